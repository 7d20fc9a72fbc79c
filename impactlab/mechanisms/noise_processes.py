"""What processes of noises have in common: bodies that move together, where they begin, and tables of responses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.kernels.random import addresses, fill_normals
from impactlab.linear.laws import MOST_TOGETHER
from impactlab.linear.noise_motion import NoiseMotion
from impactlab.mechanisms.sampled_responses import Sparse


class DrawnStart(NamedTuple):
    """Where a process, and what it moves, begin: a root of their covariance times normal numbers."""

    streams: np.ndarray  # (3, stream) addresses
    slots: np.ndarray  # (body,)
    states: slice  # of the process among those of all
    root: np.ndarray  # (state and x and v, normal)
    mean: np.ndarray  # (x and v,) of the bodies

    @classmethod
    def of(cls, motion: NoiseMotion, first: int, seed: tuple[int, int]) -> DrawnStart:
        """Return the start of a motion whose states, among those of all, begin at the first."""
        root = motion.start()
        streams = [addresses(seed, [motion.name], f"begin {number}") for number in range(-(-len(root) // 4))]
        states = slice(first, first + motion.states)
        return cls(np.concatenate(streams, axis=1), motion.slots, states, root, motion.mean.ravel())

    def draw(self, realizations: np.ndarray, attempt: int) -> np.ndarray:
        """Return the states of the process, displacements and velocities of some realizations, (row, lane)."""
        normals = np.empty((4, self.streams.shape[1], len(realizations)), dtype=np.float32)
        fill_normals(self.streams, realizations, np.uint64(attempt), normals)
        rows = normals.transpose(1, 0, 2).reshape(-1, len(realizations))
        # the same bits in any block, as a matrix product would not be
        result = np.asarray(sum(column[:, None] * row for column, row in zip(self.root.T, rows, strict=False)))
        if self.mean.any():
            result[-len(self.mean) :] += self.mean[:, None]
        return result


def check_together(motions: Sequence[NoiseMotion]) -> None:
    """Refuse a noise that moves too many bodies at a time."""
    for motion in motions:
        if len(motion.slots) > MOST_TOGETHER:
            raise InvalidInput(
                f"The {motion.called} {motion.name!r} moves {len(motion.slots)} bodies at a time; {MOST_TOGETHER} "
                "is the most. Use several sources."
            )


def envelopes_of(motions: Sequence[NoiseMotion]) -> np.ndarray:
    """Return which envelope each motion has, −1 for none, (motion,)."""
    modulated = np.array([motion.modulated for motion in motions], dtype=bool)
    return np.where(modulated, np.cumsum(modulated) - 1, -1)


def pairs_of(motions: Sequence[NoiseMotion]) -> np.ndarray:
    """Return the rows of both parts of each response, −1 for none, and its envelope or −1, (response, 3).

    Rows of the states of all motions come first.
    """
    result, first = [np.zeros((0, 3), dtype=np.int64)], sum(motion.states for motion in motions)
    for motion, envelope in zip(motions, envelopes_of(motions).tolist(), strict=True):
        count = 2 * len(motion.slots)
        own = first + np.arange(count)
        growing = own + count if motion.modulated else np.full(count, -1)
        result.append(np.stack([own, growing, np.full(count, envelope)], axis=1))
        first += count * (2 if motion.modulated else 1)
    return np.concatenate(result)


def responding(motions: Sequence[NoiseMotion]) -> np.ndarray:
    """Return the bodies that respond, in the order of the responses."""
    return np.concatenate([np.zeros(0, dtype=np.int64), *(motion.slots for motion in motions)])


def sparse(blocks: Sequence[np.ndarray]) -> Sparse:
    """Return a matrix that has some blocks on its diagonal."""
    lengths, columns, values, column = [np.zeros(1, dtype=np.int64)], [], [], 0
    for block in blocks:
        row, place = np.nonzero(block)
        lengths.append(np.bincount(row, minlength=len(block)))
        columns.append(column + place)
        values.append(block[row, place])
        column += block.shape[1]
    none = np.zeros(0, dtype=np.int64)
    return Sparse(
        np.cumsum(np.concatenate(lengths)), np.concatenate([none, *columns]), np.concatenate([np.zeros(0), *values])
    )
