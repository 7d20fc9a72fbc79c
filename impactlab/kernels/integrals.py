"""Integrals over a part of a piece of motion, in closed form.

A pair with complex rates and a wave are the real part of a phasor, a complex number that grows at a constant rate. A
pair without a spring and a damper has ``a + i b`` for its phasor, a polynomial of time. Displacements, velocities and
forces are the real parts of sums of phasors by complex weights, and constants. So the integrals of phasors, of their
products, and of products with a conjugate have those of any of these and of their squares. Only the values at both ends
enter.

Integrals are added up for a few pieces at once, each a *slot*, before they are taken apart into those of bodies: a
motion comes back to the same pieces. Slot 0 is the part of a piece that was integrated last.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impactlab.compiling.jit import kernel
from impactlab.compiling.records import Numbers, PhasorCube, Phasors, PhasorTable, Slots
from impactlab.kernels.pieces import FREE, GENERAL, KAPPA, KIND, PUSH, ROOT, SWINGING, WEIGHTS, G

SLOTS = 5
"""One for a part of a piece, and the pieces that most motions have."""

LOST = 100.0
"""By how much the square of a phasor may be larger than that of its motion: two digits of an integral are lost."""

TURNED = 0.5
"""Least growth (rad) for which the difference of the ends has the integral of a phasor, else a power series."""

SHARES = 1.0 / np.arange(1.0, 21.0)
"""Factors of the power series of exponentials, which has them to rounding for 1 rad."""


class Integrals(NamedTuple):
    """Integrals of phasors: of pairs, then of waves."""

    begins: Phasors  # (phasor,) at the beginning of a part of a piece, and at its end
    ends: Phasors
    weights: PhasorTable  # (2, phasor) of two functionals
    rows: Slots  # (slot,) of pieces, -1 for none
    lengths: Numbers  # (slot,) time
    first: PhasorTable  # (slot, phasor) integrals of phasors
    plain: PhasorCube  # (slot, phasor, phasor) of their products, each pair of phasors once
    crossed: PhasorCube  # the same, the second one conjugate


def integrals_for(phasors: int) -> Integrals:
    """Return memory for the integrals of so many phasors."""
    shapes = (phasors,), (phasors,), (2, phasors)
    ends = (np.zeros(shape, complex) for shape in shapes)
    shapes = (SLOTS, phasors), (SLOTS, phasors, phasors), (SLOTS, phasors, phasors)
    sums = (np.zeros(shape, complex) for shape in shapes)
    return Integrals(*ends, np.full(SLOTS, -1), np.zeros(SLOTS), *sums)


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
    """Whether closed forms have the integrals from the phasors at the ends.

    They do not for pairs with real rates and given functions. And weak springs have phasors that are larger than their
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
            phasor, steady = integrals.begins[pair], pieces.pairs[row, pair, PUSH] / kappa
            a, b = phasor.real + steady, root * phasor.imag + g * phasor.real
            turned = min(kappa * length * length, 1.0)
            moves = a * a + turned * (b * b / kappa + turned * steady * steady)
            if phasor.real * phasor.real + phasor.imag * phasor.imag + steady * steady > LOST * moves:
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
    both = other < pairs and pieces.pairs[row, one, KIND] == FREE and pieces.pairs[row, other, KIND] == FREE
    first = one < pairs and pieces.pairs[row, one, KIND] == FREE
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
def integrate(pieces, row, frequencies, lane, length, integrals):  # type: ignore[no-untyped-def]
    """Write the integrals of phasors, from those at the ends of a part of a piece, into slot 0."""
    pairs, begins, ends = pieces.sizes[row], integrals.begins, integrals.ends
    count = pairs + frequencies.shape[1]
    integrals.lengths[0] = length
    for one in range(count):
        free = one < pairs and pieces.pairs[row, one, KIND] == FREE
        rate = _rate_of(pieces, row, frequencies, lane, one)
        if free:
            p, q, r = _polynomial(pieces, row, one, begins[one], length)
            integrals.first[0, one] = length * (p + q * SHARES[1] + r * SHARES[2])
        else:
            integrals.first[0, one] = _integral(rate, begins[one], ends[one], length)
        for other in range(one, count):
            if free or (other < pairs and pieces.pairs[row, other, KIND] == FREE):
                plain, crossed = _free_products(pieces, row, frequencies, lane, one, other, length, integrals)
            else:
                second = _rate_of(pieces, row, frequencies, lane, other)
                plain = _integral(rate + second, begins[one] * begins[other], ends[one] * ends[other], length)
                begin, end = begins[one] * begins[other].conjugate(), ends[one] * ends[other].conjugate()
                if one == other:
                    decay = -2.0 * rate.real
                    lasts = length if decay == 0.0 else -math.expm1(-decay * length) / decay
                    crossed = begin * lasts
                else:
                    crossed = _integral(rate + second.conjugate(), begin, end, length)
            integrals.plain[0, one, other], integrals.crossed[0, one, other] = plain, crossed


@kernel
def _turned(pieces, row, pair, one, two):  # type: ignore[no-untyped-def]
    """Return by what a phasor enters where its pair enters by two weights, of a and a', and the constant part."""
    if pieces.pairs[row, pair, KIND] == FREE:
        return complex(one, -two), 0.0
    g, kappa, root = pieces.pairs[row, pair, G], pieces.pairs[row, pair, KAPPA], pieces.pairs[row, pair, ROOT]
    return complex(one - g * two, root * two), one * pieces.pairs[row, pair, PUSH] / kappa


@kernel
def weigh_state(pieces, row, entry, frequencies, weights):  # type: ignore[no-untyped-def]
    """Write the weights of phasors in a displacement or a velocity; return its constant part."""
    total, pairs = pieces.offset[row, entry], pieces.sizes[row]
    for pair in range(pairs):
        one, two = pieces.outof[row, 2 * pair, entry], pieces.outof[row, 2 * pair + 1, entry]
        weights[pair], constant = _turned(pieces, row, pair, one, two)
        total += constant
    for wave in range(frequencies.shape[1]):
        weights[pairs + wave] = complex(pieces.waves[row, entry, 2 * wave], pieces.waves[row, entry, 2 * wave + 1])
    return total


@kernel
def weigh_functional(pieces, row, functional, level, frequencies, lane, weights):  # type: ignore[no-untyped-def]
    """Write the weights of phasors in a functional or one of its derivatives; return its constant part."""
    total, pairs = pieces.constants[row, functional, level], pieces.sizes[row]
    for pair in range(pairs):
        place = pair * WEIGHTS + 2 * level
        one, two = pieces.weights[row, functional, place], pieces.weights[row, functional, place + 1]
        weights[pair], constant = _turned(pieces, row, pair, one, two)
        total += constant
    for wave in range(frequencies.shape[1]):
        swing = complex(pieces.swings[row, functional, 2 * wave], pieces.swings[row, functional, 2 * wave + 1])
        for _ in range(level):
            swing = swing * complex(0.0, frequencies[lane, wave])
        weights[pairs + wave] = swing
    return total


@kernel
def integral_of(constant, weights, slot, integrals):  # type: ignore[no-untyped-def]
    """Return the integral of a constant and weighted phasors."""
    total = constant * integrals.lengths[slot]
    for place in range(weights.shape[0]):
        total += (weights[place] * integrals.first[slot, place]).real
    return total


@kernel
def integral_of_product(one, other, count, slot, integrals):  # type: ignore[no-untyped-def]
    """Return the integral of the product of two functionals of so many phasors, from their constant parts.

    Their weights are in the memory of the integrals.
    """
    total = one * other * integrals.lengths[slot]
    for place in range(count):
        first, second = integrals.weights[0, place], integrals.weights[1, place]
        total += ((other * first + one * second) * integrals.first[slot, place]).real
        plain, crossed = integrals.plain[slot, place, place], integrals.crossed[slot, place, place]
        total += 0.5 * (first * second * plain + first * second.conjugate() * crossed).real
        for behind in range(place + 1, count):
            plain, crossed = integrals.plain[slot, place, behind], integrals.crossed[slot, place, behind]
            third, fourth = integrals.weights[0, behind], integrals.weights[1, behind]
            total += 0.5 * ((first * fourth + second * third) * plain).real
            total += 0.5 * ((first * fourth.conjugate() + second * third.conjugate()) * crossed).real
    return total


@kernel
def _add_slot(pieces, frequencies, slot, lane, lanes, integrals):  # type: ignore[no-untyped-def]
    """Add the integrals in a slot to those of bodies and points, and forget them."""
    bodies, points, row = lanes.x.shape[1], lanes.bodies.shape[2] - lanes.x.shape[1], integrals.rows[slot]
    integrals.rows[slot] = -1
    if row < 0:
        return
    count = pieces.sizes[row] + frequencies.shape[1]
    for body in range(bodies + points):
        for order in range(2):
            entry = body + order * bodies if body < bodies else bodies + body + order * points
            own, same = integrals.weights[0, :count], integrals.weights[1, :count]
            constant = weigh_state(pieces, row, entry, frequencies, own)
            for place in range(count):
                same[place] = own[place]
            lanes.bodies[lane, 2 * order, body] += integral_of(constant, own, slot, integrals)
            square = integral_of_product(constant, constant, count, slot, integrals)
            lanes.bodies[lane, 2 * order + 1, body] += square


@kernel
def add_integrals(pieces, frequencies, lane, lanes, integrals):  # type: ignore[no-untyped-def]
    """Add all integrals that are kept to those of bodies and points."""
    for slot in range(1, SLOTS):
        _add_slot(pieces, frequencies, slot, lane, lanes, integrals)


@kernel
def keep_integrals(pieces, row, frequencies, lane, lanes, integrals):  # type: ignore[no-untyped-def]
    """Keep the integrals of a part of a piece with others of the same piece."""
    slot, count = 1, pieces.sizes[row] + frequencies.shape[1]
    while slot < SLOTS and integrals.rows[slot] != row:
        slot += 1
    if slot == SLOTS:
        slot = 1 + row % (SLOTS - 1)
        for other in range(1, SLOTS):
            if integrals.rows[other] < 0:
                slot = other
        _add_slot(pieces, frequencies, slot, lane, lanes, integrals)
        integrals.rows[slot], integrals.lengths[slot] = row, 0.0
        for one in range(count):
            integrals.first[slot, one] = 0.0
            for other in range(one, count):
                integrals.plain[slot, one, other] = integrals.crossed[slot, one, other] = 0.0
    integrals.lengths[slot] += integrals.lengths[0]
    for one in range(count):
        integrals.first[slot, one] += integrals.first[0, one]
        for other in range(one, count):
            integrals.plain[slot, one, other] += integrals.plain[0, one, other]
            integrals.crossed[slot, one, other] += integrals.crossed[0, one, other]
