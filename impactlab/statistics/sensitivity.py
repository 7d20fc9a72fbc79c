"""Sensitivity to uncertain numbers: the parts of a variance that noise and each number cause."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.results.schema import Estimate

TOLD = 2.0
"""Standard errors by which the variance by numbers must differ from 0, for its parts to be told."""


class Sensitivity(NamedTuple):
    """Mean and variances of what realizations find, in draws of numbers with some realizations of noise each.

    Variances are those of a one-way analysis of variance. The part of a number is the variance that a polynomial in
    its rank explains, whose degree grows with the number of draws. Errors are those of the jackknife over draws, longer
    for the variance by numbers, so that they cover where statistics are skewed.
    """

    mean: Estimate
    noise: Estimate  # variance by noise in a draw
    numbers: Estimate  # variance of the means of draws without noise
    indices: Estimate  # (number, …) part of it
    means: np.ndarray  # (draw, …)

    @classmethod
    def of(cls, values: np.ndarray, shares: np.ndarray) -> Sensitivity:
        """Analyse values, (draw, realization, …), with the shares of draws below each number, (draw, number)."""
        draws, noises = values.shape[:2]
        means = values.mean(axis=1)
        within = values.var(axis=1, ddof=1) if noises > 1 else np.zeros_like(means)
        of_mean, full = _without_each(within) / noises, _variances(means)
        numbers = full - of_mean
        variance = _jackknifed(numbers)
        skewed = Estimate(variance.value, _of_variance(full[0], numbers))
        found = []
        with np.errstate(divide="ignore", invalid="ignore"):
            for share in shares.T:
                value, error = _jackknifed((full - _left(means, share)) / numbers)
                told = variance.value > TOLD * variance.error
                found.append(Estimate(np.where(told, value, np.nan), np.where(told, error, np.nan)))
        root = np.sqrt(draws)
        return cls(
            Estimate(means.mean(axis=0), means.std(axis=0, ddof=1) / root),
            Estimate(within.mean(axis=0), within.std(axis=0, ddof=1) / root),
            skewed,
            Estimate(*(np.stack(item) for item in zip(*found, strict=True))),
            means,
        )


def _jackknifed(values: np.ndarray) -> Estimate:
    """Return the first of some values and its error, by the others, each of which leaves out one draw."""
    number, scatter = len(values) - 1, values[1:] - values[1:].mean(axis=0)
    return Estimate(values[0], np.sqrt((number - 1.0) / number * (scatter**2).sum(axis=0)))


def _of_variance(variance: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the error of a variance by the jackknifed one, so that two errors hold 95 % of skewed laws as well.

    The logarithm of a variance is closer to normal than the variance, which is too small more often than too large, and
    its error with it: two errors reach as far up as the interval of the logarithm does. Student's quantile allows for
    errors that rest on few draws: ``(Σ d²)²/Σ d⁴`` of the differences d without each draw, a third of their number
    where the law is normal.
    """
    from scipy.special import stdtrit  # loaded only here

    error, away = _jackknifed(values).error, values[1:] - values[1:].mean(axis=0)
    squares = (away**2).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        freedom = 3.0 * squares**2 / (away**4).sum(axis=0)
        up = stdtrit(np.maximum(freedom, 2.0), 0.975) * error / variance
        return np.asarray(np.where(squares > 0.0, 0.5 * variance * np.expm1(up), 0.0))


def _without_each(values: np.ndarray) -> np.ndarray:
    """Return the mean of some values, and then the means without each."""
    total, number = values.sum(axis=0), len(values)
    return np.concatenate([total[None] / number, (total - values) / (number - 1.0)])


def _variances(values: np.ndarray) -> np.ndarray:
    """Return the variance of some values, and then the variances without each."""
    number, squares = len(values), (values - values.mean(axis=0)) ** 2
    total = squares.sum(axis=0)
    others = (total - squares * number / (number - 1.0)) / (number - 2.0)
    return np.concatenate([total[None] / (number - 1.0), others])


def _left(values: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the variance that a polynomial in the shares does not explain, and then the same without each value."""
    number = len(values)
    degree = round(number ** (1.0 / 3.0))
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(2.0 * share - 1.0, degree))
    flat = values.reshape(number, -1)
    squares = ((flat - basis @ (basis.T @ flat)) ** 2).reshape(values.shape)
    leverage = (basis**2).sum(axis=1).reshape(-1, *[1] * (values.ndim - 1))
    total, freedom = squares.sum(axis=0), number - 1.0 - degree
    others = (total - squares / (1.0 - leverage)) / (freedom - 1.0)
    return np.concatenate([total[None] / freedom, others])
