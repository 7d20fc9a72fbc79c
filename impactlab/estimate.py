"""From sums to statistics and their standard errors.

A *unit* is what counts as independent: a realization or, where there are few of them, a
batch of one. Every statistic is a mean over units or a smooth function of such means,
and its standard error comes from the scatter of the units.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from impactlab.errors import AccuracyWarning
from impactlab.kernels.flow import transition
from impactlab.kernels.sums import CLOSED, FLUX, FORCE, GG, GV, GX, PEAK, VV, XV, XX, G, V, X
from impactlab.plan import Plan
from impactlab.rules import BATCH_TIMES, BATCHES

Values = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Estimates:
    """Statistics of a run.

    Attributes
    ----------
    values, errors : dict of str to ndarray
        Values and standard errors, per body or contact.
    by_realization : dict of str to (realization, body or contact) ndarray
        The same statistics of each realization.
    drift : float
        Largest difference between the first and the second half of the run, in standard
        errors; NaN with fewer than 8 realizations.
    """

    values: Values
    errors: Values
    by_realization: Values
    drift: float


def estimate(plan: Plan, bodies: np.ndarray, contacts: np.ndarray, relaxation: float) -> Estimates:
    """Estimate all default statistics.

    Parameters
    ----------
    plan : Plan
    bodies : (batch, row, body, realization) ndarray
        Sums over the steps of each batch.
    contacts : (batch, row, contact, realization) ndarray
    relaxation : float
        Relaxation time of the slowest body (s).

    Returns
    -------
    Estimates
    """
    steps = np.diff([0, *plan.boundaries]).astype(float)
    realizations = bodies.shape[-1]
    enough_alone = realizations >= BATCHES
    whole = _statistics(plan, bodies.sum(axis=0) / plan.steps, contacts.sum(axis=0) / plan.steps)
    peak = contacts[:, PEAK].max(axis=0) if len(plan.ends) else np.zeros((0, realizations))
    if enough_alone:
        units, weights = whole, np.ones(realizations)
    else:
        scaled = steps[:, None, None, None]
        per_batch = [_statistics(plan, *pair) for pair in zip(bodies / scaled, contacts / scaled, strict=True)]
        units = {name: np.concatenate([item[name] for item in per_batch], axis=-1) for name in whole}
        weights = np.repeat(steps, realizations)
    trusted = enough_alone or (len(weights) >= BATCHES and steps.min() * plan.step >= 0.999 * BATCH_TIMES * relaxation)
    if not trusted and (len(plan.white) or plan.lines):
        _warn(plan, relaxation)
    values = {name: np.average(item, axis=-1, weights=weights) for name, item in units.items()}
    mean = values["mean_displacement"]
    values["variance_displacement"] = values["mean_square_displacement"] - mean**2
    linear = units["mean_square_displacement"] - 2.0 * mean[:, None] * units["mean_displacement"]
    units = {**units, "variance_displacement": linear}
    errors = {name: _error(item, weights, trusted) for name, item in units.items()}
    variance = whole["mean_square_displacement"] - whole["mean_displacement"] ** 2
    values["peak_contact_force"] = peak.mean(axis=-1)
    errors["peak_contact_force"] = _error(peak, np.ones(realizations), realizations > 1)
    by_realization = {**whole, "variance_displacement": variance, "peak_contact_force": peak}
    return Estimates(
        values,
        errors,
        {name: item.T for name, item in by_realization.items()},
        _drift(plan, bodies, contacts, steps),
    )


def _statistics(plan: Plan, bodies: np.ndarray, contacts: np.ndarray) -> Values:
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


def _error(units: np.ndarray, weights: np.ndarray, trusted: bool) -> np.ndarray:
    """Standard error of the weighted mean over the last axis; NaN if it cannot be trusted."""
    count = units.shape[-1]
    if not trusted or count < 2:
        return np.full(units.shape[:-1], np.nan)
    mean = np.average(units, axis=-1, weights=weights)
    scatter = ((weights * (units - mean[..., None])) ** 2).sum(axis=-1)
    result: np.ndarray = np.sqrt(scatter * count / (count - 1.0)) / weights.sum()
    return result


def _drift(plan: Plan, bodies: np.ndarray, contacts: np.ndarray, steps: np.ndarray) -> float:
    """Compare the two halves of every realization."""
    realizations = bodies.shape[-1]
    half = len(steps) // 2
    if realizations < 8 or half == 0:
        return float("nan")
    sums = np.concatenate([bodies[:, [X, XX, VV]].reshape(len(steps), -1, realizations), contacts[:, FORCE]], axis=1)
    difference = sums[:half].sum(axis=0) / steps[:half].sum() - sums[half:].sum(axis=0) / steps[half:].sum()
    error = difference.std(axis=-1, ddof=1) / np.sqrt(realizations)
    moving = error > 1e-12 * np.abs(sums).max(axis=(0, 2), initial=1e-300) / plan.steps
    return float(np.abs(difference.mean(axis=-1)[moving] / error[moving]).max(initial=0.0))


def _warn(plan: Plan, relaxation: float) -> None:
    if relaxation > 0.0:
        needed = BATCH_TIMES * relaxation * -(-BATCHES // plan.realizations)
        advice = f"run for at least {needed:.3g} s, or use {BATCHES} realizations"
    else:
        advice = f"use at least {BATCHES} realizations"
    warnings.warn(
        f"Too few independent samples for standard errors, which are NaN: {advice}.",
        AccuracyWarning,
        stacklevel=4,
    )
