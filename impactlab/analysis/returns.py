"""Lanes from strobe to strobe: the motion that each comes up to, its period and its impacts.

A lane between events ends when it has come up to a periodic motion. Velocities are compared in units in which the
period of the section is 2π.
"""

from __future__ import annotations

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
from impactlab.located.scenes import Linear
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse
from impactlab.records.surface import Strobe

SHORT = 4
"""Points that are compared with those a period before, at least, while lanes run."""

AT_ONCE = 16, 16, 32
"""Points after which lanes are looked at; the last is repeated."""


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
            result.refused[int(lane)] = overlap_text(names(lane, contact), overlap[lane, contact])
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
    sizes = sizes_of(angles, state[chosen] * units[chosen, 0])
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
            self.refused[int(lanes[place])] = overlap_text(
                self.names(int(lanes[place]), contact), course.overlap[place, contact]
            )
        if overlap.any():
            return None if overlap.all() else self.run(lanes[~overlap], state[~overlap], laws[~overlap], number, show)
        self.able = lanes
        course.run(lambda lane, contact: self.names(int(lanes[lane]), contact), show)
        self.refused.update({int(lanes[lane]): text for lane, text in course.stuck.items()})
        return course
