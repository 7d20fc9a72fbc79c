"""What the loop over contact-free intervals takes; see `impactlab.integrators.jumps`."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impactlab.compiling.records import (
    Block,
    Blocks,
    BlockTable,
    Cube,
    Normals,
    NormalTable,
    Numbers,
    RealizationTable,
    Slots,
    SlotTable,
    Streams,
    Table,
)

Zeros = Callable[..., np.ndarray]
"""Makes an array of a shape and a type, as `numpy.zeros` does."""


class IntervalNoise(NamedTuple):
    """Noise of intervals; `level` 0 is the shortest interval, a *leaf*."""

    draw: Table  # (body, 3) factors of the longest interval's noise
    gain: Cube  # (level, body, 4) noise of the first half by that of the whole
    rest: Cube  # (level, body, 3) factors of what is left to chance
    inverse: Table  # (body, 3) inverse covariance of a leaf's noise
    terms: Cube  # (step, body, 4) noise of a step by multipliers of the leaf's
    rows: Slots  # (body,) row of a body's noise, -1 without
    draws: Streams  # (3, row) streams of the longest intervals' noise
    halves: Streams  # (3, row) streams of halves


class Jumps(NamedTuple):
    """How intervals are covered in one transition, or halved."""

    leaf: int  # steps of a leaf
    levels: int  # how often the longest interval can be halved
    transition: Cube  # (level, body, 4) flow over an interval
    noise: IntervalNoise
    path: Cube  # (row, body, 4) mean path, see `search`
    limit: Table  # (row, contact) what the mean path may not exceed
    reach: Table  # (body, 3), see `bound`
    nearest: Numbers  # (contact,) what bounds may not exceed

    @property
    def steps(self) -> int:
        """Steps of the longest interval."""
        return int(self.leaf << self.levels)


class JumpTables(NamedTuple):
    """Numbers of the forces and of intervals."""

    parameters: Numbers
    indices: Slots
    coefficients: Cube
    jumps: Jumps


class Levels(NamedTuple):
    """The lanes that may touch, level by level."""

    x: BlockTable  # (level, 2, body, lane) state before and after half an interval
    v: BlockTable
    w: BlockTable  # (level, 4, body, lane) noise of both halves, first x, v, then those of the second
    chosen: SlotTable  # (level, lane) places in the level above
    lanes: SlotTable  # (level, lane) places in the block
    realizations: RealizationTable  # (level, lane)


class Work(NamedTuple):
    """Work space of a block that jumps."""

    after: Blocks  # (2, body, lane) state after an interval
    noise: Blocks  # (2, body, lane) of the interval
    size: Block  # [body, lane]
    worst: Block  # (1, lane)
    place: Block  # [body, lane] where kicks are read
    smooth: Block  # [body, lane] velocities of the smooth path
    normals: Normals  # (4, row, lane) of two intervals, single precision
    halves: Normals  # (4, row, lane) of halves
    steps: NormalTable  # (2, 4, row, lane) of the steps of a leaf
    levels: Levels


def work_space(jumps: Jumps, rows: int, bodies: int, lanes: int, zeros: Zeros = np.zeros) -> Work:
    """Return the work space of a block; `rows` are those of the noise of a step, `zeros` makes an array."""
    levels, noisy = jumps.levels + 1, jumps.noise.draws.shape[1]
    single = np.float32
    return Work(
        after=zeros((2, bodies + 1, lanes)),
        noise=zeros((2, bodies + 1, lanes)),
        size=zeros((bodies + 1, lanes)),
        worst=zeros((1, lanes)),
        place=zeros((bodies + 1, lanes)),
        smooth=zeros((bodies + 1, lanes)),
        normals=zeros((4, noisy, lanes), single),
        halves=zeros((4, noisy, lanes), single),
        steps=zeros((2, 4, rows, lanes), single),
        levels=Levels(
            x=zeros((levels, 2, bodies + 1, lanes)),
            v=zeros((levels, 2, bodies + 1, lanes)),
            w=zeros((levels, 4, bodies + 1, lanes)),
            chosen=zeros((levels, lanes), np.int64),
            lanes=zeros((levels, lanes), np.int64),
            realizations=zeros((levels, lanes), np.uint32),
        ),
    )
