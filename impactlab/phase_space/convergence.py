"""How accurate statistics are, from coarser grids and longer steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from impactlab.phase_space.propagator import Basis
from impactlab.phase_space.settings import LADDER, LONGER

Values = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Convergence:
    """Statistics, and those with one direction of the basis made coarser.

    Attributes
    ----------
    values : dict of str to ndarray
    coarser : dict of str to dict
        By the directions of `LADDER`.
    """

    values: Values
    coarser: dict[str, Values]

    @cached_property
    def errors(self) -> dict[str, Values]:
        """Errors of each direction of the basis, by name of the direction and the statistic.

        A quarter fewer nodes are taken to make the error at least three times as large for the gap, where the
        contact has a kink, and five times for the others; a longer step as much as three steps show,
        between the first and the fourth order.
        """
        result: dict[str, Values] = {}
        for direction in Basis._fields:
            share: Any = 0.5 if direction == "gap" else 0.25
            result[direction] = {}
            for name, value in self.values.items():
                change = np.abs(self.coarser[direction][name] - value)
                if direction == "step":
                    twice = np.abs(self.coarser[LADDER[-1]][name] - value)
                    with np.errstate(divide="ignore", invalid="ignore"):
                        ratio = np.nan_to_num(twice / change, nan=5.0, posinf=5.0)
                    share = 1.0 / np.clip(ratio - 2.0, LONGER - 1.0, 3.0)  # twice/change = 2^(p/2) + 1
                result[direction][name] = share * change
        return result

    @cached_property
    def total(self) -> Values:
        """Sum of the errors of all directions, by statistic."""
        return {name: np.sum([item[name] for item in self.errors.values()], axis=0) for name in self.values}

    def insufficient(self, tolerance: float, directions: Sequence[str]) -> list[str]:
        """Return those of some directions to refine, none if their errors are within the tolerance.

        The rate of contacts, which is read at a single place of the gap, is left out.
        """
        allowed = {name: tolerance * np.abs(value) for name, value in self.values.items() if name != "contact_rate"}

        def within(errors: Mapping[str, Any], share: float) -> bool:
            return all((errors[name] <= share * limit).all() for name, limit in allowed.items())

        together = {name: sum(self.errors[direction][name] for direction in directions) for name in allowed}
        if within(together, 1.0):
            return []
        return [name for name in directions if not within(self.errors[name], 1.0 / len(self.errors))]

    def summary(self) -> str:
        """Return the largest relative error of each direction, as text."""
        return ", ".join(
            f"{direction} {max(_largest(errors[name], self.values[name]) for name in errors):.1e}"
            for direction, errors in self.errors.items()
        )


def _largest(error: np.ndarray, value: np.ndarray) -> float:
    return float((error[value != 0.0] / np.abs(value[value != 0.0])).max(initial=0.0))
