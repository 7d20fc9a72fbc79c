"""Bugs in the records of linear forms: extremes, cycles, correlation functions."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import eigh_tridiagonal, expm

import impactlab as il
from impactlab.kernels import turning_points
from impactlab.records import correlation, cycles, extremes, wear
from impactlab.statistics import tails
from planted.detectors import Distances, Scene
from planted.plant import Bug, called, instead, returned

WINDOW, TIMES, LAGS = 10.0, (10.0, 100.0), (0.0, 0.25, 0.5)


def below(level: float, time: float, cells: int = 800) -> float:
    """Probability that a stationary Ornstein-Uhlenbeck process of unit rate and variance stays below a level."""
    width = (level + 6.0) / cells
    at = -6.0 + width * (np.arange(cells) + 0.5)
    weight, edge = np.exp(-0.5 * at**2), np.exp(-0.5 * (at + 0.5 * width) ** 2)
    lost = np.append(edge[:-1], 2.0 * edge[-1]) + np.append(0.0, edge[:-1])
    beside = edge[:-1] / np.sqrt(weight[1:] * weight[:-1]) / width**2
    values, vectors = eigh_tridiagonal(-lost / (weight * width**2), beside, select="v", select_range=(-6.0, 1.0))
    share = np.sqrt(weight) @ vectors
    return float((share**2 * np.exp(values * time)).sum() * width / np.sqrt(2.0 * np.pi))


class Forms(Scene):
    """The velocity of a body under noise and friction, and a spring under noise and a constant force."""

    name = "forms"

    def network(self) -> il.Network:
        bodies = {
            "particle": il.LinearOscillator(damping=1.0, stiffness=0.01),
            "spring": il.LinearOscillator(damping=0.4, stiffness=4.0),
        }
        push = il.Source(il.ConstantForce(3.0), on="spring")
        noise = {"particle": il.WhiteNoise(1.0 / np.pi), "spring": il.WhiteNoise(0.3), "push": push}
        return il.Network(bodies, excitations=noise)

    @cache  # noqa: B019
    def law(self) -> Any:
        grid = np.linspace(0.0, 6.0, 61)
        mean = 6.0 - np.trapezoid([below(level, WINDOW) for level in grid], grid)
        drift = np.array([[0.0, 1.0], [-4.0, -0.4]])
        covariance = np.pi * 0.3 / 0.4 * np.diag([0.25, 1.0])
        return mean, np.array([(expm(drift * lag) @ covariance).T for lag in LAGS])

    def evidence(self) -> Any:
        of = {"spring": "spring", "speed": ("velocity", "particle")}
        record = [
            il.Extremes(of, windows=(WINDOW,), return_times=TIMES),
            il.Cycles("spring"),
            il.Correlation(LAGS, ("spring", ("velocity", "spring"))),
            il.Trajectory(0.05),
        ]
        return il.simulate(self.network(), 100.0, realizations=512, step=0.05, record=record, rng=1)

    def distances(self, found: Any, law: Any) -> Distances:
        mean, covariance = law
        speed = found.sel(extreme_form="speed", extreme_kind="maximum", extreme_window=WINDOW)
        result = {"mean maximum": abs(float((speed.extreme_mean - mean) / speed.extreme_mean_standard_error))}
        for time in TIMES:
            level, error = (
                float(speed[f"extreme_return_level{end}"].sel(extreme_return_time=time))
                for end in ("", "_standard_error")
            )
            slope = (below(level + 0.02, WINDOW) - below(level - 0.02, WINDOW)) / 0.04
            off = abs(below(level, WINDOW) - math.exp(-WINDOW / time)) / slope
            result[f"return level of {time:g} s"] = off / math.hypot(error, 0.003)
            fit = float(speed.extreme_fitted_level.sel(extreme_return_time=time, extreme_tail="GEV"))
            result[f"fitted level of {time:g} s"] = abs(fit - level) / (3.0 * error + 0.03)
        count = math.sqrt(found.window_maximum[:, :, 1].size)
        spread = float(speed.extreme_mean_standard_error) * count / float(speed.extreme_deviation)
        result["error of the mean maximum"] = abs(math.log(spread)) / 0.1
        score = (found.correlation.values.transpose(2, 0, 1) - covariance) / found.correlation_standard_error.values.T
        result["covariances"] = float(np.abs(score).max())
        most, damage = self._of_paths(found)
        result["maxima of paths"] = 0.0 if np.allclose(found.window_maximum[:8, :, 0], most, rtol=1e-9) else math.inf
        exact = np.isclose(float(found.cycle_damage_rate[0]), damage, rtol=1e-9)
        result["damage of paths"] = 0.0 if exact else math.inf
        return result

    def _of_paths(self, found: Any) -> tuple[np.ndarray, float]:
        """Return the maxima in windows of the first realizations, and the rate of damage of all, from their paths."""
        times, most, damage = found.time.values, [], 0.0
        x, v = (found[name].sel(oscillator="spring").values for name in ("displacement", "velocity"))
        for row in range(len(x)):
            path = CubicHermiteSpline(times, x[row], v[row])
            at = np.sort(np.concatenate([times, path.derivative().roots(extrapolate=False)]))
            values = path(at)
            if row < 8:
                begins = np.arange(0.0, 100.0, WINDOW)
                most.append([values[(at >= begin) & (at <= begin + WINDOW)].max() for begin in begins])
            values = values[np.append(True, np.diff(values) != 0.0)]
            turns = values[np.append(True, np.append(np.diff(np.sign(np.diff(values))) != 0.0, True))]
            damage += sum(number * size**3 for size, number in rainflow(turns.tolist()))
        return np.array(most), damage / (100.0 * len(x))


def rainflow(turns: list[float]) -> list[tuple[float, float]]:
    """Ranges and numbers of cycles, by the wording of ASTM E1049."""
    points: list[float] = []
    found = []
    for value in turns:
        points.append(value)
        while len(points) >= 3 and abs(points[-1] - points[-2]) >= abs(points[-2] - points[-3]):
            found.append((abs(points[-2] - points[-3]), 0.5 if len(points) == 3 else 1.0))
            del points[-3 if len(points) == 3 else slice(-3, -1)]
    return found + [(abs(b - a), 0.5) for a, b in pairwise(points)]


class Rubbing(Scene):
    """A rotor that whirls in its stator and rubs all the time: the work rate of its path."""

    name = "rubbing"
    surface = 3.0

    def evidence(self) -> Any:
        rotor = il.LinearStructure([2.0, 2.0], damping=40.0 * np.eye(2), stiffness=200.0 * np.eye(2), names=("x", "y"))
        rub = il.RoundContact(
            ("rotor.x", "rotor.y"), il.WALL, il.KelvinVoigtContact(1e4, damping=20.0), clearance=0.001,
            friction_coefficient=0.1, surface_velocity=self.surface, friction_velocity=0.1,
        )  # fmt: skip
        push = {"rotor.x": il.Harmonic(40.0, frequency=20.0), "rotor.y": il.Harmonic(40.0, frequency=20.0, phase=1.0)}
        network = il.Network({"rotor": rotor}, {"rub": rub}, push)
        record = [il.Wear(), il.Trajectory(0.001)]
        return il.simulate(network, 1.0, step=0.001, spin_up=1.0, initial="rest", record=record)

    def distances(self, found: Any, law: Any) -> Distances:
        (x, y), (u, v) = (found[name][0].values.T[:, 1:] for name in ("displacement", "velocity"))
        sliding = (x * v - y * u) / np.hypot(x, y) + self.surface
        power = float((found.contact_force[0, 1:, 0].values * np.abs(sliding)).mean())
        right = np.isclose(float(found.contact_work_rate[0]), power, rtol=1e-9)
        return {"work rate of the path": 0.0 if right else math.inf}


FORMS, RUBBING = Forms(), Rubbing()
SCENES = [FORMS, RUBBING]


def at_steps(found: Any, *_: Any) -> Any:
    paths, jumps = found
    return [path._replace(kind=turning_points.BROWNIAN) for path in paths], jumps


def with_halved_slopes(found: Any, *_: Any) -> Any:
    paths, jumps = found
    return [path._replace(step=0.5 * path.step) for path in paths], jumps


def without_surface(record: il.Wear) -> il.Wear:
    object.__setattr__(record, "surface_velocities", (0.0,))  # a replaced record would lose its network
    return record


def without_rest(found: dict[str, np.ndarray], keeper: Any) -> dict[str, np.ndarray]:
    halves = np.zeros_like(found["damage"])
    for form, stack in enumerate(keeper.stacks):
        for lane, height in enumerate(keeper.heights[form]):
            ends, sizes = keeper.born[form][lane, 1:height], np.abs(np.diff(stack[lane, :height]))
            np.add.at(halves[lane, :, form], ends, 0.5 * sizes**keeper.exponent)
    return {**found, "damage": found["damage"] - halves}


def simple_ranges(
    places: Any, values: Any, points: Any, part: int, stack: Any, born: Any, heights: Any, damage: Any, *_: Any
) -> int:
    """Count half of each range from one turning point to the next."""
    for lane, value in zip(places[0, slice(*points)], values[slice(*points)], strict=True):
        damage[part, lane] += 0.5 * heights[lane] * abs(value - stack[lane, 0]) ** 3
        stack[lane, 0], heights[lane] = value, 1
    return int(points[1])


def without_means(keeper: dict[str, np.ndarray], _: Any) -> dict[str, np.ndarray]:
    return {**keeper, "befores": 0.0 * keeper["befores"], "afters": 0.0 * keeper["afters"]}


BUGS = [
    Bug("extremes at steps only", FORMS, returned(extremes, "paths_of", at_steps)),
    Bug("turning points with slopes of half the size", FORMS,
        returned(cycles, "paths_of", with_halved_slopes)),
    Bug("rough velocities as if they were smooth between steps", FORMS, instead(extremes, "RAISED", 0.0)),
    Bug("windows that are a tenth shorter", FORMS,
        called(extremes, "widen", lambda *given: (*given[:3], 9 * given[3] // 10, given[4]))),
    Bug("return levels of half the return time", FORMS,
        called(extremes, "level_with_error", lambda maxima, groups, part, trusted: (maxima, groups, part**2, trusted))),
    Bug("fitted levels of ten times the return time", FORMS,
        called(tails, "level_of", lambda law, periods: (law, 10.0 * periods))),
    Bug("errors of extremes without the number of groups", FORMS,
        returned(extremes, "without_each", lambda found, *_: (found[0], found[1] / 8.0))),
    Bug("rainflow without what is left", FORMS, returned(cycles._Stacks, "result", without_rest)),
    Bug("ranges from turn to turn for cycles", FORMS, instead(cycles, "count_cycles", simple_ranges)),
    Bug("lags that are one sample too long", FORMS,
        called(correlation, "add_products",
               lambda series, seen, ring, places, *others: (series, seen, ring, np.minimum(places + 1, 2), *others))),
    Bug("covariances around 0", FORMS, returned(correlation._Products, "result", without_means)),
    Bug("sliding without the velocity of the surface", RUBBING,
        called(wear, "_Works", lambda record, *others: (without_surface(record), *others))),
    Bug("work of closing where a contact slides", RUBBING,
        instead(wear, "_rubbing", lambda ends, x, v: [(item, False) for item in ends.rates(x, v)])),
    Bug("the other form first", FORMS,
        returned(correlation._Products, "result",
                 lambda found, _: {**found, "sums": found["sums"].swapaxes(-1, -2)})),
]  # fmt: skip
