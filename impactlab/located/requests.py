"""Requests for runs without steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from impactlab.allowed_time import OutOfTime
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.build import digest
from impactlab.components.stored import stored
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.integrators.base import Integrator
from impactlab.located.earlier_runs import Earlier
from impactlab.located.event_located import EventLocated, check, linear_between_events
from impactlab.located.findings import Wanted, run_located
from impactlab.located.limits import LEAST_SECONDS, Watch, allowed_beside, too_long
from impactlab.located.rows_of_couplings import rows_of_couplings
from impactlab.memory_limits import available
from impactlab.plan.driving import check_ends
from impactlab.plan.request import Request
from impactlab.plan.start import realizations_of, start_of, states_of
from impactlab.records.record import Record
from impactlab.records.trajectory import Trajectory
from impactlab.results.stack import Findings
from impactlab.step_control.rules.expected import Expected, usual_spin_up

USUAL_BODIES, USUAL_CONTACTS = 50, 8
"""Bodies, and contacts with couplings that have events, up to which motion from event to event is usual: each set of
closed contacts has modes of its own, which take milliseconds."""

MOST_BYTES = 1e9
"""Memory of the samples of a trajectory up to which it is kept as a whole."""

COPIES_OF_SAMPLES = 4
"""How many times samples are in memory: of a path and of the one beside it, and twice while they are labelled."""

REASON = "integrator_reason"
"""Attribute that says why a method was chosen."""

LOCATED = "Chosen since nothing is random; path_error is its error. integrator=il.ExactFlow() makes equal steps."


def without_steps(
    model: Model, request: Request, steps: Callable[[], float] | None = None, earlier: Earlier | None = None
) -> Wanted:
    """Return the run that a request with `EventLocated` asks for; `steps` limits its time, see `Wanted`.

    It may go on from the end of an `earlier` run.
    """
    method = request.integrator
    assert isinstance(method, EventLocated)
    if request.step is not None:
        raise InvalidInput("EventLocated makes no steps; leave out step=, or use integrator=il.ExactFlow().")
    check(model, method)
    check_ends(model, request.duration + (0.0 if earlier is None else earlier.time))
    start, starts = start_of(request.initial, model), realizations_of(request.initial)
    if starts not in (1, request.realizations):
        raise InvalidInput(
            f"initial has the values of {starts} realizations, but there are to be {request.realizations}; give "
            f"realizations={starts}."
        )
    spin_up, automatic = usual_spin_up(model, request, start)
    if automatic and model.kicks.timed.any():  # the motion may grow without end, or settle slowly
        spin_up = Expected.of(model, request).spin_up
    records = request.resolved(model, spin_up).records
    _check_memory(model, records, starts, request.duration)
    request.intervals()
    options = replace(request, realizations=starts).options()
    options |= {} if earlier is None else {"continues": True}
    configuration = {"network": stored(model.network), "simulate": options, "text": digest(generate(model))}
    states = states_of(request.initial, model)
    states = model.members.states[:, None] if states is None else states
    return Wanted(
        model, method, start, starts, request.duration, spin_up, records, request.statistics, configuration, states,
        earlier, steps,
    )  # fmt: skip


def findings_of(wanted: Wanted, progress: Callable[[float], None], seconds: float = math.inf) -> Findings:
    """Return the findings of a run without steps that may take some time (s)."""
    (found,) = run_located([wanted], Watch(progress, seconds))
    if isinstance(found, ImpactLabError):
        raise found
    return found.findings()


def chooses(integrator: Integrator | None, step: Any = None, tolerance: Any = None) -> bool:
    """Whether the method of a run is chosen, since nothing that is given asks for steps or a method."""
    return integrator is None and step is None and tolerance is None


def usual_run(model: Model, request: Request, steps: Callable[[], float]) -> Wanted | str:
    """Return the run from event to event that a request without a method has; or why it has steps, "" under noise.

    `steps` returns the time of one core that steps would take (s).
    """
    if model.random.any():
        return ""
    if reason := _too_large(model):
        return reason
    try:
        run = without_steps(model, replace(request, integrator=EventLocated()), steps)
        run.alike  # noqa: B018  # which refuses records, and numbers of networks
    except ImpactLabError as error:
        return reason_of_steps(error)
    if run.sampled_bytes > MOST_BYTES:
        return f"EventLocated keeps a trajectory as a whole, of {run.sampled_bytes / 1e9:.2g} GB here."
    least = run.least_seconds()
    if least > LEAST_SECONDS and least > (allowed := allowed_beside(steps())):
        return too_long(allowed)
    return run


def usual_findings(
    model: Model, request: Request, steps: Callable[[], float], progress: Callable[[float], None], seconds: float
) -> tuple[Findings | None, str]:
    """Return the findings of a request without a method, None where it has steps; and why the method was chosen."""
    run = usual_run(model, request, steps)
    if isinstance(run, str):
        return None, run
    try:
        return findings_of(run, progress, seconds), LOCATED
    except OutOfTime:
        raise
    except ImpactLabError as error:
        return None, reason_of_steps(error)


def findings_without_steps(
    model: Model, request: Request, steps: Callable[[], float] | None, progress: Callable[[float], None], seconds: float
) -> tuple[Findings | None, str]:
    """Return the findings of a run without steps, None where it has steps; and why, where the method is chosen.

    It is chosen where `steps` returns the time of one core that steps would take (s).
    """
    if not request.integrator.makes_steps:
        return findings_of(without_steps(model, request), progress, seconds), ""
    return (None, "") if steps is None else usual_findings(model, request, steps, progress, seconds)


def reason_of_steps(error: ImpactLabError) -> str:
    """Return why there are steps, from the error of a run from event to event, without its advice."""
    return str(error).partition("; ")[0].rstrip(".") + "."


def explained(found: Findings, reason: str) -> Findings:
    """Return findings that say why their method was chosen, if it was."""
    if not reason:
        return found
    text = reason if reason == LOCATED else f"Steps were made, though nothing is random: {reason}"
    return found._replace(attributes={**found.attributes, REASON: text})


def _check_memory(model: Model, records: Sequence[Record], realizations: int, duration: float) -> None:
    """Refuse trajectories that do not fit into memory, where they are kept as a whole."""
    numbers = 2 * len(model.bodies) + len(model.ends) + len(model.kicks.states)
    for record in records:
        if isinstance(record, Trajectory):
            samples = max(duration - record.start, 0.0) / record.interval + 1.0
            needed, there = 8.0 * COPIES_OF_SAMPLES * realizations * samples * numbers, available()
            if needed > there:
                raise InvalidInput(
                    f"The trajectories would take {needed / 1e9:.3g} GB of memory, in which EventLocated keeps them as "
                    f"a whole, but {there / 1e9:.3g} GB are available; use a longer interval or fewer realizations, or "
                    "write them to a file by integrator=il.ExactFlow() with out=."
                )


def _too_large(model: Model) -> str:
    """Say why a network is too large for motion from event to event to be usual, or return ""."""
    bodies, contacts = len(model.bodies), len(model.contacts.names) + len(rows_of_couplings(model).names)
    if bodies > USUAL_BODIES:
        return f"with more than {USUAL_BODIES} bodies they take less time, and there are {bodies}."
    if contacts > USUAL_CONTACTS and linear_between_events(model):
        return f"with more than {USUAL_CONTACTS} contacts and kinks they take less time, and there are {contacts}."
    return ""
