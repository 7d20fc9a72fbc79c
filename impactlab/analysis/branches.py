"""Branches of orbits by pseudo-arclength, and the events on them, whatever method finds the orbits.

An orbit is a point on a curve, whose direction is its tangent. The next one is looked for on a plane across this
direction, some way ahead: so a branch goes through folds, and unstable orbits are found as stable ones are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from impactlab.analysis.orbit import Corrector, Orbit

SHORTEST_STEP = 1e-9
"""Shortest way from orbit to orbit, as a part of the longest one: branches turn sharply where an event takes no time.
"""

BEND = 0.97
"""Cosine of the angle between directions of orbits that follow each other, at least."""

QUICK, SLOW = 4, 7
"""Steps of Newton's method up to which ways become longer, and from which they become shorter."""

STRETCH = 1.5
"""Factor by which ways become longer."""

OFF_LINE = 1e-3
"""Distance of a branch from the straight lines between its orbits at most, in ranges of parameters and sizes."""

SHRINK = 0.3
"""Factor by which ways become shorter at most."""

HALVED, NEAR_EVENT = 0.5, 0.05
"""Change of a test from orbit to orbit, as a part of it, and of its scale up to which it does not matter."""

MOST = 50
"""Orbits of a branch at most, in those that make up the range of the parameter."""

LOCATED_IN = 60
"""Orbits that are looked for to locate an event at most."""

NEAR_ENOUGH = 20.0
"""Distance of orbits with other events from the last one, in ways between orbits, at most."""

PRECISE = 1e-13
"""Way between orbits, in ranges of the parameter, at which an event is located."""

NEARLY, COMPLEX = 1e-6, 1e-4
"""Distance of multipliers from where they are at an event; and their imaginary part that is more than rounding."""

CHANGED = 1e-10
"""Way between orbits at which a change of impacts is located, on a branch that goes on."""

BREAKS = "closing", "touch", "shortest"
"""Tests behind whose zeros there are other impacts."""

END = "the end of the range is reached at"
"""Why most branches end."""


class Member(NamedTuple):
    """An orbit of a branch, and what happens there, "" if nothing does."""

    orbit: Orbit
    event: str = ""
    test: str = ""


@dataclass(frozen=True)
class Metric:
    """Lengths of ways between orbits: parameters in their ranges, others in their sizes."""

    sizes: np.ndarray  # of the state
    period: float
    span: np.ndarray  # (parameter,) of ranges
    limits: np.ndarray  # (parameter, 2) of parameters, which may be nearer

    def factors(self, unknowns: np.ndarray) -> np.ndarray:
        """Return the factors of the squares of all components."""
        size, parameters = len(self.sizes), len(self.limits)
        result = np.empty(len(unknowns))
        result[:size] = 1.0 / (size * self.sizes**2)
        result[size:] = 1.0 / ((len(unknowns) - size - parameters) * self.period**2)
        result[len(unknowns) - parameters :] = self.span**-2.0
        return result

    def outside(self, unknowns: np.ndarray) -> tuple[int, float] | None:
        """Return the parameter that is farthest out of its range, counted from the last, and the end of this."""
        values = unknowns[-len(self.limits) :]
        low, high = self.limits.T
        beyond = np.maximum(values - high, low - values) / self.span
        worst = int(beyond.argmax())
        if beyond[worst] <= 0.0:
            return None
        return worst - len(values), float(high[worst] if values[worst] > high[worst] else low[worst])


@dataclass(eq=False)
class Branch:
    """The curve of orbits through one of them, towards both sides.

    Parameters
    ----------
    method : Corrector
    metric : Metric
    longest : float
        Longest way from orbit to orbit, in ranges of parameters.
    reasons : mapping
        Why limits of parameters are nearer than the ends of their ranges: by the place of the parameter, counted from
        the last, and the limit.
    show : callable
        Is called after each orbit.
    last : frozenset of str
        Events at which a side ends.
    """

    method: Corrector
    metric: Metric
    longest: float
    reasons: Mapping[tuple[int, float], str]
    show: Callable[[Orbit], None] = lambda orbit: None
    last: frozenset[str] = frozenset()
    found: int = field(default=0, init=False)
    apart: float = field(default=0.0, init=False)  # from straight lines between orbits
    fastest: float = field(default=0.0, init=False)  # test of closing
    sides: list[list[Member]] = field(default_factory=lambda: [[], []], init=False)

    def through(self, start: Orbit) -> tuple[str, str]:
        """Follow the branch through an orbit, and return why it ends on either side."""
        first = self._side(start, -1.0, self.sides[0])
        return first, "closed" if first == "closed" else self._side(start, 1.0, self.sides[1])

    def members(self, start: Orbit) -> list[Member]:
        """Return the orbits that were found, in the order of the branch."""
        first, second = self.sides
        return [*first[::-1], Member(start, "start"), *second]

    def _side(self, start: Orbit, way: float, members: list[Member]) -> str:
        """Find the orbits that follow one, on one side of it, and return why they end."""
        way = way if start.tangent[-1] >= 0.0 else -way
        now = self._oriented(start, way * start.tangent)
        begin, step, least = now, self.longest, SHORTEST_STEP * self.longest
        while True:
            if self.found > MOST / self.longest:
                return f"{self.found} orbits were found"
            ahead = self._ahead(now, step)
            if ahead is None or self._from_line(now, ahead) > OFF_LINE:
                step *= 0.5
                if step < least:
                    place = f"at {now.unknowns[-1]:.9g}"
                    return self.method.refusal or f"Newton's method finds no further orbit beyond that {place}"
                continue
            outside = self.metric.outside(ahead.unknowns)
            if outside:
                ahead = self._landed(now, ahead, *outside) or ahead
            events = self._events(now, ahead)
            members += events
            self.found += 1
            self.show(ahead)
            if any(item.event in self.last for item in events):
                return "the event is found"
            broken = next((item for item in events if item.test in BREAKS), None)
            if broken is not None:
                following = self._beyond(now, broken, ahead, step)
                if following is None:
                    return f"{broken.event} at {broken.orbit.unknowns[-1]:.9g}, beyond which none was found"
                now, step = following, 0.1 * step
                continue
            turned = self._turned(ahead)
            if outside:
                turned.unknowns[outside[0]] = outside[1]  # but for rounding
            members.append(Member(turned))
            if outside:
                return self.reasons.get(outside, f"{END} {outside[1]:.6g}")
            if self._is_closed(begin, now, ahead, len(members)):
                members.pop()
                return "closed"
            step = min(self.longest, step * self._factor(now, ahead))
            now = turned

    def _factor(self, now: Orbit, ahead: Orbit) -> float:
        """Return by how much the next way may be longer than that between two orbits.

        Tests that come near to 0 halve at most, so that no two events hide between orbits.
        """
        apart = self._from_line(now, ahead)
        self.apart = max(self.apart, apart)
        allowed = [STRETCH if ahead.steps <= QUICK else 1.0 if ahead.steps <= SLOW else 0.5]
        allowed.append(math.sqrt(0.5 * OFF_LINE / max(apart, 1e-300)))
        self.fastest = max(self.fastest, now.tests.closing if math.isfinite(now.tests.closing) else 0.0)
        scales = 1.0, 1.0, self.fastest, 1.0, self.metric.period
        for first, last, scale in zip(now.tests[1:], ahead.tests[1:], scales, strict=True):
            if abs(last) < abs(first) < math.inf and first * last > 0.0:
                allowed.append(HALVED * max(abs(last), NEAR_EVENT * scale) / abs(first - last))
        return max(min(allowed), SHRINK)

    def _from_line(self, now: Orbit, ahead: Orbit) -> float:
        """Return how far a branch is from a straight line between two orbits: an eighth of their way and its turn."""
        factors = self.metric.factors(now.unknowns)
        way, turn = ahead.unknowns - now.unknowns, ahead.tangent - now.tangent
        return 0.125 * math.sqrt(float(factors @ way**2) * float(factors @ turn**2))

    def _oriented(self, orbit: Orbit, tangent: np.ndarray) -> Orbit:
        length = math.sqrt(float(self.metric.factors(orbit.unknowns) @ tangent**2))
        tangent = tangent / length
        return replace(orbit, tangent=tangent, tests=orbit.tests._replace(fold=float(tangent[-1])))

    def _ahead(self, now: Orbit, step: float) -> Orbit | None:
        """Return the orbit some way ahead of one, or None if there is none or the branch bends too much."""
        factors = self.metric.factors(now.unknowns)
        guess, border = now.unknowns + step * now.tangent, factors * now.tangent
        found = self.method.correct(now.events, guess, guess, border)
        if found is None or found.steps > SLOW + 2:
            return None
        length = math.sqrt(float(factors @ found.tangent**2))
        tangent = found.tangent / length
        if not float(border @ tangent) >= BEND:
            return None
        tests = self.method.settled(found).tests  # of events within the period: outside of it some vanish twice
        return replace(found, tangent=tangent, tests=tests._replace(fold=float(tangent[-1])))

    def _turned(self, orbit: Orbit) -> Orbit:
        """Return an orbit with its events within a period, in its direction."""
        settled = self.method.settled(orbit)
        return settled if settled is orbit else self._oriented(settled, settled.tangent)

    def _beyond(self, last: Orbit, event: Member, wrong: Orbit, step: float) -> Orbit | None:
        """Return an orbit with other events where those of a branch end, in the direction away from the last one."""
        for other, ways in self.method.others(event.orbit, event.test, wrong):
            best, farthest = None, 0.0
            for way in ways:
                begin = self._oriented(other, way * other.tangent)
                ahead = next((item for part in (0.1, 0.01) if (item := self._ahead(begin, part * step))), None)
                if ahead is None or not _is_whole(ahead):
                    continue
                away = self._apart(ahead, last)
                if away > farthest and self._apart(begin, last) < NEAR_ENOUGH * step:
                    best, farthest = begin, away
            if best is not None:
                return best
        return None

    def _apart(self, one: Orbit, other: Orbit) -> float:
        """Return the distance of two orbits by their states and parameters, at the beginning of a period."""
        one, other = self.method.settled(one), self.method.settled(other)
        size, span = len(self.metric.sizes), self.metric.span
        states = (one.unknowns[:size] - other.unknowns[:size]) / self.metric.sizes
        values = one.unknowns[-len(span) :] - other.unknowns[-len(span) :]
        return math.sqrt(float((states**2).mean()) + float(((values / span) ** 2).sum()))

    def _landed(self, now: Orbit, ahead: Orbit, place: int, end: float) -> Orbit | None:
        """Return the orbit between two at which a parameter is at the end of its range."""
        share = (end - now.unknowns[place]) / (ahead.unknowns[place] - now.unknowns[place])
        guess = now.unknowns + share * (ahead.unknowns - now.unknowns)
        guess[place] = end
        border = np.zeros(len(guess))
        border[place] = 1.0
        found = self.method.correct(now.events, guess, guess, border)
        if found is None:
            return None
        way = 1.0 if float((self.metric.factors(now.unknowns) * now.tangent) @ found.tangent) >= 0.0 else -1.0
        return self._oriented(found, way * found.tangent)

    def _events(self, now: Orbit, ahead: Orbit) -> list[Member]:
        """Return the events between two orbits, in their order; those behind a change of impacts do not count."""
        factors = self.metric.factors(now.unknowns)
        apart = float((factors * now.tangent) @ (ahead.unknowns - now.unknowns))
        found = list[tuple[float, Member]]()
        for name in ahead.tests._fields:
            first, last = getattr(now.tests, name), getattr(ahead.tests, name)
            wrong = last > 0.0 if name == "touch" else last < 0.0
            if name in BREAKS:
                if not wrong:
                    continue
            elif not first * last < 0.0:
                continue
            located = self._located(now, apart, name, first, last)
            if located is None:
                continue
            way, orbit = located
            if not _is_event(name, orbit):
                continue
            found.append((way, Member(orbit, self.method.label(orbit, name), name)))
        if ahead.pattern != now.pattern:
            way, orbit = self._changed(now, apart)
            found.append((way, Member(orbit, "grazing", "pattern")))
        found.sort(key=lambda item: item[0])
        result = list[Member]()
        for _, member in found:
            if member.test in BREAKS:
                return [*result, member]
            result.append(member._replace(orbit=self._turned(member.orbit)))
        return result

    def _changed(self, now: Orbit, apart: float) -> tuple[float, Orbit]:
        """Return how far ahead impacts come or go, on a branch that goes on, and the last orbit as before."""
        low, high, orbit = 0.0, apart, now
        while high - low > CHANGED:
            middle = 0.5 * (low + high)
            found = self._ahead(now, middle)
            if found is None or found.pattern != now.pattern:
                high = middle
            else:
                low, orbit = middle, found
        return low, orbit

    def _located(self, now: Orbit, apart: float, name: str, first: float, last: float) -> tuple[float, Orbit] | None:
        """Return how far ahead a test vanishes, and the orbit there, by the method of the Illinois."""
        low, high, orbit = 0.0, apart, None
        if not (math.isfinite(first) and math.isfinite(last)) or first * last > 0.0:
            first = -last  # it was no test before
        kept = 0
        for _ in range(LOCATED_IN):
            middle = (low * last - high * first) / (last - first)
            if not low < middle < high or high - low < 1e-3 * apart * PRECISE:
                middle = 0.5 * (low + high)
            found = self._ahead(now, middle)
            if found is None:
                return None if orbit is None else (middle, orbit)
            orbit, value = found, getattr(found.tests, name)
            if value == 0.0 or high - low <= PRECISE:
                break
            if not math.isfinite(value):
                value = first
            if (value > 0.0) == (first > 0.0):
                low, first = middle, value
                last = 0.5 * last if kept == 1 else last
                kept = 1
            else:
                high, last = middle, value
                first = 0.5 * first if kept == -1 else first
                kept = -1
            if abs(value) < PRECISE * 1e-2:
                break
        assert orbit is not None
        return middle, orbit

    def _is_closed(self, begin: Orbit, now: Orbit, ahead: Orbit, count: int) -> bool:
        """Return whether a branch has come back to its beginning between two orbits."""
        if count < 4 or not all(map(np.array_equal, begin.events, ahead.events)):
            return False
        factors = self.metric.factors(now.unknowns)
        along = factors * now.tangent
        length = float(along @ (ahead.unknowns - now.unknowns))
        back = begin.unknowns - now.unknowns
        share = float(along @ back)
        aside = back - share * now.tangent
        near = math.sqrt(float(factors @ aside**2)) < 0.1 * abs(length)
        return bool(0.0 < share <= length and near and float(along @ begin.tangent) > BEND)


def _is_whole(orbit: Orbit) -> bool:
    """Return whether an orbit has its events and no others."""
    tests = orbit.tests
    return tests.closing > 0.0 and tests.touch < 0.0 and tests.shortest > 0.0


def _is_event(name: str, orbit: Orbit) -> bool:
    """Return whether multipliers are where a test of theirs vanishes, which it does not where it jumps."""
    if name not in ("flip", "torus"):
        return True
    if not np.isfinite(orbit.monodromy).all():
        return False
    multipliers = np.linalg.eigvals(orbit.monodromy)
    if name == "flip":
        return bool(np.abs(multipliers + 1.0).min() < NEARLY)
    pairs = np.abs(multipliers[:, None] * multipliers - 1.0)
    one = int(pairs.min(axis=1).argmin())
    return bool(pairs.min() < NEARLY and abs(multipliers[one].imag) > COMPLEX)
