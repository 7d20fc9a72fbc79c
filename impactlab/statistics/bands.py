"""Simultaneous bands: how many standard errors hold a whole curve."""

from __future__ import annotations

import functools

import numpy as np

from impactlab.machine import ROWS_AT_A_TIME

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
