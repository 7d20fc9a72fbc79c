"""Means over [0, T] whatever the start, forces and intensities that vary in time, static loads, runs without noise."""

import math
import warnings

import numpy as np
import pytest
from impactlab_numerics.laws.excitations import Blasts
from scipy.integrate import simpson, solve_ivp, trapezoid
from scipy.linalg import expm, solve_continuous_lyapunov

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.given_functions import (
    NODES,
    PANELS,
    PLACES,
    irregular_times,
    joined,
    looked_at,
    mean_and_slope,
    resolving_step,
)
from impactlab.linear.transitions import response_to_force

BODY = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
NAMES = ("mean_displacement", "mean_square_displacement", "mean_velocity", "mean_square_velocity")


class Square(il.Excitation):
    """A force that jumps."""

    cycle: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def force(time, cycle):
        return 1.0 if time / cycle - math.floor(time / cycle) < 0.5 else -1.0


class Impulse(il.Excitation):
    """A short force."""

    length: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def force(time, length):
        return math.exp(-(((time - 7.3) / length) ** 2)) / length


class Restless(il.Excitation):
    """A force that is smooth at no scale of time."""

    @staticmethod
    def force(time):
        return math.sin(1e15 * time * time)


class Swelling(il.Excitation):
    """White noise that comes and goes."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    depth: float = il.parameter(minimum=0.0, maximum=1.0)

    @staticmethod
    def intensity(time, level, depth):
        return level * (1.0 + depth * math.cos(2.0 * math.pi * time))


class Gust(il.Excitation):
    """White noise for a moment."""

    length: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def intensity(time, length):
        return math.exp(-(((time - 5.3) / length) ** 2))


def alone(excitation=None, body=BODY):
    return il.Network({"a": body}, {}, {} if excitation is None else {"a": excitation})


def linear_means(drift, start, growth, duration):
    """Mean of the state and of its squares over [0, T] under white noise, by matrix exponentials."""
    times = np.linspace(0.0, duration, 4001)
    flow, half = np.eye(len(drift)), expm(drift * times[1])
    law = solve_continuous_lyapunov(drift, -np.diag(growth))
    mean, square = [], []
    for _ in times:
        mean.append(flow @ start)
        square.append(mean[-1] ** 2 + np.diag(law - flow @ law @ flow.T))
        flow = half @ flow
    return tuple(trapezoid(item, times, axis=0) / duration for item in (mean, square))


def assert_near(found, expected, share, errors=4.0):
    """Values of one body within a share of their root mean squares and some standard errors."""
    for name, value in expected.items():
        scale = abs(value)
        if name in ("mean_displacement", "mean_velocity"):
            scale = math.sqrt(expected[f"mean_square_{name.removeprefix('mean_')}"])
        error = float(np.nan_to_num(found[f"{name}_standard_error"][0]))
        assert abs(float(found[name][0]) - value) <= share * scale + errors * error, name


# starts


@pytest.mark.parametrize(("start", "duration"), [((2.0, -1.0), 20.0), ((5.0, 0.0), 10.0), ((0.0, 10.0), 5.0)])
@pytest.mark.parametrize("step", [None, 0.1])
def test_means_from_a_given_start_are_over_the_duration(start, duration, step):
    density = 0.2 / np.pi
    mean, square = linear_means(
        np.array([[0.0, 1.0], [-1.0, -0.2]]), np.array(start), [0.0, 2.0 * np.pi * density], duration
    )
    initial = {"displacement": {"a": start[0]}, "velocity": {"a": start[1]}}
    ds = il.simulate(alone(il.WhiteNoise(density)), duration, realizations=4096, initial=initial, step=step, rng=1)
    assert_near(ds, dict(zip(NAMES, [mean[0], square[0], mean[1], square[1]], strict=True)), 5e-4)


@pytest.mark.full
@pytest.mark.parametrize("integrator", [il.ExactFlow(), il.RungeKutta4()])
@pytest.mark.parametrize("duration", [1.0, 10.0])
def test_a_free_decay(integrator, duration):
    mean, square = linear_means(np.array([[0.0, 1.0], [-1.0, -0.2]]), np.array([1.0, 0.0]), [0.0, 0.0], duration)
    start = {"displacement": {"a": 1.0}}
    ds = il.simulate(alone(), duration, initial=start, integrator=integrator)
    share = 5e-4 if integrator == il.ExactFlow() else 2e-3  # Simpson's rule, trapezoidal rule
    assert_near(ds, dict(zip(NAMES, [mean[0], square[0], mean[1], square[1]], strict=True)), share)


@pytest.mark.full
def test_a_start_of_bodies_on_a_stiff_coupling():
    """They move jointly; odd numbers of steps and batches of unlike length."""
    coupling = il.Coupling("a", "b", il.LinearCoupling(20.0, damping=4.0))
    wall = il.Contact("a", il.WALL, il.HertzContact(10.0), clearance=50.0)
    network = il.Network({"a": BODY, "b": BODY}, {"far": wall}, {}, {"s": coupling})
    stiffness, damping = np.array([[21.0, -20.0], [-20.0, 21.0]]), np.array([[4.2, -4.0], [-4.0, 4.2]])
    drift = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]])
    mean, square = linear_means(drift, np.array([1.0, -0.5, 0.0, 2.0]), np.zeros(4), 3.0)
    initial = {"displacement": {"a": 1.0, "b": -0.5}, "velocity": {"b": 2.0}}
    ds = il.simulate(network, 3.0, initial=initial, step=3.0 / 37.0)
    expected = dict(zip(NAMES, [mean[:2], square[:2], mean[2:], square[2:]], strict=True))
    for name, values in expected.items():
        np.testing.assert_allclose(ds[name], values, atol=1e-3 * np.sqrt(square.max()), err_msg=name)


@pytest.mark.full
@pytest.mark.parametrize("integrator", [il.ExactFlow(), il.RungeKutta4()])
@pytest.mark.parametrize("start", [(0.0, 1.0), (0.05, -1.0)])
def test_a_given_velocity_is_that_of_the_motion_between_kicks(start, integrator):
    """Of a body that two contacts hold from the beginning to the end, so that its motion is linear."""
    contacts = {
        "right": il.Contact("a", il.WALL, il.LinearContact(500.0), clearance=-0.5),
        "left": il.Contact(il.WALL, "a", il.LinearContact(500.0), clearance=-0.5),
    }
    drift = np.array([[0.0, 1.0], [-1001.0, -0.2]])
    mean, square = linear_means(drift, np.array(start), np.zeros(2), 1.0)
    initial = {"displacement": {"a": start[0]}, "velocity": {"a": start[1]}}
    ds = il.simulate(il.Network({"a": BODY}, contacts), 1.0, initial=initial, integrator=integrator)
    assert_near(ds, dict(zip(NAMES, [mean[0], square[0], mean[1], square[1]], strict=True)), 2e-3)


RELEASES = [
    (
        il.Network(
            {"a": il.LinearOscillator(damping=0.5, stiffness=70.0)},
            {"stop": il.Contact("a", il.WALL, il.LinearContact(1e5), clearance=0.001)},
        ),
        {"displacement": {"a": -0.1}},
        8.0,
    ),
    (
        il.Network(
            {
                "a": il.LinearOscillator(damping=0.2, stiffness=100.0),
                "b": il.LinearOscillator(mass=2.0, damping=0.3, stiffness=80.0),
            },
            {"gap": il.Contact("a", "b", il.HertzContact(1e6), clearance=0.01)},
            {"a": il.WhiteNoise(1e-7)},
        ),
        {"displacement": {"a": -0.05}, "velocity": {"a": 0.5, "b": -0.5}},
        4.0,
    ),
]


@pytest.mark.full
@pytest.mark.parametrize(("network", "start", "duration"), RELEASES, ids=["stop", "pair, weak noise"])
def test_collisions_at_the_same_times_in_all_realizations_are_measured(network, start, duration):
    """Errors at their kinks do not average out: at the steps of rules these were 1 to 12 % off."""
    fine = il.ExactFlow(measured=False)
    options = {"duration": duration, "realizations": 64, "initial": start, "rng": 1}
    expected = il.simulate(network, **options, step=2e-5, integrator=fine)
    found = il.simulate(network, **options, integrator=il.ExactFlow())
    for name in ("mean_square_displacement", "mean_square_velocity", "mean_contact_force", "contact_ratio"):
        np.testing.assert_allclose(found[name], expected[name], rtol=5e-3, err_msg=name)
        assert f"{name}_step_bias" in found
    rules = il.simulate(network, **options, integrator=fine)
    assert np.abs(rules.mean_square_velocity / expected.mean_square_velocity - 1.0).max() > 0.01


def test_contacts_from_a_given_start():
    """A body that starts inside a contact, against a solver; what is left at the automatic step is the collision's."""
    network = il.Network({"a": BODY}, {"wall": il.Contact("a", il.WALL, il.HertzContact(500.0), clearance=0.0)}, {})

    def rate(_, state):
        depth = max(state[0], 0.0)
        return [state[1], -state[0] - 0.2 * state[1] - 500.0 * depth * math.sqrt(depth)]

    times = np.linspace(0.0, 0.5, 20001)
    x, v = solve_ivp(rate, (0.0, 0.5), [0.1, 0.0], rtol=1e-10, atol=1e-12, t_eval=times).y
    depth = np.maximum(x, 0.0)
    moments = [trapezoid(item, times) / 0.5 for item in (x, x**2, v, v**2)]
    force = trapezoid(500.0 * depth**1.5, times) / 0.5
    for step, share in ((None, 8e-3), (5e-3, 3e-4)):
        ds = il.simulate(network, 0.5, initial={"displacement": {"a": 0.1}}, step=step, integrator=il.ExactFlow())
        assert_near(ds, dict(zip(NAMES, moments, strict=True)), share)
        assert float(ds.mean_contact_force[0]) == pytest.approx(force, rel=share)
        assert float(ds.contact_ratio[0]) == pytest.approx(np.mean(x > 0.0), abs=ds.step)


# given forces


@pytest.mark.full
@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0, 3.0, 6.0, 2.0 * np.pi])
@pytest.mark.parametrize("integrator", [il.ExactFlow(), il.RungeKutta4()])
def test_the_response_to_a_harmonic_force(frequency, integrator):
    periods = 2.0 * np.pi / frequency
    ds = il.simulate(
        alone(il.Harmonic(1.0, frequency=frequency)),
        40.0 * periods,
        spin_up=30.0 * periods + 60.0,
        integrator=integrator,
    )
    square = 0.5 / ((1.0 - frequency**2) ** 2 + (0.2 * frequency) ** 2)
    assert_near(ds, dict(zip(NAMES, [0.0, square, 0.0, square * frequency**2], strict=True)), 2e-3)


@pytest.mark.full
def test_a_harmonic_force_on_a_body_of_a_group():
    coupling = il.Coupling("a", "b", il.LinearCoupling(20.0, damping=4.0))
    wall = il.Contact("a", il.WALL, il.HertzContact(10.0), clearance=50.0)
    network = il.Network({"a": BODY, "b": BODY}, {"far": wall}, {"b": il.Harmonic(1.0, frequency=3.0)}, {"s": coupling})
    stiffness, damping = np.array([[21.0, -20.0], [-20.0, 21.0]]), np.array([[4.2, -4.0], [-4.0, 4.2]])
    amplitude = np.linalg.solve(stiffness - 9.0 * np.eye(2) + 3.0j * damping, [0.0, 1.0])
    duration = 30.0 * 2.0 * np.pi / 3.0
    ds = il.simulate(network, duration, spin_up=100.0)
    np.testing.assert_allclose(ds.mean_square_displacement, 0.5 * np.abs(amplitude) ** 2, rtol=2e-3)
    np.testing.assert_allclose(ds.mean_square_velocity, 4.5 * np.abs(amplitude) ** 2, rtol=2e-3)


@pytest.mark.full
def test_a_harmonic_force_on_a_group_with_a_contact():
    """No body of it is read in the middle of the flow, whichever is pushed."""
    body = il.LinearOscillator(mass=1.0, damping=0.6, stiffness=1.0)
    coupling = il.Coupling("a", "b", il.LinearCoupling(20.0, damping=1.0))
    wall = il.Contact("a", il.WALL, il.HertzContact(300.0), clearance=-0.1)
    network = il.Network({"a": body, "b": body}, {"w": wall}, {"b": il.Harmonic(2.0, frequency=1.5)}, {"s": coupling})
    stiffness, damping = np.array([[21.0, -20.0], [-20.0, 21.0]]), np.array([[1.6, -1.0], [-1.0, 1.6]])

    def rate(time, state):
        x, v = state[:2], state[2:]
        depth = max(x[0] + 0.1, 0.0)
        force = np.array([-300.0 * depth * math.sqrt(depth), 2.0 * math.sin(1.5 * time)])
        return np.concatenate([v, force - stiffness @ x - damping @ v])

    times = np.linspace(0.0, 25.0, 25001)
    y = solve_ivp(rate, (0.0, 25.0), np.zeros(4), rtol=1e-8, atol=1e-10, t_eval=times, max_step=0.02).y
    ds = il.simulate(network, 25.0, initial={})
    squares = trapezoid(y**2, times) / 25.0
    np.testing.assert_allclose(ds.mean_square_displacement, squares[:2], rtol=5e-3)
    np.testing.assert_allclose(ds.mean_square_velocity, squares[2:], rtol=5e-3)
    np.testing.assert_allclose(ds.mean_displacement, trapezoid(y[:2], times) / 25.0, atol=2e-3 * np.sqrt(squares[0]))


@pytest.mark.full
@pytest.mark.parametrize("cycle", [1.0, 3.0])
def test_a_force_that_jumps(cycle):
    body = il.LinearOscillator.from_frequency(3.0, 0.05)
    ds = il.simulate(alone(Square(cycle=cycle), body), 60.0 * cycle, spin_up=150.0)
    omega = 2.0 * np.pi * np.arange(1, 4001, 2) / cycle
    square = 8.0 / (0.5 * omega * cycle) ** 2 / ((9.0 - omega**2) ** 2 + (0.3 * omega) ** 2)
    assert float(ds.mean_square_displacement[0]) == pytest.approx(square.sum(), rel=5e-3)
    assert float(ds.mean_square_velocity[0]) == pytest.approx((square * omega**2).sum(), rel=5e-3)


@pytest.mark.full
@pytest.mark.parametrize("length", [0.01, 0.1])
def test_a_short_force_is_not_missed(length):
    body = il.LinearOscillator.from_frequency(3.0, 0.05)
    ds = il.simulate(alone(Impulse(length=length), body), 40.0, initial={})

    def rate(time, state):
        return [state[1], Impulse.force(time, length) - 9.0 * state[0] - 0.3 * state[1]]

    times = np.linspace(0.0, 40.0, 40001)
    x, v = solve_ivp(rate, (0.0, 40.0), [0.0, 0.0], rtol=1e-8, atol=1e-10, max_step=0.02, t_eval=times).y
    moments = [trapezoid(item, times) / 40.0 for item in (x, x**2, v, v**2)]
    assert_near(ds, dict(zip(NAMES, moments, strict=True)), 1e-3)


def driven(duration, **options):
    wall = il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.02)
    body = il.LinearOscillator.from_frequency(3.0, 0.05)
    network = il.Network({"a": body}, {"w": wall}, {"a": il.Harmonic(1.0, frequency=2.0 * np.pi)})
    return il.simulate(network, duration, spin_up=0.0, **options)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Averages along this path")
@pytest.mark.parametrize(
    ("duration", "measured"),
    [(256.0, False), *(pytest.param(t, True, marks=pytest.mark.campaign) for t in (256.0, 250.0))],
)
def test_a_force_in_phase_with_the_run_is_seen(duration, measured):
    """1 Hz and whole seconds: looked at in equal steps it would be 0."""
    ds = driven(duration, integrator=il.ExactFlow(measured=measured))
    assert ds.step < 0.02
    assert 0.09 < float(ds.contact_ratio[0]) < 0.11


@pytest.mark.full
@pytest.mark.parametrize("frequency", [0.05, 0.5, 5.0])
def test_a_force_that_presses_a_body_on_a_contact(frequency):
    """Slow against the contact: force and contact balance, and kicks alone would be read as motion."""
    wall = il.Contact("a", il.WALL, il.HertzContact(1e3), clearance=0.1)
    body = il.LinearOscillator(mass=1.0, damping=0.5, stiffness=1.0)
    network = il.Network({"a": body}, {"w": wall}, {"a": il.Harmonic(3.0, frequency=frequency)})
    duration = max(2.0, 4.0 * frequency) * 2.0 * np.pi / frequency
    times = np.linspace(0.0, duration, 40001)

    def rate(time, state):
        depth = max(state[0] - 0.1, 0.0)
        force = 3.0 * math.sin(frequency * time) - 1e3 * depth * math.sqrt(depth)
        return [state[1], force - state[0] - 0.5 * state[1]]

    x, v = solve_ivp(rate, (0.0, duration), [0.0, 0.0], rtol=1e-9, atol=1e-11, t_eval=times, max_step=0.02).y
    ds = il.simulate(network, duration, initial={})
    moments = [trapezoid(item, times) / duration for item in (x, x**2, v, v**2)]
    assert_near(ds, dict(zip(NAMES, moments, strict=True)), 5e-3)


@pytest.mark.parametrize("damping", [0.0, 0.3, 50.0])
def test_responses_to_forces_that_grow(damping):
    numbers = np.array([2.0]), np.array([damping]), np.array([30.0])
    solved = [
        solve_ivp(
            lambda t, z, force=force: [z[1], (force(t) - damping * z[1] - 30.0 * z[0]) / 2.0],
            (0.0, 0.7), [0.0, 0.0], rtol=1e-10, atol=1e-13, method="LSODA",
        ).y[:, -1]
        for force in (lambda t: 1.0, lambda t: 2.0 * t / 0.7 - 1.0)
    ]  # fmt: skip
    np.testing.assert_allclose(response_to_force(*numbers, 0.7)[0], np.concatenate(solved), rtol=1e-6, atol=1e-9)


def test_the_step_follows_the_size_and_the_speed_of_a_function():
    def step(excitation, end=100.0):
        return resolving_step(Model.of(alone(excitation)), 0.0, end, 10.0)

    for frequency in (0.5, 1.0, 2.0 * np.pi, 64.0 * np.pi):
        assert 0.4 < step(il.Harmonic(1.0, frequency=frequency)) * frequency < 0.8
        assert 0.4 < step(il.Harmonic(1e-9, frequency=frequency), 256.0) * frequency < 0.8
    assert step(Impulse(length=0.01)) < 0.01
    assert step(il.Harmonic(0.0, frequency=1e6)) == 10.0
    assert step(il.WhiteNoise(1.0)) == 10.0
    with pytest.raises(il.InvalidInput, match="no step resolves"):
        step(Restless())


def test_the_linear_function_of_a_step():
    mean, slope = mean_and_slope(3.0 + 0.5 * (2.0 * NODES - 1.0) + 7.0 * (3.0 * (2.0 * NODES - 1.0) ** 2 - 1.0))
    assert (mean, slope) == (pytest.approx(3.0), pytest.approx(0.5))
    times = irregular_times(-2.0, 6.0, 64)
    np.testing.assert_array_equal(np.floor((times + 2.0) * 8.0), np.arange(64))
    assert np.abs(np.exp(2.0j * np.pi * 8.0 * times).mean()) < 0.05  # a period of one part


# noise that varies


@pytest.mark.full
def test_noise_that_comes_and_goes_within_a_step():
    ds = il.simulate(alone(Swelling(1.0, depth=1.0)), 400.0, realizations=256, spin_up=100.0, rng=1)
    value, error = float(ds.mean_square_displacement[0]), float(ds.mean_square_displacement_standard_error[0])
    assert abs(value - np.pi / 0.2) < 4.0 * error < 0.1 * value


@pytest.mark.full
@pytest.mark.parametrize("length", [0.05, 0.3])
def test_a_gust(length):
    def rate(time, c):
        growth = 2.0 * np.pi * math.exp(-(((time - 5.3) / length) ** 2))
        return [2.0 * c[1], c[2] - c[0] - 0.2 * c[1], -2.0 * c[1] - 0.4 * c[2] + growth]

    times = np.linspace(0.0, 20.0, 20001)
    law = solve_ivp(rate, (0.0, 20.0), [0.0] * 3, rtol=1e-9, atol=1e-12, max_step=0.2 * length, t_eval=times).y
    ds = il.simulate(alone(Gust(length=length)), 20.0, realizations=8192, initial={}, rng=1)
    for name, row in (("displacement", 0), ("velocity", 2)):
        value, error = (float(ds[f"mean_square_{name}{end}"][0]) for end in ("", "_standard_error"))
        expected = trapezoid(law[row], times) / 20.0
        assert abs(value - expected) < 4.0 * error < 0.1 * expected


@pytest.mark.full
def test_constant_noise_as_a_function_of_time_has_the_same_moments():
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.05)
    wall = il.Contact("a", il.WALL, il.HertzContact(400.0), clearance=-0.8)
    network = il.Network({"a": body}, {"w": wall}, {"a": Swelling(0.5, depth=0.0)})
    exact = il.exact(network.replace(excitations={"a": il.WhiteNoise(0.5)})).statistics()
    ds = il.simulate(network, 100.0, realizations=1024, spin_up=40.0, rng=1)
    expected = {name: float(exact[name][0]) for name in (*NAMES, "variance_displacement")}
    assert_near(ds, expected, 1e-3, errors=3.5)


# series of cosines


@pytest.mark.full
@pytest.mark.parametrize(
    ("noise", "clearance", "stiffness"),
    [
        pytest.param(
            il.ShinozukaNoise(0.5, band=(0.0, 10.0), components=2000), -3.0, 400.0, marks=pytest.mark.campaign
        ),
        (il.ShinozukaNoise(0.5, band=(0.0, 10.0), components=2000), 0.0, 400.0),
        (il.ShinozukaNoise(5.0, band=(0.95, 1.05), components=80), -0.1, 400.0),
    ],
)
def test_moments_under_bounded_noise_do_not_depend_on_the_step(noise, clearance, stiffness):
    """With the same phases, so that what differs is the step."""
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.05)
    wall = il.Contact("a", il.WALL, il.HertzContact(stiffness), clearance=clearance)
    network = il.Network({"a": body}, {"w": wall}, {"a": noise})
    options = {"duration": 100.0, "realizations": 64, "rng": 1, "record": il.PerRealization()}
    coarse = il.simulate(network, **options)
    fine = il.simulate(network, step=coarse.step / 6.0, **options)
    for name in ("mean_square_displacement", "mean_square_velocity", "variance_displacement"):
        pairs = (coarse[f"{name}_by_realization"] - fine[f"{name}_by_realization"]).values[:, 0]
        error = pairs.std(ddof=1) / 8.0
        assert abs(pairs.mean()) < 2e-3 * float(fine[name][0]) + 3.5 * error, name
        assert error < 0.01 * float(fine[name][0])


# static loads


@pytest.mark.parametrize(("damping_ratio", "load"), [(0.3, 15.0), (0.3, 60.0)])
def test_the_variance_under_a_static_load(damping_ratio, load):
    """The mean is up to 190 standard deviations from 0."""
    body = il.LinearOscillator.from_frequency(1.0, damping_ratio)
    wall = il.Contact("a", il.WALL, il.HertzContact(3.0), clearance=-load)
    network = il.Network({"a": body}, {"w": wall}, {"a": il.WhiteNoise(2.0 * damping_ratio / np.pi)})
    ds = il.simulate(network, 100.0, realizations=512, rng=3)
    exact = il.exact(network).statistics()
    for prefix in ("", "direct_"):
        value, error = (float(ds[f"{prefix}variance_displacement{end}"][0]) for end in ("", "_standard_error"))
        expected = float(exact.variance_displacement[0])
        assert abs(value - expected) < 2e-3 * expected + 3.5 * error
        assert error < 0.02 * expected


def test_the_variance_of_a_group_under_a_static_load():
    wall = il.Contact("a", il.WALL, il.HertzContact(30.0), clearance=-60.0)
    coupling = il.Coupling("a", "b", il.LinearCoupling(5.0, damping=1.0))
    body = il.LinearOscillator(mass=1.0, damping=0.6, stiffness=1.0)
    noise = il.WhiteNoise(0.6 / np.pi)
    network = il.Network({"a": body, "b": body}, {"w": wall}, {"a": noise, "b": noise}, {"s": coupling})
    options = {"duration": 100.0, "realizations": 512, "rng": 1}
    coarse = il.simulate(network, **options)
    fine = il.simulate(network, step=coarse.step / 4.0, **options)
    difference = coarse.variance_displacement - fine.variance_displacement
    error = np.hypot(coarse.variance_displacement_standard_error, fine.variance_displacement_standard_error)
    assert (abs(difference) < 2e-3 * fine.variance_displacement + 3.5 * error).all()
    assert (error < 0.03 * fine.variance_displacement).all()


# nothing random


@pytest.mark.full
def test_a_run_without_noise_has_one_realization_and_no_errors():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ds = driven(40.0, realizations=64, record=il.PerRealization())
    assert ds.attrs["realizations"] == ds.sizes["realization"] == 1
    assert "random" in ds.attrs["deterministic"]
    for name in ("mean_square_displacement", "contact_ratio", "mean_contact_force", "peak_contact_force"):
        assert float(ds[name][0]) > 0.0
        assert np.isnan(ds[f"{name}_standard_error"]).all()
    np.testing.assert_array_equal(ds.mean_square_velocity, driven(40.0).mean_square_velocity)
    with pytest.raises(il.InvalidInput, match="realizations must be"):
        driven(1.0, realizations=0)


@pytest.mark.full
def test_bodies_that_no_noise_reaches_have_no_standard_errors():
    network = il.Network(
        {"a": BODY, "b": BODY, "c": BODY}, {}, {"a": il.Harmonic(1.0, frequency=1.0), "b": il.WhiteNoise(1.0)}
    )
    ds = il.simulate(network, 40.0, realizations=64, rng=1, integrator=il.ExactFlow(jumps=False))
    assert "deterministic" not in ds.attrs
    error = ds.direct_mean_square_velocity_standard_error
    assert np.isnan(error[0])
    assert error[1] > 0.0
    assert error[2] == 0.0


@pytest.mark.full
def test_impulses_that_begin_with_a_jump_are_equal():
    """A step in which a force jumps, at any time, has all of it: 0.3 % more or less, at random, drive a resonance."""
    amplitude, interval, decay, parts = 1650.0, 0.108061, 0.025, 64
    mass, damping, stiffness = 17.3, 23.1, 1725.0
    body = il.LinearOscillator(mass=mass, damping=damping, stiffness=stiffness)
    network = il.Network({"a": body}, excitations={"a": Blasts(amplitude, interval=interval, decay=decay)})
    result = il.simulate(network, 200.0 * interval)
    motion = [[0.0, 1.0, 0.0], [-stiffness / mass, -damping / mass, 1.0 / mass], [0.0, 0.0, -1.0 / decay]]
    part, state = expm(np.array(motion) * interval / parts), np.zeros(3)
    for _ in range(300):  # periods, until nothing of the beginning is left
        state[2], x = amplitude, [state[0]]
        for _ in range(parts):
            state = part @ state
            x.append(state[0])
    mean = simpson(x) / parts
    variance = simpson((np.array(x) - mean) ** 2) / parts
    assert result.variance_displacement.item() == pytest.approx(variance, rel=2e-3)


def test_a_jump_is_found_wherever_it_is_in_a_step():
    """And the mean over the step is right to a sixteenth of the largest error of Gauss's rule."""
    for place in np.linspace(0.0, 1.0, 1001)[1:-1]:
        assert looked_at(1.0 * (place <= PLACES))[0]
        parts = mean_and_slope(1.0 * ((np.arange(PANELS)[:, None] + NODES) / PANELS >= place))
        assert joined(*parts)[0] == pytest.approx(1.0 - place, abs=0.1 / PANELS)
    rough, least = looked_at(np.cos(0.7 * PLACES + 1.1))
    assert not rough
    assert least == np.cos(0.7 * PLACES + 1.1)[1:-1].min()
