"""Sweeps: simulations over a product of values as one labelled dataset."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import xarray as xr

import impactlab
from impactlab.assembly.compiling import announced
from impactlab.components.citations import entries
from impactlab.components.literature import in_one_line
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.plan.seed import seed_of
from impactlab.progress import reporter
from impactlab.results.dataset import CONFIGURATION, provenance
from impactlab.results.stack import gathered
from impactlab.sweeps.fused import Outcome, run_side_by_side
from impactlab.sweeps.points import MakeNetwork, Point, labels_of, make_points, reason_of, values_of
from impactlab.sweeps.scheduler import Heard, Job, run_together

DONE = "done"
"""Status of a point that was simulated."""

_UNITS = dict.fromkeys(("step", "duration", "spin_up", "longest_jump", "seconds_spent"), "s")


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a sweep simulates, and how its results become one dataset."""

    coordinates: dict[str, xr.Variable]  # the values by name
    points: tuple[Point, ...]  # their product; the last name varies fastest
    reference: bool = False  # whether the exact statistics are wanted

    def dataset(self, outcomes: Mapping[str, Outcome]) -> xr.Dataset:
        """Return the outcomes of all points as one dataset, see `sweep`; an error if no point could be simulated."""
        refusals = {point.key: point.refusal or reason_of(outcomes[point.key]) for point in self.points}
        if all(refusals.values()):
            key, reason = next(iter(refusals.items()))
            error = outcomes.get(key)
            kind = type(error) if isinstance(error, ImpactLabError) else InvalidInput
            raise kind(f"No point of the sweep could be simulated; at {key}: {reason}")
        names = {"names": list(self.coordinates), "reference": self.reference}
        title = f"Statistics of networks of oscillators with contacts over {', '.join(self.coordinates)}"
        made = [json.loads(item.attrs[CONFIGURATION]) for item in outcomes.values() if isinstance(item, xr.Dataset)]
        of_all = provenance(title, {"sweep": names}, in_one_line(entries(made)))
        results = [
            outcome if isinstance(outcome := outcomes.get(point.key), xr.Dataset) else xr.Dataset()
            for point in self.points
        ]
        further = []
        for point, result in zip(self.points, results, strict=True):
            variables = {
                **_own_attributes(point, result, of_all),
                "status": ((), refusals[point.key] or DONE, {"long_name": f"{DONE}, or why not"}),
                **(_reference(point) if self.reference else {}),
            }
            further.append(xr.Dataset({name: variables[name] for name in variables if name not in self.coordinates}))
        whole = gathered(results, self.coordinates).assign_attrs(of_all)
        return whole.assign(gathered(further, self.coordinates).data_vars)


def sweep(
    make_network: MakeNetwork,
    over: Mapping[str, Sequence[Any]],
    *,
    reference: bool = False,
    common_random_numbers: bool = False,
    rng: Any = None,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    **simulate_options: Any,
) -> xr.Dataset:
    """Simulate networks over a product of values and return one dataset.

    Points that differ in numbers only share one compilation; all share the workers.

    Parameters
    ----------
    make_network : callable
        ``make_network(name=value, ...)`` returns the network of a point, or a pair of it and
        options of `simulate` for this point alone. Bodies and contacts have the same names
        everywhere.
    over : mapping of str to sequence
        Values by name: numbers, texts, components, which their text labels. Every combination is a
        point. Attributes of a DataArray, such as its units, are kept.
    reference : bool
        Whether to add the exact statistics as ``<name>_exact`` where there is an exact law.
    common_random_numbers : bool
        Whether all points have the random numbers that `simulate` has at this `rng`, which with
        equal steps, and `ExactFlow(jumps=False)`, makes differences between points more accurate.
        By default those of each follow from `rng` and the point's own values, so that it keeps
        them when values are added.
    rng : optional
        Seed, as for `simulate`.
    executor : concurrent.futures.Executor, optional
        Where to run; threads on all cores by default. Numbers never depend on it.
    progress : bool or callable, optional
        As for `simulate`, over all points.
    **simulate_options
        Options of `simulate` for all points.

    Returns
    -------
    xarray.Dataset
        The variables of `simulate` with the names of `over` as first dimensions, NaN at a
        refused point; a point's attributes, such as ``step``, as variables; ``status``, which is
        "done" or the reason why a point was refused or diverged; with `reference` also
        ``reference_status``. A point selected from it can be given to `rerun` and `network_of`.

    Raises
    ------
    InvalidInput
        If something given cannot be used, before anything runs, or every point is refused.
    Diverged
        If no point remained finite.
    """
    made = make_sweep(
        make_network,
        over,
        reference=reference,
        common_random_numbers=common_random_numbers,
        rng=rng,
        **simulate_options,
    )
    points, heard, show = [point for point in made.points if not point.refusal], Heard(), reporter(progress)
    with announced(progress):
        outcomes, rest = run_side_by_side(points, executor, show, heard)
        alone = any(point.options.get("tolerance") is not None for point in rest)
        jobs = {point.key: _job(point) for point in rest}
        outcomes |= run_points(jobs, executor, show, alone, len(points) - len(jobs), heard)
    heard.say("Point", [point.key for point in points])
    return made.dataset(outcomes)


def run_points(
    jobs: Mapping[str, Job],
    executor: Executor | None,
    show: Callable[[float], None],
    alone: bool = False,
    done: int = 0,
    heard: Heard | None = None,
) -> dict[str, Outcome]:
    """Run the jobs of a sweep, of which some points are `done`, and return what came of each."""
    outcomes: dict[str, Outcome] = {}

    def watch(_: str, parts: Mapping[str, float]) -> None:
        part = (done + sum(parts.values())) / (done + len(parts))
        if part < 1.0 or len(outcomes) == len(jobs):  # the end is shown once
            show(part)

    run_together(jobs, outcomes.__setitem__, kind="Point", executor=executor, alone=alone, watch=watch, heard=heard)
    if done and not jobs:
        show(1.0)
    return outcomes


def _job(point: Point) -> Job:
    """Return the simulation of a point."""
    return lambda pool, note: impactlab.simulate(point.network, **point.options, executor=pool, progress=note)  # type: ignore[arg-type]


def make_sweep(
    make_network: MakeNetwork,
    over: Mapping[str, Sequence[Any]],
    *,
    reference: bool = False,
    common_random_numbers: bool = False,
    rng: Any = None,
    **options: Any,
) -> Sweep:
    """Make the networks of a sweep and decide its random numbers; nothing is simulated yet.

    Parameters and errors are those of `sweep`.
    """
    if not isinstance(over, Mapping) or not over:
        raise InvalidInput(f'sweep takes values by name, such as {{"clearance": [0.01, 0.05]}}, not {over!r}.')
    values = {name: values_of(name, given) for name, given in over.items()}
    labels = {name: labels_of(name, items) for name, items in values.items()}
    points = make_points(make_network, values, labels, options, seed_of(rng), common_random_numbers)
    coordinates = {name: xr.Variable(name, labels[name], getattr(over[name], "attrs", {})) for name in values}
    return Sweep(coordinates, points, reference)


def _own_attributes(point: Point, result: xr.Dataset, of_all: Mapping[str, str]) -> dict[str, Any]:
    """Return the attributes of a point as variables, but for those that describe the whole sweep."""
    network = {} if point.network is None else {"network": point.network.to_dict()}
    again = result.attrs.get(CONFIGURATION, json.dumps(network))
    variables = {CONFIGURATION: ((), again, {"long_name": "what makes the point again"})}
    for name, value in result.attrs.items():
        if name not in of_all:
            attrs = {} if isinstance(value, str) else {"units": _UNITS.get(name, "1")}
            variables[name] = ((), value, attrs)
    return variables


def _reference(point: Point) -> dict[str, Any]:
    """Return the exact statistics of a point as variables, and whether there are any."""
    status = point.refusal or DONE
    found: dict[str, Any] = {}
    if point.network is not None:
        try:
            statistics = impactlab.exact(point.network).statistics()
        except ImpactLabError as error:
            status = reason_of(error)
        else:
            for name, variable in statistics.data_vars.items():
                attrs = {**variable.attrs, "long_name": f"exact {variable.attrs['long_name']}"}
                found[f"{name}_exact"] = (variable.dims, variable.values, attrs)
    return {**found, "reference_status": ((), status, {"long_name": f"{DONE}, or why there is no exact law"})}
