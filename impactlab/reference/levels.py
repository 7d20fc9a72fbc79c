"""How often levels are crossed, and what follows for largest values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from impactlab.components.component import finite
from impactlab.components.contact import ContactLaw
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.reference.laws import Laws, finite_array, known_name
from impactlab.reference.marginal import Marginal

_CROSSING = ("displacement", "contact_force")


class Levels(Laws):
    """What is known of levels of displacements and contact forces."""

    def onset_velocity_density(self, contact: str, grid: Any) -> np.ndarray:
        """Return the probability density of the relative velocity with which a contact closes.

        It is Rayleigh's, ``v/s² exp(−v²/2s²)`` with ``s² = T/μ``, whatever the contact.

        Parameters
        ----------
        contact : str
            Name of the contact.
        grid : array_like
            Where (m s-1).

        Returns
        -------
        ndarray
            Density (s m-1), of the shape of `grid`; 0 for velocities that part the bodies.

        Raises
        ------
        InvalidInput
            If the name is unknown or a number is not finite.
        NoExactReference
            If the contact is one of those that are left out.
        """
        self._gap_law(contact)
        scale, grid = self._relative_speed(contact), finite_array("grid", grid)
        forwards = np.maximum(grid, 0.0) / scale
        return np.asarray(forwards / scale * np.exp(-0.5 * forwards**2))

    def crossing_rate(self, name: str, quantity: str, level: float) -> float:
        """Return how often a level is crossed upwards, by Rice's formula.

        Parameters
        ----------
        name : str
            Name of a body or a contact.
        quantity : {"displacement", "contact_force"}
            Of a body or of a contact. (Under white noise a velocity crosses each of its levels
            infinitely often.)
        level : float
            The level (m or N).

        Returns
        -------
        float
            Crossings per second. Levels at which the density is less than 10⁻²⁰ of its top are not
            resolved.

        Raises
        ------
        InvalidInput
            If a name is unknown, or the level is not finite or a negative force.
        NoExactReference
            If cosines move the body, the contact is one of those that are left out, or its
            force falls with the indentation somewhere.
        """
        coordinate = self._coordinate(name, quantity)
        return coordinate.law.rate(coordinate.place_of(_level(quantity, level)))

    def return_level(self, name: str, quantity: str, time: float) -> float:
        """Return the highest level that is crossed upwards once in a time, on average.

        Parameters
        ----------
        name, quantity : str
            As in :meth:`crossing_rate`.
        time : float
            The time (s).

        Returns
        -------
        float
            The level (m or N).

        Raises
        ------
        InvalidInput
            If a name is unknown, the time is not positive, or no level is crossed so often.
        NoExactReference
            As in :meth:`crossing_rate`.
        """
        coordinate = self._coordinate(name, quantity)
        if not 0.0 < time < math.inf:
            raise InvalidInput(f"return_level takes a positive time in s, not {time!r}.")
        return coordinate.value_of(coordinate.law.return_level(time))

    def exceedance_bound(self, name: str, quantity: str, level: float, time: float = 0.0) -> float:
        """Return an upper bound of the probability that a level is exceeded within a time.

        It is ``P(now above) + rate · time``, which always holds, and exact for the time 0.

        Parameters
        ----------
        name, quantity, level
            As in :meth:`crossing_rate`.
        time : float
            The time (s).

        Returns
        -------
        float
            At most 1.

        Raises
        ------
        InvalidInput, NoExactReference
            As in :meth:`crossing_rate`, and if the time is negative.
        """
        now, crossings = self._exceedance(name, quantity, level, time)
        return min(1.0, now + crossings)

    def exceedance_estimate(self, name: str, quantity: str, level: float, time: float) -> float:
        """Return an estimate of the same probability for crossings that are independent of each other.

        It is ``1 − P(not now above) exp(−rate · time)``, never more than :meth:`exceedance_bound`.
        It is right for levels that are rarely crossed; where motion is weakly damped crossings
        come in clusters, and it is too large.

        Parameters
        ----------
        name, quantity, level, time
            As in :meth:`exceedance_bound`.

        Returns
        -------
        float

        Raises
        ------
        InvalidInput, NoExactReference
            As in :meth:`exceedance_bound`.
        """
        now, crossings = self._exceedance(name, quantity, level, time)
        return now - (1.0 - now) * math.expm1(-crossings)

    def _coordinate(self, name: str, quantity: str) -> Coordinate:
        """Return what has levels: a displacement, or the indentation behind a force."""
        known_name("quantity", quantity, _CROSSING)
        if quantity == "displacement":
            return Coordinate(self._law(name, quantity).marginal(name, self._speed(name)))
        law = self._gap_law(name)
        contact = self.network.contacts[name]
        marginal = law.gap_marginal(contact, self._relative_speed(name))
        forces = contact.law.evaluate(np.unique(np.maximum(marginal.places, 0.0)))
        if (np.diff(forces) < 0.0).any():
            raise NoExactReference(
                f"The force of contact {name!r} decreases with the indentation somewhere; levels are known for forces "
                "that never do."
            )
        return Coordinate(marginal, contact.law)

    def _exceedance(self, name: str, quantity: str, level: float, time: float) -> tuple[float, float]:
        """Return the probability to be above a level, and how often it is crossed upwards in a time."""
        if not 0.0 <= time < math.inf:
            raise InvalidInput(f"The time must be a finite number of at least 0 s, not {time!r}.")
        coordinate = self._coordinate(name, quantity)
        place = coordinate.place_of(_level(quantity, level))
        return coordinate.law.exceedance(place), coordinate.law.rate(place) * time


@dataclass(frozen=True, eq=False)
class Coordinate:
    """What has levels: a displacement, or a contact force, which grows with an indentation.

    Attributes
    ----------
    law : Marginal
        Law of the displacement or the indentation.
    force : ContactLaw, optional
        Law of the force.
    """

    law: Marginal
    force: ContactLaw | None = None

    def value_of(self, place: float) -> float:
        """Return the displacement or the force at a place."""
        return place if self.force is None else float(self.force.evaluate(place))

    def place_of(self, level: float) -> float:
        """Return the place above which a level is exceeded."""
        if self.force is None:
            return level
        low, high = 0.0, max(float(self.law.places[-1]), 0.0)
        if self.value_of(high) <= level:
            return math.inf
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (middle, high) if self.value_of(middle) <= level else (low, middle)
        return low


def _level(quantity: str, level: float) -> float:
    level = finite("level", level)
    if quantity == "contact_force" and level < 0.0:
        raise InvalidInput(f"A level of a contact force must be at least 0 N, not {level!r}.")
    return level
