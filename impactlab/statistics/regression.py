"""Weighted means, and linear regressions on controls, whose expectation is 0."""

from __future__ import annotations

import math

import numpy as np

from impactlab.results.schema import Estimate

CERTAIN = 5.0
"""Standard errors by which one of a few numbers is off 0 for certain."""

FEW_ESTIMATES = 10
"""Numbers up to which the largest is one of a few."""

ROUNDING = 1e-15
"""Relative error of a sum, below which no standard error goes."""

FEW_UNITS = 2.5
"""Units that a residual of a regression rests on, ``(Σ r²)²/Σ r⁴``, below which one or two rare events have made it: of
64 normal ones 21, where rare strong contacts leave most of the scatter 4 and more."""

NO_SCATTER = 1e-9
"""Part of the plain standard error below which the error of a regression is rounding."""


def largest_of(number: int, of_few: float) -> float:
    """Return the standard errors from which the largest of many numbers is off, where it is `of_few` among few.

    It grows as the largest of so many normal numbers does.
    """
    return math.sqrt(of_few**2 + 2.0 * math.log(max(1.0, number / FEW_ESTIMATES)))


class Mean:
    """Weighted means of rows and their standard errors, which are NaN where units are too few to be trusted."""

    def __init__(self, weights: np.ndarray, trusted: bool) -> None:
        self.weights, self.trusted = weights, trusted and len(weights) > 1
        self.total = weights.sum()

    def __call__(self, units: np.ndarray) -> Estimate:
        mean = (units * self.weights).sum(axis=-1) / self.total
        if not self.trusted:
            return Estimate(mean, np.full(units.shape[:-1], np.nan))
        count = len(self.weights)
        scatter = ((self.weights * (units - mean[..., None])) ** 2).sum(axis=-1)
        error = np.sqrt(scatter * count / (count - 1.0)) / self.total
        return Estimate(mean, np.maximum(error, ROUNDING * np.abs(mean)))


class Regression:
    """Weighted linear regressions on controls, row by row, at control 0.

    The standard error is ``s² (1/n + ḡᵀ (Σ (g − ḡ)(g − ḡ)ᵀ)⁻¹ ḡ)``.
    """

    def __init__(self, controls: np.ndarray, weights: np.ndarray) -> None:
        self.share = weights / weights.sum()
        self.root = np.sqrt(self.share * len(weights))
        offsets = (controls * self.share).sum(axis=-1)
        centred = (controls - offsets[..., None]) * self.root
        scale = np.sqrt((centred**2).sum(axis=-1))
        scale = np.where(scale > 1e-12 * np.abs(offsets), scale, np.inf)  # a constant is none
        u, s, vt = np.linalg.svd((centred / scale[..., None]).swapaxes(1, 2), full_matrices=False)
        kept = s > 1e-7
        self.u = u * kept[:, None]
        self.shift = (vt @ (offsets / scale)[..., None])[..., 0] * kept / np.where(kept, s, 1.0)
        self.freedom = len(weights) - 1 - kept.sum(axis=1)

    def _fitted(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return means, weighted deviations from them, slopes, and the residuals of the deviations."""
        mean = (values * self.share).sum(axis=1)
        deviation = (values - mean[:, None]) * self.root
        slopes = (self.u.swapaxes(1, 2) @ deviation[..., None])[..., 0]
        return mean, deviation, slopes, deviation - (self.u @ slopes[..., None])[..., 0]

    def rests_on_few(self, values: np.ndarray) -> np.ndarray:
        """Whether what the controls leave of the scatter was made by a few units, or by rounding, (row,) of bool."""
        _, deviation, _, residual = self._fitted(values)
        plain, left = (_participating(item) for item in (deviation, residual))
        nothing = (residual**2).sum(axis=1) <= NO_SCATTER**2 * (deviation**2).sum(axis=1)
        return np.asarray(nothing | (left < np.minimum(FEW_UNITS, 0.5 * plain)))

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """Return the part of weighted deviations that controls leave, (row, unit)."""
        return self._fitted(values)[-1]

    def slope(self, values: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Return the slopes of deviations over other deviations, beside the controls, (row,) from (row, unit)."""
        residual, other = self._fitted(values)[-1], self._fitted(others)[-1]
        square = (other**2).sum(axis=1)
        return np.asarray((residual * other).sum(axis=1) / np.where(square > 0.0, square, 1.0))

    def at_zero(self, values: np.ndarray) -> Estimate:
        """Return the values at which the controls are 0, and their standard errors, from (row, unit)."""
        mean, _, slopes, residual = self._fitted(values)
        spread = 1.0 / len(self.share) + (self.shift**2).sum(axis=1)
        error = np.sqrt((residual**2).sum(axis=1) / self.freedom * spread)
        value = mean - (self.shift * slopes).sum(axis=1)
        return Estimate(value, np.maximum(error, ROUNDING * np.abs(values).max(axis=1)))


def _participating(deviations: np.ndarray) -> np.ndarray:
    """Return the effective number of units in a scatter, ``(Σ d²)²/Σ d⁴``, (row,)."""
    squares = (deviations / np.maximum(np.abs(deviations).max(axis=-1, keepdims=True), 1e-300)) ** 2
    return np.asarray(squares.sum(axis=-1) ** 2 / np.maximum((squares**2).sum(axis=-1), 1e-300))
