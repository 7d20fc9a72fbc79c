"""Structures that are given by their matrices."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from impactlab.components.component import SHOWN
from impactlab.components.fields import parameter
from impactlab.components.matrices import (
    NEGLIGIBLE,
    ZERO,
    Matrix,
    Vector,
    mass_matrix,
    modes_of,
    of_pairs,
    positive_matrix,
    row_tuples,
    sum_of_squares,
    to_ground,
)
from impactlab.components.structure import Structure, Term, moved
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, real_array


class LinearStructure(Structure):
    """A linear structure ``M x'' + C x' + K x = forces`` of several coordinates.

    With a mass for each coordinate these are bodies of a network, with the name of the structure, a dot, and their own
    name, such as ``tower.roof``: contacts, couplings, excitations, statistics and records know them by this name. With
    a full mass matrix, as finite elements have it, the bodies are the modes, ``tower.mode 1`` and so on, of mass 1; the
    coordinates are points, which contacts, couplings, excitations, results and trajectories know by the same names.

    Parameters
    ----------
    mass : (coordinate,) or (coordinate, coordinate) array_like
        Masses (kg), or a symmetric matrix of them with positive eigenvalues, dense or sparse.
    damping, stiffness : (coordinate, coordinate) array_like
        Symmetric matrices without negative eigenvalues, (N s m-1) and (N m-1), dense or sparse.
    names : sequence of str, optional
        Names of the coordinates; "1", "2", … by default.

    Raises
    ------
    InvalidInput
        If a matrix is not square, symmetric and positive, or names are not as many.

    Examples
    --------
    >>> damping, stiffness = [[0.5, -0.2], [-0.2, 0.2]], [[300.0, -100.0], [-100.0, 100.0]]
    >>> tower = il.LinearStructure([2.0, 1.0], damping, stiffness, names=("low", "roof"))
    >>> tower.modes().natural_frequency.values.round(3)
    array([ 7.071, 14.142])
    """

    mass: Vector | Matrix = parameter(units="kg", kw_only=False)
    damping: Matrix = parameter(units="N s m-1", kw_only=False)
    stiffness: Matrix = parameter(units="N m-1", kw_only=False)
    names: tuple[str, ...] = parameter((), kw_only=True)

    def __post_init__(self) -> None:
        mass = mass_matrix(self.mass)
        object.__setattr__(self, "mass", tuple(mass.tolist()) if mass.ndim == 1 else row_tuples(mass))
        for name in ("damping", "stiffness"):
            object.__setattr__(self, name, row_tuples(positive_matrix(name, getattr(self, name), len(mass))))
        object.__setattr__(self, "names", _names(self.names, len(mass)))
        super().__post_init__()

    @classmethod
    @checked
    def from_damping_ratio(
        cls, mass: Any, stiffness: Any, damping_ratio: float | Sequence[float], *, names: Sequence[str] = ()
    ) -> Self:
        """Make a structure from the damping ratios of its modes.

        Parameters
        ----------
        mass, stiffness : array_like
            As for the class.
        damping_ratio : float or sequence
            Ratio ζ of the damping of all modes, or of each in the order of their frequencies, to the critical one:
            ``C = M Φ diag(2 ζ ω) Φᵀ M`` with shapes Φ of ``Φᵀ M Φ = 1``.
        names : sequence of str, optional
            As for the class.
        """
        masses = mass_matrix(mass)
        matrix = positive_matrix("stiffness", stiffness, len(masses))
        try:
            ratios = np.broadcast_to(real_array("damping_ratio", damping_ratio), len(masses))
        except ValueError:
            ratios = np.full(1, math.nan)
        if not (np.isfinite(ratios) & (ratios >= 0.0)).all():
            raise InvalidInput(
                "LinearStructure.from_damping_ratio takes one damping ratio of at least 0, or one for each of the "
                f"{len(masses)} modes, not {damping_ratio!r}."
            )
        if masses.ndim == 1:
            root = np.sqrt(masses)
            squares, shapes = np.linalg.eigh(matrix / np.outer(root, root))
            shapes *= root[:, None]
        else:
            squares, shapes = modes_of(masses, matrix)
            shapes = masses @ shapes
        damping = (shapes * (2.0 * ratios * np.sqrt(np.maximum(squares, 0.0)))) @ shapes.T
        return cls(mass, 0.5 * (damping + damping.T), stiffness, names=tuple(names))

    def __repr__(self) -> str:
        few = len(self.mass) <= SHOWN
        return super().__repr__() if few else f"LinearStructure of {len(self.mass)} coordinates"

    def bodies(self) -> dict[str, dict[str, float]]:
        """Return the coordinates, or the modes."""
        own = self._own
        columns = own.mass.tolist(), to_ground(own.damping).tolist(), to_ground(own.stiffness).tolist()
        return {
            name: {"mass": mass, "damping": damping, "stiffness": stiffness}
            for name, mass, damping, stiffness in zip(own.names, *columns, strict=True)
        }

    def terms(self) -> Iterator[Term]:
        """Give the rest of the matrices as springs and dampers between two coordinates, or along combinations."""
        names, _, damping, stiffness, _ = self._own
        matrices = {"stiffness": stiffness, "damping": damping}
        springs, dampers = (-matrix * of_pairs(matrix) for matrix in matrices.values())
        for i, j in zip(*np.nonzero(np.triu(springs + dampers, 1)), strict=True):
            pair = {names[i]: 1.0, names[j]: -1.0}
            yield Term(f"{names[i]} to {names[j]}", pair, float(springs[i, j]), float(dampers[i, j]))
        for title, matrix in matrices.items():
            for number, (weights, strength) in enumerate(() if of_pairs(matrix) else sum_of_squares(matrix)):
                along = {names[slot]: float(weights[slot]) for slot in np.flatnonzero(weights)}
                both = (strength, 0.0) if title == "stiffness" else (0.0, strength)
                yield Term(f"{title} {number + 1}", along, *both)

    def weights(self) -> dict[str, dict[str, float]]:
        """Return the shapes of the modes at the coordinates, if the modes are the bodies."""
        own = self._own
        if own.shapes is None:
            return {}
        rows = zip(self.names, own.shapes.tolist(), strict=True)
        return {name: moved(own.names, row) for name, row in rows}

    def places(self) -> tuple[str, ...]:
        return self.names

    def inertia(self, names: Collection[str]) -> dict[str, float]:
        own, following = self._own, np.array([name in names for name in self.names], dtype=float)
        # with modes of Φᵀ M Φ = 1 the forces Φᵀ M ι on them are Φ⁻¹ ι
        forces = own.mass * following if own.shapes is None else np.linalg.solve(own.shapes, following)
        forces[np.abs(forces) <= NEGLIGIBLE * np.abs(forces).max()] = 0.0
        return dict(zip(own.names, forces.tolist(), strict=True))

    @cached_property
    def _own(self) -> _Coordinates:
        mass, damping, stiffness = (np.array(item) for item in (self.mass, self.damping, self.stiffness))
        if mass.ndim == 1:
            return _Coordinates(self.names, mass, damping, stiffness, None)
        squares, shapes = modes_of(mass, stiffness)
        damping = shapes.T @ damping @ shapes
        rounding = ZERO * np.abs(damping).max()
        free = (squares == 0.0) & (np.diagonal(damping) <= rounding)  # modes that move no spring and no damper
        damping[free] = damping[:, free] = 0.0
        size = np.sqrt(np.maximum(np.diagonal(damping), 0.0))
        beside = damping - np.diag(np.diagonal(damping))
        alone = (np.abs(beside) <= NEGLIGIBLE * np.outer(size, size) + rounding).all()
        damping = np.diag(size**2) if alone else 0.5 * (damping + damping.T)
        names = tuple(f"mode {number + 1}" for number in range(len(mass)))
        return _Coordinates(names, np.ones(len(mass)), damping, np.diag(squares), shapes)


class _Coordinates(NamedTuple):
    """The bodies of a structure: its coordinates or its modes, with their matrices."""

    names: tuple[str, ...]
    mass: np.ndarray  # (body,)
    damping: np.ndarray  # (body, body)
    stiffness: np.ndarray  # (body, body)
    shapes: np.ndarray | None  # (coordinate, body) displacements in the modes


def _names(given: Any, count: int) -> tuple[str, ...]:
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise InvalidInput(f"LinearStructure.names is a sequence of strings, not {given!r}.")
    names = tuple(given) or tuple(str(number + 1) for number in range(count))
    for name in names:
        if not isinstance(name, str) or not name.strip():
            raise InvalidInput(f"LinearStructure.names: a name must be a non-empty string, not {name!r}.")
    if len(names) != count or len(set(names)) != count:
        raise InvalidInput(f"LinearStructure.names must be {count} different names, one for each mass, not {given!r}.")
    return names
