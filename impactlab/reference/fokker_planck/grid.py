"""Nodes of the gap: close to each other where the contact works, further apart elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlab.reference.fokker_planck.pair import Well
from impactlab.reference.fokker_planck.waves import evaluation, interpolation, onto_waves, waves_of

_BEFORE, _BEND = 2.2, 0.35
"""Place before the contact where cells have grown halfway, and length of the growth, in penetrations."""

_FILTER, _POWER = 36.0, 16
"""Strength of the filter in a step, and the power of the wave number."""


class Modes(NamedTuple):
    """Waves of the gap."""

    numbers: np.ndarray  # (waves,) wave numbers (m-1), from 0
    onto: np.ndarray  # (2 waves, nodes) from probabilities at nodes to the real and the imaginary part of each wave
    off: np.ndarray  # (nodes, 2 waves) back


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes ``Q(s)`` of the gap at whole distances of s, 0 being where the contact closes.

    Functions of the gap are trigonometric polynomials in s. The cells ``Q'(s)`` grow from `fine` to
    `coarse` along a logistic curve, so that Q is analytic.
    """

    fine: float  # cells in the contact (m)
    coarse: float  # cells far from it (m)
    penetration: float  # indentation that the fine cells are for (m)
    first: float  # place of the first node inside the contact, in cells
    before: int  # nodes outside of the contact
    count: int  # all nodes, an odd number

    @classmethod
    def of(cls, well: Well, box: float, count: int) -> Grid:
        """Return the grid of some nodes in a box, whose size is in standard deviations."""
        from scipy.optimize import brentq

        low, high = well.ends(box)
        widest = (high - low) / count
        least = widest / cls.sized(well, 1.0).coarse
        fine = float(brentq(lambda fine: cls.nodes_within(well, box, fine) - count, 0.5 * least, 2.0 * widest))
        grid = cls.sized(well, fine)
        before = round(grid.first - float(grid.coordinate(np.array([low]))[0]))
        return replace(grid, before=before, count=count)

    @classmethod
    def sized(cls, well: Well, fine: float) -> Grid:
        """Return the grid with some fine cells, without nodes."""
        # far from the contact, in half widths of the well, where cells in it are in penetrations
        coarse = max(3.0 * well.width / well.penetration, 1.0) * fine
        return cls(fine, coarse, well.penetration, well.pair.first_node, 0, 1)

    @classmethod
    def nodes_within(cls, well: Well, box: float, fine: float) -> float:
        """Return how many nodes a box takes with some fine cells."""
        return float(np.ptp(cls.sized(well, fine).coordinate(np.array(well.ends(box)))))

    @cached_property
    def places(self) -> np.ndarray:
        """Places s of the nodes."""
        return np.arange(self.count) - self.before + self.first

    @cached_property
    def nodes(self) -> np.ndarray:
        """Nodes (m)."""
        return self.at(self.places)

    @cached_property
    def cells(self) -> np.ndarray:
        """Cells of the nodes (m)."""
        return self.cell(self.places)

    @property
    def _growth(self) -> tuple[float, float]:
        """Place where cells have grown halfway, and how long the growth takes, in s."""
        return _BEFORE * self.penetration / self.fine, _BEND * self.penetration / self.fine

    def at(self, places: np.ndarray) -> np.ndarray:
        """Return Q(s)."""
        before, bend = self._growth
        grown = np.logaddexp(0.0, -(places + before) / bend) - np.logaddexp(0.0, -before / bend)
        return np.asarray(self.fine * places - (self.coarse - self.fine) * bend * grown)

    def cell(self, places: np.ndarray) -> np.ndarray:
        """Return Q'(s)."""
        from scipy.special import expit

        before, bend = self._growth
        return np.asarray(self.fine + (self.coarse - self.fine) * expit(-(places + before) / bend))

    def coordinate(self, gaps: np.ndarray) -> np.ndarray:
        """Return s where Q(s) are some gaps."""
        places = np.where(gaps > 0.0, gaps / self.fine, gaps / self.coarse - self._growth[0])
        for _ in range(50):
            change = (self.at(places) - gaps) / self.cell(places)
            places = places - change
            if np.abs(change).max() < 1e-12 * self.count:
                break
        return np.asarray(places)

    def values(self, places: np.ndarray) -> np.ndarray:
        """Return the matrix from values at the nodes to those at some s."""
        return evaluation(self.places, places)

    def taken_from(self, other: Grid) -> np.ndarray:
        """Return the matrix from probabilities at another grid's nodes to those at these, 0 outside."""
        matrix = interpolation(other.places, other.coordinate(self.nodes))
        return np.asarray(matrix * np.divide.outer(self.cells, other.cells))

    @cached_property
    def modes(self) -> Modes:
        """Waves of the gap.

        A drift, ``∂/∂q``, acts on ``√Q'`` times a density as an antisymmetric matrix. Its
        eigenvectors are the waves: a drift multiplies them by phases, and keeps the probability. The
        shortest ones are filtered by their number in s, whatever the size of the cells.
        """
        waves, there = waves_of(self.places)
        back, root = onto_waves(self.places, waves), np.sqrt(self.cells)
        derivative = ((there * (1j * waves)) @ back).real / np.outer(root, root)
        numbers, vectors = np.linalg.eigh(-0.5j * (derivative - derivative.T))
        half = self.count // 2  # where the eigenvalue is 0; the others are pairs
        numbers, vectors = numbers[half:], vectors[:, half:]
        numbers[0], vectors[:, 0] = 0.0, root / np.linalg.norm(root)
        smooth = np.exp(-_FILTER * (waves / waves.max()) ** _POWER)
        onto = vectors.conj().T / root @ ((there * smooth) @ back).real
        off = root[:, None] * vectors * np.where(numbers > 0.0, 2.0, 1.0)
        return Modes(
            numbers,
            np.stack([onto.real, onto.imag], axis=1).reshape(-1, self.count),
            np.stack([off.real, -off.imag], axis=2).reshape(self.count, -1),
        )
