"""The step of a run: the one that is chosen where none is given, and the largest that may be measured."""

from __future__ import annotations

import math

import numpy as np

from impactlab.assembly.model import Model, kept
from impactlab.errors import InvalidInput
from impactlab.integrators.base import Integrator
from impactlab.linear.given_functions import resolving_step
from impactlab.nonlinear.closings import counts_closings
from impactlab.nonlinear.profiles import STABLE_REACH
from impactlab.nonlinear.tangent_stiffness import Stiffening
from impactlab.step_size.dissipation import damping_step, slope_step
from impactlab.step_size.kinks import kink_step

FURTHER = 2.0
"""Multiple of the step at which rules take forces for resolved, up to which a measurement may find one to be right."""

FLIGHT = 0.15
"""Part of a radian, and of the time in which friction takes 1/e of a velocity, in a step in which bodies collide."""

SERIES_FRICTION = 3.0
"""Largest friction over an automatic step, ``c h/m``, of a kicked body under a sum of cosines or coloured noise."""


def choose_step(
    model: Model, integrator: Integrator, stiffening: Stiffening, given: float | None, begin: float = 0.0,
    end: float = 0.0, start: str | np.ndarray = "stationary",
) -> float:  # fmt: skip
    """Return the given step, checked, or the recommended one for a run between two times from a start.

    A step that is too large for the scene is refused (the largest safe one is named), and where no rule leads to one.
    """
    unknown = model.kicked & ~np.isfinite(stiffening.energy)
    if given is None and unknown.any():
        raise InvalidInput(
            f"No step can be chosen: the energy that {model.bodies[int(unknown.argmax())]!r} brings into collisions "
            "is not known, since an excited body has no damping. Give step= (s)."
        )
    moved = model.timed & (stiffening.energy == 0.0)
    if given is None and moved.any():
        raise InvalidInput(
            f"No step can be chosen: the energy of {model.bodies[int(moved.argmax())]!r} is not known, which nothing "
            "but a law that depends on time moves. Give step= (s)."
        )
    stiffness = stiffening.links, stiffening.bodies
    largest = integrator.largest_step(model, *stiffness)
    if largest <= 0.0:
        raise InvalidInput(
            f"{type(integrator).__name__} is unstable at any step for this network (a body is not damped "
            "enough). Use il.ExactFlow()."
        )
    if given is not None:
        if given > largest:
            raise InvalidInput(
                f"A step of {given:g} s is too large for {type(integrator).__name__} in this network: the largest "
                f"stable one is {largest:.3g} s, {integrator.recommended_step(model, *stiffness):.3g} s is recommended."
            )
        return given
    step = _rules(model, integrator, stiffening, isinstance(start, np.ndarray))
    if end > begin:
        step = resolving_step(model, begin, end, step)
    if not math.isfinite(step):
        raise InvalidInput("No step can be chosen: no body has stiffness or damping. Give step= (s).")
    return step


@kept
def _rules(model: Model, integrator: Integrator, stiffening: Stiffening, transient: bool) -> float:
    """Return the step that forces want which do not depend on time (s), from a given state in a `transient`."""
    step = min(integrator.recommended_step(model, stiffening.links, stiffening.bodies), damping_step(model, stiffening))
    if integrator.kicks:
        step = min(step, kink_step(model, stiffening), series_step(model), impact_step(model))
        if counts_closings(model, integrator, transient, stiffening, step):
            step = min(step, stopping_step(model))
    else:
        step = min(step, slope_step(model, stiffening))
    return step


def highest_step(
    model: Model, integrator: Integrator, stiffening: Stiffening, begin: float, end: float, start: str | np.ndarray
) -> float:
    """Return the largest step that a measurement may find to be right (s).

    Forces are resolved nearly as well as the rules want, and steps are stable for all energies that occur: of laws
    that are no powers the stiffness is known with its weight only, at which the rules' step is as large as that.
    """
    step = integrator.recommended_step(model, stiffening.links, stiffening.bodies)
    if stiffening.plain:
        hot = Stiffening.of(model, STABLE_REACH * stiffening.energy, stiffening.times)
        stable = integrator.largest_step(model, hot.links, hot.bodies)
        step = min(max(step, stable), FURTHER * step)
    step = min(step, FURTHER * damping_step(model, stiffening), series_step(model), FURTHER * impact_step(model))
    if counts_closings(model, integrator, isinstance(start, np.ndarray), stiffening, step):
        step = min(step, stopping_step(model))
    return resolving_step(model, begin, end, step)


def impact_step(model: Model) -> float:
    """Return the step in which bodies of rigid contacts, of which a path between its ends is then nearly a cubic, and
    those of dry friction that sticks turn little (s).
    """
    bodies = model.interrupted
    rates = np.append(model.natural_frequencies[bodies], model.damping[bodies] / model.mass[bodies])
    return FLIGHT / float(rates.max()) if rates.any() else math.inf


def stopping_step(model: Model) -> float:
    """Return the largest step at which closings can be counted, within which friction hardly stops the bodies (s).

    Beyond it they close with velocities that are forgotten within a step, of which the path between kicks knows
    nothing: at ``c h/m`` of 1, 3, 6, 10 and 20 it has 0, 4, 15, 37 and 81 % too many closings.
    """
    if model.lines or model.coloured:  # see `series_step`
        return math.inf
    touching = model.ends.coordinates()
    fastest = float((model.damping[touching] / model.mass[touching]).max(initial=0.0))
    return 1.0 / fastest if fastest else math.inf


def series_step(model: Model) -> float:
    """Return the step at which friction takes little of what a kick gives to bodies under other noise than white (s).

    The velocities of these are read in the middle of kicks alone, which says nothing of what decays between them:
    with a damping ratio of 10, a natural frequency of 100 rad/s and a Hertz contact E[v²] is 1.7 % too large at
    ``c h/m = 16``, and 0.07 ± 0.003 % too small at 4.
    """
    kicked = [
        slot for slot in {*model.lines, *model.coloured} if model.nonlinear_bodies[slot] and model.damping[slot] > 0.0
    ]
    return min((SERIES_FRICTION * float(model.mass[slot] / model.damping[slot]) for slot in kicked), default=math.inf)
