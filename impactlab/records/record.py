"""Records: what a simulation keeps besides its statistics."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import Component
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, suggestion
from impactlab.results.labels import Variables
from impactlab.results.snapshot import ALL, QUANTITIES, Snapshot, places_of


@checked
class Keeper:
    """Collects the samples of one record in one block of realizations; this one keeps nothing.

    Blocks run on several threads or processes, each with a keeper of its own. Snapshots are arrays
    ``[sample, row, lane]``, a lane being a realization, of which every `ratio`-th is this keeper's own: other records
    of the run have samples at other times. `RecordedRun.values` reads them.

    Parameters
    ----------
    ratio : int
        Snapshots from one sample of this record to the next.
    early : int
        Snapshots before the first sample, not counting the one at t = 0.

    Examples
    --------
    >>> il.Keeper(ratio=2).own(np.zeros((6, 1, 1))).shape
    (3, 1, 1)
    """

    wants_start, wants_end = False, False

    def __init__(self, ratio: int = 1, early: int = 0) -> None:
        self.ratio, self.seen = ratio, -early

    def first_of(self, snapshots: np.ndarray) -> int:
        """Return the index of the first own sample among the next snapshots."""
        first = max((-self.seen - 1) % self.ratio, -self.seen - 1)
        self.seen += len(snapshots)
        return first

    def own(self, snapshots: np.ndarray) -> np.ndarray:
        """Return the own samples among the next snapshots; it counts them, so that it is called once for each."""
        return snapshots[self.first_of(snapshots) :: self.ratio]

    def start(self, values: np.ndarray) -> None:
        """Take the snapshot at t = 0, ``[row, lane]``; only if `wants_start`."""

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        """Take the next snapshots, after t = 0 and up to the end of the run.

        Parameters
        ----------
        snapshots : (sample, row, lane) ndarray
            All snapshots, of which `own` returns this keeper's. They may not be changed, nor kept without a copy.
        batch : int
            Number of the batch of the statistics that they belong to, from 0 on.
        """

    def end(self, values: np.ndarray) -> None:
        """Take the state from which another run can go on, ``[row, lane]``; for `FinalState`, if `wants_end`."""

    def result(self) -> dict[str, np.ndarray]:
        """Return the arrays that were collected, by name."""
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
    """Data to be kept beside the statistics: a subclass says when to sample, what to keep, and how to label it.

    A subclass declares its settings with `parameter`, defines `keeper` and `label`, and either `exact_interval` or
    `stride`. It may use `Record`, `Keeper`, `RecordedRun`, `parameter` and `InvalidInput`, which stay as they are, and
    the ``network`` of a model. Where other processes run the blocks they must be able to import the class. A file of
    results can be rerun where the class is imported, or offered by an entry point in the group
    ``impactlab.components``.

    Examples
    --------
    >>> isinstance(il.Density(), il.Record)
    True
    >>> result = il.simulate(network, 5.0, realizations=64, record=[il.Density(), il.PerRealization()], rng=1)
    >>> result.density_displacement.dims
    ('oscillator', 'displacement_bin')
    """

    required: ClassVar[tuple[str, ...]] = ("keeper", "label")

    every_step: ClassVar[bool] = False
    """Whether it needs samples within contact-free intervals, which are crossed at once otherwise."""

    @abstractmethod
    def keeper(self, run: Any, realizations: np.ndarray, ratio: int) -> Keeper:
        """Return the keeper of a block.

        Parameters
        ----------
        run : impactlab.RecordedRun
            The run.
        realizations : (lane,) ndarray
            Indices of the realizations of the block.
        ratio : int
            Snapshots from one sample of this record to the next, which the keeper takes.
        """

    @abstractmethod
    def label(self, run: Any, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        """Return the variables of the dataset.

        Parameters
        ----------
        run : impactlab.RecordedRun
            The run.
        results : list of dict
            What the keepers returned, block by block in the order of the realizations.
        interval : float
            Time between samples (s).

        Returns
        -------
        dict
            ``(dimensions, values, attributes)`` by the name of the variable, with ``units`` and ``long_name``.
        """

    peaks: ClassVar[bool] = False
    """Whether snapshots hold the largest contact forces since the last one, where these are read between steps."""

    needs_initial: ClassVar[bool] = False
    """Whether the state at t = 0 must be given by ``initial=``, since the result depends on it."""

    ends_run: ClassVar[bool] = False
    """Whether a realization may end before the run does: it then is over where nothing else is wanted of it."""

    kicks: ClassVar[bool] = False
    """Whether snapshots hold the velocities at which forces of kicks do their work, too."""

    impacts: ClassVar[bool] = False
    """Whether snapshots hold what the impacts of rigid contacts within steps tell, where there are such contacts."""

    samples: ClassVar[bool] = True
    """Whether it looks at the bodies' states, all at the same times."""

    copies: ClassVar[int] = 3
    """How many times what keepers return of realizations is in memory while it is labelled."""

    summed: ClassVar[tuple[str, ...]] = ()
    """Names of arrays of whole numbers that keepers return whose sum over all blocks is wanted: the first of
    the results that `label` takes has it."""

    @staticmethod
    def all_of(given: Any) -> list[Record]:
        """Return one record or several as a list, or refuse what is no record."""
        several = isinstance(given, Iterable) and not isinstance(given, str | Mapping)
        records = list(given) if several else [given]
        for item in records:
            if not isinstance(item, Record):
                raise InvalidInput(f"record takes records such as il.Density(), not {item!r}.")
        return records

    @property
    def identity(self) -> tuple[str, ...]:
        """What two records of one run may not share: their variables would have the same names."""
        return (type(self).__name__,)

    def resolved(self, model: Model) -> Record:
        """Return the record with all settings chosen; names that ``model.network`` does not have are refused here."""
        return self

    def resolved_for(self, model: Model, begin: float, end: float) -> Record:
        """Return the same for a run between two times, the spin-up before t = 0 (s)."""
        return self.resolved(model)

    def going_on(self, begin: float) -> Record:
        """Return the record of a run that goes on from an earlier one at a time (s), from which samples are counted."""
        return self

    def read(self, plan: Any) -> Sequence[int] | np.ndarray | None:
        """Return the rows of snapshots that its keepers read, where the others need not be written; None for all."""
        return None

    def exact_interval(self) -> float | None:
        """Time between samples that the record must have (s), if it must: the step of the run divides it."""
        return None

    @property
    def first_sample(self) -> float:
        """Time of the first sample (s); others follow after whole intervals."""
        return 0.0

    def stride(self, model: Model, step: float) -> int:
        """Steps between samples, by default those of `exact_interval`; 0 if the record takes none."""
        interval = self.exact_interval()
        return 0 if interval is None else round(interval / step)

    def longest_step(self, model: Model) -> float:
        """Longest step that its samples should have where any step is exact (s)."""
        return float("inf")

    def largest_step(self, model: Model) -> float:
        """Longest step that it can look at, whatever the method (s)."""
        return float("inf")

    def bytes_per_realization(self, run: Any, interval: float) -> int:
        """Bytes that keepers return of a realization, if these may be many; a run beyond the memory is refused."""
        return 0

    def bytes_per_block(self, run: Any) -> int:
        """Bytes of what is `summed` over the blocks."""
        return 0


def names_of(record: Record, kind: str, names: Sequence[str] | None, quantity: str, model: Model) -> tuple[str, ...]:
    """Return the names for which a record keeps a quantity, by default all; refuse names without the quantity."""
    snapshot = Snapshot(model.bodies.names, tuple(model.network.contacts), points=model.points)
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
