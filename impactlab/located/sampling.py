"""When runs without steps take samples."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np

from impactlab.records.surface import WHOLE

Regular = tuple[float, float]
"""A first time, and the interval to each next one (s)."""


class Sampling(NamedTuple):
    """The times of all samples, and the places of those of each record."""

    times: np.ndarray  # (s)
    places: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, regular: Mapping[str, Regular], duration: float, others: Sequence[float] = ()) -> Self:
        """Return the samples of a run of some duration (s), with some at other times."""
        sampled = {name: _times(*item, duration) for name, item in regular.items()}
        every = np.sort(np.concatenate([*sampled.values(), others]), kind="stable")
        apart = WHOLE * max(duration, 1e-300) / max(len(every), 1)
        times = every[np.diff(every, prepend=-math.inf) > apart]
        return cls(times, {name: np.searchsorted(times, item - apart) for name, item in sampled.items()})


def _times(start: float, interval: float, duration: float) -> np.ndarray:
    """Return the times from a start on that are whole numbers of intervals apart, up to the end (s)."""
    first = round(start / interval)
    offset = start - first * interval
    offset = offset if abs(offset) > WHOLE * start else 0.0
    last = math.floor((duration - offset) / interval * (1.0 + WHOLE))
    return interval * np.arange(first, last + 1) + offset
