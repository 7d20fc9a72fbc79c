"""Integrals over panels that are halved until they resolve a function."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import impactlab as il

Function = Callable[[np.ndarray], np.ndarray]

_CHANGE = 1.5  # of a logarithm within a panel, per node, so that these resolve its exponential
_DEPTH = 500.0  # below its largest value, where a logarithm no longer matters
_LEVELS = 60


@dataclass(frozen=True, eq=False)
class Table:
    """The logarithm of a density or of a transfer integral: a polynomial on each panel.

    Logarithms are kept because bodies that press against each other sit where the single
    factors and messages are vanishingly small.

    Attributes
    ----------
    edges : (panel + 1,) ndarray
        Edges of the panels, increasing.
    coefficients : (panel, order) ndarray
        Coefficients of the Legendre polynomials on each panel.
    """

    edges: np.ndarray
    coefficients: np.ndarray

    @property
    def top(self) -> float:
        """Largest mean of a panel: the largest value, up to the variation within a panel."""
        return float(self.coefficients[:, 0].max())

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the values at places within the edges."""
        return self.on(x, x[..., None])[..., 0]

    def on(self, inside: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the values at places along the last axis that lie in the same panel as another place."""
        panel = np.clip(np.searchsorted(self.edges, inside, side="right") - 1, 0, len(self.coefficients) - 1)
        left, right = self.edges[panel, None], self.edges[panel + 1, None]
        t = (2.0 * x - left - right) / (right - left)
        coefficients = self.coefficients[panel]
        last, before = np.zeros_like(t), np.zeros_like(t)
        for k in range(coefficients.shape[-1] - 1, 0, -1):  # the recurrence of Clenshaw
            last, before = (
                coefficients[..., k, None] + (2 * k + 1) / (k + 1) * t * last - (k + 1) / (k + 2) * before,
                last,
            )
        return np.asarray(coefficients[..., 0, None] + t * last - 0.5 * before)


class Quadrature:
    """Gauss-Legendre sums over panels that are halved until they resolve a function.

    Parameters
    ----------
    order : int
        Nodes per panel.
    tolerance : float
        Relative size of what is neglected.
    """

    def __init__(self, order: int = 20, tolerance: float = 1e-12) -> None:
        self.order, self.tolerance = order, tolerance
        self._nodes, self._weights = np.polynomial.legendre.leggauss(order)
        vandermonde = np.polynomial.legendre.legvander(self._nodes, order - 1)
        self._transform = self._weights[:, None] * vandermonde * (np.arange(order) + 0.5)

    def points(self, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return nodes and weights of the panels between edges along the last axis: (…, panel, node)."""
        left, half = edges[..., :-1, None], 0.5 * np.diff(edges)[..., None]
        return left + half * (1.0 + self._nodes), half * self._weights

    def table(self, logarithm: Function, edges: np.ndarray) -> Table:
        """Tabulate the logarithm of a function such that the function can be integrated, too."""

        def fine(values: np.ndarray, tail: np.ndarray, largest: np.ndarray) -> np.ndarray:
            high = values.max(axis=(0, 2))
            smooth = tail[0] <= self.tolerance * (1.0 + np.abs(values).max(axis=(0, 2)))
            flat = high - values.min(axis=(0, 2)) < _CHANGE * self.order
            return np.asarray((smooth & flat) | (high < largest - _DEPTH))

        return Table(*self._resolved(lambda x: logarithm(x)[None], edges, fine, np.max)[:2])

    def integrals(self, function: Function, *edges: np.ndarray) -> np.ndarray:
        """Integrate functions of similar size, evaluated together as (function, place)."""
        low, high = max(item[0] for item in edges), min(item[-1] for item in edges)
        if low >= high:
            return np.zeros(len(function(np.zeros(1))))

        def fine(values: np.ndarray, tail: np.ndarray, largest: np.ndarray) -> np.ndarray:
            return np.asarray((tail <= 10.0 * self.tolerance * largest).all(axis=0))

        both = np.unique(np.clip(np.concatenate(edges), low, high))
        ends, _, means = self._resolved(function, both, fine, lambda values: np.abs(values).max())
        return np.asarray(means @ np.diff(ends))

    def _resolved(
        self, function: Function, edges: np.ndarray, fine: Callable[..., np.ndarray], measure: Function
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Halve panels until they are fine; return edges, the first function's coefficients and all means."""
        pending, largest = np.stack([edges[:-1], edges[1:]], axis=1), -math.inf
        panels, found = [], []
        for _ in range(_LEVELS):
            places = self.points(pending)[0][:, 0]
            values = function(places.ravel()).reshape(-1, *places.shape)
            largest = max(largest, float(measure(values)))
            coefficients = values @ self._transform
            done = fine(values, np.abs(coefficients[:, :, -3:]).max(axis=2), largest)
            panels.append(pending[done])
            found.append(coefficients[:, done])
            if done.all():
                break
            rough = pending[~done]
            middle = rough.mean(axis=1)
            pending = np.concatenate([np.stack([rough[:, 0], middle], 1), np.stack([middle, rough[:, 1]], 1)])
        else:
            raise il.ImpactLabError("A density is not smooth enough to be integrated.")
        starts, every = np.concatenate(panels)[:, 0], np.concatenate(found, axis=1)
        order = np.argsort(starts)
        return np.append(starts[order], edges[-1]), every[0, order], every[:, order, 0]
