"""Exponentials and equations of small matrices, in memory that is given."""

from __future__ import annotations

import math

from impactlab.compiling.jit import kernel, seldom_called

NORM = 0.7
"""Largest norm of a matrix whose exponential is a polynomial of degree 16: the rest is 1e-17."""

ORDER = 16
"""Degree of the polynomial by which a vector is carried over a short time."""


@kernel
def multiply(left, right, result):  # type: ignore[no-untyped-def]
    """Write the product of two square matrices."""
    size = left.shape[0]
    for row in range(size):
        for column in range(size):
            total = 0.0
            for inner in range(size):
                total += left[row, inner] * right[inner, column]
            result[row, column] = total


@kernel
def apply(matrix, vector, result):  # type: ignore[no-untyped-def]
    """Write the product of a matrix and a vector."""
    for row in range(matrix.shape[0]):
        total = 0.0
        for column in range(matrix.shape[1]):
            total += matrix[row, column] * vector[column]
        result[row] = total


@kernel
def _group(powers, first, last, result, added):  # type: ignore[no-untyped-def]
    """Write ``Σ A^j / j!`` for four powers from the first on, divided by the power of the first."""
    size = result.shape[0]
    for row in range(size):
        for column in range(size):
            total = result[row, column] if added else 0.0
            factor = 1.0 / math.gamma(first + 1.0)
            if row == column:
                total += factor
            for power in range(1, last - first + 1):
                factor /= first + power
                total += factor * powers[power - 1, row, column]
            result[row, column] = total


@seldom_called
def exponential(generator, time, scale, powers, result):  # type: ignore[no-untyped-def]
    """Write ``exp(generator · time)``; return how often the exponential of a part of the time was squared.

    Coordinates are measured in units of `scale`. The exponential of that part, in plain units, is the last of `powers`,
    (6, row, column).
    """
    size, norm = generator.shape[0], 0.0
    for row in range(size):
        total = 0.0
        for column in range(size):
            value = generator[row, column] * scale[column] / scale[row]
            powers[0, row, column] = value
            total += abs(value)
        norm = max(norm, total)
    norm *= abs(time)
    squarings = 0
    while norm > NORM and squarings < 60:
        norm *= 0.5
        squarings += 1
    part = time / 2.0**squarings
    for row in range(size):
        for column in range(size):
            powers[0, row, column] *= part
    multiply(powers[0], powers[0], powers[1])
    multiply(powers[1], powers[0], powers[2])
    multiply(powers[1], powers[1], powers[3])
    _group(powers, 12, 16, result, False)
    for first in (8, 4, 0):
        multiply(powers[3], result, powers[4])
        for row in range(size):
            for column in range(size):
                result[row, column] = powers[4, row, column]
        _group(powers, first, first + 3, result, True)
    for row in range(size):
        for column in range(size):
            powers[5, row, column] = result[row, column] * scale[row] / scale[column]
    for _ in range(squarings):
        multiply(result, result, powers[4])
        for row in range(size):
            for column in range(size):
                result[row, column] = powers[4, row, column]
    for row in range(size):
        for column in range(size):
            result[row, column] *= scale[row] / scale[column]
    return squarings


@seldom_called
def carry(generator, time, vector, term, result):  # type: ignore[no-untyped-def]
    """Write ``exp(generator · time) vector`` for a time that is short."""
    size = generator.shape[0]
    for row in range(size):
        result[row] = vector[row]
        term[0, row] = vector[row]
    for order in range(1, ORDER):
        apply(generator, term[0], term[1])
        for row in range(size):
            term[0, row] = term[1, row] * time / order
            result[row] += term[0, row]


@seldom_called
def solve(matrix, vectors):  # type: ignore[no-untyped-def]
    """Write the solutions of equations into their right-hand sides, (row, column); return the determinant.

    The matrix is overwritten. It is singular where the determinant is 0.
    """
    size, determinant = matrix.shape[0], 1.0
    for pivot in range(size):
        best = pivot
        for row in range(pivot + 1, size):
            if abs(matrix[row, pivot]) > abs(matrix[best, pivot]):
                best = row
        if best != pivot:
            determinant = -determinant
            for column in range(pivot, size):
                matrix[pivot, column], matrix[best, column] = matrix[best, column], matrix[pivot, column]
            for column in range(vectors.shape[1]):
                vectors[pivot, column], vectors[best, column] = vectors[best, column], vectors[pivot, column]
        value = matrix[pivot, pivot]
        determinant *= value
        if value == 0.0 or math.isnan(value):
            return 0.0
        for row in range(pivot + 1, size):
            factor = matrix[row, pivot] / value
            if factor != 0.0:
                for column in range(pivot + 1, size):
                    matrix[row, column] -= factor * matrix[pivot, column]
                for column in range(vectors.shape[1]):
                    vectors[row, column] -= factor * vectors[pivot, column]
    for row in range(size - 1, -1, -1):
        for column in range(vectors.shape[1]):
            total = vectors[row, column]
            for inner in range(row + 1, size):
                total -= matrix[row, inner] * vectors[inner, column]
            vectors[row, column] = total / matrix[row, row]
    return determinant
