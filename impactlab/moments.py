"""From sums to statistics: moments at the right time of the step, and balances."""

from __future__ import annotations

import numpy as np

from impactlab.integrators.base import Flows
from impactlab.integrators.exact_flow import kick_share
from impactlab.joint import LOAD, joint_statistics, mean_load, weighted_sum
from impactlab.kernels.sums import (
    BEGUN,
    CLOSED,
    FF,
    FLUX,
    FORCE,
    FV,
    FX,
    INTENSITY,
    TURN,
    VV,
    XV,
    XX,
    F,
    V,
    X,
)
from impactlab.plan import Plan

Values = dict[str, np.ndarray]

_CHUNK = 4096  # bodies whose equations are solved at a time


def statistics_of(
    plan: Plan, sums: np.ndarray, counts: np.ndarray, contacts: np.ndarray, products: np.ndarray
) -> Values:
    """Turn sums into statistics.

    Parameters
    ----------
    plan : Plan
    sums : (phase, row, body, unit) ndarray
        Sums over the steps of each phase; see `impactlab.kernels.sums`.
    counts : (phase, unit) ndarray of int
        How many steps these are.
    contacts, products : (row, contact or pair, unit) ndarray
        Mean sums.

    Returns
    -------
    dict of str to (body or contact, unit) ndarray
        Statistics and balances; under the name `LOAD` what the mean square of the displacement lacks for the variance.
    """
    seen = counts > 0
    complete = seen.all(axis=0)
    means = sums / np.where(seen, counts, 1)[:, None, None]
    of_phases = means.sum(axis=0) / seen.sum(axis=0)  # sums over no steps are 0
    bodies = sums.sum(axis=0) / counts.sum(axis=0) if plan.transient else of_phases
    processed = {
        "mean_displacement": bodies[X],
        "mean_square_displacement": bodies[XX],
        "mean_velocity": bodies[V],
        "mean_square_velocity": bodies[VV],
        LOAD: np.zeros_like(bodies[X]),
    }
    balances: Values = {}
    if plan.method.flows is not None:
        if not complete.all():
            means[..., ~complete] = np.nan
        closed = _closed_flow(plan)
        over_time, at_kicks = _response_to_mean_force(plan, plan.method.flows)
        steady = closed & ~np.isin(np.arange(len(closed)), plan.noise.white if plan.noise.time_varying else ())
        balances, mixed = _balances(plan, plan.method.flows, means, steady, at_kicks)
        off = [balances["balance_mean_square_displacement"], mixed, balances["balance_mean_square_velocity"]]
        known = [np.where(np.isfinite(item), item, 0.0) if plan.observed.sampled else None for item in off]
        if plan.transient:
            begun = sums[:, BEGUN:] / counts.sum(axis=0)
            processed = _over_time(plan, plan.method.flows, bodies, begun, processed, closed)
        else:
            processed = _processed(plan, plan.method.flows, means, processed, closed, over_time, at_kicks, known)
        _open_flow(plan, bodies, processed, ~closed)
        for group in plan.method.groups:
            if not closed[group.slots].all():
                continue
            of_pairs = products[:, np.isin(plan.method.pairs[:, 0], group.slots)]
            after = begun.sum(axis=0)[:, group.slots] if plan.transient else None
            found = joint_statistics(group, plan.clock.step, bodies[:, group.slots], of_pairs, after)
            for name, values in found.items():
                target = balances if name in balances else processed
                sure = complete | (plan.transient and name not in balances)
                target[name][group.slots] = np.where(sure, values, target[name][group.slots])
    flux = 9.0 / 8.0 * contacts[FLUX] / plan.observed.window[:, None]
    return {
        **processed,
        "contact_ratio": contacts[CLOSED],
        "contact_rate": contacts[FLUX] / plan.clock.step if plan.observed.counted else flux,
        "mean_contact_force": contacts[FORCE],
        **balances,
    }


def _processed(
    plan: Plan, flows: Flows, s: np.ndarray, at_kicks: Values, closed: np.ndarray, over_time: np.ndarray,
    of_kicks: np.ndarray, off: list[np.ndarray | None],
) -> Values:  # fmt: skip
    """Moments over the time of a step, without the error of second order that those at the kick have.

    Means are shifted by what separates those at the kicks from the mean over time under the
    mean force F, which is F/k for the displacement. Mean squares are (kick + 2 middle of the
    flow)/3, Simpson's rule; those in the middle follow exactly from those after the kick before;
    see also `mean_load`.
    Only the flow of white noise is closed in this way; other bodies keep the moments at the kick
    for `_open_flow`, and those in groups are left to `joint_statistics`. Where states are
    samples, what their second moments (of x², x v and v²) are `off` the balances is no part of the
    difference between kick and middle.
    """
    increment = _increment(plan)
    x, v, xx, xv, vv = (np.roll(item, 1, axis=0) for item in _after_kicks(s, increment))  # after the kick before
    a, q = flows.middle_transition, flows.middle_covariance
    of_xx, of_xv, of_vv = off
    if of_xx is not None:
        xx, xv, vv = xx - of_xx, xv - of_xv, vv - of_vv
    closed = (closed & ~plan.method.grouped)[:, None] & np.isfinite(s).all(axis=(0, 1))
    at_kicks = at_kicks | {"mean_square_velocity": _slowed(plan, s, at_kicks["mean_square_velocity"])}
    result = {}
    for row, quantity in enumerate(("displacement", "velocity")):
        name = f"mean_{quantity}"
        shift = over_time[:, row, None] * s[:, F].mean(axis=0) - weighted_sum(of_kicks[:, row].T, s[:, F])
        result[name] = at_kicks[name] + np.where(closed & np.isfinite(shift), shift, 0.0)
        name = f"mean_square_{quantity}"
        of_x, of_v = a[:, :, row, 0, None], a[:, :, row, 1, None]
        middle = of_x**2 * xx + 2.0 * of_x * of_v * xv + of_v**2 * vv + q[:, :, row, row, None]
        over_step = middle.mean(axis=0) if of_xx is None else middle.mean(axis=0) + (of_xx, of_vv)[row]
        result[name] = np.where(closed, (at_kicks[name] + 2.0 * over_step) / 3.0, at_kicks[name])
    result["mean_square_velocity"] = result["mean_square_velocity"] - np.where(closed, _sawtooth(plan, s), 0.0)
    at_middle = (a[:, :, 0, 0, None] * x + a[:, :, 0, 1, None] * v).mean(axis=0)
    loads = mean_load(result["mean_displacement"], at_kicks["mean_displacement"], at_middle)
    result[LOAD] = np.where(closed, loads, 0.0)
    return result


def _over_time(
    plan: Plan, flows: Flows, s: np.ndarray, begun: np.ndarray, at_kicks: Values, closed: np.ndarray
) -> Values:
    """Moments over the time of a transient by Simpson's rule, (kick + 2 middle of the flow)/3.

    Those in the middle follow from those of the kicks with which the flows of each phase begin. The mean
    velocity is the way from start to end.
    """
    x, v, xx, xv, vv = _after_kicks(begun, _increment(plan))
    a, q = flows.middle_transition, flows.middle_covariance
    intensity = begun[:, INTENSITY - BEGUN]
    closed = (closed & ~plan.method.grouped)[:, None]
    middle = {"mean_displacement": (a[:, :, 0, 0, None] * x + a[:, :, 0, 1, None] * v).sum(axis=0)}
    for row, quantity in enumerate(("displacement", "velocity")):
        of_x, of_v = a[:, :, row, 0, None], a[:, :, row, 1, None]
        square = of_x**2 * xx + 2.0 * of_x * of_v * xv + of_v**2 * vv + q[:, :, row, row, None] * intensity
        middle[f"mean_square_{quantity}"] = square.sum(axis=0)
    forgotten, own = _forgotten(plan)[:, None], _slowed(plan, s[None], at_kicks["mean_square_velocity"])
    at_kicks = at_kicks | {"mean_square_velocity": np.where(forgotten, own, at_kicks["mean_square_velocity"])}
    over_time = {name: (at_kicks[name] + 2.0 * item) / 3.0 for name, item in middle.items()}
    over_time["mean_square_velocity"] -= _sawtooth(plan, s[None])
    means = [item["mean_displacement"] for item in (over_time, at_kicks, middle)]
    over_time[LOAD] = mean_load(*means)
    # half of the states at both ends are in the others
    way = {"mean_velocity": 2.0 / plan.clock.step * (at_kicks["mean_displacement"] - begun[:, X].sum(axis=0))}
    at_kicks = {**at_kicks, LOAD: np.zeros_like(way["mean_velocity"])}
    return {**{name: np.where(closed, item, at_kicks[name]) for name, item in over_time.items()}, **way}


def _after_kicks(s: np.ndarray, increment: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the means of x, v, x², x v and v² after kicks from those in their middle, (phase, body, unit) each."""
    v = s[:, V] + 0.5 * increment * s[:, F]
    xv = s[:, XV] + 0.5 * increment * s[:, FX]
    return s[:, X], v, s[:, XX], xv, s[:, VV] + increment * s[:, FV] + 0.25 * increment**2 * s[:, FF]


def _open_flow(plan: Plan, s: np.ndarray, processed: Values, rows: np.ndarray) -> None:
    """Write the moments of bodies of which the middle of the flow is not known: cosines or given forces push them.

    The mean displacement over a step under the force f of the kick is that of ``y = x + h² f/12m``. Where no time is
    ahead of another, Simpson's rule adds ``(h/m)² E[f F]/6`` to the mean square of the velocity, F being all forces
    on the body: what the flow adds between two kicks in the place of a part of the force counts as a force.
    So a load that others balance, static or slow, adds nothing.
    """
    if not rows.any():
        return
    s, increment = s[:, rows], _increment(plan)[rows]
    shift = plan.clock.step / 12.0 * increment
    processed["mean_displacement"][rows] = s[X] + shift * s[F]
    processed["mean_square_displacement"][rows] = s[XX] + 2.0 * shift * s[FX] + shift**2 * s[FF]
    processed["mean_square_velocity"][rows] = s[VV] + increment / 6.0 * (increment * s[FF] + s[TURN])


def _slowed(plan: Plan, s: np.ndarray, at_kicks: np.ndarray) -> np.ndarray:
    """Mean square velocities with the `kick_share` of bodies that friction slows within a step, (body, unit)."""
    share = kick_share(plan.system.linear[1] / plan.system.linear[0] * plan.clock.step)
    slowed = share < 0.5
    if not slowed.any():
        return at_kicks
    share, increment = share[slowed, None], _increment(plan)[slowed]
    vv, fv, ff = (s[:, row, slowed].mean(axis=0) for row in (VV, FV, FF))
    result, own = at_kicks.copy(), vv + increment * (2.0 * share - 1.0) * (fv - 0.5 * increment * ff)
    own += increment**2 * (share**2 - 0.25) * ff
    result[slowed] = np.where(np.isfinite(own), own, at_kicks[slowed])  # units without a step of each phase
    return result


def _forgotten(plan: Plan) -> np.ndarray:
    """Whether friction makes bodies forget their velocities within a step, (body,) of bool."""
    mass, damping, _ = plan.system.linear
    return np.asarray(damping * plan.clock.step > 0.999 * mass)  # steps are often m/c


def _sawtooth(plan: Plan, s: np.ndarray) -> np.ndarray:
    """Return what `_processed` has too much in the mean squares of velocities that friction forgets, (body, unit).

    A time τ after a kick by F the body moves at A F/c instead of F/c, ``A = g e^(−γτ)/(1 − e^(−g))``, g = γh. Where a
    step is as long as 1/γ it is the displacement that is resolved, which is slow beside friction. Then the noise n of
    the velocity has E[n F] = (T/c) E[F'] with the force of its own time, and ``C = g e^(−2γτ)/(1 − e^(−2g))`` of that
    with what kicks have left of it. With T E[F'] = −E[F² − k x F], of one temperature, the mean square is
    ``((A² − 2C) E[F²] + (2C − 2A + 1) k E[x F])/c²`` too large, in the middle of the flow and at the time of the
    kick, which counts by its `kick_share`.
    """
    mass, damping, stiffness = plan.system.linear
    slow, result = _forgotten(plan), np.zeros(s.shape[2:])
    if not slow.any():
        return result
    g = (damping / mass * plan.clock.step)[slow, None]
    with np.errstate(over="ignore"):
        moved = np.stack([np.ones_like(g), 0.5 * g / np.sinh(0.5 * g)])
        seen = np.stack([kick_share(g) * g + g / np.expm1(2.0 * g), 0.5 * g / np.sinh(g)])
    of_squares, of_places = (
        (at_kick + 2.0 * at_middle) / 3.0 for at_kick, at_middle in (moved**2 - 2.0 * seen, 2.0 * (seen - moved) + 1.0)
    )
    ff, fx = (s[:, row, slow].mean(axis=0) for row in (FF, FX))
    result[slow] = (of_squares * ff + of_places * stiffness[slow, None] * fx) / damping[slow, None] ** 2
    return result


def _response_to_mean_force(plan: Plan, flows: Flows) -> tuple[np.ndarray, np.ndarray]:
    """Return displacement and velocity under unit force: means over time, and at the kicks by phase of the force.

    Returns
    -------
    (body, 2), (body, 2, phase) ndarray
        NaN where there is no stationary mean.
    """
    _, damping, stiffness = plan.system.linear
    a, increment = flows.transition, _increment(plan)
    phases = len(a)
    over_time, at_kicks = np.full((len(damping), 2), np.nan), np.full((len(damping), 2, phases), np.nan)
    held = ~plan.method.grouped & (stiffness > 0.0)
    over_time[held] = np.column_stack([1.0 / stiffness[held], np.zeros(held.sum())])
    push = np.stack([np.zeros_like(increment[held]), increment[held]], axis=1)
    at_kicks[held] = _cycle(a[:, held], push)
    free = ~plan.method.grouped & (stiffness == 0.0) & (damping > 0.0)
    over_time[free, 1] = 1.0 / damping[free]
    at_kicks[free, 1] = _cycle(a[:, free, 1:, 1:], increment[free, None])[:, 0]
    at_kicks[:, 1] += 0.5 * increment / phases  # the velocity is read in the middle of the kick
    return over_time, at_kicks


def _balances(
    plan: Plan, flows: Flows, s: np.ndarray, closed: np.ndarray, of_kicks: np.ndarray
) -> tuple[Values, np.ndarray]:
    """Direct minus balance estimates of the moments at the kick; zero in expectation at any step.

    With A the flow of a step, Σ the linear law, g the velocity increment of a kick, and
    K = [[0, E[g x]], [E[g x], 2 E[g v]]], the moments before a kick are Σ + D, and those
    before the next one Σ + A (D + K) Aᵀ: linear equations for the D of all phases of the
    method's cycle. Where the linear law does not exist, a part of this remains: the
    velocity of a damped free body, the power of the kicks on an undamped one. Second comes that
    of E[x v].
    """
    mass, damping, stiffness = plan.system.linear
    increment = _increment(plan)
    before = s[:, VV] - increment * s[:, FV] + 0.25 * increment**2 * s[:, FF]  # E[v²] before the kick
    intensity = np.zeros(len(mass))
    intensity[plan.noise.white] = plan.noise.intensity
    of_power, of_virial = increment * s[:, FV], increment * s[:, FX]
    mean, displacement, mixed, velocity = (np.full(s.shape[2:], np.nan) for _ in range(4))
    own, a, held, damped = closed & ~plan.method.grouped, flows.transition, stiffness > 0.0, damping > 0.0
    bodies = own & held
    mean[bodies] = s[:, X, bodies].mean(axis=0) - weighted_sum(of_kicks[bodies, 0].T, s[:, F, bodies])
    bodies = own & ~damped & (intensity == 0.0)
    velocity[bodies] = of_power[:, bodies].mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        heat = (np.pi * intensity / (mass * damping))[:, None]
    bodies = own & damped & ~held
    gain = _cycle(a[:, bodies, 1:, 1:] ** 2, np.full((bodies.sum(), 1, 1), 2.0))[:, 0]
    velocity[bodies] = before[:, bodies].mean(axis=0) - heat[bodies] - weighted_sum(gain.T, of_power[:, bodies])
    bodies = own & damped & held
    a = a[:, bodies]
    squares = (a[..., :, None, :, None] * a[..., None, :, None, :]).reshape(*a.shape[:2], 4, 4)  # A ⊗ A
    kicks = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 2.0]]).T  # K, flattened, of virial and power
    gain = _cycle(squares, np.broadcast_to(kicks, (a.shape[1], 4, 2))).reshape(-1, 4, len(a), 2)
    known = [
        weighted_sum(gain[:, row, :, 0].T, of_virial[:, bodies])
        + weighted_sum(gain[:, row, :, 1].T, of_power[:, bodies])
        for row in (0, 1, 3)
    ]
    potential = heat[bodies] * mass[bodies, None] / stiffness[bodies, None]
    displacement[bodies] = s[:, XX, bodies].mean(axis=0) - potential - known[0]
    mixed[bodies] = (s[:, XV, bodies] - 0.5 * of_virial[:, bodies]).mean(axis=0) - known[1]
    velocity[bodies] = before[:, bodies].mean(axis=0) - heat[bodies] - known[2]
    balances = {
        "balance_mean_displacement": mean,
        "balance_mean_square_displacement": displacement,
        "balance_mean_square_velocity": velocity,
    }
    return balances, mixed


def _cycle(maps: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Solve ``z_p = L_p (z_q + B u_q)``, q the phase before p; return the mean of z per unit of each u.

    Parameters
    ----------
    maps : (phase, body, n, n) ndarray
        L.
    inputs : (body, n, m) ndarray
        B.

    Returns
    -------
    (body, n, phase m) ndarray
    """
    phases, bodies, size, _ = maps.shape
    columns = inputs.shape[2]
    result = np.empty((bodies, size, phases * columns))
    for first in range(0, bodies, _CHUNK):
        part = slice(first, first + _CHUNK)
        system = np.tile(np.eye(phases * size), (len(inputs[part]), 1, 1))
        given = np.zeros((len(system), phases * size, phases * columns))
        for phase, matrices in enumerate(maps[:, part]):
            rows = slice(phase * size, (phase + 1) * size)
            last = (phase - 1) % phases
            system[:, rows, last * size : (last + 1) * size] -= matrices
            given[:, rows, last * columns : (last + 1) * columns] = matrices @ inputs[part]
        solved = np.linalg.solve(system, given)
        result[part] = solved.reshape(len(system), phases, size, -1).mean(axis=1)
    return result


def _increment(plan: Plan) -> np.ndarray:
    """Velocity that a unit force of a kick gives each body, (body, 1) (m s-1 N-1)."""
    increment: np.ndarray = plan.clock.step / plan.system.linear[0][:, None]
    return increment


def _closed_flow(plan: Plan) -> np.ndarray:
    """Bodies between whose kicks there is nothing but white noise, nor for the others of a group."""
    result = np.ones(len(plan.system.bodies), dtype=bool)
    result[[lines.body for lines in plan.driving.lines]] = False
    result[plan.driving.forced] = False
    for group in plan.method.groups:
        result[group.slots] = result[group.slots].all()
    return result
