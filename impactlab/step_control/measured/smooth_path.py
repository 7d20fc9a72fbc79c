"""The smooth path that kicks approximate, and the transformations of states at any step to it and from it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impactlab.integrators.kicks import kick_share
from impactlab.plan.plan import Plan
from impactlab.quadrature import mean_rule

LITTLE = 0.01
"""Friction over a step, ``c h/m``, below which its effects are computed from series."""

SHORT = 0.125
"""Part of a step over which the rate of change of forces with states is found."""

_NODES, _WEIGHTS = mean_rule(4)


class Laws(NamedTuple):
    """What laws know of some states, beside places and velocities."""

    states: np.ndarray  # of the laws, (state, row, lane)
    times: np.ndarray  # (state,) since the beginning of the measurement (s)


class SmoothPath:
    """The path ``x + s a``, ``v − r a − h²a'/12`` of bodies whose kicks have the acceleration a at x.

    A constant force keeps a body at the velocity ``a/γ``, but at ``r a`` more half way through its kicks. Kicks by
    ``F(x + h²a/12)`` make s the mean of h²/12 and r/γ, which is h²/12 where there is little friction.

    Parameters
    ----------
    plan : Plan
    evaluate : callable
        Evaluates the forces in some states, as `impactlab.simulation.block.Block.evaluate` does.
    """

    def __init__(self, plan: Plan, evaluate: Callable[..., None]) -> None:
        self.evaluate, self.step, self.contacts = evaluate, plan.clock.step, len(plan.system.ends)
        self.mass, damping, _ = (item[:, None] for item in plan.system.linear)
        friction = damping * self.step / self.mass
        there = friction > LITTLE
        lag = np.where(there, 0.5 - kick_share(friction, LITTLE), friction / 12.0)
        ratio = np.where(there, lag / np.maximum(friction, LITTLE), 1.0 / 12.0)
        self.ahead, self.lag = 0.5 * self.step**2 * (1.0 / 12.0 + ratio), self.step * lag

    def at(self, x: np.ndarray, v: np.ndarray, force: np.ndarray, laws: Laws) -> tuple[np.ndarray, np.ndarray]:
        """Return the place and velocity on the path, from states after a kick of some force, (state, body, lane)."""
        v = v - 0.5 * self.step * force / self.mass
        a, change = self._acceleration(x, v, laws)
        return x + self.ahead * a, v - self.lag * a - self.step**2 / 12.0 * change

    def begin(self, x: np.ndarray, v: np.ndarray, laws: Laws) -> tuple[np.ndarray, np.ndarray]:
        """Return the states before the first kick for displacements and velocities on the path, (state, body, lane)."""
        a, change = self._acceleration(x, v, laws)
        return x - self.ahead * a, v + self.lag * a + self.step**2 / 12.0 * change

    def work(self, start: np.ndarray, end: np.ndarray, laws: Laws) -> np.ndarray:
        """Return the work that the forces of kicks do on bodies that go straight and slowly, (state, body, lane)."""
        way = end - start
        forces = (self._forces(start + node * way, laws) for node in _NODES)
        work: np.ndarray = way * sum(weight * force for weight, force in zip(_WEIGHTS, forces, strict=True))
        return work

    def _acceleration(self, x: np.ndarray, v: np.ndarray, laws: Laws) -> tuple[np.ndarray, np.ndarray]:
        """Return the acceleration ``a = F/m`` by the forces of kicks, and its rate of change.

        Laws with states can only be followed forwards in time.
        """
        if laws.states.shape[1]:
            time = SHORT * self.step
            here, soon, later = (self._forces(x + n * time * v, laws, n * time, v) for n in (0.0, 1.0, 2.0))
            return self._forces(x, laws) / self.mass, (4.0 * soon - 3.0 * here - later) / (2.0 * time * self.mass)
        time = 0.25 * self.step
        before, here, after = (self._forces(x + shift * time * v, laws, shift * time) for shift in (-1.0, 0.0, 1.0))
        return here / self.mass, (after - before) / (2.0 * time * self.mass)

    def _forces(self, x: np.ndarray, laws: Laws, elapsed: float = 0.0, v: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the forces of kicks on bodies, by default at rest, a time (s) after the laws had the given states."""
        states, bodies, lanes = x.shape
        place, speed, total = np.zeros((3, states, bodies + 1, lanes))
        place[:, :-1], speed[:, :-1] = x, v
        self.evaluate(place, speed, *np.zeros((2, states, self.contacts, lanes)), total, laws=laws, elapsed=elapsed)
        forces: np.ndarray = total[:, :-1]
        return forces
