"""Attractors of a network in a section: periodic motions with neighbourhoods that lead to them, and others by cells."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

Around = Callable[[np.ndarray, int], np.ndarray]
"""Returns the points, (start, point, 2 coordinate), that follow states of the section, (start, 2 coordinate)."""

SAME_ORBIT = 1e-4
"""Distance between points of periodic motions, as a part of their sizes, up to which they are one motion; it is larger
than the distance from it at which a motion is taken for periodic.
"""

SHELLS = 2.0 ** -np.arange(0.0, 16.0, 0.5)
"""Radii of the shells around a periodic motion that are tried, as parts of its sizes; the last one is small enough for
motions that are stable at all.
"""

SHRINKS = 0.999
"""Factor below which a shell must come to lie inside itself after a period, on the scale of its radius."""

DIRECTIONS = 128
"""Starts on each shell, and as many for each coordinate more than one."""

CELLS = 64
"""Cells along the size of a motion that is not periodic."""

VISITS = 60
"""Points in a row within the cells of such a motion, after which a start counts as one that leads there."""


class Trap(NamedTuple):
    """Neighbourhoods of the points of a periodic motion: ``(y − c)ᵀ P (y − c) ≤ 1``, each mapped into the next."""

    centers: np.ndarray  # (point, 2 coordinate)
    forms: np.ndarray  # (point, 2 coordinate, 2 coordinate) P

    def holds(self, states: np.ndarray) -> np.ndarray:
        """Return whether states, (…, 2 coordinate), are in a neighbourhood."""
        result = np.zeros(states.shape[:-1], dtype=bool)
        for center, form in zip(self.centers, self.forms, strict=True):
            apart = (states - center).reshape(-1, len(center))  # by rows, a fifth of the time of einsum for three
            result |= (np.einsum("ni,ni->n", apart @ form, apart) <= 1.0).reshape(result.shape)
        return result


def are_stable(matrices: np.ndarray) -> bool:
    """Whether small differences die out."""
    return bool(np.abs(np.linalg.eigvals(matrices)).max() < 1.0)


def trap_of(points: np.ndarray, sizes: np.ndarray, matrices: np.ndarray, around: Around) -> Trap | None:
    """Return neighbourhoods of the points of a periodic motion that lead to it, None where none is found.

    They are ellipsoids of the discrete Lyapunov equation of its monodromy matrices, those of a motion that is stable.
    Starts on shells around each point must come inside of the shell within a period of the motion.

    Parameters
    ----------
    points : (point, 2 coordinate) ndarray
        The motion.
    sizes : (2 coordinate,) ndarray
        Sizes of displacements and velocities.
    matrices : (point, 2 coordinate, 2 coordinate) ndarray
        See `impactlab.analysis.laps.Laps.monodromies`.
    around : callable
    """
    period, count = points.shape
    draws = np.random.default_rng(0).normal(size=(DIRECTIONS * (count - 1), count))
    unit = draws / np.linalg.norm(draws, axis=1, keepdims=True)
    if count == 2:
        angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    forms = list[np.ndarray]()
    for center, matrix in zip(points, matrices, strict=True):
        form = _lyapunov(matrix)
        root = np.linalg.cholesky(form)  # P = L Lᵀ
        shell = np.linalg.solve(root.T, unit.T).T * sizes  # of P-norm 1
        starts = center + SHELLS[:, None, None] * shell
        ends = around(starts.reshape(-1, count), period)[:, -1].reshape(starts.shape)
        apart = (ends - center) / sizes @ root
        ratio = np.nan_to_num(np.linalg.norm(apart, axis=2)).max(axis=1) / SHELLS  # hard bodies keep some starts out
        fails = np.flatnonzero(~(ratio < SHRINKS))
        first = 0 if not len(fails) else int(fails[-1]) + 1
        if first == len(SHELLS):
            return None
        forms.append(form / np.outer(sizes, sizes) / SHELLS[first] ** 2)
    return Trap(points, np.array(forms))


def _lyapunov(matrix: np.ndarray) -> np.ndarray:
    """Return ``Σ (Mᵀ)ᵏ Mᵏ`` scaled to the smallest eigenvalue 1."""
    total, power = np.eye(len(matrix)), matrix
    for _ in range(60):  # squares of powers
        total, power = total + power.T @ total @ power, power @ power
        if not np.abs(power).max() > 1e-20:
            break
    return np.asarray(total / np.linalg.eigvalsh(total)[0])


class Cells(NamedTuple):
    """Cells of the section that a motion which is not periodic visits, in a plane of it."""

    axes: np.ndarray  # (2,) coordinates
    width: np.ndarray  # (2,)
    visited: np.ndarray  # (cell,) numbers, in order

    @classmethod
    def of(cls, points: np.ndarray, axes: np.ndarray, sizes: np.ndarray) -> Cells:
        """Return the cells of points, (point, 2 coordinate), of a motion of these sizes, (2 coordinate,)."""
        width = np.maximum(np.ptp(points[:, axes], axis=0), SAME_ORBIT * sizes[axes]) / CELLS
        return cls(axes, width, np.unique(_numbers(points, axes, width)))

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Return whether points, (…, 2 coordinate), are in these cells."""
        numbers = _numbers(points, self.axes, self.width)
        places = np.searchsorted(self.visited, numbers).clip(max=len(self.visited) - 1)
        return np.asarray(self.visited[places] == numbers)


def _numbers(points: np.ndarray, axes: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return the number of the cell of each point."""
    one, other = np.moveaxis(np.floor(points[..., axes] / width).clip(-(2.0**30), 2.0**30).astype(np.int64), -1, 0)
    return np.asarray((one << 32) + other)
