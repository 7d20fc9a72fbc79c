"""A method that covers intervals in which nothing can touch at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from impactlab.integrators.arguments import Events
from impactlab.integrators.interval_arguments import Jumps, JumpTables, Work, Zeros, work_space
from impactlab.plan.method import Method


@dataclass(frozen=True, eq=False)
class JumpingMethod(Method):
    """A method that covers intervals in which nothing can touch at once."""

    jumps: Jumps  # type: ignore[misc]

    @property
    def interval(self) -> int:
        return self.jumps.steps

    def loop(self, single: bool, left_out: frozenset[str]) -> Callable[..., None]:
        from impactlab.integrators.jumps import jumping_loop  # loaded only here

        return jumping_loop(left_out)

    def tables(self, parameters: np.ndarray, indices: np.ndarray, events: Events) -> JumpTables:
        return JumpTables(parameters, indices, self.coefficients, self.jumps)

    def work(self, rows: int, lanes: int, zeros: Zeros) -> Work:
        return work_space(self.jumps, rows, self.coefficients.shape[-1], lanes, zeros)


def with_jumps(method: Method, jumps: Jumps | None) -> Method:
    """Return a method that covers some intervals at once, or itself if there are none."""
    if jumps is None:
        return method
    return JumpingMethod(method.integrator, method.step, method.coefficients, method.cross, method.flows, jumps)
