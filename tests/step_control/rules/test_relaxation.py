"""Start, spin-up and batches of networks whose slowest relaxation is not that of a linear damper."""

import math
import warnings
from itertools import pairwise

import numpy as np
import pytest
from impactlab_numerics.laws.oscillators import ViscousOscillator
from laws import DoubleWell

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.damping import damped
from impactlab.step_control.rules.relaxation import Relaxation, undamped, without_dampers
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies


class Cycle(il.Oscillator):
    """Drives slow motion and damps fast motion, so that the density of (x, v) is known."""

    drive: float = il.parameter(units="N s m-1")
    limit: float = il.parameter(units="N s m-3")

    @staticmethod
    def residual(displacement, velocity, drive, limit):
        return (limit * (displacement * displacement + velocity * velocity) - drive) * velocity


def alone(body, intensity):
    return il.Network({"a": body}, {}, {"a": il.WhiteNoise(intensity)})


def relaxation_of(network):
    model = Model.of(network)
    return Relaxation.of(model, Stiffening.of(model, energies(model, "stationary", 100.0)))


def between(mass, temperatures=(2.0, 0.5)):
    """A heavy body that only collisions heat, between two thermostats."""
    end = il.LinearOscillator(mass=1.0, damping=0.5, stiffness=1.0)
    law = il.HertzContact(100.0)
    return il.Network(
        {"hot": end, "ball": il.LinearOscillator(mass=mass, stiffness=mass), "cold": end},
        {"l": il.Contact("hot", "ball", law, clearance=1.0), "r": il.Contact("ball", "cold", law, clearance=1.0)},
        dict(zip(("hot", "cold"), (il.WhiteNoise(0.5 * t / np.pi) for t in temperatures), strict=True)),
    )


# damping in residual forces


def test_a_damper_that_is_a_residual_force_counts_as_one():
    network = alone(ViscousOscillator(viscous=0.3, damping=0.1, stiffness=1.0), 0.4 / np.pi)
    for model in damped(Model.of(network)):
        assert model.damping[0] == pytest.approx(0.4, rel=1e-6)
    assert relaxation_of(network).linear == pytest.approx(5.0, rel=1e-6)


@pytest.mark.full
@pytest.mark.parametrize("drive", [-0.2, 0.1, 0.3])
def test_self_excited_motion_has_a_temperature_and_a_spin_up(drive):
    """The density is exp((drive r²/2 − limit r⁴/4) / πS); until now the run began at rest, without a spin-up."""
    limit, diffusion = 0.2, math.pi * 0.02
    network = alone(Cycle(drive=drive, limit=limit, stiffness=1.0), 0.02)
    radius = np.linspace(0.0, 4.0, 4001)
    density = radius * np.exp((0.5 * drive * radius**2 - 0.25 * limit * radius**4) / diffusion)
    exact = 0.5 * (density @ radius**2) / density.sum()
    energy = energies(Model.of(network), "stationary", 100.0)[0]
    assert 0.5 * exact < energy < 2.0 * exact
    ds = il.simulate(network, 200.0, realizations=128, step=0.05, rng=1)
    assert 20.0 < ds.attrs["spin_up"] < 200.0
    assert abs(ds.mean_square_displacement[0] - exact) < 3.0 * ds.mean_square_displacement_standard_error[0]


@pytest.mark.full
def test_check_simulate_and_tolerance_agree_on_what_damps_a_body():
    cycle = alone(Cycle(drive=0.1, limit=0.2, stiffness=1.0), 0.02)
    assert np.isfinite(cycle.check().dataset.attrs["step"])
    ds = il.simulate(cycle, tolerance={"mean_square_displacement": 0.05}, step=0.05, rng=1)
    assert ds.attrs["spin_up"] > 0.0
    heated = alone(ViscousOscillator(viscous=0.0, stiffness=1.0), 0.02)
    assert undamped(Model.of(heated)).all()
    with pytest.raises(il.InvalidInput, match="not damped"):
        il.simulate(heated, tolerance={"mean_square_displacement": 0.05}, rng=1)


def test_damping_by_laws_alone_is_said_not_to_be_known():
    wall = il.Contact("a", il.WALL, il.KelvinVoigtContact(100.0, damping=1.0), clearance=0.1)
    network = alone(il.LinearOscillator(mass=1.0, stiffness=1.0), 0.1).replace(contacts={"w": wall})
    heated, by_laws = without_dampers(Model.of(network))
    assert heated.all()
    assert by_laws.all()
    with pytest.warns(il.AccuracyWarning, match="'a' is excited and damped by contacts or couplings only"):
        il.simulate(network, 5.0, realizations=64, rng=1)


# collisions


@pytest.mark.parametrize("mass", [30.0, 1000.0])
def test_a_body_between_two_temperatures_starts_between_them(mass):
    """Long runs have 1.42 to 1.59 J; at the highest temperature, 2 J, a heavy body would stay for the whole run."""
    relaxed = relaxation_of(between(mass))
    assert 1.35 < relaxed.temperature[1] < 1.65
    assert np.isnan(relaxed.temperature[[0, 2]]).all()
    assert 0.5 * mass < relaxed.settling < 20.0 * mass  # contact rate · 4 m/M


def test_a_spin_up_is_as_long_as_collisions_take():
    ds = il.simulate(between(30.0), 50.0, realizations=1024, rng=1)
    assert ds.attrs["spin_up"] > 150.0
    temperature, error = 30.0 * ds.mean_square_velocity[1], 30.0 * ds.mean_square_velocity_standard_error[1]
    assert abs(temperature - 1.5467) < 3.0 * np.hypot(error, 0.0289)


def test_a_spin_up_that_would_take_too_long_is_said():
    with pytest.warns(il.AccuracyWarning, match=r"'ball' gets its energy from collisions alone.*spin_up=\d"):
        il.simulate(between(1e4), 50.0, realizations=64, rng=1)


def test_equal_temperatures_need_no_longer_spin_up():
    relaxed = relaxation_of(between(1000.0, (1.0, 1.0)))
    assert relaxed.settling == 0.0
    assert relaxed.temperature[1] == 1.0
    assert relaxed.slowest > 100.0 * relaxed.linear  # but batches have to be long


def test_a_crowded_row_without_damping_does_not_start_cold():
    """Its contacts are closed in every draw: 15 % of the temperature were missing in the middle."""
    count = 17
    names = [f"b{k:02d}" for k in range(count)]
    bodies = {
        name: il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.1 if name in (names[0], names[-1]) else 0.0)
        for name in names
    }
    pairs = pairwise(names)
    contacts = {f"{a}{b}": il.Contact(a, b, il.HertzContact(100.0), clearance=0.1) for a, b in pairs}
    noise = il.WhiteNoise(0.1 / np.pi)
    network = il.Network(bodies, contacts, {names[0]: noise, names[-1]: noise})
    with pytest.warns(il.AccuracyWarning, match="gets its energy from collisions alone"):
        ds = il.simulate(network, 100.0, realizations=128, rng=1)
    assert 0.95 < float(ds.mean_square_velocity.mean()) < 1.05


# barriers


def test_the_time_between_changes_of_wells_is_that_of_kramers():
    """γ = 0.5, T = 0.08, barrier 0.25 J: the rate out of a well is 0.0082 ± 0.0005 (256 trajectories)."""
    time = relaxation_of(alone(DoubleWell(depth=0.25, damping=0.5), 0.08 * 0.5 / np.pi)).slowest
    assert 0.7 < time * 0.0082 < 1.4


@pytest.mark.full
@pytest.mark.parametrize(("tilt", "warned"), [(0.0, False), (0.3, True)])
def test_wells_of_different_depth_need_time(tilt, warned):
    network = alone(DoubleWell(depth=8.0, tilt=tilt, damping=1.0), 1.0 / np.pi)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        il.simulate(network, 20.0, realizations=64, step=0.02, rng=1)
    assert any("wells of different depth" in str(item.message) for item in caught) == warned
    assert len(caught) == warned


@pytest.mark.full
def test_a_realization_that_never_changes_wells_has_no_error_bars():
    """One of 4000 s said E[x] = −0.9727 ± 0.0004 m, where it is 0."""
    network = alone(DoubleWell(depth=8.0, damping=1.0), 1.0 / np.pi)
    with pytest.warns(il.AccuracyWarning, match=r"run for at least \de\+06 s|run for at least \d\.\d+e\+06 s"):
        ds = il.simulate(network, 2000.0, step=0.02, rng=1)
    assert np.isnan(ds.mean_displacement_standard_error).all()


# free detectors


def touching_a_wall(damping=0.2):
    body = il.LinearOscillator(mass=1.0, damping=damping, stiffness=1.0)
    wall = il.Contact("a", il.WALL, il.LinearContact(100.0), clearance=0.5)
    return il.Network({"a": body}, {"wall": wall}, {"a": il.WhiteNoise(damping / np.pi)})


def test_heat_that_the_step_makes_is_a_number_of_every_run():
    ds = il.simulate(touching_a_wall(), 100.0, realizations=512, rng=1)
    assert abs(ds.attrs["step_heating"]) < 0.005
    assert 0.0 < ds.attrs["step_heating_standard_error"] < 0.005


def test_a_step_that_heats_is_said():
    method, said = (
        il.ExactFlow(measured=False),
        r"Friction takes \d(\.\d)? ± 0\.\d % more heat .* step may be too large",
    )
    with pytest.warns(il.AccuracyWarning, match=said):
        ds = il.simulate(touching_a_wall(), 100.0, realizations=512, step=0.14, integrator=method, rng=1)
    assert ds.attrs["step_heating"] == pytest.approx(float(ds.mean_square_velocity[0]) - 1.0, abs=2e-3)


def test_a_run_of_one_realization_that_drifts_is_seen():
    body = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
    ds = il.simulate(alone(body, 0.1), 64 * 201.0, rng=1)
    assert 0.0 <= ds.attrs["drift"] < 4.0


@pytest.mark.full
@pytest.mark.parametrize("damping", [100.0, 400.0, 2000.0])
def test_friction_within_a_step_does_not_count_kicks_twice(damping):
    """E[v²] was 0.13 and 0.27 % too large at ``c h/m`` of 6.7 and 33."""
    law = il.HertzContact(1e3)
    walls = {
        "up": il.Contact("a", il.WALL, law, clearance=0.1),
        "down": il.Contact(il.WALL, "a", law, clearance=0.1),
    }
    network = il.Network({"a": il.LinearOscillator(damping=damping)}, walls, {"a": il.WhiteNoise(damping / np.pi)})
    ds = il.simulate(network, 200.0, realizations=64, rng=1)
    error = float(ds.mean_square_velocity_standard_error[0])
    assert abs(float(ds.mean_square_velocity[0]) - 1.0) < 5e-4 + 3.0 * error
    assert abs(ds.attrs["step_heating"]) < 1e-3
