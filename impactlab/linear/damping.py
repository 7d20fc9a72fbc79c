"""Damping that is in residual forces: what it does to the energy of a body, as a linear damper would."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.evaluation import call_each
from impactlab.components.oscillator import Oscillator

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(8)
_X, _V = (item.ravel() for item in np.meshgrid(_NODES, _NODES))
_SHARE = np.outer(_WEIGHTS, _WEIGHTS).ravel() / (2.0 * math.pi)

_DECADES = 40
"""Decades above and below the scale of a body between which its energy is looked for."""


@kept
def damped(model: Model) -> tuple[Model, Model]:
    """Return the network with linear dampers in the place of residual forces that depend on the velocity.

    The energy θ of a body alone is where such a force and the damper take the power P(θ) that white noise brings, on
    average over displacements and velocities that are normal, with the temperature θ. Without noise it is where a force
    that drives slow motion takes as much at fast motion. The dampers of the first network, which is for energies, keep
    that energy; those of the second, for relaxation times, let small deviations from it decay as they do. The network
    itself where nothing depends on the velocity, or a force takes no power at any energy.
    """
    heat, decay = model.damping.copy(), model.damping.copy()
    for slot in np.flatnonzero(model.bodies.residual).tolist():
        body = model.bodies.oscillators[slot]
        if "velocity" in body.kernel("residual")[1]:
            power_in = float(np.pi * model.noise.intensity[slot] / model.mass[slot])
            energy = _balance(body, power_in)
            if energy > 0.0:
                below, above = _power(body, np.array([0.9, 1.1]) * energy)
                heat[slot] = model.mass[slot] * power_in / energy
                decay[slot] = model.mass[slot] * float(above - below) / (0.2 * energy)
    if (heat == model.damping).all() and (decay == model.damping).all():
        return model, model
    return replace(model, damping=heat), replace(model, damping=decay)


def _balance(body: Oscillator, power_in: float) -> float:
    """Return the least energy at which a body takes some power (J), 0 if there is none."""
    scale = power_in * math.sqrt(body.mass / body.stiffness) if body.stiffness else power_in
    energies = (scale or 1.0) * 10.0 ** np.arange(-_DECADES, _DECADES + 1.0)
    left = _power(body, energies) - power_in
    if not power_in and not (left < 0.0).any():
        return 0.0  # it comes to rest
    above = (left > 0.0) & (np.cumsum(left < 0.0) > 0)
    if not above.any():
        return 0.0
    first = int(np.argmax(above))
    low, high = (math.log(item) for item in energies[first - 1 : first + 1])
    for _ in range(40):
        middle = 0.5 * (low + high)
        more = _power(body, np.array([math.exp(middle)]))[0] > power_in
        low, high = (low, middle) if more else (middle, high)
    return math.exp(0.5 * (low + high))


def _power(body: Oscillator, energies: np.ndarray) -> np.ndarray:
    """Return the mean power lost to the damper and the residual force at given energies (W); 0 on overflow."""
    velocity = np.sqrt(energies / body.mass)[:, None] * _V
    with np.errstate(all="ignore"):
        displacement = _deviations(body, energies)[:, None] * _X
        force, elastic = (_residual(body, displacement, item) for item in (velocity, np.zeros_like(velocity)))
        power = ((body.damping * velocity + force - elastic) * velocity) @ _SHARE
    return np.where(np.isfinite(power), power, 0.0)


def _deviations(body: Oscillator, energies: np.ndarray) -> np.ndarray:
    """Return standard deviations of the displacement at some energies: of the spring, or what a residual force allows.

    The residual force is looked at at rest: they are where the mean of ``x (k x + residual)`` is the energy.
    """
    trials = np.sqrt(energies.max() / (body.stiffness or 1.0)) * 10.0 ** np.arange(-2.0 * _DECADES, 20.0, 0.25)
    displacement = trials[:, None] * _NODES
    force = body.stiffness * displacement + _residual(body, displacement, np.zeros_like(displacement))
    virial = (displacement * force) @ (_WEIGHTS / math.sqrt(2.0 * math.pi))
    virial = np.maximum.accumulate(np.where(np.isfinite(virial), virial, 0.0))
    rising = np.flatnonzero(np.diff(virial, prepend=0.0) > 0.0)
    if not rising.size:
        return np.zeros_like(energies)
    return np.asarray(np.exp(np.interp(np.log(energies), np.log(virial[rising]), np.log(trials[rising]))))


def _residual(body: Oscillator, displacement: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    return np.asarray(call_each([body] * len(displacement), "residual", displacement, velocity))
