"""The law of one coordinate whose density is given on panels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impactlab.components.contact import Contact
from impactlab.reference.marginal import Marginal
from impactlab.reference.piecewise import Piecewise
from impactlab.reference.potential import Gap


@dataclass(frozen=True, eq=False)
class Distribution:
    """Law of a displacement or of a difference of two."""

    law: Piecewise  # the density, not normalised, 0 outside its panels
    rarest: float = 1e-20  # density, relative to its top, that is still resolved

    @cached_property
    def total(self) -> float:
        """Integral of the density as it is given."""
        return float(self.law.integrals[0].sum())

    @cached_property
    def moments(self) -> tuple[float, float]:
        """Mean (m) and variance (m2)."""
        masses, nodes = self.law.masses[0], self.law.nodes
        mean = float((masses * nodes).sum() / masses.sum())
        return mean, float((masses * (nodes - mean) ** 2).sum() / masses.sum())

    def density(self, places: np.ndarray) -> np.ndarray:
        """Return the density (m-1)."""
        inside = (places >= self.law.edges[0]) & (places <= self.law.edges[-1])
        result = np.zeros(places.shape)
        result[inside] = self.law(places[inside])[0] / self.total
        return result

    def below(self, places: np.ndarray) -> np.ndarray:
        """Return the probability to be below some places."""
        return np.asarray(self.law.cumulative(places)[0] / self.total)

    def marginal(self, sign: float, shift: float, speed: float) -> Marginal:
        """Return the law of ``sign u + shift`` of the coordinate u; its rate has some standard deviation (m s-1)."""
        beyond = self.law.mirrored() if sign > 0.0 else self.law

        def above(level: float) -> float:
            return float(beyond.cumulative(np.array([shift - level]))[0, 0] / self.total)

        places = np.sort(sign * np.concatenate([self.law.edges, self.law.nodes.ravel()]) + shift)
        return Marginal(lambda places: self.density(sign * (places - shift)), above, places, speed, self.rarest)

    def of_gaps(self, gaps: Sequence[Gap]) -> list[tuple[float, float, float]]:
        """Return for contacts, which close at edges of panels, what `OfDistributions.contact` gives."""
        nodes, weights = self.law.nodes, self.law.masses[0] / self.law.masses[0].sum()
        result = []
        for gap, here in zip(gaps, self.density(np.array([gap.corner for gap in gaps])), strict=True):
            force = gap.law.evaluate(gap.indentation(nodes.ravel())).reshape(nodes.shape)
            closed = gap.indentation(nodes) > 0.0
            result.append((float(weights[closed].sum()), float(here), float((weights * force).sum())))
        return result


class OfDistributions(ABC):
    """Laws of bodies whose displacements have a density on panels."""

    temperature: float

    def __str__(self) -> str:
        return f"temperature {self.temperature:.6g} J, density proportional to exp(−H/T)"

    @abstractmethod
    def of_body(self, body: str) -> Distribution:
        """Return the law of a body's displacement."""

    @abstractmethod
    def contact(self, contact: Contact) -> tuple[float, float, float]:
        """Return the probability that a contact is closed, the density where it closes (m-1) and its mean force (N)."""

    @abstractmethod
    def gap_marginal(self, contact: Contact, speed: float) -> Marginal:
        """Return the law of a contact's indentation, its rate having some standard deviation (m s-1)."""

    def moments(self, body: str) -> tuple[float, float]:
        """Return the mean (m) and the variance (m2) of a body's displacement."""
        return self.of_body(body).moments

    def marginal(self, body: str, speed: float) -> Marginal:
        """Return the law of a body's displacement, its velocity having some standard deviation (m s-1)."""
        return self.of_body(body).marginal(1.0, 0.0, speed)

    def density(self, body: str, displacement: np.ndarray) -> np.ndarray:
        """Return the density of a body's displacement (m-1)."""
        return self.of_body(body).density(displacement)

    def probability(self, body: str, displacement: np.ndarray) -> np.ndarray:
        """Return the probability that a body's displacement is smaller."""
        return self.of_body(body).below(displacement)
