"""From sums to the moments that statistics are formed of, at the right time of the step."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impactlab.integrators.kicks import kick_share
from impactlab.kernels.rows import BEGUN, FF, FLUX, FV, FX, INTENSITY, TURN, VV, XV, XX, F, V, X
from impactlab.plan.plan import Plan
from impactlab.results.schema import BODY, CONTACT, OF_STATES, Moments, OfBodies, sampled_of
from impactlab.statistics.chain import Chain, Rows, cycle, mean_load, rows_where, weighted_sum
from impactlab.statistics.joint_moments import joint_moments

AT_ONCE = 1 << 15
"""Bodies times units whose moments are formed at a time: what is made on the way is twenty times what comes out, which
for a large network is memory that nobody has touched before, and takes longer than the arithmetic.
"""

SumsOf = Callable[[slice], np.ndarray]
"""Gives sums of chosen bodies over the steps of each phase, (phase, row, body, unit); see `impactlab.kernels.sums`."""


class Motion(NamedTuple):
    """Moments of bodies: row 0 for displacements, row 1 for velocities."""

    mean: np.ndarray  # (2, body, unit)
    square: np.ndarray  # (2, body, unit)
    load: np.ndarray  # (body, unit) correction of the mean square displacement in the variance

    def rewrite(self, bodies: np.ndarray, motion: Motion, sure: np.ndarray) -> None:
        """Write the moments of some bodies, in units where they are sure."""
        for target, values in zip(self, motion, strict=True):
            target[..., bodies, :] = np.where(sure, values, target[..., bodies, :])


class Moved(NamedTuple):
    """The linear motion of bodies between kicks, and the forces that act there."""

    chain: Chain
    intensity: np.ndarray  # (body,) of the white noise that the flows are made with
    closed: np.ndarray  # (body,) of bool: whether nothing but white noise acts between kicks
    steady: np.ndarray  # and whether no function of time leads a body

    @classmethod
    def of(cls, plan: Plan) -> Moved:
        """Return the motion of all bodies of a plan."""
        assert plan.method.flows is not None
        mass, damping, stiffness = plan.system.linear
        chain = Chain(plan.clock.step, mass, damping, stiffness, plan.method.flows, ~plan.method.grouped)
        closed, intensity = plan.driving.closed(plan.method.groups), np.zeros(len(plan.system.bodies))
        intensity[plan.noise.white] = plan.noise.intensity
        # a function of time moves a body or one that it is connected to, so that its energy at both ends of a run
        # differs by more than chance: its balances are not 0 on average
        varying = plan.noise.white if plan.noise.time_varying else plan.noise.white[:0]
        led = np.concatenate([plan.driving.forced, varying, np.flatnonzero(plan.forces.timed)])
        parts = plan.system.links.parts
        return cls(chain, intensity, closed, closed & ~np.isin(parts, parts[led]) if len(led) else closed)

    def part(self, rows: slice) -> Moved:
        """Return the motion of the chosen bodies."""
        return Moved(self.chain.part(rows), self.intensity[rows], self.closed[rows], self.steady[rows])


Formed = tuple[Motion, dict[str, np.ndarray], np.ndarray]
"""Moments and balances of bodies, and sums of the sampled functions, (row, body, unit)."""


def moments_of(
    plan: Plan, sums: SumsOf, counts: np.ndarray, contacts: np.ndarray, products: np.ndarray, laws: np.ndarray
) -> Moments:
    """Turn sums into moments, (body, contact or state, unit) each.

    `counts` says over how many steps of each phase sums are, (phase, unit). Sums of contacts, products and laws are
    (row, contact, pair or state, unit).
    """
    steps, number = counts.sum(axis=0), len(plan.system.bodies)
    moved, of_pairs = None if plan.method.flows is None else Moved.of(plan), products / steps
    most = number if plan.method.groups else max(1, AT_ONCE // len(steps))  # groups are not cut
    if most >= number:
        motion, balances, samples = _of_bodies(plan, moved, sums(slice(None)), counts, of_pairs)
    else:
        parts = [slice(begin, begin + most) for begin in range(0, number, most)]
        motion, balances, samples = _joined(
            [_of_bodies(plan, moved.part(rows) if moved else None, sums(rows), counts, of_pairs) for rows in parts]
        )
    mass, damping, stiffness = np.broadcast_to(plan.system.linear[..., None], (3, *motion.load.shape))
    variance = np.maximum(motion.square[0] + motion.load - motion.mean[0] ** 2, 0.0)
    (x, v), (xx, vv) = motion.mean, motion.square
    flux = contacts[FLUX] / steps
    rate = flux / plan.clock.step if plan.observed.counted else 9.0 / 8.0 * flux / plan.observed.window[:, None]
    of_bodies, of_contacts = sampled_of(BODY), sampled_of(CONTACT)
    pairs = [*zip(of_bodies, samples, strict=True), *zip(of_contacts, contacts[FLUX + 1 :], strict=True)]
    others = {item.name: row if item.largest else row / steps for item, row in pairs}
    others["peak_contact_force"][plan.events.impulsive] = np.nan  # an impulse has no force
    if len(plan.forces.states):
        of_time = np.array([1.0, 1.0, plan.clock.step])[:, None, None] * steps
        others |= dict(zip(OF_STATES, laws[:3] / of_time, strict=True))
    bodies = OfBodies(mass, damping, stiffness, x, xx, variance, v, vv, motion.load)
    return Moments(bodies, {"contact_rate": rate, **others}, balances)


def _joined(parts: list[Formed]) -> Formed:
    """Join moments that were computed for one slice of the bodies at a time."""
    motions, balances, samples = zip(*parts, strict=True)
    motion = Motion(*(np.concatenate(items, axis=-2) for items in zip(*motions, strict=True)))
    both = {name: np.concatenate([item[name] for item in balances]) for name in balances[0]}
    return motion, both, np.concatenate(samples, axis=-2)


def _of_bodies(plan: Plan, moved: Moved | None, sums: np.ndarray, counts: np.ndarray, products: np.ndarray) -> Formed:
    """Return the moments of bodies from their sums and from the means of products of all pairs."""
    seen, samples = counts > 0, sums[:, sums.shape[1] - len(sampled_of(BODY)) :].sum(axis=0)
    means = sums[:, :BEGUN] / np.where(seen, counts, 1)[:, None, None]
    if plan.transient:
        bodies = sums[:, :BEGUN].sum(axis=0) / counts.sum(axis=0)
    else:
        bodies = means.sum(axis=0) / seen.sum(axis=0)  # sums over no steps are 0
    at_kicks = Motion(bodies[[X, V]], bodies[[XX, VV]], np.zeros_like(bodies[X]))
    if moved is None:
        return at_kicks, {}, samples
    complete = seen.all(axis=0)
    if not complete.all():
        means[..., ~complete] = np.nan
    chain, intensity, closed, steady = moved
    response = chain.response()
    balances, mixed = balances_of(chain, intensity, means, steady, response[1])
    begun = sums[:, BEGUN:] / counts.sum(axis=0) if plan.transient else None
    if begun is not None:
        motion = _over_time(chain, bodies, begun, at_kicks, closed)
    else:
        off = [balances["mean_square_displacement"], mixed, balances["mean_square_velocity"]]
        known = [np.where(np.isfinite(item), item, 0.0) for item in off] if plan.observed.sampled else None
        motion = _over_steps(chain, means, at_kicks, closed, response, known)
    if not closed.all():
        _open_flow(chain, bodies, motion, ~closed)
    for group in plan.method.groups:
        if closed[group.slots].all():
            after = None if begun is None else begun.sum(axis=0)[:, group.slots]
            of_pairs = products[:, np.isin(plan.method.pairs[:, 0], group.slots)]
            joint, off_balance = joint_moments(group, chain.step, bodies[:, group.slots], of_pairs, after)
            motion.rewrite(group.slots, Motion(*joint), np.asarray(complete | plan.transient))
            for name, values in off_balance.items():
                known = complete & steady[group.slots].all()
                balances[name][group.slots] = np.where(known, values, balances[name][group.slots])
    return motion, balances, samples


def _over_steps(
    chain: Chain, s: np.ndarray, at_kicks: Motion, closed: np.ndarray, response: tuple[np.ndarray, np.ndarray],
    off: list[np.ndarray] | None,
) -> Motion:  # fmt: skip
    """Moments over the time of a step, without the second-order error of moments at the kick.

    Means are shifted by the difference between the mean at the kicks and the mean over time under the
    mean force F, which is F/k for the displacement. Mean squares are (kick + 2 middle of the
    flow)/3, Simpson's rule; the moments in the middle of a flow follow exactly from the moments after the
    kick before; see also `mean_load`.
    Only the flow of white noise is closed in this way; other bodies keep the moments at the kick
    for `_open_flow`, and those in groups are left to `joint_moments`. Where states are
    samples, what their second moments (of x², x v and v²) are `off` the balances is no part of the
    difference between kick and middle.
    """
    x, v, xx, xv, vv = (np.roll(item, 1, axis=0) for item in _after_kicks(chain, s))  # after the kick before
    if off is not None:
        xx, xv, vv = (item - one for item, one in zip((xx, xv, vv), off, strict=True))
    closed = (closed & chain.alone)[:, None] & np.isfinite(s).all(axis=(0, 1))
    over_time, of_kicks = response
    mean, square = np.empty((2, *at_kicks.mean.shape))
    at_kick = at_kicks.square[0], _slowed(chain, s, at_kicks.square[1])
    for row in range(2):
        shift = over_time[:, row, None] * s[:, F].mean(axis=0) - weighted_sum(of_kicks[:, row].T, s[:, F])
        mean[row] = at_kicks.mean[row] + np.where(closed & np.isfinite(shift), shift, 0.0)
        middle = _square_in_middle(chain, row, xx, xv, vv).mean(axis=0)
        over_step = middle if off is None else middle + off[2 * row]
        square[row] = np.where(closed, (at_kick[row] + 2.0 * over_step) / 3.0, at_kick[row])
    if chain.forgotten.any():
        square[1] = square[1] - np.where(closed, _sawtooth(chain, s), 0.0)
    loads = mean_load(mean[0], at_kicks.mean[0], _mean_in_middle(chain, x, v).mean(axis=0))
    return Motion(mean, square, np.where(closed, loads, 0.0))


def _over_time(chain: Chain, s: np.ndarray, begun: np.ndarray, at_kicks: Motion, closed: np.ndarray) -> Motion:
    """Moments over the time of a transient by Simpson's rule, (kick + 2 middle of the flow)/3.

    Moments in the middle of a flow follow from moments after the kick that begins it, phase by phase. The mean
    velocity is the distance from start to end over the duration.
    """
    x, v, xx, xv, vv = _after_kicks(chain, begun)
    intensity = begun[:, INTENSITY - BEGUN]
    closed = (closed & chain.alone)[:, None]
    own = _slowed(chain, s[None], at_kicks.square[1])
    at_kick = at_kicks.square[0], np.where(chain.forgotten[:, None], own, at_kicks.square[1])
    square = np.empty_like(at_kicks.square)
    for row in range(2):
        middle = _square_in_middle(chain, row, xx, xv, vv, intensity).sum(axis=0)
        square[row] = (at_kick[row] + 2.0 * middle) / 3.0
    if chain.forgotten.any():
        square[1] -= _sawtooth(chain, s[None])
    middle = _mean_in_middle(chain, x, v).sum(axis=0)
    mean = (at_kicks.mean[0] + 2.0 * middle) / 3.0
    load = mean_load(mean, at_kicks.mean[0], middle)
    # half of the states at both ends are in the others
    way = 2.0 / chain.step * (at_kicks.mean[0] - begun[:, X].sum(axis=0))
    return Motion(
        np.stack([np.where(closed, mean, at_kicks.mean[0]), way]),
        np.where(closed, square, at_kick),
        np.where(closed, load, 0.0),
    )


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


def _after_kicks(chain: Chain, s: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the means of x, v, x², x v and v² after kicks from those in their middle, (phase, body, unit) each."""
    increment = chain.increment
    v = s[:, V] + 0.5 * increment * s[:, F]
    xv = s[:, XV] + 0.5 * increment * s[:, FX]
    return s[:, X], v, s[:, XX], xv, s[:, VV] + increment * s[:, FV] + 0.25 * increment**2 * s[:, FF]


def _mean_in_middle(chain: Chain, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return mean displacements in the middle of flows that begin with some means, (phase, body, unit)."""
    a = chain.flows.middle_transition
    return np.asarray(a[:, :, 0, 0, None] * x + a[:, :, 0, 1, None] * v)


def _square_in_middle(
    chain: Chain, row: int, xx: np.ndarray, xv: np.ndarray, vv: np.ndarray, intensity: np.ndarray | None = None
) -> np.ndarray:
    """Return the mean square of x (row 0) or v (1) in the middle of flows that begin with some moments.

    The white noise in the flows has an intensity relative to that which they are made with, (phase, body, unit).
    """
    a, noise = chain.flows.middle_transition, chain.flows.middle_covariance[:, :, row, row, None]
    of_x, of_v = a[:, :, row, 0, None], a[:, :, row, 1, None]
    noise = noise if intensity is None else noise * intensity
    return np.asarray(of_x**2 * xx + 2.0 * of_x * of_v * xv + of_v**2 * vv + noise)


def _open_flow(chain: Chain, s: np.ndarray, motion: Motion, rows: np.ndarray) -> None:
    """Write the moments of bodies that cosines or given forces push: their state in the middle of a flow is not known.

    The mean displacement over a step under the force f of the kick is the mean of ``y = x + h² f/12m``. Where no time
    is ahead of another, Simpson's rule adds ``(h/m)² E[f F]/6`` to the mean square of the velocity, F being all forces
    on the body: what the flow adds between two kicks in the place of a part of the force counts as a force.
    So a load that others balance, static or slow, adds nothing.
    """
    s, increment = s[:, rows], chain.increment[rows]
    shift = chain.step / 12.0 * increment
    motion.mean[0, rows] = s[X] + shift * s[F]
    motion.square[0, rows] = s[XX] + 2.0 * shift * s[FX] + shift**2 * s[FF]
    motion.square[1, rows] = s[VV] + increment / 6.0 * (increment * s[FF] + s[TURN])


def _slowed(chain: Chain, s: np.ndarray, at_kicks: np.ndarray) -> np.ndarray:
    """Mean square velocities, corrected for friction that slows bodies within a step, (body, unit)."""
    share = kick_share(chain.damping / chain.mass * chain.step)
    slowed = share < 0.5
    if not slowed.any():
        return at_kicks
    share, increment = share[slowed, None], chain.increment[slowed]
    vv, fv, ff = (s[:, row, slowed].mean(axis=0) for row in (VV, FV, FF))
    result, own = at_kicks.copy(), vv + increment * (2.0 * share - 1.0) * (fv - 0.5 * increment * ff)
    own += increment**2 * (share**2 - 0.25) * ff
    result[slowed] = np.where(np.isfinite(own), own, at_kicks[slowed])  # units without a step of each phase
    return result


def _sawtooth(chain: Chain, s: np.ndarray) -> np.ndarray:
    """Return the excess in mean square velocities where friction acts faster than a step, (body, unit).

    A time τ after a kick by F the body moves at A F/c instead of F/c, ``A = g e^(−γτ)/(1 − e^(−g))``, g = γh. Where a
    step is as long as 1/γ it is the displacement that is resolved, which is slow beside friction. Then the noise n of
    the velocity has E[n F] = (T/c) E[F'] with the force of its own time, and ``C = g e^(−2γτ)/(1 − e^(−2g))`` of that
    with what kicks have left of it. With T E[F'] = −E[F² − k x F], of one temperature, the mean square is
    ``((A² − 2C) E[F²] + (2C − 2A + 1) k E[x F])/c²`` too large, in the middle of the flow and at the time of the
    kick, which counts by its `kick_share`.
    """
    slow, result = chain.forgotten, np.zeros(s.shape[2:])
    g = (chain.damping / chain.mass * chain.step)[slow, None]
    with np.errstate(over="ignore"):
        moved = np.stack([np.ones_like(g), 0.5 * g / np.sinh(0.5 * g)])
        seen = np.stack([kick_share(g) * g + g / np.expm1(2.0 * g), 0.5 * g / np.sinh(g)])
    of_squares, of_places = (
        (at_kick + 2.0 * at_middle) / 3.0 for at_kick, at_middle in (moved**2 - 2.0 * seen, 2.0 * (seen - moved) + 1.0)
    )
    ff, fx = (s[:, row, slow].mean(axis=0) for row in (FF, FX))
    result[slow] = (of_squares * ff + of_places * chain.stiffness[slow, None] * fx) / chain.damping[slow, None] ** 2
    return result
