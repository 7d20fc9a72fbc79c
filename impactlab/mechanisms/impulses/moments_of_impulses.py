"""Impulses at random times in the loop: the moments of those in a sample, and responses from sample to sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.compiling.intrinsics import value_at
from impactlab.compiling.jit import kernel
from impactlab.compiling.records import Block, Blocks, Cube, Realizations, Slots, SlotTable, Streams, Table
from impactlab.compiling.scalars import scalar
from impactlab.kernels.random import LOW, WORD, normal_pair, philox
from impactlab.mechanisms.sampled_responses import Sparse, add_product, clear_rows, next_responses, set_rows

MOST_IMPULSES = 1 << 16
"""Impulses of a sample that have random numbers of their own."""

_UNIT, _TINY = 2.0**-32, 1e-18


class Shots(NamedTuple):
    """Impulses at random times and what they move, by moments: sums of sizes times Chebyshev polynomials of times."""

    response: Sparse  # responses by moments
    flow: Sparse  # of the responses
    pairs: SlotTable  # (response, 3) rows of both parts of each response, -1 for none, and which envelope it has or -1
    begin: Slots  # (source + 1,) where the moments of each begin
    numbers: Table  # (3, source) expected number in a sample, mean and standard deviation of the sizes
    streams: Streams  # (3, 2 source) addresses of the numbers of impulses, then of their times and sizes
    finer: int  # how many samples of the impulses there are in one that is taken


class Impulsive(NamedTuple):
    """Impulses on some bodies, which go from sample to sample as the loop does."""

    shots: Shots
    realizations: Realizations  # (lane,) indices
    factors: Cube  # (sample, 3, envelope) value at a sample; mean, and growth in half a sample from there on
    first: int  # number of the first of these samples
    place: Slots  # (2,) numbers of the first and of the last of the samples that were last taken
    moments: Block  # (moment, lane)
    moved: Block  # (row, lane) what the impulses of a sample move
    ahead: Block  # (response, lane) responses at the end of a sample
    near: Blocks  # (NEAR + 1, row, lane) samples of series, see `impactlab.integrators.arguments.Series`
    row: int  # first of the rows that are brought here


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
    c0, c1 = np.uint32(np.uint64(number) & LOW), np.uint32(np.uint64(number) >> WORD)
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
                    np.uint32(block & LOW),
                    np.uint32(block >> WORD),
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
def bring_responses(impulsive, first):  # type: ignore[no-untyped-def]
    """Write responses at the samples first, first + 1, … of all lanes to rows of `near`; they begin at 0."""
    near, shots, place = impulsive.near, impulsive.shots, impulsive.place
    moments, moved, ahead = impulsive.moments, impulsive.moved, impulsive.ahead
    own, rows, last, finer = impulsive.row, shots.pairs.shape[0], near.shape[0] - 1, shots.finer
    end = own + rows
    clear_rows(near[0, own:end])
    for sample in range(last):
        set_rows(near[sample, own:end], rows, near[sample + 1, own:end])
        for number in range(finer * (first + sample), finer * (first + sample + 1)):
            fill_moments(shots, impulsive.realizations, number, moments)
            clear_rows(moved)
            add_product(shots.response, moments, moved)
            column = number - impulsive.first
            next_responses(shots, impulsive.factors, column, moved, ahead, near[sample + 1, own:end])
            set_rows(ahead, rows, near[sample + 1, own:end])
    place[0], place[1] = first, first + last


def bring_impulses(place, first):  # type: ignore[no-untyped-def]
    """Bring samples near; `place` is the address of an `Impulsive`."""
    bring_responses(value_at(place), first)
