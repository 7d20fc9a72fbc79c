"""Contacts between combinations of coordinates: their elongations ``w·q``, and their forces ``−w F``; in a plane."""

from __future__ import annotations

import math

from impactlab.compiling.intrinsics import rows
from impactlab.compiling.jit import scattered


@scattered
def elongations(indices, weights, q, result):  # type: ignore[no-untyped-def]
    """Write the weighted sum of a quantity of the coordinates of every contact.

    indices: `Members.indices`: the first entry tells where the table of the links begins. Its first entry tells how far
        from there the coordinates are; then come the first entry of each link, and the number of all.
    weights: `Members.parameters`, which begin with the weights.
    q: the quantity [coordinate, lane].
    result: [contact, lane].
    """
    begin = indices[0]
    slots = begin + indices[begin]
    for contact in range(result.shape[0]):
        for lane in range(result.shape[1]):
            result[contact, lane] = 0.0
        for entry in range(indices[begin + 1 + contact], indices[begin + 2 + contact]):
            slot, weight = indices[slots + entry], weights[entry]
            for lane in range(result.shape[1]):
                result[contact, lane] += weight * q[slot, lane]


@scattered
def push_back(indices, weights, contact_force, total):  # type: ignore[no-untyped-def]
    """Write the sum of its contacts' forces on every coordinate to `total`; see `elongations`."""
    begin = indices[0]
    slots = begin + indices[begin]
    for slot in range(total.shape[0]):
        for lane in range(total.shape[1]):
            total[slot, lane] = 0.0
    for contact in range(contact_force.shape[0]):
        for entry in range(indices[begin + 1 + contact], indices[begin + 2 + contact]):
            slot, weight = indices[slots + entry], weights[entry]
            for lane in range(total.shape[1]):
                total[slot, lane] -= weight * contact_force[contact, lane]


@scattered
def round_rates(indices, weights, x, v, result):  # type: ignore[no-untyped-def]
    """Write the rates of the indentations of contacts in a plane, which have no `elongations`.

    indices, weights: as there; the third entry of the indices tells where the table of these contacts begins: their
        number, then of each the contact and its links along x and y. Their centers follow the weights.
    x, v: displacements and velocities [coordinate, lane].
    result: [contact, lane].
    """
    begin, at = indices[0], indices[2]
    slots = begin + indices[begin]
    centers = indices[slots - 1]
    for number in range(indices[at]):
        contact, along = indices[at + 1 + 3 * number], rows(indices, at + 2 + 3 * number, 2)
        for lane in range(result.shape[1]):
            squares = 0.0
            rate = 0.0
            for direction in range(2):
                off = -weights[centers + 2 * number + direction]
                speed = 0.0
                for entry in range(indices[begin + 1 + along[direction]], indices[begin + 2 + along[direction]]):
                    slot, weight = indices[slots + entry], weights[entry]
                    off += weight * x[slot, lane]
                    speed += weight * v[slot, lane]
                squares += off * off
                rate += off * speed
            result[contact, lane] = rate / math.sqrt(squares) if squares > 0.0 else 0.0
