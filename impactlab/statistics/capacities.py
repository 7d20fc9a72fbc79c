"""Capacities: scales at which limits are first exceeded, each known to be between two of the scales that were tried."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr, ndtri
from scipy.stats import binom

HELD_WITH = 0.95
"""Probability with which an interval or a band holds the value."""

NORMAL = float(ndtri(0.5 + 0.5 * HELD_WITH))
"""Standard errors on both sides of a value that hold it with this probability."""

LEAST_PROBABILITY = 1e-300
"""Least probability of an interval, so that its logarithm is finite."""

OF_PARAMETER = 1e-4
"""Change of a parameter by which second derivatives of the likelihood are found."""


class Lognormal(NamedTuple):
    """A lognormal law of capacities, fitted by maximum likelihood; NaN where it is not determined."""

    median: float
    dispersion: float  # standard deviation of the logarithm
    covariance: np.ndarray  # (2, 2) of the logarithms of both

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors of the median and of the dispersion."""
        one, two = np.sqrt(np.diag(self.covariance))
        return float(self.median * one), float(self.dispersion * two)

    def probability(self, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the probability that the capacity is below each scale, and the ends of its band."""
        z = np.log(scales / self.median) / self.dispersion
        slopes = np.stack([np.full_like(z, -1.0 / self.dispersion), -z])
        spread = NORMAL * np.sqrt(np.einsum("is,ij,js->s", slopes, self.covariance, slopes))
        return ndtr(z), ndtr(z - spread), ndtr(z + spread)


UNDETERMINED = Lognormal(np.nan, np.nan, np.full((2, 2), np.nan))


def lognormal(exceeded: np.ndarray, scales: np.ndarray) -> Lognormal:
    """Return the lognormal law of the scales at which records first exceed a limit, (record, scale) of bool.

    A record first exceeds it between two scales, below the first one, or above the last one. The likelihood is the
    product of the probabilities of these intervals, so that a record counts once however many scales there are.
    """
    first = np.where(exceeded.any(axis=1), exceeded.argmax(axis=1), len(scales))
    counts = np.bincount(first, minlength=len(scales) + 1)
    reached = counts.cumsum()[:-1]
    if len(np.unique(reached[(reached > 0) & (reached < len(first))])) < 2:  # no slope is known
        return UNDETERMINED
    edges = np.concatenate([[-np.inf], np.log(scales), [np.inf]])
    chosen = counts > 0
    low, high, weights = edges[:-1][chosen], edges[1:][chosen], counts[chosen]
    inside = (reached > 0) & (reached < len(first))
    z, logs = ndtri(reached[inside] / len(first)), np.log(scales[inside])
    slope, offset = np.polyfit(logs, z, 1)
    start = np.array([-offset / slope, -np.log(slope)]) if slope > 0.0 else np.array([logs.mean(), 0.0])
    found = minimize(_minus_log_likelihood, start, (low, high, weights), jac=True, method="BFGS", tol=1e-9)
    hessian = np.stack([
        _minus_log_likelihood(found.x + shift, low, high, weights)[1]
        - _minus_log_likelihood(found.x - shift, low, high, weights)[1]
        for shift in OF_PARAMETER * np.eye(2)
    ]) / (2.0 * OF_PARAMETER)  # fmt: skip
    size = len(first)
    covariance = np.linalg.inv(0.5 * (hessian + hessian.T)) * size / (size - 1.0)  # the likelihood has the error of n
    if not (np.linalg.eigvalsh(covariance) > 0.0).all():
        return UNDETERMINED
    return Lognormal(float(np.exp(found.x[0])), float(np.exp(found.x[1])), covariance)


def _minus_log_likelihood(
    parameters: np.ndarray, low: np.ndarray, high: np.ndarray, weights: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the value and its derivatives by the logarithms of the median and of the dispersion."""
    mean, deviation = parameters[0], np.exp(parameters[1])
    ends = (np.stack([low, high]) - mean) / deviation
    upper = ends[0] > 0.0  # differences of the smaller tails
    tails = ndtr(np.where(upper, -ends, ends))
    probability = np.maximum(np.abs(tails[1] - tails[0]), LEAST_PROBABILITY)
    densities = np.exp(-0.5 * ends**2) / np.sqrt(2.0 * np.pi)
    moments = np.where(np.isfinite(ends), ends, 0.0) * densities
    slopes = np.stack([(densities[1] - densities[0]) / deviation, moments[1] - moments[0]])
    return float(-(weights * np.log(probability)).sum()), (slopes / probability * weights).sum(axis=1)


def fraction_band(counts: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the band of the probability of an event that some of a number of independent records have (Wilson)."""
    fraction, part = counts / number, NORMAL**2 / number
    middle = (fraction + 0.5 * part) / (1.0 + part)
    half = np.sqrt(part * (fraction * (1.0 - fraction) + 0.25 * part)) / (1.0 + part)
    return middle - half, middle + half


def quantile_band(values: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a quantile of samples along the first axis, and order statistics between which that of the law is.

    An end is NaN where there are too few samples for it.
    """
    number, ordered = len(values), np.sort(values, axis=0)
    below, above = (int(binom.ppf(level, number, share)) for level in (0.5 - 0.5 * HELD_WITH, 0.5 + 0.5 * HELD_WITH))
    unknown = np.full(values.shape[1:], np.nan)
    low = ordered[below - 1] if below > 0 else unknown
    high = ordered[above] if above < number else unknown
    return np.quantile(values, share, axis=0, method="hazen"), low, high
