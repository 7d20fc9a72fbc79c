"""The loop over the steps of every method."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from impactlab.compiling.intrinsics import address_of, borrow, call, value_at
from impactlab.compiling.jit import Function, cache_folder, composed, inlined, loop
from impactlab.compiling.own_memory import function_of, without_lane
from impactlab.compiling.scalars import scalar
from impactlab.compiling.single import text_of
from impactlab.integrators.arguments import (
    Account,
    Functions,
    Noise,
    Series,
    Stretch,
    loop_type,
)
from impactlab.kernels.memory import Accepted, set_accepted, set_elapsed, write_states
from impactlab.kernels.peaks import write_peaks
from impactlab.kernels.points import add_history_of_points, add_turns_of_points
from impactlab.kernels.powers import write_at_kicks
from impactlab.kernels.random import fill_steps
from impactlab.kernels.rows import FLUX, TURN
from impactlab.kernels.samples import Sample, add_no_slots, adding, version_of
from impactlab.kernels.series import NEAR, bring_near
from impactlab.kernels.sums import SLOTS, add_history, add_turns, close_slot, empty_slots, write_snapshot
from impactlab.machine import tuning
from impactlab.results.schema import BODY, CONTACT, sampled_of


def advance(functions, tables, driven, state, history, sums, snapshots, steps):  # type: ignore[no-untyped-def]
    """Make some steps; the arguments are those of `impactlab.integrators.arguments`.

    `snapshots`, [sample, quantity, lane], take displacements and velocities of all bodies and forces of all contacts
    after every `steps.every`-th step.
    """
    tables, driven, state = borrow(tables), borrow(driven), borrow(state)
    history, sums = borrow(history), borrow(sums)
    noise, series, account = driven.noise, driven.series, address_of(Account(history, sums))
    own_noise, own_series = address_of(noise), address_of(series)
    own_stretch, reached = address_of(stretch_of(tables, driven, state, history, steps)), 0
    empty_slots(history, 0, steps.first % SLOTS)
    for index in range(steps.number):
        now = steps.first + index
        slot, sample = now % SLOTS, sample_of(steps, now)
        if noise.bodies.shape[0] and (index == 0 or now % 4 == 0):
            call(functions.fill, own_noise, now // 4)
        if series.bodies.shape[0] and (index == 0 or sample == 0):
            call(functions.near, own_series, steps.samples * now - sample)
            for process in range(series.processes.shape[0]):
                call(series.processes[process, 1], series.processes[process, 0], steps.samples * now - sample)
        if functions.stretch:
            if index == reached:
                reached = end_of_stretch(steps, index)
                call(functions.stretch, own_stretch, index)
        else:
            set_accepted(tables, steps, now)
            set_elapsed(tables, steps, steps.step)
            step(functions.forces, tables, driven, state, history, steps, index)
        if steps.remembering:  # the step is accepted: states of laws change now, and never at a trial
            x, v, half_step = accepted(state, history.v[slot], steps)
            set_elapsed(tables, steps, steps.step)
            force = history.contact_force[slot]
            place = address_of(Accepted(x, v, force, half_step, tables.parameters, tables.indices))
            call(functions.accept, place, now)
        if sums.bodies.shape[1] > TURN:
            if steps.summing and sums.points.sums.shape[2]:
                call(functions.add_turns_of_points, account, now)
            add_turns(history.force[slot], history.v[slot], steps.summing, now % sums.bodies.shape[0], sums)
        if steps.summing and close_slot(history, slot, now, index == steps.number - 1, sums):
            call(functions.add, account, index)
            if sums.points.sums.shape[2]:
                call(functions.add_points, account, index)
        if sampled(steps, index):
            number = (steps.phase + index + 1) // steps.every - 1
            write_snapshot(state.reading, state.velocity, state.contact_force, sums, snapshots, number)
            if steps.remembering:
                write_states(tables.parameters, sums, snapshots, number)
            if sums.turns.late.shape[0]:
                write_at_kicks(history.v[slot], history.force[slot], sums, snapshots, number)
            if sums.closings.peaks.written:
                write_peaks(state.contact_force, sums.closings.peaks, snapshots, number)


@scalar
def sampled(steps, index):  # type: ignore[no-untyped-def]
    """Whether there is a snapshot after a step."""
    return steps.every > 0 and (steps.phase + index + 1) % steps.every == 0


@scalar
def stretch_of(tables, driven, state, history, steps):  # type: ignore[no-untyped-def]
    """Return the arguments of a loop that a group of steps takes."""
    noise, forced = driven.noise, driven.forced
    return Stretch(
        tables.parameters, tables.coefficients, noise.amplitude, noise.scale, noise.normals, forced.weights,
        forced.force, state, history, steps,
    )  # fmt: skip


@scalar
def end_of_stretch(steps, index):  # type: ignore[no-untyped-def]
    """End of the group of steps that begins at `index`: at most four steps, whose normal numbers are drawn together.

    Only the state after the last step is visible, so a group ends at a snapshot.
    """
    end = min(steps.number, index + 4 - (steps.first + index) % 4)
    return min(end, index + steps.every - (steps.phase + index) % steps.every) if steps.every else end


@scalar
def sample_of(steps, now):  # type: ignore[no-untyped-def]
    """Place of the first sample of a step in `Series.near`."""
    return steps.samples * now % (NEAR // steps.samples * steps.samples)


def step(*arguments: Any) -> None:
    """Stand for that of a method, `impactlab.integrators.base.Integrator.step`."""
    raise NotImplementedError


def accepted(*arguments: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Stand for that of a method, `impactlab.integrators.base.Integrator.accepted`."""
    raise NotImplementedError


def _fill(noise, group):  # type: ignore[no-untyped-def]
    own = value_at(noise)
    fill_steps(own, group, own.normals)


def _near(series, first):  # type: ignore[no-untyped-def]
    bring_near(value_at(series), first)


def _add(account, index):  # type: ignore[no-untyped-def]
    history, sums = value_at(account)
    add_history(history, sums)
    add_of_contacts(history.indentation, history.contact_force, sums.contacts)
    add_of_bodies(history.x, history.v, sums.samples)


def _add_points(account, index):  # type: ignore[no-untyped-def]
    history, sums = value_at(account)
    add_history_of_points(history, sums.points)


def _add_turns_of_points(account, now):  # type: ignore[no-untyped-def]
    history, sums = value_at(account)
    force, middle = history.force[now % SLOTS], history.v[now % SLOTS]
    add_turns_of_points(force, middle, now % sums.bodies.shape[0], sums.points, sums.turns)


add_of_contacts = add_of_bodies = add_no_slots
"""Stand for what statistics sample."""


@cache
def _adding(samples: tuple[Sample, ...]) -> Function:
    """Return the function that adds to all sums, with the samples of statistics in the place of nothing."""
    parts = [
        adding(tuple(item for item in samples if item.of_contacts == of_contacts)) for of_contacts in (True, False)
    ]
    return composed(_add, version_of(samples), add_of_contacts=parts[0], add_of_bodies=parts[1])


def all_samples() -> tuple[Sample, ...]:
    """Return the functions of contacts and bodies that statistics sample."""
    of_contacts, of_bodies = sampled_of(CONTACT), sampled_of(BODY)
    return tuple(
        Sample(statistic.sample, of_contact, row, statistic.largest)
        for of_contact, first, statistics in ((True, FLUX + 1, of_contacts), (False, 0, of_bodies))
        for row, statistic in enumerate(statistics, first)
    )


def with_functions(advancing: Callable[..., None], single: bool, series: bool, points: bool) -> Callable[..., None]:
    """Return a loop that takes the forces, and the address of the update of states, in the place of `Functions`.

    Functions that are called once in many steps are compiled apart from all loops, so that their machine code is there
    once, and those for `series` and `points` where a network has them.
    """
    types, addresses = loop_type(single), _addresses(single, series, points, all_samples())

    def run(forces: Function, accept: int, stretch: int, *arguments: Any) -> None:
        seen = map(without_lane, arguments, types.args[1:]) if single else arguments
        advancing(Functions(forces, accept, stretch, *addresses), *seen)

    return run


@cache
def _addresses(single: bool, series: bool, points: bool, samples: tuple[Sample, ...]) -> tuple[Any, ...]:
    """Return where the parts are that loops call; 0 for those that are not wanted."""
    parts: list[tuple[Any, Function | None]] = [
        (Noise, _fill),
        (Series, _near if series else None),
        (Account, _adding(samples)),
        (Account, _add_points if points else None),
        (Account, _add_turns_of_points if points else None),
    ]
    return tuple(function_of(kind, function, single) for kind, function in parts)


def stepping(
    method: Function, accepting: Function, single: bool, series: bool = True, points: bool = True
) -> Callable[..., None]:
    """Return the compiled loop over the steps of a method, for blocks or for blocks of one lane.

    A network may have no `series` and no `points`.
    """
    return with_functions(_loop(method, accepting, single), single, series, points)


_wanted: defaultdict[str, float] = defaultdict(float)
"""Steps of bodies that were wanted of runs of one realization, by the name of the loop."""


def pays_for_one_lane(method: Function, accepting: Function, steps: float) -> bool:
    """Whether the loop for blocks of one lane saves time from now on; so many steps of bodies more are wanted.

    The loop for many lanes makes the same numbers. It takes 20 ns more for each step of a body, and the compiler takes
    seconds.
    """
    name = _name(method, accepting)
    _wanted[name] += steps
    return _wanted[name] >= tuning().single_lane_steps or _is_kept(name)


def _is_kept(name: str) -> bool:
    """Whether the machine code of the loop for one lane is in the cache."""
    return any(cache_folder().glob(f"*/driver.{advance.__name__}_single_{name}-*.nbi"))


@cache
def _name(method: Function, accepting: Function) -> str:
    """Return the name by which the cache knows the loop of a method."""
    file = Path(method.__code__.co_filename)
    version = hashlib.sha256(file.read_bytes() if file.is_file() else method.__code__.co_code).hexdigest()[:12]
    return f"{method.__qualname__}_{accepting.__qualname__}_{version}".replace(".", "_")


@cache
def _loop(method: Function, accepting: Function, single: bool) -> Function:
    """Return the loop before the functions that it calls are filled in.

    The texts of the step, and of where it is accepted, stand in that of the loop: called, a step would take a tenth of
    a microsecond more.
    """
    parts = {"step": inlined(text_of(method, single)), "accepted": inlined(text_of(accepting, single))}
    return loop(loop_type(single), composed(text_of(advance, single), _name(method, accepting), **parts))
