"""Errors of means of subsamples."""

import numpy as np
import pytest

from impactlab.statistics.subsamples import for_skewness, mean_with_error


@pytest.mark.parametrize(
    ("law", "mean", "most"),
    [
        (lambda random, shape: random.normal(size=shape), 0.0, 0.955),
        (lambda random, shape: random.exponential(size=shape), 1.0, 0.96),
        (lambda random, shape: random.lognormal(0.0, 0.6, size=shape), np.exp(0.18), 0.96),
        (lambda random, shape: 1.0 * random.poisson(0.1, size=shape), 0.1, 0.97),
    ],
)
def test_two_errors_hold_means_of_skewed_laws(law, mean, most):
    """In 93 to 97 % of 4000 samples of 64, which are known to 0.4 %; of normal ones as before."""
    units = law(np.random.default_rng(1), (64, 4000))
    value, error, residuals = mean_with_error(units, np.ones((64, 1)), trusted=True)
    held = np.abs(value - mean) <= 2.0 * error * for_skewness(residuals)
    assert 0.935 < held.mean() < most
    assert held.mean() - (np.abs(value - mean) <= 2.0 * error).mean() > (0.002 if mean else -1e-9)
