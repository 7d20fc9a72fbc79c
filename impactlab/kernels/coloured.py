"""Filtered white noises and impulses: the states of filters and what they move, from sample to sample."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.jit import kernel
from impactlab.kernels.random import fill_normals, normal_pair, philox
from impactlab.kernels.scalars import scalar

START, BEGIN, END = 0, 1, 2
"""Rows of `Coloured.kept`: states at the start of the run, and where the samples that were last taken begin and end."""

VALUE, MEAN, SLOPE = 0, 1, 2
"""Rows of `Coloured.factors` at a sample: envelope there, mean until the next one, and growth in half of that time."""

STATES, MOVED, NEXT = 0, 1, 2
"""Blocks of `Coloured.work`: states of the filters, what a sample makes of them, and responses."""


MOST_IMPULSES = 1 << 16
"""Impulses of a sample that have random numbers of their own."""

_LOW, _32, _UNIT, _TINY = np.uint64(0xFFFFFFFF), np.uint64(32), 2.0**-32, 1e-18


@kernel
def add_product(matrix, given, result):  # type: ignore[no-untyped-def]
    """Add the product of a `Sparse` matrix and rows of lanes to other rows of lanes."""
    for row in range(matrix.begin.shape[0] - 1):
        for entry in range(matrix.begin[row], matrix.begin[row + 1]):
            value, column = matrix.values[entry], matrix.columns[entry]
            for lane in range(result.shape[1]):
                result[row, lane] += value * given[column, lane]


@kernel
def set_rows(source, rows, result):  # type: ignore[no-untyped-def]
    """Copy the first rows of lanes."""
    for row in range(rows):
        for lane in range(result.shape[1]):
            result[row, lane] = source[row, lane]


@kernel
def clear_rows(result):  # type: ignore[no-untyped-def]
    """Set rows of lanes to 0."""
    for row in range(result.shape[0]):
        for lane in range(result.shape[1]):
            result[row, lane] = 0.0


@scalar
def poisson_number(expected, high, low):  # type: ignore[no-untyped-def]
    """Return a number of Poisson's distribution from two words of 32 bits."""
    chance = (float(high) + (float(low) + 0.5) * _UNIT) * _UNIT
    part = np.exp(-expected)
    below, number = part, 0
    while chance > below and (number < expected or part > _TINY):
        number += 1
        part *= expected / number
        below += part
    return number


@kernel
def fill_moments(shots, realizations, number, moments):  # type: ignore[no-untyped-def]
    """Write sums of the sizes of all impulses of a sample, of some number, times Chebyshev polynomials of their times.

    Times go from -1 to 1 in a sample. Two words tell how many impulses there are, by the inverse of Poisson's
    distribution; each has a block of words of its own, of which one is the time and two are the size.
    """
    sources = shots.begin.shape[0] - 1
    streams, numbers = shots.streams, shots.numbers
    c0, c1 = np.uint32(np.uint64(number) & _LOW), np.uint32(np.uint64(number) >> _32)
    for source in range(sources):
        begin, end, own = shots.begin[source], shots.begin[source + 1], sources + source
        k0, k1, c3 = streams[0, source], streams[1, source], np.uint32(streams[2, source])
        for row in range(begin, end):
            for lane in range(moments.shape[1]):
                moments[row, lane] = 0.0
        for lane in range(moments.shape[1]):
            w0, w1, _, _ = philox(c0, c1, realizations[lane], c3, k0, k1)
            for impulse in range(poisson_number(numbers[0, source], np.uint32(w0), np.uint32(w1))):
                block = np.uint64(number) * np.uint64(MOST_IMPULSES) + np.uint64(impulse)
                a, _, b, c = philox(
                    np.uint32(block & _LOW),
                    np.uint32(block >> _32),
                    realizations[lane],
                    np.uint32(streams[2, own]),
                    streams[0, own],
                    streams[1, own],
                )
                place = 2.0 * (float(np.uint32(a)) + 0.5) * _UNIT - 1.0
                normal, _ = normal_pair(np.uint32(b), np.uint32(c))
                last, value = 0.0, numbers[1, source] + numbers[2, source] * np.float64(normal)
                factor = place
                for row in range(begin, end):
                    moments[row, lane] += value
                    last, value = value, factor * value - last
                    factor = 2.0 * place


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
    if coloured.shots.streams.shape[1]:
        fill_moments(coloured.shots, coloured.realizations, number, coloured.moments)
        add_product(coloured.shots.response, coloured.moments, moved)
    set_rows(moved, coloured.kept.shape[1], states)


@kernel
def next_responses(coloured, number, moved, ahead, near):  # type: ignore[no-untyped-def]
    """Carry the responses in `near` over one sample, to the rows `ahead`."""
    pairs, sample = coloured.filters.pairs, number - coloured.first
    clear_rows(ahead)
    add_product(coloured.filters.flow, near, ahead)
    for row in range(pairs.shape[0]):
        own, growing, envelope = pairs[row, 0], pairs[row, 1], pairs[row, 2]
        if envelope < 0:
            for lane in range(ahead.shape[1]):
                ahead[row, lane] += moved[own, lane]
        else:
            mean = coloured.factors[sample, MEAN, envelope]
            slope = coloured.factors[sample, SLOPE, envelope]
            for lane in range(ahead.shape[1]):
                ahead[row, lane] += mean * moved[own, lane] + slope * moved[growing, lane]


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
def bring_coloured(series, first):  # type: ignore[no-untyped-def]
    """Write samples first, first + 1, … of all lanes to the last rows of `series.near`.

    Responses begin at 0 with the first sample: only what they do from one sample to the next matters to bodies. States
    are kept where the samples begin and end, so that these can be written again, and others be gone on to.
    """
    coloured, near = series.coloured, series.near
    filters, place, kept = coloured.filters, coloured.place, coloured.kept
    states, moved, ahead = coloured.work[STATES], coloured.work[MOVED], coloured.work[NEXT]
    rows, forces, finer = kept.shape[1], filters.envelopes.shape[0], filters.finer
    own, last = series.samples.shape[1], near.shape[0] - 1
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
    clear_rows(near[0, own:])
    for sample in range(last):
        if forces:
            write_forces(coloured, finer * (first + sample), states, near[sample, own:])
        else:
            set_rows(near[sample, own:], filters.pairs.shape[0], near[sample + 1, own:])
        for number in range(finer * (first + sample), finer * (first + sample + 1)):
            next_states(coloured, number, number == finer * first, states, moved)
            if not forces:
                next_responses(coloured, number, moved, ahead, near[sample + 1, own:])
                set_rows(ahead, filters.pairs.shape[0], near[sample + 1, own:])
    if forces:
        write_forces(coloured, finer * (first + last), states, near[last, own:])
    set_rows(states, rows, kept[END])
    place[0], place[1] = first, first + last
