"""Realizations that leave the range of finite numbers: the others go on, with their own bits."""

import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

import impactlab as il

pytestmark = pytest.mark.full


class Well(il.Oscillator):
    """The potential x²/2 − x⁴/4: beyond 1 and −1 a body falls without end, in finite time."""

    @staticmethod
    def residual(displacement):
        return -displacement * displacement * displacement

    @staticmethod
    def residual_potential(displacement):
        return -0.25 * displacement**4


class Bursting(il.ContactLaw):
    """A spring whose force is not finite beyond an indentation."""

    stiffness: float = il.parameter(units="N m-1")

    @staticmethod
    def force(indentation, stiffness):
        return stiffness * indentation * (1.0 if indentation < 0.35 else np.inf)


NOISY = il.Network(
    {"a": Well(mass=1.0, damping=0.2, stiffness=1.0), "b": il.LinearOscillator(mass=1.0, damping=0.4, stiffness=4.0)},
    {"gap": il.Contact("a", "b", il.HertzContact(100.0), clearance=0.05)},
    {"a": il.WhiteNoise(0.003), "b": il.WhiteNoise(0.003)},
)
OPTIONS = {"realizations": 200, "step": 0.02, "rng": 1}


def kept(network=NOISY, duration=60.0, **options):
    """The dataset of a run, whose warnings about losses are expected."""
    with warnings.catch_warnings(action="ignore", category=il.ImpactLabWarning):
        return il.simulate(network, duration, **{**OPTIONS, **options})


def same(one, other):
    names = set(one.variables) | set(other.variables)
    return all(np.asarray(one[name]).tobytes() == np.asarray(other[name]).tobytes() for name in names)


RECORDS = il.PerRealization(), il.Density(), il.FinalState(), il.Trajectory(10.0), il.PeakForces(), il.Impacts()


@pytest.fixture(scope="module")
def found():
    return kept(record=RECORDS)


def test_lost_realizations_are_named_and_their_values_are_nan(found):
    number, lost = found.attrs["realizations_diverged"], found.diverged_realization.values
    assert 0 < number < 50
    assert len(lost) == number
    assert found.attrs["independent_samples"] == 200 - number
    each = found.mean_square_displacement_by_realization.sel(oscillator="a")
    np.testing.assert_array_equal(np.flatnonzero(each.isnull()), lost)
    np.testing.assert_array_equal(np.flatnonzero(found.final_displacement.isnull().any("oscillator")), lost)
    np.testing.assert_array_equal(np.flatnonzero(found.displacement.isnull().any(["time", "oscillator"])), lost)
    assert set(found.diverged_oscillator.values) == {"a"}
    spin_up = found.attrs["spin_up"]
    assert ((found.diverged_time > -spin_up) & (found.diverged_time <= 60.0)).all()


def test_statistics_are_those_of_the_others(found):
    each = found.mean_square_velocity_by_realization
    assert "condition" in found.attrs
    plain = found.get("direct_mean_square_velocity", found.mean_square_velocity)
    np.testing.assert_allclose(plain, each.mean("realization"))
    edges = found.displacement_edges.transpose("oscillator", ...).values
    share = (found.density_displacement.values * np.diff(edges)).sum(axis=-1)
    assert ((share > 0.99) & (share < 1.0 + 1e-9)).all()


@pytest.mark.parametrize("threads", [1, 3])
def test_bits_do_not_depend_on_blocks(found, threads):
    with ThreadPoolExecutor(threads) as pool:
        assert same(found, kept(record=RECORDS, executor=pool))


def test_bits_of_the_others_do_not_depend_on_those_that_are_lost(found):
    """The first of many realizations have the values that they have alone."""
    few = kept(record=RECORDS, realizations=70)
    for name in ("mean_square_displacement_by_realization", "final_velocity", "displacement"):
        assert found[name][:70].values.tobytes() == few[name].values.tobytes()


def test_times_are_those_of_another_method():
    """Without noise, at starts of their own: DOP853 says which bodies leave the well, and when."""
    velocities = np.linspace(0.2, 1.4, 13)
    wall = {"wall": il.Contact(il.WALL, "a", il.HertzContact(100.0), clearance=0.9)}
    network = il.Network({"a": NOISY.oscillators["a"]}, wall)
    found = kept(network, 20.0, realizations=13, step=0.002, initial={"velocity": {"a": velocities}})

    def rates(_, state):
        x, v = state
        return [v, -0.2 * v - x + x**3 + 100.0 * max(0.0, -x - 0.9) ** 1.5]

    def far(_, state):
        return abs(state[0]) - 1e6

    far.terminal = True
    times = [solve_ivp(rates, (0.0, 20.0), [0.0, v], "DOP853", rtol=1e-10, events=far).t_events[0] for v in velocities]
    np.testing.assert_array_equal(found.diverged_realization, [index for index, time in enumerate(times) if len(time)])
    np.testing.assert_allclose(found.diverged_time, np.concatenate(times), atol=0.006)  # up to three steps later


def test_raise_says_which_and_when_and_keep_does_where_none_is_left(found):
    first = found.diverged_realization.values[found.diverged_time.values.argmin()]
    with pytest.raises(il.Diverged, match=rf"'a' of realization {first} left the range of finite numbers at t = -"):
        kept(on_divergence="raise", executor=ThreadPoolExecutor(1))
    with pytest.raises(il.Diverged, match="20 of 20 realizations diverged"):
        kept(NOISY.replace(contacts={"gap": None}), realizations=20, initial={"velocity": {"a": 2.0}})
    with pytest.raises(il.InvalidInput, match="keep"):
        kept(on_divergence="ignore")


def test_contact_that_drives_a_body_away_is_named():
    """With a force that is not finite beyond an indentation, which some realizations reach."""
    ball = il.LinearOscillator(mass=1.0, damping=0.5, stiffness=1.0)
    stop = il.Contact("ball", il.WALL, Bursting(5.0))
    network = il.Network({"ball": ball}, {"stop": stop}, {"ball": il.WhiteNoise(0.01)})
    with pytest.warns(il.AccuracyWarning) as told:
        found = il.simulate(network, 20.0, realizations=64, step=0.01, rng=1)
    (message,) = [str(item.message) for item in told if item.message.kind == "diverged"]
    for words in ("of 64 realizations diverged", "pushed by contact 'stop'", "is inf N"):
        assert words in message
    assert set(found.diverged_contact.values) == {"stop"}


def test_files_reruns_and_sweeps_keep_what_was_lost(found, tmp_path):
    file = tmp_path / "found.nc"
    il.save(found, file)
    with xr.open_dataset(file) as read:
        assert same(read, found)
    with warnings.catch_warnings(action="ignore", category=il.ImpactLabWarning):
        assert same(il.rerun(found), found)
        out = kept(record=[il.Trajectory(10.0)], out=tmp_path / "paths.nc")
        assert out.displacement.values.tobytes() == found.displacement.values.tobytes()
        out.close()

        def at(density):
            return NOISY.replace(excitations={"a": il.WhiteNoise(density)})

        swept = il.sweep(at, {"density": [1e-4, 0.003]}, duration=60.0, record=il.PerRealization(), **OPTIONS)
    assert (swept.status == "done").all()
    assert np.isnan(swept.realizations_diverged[0])
    assert swept.realizations_diverged[1] > 0
    one = swept.sel(density=0.003)
    lost = one.diverged_realization.values.astype(int)
    assert np.isnan(one.mean_displacement_by_realization.sel(realization=lost)).all()
    assert il.jackknife(kept(record=il.PerRealization()), lambda s: s.contact_ratio).value.notnull().all()


def test_runs_go_on_from_those_that_are_left(found):
    with pytest.raises(il.InvalidInput, match=r"dropna\('realization'"):
        kept(initial=found, rng=2)
    left = found.dropna("realization", subset=["final_displacement"])
    assert kept(initial=left, rng=2, duration=1.0, realizations=left.sizes["realization"]).sizes["oscillator"] == 2


def test_checkpoints_hold_what_was_lost(found, tmp_path, monkeypatch):
    monkeypatch.setattr("impactlab.simulation.block_state.BETWEEN_STATES", 0.0)
    calls = 0

    def stop(part):
        nonlocal calls
        calls += 1
        if calls in (2, 3):
            raise KeyboardInterrupt

    for _ in range(4):
        try:
            again = kept(record=RECORDS, checkpoint=tmp_path / "kept", progress=stop)
            break
        except KeyboardInterrupt:
            continue
    assert same(found, again)
    assert not [*(tmp_path / "kept").rglob("*.state*"), *(tmp_path / "kept").rglob("*.losses")]


def test_first_passages_count_realizations_that_escape_after_they_passed():
    """A limit inside the well is passed by all that escape, so that none is lost."""
    options = {"duration": 200.0, "initial": "rest", "realizations": 300}
    found = kept(record=il.FirstPassage({"a": (-0.95, 0.95)}), **options)
    assert "realizations_diverged" not in found.attrs
    assert found.passage_count.sum() > 0
    lost = kept(record=il.FirstPassage({"b": (-5.0, 5.0)}), **options)
    numbers = lost.diverged_realization.values
    assert len(numbers)
    assert lost[["passage_time", "passage_censored"]].to_array()[:, numbers].isnull().all()
    assert float(lost.passage_count.sum()) + float(lost.passage_censored.sum()) == 300 - len(numbers)


def test_tolerances_are_reached_by_those_that_stay():
    found = kept(duration=None, tolerance={"mean_square_velocity": 0.1}, realizations=1, step=None, max_seconds=60.0)
    assert found.mean_square_velocity_bias.notnull().all()
