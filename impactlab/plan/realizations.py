"""Realizations and the blocks that they run in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Realizations:
    """Realizations in blocks of lanes.

    Attributes
    ----------
    number : int
        Of all realizations.
    lanes : int
        Realizations of a block.
    steps_per_call : int
        Steps of a compiled call.
    trusted : bool
        Whether there are enough independent realizations or batches for standard errors.
    seed : tuple of int
        128 bits.
    """

    number: int
    lanes: int
    steps_per_call: int
    trusted: bool
    seed: tuple[int, int]

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.number // self.lanes)

    def of(self, block: int) -> np.ndarray:
        """Indices of the realizations in a block."""
        return np.arange(block * self.lanes, min((block + 1) * self.lanes, self.number), dtype=np.uint32)
