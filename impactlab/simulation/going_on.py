"""Runs that go on from the end of an earlier one: its realizations continue, or new ones branch off."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.build import digest
from impactlab.components.stored import json_of, stored
from impactlab.errors import InvalidInput
from impactlab.integrators.base import Integrator
from impactlab.located.earlier_runs import Earlier
from impactlab.located.event_located import EventLocated
from impactlab.networks.network import Network
from impactlab.plan.plan import Plan
from impactlab.plan.request import Request
from impactlab.plan.seed import Seed
from impactlab.plan.start import filters_of, start_of, states_of
from impactlab.records.final_state import CONTINUATION
from impactlab.records.record import Record
from impactlab.results.dataset import parsed
from impactlab.results.schema import wanted_names
from impactlab.results.stack import Findings
from impactlab.simulation.block import MADE
from impactlab.simulation.block_sums import BlockResult
from impactlab.simulation.ensemble import run_block
from impactlab.simulation.labelling import estimated, warn_of_losses
from impactlab.simulation.planning import make_plan
from impactlab.simulation.restart import given_by, run_of, source_of, time_of


@dataclass(frozen=True, eq=False)
class Onward:
    """How a run goes on from the end of an earlier one.

    Parameters
    ----------
    network : Network
        That of both runs.
    state : Dataset
        The end of the earlier run.
    run : mapping
        Its options.
    branch : int, optional
        Number of branches of each realization; None where the realizations continue.
    """

    network: Network
    state: xr.Dataset
    run: Mapping[str, Any]
    branch: int | None

    @property
    def makes_steps(self) -> bool:
        """Whether both runs make steps."""
        return bool(self.run["integrator"]["type"] != EventLocated.__name__)

    @property
    def rows(self) -> np.ndarray:
        """Numbers from which realizations continue, (number, realization)."""
        rows: np.ndarray = self.state[CONTINUATION].transpose("number", "realization").values
        return rows

    def request(self, duration: float | None, record: Sequence[Record] | Record | None, statistics: Any) -> Request:
        """Return the request of the run that goes on."""
        if duration is None:
            raise InvalidInput("simulate needs a duration (s).")
        run, times = self.run, self.branch or 1
        given = given_by(self.state, self.network, None)
        initial = {
            quantity: {name: np.repeat(values, times).tolist() for name, values in of_all.items()}
            for quantity, of_all in given.items()
        }
        return Request(
            duration, times * self.state.sizes["realization"], run["step"], Integrator.from_dict(run["integrator"]),
            0.0, initial, [] if record is None else Record.all_of(record), Seed(*run["seed"]), endless=True,
            statistics=wanted_names(statistics),
        )  # fmt: skip

    @property
    def earlier(self) -> Earlier:
        """The end of an earlier run without steps."""
        return Earlier(time_of(self.state) or 0.0, self.rows.T)

    def alike(self, request: Request, workers: int) -> Request:
        """Return a request with the start of the earlier run, so that the same is noted from step to step."""
        return replace(request, initial=self.run["initial"], spin_up=self.run["spin_up"], workers=workers)

    def configuration(self, model: Model, alike: Request) -> dict[str, Any]:
        """Return what is stored with a result that has steps."""
        own = {"continues": True} if self.branch is None else {"branch": self.branch}
        options = {**alike.options(), **own}
        return {"network": stored(self.network), "simulate": options, "text": digest(generate(model))}

    def findings(
        self, model: Model, request: Request, workers: int, run: Callable[[Plan], tuple[Plan, list[BlockResult]]]
    ) -> Findings:
        """Return the variables and attributes of the dataset of the steps from the state on, which `run` makes."""
        alike = self.alike(request, workers)
        ran, results = run(self.plan(model, request, alike))
        warn_of_losses(ran)
        return estimated(ran, request, results, None, self.configuration(model, alike), "", run_block)

    def plan(self, model: Model, request: Request, alike: Request) -> Plan:
        """Return the plan of the steps from the state on."""
        time = time_of(self.state) or 0.0
        plan = make_plan(model, replace(alike, records=[record.going_on(time) for record in alike.records]))
        self._check(plan)
        now = round(time / plan.clock.step)
        initial, numbers = request.initial, self.state["realization"].values.astype(int)
        state, laws, filters = start_of(initial, model), states_of(initial, model), filters_of(initial, model)
        assert isinstance(state, np.ndarray)
        if self.branch is None:
            first, before = int(numbers[0]), int(self.rows[MADE, 0]) - now
            start = replace(plan.start, state=state, laws=laws, continuation=self.rows)
        else:
            first, before = int(numbers.max()) + 1, -now
            for part in plan.events.parts:
                part.check(model, state[0])
            state, laws, filters = (_turned(values, first) for values in (state, laws, filters))
            start = replace(plan.start, state=state, laws=laws, filters=filters)
        return replace(
            plan, start=start, clock=replace(plan.clock, spin_up_steps=before, begin=now),
            realizations=replace(plan.realizations, numbered_from=first),
        )  # fmt: skip

    def _check(self, plan: Plan) -> None:
        """Refuse a run with steps that cannot go on."""
        if plan.driving.lines:
            raise InvalidInput(
                "Sums of cosines were sampled for the earlier run only: give that one a longer duration=, or advance "
                "an il.Run with duration= in parts."
            )
        time = time_of(self.state) or 0.0
        for record, _ in plan.observed.records:
            period = getattr(record, "period", None)
            if period and abs(time / period - round(time / period)) > 1e-9 * max(1.0, time / period):
                raise InvalidInput(
                    f"{type(record).__name__}: this run begins at {time:g} s, which is not a whole number of periods "
                    f"of {period:g} s; end the earlier run at such a time."
                )
        apart = np.diff(self.state["realization"].values.astype(int)) != 1
        if self.branch is None and (apart.any() or np.diff(self.rows[MADE]).any()):
            raise InvalidInput(
                "These realizations did not all begin at once, or some of them were retired: continue them with "
                "il.Run(network, initial=…, continues=True)."
            )


def _turned(values: Any, first: int) -> Any:
    """Return values, (…, realization), which realizations from the first one on find by number, modulo how many."""
    return None if values is None else np.roll(values, first % values.shape[-1], axis=-1)


def onward(
    network: Network, initial: Any, continues: bool, branch: int | None, options: Mapping[str, Any]
) -> Onward | None:
    """Return how a run goes on from `initial`, None where it only begins there; see `impactlab.simulate`.

    Of the `options` none may be given.
    """
    if not continues and branch is None:
        return None
    if continues and branch is not None:
        raise InvalidInput("Realizations continue, or new ones branch off: give continues=True or branch=, not both.")
    if branch is not None and (not isinstance(branch, int) or isinstance(branch, bool) or branch < 1):
        raise InvalidInput(f"branch is the number of branches of each realization, from 1 on, not {branch!r}.")
    for name, value in options.items():
        if value is not None:
            raise InvalidInput(
                "A run that goes on from an earlier one has its realizations, step, method and random numbers, and no "
                f"spin-up or tolerance: leave out {name}=."
            )
    state = source_of(initial)
    theirs, model = run_of(state), Model.of(network)
    if parsed(json_of({"network": stored(network)}))["network"] != theirs["network"]:
        raise InvalidInput(
            "The earlier run was one of another network; without continues=True or branch= its end is a start."
        )
    if digest(generate(model)) != theirs["text"]:
        raise InvalidInput("The kernel of a component, or impactlab, has changed since the earlier run.")
    if branch is not None and not model.random.any():
        raise InvalidInput("Nothing is random: branches would all be alike. Give continues=True.")
    return Onward(network, state, theirs["run"], branch)
