"""Which grid and step a pair gets, and how they are changed."""

from __future__ import annotations

import math

import numpy as np

from impactlab.phase_space.pair import Pair, Well
from impactlab.phase_space.propagator import REACH, Basis

FEWER, LONGER = 0.75, math.sqrt(2.0)
"""What one direction of the basis at a time is changed by, to see its convergence."""

LADDER = (*Basis._fields, "step twice")
"""Directions of the basis; for the step there is a third one, twice as long."""


def rule(pair: Pair, well: Well, part: float = 1.0) -> Basis:
    """Return the basis with which to begin, from scales of the network.

    Four nodes to the depth at which the contact stores the energy T of the box, two to a standard
    deviation of the center, 1.7 to one of a velocity, and more where one body alone is colder than
    T, as the fourth root of the ratio; a step of 0.4 over the
    frequency of the closed contact and 0.8 over those of the bodies.
    """
    low, high = well.ends
    gap = (high - low) / min(0.25 * well.penetration, 0.5 * well.width)
    velocity = _odd(part * REACH / 0.3 * max(well.temperature / float(pair.temperatures.min()), 1.0) ** 0.25)
    closed = math.sqrt(max(well.tangent / pair.reduced_mass, 1e-300))
    step = min(0.4 / closed, 0.8 / float(np.sqrt(pair.stiffness / pair.mass).max()))
    return Basis(
        _fast(part * gap),
        _odd(part * 4.0 * REACH),
        velocity,
        velocity,
        step / part,
    )


def coarser(basis: Basis, direction: str) -> Basis:
    """Return a basis with one direction of `LADDER` made coarser."""
    return changed(basis, direction.split()[0], FEWER, LONGER**2 if direction == LADDER[-1] else LONGER)


def finer(basis: Basis, direction: str) -> Basis:
    """Return a basis with one direction made finer."""
    return changed(basis, direction, 1.0 / FEWER, 1.0 / LONGER)


def changed(basis: Basis, name: str, nodes: float, step: float) -> Basis:
    """Return a basis with one direction changed."""
    value = getattr(basis, name)
    if name == "step":
        return basis._replace(step=value * step)
    return basis._replace(**{name: (_fast if name == "gap" else _odd)(nodes * value)})


def _fast(count: float) -> int:
    """Return the nearest length that Fourier transforms take well."""
    smooth = np.multiply.outer(np.multiply.outer(2 ** np.arange(16), 3 ** np.arange(10)), 5 ** np.arange(7)).ravel()
    return int(smooth[np.argmin(np.abs(smooth - count))])


def _odd(count: float) -> int:
    """Return the nearest odd number."""
    return 2 * round(0.5 * (count - 1.0)) + 1
