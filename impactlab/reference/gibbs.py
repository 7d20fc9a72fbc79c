"""Gibbs density of one coordinate, by quadrature: what all exact laws here come down to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr

from impactlab.component import Component
from impactlab.contact import Contact, ContactLaw
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.oscillator import Oscillator

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_OCTAVES = 2.0 ** np.arange(-100, 101)  # distances (m) at which the potential is looked at
_START, _END = 1e-8, 60.0  # energies (in units of T) at which the panels begin and end
_MOST_PANELS = 5000
_REACH = 10.0  # standard deviations after which a Gaussian is 0


@dataclass(frozen=True)
class Gap:
    """A contact as the coordinate q sees it: indentation ``sign q − clearance``."""

    law: ContactLaw
    sign: float
    clearance: float

    @classmethod
    def of(cls, contact: Contact, body: str) -> Gap:
        """Return what a contact is for the coordinate that grows with a body's displacement."""
        return cls(contact.law, 1.0 if contact.first == body else -1.0, contact.clearance)

    def indentation(self, coordinate: np.ndarray, offset: np.ndarray | float = 0.0) -> np.ndarray:
        """Return δ at ``coordinate + offset``: the sum itself could round away a stiff contact's δ."""
        return np.asarray((self.sign * coordinate - self.clearance) + self.sign * offset)

    @property
    def corner(self) -> float:
        """Coordinate at which the contact closes."""
        return self.sign * self.clearance


@dataclass(frozen=True, eq=False)
class GibbsLaw:
    """Stationary law of a body, or of a pair of linear bodies.

    The coordinate q is the displacement of the body, or the difference
    ``x_first − x_second``. It has the density ``exp(−Φ(q)/T)/Z`` with
    ``Φ = stiffness q²/2 + residual potential + potentials of the contacts``. The
    displacement of a body is ``weight q + spread z``, with one standard normal z for
    both bodies: for two springs ``exp(−k₁x₁²/2T − k₂x₂²/2T)`` factorises so, with
    stiffness ``k₁k₂/(k₁+k₂)``, weights ``k₂/(k₁+k₂)`` and ``−k₁/(k₁+k₂)`` and
    spread ``sqrt(T/(k₁+k₂))``.

    The integrals are composite Gauss-Legendre sums. Panels double in width with the
    distance from every corner and minimum of Φ, so that the scales of springs and
    contacts may differ as they like, and are halved where that is not enough (a law
    with a kink of its own); the part on either side of a corner is right relative to
    itself, however small it is.

    Parameters
    ----------
    bodies : tuple of str
        Names of the bodies.
    temperature : float
        T (J).
    stiffness : float
        Stiffness of the coordinate (N m-1).
    weights : tuple of float
        Weight of q in the displacement of each body.
    spread : float
        Standard deviation of what the displacements have beside q (m).
    gaps : tuple of Gap
        The contacts.
    residual : Oscillator, optional
        The oscillator whose residual potential acts on q.

    Raises
    ------
    NoExactReference
        If ``exp(−Φ/T)`` cannot be normalised or integrated.
    InvalidInput
        If a potential is not the integral of its force.
    """

    bodies: tuple[str, ...]
    temperature: float
    stiffness: float
    weights: tuple[float, ...] = (1.0,)
    spread: float = 0.0
    gaps: tuple[Gap, ...] = ()
    residual: Oscillator | None = None
    edges: np.ndarray = field(init=False, repr=False)
    ground: float = field(init=False, repr=False)
    normalization: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        edges = self._refined(self._panels())
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "normalization", float(self._integrals(edges)[0].sum()))
        self._check_potentials()

    def energy(self, coordinate: np.ndarray, offset: np.ndarray | float = 0.0) -> np.ndarray:
        """Return Φ/T at ``coordinate + offset``; infinite where it is too large for a number."""
        place = coordinate + offset
        total = 0.5 * self.stiffness * place**2
        if self.residual is not None:
            total = total + _evaluate(self.residual, "residual_potential", place)
        for gap in self.gaps:
            indentation = gap.indentation(coordinate, offset)
            closed = indentation > 0.0
            total[closed] += _evaluate(gap.law, "potential", indentation[closed])
        if np.isnan(total).any():
            raise NoExactReference(f"{self._names}: the potential is not a number at {place[np.isnan(total)][0]:g} m.")
        return np.asarray(total / self.temperature)

    def quadrature(self, extra_edges: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return edges, offsets from them and their probabilities; with further edges if wanted."""
        edges = self.edges
        if extra_edges is not None:
            inside = (extra_edges > edges[0]) & (extra_edges < edges[-1])
            edges = np.union1d(edges, extra_edges[inside])
        starts, offsets, lengths = _gauss_legendre(edges)
        return starts, offsets, lengths * self.coordinate_density(starts, offsets)

    def coordinate_density(self, coordinate: np.ndarray, offset: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the density of q (m-1) at ``coordinate + offset``."""
        return np.asarray(np.exp(self.ground - self.energy(coordinate, offset)) / self.normalization)

    def moments(self, body: str) -> tuple[float, float]:
        """Return the mean (m) and the variance (m2) of a body's displacement."""
        weight = self.weights[self.bodies.index(body)]
        starts, offsets, probabilities = self.quadrature()
        nodes = starts + offsets
        mean = float(probabilities @ nodes)
        return weight * mean, weight**2 * float(probabilities @ (nodes - mean) ** 2) + self.spread**2

    def contact_ratio(self, gap: Gap) -> float:
        """Return the probability that a contact is closed."""
        *nodes, probabilities = self.quadrature()
        return float(probabilities[gap.indentation(*nodes) > 0.0].sum())

    def mean_force(self, gap: Gap) -> float:
        """Return the mean force of a contact (N)."""
        *nodes, probabilities = self.quadrature()
        return float(probabilities @ gap.law.evaluate(gap.indentation(*nodes)))

    def density(self, body: str, displacement: np.ndarray) -> np.ndarray:
        """Return the density of a body's displacement (m-1)."""
        if self.spread == 0.0:
            return self.coordinate_density(displacement)
        scale = 1.0 / (math.sqrt(2.0 * math.pi) * self.spread)
        return self._smeared(body, displacement, lambda z: scale * np.exp(-0.5 * z * z))[1]

    def joint_density(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return the joint density of the displacements of the two bodies (m-2)."""
        difference = first - second
        rest = (first - self.weights[0] * difference) / self.spread
        normal = np.exp(-0.5 * rest * rest) / (math.sqrt(2.0 * math.pi) * self.spread)
        return np.asarray(self.coordinate_density(difference) * normal)

    def probability(self, body: str, displacement: np.ndarray) -> np.ndarray:
        """Return the probability that a body's displacement is smaller."""
        below, near = self._smeared(body, displacement, ndtr)
        return np.asarray(below + near)

    def _smeared(
        self, body: str, displacement: np.ndarray, kernel: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Sum what is below the Gaussian's reach, and what is within it times a kernel."""
        weight = self.weights[self.bodies.index(body)]
        extra = displacement
        if self.spread > 0.0:  # panels no wider than 2 spread, but only where the Gaussian is looked at
            panel = np.round(displacement / (2.0 * self.spread))[:, None] + np.arange(-6, 7)
            extra = np.unique(panel) * 2.0 * self.spread
        starts, offsets, probabilities = self.quadrature(extra / weight if weight else None)
        places = weight * (starts + offsets)
        if weight < 0.0:
            places, probabilities = places[::-1], probabilities[::-1]
        total = np.concatenate([[0.0], np.cumsum(probabilities)])
        start = np.searchsorted(places, displacement - _REACH * self.spread)
        stop = np.searchsorted(places, displacement + _REACH * self.spread)
        near = [
            probabilities[i:j] @ kernel((x - places[i:j]) / self.spread) if i < j else 0.0
            for x, i, j in zip(displacement, start, stop, strict=True)
        ]
        return total[start], np.array(near)

    def _panels(self) -> np.ndarray:
        """Return the edges of panels that resolve the density at all its scales."""
        corners = np.unique([0.0, *(gap.corner for gap in self.gaps)])
        points = np.unique(np.add.outer(corners, [*-_OCTAVES, 0.0, *_OCTAVES]))
        energy = self.energy(points)
        left, here, right = energy[:-2], energy[1:-1], energy[2:]
        is_well = (here < left) & (here <= right) & (here + 1e-3 < np.maximum(left, right))
        wells = [self._bottom(points[i], points[i + 2]) for i in np.flatnonzero(is_well)]
        edges = [corners]
        for place in (*corners, *wells):
            for distances in (-_OCTAVES, _OCTAVES):
                change = np.abs(self.energy(place + distances) - self.energy(np.array([place])))
                edges.append(place + distances[np.argmax(change > _START) :])
        return self._trimmed(np.unique(np.concatenate([*edges, wells])), corners)

    def _bottom(self, low: float, high: float) -> float:
        """Return the place of the minimum between two points."""
        for _ in range(12):
            points = np.linspace(low, high, 17)
            best = int(np.clip(np.argmin(self.energy(points)), 1, 15))
            low, high = points[best - 1], points[best + 1]
        return 0.5 * float(low + high)

    def _trimmed(self, edges: np.ndarray, corners: np.ndarray) -> np.ndarray:
        """Drop the panels beyond which the density has vanished, on both sides."""
        energy = self.energy(edges)
        object.__setattr__(self, "ground", float(energy.min()))
        left, right = energy[edges <= corners[0]], energy[edges >= corners[-1]][::-1]
        outside = [int(np.argmax(side <= side.min() + _END)) for side in (left, right)]
        if 0 in outside:
            raise NoExactReference(
                f"{self._names}: the law cannot be normalised, because neither a spring nor a contact "
                f"confines {'it' if len(self.bodies) == 1 else 'their distance'} on both sides."
            )
        return edges[outside[0] - 1 : len(edges) - outside[1] + 1]

    def _refined(self, edges: np.ndarray) -> np.ndarray:
        """Halve the panels until that changes no integral from one corner to the next."""
        tolerance = 1e-13 + 4e-16 * abs(self.ground)  # the second is the rounding of Φ/T
        corners = np.unique([gap.corner for gap in self.gaps])
        while len(edges) < _MOST_PANELS:
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
            f"{self._names}: the integral of exp(−H/T) does not converge; its potential is not smooth."
        )

    def _integrals(self, edges: np.ndarray) -> np.ndarray:
        """Return the integrals of ``exp(−Φ/T)``, alone and times each force, over each panel."""
        *nodes, lengths = _gauss_legendre(edges)
        density = lengths * np.exp(self.ground - self.energy(*nodes))
        forces = [gap.law.evaluate(gap.indentation(*nodes)) for gap in self.gaps]
        integrands = density * np.array([np.ones_like(density), *forces])
        return np.asarray(integrands.reshape(len(integrands), -1, len(_NODES)).sum(axis=-1))

    def _check_potentials(self) -> None:
        """Refuse a potential that is not the integral of its force."""
        starts, offsets, lengths = _gauss_legendre(self.edges)
        for gap in self.gaps:
            force = gap.law.evaluate(gap.indentation(starts, offsets))
            _check_work(gap.law, "potential", gap.indentation(self.edges).max(), lengths, force)
        if self.residual is not None:
            force = self.residual.call("residual", starts + offsets, 0.0)
            for end, side in ((self.edges[-1], starts >= 0.0), (self.edges[0], starts < 0.0)):
                steps = np.where(side, lengths, 0.0) * np.sign(end)
                _check_work(self.residual, "residual_potential", end, steps, force)

    @property
    def _names(self) -> str:
        return " and ".join(map(repr, self.bodies))


def _gauss_legendre(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nodes of the composite rule, as edges and offsets from them, and the weights."""
    half = 0.5 * np.diff(edges)[:, None]
    starts = np.repeat(edges[:-1], len(_NODES))
    return starts, (half * (1.0 + _NODES)).ravel(), (half * _WEIGHTS).ravel()


def _evaluate(component: Component, kernel: str, values: np.ndarray) -> np.ndarray:
    """Evaluate a potential; Python raises where it overflows, which here means infinite."""
    try:
        return component.call(kernel, values)
    except OverflowError:
        if values.size == 1:
            return np.full(values.shape, np.inf)
        return np.concatenate([_evaluate(component, kernel, half) for half in np.array_split(values, 2)])


def _check_work(component: Component, kernel: str, end: float, steps: np.ndarray, force: np.ndarray) -> None:
    """Compare a potential at the end with the work on the way there."""
    potential, work = float(component.call(kernel, end)), float(steps @ force)
    if abs(work - potential) > 1e-6 * max(float(np.abs(steps) @ np.abs(force)), abs(potential)):
        raise InvalidInput(
            f"{type(component).__name__}.{kernel} is not the integral of the force from 0: at {end:g} m "
            f"it is {potential:g} J and the integral {work:g} J."
        )
