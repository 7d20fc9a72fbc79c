"""One step of the density of two bodies: the kick of the contact and the exact linear motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlab.kernels.phases import turn
from impactlab.linear.transitions import transition
from impactlab.reference.fokker_planck.grid import Grid
from impactlab.reference.fokker_planck.pair import Pair, Well
from impactlab.reference.fokker_planck.waves import interpolation, onto_waves, planes, symmetric, waves_of

_ABSORBED, _POWER = {"center": 0.6, "velocity": 2.0}, 12
"""Rates at which the shortest waves are absorbed, in frequencies of the pair, and the power of the wave number."""


class Basis(NamedTuple):
    """Numbers of nodes in each direction, half the size of the box in standard deviations, and the time step (s)."""

    gap: int
    center: int
    first: int
    second: int
    box: float
    step: float

    @property
    def unknowns(self) -> int:
        return self.gap * self.center * self.first * self.second


class Shears(NamedTuple):
    """The transition of a body as K(first), D(before), friction and noise, noise `spread` on x, D(after), K(last).

    See `Propagator`; noises are variances.
    """

    first: float
    before: float
    decay: float
    noise: float
    spread: float
    after: float
    last: float

    @classmethod
    def of(cls, a: np.ndarray, q: np.ndarray, decay: float) -> Shears:
        drift = a[0, 1]
        last = (decay - a[1, 1]) / drift
        back = np.array([[1.0, 0.0], [last, 1.0]])
        before_last = back @ q @ back.T
        noise = before_last[1, 1]
        after = before_last[0, 1] / noise
        spread = max(before_last[0, 0] - after**2 * noise, 0.0)
        return cls((1.0 - a[0, 0]) / drift, drift - after * decay, decay, noise, spread, after, last)


@dataclass(frozen=True, eq=False)
class Propagator:
    """The step of a density on a grid of (q, y, v₁, v₂).

    The density is that of the chain which the default integrator simulates: a kick by the
    contact, read at the shifted place, and the exact Gaussian transition of each body. Being the
    same at all times but for errors of fourth order in the step, it needs no small step.

    Functions are trigonometric polynomials in all four coordinates, that of q being a place s on a
    `Grid`. The transition of a body is a
    product of shears, friction and noise,

        A = K(b) D(s) F D(r) K(a),   K(a): v → v − a x,   D(r): x → x + r v,   F: v → e^(−ch/m) v + noise,

    which is exact with a little noise on x beside that on v. K and the kick shift v by an amount
    that is known at each (q, y); D multiplies by a phase at each v and wave number. So a step is a
    product with small matrices at every (q, y), waves of q and y, and phases and small matrices there.

    Drifts carry waves to ever shorter ones in the velocities, where noise should end them. What the
    grid does not resolve would come back as long waves, and is absorbed.
    """

    pair: Pair
    well: Well  # its gap at the temperature that sets the box
    basis: Basis

    @cached_property
    def grid(self) -> Grid:
        """Nodes of q and waves on them."""
        return Grid.of(self.well, self.basis.box, self.basis.gap)

    @property
    def gap(self) -> np.ndarray:
        """Nodes of q (m)."""
        return self.grid.nodes

    @cached_property
    def center(self) -> np.ndarray:
        """Nodes of y (m)."""
        return symmetric(self.basis.box * self.well.center(self.well.speeds), self.basis.center)

    @cached_property
    def velocities(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of v₁ and v₂ (m s-1)."""
        halves = self.basis.box * self.well.speeds
        return symmetric(halves[0], self.basis.first), symmetric(halves[1], self.basis.second)

    @property
    def nodes(self) -> tuple[np.ndarray, ...]:
        return self.gap, self.center, *self.velocities

    @property
    def cell(self) -> float:
        """Volume of a cell in the coordinates (s, y, v₁, v₂)."""
        return math.prod(float(nodes[1] - nodes[0]) for nodes in self.nodes[1:])

    @property
    def weights(self) -> np.ndarray:
        """Weight of each displacement in the center."""
        return self.well.weights

    @cached_property
    def displacements(self) -> np.ndarray:
        """Displacements at (q, y), (body, gap, center)."""
        return self.displacements_at(self.gap, self.center)

    def displacements_at(self, gap: np.ndarray, center: np.ndarray) -> np.ndarray:
        """Return the displacements at some q and y, (body, gap, center)."""
        distance = gap[:, None] + self.pair.contact.clearance
        return np.array([center + self.weights[1] * distance, center - self.weights[0] * distance])

    @cached_property
    def forces(self) -> np.ndarray:
        """Force of the contact in a kick, (gap,) (N)."""
        return self.pair.force(self.shifted_gap)

    @cached_property
    def shifts(self) -> np.ndarray:
        """How far each body is read from where it is in a kick, for a force of 1 N, (body,) (m N-1).

        ``h²/12m`` to leading order in the step h: with it, kicks by a constant force move a body by this over its
        stiffness, however fast it is.
        """
        pair, kick = self.pair, self.basis.step / self.pair.mass
        moved = [np.linalg.solve(np.eye(2) - a, a @ [0.0, each])[0] for a, each in zip(self.flow[0], kick, strict=True)]
        return np.asarray(1.0 / pair.stiffness - moved)

    @cached_property
    def shifted_gap(self) -> np.ndarray:
        """Places at which the contact is read, (gap,) (m)."""
        return np.asarray(self.gap - self.shifts.sum() * self.pair.force(self.gap))

    def stretch(self, gaps: np.ndarray) -> np.ndarray:
        """Return the derivative of the places at which the contact is read by q."""
        apart = 1e-6 * self.well.penetration
        slope = (self.pair.force(gaps + apart) - self.pair.force(gaps - apart)) / (2.0 * apart)
        return np.asarray(1.0 - self.shifts.sum() * slope)

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
    def shears(self) -> list[Shears]:
        """The transition of each body as shears."""
        friction = np.exp(-self.pair.damping / self.pair.mass * self.basis.step)
        return [Shears.of(a, q, decay) for a, q, decay in zip(*self.flow, friction, strict=True)]

    @cached_property
    def kicks(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrices of the velocities at every (q, y): both shears and the kick between them."""
        sums = np.array([shears.first + shears.last for shears in self.shears])
        first, second = self._shifting(self.increments - sums[:, None, None] * self.displacements)
        return self._faded(first), second

    def _faded(self, matrices: np.ndarray) -> np.ndarray:
        """Take matrices at every node of the gap to 0 towards its ends."""
        fade = self.well.fade(self.gap, self.basis.box)
        return np.asarray(matrices * fade.astype(matrices.dtype)[:, None, None, None])

    def in_kick(self, density: np.ndarray) -> np.ndarray:
        """Return the density of q, v₁ and v₂ in the middle of the kick."""
        last = np.array([shears.last for shears in self.shears])
        first, second = self._shifting(0.5 * self.increments - last[:, None, None] * self.displacements)
        return np.array(
            [np.matmul(one @ part, other).sum(axis=0) for one, part, other in zip(first, density, second, strict=True)]
        )

    def _shifting(self, shifts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrices that shift both velocities by amounts (body, gap, center); for the second transposed."""
        both = zip(self.velocities, shifts, strict=True)
        first, second = (shifting(v, shift).astype(self.pair.real) for v, shift in both)
        return first, np.ascontiguousarray(second.swapaxes(-1, -2))

    def marginals(self, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the sums over the second velocity, (gap, center, first), and over the first."""
        return density.sum(axis=3, dtype=float), density.sum(axis=2, dtype=float)

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrices from nodes of the gap to real and imaginary parts of its waves, and back."""
        real = self.pair.real
        return self.grid.modes.onto.astype(real), self.grid.modes.off.astype(real)

    @cached_property
    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """Fourier transform of y and its inverse, for the real and the imaginary part one after the other."""
        waves, there = waves_of(self.center)
        onto = onto_waves(self.center, waves) * self._left(waves, "center")[:, None]
        return planes(onto).astype(self.pair.real), planes(there).astype(self.pair.real)

    def _left(self, waves: np.ndarray, direction: str) -> np.ndarray:
        """Return the part of waves that absorption leaves in a step."""
        rate = _ABSORBED[direction] * self.well.fastest
        return np.asarray(np.exp(-rate * self.basis.step * (waves / waves.max()) ** _POWER))

    @cached_property
    def drifts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Phases of each body's velocities at every pair of wave numbers, before and after friction and noise."""
        of_gap, of_center = self.grid.modes.numbers[:, None], waves_of(self.center)[0]
        weights = self.weights
        result = []
        for wave, v, shears in zip(
            (of_gap + weights[0] * of_center, -of_gap + weights[1] * of_center),
            self.velocities,
            self.shears,
            strict=True,
        ):
            wave = wave[..., None]
            before, after = np.exp(-1j * shears.before * wave * v), np.exp(-1j * shears.after * wave * v)
            after = after * np.exp(-0.5 * shears.spread * wave**2)
            kind = np.result_type(self.pair.real, np.complex64)
            result.append((before.astype(kind), after.astype(kind)))
        return result

    @cached_property
    def friction(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrices of friction and noise, the second transposed."""
        first, second = (self._friction(v, shears) for v, shears in zip(self.velocities, self.shears, strict=True))
        return first, np.ascontiguousarray(second.T)

    def _friction(self, v: np.ndarray, shears: Shears) -> np.ndarray:
        waves, there = waves_of(v)
        left = self._left(waves, "velocity") * np.exp(-0.5 * shears.noise * waves**2)
        return np.asarray(((there * left) @ onto_waves(shears.decay * v, waves)).real.astype(self.pair.real))

    def drift(self, part: slice, one: np.ndarray, two: np.ndarray) -> None:
        """Carry some waves of the gap through the exact motion, in `two`; `one` is overwritten.

        Both are of shape (waves, 2, center, first, second), of the real and the imaginary part of each wave.
        """
        rows_one, rows_two = (item.reshape(len(item), 2 * self.basis.center, -1) for item in (one, two))
        forth, back = self.around
        left, right = self.friction
        (before, after), (before_second, after_second) = self.drifts
        np.matmul(forth, rows_two, out=rows_one)
        turn(one, before[part], before_second[part])
        np.matmul(left, one, out=two)
        np.matmul(two, right, out=one)
        turn(one, after[part], after_second[part])
        np.matmul(back, rows_one, out=rows_two)

    def start(self) -> np.ndarray:
        """Return the Gibbs density at the temperature of the box, for a cold body at its own."""
        energy = np.exp(-self.well.energy(self.gap)) * self.grid.cells
        return self.normalized(np.einsum("a,b,c,d->abcd", energy, *self._gibbs()).astype(self.pair.real))

    def _gibbs(self) -> list[np.ndarray]:
        """Return the Gibbs densities of y, v₁ and v₂."""
        temperature, pair, well = self.well.temperature, self.pair, self.well
        coefficients: tuple[float, ...] = (pair.stiffness.sum(), *pair.mass)
        if well.cold.any():
            coefficients = tuple(temperature / deviation**2 for deviation in (well.center(well.speeds), *well.speeds))
        nodes = (self.center, *self.velocities)
        return [np.exp(-0.5 * each / temperature * x**2) for each, x in zip(coefficients, nodes, strict=True)]

    def normalized(self, density: np.ndarray) -> np.ndarray:
        return density / float(density.sum(dtype=float) * self.cell)

    def taken_from(self, other: Propagator, density: np.ndarray) -> np.ndarray:
        """Return the density of another grid on this one; 0 outside of the other's box."""
        for axis, matrix in enumerate(self._taking(other)):
            if matrix is not None:
                density = np.moveaxis(np.tensordot(matrix.astype(density.dtype), density, axes=(1, axis)), 0, axis)
        return self.normalized(np.ascontiguousarray(density))

    def _taking(self, other: Propagator) -> list[np.ndarray | None]:
        """Return the matrices from another grid, none where it has the same nodes."""
        same = [np.array_equal(own, others) for own, others in zip(self.nodes, other.nodes, strict=True)]
        rest = zip(same[1:], self.nodes[1:], other.nodes[1:], strict=True)
        return [
            None if same[0] else self.grid.taken_from(other.grid),
            *(None if equal else interpolation(others, own) for equal, own, others in rest),
        ]


def shifting(v: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Return the matrices that shift densities at nodes of a velocity, (…, node, node), by amounts (…)."""
    waves, there = waves_of(v)
    phases = np.exp(-1j * shifts[..., None] * waves)
    return np.ascontiguousarray(((phases[..., None, :] * there) @ onto_waves(v)).real)
