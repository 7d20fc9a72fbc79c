"""Potential energy of one coordinate: springs, residual potentials and contacts, in units of T."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from impactlab.components.component import Component
from impactlab.components.contact import Contact, ContactLaw
from impactlab.components.coupling import Coupling, CouplingLaw
from impactlab.components.oscillator import Oscillator
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.quadrature import gauss_legendre

NODES_OF_PANEL, WEIGHTS = gauss_legendre(16)

OCTAVES, USUAL = 100, 50
"""Octaves from a metre to the shortest and the longest distance at which a potential is looked at; and by how many a
standard deviation may differ from a metre. Beyond that the distances reach as far from it as well."""


@dataclass(frozen=True)
class Gap:
    """A contact as the coordinate q sees it: indentation ``sign q − clearance``."""

    law: ContactLaw
    sign: float
    clearance: float

    @classmethod
    def of(cls, contact: Contact, body: str) -> Gap:
        """Return a contact as a gap of the coordinate that grows with a body's displacement."""
        return cls(contact.law, 1.0 if contact.first == body else -1.0, contact.clearance)

    def indentation(self, coordinate: np.ndarray, offset: np.ndarray | float = 0.0) -> np.ndarray:
        """Return δ at ``coordinate + offset``: the sum itself could round away a stiff contact's δ."""
        return np.asarray((self.sign * coordinate - self.clearance) + self.sign * offset)

    @property
    def corner(self) -> float:
        """Coordinate at which the contact closes."""
        return self.sign * self.clearance


@dataclass(frozen=True)
class Spring:
    """What the coordinate q feels of a residual force, or of a coupling that is not linear: a law at ``sign q``."""

    law: Oscillator | CouplingLaw
    sign: float = 1.0

    @classmethod
    def of(cls, coupling: Coupling, body: str) -> Spring:
        """Return a coupling as a spring of the coordinate that grows with a body's displacement."""
        return cls(coupling.law, 1.0 if coupling.second == body else -1.0)

    @property
    def kernel(self) -> str:
        """Name of the kernel of the potential."""
        return "residual_potential" if isinstance(self.law, Oscillator) else "potential"

    def energy(self, place: np.ndarray) -> np.ndarray:
        """Return the potential at some places (J)."""
        return _evaluate(self.law, self.kernel, self.sign * place)

    def force(self, place: np.ndarray) -> np.ndarray:
        """Return the force that pulls back (N)."""
        force = "residual" if isinstance(self.law, Oscillator) else "force"
        return np.asarray(self.sign * self.law.call(force, self.sign * place, 0.0))


@dataclass(frozen=True)
class Potential:
    """Energy Φ of a coordinate q, the displacement of a body or the difference of two.

    ``Φ = stiffness q²/2 + potentials of other springs and of the contacts``; from it a line
    may be taken off, ``slope q + level`` in units of T.
    """

    names: str = field(compare=False)  # the bodies, as messages show them
    temperature: float  # T (J)
    stiffness: float  # stiffness of the coordinate (N m-1)
    gaps: tuple[Gap, ...] = ()  # the contacts
    springs: tuple[Spring, ...] = ()  # residual forces and couplings that are not linear
    slope: float = 0.0  # of the line that is taken off (m-1)
    level: float = 0.0  # of the line

    @property
    def corners(self) -> np.ndarray:
        """Coordinates at which a contact closes, and 0, unless an infinite potential keeps it from there."""
        places = np.unique([0.0, *(gap.corner for gap in self.gaps)])
        return places[self.energy(places) < math.inf]

    @property
    def octaves(self) -> np.ndarray:
        """Distances at which the potential is looked at (m)."""
        size = math.frexp(math.sqrt(self.temperature / self.stiffness))[1] if self.stiffness else 0
        size = 0 if abs(size) < USUAL else size
        return 2.0 ** np.arange(min(size, 0) - OCTAVES, max(size, 0) + OCTAVES + 1)

    def energy(self, coordinate: np.ndarray, offset: np.ndarray | float = 0.0) -> np.ndarray:
        """Return Φ/T, less the line, at ``coordinate + offset``; infinite where too large for a number, never NaN."""
        place = coordinate + offset
        with np.errstate(over="ignore"):
            return self._energy(coordinate, offset, place)

    def _energy(self, coordinate: np.ndarray, offset: np.ndarray | float, place: np.ndarray) -> np.ndarray:
        total = 0.5 * self.stiffness * place**2
        for spring in self.springs:
            total = total + spring.energy(place)
        for gap in self.gaps:
            indentation = gap.indentation(coordinate, offset)
            closed = indentation > 0.0
            total[closed] += _evaluate(gap.law, "potential", indentation[closed])
        if np.isnan(total).any():
            raise NoExactReference(f"{self.names}: the potential is NaN at {place[np.isnan(total)][0]:g} m.")
        return np.asarray(total / self.temperature - self.slope * place - self.level)

    def force(self, coordinate: np.ndarray) -> np.ndarray:
        """Return the derivative of Φ/T (m-1)."""
        total = self.stiffness * coordinate
        for spring in self.springs:
            total = total + spring.force(coordinate)
        for gap in self.gaps:
            total = total + gap.sign * gap.law.evaluate(gap.indentation(coordinate))
        return np.asarray(total / self.temperature - self.slope)

    def panels(self, start: float = 1e-8) -> np.ndarray:
        """Return edges that double in distance from every corner and minimum, as far as numbers go.

        They begin where Φ/T has changed by `start`.
        """
        corners, octaves = self.corners, self.octaves
        points = np.unique(np.add.outer(corners, [*-octaves, 0.0, *octaves]))
        energy = self.energy(points)
        left, here, right = energy[:-2], energy[1:-1], energy[2:]
        is_well = (here < left) & (here <= right) & (here + 1e-3 < np.maximum(left, right))
        wells = [self._bottom(points[i], points[i + 2]) for i in np.flatnonzero(is_well)]
        edges = [corners, np.array(wells)]
        for place in (*corners, *wells):
            for distances in (-octaves, octaves):
                # where it is infinite there is no density
                # an infinite energy counts as 1e300 T in a difference
                change = np.minimum(self.energy(place + distances), 1e300) - self.energy(np.array([place]))
                change = np.abs(change) > start
                edges.append(place + distances[np.argmax(change) :] if change.any() else np.empty(0))
        return np.unique(np.concatenate(edges))

    def _bottom(self, low: float, high: float) -> float:
        """Return the place of the minimum between two points."""
        for _ in range(12):
            points = np.linspace(low, high, 17)
            best = int(np.clip(np.argmin(self.energy(points)), 1, 15))
            low, high = points[best - 1], points[best + 1]
        return 0.5 * float(low + high)

    def check_work(self, edges: np.ndarray) -> None:
        """Refuse a potential that is not the integral of its force, on panels that hold all corners."""
        starts, offsets, lengths = composite_rule(edges)
        for gap in self.gaps:
            if gap.law.impulsive:
                continue
            force = gap.law.evaluate(gap.indentation(starts, offsets))
            _check_work(gap.law, "potential", gap.indentation(edges).max(), lengths, force)
        for spring in self.springs:
            force = spring.sign * spring.force(starts + offsets)
            for end, side in ((edges[-1], starts >= 0.0), (edges[0], starts < 0.0)):
                steps = np.where(side, lengths, 0.0) * np.sign(end)
                _check_work(spring.law, spring.kernel, spring.sign * end, spring.sign * steps, force)


def composite_rule(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nodes of the composite rule, as edges and offsets from them, and the weights."""
    half = 0.5 * np.diff(edges)[:, None]
    starts = np.repeat(edges[:-1], len(NODES_OF_PANEL))
    return starts, (half * (1.0 + NODES_OF_PANEL)).ravel(), (half * WEIGHTS).ravel()


def _evaluate(component: Component, kernel: str, values: np.ndarray) -> np.ndarray:
    """Evaluate a potential; Python raises where it overflows, which here means infinite."""
    try:
        return component.call(kernel, values)
    except OverflowError:
        if values.size == 1:
            return np.full(values.shape, np.inf)
        halves = [_evaluate(component, kernel, half) for half in np.array_split(values.ravel(), 2)]
        return np.concatenate(halves).reshape(values.shape)


def _check_work(component: Component, kernel: str, end: float, steps: np.ndarray, force: np.ndarray) -> None:
    """Compare a potential at the end with the work on the way there."""
    potential, work = float(_evaluate(component, kernel, np.array([end]))[0]), float(steps @ force)
    within = 1e-6 * max(float(np.abs(steps) @ np.abs(force)), abs(potential))
    if math.isinf(potential) != math.isinf(work) or abs(work - potential) > within:
        raise InvalidInput(
            f"{type(component).__name__}.{kernel} is not the integral of the force from 0: at {end:g} m "
            f"it is {potential:g} J and the integral {work:g} J."
        )
