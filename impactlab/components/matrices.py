"""Matrices of masses, dampers and springs: checked, as terms of two coordinates or along combinations, and modes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.inputs import finite_array

NEGLIGIBLE = 1e-9
"""Part of the largest entry or eigenvalue of a matrix up to which another one is rounding."""

ZERO = 1e-12
"""Part of the largest stiffness, rate, variance, displacement or energy up to which another one is rounding of 0."""

Vector = tuple[float, ...]
Matrix = tuple[tuple[float, ...], ...]


def modes_of(mass: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the squared frequencies of all modes, in increasing order, and their shapes Φ with ``Φᵀ M Φ = 1``.

    Squares within rounding of 0 are exactly 0. Shapes have a positive largest value, so that signs do not depend on the
    library.
    """
    from scipy.linalg import eigh  # loaded only where there are such matrices

    squares, shapes = eigh(stiffness, mass)
    largest = shapes[np.abs(shapes).argmax(axis=0), np.arange(len(mass))]
    return np.where(squares > ZERO * squares[-1], squares, 0.0), shapes * np.sign(largest)


def of_pairs(matrix: np.ndarray) -> bool:
    """Whether a matrix is that of springs between two coordinates, or of one and the ground."""
    sums, size = matrix.sum(axis=1), NEGLIGIBLE * np.diagonal(matrix)
    return bool((matrix - np.diag(np.diagonal(matrix)) <= 0.0).all() and (sums >= -size).all())


def to_ground(matrix: np.ndarray) -> np.ndarray:
    """Springs between coordinates and the ground, (coordinate,)."""
    if not of_pairs(matrix):
        return np.zeros(len(matrix))
    sums = matrix.sum(axis=1)
    return np.where(sums > NEGLIGIBLE * np.diagonal(matrix), sums, 0.0)


def sum_of_squares(matrix: np.ndarray) -> Iterator[tuple[np.ndarray, float]]:
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
    dense = given.toarray() if hasattr(given, "toarray") else given
    return finite_array(f"LinearStructure.{place}", dense)


def row_tuples(matrix: np.ndarray) -> Matrix:
    return tuple(map(tuple, matrix.tolist()))


def mass_matrix(given: Any) -> np.ndarray:
    """Return masses, (coordinate,), or where something stands beside the diagonal the matrix of them."""
    array = _array("mass", given)
    if array.ndim == 2 and array.shape[0] == array.shape[1]:
        full, array = array, np.diagonal(array)
        if (full - np.diag(array)).any():
            return _positive_masses(full)
    if array.ndim != 1 or not array.size:
        raise InvalidInput(
            f"LinearStructure.mass is a row of masses or a square matrix of them, not of shape {array.shape}."
        )
    if not (array > 0.0).all():
        raise InvalidInput(f"LinearStructure.mass must be larger than 0 kg, but the smallest is {array.min():g}.")
    return array


def _positive_masses(given: np.ndarray) -> np.ndarray:
    """Return a symmetric mass matrix with positive eigenvalues."""
    array, diagonal = _symmetric("mass", given), np.diagonal(given)
    root = np.sqrt(np.where(diagonal > 0.0, diagonal, math.nan))
    scaled = array / np.outer(root, root)  # so that units of angles and displacements do not matter
    if not (diagonal > 0.0).all() or np.linalg.eigvalsh(scaled)[0] < ZERO:
        raise InvalidInput(
            "LinearStructure.mass must have positive eigenvalues only, but the lowest of "
            f"{len(array)} is {np.linalg.eigvalsh(array)[0]:g} kg: every motion needs a mass."
        )
    return array


def _symmetric(place: str, array: np.ndarray) -> np.ndarray:
    off = np.abs(array - array.T)
    if off.max() > NEGLIGIBLE * np.abs(array).max():
        row, column = np.unravel_index(off.argmax(), off.shape)
        raise InvalidInput(
            f"LinearStructure.{place} must be symmetric, but its entries ({row + 1}, {column + 1}) and ({column + 1}, "
            f"{row + 1}) are {array[row, column]:g} and {array[column, row]:g}."
        )
    return np.asarray(0.5 * (array + array.T))


def positive_matrix(place: str, given: Any, count: int) -> np.ndarray:
    """Return a symmetric matrix without negative eigenvalues."""
    array = _array(place, given)
    if array.shape != (count, count):
        raise InvalidInput(
            f"LinearStructure.{place} must be a square matrix for the {count} coordinates that have masses, not of "
            f"shape {array.shape}."
        )
    array = _symmetric(place, array)
    values = np.linalg.eigvalsh(array)
    if values[0] < -NEGLIGIBLE * np.abs(values).max():
        raise InvalidInput(
            f"LinearStructure.{place} must have no negative eigenvalue, but the lowest of {count} is {values[0]:g}."
        )
    return array
