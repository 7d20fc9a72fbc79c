"""The motion of networks in which nothing is random, by steps that end where events are.

During a step no contact changes: an open one has no force, however far a trial goes. Where a gap passes 0 within a
trial, the step is made again with another length until it ends there, so that the forces of a step are smooth, and the
path has the order of the method. So do turns of the extensions of laws that yield, and kinks of their states; and where
the force that holds a rigid contact at rest passes 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impactlab.compiling.intrinsics import borrow, registers
from impactlab.compiling.jit import loop, scattered, seldom_called
from impactlab.compiling.records import Cube, Numbers, Slots, SlotTable, Table, signature
from impactlab.kernels.contact_states import (
    CLOSED,
    EFFECTIVE_MASS,
    HELD,
    OPEN,
    PARTED,
    RIGID,
    SLIPS_DOWN,
    SLIPS_UP,
)
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
from impactlab.kernels.from_event_to_event import (
    ARRIVED,
    CLOSINGS,
    COUNT,
    EVALUATIONS,
    GATHERED,
    GRAZED,
    INTERRUPTED,
    LOG_FULL,
    LOST,
    NEXT,
    NOW,
    PEAK,
    PRESSED,
    RATIO,
    REPEATS,
    RESTS_FROM,
    SAME_TIME,
    STUCK,
    WHICH,
    Lanes,
    Span,
    due_of,
    impact,
    rate_of_gap,
)
from impactlab.kernels.memory import BEHIND
from impactlab.kernels.passages import bend_at, first_passage, slope_at, stays_away, value_at
from impactlab.kernels.smooth_steps import (
    AFTER,
    AT,
    BEFORE,
    HOLDS,
    IN_TIME,
    LINK_ROW,
    NOW_ROW,
    NUDGE,
    RATE_ROW,
    ROW_B,
    ROW_C,
    ROW_QUINTIC,
    SLOPE_ROW,
    STAGE_ROW,
    STAGES,
    TRIAL_ROW,
    WORKED,
    Bodies,
    Memory,
    Trial,
    evaluate,
    look_at_states,
    make_step,
    moment,
    put_states,
    write_gaps,
)

EVEN = 1e-6
"""Part of the change of a state up to which it is 0, or the change even."""

AT_ZERO = 1e-13
"""Part of the largest value of a state so far up to which it is 0."""

CREST = 1e-10
"""Part of the largest force so far by which another must be larger for a step to end at it."""

STEP_ORDER = 8.0
"""Order of the step, of which its error is a power."""

SAFETY, SHORTENED, LENGTHENED = 0.9, 0.2, 6.0
"""Part of the length that the error allows, and the factors by which it may change at once."""

LEAST_STEP = 1e-9
"""Length of the step after an event, at least, as a part of the longest one: gaps change by rounding over less."""

TURNED = 1e-14
"""Part of the size of the rate of an extension up to which it is 0."""

LOOKS = 8
"""Parts of a step in which the largest force of a contact is looked for."""

SEEN_IN = (8, 9, 10)
"""Stages between those of `IN_TIME` or among them whose accelerations tell the error of a gap."""

DOUBTED = 2.0
"""Factor of the errors that are seen in stages."""

SEVENTH, OF_SEVENTH = 8, 24.0
"""Stage that tells the error of a quintic through others, and the factor for the whole of the step: the product of its
distances from them is there a 23rd of the largest, in Bernstein's coefficients."""

BEFORE_EVENT = 0.999
"""Part of a step that ends with an event within which others have to be that come first, beyond rounding."""

TOPS = 2
"""Tops of gaps at which a step may come to end, one for the other."""

REFINED = 60
"""Trials that may end at an event: Newton's method needs three, bisection fifty."""

PAUSE = 20_000.0
"""Evaluations of the forces between places where a call may end, about."""

LEAST_GAP = 1e-200
"""Indentation of a contact that has just closed, at least, which tells laws with states that it has (m)."""

LATE = 1e-9
"""Part of the time by which a sample may be due after the end of a run, as its number allows."""

FAR = 1e30
"""Clearance of an open contact, at which its force is 0 whatever a trial does (m)."""


class Rigid(NamedTuple):
    """What impacts take of a `Scene`: contacts by free bodies, and the motion of walls."""

    frequencies: Table
    contacts: Cube
    links: Cube
    pushes: Cube
    walls: Cube
    kinds: Slots
    flows: SlotTable  # products of impulses and velocities; powers of smooth forces are sums over steps


class Before(NamedTuple):
    """What they take of a `Motion`: derivatives of a gap before an impact, and the sizes of their terms."""

    levels: Numbers
    sizes: Numbers
    limits: Numbers


@scattered
def _through(tableau, curve):  # type: ignore[no-untyped-def]
    """Put the coefficients of a quintic in the place of its values at `IN_TIME`."""
    c1, c2, c3, c4, c5 = 0.0, 0.0, 0.0, 0.0, 0.0
    for place in range(1, len(IN_TIME)):
        value = curve[place] - curve[0]
        c1 += tableau[ROW_QUINTIC, place] * value
        c2 += tableau[ROW_QUINTIC + 1, place] * value
        c3 += tableau[ROW_QUINTIC + 2, place] * value
        c4 += tableau[ROW_QUINTIC + 3, place] * value
        c5 += tableau[ROW_QUINTIC + 4, place] * value
    curve[1], curve[2], curve[3], curve[4], curve[5] = c1, c2, c3, c4, c5


@scattered
def _between(sign, before, after, contact, length, curve):  # type: ignore[no-untyped-def]
    """Write the coefficients of ``sign gap``, by Hermite's quintic between the ends of a step."""
    c0, c1, c2 = sign * before[0, contact], sign * length * before[1, contact], 0.5 * length**2 * before[2, contact]
    c0, c2 = min(c0, 0.0), sign * c2
    rise = sign * after[0, contact] - c0 - c1 - c2
    slope = sign * length * after[1, contact] - c1 - 2.0 * c2
    bend = sign * length**2 * after[2, contact] - 2.0 * c2
    curve[0], curve[1], curve[2] = c0, c1, c2
    curve[3] = 10.0 * rise - 4.0 * slope + 0.5 * bend
    curve[4] = 7.0 * slope - 15.0 * rise - bend
    curve[5] = 6.0 * rise - 3.0 * slope + 0.5 * bend


@scattered
def _sign(status):  # type: ignore[no-untyped-def]
    """Return the sign with which a gap, or the rate of an extension, is negative until the next event."""
    return 1.0 if status in (OPEN, SLIPS_DOWN) else -1.0


@scattered
def _sleeps(bodies, lane, lanes, trial, row):  # type: ignore[no-untyped-def]
    """Whether a row waits: that of the states of an open contact, or of a kink whose place is not known."""
    if row < trial.forces.shape[1]:
        return False
    contact = bodies.places[row]
    return lanes.statuses[lane, row] == PARTED or (contact >= 0 and lanes.statuses[lane, contact] == OPEN)


@scattered
def _doubt_of_gap(bodies, lane, trial, row, square, curve):  # type: ignore[no-untyped-def]
    """Return the allowance of Hermite's quintic of a gap, from how far accelerations in stages are off.

    It is off by ``k s³ (1 - s)³``, with the sixth derivative of the gap as k, of which the second derivative is seen.
    """
    most = 0.0
    for place in range(len(SEEN_IN)):
        stage, bend = SEEN_IN[place], 0.0
        for body in range(bodies.links.shape[2]):
            bend += bodies.links[lane, row, body] * trial.stages[stage, 1, body]
        share = bodies.tableau[ROW_C, stage]
        room = share * (1.0 - share)
        part = 6.0 * room * ((1.0 - 2.0 * share) ** 2 - room)
        off = square * bend - bend_at(curve, share)
        most = max(most, abs(off / part))
    return DOUBTED * most / 20.0


@scattered
def _stage_of(bodies, lane, lanes, trial, row, stage):  # type: ignore[no-untyped-def]
    """Return the force that holds a rigid contact in a stage, or the rate of an extension, as it is watched."""
    if lanes.statuses[lane, row] == HELD:
        return -trial.forces[stage, row]
    rate = 0.0
    for body in range(bodies.links.shape[2]):
        rate += bodies.links[lane, row, body] * trial.stages[stage, 0, body]
    return _sign(lanes.statuses[lane, row]) * rate


@scattered
def _write_stages(bodies, lane, lanes, trial, row, curve):  # type: ignore[no-untyped-def]
    """Write the quintic of a force that holds, or of a rate, through some stages; return its allowance by another."""
    for place in range(len(IN_TIME)):
        curve[place] = _stage_of(bodies, lane, lanes, trial, row, IN_TIME[place])
    _through(bodies.tableau, curve)
    seen = _stage_of(bodies, lane, lanes, trial, row, SEVENTH)
    off = seen - value_at(curve, bodies.tableau[ROW_C, SEVENTH])
    curve[0] = min(curve[0], 0.0)
    return OF_SEVENTH * abs(off)


@scattered
def _first(bodies, lane, lanes, memory, trial, length, but):  # type: ignore[no-untyped-def]
    """Return the first row that passes 0 within a step, when, and by when it has; -1 if there is none.

    That of an event is left out, with which the step ends.
    """
    found, when, by, curve = -1, 2.0, 0.0, registers(6)
    for row in range(trial.watched.shape[2]):
        if row == but or _sleeps(bodies, lane, lanes, trial, row):
            continue
        sign, small, inner, middle = _sign(lanes.statuses[lane, row]), 0.0, 0.0, 0.0
        if row < memory.clearances.shape[1] and lanes.statuses[lane, row] != HELD:
            _between(sign, trial.watched[BEFORE], trial.watched[AFTER], row, length, curve)
            if stays_away(curve):
                continue
            middle = _doubt_of_gap(bodies, lane, trial, row, sign * length * length, curve)
        else:
            inner = _write_stages(bodies, lane, lanes, trial, row, curve)
            if row >= memory.clearances.shape[1]:
                small = _small(bodies, lane, memory, trial, row)
        share, latest = first_passage(curve, sign * trial.watched[AFTER, 0, row], inner, middle, small)
        if 0.0 <= share < when:
            found, when, by = row, share, latest
    return found, when, by


@scattered
def _watch_holding(lane, lanes, tableau, trial, length):  # type: ignore[no-untyped-def]
    """Watch the forces that hold rigid contacts in the place of their gaps, with rates by quintics over a step."""
    curve = registers(6)
    for contact in range(trial.forces.shape[1]):
        if lanes.statuses[lane, contact] == HELD:
            for place in range(len(IN_TIME)):
                curve[place] = trial.forces[IN_TIME[place], contact]
            _through(tableau, curve)
            trial.watched[AFTER, 0, contact] = trial.forces[STAGES, contact]
            trial.watched[AFTER, 1, contact] = slope_at(curve, 1.0) / length


@scattered
def _small(bodies, lane, memory, trial, row):  # type: ignore[no-untyped-def]
    """Return the size of a gap at the end of a step, of a force or of the rate of an extension, up to which it is 0."""
    size = 0.0
    if row < trial.forces.shape[1] and trial.impulses[HOLDS, row] > 0.0:
        return TURNED * max(abs(trial.forces[0, row]), abs(trial.forces[STAGES, row]))
    if row < memory.clearances.shape[1]:
        size = abs(memory.clearances[lane, row])
        for body in range(bodies.links.shape[2]):
            size += abs(bodies.links[lane, row, body] * trial.at[0, body])
        return AT * size
    for body in range(bodies.linear.shape[2]):
        size += abs(bodies.links[lane, row, body]) * max(memory.sizes[lane, 1, body], abs(trial.at[1, body]))
    return TURNED * size


@scattered
def _earlier(bodies, lane, lanes, memory, trial, row):  # type: ignore[no-untyped-def]
    """Return the row that is farthest beyond 0 at the end of a step, or the given one if none is."""
    found = row
    most = max(_sign(lanes.statuses[lane, row]) * trial.watched[AFTER, 0, row], 0.0)
    for other in range(trial.watched.shape[2]):
        beyond = _sign(lanes.statuses[lane, other]) * trial.watched[AFTER, 0, other]
        if other == row or _sleeps(bodies, lane, lanes, trial, other):
            continue
        if beyond > max(most, _small(bodies, lane, memory, trial, other)):
            found, most = other, beyond
    return found


@seldom_called
def _count_touches(bodies, lane, lanes, memory, trial, event):  # type: ignore[no-untyped-def]
    """Count contacts that come as near to 0 at the end of a step, without or with an event, as the step may be off."""
    for contact in range(trial.forces.shape[1]):
        if lanes.statuses[lane, contact] == HELD:
            continue
        size = 0.0
        for body in range(bodies.links.shape[2]):
            size += abs(bodies.links[lane, contact, body]) * memory.sizes[lane, 0, body]
        sign, within = _sign(lanes.statuses[lane, contact]), memory.steps[lane, 2] * size
        gap, rate = sign * trial.watched[AFTER, 0, contact], trial.watched[AFTER, 1, contact]
        bend = sign * trial.watched[AFTER, 2, contact]
        touches = abs(gap) <= within and bend < 0.0 and rate * rate <= -2.0 * bend * within
        if touches and (contact == event or gap <= 0.0):
            lanes.clock[lane, GRAZED] += 1.0


@scattered
def _crest(lane, lanes, tableau, trial):  # type: ignore[no-untyped-def]
    """Return the part of a step at which a contact has its largest force so far, 0 if none has within it.

    Forces are quintics through those of some stages. Of logged impacts each has a largest force.
    """
    largest, curve = OF_IMPACT + LARGEST - BEGAN if lanes.log.shape[1] else PEAK, registers(6)
    for contact in range(trial.forces.shape[1]):
        if lanes.statuses[lane, contact] != CLOSED:
            continue
        for place in range(len(IN_TIME)):
            curve[place] = trial.forces[IN_TIME[place], contact]
        _through(tableau, curve)
        before, least = curve[1], max(curve[0], trial.forces[STAGES, contact], lanes.contacts[lane, largest, contact])
        for place in range(1, LOOKS + 1):
            low, high = (place - 1) / LOOKS, place / LOOKS
            slope = slope_at(curve, high)
            if before > 0.0 >= slope:
                for _ in range(30):
                    share = 0.5 * (low + high)
                    if slope_at(curve, share) > 0.0:
                        low = share
                    else:
                        high = share
                if value_at(curve, low) > (1.0 + CREST) * least:
                    return low
            before = slope
    return 0.0


@scattered
def _extension(bodies, lane, row, x):  # type: ignore[no-untyped-def]
    """Return the extension of a law."""
    total = 0.0
    for body in range(bodies.links.shape[2]):
        total += bodies.links[lane, row, body] * x[body]
    return total


@seldom_called
def _begin_states(bodies, lane, numbers, trial, nudge):  # type: ignore[no-untyped-def]
    """Take the states at the beginning of a step, as of a contact that has just closed, and how they change onwards.

    The latter is by extension, a moment later: a kink may be at the beginning, but for rounding.
    """
    states, later, contacts = trial.states, borrow(trial.at[2]), trial.forces.shape[1]
    for state in range(states.shape[1]):
        if states[LINK_ROW, state] > 0.0:
            states[0, state] = states[TRIAL_ROW, state]
    for moments in range(1, 3):
        put_states(numbers, states, 0)
        look_at_states(
            bodies, numbers, trial.x, trial.v, trial.stages[0, 1], trial, 0, moments * nudge, TRIAL_ROW + moments
        )
        for state in range(states.shape[1]):
            law = int(states[LINK_ROW, state])
            if law <= 0:
                continue
            place = _extension(bodies, lane, contacts + law - 1, later)
            if moments == 1:
                states[SLOPE_ROW, state] = place
            else:
                way = place - states[SLOPE_ROW, state]
                change = states[TRIAL_ROW + 2, state] - states[TRIAL_ROW + 1, state]
                states[SLOPE_ROW, state] = change / way if way != 0.0 else math.nan


@scattered
def _steepness(bodies, lane, lanes, memory, trial, state, row):  # type: ignore[no-untyped-def]
    """Return how a state changes by extension at the end of a step; NaN where this has turned."""
    turn = row + memory.clearances.shape[1] - trial.forces.shape[1]
    way = 1.0 if lanes.statuses[lane, turn] == SLIPS_UP else -1.0
    change, along = trial.states[RATE_ROW + STAGES, state], trial.watched[AFTER, 0, turn]
    if trial.states[LINK_ROW, state] > 0.0:
        change = trial.states[TRIAL_ROW, state] - trial.states[TRIAL_ROW + 1, state]
        along = _extension(bodies, lane, row, trial.at[0]) - _extension(bodies, lane, row, trial.at[2])
    return change / along if way * along > 0.0 else math.nan


@scattered
def _kink(trial, state, begin, end, steep, zero):  # type: ignore[no-untyped-def]
    """Return the extension at which a state has a kink in a step, NaN if it has none.

    There a state begins to follow the extension, or ceases to, evenly on either side; or it passes 0, unevenly. It is
    at 0 up to a `zero`, which rounding leaves.
    """
    first, last, slope = trial.states[0, state], trial.states[TRIAL_ROW, state], trial.states[SLOPE_ROW, state]
    moved, exact = last - first, trial.states[LINK_ROW, state] > 0.0
    if exact and slope != 0.0 and steep == 0.0:
        return begin + moved / slope
    if exact and slope == 0.0 and steep != 0.0 and moved != 0.0:
        return end - moved / steep
    passes = abs(first) > max(EVEN * abs(moved), zero) and abs(last) < abs(moved)
    if passes and steep != 0.0 and abs(moved - steep * (end - begin)) > EVEN * abs(moved):
        return end - last / steep
    return math.nan


@seldom_called
def _find_kinks(bodies, lane, lanes, memory, numbers, trial, length):  # type: ignore[no-untyped-def]
    """Find kinks of laws within a step, and let their rows watch for them."""
    states, contacts = trial.states, trial.forces.shape[1]
    put_states(numbers, states, 0)
    look_at_states(
        bodies,
        numbers,
        trial.at[0],
        trial.at[1],
        trial.stages[STAGES, 1],
        trial,
        STAGES,
        -NUDGE * length,
        TRIAL_ROW + 1,
    )
    for state in range(states.shape[1]):
        row = contacts + int(abs(states[LINK_ROW, state])) - 1
        if row < contacts:
            continue
        begin, end = _extension(bodies, lane, row, trial.x), _extension(bodies, lane, row, trial.at[0])
        steep = _steepness(bodies, lane, lanes, memory, trial, state, row)
        place = _kink(trial, state, begin, end, steep, AT_ZERO * memory.states[lane, state])
        if math.isnan(steep) or math.isnan(place):
            continue
        memory.clearances[lane, row] = place
        lanes.statuses[lane, row] = OPEN if begin < end else CLOSED
        trial.watched[BEFORE, 0, row], trial.watched[AFTER, 0, row] = begin - place, end - place


@scattered
def _begin(bodies, lane, lanes, memory, numbers, trial, time):  # type: ignore[no-untyped-def]
    """Write the first stage of a step, and the gaps at its beginning."""
    for state in range(trial.states.shape[1]):
        trial.states[NOW_ROW, state] = trial.states[0, state]
    nudge = NUDGE * memory.steps[lane, 0]
    later, pulled = time + moment(time, 0.0), 0
    for contact in range(trial.forces.shape[1]):
        trial.impulses[HOLDS, contact] = 1.0 if lanes.statuses[lane, contact] == HELD else 0.0
    while pulled >= 0:
        evaluate(bodies, lane, numbers, later, trial.x, trial.v, trial, nudge, 0)
        pulled = -1
        for contact in range(trial.forces.shape[1]):
            if trial.impulses[HOLDS, contact] > 0.0 and trial.forces[0, contact] <= 0.0:
                pulled = contact
                break
        if pulled >= 0:
            trial.impulses[HOLDS, pulled] = 0.0
            lanes.statuses[lane, pulled] = OPEN
            note(lanes, lane, time, pulled, HELD, 0.0, 0.0)
    write_gaps(bodies, lane, memory.clearances[lane], trial.x, trial.v, trial.stages[0, 1], trial.watched, BEFORE)
    for row in range(memory.clearances.shape[1], trial.watched.shape[2]):
        rate, size = trial.watched[BEFORE, 0, row], _small(bodies, lane, memory, trial, row)
        onward = rate if abs(rate) > size else trial.watched[BEFORE, 1, row]
        lanes.statuses[lane, row] = SLIPS_DOWN if onward < 0.0 else SLIPS_UP
    for row in range(trial.forces.shape[1], memory.clearances.shape[1]):
        lanes.statuses[lane, row] = PARTED
    if trial.watched.shape[2] > trial.forces.shape[1]:
        _begin_states(bodies, lane, numbers, trial, nudge)


@seldom_called
def _keep_nodes(bodies, lane, lanes, trial, length):  # type: ignore[no-untyped-def]
    """Keep the stages of a step as nodes of integrals, and its end, which has no weight."""
    count, contacts, time = bodies.linear.shape[2], trial.forces.shape[1], lanes.clock[lane, NOW]
    for stage in range(STAGES + 1):
        share = bodies.tableau[ROW_B, stage] if stage < STAGES else 0.0
        if share == 0.0 and stage < STAGES:
            continue
        node, row = lanes.nodes[lane, lanes.noded[lane]], stage if stage < STAGES else ROW_B
        lanes.noded[lane] += 1
        node[NODE_TIME], node[NODE_WEIGHT] = time + bodies.tableau[ROW_C, stage] * length, share * length
        for body in range(count):
            place = 0.0
            for before in range(stage):
                place += bodies.tableau[row, before] * trial.stages[before, 0, body]
            node[NODE_STATE + body] = trial.x[body] + length * place
            node[NODE_STATE + count + body] = trial.stages[stage, 0, body]
        for contact in range(contacts):
            node[NODE_STATE + 2 * count + contact] = trial.forces[stage, contact]
        for state in range(trial.states.shape[1]):
            node[NODE_STATE + 2 * count + contacts + state] = trial.states[STAGE_ROW + stage, state]


@scattered
def _accept(bodies, lane, lanes, memory, trial, length, summed):  # type: ignore[no-untyped-def]
    """Take a step: its sums, its end as the next beginning, and the sizes of the motion."""
    if summed and lanes.nodes.shape[1] > 0:
        _keep_nodes(bodies, lane, lanes, trial, length)
    if summed:
        for row in range(4):
            for place in range(trial.sums.shape[1]):
                lanes.bodies[lane, row, place] += trial.sums[row, place]
        for contact in range(trial.forces.shape[1]):
            if lanes.statuses[lane, contact] == OPEN:
                continue
            lasts = length
            if lanes.statuses[lane, contact] == HELD:
                end = lanes.clock[lane, NOW] + lanes.clock[lane, LOST] + length
                lasts = min(max(end - lanes.contacts[lane, RESTS_FROM, contact], 0.0), length)
            lanes.contacts[lane, RATIO, contact] += lasts
            lanes.contacts[lane, OF_IMPACT + DURATION - BEGAN, contact] += lasts
            lanes.contacts[lane, PRESSED, contact] += trial.impulses[0, contact]
            lanes.contacts[lane, OF_IMPACT + IMPULSE - BEGAN, contact] += trial.impulses[0, contact]
            if lanes.statuses[lane, contact] == HELD:
                continue
            most = max(trial.forces[0, contact], trial.forces[STAGES, contact])
            lanes.contacts[lane, PEAK, contact] = max(lanes.contacts[lane, PEAK, contact], most)
            most = max(lanes.contacts[lane, OF_IMPACT + LARGEST - BEGAN, contact], most)
            lanes.contacts[lane, OF_IMPACT + LARGEST - BEGAN, contact] = most
            lanes.contacts[lane, OF_IMPACT + LOST_ENERGY - BEGAN, contact] += trial.impulses[WORKED, contact]
    for contact in range(trial.forces.shape[1]):
        lanes.contacts[lane, GATHERED, contact] += trial.impulses[0, contact]
        trial.forces[0, contact] = trial.forces[STAGES, contact]
    for row in range(trial.watched.shape[2]):
        for level in range(3):
            trial.watched[BEFORE, level, row] = trial.watched[AFTER, level, row]
    for state in range(trial.states.shape[1]):
        trial.states[0, state] = trial.states[TRIAL_ROW, state]
        trial.states[RATE_ROW, state] = trial.states[RATE_ROW + STAGES, state]
        trial.states[STAGE_ROW, state] = trial.states[STAGE_ROW + STAGES, state]
        size = abs(trial.states[0, state])
        memory.states[lane, state] = max(memory.states[lane, state], size)
    for body in range(bodies.linear.shape[2]):
        trial.x[body], trial.v[body] = trial.at[0, body], trial.at[1, body]
        for quantity in range(2):
            trial.stages[0, quantity, body] = trial.stages[STAGES, quantity, body]
            size = abs(trial.at[quantity, body])
            memory.sizes[lane, quantity, body] = max(memory.sizes[lane, quantity, body], size)


@scattered
def _set(bodies, lane, lanes, memory, numbers, trial, contact):  # type: ignore[no-untyped-def]
    """Let the forces of a contact be those of its state: none while it is open; else its gap is above 0."""
    if lanes.statuses[lane, contact] == OPEN:
        numbers[bodies.places[contact]] = FAR
    else:
        within = max(_small(bodies, lane, memory, trial, contact), LEAST_GAP)
        gap = min(trial.watched[AFTER, 0, contact], 0.0)
        numbers[bodies.places[contact]] = memory.clearances[lane, contact] + gap - within


@seldom_called
def _collide(rigid, lane, lanes, trial, contact, twist, tolerance):  # type: ignore[no-untyped-def]
    """Let a rigid contact close, or open after a rest; return whether the motion goes on."""
    time, levels = lanes.clock[lane, NOW] + lanes.clock[lane, LOST], registers(3)
    sizes, limits = registers(2), registers(2)
    if lanes.statuses[lane, contact] == HELD:
        lanes.statuses[lane, contact] = OPEN
        note(lanes, lane, time, contact, HELD, 0.0, 0.0)
        return True
    for place in range(trial.free.shape[0]):
        lanes.v[lane, place] = trial.v[trial.free[place]]
    for other in range(rigid.kinds.shape[0]):  # steps leave a little of the rates of contacts at rest
        if lanes.statuses[lane, other] == HELD:
            left = rate_of_gap(rigid, lane, other, time, lanes.v)[0] * rigid.contacts[lane, other, EFFECTIVE_MASS]
            for place in range(trial.free.shape[0]):
                lanes.v[lane, place] -= left * rigid.pushes[lane, other, place]
    levels[2], limits[1], sizes[1] = trial.watched[AFTER, 2, contact], twist, 0.0
    goes_on = impact(rigid, lane, lanes, contact, time, tolerance, Before(levels, sizes, limits))
    for place in range(trial.free.shape[0]):
        trial.v[trial.free[place]] = lanes.v[lane, place]
    return goes_on


@seldom_called
def _change(bodies, lane, lanes, memory, numbers, trial, contact):  # type: ignore[no-untyped-def]
    """Open or close a contact with a law, and note it."""
    status, time = lanes.statuses[lane, contact], lanes.clock[lane, NOW] + lanes.clock[lane, LOST]
    rate, leaving = trial.watched[AFTER, 1, contact], math.nan
    if status == OPEN:
        lanes.statuses[lane, contact] = CLOSED
        begin_impact(lanes, lane, time, contact, rate)
        if time >= 0.0:
            lanes.contacts[lane, CLOSINGS, contact] += 1.0
    else:
        lanes.statuses[lane, contact], leaving = OPEN, -rate
    note(lanes, lane, time, contact, status, rate, leaving)
    _set(bodies, lane, lanes, memory, numbers, trial, contact)


@scattered
def _happen(rigid, bodies, lane, lanes, memory, numbers, trial, contact, twist, span):  # type: ignore[no-untyped-def]
    """Let an event happen; laws with kinks and turns see to themselves at the next beginning."""
    lanes.clock[lane, COUNT] += 1.0
    lanes.clock[lane, WHICH] = contact
    if contact >= trial.forces.shape[1]:
        return True
    if lanes.states.shape[1] > 0:
        for place in range(trial.free.shape[0]):
            lanes.x[lane, place], lanes.v[lane, place] = trial.x[trial.free[place]], trial.v[trial.free[place]]
    if rigid.kinds[contact] == RIGID:
        return _collide(rigid, lane, lanes, trial, contact, twist, span.tolerance)
    _change(bodies, lane, lanes, memory, numbers, trial, contact)
    return True


@scattered
def _sample(rigid, lane, lanes, trial):  # type: ignore[no-untyped-def]
    """Write displacements and velocities of free bodies, and contact forces."""
    number, place = trial.free.shape[0], int(lanes.clock[lane, NEXT])
    for entry in range(number):
        body = trial.free[entry]
        lanes.samples[lane, place, entry] = trial.x[body]
        lanes.samples[lane, place, number + entry] = trial.v[body]
    for contact in range(trial.forces.shape[1]):
        lanes.samples[lane, place, 2 * number + contact] = trial.forces[0, contact]
        if rigid.kinds[contact] == RIGID:
            impulse = lanes.contacts[lane, GATHERED, contact] if place > 0 else 0.0
            lanes.samples[lane, place, 2 * number + contact] = impulse
        lanes.contacts[lane, GATHERED, contact] = 0.0
    for state in range(trial.states.shape[1]):
        lanes.samples[lane, place, 2 * number + trial.forces.shape[1] + state] = trial.states[0, state]
    lanes.clock[lane, NEXT] += 1.0


@scattered
def _next_end(lane, lanes, memory, time):  # type: ignore[no-untyped-def]
    """Return the time at which the next step ends at the latest, and whether there is a sample, and a change, then."""
    end, sampled, changed = lanes.ends[lane], False, False
    if time < 0.0:
        end = min(end, 0.0)
    due = due_of(lane, lanes)
    if due <= end * (1.0 + LATE):
        end, sampled = min(due, lanes.ends[lane]), True
    place = np.searchsorted(memory.ends, time, side="right")
    if place < memory.ends.shape[0] and memory.ends[place] <= end:
        sampled, end, changed = sampled and memory.ends[place] == end, memory.ends[place], True
    return end, sampled, changed


@scattered
def _scaled(error, allowed):  # type: ignore[no-untyped-def]
    """Return the factor by which a step may be longer, from its error and that which is allowed."""
    if not error < math.inf:
        return SHORTENED
    if error == 0.0:
        return LENGTHENED
    return min(LENGTHENED, max(SHORTENED, SAFETY * (allowed / error) ** (1.0 / STEP_ORDER)))


@scattered
def _is_rounding(error, allowed, length, bracket):  # type: ignore[no-untyped-def]
    """Whether an error is beyond what is allowed, but hardly less than that of a step 1000 times as long.

    Across a kink of a force it would be a millionth.
    """
    first = bracket[4]
    return allowed < error < math.inf and length < 1e-3 * first and error > bracket[5] * math.sqrt(length / first)


@scattered
def _refuse(lane, memory, time, length, error, factor, bracket):  # type: ignore[no-untyped-def]
    """Choose a shorter length for a step that is refused; return whether it is more than rounding of the time."""
    if bracket[4] == 0.0:
        bracket[4], bracket[5] = length, error
    memory.steps[lane, 0] = length * min(factor, SAFETY)
    return memory.steps[lane, 0] > AT * abs(time)


@scattered
def _start(lane, lanes, memory, trial):  # type: ignore[no-untyped-def]
    """Bring the motion of a lane into the memory of its steps."""
    numbers = borrow(memory.parameters[lane])
    for state in range(trial.states.shape[1]):
        trial.states[0, state] = numbers[numbers.shape[0] - BEHIND - trial.states.shape[1] + state]
    trial.x[:] = 0.0
    trial.v[:] = 0.0
    for place in range(trial.free.shape[0]):
        trial.x[trial.free[place]], trial.v[trial.free[place]] = lanes.x[lane, place], lanes.v[lane, place]
    for body in range(trial.x.shape[0]):
        trial.at[0, body], trial.at[1, body] = trial.x[body], trial.v[body]


@scattered
def _stop(lane, lanes, memory, trial):  # type: ignore[no-untyped-def]
    """Bring the motion of a lane back."""
    put_states(borrow(memory.parameters[lane]), trial.states, 0)
    for place in range(trial.free.shape[0]):
        lanes.x[lane, place], lanes.v[lane, place] = trial.x[trial.free[place]], trial.v[trial.free[place]]


@scattered
def _advance(lane, lanes, memory, contact, length, factor, cut):  # type: ignore[no-untyped-def]
    """Advance the clock by a step, and choose the length of the next one; return whether it goes on.

    A step that was cut short for other reasons than its error leaves the length of others as it was.
    """
    clock, time = lanes.clock, lanes.clock[lane, NOW] + lanes.clock[lane, LOST]
    least = memory.steps[lane, 0] if cut else LEAST_STEP * memory.steps[lane, 1]
    memory.steps[lane, 0] = max(least, length * factor)
    before, step = clock[lane, NOW], length + clock[lane, LOST]
    clock[lane, NOW] = before + step
    clock[lane, LOST] = step - (clock[lane, NOW] - before)
    clock[lane, REPEATS] = clock[lane, REPEATS] + 1.0 if contact >= 0 and length <= AT * abs(time) else 0.0
    return clock[lane, REPEATS] <= SAME_TIME


@scattered
def _again(bodies, lane, lanes, memory, trial, contact, length, bracket):  # type: ignore[no-untyped-def]
    """Return the contact that a step is to end at, -1 for none, and the next length to try, 0 if this one will do.

    The bracket has a length before the event and one behind it, whether the latter was seen to be, and the trials.
    """
    nearest = _earlier(bodies, lane, lanes, memory, trial, contact)
    if nearest != contact:
        contact, bracket[0], bracket[3] = nearest, 0.0, 0.0
    sign = _sign(lanes.statuses[lane, contact])
    value, slope = sign * trial.watched[AFTER, 0, contact], sign * trial.watched[AFTER, 1, contact]
    bracket[3] += 1.0
    if abs(value) <= _small(bodies, lane, memory, trial, contact):
        other, share, by = _first(bodies, lane, lanes, memory, trial, length, contact)
        if other >= 0 and by > 0.0 and share < BEFORE_EVENT:
            bracket[0], bracket[1], bracket[2], bracket[3] = 0.0, by * length, 0.0, 0.0
            return other, share * length
        return contact, 0.0
    if value > 0.0:
        bracket[1], bracket[2] = length, 1.0
    else:
        bracket[0] = length
    following = length - value / slope if slope > 0.0 else 0.0
    if not bracket[0] < following < bracket[1]:
        following = 0.5 * (bracket[0] + bracket[1])
    if bracket[3] < REFINED and abs(following - length) > AT * length:
        return contact, following
    return contact if bracket[2] > 0.0 else -1, 0.0


@scattered
def _shorter(bodies, lane, lanes, memory, trial, length, topped, summed, bracket):  # type: ignore[no-untyped-def]
    """Return the contact that a step is to end at, -1 for none, and a shorter length for it, 0 if it may be as it is.

    It ends where a gap passes 0, at tops of gaps that may be above 0, or once at the largest force of a contact.
    """
    contact, share, by = _first(bodies, lane, lanes, memory, trial, length, -1)
    if contact >= 0 and by > 0.0:
        bracket[0], bracket[1], bracket[2], bracket[3] = 0.0, by * length, 0.0, 0.0
        return contact, share * length
    if contact >= 0 and topped < TOPS:
        return -1, share * length
    if contact >= 0:
        lanes.clock[lane, GRAZED] += 1.0
    if topped > 0 or not summed:
        return -1, 0.0
    return -1, length * _crest(lane, lanes, bodies.tableau, trial)


@scattered
def _pauses(lane, lanes, memory):  # type: ignore[no-untyped-def]
    """Whether the first stage of a step is made anew, so that a call may end: it has the same bits wherever it does."""
    if lanes.clock[lane, EVALUATIONS] < memory.steps[lane, 3] and not nodes_full(lanes, lane):
        return False
    memory.steps[lane, 3] += PAUSE
    return True


@scattered
def _lane(rigid, bodies, lane, lanes, memory, span, trial):  # type: ignore[no-untyped-def]
    """Run a lane until it ends, or something is missing; return which."""
    numbers, allowed, ready = borrow(memory.parameters[lane]), memory.steps[lane, 2], lanes.clock[lane, EVALUATIONS]
    time, end, left, length, bracket = 0.0, 0.0, 0.0, 0.0, borrow(memory.brackets[lane])
    contact, topped, changed, sampled, summed = -1, 0, True, False, False
    while True:
        if contact < 0 and topped == 0:  # a new step
            time = lanes.clock[lane, NOW] + lanes.clock[lane, LOST]
            changed = changed or _pauses(lane, lanes, memory)
            if changed:
                if log_full(lanes, lane) or nodes_full(lanes, lane):
                    return LOG_FULL
                if lanes.clock[lane, EVALUATIONS] - ready > span.looks:
                    return INTERRUPTED
                _begin(bodies, lane, lanes, memory, numbers, trial, time)
            end, sampled, changed = _next_end(lane, lanes, memory, time)
            left, summed = end - time, time >= 0.0 and span.summed
            if left <= 0.0 and not sampled:
                return ARRIVED
            if left <= 0.0:
                _sample(rigid, lane, lanes, trial)
                changed = False
                continue
            length = min(memory.steps[lane, 0], memory.steps[lane, 1])
            length = left if length * (1.0 + 1e-3) >= left else length
        error = make_step(bodies, lane, memory, numbers, trial, time, length)
        lanes.clock[lane, EVALUATIONS] += STAGES
        _watch_holding(lane, lanes, bodies.tableau, trial, length)
        if trial.watched.shape[2] > trial.forces.shape[1]:
            _find_kinks(bodies, lane, lanes, memory, numbers, trial, length)
        factor = _scaled(error, allowed)
        if _is_rounding(error, allowed, length, bracket):
            factor = LENGTHENED
        elif not error <= allowed:
            contact, topped, changed = -1, 0, False
            if _refuse(lane, memory, time, length, error, factor, bracket):
                continue
            return STUCK
        bracket[4] = 0.0
        if contact < 0:
            contact, shorter = _shorter(bodies, lane, lanes, memory, trial, length, topped, summed, bracket)
            topped += 1 if contact < 0 and shorter > 0.0 else 0
        else:
            contact, shorter = _again(bodies, lane, lanes, memory, trial, contact, length, bracket)
        if shorter > 0.0:
            length = shorter
            continue
        ends = length == left and contact < 0
        changed = (changed and ends) or contact >= 0
        twist = (
            abs(trial.watched[AFTER, 2, contact] - trial.watched[BEFORE, 2, contact]) / length if contact >= 0 else 0.0
        )
        if contact >= 0 or topped > 0:
            _count_touches(bodies, lane, lanes, memory, trial, contact)
        _accept(bodies, lane, lanes, memory, trial, length, summed)
        goes_on = _advance(lane, lanes, memory, contact, length, factor, contact < 0 and (ends or topped > 0))
        if ends:
            lanes.clock[lane, NOW], lanes.clock[lane, LOST] = end, 0.0
        if contact >= 0:
            goes_on &= _happen(rigid, bodies, lane, lanes, memory, numbers, trial, contact, twist, span)
        contact, topped = -1, 0
        if not goes_on:
            return STUCK


def _run(rigid, bodies, lanes, memory, span, trial, begins, ends, results):  # type: ignore[no-untyped-def]
    """Run some lanes; write why each of them stopped."""
    rigid, bodies, lanes, memory, trial = borrow(rigid), borrow(bodies), borrow(lanes), borrow(memory), borrow(trial)
    for lane in range(begins, ends):
        if results[lane] != ARRIVED:
            _start(lane, lanes, memory, trial)
            results[lane] = _lane(rigid, bodies, lane, lanes, memory, span, trial)
            _stop(lane, lanes, memory, trial)


def stepping_loop() -> Callable[..., None]:
    """Return the compiled loop."""
    return loop(signature(True, Rigid, Bodies, Lanes, Memory, Span, Trial, int, int, Slots), _run)
