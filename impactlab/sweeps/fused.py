"""Points of a sweep that differ in numbers only, side by side in one compiled run.

What a point finds never depends on the other points, nor on where it runs: an automatic step and spin-up are rounded to
numbers of steps from which many points can choose the same, and each point is then what `impactlab.simulate` gives for
it at this step and spin-up, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import impactlab
from impactlab import simulation
from impactlab.assembly.model import Model
from impactlab.errors import ImpactLabError
from impactlab.machine import begin
from impactlab.sweeps.points import Point
from impactlab.sweeps.scheduler import Heard, Job, run_together

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray as xr

    from impactlab.plan.side_by_side import Planned
    from impactlab.simulation.block import BlockResult
    from impactlab.simulation.planning import Automatic
    from impactlab.simulation.request import Request
    from impactlab.simulation.simulate import Ensemble

ROUNDED = 4
"""Numbers of steps per octave to which they are rounded up: by 19 % at most, 9 % on average."""

ALONE = {"tolerance", "max_seconds"}
"""Options with which a point chooses more than its step while it runs."""


Outcome: TypeAlias = "xr.Dataset | ImpactLabError"


class Prepared(NamedTuple):
    """A point that is planned."""

    point: Point  # with the options with which `impactlab.simulate` gives the same alone
    ensemble: Ensemble | None  # None where it cannot run beside others

    @property
    def planned(self) -> Planned:
        """Its network and its plan."""
        assert self.ensemble is not None
        planned: Planned = simulation.joint_runs.Planned(self.ensemble.parts[0].model, self.ensemble.plan)
        return planned


def run_side_by_side(
    points: Sequence[Point], executor: Executor | None, show: Callable[[float], None], heard: Heard
) -> tuple[dict[str, Outcome], list[Point]]:
    """Run the points that can side by side; return what came of them, and the others as they are to run alone.

    With an executor no points run side by side, but they have the same steps. `show` is called with the part of all
    points that is done, and `heard` are their warnings.
    """
    if executor is not None and points:
        begin(executor)  # processes are forked here, before any thread computes
    found: dict[str, Any] = {}
    jobs = {point.key: _preparing(point) for point in points}
    run_together(jobs, found.__setitem__, kind="Point", heard=heard)
    outcomes: dict[str, Outcome] = {key: item for key, item in found.items() if isinstance(item, ImpactLabError)}
    ready: dict[str, Prepared] = {key: item for key, item in found.items() if key not in outcomes}
    runs = runs_of(ready) if executor is None else []
    share = 0.99 * sum(map(len, runs)) / max(len(points), 1)  # the end is shown by others
    results = run_fused(ready, runs, lambda part: show(share * part))
    labelling = {key: _labelling(ready[key], blocks) for key, blocks in results.items()}
    run_together(labelling, outcomes.__setitem__, kind="Point", heard=heard, alone=True)
    return outcomes, [item.point for key, item in ready.items() if key not in outcomes]


def _preparing(point: Point) -> Job:
    return lambda pool, note: prepared(point, pool)


def _labelling(item: Prepared, results: list[BlockResult]) -> Job:
    def dataset(pool: Executor, note: Callable[[float], None]) -> xr.Dataset:
        assert item.ensemble is not None
        item.ensemble.take(results)
        return item.ensemble.dataset()

    return dataset


def prepared(point: Point, executor: Executor) -> Prepared:
    """Plan a point, if it may run beside others; its step and spin-up are then given."""
    alone = Prepared(point, None)
    network, given = point.network, {name: value for name, value in point.options.items() if value is not None}
    if network is None or not ALONE.isdisjoint(given) or len(network.oscillators) > simulation.joint_runs.SIZE // 2:
        return alone
    request = simulation.simulate.request_of(network, **given)
    if any(isinstance(record, impactlab.FinalState) for record in request.records):
        return alone
    model = Model.of(network)
    if request.step is None:
        chosen: Automatic | None = simulation.planning.automatic(model, request)
        if chosen is None:
            return alone
        changes = _rounded(chosen, request)
        point = point._replace(options={**point.options, **changes})
        request = replace(request, **changes)
    ensemble = _ensemble(model, request, executor)
    return alone if ensemble is None else Prepared(point, ensemble)


def _ensemble(model: Model, request: Request, executor: Executor) -> Ensemble | None:
    """Return the realizations of a request, unless something keeps them from running beside others."""
    simulate = simulation.simulate
    ensemble: Ensemble = simulate.Ensemble(model, request, simulate.Execution(executor), compared=True)
    if len(ensemble.parts) > 1:
        return None
    planned = simulation.joint_runs.Planned(ensemble.parts[0].model, ensemble.plan)
    return ensemble if simulation.joint_runs.joins(planned) else None


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
    runs: list[list[str]] = simulation.joint_runs.grouped(able)
    return runs


def run_fused(
    points: Mapping[str, Prepared], runs: Sequence[Sequence[str]], progress: Callable[[float], None]
) -> dict[str, list[BlockResult]]:
    """Run some points, run by run, and return what the blocks found of each, but of those that left the finite."""
    joint = [simulation.joint_runs.JointRun([points[key].planned for key in keys]) for keys in runs]
    results = simulation.joint_runs.run_all(joint, progress) if joint else []
    return {
        key: found
        for keys, of_run in zip(runs, results, strict=True)
        for key, found in zip(keys, of_run, strict=True)
        if found is not None
    }
