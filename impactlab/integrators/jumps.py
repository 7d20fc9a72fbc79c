"""Exact flow in one transition for as long as nothing can touch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numba
import numpy as np
from numba import b1, f8, i8, void

from impactlab.integrators.base import Flows, History, Noise, State, Sums
from impactlab.integrators.exact_flow import ExactFlow, kick
from impactlab.kernels.flow import flow
from impactlab.kernels.jit import FORCES, borrow, dense, kernel, loop
from impactlab.kernels.jump import (
    add_samples,
    add_to,
    amend_samples,
    bound,
    correct,
    draw,
    halve,
    hold_wall,
    jump,
    pin,
    put,
    search,
    select,
    take,
)
from impactlab.kernels.kick import clear, copy
from impactlab.kernels.random import fill_normals, fill_steps
from impactlab.kernels.sums import PEAK, SLOTS, F, add_history, empty_slots, write_snapshot
from impactlab.model import Model


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
    _typeof(_STATE(*[_MATRIX] * 11, _CUBE_32)),
    _typeof(History(*[_CUBE] * 5)),
    _typeof(
        Work(
            _CUBE, _CUBE, _MATRIX, _MATRIX, _CUBE_32, _CUBE_32, _FOUR_32, _FOUR, _FOUR, _FOUR, _PLACES, _PLACES,
            _LANES,
        )
    ),
    _typeof(Sums(_FOUR, _CUBE, _PLACES, _INTEGERS, _VECTOR, _VECTOR, _CUBE, _MATRIX, _MATRIX, _CUBE, _PLACES)),
    f8[:, :, ::1],
    b1,
    b1,
    i8,
    i8,
    i8,
    i8,
)  # fmt: skip
"""Signature of the loop that jumps: (forces, parameters, indices, coefficients, jumps, noise, state, history,
work, sums, snapshots, dissipative, summing, first, count, every, phase), as in `ADVANCE`; `first`, `count` and
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


def work_space(jumps: Jumps, rows: int, bodies: int, lanes: int) -> Work:
    """Return the work space of a block; `rows` are those of the noise of a step."""
    levels, noisy = jumps.levels + 1, jumps.draws.shape[1]
    return Work(
        np.zeros((2, bodies + 1, lanes)),
        np.zeros((2, bodies + 1, lanes)),
        np.zeros((bodies + 1, lanes)),
        np.zeros((1, lanes)),
        np.zeros((4, noisy, lanes), np.float32),
        np.zeros((4, noisy, lanes), np.float32),
        np.zeros((2, 4, rows, lanes), np.float32),
        np.zeros((levels, 2, bodies + 1, lanes)),
        np.zeros((levels, 2, bodies + 1, lanes)),
        np.zeros((levels, 4, bodies + 1, lanes)),
        np.zeros((levels, lanes), np.int64),
        np.zeros((levels, lanes), np.int64),
        np.zeros((levels, lanes), np.uint32),
    )


def _advance(  # type: ignore[no-untyped-def]
    forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, snapshots, dissipative,
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
                forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, dissipative,
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
                put(dense(history.v, last)[jumps.leaf - 1], lanes, state.velocity)
                put(dense(history.contact_force, last)[jumps.leaf - 1], lanes, state.contact_force)
        if wanted:
            write_snapshot(state.reading, state.velocity, state.contact_force, snapshots, (phase + done) // every - 1)
        x, v, after_x, after_v = after_x, after_v, x, v
    copy(x, state.x)
    copy(v, state.v)


@kernel
def approach(  # type: ignore[no-untyped-def]
    forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, dissipative, summing,
    interval, near, x, v, after_x, after_v,
):  # fmt: skip
    """Carry the lanes that may touch over an interval; return how many of them took its last steps one by one.

    Intervals are halved in the order of time, each for the lanes that may touch in it. The lanes of a
    level are dense blocks of their own.
    """
    top, leaf, ends = jumps.levels, jumps.leaf, sums.ends
    counts, half = np.zeros(top + 1, np.int64), np.zeros(top + 1, np.int64)
    node, begin = np.zeros(top + 1, np.int64), np.zeros(top + 1, np.int64)
    # look closer at those that a bound did not clear
    chosen, flagged = work.chosen[top], work.chosen[0]
    take_level(top, near, x, v, work.noise[0], work.noise[1], chosen, noise.realizations, work)
    now = half[top]
    number = find(jumps, ends, top, top, 2 * now + 2, now, near, work, flagged)
    for lane in range(number):
        chosen[lane] = chosen[flagged[lane]]
    if number == 0:
        return 0
    take_level(top, number, x, v, work.noise[0], work.noise[1], chosen, noise.realizations, work)
    for lane in range(number):
        work.lanes[top, lane] = chosen[lane]
    level, counts[top], node[top], begin[top] = top, number, 1, interval * (leaf << top)
    halve_level(jumps, top, number, interval, node[top], work)
    last = 0
    while half[top] < 2:
        n, now = counts[level], half[level]
        if now == 2:
            above = level + 1
            put(dense(work.x[level, 0], n), work.chosen[level], dense(work.x[above, 1 - half[above]], counts[above]))
            put(dense(work.v[level, 0], n), work.chosen[level], dense(work.v[above, 1 - half[above]], counts[above]))
            half[above] += 1
            level = above
            continue
        part = level - 1
        number = find(jumps, ends, part, level, 2 * now, now, n, work, work.chosen[part])
        old_x, old_v = dense(work.x[level, now], n), dense(work.v[level, now], n)
        wx, wv = dense(work.w[level, 2 * now], n), dense(work.w[level, 2 * now + 1], n)
        new_x, new_v = dense(work.x[level, 1 - now], n), dense(work.v[level, 1 - now], n)
        jump(jumps.transition[part], old_x, old_v, wx, wv, new_x, new_v)
        last = 0
        if number == 0:
            half[level] += 1
            continue
        take_level(part, number, old_x, old_v, wx, wv, work.chosen[part], work.realizations[level], work)
        for lane in range(number):
            work.lanes[part, lane] = work.lanes[level, work.chosen[part, lane]]
        counts[part], begin[part] = number, begin[level] + now * (leaf << part)
        if part > 0:
            node[part], half[part] = 2 * node[level] + now, 0
            halve_level(jumps, part, number, interval, node[part], work)
            level = part
            continue
        step_by_step(
            forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, dissipative,
            summing, begin[0], number,
        )  # fmt: skip
        put(dense(work.x[0, 1], number), work.chosen[0], new_x)
        put(dense(work.v[0, 1], number), work.chosen[0], new_v)
        half[level] += 1
        last = number
    put(dense(work.x[top, 0], counts[top]), work.lanes[top], after_x)
    put(dense(work.v[top, 0], counts[top]), work.lanes[top], after_v)
    if last and summing:
        middle = dense(history.v, last)[leaf - 1]
        amend_samples(dense(work.x[0, 1], last), dense(work.v[0, 1], last), middle, work.lanes[0], sums.bodies[0])
    return last


@kernel
def take_level(level, number, x, v, wx, wv, chosen, realizations, work):  # type: ignore[no-untyped-def]
    """Fill the blocks of a level with some lanes."""
    take(x, chosen, dense(work.x[level, 0], number))
    take(v, chosen, dense(work.v[level, 0], number))
    take(wx, chosen, dense(work.w[level, 2], number))
    take(wv, chosen, dense(work.w[level, 3], number))
    for lane in range(number):
        work.realizations[level, lane] = realizations[chosen[lane]]


@kernel
def find(jumps, ends, part, level, noise, state, number, work, chosen):  # type: ignore[no-untyped-def]
    """Find the lanes of a level that may touch within an interval of the level `part`."""
    worst = dense(work.worst, number)
    begin = jumps.leaf * ((1 << part) - 1)
    search(
        jumps.path, ends, jumps.limit, begin, begin + (jumps.leaf << part), dense(work.x[level, state], number),
        dense(work.v[level, state], number), dense(work.w[level, noise], number),
        dense(work.w[level, noise + 1], number), worst,
    )  # fmt: skip
    return select(worst, chosen)


@kernel
def halve_level(jumps, level, number, interval, node, work):  # type: ignore[no-untyped-def]
    """Draw the noise of the halves of the intervals of a level; `node` numbers them within the longest one."""
    normals = dense(work.halves, number)
    if jumps.halves.shape[1]:
        address = np.uint64((interval << jumps.levels) + node)
        fill_normals(jumps.halves, work.realizations[level][:number], address, normals)
    halve(
        jumps.gain[level], jumps.rest[level], jumps.transition[level - 1], jumps.rows, normals,
        dense(work.w[level, 2], number), dense(work.w[level, 3], number), dense(work.w[level, 0], number),
        dense(work.w[level, 1], number),
    )  # fmt: skip


@kernel
def step_by_step(  # type: ignore[no-untyped-def]
    forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, dissipative, summing,
    first, number,
):  # fmt: skip
    """Carry the lanes of a leaf over it, step by step, and add contacts and kicks to the sums of the block."""
    own = Noise(
        noise.bodies, noise.runs, noise.seconds, noise.amplitude, noise.streams, work.realizations[0][:number],
        noise.scale, noise.coarse,
    )  # fmt: skip
    groups = jumps.leaf // 4
    x, v = dense(work.x[0, 0], number), dense(work.v[0, 0], number)
    of_x, of_v, spare = dense(work.w[0, 0], number), dense(work.w[0, 1], number), dense(work.x[0, 1], number)
    clear(of_x)
    clear(of_v)
    clear(spare)
    for group in range(groups):
        normals = dense(work.steps[group], number)
        if noise.bodies.shape[0]:
            fill_steps(own, first // 4 + group, normals)
        for column in range(4):
            flow(coefficients, 0, own, 0, normals, column, of_x, of_v, spare)
            of_x, spare = spare, of_x
    pin(jumps.inverse, dense(work.w[0, 2], number), dense(work.w[0, 3], number), of_x, of_v)
    past = History(
        dense(history.x, number), dense(history.v, number), dense(history.force, number),
        dense(history.indentation, number), dense(history.contact_force, number),
    )  # fmt: skip
    empty_slots(past, jumps.leaf, SLOTS)
    y, rest = dense(state.external, number), dense(state.rest, number)
    hold_wall(y)
    for step in range(jumps.leaf):
        hold_wall(past.x[step])
        hold_wall(past.v[step])
        after = past.x[step]
        flow(coefficients, 0, own, 0, dense(work.steps[step // 4], number), step % 4, x, v, after)
        correct(jumps.terms[step], of_x, of_v, after, v)
        x = after
        kick(
            forces, parameters, indices, coefficients, dissipative, rest, x, v, y, past.v[step], past.force[step],
            past.indentation[step], past.contact_force[step],
        )  # fmt: skip
    if summing:
        bodies, contacts = sums.bodies.shape[2], sums.contacts.shape[1]
        own_sums = Sums(
            np.zeros((1, sums.bodies.shape[1], bodies, number)), np.zeros((sums.contacts.shape[0], contacts, number)),
            sums.ends, sums.indices, sums.window, sums.half_kick, sums.closing, sums.push, sums.kick, sums.products,
            sums.pairs,
        )  # fmt: skip
        add_history(past, own_sums)
        lanes = work.lanes[0]
        for row in range(F, sums.bodies.shape[1]):
            add_to(own_sums.bodies[0, row], lanes, sums.bodies[0, row])
        for row in range(PEAK):
            add_to(own_sums.contacts[row], lanes, sums.contacts[row])
        for contact in range(contacts):
            for lane in range(number):
                peak = sums.contacts[PEAK, contact, lanes[lane]]
                sums.contacts[PEAK, contact, lanes[lane]] = max(peak, own_sums.contacts[PEAK, contact, lane])
    copy(x, dense(work.x[0, 1], number))
    copy(v, dense(work.v[0, 1], number))
