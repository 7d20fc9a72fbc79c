"""What a solution takes: time, from steps that are timed on a grid, and memory."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from impactlab.errors import NoExactReference
from impactlab.machine import available
from impactlab.reference.fokker_planck.pair import Pair
from impactlab.reference.fokker_planck.propagator import Basis

INTERVAL = 0.2
"""Time between snapshots of a density, in slowest relaxation times."""

_BYTES, _MOST_UNKNOWNS = 200.0, 2e7
"""Memory that a point takes, with the snapshots of its density, and the largest number of points."""

_SNAPSHOTS = 11.0
"""Snapshots for each decimal of accuracy that all grids of a level take together, as many as the finest one alone would
make in that time: from 9 to 12 in pairs with frequency ratios from 16 to 128."""

_TIMED = 8
"""Steps of which the mean tells the speed."""

_OVERRUN = 2.0
"""Part of the time after which a first grid is given up if it takes longer than was foreseen."""


def steps_between(pair: Pair, basis: Basis) -> int:
    """Return the number of steps between snapshots."""
    return max(1, round(INTERVAL / pair.rate / basis.step))


def check_memory(basis: Basis) -> None:
    """Refuse a basis that does not fit into memory."""
    most = min(_MOST_UNKNOWNS, 0.5 * available() / _BYTES)
    if basis.unknowns > most:
        raise NoExactReference(
            f"The grid would need {basis.unknowns:.3g} points ({_BYTES * basis.unknowns / 1e9:.3g} GB), "
            f"but at most {most:.3g} are possible: {basis}. Give a larger tolerance=, or a basis=."
        )


class OutOfTime(Exception):
    """The time that may be spent is over."""


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

    def measure(self, basis: Basis, step: Callable[[], object]) -> None:
        """Time steps on the grid of a basis; the first one touches the memory, and does not count."""
        step()
        begin = time.perf_counter()
        for _ in range(_TIMED):
            step()
        self.point_seconds = (time.perf_counter() - begin) / _TIMED / basis.unknowns

    def foreseen(self, pair: Pair, basis: Basis, accuracy: float) -> float:
        """Return the time that a basis is foreseen to take with all coarser ones that tell its errors (s)."""
        snapshots = -_SNAPSHOTS * math.log10(accuracy)
        return self.point_seconds * basis.unknowns * steps_between(pair, basis) * snapshots

    def check(self) -> None:
        """Stop if no time is left; a first grid that takes longer than was foreseen has twice the time."""
        if self.spent > self.allowed * (1.0 if self.answered else _OVERRUN):
            raise OutOfTime


def announced(basis: Basis, seconds: float) -> str:
    """Say what a basis is foreseen to take."""
    return f"{basis.unknowns:.2g} points, up to {_BYTES * basis.unknowns / 1e9:.2g} GB and about {seconds:.2g} s"
