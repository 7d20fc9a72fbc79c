"""Lanes from strobe to strobe: the motion that each comes up to, its period and its impacts.

A lane between events ends when it has come up to a periodic motion. Velocities are compared in units in which the
period of the section is 2π.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab.analysis.prepared import Prepared
from impactlab.analysis.repetition import periods_of, sizes_of
from impactlab.kernels.contact_states import FRICTION
from impactlab.kernels.from_event_to_event import CHATTERS, CLOSINGS, WORST, Span
from impactlab.located.course import Course
from impactlab.located.scenes import Linear, as_lanes
from impactlab.located.sliders import with_sliders
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse
from impactlab.records.surface import Strobe

FULL_TURN = 2.0 * math.pi

TOLERANCE = 1e-10
"""That of located events, see `impactlab.EventLocated`."""

SETTLED_WITHIN = 1e-10
"""Distance from a periodic motion, as a part of its size, from which on it is taken for it: the error of a path."""

ROUNDED_POINTS = 1e-12
"""Part of the size of a motion up to which a difference between section points is rounding."""

SAME_POINTS = 1e-3
"""Part of the tolerance of periods up to which differences need not decrease any more."""

SHORT = 4
"""Points that are compared with those a period before, at least, while lanes run."""

AT_ONCE = 16, 16, 32
"""Points after which lanes are looked at; the last is repeated."""

Names = Callable[[int, int], str]
"""Returns the name of a contact of a lane."""


class Wanted(NamedTuple):
    """How many section points are wanted, and how closely they are compared."""

    transient: int  # points that are not kept
    keep: int
    tolerance: float  # part of the size of a motion up to which points are the same
    settled: float = SETTLED_WITHIN
    points: bool = True  # whether points are returned


class Returns(NamedTuple):
    """Section points of lanes, their periods and their impacts."""

    points: np.ndarray  # (lane, keep or 0, 2 coordinate) displacements and velocities
    ends: np.ndarray  # (lane, 2 coordinate) the last of them
    sizes: np.ndarray  # (lane, 2 coordinate) sizes of the motion
    periods: np.ndarray  # (lane,) points after which the motion repeats, 0 if it does not, -1 where there is none
    impacts: np.ndarray  # (lane, contact) mean number from point to point, NaN for endlessly many
    errors: np.ndarray  # (lane,) largest estimated error of a displacement (m)
    refused: dict[int, str]  # why there is none

    @classmethod
    def nothing(cls, lanes: int, wanted: Wanted, coordinates: int, contacts: int) -> Returns:
        """Return room for the results of lanes."""
        shapes = (wanted.keep if wanted.points else 0, 2 * coordinates), (2 * coordinates,), (2 * coordinates,)
        points, ends, sizes = (np.full((lanes, *shape), np.nan) for shape in shapes)
        impacts = np.full((lanes, contacts), np.nan)
        return cls(points, ends, sizes, np.full(lanes, -1), impacts, np.full(lanes, np.nan), {})

    def put(self, lanes: np.ndarray, found: Returns) -> None:
        """Put the results of some lanes in their places."""
        for own, other in zip(self[:-1], found[:-1], strict=True):
            own[lanes] = other
        self.refused.update({int(lanes[lane]): text for lane, text in found.refused.items()})


class LinearLanes:
    """Linear networks between events, from strobe to strobe.

    Parameters
    ----------
    scene : Linear
        The networks.
    begin, interval : (lane,) ndarray
        Times at which they begin, and from point to point (s).
    state : (lane, 2 coordinate) ndarray
        Displacements and velocities where they begin.
    wanted : Wanted
    contacts : int
        Number of contacts, behind which couplings with events follow.
    """

    def __init__(
        self, scene: Linear, begin: np.ndarray, interval: np.ndarray, state: np.ndarray, wanted: Wanted, contacts: int
    ) -> None:  # fmt: skip
        self.wanted, self.contacts, self.begin, self.interval = wanted, contacts, begin, interval
        self.units = np.ones(state.shape) * self.interval[:, None] / FULL_TURN
        self.units[:, : state.shape[1] // 2] = 1.0
        x, v = np.split(state, 2, axis=1)
        self.course = Course(scene, x, v, begin, begin.copy(), np.zeros((len(x), 0)), Span(TOLERANCE, False))
        self.drifts = drifts_of(scene)
        self.sizes = sizes_of(self._compared(state[:, None], slice(None)))
        self.counts = np.zeros((len(x), contacts))

    def run(self, names: Names, show: Callable[[float], None]) -> Returns:
        """Run the lanes."""
        wanted, course, number = self.wanted, self.course, len(self.units)
        total, done, last = wanted.transient + wanted.keep - 1, 0, np.zeros(number, np.int64)
        result = Returns.nothing(number, wanted, self.units.shape[1] // 2, self.contacts)
        overlapping = self._refuse_overlap(names, result)
        active, lengths = ~overlapping, iter(AT_ONCE)
        history = self._state()[active, None]
        while active.any() and done < total:
            length = next(lengths, AT_ONCE[-1])
            length = min(length, (wanted.transient if done < wanted.transient else total) - done)
            new, counts = self._advance(active, length, names)
            if done >= wanted.transient:
                self.counts[active] += counts
            done += length
            history = np.concatenate([history, new], axis=1)[:, -wanted.keep :]
            self.sizes[active] = np.maximum(self.sizes[active], sizes_of(self._compared(new, active)))
            found = periods_of(
                self._compared(history, active), self.sizes[active], wanted.settled, ROUNDED_POINTS, SHORT
            )
            lost = np.isin(np.flatnonzero(active), list(course.stuck))
            result.periods[active], last[active] = np.where(lost, -1, found), done
            history = history[(found == 0) & ~lost]
            active[active] = (found == 0) & ~lost
            show((number - active.sum() * (1.0 - done / total)) / number)
        result.refused.update(course.stuck)
        if active.any():
            result.ends[active] = history[:, -1]
            if wanted.points:
                result.points[active] = history
            sizes, tolerance = self.sizes[active], wanted.tolerance
            compared, noise = self._compared(history, active), SAME_POINTS * tolerance
            result.periods[active] = periods_of(compared, sizes, tolerance, noise, wanted.keep // 4)
        result.impacts[active] = self.counts[active] / max(1, wanted.keep - 1)
        self._close(result, active, last, names)
        errors = course.lanes.clock[:, WORST]
        result.errors[:] = np.where(errors <= self.sizes.max(axis=(1, 2)), errors, np.inf)
        result.sizes[:] = self.sizes[:, 0] / self.units
        return result

    def _state(self) -> np.ndarray:
        """Return where lanes are, (lane, 2 coordinate)."""
        return np.concatenate([self.course.lanes.x, self.course.lanes.v], axis=1)

    def _held(self, points: np.ndarray) -> np.ndarray:
        """Return points without displacements in directions in which networks drift."""
        if not self.drifts.shape[1]:
            return points
        result = points.copy()
        x = result[..., : len(self.drifts)]
        x -= x @ self.drifts @ self.drifts.T
        return result

    def _compared(self, points: np.ndarray, lanes: np.ndarray | slice) -> np.ndarray:
        """Return points of some lanes as they are compared, (lane, point, 2 coordinate)."""
        return np.asarray(self._held(points) * self.units[lanes, None])

    def _refuse_overlap(self, names: Names, result: Returns) -> np.ndarray:
        overlap = self.course.overlap
        for lane, contact in np.argwhere(overlap):
            result.refused[int(lane)] = _overlap(names(lane, contact), overlap[lane, contact])
        return np.asarray(overlap.any(axis=1))

    def _advance(self, chosen: np.ndarray, length: int, names: Names) -> tuple[np.ndarray, np.ndarray]:
        """Return the next points of some lanes, and their impacts meanwhile, NaN for endlessly many."""
        course = self.course
        course.repeat(chosen, self.begin[:, None] + self.interval[:, None] * np.arange(1, length + 1))
        course.run(names)
        sums = course.lanes.contacts[chosen, :, : self.contacts]
        points = course.lanes.samples[chosen, :, : self.units.shape[1]]
        return points, np.where(sums[:, CHATTERS] > 0.0, np.nan, sums[:, CLOSINGS])

    def _close(self, result: Returns, kept: np.ndarray, last: np.ndarray, names: Names) -> None:
        """Go around periodic motions once more, which tells their impacts and the points of those not `kept` so far."""
        wanted = self.wanted
        for period in np.unique(result.periods[result.periods > 0]).tolist():
            chosen = result.periods == period
            before = self._state()[chosen]
            around, counts = self._advance(chosen, period, names)
            result.impacts[chosen] = counts / period
            numbers = wanted.transient + np.arange(wanted.keep if wanted.points else 1)
            numbers = numbers if wanted.points else numbers + wanted.keep - 1
            turns, places = np.divmod(numbers - last[chosen, None] - 1, period)
            points = np.take_along_axis(around, places[:, :, None], axis=1)
            if self.drifts.shape[1]:
                gone = around[:, -1] - before
                points += turns[:, :, None] * (gone - self._held(gone))[:, None]
            result.ends[chosen] = np.where(kept[chosen, None], result.ends[chosen], points[:, -1])
            if wanted.points:
                result.points[chosen] = np.where(kept[chosen, None, None], result.points[chosen], points)


def drifts_of(scene: Linear) -> np.ndarray:
    """Return orthonormal directions in which no spring, contact or slider holds the bodies, (coordinate, direction)."""
    bodies = scene.mass.shape[1]
    rows = [scene.stiffness, with_sliders(scene, scene.links)[:, scene.kinds != FRICTION]]
    sizes = [np.abs(item).max(axis=(1, 2), initial=0.0)[:, None, None] for item in rows]
    scaled = [
        np.divide(item, size, out=np.zeros_like(item), where=size > 0.0) for item, size in zip(rows, sizes, strict=True)
    ]
    every = np.concatenate(scaled, axis=1).reshape(-1, bodies)
    rates, directions = np.linalg.eigh(every.T @ every)
    return directions[:, rates <= 1e-12 * max(1.0, rates.max(initial=0.0))]


def smooth_returns(
    networks: Sequence[Smooth], strobes: Sequence[Strobe], state: np.ndarray, states: np.ndarray, wanted: Wanted,
    names: Names, show: Callable[[float], None],
) -> Returns:  # fmt: skip
    """Run networks under smooth laws.

    Parameters
    ----------
    networks : sequence of Smooth
        The networks.
    strobes : sequence of Strobe
        Their sections.
    state, states : (lane, …) ndarray
        Displacements and velocities, and states of laws, where they begin.
    wanted : Wanted
    names : callable
    show : callable
    """
    contacts, bodies = len(networks[0].model.contacts.names), state.shape[1] // 2
    result = Returns.nothing(len(networks), wanted, bodies, contacts)
    lanes = _SmoothLanes(networks, strobes, names, result.refused)
    everywhere = np.arange(len(networks))
    course = lanes.run(everywhere, state, states, (wanted.transient, wanted.keep - 1), show)
    if course is None:
        return result
    chosen = np.array([lane for lane in everywhere if lane not in result.refused], dtype=np.int64)
    kept = np.searchsorted(lanes.able, chosen)
    points = course.lanes.samples[kept, :, : 2 * bodies]
    if wanted.points:
        result.points[chosen] = points
    result.ends[chosen] = points[:, -1]
    result.errors[chosen] = course.lanes.clock[kept, WORST]
    result.impacts[chosen] = course.lanes.contacts[kept, CLOSINGS, :contacts] / max(1, wanted.keep - 1)
    units = np.ones((len(networks), 1, 2 * bodies))
    units[:, 0, bodies:] = lanes.interval[:, None] / FULL_TURN
    angles, noise = points * units[chosen], SAME_POINTS * wanted.tolerance
    sizes = sizes_of(angles)
    result.sizes[chosen] = (sizes / units[chosen])[:, 0]
    result.periods[chosen] = periods_of(angles, sizes, wanted.tolerance, noise, wanted.keep // 4)
    laws = np.full((len(networks), states.shape[1]), np.nan)
    laws[lanes.able] = course.last_states
    for period in np.unique(result.periods[result.periods > 0]).tolist():
        here = np.flatnonzero(result.periods == period)
        around = lanes.run(here, result.ends[here], laws[here], (1, period), lambda part: None)
        if around is not None:
            result.impacts[lanes.able] = around.lanes.contacts[:, CLOSINGS, :contacts] / period
    return result


class _SmoothLanes:
    """Networks under smooth laws, from strobe to strobe; those that are refused are left out."""

    def __init__(
        self, networks: Sequence[Smooth], strobes: Sequence[Strobe], names: Names, refused: dict[int, str]
    ) -> None:
        self.networks, self.names, self.refused = networks, names, refused
        self.begin, self.interval = np.array([[item.start, item.period] for item in strobes]).reshape(-1, 2).T
        self.able = np.zeros(0, np.int64)  # lanes of the last run

    def run(
        self, lanes: np.ndarray, state: np.ndarray, laws: np.ndarray, number: tuple[int, int],
        show: Callable[[float], None],
    ) -> SmoothCourse | None:  # fmt: skip
        """Run some lanes for numbers of points before those that are kept, and among these; sums are of the latter."""
        before, after = number
        interval = self.interval[lanes, None]
        whole = np.floor(self.begin[lanes] / self.interval[lanes])[:, None] * interval
        start = self.begin[lanes, None] - whole  # sums begin at 0
        times = start + interval * np.arange(after + 1)
        members, (x, v) = [self.networks[lane] for lane in lanes], np.split(state, 2, axis=1)
        span, start = Span(TOLERANCE, True), times[:, 0] - before * interval[:, 0]
        course = SmoothCourse(members, x, v, laws, start, times[:, -1], times, span)
        overlap = course.overlap.any(axis=1)
        for place, contact in np.argwhere(course.overlap):
            self.refused[int(lanes[place])] = _overlap(
                self.names(int(lanes[place]), contact), course.overlap[place, contact]
            )
        if overlap.any():
            return None if overlap.all() else self.run(lanes[~overlap], state[~overlap], laws[~overlap], number, show)
        self.able = lanes
        course.run(lambda lane, contact: self.names(int(lanes[lane]), contact), show)
        self.refused.update({int(lanes[lane]): text for lane, text in course.stuck.items()})
        return course


def _overlap(name: str, size: float) -> str:
    return f"The bodies of contact {name!r} overlap by {size:g} m at the start; give another initial= or clearance."


def followed(
    lanes: Sequence[Prepared], state: np.ndarray, laws: np.ndarray, wanted: Wanted, show: Callable[[float], None]
) -> Returns:
    """Run networks as lanes, those that are alike in one call.

    They begin at the given displacements and velocities, (lane, 2 coordinate), and states of laws, (lane, state).
    """
    contacts = len(lanes[0].model.contacts.names)
    result = Returns.nothing(len(lanes), wanted, state.shape[1] // 2, contacts)
    groups: dict[tuple[Any, ...], list[int]] = {}
    for place, item in enumerate(lanes):
        groups.setdefault(item.alike, []).append(place)
    done = 0
    for places in groups.values():
        members, chosen = [lanes[place] for place in places], np.array(places)
        names = _names(members)

        def told(part: float, done: int = done, share: int = len(places)) -> None:
            show((done + share * part) / len(lanes))

        strobes = [item.strobe for item in members]
        if isinstance(members[0].scene, Smooth):
            networks = [item.scene for item in members if isinstance(item.scene, Smooth)]
            found = smooth_returns(networks, strobes, state[chosen], laws[chosen], wanted, names, told)
        else:
            scene = as_lanes([item.scene for item in members if isinstance(item.scene, Linear)])
            begin, interval = np.array([[item.start, item.period] for item in strobes]).T
            found = LinearLanes(scene, begin, interval, state[chosen], wanted, contacts).run(names, told)
        result.put(chosen, found)
        done += len(places)
    return result


def _names(members: Sequence[Prepared]) -> Callable[[int, int], str]:
    """Return a function that names a contact of a lane."""
    return lambda lane, contact: members[lane].row_names()[contact]
