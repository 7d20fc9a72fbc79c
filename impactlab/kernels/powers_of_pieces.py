"""Integrals of products over pieces of motion, from which the energy follows that forces carry from body to body.

A *flow* is the integral of a product of two factors: the force of a contact, the displacement or velocity of a body,
the cosine or sine of a wave, or a given function. The energy that a force along a link gives to a body is its integral
times the velocity of the body.
"""

from __future__ import annotations

import math

from impactlab.compiling.jit import kernel
from impactlab.kernels.contact_states import (
    CLOSED,
    FRICTION,
    HELD,
    SLIP_FORCE,
    SLIPS_DOWN,
    SLIPS_UP,
    STICK_FORCE,
    STICKS,
)
from impactlab.kernels.integrals import integral_of_product, weigh_functional
from impactlab.kernels.pieces import derive

CONTACT_FORCE, DISPLACEMENT, VELOCITY, COSINE, SINE, FUNCTION = range(6)
"""Kinds of factors; each has the number of its contact, body, wave or given function."""


@kernel
def _of_friction(scene, lane, lanes, link, holding):  # type: ignore[no-untyped-def]
    """Return the force of dry friction, from by how much that which holds it is beyond its limit."""
    status = lanes.statuses[lane, link]
    if status == STICKS:
        return holding + scene.contacts[lane, link, STICK_FORCE]
    if status == SLIPS_UP:
        return scene.contacts[lane, link, SLIP_FORCE]
    return -scene.contacts[lane, link, SLIP_FORCE] if status == SLIPS_DOWN else 0.0


@kernel
def _write_factor(scene, pieces, row, lane, lanes, flow, side, count, integrals, weights):  # type: ignore[no-untyped-def]
    """Write the weights of variables in a factor; return its constant part."""
    kind, place = scene.flows[flow, 2 * side], scene.flows[flow, 2 * side + 1]
    for variable in range(count):
        weights[variable] = 0.0
    if kind == CONTACT_FORCE:
        status = lanes.statuses[lane, place]
        if scene.kinds[place] >= FRICTION:
            if status != STICKS:
                return _of_friction(scene, lane, lanes, place, 0.0)
            holding = weigh_functional(pieces, row, 2 * place, 0, scene.frequencies, lane, weights)
            return _of_friction(scene, lane, lanes, place, holding)
        if status in (CLOSED, HELD):
            return weigh_functional(pieces, row, 2 * place + 1, 0, scene.frequencies, lane, weights)
        return 0.0
    if kind in (COSINE, SINE):
        weights[2 * (pieces.sizes[row] + place) + kind - COSINE] = 1.0
        return 0.0
    entry = place + (lanes.x.shape[1] if kind == VELOCITY else 0)
    for variable in range(count):
        weights[variable] = integrals.weights[variable, entry]
    return integrals.steady[entry]


@kernel
def add_powers(scene, pieces, row, lane, lanes, count, length, integrals):  # type: ignore[no-untyped-def]
    """Add the integrals of all products over a part of a piece, in closed form."""
    for flow in range(scene.flows.shape[0]):
        one = _write_factor(scene, pieces, row, lane, lanes, flow, 0, count, integrals, integrals.one)
        other = _write_factor(scene, pieces, row, lane, lanes, flow, 1, count, integrals, integrals.other)
        lanes.flows[lane, flow] += integral_of_product(one, other, count, length, integrals)


@kernel
def _factor(scene, pieces, row, lane, lanes, flow, side, work):  # type: ignore[no-untyped-def]
    """Return a factor at the time of a motion, whose state has been taken."""
    kind, place, motion = scene.flows[flow, 2 * side], scene.flows[flow, 2 * side + 1], work.motion
    if kind == CONTACT_FORCE:
        status = lanes.statuses[lane, place]
        if scene.kinds[place] >= FRICTION:
            if status != STICKS:
                return _of_friction(scene, lane, lanes, place, 0.0)
            derive(pieces, row, 2 * place, 1, 0, scene.frequencies, lane, motion)
            return _of_friction(scene, lane, lanes, place, motion.levels[0])
        if status in (CLOSED, HELD):
            derive(pieces, row, 2 * place + 1, 1, 0, scene.frequencies, lane, motion)
            return motion.levels[0]
        return 0.0
    if kind in (COSINE, SINE):
        return motion.turns[2 * place + kind - COSINE]
    if kind == FUNCTION:
        return motion.given.values[place, 0]
    return work.state[place + (lanes.x.shape[1] if kind == VELOCITY else 0)]


@kernel
def add_node_of_flows(scene, pieces, row, lane, lanes, weight, work):  # type: ignore[no-untyped-def]
    """Add a node of the integrals of all products over a part of a piece."""
    for flow in range(scene.flows.shape[0]):
        one = _factor(scene, pieces, row, lane, lanes, flow, 0, work)
        other = _factor(scene, pieces, row, lane, lanes, flow, 1, work)
        lanes.flows[lane, flow] += weight * one * other


@kernel
def strike_powers(scene, lane, lanes, contact, time, impulse):  # type: ignore[no-untyped-def]
    """Add an impulse times the mean of the velocities of each body before and after the impact."""
    if time < 0.0:
        return
    for flow in range(scene.flows.shape[0]):
        kind, place, other = scene.flows[flow, 0], scene.flows[flow, 1], scene.flows[flow, 2]
        if kind == CONTACT_FORCE and place == contact and other == VELOCITY:
            body = scene.flows[flow, 3]
            mean = lanes.v[lane, body] + 0.5 * impulse * scene.pushes[lane, contact, body]
            lanes.flows[lane, flow] += impulse * mean
        elif kind == CONTACT_FORCE and place == contact:  # cosine or sine of the motion of a body that is given
            angle = scene.frequencies[lane, scene.flows[flow, 3]] * time
            lanes.flows[lane, flow] += impulse * (math.cos(angle) if other == COSINE else math.sin(angle))
