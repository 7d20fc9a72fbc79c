"""Exact flow in one transition for as long as nothing can touch."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impactlab.compiling.intrinsics import borrow, dense
from impactlab.compiling.jit import kernel, loop
from impactlab.integrators.approach import approach
from impactlab.integrators.arguments import loop_type
from impactlab.integrators.driver import with_functions
from impactlab.integrators.interval_arguments import JumpTables, Work
from impactlab.integrators.kicks import KICK, LAG
from impactlab.kernels.jump import Piece, add_samples, bound, draw, hold_wall, jump, put, select
from impactlab.kernels.kick import clear, copy, smooth_velocity
from impactlab.kernels.powers import put_at_kicks, write_at_kicks
from impactlab.kernels.random import fill_normals
from impactlab.kernels.sums import write_snapshot


class Interval(NamedTuple):
    """The longest interval that a block is in."""

    number: int  # which one
    near: int  # lanes that a bound did not clear
    x: np.ndarray  # [body, lane] state at its beginning
    v: np.ndarray
    after_x: np.ndarray  # and after it
    after_v: np.ndarray


def jumping_loop() -> Callable[..., None]:
    """Return the compiled loop that jumps.

    Every realization covers intervals of up to `Jumps.steps` steps at once. The noise of an
    interval is drawn as a whole; the path between its ends is then a known mean path plus a
    Gaussian bridge. If not even a bridge of 1e-12 probability could bring a gap near contact at
    any of the steps, there is nothing to do in between. Otherwise the noise of the two halves is
    drawn, given that of the whole, and so on down to single steps. What a realization does is a
    function of its noise alone, whether it jumps or not: jumps change no path, only the work.
    """
    return with_functions(loop(loop_type(False, JumpTables, Work), _advance), False, False, False)


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
            contact_force, sample = state.contact_force, taken // steps.every - 1
            write_snapshot(state.reading, state.velocity, contact_force, sums, snapshots, sample)
            if sums.turns.late.shape[0]:
                write_at_kicks(after_v, state.still, sums, snapshots, sample)
                if last:
                    show_kicks(jumps.leaf, last, state, history, sums, snapshots, sample)
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


@kernel
def show_kicks(leaf, number, state, history, sums, snapshots, index):  # type: ignore[no-untyped-def]
    """Bring the velocities at which the last kicks of these lanes did their work into a snapshot."""
    middle, force = dense(history.v, number)[leaf - 1], dense(history.force, number)[leaf - 1]
    put_at_kicks(middle, force, state.work.levels.lanes[0], sums, snapshots, index)
