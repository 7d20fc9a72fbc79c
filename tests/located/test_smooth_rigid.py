"""Rigid contacts beside smooth nonlinear forces: impacts, rest and release, against independent solutions."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il

pytestmark = pytest.mark.full

EXACT = il.EventLocated()
TIGHT = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15, "max_step": 0.1}


def test_two_bodies_with_a_rigid_stop():
    """A Duffing spring, a coupling, and impacts with the wall and between the bodies: more than 20, to 1e-9."""
    network = il.Network(
        oscillators={
            "one": il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=0.5),
            "two": il.LinearOscillator(mass=0.5, damping=0.05, stiffness=0.8),
        },
        contacts={
            "between": il.Contact("one", "two", il.RigidContact(0.8), clearance=0.3),
            "stop": il.Contact("two", il.WALL, il.RigidContact(0.7), clearance=0.2),
        },
        couplings={"c": il.Coupling("one", "two", il.LinearCoupling(0.3))},
        excitations={"one": il.Harmonic(1.0, frequency=0.8)},
    )
    result = il.simulate(network, 60.0, initial="rest", record=[il.Trajectory(2.0), il.Impacts()], integrator=EXACT)

    def rates(t, y):
        x, u, v, w = y
        pull = 0.3 * (u - x)
        return [v, w, math.sin(0.8 * t) - 0.1 * v - x - 0.5 * x**3 + pull, (-0.05 * w - 0.8 * u - pull) / 0.5]

    gaps = [lambda t, y: y[0] - y[1] - 0.3, lambda t, y: y[1] - 0.2]
    for gap in gaps:
        gap.terminal, gap.direction = True, 1.0
    y, now, wanted, times = np.zeros(4), 0.0, [np.zeros(4)], []
    for target in np.arange(2.0, 61.0, 2.0):
        while now < target:
            found = solve_ivp(rates, (now, target), y, events=gaps, **TIGHT)
            now, y = found.t[-1], found.y[:, -1]
            if len(found.t_events[0]):
                impulse = 1.8 * (y[2] - y[3]) / (1.0 + 1.0 / 0.5)
                y[2], y[3] = y[2] - impulse, y[3] + impulse / 0.5
            elif len(found.t_events[1]):
                y[3] *= -0.7
            if found.status == 1:
                times.append(now)
        wanted.append(y)
    assert len(times) > 20
    assert np.abs(result.displacement[0].values - np.array(wanted)[:, :2]).max() < 1e-9
    assert np.abs(np.sort(result.impact_time.values) - times).max() < 1e-9


def test_energy_of_elastic_impacts_is_kept():
    """A ball in a smooth nonlinear well with an elastic wall: 1000 impacts."""
    network = il.Network(
        oscillators={"ball": il.DuffingOscillator(mass=1.0, damping=0.0, stiffness=1.0, cubic=2.0)},
        contacts={"ground": il.Contact(il.WALL, "ball", il.RigidContact(1.0), clearance=0.3)},
    )
    start = {"velocity": {"ball": 1.0}}
    exact = il.EventLocated(1e-12)
    result = il.simulate(network, 2900.0, initial=start, record=il.Trajectory(29.0), integrator=exact)
    x, v = result.displacement[0, :, 0].values, result.velocity[0, :, 0].values
    energy = 0.5 * v**2 + 0.5 * x**2 + 0.5 * x**4
    assert result.events > 1000
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-11


def test_a_body_rests_and_is_released():
    """Plastic impacts: the stop holds the body by the force that presses it, until this pulls."""
    network = il.Network(
        oscillators={"a": il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=0.5)},
        contacts={"stop": il.Contact("a", il.WALL, il.RigidContact(0.0), clearance=0.2)},
        excitations={"a": il.Harmonic(1.0, frequency=0.8)},
    )
    result = il.simulate(network, 100.0, initial="rest", record=[il.Trajectory(2.0), il.Impacts()], integrator=EXACT)

    def free(t, y):
        return [y[1], math.sin(0.8 * t) - 0.1 * y[1] - y[0] - 0.5 * y[0] ** 3]

    def gap(t, y):
        return y[0] - 0.2

    gap.terminal, gap.direction = True, 1.0
    holding = 0.2 + 0.5 * 0.2**3  # what the springs pull with
    held, impulses, y, now, wanted = [], [], np.zeros(2), 0.0, []
    until = -1.0
    for target in np.arange(0.0, 101.0, 2.0):
        while now < target:
            if until > now:
                now = min(until, target)
                continue
            found = solve_ivp(free, (now, target), y, events=gap, **TIGHT)
            now, y = found.t[-1], found.y[:, -1]
            if found.status == 1:
                turns = math.ceil((0.8 * now - math.pi + math.asin(holding)) / (2.0 * math.pi))
                until = (math.pi - math.asin(holding) + 2.0 * math.pi * turns) / 0.8
                pressed = (math.cos(0.8 * now) - math.cos(0.8 * until)) / 0.8 - holding * (until - now)
                held.append(until - now)
                impulses.append(y[1] + pressed)
                y = np.array([0.2, 0.0])
        wanted.append(y)
    assert len(held) > 10
    assert np.abs(result.displacement[0, :, 0].values - np.array(wanted)[:, 0]).max() < 1e-9
    rests = result.impact_flag.values == 2
    np.testing.assert_allclose(result.impact_duration.values[rests][: len(held)], held[: rests.sum()], rtol=1e-8)
    np.testing.assert_allclose(result.impact_impulse.values[rests][: len(held)], impulses[: rests.sum()], rtol=1e-8)


def test_bounces_end_in_rest():
    """A ball on a hardening spring bounces with ever lower bounces, rests, and is held; all of its energy is lost."""
    network = il.Network(
        oscillators={"ball": il.DuffingOscillator(mass=1.0, damping=0.0, stiffness=0.0, cubic=0.5)},
        contacts={"ground": il.Contact(il.WALL, "ball", il.RigidContact(0.9), clearance=1.0)},
        excitations={"gravity": il.BaseMotion(il.ConstantForce(9.81))},
    )
    record = [il.Trajectory(1.0), il.Impacts()]
    result = il.simulate(network, 12.0, initial="rest", record=record, integrator=EXACT)
    assert result.displacement[0, -1, 0].item() == pytest.approx(-1.0, abs=1e-12)
    assert result.velocity[0, -1, 0].item() == 0.0
    assert result.contact_force[0, -1, 0].item() == pytest.approx(9.81 - 0.5, rel=1e-12)
    assert result.impact_lost_energy.values.sum() == pytest.approx(9.81 - 0.125, rel=1e-9)
    assert "comment" in result.contact_rate.attrs  # endless impacts have no rate
    pressed = 12.0 * result.mean_contact_force.item()
    cubes = 12.0 * 9.81 - pressed  # ∫ of 0.5 (−x)³, by the balance of momentum
    assert result.impact_impulse.values.sum() == pytest.approx(pressed, rel=1e-12)
    assert 0.0 < cubes < 6.0


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.6])
def test_a_ball_on_a_moving_table_is_that_of_linear_motion(restitution):
    """A spring of no force makes it a smooth nonlinear network: bounces, chatter, rests and releases are the same.

    A gap that is rounded, by 1e-14 m, changes the velocity v of a fall by 9.81e-14/v.
    """

    def run(ball):
        network = il.Network(
            {"ball": ball, "table": il.PrescribedMotion(il.Harmonic(0.05, frequency=16.0))},
            {"c": il.Contact("table", "ball", il.RigidContact(restitution), clearance=0.2)},
            {"ball": il.ConstantForce(-9.81)},
        )
        return il.simulate(network, 10.0, initial="rest", record=[il.Trajectory(0.1), il.Impacts()], integrator=EXACT)

    exact = run(il.LinearOscillator(mass=1.0, damping=0.0, stiffness=0.0))
    found = run(il.DuffingOscillator(mass=1.0, damping=0.0, stiffness=0.0, cubic=1e-200))
    assert found.events == exact.events >= 50
    assert found.contact_ratio.item() == pytest.approx(exact.contact_ratio.item(), abs=1e-9)
    for name in ("displacement", "contact_force", "impact_impulse", "impact_time"):
        late = 1e-13 / np.maximum(np.abs(exact[name]), 1e-6) if name == "impact_impulse" else 0.0
        assert (np.abs(found[name] - exact[name]) <= 1e-9 + 1e-8 * np.abs(exact[name]) + late).all(), name


def test_bodies_that_overlap_at_the_start_are_refused():
    network = il.Network(
        oscillators={"a": il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=0.5)},
        contacts={"stop": il.Contact("a", il.WALL, il.RigidContact(0.5), clearance=0.2)},
    )
    start = {"displacement": {"a": 0.3}}
    with pytest.raises(il.InvalidInput, match=r"'stop' overlap by 0\.1 m where the run begins"):
        il.simulate(network, 1.0, initial=start, integrator=EXACT)


def test_friction_that_sticks_is_refused():
    network = il.Network(
        oscillators={"a": il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=0.5)},
        couplings={"c": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(0.1))},
    )
    with pytest.raises(il.InvalidInput, match="EventLocated knows no dry friction"):
        il.simulate(network, 1.0, integrator=EXACT)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_impacts_elsewhere_leave_a_rest_alone(restitution):
    """A body that a load presses against its stop, beside one that bounces, of masses whose inverses are rounded."""
    bodies = {
        "pressed": il.DuffingOscillator(mass=3.0, damping=0.3, stiffness=1.7, cubic=0.9),
        "bounces": il.DuffingOscillator(mass=0.7, damping=0.05, stiffness=1.0, cubic=0.3),
    }
    contacts = {
        "rest": il.Contact("pressed", il.WALL, il.RigidContact(restitution), clearance=0.1),
        "hit": il.Contact("bounces", il.WALL, il.RigidContact(0.8), clearance=0.2),
    }
    forces = {"pressed": il.ConstantForce(2.3), "bounces": il.Harmonic(1.0, frequency=1.3)}
    couplings = {"weak": il.Coupling("pressed", "bounces", il.CubicCoupling(0.05))}
    network = il.Network(bodies, contacts, forces, couplings)
    result = il.simulate(network, 60.0, spin_up=60.0, initial="rest", integrator=il.EventLocated(), record=il.Impacts())
    rate = result.contact_rate
    assert rate.sel(contact="hit").item() * 60.0 > 8
    assert rate.sel(contact="rest").item() == 0.0
    assert result.contact_ratio.sel(contact="rest").item() == pytest.approx(1.0, abs=1e-12)
