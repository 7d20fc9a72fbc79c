"""Gauss–Legendre quadrature."""

from __future__ import annotations

from functools import cache

import numpy as np


@cache
def gauss_legendre(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of an integral over [-1, 1], not to be changed."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    for array in (nodes, weights):
        array.setflags(write=False)
    return nodes, weights


def mean_rule(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of a mean over [0, 1]."""
    nodes, weights = gauss_legendre(points)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def legendre_coefficients(points: int) -> np.ndarray:
    """Return by what values at the nodes enter the coefficients of Legendre's polynomials, (point, degree)."""
    nodes, weights = gauss_legendre(points)
    polynomials = np.polynomial.legendre.legvander(nodes, points - 1)
    return np.asarray((np.arange(points) + 0.5) * polynomials * weights[:, None])
