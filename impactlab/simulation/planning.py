"""From a request to a plan: everything that is decided before a run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import WholeFlow
from impactlab.integrators.intervals import LEAF, foreseen_levels, jump_lanes, jump_tables, may_jump, sampled_will_do
from impactlab.integrators.jumps import Jumps
from impactlab.linear.given_functions import kinds_of
from impactlab.nonlinear.closings import counts_closings, jitter
from impactlab.nonlinear.relaxation import closing_rates
from impactlab.nonlinear.tangent_stiffness import Stiffening, gap_scale
from impactlab.plan.clock import MOST_SAMPLES, MOST_STEPS, TRANSIENT, Clock, batch_count, enough_units, fit_step
from impactlab.plan.driving import Driving, check_periods, warn_of_bands
from impactlab.plan.forces import Forces
from impactlab.plan.method import Method
from impactlab.plan.noise import WhiteNoises
from impactlab.plan.observed import WINDOW, Observed
from impactlab.plan.plan import Plan
from impactlab.plan.realizations import Realizations, block_shape, most_lanes
from impactlab.plan.start import Start
from impactlab.plan.subdomains import Subdomains
from impactlab.plan.system import System
from impactlab.simulation.expected import Expected
from impactlab.simulation.request import Request
from impactlab.step_size.automatic import choose_step, highest_step
from impactlab.step_size.certified import certified
from impactlab.step_size.kinks import warn_of_kinks

NEVER = 1e-3
"""Closings of a contact expected in a run, below which it is taken for one that cannot close."""

SHORTER = 0.8
"""Part of the step that would do without jumps which a step that makes whole intervals has at least."""

MISSED = 1e-3
"""Part of the duration by which one of whole intervals may differ from it."""


@dataclass(frozen=True, eq=False)
class Steps:
    """The step, and how many of them.

    Attributes
    ----------
    step : float
        (s)
    number : int
        Steps of the statistics.
    spin_up : int
        Steps before.
    unit : int
        Steps of the longest interval that is covered at once, else 1.
    leaf, levels : int
        Steps of the shortest such interval, and how often the longest is halved.
    counted : bool
        Whether contact rates are counts of closings.
    sampled : bool
        Whether states are samples of a stationary motion.
    """

    step: float
    number: int
    spin_up: int
    unit: int
    leaf: int
    levels: int
    counted: bool
    sampled: bool

    @classmethod
    def of(cls, model: Model, request: Request, expected: Expected, start: Start, window: np.ndarray) -> Self:
        """Choose the step and fit it to the times that are asked for.

        Raises
        ------
        InvalidInput
            If no step can be chosen, the one that is given cannot be used, or there are too many.
        """
        intervals = request.intervals()
        period = check_periods(model, request.duration + expected.spin_up)
        sampled = expected.settled and sampled_will_do(
            model, request.integrator, any(record.every_step for record in request.records)
        )
        given, duration = request.step is not None, request.duration
        chosen = _chosen(model, request, expected, sampled)
        periods = [] if given or period is None else [period]
        if all(_divides(interval, each) for each in periods for interval in intervals[:1]):
            intervals += periods
        step, number = fit_step(chosen, given, intervals, duration, smooth=bool(periods))
        counted = counts_closings(model, request.integrator, expected.start, expected.stiffening, step)
        still = sampled and not model.nonlinear_bodies.any()
        leaf, levels, unit = (LEAF // 2 if request.coarse else LEAF), 0, 1
        if sampled and may_jump(model, start.deviations):
            own = 0.5 * step if request.coarse else step
            foreseen = foreseen_levels(model, own, start.deviations, window, int(request.realizations))
            for levels in range(foreseen, 0, -1):
                longer, count = fit_step(chosen, given, intervals, duration, leaf << levels)
                exact = all(round(interval / longer) % (leaf << levels) == 0 for interval in intervals)
                if exact and longer > SHORTER * step and abs(count * longer - duration) <= MISSED * duration:
                    step, number, unit = longer, count, leaf << levels
                    break
        if number + expected.spin_up / step >= MOST_STEPS:
            raise InvalidInput(f"{duration + expected.spin_up:g} s are too many steps of {step:g} s.")
        spin_up = math.ceil(expected.spin_up / (unit * step) * (1.0 - 1e-12)) * unit
        return cls(step, number, spin_up, unit, leaf, levels, counted, still or unit > 1)

    @property
    def jumping(self) -> bool:
        """Whether intervals in which nothing can touch are covered at once."""
        return self.unit > 1

    def jumps(self, model: Model, start: Start, window: np.ndarray, seed: tuple[int, int]) -> Jumps | None:
        """Return the tables for such intervals, if there are any."""
        if not self.jumping:
            return None
        return jump_tables(model, self.step, self.leaf, self.levels, start.deviations, window, seed)


def make_plan(model: Model, request: Request) -> Plan:
    """Decide everything about a run before it begins.

    Parameters
    ----------
    model : Model
        The network.
    request : Request
        What is asked for.

    Raises
    ------
    InvalidInput
        If something cannot be done; the message says what would work.
    """
    request.integrator.check(model)
    request = request.resolved(model)
    expected = Expected.of(model, request)
    stiffening, relaxed = expected.stiffening, expected.relaxed
    model = request.integrator.arrange(model, stiffening.links, stiffening.bodies)
    start = Start.of(model, expected.start, stiffening.bodies, stiffening.rest, relaxed.temperature, request.seed)
    window = WINDOW * gap_scale(model, stiffening.penetration)
    # The step, and with it the method: in jumps where nothing touches for long.
    steps = Steps.of(model, request, expected, start, window)
    integrator = WholeFlow() if steps.jumping else request.integrator
    _warn(model, request, expected, steps, integrator)
    # Samples and batches end with whole intervals, and blocks are as large as memory and time allow.
    observed, driving = _observed(model, request, steps, window), Driving.of(model)
    unit = max(observed.every, steps.unit)
    clock = _clock(model, request, expected, steps, unit)
    series = driving.nbytes(integrator, clock.step, clock.all_steps)
    realizations = _realizations(model, request, clock, steps.jumping, series, unit)
    single, likely = realizations.lanes == 1 and not steps.jumping, _likely(model, request, stiffening)
    return Plan(
        system=System.of(model),
        forces=Forces.of(model, likely, single=single, kick=steps.step if integrator.kicks else None),
        method=Method.of(model, integrator, steps.step, steps.jumps(model, start, window, request.seed)),
        noise=WhiteNoises.of(model, integrator, steps.step, request.seed, request.coarse),
        driving=driving,
        start=start,
        clock=clock,
        realizations=realizations,
        observed=observed,
        subdomains=Subdomains.of(model, _reach(model, integrator) if single else 0),
    )


def _chosen(model: Model, request: Request, expected: Expected, sampled: bool) -> float:
    """Return the step that is given, or chosen before it is fitted to the times that are asked for (s)."""
    integrator, stiffening, duration = request.integrator, expected.stiffening, request.duration
    chosen = _by_rules(model, request, expected, expected.met, request.step)
    if request.step is None and request.velocity is not None:
        chosen = max(chosen, highest_step(model, integrator, expected.met, -expected.spin_up, duration, expected.start))
    chosen = min(chosen, request.ceiling)
    if request.step is not None or model.nonlinear_bodies.any():
        return chosen
    # each of linear bodies is exact: what counts is how well their motion is sampled
    if not expected.settled or kinds_of(model):
        chosen = min(chosen, TRANSIENT * integrator.recommended_step(model, stiffening.links, stiffening.bodies))
    if sampled:
        batches = batch_count(request.realizations, duration, expected.relaxed.slowest)
        chosen = max(chosen, duration / (MOST_SAMPLES * batches))
    return min([chosen, *(record.longest_step(model) for record in request.records)])


def _observed(model: Model, request: Request, steps: Steps, window: np.ndarray) -> Observed:
    """Return sums and records; these sample after whole intervals, in a short run once at its end."""
    records, unit = request.records, steps.unit
    strides = [min(-(-record.stride(model, steps.step) // unit) * unit, steps.number) for record in records]
    every = math.gcd(*strides)
    still = np.zeros(len(model.ends))
    return Observed(
        records=tuple(
            (record, stride // every if every else 1) for record, stride in zip(records, strides, strict=True)
        ),
        every=every,
        window=window,
        counted=steps.counted,
        jitter=jitter(model, steps.step, request.duration) if steps.counted else still,
        bodies=len(model.bodies),
        contacts=len(model.contacts),
        sampled=steps.sampled,
    )


def _clock(model: Model, request: Request, expected: Expected, steps: Steps, unit: int) -> Clock:
    """Return steps and batches, which end after a number of steps that a `unit` divides."""
    relaxation, number = expected.relaxed.slowest, steps.number
    batches = batch_count(request.realizations, request.duration, relaxation)
    boundaries = [batch * number // batches // unit * unit for batch in range(1, batches)]
    return Clock(
        step=steps.step,
        spin_up_steps=steps.spin_up,
        steps=number,
        boundaries=(*sorted({end for end in boundaries if 0 < end < number}), number),
        relaxation=relaxation,
        settling=expected.settling,
        automatic=_automatic(model, request, expected, steps.step),
        certified=certified(model, expected.stiffening.penetration, steps.step),
    )


def _realizations(model: Model, request: Request, clock: Clock, jumping: bool, series: int, unit: int) -> Realizations:
    """Return the shape of blocks, in which a realization takes some bytes for its series."""
    number, workers = int(request.realizations), request.workers
    most = jump_lanes(model) if jumping else most_lanes(model, number, workers)
    lanes, steps_per_call = block_shape(model, number, workers, series, most)
    batches = (np.diff([0, *clock.boundaries]) + unit) * clock.step
    return Realizations(number, lanes, steps_per_call, enough_units(number, batches, clock.relaxation), request.seed)


def _by_rules(model: Model, request: Request, expected: Expected, scene: Stiffening, given: float | None) -> float:
    """Return the step that is given, checked, or that rules find for a scene (s)."""
    return choose_step(model, request.integrator, scene, given, -expected.spin_up, request.duration, expected.start)


def _automatic(model: Model, request: Request, expected: Expected, step: float) -> float:
    """Return the step that is chosen where none is given (s); 0 if none can be."""
    if request.step is None and request.velocity is None:
        return step
    try:
        if request.step is None:
            return min(step, _by_rules(model, request, expected, expected.met, None))
        return _by_rules(model, request, expected, expected.stiffening, None)
    except InvalidInput:
        return 0.0


def _likely(model: Model, request: Request, stiffening: Stiffening) -> np.ndarray:
    """Whether each contact may close in the run, also where that is not known, (contact,) of bool."""
    with np.errstate(over="ignore"):
        closings = closing_rates(model, stiffening) * request.duration * request.realizations
    return ~(closings < NEVER)


def _reach(model: Model, integrator: Integrator) -> int:
    """Contacts that a force reaches in a step, 0 where more than contacts connects bodies."""
    alone = model.only_touching and not model.time_varying and integrator.reach
    return integrator.reach + model.passes if alone else 0


def _warn(model: Model, request: Request, expected: Expected, steps: Steps, integrator: Integrator) -> None:
    """Warn of series beside the natural frequency and of steps that kinks are too sharp for."""
    warn_of_bands(model)
    if request.step is None and integrator.kicks:
        warn_of_kinks(model, expected.stiffening, steps.step, request.duration + expected.spin_up)


def _divides(interval: float, period: float) -> bool:
    return abs(period / interval - round(period / interval)) < 1e-9 * period / interval
