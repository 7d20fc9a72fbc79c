"""Requests for runs without steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.build import digest
from impactlab.components.stored import stored
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.located.event_located import EventLocated, check
from impactlab.located.findings import Wanted, run_located
from impactlab.plan.driving import check_ends
from impactlab.plan.request import Request
from impactlab.plan.start import realizations_of, start_of, states_of
from impactlab.results.stack import Findings
from impactlab.step_control.rules.expected import usual_spin_up


def without_steps(model: Model, request: Request) -> Wanted:
    """Return the run that a request with `EventLocated` asks for."""
    method = request.integrator
    assert isinstance(method, EventLocated)
    if request.step is not None:
        raise InvalidInput("EventLocated makes no steps; leave out step=, or use integrator=il.ExactFlow().")
    check(model, method)
    check_ends(model, request.duration)
    start, starts = start_of(request.initial, model), realizations_of(request.initial)
    if starts not in (1, request.realizations):
        raise InvalidInput(
            f"initial has the values of {starts} realizations, but there are to be {request.realizations}; give "
            f"realizations={starts}."
        )
    spin_up = usual_spin_up(model, request, start)[0]
    records = request.resolved(model, spin_up).records
    request.intervals()
    options = _plain(replace(request, realizations=starts).options())
    configuration = {"network": stored(model.network), "simulate": options, "text": digest(generate(model))}
    states = states_of(request.initial, model)
    states = model.members.states[:, None] if states is None else states
    return Wanted(
        model, method, start, starts, request.duration, spin_up, records, request.statistics, configuration, states
    )


def findings_without_steps(model: Model, request: Request, progress: Callable[[float], None]) -> Findings:
    """Return the findings of a run without steps."""
    (found,) = run_located([without_steps(model, request)], progress)
    if isinstance(found, ImpactLabError):
        raise found
    return found.findings()


def _plain(value: Any) -> Any:
    """Return options as JSON can hold them, without numbers of NumPy."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value
