"""Snapshots of a network: displacements, velocities, contact forces and states of laws at one time, in this order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from impactlab.results.labels import Variables
from impactlab.results.schema import BODY, CONTACT, POINT, Variable

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

STATES = Variable("law_state", "state", "", "state of a law")
"""What else it holds where laws have states, each with units of its own."""

TIME = {"units": "s", "long_name": "time"}
"""Attributes of the times of snapshots."""


class Snapshot(NamedTuple):
    """Names of the bodies, contacts and states in a snapshot, of the last with units, and of points that follow.

    With the names of points there are the bodies of which each is a weighted sum, and their weights.
    """

    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    states: tuple[tuple[str, str], ...] = ()
    points: tuple[tuple[str, tuple[tuple[int, float], ...]], ...] = ()

    @property
    def size(self) -> int:
        """Rows of a snapshot."""
        return 2 * len(self.bodies) + len(self.contacts) + len(self.states)

    @property
    def quantities(self) -> list[Variable]:
        """Those that it has, or that follow: without contacts there are no forces."""
        every = (*QUANTITIES.values(), STATES, *AT_POINTS.values())
        return [quantity for quantity in every if self.names(quantity.name)]

    @property
    def coordinates(self) -> Variables:
        """Names of the states, if there are any; those of bodies and contacts every dataset has."""
        labels = np.array([name for name, _ in self.states])
        return {STATES.dimension: ((STATES.dimension,), labels, {"long_name": "state"})} if self.states else {}

    def attributes(self, quantity: Variable) -> dict[str, str]:
        """Return the attributes of a quantity."""
        if quantity is not STATES:
            return {"units": quantity.units, "long_name": quantity.long_name}
        units = dict.fromkeys(f"{name.rpartition('.')[2]} {units}" for name, units in self.states)
        return {"long_name": quantity.long_name, "comment": f"units: {', '.join(units)}"}

    def names(self, quantity: str) -> tuple[str, ...]:
        """Return what a quantity is known of."""
        if quantity == STATES.name:
            return tuple(name for name, _ in self.states)
        if quantity in (item.name for item in AT_POINTS.values()):
            return tuple(name for name, _ in self.points)
        return self.contacts if QUANTITIES[quantity].dimension == CONTACT else self.bodies

    def place(self, quantity: str) -> slice:
        """Return the rows of a quantity."""
        bodies, first = len(self.bodies), 0
        if quantity != "displacement":
            first = bodies if quantity == "velocity" else 2 * bodies
        if quantity == STATES.name:
            first += len(self.contacts)
        return slice(first, first + len(self.names(quantity)))

    def row(self, quantity: str, name: str) -> int:
        """Return the row of a quantity of one body or contact."""
        first: int = self.place(quantity).start
        return first + self.names(quantity).index(name)

    def rows(self, quantity: str, names: Sequence[str], snapshots: np.ndarray) -> tuple[np.ndarray, list[int]]:
        """Return snapshots, whose rows are the middle axis, with those of a quantity of some names, and these rows.

        The names may be those of points where a quantity of bodies is wanted.
        """
        of_bodies, points = quantity.removeprefix("point_"), dict(self.points)
        if not any(name in points for name in names):
            return snapshots, [self.row(quantity, name) for name in names]
        result = np.zeros((len(snapshots), len(names), snapshots.shape[2]))
        for row, name in enumerate(names):
            shares = points[name] if name in points else ((self.names(of_bodies).index(name), 1.0),)
            for body, weight in shares:
                result[:, row] += weight * snapshots[:, self.place(of_bodies).start + body]
        return result, list(range(len(names)))

    def values(self, quantity: Variable, snapshots: np.ndarray) -> np.ndarray:
        """Return a quantity from snapshots, whose rows are the last axis."""
        if quantity.dimension != POINT:
            return snapshots[..., self.place(quantity.name)]
        of_bodies = snapshots[..., self.place(quantity.name.removeprefix("point_"))]
        result = np.zeros((*of_bodies.shape[:-1], len(self.points)))
        for column, (_, row) in enumerate(self.points):
            for body, weight in row:
                result[..., column] += weight * of_bodies[..., body]
        return result

    def labelled(self, values: np.ndarray, *dimensions: str) -> Variables:
        """Return variables of snapshots along other dimensions, the rows of which are the last axis."""
        return self.coordinates | {
            item.name: ((*dimensions, item.dimension), self.values(item, values), self.attributes(item))
            for item in self.quantities
        }
