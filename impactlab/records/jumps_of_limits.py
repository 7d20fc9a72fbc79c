"""Changes of velocities at once, by impacts and impulses within steps, of what limits are of."""

from __future__ import annotations

import numpy as np

from impactlab.plan.plan import Plan
from impactlab.plan.processes import ProcessPart
from impactlab.results.snapshot import BY_IMPACTS

TINY = 1e-9
"""Part of the sizes of several changes in a step up to which their sum has no time of its own."""


class JumpsOfLimits:
    """Changes of velocities in steps, each with its time; several in one step are one, at the mean of their times.

    Parameters
    ----------
    weights : (limit, body) ndarray
        Weights of velocities in what each limit is of; limits of forces have none.
    plan : Plan
    """

    def __init__(self, weights: np.ndarray, plan: Plan) -> None:
        self.plan, self.step, self.weights, mass = plan, plan.clock.step, weights, plan.system.linear[0]
        ends = plan.system.ends.chosen(plan.events.impulsive)
        slots, along, rows = ends.moving()
        self.of_impulse = np.zeros((len(weights), len(plan.events.impulsive)))
        np.add.at(self.of_impulse.T, rows, (-along / mass[slots] * weights[:, slots]).T)
        told = plan.snapshot.place(BY_IMPACTS.name)
        self.moments = np.arange(told.start, told.stop)[plan.events.moments] if plan.snapshot.told else None
        parts = plan.driving.processes.parts
        self.processes = [part for part in parts if len(part.pushes) and (self.weights @ part.pushes.T).any()]

    def __call__(self, snapshots: np.ndarray, first: int, realizations: np.ndarray) -> np.ndarray:
        """Return changes in the steps to some snapshots, and their times in the steps (s), (2, step, limit, lane)."""
        number, limits = len(snapshots), len(self.weights)
        hit = self.moments is not None and bool(self.of_impulse.any())
        if not hit and not self.processes:
            return np.zeros((2, 0, limits, len(realizations)))
        found = np.zeros((2, number, limits, len(realizations)))
        sizes = np.zeros_like(found[0])
        if hit:
            impulses = snapshots[:, self.plan.snapshot.impulsive_rows] * self.step
            found[0] += self.of_impulse @ impulses
            found[1] += self.of_impulse @ snapshots[:, self.moments]
            sizes = sizes + np.abs(self.of_impulse) @ np.abs(impulses)
        for part in self.processes:
            change, left = self._of_process(part, first + self.plan.clock.spin_up_steps, number, realizations)
            found[0] += self.weights @ change
            found[1] += self.weights @ left * self.step
            sizes = sizes + np.abs(self.weights) @ np.abs(change)
        single = np.abs(found[0]) > TINY * sizes
        found[0] = np.where(single, found[0], 0.0)
        left = np.divide(found[1], found[0], out=np.zeros_like(found[1]), where=single)
        found[1] = self.step - np.clip(left, 0.0, self.step)
        return found

    def _of_process(
        self, part: ProcessPart, first: int, number: int, realizations: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return changes by a process in some steps, and these times the part of the step that is left then."""
        per_step = self.plan.method.integrator.samples_per_step
        change, left = part.jumps(realizations, per_step * first, per_step * number)
        after = (per_step - 1.0 - np.arange(len(change)) % per_step)[:, None, None]
        steps = number, per_step, *change.shape[1:]
        return change.reshape(steps).sum(axis=1), (left + after * change).reshape(steps).sum(axis=1) / per_step
