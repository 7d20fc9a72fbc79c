"""Runs without noise or steps, as the labelled datasets that any run gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries, json_of
from impactlab.errors import ImpactLabError, InvalidInput, warn
from impactlab.kernels.event_log import NODE_TIME, NODE_WEIGHT
from impactlab.kernels.from_event_to_event import (
    CHATTERS,
    CLOSINGS,
    COUNT,
    EVALUATIONS,
    GRAZED,
    PEAK,
    PRESSED,
    RATIO,
    WORST,
    Span,
)
from impactlab.kernels.smooth_steps import STAGES
from impactlab.linear.damping import damped
from impactlab.linear.decay import relaxation_time
from impactlab.located.course import Course, Stuck
from impactlab.located.earlier_runs import Earlier, go_on, numbers_of
from impactlab.located.energy_of_events import EnergyOfEvents, Integrals
from impactlab.located.energy_of_steps import EnergyOfSteps
from impactlab.located.event_located import EventLocated, linear_between_events
from impactlab.located.given_waves import given_waves
from impactlab.located.impacts_of_events import OF_EVENTS, ImpactsOfEvents
from impactlab.located.limits import ROUGHER, Limit, Limits, look_seconds, stage_seconds
from impactlab.located.logs import NodesTaken, Taken
from impactlab.located.passages_of_events import PassagesOfEvents, with_limits
from impactlab.located.path_snapshots import PathSnapshots, in_order
from impactlab.located.quantities_on_paths import QuantityOnPaths, mean_of
from impactlab.located.rows_of_couplings import rows_of_couplings
from impactlab.located.sampling import Regular, Sampling
from impactlab.located.scenes import Linear, as_lanes, linear_of
from impactlab.located.sections_of_events import SectionsOfEvents, with_level
from impactlab.located.sliders import states_at
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse, longest_step
from impactlab.located.starts import first_states
from impactlab.plan.clock import settles
from impactlab.records.energy_flows import EnergyFlows
from impactlab.records.final_state import CONTINUATION, FINAL, OF_CONTINUATION, FinalState, name_of
from impactlab.records.first_passage import FirstPassage
from impactlab.records.impact import Impacts
from impactlab.records.observable import Observable
from impactlab.records.power_accounts import labelled_powers, temperature
from impactlab.records.record import Record
from impactlab.records.section import Section
from impactlab.records.surface import Strobe
from impactlab.records.trajectory import PerRealization, Trajectory
from impactlab.results.dataset import BEGIN, provenance
from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import BODY, OF_POINTS, POINT, STATISTICS, Estimate, labels_of, unwanted, variables_of
from impactlab.results.snapshot import REALIZATION, STATES, Kept, Snapshot
from impactlab.results.stack import Findings
from impactlab.statistics.ergodicity import STARTS, difference_of_starts

ENDLESS = (
    "Unknown (NaN) where a contact came to rest by bouncing: endless impacts have no rate. contact_ratio has the "
    "time at rest."
)


TRAJECTORY, STROBE = "il.Trajectory", "il.Strobe"
"""Names of their samples, which no quantity of one's own has."""

NOTICED = 0.01
"""Part of the size of displacements up to which rounding does not change a path for averages."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A run that is wanted: of all realizations of a network."""

    model: Model
    method: EventLocated
    start: str | np.ndarray  # "stationary", "rest", or displacements and velocities, (2, body, realization)
    realizations: int
    duration: float
    spin_up: float
    records: Sequence[Record]
    statistics: tuple[str, ...] | None
    configuration: Mapping[str, Any]
    states: np.ndarray  # (state, realization), or (state, 1), of laws where realizations begin
    earlier: Earlier | None = None
    """The end of the earlier run from which this one goes on."""
    steps: Callable[[], float] | None = None
    """Time of one core that steps would take (s), beside which the run may not take too long; None for any time."""

    @cached_property
    def scene(self) -> Linear | Smooth:
        """The network as one lane: of exact motion between events, or of steps that end there."""
        if not linear_between_events(self.model):
            return Smooth(self.followed) if self.energy is None else Smooth(self.followed, self.energy.flows)
        scene, energy = linear_of(self.followed), self.energy
        return scene if energy is None else replace(scene, flows=energy.flows)

    @cached_property
    def energy(self) -> EnergyOfEvents | None:
        """What knows the powers of forces, if they are recorded."""
        for record in self.records:
            if isinstance(record, EnergyFlows):
                if linear_between_events(self.model):
                    return EnergyOfEvents(self.followed, record.of_network, linear_of(self.followed).frequencies[0])
                frequencies = Smooth(self.followed).frequencies
                return EnergyOfSteps(self.followed, record.of_network, frequencies, self.snapshots, self.realizations)
        return None

    @cached_property
    def snapshots(self) -> PathSnapshots:
        """Samples and nodes of paths as snapshots."""
        return PathSnapshots(self.model, self.followed, not linear_between_events(self.model))

    @cached_property
    def quantities(self) -> list[QuantityOnPaths]:
        """Quantities of one's own."""
        records = [record for record in self.records if isinstance(record, Observable)]
        return [QuantityOnPaths(record, self.snapshots, self.realizations) for record in records]

    @property
    def integrated(self) -> list[QuantityOnPaths | EnergyOfSteps]:
        """What takes nodes of integrals."""
        return [*self.quantities, *([self.energy] if isinstance(self.energy, EnergyOfSteps) else [])]

    def take_nodes(self, lane: int, nodes: np.ndarray) -> None:
        """Take nodes of integrals of a realization."""
        nodes = in_order(nodes)
        rows, times, weights = (
            self.snapshots.of_nodes(nodes),
            nodes[:, NODE_TIME],
            np.ascontiguousarray(nodes[:, NODE_WEIGHT]),
        )
        for item in self.integrated:
            item.take(lane, rows, times, weights)

    @cached_property
    def followed(self) -> Model:
        """The network with a contact where the level of a section is, and at each limit."""
        model = with_level(self.model, None if self.section is None else self.section.surface)
        return model if self.first_passage is None else with_limits(model, self.first_passage.named)

    @property
    def first_passage(self) -> FirstPassage | None:
        """The record of first passages, if there is one."""
        return next((record for record in self.records if isinstance(record, FirstPassage)), None)

    @property
    def section(self) -> Section | None:
        """The record of a section, if there is one."""
        return next((record for record in self.records if isinstance(record, Section)), None)

    @cached_property
    def trajectory(self) -> Trajectory | None:
        """The record of paths, if there is one; others that need samples are refused."""
        found = None
        for record in self.records:
            if isinstance(record, Trajectory):
                found = record
            elif not keeps(record):
                raise InvalidInput(
                    f"EventLocated keeps no {type(record).__name__}, but il.Trajectory, il.Section, il.FinalState, "
                    "il.FirstPassage, il.Impacts, il.EnergyFlows, il.Observable and il.PerRealization; use "
                    "integrator=il.ExactFlow()."
                )
        return found

    @property
    def begin(self) -> float:
        """Time at which statistics begin (s)."""
        return 0.0 if self.earlier is None else self.earlier.time

    @property
    def starts_at(self) -> float:
        """Time at which lanes start (s)."""
        return -self.spin_up if self.earlier is None else self.earlier.time

    @property
    def end(self) -> float:
        """Time at which lanes end (s)."""
        return self.begin + self.duration

    @property
    def strobe(self) -> Strobe | None:
        """The surface of the section, if it is a strobe."""
        surface = None if self.section is None else self.section.surface
        return surface if isinstance(surface, Strobe) else None

    @cached_property
    def sampling(self) -> Sampling:
        """When samples are taken."""
        record, strobe, regular = self.trajectory, self.strobe, dict[str, Regular]()
        if record is not None:
            regular[TRAJECTORY] = self.begin + record.start, record.interval
        if strobe is not None:
            regular[STROBE] = strobe.first_from(self.begin), strobe.period
        for item in self.records:
            if isinstance(item, Observable) and item.interval is not None:
                regular[item.variable] = self.begin, item.interval
        return Sampling.of(regular, self.end, [] if self.energy is None else [self.begin])

    @property
    def samples(self) -> int:
        """How many samples there are."""
        return len(self.sampling.times)

    @property
    def sampled_bytes(self) -> float:
        """Bytes that samples take."""
        numbers = 2 * len(self.model.bodies) + len(self.rows) + len(self.model.kicks.states)
        return 8.0 * self.realizations * self.samples * numbers

    @property
    def limit(self) -> tuple[float, Callable[[], float]] | None:
        """Time of an evaluation, and of steps (s), where the time is limited."""
        if self.steps is None:
            return None
        bodies = len(self.model.bodies)
        smooth = isinstance(self.scene, Smooth)
        return stage_seconds(bodies) if smooth else look_seconds(bodies, len(self.rows)), self.steps

    def least_seconds(self) -> float:
        """Return the time of one core that the longest steps would take under smooth forces (s), 0 under others."""
        if not isinstance(self.scene, Smooth):
            return 0.0
        length = self.spin_up + self.duration
        evaluations = 2 * STAGES * ROUGHER * length / min(longest_step(self.scene), length)
        return self.realizations * evaluations * stage_seconds(len(self.model.bodies))

    @property
    def span(self) -> Span:
        """How it runs."""
        return Span(self.method.tolerance, True)

    @property
    def alike(self) -> tuple[Any, ...]:
        """What the runs in one call have in common."""
        recorded = self.impacts is None, self.passages is None, self.logs_states, bool(self.integrated)
        return *self.scene.alike, self.span, self.samples, *recorded, id(self.earlier)

    def at_start(self) -> tuple[np.ndarray, np.ndarray]:
        """Return displacements and velocities of the free bodies where realizations begin, (realization, body)."""
        return first_states(self.model, self.scene, self.start, self.states, self.starts_at, self.realizations)

    @cached_property
    def impacts(self) -> ImpactsOfEvents | None:
        """What takes impacts, if they are recorded."""
        for record in self.records:
            if isinstance(record, Impacts):
                slots = record.slots(self.model.contacts.names)
                return ImpactsOfEvents(record.tally((0, 1), 1.0), slots, len(self.rows), self.realizations)
        return None

    @cached_property
    def points(self) -> SectionsOfEvents | None:
        """What takes the points of a section, if they are recorded."""
        section = self.section
        if section is None:
            return None
        return SectionsOfEvents(section.surface, section.names, section.points(), self.followed, self.given_motions)

    @cached_property
    def passages(self) -> PassagesOfEvents | None:
        """What takes first passages, if they are recorded."""
        record = self.first_passage
        if record is None:
            return None
        if self.earlier is not None or self.spin_up:
            raise InvalidInput(
                "FirstPassage: the clock starts at t = 0 with the state of initial=; leave out spin_up= and continues=."
            )
        return PassagesOfEvents(record.named, self.followed, self.at_start()[0])

    @property
    def ends(self) -> bool:
        """Whether nothing but what records want of it is wanted of a run, and no statistics."""
        return self.statistics is None and bool(self.records) and all(record.ends_run for record in self.records)

    @property
    def logs_states(self) -> bool:
        """Whether the states after events are wanted."""
        return self.section is not None and self.section.every_step

    def given_motions(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return displacements and velocities of bodies of given motion at some times, (time, body), and room."""
        x, v = np.empty((2, len(times), len(self.model.bodies)))
        for slot, wave in given_waves(self.model):
            x[:, slot], v[:, slot] = wave.at(times)
        return x, v

    @cached_property
    def rows(self) -> tuple[str, ...]:
        """Names of contacts, and of what else has events."""
        scene = self.scene
        couplings = scene.turns.names * 2 if isinstance(scene, Smooth) else rows_of_couplings(self.model).names
        return *self.followed.contacts.names, *couplings


def keeps(record: Record) -> bool:
    """Whether a run without steps can keep a record."""
    kept = Trajectory, Section, FinalState, FirstPassage, Impacts, EnergyFlows, Observable, PerRealization
    return isinstance(record, kept)


def run_located(wanted: Sequence[Wanted], show: Callable[[float], None]) -> list[Traced | ImpactLabError]:
    """Run networks, in one call those that are alike but for numbers; return each of them as run, or its error.

    They are known to be networks that the method can follow; see `impactlab.located.event_located.check`.
    """
    results: list[Traced | ImpactLabError | None] = [None] * len(wanted)
    groups: dict[tuple[Any, ...], list[int]] = {}
    for place, item in enumerate(wanted):
        try:
            groups.setdefault(item.alike, []).append(place)
        except ImpactLabError as error:
            results[place] = error
    for places in groups.values():
        begun = sum(item is not None for item in results) / len(wanted)
        shown = partial(_show, show, begun, len(places) / len(wanted))
        found = _run([wanted[place] for place in places], shown)
        for place, result in zip(places, found, strict=True):
            results[place] = result
    return _begun_elsewhere([item for item in results if item is not None])


def _begun_elsewhere(results: list[Traced | ImpactLabError]) -> list[Traced | ImpactLabError]:
    """Let runs whose statistics are wanted begin elsewhere, too, and note where this leads to another motion."""
    places = [place for place, item in enumerate(results) if isinstance(item, Traced) and item.forgets]
    again = [results[place].begun_elsewhere() for place in places]  # type: ignore[union-attr]
    for place, other in zip(places, run_located(again, lambda part: None) if again else [], strict=True):
        usual = results[place]
        assert isinstance(usual, Traced)
        if isinstance(other, Traced):
            results[place] = usual._replace(elsewhere=usual.difference(other))
    return results


def _show(show: Callable[[float], None], begun: float, share: float, part: float) -> None:
    """Show the part of all that is done, from the part of a share."""
    show(begun + share * part)


def _run(wanted: Sequence[Wanted], show: Callable[[float], None]) -> list[Traced | ImpactLabError]:
    """Run networks that are alike but for numbers as lanes of one call."""
    owners = [item for item in wanted for _ in range(item.realizations)]
    x, v = (np.concatenate(parts) for parts in zip(*(item.at_start() for item in wanted), strict=True))
    begins = np.cumsum([0, *(item.realizations for item in wanted)])

    def take(lane: int, events: np.ndarray, states: np.ndarray) -> None:
        item, own = owners[lane], lane - int(begins[np.searchsorted(begins, lane, side="right") - 1])
        for taker in (item.impacts, item.passages, item.points if item.logs_states else None):
            if taker is not None:
                taker.take(own, events, states)

    def take_nodes(lane: int, nodes: np.ndarray) -> None:
        owners[lane].take_nodes(lane - int(begins[np.searchsorted(begins, lane, side="right") - 1]), nodes)

    states = [np.broadcast_to(item.states, (len(item.states), item.realizations)).T for item in wanted]
    course = _course(owners, x, v, np.concatenate(states), take, take_nodes)
    places = [slice(first, last) for first, last in pairwise(begins.tolist())]
    limits = Limits([Limit(at, *item.limit) for item, at in zip(wanted, places, strict=True) if item.limit])
    try:
        if wanted[0].earlier is not None:
            _take_up(course, wanted[0].earlier)
        for lane, contact in np.argwhere(course.overlap):
            raise InvalidInput(
                f"The bodies of contact {owners[lane].rows[contact]!r} overlap by "
                f"{course.overlap[lane, contact]:g} m where the run begins; give another clearance= or initial=."
            )
        course.run(lambda lane, contact: owners[lane].rows[contact], show, limits)
    except ImpactLabError as error:
        if len(wanted) == 1:
            return [error]
        again = [replace(item) for item in wanted]  # without the impacts that were taken
        return [found for item in again for found in _run([item], lambda part: None)]  # the fault is that of one
    result: list[Traced | ImpactLabError] = []
    for item, begin in zip(wanted, begins.tolist(), strict=False):
        lanes = slice(begin, begin + item.realizations)
        if item.impacts is not None:
            item.impacts.end(course.lanes, begin)
        if item.points is not None and item.strobe is not None:
            looks = item.sampling.places[STROBE]
            item.points.take_samples(item.sampling.times[looks], course.lanes.samples[lanes, looks])
        lost = [course.stuck[lane] for lane in range(lanes.start, lanes.stop) if lane in course.stuck]
        known = limits.beyond.get(begin) or (Stuck(lost[0]) if lost else None)
        result.append(known or Traced(item, course, lanes))
    return result


def _course(
    owners: Sequence[Wanted], x: np.ndarray, v: np.ndarray, states: np.ndarray, take: Taken, take_nodes: NodesTaken
) -> Course | SmoothCourse:
    """Return the lanes of networks that are alike, one for each owner, before they run, and let events be taken."""
    first, scenes = owners[0], [item.scene for item in owners]
    taken = take if first.impacts or first.passages or first.logs_states else None
    noded = take_nodes if first.integrated else None
    begin, end = (np.array([times]) for times in zip(*((item.starts_at, item.end) for item in owners), strict=True))
    when = begin.ravel(), end.ravel(), np.stack([item.sampling.times for item in owners]), first.span
    if isinstance(first.scene, Smooth):
        return SmoothCourse(scenes, x, v, states, *when, taken, first.logs_states, noded=noded)  # type: ignore[arg-type]
    return Course(as_lanes(scenes), x, v, *when, taken is not None, first.logs_states, taken, noded)  # type: ignore[arg-type]


def _take_up(course: Course | SmoothCourse, earlier: Earlier) -> None:
    """Let lanes go on from the end of an earlier run."""
    bodies = slice(course.lanes.v.shape[1] - course.sliders)
    given = [item[:, bodies].copy() for item in (course.lanes.x, course.lanes.v)]
    go_on(course.lasting, earlier.numbers)
    same = map(np.array_equal, given, (item[:, bodies] for item in (course.lanes.x, course.lanes.v)))
    if not all(same):
        raise InvalidInput("This state was changed; without continues=True it is a start.")
    course.overlap[:] = 0.0


class Traced(NamedTuple):
    """A network whose lanes have been run."""

    wanted: Wanted
    course: Course | SmoothCourse
    lanes: slice
    elsewhere: str = ""  # by how much it depends on how it begins, if this is known

    @property
    def forgets(self) -> bool:
        """Whether statistics are to be those of a motion that has forgotten its start, though nothing is linear."""
        wanted, model = self.wanted, self.wanted.model
        if wanted.configuration["simulate"]["initial"] is not None or wanted.trajectory is not None or self.chaotic:
            return False
        led = model.sources["force"].names or model.kicks.timed.any() or not model.bodies.free.all()
        relaxation = relaxation_time(damped(model)[1])
        nonlinear = len(model.ends) or model.kicks.nonlinear.any()
        return bool(led and nonlinear and relaxation > 0.0 and wanted.spin_up and settles(wanted.spin_up, relaxation))

    def begun_elsewhere(self) -> Wanted:
        """Return the same run with velocities other than those of rest, (realization)."""
        x, velocity = np.zeros(len(self.wanted.model.bodies)), np.sqrt(self.means[:, 3].mean(axis=0))
        free = self.wanted.model.bodies.free
        x[free] = self.wanted.at_start()[0][0, : free.sum()]
        start = np.stack([np.stack([x, times * velocity]) for times in STARTS], axis=-1)
        given = {**self.wanted.configuration, "simulate": {"initial": "given"}}  # these begin nowhere else
        return replace(
            self.wanted, start=start, realizations=len(STARTS), records=(), configuration=given, steps=lambda: 0.0
        )

    def difference(self, other: Traced) -> str:
        """Say by how much another run of the network has other means, if it has."""
        usual, others = (item.means[:, [0, 1, 3]] for item in (self, other))
        return difference_of_starts(usual.mean(axis=0), others, self.wanted.model.bodies.names)

    def findings(self) -> Findings:
        """Return the variables and attributes of the dataset, and warn of a path that rounding changes."""
        wanted, model = self.wanted, self.wanted.model
        self.doubt()
        if self.elsewhere:
            warn("several_motions", self.elsewhere)
        snapshot = wanted.snapshots.snapshot
        each = self.statistics()
        coordinates = labels_of(model.bodies.names, model.contacts.names, [name for name, _ in model.points])
        variables = variables_of({item: mean_of(values) for item, values in each.items()}, coordinates)
        if "contact_rate" in variables and self.sums(CHATTERS).any():
            variables["contact_rate"][2]["comment"] = ENDLESS
        if model.contacts.names:
            text = "time over which peaks are taken"
            variables["observation_time"] = labelled((), np.array(wanted.duration), "s", text)
        if wanted.ends:
            variables, coordinates = {}, {}
        for record in wanted.records:
            if isinstance(record, PerRealization):
                variables |= {
                    item.by_realization: labelled(
                        ("realization", item.dimension), values, item.units, f"{item.long_name}, by realization"
                    )
                    for item, values in each.items()
                    if item.dimension in coordinates
                }
            elif isinstance(record, Trajectory):
                variables |= self.paths(record, snapshot)
            elif wanted.points is not None and isinstance(record, Section):
                variables |= record.described(model.bodies.names, [wanted.points.result(wanted.realizations)], "")
            elif wanted.impacts is not None and isinstance(record, Impacts):
                time, taken = np.array([wanted.duration * wanted.realizations]), [wanted.impacts.tally.result()]
                variables |= record.described(
                    model.contacts.names, time, [wanted.realizations], False, OF_EVENTS, taken
                )
            elif wanted.passages is not None and isinstance(record, FirstPassage):
                variables |= record.described(wanted.passages.times, wanted.passages.causes)
            elif isinstance(record, EnergyFlows):
                variables |= self.flows()
            elif isinstance(record, Observable):
                variables |= self.quantity(record)
            elif isinstance(record, FinalState):
                variables |= self.ends(snapshot)
                if record.continues:
                    numbers = numbers_of([item[self.lanes] for item in self.course.lasting])
                    variables[CONTINUATION] = ("realization", "number"), numbers, OF_CONTINUATION
        if wanted.statistics is not None:
            others = unwanted(wanted.statistics)
            variables = {name: item for name, item in variables.items() if name not in others}
        coordinates |= {name: item for name, item in variables.items() if item[0] == (name,)}
        if any("realization" in dims for dims, *_ in variables.values()):
            coordinates["realization"] = ("realization",), np.arange(wanted.realizations), REALIZATION
        variables = {name: item for name, item in variables.items() if name not in coordinates}
        return Findings(variables, coordinates, self.attributes())

    @property
    def path_error(self) -> float:
        """Largest estimated error of a displacement (m)."""
        return float(np.nan_to_num(self.course.lanes.clock[self.lanes, WORST], nan=np.inf).max())

    @property
    def size(self) -> float:
        """Largest root mean square of a displacement (m)."""
        return float(np.sqrt(self.course.lanes.bodies[self.lanes, 1].max(initial=0.0) / self.wanted.duration))

    @property
    def chaotic(self) -> bool:
        """Whether rounding errors have grown until they change the path."""
        return not self.path_error <= NOTICED * self.size

    def doubt(self) -> None:
        """Warn where rounding errors have grown until they change the path, and averages are those of one start."""
        size, start = self.size, self.wanted.start
        if self.chaotic and (isinstance(start, str) or not np.ptp(start, axis=-1).any()):
            warn(
                "chaotic_path",
                f"Rounding has grown to an error of about {min(self.path_error, size):.1g} m in displacements of "
                f"{size:.2g} m, as in chaotic motion: the path is one of many, and averages along it are those of this "
                "path. Average over a longer run, or over starts: initial= with one value for each realization, whose "
                "scatter il.PerRealization() keeps.",
            )

    def sums(self, row: int) -> np.ndarray:
        """Return a sum of contacts, (realization, contact)."""
        return self.course.lanes.contacts[self.lanes, row, : len(self.wanted.model.contacts.names)]

    @property
    def means(self) -> np.ndarray:
        """Means of x, x², v and v² of all realizations, (realization, 4, body)."""
        model, length = self.wanted.model, self.wanted.duration
        free, means = model.bodies.free, self.course.lanes.bodies[self.lanes] / length
        result = np.empty((means.shape[0], 4, len(free)))
        result[:, :, free] = means[:, :, : free.sum()]
        result[:, :, ~free] = _of_given_motions(model, self.wanted.begin, length)
        return result

    def statistics(self) -> dict[Any, np.ndarray]:
        """Return the statistics of all realizations, (realization, …)."""
        model, length = self.wanted.model, self.wanted.duration
        of_bodies = self.means
        of_points = self.course.lanes.bodies[self.lanes, :, self.course.lanes.x.shape[1] :] / length
        found = {}
        for statistics, values in ((STATISTICS, of_bodies), (OF_POINTS, of_points)):
            x, xx, v, vv = values.transpose(1, 0, 2)
            known = {
                "mean_displacement": x,
                "mean_square_displacement": xx,
                "variance_displacement": np.maximum(xx - x**2, 0.0),
                "mean_velocity": v,
                "mean_square_velocity": vv,
            }
            for name, item in statistics.items():
                if item.dimension in (BODY, POINT):
                    found[item] = known[name.removeprefix("point_")]
        impulsive = model.contacts.impulsive
        of_contacts = {
            "contact_ratio": self.sums(RATIO) / length,
            "contact_rate": np.where(self.sums(CHATTERS) > 0.0, np.nan, self.sums(CLOSINGS) / length),
            "mean_contact_force": self.sums(PRESSED) / length,
            "peak_contact_force": np.where(impulsive, np.nan, self.sums(PEAK)),
        }
        found |= {STATISTICS[name]: values for name, values in of_contacts.items()}
        if impulsive.all():  # there is no peak
            del found[STATISTICS["peak_contact_force"]]
        return found

    def flows(self) -> Variables:
        """Return the powers of forces, and what is stored."""
        wanted, lanes, free = self.wanted, self.course.lanes, self.wanted.model.bodies.free
        energy, bodies, inner = wanted.energy, int(self.wanted.model.bodies.free.sum()), lanes.x.shape[1]
        assert energy is not None
        squares = np.zeros((len(free), wanted.realizations))
        squares[free] = lanes.bodies[self.lanes, 3, :bodies].T
        first = lanes.samples[self.lanes, np.searchsorted(wanted.sampling.times, wanted.begin)]
        ends = []
        for time, x, v in (
            (wanted.begin, first[:, :inner], first[:, inner : 2 * inner]),
            (wanted.end, lanes.x[self.lanes], lanes.v[self.lanes]),
        ):
            state = np.empty((2, len(free), wanted.realizations))
            state[:, free] = x[:, :bodies].T, v[:, :bodies].T
            for slot, wave in given_waves(wanted.model):
                state[:, slot] = np.reshape(wave.at(time), (2, 1))
            ends.append((state[0], state[1]))
        begin, end = ends
        found = Integrals(lanes.flows[self.lanes].T, squares, begin, end, wanted.duration)
        network = energy.network
        heat = Estimate(*mean_of(self.means[:, 3]))
        powers = labelled_powers(
            network.accounts, energy.powers(found), "", lambda values, _: Estimate(*mean_of(values.T))
        )
        return powers | temperature(network.linear[0], heat)

    def quantity(self, record: Observable) -> Variables:
        """Return the variables of a quantity of one's own."""
        wanted, path = self.wanted, None
        (own,) = (item for item in wanted.quantities if item.record is record)
        if record.interval is not None:
            places = wanted.sampling.places[record.variable]
            times = wanted.sampling.times[places]
            rows = wanted.snapshots.of_samples(times, self.course.lanes.samples[self.lanes][:, places])
            path = wanted.begin, times, rows
        return own.described(wanted.duration, path)

    def paths(self, record: Trajectory, snapshot: Snapshot) -> Variables:
        """Return displacements, velocities and forces over time."""
        model, every = self.wanted.model, self.course.lanes.samples[self.lanes]
        places, forces = self.wanted.sampling.places[TRAJECTORY], snapshot.place("contact_force")
        taken, inner = every[:, places], self.course.lanes.x.shape[1]
        times = record.times(taken.shape[1], self.wanted.begin)
        rows = self.wanted.snapshots.of_samples(times[1], taken)[:, :, : snapshot.size]
        for slot in np.flatnonzero(
            model.contacts.impulsive
        ).tolist():  # impulses since the sample before, also of other records
            impulses = every[:, : places[-1] + 1, 2 * inner + slot]
            rows[:, 1:, forces.start + slot] = np.add.reduceat(impulses, places[:-1] + 1, axis=1) / record.interval
            rows[:, 0, forces.start + slot] = 0.0
        variables: Variables = {"time": times, **record.labels(snapshot)}
        kept: list[Kept] = record.kept(snapshot)
        for item in kept:
            path = np.ascontiguousarray(item.values(rows.transpose(1, 2, 0)).transpose(2, 0, 1))
            dimensions = "realization", "time", item.dimension
            variables[item.quantity.name] = dimensions, path, snapshot.attributes(item.quantity)
        return variables

    def ends(self, snapshot: Snapshot) -> Variables:
        """Return displacements and velocities at the end."""
        model, free, lanes = self.wanted.model, self.wanted.model.bodies.free, self.course.lanes
        variables: Variables = {}
        last = np.array([self.wanted.end])
        for row, (name, values) in enumerate((("displacement", lanes.x), ("velocity", lanes.v))):
            end = np.empty((self.wanted.realizations, len(free)))
            end[:, free] = values[self.lanes, : free.sum()]
            for slot, wave in given_waves(model):
                end[:, slot] = wave.at(last)[row][0]
            attributes = snapshot.attributes(FINAL[name])
            attributes["long_name"] += " at the end"
            variables[name_of(name)] = ("realization", BODY), end, attributes
            if name == "displacement" and model.kicks.states:
                if isinstance(self.course, SmoothCourse):
                    states = self.course.last_states[self.lanes]
                else:
                    states = states_at(model, end, lanes.x[self.lanes, free.sum() :])
                attributes = snapshot.attributes(STATES)
                attributes["long_name"] += " at the end"
                variables |= snapshot.coordinates
                variables[name_of("state")] = ("realization", STATES.dimension), states, attributes
        return variables

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of the whole run."""
        wanted, clock = self.wanted, self.course.lanes.clock[self.lanes]
        random = "Nothing is random: one realization tells all of a start, without standard errors."
        return {
            **provenance(
                "Statistics of a network of oscillators with contacts",
                json_of(wanted.configuration),
                in_one_line(entries(wanted.configuration)),
            ),
            "integrator": type(wanted.method).__name__,
            "event_tolerance": wanted.method.tolerance,
            "events": float(clock[:, COUNT].sum()),
            "evaluations": float(clock[:, EVALUATIONS].sum()),
            "path_error": self.path_error,
            "undecided_touches": float(clock[:, GRAZED].sum()),
            "duration": wanted.duration,
            "spin_up": wanted.spin_up,
            "realizations": wanted.realizations,
            "initial": wanted.start if isinstance(wanted.start, str) else "given",
            **({} if wanted.earlier is None else {BEGIN: wanted.begin}),
            **({"deterministic": random} if wanted.realizations == 1 else {}),
        }


def _of_given_motions(model: Model, begin: float, length: float) -> np.ndarray:
    """Return the means of x, x², v and v² of bodies of given motion, (4, body)."""
    return np.array([wave.means(begin, length) for _, wave in given_waves(model)]).reshape(-1, 4).T
