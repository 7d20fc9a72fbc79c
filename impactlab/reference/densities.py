"""Densities of one displacement or velocity, as references give them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from impactlab.errors import InvalidInput
from impactlab.inputs import FiniteNumbers, checked
from impactlab.reference.marginal import OfPlaces

STATE_QUANTITIES = ("displacement", "velocity")


class Curves(NamedTuple):
    """Law of one quantity at some places."""

    density: OfPlaces
    probability_below: OfPlaces


def normal_curves(deviation: float) -> Curves:
    """Return the normal law with mean 0 and some standard deviation."""
    top = 1.0 / (math.sqrt(2.0 * math.pi) * deviation)
    return Curves(
        lambda values: np.asarray(top * np.exp(-0.5 * (values / deviation) ** 2)),
        lambda values: np.asarray(ndtr(values / deviation)),
    )


@checked
class Densities(ABC):
    """What a reference tells of one quantity at a time."""

    @abstractmethod
    def _curves(self, oscillator: str, quantity: str) -> Curves:
        """Return the law of a displacement or a velocity; refuse names that are unknown."""

    def density(self, oscillator: str, quantity: str, grid: FiniteNumbers) -> np.ndarray:
        """Return the probability density of a displacement or a velocity.

        Parameters
        ----------
        oscillator : str
            Name of the body, or of a point of a structure.
        quantity : {"displacement", "velocity"}
            Whose density.
        grid : array_like
            Where (m or m s-1).

        Returns
        -------
        ndarray
            Density (m-1 or s m-1), of the shape of `grid`.

        Raises
        ------
        InvalidInput
            If a name is unknown or a number is not finite.
        """
        law = self._curves(oscillator, quantity)
        return law.density(grid.ravel()).reshape(grid.shape)

    def bin_density(self, oscillator: str, quantity: str, edges: FiniteNumbers) -> np.ndarray:
        """Return the averages of the density over bins, as a histogram estimates them.

        Parameters
        ----------
        oscillator : str
            Name of the body, or of a point of a structure.
        quantity : {"displacement", "velocity"}
            Whose density.
        edges : array_like
            Increasing edges of the bins (m or m s-1).

        Returns
        -------
        ndarray
            One value for every bin (m-1 or s m-1).

        Raises
        ------
        InvalidInput
            If a name is unknown or the edges do not increase.
        """
        law, places = self._curves(oscillator, quantity), edges
        if places.ndim != 1 or len(places) < 2 or not (np.diff(places) > 0.0).all():
            raise InvalidInput("edges must be at least two increasing numbers in one dimension.")
        return np.asarray(np.diff(law.probability_below(places)) / np.diff(places))
