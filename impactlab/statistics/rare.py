"""Standard errors of what rare events made: the few that were seen may have been light ones.

Contacts that close seldom, and bodies that nothing but seldom contacts or couplings move, have standard errors from the
events that were seen. Those of ``n ± √n`` events are added, as large as one may be.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from impactlab.errors import warn
from impactlab.plan.observed import WINDOW
from impactlab.plan.plan import Plan
from impactlab.results.schema import Closing, Estimate, Moments, Push, Statistic

CLOSINGS = 30
"""Closings of a contact, in all units together, below which its standard errors are too small: intervals of
95 % held the mean force in 90 % of cases with 16 to 32 of them, in 83 % with 8 to 16 (random networks, 64 units)."""

ACTED = 0.01
"""Part of the mean square force of kicks from which on kicks count as having acted in a unit."""


@dataclass(frozen=True, eq=False)
class Events:
    """Numbers of independent events in all units together."""

    closings: np.ndarray  # (contact,) to each contact
    pushes: np.ndarray
    """(body,) to each body, by kicks or events; infinite where forces act always, or the method does not kick."""
    moved: np.ndarray
    """(body,) array of int: slots of bodies moved only by kicks and impacts, and too seldom for standard errors."""

    @classmethod
    def of(cls, plan: Plan, moments: Moments, squares: np.ndarray) -> Events:
        """Count them, from the moments and the mean squares of the forces of kicks of independent units."""
        closed, impulsive = moments.others["contact_ratio"] > 0.0, plan.events.impulsive
        closed[impulsive] = moments.others["contact_rate"][impulsive] > 0.0  # impacts take no time
        closings, cold = _seen(closed), plan.cold
        if not plan.method.integrator.kicks:
            return cls(closings, np.full(len(plan.system.bodies), np.inf), cold[:0])
        pushes = _seen((squares > 0.0) & (squares >= ACTED * squares.mean(axis=-1, keepdims=True)))
        for part in plan.events.parts:
            part.push(pushes, closings)
        return cls(closings, pushes, cold[pushes[cold] < CLOSINGS])

    def of_network(self, place: int, number: int) -> Events:
        """Return the events of network `place` of a joint run of `number`; see `impactlab.plan.side_by_side`."""
        moved = self.moved[self.moved % number == place] // number
        return Events(self.closings[place::number], self.pushes[place::number], moved)

    def seldom(self, plan: Plan) -> np.ndarray:
        """Whether contacts of a body closed, or its kicks acted, too seldom to use its balances, (body,) of bool."""
        seldom = np.zeros(len(plan.system.bodies) + 1, dtype=bool)
        seldom[plan.system.ends.chosen((self.closings < CLOSINGS) & plan.forces.likely).slots] = True
        return np.asarray(seldom[:-1] | (plan.forces.kicked & (self.pushes < CLOSINGS)))


def _seen(seen: np.ndarray) -> np.ndarray:
    """Return the expected number of independent events in all units, from the units with at least one event.

    A unit with n expected events has none with the probability exp(−n).
    Infinite where each unit has an event.
    """
    count = seen.shape[-1]
    with np.errstate(divide="ignore"):
        return np.asarray(count * -np.log1p(-np.count_nonzero(seen, axis=-1) / count)) + 0.0


Estimates = Iterable[tuple[Statistic, Estimate]]


def widen_contacts(plan: Plan, events: Events, kinetic: np.ndarray, estimates: Estimates) -> None:
    """Widen the errors of contacts that closed too seldom, from mean square velocities, (body,).

    A closing of bodies of the reduced mass μ whose velocities approach each other by v, sqrt(2) times their root mean
    square, gives the impulse 2 μ v; and it takes about π δ/v, δ being the length over which the density of the gap
    varies near contact.
    """
    rare = np.flatnonzero((events.closings > 0.0) & (events.closings < CLOSINGS))
    inverse_mass, square = map(plan.system.ends.chosen(rare).squares, (1.0 / plan.system.linear[0], kinetic))
    approach = np.sqrt(2.0 * np.maximum(square, 0.0))
    with np.errstate(divide="ignore"):
        duration = np.pi * plan.observed.window[rare] / WINDOW / approach
    scatter = np.sqrt(events.closings[rare]) / (plan.clock.step * plan.clock.steps * plan.realizations.finite)
    closing = Closing(duration, 2.0 / inverse_mass * approach)
    for statistic, (_, error) in estimates:
        if statistic.event is not None:
            error[rare] = np.hypot(error[rare], scatter * statistic.event(closing))


def widen_bodies(plan: Plan, events: Events, kinetic: np.ndarray, estimates: Estimates) -> None:
    """Do the same for bodies that are moved by kicks alone, and too seldom; NaN where they never moved.

    An event may bring the energy of the hottest body of the part, for as long as this energy takes to be lost.
    """
    moved, number = events.moved, events.pushes[events.moved]
    mass, _, stiffness = plan.system.linear
    labels = plan.system.links.parts
    hottest = np.zeros(labels.max(initial=-1) + 1)
    np.maximum.at(hottest, labels, mass * kinetic)
    time = plan.clock.step * plan.clock.steps * plan.realizations.finite
    share = np.sqrt(number) * 0.5 * plan.clock.relaxation / time
    with np.errstate(divide="ignore", invalid="ignore"):  # nothing moves, or no spring holds it
        velocity = share * hottest[labels[moved]] / mass[moved]
        push = Push(velocity * mass[moved] / stiffness[moved], velocity)
    for statistic, (_, error) in estimates:
        if statistic.event is not None:
            size = statistic.event(push)
            known = np.where(np.isfinite(size) & (number > 0.0), size, np.nan)
            error[moved] = np.hypot(error[moved], known)


def warn_of_still(plan: Plan, events: Events) -> None:
    """Warn of bodies that are moved by kicks alone, and too seldom for standard errors."""
    moved, number = events.moved, events.pushes[events.moved]
    if moved.size:
        stillest = int(np.argmin(number))
        warn(
            "rare_pushes",
            f"{len(moved)} oscillator(s) that only contacts or couplings move were pushed independently fewer than "
            f"{CLOSINGS} times in all realizations, too seldom for standard errors (NaN for none): "
            f"{plan.system.bodies[moved[stillest]]!r} about {number[stillest]:.2g} times. Run for longer, or use more "
            "realizations.",
        )


def warn_of_rare(plan: Plan, closings: np.ndarray) -> None:
    """Warn of contacts that closed, but too seldom for the standard errors of their statistics."""
    rare = np.flatnonzero((closings > 0.0) & (closings < CLOSINGS))
    if rare.size:
        rarest = rare[np.argmin(closings[rare])]
        needed = plan.clock.step * plan.clock.steps * CLOSINGS / closings[rarest]
        warn(
            "rare_contacts",
            f"{len(rare)} contact(s) closed fewer than {CLOSINGS} times in all, too seldom for standard errors: "
            f"{plan.system.contacts[rarest]!r} about {closings[rarest]:.2g} times. Run for {needed:.2g} s, or use more "
            "realizations.",
        )
