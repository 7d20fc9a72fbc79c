"""Exact law of a body, or of a pair of linear bodies: the Gibbs density of one coordinate, by quadrature."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from impactlab.components.contact import Contact
from impactlab.errors import NoExactReference
from impactlab.reference.gaussian import OUTERMOST
from impactlab.reference.marginal import Marginal
from impactlab.reference.piecewise import MOST_PANELS
from impactlab.reference.potential import NODES_OF_PANEL, Gap, Potential, composite_rule

_RESOLVED = 1e-9  # of a displacement, within which the density must not vanish


@dataclass(frozen=True, eq=False)
class GibbsLaw:
    """Stationary law of a body, or of a pair of linear bodies.

    The coordinate q is the displacement of the body, or the difference ``x_first − x_second``. It has the density
    ``exp(−Φ(q)/T)/Z`` with ``Φ = stiffness q²/2 + potentials of other springs and of the contacts``. The displacement
    of a body is ``weight q + spread z``, with one standard normal z for both bodies: for two springs
    ``exp(−k₁x₁²/2T − k₂x₂²/2T)`` factorises so, with stiffness ``k₁k₂/(k₁+k₂)``, weights ``k₂/(k₁+k₂)`` and
    ``−k₁/(k₁+k₂)`` and spread ``sqrt(T/(k₁+k₂))``.

    The integrals are composite Gauss-Legendre sums. Panels double in width with the distance from every corner and
    minimum of Φ, so that the scales of springs and contacts may differ as they like, and are halved where that is not
    enough (a law with a kink of its own); the part on either side of a corner is right relative to itself, however
    small it is. What cannot be normalised or integrated, or is not the integral of its force, is refused.
    """

    bodies: tuple[str, ...]  # names
    potential: Potential  # φ and T
    weights: tuple[float, ...] = (1.0,)  # weight of q in the displacement of each body
    spread: float = 0.0  # standard deviation of what the displacements have beside q (m)
    edges: np.ndarray = field(init=False, repr=False)
    ground: float = field(init=False, repr=False)
    normalization: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        edges = self._refined(self._trimmed(self.potential.panels(), self.potential.corners))
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "normalization", float(self._integrals(edges)[0].sum()))
        self.potential.check_work(self.edges)

    def __str__(self) -> str:
        return f"temperature {self.temperature:.6g} J, density proportional to exp(−H/T)"

    @property
    def temperature(self) -> float:
        """T (J)."""
        return self.potential.temperature

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """The contacts."""
        return self.potential.gaps

    def quadrature(self, extra_edges: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return edges, offsets from them and their probabilities; with further edges if wanted."""
        edges = self.edges
        if extra_edges is not None:
            inside = (extra_edges > edges[0]) & (extra_edges < edges[-1])
            edges = np.union1d(edges, extra_edges[inside])
        starts, offsets, lengths = composite_rule(edges)
        return starts, offsets, lengths * self.coordinate_density(starts, offsets)

    def coordinate_density(self, coordinate: np.ndarray, offset: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the density of q (m-1) at ``coordinate + offset``."""
        return np.asarray(np.exp(self.ground - self.potential.energy(coordinate, offset)) / self.normalization)

    def moments(self, body: str) -> tuple[float, float]:
        """Return the mean (m) and the variance (m2) of a body's displacement."""
        mean, _ = self._of_coordinate
        return self.weights[self.bodies.index(body)] * mean, self.variance_along({body: 1.0})

    def variance_along(self, weights: Mapping[str, float]) -> float:
        """Return the variance of a weighted sum of displacements (m2)."""
        return self._share(weights) ** 2 * self._of_coordinate[1] + self.variance_beside(weights)

    def variance_beside(self, weights: Mapping[str, float]) -> float:
        """Return the variance of what a weighted sum of displacements has beside its part of q (m2)."""
        return (self.spread * sum(weights.values())) ** 2

    def gap(self, contact: Contact) -> Gap:
        """Return a contact as the coordinate sees it."""
        return Gap.of(contact, self.bodies[0])

    @cached_property
    def _of_coordinate(self) -> tuple[float, float]:
        """Mean (m) and variance (m2) of q."""
        starts, offsets, probabilities = self.quadrature()
        nodes = starts + offsets
        mean = float(probabilities @ nodes)
        return mean, float(probabilities @ (nodes - mean) ** 2)

    def _share(self, weights: Mapping[str, float]) -> float:
        """Return the weight of q in a weighted sum of displacements."""
        return sum(weight * self.weights[self.bodies.index(name)] for name, weight in weights.items())

    def contact(self, contact: Contact) -> tuple[float, float, float]:
        """Return the probability that a contact is closed, the density where it closes (m-1) and its mean force (N)."""
        gap = self.gap(contact)
        *nodes, probabilities = self.quadrature()
        indentation = gap.indentation(*nodes)
        ratio, force = probabilities[indentation > 0.0].sum(), probabilities @ gap.law.evaluate(indentation)
        return float(ratio), float(self.coordinate_density(np.array([gap.corner]))[0]), float(force)

    def density(self, body: str, displacement: np.ndarray) -> np.ndarray:
        """Return the density of a body's displacement (m-1)."""
        return self.density_along({body: 1.0}, displacement)

    def density_along(self, weights: Mapping[str, float], place: np.ndarray) -> np.ndarray:
        """Return the density of a weighted sum of displacements (m-1)."""
        spread = math.sqrt(self.variance_beside(weights))
        if spread == 0.0:
            share = self._share(weights)
            return self.coordinate_density(place / share) / abs(share)
        scale = 1.0 / (math.sqrt(2.0 * math.pi) * spread)
        return self._smeared(weights, place, lambda z: scale * np.exp(-0.5 * z * z))[1]

    def joint_density(self, first: str, second: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the joint density of the displacements of the two bodies (m-2)."""
        if (second, first) == self.bodies:
            x, y = y, x
        difference = x - y
        rest = (x - self.weights[0] * difference) / self.spread
        normal = np.exp(-0.5 * rest * rest) / (math.sqrt(2.0 * math.pi) * self.spread)
        return np.asarray(self.coordinate_density(difference) * normal)

    def probability(self, body: str, displacement: np.ndarray) -> np.ndarray:
        """Return the probability that a body's displacement is smaller."""
        return self.probability_along({body: 1.0}, displacement)

    def probability_along(self, weights: Mapping[str, float], place: np.ndarray) -> np.ndarray:
        """Return the probability that a weighted sum of displacements is smaller."""
        below, near = self._smeared(weights, place, ndtr)
        return np.asarray(below + near)

    def marginal(self, body: str, speed: float) -> Marginal:
        """Return the law of a body's displacement, its velocity having some standard deviation (m s-1)."""
        ends = self.weights[self.bodies.index(body)] * self.edges
        around = math.sqrt(self.variance_beside({body: 1.0})) * np.linspace(-OUTERMOST, OUTERMOST, 81)
        outside = [ends.min() + around, ends.max() + around, np.linspace(ends.min(), ends.max(), 257)]

        def above(level: float) -> float:
            below, near = self._smeared({body: 1.0}, np.array([-level]), ndtr, mirrored=True)
            return float(below[0] + near[0])

        return Marginal(
            lambda places: self.density(body, places), above, np.unique(np.concatenate([ends, *outside])), speed
        )

    def gap_marginal(self, contact: Contact, speed: float) -> Marginal:
        """Return the law of a contact's indentation, its rate having some standard deviation (m s-1)."""
        gap = self.gap(contact)

        def above(level: float) -> float:
            *nodes, probabilities = self.quadrature(np.array([gap.corner + gap.sign * level]))
            return float(probabilities[gap.indentation(*nodes) > level].sum())

        def density(places: np.ndarray) -> np.ndarray:
            return self.coordinate_density(np.full_like(places, gap.corner), gap.sign * places)

        return Marginal(density, above, np.sort(gap.indentation(self.edges)), speed)

    def _smeared(
        self,
        weights: Mapping[str, float],
        displacement: np.ndarray,
        kernel: Callable[[np.ndarray], np.ndarray],
        mirrored: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Sum what is below the Gaussian's reach, and what is within it times a kernel; for −x if mirrored."""
        weight = self._share(weights) * (-1.0 if mirrored else 1.0)
        extra, spread = displacement, math.sqrt(self.variance_beside(weights))
        if spread > 0.0:  # panels no wider than 2 spread, but only where the Gaussian is looked at
            panel = np.round(displacement / (2.0 * spread))[:, None] + np.arange(-6, 7)
            extra = np.unique(panel) * 2.0 * spread
        starts, offsets, probabilities = self.quadrature(extra / weight if weight else None)
        places = weight * (starts + offsets)
        if weight < 0.0:
            places, probabilities = places[::-1], probabilities[::-1]
        total = np.concatenate([[0.0], np.cumsum(probabilities)])
        start = np.searchsorted(places, displacement - OUTERMOST * spread)
        stop = np.searchsorted(places, displacement + OUTERMOST * spread)
        near = [
            probabilities[i:j] @ kernel((x - places[i:j]) / spread) if i < j else 0.0
            for x, i, j in zip(displacement, start, stop, strict=True)
        ]
        return total[start], np.array(near)

    def _trimmed(self, edges: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Drop the panels beyond which the density has vanished, on both sides."""
        energy = self.potential.energy(edges)
        place = edges[energy.argmin()]
        object.__setattr__(self, "ground", float(energy.min()))
        nearby = self.potential.energy(place * np.array([1.0 - _RESOLVED, 1.0 + _RESOLVED]))
        if place and nearby.min() > self.ground + 1.0:
            raise NoExactReference(
                f"{self.potential.names}: the motion about {place:.6g} m is within {_RESOLVED * abs(place):.1g} m, "
                "not resolved beside this displacement; give more noise."
            )
        left, right = energy[edges <= corners[0]], energy[edges >= corners[-1]][::-1]
        # the energy, in units of T, at which the panels end
        outside = [int(np.argmax(side <= side.min() + 60.0)) for side in (left, right)]
        if 0 in outside:
            raise NoExactReference(
                f"{self.potential.names}: the law cannot be normalised, because neither a spring nor a contact "
                f"confines {'it' if len(self.bodies) == 1 else 'their distance'} on both sides; add either."
            )
        return edges[outside[0] - 1 : len(edges) - outside[1] + 1]

    def _refined(self, edges: np.ndarray) -> np.ndarray:
        """Halve the panels until that changes no integral from one corner to the next."""
        tolerance = 1e-13 + 4e-16 * abs(self.ground)  # the second is the rounding of Φ/T
        corners = np.unique([gap.corner for gap in self.gaps])
        while len(edges) < MOST_PANELS:
            middles = 0.5 * (edges[1:] + edges[:-1])
            halved = np.sort(np.append(edges, middles))
            whole, halves = self._integrals(edges), self._integrals(halved)
            halves = halves.reshape(len(whole), -1, 2).sum(axis=-1)
            part = np.searchsorted(corners, edges[:-1], side="right")
            scale = np.array([np.bincount(part, np.abs(row))[part] for row in halves])
            rough = (np.abs(whole - halves) > tolerance * scale).any(axis=0)
            if not rough.any():
                return halved
            edges = np.sort(np.append(edges, middles[rough]))
        raise NoExactReference(
            f"{self.potential.names}: the integral of exp(−H/T) does not converge; its potential is not smooth."
        )

    def _integrals(self, edges: np.ndarray) -> np.ndarray:
        """Return the integrals of ``exp(−Φ/T)``, alone and times each force, over each panel."""
        *nodes, lengths = composite_rule(edges)
        density = lengths * np.exp(self.ground - self.potential.energy(*nodes))
        forces = [gap.law.evaluate(gap.indentation(*nodes)) for gap in self.gaps]
        integrands = density * np.array([np.ones_like(density), *forces])
        return np.asarray(integrands.reshape(len(integrands), -1, len(NODES_OF_PANEL)).sum(axis=-1))
