"""Contact rates where the density of the gap is not smooth near contact, against counts and exact laws."""

import math

import numpy as np
import pytest
from impactlab_numerics.laws.contacts import JumpContact

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.kernels.sums import closings
from impactlab.step_control.rules.closings import jitter


def wall(law, *, clearance=0.5, damping=0.2, excitation=None):
    body = il.LinearOscillator(mass=1.0, damping=damping, stiffness=1.0)
    contact = il.Contact("a", il.WALL, law, clearance=clearance)
    return il.Network({"a": body}, {"w": contact}, {"a": excitation or il.WhiteNoise(damping / np.pi)})


def shaken(base):
    """Two bodies of 1 kg on a base that is shaken."""
    periods = {"left": 0.6, "right": 1.0}
    springs = {
        name: il.Coupling("base", name, il.LinearCoupling((2 * np.pi / time) ** 2, damping=0.1 * 2 * np.pi / time))
        for name, time in periods.items()
    }
    bodies = {name: il.LinearOscillator() for name in periods}
    return il.Network(
        {"base": il.LinearOscillator.from_frequency(10.0, 0.3, mass=base), **bodies},
        {"gap": il.Contact("left", "right", il.LinearContact(1e4), clearance=0.02)},
        {"base": il.WhiteNoise(0.02 * base**2)},
        springs,
    )


def closings_of(ds):
    closed = ds.contact_force.values[:, :, 0] > 0.0
    return (closed[:, 1:] & ~closed[:, :-1]).sum() / closed.shape[0] / ds.attrs["duration"]


def deviation(ds, rate, label=0):
    """Standard errors between a rate and that of a run, which must be known to 1 %."""
    error = float(ds.contact_rate_standard_error[label])
    assert error < 0.01 * rate
    return abs(float(ds.contact_rate[label]) - rate) / error


@pytest.mark.campaign
@pytest.mark.parametrize("base", [1.0, 1e3, 1e6])
def test_bodies_on_a_heavy_shaken_base(base):
    """The base is hotter than what it carries by as much as it is heavier."""
    fine = il.simulate(shaken(base), 25.0, realizations=64, step=5e-4, record=il.Trajectory(5e-4), rng=1)
    assert float(fine.direct_contact_rate[0]) == pytest.approx(closings_of(fine), rel=3e-3)
    long = il.simulate(shaken(base), 100.0, realizations=512, step=1e-3, rng=1)
    ds = il.simulate(shaken(base), 100.0, realizations=512, rng=2)
    error = math.hypot(*(float(item.contact_rate_standard_error[0]) for item in (long, ds)))
    assert error < 0.011 * float(ds.contact_rate[0])
    assert float(ds.contact_rate[0]) == pytest.approx(float(long.contact_rate[0]), abs=3.5 * error)


@pytest.mark.full
@pytest.mark.parametrize(
    ("frequency", "number"),
    [(0.65, 2.0), *(pytest.param(f, 1.0, marks=pytest.mark.campaign) for f in (0.8, 1.3)), (1.5, 1.0), (2.0, 0.0)],
)
def test_a_periodic_motion_touches_a_whole_number_of_times_in_a_period(frequency, number):
    body = il.LinearOscillator(mass=1.0, damping=0.1, stiffness=1.0)
    contact = il.Contact("m", il.WALL, il.LinearContact(20.0), clearance=0.5)
    network = il.Network({"m": body}, {"stop": contact}, {"m": il.Harmonic(1.0, frequency=frequency)})
    period = 2 * np.pi / frequency
    ds = il.simulate(network, 40 * period, spin_up=60 * period, initial={}, rng=1)
    assert ds.contact_rate.item() * period == pytest.approx(number, abs=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("preload", [-1.0, -6.0])
def test_a_second_contact_of_a_body_that_is_pressed_against_its_spring(preload):
    contacts = {
        "press": il.Contact("a", il.WALL, il.HertzContact(400.0), clearance=preload),
        "other": il.Contact(il.WALL, "a", il.HertzContact(100.0), clearance={-1.0: 0.85, -6.0: 5.2}[preload]),
    }
    body = il.LinearOscillator.from_frequency(2 * np.pi, 0.05)
    network = il.Network({"a": body}, contacts, {"a": il.WhiteNoise(0.5)})
    exact = float(il.exact(network).statistics().contact_rate.sel(contact="other"))
    assert deviation(il.simulate(network, 200.0, realizations=1024, rng=1), exact, 1) < 3.5


@pytest.mark.full
@pytest.mark.parametrize("damping", [pytest.param(60.0, marks=pytest.mark.campaign), 200.0])
def test_bodies_that_friction_stops_within_a_step(damping):
    """The neighbour's force counts in their velocities as friction leaves it: 2.7 % too many at ``c h/m`` of 14."""
    body = il.LinearOscillator(stiffness=1.0, damping=damping)
    contacts = {
        "wall": il.Contact("a", il.WALL, il.LinearContact(20.0), clearance=0.3),
        "pair": il.Contact("b", "a", il.LinearContact(20.0), clearance=-0.5),
    }
    network = il.Network({"a": body, "b": body}, contacts, dict.fromkeys("ab", il.WhiteNoise(damping / np.pi)))
    ds = il.simulate(network, 20.0 * damping, realizations=512, rng=1, integrator=il.ExactFlow(measured=False))
    assert damping * ds.attrs["step"] > 4.0
    for label, rate in enumerate(il.exact(network).statistics().contact_rate):
        assert deviation(ds, float(rate), label) < 3.5


@pytest.mark.campaign
def test_closings_of_bodies_that_friction_would_stop_within_a_step():
    """A contact with a dashpot has its closings counted: at the step that forces need, 13.8 m/c, some 50 % too many."""
    body = il.LinearOscillator(stiffness=1.0, damping=200.0)

    def touching(law):
        contact = il.Contact("a", il.WALL, law, clearance=0.3)
        return il.Network({"a": body}, {"w": contact}, {"a": il.WhiteNoise(200.0 / np.pi)})

    method, dashpot = il.ExactFlow(measured=False), il.KelvinVoigtContact(20.0, damping=1e-6)
    ds = il.simulate(touching(dashpot), 400.0, realizations=64, rng=1, integrator=method)
    assert 200.0 * ds.attrs["step"] <= 1.0
    exact = float(il.exact(touching(il.LinearContact(20.0))).statistics().contact_rate[0])
    assert abs(float(ds.contact_rate[0]) - exact) < 3.5 * float(ds.contact_rate_standard_error[0])


@pytest.mark.full
@pytest.mark.parametrize(
    ("rates", "clearances"),
    [pytest.param((2.8, 2.7), (-1.0, -1.2), marks=pytest.mark.campaign), ((46.0, 34.0), (-1.0, -1.2))],
)
def test_bodies_that_are_pressed_together(rates, clearances):
    """Forces at the moment of a closing have a mean there: the flux has 0.5 to 0.7 % too many."""
    masses = {"a": 0.036, "b": 0.15}
    bodies = {
        name: il.LinearOscillator(mass=mass, stiffness=2.0, damping=rate * mass)
        for (name, mass), rate in zip(masses.items(), rates, strict=True)
    }
    contacts = {
        "wall": il.Contact("a", il.WALL, il.PowerLawContact(10.0, exponent=1.7), clearance=clearances[0]),
        "pair": il.Contact("b", "a", il.PowerLawContact(10.0, exponent=1.5), clearance=clearances[1]),
    }
    noises = {name: il.WhiteNoise(2.0 * body.damping / np.pi) for name, body in bodies.items()}
    network = il.Network(bodies, contacts, noises)
    ds = il.simulate(network, 100.0, realizations=2048, rng=1)
    for label, rate in enumerate(il.exact(network).statistics().contact_rate):
        assert deviation(ds, float(rate), label) < 3.5


@pytest.mark.full
@pytest.mark.parametrize(
    "law",
    [
        *(pytest.param(il.PowerLawContact(10.0, exponent=q), marks=pytest.mark.campaign) for q in (0.3, 0.1)),
        JumpContact(2.0, stiffness=10.0),
    ],
    ids=["power 0.3", "power 0.1", "jump"],
)
def test_forces_that_begin_suddenly(law):
    network = wall(law)
    ds = il.simulate(network, 100.0, realizations=1024, rng=1)
    assert deviation(ds, il.exact(network).statistics().contact_rate.item()) < 3.5


@pytest.mark.parametrize("damping", [0.2, 2.0])
def test_what_noise_hides_within_steps(damping, monkeypatch):
    """The same law as by a flux, with counts; the cubic alone misses 8 % of c h/m."""
    monkeypatch.setattr("impactlab.step_control.rules.steps.counts_closings", lambda *_: True)
    network = wall(il.LinearContact(10.0), damping=damping)
    ds = il.simulate(network, 200.0, realizations=4096, rng=1)
    assert deviation(ds, il.exact(network).statistics().contact_rate.item()) < 3.5


@pytest.mark.full
def test_a_strong_dashpot():
    """The speed is gone within less than the window of a flux; 0.306 was counted with a step of 0.2 ms."""
    ds = il.simulate(
        wall(il.KelvinVoigtContact(100.0, damping=40.0), clearance=0.2), 100.0, realizations=512, step=1e-3, rng=1
    )
    assert float(ds.contact_rate[0]) == pytest.approx(0.306, abs=0.006)


@pytest.mark.full
def test_bounded_noise():
    """Two methods under the same noise, at their steps."""
    noise = il.ShinozukaNoise(0.2 / np.pi, band=(0.0, 20.0), components=8000)
    network = wall(il.LinearContact(100.0), excitation=noise)
    flow, steps = (
        il.simulate(network, 100.0, realizations=128, integrator=item, rng=1)
        for item in (il.ExactFlow(), il.RungeKutta4())
    )
    assert float(flow.contact_rate[0]) == pytest.approx(float(steps.contact_rate[0]), rel=5e-3)


@pytest.mark.parametrize("step", [0.5, 0.01])
def test_what_cosines_change_velocities_by_in_a_step(step):
    """Also where two that share their phases have none as fast as the steps."""
    noise = il.ShinozukaNoise(0.2 / np.pi, band=(0.0, 3.0), components=600)
    for given in ({"a": noise}, il.coherent(noise, {"a": 0.0}, lambda frequencies, distance: 1.0)):
        network = wall(il.LinearContact(100.0)).replace(excitations={"a": None, **given})
        expected = np.sqrt(2.0 * np.pi * step * 0.2 / np.pi) if step == 0.5 else 0.0  # as of white noise of the density
        assert jitter(Model.of(network), step, 10.0) == pytest.approx([expected], rel=0.01)


@pytest.mark.parametrize("integrator", [il.ExactFlow(), il.RungeKutta4(), il.EulerMaruyama()], ids=repr)
def test_rates_are_the_closings_of_the_path(integrator):
    ds = il.simulate(
        wall(il.KelvinVoigtContact(100.0, damping=1.0)), 5.0, realizations=64, step=1e-3, integrator=integrator,
        record=il.Trajectory(1e-3), rng=1,
    )  # fmt: skip
    closed = ds.displacement.values[:, :, 0] > 0.5
    counted = (closed[:, 1:] & ~closed[:, :-1]).sum() / 64 / 5.0
    rate = ds.get("direct_contact_rate", ds.contact_rate)
    assert float(rate[0]) == pytest.approx(counted, abs=1.01 / 64 / 5.0)


@pytest.mark.full
def test_a_rate_is_never_negative():
    """A heavy body that stays in contact while a force within the window of a flux changes its speed."""
    network = il.Network(
        {
            "a": il.DuffingOscillator(2e3, mass=1e10, damping=2.7, stiffness=0.26),
            "b": il.LinearOscillator(mass=2e8, damping=6.25e-5, stiffness=179.0),
        },
        {"g": il.Contact("a", il.WALL, il.LinearContact(2.4e4), clearance=-22.5)},
        {"a": il.WhiteNoise(3.9e5)},
    )
    start = {"displacement": {"a": 6.7e-4}, "velocity": {"a": 0.19}}
    with pytest.warns(il.AccuracyWarning):
        ds = il.simulate(network, 1.0, initial=start, rng=99)
    assert ds.contact_rate.item() == 0.0


def test_the_first_step_counts():
    """A body that its spring presses against the wall closes the contact and stays: once, whenever it begins."""
    network = wall(il.KelvinVoigtContact(100.0, damping=40.0), clearance=-1.0).replace(excitations={"a": None})
    ds = il.simulate(network, 1.0, initial={"displacement": {"a": -1.0 - 1e-6}, "velocity": {"a": 1.0}}, rng=1)
    assert ds.contact_rate.item() == pytest.approx(1.0)


def test_a_turning_point_beyond_contact_stands_for_what_is_hidden():
    assert closings(-0.1, 1.0, -0.1, -1.0, 1.0, 0.0) == 1.0
    assert closings(-0.3, 1.0, -0.3, -1.0, 1.0, 0.0) == 0.0
    assert closings(0.1, -1.0, 0.1, 1.0, 1.0, 0.0) == 1.0
    assert 1.0 < closings(-0.2, 1.0, -0.2, -1.0, 1.0, 2.0) < 1.1
    assert closings(math.nan, math.nan, 1.0, 1.0, 1.0, 1.0) == 0.0
