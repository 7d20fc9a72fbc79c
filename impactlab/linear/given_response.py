"""How far given forces and motions move linear bodies, and how fast."""

from __future__ import annotations

import math

import numpy as np

from impactlab.assembly.mechanism import Load, given_motions
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.matrices import ZERO
from impactlab.linear.given_functions import irregular_times
from impactlab.linear.laws import coupled_systems
from impactlab.linear.spectral_lines import receptance_of
from impactlab.linear.systems import LinearSystem

MOST, FEWEST = 2**15, 2**11
"""Times at which a response is found in a stretch of a run, and the fewest of them."""

WORK, MANY = 4e8, 64
"""What solving for all frequencies may take, their number times the cube of the bodies; and bodies that move together
up to which it is done: for more the response is that of slow forces."""

FINE, FINE_FORCE = 0.25, 0.5
"""Angles between two times of the fastest motion, and of a force whose frequencies are known."""

STRETCHES, SETTLED = 4, 8.0
"""Stretches of a run that is too long to be looked at as a whole, and relaxation times that are left out of each."""

FADED = 1e-5
"""What is left of the factor by which responses fade in a period, twice a stretch, so that they end before the next."""


@kept
def given_ranges(model: Model, begin: float, end: float) -> np.ndarray:
    """Return least and largest displacement and velocity under given forces and motions, (2, 2, body).

    They are of times after 0 (s), without noise, contacts and residual forces, and from rest at the beginning. They are
    0 where nothing of this kind acts, and for bodies on springs or dampers of negative strength.
    """
    result = np.zeros((2, 2, len(model.bodies)))
    known: dict[tuple[float, ...], np.ndarray] = {}
    for slot, item in given_motions(model):
        times = np.linspace(0.0, end, MOST)
        motion = item.call("force", np.clip(times, *item.acts_between))
        result[..., slot] = _ends(motion, np.gradient(motion, times))
    for slots, system, forces in _driven(model):
        key: tuple[float, ...] = (-1.0, float(slots[0]))
        if len(slots) == 1:
            key = *system.mass, *system.damping[0], *system.stiffness[0]
            key += tuple(number for item in forces for number in (id(item.function), *item.weights, *item.of_rate))
        if key not in known:
            most = min(MOST, 8 * MOST // len(model.sources["force"].excitations), int(WORK / len(slots) ** 3))
            known[key] = _range(system, forces, begin, end, max(FEWEST, most))
        result[..., slots] = known[key]
    return result


def _driven(model: Model) -> list[tuple[np.ndarray, LinearSystem, list[Load]]]:
    """Return bodies that given forces, or couplings to bodies of given motion, move: slots, system and forces."""
    joint = {slot: pair for pair in coupled_systems(model) for slot in pair[0].tolist()}
    result: dict[int, tuple[np.ndarray, LinearSystem, list[Load]]] = {}
    for load in (load for item in model.mechanisms for load in item.loads(model)):
        reached: dict[int, list[int]] = {}
        for place, slot in enumerate(load.bodies.tolist()):
            reached.setdefault(int(joint[slot][0][0]) if slot in joint else slot, []).append(place)
        for first, places in reached.items():
            if first not in result:
                slots, system = joint[first] if first in joint else (np.array([first]), _alone(model, first))
                result[first] = slots, system, []
            slots, _, loads = result[first]
            both = np.zeros((2, len(slots)))
            both[:, np.searchsorted(slots, load.bodies[places])] = load.weights[places], load.of_rate[places]
            loads.append(Load(slots, load.function, both[0], both[1], load.span))
    return list(result.values())


def _alone(model: Model, slot: int) -> LinearSystem:
    damping, stiffness = (item[slot : slot + 1, None] for item in (model.damping, model.stiffness))
    return LinearSystem(model.mass[slot : slot + 1], damping, stiffness, np.zeros((1, 1)))


def _range(system: LinearSystem, forces: list[Load], begin: float, end: float, most: int) -> np.ndarray:
    """Return least and largest displacement and velocity of bodies that forces move together, (2, 2, body)."""
    bodies = len(system.mass)
    for strengths in map(np.linalg.eigvalsh, (system.stiffness, system.damping)):
        if strengths[0] < -ZERO * strengths[-1] or not end > max(begin, 0.0):
            return np.zeros((2, 2, bodies))
    if bodies > MANY:
        return _slow_range(system, forces, begin, end)
    fastest, known = system.scales[0], max(item.function.highest_frequency for item in forces)
    rates = fastest / FINE, known / FINE_FORCE, FEWEST / (end - begin)
    interval = 1.0 / max(rate for rate in rates if math.isfinite(rate))
    count = 2 ** math.ceil(math.log2((end - begin) / interval))
    starts = np.array([begin])
    if count > most:
        count = 2 ** int(math.log2(most))
        starts = np.linspace(begin, end - count * interval, STRETCHES)
    else:
        interval = (end - begin) / count
    slowest = system.rates[system.rates > 0.0].min(initial=math.inf)
    faded = np.exp(math.log(FADED) * np.arange(count) / (2 * count))
    period = 2 * count * interval
    frequencies = (2.0 * np.pi * np.arange(count + 1) + 1j * math.log(FADED)) / period
    found = []
    for start in starts:
        times = start + interval * np.arange(count)
        seen = times if math.isfinite(known) else irregular_times(start, start + count * interval, count)
        response = np.zeros((len(frequencies), bodies), dtype=complex)
        for _, function, weights, of_rate, span in forces:
            values = np.fft.rfft(faded * function.call("force", np.clip(seen, *span)), 2 * count)
            response += values[:, None] * _receptance(system, weights, frequencies)
            if of_rate.any():
                response += (1j * frequencies * values)[:, None] * _receptance(system, of_rate, frequencies)
        forgotten = min(SETTLED / slowest, 0.5 * count * interval) if start > begin else 0.0
        late = (times >= 0.0) & (times >= start + forgotten)
        motion = (
            np.fft.irfft(item, axis=0)[:count] / faded[:, None]
            for item in (response, 1j * frequencies[:, None] * response)
        )
        found.append([item[late if late.any() else slice(None)] for item in motion])
    result: np.ndarray = _ends(*(np.concatenate(item) for item in zip(*found, strict=True)))
    return result if np.isfinite(result).all() else np.zeros_like(result)


def _slow_range(system: LinearSystem, forces: list[Load], begin: float, end: float) -> np.ndarray:
    """Return the same where the forces vary slowly."""
    result, times = np.zeros((2, 2, len(system.mass))), irregular_times(max(begin, 0.0), end, FEWEST)
    yielding = np.linalg.pinv(system.stiffness, rcond=ZERO, hermitian=True)
    for _, function, weights, _, span in forces:
        values = function.call("force", np.clip(times, *span))
        result[0] += np.sort(np.outer([values.min(), values.max()], yielding @ weights), axis=0)
    return result


def _receptance(system: LinearSystem, along: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    if len(along) > 1:
        return system.receptance(along, frequencies)
    m, c, k = system.mass[0], system.damping[0, 0], system.stiffness[0, 0]
    return np.asarray(along[0] * receptance_of(m, c, k, frequencies))[:, None]


def _ends(*series: np.ndarray) -> np.ndarray:
    return np.asarray([[item.min(axis=0), item.max(axis=0)] for item in series])
