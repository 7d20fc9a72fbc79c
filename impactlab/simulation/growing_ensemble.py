"""Realizations of a network at one step, to which more can be added."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from impactlab.allowed_time import allowed_time, time_left
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.build import digest
from impactlab.components.stored import stored
from impactlab.errors import LONG_TIME, Diverged, ImpactLabWarning, InvalidInput, unheard, warn
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.machine import shares_memory
from impactlab.networks.network import Network
from impactlab.plan.plan import Plan
from impactlab.plan.realizations import lane_seconds
from impactlab.plan.request import Request
from impactlab.plan.seed import seed_of
from impactlab.plan.start import realizations_of
from impactlab.progress import say
from impactlab.records.record import Record
from impactlab.records.trajectory import PairedRealizations, trajectory_size
from impactlab.results.schema import unwanted, wanted_names
from impactlab.results.stack import Findings
from impactlab.simulation.block import Block, compiled
from impactlab.simulation.block_sums import BlockResult
from impactlab.simulation.ensemble import Execution, continued, run, run_block, whole_blocks
from impactlab.simulation.idle_bodies import joined, split
from impactlab.simulation.labelling import estimated, records_alone, warn_of_losses
from impactlab.simulation.memory_use import check_memory
from impactlab.simulation.planning import make_plan
from impactlab.simulation.restart import given_by
from impactlab.statistics.estimate import Rows
from impactlab.step_control.measured.measured_step import measured, worth_measuring
from impactlab.step_control.measured.step_bias import StepBias
from impactlab.step_control.rules.force_checks import explanation

USUAL = ExactFlow()
"""The method that makes steps, where none is given."""

STEP_SECONDS = 2e-7
"""Time of a step of one realization, beside that of its bodies and contacts (s)."""


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
    on_divergence: str = "keep",
) -> Request:
    """Return the request of a run without a tolerance; parameters are those of `simulate`."""
    if duration is None:
        raise InvalidInput("simulate needs a duration (s), or a tolerance.")
    method, seed = integrator or USUAL, seed_of(rng)
    given = None if initial is None else given_by(initial, network, seed)
    records, wanted = [] if record is None else Record.all_of(record), wanted_names(statistics)
    return Request(
        duration, realizations, step, method, spin_up, given, records, seed, statistics=wanted,
        on_divergence=on_divergence,
    )  # fmt: skip


def seconds_of_steps(model: Model, request: Request) -> float:
    """Return the time of one core that the steps of a run take: the same on any machine, infinite without steps (s)."""
    starts = realizations_of(request.initial)
    try:
        with unheard():
            clock = make_plan(model, replace(request, integrator=USUAL, realizations=starts)).clock
    except InvalidInput:
        return math.inf
    return clock.all_steps * (
        STEP_SECONDS + starts * lane_seconds(len(model.bodies), len(model.links), len(model.members.states))
    )


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
        """Number of these realizations."""
        return self.plan.realizations.number

    @property
    def exact(self) -> bool:
        """Whether the step makes no error: states are samples of a linear stationary motion."""
        return self.plan.observed.sampled and not self.parts[0].model.kicks.nonlinear.any()

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
        """Return the statistics of all realizations and the data of records."""
        return self.findings().dataset()

    def findings(self) -> Findings:
        """Return the variables and attributes of the dataset."""
        step = self.plan.clock.step if self.growing else self.request.step
        asked = [record for record in self.request.records if not isinstance(record, PairedRealizations)]
        options = replace(self.request, realizations=self.number, step=step, records=asked).options()
        configuration = {"network": stored(self.network), "simulate": options, "text": self.text}
        found = [part.findings(configuration) for part in self.parts]
        parts = [item.dataset() for item in found] if len(found) > 1 else []
        whole = Findings.of(joined(self.network, *parts)) if parts else found[0]
        if self.alike:
            whole.attributes["deterministic"] = (
                "Nothing is random: one realization tells all of a start, without standard errors."
            )
        if self.request.statistics is None or self.growing:
            return whole
        others = unwanted(self.request.statistics)
        return whole._replace(variables={name: item for name, item in whole.variables.items() if name not in others})


class Part:
    """Realizations of a network, or of bodies that nothing connects with the rest of the network."""

    def __init__(self, model: Model, request: Request, execution: Execution, compared: bool) -> None:
        self.model, self.request, self.execution = model, request, execution
        self.results: list[BlockResult] = []
        self.rows: Rows | None = None  # what is known of them
        self.bias: StepBias | None = None
        self.plan = make_plan(model, request)
        affordable = self.plan.seconds(request.workers) <= time_left()
        if not compared and affordable and self.worth_measuring:
            self.measure()

    @property
    def worth_measuring(self) -> bool:
        """Whether the bias of the step can only be found by a measurement."""
        return worth_measuring(self.plan, self.model, self.request.integrator, self.request.step)

    def measure(self) -> None:
        """Measure what the step does; choose another where it was not given, whatever the records."""
        from impactlab.step_control.measured.segments import Runs, step_bias  # loaded only here

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
            measure = partial(step_bias, Runs(partial(make_plan, model), Block), model, alone.initial)
            first = tried(math.inf) if free and self.request.records else self.plan
            self.plan, self.bias = measured(tried, measure, first, sampled if free else None)

    def grow(self, number: int, progress: Callable[[float], None], file: Path | None) -> None:
        """Run the realizations that are missing of so many."""
        plan = self.plan
        if self.results or number != plan.realizations.number:
            with unheard():
                plan = make_plan(self.model, replace(self.request, realizations=number, step=plan.clock.step))
        results = self.results if self.results and _as_before(plan, self.plan) else []
        before = self.plan.realizations.losses if results else ()
        first = self.plan.realizations.number if results else 0
        missing = replace(plan, realizations=replace(plan.realizations, first=first))
        with self._explained(plan):
            ran, more = run_plan(missing, self.execution, progress, file)
        self.results, self.rows = continued(results, more, plan) if results else more, None
        losses = [*before, *ran.realizations.losses]
        self.plan = replace(plan.without(losses) if losses else plan, observed=ran.observed)

    def findings(self, configuration: dict[str, Any]) -> Findings:
        """Return the variables and attributes of the dataset of all realizations."""
        warn_of_losses(self.plan, explanation(self.model, self.plan.observed.window))
        if self.plan.observed.ends:
            return records_alone(self.plan, self.results, configuration)
        wandering = "" if self.bias is None else self.bias.wandering
        found = estimated(self.plan, self.request, self.results, self.rows, configuration, wandering, run_block)
        if self.bias is None:
            return found
        dataset = found.dataset()
        sampled = self.plan.random and not self.plan.realizations.trusted
        if message := self.bias.warning(dataset, sampled, self.plan.steady, self.plan.clock.automatic):
            warn("unknown_step_bias", message)
        return Findings.of(self.bias.told().with_order().added_to(dataset, self.plan.clock.automatic))

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


def run_plan(
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
    if foreseen > LONG_TIME and not execution.growing:  # then the time is limited
        warn("long_run", f"{plan.announced(foreseen)}. Give max_seconds= to refuse such runs.", ImpactLabWarning)
    size = trajectory_size(plan) if plan.observed.records else 0
    check_memory(plan, execution.workers, size if file is None else 0)
    with contextlib.ExitStack() as stack:
        if size and file is not None:
            if not shares_memory(executor):
                raise InvalidInput("Trajectories are written to a file from threads only: leave out executor= or out=.")
            from impactlab.records.trajectory_file import lose_paths, written  # loaded only here

            say(execution.progress, f"Trajectories: up to {size / 1e9:.3g} GB")
            plan = stack.enter_context(written(plan, file, file.parent))
        ran, results = whole_blocks(plan, run(plan, executor, progress, execution.checkpoint))
        if ran.realizations.losses and size and file is not None:
            lose_paths(ran)
        return ran, results


def ensemble_since(reason: str, model: Model, request: Request, execution: Execution) -> Ensemble:
    """Return an ensemble whose steps are made for a reason, which its errors tell."""
    try:
        with allowed_time(execution.seconds):
            ensemble = Ensemble(model, request, execution)
            for part in ensemble.parts:
                part.execution = replace(execution, seconds=time_left())
            return ensemble
    except InvalidInput as error:
        if not reason or str(error).startswith(reason.rstrip(".")):
            raise
        raise InvalidInput(f"{error} Steps were to be made: {reason}") from error
