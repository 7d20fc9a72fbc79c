"""From statistics of independent units to values and their standard errors.

A *unit* is what counts as independent: a realization or, where there are few of them, a
batch of one. A value is a mean over units. Where balances hold, whose expectation is
known to be 0, the part of a statistic's scatter that follows theirs is removed: the value
is that of a linear regression on the balances, at balance 0 (control variates).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from impactlab.errors import warn
from impactlab.kernels.sums import FORCE, PEAK, VV, XX, X
from impactlab.moments import Values, statistics_of
from impactlab.plan import Plan
from impactlab.rules import BATCH_TIMES, BATCHES, batches_wanted

SETTLED = 5.0
"""Relaxation times of spin-up after which balances may be used as controls."""

UNITS_PER_CONTROL = 8
"""Least number of units for each control of a regression."""

ROUNDING = 1e-15
"""Relative error of a sum, below which no standard error goes."""

BROKEN = 6.0
"""Balance, in standard errors, from which it counts as not closed."""


@dataclass(frozen=True, eq=False)
class Estimates:
    """Statistics of a run.

    Attributes
    ----------
    values, errors : dict of str to ndarray
        Values and standard errors, per body or contact; ``direct_<name>`` are plain means
        where the value itself is a combination with balances.
    by_realization : dict of str to (realization, body or contact) ndarray
        The direct statistics of each realization.
    drift : float
        Largest difference between the first and the second half of the run, in standard
        errors; NaN with fewer than 8 realizations.
    """

    values: Values
    errors: Values
    by_realization: Values
    drift: float


def estimate(plan: Plan, bodies: np.ndarray, contacts: np.ndarray, products: np.ndarray) -> Estimates:
    """Estimate all default statistics.

    Parameters
    ----------
    plan : Plan
    bodies : (batch, phase, row, body, realization) ndarray
        Sums over the steps of each batch.
    contacts : (batch, row, contact, realization) ndarray
    products : (batch, row, pair, realization) ndarray

    Returns
    -------
    Estimates
    """
    steps = np.diff([0, *plan.boundaries]).astype(float)
    counts = np.array([plan.counts(*pair) for pair in pairwise((0, *plan.boundaries))])
    realizations = bodies.shape[-1]
    enough_alone = realizations >= BATCHES
    whole = statistics_of(
        plan, bodies.sum(axis=0), counts.sum(axis=0), *(part.sum(axis=0) / plan.steps for part in (contacts, products))
    )
    if enough_alone:
        units, weights = whole, np.ones(realizations)
    else:
        means = (part / steps[:, None, None, None] for part in (contacts, products))
        per_batch = [statistics_of(plan, *batch) for batch in zip(bodies, counts, *means, strict=True)]
        units = {name: np.concatenate([item[name] for item in per_batch], axis=-1) for name in whole}
        weights = np.repeat(steps, realizations)
    if not plan.trusted and (len(plan.white) or plan.lines):
        _warn(plan)
    settled = plan.trusted and plan.spin_up_steps * plan.step >= SETTLED * plan.relaxation * (1.0 - 1e-9)
    values, errors = _combined(plan, units, weights, plan.trusted, settled)
    peak = contacts[:, PEAK].max(axis=0) if len(plan.ends) else np.zeros((0, realizations))
    values["peak_contact_force"] = peak.mean(axis=-1)
    errors["peak_contact_force"] = _mean(peak, np.ones(realizations), realizations > 1)[1]
    variance = whole["mean_square_displacement"] - whole["mean_displacement"] ** 2
    by_realization = {**whole, "variance_displacement": variance, "peak_contact_force": peak}
    return Estimates(
        values,
        errors,
        {name: item.T for name, item in by_realization.items()},
        _drift(plan, bodies.sum(axis=1), contacts, steps),
    )


def _combined(plan: Plan, units: Values, weights: np.ndarray, trusted: bool, settled: bool) -> tuple[Values, Values]:
    """Return values and standard errors, combined with the balances where these can be used."""
    balances = [name for name in units if name.startswith("balance_")]
    values, errors = {}, {}
    for name in balances:
        values[name], errors[name] = _mean(units[name], weights, trusted)
    controls = _controls(plan, units, values, errors) if settled else {}
    for name in units:
        if name in balances:
            continue
        direct = _mean(units[name], weights, trusted)
        values[name], errors[name] = _regressed(plan, name, units[name], controls, weights) if controls else direct
        if controls:
            values[f"direct_{name}"], errors[f"direct_{name}"] = direct
    for prefix in ("", "direct_") if controls else ("",):
        # the influence of a unit on E[x²] − E[x]² is that of x² − 2 E[x] x
        mean = values[f"{prefix}mean_displacement"]
        linear = units["mean_square_displacement"] - 2.0 * mean[:, None] * units["mean_displacement"]
        name = f"{prefix}variance_displacement"
        plain = prefix or not controls
        value, errors[name] = (
            _mean(linear, weights, trusted) if plain else _regressed(plan, name, linear, controls, weights)
        )
        values[name] = value + mean**2
    return values, errors


def _controls(plan: Plan, units: Values, values: Values, errors: Values) -> dict[int, list[np.ndarray]]:
    """Return the balances of each body that close, by its slot; nothing if one does not.

    A balance that is off says that the run is not stationary, or the step is beyond what
    the theory covers; then no value is corrected by it.
    """
    controls: dict[int, list[np.ndarray]] = {}
    for name in (name for name in units if name.startswith("balance_")):
        for body in np.flatnonzero(np.isfinite(errors[name])):
            scatter = errors[name][body]
            if abs(values[name][body]) > BROKEN * scatter:
                warn(
                    f"{name} of {plan.bodies[body]!r} is {abs(values[name][body]) / scatter:.1f} standard errors "
                    "off 0, so balances are not used: the spin-up may be too short, or the step too large."
                )
                return {}
            if scatter > 0.0:
                controls.setdefault(int(body), []).append(units[name][body])
    return controls


def _regressed(
    plan: Plan, name: str, units: np.ndarray, controls: dict[int, list[np.ndarray]], weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Regress each row of units on the balances of the bodies concerned.

    They are the body and its neighbours, or the two bodies of a contact. The standard error
    is that of the regression at balance 0: ``s² (1/n + ḡᵀ (Σ (g − ḡ)(g − ḡ)ᵀ)⁻¹ ḡ)``.
    """
    of_contacts = len(units) == len(plan.ends) and "contact" in name
    result = np.empty((2, len(units)))
    most = len(weights) // UNITS_PER_CONTROL
    for row, values in enumerate(units):
        near = plan.ends[row] if of_contacts else _neighbours(plan, row)
        chosen = [control for body in near for control in controls.get(int(body), [])][:most]
        result[:, row] = _regression(values, chosen, weights)
    return result[0], result[1]


def _neighbours(plan: Plan, body: int) -> np.ndarray:
    """Slots of a body and of those it can touch or is coupled to, itself first."""
    joined = plan.links[(plan.links == body).any(axis=1)]
    return np.concatenate([[body], np.unique(joined[joined != body])])


def _regression(values: np.ndarray, controls: list[np.ndarray], weights: np.ndarray) -> tuple[float, float]:
    """Return the value of a weighted linear regression at control 0, and its standard error."""
    share = weights / weights.sum()
    root = np.sqrt(share * len(weights))
    mean = share @ values
    g = np.array(controls).reshape(len(controls), len(values))
    offsets = g @ share
    centred = (g - offsets[:, None]) * root
    scale = np.sqrt((centred**2).sum(axis=1))
    used = scale > 0.0
    u, s, vt = np.linalg.svd((centred[used] / scale[used, None]).T, full_matrices=False)
    kept = s > 1e-7
    u, s, vt = u[:, kept], s[kept], vt[kept]
    residual = (values - mean) * root
    slopes = u.T @ residual
    shift = vt @ (offsets[used] / scale[used]) / s
    residual = residual - u @ slopes
    freedom = len(values) - 1 - len(s)
    variance = residual @ residual / freedom * (1.0 / len(values) + shift @ shift)
    value = float(mean - shift @ slopes)
    return value, max(float(np.sqrt(variance)), ROUNDING * float(np.abs(values).max()))


def _mean(units: np.ndarray, weights: np.ndarray, trusted: bool) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean over the last axis and its standard error; NaN if it cannot be trusted."""
    count = units.shape[-1]
    mean = np.average(units, axis=-1, weights=weights)
    if not trusted or count < 2:
        return mean, np.full(units.shape[:-1], np.nan)
    scatter = ((weights * (units - mean[..., None])) ** 2).sum(axis=-1)
    return mean, np.maximum(np.sqrt(scatter * count / (count - 1.0)) / weights.sum(), ROUNDING * np.abs(mean))


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
    largest = np.abs(difference.mean(axis=-1)[moving] / error[moving]).max(initial=0.0)
    # as many standard errors of a normal law, since with few realizations the quotient has
    # wide tails (Wallace, Ann. Math. Statist. 30, 1959, 1121)
    freedom = realizations - 1.0
    return float(np.sqrt(freedom * np.log1p(largest**2 / freedom)) * (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0))


def _warn(plan: Plan) -> None:
    if plan.relaxation > 0.0:
        needed = (
            1.01 * BATCH_TIMES * plan.relaxation * batches_wanted(plan.realizations)
        )  # more than rounding takes away
        advice = f"run for at least {needed:.3g} s, or use {BATCHES} realizations"
    else:
        advice = f"use at least {BATCHES} realizations"
    warn(f"Too few independent samples for standard errors, which are NaN: {advice}.")
