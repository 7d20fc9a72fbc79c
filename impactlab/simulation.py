"""Simulate a network: plan, run, estimate, label."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import impactlab.density
import impactlab.peaks
import impactlab.spectrum  # noqa: F401  (records must be known when one is made again)
from impactlab.build import digest
from impactlab.damping import damped
from impactlab.dataset import VARIABLES, opened, path_of, provenance, replacing, statistics, told, write
from impactlab.ensemble import merged, run, shares_memory, workers_of
from impactlab.ergodicity import begun_elsewhere
from impactlab.errors import Diverged, InvalidInput, warn
from impactlab.estimate import Estimates, estimate
from impactlab.forces import explanation
from impactlab.generate import generate
from impactlab.groups import samples_per_realization
from impactlab.heating import unequal_partition
from impactlab.integrators import ExactFlow, Integrator
from impactlab.linear import relaxation_time
from impactlab.memory import check_memory
from impactlab.model import Model
from impactlab.network import Network
from impactlab.parts import joined, split
from impactlab.plan import Plan
from impactlab.planning import Request, make_plan
from impactlab.progress import reporter, say
from impactlab.record import PairedRealizations, PerRealization, Record, Trajectory, trajectory_size
from impactlab.rules import Seed, positive, seed_of
from impactlab.step_error import measured, worth_measuring
from impactlab.tolerance import DRIFT, checked, reach, without_realizations
from impactlab.tolerance import RELAXATION_TIMES as LENGTH
from impactlab.trajectories import written

LONG = 3600.0
"""Time that a run may take without a warning before it begins (s)."""

SECONDS = 600.0
"""Time that may be spent to reach a tolerance, unless it is given (s)."""

TRAJECTORIES = ("displacement", "velocity", "contact_force")
"""Variables of trajectories, which are read from a file when they are needed."""


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
        for every label; see `impactlab.tolerance`.
    max_seconds : float, optional
        Time that may be spent (s): a run that is foreseen to take longer is refused. By default 600 with a
        tolerance; without one any time, with a warning where it is more than an hour.
    realizations : int
        Number of independent realizations; with a tolerance the least. One is run where nothing is random.
    step : float, optional
        Time step (s); chosen from the scene by default.
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
        keyed by seed, realization, name of the body and step; or interval, in runs that jump.
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
        raise InvalidInput(f"simulate takes an il.Network, {network!r} was given.")
    method, seed = integrator or ExactFlow(), seed_of(rng)
    allowed = None if max_seconds is None else positive("max_seconds", max_seconds)
    if tolerance is None:
        if duration is None:
            raise InvalidInput("simulate needs a duration (s), or a tolerance.")
        request = Request(duration, realizations, step, method, spin_up, initial, records_of(record), seed)
        return _simulate(network, request, Execution(executor, progress, math.inf if allowed is None else allowed, out))
    if out is not None:
        raise InvalidInput("simulate cannot write to out= until a tolerance is reached; use il.save afterwards.")
    model = Model.of(network)
    tolerances = checked(tolerance, model)
    longest = math.inf if duration is None else positive("duration", duration)
    length = min(longest, LENGTH * relaxation_time(damped(model)[1]))
    records = records_of(record)
    asked = any(isinstance(item, PerRealization) for item in records)
    kept = records if asked else [*records, PairedRealizations()]

    request = Request(length, realizations, step, method, spin_up, initial, kept, seed)

    def attempt(count: int, chosen: float | None, coarse: bool, seconds: float) -> xr.Dataset:
        one = replace(request, realizations=count, step=chosen, coarse=coarse)
        return _simulate(network, one, Execution(executor, progress, seconds), compared=chosen is not None)

    result = reach(attempt, tolerances, SECONDS if allowed is None else allowed, realizations, step)
    return result if asked else without_realizations(result)


def repeat(
    configuration: Mapping[str, Any],
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate again what a configuration of `simulate` describes.

    Raises
    ------
    InvalidInput
        If a component's kernel has changed since.
    """
    options = configuration.get("simulate")
    if not isinstance(options, Mapping) or set(options) != _REPEATED:
        names = sorted(options) if isinstance(options, Mapping) else options
        raise InvalidInput(
            f"A stored simulation has the options {sorted(_REPEATED)} and no others; these are {names!r}."
        )
    seed, records = options["seed"], options["record"]
    if not isinstance(seed, list) or len(seed) != 2 or not all(_is_word(word) for word in seed):
        raise InvalidInput(f"The stored seed must be two whole numbers from 0 to 2^64 - 1, not {seed!r}.")
    if not isinstance(records, list):
        raise InvalidInput(f"The stored records must be a list, not {records!r}.")
    network = Network.from_dict(configuration.get("network", {}))
    if digest(generate(Model.of(network))) != configuration.get("text"):
        raise InvalidInput("The kernel of a component, or impactlab, has changed since this result was made.")
    request = Request(
        options["duration"], options["realizations"], options["step"], Integrator.from_dict(options["integrator"]),
        options["spin_up"], options["initial"], [Record.from_dict(item) for item in records], Seed(*seed),
    )  # fmt: skip
    return _simulate(network, request, Execution(executor, progress))


_REPEATED = {"duration", "realizations", "step", "integrator", "spin_up", "initial", "record", "seed"}
"""Options that are stored with a result: none of them can name a file."""


def _is_word(value: Any) -> bool:
    return type(value) is int and 0 <= value < 2**64


@dataclass(frozen=True)
class Execution:
    """Where a run happens, and what it may take; parameters are those of `simulate`.

    Attributes
    ----------
    executor : Executor, optional
    progress : bool or callable, optional
    seconds : float
        Time that it may be foreseen to take (s).
    out : str or path, optional

    Raises
    ------
    InvalidInput
        If the executor is none.
    """

    executor: Executor | None = None
    progress: bool | Callable[[float], None] | None = None
    seconds: float = math.inf
    out: str | os.PathLike[str] | None = None

    def __post_init__(self) -> None:
        if self.executor is not None and not isinstance(self.executor, Executor):
            raise InvalidInput(f"executor must be a concurrent.futures.Executor, {self.executor!r} was given.")

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
    return opened(path_of(out), TRAJECTORIES)


def _run_part(
    model: Model, request: Request, execution: Execution, compared: bool, configuration: dict[str, Any],
    file: Path | None,
) -> xr.Dataset:  # fmt: skip
    """Plan a run, measure its step where that is worth while, and return its dataset."""

    def planned(ceiling: float = math.inf, velocity: np.ndarray | None = None) -> Plan:
        return make_plan(model, replace(request, ceiling=ceiling, velocity=velocity))

    plan, error = planned(), None
    try:
        affordable = not compared and plan.seconds(execution.workers) <= execution.seconds
        if affordable and worth_measuring(plan, model, request.integrator, request.step):
            plan, error = measured(planned, plan, model, request.initial, request.step is None)
        dataset = _run(plan, request, execution, configuration, file)
        return dataset if error is None else error.added_to(dataset, plan.clock.automatic)
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
            f"{_work(plan, foreseen)}, {max(seconds, 0.0):.2g} s are left. Give a larger max_seconds= or tolerance=, "
            "a shorter duration= or spin_up=, or fewer realizations."
        )
    if foreseen > LONG:
        warn(f"{_work(plan, foreseen)}. A run that is foreseen to take longer than max_seconds= is refused.")
    size = trajectory_size(plan)
    check_memory(plan, execution.workers, size if file is None else 0)
    with contextlib.ExitStack() as stack:
        if size and file is not None:
            if not shares_memory(executor):
                raise InvalidInput("Trajectories go to a file from threads only: leave out executor= or out=.")
            say(progress, f"Trajectories: up to {size / 1e9:.3g} GB")
            plan = stack.enter_context(written(plan, file, file.parent))
        results = run(plan, executor, reporter(progress))
    estimates = estimate(plan, *merged(results))
    drifting = plan.steady and estimates.drift > DRIFT
    from_rest = not plan.start.given and plan.start.state == "rest" and not plan.clock.spin_up_steps
    # means are those of the whole transient, as from any state that is given
    transient = from_rest and request.initial == "rest" and request.spin_up == 0.0
    if estimates.unbalanced and plan.steady and (plan.clock.settled or not (drifting or from_rest)):
        warn(estimates.unbalanced)
    if drifting and not transient:
        warn(
            f"The two halves of the run differ by {estimates.drift:.1f} standard errors: the spin-up of "
            f"{plan.clock.spin_up:g} s may be too short."
        )
    usual = request.initial is None and not plan.noise.coarse
    elsewhere = begun_elsewhere(plan, results[0].bodies) if usual else ""
    if message := estimates.remembered or elsewhere:
        warn(message)
    if not plan.noise.coarse and not drifting:
        name = "mean_square_velocity"
        partition = unequal_partition(plan, estimates.values[name], estimates.errors[name])
        if message := estimates.heating.warning or partition:
            warn(message)
    return _labelled(plan, estimates, results, configuration)


def _work(plan: Plan, seconds: float) -> str:
    return (
        f"{plan.realizations.number} realizations of {plan.clock.all_steps:.3g} steps of {plan.clock.step:.3g} s would "
        f"take about {seconds:.2g} s"
    )


def records_of(record: Any) -> list[Record]:
    """Return what is given as `record` as a list, or refuse what is no record."""
    several = isinstance(record, Iterable) and not isinstance(record, str | Mapping)
    records = [] if record is None else list(record) if several else [record]
    for item in records:
        if not isinstance(item, Record):
            raise InvalidInput(f"record takes records such as il.Density(), {item!r} was given.")
    return records


def _plain(value: Any) -> Any:
    """Return options as JSON can hold them, without numbers of NumPy."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return value.item() if isinstance(value, np.generic) else value


def _labelled(plan: Plan, estimates: Estimates, results: list[Any], configuration: dict[str, Any]) -> xr.Dataset:
    """Return the dataset of a finished run."""
    names = [name for name in VARIABLES if _known(estimates.values.get(name))]
    values = {name: estimates.values[name] for name in names}
    errors = {name: estimates.errors[name] for name in names}
    observation = plan.clock.duration
    attributes: dict[str, Any] = {
        **provenance("Statistics of a network of oscillators with contacts", configuration),
        "integrator": configuration["simulate"]["integrator"]["type"],
        "step": plan.clock.step,
        "duration": observation,
        "spin_up": plan.clock.spin_up,
        "realizations": plan.realizations.number,
        "independent_samples": plan.realizations.number * samples_per_realization(plan),
        "initial": "given" if plan.start.given else plan.start.state,
        "drift": estimates.drift,
        "step_heating": estimates.heating.share,
        "step_heating_standard_error": estimates.heating.error,
    }
    if plan.method.jumps is not None:
        attributes["longest_jump"] = plan.method.jumps.steps * plan.clock.step
    dataset = statistics(list(plan.system.bodies), list(plan.system.contacts), values, errors, **attributes)
    if "peak_contact_force" in dataset:
        dataset["observation_time"] = (
            (),
            observation,
            {"units": "s", "long_name": "time over which peaks are taken"},
        )
    if plan.system.contacts:
        attrs = {
            "units": "1",
            "long_name": "number of contacts in one of the samples that standard errors come from",
            "comment": "Differences beyond 5 standard errors are possible below 20.",
        }
        dataset["contacts_per_sample"] = ("contact", estimates.contacts_per_sample, attrs)
    for index, (item, ratio) in enumerate(plan.observed.records):
        if isinstance(item, PerRealization):
            for name in names:
                dimension, units, long_name = VARIABLES[name]
                if dimension in dataset.dims and name in estimates.by_realization:
                    dataset[f"{name}_by_realization"] = (
                        ("realization", dimension),
                        estimates.by_realization[name],
                        {"units": units, "long_name": f"{long_name}, by realization"},
                    )
        interval = ratio * plan.observed.every * plan.clock.step
        variables = item.label(plan, [result.records[index] for result in results], interval)
        coordinates = {name for name, (dims, *_) in variables.items() if dims == (name,)}
        dataset = dataset.assign_coords({name: variables[name] for name in coordinates})
        dataset = dataset.assign({name: value for name, value in variables.items() if name not in coordinates})
    if "realization" in dataset.dims:
        dataset = dataset.assign_coords(realization=np.arange(plan.realizations.number))
    return dataset


def _known(value: np.ndarray | None) -> bool:
    return value is not None and not (value.size and np.isnan(value).all())
