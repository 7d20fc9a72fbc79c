"""Steps of order eight of networks whose forces are functions of displacements, velocities, states and time.

A step is Dormand and Prince's of order eight with error estimates of order five and three (Hairer, Nørsett and Wanner,
Solving Ordinary Differential Equations I, 2nd ed., 1993, section II.10). Integrals over the step have its weights.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impactlab.compiling.force_type import ForceFunction
from impactlab.compiling.intrinsics import address_of, borrow, call
from impactlab.compiling.jit import part, scattered, seldom_called
from impactlab.compiling.records import Cube, Numbers, Slots, SlotTable, Table, by_address
from impactlab.kernels.memory import BEHIND, Accepted

STAGES = 12
"""Stages of a step; a thirteenth is the first of the next one."""

ROW_B, ROW_C, ROW_E3, ROW_E5, ROW_QUINTIC = range(STAGES, STAGES + 5)
"""Rows of the tableau behind those of its stages: weights, times, and weights of the two error estimates. In the last
row, and four behind it, the coefficients of a quintic from its values at `IN_TIME`, 0 at first."""

IN_TIME = (0, 6, 5, 9, 10, 12)
"""Stages whose times go evenly through a step."""

FLOOR = 1e-4
"""Size of the smallest motion whose own size counts in its errors, as a part of the largest."""

AT = 4e-16
"""Part of the size of a gap up to which it is 0."""

NUDGE = 5e-3
"""Part of a step over which changes of states tell their rates: errors are of its fourth power, or rounding over it."""

NOW_ROW, TRIAL_ROW, RATE_ROW, SLOPE_ROW, LINK_ROW, STAGE_ROW = 1, 2, 7, 8 + STAGES, 9 + STAGES, 10 + STAGES
"""Rows of `Trial.states`."""

BEFORE, AFTER = range(2)
"""Places of `Trial.watched`: the beginning of a step, and its end."""

WORKED, GAPS, HOLDS, PULLS, BETWEEN = range(1, 6)
"""Rows of `Trial.impulses` behind the integrals of forces: those of force times rate, gaps in a stage, whether a rigid
contact is held at rest, accelerations of gaps that are held, and from there on their changes by unit forces."""

DEPENDENT = 1e-12
"""Part of its own change up to which one that others leave is 0: they hold the contact as well."""

OWN_MASS, OWN_DAMPING, OWN_STIFFNESS = range(3)
"""Rows of the linear part of bodies."""


class GivenAt(NamedTuple):
    """Where given forces are asked for at a time."""

    time: float
    parameters: Numbers
    indices: Slots
    result: Numbers  # (source,)


GIVEN = by_address(GivenAt, True)
"""Type of the function that is generated for given forces."""


def giving(function: Callable[..., None]) -> Callable[..., None]:
    """Compile the function that is generated for given forces; return it with its address."""
    return part(GIVEN, function, True)  # type: ignore[no-any-return]


class Bodies(NamedTuple):
    """Networks of one structure; bodies are all of them, and the wall behind the last."""

    forces: ForceFunction
    functions: Slots  # addresses of the functions of given forces and of states, 0 for none
    indices: Slots  # of the forces
    linear: Cube  # (lane, 3, body) masses, damping and stiffness of each body alone; no mass where the motion is given
    drives: SlotTable  # (2, drive) source and body
    shares: Numbers  # (drive,) weight of the source
    links: Cube  # (lane, row, body) of contacts; then of laws with states, first for kinks of these, then for turns
    motions: Cube  # (lane, body, 1 + 2 wave) constant and amplitudes of given motions, as `Pieces.waves`
    frequencies: Table  # (lane, wave) (rad s-1)
    points: Cube  # (lane, point, body)
    places: Slots  # (row,) of the clearance of a contact among the parameters; behind them its contact, -1 for none
    tableau: Table


class Memory(NamedTuple):
    """What a lane remembers between calls, besides `Lanes`."""

    parameters: Table  # (lane, number) of the forces, with the time behind them
    clearances: Table  # (lane, contact or kink) (m), of kinks the extensions at which they are
    sizes: Cube  # (lane, 2, body) largest displacements and velocities so far
    steps: Table  # (lane, 4) length of the next step, the longest, the error allowed, evaluations to a pause
    ends: Numbers  # increasing times at which steps end
    states: Table  # (lane, state) largest values so far
    brackets: Table  # (lane, 6) lengths about an event, how they are known; length, error of the first step refused


class Trial(NamedTuple):
    """A step that is tried, from its beginning to its end."""

    x: Numbers  # (body,) at the beginning
    v: Numbers
    stages: Cube  # (STAGES + 1, 2, body) rates of change of x and v
    at: Table  # (3, body) place and velocity in a stage, at last those of the end; and a place a moment later
    total: Numbers  # (body,)
    given: Numbers  # (source,)
    watched: Cube  # (2, 3, row) gap, its rate and acceleration at the beginning and the end; see `write_gaps`
    forces: Table  # (STAGES + 1, contact) in each stage
    states: Table  # (2 STAGES + 11, state) at the beginning, now, five trials, rates in stages, by extension, number of
    # law, and in stages
    sums: Table  # (4, free body or point) integrals over the step
    impulses: Table  # (BETWEEN + contact, contact) integral of the force over the step, and rows from `WORKED` on
    free: Slots  # bodies whose motion is not given


@scattered
def put_states(numbers, states, row):  # type: ignore[no-untyped-def]
    """Write states where the forces read them; see `impactlab.kernels.memory`."""
    count = states.shape[1]
    for state in range(count):
        numbers[numbers.shape[0] - BEHIND - count + state] = states[row, state]


@seldom_called
def _hold(bodies, lane, trial, out, stage):  # type: ignore[no-untyped-def]
    """Let rigid contacts at rest be held by forces, by which no gap of them accelerates."""
    rows, count = trial.impulses, trial.forces.shape[1]
    for one in range(count):
        rows[PULLS, one] = 0.0
        for body in range(bodies.links.shape[2]):
            rows[PULLS, one] += bodies.links[lane, one, body] * out[1, body]
        for other in range(count):
            change = 0.0
            for body in range(bodies.links.shape[2]):
                if bodies.linear[lane, OWN_MASS, body] > 0.0:
                    weight = bodies.links[lane, one, body] / bodies.linear[lane, OWN_MASS, body]
                    change += weight * bodies.links[lane, other, body]
            rows[BETWEEN + one, other] = change if rows[HOLDS, one] * rows[HOLDS, other] > 0.0 else 0.0
    for one in range(count):
        own = 0.0
        for body in range(bodies.links.shape[2]):
            if bodies.linear[lane, OWN_MASS, body] > 0.0:
                own += bodies.links[lane, one, body] ** 2 / bodies.linear[lane, OWN_MASS, body]
        left = rows[BETWEEN + one, one]
        for other in range(one + 1, count):
            share = rows[BETWEEN + other, one] / left if left > DEPENDENT * own else 0.0
            rows[PULLS, other] -= share * rows[PULLS, one]
            for column in range(one, count):
                rows[BETWEEN + other, column] -= share * rows[BETWEEN + one, column]
        if left <= DEPENDENT * own:
            rows[BETWEEN + one, one] = 0.0
    for place in range(count):
        one = count - 1 - place
        if rows[HOLDS, one] == 0.0:
            continue
        left = rows[PULLS, one]
        for other in range(one + 1, count):
            if rows[HOLDS, other] > 0.0:
                left -= rows[BETWEEN + one, other] * trial.forces[stage, other]
        force = left / rows[BETWEEN + one, one] if rows[BETWEEN + one, one] > 0.0 else 0.0
        trial.forces[stage, one] = force
        for body in range(bodies.links.shape[2]):
            if bodies.linear[lane, OWN_MASS, body] > 0.0:
                out[1, body] -= bodies.links[lane, one, body] * force / bodies.linear[lane, OWN_MASS, body]


@scattered
def look_at_states(bodies, numbers, x, v, a, trial, stage, elapsed, row):  # type: ignore[no-untyped-def]
    """Write the states that laws make of those where the forces read them, some time later or earlier."""
    count, later = trial.states.shape[1], borrow(trial.at[2])
    force, first = borrow(trial.forces[stage]), numbers.shape[0] - BEHIND - count
    for body in range(later.shape[0]):
        later[body] = x[body] + elapsed * (v[body] + 0.5 * elapsed * a[body])
    numbers[numbers.shape[0] - 1] = max(elapsed, 0.0)
    call(bodies.functions[1], address_of(Accepted(later, v, force, 0.0, numbers, bodies.indices)), 0)
    for state in range(count):
        trial.states[row, state] = numbers[first + state]


@scattered
def _rates_of_states(bodies, numbers, x, v, trial, nudge, stage):  # type: ignore[no-untyped-def]
    """Write rates of change of states, from four small changes in time, by Richardson's extrapolation.

    A law tells which states follow others some time later; its rates of change are the limit for no time. The states of
    the stage are where the forces have read them. States that follow exactly from those at the beginning of a step,
    while extensions do not turn, have no rates: the forces take them from there.
    """
    states, count, changes = trial.states, trial.states.shape[1], 1
    for state in range(count):
        states[RATE_ROW + stage, state] = 0.0
        if states[LINK_ROW, state] <= 0.0:
            changes = 5
    for body in range(trial.total.shape[0]):
        trial.total[body] = 0.0
    still = borrow(trial.total)
    for nudged in range(changes):  # at first to the place itself, from which rounding is apart
        elapsed = nudge * 0.5 ** (nudged - 1) if nudged else 0.0
        if nudged:
            put_states(numbers, states, TRIAL_ROW)
        look_at_states(bodies, numbers, x, v, still, trial, stage, elapsed, TRIAL_ROW + nudged)
    for state in range(count):
        states[STAGE_ROW + stage, state] = states[TRIAL_ROW, state]
        if states[LINK_ROW, state] > 0.0:
            continue
        begin = states[TRIAL_ROW, state]
        one, two = states[TRIAL_ROW + 1, state] - begin, states[TRIAL_ROW + 2, state] - begin
        four, eight = states[TRIAL_ROW + 3, state] - begin, states[TRIAL_ROW + 4, state] - begin
        states[RATE_ROW + stage, state] = (512.0 * eight - 224.0 * four + 28.0 * two - one) / (21.0 * nudge)


@scattered
def evaluate(bodies, lane, numbers, time, x, v, trial, nudge, stage):  # type: ignore[no-untyped-def]
    """Write rates of change in a stage at a time; bodies of given motion are put in place."""
    count, out = bodies.linear.shape[2], borrow(trial.stages[stage])
    for body in range(count):
        if bodies.linear[lane, OWN_MASS, body] == 0.0:
            place, speed, bend = bodies.motions[lane, body, 0], 0.0, 0.0
            for wave in range(bodies.frequencies.shape[1]):
                rate = bodies.frequencies[lane, wave]
                cosine, sine = math.cos(rate * time), math.sin(rate * time)
                real, imaginary = bodies.motions[lane, body, 1 + 2 * wave], bodies.motions[lane, body, 2 + 2 * wave]
                place += real * cosine - imaginary * sine
                speed -= rate * (real * sine + imaginary * cosine)
                bend -= rate * rate * (real * cosine - imaginary * sine)
            x[body], v[body], out[1, body] = place, speed, bend
    put_states(numbers, trial.states, NOW_ROW)
    numbers[numbers.shape[0] - 2], numbers[numbers.shape[0] - 1] = time, 0.0
    indentation, force = borrow(trial.impulses[GAPS]), borrow(trial.forces[stage])
    for contact in range(force.shape[0]):
        force[contact] = 0.0  # rigid ones have no law
    bodies.forces(x, v, v, 0.0, numbers, bodies.indices, indentation, force, trial.total)
    if trial.given.shape[0]:
        call(bodies.functions[0], address_of(GivenAt(time, numbers, bodies.indices, trial.given)), 0)
        for drive in range(bodies.shares.shape[0]):
            source, body = bodies.drives[0, drive], bodies.drives[1, drive]
            trial.total[body] += bodies.shares[drive] * trial.given[source]
    for body in range(count):
        mass = bodies.linear[lane, OWN_MASS, body]
        out[0, body] = v[body]
        if mass > 0.0:
            pull = bodies.linear[lane, OWN_STIFFNESS, body] * x[body] + bodies.linear[lane, OWN_DAMPING, body] * v[body]
            out[1, body] = (trial.total[body] - pull) / mass
    for contact in range(force.shape[0]):
        if trial.impulses[HOLDS, contact] > 0.0:
            _hold(bodies, lane, trial, out, stage)
            break
    if trial.states.shape[1]:
        _rates_of_states(bodies, numbers, x, v, trial, nudge, stage)


@scattered
def write_gaps(bodies, lane, clearances, x, v, a, into, when):  # type: ignore[no-untyped-def]
    """Write gaps of all contacts, and their first two derivatives, at an end of a step.

    Kinks are as gaps; of turns these are the rate of an extension, and its derivative.
    """
    for contact in range(clearances.shape[0]):
        gap, rate, bend = -clearances[contact], 0.0, 0.0
        for body in range(bodies.links.shape[2]):
            weight = bodies.links[lane, contact, body]
            if weight != 0.0:
                gap += weight * x[body]
                rate += weight * v[body]
                bend += weight * a[body]
        into[when, 0, contact], into[when, 1, contact], into[when, 2, contact] = gap, rate, bend
    for row in range(clearances.shape[0], bodies.links.shape[1]):  # of turns
        rate, bend = 0.0, 0.0
        for body in range(bodies.links.shape[2]):
            rate += bodies.links[lane, row, body] * v[body]
            bend += bodies.links[lane, row, body] * a[body]
        into[when, 0, row], into[when, 1, row] = rate, bend


@scattered
def moment(time, length):  # type: ignore[no-untyped-def]
    """Return by how much stages stay away from the ends of a step, where given forces may jump."""
    return AT * max(abs(time), abs(time + length))


@scattered
def make_step(bodies, lane, memory, numbers, trial, time, length):  # type: ignore[no-untyped-def]
    """Make a step of some length; return its error as a part of the error that is allowed, for a tolerance of 1."""
    count, tableau = bodies.linear.shape[2], bodies.tableau
    latest = time + length - moment(time, length)
    trial.sums[:] = 0.0
    for contact in range(trial.forces.shape[1]):
        trial.impulses[0, contact] = trial.impulses[WORKED, contact] = 0.0
    for body in range(count):
        trial.at[0, body], trial.at[1, body] = trial.x[body], trial.v[body]
    x, v = borrow(trial.at[0]), borrow(trial.at[1])
    for stage in range(STAGES + 1):
        if stage:
            row = stage if stage < STAGES else ROW_B
            for body in range(count):
                place, speed = 0.0, 0.0
                for before in range(stage):
                    weight = tableau[row, before]
                    place += weight * trial.stages[before, 0, body]
                    speed += weight * trial.stages[before, 1, body]
                x[body] = trial.x[body] + length * place
                v[body] = trial.v[body] + length * speed
            for state in range(trial.states.shape[1]):
                change = 0.0
                for before in range(stage):
                    change += tableau[row, before] * trial.states[RATE_ROW + before, state]
                trial.states[NOW_ROW, state] = trial.states[0, state] + length * change
            within = min(time + tableau[ROW_C, stage] * length, latest)
            evaluate(bodies, lane, numbers, within, x, v, trial, NUDGE * length, stage)
        weight = length * tableau[ROW_B, stage]
        if weight != 0.0:
            _add(bodies, lane, trial, weight, stage)
    write_gaps(bodies, lane, memory.clearances[lane], x, v, trial.stages[STAGES, 1], trial.watched, AFTER)
    return _error(bodies, lane, memory, trial, length)


@scattered
def _add(bodies, lane, trial, weight, stage):  # type: ignore[no-untyped-def]
    """Add a stage to the integrals of a step."""
    number, x, v = trial.free.shape[0], borrow(trial.at[0]), borrow(trial.at[1])
    for place in range(number):
        body = trial.free[place]
        trial.sums[0, place] += weight * x[body]
        trial.sums[1, place] += weight * x[body] * x[body]
        trial.sums[2, place] += weight * v[body]
        trial.sums[3, place] += weight * v[body] * v[body]
    for point in range(bodies.points.shape[1]):
        along, speed = 0.0, 0.0
        for body in range(bodies.points.shape[2]):
            along += bodies.points[lane, point, body] * x[body]
            speed += bodies.points[lane, point, body] * v[body]
        trial.sums[0, number + point] += weight * along
        trial.sums[1, number + point] += weight * along * along
        trial.sums[2, number + point] += weight * speed
        trial.sums[3, number + point] += weight * speed * speed
    for contact in range(trial.impulses.shape[1]):
        force, pace = trial.forces[stage, contact], 0.0
        if force != 0.0:
            for body in range(bodies.links.shape[2]):
                pace += bodies.links[lane, contact, body] * v[body]
            trial.impulses[0, contact] += weight * force
            trial.impulses[WORKED, contact] += weight * force * pace


@scattered
def _error(bodies, lane, memory, trial, length):  # type: ignore[no-untyped-def]
    """Return the error of a step, root mean square over all free bodies, as a part of the size of the motion.

    Sizes are those of the ends of steps: rates there say nothing where a step is so long that its stages explode.
    """
    sizes, fifth, third = memory.sizes, 0.0, 0.0
    number = trial.free.shape[0]
    for quantity in range(2):
        largest = 0.0
        for place in range(number):
            body = trial.free[place]
            largest = max(largest, sizes[lane, quantity, body], abs(trial.at[quantity, body]))
        for place in range(number):
            body = trial.free[place]
            size = max(sizes[lane, quantity, body], abs(trial.at[quantity, body]), FLOOR * largest)
            one, other = 0.0, 0.0
            for stage in range(STAGES + 1):
                one += bodies.tableau[ROW_E5, stage] * trial.stages[stage, quantity, body]
                other += bodies.tableau[ROW_E3, stage] * trial.stages[stage, quantity, body]
            if size > 0.0:
                fifth += (one / size) ** 2
                third += (other / size) ** 2
    for state in range(trial.states.shape[1]):
        size, one, other = max(memory.states[lane, state], abs(trial.states[TRIAL_ROW, state])), 0.0, 0.0
        for stage in range(STAGES + 1):
            one += bodies.tableau[ROW_E5, stage] * trial.states[RATE_ROW + stage, state]
            other += bodies.tableau[ROW_E3, stage] * trial.states[RATE_ROW + stage, state]
        if size > 0.0:
            fifth += (one / size) ** 2
            third += (other / size) ** 2
    for contact in range(trial.forces.shape[1]):  # nothing moves while bodies rest, but what holds them changes
        if trial.impulses[HOLDS, contact] > 0.0:
            size, one, other = max(abs(trial.forces[0, contact]), abs(trial.forces[STAGES, contact])), 0.0, 0.0
            for stage in range(STAGES + 1):
                one += bodies.tableau[ROW_E5, stage] * trial.forces[stage, contact]
                other += bodies.tableau[ROW_E3, stage] * trial.forces[stage, contact]
            if size > 0.0:
                fifth += (one / size) ** 2
                third += (other / size) ** 2
    if fifth == 0.0:
        return 0.0
    return abs(length) * fifth / math.sqrt((fifth + 0.01 * third) * (2.0 * number + trial.states.shape[1]))


def trial_for(bodies: Bodies, free: np.ndarray, sources: int, contacts: int, laws: np.ndarray) -> Trial:
    """Return memory for the steps of a call.

    `laws` are those of `impactlab.located.turning.Turns`.
    """
    count, rows, points = bodies.linear.shape[2], bodies.links.shape[1], bodies.points.shape[1]
    states = np.zeros((STAGE_ROW + STAGES + 1, len(laws)))
    states[LINK_ROW] = laws
    return Trial(
        np.zeros(count + 1), np.zeros(count + 1), np.zeros((STAGES + 1, 2, count + 1)), np.zeros((3, count + 1)),
        np.zeros(count + 1), np.zeros(sources), np.zeros((2, 3, rows)), np.zeros((STAGES + 1, contacts)),
        states, np.zeros((4, len(free) + points)), np.zeros((BETWEEN + contacts, contacts)), free,
    )  # fmt: skip
