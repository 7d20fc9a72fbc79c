"""Small differences of paths from that of a lane, carried along it through its events.

A difference moves as the motion does without its forces. Where an event comes a *delay* later on the other path, this
goes on as before the event for so long, is struck with the delay, and has gone on as after it for so much less: the
saltation of a tangent vector (R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems,
2004), in parts that need no case for each kind of event.
"""

from __future__ import annotations

import math

from impactlab.compiling.jit import seldom_called
from impactlab.kernels.contact_states import EFFECTIVE_MASS
from impactlab.kernels.pieces import KAPPA, PUSH, G, out_of


@seldom_called
def _rates_of_state(pieces, row, frequencies, lane, motion, pairs, rates):  # type: ignore[no-untyped-def]
    """Write the rates of change of displacements and velocities of bodies, by way of those of pairs."""
    given = motion.given
    for pair in range(pieces.sizes[row]):
        a, b = motion.now[2 * pair], motion.now[2 * pair + 1]
        rate = pieces.pairs[row, pair, PUSH] - pieces.pairs[row, pair, KAPPA] * a - 2.0 * pieces.pairs[row, pair, G] * b
        for source in range(given.values.shape[0]):
            b += pieces.drives[row, 2 * pair, source] * given.values[source, 0]
            rate += pieces.drives[row, 2 * pair + 1, source] * given.values[source, 0]
        pairs[2 * pair], pairs[2 * pair + 1] = b, rate
    for entry in range(rates.shape[0]):
        rates[entry] = 0.0
        for wave in range(frequencies.shape[1]):
            part = pieces.waves[row, entry, 2 * wave] * motion.turns[2 * wave + 1]
            part += pieces.waves[row, entry, 2 * wave + 1] * motion.turns[2 * wave]
            rates[entry] -= frequencies[lane, wave] * part
    out_of(pieces, row, 1.0, pairs, rates)


@seldom_called
def add_rounding(lane, lanes, part):  # type: ignore[no-untyped-def]
    """Let the difference that is the estimated error grow by a part of the state, as rounding does in each piece."""
    bodies = lanes.x.shape[1]
    for place in range(min(1, lanes.differences.shape[1])):
        for body in range(bodies):
            error = lanes.differences[lane, place, body]
            lanes.differences[lane, place, body] = error + math.copysign(part * lanes.x[lane, body], error)
            error = lanes.differences[lane, place, bodies + body]
            lanes.differences[lane, place, bodies + body] = error + math.copysign(part * lanes.v[lane, body], error)


@seldom_called
def delay_differences(pieces, row, frequencies, lane, lanes, sign, work):  # type: ignore[no-untyped-def]
    """Let all paths go on as the motion does now for their delays, or for so much less by the sign."""
    delayed = False
    for place in range(lanes.differences.shape[1]):
        delayed = delayed or lanes.delays[lane, place] != 0.0
    if not delayed:
        return
    rates = work.state[: lanes.differences.shape[2]]
    _rates_of_state(pieces, row, frequencies, lane, work.motion, work.pairs, rates)
    for place in range(lanes.differences.shape[1]):
        delay = sign * lanes.delays[lane, place]
        for entry in range(rates.shape[0]):
            lanes.differences[lane, place, entry] += rates[entry] * delay


@seldom_called
def strike_differences(scene, lane, lanes, contact, time, restitution):  # type: ignore[no-untyped-def]
    """Let an impact change all paths; a wall has gone on for their delays."""
    bodies, bend = lanes.x.shape[1], 0.0
    for wave in range(scene.frequencies.shape[1]):
        rate, real = scene.frequencies[lane, wave], scene.walls[lane, contact, 2 * wave]
        imaginary = scene.walls[lane, contact, 2 * wave + 1]
        if real == 0.0 and imaginary == 0.0:
            continue
        part = real * math.cos(rate * time) - imaginary * math.sin(rate * time)
        bend -= rate * rate * part
    factor = (1.0 + restitution) * scene.contacts[lane, contact, EFFECTIVE_MASS]
    for place in range(lanes.differences.shape[1]):
        change = bend * lanes.delays[lane, place]
        for body in range(bodies):
            change += scene.links[lane, contact, body] * lanes.differences[lane, place, bodies + body]
        for body in range(bodies):
            lanes.differences[lane, place, bodies + body] -= factor * change * scene.pushes[lane, contact, body]


@seldom_called
def make_orthonormal(lane, lanes, sample):  # type: ignore[no-untyped-def]
    """Make all differences but the estimated error orthonormal, and note their growth."""
    for place in range(1, lanes.differences.shape[1]):
        size, own = 0.0, lanes.differences[lane, place]
        for entry in range(own.shape[0]):
            size += own[entry] * own[entry]
        for other in range(1, place):
            along = 0.0
            for entry in range(own.shape[0]):
                along += own[entry] * lanes.differences[lane, other, entry]
            for entry in range(own.shape[0]):
                own[entry] -= along * lanes.differences[lane, other, entry]
        length = 0.0
        for entry in range(own.shape[0]):
            length += own[entry] * own[entry]
        lost = length <= 1e-28 * size  # rounding of a difference that the motion has taken away
        lanes.growths[lane, sample, place - 1] = -math.inf if lost else 0.5 * math.log(length)
        for entry in range(own.shape[0]):
            own[entry] = 0.0 if lost else own[entry] / math.sqrt(length)
