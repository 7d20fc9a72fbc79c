"""When paths first pass limits: between two steps the path is drawn at the middle, given both ends, again and again.

A path under white noise is known at steps only. Given its displacement and velocity at two times it is a Gaussian
process between them, a bridge, of which the middle is drawn by the tables of `impactlab.records.passage_limits`. Halves
in which no limit can be reached, but for `IMPROBABLE`, are not looked at. The shortest parts are cubics for
displacements, and Brownian motion for velocities, of which the probability of a passage is known.

An impact or an impulse within a step changes the velocity at once, at a time that is known. What it adds to the path
from there on, the change times the time since, is known as well, so that the path without it is a bridge between the
ends less this.

Random numbers are addressed by the limit, the realization, the step and the part of the step, so that they depend on
nothing else.
"""

from __future__ import annotations

import math

import numpy as np

from impactlab.compiling.intrinsics import registers
from impactlab.compiling.jit import kernel, scattered, seldom_called
from impactlab.kernels.interpolation import cubic, turns
from impactlab.kernels.random import LOW, WORD, normal_pair, philox

OF_DISPLACEMENT, OF_VELOCITY, AT_STEPS, AT_IMPACT = range(4)
"""What a limit is of: a displacement or a velocity along the path, a force that is read at steps, or a gap up to its
first impact."""

MEAN_X, MEAN_V, ROOT, SPAN_OF_PART, REACH, VARIANCE = 0, 4, 8, 11, 12, 13
"""Columns of a table: weights of x, v before and x, v after in the mean displacement and in the mean velocity of the
middle; the lower triangle of a root of its covariance; the length of the part (s); time for which a velocity may carry
on (s); and the variance by which noise changes a velocity over the part (m2 s-2)."""

COLUMNS = VARIANCE + 1

DEEPEST = 30
"""Halvings at most, so that the number of a part has 32 bits."""

IMPROBABLE = 6.0
"""Standard deviations by which a bridge is not exceeded."""

WIDER = 1.2
"""Largest standard deviation of a velocity within a bridge, at most, over that in the middle: it is 2/√3."""

_BISECTIONS = 45
"""Halvings that find where a cubic passes a limit, to rounding."""

_ROOM = 4 * (DEEPEST + 2)
"""Numbers of the parts that wait: their ends, levels and numbers."""

_UNIT = 2.0**-32


@scattered
def _on_cubic(ends, share):  # type: ignore[no-untyped-def]
    """Return Hermite's cubic, from displacements, and velocities times the length, at a part of the length."""
    x, v, later, later_v = ends
    square, cube = cubic(v, later_v, later - x)
    return x + share * (v + share * (square + share * cube))


@scattered
def first_on_cubic(ends, limit):  # type: ignore[no-untyped-def]
    """Return where a cubic that begins below a limit first reaches it, as a part of its length; -1 if it does not."""
    x, v, later, later_v = ends
    square, cube = cubic(v, later_v, later - x)
    high = 1.0 if later >= limit else -1.0
    for turn in turns(v, square, cube)[::-1]:
        if 0.0 < turn < 1.0 and _on_cubic(ends, turn) >= limit:
            high = turn
    if high < 0.0:
        return high
    low = 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _on_cubic(ends, middle) >= limit:
            high = middle
        else:
            low = middle
    return high


@scattered
def _may_pass(ends, row, limits, kind, scale):  # type: ignore[no-untyped-def]
    """Whether a bridge may reach one of two limits."""
    x, v, later, later_v = ends
    if kind == OF_VELOCITY:
        spread = WIDER * math.sqrt(row[ROOT + 1] * row[ROOT + 1] + row[ROOT + 2] * row[ROOT + 2])
        between = (later - x) / row[REACH] - v - later_v
        most, least = max(v, later_v, between), min(v, later_v, between)
    else:
        spread = row[ROOT]
        one, other = x + row[REACH] * v, later - row[REACH] * later_v
        most, least = max(x, later, one, other), min(x, later, one, other)
    return most + IMPROBABLE * scale * spread >= limits[1] or least - IMPROBABLE * scale * spread <= limits[0]


@scattered
def _in_part(ends, row, lasts, limits, kind, scale, uniform):  # type: ignore[no-untyped-def]
    """Return where a path passes a limit in a part that is not halved any more, as a part of it; -1 if it does not.

    It `lasts` as long as that of the row, or a part of this.
    """
    x, v, later, later_v = ends
    if kind == OF_VELOCITY:
        if later_v >= limits[1]:
            return (limits[1] - v) / (later_v - v)
        if later_v <= limits[0]:
            return (limits[0] - v) / (later_v - v)
        variance = scale * scale * row[VARIANCE] * lasts
        if variance == 0.0:
            return -1.0
        above = math.exp(-2.0 * (limits[1] - v) * (limits[1] - later_v) / variance)
        below = math.exp(-2.0 * (v - limits[0]) * (later_v - limits[0]) / variance)
        return 0.5 if uniform < above + below else -1.0
    length = row[SPAN_OF_PART] * lasts
    up = first_on_cubic((x, length * v, later, length * later_v), limits[1])
    down = first_on_cubic((-x, -length * v, -later, -length * later_v), -limits[0])
    return up if down < 0.0 or 0.0 <= up < down else down


@scattered
def _beyond_bridge(jump, kind, time):  # type: ignore[no-untyped-def]
    """Return what a jump of a velocity adds to a path at a time of the step (s), which it does evenly from then on."""
    if kind == OF_VELOCITY:
        return jump[0] if time > jump[1] else 0.0
    return jump[0] * max(time - jump[1], 0.0)


@scattered
def _within(limits, jump, kind, begin, end):  # type: ignore[no-untyped-def]
    """Return limits of a bridge in a part of a step, beyond which the path may pass its own."""
    one, other = _beyond_bridge(jump, kind, begin), _beyond_bridge(jump, kind, end)
    return limits[0] - min(one, other), limits[1] - max(one, other)


@scattered
def _across_jump(ends, row, limits, kind, scale, uniforms, jump, begin):  # type: ignore[no-untyped-def]
    """Return where a path passes a limit in a part that is not halved any more, with a jump of its velocity within.

    The bridge is Hermite's cubic there, or straight where it is a velocity; each side has a random number of its own.
    """
    x, v, later, later_v = ends
    length, change, when = row[SPAN_OF_PART], jump[0], jump[1]
    share = min(max((when - begin) / length, 0.0), 1.0)
    place = _on_cubic((x, length * v, later, length * later_v), share)
    square, twist = cubic(length * v, length * later_v, later - x)
    speed = (length * v + share * (2.0 * square + 3.0 * share * twist)) / length
    if kind == OF_VELOCITY:
        speed = v + share * (later_v - v)
    found = -1.0
    if share > 0.0:
        found = share * _in_part((x, v, place, speed), row, share, limits, kind, scale, uniforms[0])
    if found < 0.0 and kind == OF_VELOCITY and not limits[0] < speed + change < limits[1]:
        return share
    if found < 0.0 and share < 1.0:
        left = 1.0 - share
        after = place, speed + change, later + change * left * length, later_v + change
        within = _in_part(after, row, left, limits, kind, scale, uniforms[1])
        found = share + left * within if within >= 0.0 else -1.0
    return found


@seldom_called
def _first_in_step(ends, table, limits, kind, scale, address, jump):  # type: ignore[no-untyped-def]
    """Return where a path first passes a limit in a step, as a part of it; -1 if it does not.

    `ends` are those of the bridge, to which a jump of the velocity, at a time of the step (s), adds. `address` has the
    numbers by which random numbers are found: of the step, the realization and the stream.
    """
    x, v, later, later_v = ends
    step, realization, k0, k1, word = address
    low_word, high_word = np.uint32(np.uint64(step) & LOW), np.uint32(np.uint64(step) >> WORD)
    waiting, number, at = registers(_ROOM), 0, 0.0
    waiting[0], waiting[1], waiting[2], waiting[3] = later, later_v, 0.0, 1.0
    deepest = table.shape[0] - 1 if scale > 0.0 else 0
    while number >= 0:
        later, later_v = waiting[4 * number], waiting[4 * number + 1]
        level, part = int(waiting[4 * number + 2]), np.uint64(waiting[4 * number + 3])
        row, both = table[level], (x, v, later, later_v)
        begin = at * table[0, SPAN_OF_PART]
        end = begin + row[SPAN_OF_PART]
        if _may_pass(both, row, _within(limits, jump, kind, begin, end), kind, scale):
            words = philox(np.uint32(part), low_word, realization, np.uint32(np.uint32(word) ^ high_word), k0, k1)
            if level < deepest:
                one, other = normal_pair(words[0], words[1])
                middle = row[0] * x + row[1] * v + row[2] * later + row[3] * later_v + scale * row[ROOT] * one
                speed = row[4] * x + row[5] * v + row[6] * later + row[7] * later_v
                speed += scale * (row[ROOT + 1] * one + row[ROOT + 2] * other)
                waiting[4 * number + 2], waiting[4 * number + 3] = level + 1.0, 2.0 * part + 1.0
                number += 1
                waiting[4 * number], waiting[4 * number + 1] = middle, speed
                waiting[4 * number + 2], waiting[4 * number + 3] = level + 1.0, 2.0 * part
                continue
            uniform, other_uniform = (words[2] + 0.5) * _UNIT, (words[3] + 0.5) * _UNIT
            if jump[0] != 0.0 and begin < jump[1] < end:
                share = _across_jump(both, row, limits, kind, scale, (uniform, other_uniform), jump, begin)
            else:
                if jump[0] != 0.0 and begin >= jump[1]:
                    since = begin - jump[1]
                    both = x + jump[0] * since, v + jump[0], later + jump[0] * (end - jump[1]), later_v + jump[0]
                share = _in_part(both, row, 1.0, limits, kind, scale, uniform)
            if share >= 0.0:
                return at + share * 0.5**level
        x, v = later, later_v
        at += 0.5**level
        number -= 1
    return -1.0


@kernel
def follow_passages(snapshots, first, forms, limits, tables, scales, addresses, jumps, found):  # type: ignore[no-untyped-def]
    """Look for the first passage of each lane in the steps to the next snapshots, the first of which has a number.

    Parameters
    ----------
    forms : tuple
        The weighted sums that have limits: where the entries of each begin, (limit + 1,), their rows of displacements
        and of velocities, their weights, what is subtracted, (limit,), and its kind, (limit,).
    limits : (limit, 2) ndarray
    tables : tuple
        Tables of bridges, (row, column), and where that of each limit begins, (limit + 1,).
    scales : (sample, limit) ndarray
        Root of the density of noise in each step, in that of the tables.
    addresses : tuple
        Streams of random numbers, (3, limit), and numbers of the realizations, (lane,).
    jumps : (2, sample, limit, lane) ndarray
        Changes of velocities at once within each step, and their times in it (s), of some limits or none.
    found : tuple
        Displacement and velocity at the end of the step before, or a force, (2, limit, lane); steps until the first
        passage, (lane,), NaN before; and which limit was passed, (lane,).
    """
    begins, places, paces, weights, offsets, kinds = forms
    table, parts = tables
    streams, realizations = addresses
    before, passed, causes = found
    for sample in range(snapshots.shape[0]):
        for lane in range(snapshots.shape[2]):
            if not math.isnan(passed[lane]):
                continue
            least = 2.0
            for limit in range(limits.shape[0]):
                x, v = -offsets[limit], 0.0
                for entry in range(begins[limit], begins[limit + 1]):
                    x += weights[entry] * snapshots[sample, places[entry], lane]
                    v += weights[entry] * snapshots[sample, paces[entry], lane]
                ends = before[0, limit, lane], before[1, limit, lane], x, v
                before[0, limit, lane], before[1, limit, lane] = x, v
                pair, share = (limits[limit, 0], limits[limit, 1]), -1.0
                if kinds[limit] == AT_STEPS:
                    if x >= pair[1]:
                        share = (pair[1] - ends[0]) / (x - ends[0])
                    elif x <= pair[0]:
                        share = (pair[0] - ends[0]) / (x - ends[0])
                else:
                    own, jump = table[parts[limit] : parts[limit + 1]], (0.0, 0.0)
                    if jumps.shape[1] > 0 and jumps[0, sample, limit, lane] != 0.0:
                        change, when = jumps[0, sample, limit, lane], jumps[1, sample, limit, lane]
                        left = own[0, SPAN_OF_PART] - when
                        ends = ends[0], ends[1], x - change * left, v - change
                        if kinds[limit] != AT_IMPACT:
                            jump = change, when
                    within = _within(pair, jump, kinds[limit], 0.0, own[0, SPAN_OF_PART])
                    if _may_pass(ends, own[0], within, kinds[limit], scales[sample, limit]):
                        address = (
                            first + sample, realizations[lane], streams[0, limit], streams[1, limit], streams[2, limit]
                        )  # fmt: skip
                        share = _first_in_step(ends, own, pair, kinds[limit], scales[sample, limit], address, jump)
                if 0.0 <= share < least:
                    least = share
                    causes[lane] = limit
            if least <= 1.0:
                passed[lane] = first + sample + least
