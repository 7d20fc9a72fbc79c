"""Samples and nodes of integrals along paths of runs without steps, as snapshots."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.coupling import CoulombFrictionCoupling
from impactlab.kernels.event_log import NODE_STATE, NODE_TIME
from impactlab.located.given_waves import given_waves
from impactlab.located.rows_of_couplings import rows_of_couplings, weights
from impactlab.located.sliders import states_at
from impactlab.records.accounted_network import OfNetwork
from impactlab.records.links_in_snapshots import LinksInSnapshots
from impactlab.results.snapshot import Snapshot


class PathSnapshots:
    """Samples and nodes of paths as snapshots, behind which the forces of dry frictions stand.

    Parameters
    ----------
    model, followed : Model
        The network, and that which is followed, with further contacts.
    smooth : bool
        Whether paths are made of steps; nodes then have all bodies, and states of laws.
    """

    def __init__(self, model: Model, followed: Model, smooth: bool) -> None:
        self.model, self.smooth, self.contacts = model, smooth, len(followed.contacts.names)
        self.snapshot = Snapshot(
            model.bodies.names, model.contacts.names, model.kicks.states, model.points,
            impulsive=tuple(np.flatnonzero(model.contacts.impulsive).tolist()),
        )  # fmt: skip
        rows, names = rows_of_couplings(followed), model.couplings.names
        sticking = [isinstance(law, CoulombFrictionCoupling) for law in model.couplings.laws]
        chosen = [row for row, name in enumerate(rows.names) if sticking[names.index(name)]]
        self.frictions = np.array([] if smooth else chosen, dtype=np.int64)
        self.rubbing = np.array([names.index(rows.names[row]) for row in self.frictions], dtype=np.int64)
        directions = weights(model.coupled)[self.rubbing]
        self.signs = np.sign((directions * rows.links[self.frictions][:, : directions.shape[1]]).sum(axis=1))

    def links(self, network: OfNetwork) -> LinksInSnapshots:
        """Return what reads forces and rates of contacts and couplings in these snapshots."""
        return _LinksOnPaths(network, self)

    def of_samples(self, times: np.ndarray, taken: np.ndarray) -> np.ndarray:
        """Return snapshots, (…, time, row), of samples, (…, time, column)."""
        snapshot, free = self.snapshot, self.model.bodies.free
        bodies, forces = len(free), snapshot.place("contact_force")
        inner = (taken.shape[-1] - self._behind) // 2
        rows = np.empty((*taken.shape[:-1], snapshot.size + len(self.frictions)))
        rows[..., forces] = taken[..., 2 * inner : 2 * inner + forces.stop - forces.start]
        for first, column in ((0, 0), (bodies, inner)):
            rows[..., first + np.flatnonzero(free)] = taken[..., column : column + free.sum()]
        for slot, wave in given_waves(self.model):
            rows[..., slot], rows[..., bodies + slot] = wave.at(times)
        behind = 2 * inner + self.contacts
        states = slice(forces.stop, snapshot.size)
        if self.smooth:
            rows[..., states] = taken[..., behind:]
        else:
            rows[..., states] = states_at(self.model, rows[..., :bodies], taken[..., free.sum() : inner])
            rows[..., snapshot.size :] = self.signs * taken[..., behind + self.frictions]
        return rows

    def of_nodes(self, nodes: np.ndarray) -> np.ndarray:
        """Return snapshots of nodes, (node, column)."""
        taken = nodes[:, NODE_STATE:]
        if self.smooth:
            free, bodies = np.flatnonzero(self.model.bodies.free), len(self.model.bodies)
            others = np.arange(2 * bodies, taken.shape[1])
            taken = taken[:, np.concatenate([free, bodies + free, others])]
        return self.of_samples(nodes[:, NODE_TIME], taken)

    @property
    def _behind(self) -> int:
        """Columns behind displacements and velocities."""
        states = len(self.model.kicks.states) if self.smooth else len(rows_of_couplings(self.model).names)
        return self.contacts + states


class _LinksOnPaths(LinksInSnapshots):
    """Forces of links along paths, where those of dry friction are known while it sticks."""

    def __init__(self, network: OfNetwork, paths: PathSnapshots) -> None:
        super().__init__(network, paths.snapshot, np.ones(len(paths.model.bodies), dtype=bool))
        self.paths = paths

    def pulls(self, own: np.ndarray, times: np.ndarray) -> np.ndarray:
        result = super().pulls(own, times)
        result[:, self.paths.rubbing] = own[:, self.paths.snapshot.size :]
        return result


def in_order(nodes: np.ndarray) -> np.ndarray:
    """Return nodes in the order of time; at one time in that in which they were made."""
    return nodes[np.argsort(nodes[:, NODE_TIME], kind="stable")]
