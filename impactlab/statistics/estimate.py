"""From the sums of a run to its statistics with their standard errors.

A *unit* is what counts as independent: a realization or, where there are few of them, a
batch of one. A value is a mean over units. Where balances hold, whose expectation is
known to be 0, the part of a statistic's scatter that follows theirs is removed: the value
is that of a linear regression on the balances, at balance 0 (control variates).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from impactlab.errors import warn
from impactlab.kernels.rows import FF, FLUX, F
from impactlab.plan.clock import BATCH_TIMES, BATCHES, batches_wanted
from impactlab.plan.plan import Plan
from impactlab.results.schema import (
    BODY,
    CONTACT,
    EVERY,
    POINT,
    STATE,
    STATISTICS,
    Estimate,
    Moments,
    Statistic,
    Variable,
    sampled_of,
)
from impactlab.statistics.controls import Controls, controlled, moving, neighbours, touching, unbalanced
from impactlab.statistics.drift import drift_of
from impactlab.statistics.ergodicity import Memory, memory_of
from impactlab.statistics.heating import Heating, conservative, heating_of
from impactlab.statistics.moments import moments_of
from impactlab.statistics.point_moments import with_points
from impactlab.statistics.rare import Events, warn_of_rare, warn_of_still, widen_bodies, widen_contacts
from impactlab.statistics.regression import Mean


@dataclass(frozen=True, eq=False)
class Values:
    """Values and standard errors, by the statistic."""

    combined: dict[str, Estimate]  # at balance 0; where no balances are used plain means
    direct: dict[str, Estimate]  # plain means, where balances are used
    balances: dict[str, Estimate]
    unbalanced: str  # which balance does not close; empty if all do

    @classmethod
    def of_each(
        cls, plan: Plan, networks: Sequence[Plan], moments: Moments, whole: Moments, mean: Mean, seldom: np.ndarray
    ) -> list[Values]:
        """Estimate the values of the networks of a joint run from the moments of independent units and of realizations.

        `plan` is the plan of all `networks` together, see `impactlab.plan.side_by_side`; one network has its own plan.
        Balances of bodies whose forces acted too `seldom`, (body,) of bool, are not used as controls.
        """
        number = len(networks)
        balances = {name: mean(item) for name, item in moments.balances.items()}
        off = [
            unbalanced(_every(balances, place, number), network.system.bodies, network.noise.random)
            for place, network in enumerate(networks)
        ]
        plain = {item.name: item.averaged(moments, mean) for item in moments.statistics()}
        errors = [error for _, error in balances.values()]
        usable = np.array([np.isfinite(error) & (error > 0.0) & ~seldom for error in errors]).T
        used = [
            mean.trusted and network.clock.settled and not message and bool(usable[place::number].any())
            for place, (network, message) in enumerate(zip(networks, off, strict=True))
        ]
        combined = _at_balance(plan, moments, mean, usable) if any(used) else {}
        of_realizations = Mean(np.ones(plan.realizations.finite), trusted=True)
        others = {
            statistic.name: statistic.averaged(whole, of_realizations)
            for statistic in STATISTICS.values()
            if not statistic.stationary
        }
        return [
            cls(
                _every((combined if used[place] else plain) | others, place, number),
                _every(plain, place, number) if used[place] else {},
                _every(balances, place, number),
                off[place],
            )
            for place in range(number)
        ]

    def labelled(self) -> Iterator[tuple[Variable, Estimate]]:
        """Give each estimate with its variable in a dataset."""
        for statistic in EVERY.values():
            if statistic.name in self.combined:
                yield statistic, self.combined[statistic.name]
        for name, estimate in self.direct.items():
            yield EVERY[name].direct, estimate
        for name, estimate in self.balances.items():
            yield STATISTICS[name].balance, estimate

    def of_dimension(self, dimension: str) -> Iterator[tuple[Statistic, Estimate]]:
        """Give values and plain means of bodies, contacts or states of laws."""
        for estimates in (self.combined, self.direct):
            for name, estimate in estimates.items():
                if EVERY[name].dimension == dimension:
                    yield EVERY[name], estimate


def _every(estimates: Mapping[str, Estimate], place: int, number: int) -> dict[str, Estimate]:
    """Return the estimates of network `place` of a joint run of `number` networks."""
    rows = slice(place, None, number)
    return {name: Estimate(value[rows], error[rows]) for name, (value, error) in estimates.items()}


def _at_balance(plan: Plan, moments: Moments, mean: Mean, usable: np.ndarray) -> dict[str, Estimate]:
    """Return the statistics of bodies, contacts, points and states at balance 0; see `controlled`."""
    kicked = plan.forces.kicked.copy()  # whether other forces than linear ones may act on a body, or on its group
    for group in plan.method.groups:
        kicked[group.slots] = kicked[group.slots].any()
    bodies = neighbours(plan.system.links.pairs, kicked)
    contacts = touching(plan.system.ends)
    points = [moving(plan.points.shares, moments, bodies)] if plan.points.labels else []
    states = [touching(plan.forces.state_ends, STATE)] if len(plan.forces.states) else []
    result: dict[str, Estimate] = {}
    for near in (bodies, contacts, *points, *states):
        result |= controlled(near, moments, mean, usable)
    return result


@dataclass(frozen=True, eq=False)
class Units:
    """Independent units, from whose scatter standard errors are estimated."""

    moments: Moments  # of the units
    whole: Moments  # of the realizations
    weights: np.ndarray  # (unit,) steps of a unit; 1 for realizations
    steps: np.ndarray  # (batch,) steps of the batches
    alone: bool  # whether realizations are the units, not their batches
    pushes: np.ndarray  # (body, unit) mean square of the forces of kicks; without rows if the method does not kick

    @classmethod
    def of(
        cls, plan: Plan, bodies: np.ndarray, contacts: np.ndarray, products: np.ndarray, points: np.ndarray,
        laws: np.ndarray,
    ) -> Units:  # fmt: skip
        """Return the units of a run, from the sums of its batches; see `estimate`."""
        ends, realizations = (0, *plan.clock.boundaries), bodies.shape[-1]
        steps = np.diff(ends).astype(float)
        counts = np.array([plan.counts(*pair) for pair in pairwise(ends)]).T
        total = np.repeat(counts.sum(axis=1)[:, None], realizations, axis=1)
        sums = contacts, products, laws, points
        whole = [item.sum(axis=0) for item in sums]
        for row, statistic in enumerate(sampled_of(CONTACT), FLUX + 1):
            if statistic.largest:
                whole[0][row] = contacts[:, row].max(axis=0)
        alone = realizations + len(plan.realizations.losses) >= BATCHES
        pushes = _pushes(bodies, steps, alone) if plan.method.integrator.kicks else np.zeros((0, 0))
        several = not (alone or len(steps) == 1)  # units are batches, after which the realizations are looked at
        if several:
            total = np.concatenate([total, np.repeat(counts, realizations, axis=1)], axis=1)
            whole = list(map(_joined, whole, sums))

        def of_bodies(rows: slice) -> np.ndarray:
            own = bodies[:, :, :, rows]
            return _joined(own.sum(axis=0), own) if several else np.asarray(own.sum(axis=0))

        moments = moments_of(plan, of_bodies, total, *whole[:-1])
        if plan.points.labels:
            moments = with_points(plan, moments, of_bodies(slice(None)), total, whole[-1])
        weights = np.ones(realizations) if alone else np.repeat(steps, realizations)
        if not several:
            return cls(moments, moments, weights, steps, alone, pushes)
        of_whole, of_units = (moments.part(slice(None), item) for item in (np.s_[:realizations], np.s_[realizations:]))
        return cls(of_units, of_whole, weights, steps, alone, pushes)

    def of_network(self, place: int, number: int) -> Units:
        """Return the units of network `place` of a joint run of `number`; see `impactlab.plan.side_by_side`."""
        rows = slice(place, None, number)
        moments = self.moments.part(rows)
        whole = moments if self.whole is self.moments else self.whole.part(rows)
        return replace(self, moments=moments, whole=whole, pushes=self.pushes[rows])


@dataclass(frozen=True, eq=False)
class Rows:
    """Estimates of each body and contact on its own, without sums over the network."""

    units: Units
    events: Events
    seldom: np.ndarray  # (body,) of bool; see `Events.seldom`
    values: Values

    @classmethod
    def of_each(cls, plan: Plan, networks: Sequence[Plan], units: Units) -> list[Rows]:
        """Return the estimates of each network from the units and the plan of their joint run."""
        number, trusted = len(networks), {network.realizations.trusted and network.random for network in networks}
        each = [units.of_network(place, number) for place in range(number)] if number > 1 else [units]
        if len(trusted) > 1:
            alone = zip(networks, each, strict=True)
            return [rows for network, own in alone for rows in cls.of_each(network, [network], own)]
        events = Events.of(plan, units.moments, units.pushes)
        seldom, mean = events.seldom(plan), Mean(units.weights, *trusted)
        values = Values.of_each(plan, networks, units.moments, units.whole, mean, seldom)
        own = [events.of_network(place, number) for place in range(number)] if number > 1 else [events]
        return [cls(each[place], own[place], seldom[place::number], values[place]) for place in range(number)]

    def controls(self, plan: Plan) -> Controls:
        """Return the balances of the units, as far as the values have used them."""
        moments, mean = self.units.moments, Mean(self.units.weights, plan.realizations.trusted and plan.random)
        errors = np.array([error for _, error in self.values.balances.values()]).T
        usable = np.isfinite(errors) & (errors > 0.0) & ~self.seldom[:, None] & bool(self.values.direct)
        balances = np.zeros((len(self.seldom), len(moments.balances), len(self.units.weights)))
        for row, balance in enumerate(moments.balances.values()):
            balances[:, row] = balance
        return Controls(moments, mean, balances, usable)


@dataclass(frozen=True, eq=False)
class Estimates:
    """Statistics of a run."""

    values: Values  # values and standard errors
    by_realization: dict[str, np.ndarray]
    """Statistics and balances of each realization, as they are called in a dataset."""
    drift: float
    """Largest difference between the first and the second half of the run, in standard errors; with fewer than 8
    realizations also between its first quarter and the rest, and NaN without enough batches.
    """
    contacts_per_sample: np.ndarray  # (contact,) how often each contact closed in a unit, on average
    heating: Heating  # heat that the step made
    remembered: str  # says that realizations settle into different motions; empty if they do not
    controls: Controls  # of the units, for what records estimate


def estimate(
    plan: Plan, bodies: np.ndarray, contacts: np.ndarray, products: np.ndarray, points: np.ndarray,
    laws: np.ndarray, *, rows: Rows | None = None, wanted: bool = True,
) -> Estimates:  # fmt: skip
    """Estimate all default statistics from sums over the steps of each batch; a joint run has estimated its `rows`.

    Where no statistics are `wanted`, no warning tells of standard errors that are NaN.

    These are of bodies, (batch, phase, row, body, realization), of contacts, (batch, row, contact, realization), and
    products of pairs, (batch, row, pair, realization), of points, (batch, phase, row, point, realization), and of
    states of laws, (batch, row, state, realization).
    """
    if rows is None:
        (rows,) = Rows.of_each(plan, [plan], Units.of(plan, bodies, contacts, products, points, laws))
    units, events, values = rows.units, rows.events, rows.values
    random, trusted = plan.random, plan.realizations.trusted
    if random and not trusted and wanted:
        advice = f"use at least {BATCHES} realizations"
        if plan.clock.relaxation > 0.0:  # more than rounding takes away
            needed = 1.01 * BATCH_TIMES * plan.clock.relaxation * batches_wanted(plan.realizations.number)
            advice = f"run for at least {needed:.3g} s, or use {BATCHES} realizations"
        warn("few_samples", f"Too few independent samples for standard errors, which are NaN: {advice}.")
    closings = values.combined["contact_rate"].value * plan.clock.step * plan.clock.steps * plan.realizations.finite
    if "contact_rate" in plan.observed.left_out:
        closings = events.closings
    looked_at = slice(0 if "mean_contact_force" in plan.observed.left_out else None)
    if not plan.noise.random.all():
        _forget(plan, values)
    of_batches = bodies[:, :, :F].sum(axis=1)
    memory = memory_of(plan, of_batches, units.steps, units.alone) if plan.led else None
    if random:
        _widen(plan, units, events, memory, values)
        if trusted:
            closed = (closings < 1.0) & np.isfinite(events.closings)
            warn_of_rare(plan, np.where(closed, np.maximum(closings, events.closings), closings))
            warn_of_still(plan, events)
    known = [*units.whole.statistics(), *(item for item in STATISTICS.values() if not item.stationary)]
    by_realization = {item.name: units.whole.of(item).T for item in known}
    by_realization |= {STATISTICS[name].balance.name: item.T for name, item in units.whole.balances.items()}
    return Estimates(
        values,
        by_realization,
        drift_of(of_batches, contacts[:, :, looked_at], units.steps, trusted),
        closings / len(units.weights),
        heating_of(plan, units.moments, units.weights, rows.seldom) if conservative(plan) else Heating(),
        "" if memory is None else memory.warning,
        rows.controls(plan),
    )


def _joined(whole: np.ndarray, batches: np.ndarray) -> np.ndarray:
    """Put batches, on the first axis, behind what they add up to, along the last."""
    units = np.moveaxis(np.concatenate([whole[None], batches]), 0, -2)
    return units.reshape(*whole.shape[:-1], units.shape[-2] * units.shape[-1])


def _pushes(bodies: np.ndarray, steps: np.ndarray, alone: bool) -> np.ndarray:
    """Return the mean square of the forces of kicks in each unit, (body, unit)."""
    squares = bodies[:, :, FF].sum(axis=1)
    if alone:
        return np.asarray(squares.sum(axis=0) / steps.sum())
    return np.asarray((squares / steps[:, None, None]).swapaxes(0, 1).reshape(squares.shape[1], -1))


def _forget(plan: Plan, values: Values) -> None:
    """Turn standard errors into NaN where no noise reaches, unless a value is 0: nothing is sampled there."""
    random = plan.noise.random
    stills = {
        BODY: ~random,
        CONTACT: ~plan.system.ends.any(random),
        POINT: ~plan.points.shares.any(random),
        STATE: ~plan.forces.state_ends.any(random),
    }
    for variable, (value, error) in values.labelled():
        still = stills[variable.dimension]
        error[still] = np.where(value[still] != 0.0, np.nan, 0.0)


def _widen(plan: Plan, units: Units, events: Events, memory: Memory | None, values: Values) -> None:
    """Add to standard errors what scatter between units does not show: rare events, and what realizations remember."""
    kinetic = values.combined["mean_square_velocity"].value
    widen_contacts(plan, events, kinetic, values.of_dimension(CONTACT))
    if events.moved.size:
        widen_bodies(plan, events, kinetic, values.of_dimension(BODY))
    for statistic, (_, error) in (*values.of_dimension(CONTACT), *values.of_dimension(STATE)):
        moments = units.moments if statistic.stationary else units.whole
        same = np.ptp(moments.of(statistic), axis=-1) == 0.0
        never = events.closings == 0.0 if statistic.dimension == CONTACT else False
        error[same | never] = np.nan  # what was the same in all units is not known exactly
    if memory is None:
        return
    widening = memory.widening(len(units.weights))
    links = {CONTACT: plan.system.ends, POINT: plan.points.shares, STATE: plan.forces.state_ends}
    widenings = {BODY: widening, **{name: item.largest(widening, 1.0) for name, item in links.items()}}
    for variable, (_, error) in values.labelled():
        error *= widenings[variable.dimension]
