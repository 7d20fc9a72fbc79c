"""The chain of steps of bodies whose linear motion is their own: kicks, and flows between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from impactlab.integrators.arguments import Flows
from impactlab.machine import ROWS_AT_A_TIME

Rows = np.ndarray | slice
"""A selection of bodies: a mask, or a slice that takes all."""


@dataclass(frozen=True, eq=False)
class Chain:
    """Steps of linear bodies."""

    step: float  # (s)
    mass: np.ndarray  # (body,)
    damping: np.ndarray  # (body,)
    stiffness: np.ndarray  # (body,)
    flows: Flows  # the linear motion between kicks
    alone: np.ndarray  # (body,) of bool: whether no coupling is a part of the flow of each body
    increment: np.ndarray = field(init=False)  # (body, 1) velocity that a unit force of a kick gives (m s-1 N-1)
    forgotten: np.ndarray = field(init=False)
    """(body,) of bool: whether friction makes bodies forget their velocities within a step."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "increment", self.step / self.mass[:, None])
        object.__setattr__(self, "forgotten", self.damping * self.step > 0.999 * self.mass)  # steps are often m/c

    def part(self, rows: slice) -> Chain:
        """Return the chain restricted to the chosen bodies."""
        a, q, middle_a, middle_q = (item[:, rows] for item in self.flows[:-1])
        mass, damping, stiffness, alone = (item[rows] for item in (self.mass, self.damping, self.stiffness, self.alone))
        return Chain(self.step, mass, damping, stiffness, Flows(a, q, middle_a, middle_q, self.flows.groups), alone)

    @cached_property
    def motions(self) -> np.ndarray:
        """Index of the motion of each body, (body,); bodies with equal coefficients share one."""
        flows = self.flows.transition.swapaxes(0, 1).reshape(len(self.mass), -1)
        table = np.column_stack([self.mass, self.damping, self.stiffness, flows])
        table = table[:, (table != table[:1]).any(axis=0)]
        if not table.size:
            return np.zeros(len(table), dtype=np.int64)
        text, width = table.tobytes(), table.itemsize * table.shape[1]
        numbers: dict[bytes, int] = {}
        rows = (text[begin : begin + width] for begin in range(0, len(text), width))
        return np.array([numbers.setdefault(row, len(numbers)) for row in rows], dtype=np.int64)

    def alike(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Return one representative row per distinct motion, and the index of each row's motion."""
        _, first, which = np.unique(self.motions[rows], return_index=True, return_inverse=True)
        return first, which

    def response(self) -> tuple[np.ndarray, np.ndarray]:
        """Return displacement and velocity under unit force: means over time, and at the kicks by phase of the force.

        These are (body, 2) and (body, 2, phase), NaN where there is no stationary mean.
        """
        a, increment, bodies = self.flows.transition, self.increment, len(self.mass)
        over_time, at_kicks = np.full((bodies, 2), np.nan), np.full((bodies, 2, len(a)), np.nan)
        held = rows_where(self.alone & (self.stiffness > 0.0))
        over_time[held, 0], over_time[held, 1] = 1.0 / self.stiffness[held], 0.0
        first, which = self.alike(held)
        push = increment[held][first]
        at_kicks[held] = cycle(a[:, held][:, first], np.stack([np.zeros_like(push), push], axis=1))[which]
        free = rows_where(self.alone & (self.stiffness == 0.0) & (self.damping > 0.0))
        over_time[free, 1] = 1.0 / self.damping[free]
        first, which = self.alike(free)
        at_kicks[free, 1] = cycle(a[:, free, 1:, 1:][:, first], increment[free, None][first])[which, 0]
        at_kicks[:, 1] += 0.5 * increment / len(a)  # the velocity is read in the middle of the kick
        return over_time, at_kicks


def rows_where(chosen: np.ndarray) -> Rows:
    """Return the bodies that are chosen; a slice where all are, which copies nothing."""
    return slice(None) if chosen.all() else chosen


def cycle(maps: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Solve ``z_p = L_p (z_q + B u_q)``, q the phase before p; return the mean of z per unit of each u.

    The maps L are (phase, body, n, n), the inputs B (body, n, m), and the means (body, n, phase m).
    """
    phases, bodies, size, _ = maps.shape
    columns = inputs.shape[2]
    result = np.empty((bodies, size, phases * columns))
    for begin in range(0, bodies, ROWS_AT_A_TIME):
        part = slice(begin, begin + ROWS_AT_A_TIME)
        system = np.tile(np.eye(phases * size), (len(inputs[part]), 1, 1))
        given = np.zeros((len(system), phases * size, phases * columns))
        for phase, matrices in enumerate(maps[:, part]):
            rows = slice(phase * size, (phase + 1) * size)
            last = (phase - 1) % phases
            system[:, rows, last * size : (last + 1) * size] -= matrices
            given[:, rows, last * columns : (last + 1) * columns] = matrices @ inputs[part]
        solved = np.linalg.solve(system, given)
        result[part] = solved.reshape(len(system), phases, size, -1).mean(axis=1)
    return result


def weighted_sum(weights: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Sum over the first axis; term by term, so that it does not depend on the number of units."""
    total: np.ndarray = sum(weight[..., None] * moment for weight, moment in zip(weights, moments, strict=True))
    return total


def mean_load(over_time: np.ndarray, at_kicks: np.ndarray, at_middle: np.ndarray) -> np.ndarray:
    """Return the correction to Simpson's rule for the square of a mean displacement whose time average is known.

    Where a static load holds a body away from 0, friction over a step changes Simpson's mean square by a small part of
    the square of the mean, which may be many times the variance. With the correction, the variance follows from
    Simpson's rule for the squares and for the squared means alike.
    """
    return np.asarray(over_time**2 - (at_kicks**2 + 2.0 * at_middle**2) / 3.0)
