"""Structures: bodies of several coordinates, which a network takes apart."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import NamedTuple

SHOWN = 6
"""Coordinates up to which all numbers are printed."""


class Term(NamedTuple):
    """A spring and a damper along a combination of coordinates, a term ``k w wᵀ`` of the matrices."""

    label: str
    weights: dict[str, float]  # by the name of the coordinate
    stiffness: float  # (N m-1)
    damping: float  # (N s m-1)


class Structure(ABC):
    """What a network knows as several bodies, the coordinates, and as points, which are weighted sums of these.

    Names are those within the structure.
    """

    @abstractmethod
    def bodies(self) -> dict[str, dict[str, float]]:
        """Return mass, damping and stiffness of the coordinates, as bodies that are held to the ground."""

    @abstractmethod
    def terms(self) -> Iterator[Term]:
        """Give what connects the coordinates."""

    @abstractmethod
    def weights(self) -> dict[str, dict[str, float]]:
        """Return the weights of the coordinates by the name of each point."""

    @abstractmethod
    def places(self) -> tuple[str, ...]:
        """Return the names of what may follow a motion of the base."""

    @abstractmethod
    def inertia(self, names: Collection[str]) -> dict[str, float]:
        """Return the forces ``M ι`` on the bodies that accelerate some places by 1 m s-2, and others not."""


def moved(modes: Sequence[str], row: Iterable[float]) -> dict[str, float]:
    """Return the weights of the modes that move a point."""
    return {mode: weight for mode, weight in zip(modes, row, strict=True) if weight}
