"""Trigonometric polynomials on equally spaced nodes."""

from __future__ import annotations

import numpy as np


def symmetric(half: float, count: int) -> np.ndarray:
    """Return nodes around 0 of a box of some half size."""
    return (np.arange(count) - 0.5 * (count - 1)) * (2.0 * half / count)


def waves_of(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the wave numbers of nodes, and the matrix that evaluates a trigonometric polynomial there."""
    waves = 2.0 * np.pi * np.fft.fftfreq(len(nodes), nodes[1] - nodes[0])
    return waves, np.exp(1j * np.outer(nodes, waves)) / len(nodes)


def onto_waves(places: np.ndarray, waves: np.ndarray | None = None) -> np.ndarray:
    """Return the matrix from values at places to coefficients of the wave numbers."""
    if waves is None:
        waves = waves_of(places)[0]
    return np.exp(-1j * np.outer(waves, places))


def evaluation(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the matrix from values at nodes to values at places, with the period of the box."""
    waves = waves_of(nodes)[0]
    return np.asarray((np.exp(1j * np.outer(places, waves)) / len(nodes) @ onto_waves(nodes, waves)).real)


def interpolation(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the matrix from values at nodes to values at places, 0 outside."""
    cell = nodes[1] - nodes[0]
    inside = (places >= nodes[0] - 0.5 * cell) & (places <= nodes[-1] + 0.5 * cell)
    return np.where(inside[:, None], evaluation(nodes, places), 0.0)


def planes(matrix: np.ndarray) -> np.ndarray:
    """Return the matrix that does to real and imaginary parts, one after the other, what a complex one does."""
    return np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])
