"""Bugs in first passages, of a body whose mean times and survival are known from the Fokker–Planck equation."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

import impactlab as il
from impactlab.kernels.bridges import AT_STEPS, OF_DISPLACEMENT, OF_VELOCITY, VARIANCE
from impactlab.records import first_passage, passage_limits
from impactlab.statistics import survival
from planted.detectors import Distances, Scene
from planted.plant import Bug, both, instead, returned

REALIZATIONS, HORIZON = 100_000, 60.0
"""Of the run, some of which survive."""

LEVEL, STEP = 1.5, 1.0
"""Limit of a body of unit deviation and frequency (m), and the step (s)."""


class Leaving(Scene):
    """A linear body that leaves an interval from rest, and a free body whose velocity does."""

    name = "first passage"

    @cache  # noqa: B019  # scenes are few
    def law(self) -> Any:
        """Survival of the displacement, and of the velocity of a free body: Brownian motion between two limits."""
        times = np.linspace(0.0, HORIZON, 1201)
        of_body = il.fokker_planck(_network(0.2), absorb={"a": LEVEL}, tolerance=1e-3).survival(times)
        odd = np.arange(1, 400, 2)
        signs, rates = np.where(odd % 4 == 1, 4.0, -4.0) / (math.pi * odd), (math.pi * odd) ** 2 / 8.0
        brownian = (signs * np.exp(-rates * 0.05 * times[:, None])).sum(axis=1)
        return {"displacement": of_body, "velocity": brownian}

    def evidence(self) -> Any:
        options = {"duration": HORIZON, "realizations": REALIZATIONS, "initial": "rest", "step": STEP, "rng": 3}
        record = il.FirstPassage({"a": LEVEL}, intervals=12)
        free = il.FirstPassage({"a": ("velocity", 1.0)}, intervals=12)
        slow = il.Network({"a": il.LinearOscillator(mass=1.0)}, {}, {"a": il.WhiteNoise(0.05 / (2.0 * math.pi))})
        return {
            "displacement": il.simulate(_network(0.2), record=record, **options),
            "velocity": il.simulate(slow, record=free, **options),
        }

    def distances(self, found: Any, law: Any) -> Distances:
        result = {}
        for name, data in found.items():
            expected, mean = law[name][100::100], np.trapezoid(law[name], dx=HORIZON / 1200)
            error = np.sqrt(np.maximum(expected * (1.0 - expected), 1e-6) / REALIZATIONS)
            result[f"survival of {name}"] = float(np.abs((data.survival.values[1:] - expected) / error).max())
            scatter = data.passage_time.fillna(HORIZON).values.std() / math.sqrt(REALIZATIONS)
            value, claimed = data.restricted_mean_passage_time, data.restricted_mean_passage_time_standard_error
            result[f"mean of {name}"] = abs(value.item() - mean) / scatter
            result[f"error of {name}"] = 0.0 if abs(claimed.item() / scatter - 1.0) < 0.01 else math.inf
        return result


def _network(damping: float) -> Any:
    body = il.LinearOscillator(mass=1.0, damping=damping, stiffness=1.0)
    return il.Network({"a": body}, {}, {"a": il.WhiteNoise(damping / math.pi)})


def levels(displacement: int, velocity: int) -> Any:
    return instead(passage_limits, "LEVELS", {OF_DISPLACEMENT: displacement, OF_VELOCITY: velocity, AT_STEPS: 0})


def without_brownian_motion(table: np.ndarray, *arguments: Any) -> np.ndarray:
    table[:, VARIANCE] = 0.0
    return table


LEAVING = Leaving()

BUGS = [
    Bug("displacements between steps as cubics", LEAVING, levels(0, 8)),
    Bug("velocities at steps only", LEAVING,
        both(levels(6, 0), returned(passage_limits, "bridges", without_brownian_motion))),
    Bug("bridges of a quarter of the noise", LEAVING,
        returned(passage_limits.NoiseOnLimits, "of", lambda noise, *_: noise._replace(density=0.25 * noise.density))),
    Bug("times of passage at the ends of steps", LEAVING,
        returned(first_passage.Passages, "result", lambda found, *_: {**found, "times": np.ceil(found["times"])})),
    Bug("restricted mean without survivors", LEAVING,
        instead(survival.Survival, "restricted_mean",
                lambda self: survival.Survival(self.times[~np.isnan(self.times)], self.horizon).mean())),
    Bug("survivors that have passed at the horizon", LEAVING,
        returned(first_passage.Passages, "result",
                 lambda found, *_: {
                     "times": np.nan_to_num(found["times"], nan=0.5 * HORIZON), "causes": 0 * found["causes"],
                 })),
]  # fmt: skip

SCENES = [LEAVING]
