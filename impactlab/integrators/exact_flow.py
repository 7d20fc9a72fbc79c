"""Exact flow: the linear stochastic motion between kicks by all other forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from impactlab.integrators.base import ADVANCE, Flows, Integrator, coupling_rate, frequencies
from impactlab.kernels.flow import (
    COEFFICIENTS,
    GAUSS,
    flow,
    noise_columns,
    response_to_force,
    split_transition,
    transition,
)
from impactlab.kernels.jit import borrow, loop
from impactlab.kernels.kick import add_forced, add_response, apply_kick, clear, copy, scaled_sum
from impactlab.kernels.random import fill_steps
from impactlab.kernels.sums import SLOTS, close_slot, empty_slots, write_snapshot
from impactlab.model import Model

_SHIFT, _KICK, _HALF_KICK, _PUSH_X, _PUSH_V = range(COEFFICIENTS, COEFFICIENTS + 5)


SPLIT_FRICTION = 0.125
"""Largest friction over a step, ``c h/m``, that may act at one moment of it."""


class ExactFlow(Integrator):
    """Exact flow with a shifted kick; the default.

    One step is the linear motion of every body under its white noise, then a kick by all
    remaining forces R. The kick and every statistic of contacts and positions are read
    at ``y = x + (h²/12) R(x)/m``: for conservative forces this is the force-gradient
    correction of a fourth-order splitting to its order, without the derivative of any
    force (Chin, Phys. Lett. A 226, 1997, 344). Forces that depend on velocities are
    evaluated at the velocity in the middle of the kick, in two passes. Without contacts
    there is no error at any step. Sums of cosines enter through their exact linear response,
    given forces as constant over a step.

    The linear motion of a body with contacts is the exact undamped one, with the friction
    and noise of the step at one of the two nodes of Gauss's rule, in turn. That takes one
    normal instead of two and keeps the linear law just as well. Between kicks the mean
    kinetic energy varies like a parabola around its true value, which it has at these
    nodes: friction and noise that act there (and not, as usual, in the middle) feel the
    right temperature. Bodies without contacts, and those with friction over a step of more
    than 1/8, have the exact Gaussian transition.
    """

    order: ClassVar[float] = 2.0
    handles: ClassVar[tuple[str, ...]] = ("intensity", "lines", "force")
    kicks: ClassVar[bool] = True
    phases: ClassVar[int] = 2
    takes_response: ClassVar[bool] = True

    @staticmethod
    def loop() -> Callable[..., None]:
        return loop(ADVANCE, _advance)

    def coefficients(self, model: Model, step: float) -> np.ndarray:
        a = self.flows(model, step).transition
        constant = np.column_stack(
            [
                step**2 / 12.0 / model.mass,
                step / model.mass,
                0.5 * step / model.mass,
                *response_to_force(model.mass, model.damping, model.stiffness, step).T,
            ]
        )
        return np.concatenate([a.reshape(*a.shape[:2], 4), np.broadcast_to(constant, (len(a), *constant.shape))], 2)

    def noise(self, model: Model, step: float) -> tuple[np.ndarray, np.ndarray]:
        split = self._split(model, step)
        columns = np.stack([noise_columns(q) for q in self.flows(model, step).covariance])  # (phase, 2, body, 2)
        rows = [(slot, k) for slot in model.white for k in ((0,) if split[slot] else (0, 1))]
        slots, which = np.ascontiguousarray(np.array(rows, dtype=np.int64).reshape(-1, 2).T)
        return slots, columns[:, which, slots]

    def flows(self, model: Model, step: float) -> Flows:
        linear = model.mass, model.damping, model.stiffness, model.reference_intensities()
        exact = *transition(*linear, step), *transition(*linear, 0.5 * step)
        split = self._split(model, step)[:, None, None]
        phases = []
        for place in GAUSS:
            parts = *split_transition(*linear, step, place), *split_transition(*linear, step, place, until=0.5)
            phases.append([np.where(split, *pair) for pair in zip(parts, exact, strict=True)])
        return Flows(*(np.stack(part) for part in zip(*phases, strict=True)))

    def _split(self, model: Model, step: float) -> np.ndarray:
        """Whether friction and noise of each body act at one moment of the step, (body,) of bool."""
        noisy = np.zeros(len(model.mass), dtype=bool)
        noisy[list(model.white)] = True
        split: np.ndarray = noisy & model.nonlinear_bodies & (model.damping * step <= SPLIT_FRICTION * model.mass)
        return split

    def largest_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        return self._step(model, tangent, residual, 1.6, 3.0, 1.0)

    def recommended_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        if not model.nonlinear_bodies.any():  # every step is exact: a few samples per period
            return min(_over(1.0, model.natural_frequencies.max()), _over(1.0, (model.damping / model.mass).max()))
        return self._step(model, tangent, residual, 0.5, 1.0, 0.05)

    def _step(
        self,
        model: Model,
        tangent: np.ndarray,
        residual: np.ndarray | float,
        of_kicks: float,
        of_flow: float,
        of_dampers: float,
    ) -> float:
        """Limit the step by the frequency of the forces that kick and of the bodies they act on, and by dampers."""
        kicked = model.nonlinear_bodies
        if not kicked.any():
            return float("inf")
        by_kicks = replace(model, stiffness=np.zeros_like(model.stiffness) + residual)
        return min(
            _over(of_kicks, frequencies(by_kicks, tangent)[-1]),
            _over(of_flow, model.natural_frequencies[kicked].max()),
            _over(of_dampers, coupling_rate(model)),
        )


def _over(number: float, frequency: float) -> float:
    return number / float(frequency) if frequency > 0.0 else float("inf")


def _advance(  # type: ignore[no-untyped-def]
    forces, parameters, indices, coefficients, noise, series, forced, state, history, sums, snapshots,
    step, dissipative, summing, first, count, every, phase,
):  # fmt: skip
    noise, series, forced = borrow(noise), borrow(series), borrow(forced)
    state, history, sums = borrow(state), borrow(history), borrow(sums)
    coefficients, parameters, indices = borrow(coefficients), borrow(parameters), borrow(indices)
    x, v, y, push = state.x, state.v, state.reading, state.external
    rows = np.full(coefficients.shape[1], -1)
    for row in range(noise.bodies.shape[0] - 1, -1, -1):
        rows[noise.bodies[row]] = row
    empty_slots(history, 0, first % SLOTS)
    for index in range(count):
        now = first + index
        slot = now % SLOTS
        after, middle, total = history.x[slot], history.v[slot], history.force[slot]
        indentation, contact_force = history.indentation[slot], history.contact_force[slot]
        if series.bodies.shape[0]:
            copy(x, y)
            x = y
            add_response(series.samples, now, -1.0, series.bodies, x, v)
        if noise.bodies.shape[0] and (index == 0 or now % 4 == 0):
            fill_steps(noise, now // 4, state.normals)
        sample = index if noise.scale.shape[0] > 1 else 0
        flow(coefficients, now % coefficients.shape[0], rows, noise, sample, state.normals, now % 4, x, v, after)
        x = after
        if forced.bodies.shape[0]:
            clear(push)
            add_forced(forced.force, index, forced.bodies, push)
            scaled_sum(x, coefficients, _PUSH_X, push, x)
            scaled_sum(v, coefficients, _PUSH_V, push, v)
        if series.bodies.shape[0]:
            add_response(series.samples, now + 1, 1.0, series.bodies, x, v)
        # the conservative force at x says where the kick is read
        forces(x, state.rest, parameters, indices, indentation, contact_force, total)
        scaled_sum(x, coefficients, _SHIFT, total, y)
        forces(y, v, parameters, indices, indentation, contact_force, total)
        if dissipative:  # once more, with the velocity in the middle of the kick
            scaled_sum(v, coefficients, _HALF_KICK, total, middle)
            forces(y, middle, parameters, indices, indentation, contact_force, total)
        apply_kick(coefficients, _KICK, total, v, middle)
        if summing:
            close_slot(history, slot, index == count - 1, sums)
        if every and (phase + index + 1) % every == 0:
            write_snapshot(y, middle, contact_force, snapshots, (phase + index + 1) // every - 1)
    last = (first + count - 1) % SLOTS
    copy(x, state.x)
    copy(history.v[last], state.velocity)
    copy(history.contact_force[last], state.contact_force)
