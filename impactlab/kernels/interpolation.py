"""Interpolation between two times."""

from __future__ import annotations

import math

from impactlab.compiling.jit import kernel
from impactlab.compiling.scalars import scalar


@scalar
def cubic(by, next_by, rise):  # type: ignore[no-untyped-def]
    """Return the coefficients of s² and s³ of Hermite's cubic from 0 to `rise`, with these slopes at s = 0 and 1."""
    return 3.0 * rise - 2.0 * by - next_by, by + next_by - 2.0 * rise


@scalar
def turns(by, square, cube):  # type: ignore[no-untyped-def]
    """Return where ``by s + square s² + cube s³`` turns, in order; −1 in the place of one that there is not."""
    inside = square * square - 3.0 * cube * by
    if inside <= 0.0:
        return -1.0, -1.0
    root = -(square + math.copysign(math.sqrt(inside), square))
    one, other = root / (3.0 * cube) if cube != 0.0 else -1.0, by / root
    return min(one, other), max(one, other)


@kernel
def rise(gap, by, bend, twist, low, high):  # type: ignore[no-untyped-def]
    """Where ``gap + by s + bend s² + twist s³`` becomes positive between two places, at the second of which it is."""
    s = 0.5 * (low + high)
    for _ in range(80):
        value = gap + s * (by + s * (bend + s * twist))
        if value > 0.0:
            high = s
        else:
            low = s
        slope = by + s * (2.0 * bend + 3.0 * twist * s)
        after = s - value / slope if slope > 0.0 else low
        if not low < after < high:
            after = 0.5 * (low + high)
        if abs(after - s) <= 1e-16:
            break
        s = after
    return s
