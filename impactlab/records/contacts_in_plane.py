"""Contacts in a plane: their gaps, and the forces along the coordinates of their bodies, from snapshots."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from impactlab.assembly.links import RoundLinks
from impactlab.assembly.model import Model


class ContactsInPlane(NamedTuple):
    """The contacts of a network, of which some are round; plain data."""

    ends: RoundLinks
    entries: np.ndarray  # (entry,) those of round contacts among the entries of all links
    directions: np.ndarray  # (entry,) direction of each
    friction: np.ndarray  # (3, link) coefficient, velocity of the surface, and that at which friction is 0.76 of it

    @classmethod
    def of(cls, model: Model) -> Self | None:
        """Return the contacts of a network, or None where none is round."""
        ends = model.ends
        if not isinstance(ends, RoundLinks) or not model.contacts.round.any():
            return None
        directions = ends.along.rows[ends.slots < ends.count]
        entries = np.flatnonzero(model.contacts.round[ends.link[directions]])
        friction = np.zeros((3, len(ends)))
        for slot in ends.round.tolist():
            contact = model.network.contacts[model.contacts.names[slot]]
            friction[:, slot] = contact.friction_coefficient, contact.surface_velocity, contact.friction_velocity
        return cls(ends, entries, directions[entries], friction)

    def elongations(self, x: np.ndarray, v: np.ndarray, rates: bool) -> np.ndarray:
        """Return gaps before clearances, or their rates, (sample, contact, lane), from (sample, body, lane)."""
        x, v = _with_wall(x), _with_wall(v)
        found = self.ends.rates(x, v) if rates else self.ends.gap(x)
        return np.moveaxis(found, 0, 1)

    def forces(self, x: np.ndarray, v: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Return the force along each entry, (sample, entry, lane), by the forces of laws, (sample, contact, lane)."""
        ends, links = self.ends, self.ends.link[self.directions]
        first, rows = ends.first_direction[links], np.searchsorted(ends.round, links)
        normal, across, turning = (item[rows] for item in ends.radii(_with_wall(x), _with_wall(v)))
        coefficient, surface, slow = (row[links, None, None] for row in self.friction)
        sliding = turning + surface
        rubs = coefficient * np.tanh(np.divide(sliding, slow, out=np.zeros_like(sliding), where=slow > 0.0))
        along_x = (self.directions == first)[:, None, None]
        way = np.where(along_x, normal - rubs * across, across + rubs * normal)
        return np.asarray(np.moveaxis(way, 0, 1) * force[:, links])


def _with_wall(values: np.ndarray) -> np.ndarray:
    """Return values of bodies, (sample, body, lane), with 0 of the wall behind, (body, sample, lane)."""
    moved = np.moveaxis(values, 1, 0)
    return np.concatenate([moved, np.zeros((1, *moved.shape[1:]))])
