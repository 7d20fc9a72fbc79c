"""Explicit methods: their tableau is all that tells them apart."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.mechanism import sampled_step
from impactlab.assembly.model import Model
from impactlab.compiling.jit import inlined
from impactlab.integrators.arguments import NoiseRows
from impactlab.integrators.base import Integrator, coupling_rate, frequencies
from impactlab.integrators.driver import sample_of, sampled
from impactlab.kernels.kick import (
    accelerate,
    add_forced,
    add_held_noise,
    add_multiple,
    add_series,
    clear,
    combine,
    copy,
)
from impactlab.kernels.memory import set_elapsed
from impactlab.kernels.series import NEAR
from impactlab.kernels.sums import SLOTS
from impactlab.linear.laws import lines_of


class ExplicitIntegrator(Integrator):
    """A Runge-Kutta method whose stages each begin with the slope of the stage before.

    A subclass gives `order`, `nodes` and `weights`. White noise is held constant over a step.

    Examples
    --------
    >>> class Heun(il.ExplicitIntegrator):
    ...     order = 2.0
    ...     nodes = (0.0, 1.0)
    ...     weights = (0.5, 0.5)
    >>> Heun()
    Heun()
    """

    handles: ClassVar[tuple[str, ...]] = ("intensity", "lines", "filter", "force")
    blocks: ClassVar[int] = 3
    required: ClassVar[tuple[str, ...]] = ("order", "nodes", "weights")

    nodes: ClassVar[tuple[float, ...] | None] = None
    """Times of the stages, as parts of a step; the first is 0."""

    weights: ClassVar[tuple[float, ...] | None] = None
    """Weights of the stages in the slope of the step."""

    fraction: ClassVar[float] = 1.0
    """Recommended step as a part of the largest."""

    @staticmethod
    def step(forces, tables, driven, state, history, steps, index):  # type: ignore[no-untyped-def]
        nodes, weights = tables.tableau[0], tables.tableau[1]
        slot, last = (steps.first + index) % SLOTS, nodes.shape[0] - 1
        x, v, slope = state.x, state.v, state.total
        external, mean_v, mean_slope = state.work[0], state.work[1], state.work[2]
        at_x, at_v, indentation, contact_force = x, v, history.indentation[slot], history.contact_force[slot]
        copy(x, history.x[slot])
        copy(v, history.v[slot])
        clear(mean_v)
        clear(mean_slope)
        for stage in range(last + 1):
            if stage == 0 or nodes[stage] != nodes[stage - 1]:
                push(driven, steps, index, nodes[stage], external)
            set_elapsed(tables, steps, nodes[stage] * steps.step)
            forces(at_x, at_v, at_v, 0.0, tables.parameters, tables.indices, indentation, contact_force, slope)
            accelerate(tables.coefficients, at_x, at_v, external, slope)
            add_multiple(weights[stage], at_v, mean_v)
            add_multiple(weights[stage], slope, mean_slope)
            if stage < last:
                ahead = nodes[stage + 1] * steps.step
                combine(x, ahead, at_v, state.reading)
                combine(v, ahead, slope, state.velocity)
            at_x, at_v = state.reading, state.velocity
            indentation, contact_force = state.indentation, state.contact_force
        add_multiple(steps.step, mean_v, x)
        add_multiple(steps.step, mean_slope, v)
        if sampled(steps, index):
            copy(x, state.reading)
            copy(v, state.velocity)
            set_elapsed(tables, steps, steps.step)
            forces(x, v, v, 0.0, tables.parameters, tables.indices, indentation, contact_force, slope)

    @property
    def samples_per_step(self) -> int:
        return math.lcm(*(Fraction(node).limit_denominator(NEAR).denominator for node in self.nodes or ()))

    @property
    def stability_polynomial(self) -> tuple[float, ...]:
        """Coefficients of the amplification factor over ``step × eigenvalue``, highest power first."""
        nodes, weights = self.tableau()
        slopes = np.zeros((len(nodes), len(nodes)))  # of each stage, by powers of ``step × eigenvalue``
        slopes[:, 0] = 1.0
        for stage in range(1, len(nodes)):
            slopes[stage, 1:] = nodes[stage] * slopes[stage - 1, :-1]
        return (*(math.fsum(column) for column in (slopes.T * weights)[::-1]), 1.0)

    def tableau(self) -> np.ndarray:
        return np.array([self.nodes, self.weights], dtype=float)

    def coefficients(self, model: Model, step: float) -> np.ndarray:
        return np.column_stack([model.mass, model.damping, model.stiffness])[None]

    def noise(self, model: Model, step: float) -> NoiseRows:
        noises = model.sources["intensity"]
        source, body, weight = noises.drives
        force = weight * np.sqrt(2.0 * np.pi * model.noise.reference_density[source] / step)
        amplitude = np.stack([np.zeros_like(force), force], axis=1)[None]
        names = tuple(noises.names[number] for number in source)
        return NoiseRows(body, names, np.zeros_like(source), source, amplitude).ordered()

    def largest_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        return min(self._stable(model, tangent, residual), _sampled_step(model))

    def recommended_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        return min(
            self.fraction * self._stable(model, tangent, residual), 0.5 * _sampled_step(model), sampled_step(model)
        )

    def _stable(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float) -> float:
        return stable_step(self.stability_polynomial, replace(model, stiffness=model.stiffness + residual), tangent)


class RungeKutta4(ExplicitIntegrator):
    """Classical Runge-Kutta method with a fixed step.

    It is of fourth order for smooth forces; where Hertz contacts open and close, the second
    derivative of the force is singular and about 2.5 remains. Series of cosines and given
    forces are sampled at half steps. White noise is held constant over a step: the
    usual approximation, of second order in the mean squares of a linear body.

    Examples
    --------
    >>> il.RungeKutta4().order
    4.0
    """

    order: ClassVar[float] = 4.0
    nodes: ClassVar[tuple[float, ...]] = (0.0, 0.5, 0.5, 1.0)
    weights: ClassVar[tuple[float, ...]] = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
    fraction: ClassVar[float] = 0.05


class EulerMaruyama(ExplicitIntegrator):
    """Euler-Maruyama method with a fixed step: first order, stable only below ``2 ζ/ω``.

    It is here as the baseline that most hand-written simulations use (Maruyama, Rend. Circ. Mat.
    Palermo 4, 1955, 48).

    Examples
    --------
    >>> il.EulerMaruyama().order
    1.0
    """

    order: ClassVar[float] = 1.0
    nodes: ClassVar[tuple[float, ...]] = (0.0,)
    weights: ClassVar[tuple[float, ...]] = (1.0,)
    fraction: ClassVar[float] = 0.02


def _sampled_step(model: Model) -> float:
    """Largest step at which no line of a series is taken for one near the natural frequency of its body (s).

    A line of frequency 1/h looks constant to a method that samples it once in a step, and to
    Runge-Kutta methods too, whose weights of the samples in between do not cancel it.
    """
    natural = np.sqrt(model.stiffness / model.mass)
    tops = [float(item.frequencies.max() + natural[[*item.bodies]].max()) for item in lines_of(model)]
    highest = max(tops, default=0.0)
    return 2.0 * np.pi / highest if highest > 0.0 else float("inf")


def stable_step(polynomial: Any, model: Model, tangent: np.ndarray) -> float:
    """Largest step of an explicit one-step method with this stability polynomial (s).

    Every natural frequency with closed contacts is taken with the least relative damping
    of any body, and with the largest; 0 if the method is unstable at any step.
    """
    top = float(frequencies(model, tangent)[-1])
    rates = model.damping / model.mass
    poles = [np.roots([1.0, float(rate), top**2]) for rate in {rates.min(), rates.max() + coupling_rate(model)}]
    poles += [
        np.roots([1.0, rate, k / m])
        for rate, k, m in {*zip(rates.tolist(), model.stiffness.tolist(), model.mass.tolist(), strict=True)}
    ]
    values = np.concatenate(poles)
    values = values[np.abs(values) > 1e-12 * max(np.abs(values).max(), 1e-300)]
    if not values.size:
        return float("inf")

    high = 4.0 / np.abs(values).max()
    trials = high * 0.5 ** np.arange(0.0, 20.0, 0.01)  # below, growth would hide in the tolerance
    for steps in np.array_split(trials, np.clip(values.size, 100, trials.size)):
        growth = np.abs(np.polyval(polynomial, steps[:, None] * values))
        stable = steps[(growth <= 1.0 + 1e-12).all(axis=1)]
        if stable.size:
            return float(stable[0])
    return 0.0


@inlined
def push(driven, steps, index, node, force):  # type: ignore[no-untyped-def]
    """Write the force of everything that acts from outside at a node of a step to ``force[body, lane]``."""
    noise, series, forced = driven.noise, driven.series, driven.forced
    now, sample = steps.first + index, int(steps.samples * node + 0.5)
    clear(force)
    if noise.bodies.shape[0]:
        add_held_noise(noise, index if noise.scale.shape[0] > 1 else 0, noise.normals, now % 4, force)
    if series.bodies.shape[0]:
        add_series(series, sample_of(steps, now) + sample, force)
    if forced.bodies.shape[0]:
        add_forced(forced, steps.samples * index + sample, force)
