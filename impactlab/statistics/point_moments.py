"""Moments at points of structures, by the formulas of one body; see `impactlab.plan.structure_points`."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from impactlab.kernels.rows import BEGUN, INTENSITY, POINT_TURN, SQUARES, F, V, X
from impactlab.plan.plan import Plan
from impactlab.plan.structure_points import BETWEEN
from impactlab.results.schema import Moments, OfBodies
from impactlab.statistics.chain import mean_load


def with_points(plan: Plan, moments: Moments, sums: np.ndarray, counts: np.ndarray, points: np.ndarray) -> Moments:
    """Add moments at points to the moments of bodies from `impactlab.statistics.moments.moments_of`.

    Sums over points are (phase, row, point, unit).
    """
    own, total, seen = plan.points, counts.sum(axis=0), counts > 0
    x, v = own.shares.gap(moments.bodies.x), own.shares.gap(moments.bodies.v)
    each = points / np.where(seen, counts, 1)[:, None, None]
    over = points.sum(axis=0) / total if plan.transient else each.sum(axis=0) / seen.sum(axis=0)
    at_kick_x, at_kick_v, first, second = over[SQUARES]
    square, load = np.stack([at_kick_x, at_kick_v]), np.zeros_like(x)
    if plan.method.flows is not None and not plan.observed.sampled:
        closed, complete = own.closed[:, None], seen.all(axis=0) | plan.transient
        middle = np.stack([first, second]) + _noise(plan, sums, total)
        simpson = (square + 2.0 * middle) / 3.0
        shifted = np.stack([first, at_kick_v + (second + over[POINT_TURN]) / 6.0])
        square = np.where(closed & complete, simpson, np.where(closed, square, shifted))
        load = np.where(closed & complete, mean_load(x, *_means_at_steps(plan, sums, counts)), 0.0)
    variance, unknown = np.maximum(square[0] + load - x**2, 0.0), np.full_like(x, np.nan)
    return moments._replace(points=OfBodies(unknown, unknown, unknown, x, square[0], variance, v, square[1], load))


def _noise(plan: Plan, sums: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Return the contribution of noise to mean squares in the middle of flows, (2, point, unit) or (2, point, 1).

    Noise that varies in time is taken to vary as the noise on the body that contributes most to the point.
    """
    own = plan.points
    if not plan.transient:
        return np.asarray(own.noise.mean(axis=0)[..., None])
    intensity = np.zeros(len(plan.system.bodies))
    intensity[plan.noise.white] = plan.noise.intensity
    size = np.abs(own.shares.weights) * np.sqrt(intensity[own.shares.slots])
    begins = np.searchsorted(own.shares.rows, np.arange(len(own.shares) + 1)).tolist()
    most = [int(np.argmax(size[begin:end])) + begin for begin, end in pairwise(begins)]
    share = sums[:, INTENSITY, own.shares.slots[most]] / total  # (phase, point, unit)
    return np.asarray((own.noise[..., None] * share[:, None]).sum(axis=0))


def _means_at_steps(plan: Plan, sums: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean displacements of points at kicks and in the middle of the flows after them, (point, unit)."""
    own, seen = plan.points, counts > 0
    if plan.transient:
        total = counts.sum(axis=0)
        at_kicks, states = sums[:, X].sum(axis=0) / total, np.roll(sums[:, BEGUN:], -1, axis=0) / total
    else:
        states = sums / np.where(seen, counts, 1)[:, None, None] / seen.sum(axis=0)
        at_kicks = states[:, X].sum(axis=0)
    middle = sum(own.read(phase, BETWEEN, *state[[X, V, F]]) for phase, state in enumerate(states))
    return own.shares.gap(at_kicks), np.asarray(middle)
