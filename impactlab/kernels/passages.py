"""Where a polynomial over a step passes 0: its sign is shown by bounds, with an allowance for its own error.

A quintic over [0, 1] lies between its coefficients in Bernstein's basis. An interval on which all of these, with the
allowance, are at most 0 has no passage; others are halved, from the first one on, down to a thousandth of a step.
"""

from __future__ import annotations

from impactlab.compiling.intrinsics import registers
from impactlab.compiling.jit import scattered, seldom_called

SEXTIC = 7
"""Coefficients of a polynomial of degree six, by which errors of Hermite's quintic are bounded."""

HALVINGS = 10
"""How often the step is halved before a place is left open."""

INTERVALS = HALVINGS + 2
"""Intervals that may wait at a time."""

ROOM_OF_BOUNDS = SEXTIC * INTERVALS
"""Room for their coefficients."""

SINCE_BEGIN = 0.02
"""Part of a step up to which a top is at its beginning."""

MIDDLE = 3
"""Coefficient that ``20 s³ (1 - s)³`` has alone."""


@scattered
def value_at(curve, share):  # type: ignore[no-untyped-def]
    """Return a quintic at a part of a step."""
    inner = curve[3] + share * (curve[4] + share * curve[5])
    return curve[0] + share * (curve[1] + share * (curve[2] + share * inner))


@scattered
def slope_at(curve, share):  # type: ignore[no-untyped-def]
    """Return the derivative of a quintic there."""
    inner = 3.0 * curve[3] + share * (4.0 * curve[4] + share * 5.0 * curve[5])
    return curve[1] + share * (2.0 * curve[2] + share * inner)


@scattered
def bend_at(curve, share):  # type: ignore[no-untyped-def]
    """Return the second derivative of a quintic there."""
    inner = 6.0 * curve[3] + share * (12.0 * curve[4] + share * 20.0 * curve[5])
    return 2.0 * curve[2] + share * inner


@scattered
def stays_away(curve):  # type: ignore[no-untyped-def]
    """Whether a quintic is below 0 by more than twice all that makes it differ from a straight line."""
    bent = abs(curve[2]) + abs(curve[3]) + abs(curve[4]) + abs(curve[5])
    return max(curve[0], curve[0] + curve[1]) + 2.0 * bent < 0.0


@scattered
def _write_bounds(curve, end, inner, middle, bounds):  # type: ignore[no-untyped-def]
    """Write the coefficients of a quintic with its allowance; return whether one of them is above 0."""
    above = False
    for place in range(SEXTIC):
        total, factor = curve[0], 1.0
        for power in range(1, SEXTIC - 1):
            factor *= (place - power + 1) / (SEXTIC - power)
            total += factor * curve[power]
        if 0 < place < SEXTIC - 1:
            total += inner + (middle if place == MIDDLE else 0.0)
        bounds[place] = end if place == SEXTIC - 1 else total
        above = above or bounds[place] > 0.0
    return above


@scattered
def _halve(bounds, waiting):  # type: ignore[no-untyped-def]
    """Put the coefficients of the first half of the last interval behind those of the second one."""
    first, begin = SEXTIC * waiting, SEXTIC * (waiting + 1)
    bounds[begin] = bounds[first]
    for turn in range(1, SEXTIC):
        for place in range(first, first + SEXTIC - turn):
            bounds[place] = 0.5 * (bounds[place] + bounds[place + 1])
        bounds[begin + turn] = bounds[first]


@scattered
def _root(curve, low, high):  # type: ignore[no-untyped-def]
    """Return where a quintic that passes 0 between two parts of a step is above 0."""
    for _ in range(30):
        share = 0.5 * (low + high)
        if value_at(curve, share) > 0.0:
            high = share
        else:
            low = share
    return high


@scattered
def _top(curve, low, high):  # type: ignore[no-untyped-def]
    """Return where a quintic is largest between two parts of a step."""
    for _ in range(30):
        share = 0.5 * (low + high)
        if slope_at(curve, share) > 0.0:
            low = share
        else:
            high = share
    return 0.5 * (low + high)


@seldom_called
def _look_closer(curve, end, inner, middle, small):  # type: ignore[no-untyped-def]
    """Return the first passage of a quintic that its bounds over the whole step leave open."""
    bounds, begins, widths = registers(ROOM_OF_BOUNDS), registers(INTERVALS), registers(INTERVALS)
    waiting, open_from, high = 0, -1.0, 0.0
    begins[0], widths[0] = 0.0, 1.0
    _write_bounds(curve, end, inner, middle, bounds)
    while waiting >= 0:
        above = False
        for place in range(SEXTIC * waiting, SEXTIC * (waiting + 1)):
            above = above or bounds[place] > 0.0
        low, width = begins[waiting], widths[waiting]
        if not above:
            if open_from >= 0.0:
                at = _top(curve, open_from, low)
                if open_from > 0.0 or (curve[1] > 0.0 and at > SINCE_BEGIN):
                    return at, 0.0
                open_from = -1.0  # it has just been there
            waiting -= 1
        elif width > 0.5**HALVINGS:
            _halve(bounds, waiting)
            widths[waiting] = widths[waiting + 1] = 0.5 * width
            begins[waiting], begins[waiting + 1] = low + 0.5 * width, low
            waiting += 1
        else:
            high = low + width
            if (end if high == 1.0 else value_at(curve, high)) > small:
                return _root(curve, low, high), high
            open_from = open_from if open_from >= 0.0 else low
            waiting -= 1
    if open_from > 0.0 and slope_at(curve, 1.0) < 0.0:
        return _top(curve, open_from, 1.0), 0.0
    return -1.0, 0.0


@scattered
def first_passage(curve, end, inner, middle, small):  # type: ignore[no-untyped-def]
    """Return the part of a step at which a quintic first passes 0 upwards, and by when it has; -1 if it does not.

    Its value at the `end` is known. The quintic is off by less than the polynomial whose inner coefficients are
    `inner`, with `middle` added to that in the middle. Where this leaves open whether it passes 0, the first part is
    that of its top there, and the second is 0.
    """
    if not _write_bounds(curve, end, inner, middle, registers(SEXTIC)):
        return -1.0, 0.0
    return _look_closer(curve, end, inner, middle, small)
