"""Survival of independent realizations until a horizon: probabilities, hazards and means, with standard errors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

ADDED = 2.0
"""Survivals and failures that are added where a standard error is estimated, so that few of them make it no smaller
(A. Agresti and B. A. Coull, Am. Stat. 52, 1998, 119)."""


class Value(NamedTuple):
    """Values and their standard errors."""

    value: np.ndarray
    error: np.ndarray


class Survival(NamedTuple):
    """Times of realizations, NaN for those that survive until the horizon, which are known to do so (s)."""

    times: np.ndarray
    horizon: float

    def probability(self, grid: np.ndarray) -> Value:
        """Return the probability of survival until some times up to the horizon.

        It is the estimate of Kaplan and Meier, which is a binomial one since all are observed until the horizon.
        """
        number = len(self.times)
        left = number - np.searchsorted(np.sort(self._ends), grid, side="right")
        part = (left + ADDED) / (number + 2.0 * ADDED)
        return Value(left / number, np.sqrt(part * (1.0 - part) / (number + 2.0 * ADDED)))

    def hazard(self, edges: np.ndarray) -> Value:
        """Return the rate at which survivors fail between some times: failures over the time of all survivors (s-1)."""
        failed, _ = np.histogram(self._ends, edges)
        spent = np.clip(self._ends[:, None], edges[:-1], edges[1:]) - edges[:-1]
        exposure = spent.sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            value, error = failed / exposure, np.sqrt(failed + 1.0) / exposure
        return Value(np.where(exposure > 0.0, value, np.nan), np.where(exposure > 0.0, error, np.nan))

    def mean(self) -> Value:
        """Return the mean time, NaN where some survive (s)."""
        return _mean(self.times)

    def restricted_mean(self) -> Value:
        """Return the mean of the times up to the horizon, at which those of survivors end (s)."""
        return _mean(np.minimum(self._ends, self.horizon))

    @property
    def _ends(self) -> np.ndarray:
        return np.where(np.isnan(self.times), math.inf, self.times)


def _mean(values: np.ndarray) -> Value:
    """Return a mean over independent realizations, and its standard error; NaN for one of them."""
    error = values.std(ddof=1) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return Value(values.mean(), np.asarray(error))
