"""The base case in other libraries, where they are installed: diffrax, torchsde, OpenMM.

Each runs many realizations at once, as its users do, with the method it has for this kind of
equation, and samples displacements every 0.02 s, from which all statistics are taken.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.baselines.loops import SAMPLING, SPIN_UP, Batches
from impactlab_numerics.scenes import TEMPERATURE, Arrays

SEGMENT = 2.0
"""Time that a library simulates in one call (s)."""

LONG_RUN = 5
"""Calls from which the bias of a library is estimated."""


@dataclass(eq=False)
class Peer:
    """The pair in another library; `run` continues where the last call ended.

    Attributes
    ----------
    name, scheme : str
        Library and method.
    step : float
        Step (s).
    realizations : int
        Number of realizations that run at once.
    make : callable
        Takes the scene's numbers, the step, the number of realizations and a seed; returns a
        function that advances all by a segment and returns samples [time, realization, body].
    """

    name: str
    scheme: str
    step: float
    realizations: int
    make: Callable[[Arrays, float, int, int], Callable[[], np.ndarray]]
    _advance: Callable[[], np.ndarray] = field(init=False)

    @property
    def installed(self) -> bool:
        """Whether the library can be imported."""
        return importlib.util.find_spec(self.name.lower()) is not None

    @property
    def batch(self) -> float:
        """Time that all realizations make in a segment (s)."""
        return SEGMENT * self.realizations

    def start(self, network: il.Network, edges: np.ndarray, seed: int) -> None:
        """Compile, and run until the start is forgotten."""
        arrays = Arrays.of(network)
        self._arrays, self._edges = arrays, edges
        self._advance = self.make(arrays, self.step, self.realizations, seed)
        for _ in range(round(SPIN_UP / SEGMENT)):
            self._advance()

    def run(self, segments: int) -> Batches:
        """Run a number of segments; each realization counts as a batch."""
        a, values, densities = self._arrays, [], []
        width = np.diff(self._edges)
        for _ in range(segments):
            x = self._advance()
            indentation = np.maximum(x[..., 0] - x[..., 1] - a.clearance, 0.0)
            each = [x[..., 1] ** 2, indentation > 0.0, a.hertz * indentation**1.5]
            values.append(np.stack([item.mean(axis=0) for item in each], axis=1))
            counts = [np.histogram(lane, self._edges)[0] for lane in x[..., 1].T]
            densities.append(np.array(counts) / (len(x) * width))
        return Batches(np.mean(values, axis=0), np.mean(densities, axis=0))


def _samples(step: float) -> tuple[int, int]:
    """Steps between samples, and samples in a segment."""
    return round(SAMPLING / step), round(SEGMENT / SAMPLING)


def _diffrax(arrays: Arrays, step: float, realizations: int, seed: int) -> Callable[[], np.ndarray]:
    """`diffeqsolve` for an underdamped Langevin equation, in double precision."""
    import diffrax
    import jax
    import jax.numpy as jnp

    _, samples = _samples(step)
    jax.config.update("jax_enable_x64", True)
    k, damping = jnp.asarray(arrays.stiffness), jnp.asarray(arrays.damping)

    def slope(x: Any, *_: Any) -> Any:  # of the potential, in units of the temperature
        force = arrays.hertz * jnp.maximum(x[0] - x[1] - arrays.clearance, 0.0) ** 1.5
        return (k * x + force * jnp.array([1.0, -1.0])) / TEMPERATURE

    times = jnp.arange(1, samples + 1) * SAMPLING
    shape = jax.ShapeDtypeStruct((2,), jnp.float64)

    def solve(state: Any, key: Any) -> Any:
        path = diffrax.UnsafeBrownianPath(shape, key, levy_area=diffrax.SpaceTimeLevyArea)
        temperature = jnp.full(2, TEMPERATURE)
        terms = diffrax.MultiTerm(
            diffrax.UnderdampedLangevinDriftTerm(damping, temperature, slope),
            diffrax.UnderdampedLangevinDiffusionTerm(damping, temperature, path),
        )
        return diffrax.diffeqsolve(
            terms, diffrax.ALIGN(), 0.0, SEGMENT, step, state, saveat=diffrax.SaveAt(ts=times),
            adjoint=diffrax.DirectAdjoint(), max_steps=None,
        ).ys  # fmt: skip

    together = jax.jit(jax.vmap(solve))
    key = jax.random.key(seed)
    state = (jnp.zeros((realizations, 2)), jnp.zeros((realizations, 2)))

    def advance() -> np.ndarray:
        nonlocal state, key
        key, own = jax.random.split(key)
        x, v = together(state, jax.random.split(own, realizations))
        state = x[:, -1], v[:, -1]
        return np.asarray(x).transpose(1, 0, 2)

    return advance


def _torchsde(arrays: Arrays, step: float, realizations: int, seed: int) -> Callable[[], np.ndarray]:
    """`sdeint` with the stochastic Runge-Kutta method for additive noise, in double precision."""
    import torch
    import torchsde

    _, samples = _samples(step)
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    k, c, noise = (
        torch.as_tensor(item)
        for item in (arrays.stiffness, arrays.damping, np.sqrt(2.0 * np.pi * arrays.spectral_density))
    )
    amplitude = torch.zeros(realizations, 4, 2, dtype=torch.float64)
    amplitude[:, 2, 0], amplitude[:, 3, 1] = noise

    class Pair(torch.nn.Module):  # type: ignore[misc]
        noise_type, sde_type = "additive", "ito"

        def f(self, t: Any, y: Any) -> Any:
            x, v = y[:, :2], y[:, 2:]
            force = arrays.hertz * torch.clamp(x[:, 0] - x[:, 1] - arrays.clearance, min=0.0) ** 1.5
            return torch.cat([v, torch.stack([-force, force], 1) - k * x - c * v], 1)

        def g(self, t: Any, y: Any) -> Any:
            return amplitude

    times = torch.arange(samples + 1, dtype=torch.float64) * SAMPLING
    state = torch.zeros(realizations, 4, dtype=torch.float64)

    def advance() -> np.ndarray:
        nonlocal state
        with torch.no_grad():
            path = torchsde.sdeint(Pair(), state, times, dt=step, method="srk")
        state = path[-1]
        return np.asarray(path[1:, :, :2])

    return advance


def _openmm(arrays: Arrays, step: float, realizations: int, seed: int) -> Callable[[], np.ndarray]:
    """A BAOAB integrator with a friction for each particle, on the CPU platform; nm, ps, u and kJ/mol as units."""
    import openmm

    stride, samples = _samples(step)
    system = openmm.System()
    spring = openmm.CustomExternalForce("0.5*k*x^2")
    spring.addPerParticleParameter("k")
    contact = openmm.CustomCompoundBondForce(2, "0.4*hertz*d^2.5; d = max(0, x1 - x2 - clearance)")
    contact.addGlobalParameter("hertz", arrays.hertz)
    contact.addGlobalParameter("clearance", arrays.clearance)
    for first in range(0, 2 * realizations, 2):
        for body in (0, 1):
            system.addParticle(1.0)
            spring.addParticle(first + body, [arrays.stiffness[body]])
        contact.addBond([first, first + 1], [])
    for force in (spring, contact):
        system.addForce(force)
    integrator = openmm.CustomIntegrator(step)
    integrator.addPerDofVariable("decay", 0.0)
    integrator.addPerDofVariable("scale", 0.0)
    for target, formula in (
        ("v", "v + 0.5*dt*f/m"),
        ("x", "x + 0.5*dt*v"),
        ("v", "decay*v + scale*gaussian"),
        ("x", "x + 0.5*dt*v"),
        ("v", "v + 0.5*dt*f/m"),
    ):
        integrator.addComputePerDof(target, formula)
    integrator.setRandomNumberSeed(seed)
    platform = openmm.Platform.getPlatformByName("CPU")
    context = openmm.Context(system, integrator, platform, {"Threads": "1"})
    context.setPositions(np.zeros((2 * realizations, 3)))
    context.setVelocities(np.zeros((2 * realizations, 3)))
    decay = np.exp(-arrays.damping * step)
    along = np.zeros((2, 2, 3))  # decay and scale of the two bodies; nothing moves across
    along[0, :, 0], along[1, :, 0] = decay, np.sqrt(TEMPERATURE * (1.0 - decay**2))
    for name, rows in zip(("decay", "scale"), along, strict=True):
        integrator.setPerDofVariableByName(name, np.tile(rows, (realizations, 1)).tolist())

    def advance() -> np.ndarray:
        found = np.empty((samples, realizations, 2))
        for sample in range(samples):
            integrator.step(stride)
            places = context.getState(getPositions=True).getPositions(asNumpy=True)._value
            found[sample] = places[:, 0].reshape(realizations, 2)
        return found

    return advance


def peers() -> list[Peer]:
    """Return the libraries that are known, installed or not."""
    return [
        Peer("diffrax", "ALIGN", 0.004, 256, _diffrax),
        Peer("torchsde", "SRK", 0.002, 1024, _torchsde),
        Peer("OpenMM", "BAOAB", 0.004, 1024, _openmm),
    ]
