"""What a density of (q, y, v₁, v₂) says: statistics, balances and marginal densities."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlab.phase_space.propagator import Propagator

_FINE = 4000


class Reading:
    """Statistics of a density at the moment before the last shear of a step.

    Second moments and velocities are (kick + 2 middle of the flow)/3, as in simulations by exact flow;
    contacts and displacements are read at the shifted places of the kick.
    """

    def __init__(self, propagator: Propagator, density: np.ndarray) -> None:
        self.propagator = propagator
        total = float(density.sum(dtype=float))
        own = (density.sum(axis=3, dtype=float), density.sum(axis=2, dtype=float))
        self.weights = own[0].sum(axis=2) / total
        self._own = tuple(item / total for item in own)
        self._density = density

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """The default statistics but the peak force, (2,) for bodies and (1,) for the contact."""
        propagator, pair = self.propagator, self.propagator.pair
        force = float((self.weights.sum(axis=1) * propagator.forces).sum())
        moments = [self._moments(body) for body in range(2)]
        means = np.array([-force, force]) / pair.stiffness
        squares, kinetic = np.array([item[0] for item in moments]).T
        return {
            "mean_displacement": means,
            "mean_square_displacement": squares,
            "variance_displacement": squares - means**2,
            "mean_velocity": np.zeros(2),
            "mean_square_velocity": kinetic,
            "contact_ratio": np.array([self._closed()]),
            "contact_rate": np.array([self._rate()]),
            "mean_contact_force": np.array([force]),
        }

    @cached_property
    def balances(self) -> dict[str, np.ndarray]:
        """What should be 0: forces relative to that of the contact; moments before and after a step; power."""
        pair, values = self.propagator.pair, self.values
        force = values["mean_contact_force"][0]
        power = (pair.damping * values["mean_square_velocity"]).sum()
        supplied = (np.pi * pair.intensity / pair.mass).sum()
        return {
            "balance_force": np.array([self._moments(body)[1] for body in range(2)]) / force,
            "balance_moments": np.array([self._moments(body)[2] for body in range(2)]),
            "balance_power": np.array([power / supplied - 1.0]),
        }

    def _moments(self, body: int) -> tuple[np.ndarray, float, float, float]:
        """Return E[x²] and E[v²], the force that is missing, what a step changes, and E[v²] at kicks, of one body."""
        propagator = self.propagator
        x, v, shears = propagator.displacements[body], propagator.velocities[body], propagator.shears[body]
        kick = propagator.increments[body]
        mass, first, second = self.weights, self._own[body] @ v, self._own[body] @ v**2
        second = second - 2.0 * shears.last * x * first + (shears.last * x) ** 2 * mass
        first = first - shears.last * x * mass  # of the velocity before the kick

        def moments(part: float) -> np.ndarray:  # of x and the velocity after a part of the kick
            xv = (x * (first + part * kick * mass)).sum()
            vv = (second + 2.0 * part * kick * first + (part * kick) ** 2 * mass).sum()
            return np.array([[(x * x * mass).sum(), xv], [xv, vv]])

        a, q = (item[body] for item in propagator.flow)
        half_a, half_q = (item[body] for item in propagator.transition(0.5 * propagator.basis.step))
        before, between, after = moments(0.0), moments(0.5), moments(1.0)
        middle = half_a @ after @ half_a.T + half_q
        scale = np.sqrt(np.outer(np.diag(before), np.diag(before)))
        change = float(np.abs((a @ after @ a.T + q - before) / scale).max())
        response = np.linalg.solve(np.eye(2) - a, a @ np.array([0.0, (kick * mass).sum()]))
        missing = float((x * mass).sum() - response[0]) * propagator.pair.stiffness[body]
        return np.diag(between + 2.0 * middle) / 3.0, missing, change, float(between[1, 1])

    def _closed(self) -> float:
        """Return the integral of the gap's density over closed contact.

        The density is a trigonometric polynomial plus a part with its kink at 0: to leading order
        the density at 0 times ``exp(−U/T)``, U being the energy of the contact and T the mean square of
        the relative velocity there, times the reduced mass (from the equation of momentum).
        """
        well, (there, square) = self.propagator.well, self._at_contact
        hot = well.temperature / (self.propagator.pair.reduced_mass * square)
        gap, cell = self.propagator.gap, self.propagator.gap[1] - self.propagator.gap[0]
        last, reach = gap[-1] + 0.5 * cell, 0.3 * self.propagator.gap[-1]

        def kink(places: np.ndarray) -> np.ndarray:
            return np.asarray(there * np.exp(-((places / reach) ** 2)) * np.expm1(-hot * well.work(places)))

        smooth = self.weights.sum(axis=1) / cell - np.where(gap > 0.0, kink(np.maximum(gap, 0.0)), 0.0)
        waves = 2.0 * np.pi * np.fft.fftfreq(len(gap), cell)
        coefficients = np.fft.fft(smooth)[1:] / (1j * waves[1:])
        phases = np.exp(1j * np.outer((last - gap[0], -gap[0]), waves[1:])) @ coefficients
        inside = np.linspace(0.0, last, _FINE)
        polynomial = (phases[0] - phases[1]).real + smooth.sum() * last
        return float(polynomial / len(gap) + np.trapezoid(kink(inside), inside))

    @cached_property
    def _near(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Density of y, v₁ and v₂ at q = 0, times their cell, and both velocities, (center, node)."""
        propagator = self.propagator
        gap, cell = propagator.gap, propagator.gap[1] - propagator.gap[0]
        waves = 2.0 * np.pi * np.fft.fftfreq(len(gap), cell)
        at_zero = np.exp(1j * np.outer(-gap, waves)).sum(axis=1).real / len(gap) / cell
        near = np.tensordot(at_zero, self._density, axes=(0, 0)) / self._density.sum(dtype=float)
        weights, clearance = propagator.pair.weights, propagator.pair.contact.clearance
        velocities = [
            nodes - shears.last * (propagator.center + weight * clearance)[:, None]
            for nodes, shears, weight in zip(
                propagator.velocities, propagator.shears, (weights[1], -weights[0]), strict=True
            )
        ]
        return near, velocities

    @cached_property
    def _at_contact(self) -> tuple[float, float]:
        """Density of q at 0 (m-1), and mean square of the relative velocity there (m2 s-2)."""
        near, (first, second) = self._near
        density = float(near.sum())
        relative = first[:, :, None] - second[:, None, :]
        return density, float((near * relative**2).sum()) / density

    def _rate(self) -> float:
        """Return the flux of the relative velocity through q = 0.

        The velocity at kicks is a little too small; it is scaled to the mean square of the time between.
        """
        near, (first, second) = self._near
        scale = float(np.sqrt(self._at_contact[1]))
        nodes = self.propagator.velocities
        most = np.pi / max(float(v[1] - v[0]) for v in nodes)
        waves = np.arange(0.0, most, 0.5 * np.pi / sum(map(np.ptp, nodes)))
        parts = [np.exp(-1j * item[..., None] * waves) for item in (first, -second)]
        characteristic = np.einsum("yab,yak,ybk->k", near, *parts, optimize=True)
        rising = np.linspace(0.0, 12.0 * scale, _FINE)
        flux = float(np.trapezoid(rising * Characteristic(waves, characteristic, 0.0).density(rising), rising))
        at_kicks, over_time = (sum(self._moments(body)[part] for body in range(2)) for part in (3, 0))
        return flux * float(np.sqrt(over_time[1] / at_kicks))

    def displacement(self, body: int) -> Characteristic:
        """Return the characteristic function of a displacement."""
        propagator = self.propagator
        x = propagator.displacements[body] + propagator.basis.step / 12.0 * propagator.increments[body]
        weight = propagator.pair.weights[1 - body]
        cells = propagator.gap[1] - propagator.gap[0], propagator.center[1] - propagator.center[0]
        waves = np.arange(0.0, np.pi / max(weight * cells[0], cells[1]), np.pi / np.ptp(x))
        values = np.array([(self.weights * np.exp(-1j * wave * x)).sum() for wave in waves])
        return Characteristic(waves, values, float((self.weights * x).sum()))

    def velocity(self, body: int) -> Characteristic:
        """Return the characteristic function of a velocity."""
        propagator = self.propagator
        x, v, shears = propagator.displacements[body], propagator.velocities[body], propagator.shears[body]
        a, q = (item[body] for item in propagator.transition(0.5 * propagator.basis.step))
        kick = propagator.increments[body]
        waves = np.arange(0.0, np.pi / (v[1] - v[0]), np.pi / np.ptp(v))
        result = []
        for wave in waves:
            of_v = {part: self._own[body] @ np.exp(-1j * part * wave * v) for part in (1.0, a[1, 1])}
            between = of_v[1.0] * np.exp(-1j * wave * (0.5 * kick - shears.last * x))
            after = a[1, 0] * x + a[1, 1] * (kick - shears.last * x)
            middle = of_v[a[1, 1]] * np.exp(-1j * wave * after) * np.exp(-0.5 * wave**2 * q[1, 1])
            result.append((between + 2.0 * middle).sum() / 3.0)
        return Characteristic(waves, np.array(result), 0.0)


class Characteristic(NamedTuple):
    """Characteristic function ``E exp(−i k x)`` of a quantity x at equally spaced wave numbers k from 0 on."""

    waves: np.ndarray
    values: np.ndarray
    mean: float

    def density(self, places: np.ndarray) -> np.ndarray:
        """Return the density at some places."""
        weights = np.full(len(self.waves), self.waves[1] / np.pi)
        weights[0] *= 0.5
        return np.asarray((np.exp(1j * np.outer(places, self.waves)) @ (weights * self.values)).real)

    def probability_below(self, places: np.ndarray) -> np.ndarray:
        """Return the probability of less than some places (Gil-Pelaez, Biometrika 38, 1951, 481)."""
        weights = self.waves[1] / np.pi * self.values[1:] / (1j * self.waves[1:])
        at_zero = self.waves[1] / (2.0 * np.pi) * (places - self.mean)
        return np.asarray(0.5 + (np.exp(1j * np.outer(places, self.waves[1:])) @ weights).real + at_zero)
