"""Finite elements in the plane of a displacement and a velocity, for functions of where a body starts.

Functions are polynomials on rectangles, continuous over velocities. Over displacements they jump, and take the value
from where the body is going (an upwind discontinuous Galerkin method: W. H. Reed and T. R. Hill, LA-UR-73-479, 1973).
At a limit a function has a singularity at rest, of the form ``d^(1/6) Φ(v³/d)`` at a distance d (T. W. Marshall and
E. J. Watson, J. Phys. A 18, 1985, 3531), for which rectangles become smaller as a geometric series.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre
from scipy.sparse.linalg import splu

from impactlab.quadrature import gauss_legendre
from impactlab.reference.fokker_planck.phase_plane import PhasePlane

EXTRA_NODES = 2
"""Nodes of a quadrature beyond those of the polynomials."""


class Mesh(NamedTuple):
    """Polynomials and rectangles; sizes are parts of the interval and of the largest velocity."""

    along_x: int  # degree over displacements
    along_v: int  # degree over velocities
    widest: float  # largest rectangle
    growth: float  # factor from a rectangle to the next larger one
    least_x: float  # smallest ones, at the limits
    least_v: float  # and at rest
    reach: float  # largest velocity, in that of the plane


class Polynomials:
    """Polynomials on [−1, 1] by their values at Gauss–Lobatto nodes, with a quadrature of Gauss."""

    def __init__(self, degree: int) -> None:
        inner = legendre.legroots(legendre.legder([0.0] * degree + [1.0])).real
        self._nodes = np.concatenate([[-1.0], np.sort(inner), [1.0]])
        self.number = degree + 1
        self.places, self.weights = gauss_legendre(self.number + EXTRA_NODES)
        self.values, self.slopes = self.at(self.places), self.at(self.places, True)
        self.low, self.high = self.at(np.array([-1.0, 1.0]))

    def at(self, places: np.ndarray, slopes: bool = False) -> np.ndarray:
        """Return the values of all polynomials, or their slopes, at some places, (place, polynomial)."""
        coefficients = np.linalg.inv(legendre.legvander(self._nodes, self.number - 1))
        if not slopes:
            return np.asarray(legendre.legvander(places, self.number - 1) @ coefficients)
        return np.asarray(legendre.legval(places, legendre.legder(coefficients)).T)


class Elements:
    """The equations ``M dS/dt = G S`` of the probability S that a body is still within, over its start."""

    def __init__(self, plane: PhasePlane, mesh: Mesh) -> None:
        self.plane, self.of_x, self.of_v = plane, Polynomials(mesh.along_x), Polynomials(mesh.along_v)
        (low, high), speed = plane.ends, mesh.reach * plane.speed
        half = _graded(mesh.least_x, mesh.widest, mesh.growth, 0.5)
        inner = np.concatenate([half, 1.0 - half[-2::-1]])
        self.x = np.unique(np.concatenate([low + (high - low) * inner, plane.kinks]))
        steps = speed * _graded(mesh.least_v, mesh.widest, mesh.growth, 1.0)
        self.v = np.concatenate([-steps[:0:-1], steps])
        self.rows = (len(self.v) - 1) * mesh.along_v + 1  # unknowns over velocities
        self.unknowns = (len(self.x) - 1) * self.of_x.number * self.rows

    def read(self, field: np.ndarray, *states: np.ndarray) -> np.ndarray:
        """Return a function (unknown, …) at some states, displacements and velocities, (state,) each."""
        x, v = states
        i, s = _place(self.x, x)
        j, u = _place(self.v, v)
        columns = j[:, None] * (self.of_v.number - 1) + np.arange(self.of_v.number)
        blocks = field.reshape(len(self.x) - 1, self.of_x.number, self.rows, *field.shape[1:])
        near = blocks[i[:, None, None], np.arange(self.of_x.number)[:, None], columns[:, None]]
        return np.asarray(np.einsum("na,nj,naj...->n...", self.of_x.at(s), self.of_v.at(u), near))

    @cached_property
    def mass(self) -> sp.csc_array:
        """M, (unknown, unknown)."""
        return self._weighted(*self._ones)

    @cached_property
    def displacement(self) -> sp.csc_array:
        """The same of functions times the displacement."""
        return self._weighted(_nodes(self.x, self.of_x.places), self._ones[1])

    @cached_property
    def velocity(self) -> sp.csc_array:
        """The same of functions times the velocity."""
        return self._weighted(self._ones[0], _nodes(self.v, self.of_v.places))

    @cached_property
    def pushed(self) -> sp.csc_array:
        """The part of G of an acceleration of 1."""
        over_x = np.einsum(
            "i,q,qa,qb->iab", 0.5 * np.diff(self.x), self.of_x.weights, self.of_x.values, self.of_x.values
        )
        over_v = np.einsum("q,qj,qk->jk", self.of_v.weights, self.of_v.values, self.of_v.slopes)
        each = np.ones(len(self.v) - 1)
        return self._assembled([(np.einsum("iab,e,jk->iabejk", over_x, each, over_v), 0)])

    @property
    def _ones(self) -> tuple[np.ndarray, np.ndarray]:
        """The weights 1 at the nodes over displacements and velocities."""
        pairs = ((self.x, self.of_x), (self.v, self.of_v))
        x, v = (np.ones((len(edges) - 1, len(part.places))) for edges, part in pairs)
        return x, v

    def _weighted(self, along_x: np.ndarray, along_v: np.ndarray) -> sp.csc_array:
        """Return the products of functions with weights at the nodes of quadratures, (element, node) each."""
        over_x, over_v = (
            np.einsum("i,iq,q,qa,qb->iab", 0.5 * np.diff(edges), at_nodes, part.weights, part.values, part.values)
            for edges, at_nodes, part in ((self.x, along_x, self.of_x), (self.v, along_v, self.of_v))
        )
        return self._assembled([(np.einsum("iab,ejk->iabejk", over_x, over_v), 0)])

    @property
    def others(self) -> tuple[str, ...]:
        """Names of other bodies: there are none."""
        return ()

    @property
    def ones(self) -> np.ndarray:
        """The coefficients of the function 1."""
        return np.ones(self.unknowns)

    def weigh(self, field: np.ndarray) -> np.ndarray:
        """Return M times a function, (unknown,)."""
        return np.asarray(self.mass @ field)

    def inverse(self, step: float | None = None) -> Callable[..., np.ndarray]:
        """Return what solves equations of G, or of ``M - step G``."""
        matrix = self.generator if step is None else (self.mass - step * self.generator).tocsc()
        solve: Callable[..., np.ndarray] = splu(matrix).solve
        return solve

    @cached_property
    def generator(self) -> sp.csc_array:
        """G, (unknown, unknown)."""
        x, v, half = self.of_x, self.of_v, 0.5 * np.diff(self.v)
        speeds = _nodes(self.v, v.places)
        up, down = (
            np.einsum("e,q,eq,qj,qk->ejk", half, v.weights, part, v.values, v.values)
            for part in (np.maximum(speeds, 0.0), np.minimum(speeds, 0.0))
        )
        drift = np.einsum("q,qa,qb->ab", x.weights, x.values, x.slopes)
        own = np.einsum("ab,ejk->abejk", drift, up + down)
        own -= np.einsum("a,b,ejk->abejk", x.high, x.high, up) - np.einsum("a,b,ejk->abejk", x.low, x.low, down)
        blocks = self._pushed(speeds) + own
        number = len(self.x) - 1
        ahead = np.einsum("a,b,ejk->abejk", x.high, x.low, up)
        behind = -np.einsum("a,b,ejk->abejk", x.low, x.high, down)
        return self._assembled(
            [
                (blocks, 0),
                (np.broadcast_to(ahead, (number, *ahead.shape)), 1),
                (np.broadcast_to(behind, (number, *behind.shape)), -1),
            ]
        ) + self._turned_back(up, down)

    def _pushed(self, speeds: np.ndarray) -> np.ndarray:
        """Return the part of forces and noise, (element of x, a, b, element of v, j, k)."""
        x, v, half = self.of_x, self.of_v, 0.5 * np.diff(self.x)
        places = _nodes(self.x, x.places)
        states = np.broadcast_arrays(places[:, :, None, None], speeds)
        forces = self.plane.forces.acceleration(*(item.ravel() for item in states)).reshape(states[0].shape)
        along = np.einsum("i,p,pa,pb->ipab", half, x.weights, x.values, x.values)
        across = np.einsum("q,ipeq,qj,qk->ipejk", v.weights, forces, v.values, v.slopes, optimize=True)
        spread = 0.5 * self.plane.diffusion * np.einsum("q,qj,qk->jk", v.weights, v.slopes, v.slopes)
        across -= spread * (2.0 / np.diff(self.v))[:, None, None]
        return np.asarray(np.einsum("ipab,ipejk->iabejk", along, across, optimize=True))

    def _turned_back(self, up: np.ndarray, down: np.ndarray) -> sp.csc_array:
        """Return the part of ends at which the velocity changes its sign."""
        x, number = self.of_x, len(self.x) - 1
        parts = np.zeros((number, x.number, x.number, *up.shape))
        if self.plane.mirrored[1]:
            parts[-1] += np.einsum("a,b,ejk->abejk", x.high, x.high, up)
        if self.plane.mirrored[0]:
            parts[0] -= np.einsum("a,b,ejk->abejk", x.low, x.low, down)
        return self._assembled([(parts, 0)], True)

    def _assembled(self, parts: list[tuple[np.ndarray, int]], turned: bool = False) -> sp.csc_array:
        """Return a matrix from blocks of rectangles and those some elements of x further, maybe with columns of −v."""
        number, elements = len(self.x) - 1, len(self.v) - 1
        local = np.arange(elements)[:, None] * (self.of_v.number - 1) + np.arange(self.of_v.number)
        grid = np.arange(number)[:, None] * self.of_x.number + np.arange(self.of_x.number)
        columns_v = self.rows - 1 - local if turned else local
        rows, columns, values = [], [], []
        for blocks, shift in parts:
            begin, end = max(0, -shift), number - max(0, shift)
            row = grid[begin:end, :, None, None, None, None] * self.rows + local[:, :, None]
            column = grid[begin + shift : end + shift, None, :, None, None, None] * self.rows + columns_v[:, None, :]
            data, row, column = np.broadcast_arrays(blocks[begin:end], row, column)
            there = data != 0.0
            rows.append(row[there])
            columns.append(column[there])
            values.append(data[there])
        places = np.concatenate(rows), np.concatenate(columns)
        shape = self.unknowns, self.unknowns
        return sp.coo_array((np.concatenate(values), places), shape=shape).tocsc()


def _graded(least: float, widest: float, growth: float, end: float) -> np.ndarray:
    """Return edges from 0 to an end, each interval a factor wider than the one before, up to the widest."""
    edges = [0.0, least]
    while edges[-1] < end:
        edges.append(edges[-1] + min(widest, (growth - 1.0) * edges[-1]))
    return np.array(edges) * (end / edges[-1])


def _nodes(edges: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the nodes of a quadrature with places in [−1, 1] in all intervals, (interval, node)."""
    return np.asarray(0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * places)


def _place(edges: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the interval of each value, and the place in it from −1 to 1."""
    index = np.clip(np.searchsorted(edges, values, "right") - 1, 0, len(edges) - 2)
    return index, 2.0 * (values - edges[index]) / (edges[index + 1] - edges[index]) - 1.0
