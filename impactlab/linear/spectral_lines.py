"""Sums of cosines, and the response of one body to them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Lines:
    """A sum of cosines on one body or several."""

    bodies: tuple[int, ...]  # slots
    name: str  # of the body or the source, which names the stream of the phases
    frequencies: np.ndarray  # (line,) angular (rad s-1)
    amplitudes: np.ndarray  # (line,) of the force (N)
    weights: tuple[float, ...] | tuple[np.ndarray, ...] = (1.0,)
    """Factor of the force on each body, or complex ones of all lines."""

    @property
    def gains(self) -> np.ndarray:
        """The same as an array, (body, 1 or line)."""
        weights = np.array(self.weights)
        return weights if weights.ndim > 1 else weights[:, None]


def receptance_of(mass: float, damping: float, stiffness: float, frequencies: np.ndarray) -> np.ndarray:
    """Return the complex displacement per unit force at angular frequencies, ``1/(k − m ω² + i c ω)`` (m N-1)."""
    dynamic = stiffness - mass * frequencies**2 + 1j * damping * frequencies
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(dynamic != 0.0, 1.0 / dynamic, np.inf)


def regular_lines(frequencies: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Return whole numbers k and the period P such that all ``ω = 2π k/P``, or None."""
    spacing = float(frequencies[1] - frequencies[0]) if len(frequencies) > 1 else float(frequencies[0])
    if spacing <= 0.0 or frequencies[0] < 0.0:
        return None
    if len(frequencies) > 1:
        spacing = float(frequencies[-1] - frequencies[0]) / (len(frequencies) - 1)
    k = frequencies / spacing
    whole = np.rint(k)
    if np.abs(k - whole).max() > 1e-6 or np.abs(np.diff(whole) - 1.0).max(initial=0.0) > 0.0:
        return None
    return whole.astype(np.int64), 2.0 * math.pi / spacing
