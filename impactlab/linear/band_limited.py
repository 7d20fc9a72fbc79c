"""Given forces that are sums of cosines up to a known frequency: means and slopes over many steps at once.

Such a function is, to rounding, the polynomial through a few of its values in a time in which its fastest cosine turns
by a few radians. What the steps in that time see of it, `impactlab.linear.given_functions.mean_and_slope`, are then
weighted sums of these values, with the same weights everywhere.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from impactlab.linear.given_functions import NODES, mean_and_slope
from impactlab.quadrature import legendre_coefficients, mean_rule

POINTS, WIDEST, MOST = 16, 3.0, 32
"""Values in a panel of steps, how far the fastest cosine may turn in it (rad), and the most steps: the polynomial is
then off by 1e-15 of the largest value."""

PLACES, _ = mean_rule(POINTS)
"""Where a panel is looked at, as parts of it: Gauss's rule, in which no value counts much more than the others."""


def panel_steps(highest: np.ndarray, step: float) -> np.ndarray:
    """Return how many steps (s) a panel has by highest angular frequencies (rad s-1): powers of two, or 0 for none."""
    with np.errstate(divide="ignore", over="ignore"):
        room = np.minimum(WIDEST / (highest * step), MOST)
    return np.where(room >= 1.0, 2 ** np.log2(np.maximum(room, 1.0)).astype(np.int64), 0)


@cache
def panel_weights(steps: int) -> np.ndarray:
    """Return the weights of values at `PLACES` in mean and slope of each step of a panel, (point, 2 step)."""
    inside = (np.arange(steps)[:, None] + NODES) / steps
    polynomials = np.polynomial.legendre.legvander(2.0 * inside - 1.0, POINTS - 1)
    values = polynomials @ legendre_coefficients(POINTS).T  # (step, node, point)
    both = np.stack(mean_and_slope(np.moveaxis(values, -1, 0)), axis=-1)  # (point, step, 2)
    return np.ascontiguousarray(both.reshape(POINTS, 2 * steps))
