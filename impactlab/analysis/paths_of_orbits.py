"""Paths from event to event over a period, and the itineraries of orbits that they tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from impactlab.analysis.found_points import overlap_text
from impactlab.analysis.itineraries import drift_of, signs_of
from impactlab.kernels.contact_states import (
    CLOSED,
    DASHPOT,
    FRICTION,
    HELD,
    OPEN,
    PARTED,
    RIGID,
    SLIPS_DOWN,
    SLIPS_UP,
    STICKS,
)
from impactlab.kernels.event_log import AFTER, BEFORE, EVENT, OF_CONTACT, WHEN
from impactlab.kernels.from_event_to_event import Span
from impactlab.kernels.shooting import BOUNCES, COMES_TO_REST, GOES_ON, Itinerary
from impactlab.located.course import Course
from impactlab.located.scenes import TOUCHING, Linear

LOW, FINE = 1e-10, 1e-18
"""Height of bounces that are taken for rest, as a part of the motion; and where orbits that graze are to be seen."""

AT_BEGINNING = 1e-9
"""Part of a period within which a contact that touches at the beginning rests, and a friction sticks."""


class Paths(NamedTuple):
    """Paths of lanes over some time, each with its events."""

    ends: np.ndarray  # (lane, 2 body) states at the end
    sizes: np.ndarray  # (lane, 2 body) root mean squares of displacements and velocities
    first: np.ndarray  # (lane, contact) states of contacts at the beginning
    events: list[np.ndarray]  # (event, EVENT) of each lane
    after: list[np.ndarray]  # (event, 2 body) states after these
    lost: dict[int, str]  # why lanes could not be followed


def follow(
    scene: Linear, states: np.ndarray, lengths: np.ndarray, tolerance: float = LOW, names: Sequence[str] = ()
) -> Paths:
    """Return the paths of lanes from their states at the time 0, (lane, 2 body), each over some time (s).

    With the `names` of contacts it is said why lanes are lost.
    """
    bodies, lanes = scene.mass.shape[1], len(states)
    events: list[list[np.ndarray]] = [[] for _ in range(lanes)]
    after: list[list[np.ndarray]] = [[] for _ in range(lanes)]

    def take(lane: int, rows: np.ndarray, own: np.ndarray) -> None:
        events[lane].append(rows)
        after[lane].append(own)

    x, v = states[:, :bodies].copy(), states[:, bodies:].copy()  # they move
    begins, none = np.zeros(lanes), np.zeros((lanes, 0))
    course = Course(scene, x, v, begins, lengths, none, Span(tolerance, True), True, True, take)
    begun = course.lanes.statuses.copy()
    lost = _run(course, names)
    means = course.lanes.bodies[:, :, :bodies] / lengths[:, None, None]
    return Paths(
        np.hstack([course.lanes.x, course.lanes.v]),
        np.sqrt(np.hstack([means[:, 1], means[:, 3]])),
        begun,
        [np.concatenate([np.zeros((0, EVENT)), *item]) for item in events],
        [np.concatenate([np.zeros((0, 2 * bodies)), *item]) for item in after],
        lost,
    )


def sampled(scene: Linear, states: np.ndarray, begins: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the states of lanes at some times, of paths that begin before, (lane, sample, 2 body).

    Those that cannot be followed are NaN.
    """
    bodies, lanes = scene.mass.shape[1], len(states)
    x, v = states[:, :bodies].copy(), states[:, bodies:].copy()  # they move
    ends, times = np.full(lanes, times[-1]), np.repeat(times[None], lanes, axis=0)
    course = Course(scene, x, v, begins, ends, times, Span(LOW, False))
    lost = _run(course)
    found: np.ndarray = course.lanes.samples[:, :, : 2 * bodies]
    found[list(lost)] = np.nan
    return found


def _run(course: Course, names: Sequence[str] = ()) -> dict[int, str]:
    """Run lanes to their end; return why some could not be followed."""

    def name(lane: int, contact: int) -> str:
        return names[contact] if names else f"contact {contact}"

    lost = {
        int(lane): overlap_text(name(lane, contact), course.overlap[lane, contact])
        for lane, contact in np.argwhere(course.overlap)
    }
    course.run(name)
    return dict(course.stuck) | lost


def itinerary_of(
    scene: Linear, paths: Paths, lane: int, length: float, period: tuple[int, int]
) -> tuple[Itinerary, np.ndarray]:
    """Return the itinerary of a lane over a time, and when its events are; `period` is a wave and its cycles."""
    kinds, status = scene.kinds, paths.first[lane].copy()
    rows, after = paths.events[lane], paths.after[lane]
    ends = {int(row[OF_CONTACT]): row[AFTER] for row in rows}
    while len(rows) and rows[0, WHEN] <= AT_BEGINNING * length:
        contact, then = int(rows[0, OF_CONTACT]), int(rows[0, AFTER])
        if not (then == HELD or then == STICKS == ends[contact]):
            break
        status[contact] = then
        rows, after = rows[1:], after[1:]
    statuses, functionals, strikes = [status.copy()], [], []
    for row, state in zip(rows, after, strict=True):
        contact, before, then = (int(row[column]) for column in (OF_CONTACT, BEFORE, AFTER))
        functionals.append(_functional(int(kinds[contact]), contact, before, then))
        strikes.append(_strike(int(kinds[contact]), before, then))
        status[contact] = then
        if strikes[-1] >= BOUNCES:
            _let_slip(scene, lane, contact, state, row[WHEN], status)
        statuses.append(status.copy())
    times = rows[:, WHEN].copy()
    together = np.concatenate([[False], times[1:] == times[:-1]])[: len(times)]
    return (
        Itinerary(
            kinds,
            np.array(statuses, dtype=np.int64).reshape(len(times) + 1, len(kinds)),
            signs_of(kinds, np.array(statuses).reshape(len(times) + 1, len(kinds))),
            np.array(functionals, dtype=np.int64),
            np.array(strikes, dtype=np.int64),
            together.astype(np.int64),
            np.array(period, dtype=np.int64),
            drift_of(scene, lane),
        ),
        times,
    )


def _functional(kind: int, contact: int, before: int, after: int) -> int:
    """Return what vanishes where a contact goes from one state to another."""
    if kind >= FRICTION:
        return 2 * contact + int(before == STICKS and after == SLIPS_DOWN)
    by_force = before == HELD or (before == CLOSED and kind == DASHPOT) or (before == PARTED and after == CLOSED)
    return 2 * contact + int(by_force)


def _strike(kind: int, before: int, after: int) -> int:
    if kind != RIGID or before != OPEN:
        return GOES_ON
    return BOUNCES if after == OPEN else COMES_TO_REST


def _let_slip(scene: Linear, lane: int, contact: int, state: np.ndarray, time: float, status: np.ndarray) -> None:
    """Let dry friction slip as an impact of a contact has made it."""
    bodies, links, mass = scene.mass.shape[1], scene.links[lane], scene.mass[lane]
    turn = np.exp(1j * scene.frequencies[lane] * time)
    for row in np.flatnonzero(scene.kinds == FRICTION):
        parts = links[row] * links[contact] / mass
        if abs(parts.sum()) <= TOUCHING * np.abs(parts).sum():
            continue
        moving = (1j * scene.frequencies[lane] * scene.wall[lane, row] * turn).sum().real
        rate = links[row] @ state[bodies:] + moving + scene.frictions[lane, row, 2]
        size = np.abs(links[row]) @ np.abs(state[bodies:]) + abs(scene.frictions[lane, row, 2])
        status[row] = STICKS if abs(rate) <= TOUCHING * size else SLIPS_UP if rate > 0.0 else SLIPS_DOWN
