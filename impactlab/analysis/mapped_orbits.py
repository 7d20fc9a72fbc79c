"""Orbits of networks with smooth nonlinear forces, as fixed points of the map of states over a period.

The map is a located run, all starts beside each other in one call. Its derivatives are central differences of paths
that are exact to 1e-12 or so; between their evaluations Newton's method goes on with those of the orbit before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from impactlab.analysis.found_points import overlap_text
from impactlab.analysis.itineraries import WORDS, common_period
from impactlab.analysis.orbit import Happening, MakeNetwork, Orbit, Other, Tests, along, sizes_of, slowest_of, torus_of
from impactlab.assembly.mechanism import given_motions
from impactlab.assembly.model import Model
from impactlab.components.loads import ConstantForce, Harmonic
from impactlab.errors import InvalidInput
from impactlab.kernels.contact_states import OPEN
from impactlab.kernels.event_log import AFTER, BEFORE, EVENT, OF_CONTACT, RATE_BEFORE, WHEN
from impactlab.kernels.from_event_to_event import Span
from impactlab.kernels.shooting import NEWTON_STEPS
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse
from impactlab.networks.network import Network

OF_MAP, OF_RETURNS = 1e-12, 1e-9
"""Errors of paths over a period, and of those on which returns are looked for, as parts of their sizes."""

SHIFT = 2e-5
"""Differences of states and parameters from which derivatives are found, as a part of their sizes."""

SMALL_STEP, STALLED = 1e-10, 0.2
"""Step of Newton's method that is the last one, as a part of sizes; and part of the step before that is too long for
derivatives to be used again.
"""

AROUND = 1e-12
"""Part of the time of an event by which a state is before it, or after."""

KEPT = 64
"""Networks that are remembered."""

WORK_SAMPLES = 4096
"""Samples of a path from which the work of forces is summed."""


class Ends(NamedTuple):
    """Where paths end after a period, and what has happened on them."""

    states: np.ndarray  # (lane, 2 body)
    events: list[np.ndarray]  # (event, EVENT) of each lane


@dataclass(eq=False)
class MappedOrbits:
    """Orbits of networks that depend on one parameter; see `impactlab.analysis.orbit.Method`.

    Parameters
    ----------
    make : callable
        Returns the network at a value of the parameter.
    ranges : mapping of str to pair of float
    about : float
        A value of the parameter at which there is a network.
    """

    make: MakeNetwork
    ranges: Mapping[str, tuple[float, float]]
    about: float
    refusal: str = field(init=False, default="")
    parameters: int = field(init=False, default=1)
    _known: dict[float, Smooth] = field(init=False, default_factory=dict)
    _last: np.ndarray | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        ((self.name, (low, high)),) = self.ranges.items()
        self.span = np.array([high - low])
        first = self._network(self.about)
        model = first.model
        self.bodies = tuple(np.array(model.bodies.names)[model.bodies.free].tolist())
        self.contacts = (*model.contacts.names, *first.turns.names)
        self.sizes, self.drift = np.ones(2 * len(self.bodies)), np.zeros(len(self.bodies))
        self.trivial = int(self.force(np.array([self.about])) is None)

    @staticmethod
    def of(network: Network) -> MappedOrbits:
        """Return what finds the orbits of one network."""
        return MappedOrbits(lambda **_: network, {"": (-1.0, 1.0)}, 0.0)

    def at_rest(self, values: np.ndarray) -> np.ndarray:
        """Return the state of a network at rest, (2 body,)."""
        place = self._network(values[0]).at_rest()[0]
        return np.concatenate([place, np.zeros_like(place)])

    def room(self, values: np.ndarray) -> float:
        """Return how far apart the sides of contacts are, and how far given motions move them (m)."""
        network = self._network(values[0])
        moved = np.abs(network.motions[:, 1:]).sum(axis=1).max(initial=0.0)
        return float(np.abs(network.model.clearance).max(initial=0.0) + moved)

    def force(self, values: np.ndarray) -> tuple[float, int, int] | None:
        """Return the period of all forces (s), a wave and its cycles in it; None if nothing varies in time."""
        network = self._network(values[0])
        forces = [item for item in network.model.sources["force"].excitations if isinstance(item, Harmonic)]
        return common_period(np.array([*network.frequencies, *(item.frequency for item in forces)]))

    def slowest(self, values: np.ndarray) -> float:
        """Return the period of the slowest free motion of a body alone (s), 1 if none has one."""
        mass, _, stiffness = self._network(values[0]).linear
        return slowest_of(mass, stiffness)

    def sampled(self, states: np.ndarray, values: np.ndarray, begins: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return states of paths at some times, from times before, (lane, sample, 2 body)."""
        lanes = len(states)
        ends = np.full(lanes, times[-1])
        course = self._course([self._network(values[0])] * lanes, states, begins, ends, times, OF_RETURNS)
        found: np.ndarray = course.lanes.samples[:, :, : len(self.sizes)]
        found[list(course.stuck)] = np.nan
        free = ~course.overlap.any(axis=1)
        if not free.all() and free.any():
            found[free] = self.sampled(states[free], values, begins[free], times)
        return found

    def near(
        self, state: np.ndarray, values: np.ndarray, period: float, cycles: tuple[int, int],
        least: np.ndarray | float = 0.0,
    ) -> Orbit | str:  # fmt: skip
        """Return the orbit near a state at the time 0, or why there is none; its sizes are not below the least ones."""
        path = self.sampled(state[None], values, np.zeros(1), np.linspace(0.0, period, 65))[0]
        if not np.isfinite(path).all():
            try:
                self._ends(state[None], float(values[0]), period)
            except InvalidInput as error:
                return str(error)
            return "a path cannot be followed"
        if (self.sizes == 1.0).all():
            self.sizes = sizes_of(np.sqrt((path**2).mean(axis=0)), least)
        guess = np.concatenate([state, [period], values])
        border = np.zeros(len(guess))
        border[-1] = 1.0
        return self.correct(cycles, guess, guess, border) or "Newton's method does not converge"

    def correct(self, events: tuple[int, int], guess: np.ndarray, base: np.ndarray, border: np.ndarray) -> Orbit | None:
        """Return the orbit near a guess for which ``border · (unknowns − base)`` is 0, or None if there is none."""
        unknowns, weights = guess.copy(), np.concatenate([self.sizes, guess[-2:-1], self.span])
        slopes, before, self.refusal = self._last, np.inf, ""
        for step in range(1, NEWTON_STEPS + 1):
            try:
                left, _ = self._left(events, unknowns, base)
                if slopes is None:
                    slopes = self._derivatives(events, unknowns, base)
                change = np.linalg.solve(np.vstack([slopes, border]), np.append(left, border @ (unknowns - base)))
            except (InvalidInput, np.linalg.LinAlgError) as error:
                self.refusal = str(error)
                return None
            largest = float(np.abs(change / weights).max())
            if not largest < 1e2:
                return None
            unknowns = unknowns - change
            if largest < SMALL_STEP * max(1.0, float(np.abs(slopes[:-1, : len(self.sizes)]).max())):
                return self._taken(events, unknowns, base, border, step)
            if largest > STALLED * before:
                slopes = None
            before = largest
        return None

    def settled(self, orbit: Orbit) -> Orbit:
        """Return an orbit as it is: its events are no unknowns."""
        return orbit

    def others(self, at: Orbit, test: str, wrong: Orbit) -> Iterable[Other]:
        """Return no orbit: a branch goes on where impacts come and go, or there is none."""
        return []

    def label(self, at: Orbit, test: str) -> str:
        """Return the name of what happens where a test vanishes."""
        return test

    def happenings(self, orbit: Orbit) -> list[Happening]:
        """Return the events of a period, in order."""
        return list(orbit.details)

    def losses(self, orbits: Sequence[Orbit]) -> np.ndarray:
        """Return the energy that each orbit loses in a period (J): the work of forces; NaN where motions are given."""
        return np.array([self._work(orbit) for orbit in orbits])

    def closures(self, orbits: Sequence[Orbit]) -> tuple[np.ndarray, np.ndarray]:
        """Return how far paths that begin on orbits are from these after a period, in their sizes; and no drifts."""
        result = []
        for orbit in orbits:
            z, period = orbit.unknowns[: len(self.sizes)], float(orbit.unknowns[-2])
            try:
                end = self._ends(z[None], float(orbit.unknowns[-1]), period).states[0]
                result.append(float((np.abs(end - z) / self.sizes).max()))
            except InvalidInput:
                result.append(math.inf)
        return np.array(result), np.zeros((len(orbits), len(self.bodies)))

    def state_at(self, orbit: Orbit, time: float) -> np.ndarray:
        """Return the state of an orbit at a time of its period."""
        z = orbit.unknowns[: len(self.sizes)]
        return z if time <= 0.0 else self._ends(z[None], float(orbit.unknowns[-1]), time).states[0]

    def state_at_event(self, orbit: Orbit, event: int, after: bool) -> np.ndarray:
        """Return the state of an orbit before an event, or after it."""
        time = orbit.details[event].time
        return self.state_at(orbit, time * (1.0 + (AROUND if after else -AROUND)))

    def _network(self, value: float) -> Smooth:
        """Return the network at a value of the parameter, or refuse it."""
        known = self._known.get(value)
        if known is None:
            try:
                model = Model.of(self.make(**{self.name: float(value)}))
                _refuse(model)
            except InvalidInput as error:
                told = f"There is no network at {self.name}={value:.9g}: {error}" if self.name else str(error)
                raise InvalidInput(told) from error
            if len(self._known) >= KEPT:
                self._known.clear()
            known = self._known[value] = Smooth(model)
        return known

    def _course(
        self, networks: list[Smooth], states: np.ndarray, begins: np.ndarray, ends: np.ndarray, times: np.ndarray,
        tolerance: float, taken: Any = None,
    ) -> SmoothCourse:  # fmt: skip
        """Return the paths of lanes, which have been run unless hard bodies overlap in one of them."""
        half, lanes = len(self.bodies), len(states)
        course = SmoothCourse(
            networks, states[:, :half].copy(), states[:, half:].copy(), np.zeros((lanes, 0)), begins, ends,
            np.repeat(times[None], lanes, axis=0), Span(tolerance, False), taken,
        )  # fmt: skip
        if not course.overlap.any():
            course.run(lambda lane, contact: self.contacts[contact])
        return course

    def _ends(self, states: np.ndarray, value: float | Sequence[float], lengths: float | Sequence[float]) -> Ends:
        """Return where paths from some states are after some times, or refuse one that cannot be followed.

        Values and times are one for all, or those of each.
        """
        events: list[list[np.ndarray]] = [[] for _ in states]

        def take(lane: int, rows: np.ndarray, own: np.ndarray) -> None:
            events[lane].append(rows)

        lanes = len(states)
        networks = [self._network(float(item)) for item in np.broadcast_to(value, lanes)]
        ends = np.broadcast_to(np.asarray(lengths, dtype=float), lanes).copy()
        course = self._course(networks, states, np.zeros(lanes), ends, np.zeros(0), OF_MAP, take)
        for lane, contact in np.argwhere(course.overlap > 0.0):
            raise InvalidInput(overlap_text(self.contacts[contact], course.overlap[lane, contact]))
        if course.stuck:
            raise InvalidInput(next(iter(course.stuck.values())))
        found = np.hstack([course.lanes.x, course.lanes.v])
        if not np.isfinite(found).all():
            raise InvalidInput("A path leaves the range of finite numbers.")
        return Ends(found, [np.concatenate([np.zeros((0, EVENT)), *item]) for item in events])

    def _length(self, events: tuple[int, int], unknowns: np.ndarray, value: float) -> float:
        """Return the length of the paths that are to close (s)."""
        force = self.force(np.array([value])) if events[0] >= 0 else None
        return float(unknowns[-2]) if force is None else force[0] * events[1] / force[2]

    def _left(self, events: tuple[int, int], unknowns: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what is left of the equations, and the events of the path."""
        z, value = unknowns[:-2], float(unknowns[-1])
        length = self._length(events, unknowns, value)
        found = self._ends(z[None], value, length)
        last = unknowns[-2] - length if events[0] >= 0 else (unknowns - base)[self._anchor(base)]
        return np.append(found.states[0] - z, last), found.events[0]

    def _anchor(self, base: np.ndarray) -> int:
        """Return the displacement that stays as it is where nothing tells the time."""
        half = len(self.bodies)
        return int(np.argmax(np.abs(base[half : 2 * half]) / self.sizes[half:]))

    def _derivatives(self, events: tuple[int, int], unknowns: np.ndarray, base: np.ndarray) -> np.ndarray:
        """Return the derivatives of the equations, (equation, unknown)."""
        count, value = len(self.sizes), float(unknowns[-1])
        z, steps, free = unknowns[:-2], SHIFT * self.sizes, events[0] < 0
        values = np.full(2 * count + 4, value)
        values[2 * count : 2 * count + 2] += np.array([1.0, -1.0]) * SHIFT * self.span[0]
        lengths = np.array([self._length(events, unknowns, item) for item in values.tolist()])
        if free:
            lengths[-2:] *= 1.0 + np.array([1.0, -1.0]) * SHIFT
        starts = np.concatenate([z + np.diag(steps), z - np.diag(steps), np.repeat(z[None], 4, axis=0)])
        lanes = len(starts) if free else len(starts) - 2
        ends = self._ends(starts[:lanes], values[:lanes].tolist(), lengths[:lanes].tolist()).states
        result = np.zeros((count + 1, count + 2))
        result[:count, :count] = ((ends[:count] - ends[count : 2 * count]) / (2.0 * steps[:, None])).T - np.eye(count)
        apart = values[2 * count] - values[2 * count + 1]
        result[:count, -1] = (ends[2 * count] - ends[2 * count + 1]) / apart
        if free:
            result[:count, -2] = (ends[-2] - ends[-1]) / (lengths[-2] - lengths[-1])
            result[count, self._anchor(base)] = 1.0
        else:
            result[count, -2:] = 1.0, -(lengths[2 * count] - lengths[2 * count + 1]) / apart
        return result

    def _taken(
        self, events: tuple[int, int], unknowns: np.ndarray, base: np.ndarray, border: np.ndarray, steps: int
    ) -> Orbit | None:
        """Return an orbit with its derivatives and events."""
        count = len(self.sizes)
        try:
            slopes = self._last = self._derivatives(events, unknowns, base)
            happened = self._left(events, unknowns, base)[1]
            tangent = np.linalg.solve(np.vstack([slopes, border]), np.eye(count + 2)[-1])
        except (InvalidInput, np.linalg.LinAlgError) as error:
            self.refusal = str(error)
            return None
        monodromy = slopes[:count, :count] + np.eye(count)
        flip = float(np.linalg.det(monodromy + np.eye(count)))
        tests = Tests(float(tangent[-1]), flip, torus_of(monodromy), math.inf, -math.inf, math.inf)
        table = tuple(self._happenings(happened))
        rates = np.array([item.closing_velocity for item in table])
        pattern = tuple(sorted((item.contact, item.kind) for item in table))  # wherever the period begins
        return Orbit(unknowns, tangent, monodromy, tests, events, rates, steps, table, pattern)

    def _happenings(self, rows: np.ndarray) -> list[Happening]:
        found = []
        for row in rows:
            before, after = int(row[BEFORE]), int(row[AFTER])
            velocity = float(row[RATE_BEFORE]) if before == OPEN else math.nan
            word = WORDS.get((before, after), "turn")
            found.append(Happening(float(row[WHEN]), self.contacts[int(row[OF_CONTACT])], word, velocity))
        return found

    def _work(self, orbit: Orbit) -> float:
        """Return the work of all forces in a period (J)."""
        value, period = float(orbit.unknowns[-1]), float(orbit.unknowns[-2])
        model, network = self._network(value).model, self._network(value)
        if list(given_motions(model)):
            return math.nan
        time, power, sources = np.linspace(0.0, period, WORK_SAMPLES, endpoint=False), 0.0, model.sources["force"]
        path = along(self, orbit, time)
        for number, excitation in enumerate(sources.excitations):
            slots, weights = sources.driven(number)
            places = np.searchsorted(network.free, slots)
            velocity = path[:, len(self.bodies) + places] @ np.asarray(weights, dtype=float)
            power += float((excitation.call("force", time) * velocity).mean())
        return power * period


def _refuse(model: Model) -> None:
    """Refuse a network with forces that have no period, or laws with states."""
    for excitation in model.sources["force"].excitations:
        if not isinstance(excitation, ConstantForce | Harmonic):
            raise InvalidInput(
                "Orbits are found under forces il.Harmonic and il.ConstantForce, but there is a "
                f"{type(excitation).__name__}."
            )
    if model.kicks.states:
        raise InvalidInput(f"Orbits are found of laws without states, but there is {model.kicks.states[0][0]!r}.")
