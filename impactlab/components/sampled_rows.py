"""Samples: rows of numbers by time or frequency as fields of components, checked, and what is between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.inputs import real_array

_PLACES = {"times": ("time", "s"), "frequencies": ("frequency", "rad/s")}
"""Axes of samples: the name of a single value, and its unit."""


def between(time: float, times: Sequence[float], values: Sequence[float]) -> float:
    """Interpolate linearly between samples; 0 outside their range."""
    if not times[0] <= time <= times[-1]:
        return 0.0
    low = sample_before(time, times)
    share = (time - times[low]) / (times[low + 1] - times[low])
    return (1.0 - share) * values[low] + share * values[low + 1]


def sample_before(time: float, times: Sequence[float]) -> int:
    """Return the number of the last sample, but for the last of all, that is not after a time.

    Samples at equal distances are found where they must be, others by bisection.
    """
    low, high = 0, len(times) - 1
    middle = min(int((time - times[0]) / (times[high] - times[0]) * high), high - 1)
    while high - low > 1:
        if times[middle] <= time:
            low = middle
        else:
            high = middle
        middle = low + 1 if times[low + 1] > time else (low + high) // 2
    return low


def take_samples(owner: Any, name: str, of: str = "times") -> None:
    """Return a component's times, or frequencies, and the values of one field as tuples, or refuse them."""
    kind, (one, units) = type(owner).__name__, _PLACES[of]
    times, values = (_samples(f"{kind}.{field}", getattr(owner, field)) for field in (of, name))
    if len(times) != len(values):
        raise InvalidInput(f"{kind} takes a value for each {one}, not {len(values)} for {len(times)} {of}.")
    if len(times) < 2:
        raise InvalidInput(f"{kind} needs two samples at least.")
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if len(back):
        raise InvalidInput(
            f"{kind}.{of} must increase, but sample {back[0] + 1} (from 0) at {times[back[0] + 1]:g} {units} follows "
            f"one at {times[back[0]]:g} {units}."
        )
    object.__setattr__(owner, of, tuple(times.tolist()))
    object.__setattr__(owner, name, tuple(values.tolist()))


def shown_samples(owner: Any) -> str:
    """Say what a component of many samples is."""
    times = owner.times
    return f"{type(owner).__name__} of {len(times)} samples from {times[0]:g} to {times[-1]:g} s"


def _samples(place: str, given: Any) -> np.ndarray:
    """Return a row of finite numbers, or refuse it."""
    array = real_array(place, given)
    if array.ndim != 1:
        raise InvalidInput(f"{place} must be a row of numbers, not of shape {array.shape}.")
    wrong = np.flatnonzero(~np.isfinite(array))
    if len(wrong):
        raise InvalidInput(
            f"{place} must be finite, but {len(wrong)} of {len(array)} are not, the first at {wrong[0]} (from 0)."
        )
    return array
