"""One block of realizations: its start, its steps, and what it measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.build import build
from impactlab.errors import Diverged
from impactlab.integrators.arguments import Driven, Forced, Noise, Series, Steps, Tables
from impactlab.integrators.driver import colliding, filtering, sliding
from impactlab.integrators.stretches import stretching, worth_compiling
from impactlab.kernels.functions_of_time import sum_panels
from impactlab.kernels.impacts import ENDLESS
from impactlab.kernels.jit import evaluate, evaluator
from impactlab.kernels.memory import TIMES, accept, with_states
from impactlab.kernels.peaks import LARGEST as LARGEST_FORCE
from impactlab.kernels.random import fill_normals
from impactlab.kernels.rows import BEGUN, FLUX, INTENSITY, KICK_ROWS, SQUARES, TRANSIENT_ROWS, F
from impactlab.kernels.series import NEAR
from impactlab.kernels.sums import SLOTS
from impactlab.linear.band_limited import PLACES as PANEL_PLACES
from impactlab.linear.band_limited import POINTS, panel_steps, panel_weights
from impactlab.linear.cosine_series import Cosines, sample_count
from impactlab.linear.given_functions import NODES, PANELS, PLACES, joined, looked_at, mean_and_slope, motion_at
from impactlab.nonlinear.force_checks import LARGEST
from impactlab.plan.driving import GivenMotion
from impactlab.plan.in_registers import layout_of
from impactlab.plan.plan import Plan
from impactlab.results.schema import BODY, CONTACT, sampled_of
from impactlab.simulation.arrays import allocate
from impactlab.simulation.filter_states import filter_states
from impactlab.simulation.smooth_path import Laws, SmoothPath

ATTEMPTS = 100
"""How often a random start is drawn again while a contact is closed."""

HOPELESS = 20
"""Contacts closed in the first draw from which on no draw will have none."""

SNAPSHOT_BYTES = 16_000_000
"""Memory that the samples of a call may take."""

TABLE = 100_000
"""Values of functions of time that are in memory at a time."""

WORTH_COMPILING = 20.0
"""Work of a run (s) from which on a loop without samples that are not wanted, which saves 5 % of it, is compiled."""

Tick = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class BlockResult:
    """What a block returns: sums per batch and realization, and what its records kept."""

    bodies: np.ndarray  # (batch, phase, row, body, lane)
    contacts: np.ndarray  # (batch, row, contact, lane)
    products: np.ndarray  # (batch, row, pair, lane)
    points: np.ndarray  # (batch, phase, row, point, lane)
    endless: np.ndarray  # (rigid, lane) number of the first step, from 1 on, with too many impacts; 0 for none
    records: list[dict[str, np.ndarray]] = field(default_factory=list)  # one dictionary of arrays per record


class Edge(NamedTuple):
    """What the state at one moment is worth in the sums."""

    bodies: np.ndarray  # (row, body, lane)
    contacts: np.ndarray  # (row, contact, lane)
    products: np.ndarray  # (row, pair, lane)
    samples: np.ndarray  # (row, body, lane)
    points: np.ndarray  # (row, point, lane), those of squares


def compiled(plan: Plan) -> tuple[ModuleType, Callable[..., None]]:
    """Return the module of a plan's forces and the loop over its steps, compiled where that is still to be done."""
    if plan.method.integrator.kicks:
        evaluator(plan.single)
    left_out = plan.observed.left_out if plan.work > WORTH_COMPILING else frozenset()
    return build(plan.forces.text), plan.method.loop(plan.single, left_out)


class Block:
    """The arrays of one block while it runs."""

    noise_sets, force_sets = 1, 1
    """Sets of intensities and given forces that are independent of each other."""

    def __init__(self, plan: Plan, index: int, tick: Tick) -> None:
        self.plan, self.tick = plan, tick
        self.responses: list[Cosines] = []  # of sums of cosines, and the contacts whose gap is known after each
        self.known: list[np.ndarray] = []
        self.module, self.loop = compiled(plan)
        layout = layout_of(plan)
        in_registers = layout is not None and worth_compiling(layout, plan.clock.all_steps)
        self.stretch = stretching(layout)[1] if in_registers else 0
        self.realizations = plan.realizations.of(index)
        self.now = 0
        lanes = len(self.realizations)
        # of each phase, by that of the plan
        self.intensity = np.zeros((plan.method.integrator.phases, len(plan.noise.white)))
        arrays = allocate(plan, lanes)
        self.state, self.history, self.sums, self.normals, self.distinct, self.parameters, events = arrays
        closings = self.sums.closings
        closings.before[:] = closings.peaks.before[:] = np.nan
        if plan.observed.rated:
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
        if plan.driving.lines:
            self.series = self._of_series(*self._start_with_cosines())
        else:
            self._start(np.arange(len(self.realizations)))
        self._put_given_motions(self.state.x, self.state.v)
        given = (self.state.x[:-1].copy(), self.state.v[:-1].copy()) if kicks and plan.start.given else None
        if kicks:
            self._half_kick(plan.start.given)
        if self.remembering:
            self._accept()
        if given is not None:
            self._begin_on_path(*given)

    def begin_as(self, plan: Plan) -> None:
        """Begin as a block of another plan does, of one `impactlab.plan.side_by_side.structure` with that before."""
        forces, lanes = plan.forces, len(self.realizations)
        self.plan, self.parameters = plan, forces.parameters
        if forces.clocked:
            self.parameters = with_states(forces.parameters, forces.states, lanes, np.zeros)
        state, turns = self.state, self.sums.turns
        for array in (state.x, state.v, state.reading, state.velocity, state.total, turns.force, turns.middle):
            array.fill(0.0)
        self._begin()

    def _put_given_motions(self, x: np.ndarray, v: np.ndarray) -> None:
        """Put displacements and velocities of bodies of given motion among others, (body and wall, lane) each."""
        for motion in self.plan.driving.motions:
            place, speed = self._moved(motion, 0)
            x[motion.slot], v[motion.slot] = place[0], speed[0]

    def _of_series(self, slots: np.ndarray, samples: np.ndarray) -> Series:
        """Return the series of a block: samples of sums of cosines on some slots, and coloured noises."""
        noise, lanes = self.plan.driving.coloured, len(self.realizations)
        near = (NEAR + 1, samples.shape[1] + noise.rows, lanes) if self.plan.driving.series else (1, 0, 1)
        return Series(np.concatenate([slots, noise.slots]), samples, np.zeros(near), self.coloured)

    def _start(self, lanes: np.ndarray) -> int:
        """Set the state of some lanes at the beginning; return the largest number of draws before the last."""
        plan, state = self.plan, self.state
        attempt = 0
        if isinstance(plan.start.state, np.ndarray):
            self._put_given(plan.start.state, lanes)
        elif plan.start.state == "stationary":
            redraw, resting = lanes, lanes[:0]
            for attempt in range(ATTEMPTS):
                state.x[:, redraw], state.v[:, redraw] = self._draw(redraw, attempt)
                closed = self._closed(state.x[:, redraw], slice(None))
                if attempt == 0:
                    resting = redraw[closed > HOPELESS]
                redraw = redraw[(closed > 0) & ((closed <= HOPELESS) | (attempt > 0))]
                if not redraw.size:
                    break
            resting = np.concatenate([resting, redraw])
            if resting.size:
                cold = plan.cold  # what only contacts heat stays cold for long: all its energy is in the velocity
                velocity = np.sqrt(2.0) * self._draw(resting, 0)[1][cold] if cold.size else 0.0
                state.x[:-1, resting] = plan.start.rest[:, None]
                state.v[:, resting] = 0.0
                state.v[cold[:, None], resting] = velocity
        else:
            state.x[:-1, lanes] = plan.start.rest[:, None]
        if plan.start.given or plan.start.state != "stationary":
            self._draw_filters(lanes, 0)
        return attempt

    def _put_given(self, given: np.ndarray, lanes: np.ndarray) -> None:
        """Put displacements and velocities that are given into some lanes, and states of laws if there are some.

        There may be more realizations than values, in measurements of the step: these then come again.
        """
        chosen = self.realizations[lanes] % given.shape[2]
        self.state.x[:-1, lanes], self.state.v[:-1, lanes] = given[:, :, chosen]
        if self.plan.start.laws is not None:
            self.states[:, lanes] = self.plan.start.laws[:, self.realizations[lanes] % self.plan.start.laws.shape[1]]

    def _draw(self, lanes: np.ndarray, attempt: int) -> tuple[np.ndarray, np.ndarray]:
        """Draw displacements and velocities of some lanes from the linear law, (body and wall, lane) each."""
        plan = self.plan
        realizations = np.ascontiguousarray(self.realizations[lanes])
        x, v = np.zeros((2, plan.system.linear.shape[1] + 1, len(lanes)))
        if plan.start.deviations.any() or plan.start.factors:
            normals = np.empty((4, len(x) - 1, len(lanes)), dtype=np.float32)
            fill_normals(plan.start.streams, realizations, np.uint64(attempt), normals)
            x[:-1], v[:-1] = (plan.start.deviations[row][:, None] * normals[row] for row in (0, 1))
        for slots, factor in plan.start.factors:
            independent = np.concatenate([normals[0, slots], normals[1, slots]])
            joint = sum(column[:, None] * row for column, row in zip(factor.T, independent, strict=True))
            x[slots], v[slots] = np.split(joint, 2)  # the same bits in any block, as a matrix product would not be
        for (slots, _), cosines, known in zip(plan.driving.responses, self.responses, self.known, strict=True):
            for column, realization in enumerate(realizations):
                steady = cosines.start(int(realization), attempt)
                x[slots, column] += steady[0::2]
                v[slots, column] += steady[1::2]
            if known.size and self._closed(x, known).all():
                break  # the rest does not matter: these will be drawn again
        for slots, moved in self._draw_filters(lanes, attempt):
            x[slots] += moved[0]
            v[slots] += moved[1]
        self._put_given_motions(x, v)
        return x, v

    def _draw_filters(self, lanes: np.ndarray, attempt: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Draw the states that filters of noise begin with in some lanes.

        Return slots of the bodies that each moves, and their displacements and velocities, (2, body, lane).
        """
        result = []
        for start in self.plan.driving.coloured.starts:
            rows = start.draw(np.ascontiguousarray(self.realizations[lanes]), attempt)
            count = start.states.stop - start.states.start
            for kept in self.coloured.kept:
                kept[start.states, lanes] = self._given_or(rows[:count], start.states, lanes)
            result.append((start.slots, rows[count:].reshape(2, -1, len(lanes))))
        return result

    def _given_or(self, drawn: np.ndarray, states: slice, lanes: np.ndarray) -> np.ndarray:
        """Return states of a filter in some lanes, (row, lane): those that are given, else what was drawn."""
        given = self.plan.start.filters
        if given is None:
            return drawn
        known = given[states][:, self.realizations[lanes] % given.shape[1]]
        return np.where(np.isnan(known), drawn, known)

    def _closed(self, x: np.ndarray, contacts: np.ndarray | slice) -> np.ndarray:
        """How many of some contacts are closed at these displacements of the bodies and the wall, (lane,)."""
        gap = self.plan.system.ends.chosen(contacts).gap(x)
        closed: np.ndarray = np.sum(gap > self.plan.system.clearance[contacts, None], axis=0)
        return closed

    def _start_with_cosines(self) -> tuple[np.ndarray, np.ndarray]:
        """Start the realizations one after the other, and sample the cosines of each for the whole run.

        Return the slots of what they move, and the samples, (lane, row, time).
        """
        plan, method = self.plan, self.plan.method.integrator
        driving, seed = plan.driving, plan.realizations.seed
        interval = plan.clock.step / method.samples_per_step
        needed = plan.clock.all_steps * method.samples_per_step + 1
        self.responses = sampled = [
            Cosines(seed, lines, response.T, True, interval if method.takes_response else None, needed)
            for lines, (_, response) in zip(driving.lines, driving.responses, strict=True)
        ]
        last = np.full(plan.system.linear.shape[1], -1)
        for index, (slots, _) in enumerate(plan.driving.responses):
            last[slots] = index
        latest = plan.system.ends.largest(last, -1)
        self.known = [np.flatnonzero(latest == index) for index in range(len(driving.lines))]
        if not method.takes_response:
            sampled = [
                Cosines(seed, item, gains, False, interval, needed)
                for item, gains in ((item, item.gains) for item in driving.lines)
            ]
        ends = np.cumsum([item.channels for item in sampled])
        lanes = len(self.realizations)
        samples = np.empty((lanes, ends[-1], sample_count(plan.driving.lines, interval, needed)))
        for lane, realization in enumerate(self.realizations):
            self.tick(0)
            attempt = self._start(np.array([lane]))
            for item, end in zip(sampled, ends, strict=True):
                item.sample(int(realization), attempt, samples[lane, end - item.channels : end])
        slots = np.concatenate([slots for slots, _ in plan.driving.responses])
        return slots, samples

    def _half_kick(self, given: bool) -> None:
        """Bring the velocity from the time of the displacement to the end of the kick there.

        A displacement that is `given` is where the kick is read.
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
        """Add to the velocities what those at the kicks have beyond the velocities of the smooth path, (body, lane)."""
        self.state.v[:-1] += self._beyond_path(x, v)

    def _beyond_path(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return what velocities at kicks have beyond those of the smooth path, (body, lane)."""
        laws = Laws(self.states[None], np.array([self.time]))
        _, before = SmoothPath(self.plan, self.evaluate).begin(x[None], v[None], laws)
        beyond: np.ndarray = before[0] - v
        return beyond

    def _final(self) -> np.ndarray:
        """Return a snapshot from which another run can go on, with velocities as `_begin_on_path` takes them, and the
        states of filters.
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
        """Evaluate the forces in some states; see `impactlab.kernels.jit.evaluate`.

        Laws have the states that they have now or others, in each state, accepted some time before (s).
        """
        parameters, indices = self.parameters, self.plan.forces.indices
        if not self.plan.forces.clocked or laws is None:
            if self.plan.forces.clocked:
                parameters[-TIMES:] = self.time, elapsed
            evaluate(self.module.forces, x, v, parameters, indices, *result)
            return
        parameters = parameters.copy()
        for index, (states, time) in enumerate(zip(*laws, strict=True)):
            parameters[-TIMES:] = time, elapsed
            self._states_in(parameters)[:] = states
            here = (item[index : index + 1] for item in result)
            evaluate(self.module.forces, x[index : index + 1], v[index : index + 1], parameters, indices, *here)

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
        first, lanes = len(self.plan.forces.parameters), len(self.realizations)
        rows: np.ndarray = parameters[first : first + len(self.plan.forces.states) * lanes]
        return rows.reshape(-1, lanes)

    def _accept(self) -> None:
        """Bring the states of laws from their start values to the start, at once."""
        kicks, state = self.plan.method.integrator.kicks, self.state
        place = (state.reading, state.velocity) if kicks else (state.x, state.v)
        self.parameters[-TIMES:] = self.time, 0.0
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
            mean, _, least = self._over_steps(count, self.module.intensity, noise.shares.noises, self.noise_sets)
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
        mean, slope, _ = self._over_steps(number, self.module.modulation, rows, 1, first, per_step)
        times = ((first + np.arange(number)) / per_step - plan.clock.spin_up_steps) * plan.clock.step
        value = np.empty((number, rows))
        self.module.modulation(times, plan.forces.parameters, plan.forces.indices, value)
        coloured = self.coloured._replace(factors=np.stack([value, mean, slope], axis=1), first=first)
        return self.series._replace(coloured=coloured)

    def _forced(self, count: int) -> Forced:
        plan = self.plan
        if not len(plan.driving.forced):
            return Forced(plan.driving.forced, np.zeros((0, 0)))
        if plan.method.integrator.takes_response:
            return Forced(plan.driving.forced, plan.driving.on_bodies(self._given(count)))
        per_step = plan.method.integrator.samples_per_step
        first = (self.now - plan.clock.spin_up_steps) * per_step
        times = (first + np.arange(count * per_step + 1)) * (plan.clock.step / per_step)
        force = np.empty((len(times), plan.driving.given))
        self.module.forcing(times, plan.forces.parameters, plan.forces.indices, force)
        return Forced(plan.driving.forced, plan.driving.on_bodies(force))

    def _given(self, count: int) -> np.ndarray:
        """Return mean and slope of all given forces over the next steps, in turn, (2 step, row)."""
        plan = self.plan
        steps_of = panel_steps(plan.driving.highest, plan.clock.step)
        if steps_of.all():
            both = np.empty((2 * count, plan.driving.given))
        else:
            mean, slope, _ = self._over_steps(count, self.module.forcing, plan.driving.given, self.force_sets)
            both = np.stack([mean, slope], axis=1).reshape(2 * count, -1)
        for steps in np.unique(steps_of[steps_of > 0]).tolist():
            rows = np.flatnonzero(steps_of == steps)
            both[:, rows] = self._in_panels(count, steps)[:, rows]
        for motion in plan.driving.motions:
            x, v = self._moved(motion, count)
            both[:, motion.force] = motion.pushes(x, v, plan.clock.step)
        return both

    def _moved(self, motion: GivenMotion, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return displacement and velocity of a body of given motion now and after each of the next steps."""
        plan = self.plan
        times = (self.now + np.arange(count + 1) - plan.clock.spin_up_steps) * plan.clock.step

        def displacement(at: np.ndarray) -> np.ndarray:
            values = np.empty((at.size, plan.driving.given))
            self.module.forcing(at.ravel(), plan.forces.parameters, plan.forces.indices, values)
            return values[:, motion.force].reshape(at.shape)

        return motion_at(displacement, motion.displacement, times, plan.clock.step, begins=self.now == 0)

    def _in_panels(self, count: int, steps: int) -> np.ndarray:
        """Return the same by panels of some steps, which begin at multiples of these whatever steps are asked for."""
        plan, rows, weights = self.plan, self.plan.driving.given, panel_weights(steps)
        first, last = self.now // steps, -(-(self.now + count) // steps)
        most = max(1, TABLE // (POINTS * rows))
        parts = []
        for begin in range(first, last, most):
            panels = np.arange(begin, min(begin + most, last))
            times = ((panels[:, None] + PANEL_PLACES) * steps - plan.clock.spin_up_steps) * plan.clock.step
            values = np.empty((len(panels), POINTS, rows))
            self.module.forcing(times.ravel(), plan.forces.parameters, plan.forces.indices, values.reshape(-1, rows))
            sums = np.empty((rows, len(panels), 2 * steps))
            sum_panels(values, weights, sums)
            parts.append(sums.reshape(rows, -1))
        before = 2 * (self.now - first * steps)
        return np.concatenate(parts, axis=1).T[before : before + 2 * count]

    def _over_steps(
        self,
        count: int,
        table: Any,
        rows: int,
        sets: int = 1,
        begins: int | None = None,
        per_step: int = 1,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return mean and slope of functions of time over the next steps, (step, row), and the least value, (step,).

        The measurement begins at 0. Rows are those of some sets, one set after the other, each of which has the bits
        that it has alone. Parts of steps may be asked for in their place, so many `per_step`, and where they begin by
        the number of the first one.
        """
        plan = self.plan
        mean, slope, least = *np.empty((2, sets, count, rows // sets)), np.empty(count)
        most = max(1, TABLE // (len(NODES) * rows))

        def seen(begin: np.ndarray, places: np.ndarray) -> np.ndarray:
            """Return values at some places from the beginnings of steps, (set, …, row, place)."""
            times = (begin[..., None] + places / per_step) * plan.clock.step
            values = np.empty((times.size, rows))
            table(times.ravel(), plan.forces.parameters, plan.forces.indices, values)
            each = np.moveaxis(values.reshape(*times.shape, sets, rows // sets), -2, 0)
            return np.ascontiguousarray(each).swapaxes(-1, -2)

        for begin in range(0, count, most):
            steps = np.arange(begin, min(begin + most, count))
            first = (self.now if begins is None else begins / per_step) - plan.clock.spin_up_steps + steps / per_step
            values = seen(first, PLACES)
            mean[:, steps], slope[:, steps] = mean_and_slope(values[..., 1:-1])
            rough, inside = looked_at(values)
            least[steps] = inside.min(axis=(0, 2))  # without the ends: a function may end with the run
            again = np.asarray(rough.any(axis=-1))
            chosen = np.flatnonzero(again.any(axis=0))
            if chosen.size:
                values = seen(first[chosen, None] + np.arange(PANELS) / (PANELS * per_step), NODES / PANELS)
                least[steps[chosen]] = np.minimum(least[steps[chosen]], values.min(axis=(0, 2, 3, 4)))
                parts = joined(*(item.swapaxes(-1, -2) for item in mean_and_slope(values)))
                for result, part in zip((mean, slope), parts, strict=True):
                    result[:, steps[chosen]] = np.where(again[:, chosen, None], part, result[:, steps[chosen]])
        mean, slope = (np.moveaxis(item, 0, 1).reshape(count, rows) for item in (mean, slope))
        return mean, slope, least

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
        keepers = [record.keeper(plan, self.realizations, ratio) for record, ratio in plan.observed.records]
        if any(keeper.wants_start for keeper in keepers):
            if not plan.method.integrator.kicks:
                self.state.velocity[:] = self.state.v
            own = plan.clock.spin_up_steps == 0 and not plan.start.given
            if not plan.method.integrator.kicks or own:  # the state itself, not where a kick is read
                self.state.reading[:] = self.state.x
                self._evaluate(self.state.reading, self.state.velocity)
            first = self._snapshot()
            for keeper in keepers:
                keeper.start(first)
        if plan.method.integrator.kicks:  # others sample the beginning of each step
            place = self.state.reading if plan.clock.spin_up_steps or plan.start.given else self.state.x
            self.note_gaps(place, self.state.velocity)
        kept: list[np.ndarray] = []
        begin = 0
        for batch, end in enumerate(plan.clock.boundaries):
            self._clear_sums()

            def sample(snapshots: np.ndarray, batch: int = batch) -> None:
                for keeper in keepers:
                    keeper.add(snapshots, batch)

            self.advance(end - begin, sample)
            self._collect_sums()
            self.sums.bodies[:, :F] *= plan.method.interval  # states are added once per interval
            bodies = self._with_samples(self.sums.bodies, self.sums.samples)
            totals = bodies, self.sums.contacts, self.sums.products, self.sums.points.sums
            if start is not None:
                last = self._edge()
                totals, start = self._over_time(begin, end, start, last), last
            kept = kept or [np.empty((len(plan.clock.boundaries), *total.shape)) for total in totals]
            for total, sums in zip(totals, kept, strict=True):
                sums[batch] = total
            begin = end
        for keeper in keepers:
            if keeper.wants_end:
                keeper.end(self._final())
        bodies, contacts, products, points = kept
        endless = self.events.impacts.seen[ENDLESS].copy()
        return BlockResult(bodies, contacts, products, points, endless, [keeper.result() for keeper in keepers])

    def _snapshot(self) -> np.ndarray:
        """Return where bodies are read, their velocities, contact forces and states of laws, [quantity, lane]."""
        state = self.state
        return np.concatenate([state.reading[:-1], state.velocity[:-1], state.contact_force, self.states])

    def begin(self, x: np.ndarray, v: np.ndarray, now: int) -> None:
        """Go on from displacements before a kick, and velocities, of all bodies after some steps."""
        self.state.x[:-1], self.state.v[:-1], self.now = x, v, now
        self.events.rubbing.seen[:] = 0.0
        self._half_kick(False)
        self.note_gaps(self.state.reading, self.state.velocity)

    def note_gaps(self, x: np.ndarray, v: np.ndarray) -> None:
        """Tell where the gaps are from which closings are counted, if they are."""
        if not self.plan.observed.counted:
            return
        contacts = slice(self.plan.observed.contacts)
        ends, clearance = self.plan.system.ends.chosen(contacts), self.plan.system.clearance[contacts, None]
        self.sums.closings.before[0] = ends.gap(x) - clearance
        self.sums.closings.before[1] = ends.rates(x, v)

    def segment(self, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Make some steps and return their sums over bodies, contacts and pairs, as a transient needs them."""
        begin, first = self.now - self.plan.clock.spin_up_steps, self._edge()
        self._clear_sums()
        self.advance(steps, lambda snapshots: None)
        self._collect_sums()
        bodies, contacts, products, _ = self._over_time(begin, begin + steps, first, self._edge())
        return bodies, contacts, products

    def _edge(self) -> Edge:
        """Return what the state, of which a kick has just been made, adds to the sums."""
        plan, state = self.plan, self.state
        if not plan.method.integrator.kicks:
            state.reading[:], state.velocity[:] = state.x, state.v
            self._evaluate(state.reading, state.velocity)
        mass = plan.system.linear[0][:, None]
        x, f = state.x[:-1], state.total[:-1]
        v = state.v[:-1] - 0.5 * plan.clock.step / mass * f if plan.method.integrator.kicks else state.v[:-1]
        bodies = np.array([x, v, x * x, x * v, v * v, f, f * f, f * x, f * v])
        contacts, samples = np.zeros_like(self.sums.contacts), np.zeros_like(self.sums.samples)
        indentation = plan.system.ends.gap(state.reading) - plan.system.clearance[:, None]
        for sums, dimension, quantities in (
            (contacts[FLUX + 1 :], CONTACT, (indentation, state.contact_force)),
            (samples, BODY, (x, v)),
        ):
            for row, statistic in zip(sums, sampled_of(dimension), strict=True):
                if not statistic.largest:
                    row[:] = statistic.sample(*quantities)
        contacts[:, plan.impacts.rigid.contacts] = 0.0  # impulses and rests are those of whole steps
        products = np.zeros_like(self.sums.products)
        if products.size:
            i, j = self.sums.pairs.T
            products[:] = [one[i] * other[j] for one in (x, v, f) for other in (x, v, f)]
        phase = (self.now - 1) % plan.method.integrator.phases
        return Edge(bodies, contacts, products, samples, plan.points.squares(phase, x, v, f))

    @staticmethod
    def _with_samples(bodies: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """Return sums over bodies with those of what statistics sample in the last rows, all in the first phase."""
        if not len(samples):
            return bodies
        rows = np.zeros((len(bodies), *samples.shape))
        rows[0] = samples
        return np.concatenate([bodies, rows], axis=1)

    def _over_time(
        self, begin: int, end: int, first: Edge, last: Edge
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the sums of some steps as a transient needs them, from those of the kicks or states in them.

        Sums over kicks are of those that end the steps, other sums of the states that begin them.
        """
        plan, sums = self.plan, self.sums
        kicks, phases = plan.method.integrator.kicks, plan.method.integrator.phases
        half = [0.5 * (one - other if kicks else other - one) for one, other in zip(first, last, strict=True)]
        bodies = np.zeros((phases, TRANSIENT_ROWS if kicks else plan.rows, *sums.bodies.shape[2:]))
        bodies[:, : plan.rows] = sums.bodies
        count = KICK_ROWS if kicks else plan.rows
        bodies[0, :count] += half[0][:count]
        products = sums.products + half[2]
        if kicks:
            # the flow of each step begins at the kick before, of the phase before
            bodies[1:, BEGUN:INTENSITY], bodies[0, BEGUN:INTENSITY] = sums.bodies[:-1, :count], sums.bodies[-1, :count]
            bodies[(plan.clock.spin_up_steps + begin) % phases, BEGUN:INTENSITY] += first.bodies
            bodies[(plan.clock.spin_up_steps + end) % phases, BEGUN:INTENSITY] -= last.bodies
            bodies[:, INTENSITY] = plan.counts(begin, end)[:, None, None]
            if plan.noise.time_varying:
                bodies[:, INTENSITY, plan.noise.white] = self.intensity[..., None]
            products = np.concatenate([products, sums.products + first.products - last.products])
        points = sums.points.sums.copy()
        if plan.points:
            before = plan.clock.spin_up_steps - 1
            between = np.stack([np.zeros_like(plan.points.closed)] * 2 + [plan.points.closed] * 2)[..., None]
            points[0, SQUARES] += ~between * half[4]
            points[(before + begin) % phases, SQUARES] += between * first.points
            points[(before + end) % phases, SQUARES] -= between * last.points
        return self._with_samples(bodies, sums.samples + half[3]), sums.contacts + half[1], products, points

    def _clear_sums(self) -> None:
        self.intensity = np.zeros((self.plan.method.integrator.phases, len(self.plan.noise.white)))
        sums = self.sums
        for total in (sums.bodies, sums.contacts, sums.products, sums.samples, sums.points.sums):
            total[:] = 0.0
        sums.closings.peaks.before[LARGEST_FORCE] = np.nan

    def _collect_sums(self) -> None:
        """Bring all sums together."""
        self._take_peaks()

    def _take_peaks(self) -> None:
        """Let the largest forces be those that were read between steps, of contacts of which they were."""
        sums = self.sums
        peaks = sums.closings.peaks
        if self.plan.observed.rated:
            found = peaks.before[LARGEST_FORCE]
            largest = sums.contacts[peaks.row]
            np.copyto(largest, found, where=~np.isnan(found))
