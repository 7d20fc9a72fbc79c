"""Simultaneous bands: how many standard errors hold a whole curve."""

from __future__ import annotations

import functools

import numpy as np

DRAWS = 1000
"""Draws of the multipliers."""

BINS = 4096
"""Bins that are drawn for at a time, which bounds the memory."""

SHARE = 0.95
"""Probability with which a band holds the whole curve."""

KNOWN = 10.0
"""Least value of a bin in its standard errors from which on it counts: below, errors are those of a few counts."""


def band_factor(residuals: np.ndarray, counted: np.ndarray) -> float:
    """Return the factor to the standard errors of a curve in which a band holds all of it with 95 %.

    It is the quantile of the largest ``|Σ_g ξ_g r_gb| / (Σ_g r_gb²)^½`` over the bins b, ξ being normal numbers: what
    the scatter of the subsamples g says of how bins depend on each other (multiplier bootstrap; Chernozhukov,
    Chetverikov and Kato, Ann. Statist. 41, 2013, 2786). That normal quantile becomes one of Student's law, since errors
    from few subsamples scatter.

    Residuals are differences of each subsample from the mean, (subsample, bin); the band is for the bins that are
    `counted`, (bin,) of bool. NaN if none is.
    """
    from scipy.special import ndtr, stdtrit  # loaded only here

    scatter = np.sqrt((residuals**2).sum(axis=0))
    chosen = counted & (scatter > 0.0)
    if not chosen.any():
        return float("nan")
    bins, largest = np.flatnonzero(chosen), np.zeros(DRAWS)
    for some in np.array_split(bins, -(-len(bins) // BINS)):
        sums = _multipliers(len(residuals)) @ (residuals[:, some] / scatter[some])
        np.maximum(largest, np.abs(sums).max(axis=1), out=largest)
    normal = np.quantile(largest, SHARE)
    return float(-stdtrit(len(residuals) - 1.0, ndtr(-normal)))


@functools.cache
def _multipliers(subsamples: int) -> np.ndarray:
    """Normal numbers, the same ones for every curve, (draw, subsample)."""
    return np.random.Generator(np.random.Philox(0)).standard_normal((DRAWS, subsamples))
