"""Where closings of contacts are counted, and where a flux near the point of contact is the better rate."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.mechanism import Mode, refusing
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.contact import contact_forces
from impactlab.integrators.base import Integrator
from impactlab.linear.laws import correlated_systems, flexibility, hottest, linear_variances, lines_of
from impactlab.step_control.rules.tangent_stiffness import Stiffening

COLDER = 4.0
"""Ratio of the temperature of the bodies to that of their relative motion up to which the penetration is the length
over which the density of the gap varies."""

SHALLOW = 0.01
"""Part of the penetration down to which a force must fall at least like the power `LEAST_EXPONENT`."""

LEAST_EXPONENT = 0.9
"""This power: a force that acts sooner bends the density of the gap within any window."""

STEADY_KICK = 0.05
"""Largest half kick by a static load, in thermal velocities; a third of its square is the error of the flux."""

PRESSED = 0.5
"""Overlap at rest, as a part of the penetration, from which on the forces on a body at a closing do not fluctuate
around 0: the flux had 0.7 % too many closings in two pairs with an overlap of 1.3, and 0.1 % with 0.5."""

STOPPED = 1.0
"""Friction over a step, ``c h/m``, from which on closings are not counted: counts are 0.6 % too many at 1.5, 1.3 % at
2 and 4 % at 3, while the flux of pressed pairs is within 0.4 %, since kicks are small."""

OWN_KICKS = 0.005
"""Largest ``h² K/6m`` of kicks by residual forces and couplings, which the flux corrects on average only."""


def counts_closings(model: Model, integrator: Integrator, transient: bool, stiffening: Stiffening, step: float) -> bool:
    """Whether contact rates are counted from the path between steps, in a `transient` from a given state always.

    The flux through a window around the point of contact scatters less and does not see the step, as
    long as the law of gap and closing velocity is smooth within the window, and kicks are fluctuations. That is so
    under stationary white noise, with conservative forces that begin smoothly, without loads or residual forces
    that are large at a step, and where bodies of a contact do not move together. Gaps with weights are always counted.
    """
    varying = transient or refusing(model, Mode.SAMPLES) or model.contacts.impulsive.any()
    quiet = not model.sources["intensity"].bodies or not integrator.kicks
    if varying or quiet or model.kicks.dissipative or not model.ends.plain:
        return bool(len(model.ends))
    touching = model.ends.coordinates()
    return _sudden(model, stiffening) or bool(_kicked(model, stiffening, step)[touching].any())


@kept
def _sudden(model: Model, stiffening: Stiffening) -> bool:
    """Whether a force begins too suddenly, or bodies of a contact move together."""
    depth = stiffening.penetration[:, None]
    early, late = contact_forces(model.contacts.laws, depth * np.array([[SHALLOW, 1.0]])).T
    abrupt = early > SHALLOW**LEAST_EXPONENT * np.abs(late)
    return bool(abrupt.any() or _together(model, stiffening).any())


def _together(model: Model, stiffening: Stiffening) -> np.ndarray:
    """Whether the relative motion of the bodies of each contact is much colder than they are, (contact,) of bool."""
    variance = linear_variances(model)[1]
    cold = (model.damping == 0.0) & ~model.bodies.excited & (variance == 0.0)  # as hot as their part
    variance = np.where(cold, hottest(model, model.mass * variance) / model.mass, variance)
    relative = model.ends.squares(variance)
    for slots, system in correlated_systems(model):
        if system.covariance is not None and system.intensity.any():
            relative += model.ends.mixed(system.covariance[len(slots) :, len(slots) :], slots)
    mobility = model.ends.squares(1.0 / model.mass)
    return np.asarray(stiffening.energy[model.first_of(model.ends)] * mobility > COLDER * relative)


def _kicked(model: Model, stiffening: Stiffening, step: float) -> np.ndarray:
    """Whether static loads, residual forces or couplings kick each body too strongly, (body,) of bool."""
    own, between, overlapping, touching = _loads(model, stiffening)
    if not (between | (own > 0.0)).any():
        return np.zeros(len(between), dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        thermal = np.sqrt(stiffening.energy / model.mass)
        static = 0.5 * step / model.mass * np.abs(stiffening.rest) / flexibility(model)
    stopped = (step * model.damping > STOPPED * model.mass)[touching]
    pressed = between & ((overlapping & (not stopped.any())) | (static > STEADY_KICK * thermal))
    return np.asarray(pressed | (step**2 * own / (6.0 * model.mass) > OWN_KICKS))


@kept
def _loads(model: Model, stiffening: Stiffening) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the stiffness of residual forces and couplings that kick each body, whether other forces than one contact
    do, whether a contact presses it, (body,) each, and the slots of all bodies that have contacts.
    """
    kicks = model.kicks.links.copy()
    kicks[: len(model.ends)] = False
    own = model.links.chosen(kicks).with_strengths(stiffening.bodies, stiffening.links[kicks])
    several = model.links.chosen(model.kicks.links).numbers() > 1
    overlapping = np.zeros(model.wall + 1, dtype=bool)
    pressing = -model.clearance > PRESSED * stiffening.penetration
    overlapping[model.ends.chosen(pressing).slots] = True
    return own, several | model.bodies.residual, overlapping[:-1], model.ends.coordinates()


def jitter(model: Model, step: float, duration: float) -> np.ndarray:
    """Return the r.m.s. change of the closing velocity of each contact by noise in a step, (contact,) (m s-1).

    Of noises that are not white, only frequencies around half the step rate count: the steps resolve the
    paths under slower forces.
    """
    times = duration * np.modf(np.arange(64) * 0.5 * (np.sqrt(5.0) - 1.0))[0] if model.noise.varying else np.zeros(1)
    density = np.mean([model.noise.at(float(time)) for time in times], axis=0)
    for item in lines_of(model):
        near = np.abs(np.log2(item.frequencies * step / np.pi)) < 1.0
        if not near.any():
            continue
        own = 0.25 * (item.amplitudes[near] ** 2).sum() / (1.5 * np.pi / step)
        gains = item.gains if item.gains.shape[1] == 1 else item.gains[:, near]
        np.add.at(density, [*item.bodies], (np.abs(gains) ** 2).mean(axis=1) * own)
    for mechanism in model.mechanisms:
        density += mechanism.density(model, np.pi / step)
    return np.asarray(np.sqrt(model.ends.squares(2.0 * np.pi * step * density / model.mass**2)))
