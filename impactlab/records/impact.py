"""Records of impacts: lists of all of them, or distributions of their quantities."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput
from impactlab.inputs import suggestion
from impactlab.kernels.event_log import BEGAN, CLOSING, EVENT
from impactlab.kernels.impacts_at_steps import (
    INSIDE,
    LAST_FORCE,
    LAST_GAP,
    LAST_RATE,
    ONGOING,
    ROWS_OF_CONTACT,
    end_impacts,
    follow_impacts,
)
from impactlab.plan.plan import Plan
from impactlab.records.impact_tables import OF_IMPACTS, Described, Tally, labels
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables
from impactlab.results.snapshot import PEAKS, places_of
from impactlab.statistics.subsamples import OF_BAND, mean_of_subsamples, subsample_count, subsamples_of

IN_STEPS = {
    "closing_velocity": "The slope of the cubic through gaps and rates at two steps, where it crosses 0. A contact "
    "that closes and opens, or opens and closes, between two steps is not seen: under white noise this happens to the "
    "slowest.",
    "leaving_velocity": "The slope of the cubic through gaps and rates at two steps, where it crosses 0.",
    "duration": "Between crossings of the cubic through gaps and rates at two steps.",
    "impulse": "The sum of the forces at the steps, as they kick the bodies.",
    "largest_force": "That at the steps, and between them where the force depends on the rate.",
    "lost_energy": "By the trapezoidal rule from step to step; forces without losses leave an error of it.",
}
"""How accurate quantities are where steps are made."""


class Impacts(Record):
    """Each impact of the contacts: when, how fast, how long, how hard, and the energy that it takes.

    By default impacts are listed, as a ragged array by the CF conventions: along the dimension ``impact`` those of one
    contact in one realization follow each other, and ``impact_series_size`` tells how many these are. With `bins` they
    are counted into bins instead, without lists. Both tell how often contacts close, by counting, and means over
    impacts that begin and end within the run and leave no contact at rest.

    With `EventLocated` all numbers are exact to rounding, or as accurate as the path where forces are not linear, and
    the impacts of rigid contacts are impulses of the duration 0. With other methods impacts are put together from gaps,
    rates and forces at the steps; rigid contacts are refused then. All steps are taken, without contact-free intervals.

    Parameters
    ----------
    contacts : sequence of str, optional
        Contacts; all by default.
    quantities : sequence of str, optional
        "closing_velocity", "leaving_velocity", "duration", "impulse", "largest_force" and "lost_energy"; all by
        default.
    bins : int, optional
        Number of bins of the distributions; without, impacts are listed.
    limits : mapping of str to pair of float, optional
        Lower and upper limit of the bins by the name of the quantity; by default bins begin at 0, and are as wide as
        the largest value needs, a power of two.
    most : int
        How many impacts may be listed, in all realizations; a run with more of them ends with an error.

    Examples
    --------
    >>> il.Impacts(contacts=["stop"], quantities=["closing_velocity"], bins=50)
    Impacts(contacts=('stop',), quantities=('closing_velocity',), bins=50)
    """

    contacts: tuple[str, ...] | None = parameter(None)
    quantities: tuple[str, ...] | None = parameter(None)
    bins: int | None = parameter(None, minimum=1)
    limits: Any = parameter(None)
    most: int = parameter(1_000_000, minimum=1)

    every_step: ClassVar[bool] = True
    peaks: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        for field in ("contacts", "quantities"):
            if getattr(self, field) == ():
                raise InvalidInput(f"Impacts.{field} has no name; leave it out for all.")
        for name in self.quantities or ():
            if name not in OF_IMPACTS:
                raise InvalidInput(f"Impacts.quantities: {suggestion(name, OF_IMPACTS)}")
        object.__setattr__(self, "limits", _plain(self.limits))
        if self.limits and self.bins is None:
            raise InvalidInput("Impacts: limits= are those of bins; give bins=, or leave them out.")

    @property
    def wanted(self) -> tuple[str, ...]:
        """Names of the quantities that are wanted."""
        return self.quantities or tuple(OF_IMPACTS)

    def resolved(self, model: Model) -> Record:
        known = places_of(tuple(model.network.contacts))
        names = self.contacts or tuple(known)
        for name in names:
            if name not in known:
                raise InvalidInput(f"Impacts: there is no contact {name!r}; {suggestion(name, known)}")
            if model.contacts.round[known[name]]:
                raise InvalidInput(
                    f"Impacts: {name!r} is a round contact, whose impacts are not recorded; name others in contacts=."
                )
        return self.replace(contacts=names)

    def stride(self, model: Model, step: float) -> int:
        for slot in self.slots(tuple(model.network.contacts)):
            if model.contacts.impulsive[slot]:
                raise InvalidInput(
                    f"Impacts: {model.contacts.names[slot]!r} is rigid, and steps do not tell its impacts apart; use "
                    "integrator=il.EventLocated() where nothing is random, or name others in contacts=."
                )
        return 1

    def slots(self, contacts: tuple[str, ...]) -> list[int]:
        """Return the places of the contacts among all."""
        known = places_of(contacts)
        return [known[name] for name in self.contacts or contacts]

    def tally(self, subsamples: tuple[int, int], share: float) -> Tally:
        """Return what takes the impacts of a share of the realizations."""
        most, count = math.ceil(self.most * share), len(self.contacts or ())
        return Tally(self.bins, dict(self.limits or ()), self.wanted, count, subsamples, most)

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Followed(self, run.plan, realizations)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        plan = run.plan
        lanes, time = [int(result["lanes"]) for result in results], np.zeros(subsample_count(plan))
        for result in results:
            time += result["time"]
        found = self.described(plan.system.contacts, time, lanes, plan.realizations.trusted, IN_STEPS, results)
        if plan.realizations.losses:
            numbers = plan.realizations.finite_places.astype(np.int32)
            for name in {"impact_realization", "impact_series_realization"} & found.keys():
                dimensions, places, attributes = found[name]
                found[name] = dimensions, numbers[places], attributes
        return found

    def described(
        self, contacts: tuple[str, ...], time: np.ndarray, lanes: list[int], trusted: bool, comments: dict[str, str],
        results: list[dict[str, np.ndarray]],
    ) -> Variables:  # fmt: skip
        """Return the variables of a run, from the time observed in each subsample and the results of its blocks."""
        if not contacts:
            return {}
        slots, limits = self.slots(contacts), dict(self.limits or ())

        def mean(sums: np.ndarray, samples: np.ndarray, inner: slice) -> tuple[np.ndarray, np.ndarray, float]:
            return mean_of_subsamples(sums, samples, trusted, inner)

        run = Described(contacts, slots, self.wanted, self.bins, limits, time, lanes, mean, OF_BAND, comments)
        return labels(run, results)

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        return 0 if self.bins else math.ceil(8 * EVENT * self.most / run.realizations)

    def bytes_per_block(self, run: RecordedRun) -> int:
        rows = len(self.wanted) * len(self.contacts or ()) * subsample_count(run.plan)
        return 8 * rows * ((self.bins or 0) + 4)


class _Followed(Keeper):
    """Follows contacts from step to step."""

    wants_start = True

    def __init__(self, record: Impacts, plan: Plan, realizations: np.ndarray) -> None:
        super().__init__()
        self.step, self.begin = plan.clock.step, plan.clock.begin
        slots, lanes = record.slots(plan.system.contacts), len(realizations)
        self.subsamples = subsamples_of(plan, realizations)
        self.time, self.batch = np.zeros(subsample_count(plan)), 0
        first = int(self.subsamples.min())
        self.tally = record.tally(
            (first, int(self.subsamples.max()) - first + 1), lanes / max(plan.realizations.number, 1)
        )
        place = {name: plan.snapshot.place(name).start for name in ("displacement", "velocity", "contact_force")}
        ends, bodies = [plan.system.ends.chosen(np.array([slot])) for slot in slots], len(plan.system.bodies)
        moving = [item.slots < bodies for item in ends]
        sizes = [int(some.sum()) for some in moving]
        rows = _joined([item.slots[some] for item, some in zip(ends, moving, strict=True)], np.int64)
        weights = _joined([item.weights[some] for item, some in zip(ends, moving, strict=True)], float)
        chosen = np.array(slots, dtype=np.int64)
        forces = place["contact_force"] + chosen
        largest = plan.snapshot.place(PEAKS.name).start + chosen if plan.snapshot.peaked else forces
        self.along = (
            np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64), place["displacement"] + rows,
            place["velocity"] + rows, weights, plan.system.clearance[chosen], forces, largest,
            plan.observed.rated[chosen],
        )  # fmt: skip
        self.known = np.zeros((ROWS_OF_CONTACT, len(slots), lanes))
        # impacts that are taken at a time, at least
        self.rows = np.empty((max(4096, 2 * len(slots) * lanes), EVENT))

    def start(self, values: np.ndarray) -> None:
        begin, places, paces, weights, clearance, forces, *_ = self.along
        for contact in range(len(forces)):
            some = slice(begin[contact], begin[contact + 1])
            self.known[LAST_GAP, contact] = weights[some] @ values[places[some]] - clearance[contact]
            self.known[LAST_RATE, contact] = weights[some] @ values[paces[some]]
        self.known[LAST_FORCE] = values[forces]
        self.known[INSIDE] = np.where(self.known[LAST_GAP] > 0.0, 2.0, 0.0)
        self.known[ONGOING + CLOSING - BEGAN] = np.nan

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        self.batch, sample = batch, 0
        np.add.at(self.time, self.subsamples[batch], len(snapshots) * self.step)
        steps = float(self.begin + self.seen + 1), self.step
        while sample < len(snapshots):
            sample, number = follow_impacts(
                snapshots, sample, steps, self.along, self.known, self.subsamples[batch], self.rows
            )
            if number:
                self.tally.take(self.rows[:number])
        self.seen += len(snapshots)

    def result(self) -> dict[str, np.ndarray]:
        number = end_impacts((self.begin + self.seen) * self.step, self.known, self.subsamples[self.batch], self.rows)
        if number:
            self.tally.take(self.rows[:number])
        lanes = np.array(self.known.shape[2])
        return {**self.tally.result(), "time": self.time, "lanes": lanes}


def _joined(arrays: list[np.ndarray], kind: Any) -> np.ndarray:
    """Return arrays one after the other, of which there may be none."""
    return np.concatenate([np.zeros(0, kind), *arrays]).astype(kind)


def _plain(limits: Any) -> Any:
    """Return limits as pairs (name, (low, high)), or refuse them."""
    if limits is None:
        return None
    items = limits.items() if isinstance(limits, Mapping) else limits
    try:
        plain = tuple((str(name), (float(low), float(high))) for name, (low, high) in items)
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"Impacts.limits are {{quantity: (low, high)}}, not {limits!r}.") from error
    for name, (low, high) in plain:
        if name not in OF_IMPACTS:
            raise InvalidInput(f"Impacts.limits: {suggestion(name, OF_IMPACTS)}")
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise InvalidInput(f"Impacts.limits of {name!r} must be two increasing finite numbers, not {low, high}.")
    return plain
