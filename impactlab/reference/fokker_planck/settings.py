"""Which grid and step a pair gets, and how they are changed."""

from __future__ import annotations

import math

import numpy as np

from impactlab.reference.fokker_planck.grid import Grid
from impactlab.reference.fokker_planck.pair import Pair, Well
from impactlab.reference.fokker_planck.propagator import Basis

FEWER, LONGER = 0.75, math.sqrt(2.0)
"""What one direction of the basis at a time is changed by, to see its convergence."""

SHARES = {"gap": 0.2, "center": 0.15, "first": 0.1, "second": 0.1, "box": 0.1}
"""Error relative to the change by a quarter fewer nodes, at most: it falls exponentially with their number, and
that of the box as the tail of a normal law, with the square of its size."""

LADDER = (*Basis._fields, "step twice")
"""Directions of the basis; for the step there is a third one, twice as long."""

FUNCTIONS, _FREE = 9.0, 1.2
"""Hermite functions of a body that follows the other one, and the step over its natural frequency."""

_BOX, _GAP, _CENTER, _VELOCITY, _COLD = 5.5, 7.5, 0.48, 0.43, 0.65
"""Half the box in standard deviations, cells of the gap to a penetration, other cells in standard deviations; the last
is for a cold body, in those of the body alone."""


def rule(pair: Pair, well: Well, part: float = 1.0) -> Basis:
    """Return the basis with which to begin, from scales of the network.

    7.5 cells of the gap to the depth at which the contact stores the energy T of the box, 5.5
    standard deviations of the Gibbs law at T to each side, with cells of 0.48 of the center and 0.43 of
    a velocity, up to 1.5 times as small for a body that alone is colder than T; a step of 0.32 over the
    frequency of the closed contact and 0.8 over those of the bodies. `part` times as many nodes go
    half into the box and half into cells. A body that follows the other one has 9 Hermite functions for each of its
    coordinates, and allows for a step of 1.2 over its frequency.
    """
    size, box = math.sqrt(part), _BOX * math.sqrt(part)
    gap = Grid.nodes_within(well, box, min(well.penetration, well.width) / (_GAP * size))
    cold = 1.0 - np.minimum(pair.temperatures / well.temperature, 1.0)
    first, second = _VELOCITY / ((1.0 + 0.2 * cold.max()) * (1.0 + 0.25 * cold))
    narrow = _CENTER / (1.0 + 0.15 * cold.max())
    if well.cold.any():  # ranges are those of hits, and cells those of the bodies alone
        first, second = np.where(well.cold, _COLD, (first, second)) * well.cores / well.speeds
        narrow = _COLD * well.center(well.cores) / well.center(well.speeds)
    closed = math.sqrt(max(well.tangent / pair.reduced_mass, 1e-300))
    follows = pair.gaussian > 0.0
    step = min(0.32 / closed, (_FREE if follows else 0.8) / math.sqrt(pair.stiffness[0] / pair.mass[0]))
    center, first, second = (_odd(2.0 * box * size / cell) for cell in (narrow, first, second))
    if follows:
        center = first = _odd(FUNCTIONS * part)
    return Basis(_odd(gap), center, first, second, box, step / math.sqrt(size))


def coarser(well: Well, basis: Basis, direction: str) -> Basis:
    """Return a basis with one direction of `LADDER` made coarser."""
    return changed(well, basis, direction.split()[0], FEWER, LONGER**2 if direction == LADDER[-1] else LONGER)


def finer(well: Well, basis: Basis, direction: str, excess: float) -> Basis:
    """Return a basis with one direction made finer, such that its error is smaller by some factor."""
    excess = min(excess, 50.0)
    nodes = 1.0 + 0.08 * math.log(excess)
    if direction not in ("box", "step"):
        nodes = max(nodes, 1.0 + 2.0 / getattr(basis, direction))
    # the error of the step is of fourth order
    return changed(well, basis, direction, nodes, excess**-0.25)


def changed(well: Well, basis: Basis, name: str, nodes: float, step: float) -> Basis:
    """Return a basis with one direction changed: the box with its cells as they are, others in the same box."""
    if name == "step":
        return basis._replace(step=basis.step * step)
    if name != "box":
        return basis._replace(**{name: _odd(nodes * getattr(basis, name))})
    size = math.sqrt(nodes)
    gap = Grid.nodes_within(well, size * basis.box, Grid.of(well, basis.box, basis.gap).fine)
    center, first, second = (_odd(size * count) for count in (basis.center, basis.first, basis.second))
    if well.pair.gaussian:  # the box is not that of the body that follows
        center, first = basis.center, basis.first
    return Basis(_odd(gap), center, first, second, size * basis.box, basis.step)


def _odd(count: float) -> int:
    """Return the nearest odd number."""
    return 2 * round(0.5 * (count - 1.0)) + 1
