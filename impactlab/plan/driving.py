"""Sums of cosines and given forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlab.integrators.base import Integrator
from impactlab.linear import Lines, flowing_systems, lines_of, responses
from impactlab.model import Model
from impactlab.series import sample_count, sampling_seconds


@dataclass(frozen=True, eq=False)
class Driving:
    """Forces that are known functions of time once their phases are drawn.

    Attributes
    ----------
    lines : tuple of Lines
        Sums of cosines.
    responses : tuple
        What each of them moves; see `impactlab.linear.responses`.
    forced : (row,) ndarray of int
        Slots of the bodies under given forces.
    """

    lines: tuple[Lines, ...]
    responses: tuple[tuple[np.ndarray, np.ndarray], ...]
    forced: np.ndarray

    @classmethod
    def of(cls, model: Model) -> Driving:
        """Return those of a model."""
        moved = responses(model, flowing_systems(model))
        return cls(lines_of(model), moved, np.array(model.forced, dtype=np.int64))

    def __bool__(self) -> bool:
        return bool(self.lines or len(self.forced))

    def rows(self, integrator: Integrator) -> list[int]:
        """Rows of samples that a method takes of each sum of cosines."""
        return [2 * len(slots) if integrator.takes_response else 1 for slots, _ in self.responses]

    def nbytes(self, integrator: Integrator, step: float, steps: int, more: int = 0) -> int:
        """Bytes of the samples of a realization, and of some rows more."""
        if not self.lines:
            return 0
        return 8 * (sum(self.rows(integrator)) + more) * sample_count(self.lines, *_samples(integrator, step, steps))

    def seconds(self, integrator: Integrator, step: float, steps: int) -> float:
        """Time that sampling takes for a realization (s)."""
        return sum(
            rows * sampling_seconds(item, *_samples(integrator, step, steps))
            for rows, item in zip(self.rows(integrator), self.lines, strict=True)
        )


def _samples(integrator: Integrator, step: float, steps: int) -> tuple[float, int]:
    """Return the time between the samples of some steps (s), and their number."""
    return step / integrator.samples_per_step, steps * integrator.samples_per_step + 1
