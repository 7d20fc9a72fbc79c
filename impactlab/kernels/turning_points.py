"""Turning points between samples, cycles counted by rainflow, and products of samples at lags."""

from __future__ import annotations

import math

from impactlab.compiling.jit import kernel
from impactlab.kernels.interpolation import cubic, turns

PER_OCTAVE, LOWEST, BINS = 8, -320, 640
"""Bins of ranges to each factor of two, the number of the lowest one, which begins at 2^-40, and how many there are."""


@kernel
def sum_rows(snapshots, rows, weights, scale, sums):  # type: ignore[no-untyped-def]
    """Write weighted sums of rows of snapshots, ``[sample, row, lane]``, times a scale to ``sums[sample, lane]``."""
    for sample in range(snapshots.shape[0]):
        for lane in range(snapshots.shape[2]):
            sums[sample, lane] = 0.0
        for item in range(len(rows)):
            row, weight = rows[item], scale * weights[item]
            for lane in range(snapshots.shape[2]):
                sums[sample, lane] += weight * snapshots[sample, row, lane]


@kernel
def between_cubics(values, slopes, broken, fine):  # type: ignore[no-untyped-def]
    """Write for each interval what a path does in it, in order of time: ``fine[interval, 3, lane]``.

    The path is Hermite's cubic of the values and of the slopes times the step at both ends, ``[sample, lane]``. The
    first two are its turning points, or the value before where there is none; the third is the value at the end. In an
    interval that is `broken` a velocity jumps: the path has the two tangents of its ends, and turns where they meet.
    """
    for sample in range(fine.shape[0]):
        for lane in range(fine.shape[2]):
            x, end = values[sample, lane], values[sample + 1, lane]
            a, c = slopes[sample, lane], slopes[sample + 1, lane]
            square, cube = cubic(a, c, end - x)
            b = square + a  # the slope is a (1-u)² + 2 b u (1-u) + c u²
            first, second = x, x
            if broken[sample, lane]:
                if a * c < 0.0:
                    u = (end - c - x) / (a - c)
                    if 0.0 < u < 1.0:
                        first = second = x + a * u
            elif not ((a >= 0.0 and b >= 0.0 and c >= 0.0) or (a <= 0.0 and b <= 0.0 and c <= 0.0)):
                low, high = turns(a, square, cube)
                if 0.0 < low < 1.0:
                    first = second = x + low * (a + low * (square + low * cube))
                if 0.0 < high < 1.0:
                    second = x + high * (a + high * (square + high * cube))
                    if not 0.0 < low < 1.0:
                        first = second
            fine[sample, 0, lane], fine[sample, 1, lane], fine[sample, 2, lane] = first, second, end


@kernel
def between_parabolas(values, outwards, fine):  # type: ignore[no-untyped-def]
    """Write for each sample from the third on what comes before it, as `between_cubics` does.

    Where the sample before is higher or lower than both its neighbours, it turns at the top of the parabola through
    the three. Where forces push, at 0 or more, only the sides away from 0 are round: tops are found `outwards`.
    """
    for sample in range(fine.shape[0]):
        for lane in range(fine.shape[2]):
            a, b, c = values[sample, lane], values[sample + 1, lane], values[sample + 2, lane]
            top = b
            if (b - a) * (b - c) > 0.0 and (not outwards or abs(b) > max(abs(a), abs(c))):
                top = b - 0.125 * (c - a) * (c - a) / (a - 2.0 * b + c)
            fine[sample, 0, lane], fine[sample, 1, lane], fine[sample, 2, lane] = top, top, c


@kernel
def widen(series, begin, window, tops):  # type: ignore[no-untyped-def]
    """Widen ``tops[0, window, lane]`` to the largest values of a series, ``[sample, lane]``, and ``tops[1]`` to minus
    the least ones.

    The first sample is the last one of before, and so many went before the second one. A window begins with the end of
    the one before; samples after the last window are left out.
    """
    for sample in range(1, series.shape[0]):
        place = (begin + sample - 1) // window
        if place >= tops.shape[1]:
            return
        first = sample - 1 if (begin + sample - 1) % window == 0 else sample
        for lane in range(series.shape[1]):
            high, low = max(series[first, lane], series[sample, lane]), min(series[first, lane], series[sample, lane])
            tops[0, place, lane] = max(tops[0, place, lane], high)
            tops[1, place, lane] = max(tops[1, place, lane], -low)


@kernel
def count_cycles(series, begin, part, stack, born, heights, damage, counts, exponent):  # type: ignore[no-untyped-def]
    """Count the cycles that a series closes, ``[sample, lane]``, from a sample on; return where the stack was full.

    A cycle is closed by four turning points of which the inner two lie between the outer ones. Others stay on the
    stack, ``[place, lane]``, of which so many `heights` are in use, (lane,), with the parts of the run in which they
    were `born`. A cycle of a range adds the range to the power of an exponent to ``damage[part, lane]``, and 1 to its
    bin of ``counts[part, lane, bin]``.
    """
    for sample in range(begin, series.shape[0]):
        for lane in range(series.shape[1]):
            if heights[lane] == stack.shape[0]:
                return sample
        for lane in range(series.shape[1]):
            value, top = series[sample, lane], heights[lane]
            if top > 0 and value == stack[top - 1, lane]:
                continue
            if top > 1 and (value - stack[top - 1, lane]) * (stack[top - 1, lane] - stack[top - 2, lane]) > 0.0:
                top -= 1  # it goes on in the same direction
            while top > 2:
                inner = abs(stack[top - 1, lane] - stack[top - 2, lane])
                outer = abs(stack[top - 2, lane] - stack[top - 3, lane])
                if inner > abs(value - stack[top - 1, lane]) or inner > outer:
                    break
                damage[born[top - 1, lane], lane] += inner**exponent
                counts[born[top - 1, lane], lane, bin_of(inner)] += 1.0
                top -= 2
            stack[top, lane], born[top, lane] = value, part
            heights[lane] = top + 1
    return series.shape[0]


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
