"""Balances: differences of two estimates of one moment, 0 in expectation at any step."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.rows import FF, FV, FX, VV, XV, XX, F, X
from impactlab.statistics.chain import Chain, Rows, cycle, rows_where, weighted_sum


def balances_of(
    chain: Chain, intensity: np.ndarray, s: np.ndarray, closed: np.ndarray, of_kicks: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Direct minus balance estimates of the moments at the kick.

    With A the flow of a step, Σ the linear law, g the velocity increment of a kick, and
    K = [[0, E[g x]], [E[g x], 2 E[g v]]], the moments before a kick are Σ + D, and those before the next one Σ + A
    (D + K) Aᵀ: linear equations for the D of all phases of the method's cycle. Where the linear law does not exist, a
    part of this remains: the velocity of a damped free body, the power of the kicks on an undamped one.

    `intensity` is of the white noise that the flows are made with, (body,), s are means of the rows of sums,
    (phase, row, body, unit), `closed` are the bodies that nothing but kicks and steady white noise moves, (body,) of
    bool, and `of_kicks` is the second of `Chain.response`. The balances are (body, unit), by the statistic, NaN where
    there are none; the last ones are of E[x v].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        heat = (np.pi * intensity / (chain.mass * chain.damping))[:, None]
    own, held, damped = closed & chain.alone, chain.stiffness > 0.0, chain.damping > 0.0
    mean, displacement, mixed, velocity = (np.full(s.shape[2:], np.nan) for _ in range(4))
    bodies = rows_where(own & held)
    mean[bodies] = s[:, X, bodies].mean(axis=0) - weighted_sum(of_kicks[bodies, 0].T, s[:, F, bodies])
    bodies = rows_where(own & ~damped & (intensity == 0.0))
    velocity[bodies] = (chain.increment[bodies] * s[:, FV, bodies]).mean(axis=0)
    if (free := own & damped & ~held).any():
        bodies = rows_where(free)
        velocity[bodies] = _of_free_bodies(chain, s, bodies, heat)
    if (on_springs := own & damped & held).any():
        bodies = rows_where(on_springs)
        displacement[bodies], mixed[bodies], velocity[bodies] = _of_held_bodies(chain, s, bodies, heat)
    balances = {
        "mean_displacement": mean,
        "mean_square_displacement": displacement,
        "mean_square_velocity": velocity,
    }
    return balances, mixed


def _before_kicks(increment: np.ndarray, s: np.ndarray, bodies: Rows) -> np.ndarray:
    """Return E[v²] of some bodies before the kicks, with their increments, (phase, body, unit)."""
    return np.asarray(s[:, VV, bodies] - increment * s[:, FV, bodies] + 0.25 * increment**2 * s[:, FF, bodies])


def _of_free_bodies(chain: Chain, s: np.ndarray, bodies: Rows, heat: np.ndarray) -> np.ndarray:
    """Return the balance of E[v²] of damped bodies without a spring."""
    first, which = chain.alike(bodies)
    a, increment = chain.flows.transition[:, bodies, 1:, 1:][:, first], chain.increment[bodies]
    gain = cycle(a**2, np.full((len(first), 1, 1), 2.0))[which, 0]
    power = weighted_sum(gain.T, increment * s[:, FV, bodies])
    return np.asarray(_before_kicks(increment, s, bodies).mean(axis=0) - heat[bodies] - power)


def _of_held_bodies(
    chain: Chain, s: np.ndarray, bodies: Rows, heat: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the balances of E[x²], E[x v] and E[v²] of damped bodies with a spring."""
    first, which = chain.alike(bodies)
    a, increment = chain.flows.transition[:, bodies][:, first], chain.increment[bodies]
    squares = (a[..., :, None, :, None] * a[..., None, :, None, :]).reshape(*a.shape[:2], 4, 4)  # A ⊗ A
    kicks = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 2.0]]).T  # K, flattened, of virial and power
    inputs = np.broadcast_to(kicks, (a.shape[1], 4, 2))
    gain = cycle(squares, inputs).reshape(-1, 4, len(a), 2)[which]
    virial, power = increment * s[:, FX, bodies], increment * s[:, FV, bodies]
    of_xx, of_xv, of_vv = (
        weighted_sum(gain[:, row, :, 0].T, virial) + weighted_sum(gain[:, row, :, 1].T, power) for row in (0, 1, 3)
    )
    potential = heat[bodies] * chain.mass[bodies, None] / chain.stiffness[bodies, None]
    return (
        s[:, XX, bodies].mean(axis=0) - potential - of_xx,
        (s[:, XV, bodies] - 0.5 * virial).mean(axis=0) - of_xv,
        _before_kicks(increment, s, bodies).mean(axis=0) - heat[bodies] - of_vv,
    )
