"""Whether realizations of a driven network forget how they began, as their own series tell at no cost.

Given forces may keep several motions up. Each realization then settles into one of them, and the mean over realizations
counts how many began near each. What realizations remember shows: their means over time differ by more than parts
of one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impactlab.kernels.sums import VV, XX, X
from impactlab.plan import Plan
from impactlab.relaxation import correlation_of_neighbours

MOST_REMEMBERED = 0.005
"""Part of a statistic by which realizations may differ for good, unnoticed."""

AGREEING = 2.0
"""Variance between means of realizations, over that expected from their batches, up to which they agree."""

CERTAIN = 6.0
"""Standard errors of the logarithm of that ratio: its tails are wider than of normal samples."""

_ROWS = {X: "mean_displacement", XX: "mean_square_displacement", VV: "mean_square_velocity"}


@dataclass(frozen=True)
class Memory:
    """What realizations remember.

    Attributes
    ----------
    share : (body,) ndarray
        Part of the variance between the units of an estimate that more of them do not average away; 0 where nothing is
        remembered.
    warning : str
        A sentence that says it; empty if nothing is.
    """

    share: np.ndarray
    warning: str = ""

    def widening(self, units: int) -> np.ndarray:
        """Return what standard errors of so many units must be multiplied by, (body,)."""
        return np.asarray(np.sqrt(1.0 + self.share * (units - 1)))


def memory_of(plan: Plan, bodies: np.ndarray, steps: np.ndarray, alone: bool) -> Memory:
    """Compare the scatter between realizations with that within them.

    Parameters
    ----------
    plan : Plan
    bodies : (batch, row, body, realization) ndarray
        Sums over the steps of each batch.
    steps : (batch,) ndarray
        How many these are.
    alone : bool
        Whether realizations are the units of the estimate, not their batches.
    """
    batches, _, count, realizations = bodies.shape
    nothing = Memory(np.zeros(count))
    settles = isinstance(plan.start, str) and plan.spin_up_steps and plan.settled and plan.relaxation > 0.0
    if not (len(plan.forced) and settles and plan.trusted and batches > 1 and realizations > 1):
        return nothing
    rows = list(_ROWS)
    means = bodies[:, rows] / steps[:, None, None, None]
    values = means.mean(axis=(0, -1))
    scale = np.abs(values)
    scale[0] = np.sqrt(values[1])
    between = means.mean(axis=0).var(axis=-1, ddof=1)
    offsets = means - means.mean(axis=-1, keepdims=True)  # what forces do to all of them alike is none
    within = offsets.var(axis=0, ddof=1).mean(axis=-1) / batches
    # batches that follow each other are alike as long as linear motion remembers, with nothing to choose from
    alike = correlation_of_neighbours(steps.min() * plan.step / plan.relaxation)
    freedom = realizations - 1, realizations * (batches - 1)
    chance = math.exp(CERTAIN * math.sqrt(sum(2.0 / number for number in freedom)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = between / within
        kept = np.sqrt(np.maximum(between - within, 0.0)) / scale
        share = np.where(alone, 1.0 - 1.0 / ratio, (ratio - 1.0) / (ratio - 1.0 + batches))
    limit = max(AGREEING, chance * (1.0 + alike) / (1.0 - alike))
    remembered = (ratio > limit) & (kept > MOST_REMEMBERED) & plan.random
    if not remembered.any():
        return nothing
    row, body = np.unravel_index(np.where(remembered, kept, 0.0).argmax(), kept.shape)
    share_of_value = 100.0 * kept[row, body]
    warning = (
        f"Realizations settle into different motions: {_ROWS[rows[row]]} of {plan.bodies[body]!r} differs for good "
        f"between them by {share_of_value:.3g} % (root mean square). The mean over realizations depends on how they "
        "begin, and standard errors say by how much: give initial=, or a longer spin_up= if they change over."
    )
    return Memory(np.where(remembered, share, 0.0).max(axis=0), warning)
