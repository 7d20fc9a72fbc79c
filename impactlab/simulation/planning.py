"""The plan of a run, chosen from the network and the request: batches and blocks, and what follows from the rest.

Spin-up and start are chosen in `impactlab.simulation.expected`, the step in `impactlab.simulation.steps`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import warn
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import WholeFlow
from impactlab.integrators.intervals import in_one_piece, jump_lanes
from impactlab.linear.given_functions import jumping_laws, with_given_motions
from impactlab.machine import uncollected
from impactlab.nonlinear.closings import jitter
from impactlab.nonlinear.relaxation import closing_rates
from impactlab.nonlinear.tangent_stiffness import Stiffening, gap_scale
from impactlab.plan.clock import Clock, batch_count, enough_units
from impactlab.plan.driving import ColouredNoises, Driving, warn_of_bands
from impactlab.plan.dry_friction import DryFriction
from impactlab.plan.forces import Forces
from impactlab.plan.impacts import RigidImpacts
from impactlab.plan.jumping import with_jumps
from impactlab.plan.method import Method
from impactlab.plan.noise import WhiteNoises
from impactlab.plan.observed import WINDOW, Observed
from impactlab.plan.plan import Plan
from impactlab.plan.points import Points
from impactlab.plan.realizations import Realizations, block_shape, most_lanes
from impactlab.plan.start import Start, filters_of, start_of, states_of
from impactlab.plan.subdomains import Subdomains
from impactlab.plan.system import System
from impactlab.results.schema import CONTACT, STATISTICS, sampled_of
from impactlab.simulation.expected import Expected, usual_spin_up
from impactlab.simulation.measured_step import may_measure
from impactlab.simulation.request import Request
from impactlab.simulation.steps import Steps
from impactlab.statistics.rare import CLOSINGS
from impactlab.step_size.certified import alike, certified
from impactlab.step_size.kinks import warn_of_kinks

NEGLIGIBLE_CLOSINGS = 1e-3
"""Expected number of closings in a run below which a contact is taken never to close, and its statistics are 0."""


@uncollected()
def make_plan(model: Model, request: Request) -> Plan:
    """Make the plan of a run. A request that cannot be met is refused, with a cure.

    Where the error of the step is measured before the run, there is a plan for each step that is tried.
    """
    request.integrator.check(model)
    request = request.resolved(model, usual_spin_up(model, request, start_of(request.initial, model))[0])
    expected = Expected.of(model, request)
    # tangent stiffnesses and penetrations at the energies that are expected, and relaxation times
    stiffening, relaxed = expected.stiffening, expected.relaxed
    # stiff couplings go from the kicks to the flow; the order of all links stays
    model = request.integrator.arrange(model, stiffening.links, stiffening.bodies)
    start = Start.of(
        model, expected.start, stiffening.bodies, stiffening.rest, relaxed.temperature, request.seed,
        states_of(request.initial, model),
    )  # fmt: skip
    # half width of the band about contact whose flux is the contact rate; contact-free intervals stay out of it
    window = WINDOW * gap_scale(model, stiffening)
    start = replace(start, filters=filters_of(request.initial, model))
    steps = Steps.of(model, request, expected, start, window)
    # a contact-free interval of n steps must move bodies as n steps do, which it would not if damping and noise acted
    # at one moment of each step
    integrator = WholeFlow() if steps.jumping else request.integrator
    impacts = RigidImpacts.of(model, steps.step, request.seed, stiffening.energy)
    if isinstance(start.state, np.ndarray):
        impacts.check(model, start.state[0])
    elif start.state == "rest" and model.prescribed.any():
        impacts.check(model, with_given_motions(model, start.rest, -expected.spin_up))
    _warn(model, request, expected, steps, integrator, impacts)
    observed = _observed(model, request, steps, window)
    driving = Driving.of(model, ColouredNoises.of(model, integrator, steps.step, request.seed, request.coarse))
    # all batches but the last are multiples of this many steps: they end with a sample, if any, and with an interval
    grid = max(observed.every, steps.longest)
    clock = _clock(model, request, expected, steps, grid)
    series_bytes = driving.nbytes(integrator, clock.step, clock.all_steps)
    realizations = _realizations(model, request, clock, steps.jumping, series_bytes, grid)
    single = realizations.lanes == 1 and not steps.jumping  # loops over the bodies of one realization
    method = with_jumps(Method.of(model, integrator, steps.step), steps.jumps(model, start, window, request.seed))
    return Plan(
        system=System.of(model),
        forces=Forces.of(
            model, _may_close(model, request, stiffening), single=single, kick=steps.step if integrator.kicks else None
        ),
        method=method,
        noise=WhiteNoises.of(model, integrator, steps.step, request.seed, request.coarse),
        driving=driving,
        impacts=impacts,
        friction=DryFriction.of(model, steps.step),
        # sums of bodies at named places of structures; `closed` says between whose kicks nothing but white noise acts
        points=Points.of(model, method.flows, integrator.phases, driving.closed(method.groups), steps.step),
        start=start,
        clock=clock,
        realizations=realizations,
        observed=observed,
        subdomains=Subdomains.of(model, _contacts_reached(model, integrator) if single else 0),
    )


class Automatic(NamedTuple):
    """What is chosen for a run of which neither step nor spin-up are given."""

    step: float  # (s)
    spin_up: float  # (s)


def automatic(model: Model, request: Request) -> Automatic | None:
    """Return what would be chosen for a run, which takes a part of the time of a plan.

    None where that is more: contact-free intervals, couplings that flow, or a step to be measured.
    """
    request.integrator.check(model)
    request = request.resolved(model, usual_spin_up(model, request, start_of(request.initial, model))[0])
    expected = Expected.of(model, request)
    stiffening = expected.stiffening
    if request.integrator.arrange(model, stiffening.links, stiffening.bodies) is not model:
        return None
    start = Start.of(
        model, expected.start, stiffening.bodies, stiffening.rest, expected.relaxed.temperature, request.seed
    )
    steps = Steps.of(model, request, expected, start, WINDOW * gap_scale(model, stiffening))
    step = steps.step
    if steps.jumping:
        return None
    unsure = not certified(model, stiffening.penetration, step) or alike(model, expected.start, request.duration)
    if unsure and may_measure(model, request.integrator):
        return None
    if request.integrator.kicks:
        warn_of_kinks(model, stiffening, step, request.duration + expected.spin_up)
    return Automatic(step, expected.spin_up)


def _observed(model: Model, request: Request, steps: Steps, window: np.ndarray) -> Observed:
    """Return what is observed: records, which sample at ends of contact-free intervals, and what statistics need."""
    records, longest = request.records, steps.longest
    # rounded up to whole intervals, in a short run to one sample at its end; 0 for a record without samples
    strides = [min(-(-record.stride(model, steps.step) // longest) * longest, steps.number) for record in records]
    every = math.gcd(*strides, *(round(record.first_sample / steps.step) for record in records))
    left_out = _left_out(model, request)
    counted = steps.counted and "contact_rate" not in left_out
    peaks = any(record.peaks for record in records)
    read = peaks or "peak_contact_force" not in left_out
    rated = model.rated_contacts if read else np.zeros(len(model.ends), dtype=bool)
    disturbed = counted or (steps.counted and rated.any())  # what noise does within steps counts
    return Observed(
        records=tuple(
            (record, stride // every if every else 1) for record, stride in zip(records, strides, strict=True)
        ),
        every=every,
        window=window,
        counted=counted,
        jitter=jitter(model, steps.step, request.duration) if disturbed else np.zeros(len(model.ends)),
        rated=rated,
        peaked=bool(peaks and rated.any()),
        bodies=len(model.bodies),
        contacts=len(model.contacts),
        sampled=steps.sampled,
        left_out=left_out,
    )


def _left_out(model: Model, request: Request) -> frozenset[str]:
    """Return the statistics of contacts that are neither wanted nor needed for what is said of others.

    The time in contact tells in which units a contact closed, and so how wide the errors of rare events are, of bodies,
    too. Rates tell the same where units are few. Sums over bodies all serve their mean squares: balances of both are
    controls of every statistic.
    """
    if request.statistics is None:
        return frozenset()
    few = request.realizations < CLOSINGS or model.rigid.any()
    needed = {*request.statistics, "contact_ratio", *(["contact_rate"] if few else [])}
    of_contacts = {item.name for item in STATISTICS.values() if item.dimension == CONTACT}
    sampled = {item.name for item in sampled_of(CONTACT)} - {"contact_ratio"}
    if sampled & needed:  # they are summed together: any other choice would have machine code of its own
        needed |= sampled
    return frozenset(of_contacts - needed)


def _clock(model: Model, request: Request, expected: Expected, steps: Steps, grid: int) -> Clock:
    """Return the numbers of steps, and batches that end on multiples of `grid` steps."""
    relaxation, number = expected.relaxed.slowest, steps.number
    batches = batch_count(request.realizations, request.duration, relaxation)
    boundaries = [batch * number // batches // grid * grid for batch in range(1, batches)]
    return Clock(
        step=steps.step,
        spin_up_steps=steps.spin_up,
        steps=number,
        boundaries=(*sorted({end for end in boundaries if 0 < end < number}), number),
        relaxation=relaxation,
        settling=expected.settling,
        automatic=steps.automatic,
        certified=certified(model, expected.stiffening.penetration, steps.step),
    )


def _realizations(
    model: Model, request: Request, clock: Clock, jumping: bool, series_bytes: int, grid: int
) -> Realizations:
    """Return how realizations are grouped in blocks, and whether they are enough for standard errors.

    `series_bytes` is the memory of the time series of one realization.
    """
    number, workers = int(request.realizations), request.workers
    most = jump_lanes(model) if jumping else most_lanes(model, number, workers)
    lanes, steps_per_call = block_shape(model, number, workers, series_bytes, most)
    lengths = (np.diff([0, *clock.boundaries]) + grid) * clock.step  # before ends were rounded down, at most
    return Realizations(number, lanes, steps_per_call, enough_units(number, lengths, clock.relaxation), request.seed)


def _may_close(model: Model, request: Request, stiffening: Stiffening) -> np.ndarray:
    """Whether each contact may close during the run, (contact,) of bool; True where its rate is unknown."""
    with np.errstate(over="ignore"):
        closings = closing_rates(model, stiffening) * request.duration * request.realizations
    return ~(closings < NEGLIGIBLE_CLOSINGS)  # with >= an unknown rate, NaN, would count as none


def _contacts_reached(model: Model, integrator: Integrator) -> int:
    """Return how many contacts away a force is felt within a step; 0 where method or network allow no tiles."""
    return integrator.reach + model.passes if integrator.reach and not in_one_piece(model) else 0


def _warn(
    model: Model, request: Request, expected: Expected, steps: Steps, integrator: Integrator, impacts: RigidImpacts
) -> None:
    """Warn of noise bands that miss a natural frequency, of steps too long for kinks, of laws that jump in time, and of
    impacts that no step resolves.

    A given step that is too long is measured, which tells more.
    """
    warn_of_bands(model)
    if request.step is None and integrator.kicks:
        warn_of_kinks(model, expected.stiffening, steps.step, request.duration + expected.spin_up)
    for name in jumping_laws(model, -expected.spin_up, request.duration, steps.step) if model.timed.any() else ():
        warn(
            "jumping_force",
            f"The force of {name} jumps in time, each time up to half a step too early or too late, which may add up "
            "and is not measured; compare with a smaller step=.",
        )
    for contact in impacts.rigid.contacts[impacts.unresolved][:1]:
        name, order = model.contacts[contact], float(impacts.orders.min())
        warn(
            "small_impacts",
            f"contact_rate of {name!r} counts the impacts that the step of {steps.step:.3g} s resolves: noise and loss "
            f"make small ones so many that those it misses fall only with the step to the power of {order:.2g}.",
        )
