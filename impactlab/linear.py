"""Linear laws: bodies alone or on linear couplings, under white noise and cosines, without contacts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.model import Model, kept

ZERO = 1e-12
"""Part of the largest stiffness or rate below which another counts as 0."""

LARGE, APART, MOST_APART = 1e6, 1e6, 1e12
"""Largest entry of a drift by the fastest rate at which rates are found in SI units; by the slowest rate at which its
Lyapunov equation is solved as it is, and at which there is a covariance at all."""

_CHUNK = 2e6  # complex numbers that a response may take at a time


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """Bodies on springs and dampers under white noise, ``M x'' + C x' + K x = f``.

    Displacements in which no spring holds the bodies (rows of K that add up to 0) are left
    out of the state, so that the velocities of free bodies have their law.

    Attributes
    ----------
    mass : (body,) ndarray
        Diagonal of M (kg).
    damping, stiffness : (body, body) ndarray
        C and K (N s m-1, N m-1).
    intensity : (body,) ndarray
        Two-sided spectral densities of the noises (N2 s rad-1).
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    intensity: np.ndarray

    @cached_property
    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the directions that springs hold, and the free ones, as columns."""
        stiffness, directions = np.linalg.eigh(self.stiffness)
        held = stiffness > ZERO * stiffness[-1]
        return directions[:, held], directions[:, ~held]

    @property
    def free(self) -> np.ndarray:
        """Whether no spring holds each body, (body,) of bool."""
        return np.asarray((np.abs(self.directions[1]) > 1e-6).any(axis=1))

    @cached_property
    def drift(self) -> np.ndarray:
        """Return the matrix L of ``(z, v)' = L (z, v)``; z are the displacements in the held directions."""
        held, inverse = self.directions[0], 1.0 / self.mass[:, None]
        none = np.zeros((held.shape[1], held.shape[1]))
        return np.block([[none, held.T], [-inverse * (self.stiffness @ held), -inverse * self.damping]])

    @cached_property
    def reduction(self) -> np.ndarray:
        """Return the matrix, of orthonormal rows, that takes (x, v) to (z, v)."""
        held = self.directions[0]
        count, kept = held.shape
        result = np.zeros((kept + count, 2 * count))
        result[:kept, :count], result[kept:, count:] = held.T, np.eye(count)
        return result

    @cached_property
    def scales(self) -> tuple[float, float]:
        """Return the largest undamped frequency, and the largest rate of the dampers alone (s-1)."""
        root = 1.0 / np.sqrt(self.mass)
        largest = [
            float(np.linalg.eigvalsh(root[:, None] * part * root)[-1]) for part in (self.stiffness, self.damping)
        ]
        return math.sqrt(max(largest[0], 0.0)), max(largest[1], 0.0)

    @property
    def units(self) -> np.ndarray:
        """Return units of (z, v) in which no entry of the drift is much larger than the fastest rate."""
        count = self.directions[0].shape[1]
        return np.concatenate([np.full(count, math.sqrt(np.abs(self.stiffness).max())), np.sqrt(self.mass)])

    @cached_property
    def rates(self) -> np.ndarray:
        """Return the rates at which motions decay (s-1), exactly 0 for those that are not damped."""
        drift, units = self.drift, self.units
        if np.abs(drift).max() > LARGE * max(self.scales):
            drift = units[:, None] * drift / units
        values = np.linalg.eigvals(drift)
        return np.where(-values.real > ZERO * np.abs(values).max(), -values.real, 0.0)

    @cached_property
    def covariance(self) -> np.ndarray | None:
        """Return the stationary covariance of (x, v), (2 body, 2 body), None if there is none.

        There is none either where rates lie so far apart that it cannot be computed.
        Displacements in free directions, which have no stationary law, are taken as 0.
        """
        from scipy.linalg import solve_continuous_lyapunov  # loaded only where there are couplings

        if not self.intensity.any():
            return np.zeros((2 * len(self.mass), 2 * len(self.mass)))
        if not self.rates.all():
            return None
        held = self.directions[0].shape[1]
        growth = np.concatenate([np.zeros(held), 2.0 * np.pi * self.intensity / self.mass**2])
        largest, slowest = np.abs(self.drift).max(), self.rates.min()
        if largest <= APART * slowest:
            reduced = solve_continuous_lyapunov(self.drift, -np.diag(growth))
        else:
            units = self.units
            drift = units[:, None] * self.drift / units
            if np.abs(drift).max() > MOST_APART * slowest:
                return None
            reduced = stationary(*_over_step(drift, units**2 * growth)) / np.outer(units, units)
        return np.asarray(self.reduction.T @ reduced @ self.reduction)

    def thermal_covariance(self, temperature: float) -> np.ndarray:
        """Return the covariance of (x, v) at one temperature (J), ``T K⁻¹`` and ``T M⁻¹``."""
        result = np.zeros((2 * len(self.mass), 2 * len(self.mass)))
        count = len(self.mass)
        result[:count, :count] = temperature * np.linalg.pinv(self.stiffness, rcond=ZERO, hermitian=True)
        result[count:, count:] = np.diag(temperature / self.mass)
        return result

    def variances(self) -> np.ndarray:
        """Return the mean squares of displacement and velocity, infinite where there is no law, (2, body)."""
        covariance = self.covariance
        if covariance is None:
            return np.full((2, len(self.mass)), np.inf)
        result = np.diag(covariance).reshape(2, -1).copy()
        result[0, self.free & (result[1] > 0.0)] = np.inf
        return result

    def flexibility(self) -> np.ndarray:
        """Return the displacement of each body by a unit force on it, infinite for a free one (m N-1)."""
        own = np.diag(self.thermal_covariance(1.0))[: len(self.mass)]
        return np.where(self.free, np.inf, own)

    def receptance(self, body: int, frequencies: np.ndarray) -> np.ndarray:
        """Return the complex displacements by a unit force on one body, (frequency, body) (m N-1)."""
        force = np.zeros((len(self.mass), 1))
        force[body] = 1.0
        parts = []
        for omega in np.array_split(frequencies, int(frequencies.size * self.stiffness.size / _CHUNK) + 1):
            omega = omega[:, None, None]
            dynamic = self.stiffness - np.diag(self.mass) * omega**2 + 1j * omega * self.damping
            try:
                parts.append(np.linalg.solve(dynamic, np.broadcast_to(force, (len(omega), *force.shape)))[..., 0])
            except np.linalg.LinAlgError:  # a line meets an undamped mode
                parts.append(np.full((len(omega), len(self.mass)), np.inf, dtype=complex))
        return np.concatenate(parts)


def _over_step(drift: np.ndarray, growth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return transition and covariance of a motion over a short time, by Van Loan's block exponential."""
    from scipy.linalg import expm

    step, count = 1.0 / np.abs(drift).max(), len(drift)
    block = expm(step * np.block([[-drift, np.diag(growth)], [np.zeros_like(drift), drift.T]]))
    transition = block[count:, count:].T
    return transition, transition @ block[:count, count:]


def stationary(transition: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Solve ``P = A P Aᵀ + Q`` as a sum over steps whose number is doubled until it grows no more.

    All terms are positive, so that nothing cancels, whatever the units. Infinite if A is not stable.
    """
    nowhere = np.full(transition.shape, np.inf)
    if not np.isfinite(transition).all() or np.abs(np.linalg.eigvals(transition)).max() >= 1.0:
        return nowhere
    for _ in range(60):
        more = transition @ covariance @ transition.T
        covariance, transition = covariance + more, transition @ transition
        if not (np.abs(np.diag(more)) > 1e-17 * np.diag(covariance)).any():
            return covariance
    return nowhere


@kept
def coupled_systems(model: Model) -> tuple[tuple[np.ndarray, LinearSystem], ...]:
    """Return the slots and the linear system of every group of bodies that linear couplings connect."""
    intensity = model.initial_intensities
    return tuple(
        (
            slots,
            LinearSystem(
                model.mass[slots],
                np.diag(model.damping[slots]) + damping,
                np.diag(model.stiffness[slots]) + stiffness,
                intensity[slots],
            ),
        )
        for slots, stiffness, damping in model.coupled_parts()
    )


def flowing_systems(model: Model) -> tuple[tuple[np.ndarray, LinearSystem], ...]:
    """Return those of :func:`coupled_systems` whose couplings flow: the groups of a linear motion."""
    flowing = model.coupled[model.flowing]
    return tuple(pair for pair in coupled_systems(model) if np.isin(pair[0], flowing).any())


def linear_variances(model: Model) -> np.ndarray:
    """Return the linear mean squares of displacement and velocity without contacts, (2, body).

    Under white noise ``πS/(ck)`` and ``πS/(mc)``, under lines the finite sum over them;
    for bodies with linear couplings those of the coupled system. Infinite where there is
    no stationary law, 0 without excitation.
    """
    return np.asarray(white_variances(model, model.initial_intensities) + line_variances(model))


def white_variances(model: Model, intensity: np.ndarray) -> np.ndarray:
    """Return the part of :func:`linear_variances` that white noise of some densities makes, (2, body)."""
    own = (intensity == model.initial_intensities).all()
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = np.pi * intensity / (model.mass * model.damping)
        displacement = np.pi * intensity / (model.damping * model.stiffness)
    result = np.where(intensity > 0.0, [displacement, velocity], 0.0)
    for slots, system in coupled_systems(model):
        result[:, slots] = (system if own else replace(system, intensity=intensity[slots])).variances()
    return np.asarray(result)


@kept
def line_variances(model: Model) -> np.ndarray:
    """Return the part of :func:`linear_variances` that sums of cosines make, (2, body)."""
    result = np.zeros((2, len(model.bodies)))
    for item, (slots, response) in zip(lines_of(model), responses(model, coupled_systems(model)), strict=True):
        gain = np.abs(response) * item.amplitudes[:, None]
        result[0, slots] += 0.5 * (gain**2).sum(axis=0)
        result[1, slots] += 0.5 * ((item.frequencies[:, None] * gain) ** 2).sum(axis=0)
    return result


def responses(
    model: Model, systems: tuple[tuple[np.ndarray, LinearSystem], ...]
) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Return what each sum of cosines moves, alone or in some systems of bodies.

    Returns
    -------
    tuple of pairs
        Slots, and complex displacements by unit force, (line, body) (m N-1).
    """
    joint = {slot: pair for pair in systems for slot in pair[0].tolist()}
    result = []
    for item in lines_of(model):
        slot, slots = item.body, np.array([item.body])
        if slot in joint:
            slots, system = joint[slot]
            response = system.receptance(slots.tolist().index(slot), item.frequencies)
        else:
            response = receptance_of(model.mass[slot], model.damping[slot], model.stiffness[slot], item.frequencies)
            response = response[:, None]
        result.append((slots, response))
    return tuple(result)


def relaxation_time(model: Model) -> float:
    """Return the relaxation time of the slowest damped motion (s); 0 if nothing is damped."""
    systems = coupled_systems(model)
    damped = model.damping > 0.0
    for slots, _ in systems:
        damped[slots] = False
    c, k, m = (values[damped] for values in (model.damping, model.stiffness, model.mass))
    root = np.sqrt(np.maximum(c**2 - 4.0 * k * m, 0.0))
    slow = np.where(k > 0.0, 2.0 * k / (c + root), c / m)  # overdamped: the smaller root
    rates = np.concatenate([np.where(c**2 < 4.0 * k * m, 0.5 * c / m, slow), *(item.rates for _, item in systems)])
    return float(1.0 / rates[rates > 0.0].min()) if rates.any() else 0.0


def hottest(model: Model, heat: np.ndarray, labels: np.ndarray | None = None) -> np.ndarray:
    """Return the largest of some energies in the connected part of each body, or among those of a label, (body,)."""
    labels = model.connected() if labels is None else labels
    largest = np.zeros(labels.max() + 1)
    np.maximum.at(largest, labels, heat)
    result: np.ndarray = largest[labels]
    return result


def spread(model: Model) -> np.ndarray:
    """Return upper estimates of the standard deviations of displacement and velocity, (2, body).

    They are those of the linear law at the highest temperature of the connected part.
    """
    temperature = hottest(model, model.mass * linear_variances(model)[1])
    with np.errstate(invalid="ignore"):
        return np.sqrt([temperature * flexibility(model), temperature / model.mass])


def extent(model: Model) -> np.ndarray:
    """Return how far bodies usually are from rest and how fast, roughly, (2, body): standard deviations.

    As `spread`, but only contacts bring bodies to the highest temperature among them; those on linear couplings keep
    the shape of their linear law, in which a heavy body is hotter than what it carries.
    """
    result, variance = spread(model), linear_variances(model)
    systems = coupled_systems(model)
    if not systems:
        return result
    heat = model.mass * variance[1]
    shared = hottest(model, heat, model.touching())
    for body in np.flatnonzero((shared > 0.0) & np.isfinite(shared)):
        result[:, body] *= np.sqrt(shared[body] * model.mass[body]) / (model.mass[body] * result[1, body])
    for slots, _ in systems:
        if (heat[slots] > 0.0).all() and np.isfinite(variance[:, slots]).all():
            result[:, slots] = np.sqrt(variance[:, slots] * (shared[slots] / heat[slots]).max())
    return result


def flexibility(model: Model) -> np.ndarray:
    """Return the displacement of each body by a unit force on it, infinite for a free one (m N-1), (body,)."""
    with np.errstate(divide="ignore"):
        result = 1.0 / model.stiffness
    for slots, system in coupled_systems(model):
        result[slots] = system.flexibility()
    return result


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


def receptance_of(mass: float, damping: float, stiffness: float, frequencies: np.ndarray) -> np.ndarray:
    """Return the complex displacement per unit force at angular frequencies, ``1/(k − m ω² + i c ω)`` (m N-1)."""
    dynamic = stiffness - mass * frequencies**2 + 1j * damping * frequencies
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(dynamic != 0.0, 1.0 / dynamic, np.inf)


@kept
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
