"""The states that the realizations of a block begin with: given, drawn from the linear law, or at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from impactlab.integrators.arguments import State
from impactlab.kernels.random import fill_normals
from impactlab.linear.cosine_series import Cosines, sample_count
from impactlab.plan.plan import Plan
from impactlab.plan.processes import BlockProcesses

ATTEMPTS = 100
"""How often a random start is drawn again while a contact is closed."""


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
    processes : BlockProcesses
        Processes that push bodies; their states begin together with the states of the bodies.
    motions : sequence of (int, float, float)
        Slot, displacement and velocity of each body of given motion.
    """

    def __init__(
        self,
        plan: Plan,
        realizations: np.ndarray,
        state: State,
        laws: np.ndarray,
        processes: BlockProcesses,
        motions: Sequence[tuple[int, float, float]],
    ) -> None:
        self.plan, self.realizations, self.motions = plan, realizations, motions
        self.networks = plan.realizations.networks  # side by side: each draws until its own contacts are open
        self.state, self.laws, self.processes = state, laws, processes
        self.responses: list[Cosines] = []  # to sums of cosines; and the contacts whose gap is known after each
        self.known: list[np.ndarray] = []

    def put(self, lanes: np.ndarray) -> int:
        """Set the initial state of the given lanes; return the number of the last draw, counted from 0."""
        plan, state = self.plan, self.state
        attempt = 0
        if isinstance(plan.start.state, np.ndarray):
            self._put_given(plan.start.state, lanes)
        elif plan.start.state == "stationary":
            open_, attempt = self._put_open(lanes)
            if not open_.all():
                some = np.flatnonzero(~open_.all(axis=0))
                x, v = np.zeros((2, len(state.x), len(some)))
                x[:-1] = plan.start.rest[:, None]
                cold = plan.cold  # what only contacts heat stays cold for long: all its energy is in the velocity
                if cold.size:
                    v[cold] = np.sqrt(2.0) * self._draw(lanes[some], 0)[1][cold]
                self._put(~open_[:, some], lanes[some], x, v)
        else:
            state.x[:-1, lanes] = plan.start.rest[:, None]
        if self.processes.parts and (plan.start.given or plan.start.state != "stationary"):
            self.processes.draw(lanes, 0, plan.start.filters)
        for slot, *motion in self.motions:
            state.x[slot], state.v[slot] = motion
        return attempt

    def _put_open(self, lanes: np.ndarray) -> tuple[np.ndarray, int]:
        """Draw the states of the given lanes until no contact is closed.

        Return where this succeeded, (network, lane) of bool, and the largest number of draws before the last.
        """
        waiting = np.ones((self.networks, len(lanes)), dtype=bool)
        hopeless = ~waiting
        for attempt in range(ATTEMPTS):
            some = np.flatnonzero(waiting.any(axis=0))
            self._put(waiting[:, some], lanes[some], *self._draw(lanes[some], attempt))
            closed = self._closed(self.state.x[:, lanes[some]], slice(None))
            if attempt == 0:
                # hardly any further draw would have them all open
                hopeless = closed > 20
            waiting[:, some] &= (closed > 0) & ~hopeless[:, some]
            if not waiting.any():
                break
        return ~(waiting | hopeless), attempt

    def _put(self, chosen: np.ndarray, lanes: np.ndarray, x: np.ndarray, v: np.ndarray) -> None:
        """Write states, (body and wall, lane), of bodies of chosen networks, (network, lane), to the given lanes."""
        for array, values in ((self.state.x[:-1], x[:-1]), (self.state.v[:-1], v[:-1])):
            rows = np.tile(chosen, (len(array) // self.networks, 1))
            array[:, lanes] = np.where(rows, values, array[:, lanes])

    def _put_given(self, given: np.ndarray, lanes: np.ndarray) -> None:
        """Put displacements and velocities that are given into some lanes, and states of laws if there are some.

        Measurements of the step may have more realizations than there are values, which are then used again.
        """
        chosen = self.realizations[lanes] % given.shape[2]
        self.state.x[:-1, lanes], self.state.v[:-1, lanes] = given[:, :, chosen]
        if self.plan.start.laws is not None:
            self.laws[:, lanes] = self.plan.start.laws[:, self.realizations[lanes] % self.plan.start.laws.shape[1]]

    def _draw(self, lanes: np.ndarray, attempt: int) -> tuple[np.ndarray, np.ndarray]:
        """Draw displacements and velocities of the given lanes from the linear law, (body and wall, lane) each."""
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
            x[slots], v[slots] = np.split(joint, 2)  # unlike a matrix product it has the same bits in any block
        for (slots, _), cosines, known in zip(plan.driving.responses, self.responses, self.known, strict=True):
            for column, realization in enumerate(realizations):
                steady = cosines.start(int(realization), attempt)
                x[slots, column] += steady[0::2]
                v[slots, column] += steady[1::2]
            if known.size and self._closed(x, known).all():
                break  # the rest does not matter: these will be drawn again
        if self.processes.parts:
            for slots, moved in self.processes.draw(lanes, attempt, plan.start.filters):
                x[slots] += moved[0]
                v[slots] += moved[1]
        for slot, *motion in self.motions:
            x[slot], v[slot] = motion
        return x, v

    def _closed(self, x: np.ndarray, contacts: np.ndarray | slice) -> np.ndarray:
        """Number of closed contacts at given displacements of the bodies and the wall, (network, lane)."""
        closed = self.plan.system.ends.chosen(contacts).gap(x) > self.plan.system.clearance[contacts, None]
        return np.asarray(closed.reshape(-1, self.networks, x.shape[1]).sum(axis=0))

    def put_with_cosines(
        self, tick: Callable[[int], None], draws: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Start the realizations one after the other, and sample the cosines of each for the whole run.

        Return the number of each one's last draw, which is the given one where states are given, the slots of the
        bodies that cosines move, and the samples, (lane, row, time). `tick` is called before each.
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
        lanes, draws = len(self.realizations), draws.copy()
        samples = np.empty((lanes, ends[-1], sample_count(plan.driving.lines, interval, needed)))
        for lane, realization in enumerate(self.realizations):
            tick(0)
            draws[lane] += self.put(np.array([lane]))
            for item, end in zip(sampled, ends, strict=True):
                item.sample(int(realization), int(draws[lane]), samples[lane, end - item.channels : end])
        slots = np.concatenate([slots for slots, _ in plan.driving.responses])
        return draws, slots, samples
