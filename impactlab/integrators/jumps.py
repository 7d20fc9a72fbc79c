"""Exact flow in one transition for as long as nothing can touch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import f4, i8, u4, u8, void

from impactlab.integrators.approach import approach
from impactlab.integrators.arguments import OF_LANES, State, array, named
from impactlab.integrators.driver import with_functions
from impactlab.integrators.kicks import KICK, LAG
from impactlab.kernels.arrays import borrow, dense
from impactlab.kernels.jit import kernel, loop
from impactlab.kernels.jump import Piece, add_samples, bound, draw, hold_wall, jump, put, select
from impactlab.kernels.kick import clear, copy, smooth_velocity
from impactlab.kernels.random import fill_normals
from impactlab.kernels.sums import write_snapshot

Zeros = Callable[..., np.ndarray]
"""Makes an array of a shape and a type, as `numpy.zeros` does."""


class IntervalNoise(NamedTuple):
    """Noise of intervals; `level` 0 is the shortest interval, a *leaf*."""

    draw: np.ndarray  # (body, 3) factors of the longest interval's noise
    gain: np.ndarray  # (level, body, 4) noise of the first half by that of the whole
    rest: np.ndarray  # (level, body, 3) factors of what is left to chance
    inverse: np.ndarray  # (body, 3) inverse covariance of a leaf's noise
    terms: np.ndarray  # (step, body, 4) noise of a step by multipliers of the leaf's
    rows: np.ndarray  # (body,) row of a body's noise, -1 without
    draws: np.ndarray  # (3, row) streams of the longest intervals' noise
    halves: np.ndarray  # (3, row) streams of halves


class Jumps(NamedTuple):
    """How intervals are covered in one transition, or halved."""

    leaf: int  # steps of a leaf
    levels: int  # how often the longest interval can be halved
    transition: np.ndarray  # (level, body, 4) flow over an interval
    noise: IntervalNoise
    path: np.ndarray  # (row, body, 4) mean path, see `search`
    limit: np.ndarray  # (row, contact) what the mean path may not exceed
    reach: np.ndarray  # (body, 3), see `bound`
    nearest: np.ndarray  # (contact,) what bounds may not exceed

    @property
    def steps(self) -> int:
        """Steps of the longest interval."""
        return int(self.leaf << self.levels)


class JumpTables(NamedTuple):
    """Numbers of the forces and of intervals."""

    parameters: np.ndarray
    indices: np.ndarray
    coefficients: np.ndarray
    jumps: Jumps


class Levels(NamedTuple):
    """The lanes that may touch, level by level."""

    x: np.ndarray  # (level, 2, body, lane) state before and after half an interval
    v: np.ndarray
    w: np.ndarray  # (level, 4, body, lane) noise of both halves, first x, v, then those of the second
    chosen: np.ndarray  # (level, lane) places in the level above
    lanes: np.ndarray  # (level, lane) places in the block
    realizations: np.ndarray  # (level, lane)


class Work(NamedTuple):
    """Work space of a block that jumps."""

    after: np.ndarray  # (2, body, lane) state after an interval
    noise: np.ndarray  # (2, body, lane) of the interval
    size: np.ndarray  # [body, lane]
    worst: np.ndarray  # (1, lane)
    place: np.ndarray  # [body, lane] where kicks are read
    smooth: np.ndarray  # [body, lane] velocities of the smooth path
    normals: np.ndarray  # (4, row, lane) of two intervals, single precision
    halves: np.ndarray  # (4, row, lane) of halves
    steps: np.ndarray  # (2, 4, row, lane) of the steps of a leaf
    levels: Levels


class Interval(NamedTuple):
    """The longest interval that a block is in."""

    number: int  # which one
    near: int  # lanes that a bound did not clear
    x: np.ndarray  # [body, lane] state at its beginning
    v: np.ndarray
    after_x: np.ndarray  # and after it
    after_v: np.ndarray


def _signature() -> Any:
    """Signature of the loop, as that of `impactlab.integrators.driver.advance`."""
    numbers, matrix, cube, four = (array(dimensions) for dimensions in range(1, 5))
    slots, words, places = array(1, i8), array(2, u8), array(2, i8)
    noise = named(IntervalNoise, matrix, cube, cube, matrix, cube, slots, words, words)
    jumps = named(Jumps, i8, i8, cube, noise, cube, matrix, matrix, numbers)
    tables = named(JumpTables, numbers, slots, cube, jumps)
    levels = named(Levels, four, four, four, places, places, array(2, u4))
    normals = array(3, f4)
    work = named(Work, cube, cube, *[matrix] * 4, normals, normals, array(4, f4), levels)
    other = OF_LANES
    state = named(State, *[matrix] * 8, work)
    return void(other.functions, tables, other.driven, state, other.history, other.sums, cube, other.steps)


def jumping_loop() -> Callable[..., None]:
    """Return the compiled loop that jumps.

    Every realization covers intervals of up to `Jumps.steps` steps at once. The noise of an
    interval is drawn as a whole; the path between its ends is then a known mean path plus a
    Gaussian bridge. If not even a bridge of 1e-12 probability could bring a gap near contact at
    any of the steps, there is nothing to do in between. Otherwise the noise of the two halves is
    drawn, given that of the whole, and so on down to single steps. What a realization does is a
    function of its noise alone, whether it jumps or not: jumps change no path, only the work.
    """
    return with_functions(loop(_signature(), _advance), False)


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


def _advance(functions, tables, driven, state, history, sums, snapshots, steps):  # type: ignore[no-untyped-def]
    tables, driven, state = borrow(tables), borrow(driven), borrow(state)
    history, sums, snapshots = borrow(history), borrow(sums), borrow(snapshots)
    jumps, work = tables.jumps, state.work
    length = jumps.leaf << jumps.levels
    x, v, after_x, after_v = state.x, state.v, work.after[0], work.after[1]
    wx, wv = work.noise[0], work.noise[1]
    for done in range(length, steps.number + 1, length):
        index = (steps.first + done) // length - 1
        if jumps.noise.draws.shape[1] and (done == length or index % 2 == 0):
            fill_normals(jumps.noise.draws, driven.noise.realizations, np.uint64(index // 2), work.normals)
        draw(jumps.noise.draw, jumps.noise.rows, work.normals, 2 * (index % 2), wx, wv, work.size)
        jump(jumps.transition[jumps.levels], Piece(x, v, wx, wv), after_x, after_v)
        bound(jumps.reach, sums.ends, jumps.nearest, x, v, work.size, work.worst)
        near = select(work.worst, work.levels.chosen[jumps.levels])
        last = 0
        if near:
            interval = Interval(index, near, x, v, after_x, after_v)
            last = approach(functions, tables, driven.noise, state, history, sums, steps, interval)
        if steps.summing:
            add_samples(after_x, after_v, sums.bodies[0])
        taken = steps.phase + done
        wanted = steps.every > 0 and taken % steps.every == 0
        if wanted or done == steps.number:
            copy(after_x, state.reading)
            copy(after_v, state.velocity)
            clear(state.contact_force)
            if last:
                show(tables.coefficients, jumps.leaf, last, state, history)
        if wanted:
            contact_force = state.contact_force
            write_snapshot(state.reading, state.velocity, contact_force, sums, snapshots, taken // steps.every - 1)
        x, v, after_x, after_v = after_x, after_v, x, v
    copy(x, state.x)
    copy(v, state.v)


@kernel
def show(coefficients, leaf, number, state, history):  # type: ignore[no-untyped-def]
    """Bring the last step of the lanes that took it where samples are read."""
    lanes = state.work.levels.lanes[0]
    put(dense(state.work.place, number), lanes, state.reading)
    middle, force, smooth = (
        dense(history.v, number)[leaf - 1],
        dense(history.force, number),
        dense(state.work.smooth, number),
    )
    hold_wall(smooth)
    smooth_velocity(coefficients, KICK, LAG, middle, force[leaf - 1], force[leaf - 2], smooth)
    put(smooth, lanes, state.velocity)
    put(dense(history.contact_force, number)[leaf - 1], lanes, state.contact_force)
