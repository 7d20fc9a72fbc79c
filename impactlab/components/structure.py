"""Structures: bodies of several coordinates, given by their matrices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from impactlab.components.component import Component, parameter
from impactlab.errors import InvalidInput

NEGLIGIBLE = 1e-9
"""Part of the largest entry or eigenvalue of a matrix up to which another one is rounding."""

SHOWN = 6
"""Coordinates up to which all numbers are printed."""

Vector = tuple[float, ...]
Matrix = tuple[tuple[float, ...], ...]


class Term(NamedTuple):
    """A spring and a damper along a combination of coordinates, a term ``k w wᵀ`` of the matrices."""

    label: str
    weights: dict[int, float]
    stiffness: float  # (N m-1)
    damping: float  # (N s m-1)


class LinearStructure(Component):
    """A linear structure ``M x'' + C x' + K x = forces`` of several coordinates with a mass each.

    In a network each coordinate is a body, with the name of the structure, a dot, and its own name, such as
    ``tower.roof``: contacts, couplings, excitations, statistics and records know it by this name.

    Parameters
    ----------
    mass : (coordinate,) array_like
        Masses (kg), or a diagonal matrix of them.
    damping, stiffness : (coordinate, coordinate) array_like
        Symmetric matrices without negative eigenvalues, (N s m-1) and (N m-1), dense or sparse.
    names : sequence of str, optional
        Names of the coordinates; "1", "2", … by default.

    Raises
    ------
    InvalidInput
        If a matrix is not square, symmetric and positive, masses are not diagonal, or names are not as many.
    """

    mass: Vector = parameter(units="kg", kw_only=False)
    damping: Matrix = parameter(units="N s m-1", kw_only=False)
    stiffness: Matrix = parameter(units="N m-1", kw_only=False)
    names: tuple[str, ...] = parameter((), kw_only=True)

    def __post_init__(self) -> None:
        mass = _masses(self.mass)
        object.__setattr__(self, "mass", tuple(mass.tolist()))
        for name in ("damping", "stiffness"):
            matrix = _positive(name, getattr(self, name), len(mass))
            object.__setattr__(self, name, tuple(map(tuple, matrix.tolist())))
        object.__setattr__(self, "names", _names(self.names, len(mass)))
        super().__post_init__()

    @classmethod
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
        masses = _masses(mass)
        matrix = _positive("stiffness", stiffness, len(masses))
        try:
            ratios = np.broadcast_to(np.asarray(damping_ratio, dtype=float), len(masses))
        except (TypeError, ValueError):
            ratios = np.full(1, math.nan)
        if not (np.isfinite(ratios) & (ratios >= 0.0)).all():
            raise InvalidInput(
                "LinearStructure.from_damping_ratio takes one damping ratio of at least 0, or one for each of the "
                f"{len(masses)} modes, not {damping_ratio!r}."
            )
        root = np.sqrt(masses)
        squares, shapes = np.linalg.eigh(matrix / np.outer(root, root))
        shapes *= root[:, None]
        damping = (shapes * (2.0 * ratios * np.sqrt(np.maximum(squares, 0.0)))) @ shapes.T
        return cls(mass, 0.5 * (damping + damping.T), stiffness, names=tuple(names))

    def __repr__(self) -> str:
        few = len(self.mass) <= SHOWN
        return super().__repr__() if few else f"LinearStructure of {len(self.mass)} coordinates"

    def to_ground(self) -> np.ndarray:
        """Return stiffness and damping of what holds each coordinate to the ground, (2, coordinate)."""
        return np.stack([_ground(np.array(item)) for item in (self.stiffness, self.damping)])

    def terms(self) -> Iterator[Term]:
        """Give the rest of the matrices as springs and dampers between two coordinates, or along combinations."""
        matrices = {"stiffness": np.array(self.stiffness), "damping": np.array(self.damping)}
        springs, dampers = (-matrix * _of_pairs(matrix) for matrix in matrices.values())
        for i, j in zip(*np.nonzero(np.triu(springs + dampers, 1)), strict=True):
            label = f"{self.names[i]} to {self.names[j]}"
            yield Term(label, {int(i): 1.0, int(j): -1.0}, float(springs[i, j]), float(dampers[i, j]))
        for title, matrix in matrices.items():
            for number, (weights, strength) in enumerate(() if _of_pairs(matrix) else _squares(matrix)):
                along = {int(slot): float(weights[slot]) for slot in np.flatnonzero(weights)}
                both = (strength, 0.0) if title == "stiffness" else (0.0, strength)
                yield Term(f"{title} {number + 1}", along, *both)


def _of_pairs(matrix: np.ndarray) -> bool:
    """Whether a matrix is that of springs between two coordinates, or of one and the ground."""
    sums, size = matrix.sum(axis=1), NEGLIGIBLE * np.diagonal(matrix)
    return bool((matrix - np.diag(np.diagonal(matrix)) <= 0.0).all() and (sums >= -size).all())


def _ground(matrix: np.ndarray) -> np.ndarray:
    """Springs between coordinates and the ground, (coordinate,)."""
    if not _of_pairs(matrix):
        return np.zeros(len(matrix))
    sums = matrix.sum(axis=1)
    return np.where(sums > NEGLIGIBLE * np.diagonal(matrix), sums, 0.0)


def _squares(matrix: np.ndarray) -> Iterator[tuple[np.ndarray, float]]:
    """Write a matrix as ``Σ k w wᵀ`` by elimination, which keeps the band of a banded one; give w and k > 0."""
    rest, enough = matrix.copy(), NEGLIGIBLE * np.diagonal(matrix)
    for place in range(len(rest)):
        pivot = float(rest[place, place])
        if pivot <= enough[place]:
            continue
        weights = rest[place] / pivot
        yield weights, pivot
        rest -= pivot * np.outer(weights, weights)
        rest[place] = rest[:, place] = 0.0


def _array(place: str, given: Any) -> np.ndarray:
    try:
        array = np.array(given.toarray() if hasattr(given, "toarray") else given, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"LinearStructure.{place} must hold numbers, not {given!r}.") from None
    if not np.isfinite(array).all():
        raise InvalidInput(f"LinearStructure.{place} must hold finite numbers only.")
    return array


def _masses(given: Any) -> np.ndarray:
    array = _array("mass", given)
    if array.ndim == 2 and array.shape[0] == array.shape[1]:
        beside = array - np.diag(np.diagonal(array))
        if beside.any():
            row, column = np.unravel_index(np.abs(beside).argmax(), beside.shape)
            raise InvalidInput(
                f"LinearStructure.mass must be diagonal, a mass for each coordinate, but its entry ({row + 1}, "
                f"{column + 1}) is {beside[row, column]:g} kg: lump the masses."
            )
        array = np.diagonal(array)
    if array.ndim != 1 or not array.size:
        raise InvalidInput(f"LinearStructure.mass is a row of masses or a diagonal matrix, not of shape {array.shape}.")
    if not (array > 0.0).all():
        raise InvalidInput(f"LinearStructure.mass must be larger than 0 kg, but the smallest is {array.min():g}.")
    return array


def _positive(place: str, given: Any, count: int) -> np.ndarray:
    """Return a symmetric matrix without negative eigenvalues."""
    array = _array(place, given)
    if array.shape != (count, count):
        raise InvalidInput(
            f"LinearStructure.{place} must be a square matrix for the {count} coordinates that have masses, not of "
            f"shape {array.shape}."
        )
    off = np.abs(array - array.T)
    if off.max() > NEGLIGIBLE * np.abs(array).max():
        row, column = np.unravel_index(off.argmax(), off.shape)
        raise InvalidInput(
            f"LinearStructure.{place} must be symmetric, but its entries ({row + 1}, {column + 1}) and ({column + 1}, "
            f"{row + 1}) are {array[row, column]:g} and {array[column, row]:g}."
        )
    array = np.asarray(0.5 * (array + array.T))
    values = np.linalg.eigvalsh(array)
    if values[0] < -NEGLIGIBLE * np.abs(values).max():
        raise InvalidInput(
            f"LinearStructure.{place} must have no negative eigenvalue, but the lowest of {count} is {values[0]:g}."
        )
    return array


def _names(given: Any, count: int) -> tuple[str, ...]:
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise InvalidInput(f"LinearStructure.names is a sequence of strings, not {given!r}.")
    names = tuple(given) or tuple(str(number + 1) for number in range(count))
    if len(names) != count or len(set(names)) != count:
        raise InvalidInput(f"LinearStructure.names must be {count} different names, one for each mass, not {given!r}.")
    for name in names:
        if not isinstance(name, str) or not name.strip():
            raise InvalidInput(f"LinearStructure.names: a name must be a non-empty string, not {name!r}.")
    return names
