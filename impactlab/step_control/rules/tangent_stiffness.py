"""Estimates before a run: energies, and the stiffness of contacts, couplings and residual forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Self

import numpy as np

from impactlab.assembly.model import Model, same
from impactlab.assembly.remembered import kept
from impactlab.components.contact import ContactLaw, HertzContact, LinearContact, PowerLawContact, contact_forces
from impactlab.components.evaluation import TIME, call_each, distinct, of_classes
from impactlab.components.oscillator import DuffingOscillator
from impactlab.linear.damping import damped
from impactlab.linear.given_functions import irregular_times, kinds_of, largest_energy, look, span_of
from impactlab.linear.laws import flexibility, hottest, other_variances, spread, white_variances
from impactlab.quadrature import mean_rule
from impactlab.step_control.rules.profiles import COLUMNS, REACH, Profiles, of_force

PLAIN = (LinearContact, HertzContact, PowerLawContact, DuffingOscillator)
"""Laws that have no kinks but where they begin, and a stiffness that is a power of the energy."""

SCATTER = 1.5
"""Factor between energies that a short pilot finds and those that the step is made for."""

MOMENTS = 12
"""Times of a run at which laws that depend on time are looked at."""

_BEGIN = np.zeros(1)

AHEAD = np.geomspace(1.0, 1e12, 600)
"""Places, over that of a body, where forces are looked at that pull it outwards: a twentieth more each."""

BESIDE = 1e-6
"""Part of a place, or of 1 m, by which slopes of forces are taken on both sides."""

LARGER = 1.1
"""Factor by which another stiffness of a law must exceed the tangent at the thermal energy to replace it."""


@kept
def energies(model: Model, start: str | np.ndarray, duration: float, spin_up: float = 0.0) -> np.ndarray:
    """Return the energy that each body may bring into a collision (J), (body,).

    It is the temperature ``m E[v²]`` of the hottest body in the connected part, or the
    energy of the start, of a large impulse or of the response to a given force, whichever is largest.
    """
    heat = _heat(model, duration, spin_up)
    if isinstance(start, np.ndarray):
        heat = np.maximum(heat, energy_of(model, start))
    given = ~model.bodies.free
    heat, led = np.where(given, 0.0, heat), model.kicks.timed.copy()
    led[[*model.sources["force"].bodies]] = True
    for slot in np.flatnonzero(led & ~given).tolist():
        heat[slot] = max(heat[slot], largest_energy(model, slot, -spin_up, duration))
    return hottest(model, heat)


@kept
def _heat(model: Model, duration: float, spin_up: float) -> np.ndarray:
    """Return the temperature of each body under its noise, and of a large push (J), (body,)."""
    noises, densities, of_time = model.sources["intensity"], model.noise.density.copy(), kinds_of(model)
    for number, excitation in enumerate(noises.excitations if of_time else ()):
        if excitation in of_time:
            densities[number] = look(model, excitation, *span_of(excitation, -spin_up, duration))[1].max()
    intensity = noises.added(densities, len(model.bodies))
    heat = model.mass * white_variances(damped(model)[0], densities)[1]
    growing = ~np.isfinite(heat)  # as long as the run lasts
    heat[growing] = 2.0 * np.pi * intensity[growing] * (spin_up + duration) / model.mass[growing]
    heat += model.mass * other_variances(model)[1]
    for item in model.mechanisms:
        heat = np.maximum(heat, item.sudden_energies(model, -spin_up, duration))
    return np.asarray(heat)


def moments(model: Model, begin: float, end: float) -> np.ndarray:
    """Return times between two others at which laws that depend on time are looked at, 0 where there are none (s)."""
    return irregular_times(begin, end, MOMENTS) if model.kicks.timed.any() and end > begin else _BEGIN


def measured_energies(model: Model, velocity: np.ndarray) -> np.ndarray:
    """Return the energy that bodies bring into collisions where their mean square velocities are known (J), (body,).

    Of contacts and couplings it is that of their relative motion at most, ``E[v₁²] + E[v₂²]`` over 1/m₁ + 1/m₂, or
    ``Σ w² E[v²]`` over ``Σ w²/m``: a heavy base that is shaken brings no more of its own.
    """
    links = model.links
    energy = np.append(np.where(model.bodies.residual, model.mass * velocity, 0.0), 0.0)
    np.maximum.at(energy, links.slots, (links.squares(velocity) / links.squares(1.0 / model.mass))[links.rows])
    return SCATTER * energy[:-1]


def energy_of(model: Model, start: np.ndarray) -> np.ndarray:
    """Return the energy of each body in a given state, with that of its contacts and couplings (J), (body,).

    For states of several realizations, (2, body, realization), each part is the largest among them.
    """
    displacement, velocity = start.reshape(2, len(model.mass), -1)
    mass = np.where(model.bodies.free, model.mass, 0.0)[:, None]
    energy = 0.5 * model.stiffness[:, None] * displacement**2 + 0.5 * mass * velocity**2
    result = np.append(energy.max(axis=1), 0.0)
    contacts = _Forces(model.contacts.laws, np.zeros(len(model.ends)), _CONTACT)
    couplings = _Forces(model.couplings.laws, np.zeros(len(model.coupled)))
    of_contacts = contacts.work(model.ends.gap(displacement).max(axis=1) - model.clearance)
    np.add.at(result, model.ends.slots, of_contacts[model.ends.rows])
    extensions = -model.coupled.gap(displacement)
    shortest, longest = (couplings.work(end) for end in (extensions.min(axis=1), extensions.max(axis=1)))
    of_couplings = np.maximum(np.maximum(shortest, longest), 0.0)
    np.add.at(result, model.coupled.slots, of_couplings[model.coupled.rows])
    slots = np.flatnonzero(model.bodies.residual & model.bodies.free)
    if len(slots):
        own = displacement[slots]
        nearest = np.take_along_axis(own, np.abs(own).argmin(axis=1)[:, None], axis=1)[:, 0]
        result[slots] += np.max([_of_residuals(model, slots, x) for x in (own.min(1), own.max(1), nearest)], axis=0)
    return result[:-1]


def _of_residuals(model: Model, slots: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the energy that residual forces of some bodies give them from their places on (J), (row,).

    It is that which is stored where they pull inwards, and what they do from there until they and the spring pull
    inwards.
    """
    forces = _Forces([model.bodies.oscillators[slot] for slot in slots.tolist()], np.zeros(len(slots)), "residual")
    further = place[:, None] * AHEAD
    outwards = -np.sign(place)[:, None] * (forces.at(further) + model.stiffness[slots, None] * further)
    outwards[:, np.isnan(outwards).any(axis=0)] = 0.0
    leads = np.logical_and.accumulate(outwards > 0.0, axis=1)
    parts = 0.5 * (outwards[:, 1:] + outwards[:, :-1]) * np.diff(np.abs(further), axis=1)
    stored = np.maximum(forces.work(place, spring=np.zeros(len(slots))), 0.0)
    return np.asarray(stored + np.where(leads[:, 1:], parts, 0.0).sum(axis=1))


def slopes_at(model: Model, place: np.ndarray) -> np.ndarray:
    """Return the sizes of the slopes of residual forces at places of the bodies, (body,) (N m-1)."""
    result, slots = np.zeros(len(place)), np.flatnonzero(model.bodies.residual & model.bodies.free)
    forces = _Forces([model.bodies.oscillators[slot] for slot in slots.tolist()], np.zeros(len(slots)), "residual")
    x = place[slots]
    width = BESIDE * np.where(x != 0.0, np.abs(x), 1.0)
    if len(slots):
        result[slots] = np.abs(np.diff(forces.at(np.stack([x - width, x + width], axis=1)))[:, 0]) / (2.0 * width)
    return result


@dataclass(frozen=True, eq=False)
class Stiffening:
    """What contacts, couplings and residual forces add to the bodies' own stiffness at a given energy."""

    energy: np.ndarray  # (body,) (J)
    penetration: np.ndarray  # (contact,) thermal plus static (m)
    contacts: np.ndarray  # (contact,) tangent stiffness there, or the largest weighted one of the profile (N m-1)
    couplings: np.ndarray  # (coupling,) the same of the couplings (N m-1)
    bodies: np.ndarray  # (body,) the same of the residual forces (N m-1)
    rest: np.ndarray  # (body,) displacements under the static forces of contacts with negative clearance (m)
    profiles: tuple[tuple[Profiles, np.ndarray], ...]
    """Forces of contacts, couplings and bodies over all energies, NaN where they are known to be powers, and the row of
    each item, -1 where it has none.
    """
    times: np.ndarray
    """Times at which laws that depend on time were evaluated (s); numbers of a law are those where it is stiffest."""

    @property
    def plain(self) -> bool:
        """Whether all forces are known powers, whose stiffness at larger energies is that of no other branch."""
        return not any((places >= 0).any() and not np.isnan(known.room).all() for known, places in self.profiles)

    @property
    def links(self) -> np.ndarray:
        """Tangent stiffness of the contacts, then of the couplings (N m-1)."""
        return np.concatenate([self.contacts, self.couplings])

    @classmethod
    def of(cls, model: Model, energy: np.ndarray, times: np.ndarray = _BEGIN) -> Stiffening:
        """Evaluate a scene at some energies of its bodies, and laws that depend on time at some times (s).

        The thermal penetration δ stores the energy, ``∫₀^δ F = E``; for ``F = η δ^p`` it is
        ``((p + 1) E/η)^(1/(p + 1))``. The static penetration is the overlap of a negative clearance.
        """
        columns, count = _contact_rows(model, energy), 3 + COLUMNS
        found = _at_stiffest(_penetrations, model.contacts.laws, columns, "force", times, 1, count)
        return cls._with_contacts(model, energy, times, *found)

    @classmethod
    def of_each(cls, models: Sequence[Model], energies: Sequence[np.ndarray]) -> list[Self]:
        """Evaluate several networks in which no law depends on time, with all their contacts together."""
        rows = [_contact_rows(*scene) for scene in zip(models, energies, strict=True)]
        laws, columns = same([law for model in models for law in model.contacts.laws]), np.concatenate(rows, axis=1)
        found, places = _at_stiffest(_penetrations, laws, columns, "force", _BEGIN, 1, 3 + COLUMNS)
        result = []
        lengths = [len(model.contacts.laws) for model in models]
        for model, energy, chosen in zip(models, energies, _split(places, lengths), strict=True):
            own, at = np.unique(chosen, return_inverse=True)
            result.append(cls._with_contacts(model, energy, _BEGIN, found[:, own], at))
        return result

    @classmethod
    def _with_contacts(
        cls, model: Model, energy: np.ndarray, times: np.ndarray, found: np.ndarray, places: np.ndarray
    ) -> Self:
        """Return the stiffening of a network from the columns of `_penetrations` and the column of each contact."""
        yielding = flexibility(model)
        penetration, tangent, force = found[:3, places]
        of_contacts = Profiles.of(found[3:]), places
        rest = model.ends.pushes(force)
        rest = np.where(np.isfinite(yielding), rest * np.minimum(yielding, 1e300), 0.0)
        springs, heats = model.couplings.linear[0], energy[model.first_of(model.coupled)]
        none, own, found_of = np.zeros_like(springs), model.bodies, []
        for kernel, members, chosen, beside, heat in (
            ("force", model.couplings.laws, springs == 0.0, none, heats),
            ("residual", own.oscillators, own.residual, model.stiffness, energy),
        ):
            nothing = np.zeros(len(members)), (of_contacts[0].rows(np.zeros(0, int)), np.full(len(members), -1))
            found_of.append(_beside_springs(kernel, members, chosen, beside, heat, times) if chosen.any() else nothing)
        (couplings, of_couplings), (bodies, of_bodies) = found_of
        profiles = of_contacts, of_couplings, of_bodies
        return cls(energy, penetration, tangent, springs + couplings, bodies, rest, profiles, times)


def _contact_rows(model: Model, energy: np.ndarray) -> np.ndarray:
    """Return time, energy, overlap and compliance of each contact, (4, contact)."""
    overlap = np.maximum(-model.clearance, 0.0)
    compliance = np.where(overlap > 0.0, model.ends.squares(flexibility(model)), 0.0)
    return np.stack([np.zeros(len(model.ends)), energy[model.first_of(model.ends)], overlap, compliance])


def _split(items: np.ndarray, lengths: Sequence[int]) -> list[np.ndarray]:
    """Return successive parts of some lengths."""
    return np.split(items, np.cumsum(lengths)[:-1])


_NODES, _WEIGHTS = mean_rule(12)
_CONTACT = "contact"


class _Forces(NamedTuple):
    """Forces of some members at a time each."""

    members: Sequence[Any]
    times: np.ndarray  # (member,)
    kernel: str = "force"  # or "residual", or `_CONTACT` for forces that are 0 where contacts are open

    def at(self, place: np.ndarray, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the forces of the members of some rows at their places, (row, point)."""
        members = self.members if isinstance(rows, slice) else [self.members[row] for row in rows]
        times = self.times[rows, None]
        if self.kernel == _CONTACT:
            return contact_forces(members, place, times)
        return call_each(members, self.kernel, place, np.zeros_like(place), times)

    def work(
        self, length: np.ndarray, rows: np.ndarray | slice = slice(None), spring: np.ndarray | None = None
    ) -> np.ndarray:
        """Return integrals of the forces from 0 to some lengths, of either sign, (row,) (J).

        Beside a spring, (row,) (N m-1), forces that pull outwards do not count.
        """
        x = length[:, None] * _NODES
        force = self.at(x, rows)
        if spring is not None:
            force = spring[:, None] * x + np.sign(x) * np.maximum(np.sign(x) * force, 0.0)
        return np.asarray(length * (_WEIGHTS * force).sum(axis=1))


def _at_stiffest(
    function: Callable[..., np.ndarray], members: Sequence[Any], columns: np.ndarray, kernel: str, times: np.ndarray,
    row: int, count: int,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return a function of members, times (0 in the columns) and numbers, (count, place), and each member's place.

    The function is asked once for members that are equal. The place is that of the stiffest time, which maximizes one
    row of the results; laws that do not depend on time have the same at all times.
    """
    if not members:
        return np.zeros((count, 0)), np.zeros(0, dtype=int)
    timed = np.array(of_classes(lambda kind: TIME in kind.kernel(kernel)[1], members), dtype=bool)
    times = times if timed.any() else _BEGIN
    moments = np.where(timed[:, None], times, 0.0).ravel()
    columns = np.concatenate([moments[None], np.repeat(columns[1:], len(times), axis=1)])
    members = [item for item in members for _ in times]
    first, places = distinct(members, [*columns])
    found = function([members[row] for row in first.tolist()], *(column[first] for column in columns))
    places = places.reshape(len(timed), len(times))
    return found, places[np.arange(len(timed)), found[row, places].argmax(axis=1)]


def _beside_springs(
    kernel: str, members: Sequence[Any], chosen: np.ndarray, springs: np.ndarray, energy: np.ndarray,
    times: np.ndarray,
) -> tuple[np.ndarray, tuple[Profiles, np.ndarray]]:  # fmt: skip
    """Return the stiffness of chosen members beside springs, 0 of others, and profiles as `Stiffening` has them."""
    slots = np.flatnonzero(chosen)
    some = [members[slot] for slot in slots.tolist()]
    rows = np.stack([np.zeros(len(slots)), springs[slots], energy[slots]])
    found, places = _at_stiffest(partial(_tangents, kernel), some, rows, kernel, times, 0, 1 + COLUMNS)
    stiffness, at = np.zeros(len(members)), np.full(len(members), -1)
    stiffness[slots], at[slots] = found[0, places], places
    return stiffness, (Profiles.of(found[1:]), at)


def _tangents(
    kernel: str, members: Sequence[Any], times: np.ndarray, stiffness: np.ndarray, energy: np.ndarray
) -> np.ndarray:
    """Stiffness of forces that act on both sides, beside a spring, and their profiles, (1 + COLUMNS, row).

    It is the largest tangent within the amplitudes where they and the spring have stored the energy, or that
    of the profile.
    """
    forces = _Forces(members, times, kernel)

    def stored(sign: float, amplitude: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return forces.work(sign * amplitude, rows, stiffness[rows])

    def on_both_sides(amplitude: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.asarray(np.minimum(stored(1.0, amplitude, rows), stored(-1.0, amplitude, rows)))

    amplitude = _solve(on_both_sides, energy)
    x = np.linspace(-amplitude, amplitude, 65, axis=1)
    steepest = [np.gradient(*pair).max() if pair[1][-1] else 0.0 for pair in zip(forces.at(x), x, strict=True)]
    right, left = (_solve(partial(stored, sign), _far(members, energy)) for sign in (1.0, -1.0))
    right, left = np.where(right > 0.0, right, left), np.where(left > 0.0, left, right)
    spring = stiffness, np.zeros_like(stiffness)
    return _with_profiles(np.maximum(steepest, 0.0)[None], forces, -left, right, energy, *spring)


def _far(members: Sequence[Any], energy: np.ndarray) -> np.ndarray:
    """Energies up to which profiles are made (J); 0 for laws that a single number describes."""
    return np.where([type(item) in PLAIN for item in members], 0.0, REACH * energy)


def _with_profiles(
    known: np.ndarray,
    forces: _Forces,
    low: np.ndarray,
    high: np.ndarray,
    energy: np.ndarray,
    spring: np.ndarray,
    rest: np.ndarray,
) -> np.ndarray:
    """Return rows of known numbers, the stiffness first, with the rows of profiles below.

    A profile replaces the stiffness only where it is clearly larger, so that power laws keep their exact value.
    """
    profiles = np.full((COLUMNS, len(energy)), np.nan)
    for row in np.flatnonzero(low < high).tolist():
        columns = (float(item[row]) for item in (low, high, energy, spring, rest))
        one = partial(forces.at, rows=np.array([row]))
        profiles[:, row] = of_force(lambda places, one=one: one(places[None])[0], *columns)  # type: ignore[misc]
    larger = profiles[0] > LARGER * known[0]
    known[0, larger] = [float(f"{item:.3g}") for item in profiles[0, larger].tolist()]  # on any processor
    return np.concatenate([known, profiles])


@kept
def gap_scale(model: Model, stiffening: Stiffening) -> np.ndarray:
    """Return the length over which the density of each gap varies near contact (m).

    It is the penetration or the spread of the gap, whichever is smaller, or that of another contact
    which a body of it has: penetration and spread of what is touched there. 1 if nothing moves.
    """
    variance, penetration = spread(model)[0] ** 2, stiffening.penetration
    of_gap = np.sqrt(model.ends.squares(variance))
    depth = np.where(penetration > 0.0, penetration, np.inf)
    scale = np.where(penetration > 0.0, np.minimum(penetration, np.where(of_gap > 0.0, of_gap, np.inf)), of_gap)
    narrowest = np.full(model.wall + 1, np.inf)
    unknown = np.where(np.isnan(variance), np.inf, variance)  # of free bodies without noise
    size, slots, rows = np.abs(model.ends.weights), model.ends.slots, model.ends.rows
    np.minimum.at(narrowest, slots, np.hypot(depth[rows], np.sqrt(model.ends.others(unknown))) / size)
    narrowest[-1] = np.inf  # a wall keeps no bodies from each other
    with np.errstate(invalid="ignore"):  # unknown spreads stay so
        np.minimum.at(scale, rows, size * narrowest[slots])
    return np.where((scale > 0.0) & np.isfinite(scale), scale, 1.0)


def _penetrations(
    laws: Sequence[ContactLaw], times: np.ndarray, energy: np.ndarray, overlap: np.ndarray, compliance: np.ndarray
) -> np.ndarray:
    """Penetrations, stiffnesses, static forces and profiles of contacts, (3 + COLUMNS, contact)."""
    forces = _Forces(laws, times, _CONTACT)

    def pressed(depth: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.asarray(depth + compliance[rows] * forces.at(depth[:, None], rows)[:, 0])

    thermal = _solve(forces.work, energy)
    static = _solve(pressed, np.where(compliance < np.inf, overlap, 0.0))
    depth = thermal + static
    width = 1e-3 * depth
    low, middle, high, at_rest = forces.at(np.stack([depth - width, depth, depth + width, static], axis=1)).T
    closed = depth > 0.0
    rise = np.subtract(high, low, out=np.full_like(depth, np.inf), where=np.isfinite(high))  # or the law has ended
    tangent = np.divide(rise, 2.0 * width, out=np.zeros_like(depth), where=closed)
    secant = np.divide(middle, depth, out=np.zeros_like(depth), where=closed)
    stiffness = np.where(secant > LARGER * tangent, secant, np.maximum(tangent, 0.0))
    far = _far(laws, energy)
    reach = _solve(forces.work, far)
    reach = np.where((reach == 0.0) & (far > 0.0), 4.0 * thermal, reach)  # of a law that stores no more
    with np.errstate(divide="ignore"):
        spring = np.where((overlap > 0.0) & (compliance < np.inf), 1.0 / compliance, 0.0)
    end = np.where(reach > 0.0, static + reach, 0.0)
    found = _with_profiles(stiffness[None], forces, np.zeros_like(end), end, energy, spring, overlap)
    return np.concatenate([depth[None], found[:1], at_rest[None], found[1:]])


_LOWEST, _HIGHEST = -60.0, 40.0
"""Decimal logarithms between which roots are looked for."""

BISECTIONS = 60
"""Times that this interval is halved."""

EXACT = 40
"""Number of halvings after which midpoints are still exact in double precision."""


def _solve(increasing: Callable[[np.ndarray, np.ndarray], np.ndarray], target: np.ndarray) -> np.ndarray:
    """Solve ``increasing(depth, rows) = target[rows]`` for all rows by bisection of the logarithm, (row,).

    The result is 0 where the target is never reached, or is not positive and finite. A few secants find narrow bounds
    of the roots, as for powers, beyond which bisection need not evaluate anything.
    """

    def reached(logarithm: np.ndarray, rows: np.ndarray) -> np.ndarray:
        values = increasing(_powers(logarithm), rows)
        return np.asarray((values >= target[rows]) | np.isnan(values))  # NaN is an overflow

    rows = np.flatnonzero((target > 0.0) & (target < np.inf))
    rows = rows[reached(np.full(len(rows), _HIGHEST), rows)]
    last, guess = np.full(len(rows), -6.0), np.full(len(rows), -3.0)
    with np.errstate(all="ignore"):
        off = np.log10(increasing(_powers(last), rows) / target[rows])
        for _ in range(8):
            now = np.log10(increasing(_powers(guess), rows) / target[rows])
            shift = np.where(now != off, now * (guess - last) / (now - off), 0.0)
            last, off, guess = guess, now, np.clip(guess - shift, _LOWEST, _HIGHEST)
            if not (np.abs(shift) > 1e-14).any():
                break
    guess = np.where(np.isnan(guess), _HIGHEST, guess)
    below, above = guess - 1e-13, guess + 1e-13
    sure = ~reached(below, rows) & reached(above, rows)
    below, above = np.where(sure, below, -np.inf), np.where(sure, above, np.inf)
    low, high, halvings = _halved(below, above)
    for _ in range(halvings, BISECTIONS):
        middle = 0.5 * (low + high)
        up = middle >= above
        unknown = np.flatnonzero((below < middle) & (middle < above))
        if unknown.size:
            up[unknown] = reached(middle[unknown], rows[unknown])
        low, high = np.where(up, low, middle), np.where(up, middle, high)
    result = np.zeros(len(target))
    result[rows] = _powers(0.5 * (low + high))
    return result


def _halved(below: np.ndarray, above: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the interval to which bounds of the roots alone lead by halving, and the number of halvings."""
    width = (_HIGHEST - _LOWEST) / 2.0**EXACT
    low = _LOWEST + np.floor((np.maximum(below, _LOWEST) - _LOWEST) / width) * width
    high = low + width
    if ((low <= below) & (above <= high)).all():
        return low, high, EXACT
    return np.full(len(below), _LOWEST), np.full(len(below), _HIGHEST), 0  # bounds on both sides of a middle, or none


def _powers(logarithm: np.ndarray) -> np.ndarray:
    """Powers of ten one by one: NumPy's own depend on the processor."""
    return np.array([10.0**item for item in logarithm.tolist()])
