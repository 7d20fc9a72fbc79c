"""What is refused, warned of, or done in another way so that no valid scene ends without a word."""

import warnings

import numpy as np
import pytest
from scenes import base, linear

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.linear.cosine_series import Cosines, sample_count
from impactlab.linear.spectral_lines import Lines
from impactlab.linear.systems import LinearSystem, stationary
from impactlab.machine import tuned
from impactlab.simulation import growing_ensemble
from impactlab.simulation import memory_use as memory
from impactlab.step_control.rules import automatic
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies

# work and memory


def test_a_run_that_is_foreseen_to_take_too_long_is_refused():
    far = {"realizations": 64, "duration": 1e7, "rng": 1}
    with pytest.raises(il.InvalidInput, match=r"steps of 0\.006\d* s would take about .* s, but (5|4\.\d+) s are left"):
        il.simulate(base(), **far, max_seconds=5.0)
    with pytest.raises(il.InvalidInput, match="max_seconds must be larger than 0"):
        il.simulate(base(), **far, max_seconds=0.0)
    assert il.simulate(base(), 5.0, realizations=64, rng=1, max_seconds=600.0).sizes["oscillator"] == 2


def test_a_long_run_is_warned_of_before_it_begins(monkeypatch):
    monkeypatch.setattr(growing_ensemble, "LONG_TIME", 1e-6)
    with pytest.warns(il.ImpactLabWarning, match=r"would take about .* s\. Give max_seconds= to refuse"):
        il.simulate(base(), 5.0, realizations=64, rng=1)


def shaken(**fields):
    return linear().replace(excitations={"a": il.ShinozukaNoise(1.0, **fields)})


def test_time_and_memory_of_series_are_foreseen(monkeypatch):
    network = shaken(band=(0.1, 20.0), components=3333, allow_repeat=True)  # no grid: a chirp for each realization
    with pytest.raises(il.InvalidInput, match="would take about"):
        il.simulate(network, 1e4, step=0.01, realizations=10000, rng=1, max_seconds=10.0)
    monkeypatch.setattr(memory, "available", lambda: 5e7)
    with pytest.raises(il.InvalidInput, match=r"GB of memory \("):
        il.simulate(network, 1e4, step=0.01, realizations=4, rng=1)


def test_memory_of_histograms_is_foreseen(monkeypatch):
    """Every block counts for itself, in up to 256 groups."""
    monkeypatch.setattr(memory, "available", lambda: 1e9)
    many = {"duration": 1.0, "realizations": 2000, "rng": 1}
    for record in (il.JointDensity("one", "two", bins=400), il.Density(bins=100_000)):
        with pytest.raises(il.InvalidInput, match=r"would take [2-4](\.\d+)? GB of memory .*or smaller records"):
            il.simulate(base(), **many, record=record)
    with pytest.raises(il.InvalidInput, match=r"would take [\d.]+e\+0\d GB of memory"):
        il.simulate(base(), **many, record=il.JointDensity("one", "two", bins=10**6))


def test_counts_of_blocks_are_added_as_they_finish(monkeypatch):
    """So that those of the blocks that run, and one sum, are in memory; in any order they are the same numbers."""
    records = [il.Density(bins=30), il.Density("velocity", bins=30), il.JointDensity("one", "two", bins=10)]
    run = {"duration": 1.0, "realizations": 64, "rng": 1, "record": records}
    whole = il.simulate(base(), **run)
    seen = []
    usual = growing_ensemble.run
    monkeypatch.setattr(growing_ensemble, "run", lambda *arguments: seen.extend(usual(*arguments)) or seen)
    with tuned(lanes=8):
        parts = il.simulate(base(), **run)
    assert len(seen) == 8
    assert [["counts" in kept for kept in result.records] for result in seen] == [[True] * 3] + [[False] * 3] * 7
    for name in ("density_displacement", "density_velocity", "joint_density", "joint_density_standard_error"):
        np.testing.assert_array_equal(parts[name], whole[name])


# series


def test_little_of_a_long_period_is_sampled_without_all_of_it(monkeypatch):
    """The values are those of the FFT of a whole period, which would take a terabyte at a small step."""
    lines = Lines((0,), "a", *il.ShinozukaNoise(1.0, band=(0.0, 1.0), components=20).lines())
    short = Cosines((1, 2), lines, np.ones((1, 20)), False, 1e-3, 50)
    whole = Cosines((1, 2), lines, np.ones((1, 20)), False, 1e-3)
    few, all_of_it = np.empty((1, 50)), np.empty((1, 20000))
    short.sample(0, 0, few)
    whole.sample(0, 0, all_of_it)
    np.testing.assert_allclose(few, all_of_it[:, :50], rtol=0.0, atol=1e-10 * np.abs(all_of_it).max())
    np.testing.assert_allclose(short.start(0, 0), whole.start(0, 0), rtol=1e-12)
    assert sample_count((lines,), 1e-3, 50) == 50
    monkeypatch.setattr(np.fft, "irfft", None)  # nothing of the length of a period
    Cosines((1, 2), lines, np.ones((1, 20)), False, 1e-12, 50).sample(0, 0, few)
    assert np.ptp(few) < 1e-6 * np.abs(few).max()


def test_lines_anywhere_are_summed_some_samples_at_a_time():
    lines = Lines((0,), "a", np.array([1.0, 2.5, 7.1]), np.ones(3))
    cosines = Cosines((1, 2), lines, np.ones((1, 3)), False, 0.01)
    at_once, in_parts = np.empty((2, 1, 2000))
    cosines.sample(0, 0, at_once)
    with tuned(cosines=6.0):
        cosines.sample(0, 0, in_parts)
    np.testing.assert_allclose(in_parts, at_once, rtol=0.0, atol=1e-12)


def test_overdamped_bodies_under_series_are_stepped_through_their_friction():
    """Velocities at kicks would miss what decays between them; white noise is averaged over the step."""

    def step(network):
        model = Model.of(network)
        stiffening = Stiffening.of(model, energies(model, "stationary", 100.0))
        return automatic.choose_step(model, ExactFlow(), stiffening, None), model

    heavy = il.LinearOscillator(mass=1.0, damping=2000.0, stiffness=1e4)
    noise = {"one": il.ShinozukaNoise(1600.0, band=(0.0, 32.0), components=400)}
    overdamped = base().replace(oscillators={"one": heavy})
    shaken_step, model = step(overdamped.replace(excitations=noise))
    assert shaken_step == pytest.approx(3.0 / 2000.0) == automatic.series_step(model)
    assert step(overdamped)[0] > 2.0 * shaken_step
    lightly = {"one": il.ShinozukaNoise(16.0, band=(0.0, 32.0), components=400)}
    assert step(base(excitations=lightly))[0] == pytest.approx(step(base())[0], rel=0.1)


@pytest.mark.full
def test_contacts_that_never_close_leave_the_step_as_it_is():
    """At the edge of what a number can hold, 10^-308 closings a second."""
    apart = [base(clearance=d).check().dataset.attrs["step"] for d in np.arange(9.0, 10.0, 0.02)]
    assert np.ptp(apart) == 0.0


# linear laws


def test_a_linear_law_of_rates_far_apart_is_known_in_any_units():
    """A light body on a hard spring to a heavy one: at equal temperature T each velocity has T/m, each spring T."""
    mass, own = np.array([1e-6, 1e3]), np.array([1e-9, 1e-3])
    spring = 1e6 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness, damping = spring + np.diag([0.0, 1.0]), np.diag([1e-4, 1.0])
    system = LinearSystem(mass, damping, stiffness, 2.0 * damping / np.pi)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        covariance = system.covariance
    assert (own > 0.0).all()
    np.testing.assert_allclose(np.diag(covariance)[2:], 2.0 / mass, rtol=1e-4)
    assert covariance[1, 1] == pytest.approx(2.0, rel=1e-4)
    beyond = LinearSystem(mass, np.diag([1e-4, 1e-9]), stiffness, np.eye(2))
    assert beyond.covariance is None


def test_a_discrete_law_is_a_sum_of_powers():
    a, q = np.array([[0.9, 0.3], [-0.2, 0.8]]), np.diag([1.0, 1e-12])
    found = stationary(a, q)
    np.testing.assert_allclose(a @ found @ a.T + q, found, rtol=1e-12)
    assert np.isinf(stationary(1.2 * np.eye(2), q)).all()
    assert np.isinf(stationary(np.full((2, 2), np.nan), q)).all()
    assert stationary(np.eye(2) * (1.0 - 1e-9), np.eye(2))[0, 0] == pytest.approx(5e8, rel=1e-6)


# balances


def test_a_balance_that_is_off_is_told_without_a_spin_up_too():
    """The halves of so short a run hardly differ, but its balances are far from closed."""
    pressed = base(clearance=-0.1)
    with pytest.warns(il.AccuracyWarning, match=r"balance_mean_displacement of 'two' is [\d.]+ standard errors off 0"):
        il.simulate(pressed, 0.025, realizations=512, rng=1, spin_up=0.0)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*too seldom")  # a given start is no stationary motion
        il.simulate(pressed, 0.025, realizations=512, rng=1, initial={"velocity": {"two": 0.0}}, spin_up=0.0)


# inputs


def network_of_noise(**fields):
    return {"network": base(), "duration": 2.0, "realizations": 64, "rng": 1, **fields}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": 1e308}, r"1e\+308 s has too many steps of"),
        ({"duration": 5e-324}, r"4\.94066e-324 s is too short for steps of"),
        ({"duration": 1e-200, "spin_up": 0.0}, r"1e-200 s is too short for steps"),
        ({"step": 5e-324}, r"too many steps"),
        ({"duration": 10**400}, r"duration must be a finite number, not 1000.*0000"),
        ({"record": 5}, r"record must be a list of il.Records.* not 5"),
        ({"record": True}, r"record must be a list of il.Records"),
        ({"record": {"a": il.Density()}}, r"record must be a list of il.Records"),
        ({"rng": True}, r"rng must be None, a whole number .*, not True"),
        ({"progress": "no"}, r"progress must be true or false, a function or None, not 'no'"),
        ({"progress": 5}, r"progress must be"),
        ({"duration": None, "tolerance": {"contact_ratio": 5.0}}, r"larger than 0 and at most 1, not 5\.0"),
    ],
    ids=str,
)
def test_input_that_cannot_be_meant(options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(**network_of_noise(**options))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: il.LinearOscillator(mass=10**400), r"mass must be a finite number"),
        (lambda: il.Density(limits=1.0), r"Limits are \(low, high\)"),
        (
            lambda: il.Network({"a": il.LinearOscillator(), "a\0": il.LinearOscillator()}),
            r"not contain control characters, as does 'a\\x0",
        ),
        (lambda: il.Network({"a\ud800": il.LinearOscillator()}), r"not contain control characters"),
        (lambda: il.Density(oscillators={"one"}), r"oscillators must be a list of strings"),
        (lambda: il.Density(oscillators="one"), r"oscillators must be a list of strings"),
        (lambda: il.Network.from_dict(5), r"must be a mapping, not 5"),
        (lambda: il.run_study("two-system", out=5), r"out must be a path, not 5"),
        (lambda: il.run_study("two-system", settings=[1]), r"settings must be a mapping"),
    ],
)
def test_parts_that_cannot_be_meant(make, message):
    with pytest.raises(il.InvalidInput, match=message):
        make()


def test_names_in_any_script_are_names():
    assert list(il.Network({"Ω₁ ölig\u00a0é": il.LinearOscillator()}).oscillators) == ["Ω₁ ölig\u00a0é"]
