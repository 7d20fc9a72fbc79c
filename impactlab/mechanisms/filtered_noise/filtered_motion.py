"""Linear motion under filtered white noise: the states of the filter and of the bodies as one linear system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlab.components.excitation import Excitation
from impactlab.components.filters import Filter
from impactlab.linear.noise_motion import NoiseMotion
from impactlab.linear.systems import LinearSystem
from impactlab.linear.transitions import (
    drift_matrix,
    gaussian_transition,
    lower_root,
    noise_root,
    with_delayed_response,
)


class FilteredSteps(NamedTuple):
    """What filter and bodies do in a step: the filter by ``z → M z + N ξ``, bodies by ``u → F u + R``.

    The rows of M and N are the states of the filter, then the response R of the bodies that begin the step at rest, and
    then, if there is an envelope, R to the force times what grows from -1 to 1 in the step. Displacement and velocity
    of a body follow each other; ξ are independent normal numbers.
    """

    motion: np.ndarray  # (row, state) M
    noise: np.ndarray  # (row, normal) N
    flow: np.ndarray  # (2 body, 2 body) F


@dataclass(frozen=True, eq=False)
class FilteredMotion(NoiseMotion):
    """What one filtered white noise moves."""

    name: str  # of the body or the source, which names its random numbers
    excitation: Excitation
    filter: Filter
    slots: np.ndarray  # (body,)
    system: LinearSystem  # of these bodies
    weights: np.ndarray  # (body,) of the force on each

    called = "filtered noise"

    @property
    def states(self) -> int:
        """Number of the states of the filter."""
        return len(self.filter.input)

    @property
    def drives(self) -> bool:
        return bool(self.filter.input.any())

    @property
    def _push(self) -> np.ndarray:
        """What the states of the filter add to the change of (x, v), (2 body, state)."""
        force = np.outer(self.weights / self.system.mass, self.filter.output)
        return np.concatenate([np.zeros_like(force), force])

    def _joint(self, drift: np.ndarray, push: np.ndarray) -> np.ndarray:
        """Return the drift of the states of the filter and of the bodies."""
        none = np.zeros((self.states, len(drift)))
        return np.block([[self.filter.drift, none], [push, drift]])

    def growth(self, size: int) -> np.ndarray:
        """Return the growth of the covariance of `size` states per time by the noise, filter states first."""
        given = np.zeros(size)
        given[: self.states] = self.filter.input
        return np.asarray(2.0 * np.pi * np.outer(given, given))

    @cached_property
    def drift(self) -> np.ndarray:
        """The drift of the states of the filter, then displacements and velocities of the bodies."""
        system = self.system
        return self._joint(drift_matrix(system.mass, system.damping, system.stiffness), self._push)

    @property
    def rate(self) -> float:
        """Bound of the eigenvalues of the drift (s-1)."""
        return max(self.filter.fastest, sum(self.system.scales))

    @cached_property
    def covariance(self) -> np.ndarray | None:
        """Stationary covariance of the filter's states, displacements and velocities; None if bodies have none.

        Displacements in free directions, which have no stationary law, are taken as 0. The bodies do
        not act back on the filter, so the blocks filter–filter, filter–body, body–body are solved in turn. The
        triangular form of the bodies' drift is the costly part, and all noises on them share it.
        """
        if not self.system.rates.all():
            return None
        own = lyapunov(self.filter.drift, self.growth(self.states))
        triangle, turned = self.system.triangular
        back, reduction = np.linalg.inv(turned), self.system.reduction
        push = back @ reduction @ self._push
        mixed = _triangular_solution(triangle, self.filter.drift, -push @ own)
        bodies = _triangular_solution(triangle, triangle, -push @ mixed.T - mixed @ push.T)
        whole = reduction.T @ turned
        return np.block([[own, mixed.T @ whole.T], [whole @ mixed, whole @ bodies @ whole.T]])

    def variances(self) -> np.ndarray:
        """Return the mean squares of displacement and velocity without envelope, infinite without a law, (2, body)."""
        if self.covariance is None:
            return np.where(self.filter.input.any() * np.ones((2, len(self.slots))), np.inf, 0.0)
        result = np.diag(self.covariance)[self.states :].reshape(2, -1).copy()
        result[0, self.system.free & (result[1] > 0.0)] = np.inf
        return result

    def start(self) -> np.ndarray:
        """Return a root of the covariance of all states where a run begins.

        Bodies are at rest there where they have no stationary law, or the noise has an envelope, or its filter is at
        rest.
        """
        count = self.states + 2 * len(self.slots)
        if self.covariance is not None and not (self.modulated or self.excitation.at_rest):
            return noise_root(self.covariance)
        result = np.zeros((count, count))
        own = slice(self.states)
        result[own, own] = noise_root(self.filter_start())
        return result

    def filter_start(self) -> np.ndarray:
        """Return the covariance of the filter's states where a run begins: stationary, or 0 if it is at rest there."""
        at_rest = np.zeros((self.states, self.states))
        return at_rest if self.excitation.at_rest else lyapunov(self.filter.drift, self.growth(self.states))

    def steps(self, step: float) -> FilteredSteps:
        """Return the exact transition over a step (s) of any length; within the step, an envelope is linear in time."""
        count, bodies = self.states, 2 * len(self.slots)
        drift = self.drift
        if self.modulated:
            drift = with_delayed_response(drift, count)
        a, q = gaussian_transition(drift[None], self.growth(len(drift))[None], step, self.rate)
        by_body = np.arange(bodies).reshape(2, -1).T.ravel()  # x and v of a body follow each other
        read = np.eye(len(drift))[np.concatenate([np.arange(count), *(
            first + by_body for first in range(count, len(drift), bodies)
        )])]  # fmt: skip
        if self.modulated:
            response, delayed = read[count : count + bodies], read[count + bodies :]
            read[count + bodies :] = response - 2.0 / step * delayed
        covariance = read @ q[0] @ read.T
        root = lower_root(covariance, np.diag(covariance))
        flow = a[0, count : count + bodies, count : count + bodies][np.ix_(by_body, by_body)]
        return FilteredSteps(read @ a[0, :, :count], root[:, root.any(axis=0)], flow)

    def own_steps(self, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return M and N of the states of the filter alone."""
        a, q = gaussian_transition(
            self.filter.drift[None], self.growth(self.states)[None], step, self.filter.fastest
        )  # fmt: skip
        root = lower_root(q[0], np.diag(q[0]))
        return a[0], root[:, root.any(axis=0)]

    def autocovariance(self, places: Sequence[int], factors: np.ndarray, lags: np.ndarray) -> np.ndarray:
        """Return ``E[q(t) q(t + lag)]`` of a weighted sum of displacements or velocities, places of (x, v), (lag,)."""
        from scipy.linalg import expm

        assert self.covariance is not None
        rows, result = [self.states + place for place in places], np.empty(len(lags))
        for index, lag in enumerate(lags):
            result[index] = factors @ expm(abs(lag) * self.drift)[rows] @ (self.covariance[:, rows] @ factors)
        return result

    def spectrum(self, along: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
        """Return the spectral density of a sum of displacements with weights, (body,), (m2 s rad-1), (frequency,)."""
        moved = self.system.receptance(along, frequencies) @ self.weights
        return np.asarray(np.abs(moved) ** 2 * self.filter.density(frequencies))


def _triangular_solution(first: np.ndarray, second: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Solve ``A X + X Bᵀ = given``, A being nearly triangular."""
    from scipy.linalg import schur
    from scipy.linalg.lapack import dtrsyl

    triangle, turned = (second, None) if second is first else schur(second)
    right = given if turned is None else given @ turned
    result, scale, _ = dtrsyl(first, triangle, right, tranb="T")
    result = result / scale
    return np.asarray(result if turned is None else result @ turned.T)


def lyapunov(drift: np.ndarray, growth: np.ndarray) -> np.ndarray:
    """Solve ``L P + P Lᵀ + growth = 0`` in units in which rows and columns of L are alike."""
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov

    _, (units, _) = matrix_balance(drift, permute=False, separate=True)
    drift, growth = drift * units / units[:, None], growth / np.outer(units, units)
    result = np.zeros_like(growth)
    for _ in range(2):  # what rounding leaves is solved for again
        result += solve_continuous_lyapunov(drift, -(growth + drift @ result + result @ drift.T))
    return np.asarray(result * np.outer(units, units))
