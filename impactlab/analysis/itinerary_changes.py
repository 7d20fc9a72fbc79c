"""Itineraries that begin elsewhere, or have an impact more or less."""

from __future__ import annotations

import numpy as np

from impactlab.analysis.itineraries import signs_of
from impactlab.analysis.orbit import Orbit
from impactlab.kernels.contact_states import CLOSED, DASHPOT, FRICTION, OPEN, PARTED, RIGID, SPRING
from impactlab.kernels.shooting import (
    AT_EVENT,
    BOUNCES,
    GOES_ON,
    IN_SEGMENT,
    OF_FUNCTIONAL,
    PASSES,
    RESTS,
    SHORT_AT,
    Itinerary,
)

OF_EVENTS = "functionals", "strikes", "together"
"""Fields with one value for each event."""

BRIEF = 1e-3
"""Part of a period that an impact takes at most, if it is to take none a little farther on."""


def rotated(events: Itinerary, first: int) -> Itinerary:
    """Return an itinerary that begins after some of its events."""
    return events._replace(
        statuses=np.concatenate([events.statuses[first:], events.statuses[1 : first + 1]]),
        signs=np.concatenate([events.signs[first:], events.signs[1 : first + 1]]),
        **{name: np.roll(getattr(events, name), -first) for name in OF_EVENTS},
    )


def without(events: Itinerary, first: int, last: int) -> Itinerary:
    """Return an itinerary without an impact, from its first event to its last."""
    group = np.arange(first, last + 1)
    return events._replace(
        statuses=np.delete(events.statuses, group, axis=0),
        signs=np.delete(events.signs, group, axis=0),
        **{name: np.delete(getattr(events, name), group) for name in OF_EVENTS},
    )


def with_impact(events: Itinerary, segment: int, contact: int, passing: bool = False) -> tuple[Itinerary, int]:
    """Return an itinerary with one more impact in a segment, and its number of events.

    One that is `passing` touches only.
    """
    kind = int(events.kinds[contact])
    states, others = {RIGID: ([], [0]), SPRING: ([CLOSED], [0, 0]), DASHPOT: ([CLOSED, PARTED], [0, 1, 0])}[kind]
    if passing:
        states, others = [], [0]
    between = np.repeat(events.statuses[segment, None], len(others), axis=0)
    between[:, contact] = [OPEN, *states]
    statuses = np.insert(events.statuses, segment, between, axis=0)
    strike = PASSES if passing else BOUNCES if kind == RIGID else GOES_ON
    changed = events._replace(
        statuses=statuses,
        signs=signs_of(events.kinds, statuses),
        functionals=np.insert(events.functionals, segment, 2 * contact + np.array(others)),
        strikes=np.insert(events.strikes, segment, [strike] * len(others)),
        together=np.insert(events.together, segment, [0] * len(others)),
    )
    return changed, len(others)


def touched(orbit: Orbit) -> tuple[int, int]:
    """Return the segment of an orbit in which a contact touches, and the contact."""
    return int(orbit.details[IN_SEGMENT]), int(orbit.details[OF_FUNCTIONAL]) // 2


def brief_impact(at: Orbit, test: str, size: int) -> tuple[int, int] | None:
    """Return the first and the last event of an impact that takes no time where a test vanishes, if it is one."""
    events = at.events
    assert isinstance(events, Itinerary)
    if test not in ("closing", "shortest") or events.together.any():
        return None
    place = int(at.details[AT_EVENT if test == "closing" else SHORT_AT])
    contact, count = int(events.functionals[place]) // 2, len(events.functionals)
    if events.kinds[contact] >= FRICTION or events.strikes[place] == RESTS:
        return None
    first, last = place, place
    while first >= 0 and events.statuses[first, contact] != OPEN:
        first -= 1
    while last < count and events.statuses[last + 1, contact] != OPEN:
        last += 1
    if first < 0 or last >= count or (events.functionals[first : last + 1] // 2 != contact).any():
        return None
    times = at.unknowns[size : size + count + 1]
    return (first, last) if times[last] - times[first] <= BRIEF * times[count] else None
