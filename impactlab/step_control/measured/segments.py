"""The bias of a step, measured on the network: short segments at the step and at a fraction of it, with common noise.

Two whole runs at different steps drift apart after a few collisions, and then see nothing below their own noise.
Segments that begin at one state, under the same noise, show the local error of the step with very little scatter: as a
difference of each statistic in the segment, and of the energy at its end, which lasts as long as the network retains
energy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from impactlab.allowed_time import check_time, uncounted_time
from impactlab.assembly.model import Model
from impactlab.errors import WORTH_SAYING, Diverged, unheard
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.plan.plan import Plan
from impactlab.plan.request import Request
from impactlab.plan.subdomains import Subdomains
from impactlab.step_control.measured.bias import STILL
from impactlab.step_control.measured.effort import FINER, FINEST, Effort
from impactlab.step_control.measured.segment_statistics import Coverage, Segments, bias_of, rows_of, together
from impactlab.step_control.measured.smooth_path import Laws, SmoothPath
from impactlab.step_control.measured.step_bias import StepBias

if TYPE_CHECKING:
    from impactlab.simulation.block import Block

SEED = 7, 2023
"""Seed of all measurements: the step of a network does not depend on that of the run."""

PIECES = 32, 16
"""Most and fewest parts of a path that tell how its averages scatter."""

SHIFT = 1e-6
"""Change of the velocities at the start, as a part of them. What it does to a path no step can avoid; on regular paths
it grows with time, or as a square root."""

FAR = 0.1
"""Distance of two paths, as a part of their velocities, beyond which they are apart."""

OFTEN = 0.125
"""Part of the time in which two paths must be apart: between the impacts of one and the other regular paths are so,
too."""


def _checked(steps: int) -> None:
    """Look, after some steps, at the time that is left."""
    check_time("The measurement of the step")


class Runs(NamedTuple):
    """How the runs of a measurement are made."""

    plan_of: Callable[[Request], Plan]
    block_of: Callable[[Plan, np.ndarray, Callable[[int], None]], Block]
    """Of a plan, the numbers of its realizations, and a function that takes the steps that are done."""

    def block(self, plan: Plan, index: int) -> Block:
        """Return a block of a plan at its start."""
        with uncounted_time():  # what is not in the cache is compiled
            return self.block_of(plan, plan.realizations.of(index), _checked)


def step_bias(
    runs: Runs, model: Model, initial: object, plan: Plan, velocity: np.ndarray | None = None, patient: bool = True
) -> StepBias:
    """Measure what the step of a plan does to its statistics, for longer where biases stay unclear and it is `patient`.

    The time of the measurement is a share of the plan's, and its result depends on nothing but the plan. The plans of
    its runs have the mean square velocities that the plan was made with.
    """
    effort = Effort.of(plan, model)
    step, finer = plan.clock.step, FINER if plan.random else FINEST

    def part(size: float, coarse: bool) -> Plan:
        request = Request(
            duration=(effort.begins[-1] + effort.steps) * step, realizations=effort.realizations, step=size,
            spin_up=effort.spin_up * step, integrator=ExactFlow(jumps=False), initial=initial, records=[], seed=SEED,
            workers=1, coarse=coarse, mean_square_velocity=velocity,
        )  # fmt: skip
        with unheard():
            return replace(runs.plan_of(request), subdomains=Subdomains(0, ()))  # no tiles

    coarse, fine = part(step, True), part(step / finer, False)
    fine = replace(fine, clock=replace(fine.clock, spin_up_steps=finer * coarse.clock.spin_up_steps))
    time = plan.realizations.number * plan.clock.duration
    planned = effort.looks[min(1, len(effort.looks) - 1)]
    try:
        pairs = [_Pair(runs, coarse, fine, model, index, effort.whole) for index in range(coarse.realizations.blocks)]
        found: list[Segments] = []
        for done, number in pairwise((0, *effort.looks)):
            more = [pair.run(effort.begins[done:number], effort.steps, effort.run_up) for pair in pairs]
            found = [one.followed_by(other) for one, other in zip(found, more, strict=True)] if found else more
            coverage = Coverage(effort.begins[:number], effort.steps, plan.clock.steps)
            bias = bias_of(coarse, fine, model, coverage, found, _chattering(pairs))
            if bias.certain > WORTH_SAYING or bias.surely_small:
                break
            if number >= planned and not (bias.does and patient and bias.unclear(time)):
                break
        if effort.whole and not bias.does and bias.certain < np.inf:
            return _along_paths(runs, bias, coarse, fine, model)
        return bias
    except Diverged:
        return StepBias.infinite(step, model.bodies.names, model.contacts.names)


def _along_paths(runs: Runs, bias: StepBias, coarse: Plan, fine: Plan, model: Model) -> StepBias:
    """Return the bias of a step on whole paths, with errors of averages where small changes grow; see `separate`."""
    begins, steps = in_pieces(coarse.clock.steps)
    if not begins:
        return bias
    one = _speeds(runs, coarse, steps, len(begins), np.zeros(len(model.bodies)))
    other = _speeds(runs, coarse, steps, len(begins), SHIFT * np.sqrt((one**2).mean(axis=(0, 2))))
    parts = separate(model, one, other)
    if not parts.any():
        return bias
    pairs = [_Pair(runs, coarse, fine, model, index, whole=True) for index in range(coarse.realizations.blocks)]
    found = [pair.run(begins, steps, 0) for pair in pairs]
    coverage = Coverage(begins, steps, coarse.clock.steps, follow=True)
    scattered = bias_of(coarse, fine, model, coverage, found, _chattering(pairs))
    return bias.scattered(scattered, rows_of(model, parts, scattered.bias))


def in_pieces(run: int) -> tuple[tuple[int, ...], int]:
    """Return where parts of a path of so many steps begin, and their length: all of it but a few steps."""
    lengths = {number: run // number // 2 * 2 for number in range(PIECES[0], PIECES[1] - 1, -1)}
    number = max(lengths, key=lambda number: number * lengths[number])
    length = lengths[number]
    return tuple(range(0, number * length, length)) if length else (), length


def separate(model: Model, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether two paths are apart, by connected part, from their velocities, (moment, body, realization)."""
    labels, square = model.connected, (one**2).mean(axis=(0, 2))
    energy, largest = model.mass * square, np.zeros(labels.max() + 1)
    np.maximum.at(largest, labels, energy)
    distance = np.quantile(((one - other) ** 2).mean(axis=2), 1.0 - OFTEN, axis=0)
    apart = (distance > FAR**2 * square) & (energy > STILL * largest[labels])
    result = np.zeros(len(largest), dtype=bool)
    result[labels[apart]] = True
    return result


def _speeds(runs: Runs, plan: Plan, steps: int, number: int, shift: np.ndarray) -> np.ndarray:
    """Return velocities after some times so many steps, (moment, body, realization), if they are shifted at first."""
    found = []
    for index in range(plan.realizations.blocks):
        block = runs.block(plan, index)
        block.state.v[:-1] += shift[:, None]
        block.advance(plan.clock.spin_up_steps, None)
        speeds = []
        for _ in range(number):
            block.advance(steps, None)
            speeds.append(block.state.v[:-1].copy())
        found.append(np.array(speeds))
    return np.concatenate(found, axis=-1)


class _Pair:
    """Blocks of the same realizations at a step and at a part of it.

    Of `whole` paths the fine one goes on by itself, and has its own spin-up if there is one: without noise this may
    decide to which motion it leads.
    """

    def __init__(self, runs: Runs, coarse: Plan, fine: Plan, model: Model, index: int, whole: bool) -> None:
        self.coarse, self.fine = (runs.block(plan, index) for plan in (coarse, fine))
        self.plan, self.finer = coarse, round(coarse.clock.step / fine.clock.step)
        self.coarse_path = SmoothPath(coarse, self.coarse.evaluate)
        self.fine_path = SmoothPath(fine, self.fine.evaluate)
        self.labels, self.whole = model.connected, whole
        self.begun = whole and coarse.clock.spin_up_steps > 0
        _run_up(self.coarse, coarse.clock.spin_up_steps)
        if self.begun:
            _run_up(self.fine, fine.clock.spin_up_steps)

    def run(self, begins: tuple[int, ...], steps: int, run_up: int) -> Segments:
        """Let the coarse block make segments, and the fine block the same segments from the same states."""
        plan, finer = self.plan, self.finer
        starts, ends, coarse = [], [], []
        fine: list[tuple[np.ndarray, ...]] = []
        for begin in (plan.clock.spin_up_steps + np.array(begins)).tolist():
            if begin > self.coarse.now:
                if not plan.driving.motions:  # the state of one time is a start at another
                    self.coarse.now = max(self.coarse.now, begin - run_up)
                _run_up(self.coarse, begin - self.coarse.now)
            starts.append(_State.of(self.coarse))
            coarse.append(tuple(map(together, self.coarse.segment(steps))))
            ends.append(_State.of(self.coarse))
        path = self.coarse_path.at(*_joined([*starts, *ends]))
        (start_x, x), (start_v, v) = (np.split(item, 2) for item in path)
        (*_, start_laws), (*_, laws) = (_joined(items) for items in (starts, ends))
        ends = []
        for begin, place, speed, states in zip(
            begins, *self.fine_path.begin(start_x, start_v, start_laws), start_laws.states, strict=True
        ):
            if not self.begun:
                self.fine.states[:] = states
                self.fine.begin(place, speed, finer * (plan.clock.spin_up_steps + begin))
                self.begun = self.whole
            fine.append(tuple(map(together, self.fine.segment(finer * steps))))
            ends.append(_State.of(self.fine))
        of_fine = _joined(ends)
        energy = self._energy(x, v, *self.fine_path.at(*of_fine), laws, of_fine[-1])
        return Segments(coarse, fine, together(energy * (not self.whole)))  # nothing is kept of it that is not seen

    def _energy(
        self, x: np.ndarray, v: np.ndarray, from_x: np.ndarray, from_v: np.ndarray, laws: Laws, from_laws: Laws
    ) -> np.ndarray:
        """Return the energy of states less that of others, by connected part: conservative forces do the work.

        Laws with states do the mean of what they do from either end: from one alone a spring that has slipped on would
        be pulled back by all of its stiffness.
        """
        plan, middle = self.plan, 0.5 * (x + from_x)
        work = self.coarse_path.work(from_x, x, laws)
        if len(plan.forces.states):
            work = 0.5 * (work - self.fine_path.work(x, from_x, from_laws))
        mass, _, stiffness = (item[:, None] for item in plan.system.linear)
        pull = stiffness * middle
        for group in plan.method.groups:  # with the couplings that do not kick
            pull[:, group.slots] = group.system.stiffness @ middle[:, group.slots]
        energy = 0.5 * mass * (v**2 - from_v**2) + pull * (x - from_x) - work
        result = np.zeros((self.labels.max() + 1, len(x), x.shape[-1]))
        np.add.at(result, self.labels, energy.swapaxes(0, 1))
        return result.swapaxes(0, 1)


def _run_up(block: Block, steps: int) -> None:
    """Let a block make steps without sums."""
    block.advance(steps, None)
    block.note_gaps(block.state.reading, block.state.velocity)


def _chattering(pairs: list[_Pair]) -> np.ndarray:
    """Whether the rate of each contact leaves out impacts that are too slow to count, (contact,) of bool."""
    blocks = [block for pair in pairs for block in (pair.coarse, pair.fine)]
    seen = [block.plan.events.slow(block.events.noted(), len(block.plan.system.contacts)) for block in blocks]
    return np.asarray(np.any(seen, axis=0))


class _State(NamedTuple):
    """Displacements, velocities and forces of the bodies after a kick, and the states of laws."""

    x: np.ndarray
    v: np.ndarray
    force: np.ndarray
    laws: np.ndarray
    time: float  # since the beginning of the measurement (s)

    @classmethod
    def of(cls, block: Block) -> Self:
        """Return the state of a block."""
        x, v, force = (item[:-1].copy() for item in (block.state.x, block.state.v, block.state.total))
        return cls(x, v, force, block.states.copy(), block.time)


def _joined(states: list[_State]) -> tuple[np.ndarray, np.ndarray, np.ndarray, Laws]:
    """Return the arrays of some states, (state, …) each."""
    x, v, force, laws, times = map(np.array, zip(*states, strict=True))
    return x, v, force, Laws(laws, times)
