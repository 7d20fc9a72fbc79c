"""Impacts of smooth nonlinear contacts, followed without noise, against SciPy's DOP853 with events."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

import impactlab as il

pytestmark = pytest.mark.full

EXACT = il.EventLocated()


def stop(law, damping=0.1, excitations=None):
    """Return a body beside a stop."""
    return il.Network(
        oscillators={"a": il.LinearOscillator(mass=1.0, damping=damping, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, law, clearance=0.2)},
        excitations=excitations,
    )


def impacts_of_stop(force, duration):
    """Return a row for each impact of the driven body: when, closing and leaving, duration, impulse, largest, lost."""

    def free(t, y):
        return [y[1], math.sin(0.8 * t) - 0.1 * y[1] - y[0]]

    def closed(t, y):
        push = force(max(y[0] - 0.2, 0.0), y[1])
        return [y[1], math.sin(0.8 * t) - 0.1 * y[1] - y[0] - push, push, push * y[1]]

    def gap(t, y):
        return y[0] - 0.2

    gap.terminal, now, y, rows = True, 0.0, [0.0, 0.0], []
    options = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-16}
    while True:
        gap.direction = 1.0
        found = solve_ivp(free, (now, duration), y, events=gap, **options)
        begin, y = found.t[-1], found.y[:, -1]
        gap.direction = -1.0
        found = solve_ivp(closed, (begin, duration), [*y, 0.0, 0.0], events=gap, dense_output=True, **options)
        if found.status != 1:
            return np.array(rows)
        now, (x, v, impulse, lost) = found.t[-1], found.y[:, -1]

        def push(t, path=found.sol):
            x, v = path(t)[:2]
            return -force(max(x - 0.2, 0.0), v)

        largest = -minimize_scalar(push, bounds=(begin, now), method="bounded", options={"xatol": 1e-9}).fun
        rows.append([begin, y[1], -v, now - begin, impulse, largest, lost])
        y = [x, v]


@pytest.mark.parametrize(
    ("law", "force"),
    [
        (il.HertzContact(100.0), lambda d, r: 100.0 * d**1.5),
        (il.HuntCrossleyContact(100.0, dissipation=0.3), lambda d, r: 100.0 * d**1.5 * max(1.0 + 0.3 * r, 0.0)),
    ],
)
def test_impacts_at_a_stop(law, force):
    """More than 20 impacts, each number to 1e-8."""
    network = stop(law, excitations={"a": il.Harmonic(1.0, frequency=0.8)})
    data = il.simulate(network, 80.0, initial="rest", record=il.Impacts(), integrator=EXACT)
    wanted = impacts_of_stop(force, 80.0)
    names = "time", "closing_velocity", "leaving_velocity", "duration", "impulse", "largest_force", "lost_energy"
    found = np.stack([data[f"impact_{name}"].values for name in names], axis=1)[: len(wanted)]
    assert len(wanted) > 20
    assert data.sizes["impact"] - len(wanted) in (0, 1)  # the last may be cut off
    np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-9)
    assert data.peak_contact_force.item() == pytest.approx(data.impact_largest_force.values.max(), rel=1e-12)


def test_a_hertz_collision_has_its_closed_form():
    """A free body: largest force and duration by the energy, a leaving velocity that is the closing one."""
    network = il.Network(
        oscillators={"a": il.LinearOscillator(mass=2.0, damping=0.0, stiffness=0.0)},
        contacts={"stop": il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.1)},
    )
    start = {"velocity": {"a": 1.5}}
    data = il.simulate(network, 1.0, initial=start, record=il.Impacts(), integrator=EXACT)
    deepest = (5.0 * 2.0 * 1.5**2 / (4.0 * 1e4)) ** 0.4
    lasts = 2.0 * deepest / 1.5 * math.sqrt(math.pi) * math.gamma(1.4) / math.gamma(0.9)
    assert data.sizes["impact"] == 1
    assert data.impact_time.item() == pytest.approx(0.1 / 1.5, rel=1e-12)
    assert data.impact_duration.item() == pytest.approx(lasts, rel=1e-9)
    assert data.impact_largest_force.item() == pytest.approx(1e4 * deepest**1.5, rel=1e-9)
    assert data.impact_leaving_velocity.item() == pytest.approx(1.5, rel=1e-10)
    assert data.impact_impulse.item() == pytest.approx(2.0 * 2.0 * 1.5, rel=1e-10)
    assert data.impact_lost_energy.item() == pytest.approx(0.0, abs=1e-9)


def test_impacts_are_cut_by_the_measurement():
    """A contact that is closed when the measurement begins, and at its end, has flags and parts of its impulse."""
    network = stop(il.HertzContact(50.0), damping=0.2, excitations={"a": il.ConstantForce(3.0)})
    data = il.simulate(network, 2.0, spin_up=80.0, initial="rest", record=il.Impacts(), integrator=EXACT)
    assert data.impact_flag.values.tolist() == [5]
    assert math.isnan(data.impact_closing_velocity.item())
    assert data.impact_duration.item() == pytest.approx(2.0, rel=1e-12)
    assert data.impact_impulse.item() == pytest.approx(2.0 * data.mean_contact_force.item(), rel=1e-12)


def test_logs_that_are_full_change_no_bit(monkeypatch):
    """A run stops where its log is full, and goes on."""
    network = stop(il.HertzContact(100.0), excitations={"a": il.Harmonic(1.0, frequency=0.8)})
    options = {"initial": "rest", "record": il.Impacts(), "integrator": EXACT}
    whole = il.simulate(network, 80.0, **options)
    monkeypatch.setattr("impactlab.located.logs.MOST_EVENTS", 1)
    parts = il.simulate(network, 80.0, **options)
    assert whole.sizes["impact"] > 20
    assert np.array_equal(whole.impact_impulse, parts.impact_impulse)
    assert np.array_equal(whole.impact_time, parts.impact_time)


def test_a_run_goes_on_from_the_states_at_its_end():
    """The final state has those of laws."""
    network = il.Network(
        oscillators={"a": il.LinearOscillator(mass=1.0, damping=0.05, stiffness=1.0)},
        couplings={"c": il.Coupling(il.WALL, "a", il.MaxwellCoupling(3.0, damping=2.0))},
        contacts={"stop": il.Contact("a", il.WALL, il.HertzContact(100.0), clearance=0.2)},
    )
    start = {"velocity": {"a": 1.0}}
    options = {"integrator": EXACT, "record": il.FinalState()}
    whole = il.simulate(network, 6.0, initial=start, **options)
    first = il.simulate(network, 3.0, initial=start, **options)
    second = il.simulate(network, 3.0, initial=first, **options)
    for name in ("final_displacement", "final_velocity", "final_law_state"):
        np.testing.assert_allclose(second[name], whole[name], rtol=1e-8, atol=1e-10)
