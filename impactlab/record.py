"""Records: what a simulation keeps besides its statistics."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from impactlab.component import Component, parameter
from impactlab.model import Model
from impactlab.plan import Plan

Variables = dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]


class Keeper:
    """Collects what one record keeps of one block. This one keeps nothing."""

    wants_start = False

    def start(self, values: np.ndarray) -> None:
        """Take the values at t = 0, [quantity, lane]."""

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        """Take snapshots [sample, quantity, lane] of a batch."""

    def result(self) -> dict[str, np.ndarray]:
        """Return the arrays that were collected."""
        return {}


class Record(Component):
    """Something to be kept. A subclass says how often to sample, what to keep of a
    block (a `Keeper`), and how to label what the blocks kept."""

    required: ClassVar[tuple[str, ...]] = ("keeper", "label")

    every_step: ClassVar[bool] = False
    """Whether the record needs statistics that are taken at every step."""

    keeper: ClassVar[Any] = None
    """``keeper(plan, realizations, ratio)`` returns the `Keeper` of a block; every `ratio`-th
    snapshot is the record's."""

    label: ClassVar[Any] = None
    """``label(plan, results, interval)`` returns variables from the results of all blocks."""

    samples: ClassVar[bool] = True
    """Whether it looks at the bodies' states, all at the same times."""

    summed: ClassVar[tuple[str, ...]] = ()
    """Names of arrays of whole numbers that keepers return whose sum over all blocks is wanted: the first of
    the results that `label` takes has it."""

    @property
    def identity(self) -> tuple[str, ...]:
        """What two records of one run may not share: their variables would have the same names."""
        return (type(self).__name__,)

    def resolved(self, model: Model) -> Record:
        """Return the record with everything filled in that was left to be chosen."""
        return self

    def exact_interval(self) -> float | None:
        """Time between samples that the record must have (s), if it must."""
        return None

    def stride(self, model: Model, step: float) -> int:
        """Steps between samples; 0 if the record takes none."""
        return 0

    def longest_step(self, model: Model) -> float:
        """Longest step that its samples should have where any step is exact (s)."""
        return float("inf")

    def bytes_per_realization(self, plan: Plan) -> int:
        """What it keeps of a realization, beside trajectories, if that may be much."""
        return 0

    def bytes_per_block(self, plan: Plan) -> int:
        """Bytes of what is `summed` over the blocks."""
        return 0


class PerRealization(Record):
    """Each statistic also for every realization, as ``<name>_by_realization``: means over all steps."""

    every_step: ClassVar[bool] = True
    samples: ClassVar[bool] = False

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        return Keeper()

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        return {}  # the statistics are there already, one per realization


class PairedRealizations(PerRealization):
    """As `PerRealization`, but of whatever samples the ensemble's statistics are made."""

    every_step: ClassVar[bool] = False


class Trajectory(Record):
    """Displacements, velocities and contact forces over time, of all realizations.

    Parameters
    ----------
    interval : float
        Time between samples (s); the first is at t = 0, after the spin-up.
    """

    interval: float = parameter(units="s", above=0.0)

    def exact_interval(self) -> float | None:
        return self.interval

    def stride(self, model: Model, step: float) -> int:
        return round(self.interval / step)

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        quantities = 2 * len(plan.system.bodies) + len(plan.system.contacts)
        return _Path(np.empty((len(realizations), sample_count(plan)[1], quantities)), ratio)

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        paths = [result["path"] for result in results]
        path = np.concatenate(paths) if len(paths) > 1 else paths[0]
        n = len(plan.system.bodies)
        dims = ("realization", "time")
        variables: Variables = {
            "time": (("time",), interval * np.arange(path.shape[1]), {"units": "s", "long_name": "time"}),
            "displacement": (
                (*dims, "oscillator"),
                path[:, :, :n],
                {"units": "m", "long_name": "displacement"},
            ),
            "velocity": (
                (*dims, "oscillator"),
                path[:, :, n : 2 * n],
                {"units": "m s-1", "long_name": "velocity"},
            ),
        }
        if plan.system.contacts:
            attrs = {"units": "N", "long_name": "contact force"}
            variables["contact_force"] = ((*dims, "contact"), path[:, :, 2 * n :], attrs)
        return variables


class _Path(Keeper):
    wants_start = True

    def __init__(self, path: np.ndarray, ratio: int) -> None:
        self.path, self.ratio, self.seen, self.kept = path, ratio, 0, 0

    def start(self, values: np.ndarray) -> None:
        self.path[:, 0], self.kept = values.T, 1

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        own = snapshots[first_own(self.seen, self.ratio) :: self.ratio]
        self.seen += len(snapshots)
        self.path[:, self.kept : self.kept + len(own)] = own.transpose(2, 0, 1)
        self.kept += len(own)

    def result(self) -> dict[str, np.ndarray]:
        return {"path": self.path}


def sample_count(plan: Plan) -> tuple[float, int]:
    """Return the time between samples of the trajectories of a plan (s), and their number; 0 without any."""
    for record, ratio in plan.observed.records:
        if isinstance(record, Trajectory):
            return ratio * plan.observed.every * plan.clock.step, plan.clock.steps // (ratio * plan.observed.every) + 1
    return 0.0, 0


def trajectory_size(plan: Plan) -> int:
    """Return the bytes that the trajectories of a plan take."""
    quantities = 2 * len(plan.system.bodies) + len(plan.system.contacts)
    return 8 * plan.realizations.number * sample_count(plan)[1] * quantities


def first_own(seen: int, ratio: int) -> int:
    """Index of the record's first snapshot among the next, when `seen` have gone before."""
    return (-seen - 1) % ratio
