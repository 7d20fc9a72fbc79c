"""Errors of curves: subsamples of all realizations, and bands that hold a whole curve."""

from __future__ import annotations

import functools
import math
from typing import Protocol

import numpy as np

from impactlab.machine import ROWS_AT_A_TIME
from impactlab.plan.clock import Clock
from impactlab.plan.realizations import Realizations

DRAWS = 1000
"""Draws of the multipliers."""

LEAST_SIGNIFICANCE = 10.0
"""Least value of a bin, in its standard errors, for the bin to count: below, the error rests on a few samples."""


def band_factor(residuals: np.ndarray, counted: np.ndarray) -> float:
    """Return the factor to the standard errors of a curve in which a band holds all of it with 95 %.

    The factor is the quantile of the largest ``|Σ_g ξ_g r_gb| / (Σ_g r_gb²)^½`` over the bins b, with normal numbers ξ.
    The scatter of the subsamples g thus accounts for the dependence between bins (multiplier bootstrap; Chernozhukov,
    Chetverikov and Kato, Ann. Statist. 41, 2013, 2786). The normal quantile is then turned into one of Student's law,
    since errors from few subsamples scatter.

    Residuals are differences of each subsample from the mean, (subsample, bin); the band is for the bins that are
    `counted`, (bin,) of bool. The factor is NaN if no bin is.
    """
    from scipy.special import ndtr, stdtrit  # loaded only here

    scatter = np.sqrt((residuals**2).sum(axis=0))
    chosen = counted & (scatter > 0.0)
    if not chosen.any():
        return float("nan")
    bins, largest = np.flatnonzero(chosen), np.zeros(DRAWS)
    for some in np.array_split(bins, -(-len(bins) // ROWS_AT_A_TIME)):
        sums = _multipliers(len(residuals)) @ (residuals[:, some] / scatter[some])
        np.maximum(largest, np.abs(sums).max(axis=1), out=largest)
    normal = np.quantile(largest, 0.95)
    return float(-stdtrit(len(residuals) - 1.0, ndtr(-normal)))


@functools.cache
def _multipliers(subsamples: int) -> np.ndarray:
    """Normal numbers, the same ones for every curve, (draw, subsample)."""
    return np.random.Generator(np.random.Philox(0)).standard_normal((DRAWS, subsamples))


SUBSAMPLES = 256
"""Largest number of subsamples from which errors are estimated."""

SKEWED = 7.0 / 6.0
"""Factor of γ²/n by which two errors grow, by the expansion of Edgeworth: (z⁴ + 2z² − 3)/18 at z = 2 (P. Hall, The
Bootstrap and Edgeworth Expansion, 1992, 2.6)."""

OF_BAND = {
    "units": "1",
    "long_name": "factor to the standard errors with which a band holds the whole curve with a probability of 95 %",
    "comment": f"for the bins of at least {LEAST_SIGNIFICANCE:g} standard errors",
}
"""Attributes of a band factor."""


class Divided(Protocol):
    """The parts of a plan that say how realizations are divided."""

    @property
    def realizations(self) -> Realizations:
        """The realizations."""

    @property
    def clock(self) -> Clock:
        """The batches."""


def subsample_count(plan: Divided) -> int:
    """Return the number of subsamples of a run."""
    return min(plan.realizations.number * len(plan.clock.boundaries), SUBSAMPLES)


def subsamples_of(plan: Divided, realizations: np.ndarray) -> np.ndarray:
    """Subsample of every realization in every batch, (batch, lane)."""
    batches = len(plan.clock.boundaries)
    units = realizations.astype(np.int64)[None, :] * batches + np.arange(batches)[:, None]
    return np.ascontiguousarray(units * subsample_count(plan) // (plan.realizations.number * batches))


def in_subsamples(blocks: list[np.ndarray]) -> np.ndarray:
    """Add independent samples of all blocks, (lane, sample, …) each, to at most `SUBSAMPLES` sums, (subsample, …).

    Realizations are added in their order, so that the sums do not depend on the blocks.
    """
    each = np.concatenate(blocks)
    each = each.reshape(-1, *each.shape[2:])
    starts = (
        -(-np.arange(min(len(each), SUBSAMPLES)) * len(each) // SUBSAMPLES)
        if len(each) > SUBSAMPLES
        else np.arange(len(each))
    )
    result: np.ndarray = np.add.reduceat(each, starts, axis=0)
    return result


def in_units(blocks: list[np.ndarray]) -> np.ndarray:
    """Return values of all blocks, (lane, part, row) each, by independent units as estimates have them, (row, unit)."""
    whole = np.concatenate(blocks)
    return whole.swapaxes(0, 1).reshape(whole.shape[0] * whole.shape[1], whole.shape[2]).T


def mean_with_error(sums: np.ndarray, samples: np.ndarray, trusted: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mean of some sums, (subsample, …), of so many `samples`, its standard error, and the residuals.

    Errors are NaN where subsamples are too few to be `trusted`.
    """
    subsamples, total = len(sums), samples.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN where there are no samples
        mean = sums.sum(axis=0) / total
        residuals = sums - mean * samples
        if not trusted:
            return mean, np.full_like(mean, np.nan), residuals
        return mean, np.sqrt((residuals**2).sum(axis=0) * subsamples / (subsamples - 1.0)) / total, residuals


def for_skewness(residuals: np.ndarray) -> np.ndarray:
    """Return the factor by which skewness γ of n subsamples lengthens errors, ``1 + 7/6 γ²/n``, from (subsample, …).

    A mean that is too small has an error that is too small then.
    """
    number, size = len(residuals), np.abs(residuals).max(axis=0)
    parts = residuals / np.where(size > 0.0, size, 1.0)
    square, cube = (parts**2).sum(axis=0), (parts**3).sum(axis=0)
    skewness = cube**2 * number / np.where(square > 0.0, square, 1.0) ** 3
    return np.asarray(1.0 + SKEWED * skewness / number)


def mean_of_subsamples(
    sums: np.ndarray, samples: np.ndarray, trusted: bool, inner: np.ndarray | slice = slice(1, -1)
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the mean of every bin, its standard error, and the factor of a band around the inner ones.

    `sums` are (subsample, bin), of so many `samples`, (subsample, 1). Errors are NaN where subsamples are too few to be
    `trusted`.
    """
    mean, error, residuals = mean_with_error(sums, samples, trusted)
    if not trusted:
        return mean, error, math.nan
    return mean, error, band_factor(residuals[:, inner], (mean >= LEAST_SIGNIFICANCE * error)[inner])
