"""Functionals of dry friction: the slip rate and what would hold it, or by how much what holds it is beyond limits."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.contact_states import FRICTION, STICKS
from impactlab.kernels.pieces import LEVELS, WEIGHTS, Pieces
from impactlab.located.scenes import Linear


def write_slip_and_stick(
    scene: Linear, lanes: np.ndarray, status: np.ndarray, functionals: tuple[np.ndarray, ...]
) -> None:
    """Write slip rates, or in the place of the forces that hold frictions by how much they are beyond either limit."""
    bodies, frequency = scene.mass.shape[1], scene.frequencies[lanes]
    rows, constants, swings, _ = functionals
    for link in np.flatnonzero(scene.kinds >= FRICTION):
        one, other, (_, breakaway, surface) = 2 * link, 2 * link + 1, scene.frictions[lanes, link].T
        if status[link] == STICKS:
            for values in functionals:
                values[:, one] = values[:, other]
                values[:, other] *= -1.0
            constants[:, [one, other]] -= breakaway[:, None]
        else:
            rows[:, one, :bodies], rows[:, one, bodies:] = 0.0, scene.links[lanes, link]
            constants[:, one], swings[:, one] = surface, 1j * frequency * scene.wall[lanes, link]


def write_holding(scene: Linear, lanes: np.ndarray, slips: np.ndarray, held: np.ndarray, pieces: Pieces) -> None:
    """Write the forces that would hold frictions that slip, beside all that is held, behind their slip rates.

    They are the forces of slip, and what takes away the rates of the slip rates.
    """
    root = scene.mass[lanes, None] ** -0.5
    scaled, fixed = scene.links[lanes] * root, held * root
    left = scaled - scaled @ np.linalg.pinv(fixed, rcond=1e-12) @ fixed
    share, size = ((item**2).sum(axis=2) for item in (left, scaled))
    count, frequency = pieces.sizes[0], scene.frequencies[lanes]
    for link in np.flatnonzero(slips):
        moves = share[:, link] > 1e-12 * size[:, link]  # others do not hold it
        inertia = np.divide(1.0, share[:, link], out=np.zeros(len(lanes)), where=moves)[:, None]
        rate, holding = 2 * link, 2 * link + 1
        weights = pieces.weights.reshape(*pieces.weights.shape[:2], -1, WEIGHTS)
        weights[:, holding, :count, :2] = inertia[..., None] * weights[:, rate, :count, 2:4]
        pieces.constants[:, holding, 0] = (
            inertia[:, 0] * pieces.constants[:, rate, 1] + slips[link] * scene.frictions[lanes, link, 0]
        )
        real, imaginary = pieces.swings[:, rate, 0::2], pieces.swings[:, rate, 1::2]
        pieces.swings[:, holding, 0::2] = -inertia * frequency * imaginary
        pieces.swings[:, holding, 1::2] = inertia * frequency * real
        direct = pieces.direct.reshape(*pieces.direct.shape[:2], -1, LEVELS + 1)
        direct[:, holding, :, 0] = inertia * direct[:, rate, :, 1]
