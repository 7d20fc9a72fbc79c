"""Exact flow in one transition for as long as nothing can touch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numba
import numpy as np
from numba import b1, f8, i8, void

from impactlab.integrators.approach import approach
from impactlab.integrators.base import Flows, History, Noise, State, Sums
from impactlab.integrators.exact_flow import _KICK, ExactFlow
from impactlab.kernels.jit import FORCES, borrow, dense, loop
from impactlab.kernels.jump import add_samples, bound, draw, hold_wall, jump, put, select
from impactlab.kernels.kick import clear, copy, smooth_velocity
from impactlab.kernels.random import fill_normals
from impactlab.kernels.sums import write_snapshot
from impactlab.model import Model

Zeros = Callable[..., np.ndarray]
"""Makes an array of a shape and a type, as `numpy.zeros` does."""


class Jumps(NamedTuple):
    """How intervals are covered in one transition, or halved; `level` 0 is the shortest, a *leaf*."""

    leaf: int  # steps of a leaf
    levels: int  # how often the longest interval can be halved
    transition: np.ndarray  # (level, body, 4) flow over an interval
    draw: np.ndarray  # (body, 3) factors of the longest interval's noise
    gain: np.ndarray  # (level, body, 4) noise of the first half by that of the whole
    rest: np.ndarray  # (level, body, 3) factors of what is left to chance
    inverse: np.ndarray  # (body, 3) inverse covariance of a leaf's noise
    terms: np.ndarray  # (step, body, 4) noise of a step by multipliers of the leaf's
    path: np.ndarray  # (row, body, 4) mean path, see `search`
    limit: np.ndarray  # (row, contact) what the mean path may not exceed
    reach: np.ndarray  # (body, 3), see `bound`
    nearest: np.ndarray  # (contact,) what bounds may not exceed
    rows: np.ndarray  # (body,) row of a body's noise, -1 without
    draws: np.ndarray  # (3, row) streams of the longest intervals' noise
    halves: np.ndarray  # (3, row) streams of halves

    @property
    def steps(self) -> int:
        """Steps of the longest interval."""
        return int(self.leaf << self.levels)


class Work(NamedTuple):
    """Work space of a block that jumps."""

    after: np.ndarray  # (2, body, lane) state after an interval
    noise: np.ndarray  # (2, body, lane) of the interval
    size: np.ndarray  # [body, lane]
    worst: np.ndarray  # (1, lane)
    normals: np.ndarray  # (4, row, lane) of two intervals, single precision
    halves: np.ndarray  # (4, row, lane) of halves
    steps: np.ndarray  # (2, 4, row, lane) of the steps of a leaf
    x: np.ndarray  # (level, 2, body, lane) state before and after half an interval
    v: np.ndarray
    w: np.ndarray  # (level, 4, body, lane) noise of both halves, first x, v, then those of the second
    chosen: np.ndarray  # (level, lane) places in the level above
    lanes: np.ndarray  # (level, lane) places in the block
    realizations: np.ndarray  # (level, lane)


_VECTOR, _MATRIX = np.zeros(1), np.zeros((1, 1))
_CUBE, _CUBE_32 = np.zeros((1, 1, 1)), np.zeros((1, 1, 1), np.float32)
_FOUR, _FOUR_32 = np.zeros((1, 1, 1, 1)), np.zeros((1, 1, 1, 1), np.float32)
_INTEGERS, _PLACES = np.zeros(1, np.int64), np.zeros((1, 1), np.int64)
_WORDS, _LANES = np.zeros((1, 1), np.uint64), np.zeros((1, 1), np.uint32)

_typeof: Any = numba.typeof
_STATE: Any = State

ADVANCE_JUMPS = void(
    FORCES,
    f8[::1],
    i8[::1],
    f8[:, :, ::1],
    _typeof(
        Jumps(
            1, 1, _CUBE, _MATRIX, _CUBE, _CUBE, _MATRIX, _CUBE, _CUBE, _MATRIX, _MATRIX, _VECTOR, _INTEGERS, _WORDS,
            _WORDS,
        )
    ),
    _typeof(Noise(_INTEGERS, _PLACES, 1, _CUBE, _WORDS, _LANES[0], _MATRIX, True)),
    _typeof(_STATE(*[_MATRIX] * 12, _CUBE_32)),
    _typeof(History(*[_CUBE] * 5)),
    _typeof(
        Work(
            _CUBE, _CUBE, _MATRIX, _MATRIX, _CUBE_32, _CUBE_32, _FOUR_32, _FOUR, _FOUR, _FOUR, _PLACES, _PLACES,
            _LANES,
        )
    ),
    _typeof(
        Sums(
            _FOUR, _CUBE, _PLACES, _INTEGERS, _VECTOR, _MATRIX, _CUBE, _MATRIX, _MATRIX, _CUBE, _PLACES, _CUBE, _VECTOR,
            1.0,
        )
    ),
    f8[:, :, ::1],
    i8,
    b1,
    i8,
    i8,
    i8,
    i8,
)  # fmt: skip
"""Signature of the loop that jumps: (forces, parameters, indices, coefficients, jumps, noise, state, history,
work, sums, snapshots, passes, summing, first, count, every, phase), as in `ADVANCE`; `first`, `count` and
`every` are multiples of the longest interval."""


class WholeFlow(ExactFlow):
    """The exact flow with the exact Gaussian transition for all bodies, so that steps add up to that of an interval.

    `ExactFlow` turns into it where jumps save work.
    """

    phases: ClassVar[int] = 1

    def flows(self, model: Model, step: float) -> Flows:
        both = super().flows(model, step)
        a, q, middle_a, middle_q = (part[:1] for part in both[:-1])
        return Flows(a, q, middle_a, middle_q, both.groups)

    def _split(self, model: Model, step: float) -> np.ndarray:
        return np.zeros(len(model.mass), dtype=bool)


def jumping_loop() -> Callable[..., None]:
    """Return the compiled loop that jumps.

    Every realization covers intervals of up to `Jumps.steps` steps at once. The noise of an
    interval is drawn as a whole; the path between its ends is then a known mean path plus a
    Gaussian bridge. If not even a bridge of 1e-12 probability could bring a gap near contact at
    any of the steps, there is nothing to do in between. Otherwise the noise of the two halves is
    drawn, given that of the whole, and so on down to single steps. What a realization does is a
    function of its noise alone, whether it jumps or not: jumps change no path, only the work.
    """
    return loop(ADVANCE_JUMPS, _advance)


def work_space(jumps: Jumps, rows: int, bodies: int, lanes: int, zeros: Zeros = np.zeros) -> Work:
    """Return the work space of a block; `rows` are those of the noise of a step, `zeros` makes an array."""
    levels, noisy = jumps.levels + 1, jumps.draws.shape[1]
    return Work(
        zeros((2, bodies + 1, lanes)),
        zeros((2, bodies + 1, lanes)),
        zeros((bodies + 1, lanes)),
        zeros((1, lanes)),
        zeros((4, noisy, lanes), np.float32),
        zeros((4, noisy, lanes), np.float32),
        zeros((2, 4, rows, lanes), np.float32),
        zeros((levels, 2, bodies + 1, lanes)),
        zeros((levels, 2, bodies + 1, lanes)),
        zeros((levels, 4, bodies + 1, lanes)),
        zeros((levels, lanes), np.int64),
        zeros((levels, lanes), np.int64),
        zeros((levels, lanes), np.uint32),
    )


def _advance(  # type: ignore[no-untyped-def]
    forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, snapshots, passes,
    summing, first, count, every, phase,
):  # fmt: skip
    jumps, noise, state, history = borrow(jumps), borrow(noise), borrow(state), borrow(history)
    work, sums, snapshots = borrow(work), borrow(sums), borrow(snapshots)
    coefficients, parameters, indices = borrow(coefficients), borrow(parameters), borrow(indices)
    length = jumps.leaf << jumps.levels
    x, v, after_x, after_v = state.x, state.v, work.after[0], work.after[1]
    wx, wv = work.noise[0], work.noise[1]
    for done in range(length, count + 1, length):
        interval = (first + done) // length - 1
        if jumps.draws.shape[1] and (done == length or interval % 2 == 0):
            fill_normals(jumps.draws, noise.realizations, np.uint64(interval // 2), work.normals)
        draw(jumps.draw, jumps.rows, work.normals, 2 * (interval % 2), wx, wv, work.size)
        jump(jumps.transition[jumps.levels], x, v, wx, wv, after_x, after_v)
        bound(jumps.reach, sums.ends, jumps.nearest, x, v, work.size, work.worst)
        near = select(work.worst, work.chosen[jumps.levels])
        last = 0
        if near:
            last = approach(
                forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, passes,
                summing, interval, near, x, v, after_x, after_v,
            )  # fmt: skip
        if summing:
            add_samples(after_x, after_v, sums.bodies[0])
        wanted = every > 0 and (phase + done) % every == 0
        if wanted or done == count:
            copy(after_x, state.reading)
            copy(after_v, state.velocity)
            clear(state.contact_force)
            if last:
                lanes = work.lanes[0]
                put(dense(state.external, last), lanes, state.reading)
                middle, force, smooth = (
                    dense(history.v, last)[jumps.leaf - 1], dense(history.force, last), dense(state.slope_x, last)
                )  # fmt: skip
                hold_wall(smooth)
                smooth_velocity(coefficients, _KICK, middle, force[jumps.leaf - 1], force[jumps.leaf - 2], smooth)
                put(smooth, lanes, state.velocity)
                put(dense(history.contact_force, last)[jumps.leaf - 1], lanes, state.contact_force)
        if wanted:
            write_snapshot(
                state.reading, state.velocity, state.contact_force, sums, snapshots, (phase + done) // every - 1
            )
        x, v, after_x, after_v = after_x, after_v, x, v
    copy(x, state.x)
    copy(v, state.v)
