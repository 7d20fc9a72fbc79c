"""The size of the measurement of a step: realizations and segments that take a given share of the work of a run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.kernels.sums import SLOTS
from impactlab.plan.plan import Plan
from impactlab.plan.realizations import STEP_SECONDS, lane_seconds, most_lanes
from impactlab.statistics.drift import FEWEST_UNITS

SEGMENT = 32
"""Steps of a segment where contacts may separate two paths: several contacts long, short beside the time between."""

SHARE = 0.2
"""Part of the work of a run that the measurement may take."""

LEAST_SECONDS = 0.05
"""Time that the measurement may take in any run, as a plan foresees it (s)."""

MOST_SECONDS = 2.0
"""Longest time of a measurement, also of a whole path without noise at the step and at a finer one (s)."""

UNCLEAR_SECONDS = 0.25
"""Time that the measurement of a short run may take where it is open whether a bias deserves a warning, or where
segments must lie all over the run (s)."""

LANES = 256
"""Most realizations of a measurement."""

SEGMENTS = 64
"""Most segments of a measurement."""

MOST_SEGMENTS = 256
"""Most segments where they must lie all over the run."""

LONGEST = 4 * SEGMENT
"""Longest segment, in steps, where longer segments are made in order to have fewer."""

SPIN_UP = 3.0
"""Relaxation times before the first segment, whose states need only be typical."""

FINER = 2
"""Steps of the fine run in a step of the coarse run."""

FINEST = 4
"""The same where nothing is random, so that the bias follows from one path alone."""


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
        Steps before a segment that does not follow the one before, in which the motion becomes typical of its time.
    looks : tuple of int
        Numbers of segments after which biases are examined: a few, all that are planned, and more where much is
        unclear.
    whole : bool
        Whether the only segment is the whole path, which no noise moves.
    """

    realizations: int
    spin_up: int
    steps: int
    begins: tuple[int, ...]
    run_up: int
    looks: tuple[int, ...]
    whole: bool = False

    @classmethod
    def of(cls, plan: Plan, model: Model) -> Self:
        """Choose what a share of the work of a plan buys."""
        clock, lane = plan.clock, lane_seconds(len(model.mass), len(model.links), len(model.members.states))
        if not plan.random and (1 + FINEST) * clock.all_steps * (STEP_SECONDS + lane) < MOST_SECONDS:
            return cls(plan.realizations.number, clock.spin_up_steps, clock.steps, (0,), 0, (1,), whole=True)
        apart, settling = _apart(plan), math.ceil(SPIN_UP * clock.relaxation / clock.step)
        seconds = min(max(UNCLEAR_SECONDS if apart else LEAST_SECONDS, SHARE * plan.work), MOST_SECONDS)
        wanted = SEGMENTS * (settling + 3 * SEGMENT) if apart else 3 * FEWEST_UNITS * SEGMENT
        led = plan.led and not plan.random  # to a motion that may depend on how it began
        spin_up = clock.spin_up_steps if led else min(clock.spin_up_steps, settling)
        for realizations in _numbers(plan, model):
            of_all = STEP_SECONDS * (1 + len(model.mass) // 10) if realizations > 1 else STEP_SECONDS
            affordable = int(seconds / (of_all + lane * realizations))
            if affordable >= 2 * spin_up + min(wanted, 3 * clock.steps):
                break
        spin_up = min(spin_up, affordable // 3)
        left = max(affordable - spin_up, 3 * SEGMENT) // 3
        if not plan.steady or plan.driving.series:  # as long as the run, where time counts or a series must not repeat
            left = min(left, clock.steps)
        steps = _segment(plan, model, left)
        segments = max(1, min(SEGMENTS, left // steps))
        if apart and segments * steps < clock.steps:
            damped = bool((plan.system.linear[1] > 0.0).all())
            begins, steps, run_up = _spread(clock.steps, steps, affordable - spin_up, settling if damped else None)
            return cls(realizations, spin_up, steps, begins, run_up, (len(begins),))
        looks: tuple[int, ...] = (segments,)
        if plan.steady and not plan.driving.series and (segments >= 4 * FEWEST_UNITS or model.kicks.states):
            most = segments * max(1, int(UNCLEAR_SECONDS / seconds))
            looks = tuple(range(segments, most + 1, segments))
            looks = (segments // 4, *looks) if segments >= 4 else looks
        return cls(realizations, spin_up, steps, tuple(range(0, looks[-1] * steps, steps)), 0, looks)


def _apart(plan: Plan) -> bool:
    """Whether what comes late in a run differs from how it begins, and can be reached without all that lies between."""
    return not plan.steady and not plan.driving.series and (plan.random or plan.led)


def _numbers(plan: Plan, model: Model) -> list[int]:
    """Return numbers of realizations that a measurement may have, the best first; the same on any number of cores.

    One realization of a run is measured on many, too: together they tell ten times as much in the same time.
    """
    if (not plan.random and plan.realizations.number == 1) or most_lanes(model, LANES, 1) == 1:
        return [1]
    least = len(model.mass) // 16 + 2  # blocks of one lane have machine code of their own
    return [max(LANES >> power, least) for power in range(0, 9, 2)]


def _segment(plan: Plan, model: Model, left: int) -> int:
    """Return the steps of a segment, from the number of steps that can be measured."""
    steps, memory = SEGMENT, math.ceil(2.0 * plan.clock.relaxation / plan.clock.step)
    if not len(model.ends) or plan.led:  # paths stay together: as long as the motion is correlated
        steps = max(steps, min(left // FEWEST_UNITS, memory) // SLOTS * SLOTS)
    if not plan.steady or plan.driving.series:
        steps = min(steps, left)
        steps = max(2, left // -(-left // steps) // 2 * 2) if left > 1 else 1
    if not plan.random:  # parts of the whole path
        steps = max(steps, -(-left // (SEGMENTS * SLOTS)) * SLOTS)
    return steps


def _spread(run: int, steps: int, affordable: int, settling: int | None) -> tuple[tuple[int, ...], int, int]:
    """Return where segments begin that lie over a whole run alike, their length, and steps before each to settle in.

    All are numbers of steps; one of a segment costs three, with the two of half its length. Bodies that do not settle
    (None) go through the whole run or, where that costs too much, follow its beginning.
    """
    longer = max(steps, -(-run // MOST_SEGMENTS))
    if 3 * run <= affordable and longer <= LONGEST:  # all of it
        steps = longer + longer % 2
    through = (affordable - run) // (2 * steps)
    if settling is None and through < FEWEST_UNITS:
        return tuple(range(0, min(affordable // 3, SEGMENTS * steps), steps)), steps, 0
    apart = 0 if settling is None else max(FEWEST_UNITS, affordable // (settling + 3 * steps))
    segments = max(1, min(MOST_SEGMENTS, max(through, apart), run // steps))
    run_up = run if settling is None or through >= apart else max(0, min(settling, affordable // segments - 3 * steps))
    begins = np.linspace(0, run - steps, segments).astype(int) // 2 * 2
    return tuple(begins.tolist()), steps, run_up // SLOTS * SLOTS
