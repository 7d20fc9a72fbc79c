"""The time step of a run, and the contact-free intervals that are crossed in one transition."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.integrators.interval_arguments import Jumps
from impactlab.integrators.intervals import LEAF, foreseen_levels, jump_tables, sampled_will_do
from impactlab.linear.given_functions import kinds_of
from impactlab.plan.clock import MOST_SAMPLES, MOST_STEPS, TRANSIENT, batch_count, fit_step
from impactlab.plan.driving import check_ends, check_periods
from impactlab.plan.observed import WINDOW
from impactlab.plan.request import Request
from impactlab.plan.start import Start
from impactlab.results.schema import BODY, sampled_of
from impactlab.step_control.rules.automatic import choose_step, highest_step
from impactlab.step_control.rules.closings import counts_closings
from impactlab.step_control.rules.expected import Expected
from impactlab.step_control.rules.tangent_stiffness import gap_scale

LEAST_STEP_RATIO = 0.8
"""Smallest ratio of the step that fits whole contact-free intervals to the step chosen without them."""

DURATION_TOLERANCE = 1e-3
"""Largest relative change of the duration that rounding it to whole intervals may cause."""


@dataclass(frozen=True, eq=False)
class Steps:
    """The time step, the numbers of steps, and the contact-free intervals that are crossed in one transition."""

    step: float  # (s)
    automatic: float  # the step that the rules choose where none is given or measured (s), 0 if they choose none
    number: int  # number of steps over which statistics are taken
    spin_up: int  # number of steps before that
    longest: int  # steps in the longest contact-free interval; 1 if every step is taken
    leaf: int  # steps in the shortest interval, of which each is made
    levels: int  # how often the longest interval is halved until it is the shortest
    counted: bool
    """Whether contact rates are counted closings; otherwise they are fluxes through a narrow band of the gap."""
    sampled: bool
    """Whether statistics are means over the states after steps or intervals only, and not over the path between them,
    which stationary motion allows."""

    window: np.ndarray  # (contact,) half width of the band about contact whose flux is the contact rate (m)

    @classmethod
    def of(cls, model: Model, request: Request, expected: Expected, start: Start) -> Self:
        """Choose the step, and round it so that duration, sampling intervals and periods are whole numbers of steps.

        It is refused if no step can be chosen, the given one cannot be used, or the run would have too many steps.
        """
        window = WINDOW * gap_scale(model, expected.stiffening)  # contact-free intervals stay out of it
        intervals = request.intervals() if request.records else []
        duration, given = request.duration, request.step is not None
        period = check_periods(model, duration + expected.spin_up)
        check_ends(model, duration)
        every_step = any(record.every_step for record in request.records) or bool(sampled_of(BODY))
        may_sample = expected.stationary and sampled_will_do(model, request.integrator, every_step)
        chosen = _step_before_fitting(model, request, expected, may_sample)
        if period is not None and not given and (not intervals or _divides(intervals[0], period)):
            intervals.append(period)
        step, number = fit_step(chosen, given, intervals, duration, smooth=period is not None and not given)
        transient = isinstance(expected.start, np.ndarray)
        counted = counts_closings(model, request.integrator, transient, expected.stiffening, step)
        leaf, levels, longest = (LEAF // 2 if request.coarse else LEAF), 0, 1  # as long as in the fine run of a pair
        if may_sample:
            fine_step = 0.5 * step if request.coarse else step
            deepest = foreseen_levels(model, fine_step, start.deviations, window, int(request.realizations))
            for candidate in range(deepest, 0, -1):
                steps = leaf << candidate
                fitted, count = fit_step(chosen, given, intervals, duration, steps)
                samples_fit = all(round(interval / fitted) % steps == 0 for interval in intervals)
                duration_fits = abs(count * fitted - duration) <= DURATION_TOLERANCE * duration
                if samples_fit and duration_fits and fitted > LEAST_STEP_RATIO * step:
                    step, number, levels, longest = fitted, count, candidate, steps
                    break
        if number + expected.spin_up / step >= MOST_STEPS:
            raise InvalidInput(
                f"A run of {duration + expected.spin_up:g} s has too many steps of {step:g} s; give a shorter "
                "duration= or spin_up=, or a larger step=."
            )
        spin_up = math.ceil(expected.spin_up / (longest * step) * (1.0 - 1e-12)) * longest  # rounding adds no interval
        linear_only = may_sample and not model.kicks.nonlinear.any()
        automatic = _automatic(model, request, expected, step)
        return cls(step, automatic, number, spin_up, longest, leaf, levels, counted, linear_only or longest > 1, window)

    @property
    def jumping(self) -> bool:
        """Whether contact-free intervals are crossed in one transition each."""
        return self.longest > 1

    def jumps(self, model: Model, start: Start, seed: tuple[int, int]) -> Jumps:
        """Return the tables of the transitions over contact-free intervals."""
        return jump_tables(model, self.step, self.leaf, self.levels, start.deviations, self.window, seed)


def _step_before_fitting(model: Model, request: Request, expected: Expected, may_sample: bool) -> float:
    """Return the given step, checked, or the chosen one before rounding (s)."""
    integrator, stiffening, duration = request.integrator, expected.stiffening, request.duration
    times = -expected.spin_up, duration, expected.start
    chosen = choose_step(model, integrator, expected.measured, request.step, *times)
    if request.step is None and request.mean_square_velocity is not None:
        # the measurement of its error replaces the safety margin of the rules
        chosen = max(chosen, highest_step(model, integrator, expected.measured, *times))
    chosen = min(chosen, request.longest_step)
    if request.step is None:
        chosen = min([chosen, *(record.largest_step(model) for record in request.records)])
    if request.step is not None or model.kicks.nonlinear.any():
        return chosen
    # the flow of linear bodies is exact at any step: only the sampling of their motion limits it
    if not expected.stationary or kinds_of(model):
        chosen = min(chosen, TRANSIENT * integrator.recommended_step(model, stiffening.links, stiffening.bodies))
    if may_sample:
        batches = batch_count(request.realizations, duration, expected.relaxed.slowest)
        chosen = max(chosen, duration / (MOST_SAMPLES * batches))
    return min([chosen, *(record.longest_step(model) for record in request.records)])


def _automatic(model: Model, request: Request, expected: Expected, step: float) -> float:
    """Return the step that rules would choose if none were given or measured (s), 0 if none can be."""
    given = request.step is not None
    if not given and request.mean_square_velocity is None:
        return step
    stiffening = expected.stiffening if given else expected.measured
    try:
        rules = choose_step(
            model, request.integrator, stiffening, None, -expected.spin_up, request.duration, expected.start
        )
    except InvalidInput:
        return 0.0
    return rules if given else min(step, rules)


def _divides(interval: float, period: float) -> bool:
    """Whether a period is a whole number of intervals."""
    return abs(period / interval - round(period / interval)) < 1e-9 * period / interval
