"""When runs without steps take samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from impactlab.records.surface import WHOLE

Regular = tuple[float, float]
"""A first time, and the interval to each next one (s)."""


class Sampling(NamedTuple):
    """The times of all samples, and which of them those of a trajectory are, and the looks of a strobe."""

    times: np.ndarray  # (s)
    trajectory: np.ndarray
    looks: np.ndarray

    @classmethod
    def of(
        cls, trajectory: Regular | None, strobe: Regular | None, duration: float, others: Sequence[float] = ()
    ) -> Self:
        """Return the samples of a run of some duration (s), with some at other times."""
        sampled, looked = (np.zeros(0) if item is None else _times(*item, duration) for item in (trajectory, strobe))
        every = np.sort(np.concatenate([sampled, looked, others]), kind="stable")
        apart = WHOLE * max(duration, 1e-300) / max(len(every), 1)
        times = every[np.diff(every, prepend=-math.inf) > apart]
        return cls(times, np.searchsorted(times, sampled - apart), np.searchsorted(times, looked - apart))


def _times(start: float, interval: float, duration: float) -> np.ndarray:
    """Return the times from a start on that are whole numbers of intervals apart, up to the end (s)."""
    first = round(start / interval)
    offset = start - first * interval
    offset = offset if abs(offset) > WHOLE * start else 0.0
    last = math.floor((duration - offset) / interval * (1.0 + WHOLE))
    return interval * np.arange(first, last + 1) + offset
