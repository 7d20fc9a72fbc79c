"""Periodic orbits of linear motion between events: equations for their state and the times of their events.

An orbit is known by its *itinerary*, the events of a period in order, with the states of all contacts between them. Its
unknowns are the state at the beginning, the time of each event, the period, and the value of a parameter. With 1 and
the cosines and sines of all waves as further coordinates of the state, the motion between events is ``y' = B y``,
impacts are linear maps, and what vanishes at events are linear forms: exponentials of small matrices tell all.
Equations are solved by Newton's method; the product of the same derivatives is the monodromy matrix.
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
    FRICTION,
    HELD,
    OPEN,
    SLIPS_DOWN,
    SLIPS_UP,
    STICKS,
)
from impactlab.kernels.small_matrices import apply, carry, exponential, multiply, solve

GOES_ON, PASSES, BOUNCES, COMES_TO_REST = range(4)
"""What an event does to velocities; where a contact passes, it touches only."""

FLIP, CLOSING, AT_EVENT, TOUCH, IN_SEGMENT, OF_FUNCTIONAL, TOUCHED_AT, SHORTEST, SHORT_AT, LOSS = range(10)
"""Results of an orbit: the determinant of its monodromy matrix and the identity, the least rate at which a functional
comes to 0 at an event, and at which; the largest maximum of one that has no event there, in which segment, whose, and
when; the shortest time between events, and before which; and the energy that is lost in a period."""

FOUND = LOSS + 1
"""How many these are."""

LOSS_TERMS = 22
"""Terms of the series of the energy lost in a part of a segment: the rest is 1e-17."""

BISECTED = 50
"""Halvings by which a change of sign within a part of a segment is found."""

RELEASED = 1e-10
"""Part of the sizes of terms below which their sum is rounding, where a contact is released."""

NEWTON_STEPS = 12
"""Newton's steps at most."""

ENOUGH, POLISHED = 1e-8, 1e-14
"""Steps of Newton's method that can be the last one, and the next one that is expected then, as parts of sizes."""

UNKNOWN = 1e-4
"""Step that is taken for the one before the first."""

TOO_FAR = 1e3
"""Step that leads nowhere."""

SHIFT = 1e-7
"""Change of a parameter, as a part of its range, from which derivatives are found."""


class Polynomials(NamedTuple):
    """The numbers of a family of networks, see `impactlab.located.families.Family`."""

    boxes: Cube  # (panel, axis, 2)
    places: Slots  # (varying,)
    coefficients: Cube  # (panel, varying, coefficient), those of the last axis vary fastest
    counts: Slots  # (axis,) of coefficients


class Plant(NamedTuple):
    """The numbers of one network: all of them in order, and the same memory as arrays, see `Linear`."""

    numbers: Numbers
    mass: Numbers
    damping: Table
    stiffness: Table
    frequencies: Numbers
    load: Numbers
    force: Cube  # (body, wave, 2)
    links: Table
    gap: Numbers
    wall: Cube  # (contact, wave, 2)
    laws: Table  # (3, contact) springs, dampers, restitution
    frictions: Table  # (contact, 3)


class Itinerary(NamedTuple):
    """The events of a period in order; segments are between them, the first from the beginning on."""

    kinds: Slots  # (contact,)
    statuses: SlotTable  # (segment, contact)
    signs: Table  # (segment, 2 contact) with which functionals stay negative, 0 if they may be anything
    functionals: Slots  # (event,) 2 contact for a gap, a slip rate or an upper limit; 2 contact + 1 for a force
    strikes: Slots  # (event,) GOES_ON, PASSES, BOUNCES or COMES_TO_REST
    together: Slots  # (event,) whether it is at the time of the one before
    period: Slots  # wave and its cycles in a period; -1 and 0 where the period is free
    drift: Numbers  # (body,) the direction in which all may stand anywhere, and go on in a period; 0 if there is none


class Orbits(NamedTuple):
    """The unknowns of an orbit and what is found: state, times of events, period, values of parameters."""

    unknowns: Numbers
    weights: Numbers  # sizes of unknowns
    base: Numbers  # where the last equation is about
    border: Numbers  # its coefficients
    residual: Numbers
    jacobian: Table
    monodromy: Table  # (2 body, 2 body)
    found: Numbers
    rates: Numbers  # (event,) at which functionals come to 0
    tangent: Numbers  # of the curve of solutions


class ShootingWork(NamedTuple):
    """Memory that a call works in."""

    generators: Cube  # (segment, coordinate, coordinate)
    flow: Table
    powers: Cube  # (9, coordinate, coordinate), the last three for losses
    states: Cube  # (segment, 2, coordinate) at both ends
    terms: Table  # (6, coordinate), the last of them units
    row: Table  # (2, coordinate)
    forms: Cube  # (3, 2 contact + 1, coordinate) functionals, their rates and the rates of these; last, of an event
    values: Table  # (2 contact, 5) of functionals: rate, largest size, largest maximum, when this is, and bend
    sensitivity: Cube  # (2, coordinate, unknown)
    equations: Table  # (unknown, unknown)
    sides: Table  # (unknown, …)
    held: Cube  # (2, contact, contact + coordinate)


@kernel
def numbers_at(family, values, first, plant):  # type: ignore[no-untyped-def]
    """Write the numbers of the network at the values of parameters, which begin at a place of an array."""
    axes, chosen, nearest = family.boxes.shape[1], 0, math.inf
    for panel in range(family.boxes.shape[0]):
        apart = 0.0
        for axis in range(axes):
            value, low, high = values[first + axis], family.boxes[panel, axis, 0], family.boxes[panel, axis, 1]
            apart += max(low - value, value - high, 0.0) / (high - low)
        if apart < nearest:
            chosen, nearest = panel, apart
    second = family.counts[1] if axes > 1 else 1
    low, high = family.boxes[chosen, 0, 0], family.boxes[chosen, 0, 1]
    x, y = (2.0 * values[first] - low - high) / (high - low), 0.0
    if axes > 1:
        low, high = family.boxes[chosen, 1, 0], family.boxes[chosen, 1, 1]
        y = (2.0 * values[first + 1] - low - high) / (high - low)
    for number in range(family.places.shape[0]):
        last, before = 0.0, 0.0
        for degree in range(family.counts[0] - 1, -1, -1):
            inner, behind = 0.0, 0.0
            for other in range(second - 1, -1, -1):
                term = family.coefficients[chosen, number, degree * second + other]
                new = term + (2.0 if other > 0 else 1.0) * y * inner - behind
                inner, behind = new, inner
            new = inner + (2.0 if degree > 0 else 1.0) * x * last - before
            last, before = new, last
        plant.numbers[family.places[number]] = last


@kernel
def _write_row(plant, contact, other, row):  # type: ignore[no-untyped-def]
    """Write the gap of a contact, or the `other`, its rate, as a form of the state."""
    bodies, waves = plant.mass.shape[0], plant.frequencies.shape[0]
    for column in range(row.shape[0]):
        row[column] = 0.0
    for body in range(bodies):
        row[body + (bodies if other else 0)] = plant.links[contact, body]
    row[2 * bodies] = 0.0 if other else plant.gap[contact]
    for wave in range(waves):
        real, imaginary, place = plant.wall[contact, wave, 0], plant.wall[contact, wave, 1], 2 * bodies + 1 + 2 * wave
        if other:
            row[place], row[place + 1] = -plant.frequencies[wave] * imaginary, -plant.frequencies[wave] * real
        else:
            row[place], row[place + 1] = real, -imaginary


@kernel
def _push(plant, contact, row, factor, generator):  # type: ignore[no-untyped-def]
    """Let a form of the state be a force of a contact."""
    bodies = plant.mass.shape[0]
    for body in range(bodies):
        weight = factor * plant.links[contact, body] / plant.mass[body]
        if weight != 0.0:
            for column in range(row.shape[0]):
                generator[bodies + body, column] += weight * row[column]


@kernel
def _is_held(status):  # type: ignore[no-untyped-def]
    return status in (HELD, STICKS)


@seldom_called
def _write_holding(plant, itinerary, segment, generator, work):  # type: ignore[no-untyped-def]
    """Write the forces that hold contacts as forms, into ``work.held[1]``, and let them act."""
    bodies, contacts = plant.mass.shape[0], plant.gap.shape[0]
    size, count = generator.shape[0], 0
    matrix, sides, row = work.held[0], work.held[1], work.row[0]
    for contact in range(contacts):
        if not _is_held(itinerary.statuses[segment, contact]):
            continue
        for column in range(size):
            total = 0.0
            for body in range(bodies):
                total += plant.links[contact, body] * generator[bodies + body, column]
            sides[count, column] = total
        for wave in range(plant.frequencies.shape[0]):
            factor, place = plant.frequencies[wave] ** 2, 2 * bodies + 1 + 2 * wave
            sides[count, place] -= factor * plant.wall[contact, wave, 0]
            sides[count, place + 1] += factor * plant.wall[contact, wave, 1]
        column = 0
        for other in range(contacts):
            if _is_held(itinerary.statuses[segment, other]):
                total = 0.0
                for body in range(bodies):
                    total += plant.links[contact, body] * plant.links[other, body] / plant.mass[body]
                matrix[count, column] = total
                column += 1
        count += 1
    if count == 0:
        return
    if solve(matrix[:count, :count], sides[:count, :size]) == 0.0:
        generator[0, 0] = math.nan
    count = 0
    for contact in range(contacts):
        if _is_held(itinerary.statuses[segment, contact]):
            for column in range(size):
                row[column] = sides[count, column]
            _push(plant, contact, row, -1.0, generator)
            count += 1


@seldom_called
def _write_generator(plant, itinerary, segment, generator, work):  # type: ignore[no-untyped-def]
    """Write the matrix of the motion in a segment, and the units of its coordinates."""
    bodies, waves, size = plant.mass.shape[0], plant.frequencies.shape[0], generator.shape[0]
    for row in range(size):
        for column in range(size):
            generator[row, column] = 0.0
    for body in range(bodies):
        mass = plant.mass[body]
        generator[body, bodies + body] = 1.0
        for other in range(bodies):
            generator[bodies + body, other] = -plant.stiffness[body, other] / mass
            generator[bodies + body, bodies + other] = -plant.damping[body, other] / mass
        generator[bodies + body, 2 * bodies] = plant.load[body] / mass
        for wave in range(waves):
            place = 2 * bodies + 1 + 2 * wave
            generator[bodies + body, place] = plant.force[body, wave, 0] / mass
            generator[bodies + body, place + 1] = -plant.force[body, wave, 1] / mass
    for wave in range(waves):
        place, frequency = 2 * bodies + 1 + 2 * wave, plant.frequencies[wave]
        generator[place, place + 1], generator[place + 1, place] = -frequency, frequency
    row = work.row[0]
    for contact in range(plant.gap.shape[0]):
        status = itinerary.statuses[segment, contact]
        if status == CLOSED:
            _write_row(plant, contact, False, row)
            _push(plant, contact, row, -plant.laws[0, contact], generator)
            _write_row(plant, contact, True, row)
            _push(plant, contact, row, -plant.laws[1, contact], generator)
        elif status in (SLIPS_UP, SLIPS_DOWN):
            way = plant.frictions[contact, 0] if status == SLIPS_UP else -plant.frictions[contact, 0]
            for column in range(size):
                row[column] = 0.0
            row[2 * bodies] = way
            _push(plant, contact, row, -1.0, generator)
    _write_holding(plant, itinerary, segment, generator, work)
    _choose_units(plant, generator, work.terms[5])


@kernel
def _choose_units(plant, generator, scale):  # type: ignore[no-untyped-def]
    """Choose units of coordinates in which the matrix has entries of one size."""
    bodies, size, fastest = plant.mass.shape[0], generator.shape[0], 0.0
    for row in range(bodies, 2 * bodies):
        total = 0.0
        for column in range(bodies):
            total += abs(generator[row, column])
        fastest = max(fastest, math.sqrt(total))
    for wave in range(plant.frequencies.shape[0]):
        fastest = max(fastest, plant.frequencies[wave])
    if fastest == 0.0:
        fastest = 1.0
    for row in range(size):
        scale[row] = fastest if bodies <= row < 2 * bodies else 1.0
    for column in range(2 * bodies, size):
        largest = 0.0
        for row in range(bodies, 2 * bodies):
            largest = max(largest, abs(generator[row, column]))
        if largest > 0.0:
            scale[column] = fastest * fastest / largest
    for column in range(2 * bodies + 1, size, 2):
        scale[column] = scale[column + 1] = min(scale[column], scale[column + 1])


@seldom_called
def _write_functional(plant, itinerary, segment, functional, work, row):  # type: ignore[no-untyped-def]
    """Write what vanishes at an event as a form of the state in the segment whose generator was written last."""
    contact, other = functional // 2, functional % 2 == 1
    status, bodies, size = itinerary.statuses[segment, contact], plant.mass.shape[0], row.shape[0]
    if _is_held(status):
        if not (other or status == STICKS):
            _write_row(plant, contact, False, row)
            return
        place = 0
        for before in range(contact):
            if _is_held(itinerary.statuses[segment, before]):
                place += 1
        for column in range(size):
            row[column] = work.held[1, place, column]
        if status == STICKS:
            if other:
                for column in range(size):
                    row[column] = -row[column]
            row[2 * bodies] -= plant.frictions[contact, 1]
        return
    if itinerary.kinds[contact] >= FRICTION:
        _write_row(plant, contact, True, row)
        row[2 * bodies] += plant.frictions[contact, 2]
        return
    _write_row(plant, contact, False, row)
    if other:
        stiffness, damping = plant.laws[0, contact], plant.laws[1, contact]
        for column in range(size):
            row[column] *= stiffness
        rate = work.row[1]
        _write_row(plant, contact, True, rate)
        for column in range(size):
            row[column] += damping * rate[column]


@kernel
def _write_rate(form, generator, rate):  # type: ignore[no-untyped-def]
    """Write the rate of a form of the state as a form."""
    for column in range(form.shape[0]):
        total = 0.0
        for inner in range(form.shape[0]):
            total += form[inner] * generator[inner, column]
        rate[column] = total


@kernel
def _times(form, vector):  # type: ignore[no-untyped-def]
    total = 0.0
    for entry in range(form.shape[0]):
        total += form[entry] * vector[entry]
    return total


@kernel
def _significant(form, vector):  # type: ignore[no-untyped-def]
    """Return a form of a state, 0 where it is rounding."""
    total, size = 0.0, 0.0
    for entry in range(form.shape[0]):
        total += form[entry] * vector[entry]
        size += abs(form[entry] * vector[entry])
    return total if abs(total) > RELEASED * size else 0.0


@kernel
def _strike(plant, contact, rests, rate, vectors):  # type: ignore[no-untyped-def]
    """Let an impact turn the rate of a gap, a form of the state, in each column of some states."""
    bodies, inverse = plant.mass.shape[0], 0.0
    for body in range(bodies):
        inverse += plant.links[contact, body] ** 2 / plant.mass[body]
    factor = (1.0 if rests else 1.0 + plant.laws[2, contact]) / inverse
    for column in range(vectors.shape[1]):
        total = 0.0
        for entry in range(rate.shape[0]):
            total += rate[entry] * vectors[entry, column]
        for body in range(bodies):
            vectors[bodies + body, column] -= factor * plant.links[contact, body] / plant.mass[body] * total


@kernel
def _begin(plant, orbit, work):  # type: ignore[no-untyped-def]
    """Write the state at the beginning, and its derivatives."""
    bodies, state = plant.mass.shape[0], work.states[0, 0]
    for entry in range(2 * bodies):
        state[entry] = orbit.unknowns[entry]
    state[2 * bodies] = 1.0
    for wave in range(plant.frequencies.shape[0]):
        state[2 * bodies + 1 + 2 * wave], state[2 * bodies + 2 + 2 * wave] = 1.0, 0.0
    for row in range(work.sensitivity.shape[1]):
        for column in range(work.sensitivity.shape[2]):
            work.sensitivity[0, row, column] = 1.0 if row == column and row < 2 * bodies else 0.0


@seldom_called
def write_equations(plant, itinerary, orbit, work, derived, looked):  # type: ignore[no-untyped-def]
    """Write what is left of the equations of an orbit; `derived` their derivatives, too; `looked` where it touches."""
    bodies, events = plant.mass.shape[0], itinerary.functionals.shape[0]
    size, state, period = work.flow.shape[0], 2 * bodies, 2 * bodies + events
    _begin(plant, orbit, work)
    time, unknowns = 0.0, orbit.unknowns
    if looked:
        orbit.found[TOUCH], orbit.found[IN_SEGMENT], orbit.found[LOSS] = -math.inf, -1.0, 0.0
    for segment in range(events + 1):
        until, generator = unknowns[state + segment], work.generators[segment]
        _write_generator(plant, itinerary, segment, generator, work)
        squarings = exponential(generator, until - time, work.terms[5], work.powers, work.flow)
        before, after = work.states[segment, 0], work.states[segment, 1]
        apply(work.flow, before, after)
        if looked:
            _look(plant, itinerary, segment, time, until, squarings, orbit, work)
            orbit.found[LOSS] += _lost(plant, itinerary, segment, until - time, squarings, work)
        rate, form = work.row[0], work.row[1]
        if derived:
            apply(generator, after, rate)
            for row in range(size):
                for column in range(period + 1):
                    total = 0.0
                    for inner in range(size):
                        total += work.flow[row, inner] * work.sensitivity[0, inner, column]
                    work.sensitivity[1, row, column] = total
                work.sensitivity[1, row, state + segment] += rate[row]
                if segment > 0:
                    work.sensitivity[1, row, state + segment - 1] -= rate[row]
        if segment == events:
            break
        _meet(plant, itinerary, segment, orbit, work, derived)
        if looked:
            orbit.found[LOSS] += _lost_by_spring(plant, itinerary, segment, after, form)
        following = work.states[segment + 1, 0]
        for row in range(size):
            following[row] = after[row]
            if derived:
                for column in range(period + 1):
                    work.sensitivity[0, row, column] = work.sensitivity[1, row, column]
        if itinerary.strikes[segment] >= BOUNCES:
            contact, rests = itinerary.functionals[segment] // 2, itinerary.strikes[segment] == COMES_TO_REST
            _write_row(plant, contact, True, form)
            if looked:
                orbit.found[LOSS] += _lost_at_impact(plant, contact, rests, _times(form, after))
            _strike(plant, contact, rests, form, following.reshape((size, 1)))
            if derived:
                _strike(plant, contact, rests, form, work.sensitivity[0])
        time = until
    _close(plant, itinerary, orbit, work, derived)


@kernel
def _meet(plant, itinerary, segment, orbit, work, derived):  # type: ignore[no-untyped-def]
    """Write the equation of the event at the end of a segment."""
    line, state = 2 * plant.mass.shape[0] + segment, 2 * plant.mass.shape[0]
    form, rate = work.forms[0, -1], work.forms[1, -1]
    last, after = orbit.unknowns.shape[0], work.states[segment, 1]
    _write_functional(plant, itinerary, segment, itinerary.functionals[segment], work, form)
    _write_rate(form, work.generators[segment], rate)
    sign = itinerary.signs[segment, itinerary.functionals[segment]]
    if derived:
        orbit.rates[segment] = (sign if sign != 0.0 else 1.0) * _times(rate, after)
        for column in range(last):
            orbit.jacobian[line, column] = 0.0
    if itinerary.together[segment]:
        before = orbit.unknowns[state + segment - 1] if segment > 0 else 0.0
        orbit.residual[line] = orbit.unknowns[state + segment] - before
        if derived:
            orbit.jacobian[line, state + segment] = 1.0
            if segment > 0:
                orbit.jacobian[line, state + segment - 1] = -1.0
        return
    orbit.residual[line] = _times(form, after)
    if derived:
        for column in range(work.sensitivity.shape[2]):
            total = 0.0
            for entry in range(form.shape[0]):
                total += form[entry] * work.sensitivity[1, entry, column]
            orbit.jacobian[line, column] = total


@kernel
def _close(plant, itinerary, orbit, work, derived):  # type: ignore[no-untyped-def]
    """Write the equations of the state after a period, and of the period; see how short segments are."""
    state, events = 2 * plant.mass.shape[0], itinerary.functionals.shape[0]
    period, unknowns = state + events, orbit.unknowns
    for line in range(state):
        orbit.residual[line] = work.states[events, 1, line] - unknowns[line]
        if derived:
            for column in range(unknowns.shape[0]):
                total = work.sensitivity[1, line, column] if column <= period else 0.0
                orbit.jacobian[line, column] = total - (1.0 if column == line else 0.0)
    wave = itinerary.period[0]
    if wave >= 0:
        length = 2.0 * math.pi * itinerary.period[1] / plant.frequencies[wave]
        orbit.residual[period] = unknowns[period] - length
    else:  # the first event is when it was
        orbit.residual[period] = unknowns[state] - orbit.base[state]
    if derived:
        for column in range(unknowns.shape[0]):
            orbit.jacobian[period, column] = 0.0
        orbit.jacobian[period, period if wave >= 0 else state] = 1.0
    if not derived:
        return
    orbit.found[CLOSING], orbit.found[SHORTEST], time = math.inf, math.inf, 0.0
    if events > 0:
        time = unknowns[state + events - 1] - unknowns[period]
    for event in range(events):
        until = unknowns[state + event]
        if not itinerary.together[event]:
            if until - time < orbit.found[SHORTEST]:
                orbit.found[SHORTEST], orbit.found[SHORT_AT] = until - time, event
            if orbit.rates[event] < orbit.found[CLOSING]:
                orbit.found[CLOSING], orbit.found[AT_EVENT] = orbit.rates[event], event
        time = until


@seldom_called
def _begin_look(plant, itinerary, segment, time, step, work):  # type: ignore[no-untyped-def]
    """Write the functionals of a segment as forms, and what they are at its beginning."""
    generator, values = work.generators[segment], work.values
    for functional in range(itinerary.signs.shape[1]):
        sign = itinerary.signs[segment, functional]
        if sign != 0.0:
            _write_functional(plant, itinerary, segment, functional, work, work.forms[0, functional])
            _write_rate(work.forms[0, functional], generator, work.forms[1, functional])
            _write_rate(work.forms[1, functional], generator, work.forms[2, functional])
            values[functional, 4] = sign * _significant(work.forms[2, functional], work.states[segment, 0])
            values[functional, 0] = sign * _significant(work.forms[1, functional], work.states[segment, 0])
            first = sign * _significant(work.forms[0, functional], work.states[segment, 0])
            values[functional, 1], values[functional, 2] = abs(first), -math.inf
            status = itinerary.statuses[segment, functional // 2]
            if segment > 0 and status == OPEN and _is_held(itinerary.statuses[segment - 1, functional // 2]):
                values[functional, 0] = values[functional, 4] = 0.0  # it is let go without a force
            begun = segment > 0 and not _is_held(itinerary.statuses[segment - 1, functional // 2])
            if begun and (_is_held(status) or itinerary.kinds[functional // 2] >= FRICTION):
                turning = values[functional, 0] * step  # what has come to 0 is not to go on
                own = itinerary.functionals[segment - 1] // 2 == functional // 2 and not _is_held(status)
                values[functional, 2] = turning if own else first
                values[functional, 3] = time


@seldom_called
def _look(plant, itinerary, segment, time, until, squarings, orbit, work):  # type: ignore[no-untyped-def]
    """See how near to 0 functionals come within a segment; their forms are of the last generator."""
    generator, functionals = work.generators[segment], itinerary.signs.shape[1]
    if until <= time:
        return
    earliest, latest, events, state = time, until, itinerary.functionals.shape[0], 2 * plant.mass.shape[0]
    if events > 0:  # those at the ends may be before the beginning, or after the end
        whole = orbit.unknowns[state + events]
        if segment == 0:
            earliest = max(time, orbit.unknowns[state + events - 1] - whole)
        elif segment == events:
            latest = min(until, whole + orbit.unknowns[state])
    parts = 2**squarings
    step = (until - time) / parts
    values = work.values
    _begin_look(plant, itinerary, segment, time, step, work)
    here, there = work.terms[0], work.terms[1]
    for entry in range(here.shape[0]):
        here[entry] = work.states[segment, 0, entry]
    for part in range(parts):
        apply(work.powers[5], here, there)
        for functional in range(functionals):
            sign = itinerary.signs[segment, functional]
            if sign == 0.0:
                continue
            rate = sign * _times(work.forms[1, functional], there)
            bend = sign * _times(work.forms[2, functional], there)
            values[functional, 1] = max(values[functional, 1], abs(_times(work.forms[0, functional], there)))
            top, when = -math.inf, 0.0
            if values[functional, 0] > 0.0 and rate <= 0.0:
                share = values[functional, 0] / (values[functional, 0] - rate)
                top, when = _top(functional, sign, generator, step, share, work)
            elif values[functional, 0] <= 0.0 and rate <= 0.0 and values[functional, 4] > 0.0 and bend < 0.0:
                bound = min(values[functional, 0] + values[functional, 4] * step, rate - bend * step)
                if bound > 0.0:
                    top, when = _hidden_top(functional, sign, generator, step, work)
            when += time + part * step
            if top > values[functional, 2] and earliest <= when <= latest:
                values[functional, 2], values[functional, 3] = top, when
            values[functional, 0], values[functional, 4] = rate, bend
        for entry in range(here.shape[0]):
            here[entry] = there[entry]
    for functional in range(functionals):
        if itinerary.signs[segment, functional] != 0.0 and values[functional, 1] > 0.0:
            top = values[functional, 2] / values[functional, 1]
            if top > orbit.found[TOUCH]:
                orbit.found[TOUCH], orbit.found[IN_SEGMENT] = top, segment
                orbit.found[OF_FUNCTIONAL], orbit.found[TOUCHED_AT] = functional, values[functional, 3]


@kernel
def _top(functional, sign, generator, step, share, work):  # type: ignore[no-untyped-def]
    """Return the maximum of a functional in a step from the state in ``work.terms[0]``, and when it is."""
    when, state, bend = share * step, work.terms[2], work.forms[2, functional]
    for _ in range(4):
        carry(generator, when, work.terms[0], work.terms[3:5], state)
        turning = _times(bend, state)
        if turning != 0.0:
            when = min(max(when - _times(work.forms[1, functional], state) / turning, 0.0), step)
    carry(generator, when, work.terms[0], work.terms[3:5], state)
    return sign * _times(work.forms[0, functional], state), when


@kernel
def _change(form, sign, generator, low, high, work):  # type: ignore[no-untyped-def]
    """Return when a form of the state turns negative in a step from the state in ``work.terms[0]``."""
    for _ in range(BISECTED):
        middle = 0.5 * (low + high)
        carry(generator, middle, work.terms[0], work.terms[3:5], work.terms[2])
        if sign * _times(form, work.terms[2]) > 0.0:
            low = middle
        else:
            high = middle
    return low


@seldom_called
def _hidden_top(functional, sign, generator, step, work):  # type: ignore[no-untyped-def]
    """Return the maximum of a functional that falls at both ends of a step, and when it is; −inf if it only falls."""
    state = work.terms[2]
    fastest = _change(work.forms[2, functional], sign, generator, 0.0, step, work)
    carry(generator, fastest, work.terms[0], work.terms[3:5], state)
    if sign * _times(work.forms[1, functional], state) <= 0.0:
        return -math.inf, 0.0
    when = _change(work.forms[1, functional], sign, generator, fastest, step, work)
    carry(generator, when, work.terms[0], work.terms[3:5], state)
    return sign * _times(work.forms[0, functional], state), when


@kernel
def _lost_at_impact(plant, contact, rests, rate):  # type: ignore[no-untyped-def]
    """Return the energy that an impact loses whose gap closes at a rate."""
    inverse, rebound = 0.0, 0.0 if rests else plant.laws[2, contact]
    for body in range(plant.mass.shape[0]):
        inverse += plant.links[contact, body] ** 2 / plant.mass[body]
    return 0.5 * rate * rate * (1.0 - rebound * rebound) / inverse


@kernel
def _lost_by_spring(plant, itinerary, segment, state, row):  # type: ignore[no-untyped-def]
    """Return the energy of the spring of a contact that is let go with its force at 0, less if it is taken up again."""
    contact, change = itinerary.functionals[segment] // 2, 0.0
    change += 1.0 if itinerary.statuses[segment, contact] == CLOSED else 0.0
    change -= 1.0 if itinerary.statuses[segment + 1, contact] == CLOSED else 0.0
    if change == 0.0:
        return 0.0
    _write_row(plant, contact, False, row)
    return 0.5 * change * plant.laws[0, contact] * _times(row, state) ** 2


@kernel
def _write_dissipation(plant, itinerary, segment, power, row):  # type: ignore[no-untyped-def]
    """Write the power of dampers of bodies, contacts and dry friction in a segment as a quadratic form of the state."""
    bodies, size = plant.mass.shape[0], power.shape[0]
    for one in range(size):
        for other in range(size):
            power[one, other] = 0.0
    for one in range(bodies):
        for other in range(bodies):
            power[bodies + one, bodies + other] = 0.5 * (plant.damping[one, other] + plant.damping[other, one])
    for contact in range(plant.gap.shape[0]):
        status = itinerary.statuses[segment, contact]
        if status not in (CLOSED, SLIPS_UP, SLIPS_DOWN):
            continue
        _write_row(plant, contact, True, row)
        if status == CLOSED:
            for one in range(size):
                for other in range(size):
                    power[one, other] += plant.laws[1, contact] * row[one] * row[other]
            continue
        row[2 * bodies] += plant.frictions[contact, 2]
        force = plant.frictions[contact, 0] if status == SLIPS_UP else -plant.frictions[contact, 0]
        for one in range(size):
            power[2 * bodies, one] += 0.5 * force * row[one]
            power[one, 2 * bodies] += 0.5 * force * row[one]


@seldom_called
def _lost(plant, itinerary, segment, length, squarings, work):  # type: ignore[no-untyped-def]
    """Return the energy that dampers and dry friction take in a segment, of which the exponential was written last.

    It is a quadratic form W of the state at its beginning: a series for a part of the segment, and ``W + Eᵀ W E`` for
    twice the time, where E is the motion.
    """
    generator, flow = work.generators[segment], work.powers[5]
    term, total, product, size = work.powers[6], work.powers[7], work.powers[8], work.flow.shape[0]
    part = length / 2.0**squarings
    _write_dissipation(plant, itinerary, segment, term, work.row[0])
    for row in range(size):
        for column in range(size):
            total[row, column] = part * term[row, column]
    for order in range(1, LOSS_TERMS):
        multiply(term, generator, product)
        for row in range(size):
            for column in range(size):
                term[row, column] = (product[row, column] + product[column, row]) * part / order
                total[row, column] += term[row, column] * part / (order + 1)
    for _ in range(squarings):
        multiply(total, flow, product)
        for row in range(size):
            for column in range(size):
                value = 0.0
                for inner in range(size):
                    value += flow[inner, row] * product[inner, column]
                term[row, column] = value
        multiply(flow, flow, product)
        for row in range(size):
            for column in range(size):
                total[row, column] += term[row, column]
                flow[row, column] = product[row, column]
    apply(total, work.states[segment, 0], work.row[0])
    return _times(work.row[0], work.states[segment, 0])


@seldom_called
def _derive_by_parameters(family, plant, itinerary, orbit, work):  # type: ignore[no-untyped-def]
    """Write the derivatives of the equations by the parameters, from differences."""
    first, lines = orbit.unknowns.shape[0] - family.boxes.shape[1], orbit.residual.shape[0]
    for line in range(lines):
        work.sides[line, 0] = orbit.residual[line]
    for axis in range(family.boxes.shape[1]):
        place = first + axis
        value, shift = orbit.unknowns[place], SHIFT * orbit.weights[place]
        orbit.unknowns[place] = value + shift
        shift = orbit.unknowns[place] - value
        numbers_at(family, orbit.unknowns, first, plant)
        write_equations(plant, itinerary, orbit, work, False, False)
        for line in range(lines):
            orbit.jacobian[line, place] = (orbit.residual[line] - work.sides[line, 0]) / shift
        orbit.unknowns[place] = value
    for line in range(lines):
        orbit.residual[line] = work.sides[line, 0]
    numbers_at(family, orbit.unknowns, first, plant)


@seldom_called
def _end(plant, itinerary, orbit, work):  # type: ignore[no-untyped-def]
    """Write the monodromy matrix: times of events follow the state at the beginning."""
    state, events = 2 * plant.mass.shape[0], itinerary.functionals.shape[0]
    moved = work.sides  # of times, (event, state)
    for event in range(events):
        line = state + event
        own = orbit.jacobian[line, line]
        for column in range(state):
            total = -orbit.jacobian[line, column]
            for other in range(event):
                total -= orbit.jacobian[line, state + other] * moved[other, column]
            moved[event, column] = total / own if own != 0.0 else math.nan
    for row in range(state):
        for column in range(state):
            total = orbit.jacobian[row, column] + (1.0 if row == column else 0.0)
            for event in range(events):
                total += orbit.jacobian[row, state + event] * moved[event, column]
            orbit.monodromy[row, column] = total
    for row in range(state):
        for column in range(state):
            work.equations[row, column] = orbit.monodromy[row, column] + (1.0 if row == column else 0.0)
    orbit.found[FLIP] = solve(work.equations[:state, :state], work.sides[:state, :0])


@seldom_called
def _let_drift(itinerary, orbit):  # type: ignore[no-untyped-def]
    """Let bodies end elsewhere along the direction in which all may stand anywhere, and begin where they are."""
    bodies, pivot = itinerary.drift.shape[0], 0
    for body in range(bodies):
        if abs(itinerary.drift[body]) > abs(itinerary.drift[pivot]):
            pivot = body
    if itinerary.drift[pivot] == 0.0:
        return
    for body in range(bodies):
        share = itinerary.drift[body] / itinerary.drift[pivot]
        if body != pivot and share != 0.0:
            orbit.residual[body] -= share * orbit.residual[pivot]
            for column in range(orbit.jacobian.shape[1]):
                orbit.jacobian[body, column] -= share * orbit.jacobian[pivot, column]
    orbit.residual[pivot] = orbit.unknowns[pivot] - orbit.base[pivot]
    for column in range(orbit.jacobian.shape[1]):
        orbit.jacobian[pivot, column] = 1.0 if column == pivot else 0.0


@seldom_called
def _step(orbit, work, last):  # type: ignore[no-untyped-def]
    """Solve the equations with a last one, whose right-hand side is given; the solution is in ``work.sides``."""
    size = orbit.unknowns.shape[0]
    for row in range(size - 1):
        for column in range(size):
            work.equations[row, column] = orbit.jacobian[row, column]
        work.sides[row, 0] = orbit.residual[row] if last == 0.0 else 0.0
    value = -last
    for column in range(size):
        work.equations[size - 1, column] = orbit.border[column]
        if last == 0.0:
            value += orbit.border[column] * (orbit.unknowns[column] - orbit.base[column])
    work.sides[size - 1, 0] = value
    return solve(work.equations, work.sides[:, :1])


def _correct(family, plant, itinerary, orbit, work, results):  # type: ignore[no-untyped-def]
    """Find the orbit near one, on the plane of the last equation; write the number of steps, or 0 if there is none.

    And what is found of it, and the direction of the curve of orbits.
    """
    size, done, before = orbit.unknowns.shape[0], False, UNKNOWN
    results[0] = 0
    for step in range(NEWTON_STEPS):
        numbers_at(family, orbit.unknowns, size - family.boxes.shape[1], plant)
        write_equations(plant, itinerary, orbit, work, True, done)
        _derive_by_parameters(family, plant, itinerary, orbit, work)
        if done:
            _end(plant, itinerary, orbit, work)
            _let_drift(itinerary, orbit)
            _step(orbit, work, 1.0)
            for entry in range(size):
                orbit.tangent[entry] = -work.sides[entry, 0]
            results[0] = step
            return
        _let_drift(itinerary, orbit)
        _step(orbit, work, 0.0)
        largest = 0.0
        for entry in range(size):
            change = abs(work.sides[entry, 0]) / orbit.weights[entry]
            largest = max(largest, change) if change == change else math.inf
            orbit.unknowns[entry] -= work.sides[entry, 0]
        if not largest < TOO_FAR:
            return
        done = largest < ENOUGH and largest**3 <= POLISHED * before**2  # steps become quadratically smaller
        before = largest


def _evaluate(family, plant, itinerary, orbit, work, results):  # type: ignore[no-untyped-def]
    """Write the equations of an orbit and their derivatives, and what is found of it, where it is no solution, too."""
    numbers_at(family, orbit.unknowns, orbit.unknowns.shape[0] - family.boxes.shape[1], plant)
    write_equations(plant, itinerary, orbit, work, True, True)
    _derive_by_parameters(family, plant, itinerary, orbit, work)
    write_equations(plant, itinerary, orbit, work, False, False)  # states and motions of other parameters were left
    _end(plant, itinerary, orbit, work)
    _let_drift(itinerary, orbit)
    results[0] = 1


_SIGNATURE = signature(False, Polynomials, Plant, Itinerary, Orbits, ShootingWork, Slots)


def correct_loop() -> Callable[..., None]:
    """Return the compiled search for an orbit."""
    return loop(_SIGNATURE, _correct)


def evaluate_loop() -> Callable[..., None]:
    """Return the compiled equations of an orbit."""
    return loop(_SIGNATURE, _evaluate)


def work_for(bodies: int, waves: int, contacts: int, events: int, parameters: int) -> ShootingWork:
    """Return memory for calls."""
    size, unknowns = 2 * bodies + 1 + 2 * waves, 2 * bodies + events + 1 + parameters
    contacts = max(1, contacts)
    state = 2 * bodies
    shapes = (
        (events + 1, size, size), (size, size), (9, size, size), (events + 1, 2, size), (6, size), (2, size),
        (3, 2 * contacts + 1, size), (2 * contacts, 5), (2, size, state + events + 1), (unknowns, unknowns),
        (unknowns, max(1, state)), (2, contacts, max(contacts, size)),
    )  # fmt: skip
    return ShootingWork(*map(np.zeros, shapes))
