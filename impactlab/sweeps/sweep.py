"""Sweeps: simulations over a product of values as one labelled dataset.

Points that differ in numbers only run side by side in one compiled run. What a point finds never depends on the other
points, nor on where it runs: an automatic step and spin-up are rounded to numbers of steps from which many points can
choose the same, and each point is then what `impactlab.simulate` gives for it at this step and spin-up, bit for bit.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import xarray as xr

import impactlab
from impactlab.assembly.mechanism import Mode, refusing
from impactlab.assembly.model import Model
from impactlab.compiling.announced import announced
from impactlab.errors import ImpactLabError
from impactlab.inputs import checked
from impactlab.located.event_located import EventLocated
from impactlab.located.findings import Traced, Wanted, run_located
from impactlab.located.requests import LOCATED, chooses, explained, reason_of_steps, usual_run, without_steps
from impactlab.machine import begin, uncollected
from impactlab.plan.request import Request
from impactlab.plan.seed import seed_of
from impactlab.plan.side_by_side import Planned
from impactlab.progress import reporter
from impactlab.results.checkpoint import Checkpoint
from impactlab.results.plain_values import digest, plain_data
from impactlab.results.stack import Findings, Shared
from impactlab.results.warned import by_kind, with_warnings
from impactlab.simulation.ensemble import Execution
from impactlab.simulation.growing_ensemble import USUAL, Ensemble, request_of, seconds_of_steps
from impactlab.simulation.joint_runs import JOINT_SIZE, Found, JointRun, grouped, joins, run_all
from impactlab.simulation.kept_runs import kept_run
from impactlab.simulation.planning import Automatic, automatic
from impactlab.step_control.rules.expected import expect_together
from impactlab.sweeps.kept_points import KeptPoints
from impactlab.sweeps.product import Outcome, Sweep, found_of, make_sweep
from impactlab.sweeps.scheduler import Heard, Job, run_in_turn, run_points
from impactlab.sweeps.sweep_points import MakeNetwork, Point

ROUNDED = 4
"""Numbers of steps per octave to which they are rounded up: by 19 % at most, 9 % on average."""

ALONE = {"tolerance", "max_seconds"}
"""Options with which a point chooses more than its step while it runs."""


@checked
def sweep(
    make_network: MakeNetwork,
    over: Mapping[str, Sequence[Any]],
    *,
    reference: bool = False,
    common_random_numbers: bool = False,
    rng: Any = None,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    **simulate_options: Any,
) -> xr.Dataset:
    """Simulate networks over a product of values and return one dataset.

    Points that differ only in numbers share one compilation; all share the workers.

    Parameters
    ----------
    make_network : callable
        ``make_network(name=value, ...)`` returns the network of a point, or a pair of it and
        options of `simulate` for this point alone. Bodies and contacts have the same names
        everywhere.
    over : mapping of str to sequence
        Values by name: numbers, texts, or components, which are labelled by their text. Every combination is a
        point. Attributes of a DataArray, such as its units, are kept.
    reference : bool
        Whether to add the exact statistics as ``<name>_exact`` where there is an exact law.
    common_random_numbers : bool
        Whether all points have the random numbers that `simulate` has at this `rng`. With
        equal steps, and `ExactFlow(jumps=False)`, differences between points are then more accurate.
        By default those of each point follow from `rng` and its values, so that it keeps
        them when values are added.
    rng : optional
        Seed, as for `simulate`.
    executor : concurrent.futures.Executor, optional
        Where to run; threads on all cores by default. Numbers never depend on it.
    progress : bool or callable, optional
        As for `simulate`, over all points.
    checkpoint : str or path, optional
        Folder that keeps points as they end, and every few seconds the states of those that run; see `simulate`.
    **simulate_options
        Options of `simulate` for all points.

    Returns
    -------
    xarray.Dataset
        The variables of `simulate` with the names of `over` as first dimensions, NaN at a
        refused point. Where points have different times, the dimension is the number of the
        ``sample``, and the coordinate ``time`` depends on the point, likewise frequencies. A
        point's attributes, such as ``step``, are variables; ``status`` is "done" or the reason
        why a point was refused or diverged; with `reference` there is ``reference_status``, too.
        A point selected from it can be given to `rerun` and `network_of`.

    Raises
    ------
    InvalidInput
        If an argument cannot be used, before anything runs, or every point is refused.
    Diverged
        If no point remained finite.
    ImpactLabError
        If the executor lost workers that it does not replace; what was found is its attribute `found`.

    Examples
    --------
    >>> def at(clearance):
    ...     stop = il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=clearance)
    ...     return network.replace(contacts={"stop": stop})
    >>> found = il.sweep(at, {"clearance": [0.1, 0.2]}, duration=20.0, realizations=64, rng=1)
    >>> found.contact_ratio.dims
    ('clearance', 'contact')
    """
    seed = seed_of(rng)
    make = partial(
        make_sweep, make_network, over, reference=reference, common_random_numbers=common_random_numbers,
        **simulate_options,
    )  # fmt: skip
    made = make(rng=seed)
    asked = {} if checkpoint is None else _asked(made, simulate_options, common_random_numbers)
    with kept_run(checkpoint, "sweep", executor, {**asked, "rng": None if rng is None else seed}) as (kept, used):
        if kept is not None and used != seed:
            made = make(rng=used)
        points = [point for point in made.points if not point.refusal]
        with announced(progress):
            outcomes, heard = run_all_points(points, executor, reporter(progress), kept)
        heard.say("Point", [point.key for point in points])
        return made.dataset(outcomes)


def _asked(made: Sweep, options: Mapping[str, Any], common_random_numbers: bool) -> dict[str, Any]:
    """Return what a sweep asks for."""
    networks = [(point.key, point.refusal, plain_data(point.network)) for point in made.points]
    return {
        "over": {name: labels.values for name, labels in made.coordinates.items()}, "networks": digest(networks),
        "options": options, "reference": made.reference, "common_random_numbers": common_random_numbers,
    }  # fmt: skip


def run_all_points(
    points: Sequence[Point], executor: Executor | None, show: Callable[[float], None], kept: Checkpoint | None
) -> tuple[dict[str, Outcome], Heard]:
    """Run points, those that are not kept, and return what came of all, and their warnings."""
    heard, outcomes, shared = Heard(), dict[str, Outcome](), Shared()
    if executor is not None and points:
        begin(executor)  # processes are forked here, before any thread computes
    store = None if kept is None else KeptPoints(kept, heard)
    if store is not None:
        outcomes |= store.load(points)
    left = [point for point in points if point.key not in outcomes]
    many = {point.key: partial(_of_draws, point) for point in left if point.network and point.network.is_uncertain}
    of_draws = {key: job(None) if store is None else store.kept(key, job) for key, job in many.items()}
    pool: Any = executor  # None for threads
    outcomes |= run_in_turn({key: partial(job, pool, show) for key, job in of_draws.items()}, heard)
    left = [point for point in left if point.key not in outcomes]
    jobs: dict[str, Job] = {}
    while left:
        part = left if store is None else left[: store.number]
        done = len(points) - len(left)

        def told(share: float, done: int = done, number: int = len(part)) -> None:
            show((done + number * share) / len(points))

        beside = None if store is None else store.beside()
        found, rest, reasons = run_beside_others(part, executor, told, heard, beside)
        if store is not None:
            store.save(found)
        for key, item in found.items():
            outcomes[key] = item if isinstance(item, Exception) else shared(found_of(item))
        for point in rest:
            job = partial(_job, point, reasons.get(point.key))
            jobs[point.key] = job(None) if store is None else store.kept(point.key, job)
        left = left[len(part) :]
    alone = any(point.options.get("tolerance") is not None for point in points if point.key in jobs)
    outcomes |= run_points(jobs, executor, show, alone, len(points) - len(jobs), heard)
    if store is not None:
        store.clear_parts(outcomes)
    return outcomes, heard


def run_beside_others(
    points: Sequence[Point], executor: Executor | None, show: Callable[[float], None], heard: Heard,
    kept: Checkpoint | None,
) -> tuple[dict[str, Outcome], list[Point], dict[str, str]]:  # fmt: skip
    """Run the points that can beside others; return what came of them, the others, and why methods were chosen."""
    exact, others, reasons, models = run_without_steps(points, show, heard)
    outcomes, rest = run_side_by_side(others, executor, show, heard, models, kept)
    outcomes |= exact
    for key, found in outcomes.items():
        if key in reasons and not isinstance(found, ImpactLabError):
            outcomes[key] = explained(found_of(found), reasons[key])
    return outcomes, rest, reasons


class Draft(NamedTuple):
    """A point that may run beside others."""

    point: Point
    model: Model
    request: Request


class Prepared(NamedTuple):
    """A point that is planned."""

    point: Point  # with the options with which `impactlab.simulate` gives the same alone
    ensemble: Ensemble | None  # None where it cannot run beside others

    @property
    def planned(self) -> Planned:
        """Its network and its plan."""
        assert self.ensemble is not None
        return Planned(self.ensemble.parts[0].model, self.ensemble.plan)


@uncollected()
def run_side_by_side(
    points: Sequence[Point], executor: Executor | None, show: Callable[[float], None], heard: Heard,
    models: Mapping[str, Model], kept: Checkpoint | None = None,
) -> tuple[dict[str, Outcome], list[Point]]:  # fmt: skip
    """Run the points that can side by side; return what came of them, and the others as they are to run alone.

    With an executor no points run side by side, but they have the same steps. `show` is called with the part of all
    points that is done, `heard` are their warnings, and `models` those that are known, by their keys.
    """
    drafts = run_in_turn({point.key: partial(drafted, point, models.get(point.key)) for point in points}, heard)
    able = [draft for draft in drafts.values() if isinstance(draft, Draft)]
    with contextlib.suppress(ImpactLabError):  # whose fault it is each says for itself
        expect_together([(draft.model, draft.request) for draft in able])
    found: dict[str, Any] = {
        point.key: Prepared(point, None) if drafts[point.key] is None else drafts[point.key] for point in points
    }
    found |= run_in_turn({draft.point.key: partial(prepared, draft) for draft in able}, heard)
    outcomes: dict[str, Outcome] = {key: item for key, item in found.items() if isinstance(item, ImpactLabError)}
    ready: dict[str, Prepared] = {key: item for key, item in found.items() if key not in outcomes}
    runs = runs_of(ready) if executor is None else []
    share = 0.99 * sum(map(len, runs)) / max(len(points), 1)  # the end is shown by others
    results = run_fused(ready, runs, lambda part: show(share * part), kept)
    labelled = run_in_turn({key: partial(_labelled, ready[key], found_of) for key, found_of in results.items()}, heard)
    outcomes |= {
        key: with_warnings(item, by_kind(heard.of_job(key))) if isinstance(item, Findings) else item
        for key, item in labelled.items()
    }
    return outcomes, [item.point for key, item in ready.items() if key not in outcomes]


def _labelled(item: Prepared, found: Found) -> Findings:
    assert item.ensemble is not None
    item.ensemble.take(*found)
    return item.ensemble.findings()


def drafted(point: Point, known: Model | None = None) -> Draft | None:
    """Make the model of a point, unless it is known, if it may run beside others."""
    network, given = point.network, {name: value for name, value in point.options.items() if value is not None}
    if network is None or not ALONE.isdisjoint(given) or len(network.oscillators) > JOINT_SIZE // 2:
        return None
    request = request_of(network, **given)
    if any(isinstance(record, impactlab.FinalState) for record in request.records):
        return None
    model = known or Model.of(network)
    return None if refusing(model, Mode.SIDE_BY_SIDE) else Draft(point, model, request)


def prepared(draft: Draft) -> Prepared:
    """Plan a point; its step and spin-up are then given, unless something keeps it from running beside others."""
    point, model, request = draft
    alone = Prepared(point, None)
    if request.step is None:
        chosen = automatic(model, request)
        if chosen is None:
            return alone
        changes = _rounded(chosen, request)
        point = point._replace(options={**point.options, **changes})
        request = replace(request, **changes)
    ensemble = _ensemble(model, request)
    return alone if ensemble is None else Prepared(point, ensemble)


def _ensemble(model: Model, request: Request) -> Ensemble | None:
    """Return the realizations of a request, unless something keeps them from running beside others."""
    ensemble = Ensemble(model, request, Execution(), compared=True)
    if len(ensemble.parts) > 1:
        return None
    return ensemble if joins(Planned(ensemble.parts[0].model, ensemble.plan)) else None


def _rounded(chosen: Automatic, request: Request) -> dict[str, Any]:
    """Return a step, and a spin-up if there is one, that are a little smaller and longer, of few that may be chosen."""
    step, intervals = chosen.step, set(request.intervals())
    whole = next(iter(intervals), request.duration)
    if len(intervals) < 2:
        step = whole / _rounded_up(round(whole / step))
    if request.spin_up is not None or chosen.spin_up <= 0.0:
        return {"step": step}
    return {"step": step, "spin_up": _rounded_up(math.ceil(chosen.spin_up / step * (1.0 - 1e-12))) * step}


def _rounded_up(number: int) -> int:
    """Return the next of 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, … that is no smaller."""
    power = max(0, int(ROUNDED * math.log2(number)) - 1)
    while (rounded := math.ceil(math.exp2(power / ROUNDED) * (1.0 - 1e-12))) < number:
        power += 1
    return rounded


def runs_of(points: Mapping[str, Prepared]) -> list[list[str]]:
    """Return the keys of the points that run together, run by run; points that run alone are in none."""
    able = {key: item.planned for key, item in points.items() if item.ensemble is not None}
    return grouped(able)


def run_fused(
    points: Mapping[str, Prepared], runs: Sequence[Sequence[str]], progress: Callable[[float], None],
    kept: Checkpoint | None = None,
) -> dict[str, Found]:  # fmt: skip
    """Run the joint runs in turn; return the result of each point that did not diverge."""
    joint = [JointRun([points[key].planned for key in keys]) for keys in runs]
    results = run_all(joint, progress, kept) if joint else []
    return {
        key: found
        for keys, of_run in zip(runs, results, strict=True)
        for key, found in zip(keys, of_run, strict=True)
        if found is not None
    }


@uncollected()
def run_without_steps(
    points: Sequence[Point], show: Callable[[float], None], heard: Heard
) -> tuple[dict[str, Outcome], list[Point], dict[str, str], dict[str, Model]]:
    """Run points without steps, as lanes of one compiled call: those for which `EventLocated` is asked for, or chosen.

    Return what came of them, the other points, why methods were chosen, and the models that were made.
    """
    models: dict[str, Model] = {}
    found = run_in_turn({point.key: partial(_without_steps, point, models) for point in points}, heard)
    reasons = {key: item for key, item in found.items() if isinstance(item, str)}
    runs = {key: item for key, item in found.items() if isinstance(item, Wanted)}
    share = len(runs) / max(len(points), 1)
    results = dict(zip(runs, run_located(list(runs.values()), lambda part: show(share * part)), strict=True))
    for key, item in results.items():
        if runs[key].steps is not None:  # the method was chosen
            reasons[key] = LOCATED if isinstance(item, Traced) else reason_of_steps(item)
    found |= results
    labelled = run_in_turn({key: item.findings for key, item in found.items() if isinstance(item, Traced)}, heard)
    outcomes: dict[str, Outcome] = {
        key: item for key, item in found.items() if isinstance(item, ImpactLabError) and key not in reasons
    }
    outcomes |= {
        key: with_warnings(item, by_kind(heard.of_job(key))) if isinstance(item, Findings) else item
        for key, item in labelled.items()
    }
    others = [_with_steps(point) if point.key in reasons else point for point in points if point.key not in outcomes]
    return outcomes, others, reasons, models


def _without_steps(point: Point, models: dict[str, Model]) -> Wanted | str | None:
    """Return the run of a point for which `EventLocated` is asked for, or chosen; or why it was not.

    The model is added to those that were made.
    """
    network, options = point.network, {name: value for name, value in point.options.items() if value is not None}
    asked = isinstance(options.get("integrator"), EventLocated)
    chosen = chooses(options.get("integrator"), options.get("step"))
    if network is None or not ALONE.isdisjoint(options) or not (asked or chosen):
        return None
    request = request_of(network, **options)
    model = models[point.key] = Model.of(network)
    return (
        without_steps(model, request)
        if asked
        else usual_run(model, request, partial(seconds_of_steps, model, request)) or None
    )


def _with_steps(point: Point) -> Point:
    """Return a point whose method is not chosen anew."""
    return point._replace(options={**point.options, "integrator": USUAL})


def _of_draws(point: Point, kept: Checkpoint | None) -> Job:
    """Return the simulation of a point with uncertain numbers, which runs its draws side by side."""
    return lambda pool, _: impactlab.simulate(
        point.network,  # type: ignore[arg-type]
        **point.options,
        executor=pool,
        progress=False,
        checkpoint=kept,
    )


def _job(point: Point, reason: str | None, kept: Checkpoint | None) -> Job:
    """Return the simulation of a point, whose method was chosen for a reason if there is one."""
    checkpoint = None if point.options.get("tolerance") is not None else kept

    def run(pool: Executor, note: Callable[[float], None]) -> Outcome:
        found = impactlab.simulate(
            point.network,  # type: ignore[arg-type]
            **point.options,
            executor=pool,
            progress=note,
            checkpoint=checkpoint,
        )
        return found if reason is None else explained(Findings.of(found), reason)

    return run
