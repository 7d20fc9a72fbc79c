"""Free collisions of a contact law: the restitution that it gives, and the law that gives a restitution."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from impactlab.components.evaluation import ELAPSED, TIME, UPDATE
from impactlab.errors import InvalidInput

_TOUCHING = sys.float_info.min


def restitution(law: Any, velocity: float, mass: float) -> float:
    """Return the velocity after a free collision of a mass with a law over that before, 0 if the bodies stay together.

    Laws whose states change with the time elapsed, not only with the place, are followed twice: the second time in
    small parts of the duration that is known then.
    """
    collision = _Collision(law, velocity, mass)
    result, duration = collision.run(math.inf)
    if law.state_names() and ELAPSED in law.arguments(UPDATE)[0]:
        # parts in each of which the path is taken as straight to find states that change in time
        result, _ = collision.run(duration / 1000)
    return result


def calibrated(law: Any, wanted: float, velocity: float, mass: float) -> Any:
    """Return the law with another value of its `restitution_field`, so that it has the restitution that is wanted."""
    name = law.restitution_field
    if not name:
        raise InvalidInput(f"{type(law).__name__} cannot be calibrated: it has no field that changes its restitution.")

    def of(value: float) -> float:
        return restitution(law.replace(**{name: value}), velocity, mass)

    root = brentq(lambda value: of(value) - wanted, *_bracket(law, name, of, wanted), xtol=1e-300, rtol=1e-12)
    return law.replace(**{name: float(root)})


def _bracket(law: Any, name: str, of: Callable[[float], float], wanted: float) -> tuple[float, float]:
    """Return two values of a field whose restitutions lie on either side of what is wanted."""
    start = getattr(law, name) or 1.0
    found = {start: of(start)}
    ends = {10.0: start, 0.1: start}
    # powers of ten up and down from the value of the field
    for _ in range(12):
        for factor, end in list(ends.items()):
            value = _nearest(law, name, end, factor * end)
            if value == end:
                del ends[factor]
                continue
            ends[factor], found[value] = value, of(value)
            if (found[value] - wanted) * (found[end] - wanted) <= 0.0:
                return end, value
    units = "" if law.units_of(name) == "1" else f" {law.units_of(name)}"
    raise InvalidInput(
        f"{law!r} cannot have the restitution {wanted:g}: for {name} from {min(found):.3g} to {max(found):.3g}{units} "
        f"it has from {min(found.values()):.4g} to {max(found.values()):.4g}."
    )


def _nearest(law: Any, name: str, allowed: float, value: float) -> float:
    """Return the value of a field, or the last one on the way to it that is allowed."""
    if _is_allowed(law, name, value):
        return value
    while (middle := 0.5 * (allowed + value)) not in (allowed, value):
        allowed, value = (middle, value) if _is_allowed(law, name, middle) else (allowed, middle)
    return allowed


def _is_allowed(law: Any, name: str, value: float) -> bool:
    try:
        law.replace(**{name: value})
    except InvalidInput:
        return False
    return True


class _Collision:
    """A mass that meets a law, in units in which it closes with the velocity 1 and comes to about the depth 1.

    The states of the law are those at the last accepted step; it is accepted when the mass turns back, too.
    """

    def __init__(self, law: Any, velocity: float, mass: float) -> None:
        self.law, self.velocity = law, velocity
        self.of_update = law.arguments(UPDATE) if law.state_names() else ((), ())
        self.of_force = law.arguments("force")
        self._begin()
        energy = mass * velocity * velocity
        if not sys.float_info.min <= energy < math.inf:
            raise InvalidInput(f"The energy of {mass:g} kg at {velocity:g} m s-1 is beyond the range of numbers.")
        self.length = self._length(energy)
        self.deceleration = self.length / energy

    def _begin(self) -> None:
        used = (*self.of_update[1], *self.of_force[1], *self.law.state_names())
        self.values = {name: getattr(self.law, name) for name in used}
        self.accepted = 0.0
        self.values.update(self._states(0.0, _TOUCHING, self.velocity))

    def _length(self, energy: float) -> float:
        """Return a power of two of about the depth at which the law has stopped the mass (m)."""
        for exponent in range(-200, 200):
            depth = 2.0**exponent
            if self._force(0.0, depth, self.velocity) * depth >= energy:
                return depth
        raise InvalidInput(f"{self.law!r} does not stop a mass that closes with {self.velocity:g} m s-1.")

    def _at(self, time: float, indentation: float, rate: float) -> dict[str, Any]:
        place = {"indentation": indentation, "rate": rate, ELAPSED: time - self.accepted, TIME: time}
        return {**self.values, **place}

    def _states(self, time: float, indentation: float, rate: float) -> dict[str, float]:
        names = self.law.state_names()
        if not names:
            return {}
        values, (kinematic, fields) = self._at(time, indentation, rate), self.of_update
        new = self.law.update(*(values[item] for item in (*kinematic, *fields)))
        return dict(zip(names, (new,) if len(names) == 1 else new, strict=True))

    def _force(self, time: float, indentation: float, rate: float) -> float:
        if indentation <= 0.0:
            return 0.0
        values = self._at(time, indentation, rate) | self._states(time, indentation, rate)
        kinematic, fields = self.of_force
        return float(self.law.force(*(values[item] for item in (*kinematic, *fields))))

    def _physical(self, now: float, motion: np.ndarray) -> tuple[float, float, float]:
        depth, speed = motion.tolist()
        return now * self.length / self.velocity, depth * self.length, speed * self.velocity

    def _rate(self, now: float, motion: np.ndarray) -> list[float]:
        return [float(motion[1]), -self.deceleration * self._force(*self._physical(now, motion))]

    def _accept(self, now: float, motion: np.ndarray) -> None:
        place = self._physical(now, motion)
        self.values.update(self._states(*place))
        self.accepted = place[0]

    def _solver(self, now: float, motion: np.ndarray, longest: float) -> DOP853:
        return DOP853(self._rate, now, motion, math.inf, max_step=longest, rtol=1e-11, atol=1e-13)

    def run(self, longest: float) -> tuple[float, float]:
        """Return the velocity with which the mass leaves, in units of that before, and how long it took."""
        self._begin()
        solver = self._solver(0.0, np.array([_TOUCHING / self.length, 1.0]), longest)
        # after so many steps bodies count as staying together
        for _ in range(3000 * (1 if longest == math.inf else 2)):
            before = solver.y
            solver.step()
            if solver.status == "failed":
                raise InvalidInput(f"The collision of {self.law!r} at {self.velocity:g} m s-1 cannot be followed.")
            turned = before[1] * solver.y[1] < 0.0
            # depth and speed, relative to the largest, below which bodies count as staying together
            if np.abs(solver.y).max() < 1e-9:
                break
            if turned:
                now, motion = _crossing(solver, 1)
                self._accept(now, motion)
                solver = self._solver(now, motion, longest)
            elif solver.y[0] <= 0.0:
                now, motion = _crossing(solver, 0)
                return -float(motion[1]), now
            else:
                self._accept(solver.t, solver.y)
        return 0.0, float(solver.t)


def _crossing(solver: DOP853, component: int) -> tuple[float, np.ndarray]:
    """Return when a component of the motion was 0 in the last step, and the motion then."""
    path = solver.dense_output()
    now = brentq(lambda now: path(now)[component], solver.t_old, solver.t, xtol=1e-300, rtol=1e-14)
    motion = path(now)
    motion[component] = 0.0
    return float(now), motion
