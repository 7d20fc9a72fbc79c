"""The independent units of an estimate: realizations or, where there are few of them, batches of each."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from impactlab.kernels.rows import FF, FLUX
from impactlab.plan.clock import BATCHES
from impactlab.plan.plan import Plan
from impactlab.results.schema import CONTACT, Moments, sampled_of
from impactlab.statistics.moments import moments_of
from impactlab.statistics.point_moments import with_points


@dataclass(frozen=True, eq=False)
class Units:
    """What standard errors come from."""

    moments: Moments  # of the units
    whole: Moments  # of the realizations
    weights: np.ndarray  # (unit,) steps of a unit; 1 for realizations
    steps: np.ndarray  # (batch,) steps of the batches
    alone: bool  # whether realizations are the units, not their batches
    pushes: np.ndarray  # (body, unit) mean square of the forces of kicks; without rows if the method does not kick

    @classmethod
    def of(
        cls, plan: Plan, bodies: np.ndarray, contacts: np.ndarray, products: np.ndarray, points: np.ndarray
    ) -> Units:
        """Return those of a run, from the sums of its batches; see `impactlab.statistics.estimate.estimate`."""
        ends, realizations = (0, *plan.clock.boundaries), bodies.shape[-1]
        steps = np.diff(ends).astype(float)
        counts = np.array([plan.counts(*pair) for pair in pairwise(ends)]).T
        total = np.repeat(counts.sum(axis=1)[:, None], realizations, axis=1)
        sums = bodies, contacts, products, points
        whole = [item.sum(axis=0) for item in sums]
        for row, statistic in enumerate(sampled_of(CONTACT), FLUX + 1):
            if statistic.largest:
                whole[1][row] = contacts[:, row].max(axis=0)
        alone = realizations >= BATCHES
        pushes = _pushes(bodies, steps, alone) if plan.method.integrator.kicks else np.zeros((0, 0))
        if alone:
            moments = _moments(plan, total, *whole)
            return cls(moments, moments, np.ones(realizations), steps, alone, pushes)
        counts = np.concatenate([total, np.repeat(counts, realizations, axis=1)], axis=1)
        moments = _moments(plan, counts, *map(_joined, whole, sums))
        units, of_whole = moments.of_units(slice(realizations, None)), moments.of_units(slice(realizations))
        return cls(units, of_whole, np.repeat(steps, realizations), steps, alone, pushes)


def _moments(
    plan: Plan, counts: np.ndarray, bodies: np.ndarray, contacts: np.ndarray, products: np.ndarray, points: np.ndarray
) -> Moments:
    """Return the moments of bodies, contacts and points, if there are any."""
    moments = moments_of(plan, bodies, counts, contacts, products)
    return with_points(plan, moments, bodies, counts, points) if plan.points else moments


def _joined(whole: np.ndarray, batches: np.ndarray) -> np.ndarray:
    """Put batches, on the first axis, behind what they add up to, along the last."""
    units = np.moveaxis(np.concatenate([whole[None], batches]), 0, -2)
    return units.reshape(*whole.shape[:-1], units.shape[-2] * units.shape[-1])


def _pushes(bodies: np.ndarray, steps: np.ndarray, alone: bool) -> np.ndarray:
    """Return the mean square of the forces of kicks in each unit, (body, unit)."""
    squares = bodies[:, :, FF].sum(axis=1)
    if alone:
        return np.asarray(squares.sum(axis=0) / steps.sum())
    return np.asarray((squares / steps[:, None, None]).swapaxes(0, 1).reshape(squares.shape[1], -1))
