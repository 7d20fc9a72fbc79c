"""The bodies and links of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from impactlab.assembly.links import Links, Pairs
from impactlab.assembly.mechanism import Mode, refusals
from impactlab.assembly.model import Model
from impactlab.plan.subdomains import Tile, refuse_to_cut


@dataclass(frozen=True, eq=False)
class System:
    """Bodies and links."""

    bodies: tuple[str, ...]  # names by slot
    contacts: tuple[str, ...]
    linear: np.ndarray  # (3, body) mass, damping and stiffness
    ends: Links  # what contacts act along
    clearance: np.ndarray  # (contact,) their clearances (m)
    links: Links  # contacts, then couplings
    refusals: Mapping[Mode, str]  # modes that mechanisms of the network cannot meet, and which these are

    @classmethod
    def of(cls, model: Model) -> System:
        """Return the bodies and links of a model."""
        linear = np.stack([model.mass, model.damping, model.stiffness])
        names = model.bodies.names, model.contacts.names
        return cls(*names, linear, model.ends, model.clearance, model.links, refusals(model))

    def restricted(self, tile: Tile) -> System:
        """Return those of a tile, which have contacts alone; else refuse."""
        refuse_to_cut(self, not self.ends.plain or len(self.links) > len(self.ends))
        ends = Pairs(len(tile.bodies), tile.ends)
        return System(
            tuple(map(self.bodies.__getitem__, tile.bodies.tolist())),
            tuple(map(self.contacts.__getitem__, tile.contacts.tolist())),
            self.linear[:, tile.bodies],
            ends,
            self.clearance[tile.contacts],
            ends,
            self.refusals,
        )
