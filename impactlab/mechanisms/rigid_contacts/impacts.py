"""Impacts of rigid contacts within a step, in the order of time.

Between kicks the motion is linear. A change of velocities at a moment of a step therefore adds its own free motion
until the end of the step, exactly, and no part of the step has to be made again. A contact closes where the cubic
through the gaps and their rates at both ends of its path (Hermite's, the mean path of a body under white noise that
has these ends) first becomes positive. Between these ends noise makes the rate vary by
``σ² L r (1 − 3r)`` more, r = s (1 − s) at the part s of a path of the length L, where σ² is what it adds to the
variance of the rate in unit time; without that each impact would cool the bodies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impactlab.compiling.intrinsics import call, value_at
from impactlab.compiling.jit import kernel
from impactlab.compiling.records import Block, Blocks, Numbers, Realizations, Slots, SlotTable, Streams, Table
from impactlab.integrators.driver import sampled
from impactlab.integrators.located import ROUNDING, Follower, WithinAddress, step_of
from impactlab.kernels.interpolation import cubic, rise
from impactlab.kernels.random import LOW, WORD, normal_pair, philox
from impactlab.kernels.rows import TOUCHING

GAP, RATE, END_GAP, END_RATE, SINCE, DUE, SPEED, SIZE, EVENTS, RESTS = range(10)
"""Rows of the paths of contacts in a step, of one lane: gap and rate at both ends, when the path begins, when the
contact closes and how fast, the size of its motion, and how often it has closed; whether it rests."""

PATHS = RESTS + 1
"""How many rows these are."""

IMPULSE, IMPACTS, RESTING, LARGEST, ENDLESS, SLOW, GATHERED = range(7)
"""Rows of what is seen in a step: the impulse, the number of impacts, and whether a contact rests; the
largest size of its motion so far; the numbers, from 1 on, of the first step in which its impacts were too many, and
of the last one in which impacts were too slow to count; and the impulse since the last snapshot."""

SEEN = GATHERED + 1
"""How many rows these are."""

CLEARANCE, RESTITUTION, INERTIA, COUNTED = range(4)
"""Rows of the numbers of contacts; the inertia is that against which an impulse acts, ``1/Σ w²/m``, and impacts count
from a closing velocity on: 0 where all do, and beginnings of rests."""

MANY = 1000
"""Impacts of a contact in a step after which it rests."""

TOUCH = 1e-9
"""Part of the least closing velocity that counts up to which bodies touch without an impact, but for rounding."""


class RigidContacts(NamedTuple):
    """Rigid contacts, and how they act."""

    contacts: Slots  # (rigid,) which contacts they are
    begin: Slots  # (rigid + 1,) where the entries of each begin
    bodies: Slots  # (entry,) slots
    weights: Numbers  # (entry,) weights of their displacements in the gap
    shares: Numbers  # (entry,) velocity that a body gains where the rate of the gap grows by one unit
    numbers: Table  # (4, rigid) clearance, restitution, inertia, closing velocity from which impacts count
    flow: Table  # (3, body) rate of decay c/2m, square of the natural frequency, and h/m
    near_begin: Slots  # (rigid + 1,) where those begin that share a body with each
    near: Slots  # (pair,) which these are
    influence: Numbers  # (pair,) how much their rate grows where that of the contact grows by one unit
    followed: SlotTable  # (2, entry) link that follows the body through the step, and the entry there, −1 for none


class Impacts(NamedTuple):
    """Arguments of rigid contacts, and the impacts of a step."""

    within: WithinAddress
    rigid: RigidContacts
    streams: Streams  # (3, rigid) addresses of the random numbers
    realizations: Realizations  # (lane,) indices
    spread: Table  # (1 or step, rigid) what noise adds to rates, σ
    ends: Blocks  # [5, rigid, lane] gaps and rates before and after the flow, and how far paths may reach
    paths: Table  # (10, rigid) of one lane
    seen: Blocks  # [6, rigid, lane]
    closings: Block  # [contact, lane] sums of closings, to which impacts are added
    depths: Block  # [contact, lane] indentations from which closings are counted; nothing where they are not
    follower: Follower  # since impacts change the velocities of bodies that are followed through the step
    shown: Blocks  # [1 + snapshot, 2 rigid + entry, lane] see `impactlab.plan.events.EventPart.told`


class Flight(NamedTuple):
    """The flow of a step in which bodies may collide."""

    begin: Block  # displacements before it [body, lane]
    before: Block  # velocities before it
    x: Block  # displacements after it, which are changed
    v: Block  # velocities after it, which are changed
    pushed: Block  # force of the kick before it [body, lane]
    impacts: Impacts
    step: float  # (s)
    row: int  # of the spread


@kernel
def _project(rigid, q, result):  # type: ignore[no-untyped-def]
    """Write the weighted sum of a quantity of the bodies of every contact, [rigid, lane]."""
    for contact in range(result.shape[0]):
        for lane in range(result.shape[1]):
            result[contact, lane] = 0.0
        for entry in range(rigid.begin[contact], rigid.begin[contact + 1]):
            body, weight = rigid.bodies[entry], rigid.weights[entry]
            for lane in range(result.shape[1]):
                result[contact, lane] += weight * q[body, lane]


@kernel
def _along(rigid, contact, q, lane):  # type: ignore[no-untyped-def]
    """Return that sum of one contact and lane."""
    total = 0.0
    for entry in range(rigid.begin[contact], rigid.begin[contact + 1]):
        total += rigid.weights[entry] * q[rigid.bodies[entry], lane]
    return total


@kernel
def _reach(clearance, step, ends):  # type: ignore[no-untyped-def]
    """Take clearances off the gaps, and write how far paths may reach, by Bézier's points of control, to the last row.

    The reach of all contacts stands at the first.
    """
    for contact in range(ends.shape[1]):
        off = clearance[contact]
        for lane in range(ends.shape[2]):
            gap, end = ends[0, contact, lane] - off, ends[2, contact, lane] - off
            after = gap + step * ends[1, contact, lane] / 3.0
            before = end - step * ends[3, contact, lane] / 3.0
            high = gap if gap > after else after
            low = end if end > before else before
            ends[0, contact, lane], ends[2, contact, lane] = gap, end
            ends[4, contact, lane] = high if high > low else low
    for contact in range(1, ends.shape[1]):
        for lane in range(ends.shape[2]):
            own, before = ends[4, contact, lane], ends[4, 0, lane]
            ends[4, 0, lane] = own if own > before else before


@kernel
def _closing(gap, by, bend, twist, little):  # type: ignore[no-untyped-def]
    """Return the first place in [0, 1] at which that cubic becomes positive by more than a little; 2 if it does not."""
    if gap >= 0.0 and by > 0.0:
        return 0.0
    first, second, discriminant = 2.0, 2.0, bend * bend - 3.0 * twist * by
    if discriminant > 0.0:  # places where the slope is 0, from the sum whose terms have one sign
        both = -(bend + math.copysign(math.sqrt(discriminant), bend))
        one, other = both / (3.0 * twist), by / both
        first, second = min(one, other), max(one, other)
    low = 0.0
    for place in (first, second, 1.0):
        if low <= place <= 1.0:
            if gap + place * (by + place * (bend + place * twist)) > little:
                return rise(gap, by, bend, twist, low, place)
            low = place
    return 2.0


@kernel
def _path(paths, contact, step):  # type: ignore[no-untyped-def]
    """Return the coefficients of the path of a contact, ``gap + by s + bend s² + twist s³`` for s from 0 to 1."""
    length, gap = step - paths[SINCE, contact], min(paths[GAP, contact], 0.0)
    by, next_by, rise = length * paths[RATE, contact], length * paths[END_RATE, contact], paths[END_GAP, contact] - gap
    return gap, by, *cubic(by, next_by, rise)


@kernel
def _foresee(paths, contact, step):  # type: ignore[no-untyped-def]
    """Find when a contact closes next, and how fast."""
    length, little = step - paths[SINCE, contact], ROUNDING * paths[SIZE, contact]
    paths[DUE, contact] = math.inf
    if length <= 0.0:
        return
    gap, by, bend, twist = _path(paths, contact, step)
    end, before = paths[END_GAP, contact], paths[END_GAP, contact] - length * paths[END_RATE, contact] / 3.0
    if max(gap + by / 3.0, max(before, end)) <= little:  # Bézier's points of control, between which the path is
        return
    place = _closing(gap, by, bend, twist, little)
    if place <= 1.0:
        paths[DUE, contact] = paths[SINCE, contact] + place * length
        paths[SPEED, contact] = max((by + place * (2.0 * bend + 3.0 * twist * place)) / length, 0.0)


@kernel
def _end(flight, contact, lane):  # type: ignore[no-untyped-def]
    """Read where the path of a contact ends now."""
    rigid, paths = flight.impacts.rigid, flight.impacts.paths
    paths[END_GAP, contact] = _along(rigid, contact, flight.x, lane) - rigid.numbers[CLEARANCE, contact]
    paths[END_RATE, contact] = _along(rigid, contact, flight.v, lane)


@kernel
def _bend_neighbours(flight, contact, time, change, lane):  # type: ignore[no-untyped-def]
    """Begin the paths of contacts that share a body with one anew, after its rate has changed."""
    rigid, paths, step = flight.impacts.rigid, flight.impacts.paths, flight.step
    for pair in range(rigid.near_begin[contact], rigid.near_begin[contact + 1]):
        near, grown = rigid.near[pair], rigid.influence[pair] * change
        since, length = paths[SINCE, near], step - paths[SINCE, near]
        rate = 0.0
        gap, by, bend, twist = _path(paths, near, step)
        if paths[RESTS, near] == 0.0 and length > 0.0:
            s = (time - since) / length
            gap += s * (by + s * (bend + s * twist))
            rate = (by + s * (2.0 * bend + 3.0 * twist * s)) / length
        paths[GAP, near], paths[RATE, near], paths[SINCE, near] = gap, rate + grown, time
        end = paths[END_GAP, near]
        _end(flight, near, lane)
        paths[SIZE, near] += step * abs(grown) + abs(paths[END_GAP, near] - end)
        if abs(paths[END_GAP, near]) > ROUNDING * paths[SIZE, near]:
            paths[RESTS, near] = 0.0
        _foresee(paths, near, step)


@kernel
def _free(rigid, body, left):  # type: ignore[no-untyped-def]
    """Return how far a body goes in some time on a velocity of 1, and how fast it is then."""
    decay = rigid.flow[0, body]
    square = rigid.flow[1, body] - decay * decay
    if abs(square) * left * left < 1e-4:
        z = square * left * left
        way, speed = left * (1.0 - z / 6.0 * (1.0 - z / 20.0)), 1.0 - 0.5 * z * (1.0 - z / 12.0)
    elif square > 0.0:
        frequency = math.sqrt(square)
        way, speed = math.sin(frequency * left) / frequency, math.cos(frequency * left)
    else:
        frequency = math.sqrt(-square)
        way, speed = math.sinh(frequency * left) / frequency, math.cosh(frequency * left)
    damped = math.exp(-decay * left)
    return damped * way, damped * (speed - decay * way)


@kernel
def _strike(flight, contact, entry, change, left, now, lane):  # type: ignore[no-untyped-def]
    """Change the velocities of bodies that another mechanism follows through the step.

    Entries of one contact that one link follows change together, at the first of them.
    """
    rigid, follower = flight.impacts.rigid, flight.impacts.follower
    told, link = follower.changes, rigid.followed[0, entry]
    for other in range(rigid.begin[contact], entry):
        if rigid.followed[0, other] == link:
            return
    for other in range(entry, rigid.begin[contact + 1]):
        if rigid.followed[0, other] == link:
            told[rigid.followed[1, other]] = rigid.shares[other] * change
    told[told.shape[0] - 1] = flight.step - left
    follower.which[0], follower.which[1] = link, lane
    call(follower.struck, follower.own, now)


@kernel
def _tell_work(flight, entry, way, faster, left, lane):  # type: ignore[no-untyped-def]
    """Add the energy that a body gains where its state at the end of the step is changed, some time before.

    Friction takes of it until then what it takes of a velocity twice.
    """
    rigid, told = flight.impacts.rigid, flight.impacts.shown
    body, row = rigid.bodies[entry], 2 * rigid.contacts.shape[0] + entry
    mass = flight.step / rigid.flow[2, body]
    pull = rigid.flow[1, body] * way * (flight.x[body, lane] + 0.5 * way)
    work = mass * (pull + faster * (flight.v[body, lane] + 0.5 * faster)) * math.exp(4.0 * rigid.flow[0, body] * left)
    told[0, row, lane] += work
    return work


@kernel
def _tell(flight, contact, lost, change, left, lane):  # type: ignore[no-untyped-def]
    """Add what an impact loses, and its impulse times the time that is left of the step."""
    rigid, told = flight.impacts.rigid, flight.impacts.shown
    if told.shape[1]:
        inertia, count = rigid.numbers[INERTIA, contact], rigid.contacts.shape[0]
        told[0, contact, lane] += inertia * lost
        told[0, count + contact, lane] -= inertia * change * left


@kernel
def _change(flight, contact, change, left, now, lane):  # type: ignore[no-untyped-def]
    """Change the rate of a contact some time before the end of the step: the free motion that follows is added."""
    rigid, seen = flight.impacts.rigid, flight.impacts.seen
    for entry in range(rigid.begin[contact], rigid.begin[contact + 1]):
        if rigid.followed[0, entry] >= 0:
            _strike(flight, contact, entry, change, left, now, lane)
            continue
        body = rigid.bodies[entry]
        way, speed = _free(rigid, body, left)
        by = rigid.shares[entry] * change
        if flight.impacts.shown.shape[1]:
            _tell_work(flight, entry, way * by, speed * by, left, lane)
        flight.x[body, lane] += way * by
        flight.v[body, lane] += speed * by
    seen[IMPULSE, contact, lane] -= rigid.numbers[INERTIA, contact] * change


@kernel
def _held(rigid, contact, left):  # type: ignore[no-untyped-def]
    """Return the impulse of a constant force that takes a rate of 1 from a contact within some time.

    Friction and springs take part of what a force gives, so that this is more than the inertia.
    """
    yielding = 0.0
    for entry in range(rigid.begin[contact], rigid.begin[contact + 1]):
        way, _ = _free(rigid, rigid.bodies[entry], left)
        yielding += rigid.weights[entry] * rigid.shares[entry] * way
    return rigid.numbers[INERTIA, contact] * (left / yielding if yielding > 0.0 else 1.0)


@kernel
def _rest(flight, contact, left, kicked, now, lane):  # type: ignore[no-untyped-def]
    """Hold a contact closed to the end of the step, where it neither overlaps nor closes further.

    Where kicks are part of what presses it, it does not open either: their sum with other forces counts alone.
    """
    rigid, paths, seen = flight.impacts.rigid, flight.impacts.paths, flight.impacts.seen
    overlap, rate = paths[END_GAP, contact], paths[END_RATE, contact]
    if not kicked:
        overlap, rate = max(overlap, 0.0), max(rate, 0.0)
    for entry in range(rigid.begin[contact], rigid.begin[contact + 1]):
        body, share = rigid.bodies[entry], rigid.shares[entry]
        if flight.impacts.shown.shape[1]:
            work = _tell_work(flight, entry, -share * overlap, -share * rate, 0.0, lane)
            flight.impacts.shown[0, contact, lane] -= work
        flight.x[body, lane] -= share * overlap
        flight.v[body, lane] -= share * rate
        if rigid.followed[0, entry] >= 0:
            follower = flight.impacts.follower
            follower.changes[rigid.followed[1, entry]] = -share * overlap
            follower.which[0], follower.which[1] = rigid.followed[0, entry], lane
            call(follower.moved, follower.own, now)
    seen[IMPULSE, contact, lane] += _held(rigid, contact, left) * rate
    paths[RATE, contact], paths[RESTS, contact], paths[DUE, contact] = 0.0, 1.0, math.inf
    _end(flight, contact, lane)


@kernel
def _speed(flight, contact, now, lane):  # type: ignore[no-untyped-def]
    """Return how fast a contact closes, with what noise hides between both ends of its path.

    A rate of the mean v and the variance f crosses zero at u as often as ``u exp(−(u − v)²/2f)`` says, whose first
    moments are those of the length of a vector of three normals about (v, 0, 0).
    """
    impacts, paths = flight.impacts, flight.impacts.paths
    speed, spread = paths[SPEED, contact], impacts.spread[flight.row, contact]
    length, left = flight.step - paths[SINCE, contact], flight.step - paths[DUE, contact]
    share = left / length * (1.0 - left / length)
    hidden = spread * math.sqrt(length * share * (1.0 - 3.0 * share))
    if hidden == 0.0:
        return speed
    counter, key = np.uint64(now), impacts.streams
    high = np.uint32(counter >> WORD) ^ np.uint32(np.uint64(paths[EVENTS, contact]) << np.uint64(16))
    a, b, c, d = philox(
        np.uint32(counter & LOW), high, impacts.realizations[lane], np.uint32(key[2, contact]), key[0, contact],
        key[1, contact],
    )  # fmt: skip
    one, two = normal_pair(a, b)
    three, _ = normal_pair(c, d)
    along, across, aside = speed + hidden * float(one), hidden * float(two), hidden * float(three)
    return math.sqrt(along * along + across * across + aside * aside)


@kernel
def _pressed(flight, contact, lane):  # type: ignore[no-untyped-def]
    """Return how much faster a contact closes by the last kick."""
    rigid, total = flight.impacts.rigid, 0.0
    for entry in range(rigid.begin[contact], rigid.begin[contact + 1]):
        body = rigid.bodies[entry]
        total += rigid.weights[entry] * rigid.flow[2, body] * flight.pushed[body, lane]
    return total


@kernel
def _note_endless(seen, contact, now, lane):  # type: ignore[no-untyped-def]
    """Keep the first step in which a contact had too many impacts."""
    if seen[ENDLESS, contact, lane] == 0.0:
        seen[ENDLESS, contact, lane] = now + 1.0


@kernel
def _count(flight, contact, speed, rests, now, lane):  # type: ignore[no-untyped-def]
    """Count an impact where all of them count, or if it is fast enough.

    Of a bouncing that ends within the step those that are left follow each other with velocities e u, e² u, ….
    """
    rigid, seen = flight.impacts.rigid, flight.impacts.seen
    restitution, least = rigid.numbers[RESTITUTION, contact], rigid.numbers[COUNTED, contact]
    if least == 0.0:
        seen[IMPACTS, contact, lane] += 0.0 if rests else 1.0
        return
    if speed >= least:
        seen[IMPACTS, contact, lane] += 1.0
        if rests and restitution > 0.0:
            seen[IMPACTS, contact, lane] += math.floor(math.log(least / speed) / math.log(restitution))
    bounces = speed < least or (rests and restitution > 0.0)
    if bounces and speed > TOUCH * least and seen[RESTING, contact, lane] == 0.0:
        seen[SLOW, contact, lane] = now + 1.0


@kernel
def _meet(flight, contact, now, lane):  # type: ignore[no-untyped-def]
    """Let a contact close: it opens again with the restitution e, or rests.

    It rests if a bouncing that its acceleration a makes shorter and shorter ends within the step, which takes
    ``2u/(1 − e)a`` from a rebound at u on, or takes too many impacts. Where it loses energy and what acts in the step
    and the kick before it press it together, it rests, too, if it closes hardly faster than that kick changed its rate.
    """
    rigid, paths, step = flight.impacts.rigid, flight.impacts.paths, flight.step
    restitution, time = rigid.numbers[RESTITUTION, contact], paths[DUE, contact]
    since, left, speed = paths[SINCE, contact], step - time, _speed(flight, contact, now, lane)
    rebound, length = restitution * speed, step - since
    _, _, bend, twist = _path(paths, contact, step)
    pull = (2.0 * bend + 6.0 * twist * (time - since) / length) / (length * length)
    pressed = _pressed(flight, contact, lane)
    short = pull > 0.0 and 2.0 * rebound <= max(1.0 - restitution, 2.0 / MANY) * pull * left
    kicked = restitution < 1.0 and pressed + pull * step > 0.0 and speed <= 1.5 * abs(pressed)
    rests = short or kicked
    if not rests and paths[EVENTS, contact] > MANY:
        rests = True
        _note_endless(flight.impacts.seen, contact, now, lane)
    # the kick before gave at once what grows over a step, from half a step before it on
    ahead = (1.0 + restitution) * (time / step - 0.5) * pressed
    change = -speed if rests else -(speed + rebound + (ahead if rebound + ahead > 0.0 else 0.0))
    _change(flight, contact, change, left, now, lane)
    _tell(flight, contact, -change * (speed + 0.5 * change), change, left, lane)
    paths[GAP, contact], paths[RATE, contact], paths[SINCE, contact] = 0.0, speed + change, time
    paths[EVENTS, contact] += 1.0
    paths[SIZE, contact] += step * abs(change)
    _end(flight, contact, lane)
    _count(flight, contact, speed, rests, now, lane)
    if rests:
        _rest(flight, contact, left, kicked, now, lane)
    else:
        paths[RESTS, contact] = 0.0
        _foresee(paths, contact, step)
    _bend_neighbours(flight, contact, time, change, lane)


@kernel
def _hold(flight, contact, now, lane):  # type: ignore[no-untyped-def]
    """Let a contact rest on if a kick and the forces in the step press it together, whichever of them lifts it."""
    impacts, paths = flight.impacts, flight.impacts.paths
    if impacts.spread[flight.row, contact] > 0.0 or _pressed(flight, contact, lane) == 0.0:
        return
    if paths[END_RATE, contact] > 0.0:
        paths[GAP, contact] = 0.0
        _rest(flight, contact, flight.step, True, now, lane)
        _bend_neighbours(flight, contact, 0.0, 0.0, lane)


@kernel
def _size(flight, contact, lane):  # type: ignore[no-untyped-def]
    """Return the size of the numbers that the gap of a contact is a difference of."""
    rigid, size = flight.impacts.rigid, abs(flight.impacts.rigid.numbers[CLEARANCE, contact])
    for entry in range(rigid.begin[contact], rigid.begin[contact + 1]):
        body, way = rigid.bodies[entry], 0.0
        way += abs(flight.begin[body, lane]) + flight.step * abs(flight.before[body, lane])
        size += abs(rigid.weights[entry]) * way
    return size


@kernel
def _first(paths):  # type: ignore[no-untyped-def]
    """Return which contact closes first, of several at the same time that which has closed least often.

    Bodies that rest on each other would otherwise settle in pairs, again and again after each impact of the next pair.
    """
    first = 0
    for contact in range(1, paths.shape[1]):
        later = paths[DUE, contact] - paths[DUE, first]
        if later < 0.0 or (later == 0.0 and paths[EVENTS, contact] < paths[EVENTS, first]):
            first = contact
    return first


@kernel
def _collide(flight, now, lane):  # type: ignore[no-untyped-def]
    """Let all contacts of a lane close that do so within the step, the first one first."""
    impacts, step = flight.impacts, flight.step
    ends, paths, count = impacts.ends, impacts.paths, impacts.paths.shape[1]
    for contact in range(count):
        for row in range(4):
            paths[row, contact] = ends[row, contact, lane]
        impacts.seen[LARGEST, contact, lane] = max(impacts.seen[LARGEST, contact, lane], _size(flight, contact, lane))
        paths[SIZE, contact] = impacts.seen[LARGEST, contact, lane]
        paths[SINCE, contact], paths[EVENTS, contact], paths[RESTS, contact] = 0.0, 0.0, 0.0
        _foresee(paths, contact, step)
    for contact in range(count):
        if impacts.seen[RESTING, contact, lane] > 0.0:
            _hold(flight, contact, now, lane)
    for _ in range(2 * MANY * count):
        first = _first(paths)
        if paths[DUE, first] == math.inf:
            for contact in range(count):
                impacts.seen[RESTING, contact, lane] = paths[RESTS, contact]
            return
        _meet(flight, first, now, lane)
    for contact in range(count):  # bodies that rest on each other: what overlaps yet is held in the next step
        due = paths[DUE, contact] < math.inf
        impacts.seen[RESTING, contact, lane] = 1.0 if due or paths[RESTS, contact] == 1.0 else 0.0
        if due:
            _note_endless(impacts.seen, contact, now, lane)


@kernel
def _rested(seen, lane):  # type: ignore[no-untyped-def]
    """Whether a contact of a lane was at rest at the end of the step before."""
    number = 0.0
    for contact in range(seen.shape[1]):
        number += seen[RESTING, contact, lane]
    return number > 0.0


@kernel
def _clear(seen):  # type: ignore[no-untyped-def]
    """Forget what was seen in the step before, but for rests."""
    for row in range(RESTING):
        for contact in range(seen.shape[1]):
            for lane in range(seen.shape[2]):
                seen[row, contact, lane] = 0.0


@kernel
def _show(impacts, summing, step, indentation, contact_force):  # type: ignore[no-untyped-def]
    """Write forces of rigid contacts, means over a step, and indentations, as small as can be where they rest.

    Impacts are counted here; contacts that come to rest are so by their indentation, unless impacts have to be fast to
    count.
    """
    seen, counted = impacts.seen, impacts.depths.shape[0] > 0
    for rigid in range(seen.shape[1]):
        contact = impacts.rigid.contacts[rigid]
        for lane in range(contact_force.shape[1]):
            contact_force[contact, lane] = seen[IMPULSE, rigid, lane] / step
            indentation[contact, lane] = TOUCHING if seen[RESTING, rigid, lane] > 0.0 else -math.inf
        if counted and impacts.rigid.numbers[COUNTED, rigid] > 0.0:
            for lane in range(contact_force.shape[1]):
                impacts.depths[contact, lane] = TOUCHING
        if summing:
            for lane in range(contact_force.shape[1]):
                impacts.closings[contact, lane] += seen[IMPACTS, rigid, lane]


@kernel
def _gather(impacts, time, sampled, contact_force):  # type: ignore[no-untyped-def]
    """Add up the impulse until there is a snapshot, in which the force of a rigid contact is its mean over the time."""
    seen = impacts.seen
    for rigid in range(seen.shape[1]):
        contact = impacts.rigid.contacts[rigid]
        for lane in range(contact_force.shape[1]):
            seen[GATHERED, rigid, lane] += seen[IMPULSE, rigid, lane]
        if sampled:
            for lane in range(contact_force.shape[1]):
                contact_force[contact, lane] = seen[GATHERED, rigid, lane] / time
                seen[GATHERED, rigid, lane] = 0.0


@kernel
def _let_collide(flight, now):  # type: ignore[no-untyped-def]
    """Change what is after the flow of a step by the impacts in it."""
    impacts, rigid = flight.impacts, flight.impacts.rigid
    ends, seen = impacts.ends, impacts.seen
    _project(rigid, flight.begin, ends[0])
    _project(rigid, flight.before, ends[1])
    _project(rigid, flight.x, ends[2])
    _project(rigid, flight.v, ends[3])
    _reach(rigid.numbers[CLEARANCE], flight.step, ends)
    _clear(seen)
    for lane in range(flight.x.shape[1]):
        if ends[4, 0, lane] > 0.0 or _rested(seen, lane):
            _collide(flight, now, lane)


def collisions(place, now):  # type: ignore[no-untyped-def]
    """Let rigid contacts collide within the flow of a step; `place` is the address of an `Impacts`."""
    impacts = value_at(place)
    within = value_at(impacts.within)
    step = step_of(within, now)
    row = step.place if impacts.spread.shape[0] > 1 else 0
    flight = Flight(step.begin, step.before, step.x, step.v, step.pushed, impacts, within.steps.step, row)
    _let_collide(flight, now)


def show_impacts(place, now):  # type: ignore[no-untyped-def]
    """Show impacts and rests after the kick that ends a step."""
    impacts = value_at(place)
    within = value_at(impacts.within)
    step = step_of(within, now)
    _show(impacts, within.steps.summing, within.steps.step, step.indentation, step.contact_force)


@kernel
def _show_told(told, number, count):  # type: ignore[no-untyped-def]
    """Write what impacts tell at a snapshot; impulses times times are those since the one before."""
    for row in range(told.shape[1]):
        for lane in range(told.shape[2]):
            told[number, row, lane] = told[0, row, lane]
            if count <= row < 2 * count:
                told[0, row, lane] = 0.0


def gather_impulses(place, now):  # type: ignore[no-untyped-def]
    """Write the mean force of impacts since the snapshot before where there is one, and what they tell."""
    impacts = value_at(place)
    within = value_at(impacts.within)
    steps, shown = within.steps, within.state.contact_force
    seen = sampled(steps, now - steps.first)
    _gather(impacts, steps.every * steps.step, seen, shown)
    if seen and impacts.shown.shape[1]:
        number = (steps.phase + now - steps.first + 1) // steps.every
        _show_told(impacts.shown, number, impacts.rigid.contacts.shape[0])
