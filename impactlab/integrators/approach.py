"""What realizations do that may touch: intervals are halved, down to single steps."""

from __future__ import annotations

import numpy as np

from impactlab.integrators.base import History, Noise, Sums
from impactlab.integrators.exact_flow import _SHIFT, kick
from impactlab.kernels.flow import flow
from impactlab.kernels.jit import dense, kernel
from impactlab.kernels.jump import (
    add_to,
    amend_samples,
    correct,
    halve,
    hold_wall,
    jump,
    pin,
    put,
    search,
    select,
    take,
)
from impactlab.kernels.kick import clear, copy, differences, scaled_sum
from impactlab.kernels.random import fill_normals, fill_steps
from impactlab.kernels.sums import PEAK, SLOTS, F, add_history, count_closings, empty_slots


@kernel
def approach(  # type: ignore[no-untyped-def]
    forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, passes, summing,
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
            forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, passes,
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
    forces, parameters, indices, coefficients, jumps, noise, state, history, work, sums, passes, summing,
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
    counted = sums.before.shape[1]
    before = np.empty((2, counted, number))
    if counted:  # where the kick before was read; its half makes no difference that counts
        total, contact_force = past.force[0], past.contact_force[0]
        forces(x, rest, rest, 0.0, parameters, indices, before[0], contact_force, total)
        scaled_sum(x, coefficients, _SHIFT, total, y)
        forces(y, rest, rest, 0.0, parameters, indices, before[0], contact_force, total)
        differences(indices, v, before[1])
    for step in range(jumps.leaf):
        hold_wall(past.x[step])
        hold_wall(past.v[step])
        after = past.x[step]
        flow(coefficients, 0, own, 0, dense(work.steps[step // 4], number), step % 4, x, v, after)
        correct(jumps.terms[step], of_x, of_v, after, v)
        x = after
        kick(
            forces, parameters, indices, coefficients, passes, rest, x, v, y, past.v[step], past.force[step],
            past.indentation[step], past.contact_force[step],
        )  # fmt: skip
    if summing:
        bodies, contacts = sums.bodies.shape[2], sums.contacts.shape[1]
        own_sums = Sums(
            np.zeros((1, sums.bodies.shape[1], bodies, number)), np.zeros((sums.contacts.shape[0], contacts, number)),
            sums.ends, sums.indices, sums.window, sums.half_kick, sums.closing, sums.push, sums.kick, sums.products,
            sums.pairs, before, sums.jitter, sums.step,
        )  # fmt: skip
        for step in range(counted and jumps.leaf):
            count_closings(past.indentation[step], past.v[step], own_sums)
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
