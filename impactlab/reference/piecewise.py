"""Functions as polynomials on panels that are halved until these resolve them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impactlab.errors import NoExactReference
from impactlab.machine import ROWS_AT_A_TIME
from impactlab.reference.potential import NODES_OF_PANEL, WEIGHTS

COEFFICIENTS = len(NODES_OF_PANEL)
_LEGENDRE = np.polynomial.legendre.legvander(NODES_OF_PANEL, COEFFICIENTS - 1)
TRANSFORM = WEIGHTS[:, None] * _LEGENDRE * (np.arange(COEFFICIENTS) + 0.5)  # values at the nodes → coefficients
_SIGNS = np.where(np.arange(COEFFICIENTS) % 2, -1.0, 1.0)  # of the Legendre polynomials at −1
MOST_PANELS = 20_000


@dataclass(frozen=True, eq=False)
class Piecewise:
    """Functions of one coordinate: Legendre polynomials on the same panels."""

    edges: np.ndarray  # (panel + 1,) edges of the panels, increasing
    coefficients: np.ndarray  # (function, panel, order) coefficients of the polynomials

    @cached_property
    def nodes(self) -> np.ndarray:
        """Gauss nodes, (panel, order)."""
        return self.edges[:-1, None] + 0.5 * np.diff(self.edges)[:, None] * (1.0 + NODES_OF_PANEL)

    @cached_property
    def values(self) -> np.ndarray:
        """Values at the nodes, (function, panel, order)."""
        return np.asarray(self.coefficients @ _LEGENDRE.T)

    @cached_property
    def masses(self) -> np.ndarray:
        """Values times the weights of Gauss's rule, (function, panel, order)."""
        return np.asarray(self.values * WEIGHTS * (0.5 * np.diff(self.edges)[:, None]))

    @cached_property
    def integrals(self) -> np.ndarray:
        """Integrals over each panel, (function, panel)."""
        return np.asarray(self.coefficients[:, :, 0] * np.diff(self.edges))

    def cumulative(self, places: np.ndarray) -> np.ndarray:
        """Return the integrals from the first edge to some places, (function, place)."""
        panel = self.panel_of(places)
        t = self._local(panel, places[:, None])[:, 0]
        legendre = np.polynomial.legendre.legvander(t, COEFFICIENTS)
        primitive = np.empty((len(t), COEFFICIENTS))
        primitive[:, 0] = t + 1.0
        primitive[:, 1:] = (legendre[:, 2:] - legendre[:, :-2]) / (2.0 * np.arange(1, COEFFICIENTS) + 1.0)
        part = 0.5 * np.diff(self.edges)[panel] * np.einsum("fpk,pk->fp", self.coefficients[:, panel], primitive)
        before = np.cumsum(self.integrals, axis=1) - self.integrals
        return np.asarray(before[:, panel] + part)

    def mirrored(self) -> Piecewise:
        """Return the functions of the coordinate with the opposite sign."""
        return Piecewise(-self.edges[::-1], _SIGNS * self.coefficients[:, ::-1])

    def panel_of(self, places: np.ndarray) -> np.ndarray:
        """Return the panels in which places lie; the nearest for those outside."""
        return np.clip(np.searchsorted(self.edges, places, side="right") - 1, 0, len(self.edges) - 2)

    def __call__(self, starts: np.ndarray, offsets: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the values of the functions at places and offsets from them, (function, place)."""
        panel = self.panel_of(starts + offsets)
        return self._at(panel, self._local(panel, starts[:, None], np.reshape(offsets, (-1, 1))))[..., 0]

    def on(self, panel: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the values at places (row, place) in a panel for each row, (function, row, place)."""
        return self._at(panel, self._local(panel, places))

    def basis(self, panel: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the Legendre polynomials at places (row, place) in a panel for each row, (row, place, order)."""
        return np.polynomial.legendre.legvander(self._local(panel, places), COEFFICIENTS - 1)

    def _at(self, panel: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return the values at local coordinates by the recurrence of Clenshaw."""
        coefficients = self.coefficients[:, panel]
        last, before = np.zeros(coefficients.shape[:1] + t.shape), np.zeros(coefficients.shape[:1] + t.shape)
        for k in range(COEFFICIENTS - 1, 0, -1):
            last, before = (
                coefficients[..., k, None] + (2 * k + 1) / (k + 1) * t * last - (k + 1) / (k + 2) * before,
                last,
            )
        return np.asarray(coefficients[..., 0, None] + t * last - 0.5 * before)

    def _local(self, panel: np.ndarray, places: np.ndarray, offsets: np.ndarray | float = 0.0) -> np.ndarray:
        """Return places as coordinates from −1 to 1; what is close to an edge is not rounded away."""
        left = self.edges[panel, None]
        local = 2.0 * ((places - left) + offsets) / (self.edges[panel + 1, None] - left) - 1.0
        return np.asarray(np.clip(local, -1.0, 1.0))  # a rounded place may lie beside a panel that is much narrower


OfPanels = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A function of edges and offsets from them, two arrays of one dimension, that returns (function, place)."""

Fineness = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Whether panels are fine enough, from values (function, panel, node), the sizes of the last coefficients (function,
panel), the edges of the panels (panel, 2) and the sizes that the coefficients had before the panels were halved."""


def resolve(function: OfPanels, edges: np.ndarray, is_fine: Fineness, what: str) -> Piecewise:
    """Return functions on panels that are halved until they are fine; they are refused if they do not become so."""
    pending = np.stack([edges[:-1], edges[1:]], axis=1)
    panels, found, before = [], [], None
    while len(pending):
        values, coefficients = _sampled(function, pending)
        middle = pending.mean(axis=1)
        tails = np.abs(coefficients[:, :, -3:]).max(axis=2)
        before = np.full_like(tails, math.inf) if before is None else before
        fine = is_fine(values, tails, pending, before)
        fine |= (middle <= pending[:, 0]) | (middle >= pending[:, 1])
        panels.append(pending[fine])
        found.append(coefficients[:, fine])
        (left, right), middle = pending[~fine].T, middle[~fine]
        pending, before = np.concatenate([[left, middle], [middle, right]], axis=1).T, np.tile(tails[:, ~fine], 2)
        if sum(map(len, panels)) + len(pending) > MOST_PANELS:
            raise NoExactReference(f"{what}: the integral of exp(−H/T) does not converge; its potential is not smooth.")
    every, coefficients = np.concatenate(panels), np.concatenate(found, axis=1)
    order = np.argsort(every[:, 0])
    return Piecewise(np.append(every[order, 0], edges[-1]), coefficients[:, order])


def _sampled(function: OfPanels, panels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values at the nodes and coefficients, (function, panel, order)."""
    offsets = 0.5 * np.diff(panels, axis=1) * (1.0 + NODES_OF_PANEL)
    values = function(np.repeat(panels[:, 0], COEFFICIENTS), offsets.ravel())
    values = values.reshape(len(values), -1, COEFFICIENTS)
    return values, values @ TRANSFORM


def resolve_with(
    function: OfPanels,
    edges: np.ndarray,
    probes: np.ndarray,
    is_fine: Callable[[], Fineness],
    what: str,
    tolerance: float,
) -> Piecewise:
    """Return the same as `resolve`, with more first edges where the functions are not what they are at some probes.

    Probes are further places, and the ends of the panels: a kink may lie closer to an edge than
    the first node. The tolerance is relative to the largest value of each function.
    """
    found = resolve(function, edges, is_fine(), what)
    for _ in range(8):
        allowed = tolerance * np.abs(found.values).max(axis=(1, 2))[:, None]
        wrong = (np.abs(function(probes, np.zeros_like(probes)) - found(probes)) > allowed).any(axis=0)
        more, widths = [probes[wrong & ~np.isin(probes, edges)]], np.diff(found.edges) / 64.0
        for ends, signs, inwards in ((slice(0, -1), _SIGNS, widths), (slice(1, None), np.ones(COEFFICIENTS), -widths)):
            places = found.edges[ends]
            differences = function(places, np.zeros_like(places)) - found.coefficients @ signs
            more.append((places + inwards)[(np.abs(differences) > allowed).any(axis=0)])
        if not sum(map(len, more)):
            break
        edges = np.unique(np.concatenate([edges, *more]))
        found = resolve(function, edges, is_fine(), what)
    return found


def fine_integrals(corners: np.ndarray, tolerance: float) -> Fineness:
    """Return a fineness for integrals from one corner to the next, each relative to itself.

    Their sizes are taken from the first panels.
    """
    scale: np.ndarray | None = None

    def is_fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
        nonlocal scale
        widths = panels[:, 1] - panels[:, 0]
        part = np.searchsorted(corners, panels.mean(axis=1))
        if scale is None:
            sizes = np.abs(values).mean(axis=2) * widths
            scale = np.array([np.bincount(part, row, len(corners) + 1) for row in sizes])
        return np.asarray((tails * widths <= tolerance * scale[:, part]).all(axis=0))

    return is_fine


def shifted_integrals(edges: np.ndarray, kernel: Piecewise, shifts: np.ndarray) -> np.ndarray:
    """Return the weights of the integrals ``∫ f(y + u) kernel(u) du`` of any f that is given on panels.

    Both are polynomials on panels, and between the edges of both Gauss's rule is exact for their product, so that
    nothing is lost where the kernel has a kink. Outside of their edges f and the kernels are 0; the shifts are y. The
    weights are those of the coefficients of f, (kernel, shift, panel, order).
    """
    panels, count = len(edges) - 1, len(kernel.coefficients)
    result = np.zeros((len(shifts) * panels, count, COEFFICIENTS))
    of_f = Piecewise(edges, np.empty((0, panels, COEFFICIENTS)))
    step = max(1, ROWS_AT_A_TIME // (panels + len(kernel.edges)))
    for first in range(0, len(shifts), step):
        y = shifts[first : first + step, None]
        low = np.maximum(kernel.edges[0], edges[0] - y)
        high = np.maximum(low, np.minimum(kernel.edges[-1], edges[-1] - y))
        fixed = np.broadcast_to(kernel.edges, (len(y), len(kernel.edges)))
        both = np.sort(np.clip(np.concatenate([edges - y, fixed], axis=1), low, high), axis=1)
        row, column = np.nonzero(np.diff(both, axis=1) > 0.0)
        if not len(row):
            continue
        left, half = both[row, column], 0.5 * (both[row, column + 1] - both[row, column])
        panel = of_f.panel_of(left + half + y[row, 0])
        u = left[:, None] + half[:, None] * (1.0 + NODES_OF_PANEL)
        weighted = kernel.on(kernel.panel_of(left + half), u) * (half[:, None] * WEIGHTS)
        parts = np.moveaxis(weighted, 0, 1) @ of_f.basis(panel, u + y[row])
        place = (first + row) * panels + panel
        starts = np.flatnonzero(np.diff(place, prepend=-1))
        result[place[starts]] = np.add.reduceat(parts, starts, axis=0)
    return np.moveaxis(result.reshape(len(shifts), panels, count, COEFFICIENTS), 2, 0)
