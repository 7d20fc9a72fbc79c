"""The motion of networks in which nothing is random, from event to event.

Between events the motion is a piece, see `impactlab.kernels.pieces`. Gaps of open contacts and forces of closed ones
are functionals that are negative until an event. Each step of the search is a time for which all of them surely stay
negative, so that no event is missed; near a root such steps converge faster than Newton's.

Events at one time follow in the order of the contacts. An impact of a rigid contact acts on its own bodies; resting
contacts that it makes close, or open, follow in their order, until none closes. Where bounces come to be lower than
the tolerance, the contact rests from there on, and counts as resting from the time at which the series of its bounces
ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impactlab.compiling.jit import kernel, loop, seldom_called
from impactlab.compiling.records import Cube, Numbers, Slots, SlotTable, Table, signature
from impactlab.kernels.contact_states import (
    CLOSED,
    DAMPING,
    DASHPOT,
    EFFECTIVE_MASS,
    FRICTION,
    HELD,
    OPEN,
    PARTED,
    RESTITUTION,
    RIGID,
    STICKS,
    SURFACE,
)
from impactlab.kernels.differences import add_rounding, delay_differences, make_orthonormal, strike_differences
from impactlab.kernels.event_log import (
    BEGAN,
    DURATION,
    IMPULSE,
    LARGEST,
    LOST_ENERGY,
    NODE_STATE,
    NODE_TIME,
    NODE_WEIGHT,
    OF_IMPACT,
    begin_impact,
    log_full,
    nodes_full,
    note,
)
from impactlab.kernels.integrals import (
    Integrals,
    add_integrals,
    add_node_of_flows,
    add_powers,
    force_at,
    in_closed_form,
    integral_of,
    integral_of_product,
    integrals_for,
    integrate,
    note_phasors,
    strike_powers,
    weigh_functional,
)
from impactlab.kernels.peaks_of_pieces import foretold, top_between, top_nearby
from impactlab.kernels.pieces import (
    DEGREE,
    LEVELS,
    LIMITS,
    ROUNDING,
    SIGNIFICANT,
    TERMS,
    Given,
    Motion,
    Panels,
    Pieces,
    begin,
    bound,
    carry_error,
    derive,
    look,
    root_of_parabola,
    safe_time,
    take_given,
    take_state,
)
from impactlab.kernels.stick_slip import after_impact, slip_or_stick, watched_of_friction
from impactlab.quadrature import mean_rule

ARRIVED, UNKNOWN_PIECE, INTERRUPTED, LOG_FULL, STUCK = range(5)
"""Why a lane stopped: it is at its end, needs a piece, has made many looks, has many events, or does not get on."""

NOW, LOST, COUNT, NEXT, EVALUATIONS, GRAZED, REPEATS, WHICH, WORST = range(9)
"""Columns of the clock of a lane: time and what rounding took off it, events, number of the next sample, looks at the
motion, touches that rounding leaves open, events at one time, the contact of the last one, and the largest estimated
error of a displacement (m)."""

RATIO, CLOSINGS, PRESSED, PEAK, RESTS_FROM, CHATTERS, FASTEST, GATHERED = range(OF_IMPACT)
"""Rows of the sums of a contact; the last are the time up to which a rest does not count, the number of rests that
endlessly many impacts lead to, the largest closing velocity, and the impulse since the last sample. The
rows of an impact that goes on follow, see `impactlab.kernels.event_log`."""

UNSEEN = 2.0**-52
"""Part of a time that rounding takes away."""

SAME_TIME = 200
"""Events at one time of which the motion does not go on."""

SEARCHED = 1e5
"""Largest angle of the fastest wave in a search (rad): a call lasts as long as some searches at least."""

MOST_LOOKED = 300_000
"""Looks of a search: some tens of milliseconds, the same for any share of lanes, so that bits do not depend on it."""

PANEL = 13.0
"""Largest angle of a wave in a panel of an integral over time (rad)."""

FEWEST_NODES = 8
"""Nodes of Gauss's rule in a panel of up to a radian, with one more for each further one: it has the mean square of a
wave to 2e-15 then, for any angle up to `PANEL`."""

KEPT_PANEL = 1.0
"""Largest angle of the fastest wave in a panel of nodes that are kept (rad): Gauss's rule has powers of the motion up
to the fourth, and smooth functions of it, to rounding."""

KEPT_ANGLE = 16.0
"""Largest angle of a part of the motion whose nodes are kept (rad): with both ends they are fewer than
`impactlab.kernels.event_log.RESERVED_NODES`, whatever the rule."""


class Scene(NamedTuple):
    """Numbers of the networks of all lanes."""

    frequencies: Table  # (lane, wave) (rad s-1)
    contacts: Cube  # (lane, contact, SURFACE + 1)
    links: Cube  # (lane, contact, body) weights
    pushes: Cube  # (lane, contact, body) change of the velocities by a unit impulse, ``w/m``
    walls: Cube  # (lane, contact, 2 wave) of the motion of walls, as `Pieces.waves`
    kinds: Slots  # (contact,)
    panels: Panels
    flows: SlotTable  # (flow, 4) what is integrated as the power of forces, see `impactlab.kernels.integrals`
    nodes: Cube  # (rule, 2, node) Gauss's on [0, 1], and weights, of rules of `FEWEST_NODES` nodes and more


class Span(NamedTuple):
    """How lanes run, and what is kept on the way."""

    tolerance: float
    summed: bool  # whether statistics are
    looks: int = 0  # of a lane in a call, about
    followed: bool = False  # whether samples end pieces, and differences of paths are made orthonormal there


class Lanes(NamedTuple):
    """When lanes take samples and end, and what changes along the run of each."""

    times: Table  # (lane, sample) of samples (s)
    ends: Numbers  # (lane,) (s)
    x: Table  # (lane, body)
    v: Table
    statuses: SlotTable  # (lane, contact)
    clock: Table  # (lane, WORST + 1)
    differences: Cube  # (lane, difference, 2 body) of paths from that of the lane: its estimated error, and others
    delays: Table  # (lane, difference) by how much the last event of the other path is later
    growths: Cube  # (lane, sample, difference) logarithms of the growth of the others since the last sample
    rows: SlotTable  # (lane, place) rows of its pieces, -1 behind the last
    bodies: Cube  # (lane, 4, body and point) integrals of x, x², v, v²
    flows: Table  # (lane, flow) integrals of the products of `Scene.flows`
    contacts: Cube  # (lane, SUMS, contact), see `impactlab.kernels.event_log`
    samples: Cube  # (lane, sample, 2 body + contact), of rigid contacts the impulse since the sample before
    log: Cube  # (lane, event, EVENT), see `impactlab.kernels.event_log`
    states: Cube  # (lane, event, 2 body) displacements and velocities after events of the log, where they are wanted
    logged: Slots  # (lane,) events that were to be written to it
    nodes: Cube  # (lane, node, NODE_STATE + 2 body + contact + state) nodes of integrals, where they are wanted
    noded: Slots  # (lane,) how many there are


class Work(NamedTuple):
    """Memory that a call works in."""

    motion: Motion
    rates: Table  # (3, contact) first and second derivatives of forces, and for how long these tell the former
    integrals: Integrals
    state: Numbers  # (entry,) displacements, velocities, and then those of points
    pairs: Numbers  # (2 pair,)


@kernel
def rate_of_gap(scene, lane, contact, time, v):  # type: ignore[no-untyped-def]
    """Return the rate of a gap at a time, and the size of its terms."""
    total, size = 0.0, 0.0
    for body in range(v.shape[1]):
        part = scene.links[lane, contact, body] * v[lane, body]
        total += part
        size += abs(part)
    for wave in range(scene.frequencies.shape[1]):
        real, imaginary = scene.walls[lane, contact, 2 * wave], scene.walls[lane, contact, 2 * wave + 1]
        if real == 0.0 and imaginary == 0.0:  # most walls stand still
            continue
        angle, factor = scene.frequencies[lane, wave] * time, scene.frequencies[lane, wave]
        part = real * math.sin(angle) + imaginary * math.cos(angle)
        total -= factor * part
        size += abs(factor * part)
    return total, size


@kernel
def _row_of(pieces, lanes, lane):  # type: ignore[no-untyped-def]
    """Return the row of the piece of a lane, -1 if it is not known."""
    for place in range(lanes.rows.shape[1]):
        row = lanes.rows[lane, place]
        if row < 0:
            return -1
        same = True
        for contact in range(lanes.statuses.shape[1]):
            if pieces.statuses[row, contact] != lanes.statuses[lane, contact]:
                same = False
                break
        if same:
            return row
    return -1


@kernel
def _watched(scene, status, contact, other):  # type: ignore[no-untyped-def]
    """Return the sign with which a functional of a contact stays negative, 0 if it may be anything.

    The functional is its gap, or the `other`, its force.
    """
    if scene.kinds[contact] >= FRICTION:
        return watched_of_friction(status, other)
    if status == OPEN:
        return 0.0 if other else 1.0
    if status == HELD:
        return -1.0 if other else 0.0
    if status == PARTED:
        return 1.0 if other else -1.0
    if scene.kinds[contact] == DASHPOT:
        return -1.0 if other else 0.0
    return 0.0 if other else -1.0


@kernel
def _leaving(sign, begun, held, longest, motion):  # type: ignore[no-untyped-def]
    """Return for how long a functional that is 0 surely stays negative, 0 if it becomes positive at once.

    The first of its derivatives that is no rounding tells; the terms of one may all be small where those of others are
    not. At the beginning of a piece, which an event has `begun`, a smaller one keeps it negative, too. What is `held`
    stays so where a limit is only touched: where its functional comes back before it is more than rounding.
    """
    for level in range(1, LEVELS):
        value, size = sign * motion.levels[level], motion.sizes[level]
        usual = math.sqrt(motion.sizes[0] * motion.limits[0]) if level == 1 else motion.limits[level - 2]
        told = abs(value) > SIGNIFICANT * max(size, usual)
        if held and level == 1 and value > 0.0:
            room, bend = SIGNIFICANT * motion.sizes[0] - sign * motion.levels[0], sign * motion.levels[2]
            if bend < 0.0 and value * value <= -2.0 * bend * room:
                return safe_time(sign, -room, longest, motion)
        if told and value > 0.0:
            return 0.0
        if told or (begun and value < -ROUNDING * size):
            if level == 1:  # what it is, is rounding
                time, bend = safe_time(sign, 0.0, longest, motion), sign * motion.levels[2]
                if begun or (bend <= 0.0 and motion.limits[1] == 0.0):
                    return time
                return max(time, root_of_parabola(value, 0.5 * bend, motion.limits[1] / 3.0))
            most = motion.limits[level - 1]
            return -value * (level + 1) / most if most > 0.0 else math.inf
    return math.inf


@kernel
def _search(scene, pieces, row, lane, lanes, start, longest, motion):  # type: ignore[no-untyped-def]
    """Return when the next event is, after how long, and its functional; -1 if there is none up to the longest time.

    After many looks it returns as well: the search goes on from there.
    """
    elapsed, looks = 0.0, 0
    while True:
        look(pieces, row, scene.frequencies, lane, start, elapsed, motion)
        looks += 1
        safe, first = longest - elapsed, -1
        for functional in range(2 * scene.kinds.shape[0]):
            sign = _watched(scene, lanes.statuses[lane, functional // 2], functional // 2, functional % 2 == 1)
            if sign == 0.0:
                continue
            derive(pieces, row, functional, LEVELS, 1, scene.frequencies, lane, motion)
            bound(pieces, row, functional, motion)
            value, held = sign * motion.levels[0], lanes.statuses[lane, functional // 2] in (HELD, STICKS)
            if held and value > SIGNIFICANT * motion.sizes[0]:
                time = 0.0  # what holds it is beyond its limit from the beginning
            elif value >= -ROUNDING * motion.sizes[0]:
                derive(pieces, row, functional, LEVELS, LEVELS, scene.frequencies, lane, motion)
                time = _leaving(sign, elapsed == 0.0, held, safe, motion)
                if time > 0.0 and elapsed > 0.0:
                    lanes.clock[lane, GRAZED] += 1.0
            else:
                time = safe_time(sign, value, safe, motion)
                gaps = lanes.statuses[lane, functional // 2] in (OPEN, CLOSED)  # which rounding may leave a little open
                near = gaps and value + sign * motion.levels[1] * UNSEEN * abs(start + elapsed) >= 0.0
                if near or time <= UNSEEN * elapsed:
                    time = 0.0
            if time < safe:
                safe, first = time, functional
                if time == 0.0:
                    break
        if first < 0:
            return longest, -1, looks
        if safe == 0.0:
            return elapsed, first, looks
        elapsed += safe
        if looks > MOST_LOOKED:
            return elapsed, -1, looks


@kernel
def _weigh(scene, pieces, row, lane, lanes, time, weight, summed, work):  # type: ignore[no-untyped-def]
    """Add a node of the integrals over a part of a piece."""
    motion, bodies = work.motion, lanes.x.shape[1]
    if summed:
        take_state(pieces, row, scene.frequencies, motion, work.state)
        for body in range(lanes.bodies.shape[2]):
            place = body if body < bodies else bodies + body
            x, v = work.state[place], work.state[place + (bodies if body < bodies else lanes.bodies.shape[2] - bodies)]
            lanes.bodies[lane, 0, body] += weight * x
            lanes.bodies[lane, 1, body] += weight * x * x
            lanes.bodies[lane, 2, body] += weight * v
            lanes.bodies[lane, 3, body] += weight * v * v
        add_node_of_flows(scene, pieces, row, lane, lanes, weight, work)
    for contact in range(scene.kinds.shape[0]):
        status, work_done = lanes.statuses[lane, contact], 0.0
        if status != CLOSED and status != HELD:
            continue
        derive(pieces, row, 2 * contact + 1, 1, 0, scene.frequencies, lane, motion)
        force = motion.levels[0]
        if _loses(scene, lane, lanes, contact):
            derive(pieces, row, 2 * contact, 2, 0, scene.frequencies, lane, motion)
            work_done = force * motion.levels[1]
        _press(lane, lanes, contact, weight * force, weight * work_done, summed)


@kernel
def _loses(scene, lane, lanes, contact):  # type: ignore[no-untyped-def]
    """Whether the energy that a contact takes is wanted, and not 0."""
    noted = lanes.log.shape[1] > 0 and lanes.statuses[lane, contact] == CLOSED
    return noted and scene.contacts[lane, contact, DAMPING] != 0.0


@kernel
def _press(lane, lanes, contact, impulse, lost, summed):  # type: ignore[no-untyped-def]
    """Add an impulse and an energy to what a contact has taken."""
    lanes.contacts[lane, GATHERED, contact] += impulse
    if summed:
        lanes.contacts[lane, PRESSED, contact] += impulse
        lanes.contacts[lane, OF_IMPACT + IMPULSE - BEGAN, contact] += impulse
        lanes.contacts[lane, OF_IMPACT + LOST_ENERGY - BEGAN, contact] += lost


@seldom_called
def _sum_by_rule(scene, pieces, row, lane, lanes, start, since, until, summed, work):  # type: ignore[no-untyped-def]
    """Add the integrals over a part of a piece, which Gauss's rule has to rounding."""
    angle = (until - since) * pieces.fastest[row]
    panels = max(1, math.ceil(angle / PANEL))
    width, rule = (until - since) / panels, max(0, math.ceil(angle / panels) - 1)
    if work.motion.given.functions.shape[0] > 0:
        rule = max(rule, DEGREE + 1 - FEWEST_NODES)
    for panel in range(panels):
        for node in range(FEWEST_NODES + rule):
            time, weight = since + width * (panel + scene.nodes[rule, 0, node]), width * scene.nodes[rule, 1, node]
            look(pieces, row, scene.frequencies, lane, start, time, work.motion)
            _weigh(scene, pieces, row, lane, lanes, time, weight, summed, work)


@seldom_called
def _keep_nodes(scene, pieces, row, lane, lanes, start, since, until, work):  # type: ignore[no-untyped-def]
    """Keep nodes of integrals over a part of a piece, and its two ends, which have no weight."""
    panels = max(1, math.ceil((until - since) * pieces.fastest[row] / KEPT_PANEL))
    width, rule = (until - since) / panels, 0
    if work.motion.given.functions.shape[0] > 0:
        rule = DEGREE + 1 - FEWEST_NODES
    _keep_node(scene, pieces, row, lane, lanes, start, since, 0.0, work)
    for panel in range(panels):
        for node in range(FEWEST_NODES + rule):
            time, weight = since + width * (panel + scene.nodes[rule, 0, node]), width * scene.nodes[rule, 1, node]
            _keep_node(scene, pieces, row, lane, lanes, start, time, weight, work)
    _keep_node(scene, pieces, row, lane, lanes, start, until, 0.0, work)


@seldom_called
def _keep_node(scene, pieces, row, lane, lanes, start, time, weight, work):  # type: ignore[no-untyped-def]
    """Keep a node of a piece, some time after its start."""
    bodies, node, motion = lanes.x.shape[1], lanes.nodes[lane, lanes.noded[lane]], work.motion
    lanes.noded[lane] += 1
    node[NODE_TIME], node[NODE_WEIGHT] = start + time, weight
    look(pieces, row, scene.frequencies, lane, start, time, motion)
    take_state(pieces, row, scene.frequencies, motion, work.state)
    for entry in range(2 * bodies):
        node[NODE_STATE + entry] = work.state[entry]
    for contact in range(scene.kinds.shape[0]):
        node[NODE_STATE + 2 * bodies + contact] = force_at(scene, pieces, row, lane, lanes, contact, motion)


@kernel
def _sum(scene, pieces, row, lane, lanes, start, since, until, summed, work):  # type: ignore[no-untyped-def]
    """Add the integrals over a part of a piece, in closed form where there is one."""
    motion, integrals = work.motion, work.integrals
    if since == 0.0:
        note_phasors(pieces, row, scene.frequencies, motion.begin, motion.turned, integrals.begins)
    else:
        look(pieces, row, scene.frequencies, lane, start, since, motion)
        note_phasors(pieces, row, scene.frequencies, motion.now, motion.turns, integrals.begins)
    look(pieces, row, scene.frequencies, lane, start, until, motion)
    note_phasors(pieces, row, scene.frequencies, motion.now, motion.turns, integrals.ends)
    pressed = False
    for contact in range(scene.kinds.shape[0]):
        pressed = pressed or lanes.statuses[lane, contact] == CLOSED
    if summed and pressed:
        _see_peaks(scene, pieces, row, lane, lanes, start, since, until, work)
    length, count = until - since, 2 * (pieces.sizes[row] + scene.frequencies.shape[1])
    known = in_closed_form(pieces, row, length, motion, integrals)
    if known:
        integrate(pieces, row, scene.frequencies, lane, length, integrals)
    if known and summed:
        known = add_integrals(pieces, row, scene.frequencies, lane, lanes, start + since, length, integrals)
    if not known:
        _sum_by_rule(scene, pieces, row, lane, lanes, start, since, until, summed, work)
        return
    if summed:
        add_powers(scene, pieces, row, lane, lanes, count, length, integrals)
    for contact in range(scene.kinds.shape[0]):
        status, lost = lanes.statuses[lane, contact], 0.0
        if status in (CLOSED, HELD):
            constant = weigh_functional(pieces, row, 2 * contact + 1, 0, scene.frequencies, lane, integrals.one)
            impulse = integral_of(constant, integrals.one, count, length, integrals)
            if _loses(scene, lane, lanes, contact):
                pace = weigh_functional(pieces, row, 2 * contact, 1, scene.frequencies, lane, integrals.other)
                lost = integral_of_product(constant, pace, count, length, integrals)
            _press(lane, lanes, contact, impulse, lost, summed)


@kernel
def _see_peaks(scene, pieces, row, lane, lanes, start, since, until, work):  # type: ignore[no-untyped-def]
    """Find the largest forces of closed contacts in a part of a piece.

    Steps are so long that three derivatives of the rate of a force foretell it but for a small part, or that no force
    exceeds the largest one so far: of the impact, if there is a log. Where a rate has come to 0 in a step, the top is
    near that of a cubic through its values and derivatives at both ends, and that of Taylor's polynomial from there.
    """
    motion, rates, time, step, noted = work.motion, work.rates, since, 0.0, lanes.log.shape[1] > 0
    while True:
        look(pieces, row, scene.frequencies, lane, start, time, motion)
        longest = until - time
        for contact in range(scene.kinds.shape[0]):
            if lanes.statuses[lane, contact] != CLOSED:
                continue
            derive(pieces, row, 2 * contact + 1, LEVELS, 0, scene.frequencies, lane, motion)
            bound(pieces, row, 2 * contact + 1, motion)
            top, rate, bend, known = motion.levels[0], motion.levels[1], motion.levels[2], rates[2, contact]
            rates[2, contact] = foretold(pieces.fastest[row], motion)
            if rates[2, contact] < longest:
                best = lanes.contacts[lane, OF_IMPACT + LARGEST - BEGAN if noted else PEAK, contact]
                below = safe_time(1.0, top - best, longest, motion) if top < best else 0.0
                longest = min(longest, max(below, rates[2, contact]))
            if 0.0 < step <= known and rates[0, contact] > 0.0 and rate <= 0.0:
                back = top_between(step, rates[0, contact], rates[1, contact], rate, bend)
                look(pieces, row, scene.frequencies, lane, start, time - back, motion)
                derive(pieces, row, 2 * contact + 1, LEVELS, 0, scene.frequencies, lane, motion)
                top = max(top, top_nearby(motion))
                look(pieces, row, scene.frequencies, lane, start, time, motion)
            rates[0, contact], rates[1, contact] = rate, bend
            for place in (PEAK, OF_IMPACT + LARGEST - BEGAN):
                lanes.contacts[lane, place, contact] = max(lanes.contacts[lane, place, contact], top)
        if time == until:
            return
        step = longest
        time = until if step == until - time else time + step


@kernel
def due_of(lane, lanes):  # type: ignore[no-untyped-def]
    """Return when the next sample is taken, infinite if none is."""
    place = int(lanes.clock[lane, NEXT])
    return lanes.times[lane, place] if place < lanes.times.shape[1] else math.inf


@kernel
def _pass(scene, pieces, row, lane, lanes, span, start, length, last, work):  # type: ignore[no-untyped-def]
    """Sum and sample a piece over its length; rounding keeps no sample of the last one from being taken."""
    since, motion, bodies = 0.0, work.motion, lanes.x.shape[1]
    while True:
        until, due = length, due_of(lane, lanes) - start
        sampled = due <= length or (last and due < math.inf)
        if sampled:
            until = min(max(due, since), length)
        begins = max(since, -start)  # statistics begin at 0
        resting = False
        for contact in range(scene.kinds.shape[0]):
            resting = resting or lanes.statuses[lane, contact] == HELD
        if until > begins:
            if span.summed:
                for contact in range(scene.kinds.shape[0]):
                    status, lasts = lanes.statuses[lane, contact], until - begins
                    if status == OPEN:
                        continue
                    if status == HELD:
                        from_then = max(begins, lanes.contacts[lane, RESTS_FROM, contact] - start)
                        lasts = max(until - from_then, 0.0)
                    lanes.contacts[lane, RATIO, contact] += lasts
                    lanes.contacts[lane, OF_IMPACT + DURATION - BEGAN, contact] += lasts
            if span.summed or (resting and lanes.times.shape[1] > 0):
                _sum(scene, pieces, row, lane, lanes, start, begins, until, span.summed, work)
            if lanes.nodes.shape[1] > 0:
                _keep_nodes(scene, pieces, row, lane, lanes, start, begins, until, work)
        if not sampled:
            break
        place = int(lanes.clock[lane, NEXT])
        look(pieces, row, scene.frequencies, lane, start, until, motion)
        take_state(pieces, row, scene.frequencies, motion, lanes.samples[lane, place, : 2 * bodies])
        for contact in range(scene.kinds.shape[0]):
            force = 0.0
            if scene.kinds[contact] == RIGID:
                force = lanes.contacts[lane, GATHERED, contact] if place > 0 else 0.0
            elif lanes.statuses[lane, contact] == CLOSED:
                derive(pieces, row, 2 * contact + 1, 1, 0, scene.frequencies, lane, motion)
                force = motion.levels[0]
            lanes.samples[lane, place, 2 * bodies + contact] = force
            lanes.contacts[lane, GATHERED, contact] = 0.0
        lanes.clock[lane, NEXT] += 1.0
        since = until


@kernel
def _strike(scene, lane, lanes, contact, time, rate, restitution, after):  # type: ignore[no-untyped-def]
    """Let an impact turn the rate of a gap, note it, and change frictions; a rest that it hits ends before."""
    mass = scene.contacts[lane, contact, EFFECTIVE_MASS]
    impulse = (1.0 + restitution) * rate * mass
    left = impulse
    for _ in range(2):  # the second takes away what rounding of the effective mass makes of many impacts
        for body in range(lanes.v.shape[1]):
            lanes.v[lane, body] -= left * scene.pushes[lane, contact, body]
        left = (rate_of_gap(scene, lane, contact, time, lanes.v)[0] + restitution * rate) * mass
    strike_differences(scene, lane, lanes, contact, time, restitution)
    strike_powers(scene, lane, lanes, contact, time, impulse)
    lanes.contacts[lane, GATHERED, contact] += impulse
    if time >= 0.0:
        lanes.contacts[lane, PRESSED, contact] += impulse
        lanes.contacts[lane, CLOSINGS, contact] += 1.0
    if lanes.statuses[lane, contact] == HELD:
        lanes.statuses[lane, contact] = OPEN
        note(lanes, lane, time, contact, HELD, rate, 0.0)
    lanes.statuses[lane, contact] = after
    begin_impact(lanes, lane, time, contact, rate)
    lanes.contacts[lane, OF_IMPACT + IMPULSE - BEGAN, contact] = impulse
    lanes.contacts[lane, OF_IMPACT + LARGEST - BEGAN, contact] = math.nan
    lost = 0.5 * mass * rate * rate * (1.0 - restitution) * (1.0 + restitution)
    lanes.contacts[lane, OF_IMPACT + LOST_ENERGY - BEGAN, contact] = lost
    note(lanes, lane, time, contact, OPEN, rate, restitution * rate if after == OPEN else math.nan)
    for link in range(scene.kinds.shape[0]):
        if scene.kinds[link] >= FRICTION:
            slip, size = rate_of_gap(scene, lane, link, time, lanes.v)
            surface = scene.contacts[lane, link, SURFACE]
            after_impact(scene, lane, lanes, link, contact, impulse, slip + surface, size + abs(surface))


@kernel
def impact(scene, lane, lanes, contact, time, tolerance, motion):  # type: ignore[no-untyped-def]
    """Let a rigid contact close: it bounces, or rests where its bounces would be lower than the tolerance.

    The motion is that before the impact, whose pull on the gap tells how high the bounces are.
    """
    rate, size = rate_of_gap(scene, lane, contact, time, lanes.v)
    restitution = scene.contacts[lane, contact, RESTITUTION]
    pull, twist = motion.levels[2], motion.limits[1]
    lanes.contacts[lane, FASTEST, contact] = max(lanes.contacts[lane, FASTEST, contact], rate)
    rests = rate <= SIGNIFICANT * max(size, motion.sizes[1]) or restitution == 0.0
    ends = time
    if not rests and restitution < 1.0 and pull > 0.0:
        leaves = restitution * rate
        lasts = 2.0 * leaves / (pull * (1.0 - restitution))
        low = leaves * leaves <= tolerance * lanes.contacts[lane, FASTEST, contact] ** 2
        if low and lasts * twist < 0.1 * pull:
            rests, ends = True, time + lasts
            if time >= 0.0:
                lanes.contacts[lane, CHATTERS, contact] += 1.0
    _strike(scene, lane, lanes, contact, time, rate, 0.0 if rests else restitution, HELD if rests else OPEN)
    lanes.contacts[lane, RESTS_FROM, contact] = ends
    for _ in range(SAME_TIME):
        struck = False
        for other in range(scene.kinds.shape[0]):
            if lanes.statuses[lane, other] != HELD:
                continue
            pace, terms = rate_of_gap(scene, lane, other, time, lanes.v)
            if abs(pace) <= SIGNIFICANT * max(terms, rate):  # rounding, where it only holds still
                continue
            if pace < 0.0:
                lanes.statuses[lane, other] = OPEN
                note(lanes, lane, time, other, HELD, pace, -pace)
            else:
                bounce = scene.contacts[lane, other, RESTITUTION]
                _strike(scene, lane, lanes, other, time, pace, bounce, OPEN if bounce > 0.0 else HELD)
                struck = True
        if not struck:
            return True
    return False


@kernel
def _happen(scene, lane, lanes, functional, time, tolerance, holding, motion):  # type: ignore[no-untyped-def]
    """Let an event happen, from the gap of its contact before; return whether the motion goes on.

    `holding` is the force that would hold a friction that slips.
    """
    contact, status = functional // 2, lanes.statuses[lane, functional // 2]
    if scene.kinds[contact] >= FRICTION:
        slip, _ = rate_of_gap(scene, lane, contact, time, lanes.v)
        slip_or_stick(scene, lane, lanes, functional, slip + scene.contacts[lane, contact, SURFACE], holding)
    elif status == OPEN:
        if scene.kinds[contact] == RIGID:
            return impact(scene, lane, lanes, contact, time, tolerance, motion)
        lanes.statuses[lane, contact] = CLOSED
        begin_impact(lanes, lane, time, contact, motion.levels[1])
        if time >= 0.0:
            lanes.contacts[lane, CLOSINGS, contact] += 1.0
    elif status == PARTED:
        lanes.statuses[lane, contact] = CLOSED if functional % 2 else OPEN
    elif status == CLOSED and scene.kinds[contact] == DASHPOT:
        lanes.statuses[lane, contact] = PARTED if motion.levels[0] > ROUNDING * motion.sizes[0] else OPEN
    else:
        lanes.statuses[lane, contact] = OPEN
    return True


@kernel
def note_error(lane, lanes):  # type: ignore[no-untyped-def]
    """Note the largest size of the estimated error of a displacement."""
    for body in range(lanes.x.shape[1]):
        error = abs(lanes.differences[lane, 0, body])
        if not error <= lanes.clock[lane, WORST]:
            lanes.clock[lane, WORST] = error


@seldom_called
def _lane(scene, pieces, lane, lanes, span, work):  # type: ignore[no-untyped-def]
    """Run a lane until it ends, or something is missing; return which."""
    looks, fastest = 0, 0.0
    for wave in range(scene.frequencies.shape[1]):
        fastest = max(fastest, scene.frequencies[lane, wave])
    while True:
        time = lanes.clock[lane, NOW] + lanes.clock[lane, LOST]
        left = lanes.ends[lane] - time
        if left <= 0.0:
            return ARRIVED
        if looks > span.looks:
            return INTERRUPTED
        if log_full(lanes, lane) or nodes_full(lanes, lane):
            return LOG_FULL
        row = _row_of(pieces, lanes, lane)
        if row < 0:
            return UNKNOWN_PIECE
        begin(pieces, row, scene.frequencies, lane, time, lanes.x, lanes.v, work.motion)
        longest = min(left, take_given(pieces, row, scene.panels, lane, time, work.motion))
        delay_differences(pieces, row, scene.frequencies, lane, lanes, -1.0, work)
        if span.followed or lanes.nodes.shape[1] > 0:
            longest = min(longest, max(due_of(lane, lanes) - time, 0.0))
        taken = lanes.clock[lane, NEXT]
        searched = SEARCHED if lanes.nodes.shape[1] == 0 else KEPT_ANGLE
        if longest * pieces.fastest[row] > searched:
            longest = searched / pieces.fastest[row]
        length, functional, made = _search(scene, pieces, row, lane, lanes, time, longest, work.motion)
        looks += made
        lanes.clock[lane, EVALUATIONS] += made
        ends = functional < 0 and length == left
        _pass(scene, pieces, row, lane, lanes, span, time, length, ends, work)
        bodies = lanes.x.shape[1]
        add_rounding(lane, lanes, ROUNDING * (1.0 + fastest * abs(time + length)))
        look(pieces, row, scene.frequencies, lane, time, length, work.motion)
        take_state(pieces, row, scene.frequencies, work.motion, work.state)
        for body in range(bodies):
            lanes.x[lane, body], lanes.v[lane, body] = work.state[body], work.state[bodies + body]
        for place in range(lanes.differences.shape[1]):
            difference = lanes.differences[lane, place]
            lanes.delays[lane, place] = -carry_error(pieces, row, max(functional, 0), difference, work.motion)
        before = lanes.clock[lane, NOW]
        step = length + lanes.clock[lane, LOST]
        after = before + step
        lanes.clock[lane, NOW], lanes.clock[lane, LOST] = after, step - (after - before)
        if functional < 0:
            lanes.delays[lane, :] = 0.0
            note_error(lane, lanes)
            if span.followed and lanes.clock[lane, NEXT] > taken:
                make_orthonormal(lane, lanes, int(taken))
            if not ends:
                looks += int(longest * pieces.fastest[row])
                continue
            lanes.clock[lane, NOW], lanes.clock[lane, LOST] = lanes.ends[lane], 0.0
            return ARRIVED
        contact = functional // 2
        status = lanes.statuses[lane, contact]
        rubs, holding = scene.kinds[contact] >= FRICTION, 0.0
        if rubs:  # this functional of one that slips
            derive(pieces, row, 2 * contact + 1, 1, 0, scene.frequencies, lane, work.motion)
            holding = work.motion.levels[0]
        seen = functional if rubs else 2 * contact
        derive(pieces, row, seen, 3, 2, scene.frequencies, lane, work.motion)
        bound(pieces, row, seen, work.motion)
        rate = work.motion.levels[1]
        known = (rubs or functional % 2 == 0) and abs(rate) > SIGNIFICANT * work.motion.sizes[1]
        for place in range(lanes.differences.shape[1]):  # forces and impacts act so much later
            lanes.delays[lane, place] = lanes.delays[lane, place] / rate if known else 0.0
        delay_differences(pieces, row, scene.frequencies, lane, lanes, 1.0, work)
        goes_on = _happen(scene, lane, lanes, functional, time + length, span.tolerance, holding, work.motion)
        note_error(lane, lanes)
        if status != OPEN or scene.kinds[contact] != RIGID:  # strikes have been noted
            leaving = -rate if status != HELD else 0.0
            if lanes.statuses[lane, contact] != OPEN:
                leaving = math.nan
            note(lanes, lane, time + length, contact, status, rate, leaving)
        lanes.clock[lane, COUNT] += 1.0
        lanes.clock[lane, WHICH] = contact
        lanes.clock[lane, REPEATS] = lanes.clock[lane, REPEATS] + 1.0 if length == 0.0 else 0.0
        if not goes_on or lanes.clock[lane, REPEATS] > SAME_TIME:
            return STUCK


def _run(scene, pieces, lanes, span, work, begins, ends, results):  # type: ignore[no-untyped-def]
    """Run some lanes; write why each of them stopped."""
    for lane in range(begins, ends):
        if results[lane] != ARRIVED:
            results[lane] = _lane(scene, pieces, lane, lanes, span, work)


def rules() -> np.ndarray:
    """Return the rules of integrals over a panel, (rule, 2, node)."""
    number = math.ceil(PANEL)
    result = np.zeros((number, 2, FEWEST_NODES + number - 1))
    for rule in range(number):
        result[rule, :, : FEWEST_NODES + rule] = mean_rule(FEWEST_NODES + rule)
    return result


def located_loop() -> Callable[..., None]:
    """Return the compiled loop."""
    return loop(signature(False, Scene, Pieces, Lanes, Span, Work, int, int, Slots), _run)


def work_for(bodies: int, points: int, waves: int, contacts: int, sources: int) -> Work:
    """Return memory for a call."""
    shapes = (1,), (sources, DEGREE + 1), (sources, LEVELS), (sources, LEVELS + 1), (2 * bodies, TERMS)
    given = Given(*(np.zeros(shape) for shape in shapes))
    sizes = 2 * bodies, 1, 2 * bodies, (3, bodies), 2 * waves, 2 * waves, bodies, bodies, LEVELS, LEVELS, LIMITS
    motion: Motion = Motion(*map(np.zeros, sizes), given)  # type: ignore[arg-type, call-arg]
    return Work(
        motion,
        np.zeros((3, contacts)),
        integrals_for(bodies + waves, 2 * (bodies + points)),
        np.zeros(2 * (bodies + points)),
        np.zeros(2 * bodies),
    )
