"""Where energy comes from, which way it goes, and where it is lost."""

import numpy as np
import pytest
from scenes import base

import impactlab as il
from impactlab.statistics.controls import Controls
from impactlab.statistics.regression import Mean

POWERS = ("power_in", "power_dissipated", "power_balance", "network_power_balance")


def pair(hot=2.0, cold=1.0, stiffness=1.0, damping=0.1, spring=0.5, damper=0.0):
    """Two equal linear bodies at two temperatures, with a coupling."""
    body = il.LinearOscillator(damping=damping, stiffness=stiffness)
    heat = damping / np.pi
    return il.Network(
        {"hot": body, "cold": body},
        couplings={"spring": il.Coupling("hot", "cold", il.LinearCoupling(spring, damping=damper))},
        excitations={"hot": il.WhiteNoise(hot * heat), "cold": il.WhiteNoise(cold * heat)},
    )


def flux(difference=1.0, m=1.0, k=1.0, c=0.1, kappa=0.5):
    """The flux of heat between them: that of the linear law of a pair."""
    return difference * c * kappa**2 / (2.0 * (m * kappa**2 + c**2 * (k + kappa)))


def score(ds, name, expected):
    """Distance from what is expected in standard errors."""
    return np.abs((ds[name].values - expected) / ds[f"{name}_standard_error"].values).max()


def balanced(ds, most=4.0):
    """Whether all balances close to their errors."""
    return score(ds, "power_balance", 0.0) < most and score(ds, "network_power_balance", 0.0) < most


def test_the_flux_of_heat_between_two_bodies():
    """Of a linear pair it is known: 0.0471698 W for a difference of 1 J."""
    assert flux() == pytest.approx(0.04716981132, rel=1e-9)
    ds = il.simulate(pair(), 4000.0, realizations=64, rng=1, record=il.EnergyFlows())
    assert score(ds, "coupling_power_carried", flux()) < 3.0
    assert float(ds.coupling_power_carried_standard_error[0]) < 0.002 * flux()
    assert score(ds, "power_dissipated", [0.2 - flux(), 0.1 + flux()]) < 3.0
    assert ds.power_in.values == pytest.approx([0.2, 0.1])
    assert ds.source.values.tolist() == ["hot", "cold"]
    assert abs(float(ds.coupling_power_dissipated[0])) < 1e-12
    assert balanced(ds)
    np.testing.assert_allclose(ds.temperature, ds.mean_square_velocity)


def test_a_contact_carries_heat():
    """The power that a contact takes from one body arrives at the other, and agrees with what their dampers lose."""
    network = base(excitations={"one": il.WhiteNoise(16.0), "two": il.WhiteNoise(4.0)})
    ds = il.simulate(network, 60.0, realizations=128, rng=1, record=il.EnergyFlows())
    arrives = ds.power_in.values - ds.power_dissipated.values
    assert balanced(ds)
    assert abs(float(ds.contact_power_carried[0]) - arrives[0]) < 4.0 * float(ds.power_dissipated_standard_error[0])
    assert float(ds.contact_power_carried[0]) < -2.0
    assert abs(float(ds.contact_power_dissipated[0])) < 1e-12


@pytest.mark.full
@pytest.mark.parametrize("realizations", [1, 96])
def test_a_contact_that_loses_energy(realizations):
    """What comes in is lost in dampers and in the contact."""
    contact = {"gap": il.Contact("one", "two", il.KelvinVoigtContact(1e4, damping=20.0), clearance=0.05)}
    duration = 2500.0 if realizations == 1 else 60.0
    ds = il.simulate(base(contacts=contact), duration, realizations=realizations, rng=2, record=il.EnergyFlows())
    assert balanced(ds)
    lost = ds.power_in.values.sum() - ds.power_dissipated.values.sum()
    assert abs(float(ds.contact_power_dissipated[0]) - lost) < 4.0 * float(
        ds.contact_power_dissipated_standard_error[0]
    )
    assert float(ds.contact_power_dissipated[0]) > 10.0 * float(ds.contact_power_dissipated_standard_error[0])


NETWORKS = {
    "Duffing": {"oscillators": {"a": il.DuffingOscillator(damping=0.4, stiffness=4.0, cubic=3.0)}},
    "van der Pol": {"oscillators": {"a": il.VanDerPolOscillator(damping=0.4, stiffness=4.0, growth=1.0, width=0.5)}},
    "cubic spring": {"couplings": {"own": il.Coupling("a", "b", il.CubicCoupling(3.0))}},
    "hysteresis": {"couplings": {"own": il.Coupling("a", "b", il.BoucWenCoupling(4.0, yield_displacement=0.3))}},
    "circuit": {
        "couplings": {"own": il.Coupling("a", il.WALL, il.PiezoelectricCoupling(0.4, capacitance=1.0, resistance=1.0))}
    },
    "damper": {"couplings": {"own": il.Coupling("a", "b", il.LinearCoupling(2.0, damping=0.3))}},
    "friction": {"couplings": {"own": il.Coupling("a", "b", il.FrictionCoupling(0.3, velocity=0.2))}},
    "weights": {
        "couplings": {"own": il.Coupling(il.Combination({"a": 1.0, "b": -0.5}), il.WALL, il.LinearCoupling(2.0))}
    },
    "correlated noise": {"excitations": {"wind": il.Source(il.WhiteNoise(0.3), on={"a": 1.0, "b": -0.5})}},
    "filtered noise": {"excitations": {"a": il.OrnsteinUhlenbeckNoise(1.0, correlation_time=0.1)}},
    "harmonic force": {"excitations": {"a": il.Harmonic(1.5, frequency=2.0)}},
    "rare contacts": {"contacts": {"own": il.Contact("a", il.WALL, il.LinearContact(50.0), clearance=2.5)}},
}  # fmt: skip


def network_of(name):
    """Two bodies with a contact under white noise, and what the name says."""
    body = il.LinearOscillator(damping=0.4, stiffness=4.0)
    parts = {
        "oscillators": {"a": body, "b": il.LinearOscillator(mass=2.0, damping=0.3, stiffness=6.0)},
        "contacts": {"gap": il.Contact("a", "b", il.HertzContact(100.0), clearance=0.2)},
        "couplings": {},
        "excitations": {"a": il.WhiteNoise(0.3), "b": il.WhiteNoise(0.1)},
    }
    return il.Network(**{kind: members | NETWORKS[name].get(kind, {}) for kind, members in parts.items()})


@pytest.mark.full
@pytest.mark.parametrize("name", NETWORKS)
def test_all_networks_balance(name):
    """Whatever passes energy on, loses or stores it."""
    ds = il.simulate(network_of(name), 200.0, realizations=64, rng=3, record=il.EnergyFlows())
    assert balanced(ds, 4.5)
    assert np.isfinite(ds.power_in).all()
    if "own" in ds.get("coupling", []):
        lost = float(ds.coupling_power_dissipated.sel(coupling="own"))
        loses = name in ("hysteresis", "circuit", "damper")
        assert lost > 5.0 * float(ds.coupling_power_dissipated_standard_error[-1]) if loses else True


@pytest.mark.full
def test_they_are_stored_swept_and_made_again(tmp_path):
    """In sweeps, in files, and by a rerun: the same numbers."""
    ds = il.sweep(
        lambda hot: pair(hot), {"hot": [1.0, 3.0]}, duration=400.0, realizations=64, rng=1, record=il.EnergyFlows()
    )
    assert (ds.status == "done").all()
    difference = ds.coupling_power_carried - flux(ds.hot - 1.0)
    assert (np.abs(difference) < 4.0 * ds.coupling_power_carried_standard_error).all()
    one = il.simulate(pair(), 400.0, realizations=64, rng=1, record=il.EnergyFlows())
    il.save(one, tmp_path / "flows.nc")
    again = il.rerun(tmp_path / "flows.nc")
    for name in POWERS:
        np.testing.assert_array_equal(again[name], one[name])
    assert "Rieder" in one.attrs["references"]


def body(**fields):
    return il.LinearOscillator(**{"damping": 0.1, "stiffness": 1.0} | fields)


def stopped(law, **excitations):
    """Two bodies, one of them driven, that meet."""
    contacts = {"gap": il.Contact("a", "b", law, clearance=0.1)}
    excitations = excitations or {"a": il.Harmonic(1.0, frequency=1.3)}
    return il.Network({"a": body(), "b": body()}, contacts, excitations)


def rubbed(law):
    """A driven body on a coupling."""
    coupling = {"own": il.Coupling("a", il.WALL, law)}
    return il.Network({"a": body()}, couplings=coupling, excitations={"a": il.Harmonic(1.0, frequency=1.3)})


SHAKEN = il.PrescribedMotion(il.Harmonic(0.3, frequency=1.1))
LOCATED = {
    "spring": stopped(il.LinearContact(100.0)),
    "damper": stopped(il.KelvinVoigtContact(100.0, damping=1.0)),
    "rigid": stopped(il.RigidContact(0.7)),
    "pulse": stopped(il.RigidContact(0.7), a=il.Pulse(3.0, duration=2.0, start=0.2)),
    "friction": rubbed(il.CoulombFrictionCoupling(0.3, velocity=0.2)),
    "slider": rubbed(il.JenkinsCoupling(5.0, slip_force=0.3)),
    "kinks": rubbed(il.BilinearCoupling(1.0, outer_stiffness=5.0, break_extension=0.2)),
    "shaken": il.Network(
        {"a": body(), "p": SHAKEN},
        {"gap": il.Contact("p", "a", il.RigidContact(0.7), clearance=0.1)},
        couplings={"own": il.Coupling("p", "a", il.LinearCoupling(0.5, damping=0.2))},
    ),
}
"""Networks in which nothing is random, of all kinds of events."""


@pytest.mark.parametrize("name", LOCATED)
def test_located_paths_balance_to_rounding(name):
    ds = il.simulate(LOCATED[name], 30.0, record=il.EnergyFlows(), spin_up=2.0, initial="rest")
    assert ds.attrs["integrator"] == "EventLocated"
    scale = np.abs(ds.power_in).max()
    assert np.abs(ds.power_balance).max() < 1e-13 * scale
    assert np.abs(ds.network_power_balance) < 1e-13 * scale
    lost = sum(float(ds[f"{link}_power_dissipated"].sum()) for link in ("contact", "coupling") if link in ds.dims)
    assert lost > 1e-3 * scale if name not in ("spring", "kinks") else abs(lost) < 1e-13 * scale
    moving = [item for item in ds.oscillator.values if item != "p"]
    taken = 0.1 * float(ds.mean_square_velocity.sel(oscillator=moving).sum())
    assert float(ds.power_dissipated.sum()) == pytest.approx(taken, rel=1e-12)


def duffing(**parts):
    """A Duffing oscillator beside a linear body, driven and coupled."""
    bodies = {"a": il.DuffingOscillator(damping=0.1, stiffness=1.0, cubic=0.5), "b": body(mass=0.5)}
    parts = {"excitations": {"a": il.Harmonic(0.8, frequency=1.3)}} | parts
    return il.Network({**bodies, **parts.pop("oscillators", {})}, **parts)


SMOOTH = {
    "Hertz": duffing(contacts={"gap": il.Contact("a", "b", il.HertzContact(100.0), clearance=0.3)}),
    "damper": duffing(contacts={"gap": il.Contact("a", il.WALL, il.HuntCrossleyContact(100.0, dissipation=0.2))}),
    "rigid": duffing(
        contacts={"gap": il.Contact("a", "b", il.RigidContact(0.7), clearance=0.3)},
        couplings={"own": il.Coupling("a", "b", il.LinearCoupling(0.3, damping=0.1))},
    ),
    "hysteresis": duffing(couplings={"own": il.Coupling("a", "b", il.BoucWenCoupling(0.5, yield_displacement=0.2))}),
    "van der Pol": duffing(
        oscillators={"b": il.VanDerPolOscillator(damping=0.1, stiffness=1.0, growth=0.4, width=0.5)},
        excitations={"b": il.Pulse(1.0, duration=2.0, start=0.2)},
    ),
    "shaken": duffing(
        oscillators={"p": SHAKEN},
        contacts={
            "gap": il.Contact("p", "a", il.HertzContact(50.0), clearance=0.1),
            "stop": il.Contact("p", "b", il.RigidContact(0.7), clearance=0.1),
        },
    ),
}
"""Networks of smooth nonlinear forces in which nothing is random."""


@pytest.mark.full
@pytest.mark.parametrize("name", SMOOTH)
def test_paths_of_smooth_forces_balance_to_the_error_of_the_path(name):
    """Steps of order eight have all powers to the error of the path."""
    ds = il.simulate(SMOOTH[name], 20.0, record=il.EnergyFlows(), spin_up=1.0, initial="rest")
    assert ds.attrs["integrator"] == "EventLocated"
    scale = max(np.abs(ds[item]).max() for item in ("power_in", "power_dissipated", "power_stored"))
    assert np.abs(ds.power_balance).max() < 1e-9 * scale
    assert np.abs(ds.network_power_balance) < 1e-9 * scale
    lost = sum(float(ds[f"{link}_power_dissipated"].sum()) for link in ("contact", "coupling") if link in ds.dims)
    assert (lost > 1e-3 * scale) == (name in ("damper", "rigid", "hysteresis", "shaken"))
    taken = 0.1 * float(ds.mean_square_velocity.sel(oscillator="a"))
    assert float(ds.power_dissipated.sel(oscillator="a")) == pytest.approx(taken, rel=1e-9)


def by_steps(network, step, duration=5.6):
    return il.simulate(network, duration, record=il.EnergyFlows(), spin_up=0.0, initial="rest", step=step)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_steps_tell_what_impacts_and_dry_friction_do():
    """What impacts lose is that of located paths, what they carry comes to it with the step; so does friction."""
    rubbed_pair = il.Network(
        {"a": body(), "b": body(mass=2.0, stiffness=3.0)},
        couplings={"own": il.Coupling("a", "b", il.CoulombFrictionCoupling(0.3))},
        excitations={"a": il.Harmonic(1.0, frequency=1.2)},
    )
    for network, link, exact in ((stopped(il.RigidContact(0.6)), "contact", 1e-3), (rubbed_pair, "coupling", 1e-5)):
        located = il.simulate(network, 5.6, record=il.EnergyFlows(), spin_up=0.0, initial="rest")
        coarse, fine = (by_steps(network, step) for step in (0.02, 0.01))
        lost, carried = (float(located[f"{link}_power_{name}"][0]) for name in ("dissipated", "carried"))
        assert lost > 1e-3
        for ds in (coarse, fine):
            assert float(ds[f"{link}_power_dissipated"][0]) == pytest.approx(lost, rel=exact)
        off = [abs(float(ds[f"{link}_power_carried"][0]) - carried) for ds in (coarse, fine)]
        assert off[1] < max(0.7 * off[0], exact * carried)
        assert off[0] < 0.05 * carried


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_rigid_contacts_balance_under_noise():
    """Between bodies at two temperatures, and at a wall."""
    contacts = {
        "gap": il.Contact("a", "b", il.RigidContact(0.8), clearance=0.2),
        "stop": il.Contact("b", il.WALL, il.RigidContact(0.6), clearance=0.5),
    }
    network = il.Network(
        {"a": body(damping=0.4), "b": body(mass=2.0, damping=0.3, stiffness=2.0)}, contacts,
        {"a": il.WhiteNoise(0.5), "b": il.WhiteNoise(0.05)},
    )  # fmt: skip
    ds = il.simulate(network, 200.0, realizations=96, rng=4, record=il.EnergyFlows())
    assert balanced(ds)
    lost, error = (ds[f"contact_power_dissipated{end}"].values for end in ("", "_standard_error"))
    assert (lost > 20.0 * error).all()
    assert float(ds.contact_power_carried.sel(contact="gap")) > 0.02


@pytest.mark.full
def test_dry_friction_balances_beside_noise():
    """A body that sticks and slips on the ground, pushed through a spring by one under noise."""
    network = il.Network(
        {"a": body(), "b": body(damping=0.3)},
        couplings={
            "rub": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(0.3)),
            "spring": il.Coupling("a", "b", il.LinearCoupling(1.0)),
        },
        excitations={"b": il.WhiteNoise(0.2)},
    )
    ds = il.simulate(network, 200.0, realizations=96, rng=4, record=il.EnergyFlows())
    assert balanced(ds)
    rub = ds.sel(coupling="rub")
    assert float(rub.coupling_power_dissipated) > 20.0 * float(rub.coupling_power_dissipated_standard_error)


@pytest.mark.full
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_contacts_in_a_plane_balance(friction):
    """A body in a ring: its law loses nothing, friction on its surface does, and turns it."""
    rubs = {"friction_coefficient": friction, "friction_velocity": 0.1, "surface_velocity": 0.5} if friction else {}
    ring = il.RoundContact(("x", "y"), il.WALL, il.LinearContact(50.0), clearance=0.5, **rubs)
    network = il.Network(
        {"x": body(damping=0.2), "y": body(damping=0.3, stiffness=1.3)}, {"ring": ring},
        {"x": il.WhiteNoise(0.3), "y": il.WhiteNoise(0.2)},
    )  # fmt: skip
    ds = il.simulate(network, 200.0, realizations=96, rng=4, record=il.EnergyFlows())
    assert balanced(ds)
    lost, error = (float(ds[f"contact_power_dissipated{end}"][0]) for end in ("", "_standard_error"))
    assert abs(lost) > 20.0 * error if friction else abs(lost) < 1e-12


@pytest.mark.full
def test_residual_forces_store_what_they_do_not_lose():
    """Over a short run from rest a cubic spring takes energy, and loses none."""
    network = il.Network(
        {"a": il.DuffingOscillator(damping=0.1, stiffness=1.0, cubic=2.0)}, excitations={"a": il.WhiteNoise(0.5)}
    )
    ds = il.simulate(network, 1.0, realizations=256, initial="rest", spin_up=0.0, rng=1, record=il.EnergyFlows())
    assert balanced(ds)
    taken, error = 0.1 * float(ds.mean_square_velocity[0]), float(ds.power_dissipated_standard_error[0])
    assert abs(float(ds.power_dissipated[0]) - taken) < 4.0 * error


@pytest.mark.full
def test_a_rigid_contact_that_rounding_has_closed_stores_nothing():
    """A light tooth that rests on a flank at the end of the run."""
    frequency = 52.0 * np.pi
    driver = il.PrescribedMotion(il.Harmonic(60.0 / frequency**2, frequency=frequency))
    teeth = il.backlash("a", "p", il.RigidContact(0.6), clearance=5e-5, name="play")
    drag = {"drag": il.Source(il.ConstantForce(-0.02), on="a")}
    network = il.Network({"p": driver, "a": il.LinearOscillator(mass=2e-3)}, teeth, drag)
    ds = il.simulate(network, 1.0 / 26.0, record=il.EnergyFlows(), spin_up=20.0 / 26.0, initial={})
    assert abs(ds.network_power_balance) < 1e-13 * ds.power_in.max()


def test_the_power_of_a_harmonic_force_is_that_of_the_response():
    """In the steady motion, F² ω² c/2 |H|²; from event to event and, to its error, by steps beside noise."""
    network = il.Network({"a": body()}, excitations={"a": il.Harmonic(2.0, frequency=1.3)})
    period = 2.0 * np.pi / 1.3
    power = 0.5 * 4.0 * 1.3**2 * 0.1 / ((1.0 - 1.3**2) ** 2 + (0.1 * 1.3) ** 2)
    ds = il.simulate(network, 3.0 * period, spin_up=600.0, record=il.EnergyFlows())
    assert float(ds.power_in[0]) == pytest.approx(power, rel=1e-10)
    noisy = network.replace(excitations={"b": il.Source(il.WhiteNoise(0.1), on="a")})
    ds = il.simulate(noisy, 40.0 * period, realizations=64, rng=1, record=il.EnergyFlows())
    powers = ds.power_in.to_series()
    assert powers["b"] == pytest.approx(np.pi * 0.1)
    error = float(ds.power_in_standard_error.sel(source="a"))
    assert 0.0 < error < 0.1 * power
    assert abs(powers["a"] - power) < 4.0 * error


@pytest.mark.full
def test_powers_of_given_forces_beside_a_contact():
    """Of a body that no noise reaches its balance closes to its error, over periods that are not whole."""
    far = il.Contact("a", "b", il.HertzContact(1e3), clearance=30.0)
    sources = {"a": il.Harmonic(2.0, frequency=1.3), "b": il.WhiteNoise(0.1)}
    network = il.Network({"a": body(), "b": body()}, {"far": far}, sources)
    ds = il.simulate(network, 37.0, realizations=64, step=0.02, rng=1, record=il.EnergyFlows())
    power = ds.power_in.sel(source="a").item()
    assert power > 0.1
    balance, error = (ds[f"power_balance{end}"].sel(oscillator="a").item() for end in ("", "_standard_error"))
    assert abs(balance) < 2.0 * error < 4.0 * 0.026**2 / 12.0 * power
    assert ds.network_power_balance_standard_error.item() >= error


@pytest.mark.full
def test_energy_over_impacts_beside_a_law_with_a_state():
    """Of two bodies that collide beside a Maxwell element, where nothing is random; and paths of its state."""
    link = il.Coupling("a", "b", il.MaxwellCoupling(1.0, damping=0.5))
    rigid = il.Contact("a", "b", il.RigidContact(1.0), clearance=0.1)
    network = il.Network({"a": body(), "b": body()}, {"hit": rigid}, {}, {"link": link})
    options = {"step": 0.01, "integrator": il.ExactFlow(), "initial": {"velocity": {"a": 1.0}}, "spin_up": 0.0}
    path = il.Trajectory(0.1)
    ds = il.simulate(network, 10.0, record=[il.EnergyFlows(), path], **options)
    assert ds.contact_rate.item() > 0.0
    assert ds.coupling_power_dissipated.item() > 0.01
    assert np.abs(ds.power_balance).max() < 1e-3
    alone = il.simulate(network, 10.0, record=path, **options)
    np.testing.assert_array_equal(ds.law_state, alone.law_state)


def test_a_balance_that_is_off_is_no_control():
    """Then what it would be regressed on is the plain mean."""
    moments, units = None, np.random.default_rng(1).normal(size=(2, 64))
    plain = Controls(moments, Mean(np.ones(64), True), np.zeros((2, 0, 64)), np.zeros((2, 0), dtype=bool))
    assert plain.with_balance(units + np.array([[0.0], [1.0]])).usable.tolist() == [[True], [False]]


def scores_of_pairs(number, seed):
    """Distances of fluxes and losses of random linear pairs from the law, in standard errors."""
    numbers, found = np.random.default_rng(seed), []
    for trial in range(number):
        stiffness, spring = numbers.uniform(0.5, 2.0, 2)
        damping, hot, cold = numbers.uniform(0.05, 0.3), *numbers.uniform(0.5, 4.0, 2)
        network = pair(hot, cold, stiffness, damping, spring)
        ds = il.simulate(network, 150.0, realizations=64, rng=seed + trial, record=il.EnergyFlows())
        expected = flux(hot - cold, 1.0, stiffness, damping, spring)
        losses = damping * np.array([hot, cold]) + [-expected, expected]
        for name, value in (
            ("coupling_power_carried", expected),
            ("power_dissipated", losses),
            ("power_balance", 0.0),
            ("network_power_balance", 0.0),
        ):
            found += np.ravel((ds[name].values - value) / ds[f"{name}_standard_error"].values).tolist()
    return np.array(found)


def covered(scores):
    """Part of the scores within the 95 % interval of Student's law, of 64 units."""
    return float(np.mean(np.abs(scores) < 2.0))


@pytest.mark.full
def test_errors_cover():
    scores = scores_of_pairs(25, 100)
    assert 0.89 < covered(scores) < 0.995
    assert 0.8 < np.std(scores) < 1.25


@pytest.mark.campaign
def test_errors_cover_in_many_networks():
    assert 0.93 < covered(scores_of_pairs(200, 1000)) < 0.97


@pytest.mark.campaign
def test_balances_cover_in_networks_of_all_kinds():
    """Two bodies that collide and are coupled in some way; short runs from other seeds.

    Two errors hold 95 %: within three errors of this share, of one independent number a run.
    """
    scores, runs = [], 16 * len(NETWORKS)
    for name in NETWORKS:
        for seed in range(16):
            ds = il.simulate(network_of(name), 60.0, realizations=64, rng=seed, record=il.EnergyFlows())
            error = ds.power_balance_standard_error.values
            scores += (ds.power_balance.values / error)[error > 1e-12].tolist()
    assert abs(covered(np.array(scores)) - 0.954) < 3.0 * np.sqrt(0.954 * 0.046 / runs)


@pytest.mark.full
def test_the_flux_of_a_harmonic_chain():
    """Eight unit masses on unit springs between walls and baths of unit friction: nearly ½ (3/2 − √5/2) ΔT."""
    names = [f"b{number}" for number in range(8)]
    ends = [il.WALL, *names, il.WALL]
    chain = il.Network(
        {name: il.LinearOscillator(damping=float(name in ("b0", "b7"))) for name in names},
        couplings={f"s{n}": il.Coupling(ends[n], ends[n + 1], il.LinearCoupling(1.0)) for n in range(9)},
        excitations={"b0": il.WhiteNoise(2.0 / np.pi), "b7": il.WhiteNoise(1.0 / np.pi)},
    )
    ds = il.simulate(chain, 300.0, realizations=128, rng=1, record=il.EnergyFlows())
    inner = ds.isel(coupling=slice(1, 8))
    assert score(inner, "coupling_power_carried", 0.5 * (1.5 - np.sqrt(5.0) / 2.0)) < 4.0
    assert float(inner.coupling_power_carried_standard_error.max()) < 0.01
    error = float(ds.temperature_standard_error.max())
    assert float(ds.temperature[0]) == pytest.approx(2.0 - 0.190983, abs=4.0 * error)
    assert float(ds.temperature[7]) == pytest.approx(1.0 + 0.190983, abs=4.0 * error)
