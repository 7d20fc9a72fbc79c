"""What the sums of a run say about its step and its start, at no cost: heat that the step makes, and equipartition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlab.kernels.sums import FV
from impactlab.model import connected_parts
from impactlab.plan import Plan

MOST_HEATING = 0.005
"""Heat that a step may make beside what noise puts in, and largest difference from a known temperature: one is the
other, where what is lost is proportional to the temperature."""

CERTAIN, VERY_CERTAIN = 3.0, 5.0
"""Standard errors beside it, of one number and of the largest of many."""


@dataclass(frozen=True)
class Heating:
    """Heat that a step makes, over the power that noise and friction exchange.

    Attributes
    ----------
    share, error : float
        Of the connected part of the network where it is largest, and its standard error; NaN where it is not known.
    body : str
        The first body of that part.
    """

    share: float
    error: float
    body: str

    @property
    def warning(self) -> str:
        """A sentence that says it, where it is too much."""
        if not self.share > MOST_HEATING + CERTAIN * self.error:
            return ""
        return (
            f"The step makes {100.0 * self.share:.2g} ± {100.0 * self.error:.1g} % of the heat that excitations put "
            f"into {self.body!r} and what is connected to it, and temperatures are too high by as much: use a smaller "
            "step."
        )


def heating_of(plan: Plan, bodies: np.ndarray, mean_square_velocity: np.ndarray) -> Heating:
    """Return the heat that the step made.

    Kicks of conservative forces, over which kinetic energy changes by the force times the mean of the velocities
    before and after, give back what they took in a stationary motion: what is left was made by the step. Forces that
    depend on velocities can only take.

    Parameters
    ----------
    plan : Plan
    bodies : (batch, phase, row, body, realization) ndarray
        Sums over the steps.
    mean_square_velocity : (body,) ndarray
        To see what friction takes (m2 s-2).
    """
    unknown = Heating(np.nan, np.nan, "")
    realizations = bodies.shape[-1]
    if not (plan.integrator.kicks and plan.steady and plan.trusted and plan.settled and plan.kicked.any()):
        return unknown
    labels = connected_parts(len(plan.bodies), plan.links)
    count = labels.max() + 1
    mass, damping, _ = plan.linear
    put_in = np.zeros(len(mass))
    put_in[plan.white] = np.pi * plan.intensity / mass[plan.white]
    exchanged = np.bincount(labels, np.maximum(put_in, damping * mean_square_velocity), count)
    powers = bodies[:, :, FV].sum(axis=1)  # (batch, body, realization)
    steps = np.diff([0, *plan.boundaries]).astype(float)
    whole = powers.sum(axis=0)[None] / steps.sum() if realizations >= 2 else powers / steps[:, None, None]
    of_bodies = whole.swapaxes(0, 1).reshape(len(labels), -1)
    units = np.zeros((count, of_bodies.shape[1]))
    np.add.at(units, labels, of_bodies)
    touched = np.unique(labels[plan.kicked])
    touched = touched[exchanged[touched] > 0.0]
    if not touched.size or units.shape[1] < 2:
        return unknown
    share = units[touched].mean(axis=1) / exchanged[touched]
    error = units[touched].std(axis=1, ddof=1) / np.sqrt(units.shape[1]) / exchanged[touched]
    worst = int(np.argmax(share - CERTAIN * error))
    first = int(np.argmax(labels == touched[worst]))
    return Heating(float(share[worst]), float(error[worst]), plan.bodies[first])


def _damped_couplings(plan: Plan) -> bool:
    """Whether a damper between two bodies is a part of a linear motion: it is not at their temperature."""
    groups = plan.flows.groups if plan.flows is not None else ()
    return any((group.system.damping != np.diag(plan.linear[1, group.slots])).any() for group in groups)


def unequal_partition(plan: Plan, mean_square_velocity: np.ndarray, error: np.ndarray) -> str:
    """Say which body has not the temperature of its part, where all noise there has one and forces are conservative."""
    if plan.dissipative or not (plan.steady and plan.trusted) or plan.lines or _damped_couplings(plan):
        return ""
    mass, damping, _ = plan.linear
    labels = connected_parts(len(mass), plan.links)
    intensity = np.zeros(len(mass))
    intensity[plan.white] = plan.intensity
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.pi * intensity / damping
    lowest, highest = np.full(labels.max() + 1, np.inf), np.zeros(labels.max() + 1)
    bathed = (damping > 0.0) | (intensity > 0.0)
    np.minimum.at(lowest, labels[bathed], own[bathed])
    np.maximum.at(highest, labels[bathed], own[bathed])
    one = (highest - lowest <= 1e-9 * highest) & (highest > 0.0) & np.isfinite(highest)
    temperature = np.where(one, highest, np.nan)[labels]
    off = mass * mean_square_velocity - temperature
    limit = MOST_HEATING * temperature + VERY_CERTAIN * mass * error
    wrong = np.flatnonzero(np.abs(off) > limit)
    if not wrong.size:
        return ""
    body = wrong[np.argmax(np.abs(off[wrong]) / limit[wrong])]
    return (
        f"mean_square_velocity of {plan.bodies[body]!r} is {100.0 * off[body] / temperature[body]:+.2g} ± "
        f"{100.0 * mass[body] * error[body] / temperature[body]:.1g} % off the temperature that all noise there has: "
        "the step may be too large, or the spin-up too short."
    )
