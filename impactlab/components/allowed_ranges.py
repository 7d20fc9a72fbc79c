"""Ranges of a quantity between two limits, either of which may be absent."""

from __future__ import annotations

import math
from typing import Any

from impactlab.errors import InvalidInput
from impactlab.inputs import finite

Limits = tuple[float | None, float | None]
"""The lower and the upper limit, None for none."""


def range_of(place: str, given: Any) -> Limits:
    """Return the range that is given as a pair, or as a positive number for limits on both sides of 0.

    Parameters
    ----------
    place : str
        Where it was given, for messages.
    given : float or pair of float
        None or an infinite number in a pair is no limit.

    Raises
    ------
    InvalidInput
        If it is none of these.
    """
    if isinstance(given, list | tuple):
        if len(given) != 2:
            raise InvalidInput(f"{place} takes two limits, (lower, upper), not {given!r}; None is no limit.")
        low, high = (_limit(place, value, sign * math.inf) for value, sign in zip(given, (-1.0, 1.0), strict=True))
        if low is None and high is None:
            raise InvalidInput(f"{place} has no limit: {given!r}; give at least one number.")
        if low is not None and high is not None and not low < high:
            raise InvalidInput(f"{place}: the lower limit must be below the upper one, not {given!r}.")
        return low, high
    limit = finite(place, given)
    if limit <= 0.0:
        raise InvalidInput(f"{place}: a single number is a limit on both sides of 0, above 0, not {given!r}.")
    return -limit, limit


def _limit(place: str, value: Any, none: float) -> float | None:
    """Return a limit, None where it is absent."""
    return None if value is None or value == none else finite(place, value)
