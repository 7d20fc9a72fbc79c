"""Realizations, and the blocks that they run in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlab.assembly.model import Model
from impactlab.machine import tuning
from impactlab.plan.subdomains import Tile
from impactlab.results.losses import Loss

LANE_STEP_SECONDS, STEP_SECONDS = 5e-9, 1e-6
"""Cost of a step, for each lane of each body and beside it, with which the length of a call is planned."""


@dataclass(frozen=True, eq=False)
class Realizations:
    """Realizations in blocks of lanes."""

    number: int  # of all realizations
    lanes: int  # realizations of a block
    steps_per_call: int  # steps of a compiled call
    trusted: bool  # whether there are enough independent realizations or batches for standard errors
    seed: tuple[int, int]  # 128 bits
    networks: int = 1  # of one structure that run side by side, with the same realizations
    first: int = 0  # the first one that is still to be run, where those before it have been
    by_body: bool = False  # whether a block of one lane has loops over bodies, in arrays without an axis of lanes
    numbered_from: int = 0  # number of the first realization, by which its random numbers are addressed
    keep: bool = False  # whether the others go on where one leaves the range of finite numbers
    losses: tuple[Loss, ...] = ()  # those that have left it, and are not run

    @classmethod
    def in_blocks(
        cls,
        model: Model,
        number: int,
        workers: int,
        seed: tuple[int, int],
        series_bytes: int,
        trusted: bool,
        most: int = 0,
    ) -> Realizations:
        """Return so many realizations in blocks, of at most `most` lanes unless that is 0, for some workers.

        The series of one realization take `series_bytes` of memory.
        """
        most, bodies, sizes = most or most_lanes(model, number, workers), len(model.mass), tuning()
        of_lane = lane_seconds(bodies, len(model.links), len(model.members.states))
        if most == 1:
            return cls(number, 1, max(1, int(sizes.call_seconds / (STEP_SECONDS + of_lane))), trusted, seed)
        blocks = -(-number // (most * workers)) * workers  # as many for each worker
        lanes = -(-number // (8 * blocks)) * 8
        if lanes % 128 == 0:  # rows that are whole kilobytes apart compete for the same lines of the cache
            lanes += 8
        lanes = min(lanes, number)
        if series_bytes:
            lanes = max(1, min(lanes, int(sizes.series_bytes / series_bytes)))
        steps = int(sizes.call_seconds / (STEP_SECONDS * (1 + bodies // 10) + of_lane * lanes))
        return cls(number, lanes, max(1, steps), trusted, seed)

    @property
    def left(self) -> int:
        """How many are to be run."""
        return self.number - self.first

    @property
    def blocks(self) -> int:
        """Number of blocks in the run."""
        return -(-self.left // self.lanes)

    def of(self, block: int) -> np.ndarray:
        """Numbers of the realizations in a block."""
        begin = self.first + block * self.lanes
        places = np.arange(begin, min(begin + self.lanes, self.number), dtype=np.uint32)
        return self._without_losses(places + np.uint32(self.numbered_from))

    @property
    def finite(self) -> int:
        """How many are finite to their ends, as far as it is known."""
        return self.number - len(self.losses)

    @property
    def finite_places(self) -> np.ndarray:
        """Places of these among all."""
        first = np.uint32(self.numbered_from)
        return self._without_losses(first + np.arange(self.number, dtype=np.uint32)) - first

    def _without_losses(self, numbers: np.ndarray) -> np.ndarray:
        return numbers[~np.isin(numbers, [loss.realization for loss in self.losses])] if self.losses else numbers

    def restricted(self, tile: Tile) -> Realizations:
        """Return itself: all tiles have the same realizations."""
        return self


OF_STATE = 5
"""Bodies that take as long as a state of a law: 3 to 7; with Bouc and Wen's hysteresis 25, unless its exponent is 1."""


def lane_seconds(bodies: int, links: int, states: int) -> float:
    """Return the time that a step takes each lane, with which lengths of calls and of measurements are planned (s)."""
    return LANE_STEP_SECONDS * (bodies + links + OF_STATE * states)


def most_lanes(model: Model, realizations: int, workers: int) -> int:
    """Return the largest number of lanes that a block should have; 1 where loops over bodies cost less."""
    bodies, sizes = len(model.mass), tuning()
    if bodies >= min(sizes.single_lane_bodies, sizes.bodies_per_lane * -(-realizations // workers)):
        return 1
    return min(sizes.lanes, max(sizes.fewest_lanes, sizes.cached // bodies // 8 * 8))
