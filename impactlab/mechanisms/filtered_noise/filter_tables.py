"""Filters of noise, and what they move in a step, as tables that loops take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactlab.mechanisms.filtered_noise.filtered_motion import FilteredMotion
from impactlab.mechanisms.filtered_noise.from_sample_to_sample import Filters
from impactlab.mechanisms.noise_processes import envelopes_of, pairs_of, responding, sparse
from impactlab.mechanisms.sampled_responses import Sparse


def tables_of_responses(motions: Sequence[FilteredMotion], interval: float) -> tuple[np.ndarray, Filters, list[int]]:
    """Return the bodies that respond, tables without the addresses of their normals, and the numbers of these."""
    steps = [motion.steps(interval) for motion in motions]
    counts = [motion.states for motion in motions]
    tables = Filters(
        motion=_states_first([item.motion for item in steps], counts),
        noise=_states_first([item.noise for item in steps], counts),
        flow=sparse([item.flow for item in steps]),
        output=sparse([]),
        pairs=pairs_of(motions),
        envelopes=np.zeros(0, dtype=np.int64),
        streams=np.zeros((3, 0), dtype=np.uint64),
        finer=1,
    )
    return responding(motions), tables, [item.noise.shape[1] for item in steps]


def tables_of_forces(motions: Sequence[FilteredMotion], interval: float) -> tuple[np.ndarray, Filters, list[int]]:
    """Return the same for a method that takes forces."""
    steps = [motion.own_steps(interval) for motion in motions]
    driven = [np.flatnonzero(motion.weights) for motion in motions]
    output = [
        np.outer(motion.weights[bodies], motion.filter.output)
        for motion, bodies in zip(motions, driven, strict=True)
    ]  # fmt: skip
    tables = Filters(
        motion=sparse([motion for motion, _ in steps]),
        noise=sparse([noise for _, noise in steps]),
        flow=sparse([]),
        output=sparse(output),
        pairs=np.zeros((0, 3), dtype=np.int64),
        envelopes=np.repeat(envelopes_of(motions), [len(bodies) for bodies in driven]),
        streams=np.zeros((3, 0), dtype=np.uint64),
        finer=1,
    )
    slots = [motion.slots[bodies] for motion, bodies in zip(motions, driven, strict=True)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *slots]), tables, [noise.shape[1] for _, noise in steps]


def _states_first(blocks: Sequence[np.ndarray], states: Sequence[int]) -> Sparse:
    """Return a matrix of some blocks, with the rows of the states of all before all others."""
    whole = sparse(blocks)
    of_states = [np.arange(len(block)) < count for block, count in zip(blocks, states, strict=True)]
    first = np.concatenate([np.zeros(0, dtype=bool), *of_states])
    order = np.argsort(~first, kind="stable")
    lengths = np.diff(whole.begin)[order]
    entries = [np.arange(whole.begin[row], whole.begin[row + 1]) for row in order]
    chosen = np.concatenate([np.zeros(0, dtype=np.int64), *entries])
    return Sparse(np.cumsum([0, *lengths]), whole.columns[chosen], whole.values[chosen])
