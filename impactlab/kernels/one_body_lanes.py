"""Paths of one linear body at a rigid stop, driven by a wave, in the lanes of vectors.

Each look carries all lanes by a time for which none surely meets the stop: the first root of the parabola of the bound
of the second derivative of the gap, and from there of that of its Taylor polynomial, whose error a bound of the fourth
derivative limits. Near an impact looks converge quadratically. Cosines, sines and exponentials of a look are
polynomials, since its angle is small. A lane that rests at the stop has, in the place of its gap, the force
that would take it away.

All numbers of lanes are in one array, so that the compiler knows that they are apart; its loop over lanes has no
branches, and is made of vectors. Each lane goes on at a pace of its own, and is noted after so many strobes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from impactlab.compiling.jit import kernel, loop
from impactlab.compiling.records import Cube, Table, signature

LANES = 16
"""Lanes side by side: four vectors of four, by which the latencies of divisions and roots are hidden."""

(
    FREE_GAP, FREE_RATE, COSINE, SINE, SINCE_STROBE, RESTING, FRESH, NEAR_BY, NEAR_BY_RATE, GROWN, HITS, QUICKEST,
    PASSED, UNTIL, NOTED,
) = range(15)  # fmt: skip
"""Rows of the numbers of lanes: what the free motion adds to the gap and its rate, the wave, the time since the last
strobe, whether it rests, and has just been released; a difference of the gap and of its rate, the product of its
growths, impacts, the largest closing velocity, strobes, the strobe at which it is noted next, and how often it was."""

ROWS_OF_LANES = NOTED + 1
"""How many these are."""

LOOKS_IN_A_ROW = 4
"""Looks between which no lane is noted: one that waits for it loses two of some hundred, and to see costs a tenth of a
look."""

ANGLE, FADES = 1.5, 0.5
"""Largest angle of a look (rad), and decay in it: polynomials of degree 20 and 14 are right to rounding."""

TOUCHES = 1e-15
"""Part of the sizes of its terms up to which a gap is 0."""

AT_REST = 1e-12
"""The same for the rate of a gap."""

EVEN_PULL = 0.1
"""Part of its pull by which the acceleration may change while a bouncing ends in rest."""


class OneBody(NamedTuple):
    """The gap of one body, ``q = d + constant + real cos ωt + imaginary sin ωt``.

    Its free part obeys ``d'' + 2 g d' + (g² + w²) d = 0``.
    """

    g: float  # decay (s-1)
    w: float  # frequency of free motion (rad s-1)
    omega: float  # of the wave (rad s-1)
    constant: float  # (m)
    real: float
    imaginary: float
    restitution: float
    period: float  # from strobe to strobe (s)
    slow: float  # velocity of bounces that are not followed, as a part of the largest closing velocity


_C = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(11))
_S = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(10))
_E = tuple((-1.0) ** k / math.factorial(k) for k in range(15))
"""Coefficients of the power series of a cosine, of a sine over its angle, both by its square, and of a decay."""


@kernel
def _cosine(z):  # type: ignore[no-untyped-def]
    """Return the cosine of an angle of a look, from its square."""
    high = _C[5] + z * (_C[6] + z * (_C[7] + z * (_C[8] + z * (_C[9] + z * _C[10]))))
    return _C[0] + z * (_C[1] + z * (_C[2] + z * (_C[3] + z * (_C[4] + z * high))))


@kernel
def _sine_ratio(z):  # type: ignore[no-untyped-def]
    """Return the sine of an angle of a look over the angle, from the square of this."""
    high = _S[5] + z * (_S[6] + z * (_S[7] + z * (_S[8] + z * _S[9])))
    return _S[0] + z * (_S[1] + z * (_S[2] + z * (_S[3] + z * (_S[4] + z * high))))


@kernel
def _decay(y):  # type: ignore[no-untyped-def]
    """Return ``exp(−y)`` for y from 0 to a half."""
    high = _E[10] + y * (_E[11] + y * (_E[12] + y * (_E[13] + y * _E[14])))
    high = _E[5] + y * (_E[6] + y * (_E[7] + y * (_E[8] + y * (_E[9] + y * high))))
    return _E[0] + y * (_E[1] + y * (_E[2] + y * (_E[3] + y * (_E[4] + y * high))))


@kernel
def _root(value, slope, bend):  # type: ignore[no-untyped-def]
    """Return the first root of a parabola whose value is not above 0, and whose second derivative is."""
    square = slope * slope - 2.0 * bend * value
    root = math.sqrt(square if square > 0.0 else 0.0)
    above = root - slope if slope <= 0.0 else -2.0 * value
    below = bend if slope <= 0.0 else root + slope
    return above / below


@kernel
def _free_time(q2, q3, most, longest):  # type: ignore[no-untyped-def]
    """Return a time up to the longest for which a gap that is 0 with its rate surely opens.

    `most` bounds its fourth derivative. The third derivative of one that is just released is negative.
    """
    rising = q3 if q3 > 0.0 else 0.0
    above = -2.0 * q3 if q3 < 0.0 else (-q2 if q2 < 0.0 else 0.0)
    below = most if q3 < 0.0 else rising + most * longest
    return above / below


@kernel
def _safe_time(q, q1, q2, q3, most_bend, most_fourth):  # type: ignore[no-untyped-def]
    """Return for how long a functional surely stays negative, by bounds of its second and fourth derivatives."""
    below = q if q < 0.0 else 0.0
    time = _root(below, q1, most_bend)
    rise = q1 + time * (q2 + time * (0.5 * q3 + time * most_fourth * (1.0 / 6.0)))
    inner = 0.5 * q2 + time * (q3 * (1.0 / 6.0) + time * most_fourth * (1.0 / 24.0))
    value = below + time * (q1 + time * inner)
    return time + _root(value if value < 0.0 else 0.0, rise, most_bend)


@kernel
def _carried(g, w, time):  # type: ignore[no-untyped-def]
    """Return what becomes of a displacement and of a velocity, each as both, by free motion over some time."""
    angle = w * time
    cosine, sine, decay = _cosine(angle * angle), time * _sine_ratio(angle * angle), _decay(g * time)
    step = decay * sine
    return decay * (cosine + g * sine), -(g * g + w * w) * step, step, decay * (cosine - g * sine)


@kernel
def _turned(c, s, angle):  # type: ignore[no-untyped-def]
    """Return a cosine and a sine, turned by an angle."""
    cosine, sine = _cosine(angle * angle), angle * _sine_ratio(angle * angle)
    return c * cosine - s * sine, s * cosine + c * sine


@kernel
def _wave(real, imaginary, omega, c, s):  # type: ignore[no-untyped-def]
    """Return a wave and its rate of change."""
    return real * c + imaginary * s, omega * (imaginary * c - real * s)


@kernel
def _held(body):  # type: ignore[no-untyped-def]
    """Return constant, cosine and sine of the acceleration by which a body at rest would leave the stop."""
    g, omega = body.g, body.omega
    kappa = g * g + body.w * body.w
    real = (omega * omega - kappa) * body.real - 2.0 * g * omega * body.imaginary
    imaginary = (omega * omega - kappa) * body.imaginary + 2.0 * g * omega * body.real
    return -kappa * body.constant, real, imaginary


@kernel
def _look(body, state):  # type: ignore[no-untyped-def]
    """Carry lanes on for some looks, while they have not passed their strobes."""
    g, w, omega, e = body.g, body.w, body.omega, body.restitution
    kappa = g * g + w * w
    natural, inverse_w = math.sqrt(kappa), 1.0 / w
    longest = min(ANGLE / max(natural, omega), FADES / g if g > 0.0 else math.inf)
    held, held_real, held_imaginary = _held(body)
    swing, held_swing = math.hypot(body.real, body.imaginary), math.hypot(held_real, held_imaginary)
    small = TOUCHES * (abs(body.constant) + swing)
    held_small = TOUCHES * (abs(held) + held_swing)
    for _ in range(LOOKS_IN_A_ROW):
        for lane in range(LANES):
            d, pace = state[FREE_GAP * LANES + lane], state[FREE_RATE * LANES + lane]
            c, s = state[COSINE * LANES + lane], state[SINE * LANES + lane]
            since, rounds = state[SINCE_STROBE * LANES + lane], state[PASSED * LANES + lane]
            resting, fresh = state[RESTING * LANES + lane] > 0.0, state[FRESH * LANES + lane] > 0.0
            along, drift = state[NEAR_BY * LANES + lane], state[NEAR_BY_RATE * LANES + lane]
            runs = rounds < state[UNTIL * LANES + lane]
            constant = held if resting else body.constant
            real = held_real if resting else body.real
            imaginary = held_imaginary if resting else body.imaginary
            size = held_swing if resting else swing
            # the functional and its derivatives, and how long it surely stays negative
            z, turn = _wave(real, imaginary, omega, c, s)
            bend = -2.0 * g * pace - kappa * d
            q, q1, q2 = d + constant + z, pace + turn, bend - omega * omega * z
            q3 = -kappa * pace - 2.0 * g * bend - omega * omega * turn
            side = (pace + g * d) * inverse_w
            swinging = kappa * math.sqrt(d * d + side * side)
            most_fourth = kappa * swinging + omega**4 * size
            time = _safe_time(q, q1, q2, q3, swinging + omega * omega * size, most_fourth)
            time = _free_time(q2, q3, most_fourth, longest) if fresh else time
            left = body.period - since
            time = time if time < longest else longest
            time = time if time < left else left
            time = time if runs else 0.0
            # carry it
            one, two, three, four = _carried(g, w, time)
            d, pace = one * d + three * pace, two * d + four * pace
            along, drift = one * along + three * drift, two * along + four * drift
            c, s = _turned(c, s, omega * time)
            since += time
            # impacts, rests and releases
            z, turn = _wave(real, imaginary, omega, c, s)
            q, q1 = d + constant + z, pace + turn
            bend = -2.0 * g * pace - kappa * d
            q2 = bend - omega * omega * z
            near = held_small if resting else small + TOUCHES * abs(d)
            event = runs & (q >= -near) & ((q1 > 0.0) | (resting & (q > near)))
            strikes, released = event & (not resting), event & resting
            leaves = e * q1
            twist = natural * kappa * (abs(d) + abs(pace + g * d) * inverse_w) + omega**3 * size
            soon = 2.0 * leaves * twist < EVEN_PULL * q2 * q2 * (1.0 - e)
            quickest = state[QUICKEST * LANES + lane]
            quickest = q1 if strikes & (q1 > quickest) else quickest
            low = (q2 > 0.0) & (leaves <= body.slow * quickest) & soon
            ends = strikes & (low | (e == 0.0) | (q1 <= AT_REST * (abs(pace) + omega * size)))
            bounces = strikes & (not ends)
            turned = -e * drift + (1.0 + e) * (q2 / q1 + 2.0 * g) * along
            drift = turned if bounces else drift
            along = -e * along if bounces else along
            along, drift = 0.0 if ends else along, 0.0 if ends else drift
            moved, moving = _wave(body.real, body.imaginary, omega, c, s)
            d = 0.0 if ends else (-body.constant - moved if released else d)
            pace = 0.0 if ends else (-moving if released else (pace - (1.0 + e) * q1 if bounces else pace))
            # strobes
            passed = runs & (since >= body.period * (1.0 - 1e-15))
            length = abs(along) + abs(drift)
            inverse = 1.0 / length if length > 0.0 else 0.0
            state[GROWN * LANES + lane] *= length if passed else 1.0
            state[NEAR_BY * LANES + lane] = along * inverse if passed else along
            state[NEAR_BY_RATE * LANES + lane] = drift * inverse if passed else drift
            state[FREE_GAP * LANES + lane], state[FREE_RATE * LANES + lane] = d, pace
            even = 1.5 - 0.5 * (c * c + s * s)  # rounding does not change the size of the wave
            state[COSINE * LANES + lane] = 1.0 if passed else c * even
            state[SINE * LANES + lane] = 0.0 if passed else s * even
            state[SINCE_STROBE * LANES + lane] = 0.0 if passed else since
            state[RESTING * LANES + lane] = 1.0 if ends | (resting & (not released)) else 0.0
            state[FRESH * LANES + lane] = 1.0 if released else (0.0 if runs else state[FRESH * LANES + lane])
            state[QUICKEST * LANES + lane] = quickest
            state[HITS * LANES + lane] += 1.0 if strikes else 0.0
            state[PASSED * LANES + lane] = rounds + 1.0 if passed else rounds


@kernel
def _note(state, path, periods, noted):  # type: ignore[no-untyped-def]
    """Note the lanes that have passed their strobes; return whether all of them are done."""
    done = True
    for lane in range(LANES):
        place = int(state[NOTED * LANES + lane])
        if place == noted.shape[0]:
            continue
        if state[PASSED * LANES + lane] < state[UNTIL * LANES + lane]:
            done = False
            continue
        for row, what in enumerate((FREE_GAP, FREE_RATE, RESTING, GROWN)):
            noted[place, row, path + lane] = state[what * LANES + lane]
        state[GROWN * LANES + lane] = 1.0
        state[NOTED * LANES + lane] += 1.0
        if place + 1 < noted.shape[0]:
            state[UNTIL * LANES + lane] += periods
            done = False
    return done


def _run(body, state, periods, noted, looks, first, last):  # type: ignore[no-untyped-def]
    """Carry some groups of lanes on for so many looks, or until each is noted so often, after so many strobes each."""
    for group in range(first, last):
        own = state[group]
        for _ in range(looks // LOOKS_IN_A_ROW):
            _look(body, own)
            if _note(own, group * LANES, periods, noted):
                break


def one_body_loop() -> Callable[..., None]:
    """Return the compiled loop: (body, state, periods, noted, looks, first group, last group).

    `noted` is (time, 4, path): gap and rate of the free motion, whether it rests, and the growth of a difference.
    """
    return loop(signature(False, OneBody, Table, float, Cube, int, int, int), _run)
