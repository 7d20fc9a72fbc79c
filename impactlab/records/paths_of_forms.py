"""Paths of linear forms in runs by steps: where they turn, and records of that."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.kernels.turning_points import BROWNIAN, CUBIC, PARABOLIC, PathOfForm, begin_path, find_turns
from impactlab.linear.laws import coupled_systems
from impactlab.plan.plan import Plan
from impactlab.records.linear_forms import Forms, RowsOfForm, forms_given, resolved_forms
from impactlab.records.record import Record

RAISED = 0.5826
"""How much higher the top of a Brownian path is than its highest sample, in root mean squares of a step (M. Broadie,
P. Glasserman and S. Kou, Math. Finance 7, 1997, 325)."""

SMOOTH_STEPS, ROUGH_STEPS = 0.25, 0.05
"""Step times the fastest rate of linear motion: Hermite's cubic of displacements is then 1e-5 off, and the largest
velocities, where noise makes them rough, 0.1 %."""

NEVER = 2**62
"""Samples between points of all lanes, where turning points are enough."""

POINTS_OF_LANE = 64
"""Points of each lane for which there is room, on average: they stay in the cache."""


class RecordOfPaths(Record):
    """A record of linear forms along whole paths, for which all steps are taken."""

    of: Any = parameter(None)

    every_step: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "of", forms_given(f"{type(self).__name__}.of", self.of))

    def resolved(self, model: Model) -> Record:
        return self.replace(of=resolved_forms(f"{type(self).__name__}.of", self.of, model))

    def stride(self, model: Model, step: float) -> int:
        return 1

    def longest_step(self, model: Model) -> float:
        return longest_step(self.of, model)

    def read(self, plan: Plan) -> np.ndarray:
        snapshot = plan.snapshot
        rows = RowsOfForm.of_all(self.of, snapshot)
        rows += RowsOfForm.of_all([form for form in self.of if form.smooth], snapshot, "velocity")
        return np.concatenate([item.rows for item in rows])


def jumps_by_noise(forms: Sequence[RowsOfForm], plan: Plan) -> np.ndarray:
    """Return by how much white noise changes each form in a step, root mean square, through the velocities in it."""
    noise, place = plan.noise, plan.snapshot.place("velocity")
    pushes = noise.amplitude[:, 1]  # (phase, row)
    if not plan.method.integrator.kicks:  # rows are forces
        pushes = pushes * plan.clock.step / plan.system.linear[0][noise.rows]
    which = noise.distinct[1]
    which = which if len(which) else np.arange(len(noise.rows))
    order = np.argsort(noise.rows, kind="stable")
    begin = np.searchsorted(noise.rows[order], np.arange(len(plan.system.bodies) + 1))
    result = np.zeros(len(forms))
    for number, (rows, weights) in enumerate(forms):
        own = (rows >= place.start) & (rows < place.stop)
        slots, weights = rows[own] - place.start, weights[own]
        pushed = [order[begin[slot] : begin[slot + 1]] for slot in slots.tolist()]
        if any(map(len, pushed)):
            along = pushes[:, np.concatenate(pushed)] * np.repeat(weights, [len(item) for item in pushed])
            streams, normal = np.unique(which[np.concatenate(pushed)], return_inverse=True)
            normals = np.zeros((len(along), len(streams)))
            np.add.at(normals.T, normal, along.T)
            result[number] = np.sqrt((normals**2).sum(axis=1).mean())
    return result


def longest_step(forms: Forms, model: Model) -> float:
    """Return the longest step between which paths of forms are told well where any step is exact (s)."""
    rates = np.concatenate([np.sqrt(model.stiffness / model.mass), model.damping / model.mass])
    fastest = max([float(rates.max()), *(max(system.scales) for _, system in coupled_systems(model))])
    share = SMOOTH_STEPS if all(form.smooth for form in forms) else ROUGH_STEPS
    return share / fastest if fastest > 0.0 else math.inf


def paths_of(forms: Forms, plan: Plan) -> tuple[list[PathOfForm], np.ndarray]:
    """Return what the paths of forms do between steps, and by how much noise changes them in a step.

    Displacements follow Hermite's cubic of displacements and velocities, and where an impulsive contact has hit, the
    tangents. Forms with velocities or forces turn at the top of a parabola, or at a step where white noise makes them
    rough.
    """
    snapshot, none = plan.snapshot, np.zeros(0, dtype=np.int64)
    rows = RowsOfForm.of_all(forms, snapshot)
    paces = iter(RowsOfForm.of_all([form for form in forms if form.smooth], snapshot, "velocity"))
    jumps, result = jumps_by_noise(rows, plan), []
    for form, own, jump in zip(forms, rows, jumps.tolist(), strict=True):
        kind = CUBIC if form.smooth else BROWNIAN if jump > 0.0 else PARABOLIC
        slopes, pushing = next(paces).rows if form.smooth else none, "contact_force" in form.quantities
        result.append(PathOfForm(*own, slopes, snapshot.impulsive_rows, plan.clock.step, kind, pushing))
    return result, jumps


class TurnsOfPath:
    """The points at which a path turns, in the snapshots of a block of realizations.

    Parameters
    ----------
    path : PathOfForm
    lanes : int
    every : int
        Steps after which all realizations have a point.
    """

    def __init__(self, path: PathOfForm, lanes: int, every: int = NEVER) -> None:
        self.path, self.every, self.seen = path, every, 0
        self.past, self.work = np.zeros((3, lanes)), (np.zeros((3, lanes)), *np.zeros((2, lanes), np.int64))
        self.places, self.values = np.zeros((2, POINTS_OF_LANE * lanes), np.int64), np.zeros(POINTS_OF_LANE * lanes)

    def start(self, values: np.ndarray) -> None:
        """Begin with the snapshot at t = 0, [row, lane]."""
        begin_path(np.ascontiguousarray(values[None]), self.path, self.past)

    def next(self, snapshots: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, int]]:
        """Yield places and values of the next points, and how many of both count; see `find_turns`."""
        snapshots, done = np.ascontiguousarray(snapshots), 0
        while done < len(snapshots):
            done, number = find_turns(
                snapshots, done, self.seen, self.every, self.path, self.past, self.work, self.places, self.values
            )
            yield self.places, self.values, number
        self.seen += len(snapshots)
