"""Bugs in dry friction that sticks, which its paths show: on a belt, of which the orbit is known, and under kicks."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar

import numpy as np

import impactlab as il
from impactlab.mechanisms.dry_friction.slip_and_stick import BREAKAWAY, HALF_KICK, INERTIA, SLIDING
from planted.detectors import Distances, Scene
from planted.plant import Bug, Plant, in_plan

EXACT = il.ExactFlow(measured=False)
SPRING, FRICTION, RATIO, BELT = 4.0, 1.0, 1.5, 0.2


class Sticking(Scene):
    """A body on a belt, and two on each other of which a spring pulls one: displacements against those that are known.

    A path that is off by its error at this step, or by rounding on the belt, is one standard error off.
    """

    name = "dry friction"
    step, duration = 0.05, 20.0
    errors: ClassVar = {"belt": 1e-10, "upper": 2e-4, "lower": 2e-4}

    def network(self) -> il.Network:
        free = il.LinearOscillator(mass=1.0, stiffness=SPRING)
        bodies = {"belt": free, "upper": free, "lower": free.replace(mass=2.0), "puller": free}
        rubs = il.CoulombFrictionCoupling(0.5, static_ratio=RATIO)
        couplings = {
            "on belt": il.Coupling("belt", il.WALL, rubs.replace(friction=FRICTION, velocity=BELT)),
            "on each other": il.Coupling("upper", "lower", rubs),
            "spring": il.Coupling("puller", "upper", il.LinearCoupling(2.0)),
        }
        return il.Network(bodies, {}, {"puller": il.Harmonic(3.0, frequency=1.3)}, couplings)

    def run(self, finer: int = 1) -> np.ndarray:
        """Return displacements, (time, body)."""
        start = dict.fromkeys(self.network().oscillators, 0.0)
        release = RATIO * FRICTION / SPRING
        initial = {"displacement": start | {"belt": release}, "velocity": start | {"belt": BELT}}
        record = il.Trajectory(self.step)
        result = il.simulate(
            self.network(), self.duration, step=self.step / finer, initial=initial, record=record, integrator=EXACT
        )
        return np.asarray(result.displacement.values[0])

    @cache  # noqa: B019
    def law(self) -> np.ndarray:
        """Return a path at a small step, and the closed orbit of the body on the belt."""
        path = self.run(32)
        frequency, middle = math.sqrt(SPRING), FRICTION / SPRING
        beyond = (RATIO - 1.0) * middle
        slip = 2.0 * (math.pi - math.atan2(beyond * frequency, BELT)) / frequency
        since = np.mod(self.step * np.arange(len(path)), slip + 2.0 * beyond / BELT)
        swing = beyond * np.cos(frequency * since) + BELT / frequency * np.sin(frequency * since)
        path[:, 0] = middle + np.where(since < slip, swing, BELT * (since - slip) - beyond)
        return path

    def evidence(self) -> np.ndarray:
        return self.run()

    def distances(self, found: Any, law: np.ndarray) -> Distances:
        off = np.abs(found - law).max(axis=0)
        return {name: float(off[number]) / error for number, (name, error) in enumerate(self.errors.items())}


STICKING = Sticking()
SCENES = [STICKING]


def numbers(change: Any) -> Plant:
    """Change what is known of links of dry friction."""

    def parts(plan: Any) -> tuple[Any, ...]:
        (part,) = plan.events.parts
        return (replace(part, links=change(part.links)),)

    return in_plan(events__parts=parts)


def with_row(table: np.ndarray, row: int, values: Any) -> np.ndarray:
    result = table.copy()
    result[row] = values
    return result


BUGS = [
    Bug("a breakaway force as small as that of sliding", STICKING,
        numbers(lambda links: links._replace(numbers=with_row(links.numbers, BREAKAWAY, links.numbers[SLIDING])))),
    Bug("slip with the velocities after whole kicks", STICKING,
        numbers(lambda links: links._replace(motion=with_row(links.motion, HALF_KICK, 0.0)))),
    Bug("bodies that stick with the inertia of one", STICKING,
        numbers(lambda links: links._replace(numbers=with_row(links.numbers, INERTIA, 1.0)))),
]  # fmt: skip
