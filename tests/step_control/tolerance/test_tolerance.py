"""An accuracy instead of a duration."""

import numpy as np
import pytest
from scenes import base

import impactlab as il
from impactlab.simulation import memory_use as memory
from impactlab.step_control.tolerance.pairs import _sees_other_forces

BODY = il.LinearOscillator(damping=1.0, stiffness=10.0)


@pytest.mark.campaign
def test_the_error_stays_within_the_tolerance():
    """In at most 5 % of the cases a statistic is further off than was asked for."""
    network, names = base(), ["mean_square_displacement", "contact_ratio"]
    exact = il.exact(network).statistics()
    beyond = 0
    for seed in range(40):
        result = il.simulate(network, tolerance=dict.fromkeys(names, 0.02), rng=seed)
        beyond += any((np.abs(result[name] / exact[name] - 1.0) > 0.02).any() for name in names)
        for name in names:
            error = np.abs(result[f"{name}_bias"]) + 2.0 * result[f"{name}_standard_error"]
            assert (error <= 0.02 * np.abs(result[name])).all()
    assert beyond <= 2


@pytest.mark.full
def test_a_smaller_tolerance_costs_more_realizations():
    coarse, fine = (il.simulate(base(), tolerance={"mean_square_velocity": value}, rng=1) for value in (0.02, 0.004))
    assert fine.attrs["realizations"] > coarse.attrs["realizations"]
    assert fine.attrs["attempts"] > 1
    assert il.rerun(fine).mean_square_velocity.equals(fine.mean_square_velocity)


def test_a_contact_that_was_not_seen_is_not_known():
    apart = base(clearance=5.0)
    with pytest.warns(il.AccuracyWarning, match=r"contact_ratio of 'gap' is up to inf times .* than can be foreseen"):
        result = il.simulate(apart, tolerance={"contact_ratio": 0.01}, duration=10.0, rng=1)
    assert result.attrs["error_over_tolerance"] == np.inf


def test_bodies_that_never_move_are_known():
    network = base().replace(oscillators={"still": BODY})
    result = il.simulate(network, tolerance={"mean_square_velocity": 0.05}, rng=1)
    assert result.mean_square_velocity.sel(oscillator="still") == 0.0


def test_a_zero_does_not_hide_what_is_not_known():
    network = il.Network({"a": BODY, "b": BODY}, {}, {"a": il.WhiteNoise(1.0)})
    with pytest.warns(il.AccuracyWarning, match=r"mean_velocity of 'a' .* s more; give a larger"):
        result = il.simulate(network, tolerance={"mean_velocity": 1e-9}, max_seconds=0.2, rng=1)
    assert result.attrs["error_over_tolerance"] > 1e3


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_a_run_that_drifts_reaches_no_tolerance():
    """A free body diffuses between distant walls for much longer than its velocity remembers."""
    sides = {
        "left": il.Contact(il.WALL, "a", il.HertzContact(1e4), clearance=5.0),
        "right": il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=5.0),
    }
    network = il.Network({"a": il.LinearOscillator(damping=10.0)}, sides, {"a": il.WhiteNoise(10.0 / np.pi)})
    with pytest.raises(il.InvalidInput, match="not stationary"):
        il.simulate(network, tolerance={"mean_square_displacement": 0.05}, rng=1)


def test_time_that_is_not_there_is_not_spent():
    with pytest.raises(il.InvalidInput, match=r"64 realizations of .* would take about .* s .* but 2 s are left"):
        il.simulate(
            base(), tolerance={"contact_ratio": 0.5}, integrator=il.EulerMaruyama(), duration=30.0, max_seconds=2, rng=1
        )


@pytest.mark.full
def test_what_the_time_allowed_for_is_returned_with_its_error():
    name, network = "mean_square_displacement", base()
    with pytest.warns(il.AccuracyWarning, match=rf"not reached in .* s: the error of {name} of 'two' is up to .* more"):
        result = il.simulate(network, tolerance={name: 1e-6}, max_seconds=1.0, rng=1)
    assert result.attrs["seconds_spent"] < 5.0
    assert result.attrs["realizations"] >= 256
    spent = (np.abs(result[f"{name}_bias"]) + 2.0 * result[f"{name}_standard_error"]) / (1e-6 * result[name])
    assert 1.0 < float(spent.max()) <= result.attrs["error_over_tolerance"]
    assert (np.abs(result[name] / il.exact(network).statistics()[name] - 1.0) < 4.0 * spent * 1e-6).all()


def test_what_the_memory_allowed_for_is_returned(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 3e6)
    with pytest.warns(il.AccuracyWarning, match="was not reached"):
        result = il.simulate(base(), tolerance={"mean_square_displacement": 1e-3}, rng=1)
    assert 256 < result.attrs["realizations"] < 2000
    assert result.attrs["error_over_tolerance"] > 1.0


@pytest.mark.full
def test_progress_is_that_of_the_accuracy():
    seen = []
    result = il.simulate(base(), tolerance={"mean_contact_force": 2e-3}, rng=1, progress=seen.append)
    assert result.attrs["attempts"] > 1
    assert seen == sorted(seen)
    assert seen[0] == 0.0
    assert seen[-1] == 1.0


@pytest.mark.parametrize(
    ("network", "tolerance", "message"),
    [
        (base(), {"mean_square_displacement": 0.0}, "larger than 0"),
        (base(), {"mean_square_displacement": -1.0}, "larger than 0"),
        (base(), {"mean_square_displacement": np.nan}, "finite"),
        (base(), {"mean_square_displacment": 0.1}, "did you mean 'mean_square_displacement'"),
        (base(), {"peak_contact_force": 0.1}, "grows with the observation time"),
        (base(), {}, "tolerance must be like"),
        (base(), 0.01, "tolerance must be a mapping"),
        (base().replace(excitations={"one": None, "two": None}), {"mean_square_velocity": 0.1}, "nothing is excited"),
        (il.Network({"a": BODY}, {}, {"a": il.WhiteNoise(1.0)}), {"contact_ratio": 0.1}, "no contact_ratio"),
        (
            il.Network({"a": il.LinearOscillator(stiffness=1.0)}, {}, {"a": il.WhiteNoise(1.0)}),
            {"mean_square_velocity": 0.1},
            "not damped",
        ),
        (
            il.Network({"a": il.LinearOscillator(damping=1.0)}, {}, {"a": il.WhiteNoise(1.0)}),
            {"mean_square_displacement": 0.1},
            "nothing confines",
        ),
    ],
)
def test_what_cannot_be_asked_for(network, tolerance, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(network, tolerance=tolerance, rng=1)


def test_duration_or_tolerance():
    with pytest.raises(il.InvalidInput, match="needs a duration"):
        il.simulate(base())


def test_runs_that_do_not_see_a_force_are_not_compared():
    """Two runs without the force of a wall had the same result, and a bias of 0 was accepted, 850 tolerances off."""
    wall = {"wall": il.Contact("a", il.WALL, il.LinearContact(100.0), clearance=0.5)}
    body = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
    network = il.Network({"a": body}, wall, {"a": il.WhiteNoise(0.2 / np.pi)})
    ds = il.simulate(network, 50.0, realizations=64, rng=1)
    name = "mean_contact_force"
    assert not _sees_other_forces(ds, ds)
    assert _sees_other_forces(ds, ds.assign({name: 1.5 * ds[name]}))
    without = ds.assign({name: 0.0 * ds[name]})
    with pytest.raises(il.InvalidInput, match=r"'wall' was closed in \d.* % of the time without any force"):
        _sees_other_forces(without, without)
