"""Sections: the states of a network at the times at which its motion meets a surface."""

from __future__ import annotations

import math

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import take_part
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput, warn
from impactlab.inputs import known_name, suggestion
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.records.surface import AtContact, Crossing, SectionPoints, Strobe, Surface
from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import BODY
from impactlab.results.snapshot import places_of

IN_STEPS = "Between steps, by Hermite's cubic: a crossing and one back within a step are not seen."
"""How accurate crossings are where steps are made."""

LENGTH = "section"
"""Dimension of the points."""

BISECTIONS = 40
"""Halvings that find a crossing between two steps, to rounding of a double."""


class Section(Record):
    """The states in which a motion meets a surface: stroboscopic and Poincaré sections, impact maps.

    The variables ``section_displacement`` and ``section_velocity`` have the points of each realization along the
    dimension ``section``, in the order of their times ``section_time``. Where realizations have different numbers of
    points, as ``section_points`` tells, the rest is NaN. At a contact there is ``section_contact_velocity``, too: its
    closing or leaving velocity. Points of the spin-up are left out.

    With `EventLocated`, the default where nothing is random, points are as exact as the path. With other methods those
    of a strobe are at steps, and crossings are found between steps, so that rigid contacts are refused there.

    Parameters
    ----------
    surface : Strobe, AtContact or Crossing
        Where the motion is looked at.
    names : sequence of str, optional
        Bodies that are kept; all by default.
    keep : int, optional
        The last so many points of each realization are kept; all by default.
    most : int
        How many points may be kept of all realizations; a run with more of them ends with an error.

    Examples
    --------
    >>> il.Section(il.Strobe(0.5), keep=100)
    Section(surface=Strobe(period=0.5), keep=100)
    """

    surface: Surface = parameter()
    names: tuple[str, ...] | None = parameter(None)
    keep: int | None = parameter(None, minimum=1)
    most: int = parameter(1_000_000, minimum=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        take_part(self, "surface", Surface, "a surface such as il.Strobe(0.5)")

    @property
    def every_step(self) -> bool:  # type: ignore[override]
        """Whether it needs samples within contact-free intervals."""
        return not isinstance(self.surface, Strobe)

    @property
    def first_sample(self) -> float:
        surface = self.surface
        return surface.first if isinstance(surface, Strobe) else 0.0

    def going_on(self, begin: float) -> Record:
        surface = self.surface
        return (
            self.replace(surface=surface.replace(start=surface.start - begin)) if isinstance(surface, Strobe) else self
        )

    def exact_interval(self) -> float | None:
        return self.surface.period if isinstance(self.surface, Strobe) else None

    def resolved(self, model: Model) -> Record:
        surface, bodies = self.surface, model.bodies.names
        if isinstance(surface, AtContact):
            known = tuple(model.network.contacts)
            if surface.contact not in known:
                raise InvalidInput(
                    f"AtContact: there is no contact {surface.contact!r}; {suggestion(surface.contact, known)}"
                )
            if model.contacts.round[known.index(surface.contact)]:
                raise InvalidInput(f"AtContact: {surface.contact!r} is a round contact, which has no sections.")
        if isinstance(surface, Crossing):
            known_name("oscillator", surface.body, bodies)
        known_bodies = places_of(bodies)
        for name in self.names or ():
            known_name("oscillator", name, known_bodies)
        return self.replace(names=tuple(self.names or bodies))

    def stride(self, model: Model, step: float) -> int:
        if isinstance(self.surface, Strobe):
            return round(self.surface.period / step)
        if isinstance(self.surface, AtContact):
            slot = model.contacts.names.index(self.surface.contact)
            if model.contacts.impulsive[slot]:
                raise InvalidInput(
                    f"AtContact: {self.surface.contact!r} is rigid, and steps do not tell its impacts apart; use "
                    "integrator=il.EventLocated() where nothing is random, or il.Strobe."
                )
        return 1

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        points = self.points(len(realizations) / max(run.realizations, 1))
        return (_Strobed if isinstance(self.surface, Strobe) else _Crossed)(self, run, points, len(realizations), ratio)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        return self.described(run.names("displacement"), results, IN_STEPS if self.every_step else "")

    def points(self, share: float = 1.0) -> SectionPoints:
        """Return what takes the points of a share of the realizations."""
        return SectionPoints(self.keep, math.ceil(self.most * share))

    def described(self, bodies: tuple[str, ...], results: list[dict[str, np.ndarray]], comment: str) -> Variables:
        """Return the variables of a run from the points of its blocks, with a comment on their accuracy."""
        names = self.names or bodies
        sizes = np.concatenate([result["sizes"] for result in results])
        longest = int(sizes.max(initial=0))
        if not longest:
            warn(
                "no_section",
                f"The motion never meets {self.surface!r}, so that its section is empty; give another surface, such as "
                "il.Strobe(period), or a longer run.",
            )
        inside = np.arange(longest) < sizes[:, None]
        values = np.full((len(sizes), longest, 2 + 2 * len(names)), np.nan)
        values[inside] = np.concatenate([result["values"] for result in results])
        dimension = BODY if names == bodies else f"{LENGTH}_{BODY}"
        each, among = ("realization", LENGTH), ("realization", LENGTH, dimension)
        place, rate = values[:, :, 2 : 2 + len(names)], values[:, :, 2 + len(names) :]
        variables = {
            "section_time": labelled(each, values[:, :, 0], "s", "time of a point of the section"),
            "section_displacement": labelled(among, place, "m", "displacement in the section"),
            "section_velocity": labelled(among, rate, "m s-1", "velocity in the section"),
            "section_points": labelled(("realization",), sizes, "1", "number of points of the section"),
        }
        if isinstance(self.surface, AtContact):
            text = f"{self.surface.side} velocity of {self.surface.contact!r} in the section"
            variables["section_contact_velocity"] = labelled(each, values[:, :, 1], "m s-1", text)
        if comment:
            variables["section_time"][2]["comment"] = comment
        if dimension != BODY:
            variables[dimension] = (dimension,), np.array(names), {"long_name": "oscillator in the section"}
        return variables

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        most = self.most if self.keep is None else min(self.most, self.keep * run.realizations)
        if isinstance(self.surface, Strobe):
            most = min(most, (math.floor(run.duration / self.surface.period) + 1) * run.realizations)
        return math.ceil(16 * (1 + len(self.names or ())) * most / run.realizations)


class _Strobed(Keeper):
    """Takes the points of a strobe."""

    wants_start = True

    def __init__(self, record: Section, run: RecordedRun, points: SectionPoints, lanes: int, ratio: int) -> None:
        super().__init__(ratio, round(record.first_sample / run.interval(1)))
        self.record, self.run, self.points, self.lanes, self.number = record, run, points, lanes, 0

    def start(self, values: np.ndarray) -> None:
        if self.seen == 0 and self.run.begin > 0.0:  # the earlier run has looked then
            self.number = 1
        elif self.seen == 0:
            self._take(values[None])

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        self._take(self.own(snapshots))

    def _take(self, samples: np.ndarray) -> None:
        names, (count, _, lanes) = self.record.names, samples.shape
        first, period = self.run.begin + self.record.first_sample, self.record.surface.period  # type: ignore[attr-defined]
        values = np.full((count, lanes, 2 + 2 * len(names or ())), np.nan)
        values[:, :, 0] = (first + period * (self.number + np.arange(count)))[:, None]
        both = [self.run.values(samples, quantity, names) for quantity in ("displacement", "velocity")]
        values[:, :, 2:] = np.concatenate(both, axis=1).swapaxes(1, 2)
        self.points.take(np.tile(np.arange(lanes), count), values.reshape(count * lanes, -1))
        self.number += count

    def result(self) -> dict[str, np.ndarray]:
        return self.points.result(self.lanes, 2 + 2 * len(self.record.names or ()))


class _Crossed(Keeper):
    """Looks for crossings between steps."""

    wants_start = True

    def __init__(self, record: Section, run: RecordedRun, points: SectionPoints, lanes: int, ratio: int) -> None:
        super().__init__()
        self.run, self.points, self.lanes, self.step = run, points, lanes, run.step
        bodies, surface, system = run.names("displacement"), record.surface, run.plan.system
        places = places_of(bodies)
        self.kept = [places[name] for name in record.names or bodies]
        self.links, self.offset, self.sign = np.zeros(len(bodies)), 0.0, 1.0 if surface.inwards else -1.0
        self.speed = isinstance(surface, AtContact)
        if isinstance(surface, AtContact):
            slot = system.contacts.index(surface.contact)
            ends = system.ends.chosen(np.array([slot]))
            moving = ends.slots < len(bodies)
            np.add.at(self.links, ends.slots[moving], ends.weights[moving])
            self.offset = system.clearance[slot]
        elif isinstance(surface, Crossing):
            self.links[places[surface.body]], self.offset = 1.0, surface.level
        self.before = np.zeros((0, 0, 0))

    def start(self, values: np.ndarray) -> None:
        self.before = values[None].copy()

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        joined = np.concatenate([self.before, snapshots])
        x, v = (self.run.values(joined, quantity) for quantity in ("displacement", "velocity"))
        gap = self.sign * (np.einsum("b,sbl->sl", self.links, x) - self.offset)
        step, lane = np.nonzero((gap[:-1] < 0.0) & (gap[1:] >= 0.0))
        ends = x[step, :, lane], v[step, :, lane], x[step + 1, :, lane], v[step + 1, :, lane]
        low, high = np.zeros(len(step)), np.ones(len(step))
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            beyond = self.sign * (_between(ends, self.step, middle)[0] @ self.links - self.offset) >= 0.0
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        place, rate = _between(ends, self.step, high)
        values = np.empty((len(step), 2 + 2 * len(self.kept)))
        values[:, 0] = self.run.begin + (self.seen + step + high) * self.step
        values[:, 1] = self.sign * (rate @ self.links) if self.speed else np.nan
        values[:, 2:] = np.concatenate([place[:, self.kept], rate[:, self.kept]], axis=1)
        self.points.take(lane, values)
        self.before, self.seen = snapshots[-1:].copy(), self.seen + len(snapshots)

    def result(self) -> dict[str, np.ndarray]:
        return self.points.result(self.lanes, 2 + 2 * len(self.kept))


def _between(ends: tuple[np.ndarray, ...], step: float, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements and velocities at parts of steps, (crossing, body), by Hermite's cubic."""
    x, v, later_x, later_v = ends
    u, rise = share[:, None], later_x - x
    bend, twist = 3.0 * rise - step * (2.0 * v + later_v), step * (v + later_v) - 2.0 * rise
    place = x + u * (step * v + u * (bend + u * twist))
    return place, v + u * (2.0 * bend + 3.0 * u * twist) / step
