"""Values of statistics and their standard errors: means over independent units, combined with balances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from impactlab.plan.plan import Plan
from impactlab.results.schema import (
    OF_POINTS,
    STATISTICS,
    Estimate,
    Moments,
    Statistic,
    Variable,
    stationary,
    statistic_of,
)
from impactlab.statistics.controls import controlled, moving, neighbours, touching, unbalanced
from impactlab.statistics.regression import Mean


@dataclass(frozen=True, eq=False)
class Values:
    """Values and standard errors, by the statistic."""

    combined: dict[str, Estimate]  # at balance 0; where no balances are used plain means
    direct: dict[str, Estimate]  # plain means, where balances are used
    balances: dict[str, Estimate]
    unbalanced: str  # which balance does not close; empty if all do

    @classmethod
    def of(cls, plan: Plan, moments: Moments, whole: Moments, mean: Mean, seldom: np.ndarray) -> Values:
        """Estimate them from the moments of independent units and of whole realizations.

        Bodies whose forces acted too `seldom`, (body,) of bool, have balances that are no controls.
        """
        balances = {name: mean(item) for name, item in moments.balances.items()}
        off = unbalanced(balances, plan.system.bodies, plan.noise.random)
        known = [*stationary(), *(OF_POINTS.values() if plan.points else ())]
        combined, direct = {item.name: item.averaged(moments, mean) for item in known}, {}
        errors = [error for _, error in balances.values()]
        usable = np.array([np.isfinite(error) & (error > 0.0) & ~seldom for error in errors]).T
        if usable.any() and mean.trusted and plan.clock.settled and not off:
            bodies = neighbours(plan.system.links.pairs, _kicked(plan))
            contacts = touching(plan.system.ends)
            direct, combined = combined, {}
            points = [moving(plan.points.shares, moments, bodies)] if plan.points else []
            for near in (bodies, contacts, *points):
                combined |= controlled(near, moments, mean, usable)
        of_realizations = Mean(np.ones(plan.realizations.number), trusted=True)
        for statistic in STATISTICS.values():
            if not statistic.stationary:
                combined[statistic.name] = statistic.averaged(whole, of_realizations)
        return cls(combined, direct, balances, off)

    def labelled(self) -> Iterator[tuple[Variable, Estimate]]:
        """Give all with what they are called in a dataset."""
        for statistic in (*STATISTICS.values(), *OF_POINTS.values()):
            if statistic.name in self.combined:
                yield statistic, self.combined[statistic.name]
        for name, estimate in self.direct.items():
            yield statistic_of(name).direct, estimate
        for name, estimate in self.balances.items():
            yield STATISTICS[name].balance, estimate

    def of_dimension(self, dimension: str) -> Iterator[tuple[Statistic, Estimate]]:
        """Give values and plain means of bodies or of contacts."""
        for estimates in (self.combined, self.direct):
            for name, estimate in estimates.items():
                if statistic_of(name).dimension == dimension:
                    yield statistic_of(name), estimate


def _kicked(plan: Plan) -> np.ndarray:
    """Whether other forces than linear ones may act on each body, or one in a group with it, (body,) of bool."""
    kicked = plan.forces.kicked.copy()
    for group in plan.method.groups:
        kicked[group.slots] = kicked[group.slots].any()
    return kicked
