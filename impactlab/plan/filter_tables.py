"""Filters of noise and impulses, and what they move in a step, as tables that loops take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactlab.integrators.arguments import Filters, Shots, Sparse
from impactlab.kernels.random import addresses
from impactlab.linear.coloured import FilteredMotion
from impactlab.linear.impulses import ImpulsiveMotion


def tables_of_responses(
    motions: Sequence[FilteredMotion | ImpulsiveMotion], envelope: Sequence[int], interval: float
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


def tables_of_shots(
    motions: Sequence[FilteredMotion | ImpulsiveMotion], interval: float, seed: tuple[int, int]
) -> Shots:
    """Return the impulses among what moves bodies, and what they do in the time of a sample (s)."""
    impulsive = [motion for motion in motions if isinstance(motion, ImpulsiveMotion)]
    if not impulsive:
        return Shots(_sparse([]), np.zeros(1, dtype=np.int64), np.zeros((3, 0)), np.zeros((3, 0), dtype=np.uint64))
    blocks = [
        motion.steps(interval).impulses
        if isinstance(motion, ImpulsiveMotion)
        else np.zeros((motion.states + 2 * len(motion.slots) * (1 + motion.modulated), 0))
        for motion in motions
    ]
    names = [motion.name for motion in impulsive]
    streams = [addresses(seed, names, purpose) for purpose in ("impulses", "impulse sizes")]
    numbers = [(item.rate * interval, item.mean, item.deviation) for item in (motion.impulses for motion in impulsive)]
    return Shots(
        response=_states_first(blocks, [motion.states for motion in motions]),
        begin=np.cumsum([0, *(block.shape[1] for block in blocks if block.shape[1])]),
        numbers=np.array(numbers).T.copy(),
        streams=np.concatenate(streams, axis=1),
    )


def tables_of_forces(
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
