"""What is kept of each realization: its statistics, its path."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.plan.plan import Plan
from impactlab.records.record import Keeper, Record
from impactlab.results.labels import Variables
from impactlab.results.snapshot import AT_POINTS, TIME


class PerRealization(Record):
    """Each statistic also for every realization, as ``<name>_by_realization``: means over all steps."""

    every_step: ClassVar[bool] = True
    samples: ClassVar[bool] = False

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        return Keeper()

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        return {}  # the statistics are there already, one per realization


class PairedRealizations(PerRealization):
    """As `PerRealization`, but of whatever samples the ensemble's statistics are made."""

    every_step: ClassVar[bool] = False


class Trajectory(Record):
    """Displacements, velocities, contact forces and states of laws over time, of all realizations.

    Parameters
    ----------
    interval : float
        Time between samples (s); the first is at t = 0, after the spin-up.
    """

    interval: float = parameter(units="s", above=0.0)

    def exact_interval(self) -> float | None:
        return self.interval

    def stride(self, model: Model, step: float) -> int:
        return round(self.interval / step)

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Path(np.empty((len(realizations), sample_count(plan)[1], plan.snapshot.size)), ratio)

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        paths = [result["path"] for result in results]
        path = np.concatenate(paths) if len(paths) > 1 else paths[0]
        times = ("time",), self.interval * np.arange(path.shape[1]), TIME
        return {"time": times, **plan.snapshot.labelled(path, "realization", "time")}


class _Path(Keeper):
    wants_start = True

    def __init__(self, path: np.ndarray, ratio: int) -> None:
        super().__init__(ratio)
        self.path, self.kept = path, 0

    def start(self, values: np.ndarray) -> None:
        self.path[:, 0], self.kept = values.T, 1

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        own = self.own(snapshots)
        self.path[:, self.kept : self.kept + len(own)] = own.transpose(2, 0, 1)
        self.kept += len(own)

    def result(self) -> dict[str, np.ndarray]:
        return {"path": self.path}


def sample_count(plan: Plan) -> tuple[float, int]:
    """Return the time between samples of the trajectories of a plan (s), and their number; 0 without any."""
    for record, ratio in plan.observed.records:
        if isinstance(record, Trajectory):
            return record.interval, plan.clock.steps // (ratio * plan.observed.every) + 1
    return 0.0, 0


def trajectory_size(plan: Plan) -> int:
    """Return the bytes that the trajectories of a plan take."""
    numbers = plan.snapshot.size + len(AT_POINTS) * len(plan.snapshot.points)
    return 8 * plan.realizations.number * sample_count(plan)[1] * numbers
