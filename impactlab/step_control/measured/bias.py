"""The bias of a step in one statistic, the size that it is a part of, and when it is known: the vocabulary.

- The *bias* of a step is the expectation of a statistic at the step less that of the motion itself; its *error* is its
  standard error. Both are parts of the *size* of the statistic, where nothing else is said.
- The *scatter* of a statistic is its standard error without what the step adds.
- A bias is not known within its *margin*, so many of its errors.
- A step does if no bias is certainly larger than what is *tolerated*; the user's `tolerance` takes the place of this.
- The *allowance* is the root mean square of the bias, given its measurement: standard errors of results contain it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np

from impactlab.errors import WORTH_SAYING
from impactlab.results.schema import EVERY, STATE
from impactlab.statistics.regression import CERTAIN, largest_of

TOLERATED = 0.0015
"""Bias of the step, as a part of a statistic, up to which a step that is chosen will do."""

USUAL_BIAS = TOLERATED / 3.0
"""Standard deviation of the biases of chosen steps before a measurement: hardly any is larger than what is tolerated.
In 51 random networks it was 0.05 % by maximum likelihood."""

MARGIN_OF_BIAS = 2.5
"""Margin of a bias, in its errors, where few statistics are looked at."""

STILL = 1e-9
"""Part of the mean square of a displacement below which its variance is rounding, or what a spin-up has left."""


class Bias(NamedTuple):
    """Bias of the step in one statistic, measured in any way; arrays over its labels."""

    value: np.ndarray
    error: np.ndarray  # standard error of the value
    unsure: np.ndarray | float = 0.0
    """Standard error beside `error`, of what the compared paths cannot tell. It does not count where a step is chosen.
    """
    apart: np.ndarray | bool = False
    """Whether small changes grow until paths are apart; the error is then that of averages along them."""

    def least(self, margin: float) -> np.ndarray:
        """Return the smallest likely size of the bias, below 0 where the bias may be 0."""
        return np.asarray(np.abs(self.value) - margin * self.error)

    def most(self, margin: float) -> np.ndarray:
        """Return the largest size that the bias may have."""
        return np.asarray(np.abs(self.value) + margin * self.error)

    def told(self) -> Self:
        """Return the bias with an error that allows for differences that the compared paths cannot show."""
        return self._replace(error=np.hypot(self.error, self.unsure), unsure=0.0)

    def with_order(self, part: float) -> Self:
        """Return the bias with an error that allows for a convergence with another power of the step."""
        return self._replace(error=np.hypot(self.error, part * self.value if part else 0.0))

    def at(self, ratio: float, order: float) -> Self:
        """Return the bias at a step that is smaller by a ratio: it falls with a power of the step, from 1 to `order`.

        The value assumes `order`; the difference from the first power counts as a standard error.
        """
        expected, beyond = ratio**order, ratio * (1.0 - ratio ** (order - 1.0))
        return self._replace(
            value=expected * self.value, error=np.hypot(expected * self.error, beyond * np.abs(self.value))
        )

    def or_from(self, other: Self) -> Self:
        """Return this bias, or another estimate where that is known better and paths are not apart."""
        better = (other.error < self.error) & ~np.asarray(self.apart)
        value, error = (np.where(better, there, here) for here, there in zip(self[:2], other[:2], strict=True))
        return self._replace(value=value, error=error)

    def allowance(self, usual: float, margin: float) -> np.ndarray:
        """Return the root mean square of the bias, given what was measured: as large as it may well be.

        Before a measurement, the bias b of a chosen step is a normal number with the standard deviation s that is
        `usual`. After the measurement b̂ ± σ it has the mean q b̂ and the variance q σ² = (1 − q) s², with
        q = s²/(s² + σ²). Beyond the margin, the bias is unusual and the measurement is taken as it is: q = 1.
        """
        known = np.where(np.abs(self.value) > margin * self.error, 1.0, 1.0 / (1.0 + (self.error / usual) ** 2))
        return np.asarray(np.hypot(known * self.value, np.sqrt(1.0 - known) * usual))


def tolerated(name: str) -> float:
    """Return the bias of a statistic up to which a step that is chosen will do.

    States of laws may have a bias that is too small for a warning: few users need the velocity at which a contact has
    closed, which takes steps four times as fine as the motion.
    """
    return WORTH_SAYING if EVERY[name].dimension == STATE else TOLERATED


def margin_of(number: int) -> float:
    """Return the margin of biases, in their errors: the more are examined, the farther off the largest is by chance."""
    return largest_of(number, MARGIN_OF_BIAS)


def size_of(name: str, mean: Callable[[str], np.ndarray], scatter: np.ndarray | None = None) -> np.ndarray:
    """Return the size to which a bias or a tolerance of a statistic is relative, from values by name.

    The size is the value or, for a mean that may be 0, the root mean square, unless its scatter shows that the mean is
    not 0.
    """
    square = EVERY[name].square
    if square and scatter is None:
        return np.asarray(np.sqrt(mean(square)))
    size = np.abs(mean(name))
    if square and scatter is not None:
        size = np.where(size < CERTAIN * scatter, np.sqrt(mean(square)), size)
    if name == "variance_displacement":  # of a body that a load holds still
        size = np.maximum(size, STILL * mean("mean_square_displacement"))
    return np.asarray(size)
