"""Sums over time of what statistics sample, composed of their functions when loops are compiled."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from impactlab.kernels.jit import Function, composed, inlined, kernel
from impactlab.kernels.scalars import scalar


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
    """Return the largest of four samples and those before."""
    return max(most, max(max(a, b), max(c, d)))


def sample(first: Any, second: Any) -> Any:
    """Stand for the function of a statistic."""
    raise NotImplementedError


def add_slots(first: Any, second: Any, sums: Any) -> None:
    """Add what a function makes of two quantities, [slot, item, lane], to ``sums[item, lane]``."""
    for a, b, c, d in ((0, 2, 4, 6), (1, 3, 5, 7)):
        for item in range(sums.shape[0]):
            for lane in range(sums.shape[1]):
                of_a = sample(first[a, item, lane], second[a, item, lane])
                of_b = sample(first[b, item, lane], second[b, item, lane])
                of_c = sample(first[c, item, lane], second[c, item, lane])
                of_d = sample(first[d, item, lane], second[d, item, lane])
                sums[item, lane] = added(sums[item, lane], of_a, of_b, of_c, of_d)


@inlined
def add_nothing(history, sums):  # type: ignore[no-untyped-def]
    """Add nothing."""


def add_of_contacts(history, sums):  # type: ignore[no-untyped-def]
    """Add what is sampled of contacts to its row, and all before it."""
    add_nothing(history, sums)
    add_slots(history.indentation, history.contact_force, sums.contacts[row])


def add_of_bodies(history, sums):  # type: ignore[no-untyped-def]
    """Add what is sampled of bodies to its row, and all before it."""
    add_nothing(history, sums)
    add_slots(history.x, history.v, sums.samples[row])


row = 0
"""Stands for the row of a statistic."""


def version_of(samples: tuple[Sample, ...]) -> str:
    """Return a digest of functions and rows, by which the cache knows what is composed of them."""
    codes = [(item.function.__code__, item[1:]) for item in samples]
    parts = [(code.co_code, code.co_consts, code.co_names, rest) for code, rest in codes]
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:12]


@cache
def adding(samples: tuple[Sample, ...]) -> Function:
    """Return the function that adds all that is sampled: (history, sums)."""
    if not samples:
        return add_nothing
    last, version = samples[-1], version_of(samples)
    own = {"sample": scalar(last.function), "added": larger if last.largest else added}
    slots = kernel(composed(add_slots, version_of((last,)), **own))
    link = add_of_contacts if last.of_contacts else add_of_bodies
    return inlined(composed(link, version, add_nothing=adding(samples[:-1]), add_slots=slots, row=last.row))
