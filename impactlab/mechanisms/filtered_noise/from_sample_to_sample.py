"""Filtered white noises: the states of filters and what they move, from sample to sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.compiling.intrinsics import value_at
from impactlab.compiling.jit import kernel
from impactlab.compiling.records import Blocks, Cube, Normals, Realizations, Slots, SlotTable, Streams
from impactlab.kernels.random import fill_normals
from impactlab.mechanisms.sampled_responses import VALUE, Sparse, add_product, clear_rows, next_responses, set_rows

START, BEGIN, END = range(3)
"""Rows of `Coloured.kept`: states at the start of the run, and where the samples that were last taken begin and end."""

STATES, MOVED, NEXT = range(3)
"""Blocks of `Coloured.work`: states of the filters, what a sample makes of them, and responses."""


class Filters(NamedTuple):
    """Filters of noise and what they move; see `FilteredSteps`."""

    motion: Sparse  # states, then responses, by states
    noise: Sparse  # the same by normal numbers
    flow: Sparse  # of the responses
    output: Sparse  # forces by states, where methods take these
    pairs: SlotTable  # (response, 3) rows of both parts of each response, -1 for none, and which envelope it has or -1
    envelopes: Slots  # (output,) which envelope each force has, -1 for none
    streams: Streams  # (3, normal) addresses of the normal numbers
    finer: int  # how many samples of the noise there are in one that is taken


class Coloured(NamedTuple):
    """Filtered white noises on some bodies, which go from sample to sample as the loop does."""

    filters: Filters
    realizations: Realizations  # (lane,) indices
    factors: Cube  # (sample, 3, envelope) value at a sample; mean, and growth in half a sample from there on
    first: int  # number of the first of these samples
    place: Slots  # (2,) numbers of the samples of the last two of `kept`
    kept: Blocks  # [3, state, lane] states at the start, and where the last samples that were taken begin and end
    work: Blocks  # [3, row, lane]
    normals: Normals  # (4, normal, lane) single precision
    near: Blocks  # (NEAR + 1, row, lane) samples of series, see `impactlab.integrators.arguments.Series`
    row: int  # first of the rows that are brought here


@kernel
def next_states(coloured, number, fresh, states, moved):  # type: ignore[no-untyped-def]
    """Carry the states of the filters over one sample of the noise, of some number; `moved` has all rows of it.

    Normal numbers come four at a time, which are there already unless they are to be `fresh`.
    """
    filters = coloured.filters
    if fresh or number % 4 == 0:
        fill_normals(filters.streams, coloured.realizations, np.uint64(number // 4), coloured.normals)
    clear_rows(moved)
    add_product(filters.motion, states, moved)
    add_product(filters.noise, coloured.normals[number % 4], moved)
    set_rows(moved, coloured.kept.shape[1], states)


@kernel
def write_forces(coloured, number, states, near):  # type: ignore[no-untyped-def]
    """Write the forces at a sample of some number to rows of lanes."""
    envelopes, sample = coloured.filters.envelopes, number - coloured.first
    clear_rows(near)
    add_product(coloured.filters.output, states, near)
    for row in range(envelopes.shape[0]):
        if envelopes[row] >= 0:
            factor = coloured.factors[sample, VALUE, envelopes[row]]
            for lane in range(near.shape[1]):
                near[row, lane] *= factor


@kernel
def bring_samples(coloured, first):  # type: ignore[no-untyped-def]
    """Write samples first, first + 1, … of all lanes to rows of `near`.

    Responses begin at 0 with the first sample: only what they do from one sample to the next matters to bodies. States
    are kept where the samples begin and end, so that these can be written again, and others be gone on to.
    """
    near = coloured.near
    filters, place, kept = coloured.filters, coloured.place, coloured.kept
    states, moved, ahead = coloured.work[STATES], coloured.work[MOVED], coloured.work[NEXT]
    rows, forces, finer = kept.shape[1], filters.envelopes.shape[0], filters.finer
    own, last = coloured.row, near.shape[0] - 1
    end = own + max(filters.pairs.shape[0], forces)
    if first >= place[1]:
        at, known = place[1], END
    elif first >= place[0]:
        at, known = place[0], BEGIN
    else:
        at, known = 0, START
    set_rows(kept[known], rows, states)
    for number in range(finer * at, finer * first):
        next_states(coloured, number, number == finer * at, states, moved)
    set_rows(states, rows, kept[BEGIN])
    clear_rows(near[0, own:end])
    for sample in range(last):
        if forces:
            write_forces(coloured, finer * (first + sample), states, near[sample, own:end])
        else:
            set_rows(near[sample, own:end], filters.pairs.shape[0], near[sample + 1, own:end])
        for number in range(finer * (first + sample), finer * (first + sample + 1)):
            next_states(coloured, number, number == finer * first, states, moved)
            if not forces:
                column = number - coloured.first
                next_responses(filters, coloured.factors, column, moved, ahead, near[sample + 1, own:end])
                set_rows(ahead, filters.pairs.shape[0], near[sample + 1, own:end])
    if forces:
        write_forces(coloured, finer * (first + last), states, near[last, own:end])
    set_rows(states, rows, kept[END])
    place[0], place[1] = first, first + last


def bring_coloured(place, first):  # type: ignore[no-untyped-def]
    """Bring samples near; `place` is the address of a `Coloured`."""
    bring_samples(value_at(place), first)


def filter_states(coloured: Coloured, sample: int) -> np.ndarray:
    """Return the states of all filters at a sample, not before the first of those last taken, (row, lane)."""
    filters, states = coloured.filters, np.array(coloured.kept[BEGIN], dtype=float)
    if not len(states):
        return states
    normals = np.empty((4, filters.streams.shape[1], len(coloured.realizations)), dtype=np.float32)
    motion, noise = _dense(filters.motion, *2 * (len(states),)), _dense(filters.noise, len(states), normals.shape[1])
    begin = filters.finer * int(coloured.place[0])
    for number in range(begin, filters.finer * sample):
        if number == begin or number % 4 == 0:
            fill_normals(filters.streams, coloured.realizations, np.uint64(number // 4), normals)
        states = motion @ states + noise @ normals[number % 4]
    return states


def _dense(matrix: Sparse, rows: int, columns: int) -> np.ndarray:
    """Return the first rows of a matrix with its zeros."""
    result, count = np.zeros((rows, columns)), matrix.begin[rows]
    row = np.repeat(np.arange(rows), np.diff(matrix.begin[: rows + 1]))
    np.add.at(result, (row, matrix.columns[:count]), matrix.values[:count])
    return result
