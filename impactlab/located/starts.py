"""Where bodies rest under contacts that are closed beforehand."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.contact_states import RIGID
from impactlab.located.scenes import Linear

ROUNDS = 50
"""Sets of closed contacts that are tried."""


def at_rest(scene: Linear) -> np.ndarray:
    """Return displacements under the static forces of contacts alone, 0 where none is closed there, (1, body)."""
    soft = scene.kinds < RIGID
    gap, links, springs = scene.gap[0, soft], scene.links[0, soft], scene.springs[0, soft]
    x, closed = np.zeros(scene.mass.shape[1]), gap > 0.0
    for _ in range(ROUNDS if closed.any() else 0):
        k = springs * closed
        x = np.linalg.lstsq(scene.stiffness[0] + (links.T * k) @ links, -links.T @ (k * gap), rcond=None)[0]
        after = links @ x + gap > 0.0
        if (after == closed).all():
            break
        closed = after
    return x[None]
