"""Many records at many scales as the realizations of one run, and the ranges of linear forms in each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.loads import SampledForce
from impactlab.kernels.recorded_lanes import ScaledRecords, SummedRows, bring_records, take_ranges
from impactlab.kernels.series import NEAR
from impactlab.linear.laws import flowing_systems, system_of
from impactlab.linear.transitions import system_response, system_transition
from impactlab.plan.driving import Driving
from impactlab.plan.plan import Plan
from impactlab.plan.processes import Draws, Processes, ProcessPart
from impactlab.records.record import Keeper
from impactlab.results.snapshot import PEAKS

IN_STEP = 0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0)
"""Places of Gauss's rule in a step: mean and growth of a record that is linear in a step are exact."""

NUMBERS_OF_LANE = 60
"""Numbers that a lane keeps, about."""


@dataclass(frozen=True, eq=False)
class RecordsInLanes(ProcessPart):
    """Records that take the place of one given force, each in lanes of its own, by the linear response to them."""

    record: ClassVar[type] = ScaledRecords
    bring = staticmethod(bring_records)

    slots: np.ndarray  # (response,) bodies
    flow: np.ndarray  # see `ScaledRecords`
    push: np.ndarray
    forces: np.ndarray
    scales: np.ndarray  # (scale,): each record has all of them, in realizations that follow each other
    envelopes: int = 0

    @property
    def rows(self) -> int:
        return len(self.flow)

    @property
    def nbytes(self) -> int:
        return 8 * ((NEAR + 1) * self.rows + NUMBERS_OF_LANE)

    @property
    def seconds(self) -> float:
        return 1e-9 * self.rows

    def arrays(self, realizations: np.ndarray) -> ScaledRecords:
        record, scale = np.divmod(realizations.astype(np.int64), len(self.scales))
        chosen, record = np.unique(record, return_inverse=True)  # those of the block
        return ScaledRecords(
            flow=self.flow, push=self.push, forces=np.ascontiguousarray(self.forces[:, :, chosen]), record=record,
            scale=self.scales[scale], work=np.zeros((2, self.rows, len(chosen))), factors=np.zeros((0, 3, 0)), first=0,
            near=np.zeros((0, 0, len(realizations))), row=0,
        )  # fmt: skip

    def draw(
        self, arrays: Any, lanes: np.ndarray, realizations: np.ndarray, attempt: int, given: np.ndarray | None
    ) -> Draws:
        return []

    def end(self, arrays: Any, sample: int) -> np.ndarray:
        return np.zeros((0, len(arrays.record)))

    def place(self, arrays: Any) -> np.ndarray:
        return np.zeros(2, dtype=np.int64)


def records_in_lanes(
    model: Model, numbers: Sequence[int], records: Sequence[SampledForce], scales: np.ndarray, step: float, steps: int
) -> RecordsInLanes:
    """Return records in the place of given forces of a model, of some numbers, for steps of some length (s)."""
    joint = {slot: pair for pair in flowing_systems(model) for slot in pair[0].tolist()}
    sources, forces = model.sources["force"].drives, np.zeros(len(model.bodies))
    chosen = np.isin(sources.source, numbers)
    np.add.at(forces, sources.body[chosen], sources.weight[chosen])
    slots, flows, pushes, done = [], [], [], set[int]()
    for slot in np.flatnonzero(forces).tolist():
        if slot in done:
            continue
        own, system = joint.get(slot) or (np.array([slot]), system_of(model, np.array([slot]), *np.zeros((2, 1, 1))))
        done |= set(own.tolist())
        parts, rate, count = (system.mass, system.damping, system.stiffness), sum(system.scales), len(own)
        by_body = np.arange(2 * count).reshape(2, -1).T.ravel()  # displacement and velocity of a body follow each other
        flow = system_transition(*parts, np.zeros((count, count)), step, rate)[0]
        slots.append(own)
        flows.append(flow[np.ix_(by_body, by_body)])
        pushes.append((system_response(*parts, step, rate) @ forces[own])[:, by_body])
    begins, size = np.cumsum([0, *map(len, flows)]), sum(map(len, flows))
    whole = np.zeros((size, size))
    for begin, flow in zip(begins.tolist(), flows, strict=False):
        whole[begin : begin + len(flow), begin : begin + len(flow)] = flow
    times = (np.arange(steps)[:, None] + np.array(IN_STEP)) * step
    values = np.stack([sampled_record(item, times) for item in records], axis=-1)  # (step, node, record)
    linear = np.stack([values.mean(axis=1), np.sqrt(3.0) / 2.0 * (values[:, 1] - values[:, 0])], axis=1)
    linear = np.concatenate([linear, np.zeros((1, *linear.shape[1:]))])  # after the end
    push = np.ascontiguousarray(np.concatenate(pushes, axis=1))  # compiled code takes no other arrays
    return RecordsInLanes(np.concatenate(slots), whole, push, linear, scales)


def sampled_record(record: SampledForce, times: np.ndarray) -> np.ndarray:
    """Return the values of a given force at some times; those of samples with lines between them all at once."""
    if record.order == 1 and not record.repeats:
        return np.asarray(record.scale * np.interp(times, record.times, record.values, left=0.0, right=0.0))
    return np.asarray(record.call("force", times))


def with_records(plan: Plan, part: RecordsInLanes, numbers: Sequence[int]) -> Plan:
    """Return a plan in which records take the place of given forces of some numbers."""
    driving = plan.driving
    others = ~np.isin(driving.forces, numbers)
    forced, forces, weights = (item[others] for item in (driving.forced, driving.forces, driving.weights))
    processes = Processes((*driving.processes.parts, part), driving.processes.finer)
    changed: Driving = replace(driving, forced=forced, forces=forces, weights=weights, processes=processes)
    return replace(plan, driving=changed)


class Form(NamedTuple):
    """A linear form of displacements of bodies, or the force of a contact."""

    weights: dict[int, float]  # by slot
    of_contact: bool


class Ranges:
    """Takes the ranges of linear forms in each realization; it stands in a plan where records do.

    Parameters
    ----------
    forms : sequence of Form
    ends : (realization,) ndarray
        Time until which each realization counts (s).
    """

    summed: ClassVar[tuple[str, ...]] = ()

    def __init__(self, forms: Sequence[Form], ends: np.ndarray) -> None:
        self.forms, self.ends = forms, ends

    def read(self, plan: Plan) -> None:
        """Say that all rows of snapshots are read."""

    def keeper(self, run: Any, realizations: np.ndarray, ratio: int) -> Keeper:
        """Return the keeper of a block."""
        plan: Plan = run.plan
        snapshot, interval = plan.snapshot, plan.interval(ratio)
        bodies, rated = len(snapshot.bodies), plan.observed.rated
        rows, begin = list[int](), [0]
        for form in self.forms:
            for slot in form.weights:
                peaked = form.of_contact and plan.observed.peaked and rated[slot]
                name = PEAKS.name if peaked else "contact_force"
                rows.append(snapshot.place(name).start + slot if form.of_contact else slot)
            begin.append(len(rows))
        forms = SummedRows(
            np.array(begin), np.array(rows),
            np.array([weight for form in self.forms for weight in form.weights.values()], dtype=float),
            np.array([0 if form.of_contact else bodies for form in self.forms]), snapshot.impulsive_rows, interval,
        )  # fmt: skip
        ends = np.round(self.ends[realizations] / interval).astype(np.int64)
        return _RangeKeeper(forms, ends)


class _RangeKeeper(Keeper):
    """Takes the ranges of forms in a block."""

    wants_start = True

    def __init__(self, forms: SummedRows, ends: np.ndarray) -> None:
        super().__init__()
        self.forms, self.ends, self.now = forms, ends, 0
        count = len(forms.begin) - 1
        self.remembered, self.work = np.zeros((count, 3, len(ends))), np.zeros((2, len(ends)))
        self.turns = np.zeros(len(ends), dtype=bool)
        self.spans = np.stack([np.full((count, len(ends)), np.inf), np.full((count, len(ends)), -np.inf)], axis=1)

    def start(self, values: np.ndarray) -> None:
        self._take(np.ascontiguousarray(values[None]))
        self.first = self.spans[:, 1].copy()

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        self._take(snapshots)

    def _take(self, snapshots: np.ndarray) -> None:
        take_ranges(snapshots, self.forms, self.ends, self.now, self.remembered, self.spans, self.work, self.turns)
        self.now += len(snapshots)

    def result(self) -> dict[str, np.ndarray]:
        return {"range": np.concatenate([self.spans, self.first[:, None]], axis=1)}


def with_ranges(plan: Plan, ranges: Ranges, every: int) -> Plan:
    """Return a plan that looks at the ranges of forms after every so many steps."""
    peaked = bool(plan.observed.rated.any())
    return replace(plan, observed=replace(plan.observed, records=((ranges, 1),), every=every, peaked=peaked))
