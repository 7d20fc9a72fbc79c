"""Orbits of networks with smooth nonlinear forces, as fixed points of the map of states over a period.

The map is a located run, all starts beside each other in one call. Its derivatives are central differences of paths
that are exact to 1e-12 or so; between their evaluations Newton's method goes on with those of the orbit before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from impactlab.analysis.found_points import overlap_text
from impactlab.analysis.itineraries import WORDS, common_period
from impactlab.analysis.newton import solved
from impactlab.analysis.orbit import Happening, MakeNetwork, Orbit, Other, Tests, sizes_of, slowest_of, torus_of
from impactlab.assembly.mechanism import given_motions
from impactlab.assembly.model import Model
from impactlab.components.loads import ConstantForce, Harmonic
from impactlab.errors import InvalidInput
from impactlab.kernels.contact_states import OPEN
from impactlab.kernels.event_log import AFTER, BEFORE, EVENT, OF_CONTACT, RATE_BEFORE, WHEN
from impactlab.kernels.from_event_to_event import Span
from impactlab.located.rows_of_couplings import weights
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse
from impactlab.networks.network import Network

OF_MAP, OF_RETURNS = 1e-12, 1e-9
"""Errors of paths over a period, and of those on which returns are looked for, as parts of their sizes."""

SHIFT = 2e-5
"""Differences of states and parameters from which derivatives are found, as a part of their sizes."""

SMALL_STEP = 1e-10
"""Step of Newton's method that is the last one, as a part of sizes."""

AROUND = 1e-12
"""Part of the time of an event by which a state is before it, or after."""

KEPT = 64
"""Networks that are remembered."""

WORK_SAMPLES, WORKED_AT_ONCE = 4096, 64
"""Samples of a path from which the work of forces is summed, and paths of a call."""

EVENT_SHIFT = 3e-4
"""Change of an unknown from which the derivative of the equation of an event is found, as a part of its size: values
are known to 1e-8.
"""

GAP_SAMPLES, FINER_SAMPLES = 256, 64
"""Samples of a period in which turning points of gaps are looked for, and again around the one that is wanted."""

BRIEF = 1e-3
"""Part of a period up to which an impact is taken for a touch where grazing is followed."""


class Ends(NamedTuple):
    """Where paths end after a period, and what has happened on them."""

    states: np.ndarray  # (lane, 2 body)
    events: list[np.ndarray]  # (event, EVENT) of each lane


class Paths(NamedTuple):
    """Paths that are followed beside each other."""

    starts: np.ndarray  # (lane, 2 body)
    values: np.ndarray  # (lane, parameter)
    lengths: np.ndarray  # (lane,) (s)

    @staticmethod
    def joined(paths: Sequence[Paths]) -> Paths:
        """Return several as one."""
        return Paths(*map(np.concatenate, zip(*paths, strict=True)))


class Equations(NamedTuple):
    """The equations of an orbit: what is left of them, their derivatives, and the events of its path."""

    left: np.ndarray  # (equation,)
    derivatives: np.ndarray  # (equation, unknown), but for parameters where these are fixed
    events: np.ndarray  # (event, EVENT)


@dataclass(eq=False)
class MappedOrbits:
    """Orbits of networks that depend on parameters; see `impactlab.analysis.orbit.EquationsOfOrbits`.

    Parameters
    ----------
    make : callable
        Returns the network at values of the parameters.
    ranges : mapping of str to pair of float
    about : (parameter,) ndarray
        Values of the parameters at which there is a network.
    """

    make: MakeNetwork
    ranges: Mapping[str, tuple[float, float]]
    about: np.ndarray
    refusal: str = field(init=False, default="")
    shift: float = field(init=False, default=EVENT_SHIFT)
    _known: dict[tuple[float, ...], Smooth] = field(init=False, default_factory=dict)
    _last: np.ndarray | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.span = np.array([high - low for low, high in self.ranges.values()])
        self.parameters = len(self.span)
        first = self._network(self.about)
        model, self.rigid = first.model, first.rigid
        self.bodies = tuple(np.array(model.bodies.names)[model.bodies.free].tolist())
        self.contacts = (*model.contacts.names, *first.turns.names)
        self.sizes, self.drift = np.ones(2 * len(self.bodies)), np.zeros(len(self.bodies))
        self.trivial = int(self.force(self.about) is None)

    @staticmethod
    def of(network: Network) -> MappedOrbits:
        """Return what finds the orbits of one network."""
        return MappedOrbits(lambda **_: network, {"": (-1.0, 1.0)}, np.zeros(1))

    def at_rest(self, values: np.ndarray) -> np.ndarray:
        """Return the state of a network at rest, (2 body,)."""
        place = self._network(values).at_rest()[0]
        return np.concatenate([place, np.zeros_like(place)])

    def room(self, values: np.ndarray) -> float:
        """Return how far apart the sides of contacts are, and how far given motions move them (m)."""
        network = self._network(values)
        moved = np.abs(network.motions[:, 1:]).sum(axis=1).max(initial=0.0)
        return float(np.abs(network.model.clearance).max(initial=0.0) + moved)

    def force(self, values: np.ndarray) -> tuple[float, int, int] | None:
        """Return the period of all forces (s), a wave and its cycles in it; None if nothing varies in time."""
        network = self._network(values)
        forces = [item for item in network.model.sources["force"].excitations if isinstance(item, Harmonic)]
        return common_period(np.array([*network.frequencies, *(item.frequency for item in forces)]))

    def slowest(self, values: np.ndarray) -> float:
        """Return the period of the slowest free motion of a body alone (s), 1 if none has one."""
        mass, _, stiffness = self._network(values).linear
        return slowest_of(mass, stiffness)

    def sampled(self, states: np.ndarray, values: np.ndarray, begins: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return states of paths at some times, from times before, (lane, sample, 2 body)."""
        lanes = len(states)
        every = np.repeat(times[None], lanes, axis=0)
        course = self._course([self._network(values)] * lanes, states, begins, every[:, -1], every, OF_RETURNS)
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
                self._ends(Paths(state[None], values[None], np.array([period])))
            except InvalidInput as error:
                return str(error)
            return "a path cannot be followed"
        if (self.sizes == 1.0).all():
            self.sizes = sizes_of(np.sqrt((path**2).mean(axis=0)), least)
        guess = np.concatenate([state, [period], values])
        border = np.zeros(len(guess))
        border[-1] = 1.0
        return self.correct(cycles, guess, guess, border) or "Newton's method does not converge"

    def correct(self, events: Any, guess: np.ndarray, base: np.ndarray, border: np.ndarray) -> Orbit | None:
        """Return the orbit near a guess for which ``border · (unknowns − base)`` is 0, or None if there is none."""

        def evaluate(unknowns: np.ndarray, slopes: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
            if slopes is not None:
                return self._left(events, unknowns, base), slopes
            return self._equations(events, unknowns, base)[:2]

        def enough(slopes: np.ndarray, own: bool) -> float:
            return SMALL_STEP * max(1.0, float(np.abs(slopes[:-1, : len(self.sizes)]).max()))

        sizes, self.refusal = self.weights(events, guess[-1 - self.parameters]), ""
        try:
            found = solved(evaluate, enough, guess, base, border, sizes, self._last)
        except (InvalidInput, np.linalg.LinAlgError) as error:
            self.refusal = str(error)
            return None
        return None if found is None else self._taken(events, found[0], base, border, found[1])

    def weights(self, events: Any, period: float) -> np.ndarray:
        """Return the sizes of all unknowns."""
        return np.concatenate([self.sizes, [period], self.span])

    def evaluate(self, events: Any, unknowns: np.ndarray) -> tuple[Orbit, np.ndarray, np.ndarray]:
        """Return what is left of the equations of an orbit, and their derivatives, at any unknowns."""
        found = self._equations(events, unknowns, unknowns)
        return self._orbit(events, unknowns, found), found.left, found.derivatives

    def beside(self, events: Any, many: np.ndarray) -> list[tuple[Orbit, np.ndarray, np.ndarray]]:
        """Return the same at several unknowns, (place, unknown), with derivatives at fixed parameters only."""
        paths = [self._around(events, unknowns) for unknowns in many]
        ends = self._ends(Paths.joined(paths))
        result = []
        for place, unknowns in enumerate(many):
            part = slice(place * len(paths[0].starts), (place + 1) * len(paths[0].starts))
            found = self._at_fixed(events, unknowns, unknowns, paths[place], Ends(ends.states[part], ends.events[part]))
            result.append((self._orbit(events, unknowns, found), found.left, found.derivatives))
        return result

    def unwrapped(self, orbit: Orbit, test: str) -> Orbit:
        """Return an orbit as it is: its events are no unknowns."""
        return orbit

    def turned(self, orbit: Orbit) -> None:
        """Return nothing: events are no unknowns, and always within a period."""

    def passing(self, orbit: Orbit, test: str) -> tuple[Any, np.ndarray]:
        """Return the period and the contact that touches on an orbit, and its unknowns; see `grazing`."""
        turns = [np.abs(self._turning_points(orbit, contact)).min() for contact in range(len(self.rigid))]
        touching = int(np.argmin(turns))
        if self.rigid[touching]:
            raise InvalidInput(
                f"The grazing of the rigid contact {self.contacts[touching]!r} beside nonlinear forces cannot be "
                "followed over two parameters; a stiff il.LinearContact in its place can."
            )
        return (*orbit.events[:2], touching), orbit.unknowns

    def grazing(self, orbit: Orbit) -> tuple[float, Tests]:
        """Return the turning point of a gap that is 0 where it grazes (m), and tests of other events."""
        gaps = self._turning_points(orbit, orbit.events[2])
        return float(gaps[np.abs(gaps).argmin()]), orbit.tests

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
        parts = range(0, len(orbits), WORKED_AT_ONCE)
        return np.concatenate([np.zeros(0), *(self._works(orbits[part : part + WORKED_AT_ONCE]) for part in parts)])

    def closures(self, orbits: Sequence[Orbit]) -> tuple[np.ndarray, np.ndarray]:
        """Return how far paths that begin on orbits are from these after a period, in their sizes; and no drifts."""
        paths = self._of_orbits(orbits)
        result = np.full(len(orbits), math.inf)
        try:
            result[:] = (np.abs(self._ends(paths).states - paths.starts) / self.sizes).max(axis=1)
        except InvalidInput:
            if len(orbits) > 1:
                result[:] = np.concatenate([self.closures([orbit])[0] for orbit in orbits])
        return result, np.zeros((len(orbits), len(self.bodies)))

    def state_at(self, orbit: Orbit, time: float) -> np.ndarray:
        """Return the state of an orbit at a time of its period."""
        path = self._of_orbits([orbit])
        ends = path.starts if time <= 0.0 else self._ends(path._replace(lengths=np.array([time]))).states
        return np.asarray(ends[0])

    def state_at_event(self, orbit: Orbit, event: int, after: bool) -> np.ndarray:
        """Return the state of an orbit before an event, or after it."""
        time = orbit.details[event].time
        return self.state_at(orbit, time * (1.0 + (AROUND if after else -AROUND)))

    def network(self, orbit: Orbit) -> Smooth:
        """Return the network of an orbit."""
        return self._network(orbit.unknowns[-self.parameters :])

    def link(self, orbit: Orbit, contact: int) -> np.ndarray:
        """Return by what the displacement of each free body closes a contact, (body,)."""
        network = self.network(orbit)
        return np.asarray(weights(network.model.ends)[contact, network.free])

    def gaps(self, orbit: Orbit, contact: int, states: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the gap of a contact along a path, and its rate, (sample,)."""
        network, half = self.network(orbit), len(self.bodies)
        link = weights(network.model.ends)[contact]
        turn = np.exp(1j * np.outer(times, network.frequencies))
        waves = network.motions[:, 1::2] + 1j * network.motions[:, 2::2]
        gap = link @ (network.motions[:, :1] + (waves @ turn.T).real) - network.model.clearance[contact]
        rate = link @ (waves @ (1j * network.frequencies * turn).T).real
        own = link[network.free]
        return -(gap + states[:, :half] @ own), -(rate + states[:, half : 2 * half] @ own)

    def flows(self, orbit: Orbit, begins: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return how deviations from an orbit at some times, (part,), move on to later ones, (part, time).

        They are (part, time, 2 body, 2 body), by differences of paths.
        """
        count, network, order = len(self.sizes), self.network(orbit), np.argsort(begins)
        states, path = np.empty((len(begins), count)), self._of_orbits([orbit])
        course = self._course([network], path.starts, np.zeros(1), begins[order[-1:]], begins[None, order], OF_MAP)
        states[order] = course.lanes.samples[0, :, :count]
        steps = SHIFT * np.diag(self.sizes)
        starts = states[:, None, None] + np.stack([steps, -steps])
        lanes = 2 * count
        every = np.repeat(times, lanes, axis=0)
        course = self._course(
            [network] * len(every), starts.reshape(-1, count), np.repeat(begins, lanes), every[:, -1].copy(), every,
            OF_MAP,
        )  # fmt: skip
        if course.stuck:
            raise InvalidInput(next(iter(course.stuck.values())))
        ends = course.lanes.samples[:, :, :count].reshape(len(begins), 2, count, -1, count)
        moved = (ends[:, 0] - ends[:, 1]) / (2.0 * SHIFT * self.sizes[:, None, None])
        return np.asarray(moved.transpose(0, 2, 3, 1))

    def _network(self, values: np.ndarray) -> Smooth:
        """Return the network at values of the parameters, or refuse it."""
        key = tuple(values.tolist())
        known = self._known.get(key)
        if known is None:
            try:
                model = Model.of(self.make(**dict(zip(self.ranges, key, strict=True))))
                _refuse(model)
            except InvalidInput as error:
                at = ", ".join(f"{name}={value:.9g}" for name, value in zip(self.ranges, key, strict=True) if name)
                raise InvalidInput(f"There is no network at {at}: {error}" if at else str(error)) from error
            if len(self._known) >= KEPT:
                self._known.clear()
            known = self._known[key] = Smooth(model)
        return known

    def _course(
        self, networks: list[Smooth], states: np.ndarray, begins: np.ndarray, ends: np.ndarray, times: np.ndarray,
        tolerance: float, taken: Any = None,
    ) -> SmoothCourse:  # fmt: skip
        """Return the paths of lanes, which have been run unless hard bodies overlap in one of them."""
        half, lanes = len(self.bodies), len(states)
        course = SmoothCourse(
            networks, states[:, :half].copy(), states[:, half:].copy(), np.zeros((lanes, 0)), begins, ends, times,
            Span(tolerance, False), taken, compared=False,
        )  # fmt: skip
        if not course.overlap.any():
            course.run(lambda lane, contact: self.contacts[contact])
        return course

    def _ends(self, paths: Paths) -> Ends:
        """Return where paths end, or refuse one that cannot be followed."""
        events: list[list[np.ndarray]] = [[] for _ in paths.starts]

        def take(lane: int, rows: np.ndarray, own: np.ndarray) -> None:
            events[lane].append(rows)

        lanes, networks = len(paths.starts), [self._network(values) for values in paths.values]
        ends, times = paths.lengths.copy(), np.zeros((lanes, 0))
        course = self._course(networks, paths.starts, np.zeros(lanes), ends, times, OF_MAP, take)
        for lane, contact in np.argwhere(course.overlap > 0.0):
            raise InvalidInput(overlap_text(self.contacts[contact], course.overlap[lane, contact]))
        if course.stuck:
            raise InvalidInput(next(iter(course.stuck.values())))
        found = np.hstack([course.lanes.x, course.lanes.v])
        if not np.isfinite(found).all():
            raise InvalidInput("A path leaves the range of finite numbers.")
        return Ends(found, [np.concatenate([np.zeros((0, EVENT)), *item]) for item in events])

    def _of_orbits(self, orbits: Sequence[Orbit]) -> Paths:
        """Return the paths of orbits over their periods."""
        unknowns, size = np.array([orbit.unknowns for orbit in orbits]), len(self.sizes)
        return Paths(unknowns[:, :size], unknowns[:, -self.parameters :], unknowns[:, size].copy())

    def _length(self, events: Any, unknowns: np.ndarray, values: np.ndarray) -> float:
        """Return the length of the paths that are to close (s)."""
        force = self.force(values) if events[0] >= 0 else None
        return float(unknowns[-1 - self.parameters]) if force is None else force[0] * events[1] / force[2]

    def _path(self, events: Any, unknowns: np.ndarray) -> Paths:
        """Return the path that is to close."""
        values = unknowns[-self.parameters :]
        lengths = np.array([self._length(events, unknowns, values)])
        return Paths(unknowns[None, : len(self.sizes)], values[None], lengths)

    def _left(self, events: Any, unknowns: np.ndarray, base: np.ndarray) -> np.ndarray:
        """Return what is left of the equations."""
        path = self._path(events, unknowns)
        return self._apart(events, unknowns, base, path, self._ends(path))

    def _apart(self, events: Any, unknowns: np.ndarray, base: np.ndarray, paths: Paths, ends: Ends) -> np.ndarray:
        """Return what is left of the equations by the first of some paths."""
        last = unknowns[len(self.sizes)] - paths.lengths[0] if events[0] >= 0 else (unknowns - base)[self._anchor(base)]
        return np.append(ends.states[0] - paths.starts[0], last)

    def _anchor(self, base: np.ndarray) -> int:
        """Return the displacement that stays as it is where nothing tells the time."""
        half = len(self.bodies)
        return int(np.argmax(np.abs(base[half : 2 * half]) / self.sizes[half:]))

    def _around(self, events: Any, unknowns: np.ndarray) -> Paths:
        """Return the path that is to close, and those from which derivatives at fixed parameters are found."""
        (start,), (value,), (length,) = self._path(events, unknowns)
        steps = np.diag(SHIFT * self.sizes)
        starts, lengths = [start[None], start + steps, start - steps], np.full(1 + 2 * len(steps), length)
        if events[0] < 0:
            starts.append(np.repeat(start[None], 2, axis=0))
            lengths = np.append(lengths, length * (1.0 + np.array([1.0, -1.0]) * SHIFT))
        found = np.concatenate(starts)
        return Paths(found, np.repeat(value[None], len(found), axis=0), lengths)

    def _at_fixed(self, events: Any, unknowns: np.ndarray, base: np.ndarray, paths: Paths, ends: Ends) -> Equations:
        """Return the equations at fixed parameters from the ends of the paths of `_around`."""
        count = len(self.sizes)
        result = np.zeros((count + 1, count + 1))
        moved = ends.states[1 : 1 + count] - ends.states[1 + count : 1 + 2 * count]
        result[:count, :count] = (moved / (2.0 * SHIFT * self.sizes[:, None])).T - np.eye(count)
        if events[0] < 0:
            late = slice(1 + 2 * count, 3 + 2 * count)
            (one, other), (longer, shorter) = ends.states[late], paths.lengths[late]
            result[:count, count] = (one - other) / (longer - shorter)
            result[count, self._anchor(base)] = 1.0
        else:
            result[count, count] = 1.0
        return Equations(self._apart(events, unknowns, base, paths, ends), result, ends.events[0])

    def _equations(self, events: Any, unknowns: np.ndarray, base: np.ndarray) -> Equations:
        """Return the equations with all derivatives."""
        count, around = len(self.sizes), self._around(events, unknowns)
        shifts = SHIFT * np.diag(self.span)
        values = np.concatenate([unknowns[-self.parameters :] + shifts, unknowns[-self.parameters :] - shifts])
        lengths = np.array([self._length(events, unknowns, item) for item in values])
        starts = np.repeat(unknowns[None, :count], len(values), axis=0)
        paths = Paths.joined([around, Paths(starts, values, lengths)])
        ends = self._ends(paths)
        found = self._at_fixed(events, unknowns, base, around, ends)
        one, other = ends.states[len(around.starts) :].reshape(2, self.parameters, count)
        (longer, shorter), apart = lengths.reshape(2, -1), 2.0 * SHIFT * self.span
        last = -(longer - shorter) / apart if events[0] >= 0 else np.zeros(self.parameters)
        columns = np.vstack([((one - other) / apart[:, None]).T, last])
        return found._replace(derivatives=np.hstack([found.derivatives, columns]))

    def _taken(
        self, events: Any, unknowns: np.ndarray, base: np.ndarray, border: np.ndarray, steps: int
    ) -> Orbit | None:
        """Return an orbit with its derivatives and events."""
        try:
            found = self._equations(events, unknowns, base)
            tangent = np.linalg.solve(np.vstack([found.derivatives, border]), np.eye(len(unknowns))[-1])
        except (InvalidInput, np.linalg.LinAlgError) as error:
            self.refusal = str(error)
            return None
        self._last, orbit = found.derivatives, self._orbit(events, unknowns, found)
        return replace(orbit, tangent=tangent, tests=orbit.tests._replace(fold=float(tangent[-1])), steps=steps)

    def _orbit(self, events: Any, unknowns: np.ndarray, found: Equations) -> Orbit:
        """Return an orbit, or what is one but for what is left of the equations, without its direction."""
        count, period = len(self.sizes), float(unknowns[len(self.sizes)])
        monodromy = found.derivatives[:count, :count] + np.eye(count)
        flip = float(np.linalg.det(monodromy + np.eye(count)))
        tests = Tests(math.nan, flip, torus_of(monodromy), math.inf, -math.inf, math.inf)
        table = self._happenings(found.events)
        if len(events) > 2:
            table = _without_touches(table, self.contacts[events[2]], BRIEF * period)
        rates = np.array([item.closing_velocity for item in table])
        pattern = tuple(sorted((item.contact, item.kind) for item in table))  # wherever the period begins
        return Orbit(
            unknowns.copy(), np.zeros(len(unknowns)), monodromy, tests, events, rates, 0, tuple(table), pattern
        )

    def _turning_points(self, orbit: Orbit, contact: int) -> np.ndarray:
        """Return the gap of a contact where it turns in a period (m); the one nearest to 0 to rounding."""
        from scipy.interpolate import CubicHermiteSpline

        path = self._of_orbits([orbit])
        network, period = self.network(orbit), float(path.lengths[0])

        def turns(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            course = self._course([network], path.starts, np.zeros(1), times[-1:], times[None], OF_MAP)
            curve = CubicHermiteSpline(times, *self.gaps(orbit, contact, course.lanes.samples[0], times))
            places = curve.derivative().roots(extrapolate=False)
            places = places[np.isfinite(places)]
            return places, curve(places)

        places, values = turns(period / GAP_SAMPLES * np.arange(GAP_SAMPLES + 3))
        if not len(places):
            return np.array([math.inf])
        nearest = int(np.abs(values).argmin())
        around = places[nearest] + period / GAP_SAMPLES * np.linspace(-1.0, 1.0, FINER_SAMPLES + 1)
        finer = turns(around[around >= 0.0])[1]
        if len(finer):
            values[nearest] = finer[np.abs(finer - values[nearest]).argmin()]
        return values

    def _happenings(self, rows: np.ndarray) -> list[Happening]:
        found = []
        for row in rows:
            before, after = int(row[BEFORE]), int(row[AFTER])
            velocity = float(row[RATE_BEFORE]) if before == OPEN else math.nan
            word = WORDS.get((before, after), "turn")
            found.append(Happening(float(row[WHEN]), self.contacts[int(row[OF_CONTACT])], word, velocity))
        return found

    def _works(self, orbits: Sequence[Orbit]) -> np.ndarray:
        """Return the work of all forces in a period of each orbit (J)."""
        paths, count = self._of_orbits(orbits), len(self.bodies)
        networks = [self._network(values) for values in paths.values]
        if any(True for _ in given_motions(networks[0].model)):
            return np.full(len(orbits), math.nan)
        times = paths.lengths[:, None] * np.arange(WORK_SAMPLES) / WORK_SAMPLES
        course = self._course(networks, paths.starts, np.zeros(len(orbits)), times[:, -1].copy(), times, OF_RETURNS)
        result = np.zeros(len(orbits))
        for lane, network in enumerate(networks):
            sources, speeds = network.model.sources["force"], course.lanes.samples[lane, :, count : 2 * count]
            for number, excitation in enumerate(sources.excitations):
                slots, shares = sources.driven(number)
                velocity = speeds[:, np.searchsorted(network.free, slots)] @ np.asarray(shares, dtype=float)
                result[lane] += float((excitation.call("force", times[lane]) * velocity).mean()) * paths.lengths[lane]
        return result


def _without_touches(table: Sequence[Happening], contact: str, brief: float) -> list[Happening]:
    """Return events without those of a contact that follow each other in a short time (s), where it touches."""
    own = [place for place, item in enumerate(table) if item.contact == contact]
    pairs = [pair for pair in pairwise(own) if table[pair[1]].time - table[pair[0]].time < brief]
    touches = {place for pair in pairs for place in pair}
    return [item for place, item in enumerate(table) if place not in touches]


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
