"""The integrator with its numbers for one network and step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.integrators.arguments import Cross, Events, Flows, Group, Tables
from impactlab.integrators.base import Integrator
from impactlab.integrators.driver import stepping
from impactlab.integrators.interval_arguments import Jumps, JumpTables, Work, Zeros
from impactlab.kernels.rows import KICK_ROWS, STATE_ROWS
from impactlab.plan.subdomains import Tile


@dataclass(frozen=True, eq=False)
class Method:
    """A method with its numbers."""

    integrator: Integrator
    step: Callable[..., None]  # the function that makes a step of the network
    coefficients: np.ndarray  # (phase, column, body) its numbers
    cross: Cross  # blocks of the linear motion between bodies
    flows: Flows | None  # what is between kicks

    jumps: ClassVar[Jumps | None] = None
    """How intervals in which nothing can touch are covered at once."""

    @classmethod
    def of(cls, model: Model, integrator: Integrator, step: float) -> Self:
        """Return a method for a model at a step (s)."""
        coefficients = np.ascontiguousarray(integrator.coefficients(model, step).transpose(0, 2, 1))
        linear = integrator.cross(model, step), integrator.flows(model, step)
        return cls(integrator, integrator.step_of(model), coefficients, *linear)

    @property
    def interval(self) -> int:
        """Steps that are made at once."""
        return 1

    def loop(self, single: bool, left_out: frozenset[str]) -> Callable[..., None]:
        """Return the compiled loop, for blocks or for those of one lane, without samples of some statistics."""
        return stepping(self.step, self.integrator.accepted, single, left_out)

    def tables(self, parameters: np.ndarray, indices: np.ndarray, events: Events) -> Tables | JumpTables:
        """Return the numbers that the loop takes, with those of the forces."""
        return Tables(parameters, indices, self.coefficients, self.cross, self.integrator.tableau(), *events)

    def work(self, rows: int, lanes: int, zeros: Zeros) -> np.ndarray | Work:
        """Return the work space of a block; `rows` are those of the noise of a step, `zeros` makes an array."""
        return zeros((self.integrator.blocks, self.coefficients.shape[-1] + 1, lanes))

    @property
    def groups(self) -> tuple[Group, ...]:
        """Bodies whose linear motion couplings connect."""
        return self.flows.groups if self.flows is not None else ()

    @property
    def grouped(self) -> np.ndarray:
        """Whether each body is in a group, (body,) of bool."""
        result = np.zeros(self.coefficients.shape[-1], dtype=bool)
        for group in self.groups:
            result[group.slots] = True
        return result

    @property
    def pairs(self) -> np.ndarray:
        """Slots of the pairs of bodies of each group, (pair, 2)."""
        pairs = [group.slots[np.stack(np.triu_indices(len(group.slots), 1), axis=1)] for group in self.groups]
        return np.concatenate([np.zeros((0, 2), dtype=np.int64), *pairs])

    def rows(self, varying: bool) -> int:
        """Rows of the sums over bodies that the loop makes; one more where forces are given or sums of cosines."""
        return KICK_ROWS + varying if self.integrator.kicks else STATE_ROWS

    def restricted(self, tile: Tile) -> Method:
        """Return the method for the bodies of a tile, which nothing but contacts connects."""
        return replace(self, coefficients=np.ascontiguousarray(self.coefficients[:, :, tile.bodies]))
