"""Whether section points repeat, after how many of them, and how far they are from the motion that they approach."""

from __future__ import annotations

import numpy as np

UNSETTLED = 4.0
"""Distances from the motion that is approached, up to which points may be one: from one side of it to the other, twice.
"""

LEAST_SIZE = 1e-3
"""Least size of a coordinate in comparisons, as a part of the largest: others may die out or stay at rest."""

REST = 1e-4
"""Least size of a motion in comparisons, as a part of the state in which it began: it may die out, and be a rest."""


def sizes_of(points: np.ndarray, begins: np.ndarray | None = None) -> np.ndarray:
    """Return the sizes of coordinates in section points, (lane, 1, coordinate), of points (lane, point, 2 coordinate).

    Velocities are in units in which the angle of the force is the time. Motions that began in states `begins`, (lane,
    2 coordinate), have a least size.
    """
    x, v = np.split(points, 2, axis=2)
    size = np.hypot(x, v).max(axis=1, initial=0.0)
    if begins is not None:
        size = np.maximum(size, REST * np.hypot(*np.split(begins, 2, axis=1)).max(axis=1, keepdims=True, initial=0.0))
    size = np.maximum(size, LEAST_SIZE * size.max(axis=1, keepdims=True, initial=0.0))
    return np.asarray(np.tile(size, 2)[:, None])


def periods_of(points: np.ndarray, sizes: np.ndarray, tolerance: float, noise: float, window: int) -> np.ndarray:
    """Return the numbers of points after which motions repeat within a tolerance, 0 where they do not, (lane,).

    Differences of the points of a window from those a period before are compared with these differences in the window
    before, which tells the distance from the motion that is approached, unless they are `noise`.
    """
    result, number = np.zeros(len(points), np.int64), points.shape[1]
    left = np.arange(len(points))
    for period in range(1, number // 3 + 1):
        width = max(period, min(window, (number - period) // 2))
        near = left[_apart(points[left], sizes[left], 0, 1, period) <= tolerance]
        if not len(near):
            continue
        last, before = (_apart(points[near], sizes[near], begin, width, period) for begin in (0, width))
        ratio = np.divide(last, before, out=np.ones_like(last), where=before > 0.0) ** (period / width)
        distance = np.divide(last, 1.0 - ratio, out=np.full_like(last, np.inf), where=ratio < 1.0)
        distance = np.where(last <= noise, np.minimum(distance, noise), distance)
        done = distance <= tolerance
        result[near[done]] = _shortest(points[near[done]], sizes[near[done]], distance[done], period)
        left = np.setdiff1d(left, near[last <= tolerance])  # others may still come up to a motion of this period
    return result


def _shortest(points: np.ndarray, sizes: np.ndarray, distance: np.ndarray, period: int) -> np.ndarray:
    """Return the shortest periods whose differences are as small as a distance that is left, (lane,)."""
    result = np.full(len(points), period)
    for part in range(period // 2, 0, -1):
        if period % part == 0:
            result[_apart(points, sizes, 0, period, part) <= UNSETTLED * distance] = part
    return result


def _apart(points: np.ndarray, sizes: np.ndarray, begin: int, count: int, period: int) -> np.ndarray:
    """Return the largest difference of some points from those a period before, counted from the last one, (lane,)."""
    end = points.shape[1] - begin
    one, other = points[:, end - count : end], points[:, end - count - period : end - period]
    apart = np.divide(np.abs(one - other), sizes, out=np.zeros(one.shape), where=sizes > 0.0)
    return np.asarray(apart.max(axis=(1, 2), initial=0.0))
