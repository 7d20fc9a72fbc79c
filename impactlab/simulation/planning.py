"""The plan of a run: start, spin-up, step, batches and blocks, chosen from the network and the request."""

from __future__ import annotations

import math

import numpy as np

from impactlab.assembly.model import Model
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import WholeFlow
from impactlab.integrators.intervals import in_one_piece, jump_lanes
from impactlab.nonlinear.closings import jitter
from impactlab.nonlinear.relaxation import closing_rates
from impactlab.nonlinear.tangent_stiffness import Stiffening, gap_scale
from impactlab.plan.clock import Clock, batch_count, enough_units
from impactlab.plan.driving import Driving, warn_of_bands
from impactlab.plan.forces import Forces
from impactlab.plan.method import Method
from impactlab.plan.noise import WhiteNoises
from impactlab.plan.observed import WINDOW, Observed
from impactlab.plan.plan import Plan
from impactlab.plan.points import Points
from impactlab.plan.realizations import Realizations, block_shape, most_lanes
from impactlab.plan.start import Start
from impactlab.plan.subdomains import Subdomains
from impactlab.plan.system import System
from impactlab.simulation.expected import Expected
from impactlab.simulation.request import Request
from impactlab.simulation.steps import Steps
from impactlab.step_size.certified import certified
from impactlab.step_size.kinks import warn_of_kinks

NEGLIGIBLE_CLOSURES = 1e-3
"""Expected number of closures in a run below which a contact is treated as never closing."""


def make_plan(model: Model, request: Request) -> Plan:
    """Make the plan of a run. A request that cannot be met is refused, with a cure.

    Where the error of the step is measured before the run, there is a plan for each step that is tried.
    """
    request.integrator.check(model)
    request = request.resolved(model)
    expected = Expected.of(model, request)
    # tangent stiffnesses and penetrations at the energies that are expected, and relaxation times
    stiffening, relaxed = expected.stiffening, expected.relaxed
    # stiff couplings go from the kicks to the flow; the order of all links stays
    model = request.integrator.arrange(model, stiffening.links, stiffening.bodies)
    start = Start.of(model, expected.start, stiffening.bodies, stiffening.rest, relaxed.temperature, request.seed)
    # half width of the band of indentations in which contact rates are a flux; contact-free intervals stay out of it
    window = WINDOW * gap_scale(model, stiffening.penetration)
    steps = Steps.of(model, request, expected, start, window)
    # an interval of n steps must move bodies as n steps do, so that friction must not act at one moment of each
    integrator = WholeFlow() if steps.jumping else request.integrator
    _warn(model, request, expected, steps, integrator)
    observed, driving = _observed(model, request, steps, window), Driving.of(model)
    # batches are multiples of this many steps: they end with a sample, if there are any, and with an interval
    grid = max(observed.every, steps.longest)
    clock = _clock(model, request, expected, steps, grid)
    series = driving.nbytes(integrator, clock.step, clock.all_steps)
    realizations = _realizations(model, request, clock, steps.jumping, series, grid)
    single = realizations.lanes == 1 and not steps.jumping  # one realization a block: loops over its bodies
    method = Method.of(model, integrator, steps.step, steps.jumps(model, start, window, request.seed))
    return Plan(
        system=System.of(model),
        forces=Forces.of(
            model, _may_close(model, request, stiffening), single=single, kick=steps.step if integrator.kicks else None
        ),
        method=method,
        noise=WhiteNoises.of(model, integrator, steps.step, request.seed, request.coarse),
        driving=driving,
        points=Points.of(
            model, method.flows, integrator.phases, driving.closed(method.groups, len(model.bodies)), steps.step
        ),
        start=start,
        clock=clock,
        realizations=realizations,
        observed=observed,
        subdomains=Subdomains.of(model, _contacts_reached(model, integrator) if single else 0),
    )


def _observed(model: Model, request: Request, steps: Steps, window: np.ndarray) -> Observed:
    """Return the sums and records; records sample at ends of contact-free intervals."""
    records, longest = request.records, steps.longest
    # rounded up to whole intervals, in a short run to one sample at its end; 0 for a record without samples
    strides = [min(-(-record.stride(model, steps.step) // longest) * longest, steps.number) for record in records]
    every = math.gcd(*strides)
    no_jitter = np.zeros(len(model.ends))
    return Observed(
        records=tuple(
            (record, stride // every if every else 1) for record, stride in zip(records, strides, strict=True)
        ),
        every=every,
        window=window,
        counted=steps.counted,
        jitter=jitter(model, steps.step, request.duration) if steps.counted else no_jitter,
        bodies=len(model.bodies),
        contacts=len(model.contacts),
        sampled=steps.sampled,
    )


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


def _realizations(model: Model, request: Request, clock: Clock, jumping: bool, series: int, grid: int) -> Realizations:
    """Return how realizations are grouped in blocks; `series` is the memory of the time series of one (bytes)."""
    number, workers = int(request.realizations), request.workers
    most = jump_lanes(model) if jumping else most_lanes(model, number, workers)
    lanes, steps_per_call = block_shape(model, number, workers, series, most)
    batches = (np.diff([0, *clock.boundaries]) + grid) * clock.step
    return Realizations(number, lanes, steps_per_call, enough_units(number, batches, clock.relaxation), request.seed)


def _may_close(model: Model, request: Request, stiffening: Stiffening) -> np.ndarray:
    """Whether each contact may close during the run, (contact,) of bool; True where its rate is unknown."""
    with np.errstate(over="ignore"):
        closures = closing_rates(model, stiffening) * request.duration * request.realizations
    return ~(closures < NEGLIGIBLE_CLOSURES)  # not >=, by which an unknown rate, NaN, would be none


def _contacts_reached(model: Model, integrator: Integrator) -> int:
    """Number of contacts that a force reaches in a step; 0 where more than forces of contacts acts between bodies."""
    return integrator.reach + model.passes if integrator.reach and not in_one_piece(model) else 0


def _warn(model: Model, request: Request, expected: Expected, steps: Steps, integrator: Integrator) -> None:
    """Warn of noise bands that miss a natural frequency, and of a step too long for kinks of the force."""
    warn_of_bands(model)
    if request.step is None and integrator.kicks:
        warn_of_kinks(model, expected.stiffening, steps.step, request.duration + expected.spin_up)
