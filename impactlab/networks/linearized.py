"""A network with closed contacts as a linear one: modes, and covariances in time and in steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.integrators.explicit import ExplicitIntegrator
from impactlab.integrators.kicks import kick_share
from impactlab.linear.systems import LinearSystem, stationary
from impactlab.linear.transitions import diffusion_matrix, drift_matrix
from impactlab.step_control.rules.tangent_stiffness import Stiffening


@dataclass(frozen=True, eq=False)
class LinearizedNetwork:
    """A network in which every contact is a two-sided spring of its tangent stiffness, or open.

    Attributes
    ----------
    model : Model
    held, braked : (body, body) ndarray
        Matrices of the linear motion: stiffness and damping of bodies, and of couplings
        that flow (N m-1, N s m-1).
    added, damping : (body, body) ndarray
        Matrices of what acts in the kick: stiffness of contacts, couplings and residual
        forces (N m-1), damping of couplings (N s m-1).
    """

    model: Model
    held: np.ndarray
    braked: np.ndarray
    added: np.ndarray
    damping: np.ndarray

    @classmethod
    def of(cls, model: Model, stiffening: Stiffening) -> LinearizedNetwork:
        """Linearize a network where its bodies have the energies of `stiffening`."""
        dampers = np.concatenate([np.zeros(len(model.ends)), model.couplings.linear[1]])
        kicking, springs = model.kicks.links, model.links.springs
        return cls(
            model,
            np.diag(model.stiffness) + springs(stiffening.links * ~kicking),
            np.diag(model.damping) + springs(dampers * ~kicking),
            springs(stiffening.links * kicking) + np.diag(stiffening.bodies),
            springs(dampers * kicking),
        )

    @classmethod
    def open(cls, model: Model) -> LinearizedNetwork:
        """Return the linear springs and dampers of a network alone, with all contacts open."""
        stiffness, damping = (model.coupled.springs(strengths) for strengths in model.couplings.linear)
        none = np.zeros_like(stiffness)
        return cls(model, np.diag(model.stiffness) + stiffness, np.diag(model.damping) + damping, none, none)

    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return undamped frequencies (rad s-1), and shapes as columns with ``φᵀ M φ = 1``."""
        from scipy.linalg import eigh  # loaded only here

        squares, shapes = eigh(self.held + self.added, np.diag(self.model.mass))
        return np.sqrt(np.maximum(squares, 0.0)), shapes

    def covariance(self) -> np.ndarray | None:
        """Return the stationary covariance of (x, v), (2 body, 2 body), None if there is none."""
        model = self.model
        noise = model.noise.matrix(np.arange(model.wall))
        system = LinearSystem(model.mass, self.braked + self.damping, self.held + self.added, noise)
        return None if system.free.any() else system.covariance

    def discrete_covariance(self, integrator: Integrator, step: float) -> np.ndarray | None:
        """Return the exact covariance of a method at a given step; None if it is not known.

        It is the solution of a discrete Lyapunov equation, infinite where that has none
        because the method is unstable.
        """
        if isinstance(integrator, ExactFlow) and not integrator.derived:
            return self._covariance_of_kicks(integrator, step)
        if isinstance(integrator, ExplicitIntegrator) and type(integrator).step is ExplicitIntegrator.step:
            return self._covariance_of_polynomial(integrator.stability_polynomial, step)
        return None

    def _covariance_of_polynomial(self, polynomial: Any, step: float) -> np.ndarray:
        """Covariance of ``z → R(hL) z + h (R(w) − 1)/w (hL) f``, noise f held constant over a step."""
        model = self.model
        scaled = step * drift_matrix(model.mass, self.braked + self.damping, self.held + self.added)
        growth, forcing = np.zeros_like(scaled), np.zeros_like(scaled)
        for coefficient in polynomial:  # Horner's scheme; what `forcing` lags behind is the division by w
            forcing = growth
            growth = growth @ scaled + coefficient * np.eye(len(scaled))
        diffusion = diffusion_matrix(model.mass, model.noise.matrix(np.arange(model.wall)))
        return stationary(growth, step * forcing @ diffusion @ forcing.T)

    def _covariance_of_kicks(self, integrator: ExactFlow, step: float) -> np.ndarray:
        """Covariance of flow and shifted kick, by Simpson's rule over kick and middle of the flow."""
        inverse = 1.0 / self.model.mass[:, None]
        unit = np.eye(len(inverse))
        shifted = self.added @ (unit - step**2 / 12.0 * inverse * self.added)
        by_x, by_v = -self.added if self.model.kicks.passes else -shifted, 0.0 * unit
        for _ in range(self.model.kicks.passes):  # with the velocity in the middle of the kick that forces so far make
            by_x, by_v = (
                -shifted - self.damping @ (0.5 * step * inverse * by_x),
                -self.damping @ (unit + 0.5 * step * inverse * by_v),
            )
        flows = integrator.flows(self.model, step)
        share = kick_share(self.model.damping / self.model.mass * step)
        for group in flows.groups:
            share[group.slots] = 0.5
        kick, half_kick = (
            np.block([[unit, 0.0 * unit], [part * inverse * by_x, unit + part * inverse * by_v]])
            for part in (step, step * share[:, None])
        )
        joints = zip(*(group[2:] for group in flows.groups), strict=True) if flows.groups else [()] * 4
        slots = [group.slots for group in flows.groups]
        a, q, middle_a, middle_q = (_joined(*parts, slots) for parts in zip(flows[:4], joints, strict=True))
        cycle, noise = np.eye(len(kick)), np.zeros_like(kick)
        for growth, covariance in zip(a, q, strict=True):
            cycle, noise = kick @ growth @ cycle, kick @ (growth @ noise @ growth.T + covariance) @ kick.T
        after = stationary(cycle, noise)
        if not np.isfinite(after).all():
            return after
        total = np.zeros_like(after)
        for flow, covariance, half, half_covariance in zip(a, q, middle_a, middle_q, strict=True):
            middle = half @ after @ half.T + half_covariance
            before = flow @ after @ flow.T + covariance
            after = kick @ before @ kick.T
            total += (half_kick @ before @ half_kick.T + 2.0 * middle) / 3.0
        return total / len(a)


def _joined(alone: np.ndarray, joints: Sequence[np.ndarray], slots: Sequence[np.ndarray]) -> np.ndarray:
    """Turn (phase, body, 2, 2) and the matrices of groups into those of all bodies, (phase, 2 body, 2 body)."""
    phases, count = alone.shape[:2]
    result = np.zeros((phases, 2, count, 2, count))
    index = np.arange(count)
    result[:, :, index, :, index] = np.moveaxis(alone, 1, 0)
    matrices = result.reshape(phases, 2 * count, 2 * count)
    for joint, group in zip(joints, slots, strict=True):
        both = np.concatenate([group, count + group])
        matrices[:, both[:, None], both] = joint
    return matrices
