"""An accuracy instead of a duration: how many realizations, and at which step."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import xarray as xr

from impactlab.allowed_time import allowed_time
from impactlab.assembly.mechanism import Mode, refusing
from impactlab.assembly.model import Model
from impactlab.compiling.announced import announced
from impactlab.errors import InvalidInput, noted, warn
from impactlab.inputs import finite, positive, suggestion
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow, FineFlow
from impactlab.linear.damping import damped
from impactlab.linear.decay import relaxation_time
from impactlab.linear.laws import linear_variances
from impactlab.plan.clock import BATCHES, LENGTH
from impactlab.plan.request import Request
from impactlab.plan.start import realizations_of
from impactlab.progress import reporter
from impactlab.records.trajectory import PairedRealizations, PerRealization
from impactlab.results.schema import EVERY, OF_POINTS, OF_STATES, STATISTICS, unwanted, variables
from impactlab.results.stack import Findings
from impactlab.results.warned import by_kind, with_warnings
from impactlab.step_control.rules.relaxation import undamped
from impactlab.step_control.tolerance.pairs import (
    EnsembleOf,
    Errors,
    GrowingEnsemble,
    Numbers,
    Report,
    Trial,
    order_of,
    within,
)

PAIRS = 128
"""Pairs that tell how many realizations and pairs there must be."""

PILOT = 2 * PAIRS
"""Realizations that tell this; only those in pairs where they may well tell that the step is too large, since a small
order leaves much of the difference to the bias."""

MORE_PAIRS = 3.0
"""Factor from which on more pairs are run first, since a better bias changes the number of realizations."""

LEAST_ADDED = 1.1
"""Least factor by which realizations are added, so that a run does not end as soon as its errors happen to be small."""

MOST_UNKNOWN = 3
"""How often realizations are added that cannot tell yet how many are enough."""

MOST_ADDED = 8.0
"""Most factor by which pairs are added at once: few tell too little of how many there must be."""

HALVINGS = 6
"""How often the step is halved at most."""

TELLING = 4.0
"""Factor by which more pairs tell whether to halve the step, and more realizations how many are enough."""

CHEAP = 0.15
"""Part of all the work up to which these pairs are worth it."""

SECONDS = 600.0
"""Time that may be spent to reach a tolerance, unless it is given (s)."""


def checked(tolerance: Any, model: Model) -> dict[str, float]:
    """Return the tolerances by the name of the statistic.

    A tolerance is refused if it is not positive, or its statistic is unknown, has no error bar, or has no stationary
    value in this network.
    """
    if not isinstance(tolerance, Mapping) or not tolerance:
        raise InvalidInput(f'tolerance must be like {{"mean_square_displacement": 1e-3}}, not {tolerance!r}.')
    for name, value in tolerance.items():
        known = STATISTICS | OF_POINTS if model.points else STATISTICS
        if name in OF_STATES:
            raise InvalidInput(
                f"tolerance: {name} has states beside each other that may be 0 or grow; name a statistic of bodies or "
                "contacts, or give duration= instead."
            )
        if name not in known:
            raise InvalidInput(f"tolerance: there is no statistic {name!r}; {suggestion(name, known)}")
        if not known[name].stationary:
            raise InvalidInput(
                f"tolerance: {name} grows with the observation time; name another statistic, or give duration= instead."
            )
        if not 0.0 < finite(f"tolerance of {name}", value) <= 1.0:
            raise InvalidInput(f"tolerance of {name} must be larger than 0 and at most 1, not {value!r}.")
    _refuse_drifting(tuple(tolerance), model)
    return {name: float(value) for name, value in tolerance.items()}


def _refuse_drifting(names: tuple[str, ...], model: Model) -> None:
    """Refuse statistics that have no stationary value, or none but 0."""
    heated = linear_variances(model)[1]
    if not heated.any():
        raise InvalidInput("tolerance: nothing is excited by noise, so every statistic is 0; give duration=.")
    growing = undamped(model)
    for body, name in enumerate(model.bodies.names):
        if growing[body]:
            raise InvalidInput(
                f"tolerance: {name!r} is excited but not damped, so it has no stationary state; give duration=."
            )
        held = model.stiffness[body] > 0.0 or model.kicks.nonlinear[body]
        if not held and any(EVERY[item].held for item in names):
            raise InvalidInput(
                f"tolerance: nothing confines {name!r}, so its displacement has no stationary value; give duration=."
            )


def method_for(model: Model, method: Integrator) -> Integrator:
    """Return the method that has the least bias for its work where the bias is to be small.

    Friction and noise that act at one moment of a step save time, but have an error of second order.
    """
    if type(method) is ExactFlow and not refusing(model, Mode.FINE_FLOW):
        return FineFlow(jumps=method.jumps, measured=method.measured)
    return method


def reach(
    ensemble_of: EnsembleOf, tolerance: dict[str, float], max_seconds: float, request: Request, report: Report
) -> xr.Dataset:
    """Add realizations until the errors are within a tolerance, or the time is over.

    Pairs of realizations, at a step h and, with the same noise, at 2h, tell the bias of the step. A pilot of them
    foresees how many pairs and realizations are enough with the least work, or that half the step is better. They are
    added to those that there are: the result is that of one run with all of them. It is good enough when
    ``|bias| + 2 standard errors ≤ tolerance |value|`` for every label, where the standard error has that of the bias in
    it; a mean that may be 0 counts as its root mean square. What was reached when the time is over is returned, too,
    with a warning.

    Parameters
    ----------
    ensemble_of : callable
        Plans realizations.
    tolerance : dict of str to float
        By the name of the statistic.
    max_seconds : float
        Time that may be spent (s).
    request : Request
        The step that is wanted, if one is, and how many realizations there are to be at least.
    report : callable
        Takes the part of the work that is done, as far as it is foreseen: 0 until the end of the pilot.
    """
    begin = time.monotonic()
    report(0.0)
    trial = _pilot(ensemble_of, tolerance, request, max_seconds)
    rounds, halvings, unknown, most = 1, 0, 0, math.inf
    while (errors := trial.errors(tolerance)).worst > 1.0:
        spent = time.monotonic() - begin
        left = max_seconds - spent
        more = _halvings(trial, errors, HALVINGS - halvings)
        if more and 2.0**more * trial.seconds(trial.planned) < left:
            halvings += more
            trial = Trial(ensemble_of, int(trial.planned.fine), int(trial.planned.pairs), trial.step / 2.0**more)
            trial.grow(trial.planned, lambda share: None)
        else:
            unknown += not math.isfinite(errors.wanted(trial.has).fine)
            stage, goal = _next(trial, errors, left, most)
            if unknown > MOST_UNKNOWN or stage == trial.has:
                break
            total = spent + min(trial.missing(goal), left)
            try:
                trial.grow(stage, within(report, spent / total, (spent + trial.missing(stage)) / total))
            except InvalidInput:  # there is no memory for so many
                most = 0.5 * (trial.has.fine + stage.fine)
        rounds += 1
    report(1.0)
    trial.repeat_warnings()
    if errors.worst > 1.0:
        warn("tolerance", _missed(trial, errors, time.monotonic() - begin))
    attributes = {"error_over_tolerance": errors.worst, "attempts": rounds, "seconds_spent": time.monotonic() - begin}
    return _labelled(trial, tolerance, attributes)


def _pilot(ensemble_of: EnsembleOf, tolerance: dict[str, float], request: Request, max_seconds: float) -> Trial:
    """Run the first pairs; fewer where the time does not allow for as many, and none is refused."""
    for number, pairs in ((PILOT, PAIRS), (BATCHES, BATCHES // 2)):
        with allowed_time(max_seconds):  # to plan
            trial = Trial(ensemble_of, max(number, request.realizations), pairs, request.step)
        if trial.coarse and min(order_of(trial.fine.plan, name) for name in tolerance) < 4:
            trial.planned = Numbers(max(pairs, request.realizations), pairs)
        foreseen = trial.foreseen()
        if foreseen <= max_seconds:
            trial.grow(trial.planned, lambda share: None)
            return trial
    raise InvalidInput(
        f"{trial.fine.plan.announced(foreseen)} with {trial.planned.pairs} at twice the step, but {max_seconds:.2g} s "
        "are left. Give a larger max_seconds=, or a shorter duration= or spin_up=."
    )


def _halvings(trial: Trial, errors: Errors, most: int) -> int:
    """Return how often to halve the step, at most: where that is cheaper than more realizations.

    The halving must pay for a bias that is two standard errors smaller or, where further pairs would cost too much to
    decide it, one standard error larger.
    """
    if not errors.alike:
        return min(1, most)
    surely, _ = trial.cheapest(errors.moved(-2.0), most)
    likely, seconds = trial.cheapest(errors.moved(1.0), most)
    pairs = TELLING * trial.has.pairs
    dear = trial.missing(Numbers(max(trial.has.fine, pairs), pairs)) > CHEAP * seconds
    return surely or likely * dear


def _next(trial: Trial, errors: Errors, left: float, most: float) -> tuple[Numbers, Numbers]:
    """Return the numbers that are to be run next, and those that are foreseen to be enough.

    First more pairs, if there are to be many: they may tell that fewer are enough, or another step is better. Else as
    many as the time that is left (s) and the memory allow; no more than there are where it is not worth while.
    """
    has, goal = trial.has, errors.wanted(trial.has)
    if goal.fine == math.inf:
        goal = Numbers(TELLING * has.fine, TELLING * has.pairs)
    goal = Numbers(max(goal.fine, LEAST_ADDED * has.fine), goal.pairs)
    if goal.pairs > MORE_PAIRS * has.pairs:
        pairs = min(goal.pairs, MOST_ADDED * has.pairs)
        first = Numbers(max(has.fine, pairs), pairs)
        if trial.missing(first) < left and first.fine < most:
            return first, goal
    share = min(max(left, 0.0) / trial.missing(goal), (most - has.fine) / (goal.fine - has.fine))
    if share < 1.0:
        stage = Numbers(*(have + share * (number - have) for have, number in zip(has, goal, strict=True)))
        return stage if stage.fine >= LEAST_ADDED * has.fine else has, goal
    return goal, goal


def _missed(trial: Trial, errors: Errors, spent: float) -> str:
    """Say by how much a tolerance was missed in the given time (s), and how long it would take."""
    needed = trial.missing(errors.wanted(trial.has))
    name = errors.names[int(errors.excess.argmax())] if len(errors.names) else "forces"
    times = f"about {needed:.2g} s more" if math.isfinite(needed) else "more time than can be foreseen"
    return (
        f"The tolerance was not reached in {spent:.2g} s: the error of {name} is up to {errors.worst:.3g} times as "
        f"large. It would take {times}; give a larger tolerance= or max_seconds=."
    )


def without_realizations(dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset without what each realization gave."""
    names = [variable.by_realization for variable in variables().values()]
    dataset = dataset.drop_vars(names, errors="ignore")
    unused = "realization" not in {dim for item in dataset.data_vars.values() for dim in item.dims}
    return dataset.drop_dims("realization") if unused and "realization" in dataset.dims else dataset


def _labelled(trial: Trial, tolerance: dict[str, float], attributes: dict[str, Any]) -> xr.Dataset:
    """Return the dataset with the biases, which stand beside the standard errors: these do not allow for them."""
    dataset = trial.dataset
    for name in tolerance:
        attrs = {
            **dataset[name].attrs,
            "long_name": f"estimated bias of the step in {dataset[name].attrs['long_name']}",
        }
        attrs.pop("ancillary_variables", None)
        dataset[f"{name}_bias"] = trial.biases[name].dims, trial.biases[name].values, attrs
    text = ", ".join(f"{name}: {value:g}" for name, value in tolerance.items())
    return dataset.assign_attrs(tolerance=text, **attributes)


def length_of(model: Model, duration: float | None) -> float:
    """Return the length of the realizations, no longer than a duration (s) if there is one."""
    longest = math.inf if duration is None else positive("duration", duration)
    return min(longest, LENGTH * relaxation_time(damped(model)[1]))


def simulate_to(
    tolerance: dict[str, float],
    seconds: float | None,
    model: Model,
    request: Request,
    ensemble_of: Callable[[Model, Request], GrowingEnsemble],
    progress: bool | Callable[[float], None] | None,
) -> xr.Dataset:
    """Return the dataset of an ensemble that grows until a tolerance is reached or its time has passed.

    `ensemble_of` makes the ensemble of a request, at its step.
    """
    if realizations_of(request.initial) > 1:
        raise InvalidInput(
            "With a tolerance the number of realizations is not known before, so that none can have a start of its "
            "own; give duration= without a tolerance."
        )
    wanted = request.statistics
    wanted = None if wanted is None else tuple(dict.fromkeys((*wanted, *tolerance)))
    asked = any(isinstance(item, PerRealization) for item in request.records)
    kept = request.records if asked else [*request.records, PairedRealizations()]
    method = method_for(model, request.integrator)
    request = replace(request, integrator=method, records=kept, statistics=wanted)

    def ensemble(number: int, chosen: float | None, coarse: bool) -> GrowingEnsemble:
        return ensemble_of(model, replace(request, realizations=number, step=chosen, coarse=coarse))

    with announced(progress), noted() as given:
        result = reach(ensemble, tolerance, SECONDS if seconds is None else seconds, request, reporter(progress))
    result = with_warnings(Findings.of(result), by_kind(given)).dataset() if given else result
    result = result if wanted is None else result.drop_vars(unwanted(wanted), errors="ignore")
    return result if asked else without_realizations(result)
