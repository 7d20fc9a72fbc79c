"""Functions of time, reduced to steps: means and slopes of given forces, intensities and envelopes."""

from __future__ import annotations

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from impactlab.kernels.functions_of_time import sum_panels
from impactlab.linear.band_limited import PLACES as PANEL_PLACES
from impactlab.linear.band_limited import POINTS, panel_steps, panel_weights
from impactlab.linear.given_functions import NODES, PANELS, PLACES, joined, looked_at, mean_and_slope, motion_at
from impactlab.plan.driving import GivenMotion
from impactlab.plan.plan import Plan

TABLE = 100_000
"""Values of functions of time that are in memory at a time."""


class FunctionsInSteps(NamedTuple):
    """Functions of time of a network in steps, which are counted from the beginning of the spin-up."""

    plan: Plan
    module: ModuleType  # where they are compiled

    def given_forces(self, now: int, count: int) -> np.ndarray:
        """Return mean and slope of all given forces over some steps, in turn, (2 step, row)."""
        plan = self.plan
        steps_of = panel_steps(plan.driving.highest, plan.clock.step)
        if steps_of.all():
            both = np.empty((2 * count, plan.driving.given))
        else:
            mean, slope, _ = self.over_steps(self.module.forcing, now, count, plan.driving.given, plan.driving.sets)
            both = np.stack([mean, slope], axis=1).reshape(2 * count, -1)
        for steps in np.unique(steps_of[steps_of > 0]).tolist():
            rows = np.flatnonzero(steps_of == steps)
            both[:, rows] = self._in_panels(now, count, steps)[:, rows]
        for motion in plan.driving.motions:
            x, v = self.motion(motion, now, count)
            both[:, motion.force] = motion.pushes(x, v, plan.clock.step)
        return both

    def motion(self, motion: GivenMotion, now: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return displacement and velocity of a body of given motion after some steps and each of the next ones."""
        plan = self.plan
        times = (now + np.arange(count + 1) - plan.clock.spin_up_steps) * plan.clock.step

        def displacement(at: np.ndarray) -> np.ndarray:
            values = np.empty((at.size, plan.driving.given))
            self.module.forcing(at.ravel(), plan.forces.parameters, plan.forces.indices, values)
            return values[:, motion.force].reshape(at.shape)

        return motion_at(displacement, motion.displacement, times, plan.clock.step, begins=now == 0)

    def _in_panels(self, now: int, count: int, steps: int) -> np.ndarray:
        """Return the same from panels of several steps, which begin at multiples of their length."""
        plan, rows, weights = self.plan, self.plan.driving.given, panel_weights(steps)
        first, last = now // steps, -(-(now + count) // steps)
        most = max(1, TABLE // (POINTS * rows))
        parts = []
        for begin in range(first, last, most):
            panels = np.arange(begin, min(begin + most, last))
            times = ((panels[:, None] + PANEL_PLACES) * steps - plan.clock.spin_up_steps) * plan.clock.step
            values = np.empty((len(panels), POINTS, rows))
            self.module.forcing(times.ravel(), plan.forces.parameters, plan.forces.indices, values.reshape(-1, rows))
            sums = np.empty((rows, len(panels), 2 * steps))
            sum_panels(values, weights, sums)
            parts.append(sums.reshape(rows, -1))
        before = 2 * (now - first * steps)
        return np.concatenate(parts, axis=1).T[before : before + 2 * count]

    def over_steps(
        self, table: Any, begins: int, count: int, rows: int, sets: int = 1, per_step: int = 1
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return mean and slope of functions of time over some steps, (step, row), and the least value, (step,).

        Rows belong to one set after the other, and each set gets the same bits as alone. Steps may be divided into
        `per_step` equal parts; `begins` and `count` then count parts.
        """
        plan = self.plan
        mean, slope, least = *np.empty((2, sets, count, rows // sets)), np.empty(count)
        most = max(1, TABLE // (len(NODES) * rows))

        def seen(begin: np.ndarray, places: np.ndarray) -> np.ndarray:
            """Return values at some places from the beginnings of steps, (set, …, row, place)."""
            times = (begin[..., None] + places / per_step) * plan.clock.step
            values = np.empty((times.size, rows))
            table(times.ravel(), plan.forces.parameters, plan.forces.indices, values)
            each = np.moveaxis(values.reshape(*times.shape, sets, rows // sets), -2, 0)
            return np.ascontiguousarray(each).swapaxes(-1, -2)

        for begin in range(0, count, most):
            steps = np.arange(begin, min(begin + most, count))
            first = begins / per_step - plan.clock.spin_up_steps + steps / per_step
            values = seen(first, PLACES)
            mean[:, steps], slope[:, steps] = mean_and_slope(values[..., 1:-1])
            rough, inside = looked_at(values)
            least[steps] = inside.min(axis=(0, 2))  # without the ends: a function may end with the run
            again = np.asarray(rough.any(axis=-1))
            chosen = np.flatnonzero(again.any(axis=0))
            if chosen.size:
                values = seen(first[chosen, None] + np.arange(PANELS) / (PANELS * per_step), NODES / PANELS)
                least[steps[chosen]] = np.minimum(least[steps[chosen]], values.min(axis=(0, 2, 3, 4)))
                parts = joined(*(item.swapaxes(-1, -2) for item in mean_and_slope(values)))
                for result, part in zip((mean, slope), parts, strict=True):
                    result[:, steps[chosen]] = np.where(again[:, chosen, None], part, result[:, steps[chosen]])
        mean, slope = (np.moveaxis(item, 0, 1).reshape(count, rows) for item in (mean, slope))
        return mean, slope, least
