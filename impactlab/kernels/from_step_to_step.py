"""The motion of networks in which nothing is random, by steps that end where events are.

During a step no contact changes: an open one has no force, however far a trial goes. Where a gap passes 0 within a
trial, the step is made again with another length until it ends there, so that the forces of a step are smooth, and the
path has the order of the method.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from impactlab.compiling.intrinsics import borrow
from impactlab.compiling.jit import loop, scattered
from impactlab.compiling.records import Slots, signature
from impactlab.kernels.contact_states import CLOSED, OPEN
from impactlab.kernels.event_log import (
    BEGAN,
    DURATION,
    IMPULSE,
    LARGEST,
    LOST_ENERGY,
    OF_IMPACT,
    begin_impact,
    log_full,
    note,
)
from impactlab.kernels.from_event_to_event import (
    ARRIVED,
    CLOSINGS,
    COUNT,
    EVALUATIONS,
    GATHERED,
    INTERRUPTED,
    LOG_FULL,
    LOST,
    NEXT,
    NOW,
    PEAK,
    PRESSED,
    RATIO,
    REPEATS,
    SAME_TIME,
    STUCK,
    WHICH,
    Lanes,
    Span,
)
from impactlab.kernels.memory import BEHIND
from impactlab.kernels.smooth_steps import (
    AFTER,
    AT,
    BEFORE,
    FORCE_ROW,
    IN_STAGE,
    IN_TIME,
    NOW_ROW,
    NUDGE,
    RATE_ROW,
    ROW_QUINTIC,
    STAGES,
    TRIAL_ROW,
    Bodies,
    Memory,
    Trial,
    evaluate,
    make_step,
    moment,
    put_states,
    write_gaps,
)

CREST = 1e-10
"""Part of the largest force so far by which another must be larger for a step to end at it."""

STEP_ORDER = 8.0
"""Order of the step, of which its error is a power."""

SAFETY, SHORTENED, LENGTHENED = 0.9, 0.2, 6.0
"""Part of the length that the error allows, and the factors by which it may change at once."""

LOOKS = 8
"""Parts of a step in which passages of a gap through 0 are looked for."""

REFINED = 60
"""Trials that may end at an event: Newton's method needs three, bisection fifty."""

PAUSE = 20_000.0
"""Evaluations of the forces between places where a call may end, about."""

FAR = 1e30
"""Clearance of an open contact, at which its force is 0 whatever a trial does (m)."""


@scattered
def _passage(sign, before, after, contact, length):  # type: ignore[no-untyped-def]
    """Return the part of a step at which ``sign gap`` first passes 0 upwards, and by when it has; -1 if it does not.

    The gap is Hermite's quintic between the ends of the step. Where its top is below 0 by less than it differs from
    Hermite's cubic, the first part is that of the top, and the second is 0.
    """
    c0, c1, c2 = sign * before[0, contact], sign * length * before[1, contact], 0.5 * length**2 * before[2, contact]
    c0, c2 = min(c0, 0.0), sign * c2
    rise = sign * after[0, contact] - c0 - c1 - c2
    slope = sign * length * after[1, contact] - c1 - 2.0 * c2
    bend = sign * length**2 * after[2, contact] - 2.0 * c2
    c3 = 10.0 * rise - 4.0 * slope + 0.5 * bend
    c4 = 7.0 * slope - 15.0 * rise - bend
    c5 = 6.0 * rise - 3.0 * slope + 0.5 * bend
    last, value, top, at = c0, c0, -math.inf, -1.0
    for place in range(1, LOOKS + 1):
        share = place / LOOKS
        following = c0 + share * (c1 + share * (c2 + share * (c3 + share * (c4 + share * c5))))
        if place == LOOKS:
            following = sign * after[0, contact]
        if following > 0.0:
            low, high = share - 1.0 / LOOKS, share
            for _ in range(30):
                share = 0.5 * (low + high)
                if c0 + share * (c1 + share * (c2 + share * (c3 + share * (c4 + share * c5)))) > 0.0:
                    high = share
                else:
                    low = share
            return high, place / LOOKS
        if place > 1 and value >= last and value >= following:
            curve = last - 2.0 * value + following
            shift = 0.5 * (last - following) / curve if curve < 0.0 else 0.0
            peak = value - 0.25 * (last - following) * shift
            if peak > top:
                top, at = peak, (place - 1 + shift) / LOOKS
        last, value = value, following
    half = 0.5 * (2.0 * c0 + c1 + c2 + rise) + 0.125 * (c1 - (slope + c1 + 2.0 * c2))
    middle = c0 + 0.5 * (c1 + 0.5 * (c2 + 0.5 * (c3 + 0.5 * (c4 + 0.5 * c5))))
    if top > -abs(middle - half) and 0.1 < at < 0.9:
        return at, 0.0
    return -1.0, 0.0


@scattered
def _sign(status):  # type: ignore[no-untyped-def]
    """Return the sign with which the gap of a contact is negative until its next event."""
    return 1.0 if status == OPEN else -1.0


@scattered
def _first(lane, lanes, trial, length):  # type: ignore[no-untyped-def]
    """Return the first contact whose gap passes 0 within a step, when, and by when it has; -1 if there is none."""
    found, when, by = -1, 2.0, 0.0
    for contact in range(trial.forces.shape[1]):
        sign = _sign(lanes.statuses[lane, contact])
        share, latest = _passage(sign, trial.contacts[BEFORE], trial.contacts[AFTER], contact, length)
        if 0.0 <= share < when:
            found, when, by = contact, share, latest
    return found, when, by


@scattered
def _small(bodies, lane, memory, trial, contact):  # type: ignore[no-untyped-def]
    """Return the size of a gap at the end of a step up to which it is 0."""
    size = abs(memory.clearances[lane, contact])
    for body in range(bodies.links.shape[2]):
        size += abs(bodies.links[lane, contact, body] * trial.at[0, body])
    return AT * size


@scattered
def _earlier(bodies, lane, lanes, memory, trial, contact):  # type: ignore[no-untyped-def]
    """Return the contact whose gap is farthest beyond 0 at the end of a step, or the given one if none is."""
    found = contact
    most = max(_sign(lanes.statuses[lane, contact]) * trial.contacts[AFTER, 0, contact], 0.0)
    for other in range(trial.forces.shape[1]):
        beyond = _sign(lanes.statuses[lane, other]) * trial.contacts[AFTER, 0, other]
        if other != contact and beyond > max(most, _small(bodies, lane, memory, trial, other)):
            found, most = other, beyond
    return found


@scattered
def _crest(lane, lanes, tableau, trial):  # type: ignore[no-untyped-def]
    """Return the part of a step at which a contact has its largest force so far, 0 if none has within it.

    Forces are quintics through those of some stages. Of logged impacts each has a largest force.
    """
    largest = OF_IMPACT + LARGEST - BEGAN if lanes.log.shape[1] else PEAK
    for contact in range(trial.forces.shape[1]):
        if lanes.statuses[lane, contact] == OPEN:
            continue
        c1, c2, c3, c4, c5 = 0.0, 0.0, 0.0, 0.0, 0.0
        first, last = trial.forces[0, contact], trial.forces[STAGES, contact]
        for place in range(1, len(IN_TIME)):
            force = trial.forces[IN_TIME[place], contact] - first
            c1 += tableau[ROW_QUINTIC, place] * force
            c2 += tableau[ROW_QUINTIC + 1, place] * force
            c3 += tableau[ROW_QUINTIC + 2, place] * force
            c4 += tableau[ROW_QUINTIC + 3, place] * force
            c5 += tableau[ROW_QUINTIC + 4, place] * force
        before = c1
        for place in range(1, LOOKS + 1):
            high, low = place / LOOKS, (place - 1) / LOOKS
            slope = c1 + high * (2.0 * c2 + high * (3.0 * c3 + high * (4.0 * c4 + high * 5.0 * c5)))
            if before > 0.0 >= slope:
                for _ in range(30):
                    share = 0.5 * (low + high)
                    if c1 + share * (2.0 * c2 + share * (3.0 * c3 + share * (4.0 * c4 + share * 5.0 * c5))) > 0.0:
                        low = share
                    else:
                        high = share
                top = first + low * (c1 + low * (c2 + low * (c3 + low * (c4 + low * c5))))
                if top > (1.0 + CREST) * max(first, last, lanes.contacts[lane, largest, contact]):
                    return low
            before = slope
    return 0.0


@scattered
def _begin(bodies, lane, memory, numbers, trial, time):  # type: ignore[no-untyped-def]
    """Write the first stage of a step, and the gaps at its beginning."""
    for state in range(trial.states.shape[1]):
        trial.states[NOW_ROW, state] = trial.states[0, state]
    nudge = NUDGE * memory.steps[lane, 0]
    later = time + moment(time, 0.0)
    evaluate(bodies, lane, numbers, later, trial.x, trial.v, trial, nudge, 0)
    for contact in range(trial.forces.shape[1]):
        trial.contacts[BEFORE, FORCE_ROW, contact] = trial.contacts[IN_STAGE, FORCE_ROW, contact]
    write_gaps(bodies, lane, memory.clearances[lane], trial.x, trial.v, trial.stages[0, 1], trial.contacts, BEFORE)


@scattered
def _accept(bodies, lane, lanes, memory, trial, length, summed):  # type: ignore[no-untyped-def]
    """Take a step: its sums, its end as the next beginning, and the sizes of the motion."""
    if summed:
        for row in range(4):
            for place in range(trial.sums.shape[1]):
                lanes.bodies[lane, row, place] += trial.sums[row, place]
        for contact in range(trial.forces.shape[1]):
            if lanes.statuses[lane, contact] == OPEN:
                continue
            lanes.contacts[lane, RATIO, contact] += length
            lanes.contacts[lane, PRESSED, contact] += trial.impulses[0, contact]
            most = max(trial.forces[0, contact], trial.forces[STAGES, contact])
            lanes.contacts[lane, PEAK, contact] = max(lanes.contacts[lane, PEAK, contact], most)
            most = max(lanes.contacts[lane, OF_IMPACT + LARGEST - BEGAN, contact], most)
            lanes.contacts[lane, OF_IMPACT + LARGEST - BEGAN, contact] = most
            lanes.contacts[lane, OF_IMPACT + DURATION - BEGAN, contact] += length
            lanes.contacts[lane, OF_IMPACT + IMPULSE - BEGAN, contact] += trial.impulses[0, contact]
            lanes.contacts[lane, OF_IMPACT + LOST_ENERGY - BEGAN, contact] += trial.impulses[1, contact]
    for contact in range(trial.forces.shape[1]):
        lanes.contacts[lane, GATHERED, contact] += trial.impulses[0, contact]
        for row in range(4):
            trial.contacts[BEFORE, row, contact] = trial.contacts[AFTER, row, contact]
    for state in range(trial.states.shape[1]):
        trial.states[0, state] = trial.states[TRIAL_ROW, state]
        trial.states[RATE_ROW, state] = trial.states[RATE_ROW + STAGES, state]
        size = abs(trial.states[0, state])
        memory.states[lane, state] = max(memory.states[lane, state], size)
    for body in range(bodies.linear.shape[2]):
        trial.x[body], trial.v[body] = trial.at[0, body], trial.at[1, body]
        for quantity in range(2):
            trial.stages[0, quantity, body] = trial.stages[STAGES, quantity, body]
            size = abs(trial.at[quantity, body])
            memory.sizes[lane, quantity, body] = max(memory.sizes[lane, quantity, body], size)


@scattered
def _set(bodies, lane, lanes, memory, numbers, contact, gap):  # type: ignore[no-untyped-def]
    """Let the forces of a contact be those of its state: none while it is open; else its gap is not below 0."""
    if lanes.statuses[lane, contact] == OPEN:
        numbers[bodies.places[contact]] = FAR
    else:
        clearance = memory.clearances[lane, contact]
        numbers[bodies.places[contact]] = clearance + min(gap, 0.0) - AT * abs(clearance)


@scattered
def _change(bodies, lane, lanes, memory, numbers, trial, contact):  # type: ignore[no-untyped-def]
    """Open or close a contact, and note it."""
    status, time = lanes.statuses[lane, contact], lanes.clock[lane, NOW] + lanes.clock[lane, LOST]
    rate, leaving = trial.contacts[AFTER, 1, contact], math.nan
    if status == OPEN:
        lanes.statuses[lane, contact] = CLOSED
        begin_impact(lanes, lane, time, contact, rate)
        if time >= 0.0:
            lanes.contacts[lane, CLOSINGS, contact] += 1.0
    else:
        lanes.statuses[lane, contact], leaving = OPEN, -rate
    note(lanes, lane, time, contact, status, rate, leaving)
    _set(bodies, lane, lanes, memory, numbers, contact, trial.contacts[AFTER, 0, contact])
    lanes.clock[lane, COUNT] += 1.0
    lanes.clock[lane, WHICH] = contact


@scattered
def _sample(lane, lanes, trial):  # type: ignore[no-untyped-def]
    """Write displacements and velocities of free bodies, and contact forces."""
    number, place = trial.free.shape[0], int(lanes.clock[lane, NEXT])
    for entry in range(number):
        body = trial.free[entry]
        lanes.samples[lane, place, entry] = trial.x[body]
        lanes.samples[lane, place, number + entry] = trial.v[body]
    for contact in range(trial.forces.shape[1]):
        lanes.samples[lane, place, 2 * number + contact] = trial.contacts[BEFORE, FORCE_ROW, contact]
        lanes.contacts[lane, GATHERED, contact] = 0.0
    for state in range(trial.states.shape[1]):
        lanes.samples[lane, place, 2 * number + trial.forces.shape[1] + state] = trial.states[0, state]
    lanes.clock[lane, NEXT] += 1.0


@scattered
def _next_end(lane, lanes, memory, span, time):  # type: ignore[no-untyped-def]
    """Return the time at which the next step ends at the latest, and whether there is a sample, and a change, then."""
    end, sampled, changed = span.end, False, False
    if time < 0.0:
        end = min(end, 0.0)
    number = lanes.clock[lane, NEXT]
    if span.interval > 0.0 and number < lanes.samples.shape[1]:
        due = span.interval * (span.first + number)
        if due <= end * (1.0 + 1e-12):
            end, sampled = min(due, span.end), True
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
def _start(lane, lanes, memory, trial):  # type: ignore[no-untyped-def]
    """Bring the motion of a lane into the memory of its steps."""
    numbers = borrow(memory.parameters[lane])
    for state in range(trial.states.shape[1]):
        trial.states[0, state] = numbers[numbers.shape[0] - BEHIND - trial.states.shape[1] + state]
    trial.x[:] = 0.0
    trial.v[:] = 0.0
    for place in range(trial.free.shape[0]):
        trial.x[trial.free[place]], trial.v[trial.free[place]] = lanes.x[lane, place], lanes.v[lane, place]


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
    memory.steps[lane, 0] = max(memory.steps[lane, 0] if cut else 0.0, length * factor)
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
    value, slope = sign * trial.contacts[AFTER, 0, contact], sign * trial.contacts[AFTER, 1, contact]
    bracket[3] += 1.0
    if abs(value) <= _small(bodies, lane, memory, trial, contact):
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
def _shorter(bodies, lane, lanes, trial, length, topped, summed, bracket):  # type: ignore[no-untyped-def]
    """Return the contact that a step is to end at, -1 for none, and a shorter length for it, 0 if it may be as it is.

    It ends where a gap passes 0, or once at its top, which may be above 0, or at the largest force of a contact.
    """
    contact, share, by = _first(lane, lanes, trial, length)
    if contact >= 0 and by > 0.0:
        bracket[0], bracket[1], bracket[2], bracket[3] = 0.0, by * length, 0.0, 0.0
        return contact, share * length
    if topped or (contact < 0 and not summed):
        return -1, 0.0
    return -1, length * (share if contact >= 0 else _crest(lane, lanes, bodies.tableau, trial))


@scattered
def _pauses(lane, lanes, memory):  # type: ignore[no-untyped-def]
    """Whether the first stage of a step is made anew, so that a call may end: it has the same bits wherever it does."""
    if lanes.clock[lane, EVALUATIONS] < memory.steps[lane, 3]:
        return False
    memory.steps[lane, 3] += PAUSE
    return True


@scattered
def _lane(bodies, lane, lanes, memory, span, trial):  # type: ignore[no-untyped-def]
    """Run a lane until it ends, or something is missing; return which."""
    numbers, allowed, ready = borrow(memory.parameters[lane]), memory.steps[lane, 2], lanes.clock[lane, EVALUATIONS]
    time, end, left, length, bracket = 0.0, 0.0, 0.0, 0.0, borrow(memory.brackets[lane])
    contact, topped, changed, sampled, summed = -1, False, True, False, False
    while True:
        if contact < 0 and not topped:  # a new step
            time = lanes.clock[lane, NOW] + lanes.clock[lane, LOST]
            changed = changed or _pauses(lane, lanes, memory)
            if changed:
                if log_full(lanes, lane):
                    return LOG_FULL
                if lanes.clock[lane, EVALUATIONS] - ready > span.looks:
                    return INTERRUPTED
                _begin(bodies, lane, memory, numbers, trial, time)
            end, sampled, changed = _next_end(lane, lanes, memory, span, time)
            left, summed = end - time, time >= 0.0 and span.summed
            if left <= 0.0 and not sampled:
                return ARRIVED
            if left <= 0.0:
                _sample(lane, lanes, trial)
                changed = False
                continue
            length = min(memory.steps[lane, 0], memory.steps[lane, 1])
            length = left if length * (1.0 + 1e-3) >= left else length
        error = make_step(bodies, lane, memory, numbers, trial, time, length)
        lanes.clock[lane, EVALUATIONS] += STAGES
        factor = _scaled(error, allowed)
        if _is_rounding(error, allowed, length, bracket):
            factor = LENGTHENED
        elif not error <= allowed:
            contact, topped, changed = -1, False, False
            if bracket[4] == 0.0:
                bracket[4], bracket[5] = length, error
            memory.steps[lane, 0] = length * min(factor, SAFETY)
            if not memory.steps[lane, 0] > AT * abs(time):
                return STUCK
            continue
        bracket[4] = 0.0
        if contact < 0:
            contact, shorter = _shorter(bodies, lane, lanes, trial, length, topped, summed, bracket)
            topped = topped or (contact < 0 and shorter > 0.0)
        else:
            contact, shorter = _again(bodies, lane, lanes, memory, trial, contact, length, bracket)
        if shorter > 0.0:
            length = shorter
            continue
        ends = length == left and contact < 0
        changed = (changed and ends) or contact >= 0
        _accept(bodies, lane, lanes, memory, trial, length, summed)
        goes_on = _advance(lane, lanes, memory, contact, length, factor, contact < 0 and (ends or topped))
        if ends:
            lanes.clock[lane, NOW], lanes.clock[lane, LOST] = end, 0.0
        if contact >= 0:
            _change(bodies, lane, lanes, memory, numbers, trial, contact)
        contact, topped = -1, False
        if not goes_on:
            return STUCK


def _run(bodies, lanes, memory, span, trial, begins, ends, results):  # type: ignore[no-untyped-def]
    """Run some lanes; write why each of them stopped."""
    bodies, lanes, memory, trial = borrow(bodies), borrow(lanes), borrow(memory), borrow(trial)
    for lane in range(begins, ends):
        if results[lane] != ARRIVED:
            _start(lane, lanes, memory, trial)
            results[lane] = _lane(bodies, lane, lanes, memory, span, trial)
            _stop(lane, lanes, memory, trial)


def stepping_loop() -> Callable[..., None]:
    """Return the compiled loop."""
    return loop(signature(True, Bodies, Lanes, Memory, Span, Trial, int, int, Slots), _run)
