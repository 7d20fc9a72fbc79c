"""The bodies and links of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlab.assembly.links import Links, Pairs
from impactlab.assembly.model import Model
from impactlab.plan.subdomains import Tile


@dataclass(frozen=True, eq=False)
class System:
    """Bodies and links.

    Attributes
    ----------
    bodies, contacts : tuple of str
        Names by slot.
    linear : (3, body) ndarray
        Mass, damping and stiffness.
    ends : Links
        What contacts act along.
    clearance : (contact,) ndarray
        Their clearances (m).
    links : Links
        Contacts, then couplings.
    """

    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    linear: np.ndarray
    ends: Links
    clearance: np.ndarray
    links: Links

    @classmethod
    def of(cls, model: Model) -> System:
        """Return the bodies and links of a model."""
        linear = np.stack([model.mass, model.damping, model.stiffness])
        return cls(model.bodies, model.contacts, linear, model.ends, model.clearance, model.links)

    def restricted(self, tile: Tile) -> System:
        """Return those of a tile."""
        ends = Pairs(len(tile.bodies), tile.ends)
        return System(
            tuple(self.bodies[slot] for slot in tile.bodies),
            tuple(self.contacts[slot] for slot in tile.contacts),
            self.linear[:, tile.bodies],
            ends,
            self.clearance[tile.contacts],
            ends,
        )
