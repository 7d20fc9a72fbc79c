"""Integrals over a part of a piece of motion, also of powers, in closed form.

A pair with complex rates and a wave are the real part of a phasor, a complex number that grows at a constant rate. The
phasor of a pair without a spring and a damper is ``a + i a'``, a polynomial of time. Integrals of phasors, of their
products, and of products with a conjugate come from their values at both ends. From these follow integrals of a
*variable* or of the product of two: a and a' of each pair, without the constant part of a, then cosine and sine of each
wave. Displacements, velocities and forces are sums of variables and a constant.

A *flow* is the integral of the product of two factors: the force of a contact, the displacement or velocity of a body,
the cosine or sine of a wave, or a given function. The energy that a force along a link gives to a body is its integral
times the velocity of the body.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impactlab.compiling.jit import kernel, seldom_called
from impactlab.compiling.records import Numbers, Phasors, Table
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
from impactlab.kernels.pieces import FREE, GENERAL, KAPPA, KIND, PUSH, ROOT, SWINGING, WEIGHTS, G, derive

LOST = 100.0
"""By how much the sum of terms of an integral may be larger than what they leave: it loses two digits."""

TURNED = 0.5
"""Least growth (rad) for which the difference of the ends has the integral of a phasor, else a power series."""

SHARES = 1.0 / np.arange(1.0, 21.0)
"""Factors of the power series of exponentials, which has them to rounding for 1 rad."""


CONTACT_FORCE, DISPLACEMENT, VELOCITY, COSINE, SINE, FUNCTION = range(6)
"""Kinds of factors; each has the number of its contact, body, wave or given function."""


class Integrals(NamedTuple):
    """Integrals of variables, and memory in which they are made."""

    begins: Phasors  # (phasor,) of pairs, then waves, at the beginning of a part of a piece, and at its end
    ends: Phasors
    first: Numbers  # (variable,) integrals
    second: Table  # (variable, variable) integrals of products, once for each two phasors
    weights: Table  # (variable, entry) of displacements and velocities
    one: Numbers  # (variable,) weights of two functionals
    other: Numbers
    steady: Numbers  # (entry,) constant parts of displacements and velocities
    means: Numbers  # (entry,) their integrals
    squares: Numbers  # (entry,) integrals of their squares
    terms: Numbers  # (entry,) sums of the terms of these that are positive
    rest: Numbers  # (entry,) variables by integrals of their products with another one


def integrals_for(phasors: int, entries: int) -> Integrals:
    """Return memory for the integrals of so many phasors, displacements and velocities."""
    both = 2 * phasors
    sizes = both, (both, both), (both, entries), both, both, *[entries] * 5
    return Integrals(np.zeros(phasors, complex), np.zeros(phasors, complex), *map(np.zeros, sizes))  # type: ignore[arg-type, call-arg]


@kernel
def note_phasors(pieces, row, frequencies, state, turns, phasors):  # type: ignore[no-untyped-def]
    """Write the phasors of pairs and of turned waves."""
    pairs = pieces.sizes[row]
    for pair in range(pairs):
        a, b = state[2 * pair], state[2 * pair + 1]
        if pieces.pairs[row, pair, KIND] == SWINGING:
            a -= pieces.pairs[row, pair, PUSH] / pieces.pairs[row, pair, KAPPA]
            b = -(b + pieces.pairs[row, pair, G] * a) / pieces.pairs[row, pair, ROOT]
        phasors[pair] = complex(a, b)
    for wave in range(frequencies.shape[1]):
        phasors[pairs + wave] = complex(turns[2 * wave], turns[2 * wave + 1])


@kernel
def in_closed_form(pieces, row, length, motion, integrals):  # type: ignore[no-untyped-def]
    """Whether phasors at the ends have the integrals of all variables.

    They have not for pairs with real rates and given functions. And slow pairs have phasors that are larger than their
    motion in a short time, so that differences of the former would lose digits.
    """
    if motion.given.functions.shape[0] > 0:
        return False
    for pair in range(pieces.sizes[row]):
        kind = pieces.pairs[row, pair, KIND]
        if kind == GENERAL:
            return False
        if kind == SWINGING:
            g, kappa, root = pieces.pairs[row, pair, G], pieces.pairs[row, pair, KAPPA], pieces.pairs[row, pair, ROOT]
            a, imaginary = integrals.begins[pair].real, integrals.begins[pair].imag
            b = root * imaginary + g * a
            if a * a + imaginary * imaginary > LOST * (a * a + min(length * length, 1.0 / kappa) * b * b):
                return False
    return True


@kernel
def _rate_of(pieces, row, frequencies, lane, place):  # type: ignore[no-untyped-def]
    """Return the rate at which a phasor grows."""
    pairs = pieces.sizes[row]
    if place < pairs:
        return complex(-pieces.pairs[row, place, G], pieces.pairs[row, place, ROOT])
    return complex(0.0, frequencies[lane, place - pairs])


@kernel
def _integral(rate, begin, end, length):  # type: ignore[no-untyped-def]
    """Return the integral of a phasor that grows at a rate."""
    growth = rate * length
    size = growth.real * growth.real + growth.imag * growth.imag
    if size > TURNED * TURNED:
        return (end - begin) * (length * length / size * rate.conjugate())
    total = complex(1.0, 0.0)
    for term in range(7 if size < 1e-4 else 14, 0, -1):
        total = 1.0 + growth * total * SHARES[term]
    return length * begin * total


@kernel
def _moments(rate, begin, end, length):  # type: ignore[no-untyped-def]
    """Return the integrals of a phasor that grows at a rate, times powers 0, 1 and 2 of the part of the length."""
    growth = rate * length
    size = growth.real * growth.real + growth.imag * growth.imag
    if size > 1.0:
        back = length * length / size * rate.conjugate()
        one = (end - begin) * back
        two = (end - one / length) * back
        return one, two, (end - 2.0 * two / length) * back
    one = two = three = complex(0.0, 0.0)
    power = length * begin
    for term in range(20):
        one += power * SHARES[term]
        two += power / (term + 2)
        three += power / (term + 3)
        power = power * growth * SHARES[term]
    return one, two, three


@kernel
def _polynomial(pieces, row, pair, begin, length):  # type: ignore[no-untyped-def]
    """Return the coefficients of the phasor of a free pair, by powers of the part of the length."""
    push = pieces.pairs[row, pair, PUSH]
    return begin, complex(begin.imag * length, push * length), complex(0.5 * push * length * length, 0.0)


@kernel
def _of_product(one, other, length):  # type: ignore[no-untyped-def]
    """Return the integral of the product of two polynomials."""
    return length * (
        one[0] * (other[0] + other[1] * SHARES[1] + other[2] * SHARES[2])
        + one[1] * (other[0] * SHARES[1] + other[1] * SHARES[2] + other[2] * SHARES[3])
        + one[2] * (other[0] * SHARES[2] + other[1] * SHARES[3] + other[2] * SHARES[4])
    )


@kernel
def _free_products(pieces, row, frequencies, lane, one, other, length, integrals):  # type: ignore[no-untyped-def]
    """Return the integrals of the product of two phasors, and of that with a conjugate, one of them of a free pair."""
    pairs, begins, ends = pieces.sizes[row], integrals.begins, integrals.ends
    first = one < pairs and pieces.pairs[row, one, KIND] == FREE
    both = first and other < pairs and pieces.pairs[row, other, KIND] == FREE
    free, swings = (one, other) if first else (other, one)
    p, q, r = _polynomial(pieces, row, free, begins[free], length)
    if both:
        u, v, w = _polynomial(pieces, row, other, begins[other], length)
        crossed = _of_product((p, q, r), (u.conjugate(), v.conjugate(), w.conjugate()), length)
        return _of_product((p, q, r), (u, v, w), length), crossed
    rate = _rate_of(pieces, row, frequencies, lane, swings)
    u, v, w = _moments(rate, begins[swings], ends[swings], length)
    crossed = p * u.conjugate() + q * v.conjugate() + r * w.conjugate()
    return p * u + q * v + r * w, crossed if first else crossed.conjugate()


@kernel
def _products(pieces, row, frequencies, lane, one, other, length, integrals):  # type: ignore[no-untyped-def]
    """Return the integrals of the product of two phasors that grow at rates, and of that with a conjugate."""
    begins, ends = integrals.begins, integrals.ends
    rate = _rate_of(pieces, row, frequencies, lane, one)
    second = _rate_of(pieces, row, frequencies, lane, other)
    plain = _integral(rate + second, begins[one] * begins[other], ends[one] * ends[other], length)
    begin = begins[one] * begins[other].conjugate()
    if one == other:
        decay = -2.0 * rate.real
        return plain, begin * (length if decay == 0.0 else -math.expm1(-decay * length) / decay)
    return plain, _integral(rate + second.conjugate(), begin, ends[one] * ends[other].conjugate(), length)


@kernel
def _is_free(pieces, row, place):  # type: ignore[no-untyped-def]
    """Whether a phasor is that of a free pair."""
    return place < pieces.sizes[row] and pieces.pairs[row, place, KIND] == FREE


@kernel
def _of_variables(pieces, row, place):  # type: ignore[no-untyped-def]
    """Return what real and imaginary part of a phasor are in the second of its variables; the first is the former."""
    if place < pieces.sizes[row] and pieces.pairs[row, place, KIND] == SWINGING:
        return -pieces.pairs[row, place, G], -pieces.pairs[row, place, ROOT]
    return 0.0, 1.0


@kernel
def integrate(pieces, row, frequencies, lane, length, integrals):  # type: ignore[no-untyped-def]
    """Write the integrals of variables and of their products, from the phasors at the ends of a part of a piece."""
    begins, ends, second = integrals.begins, integrals.ends, integrals.second
    count = pieces.sizes[row] + frequencies.shape[1]
    for one in range(count):
        free = _is_free(pieces, row, one)
        real, imaginary = _of_variables(pieces, row, one)
        if free:
            p, q, r = _polynomial(pieces, row, one, begins[one], length)
            first = length * (p + q * SHARES[1] + r * SHARES[2])
        else:
            first = _integral(_rate_of(pieces, row, frequencies, lane, one), begins[one], ends[one], length)
        integrals.first[2 * one] = first.real
        integrals.first[2 * one + 1] = real * first.real + imaginary * first.imag
        for other in range(one, count):
            if free or _is_free(pieces, row, other):
                plain, crossed = _free_products(pieces, row, frequencies, lane, one, other, length, integrals)
            else:
                plain, crossed = _products(pieces, row, frequencies, lane, one, other, length, integrals)
            reals, imaginaries = 0.5 * (crossed.real + plain.real), 0.5 * (crossed.real - plain.real)
            before, behind = 0.5 * (plain.imag + crossed.imag), 0.5 * (plain.imag - crossed.imag)
            others_real, others_imaginary = _of_variables(pieces, row, other)
            after = others_real * reals + others_imaginary * behind
            second[2 * one, 2 * other], second[2 * one, 2 * other + 1] = reals, after
            second[2 * one + 1, 2 * other] = real * reals + imaginary * before
            last = others_real * before + others_imaginary * imaginaries
            second[2 * one + 1, 2 * other + 1] = real * after + imaginary * last


@kernel
def _steady_part(pieces, row, pair):  # type: ignore[no-untyped-def]
    """Return the constant part of a of a pair."""
    if pieces.pairs[row, pair, KIND] == SWINGING:
        return pieces.pairs[row, pair, PUSH] / pieces.pairs[row, pair, KAPPA]
    return 0.0


@seldom_called
def _weigh_states(pieces, row, frequencies, integrals):  # type: ignore[no-untyped-def]
    """Write the weights of variables in displacements and velocities, and the constant parts of these."""
    pairs, weights, entries = pieces.sizes[row], integrals.weights, integrals.steady.shape[0]
    for entry in range(entries):
        integrals.steady[entry] = pieces.offset[row, entry]
        for wave in range(frequencies.shape[1]):
            weights[2 * (pairs + wave), entry] = pieces.waves[row, entry, 2 * wave]
            weights[2 * (pairs + wave) + 1, entry] = -pieces.waves[row, entry, 2 * wave + 1]
    for pair in range(pairs):
        part = _steady_part(pieces, row, pair)
        for entry in range(entries):
            weights[2 * pair, entry] = pieces.outof[row, 2 * pair, entry]
            weights[2 * pair + 1, entry] = pieces.outof[row, 2 * pair + 1, entry]
            integrals.steady[entry] += weights[2 * pair, entry] * part


@kernel
def _integrate_states(pieces, row, frequencies, length, integrals):  # type: ignore[no-untyped-def]
    """Write the integrals of displacements and velocities and of their squares."""
    pairs, weights, steady, second = pieces.sizes[row], integrals.weights, integrals.steady, integrals.second
    means, squares, terms, rest = integrals.means, integrals.squares, integrals.terms, integrals.rest
    both, entries = 2 * (pairs + frequencies.shape[1]), steady.shape[0]
    means[:] = 0.0
    for one in range(both):
        for entry in range(entries):
            means[entry] += weights[one, entry] * integrals.first[one]
    for entry in range(entries):
        terms[entry] = steady[entry] * steady[entry] * length
        squares[entry] = terms[entry] + 2.0 * steady[entry] * means[entry]
        means[entry] += steady[entry] * length
    for one in range(both):
        for entry in range(entries):
            part = weights[one, entry] * second[one, one]
            terms[entry] += weights[one, entry] * part
            rest[entry] = 0.5 * part
        for other in range(one + 1, both):
            if pieces.plain[row] and other < 2 * pairs and (other - one) % 2 == 1:
                continue
            for entry in range(entries):
                rest[entry] += weights[other, entry] * second[one, other]
        for entry in range(entries):
            squares[entry] += 2.0 * weights[one, entry] * rest[entry]


@kernel
def add_integrals(pieces, row, frequencies, lane, lanes, time, length, integrals):  # type: ignore[no-untyped-def]
    """Add the integrals of a part of a piece that begins at a time to those of bodies and points; return whether.

    They are not added where pairs and waves are larger than the motion, this one and that so far.
    """
    _weigh_states(pieces, row, frequencies, integrals)
    _integrate_states(pieces, row, frequencies, length, integrals)
    bodies, points, sums = lanes.x.shape[1], lanes.bodies.shape[2] - lanes.x.shape[1], lanes.bodies
    past = length / time if time > 0.0 else 0.0
    for body in range(bodies + points):
        place, later = (body, bodies) if body < bodies else (bodies + body, points)
        for order in range(2):
            entry = place + order * later
            usual = integrals.squares[entry] + past * sums[lane, 2 * order + 1, body]
            if integrals.terms[entry] > LOST * usual:
                return False
    for body in range(bodies + points):
        place, later = (body, bodies) if body < bodies else (bodies + body, points)
        for order in range(2):
            sums[lane, 2 * order, body] += integrals.means[place + order * later]
            sums[lane, 2 * order + 1, body] += integrals.squares[place + order * later]
    return True


@seldom_called
def weigh_functional(pieces, row, functional, level, frequencies, lane, weights):  # type: ignore[no-untyped-def]
    """Write the weights of variables in a functional or one of its derivatives; return its constant part."""
    total, pairs = pieces.constants[row, functional, level], pieces.sizes[row]
    for pair in range(pairs):
        place = pair * WEIGHTS + 2 * level
        one, two = pieces.weights[row, functional, place], pieces.weights[row, functional, place + 1]
        weights[2 * pair], weights[2 * pair + 1] = one, two
        total += weights[2 * pair] * _steady_part(pieces, row, pair)
    for wave in range(frequencies.shape[1]):
        real, imaginary = pieces.swings[row, functional, 2 * wave], pieces.swings[row, functional, 2 * wave + 1]
        for _ in range(level):
            real, imaginary = -frequencies[lane, wave] * imaginary, frequencies[lane, wave] * real
        weights[2 * (pairs + wave)], weights[2 * (pairs + wave) + 1] = real, -imaginary
    return total


@kernel
def integral_of(constant, weights, count, length, integrals):  # type: ignore[no-untyped-def]
    """Return the integral of a constant and so many weighted variables."""
    total = constant * length
    for place in range(count):
        total += weights[place] * integrals.first[place]
    return total


@kernel
def integral_of_product(one, other, count, length, integrals):  # type: ignore[no-untyped-def]
    """Return the integral of the product of two functionals of so many variables, from their constant parts.

    Their weights are in the memory of the integrals.
    """
    total = one * other * length
    for place in range(count):
        first, second = integrals.one[place], integrals.other[place]
        total += (other * first + one * second) * integrals.first[place]
        total += first * second * integrals.second[place, place]
        for behind in range(place + 1, count):
            crossed = first * integrals.other[behind] + second * integrals.one[behind]
            total += crossed * integrals.second[place, behind]
    return total


@kernel
def _of_friction(scene, lane, lanes, link, holding):  # type: ignore[no-untyped-def]
    """Return the force of dry friction, from by how much that which holds it is beyond its limit."""
    status = lanes.statuses[lane, link]
    if status == STICKS:
        return holding + scene.contacts[lane, link, STICK_FORCE]
    if status == SLIPS_UP:
        return scene.contacts[lane, link, SLIP_FORCE]
    return -scene.contacts[lane, link, SLIP_FORCE] if status == SLIPS_DOWN else 0.0


@seldom_called
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


@seldom_called
def force_at(scene, pieces, row, lane, lanes, place, motion):  # type: ignore[no-untyped-def]
    """Return the force of a contact, or of another row that has events, at the time of a motion."""
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


@seldom_called
def _factor(scene, pieces, row, lane, lanes, flow, side, work):  # type: ignore[no-untyped-def]
    """Return a factor at the time of a motion, whose state has been taken."""
    kind, place, motion = scene.flows[flow, 2 * side], scene.flows[flow, 2 * side + 1], work.motion
    if kind == CONTACT_FORCE:
        return force_at(scene, pieces, row, lane, lanes, place, motion)
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


@seldom_called
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
