"""Snapshots of a network: displacements, velocities, contact forces and states of laws at one time, in this order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab.results.labels import Variables
from impactlab.results.schema import BODY, CONTACT, POINT, STATE, Variable

QUANTITIES = {
    quantity.name: quantity
    for quantity in (
        Variable("displacement", BODY, "m", "displacement"),
        Variable("velocity", BODY, "m s-1", "velocity"),
        Variable("contact_force", CONTACT, "N", "contact force"),
    )
}
"""What a snapshot holds, in the order of `impactlab.kernels.sums.write_snapshot`."""


AT_POINTS = {
    quantity: Variable(f"point_{quantity}", POINT, QUANTITIES[quantity].units, f"{quantity} at points")
    for quantity in ("displacement", "velocity")
}
"""What follows of points of structures, by the quantity of the bodies."""

ALL = QUANTITIES | {quantity.name: quantity for quantity in AT_POINTS.values()}
"""Both, by name."""

STATES = Variable("law_state", STATE, "", "state of a law")
"""What else it holds where laws have states, each with units of its own."""

PEAKS = Variable("largest_contact_force", CONTACT, "N", "largest contact force since the last snapshot")
"""And where a record asks for peaks that are read between steps."""

AT_KICKS = Variable("velocity_at_kicks", BODY, "m s-1", "velocity at which the forces of kicks do their work")
"""And where a record asks for the power of forces that kick."""

BY_IMPACTS = Variable("told_by_impacts", "told", "", "what impacts within steps tell")
"""And where a record asks what impacts do within steps. Of each contact what its impacts have lost so far (J), then of
each the impulses since the last snapshot times what was left of their steps (N s2), then of each entry of its links the
energy that they have given to the body so far (J)."""

OF_IMPULSES = (
    "Where a contact is impulsive: its impulse from the sample before (or t = 0) to this one, over the interval."
)
"""What samples of the force of an impulsive contact are."""

TIME = {"units": "s", "long_name": "time"}
"""Attributes of the times of snapshots."""

REALIZATION = {"long_name": "number of the realization"}
"""Attributes of the numbers of realizations."""


def with_points(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by the quantity with those of the same quantities at points."""
    return {**values, **{variable.name: values[quantity] for quantity, variable in AT_POINTS.items()}}


def places_of(names: Sequence[str]) -> dict[str, int]:
    """Return the place of each name: a list that is searched for all of them takes time by the square of its length."""
    return {name: place for place, name in enumerate(names)}


Sums = Sequence[Sequence[tuple[int, float]]]
"""Rows and weights of some weighted sums of rows."""


def weighted_sums(rows: np.ndarray, sums: Sums, axis: int) -> np.ndarray:
    """Return some weighted sums of rows, which are the first axis, along an axis of the result."""
    return np.stack([sum(weight * rows[row] for row, weight in item) for item in sums], axis=axis)


class Reader(NamedTuple):
    """Rows of snapshots, or of sums of their rows, in which a record looks."""

    rows: list[int]
    sums: Sums = ()

    def __call__(self, snapshots: np.ndarray) -> np.ndarray:
        """Return snapshots, or sums, that have these rows as the middle axis."""
        return weighted_sums(snapshots.swapaxes(0, 1), self.sums, 1) if self.sums else snapshots


def recorded(dimension: str) -> str:
    """Return the dimension of some of the names of another dimension."""
    return f"recorded_{dimension}"


def owner_of(name: str) -> str:
    """Return the name of the member of a network that a coordinate, a point or a state belongs to."""
    return name.rpartition(".")[0]


class Kept(NamedTuple):
    """A quantity in trajectories, with all names, or with a selection of names on a dimension of its own."""

    quantity: Variable
    names: tuple[str, ...]
    dimension: str
    reader: Reader
    rows: slice | list[int]

    def values(self, snapshots: np.ndarray) -> np.ndarray:
        """Return the quantity from snapshots [sample, quantity, lane], [sample, name, lane]."""
        found: np.ndarray = self.reader(snapshots)[:, self.rows]
        return found


class Snapshot(NamedTuple):
    """Names of the bodies, contacts and states in a snapshot, of the states with units, and of points.

    The displacement and the velocity of a point are weighted sums of the rows of bodies. Velocities at kicks and peaks
    of contact forces come last, if there are any. Forces of impulsive contacts are means since the snapshot before.
    """

    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    states: tuple[tuple[str, str], ...] = ()
    points: tuple[tuple[str, tuple[tuple[int, float], ...]], ...] = ()
    peaked: bool = False  # whether peaks of contact forces come last
    impulsive: tuple[int, ...] = ()  # slots of the impulsive contacts
    kicked: bool = False  # whether velocities at kicks come before these peaks
    told: int = 0  # rows of what impacts tell, which come before these velocities

    @property
    def size(self) -> int:
        """Rows of a snapshot."""
        more = self.told + len(self.names(AT_KICKS.name)) + len(self.names(PEAKS.name))
        return 2 * len(self.bodies) + len(self.contacts) + len(self.states) + more

    @property
    def quantities(self) -> list[Variable]:
        """Quantities in a snapshot, or derived from one: without contacts there are no forces."""
        every = (*QUANTITIES.values(), STATES, *AT_POINTS.values())
        return [quantity for quantity in every if self.names(quantity.name)]

    @property
    def coordinates(self) -> Variables:
        """Names of the states, if there are any; those of bodies and contacts every dataset has."""
        if not self.states:
            return {}
        labels = np.array([name for name, _ in self.states])
        return {STATE: ((STATE,), labels, {"long_name": "state", "comment": self.units})}

    @property
    def units(self) -> str:
        """The units of the states."""
        units = dict.fromkeys(f"{name.rpartition('.')[2]} {units}" for name, units in self.states)
        return f"units: {', '.join(units)}"

    def attributes(self, quantity: Variable) -> dict[str, str]:
        """Return the attributes of a quantity."""
        if quantity is not STATES:
            comment = {"comment": OF_IMPULSES} if quantity.name == "contact_force" and self.impulsive else {}
            return {"units": quantity.units, "long_name": quantity.long_name, **comment}
        return {"long_name": quantity.long_name, "comment": self.units}

    @property
    def impulsive_rows(self) -> np.ndarray:
        """Rows of the forces of impulsive contacts."""
        first: int = self.place("contact_force").start
        return first + np.array(self.impulsive, dtype=np.int64)

    def names(self, quantity: str) -> tuple[str, ...]:
        """Return the names that have a quantity."""
        if quantity == STATES.name:
            return tuple(name for name, _ in self.states)
        if quantity in (item.name for item in AT_POINTS.values()):
            return tuple(name for name, _ in self.points)
        if quantity == BY_IMPACTS.name:
            return tuple(map(str, range(self.told)))
        if quantity == PEAKS.name:
            return self.contacts if self.peaked else ()
        if quantity == AT_KICKS.name:
            return self.bodies if self.kicked else ()
        return self.contacts if QUANTITIES[quantity].dimension == CONTACT else self.bodies

    def place(self, quantity: str) -> slice:
        """Return the rows of a quantity."""
        bodies, first = len(self.bodies), 0
        if quantity != "displacement":
            first = bodies if quantity == "velocity" else 2 * bodies
        if quantity in (STATES.name, BY_IMPACTS.name, AT_KICKS.name, PEAKS.name):
            first += len(self.contacts)
        if quantity in (BY_IMPACTS.name, AT_KICKS.name, PEAKS.name):
            first += len(self.states)
        if quantity in (AT_KICKS.name, PEAKS.name):
            first += self.told
        if quantity == PEAKS.name:
            first += len(self.names(AT_KICKS.name))
        return slice(first, first + len(self.names(quantity)))

    def kept(self, names: Sequence[str] | None, quantities: Sequence[str] | None) -> list[Kept]:
        """Return quantities of some names, all by default; ``name`` is also that of all ``name.…``."""
        result, wanted = [], set(names or ())
        for item in self.quantities:
            if quantities is not None and item.name not in quantities:
                continue
            known = self.names(item.name)
            if names is None and item.dimension != POINT:  # views of the rows, which may be many
                result.append(Kept(item, known, item.dimension, Reader([]), self.place(item.name)))
                continue
            own = known if names is None else tuple(name for name in known if wanted & {name, owner_of(name)})
            dimension = item.dimension if names is None else recorded(item.dimension)
            reader = self.reader(item.name, own)
            result += [Kept(item, own, dimension, reader, reader.rows)] if own else []
        return result

    def reader(self, quantity: str, names: Sequence[str]) -> Reader:
        """Return a reader of a quantity for bodies, points, contacts or states by name."""
        return self.reader_of([(quantity, name) for name in names])

    def reader_of(self, items: Sequence[tuple[str, str]]) -> Reader:
        """Return a reader of quantities for names, pair by pair; names may be points."""
        points = dict(self.points)
        of_contacts = {"contact_force", STATES.name}
        if not any(name in points and quantity not in of_contacts for quantity, name in items):
            places = {name: places_of(self.names(name)) for name in {quantity for quantity, _ in items}}
            return Reader([self.place(quantity).start + places[quantity][name] for quantity, name in items])
        slots, sums = {name: ((slot, 1.0),) for slot, name in enumerate(self.bodies)} | points, []
        for quantity, name in items:
            first = self.place(quantity.removeprefix("point_")).start
            sums.append([(first + slot, share) for slot, share in slots[name]])
        return Reader(list(range(len(items))), sums)

    def values(self, quantity: Variable, snapshots: np.ndarray) -> np.ndarray:
        """Return a quantity from snapshots, whose rows are the last axis."""
        if quantity.dimension != POINT:
            return snapshots[..., self.place(quantity.name)]
        sums = self.reader(quantity.name, self.names(quantity.name)).sums
        return weighted_sums(np.moveaxis(snapshots, -1, 0), sums, -1)

    def labelled(self, values: np.ndarray, *dimensions: str) -> Variables:
        """Return variables of snapshots along other dimensions, the rows of which are the last axis."""
        return self.coordinates | {
            item.name: ((*dimensions, item.dimension), self.values(item, values), self.attributes(item))
            for item in self.quantities
        }
