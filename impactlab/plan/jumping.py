"""A method that covers intervals in which nothing can touch at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from impactlab.integrators.interval_arguments import Jumps, JumpTables, Work, Zeros, work_space
from impactlab.plan.method import Method


@dataclass(frozen=True, eq=False)
class JumpingMethod(Method):
    """A method that covers intervals in which nothing can touch at once."""

    jumps: Jumps

    def loop(self, single: bool, series: bool, points: bool) -> Callable[..., None]:
        from impactlab.integrators.jumps import jumping_loop  # loaded only here

        return jumping_loop()

    def tables(self, parameters: np.ndarray, indices: np.ndarray, events: np.ndarray, before: np.ndarray) -> JumpTables:
        return JumpTables(parameters, indices, self.coefficients, self.jumps)

    def work(self, rows: int, lanes: int, zeros: Zeros) -> Work:
        return work_space(self.jumps, rows, self.coefficients.shape[-1], lanes, zeros)


def with_jumps(method: Method, jumps: Jumps) -> Method:
    """Return a method that covers some intervals at once."""
    linear = method.coefficients, method.cross, method.flows
    return JumpingMethod(method.integrator, method.step, *linear, jumps, jumps.steps)
