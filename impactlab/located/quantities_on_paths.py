"""Quantities of one's own along the paths of runs without steps, from nodes of integrals."""

from __future__ import annotations

from typing import Any

import numpy as np

from impactlab.located.path_snapshots import PathSnapshots
from impactlab.records.quantities import EXTREMES, MEANS, Quantity, WithError
from impactlab.records.signed_histogram import SignedHistogram
from impactlab.results.labels import Variables

AT_ONE_TIME = 1e-14
"""Part of a time up to which two nodes are at one time: the end of a step and the beginning of the next one."""


class QuantityOnPaths:
    """Integrals, extremes and a density of a quantity of one's own along the paths of realizations.

    Integrals have the nodes and weights of the path. Extremes are those at nodes, or of parabolas through three, which
    do not reach across events. The density counts nodes by the time between their neighbours.

    Parameters
    ----------
    record : Observable
    paths : PathSnapshots
    realizations : int
    """

    def __init__(self, record: Any, paths: PathSnapshots, realizations: int) -> None:
        self.record, self.paths = record, paths
        self.quantity = Quantity(record, paths.links(record.of_network.network))
        count = len(record.of_network.labels)
        self.sums, self.squares = np.zeros((2, realizations, count))
        self.largest, self.smallest = np.full((2, realizations, count), -np.inf)  # the latter of the negative
        self.counts = SignedHistogram(count, record.bins, np.zeros((1, 1), dtype=np.int64))

    def take(self, lane: int, snapshots: np.ndarray, times: np.ndarray, weights: np.ndarray) -> None:
        """Take nodes of a realization in the order of time: snapshots, (node, row), times and weights (s)."""
        values = self.quantity(snapshots[:, :, None], times, np.array([lane]))
        own = values[:, :, 0].T
        self.sums[lane] += weights @ own
        self.squares[lane] += weights @ own**2
        for largest, sign in ((self.largest, 1.0), (self.smallest, -1.0)):
            np.maximum(largest[lane], _largest(times, sign * own), out=largest[lane])
        self.counts.add(values, 0, np.gradient(times) if len(times) > 1 else weights)

    def described(self, length: float, path: tuple[float, np.ndarray, np.ndarray] | None) -> Variables:
        """Return the variables of a run of some length (s), with a path: its begin, times (s) and snapshots."""
        means = dict(zip(MEANS, (self.sums / length, self.squares / length), strict=True))
        extremes = dict(zip(EXTREMES, (self.largest, -self.smallest), strict=True))
        averages: dict[str, WithError] = {name: mean_of(values) for name, values in (means | extremes).items()}
        sampled = None
        if path is not None:
            begin, times, rows = path
            values = self.quantity(rows.transpose(1, 2, 0), times, np.arange(len(rows)))
            sampled = begin, values.transpose(2, 1, 0)
        found: Variables = self.record.described(averages, [self.counts.result()], False, sampled)
        return found


def mean_of(values: np.ndarray) -> WithError:
    """Return the mean over realizations, and standard errors, which are unknown where nothing is random."""
    value = values.mean(axis=0)
    return value, np.where(value == 0.0, 0.0, np.nan)


def _largest(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the largest values, (place,), at times or of parabolas about one that is larger than both beside it.

    A parabola rises above the value by no more than this is above those beside it: it may be about a short step.
    """
    result: np.ndarray = values.max(axis=0)
    steps, changes = np.diff(times)[:, None], np.diff(values, axis=0)
    apart = steps > AT_ONE_TIME * np.abs(times[1:, None])
    before, after, rise, fall = steps[:-1], steps[1:], changes[:-1], -changes[1:]
    inner = apart[:-1] & apart[1:] & (rise >= 0.0) & (fall >= 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        bend = (fall / after + rise / before) / (before + after)
        slope = (rise / before * after - fall / after * before) / (before + after)
        above = np.minimum(slope**2 / (4.0 * bend), np.maximum(rise, fall))
    tops = np.where(inner & (bend > 0.0), values[1:-1] + above, -np.inf)
    return np.asarray(np.maximum(result, tops.max(axis=0, initial=-np.inf)))
