"""Simulate a network: plan, measure the step, run, estimate, label."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.build import digest
from impactlab.assembly.compiling import announced
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.components.component import positive
from impactlab.components.stored import stored
from impactlab.errors import Diverged, ImpactLabWarning, InvalidInput, noted, unheard, warn
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.linear.damping import damped
from impactlab.linear.decay import relaxation_time
from impactlab.machine import shares_memory, workers_of
from impactlab.networks.network import Network
from impactlab.nonlinear.force_checks import explanation
from impactlab.plan.plan import Plan
from impactlab.plan.seed import seed_of
from impactlab.plan.start import realizations_of
from impactlab.progress import reporter, say
from impactlab.records.record import Record
from impactlab.records.trajectory import PairedRealizations, PerRealization, Trajectory, trajectory_size
from impactlab.results.dataset import opened, path_of, replacing, told, write
from impactlab.results.schema import unwanted, wanted_names
from impactlab.results.snapshot import AT_POINTS, QUANTITIES, STATES
from impactlab.results.stack import Findings
from impactlab.results.warned import by_kind, with_warnings
from impactlab.simulation.block import compiled
from impactlab.simulation.block_sums import BlockResult
from impactlab.simulation.ensemble import chatter, continued, endless_chatter, merged, run, run_block, slow_impacts
from impactlab.simulation.idle_bodies import joined, split
from impactlab.simulation.labelling import findings_of
from impactlab.simulation.measured_step import measured, worth_measuring
from impactlab.simulation.memory import check_memory
from impactlab.simulation.planning import make_plan
from impactlab.simulation.request import Request
from impactlab.simulation.restart import given_by
from impactlab.simulation.step_error import StepError
from impactlab.statistics.drift import DRIFT
from impactlab.statistics.ergodicity import begun_elsewhere
from impactlab.statistics.estimate import Rows, estimate
from impactlab.statistics.heating import unequal_partition

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
    initial: str | os.PathLike[str] | Mapping[str, Mapping[str, Any]] | xr.Dataset | None = None,
    record: Sequence[Record] | Record | None = None,
    statistics: str | Sequence[str] | None = None,
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
        for every label; see `impactlab.simulation.tolerance`. Friction then hardly acts at one moment of
        a step, for the sake of a smaller bias.
    max_seconds : float, optional
        Time that may be spent (s). A run that is foreseen to take longer is refused; by default any time is
        allowed, with a warning where it is more than an hour. With a tolerance, 600 by default, what was reached is
        returned with a warning; ``error_over_tolerance`` tells how far it is.
    realizations : int
        Number of independent realizations; with a tolerance the least. One is run where nothing is random.
    step : float, optional
        Time step (s); chosen from the network by default.
    integrator : Integrator, optional
        Method; `ExactFlow` by default.
    spin_up : float, optional
        Time before the statistics begin (s). By default twelve relaxation times of the slowest body, or as long as
        collisions and changes between wells take, if that is not much longer than the run; 0 if `initial` is "rest"
        or given.
    initial : str, mapping, Dataset or path, optional
        "stationary" (default: the law without contacts, drawn again while a contact is
        closed; where there is none, rest before the spin-up), "rest" (at t = 0), or ``{"displacement": {name: value},
        "velocity": {name: value}}`` (m, m s-1), 0 where nothing is named; a value is a number, or one for each
        realization. Or the result of a run with `FinalState`, or the path of its file: each realization then
        goes on from the end of its own, at t = 0 and with new noise.
    record : Record or sequence, optional
        What to keep besides the statistics.
    statistics : str or sequence of str, optional
        Names of the statistics that are wanted, all by default; those of a `tolerance` are wanted as well. Values and
        errors are the same as when all are wanted. Contacts then take less time, if none of their statistics
        but the ``contact_ratio`` is named, and the ``drift`` does not look at their forces; a tolerance needs all sums.
        The ``contact_rate`` is summed in any case for fewer than 30 realizations, since it tells whether events are
        rare.
    rng : optional
        Seed as NumPy takes it (SPEC 7): None, int, SeedSequence, Generator. Streams are
        keyed by seed, realization, name of the body or the source, and step; or interval, in runs
        with contact-free intervals.
    executor : concurrent.futures.Executor, optional
        Where blocks of realizations run; threads on all cores by default. Numbers never
        depend on it.
    progress : bool or callable, optional
        Progress bar, with a statistic and its error so far; by default on long runs in a terminal or a notebook. A
        function is called with the part that is done.
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
    allowed = None if max_seconds is None else positive("max_seconds", max_seconds)
    if tolerance is None:
        request = request_of(
            network, duration, realizations, step, integrator, spin_up, initial, record, statistics, rng
        )
        return _simulate(network, request, Execution(executor, progress, math.inf if allowed is None else allowed, out))
    from impactlab.simulation.tolerance import RELAXATION_TIMES, checked, method_for, reach, without_realizations

    method, seed = integrator or ExactFlow(), seed_of(rng)
    records = Record.all_of(record)
    initial = given_by(initial, network, seed)
    if out is not None:
        raise InvalidInput(
            "simulate cannot write to out= until a tolerance is reached; give duration=, or use il.save afterwards."
        )
    if realizations_of(initial) > 1:
        raise InvalidInput(
            "With a tolerance the number of realizations is not known before, so that none can have a start of its "
            "own; give duration= without a tolerance."
        )
    model = Model.of(network)
    tolerances = checked(tolerance, model)
    wanted = wanted_names(statistics)
    wanted = None if wanted is None else tuple(dict.fromkeys((*wanted, *tolerances)))
    longest = math.inf if duration is None else positive("duration", duration)
    length = min(longest, RELAXATION_TIMES * relaxation_time(damped(model)[1]))
    asked = any(isinstance(item, PerRealization) for item in records)
    kept = records if asked else [*records, PairedRealizations()]
    method = method_for(model, method)
    request = Request(length, realizations, step, method, spin_up, initial, kept, seed, statistics=wanted)

    def ensemble(number: int, chosen: float | None, coarse: bool) -> Ensemble:
        one = replace(request, realizations=number, step=chosen, coarse=coarse)
        return Ensemble(model, one, Execution(executor, growing=True), compared=True)

    with announced(progress), noted() as given:
        result = reach(ensemble, tolerances, SECONDS if allowed is None else allowed, request, reporter(progress))
    result = with_warnings(Findings.of(result), by_kind(given)).dataset() if given else result
    result = result if wanted is None else result.drop_vars(unwanted(wanted), errors="ignore")
    return result if asked else without_realizations(result)


def request_of(
    network: Network,
    duration: float | None = None,
    realizations: int = 1,
    step: float | None = None,
    integrator: Integrator | None = None,
    spin_up: float | None = None,
    initial: Any = None,
    record: Sequence[Record] | Record | None = None,
    statistics: str | Sequence[str] | None = None,
    rng: Any = None,
) -> Request:
    """Return the request of a run without a tolerance; parameters are those of `simulate`."""
    if duration is None:
        raise InvalidInput("simulate needs a duration (s), or a tolerance.")
    method, seed = integrator or ExactFlow(), seed_of(rng)
    given = given_by(initial, network, seed)
    records, wanted = Record.all_of(record), wanted_names(statistics)
    return Request(duration, realizations, step, method, spin_up, given, records, seed, statistics=wanted)


def _simulate(network: Network, request: Request, execution: Execution) -> xr.Dataset:
    """Return the dataset of a request."""
    out, progress = execution.out, reporter(execution.progress)
    files = contextlib.nullcontext() if out is None else replacing(path_of(out))
    with announced(execution.progress), files as temporary, noted() as given:
        ensemble = Ensemble(Model.of(network), request, execution)
        ensemble.grow(ensemble.number, progress, temporary)
        dataset = with_warnings(ensemble.findings(), by_kind(given)).dataset()
        if out is None or temporary is None:
            return dataset
        streamed = any(isinstance(item, Trajectory) for item in request.records)
        with told(str(out), temporary):
            write(dataset, temporary, append=streamed)
    return opened(path_of(out), lazy=(*QUANTITIES, STATES.name, *(item.name for item in AT_POINTS.values())))


@dataclass(frozen=True)
class Execution:
    """Where a run happens, and what it may take; parameters are those of `simulate`."""

    executor: Executor | None = None
    progress: bool | Callable[[float], None] | None = None
    seconds: float = math.inf  # time that it may be foreseen to take (s)
    out: str | os.PathLike[str] | None = None
    growing: bool = False
    """Whether realizations will be added: the dataset then has the step as if it were given."""

    def __post_init__(self) -> None:
        if self.executor is not None and not isinstance(self.executor, Executor):
            raise InvalidInput(f"executor must be a concurrent.futures.Executor, not {self.executor!r}.")

    @property
    def workers(self) -> int:
        """Number of blocks that run at once."""
        return workers_of(self.executor)


class Ensemble:
    """Realizations of a network at one step, to which more can be added: together they are as one run of them all.

    Parameters
    ----------
    model : Model
    request : Request
        What to run, and how many realizations there are to be at first; where nothing is random one tells all.
    execution : Execution
    compared : bool
        Whether the step need not be measured, since it is compared with another.
    """

    def __init__(self, model: Model, request: Request, execution: Execution, compared: bool = False) -> None:
        starts = realizations_of(request.initial)
        if starts not in (1, request.realizations):
            raise InvalidInput(
                f"initial has the values of {starts} realizations, but there are to be {request.realizations}; give "
                f"realizations={starts}."
            )
        self.network, self.growing = model.network, execution.growing
        self.alike = starts == 1 and not model.random.any()
        number = 1 if self.alike else request.realizations
        self.request = replace(request, realizations=number, workers=execution.workers)
        # those that judge whether a tolerance is reached need all statistics
        summed = None if self.growing else request.statistics
        self.text = digest(generate(model))
        apart = split(model, request.integrator, request.initial, request.records)
        if apart is None:
            self.parts = [Part(model, replace(self.request, statistics=summed), execution, compared)]
        else:
            first = replace(self.request, statistics=summed)
            requests = first, replace(first, step=None, coarse=False)
            both = zip(map(Model.of, apart), requests, strict=True)
            self.parts = [Part(part, own, execution, compared) for part, own in both]

    @property
    def plan(self) -> Plan:
        """The plan of the realizations that there are, or are to be at first; without idle bodies."""
        return self.parts[0].plan

    @property
    def number(self) -> int:
        """How many these are."""
        return self.plan.realizations.number

    @property
    def exact(self) -> bool:
        """Whether the step makes no error: states are samples of a linear stationary motion."""
        return self.plan.observed.sampled and not self.parts[0].model.nonlinear_bodies.any()

    def seconds(self) -> float:
        """Return the time that the first of them will take, roughly (s)."""
        return sum(part.plan.seconds(part.request.workers) for part in self.parts)

    def compile(self) -> None:
        """Compile what is not in the cache, so that the time of realizations can be measured."""
        for part in self.parts:
            if shares_memory(part.execution.executor):
                compiled(part.plan)

    def grow(self, number: int, progress: Callable[[float], None], file: Path | None = None) -> None:
        """Run the realizations that are missing; trajectories go to a file if there is one.

        Those that were planned with other contact-free intervals than so many are do not count: all are run anew.
        """
        for part in self.parts:
            part.grow(number, progress, file)

    def take(self, results: list[BlockResult], rows: Rows) -> None:
        """Take what the realizations found beside other networks, and measure the step if need be."""
        (part,) = self.parts
        part.results, part.rows = results, rows
        if part.worth_measuring:
            part.measure()

    def dataset(self) -> xr.Dataset:
        """Return the statistics of all realizations, and what records kept of them."""
        return self.findings().dataset()

    def findings(self) -> Findings:
        """Return what the dataset holds."""
        step = self.plan.clock.step if self.growing else self.request.step
        asked = [record for record in self.request.records if not isinstance(record, PairedRealizations)]
        options = replace(self.request, realizations=self.number, step=step, records=asked).options()
        configuration = {"network": stored(self.network), "simulate": _plain(options), "text": self.text}
        found = [part.findings(configuration) for part in self.parts]
        parts = [item.dataset() for item in found] if len(found) > 1 else []
        whole = Findings.of(joined(self.network, *parts)) if parts else found[0]
        if self.alike:
            whole.attributes["deterministic"] = "Nothing is random: one realization tells all, without standard errors."
        if self.request.statistics is None or self.growing:
            return whole
        others = unwanted(self.request.statistics)
        return whole._replace(variables={name: item for name, item in whole.variables.items() if name not in others})


class Part:
    """Realizations of a network, or of a part of it that nothing connects with the rest."""

    def __init__(self, model: Model, request: Request, execution: Execution, compared: bool) -> None:
        self.model, self.request, self.execution = model, request, execution
        self.results: list[BlockResult] = []
        self.rows: Rows | None = None  # what is known of them
        self.error: StepError | None = None
        self.plan = make_plan(model, request)
        if not compared and self.plan.seconds(request.workers) <= execution.seconds and self.worth_measuring:
            self.measure()

    @property
    def worth_measuring(self) -> bool:
        """Whether nothing but a measurement tells what the step does."""
        return worth_measuring(self.plan, self.model, self.request.integrator, self.request.step)

    def measure(self) -> None:
        """Measure what the step does; choose another where it was not given, whatever the records."""
        from impactlab.simulation.segments import step_error  # loaded only here

        model, free, velocities = self.model, self.request.step is None, dict[Plan, np.ndarray | None]()
        alone = replace(self.request, records=[]) if free else self.request

        def tried(longest_step: float, velocity: np.ndarray | None = None, request: Request = alone) -> Plan:
            with unheard():  # the first plan has said it
                plan = make_plan(model, replace(request, longest_step=longest_step, mean_square_velocity=velocity))
            velocities[plan] = velocity
            return plan

        def sampled(plan: Plan) -> Plan:
            return tried(plan.clock.step, velocities[plan], self.request) if self.request.records else plan

        with self._explained(self.plan):
            measure = partial(step_error, partial(make_plan, model), model, alone.initial)
            first = tried(math.inf) if free and self.request.records else self.plan
            self.plan, self.error = measured(tried, measure, first, sampled if free else None)

    def grow(self, number: int, progress: Callable[[float], None], file: Path | None) -> None:
        """Run the realizations that are missing of so many."""
        plan = self.plan
        if self.results or number != plan.realizations.number:
            with unheard():
                plan = make_plan(self.model, replace(self.request, realizations=number, step=plan.clock.step))
        results = self.results if _as_before(plan, self.plan) else []
        first = self.plan.realizations.number if results else 0
        missing = replace(plan, realizations=replace(plan.realizations, first=first))
        with self._explained(plan):
            ran, more = _run(missing, self.execution, progress, file)
        self.results, self.rows = continued(results, more, plan), None
        self.plan = replace(plan, observed=ran.observed)

    def findings(self, configuration: dict[str, Any]) -> Findings:
        """Return what the dataset of all realizations holds."""
        wandering = "" if self.error is None else self.error.wandering
        found = _estimated(self.plan, self.request, self.results, self.rows, configuration, wandering)
        if self.error is None:
            return found
        dataset = found.dataset()
        sampled = self.plan.random and not self.plan.realizations.trusted
        if message := self.error.doubt(dataset, sampled, self.plan.steady, self.plan.clock.automatic):
            warn("unknown_step_bias", message)
        return Findings.of(self.error.told().with_order().added_to(dataset, self.plan.clock.automatic))

    @contextlib.contextmanager
    def _explained(self, plan: Plan) -> Iterator[None]:
        """Say what may be wrong with forces under which a realization diverges."""
        try:
            yield
        except Diverged as diverged:
            raise Diverged(f"{diverged}{explanation(self.model, plan.observed.window)}") from None


def _as_before(plan: Plan, before: Plan) -> bool:
    """Whether realizations of two plans, of one request but for their number, have the same random numbers and sums."""
    return plan.method.interval == before.method.interval and plan.clock.boundaries == before.clock.boundaries


def _run(
    plan: Plan, execution: Execution, progress: Callable[[float], None], file: Path | None
) -> tuple[Plan, list[BlockResult]]:
    """Run a plan; return it, with what took its trajectories if there is a file for them, and what its blocks found."""
    executor, seconds = execution.executor, execution.seconds
    foreseen = plan.seconds(execution.workers)
    if foreseen > seconds:
        raise InvalidInput(
            f"{plan.announced(foreseen)}, but {max(seconds, 0.0):.2g} s are left. Give a larger max_seconds= or "
            "tolerance=, a shorter duration= or spin_up=, or fewer realizations."
        )
    if foreseen > LONG and not execution.growing:  # then the time is limited
        warn("long_run", f"{plan.announced(foreseen)}. Give max_seconds= to refuse such runs.", ImpactLabWarning)
    size = trajectory_size(plan)
    check_memory(plan, execution.workers, size if file is None else 0)
    with contextlib.ExitStack() as stack:
        if size and file is not None:
            if not shares_memory(executor):
                raise InvalidInput("Trajectories are written to a file from threads only: leave out executor= or out=.")
            from impactlab.records.trajectory_file import written  # loaded only here

            say(execution.progress, f"Trajectories: up to {size / 1e9:.3g} GB")
            plan = stack.enter_context(written(plan, file, file.parent))
        return plan, run(plan, executor, progress)


def _estimated(
    plan: Plan,
    request: Request,
    results: list[BlockResult],
    rows: Rows | None,
    configuration: dict[str, Any],
    wandering: str,
) -> Findings:
    """Return what the dataset of a finished run holds, and warn of what it leaves open.

    A text on `wandering` says that small errors change the path, where no other start is known to do so.
    """
    estimates = estimate(plan, *merged(results), rows=rows)
    if message := endless_chatter(plan, results):
        warn("many_impacts", message)
    slowest_counted = slow_impacts(plan, results)
    if request.statistics is not None and "contact_rate" not in request.statistics:
        slowest_counted[:] = np.nan
    if message := chatter(plan, slowest_counted):
        warn("chatter", message)
    drifting = plan.steady and estimates.drift > DRIFT
    from_rest = not plan.start.given and plan.start.state == "rest" and not plan.clock.spin_up_steps
    transient = from_rest and request.from_rest
    if estimates.values.unbalanced and plan.steady and (plan.clock.settled or not (drifting or from_rest)):
        warn("balance", estimates.values.unbalanced)
    if drifting and not transient:
        warn(
            "drift",
            f"The two halves of the run differ by {estimates.drift:.1f} standard errors: the spin-up of "
            f"{plan.clock.spin_up:g} s may be too short. Give a longer spin_up=.",
        )
    paths = any(isinstance(record, Trajectory) for record in request.records)
    if drifting and transient and request.spin_up is None and not paths:
        warn(
            "transient",
            f"Means contain the transient from rest: the two halves of the run differ by {estimates.drift:.1f} "
            "standard errors. Give spin_up= (s) for stationary means, or spin_up=0.0 if the transient is wanted.",
        )
    usual = request.initial is None and not plan.noise.coarse
    elsewhere = begun_elsewhere(plan, results[0].bodies, lambda other: run_block(other, 0).bodies) if usual else ""
    if message := estimates.remembered or elsewhere:
        warn("several_motions", message)
    elif wandering:
        warn("chaotic_path", wandering)
    if not plan.noise.coarse and not drifting:
        partition = unequal_partition(plan, *estimates.values.combined["mean_square_velocity"])
        if message := estimates.heating.warning or partition:
            warn("heating", message)
    return findings_of(plan, estimates, results, slowest_counted, configuration)


def _plain(value: Any) -> Any:
    """Return options as JSON can hold them, without numbers of NumPy."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value
