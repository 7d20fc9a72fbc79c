"""The choice of a step by what it was measured to do to the statistics."""

from __future__ import annotations

import math
from collections.abc import Callable

from impactlab.assembly.model import Model
from impactlab.errors import warn
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.plan.plan import Plan
from impactlab.results.schema import STATISTICS
from impactlab.simulation.step_error import MOST_BIAS, WORTH_SAYING, StepError

SURELY_FINE = 0.2
"""Part of the automatic step up to which a step that is given needs no measurement, whatever the network."""

TRIALS = 6
"""Steps that are tried before the best is taken as it is."""

WORTHWHILE, WORTH_SECONDS, LARGER = 1.2, 1.0, 2
"""Factor from which on a larger step, and time of a run from which on looking for it (s), is worth its work, and how
many are tried: each takes a fifth of the run, or about as long as a run of half a second, and may save half of it."""

Measure = Callable[..., StepError]
"""Of a plan, and of mean square velocities of the bodies where a larger step was chosen with them."""


def worth_measuring(plan: Plan, model: Model, integrator: Integrator, given: float | None) -> bool:
    """Whether nothing but a measurement tells what the step of a plan does."""
    wanted = isinstance(integrator, ExactFlow) and integrator.measured
    if not wanted or plan.noise.coarse or not model.nonlinear_bodies.any():
        return False
    beyond = 1.0 + 1e-9 if plan.clock.certified else SURELY_FINE
    return (given is None and not plan.clock.certified) or (given is not None and given > beyond * plan.clock.automatic)


def measured(plan_of: Callable[..., Plan], measure: Measure, plan: Plan, free: bool) -> tuple[Plan, StepError]:
    """Return a plan whose step makes no large error in the scene, and the error that it makes; warn if there is none.

    Parameters
    ----------
    plan_of : callable
        Makes the plan of the run whose step is at most so large (s), and may be larger than the rules want where mean
        square velocities of the bodies are given.
    measure : callable
        Measures what the step of a plan does, as `impactlab.simulation.stretches.step_error`.
    plan : Plan
        The plan with the step to begin with.
    free : bool
        Whether the step may be changed.
    """
    first, error = plan, measure(plan)
    for _ in range(TRIALS - 1 if free else 0):
        if error.certain <= MOST_BIAS:
            break
        plan = plan_of(error.better)
        error = measure(plan)
    if math.isinf(error.certain):
        return first, error  # the run will say where it diverges
    if free and plan is first and error.certain <= MOST_BIAS:
        plan, error = _larger(plan_of, measure, plan, error)
    if error.certain > WORTH_SAYING:
        name, label, bias, scatter = error.worst
        warn(
            f"The step of {plan.clock.step:.3g} s makes {STATISTICS[name].long_name} of {label!r} about "
            f"{100.0 * abs(bias):.2g} ± {100.0 * scatter:.1g} % too {'large' if bias > 0.0 else 'small'}, "
            f"as measured in short stretches of this scene; try step={error.better:.2g}."
        )
    return plan, error


def _larger(plan_of: Callable[..., Plan], measure: Measure, plan: Plan, error: StepError) -> tuple[Plan, StepError]:
    """Return a plan of a larger step that was found to do as well, or the same plan, and the error of its step.

    A step is no more than twice one that was found to do, so that the differences of all of them add up to its bias.
    """
    factor, too_large = 2.0, math.inf
    for _ in range(LARGER):
        if not (plan.steady and plan.seconds(1) > WORTH_SECONDS):
            break
        trial = plan_of(min(factor * plan.clock.step, too_large / WORTHWHILE), error.met["mean_square_velocity"])
        if trial.clock.step < WORTHWHILE * plan.clock.step:
            break
        found = measure(trial, error.met["mean_square_velocity"])
        if found.will_do(trial.clock.automatic):
            plan, error = trial, found
        else:
            factor, too_large = math.sqrt(factor), trial.clock.step
    return plan, error
