"""The error of a step, measured on the network: short segments at the step and at a fraction of it, with common noise.

Two whole runs at different steps drift apart after a few collisions, and then see nothing below their own noise.
Segments that begin at one state, under the same noise, see the local error of the step with very little noise: the
difference of each statistic in the segment, and that of the energy at its end, which the network keeps for as long as
its energy is correlated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import Diverged, heard_by
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.kernels.sums import SLOTS
from impactlab.plan.plan import Plan
from impactlab.plan.realizations import LANE_STEP_SECONDS, STEP_SECONDS, most_lanes
from impactlab.simulation.block import Block
from impactlab.simulation.request import Request
from impactlab.simulation.segment_statistics import FEWEST, Coverage, Segments, bias_of, together
from impactlab.simulation.smooth_path import SmoothPath
from impactlab.simulation.step_error import MOST_BIAS, WORTH_SAYING, StepError

SEGMENT = 32
"""Steps of a segment where forces may part two paths: some contacts long, and short beside the time between them."""

SHARE, LEAST_SECONDS, MOST_SECONDS = 0.2, 0.05, 2.0
"""Part of the work of a run that the measurement may take, what it always may, and what is enough for any network, or
for the whole path of a run without noise at the step and at a finer one (s, as a plan foresees it)."""

UNCLEAR_SECONDS = 0.25
"""Time that the measurement of a short run may take which leaves it open whether a bias is worth saying, or needs
segments all over the run (s)."""

LANES, SEGMENTS, MOST_SEGMENTS = 256, 64, 256
"""Most realizations and segments of a measurement, and most segments where they must lie all over the run."""

LONGEST = 4 * SEGMENT
"""Steps of a segment up to which it may be longer for the sake of fewer."""

SPIN_UP = 3.0
"""Relaxation times before the first segment: states need be typical only."""

SEED = 7, 2023
"""Seed of all measurements: the step of a network does not depend on that of the run."""

FINER, FINEST = 2, 4
"""Steps of the fine run in one of the coarse; where nothing is random, so that one path alone must tell the error."""


@dataclass(frozen=True)
class Effort:
    """What a measurement may take: a share of the work of a run.

    Attributes
    ----------
    realizations : int
    spin_up : int
        Steps before the first segment.
    steps : int
        Steps of a segment.
    begins : tuple of int
        Steps after the spin-up at which segments begin.
    run_up : int
        Steps before a segment that does not follow the one before, in which the motion becomes that of its time.
    looks : tuple of int
        Numbers of segments after which biases are looked at: early, all that are planned, and more where much is
        unclear.
    """

    realizations: int
    spin_up: int
    steps: int
    begins: tuple[int, ...]
    run_up: int
    looks: tuple[int, ...]

    @classmethod
    def of(cls, plan: Plan, model: Model) -> Self:
        """Choose what a share of the work of a plan buys."""
        lane = LANE_STEP_SECONDS * (len(model.mass) + len(model.links))
        clock, whole = plan.clock, plan.clock.steps // SLOTS * SLOTS
        if not _random(plan) and whole and (1 + FINEST) * clock.all_steps * (STEP_SECONDS + lane) < MOST_SECONDS:
            return cls(plan.realizations.number, clock.spin_up_steps, whole, (0,), 0, (1,))
        apart, settling = _apart(plan), math.ceil(SPIN_UP * clock.relaxation / clock.step)
        seconds = min(max(UNCLEAR_SECONDS if apart else LEAST_SECONDS, SHARE * plan.work), MOST_SECONDS)
        wanted = SEGMENTS * (settling + 3 * SEGMENT) if apart else 3 * FEWEST * SEGMENT
        led = len(plan.driving.forced) > 0  # to a motion that may depend on how it began
        spin_up = clock.spin_up_steps if led else min(clock.spin_up_steps, settling)
        for realizations in _numbers(plan, model):
            affordable = int(seconds / (STEP_SECONDS * (1 + len(model.mass) // 10) + lane * realizations))
            if affordable >= 2 * spin_up + min(wanted, 3 * clock.all_steps):
                break
        spin_up = min(spin_up, affordable // 3)
        left = max(affordable - spin_up, 3 * SEGMENT) // 3
        if not plan.steady or plan.driving.lines:  # as long as the run, where time counts or a series must not repeat
            left = min(left, clock.steps)
        steps = _segment(plan, model, left)
        segments = max(1, min(SEGMENTS, left // steps))
        if apart and segments * steps + SEGMENT < clock.steps:
            begins, steps, run_up = _spread(clock.steps, steps, affordable - spin_up, settling)
            return cls(realizations, spin_up, steps, begins, run_up, (len(begins),))
        looks: tuple[int, ...] = (segments,)
        if plan.steady and not plan.driving.lines and segments >= 4 * FEWEST:
            most = segments * max(1, int(UNCLEAR_SECONDS / seconds))
            looks = (segments // 4, *range(segments, most + 1, segments))
        return cls(realizations, spin_up, steps, tuple(range(0, looks[-1] * steps, steps)), 0, looks)


def _random(plan: Plan) -> bool:
    return bool(plan.noise.random.any())


def _apart(plan: Plan) -> bool:
    """Whether what comes late in a run differs from how it begins, and can be reached without all that lies between."""
    return not plan.steady and not plan.driving.lines and (_random(plan) or len(plan.driving.forced) > 0)


def _numbers(plan: Plan, model: Model) -> list[int]:
    """Return numbers of realizations that a measurement may have, the best first; the same on any number of cores."""
    number = plan.realizations.number
    if number == 1 or most_lanes(model, number, 1) == 1:
        return [1]
    least = len(model.mass) // 16 + 2  # blocks of one lane have a text of their own
    return [max(LANES >> power, least) for power in range(0, 9, 2)]


def _segment(plan: Plan, model: Model, left: int) -> int:
    """Return the steps of a segment where so many can be measured."""
    steps, memory = SEGMENT, math.ceil(2.0 * plan.clock.relaxation / plan.clock.step)
    if not len(model.ends) or len(plan.driving.forced):  # paths do not part: as long as they remember
        steps = max(steps, min(left // FEWEST, memory) // SLOTS * SLOTS)
    if not plan.steady or plan.driving.lines:
        steps = max(2, min(steps, left // 2 * 2))
    if not _random(plan):  # parts of the whole path
        steps = max(steps, -(-left // (SEGMENTS * SLOTS)) * SLOTS)
    return steps


def _spread(run: int, steps: int, affordable: int, settling: int) -> tuple[tuple[int, ...], int, int]:
    """Return where segments begin that lie over a whole run alike, their length, and steps before each to settle in.

    All are numbers of steps; one of a segment costs three, with the two of half its length.
    """
    longer = max(steps, -(-run // (MOST_SEGMENTS * SLOTS)) * SLOTS)
    if 3 * run <= affordable and longer <= LONGEST:  # all of it
        return tuple(range(0, run - longer + 1, longer)), longer, 0
    segments = min(MOST_SEGMENTS, max(FEWEST, affordable // (settling + 3 * steps)), run // steps)
    run_up = min(settling, max(0, affordable // segments - 3 * steps)) // SLOTS * SLOTS
    begins = np.linspace(0, run - steps, segments).astype(int) // SLOTS * SLOTS
    return tuple(begins.tolist()), steps, run_up


def step_error(
    plan_of: Callable[[Request], Plan], model: Model, initial: object, plan: Plan,
    velocity: np.ndarray | None = None, patient: bool = True,
) -> StepError:  # fmt: skip
    """Measure what the step of a plan does to its statistics, for longer where biases stay unclear and it is `patient`.

    The time of the measurement is a share of the plan's, and its result depends on nothing but the plan; `plan_of`
    makes the plans of its runs, with the mean square velocities that the plan was made with.
    """
    effort = Effort.of(plan, model)
    step, finer = plan.clock.step, FINER if plan.noise.random.any() else FINEST

    def part(size: float, coarse: bool) -> Plan:
        request = Request(
            duration=(effort.begins[-1] + effort.steps) * step, realizations=effort.realizations, step=size,
            spin_up=effort.spin_up * step, integrator=ExactFlow(jumps=False), initial=initial, records=[], seed=SEED,
            workers=1, coarse=coarse, mean_square_velocity=velocity,
        )  # fmt: skip
        return plan_of(request)

    with heard_by(lambda message, category: None):
        coarse, fine = part(step, True), part(step / finer, False)
    fine = replace(fine, clock=replace(fine.clock, spin_up_steps=finer * coarse.clock.spin_up_steps))
    time = plan.realizations.number * plan.clock.duration
    planned = effort.looks[min(1, len(effort.looks) - 1)]
    try:
        pairs = [_Pair(coarse, fine, model, index) for index in range(coarse.realizations.blocks)]
        found: list[Segments] = []
        for done, number in pairwise((0, *effort.looks)):
            more = [pair.run(effort.begins[done:number], effort.steps, effort.run_up) for pair in pairs]
            found = [one.followed_by(other) for one, other in zip(found, more, strict=True)] if found else more
            coverage = Coverage(effort.begins[:number], effort.steps, plan.clock.steps)
            error = bias_of(coarse, fine, model, coverage, found)
            if error.certain > WORTH_SAYING or error.surely_small:
                break
            if number >= planned and not (error.certain <= MOST_BIAS and patient and error.unclear(time)):
                break
        return error
    except Diverged:
        return StepError.infinite(step, model.bodies, model.contacts)


class _Pair:
    """Blocks of the same realizations at a step and at a part of it."""

    def __init__(self, coarse: Plan, fine: Plan, model: Model, index: int) -> None:
        self.coarse, self.fine = (Block(plan, index, lambda steps: None) for plan in (coarse, fine))
        self.coarse_path = SmoothPath(coarse, self.coarse.evaluate)
        self.fine_path = SmoothPath(fine, self.fine.evaluate)
        self.labels = model.connected()
        self._run_up(coarse.clock.spin_up_steps)

    def _run_up(self, steps: int) -> None:
        """Let the coarse block make steps without sums."""
        self.coarse.advance(steps, None)
        self.coarse.note_gaps(self.coarse.state.reading, self.coarse.state.velocity)

    def run(self, begins: tuple[int, ...], steps: int, run_up: int) -> Segments:
        """Let the coarse block make segments, and the fine one each of them from where the coarse one began it."""
        plan = self.coarse.plan
        finer = round(plan.clock.step / self.fine.plan.clock.step)
        starts, ends, coarse, fine = [], [], [], []
        for begin in (plan.clock.spin_up_steps + np.array(begins)).tolist():
            if begin > self.coarse.now:
                self.coarse.now = max(self.coarse.now, begin - run_up)  # the state of one time is a start at another
                self._run_up(begin - self.coarse.now)
            starts.append(_state(self.coarse))
            coarse.append(tuple(map(together, self.coarse.segment(steps))))
            ends.append(_state(self.coarse))
        path = self.coarse_path.at(*map(np.array, zip(*starts, *ends, strict=True)))
        (start_x, x), (start_v, v) = (np.split(item, 2) for item in path)
        ends = []
        for begin, state in zip(begins, zip(*self.fine_path.begin(start_x, start_v), strict=True), strict=True):
            self.fine.begin(*state, finer * (plan.clock.spin_up_steps + begin))
            fine.append(tuple(map(together, self.fine.segment(finer * steps))))
            ends.append(_state(self.fine))
        energy = self._energy(x, v, *self.fine_path.at(*map(np.array, zip(*ends, strict=True))))
        return Segments(coarse, fine, together(energy))

    def _energy(self, x: np.ndarray, v: np.ndarray, from_x: np.ndarray, from_v: np.ndarray) -> np.ndarray:
        """Return the energy of states less that of others, by connected part: conservative forces do the work."""
        plan, middle = self.coarse.plan, 0.5 * (x + from_x)
        mass, _, stiffness = (item[:, None] for item in plan.system.linear)
        pull = stiffness * middle
        for group in plan.method.groups:  # with the couplings that do not kick
            pull[:, group.slots] = group.system.stiffness @ middle[:, group.slots]
        energy = 0.5 * mass * (v**2 - from_v**2) + pull * (x - from_x) - self.coarse_path.work(from_x, x)
        result = np.zeros((self.labels.max() + 1, len(x), x.shape[-1]))
        np.add.at(result, self.labels, energy.swapaxes(0, 1))
        return result.swapaxes(0, 1)


def _state(block: Block) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the displacements, velocities and forces of the bodies after a kick."""
    x, v, force = (item[:-1].copy() for item in (block.state.x, block.state.v, block.state.total))
    return x, v, force
