"""Dry friction that sticks: slip and stick of bodies within the flow of a step.

Forces of kicks are taken to change as they did in the step before, and given ones evenly, so that while bodies slip,
under a friction of one size, their motion is a power series of the time. It is followed from one event to the next:
slip ends where the rate of the coordinate reaches the velocity of the surface, stick where the force that it takes
exceeds the breakaway force. What friction has changed by the end of the step is added to the flow, which is linear.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from impactlab.compiling.intrinsics import value_at
from impactlab.compiling.jit import kernel
from impactlab.compiling.records import Block, Blocks, Numbers, Slots, Table
from impactlab.compiling.scalars import scalar
from impactlab.integrators.driver import sampled
from impactlab.integrators.located import ROUNDING, WithinAddress, step_of

MASS, DAMPING, STIFFNESS, SHIFT, HALF_KICK, LAG, XX, XV, VX, VV, X_MEAN, V_MEAN, X_SLOPE, V_SLOPE = range(14)
"""Rows of the numbers of bodies: of their linear motion, of kicks, of the flow of a step, and of its response to forces
of unit mean and to those that grow from -1 to 1 in it."""

SLIDING, BREAKAWAY, VELOCITY, INERTIA = range(4)
"""Rows of the numbers of links; the inertia is ``1/Σ w²/m``."""

PLACE, SPEED, FORCE, GROWTH, WORK_DONE, END_PLACE, END_SPEED = range(7)
"""Rows of the work space, of each entry: state, force but for friction and its change in time; the work that friction
has done in the step; the state at the end of the step without friction."""

WORK = END_SPEED + 1
"""How many rows these are."""

STATE, TARGET = range(2)
"""Rows of what is known of links at the end of a step: whether they stick, or which way they slip; and the coordinate
at which they are held."""

BEGUN, SINCE, SIZE = range(3)
"""Rows of what links go on from where an impact changes their velocities within a step: whether they stuck or which way
they slipped at the last impact, or the beginning of the step; when that was; and the size of their velocities."""

LEFT = SIZE + 1
"""How many rows these are."""

SEEN = TARGET + 1
"""How many rows these are."""

UNKNOWN, STUCK = 0.0, 2.0
"""What is known of a link at a start, and where it sticks; 1 or −1 where it slips."""

DEGREE = 18
"""Degree of the power series: where nothing changes by more than 1/e in a step, the rest is below rounding."""

PARTS, MANY = 4, 100
"""Parts of a slip in which its turning points are looked for, and events in a step after which there are no more."""


class Rubs(NamedTuple):
    """Links of dry friction that sticks, and how they act."""

    begin: Slots  # (link + 1,) where the entries of each begin
    bodies: Slots  # (entry,) slots
    weights: Numbers  # (entry,) weights of their displacements in the coordinate that slips
    shares: Numbers  # (entry,) velocity that a body gains where that of the coordinate grows by one unit
    numbers: Table  # (4, link) force of sliding, breakaway force, velocity of the surface, inertia
    motion: Table  # (14, body)


class Rubbing(NamedTuple):
    """Arguments of dry friction, and its state at the end of a step."""

    within: WithinAddress
    links: Rubs
    earlier: Block  # [entry, lane] force of the kick before the last one
    work: Table  # (7, entry) of one lane
    series: Table  # (entry + 1, order) of one lane
    seen: Blocks  # [2, link, lane]
    left: Blocks  # [3, link, lane] what an impact within the step goes on from; nothing where there are none
    kept: Blocks  # [7, entry, lane] the same of the work space
    told: Numbers  # (entry + 1,) what an impact changes of each entry, and its time
    struck: Slots  # (2,) link and lane of an impact
    done: Block  # [entry, lane] work of friction in a step; nothing where it is not wanted
    shown: Blocks  # [1 + snapshot, entry, lane] its sums; see `impactlab.plan.events.EventPart.told`


class Slide(NamedTuple):
    """The flow of a step in which bodies may slip and stick."""

    begin: Block  # displacements before it [body, lane]
    before: Block  # velocities before it
    x: Block  # displacements after it, which are changed
    v: Block  # velocities after it, which are changed
    pushed: Block  # force of the kick before it [body, lane]
    rubbing: Rubbing
    step: float  # (s)


@kernel
def _open(slide, link, lane):  # type: ignore[no-untyped-def]
    """Write state and forces of the bodies of a link at the beginning of a step; return the size of its velocities."""
    known = slide.rubbing.seen[STATE, link, lane] != UNKNOWN
    links, motion, work, step = slide.rubbing.links, slide.rubbing.links.motion, slide.rubbing.work, slide.step
    size = abs(links.numbers[VELOCITY, link])
    for entry in range(links.begin[link], links.begin[link + 1]):
        body = links.bodies[entry]
        x, v, kick = slide.begin[body, lane], slide.before[body, lane], slide.pushed[body, lane]
        off_x = slide.x[body, lane] - motion[XX, body] * x - motion[XV, body] * v
        off_v = slide.v[body, lane] - motion[VX, body] * x - motion[VV, body] * v
        x_mean, v_mean, x_slope, v_slope = (
            motion[X_MEAN, body],
            motion[V_MEAN, body],
            motion[X_SLOPE, body],
            motion[V_SLOPE, body],
        )
        both = x_mean * v_slope - x_slope * v_mean
        mean, slope = (off_x * v_slope - off_v * x_slope) / both, (off_v * x_mean - off_x * v_mean) / both
        change = kick - slide.rubbing.earlier[entry, lane] if known else 0.0
        slide.rubbing.earlier[entry, lane] = kick
        beyond = motion[HALF_KICK, body] * (kick + change / 6.0) + motion[LAG, body] * kick
        work[PLACE, entry], work[SPEED, entry] = x + motion[SHIFT, body] * kick, v - beyond
        work[FORCE, entry], work[GROWTH, entry] = mean - slope + kick, (2.0 * slope + change) / step
        work[WORK_DONE, entry] = 0.0
        held = motion[STIFFNESS, body] * abs(x) + motion[DAMPING, body] * abs(v)
        pulled = abs(mean) + abs(slope) + abs(kick) + held
        size += abs(links.weights[entry]) * (abs(work[SPEED, entry]) + step * pulled / motion[MASS, body])
    return size


@kernel
def _series(rubbing, link, length, friction, growth):  # type: ignore[no-untyped-def]
    """Write the displacements of the bodies of a link as power series of the part of some time, under a friction.

    The coefficients of its rate, less the velocity of the surface, stand in the last row.
    """
    links, work, series = rubbing.links, rubbing.work, rubbing.series
    rate = series[series.shape[0] - 1]
    for order in range(DEGREE):
        rate[order] = 0.0
    rate[0] = -links.numbers[VELOCITY, link]
    for entry in range(links.begin[link], links.begin[link + 1]):
        body, weight, row = links.bodies[entry], links.weights[entry], series[entry]
        per_mass = length * length / links.motion[MASS, body]
        slowed, held = links.motion[DAMPING, body] / length * per_mass, links.motion[STIFFNESS, body] * per_mass
        force = (work[FORCE, entry] + weight * friction) * per_mass
        row[0], row[1] = work[PLACE, entry], length * work[SPEED, entry]
        for order in range(DEGREE - 1):
            bent = force - slowed * (order + 1.0) * row[order + 1] - held * row[order]
            row[order + 2] = bent / ((order + 1.0) * (order + 2.0))
            force = (work[GROWTH, entry] + weight * growth) * length * per_mass if order == 0 else 0.0
        for order in range(DEGREE):
            rate[order] += weight * (order + 1.0) * row[order + 1] / length


@kernel
def _at(row, first, part):  # type: ignore[no-untyped-def]
    """Return the sum of the terms of a power series from one on, divided by its power, and the derivative of that."""
    value, slope = 0.0, 0.0
    for back in range(DEGREE):
        slope = slope * part + value
        value = value * part + row[first + DEGREE - 1 - back]
    return value, slope


@kernel
def _go(rubbing, link, length, part, friction, growth):  # type: ignore[no-untyped-def]
    """Bring the bodies of a link to a part of the time of their power series, under a friction that grows evenly.

    Its work is that where velocities change evenly as well, as they do under a friction that does not grow.
    """
    links, work, series, time = rubbing.links, rubbing.work, rubbing.series, length * part
    for entry in range(links.begin[link], links.begin[link + 1]):
        row = series[entry]
        rest, slope = _at(row, 1, part)
        way, speed = part * rest, (rest + part * slope) / length
        faster = growth * time * time / 12.0 * (speed - work[SPEED, entry])
        work[WORK_DONE, entry] += links.weights[entry] * ((friction + 0.5 * growth * time) * way + faster)
        work[PLACE, entry], work[SPEED, entry] = row[0] + way, speed
        work[FORCE, entry] += work[GROWTH, entry] * length * part


@kernel
def _bisected(row, way, of_slope, low, high):  # type: ignore[no-untyped-def]
    """Return where a power series times ±1, or its slope, changes its sign between two places."""
    value, slope = _at(row, 0, low)
    rising = way * (slope if of_slope else value) < 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        value, slope = _at(row, 0, middle)
        if (way * (slope if of_slope else value) < 0.0) == rising:
            low = middle
        else:
            high = middle
    return high


@kernel
def _end_of_slip(row, way, little):  # type: ignore[no-untyped-def]
    """Return the first part of the time at which a rate that has one direction, ±1, turns; 2 if it does not."""
    low = 0.0
    _, slope = _at(row, 0, low)
    for number in range(PARTS):
        high = (number + 1.0) / PARTS
        value, next_slope = _at(row, 0, high)
        if slope * next_slope < 0.0:
            turning = _bisected(row, 1.0, True, low, high)
            if way * _at(row, 0, turning)[0] < -little:
                return _bisected(row, way, False, low, turning)
            low = turning
        if way * value < -little:
            return _bisected(row, way, False, low, high)
        low, slope = high, next_slope
    return 2.0


@kernel
def _off(rubbing, link):  # type: ignore[no-untyped-def]
    """Return how much faster than the surface a link is."""
    links, total = rubbing.links, -rubbing.links.numbers[VELOCITY, link]
    for entry in range(links.begin[link], links.begin[link + 1]):
        total += links.weights[entry] * rubbing.work[SPEED, entry]
    return total


@kernel
def _coordinate(rubbing, link):  # type: ignore[no-untyped-def]
    """Return the coordinate of a link."""
    links, total = rubbing.links, 0.0
    for entry in range(links.begin[link], links.begin[link + 1]):
        total += links.weights[entry] * rubbing.work[PLACE, entry]
    return total


@kernel
def _move(rubbing, link, way, faster):  # type: ignore[no-untyped-def]
    """Change the coordinate of a link and its rate, by an impulse between its sides."""
    links, work = rubbing.links, rubbing.work
    for entry in range(links.begin[link], links.begin[link + 1]):
        work[PLACE, entry] += links.shares[entry] * way
        work[SPEED, entry] += links.shares[entry] * faster


@kernel
def _holding(rubbing, link):  # type: ignore[no-untyped-def]
    """Return the force that keeps a link at the velocity of the surface, and its change in time."""
    links, work = rubbing.links, rubbing.work
    inertia, force, growth = links.numbers[INERTIA, link], 0.0, 0.0
    for _ in range(2):  # its change is that of the accelerations under it
        pulled, growth = 0.0, 0.0
        for entry in range(links.begin[link], links.begin[link + 1]):
            body, weight = links.bodies[entry], links.weights[entry]
            mass, damping, stiffness = (
                links.motion[MASS, body],
                links.motion[DAMPING, body],
                links.motion[STIFFNESS, body],
            )
            other = work[FORCE, entry] - damping * work[SPEED, entry] - stiffness * work[PLACE, entry]
            faster = (other + weight * force) / mass
            pulled += weight / mass * other
            growth += weight / mass * (work[GROWTH, entry] - damping * faster - stiffness * work[SPEED, entry])
        force = -inertia * pulled
    return force, -inertia * growth


@kernel
def _stick(rubbing, link, left):  # type: ignore[no-untyped-def]
    """Hold a link as long as it sticks, at most for some time; return that time, and which way it slips then, or 0."""
    numbers = rubbing.links.numbers
    _move(rubbing, link, 0.0, -_off(rubbing, link))
    force, growth = _holding(rubbing, link)
    most = numbers[BREAKAWAY, link]
    if abs(force) > most:
        return 0.0, -math.copysign(1.0, force)
    length, way = left, 0.0
    if abs(force + growth * left) > most:
        way = -math.copysign(1.0, growth)
        length = min((-way * most - force) / growth, left)
    if length > 0.0:
        place = _coordinate(rubbing, link) + numbers[VELOCITY, link] * length
        _series(rubbing, link, length, force, growth)
        _go(rubbing, link, length, 1.0, force, growth)
        _move(rubbing, link, place - _coordinate(rubbing, link), -_off(rubbing, link))
    return length, way


@kernel
def _slip(rubbing, link, left, way, little):  # type: ignore[no-untyped-def]
    """Let a link slip one way until its rate turns, at most for some time; return that time, and whether it turns."""
    friction = -way * rubbing.links.numbers[SLIDING, link]
    _series(rubbing, link, left, friction, 0.0)
    part = _end_of_slip(rubbing.series[rubbing.series.shape[0] - 1], way, little)
    turns = part <= 1.0
    if not turns:
        part = 1.0
    _go(rubbing, link, left, part, friction, 0.0)
    return part * left, turns


@kernel
def _begins(rubbing, link, state, size, kicked):  # type: ignore[no-untyped-def]
    """Return whether a link sticks at the beginning of a step, or which way it slips.

    At a start it sticks where it is no faster than rounding, and what kicks count in velocities there, may make it.
    """
    off = _off(rubbing, link)
    if state == STUCK:
        return STUCK
    if state == UNKNOWN:
        return STUCK if abs(off) <= ROUNDING * size + kicked else math.copysign(1.0, off)
    return state if state * off > 0.0 else STUCK


@kernel
def _go_on(rubbing, link, left, state, before, target, size):  # type: ignore[no-untyped-def]
    """Follow a link for some time; return whether it sticks then, or which way it slips, and where it is held."""
    events = 0
    while left > 0.0:
        events += 1
        if state == STUCK:
            if before != STUCK or events > 1:
                target = _coordinate(rubbing, link)
            length, way = _stick(rubbing, link, left)
            target += rubbing.links.numbers[VELOCITY, link] * length
            if way != 0.0:
                state = way
        else:
            length, turns = _slip(rubbing, link, left, state, ROUNDING * size if events < MANY else math.inf)
            if turns:
                state = STUCK
        left -= length
    return state, target


@kernel
def _keep(rubbing, link, lane, state, since, size):  # type: ignore[no-untyped-def]
    """Keep what an impact within the step goes on from."""
    kept, left = rubbing.kept, rubbing.left
    left[BEGUN, link, lane], left[SINCE, link, lane], left[SIZE, link, lane] = state, since, size
    for entry in range(rubbing.links.begin[link], rubbing.links.begin[link + 1]):
        for row in range(END_PLACE):
            kept[row, entry, lane] = rubbing.work[row, entry]


@kernel
def _keep_end(rubbing, link, lane):  # type: ignore[no-untyped-def]
    """Keep where the bodies of a link are at the end of the step, and the work of friction in it."""
    for entry in range(rubbing.links.begin[link], rubbing.links.begin[link + 1]):
        if rubbing.done.shape[0]:
            rubbing.done[entry, lane] = rubbing.work[WORK_DONE, entry]
    if rubbing.left.shape[0]:
        for entry in range(rubbing.links.begin[link], rubbing.links.begin[link + 1]):
            rubbing.kept[END_PLACE, entry, lane] = rubbing.work[PLACE, entry]
            rubbing.kept[END_SPEED, entry, lane] = rubbing.work[SPEED, entry]


@kernel
def _turn(slide, link, lane):  # type: ignore[no-untyped-def]
    """Follow a link of a lane anew from an impact to the end of the step, and change where its bodies are then."""
    rubbing, step = slide.rubbing, slide.step
    links, work, kept, left = rubbing.links, rubbing.work, rubbing.kept, rubbing.left
    time, size = rubbing.told[rubbing.told.shape[0] - 1], left[SIZE, link, lane]
    for entry in range(links.begin[link], links.begin[link + 1]):
        for row in range(END_PLACE):
            work[row, entry] = kept[row, entry, lane]
    _go_on(rubbing, link, time - left[SINCE, link, lane], left[BEGUN, link, lane], UNKNOWN, 0.0, size)
    for entry in range(links.begin[link], links.begin[link + 1]):
        work[SPEED, entry] += rubbing.told[entry]
        rubbing.told[entry] = 0.0
        size = max(size, abs(links.weights[entry] * work[SPEED, entry]))
    off, target = _off(rubbing, link), _coordinate(rubbing, link)
    state = STUCK if abs(off) <= ROUNDING * size else math.copysign(1.0, off)
    _keep(rubbing, link, lane, state, time, size)
    state, target = _go_on(rubbing, link, step - time, state, UNKNOWN, target, size)
    rubbing.seen[STATE, link, lane], rubbing.seen[TARGET, link, lane] = state, target
    for entry in range(links.begin[link], links.begin[link + 1]):
        body = links.bodies[entry]
        slide.x[body, lane] += work[PLACE, entry] - kept[END_PLACE, entry, lane]
        slide.v[body, lane] += work[SPEED, entry] - kept[END_SPEED, entry, lane]
    _keep_end(rubbing, link, lane)


@kernel
def _shift(rubbing, link, lane):  # type: ignore[no-untyped-def]
    """Move where a link is held with its bodies, which have been moved at the end of the step."""
    for entry in range(rubbing.links.begin[link], rubbing.links.begin[link + 1]):
        if rubbing.seen[STATE, link, lane] == STUCK:
            rubbing.seen[TARGET, link, lane] += rubbing.links.weights[entry] * rubbing.told[entry]
        rubbing.told[entry] = 0.0


@kernel
def _follow(slide, link, lane):  # type: ignore[no-untyped-def]
    """Follow a link of a lane through a step, and add what its friction does to the flow."""
    rubbing, step = slide.rubbing, slide.step
    links, work, seen = rubbing.links, rubbing.work, rubbing.seen
    size, kicked = _open(slide, link, lane), 0.0
    _series(rubbing, link, step, 0.0, 0.0)
    for entry in range(links.begin[link], links.begin[link + 1]):
        rest, slope = _at(rubbing.series[entry], 1, 1.0)
        work[END_PLACE, entry], work[END_SPEED, entry] = rubbing.series[entry, 0] + rest, (rest + slope) / step
        body = links.bodies[entry]
        kicked += abs(links.weights[entry] * links.motion[HALF_KICK, body] * slide.pushed[body, lane]) / 6.0
    before, target = seen[STATE, link, lane], seen[TARGET, link, lane]
    state = _begins(rubbing, link, before, size, kicked)
    if rubbing.left.shape[0]:
        _keep(rubbing, link, lane, state, 0.0, size)
    seen[STATE, link, lane], seen[TARGET, link, lane] = _go_on(rubbing, link, step, state, before, target, size)
    _keep_end(rubbing, link, lane)
    for entry in range(links.begin[link], links.begin[link + 1]):
        body = links.bodies[entry]
        slide.x[body, lane] += work[PLACE, entry] - work[END_PLACE, entry]
        slide.v[body, lane] += work[SPEED, entry] - work[END_SPEED, entry]


@kernel
def _hold(rubbing, x, y, v, middle, kick, last_kick):  # type: ignore[no-untyped-def]
    """Take off what a kick moves links that stick: at its place y and in its middle they are where they are held.

    Velocities are those of the smooth path; see `impactlab.kernels.kick.smooth_velocity`. Displacements x and
    velocities v are those after the flow and after the kick.
    """
    links, seen = rubbing.links, rubbing.seen
    for link in range(seen.shape[1]):
        for lane in range(v.shape[1]):
            if seen[STATE, link, lane] == STUCK:
                away, off = -seen[TARGET, link, lane], -links.numbers[VELOCITY, link]
                for entry in range(links.begin[link], links.begin[link + 1]):
                    body, weight = links.bodies[entry], links.weights[entry]
                    force = kick[body, lane]
                    beyond = links.motion[HALF_KICK, body] / 6.0 * (force - last_kick[body, lane])
                    away += weight * y[body, lane]
                    off += weight * (middle[body, lane] - beyond - links.motion[LAG, body] * force)
                for entry in range(links.begin[link], links.begin[link + 1]):
                    body, share = links.bodies[entry], links.shares[entry]
                    x[body, lane] -= share * away
                    y[body, lane] -= share * away
                    middle[body, lane] -= share * off
                    v[body, lane] -= share * off


@scalar
def _slide(rubbing, now):  # type: ignore[no-untyped-def]
    """Return the flow of a step."""
    within = value_at(rubbing.within)
    step = step_of(within, now)
    return Slide(step.begin, step.before, step.x, step.v, step.pushed, rubbing, within.steps.step)


def rub(place, now):  # type: ignore[no-untyped-def]
    """Change the state after the flow of a step by the friction in it; `place` is the address of a `Rubbing`."""
    rubbing = value_at(place)
    slide = _slide(rubbing, now)
    for link in range(rubbing.seen.shape[1]):
        for lane in range(slide.x.shape[1]):
            _follow(slide, link, lane)


@kernel
def _gather(rubbing):  # type: ignore[no-untyped-def]
    """Add up the work of friction."""
    for entry in range(rubbing.done.shape[0]):
        for lane in range(rubbing.done.shape[1]):
            rubbing.shown[0, entry, lane] += rubbing.done[entry, lane]


@kernel
def _show(shown, number):  # type: ignore[no-untyped-def]
    """Write the work of friction so far at a snapshot."""
    for entry in range(shown.shape[1]):
        for lane in range(shown.shape[2]):
            shown[number, entry, lane] = shown[0, entry, lane]


def show_work(place, now):  # type: ignore[no-untyped-def]
    """Write the work of friction so far where there is a snapshot."""
    rubbing = value_at(place)
    steps = value_at(rubbing.within).steps
    if rubbing.done.shape[0] and sampled(steps, now - steps.first):
        _show(rubbing.shown, (steps.phase + now - steps.first + 1) // steps.every)


def hold(place, now):  # type: ignore[no-untyped-def]
    """Hold what sticks against the kick that ends a step."""
    rubbing = value_at(place)
    _gather(rubbing)
    step = step_of(value_at(rubbing.within), now)
    _hold(rubbing, step.x, step.reading, step.v, step.middle, step.force, step.pushed)


def turn(place, now):  # type: ignore[no-untyped-def]
    """Follow one link of one lane anew from an impact on."""
    rubbing = value_at(place)
    _turn(_slide(rubbing, now), rubbing.struck[0], rubbing.struck[1])


def shift(place, now):  # type: ignore[no-untyped-def]
    """Note that an impact has moved the bodies of one link of one lane at the end of the step."""
    rubbing = value_at(place)
    _shift(rubbing, rubbing.struck[0], rubbing.struck[1])
