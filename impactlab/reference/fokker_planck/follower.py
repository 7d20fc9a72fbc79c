"""One step of the density of two bodies, the first of which follows the second: Hermite functions for its state."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from impactlab.kernels.phases import turn
from impactlab.reference.fokker_planck.pair import Well
from impactlab.reference.fokker_planck.propagator import Basis, Propagator, Shears, shifting
from impactlab.reference.fokker_planck.waves import planes, symmetric

_ABSORBED, _POWER = 3.0, 4
"""Rate at which functions of the highest degree are absorbed, in frequencies of the pair, and the power of the degree.

Without it those that kicks make where the contact is deepest, and few functions do not resolve, grow without end.
Moments of first and second degree are kept."""

_READ, _REACH = 35, 7.0
"""Equally spaced nodes at which the law of the first body is read, and their reach in standard deviations."""


class Hermite:
    """Hermite functions of a coordinate in units of a standard deviation, and the nodes of Gauss that belong to them.

    A density is a normal one times a polynomial; its values are the probabilities of the nodes.
    """

    def __init__(self, count: int) -> None:
        self.nodes, weights = np.polynomial.hermite_e.hermegauss(count)
        self.weights = weights / weights.sum()
        self.onto = self.polynomials(self.nodes, count).T  # from probabilities to coefficients
        self.off = self.weights[:, None] * self.onto.T  # back

    @staticmethod
    def polynomials(places: np.ndarray, count: int) -> np.ndarray:
        """Return the orthonormal polynomials at some places, (place, polynomial)."""
        result = np.ones((len(places), count))
        for n in range(1, count):
            result[:, n] = places * result[:, n - 1]
            if n > 1:
                result[:, n] -= math.sqrt(n - 1) * result[:, n - 2]
            result[:, n] /= math.sqrt(n)
        return result

    @staticmethod
    def raising(count: int) -> np.ndarray:
        """Return the matrix of minus the derivative: it takes each function to the next one."""
        return np.diag(np.sqrt(np.arange(1.0, count)), -1)

    def shifting(self, shifts: np.ndarray) -> np.ndarray:
        """Return the matrices that shift densities at the nodes, (…, node, node), by amounts (…)."""
        count = len(self.nodes)
        power, result = np.eye(count), np.zeros((*shifts.shape, count, count))
        for n in range(count):
            result += (shifts**n / math.factorial(n))[..., None, None] * power
            power = power @ self.raising(count)
        return np.asarray(self.off @ result @ self.onto)

    def read(self, places: np.ndarray) -> np.ndarray:
        """Return the matrix from probabilities of the nodes to those of the cells of equally spaced places."""
        normal = np.exp(-0.5 * places**2) / math.sqrt(2.0 * math.pi) * (places[1] - places[0])
        return np.asarray(normal[:, None] * (self.polynomials(places, len(self.nodes)) @ self.onto))

    def taken_from(self, other: Hermite) -> np.ndarray:
        """Return the matrix from the nodes of another number of functions to these."""
        common = min(len(self.nodes), len(other.nodes))
        return np.asarray(self.off[:, :common] @ other.onto[:common])


class Follower(Propagator):
    """The step where the first body is nearly Gaussian whatever the second does (see `Pair.gaussian`).

    Its displacement takes the place of the center, y = x₁. Few Hermite functions give its state, as probabilities at
    the nodes of Gauss, so that a kick shifts v₁ by a matrix for each q. Its exact motion is a matrix for each wave
    of q: the exponential of its Kramers operator minus ``ik v₁`` for a wave number k, since it carries q along.
    The step need not resolve its oscillation.
    """

    @cached_property
    def spreads(self) -> tuple[float, float]:
        """Standard deviations of the displacement and the velocity of the first body, in units of which nodes are."""
        pair = self.pair
        return math.sqrt(pair.gaussian / pair.stiffness[0]), math.sqrt(pair.gaussian / pair.mass[0])

    @cached_property
    def _functions(self) -> tuple[Hermite, Hermite]:
        return Hermite(self.basis.center), Hermite(self.basis.first)

    @property
    def weights(self) -> np.ndarray:
        return np.array([1.0, 0.0])

    @cached_property
    def center(self) -> np.ndarray:
        """Places at which x₁ is read (m)."""
        return symmetric(_REACH * self.spreads[0], _READ)

    @cached_property
    def velocities(self) -> tuple[np.ndarray, np.ndarray]:
        """Places at which v₁ is read, and nodes of v₂ (m s-1)."""
        return symmetric(_REACH * self.spreads[1], _READ), super().velocities[1]

    @property
    def cell(self) -> float:
        """Volume of a cell in the coordinates (s, v₂)."""
        return float(self.velocities[1][1] - self.velocities[1][0])

    @cached_property
    def shears(self) -> list[Shears]:
        """The transition of each body as shears; that of the first is not divided."""
        first, second = super().shears
        return [first._replace(first=0.0, last=0.0), second]

    @cached_property
    def _displacement(self) -> np.ndarray:
        """Displacement of the second body at the nodes, (gap, center)."""
        return np.asarray(self.displacements_at(self.gap, self.spreads[0] * self._functions[0].nodes)[1])

    @cached_property
    def kicks(self) -> tuple[np.ndarray, np.ndarray]:
        shears = self.shears[1]
        first, second = self._kick(1.0, shears.first + shears.last)
        return self._faded(first), second

    def in_kick(self, density: np.ndarray) -> np.ndarray:
        first, second = self._kick(0.5, self.shears[1].last)
        read = self._functions[1].read(self.velocities[0] / self.spreads[1])
        return np.array(
            [
                read @ (one[0] @ (part @ other).sum(axis=0))
                for one, part, other in zip(first, density, second, strict=True)
            ]
        )

    def _kick(self, part: float, shear: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrices of a part of the kick and of a shear of the second body."""
        first = self._functions[1].shifting(part * self.increments[0] / self.spreads[1])
        second = shifting(self.velocities[1], part * self.increments[1] - shear * self._displacement)
        return first, np.ascontiguousarray(second.swapaxes(-1, -2))

    def marginals(self, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        of_place, of_velocity = (
            functions.read(places / spread)
            for functions, places, spread in zip(
                self._functions, (self.center, self.velocities[0]), self.spreads, strict=True
            )
        )
        first, second = super().marginals(density)
        return np.asarray(of_place @ first @ of_velocity.T), np.asarray(of_place @ second)

    @cached_property
    def motion(self) -> np.ndarray:
        """Motion of the first body over a step, for each wave of the gap, (waves, 2 center first, 2 center first)."""
        from scipy.linalg import expm

        pair, (in_x, in_v) = self.pair, self._functions
        frequency, friction = math.sqrt(pair.stiffness[0] / pair.mass[0]), pair.damping[0] / pair.mass[0]
        # four Hermite functions more than there are nodes
        x, v = (Hermite.raising(len(functions.nodes) + 4) for functions in self._functions)
        excess = pair.temperatures[0] / pair.gaussian - 1.0
        kramers = frequency * (np.kron(x, v.T) - np.kron(x.T, v))
        kramers += friction * np.kron(np.eye(len(x)), excess * v @ v - v @ v.T)
        degree = np.add.outer(np.arange(len(x)), np.arange(len(v))).ravel()
        high = np.maximum(degree - 2.0, 0.0) / max(min(self.basis.center, self.basis.first) - 3.0, 1.0)
        kramers -= np.diag(_ABSORBED * self.well.fastest * high**_POWER)
        speed = self.spreads[1] * np.kron(np.eye(len(x)), v + v.T)
        kept = np.add.outer(np.arange(len(in_x.nodes)) * len(v), np.arange(len(in_v.nodes))).ravel()
        off, onto = np.kron(in_x.off, in_v.off), np.kron(in_x.onto, in_v.onto)
        return np.array(
            [
                planes(off @ expm(self.basis.step * (kramers - 1j * wave * speed))[np.ix_(kept, kept)] @ onto)
                for wave in self.grid.modes.numbers
            ]
        )

    @cached_property
    def _of_second(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Phases of the second body's velocities at every wave number, friction and noise, transposed, and phases."""
        wave, v, shears = -self.grid.modes.numbers[:, None, None], self.velocities[1], self.shears[1]
        before, after = np.exp(-1j * shears.before * wave * v), np.exp(-1j * shears.after * wave * v)
        after = after * np.exp(-0.5 * shears.spread * wave**2)
        shape = (len(wave), self.basis.center, len(v))
        before, after = (np.ascontiguousarray(np.broadcast_to(item, shape)) for item in (before, after))
        return before, np.ascontiguousarray(self._friction(v, shears).T), after

    def drift(self, part: slice, one: np.ndarray, two: np.ndarray) -> None:
        rows = 2 * self.basis.center * self.basis.first
        before, friction, after = self._of_second
        unity = np.ones((*before[part].shape[:2], self.basis.first), complex)
        np.matmul(self.motion[part], two.reshape(len(two), rows, -1), out=one.reshape(len(one), rows, -1))
        turn(one, unity, before[part])
        np.matmul(one, friction, out=two)
        turn(two, unity, after[part])

    def _gibbs(self) -> list[np.ndarray]:
        return [*(functions.weights for functions in self._functions), super()._gibbs()[2]]

    def _taking(self, other: Propagator) -> list[np.ndarray | None]:
        of_gap, *_, of_second = super()._taking(other)
        if not isinstance(other, Follower):
            raise TypeError("Grids of one pair are of one kind.")
        both = zip(self._functions, other._functions, strict=True)
        return [of_gap, *(own.taken_from(others) for own, others in both), of_second]


def propagator_of(well: Well, basis: Basis) -> Propagator:
    """Return the step of a pair on a basis."""
    return (Follower if well.pair.gaussian else Propagator)(well.pair, well, basis)
