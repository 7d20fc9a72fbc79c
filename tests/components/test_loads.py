"""Loads: forces of common shapes in time, against closed forms of the motion and other solvers."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import impactlab as il

MASS, FREQUENCY = 2.0, 2.0 * np.pi
BODY = il.LinearOscillator.from_frequency(FREQUENCY, mass=MASS)
SHAPES = {
    "rectangle": lambda part: 1.0,
    "half-sine": lambda part: np.sin(np.pi * part),
    "versed-sine": lambda part: 0.5 * (1.0 - np.cos(2.0 * np.pi * part)),
}


@pytest.fixture(scope="module")
def motion():
    """Displacements from rest under each load: an oscillator of its own without damping."""
    loads = {shape: il.Pulse(3.0, duration=0.3, start=0.2, shape=shape) for shape in SHAPES}
    loads["chirp"] = il.Chirp(1.5, start_frequency=1.0, end_frequency=20.0, duration=2.25)
    loads["constant"] = il.ConstantForce(-1.5)
    loads["harmonic"] = il.Harmonic(2.0, frequency=5.0, phase=0.3)
    loads["resonance"] = il.Harmonic(2.0, frequency=FREQUENCY)
    network = il.Network(dict.fromkeys(loads, BODY), {}, loads)
    return il.simulate(network, 4.0, step=0.01, initial={}, record=il.Trajectory(0.25)).displacement[0]


def of(motion, name):
    return motion.time.values, motion.sel(oscillator=name).values


@pytest.mark.parametrize("shape", SHAPES)
def test_a_pulse_moves_an_oscillator_as_duhamel_s_integral_says(motion, shape):
    def response(time):
        push = lambda at: 3.0 * SHAPES[shape]((at - 0.2) / 0.3) * np.sin(FREQUENCY * (time - at))  # noqa: E731
        end = min(time, 0.5)
        return quad(push, 0.2, end, epsabs=1e-13)[0] / (MASS * FREQUENCY) if end > 0.2 else 0.0

    times, found = of(motion, shape)
    np.testing.assert_allclose(found, [response(time) for time in times], atol=1e-7 * np.abs(found).max())


def test_a_constant_force_shifts_the_oscillation(motion):
    times, found = of(motion, "constant")
    rest = -1.5 / (MASS * FREQUENCY**2)
    np.testing.assert_allclose(found, rest * (1.0 - np.cos(FREQUENCY * times)), atol=1e-7 * abs(rest))


def test_a_harmonic_force(motion):
    """The forced oscillation and the free one that it starts; in resonance they grow together."""
    times, found = of(motion, "harmonic")
    amplitude = 2.0 / (MASS * (FREQUENCY**2 - 5.0**2))
    free = np.sin(0.3) * np.cos(FREQUENCY * times) + 5.0 / FREQUENCY * np.cos(0.3) * np.sin(FREQUENCY * times)
    np.testing.assert_allclose(found, amplitude * (np.sin(5.0 * times + 0.3) - free), atol=1e-7)
    times, found = of(motion, "resonance")
    angle = FREQUENCY * times
    expected = (np.sin(angle) - angle * np.cos(angle)) / (MASS * FREQUENCY**2)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_a_chirp_that_ends(motion):
    def slope(time, y):
        force = 1.5 * np.sin(time + 19.0 * time**2 / 4.5) if time <= 2.25 else 0.0
        return [y[1], force / MASS - FREQUENCY**2 * y[0]]

    times, found = of(motion, "chirp")
    first = solve_ivp(slope, (0.0, 2.25), [0.0, 0.0], t_eval=times[times <= 2.25], rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(found[times <= 2.25], first[0], atol=1e-6 * np.abs(found).max())
    rest = solve_ivp(slope, (2.25, 4.0), first[:, -1], t_eval=times[times > 2.25], rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(found[times > 2.25], rest[0], atol=1e-6 * np.abs(found).max())


def test_a_harmonic_force_acts_in_the_spin_up():
    """So that the motion is steady at time 0."""
    body = il.LinearOscillator(mass=MASS, damping=4.0, stiffness=30.0)
    network = il.Network({"a": body}, {}, {"a": il.Harmonic(3.0, frequency=4.0, phase=np.pi / 2)})
    paths = il.simulate(network, 2.0, step=0.01, spin_up=30.0, record=il.Trajectory(0.1)).displacement[0, :, 0]
    response = 3.0 / (30.0 - MASS * 16.0 + 16.0j)
    expected = np.real(response * np.exp(4.0j * paths.time.values))
    np.testing.assert_allclose(paths.values, expected, atol=1e-6 * np.abs(response))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: il.Harmonic(1.0, frequency=0.0), r"Harmonic.frequency must be larger than 0 rad s-1, not 0.0"),
        (lambda: il.Chirp(1.0, start_frequency=1.0, end_frequency=2.0, duration=0.0), r"Chirp.duration must be larger"),
        (lambda: il.Pulse(1.0, duration=-1.0), r"Pulse.duration must be larger than 0 s, not -1.0"),
        (lambda: il.Pulse(1.0, duration=1.0, shape="half-sin"), r"There is no shape of a pulse 'half-sin'; did you"),
        (lambda: il.Pulse(1.0, duration=1.0, shape=2), r"Pulse.shape must be a string, not 2"),
        (lambda: il.ConstantForce(np.inf), r"ConstantForce.load must be a finite number, not inf"),
    ],
)
def test_bad_load(make, message):
    with pytest.raises(il.InvalidInput, match=message):
        make()
