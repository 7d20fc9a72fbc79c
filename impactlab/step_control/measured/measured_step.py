"""The choice of a step by its measured bias in the statistics."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import WORTH_SAYING, warn
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.plan.plan import Plan
from impactlab.results.measured import measured_text
from impactlab.results.schema import EVERY
from impactlab.step_control.measured.step_bias import StepBias
from impactlab.step_control.rules.automatic import alike

SURELY_FINE = 0.2
"""Part of the automatic step up to which a step that is given needs no measurement, whatever the network."""

TRIALS = 6
"""Steps that are tried before the best is taken as it is."""

WORTH_ENLARGING = 1.2
"""Least factor by which a larger step is worth taking."""

WORTH_SEARCHING = 1.0
"""Least work of a run for which a still larger step is sought: the search takes a fifth of the run, and may save half
of the run (s)."""

Measure = Callable[..., StepBias]
"""Of a plan, and the mean square velocities that it was made with; `patient` ones go on where much is unclear."""


def may_measure(model: Model, integrator: Integrator) -> bool:
    """Whether the bias of a step of a method can be measured, and there may be one."""
    wanted = isinstance(integrator, ExactFlow) and integrator.measured and not integrator.derived
    return wanted and bool(model.kicks.nonlinear.any())


def worth_measuring(plan: Plan, model: Model, integrator: Integrator, given: float | None) -> bool:
    """Whether nothing but a measurement tells what the step of a plan does, and it can be made."""
    if plan.noise.coarse or not may_measure(model, integrator):
        return False
    if given is None:
        return not plan.clock.certified or alike(model, plan.start.state, plan.clock.duration)
    beyond = 1.0 + 1e-9 if plan.clock.certified else SURELY_FINE
    return given > beyond * plan.clock.automatic


def measured(
    plan_of: Callable[..., Plan], measure: Measure, plan: Plan, sampled: Callable[[Plan], Plan] | None
) -> tuple[Plan, StepBias]:
    """Return a plan whose step causes no large bias, and the bias of its step; warn if no such step is found.

    Parameters
    ----------
    plan_of : callable
        Makes the plan of the run from an upper bound of its step (s) and, optionally, mean square velocities of the
        bodies, with which the step may exceed that of the rules: measured ones, or infinite ones where the energies
        that the rules estimate are to be kept.
    measure : callable
        Measures what the step of a plan does, as `impactlab.step_control.measured.segments.step_bias`.
    plan : Plan
        The plan with the step of the rules, or the one that is given.
    sampled : callable, optional
        Makes the plan with the records of the run from one without them, of which it may round the step down. Without
        it the step may not be changed.
    """
    first = plan
    plan, bias = _chosen(plan_of, measure, plan) if sampled else (plan, measure(plan))
    if math.isinf(bias.certain):  # the run will say where it diverges, or that this is unknown
        return sampled(first) if sampled else first, bias
    if sampled:
        plan = sampled(plan)
        if plan.clock.step < bias.step * (1.0 - 1e-9):
            bias = measure(plan)
    told = bias.told()
    if told.certain > WORTH_SAYING:
        name, label, value, error = told.worst
        error = math.hypot(error, told.error_of_order * value)
        warn(
            "step_bias",
            f"At the step of {plan.clock.step:.3g} s {EVERY[name].long_name} of {label!r} is about "
            f"{measured_text(100.0 * abs(value), 100.0 * error)} % too {'large' if value > 0.0 else 'small'}, "
            f"as measured on this network; try step={bias.better:.2g}.",
        )
    return plan, bias


def _chosen(plan_of: Callable[..., Plan], measure: Measure, rules: Plan) -> tuple[Plan, StepBias]:
    """Return a plan whose step does, and the bias of its step, or the last of some trials.

    Where the motion is stationary steps are measured from above: a bias that is four times as large tells more for its
    work. The first step resolves forces at least half as finely as the rules; a later one is no more than twice one
    that was found to do: differences between a step and its half, which are what is measured, then add up to its bias.
    """
    plan, time = rules, rules.realizations.number * rules.clock.duration
    stationary = rules.steady and rules.random
    anything = np.full(len(rules.system.bodies), np.inf)
    if stationary:
        larger = plan_of(math.inf, anything)
        plan = larger if larger.clock.step > WORTH_ENLARGING * rules.clock.step else rules

    def does(plan: Plan, bias: StepBias) -> bool:
        return bias.will_do(rules.clock.step) if plan.clock.step > rules.clock.step else bias.does

    known: StepBias | None = None
    last: StepBias | None = None
    for _ in range(TRIALS):
        high = plan.clock.step > rules.clock.step
        tried, bias = plan, measure(plan, anything if high else None, patient=not high)
        if known is not None and bias.step < known.step:
            bias = bias.or_from(known)  # one event in a path may not be met again
        if last is not None and bias.follows_the_step(last):
            return tried, bias
        last = bias
        known = None if stationary or bias.certain == math.inf else bias
        if does(plan, bias):
            return _larger(plan_of, measure, plan, bias) if high else (plan, bias)
        if not high:
            plan = plan_of(bias.better)
        elif not bias.does and bias.certain < math.inf:
            plan = plan_of(max(bias.better, rules.clock.step), anything)
        else:
            plan = rules
        if stationary and bias.certain < math.inf and not len(rules.forces.states):
            foreseen = bias.at(plan.clock.step)
            if does(plan, foreseen) and not foreseen.unclear(time):
                return plan, foreseen
    return tried, bias


def _larger(plan_of: Callable[..., Plan], measure: Measure, plan: Plan, bias: StepBias) -> tuple[Plan, StepBias]:
    """Return a plan of a larger step that was found to do as well, or the same plan, and the bias of its step."""
    if plan.work > WORTH_SEARCHING:
        velocity = bias.measured["mean_square_velocity"]
        trial = plan_of(2.0 * plan.clock.step, velocity)
        if trial.clock.step > WORTH_ENLARGING * plan.clock.step:
            found = measure(trial, velocity, patient=False)
            if found.will_do(trial.clock.automatic):
                return trial, found
    return plan, bias
