"""Snapshots of a network: displacements, velocities and contact forces at one time, one after another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import BODY, CONTACT, Variable

QUANTITIES = {
    quantity.name: quantity
    for quantity in (
        Variable("displacement", BODY, "m", "displacement"),
        Variable("velocity", BODY, "m s-1", "velocity"),
        Variable("contact_force", CONTACT, "N", "contact force"),
    )
}
"""What a snapshot holds, in the order of `impactlab.kernels.sums.write_snapshot`."""


TIME = {"units": "s", "long_name": "time"}
"""Attributes of the times of snapshots."""


class Snapshot(NamedTuple):
    """Names of the bodies and contacts in a snapshot."""

    bodies: tuple[str, ...]
    contacts: tuple[str, ...]

    @property
    def size(self) -> int:
        """Rows of a snapshot."""
        return 2 * len(self.bodies) + len(self.contacts)

    @property
    def quantities(self) -> list[Variable]:
        """Those that it has: without contacts there are no forces."""
        return [quantity for name, quantity in QUANTITIES.items() if self.names(name)]

    def names(self, quantity: str) -> tuple[str, ...]:
        """Return what a quantity is known of."""
        return self.contacts if QUANTITIES[quantity].dimension == CONTACT else self.bodies

    def place(self, quantity: str) -> slice:
        """Return the rows of a quantity."""
        first = {"displacement": 0, "velocity": len(self.bodies), "contact_force": 2 * len(self.bodies)}[quantity]
        return slice(first, first + len(self.names(quantity)))

    def row(self, quantity: str, name: str) -> int:
        """Return the row of a quantity of one body or contact."""
        first: int = self.place(quantity).start
        return first + self.names(quantity).index(name)

    def labelled(self, values: np.ndarray, *dimensions: str) -> Variables:
        """Return variables of snapshots along other dimensions, the rows of which are the last axis."""
        return {
            name: labelled((*dimensions, item.dimension), values[..., self.place(name)], item.units, item.long_name)
            for name, item in QUANTITIES.items()
            if self.names(name)
        }
