"""Itineraries of orbits: events in order, in words, begun elsewhere, or with an impact more or less."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from impactlab.analysis.orbit import Happening, Orbit
from impactlab.errors import InvalidInput
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
    SPRING,
    STICKS,
)
from impactlab.kernels.shooting import (
    AT_EVENT,
    BOUNCES,
    COMES_TO_REST,
    GOES_ON,
    IN_SEGMENT,
    OF_FUNCTIONAL,
    PASSES,
    SHORT_AT,
    Itinerary,
)
from impactlab.located.scenes import Linear

MOST_CYCLES, COMMON = 60, 1e-9
"""Cycles of a force in the common period of several at most, and part of a frequency that counts as none."""

HOLDS = 1e-12
"""Part of a stiffness that holds nothing."""

WORDS = {
    (OPEN, OPEN): "bounce",
    (OPEN, CLOSED): "close",
    (OPEN, HELD): "rest",
    (HELD, OPEN): "release",
    (CLOSED, OPEN): "open",
    (CLOSED, PARTED): "part",
    (PARTED, CLOSED): "press",
    (PARTED, OPEN): "open",
    (SLIPS_UP, STICKS): "stick",
    (SLIPS_DOWN, STICKS): "stick",
    (SLIPS_UP, SLIPS_DOWN): "turn",
    (SLIPS_DOWN, SLIPS_UP): "turn",
}
"""Events by the states of a contact before and after."""

OF_EVENTS = "functionals", "strikes", "together"
"""Fields with one value for each event."""

BRIEF = 1e-3
"""Part of a period that an impact takes at most, if it is to take none a little farther on."""


SHORTENS = "closing", "shortest", "touch"
"""Tests that vanish where something takes no time; a contact that is hardly closed touches, too."""


def drift_of(scene: Linear, lane: int = 0) -> np.ndarray:
    """Return the direction in which all bodies may stand anywhere, since only dry friction holds them, 0 if none."""
    holds = np.concatenate([scene.stiffness[lane], scene.links[lane, scene.kinds < FRICTION]])
    size = np.abs(holds).max(axis=1, initial=0.0, keepdims=True)
    _, sizes, directions = np.linalg.svd(holds / np.where(size > 0.0, size, 1.0))
    free = np.flatnonzero(np.append(sizes, np.zeros(len(directions) - len(sizes))) < HOLDS)
    if len(free) != 1:
        return np.zeros(len(directions))
    result: np.ndarray = directions[free[0]] / np.abs(directions[free[0]]).max()
    result[np.abs(result) < HOLDS] = 0.0
    return result


def without_drift(states: np.ndarray, drift: np.ndarray) -> np.ndarray:
    """Return states, (…, 2 body), with the body that moves farthest along a drift at 0."""
    if not drift.any():
        return states
    pivot, result = int(np.abs(drift).argmax()), states.copy()
    result[..., : len(drift)] -= states[..., pivot, None] * (drift / drift[pivot])
    return result


def signs_of(kinds: np.ndarray, statuses: np.ndarray) -> np.ndarray:
    """Return the signs with which functionals stay negative, 0 for any, (segment, 2 contact)."""
    signs = np.zeros((*statuses.shape, 2))
    rubs, damped = kinds >= FRICTION, kinds == DASHPOT
    signs[statuses == OPEN, 0] = 1.0
    signs[statuses == HELD, 1] = -1.0
    signs[statuses == PARTED] = -1.0, 1.0
    signs[(statuses == CLOSED) & ~damped, 0] = -1.0
    signs[(statuses == CLOSED) & damped, 1] = -1.0
    signs[(statuses == STICKS) & rubs] = 1.0, 1.0
    signs[statuses == SLIPS_UP, 0] = -1.0
    signs[statuses == SLIPS_DOWN, 0] = 1.0
    return signs.reshape(len(statuses), -1)


def same(one: Itinerary, other: Itinerary) -> bool:
    """Whether two itineraries are the same."""
    return one.statuses.shape == other.statuses.shape and all(
        bool((getattr(one, name) == getattr(other, name)).all())
        for name in ("statuses", "functionals", "strikes", "period")
    )


def alike(one: Itinerary, other: Itinerary) -> bool:
    """Whether two itineraries are the same, wherever in a period they begin."""
    return any(same(rotated(one, first), other) for first in range(max(1, len(one.functionals))))


def table_of(events: Itinerary, times: np.ndarray, rates: np.ndarray, names: Sequence[str]) -> list[Happening]:
    """Return the events of an itinerary at some times, in words; rates are closing velocities where contacts close."""
    found = []
    for event, functional in enumerate(events.functionals.tolist()):
        contact = functional // 2
        before, after = int(events.statuses[event, contact]), int(events.statuses[event + 1, contact])
        closes = before == OPEN
        word = "touch" if events.strikes[event] == PASSES else WORDS.get((before, after), "slip")
        velocity = float(rates[event]) if closes else np.nan
        found.append(Happening(float(times[event]), names[contact], word, velocity))
    return found


def common_period(frequencies: np.ndarray) -> tuple[float, int, int] | None:
    """Return the shortest common period of waves (s), one of them and its cycles in it; None if there are none."""
    waves = np.flatnonzero(frequencies)
    if not len(waves):
        return None
    first = int(waves[0])
    ratios = [Fraction(float(item / frequencies[first])).limit_denominator(MOST_CYCLES) for item in frequencies[waves]]
    for wave, ratio in zip(waves.tolist(), ratios, strict=True):
        if abs(float(ratio) * frequencies[first] - frequencies[wave]) > COMMON * frequencies[wave]:
            raise InvalidInput(
                f"Forces of {frequencies[first]:.9g} and {frequencies[wave]:.9g} rad s-1 have no common period of "
                f"{MOST_CYCLES} periods of one of them or less: the network has no periodic orbit."
            )
    cycles = math.lcm(*(ratio.denominator for ratio in ratios))
    return 2.0 * math.pi * cycles / float(frequencies[first]), first, cycles


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


def with_impact(events: Itinerary, segment: int, functional: int, passing: bool = False) -> tuple[Itinerary, int]:
    """Return an itinerary with one more impact in a segment, and the number of its events.

    Or with an opening in an impact, with a slip in a stick, or the reverse.

    One that is `passing` touches only.
    """
    contact, lower = divmod(functional, 2)
    kind, status = int(events.kinds[contact]), int(events.statuses[segment, contact])
    if passing:
        states, others = [], [0]
    elif kind >= FRICTION and status == STICKS:
        states, others = [SLIPS_DOWN if lower else SLIPS_UP], [lower, 0]
    elif kind >= FRICTION:
        states, others = [STICKS], [0, int(status == SLIPS_DOWN)]
    elif status == CLOSED:
        states, others = {SPRING: ([OPEN], [0, 0]), DASHPOT: ([PARTED], [1, 1])}[kind]
    else:
        states, others = {RIGID: ([], [0]), SPRING: ([CLOSED], [0, 0]), DASHPOT: ([CLOSED, PARTED], [0, 1, 0])}[kind]
    between = np.repeat(events.statuses[segment, None], len(others), axis=0)
    between[:, contact] = [status, *states]
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
    """Return the segment of an orbit in which something comes to touch, and the functional of it."""
    return int(orbit.details[IN_SEGMENT]), int(orbit.details[OF_FUNCTIONAL])


def brief_impact(at: Orbit, test: str, size: int) -> tuple[int, int] | None:
    """Return the first and the last event of what takes no time where a test vanishes, if it is one.

    That is an impact, or what is between two events of a contact or a friction: a stick, a slip, an opening.
    """
    events = at.events
    assert isinstance(events, Itinerary)
    if test not in SHORTENS or not len(events.functionals) or events.together.any():
        return None
    place = int(at.details[AT_EVENT if test == "closing" else SHORT_AT])
    contact, count = int(events.functionals[place]) // 2, len(events.functionals)
    elsewhere = test == "touch" and at.details[IN_SEGMENT] >= 0 and touched(at)[1] // 2 != contact
    if events.strikes[place] == COMES_TO_REST or elsewhere:
        return None
    pairs = [(place - 1, place), (place, place + 1)]
    if events.kinds[contact] < FRICTION:
        first, last = place, place
        while first >= 0 and events.statuses[first, contact] != OPEN:
            first -= 1
        while last < count and events.statuses[last + 1, contact] != OPEN:
            last += 1
        pairs.insert(0, (first, last))
    times = at.unknowns[size : size + count + 1]
    for first, last in pairs:
        if first < 0 or last >= count or (events.functionals[first : last + 1] // 2 != contact).any():
            continue
        same_after = events.statuses[first, contact] == events.statuses[last + 1, contact]
        if same_after and times[last] - times[first] <= BRIEF * times[count]:
            return first, last
    return None


def across(at: Orbit, test: str, size: int) -> int | None:
    """Return the first event of what goes on across the beginning of an orbit where a test vanishes, if it does."""
    events = at.events
    assert isinstance(events, Itinerary)
    if test not in SHORTENS or not len(events.functionals) or brief_impact(at, test, size) is not None:
        return None
    place, count = int(at.details[AT_EVENT if test == "closing" else SHORT_AT]), len(events.functionals)
    contact, first = int(events.functionals[place]) // 2, len(events.functionals)
    opens = events.statuses[0, contact] == OPEN and (events.functionals[[0, -1]] // 2 == contact).all()
    if events.kinds[contact] >= FRICTION or opens:
        return count - 1 if place in ((0, count - 1) if test == "closing" else (0,)) else None
    while first > 0 and events.statuses[first, contact] != OPEN:
        first -= 1
    return first if 0 < first < count else None
