"""Paths without noise: whether small changes grow until paths are apart, and errors of averages along such paths."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from impactlab.assembly.model import Model
from impactlab.simulation.step_error import STILL

PIECES = 32, 16
"""Most and fewest parts of a path that tell how its averages scatter."""

FEWEST, FEWEST_PARTS = 8, 4
"""Fewest realizations, and fewest parts of a path, that tell a standard error."""

SHIFT = 1e-6
"""Change of the velocities at the start, as a part of them. What it does to a path no step can avoid; on regular paths
it grows with time, or as a square root."""

FAR, OFTEN = 0.1, 0.125
"""Distance of two paths, as a part of their velocities, beyond which they are apart, and the part of the time in which
they must be: at a moment between the impacts of one and the other they differ on regular paths, too."""


def in_pieces(run: int) -> tuple[tuple[int, ...], int]:
    """Return where parts of a path of so many steps begin, and their length: all of it but a few steps."""
    lengths = {number: run // number // 2 * 2 for number in range(PIECES[0], PIECES[1] - 1, -1)}
    number = max(lengths, key=lambda number: number * lengths[number])
    length = lengths[number]
    return tuple(range(0, number * length, length)) if length else (), length


def separate(model: Model, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether two paths are apart, by connected part, from their velocities, (moment, body, realization)."""
    labels, square = model.connected(), (one**2).mean(axis=(0, 2))
    energy, largest = model.mass * square, np.zeros(labels.max() + 1)
    np.maximum.at(largest, labels, energy)
    distance = np.quantile(((one - other) ** 2).mean(axis=2), 1.0 - OFTEN, axis=0)
    apart = (distance > FAR**2 * square) & (energy > STILL * largest[labels])
    result = np.zeros(len(largest), dtype=bool)
    result[labels[apart]] = True
    return result


def error_of_means(values: np.ndarray, widened: Callable[[int], float]) -> np.ndarray:
    """Return standard errors of means over paths, from parts that follow each other, (row, part, lane).

    Parts may be correlated with the next ones: the largest error of parts of several lengths counts. An error from
    few degrees of freedom is `widened`.
    """
    parts, lanes = values.shape[-2:]
    if lanes >= FEWEST:
        units = [values.mean(axis=-2)]
    else:
        numbers = [parts >> power for power in range(4) if parts >> power >= FEWEST_PARTS]
        units = [_joined(values, number) for number in numbers]
    errors = [widened(item.shape[-1] - 1) * item.std(axis=-1, ddof=1) / math.sqrt(item.shape[-1]) for item in units]
    return np.asarray(np.max(errors, axis=0))


def _joined(values: np.ndarray, number: int) -> np.ndarray:
    """Return means over so many longer parts, of all lanes, (row, unit)."""
    cuts = np.arange(number) * values.shape[-2] // number
    means = np.add.reduceat(values, cuts, axis=-2) / np.diff([*cuts, values.shape[-2]])[:, None]
    return np.asarray(means.reshape(len(values), -1))
