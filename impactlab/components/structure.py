"""Structures: bodies of several coordinates, which a network takes apart."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from impactlab.components.component import Component

if TYPE_CHECKING:
    import xarray as xr


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

    Examples
    --------
    >>> tube = il.beam(1.0, 1.0, 1.0, supports="pinned-pinned", modes=2, damping_ratios=0.01, points={})
    >>> isinstance(tube, il.Structure)
    True
    >>> tube.modes().natural_frequency.values.round(2)
    array([ 9.87, 39.48])
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

    def modes(self) -> xr.Dataset:
        """Return the modes of the structure alone, in the order of their frequencies.

        Returns
        -------
        xarray.Dataset
            ``natural_frequency`` (mode), ω without damping (rad s-1); ``damping_ratio`` (mode), ``φᵀ C φ/2ω``, which
            leaves out damping between modes, NaN at frequency 0; ``mode_shape`` (place, mode), φ at the coordinates
            and the points, with ``φᵀ M φ = 1`` and a positive largest value (kg-1/2).
        """
        import numpy as np  # studies are listed without these
        import xarray as xr

        from impactlab.components.matrices import modes_of

        bodies = self.bodies()
        slots = {name: slot for slot, name in enumerate(bodies)}

        def row(weights: Mapping[str, float]) -> np.ndarray:
            result = np.zeros(len(slots))
            result[[slots[name] for name in weights]] = list(weights.values())
            return result

        columns = (
            [float(item.get(name, 0.0)) for item in bodies.values()] for name in ("mass", "damping", "stiffness")
        )
        mass, damping, stiffness = map(np.diag, columns)
        for _, weights, spring, damper in self.terms():
            along = row(weights)
            stiffness += spring * np.outer(along, along)
            damping += damper * np.outer(along, along)
        squares, shapes = modes_of(mass, stiffness)
        frequencies = np.sqrt(squares)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = 0.5 * np.einsum("im,ij,jm->m", shapes, damping, shapes) / frequencies
        points = self.weights()
        of_points = [row(weights) @ shapes for weights in points.values()]
        return xr.Dataset(
            {
                "natural_frequency": ("mode", frequencies, {"units": "rad s-1", "long_name": "natural frequency"}),
                "damping_ratio": (
                    "mode", np.where(squares > 0.0, ratios, np.nan), {"units": "1", "long_name": "damping ratio"},
                ),
                "mode_shape": (
                    ("place", "mode"), np.stack([*shapes, *of_points]), {"units": "kg-1/2", "long_name": "mode shape"},
                ),
            },
            {"mode": np.arange(1, len(frequencies) + 1), "place": [*bodies, *points]},
            {"title": f"Modes of {type(self).__name__}"},
        )  # fmt: skip


def moved(modes: Sequence[str], row: Iterable[float]) -> dict[str, float]:
    """Return the weights of the modes that move a point."""
    return {mode: weight for mode, weight in zip(modes, row, strict=True) if weight}
