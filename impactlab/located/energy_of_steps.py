"""The record of energy flows under smooth forces, from the nodes of the steps of runs without given steps."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.evaluation import call_each
from impactlab.kernels.integrals import CONTACT_FORCE
from impactlab.located.energy_of_events import EnergyOfEvents, Factor, Integrals, Terms
from impactlab.located.path_snapshots import PathSnapshots
from impactlab.records.accounted_network import OfNetwork
from impactlab.records.law_kernels import added
from impactlab.records.power_accounts import Powers


class EnergyOfSteps(EnergyOfEvents):
    """Powers of smooth forces along paths, and of the impacts of rigid contacts.

    Parameters
    ----------
    model : Model
        The network that is followed.
    network : OfNetwork
    frequencies : (wave,) ndarray
        Those of given motions (rad s-1).
    paths : PathSnapshots
    realizations : int
    """

    def __init__(
        self, model: Model, network: OfNetwork, frequencies: np.ndarray, paths: PathSnapshots, realizations: int
    ) -> None:
        super().__init__(model, network, frequencies)
        self.links, accounts = paths.links(network), network.accounts
        self.work = np.zeros((len(accounts.entries.rows), realizations))
        self.taken = np.zeros((len(model.bodies), realizations))
        self.forced = np.zeros((len(network.forced), realizations))

    def take(self, lane: int, snapshots: np.ndarray, times: np.ndarray, weights: np.ndarray) -> None:
        """Take nodes of a realization: snapshots, (node, row), times and weights (s)."""
        links, own = self.links, snapshots[:, :, None]
        slots, signs, rows = self.network.accounts.entries
        v, forces = snapshots[:, links.v], np.hstack([snapshots[:, links.forces], links.pulls(own, times)[:, :, 0]])
        self.work[:, lane] -= signs * (weights @ (forces[:, rows] * v[:, slots]))
        if residuals := self.network.laws.residuals:
            kinematic = {"displacement": own[:, links.x], "velocity": own[:, links.v]}
            kinematic["time"] = np.broadcast_to(times[:, None, None], (*v.shape, 1))
            self.taken[:, lane] += weights @ (added(residuals, kinematic, own[:, links.states])[:, :, 0] * v)
        sources = self.model.sources["force"]
        if sources.names:
            drives = sources.drives
            push = call_each(sources.excitations, "force", np.broadcast_to(times, (len(sources.names), len(times))))
            self.forced[:, lane] += drives.weight * (weights @ (push[drives.source].T * v[:, drives.body]))

    def powers(self, found: Integrals) -> Powers:
        of_impacts = super().powers(found)
        entries, length = of_impacts.entries + self.work / found.length, found.length
        kept = self.network.residual_energies(found.end[0]) - self.network.residual_energies(found.begin[0])
        lost = self.network.lost_in_residuals(self.taken, kept) / length
        damped = of_impacts.damped + np.where(self.network.free[:, None], lost, 0.0)
        return self.completed(of_impacts._replace(entries=entries, damped=damped), self.forced / length)

    def _forces(self) -> list[Factor]:
        """Return the forces of links: of rigid contacts their impulses, others are in the nodes."""
        accounts, result = self.network.accounts, list[Factor]()
        for contact in range(accounts.links):
            rigid = contact < len(accounts.contacts) and self.model.contacts.impulsive[contact]
            result.append({(CONTACT_FORCE, contact): 1.0} if rigid else {})
        return result

    def _of_sources(self) -> list[Terms]:
        """Return no terms of given forces, which are in the nodes."""
        return [[] for _ in self.network.forced]
