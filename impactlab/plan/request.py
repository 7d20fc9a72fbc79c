"""The arguments of a run, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.inputs import finite, known_name, positive
from impactlab.integrators.base import Integrator, check_integrator
from impactlab.results.schema import wanted_names

if TYPE_CHECKING:
    from impactlab.records.record import Record


@dataclass(frozen=True, eq=False)
class Request:
    """The arguments of a run, within their ranges; see `impactlab.simulate`."""

    duration: float
    realizations: int
    step: float | None
    integrator: Integrator
    spin_up: float | None
    initial: Any
    records: Sequence[Record]
    seed: tuple[int, int]  # 128 bits
    workers: int = 1  # number of blocks that run at once
    coarse: bool = False
    """Whether this is the coarse run of a pair with common noise: each increment is the sum of two of the run at half
    the step.
    """
    longest_step: float = math.inf  # upper bound of the automatic step (s)
    mean_square_velocity: np.ndarray | None = None
    """(body,) mean square velocities measured before the run, infinite where they were not (m2 s-2). The automatic step
    may then exceed that of the rules, since its error is measured.
    """

    endless: bool = False  # whether the run may go on beyond the duration

    statistics: tuple[str, ...] | None = None
    """Names of the statistics to estimate; others need not be summed. None for all."""

    on_divergence: str = "keep"
    """Whether the other realizations go on where one diverges: "keep", or "raise"."""

    def __post_init__(self) -> None:
        known_name("on_divergence", self.on_divergence, ("keep", "raise"))
        object.__setattr__(self, "statistics", wanted_names(self.statistics))
        check_integrator(self.integrator)
        object.__setattr__(self, "duration", positive("duration", self.duration))
        whole = isinstance(self.realizations, int | np.integer) and not isinstance(self.realizations, bool)
        if not whole or not 1 <= self.realizations < 2**32:
            raise InvalidInput(f"realizations must be a whole number from 1 to 2^32 - 1, not {self.realizations!r}.")
        if self.spin_up is not None and finite("spin_up", self.spin_up) < 0.0:
            raise InvalidInput(f"spin_up must be at least 0 s, not {self.spin_up!r}.")
        if self.step is not None:
            object.__setattr__(self, "step", positive("step", self.step))

    @property
    def from_rest(self) -> bool:
        """Whether rest is asked for as the state at the start."""
        return isinstance(self.initial, str) and self.initial == "rest"

    def options(self) -> dict[str, Any]:
        """Return the options that reproduce the run, as stored with its result; none can name a file to write."""
        spin_up = 0.0 if self.from_rest and self.spin_up is None else self.spin_up
        options = {
            "duration": self.duration, "realizations": self.realizations, "step": self.step,
            "integrator": self.integrator.to_dict(), "spin_up": spin_up, "initial": self.initial,
            "record": [item.to_dict() for item in self.records], "seed": list(self.seed),
            **({} if self.statistics is None else {"statistics": list(self.statistics)}),
            **({"on_divergence": "raise"} if self.on_divergence == "raise" else {}),
        }  # fmt: skip
        return {name: _plain(item) for name, item in options.items()}

    def resolved(self, model: Model, spin_up: float) -> Self:
        """Return the request with records whose settings are all chosen for a model and a spin-up (s)."""
        for record in self.records:
            if record.needs_initial and self.initial is None:
                raise InvalidInput(
                    f"{type(record).__name__}: its result depends on the state at t = 0; give initial=, such as "
                    '"rest", "stationary" or {"displacement": {name: value}}.'
                )
        records = [record.resolved_for(model, -spin_up, self.duration) for record in self.records]
        return replace(self, records=records)

    def intervals(self) -> list[float]:
        """Return the sampling intervals that records prescribe, checked against each other and the duration (s)."""
        seen = set()
        for record in self.records:
            if record.identity in seen:
                raise InvalidInput(
                    f"Two records {' '.join(record.identity)} would have variables of the same names; keep one, or "
                    "repeat the run with the other and the same rng."
                )
            seen.add(record.identity)
        intervals = []
        for record in self.records:
            if (interval := record.exact_interval()) is not None:
                first = record.first_sample
                if first > self.duration * (1.0 + 1e-9):
                    raise InvalidInput(
                        f"{type(record).__name__}: start={first:g} s is after the end of the run at "
                        f"{self.duration:g} s; change one of them."
                    )
                if self.step and abs(math.remainder(first, self.step)) > 1e-6 * self.step:
                    raise InvalidInput(
                        f"{type(record).__name__}: start={first:g} s is not a whole number of steps of {self.step:g} "
                        "s; change one of them."
                    )
                early = abs(math.remainder(first, interval)) > 1e-9 * max(first, interval)
                intervals += [first % interval, interval] if early else [interval]
        if intervals and max(intervals) > self.duration * (1.0 + 1e-9):
            raise InvalidInput(
                f"A record asks for an interval of {max(intervals):g} s, longer than the duration of "
                f"{self.duration:g} s; change one of them."
            )
        return intervals


def _plain(value: Any) -> Any:
    """Return options as JSON can hold them, without numbers of NumPy."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value
