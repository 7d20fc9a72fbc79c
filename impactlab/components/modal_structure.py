"""Structures that are given by their modes."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Self

import numpy as np

from impactlab.components.component import SHOWN
from impactlab.components.fields import parameter
from impactlab.components.matrices import Vector, mass_matrix, modes_of, positive_matrix
from impactlab.components.structure import Structure, Term, moved
from impactlab.components.weights import Weights
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, real_array, shown


class ModalStructure(Structure):
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
    participation : sequence of float, optional
        Forces ``φᵀ M ι`` on the modes that give the structure an acceleration of 1 m s-2 as a whole (kg), which
        `BaseMotion` needs. `beam` knows them.

    Raises
    ------
    InvalidInput
        If there are not as many numbers as modes, a frequency or a mass is not positive, a damping ratio is negative,
        no mode moves a point, or a name is that of a mode.

    Examples
    --------
    >>> beam = il.ModalStructure([3.5, 22.0], 0.02, points={"tip": [2.0, -2.0]})
    >>> noisy = il.Network({"beam": beam}, excitations={"beam.tip": il.WhiteNoise(1e-4)})
    >>> beam.modes().mode_shape.sel(place="tip").values
    array([ 2., -2.])
    """

    natural_frequencies: Sequence[float] = parameter(units="rad s-1", kw_only=False)
    damping_ratios: float | Sequence[float] = parameter(kw_only=False)
    points: Mapping[str, Sequence[float]] = parameter(Weights({}))
    mass: float | Sequence[float] = parameter(1.0, units="kg")
    participation: Sequence[float] = parameter((), units="kg")

    def __post_init__(self) -> None:
        frequencies = _numbers("natural_frequencies", self.natural_frequencies)
        count = len(frequencies)
        for number, frequency in enumerate(frequencies):
            if frequency <= 0.0:
                raise InvalidInput(
                    f"ModalStructure.natural_frequencies must be larger than 0 rad s-1, but that of mode {number + 1} "
                    f"is {frequency:g}: a mode of frequency 0 has no damping ratio. Give the structure by its "
                    "matrices, il.LinearStructure, which may be free."
                )
        ratios, mass = _numbers("damping_ratios", self.damping_ratios, count), _numbers("mass", self.mass, count)
        if min(ratios) < 0.0:
            raise InvalidInput(f"ModalStructure.damping_ratios must be at least 0, but the lowest is {min(ratios):g}.")
        if min(mass) <= 0.0:
            raise InvalidInput(f"ModalStructure.mass must be larger than 0 kg, but the smallest is {min(mass):g}.")
        object.__setattr__(self, "natural_frequencies", frequencies)
        object.__setattr__(self, "damping_ratios", ratios)
        object.__setattr__(self, "mass", mass)
        if not (isinstance(self.participation, list | tuple) and len(self.participation) == 0):
            given = _numbers("participation", self.participation, count, "one for each mode")
            object.__setattr__(self, "participation", given)
        object.__setattr__(self, "points", _points(self.points, count))
        super().__post_init__()

    @classmethod
    @checked
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
        full = mass_matrix(mass)
        matrix, count = positive_matrix("stiffness", stiffness, len(full)), len(full)
        if not 1 <= modes <= count:
            raise InvalidInput(
                f"ModalStructure.from_matrices: modes must be a whole number from 1 to {count}, not {modes!r}."
            )
        squares, shapes = modes_of(np.diag(full) if full.ndim == 1 else full, matrix)
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
        return {name: moved(modes, row) for name, row in self.points.items()}

    def places(self) -> tuple[str, ...]:
        return tuple(self.points)

    def inertia(self, names: Collection[str]) -> dict[str, float]:
        if not self.participation:
            raise InvalidInput(
                "a ModalStructure knows by which forces φᵀ M ι its modes feel the motion of their base if these are "
                "given as its participation. Or give the structure by its matrices, il.LinearStructure."
            )
        if set(names) != set(self.points):
            raise InvalidInput("a ModalStructure follows the ground as a whole; name the structure itself.")
        return {str(number): force for number, force in enumerate(self.participation, 1)}


def _numbers(place: str, given: Any, count: int = 0, what: str = "one for all modes or one for each") -> Vector:
    """Return finite numbers, as many as there are modes; one alone stands for all."""
    try:
        array = real_array(place, given)
    except InvalidInput:
        array = np.full(1, math.nan)
    if array.ndim == 0 and count:
        array = np.full(count, array)
    if array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise InvalidInput(f"ModalStructure.{place} must be finite real numbers, {what}, not {shown(given)}.")
    if count and len(array) != count:
        raise InvalidInput(f"ModalStructure.{place} must be {count} numbers, {what}, not {len(array)}.")
    return tuple(array.tolist())


def _mapping(points: Any) -> Mapping[str, Any]:
    if not isinstance(points, Mapping):
        raise InvalidInput(f"ModalStructure.points must be {{name: displacement in each mode}}, not {shown(points)}.")
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
