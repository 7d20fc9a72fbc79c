"""One step of the density of two bodies: the kick of the contact and the exact linear motion."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlab.kernels.flow import transition
from impactlab.phase_space.pair import Pair, Well

REACH = 6.0
"""Standard deviations at which the box of the center and those of velocities end."""

_FILTER, _FILTER_ORDER = 36.0, 16


class Basis(NamedTuple):
    """Numbers of nodes in each direction, and the time step (s)."""

    gap: int
    center: int
    first: int
    second: int
    step: float

    @property
    def unknowns(self) -> int:
        return self.gap * self.center * self.first * self.second


@dataclass(frozen=True, eq=False)
class Propagator:
    """The step of a density on a grid of (q, y, v₁, v₂).

    The density is that of the chain which the default integrator simulates: a kick by the
    contact, read at the shifted place, and the exact Gaussian transition of each body. Being the
    same at all times but for errors of fourth order in the step, it needs no small step.

    Functions are trigonometric polynomials in all four coordinates. The transition of a body is a
    product of shears, friction and noise,

        A = K(b) D(s) F D(r) K(a),   K(a): v → v − a x,   D(r): x → x + r v,   F: v → e^(−ch/m) v + noise,

    which is exact with a little noise on x beside that on v. K and the kick shift v by an amount
    that is known at each (q, y); D multiplies by a phase at each v and wave number. So a step is a
    product with small matrices at every (q, y), and one at every pair of wave numbers.

    Parameters
    ----------
    pair : Pair
    well : Well
        Its gap at the temperature that sets the box.
    basis : Basis
    """

    pair: Pair
    well: Well
    basis: Basis

    @cached_property
    def gap(self) -> np.ndarray:
        """Nodes of q (m)."""
        low, high = self.well.ends
        cell = (high - low) / self.basis.gap
        return (np.arange(self.basis.gap) - round(-low / cell) + self.pair.first_node) * cell

    @cached_property
    def center(self) -> np.ndarray:
        """Nodes of y (m)."""
        half = REACH * math.sqrt(self.well.temperature / self.pair.stiffness.sum())
        return _symmetric(half, self.basis.center)

    @cached_property
    def velocities(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of v₁ and v₂ (m s-1)."""
        halves = REACH * np.sqrt(self.well.temperature / self.pair.mass)
        return _symmetric(halves[0], self.basis.first), _symmetric(halves[1], self.basis.second)

    @property
    def nodes(self) -> tuple[np.ndarray, ...]:
        return self.gap, self.center, *self.velocities

    @property
    def cell(self) -> float:
        """Volume of a cell."""
        return math.prod(float(nodes[1] - nodes[0]) for nodes in self.nodes)

    @cached_property
    def displacements(self) -> np.ndarray:
        """Displacements at (q, y), (body, gap, center)."""
        distance = self.gap[:, None] + self.pair.contact.clearance
        weights = self.pair.weights
        return np.array([self.center + weights[1] * distance, self.center - weights[0] * distance])

    @cached_property
    def forces(self) -> np.ndarray:
        """Force of the contact in a kick, (gap,) (N)."""
        return self.pair.force(self.shifted_gap)

    @property
    def _shift(self) -> float:
        return self.basis.step**2 / 12.0 / self.pair.reduced_mass

    @cached_property
    def shifted_gap(self) -> np.ndarray:
        """Places at which the contact is read, (gap,) (m)."""
        return np.asarray(self.gap - self._shift * self.pair.force(self.gap))

    def stretch(self, gaps: np.ndarray) -> np.ndarray:
        """Return the derivative of the places at which the contact is read by q."""
        apart = 1e-6 * self.well.penetration
        slope = (self.pair.force(gaps + apart) - self.pair.force(gaps - apart)) / (2.0 * apart)
        return np.asarray(1.0 - self._shift * slope)

    @cached_property
    def increments(self) -> np.ndarray:
        """Change of each velocity in a kick, (body, gap, 1) (m s-1)."""
        return np.asarray(
            self.basis.step / self.pair.mass[:, None, None] * np.outer((-1.0, 1.0), self.forces)[..., None]
        )

    @cached_property
    def flow(self) -> tuple[np.ndarray, np.ndarray]:
        """Exact transition over a step, (2, 2, 2) each."""
        return self.transition(self.basis.step)

    def transition(self, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the exact transition of the bodies over some time."""
        pair = self.pair
        return transition(pair.mass, pair.damping, pair.stiffness, pair.intensity, step)

    @cached_property
    def shears(self) -> list[_Shears]:
        """The transition of each body as shears."""
        friction = np.exp(-self.pair.damping / self.pair.mass * self.basis.step)
        return [_Shears.of(a, q, decay) for a, q, decay in zip(*self.flow, friction, strict=True)]

    @cached_property
    def _kicks(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrices of the velocities at every (q, y): both shears and the kick between them."""
        sums = np.array([shears.first + shears.last for shears in self.shears])
        first, second = self._shifting(self.increments - sums[:, None, None] * self.displacements)
        first *= self.well.fade(self.gap).astype(np.float32)[:, None, None, None]
        return first, second

    def in_kick(self, density: np.ndarray) -> np.ndarray:
        """Return the density of q, v₁ and v₂ in the middle of the kick."""
        last = np.array([shears.last for shears in self.shears])
        first, second = self._shifting(0.5 * self.increments - last[:, None, None] * self.displacements)
        return np.array(
            [np.matmul(one @ part, other).sum(axis=0) for one, part, other in zip(first, density, second, strict=True)]
        )

    def _shifting(self, shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrices that shift both velocities by amounts (body, gap, center); for the second transposed."""
        result = []
        for shift, v in zip(shifts, self.velocities, strict=True):
            waves, there = _waves(v)
            phases = np.exp(-1j * shift[..., None] * waves)
            result.append(np.ascontiguousarray(((phases[..., None, :] * there) @ _back(v)).real, dtype=np.float32))
        return result[0], np.ascontiguousarray(result[1].swapaxes(-1, -2))

    @cached_property
    def _drifts(self) -> tuple[np.ndarray, ...]:
        """Matrices of the velocities at every pair of wave numbers: drifts, friction and noise."""
        of_gap = 2.0 * np.pi * np.fft.rfftfreq(len(self.gap), self.gap[1] - self.gap[0])[:, None]
        of_center = 2.0 * np.pi * np.fft.fftfreq(len(self.center), self.center[1] - self.center[0])
        weights = self.pair.weights
        result = []
        for wave, v, shears in zip(
            (of_gap + weights[0] * of_center, -of_gap + weights[1] * of_center),
            self.velocities,
            self.shears,
            strict=True,
        ):
            waves, there = _waves(v)
            friction = ((there * np.exp(-0.5 * shears.noise * waves**2)) @ _back(shears.decay * v, waves)).real
            wave = wave[..., None, None]
            matrix = np.exp(-0.5 * shears.spread * wave**2) * friction
            matrix = np.exp(-1j * shears.after * wave * v[:, None]) * matrix * np.exp(-1j * shears.before * wave * v)
            result.append(matrix.astype(np.complex64))
        smooth = np.exp(-_FILTER * (of_gap / of_gap[-1]) ** _FILTER_ORDER)
        result[0] *= smooth.astype(np.float32)[..., None, None]
        return result[0], np.ascontiguousarray(result[1].swapaxes(-1, -2))

    def start(self) -> np.ndarray:
        """Return the Gibbs density at the temperature of the box."""
        temperature, pair = self.well.temperature, self.pair
        factors = [
            np.exp(-self.well.energy(self.gap)),
            np.exp(-0.5 * pair.stiffness.sum() / temperature * self.center**2),
            *(np.exp(-0.5 * mass / temperature * v**2) for mass, v in zip(pair.mass, self.velocities, strict=True)),
        ]
        return self.normalized(np.einsum("a,b,c,d->abcd", *factors).astype(np.float32))

    def normalized(self, density: np.ndarray) -> np.ndarray:
        return density / np.float32(density.sum(dtype=float) * self.cell)

    def march(self, density: np.ndarray, steps: int, pool: Executor, workers: int) -> np.ndarray:
        """Return the density after some steps, normalised."""
        from scipy import fft

        shape = density.shape
        for _ in range(steps):
            kicked = _products(self._kicks, density, pool, workers)
            transformed = fft.rfftn(kicked, axes=(1, 0), workers=workers)
            moved = _products(self._drifts, transformed, pool, workers)
            density = fft.irfftn(moved, s=(shape[1], shape[0]), axes=(1, 0), workers=workers, overwrite_x=True)
        return self.normalized(density)

    def taken_from(self, other: Propagator, density: np.ndarray) -> np.ndarray:
        """Return the density of another grid on this one; 0 outside of the other's box."""
        for axis, (own, others) in enumerate(zip(self.nodes, other.nodes, strict=True)):
            if own is others or np.array_equal(own, others):
                continue
            matrix = _interpolation(others, own).astype(np.float32)
            density = np.moveaxis(np.tensordot(matrix, density, axes=(1, axis)), 0, axis)
        return self.normalized(np.ascontiguousarray(density))


class _Shears(NamedTuple):
    """K(first), D(before), friction and noise, noise `spread` on x, D(after), K(last); noises are variances."""

    first: float
    before: float
    decay: float
    noise: float
    spread: float
    after: float
    last: float

    @classmethod
    def of(cls, a: np.ndarray, q: np.ndarray, decay: float) -> _Shears:
        drift = a[0, 1]
        last = (decay - a[1, 1]) / drift
        back = np.array([[1.0, 0.0], [last, 1.0]])
        before_last = back @ q @ back.T
        noise = before_last[1, 1]
        after = before_last[0, 1] / noise
        spread = max(before_last[0, 0] - after**2 * noise, 0.0)
        return cls((1.0 - a[0, 0]) / drift, drift - after * decay, decay, noise, spread, after, last)


def _symmetric(half: float, count: int) -> np.ndarray:
    return (np.arange(count) - 0.5 * (count - 1)) * (2.0 * half / count)


def _waves(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the wave numbers of nodes, and the matrix that evaluates a trigonometric polynomial there."""
    waves = 2.0 * np.pi * np.fft.fftfreq(len(nodes), nodes[1] - nodes[0])
    return waves, np.exp(1j * np.outer(nodes, waves)) / len(nodes)


def _back(places: np.ndarray, waves: np.ndarray | None = None) -> np.ndarray:
    """Return the matrix from values at places to coefficients of the wave numbers."""
    if waves is None:
        waves = _waves(places)[0]
    return np.exp(-1j * np.outer(waves, places))


def _interpolation(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the matrix from values at nodes to values at places, 0 outside."""
    waves = _waves(nodes)[0]
    matrix = (np.exp(1j * np.outer(places, waves)) / len(nodes) @ _back(nodes)).real
    cell = nodes[1] - nodes[0]
    inside = (places >= nodes[0] - 0.5 * cell) & (places <= nodes[-1] + 0.5 * cell)
    return np.where(inside[:, None], matrix, 0.0)


def _products(matrices: tuple[np.ndarray, ...], density: np.ndarray, pool: Executor, workers: int) -> np.ndarray:
    """Multiply the velocities' axes by a matrix each; every row by itself, so that threads do not matter."""
    left, right = matrices
    result = np.empty_like(density)
    rows = np.array_split(np.arange(len(density)), 4 * workers)

    def multiply(part: np.ndarray) -> None:
        if len(part):
            at = slice(part[0], part[-1] + 1)
            np.matmul(left[at] @ density[at], right[at], out=result[at])

    list(pool.map(multiply, rows))
    return result
