"""Networks with smooth nonlinear forces, followed without noise: paths against independent solutions."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.kernels.from_event_to_event import EVALUATIONS, Span
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse

pytestmark = pytest.mark.full


def followed(network, duration, interval, **options):
    """Simulate by events, with a trajectory."""
    record = il.Trajectory(interval)
    return il.simulate(network, duration, record=record, integrator=il.EventLocated(), initial="rest", **options)


def solved(pieces, y, times, choose):
    """Solve an equation in pieces: `choose` names the first one, `pieces` has rates and the events that end it.

    Each piece begins and ends where an event function passes 0, so that all pieces are smooth.
    """
    y, now, result, index = np.array(y, dtype=float), 0.0, [np.array(y, dtype=float)], choose(0.0, y)
    for target in times[1:]:
        while now < target:
            rates, events = pieces[index]

            def ends(event, way):
                def function(t, state):
                    return event(t, state)

                function.terminal, function.direction = True, way
                return function

            watched = [ends(event, way) for event, way, _ in events]
            found = solve_ivp(rates, (now, target), y, method="DOP853", rtol=3e-14, atol=1e-16, events=watched)
            now, y = found.t[-1], found.y[:, -1]
            for (_, _, following), hits in zip(events, found.t_events, strict=True):
                if len(hits):
                    index = following
        result.append(y)
    return np.array(result)


def stop(law, **options):
    """Return a driven body beside a stop."""
    return il.Network(
        oscillators={"a": il.LinearOscillator(mass=1.0, damping=0.1, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, law, clearance=0.2)},
        excitations={"a": il.Harmonic(1.0, frequency=0.8)},
        **options,
    )


def of_stop(force, duration, interval):
    """Solve its motion, for a force of the indentation and its rate."""

    def rates(closed):
        def function(t, y):
            push = force(max(y[0] - 0.2, 0.0), y[1]) if closed else 0.0
            return [y[1], math.sin(0.8 * t) - 0.1 * y[1] - y[0] - push]

        return function

    gap = lambda t, y: y[0] - 0.2  # noqa: E731
    pieces = {0: (rates(False), [(gap, 1.0, 1)]), 1: (rates(True), [(gap, -1.0, 0)])}
    return solved(pieces, [0.0, 0.0], np.arange(0.0, duration + 0.5 * interval, interval), lambda t, y: 0)


@pytest.mark.parametrize(
    ("law", "force"),
    [
        (il.HertzContact(100.0), lambda d, r: 100.0 * d**1.5),
        (
            il.HuntCrossleyContact(100.0, dissipation=0.3, exponent=1.5),
            lambda d, r: 100.0 * d**1.5 * max(1.0 + 0.3 * r, 0.0),
        ),
        (il.PowerLawContact(300.0, exponent=2.0), lambda d, r: 300.0 * d**2),
    ],
)
def test_paths_at_a_stop(law, force):
    """More than 20 impacts, to 1e-9 of the amplitude, and the error said covers the true one."""
    result = followed(stop(law), 80.0, 2.0)
    wanted = of_stop(force, 80.0, 2.0)
    error = np.abs(result.displacement[0, :, 0] - wanted[:, 0]).max()
    assert result.events >= 40
    assert error < 1e-9
    assert error < result.path_error < 1e-7


def test_statistics_of_a_path():
    """Means are integrals of the path: compared with those of its samples, and forces with their balance."""
    result = followed(stop(il.HertzContact(100.0)), 200.0, 0.01)
    x, v, force = (result[name][0, :, 0].values for name in ("displacement", "velocity", "contact_force"))
    for name, path in (
        ("mean_displacement", x), ("mean_square_displacement", x**2), ("mean_square_velocity", v**2),
        ("mean_contact_force", force),
    ):  # fmt: skip
        assert float(result[name][0]) == pytest.approx(np.trapezoid(path, dx=0.01) / 200.0, rel=2e-5)
    assert float(result.contact_ratio[0]) == pytest.approx(np.mean(x > 0.2), abs=2e-4)
    closings = np.sum((x[1:] > 0.2) & (x[:-1] <= 0.2))
    assert float(result.contact_rate[0]) == pytest.approx(closings / 200.0)
    assert 0.0 <= float(result.peak_contact_force[0]) - force.max() < 1e-3 * force.max()
    # m v(T) + c x(T) + k ∫ x + ∫ F = ∫ sin 0.8 t
    momentum = v[-1] + 0.1 * x[-1] + 200.0 * float(result.mean_displacement[0])
    momentum += 200.0 * float(result.mean_contact_force[0])
    assert momentum == pytest.approx((1.0 - math.cos(160.0)) / 0.8, abs=1e-9)


@pytest.mark.filterwarnings("ignore:Rounding has grown")  # a chaotic path keeps its energy all the same
def test_energy_of_elastic_collisions_is_kept():
    """Two bodies between walls, with Hertz contacts and a Duffing spring, over some thousand collisions."""
    network = il.Network(
        oscillators={
            "one": il.DuffingOscillator(mass=1.0, damping=0.0, stiffness=1.0, cubic=3.0),
            "two": il.LinearOscillator(mass=0.3, damping=0.0, stiffness=0.5),
        },
        contacts={
            "gap": il.Contact("one", "two", il.HertzContact(1e3), clearance=0.1),
            "left": il.Contact(il.WALL, "one", il.HertzContact(1e4), clearance=0.4),
            "right": il.Contact("two", il.WALL, il.HertzContact(1e4), clearance=0.4),
        },
    )
    initial = {"displacement": {"one": -0.2}, "velocity": {"one": 1.0, "two": -2.0}}
    record = il.Trajectory(10.0)
    result = il.simulate(network, 300.0, record=record, integrator=il.EventLocated(), initial=initial)
    assert result.events > 1000

    def energy(sample):
        (x, y), (v, w) = result.displacement[0, sample].values, result.velocity[0, sample].values
        potential = 0.5 * x**2 + 0.75 * x**4 + 0.25 * y**2
        for stiffness, depth in ((1e3, x - y - 0.1), (1e4, -x - 0.4), (1e4, y - 0.4)):
            potential += 0.4 * stiffness * max(depth, 0.0) ** 2.5
        return 0.5 * v**2 + 0.15 * w**2 + potential

    energies = np.array([energy(sample) for sample in range(31)])
    assert np.abs(energies / energies[0] - 1.0).max() < 1e-10 * result.events  # the tolerance, in each event


def test_cradle_of_hertz_balls():
    """Five equal balls in a row, the first of which moves: against SciPy's solution of one smooth collision."""
    ball = il.LinearOscillator(mass=1.0, damping=0.0, stiffness=0.0)
    network = il.chain(5, ball, il.HertzContact(1e5), clearance=0.0)
    initial = {"velocity": {"body_0": 1.0}}
    result = il.simulate(
        network, 0.4, record=il.Trajectory(0.1), integrator=il.EventLocated(), initial=initial, spin_up=0.0
    )

    def rates(t, y):
        force = 1e5 * np.maximum(y[:4] - y[1:5], 0.0) ** 1.5
        pull = np.zeros(5)
        pull[:4] -= force
        pull[1:] += force
        return np.concatenate([y[5:], pull])

    start = np.zeros(10)
    start[5] = 1.0
    found = solve_ivp(rates, (0.0, 0.4), start, method="DOP853", rtol=1e-13, atol=1e-16, max_step=1e-3)
    assert np.abs(result.velocity[0, -1].values - found.y[5:, -1]).max() < 1e-9
    assert float((result.velocity[0, -1] ** 2).sum()) == pytest.approx(1.0, abs=1e-10)


def with_coupling(law):
    """Return a driven body with a coupling to the ground."""
    return il.Network(
        oscillators={"a": il.LinearOscillator(mass=1.0, damping=0.05, stiffness=1.0)},
        couplings={"c": il.Coupling(il.WALL, "a", law)},
        excitations={"a": il.Harmonic(1.0, frequency=0.8)},
    )


def test_a_law_that_relaxes():
    """A Maxwell element: its force is an equation of first order, which the path has to ten digits."""
    result = followed(with_coupling(il.MaxwellCoupling(3.0, damping=2.0)), 60.0, 2.0)

    def rates(t, y):
        x, v, force = y
        return [v, math.sin(0.8 * t) - 0.05 * v - x - force, 3.0 * v - 1.5 * force]

    times = np.arange(0.0, 61.0, 2.0)
    found = solve_ivp(rates, (0.0, 60.0), [0.0] * 3, method="DOP853", rtol=1e-13, atol=1e-15, t_eval=times)
    assert np.abs(result.displacement[0, :, 0] - found.y[0]).max() < 1e-10
    assert np.abs(result.law_state[0].sel(state="c.pull") - found.y[2]).max() < 1e-10


def test_given_states_are_where_laws_begin():
    """The force of a Maxwell element at the start, beside the extension at which it has it."""
    network = with_coupling(il.MaxwellCoupling(3.0, damping=2.0))
    initial = {"displacement": {"a": 0.1}, "state": {"c.pull": 0.7, "c.last": 0.1}}
    result = il.simulate(network, 20.0, record=il.Trajectory(2.0), integrator=il.EventLocated(), initial=initial)

    def rates(t, y):
        x, v, force = y
        return [v, math.sin(0.8 * t) - 0.05 * v - x - force, 3.0 * v - 1.5 * force]

    times = np.arange(0.0, 21.0, 2.0)
    found = solve_ivp(rates, (0.0, 20.0), [0.1, 0.0, 0.7], method="DOP853", rtol=1e-13, atol=1e-15, t_eval=times)
    assert np.abs(result.displacement[0, :, 0] - found.y[0]).max() < 1e-10


@pytest.mark.parametrize("shape", ["rectangle", "half-sine"])
def test_pulses_are_met_at_their_ends(shape):
    """A force that jumps where nothing else changes costs no accuracy."""
    network = stop(il.HertzContact(100.0)).replace(
        excitations={"a": il.Pulse(2.0, duration=0.7, start=1.3, shape=shape)}
    )
    result = followed(network, 10.0, 0.5)

    def rates(closed):
        def function(t, y):
            acts = 1.3 <= t <= 2.0
            load = 2.0 * (math.sin(math.pi * (t - 1.3) / 0.7) if shape == "half-sine" else 1.0) if acts else 0.0
            return [y[1], load - 0.1 * y[1] - y[0] - (100.0 * max(y[0] - 0.2, 0.0) ** 1.5 if closed else 0.0)]

        return function

    gap = lambda t, y: y[0] - 0.2  # noqa: E731
    pieces = {0: (rates(False), [(gap, 1.0, 1)]), 1: (rates(True), [(gap, -1.0, 0)])}
    times = np.unique(
        np.concatenate([np.arange(0.0, 10.25, 0.5), [1.3 - 1e-13, 1.3 + 1e-13, 2.0 - 1e-13, 2.0 + 1e-13]])
    )
    wanted = solved(pieces, [0.0, 0.0], times, lambda t, y: 0)
    chosen = np.isin(times, np.arange(0.0, 10.25, 0.5))
    assert np.abs(result.displacement[0, :, 0] - wanted[chosen, 0]).max() < 1e-9


def test_a_first_step_that_is_far_too_long_is_made_again():
    """Where no spring tells the longest step, the first one is a part of the run, and stages of a cube explode."""
    body = il.DoubleWellOscillator(damping=0.2, cubic=1.0, repulsion=1.0)
    begin = {"displacement": {"a": -2.0}, "velocity": {"a": -2.0}}
    options = {"integrator": il.EventLocated(), "initial": begin, "record": il.Trajectory(1.0)}
    found = il.simulate(il.Network({"a": body}), 5000.0, **options)

    def rates(time, state):
        x, v = state
        return [v, x - x**3 - 0.2 * v]

    times = found.time.values[:20]
    exact = solve_ivp(rates, (0.0, 20.0), [-2.0, -2.0], method="DOP853", rtol=1e-13, atol=1e-13, t_eval=times).y[0]
    assert np.abs(found.displacement.values.ravel()[:20] - exact).max() < 1e-9


def test_steps_near_a_rest_are_no_shorter_than_rounding_allows():
    """A body that is put where its forces balance, up to rounding, stays there, in some steps."""
    network = Smooth(Model.of(il.Network({"a": il.DoubleWellOscillator(damping=0.1, cubic=1.0, repulsion=1.0)})))
    start, nothing = np.array([[1.0 + 1e-11]]), np.zeros((1, 0))
    begin, end = np.zeros(1), np.array([1000.0])
    course = SmoothCourse([network], start, np.zeros((1, 1)), nothing, begin, end, nothing, Span(1e-10, False))
    course.run(lambda lane, contact: "")
    assert course.lanes.clock[0, EVALUATIONS] < 1e6
    assert abs(course.lanes.x.item() - 1.0) < 1e-10


def test_a_pressed_body_begins_where_forces_balance():
    body = il.LinearOscillator(damping=0.1, stiffness=1.0)
    pressed = il.Network({"a": body}, {"stop": il.Contact("a", il.WALL, il.HertzContact(10.0), clearance=-0.1)})
    found = il.simulate(pressed, 50.0, integrator=il.EventLocated(), record=il.Trajectory(5.0))
    rest = brentq(lambda x: x - 10.0 * (0.1 - x) ** 1.5, 0.0, 0.1, xtol=1e-15)
    assert found.displacement.values == pytest.approx(np.full((1, 11, 1), -rest), abs=1e-11)


def test_two_bodies_on_a_rigid_contact_begin_where_springs_balance():
    bodies = {
        "a": il.LinearOscillator(damping=0.1, stiffness=1.0),
        "b": il.LinearOscillator(damping=0.1, stiffness=3.0),
    }
    pressed = il.Network(bodies, {"stop": il.Contact("a", "b", il.RigidContact(0.8), clearance=-0.2)})
    found = il.simulate(pressed, 50.0, integrator=il.EventLocated(), record=il.Trajectory(5.0))
    assert found.displacement.values[0] == pytest.approx(np.tile([-0.15, 0.05], (11, 1)), abs=1e-12)


def test_an_error_is_never_said_to_be_nothing():
    """Steps that end at many samples are as short on the path that is compared."""
    times = np.arange(0.0, 6.0, 0.01)
    force = il.SampledForce(times, np.sin(2.0 * times))
    body = il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=0.3)
    result = followed(il.Network({"a": body}, excitations={"a": force}), 5.0, 1.0)
    assert 1e-13 < result.path_error < 1e-11


def test_a_last_sample_that_rounding_makes_late_is_taken():
    duffing = il.Network(
        {"a": il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=0.3)},
        excitations={"a": il.Harmonic(1.0, frequency=1.0)},
    )
    result = followed(duffing, 6.283185307, 2.0 * math.pi / 100)
    assert result.sizes["time"] == 101
    assert np.isfinite(result.displacement).all()
    assert result.path_error < 1e-8


def test_networks_side_by_side_are_those_alone():
    """The points of a sweep run in one call, with the bits of single runs."""
    values = [0.6, 1.0, 1.4]

    def make(amplitude):
        return stop(il.HertzContact(100.0)).replace(excitations={"a": il.Harmonic(amplitude, frequency=0.8)})

    options = {"duration": 40.0, "integrator": il.EventLocated(), "initial": "rest", "record": il.Trajectory(8.0)}
    swept = il.sweep(make, {"amplitude": values}, **options)
    for value in values:
        alone = il.simulate(make(value), **options)
        assert np.array_equal(swept.displacement.sel(amplitude=value), alone.displacement)


def test_networks_side_by_side_have_their_own_pulses():
    """Steps end where the pulses of each network begin and end."""

    def make(start):
        pulse = il.Pulse(2.0, duration=0.1, start=start, shape="rectangle")
        return stop(il.HertzContact(100.0)).replace(excitations={"a": pulse})

    options = {"duration": 20.0, "integrator": il.EventLocated(), "initial": "rest", "record": il.Trajectory(2.0)}
    swept = il.sweep(make, {"start": [0.0, 7.3]}, **options)
    for value in (0.0, 7.3):
        assert np.array_equal(swept.displacement.sel(start=value), il.simulate(make(value), **options).displacement)


def test_chaos_is_said():
    """Where the path forgets its start, its error is that of any path, with a warning."""
    network = il.Network(
        oscillators={"a": il.DuffingOscillator(mass=1.0, damping=0.05, stiffness=0.0, cubic=1.0)},
        excitations={"a": il.Harmonic(7.5, frequency=1.0)},
    )
    with pytest.warns(il.AccuracyWarning, match="Rounding has grown"):
        result = il.simulate(network, 300.0, integrator=il.EventLocated(), initial="rest")
    assert result.path_error > 0.1


def test_white_noise_is_refused():
    network = stop(il.HertzContact(100.0)).replace(excitations={"a": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match="EventLocated does not handle the excitation of"):
        il.simulate(network, 1.0, integrator=il.EventLocated())


def test_calls_that_end_early_change_no_bit(monkeypatch):
    """A run is made in calls that last some tenths of a second; shorter ones have the same numbers."""
    network = stop(il.HertzContact(100.0)).replace(
        oscillators={"a": il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=0.3)}
    )
    whole = followed(network, 300.0, 5.0)
    monkeypatch.setattr("impactlab.located.smooth_course.SECONDS_OF_CALL", 1e-5)
    parts = followed(network, 300.0, 5.0)
    assert whole.evaluations > 50_000
    assert np.array_equal(whole.displacement, parts.displacement)
    assert np.array_equal(whole.mean_contact_force, parts.mean_contact_force)
    assert whole.path_error == parts.path_error
