"""Whether a run is stationary: its first half and the second compared."""

from __future__ import annotations

import math

import numpy as np

from impactlab.kernels.rows import FLUX, VV, XX, X
from impactlab.results.schema import CONTACT, sampled_of

DRIFT = 6.0
"""Difference between two halves of a run, in standard errors, from which it is not stationary."""

FEWEST_UNITS = 8
"""Number of realizations, or other units, from which on their scatter alone gives a standard error."""


def drift_of(bodies: np.ndarray, contacts: np.ndarray, steps: np.ndarray, trusted: bool) -> float:
    """Compare the two halves of every realization; for few realizations, compare halves and quarters by their batches.

    The sums over the steps of each batch are (batch, row, body or contact, realization). Return the largest
    difference, in standard errors, or NaN if it is not known, as where batches are too few to be `trusted`.
    """
    realizations, half = bodies.shape[-1], len(steps) // 2
    alone = realizations < FEWEST_UNITS
    if half == 0 or (alone and not trusted):
        return math.nan
    row = [statistic.name for statistic in sampled_of(CONTACT)].index("mean_contact_force")
    sums = np.concatenate(
        [bodies[:, [X, XX, VV]].reshape(len(steps), -1, realizations), contacts[:, FLUX + 1 + row]], axis=1
    )
    differences, error, freedom = _by_batches(sums, steps) if alone else _by_realizations(sums, steps)
    moving = error > 1e-12 * np.abs(sums).max(axis=(0, 2), initial=1e-300) / steps.sum()
    largest = np.abs(differences[moving] / error[moving]).max(initial=0.0)
    # as many standard errors of a normal law, since with few realizations the quotient has
    # wide tails (Wallace, Ann. Math. Statist. 30, 1959, 1121)
    return float(np.sqrt(freedom * np.log1p(largest**2 / freedom)) * (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0))


def _by_realizations(sums: np.ndarray, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return differences of the halves, their standard errors and degrees of freedom, from (batch, row, unit)."""
    half, realizations = len(steps) // 2, sums.shape[-1]
    difference = sums[:half].sum(axis=0) / steps[:half].sum() - sums[half:].sum(axis=0) / steps[half:].sum()
    return difference.mean(axis=-1), difference.std(axis=-1, ddof=1) / np.sqrt(realizations), realizations - 1.0


def _by_batches(sums: np.ndarray, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the same for a half and a quarter of the run, (cut, row), with batches as samples."""
    means = sums / steps[:, None, None]
    cuts = len(steps) // 2, len(steps) // 4
    differences = np.array([means[:cut].mean(axis=(0, 2)) - means[cut:].mean(axis=(0, 2)) for cut in cuts])
    spread = [[means[:cut].var(axis=(0, 2), ddof=1), means[cut:].var(axis=(0, 2), ddof=1)] for cut in cuts]
    counts = sums.shape[-1] * np.array([[cut, len(steps) - cut] for cut in cuts])
    error = np.sqrt((np.array(spread) / counts[..., None]).sum(axis=1))
    return differences, error, counts.min() - 1.0
