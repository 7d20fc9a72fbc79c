"""The analytic solution of the paper, its condition, and the ratios of its linear systems.

Equation numbers are those of Luo, Yan and Zhang, ENG Transactions 4 (2023) 2868. The
solution is exact where the two temperatures are equal (Eq. 8). Elsewhere it is what the
paper draws: the linear law of each system, weighted with the contact at the temperature
of System 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.special import ndtr

from impactlab import LinearOscillator, Network, ShinozukaNoise

CORRECTED_EXPONENT = 2.5
"""Exponent of the Hertz potential, the integral of the force of Eq. 2."""

PRINTED_EXPONENT = 1.5
"""Exponent that Eqs. 10 and 12 print."""

_TAIL = 9.5  # standard deviations that a quadrature covers; the rest is below 1e-20
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(128)
_BIN_NODES, _BIN_WEIGHTS = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True)
class AnalyticSolution:
    """Stationary density of Eqs. 10 to 13, with the exponent of the potential as an option.

    Parameters
    ----------
    masses, dampings, stiffnesses, spectral_densities : tuple of float
        Mass (kg), damping (N s m-1), stiffness (N m-1) and two-sided spectral density of
        the force (N2 s rad-1) of System 1 and System 2.
    contact_stiffness : float
        Stiffness η of the Hertz contact (N m-3/2).
    clearance : float
        Clearance d (m).
    exponent : float
        Exponent of the indentation in the contact potential: 5/2, or 3/2 as printed.
    """

    masses: tuple[float, float]
    dampings: tuple[float, float]
    stiffnesses: tuple[float, float]
    spectral_densities: tuple[float, float]
    contact_stiffness: float
    clearance: float
    exponent: float = CORRECTED_EXPONENT

    @classmethod
    def of(cls, network: Network, exponent: float = CORRECTED_EXPONENT) -> Self:
        """Read the parameters of the pair ``one``, ``two`` with its contact ``gap``."""
        bodies = [network.oscillators[name] for name in ("one", "two")]
        noises: list[Any] = [network.excitations[name] for name in ("one", "two")]
        law: Any = network.contacts["gap"].law
        return cls(
            masses=(bodies[0].mass, bodies[1].mass),
            dampings=(bodies[0].damping, bodies[1].damping),
            stiffnesses=(bodies[0].stiffness, bodies[1].stiffness),
            spectral_densities=(noises[0].spectral_density, noises[1].spectral_density),
            contact_stiffness=law.stiffness,
            clearance=network.contacts["gap"].clearance,
            exponent=exponent,
        )

    @property
    def temperatures(self) -> np.ndarray:
        """Temperature πS/c of each system (J): m σ_v² and k σ_x² of Eq. 10."""
        return math.pi * np.divide(self.spectral_densities, self.dampings)

    @property
    def linear_mean_square_displacement(self) -> np.ndarray:
        """σ_x² = πS/(ck) of the linear systems (m2), below Eq. 10."""
        return np.asarray(self.temperatures / np.array(self.stiffnesses))

    @property
    def linear_mean_square_velocity(self) -> np.ndarray:
        """σ_v² = πS/(cm) of the linear systems (m2 s-2), below Eq. 10."""
        return np.asarray(self.temperatures / np.array(self.masses))

    @property
    def velocity_ratio(self) -> float:
        """C_DV of Eq. 17; for equal masses the left side of Eq. 9, which is 1 where Eq. 8 holds."""
        first, second = self.linear_mean_square_velocity
        return float(first / second)

    @property
    def displacement_ratio(self) -> float:
        """C_DX of Eq. 17."""
        first, second = self.linear_mean_square_displacement
        return float(first / second)

    @property
    def condition_holds(self) -> bool:
        """Whether assumption (2), Eq. 8, holds: the two temperatures are equal."""
        first, second = self.temperatures
        return math.isclose(first, second, rel_tol=1e-9)

    def potential(self, indentation: np.ndarray) -> np.ndarray:
        """Contact potential (J) as it stands in the exponent of Eq. 10."""
        return np.asarray(0.4 * self.contact_stiffness * np.maximum(indentation, 0.0) ** self.exponent)

    def force(self, indentation: np.ndarray) -> np.ndarray:
        """Contact force of Eq. 2 (N), whatever the exponent of the potential."""
        return np.asarray(self.contact_stiffness * np.maximum(indentation, 0.0) ** 1.5)

    def log_density(self, displacement: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Logarithm of Eq. 10 without its constant; arrays have the two systems first."""
        x, v = np.asarray(displacement, dtype=float), np.asarray(velocity, dtype=float)
        column = (2,) + (1,) * (x.ndim - 1)
        quadratic = x**2 / self.linear_mean_square_displacement.reshape(column)
        quadratic = quadratic + v**2 / self.linear_mean_square_velocity.reshape(column)
        energy = self.potential(x[0] - x[1] - self.clearance)
        return np.asarray(-0.5 * quadratic.sum(axis=0) - energy / self.temperatures[0])

    def statistics(self) -> dict[str, np.ndarray]:
        """Moments of Eqs. 12 and 18, contact ratio and mean contact force, by the names of `simulate`.

        The gap coordinate x1 − x2 is integrated numerically; given it the displacements
        are Gaussian.
        """
        variances = self.linear_mean_square_displacement
        total = variances.sum()
        scale = math.sqrt(total)
        low = np.array([min(-_TAIL * scale, self.clearance)])
        open_gap, open_weight = _panel(low, np.array([self.clearance]))
        closed, closed_weight = self._closed(np.array([-self.clearance]), scale)
        gap = np.concatenate([open_gap[0], closed[0] + self.clearance])
        density = np.exp(-0.5 * gap**2 / total - self.potential(gap - self.clearance) / self.temperatures[0])
        weight = density * np.concatenate([open_weight[0], closed_weight[0]])
        weight /= weight.sum()
        mean = float(weight @ gap)
        variance = float(weight @ (gap - mean) ** 2)
        share = np.array([1.0, -1.0]) * variances / total
        mean_displacement = share * mean
        variance_displacement = share**2 * variance + variances.prod() / total
        return {
            "mean_displacement": mean_displacement,
            "mean_square_displacement": variance_displacement + mean_displacement**2,
            "variance_displacement": variance_displacement,
            "mean_velocity": np.zeros(2),
            "mean_square_velocity": self.linear_mean_square_velocity,
            "contact_ratio": np.array([weight[gap > self.clearance].sum()]),
            "mean_contact_force": np.array([weight @ self.force(gap - self.clearance)]),
        }

    def density(self, system: int, quantity: str, points: np.ndarray) -> np.ndarray:
        """Marginal density of Eq. 12.

        Parameters
        ----------
        system : int
            0 for System 1, 1 for System 2.
        quantity : str
            "displacement" or "velocity".
        points : ndarray
            Values of the quantity (m or m s-1).

        Returns
        -------
        ndarray
            Density (m-1 or s m-1).
        """
        points = np.asarray(points, dtype=float)
        if quantity == "velocity":
            return _normal(points, self.linear_mean_square_velocity[system])
        variances = self.linear_mean_square_displacement
        toward = points if system == 0 else -points
        other = math.sqrt(variances[1 - system])
        mean = self._boltzmann_mean(toward.ravel() - self.clearance, other).reshape(points.shape)
        constant = self._boltzmann_mean(np.array([-self.clearance]), math.sqrt(variances.sum()))
        return np.asarray(_normal(points, variances[system]) * mean / constant)

    def bin_density(self, system: int, quantity: str, edges: np.ndarray) -> np.ndarray:
        """Averages of the marginal density over the bins between the edges."""
        points, weights = _panel(edges[:-1], edges[1:], _BIN_NODES, _BIN_WEIGHTS)
        return np.asarray((self.density(system, quantity, points) * weights).sum(axis=-1) / np.diff(edges))

    def _closed(self, offset: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and weights for closed contacts, the indentation being N(offset, scale²) before its energy.

        The square root of the indentation is the variable, in which the potential is smooth.
        """
        deepest = (50.0 * self.temperatures[0] / (0.4 * self.contact_stiffness)) ** (1.0 / self.exponent)
        low = np.clip(offset - _TAIL * scale, 0.0, deepest)
        high = np.clip(offset + _TAIL * scale, 0.0, deepest)
        root, weight = _panel(np.sqrt(low), np.sqrt(high))
        return root**2, 2.0 * root * weight

    def _boltzmann_mean(self, offset: np.ndarray, scale: float) -> np.ndarray:
        """Mean of exp(−U(δ)/T1) over indentations δ = offset + scale × normal."""
        nodes, weights = self._closed(offset, scale)
        values = _normal(nodes - offset[:, None], scale**2) * np.exp(-self.potential(nodes) / self.temperatures[0])
        return np.asarray(ndtr(-offset / scale) + (values * weights).sum(axis=-1))


def fokker_planck_residual(
    solution: AnalyticSolution,
    displacement: np.ndarray,
    velocity: np.ndarray,
    log_density: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Left side of the stationary Fokker-Planck equation, Eq. 4, divided by the density (s-1).

    Derivatives of the logarithm of the density are taken by central differences, so that
    nothing of the derivation of Eq. 10 is used.

    Parameters
    ----------
    solution : AnalyticSolution
        The system, and by default the density.
    displacement, velocity : ndarray
        States, the two systems first.
    log_density : callable, optional
        Another density of the same arguments.
    """
    log_density = log_density or solution.log_density
    force = solution.force(displacement[0] - displacement[1] - solution.clearance)
    center = log_density(displacement, velocity)
    residual = np.zeros_like(center)
    for i, sign in enumerate((1.0, -1.0)):
        mass, damping = solution.masses[i], solution.dampings[i]
        step = 1e-4 * np.sqrt([solution.linear_mean_square_displacement[i], solution.linear_mean_square_velocity[i]])
        unit = np.zeros(displacement.shape)
        unit[i] = 1.0
        ahead, behind = (log_density(displacement + side * step[0] * unit, velocity) for side in (1, -1))
        by_displacement = (ahead - behind) / (2.0 * step[0])
        ahead, behind = (log_density(displacement, velocity + side * step[1] * unit) for side in (1, -1))
        by_velocity = (ahead - behind) / (2.0 * step[1])
        curvature = (ahead - 2.0 * center + behind) / step[1] ** 2
        opposing = damping * velocity[i] + solution.stiffnesses[i] * displacement[i] + sign * force
        diffusion = math.pi * solution.spectral_densities[i] / mass**2
        residual += damping / mass - velocity[i] * by_displacement + opposing / mass * by_velocity
        residual += diffusion * (curvature + by_velocity**2)
    return residual


def _panel(
    low: np.ndarray, high: np.ndarray, nodes: np.ndarray = _NODES, weights: np.ndarray = _WEIGHTS
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights between each low and high, along a new last axis."""
    half = 0.5 * (high - low)[..., None]
    return 0.5 * (high + low)[..., None] + half * nodes, half * weights


def _normal(values: np.ndarray, variance: float) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * values**2 / variance) / math.sqrt(2.0 * math.pi * variance))


def runge_kutta_mean_square(oscillator: LinearOscillator, noise: ShinozukaNoise, step: float) -> float:
    """Return the stationary mean square displacement that RK4 makes of a linear system under a series (m2).

    The scheme's response to each cosine is known: with one step `x → R x + r`, a line of
    angular frequency ω has the response `(exp(iωh) − R)⁻¹ r`. It shows what the step alone
    changes, as no contact and no chance is in it.
    """
    frequency, amplitude = noise.lines()
    matrix = np.array([[0.0, 1.0], [-oscillator.stiffness, -oscillator.damping]])
    matrix[1] /= oscillator.mass
    half = np.exp(0.5j * frequency * step)

    def slope(state: np.ndarray, force: np.ndarray) -> np.ndarray:
        result: np.ndarray = matrix @ state
        result[1] += force / oscillator.mass
        return result

    def advance(state: np.ndarray, forces: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
        first = slope(state, forces[0])
        second = slope(state + 0.5 * step * first, forces[1])
        third = slope(state + 0.5 * step * second, forces[1])
        fourth = slope(state + step * third, forces[2])
        return np.asarray(state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth))

    none = np.zeros(1, dtype=complex)
    growth = np.hstack([advance(unit[:, None].astype(complex), (none, none, none)) for unit in np.eye(2)])
    forced = advance(np.zeros((2, frequency.size), dtype=complex), (np.ones_like(half), half, half**2))
    turned = half**2
    # (turned − growth)⁻¹ forced, by Cramer's rule for all lines at once
    determinant = (turned - growth[0, 0]) * (turned - growth[1, 1]) - growth[0, 1] * growth[1, 0]
    response = ((turned - growth[1, 1]) * forced[0] + growth[0, 1] * forced[1]) / determinant
    return float(0.5 * (amplitude**2 * np.abs(response) ** 2).sum())
