"""Values of statistics and their standard errors: means over independent units, combined with balances."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from impactlab.plan.plan import Plan
from impactlab.results.schema import EVERY, STATE, STATISTICS, Estimate, Moments, Statistic, Variable
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
    def of_each(
        cls, plan: Plan, networks: Sequence[Plan], moments: Moments, whole: Moments, mean: Mean, seldom: np.ndarray
    ) -> list[Values]:
        """Estimate the values of the networks of a joint run from the moments of independent units and of realizations.

        `plan` is the plan of all `networks` together, see `impactlab.plan.side_by_side`; one network has its own plan.
        Balances of bodies whose forces acted too `seldom`, (body,) of bool, are not used as controls.
        """
        number = len(networks)
        balances = {name: mean(item) for name, item in moments.balances.items()}
        off = [
            unbalanced(_every(balances, place, number), network.system.bodies, network.noise.random)
            for place, network in enumerate(networks)
        ]
        plain = {item.name: item.averaged(moments, mean) for item in moments.statistics()}
        errors = [error for _, error in balances.values()]
        usable = np.array([np.isfinite(error) & (error > 0.0) & ~seldom for error in errors]).T
        used = [
            mean.trusted and network.clock.settled and not message and bool(usable[place::number].any())
            for place, (network, message) in enumerate(zip(networks, off, strict=True))
        ]
        combined = _at_balance(plan, moments, mean, usable) if any(used) else {}
        of_realizations = Mean(np.ones(plan.realizations.number), trusted=True)
        others = {
            statistic.name: statistic.averaged(whole, of_realizations)
            for statistic in STATISTICS.values()
            if not statistic.stationary
        }
        return [
            cls(
                _every((combined if used[place] else plain) | others, place, number),
                _every(plain, place, number) if used[place] else {},
                _every(balances, place, number),
                off[place],
            )
            for place in range(number)
        ]

    def labelled(self) -> Iterator[tuple[Variable, Estimate]]:
        """Give each estimate with its variable in a dataset."""
        for statistic in EVERY.values():
            if statistic.name in self.combined:
                yield statistic, self.combined[statistic.name]
        for name, estimate in self.direct.items():
            yield EVERY[name].direct, estimate
        for name, estimate in self.balances.items():
            yield STATISTICS[name].balance, estimate

    def of_dimension(self, dimension: str) -> Iterator[tuple[Statistic, Estimate]]:
        """Give values and plain means of bodies, contacts or states of laws."""
        for estimates in (self.combined, self.direct):
            for name, estimate in estimates.items():
                if EVERY[name].dimension == dimension:
                    yield EVERY[name], estimate


def _every(estimates: Mapping[str, Estimate], place: int, number: int) -> dict[str, Estimate]:
    """Return the estimates of network `place` of a joint run of `number` networks."""
    rows = slice(place, None, number)
    return {name: Estimate(value[rows], error[rows]) for name, (value, error) in estimates.items()}


def _at_balance(plan: Plan, moments: Moments, mean: Mean, usable: np.ndarray) -> dict[str, Estimate]:
    """Return the statistics of bodies, contacts, points and states at balance 0; see `controlled`."""
    kicked = plan.forces.kicked.copy()  # whether other forces than linear ones may act on a body, or on its group
    for group in plan.method.groups:
        kicked[group.slots] = kicked[group.slots].any()
    bodies = neighbours(plan.system.links.pairs, kicked)
    contacts = touching(plan.system.ends)
    points = [moving(plan.points.shares, moments, bodies)] if plan.points.labels else []
    states = [touching(plan.forces.state_ends, STATE)] if len(plan.forces.states) else []
    result: dict[str, Estimate] = {}
    for near in (bodies, contacts, *points, *states):
        result |= controlled(near, moments, mean, usable)
    return result
