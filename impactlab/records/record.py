"""Records: what a simulation keeps besides its statistics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import Component, parameter
from impactlab.errors import InvalidInput
from impactlab.plan.plan import Plan
from impactlab.results.labels import Variables
from impactlab.results.snapshot import TIME


class Keeper:
    """Collects what one record keeps of one block: every `ratio`-th snapshot is its own. This one keeps nothing."""

    wants_start = False

    def __init__(self, ratio: int = 1) -> None:
        self.ratio, self.seen = ratio, 0

    def first_of(self, snapshots: np.ndarray) -> int:
        """Return the index of its first among the next snapshots."""
        first = (-self.seen - 1) % self.ratio
        self.seen += len(snapshots)
        return first

    def own(self, snapshots: np.ndarray) -> np.ndarray:
        """Return those of the next snapshots that are its own."""
        return snapshots[self.first_of(snapshots) :: self.ratio]

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

    @staticmethod
    def all_of(given: Any) -> list[Record]:
        """Return no record, one or several as a list, or refuse what is no record."""
        several = isinstance(given, Iterable) and not isinstance(given, str | Mapping)
        records = [] if given is None else list(given) if several else [given]
        for item in records:
            if not isinstance(item, Record):
                raise InvalidInput(f"record takes records such as il.Density(), {item!r} was given.")
        return records

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

    def bytes_per_realization(self, plan: Plan, interval: float) -> int:
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
        return _Path(np.empty((len(realizations), sample_count(plan)[1], plan.snapshot.size)), ratio)

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        paths = [result["path"] for result in results]
        path = np.concatenate(paths) if len(paths) > 1 else paths[0]
        times = ("time",), interval * np.arange(path.shape[1]), TIME
        return {"time": times, **plan.snapshot.labelled(path, "realization", "time")}


class _Path(Keeper):
    wants_start = True

    def __init__(self, path: np.ndarray, ratio: int) -> None:
        super().__init__(ratio)
        self.path, self.kept = path, 0

    def start(self, values: np.ndarray) -> None:
        self.path[:, 0], self.kept = values.T, 1

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        own = self.own(snapshots)
        self.path[:, self.kept : self.kept + len(own)] = own.transpose(2, 0, 1)
        self.kept += len(own)

    def result(self) -> dict[str, np.ndarray]:
        return {"path": self.path}


def sample_count(plan: Plan) -> tuple[float, int]:
    """Return the time between samples of the trajectories of a plan (s), and their number; 0 without any."""
    for record, ratio in plan.observed.records:
        if isinstance(record, Trajectory):
            return plan.interval(ratio), plan.clock.steps // (ratio * plan.observed.every) + 1
    return 0.0, 0


def trajectory_size(plan: Plan) -> int:
    """Return the bytes that the trajectories of a plan take."""
    return 8 * plan.realizations.number * sample_count(plan)[1] * plan.snapshot.size
