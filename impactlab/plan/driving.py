"""Sums of cosines, coloured noises and given forces."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.excitation import Excitation
from impactlab.errors import InvalidInput, warn
from impactlab.integrators.arguments import Coloured, Filters, Forced, Group, Shots
from impactlab.integrators.base import Integrator
from impactlab.kernels.random import addresses, fill_normals, streams_of
from impactlab.kernels.series import NEAR
from impactlab.linear.cosine_series import sample_count, sampling_seconds
from impactlab.linear.cosines import Lines, regular_lines
from impactlab.linear.laws import (
    coupled_systems,
    filter_labels,
    filtered_motions,
    flowing_systems,
    lines_of,
    responding,
    responses,
)
from impactlab.plan.filter_tables import tables_of_forces, tables_of_responses, tables_of_shots

MOST_TOGETHER = 500
"""Bodies that one noise may move together: it takes some seconds, and as the cube."""

BLOCKS = 3
"""Blocks of states that are kept, and of work space."""


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
    """Forces between kicks that bodies respond to in a known way: functions of time, and coloured noises."""

    lines: tuple[Lines, ...]  # sums of cosines
    responses: tuple[tuple[np.ndarray, np.ndarray], ...]
    """What each of them moves; see `impactlab.linear.laws.responses`."""
    forced: np.ndarray  # (row,) slots of the bodies under given forces, once for each of them
    forces: np.ndarray  # (row,) which given force it is
    weights: np.ndarray  # (row,) factor of it
    highest: np.ndarray  # (force,) angular frequency up to which each given force is a sum of cosines (rad s-1)
    coloured: ColouredNoises
    interrupted: np.ndarray  # (body,) whether rigid contacts or dry friction act between kicks
    motions: tuple[GivenMotion, ...] = ()  # given forces that are displacements of bodies of given motion

    @classmethod
    def of(cls, model: Model, coloured: ColouredNoises) -> Driving:
        """Return those of a model, with its coloured noises."""
        moved = responses(model, flowing_systems(model))
        given = model.sources["force"]
        number, body, weight = given.drives
        highest = np.array([item.highest_frequency for item in given.excitations], dtype=float)
        motions = [
            GivenMotion(int(slot), int(force), given.excitations[force], float(model.mass[slot]))
            for force, slot in zip(number, body, strict=True)
            if model.prescribed[slot]
        ]
        interrupted = model.interrupted
        return cls(lines_of(model), moved, body, number, weight, highest, coloured, interrupted, tuple(motions))

    def __bool__(self) -> bool:
        return bool(self.series or len(self.forced) or self.interrupted.any())

    @property
    def series(self) -> bool:
        """Whether there are sums of cosines or coloured noises."""
        return bool(self.lines or self.coloured)

    def closed(self, groups: tuple[Group, ...]) -> np.ndarray:
        """Whether nothing but white noise acts between kicks on each body, nor on the others of its group, (body,)."""
        result = ~self.interrupted
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
        return len(self.highest)

    def on_bodies(self, values: np.ndarray) -> Forced:
        """Return the given forces on bodies from their values, (n, force)."""
        return Forced(self.forced, self.forces, self.weights, np.ascontiguousarray(values))

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


class FilterStart(NamedTuple):
    """Where a filter, and what it moves, begin: a root of their covariance times normal numbers."""

    streams: np.ndarray  # (3, stream) addresses
    slots: np.ndarray  # (body,)
    states: slice  # of the filter among those of all
    root: np.ndarray  # (state and x and v, normal)
    mean: np.ndarray  # (x and v,) of the bodies

    def draw(self, realizations: np.ndarray, attempt: int) -> np.ndarray:
        """Return the states of the filter, displacements and velocities of some realizations, (row, lane)."""
        normals = np.empty((4, self.streams.shape[1], len(realizations)), dtype=np.float32)
        fill_normals(self.streams, realizations, np.uint64(attempt), normals)
        rows = normals.transpose(1, 0, 2).reshape(-1, len(realizations))
        # the same bits in any block, as a matrix product would not be
        result = np.asarray(sum(column[:, None] * row for column, row in zip(self.root.T, rows, strict=False)))
        if self.mean.any():
            result[-len(self.mean) :] += self.mean[:, None]
        return result


@dataclass(frozen=True, eq=False)
class ColouredNoises:
    """Filtered white noises and impulses on some bodies."""

    slots: np.ndarray  # (response or force,) bodies
    filters: Filters
    shots: Shots
    starts: tuple[FilterStart, ...]
    envelopes: int  # how many have one
    states: int  # of all filters
    labels: tuple[str, ...]  # names of the states

    @classmethod
    def of(
        cls, model: Model, integrator: Integrator, step: float, seed: tuple[int, int], coarse: bool
    ) -> ColouredNoises:
        """Return those of a model as a method takes them at a step (s); see `WhiteNoises` for a coarse run."""
        finer = 2 if coarse else 1
        if not (model.sources["filter"].names or model.sources["impulses"].names):
            return _silence(finer)
        interval = step / (finer * integrator.samples_per_step)
        motions = responding(model, flowing_systems(model))
        for motion in motions:
            if len(motion.slots) > MOST_TOGETHER:
                what = "The coloured noise" if motion.states else "The source of impulses"
                raise InvalidInput(
                    f"{what} {motion.name!r} moves {len(motion.slots)} bodies at a time; {MOST_TOGETHER} "
                    "is the most. Use several sources."
                )
        counts = [motion.states for motion in motions]
        modulated = np.array([motion.modulated for motion in motions], dtype=bool)
        envelope = np.where(modulated, np.cumsum(modulated) - 1, -1).tolist()
        if integrator.takes_response:
            slots, tables, normals = tables_of_responses(motions, envelope, interval)
        else:
            slots, tables, normals = tables_of_forces(
                filtered_motions(model, flowing_systems(model)), envelope, interval
            )
        names = [motion.name for motion, count in zip(motions, normals, strict=True) for _ in range(count)]
        numbers = [number for count in normals for number in range(count)]
        return cls(
            slots,
            tables._replace(streams=streams_of(seed, names, numbers), finer=finer),
            tables_of_shots(motions, interval, seed),
            _starts(model, counts, seed),
            int(modulated.sum()),
            sum(counts),
            tuple(filter_labels(model)),
        )

    def __bool__(self) -> bool:
        return bool(self.states or len(self.shots.begin) > 1)

    @property
    def time_varying(self) -> bool:
        """Whether one of them has an envelope."""
        return self.envelopes > 0

    @property
    def rows(self) -> int:
        """Rows of samples."""
        return max(len(self.filters.pairs), len(self.filters.envelopes))

    @property
    def nbytes(self) -> int:
        """Bytes that a realization takes."""
        rows = (NEAR + 1) * self.rows + BLOCKS * (len(self.filters.motion.begin) - 1 + self.states)
        return int(8 * (rows + self.shots.begin[-1]) + 16 * self.filters.streams.shape[1])

    @property
    def seconds(self) -> float:
        """Time that a sample takes for a realization, roughly (s)."""
        filters, shots = self.filters, self.shots
        matrices = filters.motion, filters.noise, filters.flow, filters.output, shots.response
        entries = sum(len(item.values) for item in matrices)
        return float(1e-9 * filters.finer * (entries + 4 * (filters.streams.shape[1] + shots.streams.shape[1])))

    def arrays(self, function: int, realizations: np.ndarray) -> Coloured:
        """Return what the loop takes for a block of some realizations; the states are to be set."""
        lanes, filters = len(realizations), self.filters
        rows = max(len(filters.motion.begin) - 1, self.states, self.rows)
        return Coloured(
            function=function,
            filters=filters,
            realizations=realizations,
            factors=np.zeros((0, BLOCKS, self.envelopes)),
            first=0,
            place=np.zeros(2, dtype=np.int64),
            kept=np.zeros((BLOCKS, self.states, lanes)),
            work=np.zeros((BLOCKS, rows, lanes)),
            normals=np.zeros((4, filters.streams.shape[1], lanes), dtype=np.float32),
            shots=self.shots,
            moments=np.zeros((self.shots.begin[-1], lanes)),
        )


@functools.cache
def _silence(finer: int) -> ColouredNoises:
    """Return what a network without such noises has."""
    slots, tables, _ = tables_of_responses((), (), 1.0)
    return ColouredNoises(slots, tables._replace(finer=finer), tables_of_shots((), 1.0, (0, 0)), (), 0, 0, ())


def _starts(model: Model, counts: Sequence[int], seed: tuple[int, int]) -> tuple[FilterStart, ...]:
    """Return where filters of so many states begin, and bodies that impulses move."""
    ends, result = np.cumsum(counts, dtype=int), []
    for motion, end in zip(responding(model, coupled_systems(model)), ends, strict=True):
        root = motion.start()
        streams = [addresses(seed, [motion.name], f"begin {number}") for number in range(-(-len(root) // 4))]
        states = slice(int(end) - motion.states, int(end))
        result.append(FilterStart(np.concatenate(streams, axis=1), motion.slots, states, root, motion.mean.ravel()))
    return tuple(result)


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
                    "noise_band",
                    f"The band of the excitation of {item.name!r} ({item.frequencies.min() / (2 * math.pi):g} to "
                    f"{item.frequencies.max() / (2 * math.pi):g} Hz) does not contain {whose} "
                    f"{natural / (2 * math.pi):g} Hz.",
                )
