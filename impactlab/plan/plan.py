"""The plan of a run: a tree of parts, each with the decisions on one subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from impactlab.assembly.links import Links, Pairs
from impactlab.assembly.mechanism import Mode, refusals
from impactlab.assembly.model import Model
from impactlab.machine import tuning
from impactlab.plan.clock import BATCHES, Clock
from impactlab.plan.driving import Driving
from impactlab.plan.events import Events
from impactlab.plan.forces import Forces
from impactlab.plan.method import Method
from impactlab.plan.noise import WhiteNoises
from impactlab.plan.observed import Observed
from impactlab.plan.realizations import STEP_SECONDS, Realizations, lane_seconds
from impactlab.plan.start import Start
from impactlab.plan.structure_points import Points
from impactlab.plan.subdomains import Subdomains, Tile, refuse_to_cut
from impactlab.results.losses import Loss
from impactlab.results.snapshot import Snapshot

ENOUGH_LEFT = 0.75
"""Part of the independent samples that standard errors need which is enough where realizations were lost."""


@dataclass(frozen=True, eq=False)
class System:
    """Bodies and links."""

    bodies: tuple[str, ...]  # names by slot
    contacts: tuple[str, ...]
    linear: np.ndarray  # (3, body) mass, damping and stiffness
    ends: Links  # what contacts act along
    clearance: np.ndarray  # (contact,) their clearances (m)
    links: Links  # contacts, then couplings
    refusals: Mapping[Mode, str]  # modes that mechanisms of the network cannot meet, and which these are

    @classmethod
    def of(cls, model: Model) -> System:
        """Return the bodies and links of a model."""
        linear = np.stack([model.mass, model.damping, model.stiffness])
        names = model.bodies.names, model.contacts.names
        return cls(*names, linear, model.ends, model.clearance, model.links, refusals(model))

    def restricted(self, tile: Tile) -> System:
        """Return those of a tile, which have contacts alone; else refuse."""
        refuse_to_cut(self, not self.ends.plain or len(self.links) > len(self.ends))
        ends = Pairs(len(tile.bodies), tile.ends)
        return System(
            tuple(map(self.bodies.__getitem__, tile.bodies.tolist())),
            tuple(map(self.contacts.__getitem__, tile.contacts.tolist())),
            self.linear[:, tile.bodies],
            ends,
            self.clearance[tile.contacts],
            ends,
            self.refusals,
        )


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything that a worker needs to run a block, as plain picklable data."""

    system: System
    forces: Forces
    method: Method
    noise: WhiteNoises
    driving: Driving
    events: Events
    points: Points
    start: Start
    clock: Clock
    realizations: Realizations
    observed: Observed
    subdomains: Subdomains

    @property
    def single(self) -> bool:
        """Whether blocks have one lane, in arrays without an axis of lanes."""
        return self.realizations.lanes == 1 and self.realizations.by_body

    @property
    def steady(self) -> bool:
        """Whether noise moves the bodies, and nothing but too short a spin-up keeps it from being stationary."""
        varying = self.noise.time_varying or bool(self.driving.processes.envelopes)
        transient = self.start.given or varying or self.led
        return not transient and bool(len(self.noise.white) or self.driving.series)

    @property
    def led(self) -> bool:
        """Whether given forces, or laws that depend on time, lead bodies to their motion."""
        return bool(len(self.driving.forced) or self.forces.timed.any())

    @property
    def random(self) -> bool:
        """Whether noise moves any body."""
        return bool(self.noise.random.any())

    @property
    def transient(self) -> bool:
        """Whether the states at the start and the end of the measurement count: it is no sample of a stationary motion.

        Sums then have rows for it; see `impactlab.kernels.sums`. So have those under cosines or processes, whose
        mean velocity is known from the states at both ends only.
        """
        clock = self.clock
        steady = self.steady and clock.settled and clock.relaxation > 0.0 and not self.driving.series
        return not (self.observed.sampled or steady)

    @property
    def rows(self) -> int:
        """Rows of the sums over bodies that the loop makes."""
        return self.method.rows(bool(self.driving))

    @cached_property  # names of 100 000 bodies are not cut for every call
    def snapshot(self) -> Snapshot:
        """What a snapshot of the run holds."""
        bodies, contacts = self.system.bodies[: self.observed.bodies], self.system.contacts[: self.observed.contacts]
        impulsive = tuple(self.events.impulsive.tolist())
        observed, labels = self.observed, self.forces.labels
        told = observed.told * self.events.told
        return Snapshot(bodies, contacts, labels, self.points.labels, observed.peaked, impulsive, observed.kicked, told)

    @cached_property
    def read(self) -> np.ndarray:
        """Rows of displacements, velocities and forces in snapshots that records read; nothing where these are all."""
        found = [record.read(self) for record, _ in self.observed.records]
        if not found or any(rows is None for rows in found):
            return np.zeros(0, dtype=np.int64)
        rows = np.unique(np.concatenate([self.snapshot.impulsive_rows, *found])).astype(np.int64)
        return np.asarray(rows[rows < self.snapshot.place("contact_force").stop])

    def interval(self, ratio: int) -> float:
        """Time between every `ratio`-th snapshot (s)."""
        return ratio * self.observed.every * self.clock.step

    def sample_times(self, seen: int, number: int) -> np.ndarray:
        """Return the times of so many snapshots after those that were seen, which begin after t = 0 (s)."""
        begin: float = self.clock.begin * self.clock.step
        return np.asarray(begin + (seen + 1 + np.arange(number)) * self.interval(1))

    @property
    def cold(self) -> np.ndarray:
        """Slots of bodies that nothing but kicks moves, in parts of the network that are excited, (body,)."""
        driven = np.zeros(len(self.system.bodies), dtype=bool)
        for slots in (
            self.noise.rows,
            self.driving.forced,
            self.driving.processes.slots,
            *(slots for slots, _ in self.driving.responses),
        ):
            driven[slots] = True
        labels = self.system.links.parts
        return np.flatnonzero(~driven & np.isin(labels, labels[driven]))

    def seconds(self, workers: int) -> float:
        """Time that the run will take on so many cores, roughly (s)."""
        clock, realizations = self.clock, self.realizations
        rounds = -(-realizations.blocks // workers)
        sampling = self.driving.seconds(self.method.integrator, clock.step, clock.all_steps)
        stepping = clock.all_steps / realizations.steps_per_call * tuning().call_seconds
        return rounds * (stepping + min(realizations.lanes, realizations.left) * sampling)

    def announced(self, seconds: float) -> str:
        """Say what the run will do in some time (s)."""
        return (
            f"{self.realizations.number} realizations of {self.clock.all_steps:.3g} steps of {self.clock.step:.3g} s "
            f"would take about {seconds:.2g} s"
        )

    @property
    def work(self) -> float:
        """Time that the steps of all realizations take in one block on one core (s): the same on any machine."""
        lane = lane_seconds(len(self.system.bodies), len(self.system.links), len(self.forces.states))
        return self.clock.all_steps * (STEP_SECONDS + self.realizations.number * lane)

    @property
    def samples_per_realization(self) -> int:
        """Into how many independent samples a realization is cut: its batches, if there are few realizations."""
        return 1 if self.realizations.number >= BATCHES else len(self.clock.boundaries)

    def without(self, losses: Sequence[Loss]) -> Plan:
        """Return the plan of the realizations that are left after some losses."""
        samples = (self.realizations.number - len(losses)) * self.samples_per_realization
        trusted = self.realizations.trusted and samples >= ENOUGH_LEFT * BATCHES
        return replace(self, realizations=replace(self.realizations, losses=tuple(losses), trusted=trusted))

    def counts(self, begin: int, end: int) -> np.ndarray:
        """Return how many of some steps after the spin-up are in each phase of the method's cycle, (phase,)."""
        phases, before = self.method.integrator.phases, self.clock.spin_up_steps
        last = phases - 1 - np.arange(phases)
        steps: np.ndarray = (before + end + last) // phases - (before + begin + last) // phases
        return steps

    @cached_property  # for the memory that they take, and for the blocks that run
    def tiles(self) -> tuple[Plan, ...]:
        """The plans of the tiles."""
        return tuple(map(self._restricted, self.subdomains.tiles))

    def _restricted(self, tile: Tile) -> Plan:
        return Plan(*(getattr(self, part.name).restricted(tile) for part in fields(self)))
