"""Linear scenes of combinations, shared noises, structures, laws with states or time: covariances by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.integrate
import scipy.linalg

import impactlab as il
from planted.detectors import Distances, Scene

EXACT = il.ExactFlow(measured=False)


def moments(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance of z = (x, v) under white noises of some matrix of densities, by its Lyapunov equation."""
    count, inverse = len(mass), np.linalg.inv(mass)
    drift = np.block([[np.zeros((count, count)), np.eye(count)], [-inverse @ stiffness, -inverse @ damping]])
    growth = np.zeros((2 * count, 2 * count))
    growth[count:, count:] = 2.0 * math.pi * inverse @ noise @ inverse
    return np.asarray(scipy.linalg.solve_continuous_lyapunov(drift, -growth))


class Covariances(Scene):
    """Covariances of displacements and velocities at the ends of intervals, against those that are known."""

    interval, duration, realizations = 0.5, 20.0, 1024

    def network(self) -> il.Network:
        raise NotImplementedError

    def evidence(self) -> Any:
        options: dict[str, Any] = {"realizations": self.realizations, "integrator": EXACT, "rng": 1}
        return il.simulate(self.network(), self.duration, record=il.Trajectory(self.interval), **options)

    def distances(self, found: Any, law: np.ndarray) -> Distances:
        z = np.concatenate([found[name].values for name in ("displacement", "velocity")], axis=2)
        z = z - z.mean(axis=(0, 1))
        products = np.einsum("rti,rtj->rij", z, z) / z.shape[1]
        error = products.std(axis=0, ddof=1) / math.sqrt(len(products))
        distance = np.abs(products.mean(axis=0) - law) / error
        return {f"covariance of z{i} and z{j}": float(distance[i, j]) for i, j in np.ndindex(*law.shape)}


class Lever(Covariances):
    """Two bodies under one noise that turns them against each other, and the end of a lever on a spring."""

    name = "lever under one noise"

    def network(self) -> il.Network:
        bodies = {
            "a": il.LinearOscillator(mass=1.0, damping=1.0, stiffness=4.0),
            "b": il.LinearOscillator(mass=2.0, damping=1.5, stiffness=3.0),
        }
        end = il.Combination({"a": 1.5, "b": -0.5})
        contact = il.Contact(end, il.WALL, il.LinearContact(6.0), clearance=-15.0)  # it never opens
        noises = {"common": il.Source(il.WhiteNoise(0.5), on={"a": 1.0, "b": -0.7}), "b": il.WhiteNoise(0.1)}
        return il.Network(bodies, {"end": contact}, noises)

    def law(self) -> np.ndarray:
        along, on = np.array([1.5, -0.5]), np.array([1.0, -0.7])
        stiffness = np.diag([4.0, 3.0]) + 6.0 * np.outer(along, along)
        noise = 0.5 * np.outer(on, on) + np.diag([0.0, 0.1])
        return moments(np.diag([1.0, 2.0]), np.diag([1.0, 1.5]), stiffness, noise)


class Tower(Covariances):
    """A structure by full matrices, with springs along combinations of its coordinates, shaken by its ground."""

    name = "shaken structure"
    mass = np.array([2.0, 1.0, 1.5])
    stiffness = np.array([[40.0, -15.0, 3.0], [-15.0, 30.0, -12.0], [3.0, -12.0, 20.0]])
    damping = np.array([[1.5, -0.6, 0.2], [-0.6, 1.2, -0.3], [0.2, -0.3, 0.8]])

    def network(self) -> il.Network:
        tower = il.LinearStructure(self.mass, self.damping, self.stiffness, names=("low", "middle", "top"))
        on = {"tower.low": -2.0, "tower.middle": -1.0, "tower.top": -1.5}
        return il.Network({"tower": tower}, None, {"ground": il.Source(il.WhiteNoise(0.2), on=on)})

    def law(self) -> np.ndarray:
        return moments(np.diag(self.mass), self.damping, self.stiffness, 0.2 * np.outer(self.mass, self.mass))


class Creeping(Covariances):
    """A body that a spring and damper in series hold: their force is a third state of a linear motion."""

    name = "Maxwell element"

    def network(self) -> il.Network:
        body = il.LinearOscillator(mass=1.0, damping=0.5, stiffness=3.0)
        held = il.Coupling("a", il.WALL, il.MaxwellCoupling(20.0, damping=6.0))
        return il.Network({"a": body}, None, {"a": il.WhiteNoise(0.3)}, {"held": held})

    def law(self) -> np.ndarray:
        drift = np.array([[0.0, 1.0, 0.0], [-3.0, -0.5, -1.0], [0.0, 20.0, -20.0 / 6.0]])
        growth = np.diag([0.0, 2.0 * math.pi * 0.3, 0.0])
        return np.asarray(scipy.linalg.solve_continuous_lyapunov(drift, -growth))[:2, :2]


class PulsatingSpring(il.CouplingLaw):
    """Spring whose stiffness varies with the period of 2 s."""

    stiffness: float = il.parameter(units="N m-1")

    @staticmethod
    def force(extension, time, stiffness):  # type: ignore[no-untyped-def]
        return stiffness * (1.0 + 0.8 * math.cos(math.pi * time)) * extension


class Pulsating(Covariances):
    """A body on a spring that varies in time, once in each of its periods, where the covariance is always the same."""

    name = "parametric excitation"
    interval, duration = 2.0, 40.0

    def network(self) -> il.Network:
        body = il.LinearOscillator(mass=1.0, damping=0.7, stiffness=3.0)
        return il.Network(
            {"a": body}, None, {"a": il.WhiteNoise(0.3)}, {"p": il.Coupling("a", il.WALL, PulsatingSpring(4.0))}
        )

    def law(self) -> np.ndarray:
        def growth(time: float, values: np.ndarray) -> np.ndarray:
            """Of the linear map of a part of a period, and of the covariance that noise makes in it."""
            drift = np.array([[0.0, 1.0], [-7.0 - 3.2 * math.cos(math.pi * time), -0.7]])
            along, spread = values.reshape(2, 2, 2)
            noise = np.diag([0.0, 2.0 * math.pi * 0.3])
            return np.stack([drift @ along, drift @ spread + spread @ drift.T + noise]).ravel()

        begin = np.stack([np.eye(2), np.zeros((2, 2))]).ravel()
        end = scipy.integrate.solve_ivp(growth, (0.0, 2.0), begin, rtol=1e-10, atol=1e-12).y[:, -1]
        return np.asarray(scipy.linalg.solve_discrete_lyapunov(*end.reshape(2, 2, 2)))


LEVER, TOWER, CREEPING, PULSATING = Lever(), Tower(), Creeping(), Pulsating()

SCENES = [LEVER, TOWER, CREEPING, PULSATING]
