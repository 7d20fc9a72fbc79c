"""Statistics over uncertain numbers, and Sobol indices."""

import numpy as np
import pytest
import scipy.stats

import impactlab as il
from impactlab.analysis.uncertain import _index

OVER = {"stiffness": scipy.stats.lognorm(0.3, scale=20.0), "damping": scipy.stats.uniform(0.5, 0.3)}


def make(stiffness, damping):
    body = il.LinearOscillator(stiffness=stiffness, damping=damping)
    return il.Network({"a": body}, excitations={"a": il.WhiteNoise(1.0)})


def forced(stiffness, damping):
    """The same under a force that is not random."""
    return make(stiffness, damping).replace(excitations={"a": il.Harmonic(1.0, frequency=2.0)})


@pytest.fixture(scope="module")
def result():
    return il.uncertain(make, OVER, 24, duration=50.0, realizations=64, rng=1)


def test_means_and_parts_of_the_variance(result):
    """E[x²] is πS/(c k): a product of independent factors."""
    stiffness, damping = (item.rvs(400_000, random_state=place) for place, item in enumerate(OVER.values()))
    known = np.pi / (stiffness * damping)
    name = "mean_square_displacement"
    error = result[f"{name}_standard_error"].item()
    assert result[name].item() == pytest.approx(known.mean(), abs=3.0 * error)
    of_stiffness = (np.pi / stiffness * (1.0 / damping).mean()).var() / known.var()
    index, spread = (result[f"{name}_sobol_index{end}"].values[0, 0] for end in ("", "_standard_error"))
    assert index == pytest.approx(of_stiffness, abs=3.0 * spread)
    assert result[f"{name}_variance"].item() == pytest.approx(known.var(), rel=0.6)
    assert 0.0 < result[f"{name}_noise_part"].item() < 0.2
    values = result.parameter_value.values
    assert (values[:, 0, 0] == values[:, 1, 0]).all()
    assert (values[:, 0, 1] == values[:, 2, 1]).all()


def test_the_same_seed_gives_the_same_draws_and_a_rerun_the_same_numbers(result, tmp_path):
    result.to_netcdf(tmp_path / "uncertain.nc")
    again = il.rerun(tmp_path / "uncertain.nc")
    for name in ("mean_square_velocity", "mean_square_velocity_sobol_index", "parameter_value"):
        assert np.array_equal(again[name].transpose(*result[name].dims).values, result[name].values)
    still = il.uncertain(forced, OVER, 24, duration=20.0, rng=1)
    assert (still.parameter_value.values == result.parameter_value.values).all()
    assert still.mean_square_displacement_noise_part.item() == 0.0


def covered(rows, runs, seed):
    """Share of runs in which two errors hold the index 0.8 of one term of a sum."""
    rng, held = np.random.default_rng(seed), 0
    for _ in range(runs):
        first, others = rng.normal(size=rows), rng.normal(size=(2, rows))
        one, other = (2.0 * first + item for item in others)
        index, error = _index(one, other)
        held += abs(index - 0.8) <= 1.96 * error
    return held / runs


def test_errors_of_indices_hold_them():
    assert covered(100, 1000, 1) == pytest.approx(0.95, abs=0.02 + 2.0 * 0.007)


@pytest.mark.campaign
def test_coverage_of_indices():
    assert covered(200, 20_000, 2) == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"over": {"stiffness": scipy.stats.norm(20.0, 5.0), "damping": OVER["damping"]}},
            "distribution of 'stiffness'",
        ),
        ({"over": {"stiffness": 3.0, "damping": OVER["damping"]}}, "'stiffness' must be a distribution"),
        ({"over": {}}, "distributions by name"),
        ({"over": {"mass": OVER["damping"]}}, "cannot be called with the names mass"),
        ({"draws": 2}, "draws must be a whole number of at least 8"),
    ],
)
def test_bad_input_is_refused_by_name(given, said):
    with pytest.raises(il.InvalidInput, match=said):
        il.uncertain(**({"make": make, "over": OVER, "draws": 8} | given), duration=10.0)
