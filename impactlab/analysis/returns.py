"""Lanes from strobe to strobe: the motion that each comes up to, its period and its impacts.

Linear networks between events are lanes of one course in units of time in which all forces have the period 2π, so that
lanes of different periods run together. A lane ends when it has come up to a periodic motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from impactlab.analysis.repetition import periods_of, sizes_of
from impactlab.errors import InvalidInput
from impactlab.kernels.contact_states import FRICTION
from impactlab.kernels.from_event_to_event import CHATTERS, CLOSINGS, WORST, Span
from impactlab.located.course import Course
from impactlab.located.scenes import Linear
from impactlab.located.sliders import with_sliders
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse

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


class Returns(NamedTuple):
    """Section points of lanes, their periods and their impacts."""

    points: np.ndarray  # (lane, keep, 2 coordinate) displacements and velocities
    periods: np.ndarray  # (lane,) points after which the motion repeats, 0 if it does not, -1 where there is none
    impacts: np.ndarray  # (lane, contact) mean number from point to point, NaN for endlessly many
    errors: np.ndarray  # (lane,) largest estimated error of a displacement (m)
    refused: dict[int, str]  # why there is none

    @classmethod
    def nothing(cls, lanes: int, keep: int, coordinates: int, contacts: int) -> Returns:
        """Return room for the results of lanes."""
        unknown = np.full((lanes, keep, 2 * coordinates), np.nan), np.full(lanes, -1)
        return cls(*unknown, np.full((lanes, contacts), np.nan), np.full(lanes, np.nan), {})

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
    periods : (lane,) ndarray
        Time from point to point (s); the same for all under given functions.
    state : (lane, 2 coordinate) ndarray
        Displacements and velocities where they begin.
    wanted : Wanted
    contacts : int
        Number of contacts, behind which couplings with events follow.
    """

    def __init__(self, scene: Linear, periods: np.ndarray, state: np.ndarray, wanted: Wanted, contacts: int) -> None:
        self.wanted, self.contacts, self.units = wanted, contacts, periods[:, None] / FULL_TURN
        given = scene.loads.shape[2] > 0
        self.interval = float(periods[0]) if given else FULL_TURN
        self.scale = self.interval / FULL_TURN  # from velocities of the course to those of angles
        scene = scene if given else scene.in_units(self.units[:, 0])
        x, v = np.split(state, 2, axis=1)
        v = v * self.units / self.scale
        span = Span(0.0, self.interval, 1, TOLERANCE, False)
        room = max(wanted.keep, *AT_ONCE)
        self.course = Course(scene, x, v, 0.0, span, room)
        self.points = np.concatenate([x, v * self.scale], axis=1)[:, None]
        self.drifts = drifts_of(scene)
        self.sizes = sizes_of(self._held(self.points))
        self.counts = np.zeros((len(x), contacts))

    def run(self, names: Names, show: Callable[[float], None]) -> Returns:
        """Run the lanes."""
        wanted, course, number = self.wanted, self.course, len(self.units)
        total, done, last = wanted.transient + wanted.keep - 1, 0, np.zeros(number, np.int64)
        result = Returns.nothing(number, wanted.keep, self.points.shape[2] // 2, self.contacts)
        overlapping = self._refuse_overlap(names, result)
        active, lengths = ~overlapping, iter(AT_ONCE)
        history = self.points[active]
        while active.any() and done < total:
            length = next(lengths, AT_ONCE[-1])
            length = min(length, (wanted.transient if done < wanted.transient else total) - done)
            new, counts = self._advance(active, length, names)
            if done >= wanted.transient:
                self.counts[active] += counts
            done += length
            history = np.concatenate([history, new], axis=1)[:, -wanted.keep :]
            self.sizes[active] = np.maximum(self.sizes[active], sizes_of(self._held(new)))
            found = periods_of(self._held(history), self.sizes[active], wanted.settled, ROUNDED_POINTS, SHORT)
            lost = np.isin(np.flatnonzero(active), list(course.stuck))
            result.periods[active], last[active] = np.where(lost, -1, found), done
            history = history[(found == 0) & ~lost]
            active[active] = (found == 0) & ~lost
            show((number - active.sum() * (1.0 - done / total)) / number)
        result.refused.update(course.stuck)
        if active.any():
            result.points[active] = history
            sizes, tolerance = self.sizes[active], wanted.tolerance
            held, noise = self._held(history), SAME_POINTS * tolerance
            result.periods[active] = periods_of(held, sizes, tolerance, noise, wanted.keep // 4)
        result.impacts[active] = self.counts[active] / max(1, wanted.keep - 1)
        self._close(result, active, last, names)
        coordinates = result.points.shape[2] // 2
        result.points[:, :, coordinates:] /= self.units[:, None]
        errors = course.lanes.clock[:, WORST]
        result.errors[:] = np.where(errors <= self.sizes.max(axis=(1, 2)), errors, np.inf)
        return result

    def _held(self, points: np.ndarray) -> np.ndarray:
        """Return points without displacements in directions in which networks drift."""
        if not self.drifts.shape[1]:
            return points
        result = points.copy()
        x = result[:, :, : len(self.drifts)]
        x -= x @ self.drifts @ self.drifts.T
        return result

    def _refuse_overlap(self, names: Names, result: Returns) -> np.ndarray:
        overlap = self.course.overlap
        for lane, contact in np.argwhere(overlap):
            text = f"The bodies of contact {names(lane, contact)!r} overlap by {overlap[lane, contact]:g} m"
            result.refused[int(lane)] = f"{text} at the start; give another initial= or clearance."
        return np.asarray(overlap.any(axis=1))

    def _advance(self, chosen: np.ndarray, length: int, names: Names) -> tuple[np.ndarray, np.ndarray]:
        """Return the next points of some lanes, and their impacts meanwhile, NaN for endlessly many."""
        course = self.course
        course.repeat(chosen, length, self.interval)
        course.run(names)
        bodies, sums = course.lanes.x.shape[1], course.lanes.contacts[chosen, :, : self.contacts]
        points = course.lanes.samples[chosen, :length, : 2 * bodies]
        points[:, :, bodies:] *= self.scale
        return points, np.where(sums[:, CHATTERS] > 0.0, np.nan, sums[:, CLOSINGS])

    def _close(self, result: Returns, kept: np.ndarray, last: np.ndarray, names: Names) -> None:
        """Go around periodic motions once more, which tells their impacts and the points of those not `kept` so far."""
        wanted = self.wanted
        for period in np.unique(result.periods[result.periods > 0]).tolist():
            chosen = result.periods == period
            before = np.concatenate([self.course.lanes.x, self.scale * self.course.lanes.v], axis=1)[chosen]
            around, counts = self._advance(chosen, period, names)
            result.impacts[chosen] = counts / period
            turns, places = np.divmod(wanted.transient + np.arange(wanted.keep) - last[chosen, None] - 1, period)
            points = np.take_along_axis(around, places[:, :, None], axis=1)
            if self.drifts.shape[1]:
                gone = around[:, -1] - before
                points += turns[:, :, None] * (gone - self._held(gone[:, None])[:, 0])[:, None]
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
    networks: Sequence[Smooth], period: float, state: np.ndarray, states: np.ndarray, wanted: Wanted, names: Names,
    show: Callable[[float], None],
) -> Returns:  # fmt: skip
    """Run networks under smooth laws, all with one period.

    Parameters
    ----------
    networks : sequence of Smooth
        The networks.
    period : float
        Time from point to point (s).
    state, states : (lane, …) ndarray
        Displacements and velocities, and states of laws, where they begin.
    wanted : Wanted
    names : callable
    show : callable
    """
    contacts, bodies = len(networks[0].model.contacts.names), state.shape[1] // 2
    result = Returns.nothing(len(networks), wanted.keep, bodies, contacts)

    def run(
        chosen: np.ndarray, begin: np.ndarray, laws: np.ndarray, before: int, after: int, show: Callable[[float], None]
    ) -> SmoothCourse:
        span, (x, v) = Span(after * period, period, 0, TOLERANCE, True), np.split(begin, 2, axis=1)
        members = [networks[lane] for lane in chosen]
        course = SmoothCourse(members, x, v, laws, -before * period, span, after + 1)
        if course.overlap.any():
            lane, contact = np.argwhere(course.overlap)[0]
            raise InvalidInput(f"The bodies of contact {names(int(chosen[lane]), contact)!r} overlap at the start.")
        course.run(lambda lane, contact: names(int(chosen[lane]), contact), show)
        result.refused.update({int(chosen[lane]): text for lane, text in course.stuck.items()})
        return course

    course = run(np.arange(len(networks)), state, states, wanted.transient, wanted.keep - 1, show)
    result.points[:] = course.lanes.samples[:, :, : 2 * bodies]
    result.errors[:] = course.lanes.clock[:, WORST]
    result.impacts[:] = course.lanes.contacts[:, CLOSINGS, :contacts] / max(1, wanted.keep - 1)
    angles = result.points * np.repeat([1.0, period / FULL_TURN], bodies)
    known = ~np.isin(np.arange(len(networks)), list(result.refused))
    result.periods[known] = periods_of(
        angles[known], sizes_of(angles[known]), wanted.tolerance, SAME_POINTS * wanted.tolerance, wanted.keep // 4
    )
    laws = course.last_states
    for length in np.unique(result.periods[result.periods > 0]).tolist():
        chosen = np.flatnonzero(result.periods == length)
        around = run(chosen, result.points[chosen, -1], laws[chosen], 1, length, lambda part: None)
        result.impacts[chosen] = around.lanes.contacts[:, CLOSINGS, :contacts] / length
    return result
