"""The motion between events and the events, against closed forms and independent solutions."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.kernels.contact_states import CLOSED, HELD, OPEN
from impactlab.kernels.from_event_to_event import Span
from impactlab.located.course import Course
from impactlab.located.scenes import linear_of

EXACT = il.EventLocated()


def course_of(network, duration, x=(), v=(), interval=0.0, samples=0, tolerance=1e-10):
    """Run a network from a state, and keep its events."""
    model = Model.of(network)
    scene = linear_of(model)
    bodies = scene.mass.shape[1]
    start = [np.array([values]) if len(values) else np.zeros((1, bodies)) for values in (x, v)]
    times = interval * np.arange(samples)[None]
    course = Course(scene, *start, np.zeros(1), np.array([duration]), times, Span(tolerance, True), logged=True)
    course.run(lambda lane, contact: model.contacts.names[contact])
    return course


def falling(restitution=0.9, height=1.0, **fields):
    """A ball above the ground, which is at 0; down is positive."""
    return il.Network(
        {"ball": il.LinearOscillator(mass=2.0)},
        {"ground": il.Contact("ball", il.WALL, il.RigidContact(restitution), clearance=height)},
        {"gravity": il.BaseMotion(il.ConstantForce(-9.81))},
        **fields,
    )


def test_a_ball_comes_to_rest_by_endlessly_many_impacts():
    course = course_of(falling(), 10.0)
    rests = course.events_of(0)[-1]
    assert rests[3] == HELD
    ends = course.lanes.contacts[0, 4, 0]  # RESTS_FROM
    assert ends == pytest.approx(math.sqrt(2.0 / 9.81) * (1.0 + 0.9) / (1.0 - 0.9), rel=1e-11)
    assert ends == pytest.approx(8.578949179, abs=5e-10)
    data = il.simulate(falling(), 10.0, initial="rest", integrator=EXACT)
    assert data.contact_ratio.item() == pytest.approx(1.0 - ends / 10.0, rel=1e-10)
    assert data.mean_contact_force.item() == pytest.approx(2.0 * 9.81, rel=1e-9)
    assert np.isnan(data.contact_rate.item())
    assert "peak_contact_force" not in data


@pytest.mark.parametrize(("power", "collisions"), [(0, 3), (1, 31), (2, 314), (3, 3141), (4, 31415)])
def test_collisions_count_the_digits_of_pi(power, collisions):
    network = il.Network(
        {"light": il.LinearOscillator(mass=1.0), "heavy": il.LinearOscillator(mass=100.0**power)},
        {
            "between": il.Contact("heavy", "light", il.RigidContact(1.0), clearance=1.0),
            "wall": il.Contact("light", il.WALL, il.RigidContact(1.0), clearance=1.0),
        },
    )
    course = course_of(network, 10.0, v=(0.0, 1.0))
    assert len(course.events_of(0)) == collisions


def test_the_period_of_a_soft_gap_is_that_of_the_closed_form():
    network = il.Network(
        {"a": il.LinearOscillator(stiffness=1.0)}, {"g": il.Contact("a", il.WALL, il.LinearContact(4.0), clearance=0.5)}
    )
    events = course_of(network, 40.0, x=(-1.0,)).events_of(0)
    # free: from x = 0.5 at v out to −1 and back; closed: ω² = 5 about 4·0.5/5 = 0.4
    speed, rate = math.sqrt(1.0 - 0.25), math.sqrt(5.0)
    free = 2.0 * (math.pi - math.acos(0.5))
    closings = events[events[:, 3] == CLOSED, 0]
    openings = events[events[:, 3] == OPEN, 0]
    duration = 2.0 * math.atan2(speed / rate, 0.1) / rate
    np.testing.assert_allclose(openings[:5] - closings[:5], duration, rtol=1e-12)
    np.testing.assert_allclose(np.diff(closings), free + duration, rtol=1e-12)


def test_elastic_energy_is_kept_over_many_impacts():
    network = il.Network(
        {"a": il.LinearOscillator(stiffness=1.0), "b": il.LinearOscillator(mass=3.0, stiffness=2.0)},
        {
            "soft": il.Contact("a", "b", il.LinearContact(500.0), clearance=0.1),
            "rigid": il.Contact("b", il.WALL, il.RigidContact(1.0), clearance=0.2),
        },
        couplings={"c": il.Coupling("a", "b", il.LinearCoupling(0.3))},
    )
    course = course_of(network, 3000.0, x=(1.0, -0.4), interval=10.0, samples=301)
    x, v = course.lanes.samples[0, :, :2].T, course.lanes.samples[0, :, 2:4].T
    gap = np.maximum(x[0] - x[1] - 0.1, 0.0)
    energy = 0.5 * (v[0] ** 2 + 3.0 * v[1] ** 2 + x[0] ** 2 + 2.0 * x[1] ** 2 + 0.3 * (x[0] - x[1]) ** 2)
    energy += 250.0 * gap**2
    assert len(course.events_of(0)) > 3000
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)


MASS = np.array([1.0, 0.5, 2.0])
CLEARANCES = np.array([0.1, 0.3, 0.25])


def gaps(x):
    return np.array([x[0] - x[1], x[2], -x[2]]) - CLEARANCES


def acceleration(t, x, v):
    """Of the network below, written down by hand."""
    force = np.array([-0.1, -0.3, 0.0]) * v - np.array([1.0, 3.0, 0.0]) * x
    shared = 0.4 * math.sin(2.3 * t + 0.7)
    force += [math.sin(0.8 * t), shared, -2.0 * shared]
    pull = 2.0 * (x[2] - x[1]) + 0.4 * (v[2] - v[1])
    force += [0.0, pull, -pull]
    ab, cw, wc = gaps(x)
    if ab > 0.0:
        force += [-80.0 * ab, 80.0 * ab, 0.0]
    if cw > 0.0:
        force[2] -= 40.0 * cw + 1.5 * v[2]
    if wc > 0.0:
        force[2] += 55.0 * wc
    return force / MASS


def independent(duration, state, times):
    """Path and events by DOP853, each piece between events on its own."""

    def slope(t, y):
        return np.concatenate([y[3:], acceleration(t, y[:3], y[3:])])

    events = [lambda t, y, k=contact: gaps(y[:3])[k] for contact in range(3)]
    for event in events:
        event.terminal = True
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    found, t, y, path = [], 0.0, np.array(state), np.empty((len(times), 6))
    while t < duration:
        s = solve_ivp(slope, (t, duration), y, events=events, dense_output=True, max_step=0.1, **options)
        inside = np.flatnonzero((times >= t) & (times <= s.t[-1]))
        for place in inside:
            path[place] = s.sol(times[place])
        t, y = s.t[-1], s.y[:, -1]
        if s.status == 1:
            found.append(t)
            s = solve_ivp(slope, (t, t + 1e-7), y, **options)  # off the event
            t, y = s.t[-1], s.y[:, -1]
    return path, np.array(found)


def driven():
    return il.Network(
        {
            "a": il.LinearOscillator(damping=0.1, stiffness=1.0),
            "b": il.LinearOscillator(mass=0.5, damping=0.3, stiffness=3.0),
            "c": il.LinearOscillator(mass=2.0),
        },
        {
            "ab": il.Contact("a", "b", il.LinearContact(80.0), clearance=0.1),
            "cw": il.Contact("c", il.WALL, il.KelvinVoigtContact(40.0, damping=1.5, tension=True), clearance=0.3),
            "wc": il.Contact(il.WALL, "c", il.LinearContact(55.0), clearance=0.25),
        },
        {
            "a": il.Harmonic(1.0, frequency=0.8),
            "s": il.Source(il.Harmonic(0.4, frequency=2.3, phase=0.7), on={"b": 1.0, "c": -2.0}),
        },
        {"bc": il.Coupling("b", "c", il.LinearCoupling(2.0, damping=0.4))},
    )


def test_a_driven_network_moves_as_an_independent_solver_has_it():
    times = np.linspace(0.0, 20.0, 41)
    state = [0.3, -0.2, 0.1, 0.5, -0.4, 0.2]
    path, found = independent(20.0, state, times)
    course = course_of(driven(), 20.0, state[:3], state[3:], 0.5, 41)
    assert len(found) > 20
    assert len(course.events_of(0)) == len(found)
    np.testing.assert_allclose(course.events_of(0)[:, 0], found, atol=1e-9)
    np.testing.assert_allclose(course.lanes.samples[0, :, :6], path, atol=1e-9)


def test_a_dashpot_without_tension_lets_go_where_its_force_vanishes():
    law = il.KelvinVoigtContact(100.0, damping=4.0)
    network = il.Network({"a": il.LinearOscillator()}, {"g": il.Contact("a", il.WALL, law, clearance=0.5)})
    course = course_of(network, 2.0, v=(1.0,))
    zeta = 4.0 / (2.0 * 10.0)
    restitution = math.exp(-2.0 * zeta * math.acos(zeta) / math.sqrt(1.0 - zeta**2))
    assert -course.lanes.v[0, 0] == pytest.approx(restitution, rel=1e-13)
    assert [event[3] for event in course.events_of(0)] == [CLOSED, 2.0, OPEN]


def test_a_body_rests_on_a_table_until_the_table_leaves_it():
    amplitude, frequency = 0.02, 25.0
    network = il.Network(
        {"table": il.PrescribedMotion(il.Harmonic(amplitude, frequency=frequency)), "ball": il.LinearOscillator()},
        {"g": il.Contact("table", "ball", il.RigidContact(0.0))},
        {"gravity": il.Source(il.ConstantForce(-9.81), on="ball")},
    )
    events = course_of(network, 0.5).events_of(0)
    leaves = math.asin(9.81 / (amplitude * frequency**2)) / frequency
    left = events[(events[:, 2] == HELD) & (events[:, 3] == OPEN), 0]
    assert left[0] == pytest.approx(leaves, rel=1e-12)
    speed, place = amplitude * frequency * math.cos(frequency * leaves), amplitude * math.sin(frequency * leaves)
    meets = brentq(
        lambda t: place + speed * (t - leaves) - 0.5 * 9.81 * (t - leaves) ** 2 - amplitude * math.sin(frequency * t),
        leaves + 0.05, leaves + 0.2, xtol=1e-15,
    )  # fmt: skip
    assert events[(events[:, 2] == OPEN) & (events[:, 0] > leaves), 0][0] == pytest.approx(meets, rel=1e-12)


def test_a_row_of_touching_balls_passes_an_impact_on():
    names = [f"ball_{i}" for i in range(4)]
    network = il.Network(
        {name: il.LinearOscillator() for name in names},
        {f"g{i}": il.Contact(names[i], names[i + 1], il.RigidContact(1.0)) for i in range(3)},
    )
    course = course_of(network, 2.0, x=(-1.0, 0.0, 0.0, 0.0), v=(1.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(course.lanes.v[0], [0.0, 0.0, 0.0, 1.0], atol=1e-14)
    np.testing.assert_allclose(course.lanes.x[0], [0.0, 0.0, 0.0, 1.0], atol=1e-14)


@pytest.mark.parametrize("damping", [0.0, 0.5, 2.0, 2.0000001, 5.0])
@pytest.mark.parametrize("stiffness", [0.0, 1e-9, 1.0])
def test_bodies_with_any_damping_are_carried_exactly(damping, stiffness):
    body = il.LinearOscillator(damping=damping, stiffness=stiffness)
    force = {"f": il.Source(il.ConstantForce(0.3), on="a"), "g": il.Source(il.Harmonic(0.7, frequency=1.7), on="a")}
    course = course_of(il.Network({"a": body}, {}, force), 12.0, (0.4,), (-0.2,), 0.37, 33)
    times = 0.37 * np.arange(33)
    path = solve_ivp(
        lambda t, y: [y[1], 0.3 + 0.7 * math.sin(1.7 * t) - damping * y[1] - stiffness * y[0]],
        (0.0, 12.0), [0.4, -0.2], method="DOP853", rtol=1e-13, atol=1e-14, t_eval=times,
    ).y.T  # fmt: skip
    np.testing.assert_allclose(course.lanes.samples[0, :, :2], path, rtol=1e-10, atol=1e-10)


def test_pieces_that_are_forgotten_are_made_again(monkeypatch):
    state = [0.3, -0.2, 0.1, 0.5, -0.4, 0.2]
    kept = course_of(driven(), 20.0, state[:3], state[3:])
    monkeypatch.setattr("impactlab.located.course.MEMORY", 1.0)
    again = course_of(driven(), 20.0, state[:3], state[3:])
    assert (again.made, kept.made) == (1, 6)
    np.testing.assert_array_equal(again.events_of(0), kept.events_of(0))


@pytest.mark.parametrize(
    ("duration", "allowed"), [(3e4, 1e-12), pytest.param(3.2e6, 1e-11, marks=pytest.mark.full)], ids=["1e4", "1e6"]
)
@pytest.mark.parametrize(("spring", "law"), [(0.0, il.RigidContact(1.0)), (300.0, il.LinearContact(300.0))])
def test_rounding_makes_no_energy_of_impacts_of_two_bodies(spring, law, duration, allowed):
    """Some 10⁴ and 10⁶ impacts; rounding of weights alone would make 4e-16 of the energy in each."""
    mass, stiffness = np.array([1.0, 1.7]), np.array([1.0, 2.0])
    bodies = {name: il.LinearOscillator(mass=m, stiffness=k) for name, m, k in zip("ab", mass, stiffness, strict=True)}
    network = il.Network(bodies, {"g": il.Contact("a", "b", law, clearance=0.05)})
    initial = {"displacement": {"a": -1.0, "b": 0.4}, "velocity": {"b": 0.7}}
    result = il.simulate(network, duration, initial=initial, record=il.FinalState(), integrator=EXACT)
    x, v = (result[f"final_{name}"].values.ravel() for name in ("displacement", "velocity"))

    def energy(x, v):
        return 0.5 * (mass * v**2 + stiffness * x**2).sum() + 0.5 * spring * max(x[0] - x[1] - 0.05, 0.0) ** 2

    start = energy(np.array([-1.0, 0.4]), np.array([0.0, 0.7]))
    assert result.contact_rate.item() * duration > 0.3 * duration
    assert abs(energy(x, v) / start - 1.0) < allowed
