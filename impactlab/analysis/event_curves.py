"""Curves on which an event of a branch stays, over two parameters: one more equation for one more unknown."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from impactlab.analysis.branches import Member
from impactlab.analysis.itineraries import brief_impact, touched, with_impact, without
from impactlab.analysis.orbit import EquationsOfOrbits, Orbit, Other, torus_of
from impactlab.errors import InvalidInput
from impactlab.kernels.contact_states import FRICTION
from impactlab.kernels.shooting import (
    IN_SEGMENT,
    NEWTON_STEPS,
    PASSES,
    TOUCH,
    TOUCHED_AT,
    Itinerary,
)

ENOUGH = 1e-8
"""Step after which what is left is rounding, as a part of the sizes of unknowns."""

SHIFT = 1e-6
"""Change of an unknown from which the derivative of the event's equation is found, as a part of its size."""

TOUCHES = 1e-9
"""Part of its size by which a gap may be above 0 where it touches."""


@dataclass(eq=False)
class EventCurve:
    """What finds the orbits of a curve on which an event stays; see `impactlab.analysis.orbit.Method`.

    Parameters
    ----------
    method : EquationsOfOrbits
        Finds orbits of the networks of two parameters.
    event : str
        "fold", "flip", "torus" or "grazing".
    start : Orbit
        At which it is.
    """

    method: EquationsOfOrbits
    event: str
    start: Orbit
    refusal: str = field(default="", init=False)

    @staticmethod
    def of(both: EquationsOfOrbits, member: Member, values: np.ndarray) -> EventCurve:
        """Return what finds the curve through an event of a branch, at values of two parameters."""
        orbit = member.orbit
        unknowns, events = orbit.unknowns, orbit.events
        if member.event == "grazing":
            events, unknowns = _passing(orbit, member.test, len(both.sizes))
        curve = EventCurve(both, member.event, orbit)
        curve.start = curve._first(events, np.concatenate([unknowns[:-1], values]))
        return curve

    def correct(self, events: Itinerary, guess: np.ndarray, base: np.ndarray, border: np.ndarray) -> Orbit | None:
        """Return the orbit near a guess for which ``border · (unknowns − base)`` is 0, or None if there is none."""
        unknowns, weights = (
            guess.copy(),
            self.method.weights(events, guess[len(self.method.sizes) + len(events.functionals)]),
        )
        for step in range(1, NEWTON_STEPS + 1):
            equations, left = self._equations(events, unknowns)
            equations = np.vstack([equations, border])
            try:
                change = np.linalg.solve(equations, np.append(left, border @ (unknowns - base)))
            except np.linalg.LinAlgError:
                return None
            unknowns = unknowns - change
            largest = float(np.abs(change / weights).max())
            if not largest < 1e2:
                return None
            if largest < ENOUGH:
                return self._taken(events, unknowns, equations, step)
        return None

    def settled(self, orbit: Orbit) -> Orbit:
        """Return an orbit with its events between the beginning and the end of a period."""
        turned = self.method.turned(orbit)
        return orbit if turned is None else self.correct(*turned) or orbit

    def others(self, at: Orbit, test: str, wrong: Orbit) -> Iterable[Other]:
        """Return no orbit: where impacts change, the curve ends."""
        return []

    def label(self, at: Orbit, test: str) -> str:
        """Return the name of what happens where a test vanishes."""
        return self.method.label(at, test)

    def _first(self, events: Itinerary, unknowns: np.ndarray) -> Orbit:
        """Return the first orbit, with the direction of the curve."""
        equations, _ = self._equations(events, unknowns)
        weights = self.method.weights(events, unknowns[len(self.method.sizes) + len(events.functionals)])
        direction = np.linalg.svd(equations * weights)[2][-1] * weights
        found = self.correct(events, unknowns, unknowns, direction / weights**2)
        if found is None:
            raise InvalidInput(
                f"The {self.event} cannot be followed: Newton's method does not converge at its beginning."
            )
        return found

    def _equations(self, events: Itinerary, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the equations, (equation, unknown), and what is left of them."""
        weights = self.method.weights(events, unknowns[len(self.method.sizes) + len(events.functionals)])
        orbit, left, derivatives = self.method.evaluate(events, unknowns)
        borders = self._borders(derivatives)
        value, slopes = self._value(events, orbit, derivatives, borders), np.empty(len(unknowns))
        for place, shift in enumerate(SHIFT * weights):
            moved = unknowns.copy()
            moved[place] += shift
            other, _, slanted = self.method.evaluate(events, moved)
            slopes[place] = (self._value(events, other, slanted, borders) - value) / (moved[place] - unknowns[place])
        return np.vstack([derivatives, slopes]), np.append(left, value)

    def _borders(self, derivatives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a column and a row beside the equations at fixed parameters, which are singular at a fold."""
        if self.event != "fold":
            return np.zeros(0), np.zeros(0)
        left, _, right = np.linalg.svd(derivatives[:, : len(derivatives)])
        return left[:, -1], right[-1]

    def _value(
        self, events: Itinerary, orbit: Orbit, derivatives: np.ndarray, borders: tuple[np.ndarray, np.ndarray]
    ) -> float:
        """Return what vanishes at the event."""
        if self.event == "flip":
            return float(orbit.tests.flip)
        if self.event == "torus":
            return torus_of(orbit.monodromy)
        if self.event == "grazing":
            return float(orbit.rates[int(np.argmax(events.strikes == PASSES))])
        count = len(derivatives)
        whole = np.zeros((count + 1, count + 1))
        whole[:count, :count], whole[:count, count], whole[count, :count] = derivatives[:, :count], *borders
        return float(np.linalg.solve(whole, np.eye(count + 1)[count])[count])

    def _taken(self, events: Itinerary, unknowns: np.ndarray, equations: np.ndarray, steps: int) -> Orbit:
        """Return an orbit with the direction of the curve, and tests of what is not followed."""
        orbit, _, _ = self.method.evaluate(events, unknowns)
        tangent = np.linalg.solve(equations, np.eye(len(unknowns))[-1])
        tests = orbit.tests._replace(fold=np.nan, flip=np.nan, torus=np.nan)
        if self.event == "grazing":
            passing = int(np.argmax(events.strikes == PASSES))
            others = np.delete(orbit.rates, passing)
            tests = tests._replace(closing=float(others.min(initial=np.inf)))
            if abs(orbit.details[TOUCH]) < TOUCHES and orbit.details[IN_SEGMENT] in (passing, passing + 1):
                tests = tests._replace(touch=-np.inf)
        return replace(orbit, tangent=tangent, tests=tests, steps=steps)


def _passing(orbit: Orbit, test: str, size: int) -> tuple[Itinerary, np.ndarray]:
    """Return the itinerary of a grazing orbit in which the contact that touches passes, and its unknowns."""
    events, unknowns = orbit.events, orbit.unknowns
    assert isinstance(events, Itinerary)
    group = brief_impact(orbit, test, size)
    if group is not None:
        segment, functional = group[0], int(events.functionals[group[0]])
        when = float(unknowns[size + group[0]])
        events = without(events, *group)
        unknowns = np.delete(unknowns, size + np.arange(group[0], group[1] + 1))
    elif test == "touch":
        (segment, functional), when = touched(orbit), float(orbit.details[TOUCHED_AT])
    if (test != "touch" and group is None) or events.kinds[functional // 2] >= FRICTION:
        raise InvalidInput("This grazing, of a rest or of dry friction, cannot be followed over two parameters.")
    events, _ = with_impact(events, segment, functional, passing=True)
    return events, np.insert(unknowns, size + segment, when)
