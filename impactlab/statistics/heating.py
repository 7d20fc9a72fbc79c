"""What the sums of a run say about its step and its start, at no cost: heat that the step makes, and equipartition."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impactlab.errors import WORTH_SAYING
from impactlab.plan.plan import Plan
from impactlab.results.schema import Moments
from impactlab.statistics.regression import CERTAIN, Regression

MOST_PARTS = 1000
"""Largest number of connected parts that are examined: each takes a regression."""

CERTAIN_TO_HEAT = 4.0
"""Standard errors of the share beyond `WORTH_SAYING` that count as heating."""


@dataclass(frozen=True)
class Heating:
    """Heat made by the step, relative to the power put in by noise."""

    share: float = math.nan
    """Of the connected part of the network where it is most certainly not 0; NaN where it is not known: where forces
    depend on velocities, which take or bring heat themselves.
    """
    error: float = math.nan  # standard error of the share
    body: str = ""  # the first body of that part
    parts: int = 1  # connected parts that were looked at

    @property
    def significance(self) -> float:
        """How many standard errors it is off 0."""
        return abs(self.share) / max(self.error, 1e-300)

    @property
    def warning(self) -> str:
        """A sentence that says it, where it is too much."""
        certain = math.sqrt(
            CERTAIN_TO_HEAT**2 + 2.0 * math.log(self.parts)
        )  # as the largest of so many normal numbers grows
        if not abs(self.share) > WORTH_SAYING + certain * self.error:
            return ""
        return (
            f"Friction takes {100.0 * abs(self.share):.2g} ± {100.0 * self.error:.1g} % "
            f"{'more' if self.share > 0.0 else 'less'} heat than noise puts into {self.body!r} and what is connected "
            f"to it, and temperatures are too {'high' if self.share > 0.0 else 'low'} by about as much: "
            f"{'the step may be too large' if self.share > 0.0 else 'the spin-up may be too short'}."
        )


def heating_of(plan: Plan, moments: Moments, weights: np.ndarray, seldom: np.ndarray) -> Heating:
    """Return the heat that a step with conservative kicks made: what friction takes beyond the power of the noise.

    These are ``Σ c E[v²]`` and ``Σ πS/m``. In a stationary motion under conservative forces they are the same in each
    connected part. Balances of the velocities are controls of the sum, as they are of each of its terms, but not
    those of `seldom` bodies. The moments are of independent units.
    """
    if not plan.forces.kicked.any():
        return Heating()
    mass, damping, _ = plan.system.linear
    labels = plan.system.links.parts
    put_in = np.zeros(len(mass))
    put_in[plan.noise.white] = np.pi * plan.noise.intensity / mass[plan.noise.white]
    given = np.bincount(labels, put_in)
    taken = damping[:, None] * moments.bodies.vv
    balances = moments.balances.get("mean_square_velocity", np.full_like(taken, np.nan))
    usable = np.isfinite(balances).all(axis=1) & (np.ptp(balances, axis=1) > 0.0) & (damping > 0.0) & ~seldom
    dampers = _damped_couplings(plan)
    worst = Heating()
    kicked = np.bincount(labels, plan.forces.kicked) > 0.0
    parts = np.flatnonzero(kicked & (given > 0.0) & (not dampers))
    members = np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:-1])
    for part in parts[:MOST_PARTS]:
        slots = members[part]
        controls = slots[usable[slots]][: len(weights) // 8]
        value, error = Regression(balances[controls][None], weights).at_zero(taken[slots].sum(axis=0)[None])
        share, scatter = float(value[0] / given[part]) - 1.0, float(error[0] / given[part])
        found = Heating(share, scatter, plan.system.bodies[slots[0]], len(parts))
        if math.isnan(worst.share) or found.significance > worst.significance:
            worst = found
    return worst


def _damped_couplings(plan: Plan) -> bool:
    """Whether a damper between two bodies is a part of a linear motion: it is not at their temperature."""
    groups = plan.method.groups
    return any((group.system.damping != np.diag(plan.system.linear[1, group.slots])).any() for group in groups)


def conservative(plan: Plan) -> bool:
    """Whether kicks are conservative and white noise alone drives a run that is stationary and long enough."""
    stationary = plan.steady and plan.clock.settled and plan.realizations.trusted
    conservative = not (plan.forces.passes or len(plan.forces.states) or plan.events.dissipative)
    return stationary and conservative and not plan.driving.series


def unequal_partition(plan: Plan, mean_square_velocity: np.ndarray, error: np.ndarray) -> str:
    """Say which body has not the temperature of its part, where all noise there has one; forces are `conservative`."""
    if _damped_couplings(plan):
        return ""
    mass, damping, _ = plan.system.linear
    labels = plan.system.links.parts
    intensity = np.zeros(len(mass))
    intensity[plan.noise.white] = plan.noise.intensity
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.pi * intensity / damping
    lowest, highest = np.full(labels.max() + 1, np.inf), np.zeros(labels.max() + 1)
    bathed = (damping > 0.0) | (intensity > 0.0)
    np.minimum.at(lowest, labels[bathed], own[bathed])
    np.maximum.at(highest, labels[bathed], own[bathed])
    one = (highest - lowest <= 1e-9 * highest) & (highest > 0.0) & np.isfinite(highest)
    one[labels[plan.noise.common]] = False  # correlated forces keep no common temperature
    temperature = np.where(one, highest, np.nan)[labels]
    off = mass * mean_square_velocity - temperature
    limit = WORTH_SAYING * temperature + CERTAIN * mass * error
    wrong = np.flatnonzero(np.abs(off) > limit)
    if not wrong.size:
        return ""
    body = wrong[np.argmax(np.abs(off[wrong]) / limit[wrong])]
    return (
        f"mean_square_velocity of {plan.system.bodies[body]!r} is {100.0 * off[body] / temperature[body]:+.2g} ± "
        f"{100.0 * mass[body] * error[body] / temperature[body]:.1g} % off the common temperature of all noise there: "
        "the step may be too large, or the spin-up too short."
    )
