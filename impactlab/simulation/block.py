"""One block of realizations: its start, its steps, and what it measures."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from functools import partial
from types import ModuleType
from typing import Any, Protocol, Self

import numpy as np

from impactlab.compiling.build import build
from impactlab.compiling.force_type import evaluate, evaluator
from impactlab.errors import Diverged, InvalidInput
from impactlab.integrators.arguments import Driven, Forced, Noise, Series, State, Steps, Sums
from impactlab.integrators.stretches import stretching, worth_compiling
from impactlab.kernels.memory import SUMS, TIMES, accept, states_in, sums_in
from impactlab.kernels.peaks import LARGEST as LARGEST_FORCE
from impactlab.kernels.peaks import OF_BATCH
from impactlab.kernels.rows import F
from impactlab.kernels.series import NEAR
from impactlab.kernels.sums import SLOTS
from impactlab.machine import NUMBERS_AT_A_TIME, uncollected
from impactlab.plan.driving import GivenMotion
from impactlab.plan.events import BlockEvents
from impactlab.plan.in_registers import layout_of
from impactlab.plan.plan import Plan
from impactlab.plan.processes import BlockProcesses
from impactlab.records.record import IntervalMeans, Keeper
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.losses import ADVICE
from impactlab.results.snapshot import BY_IMPACTS
from impactlab.simulation.arrays import allocate, copy_lanes
from impactlab.simulation.block_state import BlockStates
from impactlab.simulation.block_sums import BlockResult, Edge, edge_of, over_time, with_samples
from impactlab.simulation.divergence import LeftNumbers, finite_in
from impactlab.simulation.first_states import FirstStates
from impactlab.simulation.functions_in_steps import FunctionsInSteps
from impactlab.step_control.measured.smooth_path import Laws, SmoothPath

DRAWS, MADE = range(2)
"""Rows of a `Block.continuation`: draws of the start before the last one, and steps made; then places of processes."""

Tick = Callable[[int], None]


def untold(steps: int) -> None:
    """Take the number of steps that were made, for which nobody waits."""


def unkept() -> None:
    """Keep no state."""


@uncollected()
def compiled(plan: Plan) -> tuple[ModuleType, Callable[..., None]]:
    """Return the module of a plan's forces and the loop over its steps, compiled where that is still to be done."""
    if plan.method.integrator.kicks:
        evaluator(plan.single)
    return build(plan.forces.text), plan.method.loop(plan.single, plan.driving.series, len(plan.points.labels) > 0)


class Stepper(Protocol):
    """What makes the steps of a block in its place, and has the sums."""

    def call(
        self, state: State, now: int, count: int, snapshots: np.ndarray, summing: bool, every: int, phase: int
    ) -> None:
        """Make some steps from a state, which is changed."""

    def taken(self, lanes: np.ndarray) -> Self:
        """Return a stepper of some of the realizations, which goes on from here as this one would."""

    def noted(self) -> list[np.ndarray]:
        """Return the arrays in which a step is noted for the sums over the next one, […, lane], to be changed."""

    def note_gaps(self, x: np.ndarray, v: np.ndarray) -> None:
        """Store the gaps and their rates from which closings are counted."""

    def clear_sums(self) -> None:
        """Set the sums to 0."""

    def collect_sums(self, sums: Sums) -> None:
        """Add up the sums into the ones of the block."""


class Block:
    """The arrays of one block while it runs.

    Parameters
    ----------
    plan : Plan
    realizations : (lane,) ndarray of uint32
        Their numbers.
    tick : callable
        Called with numbers of steps that were made.
    tiles : Stepper, optional
        Makes the steps of a large network instead of the block.
    continuation : (number, lane) ndarray, optional
        `continuation` of the block that this one continues.
    """

    made_edge = Edge._make

    def __init__(
        self,
        plan: Plan,
        realizations: np.ndarray,
        tick: Tick,
        tiles: Stepper | None = None,
        continuation: np.ndarray | None = None,
    ) -> None:
        self.plan, self.realizations, self.tick, self.tiles = plan, realizations, tick, tiles
        drawn = np.zeros(len(realizations)) if continuation is None else continuation[DRAWS]
        self.draws = drawn.astype(int)  # of the start before the last one, which sums of cosines share
        self.lost: set[int] = set()  # networks side by side that left the range of finite numbers
        self.module, self.loop = compiled(plan)
        layout = layout_of(plan) if plan.single else None
        in_registers = layout is not None and worth_compiling(layout, plan.clock.all_steps)
        self.stretch = stretching(layout)[1] if in_registers else 0
        self.now, self.sums_began = 0, 0
        self.kept: Callable[[], None] = unkept  # called after steps, where a state may be kept
        self.guarded = True  # whether steps end with an error where a number is not finite
        self.edge: Edge | None = None  # the state when sums began, where it counts
        # summed over the steps of each phase
        self.intensity = np.zeros((plan.method.integrator.phases, len(plan.noise.white)))
        self.scale = np.ones((1, len(plan.noise.rows)))
        self.seconds = len(np.unique(plan.noise.rows))  # rows of bodies that have two come last
        self._allocate()
        self._begin()
        if continuation is not None:
            self._go_on(continuation)

    def _allocate(self) -> None:
        """Make the arrays of the realizations."""
        plan, lanes = self.plan, len(self.realizations)
        self.begun = np.zeros((0, lanes))  # states of laws when sums were cleared
        self.room = np.zeros(0)  # for snapshots
        arrays = allocate(plan, lanes)
        self.state, self.history, self.sums, self.normals, self.distinct, self.parameters, before, events = arrays
        # states of laws, which may be changed, (row, lane); see `impactlab.assembly.members.Members`
        self.remembering = len(plan.forces.states) > 0
        self.states = states_in(self.parameters, len(plan.forces.states), lanes)
        closings = self.sums.closings
        closings.before[:] = closings.peaks.before[:] = np.nan
        if plan.observed.rated.any():
            peaks = closings.peaks._replace(function=self.module.peaks[1])
            self.sums = self.sums._replace(closings=closings._replace(peaks=peaks))
        self.events = BlockEvents(plan.events, events, self.realizations, plan.single)
        self.tables = plan.method.tables(self.parameters, plan.forces.indices, self.events.table, before)
        self.processes = BlockProcesses(plan.driving.processes, self.realizations, plan.single)
        self.unforced = plan.driving.on_bodies(np.zeros((0, 0)))
        self.series = self._of_series(np.zeros(0, np.int64), np.zeros((1, 0, 1)))

    def taken(self, lanes: np.ndarray) -> Self:
        """Return a block of some of the realizations, in their order, which goes on from here as this one would."""
        other = copy(self)
        other.realizations, other.draws = self.realizations[lanes], self.draws[lanes]
        other.tiles = None if self.tiles is None else self.tiles.taken(lanes)
        other._allocate()
        samples = self.series.samples
        if samples.shape[1]:  # of sums of cosines
            other.series = other._of_series(self.series.bodies[: samples.shape[1]], samples[lanes])
        for one, own in (
            (self.state, other.state), (self.history, other.history), (self.sums, other.sums),
            (self.normals, other.normals), (self.distinct, other.distinct), (self.events.arrays, other.events.arrays),
            (self.processes.arrays, other.processes.arrays),
        ):  # fmt: skip
            copy_lanes(one, lanes, own)
        other.begun, other.intensity = self.begun[:, lanes], self.intensity.copy()
        if self.edge is not None:
            other.edge = Edge(*(item[..., lanes] for item in self.edge))
        if self.plan.forces.clocked:
            other.states[:] = self.states[:, lanes]
            for own, one in zip(other._state_sums(), self._state_sums(), strict=True):
                own[:] = one[:, lanes]
            other.parameters[TIMES] = self.parameters[TIMES]
        return other

    def continuation(self) -> np.ndarray:
        """Return the numbers from which another block continues as this one would, bit for bit, (number, lane)."""
        lanes = len(self.realizations)
        of_all = [np.full(lanes, number) for number in (self.now, *np.ravel(self.processes.places))]
        return np.concatenate([[self.draws, *of_all], *(item.reshape(-1, lanes) for item in self._lasting())])

    def _go_on(self, numbers: np.ndarray) -> None:
        """Continue from the numbers of a `continuation`, in which all lanes have made the same number of steps."""
        places = self.processes.places
        begin = MADE + 1 + 2 * len(places)
        self.now, *samples = numbers[MADE:begin, 0].astype(int).tolist()
        for place, pair in zip(places, zip(samples[::2], samples[1::2], strict=True), strict=True):
            place[:] = pair
        lasting = self._lasting()
        ends = np.cumsum([item.size // len(self.realizations) for item in lasting])
        if len(numbers) != begin + ends[-1]:
            raise InvalidInput(
                "No run can continue from this state: it is that of another version of impactlab, or of a run with "
                "other statistics=; without continues=True it is a start."
            )
        for item, rows in zip(lasting, np.split(numbers[begin:], ends[:-1]), strict=True):
            item[...] = rows.reshape(item.shape)

    def _lasting(self) -> list[np.ndarray]:
        """Return the arrays that a step leaves to the next one, […, lane], which may be changed."""
        state = self.state
        result = [
            state.x, state.v, state.reading, state.velocity, state.total, state.indentation, state.contact_force,
            *self.events.lasting(), *self.processes.lasting(),
            *(self.noted() if self.tiles is None else self.tiles.noted()),
        ]  # fmt: skip
        return [*result, self.states, self._state_sums()[-1]] if self.remembering else result

    def noted(self) -> list[np.ndarray]:
        """Return the arrays in which a step is noted for the sums over the next one, […, lane], to be changed."""
        closings, turns = self.sums.closings, self.sums.turns
        return [closings.before, closings.peaks.before[:LARGEST_FORCE], turns.force, turns.middle]

    # start

    def _begin(self) -> None:
        """Bring the block to the beginning of the spin-up."""
        plan, kicks = self.plan, self.plan.method.integrator.kicks
        motions = [(motion.slot, *self._at_start(motion)) for motion in plan.driving.motions]
        first = FirstStates(plan, self.realizations, self.state, self.states, self.processes, motions)
        if plan.driving.lines:
            self.draws, *sampled = first.put_with_cosines(self.tick, self.draws)
            self.series = self._of_series(*sampled)
        else:
            first.put(np.arange(len(self.realizations)))
        given = (self.state.x[:-1].copy(), self.state.v[:-1].copy()) if kicks and plan.start.given else None
        if kicks:
            self._half_kick(plan.start.given)
        if self.remembering:
            self._accept()
        if given is not None:
            self._begin_on_path(*given)

    def _at_start(self, motion: GivenMotion) -> tuple[float, float]:
        """Return displacement and velocity of a body of given motion at the start."""
        x, v = self.functions.motion(motion, 0, 0)
        return x[0], v[0]

    def _of_series(self, slots: np.ndarray, samples: np.ndarray) -> Series:
        """Return the series of a block: samples of sums of cosines, with the slots that they act on, and processes."""
        processes, lanes = self.plan.driving.processes, len(self.realizations)
        shape = (NEAR + 1, samples.shape[1] + processes.rows, lanes) if self.plan.driving.series else (1, 0, 1)
        near = np.zeros(shape)
        table = self.processes.table(near, samples.shape[1])
        return Series(np.concatenate([slots, processes.slots]), samples, near, table)

    def _half_kick(self, given: bool) -> None:
        """Carry the velocity from the time of the displacement to the end of the kick at that time.

        The force of the kick is evaluated at the displacement itself if the displacement is `given`.
        """
        plan, state = self.plan, self.state
        half = 0.5 * plan.clock.step / plan.system.linear[0][:, None]
        self._evaluate(state.x, state.still)
        shift = plan.clock.step / 6.0 * half * state.total[:-1]
        if given:
            state.reading[:] = state.x
            state.x[:-1] -= shift
        else:
            state.reading[:-1] = state.x[:-1] + shift
        state.velocity[:] = state.v
        self._evaluate(state.reading, state.velocity)
        state.v[:-1] += half * state.total[:-1]
        turns = self.sums.turns
        turns.force[:], turns.middle[:] = (item[: len(turns.force)] for item in (state.total, state.velocity))

    def _begin_on_path(self, x: np.ndarray, v: np.ndarray) -> None:
        """Add the difference between velocities at kicks and those of the smooth path to the velocities."""
        self.state.v[:-1] += self._beyond_path(x, v)

    def _beyond_path(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the difference between velocities at kicks and those of the smooth path, (body, lane)."""
        laws = Laws(self.states[None], np.array([self.time]))
        _, before = SmoothPath(self.plan, self.evaluate).begin(x[None], v[None], laws)
        beyond: np.ndarray = before[0] - v
        return beyond

    def seen(self) -> np.ndarray:
        """Return the snapshot of the present state, which may be that at the start."""
        plan, kicks = self.plan, self.plan.method.integrator.kicks
        if self.now > 0 or (kicks and plan.start.given):  # a given start is read where it was given
            return self._snapshot()
        start = self.taken(np.arange(len(self.realizations)))
        start.state.reading[:] = start.state.x
        if not kicks:
            start.state.velocity[:] = start.state.v
        start._evaluate(start.state.reading, start.state.velocity)
        return start._snapshot()

    def end(self) -> np.ndarray:
        """Return the snapshot, the states of filters, and the `continuation`, from which another run can go on."""
        final = self._final() if self.now > 0 else np.concatenate([self.seen(), self.processes.end(0)])
        return np.concatenate([final, self.continuation()])

    def _final(self) -> np.ndarray:
        """Return the snapshot and the states of filters from which another run can go on.

        Velocities are on the smooth path, as `_begin_on_path` takes them.
        """
        final, plan, bodies = self._snapshot(), self.plan, len(self.plan.system.bodies)
        if plan.method.integrator.kicks and plan.method.interval == 1:
            state, half = self.state, 0.5 * plan.clock.step / plan.system.linear[0][:, None]
            v = state.v[:-1] - half * state.total[:-1]
            final[bodies : 2 * bodies] = v - self._beyond_path(state.reading[:-1], v)
        return np.concatenate([final, self.processes.end(self.now * plan.method.integrator.samples_per_step)])

    def _evaluate(self, x: np.ndarray, v: np.ndarray) -> None:
        state = self.state
        arrays = state.indentation, state.contact_force, state.total
        self.evaluate(x[None], v[None], *(item[None] for item in arrays))

    def evaluate(
        self, x: np.ndarray, v: np.ndarray, *result: np.ndarray, laws: Laws | None = None, elapsed: float = 0.0
    ) -> None:
        """Evaluate the forces in some states; see `impactlab.compiling.force_type.evaluate`.

        Laws have the states that they have now or others, in each state, accepted some time before (s).
        """
        parameters, indices = self.parameters, self.plan.forces.indices
        if not self.plan.forces.clocked or laws is None:
            if self.plan.forces.clocked:
                parameters[TIMES] = self.time, elapsed
            evaluate(self.module.forces, x, v, parameters, indices, *result)
            return
        parameters = parameters.copy()
        for index, (states, time) in enumerate(zip(*laws, strict=True)):
            parameters[TIMES] = time, elapsed
            states_in(parameters, len(self.plan.forces.states), len(self.realizations))[:] = states
            here = (item[index : index + 1] for item in result)
            evaluate(self.module.forces, x[index : index + 1], v[index : index + 1], parameters, indices, *here)

    @property
    def functions(self) -> FunctionsInSteps:
        """Functions of time in steps."""
        return FunctionsInSteps(self.plan, self.module)

    @property
    def time(self) -> float:
        """Time since the beginning of the measurement (s)."""
        return (self.now - self.plan.clock.spin_up_steps) * self.plan.clock.step

    def _state_sums(self) -> np.ndarray:
        return sums_in(self.parameters, len(self.plan.forces.states), len(self.realizations))

    def _of_laws(self) -> np.ndarray:
        """Return sums over steps of the states of laws and of their squares, by the trapezoidal rule from when sums
        were cleared, by how much the states have changed, and the size of all changes, (`SUMS`, row, lane).
        """
        first, last = self.begun, self.states
        sums, squares, changes, _ = self._state_sums()
        return np.stack([sums - 0.5 * (last - first), squares - 0.5 * (last**2 - first**2), last - first, changes])

    def _accept(self) -> None:
        """Bring the states of laws from their start values to the start, at once."""
        kicks, state = self.plan.method.integrator.kicks, self.state
        place = (state.reading, state.velocity) if kicks else (state.x, state.v)
        self.parameters[TIMES] = self.time, 0.0
        blocks = *place, state.contact_force
        accept(self.module.accept, self.plan.single, blocks, self.parameters, self.plan.forces.indices)

    # run

    def advance(self, steps: int, sampler: Callable[[np.ndarray], None] | None) -> None:
        """Make some steps, adding to the sums and sampling if there is a sampler."""
        plan = self.plan
        every = plan.observed.every if sampler is not None else 0
        lanes, rows = len(self.realizations), plan.snapshot.size
        done = 0
        while done < steps:
            # calls end with a group of slots, so that their length does not change any sum
            unit = max(SLOTS, plan.method.interval)
            most = plan.realizations.steps_per_call
            if every:
                most = min(most, NUMBERS_AT_A_TIME // (rows * lanes) * every)
            whole = plan.subdomains.steps or max(unit, most // unit * unit)
            count = min(whole - self.now % SLOTS, steps - done)
            phase = (self.now - plan.clock.first) % every if every else 0
            snapshots = self._room_for((phase + count) // every if every else 0, rows, lanes)
            self.call(count, snapshots, sampler is not None, every, phase)
            self.now += count
            done += count
            if self.guarded:
                self._guard()
            if len(snapshots) and sampler is not None:
                sampler(snapshots)
            self.tick(count * lanes)
            self.kept()

    def _room_for(self, *shape: int) -> np.ndarray:
        """Return an array for snapshots, in which all that is not written is NaN."""
        size = math.prod(shape)
        if size > len(self.room):
            self.room = np.full(size, np.nan)
        return self.room[:size].reshape(shape)

    def call(self, count: int, snapshots: np.ndarray, summing: bool, every: int, phase: int) -> None:
        """Call the compiled loop, or that of each tile."""
        if self.tiles is not None:
            self.tiles.call(self.state, self.now, count, snapshots, summing, every, phase)
            return
        plan, integrator = self.plan, self.plan.method.integrator
        steps = Steps(
            plan.clock.step, integrator.samples_per_step, plan.forces.passes, summing, self.remembering,
            plan.forces.clocked, plan.clock.spin_up_steps, self.now, count, every, phase,
        )  # fmt: skip
        driving = plan.driving
        series = self._series(count) if driving.processes.envelopes else self.series
        driven = Driven(self._noise(count), series, self._forced(count) if len(driving.forced) else self.unforced)
        accepting = self.module.accept[1] if self.remembering else 0
        if plan.snapshot.told:
            self.events.open_told(len(snapshots))
        self.loop(
            self.module.forces,
            accepting,
            self.stretch,
            self.tables,
            driven,
            self.state,
            self.history,
            self.sums,
            snapshots,
            steps,
        )
        if plan.snapshot.told:
            snapshots[:, plan.snapshot.place(BY_IMPACTS.name)] = self.events.take_told()

    def _noise(self, count: int) -> Noise:
        plan, noise, scale = self.plan, self.plan.noise, self.scale
        if noise.time_varying:
            rows, sets = noise.shares.noises, plan.realizations.networks
            mean, _, least = self.functions.over_steps(self.module.intensity, self.now, count, rows, sets)
            wrong = np.flatnonzero(~(least >= 0.0))
            if wrong.size:
                time = (self.now - plan.clock.spin_up_steps + wrong[0] + 0.5) * plan.clock.step
                raise Diverged(
                    f"The spectral density of a white noise is negative or NaN near t = {time:g} s; correct its "
                    "intensity."
                )
            phases = plan.method.integrator.phases
            of_phases = [mean[(phase - self.now) % phases :: phases].sum(axis=0) for phase in range(phases)]
            self.intensity += noise.shares.added(np.array(of_phases))
            scale = np.ascontiguousarray(np.sqrt(mean)[:, noise.noises])
            if plan.events.parts:
                self.events.under_noise(mean)
        streams, which = noise.distinct
        numbers = noise.amplitude, streams, self.realizations, scale, noise.coarse, self.normals
        return Noise(noise.rows, noise.runs, self.seconds, *numbers, which, self.distinct)

    def _series(self, count: int) -> Series:
        """Return the series of the next steps, with the envelopes of processes."""
        plan, method = self.plan, self.plan.method.integrator
        samples, finer = method.samples_per_step, plan.driving.processes.finer
        span = NEAR // samples * samples  # samples that are brought near at a time
        begin, end = (samples * now // span * span for now in (self.now, self.now + count))
        rows, first, per_step = plan.driving.processes.envelopes, finer * begin, finer * samples
        number = finer * (end - begin + NEAR) + 1
        mean, slope, _ = self.functions.over_steps(self.module.modulation, first, number, rows, per_step=per_step)
        times = ((first + np.arange(number)) / per_step - plan.clock.spin_up_steps) * plan.clock.step
        value = np.empty((number, rows))
        self.module.modulation(times, plan.forces.parameters, plan.forces.indices, value)
        self.processes.set_envelopes(np.stack([value, mean, slope], axis=1), first)
        return self.series

    def _forced(self, count: int) -> Forced:
        plan = self.plan
        if plan.method.integrator.takes_response:
            return plan.driving.on_bodies(self.functions.given_forces(self.now, count))
        per_step = plan.method.integrator.samples_per_step
        first = (self.now - plan.clock.spin_up_steps) * per_step
        times = (first + np.arange(count * per_step + 1)) * (plan.clock.step / per_step)
        force = np.empty((len(times), plan.driving.given))
        self.module.forcing(times, plan.forces.parameters, plan.forces.indices, force)
        return plan.driving.on_bodies(force)

    def _guard(self) -> None:
        """Stop if a number is not finite: averages would hide it. Networks side by side are held still instead."""
        x, v, reading = self.state.x, self.state.v, self.state.reading
        finite = finite_in(self.state)
        if finite.all():
            return
        networks = self.plan.realizations.networks
        if networks == 1:
            body, lane = np.argwhere(~finite)[0]
            name, realization = self.plan.system.bodies[body], int(self.realizations[lane])
            raise LeftNumbers(
                f"{name!r} of realization {realization} left the range of finite numbers before t = {self.time:g} s. "
                + ADVICE,
                np.flatnonzero(~finite.all(axis=0)),
            )
        self.lost |= {int(body) % networks for body in np.flatnonzero(~finite.all(axis=1))}
        for place in self.lost:
            for item in (x, v, reading, self.state.velocity, self.state.total):
                item[place:-1:networks] = 0.0

    def open_keepers(self) -> list[Keeper]:
        """Begin the sums of the measurement; return what collects the samples of each record, at its start."""
        plan = self.plan
        self.begin_sums(plan.transient)  # before keepers look at forces elsewhere
        places = self.realizations - np.uint32(plan.realizations.numbered_from)
        keepers = [record.keeper(RecordedRun(plan), places, ratio) for record, ratio in plan.observed.records]
        if any(keeper.wants_start for keeper in keepers):
            if not plan.method.integrator.kicks:
                self.state.velocity[:] = self.state.v
            own = plan.clock.spin_up_steps == 0 and not plan.start.given
            if not plan.method.integrator.kicks or own:  # the state itself, not where a kick is read
                self.state.reading[:] = self.state.x
                self._evaluate(self.state.reading, self.state.velocity)
            first = self._snapshot()
            first[plan.snapshot.impulsive_rows] = 0.0
            for keeper in keepers:
                keeper.start(first)
        return keepers

    def measure(self, states: BlockStates | None = None) -> BlockResult:
        """Run all batches after the spin-up and return their sums; from a state that was kept, if there is one."""
        plan = self.plan
        keepers = self.open_keepers()
        means = [IntervalMeans(plan.snapshot.impulsive_rows, keeper) for keeper in keepers]
        if plan.method.integrator.kicks and plan.start.continuation is None:  # others sample the beginning of each step
            place = self.state.reading if plan.clock.spin_up_steps or plan.start.given else self.state.x
            self.note_gaps(place, self.state.velocity)
        kept: list[np.ndarray] = []
        course: dict[str, Any] = {"keepers": keepers, "means": means, "sums": kept, "batch": 0}
        within = False
        if states is not None:
            within, self.kept = states.restore(self, course), partial(states.note, self, course)
        for batch in range(course["batch"], len(plan.clock.boundaries)):
            course["batch"] = batch
            if batch and not within:
                self.begin_sums(plan.transient)

            def sample(snapshots: np.ndarray, batch: int = batch) -> None:
                for keeper, mean in zip(keepers, means, strict=True):
                    keeper.add(mean(snapshots), batch)

            self.advance(plan.clock.first + plan.clock.boundaries[batch] - self.now, sample)
            within, totals = False, self.totals()
            if not kept:
                kept.extend(np.empty((len(plan.clock.boundaries), *total.shape)) for total in totals)
            for total, sums in zip(totals, kept, strict=True):
                sums[batch] = total
        for keeper in keepers:
            if keeper.wants_end:
                keeper.end(self.end())
        bodies, contacts, products, points, laws = kept
        return BlockResult(
            bodies, contacts, products, points, laws, self.events.noted(), [keeper.result() for keeper in keepers],
            frozenset(self.lost),
        )  # fmt: skip

    def _snapshot(self) -> np.ndarray:
        """Return where bodies are read, velocities, contact forces, states of laws and peaks, [quantity, lane]."""
        state, snapshot = self.state, self.plan.snapshot
        kicks = state.velocity[:-1] if snapshot.kicked else state.velocity[:0]
        peaks = state.contact_force if snapshot.peaked else state.contact_force[:0]
        told = self.events.told() if snapshot.told else peaks[:0]
        parts = [state.reading[:-1], state.velocity[:-1], state.contact_force, self.states, told, kicks, peaks]
        return np.concatenate(parts)

    def begin(self, x: np.ndarray, v: np.ndarray, now: int) -> None:
        """Go on from displacements before a kick, and velocities, of all bodies after some steps."""
        self.state.x[:-1], self.state.v[:-1], self.now = x, v, now
        self.events.begin()
        self._half_kick(False)
        self.note_gaps(self.state.reading, self.state.velocity)

    def note_gaps(self, x: np.ndarray, v: np.ndarray) -> None:
        """Store the gaps and their rates from which closings are counted, where they are counted."""
        if self.tiles is not None:
            self.tiles.note_gaps(x, v)
        if not self.plan.observed.counted or self.tiles is not None:
            return
        contacts = slice(self.plan.observed.contacts)
        ends, clearance = self.plan.system.ends.chosen(contacts), self.plan.system.clearance[contacts, None]
        self.sums.closings.before[0] = ends.gap(x) - clearance
        self.sums.closings.before[1] = ends.rates(x, v)

    def begin_sums(self, transient: bool) -> None:
        """Begin the sums anew; sums of a transient begin with the states at both ends."""
        self.edge = self._edge() if transient else None
        self.clear_sums()
        self.sums_began = self.now

    def totals(self) -> tuple[np.ndarray, ...]:
        """Return the sums since they began: over bodies, contacts, pairs, points and laws."""
        plan, sums = self.plan, self.sums
        laws = self._of_laws() if self.remembering else np.zeros((SUMS, *self.states.shape))
        self.collect_sums()
        if plan.method.interval > 1:  # states are added once per interval
            bodies = sums.bodies.copy()
            bodies[:, :F] *= plan.method.interval
            sums = sums._replace(bodies=bodies)
        if self.edge is None:
            return with_samples(sums.bodies, sums.samples), sums.contacts, sums.products, sums.points.sums, laws
        begin, end = (now - plan.clock.spin_up_steps for now in (self.sums_began, self.now))
        return *over_time(plan, sums, self.intensity, begin, end, self.edge, self._edge()), laws

    def segment(self, steps: int) -> tuple[np.ndarray, ...]:
        """Make some steps and return their sums over bodies, contacts, pairs and laws, as a transient needs them."""
        self.begin_sums(True)
        self.advance(steps, lambda snapshots: None)
        bodies, contacts, products, _, laws = self.totals()
        return bodies, contacts, products, laws

    def _edge(self) -> Edge:
        """Return the contribution of the present state to the sums of a transient."""
        plan, state = self.plan, self.state
        if not plan.method.integrator.kicks:
            state.reading[:], state.velocity[:] = state.x, state.v
            self._evaluate(state.reading, state.velocity)
        return edge_of(plan, state, self.sums, (self.now - 1) % plan.method.integrator.phases)

    def clear_sums(self) -> None:
        """Set all sums to 0."""
        if self.tiles is not None:
            self.tiles.clear_sums()
        self.intensity = np.zeros((self.plan.method.integrator.phases, len(self.plan.noise.white)))
        sums = self.sums
        for total in (sums.bodies, sums.contacts, sums.products, sums.samples, sums.points.sums):
            total[:] = 0.0
        sums.closings.peaks.before[[LARGEST_FORCE, OF_BATCH]] = np.nan
        if self.remembering:
            self.begun = self.states.copy()
            *totals, before = self._state_sums()
            before[:] = self.begun
            for total in totals:
                total[:] = 0.0

    def collect_sums(self) -> None:
        """Bring all sums together, with the largest forces between steps of contacts whose peaks are read there."""
        sums = self.sums
        if self.tiles is not None:
            self.tiles.collect_sums(sums)
            return
        peaks = sums.closings.peaks
        if self.plan.observed.rated.any():
            found = np.fmax(peaks.before[LARGEST_FORCE], peaks.before[OF_BATCH])
            largest = sums.contacts[peaks.row]
            np.copyto(largest, found, where=~np.isnan(found))
