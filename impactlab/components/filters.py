"""Linear filters of white noise, as numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.components.component import Component
from impactlab.errors import InvalidInput
from impactlab.inputs import real_array, shown


class Filter(NamedTuple):
    """A linear filter ``z' = A z + b w``, ``f = c z`` of white noise w, ``E[w(t) w(t+τ)] = 2π δ(τ)``."""

    drift: np.ndarray  # (state, state) A
    input: np.ndarray  # (state,) b
    output: np.ndarray  # (state,) c

    @property
    def rates(self) -> np.ndarray:
        """Rates at which its motions decay (s-1), (state,)."""
        return np.asarray(-np.linalg.eigvals(self.drift).real)

    @property
    def fastest(self) -> float:
        """Magnitude of its largest eigenvalue (s-1)."""
        return float(np.abs(np.linalg.eigvals(self.drift)).max())

    def density(self, frequencies: np.ndarray) -> np.ndarray:
        """Return the two-sided spectral density of f at angular frequencies (rad s-1), (frequency,)."""
        moving = 1j * frequencies[:, None, None] * np.eye(len(self.input)) - self.drift
        inputs = np.broadcast_to(self.input[:, None], (len(frequencies), len(self.input), 1))
        return np.asarray(np.abs(np.linalg.solve(moving, inputs)[..., 0] @ self.output) ** 2)


def filter_of(excitation: Component) -> Filter:
    """Return the filter of an excitation, or refuse one that is none or not stable."""
    kind, parts = type(excitation).__name__, excitation.filter()  # type: ignore[attr-defined]
    try:
        drift, given, output = (real_array(kind, part) for part in parts)
    except (TypeError, ValueError):  # not three, or no numbers
        raise InvalidInput(f"{kind}.filter must return a matrix and two vectors, not {shown(parts)}.") from None
    count = given.size
    if not count or (drift.shape, given.shape, output.shape) != ((count, count), (count,), (count,)):
        raise InvalidInput(
            f"{kind}.filter must return A, b and c of the shapes (n, n), (n,) and (n,); {drift.shape}, {given.shape} "
            f"and {output.shape} were returned."
        )
    if not (np.isfinite(drift).all() and np.isfinite(given).all() and np.isfinite(output).all()):
        raise InvalidInput(f"{kind}.filter must return finite numbers.")
    result = Filter(drift, given, output)
    if result.rates.min() <= 0.0:
        raise InvalidInput(
            f"The filter of {kind} is not stable: its slowest motion decays at a rate of {result.rates.min():g} s-1, "
            "which must be larger than 0."
        )
    return result
