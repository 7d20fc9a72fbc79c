"""Contacts between combinations of coordinates: their elongations ``w·q``, and their forces ``−w F``."""

from __future__ import annotations

from impactlab.kernels.jit import scattered


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
