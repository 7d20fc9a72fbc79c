"""Curves on which an event of a branch stays, over two parameters: one more equation for one more unknown."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from impactlab.analysis.branches import Member
from impactlab.analysis.newton import solved
from impactlab.analysis.orbit import EquationsOfOrbits, Orbit, Other, torus_of
from impactlab.errors import InvalidInput

ENOUGH, ENOUGH_BY_OTHERS = 1e-8, 1e-11
"""Steps after which what is left is rounding, as a part of the sizes of unknowns: by derivatives at the place itself,
and by those of an orbit before.
"""


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
    _last: np.ndarray | None = field(default=None, init=False)  # derivatives at the last orbit

    @staticmethod
    def of(both: EquationsOfOrbits, member: Member, values: np.ndarray) -> EventCurve:
        """Return what finds the curve through an event of a branch, at values of two parameters."""
        events, unknowns = member.orbit.events, member.orbit.unknowns
        if member.event == "grazing":
            events, unknowns = both.passing(member.orbit, member.test)
        curve = EventCurve(both, member.event, member.orbit)
        curve.start = curve._first(events, np.concatenate([unknowns[:-1], values]))
        return curve

    def correct(self, events: Any, guess: np.ndarray, base: np.ndarray, border: np.ndarray) -> Orbit | None:
        """Return the orbit near a guess for which ``border · (unknowns − base)`` is 0, or None if there is none."""

        def evaluate(unknowns: np.ndarray, slopes: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
            if slopes is not None:
                return self._left(events, unknowns), slopes
            _, slopes, left = self._equations(events, unknowns)
            return left, slopes

        def enough(slopes: np.ndarray, own: bool) -> float:
            return ENOUGH if own else ENOUGH_BY_OTHERS

        known = self._last if self._last is not None and self._last.shape[1] == len(guess) else None
        sizes, self.refusal = self._weights(events, guess), ""
        try:
            found = solved(evaluate, enough, guess, base, border, sizes, known)
        except (InvalidInput, np.linalg.LinAlgError) as error:
            self.refusal = str(error)
            return None
        return None if found is None else self._taken(events, found[0], border, found[1])

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

    def _first(self, events: Any, unknowns: np.ndarray) -> Orbit:
        """Return the first orbit, with the direction of the curve."""
        weights = self._weights(events, unknowns)
        _, equations, _ = self._equations(events, unknowns)
        direction = np.linalg.svd(equations * weights)[2][-1] * weights
        found = self.correct(events, unknowns, unknowns, direction / weights**2)
        if found is None:
            raise InvalidInput(
                f"The {self.event} cannot be followed: Newton's method does not converge at its beginning. "
                f"{self.refusal}".strip()
            )
        return found

    def _weights(self, events: Any, unknowns: np.ndarray) -> np.ndarray:
        """Return the sizes of all unknowns."""
        return self.method.weights(events, float(unknowns[-1 - self.method.parameters]))

    def _left(self, events: Any, unknowns: np.ndarray) -> np.ndarray:
        """Return what is left of the equations."""
        ((orbit, left, derivatives),) = self.method.beside(events, unknowns[None])
        return np.append(left, self._value(orbit, derivatives, self._borders(derivatives)))

    def _equations(self, events: Any, unknowns: np.ndarray) -> tuple[Orbit, np.ndarray, np.ndarray]:
        """Return the orbit, the derivatives of the equations, (equation, unknown), and what is left of them."""
        orbit, left, derivatives = self.method.evaluate(events, unknowns)
        borders = self._borders(derivatives)
        value = self._value(orbit, derivatives, borders)
        shifts = self.method.shift * self._weights(events, unknowns)
        others = self.method.beside(events, unknowns + np.diag(shifts))
        values = [self._value(other, slanted, borders) for other, _, slanted in others]
        return orbit, np.vstack([derivatives, (np.array(values) - value) / shifts]), np.append(left, value)

    def _borders(self, derivatives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a column and a row beside the equations at fixed parameters, which are singular at a fold."""
        if self.event != "fold":
            return np.zeros(0), np.zeros(0)
        left, _, right = np.linalg.svd(derivatives[:, : len(derivatives)])
        return left[:, -1], right[-1]

    def _value(self, orbit: Orbit, derivatives: np.ndarray, borders: tuple[np.ndarray, np.ndarray]) -> float:
        """Return what vanishes at the event."""
        if self.event == "flip":
            return float(orbit.tests.flip)
        if self.event == "torus":
            return torus_of(orbit.monodromy)
        if self.event == "grazing":
            return self.method.grazing(orbit)[0]
        count = len(derivatives)
        whole = np.zeros((count + 1, count + 1))
        whole[:count, :count], whole[:count, count], whole[count, :count] = derivatives[:, :count], *borders
        return float(np.linalg.solve(whole, np.eye(count + 1)[count])[count])

    def _taken(self, events: Any, unknowns: np.ndarray, border: np.ndarray, steps: int) -> Orbit | None:
        """Return an orbit with the direction of the curve, and tests of what is not followed."""
        try:
            orbit, self._last, _ = self._equations(events, unknowns)
            tangent = np.linalg.solve(np.vstack([self._last, border]), np.eye(len(unknowns))[-1])
        except (InvalidInput, np.linalg.LinAlgError) as error:
            self.refusal = str(error)
            return None
        tests = self.method.grazing(orbit)[1] if self.event == "grazing" else orbit.tests
        tests = tests._replace(fold=np.nan, flip=np.nan, torus=np.nan)
        return replace(orbit, tangent=tangent, tests=tests, steps=steps)
