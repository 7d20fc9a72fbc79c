"""Lanes from their start to their end: the compiled loop is called, and pieces are made, until all are there."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from impactlab.errors import ImpactLabError
from impactlab.kernels import from_event_to_event as kernel
from impactlab.kernels.contact_states import (
    CLOSED,
    DASHPOT,
    FRICTION,
    HELD,
    JENKINS,
    OPEN,
    PARTED,
    RIGID,
    SLIPS_DOWN,
    SLIPS_UP,
    STICKS,
)
from impactlab.kernels.event_log import BEGAN, CLOSING, EVENT, NODE_STATE, OF_IMPACT, SUMS
from impactlab.kernels.from_event_to_event import (
    ARRIVED,
    CHATTERS,
    CLOSINGS,
    COUNT,
    EVALUATIONS,
    GATHERED,
    GRAZED,
    INTERRUPTED,
    LOG_FULL,
    LOST,
    NEXT,
    NOW,
    PEAK,
    PRESSED,
    RATIO,
    STUCK,
    UNKNOWN_PIECE,
    WHICH,
    WORST,
    Lanes,
    Scene,
    Span,
)
from impactlab.kernels.pieces import Pieces
from impactlab.located.limits import Limits
from impactlab.located.logs import NodesTaken, Taken, empty_logs, hand_on_nodes, room_for_nodes, room_in_log
from impactlab.located.modes import parts, pieces_of
from impactlab.located.panels import panels_of
from impactlab.located.scenes import TOUCHING, Linear
from impactlab.machine import cores, uncollected

LOOKS_OF_CALL, LEAST_LOOKS = 1_000_000, 2000
"""Looks at the motion in a compiled call, about: some tenths of a second, for interrupts to be answered. And the least
of each lane."""

PLACES = 8
"""Pieces of a lane for which there is room at first."""

MEMORY = 2.5e8
"""Memory of pieces beyond which older ones are forgotten, and made again when they are met (bytes)."""


class Stuck(ImpactLabError):
    """The motion of a network cannot be followed beyond some time; the message says where, and why."""


@dataclass(eq=False)
class Course:
    """The run of some lanes, with their sums, samples and events.

    Parameters
    ----------
    scene : Linear
        The networks.
    x, v : (lane, body) ndarray
        Where they begin.
    begin, end : (lane,) ndarray
        From when to when they run (s).
    times : (lane, sample) ndarray
        When samples are taken (s).
    span : Span
    logged : bool
        Whether events are kept.
    states : bool
        Whether displacements and velocities after these are.
    taken : callable, optional
        Takes events in the place of their keeping, see `impactlab.located.logs.Taken`.
    noded : callable, optional
        Takes nodes of integrals, see `impactlab.located.logs.NodesTaken`.
    one : bool
        Whether all lanes are one network, whose pieces are made once.
    """

    scene: Linear
    x: np.ndarray
    v: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    times: np.ndarray
    span: Span
    logged: bool = False
    states: bool = False
    taken: Taken | None = None
    noded: NodesTaken | None = None
    one: bool = False
    lanes: Lanes = field(init=False)
    stuck: dict[int, str] = field(init=False, default_factory=dict)
    """Why lanes could not be followed to the end."""
    overlap: np.ndarray = field(init=False)
    """By how much hard bodies overlap where lanes begin, (lane, contact) (m); such lanes are not to be run."""

    def __post_init__(self) -> None:
        bodies, contacts, _ = self.scene.shape
        number = len(self.x)
        clock = np.zeros((number, WORST + 1))
        clock[:, NOW] = self.begin
        self.events: list[list[np.ndarray]] = [[] for _ in range(number)] if self.logged else []
        samples = self.times.shape[1]
        nodes = room_for_nodes(number, NODE_STATE + 2 * bodies + contacts) if self.noded else 0
        self.lanes = Lanes(
            np.ascontiguousarray(self.times, dtype=float),
            np.ascontiguousarray(self.end, dtype=float),
            np.ascontiguousarray(self.x, dtype=float),
            np.ascontiguousarray(self.v, dtype=float),
            np.zeros((number, contacts), np.int64),
            clock,
            *self._differences(None),
            np.full((number, PLACES), -1, np.int64),
            np.zeros((number, 4, bodies + self.scene.points.shape[1])),
            np.zeros((number, len(self.scene.flows))),
            np.zeros((number, SUMS, contacts)),
            np.full((number, samples, 2 * bodies + contacts), np.nan),
            np.zeros((number, room := room_in_log(number, contacts) if self.logged else 0, EVENT)),
            np.zeros((number, room if self.states else 0, 2 * bodies)),
            np.zeros(number, np.int64),
            np.zeros((number, nodes, NODE_STATE + 2 * bodies + contacts)),
            np.zeros(number, np.int64),
        )
        self._begin_contacts()
        self.pieces: Pieces | None = None
        self.made = 0  # pieces that there are
        self.chosen = np.ones(number, dtype=bool)  # lanes that run

    def _differences(self, given: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return differences of paths, the first one an estimated error, their delays, and room for their growth."""
        shape = len(self.x), 1 if given is None else 1 + given.shape[1], 2 * self.scene.shape[0]
        result = np.zeros(shape)
        result[:, 1:] = 0.0 if given is None else given
        return result, np.zeros(shape[:2]), np.zeros((*self.times.shape, shape[1] - 1))

    def _begin_contacts(self) -> None:
        """Close the contacts that are closed at the start."""
        scene, lanes = self.scene, self.lanes
        turn = np.exp(1j * scene.frequencies * self.begin[:, None])
        moving = scene.wall * turn[:, None, :]
        gap = np.einsum("lki,li->lk", scene.links, lanes.x) + scene.gap + moving.sum(-1).real
        rate = np.einsum("lki,li->lk", scene.links, lanes.v)
        rate += (1j * scene.frequencies[:, None, :] * moving).sum(-1).real
        size = np.einsum("lki,li->lk", np.abs(scene.links), np.abs(lanes.x)) + np.abs(scene.gap)
        size += np.abs(moving).sum(-1)
        indented = gap > TOUCHING * size
        soft = scene.kinds != RIGID
        self.overlap = np.where(indented & ~soft, gap, 0.0)
        pulling = scene.springs * gap + scene.dampers * rate <= 0.0
        status = np.where(indented & soft, CLOSED, OPEN)
        lanes.statuses[:] = np.where((status == CLOSED) & (scene.kinds == DASHPOT) & pulling, PARTED, status)
        rubs = scene.kinds >= FRICTION
        slip = (rate + scene.frictions[:, :, 2])[:, rubs]
        fast = np.einsum("lki,li->lk", np.abs(scene.links), np.abs(lanes.v)) + np.abs(scene.frictions[:, :, 2])
        fast += (scene.frequencies[:, None, :] * np.abs(scene.wall)).sum(-1)
        sticks = np.abs(slip) <= TOUCHING * fast[:, rubs]
        lanes.statuses[:, rubs] = np.where(sticks, STICKS, np.where(slip > 0.0, SLIPS_UP, SLIPS_DOWN))
        lanes.statuses[:, scene.kinds == JENKINS] = STICKS
        lanes.contacts[:, kernel.RESTS_FROM] = lanes.contacts[:, OF_IMPACT] = self.begin[:, None]
        lanes.contacts[:, OF_IMPACT + CLOSING - BEGAN] = np.nan

    def run(
        self, names: Callable[[int, int], str], show: Callable[[float], None] = lambda part: None,
        limits: Limits | None = None,
    ) -> None:  # fmt: skip
        """Run all lanes to their end, or beyond their limits; `names` gives the name of a contact of a lane."""
        limits = limits or Limits()
        scene, number = self._scene(), int(self.chosen.sum())
        bodies, contacts, waves = self.scene.shape
        results = np.where(self.chosen, UNKNOWN_PIECE if self.pieces is None else INTERRUPTED, ARRIVED)
        self._make_pieces(results)
        with uncollected():
            loop = kernel.located_loop()
        threads = min(cores(), max(1, number))
        span = self.span._replace(looks=max(LEAST_LOOKS, LOOKS_OF_CALL * threads // max(1, number)))
        begins = np.searchsorted(self.chosen.cumsum(), np.linspace(0, number, threads + 1), side="right")
        points, sources = self.scene.points.shape[1], self.scene.loads.shape[2]
        works = [kernel.work_for(bodies, points, waves, contacts, sources) for _ in range(threads)]
        before = np.full((len(self.x), 2), -np.inf)
        show(0.0)
        with ThreadPoolExecutor(threads) as pool:
            while (results != ARRIVED).any():
                assert self.pieces is not None
                pieces = self.pieces

                def call(thread: int, pieces: Pieces = pieces) -> None:
                    first, last = int(begins[thread]), int(begins[thread + 1])
                    loop(scene, pieces, self.lanes, span, works[thread], first, last, results)

                if threads == 1:
                    call(0)
                else:
                    list(pool.map(call, range(threads)))
                if self.logged:
                    empty_logs(self.lanes, self.taken or self._keep, names, self.stuck)
                hand_on_nodes(self.lanes, self.noded, len(self.x))
                for lane in np.flatnonzero((results != ARRIVED) & (results != UNKNOWN_PIECE)):
                    self._look_after(int(lane), results, before, names)
                results[limits.lanes_beyond(self.lanes.clock[:, EVALUATIONS])] = ARRIVED
                self._make_pieces(results)
                done = np.where(self.chosen, self.lanes.clock[:, NOW].clip(max=self.end), self.end) - self.begin
                show(float(done.sum() / max((self.end - self.begin).sum(), 1e-300)))
        if self.logged:
            empty_logs(self.lanes, self.taken or self._keep, names, self.stuck)

    def _look_after(self, lane: int, results: np.ndarray, before: np.ndarray, names: Callable[[int, int], str]) -> None:
        """Let a lane that was interrupted go on, unless it goes nowhere."""
        clock = self.lanes.clock[lane]
        now, contact = clock[NOW], int(clock[WHICH])
        if results[lane] == LOG_FULL:
            return
        if results[lane] == STUCK or (results[lane] == INTERRUPTED and now - before[lane, 0] <= 1e-12 * abs(now)):
            self.stuck[lane] = (
                f"{names(lane, contact)!r} has events without end at {now:.12g} s: {clock[COUNT]:.0f} in all. Results "
                "up to a shorter duration= are right."
            )
            results[lane] = ARRIVED
        before[lane] = now, clock[COUNT]

    def go_on(self, end: np.ndarray, times: np.ndarray) -> None:
        """Let lanes that have ended run on, (lane,), with samples at times from there on, (lane, sample) (s)."""
        self.begin, self.end, self.times, lanes = self.end, end, np.ascontiguousarray(times), self.lanes
        lanes.clock[:, NEXT] = 0.0
        lanes.ends[:] = end
        self.lanes = lanes._replace(
            times=self.times,
            samples=np.full((*times.shape, lanes.samples.shape[2]), np.nan),
            growths=np.zeros((*times.shape, lanes.growths.shape[2])),
        )

    def repeat(self, chosen: np.ndarray, times: np.ndarray) -> None:
        """Let some lanes, (lane,), go on from their states to the last of some times, (lane, sample) (s).

        The clock is at their begin again, where all forces are as then, and sums and samples begin anew.
        """
        begin, lanes = self.begin, self.lanes
        self.go_on(times[:, -1], times)
        self.begin, self.chosen = begin, chosen
        lanes.clock[:, NOW], lanes.clock[:, LOST] = begin, 0.0
        for row in (RATIO, CLOSINGS, PRESSED, PEAK, CHATTERS, GATHERED):
            lanes.contacts[:, row] = 0.0
        lanes.contacts[:, kernel.RESTS_FROM] = lanes.contacts[:, OF_IMPACT] = begin[:, None]

    def follow(self, differences: np.ndarray | None, orthonormal: bool = True) -> None:
        """Carry small differences of paths from here on, (lane, difference, 2 body); made `orthonormal` at samples."""
        carried, delays, growths = self._differences(differences)
        carried[:, 0] = self.lanes.differences[:, 0]
        self.lanes = self.lanes._replace(differences=carried, delays=delays, growths=growths)
        self.span = self.span._replace(followed=orthonormal and differences is not None)

    def _scene(self) -> Scene:
        scene = self.scene
        along = scene.links / scene.mass[:, None, :]
        inverse = (scene.links * along).sum(axis=-1)
        inertia = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0.0)
        numbers = np.stack([scene.restitution, inertia, scene.dampers], axis=-1)
        numbers = np.concatenate([numbers, scene.frictions], axis=-1)
        panels = panels_of(scene.functions, self.begin.min(), self.end.max(), scene.fastest)
        numbers, links, along, walls = map(np.ascontiguousarray, (numbers, scene.links, along, parts(scene.wall)))
        # compiled code takes no others
        frequencies, kinds = map(np.ascontiguousarray, (scene.frequencies, scene.kinds))
        return Scene(frequencies, numbers, links, along, walls, kinds, panels, scene.flows, kernel.rules())

    def _make_pieces(self, results: np.ndarray) -> None:
        """Make the pieces that lanes wait for, for all lanes of one set of closed contacts at once."""
        waiting = np.flatnonzero(results == UNKNOWN_PIECE)
        while len(waiting):
            status = self.lanes.statuses[waiting[0]]
            same = (self.lanes.statuses[waiting] == status).all(axis=1)
            chosen, waiting = waiting[same], waiting[~same]
            made = pieces_of(self.scene, chosen[:1] if self.one else chosen, status)
            first = self._room_for(made)
            assert self.pieces is not None
            for kept, new in zip(self.pieces, made, strict=True):
                kept[first : self.made] = new
            rows = self._room(chosen)
            self.lanes.rows[chosen, rows] = first if self.one else np.arange(first, self.made)

    def _room_for(self, made: Pieces) -> int:
        """Return the first row for new pieces; where all of them take too much memory, older ones are forgotten."""
        number, first = len(made.sizes), self.made
        room = 0 if self.pieces is None else len(self.pieces.sizes)
        size = sum(item.nbytes for item in made) / number
        if first and first + number > room and (first + number) * size > MEMORY:
            self.lanes.rows[:], first = -1, 0
        if first + number > room:
            grown = Pieces(*(np.zeros((max(2 * room, first + number), *item.shape[1:]), item.dtype) for item in made))
            for kept, old in zip(grown, self.pieces or (), strict=False):
                kept[:first] = old[:first]
            self.pieces = grown
        self.made = first + number
        return first

    def _room(self, lanes: np.ndarray) -> np.ndarray:
        """Return the free place for a row of each of some lanes, of which there are more where they are used up."""
        used: np.ndarray = (self.lanes.rows[lanes] >= 0).sum(axis=1)
        if used.max() == self.lanes.rows.shape[1]:
            more = np.full_like(self.lanes.rows, -1)
            self.lanes = self.lanes._replace(rows=np.concatenate([self.lanes.rows, more], axis=1))
        return used

    def _keep(self, lane: int, rows: np.ndarray, states: np.ndarray) -> None:
        """Put events aside."""
        self.events[lane].append(rows)

    def events_of(self, lane: int) -> np.ndarray:
        """Return the events of a lane, (event, EVENT)."""
        return np.concatenate([np.zeros((0, EVENT)), *self.events[lane]])

    @property
    def sliders(self) -> int:
        """How many coordinates behind those of bodies belong to sliders."""
        return int((self.scene.kinds == JENKINS).sum())

    @property
    def lasting(self) -> list[np.ndarray]:
        """Arrays that a run leaves to another one that goes on from its end, (lane, …), which may be changed."""
        lanes = self.lanes
        rests, sides = lanes.contacts[:, kernel.RESTS_FROM : kernel.CHATTERS], lanes.contacts[:, kernel.FASTEST :]
        return [lanes.x, lanes.v, lanes.statuses, lanes.differences[:, :1], lanes.delays[:, :1], rests, sides]

    @property
    def grazed(self) -> np.ndarray:
        """How often rounding left open whether a contact closed, (lane,)."""
        return self.lanes.clock[:, GRAZED]

    @property
    def resting(self) -> np.ndarray:
        """Whether each contact rests, (lane, contact)."""
        return np.asarray(self.lanes.statuses == HELD)
