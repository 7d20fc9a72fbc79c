"""Records of energy flows: the power that sources give, links carry, and dampers, frictions and contacts take."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.compiling.build import build
from impactlab.components.literature import article
from impactlab.kernels.powers import add_work
from impactlab.plan.plan import Plan
from impactlab.records.accounted_network import OfNetwork
from impactlab.records.law_kernels import added
from impactlab.records.links_in_snapshots import LinksInSnapshots
from impactlab.records.power_accounts import BALANCE, Powers, labelled_powers, summed, temperature
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables
from impactlab.results.schema import BODY, Estimate
from impactlab.results.snapshot import BY_IMPACTS
from impactlab.statistics.subsamples import in_units

STRIDE = 7
"""Steps between samples where forces kick: few enough to see most contacts, and odd, so that both phases of the steps
of `ExactFlow` are seen alike."""

AT_ENDS = 3
"""Powers of given forces at each end of a run, from which the error of their sum is found: of two differences."""

FOUND = (
    "Of white noise the expectation, πS/m of each body; of given forces the mean of force times velocity; of other "
    "noises and of given motions what the balance of their bodies leaves."
)
"""How powers of sources are found where steps are made."""


class EnergyFlows(Record):
    """Where energy comes from, which way it goes, and where it is lost: mean powers with their errors.

    Each source gives power to the network, ``power_in``. Contacts and couplings carry it from their first to their
    second side, ``contact_power_carried`` and ``coupling_power_carried``, and lose part of it, ``…_dissipated``, as do
    the dampers and residual forces of oscillators, ``power_dissipated``. What is neither lost nor passed on is stored.
    ``power_balance`` is the power into each oscillator less what it loses, passes on and stores, and
    ``network_power_balance`` the same of all: 0, up to errors. ``temperature`` is that of each oscillator, m E[v²]:
    along a chain they are the profile, and what its links carry is the flux of heat.

    With `EventLocated` all powers are integrals in closed form where motion is linear between events, so that balances
    hold to rounding on every path. Where steps are made, the power of a force that kicks is its work in the kick, in
    every seventh step, and that of dampers is ``c E[v²]`` with the mean square that the run estimates. Where forces are
    given, every step is taken, and their powers are integrated by the trapezoidal rule; its error, which the powers at
    both ends of the run tell, is part of the standard errors. White noise gives ``πS/m`` to a body, the expectation by
    Itô's rule, whatever else acts on it. A link with a potential and no damper loses nothing, which is used. What a law
    with states stores counts as lost until it gives it back.

    Notes
    -----
    The balance is that of equation :eq:`power-balance` of the theory.

    Examples
    --------
    >>> il.EnergyFlows()
    EnergyFlows()
    """

    citation = article(
        "Rieder, Z. and Lebowitz, J. L. and Lieb, E.",
        "Properties of a harmonic crystal in a stationary nonequilibrium state",
        "J. Math. Phys.", 8, 1967, "1073", "10.1063/1.1705319",
    )  # fmt: skip

    kicks: ClassVar[bool] = True
    impacts: ClassVar[bool] = True

    of_network: ClassVar[Any] = None
    """What a resolved record knows of its network, `OfNetwork`."""

    def __reduce__(self) -> Any:
        return (*super().__reduce__(), {"of_network": self.of_network})

    def resolved_for(self, model: Model, begin: float, end: float) -> Record:
        result = self.replace()
        object.__setattr__(result, "of_network", OfNetwork.of(model, max(begin, 0.0), end))
        return result

    def stride(self, model: Model, step: float) -> int:
        # powers of given forces vary within a few steps, whether a contact is closed or not
        return STRIDE if model.kicks.nonlinear.any() and not model.sources["force"].names else 1

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Work(self.of_network, run.plan, len(realizations), ratio)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        plan, estimates, own = run.plan, run.estimates, self.of_network
        assert estimates is not None
        sums = {key: in_units([item[key] for item in results]) for key in results[0]}
        powers = _powers(plan, own, sums, interval, estimates.controls.moments.bodies.vv)
        plain, near = estimates.controls, own.accounts.near()
        controls = plain.with_balance(own.accounts.balance(powers))

        def average(values: np.ndarray, dimension: str) -> Estimate:
            found: Estimate = plain.mean(values)
            if dimension == BALANCE:
                found = plain.average(values, near[BODY])
            elif dimension in near:
                found = controls.average(values, near[dimension])
            return found

        heat = plan.system.linear[0], estimates.values.combined["mean_square_velocity"]
        return {**labelled_powers(own.accounts, powers, FOUND, average), **temperature(*heat)}


def _powers(plan: Plan, own: OfNetwork, sums: dict[str, np.ndarray], interval: float, square: np.ndarray) -> Powers:
    """Return the powers in each unit, from sums over its samples and mean square velocities, (body, unit)."""
    accounts, free = own.accounts, own.free[:, None]
    samples = sums["samples"]
    entries, taken = (sums[key] / samples for key in ("entries", "taken"))
    stored, kept, told = (sums[key] / (samples * interval) for key in ("stored", "kept", "told"))
    losses = np.where(own.conservative[:, None], np.zeros_like(kept), np.nan)
    if plan.snapshot.told:
        losses[plan.events.impulsive] = told[plan.events.losses]
        for first, (links, rows) in zip((len(accounts.contacts), 0), plan.events.works, strict=True):
            entries[np.isin(accounts.entries.rows, first + links)] = told[rows]
    entries = accounts.with_losses(entries, kept, losses)
    residual = sums["residual"] / (samples * interval)
    damped = plan.system.linear[1][:, None] * square + own.lost_in_residuals(taken, residual)
    damped, stored = np.where(free, damped, 0.0), np.where(free, stored, 0.0)
    from_links = accounts.on_bodies(entries)
    drives = np.repeat(own.white[:, None], entries.shape[1], axis=1)
    body = accounts.driven[:, 1]
    drives[own.forced] = np.where(free[body[own.forced]], sums["forced"] / samples, np.nan)
    unknown = np.isnan(own.white)
    unknown[own.forced] = ~own.free[body[own.forced]]
    left = damped + stored - from_links - summed(np.nan_to_num(drives), body, len(free))
    drives[unknown] = left[body[unknown]]
    sources = summed(drives, accounts.driven[:, 0], len(accounts.sources))
    sampled, ends = np.zeros(len(drives)), sums["ends"]
    steps = samples.sum() / ends.shape[1]
    sampled[own.forced] = _of_trapezoids(ends.mean(axis=1).reshape(2, AT_ENDS, -1)) / steps
    return Powers(sources, summed(drives, body, len(free)), damped, entries, stored, kept, sampled)


def _of_trapezoids(ends: np.ndarray) -> np.ndarray:
    """Return the size of the error of sums by the trapezoidal rule, (force,), from values at both ends of the run.

    The values are (end, sample, force), each end last, in the mean of all realizations. By the formula of Euler and
    Maclaurin the error is a twelfth of the difference of the slopes at the ends, by steps. Where a slope turns within a
    few steps, second differences tell of it when the first ones are just 0.
    """
    first, second = np.diff(ends, axis=1)[:, -1], np.diff(ends, 2, axis=1)[:, -1]
    return np.asarray(np.sqrt((first**2 + second**2).sum(axis=0)) / 12.0)


class _Work(Keeper):
    """Work of forces, and stored energies, in samples of a block."""

    wants_start = True

    def __init__(self, own: OfNetwork, plan: Plan, lanes: int, ratio: int) -> None:
        super().__init__(ratio)
        self.network, self.plan, self.parts = own, plan, plan.samples_per_realization
        self.seen_links, bodies = LinksInSnapshots(own, plan.snapshot, plan.method.grouped), len(plan.system.bodies)
        counts = {"entries": len(own.accounts.entries.rows), "taken": bodies, "forced": len(own.forced)}
        self.sums = {name: np.zeros((self.parts, count, lanes)) for name, count in counts.items()}
        self.samples = np.zeros((self.parts, 1, lanes))
        self.energies = np.zeros((self.parts + 1, 2 * bodies + own.accounts.links, lanes))
        self.straight = own.accounts.entries.weights[: self.seen_links.first].copy()  # 0 of contacts in a plane
        if own.in_plane is not None:
            self.straight[own.in_plane.entries] = 0.0
        self.rows = plan.snapshot.place(BY_IMPACTS.name)
        self.told = np.zeros((self.parts + 1, plan.snapshot.told, lanes))
        self.given = build(plan.forces.text).forcing if len(own.forced) else None
        self.pushes = np.zeros((self.parts + 1, len(own.forced), lanes))  # powers of given forces where parts end
        self.first = self.last = self.pushes[:1]  # some of these powers at both ends of the run

    def start(self, values: np.ndarray) -> None:
        self.energies[0], self.told[0] = self._energies(values), values[self.rows]
        if self.given is not None:
            self.first = self.last = self._powers_of_given(values[None], self.plan.sample_times(-1, 1))
            self.pushes[0] = self.first[0]

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        times = self.plan.sample_times(self.seen, len(snapshots))
        part, first = min(batch, self.parts - 1), self.first_of(snapshots)
        own, times = np.ascontiguousarray(snapshots[first :: self.ratio]), times[first :: self.ratio]
        if not len(own):
            return
        links, sums, weights = self.seen_links, self.sums["entries"][part], self.network.accounts.entries.weights
        add_work(own, own, links.of_contacts, self.straight, sums[: links.first])
        if (in_plane := self.network.in_plane) is not None:
            rows = np.stack([np.arange(len(in_plane.entries)), links.of_contacts[1, in_plane.entries]])
            forces = in_plane.forces(own[:, links.x], own[:, links.kicks], own[:, links.forces])
            found = np.zeros((len(in_plane.entries), own.shape[2]))
            add_work(forces, own, rows, weights[in_plane.entries], found)
            sums[in_plane.entries] += found
        if len(weights) > links.first:
            add_work(links.pulls(own, times), own, links.of_couplings, weights[links.first :], sums[links.first :])
        self._add_others(own, times, part)
        self.samples[part] += len(own)
        self.energies[part + 1], self.told[part + 1] = self._energies(own[-1]), own[-1, self.rows]

    def _add_others(self, own: np.ndarray, times: np.ndarray, part: int) -> None:
        """Add the power of residual forces, and of given ones."""
        links = self.seen_links
        if residuals := self.network.laws.residuals:
            shape = len(own), len(self.plan.system.bodies), own.shape[2]
            kinematic = {"displacement": own[:, links.x], "velocity": own[:, links.kicks]}
            kinematic["time"] = np.broadcast_to(times[:, None, None], shape)
            force = added(residuals, kinematic, own[:, links.states])
            self.sums["taken"][part] += np.einsum("sbl,sbl->bl", force, kinematic["velocity"])
        if self.given is not None:
            powers = self._powers_of_given(own, times)
            self.sums["forced"][part] += powers.sum(axis=0)
            self.pushes[part + 1] = powers[-1]
            self.first = np.concatenate([self.first, powers])[:AT_ENDS]
            self.last = np.concatenate([self.last, powers])[-AT_ENDS:]

    def _powers_of_given(self, own: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the powers of given forces in snapshots, (sample, force, lane)."""
        assert self.given is not None
        driving, forces = self.plan.driving, self.plan.forces
        value = np.empty((len(times), driving.given))
        self.given(np.ascontiguousarray(times), forces.parameters, forces.indices, value)
        push = value[:, driving.forces] * driving.weights
        return np.asarray(push[..., None] * own[:, self.seen_links.v][:, driving.forced])

    def _energies(self, own: np.ndarray) -> np.ndarray:
        """Return energies of residual forces, of bodies with these, and of links, in one snapshot, (row, lane)."""
        x, v = own[self.seen_links.x], own[self.seen_links.v]
        return np.concatenate([self.network.residual_energies(x), self.network.energies(x, v)])

    def result(self) -> dict[str, np.ndarray]:
        changes, bodies = np.diff(self.energies, axis=0), len(self.plan.system.bodies)
        residual, stored, kept = np.split(changes, [bodies, 2 * bodies], axis=1)
        found = {**self.sums, "samples": self.samples, "residual": residual, "stored": stored, "kept": kept}
        found["told"] = np.diff(self.told, axis=0)
        found["forced"] = found["forced"] - 0.5 * np.diff(self.pushes, axis=0)  # by the trapezoidal rule
        padded = [np.resize(item, (AT_ENDS, *item.shape[1:])) for item in (self.first, self.last)]  # of short runs
        found["ends"] = np.concatenate([padded[0][::-1], padded[1]]).reshape(1, -1, self.samples.shape[2])
        return {name: values.transpose(2, 0, 1) for name, values in found.items()}  # (lane, part, row)
