"""Linear motion between events: modes, functionals of them, and how long a functional surely stays negative.

A *piece* is the motion while no contact changes. It is a sum of pairs, each of which obeys
``a'' + 2 g a' + κ a = p``, and of waves at the frequencies of given forces and motions. A *functional* is a linear
function of displacements and velocities, such as the gap of a contact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impactlab.compiling.jit import kernel, seldom_called
from impactlab.compiling.records import Cube, Numbers, Slots, SlotTable, Table
from impactlab.kernels.elementary import MOST_ANGLE, cosine_and_sine, faded

G, KAPPA, ROOT, PUSH, KIND, NATURAL = range(6)
"""Columns of the numbers of a pair: decay g, stiffness κ, ``sqrt|κ − g²|``, constant p, its kind, and ``sqrt κ``."""

PAIR = NATURAL + 1
"""Number of these columns."""

SWINGING, GENERAL, FREE = range(3)
"""Kinds of pairs: with two complex rates, with any rates, and without a spring and a damper."""

LEVELS = 5
"""A functional and its first four derivatives."""

AMPLITUDE = 2 * LEVELS
"""Column of the weights of a functional that has the size of what a pair adds to it, by the amplitude."""

WEIGHTS = AMPLITUDE + 1
"""Columns of the weights of a functional for each pair: of a and a' at each level, and the size."""

LIMITS = LEVELS - 1
"""Derivatives of a functional that are bounded: the second to the fifth."""

ROUNDING = 4.0 * 2.0**-52
"""Part of the sum of the sizes of its terms up to which a functional is 0."""

SIGNIFICANT = 1e-12
"""The same for the derivatives of a functional that is 0 itself."""

APPROACHES = 4
"""Parabolas by which the root of a Taylor polynomial is approached."""

CLOSE = 0.1
"""Part of a time that the last of them may add: the next look at the motion costs less than some more of them."""


DEGREE = 15
"""Degree of the polynomials of given functions."""

FITTED = 16.0
"""Size of a polynomial, of which rounding is a part, over the sum of its terms."""

TERMS = 30
"""Terms of the power series of the motion that they add: it is known to rounding for `TURN`."""

TURN = 3.0
"""Largest angle of the fastest pair while a power series is used (rad)."""


WEAK = 0.7
"""Least angle of a pair (rad) for which sine and cosine have its response to a push, else a power series."""

MANY = 4
"""Pairs from which on their sines and exponentials are taken as vectors."""


class Pieces(NamedTuple):
    """Pieces of all lanes, each in a row."""

    statuses: SlotTable  # (row, contact)
    sizes: Slots  # (row,) number of pairs
    pairs: Cube  # (row, pair, PAIR)
    into: Cube  # (row, 2 body, 2 pair) from displacements and velocities
    offset: Table  # (row, entry) of displacements, velocities, and then those of points
    waves: Cube  # (row, entry, 2 frequency): real and imaginary part of the amplitude at each frequency
    outof: Cube  # (row, 2 pair, entry)
    weights: Cube  # (row, functional, pair WEIGHTS)
    constants: Cube  # (row, functional, LEVELS)
    swings: Cube  # (row, functional, 2 frequency), as `waves`
    limits: Cube  # (row, functional, LIMITS) of what waves add to derivatives
    fastest: Numbers  # (row,) largest rate of any pair or wave (rad s-1)
    plain: Slots  # (row,) 1 where displacements are those of pairs alone, and velocities their rates of change
    drives: Cube  # (row, 2 pair, source) what a given function adds to the rates of change of a and a'
    direct: Cube  # (row, functional, source (LEVELS + 1)) and to a functional, and by the pairs to its derivatives


class Panels(NamedTuple):
    """Given functions of all lanes, as polynomials of the part of each panel of time."""

    edges: Numbers  # of panels, of one set of functions after the other (s)
    functions: Table  # (panel, source (DEGREE + 1))
    begins: Slots  # (set + 1,) first edge of each set
    sets: Slots  # (lane,) which set each lane has


class Given(NamedTuple):
    """Given functions from the beginning of a piece on, and what they add to its motion."""

    room: Numbers  # (1,) time for which this is known (s)
    functions: Table  # (source, DEGREE + 1) polynomials of the part of this time
    values: Table  # (source, LEVELS) a function and its derivatives at a time
    steepest: Table  # (source, LEVELS + 1) bounds of all derivatives
    added: Table  # (2 pair, TERMS) power series of the part of this time


class Motion(NamedTuple):
    """The motion of a lane in its piece."""

    begin: Numbers  # (2 pair,) a, a' of each pair at the beginning
    at: Numbers  # (1,) the time since then at which the following is
    now: Numbers  # (2 pair,) a, a'
    responses: Table  # (3, pair) to an impulse, its rate of change, and to a unit push
    turned: Numbers  # (2 frequency,) cosine and sine of each wave at the beginning
    turns: Numbers  # and now
    strengths: Numbers  # (pair,) amplitude at the beginning
    amplitudes: Numbers  # (pair,) bound of the amplitude from then on
    levels: Numbers  # (LEVELS,) a functional and its derivatives, and the sizes of their terms
    sizes: Numbers
    limits: Numbers  # (LIMITS,) bounds of the higher ones from then on
    given: Given


@kernel
def _swing(pairs, row, pair, cosine, sine, decay):  # type: ignore[no-untyped-def]
    """Return the responses of a pair with complex rates, as `respond` does."""
    g, kappa, root = pairs[row, pair, G], pairs[row, pair, KAPPA], pairs[row, pair, ROOT]
    step = decay * sine / root
    rate = decay * cosine - g * step
    return step, rate, (1.0 - rate - 2.0 * g * step) / kappa, decay


@kernel
def respond(pairs, row, pair, time):  # type: ignore[no-untyped-def]
    """Return the response of a pair to a unit impulse, its rate of change, the response to a unit push, and its decay.

    The last is that of swinging, or more.
    """
    g, kappa, root = pairs[row, pair, G], pairs[row, pair, KAPPA], pairs[row, pair, ROOT]
    kind = pairs[row, pair, KIND]
    x = root * time
    if kind == FREE:
        return time, 1.0, 0.5 * time * time, 1.0
    if kind == SWINGING and x > WEAK:
        return _swing(pairs, row, pair, math.cos(x), math.sin(x), math.exp(-g * time) if g != 0.0 else 1.0)
    if kappa * time * time < 1.0 and g * time < 1.0:
        slow, stiff = 2.0 * g * time, kappa * time * time
        # coefficients d_k of σ = Σ d_k t^k, with (k + 2)(k + 1) d_{k+2} = −2 g (k + 1) d_{k+1} − κ d_k
        before, last = 0.0, 0.5
        pushed, step, rate = 0.5, 1.0, 1.0
        for k in range(1, 24):
            following = -(slow * (k + 1) * last + stiff * before) / ((k + 2) * (k + 1))
            pushed += following
            step += (k + 2) * following
            rate += (k + 2) * (k + 1) * following
            if abs(following) + abs(last) < 1e-19:
                break
            before, last = last, following
        return step * time, rate, pushed * time * time, 1.0
    square = (g * g - kappa) * time * time
    if abs(square) < 0.25:
        even, odd, term = 1.0, 1.0, 1.0
        for k in range(1, 10):
            term *= square / ((2 * k) * (2 * k - 1))
            even += term
            odd += term / (2 * k + 1)
        decay = math.exp(-g * time)
        step = decay * time * odd
        rate = decay * even - g * step
        return step, rate, (1.0 - rate - 2.0 * g * step) / kappa, decay
    if square < 0.0:
        return _swing(pairs, row, pair, math.cos(x), math.sin(x), math.exp(-g * time))
    fast = -(g + root)
    slow = kappa / fast
    one, two = math.exp(slow * time), math.exp(fast * time)
    step = (one - two) / (2.0 * root)
    rate = (slow * one - fast * two) / (2.0 * root)
    grown = time if slow == 0.0 else math.expm1(slow * time) / slow
    return step, rate, (grown - math.expm1(fast * time) / fast) / (2.0 * root), 1.0


@kernel
def carry(pairs, row, pair, push, a, b, responses):  # type: ignore[no-untyped-def]
    """Return a and a' of a pair under a push, a time after their values were a and b, from its responses then.

    With the response σ to a unit push, ``a + b σ' + (p − κ a) σ`` loses no digits where the spring is weak.
    """
    rest = push - pairs[row, pair, KAPPA] * a
    step, rate, pushed = responses[0, pair], responses[1, pair], responses[2, pair]
    return a + b * step + rest * pushed, b * rate + rest * step


@kernel
def turn_waves(frequencies, lane, time, motion):  # type: ignore[no-untyped-def]
    """Write cosine and sine of all waves at a time."""
    for wave in range(frequencies.shape[1]):
        angle = frequencies[lane, wave] * time
        motion.turns[2 * wave] = math.cos(angle)
        motion.turns[2 * wave + 1] = math.sin(angle)


@kernel
def _amplitude(pieces, row, pair, a, b, push):  # type: ignore[no-untyped-def]
    """Return the amplitude of a pair with complex rates under a push."""
    g, kappa, root = pieces.pairs[row, pair, G], pieces.pairs[row, pair, KAPPA], pieces.pairs[row, pair, ROOT]
    a -= push / kappa
    b = (b + g * a) / root
    return math.sqrt(a * a + b * b)


@kernel
def _bound_amplitudes(pieces, row, motion):  # type: ignore[no-untyped-def]
    """Write bounds of the amplitudes of pairs from now on, as if given functions stayed as they are."""
    for pair in range(pieces.sizes[row]):
        if pieces.pairs[row, pair, KIND] != SWINGING:
            continue
        push, b = pieces.pairs[row, pair, PUSH], motion.now[2 * pair + 1]
        for source in range(motion.given.functions.shape[0]):
            along = pieces.drives[row, 2 * pair, source] * motion.given.values[source, 0]
            push += pieces.drives[row, 2 * pair + 1, source] * motion.given.values[source, 0]
            push += 2.0 * pieces.pairs[row, pair, G] * along
            b += along
        motion.amplitudes[pair] = _amplitude(pieces, row, pair, motion.now[2 * pair], b, push)


@kernel
def _into(pieces, row, state, pairs):  # type: ignore[no-untyped-def]
    """Add to a and a' of pairs what displacements and velocities are in them."""
    for entry in range(pieces.into.shape[1]):
        for place in range(2 * pieces.sizes[row]):
            pairs[place] += pieces.into[row, entry, place] * state[entry]


@kernel
def out_of(pieces, row, sign, pairs, state):  # type: ignore[no-untyped-def]
    """Add to as many displacements and velocities as there is room for what pairs are in them, times a sign."""
    for place in range(2 * pieces.sizes[row]):
        size = sign * pairs[place]
        for entry in range(state.shape[0]):
            state[entry] += pieces.outof[row, place, entry] * size


@kernel
def begin(pieces, row, frequencies, lane, time, x, v, motion):  # type: ignore[no-untyped-def]
    """Take the motion of a lane from its displacements and velocities at a time.

    The pairs are corrected by what they leave of these, since rounding of the weights would add up over many pieces.
    """
    bodies, pairs, state = x.shape[1], pieces.sizes[row], motion.now
    turn_waves(frequencies, lane, time, motion)
    for entry in range(2 * bodies):
        value = x[lane, entry] if entry < bodies else v[lane, entry - bodies]
        value -= pieces.offset[row, entry]
        for wave in range(frequencies.shape[1]):
            value -= pieces.waves[row, entry, 2 * wave] * motion.turns[2 * wave]
            value += pieces.waves[row, entry, 2 * wave + 1] * motion.turns[2 * wave + 1]
        state[entry] = value
    motion.begin[:] = 0.0
    _into(pieces, row, state, motion.begin)
    out_of(pieces, row, -1.0, motion.begin, state)
    _into(pieces, row, state, motion.begin)
    for place in range(2 * frequencies.shape[1]):
        motion.turned[place] = motion.turns[place]
    for pair in range(pairs):
        if pieces.pairs[row, pair, KIND] == SWINGING:
            a, b = motion.begin[2 * pair], motion.begin[2 * pair + 1]
            motion.strengths[pair] = _amplitude(pieces, row, pair, a, b, pieces.pairs[row, pair, PUSH])
    go_back(pieces, row, motion)


@kernel
def go_back(pieces, row, motion):  # type: ignore[no-untyped-def]
    """Put a motion back to the beginning of its piece."""
    motion.at[0] = 0.0
    for place in range(motion.turns.shape[0]):
        motion.turns[place] = motion.turned[place]
    for pair in range(pieces.sizes[row]):
        motion.now[2 * pair], motion.now[2 * pair + 1] = motion.begin[2 * pair], motion.begin[2 * pair + 1]
        motion.responses[0, pair], motion.responses[1, pair], motion.responses[2, pair] = 0.0, 1.0, 0.0
        motion.amplitudes[pair] = motion.strengths[pair]


@seldom_called
def take_given(pieces, row, panels, lane, time, motion):  # type: ignore[no-untyped-def]
    """Take given functions from a time on, and the motion that they add to pairs; return how long they are known."""
    given = motion.given
    sources = given.functions.shape[0]
    if sources == 0:
        return math.inf
    own_set = panels.sets[lane]
    edges = panels.edges[panels.begins[own_set] : panels.begins[own_set + 1]]
    panel = min(max(np.searchsorted(edges, time, side="right") - 1, 0), edges.shape[0] - 2)
    function = panels.begins[own_set] - own_set + panel  # sets have an edge more than panels
    width, room = edges[panel + 1] - edges[panel], edges[panel + 1] - time
    if room * pieces.fastest[row] > TURN:
        room = TURN / pieces.fastest[row]
    given.room[0] = room
    begin, share = (time - edges[panel]) / width, room / width
    for source in range(sources):
        own, power, factor = given.functions[source], 1.0, 1.0
        for term in range(DEGREE + 1):
            own[term] = panels.functions[function, source * (DEGREE + 1) + term]
        for first in range(DEGREE):
            for term in range(DEGREE - 1, first - 1, -1):
                own[term] += begin * own[term + 1]
        for term in range(DEGREE + 1):
            own[term] *= power
            power *= share
        for level in range(LEVELS + 1):
            bound = 0.0
            for term in range(level, DEGREE + 1):
                falling = 1.0
                for place in range(level):
                    falling *= term - place
                bound += abs(own[term]) * falling
            if level < LEVELS:
                given.values[source, level] = factor * own[level]
            given.steepest[source, level] = bound / room**level
            factor *= (level + 1) / room
    for pair in range(pieces.sizes[row]):
        g, kappa = pieces.pairs[row, pair, G], pieces.pairs[row, pair, KAPPA]
        a = b = 0.0
        for term in range(TERMS):
            given.added[2 * pair, term], given.added[2 * pair + 1, term] = a, b
            rate, bend = b, -kappa * a - 2.0 * g * b
            if term <= DEGREE:
                for source in range(sources):
                    rate += pieces.drives[row, 2 * pair, source] * given.functions[source, term]
                    bend += pieces.drives[row, 2 * pair + 1, source] * given.functions[source, term]
            a, b = room * rate / (term + 1), room * bend / (term + 1)
    _bound_amplitudes(pieces, row, motion)
    return room


@seldom_called
def _add_given(pieces, row, elapsed, motion):  # type: ignore[no-untyped-def]
    """Write given functions and their derivatives at a time, and add their motion to that of the pairs."""
    given = motion.given
    room = given.room[0]
    part = elapsed / room
    for source in range(given.functions.shape[0]):
        for level in range(LEVELS):
            value = 0.0
            for term in range(DEGREE, level - 1, -1):
                falling = 1.0
                for place in range(level):
                    falling *= term - place
                value = value * part + falling * given.functions[source, term]
            given.values[source, level] = value / room**level
    for pair in range(2 * pieces.sizes[row]):
        value = 0.0
        for term in range(TERMS - 1, -1, -1):
            value = value * part + given.added[pair, term]
        motion.now[pair] += value


@kernel
def _respond_all(pieces, row, elapsed, motion):  # type: ignore[no-untyped-def]
    """Write the responses of pairs as if all of them swung, in loops that become vectors."""
    responses, pairs = motion.responses, pieces.sizes[row]
    for pair in range(pairs):
        responses[0, pair], responses[1, pair] = cosine_and_sine(pieces.pairs[row, pair, ROOT] * elapsed)
    for pair in range(pairs):
        responses[2, pair] = faded(pieces.pairs[row, pair, G] * elapsed)
    for pair in range(pairs):
        cosine, sine, decay = responses[0, pair], responses[1, pair], responses[2, pair]
        step, rate, pushed, decay = _swing(pieces.pairs, row, pair, cosine, sine, decay)
        responses[0, pair], responses[1, pair], responses[2, pair] = step, rate, pushed
        motion.amplitudes[pair] = decay * motion.strengths[pair]


@kernel
def look(pieces, row, frequencies, lane, start, elapsed, motion):  # type: ignore[no-untyped-def]
    """Carry the motion of a piece from its start to a time later, where it is not there already."""
    if elapsed == motion.at[0]:
        return
    if elapsed == 0.0 and motion.given.functions.shape[0] == 0:
        go_back(pieces, row, motion)
        return
    motion.at[0] = elapsed
    turn_waves(frequencies, lane, start + elapsed, motion)
    responses, pairs = motion.responses, pieces.sizes[row]
    many = pairs >= MANY and elapsed * pieces.fastest[row] <= MOST_ANGLE
    if many:
        _respond_all(pieces, row, elapsed, motion)
    for pair in range(pairs):
        swings = pieces.pairs[row, pair, KIND] == SWINGING and pieces.pairs[row, pair, ROOT] * elapsed > WEAK
        if not many or not swings:
            step, rate, pushed, decay = respond(pieces.pairs, row, pair, elapsed)
            responses[0, pair], responses[1, pair], responses[2, pair] = step, rate, pushed
            motion.amplitudes[pair] = decay * motion.strengths[pair]
    for pair in range(pairs):
        push, a, b = pieces.pairs[row, pair, PUSH], motion.begin[2 * pair], motion.begin[2 * pair + 1]
        motion.now[2 * pair], motion.now[2 * pair + 1] = carry(pieces.pairs, row, pair, push, a, b, motion.responses)
    if motion.given.functions.shape[0] > 0:
        _add_given(pieces, row, elapsed, motion)
        _bound_amplitudes(pieces, row, motion)


@kernel
def bound(pieces, row, functional, motion):  # type: ignore[no-untyped-def]
    """Write bounds of the second and higher derivatives of a functional from now on."""
    for place in range(LIMITS):
        motion.limits[place] = pieces.limits[row, functional, place]
    for pair in range(pieces.sizes[row]):
        g, kappa, push = pieces.pairs[row, pair, G], pieces.pairs[row, pair, KAPPA], pieces.pairs[row, pair, PUSH]
        kind, first = pieces.pairs[row, pair, KIND], pair * WEIGHTS
        if kind == SWINGING:
            size = pieces.weights[row, functional, first + AMPLITUDE] * motion.amplitudes[pair] * kappa
            for place in range(LIMITS):
                motion.limits[place] += size
                size *= pieces.pairs[row, pair, NATURAL]
        elif kind == GENERAL:
            a, b = motion.now[2 * pair], abs(motion.now[2 * pair + 1])
            a = abs(a - push / kappa) if kappa > 0.0 else 0.0
            steady = 0.0 if kappa > 0.0 else abs(push) / (2.0 * g)
            of_a, of_b = pieces.weights[row, functional, first + 2], pieces.weights[row, functional, first + 3]
            for place in range(LIMITS):
                of_a, of_b = -kappa * of_b, of_a - 2.0 * g * of_b
                motion.limits[place] += abs(of_a) * (a + b / g) + abs(of_b) * (b + kappa * a / g + steady)
        else:
            motion.limits[0] += abs(pieces.weights[row, functional, first] * push)
    for source in range(motion.given.functions.shape[0]):
        _bound_given(pieces, row, functional, source, motion)


@seldom_called
def _bound_given(pieces, row, functional, source, motion):  # type: ignore[no-untyped-def]
    """Add what a given function may add to the bounds: by its changes from now on, or for all of it.

    Pairs with complex rates have moved as if it stayed as it is.
    """
    given, place = motion.given, source * (LEVELS + 1)
    rest = given.room[0] - motion.at[0]
    for level in range(2, LEVELS + 1):
        motion.limits[level - 2] += abs(pieces.direct[row, functional, place]) * given.steepest[source, level]
    for pair in range(pieces.sizes[row]):
        g, kappa, first = pieces.pairs[row, pair, G], pieces.pairs[row, pair, KAPPA], pair * WEIGHTS
        one, two = pieces.drives[row, 2 * pair, source], pieces.drives[row, 2 * pair + 1, source]
        size = given.steepest[source, 1] * rest
        if pieces.pairs[row, pair, KIND] != SWINGING:
            size += abs(given.values[source, 0])
        of_a = size * (abs(one) * rest * (1.0 + 2.0 * g * rest) + abs(two) * 0.5 * rest * rest)
        of_b = size * (abs(two) * rest + abs(one) * kappa * 0.5 * rest * rest)
        weight_a, weight_b = pieces.weights[row, functional, first], pieces.weights[row, functional, first + 1]
        for level in range(1, LEVELS + 1):
            through = abs(weight_a * one + weight_b * two)  # by the level before
            if level > 1:
                motion.limits[level - 2] += through * size
            for higher in range(level + 1, LEVELS + 1):
                motion.limits[higher - 2] += through * given.steepest[source, higher - level]
            weight_a, weight_b = -kappa * weight_b, weight_a - 2.0 * g * weight_b
            if level > 1:
                motion.limits[level - 2] += abs(weight_a) * of_a + abs(weight_b) * of_b


@kernel
def derive(pieces, row, functional, levels, sized, frequencies, lane, motion):  # type: ignore[no-untyped-def]
    """Write a functional and its first derivatives, as many in all as `levels`, and sizes of the terms of the first.

    The sizes are as many as `sized`.
    """
    for level in range(levels):
        motion.levels[level] = pieces.constants[row, functional, level]
    for pair in range(pieces.sizes[row]):
        a, b, first = motion.now[2 * pair], motion.now[2 * pair + 1], pair * WEIGHTS
        for level in range(levels):
            place = first + 2 * level
            one, two = pieces.weights[row, functional, place], pieces.weights[row, functional, place + 1]
            motion.levels[level] += one * a + two * b
    for wave in range(frequencies.shape[1]):
        real, imaginary = pieces.swings[row, functional, 2 * wave], pieces.swings[row, functional, 2 * wave + 1]
        rate, cosine, sine = frequencies[lane, wave], motion.turns[2 * wave], motion.turns[2 * wave + 1]
        for level in range(levels):
            motion.levels[level] += real * cosine - imaginary * sine
            real, imaginary = -rate * imaginary, rate * real
    for source in range(motion.given.functions.shape[0]):
        place = source * (LEVELS + 1)
        for level in range(levels):
            for order in range(level + 1):
                weight = pieces.direct[row, functional, place + level - order]
                motion.levels[level] += weight * motion.given.values[source, order]
    _size(pieces, row, functional, sized, frequencies, lane, motion)


@kernel
def _size(pieces, row, functional, sized, frequencies, lane, motion):  # type: ignore[no-untyped-def]
    """Write the sizes of the terms of a functional and its first derivatives."""
    for level in range(sized):
        motion.sizes[level] = abs(pieces.constants[row, functional, level])
    for pair in range(pieces.sizes[row]):
        a, b, first = abs(motion.now[2 * pair]), abs(motion.now[2 * pair + 1]), pair * WEIGHTS
        rounded = b + pieces.pairs[row, pair, NATURAL] * a  # a rate that has come to 0 is rounding of the latter
        for level in range(sized):
            place = first + 2 * level
            one, two = pieces.weights[row, functional, place], pieces.weights[row, functional, place + 1]
            motion.sizes[level] += abs(one) * a + abs(two) * (rounded if level > 0 else b)
    for wave in range(frequencies.shape[1]):
        real, imaginary = pieces.swings[row, functional, 2 * wave], pieces.swings[row, functional, 2 * wave + 1]
        rate, cosine, sine = frequencies[lane, wave], motion.turns[2 * wave], motion.turns[2 * wave + 1]
        for level in range(sized):
            motion.sizes[level] += abs(real * cosine) + abs(imaginary * sine)
            real, imaginary = rate * imaginary, rate * real
    for source in range(motion.given.functions.shape[0]):
        place = source * (LEVELS + 1)
        for level in range(sized):
            for order in range(level + 1):
                weight = pieces.direct[row, functional, place + level - order]
                motion.sizes[level] += abs(weight) * FITTED * motion.given.steepest[source, order]


@kernel
def carry_error(pieces, row, functional, error, motion):  # type: ignore[no-untyped-def]
    """Carry a small difference of displacements and velocities to where a motion is; return how it moves a functional.

    Pairs are left in the memory of those at the beginning of the motion.
    """
    moved, pairs = 0.0, motion.begin
    pairs[:] = 0.0
    _into(pieces, row, error, pairs)
    for pair in range(pieces.sizes[row]):
        a, b = pairs[2 * pair], pairs[2 * pair + 1]
        a, b = carry(pieces.pairs, row, pair, 0.0, a, b, motion.responses)
        pairs[2 * pair], pairs[2 * pair + 1] = a, b
        place = pair * WEIGHTS
        moved += pieces.weights[row, functional, place] * a + pieces.weights[row, functional, place + 1] * b
    error[:] = 0.0
    out_of(pieces, row, 1.0, pairs, error)
    return moved


@kernel
def take_state(pieces, row, frequencies, motion, state):  # type: ignore[no-untyped-def]
    """Write displacements and velocities, of bodies and, as far as there is room, of points."""
    for entry in range(state.shape[0]):
        total = pieces.offset[row, entry]
        for wave in range(frequencies.shape[1]):
            total += pieces.waves[row, entry, 2 * wave] * motion.turns[2 * wave]
            total -= pieces.waves[row, entry, 2 * wave + 1] * motion.turns[2 * wave + 1]
        state[entry] = total
    out_of(pieces, row, 1.0, motion.now, state)


@kernel
def root_of_parabola(value, slope, curve):  # type: ignore[no-untyped-def]
    """Return a time that is close to the first root of a parabola that is negative at 0, and not later.

    Where it is steep, the root is not taken: 1/(s + sqrt(s² + x)) is no less than 1/(2 s + x/(2 s)).
    """
    if curve <= 0.0:
        return -value / slope
    if slope > 0.0 and slope * slope > -value * curve:
        return -value * slope / (slope * slope - 0.5 * curve * value)
    root = math.sqrt(slope * slope - 2.0 * curve * value)
    return -2.0 * value / (slope + root) if slope > 0.0 else (root - slope) / curve


@kernel
def safe_time(sign, value, longest, motion):  # type: ignore[no-untyped-def]
    """Return a time for which a functional surely stays negative, from its value, which is not above 0, by its sign.

    It need not be better than a longest time.

    Its second derivative is nowhere larger than a bound: the first root of the parabola that follows is such a time.
    From there on parabolas lead towards the root of its Taylor polynomial with the bound of the next derivative, which
    is above it with all derivatives.
    """
    slope, most_bend = sign * motion.levels[1], motion.limits[0]
    if most_bend == 0.0:
        return -value / slope if slope > 0.0 else math.inf
    two, three, four = sign * motion.levels[2], sign * motion.levels[3], sign * motion.levels[4]
    most_third, most = motion.limits[1] / 3.0, motion.limits[LIMITS - 1] / 6.0
    time = -value / slope if slope > 0.0 else math.inf
    curve = min(two + time * most_third, most_bend)
    time = root_of_parabola(value, slope, curve if slope > 0.0 else most_bend)
    for _ in range(APPROACHES):  # sums in pairs, which a processor adds at once
        square = time * time
        here = (value + time * slope) + square * (
            (0.5 * two + time * (three / 6.0)) + square * (four / 24.0 + time * (most / 20.0))
        )
        if here >= 0.0 or time >= longest:
            break
        rise = (slope + time * two) + square * ((0.5 * three + time * (four / 6.0)) + square * (0.25 * most))
        bend = (two + time * three) + square * (0.5 * four + time * most)
        curve = min(bend + time * most_third, most_bend)  # as large at most for as long again, of what it adds
        more = root_of_parabola(here, rise, curve) if rise > 0.0 or curve > 0.0 else time
        if more < CLOSE * time:
            return time + more
        time += min(more, time)
    return time
