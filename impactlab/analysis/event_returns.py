"""Lanes from event to event of a section: at a contact, or at a level of a displacement."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from impactlab.analysis.found_points import FULL_TURN, SAME_POINTS, TOLERANCE, Names, Returns, Wanted, overlap_text
from impactlab.analysis.prepared import Prepared
from impactlab.analysis.repetition import periods_of, sizes_of
from impactlab.kernels import event_log as log
from impactlab.kernels.contact_states import OPEN
from impactlab.kernels.from_event_to_event import WORST, Span
from impactlab.located.course import Course
from impactlab.located.scenes import Linear, as_lanes
from impactlab.located.sections_of_events import SectionsOfEvents
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse

PERIODS_A_POINT = 6
"""Periods that a section may take for each point, on average: motions with fewer points are refused."""


class EventLane:
    """The points of a section of one motion, and when contacts close.

    Parameters
    ----------
    prepared : Prepared
        The network.
    """

    def __init__(self, prepared: Prepared) -> None:
        self.parts: list[np.ndarray] = []
        self.closings: list[np.ndarray] = []  # (closing, 2): when, and the contact
        self.contacts, self.count = len(prepared.model.contacts.names), 0
        assert prepared.surface is not None
        self.section = SectionsOfEvents(prepared.surface, None, self, prepared.followed, prepared.motions)  # type: ignore[arg-type]

    def take(self, lanes: np.ndarray, values: np.ndarray) -> None:
        """Take points: time, velocity of the contact, displacements and velocities."""
        self.parts.append(values)
        self.count += len(values)

    def take_events(self, events: np.ndarray, states: np.ndarray) -> None:
        """Take events, and the states after them."""
        self.section.take(0, events, states)
        closes = (events[:, log.BEFORE] == OPEN) & (events[:, log.OF_CONTACT] < self.contacts)
        self.closings.append(events[closes][:, [log.WHEN, log.OF_CONTACT]])

    def impacts(self, begin: float, end: float) -> np.ndarray:
        """Return how often each contact closes after one time, up to another one, (contact,)."""
        every = np.concatenate([np.zeros((0, 2)), *self.closings])
        chosen = every[(every[:, 0] > begin) & (every[:, 0] <= end), 1].astype(np.int64)
        return np.bincount(chosen, minlength=self.contacts)


def event_returns(
    members: Sequence[Prepared], state: np.ndarray, laws: np.ndarray, wanted: Wanted, names: Names,
    show: Callable[[float], None],
) -> Returns:  # fmt: skip
    """Run networks whose section is met in events.

    Parameters
    ----------
    members : sequence of Prepared
        The networks, one for each lane.
    state, laws : (lane, …) ndarray
        Displacements and velocities, and states of laws, where they begin.
    wanted : Wanted
    names : callable
    show : callable
    """
    contacts, coordinates = len(members[0].model.contacts.names), state.shape[1] // 2
    result = Returns.nothing(len(members), wanted, coordinates, contacts)
    lanes = [EventLane(item) for item in members]
    run = _run_smooth if isinstance(members[0].scene, Smooth) else _run_linear
    ends, errors, lost = run(members, state, laws, wanted.transient + wanted.keep, lanes, names, show)
    result.refused.update(lost)
    for lane, item in enumerate(lanes):
        if lane in lost:
            continue
        if item.count < wanted.transient + wanted.keep:
            often = f"met only {item.count} times" if item.count else "never met"
            result.refused[lane] = (
                f"The section {members[lane].surface!r} is {often}; give another section, or a smaller "
                "transient= and keep=."
            )
            continue
        _take(result, lane, members[lane], item, state[lane], wanted)
        result.ends[lane], result.errors[lane] = ends[lane], errors[lane]
    return result


def _take(result: Returns, lane: int, prepared: Prepared, found: EventLane, begin: np.ndarray, wanted: Wanted) -> None:
    """Keep the points of a lane, and find its period and its impacts."""
    values = np.concatenate(found.parts)[wanted.transient : wanted.transient + wanted.keep]
    times, states = values[:, 0], values[:, 2:].reshape(len(values), 2, -1)
    free, half = prepared.model.bodies.free, result.ends.shape[1] // 2
    points = np.zeros((wanted.keep, 2, half))
    points[:, :, : free.sum()] = states[:, :, free]
    points = points.reshape(wanted.keep, 2 * half)
    unit = np.repeat([1.0, prepared.strobe.period / FULL_TURN], half)
    compared = (points * unit)[None]
    sizes = sizes_of(compared, (begin * unit)[None])
    result.sizes[lane] = sizes[0, 0] / unit
    if prepared.forced:  # states of one phase only are the same
        angle = FULL_TURN * times / prepared.strobe.period
        compared = np.concatenate([compared, np.stack([np.cos(angle), np.sin(angle)], axis=1)[None]], axis=2)
        sizes = np.concatenate([sizes, np.ones((1, 1, 2))], axis=2)
    noise = SAME_POINTS * wanted.tolerance
    period = int(periods_of(compared, sizes, wanted.tolerance, noise, wanted.keep // 4)[0])
    length = (wanted.keep - 1) // period * period if period else wanted.keep - 1
    result.periods[lane] = period
    result.impacts[lane] = found.impacts(times[-1 - length], times[-1]) / length
    if wanted.points:
        result.points[lane], result.times[lane] = points, times


def _take_events(lanes: Sequence[EventLane], lane: int, events: np.ndarray, states: np.ndarray) -> None:
    lanes[lane].take_events(events, states)


Ends = tuple[np.ndarray, np.ndarray, dict[int, str]]
"""States where lanes end, errors of their paths, and why lanes were lost."""


def _run_linear(
    members: Sequence[Prepared], state: np.ndarray, laws: np.ndarray, number: int, lanes: Sequence[EventLane],
    names: Names, show: Callable[[float], None],
) -> Ends:  # fmt: skip
    """Run linear networks until they have numbers of points."""
    scene = as_lanes([item.scene for item in members if isinstance(item.scene, Linear)])
    length = number * np.array([item.strobe.period for item in members])
    nothing, (x, v) = np.zeros((len(members), 0)), np.split(state, 2, axis=1)
    span = Span(TOLERANCE, False)
    course = Course(scene, x, v, 0.0 * length, length.copy(), nothing, span, True, True, partial(_take_events, lanes))
    lost = {
        int(lane): overlap_text(names(int(lane), contact), course.overlap[lane, contact])
        for lane, contact in np.argwhere(course.overlap)
    }
    course.chosen = np.array([lane not in lost for lane in range(len(members))])
    for turn in range(1, PERIODS_A_POINT + 1):
        course.run(names, lambda part, turn=turn: show(part / PERIODS_A_POINT + (turn - 1) / PERIODS_A_POINT))  # type: ignore[misc]
        short = np.array([item.count < number for item in lanes]) & course.chosen
        short[list(course.stuck)] = False
        if not short.any():
            break
        course.chosen = short
        course.go_on((turn + 1) * length, nothing)
    lost |= course.stuck
    ends = np.concatenate([course.lanes.x, course.lanes.v], axis=1)
    return ends, course.lanes.clock[:, WORST], lost


def _run_smooth(
    members: Sequence[Prepared], state: np.ndarray, laws: np.ndarray, number: int, lanes: list[EventLane],
    names: Names, show: Callable[[float], None],
) -> Ends:  # fmt: skip
    """Run networks under smooth laws until they have numbers of points, those with fewer once more and longer."""
    ends, errors, lost = state.copy(), np.full(len(members), np.nan), dict[int, str]()
    left, times = np.arange(len(members)), 1
    while len(left) and times <= PERIODS_A_POINT:
        for lane in left.tolist():
            lanes[lane] = EventLane(members[lane])
        here, (x, v) = [members[lane] for lane in left.tolist()], np.split(state[left], 2, axis=1)
        own, networks = [lanes[lane] for lane in left.tolist()], [item.scene for item in here]
        length = times * number * np.array([item.strobe.period for item in here])
        course = SmoothCourse(
            [item for item in networks if isinstance(item, Smooth)], x, v, laws[left], 0.0 * length, length,
            np.zeros((len(left), 0)), Span(TOLERANCE, False), partial(_take_events, own), True,
        )  # fmt: skip
        if course.overlap.any():
            for place, contact in np.argwhere(course.overlap):
                lost[int(left[place])] = overlap_text(names(int(left[place]), contact), course.overlap[place, contact])
            left = left[~course.overlap.any(axis=1)]
            continue
        course.run(partial(_name, names, left), show)
        lost.update({int(left[place]): text for place, text in course.stuck.items()})
        ends[left] = np.concatenate([course.lanes.x, course.lanes.v], axis=1)
        errors[left] = course.lanes.clock[:, WORST]
        left = np.array([lane for lane in left.tolist() if lane not in lost and lanes[lane].count < number], np.int64)
        times = math.ceil(2.5 * times)
    return ends, errors, lost


def _name(names: Names, lanes: np.ndarray, lane: int, contact: int) -> str:
    return names(int(lanes[lane]), contact)
