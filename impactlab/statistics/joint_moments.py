"""Moments and balances of bodies whose linear motion is joint: the formulas of one body, with matrices."""

from __future__ import annotations

import numpy as np

from impactlab.integrators.arguments import Group
from impactlab.kernels.rows import FF, FV, FX, KICK_ROWS, PAIR_ROWS, VV, XV, XX, F, V, X
from impactlab.statistics.chain import mean_load, weighted_sum

_OWN = np.array([[XX, XV, FX], [XV, VV, FV], [FX, FV, FF]])


def joint_moments(
    group: Group, step: float, s: np.ndarray, products: np.ndarray, begun: np.ndarray | None = None
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], dict[str, np.ndarray]]:
    """Return the moments over the time of a step of the bodies of a group, and their balances.

    Mean squares are (kick + 2 middle of the flow)/3, Simpson's rule; those in the middle follow from all second moments
    after a kick. Without the displacements that no spring holds the state is z = R (x, v). Its mean under a force F
    solves ``L z + R (0, F/m) = 0`` over time, and is ``(I − A)⁻¹ A R (0, g)`` at the kicks, g the velocity increment of
    a kick. With K of all E[g x] and E[g v], the moments before a kick are those of the linear law plus D,
    ``D = A (D + K) Aᵀ``; an element of D is a sum over K, whose weights solve the adjoint equation. A group has the
    same A in all phases. Means and balances are for groups of which all motions are damped, balances of displacements
    for bodies that springs hold.

    Given are means s of the rows of sums of its bodies, (9, body, unit), and of the sums over its pairs,
    (9, pair, unit), in the order of `numpy.triu_indices`. In a transient also the means over the kicks with which flows
    begin; the same of pairs follow in `products`. Returned are means and mean squares of x and v, (2, body, unit), and
    the load, (body, unit), as of `impactlab.statistics.moments.Motion`; and balances by the statistic, (body, unit),
    empty where there are none.
    """
    count, units = s.shape[1:]
    system, increment = group.system, step / group.system.mass[:, None]
    after, kicks = _second_moments(increment, s, products[:PAIR_ROWS])
    if begun is not None:
        after, _ = _second_moments(increment, begun[:KICK_ROWS], products[PAIR_ROWS:])
    middle = np.array([np.outer(row, row).ravel() for row in group.middle_transition])
    at_middle = weighted_sum(middle.T, after) + np.diag(group.middle_covariance)[:, None]
    square = (np.concatenate([s[XX], s[VV]]) + 2.0 * at_middle) / 3.0
    earlier = s if begun is None else begun
    z = np.concatenate([earlier[X], earlier[V] + 0.5 * increment * earlier[F]])
    at_middle = weighted_sum(group.middle_transition[:count].T, z[:, None])
    mean, load = s[[X, V]], np.zeros((count, units))
    balances: dict[str, np.ndarray] = {}
    known = system.covariance is not None and bool(system.rates.all())
    if known:
        over_time, balances = _by_law(group, increment, s, kicks)
    if begun is not None:
        simpson = (s[X] + 2.0 * at_middle) / 3.0
        way = 2.0 / step * (s[X] - begun[X])  # half of the states at both ends are in the others
        mean, load = np.stack([simpson, way]), mean_load(simpson, s[X], at_middle)
    elif known:
        free = system.free[:, None]
        mean = np.stack([np.where(free, s[X], over_time[:count]), over_time[count:]])
        load = np.where(free, 0.0, mean_load(over_time[:count], s[X], at_middle))
    return (mean, square.reshape(2, count, units), load), balances


def _by_law(
    group: Group, increment: np.ndarray, s: np.ndarray, kicks: np.ndarray
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the means of (x, v) over time, (2 bodies, unit), and the balances of a group that has a linear law."""
    from scipy.linalg import solve_discrete_lyapunov  # loaded only where there are couplings

    count, system = len(group.slots), group.system
    reduction = system.reduction
    flow, by_force = reduction @ group.transition @ reduction.T, reduction[:, count:]
    over_time = -reduction.T @ np.linalg.solve(system.drift, by_force / system.mass)
    at_kicks = reduction.T @ np.linalg.solve(np.eye(len(flow)) - flow, flow @ by_force) * increment[:, 0]
    at_kicks[count:] += 0.5 * np.diag(increment[:, 0])  # the velocity is read in the middle of the kick
    weights = []
    assert system.covariance is not None
    # displacements and velocities in units of their size, in powers of 2: else equations of stiff or soft systems are
    # ill-conditioned
    square = np.diag(reduction @ system.covariance @ reduction.T)
    size = np.exp2(np.round(0.5 * np.log2(np.where(square > 0.0, square, 1.0))))
    scaled, back = flow / size[:, None] * size, reduction / size[:, None]
    for unit in (flow.T @ reduction).T * size:
        weights.append((back.T @ solve_discrete_lyapunov(scaled.T, np.outer(unit, unit)) @ back).ravel())
    before = np.concatenate([s[XX], s[VV] - increment * s[FV] + 0.25 * increment**2 * s[FF]])
    off = before - np.diag(system.covariance)[:, None] - weighted_sum(np.array(weights).T, kicks)
    mean = np.concatenate([s[X], s[V]]) + weighted_sum((over_time - at_kicks).T, s[F, :, None])
    offset = s[X] - weighted_sum(at_kicks[:count].T, s[F, :, None])
    free = system.free[:, None]
    balances = {
        "mean_displacement": np.where(free, np.nan, offset),
        "mean_square_displacement": np.where(free, np.nan, off[:count]),
        "mean_square_velocity": off[count:],
    }
    return mean, balances


def _second_moments(increment: np.ndarray, s: np.ndarray, products: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return E[z zᵀ] of z = (x, v) after a kick, and the contribution K of the kick, (elements, 1, unit) each."""
    count, units = s.shape[1:]
    w = np.empty((3, count, 3, count, units))  # E[a b] of displacements, velocities and forces a, b
    index = np.arange(count)
    w[:, index, :, index] = np.moveaxis(s[_OWN], 2, 0)
    first, second = np.triu_indices(count, 1)
    of_pairs = np.moveaxis(products.reshape(3, 3, -1, units), 2, 0)
    w[:, first, :, second], w[:, second, :, first] = of_pairs, of_pairs.swapaxes(1, 2)
    w[2] *= increment[:, None, None]  # forces become steps of the velocity
    w[:, :, 2] *= increment
    after, kicks = w[:2, :, :2].copy(), np.zeros_like(w[:2, :, :2])
    after[1] += 0.5 * w[2, :, :2]
    after[:, :, 1] += 0.5 * w[:2, :, 2]
    after[1, :, 1] += 0.25 * w[2, :, 2]
    kicks[0, :, 1], kicks[1, :, 0], kicks[1, :, 1] = w[0, :, 2], w[2, :, 0], w[1, :, 2] + w[2, :, 1]
    return after.reshape(-1, 1, units), kicks.reshape(-1, 1, units)
