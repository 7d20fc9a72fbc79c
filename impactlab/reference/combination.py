"""Exact law of linear bodies whose contacts all act along one combination of their displacements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from impactlab.components.contact import Contact
from impactlab.components.matrices import ZERO
from impactlab.components.sides import weights_of
from impactlab.errors import NoExactReference
from impactlab.linear.systems import LinearSystem
from impactlab.reference.gibbs import GibbsLaw
from impactlab.reference.linear_laws import LinearPart
from impactlab.reference.potential import Gap, Potential
from impactlab.reference.subsystems import SAME_TEMPERATURE, Subsystem, is_linear, listed


@dataclass(frozen=True, eq=False)
class CombinationLaw(GibbsLaw):
    """Stationary law of linear bodies with contacts along one combination ``q = w·x`` of their displacements.

    Without contacts the displacements are Gaussian with the covariance ``T K⁻¹``. Given q they stay so, with mean
    ``K⁻¹w q/(wᵀK⁻¹w)`` and covariance ``T (K⁻¹ − K⁻¹w wᵀK⁻¹/(wᵀK⁻¹w))``; and q has the potential
    ``q²/(2 wᵀK⁻¹w)`` and that of the contacts.
    """

    along: Mapping[str, float] = field(kw_only=True)  # w, by the name of the body
    beside: np.ndarray = field(kw_only=True)  # covariance of the displacements given q (m2)

    @classmethod
    def of(cls, bodies: tuple[str, ...], system: LinearSystem, contacts: list[Contact], temperature: float) -> GibbsLaw:
        """Return the law of some bodies at a temperature (J)."""
        along = weights_of(contacts[0])
        weights = np.array([along.get(name, 0.0) for name in bodies])
        compliance = np.linalg.inv(system.stiffness)
        moved = compliance @ weights
        total = float(weights @ moved)
        gaps = tuple(_gap(contact, along) for contact in contacts)
        potential = Potential(listed(bodies), temperature, 1.0 / total, gaps)
        beside = temperature * (compliance - np.outer(moved, moved) / total)
        return cls(bodies, potential, tuple((moved / total).tolist()), along=along, beside=beside)

    def __str__(self) -> str:
        return f"temperature {self.temperature:.6g} J, Gaussian but for one combination of displacements"

    def gap(self, contact: Contact) -> Gap:
        return _gap(contact, self.along)

    def variance_beside(self, weights: Mapping[str, float]) -> float:
        own = np.array([weights.get(name, 0.0) for name in self.bodies])
        return max(float(own @ self.beside @ own), 0.0)

    def joint_density(self, first: str, second: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Refuse: it is not computed for contacts along a combination."""
        raise NoExactReference(
            f"The joint density of {first!r} and {second!r}, whose contacts act along a combination, is not computed."
        )


@dataclass(frozen=True, eq=False)
class CombinationPart:
    """Bodies on linear couplings whose contacts all act along one combination of their displacements, or may do so."""

    subsystem: Subsystem

    @cached_property
    def fits(self) -> bool:
        """Whether they are such bodies, at whatever temperatures."""
        contacts = [weights_of(item) for item in self.subsystem.contacts.values()]
        couplings = self.subsystem.couplings.values()
        if not contacts or self.subsystem.bent or not all(map(is_linear, couplings)):
            return False
        return all(_sign(own, contacts[0]) for own in contacts)

    @cached_property
    def _system(self) -> LinearSystem:
        return LinearPart(self.subsystem).system

    @cached_property
    def temperature(self) -> float:
        """The temperature at which noises and dampers are in balance (J), NaN if there is none.

        Balance is ``π S = T C`` of the matrices of spectral densities and of damping.
        """
        damping, noise = self._system.damping, math.pi * self._system.intensity
        own = np.diagonal(damping)
        if not (own > 0.0).any():
            return math.nan
        temperature = float(np.median(np.diagonal(noise)[own > 0.0] / own[own > 0.0]))
        size = np.sqrt(np.maximum(own, 0.0))
        off = np.abs(noise - temperature * damping)
        balanced = temperature > 0.0 and (off <= SAME_TEMPERATURE * temperature * np.outer(size, size)).all()
        return temperature if balanced else math.nan

    def reasons(self) -> Iterator[str]:
        """Say why there is no law, beside the laws and excitations themselves."""
        bodies, values = listed(self.subsystem.bodies), np.linalg.eigvalsh(self._system.stiffness)
        if math.isnan(self.temperature):
            yield (
                f"{bodies}: the noises are not in balance with the damping at one temperature; with contacts along a "
                "combination the law is known if the matrices of spectral densities S and of damping C are in "
                "proportion, π S = T C."
            )
        elif not self._system.rates.all():
            yield f"{bodies}: a motion has no damping and no noise of its own; with both there would be a law."
        if values[0] <= ZERO * values[-1]:
            yield (
                f"{bodies}: the law cannot be normalised, because no spring confines one of their motions; more "
                "stiffness would."
            )

    @property
    def law(self) -> GibbsLaw:
        """The law, where there are no reasons against it."""
        contacts = list(self.subsystem.contacts.values())
        return CombinationLaw.of(self.subsystem.bodies, self._system, contacts, self.temperature)


def _gap(contact: Contact, along: Mapping[str, float]) -> Gap:
    """Return a contact as the coordinate along some weights sees it."""
    return Gap(contact.law, float(_sign(weights_of(contact), along)), contact.clearance)


def _sign(weights: Mapping[str, float], along: Mapping[str, float]) -> int:
    """Return 1 if some weights are others, −1 if they are their opposites, otherwise 0."""
    if weights.keys() != along.keys():
        return 0
    ratios = {weights[name] / along[name] for name in along}
    return next((sign for sign in (1, -1) if ratios == {float(sign)}), 0)
