"""Filtered noise: which networks have it, how it begins, and its part of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from impactlab.assembly.mechanism import Method, Mode
from impactlab.assembly.model import Model
from impactlab.components.filters import filter_of
from impactlab.kernels.random import streams_of
from impactlab.kernels.series import NEAR
from impactlab.linear.laws import coupled_systems, flowing_systems, moved_by
from impactlab.linear.systems import LinearSystem
from impactlab.mechanisms.excitations import Excitations
from impactlab.mechanisms.filtered_noise.filter_tables import tables_of_forces, tables_of_responses
from impactlab.mechanisms.filtered_noise.filtered_motion import FilteredMotion
from impactlab.mechanisms.filtered_noise.from_sample_to_sample import (
    Coloured,
    Filters,
    bring_coloured,
    filter_states,
)
from impactlab.mechanisms.noise_processes import DrawnStart, check_together
from impactlab.plan.processes import Draws, ProcessPart

Systems = tuple[tuple[np.ndarray, LinearSystem], ...]

BLOCKS = 3
"""Blocks of states that are kept, and of work space."""

SAMPLED = 0.1
"""Step where filtered noise is sampled, in units of the shortest time of its filter."""


class FilteredNoises(Excitations):
    """White noise through filters, whose states go from sample to sample."""

    name = "filtered noise"
    kind = "filter"
    modes = frozenset({Mode.ONE_LANE, Mode.FORCES})

    def motions(self, model: Model, systems: Systems) -> tuple[FilteredMotion, ...]:
        return tuple(
            FilteredMotion(name, excitation, filter_of(excitation), *moved)
            for name, excitation, moved in moved_by(model, "filter", systems)
        )

    def labels(self, model: Model) -> list[str]:
        filters = model.sources["filter"].named()
        return [f"{name}.{number}" for name, item in filters for number in range(len(filter_of(item).input))]

    def rates(self, model: Model) -> np.ndarray:
        return np.concatenate([filter_of(item).rates for item in model.sources["filter"].excitations])

    def density(self, model: Model, frequency: float) -> np.ndarray:
        sources, at = model.sources["filter"], np.array([frequency])
        own = [float(filter_of(item).density(at)[0]) for item in sources.excitations]
        return sources.added(np.array(own), len(model.bodies))

    def sampled_step(self, model: Model) -> float:
        """Return the step; the density of samples of ``exp(−λ|t|)`` is too large by a part of ``(h λ)²/12``."""
        return SAMPLED / max(filter_of(item).fastest for item in model.sources["filter"].excitations)

    def process(
        self, model: Model, method: Method, step: float, seed: tuple[int, int], finer: int
    ) -> ColouredNoises | None:
        return ColouredNoises.of(model, method, step, seed, finer)


@dataclass(frozen=True, eq=False)
class ColouredNoises(ProcessPart):
    """Filtered white noises on some bodies."""

    record: ClassVar[type] = Coloured
    bring = staticmethod(bring_coloured)

    slots: np.ndarray  # (response or force,) bodies
    filters: Filters
    starts: tuple[DrawnStart, ...]
    envelopes: int  # how many have one
    states: int  # of all filters
    labels: tuple[str, ...]  # names of the states

    @classmethod
    def of(cls, model: Model, method: Method, step: float, seed: tuple[int, int], finer: int) -> ColouredNoises:
        """Return the coloured noises of a model for a method and a step (s), of which some make one of those taken."""
        interval, noises = step / (finer * method.samples_per_step), FilteredNoises()
        motions = noises.motions(model, flowing_systems(model))
        check_together(motions)
        tables_of = tables_of_responses if method.takes_response else tables_of_forces
        slots, tables, normals = tables_of(motions, interval)
        names = [motion.name for motion, count in zip(motions, normals, strict=True) for _ in range(count)]
        numbers = [number for count in normals for number in range(count)]
        starts, states = [], 0
        for motion in noises.motions(model, coupled_systems(model)):
            starts.append(DrawnStart.of(motion, states, seed))
            states += motion.states
        return cls(
            slots,
            tables._replace(streams=streams_of(seed, names, numbers), finer=finer),
            tuple(starts),
            sum(motion.modulated for motion in motions),
            states,
            tuple(noises.labels(model)),
        )

    @property
    def rows(self) -> int:
        """Number of rows of samples."""
        return max(len(self.filters.pairs), len(self.filters.envelopes))

    @property
    def nbytes(self) -> int:
        """Bytes that a realization takes."""
        rows = (NEAR + 1) * self.rows + BLOCKS * (len(self.filters.motion.begin) - 1 + self.states)
        return int(8 * rows + 16 * self.filters.streams.shape[1])

    @property
    def seconds(self) -> float:
        """Time that a sample takes for a realization, roughly (s)."""
        filters = self.filters
        matrices = filters.motion, filters.noise, filters.flow, filters.output
        entries = sum(len(item.values) for item in matrices)
        return float(1e-9 * filters.finer * (entries + 4 * filters.streams.shape[1]))

    def arrays(self, realizations: np.ndarray) -> Coloured:
        """Return the arguments of the loop for a block of realizations; the states are still to be set."""
        lanes, filters = len(realizations), self.filters
        rows = max(len(filters.motion.begin) - 1, self.states, self.rows)
        return Coloured(
            filters=filters,
            realizations=realizations,
            factors=np.zeros((0, 3, self.envelopes)),
            first=0,
            place=np.zeros(2, dtype=np.int64),
            kept=np.zeros((BLOCKS, self.states, lanes)),
            work=np.zeros((BLOCKS, rows, lanes)),
            normals=np.zeros((4, filters.streams.shape[1], lanes), dtype=np.float32),
            near=np.zeros((0, 0, lanes)),
            row=0,
        )

    def draw(
        self, arrays: Coloured, lanes: np.ndarray, realizations: np.ndarray, attempt: int, given: np.ndarray | None
    ) -> Draws:
        result = []
        for start in self.starts:
            rows = start.draw(realizations, attempt)
            count = start.states.stop - start.states.start
            own = rows[:count]
            if given is not None:
                known = given[start.states][:, realizations % given.shape[1]]
                own = np.where(np.isnan(known), own, known)
            for kept in arrays.kept:
                kept[start.states, lanes] = own
            result.append((start.slots, rows[count:].reshape(2, -1, len(lanes))))
        return result

    def end(self, arrays: Coloured, sample: int) -> np.ndarray:
        return filter_states(arrays, sample)

    def lasting(self, arrays: Coloured) -> list[np.ndarray]:
        return [arrays.kept]

    def place(self, arrays: Coloured) -> np.ndarray:
        return arrays.place
