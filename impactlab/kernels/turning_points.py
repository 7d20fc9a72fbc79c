"""Turning points of paths of linear forms, cycles counted by rainflow, and products of samples at lags."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impactlab.compiling.jit import kernel
from impactlab.compiling.scalars import scalar
from impactlab.kernels.interpolation import cubic, turns

CUBIC, PARABOLIC, BROWNIAN = range(3)
"""Kinds of paths, see `PathOfForm`."""

PER_OCTAVE, LOWEST, BINS = 8, -320, 640
"""Bins of ranges to each factor of two, the number of the lowest one, which begins at 2^-40, and how many there are."""


@kernel
def write_sum(snapshots, sample, rows, weights, scale, total):  # type: ignore[no-untyped-def]
    """Write the weighted sum of some rows of a snapshot, if there are any, times a scale to ``total[lane]``."""
    for item in range(len(rows)):
        row, weight = rows[item], scale * weights[item]
        if item == 0:
            for lane in range(len(total)):
                total[lane] = weight * snapshots[sample, row, lane]
        else:
            for lane in range(len(total)):
                total[lane] += weight * snapshots[sample, row, lane]


@kernel
def sum_rows(snapshots, begins, rows, weights, sums):  # type: ignore[no-untyped-def]
    """Write weighted sums of rows of snapshots, ``[sample, row, lane]``, to ``sums[place, sample, lane]``.

    The entries of each place, which has one at least, begin at `begins`.
    """
    for place in range(sums.shape[0]):
        own = slice(begins[place], begins[place + 1])
        for sample in range(snapshots.shape[0]):
            write_sum(snapshots, sample, rows[own], weights[own], 1.0, sums[place, sample])


class PathOfForm(NamedTuple):
    """A linear form in snapshots, and what its path does between them.

    A smooth path is Hermite's cubic of its values and slopes, a round one turns at the top of a parabola, a rough one
    at a sample.
    """

    rows: np.ndarray
    weights: np.ndarray
    paces: np.ndarray  # rows of its velocity, where it is smooth
    hits: np.ndarray  # rows which are not 0 where a velocity jumps
    step: float  # (s)
    kind: int
    outwards: bool  # whether only the sides away from 0 are round, as of forces that push


@kernel
def read_path(snapshots, sample, path, now):  # type: ignore[no-untyped-def]
    """Write the value of a path, its slope times the step and whether a velocity jumps to ``now[3, lane]``."""
    write_sum(snapshots, sample, path.rows, path.weights, 1.0, now[0])
    write_sum(snapshots, sample, path.paces, path.weights, path.step, now[1])
    for lane in range(now.shape[1] if len(path.hits) else 0):
        now[2, lane] = 0.0
    for place in range(len(path.hits)):
        for lane in range(now.shape[1]):
            now[2, lane] += abs(snapshots[sample, path.hits[place], lane])


@kernel
def begin_path(snapshots, path, past):  # type: ignore[no-untyped-def]
    """Begin a path with the first of some snapshots; see `find_turns`."""
    read_path(snapshots, 0, path, past)
    for lane in range(past.shape[1]):
        if path.kind != CUBIC:
            past[1, lane] = past[0, lane]
        past[2, lane] = 0.0


@kernel
def choose_lanes(past, now, kind, turning, chosen):  # type: ignore[no-untyped-def]
    """Write the lanes whose path may turn since the last sample to `chosen`; return how many there are."""
    if kind == CUBIC:
        for lane in range(len(turning)):
            a, c, way = past[1, lane], now[1, lane], past[2, lane]
            b = 3.0 * (now[0, lane] - past[0, lane]) - a - c  # the slope is a (1-u)² + 2 b u (1-u) + c u²
            on = min(min(way * a, way * b), way * c) >= 0.0
            turning[lane] = 0 if on and way != 0.0 and now[2, lane] == 0.0 else 1
    else:
        for lane in range(len(turning)):
            rise = now[0, lane] - past[0, lane]
            turning[lane] = 0 if rise * past[2, lane] > 0.0 or rise == 0.0 else 1
    count = 0
    for lane in range(len(turning)):
        chosen[count] = lane
        count += turning[lane]
    return count


@scalar
def turns_between(kind, outwards, value, slope, end, next_slope, broken):  # type: ignore[no-untyped-def]
    """Return where a path turns between two samples, in order of time, or the value before where it does not.

    In an interval that is `broken` it has the two tangents of its ends, and turns where they meet. In the place of the
    slope a round path has the value of the sample before: it turns if that in the middle is higher or lower than both.
    """
    first, second = value, value
    if (
        kind == PARABOLIC
        and (value - slope) * (value - end) > 0.0
        and (not outwards or abs(value) > max(abs(slope), abs(end)))
    ):
        first = second = value - 0.125 * (end - slope) * (end - slope) / (slope - 2.0 * value + end)
    if kind == CUBIC and broken:
        if slope * next_slope < 0.0:
            u = (end - next_slope - value) / (slope - next_slope)
            if 0.0 < u < 1.0:
                first = second = value + slope * u
    elif kind == CUBIC:
        square, cube = cubic(slope, next_slope, end - value)
        low, high = turns(slope, square, cube)
        if 0.0 < low < 1.0:
            first = second = value + low * (slope + low * (square + low * cube))
        if 0.0 < high < 1.0:
            second = value + high * (slope + high * (square + high * cube))
            if not 0.0 < low < 1.0:
                first = second
    return first, second


@kernel
def find_turns(snapshots, begin, seen, every, path, past, work, places, values):  # type: ignore[no-untyped-def]
    """Find the points at which a path turns, from a sample on; return the next sample, and how many there are.

    ``places[2, point]`` gets the lane of each, and its time in half steps: even at a sample, odd between two. The start
    is a point, and all lanes have one after every so many samples, and after the last one. It ends early where there
    might be no room.

    Parameters
    ----------
    snapshots : [sample, row, lane]
    begin, seen, every : int
        First sample to look at; how many were `seen` before the snapshots; samples between points of all lanes.
    path : PathOfForm
    past : [3, lane]
        Of the sample before: value, slope times the step (of a round path, the value a sample earlier), and 1 or -1
        where it rises or falls, 0 at the start.
    work : tuple
        ``now[3, lane]``, and two rows of whole numbers, (lane,).
    """
    now, turning, chosen = work
    lanes, number = len(turning), 0
    for sample in range(begin, snapshots.shape[0]):
        if number + 4 * lanes > len(values):
            return sample, number
        read_path(snapshots, sample, path, now)
        time = 2 * (seen + sample + 1)
        for item in range(choose_lanes(past, now, path.kind, turning, chosen)):
            lane = chosen[item]
            value, end, way = past[0, lane], now[0, lane], past[2, lane]
            first, second = turns_between(
                path.kind, path.outwards, value, past[1, lane], end, now[1, lane], now[2, lane] != 0.0
            )
            place = time - 2
            for target in (first, second, end):
                if target != value:
                    if way * (target - value) <= 0.0:
                        places[0, number], places[1, number], values[number] = lane, place, value
                        number += 1
                    way, value, place = math.copysign(1.0, target - value), target, time - 1
            past[2, lane] = way
        for lane in range(lanes):
            past[1, lane] = now[1, lane] if path.kind == CUBIC else past[0, lane]
            past[0, lane] = now[0, lane]
        if (seen + sample + 1) % every == 0 or sample + 1 == snapshots.shape[0]:
            for lane in range(lanes):
                places[0, number], places[1, number], values[number] = lane, time, now[0, lane]
                number += 1
    return snapshots.shape[0], number


@kernel
def widen(places, values, number, window, tops):  # type: ignore[no-untyped-def]
    """Widen ``tops[0, window, lane]`` to the largest values of so many points, and ``tops[1]`` to minus the least ones.

    The points are those of `find_turns`, windows so many samples long. A point between two windows is in both; those
    after the last window are left out.
    """
    for point in range(number):
        lane, time, value = places[0, point], places[1, point], values[point]
        for place in range(max((time - 1) // (2 * window), 0), min(time // (2 * window) + 1, tops.shape[1])):
            tops[0, place, lane] = max(tops[0, place, lane], value)
            tops[1, place, lane] = max(tops[1, place, lane], -value)


@kernel
def count_cycles(places, values, points, part, stack, born, heights, damage, counts, exponent):  # type: ignore[no-untyped-def]
    """Count the cycles that points of `find_turns` close, from one up to another; return where a stack was full.

    A cycle is closed by four turning points of which the inner two lie between the outer ones. Others stay on the
    stack, ``[lane, place]``, of which so many `heights` are in use, (lane,), with the parts of the run in which they
    were `born`. A cycle of a range adds the range to the power of an exponent to ``damage[part, lane]``, and 1 to its
    bin of ``counts[part, lane, bin]``.
    """
    begin, end = points
    for point in range(begin, end):
        lane, value = places[0, point], values[point]
        top = heights[lane]
        if top == stack.shape[1]:
            return point
        if top > 0 and value == stack[lane, top - 1]:
            continue
        if top > 1 and (value - stack[lane, top - 1]) * (stack[lane, top - 1] - stack[lane, top - 2]) > 0.0:
            top -= 1  # it goes on in the same direction
        while top > 2:
            inner = abs(stack[lane, top - 1] - stack[lane, top - 2])
            outer = abs(stack[lane, top - 2] - stack[lane, top - 3])
            if inner > abs(value - stack[lane, top - 1]) or inner > outer:
                break
            damage[born[lane, top - 1], lane] += inner**exponent
            counts[born[lane, top - 1], lane, bin_of(inner)] += 1.0
            top -= 2
        stack[lane, top], born[lane, top] = value, part
        heights[lane] = top + 1
    return end


@kernel
def bin_of(size):  # type: ignore[no-untyped-def]
    """Return the bin of a range; the first and the last hold all that are smaller and larger."""
    if not size > 0.0:
        return 0
    return min(max(math.floor(PER_OCTAVE * math.log2(size)) - LOWEST, 0), BINS - 1)


@kernel
def add_products(series, seen, ring, places, begin, per_phase, sums, befores, afters, samples):  # type: ignore[no-untyped-def]
    """Add products of samples, ``[form, sample, lane]``, and of those some places earlier, (lag,).

    So many samples were `seen` before; the last of them are in a ring, ``[place, form, lane]``. The earlier one of a
    pair has to be at a phase, a whole number of times `per_phase` samples, begun so many earlier. ``sums[phase, lag,
    first form, second form, lane]`` gets its value of the first times the later value of the second, `befores` and
    `afters`, ``[phase, lag, form, lane]``, the earlier and the later values, and ``samples[phase, lag]`` 1.
    """
    size, forms, lanes = ring.shape
    for sample in range(series.shape[1]):
        last = seen + sample + 1
        now = last % size
        for one in range(forms):
            for lane in range(lanes):
                ring[now, one, lane] = series[one, sample, lane]
        for lag in range(len(places)):
            first = last - places[lag]
            if first < 1 or (begin + first) % per_phase != 0:
                continue
            phase, place = (begin + first) // per_phase % sums.shape[0], first % size
            samples[phase, lag] += 1.0
            for one in range(forms):
                for lane in range(lanes):
                    befores[phase, lag, one, lane] += ring[place, one, lane]
                    afters[phase, lag, one, lane] += ring[now, one, lane]
                for other in range(forms):
                    for lane in range(lanes):
                        sums[phase, lag, one, other, lane] += ring[place, one, lane] * ring[now, other, lane]
