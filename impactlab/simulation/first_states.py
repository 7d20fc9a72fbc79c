"""The states that the realizations of a block begin with: given, drawn from the linear law, or at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from impactlab.integrators.arguments import State
from impactlab.kernels.random import fill_normals
from impactlab.linear.cosine_series import Cosines, sample_count
from impactlab.plan.plan import Plan

ATTEMPTS = 100
"""How often a random start is drawn again while a contact is closed."""

HOPELESS = 20
"""Contacts closed in the first draw from which on no draw will have none."""


class FirstStates:
    """Puts the states at the beginning of the spin-up into the arrays of a block.

    Parameters
    ----------
    plan : Plan
    realizations : (lane,) ndarray of int
    state : State
        Displacements and velocities, 0 before.
    laws : (row, lane) ndarray
        States of laws, which keep their start values where no others are given.
    filters : (place, row, lane) ndarray
        Where states of filters of noise are kept.
    motions : sequence of (int, float, float)
        Slot, displacement and velocity of each body of given motion.
    """

    def __init__(
        self,
        plan: Plan,
        realizations: np.ndarray,
        state: State,
        laws: np.ndarray,
        filters: np.ndarray,
        motions: Sequence[tuple[int, float, float]],
    ) -> None:
        self.plan, self.realizations, self.motions = plan, realizations, motions
        self.state, self.laws, self.filters = state, laws, filters
        self.responses: list[Cosines] = []  # of sums of cosines, and the contacts whose gap is known after each
        self.known: list[np.ndarray] = []

    def put(self, lanes: np.ndarray) -> int:
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
        self._put_motions(state.x, state.v)
        return attempt

    def _put_given(self, given: np.ndarray, lanes: np.ndarray) -> None:
        """Put displacements and velocities that are given into some lanes, and states of laws if there are some.

        There may be more realizations than values, in measurements of the step: these then come again.
        """
        chosen = self.realizations[lanes] % given.shape[2]
        self.state.x[:-1, lanes], self.state.v[:-1, lanes] = given[:, :, chosen]
        if self.plan.start.laws is not None:
            self.laws[:, lanes] = self.plan.start.laws[:, self.realizations[lanes] % self.plan.start.laws.shape[1]]

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
        self._put_motions(x, v)
        return x, v

    def _draw_filters(self, lanes: np.ndarray, attempt: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Draw the states that filters of noise begin with in some lanes.

        Return slots of the bodies that each moves, and their displacements and velocities, (2, body, lane).
        """
        result = []
        for start in self.plan.driving.coloured.starts:
            rows = start.draw(np.ascontiguousarray(self.realizations[lanes]), attempt)
            count = start.states.stop - start.states.start
            for kept in self.filters:
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

    def _put_motions(self, x: np.ndarray, v: np.ndarray) -> None:
        """Put bodies of given motion among others, (body and wall, lane) each."""
        for slot, place, speed in self.motions:
            x[slot], v[slot] = place, speed

    def put_with_cosines(self, tick: Callable[[int], None]) -> tuple[np.ndarray, np.ndarray]:
        """Start the realizations one after the other, and sample the cosines of each for the whole run.

        Return the slots of what they move, and the samples, (lane, row, time). `tick` is called before each.
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
            tick(0)
            attempt = self.put(np.array([lane]))
            for item, end in zip(sampled, ends, strict=True):
                item.sample(int(realization), attempt, samples[lane, end - item.channels : end])
        slots = np.concatenate([slots for slots, _ in plan.driving.responses])
        return slots, samples
