"""Levels of maxima, and their errors."""

import math

import numpy as np
import pytest

from impactlab.statistics.tails import level_with_error


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
