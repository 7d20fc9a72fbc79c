"""The integrator with its numbers for one network and step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impactlab.integrators.base import Cross, Flows, Group, Integrator
from impactlab.integrators.jumps import Jumps
from impactlab.kernels.sums import KICK_ROWS, STATE_ROWS
from impactlab.model import Model
from impactlab.plan.subdomains import Tile


@dataclass(frozen=True, eq=False)
class Method:
    """A method with its numbers.

    Attributes
    ----------
    integrator : Integrator
    coefficients : (phase, column, body) ndarray
        Its numbers.
    cross : Cross
        Blocks of the linear motion between bodies.
    flows : Flows or None
        What is between kicks.
    jumps : Jumps or None
        How intervals in which nothing can touch are covered at once.
    """

    integrator: Integrator
    coefficients: np.ndarray
    cross: Cross
    flows: Flows | None
    jumps: Jumps | None

    @classmethod
    def of(cls, model: Model, integrator: Integrator, step: float, jumps: Jumps | None) -> Method:
        """Return a method for a model at a step (s)."""
        coefficients = np.ascontiguousarray(integrator.coefficients(model, step).transpose(0, 2, 1))
        return cls(integrator, coefficients, integrator.cross(model, step), integrator.flows(model, step), jumps)

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
