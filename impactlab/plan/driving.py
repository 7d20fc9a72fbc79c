"""Sums of cosines, processes and given forces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from impactlab.assembly.mechanism import interrupted
from impactlab.assembly.model import Model
from impactlab.components.excitation import Excitation
from impactlab.errors import InvalidInput, warn
from impactlab.integrators.arguments import Forced, Group
from impactlab.integrators.base import Integrator
from impactlab.linear.cosine_series import sample_count, sampling_seconds
from impactlab.linear.laws import flowing_systems, lines_of, responses
from impactlab.linear.spectral_lines import Lines, regular_lines
from impactlab.plan.processes import Processes
from impactlab.plan.subdomains import Tile, refuse_to_cut


class GivenMotion(NamedTuple):
    """The motion of a body that is given."""

    slot: int
    force: int  # number of its displacement among the given forces
    displacement: Excitation
    mass: float  # (kg)

    def pushes(self, x: np.ndarray, v: np.ndarray, step: float) -> np.ndarray:
        """Return mean and slope of the force that moves the free body so in some steps, in turn, (2 step,).

        Displacements and velocities are those at the ends of all steps.
        """
        mean = np.diff(v) / step
        slope = 3.0 * mean - 6.0 * (np.diff(x) - step * v[:-1]) / step**2
        return self.mass * np.stack([mean, slope], axis=1).ravel()


@dataclass(frozen=True, eq=False)
class Driving:
    """Forces between kicks that bodies respond to in a known way: functions of time, and processes."""

    lines: tuple[Lines, ...]  # sums of cosines
    responses: tuple[tuple[np.ndarray, np.ndarray], ...]
    """The response to each sum of cosines; see `impactlab.linear.laws.responses`."""
    forced: np.ndarray  # (row,) slots of the bodies under given forces, once for each of them
    forces: np.ndarray  # (row,) which given force it is
    weights: np.ndarray  # (row,) factor of it
    highest: np.ndarray  # (force,) angular frequency up to which each given force is a sum of cosines (rad s-1)
    processes: Processes  # such as filtered noises
    interrupted: np.ndarray  # (body,) whether events are located between kicks
    sets: int = 1  # of given forces, independent of each other: those of networks side by side
    motions: tuple[GivenMotion, ...] = ()  # given forces that are displacements of bodies of given motion

    @classmethod
    def of(cls, model: Model, integrator: Integrator, step: float, seed: tuple[int, int], coarse: bool) -> Driving:
        """Return the driving of a model for a method and a step (s), and warn of bands that hardly excite it.

        See `WhiteNoises` for a coarse run.
        """
        lines, finer = lines_of(model), 2 if coarse else 1
        _warn_of_bands(model, lines)
        parts = [item.process(model, integrator, step, seed, finer) for item in model.mechanisms]
        processes = Processes(tuple(part for part in parts if part is not None), finer)
        moved = responses(model, flowing_systems(model)) if lines else ()
        given = model.sources["force"]
        number, body, weight = given.drives
        highest = np.array([item.highest_frequency for item in given.excitations], dtype=float)
        motions = [
            GivenMotion(int(slot), int(force), given.excitations[force], float(model.mass[slot]))
            for force, slot in zip(number, body, strict=True)
            if not model.bodies.free[slot]
        ]
        return cls(lines, moved, body, number, weight, highest, processes, interrupted(model), motions=tuple(motions))

    def __bool__(self) -> bool:
        return bool(self.series or len(self.forced) or self.interrupted.any())

    @property
    def series(self) -> bool:
        """Whether there are sums of cosines or processes."""
        return bool(self.lines or self.processes.parts)

    def closed(self, groups: tuple[Group, ...]) -> np.ndarray:
        """Whether nothing but white noise acts between kicks on each body, nor on the others of its group, (body,)."""
        result = ~self.interrupted
        result[[body for lines in self.lines for body in lines.bodies]] = False
        result[[*self.processes.slots, *self.forced]] = False
        for group in groups:
            result[group.slots] = result[group.slots].all()
        return result

    def rows(self, integrator: Integrator) -> list[int]:
        """Rows of samples that a method reads for each sum of cosines."""
        return [(2 if integrator.takes_response else 1) * len(slots) for slots, _ in self.responses]

    @property
    def given(self) -> int:
        """Number of given forces."""
        return len(self.highest)

    def on_bodies(self, values: np.ndarray) -> Forced:
        """Return the given forces on bodies from their values, (n, force)."""
        return Forced(self.forced, self.forces, self.weights, np.ascontiguousarray(values))

    def restricted(self, tile: Tile) -> Driving:
        """Return nothing for the bodies of a tile where nothing acts between kicks; else refuse."""
        refuse_to_cut(self, bool(self))
        return replace(self, interrupted=self.interrupted[tile.bodies])

    def nbytes(self, integrator: Integrator, step: float, steps: int, more: int = 0) -> int:
        """Bytes of the samples of a realization, with `more` rows added."""
        if not self.lines:
            return self.processes.nbytes
        return self.processes.nbytes + 8 * (sum(self.rows(integrator)) + more) * sample_count(
            self.lines, *_samples(integrator, step, steps)
        )

    def seconds(self, integrator: Integrator, step: float, steps: int) -> float:
        """Time that sampling takes for a realization (s)."""
        return self.processes.seconds * steps * integrator.samples_per_step + sum(
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


def _warn_of_bands(model: Model, lines: Sequence[Lines]) -> None:
    """Warn of series that hardly excite their body: no line near its natural frequency."""
    for item in lines:
        for body in item.bodies:
            natural = math.sqrt(model.stiffness[body] / model.mass[body])
            if natural > 0.0 and not item.frequencies.min() <= natural <= item.frequencies.max():
                names = model.bodies.names
                whose = "its natural frequency" if item.name in names else f"that of {names[body]!r},"
                warn(
                    "noise_band",
                    f"The band of the excitation of {item.name!r} ({item.frequencies.min() / (2 * math.pi):g} to "
                    f"{item.frequencies.max() / (2 * math.pi):g} Hz) does not contain {whose} "
                    f"{natural / (2 * math.pi):g} Hz. Give a wider one, unless this is meant.",
                )
