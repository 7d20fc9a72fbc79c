"""Laws of one coordinate: crossings of levels, return levels, and what follows for largest values."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from impactlab.errors import InvalidInput, NoExactReference
from impactlab.reference.potential import composite_rule

_RATES = np.linspace(-9.0, 9.0, 13)  # panels, in standard deviations

OfPlaces = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Marginal:
    """Law of a displacement or an indentation whose rate is Gaussian and independent of it.

    A level u is then crossed upwards at the rate ``speed/sqrt(2π) p(u)`` (Rice, Bell Syst.
    Tech. J. 24, 1945, 46).
    """

    density: OfPlaces  # density p (m-1) at some places (m)
    above: Callable[[float], float]  # probability of more than one place
    places: np.ndarray
    """(place,) increasing places, close enough to show every peak of the density; at the last it has vanished."""
    speed: float  # standard deviation of the rate (m s-1)
    rarest: float = 1e-20  # density, relative to its top, that is still resolved

    def mean(self, function: Callable[[np.ndarray, np.ndarray], np.ndarray], second: OfPlaces) -> float:
        """Return the mean of a function of the place, which may have a kink at 0, and of a second quantity there."""
        places, probabilities = self._quadrature
        return float(probabilities @ function(places, second(places)))

    def mean_with_rate(self, function: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> float:
        """Return the mean of a function of the place and its rate, which may have a kink where that is 0."""
        starts, offsets, lengths = composite_rule(_RATES)
        rates = starts + offsets
        weights = lengths * np.exp(-0.5 * rates**2) / math.sqrt(2.0 * math.pi)
        means = [self.mean(function, partial(np.full_like, fill_value=self.speed * rate)) for rate in rates]
        return float(weights @ means)

    @cached_property
    def _quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Places and their probabilities, by panels that end at 0."""
        starts, offsets, lengths = composite_rule(np.unique(np.append(self.places, 0.0)))
        places = starts + offsets
        return places, lengths * self.density(places)

    def exceedance(self, level: float) -> float:
        """Return the probability to be above a level."""
        return self.above(level) if level < self.places[-1] else 0.0

    def rate(self, level: float) -> float:
        """Return how often a level is crossed upwards (s-1)."""
        if level > self.places[-1]:
            return 0.0
        return self.speed / math.sqrt(2.0 * math.pi) * float(self.density(np.array([level]))[0])

    def return_level(self, time: float) -> float:
        """Return the highest level that is crossed upwards once in a time, on average.

        It is refused where none is crossed so often, or the density is not known so far out.
        """
        wanted = math.sqrt(2.0 * math.pi) / (self.speed * time)
        values = self.density(self.places)
        often = np.flatnonzero(values >= wanted)
        if not len(often):
            shortest = math.sqrt(2.0 * math.pi) / (self.speed * values.max())
            raise InvalidInput(
                f"Any level is crossed upwards less than once in {time:g} s, at most once in {shortest:.6g} s; "
                "give a longer time."
            )
        if wanted < self.rarest * values.max():
            raise NoExactReference(
                f"Levels that are crossed once in {time:g} s are too rare to be resolved; give a shorter time."
            )
        low, high = self.places[often[-1] : often[-1] + 2]
        return last_place(low, high, lambda place: bool(self.density(np.array([place]))[0] >= wanted))


def last_place(low: float, high: float, holds: Callable[[float], bool]) -> float:
    """Return the last place from low on where something holds, which it no longer does at high."""
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if holds(middle) else (low, middle)
    return float(low)
