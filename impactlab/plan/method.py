"""The integrator with its numbers for one network and step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.integrators.arguments import Cross, Flows, Group, Tables
from impactlab.integrators.base import Integrator
from impactlab.integrators.driver import pays_for_one_lane, stepping
from impactlab.integrators.interval_arguments import Jumps, JumpTables, Work, Zeros
from impactlab.integrators.kicks import kick_share
from impactlab.kernels.rows import KICK_ROWS, STATE_ROWS
from impactlab.plan.subdomains import Tile, refuse_to_cut

LITTLE = 1e-3
"""Friction over a step up to which the first term of a series is exact to rounding of what it stands beside."""


@dataclass(frozen=True, eq=False)
class Method:
    """A method with its numbers."""

    integrator: Integrator
    step: Callable[..., None]  # the function that makes a step
    coefficients: np.ndarray  # (phase, column, body) its numbers
    cross: Cross  # blocks of the linear motion between bodies
    flows: Flows | None  # what is between kicks

    jumps: Jumps | None = None  # how intervals in which nothing can touch are covered at once
    interval: int = 1  # steps that are made at once
    groups: tuple[Group, ...] = field(init=False)  # bodies whose linear motion couplings connect
    grouped: np.ndarray = field(init=False)  # (body,) of bool, whether each is in a group
    pairs: np.ndarray = field(init=False)  # (pair, 2) slots of the pairs of bodies of each group

    def __post_init__(self) -> None:
        groups = self.flows.groups if self.flows is not None else ()
        grouped, pairs = np.zeros(self.coefficients.shape[-1], dtype=bool), [np.zeros((0, 2), dtype=np.int64)]
        for group in groups:
            grouped[group.slots] = True
            pairs.append(group.slots[np.stack(np.triu_indices(len(group.slots), 1), axis=1)])
        object.__setattr__(self, "groups", groups)
        object.__setattr__(self, "grouped", grouped)
        object.__setattr__(self, "pairs", np.concatenate(pairs))

    @classmethod
    def of(cls, model: Model, integrator: Integrator, step: float) -> Self:
        """Return a method for a model at a step (s)."""
        coefficients = np.ascontiguousarray(integrator.coefficients(model, step).transpose(0, 2, 1))
        linear = integrator.cross(model, step), integrator.flows(model, step)
        return cls(integrator, integrator.step, coefficients, *linear)

    def pays_for_one_lane(self, steps: float) -> bool:
        """Whether so many steps of bodies more are worth loops over the bodies of one realization."""
        return pays_for_one_lane(self.step, self.integrator.accepted, steps)

    def loop(self, single: bool, series: bool, points: bool) -> Callable[..., None]:
        """Return the compiled loop for blocks of lanes or of one lane, of a network that may have series and points."""
        return stepping(self.step, self.integrator.accepted, single, series, points)

    def tables(
        self, parameters: np.ndarray, indices: np.ndarray, events: np.ndarray, before: np.ndarray
    ) -> Tables | JumpTables:
        """Return the numbers that the loop takes, with those of the forces and of events within the flow."""
        return Tables(parameters, indices, self.coefficients, self.cross, self.integrator.tableau(), events, before)

    def work(self, rows: int, lanes: int, zeros: Zeros) -> np.ndarray | Work:
        """Return the work space of a block; `rows` are those of the noise of a step, `zeros` makes an array."""
        return zeros((self.integrator.blocks, self.coefficients.shape[-1] + 1, lanes))

    def rows(self, varying: bool) -> int:
        """Rows of the sums over bodies that the loop makes; one more where forces are given or sums of cosines."""
        return KICK_ROWS + varying if self.integrator.kicks else STATE_ROWS

    def late(self, linear: np.ndarray, step: float) -> np.ndarray:
        """Return the share of a force of kicks in velocities at which it seems to do work, (body,) (m s-1 N-1).

        See `impactlab.kernels.powers`. `linear` holds masses, damping and stiffness, (3, body), and `step` is in s.
        """
        mass, damping, _ = linear
        if not self.integrator.kicks:
            return np.zeros_like(mass)
        friction = damping * step / mass
        little = friction < LITTLE
        share = np.where(little, friction / 12.0, 0.5 - kick_share(friction, LITTLE))
        return np.asarray(share * step / mass)

    def restricted(self, tile: Tile) -> Method:
        """Return the method for the bodies of a tile, which nothing but contacts connects; else refuse."""
        refuse_to_cut(self, self.interval > 1 or bool(self.groups))
        coefficients, flows = np.ascontiguousarray(self.coefficients[:, :, tile.bodies]), self.flows
        if flows is not None:
            a, q, middle_a, middle_q = (item[:, tile.bodies] for item in flows[:-1])
            flows = Flows(a, q, middle_a, middle_q, ())
        return replace(self, coefficients=coefficients, flows=flows)
