"""What is kept of each realization: its statistics, its path."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput
from impactlab.inputs import suggestion
from impactlab.plan.plan import Plan
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Labelled, Variables
from impactlab.results.snapshot import ALL, STATES, TIME, Kept, Snapshot, owner_of

_ALL = (*ALL, STATES.name)
"""Names of all quantities."""


class PerRealization(Record):
    """Each statistic also for every realization, as ``<name>_by_realization``: means over all steps.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.PerRealization(), rng=1)
    >>> result.contact_ratio_by_realization.dims
    ('realization', 'contact')
    """

    every_step: ClassVar[bool] = True
    samples: ClassVar[bool] = False

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return Keeper()

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        return {}  # the statistics are there already, one per realization


class PairedRealizations(PerRealization):
    """As `PerRealization`, but of whatever samples the ensemble's statistics are made."""

    every_step: ClassVar[bool] = False


class Trajectory(Record):
    """Displacements, velocities, contact forces and states of laws over time, of all realizations.

    The force of an impulsive contact is its impulse since the sample before, over the interval.

    Parameters
    ----------
    interval : float
        Time between samples (s).
    names : sequence of str, optional
        Bodies, contacts, points of structures and states of laws that are kept; the name of a structure, a body in a
        plane or a contact is also that of its coordinates, points or states. All by default. Variables of some names
        have the dimensions ``recorded_oscillator``, ``recorded_contact``, ``recorded_point`` and ``recorded_state``.
    quantities : sequence of str, optional
        "displacement", "velocity", "contact_force", "law_state", "point_displacement" and "point_velocity"; all by
        default.
    start : float
        Time from the begin of the statistics to the first sample (s).

    Examples
    --------
    >>> il.Trajectory(0.01, names=["a"], quantities=["displacement"], start=100.0)
    Trajectory(interval=0.01, names=('a',), quantities=('displacement',), start=100.0)
    """

    interval: float = parameter(units="s", above=0.0)
    names: tuple[str, ...] | None = parameter(None, kw_only=True)
    quantities: tuple[str, ...] | None = parameter(None, kw_only=True)
    start: float = parameter(0.0, units="s", minimum=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for field in ("names", "quantities"):
            if getattr(self, field) == ():
                raise InvalidInput(f"Trajectory.{field} has no name; leave it out for all.")
        for quantity in self.quantities or ():
            if quantity not in _ALL:
                raise InvalidInput(f"Trajectory.quantities: {suggestion(quantity, _ALL)}")

    def resolved(self, model: Model) -> Record:
        states = [name for name, _ in model.kicks.states]
        members = [*model.bodies.names, *model.network.contacts, *(name for name, _ in model.points), *states]
        known = dict.fromkeys([*members, *filter(None, map(owner_of, members))])
        for name in self.names or ():
            if name not in known:
                hint = suggestion(name, known)
                raise InvalidInput(f"Trajectory: there is no oscillator, contact, point or state {name!r}; {hint}")
        snapshot = Snapshot(model.bodies.names, tuple(model.network.contacts), tuple(model.kicks.states), model.points)
        if not self.kept(snapshot):
            raise InvalidInput(
                f"Trajectory(names={self.names!r}, quantities={self.quantities!r}) keeps nothing: none of the names "
                "has one of the quantities."
            )
        return self

    @property
    def first_sample(self) -> float:
        return self.start

    def exact_interval(self) -> float | None:
        return self.interval

    def kept(self, snapshot: Snapshot) -> list[Kept]:
        """Return the quantities kept from snapshots."""
        return snapshot.kept(self.names, self.quantities)

    def times(self, number: int, begin: float = 0.0) -> Labelled:
        """Return the times of the samples; where a record from t = 0 has the same times, its numbers, bit for bit.

        Statistics `begin` at a time (s).
        """
        start = begin + self.start
        early = round(start / self.interval)
        shift = start - early * self.interval
        shift = shift if abs(shift) > 1e-9 * start else 0.0
        return ("time",), shift + self.interval * np.arange(early, early + number), TIME

    def labels(self, snapshot: Snapshot) -> Variables:
        """Return the names of what is kept where it is not kept of all; those of states in any case."""
        kept = {item.dimension: item for item in self.kept(snapshot)}
        if self.names is None:
            return snapshot.coordinates if STATES.dimension in kept else {}
        return {
            name: ((name,), np.array(item.names), {"long_name": f"{item.quantity.dimension} that is recorded"})
            for name, item in kept.items()
        }

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Path(self, run.plan, realizations, ratio)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        plan = run.plan
        variables = dict(self.labels(plan.snapshot))
        for item in self.kept(plan.snapshot):
            paths = [result[item.quantity.name] for result in results]
            path = np.concatenate(paths) if len(paths) > 1 else paths[0]
            dimensions = "realization", "time", item.dimension
            variables[item.quantity.name] = dimensions, path, plan.snapshot.attributes(item.quantity)
        return {"time": self.times(path.shape[1], run.begin), **variables}


class Sampler(Keeper):
    """Takes the samples of a trajectory of one block."""

    wants_start = True

    def __init__(self, record: Trajectory, plan: Plan, ratio: int) -> None:
        super().__init__(ratio, round(record.start / (plan.observed.every * plan.clock.step)))
        self.kept = record.kept(plan.snapshot)

    def start(self, values: np.ndarray) -> None:
        if self.seen == 0:
            self.take(values[None])

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        self.take(self.own(snapshots))

    def take(self, samples: np.ndarray) -> None:
        """Keep samples [sample, quantity, lane]."""
        raise NotImplementedError


class _Path(Sampler):
    def __init__(self, record: Trajectory, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        super().__init__(record, plan, ratio)
        shape = len(realizations), sample_count(plan)
        self.paths, self.taken = [np.empty((*shape, len(item.names))) for item in self.kept], 0

    def take(self, samples: np.ndarray) -> None:
        end = self.taken + len(samples)
        for item, path in zip(self.kept, self.paths, strict=True):
            path[:, self.taken : end] = item.values(samples).transpose(2, 0, 1)
        self.taken = end

    def result(self) -> dict[str, np.ndarray]:
        return {item.quantity.name: path for item, path in zip(self.kept, self.paths, strict=True)}


def trajectory_of(plan: Plan) -> tuple[Trajectory, int] | None:
    """Return the record of trajectories of a plan, with the snapshots between its samples."""
    return next(((item, ratio) for item, ratio in plan.observed.records if isinstance(item, Trajectory)), None)


def sample_count(plan: Plan) -> int:
    """Return the number of samples of the trajectories of a plan; 0 without any."""
    found = trajectory_of(plan)
    if found is None:
        return 0
    record, ratio = found
    steps = plan.clock.steps - round(record.start / plan.clock.step)
    return steps // (ratio * plan.observed.every) + 1


def trajectory_size(plan: Plan) -> int:
    """Return the bytes that the trajectories of a plan take."""
    found = trajectory_of(plan)
    numbers = sum(len(item.names) for item in found[0].kept(plan.snapshot)) if found else 0
    return 8 * plan.realizations.number * sample_count(plan) * numbers
