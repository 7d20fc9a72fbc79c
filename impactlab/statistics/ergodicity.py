"""Whether realizations of a driven network forget how they began, judged from their own series at no cost.

Given forces, and laws that depend on time, may sustain several motions. Each realization then settles into one of them,
and the mean over realizations depends on how many began near each. This shows in the means over time: realizations
differ from each other by more than the parts of one do. Where nothing is random, a few more runs begin elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from impactlab.errors import WORTH_SAYING, Diverged
from impactlab.kernels.rows import VV, XX, X
from impactlab.plan.plan import Plan
from impactlab.step_control.rules.relaxation import correlation_of_neighbours

AGREEING = 2.0
"""Largest ratio of the variance between realizations to the variance expected from their batches, for agreement."""

CERTAIN_TO_DIFFER = 6.0
"""Standard errors allowed for the logarithm of `AGREEING`'s ratio, whose tails are wider than a normal law's."""

STARTS, SECONDS_ELSEWHERE = (3.0, -3.0, 10.0, -10.0), 1.0
"""Velocities, in units of the root mean square velocity, with which a motion without noise is started anew; and the
time that these runs may take, as a plan foresees it (s)."""

_ROWS = {X: "mean_displacement", XX: "mean_square_displacement", VV: "mean_square_velocity"}


@dataclass(frozen=True)
class Memory:
    """Dependence of realizations on their initial states."""

    share: np.ndarray
    """(body,) part of the variance between units that does not fall as their number grows; 0 where nothing is
    remembered."""
    warning: str = ""  # a sentence that says it; empty if nothing is

    def widening(self, units: int) -> np.ndarray:
        """Return the factor by which the standard errors of `units` units grow, (body,)."""
        return np.asarray(np.sqrt(1.0 + self.share * (units - 1)))


def memory_of(plan: Plan, bodies: np.ndarray, steps: np.ndarray, alone: bool) -> Memory:
    """Compare the scatter between realizations with that within them.

    `bodies` are sums over the steps of each batch, (batch, row, body, realization), and `alone` says whether
    realizations are the units of the estimate, not their batches.
    """
    batches, _, count, realizations = bodies.shape
    nothing = Memory(np.zeros(count))
    if not (_settles(plan) and plan.realizations.trusted and batches > 1 and realizations > 1):
        return nothing
    rows = list(_ROWS)
    means = bodies[:, rows] / steps[:, None, None, None]
    scale = _scale(means.mean(axis=(0, -1)))
    between = means.mean(axis=0).var(axis=-1, ddof=1)
    offsets = means - means.mean(axis=-1, keepdims=True)  # what forces do to all of them alike is none
    within = offsets.var(axis=0, ddof=1).mean(axis=-1) / batches
    # batches that follow each other are alike as long as linear motion remembers, with nothing to choose from
    alike = correlation_of_neighbours(steps.min() * plan.clock.step / plan.clock.relaxation)
    freedom = realizations - 1, realizations * (batches - 1)
    chance = math.exp(CERTAIN_TO_DIFFER * math.sqrt(sum(2.0 / number for number in freedom)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = between / within
        kept = np.sqrt(np.maximum(between - within, 0.0)) / scale
        share = np.where(alone, 1.0 - 1.0 / ratio, (ratio - 1.0) / (ratio - 1.0 + batches))
    limit = max(AGREEING, chance * (1.0 + alike) / (1.0 - alike))
    remembered = (ratio > limit) & (kept > WORTH_SAYING) & plan.noise.random
    if not remembered.any():
        return nothing
    row, body = np.unravel_index(np.where(remembered, kept, 0.0).argmax(), kept.shape)
    name, share_of_value = plan.system.bodies[body], 100.0 * kept[row, body]
    warning = (
        f"Realizations settle into different motions: {_ROWS[rows[row]]} of {name!r} differs permanently "
        f"between them by {share_of_value:.3g} % (root mean square). The mean over realizations depends on how they "
        "begin, and standard errors include this. Give initial=, or a longer spin_up= if they switch."
    )
    return Memory(np.where(remembered, share, 0.0).max(axis=0), warning)


def begun_elsewhere(plan: Plan, bodies: np.ndarray, sums_of: Callable[[Plan], np.ndarray]) -> str:
    """Describe the motion without noise from other starts than rest; empty if it ends in the same motion.

    The sums of the run are (batch, phase, row, body, 1); `sums_of` runs a plan of one realization and returns its sums.
    """
    affordable = int(SECONDS_ELSEWHERE / plan.seconds(1))
    if not (plan.forces.kicked.any() and _settles(plan) and affordable) or plan.subdomains.tiles:
        return ""
    usual, others = _means(plan, bodies), []
    velocity = np.sqrt(usual[2])
    for times in STARTS[:affordable]:
        start = replace(plan.start, state=np.stack([plan.start.rest, times * velocity])[..., None])
        unobserved, alone = replace(plan.observed, records=(), every=0), replace(plan.realizations, keep=False)
        try:
            others.append(_means(plan, sums_of(replace(plan, start=start, observed=unobserved, realizations=alone))))
        except Diverged:
            continue
    return difference_of_starts(usual, others, plan.system.bodies)


def difference_of_starts(usual: np.ndarray, others: Iterable[np.ndarray], bodies: Sequence[str]) -> str:
    """Say by how much means of x, x² and v², (row, body), are others after other starts; empty if by nothing."""
    scale, largest = _scale(usual), (WORTH_SAYING, 0, 0)
    for other in others:
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.nan_to_num(np.abs(other - usual) / scale, posinf=0.0)
        row, body = np.unravel_index(change.argmax(), change.shape)
        largest = max(largest, (float(change[row, body]), int(row), int(body)))
    size, row, body = largest
    if size <= WORTH_SAYING:
        return ""
    return (
        f"The motion depends on how it begins: {list(_ROWS.values())[row]} of {bodies[body]!r} differs by "
        f"{100.0 * size:.3g} % if it does not begin at rest. Give initial=, or a longer duration= if it is chaotic."
    )


def _settles(plan: Plan) -> bool:
    """Whether functions of time drive the bodies, and linear motion forgets its start during the spin-up."""
    begun = not plan.start.given and plan.clock.spin_up_steps > 0
    return bool(plan.led and begun and plan.clock.settled and plan.clock.relaxation > 0.0)


def _means(plan: Plan, bodies: np.ndarray) -> np.ndarray:
    """Means of x, x² and v² of one realization, (row, body)."""
    return np.asarray(bodies.sum(axis=(0, 1))[list(_ROWS), :, 0] / plan.clock.steps)


def _scale(means: np.ndarray) -> np.ndarray:
    """Return the sizes by which differences of means are measured: their own, for x the root mean square."""
    return np.stack([np.sqrt(means[1]), means[1], means[2]])
