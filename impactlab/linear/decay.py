"""How fast linear motion decays or grows; on springs that vary periodically, by Floquet's theory."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.component import Component
from impactlab.components.evaluation import TIME, UPDATE, call_each
from impactlab.errors import InvalidInput
from impactlab.linear.laws import coupled_systems, joined_systems
from impactlab.linear.systems import LinearSystem

NEUTRAL = 1e-6
"""Logarithm of a multiplier up to which a motion neither decays nor grows: rounding makes 1e-8 of two that are 1."""

STEPS_PER_RADIAN, STEPS_PER_PERIOD, MOST_NUMBERS = 40.0, 256, 1 << 21
"""Steps of the fastest motion and of the shortest period of a spring, whose fourth order leaves an error of 1e-9 in a
radian; and numbers in the matrices of all steps beyond which nothing is computed."""

MOST_PERIODS, SAME = 1000, 1e-9
"""Periods of a spring in a common period, at most; relative difference below which forces, or periods, are the same."""

_SIZES = np.concatenate([np.logspace(-6.0, 3.0, 10), -np.logspace(-6.0, 3.0, 10)])
_TIMES = np.array([0.0, 0.17, 0.61, 1.37, 2.83, 7.41])  # of no common period


@dataclass(frozen=True, eq=False)
class Spring:
    """A linear force of a law that varies periodically."""

    law: Component
    kernel: str
    slots: np.ndarray  # of the bodies on which it acts, in increasing order
    pattern: np.ndarray  # its matrix at a unit stiffness, (slot, slot)
    period: float  # (s)


@dataclass(frozen=True, eq=False)
class PeriodicMotion:
    """Motion of bodies on linear springs, at least one of them periodic in time."""

    slots: np.ndarray  # of the bodies
    period: float  # common to all springs (s)
    multiplier: float  # factor by which the motion that grows fastest, or decays slowest, changes in a period
    relaxation: float  # of the slowest motion that decays (s); 0 if it is no slower than without the springs
    alone: bool  # whether all forces between and on the bodies are linear

    @property
    def unstable(self) -> bool:
        """Whether small motions grow."""
        return self.multiplier > 1.0 + NEUTRAL


@kept
def relaxation_time(model: Model) -> float:
    """Return the relaxation time of the slowest damped motion, or filter of noise (s); 0 if nothing is damped."""
    systems = coupled_systems(model)
    damped = model.damping > 0.0
    for slots, _ in systems:
        damped[slots] = False
    c, k, m = (values[damped] for values in (model.damping, model.stiffness, model.mass))
    root = np.sqrt(np.maximum(c**2 - 4.0 * k * m, 0.0))
    slow = np.where(k > 0.0, 2.0 * k / (c + root), c / m)  # overdamped: the smaller root
    processes = [item.rates(model) for item in model.mechanisms]
    rates = np.concatenate(
        [np.where(c**2 < 4.0 * k * m, 0.5 * c / m, slow), *(item.rates for _, item in systems), *processes]
    )
    constant = float(1.0 / rates[rates > 0.0].min()) if rates.any() else 0.0
    return max([constant, *(motion.relaxation for motion in periodic(model) if motion.alone)])


@kept
def periodic(model: Model) -> tuple[PeriodicMotion, ...]:
    """Return the motions of bodies on linear springs that vary, where a common period is known."""
    springs = _springs(model) if model.kicks.timed.any() else []
    if not springs:
        return ()
    systems = joined_systems(model, coupled_systems(model), [spring.slots for spring in springs])
    return _motions(model, springs, systems)


def _springs(model: Model) -> list[Spring]:
    """Return the residual forces and couplings that are linear and vary periodically."""
    result = []
    for slot in np.flatnonzero(model.bodies.residual & model.kicks.timed):
        law = model.bodies.oscillators[slot]
        if period := _period(law, "residual"):
            result.append(Spring(law, "residual", np.array([slot]), np.ones((1, 1)), period))
    for row, link in enumerate(model.couplings.laws):
        if TIME in link.kernel("force")[1] and (period := _period(link, "force")):
            along = model.coupled.chosen(np.array([row])).held(~model.bodies.free)
            slots = along.coordinates()
            if slots.size:
                result.append(Spring(link, "force", slots, along.springs(np.ones(1), slots), period))
    return result


def _motions(
    model: Model, springs: Sequence[Spring], systems: Sequence[tuple[np.ndarray, LinearSystem]]
) -> tuple[PeriodicMotion, ...]:
    """Return the motions of the systems of bodies on which periodic springs act."""
    limited, owner = _limited(model, springs), np.zeros(len(model.bodies), dtype=np.int64)
    for number, (slots, _) in enumerate(systems):
        owner[slots] = number
    springs_on: dict[int, list[Spring]] = {}
    for spring in springs:
        springs_on.setdefault(int(owner[spring.slots[0]]), []).append(spring)
    result, known = [], dict[Any, np.ndarray | None]()  # many parts of large networks are alike
    for number, own in springs_on.items():
        slots, system = systems[number]
        period = _common([spring.period for spring in own])
        if period is None:
            continue
        places = [np.searchsorted(slots, spring.slots) for spring in own]
        matrices = system.mass, system.damping, system.stiffness, *places
        key = *(item.tobytes() for item in matrices), *(id(spring.law) for spring in own)
        if key not in known:
            known[key] = _multipliers(system, places, own, period)
        if (found := known[key]) is None:
            continue
        rates = -np.log(np.maximum(found, 1e-300)) / period
        slowest = rates[rates * period > NEUTRAL].min(initial=math.inf)
        usual = system.rates[system.rates > 0.0].min(initial=math.inf)
        # a relaxation time that is longer by less differs by rounding alone
        relaxation = 1.0 / slowest if slowest * 1.001 < usual and slowest < math.inf else 0.0
        alone = not limited[slots].any()
        result.append(PeriodicMotion(slots, period, float(found.max()), float(f"{relaxation:.3g}"), alone))
    return tuple(result)


def _limited(model: Model, springs: Sequence[Spring]) -> np.ndarray:
    """Whether a contact, or a force that is neither linear nor among the springs, acts on each body, (body,)."""
    laws = {id(spring.law) for spring in springs}
    others = [id(law) not in laws for law in model.couplings.laws]
    result = np.zeros(len(model.bodies) + 1, dtype=bool)
    result[model.ends.slots] = True
    result[model.coupled.chosen(np.array(others, dtype=bool) & ~model.couplings.linear.any(axis=0)).slots] = True
    bodies = model.bodies
    result[:-1] |= bodies.residual & np.array([id(body) not in laws for body in bodies.oscillators], dtype=bool)
    return result[:-1]


def _force(law: Component, kernel: str) -> Callable[..., np.ndarray]:
    """Return the force of a law as a function of arrays of displacements or extensions, their rates, and times."""
    return lambda *points: call_each([law], kernel, *(item[None] for item in np.broadcast_arrays(*points)))[0]


def _strengths(law: Component, kernel: str, times: np.ndarray) -> np.ndarray:
    """Return stiffness (N m-1) and damping (N s m-1) of a linear force at some times, (2, time)."""
    force = _force(law, kernel)
    return 0.5 * np.stack(
        [force(1.0, 0.0, times) - force(-1.0, 0.0, times), force(0.0, 1.0, times) - force(0.0, -1.0, times)]
    )


@lru_cache(maxsize=256)
def _period(law: Component, kernel: str) -> float:
    """Return the period of a force that is linear (s), among those that a field gives; 0 if there is none."""
    _, used, fields = law.kernel(kernel)
    if TIME not in used or law.has_kernel(UPDATE):
        return 0.0
    values = [(law.units_of(name), getattr(law, name)) for name in fields]
    numbers = [(units, abs(value)) for units, value in values if isinstance(value, float | int) and value]
    periods = [2.0 * math.pi / value for units, value in numbers if units == "rad s-1"]
    periods += [1.0 / value for units, value in numbers if units in ("Hz", "s-1")]
    periods += [float(value) for units, value in numbers if units == "s"]
    try:
        return next((period for period in sorted(periods) if _is_linear(law, kernel, period)), 0.0)
    except InvalidInput:  # it is not defined everywhere, as a linear one is
        return 0.0


def _is_linear(law: Component, kernel: str, period: float) -> bool:
    """Whether a force is linear, and the same after a period."""
    force, times = _force(law, kernel), period * _TIMES
    stiffness, damping = _strengths(law, kernel, times)
    x, v, time = (item.ravel() for item in np.meshgrid(_SIZES, _SIZES[::3], np.arange(len(times))))
    push = force(0.0, 0.0, times)[time]
    linear = push + stiffness[time] * x + damping[time] * v
    size = np.abs(push) + np.abs(stiffness).max() * np.abs(x) + np.abs(damping).max() * np.abs(v)
    with np.errstate(all="ignore"):
        found = np.stack([force(x, v, times[time]), force(x, v, times[time] + period)])
        return bool((np.abs(found - linear) <= SAME * size).all())


def _common(periods: Sequence[float]) -> float | None:
    """Return the least common multiple of periods (s), None if there is none, or too long a one."""
    multiple = 1
    for period in periods:
        ratio = Fraction(period / periods[0]).limit_denominator(MOST_PERIODS)
        if not ratio or abs(float(ratio) * periods[0] / period - 1.0) > SAME:
            return None
        multiple = math.lcm(multiple, ratio.numerator)  # n is a multiple of n/d
    return multiple * periods[0] if multiple * periods[0] <= MOST_PERIODS * min(periods) else None


def _multipliers(
    system: LinearSystem, places: Sequence[np.ndarray], springs: Sequence[Spring], period: float
) -> np.ndarray | None:
    """Return the absolute multipliers of a period, None where there would be too many steps.

    `places` are the bodies of each spring among those of the system.
    """
    count = len(system.mass)
    patterns = np.zeros((len(springs), count, count))
    for pattern, place, spring in zip(patterns, places, springs, strict=True):
        pattern[np.ix_(place, place)] = spring.pattern
    looks = np.linspace(0.0, period, STEPS_PER_PERIOD * max(1, round(period / min(item.period for item in springs))))
    largest = [np.abs(_strengths(item.law, item.kernel, looks)).max(axis=1) for item in springs]
    root = 1.0 / np.sqrt(system.mass)
    stiffness, damping = (
        float(np.linalg.norm(root[:, None] * (constant + np.tensordot(most, patterns, 1)) * root, 2))
        for constant, most in zip((system.stiffness, system.damping), np.transpose(largest), strict=True)
    )
    steps = max(len(looks), STEPS_PER_RADIAN * period * max(math.sqrt(stiffness), damping))
    if steps * (2 * count) ** 2 > MOST_NUMBERS:
        return None
    steps = 1 << math.ceil(math.log2(steps))
    times = period / (2 * steps) * np.arange(2 * steps + 1)
    drift = np.zeros((len(times), 2 * count, 2 * count))
    drift[:, :count, count:] = np.eye(count)
    varying = [_strengths(item.law, item.kernel, times) for item in springs]
    for column, constant in enumerate((system.stiffness, system.damping)):
        matrix = constant + np.tensordot(np.array([item[column] for item in varying]).T, patterns, 1)
        drift[:, count:, column * count : (column + 1) * count] = -matrix / system.mass[:, None]
    with np.errstate(all="ignore"):
        monodromy = _product(_runge_kutta(drift, period / steps))
    if not np.isfinite(monodromy).all():
        return np.array([math.inf])
    return np.abs(np.linalg.eigvals(monodromy))


def _runge_kutta(drift: np.ndarray, step: float) -> np.ndarray:
    """Return the matrices of classical Runge–Kutta steps, from the drift at their ends and midpoints."""
    begin, middle, end = drift[:-1:2], drift[1::2], drift[2::2]
    one = np.eye(drift.shape[1])
    second = middle @ (one + 0.5 * step * begin)
    third = middle @ (one + 0.5 * step * second)
    fourth = end @ (one + step * third)
    return one + step / 6.0 * (begin + 2.0 * second + 2.0 * third + fourth)


def _product(matrices: np.ndarray) -> np.ndarray:
    """Return the product of a power of 2 of matrices, the last one on the left."""
    while len(matrices) > 1:
        matrices = matrices[1::2] @ matrices[::2]
    return np.asarray(matrices[0])
