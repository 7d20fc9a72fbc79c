"""Sums and records of a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from impactlab.plan.subdomains import Tile

WINDOW = 0.2
"""Half width of the window of the contact rate, as a part of the length over which the density of a gap varies."""


@dataclass(frozen=True, eq=False)
class Observed:
    """Statistics and records."""

    records: tuple[tuple[Any, int], ...]  # pairs of a resolved record and the number of snapshots between its own
    every: int  # steps between snapshots, 0 for none
    window: np.ndarray  # (contact,) half width for the flux that is a contact's rate (m)
    counted: bool  # whether rates are counts of closings, not fluxes through the windows
    jitter: np.ndarray  # (contact,) what noise changes closing velocities by in a step, root mean square (m s-1)
    rated: np.ndarray  # (contact,) whether its force depends on its rate: peaks are then read between steps
    peaked: bool  # whether snapshots hold these peaks
    bodies: int  # how many are summed, from the first on
    contacts: int  # how many of them
    sampled: bool  # whether states are samples of a stationary motion, not all that there are
    left_out: frozenset[str] = frozenset()  # statistics of contacts that are not summed
    ends: bool = False  # whether a realization is over when the only record has what it wants of it
    kicked: bool = False  # whether snapshots hold the velocities at which forces of kicks do their work
    told: bool = False  # whether snapshots hold what impacts within steps tell

    def restricted(self, tile: Tile) -> Observed:
        """Return the sums of a tile, over its own bodies and contacts; the caller joins snapshots."""
        return replace(
            self, records=(), window=self.window[tile.contacts], jitter=self.jitter[tile.contacts],
            rated=self.rated[tile.contacts],
            bodies=tile.own_bodies, contacts=tile.own_contacts,
        )  # fmt: skip
