"""The plan of a run, chosen from the network and the request: batches and blocks, and what follows from the rest.

Spin-up and start are chosen in `impactlab.step_control.rules.expected`, and the step in
`impactlab.step_control.rules.steps`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from impactlab.assembly.mechanism import Mode, check_method, refusing
from impactlab.assembly.model import Model
from impactlab.errors import warn
from impactlab.integrators.exact_flow import WholeFlow
from impactlab.integrators.intervals import jump_lanes
from impactlab.linear.given_functions import jumping_laws
from impactlab.machine import uncollected
from impactlab.plan.clock import Clock, batch_count, enough_units
from impactlab.plan.driving import Driving
from impactlab.plan.events import Events
from impactlab.plan.forces import Forces
from impactlab.plan.jumping import with_jumps
from impactlab.plan.method import Method
from impactlab.plan.noise import WhiteNoises
from impactlab.plan.observed import Observed
from impactlab.plan.plan import Plan, System
from impactlab.plan.realizations import Realizations
from impactlab.plan.request import Request
from impactlab.plan.start import Start
from impactlab.plan.structure_points import Points
from impactlab.plan.subdomains import Subdomains
from impactlab.results.schema import CONTACT, STATISTICS, sampled_of
from impactlab.statistics.rare import CLOSINGS
from impactlab.step_control.measured.measured_step import may_measure
from impactlab.step_control.rules.automatic import alike, certified
from impactlab.step_control.rules.closings import jitter
from impactlab.step_control.rules.expected import Expected
from impactlab.step_control.rules.kinks import warn_of_kinks
from impactlab.step_control.rules.relaxation import closing_rates
from impactlab.step_control.rules.steps import Steps

NEGLIGIBLE_CLOSINGS = 1e-3
"""Expected number of closings in a run below which a contact is taken never to close, and its statistics are 0."""


@uncollected()
def make_plan(model: Model, request: Request) -> Plan:
    """Make the plan of a run. A request that cannot be met is refused, with a cure.

    Where the bias of the step is measured before the run, there is a plan for each step that is tried.
    """
    check_method(model, request.integrator)
    expected = Expected.of(model, request)
    if request.records:
        request = request.resolved(model, expected.usual_spin_up)
    # tangent stiffnesses and penetrations at the energies that are expected, and relaxation times
    stiffening, relaxed = expected.stiffening, expected.relaxed
    # stiff couplings go from the kicks to the flow; the order of all links stays
    model = request.integrator.arrange(model, stiffening.links, stiffening.bodies)
    start = Start.of(
        model, expected.start, (stiffening.couplings, stiffening.bodies), stiffening.rest, relaxed.temperature,
        request.seed, request.initial, -expected.spin_up,
    )  # fmt: skip
    steps = Steps.of(model, request, expected, start)
    jumps = steps.jumps(model, start, request.seed) if steps.jumping else None
    # a contact-free interval of n steps must move bodies as n steps do, which it would not if damping and noise acted
    # at one moment of each step
    integrator = WholeFlow() if steps.jumping else request.integrator
    observed = _observed(model, request, steps)
    if request.step is None and integrator.kicks:  # a given step that is too long is measured, which tells more
        warn_of_kinks(model, stiffening, steps.step, request.duration + expected.spin_up)
    # all batches but the last are multiples of this many steps: they end with a sample, if any, and with an interval
    grid = max(observed.every, steps.longest)
    clock = _clock(request, expected, steps, grid, certified(model, stiffening.penetration, steps.step))
    may_close = _may_close(request, closing_rates(model, stiffening))
    events = Events.of(model, steps.step, request.seed, stiffening.energy)
    if start.known is not None:
        for part in events.parts:
            part.check(model, start.known)
    driving = Driving.of(model, integrator, steps.step, request.seed, request.coarse)
    method = Method.of(model, integrator, steps.step)
    if jumps is not None:
        method = with_jumps(method, jumps)
    system, number = System.of(model), int(request.realizations)
    lengths = (np.diff([0, *clock.boundaries]) + grid) * clock.step  # before ends were rounded down, at most
    realizations = Realizations.in_blocks(
        model, number, request.workers, request.seed, driving.nbytes(integrator, clock.step, clock.all_steps),
        enough_units(number, lengths, clock.relaxation), jump_lanes(len(model.bodies)) if steps.jumping else 0,
    )  # fmt: skip
    realizations = replace(realizations, keep=request.on_divergence == "keep")
    # loops over the bodies of one realization
    single = realizations.lanes == 1 and not steps.jumping and Mode.ONE_LANE not in system.refusals
    single = single and method.pays_for_one_lane(len(model.mass) * clock.all_steps)
    tiled = single and integrator.reach and Mode.TILES not in system.refusals
    jumping = jumping_laws(model, -expected.spin_up, request.duration, steps.step) if model.kicks.timed.any() else ()
    _warn(jumping, [item for part in events.parts for item in part.doubts(model.contacts.names, steps.step)])
    return Plan(
        system=system,
        forces=Forces.of(model, may_close, single=single, kick=steps.step if integrator.kicks else None),
        method=method,
        noise=WhiteNoises.of(model, integrator, steps.step, request.seed, request.coarse),
        driving=driving,
        events=events,
        # sums of bodies at named places of structures; `closed` says between whose kicks nothing but white noise acts
        points=Points.of(model, method.flows, integrator.phases, driving.closed(method.groups), steps.step),
        start=start,
        clock=clock,
        realizations=replace(realizations, by_body=single),
        observed=observed,
        # as many contacts away as a force is felt within a step
        subdomains=Subdomains.of(model, integrator.reach + model.kicks.passes) if tiled else Subdomains(0, ()),
    )


class Automatic(NamedTuple):
    """Step and spin-up of a run in which neither is given."""

    step: float  # (s)
    spin_up: float  # (s)


def automatic(model: Model, request: Request) -> Automatic | None:
    """Return the step and spin-up of a run without making the whole plan.

    The result is None where a plan would choose more (contact-free intervals, or a measured step), or where a mechanism
    runs alone.
    """
    check_method(model, request.integrator)
    expected = Expected.of(model, request)
    request = request.resolved(model, expected.usual_spin_up)
    stiffening = expected.stiffening
    if refusing(request.integrator.arrange(model, stiffening.links, stiffening.bodies), Mode.SIDE_BY_SIDE):
        return None
    start = Start.of(
        model, expected.start, (stiffening.couplings, stiffening.bodies), stiffening.rest, expected.relaxed.temperature,
        request.seed, request.initial, -expected.spin_up,
    )  # fmt: skip
    steps = Steps.of(model, request, expected, start)
    step = steps.step
    if steps.jumping:
        return None
    unsure = not certified(model, stiffening.penetration, step) or alike(model, expected.start, request.duration)
    if unsure and may_measure(model, request.integrator):
        return None
    if request.integrator.kicks:
        warn_of_kinks(model, stiffening, step, request.duration + expected.spin_up)
    return Automatic(step, expected.spin_up)


def _observed(model: Model, request: Request, steps: Steps) -> Observed:
    """Return records, aligned with the ends of contact-free intervals, and the sums that statistics need."""
    records, longest = request.records, steps.longest
    # rounded up to whole intervals, in a short run to one sample at its end; 0 for a record without samples
    strides = [min(-(-record.stride(model, steps.step) // longest) * longest, steps.number) for record in records]
    every = math.gcd(*strides, *(round(record.first_sample / steps.step) for record in records))
    wanted = request.statistics
    left_out = frozenset() if wanted is None else _left_out(wanted, request.realizations, model.contacts.impulsive)
    counted = steps.counted and "contact_rate" not in left_out
    peaks = any(record.peaks for record in records)
    read = peaks or "peak_contact_force" not in left_out
    rated = model.kicks.rated if read else np.zeros(len(model.ends), dtype=bool)
    disturbed = counted or (steps.counted and rated.any())  # what noise does within steps counts
    return Observed(
        records=tuple(
            (record, stride // every if every else 1) for record, stride in zip(records, strides, strict=True)
        ),
        every=every,
        window=steps.window,
        counted=counted,
        jitter=jitter(model, steps.step, request.duration) if disturbed else np.zeros(len(model.ends)),
        rated=rated,
        peaked=bool(peaks and rated.any()),
        bodies=len(model.bodies),
        contacts=len(model.ends),
        sampled=steps.sampled,
        left_out=left_out,
        ends=wanted is None and bool(records) and all(record.ends_run for record in records),
        kicked=request.integrator.kicks and any(record.kicks for record in records),
        told=any(record.impacts for record in records),
    )


def _left_out(wanted: Sequence[str], realizations: int, impulsive: np.ndarray) -> frozenset[str]:
    """Return the statistics of contacts that are neither wanted nor needed for what is said of others.

    Rates are needed where contacts are `impulsive`, (contact,) of bool. The time in contact tells in which units a
    contact closed, and so how wide the errors of rare events are, of bodies, too. Rates tell the same where units are
    few. Sums over bodies all serve their mean squares: balances of both are controls of every statistic.
    """
    few = realizations < CLOSINGS or impulsive.any()
    needed = {*wanted, "contact_ratio", *(["contact_rate"] if few else [])}
    of_contacts = {item.name for item in STATISTICS.values() if item.dimension == CONTACT}
    sampled = {item.name for item in sampled_of(CONTACT)} - {"contact_ratio"}
    if sampled & needed:  # they are summed together
        needed |= sampled
    return frozenset(of_contacts - needed)


def _clock(request: Request, expected: Expected, steps: Steps, grid: int, certified: bool) -> Clock:
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
        certified=certified,
    )


def _may_close(request: Request, rates: np.ndarray) -> np.ndarray:
    """Whether each contact may close during the run, (contact,) of bool; True where its rate (s-1) is unknown."""
    duration = math.inf if request.endless else request.duration
    with np.errstate(over="ignore", invalid="ignore"):
        closings = rates * duration * request.realizations
    return ~(closings < NEGLIGIBLE_CLOSINGS)  # with >= an unknown rate, NaN, would count as none


def _warn(jumping: Iterable[str], doubts: Iterable[tuple[str, str]]) -> None:
    """Warn of laws that jump in time, given by name, and of doubts about events, given by kind and message."""
    for name in jumping:
        warn(
            "jumping_force",
            f"The force of {name} jumps in time, each time up to half a step too early or too late, which may add up "
            "and is not measured; compare with a smaller step=.",
        )
    for kind, message in doubts:
        warn(kind, message)
