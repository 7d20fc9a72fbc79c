"""Newton's method for orbits along a branch, by the derivatives of an orbit before as long as these do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from impactlab.kernels.shooting import NEWTON_STEPS

STALLED = 0.2
"""Part of the step before that is too long for the same derivatives to be used again."""

ASTRAY = 1e2
"""Step, as a part of the sizes of unknowns, that leads away from all that is near."""

Evaluate = Callable[[np.ndarray, Any], tuple[np.ndarray, np.ndarray]]
"""Returns what is left of the equations at some unknowns, and the derivatives that are given, or its own for None."""


def solved(
    evaluate: Evaluate, enough: Callable[[np.ndarray, bool], float], guess: np.ndarray, base: np.ndarray,
    border: np.ndarray, weights: np.ndarray, slopes: np.ndarray | None,
) -> tuple[np.ndarray, int] | None:  # fmt: skip
    """Return the unknowns near a guess for which ``border · (unknowns − base)`` is 0, or None if there are none.

    With them comes how often derivatives were found. `weights` are the sizes of unknowns; `enough` returns the step
    after which what is left is rounding, from the derivatives and whether they are those at the place itself.
    """
    unknowns, before, evaluated = guess.copy(), np.inf, 0
    for _ in range(NEWTON_STEPS):
        own = slopes is None
        evaluated += own
        left, slopes = evaluate(unknowns, slopes)
        change = np.linalg.solve(np.vstack([slopes, border]), np.append(left, border @ (unknowns - base)))
        largest = float(np.abs(change / weights).max())
        if not largest < ASTRAY:
            return None
        unknowns = unknowns - change
        if largest < enough(slopes, own):
            return unknowns, evaluated
        if largest > STALLED * before:
            slopes = None
        before = largest
    return None
