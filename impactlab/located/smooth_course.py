"""Lanes of networks with smooth forces from their start to their end, by steps that end at events."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import ClassVar

import numpy as np

from impactlab.kernels import from_step_to_step as kernel
from impactlab.kernels.contact_states import CLOSED, OPEN
from impactlab.kernels.event_log import BEGAN, CLOSING, EVENT, NODE_STATE, OF_IMPACT, SUMS
from impactlab.kernels.from_event_to_event import (
    ARRIVED,
    CHATTERS,
    COUNT,
    EVALUATIONS,
    FASTEST,
    GATHERED,
    GRAZED,
    INTERRUPTED,
    NOW,
    RESTS_FROM,
    STUCK,
    WHICH,
    WORST,
    Lanes,
    Span,
)
from impactlab.kernels.memory import BEHIND
from impactlab.kernels.smooth_steps import STAGES, Memory, trial_for
from impactlab.located.limits import ROUGHER, Limits, stage_seconds
from impactlab.located.logs import NodesTaken, Taken, empty_logs, hand_on_nodes, room_for_nodes, room_in_log
from impactlab.located.scenes import TOUCHING
from impactlab.located.smooth import Smooth, bodies_of, rigid_of, stacked
from impactlab.machine import cores, uncollected

OF_TOLERANCE = 0.05
"""Part of the tolerance of a path that each step may add to its error."""

LEAST, LEAST_OF_STATES = 2e-15, 2e-12
"""Error of a step that rounding leaves; and where laws have states, whose rates are found from differences."""

ROUGH = 1e-2
"""Tolerance of the run that tells how large the motion comes to be."""

COARSER = 10.0
"""Factor of the tolerance of the path beside each path, whose distance from it tells the error."""

CHECKS = 64
"""Places at which both are compared, where no samples are taken."""

SECONDS_OF_CALL = 0.4
"""Length of a compiled call, about: some tenths of a second, for interrupts to be answered."""

FEW, SHORT_CALL = 64, 2e-3
"""Lanes that one core begins with alone, and for about how long (s): most of them have then arrived, and threads cost
more.
"""

STILL = 1e-12
"""Part of the time by which a lane goes on in a call, at least, or it does not get on."""

FIRST = 1e-3
"""First step, as a part of the longest one."""

LEAST_MOVE = 1e-2
"""Part of its displacement by which a body moves in a run at least, for the errors of its velocity: near a rest where
forces balance these are rounding, and no step is short enough for a part of the velocity that is left.
"""

ANGLE = 2.0
"""Longest step, as an angle of the fastest free motion (rad)."""


class SmoothCourse:
    """The run of some lanes, with their sums, samples and events.

    Parameters
    ----------
    networks : sequence of Smooth
        Networks of one structure, one a lane.
    x, v : (lane, body) ndarray
        Where the free bodies begin.
    states : (lane, state) ndarray
        Of laws, where lanes begin.
    begin, end : (lane,) ndarray
        From when to when they run (s).
    times : (lane, sample) ndarray
        When samples are taken (s).
    span : Span
    taken : callable, optional
        Takes events, see `impactlab.located.logs.Taken`.
    noded : callable, optional
        Takes nodes of integrals, see `impactlab.located.logs.NodesTaken`.
    with_states : bool
        Whether it takes displacements and velocities after these, too.
    compared : bool
        Whether a coarser path beside each path tells its error.
    """

    sliders: ClassVar[int] = 0
    """Coordinates behind those of bodies, of which there are none."""

    def __init__(
        self, networks: Sequence[Smooth], x: np.ndarray, v: np.ndarray, states: np.ndarray, begin: np.ndarray,
        end: np.ndarray, times: np.ndarray, span: Span, taken: Taken | None = None, with_states: bool = False,
        compared: bool = True, noded: NodesTaken | None = None,
    ) -> None:  # fmt: skip
        self.with_states, self.copies, self.noded = with_states, 1 + compared, noded
        self.number, self.begin, self.end, self.span = len(networks), begin, end, span
        first = np.maximum(begin, 0.0)
        checked = first[:, None] + (end - first)[:, None] * np.linspace(0.0, 1.0, CHECKS + 1)
        self.times = times if times.shape[1] else checked
        self.every = [*networks] * self.copies  # each lane, and its coarser one
        self.bodies, self.networks, self.states = bodies_of(self.every), networks, np.tile(states, (self.copies, 1))
        self.stuck: dict[int, str] = {}
        self._ended: list[int] = []
        self.taken = taken
        self.laws, self.contacts = networks[0].turns.laws, len(networks[0].model.ends)
        least = LEAST if (self.laws > 0).all() else LEAST_OF_STATES
        coarser = np.repeat([1.0, COARSER][: self.copies], self.number)
        allowed = max(OF_TOLERANCE * span.tolerance, least) * coarser
        self.memory = self._memory(allowed)
        room = 0 if taken is None else room_in_log(self.copies * self.number, self.contacts)
        x, v, times = (np.tile(item, (self.copies, 1)) for item in (x, v, self.times))
        self._all = self._lanes(x, v, times, room, noded is not None)
        self.lanes = Lanes(*(item[: self.number] for item in self._all))
        self._begin_contacts(self._all, self.memory)

    def _memory(self, allowed: np.ndarray) -> Memory:
        """Return what lanes remember at the start, each with the error that is allowed in a step."""
        every = self.every
        longest = np.minimum(stacked(every, longest_step), np.tile(self.end - self.begin, self.copies))
        parameters, count = stacked(every, lambda item: item.numbers), self.states.shape[1]
        parameters[:, parameters.shape[1] - BEHIND - count : parameters.shape[1] - BEHIND] = self.states
        return Memory(
            parameters,
            stacked(every, lambda item: np.pad(item.model.clearance, (0, len(item.turns.names)))),
            np.zeros((len(every), 2, self.bodies.linear.shape[2])),
            np.stack([FIRST * longest, longest, allowed, np.zeros(len(every))], axis=1),
            self.networks[0].ends(self.begin.min(), self.end.max()),
            np.abs(self.states),
            np.zeros((len(every), 6)),
        )

    def _lanes(self, x: np.ndarray, v: np.ndarray, times: np.ndarray, room: int, noded: bool) -> Lanes:
        number, bodies, contacts = len(x), x.shape[1], self.contacts
        columns = NODE_STATE + 2 * self.bodies.linear.shape[2] + contacts + self.memory.states.shape[1]
        clock = np.zeros((number, WORST + 1))
        clock[:, NOW] = np.resize(self.begin, number)
        return Lanes(
            np.ascontiguousarray(times, dtype=float),
            np.resize(self.end, number),
            np.ascontiguousarray(x, dtype=float),
            np.ascontiguousarray(v, dtype=float),
            np.full((number, len(self.bodies.places)), OPEN),
            clock,
            np.zeros((number, 0, 2 * bodies)),
            np.zeros((number, 0)),
            np.zeros((number, 0, 0)),
            np.zeros((number, 1), np.int64),
            np.zeros((number, 4, bodies + self.bodies.points.shape[1])),
            np.zeros((number, len(self.networks[0].flows))),
            np.zeros((number, SUMS, contacts)),
            np.full((*times.shape, 2 * bodies + contacts + self.memory.states.shape[1]), np.nan),
            np.zeros((number, room, EVENT)),
            np.zeros((number, room if self.with_states else 0, 2 * bodies)),
            np.zeros(number, np.int64),
            np.zeros((number, room_for_nodes(number, columns) if noded else 0, columns)),
            np.zeros(number, np.int64),
        )

    def _begin_contacts(self, lanes: Lanes, memory: Memory) -> None:
        """Close the contacts that are closed at the start, and let the others have no force."""
        number, count = len(lanes.x), self.contacts
        motions, links = self.bodies.motions[:number], self.bodies.links[:number, :count]
        clearances = memory.clearances[:number, :count]
        place = np.zeros((number, self.bodies.linear.shape[2]))
        place[:, self.networks[0].free] = lanes.x
        turn = np.exp(1j * self.bodies.frequencies[:number] * np.resize(self.begin, (number, 1)))[:, None, :]
        moving = motions[..., 1::2] + 1j * motions[..., 2::2]
        place += motions[..., 0] + (moving * turn).sum(axis=-1).real
        gap, rigid = np.einsum("lki,li->lk", links, place) - clearances, self.networks[0].rigid
        size = np.einsum("lki,li->lk", np.abs(links), np.abs(place)) + np.abs(clearances)
        self.overlap = np.where(rigid & (gap > TOUCHING * size), gap, 0.0)[: self.number]
        lanes.statuses[:, :count] = np.where((gap > 0.0) & ~rigid, CLOSED, OPEN)
        for contact, column in enumerate(self.bodies.places[:count]):
            if rigid[contact]:
                continue
            memory.parameters[:number][lanes.statuses[:, contact] == OPEN, column] = kernel.FAR
        lanes.contacts[:, OF_IMPACT], lanes.contacts[:, OF_IMPACT + CLOSING - BEGAN] = lanes.clock[:, [NOW]], np.nan

    def run(
        self, names: Callable[[int, int], str], show: Callable[[float], None] = lambda part: None,
        limits: Limits | None = None,
    ) -> None:  # fmt: skip
        """Run all lanes to their end, or beyond their limits; `names` gives the name of a contact of a lane.

        A coarse run before tells how large the motion comes to be, of which the tolerance is a part.
        """
        memory = self._memory(np.full(self.copies * self.number, OF_TOLERANCE * ROUGH))
        span = self.span._replace(summed=False)
        rough = self._lanes(self.lanes.x.copy(), self.lanes.v.copy(), self.times[:, :0], 0, False)
        self._let_rest(memory)
        self._begin_contacts(rough, memory)
        limits = limits or Limits()
        beyond = partial(limits.lanes_beyond, factor=2.0 * ROUGHER)  # a path, and the coarser one
        self._follow(rough, memory, span, names, lambda part: show(0.0), beyond)
        self.stuck.clear()
        for known, found in ((self.memory.sizes, memory.sizes), (self.memory.states, memory.states)):
            np.maximum(known, np.tile(found[: self.number], (self.copies, *[1] * (found.ndim - 1))), out=known)
        self._let_rest(self.memory)
        self._follow(self._all, self.memory, self.span, names, show, limits.lanes_beyond)
        if self.copies > 1:
            self._compare()

    def _let_rest(self, memory: Memory) -> None:
        """Give velocities a least size: that which moves a body by a part of its displacement in the run."""
        free, length = self.networks[0].free, np.tile(self.end - self.begin, self.copies)[:, None]
        place = np.maximum(memory.sizes[:, 0, free], np.abs(self._all.x))
        least = np.divide(LEAST_MOVE * place, length, out=np.zeros_like(place), where=length > 0.0)
        memory.sizes[:, 1, free] = np.maximum(memory.sizes[:, 1, free], least)

    def _follow(
        self, lanes: Lanes, memory: Memory, span: Span, names: Callable[[int, int], str],
        show: Callable[[float], None], beyond: Callable[[np.ndarray], list[int]],
    ) -> None:  # fmt: skip
        """Run lanes to their end; those that are `beyond` their limits end where they are, and begin no more."""
        number = len(lanes.x)
        results = np.full(number, -1)
        results.reshape(-1, self.number)[:, self._ended] = ARRIVED
        with uncollected():
            loop = kernel.stepping_loop()
        threads = min(cores(), number)
        first, rigid = self.networks[0], rigid_of(self.bodies, self.every)
        stages = int(SECONDS_OF_CALL / stage_seconds(len(first.free)))
        calls = [span._replace(looks=stages * threads // number + 100 * STAGES)]
        if number <= FEW:
            calls.append(span._replace(looks=int(SHORT_CALL / stage_seconds(len(first.free))) // number))
        sizes = first.sources, self.contacts, self.laws
        trials = [trial_for(self.bodies, first.free, *sizes) for _ in range(threads)]
        before = np.full(number, -np.inf)
        show(0.0)

        def call(thread: int, span: Span) -> None:
            for lane in range(thread, number, threads):  # lanes beside each other take as long
                loop(rigid, self.bodies, lanes, memory, span, trials[thread], lane, lane + 1, results)

        with ThreadPoolExecutor(threads) as pool:
            while (results != ARRIVED).any():
                alone, span = threads == 1 or len(calls) > 1, calls[-1]
                list((map if alone else pool.map)(partial(call, span=span), range(threads)))
                del calls[1:]
                if self.taken is not None:
                    lanes.logged[self.number :] = 0  # the events of coarser lanes are not wanted
                    empty_logs(lanes, self.taken, names, self.stuck)
                hand_on_nodes(lanes, self.noded, self.number)
                now = lanes.clock[:, NOW]
                results[(results == INTERRUPTED) & (now - before <= STILL * np.abs(now))] = STUCK
                before = now.copy()
                for lane in np.flatnonzero(results == STUCK).tolist():
                    self.stuck[lane % self.number] = _why(lanes.clock[lane], partial(names, lane % self.number))
                    results[lane] = ARRIVED
                self._ended += beyond(lanes.clock[:, EVALUATIONS].reshape(-1, self.number).sum(axis=0))
                results.reshape(-1, self.number)[:, self._ended] = ARRIVED
                done = lanes.clock[:, NOW].clip(max=lanes.ends) - np.resize(self.begin, number)
                show(float(done.sum() / max((lanes.ends - np.resize(self.begin, number)).sum(), 1e-300)))

    def _compare(self) -> None:
        """Write the estimated error of the displacements of each lane, at least that which is allowed in a step.

        Where steps end at many samples of a force, both paths are the same.
        """
        taken, bodies = self._all.samples, self._all.x.shape[1]
        apart = np.abs(taken[: self.number, :, :bodies] - taken[self.number :, :, :bodies])
        allowed = self.memory.steps[: self.number, 2] * self.memory.sizes[: self.number, 0].max(axis=1, initial=0.0)
        self.lanes.clock[:, WORST] = np.maximum(apart.max(axis=(1, 2), initial=0.0), allowed)

    @property
    def lasting(self) -> list[np.ndarray]:
        """Arrays that a run leaves to another one that goes on from its end, (lane, …), which may be changed."""
        lanes, memory, result = self._all, self.memory, list[np.ndarray]()
        contacts = lanes.contacts
        for item in (
            lanes.x, lanes.v, lanes.statuses, memory.parameters, memory.sizes, memory.steps[:, :1], memory.states,
            contacts[:, RESTS_FROM:CHATTERS], contacts[:, FASTEST:],
        ):  # fmt: skip
            result += np.split(item, self.copies)  # of each path, and of the coarser one
        return result

    def begin_sums(self) -> None:
        """Let sums begin where lanes do, after they were brought to the end of an earlier run."""
        self._all.contacts[:, [RESTS_FROM, OF_IMPACT]] = np.tile(self.begin, self.copies)[:, None, None]
        self._all.contacts[:, GATHERED] = 0.0

    @property
    def last_states(self) -> np.ndarray:
        """States of laws where lanes have ended, (lane, state)."""
        end, count = self.memory.parameters.shape[1] - BEHIND, self.states.shape[1]
        return self.memory.parameters[: self.number, end - count : end]

    @property
    def grazed(self) -> np.ndarray:
        """How often it was left open whether a contact closed, (lane,)."""
        return self.lanes.clock[:, GRAZED]


def longest_step(network: Smooth) -> float:
    """Return the longest step of a network, infinite where nothing in it has a frequency (s)."""
    mass, _, stiffness = network.linear
    rates = np.sqrt(stiffness[mass > 0.0] / mass[mass > 0.0])
    fastest = max(rates.max(initial=0.0), network.frequencies.max(initial=0.0))
    return float(ANGLE / fastest) if fastest > 0.0 else math.inf


def _why(clock: np.ndarray, name: Callable[[int], str]) -> str:
    """Say why a lane could not be followed to the end."""
    moving = repr(name(int(clock[WHICH]))) if clock[COUNT] else "The motion"
    return (
        f"{moving} cannot be followed beyond {clock[NOW]:.12g} s, after {clock[COUNT]:.0f} events. Results up to a "
        "shorter duration= are right."
    )
