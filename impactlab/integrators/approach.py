"""Realizations near contact: their intervals are halved, down to single steps."""

from __future__ import annotations

import numpy as np

from impactlab.compiling.intrinsics import address_of, borrow, call, dense
from impactlab.compiling.jit import allocating, kernel
from impactlab.compiling.scalars import scalar
from impactlab.integrators.arguments import Account, Closings, History, Noise, Peaks, Sums, slot_of
from impactlab.integrators.kicks import SHIFT, kick
from impactlab.kernels.flow import flow
from impactlab.kernels.jump import (
    Piece,
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
from impactlab.kernels.peaks import read_peaks
from impactlab.kernels.random import fill_normals, fill_steps
from impactlab.kernels.rows import F
from impactlab.kernels.sums import SLOTS, count_closings, empty_slots


@allocating
def approach(functions, tables, noise, state, history, sums, steps, interval):  # type: ignore[no-untyped-def]
    """Carry the lanes that may touch over an interval; return how many of them took its last steps one by one.

    Intervals are halved in the order of time, each for the lanes that may touch in it. The lanes of a
    level are dense blocks of their own.
    """
    jumps, work, levels, ends = tables.jumps, state.work, state.work.levels, sums.ends
    top, leaf = jumps.levels, jumps.leaf
    counts, half = np.zeros(top + 1, np.int64), np.zeros(top + 1, np.int64)
    node, begin = np.zeros(top + 1, np.int64), np.zeros(top + 1, np.int64)
    number = take_top(jumps, ends, noise.realizations, work, interval)
    if number == 0:
        return 0
    level, counts[top], node[top], begin[top] = top, number, 1, interval.number * (leaf << top)
    halve_level(jumps, top, number, (interval.number << top) + node[top], work)
    last = 0
    while half[top] < 2:
        n, now = counts[level], half[level]
        if now == 2:
            above = piece(levels, level + 1, 1 - half[level + 1], 0, counts[level + 1])
            put_state(piece(levels, level, 0, 0, n), levels.chosen[level], above.x, above.v)
            level += 1
            half[level] += 1
            continue
        part, old, new = level - 1, piece(levels, level, now, now, n), piece(levels, level, 1 - now, now, n)
        number = find(jumps, ends, part, old, work.worst, levels.chosen[part])
        jump(jumps.transition[part], old, new.x, new.v)
        last = 0
        if number == 0:
            half[level] += 1
            continue
        take_level(part, number, old, levels.chosen[part], levels.realizations[level], levels)
        for lane in range(number):
            levels.lanes[part, lane] = levels.lanes[level, levels.chosen[part, lane]]
        counts[part], begin[part] = number, begin[level] + now * (leaf << part)
        if part > 0:
            node[part], half[part] = 2 * node[level] + now, 0
            halve_level(jumps, part, number, (interval.number << top) + node[part], work)
            level = part
            continue
        own = of_lanes(noise, levels.realizations[0][:number])
        step_by_step(functions, tables, own, state, history, sums, steps, begin[0])
        put_state(piece(levels, 0, 1, 0, number), levels.chosen[0], new.x, new.v)
        half[level] += 1
        last = number
    put_state(piece(levels, top, 0, 0, counts[top]), levels.lanes[top], interval.after_x, interval.after_v)
    if last and steps.summing:
        middle = dense(history.v, last)[leaf - 1]
        amend_samples(dense(levels.x[0, 1], last), dense(levels.v[0, 1], last), middle, levels.lanes[0], sums.bodies[0])
    return last


@kernel
def take_top(jumps, ends, realizations, work, interval):  # type: ignore[no-untyped-def]
    """Take those lanes to the highest level whose mean path comes near a contact; return how many they are."""
    top, levels = jumps.levels, work.levels
    chosen, flagged = levels.chosen[top], levels.chosen[0]
    start = Piece(interval.x, interval.v, work.noise[0], work.noise[1])
    take_level(top, interval.near, start, chosen, realizations, levels)
    number = find(jumps, ends, top, piece(levels, top, 0, 1, interval.near), work.worst, flagged)
    for lane in range(number):
        chosen[lane] = chosen[flagged[lane]]
        levels.lanes[top, lane] = chosen[lane]
    take_level(top, number, start, chosen, realizations, levels)
    return number


@kernel
def put_state(own, chosen, x, v):  # type: ignore[no-untyped-def]
    """Put displacements and velocities of some lanes among those that they were chosen from."""
    put(own.x, chosen, x)
    put(own.v, chosen, v)


@scalar
def of_lanes(noise, realizations):  # type: ignore[no-untyped-def]
    """Return the noise restricted to the given realizations."""
    return Noise(
        noise.bodies, noise.runs, noise.seconds, noise.amplitude, noise.streams, realizations, noise.scale,
        noise.coarse, noise.normals, noise.which, noise.distinct,
    )  # fmt: skip


@scalar
def piece(levels, level, state, half, number):  # type: ignore[no-untyped-def]
    """Return a state of the lanes of a level, before or after half their interval, with the noise of one half."""
    w = levels.w[level]
    return Piece(
        dense(levels.x[level, state], number), dense(levels.v[level, state], number), dense(w[2 * half], number),
        dense(w[2 * half + 1], number),
    )  # fmt: skip


@kernel
def take_level(level, number, whole, chosen, realizations, levels):  # type: ignore[no-untyped-def]
    """Fill the blocks of a level with some lanes."""
    own = piece(levels, level, 0, 1, number)
    take(whole.x, chosen, own.x)
    take(whole.v, chosen, own.v)
    take(whole.wx, chosen, own.wx)
    take(whole.wv, chosen, own.wv)
    for lane in range(number):
        levels.realizations[level, lane] = realizations[chosen[lane]]


@kernel
def find(jumps, ends, part, whole, spare, chosen):  # type: ignore[no-untyped-def]
    """Find the lanes that may touch within an interval of the level `part`."""
    worst = dense(spare, whole.x.shape[1])
    begin = jumps.leaf * ((1 << part) - 1)
    end = begin + (jumps.leaf << part)
    search(jumps.path[begin:end], jumps.limit[begin:end], ends, whole, worst)
    return select(worst, chosen)


@kernel
def halve_level(jumps, level, number, address, work):  # type: ignore[no-untyped-def]
    """Draw the noise of the halves of the intervals of a level."""
    normals, noise, levels = dense(work.halves, number), jumps.noise, work.levels
    if noise.halves.shape[1]:
        fill_normals(noise.halves, levels.realizations[level][:number], np.uint64(address), normals)
    first, whole = piece(levels, level, 0, 0, number), piece(levels, level, 0, 1, number)
    halve(noise.gain[level], noise.rest[level], jumps.transition[level - 1], noise.rows, normals, whole, first)


@allocating
def step_by_step(functions, tables, noise, state, history, sums, steps, first):  # type: ignore[no-untyped-def]
    """Carry the lanes of a leaf over it, step by step, and add contacts and kicks to the sums of the block."""
    forces = functions.forces  # apart: numba warns of tuples that begin with a function
    jumps, levels, coefficients = tables.jumps, state.work.levels, tables.coefficients
    number = noise.realizations.shape[0]
    x, v, of_x, of_v = piece(levels, 0, 0, 0, number)
    whole = piece(levels, 0, 1, 1, number)  # of the state after it, and the noise of all steps
    spare = whole.x
    clear(of_x)
    clear(of_v)
    clear(spare)
    for group in range(jumps.leaf // 4):
        normals = dense(state.work.steps[group], number)
        if noise.bodies.shape[0]:
            fill_steps(noise, first // 4 + group, normals)
        for column in range(4):
            flow(coefficients, 0, noise, 0, normals[column], of_x, of_v, spare)
            of_x, spare = spare, of_x
    pin(jumps.noise.inverse, whole.wx, whole.wv, of_x, of_v)
    past = History(
        dense(history.x, number), dense(history.v, number), dense(history.force, number),
        dense(history.indentation, number), dense(history.contact_force, number),
    )  # fmt: skip
    empty_slots(past, jumps.leaf, SLOTS)
    y, still = dense(state.work.place, number), dense(state.still, number)
    hold_wall(y)
    before = np.empty((2, sums.closings.before.shape[1], number))
    if before.shape[1]:  # where the kick before was read; its half makes no difference that counts
        total, contact_force = past.force[0], past.contact_force[0]
        parameters, indices = tables.parameters, tables.indices
        forces(x, still, still, 0.0, parameters, indices, before[0], contact_force, total)
        scaled_sum(x, coefficients, SHIFT, total, y)
        forces(y, still, still, 0.0, parameters, indices, before[0], contact_force, total)
        differences(indices, v, before[1])
    for step in range(jumps.leaf):
        here = slot_of(past, step)
        hold_wall(here.x)
        hold_wall(here.v)
        normals = dense(state.work.steps[step // 4], number)
        flow(coefficients, 0, noise, 0, normals[step % 4], x, v, here.x)
        correct(jumps.noise.terms[step], of_x, of_v, here.x, v)
        x = here.x
        kick(forces, tables, steps.passes, still, v, y, here)
    if steps.summing:
        add_leaf(functions.add, past, before, first, jumps.leaf, levels.lanes[0], sums)
    copy(x, whole.x)
    copy(v, whole.v)


@kernel
def _begin_reading(before, first, last):  # type: ignore[no-untyped-def]
    """Let peaks be read from the beginning of a leaf on, where the steps before it were skipped: nothing touched."""
    for contact in range(last.shape[1]):
        for lane in range(last.shape[2]):
            if last[3, contact, lane] != first - 1.0:
                last[0, contact, lane], last[1, contact, lane] = before[0, contact, lane], before[1, contact, lane]
                last[2, contact, lane], last[3, contact, lane], last[5, contact, lane] = 0.0, first - 1.0, 0.0


@allocating
def add_leaf(add, past, before, first, steps, lanes, sums):  # type: ignore[no-untyped-def]
    """Add contacts and kicks of some lanes in the steps of a leaf, from a first one on, to the sums of their block."""
    bodies, contacts, number = sums.bodies.shape[2], sums.contacts.shape[1], before.shape[2]
    shared = sums.closings.peaks
    last = np.empty((shared.before.shape[0], shared.before.shape[1], number))
    peaks = Peaks(shared.function, last, shared.parameters, shared.row, shared.written)
    for row in range(last.shape[0]):
        take(shared.before[row], lanes, last[row])
    if last.shape[1] and before.shape[1]:
        _begin_reading(before, first, last)
    own = Sums(
        np.zeros((1, sums.bodies.shape[1], bodies, number)), np.zeros((sums.contacts.shape[0], contacts, number)),
        sums.summed, sums.samples, sums.products, sums.ends, sums.pairs, sums.indices,
        Closings(before, sums.closings.jitter, sums.closings.weights, sums.closings.step, peaks), sums.flux,
        sums.turns, sums.points, sums.read,
    )  # fmt: skip
    for step in range(before.shape[1] and steps):
        count_closings(past.indentation[step], past.v[step], own)
    for step in range(last.shape[1] and steps):
        read_peaks(past, step, first + step, own.closings, sums.indices)
    for row in range(last.shape[0]):
        put(last[row], lanes, shared.before[row])
    call(add, address_of(Account(past, borrow(own))), 0)  # which lets go of what it does not borrow
    for row in range(F, sums.bodies.shape[1]):
        add_to(own.bodies[0, row], lanes, sums.bodies[0, row])
    for row in range(sums.summed):
        add_to(own.contacts[row], lanes, sums.contacts[row])
    for row in range(sums.summed, sums.contacts.shape[0]):
        for contact in range(contacts):
            for lane in range(number):
                most = sums.contacts[row, contact, lanes[lane]]
                sums.contacts[row, contact, lanes[lane]] = max(most, own.contacts[row, contact, lane])
