"""From statistics of independent units to values and their standard errors.

A *unit* is what counts as independent: a realization or, where there are few of them, a
batch of one. A value is a mean over units. Where balances hold, whose expectation is
known to be 0, the part of a statistic's scatter that follows theirs is removed: the value
is that of a linear regression on the balances, at balance 0 (control variates).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from impactlab.ergodicity import memory_of
from impactlab.errors import warn
from impactlab.heating import Heating, heating_of
from impactlab.joint import LOAD
from impactlab.kernels.sums import FF, FORCE, PEAK, VV, XX, X
from impactlab.model import connected_parts
from impactlab.moments import Values, statistics_of
from impactlab.plan import Plan
from impactlab.plan.observed import WINDOW
from impactlab.regression import ROUNDING, Regression
from impactlab.rules import BATCH_TIMES, BATCHES, batches_wanted

UNITS_PER_CONTROL = 8
"""Least number of units for each control of a regression."""

CLOSINGS = 30
"""Closings of a contact, in all units together, below which its standard errors are too small: intervals of
95 % held the mean force in 90 % of cases with 16 to 32 of them, in 83 % with 8 to 16 (random networks, 64 units)."""

ACTED = 0.01
"""Part of the mean square of the forces of kicks from which on a unit counts as one in which they acted."""

BROKEN = 5.0
"""Balance, in standard errors, from which one of a few counts as not closed."""

_ROWS = 1000  # regressions at a time


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
        errors; with fewer than 8 realizations also between its first quarter and the rest, and NaN without
        enough batches.
    unbalanced : str
        Which balance does not close; empty if all do.
    contacts_per_sample : (contact,) ndarray
        How often each contact closed in a unit, on average.
    heating : Heating
        Heat that the step made.
    remembered : str
        Says that realizations settle into different motions; empty if they do not.
    """

    values: Values
    errors: Values
    by_realization: Values
    drift: float
    unbalanced: str
    contacts_per_sample: np.ndarray
    heating: Heating
    remembered: str


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
    steps = np.diff([0, *plan.clock.boundaries]).astype(float)
    counts = np.array([plan.counts(*pair) for pair in pairwise((0, *plan.clock.boundaries))])
    realizations = bodies.shape[-1]
    enough_alone = realizations >= BATCHES
    sums, of_contacts, of_products = bodies.sum(axis=0), contacts.sum(axis=0), products.sum(axis=0)
    of_batches = bodies.sum(axis=1)
    total = np.repeat(counts.sum(axis=0)[:, None], realizations, axis=1)
    if enough_alone:
        units = whole = statistics_of(plan, sums, total, of_contacts / plan.clock.steps, of_products / plan.clock.steps)
        weights = np.ones(realizations)
    else:  # realizations, then batch by batch
        weights = np.repeat(steps, realizations)
        time = np.concatenate([np.full(realizations, float(plan.clock.steps)), weights])
        both = statistics_of(
            plan,
            _joined(sums, bodies),
            np.concatenate([total, np.repeat(counts.T, realizations, axis=1)], axis=1),
            _joined(of_contacts, contacts) / time,
            _joined(of_products, products) / time,
        )
        whole = {name: item[:, :realizations] for name, item in both.items()}
        units = {name: item[:, realizations:] for name, item in both.items()}
    of_load = whole[LOAD]
    loads = units.pop(LOAD)
    whole.pop(LOAD, None)  # the same dictionary, maybe
    pushes = _pushes(bodies, steps, enough_alone) if plan.method.integrator.kicks else np.zeros((0, len(weights)))
    random = bool(plan.noise.random.any())
    trusted = plan.realizations.trusted and random
    if random and not trusted:
        _warn(plan)
    events = _events(units["contact_ratio"] > 0.0)
    seldom = _seldom(plan, events, pushes)
    values, errors, unbalanced = _combined(plan, units, weights, trusted, loads, seldom)
    for name in {"contact_rate", "direct_contact_rate"} & set(values):  # a flux and a regression may be below 0
        values[name] = np.maximum(values[name], 0.0)
    peak = contacts[:, PEAK].max(axis=0) if len(plan.system.ends) else np.zeros((0, realizations))
    values["peak_contact_force"] = peak.mean(axis=-1)
    errors["peak_contact_force"] = _mean(peak, np.ones(realizations), realizations > 1)[1]
    closings = values["contact_rate"] * plan.clock.step * plan.clock.steps * realizations
    _forget(plan, values, errors)
    memory = memory_of(plan, of_batches, steps, enough_alone)
    if random:
        moved = plan.cold if len(pushes) else np.zeros(0, dtype=np.int64)
        pushed = _pushed(pushes)
        moved = moved[pushed[moved] < CLOSINGS]
        _widen(plan, units, events, values, errors)
        _widen_bodies(plan, moved, pushed[moved], values, errors)
        scattered = {name: units[name] for name in units if "contact" in name} | {"peak_contact_force": peak}
        for name, item in scattered.items():  # what was the same in all units is not known exactly
            for key in {name, f"direct_{name}"} & set(errors):
                errors[key][(np.ptp(item, axis=-1) == 0.0) | (events == 0.0)] = np.nan
        widening = memory.widening(len(weights))
        of_ends = np.append(widening, 1.0)[plan.system.ends].max(axis=1, initial=1.0)
        for name, error in errors.items():
            error *= of_ends if "contact" in name else widening
        if plan.realizations.trusted:
            _warn_of_rare(
                plan, np.where((closings < 1.0) & np.isfinite(events), np.maximum(closings, events), closings)
            )
            _warn_of_still(plan, moved, pushed[moved])
    variance = np.maximum(whole["mean_square_displacement"] + of_load - whole["mean_displacement"] ** 2, 0.0)
    by_realization = {**whole, "variance_displacement": variance, "peak_contact_force": peak}
    return Estimates(
        values,
        errors,
        {name: item.T for name, item in by_realization.items()},
        _drift(plan, of_batches, contacts, steps),
        unbalanced,
        closings / len(weights),
        heating_of(plan, units, weights, seldom),
        memory.warning,
    )


def _forget(plan: Plan, values: Values, errors: Values) -> None:
    """Turn standard errors into NaN where no noise reaches, unless a value is 0: nothing is sampled there."""
    of_bodies = ~plan.noise.random
    of_contacts = ~np.append(plan.noise.random, False)[plan.system.ends].any(axis=1)
    for name, error in errors.items():
        still = of_contacts if "contact" in name else of_bodies
        error[still] = np.where(values[name][still] != 0.0, np.nan, 0.0)


def _joined(whole: np.ndarray, batches: np.ndarray) -> np.ndarray:
    """Put batches, on the first axis, behind what they add up to, along the last."""
    units = np.moveaxis(np.concatenate([whole[None], batches]), 0, -2)
    return units.reshape(*whole.shape[:-1], units.shape[-2] * units.shape[-1])


def _pushes(bodies: np.ndarray, steps: np.ndarray, enough_alone: bool) -> np.ndarray:
    """Return the mean square of the forces of kicks in each unit, (body, unit)."""
    squares = bodies[:, :, FF].sum(axis=1)
    if enough_alone:
        return np.asarray(squares.sum(axis=0) / steps.sum())
    return np.asarray((squares / steps[:, None, None]).swapaxes(0, 1).reshape(squares.shape[1], -1))


def _events(seen: np.ndarray) -> np.ndarray:
    """Return how often something independent happened in all units together, from the units that saw it.

    Of independent events, of which a unit sees n on average, it sees none with the probability exp(−n).
    Infinite where each unit saw it.
    """
    count = seen.shape[-1]
    with np.errstate(divide="ignore"):
        return np.asarray(count * -np.log1p(-np.count_nonzero(seen, axis=-1) / count)) + 0.0


def _pushed(pushes: np.ndarray) -> np.ndarray:
    """Return how often kicks acted on each body, from their mean squares by unit, (body,)."""
    return _events((pushes > 0.0) & (pushes >= ACTED * pushes.mean(axis=-1, keepdims=True)))


def _seldom(plan: Plan, events: np.ndarray, pushes: np.ndarray) -> np.ndarray:
    """Whether a contact of each body closed, or its kicks acted, too seldom for balances, (body,) of bool.

    Parameters
    ----------
    plan : Plan
    events : (contact,) ndarray
        How often each contact closed, see `_events`.
    pushes : (body, unit) ndarray
        Mean square of the forces of kicks; without rows if the method does not kick.
    """
    seldom = np.zeros(len(plan.system.bodies) + 1, dtype=bool)
    seldom[plan.system.ends[(events < CLOSINGS) & plan.forces.likely]] = True
    if len(pushes):
        seldom[:-1] |= plan.forces.kicked & (_pushed(pushes) < CLOSINGS)
    return seldom[:-1]


def _combined(
    plan: Plan, units: Values, weights: np.ndarray, trusted: bool, loads: np.ndarray, seldom: np.ndarray
) -> tuple[Values, Values, str]:
    """Return values and standard errors, combined with the balances where these can be used, and which is off.

    A balance takes all scatter from a value but that which contacts and other forces of kicks make. Where these acted
    too seldom the rest says nothing: balances of bodies on which such a force acts are no controls, and a
    regression whose residuals rest on a few units, or are nothing but rounding, gives way to the plain mean.
    """
    balances = [name for name in units if name.startswith("balance_")]
    values, errors = {}, {}
    for name in balances:
        values[name], errors[name] = _mean(units[name], weights, trusted)
    unbalanced = _unbalanced(plan, values, errors)
    controls = None if unbalanced or not (trusted and plan.clock.settled) else _controls(units, values, errors, seldom)
    prefix = "" if controls is None else "direct_"
    for name in units:
        if name not in balances:
            values[f"{prefix}{name}"], errors[f"{prefix}{name}"] = _mean(units[name], weights, trusted)
    influence, square = _influence(units, values[f"{prefix}mean_displacement"], loads)
    mean, errors[f"{prefix}variance_displacement"] = _mean(influence, weights, trusted)
    values[f"{prefix}variance_displacement"] = np.maximum(mean + square, 0.0)
    if controls is None:
        return values, errors, unbalanced
    kicked = _kicked(plan)
    for of_contacts, near in ((False, _neighbours(plan)), (True, _touching(plan))):
        names = [name for name in units if name not in balances and ("contact" in name) == of_contacts]
        own = [*names] if of_contacts else [*names, "variance_displacement"]
        count = len(plan.system.ends) if of_contacts else len(plan.system.bodies)
        for name in own:
            values[name], errors[name] = np.empty(count), np.empty(count)
        doubtful = np.ones(count, dtype=bool) if of_contacts else kicked
        for rows, chosen in _choices(near, controls[0], len(weights) // UNITS_PER_CONTROL, count):
            regression = Regression(controls[1][chosen], weights)
            for name in names:
                item = units[name][rows]
                values[name][rows], errors[name][rows] = regression.at_zero(item)
                few = rows[doubtful[rows] & regression.rests_on_few(item)]
                values[name][few], errors[name][few] = values[f"direct_{name}"][few], errors[f"direct_{name}"][few]
            if not of_contacts:
                mean = values["mean_displacement"][rows]
                influence, square = _influence({name: units[name][rows] for name in names}, mean, loads[rows])
                value, error = regression.at_zero(influence)
                few = doubtful[rows] & regression.rests_on_few(influence)
                plain, of_plain = _mean(influence, weights, trusted)
                values["variance_displacement"][rows] = np.maximum(np.where(few, plain, value) + square, 0.0)
                errors["variance_displacement"][rows] = np.where(few, of_plain, error)
    return values, errors, unbalanced


def _influence(units: Values, mean: np.ndarray, loads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the influence of each unit on E[x²] − E[x]², which is that of x² − 2 E[x] x, and what is missing."""
    square = units["mean_square_displacement"] + loads
    return square - 2.0 * mean[:, None] * units["mean_displacement"], mean**2


def _unbalanced(plan: Plan, values: Values, errors: Values) -> str:
    """Say which balance is off, if one is.

    Then the run is not stationary, or the step is beyond what the theory covers, and no value is
    corrected by a balance.
    """
    names = [name for name in values if name.startswith("balance_")]
    count = sum(int(np.isfinite(errors[name]).sum()) for name in names)
    most = np.sqrt(BROKEN**2 + 2.0 * np.log(max(count, 10) / 10.0))  # as the largest of so many normal numbers grows
    for name in names:
        scatter = np.where(np.isfinite(errors[name]), errors[name], np.inf)
        broken = np.flatnonzero(np.abs(values[name]) > most * scatter)
        if broken.size:
            body = broken[0]
            distance = abs(values[name][body]) / scatter[body]
            return (
                f"{name} of {plan.system.bodies[body]!r} is {distance:.1f} standard errors off 0, so balances are not "
                "used: the spin-up may be too short, or the step too large."
            )
    return ""


def _controls(
    units: Values, values: Values, errors: Values, seldom: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return which balances of each body are controls, (body, balance), and all of them, (body, balance, unit)."""
    names = [name for name in units if name.startswith("balance_")]
    usable = np.array([np.isfinite(errors[name]) & (errors[name] > 0.0) & ~seldom for name in names])
    if not usable.any():
        return None
    return usable.T, np.stack([units[name] for name in names], axis=1)


def _kicked(plan: Plan) -> np.ndarray:
    """Whether other forces than linear ones may act on each body, or one in a group with it, (body,) of bool."""
    kicked = plan.forces.kicked.copy()
    for group in plan.method.groups:
        kicked[group.slots] = kicked[group.slots].any()
    return kicked


def _neighbours(plan: Plan) -> np.ndarray:
    """Return pairs of a body and those it can touch or is coupled to, itself first, (pair, 2)."""
    count = len(plan.system.bodies)
    links = plan.system.links[(plan.system.links < count).all(axis=1)]  # a wall has no balances
    keys = np.unique(np.concatenate([links, links[:, ::-1]]) @ [count + 1, 1] + 1)
    keys = np.sort(np.concatenate([keys, np.arange(count) * (count + 1)]))
    body, other = np.divmod(keys, count + 1)
    return np.stack([body, np.where(other, other - 1, body)], axis=1)


def _touching(plan: Plan) -> np.ndarray:
    """Return pairs of a contact and a body of it, the first body first, (pair, 2)."""
    pairs = np.stack([np.repeat(np.arange(len(plan.system.ends)), 2), plan.system.ends.ravel()], axis=1)
    return pairs[pairs[:, 1] < len(plan.system.bodies)]


def _choices(
    near: np.ndarray, usable: np.ndarray, most: int, count: int
) -> Iterator[tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]]:
    """Give rows with equal numbers of controls, some at a time, and bodies and balances of these, (row, control)."""
    pair, balance = np.nonzero(usable[near[:, 1]])
    row, body = near[pair].T
    rank = np.arange(len(row)) - np.searchsorted(row, row)
    row, body, balance = (item[rank < most] for item in (row, body, balance))
    numbers = np.bincount(row, minlength=count)
    begins = np.cumsum(numbers) - numbers
    for number in np.unique(numbers):
        rows = np.flatnonzero(numbers == number)
        for some in np.array_split(rows, len(rows) // _ROWS + 1):
            places = begins[some, None] + np.arange(number)
            yield some, (body[places], balance[places])


def _mean(units: np.ndarray, weights: np.ndarray, trusted: bool) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean over the last axis and its standard error; NaN if it cannot be trusted."""
    count = units.shape[-1]
    mean = np.average(units, axis=-1, weights=weights)
    if not trusted or count < 2:
        return mean, np.full(units.shape[:-1], np.nan)
    scatter = ((weights * (units - mean[..., None])) ** 2).sum(axis=-1)
    return mean, np.maximum(np.sqrt(scatter * count / (count - 1.0)) / weights.sum(), ROUNDING * np.abs(mean))


def _drift(plan: Plan, bodies: np.ndarray, contacts: np.ndarray, steps: np.ndarray) -> float:
    """Compare the two halves of every realization; of few realizations halves and quarters by their batches."""
    realizations = bodies.shape[-1]
    half = len(steps) // 2
    alone = realizations < 8
    if half == 0 or (alone and not plan.realizations.trusted):
        return float("nan")
    sums = np.concatenate([bodies[:, [X, XX, VV]].reshape(len(steps), -1, realizations), contacts[:, FORCE]], axis=1)
    if alone:
        means = sums / steps[:, None, None]
        cuts = half, len(steps) // 4
        differences = np.array([means[:cut].mean(axis=(0, 2)) - means[cut:].mean(axis=(0, 2)) for cut in cuts])
        spread = [[means[:cut].var(axis=(0, 2), ddof=1), means[cut:].var(axis=(0, 2), ddof=1)] for cut in cuts]
        counts = realizations * np.array([[cut, len(steps) - cut] for cut in cuts])
        error = np.sqrt((np.array(spread) / counts[..., None]).sum(axis=1))
        freedom = counts.min() - 1.0
    else:
        difference = sums[:half].sum(axis=0) / steps[:half].sum() - sums[half:].sum(axis=0) / steps[half:].sum()
        error = difference.std(axis=-1, ddof=1) / np.sqrt(realizations)
        differences, freedom = difference.mean(axis=-1), realizations - 1.0
    moving = error > 1e-12 * np.abs(sums).max(axis=(0, 2), initial=1e-300) / plan.clock.steps
    largest = np.abs(differences[moving] / error[moving]).max(initial=0.0)
    # as many standard errors of a normal law, since with few realizations the quotient has
    # wide tails (Wallace, Ann. Math. Statist. 30, 1959, 1121)
    return float(np.sqrt(freedom * np.log1p(largest**2 / freedom)) * (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0))


def _warn(plan: Plan) -> None:
    if plan.clock.relaxation > 0.0:
        needed = (
            1.01 * BATCH_TIMES * plan.clock.relaxation * batches_wanted(plan.realizations.number)
        )  # more than rounding takes away
        advice = f"run for at least {needed:.3g} s, or use {BATCHES} realizations"
    else:
        advice = f"use at least {BATCHES} realizations"
    warn(f"Too few independent samples for standard errors, which are NaN: {advice}.")


def _widen(plan: Plan, units: Values, events: np.ndarray, values: Values, errors: Values) -> None:
    """Add to the errors of contacts that closed n times, too seldom for them, those of ``n ± √n`` closings.

    The few that were seen may have been light ones. One of bodies of the reduced mass μ whose velocities
    approach each other by v, sqrt(2) times their root mean square, gives the impulse 2 μ v; and it takes about π δ/v,
    δ being the length over which the density of the gap varies near contact.
    """
    rare = np.flatnonzero((events > 0.0) & (events < CLOSINGS))
    inverse_mass = np.append(1.0 / plan.system.linear[0], 0.0)
    square = np.append(values["mean_square_velocity"], 0.0)
    inverse_mass, square = (item[plan.system.ends[rare]].sum(axis=1) for item in (inverse_mass, square))
    approach = np.sqrt(2.0 * np.maximum(square, 0.0))
    with np.errstate(divide="ignore"):
        duration = np.pi * plan.observed.window[rare] / WINDOW / approach
    scatter = np.sqrt(events[rare]) / (plan.clock.step * plan.clock.steps * plan.realizations.number)
    sizes = {"contact_ratio": duration, "contact_rate": 1.0, "mean_contact_force": 2.0 / inverse_mass * approach}
    for name, size in sizes.items():
        for key in {name, f"direct_{name}"} & set(errors):
            errors[key][rare] = np.hypot(errors[key][rare], scatter * size)


def _widen_bodies(plan: Plan, moved: np.ndarray, events: np.ndarray, values: Values, errors: Values) -> None:
    """Do what `_widen` does for bodies that kicks alone move, and moved n times; NaN where they never did.

    An event may bring the energy that the hottest body of the part has, for as long as it takes to be lost.
    """
    if not moved.size:
        return
    mass, _, stiffness = plan.system.linear
    labels = connected_parts(len(mass), plan.system.links)
    hottest = np.zeros(labels.max(initial=-1) + 1)
    np.maximum.at(hottest, labels, mass * values["mean_square_velocity"])
    time = plan.clock.step * plan.clock.steps * plan.realizations.number
    share = np.sqrt(events) * 0.5 * plan.clock.relaxation / time
    with np.errstate(divide="ignore", invalid="ignore"):  # nothing moves, or no spring holds it
        velocity = share * hottest[labels[moved]] / mass[moved]
        squares = {"velocity": velocity, "displacement": velocity * mass[moved] / stiffness[moved]}
    for quantity, square in squares.items():
        sizes = {f"mean_{quantity}": np.sqrt(square), f"mean_square_{quantity}": square}
        sizes |= {"variance_displacement": square} if quantity == "displacement" else {}
        for name, size in sizes.items():
            for key in {name, f"direct_{name}"} & set(errors):
                known = np.where(np.isfinite(size) & (events > 0.0), size, np.nan)
                errors[key][moved] = np.hypot(errors[key][moved], known)


def _warn_of_still(plan: Plan, moved: np.ndarray, events: np.ndarray) -> None:
    """Warn of bodies that kicks alone move, and moved too seldom for their standard errors."""
    if moved.size:
        stillest = int(np.argmin(events))
        warn(
            f"{len(moved)} oscillator(s) that only contacts or couplings move were moved less than {CLOSINGS} times in "
            f"all, too seldom for standard errors (NaN for none): {plan.system.bodies[moved[stillest]]!r} about "
            f"{events[stillest]:.2g} times. Run for longer, or use more realizations."
        )


def _warn_of_rare(plan: Plan, closings: np.ndarray) -> None:
    """Warn of contacts that closed, but too seldom for the standard errors of their statistics."""
    rare = np.flatnonzero((closings > 0.0) & (closings < CLOSINGS))
    if rare.size:
        rarest = rare[np.argmin(closings[rare])]
        needed = plan.clock.step * plan.clock.steps * CLOSINGS / closings[rarest]
        warn(
            f"{len(rare)} contact(s) closed less than {CLOSINGS} times in all, too seldom for standard errors: "
            f"{plan.system.contacts[rarest]!r} about {closings[rarest]:.2g} times. Run for {needed:.2g} s, or use more "
            "realizations."
        )
