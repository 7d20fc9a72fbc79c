"""From mean sums to statistics: moments at the right time of the step, and balances."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.flow import transition
from impactlab.kernels.sums import CLOSED, FLUX, FORCE, GG, GV, GX, VV, XV, XX, G, V, X
from impactlab.plan import Plan

Values = dict[str, np.ndarray]


def statistics_of(plan: Plan, bodies: np.ndarray, contacts: np.ndarray) -> Values:
    """Turn mean sums (row, body or contact, unit) into statistics (body or contact, unit)."""
    processed = {
        "mean_displacement": bodies[X],
        "mean_square_displacement": bodies[XX],
        "mean_velocity": bodies[V],
        "mean_square_velocity": bodies[VV],
    }
    balances = {}
    if plan.integrator.kicks:
        processed = _processed(plan, bodies)
        balances = _balances(plan, bodies)
    return {
        **processed,
        "contact_ratio": contacts[CLOSED],
        "contact_rate": contacts[FLUX] / (2.0 * plan.window[:, None]),
        "mean_contact_force": contacts[FORCE],
        **balances,
    }


def _processed(plan: Plan, s: np.ndarray) -> Values:
    """Moments as (kick + 2 middle of the flow)/3: Simpson's rule over the time of a step.

    It removes the error of second order. The moments in the middle of the flow follow
    exactly from those after the kick. Only the flow of white noise of constant intensity is
    closed in this way; other bodies keep the moments at the kick.
    """
    mass, damping, stiffness = plan.linear
    a, q = transition(mass, damping, stiffness, _intensity(plan), 0.5 * plan.step)
    velocity = s[V] + 0.5 * s[G]
    after = s[XX], s[XV] + 0.5 * s[GX], s[VV] + s[GV] + 0.25 * s[GG]
    closed = _closed_flow(plan)[:, None]
    result = {}
    for row, quantity, mean, square in ((0, "displacement", X, XX), (1, "velocity", V, VV)):
        of_x, of_v = a[:, row, 0, None], a[:, row, 1, None]
        middle = of_x * s[X] + of_v * velocity
        middle_square = of_x**2 * after[0] + 2.0 * of_x * of_v * after[1] + of_v**2 * after[2] + q[:, row, row, None]
        result[f"mean_{quantity}"] = np.where(closed, (s[mean] + 2.0 * middle) / 3.0, s[mean])
        result[f"mean_square_{quantity}"] = np.where(closed, (s[square] + 2.0 * middle_square) / 3.0, s[square])
    return result


def _balances(plan: Plan, s: np.ndarray) -> Values:
    """Direct minus balance estimates of the moments at the kick; zero in expectation at any step.

    With A the flow, Σ the linear law, g the velocity increment of a kick, and
    K = [[0, E[g x]], [E[g x], 2 E[g v]]], the moments before the kick are Σ + D with
    D = A (D + K) Aᵀ. Where the linear law does not exist, a part of this remains:
    the velocity of a damped free body, the power of the kicks on an undamped one.
    """
    mass, damping, stiffness = plan.linear
    a, _ = transition(mass, damping, stiffness, np.zeros_like(mass), plan.step)
    intensity = _intensity(plan)
    shape = s[X].shape
    mean, displacement, velocity = (np.full(shape, np.nan) for _ in range(3))
    for body in np.flatnonzero(_closed_flow(plan)):
        flow = a[body]
        c_x, c_v = s[GX, body], s[GV, body]
        before = s[VV, body] - c_v + 0.25 * s[GG, body]  # E[v²] before the kick
        if stiffness[body] > 0.0:
            gain = np.linalg.solve(np.eye(2) - flow, flow)[0, 1]
            mean[body] = s[X, body] - gain * s[G, body]
        if damping[body] == 0.0:
            if intensity[body] == 0.0:
                velocity[body] = c_v
        elif stiffness[body] == 0.0:
            decay = flow[1, 1] ** 2
            linear = np.pi * intensity[body] / (mass[body] * damping[body])
            velocity[body] = before - linear - 2.0 * c_v * decay / (1.0 - decay)
        else:
            lyapunov = np.kron(flow, flow)
            unit = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 2.0]]).T
            d = np.linalg.solve(np.eye(4) - lyapunov, lyapunov @ unit)
            linear = np.pi * intensity[body] / (mass[body] * damping[body])
            velocity[body] = before - linear - d[3, 0] * c_x - d[3, 1] * c_v
            linear *= mass[body] / stiffness[body]
            displacement[body] = s[XX, body] - linear - d[0, 0] * c_x - d[0, 1] * c_v
    return {
        "balance_mean_displacement": mean,
        "balance_mean_square_displacement": displacement,
        "balance_mean_square_velocity": velocity,
    }


def _intensity(plan: Plan) -> np.ndarray:
    """Density of the white noise on every body, (body,)."""
    result = np.zeros(len(plan.bodies))
    result[plan.white] = plan.intensity
    return result


def _closed_flow(plan: Plan) -> np.ndarray:
    """Bodies between whose kicks there is nothing but white noise of constant intensity."""
    result = np.ones(len(plan.bodies), dtype=bool)
    result[[lines.body for lines in plan.lines]] = False
    result[plan.forced] = False
    if plan.time_varying:
        result[plan.white] = False
    return result
