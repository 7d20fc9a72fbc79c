"""Linear motion under a noise that is not white: what exact laws, starts and steps ask of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlab.components.excitation import Excitation
from impactlab.linear.systems import LinearSystem


class NoiseMotion:
    """What one noise moves: states of its own, then displacements and velocities of some bodies."""

    name: str  # of the body or the source, which names its random numbers
    excitation: Excitation
    slots: np.ndarray  # (body,)
    system: LinearSystem  # of these bodies
    weights: np.ndarray  # (body,) of the force on each

    states: Any = 0
    """Number of the states of its own."""

    called: str
    """The noise in the words of messages."""

    gaussian: bool = True
    """Whether the law of the bodies is Gaussian."""

    drift: Any
    """Drift of all states, where there are states of its own."""

    rate: Any
    """Bound of the eigenvalues of the drift (s-1)."""

    @property
    def drives(self) -> bool:
        """Whether the noise moves anything."""
        raise NotImplementedError

    @property
    def white(self) -> np.ndarray | None:
        """Spectral densities of white noises of the same covariance, (body, body); None where there are no such."""
        return None

    @property
    def largest_envelope(self) -> float:
        """Largest size of the envelope."""
        return self.excitation.largest_modulation

    @property
    def modulated(self) -> bool:
        """Whether there is an envelope."""
        return self.excitation.has_kernel("modulation")

    @property
    def mean(self) -> np.ndarray:
        """Mean displacements and velocities, (2, body)."""
        return np.zeros((2, len(self.slots)))

    covariance: Any
    """Stationary covariance of all states; None if there is none."""

    def variances(self) -> np.ndarray:
        """Return the mean squares of displacement and velocity without envelope, infinite without a law, (2, body)."""
        raise NotImplementedError

    def start(self) -> np.ndarray:
        """Return a root of the covariance of all states where a run begins."""
        raise NotImplementedError

    def filter_start(self) -> np.ndarray:
        """Return the covariance of the states of its own where a run begins."""
        raise NotImplementedError

    def growth(self, size: int) -> np.ndarray:
        """Return the growth of the covariance of `size` states per time by the noise, states of its own first."""
        raise NotImplementedError

    def autocovariance(self, places: Sequence[int], factors: np.ndarray, lags: np.ndarray) -> np.ndarray:
        """Return the autocovariance of a weighted sum of displacements or velocities, places of (x, v), (lag,)."""
        raise NotImplementedError

    def spectrum(self, along: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
        """Return the spectral density of a sum of displacements with weights, (body,), (m2 s rad-1), (frequency,)."""
        raise NotImplementedError
