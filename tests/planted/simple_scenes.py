"""Scenes whose laws are written by hand, and facts: linear bodies, the start, reproducibility."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, ClassVar

import numpy as np
import scipy.integrate
import scipy.linalg
from scenes import base

import impactlab as il
from planted.detectors import Distances, Scene, of_independence, of_means


class Start(Scene):
    """The first moments of the base case without a spin-up."""

    name = "start"

    def evidence(self) -> Any:
        record = il.Trajectory(0.006)
        return il.simulate(base(), 0.048, realizations=2048, step=0.006, spin_up=0.0, record=record, rng=1)

    def distances(self, found: Any, law: Any) -> Distances:
        first = found.isel(time=0)
        squares = {name: first.velocity.sel(oscillator=name).values ** 2 for name in ("one", "two")}
        result = {f"velocity[{name}] at the start": float(of_means(item, 2.5)) for name, item in squares.items()}
        result["contacts closed at the start"] = math.inf if (first.contact_force > 0.0).any() else 0.0
        product = first.velocity.prod("oscillator").values
        return {**result, "bodies are independent at the start": float(of_means(product, 0.0))}


class Held(Scene):
    """The path of a damped body from a given state, which two contacts hold all the time, so that it is linear."""

    name = "path between two contacts"
    allowed = 1e-4  # m and m/s, in the place of a standard error; the third order of the path leaves 1e-4 m/s
    begin: ClassVar = (0.02, 1.0)

    def evidence(self) -> Any:
        law = il.LinearContact(500.0)
        contacts = {
            "right": il.Contact("a", il.WALL, law, clearance=-0.5),
            "left": il.Contact(il.WALL, "a", law, clearance=-0.5),
        }
        network = il.Network({"a": il.LinearOscillator(damping=20.0, stiffness=1.0)}, contacts)
        options = {"step": 0.004, "integrator": il.ExactFlow(measured=False), "record": il.Trajectory(0.02)}
        initial = {"displacement": {"a": self.begin[0]}, "velocity": {"a": self.begin[1]}}
        return il.simulate(network, 0.4, initial=initial, **options)

    def distances(self, found: Any, law: Any) -> Distances:
        drift = np.array([[0.0, 1.0], [-1001.0, -20.0]])
        exact = np.array([scipy.linalg.expm(drift * t) @ self.begin for t in found.time.values]).T
        paths = found.displacement.values.squeeze() * 32.0, found.velocity.values.squeeze()
        off = (np.abs(path - item).max() for path, item in zip(paths, exact * np.array([[32.0], [1.0]]), strict=True))
        return {
            name: float(item) / self.allowed for name, item in zip(("displacements", "velocities"), off, strict=True)
        }


class Linear(Scene):
    """Linear bodies, alone and coupled: all second moments of the state, at one time and between two."""

    name = "linear"
    interval = 0.25

    def network(self) -> il.Network:
        bodies = {
            "a": il.LinearOscillator(mass=2.0, damping=0.8, stiffness=30.0),
            "b": il.LinearOscillator(mass=0.5, damping=0.5, stiffness=4.0),
            "c": il.LinearOscillator(mass=1.5, damping=1.0, stiffness=9.0),
        }
        noises = {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(2.0), "c": il.WhiteNoise(0.5)}
        return il.Network(bodies, {}, noises, {"bc": il.Coupling("b", "c", il.LinearCoupling(20.0, damping=0.4))})

    def law(self) -> np.ndarray:
        """Return E[z zᵀ] and E[z(t + interval) zᵀ] of z = (x, v), written by hand."""
        mass = np.array([2.0, 0.5, 1.5])
        stiffness = np.array([[30.0, 0.0, 0.0], [0.0, 24.0, -20.0], [0.0, -20.0, 29.0]])
        damping = np.array([[0.8, 0.0, 0.0], [0.0, 0.9, -0.4], [0.0, -0.4, 1.4]])
        inverse = 1.0 / mass[:, None]
        drift = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse * stiffness, -inverse * damping]])
        growth = np.append(np.zeros(3), 2.0 * np.pi * np.array([1.0, 2.0, 0.5]) / mass**2)
        covariance = scipy.linalg.solve_continuous_lyapunov(drift, -np.diag(growth))
        return np.stack([covariance, scipy.linalg.expm(self.interval * drift) @ covariance])

    def evidence(self) -> Any:
        record = [il.Trajectory(self.interval)]
        return il.simulate(self.network(), 20.0, realizations=1024, step=self.interval, record=record, rng=1)

    def distances(self, found: Any, law: Any) -> Distances:
        z = np.concatenate([found.displacement.values, found.velocity.values], axis=2)
        result = {}
        for lag, expected, name in zip((0, 1), law, ("E[{0} {1}]", "E[{0} {1}] later"), strict=True):
            products = np.einsum("rti,rtj->rij", z[:, lag:], z[:, : z.shape[1] - lag]) / (z.shape[1] - lag)
            distance = of_means(products, expected)
            labels = [f"{kind}_{body}" for kind in "xv" for body in "abc"]
            result.update({name.format(labels[i], labels[j]): float(distance[i, j]) for i, j in np.ndindex(6, 6)})
        result["independence of realizations"] = of_independence((z[:, :, 0] ** 2).mean(axis=1))
        return result


class Bounded(Scene):
    """Linear bodies under cosines: over one period the mean squares of each are known exactly."""

    name = "bounded noise"

    def network(self) -> il.Network:
        noise = il.ShinozukaNoise(1.0, band=(0.0, 10.0), components=400)
        bodies = {
            "a": il.LinearOscillator(mass=1.0, damping=1.0, stiffness=400.0),
            "b": il.LinearOscillator(mass=2.0, damping=1.5, stiffness=780.0),
        }
        return il.Network(bodies, excitations={"a": noise, "b": noise})

    def law(self) -> Any:
        frequency = 2.0 * np.pi * 10.0 / 400 * np.arange(1, 401)
        power = 2.0 * (4.0 * np.pi) * (10.0 / 400)  # A² = 2 S_f Δf, S_f = 4π S
        squares = {}
        for name, (m, c, k) in {"a": (1.0, 1.0, 400.0), "b": (2.0, 1.5, 780.0)}.items():
            gain = 1.0 / ((k - m * frequency**2) ** 2 + (c * frequency) ** 2)
            squares[name] = 0.5 * power * gain.sum(), 0.5 * power * (gain * frequency**2).sum()
        return squares

    def evidence(self) -> Any:
        record = [il.Trajectory(1.0), il.PerRealization()]
        return il.simulate(
            self.network(), 40.0, realizations=256, step=0.02, spin_up=0.0, record=record, rng=1
        )  # fmt: skip

    def distances(self, found: Any, law: Any) -> Distances:
        result = {}
        for name, expected in law.items():
            body = found.sel(oscillator=name)
            for statistic, value in zip(("displacement", "velocity"), expected, strict=True):
                each = body[f"mean_square_{statistic}_by_realization"].values
                result[f"mean_square_{statistic}[{name}]"] = float(np.abs(each / value - 1.0).max()) / 1e-9
            result[f"start[{name}]"] = float(of_means(body.displacement.values[:, 0], 0.0))
            result[f"independence of realizations[{name}]"] = of_independence(body.displacement.values[:, 0])
        product = found.displacement.prod("oscillator").values.mean(axis=1)
        return {**result, "bodies are independent": float(of_means(product, 0.0))}


class Driven(Scene):
    """A body without noise from a given start: swinging under a fast force, and pressed on a wall by a slow one."""

    name = "driven"
    runs: ClassVar = {
        "swinging": (4.0, 2.0 * math.pi, math.inf, 10.0, None),
        "pressed": (3.0, 0.05, 0.1, 126.0, 0.02),
    }
    """Amplitude and frequency of the force, clearance of the wall if there is one, duration, step."""

    @cache  # noqa: B019
    def law(self) -> Any:
        result = {}
        for name, (amplitude, frequency, clearance, duration, _) in self.runs.items():

            def rate(time: float, z: Any, amplitude=amplitude, frequency=frequency, clearance=clearance) -> Any:  # type: ignore[no-untyped-def]
                contact = 1e3 * max(z[0] - clearance, 0.0) ** 1.5
                return [z[1], amplitude * math.sin(frequency * time) - z[0] - 0.2 * z[1] - contact]

            times = np.linspace(0.0, duration, 25001)
            z = scipy.integrate.solve_ivp(
                rate, (0.0, duration), [0.1, 0.0], rtol=1e-9, atol=1e-11, max_step=0.01, t_eval=times
            ).y  # fmt: skip
            squares = scipy.integrate.trapezoid(z**2, times) / duration
            result[name] = dict(zip(("mean_square_displacement", "mean_square_velocity"), squares, strict=True))
        return result

    def evidence(self) -> Any:
        body, found = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0), {}
        for name, (amplitude, frequency, clearance, duration, step) in self.runs.items():
            wall = {}
            if clearance < math.inf:
                wall["w"] = il.Contact("a", il.WALL, il.HertzContact(1e3), clearance=clearance)
            push = {"a": il.Harmonic(amplitude, frequency=frequency)}
            start = {"displacement": {"a": 0.1}}
            options = {"initial": start, "step": step, "integrator": il.ExactFlow()}
            found[name] = il.simulate(il.Network({"a": body}, wall, push), duration, **options)
        return found

    def distances(self, found: Any, law: Any) -> Distances:
        return {
            f"{statistic} {name}": abs(float(found[name][statistic][0]) / value - 1.0) / 1e-3
            for name, expected in law.items()
            for statistic, value in expected.items()
        }


class Pressed(Scene):
    """A body that is pressed on a wall with a damper and never leaves it: linear, with a force that depends on v."""

    name = "pressed"

    def network(self) -> il.Network:
        contact = il.Contact("a", il.WALL, il.KelvinVoigtContact(60.0, damping=6.0, tension=True), clearance=-8.0)
        return il.Network(
            {"a": il.LinearOscillator(mass=2.0, damping=1.0, stiffness=40.0)},
            {"wall": contact},
            {"a": il.WhiteNoise(1.0)},
        )

    def law(self) -> Any:
        return {
            "direct_mean_displacement": -8.0 * 60.0 / 100.0,
            "variance_displacement": math.pi / (7.0 * 100.0),
            "mean_square_velocity": math.pi / (7.0 * 2.0),
            "mean_velocity": 0.0,
        }

    def evidence(self) -> Any:
        return il.simulate(self.network(), 20.0, realizations=2048, step=0.005, rng=1)

    def distances(self, found: Any, law: Any) -> Distances:
        result = {"contact_ratio": 0.0 if found.contact_ratio.item() == 1.0 else math.inf}
        for name, value in law.items():
            result[name] = abs(found[name].item() - value) / found[f"{name}_standard_error"].item()
        return result


class Alone(Scene):
    """Facts: what a realization does depends neither on others, nor on blocks, nor on further bodies."""

    name = "reproducibility"

    def evidence(self) -> Any:
        options = {"duration": 1.0, "step": 0.006, "spin_up": 0.0, "record": il.PerRealization(), "rng": 3}
        third = il.LinearOscillator(stiffness=10.0, damping=1.0)
        more = il.Network(
            {"body": third, **base().oscillators},
            {"far": il.Contact("body", "one", il.HertzContact(1.0), clearance=100.0), **base().contacts},
            {"body": il.WhiteNoise(1.0), **base().excitations},
        )
        many = il.simulate(base(), realizations=1100, **options)
        again = il.simulate(base(), realizations=1100, **options)
        return (
            many,
            again,
            il.simulate(base(), realizations=70, **options),
            il.simulate(more, realizations=70, **options),
        )

    def distances(self, found: Any, law: Any) -> Distances:
        many, again, few, more = (item.mean_square_displacement_by_realization for item in found)
        names = ["one", "two"]

        def same(a: Any, b: Any) -> float:
            return 0.0 if np.array_equal(a.sel(oscillator=names), b.sel(oscillator=names)) else math.inf

        few_of_many = many.isel(realization=slice(0, few.sizes["realization"]))
        return {
            "the same numbers again": same(many, again),
            "the same numbers alone and among others": same(few_of_many, few),
            "the same numbers with another body": same(few, more),
            "independence of realizations": of_independence(many.values[:, 1]),
        }
