"""Filtered white noises, as loops take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.integrators.arguments import Coloured, Filters, Sparse
from impactlab.integrators.base import Integrator
from impactlab.kernels.random import addresses, fill_normals, streams_of
from impactlab.kernels.series import NEAR
from impactlab.linear.coloured import FilteredMotion
from impactlab.linear.laws import coupled_systems, filtered_motions, flowing_systems

MOST_TOGETHER = 500
"""Bodies that one noise may move together: it takes some seconds, and as the cube."""

BLOCKS = 3
"""Blocks of states that are kept, and of work space."""


class FilterStart(NamedTuple):
    """Where a filter, and what it moves, begin: a root of their covariance times normal numbers."""

    streams: np.ndarray  # (3, stream) addresses
    slots: np.ndarray  # (body,)
    states: slice  # of the filter among those of all
    root: np.ndarray  # (state and x and v, normal)

    def draw(self, realizations: np.ndarray, attempt: int) -> np.ndarray:
        """Return the states of the filter, displacements and velocities of some realizations, (row, lane)."""
        normals = np.empty((4, self.streams.shape[1], len(realizations)), dtype=np.float32)
        fill_normals(self.streams, realizations, np.uint64(attempt), normals)
        rows = normals.transpose(1, 0, 2).reshape(-1, len(realizations))
        # the same bits in any block, as a matrix product would not be
        return np.asarray(sum(column[:, None] * row for column, row in zip(self.root.T, rows, strict=False)))


@dataclass(frozen=True, eq=False)
class ColouredNoises:
    """Filtered white noises on some bodies."""

    slots: np.ndarray  # (response or force,) bodies
    filters: Filters
    starts: tuple[FilterStart, ...]
    envelopes: int  # how many have one
    states: int  # of all filters

    @classmethod
    def of(cls, model: Model, integrator: Integrator, step: float, seed: tuple[int, int], coarse: bool) -> Self:
        """Return those of a model as a method takes them at a step (s); see `WhiteNoises` for a coarse run."""
        finer = 2 if coarse else 1
        interval = step / (finer * integrator.samples_per_step)
        motions = filtered_motions(model, flowing_systems(model))
        for motion in motions:
            if len(motion.slots) > MOST_TOGETHER:
                raise InvalidInput(
                    f"The coloured noise {motion.name!r} moves {len(motion.slots)} bodies at a time; {MOST_TOGETHER} "
                    "is the most. Use several sources."
                )
        counts = [motion.states for motion in motions]
        modulated = np.array([motion.modulated for motion in motions], dtype=bool)
        envelope = np.where(modulated, np.cumsum(modulated) - 1, -1).tolist()
        rows = _responses if integrator.takes_response else _forces
        slots, tables, normals = rows(motions, envelope, interval)
        names = [motion.name for motion, count in zip(motions, normals, strict=True) for _ in range(count)]
        numbers = [number for count in normals for number in range(count)]
        return cls(
            slots,
            tables._replace(streams=streams_of(seed, names, numbers), finer=finer),
            _starts(model, counts, seed),
            int(modulated.sum()),
            sum(counts),
        )

    def __bool__(self) -> bool:
        return bool(self.states)

    @property
    def time_varying(self) -> bool:
        """Whether one of them has an envelope."""
        return self.envelopes > 0

    @property
    def rows(self) -> int:
        """Rows of samples."""
        return max(len(self.filters.pairs), len(self.filters.envelopes))

    @property
    def nbytes(self) -> int:
        """Bytes that a realization takes."""
        rows = (NEAR + 1) * self.rows + BLOCKS * (len(self.filters.motion.begin) - 1 + self.states)
        return int(8 * rows + 16 * self.filters.streams.shape[1])

    @property
    def seconds(self) -> float:
        """Time that a sample takes for a realization, roughly (s)."""
        filters = self.filters
        entries = sum(len(item.values) for item in (filters.motion, filters.noise, filters.flow, filters.output))
        return float(1e-9 * filters.finer * (entries + 4 * filters.streams.shape[1]))

    def arrays(self, function: int, realizations: np.ndarray) -> Coloured:
        """Return what the loop takes for a block of some realizations; the states are to be set."""
        lanes, filters = len(realizations), self.filters
        rows = max(len(filters.motion.begin) - 1, self.states, self.rows)
        return Coloured(
            function=function,
            filters=filters,
            realizations=realizations,
            factors=np.zeros((0, BLOCKS, self.envelopes)),
            first=0,
            place=np.zeros(2, dtype=np.int64),
            kept=np.zeros((BLOCKS, self.states, lanes)),
            work=np.zeros((BLOCKS, rows, lanes)),
            normals=np.zeros((4, filters.streams.shape[1], lanes), dtype=np.float32),
        )


def _starts(model: Model, counts: Sequence[int], seed: tuple[int, int]) -> tuple[FilterStart, ...]:
    """Return where filters of so many states begin."""
    ends, result = np.cumsum(counts, dtype=int), []
    for motion, end in zip(filtered_motions(model, coupled_systems(model)), ends, strict=True):
        root = motion.start()
        streams = [addresses(seed, [motion.name], f"begin {number}") for number in range(-(-len(root) // 4))]
        states = slice(int(end) - motion.states, int(end))
        result.append(FilterStart(np.concatenate(streams, axis=1), motion.slots, states, root))
    return tuple(result)


def _responses(
    motions: Sequence[FilteredMotion], envelope: Sequence[int], interval: float
) -> tuple[np.ndarray, Filters, list[int]]:
    """Return the bodies that respond, tables without the addresses of their normals, and the numbers of these."""
    steps = [motion.steps(interval) for motion in motions]
    counts, moved = [motion.states for motion in motions], [2 * len(motion.slots) for motion in motions]
    pairs, first = [], sum(counts)
    for motion, count, which in zip(motions, moved, envelope, strict=True):
        own = first + np.arange(count)
        growing = own + count if motion.modulated else np.full(count, -1)
        pairs.append(np.stack([own, growing, np.full(count, which)], axis=1))
        first += count * (2 if motion.modulated else 1)
    tables = Filters(
        motion=_states_first([item.motion for item in steps], counts),
        noise=_states_first([item.noise for item in steps], counts),
        flow=_sparse([item.flow for item in steps]),
        output=_sparse([]),
        pairs=np.concatenate([np.zeros((0, 3), dtype=np.int64), *pairs]),
        envelopes=np.zeros(0, dtype=np.int64),
        streams=np.zeros((3, 0), dtype=np.uint64),
        finer=1,
    )
    slots = np.concatenate([np.zeros(0, dtype=np.int64), *(motion.slots for motion in motions)])
    return slots, tables, [item.noise.shape[1] for item in steps]


def _forces(
    motions: Sequence[FilteredMotion], envelope: Sequence[int], interval: float
) -> tuple[np.ndarray, Filters, list[int]]:
    """Return the same for a method that takes forces."""
    steps = [motion.own_steps(interval) for motion in motions]
    driven = [np.flatnonzero(motion.weights) for motion in motions]
    output = [
        np.outer(motion.weights[bodies], motion.filter.output)
        for motion, bodies in zip(motions, driven, strict=True)
    ]  # fmt: skip
    tables = Filters(
        motion=_sparse([motion for motion, _ in steps]),
        noise=_sparse([noise for _, noise in steps]),
        flow=_sparse([]),
        output=_sparse(output),
        pairs=np.zeros((0, 3), dtype=np.int64),
        envelopes=np.repeat(np.array(envelope, dtype=np.int64), [len(bodies) for bodies in driven]),
        streams=np.zeros((3, 0), dtype=np.uint64),
        finer=1,
    )
    slots = [motion.slots[bodies] for motion, bodies in zip(motions, driven, strict=True)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *slots]), tables, [noise.shape[1] for _, noise in steps]


def _states_first(blocks: Sequence[np.ndarray], states: Sequence[int]) -> Sparse:
    """Return a matrix of some blocks, with the rows of the states of all before all others."""
    whole = _sparse(blocks)
    of_states = [np.arange(len(block)) < count for block, count in zip(blocks, states, strict=True)]
    first = np.concatenate([np.zeros(0, dtype=bool), *of_states])
    order = np.argsort(~first, kind="stable")
    lengths = np.diff(whole.begin)[order]
    entries = [np.arange(whole.begin[row], whole.begin[row + 1]) for row in order]
    chosen = np.concatenate([np.zeros(0, dtype=np.int64), *entries])
    return Sparse(np.cumsum([0, *lengths]), whole.columns[chosen], whole.values[chosen])


def _sparse(blocks: Sequence[np.ndarray]) -> Sparse:
    """Return a matrix that has some blocks on its diagonal."""
    lengths, columns, values, column = [np.zeros(1, dtype=np.int64)], [], [], 0
    for block in blocks:
        row, place = np.nonzero(block)
        lengths.append(np.bincount(row, minlength=len(block)))
        columns.append(column + place)
        values.append(block[row, place])
        column += block.shape[1]
    none = np.zeros(0, dtype=np.int64)
    return Sparse(
        np.cumsum(np.concatenate(lengths)), np.concatenate([none, *columns]), np.concatenate([np.zeros(0), *values])
    )
