"""Forces, extensions and rates of contacts and couplings, from snapshots."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.powers import add_linear_forces
from impactlab.kernels.turning_points import sum_rows
from impactlab.records.accounted_network import OfNetwork
from impactlab.records.law_kernels import added
from impactlab.results.snapshot import AT_KICKS, STATES, Snapshot


class LinksInSnapshots:
    """Where snapshots hold what contacts and couplings depend on.

    Rates are those at which forces do their work: at kicks, where the force kicks.

    Parameters
    ----------
    network : OfNetwork
    snapshot : Snapshot
    flows : (body,) ndarray of bool
        Whether springs and dampers between bodies are part of their motion, and do not kick.
    """

    def __init__(self, network: OfNetwork, snapshot: Snapshot, flows: np.ndarray) -> None:
        self.network, entries = network, network.accounts.entries
        self.contacts, self.weights = len(network.accounts.contacts), entries.weights
        self.first = int(np.searchsorted(entries.rows, self.contacts))  # entry of couplings
        names = "displacement", "velocity", "contact_force", STATES.name
        self.x, self.v, self.forces, self.states = (snapshot.place(name) for name in names)
        self.kicks = snapshot.place(AT_KICKS.name) if snapshot.kicked else self.v
        self.begins = np.searchsorted(entries.rows, np.arange(network.accounts.links + 1))
        slots, flowing, rows = entries.slots, flows[entries.slots], entries.rows
        inside = np.array(
            [flowing[rows == row].all() for row in range(self.contacts, network.accounts.links)], dtype=bool
        )
        kicked = np.append(np.ones(self.contacts, dtype=bool), ~inside)[rows]
        paces = slots + np.where(kicked, self.kicks.start, self.v.start)
        contacts, couplings = slice(self.first), slice(self.first, None)
        self.of_contacts = np.stack([self.forces.start + rows[contacts], paces[contacts]])
        self.of_couplings = np.stack([rows[couplings] - self.contacts, paces[couplings]])
        self.gaps, self.springs = (
            np.stack([slots[part] + self.x.start, paces[part]]) for part in (contacts, couplings)
        )

    def along(self, own: np.ndarray, quantity: int, couplings: bool) -> np.ndarray:
        """Return elongations of contacts (0), extensions of couplings, or their rates (1), (sample, link, lane)."""
        in_plane = self.network.in_plane
        if in_plane is not None and not couplings:
            return in_plane.elongations(own[:, self.x], own[:, self.kicks], quantity == 1)
        count = self.network.accounts.links - self.contacts if couplings else self.contacts
        result = np.empty((count, len(own), own.shape[2]))
        sum_rows(np.ascontiguousarray(own), *self.sums(np.arange(count), quantity, couplings), result)
        return result.transpose(1, 0, 2)

    def sums(self, slots: np.ndarray, quantity: int, couplings: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return elongations of some contacts, or extensions of couplings, or their rates (1), as sums of rows."""
        first, rows, sign = (self.contacts, self.springs, -1.0) if couplings else (0, self.gaps, 1.0)
        begins, ends = (self.begins[first + slots + after] for after in (0, 1))
        entries = np.concatenate([np.zeros(0, np.int64), *map(np.arange, begins, ends)])
        counted = np.cumsum([0, *(ends - begins)])
        return counted, rows[quantity, entries - self.begins[first]], sign * self.weights[entries]

    def pulls(self, own: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the forces of couplings along their links, (sample, coupling, lane): negative where they pull.

        The samples are at some times, (sample,) (s).
        """
        result = np.zeros((len(own), len(self.network.accounts.couplings), own.shape[2]))
        begins = self.begins[self.contacts :] - self.first
        add_linear_forces(own, begins, self.springs, self.weights[self.first :], self.network.couplings, result)
        if laws := self.network.laws.coupling_forces:
            kinematic = {"extension": self.along(own, 0, True), "rate": self.along(own, 1, True)}
            kinematic["time"] = np.broadcast_to(times[:, None, None], result.shape)
            result -= added(laws, kinematic, own[:, self.states])
        return result
