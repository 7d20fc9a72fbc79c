"""Whether section points repeat, after how many of them, and how far they are from the motion that they approach."""

from __future__ import annotations

import numpy as np

ROUNDED = 1e-13
"""Part of the size of a motion up to which a difference between section points is rounding."""

LEAST = 1e-3
"""Least size of a coordinate in comparisons, as a part of the largest: others may die out or stay at rest."""


def sizes_of(points: np.ndarray) -> np.ndarray:
    """Return the sizes of coordinates in section points, (lane, 1, coordinate), of points (lane, point, 2 coordinate).

    Velocities are in units in which the angle of the force is the time.
    """
    x, v = np.split(points, 2, axis=2)
    size = np.hypot(x, v).max(axis=1, initial=0.0)
    size = np.maximum(size, LEAST * size.max(axis=1, keepdims=True, initial=0.0))
    return np.asarray(np.tile(size, 2)[:, None])


def periods_of(points: np.ndarray, sizes: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the number of points after which the last half of them repeats, 0 where it does not, (lane,)."""
    number = points.shape[1]
    result = np.zeros(len(points), np.int64)
    for period in range(1, number // 2 + 1):
        left = np.flatnonzero(result == 0)
        near = left[_apart(points[left], sizes[left], 0, 1, period) <= tolerance]
        count = max(number // 2, period)
        result[near[_apart(points[near], sizes[near], 0, min(count, number - period), period) <= tolerance]] = period
    return result


def settled(points: np.ndarray, sizes: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the periods of the motions that lanes have come up to within a tolerance, 0 for others, (lane,).

    The distance that is left follows from how much the last differences have decreased.
    """
    result = np.zeros(len(points), np.int64)
    for period in range(1, points.shape[1] // 3 + 1):
        left = np.flatnonzero(result == 0)
        near = left[_apart(points[left], sizes[left], 0, 1, period) <= tolerance]
        if not len(near):
            continue
        last, before = (_apart(points[near], sizes[near], begin, period, period) for begin in (0, period))
        ratio = np.divide(last, before, out=np.ones_like(last), where=before > 0.0)
        done = (last <= ROUNDED) | ((ratio < 1.0) & (last <= tolerance * (1.0 - ratio)))
        result[near[done]] = period
    return result


def _apart(points: np.ndarray, sizes: np.ndarray, begin: int, count: int, period: int) -> np.ndarray:
    """Return the largest difference of some points from those a period before, counted from the last one, (lane,)."""
    end = points.shape[1] - begin
    one, other = points[:, end - count : end], points[:, end - count - period : end - period]
    apart = np.divide(np.abs(one - other), sizes, out=np.zeros(one.shape), where=sizes > 0.0)
    return np.asarray(apart.max(axis=(1, 2), initial=0.0))
