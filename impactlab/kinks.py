"""What openings and closings of contacts within a step do to the energy, and the step that keeps it small."""

from __future__ import annotations

import math

import numpy as np

from impactlab.contact import contact_forces
from impactlab.errors import warn
from impactlab.model import Model
from impactlab.scene import Stiffening

KINK_HEATING = 5e-4
"""Largest part of their temperature by which kinks of contact forces may heat bodies."""

WANDERING = 0.1
"""Root mean square of the relative change of the energy of bodies without friction from which on there is a warning."""


def kink_step(model: Model, stiffening: Stiffening, decay: np.ndarray | None = None) -> float:
    """Return the step at which the kinks of contact forces heat no body by more than `KINK_HEATING` (s).

    A force whose slope jumps at the point of contact, such as a linear one, heats the bodies a
    little whenever it opens or closes: measured, by ``0.016 r² (h Ω)⁴`` of their temperature or less, Ω
    being the frequency of the closed contact and r the part of its stiffness that is there at a
    tenth of the thermal penetration (1 for a linear law, 0.2 for Hertz contact). Friction takes
    it away; a body with little of it, or a contact that closes often, needs a smaller step. `decay`
    is the rate at which something takes the heat of each contact away (s-1), friction by default.
    """
    inverse_mass = np.append(1.0 / model.mass, 0.0)
    friction = np.append(model.damping / model.mass**2, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse_stiffness = np.append(1.0 / model.stiffness, 0.0)
        mobility, compliance, friction = (
            item[model.ends].sum(axis=1) for item in (inverse_mass, inverse_stiffness, friction)
        )
        decay = friction / mobility if decay is None else decay
    heated = np.flatnonzero((decay > 0.0) & (stiffening.contacts > 0.0))
    depth, tangent, clearance = (
        item[heated] for item in (stiffening.penetration, stiffening.contacts, model.clearance)
    )
    mobility, compliance, decay = mobility[heated], compliance[heated], decay[heated]
    laws = [contact.law for contact in model.network.contacts.values()]
    early = contact_forces([laws[slot] for slot in heated], 0.1 * depth[:, None])[:, 0] / (0.1 * depth * tangent)
    # how often the gap crosses the point of contact, by Rice's formula
    spring = 1.0 / compliance + np.where(clearance < 0.0, tangent, 0.0)
    with np.errstate(invalid="ignore"):
        spread = stiffening.energy[model.ends[heated].min(axis=1)] * compliance
    known = (spread > 0.0) & (spread < np.inf)
    exponent = -0.5 * np.maximum(clearance, 0.0) ** 2 / np.where(known, spread, np.inf)
    often = np.array([math.exp(item) for item in exponent.tolist()])  # NumPy's own depends on the processor
    rate = np.sqrt(mobility * spring) / (2.0 * math.pi) * often
    counted = (rate > 0.0) & (early > 0.0)
    with np.errstate(over="ignore", divide="ignore"):  # a contact that closes once in 10^300 s heats nothing
        power = KINK_HEATING * decay[counted] / (0.016 * early[counted] ** 2 * rate[counted])
    roots = np.array([item**0.25 for item in power.tolist()])
    return float((roots / np.sqrt(tangent[counted] * mobility[counted])).min(initial=np.inf))


def warn_of_kinks(model: Model, stiffening: Stiffening, step: float, duration: float) -> None:
    """Warn of a step at which the energy of bodies that no friction cools may change by more than `WANDERING`."""
    labels = model.connected()
    slowed = np.concatenate([np.flatnonzero(model.damping > 0.0), model.coupled.min(axis=1)[model.coupling[1] > 0.0]])
    free = ~np.isin(labels[model.ends.min(axis=1)], labels[slowed]) & (not model.dissipative)
    largest = kink_step(model, stiffening, np.where(free, WANDERING**2 / (KINK_HEATING * duration), 0.0))
    if step > largest:
        warn(
            f"Without friction the energy may change by more than {100.0 * WANDERING:g} % in {duration:g} s at the "
            f"automatic step of {step:.3g} s, since contacts open and close within steps; step={largest:.2g} would do."
        )
