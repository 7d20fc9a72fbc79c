"""Structures: bodies of several coordinates, which a network takes apart."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterable, Sequence
from typing import ClassVar, NamedTuple

from impactlab.components.component import Component

SHOWN = 6
"""Coordinates up to which all numbers are printed."""


class Term(NamedTuple):
    """A spring and a damper along a combination of coordinates, a term ``k w wᵀ`` of the matrices."""

    label: str
    weights: dict[str, float]  # by the name of the coordinate
    stiffness: float  # (N m-1)
    damping: float  # (N s m-1)


class Structure(Component):
    """A body of several coordinates, which a network knows as ``name.coordinate``.

    Coordinates are linear oscillators, connected by springs and dampers. Points are weighted sums of coordinates, which
    can be named wherever a coordinate can. A kind of one's own is a class with fields of its own (`parameter`) that
    defines :meth:`bodies` and :meth:`terms`. All names are those within the structure.
    """

    required: ClassVar[tuple[str, ...]] = ("bodies", "terms")

    @abstractmethod
    def bodies(self) -> dict[str, dict[str, float]]:
        """Return the fields mass, damping and stiffness of each coordinate, as an `impactlab.LinearOscillator`."""

    @abstractmethod
    def terms(self) -> Iterable[tuple[str, dict[str, float], float, float]]:
        """Give what connects the coordinates.

        Yields
        ------
        tuple
            Label, weights w by the name of the coordinate, stiffness k (N m-1) and damping c (N s m-1) of each spring
            and damper along ``w·q``: a term ``k w wᵀ`` of the stiffness matrix.
        """

    def weights(self) -> dict[str, dict[str, float]]:
        """Return the weights of the coordinates by the name of each point; by default there is no point."""
        return {}

    def places(self) -> tuple[str, ...]:
        """Return the names of what may follow a motion of the base; by default the coordinates."""
        return tuple(self.bodies())

    def inertia(self, names: Collection[str]) -> dict[str, float]:
        """Return the forces ``M ι`` on the coordinates that accelerate some places by 1 m s-2, and others not (N).

        By default the places are the coordinates.
        """
        return {name: fields["mass"] for name, fields in self.bodies().items() if name in names}


def moved(modes: Sequence[str], row: Iterable[float]) -> dict[str, float]:
    """Return the weights of the modes that move a point."""
    return {mode: weight for mode, weight in zip(modes, row, strict=True) if weight}
