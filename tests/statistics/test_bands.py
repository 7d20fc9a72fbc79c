"""Bands that hold whole curves."""

import numpy as np
import pytest
from scenes import base, linear
from scipy.special import stdtrit

import impactlab as il
from impactlab.statistics.subsamples import LEAST_SIGNIFICANCE, band_factor


@pytest.mark.campaign
def test_bands_hold_the_whole_density():
    """In 95 % of 200 runs; the standard error of that share is 1.5 %."""
    exact, every = il.exact(linear()), il.ExactFlow(jumps=False)
    held = []
    for rng in range(200):
        ds = il.simulate(
            linear(), 20.0, realizations=64, rng=rng, step=0.1, record=il.Density(bins=40), integrator=every
        )
        density, error = ds.density_displacement.values[0], ds.density_displacement_standard_error.values[0]
        known = (density >= LEAST_SIGNIFICANCE * error) & (error > 0.0)
        assert known.sum() > 8
        expected = exact.bin_density("a", "displacement", ds.displacement_edges.values[0])
        score = np.abs(density - expected)[known] / error[known]
        held.append((score.max() <= float(ds.density_displacement_band_factor[0]), score.max() <= 2.0))
    whole, of_one_bin = np.mean(held, axis=0)
    assert 0.905 <= whole <= 0.985
    assert of_one_bin < 0.8  # two standard errors are not enough


@pytest.mark.parametrize(("copies", "expected"), [(1, 40), (8, 5)])
def test_the_factor_knows_how_bins_depend_on_each_other(copies, expected):
    """Independent bins need the factor of Šidák, 1 − 0.95^(1/m) for each of m; copies of a bin need nothing more."""
    residuals = np.repeat(np.random.default_rng(1).normal(size=(256, 40 // copies)), copies, axis=1)
    factor = band_factor(residuals - residuals.mean(axis=0), np.ones(40, dtype=bool))
    sidak = -stdtrit(255.0, 0.5 * (1.0 - 0.95 ** (1.0 / expected)))
    assert factor == pytest.approx(sidak, abs=0.12)  # a quantile from 1000 draws, of the correlations of 256 groups


def test_only_what_is_known_counts():
    residuals = np.random.default_rng(2).normal(size=(64, 30))
    none, one = np.zeros(30, dtype=bool), np.arange(30) == 4
    assert np.isnan(band_factor(residuals, none))
    assert band_factor(residuals, one) == pytest.approx(-stdtrit(63.0, 0.025), abs=0.15)
    assert band_factor(0.0 * residuals, one) != band_factor(residuals, one)


def test_joint_densities_have_a_band():
    record = [il.JointDensity("one", "two", bins=12), il.Density(bins=12)]
    ds = il.simulate(base(), 20.0, realizations=64, rng=1, record=record)
    assert 2.0 < float(ds.density_displacement_band_factor[0]) < float(ds.joint_density_band_factor) < 4.5
