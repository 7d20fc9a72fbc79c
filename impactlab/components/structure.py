"""Structures: bodies of several coordinates, given by their matrices."""

from __future__ import annotations

import math
import reprlib
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from impactlab.components.component import Component
from impactlab.components.fields import parameter
from impactlab.components.matrices import (
    NEGLIGIBLE,
    RIGID,
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
from impactlab.components.weights import Weights
from impactlab.errors import InvalidInput

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


class LinearStructure(Component, Structure):
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
            ratios = np.broadcast_to(np.asarray(damping_ratio, dtype=float), len(masses))
        except (TypeError, ValueError):
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
        return {name: _moved(own.names, row) for name, row in rows}

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
        rounding = RIGID * np.abs(damping).max()
        rigid = (squares == 0.0) & (np.diagonal(damping) <= rounding)  # motions that move no damper
        damping[rigid] = damping[:, rigid] = 0.0
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


class ModalStructure(Component, Structure):
    """A linear structure given by its modes: frequencies, damping ratios, and displacements at named points.

    In a network each mode is a body, ``beam.1``, ``beam.2``, …, whose displacement is the modal coordinate q. The
    displacement of a point such as ``beam.tip`` is ``Σ φ q`` with the shapes φ at the point; a force on it is φ times
    that force on each mode. A point can be named wherever a body can: in contacts, couplings and combinations, as
    what an excitation acts on, and by what a source drives. Results and trajectories know it, too.

    Parameters
    ----------
    natural_frequencies : sequence of float
        Angular frequencies of the modes (rad s-1).
    damping_ratios : float or sequence of float
        Ratio of the damping of each mode, or of all, to the critical one.
    points : mapping of str to sequence of float
        By the name of a point, the displacement there in each mode, as belongs to the modal masses.
    mass : float or sequence of float
        Modal mass of each mode, or of all (kg); 1 by default.

    Raises
    ------
    InvalidInput
        If there are not as many numbers as modes, a frequency or a mass is not positive, a damping ratio is negative,
        no mode moves a point, or a name is that of a mode.
    """

    natural_frequencies: Sequence[float] = parameter(units="rad s-1", kw_only=False)
    damping_ratios: float | Sequence[float] = parameter(kw_only=False)
    points: Mapping[str, Sequence[float]] = parameter(Weights({}))
    mass: float | Sequence[float] = parameter(1.0, units="kg")

    def __post_init__(self) -> None:
        frequencies = _numbers("natural_frequencies", self.natural_frequencies)
        count = len(frequencies)
        for number, frequency in enumerate(frequencies):
            if frequency <= 0.0:
                raise InvalidInput(
                    f"ModalStructure.natural_frequencies must be larger than 0 rad s-1, but that of mode {number + 1} "
                    f"is {frequency:g}: a rigid motion has no damping ratio. Give the structure by its matrices, "
                    "il.LinearStructure, which may be free."
                )
        ratios, mass = _numbers("damping_ratios", self.damping_ratios, count), _numbers("mass", self.mass, count)
        if min(ratios) < 0.0:
            raise InvalidInput(f"ModalStructure.damping_ratios must be at least 0, but the lowest is {min(ratios):g}.")
        if min(mass) <= 0.0:
            raise InvalidInput(f"ModalStructure.mass must be larger than 0 kg, but the smallest is {min(mass):g}.")
        object.__setattr__(self, "natural_frequencies", frequencies)
        object.__setattr__(self, "damping_ratios", ratios)
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "points", _points(self.points, count))
        super().__post_init__()

    @classmethod
    def from_matrices(
        cls,
        mass: Any,
        stiffness: Any,
        damping_ratios: float | Sequence[float],
        *,
        modes: int,
        points: Mapping[str, int | Sequence[float]],
    ) -> Self:
        """Make a structure of the lowest modes of matrices.

        Parameters
        ----------
        mass, stiffness : array_like
            As for `LinearStructure`.
        damping_ratios : float or sequence of float
            As for the class.
        modes : int
            How many modes are kept.
        points : mapping of str to int or sequence of float
            By the name of a point, the number of its coordinate, from 0 on, or the weight of each coordinate.
        """
        own = LinearStructure.from_damping_ratio(mass, stiffness, 0.0)
        count = len(own.names)
        if isinstance(modes, bool) or not isinstance(modes, int | np.integer) or not 1 <= modes <= count:
            raise InvalidInput(
                f"ModalStructure.from_matrices: modes must be a whole number from 1 to {count}, not {modes!r}."
            )
        full = np.array(own.mass)
        squares, shapes = modes_of(np.diag(full) if full.ndim == 1 else full, np.array(own.stiffness))
        along: dict[str, Vector] = {}
        for name, given in _mapping(points).items():
            if isinstance(given, int | np.integer) and not 0 <= given < count:
                raise InvalidInput(
                    f"ModalStructure.from_matrices: points[{name!r}] must be the number of a coordinate, from 0 to "
                    f"{count - 1}, not {given}."
                )
            weights = np.eye(count)[given] if isinstance(given, int | np.integer) else given
            row = _numbers(f"from_matrices: points[{name!r}]", weights, count, "a coordinate, or a weight for each")
            along[name] = tuple((np.array(row) @ shapes[:, :modes]).tolist())
        return cls(tuple(np.sqrt(squares[:modes]).tolist()), damping_ratios, points=along)

    def __repr__(self) -> str:
        count, names = len(self.natural_frequencies), [*self.points]
        if max(count, len(names)) <= SHOWN:
            return super().__repr__()
        shown = ", ".join(names[:SHOWN]) + ("" if len(names) <= SHOWN else f" and {len(names) - SHOWN} more")
        return f"ModalStructure of {count} modes" + (f" with the points {shown}" if names else "")

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "points": {name: list(row) for name, row in self.points.items()}}

    def bodies(self) -> dict[str, dict[str, float]]:
        """Return the modes."""
        columns = (np.atleast_1d(item) for item in (self.natural_frequencies, self.damping_ratios, self.mass))
        return {
            str(number): {"mass": mass, "damping": 2.0 * ratio * frequency * mass, "stiffness": mass * frequency**2}
            for number, (frequency, ratio, mass) in enumerate(np.stack([*columns], axis=1).tolist(), 1)
        }

    def terms(self) -> Iterator[Term]:
        """Give nothing: modes are not connected."""
        return iter(())

    def weights(self) -> dict[str, dict[str, float]]:
        """Return the weights of the modes by the name of each point."""
        modes = [str(number) for number in range(1, len(self.natural_frequencies) + 1)]
        return {name: _moved(modes, row) for name, row in self.points.items()}

    def places(self) -> tuple[str, ...]:
        return tuple(self.points)

    def inertia(self, names: Collection[str]) -> dict[str, float]:
        raise InvalidInput(
            "a ModalStructure does not know by which forces φᵀ M ι its modes feel the motion of their base. Give the "
            "structure by its matrices, il.LinearStructure, or these forces L by il.Source(…, on={'1': -L, …})."
        )


def _moved(modes: Sequence[str], row: Iterable[float]) -> dict[str, float]:
    """Return the weights of the modes that move a point."""
    return {mode: weight for mode, weight in zip(modes, row, strict=True) if weight}


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


def _numbers(place: str, given: Any, count: int = 0, what: str = "one for all modes or one for each") -> Vector:
    """Return finite numbers, as many as there are modes; one alone stands for all."""
    try:
        array = np.array(given, dtype=float)
    except (TypeError, ValueError):
        array = np.full(1, math.nan)
    if array.ndim == 0 and count:
        array = np.full(count, array)
    if array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise InvalidInput(f"ModalStructure.{place} must be finite numbers, {what}, not {reprlib.repr(given)}.")
    if count and len(array) != count:
        raise InvalidInput(f"ModalStructure.{place} must be {count} numbers, {what}, not {len(array)}.")
    return tuple(array.tolist())


def _mapping(points: Any) -> Mapping[str, Any]:
    if not isinstance(points, Mapping):
        raise InvalidInput(
            f"ModalStructure.points must be {{name: displacement in each mode}}, not {reprlib.repr(points)}."
        )
    for name in points:
        if not isinstance(name, str) or not name.strip():
            raise InvalidInput(f"ModalStructure.points: a name must be a non-empty string, not {name!r}.")
    return points


def _points(given: Any, count: int) -> Weights[Vector]:
    """Return the shapes at points, checked."""
    points = {}
    modes = {str(number + 1) for number in range(count)}
    for name, row in _mapping(given).items():
        if name in modes:
            raise InvalidInput(f"ModalStructure.points: {name!r} is the name of a mode; give the point another.")
        points[name] = _numbers(f"points[{name!r}]", row if np.ndim(row) else [row], count, "one for each mode")
        if not any(points[name]):
            raise InvalidInput(f"ModalStructure.points: no mode moves {name!r}; one number at least must not be 0.")
    return Weights(points)
