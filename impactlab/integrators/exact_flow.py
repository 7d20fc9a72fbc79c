"""Exact flow: the exact linear stochastic motion between kicks by all other forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from impactlab.integrators.base import ADVANCE, Integrator, coupling_rate, frequencies
from impactlab.kernels.flow import COEFFICIENTS, flow, flow_coefficients, response_to_force, transition
from impactlab.kernels.jit import loop
from impactlab.kernels.kick import add_forced, add_response, apply_kick, clear, scaled_sum
from impactlab.kernels.random import fill_normals
from impactlab.kernels.sums import add_contacts, add_kick, add_state, write_snapshot
from impactlab.model import Model

_SHIFT, _KICK, _HALF_KICK, _PUSH_X, _PUSH_V = range(COEFFICIENTS, COEFFICIENTS + 5)


class ExactFlow(Integrator):
    """Exact flow with a shifted kick; the default.

    One step is the exact Gaussian transition of every linear body, then a kick by all
    remaining forces R. The kick and every statistic of contacts and positions are read
    at ``y = x + (h²/12) R(x)/m``: for conservative forces this is the force-gradient
    correction of a fourth-order splitting to its order, without the derivative of any
    force (Chin, Phys. Lett. A 226, 1997, 344). Forces that depend on velocities are
    evaluated at the velocity in the middle of the kick, in two passes. Without contacts
    there is no error at any step. Sums of cosines enter through their exact linear response,
    given forces as constant over a step.
    """

    order: ClassVar[float] = 2.0
    handles: ClassVar[tuple[str, ...]] = ("intensity", "lines", "force")
    kicks: ClassVar[bool] = True
    takes_response: ClassVar[bool] = True

    @staticmethod
    def loop() -> Callable[..., None]:
        return loop(ADVANCE, _advance)

    def coefficients(self, model: Model, step: float) -> np.ndarray:
        linear = (model.mass, model.damping, model.stiffness, model.reference_intensities())
        a, q = transition(*linear, step)
        return np.column_stack(
            [
                flow_coefficients(a, q),
                step**2 / 12.0 / model.mass,
                step / model.mass,
                0.5 * step / model.mass,
                *response_to_force(model.mass, model.damping, model.stiffness, step).T,
            ]
        )

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
    forces, parameters, indices, coefficients, noise, series, forced, state, sums, snapshots,
    step, dissipative, summing, first, count, every, phase,
):  # fmt: skip
    x, v, y, middle, total = state.x, state.v, state.reading, state.velocity, state.total
    indentation, contact_force = state.indentation, state.contact_force
    push = state.external
    rows = np.full(coefficients.shape[0], -1)
    for row in range(noise.bodies.shape[0]):
        rows[noise.bodies[row]] = row
    for index in range(count):
        now = first + index
        if series.bodies.shape[0]:
            add_response(series.samples, now, -1.0, series.bodies, x, v)
        if noise.bodies.shape[0] and (index == 0 or now % 2 == 0):
            fill_normals(noise.streams, noise.realizations, np.uint64(now // 2), state.normals)
        sample = index if noise.scale.shape[0] > 1 else 0
        flow(coefficients, rows, noise.scale, sample, state.normals, 2 * (now % 2), x, v)
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
            add_state(x, middle, sums.bodies)
            add_kick(x, middle, total, coefficients, _KICK, sums.bodies)
            if sums.ends.shape[0]:
                add_contacts(middle, sums.ends, sums.window, indentation, contact_force, sums.contacts)
        if every and (phase + index + 1) % every == 0:
            write_snapshot(y, middle, contact_force, snapshots, (phase + index + 1) // every - 1)
