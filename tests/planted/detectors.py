"""How far what a simulation found is from what it should be, in standard errors.

A scene has a *law*, what the right code must find, and an *evidence*, what a simulation found.
Both are plain; `distances` compares them. Facts that hold exactly, such as that a realization has
the same numbers alone and among others, are 0 or infinite standard errors off.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import impactlab as il

Distances = dict[str, float]

STATISTICS = [
    "mean_displacement", "mean_square_displacement", "variance_displacement", "mean_velocity", "mean_square_velocity",
    "contact_ratio", "contact_rate", "mean_contact_force",
]  # fmt: skip
BALANCES = ["balance_mean_displacement", "balance_mean_square_displacement", "balance_mean_square_velocity"]


class Scene:
    """A simulation and what is known of it."""

    name = ""

    def law(self) -> Any:
        """Return what is known, (from the right code) made once."""

    def evidence(self) -> Any:
        """Simulate."""
        raise NotImplementedError

    def distances(self, found: Any, law: Any) -> Distances:
        """Return the distances of what was found from what is known, by detector, in standard errors."""
        raise NotImplementedError


def of_statistics(dataset: Any, law: Any) -> Distances:
    """Distances of all default statistics from an exact law, and of the balances from 0."""
    table = il.compare(dataset, law)
    names = zip(table.statistic.values, table.label.values, table.z.values, strict=True)
    result = {f"{statistic}[{label}]": abs(float(z)) for statistic, label, z in names if statistic in STATISTICS}
    for name in BALANCES:
        for item in dataset.get(name, ()):
            error = float(dataset[f"{name}_standard_error"].sel(oscillator=item.oscillator))
            if error > 0.0:
                result[f"{name}[{item.oscillator.item()}]"] = abs(float(item)) / error
    return result


def of_independence(values: np.ndarray) -> float:
    """Largest correlation between realizations a fixed number apart, (realization,), in standard errors."""
    if np.ptp(values) == 0.0:
        return math.inf
    offset = (values - values.mean()) / values.std()
    power = np.abs(np.fft.rfft(offset, 2 * len(offset))) ** 2
    apart = np.arange(1, len(offset) // 2)
    covariance = np.fft.irfft(power)[apart]
    return float(np.max(np.abs(covariance) / np.sqrt(len(offset) - apart)))


def of_means(samples: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Distances of means over the first axis from what is expected, in standard errors."""
    error = samples.std(axis=0, ddof=1) / math.sqrt(len(samples))
    difference = np.abs(samples.mean(axis=0) - expected)
    return np.where(difference > 1e-12, difference / np.maximum(error, 1e-300), 0.0)
