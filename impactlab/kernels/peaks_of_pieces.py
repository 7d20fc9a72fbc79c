"""The largest force of a contact in a piece of motion, from derivatives of the force at a few times."""

from __future__ import annotations

import math

from impactlab.compiling.jit import kernel

UNFORETOLD = 0.1
"""Part of the rate of a force that its next three derivatives may miss after a step."""

SHORTEST = 0.5
"""Least step (rad of the fastest pair or wave)."""

ITERATIONS = 3
"""Of Newton's method on a polynomial: each doubles the number of digits."""


@kernel
def foretold(fastest, motion):  # type: ignore[no-untyped-def]
    """Return for how long derivatives of a force tell its rate, but for a small part."""
    most, shortest = motion.limits[3], SHORTEST / fastest
    if most == 0.0:
        return shortest
    pace = math.sqrt(most / motion.limits[1])  # of what moves it, about (rad s-1)
    size = abs(motion.levels[1]) + abs(motion.levels[2]) / pace
    return max(shortest, math.sqrt(math.sqrt(24.0 * UNFORETOLD * size / most)))


@kernel
def top_between(step, before, bend_before, rate, bend):  # type: ignore[no-untyped-def]
    """Return how long ago a rate was 0 that was positive a step before, and is not any more.

    It is that of the cubic with the same values and derivatives at both ends.
    """
    one, two = step * bend_before, step * bend
    square, cube = 3.0 * (rate - before) - 2.0 * one - two, 2.0 * (before - rate) + one + two
    part = before / (before - rate)
    for _ in range(ITERATIONS):
        value = before + part * (one + part * (square + part * cube))
        slope = one + part * (2.0 * square + 3.0 * part * cube)
        if slope >= 0.0:
            break
        part = min(max(part - value / slope, 0.0), 1.0)
    return step * (1.0 - part)


@kernel
def top_nearby(motion):  # type: ignore[no-untyped-def]
    """Return the largest force near a time, of Taylor's polynomial."""
    force, rate, bend = motion.levels[0], motion.levels[1], motion.levels[2]
    third, fourth = motion.levels[3], motion.levels[4]
    time = 0.0
    for _ in range(ITERATIONS):
        slope = bend + time * (third + 0.5 * time * fourth)
        if slope >= 0.0:
            break
        time -= (rate + time * (bend + 0.5 * time * (third + time * fourth / 3.0))) / slope
    return force + time * (rate + 0.5 * time * (bend + time / 3.0 * (third + 0.25 * time * fourth)))
