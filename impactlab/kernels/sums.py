"""Sums over time of one lane each, from which all statistics are estimated.

Steps are kept in a history of four, the *slots*, and added together: the sums are then
read and written once for two steps, and their cost is that of the arithmetic.
"""

from __future__ import annotations

from impactlab.kernels.jit import kernel
from impactlab.kernels.kick import copy

X, V, XX, XV, VV, F, FF, FX, FV = range(9)
"""Rows of the sums over bodies: powers of displacement x and velocity v, and of the force f that a
kick applied; the last four are there for methods that kick."""

CLOSED, FORCE, FLUX, PEAK = range(4)
"""Rows of the sums over contacts: samples in contact, force, weighted closing velocity near the
point of contact, largest force."""

STATE_ROWS, KICK_ROWS, CONTACT_ROWS = 5, 9, 4

SLOTS = 4
"""Steps that are added together."""


@kernel
def empty_slots(history, begin, end):  # type: ignore[no-untyped-def]
    """Fill some slots of a history with zeros, which add nothing to any sum."""
    for slot in range(begin, end):
        for row in range(history.x.shape[1]):
            for lane in range(history.x.shape[2]):
                history.x[slot, row, lane] = 0.0
                history.v[slot, row, lane] = 0.0
                history.force[slot, row, lane] = 0.0
        for contact in range(history.contact_force.shape[1]):
            for lane in range(history.contact_force.shape[2]):
                history.indentation[slot, contact, lane] = 0.0
                history.contact_force[slot, contact, lane] = 0.0


@kernel
def keep(history, slot, x, v, indentation, contact_force):  # type: ignore[no-untyped-def]
    """Copy a state into a slot of a history."""
    copy(x, history.x[slot])
    copy(v, history.v[slot])
    copy(indentation, history.indentation[slot])
    copy(contact_force, history.contact_force[slot])


@kernel
def close_slot(history, slot, last, sums):  # type: ignore[no-untyped-def]
    """Add the history to the sums if the slot is its last one, or the last one of a call."""
    if last or slot == SLOTS - 1:
        empty_slots(history, slot + 1, SLOTS)
        add_history(history, sums)


@kernel
def add_history(history, sums):  # type: ignore[no-untyped-def]
    """Add all slots to the sums; those of different phases of the method's cycle apart."""
    phases = sums.bodies.shape[0]
    for slot in (0, 1):
        phase = slot % phases
        add_states(history.x, history.v, slot, slot + 2, phase, sums.bodies)
        if sums.bodies.shape[1] > F:
            add_forces(history.x, history.v, history.force, slot, slot + 2, phase, sums.bodies)
        if sums.ends.shape[0]:
            add_contacts(history, slot, slot + 2, sums)


@kernel
def add_states(x, v, a, b, phase, sums):  # type: ignore[no-untyped-def]
    """Add the powers of displacement and velocity in slots a and b to ``sums[phase, row, body, lane]``."""
    for body in range(sums.shape[2]):
        for lane in range(sums.shape[3]):
            x0, x1, v0, v1 = x[a, body, lane], x[b, body, lane], v[a, body, lane], v[b, body, lane]
            sums[phase, X, body, lane] += x0 + x1
            sums[phase, V, body, lane] += v0 + v1
            sums[phase, XX, body, lane] += x0 * x0 + x1 * x1
            sums[phase, XV, body, lane] += x0 * v0 + x1 * v1
            sums[phase, VV, body, lane] += v0 * v0 + v1 * v1


@kernel
def add_forces(x, v, f, a, b, phase, sums):  # type: ignore[no-untyped-def]
    """Add the powers of the forces of kicks in slots a and b to ``sums[phase, row, body, lane]``."""
    for body in range(sums.shape[2]):
        for lane in range(sums.shape[3]):
            f0, f1 = f[a, body, lane], f[b, body, lane]
            sums[phase, F, body, lane] += f0 + f1
            sums[phase, FF, body, lane] += f0 * f0 + f1 * f1
            sums[phase, FX, body, lane] += f0 * x[a, body, lane] + f1 * x[b, body, lane]
            sums[phase, FV, body, lane] += f0 * v[a, body, lane] + f1 * v[b, body, lane]


@kernel
def add_contacts(history, a, b, target):  # type: ignore[no-untyped-def]
    """Add the state of the contacts in slots a and b to ``target.contacts[row, contact, lane]``.

    The rate of contacts is a one-sided flux: the closing velocity of bodies near the point of
    contact, weighted by ``1 − 5/3 (δ/ε)²`` inside a window ``|δ| < ε``. The weight has no
    second moment on either side, so that neither slope nor curvature of the density of
    the gap count. Counting sign changes between samples would miss the short contacts.
    """
    v, indentation, force, sums = history.v, history.indentation, history.contact_force, target.contacts
    for contact in range(sums.shape[1]):
        first, second = target.ends[contact, 0], target.ends[contact, 1]
        half = target.window[contact]
        curvature = 5.0 / 3.0 / half**2
        for lane in range(sums.shape[2]):
            d0, d1 = indentation[a, contact, lane], indentation[b, contact, lane]
            f0, f1 = force[a, contact, lane], force[b, contact, lane]
            sums[CLOSED, contact, lane] += (1.0 if d0 > 0.0 else 0.0) + (1.0 if d1 > 0.0 else 0.0)
            sums[FORCE, contact, lane] += f0 + f1
            sums[PEAK, contact, lane] = max(sums[PEAK, contact, lane], max(f0, f1))
        for slot in (a, b):
            for lane in range(sums.shape[2]):
                d = indentation[slot, contact, lane]
                closing = max(v[slot, first, lane] - v[slot, second, lane], 0.0)
                weight = 1.0 - curvature * d * d if abs(d) < half else 0.0
                sums[FLUX, contact, lane] += weight * closing
        if target.half_kick.shape[0]:
            add_flux_around_kicks(history, a, b, contact, curvature, target)


@kernel
def add_flux_around_kicks(history, a, b, contact, curvature, target):  # type: ignore[no-untyped-def]
    """Turn the last flux of a contact into the mean of those before, in the middle of and after a kick.

    At a kick by force gradients K the mean square of the velocity is off by −h²K/6 in its middle
    and by h²K/12 on either side. Where bodies feel other forces than that of the contact,
    the mean of the three is right to second order.
    """
    first, second = target.ends[contact, 0], target.ends[contact, 1]
    half = target.window[contact]
    of_first, of_second = target.half_kick[first], target.half_kick[second]
    v, f, sums = history.v, history.force, target.contacts
    for slot in (a, b):
        for lane in range(sums.shape[2]):
            d = history.indentation[slot, contact, lane]
            closing = v[slot, first, lane] - v[slot, second, lane]
            kick = of_first * f[slot, first, lane] - of_second * f[slot, second, lane]
            excess = max(closing + kick, 0.0) + max(closing - kick, 0.0) - 2.0 * max(closing, 0.0)
            weight = 1.0 - curvature * d * d if abs(d) < half else 0.0
            sums[FLUX, contact, lane] += weight * excess / 3.0


@kernel
def write_snapshot(x, v, contact_force, snapshots, index):  # type: ignore[no-untyped-def]
    """Write displacements, velocities and contact forces to ``snapshots[index, quantity, lane]``."""
    contacts = contact_force.shape[0]
    bodies = (snapshots.shape[1] - contacts) // 2
    for body in range(bodies):
        for lane in range(snapshots.shape[2]):
            snapshots[index, body, lane] = x[body, lane]
        for lane in range(snapshots.shape[2]):
            snapshots[index, bodies + body, lane] = v[body, lane]
    for contact in range(contacts):
        for lane in range(snapshots.shape[2]):
            snapshots[index, 2 * bodies + contact, lane] = contact_force[contact, lane]
