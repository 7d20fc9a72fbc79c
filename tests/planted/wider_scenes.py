"""Scenes beyond white noise and smooth conservative contacts, each of a law that is known without the code.

All run at the automatic step. Where nothing is random a relative difference of `SMALL` counts as a standard error.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import scipy.integrate
import scipy.linalg
from impactlab_numerics.laws.excitations import GustNoise

import impactlab as il
from planted.detectors import Distances, Scene, of_statistics

SMALL = 1e-3
"""Relative difference that counts as a standard error where nothing is random."""

STATES = ("mean_displacement", "mean_square_displacement", "mean_velocity", "mean_square_velocity")


def of_facts(found: Any, law: dict[str, float]) -> Distances:
    """Distances of what is not random: means are measured by root mean squares."""
    result = {}
    for name, value in law.items():
        scale = abs(value)
        if name in ("mean_displacement", "mean_velocity"):
            scale = math.sqrt(law[name.replace("mean", "mean_square")])
        result[name] = abs(found[name].item() - value) / (SMALL * scale)
    return result


def of_path(solution: Any, duration: float) -> dict[str, float]:
    """Means over [0, duration] of a solution of x and v."""
    times = np.linspace(0.0, duration, 200_001)
    x, v = solution(times)
    values = dict(zip(STATES, (x, x * x, v, v * v), strict=True))
    return {name: float(scipy.integrate.simpson(value, x=times) / duration) for name, value in values.items()}


class Dashpot(Scene):
    """A body that is pressed on a spring and a strong dashpot and never leaves them: linear, damping ratio 2."""

    name = "strong dashpot"

    def law(self) -> Any:
        mass, damping, stiffness = 2.0, 1.0 + 50.0, 40.0 + 60.0
        return {
            "variance_displacement": math.pi / (damping * stiffness),
            "mean_square_velocity": math.pi / damping / mass,
        }

    def evidence(self) -> Any:
        body = il.LinearOscillator(mass=2.0, damping=1.0, stiffness=40.0)
        contact = il.Contact("a", il.WALL, il.KelvinVoigtContact(60.0, damping=50.0, tension=True), clearance=-8.0)
        network = il.Network({"a": body}, {"wall": contact}, {"a": il.WhiteNoise(1.0)})
        return il.simulate(network, 40.0, realizations=1024, rng=1, integrator=il.ExactFlow())

    def distances(self, found: Any, law: Any) -> Distances:
        result = {"contact_ratio": 0.0 if found.contact_ratio.item() == 1.0 else math.inf}
        for name, value in law.items():
            result[name] = abs(found[name].item() - value) / found[f"{name}_standard_error"].item()
        return result


class Clamp(Scene):
    """A ball that falls on a spring and a dashpot that never pull, once; between them it flies freely."""

    name = "clamped dashpot"
    mass, stiffness, damping, gap, speed, duration = 1.0, 400.0, 24.0, 1.0, 1.0, 3.0

    def law(self) -> Any:
        def motion(_: float, state: np.ndarray) -> list[float]:
            x, v = state
            force = max(self.stiffness * (x - self.gap) + self.damping * v, 0.0) if x > self.gap else 0.0
            return [v, -force / self.mass]

        found = scipy.integrate.solve_ivp(
            motion, (0.0, self.duration), [0.0, self.speed], rtol=1e-10, atol=1e-12, max_step=1e-3, dense_output=True
        )
        return of_path(found.sol, self.duration)

    def evidence(self) -> Any:
        law = il.KelvinVoigtContact(self.stiffness, damping=self.damping)
        network = il.Network({"a": il.LinearOscillator(mass=self.mass)},
                             {"wall": il.Contact("a", il.WALL, law, clearance=self.gap)})  # fmt: skip
        return il.simulate(
            network, self.duration, initial={"velocity": {"a": self.speed}}, rng=1, integrator=il.ExactFlow()
        )

    def distances(self, found: Any, law: Any) -> Distances:
        return of_facts(found, law)


class Forced(Scene):
    """A linear body from rest under a given force, slower or faster than itself."""

    def __init__(self, name: str, frequency: float, duration: float) -> None:
        self.name, self.frequency, self.duration = name, frequency, duration

    def law(self) -> Any:
        def motion(time: float, state: np.ndarray) -> list[float]:
            x, v = state
            return [v, math.sin(self.frequency * time) - 0.2 * v - x]

        found = scipy.integrate.solve_ivp(
            motion, (0.0, self.duration), [0.0, 0.0], method="DOP853", rtol=1e-10, atol=1e-12,
            max_step=0.5 / self.frequency, dense_output=True,
        )  # fmt: skip
        return of_path(found.sol, self.duration)

    def evidence(self) -> Any:
        body = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
        network = il.Network({"a": body}, None, {"a": il.Harmonic(1.0, frequency=self.frequency)})
        return il.simulate(network, self.duration, initial={}, rng=1, integrator=il.ExactFlow())

    def distances(self, found: Any, law: Any) -> Distances:
        return of_facts(found, law)


class Decay(Scene):
    """A linear body that is let go: means over the time from the start to the end."""

    name = "decay"
    start, duration = np.array([2.0, -1.0]), 7.0

    def law(self) -> Any:
        drift = np.array([[0.0, 1.0], [-1.0, -0.2]])
        values, vectors = np.linalg.eig(drift)
        weights = np.linalg.solve(vectors, self.start.astype(complex))

        def solution(times: np.ndarray) -> np.ndarray:
            return np.asarray(((vectors * weights) @ np.exp(np.outer(values, times))).real)

        return of_path(solution, self.duration)

    def evidence(self) -> Any:
        body = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
        initial = {"displacement": {"a": self.start[0]}, "velocity": {"a": self.start[1]}}
        return il.simulate(il.Network({"a": body}), self.duration, initial=initial, rng=1, integrator=il.ExactFlow())

    def distances(self, found: Any, law: Any) -> Distances:
        return of_facts(found, law)


class Gusty(Scene):
    """A linear body from rest in a short gust: second moments by their differential equations."""

    name = "gust"
    middle, width, duration = 3.037, 0.02, 12.0

    def law(self) -> Any:
        def moments(time: float, state: np.ndarray) -> list[float]:
            xx, xv, vv = state
            heat = 2.0 * math.pi * math.exp(-(((time - self.middle) / self.width) ** 2))
            return [2.0 * xv, vv - xx - 0.2 * xv, heat - 2.0 * xv - 0.4 * vv]

        found = scipy.integrate.solve_ivp(
            moments, (0.0, self.duration), [0.0] * 3, rtol=1e-9, atol=1e-12, max_step=0.004, dense_output=True
        )
        times = np.linspace(0.0, self.duration, 20_001)
        xx, _, vv = scipy.integrate.simpson(found.sol(times), x=times) / self.duration
        return {"mean_square_displacement": xx, "mean_square_velocity": vv}

    def evidence(self) -> Any:
        body = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
        network = il.Network({"a": body}, None, {"a": GustNoise(0.0, peak=1.0, middle=self.middle, width=self.width)})
        return il.simulate(network, self.duration, initial={}, realizations=4096, rng=1, integrator=il.ExactFlow())

    def distances(self, found: Any, law: Any) -> Distances:
        return {
            name: abs(found[name].item() - value) / found[f"{name}_standard_error"].item()
            for name, value in law.items()
        }  # fmt: skip


class Loaded(Scene):
    """A body that a Hertz contact holds away from its spring, and a second wall on the other side."""

    name = "static load"

    def network(self) -> il.Network:
        body = il.LinearOscillator.from_frequency(2.0 * math.pi, 0.05)
        contacts = {
            "near": il.Contact("a", il.WALL, il.HertzContact(400.0), clearance=-6.0),
            "far": il.Contact(il.WALL, "a", il.HertzContact(100.0), clearance=5.2),
        }
        return il.Network({"a": body}, contacts, {"a": il.WhiteNoise(0.5)})

    @cache  # noqa: B019
    def law(self) -> Any:
        return il.exact(self.network()).statistics()

    def evidence(self) -> Any:
        return il.simulate(self.network(), 100.0, realizations=512, rng=1, integrator=il.ExactFlow())

    def distances(self, found: Any, law: Any) -> Distances:
        """Distances of all but the mean force and what follows from it: steps move these by 10⁻⁴, which is seen."""
        exact = ("mean_displacement", "mean_square_displacement", "mean_contact_force")
        distances = of_statistics(found, law)  # the near contact never opens
        return {name: z for name, z in distances.items() if not name.startswith(exact) and "[near]" not in name}


class Seldom(Scene):
    """Many runs in which a contact closes once or never: their intervals must hold the exact mean."""

    name = "rare contact"
    runs = 40

    def network(self) -> il.Network:
        body = il.LinearOscillator(mass=1.0, damping=0.4, stiffness=1.0)
        contact = il.Contact("a", il.WALL, il.HertzContact(1e3), clearance=3.6)
        return il.Network({"a": body}, {"wall": contact}, {"a": il.WhiteNoise(0.4 / math.pi)})

    @cache  # noqa: B019
    def law(self) -> Any:
        return il.exact(self.network()).statistics()

    def evidence(self) -> Any:
        return [il.simulate(self.network(), 50.0, realizations=64, rng=[3, run]) for run in range(self.runs)]

    def distances(self, found: Any, law: Any) -> Distances:
        """Missing intervals beyond the 5 % of them that may miss, in standard errors of their number."""
        result = {}
        for name in ("mean_displacement", "mean_square_displacement"):
            error = np.array([item[f"{name}_standard_error"].item() for item in found])
            off = np.abs(np.array([item[name].item() for item in found]) - law[name].item())
            missed = float(np.count_nonzero(off > 2.0 * error))  # a NaN says that nothing is known
            expected = 0.05 * self.runs
            result[name] = max(missed - expected, 0.0) / math.sqrt(0.95 * expected)
        return result


DASHPOT, CLAMP, DECAY, GUST, LOADED, SELDOM = Dashpot(), Clamp(), Decay(), Gusty(), Loaded(), Seldom()
RESONANCE, FAST = Forced("resonance", 1.0, 60.0), Forced("fast force", 6.0, 40.0)

SCENES = [DASHPOT, CLAMP, RESONANCE, FAST, DECAY, GUST, LOADED, SELDOM]
