"""How long a network takes to forget its start: damping, collisions with what is damped, barriers between wells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.evaluation import call_each
from impactlab.components.oscillator import Oscillator
from impactlab.errors import warn
from impactlab.linear.damping import damped
from impactlab.linear.decay import periodic, relaxation_time
from impactlab.linear.laws import coupled_systems, flexibility, hottest, linear_variances
from impactlab.step_control.rules.tangent_stiffness import Stiffening

LEAST_BARRIER = 2.0
"""Height of a barrier, in units of the temperature, from which on it is waited for."""

SAME = 1e-6
"""Relative difference of temperatures below which they are the same."""

SAME_DEPTH = 3e-3
"""Difference of the depths of two wells, in units of the temperature, below which they are the same."""

MOST_ATTEMPTS = 2.5
"""Logarithm of the draws of a start that are needed, on average, beyond which some of a hundred will not do."""

ITERATIONS = 12
"""Number of times that temperatures are estimated from the temperatures before."""

DENSE = 50
"""Bodies of a part up to which its equations are solved as a full matrix."""

SETTLING_TIMES = 6.0
"""Length of the spin-up in units of the time in which temperatures settle."""

MOST_SPIN_UP = 4.0
"""Longest automatic spin-up, in lengths of the run and its usual spin-up: a longer one is left to the user."""

WELLS_WITHIN = 40.0
"""Displacement up to which wells of a body are looked for, in lengths over which its potential changes by T."""

WELL_POINTS = 4001
"""Points at which wells are looked for."""


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Times after which a network has forgotten its start."""

    linear: float  # of the slowest damped motion (s); 0 if nothing is damped
    slowest: float  # the longest of all (s): samples further apart are independent
    settling: float
    """The longest of what the start does not know (s): energies of bodies that only collisions heat, where temperatures
    differ or the start is at rest, the share of wells of different depth, and energies near parametric instability
    that other forces may limit. 0 if there is none.
    """
    reason: str  # what takes the longest of these, as a message says it
    temperature: np.ndarray  # (body,) of those that nothing but contacts and couplings heats (J), NaN for others

    @classmethod
    def of(cls, model: Model, stiffening: Stiffening) -> Relaxation:
        """Estimate the times of a network where its bodies have the energies of `stiffening`."""
        linear = relaxation_time(damped(model)[1])
        temperature, exchange, unequal, coldest = _exchange(model, stiffening)
        hop, uneven, trapped = _hopping(model) if model.bodies.residual.any() else (0.0, False, -1)
        settling, reason = 0.0, ""
        if unequal and exchange > settling:
            settling = exchange
            reason = f"{model.bodies.names[coldest]!r} gets its energy from collisions alone, in about {exchange:.2g} s"
        if uneven and hop > settling:
            settling = hop
            reason = f"{model.bodies.names[trapped]!r} changes between wells of different depth every {hop:.2g} s or so"
        varying = periodic(model) if model.kicks.timed.any() else []
        slow = max(varying, key=lambda motion: motion.relaxation, default=None)
        pumped = 0.0 if slow is None else slow.relaxation
        if slow is not None and 0.5 * pumped > settling and not slow.alone:  # energies relax twice as fast as motions
            settling = 0.5 * pumped
            reason = (
                f"{model.bodies.names[slow.slots[0]]!r} is near parametric instability and relaxes in about "
                f"{pumped:.2g} s"
            )
        slowest = max(linear, _rounded(exchange), _rounded(hop), pumped)
        return cls(linear, slowest, _rounded(settling), reason, temperature)


def spin_up_of(relaxation: Relaxation, usual: float, duration: float) -> float:
    """Return the automatic spin-up (s): the usual one, or a longer one that lets everything settle.

    Where the longer one would take `MOST_SPIN_UP` times as long as all else, there is a warning instead.
    """
    needed = SETTLING_TIMES * relaxation.settling
    if needed <= usual:
        return usual
    if needed <= MOST_SPIN_UP * (usual + duration):
        return needed
    warn(
        "short_spin_up",
        f"The automatic spin-up of {usual:.3g} s may be too short, since {relaxation.reason}. "
        f"Give spin_up={needed:.2g} or more.",
    )
    return usual


def growth_of(model: Model) -> str:
    """Say which motion grows without end, since its springs vary and nothing that is not linear limits it; or ""."""
    growing = [motion for motion in periodic(model) if motion.alone and motion.unstable]
    if not growing:
        return ""
    motion = max(growing, key=lambda item: item.multiplier)
    return (
        f"The motion of {model.bodies.names[motion.slots[0]]!r} grows without end: its varying stiffness multiplies "
        f"it by {motion.multiplier:.6g} in each period of {motion.period:.4g} s"
    )


def warn_of_unknown_damping(model: Model, spin_up: float) -> None:
    """Warn of bodies under white noise that only laws of contacts or couplings damp, at a rate that is not known."""
    heated, by_laws = without_dampers(model)
    unknown = np.flatnonzero(heated & by_laws)
    if unknown.size:
        warn(
            "short_spin_up",
            f"{model.bodies.names[unknown[0]]!r} is excited and damped by contacts or couplings only, at an unknown "
            f"rate: the automatic spin-up of {spin_up:.3g} s may be too short. Give spin_up= (s).",
        )


def correlation_of_neighbours(times: Any) -> Any:
    """Return the correlation of the means over two stretches, one after the other, each of so many relaxation times.

    Of what is correlated by ``exp(−t)`` it is ``(1 − e^(−a))²/2(a − 1 + e^(−a))`` for a length a.
    """
    return np.expm1(-times) ** 2 / (2.0 * (times + np.expm1(-times)))


def _rounded(value: float) -> float:
    """Round an estimate to three digits, since the last ones depend on the processor."""
    return float(f"{value:.3g}")


@kept
def _exchange(model: Model, stiffening: Stiffening) -> tuple[np.ndarray, float, bool, int]:
    """Estimate the temperatures of cold bodies, and how long they take to get there.

    Two bodies that collide exchange ``4 m₁m₂/(m₁ + m₂)²`` of the difference of their temperatures on average, as
    often as their gap closes by Rice's formula; a damped body gives ``c/m`` of its temperature away in a second. In the
    stationary state what comes equals what goes.

    Returns temperatures (J), the time of the slowest exchange with cold bodies (s), whether temperatures differ in a
    part that has some or its start is at rest, and the slot of the cold body whose temperature changes slowest.
    """
    result = np.full(len(model.bodies), np.nan)
    # whether nothing but contacts and couplings can heat or damp each body
    cold = (damped(model)[0].damping == 0.0) & ~model.bodies.excited
    for slots, system in coupled_systems(model):
        cold[slots] = not system.damping.any() and not model.bodies.excited[slots].any()
    own = model.mass * linear_variances(damped(model)[0])[1]
    labels = model.connected
    parts = np.intersect1d(labels[cold], labels[np.isfinite(own) & (own > 0.0)])
    if not parts.size:
        return result, 0.0, False, -1
    own = np.where(cold, 0.0, own)
    loss = damped(model)[0].damping / model.mass
    crowded = _crowded(model, labels, own)
    members = np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:-1])
    bathed = {int(part): own[members[part][~cold[members[part]]]] for part in parts}
    bathed = {part: theirs for part, theirs in bathed.items() if np.isfinite(theirs).all()}
    differ = {part: bool(np.ptp(theirs) > SAME * theirs.max()) for part, theirs in bathed.items()}
    for part, theirs in bathed.items():
        result[members[part]] = np.where(cold[members[part]], theirs.max(), own[members[part]])
    exchanges = model.links.exchanges(model.mass)
    of_pair = labels[exchanges.first]
    order = np.argsort(of_pair, kind="stable")
    ends = np.searchsorted(of_pair[order], np.arange(len(members) + 1))
    longest, slowest = 0.0, -1
    for round_ in range(ITERATIONS if any(differ.values()) else 1):  # how often bodies collide depends on these
        conductance = exchanges.share * _meetings(model, stiffening, result)[exchanges.rows]
        conductance = np.where(np.isfinite(conductance), conductance, 0.0)
        for part, theirs in bathed.items():
            if round_ and not differ[part]:
                continue
            slots, pairs = members[part], order[ends[part] : ends[part + 1]]
            first, second = (np.searchsorted(slots, side[pairs]) for side in (exchanges.first, exchanges.second))
            temperatures, time, place = _settled(first, second, conductance[pairs], loss[slots], own[slots])
            if differ[part]:
                result[slots] = [_rounded(max(item, theirs.min())) for item in temperatures.tolist()]
            if time > longest:
                longest, slowest = time, int(slots[place])
    unequal = any(different or bool(crowded[part]) for part, different in differ.items())
    return np.where(cold, result, np.nan), longest, unequal, slowest


def _crowded(model: Model, labels: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Whether a draw from the law without contacts hardly ever finds all contacts of a part open, (part,) of bool.

    Then the start is at rest.
    """
    variance = hottest(model, np.where(np.isfinite(own), own, 0.0)) * flexibility(model)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = model.clearance / np.sqrt(2.0 * model.ends.squares(variance))
    open_ = np.array([0.5 * math.erfc(-item) for item in np.where(np.isnan(reach), 0.0, reach).tolist()])
    attempts = np.zeros(labels.max() + 1)
    np.add.at(attempts, labels[model.first_of(model.ends)], -np.log(np.maximum(open_, 1e-300)))
    return np.asarray(attempts > MOST_ATTEMPTS)


def closing_rates(model: Model, stiffening: Stiffening) -> np.ndarray:
    """Return how often each contact closes by Rice's formula if its bodies have the highest temperature (s-1).

    The rate is infinite where it is not known: where nothing holds a body, where a residual force or a coupling may
    push it to the contact, or for a contact in a plane.
    """
    warmth, pushed = model.ends.largest(stiffening.energy), np.append(model.bodies.residual, False)
    pushed[model.ends.chosen(model.clearance < 0.0).slots] = True
    pushed[model.coupled.slots] = True
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if any(kind.joining for kind in model.sources.values()):
            warmth = warmth * _together(model)
        variance = warmth * model.ends.squares(flexibility(model))
        velocity = np.sqrt(warmth * model.ends.squares(1.0 / model.mass))
        rate = _rice(velocity, variance, np.maximum(model.clearance, 0.0))
    return np.where(model.ends.any(pushed[:-1]) | model.contacts.round | ~np.isfinite(variance), np.inf, rate)


def _together(model: Model) -> np.ndarray:
    """Return how many bodies of each contact are moved by sources that drive several, which adds so much, (contact,).

    The mean square of a sum of n terms is n times the sum of theirs at most; it is that sum where none is correlated.
    """
    common = np.zeros(model.wall + 1)
    for kind in model.sources.values():
        for slots in kind.joining:
            common[slots] = 1.0
    ends = model.ends
    return np.maximum(np.bincount(ends.rows, common[ends.slots], len(ends)), 1.0)


def _rice(velocity: np.ndarray, variance: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Return how often a Gaussian motion with some root mean square velocity crosses levels upwards (s-1)."""
    return np.asarray(velocity / (2.0 * np.pi * np.sqrt(variance)) * np.exp(-0.5 * level**2 / variance))


def _meetings(model: Model, stiffening: Stiffening, temperature: np.ndarray) -> np.ndarray:
    """Return how often bodies meet along each link at some temperatures, (link,) (s-1)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = np.sqrt(model.ends.squares(temperature / model.mass))
        variance = model.ends.squares(temperature * flexibility(model))
        apart = np.maximum(model.clearance, 0.0)
        bound = _rice(velocity, variance, apart)
        free = velocity / (apart + stiffening.penetration) / math.sqrt(2.0 * math.pi)  # these fly to and fro
        springs = np.sqrt(stiffening.couplings * model.coupled.squares(1.0 / model.mass)) / (2.0 * np.pi)
    return np.concatenate([np.where(np.isfinite(variance), bound, free), springs])


def _settled(
    first: np.ndarray, second: np.ndarray, between: np.ndarray, loss: np.ndarray, own: np.ndarray
) -> tuple[np.ndarray, float, int]:
    """Return the stationary temperatures of one part, the time in which its slowest energy relaxes, and whose it is."""
    count = len(own)
    diagonal = loss + np.bincount(first, between, count) + np.bincount(second, between, count)
    floor = 1e-12 * diagonal.max()  # a body that nothing reaches
    heat = loss * own
    if count <= DENSE:
        matrix = np.diag(diagonal + floor)
        np.add.at(matrix, (np.append(first, second), np.append(second, first)), -np.append(between, between))
        temperatures, (rates, shapes) = np.linalg.solve(matrix, heat), np.linalg.eigh(matrix)
    else:
        from scipy.sparse import coo_array, diags_array  # loaded only for large networks
        from scipy.sparse.linalg import eigsh, splu

        places = np.append(first, second), np.append(second, first)
        sparse = diags_array(diagonal + floor) - coo_array((np.append(between, between), places), shape=(count, count))
        temperatures = splu(sparse.tocsc()).solve(heat)
        rates, shapes = eigsh(sparse.tocsc(), k=1, sigma=0.0, v0=np.ones(count))
    slowest = int(np.abs(shapes[:, 0]).argmax())
    return np.asarray(temperatures), 1.0 / max(float(rates[0]) - floor, floor), slowest


@kept
def _hopping(model: Model) -> tuple[float, bool, int]:
    """Return the longest time between changes of wells (s), whether its wells differ in depth, and the body."""
    longest, uneven, trapped = 0.0, False, -1
    temperature = model.mass * linear_variances(damped(model)[0])[1]
    touched = model.links.numbers() > 0
    seen: dict[tuple[Oscillator, float], tuple[float, bool]] = {}
    for slot in np.flatnonzero(model.bodies.residual):
        body = model.network.oscillators[model.bodies.names[slot]]
        energy = float(temperature[slot])
        if not 0.0 < energy < math.inf:
            continue
        if (body, energy) not in seen:
            friction = float(damped(model)[0].damping[slot] / model.mass[slot])
            seen[body, energy] = _between_wells(body, energy, friction)
        time, differ = seen[body, energy]
        if time > longest:
            longest, trapped = time, int(slot)
        uneven |= time > 0.0 and (differ or bool(touched[slot]))
    return longest, uneven, trapped


def _between_wells(body: Oscillator, temperature: float, friction: float) -> tuple[float, bool]:
    """Return the mean time until a body alone leaves the shallower of two wells (s), and whether their depths differ.

    The time is 0 where there is no barrier of `LEAST_BARRIER` temperatures. The rate is the smaller of Kramers' rates
    for strong and for weak friction (Hänggi, Talkner and Borkovec, Rev. Mod. Phys. 62, 1990, 251).
    """
    scale = _scale(body, temperature)
    x = np.linspace(-WELLS_WITHIN * scale, WELLS_WITHIN * scale, WELL_POINTS)
    with np.errstate(all="ignore"):
        force = body.stiffness * x + call_each([body], "residual", x[None], np.zeros((1, WELL_POINTS)))[0]
    force = np.where(np.isfinite(force), force, np.sign(x) * 1e300)
    energy = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(x))])
    wells = 1 + np.flatnonzero((force[1:-1] <= 0.0) & (force[2:] > 0.0))
    if len(wells) < 2:
        return 0.0, False
    slope = np.gradient(force, x)
    energy[wells] -= 0.5 * force[wells] ** 2 / np.maximum(slope[wells], 1e-300)  # at the bottom, between two points
    longest, differ = 0.0, False
    for left, right in pairwise(wells):
        top = left + int(energy[left : right + 1].argmax())
        shallow = left if energy[left] > energy[right] else right
        height = float(energy[top] - energy[shallow]) / temperature
        if height < LEAST_BARRIER:
            continue
        of_well, of_top = (math.sqrt(max(abs(float(slope[place])), 1e-300) / body.mass) for place in (shallow, top))
        attempts = of_well / (2.0 * math.pi)
        strong = math.hypot(0.5 * friction / of_top, 1.0) - 0.5 * friction / of_top
        weak = friction * height * 2.0 * math.pi / of_well  # action of the orbit at the top, about that of the well
        time = math.exp(min(height, 700.0)) / (attempts * min(strong, weak))
        longest = max(longest, time)
        differ |= abs(float(energy[left] - energy[right])) > SAME_DEPTH * temperature
    return longest, differ


def _scale(body: Oscillator, temperature: float) -> float:
    """Return a length over which the potential of a body changes by about its temperature (m)."""
    lengths = 10.0 ** np.arange(-12.0, 9.0, 0.05)
    x = np.stack([lengths, -lengths])
    with np.errstate(all="ignore"):
        force = body.stiffness * x + call_each([body] * 2, "residual", x, np.zeros_like(x))
    work = np.cumsum(np.abs(np.where(np.isfinite(force), force, np.inf)) * np.gradient(lengths), axis=1).max(axis=0)
    return float(lengths[min(int(np.searchsorted(work, temperature)), len(lengths) - 1)])


def undamped(model: Model) -> np.ndarray:
    """Whether white noise heats each body for ever, since nothing in its part takes energy, (body,) of bool."""
    heated, by_laws = without_dampers(model)
    return np.asarray(heated & ~by_laws)


def without_dampers(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Whether white noise heats each body and no damper of its part takes the energy; whether laws may, (body,) each.

    They may where the force of a contact or a coupling depends on the rate or on states.
    """
    linear, labels = damped(model)[0], model.connected
    hot = np.isinf(linear_variances(linear)[1])
    if not hot.any():
        return hot, hot
    of_contacts = ["rate" in law.kernel("force")[1] or bool(law.state_names()) for law in model.contacts.laws]
    of_laws = np.flatnonzero([*of_contacts, *(law.dissipative for law in model.couplings.laws)])
    heated = hot & ~np.isin(labels, labels[linear.damping > 0.0])
    return heated, np.isin(labels, labels[model.first_of(model.links)[of_laws]])
