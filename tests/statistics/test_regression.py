"""Linear regressions on controls."""

import numpy as np
import pytest

from impactlab.statistics.regression import Regression


def test_a_slope_is_that_beside_the_controls():
    """Both follow the control as well, which alone would make values rise by 2.5 where others do by 1."""
    control, other, own = np.random.default_rng(1).normal(size=(3, 4000))
    regression = Regression(control[None, None], np.ones(4000))
    values, others = 0.7 * other + 10.0 * control + 0.1 * own, other + 4.0 * control
    slope = regression.slope(np.stack([values, others, others]), np.stack([others, others, 0.0 * others]))
    assert slope[0] == pytest.approx(0.7, abs=4.0 * 0.1 / np.sqrt(4000))
    assert slope[1:].tolist() == [pytest.approx(1.0), 0.0]
