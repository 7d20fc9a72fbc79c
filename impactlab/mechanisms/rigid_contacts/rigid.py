"""Rigid contacts: which networks have them, how impacts change velocities, and what noise hides of their moments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Self

import numpy as np

from impactlab.assembly.links import Links
from impactlab.assembly.mechanism import Mechanism, Method, Mode, followed, linked, refuse_unless
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.integrators.located import NO_FOLLOWER, Follower
from impactlab.kernels.random import addresses
from impactlab.mechanisms.rigid_contacts.impacts import (
    COUNTED,
    ENDLESS,
    MANY,
    PATHS,
    RESTITUTION,
    SEEN,
    SLOW,
    Impacts,
    RigidContacts,
    collisions,
    gather_impulses,
    show_impacts,
)
from impactlab.memory_limits import available
from impactlab.plan.events import EventPart, Remarks, Room, Times

RESOLVED = 0.7
"""Order from which on a measurement tells what a step does not resolve of the rate of impacts."""

OVERLAP = 1e-9
"""Overlap of a rigid contact allowed at a start, relative to displacements: bodies that rest overlap by rounding."""

BYTES_OF_PAIR = 120
"""Memory of a pair of contacts that share a body, while all are found."""

LEAST_ORDER = 0.05
"""Order that is taken where the rate of impacts does not converge."""

SLOWEST, SLOWEST_UNDER_NOISE = 1e-4, 0.01
"""Part of the usual closing velocity from which on impacts count that may be endlessly many in finite time.

Where nothing is random these follow each other like a geometric series, to any velocity, and what is usual may be far
off; filtered noise that hardly presses lifts and drops bodies again and again, which steps do not resolve.
"""


class RigidContactsInFlow(Mechanism):
    """Contacts of rigid bodies: impacts are located within the flow of every step."""

    name = "rigid contacts"
    modes = frozenset({Mode.ONE_LANE, Mode.SAMPLES, Mode.LOCATED})
    in_flow = True
    strikes = True

    def there(self, model: Model) -> bool:
        return bool(model.contacts.impulsive.any())

    def bodies(self, model: Model) -> np.ndarray:
        return linked(model, model.ends, model.contacts.impulsive)

    def place(self, model: Model) -> str:
        return model.contacts.names[int(model.contacts.impulsive.argmax())]

    def refuse(self, model: Model, method: Method) -> None:
        refuse_unless(method.collides, self, model, method)

    def events(self, model: Model, step: float, seed: tuple[int, int], energy: np.ndarray | float) -> RigidImpacts:
        return RigidImpacts.of(model, step, seed, energy)


class Gains(NamedTuple):
    """Variances that white noises of unit density add to rates of contacts in unit time."""

    number: int  # of contacts
    contact: np.ndarray  # (pair,) pairs of a contact and a noise that pushes one of its bodies
    noise: np.ndarray
    variance: np.ndarray

    @classmethod
    def of(cls, model: Model, slots: np.ndarray, pushes: np.ndarray, rows: np.ndarray, number: int) -> Self:
        """Return those of a number of contacts, from ``w/m`` of their entries."""
        noise, body, weight = model.sources["intensity"].drives
        order = np.argsort(body, kind="stable")
        begin, end = (np.searchsorted(body[order], slots, side=side) for side in ("left", "right"))
        entry = np.repeat(np.arange(len(slots)), end - begin)
        drive = order[np.arange(len(entry)) - np.repeat(np.cumsum(end - begin) - end, end - begin)]
        most = max(int(noise.max(initial=0)) + 1, 1)
        pairs, place = np.unique(rows[entry] * most + noise[drive], return_inverse=True)
        rates = np.zeros(len(pairs))
        np.add.at(rates, place, pushes[entry] * weight[drive])
        return cls(number, pairs // most, pairs % most, 2.0 * np.pi * rates**2)

    @property
    def any(self) -> np.ndarray:
        """Whether noise changes the rate of each contact, (contact,) of bool."""
        return self.under(np.ones(int(self.noise.max(initial=-1)) + 1)) > 0.0

    def under(self, density: np.ndarray) -> np.ndarray:
        """Return the variances under noises of some densities, (…, noise), in unit time, (…, contact)."""
        result = np.zeros((self.number, *density.shape[:-1]))
        np.add.at(result, self.contact, np.moveaxis(density[..., self.noise] * self.variance, -1, 0))
        return np.ascontiguousarray(np.moveaxis(result, 0, -1))


@dataclass(frozen=True, eq=False)
class RigidImpacts(EventPart):
    """Rigid contacts of a run."""

    record: ClassVar[type] = Impacts
    after_flow = staticmethod(collisions)
    after_kick = staticmethod(show_impacts)
    after_step = staticmethod(gather_impulses)

    rigid: RigidContacts
    streams: np.ndarray  # (3, rigid) addresses of random numbers
    gains: Gains
    spread: np.ndarray  # (1, rigid) root mean square that noise adds to rates in unit time, at time 0

    @classmethod
    def of(cls, model: Model, step: float, seed: tuple[int, int], energy: np.ndarray | float = 0.0) -> Self:
        """Return the impacts of a model at a step (s), with the typical energies of its bodies (J).

        Without noise on its bodies a contact that loses energy comes to rest by endlessly many impacts wherever
        something presses it. The fast ones have a rate.
        """
        chosen = np.flatnonzero(model.contacts.impulsive)
        links = model.ends.chosen(chosen)
        slots, weights, rows = links.moving()
        by_links = np.ascontiguousarray(followed(model)[:, slots])
        inverse, inertia = 1.0 / model.mass, 1.0 / links.squares(1.0 / model.mass)
        shares = weights * inverse[slots] * inertia[rows]
        near_begin, near, influence = _neighbours(links, slots, weights, rows, shares, by_links[0])
        laws = [model.contacts.laws[contact] for contact in chosen]
        restitution = np.array([law.restitution for law in laws])  # type: ignore[attr-defined]
        gains = Gains.of(model, slots, weights * inverse[slots], rows, len(chosen))
        usual = np.sqrt(2.0 * np.broadcast_to(energy, len(model.bodies))[model.first_of(links)] / inertia)
        slow = SLOWEST_UNDER_NOISE if model.random.any() else SLOWEST
        endless = (restitution < 1.0) & ~gains.any & np.isfinite(usual)
        numbers = np.stack([model.clearance[chosen], restitution, inertia, np.where(endless, slow * usual, 0.0)])
        flow = np.stack([0.5 * model.damping * inverse, model.stiffness * inverse, step * inverse])
        begin = np.searchsorted(rows, np.arange(len(chosen) + 1))
        rigid = RigidContacts(
            chosen, begin, slots, weights, shares, numbers, flow, near_begin, near, influence, by_links
        )  # fmt: skip
        spread = np.sqrt(gains.under(model.noise.density))[None]
        names = [model.contacts.names[contact] for contact in chosen]
        return cls(rigid, addresses(seed, names, "impacts"), gains, spread)

    def check(self, model: Model, displacement: np.ndarray) -> None:
        """Refuse a start, (body,) or (body, realization), at which bodies of a rigid contact overlap."""
        rows = self.rigid.contacts
        gap = model.ends.chosen(rows).gap(displacement.reshape(len(model.bodies), -1))
        overlap = (gap - model.clearance[rows, None]).max(axis=1, initial=-np.inf)
        size = np.abs(displacement).max(initial=0.0) + np.abs(model.clearance[rows])
        for row in np.flatnonzero(overlap > OVERLAP * size)[:1]:
            raise InvalidInput(
                f"{model.contacts.names[rows[row]]!r} is rigid, and the start has its bodies {overlap[row]:.3g} m "
                "inside each other; give an initial= that has them apart."
            )

    @property
    def impulsive(self) -> np.ndarray:  # type: ignore[override]
        return self.rigid.contacts

    @property
    def orders(self) -> np.ndarray:
        """Power of the step with which the rate of impacts that it does not resolve falls, (rigid,).

        Noise at an impact hides closing velocities below ``v* ~ σ √h``. Near zero they have the density v^(−β), where
        ``2 sin(π (1 + 2β)/6) = e^(β − 2)``, of the paths of a body under white noise beside a wall (Burkhardt,
        Franklin and Gawronski, Phys. Rev. E 61, 2000, 2376): the flux ``∫ v^(1 − β)`` up to v* is as h^(1 − β/2).
        """
        values, which = np.unique(self.rigid.numbers[RESTITUTION], return_inverse=True)
        return np.array([_order(float(item)) for item in values])[which]

    @property
    def restless(self) -> np.ndarray:
        """Whether white noise ends rests at once, which then last for steps only, (rigid,) of bool."""
        return np.asarray((self.rigid.numbers[RESTITUTION] < 1.0) & self.gains.any)

    @property
    def unresolved(self) -> np.ndarray:
        """Whether noise makes impacts so many that their rate is that of a step, (rigid,) of bool."""
        return np.asarray((self.orders < RESOLVED) & self.restless)

    @property
    def counted(self) -> np.ndarray:
        """Closing velocity from which on impacts count, (rigid,) (m s-1); 0 where all do."""
        return np.asarray(self.rigid.numbers[COUNTED])

    @property
    def order(self) -> float:  # type: ignore[override]
        return float(self.orders.min())

    @property
    def dissipative(self) -> bool:  # type: ignore[override]
        return bool((self.rigid.numbers[RESTITUTION] < 1.0).any())

    def doubts(self, contacts: Sequence[str], step: float) -> list[tuple[str, str]]:
        return [
            (
                "small_impacts",
                f"contact_rate of {contacts[contact]!r} counts the impacts that the step of {step:.3g} s resolves: "
                "noise and loss make small ones so many that those it misses fall only with the step to the power of "
                f"{self.order:.2g}.",
            )
            for contact in self.rigid.contacts[self.unresolved][:1]
        ]

    def arrays(self, room: Room) -> Impacts:
        count, lanes, zeros = len(self.rigid.contacts), room.lanes, room.zeros
        return Impacts(
            within=0,
            rigid=self.rigid,
            streams=self.streams,
            realizations=np.zeros(0, dtype=np.uint32),
            spread=self.spread,
            ends=zeros((5, count, lanes)),
            paths=zeros((PATHS, count)),
            seen=zeros((SEEN, count, lanes)),
            closings=room.closings,
            depths=room.depths,
            follower=NO_FOLLOWER,
            shown=zeros((1, self.told * room.told, lanes)),
        )

    @property
    def told(self) -> int:  # type: ignore[override]
        return 2 * len(self.rigid.contacts) + len(self.rigid.bodies)

    def opened(self, arrays: Impacts, realizations: np.ndarray, follower: Follower) -> Impacts:
        return arrays._replace(realizations=realizations, follower=follower)

    def under_noise(self, density: np.ndarray) -> dict[str, np.ndarray]:
        return {"spread": np.sqrt(self.gains.under(density))}

    def lasting(self, arrays: Impacts) -> list[np.ndarray]:
        return [arrays.seen]

    def noted(self, arrays: Impacts) -> np.ndarray:
        """Return when impacts were too many or too slow, (2, rigid, lane).

        Numbers, from 1 on, of the first step with too many impacts, and of the last one with impacts that are too slow
        to count; 0 for none.
        """
        return np.asarray(arrays.seen[[ENDLESS, SLOW]])

    def slow(self, noted: np.ndarray) -> np.ndarray:
        return np.asarray(noted[1].any(axis=-1))

    def whole(self, finer: int, seen: float, slow: np.ndarray) -> np.ndarray:
        """Return the factor from the measured to the full bias of each rate; 0 where the rate does not converge.

        Where contacts chatter only fast impacts count, and their rate converges like other statistics.
        """
        return np.where(self.unresolved, 0.0, np.where(slow, 1.0, seen / (1.0 - finer**-self.orders)))

    def push(self, pushes: np.ndarray, closings: np.ndarray) -> None:
        np.maximum.at(pushes, self.rigid.bodies, np.repeat(closings[self.rigid.contacts], np.diff(self.rigid.begin)))

    def remarks(self, noted: np.ndarray, contacts: Sequence[str], times: Times, rates: bool) -> Remarks:
        thresholds = np.full(len(contacts), np.nan)
        last = noted[1].max(axis=-1, initial=0.0)
        slow = rates & (last > times.spin_up)
        thresholds[self.rigid.contacts] = np.where(slow, self.counted, np.nan)
        comments = {}
        if self.restless.any():
            comments["contact_ratio"] = (
                "White noise ends a rest of a rigid contact at once: of such contacts this is the part of the steps of "
                f"{times.step:.3g} s at rest, and falls with the step."
            )
        warnings = [*_endless(self.rigid.contacts, noted[0], contacts, times), *_chatter(thresholds, contacts)]
        return Remarks(warnings, thresholds, comments)


def _endless(rigid: np.ndarray, steps: np.ndarray, contacts: Sequence[str], times: Times) -> list[tuple[str, str]]:
    """Say which rigid contact had too many impacts in a step first, and when; nothing where none had."""
    if not steps.any():
        return []
    first = np.where(steps > 0.0, steps, np.inf).min(axis=-1)
    row = int(first.argmin())
    time = (first[row] - 1.0 - times.spin_up) * times.step
    name, lanes = contacts[rigid[row]], np.count_nonzero(steps[row])
    others = np.count_nonzero(np.isfinite(first)) - 1
    message = (
        f"Chatter of {name!r} does not end: it had more than {MANY} impacts in the step at t = {time:g} s, and in "
        f"{lanes} of {steps.shape[-1]} realization(s){f', as had {others} other contact(s)' if others else ''}. They "
        "are held at rest for what is left of such a step, which takes energy unless bodies rest on each other: give "
        "a shorter step=."
    )
    return [("many_impacts", message)]


def _chatter(thresholds: np.ndarray, contacts: Sequence[str]) -> list[tuple[str, str]]:
    """Name a contact whose slowest impacts do not count, and the closing velocity from which impacts count."""
    found = np.flatnonzero(np.isfinite(thresholds))
    if not found.size:
        return []
    others = f", nor of {found.size - 1} other contact(s)" if found.size > 1 else ""
    message = (
        f"{contacts[found[0]]!r} comes to rest by bouncing: its impacts are endlessly many in finite time, so that "
        f"they have no rate{others}. contact_rate counts those that close with {thresholds[found[0]]:.3g} m/s or more; "
        "see impact_velocity_threshold."
    )
    return [("chatter", message)]


def _order(restitution: float) -> float:
    """Return the order of a coefficient of restitution; `LEAST_ORDER` where impacts become endlessly many."""
    if restitution >= 1.0:
        return 1.0

    from scipy.optimize import brentq  # loaded only here

    def condition(beta: float) -> float:
        change: float = restitution ** (2.0 - beta)
        return 2.0 * math.sin(math.pi * (1.0 + 2.0 * beta) / 6.0) * change - 1.0

    most = 2.0 * (1.0 - LEAST_ORDER)  # the condition holds at 2, whatever the restitution
    if condition(0.0) >= 0.0 or condition(most) <= 0.0:
        return LEAST_ORDER
    return 1.0 - 0.5 * float(brentq(condition, 0.0, most))


def _neighbours(
    links: Links, slots: np.ndarray, weights: np.ndarray, rows: np.ndarray, shares: np.ndarray, by_links: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which contacts share a body with each, or a link that follows bodies, and how much their rates grow with
    its own.
    """
    order, number = np.argsort(slots, kind="stable"), len(links)
    begin, end = (np.searchsorted(slots[order], slots, side=side) for side in ("left", "right"))
    count = end - begin
    if (needed := float(BYTES_OF_PAIR * count.sum())) > (there := available()):
        raise InvalidInput(
            f"{number} rigid contacts have {count.sum():.3g} pairs that share a body, which would take "
            f"{needed / 1e9:.3g} GB of memory, but {there / 1e9:.3g} GB are available; give fewer contacts."
        )
    entry = np.repeat(np.arange(len(slots)), count)
    other = order[np.arange(len(entry)) - np.repeat(np.cumsum(count) - end, count)]
    apart = rows[entry] != rows[other]
    entry, other = entry[apart], other[apart]
    of_link: dict[int, dict[int, None]] = {}
    for row, link in zip(rows.tolist(), by_links.tolist(), strict=True):
        of_link.setdefault(link, {})[row] = None
    followed = [(row, link) for row, link in zip(rows.tolist(), by_links.tolist(), strict=True) if link >= 0]
    more = [row * number + near for row, link in followed for near in of_link[link] if near != row]
    keys = np.concatenate([rows[entry] * number + rows[other], np.array(more, dtype=np.int64)])
    pairs, first, place = np.unique(keys, return_index=True, return_inverse=True)
    influence = np.zeros(len(pairs))
    np.add.at(influence, place[: len(entry)], weights[other] * shares[entry])
    of_row = pairs // number
    kept = np.lexsort((first, of_row))  # those of a row in the order in which they are met
    return np.searchsorted(of_row[kept], np.arange(number + 1)), (pairs % number)[kept], influence[kept]
