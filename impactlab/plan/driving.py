"""Sums of cosines, coloured noises and given forces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput, warn
from impactlab.integrators.arguments import Group
from impactlab.integrators.base import Integrator
from impactlab.linear.cosine_series import sample_count, sampling_seconds
from impactlab.linear.cosines import Lines, regular_lines
from impactlab.linear.laws import flowing_systems, lines_of, responses

if TYPE_CHECKING:
    from impactlab.plan.coloured import ColouredNoises


@dataclass(frozen=True, eq=False)
class Driving:
    """Forces between kicks that bodies respond to in a known way: functions of time, and coloured noises."""

    lines: tuple[Lines, ...]  # sums of cosines
    responses: tuple[tuple[np.ndarray, np.ndarray], ...]
    """What each of them moves; see `impactlab.linear.laws.responses`."""
    forced: np.ndarray  # (row,) slots of the bodies under given forces, once for each of them
    forces: np.ndarray  # (row,) which given force it is
    weights: np.ndarray  # (row,) factor of it
    coloured: ColouredNoises
    impacted: np.ndarray  # (body,) whether rigid contacts act between kicks

    @classmethod
    def of(cls, model: Model, coloured: ColouredNoises) -> Driving:
        """Return those of a model, with its coloured noises."""
        moved = responses(model, flowing_systems(model))
        number, body, weight = model.sources["force"].drives
        return cls(lines_of(model), moved, body, number, weight, coloured, model.impacted)

    def __bool__(self) -> bool:
        return bool(self.series or len(self.forced) or self.impacted.any())

    @property
    def series(self) -> bool:
        """Whether there are sums of cosines or coloured noises."""
        return bool(self.lines or self.coloured)

    def closed(self, groups: tuple[Group, ...]) -> np.ndarray:
        """Whether nothing but white noise acts between kicks on each body, nor on the others of its group, (body,)."""
        result = ~self.impacted
        result[[body for lines in self.lines for body in lines.bodies]] = False
        result[[*self.coloured.slots, *self.forced]] = False
        for group in groups:
            result[group.slots] = result[group.slots].all()
        return result

    def rows(self, integrator: Integrator) -> list[int]:
        """Rows of samples that a method takes of each sum of cosines."""
        return [(2 if integrator.takes_response else 1) * len(slots) for slots, _ in self.responses]

    @property
    def given(self) -> int:
        """Number of given forces."""
        return int(self.forces.max(initial=-1)) + 1

    def on_bodies(self, values: np.ndarray) -> np.ndarray:
        """Return what given forces, (n, force), are on the bodies, (n, row)."""
        return np.ascontiguousarray(values[:, self.forces] * self.weights)

    def nbytes(self, integrator: Integrator, step: float, steps: int, more: int = 0) -> int:
        """Bytes of the samples of a realization, and of some rows more."""
        if not self.lines:
            return self.coloured.nbytes
        return self.coloured.nbytes + 8 * (sum(self.rows(integrator)) + more) * sample_count(
            self.lines, *_samples(integrator, step, steps)
        )

    def seconds(self, integrator: Integrator, step: float, steps: int) -> float:
        """Time that sampling takes for a realization (s)."""
        return self.coloured.seconds * steps * integrator.samples_per_step + sum(
            rows * sampling_seconds(item, *_samples(integrator, step, steps))
            for rows, item in zip(self.rows(integrator), self.lines, strict=True)
        )


def _samples(integrator: Integrator, step: float, steps: int) -> tuple[float, int]:
    """Return the time between the samples of some steps (s), and their number."""
    return step / integrator.samples_per_step, steps * integrator.samples_per_step + 1


def check_periods(model: Model, total: float) -> float | None:
    """Return the period of the first series that repeats; refuse one that would repeat within the time of the run."""
    for name, excitation in model.excitations:
        if total > excitation.period * (1.0 + 1e-9):
            raise InvalidInput(
                f"The series of {name!r} repeats after {excitation.period:g} s, but the run with its spin-up takes "
                f"{total:g} s. Use more components, a shorter run, or allow_repeat=True."
            )
    for item in lines_of(model):
        regular = regular_lines(item.frequencies)
        if regular is not None:
            return regular[1]
    return None


def check_ends(model: Model, duration: float) -> None:
    """Refuse a run that goes beyond what is known of an excitation."""
    for name, excitation in model.excitations:
        end = excitation.known_until
        if duration > end * (1.0 + 1e-9):
            raise InvalidInput(
                f"The samples of {name!r} end at {end:g} s, {duration - end:g} s before the run "
                'does. Give a shorter duration=, or the excitation after="zero" or after="repeat".'
            )


def warn_of_bands(model: Model) -> None:
    """Warn of series that hardly excite their body: no line near its natural frequency."""
    for item in lines_of(model):
        for body in item.bodies:
            natural = math.sqrt(model.stiffness[body] / model.mass[body])
            if natural > 0.0 and not item.frequencies.min() <= natural <= item.frequencies.max():
                whose = "its natural frequency" if item.name in model.bodies else f"that of {model.bodies[body]!r},"
                warn(
                    f"The band of the excitation of {item.name!r} ({item.frequencies.min() / (2 * math.pi):g} to "
                    f"{item.frequencies.max() / (2 * math.pi):g} Hz) does not contain {whose} "
                    f"{natural / (2 * math.pi):g} Hz."
                )
