"""Records: what a simulation keeps besides its statistics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import Component, suggestion
from impactlab.errors import InvalidInput
from impactlab.results.snapshot import ALL, QUANTITIES, Snapshot, places_of


class Keeper:
    """Collects what one record keeps of one block: every `ratio`-th snapshot is its own. This one keeps nothing.

    The first one may come after `early` snapshots, that at t = 0 aside.
    """

    wants_start, wants_end = False, False

    def __init__(self, ratio: int = 1, early: int = 0) -> None:
        self.ratio, self.seen = ratio, -early

    def first_of(self, snapshots: np.ndarray) -> int:
        """Return the index of its first among the next snapshots."""
        first = max((-self.seen - 1) % self.ratio, -self.seen - 1)
        self.seen += len(snapshots)
        return first

    def own(self, snapshots: np.ndarray) -> np.ndarray:
        """Return those of the next snapshots that are its own."""
        return snapshots[self.first_of(snapshots) :: self.ratio]

    def start(self, values: np.ndarray) -> None:
        """Take the values at t = 0, [quantity, lane]."""

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        """Take snapshots [sample, quantity, lane] of a batch."""

    def end(self, values: np.ndarray) -> None:
        """Take the values at the end, [quantity, lane]."""

    def result(self) -> dict[str, np.ndarray]:
        """Return the arrays that were collected."""
        return {}


class IntervalMeans:
    """Turns rows of snapshots that are means since the snapshot before into means since the last one of a keeper."""

    def __init__(self, rows: np.ndarray, keeper: Keeper) -> None:
        self.rows, self.ratio, self.seen, self.sum = rows, keeper.ratio, keeper.seen, 0.0

    def __call__(self, snapshots: np.ndarray) -> np.ndarray:
        """Return the next snapshots, with these means in those that are the keeper's own."""
        if self.ratio < 2 or not len(self.rows):  # 0 of a keeper that takes none
            return snapshots
        own = slice((-self.seen - 1) % self.ratio, None, self.ratio)
        ends = np.arange(len(snapshots))[own]
        rows = np.concatenate([snapshots[:, self.rows], np.zeros((1, len(self.rows), snapshots.shape[2]))])
        sums = np.add.reduceat(rows, [0, *(ends + 1)], axis=0)
        sums[0] += self.sum
        self.seen, self.sum = self.seen + len(snapshots), sums[-1]
        result = snapshots.copy()
        result[own, self.rows] = sums[:-1] / self.ratio
        return result


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

    peaks: ClassVar[bool] = False
    """Whether snapshots hold the largest contact forces since the last one, where these are read between steps."""

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
                raise InvalidInput(f"record takes records such as il.Density(), not {item!r}.")
        return records

    @property
    def identity(self) -> tuple[str, ...]:
        """What two records of one run may not share: their variables would have the same names."""
        return (type(self).__name__,)

    def resolved(self, model: Model) -> Record:
        """Return the record with everything filled in that was left to be chosen."""
        return self

    def resolved_for(self, model: Model, begin: float, end: float) -> Record:
        """Return the same for a run between two times, the spin-up before t = 0 (s)."""
        return self.resolved(model)

    def exact_interval(self) -> float | None:
        """Time between samples that the record must have (s), if it must."""
        return None

    @property
    def first_sample(self) -> float:
        """Time of the first sample (s); others follow after whole intervals."""
        return 0.0

    def stride(self, model: Model, step: float) -> int:
        """Steps between samples; 0 if the record takes none."""
        return 0

    def longest_step(self, model: Model) -> float:
        """Longest step that its samples should have where any step is exact (s)."""
        return float("inf")

    def bytes_per_realization(self, plan: Any, interval: float) -> int:
        """What it keeps of a realization, beside trajectories, if that may be much."""
        return 0

    def bytes_per_block(self, plan: Any) -> int:
        """Bytes of what is `summed` over the blocks."""
        return 0


def names_of(record: Record, kind: str, names: Sequence[str] | None, quantity: str, model: Model) -> tuple[str, ...]:
    """Return the names of which a record keeps a quantity, by default all; refuse those that do not have it."""
    snapshot = Snapshot(model.bodies, tuple(model.network.contacts), points=model.points)
    known = snapshot.names(quantity)
    places = places_of(known)
    other = quantity.removeprefix("point_") if quantity not in QUANTITIES else f"point_{quantity}"
    for name in names or ():
        if name not in places:
            hint = suggestion(name, known)
            if other in ALL and name in snapshot.names(other):
                hint = f"the quantity of a {'body' if other in QUANTITIES else 'point'} is {other!r}"
            raise InvalidInput(f"{type(record).__name__}: there is no {kind} {name!r}; {hint}")
    return tuple(names or known)
