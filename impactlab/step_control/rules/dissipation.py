"""Forces that depend on velocities: how fast they slow bodies down, and the step that resolves it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.contact import contact_forces
from impactlab.components.evaluation import call_each, distinct, of_classes
from impactlab.step_control.rules.tangent_stiffness import Stiffening

OF_CONTACTS = 0.2
"""Rate of a contact times step up to which its damping is resolved: E[v²] within 0.5 %."""

OF_BODIES = 0.07
"""The same for a force that always acts."""

DRY = 3.0
"""Largest root mean square of a rate that counts, as a multiple of its mean: that of dry friction is infinite, but a
kick stops a body and does not throw it back. With ``tanh(v/v₀)`` E[v²] is as far off for all v₀ below 0.02 σ_v."""

DEPTHS = (0.0, 0.25, 0.5, 1.0)
"""Indentations at which a contact's dependence on the rate is looked at, as parts of its penetration."""

DISPLACEMENTS = (-1.5, -0.75, 0.0, 0.75, 1.5)
"""Displacements and extensions at which others are looked at, in standard deviations."""

SLOPE = 0.5
"""Steepest slope of a force in the velocity, over the mass, times a step up to which an explicit method resolves it."""

NEAR_REST = np.concatenate([-np.logspace(0.5, -3.0, 36), np.logspace(-3.0, 0.5, 36)])
"""Velocities between which the slope is taken, in standard deviations: down to 1/1000. Where a force changes its sign
within less, an explicit method chatters about rest with velocities of about that size."""

SPEEDS = np.linspace(-3.0, 3.0, 65)
"""Velocities, in standard deviations."""


@kept
def damping_step(model: Model, stiffening: Stiffening) -> float:
    """Return the step that resolves forces that depend on velocities (s); infinite where there are none."""
    if not model.kicks.dissipative:
        return math.inf
    contacts, couplings, bodies = damping_rates(model, stiffening)
    fastest = max(
        contacts.max(initial=0.0) / OF_CONTACTS,
        couplings[model.kicks.links[len(model.ends) :]].max(initial=0.0) / OF_BODIES,
        bodies.max(initial=0.0) / OF_BODIES,
    )
    return 1.0 / float(fastest) if fastest > 0.0 else math.inf


def damping_rates(model: Model, stiffening: Stiffening) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rates at which contacts, couplings and residual forces slow bodies down (s-1), (contact,), … (body,).

    They are means (of contacts) and root mean squares (of what always acts) of ``∂F/∂v Σ w²/m`` over normal velocities
    of the energy that the bodies bring, at some indentations, extensions or displacements.
    """
    mobility, energy = 1.0 / model.mass, np.where(np.isfinite(stiffening.energy), stiffening.energy, 0.0)
    depths, of_contacts = np.multiply.outer(stiffening.penetration, DEPTHS), energy[model.first_of(model.ends)]
    along, times = model.ends.squares(mobility), stiffening.times
    contacts = _rates(model.contacts.laws, "force", depths, along, of_contacts, times, 1.0)
    contacts += _friction_rates(model, depths, along, of_contacts, times)
    of_couplings = energy[model.first_of(model.coupled)]
    extensions, along = _places(of_couplings, stiffening.couplings), model.coupled.squares(mobility)
    couplings = _rates(model.couplings.laws, "force", extensions, along, of_couplings, times)
    bodies, residual = np.zeros(len(model.mass)), np.flatnonzero(model.bodies.residual)
    bent = [model.bodies.oscillators[slot] for slot in residual.tolist()]
    displacements = _places(energy, model.stiffness + stiffening.bodies)[residual]
    bodies[residual] = _rates(bent, "residual", displacements, mobility[residual], energy[residual], times)
    return contacts, couplings, bodies


@kept
def slope_step(model: Model, stiffening: Stiffening) -> float:
    """Return the step at which an explicit method resolves the steepest slope in velocities of what always acts (s).

    That of smooth dry friction is at rest, far above its mean; of contacts in a plane it counts as well.
    """
    mobility, energy = 1.0 / model.mass, np.where(np.isfinite(stiffening.energy), stiffening.energy, 0.0)
    of_couplings, along = energy[model.first_of(model.coupled)], model.coupled.squares(mobility)
    residual = np.flatnonzero(model.bodies.residual)
    members = [
        *((law, "force") for law in model.couplings.laws),
        *((model.bodies.oscillators[slot], "residual") for slot in residual),
    ]
    numbers = np.append(of_couplings, energy[residual]), np.append(along, mobility[residual])
    steepest = _steepest_friction(model, stiffening)
    for (member, kernel), heat, lightness in dict.fromkeys(
        zip(members, *(row.tolist() for row in numbers), strict=True)
    ):
        if _VELOCITIES.isdisjoint(member.kernel(kernel)[1]) or heat == 0.0:
            continue
        speed = math.sqrt(heat * lightness) * NEAR_REST
        for time in stiffening.times:
            force = call_each([member], kernel, np.zeros((1, len(speed))), speed[None], np.full((1, 1), time))[0]
            steepest = max(steepest, lightness * float((np.diff(force) / np.diff(speed)).max()))
    return SLOPE / steepest if steepest > 0.0 else math.inf


def _friction_rates(
    model: Model, depths: np.ndarray, along: np.ndarray, energy: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Return the rates of the friction of contacts in a plane at some of their indentations, (contact,) (s-1)."""
    slots, frictions = _frictions(model)
    rates = np.zeros(len(model.ends))
    if slots.size:
        pressing = contact_forces([model.contacts.laws[slot] for slot in slots], depths[slots])
        rates[slots] = _rates(frictions, "force", pressing, along[slots], energy[slots], times, 1.0)
    return rates


def _steepest_friction(model: Model, stiffening: Stiffening) -> float:
    """Return the largest rate of the friction of contacts in a plane, at rest and at their penetrations (s-1)."""
    slots, frictions = _frictions(model)
    if not slots.size:
        return 0.0
    laws, along = [model.contacts.laws[slot] for slot in slots], model.ends.squares(1.0 / model.mass)[slots]
    pressing = contact_forces(laws, stiffening.penetration[slots, None])[:, 0]
    slopes = np.array([item.friction_coefficient / item.friction_velocity for item in frictions])
    return float((along * slopes * pressing).max())


def _frictions(model: Model) -> tuple[np.ndarray, list[Any]]:
    """Return the contacts in a plane that have friction, and its laws."""
    slots, contacts = np.flatnonzero(model.contacts.round).tolist(), list(model.network.contacts.values())
    frictions = {slot: contacts[slot].friction for slot in slots}
    sliding = [slot for slot in slots if frictions[slot] is not None]
    return np.array(sliding, dtype=np.int64), [frictions[slot] for slot in sliding]


def _places(energy: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Return `DISPLACEMENTS` of springs at some energies (m), 0 where there is no spring, (spring, place)."""
    deviation = np.sqrt(np.divide(energy, stiffness, out=np.zeros_like(energy), where=stiffness > 0.0))
    return np.asarray(np.multiply.outer(deviation, DISPLACEMENTS))


def _rates(
    members: Sequence[Any],
    kernel: str,
    places: np.ndarray,
    mobility: np.ndarray,
    energy: np.ndarray,
    times: np.ndarray,
    most: float = DRY,
) -> np.ndarray:
    """Rates of some members at their places, (member, place), worked out once for those that are equal.

    They are root mean squares, but at most so many times the mean; of laws that depend on time at the worst of some
    times.
    """
    result = np.zeros(len(members))
    depends = of_classes(lambda kind: not _VELOCITIES.isdisjoint(kind.kernel(kernel)[1]), members)
    slowing = np.flatnonzero(depends)
    rows = np.concatenate([[mobility[slowing], energy[slowing]], places[slowing].T])

    def of_members(chosen: Sequence[Any], mobility: np.ndarray, energy: np.ndarray, *at: np.ndarray) -> np.ndarray:
        deviation = np.sqrt(energy * mobility)
        place, speed = np.broadcast_arrays(np.stack(at, axis=1)[:, :, None], deviation[:, None, None] * SPEEDS)
        at_points = [item.reshape(len(chosen), -1) for item in (place, speed)]
        worst = np.zeros(len(chosen))
        for time in times[:, None, None]:
            force = call_each(chosen, kernel, *at_points, time).reshape(speed.shape)
            change = np.abs(np.diff(force, axis=2)).swapaxes(1, 2)
            mean = (_DENSITY @ change).mean(axis=1)
            root = np.sqrt((_DENSITY @ change**2).mean(axis=1) / (SPEEDS[1] - SPEEDS[0]))
            with np.errstate(divide="ignore", invalid="ignore"):
                rates = np.where(deviation > 0.0, np.minimum(root, most * mean) * mobility / deviation, 0.0)
            worst = np.maximum(worst, rates)
        return worst

    if slowing.size:
        first, which = distinct([members[row] for row in slowing.tolist()], [*rows])
        result[slowing] = of_members([members[row] for row in slowing[first].tolist()], *rows[:, first])[which]
    return result


_VELOCITIES = {"rate", "velocity"}

_MIDDLES = 0.5 * (SPEEDS[1:] + SPEEDS[:-1])
_DENSITY = np.array([math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi) for z in _MIDDLES.tolist()])
