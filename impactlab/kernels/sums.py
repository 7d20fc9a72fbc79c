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
"""Rows of the sums over contacts: samples in contact, force, relative velocity of closing
bodies near the point of contact, largest force."""

STATE_ROWS, KICK_ROWS, CONTACT_ROWS = 5, 9, 4

PAIR_ROWS = 9
"""Rows of the sums over pairs of bodies: products of x, v, f of the first and x, v, f of the second."""

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
            add_contacts(
                history.v, history.indentation, history.contact_force, slot, slot + 2, sums.ends, sums.window,
                sums.contacts,
            )  # fmt: skip
    if sums.pairs.shape[0]:
        add_products(history.x, history, sums.pairs, 0, sums.products)
        add_products(history.v, history, sums.pairs, 3, sums.products)
        add_products(history.force, history, sums.pairs, 6, sums.products)


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
def add_contacts(v, indentation, force, a, b, ends, window, sums):  # type: ignore[no-untyped-def]
    """Add the state of the contacts in slots a and b to ``sums[row, contact, lane]``.

    The rate of contacts is a one-sided flux: the mean closing velocity inside a window
    of indentations around 0, over the width of the window. Counting sign changes between
    samples would miss the short ones.

    Parameters
    ----------
    v : [slot, body, lane]
        Velocities; the last body is the wall.
    indentation, force : [slot, contact, lane]
        State of the contacts.
    a, b : int
        Slots.
    ends : (contact, 2) ndarray of int
        Slots of the two bodies.
    window : (contact,) ndarray
        Half the width of the window (m).
    sums : (4, contact, lane) ndarray
    """
    for contact in range(sums.shape[1]):
        first, second = ends[contact, 0], ends[contact, 1]
        half = window[contact]
        for lane in range(sums.shape[2]):
            d0, d1 = indentation[a, contact, lane], indentation[b, contact, lane]
            f0, f1 = force[a, contact, lane], force[b, contact, lane]
            w0 = v[a, first, lane] - v[a, second, lane]
            w1 = v[b, first, lane] - v[b, second, lane]
            flux = (w0 if abs(d0) < half and w0 > 0.0 else 0.0) + (w1 if abs(d1) < half and w1 > 0.0 else 0.0)
            sums[CLOSED, contact, lane] += (1.0 if d0 > 0.0 else 0.0) + (1.0 if d1 > 0.0 else 0.0)
            sums[FORCE, contact, lane] += f0 + f1
            sums[FLUX, contact, lane] += flux
            sums[PEAK, contact, lane] = max(sums[PEAK, contact, lane], max(f0, f1))


@kernel
def add_products(left, history, pairs, row, sums):  # type: ignore[no-untyped-def]
    """Add a quantity of the first times x, v and f of the second body of each pair, in all slots, from a row on."""
    x, v, f = history.x, history.v, history.force
    for pair in range(sums.shape[1]):
        i, j = pairs[pair, 0], pairs[pair, 1]
        for lane in range(sums.shape[2]):
            a, b, c, d = left[0, i, lane], left[1, i, lane], left[2, i, lane], left[3, i, lane]
            of_x = a * x[0, j, lane] + b * x[1, j, lane] + c * x[2, j, lane] + d * x[3, j, lane]
            of_v = a * v[0, j, lane] + b * v[1, j, lane] + c * v[2, j, lane] + d * v[3, j, lane]
            of_f = a * f[0, j, lane] + b * f[1, j, lane] + c * f[2, j, lane] + d * f[3, j, lane]
            sums[row, pair, lane] += of_x
            sums[row + 1, pair, lane] += of_v
            sums[row + 2, pair, lane] += of_f


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
