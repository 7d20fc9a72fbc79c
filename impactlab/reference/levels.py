"""How often levels are crossed, and what follows for largest values."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impactlab.components.contact import ContactLaw
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.inputs import finite, known_name
from impactlab.reference.known_laws import Laws
from impactlab.reference.marginal import Marginal, last_place

_CROSSING = ("displacement", "contact_force")


@dataclass(frozen=True, eq=False)
class Coordinate:
    """What has levels: a displacement, or a contact force, which grows with an indentation."""

    law: Marginal  # law of the displacement or the indentation
    force: ContactLaw | None = None  # law of the force

    @classmethod
    def of(cls, laws: Laws, name: str, quantity: str) -> Coordinate:
        """Return the coordinate of a body or a contact."""
        known_name("quantity", quantity, _CROSSING)
        if quantity == "displacement":
            return cls(laws.law(name, quantity).marginal(name, laws.speed(name)))
        law = laws.gap_law(name)
        contact = laws.network.contacts[name]
        if contact.law.impulsive:
            kind = type(contact.law).__name__
            raise NoExactReference(
                f"Contact {name!r} is a {kind}: its impacts have an impulse, but no force with levels."
            )
        marginal = law.gap_marginal(contact, laws.relative_speed(name))
        forces = contact.law.evaluate(np.unique(np.maximum(marginal.places, 0.0)))
        if (np.diff(forces) < 0.0).any():
            raise NoExactReference(
                f"The force of contact {name!r} decreases with the indentation somewhere; levels are known for forces "
                "that never do."
            )
        return cls(marginal, contact.law)

    def crossing_rate(self, level: float) -> float:
        """Return how often a level is crossed upwards (s-1)."""
        return self.law.rate(self._place_of(level))

    def return_level(self, time: float) -> float:
        """Return the highest level that is crossed upwards once in a time, on average."""
        if not 0.0 < time < math.inf:
            raise InvalidInput(f"return_level takes a positive time in s, not {time!r}.")
        return self._value_of(self.law.return_level(time))

    def exceedance(self, level: float, time: float) -> tuple[float, float]:
        """Return the probability to be above a level, and how often it is crossed upwards in a time."""
        if not 0.0 <= time < math.inf:
            raise InvalidInput(f"The time must be a finite number of at least 0 s, not {time!r}.")
        place = self._place_of(level)
        return self.law.exceedance(place), self.law.rate(place) * time

    def _value_of(self, place: float) -> float:
        """Return the displacement or the force at a place."""
        return place if self.force is None else float(self.force.evaluate(place))

    def _place_of(self, level: float) -> float:
        """Return the place above which a level is exceeded."""
        level = finite("level", level)
        if self.force is None:
            return level
        if level < 0.0:
            raise InvalidInput(f"A level of a contact force must be at least 0 N, not {level!r}.")
        high = max(float(self.law.places[-1]), 0.0)
        if self._value_of(high) <= level:
            return math.inf
        return last_place(0.0, high, lambda place: self._value_of(place) <= level)
