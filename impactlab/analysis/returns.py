"""Lanes from strobe to strobe: the motion that each comes up to, its period and its impacts.

A lane ends when it has come up to a periodic motion. Velocities are compared in units in which the
period of the section is 2π.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import numpy as np

from impactlab.analysis.found_points import (
    FULL_TURN,
    ROUNDED_POINTS,
    SAME_POINTS,
    TOLERANCE,
    Names,
    Returns,
    Wanted,
    drifts_of,
    overlap_text,
)
from impactlab.analysis.repetition import periods_of, sizes_of
from impactlab.kernels.from_event_to_event import CHATTERS, CLOSINGS, WORST, Span
from impactlab.located.course import Course
from impactlab.located.earlier_runs import go_on, numbers_of
from impactlab.located.scenes import Linear
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse

SHORT = 4
"""Points that are compared with those a period before, at least, while lanes run."""

AT_ONCE = 16, 16, 32
"""Points after which lanes are looked at; the last is repeated."""


class Lanes(ABC):
    """Networks from strobe to strobe.

    Parameters
    ----------
    begin, interval : (lane,) ndarray
        Times at which they begin, and from point to point (s).
    state : (lane, 2 coordinate) ndarray
        Displacements and velocities where they begin.
    wanted : Wanted
    contacts : int
        Number of contacts, behind which couplings with events follow.
    drifts : (coordinate, direction) ndarray
        Directions in which nothing holds the bodies.
    """

    overlap: np.ndarray
    """By how much hard bodies overlap where lanes begin, (lane, contact) (m)."""

    stuck: dict[int, str]
    """Why lanes could not be followed to the end."""

    errors: np.ndarray
    """Largest estimated error of a displacement, (lane,) (m)."""

    def __init__(
        self, begin: np.ndarray, interval: np.ndarray, state: np.ndarray, wanted: Wanted, contacts: int,
        drifts: np.ndarray,
    ) -> None:  # fmt: skip
        self.wanted, self.contacts, self.begin, self.interval = wanted, contacts, begin, interval
        self.units = np.ones(state.shape) * self.interval[:, None] / FULL_TURN
        self.units[:, : state.shape[1] // 2] = 1.0
        self.drifts = drifts
        self.sizes = sizes_of(self._compared(state[:, None], slice(None)))
        self.counts = np.zeros((len(state), contacts))

    @abstractmethod
    def state(self) -> np.ndarray:
        """Return where lanes are, (lane, 2 coordinate)."""

    @abstractmethod
    def advance(self, chosen: np.ndarray, times: np.ndarray, names: Names) -> tuple[np.ndarray, np.ndarray]:
        """Let some lanes, (lane,), go on from their begin to the last of some times, (lane, point) (s).

        Return the next points, (chosen lane, point, 2 coordinate), and the impacts meanwhile, (chosen lane, contact),
        NaN for endlessly many.
        """

    def run(self, names: Names, show: Callable[[float], None]) -> Returns:
        """Run the lanes."""
        wanted, number = self.wanted, len(self.units)
        total, done, last = wanted.transient + wanted.keep - 1, 0, np.zeros(number, np.int64)
        result = Returns.nothing(number, wanted, self.units.shape[1] // 2, self.contacts)
        overlapping = self._refuse_overlap(names, result)
        active, lengths = ~overlapping, iter(AT_ONCE)
        history = self.state()[active, None]
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
            lost = np.isin(np.flatnonzero(active), list(self.stuck))
            result.periods[active], last[active] = np.where(lost, -1, found), done
            history = history[(found == 0) & ~lost]
            active[active] = (found == 0) & ~lost
            show((number - active.sum() * (1.0 - done / total)) / number)
        result.refused.update(self.stuck)
        if active.any():
            result.ends[active] = history[:, -1]
            if wanted.points:
                result.points[active] = history
            sizes, tolerance = self.sizes[active], wanted.tolerance
            compared, noise = self._compared(history, active), SAME_POINTS * tolerance
            result.periods[active] = periods_of(compared, sizes, tolerance, noise, wanted.keep // 4)
        result.impacts[active] = self.counts[active] / max(1, wanted.keep - 1)
        self._close(result, active, last, names)
        result.errors[:] = np.where(self.errors <= self.sizes.max(axis=(1, 2)), self.errors, np.inf)
        result.sizes[:] = self.sizes[:, 0] / self.units
        return result

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
        for lane, contact in np.argwhere(self.overlap):
            result.refused[int(lane)] = overlap_text(names(lane, contact), self.overlap[lane, contact])
        return np.asarray(self.overlap.any(axis=1))

    def _advance(self, chosen: np.ndarray, length: int, names: Names) -> tuple[np.ndarray, np.ndarray]:
        """Return the next points of some lanes, and their impacts meanwhile."""
        times = self.begin[:, None] + self.interval[:, None] * np.arange(1, length + 1)
        return self.advance(chosen, times, names)

    def _close(self, result: Returns, kept: np.ndarray, last: np.ndarray, names: Names) -> None:
        """Go around periodic motions once more, which tells their impacts and the points of those not `kept` so far."""
        wanted = self.wanted
        for period in np.unique(result.periods[result.periods > 0]).tolist():
            chosen = result.periods == period
            before = self.state()[chosen]
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


class LinearLanes(Lanes):
    """Networks whose motion is linear between events.

    Parameters
    ----------
    scene : Linear
        The networks; other parameters are those of `Lanes`.
    """

    def __init__(
        self, scene: Linear, begin: np.ndarray, interval: np.ndarray, state: np.ndarray, wanted: Wanted, contacts: int
    ) -> None:  # fmt: skip
        super().__init__(begin, interval, state, wanted, contacts, drifts_of(scene))
        x, v = np.split(state, 2, axis=1)
        self.course = Course(scene, x, v, begin, begin.copy(), np.zeros((len(x), 0)), Span(TOLERANCE, False))
        self.overlap, self.stuck = self.course.overlap, self.course.stuck

    @property
    def errors(self) -> np.ndarray:  # type: ignore[override]
        return self.course.lanes.clock[:, WORST]

    def state(self) -> np.ndarray:
        return np.concatenate([self.course.lanes.x, self.course.lanes.v], axis=1)

    def advance(self, chosen: np.ndarray, times: np.ndarray, names: Names) -> tuple[np.ndarray, np.ndarray]:
        course = self.course
        course.repeat(chosen, times)
        course.run(names)
        sums = course.lanes.contacts[chosen, :, : self.contacts]
        points = course.lanes.samples[chosen, :, : self.units.shape[1]]
        return points, np.where(sums[:, CHATTERS] > 0.0, np.nan, sums[:, CLOSINGS])


class SmoothLanes(Lanes):
    """Networks under smooth laws.

    Parameters
    ----------
    networks : sequence of Smooth
        The networks; other parameters are those of `Lanes`.
    laws : (lane, state) ndarray
        States of laws where they begin.
    """

    def __init__(
        self, networks: Sequence[Smooth], begin: np.ndarray, interval: np.ndarray, state: np.ndarray, laws: np.ndarray,
        wanted: Wanted, contacts: int,
    ) -> None:  # fmt: skip
        begin = begin - np.floor(begin / interval) * interval  # sums begin at 0
        super().__init__(begin, interval, state, wanted, contacts, np.zeros((state.shape[1] // 2, 0)))
        self.networks, self.stuck, self.errors = networks, {}, np.zeros(len(state))
        self._last, self._laws = state.copy(), laws
        self._numbers: np.ndarray | None = None  # from which lanes go on
        self.overlap = self._course(np.arange(len(state)), begin[:, None] + interval[:, None]).overlap

    def _course(self, lanes: np.ndarray, times: np.ndarray) -> SmoothCourse:
        """Return the course of some lanes to the last of some times, (chosen lane, point)."""
        members, (x, v) = [self.networks[lane] for lane in lanes], np.split(self._last[lanes], 2, axis=1)
        span = Span(TOLERANCE, True)
        course = SmoothCourse(members, x, v, self._laws[lanes], self.begin[lanes], times[:, -1], times, span)
        if self._numbers is not None:
            go_on(course.lasting, self._numbers[lanes])
            course.begin_sums()
        return course

    def state(self) -> np.ndarray:
        return self._last

    def advance(self, chosen: np.ndarray, times: np.ndarray, names: Names) -> tuple[np.ndarray, np.ndarray]:
        lanes = np.flatnonzero(chosen)
        course = self._course(lanes, times[lanes])
        course.run(lambda lane, contact: names(int(lanes[lane]), contact))
        self.stuck.update({int(lanes[lane]): text for lane, text in course.stuck.items()})
        numbers = numbers_of(course.lasting)
        if self._numbers is None:
            self._numbers = np.zeros((len(chosen), numbers.shape[1]))
        self._numbers[lanes], self._laws[lanes] = numbers, course.last_states
        self._last[lanes] = np.concatenate([course.lanes.x, course.lanes.v], axis=1)
        self.errors[lanes] = np.maximum(self.errors[lanes], course.lanes.clock[:, WORST])
        sums = course.lanes.contacts[:, :, : self.contacts]
        points = course.lanes.samples[:, :, : self.units.shape[1]]
        return points, np.where(sums[:, CHATTERS] > 0.0, np.nan, sums[:, CLOSINGS])
