"""What a solution takes: time, from steps that are timed on a grid, and memory."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from impactlab.allowed_time import OutOfTime
from impactlab.errors import NoExactReference
from impactlab.memory_limits import available
from impactlab.reference.fokker_planck.pair import Pair
from impactlab.reference.fokker_planck.propagator import Basis

_NUMBERS, _MOST_UNKNOWNS = 50.0, 2e7
"""Numbers that a point takes, with the snapshots of its density, and the largest number of points."""

_SNAPSHOTS = 11.0
"""Snapshots for each decimal of accuracy that all grids of a level take together, as many as the finest one alone would
make in that time: from 9 to 12 in pairs with frequency ratios from 16 to 128."""


def steps_between(pair: Pair, basis: Basis) -> int:
    """Return the number of steps between snapshots."""
    # snapshots of a density are a fifth of the slowest relaxation time apart
    return max(1, round(0.2 / pair.rate / basis.step))


def _gigabytes(pair: Pair, basis: Basis) -> float:
    """Return the memory that a basis takes."""
    return _NUMBERS * pair.real.itemsize * basis.unknowns / 1e9


def check_memory(pair: Pair, basis: Basis) -> None:
    """Refuse a basis that does not fit into memory."""
    needed = _gigabytes(pair, basis)
    most = min(_MOST_UNKNOWNS, 0.5e-9 * available() / needed * basis.unknowns)
    if basis.unknowns > most:
        raise NoExactReference(
            f"The grid would need {basis.unknowns:.3g} points ({needed:.3g} GB), "
            f"but at most {most:.3g} are possible: {basis}. Give a larger tolerance=, or a basis=."
        )


@dataclass
class Budget:
    """Time that may be spent (s), and how fast this machine is."""

    allowed: float
    begun: float = field(default_factory=time.monotonic)
    point_seconds: float = 0.0  # that a point takes in a step
    answered: bool = False  # whether there is a solution already

    @property
    def spent(self) -> float:
        """Time since the beginning (s)."""
        return time.monotonic() - self.begun

    @property
    def left(self) -> float:
        """Time that may still be spent (s)."""
        return self.allowed - self.spent

    def timed(
        self, basis: Basis, march: Callable[[np.ndarray, int], np.ndarray], density: np.ndarray, steps: int
    ) -> np.ndarray:
        """March some steps on the grid of a basis, the time of which is what further ones are foreseen to take."""
        begin = time.perf_counter()
        result = march(density, steps)
        self.point_seconds = (time.perf_counter() - begin) / steps / basis.unknowns
        return result

    def foreseen(self, pair: Pair, basis: Basis, accuracy: float) -> float:
        """Return the time that a basis is foreseen to take with all coarser ones that tell its errors (s)."""
        snapshots = -_SNAPSHOTS * math.log10(accuracy)
        return self.point_seconds * basis.unknowns * steps_between(pair, basis) * snapshots

    def check(self, foreseen: float = 0.0) -> None:
        """Stop if less time is left than is foreseen (s); a first grid that takes longer has twice the time."""
        if foreseen and foreseen > self.left:
            raise OutOfTime(f"would take about {foreseen:.2g} s, but {max(self.left, 0.0):.2g} s are left")
        if self.spent > self.allowed * (1.0 if self.answered else 2.0):
            raise OutOfTime(f"takes longer than {self.allowed:.2g} s")


def announced(pair: Pair, basis: Basis, seconds: float) -> str:
    """Say what a basis is foreseen to take."""
    return f"{basis.unknowns:.2g} points, up to {_gigabytes(pair, basis):.2g} GB and about {seconds:.2g} s"
