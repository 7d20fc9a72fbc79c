"""The sums of a block, with the contributions of the states at both ends of a transient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from impactlab.errors import warn
from impactlab.integrators.arguments import State, Sums
from impactlab.kernels.rows import BEGUN, FLUX, INTENSITY, KICK_ROWS, SQUARES, TRANSIENT_ROWS
from impactlab.plan.events import Remarks, Times
from impactlab.plan.plan import Plan
from impactlab.results.losses import Loss
from impactlab.results.schema import BODY, CONTACT, sampled_of


@dataclass(frozen=True, eq=False)
class BlockResult:
    """What a block returns: sums per batch and realization, and what its records kept."""

    bodies: np.ndarray  # (batch, phase, row, body, lane)
    contacts: np.ndarray  # (batch, row, contact, lane)
    products: np.ndarray  # (batch, row, pair, lane)
    points: np.ndarray  # (batch, phase, row, point, lane)
    laws: np.ndarray  # (batch, row, state, lane)
    events: tuple[np.ndarray, ...]  # what each mechanism that locates events has noted, (…, lane)
    records: list[dict[str, np.ndarray]] = field(default_factory=list)  # one dictionary of arrays per record
    lost: frozenset[int] = frozenset()  # of networks side by side, those that left the range of finite numbers
    losses: tuple[Loss, ...] = ()  # realizations that left it, of which nothing else is here

    def __post_init__(self) -> None:
        object.__setattr__(self, "losses", tuple(Loss(*row) for row in self.losses))  # as plain data from a file

    @classmethod
    def without_realizations(cls, losses: tuple[Loss, ...]) -> BlockResult:
        """Return the result of a block all of whose realizations were lost."""
        none = np.zeros(0)
        return cls(none, none, none, none, none, (), losses=losses)

    @property
    def empty(self) -> bool:
        """Whether there are no realizations."""
        return not self.events and not self.records and not self.bodies.size


class Edge(NamedTuple):
    """The contribution of the state at one moment to each of the sums."""

    bodies: np.ndarray  # (row, body, lane)
    contacts: np.ndarray  # (row, contact, lane)
    products: np.ndarray  # (row, pair, lane)
    samples: np.ndarray  # (row, body, lane)
    points: np.ndarray  # (row, point, lane), those of squares


def edge_of(plan: Plan, state: State, sums: Sums, phase: int) -> Edge:
    """Return the contribution of the state after a kick of the given phase to the sums."""
    mass = plan.system.linear[0][:, None]
    x, f = state.x[:-1], state.total[:-1]
    v = state.v[:-1] - 0.5 * plan.clock.step / mass * f if plan.method.integrator.kicks else state.v[:-1]
    bodies = np.array([x, v, x * x, x * v, v * v, f, f * f, f * x, f * v])
    contacts, samples = np.zeros_like(sums.contacts), np.zeros_like(sums.samples)
    indentation = plan.system.ends.gap(state.reading) - plan.system.clearance[:, None]
    for rows, dimension, quantities in (
        (contacts[FLUX + 1 :], CONTACT, (indentation, state.contact_force)),
        (samples, BODY, (x, v)),
    ):
        for row, statistic in zip(rows, sampled_of(dimension), strict=True):
            if not statistic.largest:
                row[:] = statistic.sample(*quantities)
    contacts[:, plan.events.impulsive] = 0.0  # impulse and rest are those of a whole step
    products = np.zeros_like(sums.products)
    if products.size:
        i, j = sums.pairs.T
        products[:] = [one[i] * other[j] for one in (x, v, f) for other in (x, v, f)]
    return Edge(bodies, contacts, products, samples, plan.points.squares(phase, x, v, f))


def with_samples(bodies: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Return sums over bodies with the sums of sampled statistics as further rows, all in the first phase."""
    if not len(samples):
        return bodies
    rows = np.zeros((len(bodies), *samples.shape))
    rows[0] = samples
    return np.concatenate([bodies, rows], axis=1)


def over_time(
    plan: Plan, sums: Sums, intensity: np.ndarray, begin: int, end: int, first: Edge, last: Edge
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the sums of a section of a transient: integrals over time by the trapezoidal rule.

    Sums over kicks so far include the kick at the end of each step; other sums include the state at its beginning. The
    rule adds half of the state at one end of the section, and subtracts half of the state at the other.
    """
    kicks, phases = plan.method.integrator.kicks, plan.method.integrator.phases
    half = [0.5 * (one - other if kicks else other - one) for one, other in zip(first, last, strict=True)]
    bodies = np.zeros((phases, TRANSIENT_ROWS if kicks else plan.rows, *sums.bodies.shape[2:]))
    bodies[:, : plan.rows] = sums.bodies
    count = KICK_ROWS if kicks else plan.rows
    bodies[0, :count] += half[0][:count]
    products = sums.products + half[2]
    if kicks:
        # the flow of each step begins at the kick before, of the phase before
        bodies[1:, BEGUN:INTENSITY], bodies[0, BEGUN:INTENSITY] = sums.bodies[:-1, :count], sums.bodies[-1, :count]
        bodies[(plan.clock.spin_up_steps + begin) % phases, BEGUN:INTENSITY] += first.bodies
        bodies[(plan.clock.spin_up_steps + end) % phases, BEGUN:INTENSITY] -= last.bodies
        bodies[:, INTENSITY] = plan.counts(begin, end)[:, None, None]
        if plan.noise.time_varying:
            bodies[:, INTENSITY, plan.noise.white] = intensity[..., None]
        products = np.concatenate([products, sums.products + first.products - last.products])
    points = sums.points.sums.copy()
    if plan.points.labels:
        before = plan.clock.spin_up_steps - 1
        between = np.stack([np.zeros_like(plan.points.closed)] * 2 + [plan.points.closed] * 2)[..., None]
        points[0, SQUARES] += ~between * half[4]
        points[(before + begin) % phases, SQUARES] += between * first.points
        points[(before + end) % phases, SQUARES] -= between * last.points
    return with_samples(bodies, sums.samples + half[3]), sums.contacts + half[1], products, points


def remarks_on_events(plan: Plan, noted: Sequence[Sequence[np.ndarray]], rates: bool = True) -> Remarks:
    """Return remarks on the events of a run, from the notes of its blocks, and warn.

    Remarks on rates of contacts are made where the rates are wanted.
    """
    remarks = plan.events.remarks(noted, plan.system.contacts, Times(plan.clock.step, plan.clock.spin_up_steps), rates)
    for kind, message in remarks.warnings:
        warn(kind, message)
    return remarks


def merged(results: list[BlockResult]) -> tuple[np.ndarray, ...]:
    """Join the sums of all blocks over bodies, contacts, pairs, points and laws along the realizations, in order."""
    sums = [(result.bodies, result.contacts, result.products, result.points, result.laws) for result in results]
    return sums[0] if len(sums) == 1 else tuple(np.concatenate(kind, axis=-1) for kind in zip(*sums, strict=True))
