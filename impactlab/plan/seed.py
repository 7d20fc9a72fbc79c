"""The seed of all random numbers of a run."""

from __future__ import annotations

import reprlib
from typing import Any, NamedTuple

import numpy as np

from impactlab.errors import InvalidInput


class Seed(NamedTuple):
    """128 bits as two words of 64 bits."""

    low: int
    high: int


def seed_from(stored: Any) -> Seed:
    """Return the seed that a configuration holds, or refuse what is none."""
    words = isinstance(stored, list) and len(stored) == 2 and all(type(word) is int for word in stored)
    if not words or not all(0 <= word < 2**64 for word in stored):
        raise InvalidInput(f"The stored seed must be two whole numbers from 0 to 2^64 - 1, not {reprlib.repr(stored)}.")
    return Seed(*stored)


def seed_of(rng: Any) -> Seed:
    """Return 128 bits of seed from what NumPy takes as `rng` (SPEC 7), or refuse what is none of that.

    An integer or a SeedSequence gives the same seed every time; a Generator or BitGenerator gives two words and moves
    on; None gives fresh entropy. A seed is itself.
    """
    if isinstance(rng, Seed):
        return rng
    if isinstance(rng, bool):
        raise InvalidInput(f"rng must be None, a whole number of at least 0, a SeedSequence or a Generator, not {rng}.")
    if isinstance(rng, np.random.Generator | np.random.BitGenerator):
        words = np.random.default_rng(rng).integers(0, 2**64, 2, dtype=np.uint64)
        return Seed(int(words[0]), int(words[1]))
    try:
        sequence = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"rng must be None, a whole number of at least 0, a SeedSequence or a Generator, not {rng!r}."
        ) from error
    low, high = sequence.generate_state(2, np.uint64)
    return Seed(int(low), int(high))
