"""Points of structures: weighted sums of bodies, and the sums for their mean squares.

The mean at a point is the weighted sum of the means of its bodies. Its mean squares need all products of two bodies,
that is the square of the sum: so the loop adds up, whenever it reads the bodies, the squares of four weighted sums of
their displacements, velocities and forces. Two are the displacement and the velocity of the point. Where nothing but
white noise acts between kicks, the other two are both quantities in the middle of the next flow, without its noise;
elsewhere they are the displacement to which the mean over a step is shifted, and the velocity given by the kick. The
formulas are the formulas of a body in `impactlab.statistics.moments`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlab.assembly.links import Combinations, Links, Pairs
from impactlab.assembly.model import Model
from impactlab.integrators.arguments import Flows, Group, PointSums
from impactlab.integrators.interval_arguments import Zeros
from impactlab.integrators.kicks import kick_share
from impactlab.kernels.points import COLUMNS
from impactlab.kernels.rows import POINT_ROWS
from impactlab.linear.transitions import system_transition, transition
from impactlab.plan.subdomains import Tile, refuse_to_cut
from impactlab.quadrature import mean_rule

PLACE, SPEED, BETWEEN, SECOND = slice(0, 1), slice(1, 3), slice(3, 6), slice(6, 9)
"""Columns of the weights: displacement, velocity, and the two mid-flow quantities."""

_QUANTITIES = {0: slice(0, 1), 1: slice(1, 3), 3: slice(0, 3), 6: slice(0, 3)}
"""Which of displacement, velocity and force they are the weights of, by the first column."""


@dataclass(frozen=True, eq=False)
class Points:
    """The points of all structures of a network."""

    labels: tuple[tuple[str, tuple[tuple[int, float], ...]], ...]  # their names, and slots and weights of bodies
    shares: Links  # the same, of all points
    begin: np.ndarray  # (point + 1,) where the entries of each begin
    bodies: np.ndarray  # (entry,) slots
    weights: np.ndarray  # (phase, column, entry) as `impactlab.kernels.points` takes them, by the phase of the kick
    noise: np.ndarray  # (phase, 2, point) what noise adds to both mean squares in the middle, by the phase of the flow
    closed: np.ndarray  # (point,) of bool: whether nothing but white noise acts on its bodies between kicks

    @classmethod
    def of(cls, model: Model, flows: Flows | None, phases: int, closed_bodies: np.ndarray, step: float) -> Points:
        """Return the points of a model as a method with some flows, in phases, sees them at a step (s).

        The bodies say whether nothing but white noise acts on them between kicks, (body,) of bool.
        """
        if not model.network.points:
            none = np.zeros((0, 2), dtype=np.int64)
            nothing = np.zeros((phases, COLUMNS, 0)), np.zeros((phases, 2, 0)), np.zeros(0, dtype=bool)
            return cls((), Pairs(len(model.bodies), none), np.zeros(1, dtype=np.int64), none.ravel(), *nothing)
        groups = () if flows is None else flows.groups
        shares = Combinations.of([dict(row) for _, row in model.points], len(model.bodies))
        closed = shares.all(closed_bodies) & (flows is not None)
        alike: dict[tuple[int, ...], list[int]] = {}  # points that are read from the same bodies
        for point in range(len(shares)):
            own = set(shares.chosen(np.array([point])).slots.tolist())
            joint = [set(group.slots.tolist()) for group in groups if closed[point]]
            whole = own.union(*(slots for slots in joint if not slots.isdisjoint(own)))
            alike.setdefault(tuple(sorted(whole)), []).append(point)
        bodies, noise = [np.zeros(0, dtype=np.int64)] * len(shares), np.zeros((len(shares), phases, 2))
        weights = [np.zeros((phases, COLUMNS, 0))] * len(shares)
        for slots, some in alike.items():
            place = np.array(slots)
            for known in np.unique(closed[some]):
                points = [point for point in some if closed[point] == known]
                part = shares.chosen(np.array(points)).matrix(place)
                both = (
                    _between(model, flows, step, place, part) if known else _at_kicks(model, phases, step, place, part)
                )
                for point, columns, of_noise in zip(points, *both, strict=True):
                    bodies[point], weights[point], noise[point] = place, columns, of_noise
        return cls(
            model.points,
            shares,
            np.cumsum([0, *map(len, bodies)]),
            np.concatenate(bodies),
            np.concatenate(weights, axis=2),
            noise.transpose(1, 2, 0),
            closed,
        )

    def restricted(self, tile: Tile) -> Points:
        """Return itself where there are no points; else refuse."""
        refuse_to_cut(self, len(self.labels) > 0)
        return self

    def sums(self, lanes: int, zeros: Zeros) -> PointSums:
        """Return the sums of a block of `lanes` lanes; `zeros` makes an array."""
        sums = zeros((len(self.weights), POINT_ROWS, len(self.labels), lanes))
        return PointSums(self.begin, self.bodies, np.ascontiguousarray(self.weights), sums, zeros((4, lanes)))

    def read(self, phase: int, columns: slice, x: np.ndarray, v: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Return sums at every point with some columns of weights, (point, n), of bodies at a kick, (body, n) each."""
        if not self.labels:
            return x[:0]
        weights = zip(self.weights[phase, columns], (x, v, force)[_QUANTITIES[columns.start]], strict=True)
        terms = sum(row[:, None] * item[self.bodies] for row, item in weights)
        return np.asarray(np.add.reduceat(terms, self.begin[:-1], axis=0))

    def squares(self, phase: int, x: np.ndarray, v: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Return the squares that the loop adds up, (4, point, …), of bodies at a kick of a phase, (body, …) each."""
        return np.array([self.read(phase, item, x, v, force) ** 2 for item in (PLACE, SPEED, BETWEEN, SECOND)])


Part = tuple[np.ndarray, np.ndarray]
"""Weights of bodies that are read for some points, (point, phase, column, body), and the noise, (point, phase, 2)."""


def _at_kicks(model: Model, phases: int, step: float, bodies: np.ndarray, own: np.ndarray) -> Part:
    """Return how points are read where more than white noise acts between kicks, whose shares are (point, body)."""
    gain, columns = step / model.mass[bodies], np.zeros((len(own), phases, COLUMNS, len(bodies)))
    columns[:, :, [0, 1, 3]] = own[:, None, None]
    columns[:, :, 5], columns[:, :, 8] = step / 12.0 * (gain * own)[:, None], (gain * own)[:, None]
    return columns, np.zeros((len(own), phases, 2))


def _between(model: Model, flows: Flows | None, step: float, bodies: np.ndarray, own: np.ndarray) -> Part:
    """Return how points are read where nothing but white noise acts between kicks, whose shares are (point, body)."""
    assert flows is not None
    groups = [group for group in flows.groups if np.isin(group.slots, bodies).all()]
    middle = np.moveaxis(flows.middle_transition[:, bodies], 1, -1) * own[:, None, None, None]  # (…, phase, 2, 2, body)
    noise = np.einsum("pbrr,nb->nprb", flows.middle_covariance[:, bodies], own**2)
    for group in groups:
        place, count = np.searchsorted(bodies, group.slots), len(group.slots)
        joint, covariance = (
            item.reshape(2, count, 2, count) for item in (group.middle_transition, group.middle_covariance)
        )
        middle[..., place] = np.einsum("ni,ripj->nrpj", own[:, place], joint)[:, None]
        noise[..., place] = 0.0
        noise[..., place[0]] = np.einsum("ni,rirj,nj->nr", own[:, place], covariance, own[:, place])[:, None]
    noise = noise.sum(axis=-1)
    if model.sources["intensity"].beyond_own:
        noise += _common_noise(model, groups, bodies, own, step)[:, None]
    half, together = 0.5 * step / model.mass[bodies], [slot for group in groups for slot in group.slots.tolist()]
    friction = model.damping[bodies] / model.mass[bodies] * step * ~np.isin(bodies, together)
    middle = np.roll(middle, -1, axis=1)  # the flow that follows a kick is that of the next phase
    columns = np.zeros((len(own), middle.shape[1], COLUMNS, len(bodies)))
    columns[:, :, [0, 1]] = own[:, None, None]
    columns[:, :, 2] = (2.0 * half * (kick_share(friction) - 0.5) * own)[:, None]
    for row, first in enumerate((BETWEEN.start, SECOND.start)):
        by_x, by_v = middle[:, :, row, 0], middle[:, :, row, 1]
        columns[:, :, first], columns[:, :, first + 1], columns[:, :, first + 2] = by_x, by_v, half * by_v
    return columns, noise


def _common_noise(model: Model, groups: list[Group], bodies: np.ndarray, own: np.ndarray, step: float) -> np.ndarray:
    """Return the contribution of a noise on several bodies to both mean squares in the middle of a flow, (point, 2).

    It is the exact covariance between bodies that move alone or in different groups. Where friction and noise act at
    Gauss's nodes, the mean over both phases differs in the fourth order.
    """
    # in half a step a mode turns by little more than one radian, which six nodes integrate
    nodes, shares = mean_rule(6)
    intensity, parts = model.noise.matrix(bodies), np.arange(len(bodies))
    for number, group in enumerate(groups, len(bodies)):
        parts[np.searchsorted(bodies, group.slots)] = number
    intensity[parts[:, None] == parts] = 0.0
    still, result = np.zeros(len(bodies)), np.zeros((len(own), 2))
    linear = model.mass[bodies], model.damping[bodies], model.stiffness[bodies]
    for node, share in zip(nodes.tolist(), shares.tolist(), strict=True):
        time = 0.5 * step * node
        alone = transition(*linear, still, time)[0][:, :, 1].T / linear[0]  # (2, body)
        response = alone * own[:, None]
        for group in groups:
            place, system = np.searchsorted(bodies, group.slots), group.system
            matrices = system.mass, system.damping, system.stiffness, np.zeros_like(system.intensity)
            count = len(place)
            flow = system_transition(*matrices, time, sum(system.scales))[0].reshape(2, count, 2, count)
            response[..., place] = np.einsum("ni,rij->nrj", own[:, place], flow[:, :, 1]) / system.mass
        result += 0.5 * step * share * 2.0 * np.pi * ((response @ intensity) * response).sum(axis=-1)
    return result
