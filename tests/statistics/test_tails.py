"""Levels of maxima, and their errors."""

import math

import numpy as np
import pytest

from impactlab.statistics.tails import fitted, level_with_error, without_each


@pytest.mark.parametrize(("number", "part"), [(128, 0.9), (256, 0.67)])
def test_two_errors_hold_levels(number, part):
    """In 93 to 97 % of the samples of independent maxima; the share is known to 0.6 %."""
    random, runs = np.random.default_rng(1), 1500
    known, groups = -math.log(-math.log(part)), np.arange(number)
    held = 0
    for maxima in random.gumbel(size=(runs, number)):
        level, error = level_with_error(maxima, groups, part, trusted=True)
        held += abs(level - known) < 2.0 * error
    assert 0.93 < held / runs < 0.97


def test_windows_that_hardly_differ_between_realizations():
    """Of four windows whose maxima are the same in all realizations the errors allow for the bias of order 1/n."""

    def location(realizations):
        maxima = np.tile([0.1, 0.3, 0.4, 0.5], realizations)
        maxima += 1e-6 * np.random.default_rng(realizations).normal(size=len(maxima))
        groups = np.repeat(np.arange(realizations), 4)
        value, error = without_each(lambda ordered: fitted(ordered)[0, :2], maxima, groups, trusted=True)
        return value, error

    (few, error), (many, _) = location(64), location(4096)
    assert (np.abs(few - many) < 2.0 * error).all()
    assert (error < 3.0 * np.abs(few - many)).all()
