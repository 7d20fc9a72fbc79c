"""The bodies and links of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlab.assembly.links import Links, Pairs
from impactlab.assembly.model import Model
from impactlab.plan.subdomains import Tile


@dataclass(frozen=True, eq=False)
class System:
    """Bodies and links."""

    bodies: tuple[str, ...]  # names by slot
    contacts: tuple[str, ...]
    linear: np.ndarray  # (3, body) mass, damping and stiffness
    ends: Links  # what contacts act along
    clearance: np.ndarray  # (contact,) their clearances (m)
    links: Links  # contacts, then couplings

    @classmethod
    def of(cls, model: Model) -> System:
        """Return the bodies and links of a model."""
        linear = np.stack([model.mass, model.damping, model.stiffness])
        return cls(model.bodies, model.contacts, linear, model.ends, model.clearance, model.links)

    def restricted(self, tile: Tile) -> System:
        """Return those of a tile."""
        ends = Pairs(len(tile.bodies), tile.ends)
        return System(
            tuple(map(self.bodies.__getitem__, tile.bodies.tolist())),
            tuple(map(self.contacts.__getitem__, tile.contacts.tolist())),
            self.linear[:, tile.bodies],
            ends,
            self.clearance[tile.contacts],
            ends,
        )
