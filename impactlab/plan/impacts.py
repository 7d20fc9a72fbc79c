"""Rigid contacts: how impacts change velocities, and what noise hides from their moments."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from impactlab.assembly.links import Links
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.integrators.arguments import Impacts, RigidContacts
from impactlab.integrators.interval_arguments import Zeros
from impactlab.kernels.impacts import COUNTED, PATHS, RESTITUTION, SEEN
from impactlab.kernels.random import addresses

RESOLVED = 0.7
"""Order from which on a measurement tells what a step does not resolve of the rate of impacts."""

OVERLAP = 1e-9
"""Part of the size of displacements by which bodies of a rigid contact may overlap at a start: that of a rest."""

LEAST_ORDER = 0.05
"""Order that is taken where the rate of impacts does not converge."""

SLOW, SLOW_UNDER_NOISE = 1e-4, 0.01
"""Part of the usual closing velocity from which on impacts count that may be endlessly many in finite time.

Where nothing is random these follow each other like a geometric series, to any velocity, and what is usual may be far
off; coloured noise that hardly presses lifts and drops bodies again and again, which steps do not resolve.
"""


_NOTHING, _NO_PLACES, _BEGIN = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64)
_NONE = RigidContacts(
    _NO_PLACES, _BEGIN, _NO_PLACES, _NOTHING, _NOTHING, np.zeros((4, 0)), np.zeros((3, 0)), _BEGIN, _NO_PLACES, _NOTHING
)


@dataclass(frozen=True, eq=False)
class RigidImpacts:
    """Rigid contacts of a run."""

    rigid: RigidContacts
    streams: np.ndarray  # (3, rigid) addresses of random numbers
    gains: np.ndarray  # (rigid, noise) variance that each white noise of unit density adds to rates in unit time
    spread: np.ndarray  # (1, rigid) root mean square that noise adds to rates in unit time, at time 0

    @classmethod
    def of(cls, model: Model, step: float, seed: tuple[int, int], energy: np.ndarray | float = 0.0) -> Self:
        """Return those of a model at a step (s), with the energies that its bodies usually have (J).

        Without noise on its bodies a contact that loses energy comes to rest by endlessly many impacts wherever
        something presses it. The fast ones have a rate.
        """
        if not model.rigid.any():
            noises = len(model.sources["intensity"].names)
            return cls(_NONE, addresses(seed, (), "impacts"), np.zeros((0, noises)), np.zeros((1, 0)))
        chosen = np.flatnonzero(model.rigid)
        links = model.ends.chosen(chosen)
        moving = links.slots < links.count
        slots, weights, rows = links.slots[moving], links.weights[moving], links.rows[moving]
        inverse, inertia = 1.0 / model.mass, 1.0 / links.squares(1.0 / model.mass)
        shares = weights * inverse[slots] * inertia[rows]
        near_begin, near, influence = _neighbours(links, slots, weights, rows, shares)
        laws = [model.contact_laws[contact] for contact in chosen]
        restitution = np.array([law.restitution for law in laws])  # type: ignore[attr-defined]
        gains = _gains(model, slots, weights * inverse[slots], rows, len(chosen))
        usual = np.sqrt(2.0 * np.broadcast_to(energy, len(model.bodies))[model.first_of(links)] / inertia)
        slow = SLOW_UNDER_NOISE if model.random.any() else SLOW
        endless = (restitution < 1.0) & (gains.sum(axis=1) == 0.0) & np.isfinite(usual)
        numbers = np.stack([model.clearance[chosen], restitution, inertia, np.where(endless, slow * usual, 0.0)])
        flow = np.stack([0.5 * model.damping * inverse, model.stiffness * inverse, step * inverse])
        begin = np.searchsorted(rows, np.arange(len(chosen) + 1))
        rigid = RigidContacts(
            chosen, begin, slots, weights, shares, numbers, flow, near_begin, near, influence
        )  # fmt: skip
        spread = np.sqrt(gains @ model.initial_densities)[None]
        names = [model.contacts[contact] for contact in chosen]
        return cls(rigid, addresses(seed, names, "impacts"), gains, spread)

    def check(self, model: Model, displacement: np.ndarray) -> None:
        """Refuse a start, (body,) or (body, realization), at which bodies of a rigid contact overlap."""
        rows = self.rigid.contacts
        gap = model.ends.chosen(rows).gap(displacement.reshape(len(model.bodies), -1))
        overlap = (gap - model.clearance[rows, None]).max(axis=1, initial=-np.inf)
        size = np.abs(displacement).max(initial=0.0) + np.abs(model.clearance[rows])
        for row in np.flatnonzero(overlap > OVERLAP * size)[:1]:
            raise InvalidInput(
                f"{model.contacts[rows[row]]!r} is rigid, and the start has its bodies {overlap[row]:.3g} m inside "
                "each other; give an initial= that has them apart."
            )

    @property
    def orders(self) -> np.ndarray:
        """Power of the step with which the rate of impacts that it does not resolve falls, (rigid,).

        Noise at an impact hides closing velocities below ``v* ~ σ √h``. Near zero they have the density v^(−β), where
        ``2 sin(π (1 + 2β)/6) = e^(β − 2)``, of the paths of a body under white noise beside a wall (Burkhardt,
        Franklin and Gawronski, Phys. Rev. E 61, 2000, 2376): the flux ``∫ v^(1 − β)`` up to v* is as h^(1 − β/2).
        """
        return np.array([_order(float(item)) for item in self.rigid.numbers[RESTITUTION]])

    @property
    def restless(self) -> np.ndarray:
        """Whether white noise ends rests at once, which then last for steps only, (rigid,) of bool."""
        return np.asarray((self.rigid.numbers[RESTITUTION] < 1.0) & (self.gains.sum(axis=1) > 0.0))

    @property
    def unresolved(self) -> np.ndarray:
        """Whether noise makes impacts so many that their rate is that of a step, (rigid,) of bool."""
        return np.asarray((self.orders < RESOLVED) & self.restless)

    @property
    def counted(self) -> np.ndarray:
        """Closing velocity from which on impacts count, (rigid,) (m s-1); 0 where all do."""
        return np.asarray(self.rigid.numbers[COUNTED])

    @property
    def dissipative(self) -> bool:
        """Whether impacts take energy."""
        return bool((self.rigid.numbers[RESTITUTION] < 1.0).any())

    def arrays(self, bodies: int, closings: np.ndarray, depths: np.ndarray, zeros: Zeros) -> Impacts:
        """Return what a block takes, with no realizations and no function yet.

        Closings are summed, from indentations, [contact, lane].
        """
        count, lanes = len(self.rigid.contacts), closings.shape[-1]
        return Impacts(
            function=0,
            rigid=self.rigid,
            streams=self.streams,
            realizations=np.zeros(0, dtype=np.uint32),
            spread=self.spread,
            ends=zeros((5, count, lanes)),
            paths=zeros((PATHS, count)),
            before=zeros(((bodies + 1) * bool(count), lanes)),
            seen=zeros((SEEN, count, lanes)),
            closings=closings,
            depths=depths,
        )


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
    links: Links, slots: np.ndarray, weights: np.ndarray, rows: np.ndarray, shares: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which contacts share a body with each, and how much their rates grow with that of each."""
    of_body: dict[int, list[int]] = {}
    for entry, slot in enumerate(slots.tolist()):
        of_body.setdefault(slot, []).append(entry)
    influence: list[dict[int, float]] = [{} for _ in range(len(links))]
    for entry, slot in enumerate(slots.tolist()):
        own = influence[rows[entry]]
        for other in of_body[slot]:
            if rows[other] != rows[entry]:
                own[int(rows[other])] = own.get(int(rows[other]), 0.0) + float(weights[other] * shares[entry])
    begin = np.cumsum([0, *map(len, influence)])
    near = np.array([contact for own in influence for contact in own], dtype=np.int64)
    return begin, near, np.array([value for own in influence for value in own.values()], dtype=float)


def _gains(model: Model, slots: np.ndarray, pushes: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Return what each white noise of unit density adds to the variance of rates, from ``w/m`` of the entries."""
    noises = model.sources["intensity"]
    number, body, weight = noises.drives
    entry, pair = np.nonzero(slots[:, None] == body)
    rates = np.zeros((count, len(noises.names)))
    np.add.at(rates, (rows[entry], number[pair]), pushes[entry] * weight[pair])
    return np.asarray(2.0 * np.pi * rates**2)
