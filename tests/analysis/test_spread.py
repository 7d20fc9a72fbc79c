"""The spread of orbits under weak noise, against the stationary law and ensembles."""

import math

import numpy as np
import pytest

import impactlab as il
from impactlab.analysis.linear_orbits import method_of
from impactlab.analysis.near_returns import orbit_again
from impactlab.analysis.spread import _Parts

DENSITY = 1e-8


def stop(law, noise=None, gap=1.0, frequency=1.0, amplitude=1.0):
    force = il.Harmonic(amplitude=amplitude, frequency=frequency, phase=0.5 * math.pi)
    excitations = {"force": il.Source(force, on="a")}
    if noise:
        excitations["noise"] = il.Source(noise, on="a")
    return il.Network(
        oscillators={"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, law, clearance=gap)},
        excitations=excitations,
    )


RIGID = il.RigidContact(restitution=0.8)


def test_without_contact_it_is_the_stationary_law():
    """σ_v² = π S/(m c) and σ_x² = π S/(c k), at all phases."""
    found = il.orbit_spread(stop(RIGID, il.WhiteNoise(DENSITY), amplitude=0.01), il.orbits(stop(RIGID, amplitude=0.01)))
    known = math.sqrt(math.pi * DENSITY / 0.1)
    np.testing.assert_allclose(found["standard_deviation_displacement"], known, rtol=1e-10)
    np.testing.assert_allclose(found["standard_deviation_velocity"], known, rtol=1e-10)
    assert found.sizes["event"] == 0


@pytest.mark.full
@pytest.mark.parametrize("law", [RIGID, pytest.param(il.LinearContact(50.0), marks=pytest.mark.full)])
def test_ensembles_have_the_spread(law):
    orbit = il.orbits(stop(law))
    found = il.orbit_spread(stop(law, il.WhiteNoise(DENSITY)), orbit)
    start = {"displacement": {"a": orbit["displacement"].item()}, "velocity": {"a": orbit["velocity"].item()}}
    ensemble = il.simulate(
        stop(law, il.WhiteNoise(DENSITY)), duration=15 * orbit["period"].item(), realizations=2000, spin_up=0.0,
        initial=start, record=[il.FinalState()], rng=1, step=orbit["period"].item() / 800,
    )  # fmt: skip
    for quantity in ("displacement", "velocity"):
        spread = ensemble[f"final_{quantity}"].values[:, 0].std()
        assert spread == pytest.approx(found[f"standard_deviation_{quantity}"].values[0, 0], rel=4.0 / math.sqrt(4000))
        ends = found[f"standard_deviation_{quantity}"].values[[0, -1], 0]
        assert ends[0] == pytest.approx(ends[1], rel=1e-9)
    covariance = np.cov(ensemble["final_displacement"].values[:, 0], ensemble["final_velocity"].values[:, 0])
    known = found["covariance"].values[0]
    assert covariance[0, 1] == pytest.approx(known[0, 1], abs=0.1 * math.sqrt(known[0, 0] * known[1, 1]))


def test_impacts_scatter_in_time_and_velocity():
    """Deviations at the impact of all phases before it: the gap is 0 there, so its time scatters by σ_x/v."""
    orbit = il.orbits(stop(RIGID))
    found = il.orbit_spread(stop(RIGID, il.WhiteNoise(DENSITY)), orbit)
    place = int(found["event_time"].item() / (2.0 * math.pi) * 256)
    near = found["standard_deviation_displacement"].values[place, 0] / orbit["closing_velocity"].item()
    assert found["event_time_standard_deviation"].item() == pytest.approx(near, rel=0.05)
    assert found["closing_velocity_standard_deviation"].item() > 0.0


def test_what_is_refused():
    orbit = il.orbits(stop(RIGID))
    noise = il.WhiteNoise(DENSITY)
    with pytest.raises(il.InvalidInput, match="stationary white noises"):
        il.orbit_spread(stop(RIGID), orbit)
    with pytest.raises(il.InvalidInput, match="masses, laws or forces differ"):
        il.orbit_spread(stop(RIGID, noise, gap=0.9), orbit)
    with pytest.raises(il.InvalidInput, match="orbit must be a Dataset"):
        il.orbit_spread(stop(RIGID, noise), None)
    unstable = il.orbits(stop(RIGID, gap=0.0, frequency=2.8), periods=1)
    with pytest.raises(il.InvalidInput, match="grows without end"):
        il.orbit_spread(stop(RIGID, noise, gap=0.0, frequency=2.8), unstable)
    low = il.RigidContact(restitution=0.3)
    with pytest.raises(il.InvalidInput, match="contact that rests"):
        il.orbit_spread(stop(low, noise, 0.1, 0.4), il.orbits(stop(low, None, 0.1, 0.4)))


@pytest.mark.full
def test_what_is_refused_under_smooth_forces():
    hertz, noise = il.orbits(stop(il.HertzContact(50.0))), il.WhiteNoise(DENSITY)
    with pytest.raises(il.InvalidInput, match="masses, laws or forces differ"):
        il.orbit_spread(stop(il.HertzContact(50.0), noise, gap=0.9), hertz)
    with pytest.raises(il.InvalidInput, match="masses, laws or forces differ"):
        il.orbit_spread(stop(il.HertzContact(50.0), noise, amplitude=1.1), hertz)


def duffing(law, noise=None, cubic=0.0, gap=1.0, amplitude=1.0):
    """The same network, whose motion counts as smooth, with a cubic spring."""
    network = stop(law, noise, gap, amplitude=amplitude)
    return network.replace(oscillators={"a": il.DuffingOscillator(damping=0.1, stiffness=1.0, cubic=cubic)})


@pytest.mark.full
def test_under_smooth_forces_it_is_the_stationary_law():
    """As that of linear bodies, where a cubic spring has no stiffness."""
    quiet = il.orbits(duffing(il.HertzContact(50.0), amplitude=0.01))
    found = il.orbit_spread(duffing(il.HertzContact(50.0), il.WhiteNoise(DENSITY), amplitude=0.01), quiet)
    known = math.sqrt(math.pi * DENSITY / 0.1)
    np.testing.assert_allclose(found["standard_deviation_displacement"], known, rtol=1e-7)
    np.testing.assert_allclose(found["standard_deviation_velocity"], known, rtol=1e-7)


@pytest.mark.full
@pytest.mark.parametrize("law", [RIGID, il.LinearContact(50.0)])
def test_paths_tell_the_spread_that_matrices_tell(law):
    """Differences of paths under smooth forces, and saltation matrices of the same network as a linear one."""
    exact = il.orbit_spread(stop(law, il.WhiteNoise(DENSITY)), il.orbits(stop(law)))
    found = il.orbit_spread(duffing(law, il.WhiteNoise(DENSITY)), il.orbits(duffing(law)))
    for name, error in (
        ("standard_deviation_displacement", 1e-7), ("standard_deviation_velocity", 1e-7),
        ("event_time_standard_deviation", 1e-7), ("closing_velocity_standard_deviation", 1e-6),
    ):  # fmt: skip
        np.testing.assert_allclose(found[name], exact[name], rtol=error)
    assert found.attrs["largest_deviation"] == pytest.approx(exact.attrs["largest_deviation"], rel=1e-3)


@pytest.mark.full
def test_ensembles_have_the_spread_under_smooth_forces(tmp_path):
    law = il.HertzContact(50.0)
    orbit = il.orbits(duffing(law, cubic=0.5, gap=0.8))
    assert orbit["impacts"].item() == 1
    noisy = duffing(law, il.WhiteNoise(DENSITY), cubic=0.5, gap=0.8)
    found = il.orbit_spread(noisy, orbit)
    start = {"displacement": {"a": orbit["displacement"].item()}, "velocity": {"a": orbit["velocity"].item()}}
    ensemble = il.simulate(
        noisy, duration=12 * orbit["period"].item(), realizations=2000, spin_up=0.0, initial=start,
        record=[il.FinalState()], rng=1, step=orbit["period"].item() / 800,
    )  # fmt: skip
    for quantity in ("displacement", "velocity"):
        spread = ensemble[f"final_{quantity}"].values[:, 0].std()
        assert spread == pytest.approx(found[f"standard_deviation_{quantity}"].values[0, 0], rel=4.0 / math.sqrt(4000))
    il.save(found, tmp_path / "spread.nc")
    assert il.rerun(tmp_path / "spread.nc").drop_attrs().identical(found.drop_attrs())


@pytest.mark.parametrize("law", [RIGID, il.LinearContact(50.0), il.KelvinVoigtContact(stiffness=50.0, damping=3.0)])
def test_saltation_matrices_make_the_monodromy_matrix(law):
    """Their product with the motion between events is the derivative of the equations of the orbit."""
    method = method_of(stop(law))
    orbit = orbit_again(method, il.orbits(stop(law)), np.zeros(1))
    flow, _ = _Parts.of(method, orbit, np.zeros((1, 1))).over_a_period()
    np.testing.assert_allclose(flow, orbit.monodromy, atol=1e-12)


def test_rerun(tmp_path):
    noisy = stop(RIGID, il.WhiteNoise(DENSITY))
    found = il.orbit_spread(noisy, il.orbits(stop(RIGID), il.AtContact("stop", "leaving")))
    il.save(found, tmp_path / "spread.nc")
    assert il.rerun(tmp_path / "spread.nc").drop_attrs().identical(found.drop_attrs())
    assert il.network_of(tmp_path / "spread.nc") == noisy


def test_strong_noise_is_told():
    """Where a gap that stays open, or a closing velocity, is within five standard deviations of 0."""
    quiet = il.orbits(stop(RIGID, amplitude=0.09, gap=1.0))  # it nearly touches: its displacement is 0.9
    weak = il.orbit_spread(stop(RIGID, il.WhiteNoise(1e-6), amplitude=0.09), quiet)
    known = math.sqrt(math.pi * 1e-6 / 0.1) / 0.1
    assert weak.attrs["largest_deviation"] == pytest.approx(known, rel=1e-3)
    with pytest.warns(il.AccuracyWarning, match="The noise is strong: the standard deviation of the gap of 'stop'"):
        strong = il.orbit_spread(stop(RIGID, il.WhiteNoise(1e-4), amplitude=0.09), quiet)
    assert strong.attrs["largest_deviation"] == pytest.approx(10.0 * known, rel=1e-3)
    orbit = il.orbits(stop(RIGID))
    with pytest.warns(il.AccuracyWarning, match="the closing velocity of 'stop'"):
        il.orbit_spread(stop(RIGID, il.WhiteNoise(0.1)), orbit)
