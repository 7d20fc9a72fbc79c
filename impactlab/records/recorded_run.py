"""The part of a run that a record may use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlab.inputs import checked, known_name
from impactlab.plan.plan import Plan
from impactlab.results.snapshot import ALL, STATES, places_of
from impactlab.statistics.subsamples import for_skewness, in_subsamples, mean_with_error


@checked
class RecordedRun:
    """The part of a run that a record may use, for all realizations or for the realizations of a block.

    Parameters
    ----------
    plan : Plan
        The whole plan of the run. It is private to impactlab and changes without notice.
    estimates : impactlab.statistics.estimate.Estimates, optional
        The statistics of the run when it is over, as private.

    Examples
    --------
    >>> class Length(il.Record):
    ...     def stride(self, model, step):
    ...         return 1
    ...
    ...     def keeper(self, run, realizations, ratio):
    ...         return il.Keeper(ratio)
    ...
    ...     def label(self, run, results, interval):
    ...         return {"length": ((), run.duration, {"units": "s"})}
    >>> il.simulate(network, 5.0, realizations=64, record=Length(), rng=1).length.item()
    5.0
    """

    def __init__(self, plan: Plan, estimates: Any = None) -> None:
        self.plan, self.estimates = plan, estimates

    @property
    def realizations(self) -> int:
        """Number of realizations of all blocks, without those that diverged."""
        return self.plan.realizations.finite

    @property
    def step(self) -> float:
        """Time step (s)."""
        return self.plan.clock.step

    @property
    def begin(self) -> float:
        """Time at which statistics begin (s): 0, or the end of the earlier run from which this one goes on."""
        return self.plan.clock.begin * self.plan.clock.step

    @property
    def duration(self) -> float:
        """Time over which statistics are taken (s)."""
        return self.plan.clock.duration

    @property
    def parts(self) -> int:
        """Independent samples that a realization is cut into: 1, or its batches where realizations are few."""
        return self.plan.samples_per_realization

    def interval(self, ratio: int) -> float:
        """Return the time between every `ratio`-th snapshot (s)."""
        return self.plan.interval(ratio)

    def names(self, quantity: str) -> tuple[str, ...]:
        """Return the names of the bodies, contacts, points or states that have a quantity, in their order.

        Parameters
        ----------
        quantity : str
            "displacement", "velocity", "contact_force", "law_state", "point_displacement" or "point_velocity".
        """
        known_name("quantity", quantity, (*ALL, STATES.name))
        return self.plan.snapshot.names(quantity)

    def values(self, snapshots: np.ndarray, quantity: str, names: Sequence[str] | None = None) -> np.ndarray:
        """Return a quantity from snapshots.

        Parameters
        ----------
        snapshots : (sample, row, lane) ndarray
            As keepers get them; a lane is a realization.
        quantity : str
            As for `names`.
        names : sequence of str, optional
            Bodies, contacts, points or states; all by default.

        Returns
        -------
        (sample, name, lane) ndarray
            Forces of impulsive contacts are means since the keeper's sample before.

        Raises
        ------
        InvalidInput
            If the quantity or a name is unknown.
        """
        known = self.names(quantity)
        places = places_of(known)
        for name in names or ():
            known_name(ALL[quantity].dimension if quantity in ALL else STATES.dimension, name, places)
        reader = self.plan.snapshot.reader(quantity, known if names is None else names)
        found: np.ndarray = reader(snapshots)[:, reader.rows]
        return found

    def mean(self, sums: Sequence[np.ndarray], samples: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean over all samples, and its standard error, which is larger where few samples make the scatter.

        Parameters
        ----------
        sums : sequence of (lane, part, …) ndarray
            Sums over samples, block by block.
        samples : sequence of (lane, part) ndarray
            How many samples there are in each.

        Returns
        -------
        mean, error : (…) ndarray
            The error is NaN where independent samples are too few.
        """
        parts, number = in_subsamples(list(sums)), in_subsamples(list(samples))
        shape = parts.shape[1:]
        columns = parts.reshape(len(parts), -1)
        mean, error, residuals = mean_with_error(columns, number[:, None], self.plan.realizations.trusted)
        return mean.reshape(shape), (error * for_skewness(residuals)).reshape(shape)
