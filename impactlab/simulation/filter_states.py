"""States of filters of noise at a sample, which a block keeps at some samples only."""

from __future__ import annotations

import numpy as np

from impactlab.integrators.arguments import Coloured, Sparse
from impactlab.kernels.coloured import BEGIN
from impactlab.kernels.random import fill_normals


def filter_states(coloured: Coloured, sample: int) -> np.ndarray:
    """Return the states of all filters at a sample, not before the first of those last taken, (row, lane)."""
    filters, states = coloured.filters, np.array(coloured.kept[BEGIN], dtype=float)
    if not len(states):
        return states
    normals = np.empty((4, filters.streams.shape[1], len(coloured.realizations)), dtype=np.float32)
    motion, noise = _dense(filters.motion, *2 * (len(states),)), _dense(filters.noise, len(states), normals.shape[1])
    begin = filters.finer * int(coloured.place[0])
    for number in range(begin, filters.finer * sample):
        if number == begin or number % 4 == 0:
            fill_normals(filters.streams, coloured.realizations, np.uint64(number // 4), normals)
        states = motion @ states + noise @ normals[number % 4]
    return states


def _dense(matrix: Sparse, rows: int, columns: int) -> np.ndarray:
    """Return the first rows of a matrix with its zeros."""
    result, count = np.zeros((rows, columns)), matrix.begin[rows]
    row = np.repeat(np.arange(rows), np.diff(matrix.begin[: rows + 1]))
    np.add.at(result, (row, matrix.columns[:count]), matrix.values[:count])
    return result
