"""Free bodies that collide, without noise: closed forms and published numbers."""

import math
import warnings

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.optimize import brentq, fsolve
from scipy.special import gamma

import impactlab as il

BALL = il.LinearOscillator(mass=1.0, damping=0.0, stiffness=0.0)
PLAIN = il.ExactFlow(measured=False)


def row(law, number):
    """Touching balls of 1 kg in a row."""
    names = [f"ball {k}" for k in range(number)]
    contacts = {f"contact {k}": il.Contact(names[k], names[k + 1], law) for k in range(number - 1)}
    return il.Network(dict.fromkeys(names, BALL), contacts)


def motion(network, duration, step, **initial):
    """Times, displacements and velocities of every step."""
    record = il.Trajectory(step)
    result = il.simulate(network, duration, step=step, initial=initial, integrator=PLAIN, record=record)
    return result.time.values, result.displacement.values[0], result.velocity.values[0]


def duration_of_contact(law, exponent, steps):
    """Duration over that of ``κ δⁿ`` between two balls of 1 kg at 1 m/s; steps a contact, or None for the default.

    ``T_c = 2 √π Γ(1 + q)/Γ(q + ½) δ_max/v`` with ``q = 1/(n + 1)``.
    """
    mass, q = 0.5, 1.0 / (exponent + 1.0)
    deepest = ((exponent + 1.0) * mass / (2.0 * law.stiffness)) ** q
    expected = 2.0 * math.sqrt(math.pi) * gamma(1.0 + q) / gamma(q + 0.5) * deepest
    start = {"displacement": {"ball 0": -0.02}, "velocity": {"ball 0": 1.0}}
    network = row(law, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.AccuracyWarning)  # the energy after a collision that no step hits
        plan = il.simulate(network, 0.1, initial=start, integrator=il.ExactFlow()) if steps is None else None
    step = expected / steps if plan is None else plan.attrs["step"]
    times, x, v = motion(network, 0.02 + 1.5 * expected, step, **start)
    ends = CubicHermiteSpline(times, x[:, 0] - x[:, 1], v[:, 0] - v[:, 1]).roots(extrapolate=False)
    ends = ends[ends > 0.5 * 0.02]
    assert ends.size == 2
    return np.ptp(ends) / expected


LAWS = [
    (il.LinearContact(1000.0), 1.0),
    (il.HertzContact(1000.0), 1.5),
    (il.PowerLawContact(1000.0, exponent=3.0), 3.0),
]


@pytest.mark.full
@pytest.mark.parametrize(("law", "exponent"), LAWS)
def test_duration_of_a_contact(law, exponent):
    assert duration_of_contact(law, exponent, 200.3) == pytest.approx(1.0, abs=1e-6)
    assert duration_of_contact(law, exponent, None) == pytest.approx(1.0, abs=1e-3)


def test_constant_of_hertz():
    """The duration of a Hertzian contact as books print it: 2.943275 δ_max/v."""
    assert 2.0 * math.sqrt(math.pi) * gamma(1.4) / gamma(0.9) == pytest.approx(2.943275, abs=1e-6)


@pytest.mark.parametrize(
    ("law", "velocities"),
    [
        (il.HertzContact(1.0), [-0.07095, 0.07640, 0.99455]),
        (il.LinearContact(1.0), [-0.13026, 0.15023, 0.98003]),
    ],
)
def test_three_touching_balls(law, velocities):
    """The first comes with 1 m/s: not the last alone leaves."""
    found = motion(row(law, 3), 40.0, 0.00625, velocity={"ball 0": 1.0})[2][-1]
    np.testing.assert_allclose(found, velocities, rtol=0.0, atol=6e-6)  # 5 digits, and 1e-6 of the step


def solitary_speed():
    """Speed of the solitary wave of ``δ^(3/2)`` over F_max^(1/6), in balls a second for unit mass and stiffness.

    A wave ``δ(n − V t)`` obeys ``V² δ = Λ * δ^(3/2)`` with the triangle Λ of base 2 (English and Pego,
    Proc. AMS 133, 2005), solved by Petviashvili's iteration.
    """
    points, width = 4000, 20.0  # with kinks of the triangle at points
    n = (np.arange(points) - points // 2) * width / points
    triangle = np.fft.rfft(np.fft.ifftshift(np.maximum(1.0 - np.abs(n), 0.0))) * width / points
    wave = np.exp(-(n**2))
    for _ in range(60):
        mapped = np.fft.irfft(triangle * np.fft.rfft(np.maximum(wave, 0.0) ** 1.5), points)
        wave = mapped * (wave @ wave / (wave @ mapped)) ** 3
    return 1.0 / float(wave.max()) ** 0.25  # V = 1: F_max^(1/6) is δ_max^(1/4)


def test_solitary_wave_of_a_chain():
    """Nesterenko's wave, 0.90552 F_max^(1/6); it is known as 0.9056."""
    times, x, _ = motion(row(il.HertzContact(1.0), 70), 90.0, 0.05, velocity={"ball 0": 1.0})
    forces = np.maximum(x[:, :-1] - x[:, 1:], 0.0) ** 1.5
    peaks = []
    for contact in (30, 60):
        top = int(forces[:, contact].argmax())
        about = slice(top - 5, top + 6)
        curve = CubicSpline(times[about], forces[about, contact])
        turns = curve.derivative().roots(extrapolate=False)
        moment = turns[np.abs(turns - times[top]).argmin()]
        peaks.append((moment, curve(moment)))
    (first, _), (last, force) = peaks
    speed = (60 - 30) / (last - first) / force ** (1.0 / 6.0)
    assert speed == pytest.approx(solitary_speed(), rel=1e-6)
    assert speed == pytest.approx(0.9056, abs=1e-4)


# a ball on a table that vibrates, in coordinates of the table

GRAVITY, FREQUENCY, RESTITUTION, STEPS = 9.81, 2.0 * math.pi, 0.8, 400
STICKY = math.pi * (1.0 - RESTITUTION) / (1.0 + RESTITUTION)
"""Least acceleration of the table (over gravity) of one bounce a period."""
DOUBLING = 2.0 * (1.0 + RESTITUTION**2) / (1.0 + RESTITUTION) ** 2
"""Sine of the phase, times the acceleration over gravity, at which the period doubles: the determinant is e²."""


def bounce(acceleration, time, velocity):
    """Time of the next impact and velocity after it, of a ball that leaves the table, and its greatest height."""
    amplitude = acceleration * GRAVITY / FREQUENCY**2
    start = amplitude * math.sin(FREQUENCY * time)

    def gap(flight):
        ball = start + velocity * flight - 0.5 * GRAVITY * flight**2
        return ball - amplitude * math.sin(FREQUENCY * (time + flight))

    flight = brentq(gap, 1.6 * velocity / GRAVITY, 2.6 * velocity / GRAVITY, xtol=1e-15)
    table = amplitude * FREQUENCY * math.cos(FREQUENCY * (time + flight))
    after = (1.0 + RESTITUTION) * table - RESTITUTION * (velocity - GRAVITY * flight)
    return time + flight, after, start + velocity**2 / (2.0 * GRAVITY)


def heights(acceleration, bounces, time, velocity):
    """Greatest height of each flight in the laboratory, by the energy of the ball between its impacts."""
    amplitude = acceleration * GRAVITY / FREQUENCY**2
    shaking = il.Harmonic(amplitude=amplitude * FREQUENCY**2, frequency=FREQUENCY, phase=FREQUENCY * time)
    loads = {
        "weight": il.Source(il.ConstantForce(load=-GRAVITY), on="ball"),
        "shaking": il.Source(shaking, on="ball"),
    }
    contact = il.Contact(il.WALL, "ball", il.RigidContact(restitution=RESTITUTION))
    network = il.Network({"ball": BALL}, {"table": contact}, loads)
    start = {"velocity": {"ball": velocity - amplitude * FREQUENCY * math.cos(FREQUENCY * time)}}
    times, x, v = motion(network, float(bounces), 1.0 / STEPS, **start)
    phase = FREQUENCY * (times + time)
    table, moving = amplitude * np.sin(phase), amplitude * FREQUENCY * np.cos(phase)
    height = x[:, 0] + table + (v[:, 0] + moving) ** 2 / (2.0 * GRAVITY)
    impacts = np.flatnonzero(np.abs(np.diff(height)) > 1e-9) + 1
    return height, impacts


def orbit(acceleration):
    """Phase and velocity of one bounce a period: cos φ = π (1 − e)/(1 + e) over the acceleration; v = g T/2."""
    return math.acos(STICKY / acceleration) / FREQUENCY, 0.5 * GRAVITY


def flights(acceleration, bounces, time, velocity):
    """Height of every flight, one an impact."""
    height, impacts = heights(acceleration, bounces, time, velocity)
    middles = (np.concatenate([[0], impacts[:-1]]) + impacts) // 2
    return height[middles]


@pytest.mark.campaign
def test_one_bounce_a_period_of_the_table():
    """The height and, from either side, the acceleration at which the period doubles."""
    limit = math.hypot(STICKY, DOUBLING)
    time, velocity = orbit(0.95 * limit)
    found = flights(0.95 * limit, 60, time + 1e-3, velocity)
    start = 0.95 * limit * GRAVITY / FREQUENCY**2 * math.sin(FREQUENCY * time)
    assert found[-5:] == pytest.approx(start + GRAVITY / 8.0, rel=1e-6)
    beyond = []
    for acceleration in (0.99 * limit, 1.01 * limit):
        time, velocity = orbit(acceleration)
        steps = np.diff(flights(acceleration, 20, time + 1e-4, velocity))
        before = np.stack([steps[1:-1], -steps[:-2]], axis=1)
        trace, determinant = np.linalg.lstsq(before, steps[2:], rcond=None)[0]
        assert determinant == pytest.approx(RESTITUTION**2, rel=1e-3)
        beyond.append(trace + 1.0 + RESTITUTION**2)  # 0 where the multiplier is -1
    inside, outside = beyond
    assert inside > 0.0 > outside
    assert 0.99 + 0.02 * inside / (inside - outside) == pytest.approx(1.0, abs=1e-4)


def alternating(acceleration):
    """Time and velocity of an impact of two bounces in two periods, the second of which is as high as no first one."""

    def twice(state):
        once = bounce(acceleration, *state)
        again = bounce(acceleration, *once[:2])
        return np.array(again[:2]) - np.array([state[0] + 2.0, state[1]])

    time, velocity = orbit(acceleration)
    return fsolve(twice, (time + 0.03, velocity * 1.02), xtol=1e-13)


def change(acceleration, time, velocity):
    """Change of the time and the velocity of the next impact with those of the one before, and these."""
    after, gained, _ = bounce(acceleration, time, velocity)
    flight, speed = after - time, acceleration * GRAVITY / FREQUENCY
    begun, met = (speed * math.cos(FREQUENCY * moment) for moment in (time, after))
    longer = -np.array([begun - met, flight]) / (velocity - GRAVITY * flight - met)  # of the flight
    later = longer + np.array([1.0, 0.0])
    bent = -(1.0 + RESTITUTION) * speed * FREQUENCY * math.sin(FREQUENCY * after)
    faster = bent * later + RESTITUTION * (GRAVITY * longer - np.array([0.0, 1.0]))
    return np.array([later, faster]), (after, gained)


def trace_of_two(acceleration):
    """Trace of the map over two impacts about two bounces in two periods; its determinant is e⁴."""
    first, state = change(acceleration, *alternating(acceleration))
    both = change(acceleration, *state)[0] @ first
    assert np.linalg.det(both) == pytest.approx(RESTITUTION**4)
    return float(np.trace(both))


@pytest.mark.campaign
def test_limit_of_two_bounces_in_two_periods_of_the_table():
    """The acceleration at which the period doubles again, from either side, against the map of flights."""
    doubling, determinant = math.hypot(STICKY, DOUBLING), RESTITUTION**4
    limit = brentq(lambda a: trace_of_two(a) + 1.0 + determinant, 1.02 * doubling, 1.3 * doubling)
    beyond = []
    for acceleration in (0.998 * limit, 1.002 * limit):
        time, velocity = alternating(acceleration)
        steps = np.diff(flights(acceleration, 40, time + 1e-6, velocity)[::2])
        before = np.stack([steps[1:-1], -steps[:-2]], axis=1)
        trace, found = np.linalg.lstsq(before, steps[2:], rcond=None)[0]
        assert found == pytest.approx(determinant, rel=1e-3)
        beyond.append(trace + 1.0 + determinant)
    inside, outside = beyond
    assert inside > 0.0 > outside
    assert 0.998 + 0.004 * inside / (inside - outside) == pytest.approx(1.0, abs=5e-5)


@pytest.mark.campaign
def test_two_bounces_in_two_periods_of_the_table():
    """Heights beyond the doubling against the map of flights, to four digits."""
    acceleration = 1.04 * math.hypot(STICKY, DOUBLING)
    state = alternating(acceleration)
    first = bounce(acceleration, *state)
    second = bounce(acceleration, *first[:2])
    assert abs(first[2] - second[2]) > 0.05
    found = flights(acceleration, 120, state[0] + 1e-3, state[1])
    assert sorted(found[-2:]) == pytest.approx(sorted([first[2], second[2]]), rel=1e-4)
