"""Dry friction from event to event: when it slips, when it sticks, and what this changes.

A friction that slips is a constant force, one that sticks holds the velocity of its direction. Its functionals are the
slip rate and the force that would hold this, or by how much the force that holds it is beyond the breakaway force,
either way. Behind a spring it sticks
wherever its slip rate passes 0.
"""

from __future__ import annotations

from impactlab.compiling.jit import kernel, seldom_called
from impactlab.kernels.contact_states import (
    EFFECTIVE_MASS,
    JENKINS,
    SLIPS_DOWN,
    SLIPS_UP,
    STICK_FORCE,
    STICKS,
)
from impactlab.kernels.pieces import SIGNIFICANT


@kernel
def watched_of_friction(status, other):  # type: ignore[no-untyped-def]
    """Return the sign with which a functional of a friction stays negative, 0 if there is none."""
    if status == STICKS:
        return 1.0
    if other:
        return 0.0
    return -1.0 if status == SLIPS_UP else 1.0


@seldom_called
def slip_or_stick(scene, lane, lanes, functional, rate, holding):  # type: ignore[no-untyped-def]
    """Let a friction begin to slip, or turn or stick where its slip rate has come to 0.

    It turns where the force that would hold it, while all others go on as before, is beyond the breakaway force the
    other way, and sticks elsewhere; what this makes of others, the search finds. `rate` is what rounding has left of
    the slip rate.
    """
    link, before = functional // 2, lanes.statuses[lane, functional // 2]
    back = -holding if before == SLIPS_UP else holding
    if before == STICKS:
        lanes.statuses[lane, link] = SLIPS_UP if functional % 2 == 0 else SLIPS_DOWN
    elif scene.kinds[link] == JENKINS:
        lanes.statuses[lane, link] = STICKS
    elif back > scene.contacts[lane, link, STICK_FORCE]:
        lanes.statuses[lane, link] = SLIPS_DOWN if before == SLIPS_UP else SLIPS_UP
    else:
        lanes.statuses[lane, link] = STICKS
        for body in range(lanes.v.shape[1]):
            push = scene.contacts[lane, link, EFFECTIVE_MASS] * scene.pushes[lane, link, body]
            lanes.v[lane, body] -= rate * push


@seldom_called
def after_impact(scene, lane, lanes, link, contact, impulse, rate, size):  # type: ignore[no-untyped-def]
    """Let a friction slip where an impact of a contact has changed its slip rate, which is `rate` after it."""
    change, terms = 0.0, 0.0
    for body in range(lanes.v.shape[1]):
        part = scene.links[lane, link, body] * scene.pushes[lane, contact, body]
        change += part
        terms += abs(part)
    if abs(change) <= SIGNIFICANT * terms or abs(impulse * change) <= SIGNIFICANT * size:
        return
    if scene.kinds[link] == JENKINS:  # its spring gives way
        turns = rate >= 0.0 if lanes.statuses[lane, link] == SLIPS_DOWN else rate <= 0.0
        if turns:
            lanes.statuses[lane, link] = STICKS
    elif abs(rate) <= SIGNIFICANT * (size + abs(impulse) * terms):
        lanes.statuses[lane, link] = STICKS
    else:
        lanes.statuses[lane, link] = SLIPS_UP if rate > 0.0 else SLIPS_DOWN
