"""The step that rules choose, the largest that may be measured, and networks whose rules are known to be right."""

from __future__ import annotations

import math

import numpy as np

from impactlab.assembly.mechanism import Mode, interrupted, refusing
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.contact import contact_forces
from impactlab.components.evaluation import distinct
from impactlab.components.oscillator import DuffingOscillator
from impactlab.errors import InvalidInput
from impactlab.integrators.base import Integrator
from impactlab.linear.given_functions import resolving_step
from impactlab.step_control.rules.closings import counts_closings
from impactlab.step_control.rules.dissipation import damping_step, slope_step
from impactlab.step_control.rules.kinks import kink_step
from impactlab.step_control.rules.profiles import STABLE_REACH
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energy_of, slopes_at

FURTHER = 2.0
"""Largest step that a measurement may choose, as a multiple of the step at which rules take forces for resolved."""

FLIGHT = 0.15
"""Part of a radian, and of the time in which friction takes 1/e of a velocity, in a step in which bodies collide."""

SERIES_FRICTION = 3.0
"""Largest friction over an automatic step, ``c h/m``, of a kicked body under a sum of cosines or filtered noise."""


EXPONENTS = 0.95, 4.0
"""Least and largest exponent ``d ln F/d ln δ`` of forces whose step is known from theory and tests."""

UNIFORM = 0.3
"""Largest variation of this exponent along a force."""

NOISY = 0.05
"""Energy from noise in a run, relative to that of a given start, from which on errors of kinks average out."""

_PLACES = np.array([0.01, 0.03, 0.1, 0.3, 1.0, 1.5, 3.0])


def choose_step(
    model: Model, integrator: Integrator, stiffening: Stiffening, given: float | None, begin: float = 0.0,
    end: float = 0.0, start: str | np.ndarray = "stationary",
) -> float:  # fmt: skip
    """Return the given step, checked, or the recommended one for a run between two times from a start.

    A step that is too large for the network is refused, with the largest safe step in the message; so is a network for
    which no rule gives a step.
    """
    unknown = model.kicks.bodies & ~np.isfinite(stiffening.energy)
    if given is None and unknown.any():
        raise InvalidInput(
            f"No step can be chosen: the energy that {model.bodies.names[int(unknown.argmax())]!r} brings into "
            "collisions is not known, since an excited body has no damping. Give step= (s)."
        )
    moved = model.kicks.timed & (stiffening.energy == 0.0)
    if given is None and moved.any():
        raise InvalidInput(
            f"No step can be chosen: the energy of {model.bodies.names[int(moved.argmax())]!r} is not known, which "
            "nothing but a law that depends on time moves. Give step= (s)."
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
    if not math.isfinite(step):  # a body at a rest, where its energy tells no stiffness
        place = (
            start[0].reshape(len(model.mass), -1) if isinstance(start, np.ndarray) else np.zeros((len(model.mass), 1))
        )
        slopes = np.max([slopes_at(model, row) for row in place.T], axis=0)
        step = integrator.recommended_step(model, stiffening.links, slopes)
    if not math.isfinite(step):
        raise InvalidInput("No step can be chosen: no body has stiffness or damping. Give step= (s).")
    return step


@kept
def _rules(model: Model, integrator: Integrator, stiffening: Stiffening, transient: bool) -> float:
    """Return the step that forces want which do not depend on time (s), from a given state in a `transient`."""
    step = integrator.recommended_step(model, stiffening.links, stiffening.bodies)
    if model.kicks.dissipative:
        step = min(step, damping_step(model, stiffening))
    if integrator.kicks:
        step = min(step, kink_step(model, stiffening))
        step = min(step, series_step(model)) if model.bodies.sampled else step
        step = min(step, flight_step(model)) if interrupted(model).any() else step
        if counts_closings(model, integrator, transient, stiffening, step):
            step = min(step, stopping_step(model))
    else:
        step = min(step, slope_step(model, stiffening))
    return step


def highest_step(
    model: Model, integrator: Integrator, stiffening: Stiffening, begin: float, end: float, start: str | np.ndarray
) -> float:
    """Return the largest step that a measurement may find to be right (s).

    Forces are resolved nearly as well as by the rules, and the step is stable at all energies that occur. For laws that
    are no powers only the weighted stiffness is known, and the step of the rules is the largest.
    """
    step = integrator.recommended_step(model, stiffening.links, stiffening.bodies)
    if stiffening.plain:
        hot = Stiffening.of(model, STABLE_REACH * stiffening.energy, stiffening.times)
        stable = integrator.largest_step(model, hot.links, hot.bodies)
        step = min(max(step, stable), FURTHER * step)
    step = min(step, FURTHER * damping_step(model, stiffening), series_step(model), FURTHER * flight_step(model))
    if counts_closings(model, integrator, isinstance(start, np.ndarray), stiffening, step):
        step = min(step, stopping_step(model))
    return resolving_step(model, begin, end, step)


def flight_step(model: Model) -> float:
    """Return the step for events that are located within the flow (s).

    Bodies turn little within the step, so that a path is nearly a cubic between its ends.
    """
    bodies = interrupted(model)
    rates = np.append(np.sqrt(model.stiffness / model.mass)[bodies], model.damping[bodies] / model.mass[bodies])
    return FLIGHT / float(rates.max()) if rates.any() else math.inf


def stopping_step(model: Model) -> float:
    """Return the largest step at which closings can be counted, within which friction hardly stops the bodies (s).

    Beyond it contacts close with velocities that friction forgets within a step, and the path between kicks misses
    such closings: at ``c h/m`` of 1, 3, 6, 10 and 20 it has 0, 4, 15, 37 and 81 % too many closings.
    """
    if model.bodies.sampled:  # see `series_step`
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
    kicked = [slot for slot in model.bodies.sampled if model.kicks.nonlinear[slot] and model.damping[slot] > 0.0]
    return min((SERIES_FRICTION * float(model.mass[slot] / model.damping[slot]) for slot in kicked), default=math.inf)


def certified(model: Model, penetration: np.ndarray, step: float) -> bool:
    """Whether a step of a network, up to the automatic one, is known to be right, without a measurement.

    So it is, by theory and by random networks against exact laws, for bodies under white noises of constant intensity,
    one for each, from any start but those that `alike` tells of, whose forces are conservative: linear couplings, and
    contacts and residual forces that are nearly powers of their indentation or displacement, with exponents from 1 to
    4. Friction does not stop a body within a step: at c h/m from 8 to 60 the mean force of a contact was up to 1.6 %
    too small.
    """
    if (model.kicks.nonlinear & (model.damping * step > 1.001 * model.mass)).any():  # steps are often m/c
        return False
    if refusing(model, Mode.CERTIFIED_STEP) or model.kicks.passes or model.sources["intensity"].joining:
        return False
    if not model.couplings.linear[0].all():
        return False
    if not _powers(model, penetration):
        return False
    bent = np.flatnonzero(model.bodies.residual).tolist()
    return all(isinstance(model.bodies.oscillators[slot], DuffingOscillator) for slot in bent)


@kept
def _powers(model: Model, depths: np.ndarray) -> bool:
    """Whether the forces of all contacts are nearly powers of indentations up to some depths (m)."""
    for row in distinct(model.contacts.laws, [depths])[0].tolist():
        law, depth = model.contacts.laws[row], float(depths[row])
        force = contact_forces([law], depth * _PLACES[None])[0] if depth > 0.0 else np.zeros_like(_PLACES)
        if not ((force > 0.0) & (force < np.inf)).all():
            if force.any():
                return False
            continue
        exponents = np.diff(np.log(force)) / np.diff(np.log(_PLACES))
        low, high = EXPONENTS
        if not (low <= exponents.min() and exponents.max() <= high and np.ptp(exponents) <= UNIFORM):
            return False
    return True


def alike(model: Model, start: str | np.ndarray, duration: float) -> bool:
    """Whether a start is given beside which noise does so little that all realizations collide at much the same times.

    Errors of kinks then do not average out over the phases of the steps: they were up to 5 % of E[v²] at steps that are
    certified otherwise, below 0.5 % where noise gives a hundredth of the energy at the start.
    """
    if not isinstance(start, np.ndarray) or not len(model.ends):
        return False
    labels = model.connected
    cooled = np.bincount(labels, model.damping) > 0.0  # without friction kinks make the energy wander, which is told
    heat = np.bincount(labels, np.pi * model.noise.intensity / model.mass * duration)
    begun = np.bincount(labels, energy_of(model, start))
    touching = np.zeros(len(heat), dtype=bool)
    touching[labels[model.ends.coordinates()]] = True
    return bool((touching & cooled & (heat < NOISY * begun)).any())
