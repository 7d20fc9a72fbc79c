"""What kinks and jumps of forces within a step do to the energy, and the step that keeps it small."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impactlab.assembly.links import Links, Pairs, joined
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.contact import ContactLaw, HertzContact, LinearContact, PowerLawContact, contact_forces
from impactlab.components.evaluation import of_objects
from impactlab.errors import WORTH_SAYING, warn
from impactlab.step_control.rules.profiles import Profiles, of_powers
from impactlab.step_control.rules.tangent_stiffness import Stiffening

KINK_HEATING = 5e-4
"""Largest part of their temperature by which kinks of contact forces may heat bodies."""


@kept
def kink_step(model: Model, stiffening: Stiffening, decay: np.ndarray | None = None) -> float:
    """Return the step at which what it does not resolve of forces heats no body by more than `KINK_HEATING` (s).

    A force whose slope jumps at the point of contact, such as a linear one, heats the bodies a
    little whenever it opens or closes, and so do kinks and jumps elsewhere. Friction takes it away; a body with little
    of it, or a contact that closes often, needs a smaller step. Heat may also be lost other than by friction, at the
    rate `decay` (s-1) of each item.
    """
    given, total = _decays(model)
    own = given if decay is None else decay
    step = _closing_step(model, stiffening, own[: len(model.ends)])
    passes = _passes(model, stiffening, own, total if decay is None else np.zeros_like(total))
    return step if passes is None else min(step, passes.largest_step())


def _decays(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Return at which rate friction cools the bodies of each item, and all bodies of its part together (s-1).

    Items are contacts, couplings, and bodies. A part is counted only if nothing cools the bodies of some item of it,
    which then warm those that something cools; otherwise it is 0.
    """
    mass, items, labels = model.mass, _items(model), model.connected
    own = items.squares(model.damping / mass**2) / items.squares(1.0 / mass)
    of_item = labels[model.first_of(items)]
    total = np.bincount(labels, model.damping / mass)
    linear = model.couplings.linear
    np.add.at(total, labels[model.first_of(model.coupled)], linear[1] * model.coupled.squares(1.0 / mass))
    kicked = np.concatenate([np.ones(len(model.ends), dtype=bool), ~linear.any(axis=0), model.bodies.residual])
    uncooled = np.zeros(len(total), dtype=bool)
    uncooled[of_item[kicked & (own == 0.0)]] = True
    return own, np.where(uncooled, total, 0.0)[of_item]


def _closing_step(model: Model, stiffening: Stiffening, decay: np.ndarray) -> float:
    """Return the step for kinks of powers where they begin, measured: ``0.016 r² (h Ω)⁴`` of T in a contact, or less.

    Ω is the frequency of the closed contact and r the part of its stiffness that is there at a tenth of the
    thermal penetration (1 for a linear law, 0.2 for Hertz contact).
    """
    mobility, compliance = model.ends.squares(1.0 / model.mass), _compliance(model, model.ends)
    heated = np.flatnonzero((decay > 0.0) & (stiffening.contacts > 0.0) & (powers_of(model)[1] >= 1.0))
    depth, tangent, clearance = (
        item[heated] for item in (stiffening.penetration, stiffening.contacts, model.clearance)
    )
    mobility, compliance, decay = mobility[heated], compliance[heated], decay[heated]
    laws = model.contacts.laws
    early = contact_forces([laws[slot] for slot in heated], 0.1 * depth[:, None])[:, 0] / (0.1 * depth * tangent)
    # how often the gap crosses the point of contact, by Rice's formula
    spring = 1.0 / compliance + np.where(clearance < 0.0, tangent, 0.0)
    often = _often(clearance, stiffening.energy[model.first_of(model.ends)[heated]], compliance)
    rate = np.sqrt(mobility * spring) / (2.0 * math.pi) * often
    counted = (rate > 0.0) & (early > 0.0)
    with np.errstate(over="ignore", divide="ignore"):  # a contact that closes once in 10^300 s heats nothing
        power = KINK_HEATING * decay[counted] / (0.016 * early[counted] ** 2 * rate[counted])
    roots = np.array([item**0.25 for item in power.tolist()])
    return float((roots / np.sqrt(tangent[counted] * mobility[counted])).min(initial=np.inf))


@kept
def powers_of(model: Model) -> np.ndarray:
    """Return stiffness and exponent of the laws that are known to be powers, NaN of others, (2, contact)."""
    return np.array(of_objects(_power_of, model.contacts.laws)).reshape(-1, 2).T


def _power_of(law: ContactLaw) -> tuple[float, float]:
    if type(law) is PowerLawContact:
        return law.stiffness, law.exponent
    if type(law) is HertzContact:
        return law.stiffness, 1.5
    return (law.stiffness, 1.0) if type(law) is LinearContact else (math.nan, math.nan)


@kept
def _items(model: Model) -> Links:
    """Return contacts and couplings, then each body by itself."""
    slots = np.arange(model.wall)
    return joined(model.links, Pairs(model.wall, np.stack([slots, np.full(model.wall, model.wall)], axis=1)))


def _compliance(model: Model, links: Links) -> np.ndarray:
    """Return the compliance along links of the bodies' own springs (m N-1)."""
    with np.errstate(divide="ignore"):
        return links.squares(1.0 / model.stiffness)


def _often(clearance: np.ndarray, energy: np.ndarray, compliance: np.ndarray) -> np.ndarray:
    """Return the density of gaps at the point of contact, over its peak, of bodies on their own springs."""
    with np.errstate(invalid="ignore"):
        spread = energy * compliance
    known = (spread > 0.0) & (spread < np.inf)
    exponent = -0.5 * np.maximum(clearance, 0.0) ** 2 / np.where(known, spread, np.inf)
    different, which = np.unique(exponent, return_inverse=True)
    return np.array([math.exp(item) for item in different.tolist()])[which]  # NumPy's own depends on the processor


class _Passes(NamedTuple):
    """Points that pass through forces: how often, what they get, and what takes it away."""

    profiles: Profiles
    rate: np.ndarray  # passes per time where the potential is least (s-1)
    temperature: np.ndarray  # (J)
    speed: np.ndarray  # sqrt(2T/m) (m s-1)
    decay: np.ndarray  # rate of cooling of their own, 0 where it does not count (s-1)
    total: np.ndarray  # and of their part
    part: np.ndarray  # label

    def largest_step(self) -> float:
        """Return the step at which kinks heat no body, and no connected part, by more than `KINK_HEATING`.

        Or half the step at which they heat ten times as much: the heat of jumps decreases like h² only.
        """
        distance, variance = self.profiles.distance, self.profiles.variance
        numbers = np.column_stack([distance, variance[:, ::8], *self[1:]])  # enough to tell which are equal
        _, first, counts = np.unique(numbers, axis=0, return_index=True, return_counts=True)
        profiles = self.profiles.rows(first)
        rate, temperature, speed, decay, total, part = (item[first] for item in self[1:])
        groups = part.astype(int)
        share = np.divide(counts, total, out=np.zeros_like(total), where=total > 0.0)
        with np.errstate(divide="ignore"):
            alone = np.where(decay > 0.0, 1.0 / decay, 0.0)

        def heating(logarithm: float) -> float:
            power = rate / temperature * profiles.heat(10.0**logarithm * speed, temperature)
            return float(max((power * alone).max(), np.bincount(groups, power * share).max()))

        times = profiles.distance / speed
        low, high = math.log10(times.min()) - 6.0, math.log10(times.max()) + 3.0

        def largest(allowed: float) -> float:
            if heating(high) <= allowed:
                return math.inf
            below, above = low, high
            # so a step of some ten decades is known to more than its three digits
            for _ in range(30):
                middle = 0.5 * (below + above)
                below, above = (below, middle) if heating(middle) > allowed else (middle, above)
            return float(10.0**below)

        step = max(largest(KINK_HEATING), 0.5 * largest(10.0 * KINK_HEATING))
        return float(f"{step:.3g}")  # on any processor


def _passes(model: Model, stiffening: Stiffening, decay: np.ndarray, total: np.ndarray) -> _Passes | None:
    """Return the passes through forces that are no smooth powers, and through all forces of parts with a `total`.

    All contacts of free bodies are included, for which Rice's formula does not hold. None if there are no passes.
    """
    contacts, items = len(model.ends), _items(model)
    temperature = stiffening.energy[model.first_of(items)]
    counted = (temperature > 0.0) & (temperature < np.inf) & ((decay > 0.0) | (total > 0.0))
    stiffness, exponent = powers_of(model)
    smooth, free = exponent >= 1.0, np.isinf(_compliance(model, model.ends))
    powers = counted[:contacts] & (stiffness > 0.0) & (~smooth | free | (total[:contacts] > 0.0))
    powers = np.flatnonzero(powers & (stiffening.penetration > 0.0))
    chosen, found = [powers], []
    if len(powers):
        eta, p = stiffness[powers], exponent[powers]
        length = ((p + 1.0) * temperature[powers] / eta) ** (1.0 / (p + 1.0))
        found.append(Profiles.of(of_powers(eta, p, length)))
        decay = decay.copy()
        decay[powers[smooth[powers] & ~free[powers]]] = 0.0  # which `_closing_step` counts
    first = 0
    for known, row in stiffening.profiles:
        useful = np.append(known.room > 0.0, False)  # the last for those without a row
        members = np.flatnonzero(counted[first : first + len(row)] & useful[row])
        if len(members):
            chosen.append(first + members)
            found.append(known.rows(row[members]))
        first += len(row)
    if not found:
        return None
    slots = np.concatenate(chosen)
    profiles = Profiles(*(np.concatenate(item) for item in zip(*found, strict=True)))
    thermal = np.sqrt(temperature[slots] * items.squares(1.0 / model.mass)[slots])
    density = 1.0 / profiles.room  # of places where the potential is least
    touching = slots < contacts
    if touching.any():
        of_contacts = slots[touching]
        density[touching] = _density(
            model, profiles.rows(touching), temperature[of_contacts], of_contacts, total[of_contacts] > 0.0
        )
    return _Passes(
        profiles,
        2.0 * density * thermal / math.sqrt(2.0 * math.pi),
        temperature[slots],
        math.sqrt(2.0) * thermal,
        decay[slots],
        total[slots],
        model.connected[model.first_of(items)[slots]].astype(float),
    )


def _density(
    model: Model, profiles: Profiles, temperature: np.ndarray, slots: np.ndarray, crowd: np.ndarray
) -> np.ndarray:
    """Return the density of the gaps of some contacts where their potential is least (m-1).

    Bodies that meet nothing else have that of their own springs. Others are kept together by their
    neighbours: at most as if the gap could have no more than its clearance and what thermal motion adds at both sides.
    """
    from scipy.special import erfcx, ndtr  # loaded only here

    ends, clearance = model.ends.chosen(slots), model.clearance[slots]
    compliance = _compliance(model, ends)
    often = _often(clearance, temperature, compliance)
    wide = np.maximum(clearance, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = np.sqrt(temperature * compliance)
        scaled = np.where(spread < np.inf, clearance / spread, 0.0)
        # the probability of an open gap, times e^(x²/2) where it is preloaded
        tail = np.where(scaled < 0.0, 0.5 * erfcx(np.maximum(-scaled, 0.0) / math.sqrt(2.0)), ndtr(scaled))
        open_ = math.sqrt(2.0 * math.pi) * spread * tail
    open_ = np.where(spread < np.inf, open_, wide) * np.exp(-profiles.begin)
    alone = often / (often * profiles.room + open_)
    crowd = crowd | ends.any(model.ends.numbers() > 1)
    return np.asarray(np.where(crowd, np.maximum(often / (2.0 * profiles.room + wide), alone), alone))


def warn_of_kinks(model: Model, stiffening: Stiffening, step: float, duration: float) -> None:
    """Warn of a step at which the energy of bodies that no friction cools may change by more than `WORTH_SAYING`."""
    if (model.damping > 0.0).all():
        return
    labels = model.connected
    braked = model.first_of(model.coupled)[model.couplings.linear[1] > 0.0]
    slowed = np.concatenate([np.flatnonzero(model.damping > 0.0), braked])
    free = ~np.isin(labels, labels[slowed]) & (not model.kicks.dissipative)
    if not free.any():
        return
    slots = model.first_of(_items(model))
    largest = kink_step(model, stiffening, np.where(free[slots], WORTH_SAYING**2 / (KINK_HEATING * duration), 0.0))
    if step > largest:
        warn(
            "kinks",
            f"Without friction the energy may change by more than {100.0 * WORTH_SAYING:g} % in {duration:g} s at the "
            f"automatic step of {step:.3g} s, since contacts open and close within steps; give step={largest:.2g} or "
            "less.",
        )
