"""Histograms about 0 that become as wide as their values need, by powers of two."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactlab.kernels.histogram import count_about_zero, widen_bins

LEAST_EXPONENT = -1000
"""Exponent of the widest values of a histogram that has none but 0."""


class SignedHistogram:
    """Counts of values at some places in the subsamples of a block; bins reach from −2^n to 2^n.

    Parameters
    ----------
    places : int
        How many places there are.
    bins : int
        How many bins, a multiple of 4.
    subsamples : (batch, lane) ndarray
        Subsample of each realization in each batch.
    """

    def __init__(self, places: int, bins: int, subsamples: np.ndarray) -> None:
        self.bins, self.first = bins, int(subsamples.min())
        self.subsamples, self.number = subsamples - self.first, int(subsamples.max()) - self.first + 1
        self.counts = np.zeros((places, self.number, bins))
        self.exponents = np.full(places, LEAST_EXPONENT)

    def add(self, values: np.ndarray, batch: int, weights: np.ndarray | None = None) -> None:
        """Count values, (place, sample, lane), of a batch, once each or by the weights of samples, (sample,)."""
        weights = np.ones(values.shape[1]) if weights is None else weights
        count_about_zero(values, weights, self.subsamples[batch], self.exponents, self.counts)

    def result(self) -> dict[str, np.ndarray]:
        """Return the counts, their exponents, and the first subsample."""
        return {"counts": self.counts, "exponents": self.exponents, "first": np.array(self.first)}


def joined_counts(results: Sequence[dict[str, np.ndarray]], bins: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the counts of all blocks, (subsample, place, bin), and the widths of the bins, (place,)."""
    exponents = np.max([item["exponents"] for item in results], axis=0)
    number = max(int(item["first"]) + item["counts"].shape[1] for item in results)
    counts = np.zeros((number, len(exponents), bins))
    for item in results:
        first = int(item["first"])
        for place, own in enumerate(item["counts"]):
            wider = own.copy()
            widen_bins(wider, int(exponents[place] - item["exponents"][place]))
            counts[first : first + len(own), place] += wider
    return counts, 2.0**exponents * 2.0 / bins


def edges_of(width: np.ndarray, bins: int) -> np.ndarray:
    """Return the edges of bins of some widths, (place, edge)."""
    return np.asarray(width[:, None] * (np.arange(bins + 1) - 0.5 * bins))
