"""Sums over time of one lane each, from which all statistics are estimated."""

from __future__ import annotations

from impactlab.kernels.jit import kernel

X, V, XX, XV, VV, G, GG, GX, GV = range(9)
"""Rows of the sums over bodies: powers of displacement x and velocity v, and of the velocity
increment g that a kick applied; the last four are there for methods that kick."""

CLOSED, FORCE, FLUX, PEAK = range(4)
"""Rows of the sums over contacts: samples in contact, force, relative velocity of closing
bodies near the point of contact, largest force."""

STATE_ROWS, KICK_ROWS, CONTACT_ROWS = 5, 9, 4


@kernel
def add_state(x, v, sums):  # type: ignore[no-untyped-def]
    """Add the powers of displacement and velocity to ``sums[row, body, lane]``."""
    for body in range(sums.shape[1]):
        for lane in range(sums.shape[2]):
            sums[X, body, lane] += x[body, lane]
        for lane in range(sums.shape[2]):
            sums[V, body, lane] += v[body, lane]
        for lane in range(sums.shape[2]):
            sums[XX, body, lane] += x[body, lane] * x[body, lane]
        for lane in range(sums.shape[2]):
            sums[XV, body, lane] += x[body, lane] * v[body, lane]
        for lane in range(sums.shape[2]):
            sums[VV, body, lane] += v[body, lane] * v[body, lane]


@kernel
def add_kick(x, v, total, coefficients, column, sums):  # type: ignore[no-untyped-def]
    """Add the powers of the velocity increments ``coefficient total`` to ``sums[row, body, lane]``."""
    for body in range(sums.shape[1]):
        c = coefficients[body, column]
        for lane in range(sums.shape[2]):
            sums[G, body, lane] += c * total[body, lane]
        for lane in range(sums.shape[2]):
            g = c * total[body, lane]
            sums[GG, body, lane] += g * g
        for lane in range(sums.shape[2]):
            sums[GX, body, lane] += c * total[body, lane] * x[body, lane]
        for lane in range(sums.shape[2]):
            sums[GV, body, lane] += c * total[body, lane] * v[body, lane]


@kernel
def add_contacts(v, ends, window, indentation, force, sums):  # type: ignore[no-untyped-def]
    """Add the state of the contacts to ``sums[row, contact, lane]``.

    The rate of contacts is a one-sided flux: the mean closing velocity inside a window
    of indentations around 0, over the width of the window. Counting sign changes between
    samples would miss the short ones.

    Parameters
    ----------
    v : [body, lane]
        Velocities; the last row is the wall's.
    ends : (contact, 2) ndarray of int
        Slots of the two bodies.
    window : (contact,) ndarray
        Half the width of the window (m).
    indentation, force : [contact, lane]
        State of the contacts.
    sums : (4, contact, lane) ndarray
    """
    for contact in range(sums.shape[1]):
        first, second = ends[contact, 0], ends[contact, 1]
        half = window[contact]
        for lane in range(sums.shape[2]):
            sums[CLOSED, contact, lane] += 1.0 if indentation[contact, lane] > 0.0 else 0.0
        for lane in range(sums.shape[2]):
            sums[FORCE, contact, lane] += force[contact, lane]
        for lane in range(sums.shape[2]):
            closing = v[first, lane] - v[second, lane]
            near = abs(indentation[contact, lane]) < half and closing > 0.0
            sums[FLUX, contact, lane] += closing if near else 0.0
        for lane in range(sums.shape[2]):
            sums[PEAK, contact, lane] = max(sums[PEAK, contact, lane], force[contact, lane])


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
