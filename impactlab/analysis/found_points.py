"""Section points that lanes return to: how many are wanted, and what is found."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impactlab.kernels.contact_states import FRICTION
from impactlab.located.scenes import Linear
from impactlab.located.sliders import with_sliders

FULL_TURN = 2.0 * math.pi

TOLERANCE = 1e-10
"""That of located events, see `impactlab.EventLocated`."""

SETTLED_WITHIN = 1e-10
"""Distance from a periodic motion, as a part of its size, from which on it is taken for it: the error of a path."""

ROUNDED_POINTS = 1e-12
"""Part of the size of a motion up to which a difference between section points is rounding."""

SAME_POINTS = 1e-3
"""Part of the tolerance of periods up to which differences need not decrease any more."""

Names = Callable[[int, int], str]
"""Returns the name of a contact of a lane."""


class Wanted(NamedTuple):
    """How many section points are wanted, and how closely they are compared."""

    transient: int  # points that are not kept
    keep: int
    tolerance: float  # part of the size of a motion up to which points are the same
    settled: float = SETTLED_WITHIN
    points: bool = True  # whether points are returned


class Returns(NamedTuple):
    """Section points of lanes, their periods and their impacts."""

    points: np.ndarray  # (lane, keep or 0, 2 coordinate) displacements and velocities
    times: np.ndarray  # (lane, keep or 0) when they are (s), of sections that are no strobes
    ends: np.ndarray  # (lane, 2 coordinate) where lanes end, at the last point of a strobe
    sizes: np.ndarray  # (lane, 2 coordinate) sizes of the motion
    periods: np.ndarray  # (lane,) points after which the motion repeats, 0 if it does not, -1 where there is none
    impacts: np.ndarray  # (lane, contact) mean number from point to point, NaN for endlessly many
    errors: np.ndarray  # (lane,) largest estimated error of a displacement (m)
    refused: dict[int, str]  # why there is none

    @classmethod
    def nothing(cls, lanes: int, wanted: Wanted, coordinates: int, contacts: int) -> Returns:
        """Return room for the results of lanes."""
        number, states = wanted.keep if wanted.points else 0, (2 * coordinates,)
        shapes = (number, *states), (number,), states, states
        points, times, ends, sizes = (np.full((lanes, *shape), np.nan) for shape in shapes)
        impacts = np.full((lanes, contacts), np.nan)
        return cls(points, times, ends, sizes, np.full(lanes, -1), impacts, np.full(lanes, np.nan), {})

    def put(self, lanes: np.ndarray, found: Returns) -> None:
        """Put the results of some lanes in their places."""
        for own, other in zip(self[:-1], found[:-1], strict=True):
            own[lanes] = other
        self.refused.update({int(lanes[lane]): text for lane, text in found.refused.items()})


def drifts_of(scene: Linear) -> np.ndarray:
    """Return orthonormal directions in which no spring, contact or slider holds the bodies, (coordinate, direction)."""
    bodies = scene.mass.shape[1]
    rows = [scene.stiffness, with_sliders(scene, scene.links)[:, scene.kinds != FRICTION]]
    sizes = [np.abs(item).max(axis=(1, 2), initial=0.0)[:, None, None] for item in rows]
    scaled = [
        np.divide(item, size, out=np.zeros_like(item), where=size > 0.0) for item, size in zip(rows, sizes, strict=True)
    ]
    every = np.concatenate(scaled, axis=1).reshape(-1, bodies)
    rates, directions = np.linalg.eigh(every.T @ every)
    return directions[:, rates <= 1e-12 * max(1.0, rates.max(initial=0.0))]


def overlap_text(name: str, size: float) -> str:
    return f"The bodies of contact {name!r} overlap by {size:g} m at the start; give another initial= or clearance."
