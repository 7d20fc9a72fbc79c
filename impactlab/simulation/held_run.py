"""A run that one can hold: advanced, looked at, restarted, branched, and asked for events."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.announced import announced
from impactlab.compiling.build import digest
from impactlab.components.stored import json_of, stored
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, finite, positive
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.linear.damping import damped
from impactlab.linear.decay import relaxation_time
from impactlab.located.event_located import EventLocated
from impactlab.machine import Result, Tally, begin, cores, hand_over
from impactlab.networks.network import Network
from impactlab.plan.clock import BATCH_TIMES, BATCHES, LENGTH, MOST_SAMPLES, enough_units
from impactlab.plan.driving import check_ends
from impactlab.plan.plan import Plan
from impactlab.plan.request import Request
from impactlab.plan.start import filters_of, realizations_of, start_of, states_of
from impactlab.records.final_state import CONTINUATION, FINAL, FinalState, name_of
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.dataset import BEGIN, CONFIGURATION, parsed, provenance
from impactlab.results.snapshot import QUANTITIES, REALIZATION, places_of
from impactlab.simulation.block import MADE, Block
from impactlab.simulation.block_sums import BlockResult, remarks_on_events
from impactlab.simulation.ensemble import Execution, opened
from impactlab.simulation.event import Event, Occurred, occurred
from impactlab.simulation.growing_ensemble import Part, request_of
from impactlab.simulation.held_block import HeldBlock
from impactlab.simulation.labelling import findings_of
from impactlab.simulation.planning import make_plan
from impactlab.simulation.restart import given_by, run_of, source_of, time_of
from impactlab.statistics.estimate import estimate

if TYPE_CHECKING:
    import xarray as xr

CONTINUED = {"step": "step", "integrator": "method", "seed": "rng"}
"""Options that a run and the state from which it continues share."""


@checked
class Run:
    """A run of a network that is held, and advances on request.

    It begins at t = 0, after its spin-up. Realizations have numbers that are never used again in a run, and that
    determine their noise; those that begin by `restart` or `branch` have new numbers, and so new noise, unless
    they continue. Advancing by 50 s and then by 50 s gives the bits of 100 s, also where the second part continues
    from the saved `state` of the first one in another process. Close a run, or use it in a ``with`` statement; an error
    while it advances closes it.

    Parameters
    ----------
    network : Network
    realizations : int
        Number of realizations.
    step : float, optional
        Time step (s). By default it is chosen and measured as `simulate` does, for 100 relaxation times (or the
        `duration`), and made a little smaller: so that `interval`, or else a power of ten seconds, is a whole number
        of steps. A given step is not measured.
    interval : float, optional
        Time of which steps are a whole part (s), such as the period of a force.
    duration : float, optional
        Time beyond which the run will not go (s); needed with sums of cosines, whose samples are made at once, and
        where nothing is damped and no `step` is given.
    integrator : Integrator, optional
        Method; `ExactFlow` by default, without contact-free intervals, also where nothing is random: a held run makes
        steps.
    spin_up, initial, rng : optional
        As for `simulate`.
    continues : bool
        Whether the run takes up the run of which `initial` is the `state`, a result with
        ``FinalState(continues=True)``, or the path of its file, at its time: with the same realizations, step, method
        and random numbers, bit for bit. None of them is then given.
    events : mapping of str to Event, optional
        Events to look for, by name.

    Raises
    ------
    InvalidInput
        If an argument cannot be used.
    Diverged
        If a realization left the range of finite numbers, here or in `advance`.

    Examples
    --------
    >>> import impactlab as il
    >>> ball = il.LinearOscillator.from_frequency(6.0, damping_ratio=0.05)
    >>> network = il.Network({"ball": ball}, excitations={"ball": il.WhiteNoise(0.01)})
    >>> with il.Run(network, realizations=64, rng=1) as run:
    ...     run.advance(10.0)
    ...     run.time, run.state.sizes["realization"]
    (10.0, 64)
    """

    def __init__(
        self,
        network: Network,
        *,
        realizations: int = 1,
        step: float | None = None,
        interval: float | None = None,
        duration: float | None = None,
        integrator: Integrator | None = None,
        spin_up: float | None = None,
        initial: Any = None,
        rng: Any = None,
        continues: bool = False,
        events: Mapping[str, Event] | None = None,
    ) -> None:
        self._closed = True  # until all is there
        self._events = dict(events or {})
        self._network, self._model = network, Model.of(network)
        self._longest = math.inf if duration is None else positive("duration", duration)
        self._interval = None if interval is None else positive("interval", interval)
        begun = source_of(initial) if continues else None
        if begun is None:
            options = self._asked(duration, realizations, step, integrator, spin_up, initial, rng)
        elif realizations != 1 or any(item is not None for item in (step, integrator, spin_up, rng)):
            raise InvalidInput(
                "A run that continues has the realizations, step, method, spin-up and rng of the earlier run: give "
                "none of them."
            )
        else:
            options = _request_of(_with_steps(begun))
        self._request = replace(options, workers=cores(), endless=True)
        with announced(None):
            self._request = replace(self._request, step=self._chosen_step(options.step))
            self._plan = self._planned(options.realizations)
            if self._plan.driving.lines and continues:
                self._longest = min(self._longest, options.duration)
            elif self._plan.driving.lines and duration is None:
                raise InvalidInput("A run with sums of cosines needs a duration= (s): their samples are made at once.")
            self._pool, self._tally = ThreadPoolExecutor(cores()), Tally()
            self._now, self._next, self._occurred = 0, 0, list[tuple[np.ndarray, Occurred]]()
            self._blocks: list[HeldBlock] = []
            self._made: dict[int, int] = {}
            """Steps that realizations have made that run no more, by number."""
            if begun is None:
                self._blocks = self._begun(self._plan, options.realizations)
                self._each(lambda item: item.block.advance(self._plan.clock.spin_up_steps, None))
            else:
                self._blocks, self._now = self._continued(begun)
        self._begin(self._plan.transient or continues)
        self._closed = False

    def _asked(
        self, duration: float | None, realizations: int, step: float | None, integrator: Integrator | None,
        spin_up: float | None, initial: Any, rng: Any,
    ) -> Request:  # fmt: skip
        """Return the request of a run that begins."""
        length = duration or LENGTH * relaxation_time(damped(self._model)[1])  # cosines are sampled for all of it
        if not 0.0 < length < math.inf:
            if step is None:
                raise InvalidInput("Nothing damps this network: give il.Run a step= or a duration= (s).")
            length = LENGTH * positive("step", step)
        method = integrator or ExactFlow()
        if isinstance(method, ExactFlow):
            method = method.replace(jumps=False)  # a run may end at any step
        request = request_of(self._network, length, realizations, step, method, spin_up, initial, rng=rng)
        starts = realizations_of(request.initial)
        if starts not in (1, request.realizations):
            raise InvalidInput(f"initial has the values of {starts} realizations; give realizations={starts}.")
        return request

    def _chosen_step(self, given: float | None) -> float:
        """Return the step: a part of the interval, or of a power of ten seconds (s)."""
        interval = self._interval
        if given is not None:
            ratio = 1.0 if interval is None else interval / given
            if not ratio < 2**53 or abs(ratio - round(ratio)) > 1e-9 * ratio:
                raise InvalidInput(f"interval={interval:g} s is not a whole number of steps of {given:g} s.")
            return given
        chosen = Part(self._model, replace(self._request, endless=False), Execution(), compared=False).plan.clock.step
        # the step divides a decimal part of a second into five steps or more
        whole = 10.0 ** math.ceil(math.log10(5 * chosen)) if interval is None else interval
        return whole / math.ceil(whole / chosen * (1.0 - 1e-12))

    def _planned(self, realizations: int) -> Plan:
        """Return the plan of so many realizations, with a snapshot of every step where events are looked for."""
        plan = make_plan(self._model, replace(self._request, realizations=realizations))
        observed = replace(plan.observed, every=1 if self._events else 0)
        return replace(plan, observed=observed)

    def _begun(self, plan: Plan, number: int) -> list[HeldBlock]:
        """Return the blocks of new realizations."""
        numbers = np.arange(self._next, self._next + number, dtype=np.uint32)
        self._next += number
        lanes = plan.realizations.lanes
        parts = [numbers[first : first + lanes] for first in range(0, number, lanes)]
        return [HeldBlock(self._opened(plan, part)) for part in parts]

    def _opened(self, plan: Plan, numbers: np.ndarray, continuation: np.ndarray | None = None) -> Block:
        return opened(plan, numbers, self._tally, self._pool, continuation)

    # a run as a resource

    def __enter__(self) -> Self:
        self._check_open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the run and give back its threads."""
        self._closed = True
        self._pool.shutdown()

    def _check_open(self) -> None:
        if self._closed:
            raise InvalidInput("This run is closed; begin another with il.Run(network, …).")

    def _each(self, function: Callable[[HeldBlock], Result]) -> list[Result]:
        """Return what a function returns of each block, on threads where there are several; an error ends the run."""
        results: list[Result] = []
        try:
            if len(self._blocks) < 2 or self._plan.subdomains.tiles:  # which have the threads for themselves
                return [function(block) for block in self._blocks]
            tasks = (begin(self._pool, function, block) for block in self._blocks)
            hand_over(tasks, results.append, lambda: None, self._tally.stop)
        except BaseException:
            self.close()
            raise
        return results

    # time

    @property
    def step(self) -> float:
        """Time step (s)."""
        return self._plan.clock.step

    @property
    def time(self) -> float:
        """Time since the end of the spin-up (s)."""
        return self._now * self.step

    @property
    def realizations(self) -> np.ndarray:
        """Numbers of the realizations that run, (realization,)."""
        return np.concatenate([np.zeros(0, np.uint32), *(item.block.realizations for item in self._blocks)])

    def advance(self, duration: float | None = None, *, until: float | None = None) -> None:
        """Go on for a duration, or until a time, or up to an event that stops the run.

        Parameters
        ----------
        duration : float, optional
            How long (s), a whole number of steps.
        until : float, optional
            Time at which to end (s).

        Raises
        ------
        InvalidInput
            If neither or both are given, or the time is earlier than `time`, beyond the `duration` of the run or the
            samples of an excitation, or no whole number of steps; if no realization is left; if a condition of an event
            is not finite.
        """
        self._check_open()
        end = self._end_of(duration, until)
        if not self._blocks:
            raise InvalidInput("No realization is left to advance: all are retired. Use restart().")
        check_ends(self._model, end * self.step)
        if end * self.step > self._longest * (1.0 + 1e-9):
            raise InvalidInput(f"This run ends at its duration of {self._longest:g} s, before {end * self.step:g} s.")
        while self._now < end and self._blocks:
            to_batch = self._batch - (self._now - self._began) % self._batch
            if self._advance(min(end - self._now, to_batch)):
                break

    def _end_of(self, duration: float | None, until: float | None) -> int:
        """Return the step at which to end."""
        if (duration is None) == (until is None):
            raise InvalidInput("advance takes either a duration (s) or until= (s).")
        if until is None:
            until = self.time + positive("duration", duration)
        elif finite("until", until) < self.time:
            raise InvalidInput(f"until={until:g} s is before the time of the run, {self.time:g} s; see restart().")
        return self._whole("A time", until)

    def _whole(self, what: str, time: float) -> int:
        """Return the number of steps to a time (s), which must be a whole one."""
        steps = time / self.step
        if abs(steps - round(steps)) > 1e-6 * max(1.0, 1e-6 * abs(steps)):
            raise InvalidInput(
                f"{what} of {time:.9g} s is not a whole number of steps of {self.step:.9g} s; the nearest are "
                f"{math.floor(steps) * self.step:.9g} s and {math.ceil(steps) * self.step:.9g} s. Give il.Run an "
                "interval= of which all times are whole numbers."
            )
        return round(steps)

    def _advance(self, steps: int) -> bool:
        """Make some steps, or fewer up to an event; return whether one stopped the run."""
        if not self._events:
            self._each(lambda item: item.advance(steps, _ignore))
            self._passed(steps)
            return False
        # at the most between looks for events
        steps = min(steps, 512)
        stopping = any(event.action == "stop" for event in self._events.values())
        before = self._each(lambda item: item.taken(np.arange(len(item.block.realizations)))) if stopping else []
        found = self._each(lambda item: self._look(item, steps))
        stops = [
            one.step.min() for of_block in found for one in of_block if one.event.action == "stop" and one.step.size
        ]
        if stops and min(stops) + 1 < steps:
            steps = int(min(stops)) + 1
            self._blocks = before
            self._each(lambda item: item.advance(steps, _ignore))
        for item, of_block in zip(list(self._blocks), found, strict=True):
            self._note(item, of_block, steps)
        self._passed(steps)
        return bool(stops)

    def _look(self, item: HeldBlock, steps: int) -> list[Occurred]:
        """Let a block make some steps, and return the events in them."""
        sampled = [item.block.seen()[None]]
        item.advance(steps, lambda snapshots: sampled.append(snapshots.copy()))
        snapshots = np.concatenate(sampled)
        return [
            occurred(name, event, item.block.plan, snapshots, self.time, item.block.realizations)
            for name, event in self._events.items()
        ]

    def _note(self, item: HeldBlock, found: list[Occurred], steps: int) -> None:
        """Note the events of a block in its last steps, and retire the realizations that end with them."""
        last = np.full(len(item.block.realizations), np.inf)
        for one in found:
            if one.event.action == "retire":
                np.minimum.at(last, one.lane, np.where(one.step < steps, one.time, np.inf))
        for one in found:
            kept = one.chosen(np.flatnonzero((one.step < steps) & (one.time <= last[one.lane])))
            self._occurred.append((item.block.realizations[kept.lane], kept))
        if np.isfinite(last).any():
            self._keep(item, np.flatnonzero(np.isinf(last)))

    def _passed(self, steps: int) -> None:
        """Go on with the time, and end a batch that is over."""
        self._now += steps
        if (self._now - self._began) % self._batch == 0:
            for item in self._blocks:
                item.end_batch()
            if self._blocks and len(self._blocks[0].batches) == 2 * BATCHES:
                for item in self._blocks:
                    item.join_batches()
                self._batch *= 2

    # realizations

    @property
    def state(self) -> xr.Dataset:
        """Displacements, velocities, and states of laws and filters of all realizations, as `FinalState` has them.

        It can be saved, changed, given to `restart`, or to `simulate` and `Run` as ``initial=``.
        """
        import xarray as xr

        self._check_open()
        return xr.Dataset(self._labelled(self._blocks), self._coordinates(), self._attributes("State of a held run"))

    def _labelled(self, blocks: Sequence[HeldBlock]) -> dict[str, Any]:
        size = self._plan.snapshot.size + len(self._plan.driving.processes.labels)
        ends = [item.block.end() for item in blocks] or [np.zeros((size, 0))]
        record, found = FinalState(continues=True), {"end": np.concatenate(ends, axis=1).T}
        return dict(record.label(RecordedRun(self._plan), [found], 0.0))

    def _coordinates(self) -> dict[str, Any]:
        time = (), self.time, {"units": "s", "long_name": "time"}
        numbers = ("realization",), self.realizations.astype(np.int64), REALIZATION
        return {"realization": numbers, "oscillator": list(self._plan.system.bodies), "time": time}

    @cached_property
    def _configuration(self) -> str:
        """The network and the options, in JSON."""
        network, text = stored(self._model.network), digest(generate(self._model))
        return json_of({"network": network, "run": self._request.options(), "text": text})

    def _attributes(self, title: str) -> dict[str, Any]:
        return provenance(title, self._configuration, "")

    def restart(
        self, state: Any, *, realizations: int | None = None, time: float | None = None, continues: bool = False
    ) -> None:
        """Begin again from given states, with new realizations or those that continue.

        Parameters
        ----------
        state : Dataset, mapping or path
            `state` of a run, a result with `FinalState`, or values by name; see ``initial=`` of `simulate`.
        realizations : int, optional
            How many; by default as many as there are states. All begin alike from one state.
        time : float, optional
            Time of the states (s); by default that of a `state`, or 0.
        continues : bool
            Whether the realizations of a `state` go on with their own random numbers, bit for bit.

        Raises
        ------
        InvalidInput
            If the state is of another network, or the time no whole number of steps; if realizations are to continue
            whose random numbers were used since.
        """
        self._check_open()
        state = source_of(state)
        if continues:
            if realizations is not None or time is not None:
                raise InvalidInput("Realizations that continue have their number and time: give neither.")
            blocks, now = self._continued(state)
            self._drop(self._blocks)
            self._blocks, self._now = blocks, now
            self._begin(True)
            return
        now = self._step_of(state, time)
        given = given_by(state, self._network, None)
        starts = realizations_of(given)
        number = replace(self._request, realizations=starts if realizations is None else realizations).realizations
        if starts not in (1, number):
            raise InvalidInput(f"There are states of {starts} realizations; give realizations={starts}, or one state.")
        blocks = self._started(given, number, now)
        self._drop(self._blocks)
        self._blocks, self._now = blocks, now
        self._begin(True)

    def _step_of(self, state: Any, time: float | None = None) -> int:
        """Return the step at the time of a state (s), by default its own."""
        if time is None:
            own = getattr(state, "coords", {}).get("time")
            time = 0.0 if own is None or own.ndim else float(own)
        if finite("time", time) > self._longest * (1.0 + 1e-9):
            raise InvalidInput(
                f"A state at {time:g} s is after the end of this run, its duration of {self._longest:g} s."
            )
        return self._whole("The time of a state", time)

    def _continued(self, state: Any) -> tuple[list[HeldBlock], int]:
        """Return the blocks of the realizations of a state, which continue, and the step at its time."""
        theirs, own = _with_steps(state), parsed(self._configuration)
        for name, what in {"network": "network", "text": "network", **CONTINUED}.items():
            one, other = (each[name] if name in each else each["run"].get(name) for each in (theirs, own))
            if one != other:
                raise InvalidInput(f"A run of another {what} had this state; without continues=True it is a start.")
        now, numbers = self._step_of(state, time_of(state)), state["realization"].values.astype(np.uint32)
        rows = state[CONTINUATION].transpose("number", "realization").values
        self._check_unused(numbers, rows[MADE])
        if self._plan.single and len(numbers) > 1:
            self._plan = self._planned(len(numbers))
        start = replace(self._plan.start, state=np.zeros((2, len(self._plan.system.bodies), 1)), laws=None)
        lanes, cuts = self._plan.realizations.lanes, np.flatnonzero(np.diff(rows[MADE])) + 1
        blocks: list[HeldBlock] = []
        for places in np.split(np.arange(len(numbers)), cuts):
            made = int(rows[MADE, places[0]])
            clock = replace(self._plan.clock, spin_up_steps=made - now)
            plan = replace(self._plan, start=start, clock=clock)
            for first in range(0, len(places), lanes):
                some = places[first : first + lanes]
                blocks.append(HeldBlock(self._opened(plan, numbers[some], rows[:, some])))
        self._next = max(self._next, *(int(number) + 1 for number in numbers))
        names = [name_of(quantity) for quantity in FINAL if name_of(quantity) in state]
        found = self._labelled(blocks)
        if any((state[name].values != found[name][1]).any() for name in names):
            raise InvalidInput("This state was changed; without continues=True it is a start.")
        return blocks, now

    def _check_unused(self, numbers: np.ndarray, made: np.ndarray) -> None:
        """Refuse to continue realizations that have gone on after so many steps."""
        running = {int(number): item.block.now for item in self._blocks for number in item.block.realizations}
        for number, steps in zip(numbers.tolist(), made, strict=True):
            if self._model.random.any() and max(running.get(number, 0), self._made.get(number, 0)) > steps:
                raise InvalidInput(
                    f"Realization {number} has gone on since this state, and its random numbers were used; without "
                    "continues=True the state is a start with new ones."
                )

    def _drop(self, blocks: Sequence[HeldBlock]) -> None:
        """Note the times at which realizations end."""
        for item in blocks:
            self._made |= dict.fromkeys(item.block.realizations.tolist(), item.block.now)

    def branch(self, parents: Sequence[int] | np.ndarray) -> np.ndarray:
        """Let new realizations go on from the states of others, with noise of their own.

        Statistics begin anew.

        Parameters
        ----------
        parents : sequence of int
            Numbers of `realizations`, which may be repeated.

        Returns
        -------
        (parent,) ndarray
            Numbers of the new realizations.
        """
        self._check_open()
        chosen = self._known(parents)
        if not chosen.size:
            return np.zeros(0, np.uint32)
        places = places_of(self.realizations.tolist())
        state = self.state.isel(realization=[places[number] for number in chosen.tolist()])
        new = self._started(given_by(state, self._network, None), len(chosen), self._now)
        self._blocks = [*self._blocks, *new]
        self._begin(True)
        return np.concatenate([item.block.realizations for item in new])

    def retire(self, realizations: Sequence[int] | np.ndarray) -> None:
        """End some realizations; statistics are those of the others."""
        self._check_open()
        ended = self._known(realizations)
        for item in list(self._blocks):
            left = np.flatnonzero(~np.isin(item.block.realizations, ended))
            if len(left) < len(item.block.realizations):
                self._keep(item, left)

    def _known(self, realizations: Sequence[int] | np.ndarray) -> np.ndarray:
        numbers = np.atleast_1d(np.asarray(realizations))
        unknown = numbers[~np.isin(numbers, self.realizations)]
        if unknown.size:
            raise InvalidInput(f"No realization {unknown[0]} runs; there are {self.realizations.tolist()[:8]} …")
        return numbers

    def _keep(self, item: HeldBlock, lanes: np.ndarray) -> None:
        """Go on with some realizations of a block."""
        place = self._blocks.index(item)
        self._drop([item])
        self._blocks[place : place + 1] = [item.taken(lanes)] if lanes.size else []

    def _started(self, given: Any, number: int, now: int) -> list[HeldBlock]:
        """Return the blocks of new realizations that begin with given states after some steps."""
        model = self._model
        if self._plan.single and number > 1:
            self._plan = self._planned(number)
        state, laws = start_of(given, model), states_of(given, model)
        if not isinstance(state, np.ndarray):
            raise InvalidInput('restart takes states, not a word: begin another il.Run with initial="rest".')
        for part in self._plan.events.parts:
            part.check(model, state[0])
        start = replace(
            self._plan.start, state=self._in_order(state), laws=None if laws is None else self._in_order(laws),
            filters=self._in_order(filters_of(given, model)),
        )  # fmt: skip
        plan = replace(self._plan, start=start, clock=replace(self._plan.clock, spin_up_steps=-now))
        return self._begun(plan, number)

    def _in_order(self, values: np.ndarray | None) -> Any:
        """Return values, (…, realization), so that the next realizations find theirs: by number, modulo how many."""
        return None if values is None else np.roll(values, self._next % values.shape[-1], axis=-1)

    # what was found

    @property
    def events(self) -> xr.Dataset:
        """Events so far, in time, with the states in which they happened.

        Dims are ``event`` and those of the quantities; ``name``, ``time`` (s) and ``realization`` tell which event it
        was.
        """
        import xarray as xr

        self._check_open()
        found = [(numbers, one) for numbers, one in self._occurred if len(one.time)]
        times = np.concatenate([np.zeros(0), *(one.time for _, one in found)])
        order = np.argsort(times, kind="stable")
        numbers = np.concatenate([np.zeros(0, np.int64), *(item.astype(np.int64) for item, _ in found)])
        names = np.array([one.name for _, one in found for _ in one.time], dtype=object)
        snapshot = self._plan.snapshot
        states = np.concatenate([np.zeros((snapshot.size, 0)), *(one.snapshot for _, one in found)], axis=1)
        variables: dict[str, Any] = {
            "name": ("event", names[order].astype(str), {"long_name": "name of the event"}),
            "time": ("event", times[order], {"units": "s", "long_name": "time of the event"}),
            "realization": ("event", numbers[order], REALIZATION),
        }
        for name in ("displacement", "velocity"):
            quantity = QUANTITIES[name]
            values = states[snapshot.place(name)][:, order].T
            variables[name] = ("event", quantity.dimension), values, snapshot.attributes(quantity)
        coordinates = {"oscillator": list(self._plan.system.bodies)}
        return xr.Dataset(variables, coordinates, self._attributes("Events of a held run"))

    def _begin(self, transient: bool) -> None:
        """Begin the statistics anew."""
        clock = self._plan.clock
        self._batch = math.ceil(BATCH_TIMES * clock.relaxation / clock.step) or MOST_SAMPLES
        self._began = self._now
        for item in self._blocks:
            item.begin(transient)

    def statistics(self) -> xr.Dataset:
        """Return the statistics of the realizations that run, since they began together.

        That is since the start, or the last `restart` or `branch`. Realizations that were retired do not count: where
        that depends on their motion, statistics are those of the motion under the condition of not being retired.
        Standard errors are those of the scatter.

        Raises
        ------
        InvalidInput
            If no time has passed since then.
        """
        self._check_open()
        if not self._blocks or self._now == self._began:
            raise InvalidInput("There are no statistics yet: no time has passed since the realizations began.")
        first, phases = self._blocks[0], self._plan.method.integrator.phases
        totals = []
        for item in self._blocks:
            turn = (first.first - item.first) % phases  # the cycle of the method may have begun with another step
            batches = [np.stack(kind) for kind in zip(*item.totals(), strict=True)]
            totals.append(
                [np.roll(kind, turn, axis=1) if place in (0, 3) else kind for place, kind in enumerate(batches)]
            )
        sums = [np.concatenate(kind, axis=-1) for kind in zip(*totals, strict=True)]
        plan = self._plan_of_statistics(first)
        bodies, contacts, products, points, laws = sums
        results = [BlockResult(bodies, contacts, products, points, laws, ())]
        remarks = remarks_on_events(plan, [item.block.events.noted() for item in self._blocks])
        configuration = {"network": stored(self._model.network), "simulate": self._request.options()}
        dataset = findings_of(plan, estimate(plan, *sums), results, remarks, configuration).dataset()
        own = {CONFIGURATION: self._configuration, BEGIN: self._began * self.step}
        return dataset.assign_attrs({**own, "spin_up": self._plan.clock.spin_up})

    def _plan_of_statistics(self, first: HeldBlock) -> Plan:
        """Return the plan by which sums since the beginning of the statistics are read."""
        clock, steps = self._plan.clock, self._now - self._began
        ends = [*range(self._batch, steps, self._batch), steps]
        lengths = np.diff([0, *ends[: steps // self._batch]]) * clock.step
        number = len(self.realizations)
        clock = replace(clock, spin_up_steps=first.first, steps=steps, boundaries=tuple(ends))
        trusted = enough_units(number, lengths if lengths.size else np.zeros(1), clock.relaxation)
        realizations = replace(self._plan.realizations, number=number, trusted=trusted)
        start = first.block.plan.start if not first.transient else self._blocks[-1].block.plan.start
        return replace(self._plan, clock=clock, realizations=realizations, start=start)


def _ignore(snapshots: np.ndarray) -> None:
    """Take samples that nobody wants."""


def _with_steps(state: Any) -> dict[str, Any]:
    """Return the configuration of the run that had a state, and refuse the state of a run without steps."""
    configuration = run_of(state)
    if configuration["run"]["integrator"]["type"] == EventLocated.__name__:
        raise InvalidInput(
            "This state is that of il.EventLocated, and a held run makes steps: continue it with il.simulate(network, "
            "duration, initial=…, continues=True), or make the earlier run with integrator=il.ExactFlow()."
        )
    return configuration


def _request_of(configuration: Mapping[str, Any]) -> Request:
    """Return the request of the held run that a configuration describes."""
    run = configuration["run"]
    return Request(
        run["duration"], run["realizations"], run["step"], Integrator.from_dict(run["integrator"]), run["spin_up"],
        run["initial"], [], tuple(run["seed"]),
    )  # fmt: skip
