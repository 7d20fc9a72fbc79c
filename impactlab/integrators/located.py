"""Events that mechanisms locate within the flow of a step.

The loop knows no such mechanism. At some moments of each step it calls a function of every one, with the address of the
arrays of the mechanism, a record whose first field is the address of a `Within`, and with the number of the step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from impactlab.compiling.intrinsics import address_of, call, number_at, write_at
from impactlab.compiling.jit import inlined
from impactlab.compiling.records import Numbers, Slots, address
from impactlab.compiling.scalars import scalar
from impactlab.integrators.arguments import Within, slot_of
from impactlab.kernels.sums import SLOTS

OWN, AFTER_FLOW, AFTER_KICK, AFTER_STEP = range(4)
"""Columns of `Tables.events`: where the arrays of a mechanism are, and what it does after the flow of a step, after the
kick that ends it, and when the step is done, where there are snapshots."""

ROUNDING = 1e-14
"""Part of the size of a displacement or velocity of a contact or link up to which it is 0."""

WithinAddress = address(Within)
"""Annotation of the first field of the arrays of a mechanism, by which it finds the steps."""


class Step(NamedTuple):
    """A step as mechanisms see it that locate events."""

    begin: Any  # displacements before the step [body, lane]
    before: Any  # velocities before it
    pushed: Any  # force of the kick before it; no longer there when the step is done
    x: Any  # displacements after the flow, which may be changed
    v: Any  # velocities after the flow, and from the kick on after that, which may be changed
    reading: Any  # displacements at which the kick is read
    middle: Any  # velocities in the middle of the kick
    force: Any  # of the kick [body, lane]
    indentation: Any  # [contact, lane]
    contact_force: Any  # [contact, lane]
    place: int  # of the step in the call


class Follower(NamedTuple):
    """How a mechanism is told that bodies are struck which another one follows through the step."""

    own: int  # address of the arrays of the other
    struck: int  # address of a function that changes velocities of the bodies of a link within the step; 0 for none
    moved: int  # the same for displacements at its end
    changes: Numbers  # (entry + 1,) what is changed of each entry, and the time
    which: Slots  # (2,) link and lane


NO_FOLLOWER = Follower(0, 0, 0, np.zeros(1), np.zeros(2, dtype=np.int64))
"""What a mechanism has where no other one follows bodies."""


@scalar
def step_of(within, now):  # type: ignore[no-untyped-def]
    """Return a step of a call."""
    state, history, index = within.state, within.history, now - within.steps.first
    slot, past = slot_of(history, now % SLOTS), slot_of(history, (now - 1) % SLOTS)
    begin, pushed = (past.x, past.force) if index else (state.x, state.total)
    return Step(
        begin, within.before, pushed, slot.x, state.v, state.reading, slot.v, slot.force, slot.indentation,
        slot.contact_force, index,
    )  # fmt: skip


@inlined
def open_call(tables, state, history, steps):  # type: ignore[no-untyped-def]
    """Let all mechanisms that locate events find the steps of a call."""
    within = number_at(address_of(Within(state, history, tables.before, steps)))
    for mechanism in range(tables.events.shape[0]):
        write_at(within, tables.events[mechanism, OWN])


@inlined
def happen(moment, events, now):  # type: ignore[no-untyped-def]
    """Let all mechanisms that locate events do what they do at a moment of a step."""
    for mechanism in range(events.shape[0]):
        if events[mechanism, moment]:
            call(events[mechanism, moment], events[mechanism, OWN], now)
