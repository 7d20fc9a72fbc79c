"""The log of events, and the impacts that they end.

A row of the log is written by `note` at each event, once the contact has its state after it, in the order of time, and
at one time in that of cause and effect: where a contact closes (OPEN to CLOSED), where its force ends before it opens
or begins anew (CLOSED to PARTED, PARTED to CLOSED), where it opens (CLOSED, PARTED or HELD to OPEN), where a rigid
contact bounces (OPEN to OPEN) or comes to rest (OPEN to HELD), where dry friction, a row behind the contacts, sticks or
slips. A contact at rest that is hit has two rows: its rest ends, and it bounces or rests again. Events of the spin-up
are in the log as well, at times below 0.

The columns tell `WHEN` it was (s), the number `OF_CONTACT`, its states `BEFORE` and `AFTER`, and the rate of its gap as
`RATE_BEFORE` (m s-1, positive where it closes). A row with the state OPEN after the event ends an impact, and has in
the other columns when this `BEGAN` (s), the velocities of `CLOSING` and `LEAVING` (m s-1), its `DURATION` (s), 0 for a
bounce, and since t = 0 its `IMPULSE` (N s), its `LARGEST` force (N), NaN where it has none, and the `LOST_ENERGY` (J),
the work done on the contact. `CLOSING` is NaN where the contact was closed at the start. In other rows these columns
are NaN.

While an impact goes on, its numbers from `BEGAN` on are in the rows of the sums of its contact from `OF_IMPACT` on, in
the same order: `begin_impact` sets them, and whoever follows the motion adds to those from `DURATION` on. Impacts that
have not ended when a run does are read there.
"""

from __future__ import annotations

import math

from impactlab.compiling.jit import kernel

WHEN, OF_CONTACT, BEFORE, AFTER, RATE_BEFORE = range(5)
"""Columns of an event."""

BEGAN, CLOSING, LEAVING, DURATION, IMPULSE, LARGEST, LOST_ENERGY = range(5, 12)
"""Columns of the impact that an event ends."""

EVENT = LOST_ENERGY + 1
"""How many these are."""

OF_IMPACT = 8
"""First row of an impact among the sums of its contact."""

SUMS = OF_IMPACT + EVENT - BEGAN
"""Rows of these sums."""

RESERVED = 4
"""Rows of the log that are free before an event, at least, and as many for each pair of contacts: an impact may set
off others at the same time."""

RESERVED_NODES = 512
"""Nodes for which there is room before a part of the motion, at least."""

NODE_TIME, NODE_WEIGHT, NODE_STATE = range(3)
"""Columns of a node: its time and its weight in integrals over time (s); from the last one on displacements,
velocities, forces, and states of laws."""


@kernel
def log_full(lanes, lane):  # type: ignore[no-untyped-def]
    """Whether the log of a lane has to be emptied before the next event."""
    contacts, room = lanes.contacts.shape[2], lanes.log.shape[1]
    return room > 0 and lanes.logged[lane] + RESERVED * (1 + contacts * contacts) > room


@kernel
def nodes_full(lanes, lane):  # type: ignore[no-untyped-def]
    """Whether the nodes of a lane have to be handed on before the next part of its motion."""
    room = lanes.nodes.shape[1]
    return room > 0 and lanes.noded[lane] + RESERVED_NODES > room


@kernel
def begin_impact(lanes, lane, time, contact, rate):  # type: ignore[no-untyped-def]
    """Let an impact begin at a closing velocity."""
    for row in range(OF_IMPACT, lanes.contacts.shape[1]):
        lanes.contacts[lane, row, contact] = 0.0
    lanes.contacts[lane, OF_IMPACT, contact] = time
    lanes.contacts[lane, OF_IMPACT + CLOSING - BEGAN, contact] = rate


@kernel
def note(lanes, lane, time, contact, before, rate, leaving):  # type: ignore[no-untyped-def]
    """Note an event, if there is a log; rows that it has no room for are counted.

    The leaving velocity is NaN unless the event ends an impact.
    """
    place = lanes.logged[lane]
    if lanes.log.shape[1] == 0:
        return
    lanes.logged[lane] += 1
    if place >= lanes.log.shape[1]:
        return
    row = lanes.log[lane, place]
    row[WHEN], row[OF_CONTACT], row[BEFORE], row[RATE_BEFORE] = time, contact, before, rate
    row[AFTER] = lanes.statuses[lane, contact]
    for column in range(BEGAN, EVENT):
        row[column] = math.nan
        if not math.isnan(leaving):
            row[column] = lanes.contacts[lane, OF_IMPACT + column - BEGAN, contact]
            if column == LEAVING:
                row[column] = leaving
    if lanes.states.shape[1] > 0:
        bodies = lanes.x.shape[1]
        for body in range(bodies):
            lanes.states[lane, place, body] = lanes.x[lane, body]
            lanes.states[lane, place, bodies + body] = lanes.v[lane, body]
