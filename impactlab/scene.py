"""What is known of a scene before it runs: energies, and the stiffness of contacts, couplings and residual forces."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from impactlab.contact import ContactLaw
from impactlab.linear import (
    coupled_systems,
    flexibility,
    hottest,
    line_variances,
    linear_variances,
    spread,
    white_variances,
)
from impactlab.model import Model
from impactlab.oscillator import Oscillator

Force = Callable[[np.ndarray], np.ndarray]


def energies(model: Model, start: str | np.ndarray, duration: float) -> np.ndarray:
    """Return the energy that each body may bring into a collision (J), (body,).

    It is the temperature ``m E[v²]`` of the hottest body in the connected part, or the
    energy of the start or of the response to a given force, whichever is largest.
    """
    times = np.linspace(0.0, duration, 257)
    intensity = model.intensities()
    if model.time_varying:
        for slot in model.white:
            call = model.network.excitations[model.bodies[slot]].call
            intensity[slot] = float(call("intensity", times).max())
    heat = model.mass * white_variances(model, intensity)[1]
    growing = ~np.isfinite(heat)  # as long as the run lasts
    heat[growing] = 2.0 * np.pi * intensity[growing] * duration / model.mass[growing]
    heat += model.mass * line_variances(model)[1]
    if isinstance(start, np.ndarray):
        heat = np.maximum(heat, _energy_of(model, start))
    for slot in model.forced:
        excitation = model.network.excitations[model.bodies[slot]]
        mean_square = float(np.mean(excitation.call("force", times) ** 2))
        damping, mass = model.damping[slot], model.mass[slot]
        amplitude = mass / damping if damping else duration
        heat[slot] = max(heat[slot], 0.5 * mean_square * amplitude**2 / mass)
    return hottest(model, heat)


def _energy_of(model: Model, start: np.ndarray) -> np.ndarray:
    """Energy of each body in a given state, with that of its contacts and couplings (J), (body,)."""
    displacement, velocity = start
    energy = 0.5 * model.stiffness * displacement**2 + 0.5 * model.mass * velocity**2
    place = np.append(displacement, 0.0)
    result = np.append(energy, 0.0)
    for contact, (first, second) in zip(model.network.contacts.values(), model.ends, strict=True):
        result[[first, second]] += _work(contact.law.evaluate, place[first] - place[second] - contact.clearance)
    for coupling, (first, second) in zip(model.network.couplings.values(), model.coupled, strict=True):
        result[[first, second]] += max(_work(coupling.law.evaluate, place[second] - place[first]), 0.0)
    return result[:-1]


@dataclass(frozen=True, eq=False)
class Stiffening:
    """What contacts, couplings and residual forces add to the bodies' own stiffness at a given energy.

    Attributes
    ----------
    energy : (body,) ndarray
        Energy of the bodies (J).
    penetration : (contact,) ndarray
        Thermal plus static penetration (m).
    contacts : (contact,) ndarray
        Tangent stiffness of the contacts there (N m-1).
    couplings : (coupling,) ndarray
        Tangent stiffness of the couplings (N m-1).
    bodies : (body,) ndarray
        Tangent stiffness of the residual forces (N m-1).
    rest : (body,) ndarray
        Displacements under the static forces of contacts with negative clearance (m).
    """

    energy: np.ndarray
    penetration: np.ndarray
    contacts: np.ndarray
    couplings: np.ndarray
    bodies: np.ndarray
    rest: np.ndarray

    @property
    def links(self) -> np.ndarray:
        """Tangent stiffness of the contacts, then of the couplings (N m-1)."""
        return np.concatenate([self.contacts, self.couplings])

    @classmethod
    def of(cls, model: Model, energy: np.ndarray) -> Stiffening:
        """Evaluate a scene at some energies of its bodies.

        The thermal penetration stores the energy, ``∫₀^δ F = E``; for ``F = η δ^p`` it is
        ``((p + 1) E/η)^(1/(p + 1))``. The static one is that of a negative clearance.
        """
        known: dict[tuple[Any, ...], tuple[float, float, float]] = {}
        of_contacts = np.zeros((3, len(model.ends)))
        yielding = np.append(flexibility(model), 0.0)  # a wall does not
        for slot, contact in enumerate(model.network.contacts.values()):
            overlap = max(-contact.clearance, 0.0)
            compliance = float(yielding[model.ends[slot]].sum()) if overlap else 0.0
            key = (contact.law, float(energy[model.ends[slot].min()]), overlap, compliance)
            if key not in known:
                known[key] = _penetration(*key)
            of_contacts[:, slot] = known[key]
        penetration, tangent, force = of_contacts
        rest = np.zeros(len(model.mass) + 1)
        np.add.at(rest, model.ends[:, 0], -force)
        np.add.at(rest, model.ends[:, 1], force)
        rest = np.where(np.isfinite(yielding), rest * np.minimum(yielding, 1e300), 0.0)[:-1]
        members = zip(model.network.couplings.values(), model.coupling[0], model.coupled, strict=True)
        couplings = np.array(
            [
                linear or _largest_tangent(item.law.evaluate, 0.0, float(energy[pair.min()]))
                for item, linear, pair in members
            ]
        )
        bodies = np.array(
            [
                _largest_tangent(partial(_residual, body), body.stiffness, float(heat))
                if body.has_kernel("residual")
                else 0.0
                for body, heat in zip(model.network.oscillators.values(), energy, strict=True)
            ]
        )
        return cls(energy, penetration, tangent, couplings, bodies, rest)


def _residual(body: Oscillator, displacement: np.ndarray) -> np.ndarray:
    return body.call("residual", displacement, 0.0)


def _largest_tangent(force: Force, stiffness: float, energy: float) -> float:
    """Largest tangent stiffness of a force within the amplitude where it and a spring have stored the energy."""

    def outward(x: np.ndarray) -> np.ndarray:
        return np.asarray(stiffness * x + np.sign(x) * np.maximum(np.sign(x) * force(x), 0.0))

    def stored(amplitude: float) -> float:
        return min(_work(outward, amplitude), _work(outward, -amplitude))

    if not 0.0 < energy < math.inf:
        return 0.0
    amplitude = _solve(stored, energy)
    x = np.linspace(-amplitude, amplitude, 65)
    return max(float(np.gradient(force(x), x).max()), 0.0) if amplitude else 0.0


def start_factors(model: Model, stiffening: Stiffening) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Return the slots of bodies that linear couplings connect, and a root of the covariance of their (x, v).

    Residual forces narrow the law. What only contacts can heat has the temperature of its
    part. Without a stationary law the root is 0.
    """
    temperature = hottest(model, model.mass * linear_variances(model)[1])
    result = []
    for slots, system in coupled_systems(model):
        residual = stiffening.bodies[slots]
        stiffer = replace(system, stiffness=system.stiffness + np.diag(residual)) if residual.any() else system
        cold = not system.damping.any() and not model.excited[slots].any()
        heat = float(temperature[slots[0]])
        covariance = stiffer.thermal_covariance(heat) if cold and math.isfinite(heat) else stiffer.covariance
        squares, shapes = np.linalg.eigh(np.zeros((2 * len(slots),) * 2) if covariance is None else covariance)
        result.append((slots, shapes * np.sqrt(np.maximum(squares, 0.0))))
    return tuple(result)


def gap_scale(model: Model, penetration: np.ndarray) -> np.ndarray:
    """Return the length over which the density of each gap varies near contact (m).

    It is the penetration or the spread of the gap, whichever is smaller; 1 if nothing moves.
    """
    variance = np.append(spread(model)[0] ** 2, 0.0)
    of_gap = np.sqrt(variance[model.ends].sum(axis=1))
    scale = np.where(penetration > 0.0, np.minimum(penetration, np.where(of_gap > 0.0, of_gap, np.inf)), of_gap)
    return np.where((scale > 0.0) & np.isfinite(scale), scale, 1.0)


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


def _work(force: Force, length: float) -> float:
    """Integral of a force from 0 to a length, of either sign (J)."""
    return float(0.5 * length * (_WEIGHTS * force(0.5 * length * (_NODES + 1.0))).sum())


def _penetration(law: ContactLaw, energy: float, overlap: float, compliance: float) -> tuple[float, float, float]:
    """Penetration, tangent stiffness there, and static force of a contact."""

    def stored(depth: float) -> float:
        return _work(law.evaluate, depth)

    def pressed(depth: float) -> float:
        return depth + compliance * float(law.evaluate(depth))

    thermal = _solve(stored, energy) if 0.0 < energy < math.inf else 0.0
    static = _solve(pressed, overlap) if overlap > 0.0 and compliance < math.inf else 0.0
    depth = thermal + static
    if depth == 0.0:
        return 0.0, 0.0, 0.0
    width = 1e-3 * depth
    low, high = law.evaluate([depth - width, depth + width])
    return depth, max(float(high - low) / (2.0 * width), 0.0), float(law.evaluate(static))


def _solve(increasing: Any, target: float) -> float:
    """Solve ``increasing(depth) = target`` by bisection of the logarithm; 0 if it never gets there."""

    def reached(logarithm: float) -> bool:
        try:
            return bool(increasing(10.0**logarithm) >= target)
        except OverflowError:  # Python's functions raise it where compiled ones return infinity
            return True

    low, high = -60.0, 40.0
    if not reached(high):
        return 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reached(middle) else (middle, high)
    return float(10.0 ** (0.5 * (low + high)))
