"""Processes that push bodies from sample to sample: parts of a plan, and what a block has of them.

The loop knows no such process. Before it reads samples of a series it calls a function of each process, with the
address of the arrays of the process and the number of the first sample, and finds its rows in `Series.near`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from impactlab.compiling.own_memory import Stored, function_of
from impactlab.compiling.scalars import DISABLED

Draws = list[tuple[np.ndarray, np.ndarray]]
"""Slots of bodies, and displacements and velocities of these, (2, body, lane)."""


class ProcessPart:
    """The part of a plan of a mechanism that pushes bodies by a process; see `impactlab.assembly.mechanism`."""

    record: ClassVar[type]
    """The type of its arrays in a block, a `NamedTuple` with the fields `near`, `row`, `factors` and `first`: see
    `BlockProcesses.table` and `BlockProcesses.set_envelopes`."""

    bring: ClassVar[Callable[..., None]]
    """Writes samples into rows of `near`; takes the address of its arrays and the number of the first sample."""

    slots: np.ndarray
    """(row,) bodies that it pushes."""

    envelopes: int
    """How many factors that vary in time it takes."""

    states: int = 0
    """Rows of its states, which a run can go on from."""

    labels: tuple[str, ...] = ()
    """Names of these."""

    @property
    def rows(self) -> int:
        """Rows of its samples."""
        raise NotImplementedError

    @property
    def nbytes(self) -> int:
        """Bytes that a realization takes."""
        raise NotImplementedError

    @property
    def seconds(self) -> float:
        """Time that a sample takes for a realization, roughly (s)."""
        raise NotImplementedError

    def arrays(self, realizations: np.ndarray) -> Any:
        """Return the arrays of a block: a `record`."""
        raise NotImplementedError

    def draw(
        self, arrays: Any, lanes: np.ndarray, realizations: np.ndarray, attempt: int, given: np.ndarray | None
    ) -> Draws:
        """Begin some lanes, of some realizations, with states that are drawn or given; return what these moved.

        Given states, (state, realization), are NaN where they are to be drawn.
        """
        raise NotImplementedError

    def end(self, arrays: Any, sample: int) -> np.ndarray:
        """Return the states at a sample, not before the first of the samples last taken, (state, lane)."""
        raise NotImplementedError

    @property
    def pushes(self) -> np.ndarray:
        """Changes of velocities at once by unit impulses, (source, body); without sources where there are none."""
        return np.zeros((0, 0))

    def jumps(self, realizations: np.ndarray, first: int, number: int) -> np.ndarray:
        """Return changes of velocities at once in some samples, and these times what is left of the sample.

        (2, sample, body, lane), the latter as a part of the length of the sample.
        """
        raise NotImplementedError

    def lasting(self, arrays: Any) -> list[np.ndarray]:
        """Return the arrays that a call leaves to the next one, […, lane], which may be changed."""
        return []

    def place(self, arrays: Any) -> np.ndarray:
        """Return the numbers of samples, (2,), that a call leaves to the next one, which may be changed."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Processes:
    """Processes of a run."""

    parts: tuple[ProcessPart, ...]
    finer: int  # samples of a process in one that is taken: two in a run at twice the step of another

    slots: np.ndarray = field(init=False)  # (row,) bodies of all rows
    rows: int = field(init=False)  # of all samples
    envelopes: int = field(init=False)  # factors that vary in time
    nbytes: int = field(init=False)  # bytes that a realization takes
    seconds: float = field(init=False)  # time that a sample takes for a realization, roughly (s)

    def __post_init__(self) -> None:
        none = np.zeros(0, dtype=np.int64)
        object.__setattr__(self, "slots", np.concatenate([none, *(part.slots for part in self.parts)]))
        for name in ("rows", "envelopes", "nbytes", "seconds"):
            object.__setattr__(self, name, sum(getattr(part, name) for part in self.parts))

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of all states."""
        return tuple(label for part in self.parts for label in part.labels)


class BlockProcesses:
    """The processes of a block.

    Parameters
    ----------
    processes : Processes
    realizations : (lane,) ndarray
    single : bool
        Whether the block has one lane, in arrays without an axis of lanes.
    """

    def __init__(self, processes: Processes, realizations: np.ndarray, single: bool) -> None:
        self.parts, self.realizations = processes.parts, realizations
        self.arrays = tuple(part.arrays(realizations) for part in self.parts)
        self._stored = [Stored(item, single) for item in self.arrays]
        self._functions = [function_of(part.record, part.bring, single) for part in self.parts]

    def table(self, near: np.ndarray, row: int) -> np.ndarray:
        """Return the table by which the loop calls the processes, (process, 2): addresses of arrays, and of functions.

        Their samples go to rows of `near`, (sample, row, lane), from one on.
        """
        table = np.zeros((len(self.parts), 2), dtype=object if DISABLED else np.int64)
        for place, (part, stored) in enumerate(zip(self.parts, self._stored, strict=True)):
            stored.change(near=near, row=row)
            table[place] = stored.address, self._functions[place]
            row += part.rows
        return table

    def set_envelopes(self, factors: np.ndarray, first: int) -> None:
        """Set the factors of processes that vary in time, (sample, 3, envelope), from one sample on."""
        begin = 0
        for part, stored in zip(self.parts, self._stored, strict=True):
            own = factors[..., begin : begin + part.envelopes]
            stored.change(factors=np.ascontiguousarray(own), first=first)
            begin += part.envelopes

    def draw(self, lanes: np.ndarray, attempt: int, given: np.ndarray | None) -> Draws:
        """Begin some lanes with states that are drawn, or given where not NaN; return what all processes moved."""
        result: Draws = []
        realizations, first = np.ascontiguousarray(self.realizations[lanes]), 0
        for part, item in zip(self.parts, self.arrays, strict=True):
            own = None if given is None else given[first : first + part.states]
            result += part.draw(item, lanes, realizations, attempt, own)
            first += part.states
        return result

    def end(self, sample: int) -> np.ndarray:
        """Return the states of all processes at a sample, (state, lane)."""
        both = zip(self.parts, self.arrays, strict=True)
        none = np.zeros((0, len(self.realizations)))
        return np.concatenate([none, *(part.end(item, sample) for part, item in both)])

    def lasting(self) -> list[np.ndarray]:
        """Return the arrays that a call leaves to the next one, […, lane], which may be changed."""
        both = zip(self.parts, self.arrays, strict=True)
        return [array for part, item in both for array in part.lasting(item)]

    @property
    def places(self) -> list[np.ndarray]:
        """Numbers of samples that a call leaves to the next one, (2,) of each process, which may be changed."""
        return [part.place(item) for part, item in zip(self.parts, self.arrays, strict=True)]
