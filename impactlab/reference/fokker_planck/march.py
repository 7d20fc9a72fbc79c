"""Steps of a density in blocks that fit into a cache, over threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np

from impactlab.reference.fokker_planck.propagator import Propagator

_BLOCK = 2**17
"""Numbers in a block."""

_COLUMNS, _TOGETHER = 192, 16
"""Columns in a product with the waves of the gap, and products that a thread does together."""


class March:
    """Carries densities on the grid of a propagator from step to step.

    Each step begins with a `check` of the time that is left. Threads of the pool each call a BLAS that has no threads
    of its own. Blocks do not depend on their number, hence nor do numbers.
    """

    def __init__(self, propagator: Propagator, pool: Executor, check: Callable[[], None] = lambda: None) -> None:
        self._propagator, self._pool, self._check = propagator, pool, check
        self._nodes, *self._rest = propagator.basis[:4]
        self._waves = len(propagator.grid.modes.numbers)
        self._buffers = [np.empty((2 * self._waves, *self._rest), propagator.pair.real) for _ in range(2)]

    def __call__(self, density: np.ndarray, steps: int) -> np.ndarray:
        """Return the density after some steps, normalised."""
        density = density.copy()
        one, two = self._buffers
        onto, off = self._propagator.modes
        rows = max(1, round(_BLOCK / np.prod(self._rest)))
        for _ in range(steps):
            self._check()
            self._share(self._nodes, rows, self._kick, density)
            self._product(onto, one[: self._nodes], two)
            self._share(self._waves, rows, self._drift)
            self._product(off, two, density)
        return self._propagator.normalized(density)

    def _kick(self, part: slice, density: np.ndarray) -> None:
        """Kick nodes of the gap, from the density into the first buffer."""
        one, two = (item[part] for item in self._buffers)
        left, right = self._propagator.kicks
        np.matmul(left[part], density[part], out=two)
        np.matmul(two, right[part], out=one)

    def _drift(self, part: slice) -> None:
        """Drift waves of the gap, in the second buffer."""
        one, two = (item.reshape(self._waves, 2, *self._rest)[part] for item in self._buffers)
        self._propagator.drift(part, one, two)

    def _product(self, matrix: np.ndarray, source: np.ndarray, target: np.ndarray) -> None:
        """Multiply the gap's axis by a matrix."""
        source, target = source.reshape(len(source), -1), target.reshape(len(target), -1)

        def multiply(part: slice) -> None:
            for start in range(part.start, part.stop, _COLUMNS):
                columns = slice(start, min(start + _COLUMNS, part.stop))
                np.matmul(matrix, source[:, columns], out=target[:, columns])

        self._share(source.shape[1], _TOGETHER * _COLUMNS, multiply)

    def _share(self, count: int, size: int, function: Callable[..., None], *arguments: np.ndarray) -> None:
        """Call a function for blocks of some size, over the threads."""
        parts = [slice(start, min(start + size, count)) for start in range(0, count, size)]
        for _ in self._pool.map(lambda part: function(part, *arguments), parts):
            pass
