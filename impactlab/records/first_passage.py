"""When limits are first passed: times of realizations, survival, hazard and mean."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.compiling.build import build
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.errors import InvalidInput
from impactlab.kernels.bridges import follow_passages
from impactlab.kernels.random import addresses
from impactlab.records import passage_limits
from impactlab.records.jumps_of_limits import JumpsOfLimits
from impactlab.records.passage_limits import NOT_PASSED, Forms, Limit, NoiseOnLimits
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.statistics.survival import Survival

PURPOSE = "passage"
"""Of the random numbers by which paths are drawn between steps."""


class FirstPassage(Record):
    """When a limit is first passed, and which one: survival over time, hazard, mean, and the times of realizations.

    The clock starts at t = 0, with a state that `initial` of `simulate` must name: given values, "rest" or
    "stationary". A start that is not within all limits is refused.

    ``passage_time`` (realization) is NaN where no limit is passed until the horizon, which ``passage_censored`` tells;
    ``passage_cause`` has the place of the limit in the coordinate ``limit``, and ``passage_count`` counts passages of
    each. ``survival`` is the probability that none is passed until a time, ``hazard`` the rate at which survivors pass
    one. ``mean_passage_time`` is NaN where a realization is censored; ``restricted_mean_passage_time``, the mean of the
    smaller one of the passage time and the horizon, is known in any case. Each has a standard error over realizations.

    Near a limit the path between steps is drawn, given its ends and the noise, so that a passage within a step is not
    missed; also before and after an impact of a rigid contact, or an impulse, in the step. Forces that depend on rates,
    states or time are read at steps.

    A realization ends when a limit is passed, and the result has no statistics of the motion. With ``statistics=`` or
    further records all realizations run to the end.

    Parameters
    ----------
    limits : mapping
        By the name of an oscillator or a point: the limits of its displacement (m), a pair with None for no limit, or a
        number for limits on both sides of 0. Or the name of a quantity with such a range: ``("velocity", 2.0)``. By the
        name of a contact: ``("contact_force", 500.0)`` (N) or ``("indentation", 0.0)`` (m), each an upper limit.
    horizon : float, optional
        Time until which realizations are followed (s); by default the duration of the run.
    intervals : int
        Number of equal intervals of time, up to the horizon, of survival and hazard.

    Examples
    --------
    >>> il.FirstPassage({"tower": (-0.1, 0.1), "gap": ("contact_force", 500.0)}, horizon=60.0).horizon
    60.0
    """

    citation = article(
        "Agresti, A. and Coull, B. A.",
        'Approximate is better than "exact" for interval estimation of binomial proportions',
        "Am. Stat.", 52, 1998, "119", "10.1080/00031305.1998.10480550",
    )  # fmt: skip

    limits: Any = parameter()
    horizon: float | None = parameter(None, units="s", above=0.0)
    intervals: int = parameter(100, minimum=1)

    every_step: ClassVar[bool] = True
    needs_initial: ClassVar[bool] = True
    ends_run: ClassVar[bool] = True
    impacts: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "limits", tuple(map(tuple, passage_limits.limits_of(self.limits))))

    @property
    def named(self) -> tuple[Limit, ...]:
        """The limits with their names."""
        return passage_limits.limits_of(self.limits)

    @property
    def peaks(self) -> bool:  # type: ignore[override]
        """Whether a limit is of a force."""
        return any(item.quantity == "contact_force" for item in self.named)

    def resolved(self, model: Model) -> Record:
        return self.replace(limits=tuple(map(tuple, passage_limits.resolved(self.named, model))))

    def resolved_for(self, model: Model, begin: float, end: float) -> Record:
        horizon = end if self.horizon is None else self.horizon
        if horizon > end * (1.0 + 1e-9):
            raise InvalidInput(
                f"FirstPassage: the horizon of {horizon:g} s is after the end of the run at {end:g} s; change one of "
                "them."
            )
        return self.resolved(model).replace(horizon=horizon)

    def stride(self, model: Model, step: float) -> int:
        assert self.horizon is not None
        if self.horizon < step * (1.0 - 1e-9):
            raise InvalidInput(f"FirstPassage: the horizon of {self.horizon:g} s is shorter than a step of {step:g} s.")
        return 1

    def largest_step(self, model: Model) -> float:
        return passage_limits.largest_step(self.named, model)

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return Passages(self, run, realizations)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        times, causes = (np.concatenate([item[name] for item in results]) for name in ("times", "causes"))
        return self.described(times, causes)

    def described(self, times: np.ndarray, causes: np.ndarray) -> Variables:
        """Return the variables of a run, from times of passage of all realizations (s) and their causes."""
        assert self.horizon is not None
        names = [item.name for item in self.named]
        times = np.where(times <= self.horizon, times, np.nan)
        censored = np.isnan(times)
        causes = np.where(censored, NOT_PASSED, causes)
        counts = np.bincount(causes[~censored], minlength=len(names))
        found, edges = Survival(times, self.horizon), np.linspace(0.0, self.horizon, self.intervals + 1)
        each, grid, bins = ("realization",), ("survival_time",), ("hazard_time",)
        variables: Variables = {
            "passage_time": labelled(each, times, "s", "time at which a limit is first passed"),
            "passage_censored": labelled(each, censored.astype(np.int8), "1", "whether no limit is passed"),
            "passage_cause": labelled(each, causes, "1", "place of the limit that is passed; -1 for none"),
            "passage_count": labelled(("limit",), counts, "1", "number of realizations that pass a limit first"),
            "limit": (("limit",), np.array(names), {"long_name": "limit"}),
            "survival_time": labelled(grid, edges, "s", "time after the start"),
            "hazard_time": labelled(bins, 0.5 * (edges[1:] + edges[:-1]), "s", "middle of an interval of time"),
        }
        for name, dimensions, value, units, text in (
            ("survival", grid, found.probability(edges), "1", "probability that no limit is passed until a time"),
            ("hazard", bins, found.hazard(edges), "s-1", "rate at which survivors pass a limit"),
            ("mean_passage_time", (), found.mean(), "s", "mean time until a limit is first passed"),
            (
                "restricted_mean_passage_time", (), found.restricted_mean(), "s",
                "mean time until a limit is first passed, or the horizon",
            ),
        ):  # fmt: skip
            variables |= with_error(name, dimensions, *value, units, text)
        return variables

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        return 8 * (2 + 3 * len(self.limits))

    def bytes_per_block(self, run: RecordedRun) -> int:
        return 8 * len(self.limits) * len(run.plan.system.bodies)  # which velocities are limited


class Passages(Keeper):
    """Looks for the first passages of the realizations of a block."""

    wants_start = True

    def __init__(self, record: FirstPassage, run: RecordedRun, realizations: np.ndarray) -> None:
        super().__init__()
        plan = run.plan
        if plan.clock.begin:
            raise InvalidInput(
                "FirstPassage: the clock starts at t = 0, and this run continues another one; leave out "
                "continues=True, so that the state is a start."
            )
        assert record.horizon is not None
        self.limits, self.plan, self.places = record.named, plan, np.arange(len(realizations))
        self.last = int(np.ceil(record.horizon / run.step * (1.0 - 1e-12)))
        self.numbers = (realizations + plan.realizations.numbered_from).astype(np.uint32)
        self.forms: Forms = passage_limits.forms_of(self.limits, plan)
        self.pairs = np.array([item.pair for item in self.limits])
        self.tables = passage_limits.tables_of(self.limits, self.forms.kinds, plan)
        self.noise, self.jumps = (
            NoiseOnLimits.of(self.limits, plan),
            JumpsOfLimits(passage_limits.limited_velocities(self.limits, plan), plan),
        )
        self.streams = addresses(plan.realizations.seed, [item.name for item in self.limits], PURPOSE)
        self.before = np.zeros((2, len(self.limits), len(realizations)))
        self.steps, self.causes = np.full(len(realizations), np.nan), np.full(len(realizations), NOT_PASSED)

    @property
    def waiting(self) -> np.ndarray:
        """Places of the present realizations that are still to pass a limit before the horizon."""
        return self.not_passed if self.seen < self.last else np.zeros(0, np.int64)

    @property
    def not_passed(self) -> np.ndarray:
        """Places of the present realizations that have passed no limit."""
        return np.flatnonzero(np.isnan(self.steps[self.places]))

    def give_up(self, lanes: np.ndarray) -> None:
        """Wait no longer for some of the present realizations."""
        self.steps[self.places[lanes]] = np.inf

    def keep(self, lanes: np.ndarray) -> None:
        """Go on with some of the present realizations."""
        self.places, self.before = self.places[lanes], np.ascontiguousarray(self.before[:, :, lanes])

    def start(self, values: np.ndarray) -> None:
        for row, limit in enumerate(self.limits):
            begin, end = self.forms.begins[row : row + 2]
            rows, weights = slice(begin, end), self.forms.weights[begin:end]
            self.before[0, row] = weights @ values[self.forms.places[rows]] - self.forms.offsets[row]
            self.before[1, row] = weights @ values[self.forms.paces[rows]]
            here = self.before[int(limit.quantity == "velocity"), row]
            outside = np.flatnonzero((here <= limit.pair[0]) | (here >= limit.pair[1]))
            if outside.size:
                lane = int(outside[0])
                raise InvalidInput(
                    f"FirstPassage: the {limit.quantity.replace('_', ' ')} of {limit.name!r} is {here[lane]:g} at the "
                    f"start of realization {self.numbers[lane]}, not within its limits {limit.pair}; give other "
                    "limits or another initial=."
                )

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        first, number = self.seen, min(len(snapshots), self.last - self.seen)
        self.seen += len(snapshots)
        if number <= 0:
            return
        steps, causes = self.steps[self.places], self.causes[self.places]
        follow_passages(
            snapshots[:number], first, tuple(self.forms), self.pairs, self.tables, self._scales(first, number),
            (self.streams, self.numbers[self.places]), self.jumps(snapshots[:number], first, self.numbers[self.places]),
            (self.before, steps, causes),
        )  # fmt: skip
        self.steps[self.places], self.causes[self.places] = steps, causes

    def _scales(self, first: int, number: int) -> np.ndarray:
        """Return the root of the density of noise on each limit in some steps, (step, limit)."""
        density = np.tile(self.noise.density, (number, 1))
        if self.plan.noise.time_varying:
            module, forces = build(self.plan.forces.text), self.plan.forces
            times = (first + 0.5 + np.arange(number)) * self.plan.clock.step
            found = np.empty((number, self.noise.shares.shape[1]))
            module.intensity(times, forces.parameters, forces.indices, found)
            density *= found @ self.noise.shares.T
        scales: np.ndarray = np.sqrt(np.maximum(density, 0.0))
        return scales

    def result(self) -> dict[str, np.ndarray]:
        return {"times": self.steps * self.plan.clock.step, "causes": self.causes}
