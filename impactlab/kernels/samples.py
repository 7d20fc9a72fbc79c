"""Sums over time of what statistics sample, composed of their functions when loops are compiled."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from impactlab.compiling.jit import Function, composed, inlined, kernel
from impactlab.compiling.scalars import scalar


class Sample(NamedTuple):
    """What is sampled of each body or contact once a step, and where it is summed."""

    function: Callable[[Any, Any], Any]  # of displacement and velocity, or of indentation and force
    of_contacts: bool
    row: int  # of `Sums.samples` or `Sums.contacts`
    largest: bool  # whether the largest is kept, not the sum


@scalar
def added(total, a, b, c, d):  # type: ignore[no-untyped-def]
    """Return a sum with four samples more."""
    return total + ((a + b) + (c + d))


@scalar
def larger(most, a, b, c, d):  # type: ignore[no-untyped-def]
    """Return the largest of four samples and of all before."""
    return max(most, max(max(a, b), max(c, d)))


def sample(first: Any, second: Any) -> Any:
    """Stand for the function of a statistic."""
    raise NotImplementedError


@inlined
def add_nothing(sums, item, lane, first, second):  # type: ignore[no-untyped-def]
    """Add nothing."""


def add_sample(sums, item, lane, first, second):  # type: ignore[no-untyped-def]
    """Add a function of two quantities in four slots to its row, after the rows of the functions before it."""
    add_nothing(sums, item, lane, first, second)
    of_a, of_b = sample(first[0], second[0]), sample(first[1], second[1])
    of_c, of_d = sample(first[2], second[2]), sample(first[3], second[3])
    sums[row, item, lane] = added(sums[row, item, lane], of_a, of_b, of_c, of_d)


def add_slots(first, second, sums):  # type: ignore[no-untyped-def]
    """Add what is sampled of two quantities, [slot, item, lane], to ``sums[row, item, lane]``."""
    for a, b, c, d in ((0, 2, 4, 6), (1, 3, 5, 7)):
        for item in range(sums.shape[1]):
            for lane in range(sums.shape[2]):
                p = first[a, item, lane], first[b, item, lane], first[c, item, lane], first[d, item, lane]
                q = second[a, item, lane], second[b, item, lane], second[c, item, lane], second[d, item, lane]
                add_nothing(sums, item, lane, p, q)


@inlined
def add_no_slots(first, second, sums):  # type: ignore[no-untyped-def]
    """Add nothing of any slot."""


row = 0
"""Stands for the row of a statistic."""


def version_of(samples: tuple[Sample, ...]) -> str:
    """Return a digest of functions and rows, which names the functions composed of them in the cache."""
    codes = [(item.function.__code__, item[1:]) for item in samples]
    parts = [(code.co_code, code.co_consts, code.co_names, rest) for code, rest in codes]
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:12]


@cache
def adding(samples: tuple[Sample, ...]) -> Function:
    """Return the function that adds all that is sampled of bodies, or of contacts: (first, second, sums)."""
    return kernel(composed(add_slots, version_of(samples), add_nothing=_chain(samples))) if samples else add_no_slots


def _chain(samples: tuple[Sample, ...]) -> Function:
    """Return the function that adds all samples of four slots: (sums, item, lane, first, second)."""
    if not samples:
        return add_nothing
    last = samples[-1]
    own = {"sample": scalar(last.function), "added": larger if last.largest else added, "row": last.row}
    return inlined(composed(add_sample, version_of(samples), add_nothing=_chain(samples[:-1]), **own))
