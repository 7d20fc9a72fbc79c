"""Impulses at random times: which networks have them, and their part of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from impactlab.assembly.mechanism import Method, Mode
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.kernels.random import addresses
from impactlab.kernels.series import NEAR
from impactlab.linear.laws import coupled_systems, flowing_systems, moved_by
from impactlab.linear.systems import LinearSystem
from impactlab.mechanisms.excitations import Excitations
from impactlab.mechanisms.impulses.impulsive_motion import ImpulsiveMotion, impulses_of
from impactlab.mechanisms.impulses.moments_of_impulses import Impulsive, Shots, bring_impulses, fill_moments
from impactlab.mechanisms.noise_processes import DrawnStart, check_together, pairs_of, responding, sparse
from impactlab.plan.processes import Draws, ProcessPart


class Impulses(Excitations):
    """Impulses at random times."""

    name = "impulses"
    kind = "impulses"
    modes = frozenset({Mode.ONE_LANE, Mode.FORCES})

    def motions(
        self, model: Model, systems: tuple[tuple[np.ndarray, LinearSystem], ...]
    ) -> tuple[ImpulsiveMotion, ...]:
        return tuple(
            ImpulsiveMotion(name, excitation, impulses_of(excitation), *moved)
            for name, excitation, moved in moved_by(model, self.kind, systems)
        )

    def density(self, model: Model, frequency: float) -> np.ndarray:
        sources = model.sources[self.kind]
        own = [impulses_of(item).density for item in sources.excitations]
        return sources.added(np.array(own), len(model.bodies))

    def sudden_energies(self, model: Model, begin: float, end: float) -> np.ndarray:
        sources, result = model.sources[self.kind], np.zeros(len(model.bodies))
        number, body, weight = sources.drives
        large = np.array(
            [impulses_of(item).large * item.largest_modulation for item in sources.excitations], dtype=float
        )
        np.maximum.at(result, body, (weight * large[number]) ** 2 / model.mass[body])
        return result

    def process(
        self, model: Model, method: Method, step: float, seed: tuple[int, int], finer: int
    ) -> ProcessOfImpulses:
        motions = self.motions(model, flowing_systems(model))
        check_together(motions)
        starts = tuple(DrawnStart.of(motion, 0, seed) for motion in self.motions(model, coupled_systems(model)))
        shots = _shots(motions, step / (finer * method.samples_per_step), seed, finer)
        pushes = np.zeros((len(motions), len(model.bodies)))
        for row, motion in zip(pushes, motions, strict=True):
            row[motion.slots] = motion.weights / motion.system.mass
        modulated = sum(motion.modulated for motion in motions)
        return ProcessOfImpulses(responding(motions), shots, starts, modulated, pushes)


def _shots(motions: tuple[ImpulsiveMotion, ...], interval: float, seed: tuple[int, int], finer: int) -> Shots:
    """Return impulses, and what they do in the time of a sample (s), as the loop takes them."""
    flows, responses = zip(*(motion.steps(interval) for motion in motions), strict=True)
    names = [motion.name for motion in motions]
    streams = [addresses(seed, names, purpose) for purpose in ("impulses", "impulse sizes")]
    numbers = [(item.rate * interval, item.mean, item.deviation) for item in (motion.impulses for motion in motions)]
    return Shots(
        response=sparse(responses),
        flow=sparse(flows),
        pairs=pairs_of(motions),
        begin=np.cumsum([0, *(response.shape[1] for response in responses if response.shape[1])]),
        numbers=np.array(numbers).T.copy(),
        streams=np.concatenate(streams, axis=1),
        finer=finer,
    )


@dataclass(frozen=True, eq=False)
class ProcessOfImpulses(ProcessPart):
    """Impulses on some bodies: a process without states."""

    record: ClassVar[type] = Impulsive
    bring = staticmethod(bring_impulses)

    slots: np.ndarray  # (response,) bodies
    shots: Shots
    starts: tuple[DrawnStart, ...]
    envelopes: int  # how many have one
    by_impulses: np.ndarray  # (source, body) velocity by a unit of its impulses

    @property
    def pushes(self) -> np.ndarray:
        return self.by_impulses

    def jumps(self, realizations: np.ndarray, first: int, number: int) -> np.ndarray:
        if self.envelopes:
            raise InvalidInput("FirstPassage follows no impulses with an envelope on the bodies that it limits.")
        shots, finer, lanes = self.shots, self.shots.finer, len(realizations)
        result, moments = np.zeros((2, number, self.pushes.shape[1], lanes)), np.zeros((shots.begin[-1], lanes))
        for sample in range(number * finer):
            fill_moments(shots, realizations, first * finer + sample, moments)
            sizes, times = moments[shots.begin[:-1]], moments[shots.begin[:-1] + 1]
            left = (finer - 1 - sample % finer + 0.5) * sizes - 0.5 * times
            result[0, sample // finer] += self.pushes.T @ sizes
            result[1, sample // finer] += self.pushes.T @ left / finer
        return result

    @property
    def rows(self) -> int:
        return len(self.shots.pairs)

    @property
    def nbytes(self) -> int:
        return int(8 * ((NEAR + 2) * self.rows + len(self.shots.response.begin) - 1 + self.shots.begin[-1]))

    @property
    def seconds(self) -> float:
        shots = self.shots
        entries = len(shots.flow.values) + len(shots.response.values)
        return float(1e-9 * shots.finer * (entries + 4 * shots.streams.shape[1]))

    def arrays(self, realizations: np.ndarray) -> Impulsive:
        lanes, shots = len(realizations), self.shots
        return Impulsive(
            shots=shots,
            realizations=realizations,
            factors=np.zeros((0, 3, self.envelopes)),
            first=0,
            place=np.zeros(2, dtype=np.int64),
            moments=np.zeros((shots.begin[-1], lanes)),
            moved=np.zeros((len(shots.response.begin) - 1, lanes)),
            ahead=np.zeros((self.rows, lanes)),
            near=np.zeros((0, 0, lanes)),
            row=0,
        )

    def draw(
        self, arrays: Impulsive, lanes: np.ndarray, realizations: np.ndarray, attempt: int, given: np.ndarray | None
    ) -> Draws:
        both = ((start.slots, start.draw(realizations, attempt)) for start in self.starts)
        return [(slots, rows.reshape(2, -1, len(lanes))) for slots, rows in both]

    def end(self, arrays: Impulsive, sample: int) -> np.ndarray:
        return np.zeros((0, len(arrays.realizations)))

    def place(self, arrays: Impulsive) -> np.ndarray:
        return arrays.place
