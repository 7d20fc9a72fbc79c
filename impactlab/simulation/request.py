"""What a run is asked to be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import finite, positive
from impactlab.errors import InvalidInput
from impactlab.integrators.base import Integrator, check_integrator
from impactlab.records.record import Record


@dataclass(frozen=True, eq=False)
class Request:
    """What a run is asked to be; parameters are those of `impactlab.simulate`.

    Attributes
    ----------
    duration : float
    realizations : int
    step : float or None
    integrator : Integrator
    spin_up : float or None
    initial : object
    records : sequence of Record
    seed : tuple of int
        128 bits.
    workers : int
        Number of blocks that run at once.
    coarse : bool
        Whether a step has the noise of two steps of a run at half the step.
    ceiling : float
        Largest automatic step (s).
    velocity : (body,) ndarray or None
        Mean square velocities as they were met, infinite where they are not known (m2 s-2): an automatic step may then
        be larger than the rules want, since it will be measured.

    Raises
    ------
    InvalidInput
        If a number is not one that can be asked for.
    """

    duration: float
    realizations: int
    step: float | None
    integrator: Integrator
    spin_up: float | None
    initial: Any
    records: Sequence[Record]
    seed: tuple[int, int]
    workers: int = 1
    coarse: bool = False
    ceiling: float = math.inf
    velocity: np.ndarray | None = None

    def __post_init__(self) -> None:
        check_integrator(self.integrator)
        object.__setattr__(self, "duration", positive("duration", self.duration))
        whole = isinstance(self.realizations, int | np.integer) and not isinstance(self.realizations, bool)
        if not whole or not 1 <= self.realizations < 2**32:
            raise InvalidInput(
                f"realizations must be a whole number from 1 to 2^32 - 1, {self.realizations!r} was given."
            )
        if self.spin_up is not None and finite("spin_up", self.spin_up) < 0.0:
            raise InvalidInput(f"spin_up must be at least 0 s, {self.spin_up!r} was given.")
        if self.step is not None:
            object.__setattr__(self, "step", positive("step", self.step))

    def options(self) -> dict[str, Any]:
        """Return what makes the run again: options that are stored with its result, of which none can name a file."""
        return {
            "duration": self.duration, "realizations": self.realizations, "step": self.step,
            "integrator": self.integrator.to_dict(), "spin_up": self.spin_up, "initial": self.initial,
            "record": [item.to_dict() for item in self.records], "seed": list(self.seed),
        }  # fmt: skip

    def resolved(self, model: Model) -> Self:
        """Return the request for a model, with records in which nothing is left to be chosen."""
        return replace(self, records=[record.resolved(model) for record in self.records])

    def intervals(self) -> list[float]:
        """Return the times between samples that records must have, after checking that all fit in one run."""
        seen = set()
        for record in self.records:
            if record.identity in seen:
                raise InvalidInput(
                    f"Two records {' '.join(record.identity)} would have variables of the same names; keep one, or "
                    "simulate once more with the same rng."
                )
            seen.add(record.identity)
        intervals = [interval for record in self.records if (interval := record.exact_interval()) is not None]
        if intervals and max(intervals) > self.duration * (1.0 + 1e-9):
            raise InvalidInput(
                f"An interval of {max(intervals):g} s is longer than the duration of {self.duration:g} s."
            )
        return intervals
