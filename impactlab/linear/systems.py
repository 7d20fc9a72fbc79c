"""Bodies on springs and dampers under white noise, as matrices: rates, stationary covariance, receptance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impactlab.allowed_time import check_time
from impactlab.components.matrices import ZERO
from impactlab.errors import InvalidInput
from impactlab.linear.large_matrices import eigenvalues, eigh, lyapunov_solution, schur
from impactlab.linear.transitions import van_loan
from impactlab.machine import NUMBERS_AT_A_TIME
from impactlab.memory_limits import available

LARGE, APART, MOST_APART = 1e6, 1e6, 1e12
"""Largest entry of a drift by the fastest rate at which rates are found in SI units; by the slowest rate at which its
Lyapunov equation is solved as it is, and at which there is a covariance at all."""

DENSE_SECONDS, STIFF_SECONDS = 1e-9, 1e-8
"""Time that rates or a covariance take over the cube of the rows on one core, and where rates lie far apart (s)."""

COPIES = 8
"""Matrices of all rows that are in memory at once while a covariance is found."""


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """Bodies on springs and dampers under white noise, ``M x'' + C x' + K x = f``.

    Displacements in which no spring holds the bodies (rows of K that add up to 0) are left
    out of the state, so that the velocities of free bodies have their law.
    """

    mass: np.ndarray  # (body,) diagonal of M (kg)
    damping: np.ndarray  # (body, body) C (N s m-1)
    stiffness: np.ndarray  # (body, body) K (N m-1)
    intensity: np.ndarray  # (body, body) two-sided spectral densities of the white noises and between them (N2 s rad-1)

    @cached_property
    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the directions that springs hold, and the free ones, as columns."""
        stiffness, directions = eigh(self.stiffness)
        held = stiffness > ZERO * stiffness[-1]
        return directions[:, held], directions[:, ~held]

    @property
    def free(self) -> np.ndarray:
        """Whether no spring holds each body, (body,) of bool."""
        return np.asarray((np.abs(self.directions[1]) > 1e-6).any(axis=1))

    @cached_property
    def drift(self) -> np.ndarray:
        """Return the matrix L of ``(z, v)' = L (z, v)``; z are the displacements in the held directions."""
        held, inverse = self.directions[0], 1.0 / self.mass[:, None]
        none = np.zeros((held.shape[1], held.shape[1]))
        return np.block([[none, held.T], [-inverse * (self.stiffness @ held), -inverse * self.damping]])

    @cached_property
    def reduction(self) -> np.ndarray:
        """Return the matrix, of orthonormal rows, that takes (x, v) to (z, v)."""
        held = self.directions[0]
        count, kept = held.shape
        result = np.zeros((kept + count, 2 * count))
        result[:kept, :count], result[kept:, count:] = held.T, np.eye(count)
        return result

    @cached_property
    def scales(self) -> tuple[float, float]:
        """Return the largest undamped frequency, and the largest rate of the dampers alone (s-1)."""
        root = 1.0 / np.sqrt(self.mass)
        largest = [
            float(np.linalg.eigvalsh(root[:, None] * part * root)[-1]) for part in (self.stiffness, self.damping)
        ]
        return math.sqrt(max(largest[0], 0.0)), max(largest[1], 0.0)

    @cached_property
    def oscillation(self) -> float:
        """Return the largest frequency of motions that oscillate (s-1), 0 if none does."""
        values = eigenvalues(self.units[:, None] * self.drift / self.units)
        return float(np.abs(values[np.abs(values.imag) > ZERO * np.abs(values)]).max(initial=0.0))

    @property
    def units(self) -> np.ndarray:
        """Return units of (z, v) in which no entry of the drift is much larger than the fastest rate."""
        count = self.directions[0].shape[1]
        return np.concatenate([np.full(count, math.sqrt(np.abs(self.stiffness).max())), np.sqrt(self.mass)])

    @cached_property
    def rates(self) -> np.ndarray:
        """Return the rates at which motions decay (s-1), exactly 0 for those that are not damped."""
        self._check(DENSE_SECONDS)
        drift, units = self.drift, self.units
        if np.abs(drift).max() > LARGE * max(self.scales):
            drift = units[:, None] * drift / units
        values = eigenvalues(drift)
        return np.where(-values.real > ZERO * np.abs(values).max(), -values.real, 0.0)

    def _check(self, seconds: float) -> None:
        """Refuse a system that is too large, of which a matrix takes so many seconds times the cube of its rows."""
        rows = len(self.drift)
        needed, there = 8.0 * COPIES * rows**2, available()
        task = f"The linear motion of {len(self.mass)} bodies that couplings connect"
        if needed > there:
            raise InvalidInput(
                f"{task} would take {needed / 1e9:.3g} GB of memory, but {there / 1e9:.3g} GB are available; give a "
                "smaller network."
            )
        check_time(task, seconds * rows**3)

    @cached_property
    def triangular(self) -> tuple[np.ndarray, np.ndarray]:
        """Return T and R of ``drift = R T R⁻¹``, T being nearly triangular, and R orthogonal but for units."""
        from scipy.linalg import matrix_balance

        _, (units, _) = matrix_balance(self.drift, permute=False, separate=True)
        triangle, turned = schur(self.drift * units / units[:, None])
        return triangle, units[:, None] * turned

    @cached_property
    def covariance(self) -> np.ndarray | None:
        """Return the stationary covariance of (x, v), (2 body, 2 body), None if there is none.

        There is none either where rates lie so far apart that it cannot be computed.
        Displacements in free directions, which have no stationary law, are taken as 0.
        """
        if not self.intensity.any():
            return np.zeros((2 * len(self.mass), 2 * len(self.mass)))
        if not self.rates.all():
            return None
        held = self.directions[0].shape[1]
        growth = np.zeros(self.drift.shape)
        growth[held:, held:] = 2.0 * np.pi * self.intensity / np.outer(self.mass, self.mass)
        largest, slowest = np.abs(self.drift).max(), self.rates.min()
        if largest <= APART * slowest:
            self._check(DENSE_SECONDS)
            reduced = lyapunov_solution(self.drift, growth)
        else:
            units = self.units
            drift = units[:, None] * self.drift / units
            if np.abs(drift).max() > MOST_APART * slowest:
                return None
            self._check(STIFF_SECONDS)
            reduced = stationary(*_over_step(drift, np.outer(units, units) * growth)) / np.outer(units, units)
        return np.asarray(self.reduction.T @ reduced @ self.reduction)

    def thermal_covariance(self, temperature: float) -> np.ndarray:
        """Return the covariance of (x, v) at one temperature (J), ``T K⁻¹`` and ``T M⁻¹``."""
        result = np.zeros((2 * len(self.mass), 2 * len(self.mass)))
        count = len(self.mass)
        result[:count, :count] = temperature * np.linalg.pinv(self.stiffness, rcond=ZERO, hermitian=True)
        result[count:, count:] = np.diag(temperature / self.mass)
        return result

    def variances(self) -> np.ndarray:
        """Return the mean squares of displacement and velocity, infinite where there is no law, (2, body)."""
        covariance = self.covariance
        if covariance is None:
            return np.full((2, len(self.mass)), np.inf)
        result = np.diag(covariance).reshape(2, -1).copy()
        result[0, self.free & (result[1] > 0.0)] = np.inf
        return result

    def flexibility(self) -> np.ndarray:
        """Return the displacement of each body by a unit force on it, infinite for a free one (m N-1)."""
        own = np.diag(self.thermal_covariance(1.0))[: len(self.mass)]
        return np.where(self.free, np.inf, own)

    def receptance(self, along: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
        """Return the complex displacements by a force on bodies with weights, (body,); (frequency, body) (m N-1).

        As the matrices are symmetric, so does the weighted sum of displacements answer to a force on each body.
        """
        force = along[:, None]
        parts = []
        for omega in np.array_split(frequencies, int(frequencies.size * self.stiffness.size / NUMBERS_AT_A_TIME) + 1):
            omega = omega[:, None, None]
            dynamic = self.stiffness - np.diag(self.mass) * omega**2 + 1j * omega * self.damping
            try:
                parts.append(np.linalg.solve(dynamic, np.broadcast_to(force, (len(omega), *force.shape)))[..., 0])
            except np.linalg.LinAlgError:  # a line meets an undamped mode
                parts.append(np.full((len(omega), len(self.mass)), np.inf, dtype=complex))
        return np.concatenate(parts)


def _over_step(drift: np.ndarray, growth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return transition and covariance of a motion over a short time, by Van Loan's block exponential."""
    from scipy.linalg import expm

    step, count = 1.0 / np.abs(drift).max(), len(drift)
    block = expm(step * van_loan(drift, growth))
    transition = block[count:, count:].T
    return transition, transition @ block[:count, count:]


def stationary(transition: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Solve ``P = A P Aᵀ + Q`` as a sum over steps whose number is doubled until it grows no more.

    All terms are positive, so that nothing cancels, whatever the units. Infinite if A is not stable.
    """
    nowhere = np.full(transition.shape, np.inf)
    if not np.isfinite(transition).all() or np.abs(np.linalg.eigvals(transition)).max() >= 1.0:
        return nowhere
    for _ in range(60):
        more = transition @ covariance @ transition.T
        covariance, transition = covariance + more, transition @ transition
        if not (np.abs(np.diag(more)) > 1e-17 * np.diag(covariance)).any():
            return covariance
    return nowhere
