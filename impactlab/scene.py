"""What is known of a scene before it runs: linear laws, energies and stiffness of contacts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from impactlab.contact import ContactLaw
from impactlab.errors import InvalidInput
from impactlab.model import Model
from impactlab.oscillator import Oscillator


@dataclass(frozen=True, eq=False)
class Lines:
    """A sum of cosines on one body.

    Attributes
    ----------
    body : int
        Slot.
    name : str
        Name of the body, which names the stream of the phases.
    frequencies : (line,) ndarray
        Angular frequencies (rad s-1).
    amplitudes : (line,) ndarray
        Amplitudes of the force (N).
    """

    body: int
    name: str
    frequencies: np.ndarray
    amplitudes: np.ndarray


def linear_variances(model: Model) -> np.ndarray:
    """Return the linear mean squares of displacement and velocity without contacts, (2, body).

    Under white noise ``πS/(ck)`` and ``πS/(mc)``; under lines the finite sum over them;
    infinite where there is no stationary law, 0 without excitation.
    """
    intensity = model.intensities()
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = np.pi * intensity / (model.mass * model.damping)
        displacement = np.pi * intensity / (model.damping * model.stiffness)
    result = np.where(intensity > 0.0, [displacement, velocity], 0.0)
    for item in lines_of(model):
        slot = item.body
        response = receptance_of(model.mass[slot], model.damping[slot], model.stiffness[slot], item.frequencies)
        gain = np.abs(response) * item.amplitudes
        result[:, item.body] = 0.5 * (gain**2).sum(), 0.5 * ((item.frequencies * gain) ** 2).sum()
    return result


def receptance_of(mass: float, damping: float, stiffness: float, frequencies: np.ndarray) -> np.ndarray:
    """Return the complex displacement per unit force at angular frequencies, ``1/(k − m ω² + i c ω)`` (m N-1)."""
    dynamic = stiffness - mass * frequencies**2 + 1j * damping * frequencies
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(dynamic != 0.0, 1.0 / dynamic, np.inf)


def lines_of(model: Model) -> tuple[Lines, ...]:
    """Return the sums of cosines of a network."""
    result = []
    for slot in model.lines:
        name = model.bodies[slot]
        excitation = model.network.excitations[name]
        parts = excitation.lines()  # type: ignore[attr-defined]
        frequencies, amplitudes = (np.atleast_1d(np.asarray(part, dtype=float)) for part in parts)
        same = frequencies.ndim == 1 and frequencies.shape == amplitudes.shape and frequencies.size
        if not same or not np.isfinite([frequencies, amplitudes]).all():
            raise InvalidInput(
                f"{type(excitation).__name__}.lines must return two finite arrays of one length, not empty, angular "
                f"frequencies and amplitudes; shapes {frequencies.shape} and {amplitudes.shape} were returned."
            )
        result.append(Lines(slot, name, frequencies, amplitudes))
    return tuple(result)


def relaxation_time(model: Model) -> float:
    """Return the relaxation time of the slowest damped motion (s); 0 if nothing is damped."""
    c, k, m = model.damping, model.stiffness, model.mass
    damped = c > 0.0
    if not damped.any():
        return 0.0
    c, k, m = c[damped], k[damped], m[damped]
    root = np.sqrt(np.maximum(c**2 - 4.0 * k * m, 0.0))
    slow = np.where(k > 0.0, 2.0 * k / (c + root), c / m)  # overdamped: the smaller root
    rate = np.where(c**2 < 4.0 * k * m, 0.5 * c / m, slow)
    return float(1.0 / rate.min())


def regular_lines(frequencies: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Return whole numbers k and the period P such that all ``ω = 2π k/P``, or None."""
    spacing = float(frequencies[1] - frequencies[0]) if len(frequencies) > 1 else float(frequencies[0])
    if spacing <= 0.0 or frequencies[0] < 0.0:
        return None
    if len(frequencies) > 1:
        spacing = float(frequencies[-1] - frequencies[0]) / (len(frequencies) - 1)
    k = frequencies / spacing
    whole = np.rint(k)
    if np.abs(k - whole).max() > 1e-6 or np.abs(np.diff(whole) - 1.0).max(initial=0.0) > 0.0:
        return None
    return whole.astype(np.int64), 2.0 * math.pi / spacing


def hottest(model: Model, heat: np.ndarray) -> np.ndarray:
    """Return the largest of some energies in the connected part of each body, (body,)."""
    labels = model.connected()
    largest = np.zeros(labels.max() + 1)
    np.maximum.at(largest, labels, heat)
    result: np.ndarray = largest[labels]
    return result


def spread(model: Model) -> np.ndarray:
    """Return upper estimates of the standard deviations of displacement and velocity, (2, body).

    They are those of the linear law at the highest temperature of the connected part.
    """
    temperature = hottest(model, model.mass * linear_variances(model)[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sqrt([temperature / model.stiffness, temperature / model.mass])


def energies(model: Model, start: str | np.ndarray, duration: float) -> np.ndarray:
    """Return the energy that each body may bring into a collision (J), (body,).

    It is the temperature ``m E[v²]`` of the hottest body in the connected part, or the
    energy of the start or of the response to a given force, whichever is largest.
    """
    times = np.linspace(0.0, duration, 257)
    intensity = model.intensities()
    heat = model.mass * linear_variances(model)[1]
    if isinstance(start, np.ndarray):
        heat = np.maximum(heat, _energy_of(model, start))
    for slot in model.white:
        if model.time_varying:
            call = model.network.excitations[model.bodies[slot]].call
            intensity[slot] = float(call("intensity", times).max())
        # without damping the energy grows as long as the run lasts
        limit = 1.0 / model.damping[slot] if model.damping[slot] else 2.0 * duration / model.mass[slot]
        heat[slot] = max(heat[slot] if np.isfinite(heat[slot]) else 0.0, np.pi * intensity[slot] * limit)
    for slot in model.forced:
        excitation = model.network.excitations[model.bodies[slot]]
        mean_square = float(np.mean(excitation.call("force", times) ** 2))
        damping, mass = model.damping[slot], model.mass[slot]
        amplitude = mass / damping if damping else duration
        heat[slot] = max(heat[slot], 0.5 * mean_square * amplitude**2 / mass)
    return hottest(model, heat)


def _energy_of(model: Model, start: np.ndarray) -> np.ndarray:
    """Energy of each body in a given state, with that of the contacts that are closed (J), (body,)."""
    displacement, velocity = start
    energy = 0.5 * model.stiffness * displacement**2 + 0.5 * model.mass * velocity**2
    place = np.append(displacement, 0.0)
    result = np.append(energy, 0.0)
    for contact, (first, second) in zip(model.network.contacts.values(), model.ends, strict=True):
        depth = place[first] - place[second] - contact.clearance
        if depth > 0.0:
            result[[first, second]] += _stored(contact.law, float(depth))
    return result[:-1]


@dataclass(frozen=True, eq=False)
class Stiffening:
    """What contacts and residual forces add to the linear stiffness at a given energy.

    Attributes
    ----------
    energy : (body,) ndarray
        Energy of the bodies (J).
    penetration : (contact,) ndarray
        Thermal plus static penetration (m).
    contacts : (contact,) ndarray
        Tangent stiffness of the contacts there (N m-1).
    bodies : (body,) ndarray
        Tangent stiffness of the residual forces (N m-1).
    rest : (body,) ndarray
        Displacements under the static forces of contacts with negative clearance (m).
    """

    energy: np.ndarray
    penetration: np.ndarray
    contacts: np.ndarray
    bodies: np.ndarray
    rest: np.ndarray

    @classmethod
    def of(cls, model: Model, energy: np.ndarray) -> Stiffening:
        """Evaluate a scene at some energies of its bodies.

        The thermal penetration stores the energy, ``∫₀^δ F = E``; for ``F = η δ^p`` it is
        ``((p + 1) E/η)^(1/(p + 1))``. The static one is that of a negative clearance.
        """
        known: dict[tuple[Any, ...], tuple[float, float, float]] = {}
        of_contacts = np.zeros((3, len(model.ends)))
        with np.errstate(divide="ignore"):
            flexibility = np.append(1.0 / model.stiffness, 0.0)  # a wall does not yield
        for slot, contact in enumerate(model.network.contacts.values()):
            overlap = max(-contact.clearance, 0.0)
            compliance = float(flexibility[model.ends[slot]].sum()) if overlap else 0.0
            key = (contact.law, float(energy[model.ends[slot].min()]), overlap, compliance)
            if key not in known:
                known[key] = _penetration(*key)
            of_contacts[:, slot] = known[key]
        penetration, tangent, force = of_contacts
        rest = np.zeros(len(model.mass) + 1)
        np.add.at(rest, model.ends[:, 0], -force)
        np.add.at(rest, model.ends[:, 1], force)
        rest = np.where(np.isfinite(flexibility), rest * np.minimum(flexibility, 1e300), 0.0)[:-1]
        bodies = np.array(
            [
                _residual_stiffness(body, float(heat)) if body.has_kernel("residual") else 0.0
                for body, heat in zip(model.network.oscillators.values(), energy, strict=True)
            ]
        )
        return cls(energy, penetration, tangent, bodies, rest)


def _residual_stiffness(body: Oscillator, energy: float) -> float:
    """Largest tangent stiffness of a residual force within the amplitude that stores the energy."""

    def stored(amplitude: float) -> float:
        x = 0.5 * amplitude * (_NODES + 1.0)
        forces = (body.stiffness * x + np.maximum(body.call("residual", x, 0.0), 0.0),
                  body.stiffness * x + np.maximum(-body.call("residual", -x, 0.0), 0.0))  # fmt: skip
        return float(0.5 * amplitude * min((_WEIGHTS * force).sum() for force in forces))

    if not 0.0 < energy < math.inf:
        return 0.0
    amplitude = _solve(stored, energy)
    x = np.linspace(-amplitude, amplitude, 65)
    return max(float(np.gradient(body.call("residual", x, 0.0), x).max()), 0.0) if amplitude else 0.0


def gap_scale(model: Model, penetration: np.ndarray) -> np.ndarray:
    """Return the length over which the density of each gap varies near contact (m).

    It is the penetration or the spread of the gap, whichever is smaller; 1 if nothing moves.
    """
    variance = np.append(spread(model)[0] ** 2, 0.0)
    of_gap = np.sqrt(variance[model.ends].sum(axis=1))
    scale = np.where(penetration > 0.0, np.minimum(penetration, np.where(of_gap > 0.0, of_gap, np.inf)), of_gap)
    return np.where((scale > 0.0) & np.isfinite(scale), scale, 1.0)


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


def _stored(law: ContactLaw, depth: float) -> float:
    """Work of a law from 0 to a depth (J)."""
    return float(0.5 * depth * (_WEIGHTS * law.evaluate(0.5 * depth * (_NODES + 1.0))).sum())


def _penetration(law: ContactLaw, energy: float, overlap: float, compliance: float) -> tuple[float, float, float]:
    """Penetration, tangent stiffness there, and static force of a contact."""

    def stored(depth: float) -> float:
        return _stored(law, depth)

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
