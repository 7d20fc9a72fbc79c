"""The error of a step, measured on the network: short segments at the step and at a fraction of it, with common noise.

Two whole runs at different steps drift apart after a few collisions, and then see nothing below their own noise.
Segments that begin at one state, under the same noise, see the local error of the step with very little noise: the
difference of each statistic in the segment, and that of the energy at its end, which the network keeps for as long as
it retains energy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import Diverged, unheard
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.kernels.impacts import SLOW
from impactlab.plan.plan import Plan
from impactlab.plan.subdomains import Subdomains
from impactlab.simulation.block import Block
from impactlab.simulation.effort import FINER, FINEST, Effort
from impactlab.simulation.request import Request
from impactlab.simulation.segment_statistics import Coverage, Segments, bias_of, rows_of, together
from impactlab.simulation.separation import SHIFT, in_pieces, separate
from impactlab.simulation.smooth_path import Laws, SmoothPath
from impactlab.simulation.step_error import WORTH_SAYING, StepError

SEED = 7, 2023
"""Seed of all measurements: the step of a network does not depend on that of the run."""


def step_error(
    plan_of: Callable[[Request], Plan], model: Model, initial: object, plan: Plan,
    velocity: np.ndarray | None = None, patient: bool = True,
) -> StepError:  # fmt: skip
    """Measure what the step of a plan does to its statistics, for longer where biases stay unclear and it is `patient`.

    The time of the measurement is a share of the plan's, and its result depends on nothing but the plan; `plan_of`
    makes the plans of its runs, with the mean square velocities that the plan was made with.
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
            return replace(plan_of(request), subdomains=Subdomains(0, ()))  # no tiles

    coarse, fine = part(step, True), part(step / finer, False)
    fine = replace(fine, clock=replace(fine.clock, spin_up_steps=finer * coarse.clock.spin_up_steps))
    time = plan.realizations.number * plan.clock.duration
    planned = effort.looks[min(1, len(effort.looks) - 1)]
    try:
        pairs = [_Pair(coarse, fine, model, index, effort.whole) for index in range(coarse.realizations.blocks)]
        found: list[Segments] = []
        for done, number in pairwise((0, *effort.looks)):
            more = [pair.run(effort.begins[done:number], effort.steps, effort.run_up) for pair in pairs]
            found = [one.followed_by(other) for one, other in zip(found, more, strict=True)] if found else more
            coverage = Coverage(effort.begins[:number], effort.steps, plan.clock.steps)
            error = bias_of(coarse, fine, model, coverage, found, _chattering(pairs))
            if error.certain > WORTH_SAYING or error.surely_small:
                break
            if number >= planned and not (error.does and patient and error.unclear(time)):
                break
        if effort.whole and not error.does and error.certain < np.inf:
            return _along_paths(error, coarse, fine, model)
        return error
    except Diverged:
        return StepError.infinite(step, model.bodies, model.contacts)


def _along_paths(error: StepError, coarse: Plan, fine: Plan, model: Model) -> StepError:
    """Return the error of a step on whole paths, with errors of averages where small changes grow; see `separation`."""
    begins, steps = in_pieces(coarse.clock.steps)
    if not begins:
        return error
    one = _speeds(coarse, steps, len(begins), np.zeros(len(model.bodies)))
    other = _speeds(coarse, steps, len(begins), SHIFT * np.sqrt((one**2).mean(axis=(0, 2))))
    parts = separate(model, one, other)
    if not parts.any():
        return error
    pairs = [_Pair(coarse, fine, model, index, whole=True) for index in range(coarse.realizations.blocks)]
    found = [pair.run(begins, steps, 0) for pair in pairs]
    coverage = Coverage(begins, steps, coarse.clock.steps, follow=True)
    scatter = bias_of(coarse, fine, model, coverage, found, _chattering(pairs)).error
    return error.scattered(scatter, rows_of(model, parts, scatter))


def _speeds(plan: Plan, steps: int, number: int, shift: np.ndarray) -> np.ndarray:
    """Return velocities after some times so many steps, (moment, body, realization), if they are shifted at first."""
    found = []
    for index in range(plan.realizations.blocks):
        block = Block(plan, index, lambda steps: None)
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

    def __init__(self, coarse: Plan, fine: Plan, model: Model, index: int, whole: bool) -> None:
        self.coarse, self.fine = (Block(plan, index, lambda steps: None) for plan in (coarse, fine))
        self.coarse_path = SmoothPath(coarse, self.coarse.evaluate)
        self.fine_path = SmoothPath(fine, self.fine.evaluate)
        self.labels, self.whole = model.connected(), whole
        self.begun = whole and coarse.clock.spin_up_steps > 0
        _run_up(self.coarse, coarse.clock.spin_up_steps)
        if self.begun:
            _run_up(self.fine, fine.clock.spin_up_steps)

    def run(self, begins: tuple[int, ...], steps: int, run_up: int) -> Segments:
        """Let the coarse block make segments, and the fine one each of them from where the coarse one began it."""
        plan = self.coarse.plan
        finer = round(plan.clock.step / self.fine.plan.clock.step)
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
        plan, middle = self.coarse.plan, 0.5 * (x + from_x)
        work = self.coarse_path.work(from_x, x, laws)
        if self.coarse.remembering:
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
    """Whether rigid contacts had impacts that are too slow to count, (rigid,) of bool."""
    seen = [block.events.impacts.seen[SLOW].any(axis=-1) for pair in pairs for block in (pair.coarse, pair.fine)]
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
        """Return that of a block."""
        x, v, force = (item[:-1].copy() for item in (block.state.x, block.state.v, block.state.total))
        return cls(x, v, force, block.states.copy(), block.time)


def _joined(states: list[_State]) -> tuple[np.ndarray, np.ndarray, np.ndarray, Laws]:
    """Return the arrays of some states, (state, …) each."""
    x, v, force, laws, times = map(np.array, zip(*states, strict=True))
    return x, v, force, Laws(laws, times)
