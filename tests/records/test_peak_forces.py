"""Largest forces in windows, rates of crossings and return levels, against exact ones."""

import numpy as np
import pytest
from scenes import base, linear
from scipy.integrate import quad
from scipy.optimize import brentq

import impactlab as il
from impactlab.machine import SharedThreads

T, STIFFNESS, CLEARANCE = np.pi * 16.0 / (0.2 * 32.0 * np.pi), 1e4, 0.05  # of scenes.base(), with unit masses


def weight(depth):
    """Density of the gap, not normalised: springs, at the temperature T, and the contact."""
    variance = T * (1.0 / (32.0 * np.pi) ** 2 + 1.0 / (2.0 * np.pi) ** 2)
    potential = 0.4 * STIFFNESS * max(depth, 0.0) ** 2.5
    return np.exp(-((depth + CLEARANCE) ** 2) / (2.0 * variance) - potential / T)


TOTAL = quad(weight, -4.0, 0.0, limit=400)[0] + quad(weight, 0.0, 0.5, limit=400, points=[0.05])[0]


def crossings(depth):
    """Rice's rate of crossings of an indentation, sqrt(T/(2πμ)) p(δ) with 1/μ = 2."""
    return np.sqrt(T / np.pi) * weight(depth) / TOTAL


def force_of(time):
    return STIFFNESS * brentq(lambda depth: np.log(crossings(depth) * time), 0.0, 0.5) ** 1.5


@pytest.fixture(scope="module")
def run():
    """At half the automatic step, where the rates are known to half a percent."""
    record = [il.PeakForces(window=5.0, bins=50, return_times=(2.0, 20.0, 1e9)), il.PerRealization()]
    return il.simulate(base(), 50.0, realizations=512, step=0.003, record=record, rng=1)


def test_rates_of_crossings_are_the_exact_ones(run):
    depth = run.crossing_indentation.values[0]
    half = 0.5 * (depth[1] - depth[0])
    exact = np.array([quad(crossings, at - half, at + half)[0] / (2.0 * half) for at in depth])
    rate, error = run.crossing_rate.values[0], run.crossing_rate_standard_error.values[0]
    known = rate > 10.0 * error
    assert known.sum() > 20
    score = (rate - exact)[known] / np.hypot(error, 0.01 * exact)[known]
    assert np.abs(score).max() < float(run.crossing_rate_band_factor[0]) + 0.5
    assert float(run.crossing_rate_band_factor[0]) == pytest.approx(3.3, abs=0.3)
    seen = np.isfinite(run.crossing_force.values[0])
    np.testing.assert_allclose(run.crossing_force.values[0, seen], STIFFNESS * depth[seen] ** 1.5, rtol=0.2)
    np.testing.assert_allclose(run.crossing_force.values[0, 5:30], STIFFNESS * depth[5:30] ** 1.5, rtol=0.01)


def test_return_levels_are_the_exact_ones(run):
    level, error = run.return_level.values[0], run.return_level_standard_error.values[0]
    for row, time in enumerate((2.0, 20.0)):
        assert abs(level[row] - force_of(time)) < 3.0 * error[row] + 0.002 * level[row]
        assert error[row] < 0.02 * level[row]
    assert np.isnan(level[2])  # far beyond what was observed
    assert np.isnan(error[2])


@pytest.mark.campaign
def test_errors_of_return_levels_cover():
    """60 runs; the standard error of the scatter is 9 %, that of the share 3 %."""
    expected, scores = force_of(2.0), []
    for rng in range(60):
        record = il.PeakForces(return_times=(2.0,))
        ds = il.simulate(base(), 20.0, realizations=128, step=0.004, record=record, rng=rng)
        scores.append(float((ds.return_level[0, 0] - expected) / ds.return_level_standard_error[0, 0]))
    assert 0.75 < np.std(scores) < 1.3
    assert np.mean(np.abs(scores) < 2.0) >= 0.87
    assert abs(np.mean(scores)) < 0.5  # which is 0.6 % of the level


@pytest.mark.full
@pytest.mark.parametrize("clearance", [-0.5, 0.2])
@pytest.mark.parametrize("law", [il.LinearContact(50.0), il.HertzContact(100.0)], ids=["linear", "Hertz"])
def test_return_levels_of_short_times(law, clearance):
    """Where the rate hardly depends on the force."""
    body = il.LinearOscillator.from_frequency(1.0, 0.1)
    network = il.Network(
        {"a": body}, {"w": il.Contact("a", il.WALL, law, clearance=clearance)}, {"a": il.WhiteNoise(0.2 / np.pi)}
    )
    exact = il.exact(network)
    shortest = 1.0 / max(exact.crossing_rate("w", "contact_force", force) for force in np.linspace(0.01, 20.0, 200))
    times = tuple(shortest * factor for factor in (0.9, 1.05, 1.2, 1.5, 2.0, 3.0, 5.0))
    record = il.PeakForces(return_times=times)
    ds = il.simulate(network, 200.0, realizations=2048, record=record, rng=1)
    level, error = ds.return_level.values[0], ds.return_level_standard_error.values[0]
    assert np.isnan(level[0])
    assert np.isfinite(level[2:]).all()
    expected = np.array([exact.return_level("w", "contact_force", time) for time in times[1:]])
    score = np.abs(level[1:] - expected) / error[1:]
    assert np.nanmax(score) < 3.0
    assert (error[4:] < 0.01 * level[4:]).all()


@pytest.mark.full
def test_crossings_of_a_body_between_two_closed_contacts():
    law = il.HertzContact(1e4)
    contacts = {"u": il.Contact("a", il.WALL, law, clearance=-0.1), "l": il.Contact(il.WALL, "a", law, clearance=-0.1)}
    network = il.Network({"a": il.LinearOscillator(damping=1.0)}, contacts, {"a": il.WhiteNoise(1.0)})
    ds = il.simulate(network, 100.0, realizations=512, record=il.PeakForces(bins=40), rng=1)
    exact, depth = il.exact(network), ds.crossing_indentation.values[0]
    rate, error = ds.crossing_rate.values[0], ds.crossing_rate_standard_error.values[0]
    most = np.argmax(rate)
    near = slice(most - 1, most + 2)
    expected = [exact.crossing_rate("u", "contact_force", 1e4 * at**1.5) for at in depth[near]]
    assert rate[near].sum() == pytest.approx(sum(expected), abs=3.0 * error[near].sum() + 0.003 * sum(expected))


def test_limits_that_cannot_be_foreseen_are_asked_for():
    class Late(il.Excitation):
        amplitude: float = il.parameter(units="N")

        @staticmethod
        def force(time, amplitude):
            return amplitude if time > 300.0 else 0.0

    network = base(excitations={"one": None, "two": Late(1.0)})
    with pytest.raises(il.InvalidInput, match=r"indentation of 'gap' cannot be estimated .* give limits=\{'gap': …\}"):
        il.simulate(network, 1.0, realizations=1, record=il.PeakForces())


def test_windows_hold_the_largest_forces(run):
    peaks = run.window_peak_force
    assert dict(peaks.sizes) == {"realization": 512, "window": 10, "contact": 1}
    assert float(run.peak_window) == pytest.approx(5.0, rel=1e-3)
    np.testing.assert_array_equal(peaks.max("window"), run.peak_contact_force_by_realization)
    for time in (2.0, 20.0):
        force = force_of(time)
        share = float((peaks > force).mean())
        assert share < 1.1 * 5.0 / time  # the bound: hardly any window begins above this force
        assert share > 0.5 * (1.0 - np.exp(-5.0 / time))


def test_one_window_is_the_whole_run():
    ds = il.simulate(base(), 5.0, realizations=64, rng=1, record=il.PeakForces())
    assert float(ds.window_peak_force.mean()) == pytest.approx(float(ds.peak_contact_force[0]), rel=1e-12)
    assert float(ds.peak_window) == pytest.approx(5.0)
    np.testing.assert_allclose(ds.return_time, [5.0, 50.0, 500.0])


def test_walls_on_both_sides_are_mirror_images():
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)
    sides = {
        "right": il.Contact("a", il.WALL, il.LinearContact(400.0), clearance=0.1),
        "left": il.Contact(il.WALL, "a", il.LinearContact(400.0), clearance=0.1),
    }
    network = il.Network({"a": body}, sides, {"a": il.WhiteNoise(1.0)})
    ds = il.simulate(network, 100.0, realizations=256, rng=1, record=il.PeakForces(bins=20, contacts=("left", "right")))
    rate, error = ds.crossing_rate.values, ds.crossing_rate_standard_error.values
    known = (rate > 10.0 * error).all(axis=0)
    assert known.sum() > 8
    assert (np.abs(rate[0] - rate[1])[known] < 4.0 * np.hypot(*error)[known]).all()
    # each crosses the point of contact as often as it closes
    np.testing.assert_allclose(rate[:, 0], ds.contact_rate, rtol=0.05)


def test_a_record_of_one_contact_leaves_the_others_out_and_is_made_again():
    row = il.chain(3, il.LinearOscillator(damping=0.4, stiffness=40.0), il.HertzContact(1e4), clearance=0.02,
                   excitation=il.WhiteNoise(1.0))  # fmt: skip
    ds = il.simulate(
        row, 5.0, realizations=64, rng=1, record=il.PeakForces(contacts=("contact_1",), limits=0.1, bins=10)
    )
    assert np.isnan(ds.crossing_rate.sel(contact="contact_0")).all()
    assert float(ds.crossing_indentation.sel(contact="contact_1")[-1]) == pytest.approx(0.095)
    again = il.rerun(ds)
    for name in ("crossing_rate", "window_peak_force", "return_level"):
        np.testing.assert_array_equal(again[name], ds[name])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 20.0}, r"window of 20 s is longer than the duration of 5 s"),
        ({"contacts": ("hole",)}, r"no contact 'hole'"),
        ({"contacts": "gap"}, r"a list of strings"),
        ({"limits": {"gap": -1.0}}, r"largest indentation of 'gap' must be more than 0 m"),
        ({"limits": (0.0, 1.0)}, r"limits is a number or \{name: number\}"),
        ({"limits": {"hole": 1.0}}, r"no contact 'hole'"),
        ({"return_times": (0.0,)}, r"return_times must be larger than 0 s"),
    ],
)
def test_bad_input_is_refused(options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(base(), 5.0, realizations=64, rng=1, record=il.PeakForces(**options))


def test_limits_by_name_are_a_value():
    one, other = (il.PeakForces(limits={"gap": 0.2}) for _ in range(2))
    assert hash(one) == hash(other)
    assert il.Record.from_dict(one.to_dict()) == one


def test_a_network_without_contacts_has_no_peaks():
    ds = il.simulate(linear(), 5.0, realizations=64, rng=1, record=il.PeakForces())
    assert "crossing_rate" not in ds


@pytest.mark.full
@pytest.mark.parametrize(("realizations", "duration"), [(300, 4.0), (10, 300.0)], ids=["realizations", "batches"])
def test_numbers_do_not_depend_on_the_blocks(realizations, duration):
    """Groups hold realizations of several blocks; sums of spectra and crossings are those of one block, bit for bit."""
    records = [
        il.PeakForces(window=1.0),
        il.Spectrum("contact_force", segment=2.0),
        il.Spectrum("velocity", segment=2.0),
    ]
    options = {"realizations": realizations, "rng": 1, "record": records}
    with SharedThreads(1, 1) as one, SharedThreads(5, 1) as many:
        whole, parts = (il.simulate(base(), duration, executor=pool, **options) for pool in (one, many))
    for name in whole.data_vars:
        np.testing.assert_array_equal(parts[name], whole[name], err_msg=name)


def test_what_would_not_fit_into_memory_is_refused(monkeypatch):
    monkeypatch.setattr("impactlab.simulation.memory_use.available", lambda: 1e8)
    options = {"realizations": 64, "rng": 1}
    assert "crossing_rate" in il.simulate(base(), 5.0, record=il.PeakForces(), **options)
    with pytest.raises(il.InvalidInput, match=r"GB of memory .* or smaller records"):
        il.simulate(base(), 5.0, record=il.PeakForces(bins=10**5), **options)
    with pytest.raises(il.InvalidInput, match="GB of memory"):
        il.simulate(linear(), 5e4, record=il.Spectrum(segment=5e4), **options)


def stop(law, realizations, duration, record, **options):
    body = il.LinearOscillator.from_frequency(2.0, 0.05)
    network = il.Network({"a": body}, {"c": il.Contact("a", il.WALL, law, clearance=0.1)}, {"a": il.WhiteNoise(0.05)})
    return il.simulate(network, duration, realizations=realizations, record=record, rng=1, **options)


@pytest.mark.full
@pytest.mark.parametrize(
    "law", [il.KelvinVoigtContact(200.0, damping=5.0), il.HuntCrossleyContact(400.0, dissipation=1.0)], ids=["KV", "HC"]
)
def test_peaks_of_dashpots_are_read_between_steps(law):
    """Window by window as those of the whole run, and at other steps the same."""
    record = [il.PeakForces(window=10.0, return_times=(30.0, 100.0, 300.0)), il.PerRealization()]
    runs = [stop(law, 512, 100.0, record, step=step) for step in (0.035, 0.009)]
    for ds in runs:
        whole = ds.window_peak_force.max("window")
        assert float((whole <= ds.peak_contact_force_by_realization).mean()) == 1.0
        assert float((whole == ds.peak_contact_force_by_realization).mean()) > 0.98  # the rest after the last window
    largest = [ds.window_peak_force.mean(("window", "contact")) for ds in runs]
    scatter = np.hypot(*(item.std() / np.sqrt(512.0) for item in largest))
    assert abs(largest[0].mean() - largest[1].mean()) < 3.0 * scatter + 0.003 * largest[1].mean()
    level, error = ([ds[name].values[0] for ds in runs] for name in ("return_level", "return_level_standard_error"))
    assert (np.abs(level[0] - level[1]) < 3.0 * np.hypot(*error)).all()
    assert (np.hypot(*error) < 0.025 * level[1]).all()
    for ds, levels in zip(runs, level, strict=True):  # as often beyond a level as it says, but for peaks in clusters
        for time, force in zip((30.0, 100.0, 300.0), levels, strict=True):
            share, expected = float((ds.window_peak_force > force).mean()), 1.0 - np.exp(-10.0 / time)
            assert abs(share - expected) < 0.15 * expected + 3.0 * np.sqrt(expected / ds.window_peak_force.size)


@pytest.mark.full
def test_peaks_of_dashpots_do_not_change_other_numbers():
    law, names = il.KelvinVoigtContact(200.0, damping=5.0), ("peak_contact_force", "mean_square_velocity")
    plain, recorded, alone = (
        stop(law, 64, 20.0, record, step=0.035, **options)
        for record, options in (
            (None, {}),
            (il.PeakForces(window=3.0), {}),
            (il.PeakForces(window=3.0), {"statistics": ["peak_contact_force"]}),
        )
    )
    for name in names:
        np.testing.assert_array_equal(recorded[name], plain[name])
    np.testing.assert_array_equal(alone.peak_contact_force, plain.peak_contact_force)
    np.testing.assert_array_equal(alone.window_peak_force, recorded.window_peak_force)
