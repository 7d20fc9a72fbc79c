"""Simulate a network: plan, run, estimate, label."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.build import digest
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.components.component import positive
from impactlab.errors import Diverged, InvalidInput, heard_by, warn
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.linear.damping import damped
from impactlab.linear.laws import relaxation_time
from impactlab.machine import shares_memory, workers_of
from impactlab.networks.network import Network
from impactlab.nonlinear.force_checks import explanation
from impactlab.plan.plan import Plan
from impactlab.plan.seed import seed_of
from impactlab.progress import reporter, say
from impactlab.records.record import Record
from impactlab.records.trajectory import PairedRealizations, PerRealization, Trajectory, trajectory_size
from impactlab.records.trajectory_file import written
from impactlab.results.dataset import opened, path_of, provenance, replacing, told, write
from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import Variable, statistics
from impactlab.results.snapshot import AT_POINTS, QUANTITIES, STATES
from impactlab.simulation.ensemble import merged, run, run_block
from impactlab.simulation.idle_bodies import joined, split
from impactlab.simulation.measured_step import measured, worth_measuring
from impactlab.simulation.memory import check_memory
from impactlab.simulation.planning import make_plan
from impactlab.simulation.request import Request
from impactlab.simulation.segments import step_error
from impactlab.simulation.tolerance import DRIFT, checked, reach, without_realizations
from impactlab.simulation.tolerance import RELAXATION_TIMES as LENGTH
from impactlab.statistics.ergodicity import begun_elsewhere
from impactlab.statistics.estimate import Estimates, estimate
from impactlab.statistics.heating import unequal_partition
from impactlab.statistics.subsamples import samples_per_realization

LONG = 3600.0
"""Time that a run may take without a warning before it begins (s)."""

SECONDS = 600.0
"""Time that may be spent to reach a tolerance, unless it is given (s)."""


def simulate(
    network: Network,
    duration: float | None = None,
    *,
    tolerance: Mapping[str, float] | None = None,
    max_seconds: float | None = None,
    realizations: int = 1,
    step: float | None = None,
    integrator: Integrator | None = None,
    spin_up: float | None = None,
    initial: str | Mapping[str, Mapping[str, float]] | None = None,
    record: Sequence[Record] | Record | None = None,
    rng: Any = None,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    out: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Simulate an ensemble of realizations and return its statistics.

    Parameters
    ----------
    network : Network
        What to simulate.
    duration : float, optional
        Time over which statistics are taken, after the spin-up (s). Needed unless there is a
        tolerance; then it is the longest that a realization may be.
    tolerance : mapping of str to float, optional
        Relative accuracy by the name of a statistic: the step, the duration and the number of
        realizations are chosen so that |bias of the step| + 2 standard errors are within it
        for every label; see `impactlab.simulation.tolerance`.
    max_seconds : float, optional
        Time that may be spent (s): a run that is foreseen to take longer is refused. By default 600 with a
        tolerance; without one any time, with a warning where it is more than an hour.
    realizations : int
        Number of independent realizations; with a tolerance the least. One is run where nothing is random.
    step : float, optional
        Time step (s); chosen from the network by default.
    integrator : Integrator, optional
        Method; `ExactFlow` by default.
    spin_up : float, optional
        Time before the statistics begin (s). By default twelve relaxation times of the slowest body, or as long as
        collisions and changes between wells take, if that is not much longer than the run; 0 if the initial state
        is given.
    initial : str or mapping, optional
        "stationary" (default: the law without contacts, drawn again while a contact is
        closed; "rest" where there is none), "rest", or ``{"displacement": {name: value},
        "velocity": {name: value}}`` (m, m s-1), 0 where nothing is named.
    record : Record or sequence, optional
        What to keep besides the statistics.
    rng : optional
        Seed as NumPy takes it (SPEC 7): None, int, SeedSequence, Generator. Streams are
        keyed by seed, realization, name of the body or the source, and step; or interval, in runs
        with contact-free intervals.
    executor : concurrent.futures.Executor, optional
        Where blocks of realizations run; threads on all cores by default. Numbers never
        depend on it.
    progress : bool or callable, optional
        Progress bar; by default on long runs in a terminal.
    out : str or path, optional
        File to write the dataset to (netCDF): it is whole, or not there; an existing one is
        replaced at the end. Trajectories are written while they arise, so that they take
        memory for a few samples only, and read from the file when they are needed.

    Returns
    -------
    xarray.Dataset
        Default statistics with dims ``oscillator`` or ``contact``, each with
        ``<name>_standard_error``; ``balance_*`` diagnostics; what the records add. Where the bias of the
        step was measured it is ``<name>_step_bias``, a part of the value, and standard errors allow for it.

    Raises
    ------
    InvalidInput
        If something given cannot be used, or the memory or the disk are too small.
    Diverged
        If a realization left the range of finite numbers.
    """
    if not isinstance(network, Network):
        raise InvalidInput(f"simulate takes an il.Network, not {network!r}.")
    method, seed = integrator or ExactFlow(), seed_of(rng)
    allowed = None if max_seconds is None else positive("max_seconds", max_seconds)
    if tolerance is None:
        if duration is None:
            raise InvalidInput("simulate needs a duration (s), or a tolerance.")
        request = Request(duration, realizations, step, method, spin_up, initial, Record.all_of(record), seed)
        return _simulate(network, request, Execution(executor, progress, math.inf if allowed is None else allowed, out))
    if out is not None:
        raise InvalidInput(
            "simulate cannot write to out= until a tolerance is reached; give duration=, or use il.save afterwards."
        )
    model = Model.of(network)
    tolerances = checked(tolerance, model)
    longest = math.inf if duration is None else positive("duration", duration)
    length = min(longest, LENGTH * relaxation_time(damped(model)[1]))
    records = Record.all_of(record)
    asked = any(isinstance(item, PerRealization) for item in records)
    kept = records if asked else [*records, PairedRealizations()]

    request = Request(length, realizations, step, method, spin_up, initial, kept, seed)

    def attempt(count: int, chosen: float | None, coarse: bool, seconds: float) -> xr.Dataset:
        one = replace(request, realizations=count, step=chosen, coarse=coarse)
        return _simulate(network, one, Execution(executor, progress, seconds, above=False), compared=chosen is not None)

    result = reach(attempt, tolerances, SECONDS if allowed is None else allowed, realizations, step)
    return result if asked else without_realizations(result)


@dataclass(frozen=True)
class Execution:
    """Where a run happens, and what it may take; parameters are those of `simulate`."""

    executor: Executor | None = None
    progress: bool | Callable[[float], None] | None = None
    seconds: float = math.inf  # time that it may be foreseen to take (s)
    out: str | os.PathLike[str] | None = None
    above: bool = True
    """Whether a measured step may exceed that of the rules: runs at twice the step are to be stable, too, where an
    accuracy is to be reached.
    """

    def __post_init__(self) -> None:
        if self.executor is not None and not isinstance(self.executor, Executor):
            raise InvalidInput(f"executor must be a concurrent.futures.Executor, not {self.executor!r}.")

    @property
    def workers(self) -> int:
        """Number of blocks that run at once."""
        return workers_of(self.executor)


def _simulate(network: Network, request: Request, execution: Execution, compared: bool = False) -> xr.Dataset:
    """Return the dataset of a request, of which the step need not be measured where it is `compared` with another."""
    model = Model.of(network)
    configuration = {
        "network": network.to_dict(),
        "simulate": _plain(request.options()),
        "text": digest(generate(model)),
    }
    random = bool(model.random.any())
    if not random:
        request = replace(request, realizations=1)  # all would be the same
    out, request = execution.out, replace(request, workers=execution.workers)
    with contextlib.nullcontext() if out is None else replacing(path_of(out)) as temporary:

        def run_part(part: Model, request: Request) -> xr.Dataset:
            return _run_part(part, request, execution, compared, configuration, temporary)

        apart = split(model, request.integrator, request.initial, request.records)
        if apart is None:
            dataset = run_part(model, request)
        else:
            busy, idle = map(Model.of, apart)
            alone = replace(request, step=None, coarse=False)
            dataset = joined(network, run_part(busy, request), run_part(idle, alone))
        if not random:
            dataset.attrs["deterministic"] = "Nothing is random: one realization tells all, without standard errors."
        if out is None or temporary is None:
            return dataset
        streamed = any(isinstance(item, Trajectory) for item in request.records)
        with told(str(out), temporary):
            write(dataset, temporary, append=streamed)
    return opened(path_of(out), lazy=(*QUANTITIES, STATES.name, *(item.name for item in AT_POINTS.values())))


def _run_part(
    model: Model, request: Request, execution: Execution, compared: bool, configuration: dict[str, Any],
    file: Path | None,
) -> xr.Dataset:  # fmt: skip
    """Plan a run, measure its step where that is worth while, and return its dataset."""

    def planned(longest_step: float = math.inf, velocity: np.ndarray | None = None) -> Plan:
        return make_plan(model, replace(request, longest_step=longest_step, mean_square_velocity=velocity))

    def tried(longest_step: float, velocity: np.ndarray | None = None) -> Plan:
        with heard_by(lambda message, category: None):  # the first plan has said it
            return planned(longest_step, velocity)

    plan, error = planned(), None
    try:
        affordable = not compared and plan.seconds(execution.workers) <= execution.seconds
        if affordable and worth_measuring(plan, model, request.integrator, request.step):
            measure = partial(step_error, partial(make_plan, model), model, request.initial)
            plan, error = measured(tried, measure, plan, request.step is None, execution.above)
        dataset = _run(plan, request, execution, configuration, file)
        if error is None:
            return dataset
        sampled = plan.random and not plan.realizations.trusted
        if message := error.doubt(dataset, sampled, plan.steady):
            warn(message)
        return error.added_to(dataset, plan.clock.automatic)
    except Diverged as diverged:
        raise Diverged(f"{diverged}{explanation(model, plan.observed.window)}") from None


def _run(
    plan: Plan, request: Request, execution: Execution, configuration: dict[str, Any], file: Path | None
) -> xr.Dataset:
    """Run a plan and return its dataset, without trajectories if there is a file for them."""
    executor, progress, seconds = execution.executor, execution.progress, execution.seconds
    foreseen = plan.seconds(execution.workers)
    if foreseen > seconds:
        raise InvalidInput(
            f"{_work(plan, foreseen)}, but {max(seconds, 0.0):.2g} s are left. Give a larger max_seconds= or "
            "tolerance=, a shorter duration= or spin_up=, or fewer realizations."
        )
    if foreseen > LONG:
        warn(f"{_work(plan, foreseen)}. Give max_seconds= to refuse such runs.")
    size = trajectory_size(plan)
    check_memory(plan, execution.workers, size if file is None else 0)
    with contextlib.ExitStack() as stack:
        if size and file is not None:
            if not shares_memory(executor):
                raise InvalidInput("Trajectories are written to a file from threads only: leave out executor= or out=.")
            say(progress, f"Trajectories: up to {size / 1e9:.3g} GB")
            plan = stack.enter_context(written(plan, file, file.parent))
        results = run(plan, executor, reporter(progress))
    estimates = estimate(plan, *merged(results))
    drifting = plan.steady and estimates.drift > DRIFT
    from_rest = not plan.start.given and plan.start.state == "rest" and not plan.clock.spin_up_steps
    # means are those of the whole transient, as from any state that is given
    transient = from_rest and request.initial == "rest" and request.spin_up == 0.0
    if estimates.values.unbalanced and plan.steady and (plan.clock.settled or not (drifting or from_rest)):
        warn(estimates.values.unbalanced)
    if drifting and not transient:
        warn(
            f"The two halves of the run differ by {estimates.drift:.1f} standard errors: the spin-up of "
            f"{plan.clock.spin_up:g} s may be too short. Give a longer spin_up=."
        )
    usual = request.initial is None and not plan.noise.coarse
    elsewhere = begun_elsewhere(plan, results[0].bodies, lambda other: run_block(other, 0).bodies) if usual else ""
    if message := estimates.remembered or elsewhere:
        warn(message)
    if not plan.noise.coarse and not drifting:
        partition = unequal_partition(plan, *estimates.values.combined["mean_square_velocity"])
        if message := estimates.heating.warning or partition:
            warn(message)
    return _labelled(plan, estimates, results, configuration)


def _work(plan: Plan, seconds: float) -> str:
    return (
        f"{plan.realizations.number} realizations of {plan.clock.all_steps:.3g} steps of {plan.clock.step:.3g} s would "
        f"take about {seconds:.2g} s"
    )


def _plain(value: Any) -> Any:
    """Return options as JSON can hold them, without numbers of NumPy."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return value.item() if isinstance(value, np.generic) else value


def _labelled(plan: Plan, estimates: Estimates, results: list[Any], configuration: dict[str, Any]) -> xr.Dataset:
    """Return the dataset of a finished run."""
    given = dict(estimates.values.labelled())
    known = {name: found for name, found in given.items() if not found.value.size or not np.isnan(found.value).all()}
    dataset = statistics(
        list(plan.system.bodies),
        list(plan.system.contacts),
        {variable.name: found.value for variable, found in known.items()},
        {variable.name: found.error for variable, found in known.items()},
        plan.points.names,
        **_attributes(plan, estimates, configuration),
    )
    variables = _of_contacts(plan, estimates) if plan.system.contacts else {}
    for index, (item, ratio) in enumerate(plan.observed.records):
        if isinstance(item, PerRealization):
            variables |= _by_realization([one for one in known if one.dimension in dataset.dims], estimates)
        variables |= item.label(plan, [result.records[index] for result in results], plan.interval(ratio))
    coordinates = {name: item for name, item in variables.items() if item[0] == (name,)}
    if any("realization" in dims for dims, *_ in variables.values()):
        coordinates["realization"] = ("realization",), np.arange(plan.realizations.number), {}
    return dataset.assign({name: item for name, item in variables.items() if name not in coordinates}).assign_coords(
        coordinates
    )


def _attributes(plan: Plan, estimates: Estimates, configuration: dict[str, Any]) -> dict[str, Any]:
    """Return what is said of the whole run."""
    attributes: dict[str, Any] = {
        **provenance("Statistics of a network of oscillators with contacts", configuration),
        "integrator": configuration["simulate"]["integrator"]["type"],
        "step": plan.clock.step,
        "duration": plan.clock.duration,
        "spin_up": plan.clock.spin_up,
        "realizations": plan.realizations.number,
        "independent_samples": plan.realizations.number * samples_per_realization(plan),
        "initial": "given" if plan.start.given else plan.start.state,
        "drift": estimates.drift,
        "step_heating": estimates.heating.share,
        "step_heating_standard_error": estimates.heating.error,
    }
    if plan.method.interval > 1:
        attributes["longest_jump"] = plan.method.interval * plan.clock.step
    return attributes


def _of_contacts(plan: Plan, estimates: Estimates) -> Variables:
    """Return what values of contacts rest on."""
    text = "number of contacts in one of the samples that standard errors come from"
    number = labelled(("contact",), estimates.contacts_per_sample, "1", text)
    number[2]["comment"] = "Differences beyond 5 standard errors are possible below 20."
    time = labelled((), np.array(plan.clock.duration), "s", "time over which peaks are taken")
    return {"observation_time": time, "contacts_per_sample": number}


def _by_realization(variables: list[Variable], estimates: Estimates) -> Variables:
    """Return statistics and balances of the realizations."""
    return {
        item.by_realization: labelled(
            ("realization", item.dimension), estimates.by_realization[item.name], item.units,
            f"{item.long_name}, by realization",
        )
        for item in variables
        if item.name in estimates.by_realization
    }  # fmt: skip
