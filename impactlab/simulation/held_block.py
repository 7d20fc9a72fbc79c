"""A block of a held run, with the sums of its batches."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from impactlab.kernels.rows import FLUX
from impactlab.kernels.sums import SLOTS
from impactlab.results.schema import CONTACT, sampled_of
from impactlab.simulation.block import Block

Totals = tuple[np.ndarray, ...]
"""Sums over bodies, contacts, pairs, points and laws."""


class HeldBlock:
    """A block, and the sums of the batches that are over.

    Parameters
    ----------
    block : Block
    """

    def __init__(self, block: Block) -> None:
        self.block = block
        self.behind: Block | None = None
        """The same block where its last group of steps begins, if the group is not over: sums are made by groups."""
        self.batches: list[Totals] = []
        self.transient, self.first = False, block.now  # of the statistics, and the step from which on they are taken

    def begin(self, transient: bool) -> None:
        """Begin the statistics anew."""
        self.batches, self.transient = [], transient
        self.first, self.behind = self.block.now, None
        self.block.begin_sums(transient)

    def end_batch(self) -> None:
        """End a batch, and begin the next one."""
        self.batches.append(self._totals())
        self.behind = None
        self.block.begin_sums(self.transient)

    def join_batches(self) -> None:
        """Make one batch of every two."""
        self.batches = [_joined(*pair) for pair in zip(self.batches[::2], self.batches[1::2], strict=True)]

    def totals(self) -> list[Totals]:
        """Return the sums of all batches, with the one that has begun."""
        return [*self.batches, *([self._totals()] if self.block.now > self.block.sums_began else [])]

    def _totals(self) -> Totals:
        return tuple(item.copy() for item in self.block.totals())

    def advance(self, steps: int, sampler: Callable[[np.ndarray], None]) -> None:
        """Make some steps.

        Those of a group that is not over are made again by the next call, so that sums are those of one call.
        """
        now, end = self.block.now, self.block.now + steps
        block, whole = self.behind or self.block, end // SLOTS * SLOTS
        again = now - block.now

        def new(snapshots: np.ndarray) -> None:
            nonlocal again
            sampler(snapshots[again:])
            again = max(0, again - len(snapshots))

        if whole > block.now:
            block.advance(whole - block.now, new)
        self.block, self.behind = block, None
        if end > block.now:
            self.block, self.behind = block.taken(np.arange(len(block.realizations))), block
            self.block.advance(end - block.now, new)

    def taken(self, lanes: np.ndarray) -> HeldBlock:
        """Return the same of some realizations, in their order."""
        other = HeldBlock(self.block.taken(lanes))
        other.behind = None if self.behind is None else self.behind.taken(lanes)
        other.batches = [tuple(item[..., lanes] for item in batch) for batch in self.batches]
        other.transient, other.first = self.transient, self.first
        return other


def _joined(one: Totals, other: Totals) -> Totals:
    """Return the sums of two batches joined: peaks are the larger of both."""
    result = tuple(np.add(*pair) for pair in zip(one, other, strict=True))
    for row, statistic in enumerate(sampled_of(CONTACT), FLUX + 1):
        if statistic.largest:
            result[1][row] = np.fmax(one[1][row], other[1][row])
    return result
