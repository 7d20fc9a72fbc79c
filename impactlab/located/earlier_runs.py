"""Runs from event to event that go on from the end of an earlier one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from impactlab.errors import InvalidInput


class Earlier(NamedTuple):
    """The end of an earlier run."""

    time: float  # (s)
    numbers: np.ndarray  # (realization, number) from `numbers_of`


def numbers_of(lasting: Sequence[np.ndarray]) -> np.ndarray:
    """Return the numbers of arrays, (lane, …), from which other lanes go on, (lane, number)."""
    return np.concatenate([item.reshape(len(item), -1).astype(float) for item in lasting], axis=1)


def go_on(lasting: Sequence[np.ndarray], numbers: np.ndarray) -> None:
    """Write the numbers of the end of an earlier run to the arrays of the lanes that go on from there."""
    ends = np.cumsum([item[0].size for item in lasting])
    if numbers.shape[1] != ends[-1]:
        raise InvalidInput(
            "No run can continue from this state: it is that of another version of impactlab, or of a run with another "
            "il.Section; without continues=True it is a start."
        )
    for item, part in zip(lasting, np.split(numbers, ends[:-1], axis=1), strict=True):
        item[...] = part.reshape(item.shape)
