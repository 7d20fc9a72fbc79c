"""Linear laws of a network without contacts: its linear systems, responses and variances."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from impactlab.assembly.links import Pairs
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.excitation import Excitation
from impactlab.errors import InvalidInput
from impactlab.inputs import real_array, shown
from impactlab.linear.noise_motion import NoiseMotion
from impactlab.linear.spectral_lines import Lines, receptance_of
from impactlab.linear.systems import LinearSystem

MOST_TOGETHER = 500
"""Bodies whose exact motion under one noise is taken together at most: it takes some seconds, and as the cube."""

NEVER = 1e-12
"""Probability, or expected number, of closings of a contact below which it counts as open."""


@kept
def linear_variances(model: Model) -> np.ndarray:
    """Return the linear mean squares of displacement and velocity without contacts, (2, body).

    Under white noise ``πS/(ck)`` and ``πS/(mc)``, under lines the finite sum over them, under
    filtered noise what Lyapunov's equation gives with the states of its filter; for bodies with
    linear couplings those of the coupled system. Infinite where there is no stationary law, 0
    without excitation.
    """
    return np.asarray(initial_variances(model) + other_variances(model))


@kept
def other_variances(model: Model) -> np.ndarray:
    """Return the part of :func:`linear_variances` that noise makes that is not white, (2, body)."""
    result, systems = np.zeros((2, len(model.bodies))), coupled_systems(model)
    for item, (slots, response) in zip(lines_of(model), responses(model, systems), strict=True):
        gain = np.abs(response) * item.amplitudes[:, None]
        result[0, slots] += 0.5 * (gain**2).sum(axis=0)
        result[1, slots] += 0.5 * ((item.frequencies[:, None] * gain) ** 2).sum(axis=0)
    moved = np.zeros_like(result)  # at most
    for motion in motions_of(model, systems):
        largest = motion.largest_envelope
        moved[:, motion.slots] += largest**2 * motion.variances() if largest else 0.0
    return np.asarray(result + moved)


@kept
def initial_variances(model: Model) -> np.ndarray:
    """Return the part of :func:`linear_variances` that the white noises make at time 0, (2, body)."""
    return _white_variances(model, model.noise.intensity, coupled_systems(model))


def white_variances(model: Model, densities: np.ndarray) -> np.ndarray:
    """Return the same for white noises of some densities, (2, body)."""
    if (densities == model.noise.density).all():
        return initial_variances(model)
    noises = model.sources["intensity"]
    intensity = noises.added(densities, len(model.bodies))
    noise = replace(model.noise, density=densities, intensity=intensity)
    systems = [(slots, replace(system, intensity=noise.matrix(slots))) for slots, system in coupled_systems(model)]
    return _white_variances(model, intensity, systems)


def _white_variances(
    model: Model, intensity: np.ndarray, systems: Iterable[tuple[np.ndarray, LinearSystem]]
) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = np.pi * intensity / (model.mass * model.damping)
        displacement = np.pi * intensity / (model.damping * model.stiffness)
    result = np.where(intensity > 0.0, [displacement, velocity], 0.0)
    for slots, system in systems:
        result[:, slots] = system.variances()
    return np.asarray(result)


def motions_of(model: Model, systems: tuple[tuple[np.ndarray, LinearSystem], ...]) -> tuple[NoiseMotion, ...]:
    """Return the motions under noises that are not white, of single bodies and of systems of bodies."""
    return tuple(motion for item in model.mechanisms for motion in item.motions(model, systems))


def moved_by(
    model: Model, kind: str, systems: tuple[tuple[np.ndarray, LinearSystem], ...]
) -> Iterator[tuple[str, Excitation, tuple[np.ndarray, LinearSystem, np.ndarray]]]:
    """Yield excitations of a kind with their names, slots and system of the bodies that move, and weights on these."""
    sources, joint = model.sources[kind], {slot: pair for pair in systems for slot in pair[0].tolist()}
    for number, (name, excitation) in enumerate(sources.named()):
        driven, weights = sources.driven(number)
        slots, system = joint.get(int(driven[0]), (driven[:1], None))
        if not np.isin(driven, slots).all():
            slots, system = joined_systems(model, systems, [driven])[-1]
        elif system is None:
            system = system_of(model, slots, *np.zeros((2, 1, 1)))
        forces = np.zeros(len(slots))
        forces[np.searchsorted(slots, driven)] = weights
        yield name, excitation, (slots, system, forces)


def hottest(model: Model, heat: np.ndarray, labels: np.ndarray | None = None) -> np.ndarray:
    """Return the largest energy in the connected part of each body, or among bodies of equal label, (body,)."""
    labels = model.connected if labels is None else labels
    largest = np.zeros(labels.max() + 1)
    np.maximum.at(largest, labels, heat)
    result: np.ndarray = largest[labels]
    return result


@kept
def spread(model: Model) -> np.ndarray:
    """Return upper estimates of the standard deviations of displacement and velocity, (2, body).

    They are those of the linear law at the highest temperature of the connected part.
    """
    temperature = hottest(model, model.mass * linear_variances(model)[1])
    with np.errstate(invalid="ignore"):
        return np.sqrt([temperature * flexibility(model), temperature / model.mass])


@kept
def extent(model: Model) -> np.ndarray:
    """Return how far bodies usually are from rest and how fast, roughly, (2, body): standard deviations.

    As `spread`, but only contacts bring bodies to the highest temperature among them; those on linear couplings keep
    the shape of their linear law, in which a heavy body is hotter than what it carries.
    """
    result, variance = spread(model).copy(), linear_variances(model)
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


def responses(
    model: Model, systems: tuple[tuple[np.ndarray, LinearSystem], ...]
) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Return the response to each sum of cosines, of single bodies and of systems of bodies.

    A response is slots, and complex displacements by unit force, (line, body) (m N-1).
    """
    joint = {slot: pair for pair in systems for slot in pair[0].tolist()}
    result = []
    for item in lines_of(model):
        of_slots: dict[int, np.ndarray] = {}
        for slot, weight in zip(item.bodies, item.weights, strict=True):
            slots = np.array([slot])
            if slot in joint:
                slots, system = joint[slot]
                response = system.receptance((slots == slot).astype(float), item.frequencies)
            else:
                response = receptance_of(model.mass[slot], model.damping[slot], model.stiffness[slot], item.frequencies)
                response = response[:, None]
            for reached, column in zip(slots.tolist(), response.T, strict=True):
                if isinstance(weight, float):
                    own = (np.ascontiguousarray(column).view(float) * weight).view(complex)  # infinite at a resonance
                else:
                    own = column * weight
                with np.errstate(invalid="ignore"):
                    of_slots[reached] = of_slots[reached] + own if reached in of_slots else own
        moved = sorted(of_slots)
        result.append((np.array(moved), np.stack([of_slots[slot] for slot in moved], axis=1)))
    return tuple(result)


@kept
def lines_of(model: Model) -> tuple[Lines, ...]:
    """Return the sums of cosines of a network."""
    result, sums = [], model.sources["lines"]
    shared: dict[str, list[Lines]] = {}
    for number, (name, excitation) in enumerate(sums.named()):
        phases = excitation.phases_of
        found = excitation.lines()  # type: ignore[attr-defined]
        try:
            first, second = found
            frequencies = np.atleast_1d(real_array(name, first))
            amplitudes = np.atleast_1d(
                real_array(name, second) if phases is None else np.asarray(second, dtype=complex)
            )
        except (TypeError, ValueError):
            frequencies = amplitudes = np.empty(0)
        same = frequencies.ndim == 1 and frequencies.shape == amplitudes.shape and frequencies.size
        if not same or not np.isfinite([frequencies, amplitudes]).all():
            raise InvalidInput(
                f"{type(excitation).__name__}.lines must return two finite, non-empty arrays of equal length, angular "
                f"frequencies and real amplitudes, since phases are drawn; it returned {shown(found)}."
            )
        bodies, weights = sums.driven(number)
        own = Lines(tuple(bodies.tolist()), phases or name, frequencies, amplitudes, tuple(weights.tolist()))
        if phases is None:
            result.append(own)
        else:
            shared.setdefault(phases, []).append(own)
    return *result, *map(_together, shared.values())


def _together(parts: list[Lines]) -> Lines:
    """Return sums of cosines that share their random phases as one."""
    first = parts[0]
    gains: dict[int, np.ndarray] = {}
    for item in parts:
        if not np.array_equal(item.frequencies, first.frequencies):
            raise InvalidInput(f"Sums of cosines that share the phases {first.name!r} must have the same frequencies.")
        for slot, weight in zip(item.bodies, item.weights, strict=True):
            gains[slot] = gains.get(slot, np.zeros(len(first.frequencies))) + weight * item.amplitudes
    slots = sorted(gains)
    return Lines(
        tuple(slots),
        first.name,
        first.frequencies,
        np.ones(len(first.frequencies)),
        tuple(gains[slot] for slot in slots),
    )


@kept
def coupled_systems(model: Model) -> tuple[tuple[np.ndarray, LinearSystem], ...]:
    """Return the slots and the linear system of every group of bodies that linear couplings connect."""
    return tuple((slots, system_of(model, slots, *matrices)) for slots, *matrices in model.coupled_parts())


def system_of(model: Model, slots: np.ndarray, stiffness: np.ndarray, damping: np.ndarray) -> LinearSystem:
    """Return the linear system of some bodies, from the matrices of the springs and dampers between them."""
    damping, stiffness = np.diag(model.damping[slots]) + damping, np.diag(model.stiffness[slots]) + stiffness
    return LinearSystem(model.mass[slots], damping, stiffness, model.noise.matrix(slots))


@kept
def correlated_systems(model: Model) -> tuple[tuple[np.ndarray, LinearSystem], ...]:
    """Return :func:`coupled_systems`, in which those are one that white noises drive together."""
    systems, together = coupled_systems(model), model.sources["intensity"].joining
    return joined_systems(model, systems, together) if together else systems


def joined_systems(
    model: Model, systems: tuple[tuple[np.ndarray, LinearSystem], ...], together: list[np.ndarray]
) -> tuple[tuple[np.ndarray, LinearSystem], ...]:
    """Join systems and bodies alone, where some slots belong together, (n,) each; other systems stay as they are."""
    pairs = [np.stack([slots[:-1], slots[1:]], axis=1) for slots in [*together, *(pair[0] for pair in systems)]]
    labels = Pairs(len(model.bodies), np.concatenate(pairs)).parts
    touched = np.unique(labels[np.concatenate(together)])
    result = [pair for pair in systems if labels[pair[0][0]] not in touched]
    for part in touched:
        slots = np.flatnonzero(labels == part)
        damping, stiffness = np.diag(model.damping[slots]), np.diag(model.stiffness[slots])
        for own, system in systems:
            if labels[own[0]] == part:
                here = np.ix_(*[np.searchsorted(slots, own)] * 2)
                damping[here], stiffness[here] = system.damping, system.stiffness
        result.append((slots, LinearSystem(model.mass[slots], damping, stiffness, model.noise.matrix(slots))))
    return tuple(result)


@kept
def flowing_systems(model: Model) -> tuple[tuple[np.ndarray, LinearSystem], ...]:
    """Return the systems of :func:`coupled_systems` whose couplings flow: the groups of a linear motion."""
    flowing = model.coupled.chosen(model.couplings.flowing).slots
    return tuple(pair for pair in coupled_systems(model) if np.isin(pair[0], flowing).any())


@kept
def flexibility(model: Model) -> np.ndarray:
    """Return the displacement of each body by a unit force on it, infinite for a free one (m N-1), (body,)."""
    with np.errstate(divide="ignore"):
        result = np.where(model.bodies.free, 1.0 / model.stiffness, 0.0)
    for slots, system in coupled_systems(model):
        result[slots] = system.flexibility()
    return result
