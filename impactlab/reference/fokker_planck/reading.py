"""What a density of (q, y, v₁, v₂) says: statistics, balances and marginal densities."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlab.reference.fokker_planck.propagator import Propagator
from impactlab.results.schema import CONTACT, Moments, OfBodies, sampled_of

_FINE = 4000

_FINER = 6
"""Places in a cell of the gap at which displacements are read: their densities may be as narrow as the contact."""


class Reading:
    """Statistics of a density at the moment before the last shear of a step.

    Second moments and velocities are (kick + 2 middle of the flow)/3, as in simulations by exact flow;
    contacts and displacements are read at the shifted places of the kick.
    """

    def __init__(self, propagator: Propagator, density: np.ndarray) -> None:
        self.propagator = propagator
        total = float(density.sum(dtype=float))
        own = propagator.marginals(density)
        self.weights = own[0].sum(axis=2) / total
        self._own = tuple(item / total for item in own)
        self._density = density

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """The stationary statistics, (2,) for bodies and (1,) for the contact."""
        propagator, pair = self.propagator, self.propagator.pair
        force = float((self.weights.sum(axis=1) * propagator.forces).sum())
        moments = [self._moments(body) for body in range(2)]
        means = pair.sign * np.array([-force, force]) / pair.stiffness
        squares, kinetic = np.array([item[0] for item in moments]).T
        linear = pair.mass, pair.damping, pair.stiffness
        bodies = OfBodies.of_law(linear, means, squares, squares - means**2, kinetic)
        gaps = self.weights.sum(axis=1)
        sampled = {
            item.name: (gaps * item.sample(propagator.gap, propagator.forces)).sum() for item in sampled_of(CONTACT)
        }
        known = {"contact_ratio": self._closed(), "contact_rate": self._rate(), "mean_contact_force": force}
        others = {name: np.array([value]) for name, value in (sampled | known).items()}
        return Moments(bodies, others, {}).values()

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

    def _moments(self, body: int) -> tuple[np.ndarray, float, float]:
        """Return E[x²] and E[v²], the force that is missing, and what a step changes, of one body."""
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
        return np.diag(between + 2.0 * middle) / 3.0, missing, change

    @cached_property
    def _at_contact(self) -> tuple[np.ndarray, float]:
        """Density of both velocities where the contact closes, and the temperature there over that of the box.

        As a function of q, that of the shifted gap is a trigonometric polynomial plus a part with its
        kink at 0: to leading order the density there times ``exp(−U/T)``, U being the energy of the
        contact and T the reduced mass times the mean square of the relative velocity (from
        the equation of momentum).
        """
        propagator = self.propagator
        gap, grid = propagator.gap, propagator.grid
        at_zero = grid.values(np.zeros(1))[0]
        density = propagator.in_kick(self._density).astype(float) / self._density.sum(dtype=float)
        there = np.tensordot(at_zero / grid.cells / propagator.stretch(gap), density, axes=(0, 0))
        square = float((there * np.subtract.outer(*propagator.velocities) ** 2).sum() / there.sum())
        hot = propagator.pair.reduced_mass * square / propagator.well.temperature
        return there / (1.0 + at_zero @ self._kink(gap, hot)), hot

    def _kink(self, gaps: np.ndarray, hot: float) -> np.ndarray:
        """Return the part with a kink of a density that is 1 where the contact closes, at one temperature over T."""
        reach = 0.3 * self.propagator.gap[-1]
        closed = np.maximum(gaps, 0.0)
        return np.asarray(np.exp(-((closed / reach) ** 2)) * np.expm1(-self.propagator.well.work(closed) / hot))

    def _closed(self) -> float:
        """Return the integral of the gap's density over closed contact."""
        gap, grid = self.propagator.gap, self.propagator.grid
        velocities, hot = self._at_contact
        there = float(velocities.sum())
        smooth = self.weights.sum(axis=1) / grid.cells / self.propagator.stretch(gap) - there * self._kink(gap, hot)
        places = np.linspace(0.0, grid.places[-1] + 0.5, _FINE)
        inside = grid.at(places)
        values = grid.values(places) @ smooth + there * self._kink(inside, hot)
        return float(np.trapezoid(values * self.propagator.stretch(inside), inside))

    def _rate(self) -> float:
        """Return the flux of the relative velocity through q = 0."""
        there = self._at_contact[0]
        nodes = self.propagator.velocities
        waves = np.arange(0.0, np.pi / max(float(v[1] - v[0]) for v in nodes), 0.5 * np.pi / sum(map(np.ptp, nodes)))
        first, second = (np.exp(-1j * np.outer(v, waves)) for v in nodes)
        characteristic = np.einsum("ab,ak,bk->k", there, first, second.conj(), optimize=True)
        rising = np.linspace(0.0, float(sum(map(np.ptp, nodes))) / 2.0, _FINE)
        return float(np.trapezoid(rising * Characteristic(waves, characteristic, 0.0).density(rising), rising))

    def displacement(self, body: int) -> Characteristic:
        """Return the characteristic function of a displacement."""
        propagator, grid, center = self.propagator, self.propagator.grid, self.propagator.center
        places = grid.places[0] + np.arange(_FINER * grid.count) / _FINER
        weights, gap = grid.values(places) @ self.weights / _FINER, grid.at(places)
        force = propagator.pair.force(gap - propagator.shifts.sum() * propagator.pair.force(gap))
        pushed = (-propagator.shifts[0], propagator.shifts[1])[body] * force
        x = propagator.pair.sign * (propagator.displacements_at(gap, center)[body] + pushed[:, None])
        cell = propagator.weights[1 - body] * grid.cells.max() / _FINER
        waves = np.arange(0.0, np.pi / max(cell, center[1] - center[0]), np.pi / np.ptp(x))
        values = np.array([(weights * np.exp(-1j * wave * x)).sum() for wave in waves])
        return Characteristic(waves, values, float((weights * x).sum()))

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
