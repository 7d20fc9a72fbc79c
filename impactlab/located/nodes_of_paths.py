"""Nodes of integrals along paths of runs without steps, as snapshots, and quantities of one's own from these."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.coupling import CoulombFrictionCoupling
from impactlab.kernels.event_log import STATE, TIME, WEIGHT
from impactlab.located.given_waves import given_waves
from impactlab.located.rows_of_couplings import rows_of_couplings, weights
from impactlab.located.sliders import states_at
from impactlab.records.accounted_network import OfNetwork
from impactlab.records.links_in_snapshots import LinksInSnapshots
from impactlab.records.observable import EXTREMES, MEANS, Average, Observable, Quantity
from impactlab.records.signed_histogram import SignedHistogram
from impactlab.results.labels import Variables
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
        taken = nodes[:, STATE:]
        if self.smooth:
            free, bodies = np.flatnonzero(self.model.bodies.free), len(self.model.bodies)
            others = np.arange(2 * bodies, taken.shape[1])
            taken = taken[:, np.concatenate([free, bodies + free, others])]
        return self.of_samples(nodes[:, TIME], taken)

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


class QuantityOnPaths:
    """Integrals, extremes and a density of a quantity of one's own along the paths of realizations.

    Integrals have the nodes and weights of the path. Extremes are those at nodes, or of parabolas through three, which
    do not reach across events. The density counts nodes by the time between their neighbours.

    Parameters
    ----------
    record : Observable
    paths : PathSnapshots
    realizations : int
    """

    def __init__(self, record: Observable, paths: PathSnapshots, realizations: int) -> None:
        self.record, self.paths = record, paths
        self.quantity = Quantity(record, paths.links(record.of_network.network))
        count = len(record.of_network.labels)
        self.sums, self.squares = np.zeros((2, realizations, count))
        self.largest, self.smallest = np.full((2, realizations, count), -np.inf)  # the latter of the negative
        self.counts = SignedHistogram(count, record.bins, np.zeros((1, 1), dtype=np.int64))

    def take(self, lane: int, snapshots: np.ndarray, times: np.ndarray, weights: np.ndarray) -> None:
        """Take nodes of a realization in the order of time: snapshots, (node, row), times and weights (s)."""
        values = self.quantity(snapshots[:, :, None], times, np.array([lane]))
        own = values[:, :, 0]
        self.sums[lane] += weights @ own
        self.squares[lane] += weights @ own**2
        for largest, sign in ((self.largest, 1.0), (self.smallest, -1.0)):
            np.maximum(largest[lane], _largest(times, sign * own), out=largest[lane])
        self.counts.add(values, 0, np.gradient(times)[:, None] if len(times) > 1 else weights[:, None])

    def described(self, length: float, path: tuple[float, np.ndarray, np.ndarray] | None) -> Variables:
        """Return the variables of a run of some length (s), with a path: its begin, times (s) and snapshots."""
        means = dict(zip(MEANS, (self.sums / length, self.squares / length), strict=True))
        extremes = dict(zip(EXTREMES, (self.largest, -self.smallest), strict=True))
        averages: dict[str, Average] = {name: mean_of(values) for name, values in (means | extremes).items()}
        sampled = None
        if path is not None:
            begin, times, rows = path
            values = self.quantity(rows.transpose(1, 2, 0), times, np.arange(len(rows)))
            sampled = begin, values.transpose(2, 0, 1)
        return self.record.described(averages, [self.counts.result()], False, sampled)


def in_order(nodes: np.ndarray) -> np.ndarray:
    """Return nodes in the order of time; at one time in that in which they were made."""
    return nodes[np.argsort(nodes[:, TIME], kind="stable")]


def mean_of(values: np.ndarray) -> Average:
    """Return the mean over realizations, and standard errors, which are unknown where nothing is random."""
    value = values.mean(axis=0)
    return value, np.where(value == 0.0, 0.0, np.nan)


def _largest(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the largest values, (place,), at times or of parabolas about one that is larger than both beside it."""
    result: np.ndarray = values.max(axis=0)
    steps = np.diff(times)[:, None]
    before, after = steps[:-1], steps[1:]
    inner = (before > 0.0) & (after > 0.0) & (values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])
    with np.errstate(divide="ignore", invalid="ignore"):
        falls, rises = np.diff(values, axis=0)[1:] / after, np.diff(values, axis=0)[:-1] / before
        bend, slope = (falls - rises) / (before + after), (falls * before + rises * after) / (before + after)
        tops = values[1:-1] - slope**2 / (4.0 * bend)
    tops = np.where(inner & (bend < 0.0), tops, -np.inf)
    return np.maximum(result, tops.max(axis=0, initial=-np.inf))


def weights_of(nodes: np.ndarray) -> np.ndarray:
    """Return the weights of nodes in integrals over time (s)."""
    return np.ascontiguousarray(nodes[:, WEIGHT])
