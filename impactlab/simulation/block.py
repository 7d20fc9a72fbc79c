"""One block of realizations: its start, its steps, and what it measures."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np

from impactlab.assembly.build import build
from impactlab.errors import Diverged
from impactlab.integrators.arguments import Driven, Forced, Noise, Series, Steps, Tables
from impactlab.integrators.driver import colliding, filtering, sliding
from impactlab.integrators.stretches import stretching, worth_compiling
from impactlab.kernels.forces import evaluate, evaluator
from impactlab.kernels.impacts import ENDLESS, SLOW
from impactlab.kernels.memory import SUMS, accept, states_in, sums_in
from impactlab.kernels.peaks import LARGEST as LARGEST_FORCE
from impactlab.kernels.peaks import OF_BATCH
from impactlab.kernels.rows import F
from impactlab.kernels.series import NEAR
from impactlab.kernels.sums import SLOTS
from impactlab.nonlinear.force_checks import LARGEST
from impactlab.plan.driving import GivenMotion
from impactlab.plan.in_registers import layout_of
from impactlab.plan.plan import Plan
from impactlab.records.record import IntervalMeans
from impactlab.records.recorded_run import RecordedRun
from impactlab.simulation.arrays import allocate
from impactlab.simulation.block_sums import BlockResult, Edge, edge_of, over_time, with_samples
from impactlab.simulation.filter_states import filter_states
from impactlab.simulation.first_states import FirstStates
from impactlab.simulation.functions_in_steps import FunctionsInSteps
from impactlab.simulation.smooth_path import Laws, SmoothPath

SNAPSHOT_BYTES = 16_000_000
"""Memory that the samples of a call may take."""

WORTH_COMPILING = 20.0
"""Work of a run (s) from which a loop without the unwanted samples is compiled, which saves 5 % of the work."""

Tick = Callable[[int], None]


def compiled(plan: Plan) -> tuple[ModuleType, Callable[..., None]]:
    """Return the module of a plan's forces and the loop over its steps, compiled where that is still to be done."""
    if plan.method.integrator.kicks:
        evaluator(plan.single)
    left_out = plan.observed.left_out if plan.work > WORTH_COMPILING else frozenset()
    return build(plan.forces.text), plan.method.loop(plan.single, left_out)


class Block:
    """The arrays of one block while it runs."""

    networks, force_sets = 1, 1
    """Networks side by side, with intensities of their own each, and sets of given forces that some of them share."""

    def __init__(self, plan: Plan, index: int, tick: Tick) -> None:
        self.plan, self.tick = plan, tick
        self.module, self.loop = compiled(plan)
        layout = layout_of(plan)
        in_registers = layout is not None and worth_compiling(layout, plan.clock.all_steps)
        self.stretch = stretching(layout)[1] if in_registers else 0
        self.realizations = plan.realizations.of(index)
        self.now, self.begun = 0, np.zeros((0, len(self.realizations)))  # states of laws when sums were cleared
        lanes = len(self.realizations)
        # summed over the steps of each phase
        self.intensity = np.zeros((plan.method.integrator.phases, len(plan.noise.white)))
        arrays = allocate(plan, lanes)
        self.state, self.history, self.sums, self.normals, self.distinct, self.parameters, events = arrays
        closings = self.sums.closings
        closings.before[:] = closings.peaks.before[:] = np.nan
        if plan.observed.rated.any():
            peaks = closings.peaks._replace(function=self.module.peaks[1])
            self.sums = self.sums._replace(closings=closings._replace(peaks=peaks))
        if len(plan.impacts.rigid.contacts):
            impacts = events.impacts._replace(function=colliding(plan.single), realizations=self.realizations)
            events = events._replace(impacts=impacts)
        if plan.friction.names:
            events = events._replace(rubbing=events.rubbing._replace(function=sliding(plan.single)))
        self.events = events
        self.tables = plan.method.tables(self.parameters, plan.forces.indices, events)
        self.scale = np.ones((1, len(plan.noise.rows)))
        self.seconds = len(np.unique(plan.noise.rows))  # rows of bodies that have two come last
        noise = plan.driving.coloured
        self.coloured = noise.arrays(filtering(plan.single) if noise else 0, self.realizations)
        self.series = self._of_series(np.zeros(0, np.int64), np.zeros((1, 0, 1)))
        self._begin()

    # start

    def _begin(self) -> None:
        """Bring the block to the beginning of the spin-up."""
        plan, kicks = self.plan, self.plan.method.integrator.kicks
        motions = [(motion.slot, *self._at_start(motion)) for motion in plan.driving.motions]
        filters = self.coloured.kept
        first = FirstStates(plan, self.realizations, self.state, self.states, filters, motions, self.networks)
        if plan.driving.lines:
            self.series = self._of_series(*first.put_with_cosines(self.tick))
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
        """Return the series of a block: samples of sums of cosines on some slots, and coloured noises."""
        noise, lanes = self.plan.driving.coloured, len(self.realizations)
        near = (NEAR + 1, samples.shape[1] + noise.rows, lanes) if self.plan.driving.series else (1, 0, 1)
        return Series(np.concatenate([slots, noise.slots]), samples, np.zeros(near), self.coloured)

    def _half_kick(self, given: bool) -> None:
        """Bring the velocity from the time of the displacement to the end of the kick at that time.

        The force of the kick is read at the displacement itself if that is `given`.
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

    def _final(self) -> np.ndarray:
        """Return the snapshot and the states of filters from which another run can go on.

        Its velocities are those that `_begin_on_path` takes.
        """
        final, plan, bodies = self._snapshot(), self.plan, len(self.plan.system.bodies)
        if plan.method.integrator.kicks and plan.method.interval == 1:
            state, half = self.state, 0.5 * plan.clock.step / plan.system.linear[0][:, None]
            v = state.v[:-1] - half * state.total[:-1]
            final[bodies : 2 * bodies] = v - self._beyond_path(state.reading[:-1], v)
        return np.concatenate([final, filter_states(self.coloured, self.now * plan.method.integrator.samples_per_step)])

    def _evaluate(self, x: np.ndarray, v: np.ndarray) -> None:
        state = self.state
        arrays = state.indentation, state.contact_force, state.total
        self.evaluate(x[None], v[None], *(item[None] for item in arrays))

    def evaluate(
        self, x: np.ndarray, v: np.ndarray, *result: np.ndarray, laws: Laws | None = None, elapsed: float = 0.0
    ) -> None:
        """Evaluate the forces in some states; see `impactlab.kernels.forces.evaluate`.

        Laws have the states that they have now or others, in each state, accepted some time before (s).
        """
        parameters, indices = self.parameters, self.plan.forces.indices
        if not self.plan.forces.clocked or laws is None:
            if self.plan.forces.clocked:
                parameters[-2:] = self.time, elapsed
            evaluate(self.module.forces, x, v, parameters, indices, *result)
            return
        parameters = parameters.copy()
        for index, (states, time) in enumerate(zip(*laws, strict=True)):
            parameters[-2:] = time, elapsed
            self._states_in(parameters)[:] = states
            here = (item[index : index + 1] for item in result)
            evaluate(self.module.forces, x[index : index + 1], v[index : index + 1], parameters, indices, *here)

    @property
    def functions(self) -> FunctionsInSteps:
        """Functions of time in steps."""
        return FunctionsInSteps(self.plan, self.module)

    @property
    def remembering(self) -> bool:
        """Whether laws have states."""
        return len(self.plan.forces.states) > 0

    @property
    def time(self) -> float:
        """Time since the beginning of the measurement (s)."""
        return (self.now - self.plan.clock.spin_up_steps) * self.plan.clock.step

    @property
    def states(self) -> np.ndarray:
        """States of the laws, which may be changed, (row, lane); see `impactlab.assembly.members.Members`."""
        return self._states_in(self.parameters)

    def _states_in(self, parameters: np.ndarray) -> np.ndarray:
        return states_in(parameters, len(self.plan.forces.states), len(self.realizations))

    def _of_laws(self) -> np.ndarray:
        """Return sums over steps of the states of laws and of their squares, by the trapezoidal rule from when sums
        were cleared, by how much the states have changed, and the size of all changes, (`SUMS`, row, lane).
        """
        first, last = self.begun, self.states
        if not self.remembering:
            return np.zeros((SUMS, *last.shape))
        sums, squares, changes, _ = sums_in(self.parameters, *last.shape)
        return np.stack([sums - 0.5 * (last - first), squares - 0.5 * (last**2 - first**2), last - first, changes])

    def _accept(self) -> None:
        """Bring the states of laws from their start values to the start, at once."""
        kicks, state = self.plan.method.integrator.kicks, self.state
        place = (state.reading, state.velocity) if kicks else (state.x, state.v)
        self.parameters[-2:] = self.time, 0.0
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
                most = min(most, SNAPSHOT_BYTES // (8 * rows * lanes) * every)
            whole = plan.subdomains.steps or max(unit, most // unit * unit)
            count = min(whole - self.now % SLOTS, steps - done)
            phase = (self.now - plan.clock.spin_up_steps) % every if every else 0
            snapshots = np.empty(((phase + count) // every if every else 0, rows, lanes))
            self._call(count, snapshots, sampler is not None, every, phase)
            self.now += count
            done += count
            self._guard()
            if len(snapshots) and sampler is not None:
                sampler(snapshots)
            self.tick(count * lanes)

    def _call(self, count: int, snapshots: np.ndarray, summing: bool, every: int, phase: int) -> None:
        """Call the compiled loop."""
        plan, integrator = self.plan, self.plan.method.integrator
        steps = Steps(
            plan.clock.step, integrator.samples_per_step, plan.forces.passes, summing, self.remembering,
            plan.forces.clocked, plan.clock.spin_up_steps, self.now, count, every, phase,
        )  # fmt: skip
        driven = Driven(self._noise(count), self._series(count), self._forced(count))
        accepting = self.module.accept[1] if self.remembering else 0
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

    def _noise(self, count: int) -> Noise:
        plan, noise, scale = self.plan, self.plan.noise, self.scale
        if noise.time_varying:
            rows, sets = noise.shares.noises, self.networks
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
            if isinstance(self.tables, Tables) and len(plan.impacts.rigid.contacts):
                spread = np.ascontiguousarray(np.sqrt(mean @ plan.impacts.gains.T))
                self.tables = self.tables._replace(impacts=self.tables.impacts._replace(spread=spread))
        streams, which = noise.distinct
        numbers = noise.amplitude, streams, self.realizations, scale, noise.coarse, self.normals
        return Noise(noise.rows, noise.runs, self.seconds, *numbers, which, self.distinct)

    def _series(self, count: int) -> Series:
        """Return the series of the next steps, with the envelopes of coloured noises."""
        plan, method = self.plan, self.plan.method.integrator
        if not plan.driving.coloured.time_varying:
            return self.series
        samples, finer = method.samples_per_step, self.coloured.filters.finer
        span = NEAR // samples * samples  # samples that are brought near at a time
        begin, end = (samples * now // span * span for now in (self.now, self.now + count))
        rows, first, per_step = plan.driving.coloured.envelopes, finer * begin, finer * samples
        number = finer * (end - begin + NEAR) + 1
        mean, slope, _ = self.functions.over_steps(self.module.modulation, first, number, rows, per_step=per_step)
        times = ((first + np.arange(number)) / per_step - plan.clock.spin_up_steps) * plan.clock.step
        value = np.empty((number, rows))
        self.module.modulation(times, plan.forces.parameters, plan.forces.indices, value)
        coloured = self.coloured._replace(factors=np.stack([value, mean, slope], axis=1), first=first)
        return self.series._replace(coloured=coloured)

    def _forced(self, count: int) -> Forced:
        plan = self.plan
        if not len(plan.driving.forced):
            return plan.driving.on_bodies(np.zeros((0, 0)))
        if plan.method.integrator.takes_response:
            return plan.driving.on_bodies(self.functions.given_forces(self.now, count, self.force_sets))
        per_step = plan.method.integrator.samples_per_step
        first = (self.now - plan.clock.spin_up_steps) * per_step
        times = (first + np.arange(count * per_step + 1)) * (plan.clock.step / per_step)
        force = np.empty((len(times), plan.driving.given))
        self.module.forcing(times, plan.forces.parameters, plan.forces.indices, force)
        return plan.driving.on_bodies(force)

    def _guard(self) -> None:
        """Stop if a number is not finite: averages would hide it."""
        x, v, reading = self.state.x, self.state.v, self.state.reading
        finite = np.isfinite(x) & (np.abs(v) < LARGEST) & (np.abs(reading) < LARGEST)
        if not finite.all():
            body, lane = np.argwhere(~finite)[0]
            name, realization = self.plan.system.bodies[body], int(self.realizations[lane])
            raise Diverged(
                f"{name!r} of realization {realization} left the range of finite numbers before t = {self.time:g} s. "
                "Use a smaller step, or check the forces."
            )

    def measure(self) -> BlockResult:
        """Run all batches after the spin-up and return their sums."""
        plan = self.plan
        start = self._edge() if plan.transient else None
        run = RecordedRun(plan)
        keepers = [record.keeper(run, self.realizations, ratio) for record, ratio in plan.observed.records]
        if any(keeper.wants_start for keeper in keepers):
            if not plan.method.integrator.kicks:
                self.state.velocity[:] = self.state.v
            own = plan.clock.spin_up_steps == 0 and not plan.start.given
            if not plan.method.integrator.kicks or own:  # the state itself, not where a kick is read
                self.state.reading[:] = self.state.x
                self._evaluate(self.state.reading, self.state.velocity)
            first = self._snapshot()
            first[plan.snapshot.impulsive] = 0.0
            for keeper in keepers:
                keeper.start(first)
        means = [IntervalMeans(plan.snapshot.impulsive, keeper) for keeper in keepers]
        if plan.method.integrator.kicks:  # others sample the beginning of each step
            place = self.state.reading if plan.clock.spin_up_steps or plan.start.given else self.state.x
            self.note_gaps(place, self.state.velocity)
        kept: list[np.ndarray] = []
        begin = 0
        for batch, end in enumerate(plan.clock.boundaries):
            self._clear_sums()

            def sample(snapshots: np.ndarray, batch: int = batch) -> None:
                for keeper, mean in zip(keepers, means, strict=True):
                    keeper.add(mean(snapshots), batch)

            self.advance(end - begin, sample)
            self._collect_sums()
            self.sums.bodies[:, :F] *= plan.method.interval  # states are added once per interval
            bodies = with_samples(self.sums.bodies, self.sums.samples)
            totals: tuple[np.ndarray, ...] = bodies, self.sums.contacts, self.sums.products, self.sums.points.sums
            if start is not None:
                last = self._edge()
                totals, start = over_time(plan, self.sums, self.intensity, begin, end, start, last), last
            totals = *totals, self._of_laws()
            kept = kept or [np.empty((len(plan.clock.boundaries), *total.shape)) for total in totals]
            for total, sums in zip(totals, kept, strict=True):
                sums[batch] = total
            begin = end
        for keeper in keepers:
            if keeper.wants_end:
                keeper.end(self._final())
        endless = self.events.impacts.seen[[ENDLESS, SLOW]]
        bodies, contacts, products, points, laws = kept
        return BlockResult(bodies, contacts, products, points, laws, endless, [keeper.result() for keeper in keepers])

    def _snapshot(self) -> np.ndarray:
        """Return where bodies are read, velocities, contact forces, states of laws and peaks, [quantity, lane]."""
        state = self.state
        peaks = state.contact_force if self.plan.snapshot.peaked else state.contact_force[:0]
        return np.concatenate([state.reading[:-1], state.velocity[:-1], state.contact_force, self.states, peaks])

    def begin(self, x: np.ndarray, v: np.ndarray, now: int) -> None:
        """Go on from displacements before a kick, and velocities, of all bodies after some steps."""
        self.state.x[:-1], self.state.v[:-1], self.now = x, v, now
        self.events.rubbing.seen[:] = 0.0
        self._half_kick(False)
        self.note_gaps(self.state.reading, self.state.velocity)

    def note_gaps(self, x: np.ndarray, v: np.ndarray) -> None:
        """Store the gaps and their rates from which closings are counted, where they are counted."""
        if not self.plan.observed.counted:
            return
        contacts = slice(self.plan.observed.contacts)
        ends, clearance = self.plan.system.ends.chosen(contacts), self.plan.system.clearance[contacts, None]
        self.sums.closings.before[0] = ends.gap(x) - clearance
        self.sums.closings.before[1] = ends.rates(x, v)

    def segment(self, steps: int) -> tuple[np.ndarray, ...]:
        """Make some steps and return their sums over bodies, contacts, pairs and laws, as a transient needs them."""
        begin, first = self.now - self.plan.clock.spin_up_steps, self._edge()
        self._clear_sums()
        self.advance(steps, lambda snapshots: None)
        self._collect_sums()
        last = self._edge()
        bodies, contacts, products, _ = over_time(
            self.plan, self.sums, self.intensity, begin, begin + steps, first, last
        )
        return bodies, contacts, products, self._of_laws()

    def _edge(self) -> Edge:
        """Return what the present state adds to the sums of a transient."""
        plan, state = self.plan, self.state
        if not plan.method.integrator.kicks:
            state.reading[:], state.velocity[:] = state.x, state.v
            self._evaluate(state.reading, state.velocity)
        return edge_of(plan, state, self.sums, (self.now - 1) % plan.method.integrator.phases)

    def _clear_sums(self) -> None:
        self.intensity = np.zeros((self.plan.method.integrator.phases, len(self.plan.noise.white)))
        sums = self.sums
        for total in (sums.bodies, sums.contacts, sums.products, sums.samples, sums.points.sums):
            total[:] = 0.0
        sums.closings.peaks.before[[LARGEST_FORCE, OF_BATCH]] = np.nan
        if self.remembering:
            self.begun = self.states.copy()
            *totals, before = sums_in(self.parameters, *self.begun.shape)
            before[:] = self.begun
            for total in totals:
                total[:] = 0.0

    def _collect_sums(self) -> None:
        """Bring all sums together."""
        self._take_peaks()

    def _take_peaks(self) -> None:
        """Take the largest forces from between the steps for those contacts whose peaks were read there."""
        sums = self.sums
        peaks = sums.closings.peaks
        if self.plan.observed.rated.any():
            found = np.fmax(peaks.before[LARGEST_FORCE], peaks.before[OF_BATCH])
            largest = sums.contacts[peaks.row]
            np.copyto(largest, found, where=~np.isnan(found))
