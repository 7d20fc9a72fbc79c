"""Limits of displacements, velocities and contacts: what they are of, and how paths are drawn near them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.allowed_ranges import range_of
from impactlab.components.contact import ContactLaw
from impactlab.errors import InvalidInput
from impactlab.inputs import finite, suggestion
from impactlab.kernels.bridges import (
    AT_IMPACT,
    AT_STEPS,
    COLUMNS,
    DEEPEST,
    MEAN_V,
    MEAN_X,
    OF_DISPLACEMENT,
    OF_VELOCITY,
    REACH,
    ROOT,
    SPAN_OF_PART,
    VARIANCE,
)
from impactlab.linear.transitions import transitions
from impactlab.plan.plan import Plan
from impactlab.results.snapshot import PEAKS

LIMITED = "displacement", "velocity", "indentation", "contact_force"
"""What may have limits: the first two of bodies and points, the others of contacts."""

LEVELS = {OF_DISPLACEMENT: 6, OF_VELOCITY: 8, AT_STEPS: 0, AT_IMPACT: 6}
"""How often a step is halved near a limit: the error of what is left, of the order 3/2 in its length for a displacement
and 1 for a velocity, is then 1/512 and 1/256 of that of the step."""

LONGEST_PART = 0.5
"""Part of the time in which damping stops a body that the shortest parts of a step last, at most."""

PER_RADIAN = 0.25
"""Largest step, in radians of the body: Hermite's cubic is then off by 1e-5 of an amplitude."""

IMPULSES = 0.1
"""Impulses in a step at most, in the mean: several in one are taken for one."""

NOT_PASSED = -1
"""Cause of a realization that has passed no limit."""

FARTHEST = 1e12
"""Indentation up to which a force is looked for (m)."""


class Limit(NamedTuple):
    """Limits of a quantity of one body, point or contact, between which it is at the start."""

    name: str
    quantity: str
    low: float | None
    high: float | None

    @property
    def pair(self) -> tuple[float, float]:
        """Both limits, infinite where there is none."""
        return -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high


def limits_of(given: Any) -> tuple[Limit, ...]:
    """Return limits that are given by name, or as a file has them, or refuse them."""
    stored = isinstance(given, list | tuple) and len(given) > 0
    if stored and all(isinstance(item, list | tuple) and len(item) == len(Limit._fields) for item in given):
        return tuple(map(Limit._make, given))
    if not isinstance(given, Mapping) or not given:
        raise InvalidInput(
            "FirstPassage takes limits by name, such as {'tower': 0.1, 'gap': ('contact_force', 500.0)}, not "
            f"{given!r}."
        )
    return tuple(_limit(name, item) for name, item in given.items())


def _limit(name: str, given: Any) -> Limit:
    """Return the limits of a name: a range, or the name of a quantity and a range of it."""
    place, quantity = f"FirstPassage: the limit of {name!r}", "displacement"
    if isinstance(given, list | tuple) and len(given) == 2 and isinstance(given[0], str):
        quantity, given = given
        if quantity not in LIMITED:
            raise InvalidInput(f"{place}: there is no quantity {quantity!r}; {suggestion(quantity, LIMITED)}")
    if quantity in ("indentation", "contact_force") and not isinstance(given, list | tuple):
        given = None, finite(place, given)
    low, high = range_of(place, given)
    if quantity == "contact_force" and (low is not None or high is None or high <= 0.0):
        raise InvalidInput(f"{place}: a contact force has one limit, above 0 N, not {given!r}.")
    return Limit(str(name), quantity, low, high)


def resolved(limits: Sequence[Limit], model: Model) -> tuple[Limit, ...]:
    """Return limits of a network, those of forces as indentations where these tell them, or refuse unknown names."""
    return tuple(_resolved(item, model) for item in limits)


def _resolved(limit: Limit, model: Model) -> Limit:
    place = f"FirstPassage: the limit of {limit.name!r}"
    if limit.quantity in ("displacement", "velocity"):
        known = [*model.bodies.names, *dict(model.points)]
        if limit.name not in known:
            contact = limit.name in model.contacts.names
            hint = "that of a contact is ('contact_force', …) or ('indentation', …)" if contact else None
            raise InvalidInput(
                f"FirstPassage: there is no oscillator or point {limit.name!r}; {hint or suggestion(limit.name, known)}"
            )
        return limit
    known = list(model.contacts.names)
    if limit.name not in known:
        raise InvalidInput(f"FirstPassage: there is no contact {limit.name!r}; {suggestion(limit.name, known)}")
    slot = known.index(limit.name)
    law, of_force = model.contacts.laws[slot], limit.quantity == "contact_force"
    if model.contacts.round[slot] and not of_force:
        raise InvalidInput(f"{place}: a round contact has no limits of its indentation; give those of its force.")
    if model.contacts.impulsive[slot] and of_force:
        raise InvalidInput(f"{place}: a {type(law).__name__} has impulses, but no force.")
    if model.contacts.impulsive[slot] and limit.high is not None and limit.high > 0.0:
        raise InvalidInput(
            f"{place}: a {type(law).__name__} has no indentation of {limit.high:g} m; give 0.0 for its first impact."
        )
    if not of_force or not elastic(model, slot):
        return limit
    return limit._replace(quantity="indentation", high=_indentation(place, law, limit.pair[1]))


def elastic(model: Model, slot: int) -> bool:
    """Whether the force of a contact is a function of its indentation."""
    contacts = model.contacts
    law = type(contacts.laws[slot])
    free = not (contacts.round[slot] or contacts.timed[slot] or contacts.impulsive[slot] or model.kicks.rated[slot])
    return free and not any(kind.states for kind in model.members.kinds if kind.component is law)


def _indentation(place: str, law: ContactLaw, force: float) -> float:
    """Return the indentation at which a force is first reached."""
    from scipy.optimize import brentq

    depths = np.geomspace(1.0 / FARTHEST, FARTHEST, 2001)
    with np.errstate(over="ignore"):
        beyond = np.flatnonzero(law.evaluate(depths) >= force)
    if not beyond.size:
        raise InvalidInput(f"{place}: the contact never has a force of {force:g} N.")
    first = int(beyond[0])
    begin = depths[first - 1] if first else 0.0
    return float(brentq(lambda depth: float(law.evaluate(depth)) - force, begin, depths[first], xtol=1e-300))


class Forms(NamedTuple):
    """Weighted sums of rows of snapshots, as `impactlab.kernels.bridges.follow_passages` takes them."""

    begins: np.ndarray
    places: np.ndarray
    paces: np.ndarray
    weights: np.ndarray
    offsets: np.ndarray
    kinds: np.ndarray


def slots_and_weights(limit: Limit, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Return the bodies whose weighted displacements a limit is of, and the weights."""
    if limit.quantity == "indentation":
        ends = plan.system.ends.chosen(np.array([plan.system.contacts.index(limit.name)]))
        moving = ends.slots < len(plan.system.bodies)
        return ends.slots[moving], ends.weights[moving]
    if limit.name in plan.system.bodies:
        return np.array([plan.system.bodies.index(limit.name)]), np.ones(1)
    slots, weights = zip(*dict(plan.points.labels)[limit.name], strict=True)
    return np.array(slots, dtype=np.int64), np.array(weights, dtype=float)


def limited_velocities(limits: Sequence[Limit], plan: Plan) -> np.ndarray:
    """Return the weights of velocities in what each limit is of, (limit, body); limits of forces have none."""
    result = np.zeros((len(limits), len(plan.system.bodies)))
    for row, limit in zip(result, limits, strict=True):
        if limit.quantity != "contact_force":
            np.add.at(row, *slots_and_weights(limit, plan))
    return result


def forms_of(limits: Sequence[Limit], plan: Plan) -> Forms:
    """Return what limits are of."""
    first = {name: plan.snapshot.place(name).start for name in ("displacement", "velocity", "contact_force")}
    places, paces, weights, offsets, kinds = [], [], [], [], []
    for limit in limits:
        slots, own = np.zeros(1, np.int64), np.ones(1)
        if limit.quantity == "contact_force":
            slot = plan.system.contacts.index(limit.name)
            peaked = plan.snapshot.peaked and plan.observed.rated[slot]
            row = plan.snapshot.place(PEAKS.name).start if peaked else first["contact_force"]
            places.append(slots + row + slot)
            paces.append(slots + row + slot)
            kinds.append(AT_STEPS)
        else:
            slots, own = slots_and_weights(limit, plan)
            places.append(first["displacement"] + slots)
            paces.append(first["velocity"] + slots)
            kinds.append(_kind(limit, plan))
        weights.append(own)
        contact = limit.quantity == "indentation"
        offsets.append(plan.system.clearance[plan.system.contacts.index(limit.name)] if contact else 0.0)
    begins = np.cumsum([0, *map(len, weights)]).astype(np.int64)
    rows, rates, factors = (np.concatenate(item) for item in (places, paces, weights))
    return Forms(begins, rows, rates, factors, np.array(offsets), np.array(kinds, dtype=np.int64))


def _kind(limit: Limit, plan: Plan) -> int:
    """Return what a limit is of, see `impactlab.kernels.bridges`."""
    if limit.quantity == "velocity":
        return OF_VELOCITY
    hard = limit.quantity == "indentation" and plan.system.contacts.index(limit.name) in plan.events.impulsive
    return AT_IMPACT if hard and limit.high is not None else OF_DISPLACEMENT


class NoiseOnLimits(NamedTuple):
    """The white noise on what limits are of."""

    density: np.ndarray  # (limit,) of accelerations, at unit densities where these vary in time (m2 s-3)
    shares: np.ndarray  # (limit, noise) of each noise in it

    @classmethod
    def of(cls, limits: Sequence[Limit], plan: Plan) -> NoiseOnLimits:
        """Return the noise on what limits of a plan are of."""
        noise, mass = plan.noise, plan.system.linear[0]
        on_bodies = np.zeros(len(mass))
        on_bodies[noise.white] = 2.0 * math.pi * noise.intensity / mass[noise.white] ** 2
        places = noise.white[noise.shares.body]
        density, shares = np.zeros(len(limits)), np.zeros((len(limits), noise.shares.noises))
        for row, limit in enumerate(limits):
            if limit.quantity == "contact_force":
                continue
            weights = np.zeros(len(mass))
            np.add.at(weights, *slots_and_weights(limit, plan))
            parts = weights**2 * on_bodies
            np.add.at(shares[row], noise.shares.noise, parts[places] * noise.shares.share)
            density[row] = parts.sum() * _common_part(weights, plan)
        total = shares.sum(axis=1, keepdims=True)
        return cls(density, np.divide(shares, total, out=np.zeros_like(shares), where=total > 0.0))


def _common_part(weights: np.ndarray, plan: Plan) -> float:
    """Return the variance of a weighted sum of noises over that of independent ones: bodies may have one noise."""
    noise = plan.noise
    parts = weights[noise.rows] * noise.amplitude[0, 1]
    if not parts.any():
        return 1.0
    _, which = np.unique(noise.streams, axis=1, return_inverse=True)
    together = np.bincount(which.ravel(), parts)
    return float((together**2).sum() / (parts**2).sum())


def tables_of(limits: Sequence[Limit], kinds: np.ndarray, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Return tables of bridges under noise of unit density, and where that of each limit begins."""
    tables = []
    for limit, kind in zip(limits, kinds.tolist(), strict=True):
        linear = np.array([1.0, 0.0, 0.0])
        if kind != AT_STEPS:
            slots, _ = slots_and_weights(limit, plan)
            if len(slots) == 1:
                linear = plan.system.linear[:, slots[0]] / plan.system.linear[0, slots[0]]
        tables.append(bridges(linear, plan.clock.step, LEVELS[kind]))
    return np.concatenate(tables), np.cumsum([0, *map(len, tables)]).astype(np.int64)


def bridges(linear: np.ndarray, step: float, levels: int) -> np.ndarray:
    """Return the table of the bridges of a body (mass 1, damping and stiffness), in a step and its halves (s)."""
    _, damping, stiffness = (np.array([value]) for value in linear)
    finest = math.ceil(math.log2(max(damping[0] * step / LONGEST_PART, 1.0)))
    levels = min(max(levels, finest), DEEPEST) if levels else 0
    halves = [step / 2.0**level for level in range(1, levels + 3)]
    found = transitions(np.ones(1), damping, stiffness, np.array([0.5 / math.pi]), halves)
    table = np.zeros((levels + 1, COLUMNS))
    for row, half, (a, q) in zip(table, halves, found, strict=False):
        before, after = np.linalg.inv(q[0]), a[0].T @ np.linalg.inv(q[0])
        covariance = np.linalg.inv(before + after @ a[0])
        weights = covariance @ np.hstack([before @ a[0], after])
        row[MEAN_X : MEAN_X + 4], row[MEAN_V : MEAN_V + 4] = weights
        root = math.sqrt(covariance[0, 0])
        row[ROOT : ROOT + 2] = root, covariance[1, 0] / root
        row[ROOT + 2] = math.sqrt(max(covariance[1, 1] - row[ROOT + 1] ** 2, 0.0))
        row[SPAN_OF_PART], row[VARIANCE] = 2.0 * half, 2.0 * half
        row[REACH] = min(2.0 * half / 3.0, 1.0 / damping[0] if damping[0] > 0.0 else math.inf)
    return table


def largest_step(limits: Sequence[Limit], model: Model) -> float:
    """Return the step beyond which limits might be passed and returned from unseen (s)."""
    stiffness = model.stiffness.copy()
    links, springs = model.coupled, model.couplings.linear[0]
    moving = links.slots < len(stiffness)
    np.add.at(stiffness, links.slots[moving], (links.weights**2 * springs[links.rows])[moving])
    squares, rates = np.maximum(stiffness, 0.0) / model.mass, model.damping / model.mass
    result = math.inf
    for limit in limits:
        slots = _bodies(limit, model)
        fastest = float(np.max(squares[slots] / np.maximum(np.maximum(np.sqrt(squares), rates)[slots], 1e-300)))
        if fastest > 0.0:
            result = min(result, PER_RADIAN / fastest)
        if len(slots) > 1 and rates[slots].any():  # bridges between bodies know no damping
            result = min(result, LONGEST_PART / float(rates[slots].max()))
        result = min(result, _between_impulses(slots, model))
    return result


def _between_impulses(slots: np.ndarray, model: Model) -> float:
    """Return the largest step in which impulses on some bodies are seldom several (s)."""
    impulses = model.sources["impulses"]
    bodies, sources = impulses.drives.body, impulses.drives.source
    chosen = np.unique(sources[np.isin(bodies, slots)])
    rate = sum(impulses.excitations[source].impulses()[0] for source in chosen)
    return IMPULSES / rate if rate > 0.0 else math.inf


def _bodies(limit: Limit, model: Model) -> np.ndarray:
    """Return the slots of the bodies that a limit is of."""
    if limit.quantity in ("indentation", "contact_force"):
        ends = model.ends.chosen(np.array([model.contacts.names.index(limit.name)]))
        slots = ends.slots
    elif limit.name in model.bodies.names:
        slots = np.array([model.bodies.names.index(limit.name)])
    else:
        slots = np.array([slot for slot, _ in dict(model.points)[limit.name]])
    return np.unique(slots[slots < len(model.bodies)])


def limited_bodies(limits: Sequence[Limit], model: Model) -> np.ndarray:
    """Return whether a limit is of each body, (body,)."""
    found = np.zeros(len(model.bodies), dtype=bool)
    for limit in limits:
        found[_bodies(limit, model)] = True
    return found
