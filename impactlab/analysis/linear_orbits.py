"""Orbits of networks that are linear between events, by Newton's method on the times of events."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from impactlab.analysis.itineraries import (
    across,
    alike,
    brief_impact,
    common_period,
    drift_of,
    rotated,
    same,
    table_of,
    touched,
    with_impact,
    without,
    without_drift,
)
from impactlab.analysis.mapped_orbits import MappedOrbits
from impactlab.analysis.orbit import Happening, Orbit, Other, Tests, sizes_of, slowest_of, torus_of
from impactlab.analysis.paths_of_orbits import AT_BEGINNING, FINE, follow, itinerary_of, sampled
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.kernels.contact_states import CLOSED, FRICTION, HELD, OPEN, RIGID, STICKS
from impactlab.kernels.shooting import (
    CLOSING,
    FLIP,
    FOUND,
    IN_SEGMENT,
    LOSS,
    NEWTON_STEPS,
    PASSES,
    SHORTEST,
    TOUCH,
    TOUCHED_AT,
    Itinerary,
    Orbits,
    Plant,
    Polynomials,
    ShootingWork,
    correct_loop,
    evaluate_loop,
    work_for,
)
from impactlab.located.event_located import EventLocated, check, linear_between_events
from impactlab.located.families import NUMBERS, Family, numbers_of
from impactlab.located.rows_of_couplings import rows_of_couplings, sliding_couplings
from impactlab.located.scenes import Linear, linear_of
from impactlab.networks.network import Network

LENGTHS = 1e-2, 1e-3
"""Lengths of impacts by which contacts that touch are continued, as parts of a period."""

APART_BY, CLOSED_BY = 1e-9, 1e-12
"""Part of the largest singular value of the equations of orbits below which these are not apart, and step of Newton's
method, in sizes, that is the last one.
"""

NEAR_ONE = 0.05
"""Distance of a multiplier from 1 that explains why an orbit is not found."""

EVENT_SHIFT = 1e-6
"""Change of an unknown from which the derivative of the equation of an event is found, as a part of its size."""

TOUCHES = 1e-9
"""Part of its size by which a gap may be above 0 where it touches."""

ITINERARIES = 5
"""Itineraries that are tried for an orbit."""


class _Room(NamedTuple):
    """Memory for the orbits of an itinerary."""

    events: Itinerary
    orbit: Orbits
    work: ShootingWork
    result: np.ndarray


@dataclass(eq=False)
class LinearOrbits:
    """Orbits of a family of networks; see `impactlab.analysis.orbit.Method`.

    Parameters
    ----------
    family : Family
    """

    family: Family
    refusal: str = field(default="", init=False)
    shift: float = field(default=EVENT_SHIFT, init=False)
    _rooms: dict[int, _Room] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        family, shape = self.family, self.family.coefficients.shape
        self.plant = plant_of(family.first)
        self._correct, self._evaluate = correct_loop(), evaluate_loop()
        self.polynomials = Polynomials(
            family.boxes,
            family.places,
            np.ascontiguousarray(family.coefficients.reshape(*shape[:2], int(np.prod(shape[2:])))),
            np.array(shape[2:], dtype=np.int64),
        )
        self.span = np.array([high - low for low, high in family.ranges.values()])
        model = family.model
        self.bodies = tuple(np.array(model.bodies.names)[model.bodies.free].tolist())
        self.contacts = *model.contacts.names, *rows_of_couplings(model).names
        self.sizes, self.parameters = np.ones(2 * len(self.bodies)), len(self.span)
        free = self.force(np.array([0.5 * sum(ends) for ends in family.ranges.values()])) is None
        self.drift = drift_of(family.first)
        self.trivial = int(free) + int(self.drift.any())

    @staticmethod
    def knows(model: Model) -> bool:
        """Whether a network that is linear between events has no sliders, nor forces other than waves."""
        return not sliding_couplings(model) and not linear_of(model).loads.size

    def scene(self, values: np.ndarray) -> Linear:
        """Return the networks at some values of the parameters, (lane, parameter)."""
        return self.family.scenes(values)

    def at_rest(self, values: np.ndarray) -> np.ndarray:
        """Return the state of a network at rest, (2 body,)."""
        place = self.scene(values[None]).at_rest()[0]
        return np.concatenate([place, np.zeros_like(place)])

    def room(self, values: np.ndarray) -> float:
        """Return how far apart the sides of contacts are, and how far given motions move them (m)."""
        scene = self.scene(values[None])
        return float((np.abs(scene.gap) + np.abs(scene.wall).sum(axis=-1)).max(initial=0.0))

    def force(self, values: np.ndarray) -> tuple[float, int, int] | None:
        """Return the period of all forces (s), a wave and its cycles in it; None if nothing varies in time."""
        return common_period(self.scene(values[None]).frequencies[0])

    def slowest(self, values: np.ndarray) -> float:
        """Return the period of the slowest free motion of a body alone (s), 1 if none has one."""
        scene = self.scene(values[None])
        return slowest_of(scene.mass[0], np.diag(scene.stiffness[0]))

    def sampled(self, states: np.ndarray, values: np.ndarray, begins: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return states of paths at some times, from times before, (lane, sample, 2 body)."""
        return sampled(self.scene(np.repeat(values[None], len(states), axis=0)), states, begins, times)

    def near(
        self, state: np.ndarray, values: np.ndarray, period: float, cycles: tuple[int, int],
        least: np.ndarray | float = 0.0,
    ) -> Orbit | str:  # fmt: skip
        """Return the orbit near a state at the time 0, or why there is none; its sizes are not below the least ones.

        The path over a period tells the events; they are those of the path of the orbit in the end.
        """
        scene, before = self.scene(values[None]), None
        for _ in range(ITINERARIES):
            paths = follow(scene, state[None], np.array([period]), names=self.contacts)
            if paths.lost:
                return paths.lost[0]
            if before is None and (self.sizes == 1.0).all():
                self.sizes = sizes_of(paths.sizes[0], least)
            itinerary, times = itinerary_of(scene, paths, 0, period, cycles)
            if before is not None and same(before.events, itinerary):
                return before
            guess = np.concatenate([state, times, [period], values])
            border = np.zeros(len(guess))
            border[-1] = 1.0
            found = self.correct(itinerary, guess, guess, border) or self._one_of_many(itinerary, guess)
            if found is None:
                return "Newton's method does not converge" + self._why(itinerary, guess)
            before, state = found, found.unknowns[: len(state)]
        return "each path has other events than the one before"

    def correct(self, events: Itinerary, guess: np.ndarray, base: np.ndarray, border: np.ndarray) -> Orbit | None:
        """Return the orbit near a guess for which ``border · (unknowns − base)`` is 0, or None if there is none."""
        room = self._room(events, guess)
        orbit = room.orbit
        orbit.unknowns[:], orbit.base[:], orbit.border[:] = guess, base, border
        self._correct(self.polynomials, self.plant, events, orbit, room.work, room.result)
        return self._taken(room) if room.result[0] else None

    def _why(self, events: Itinerary, guess: np.ndarray) -> str:
        """Say whether a multiplier near 1 keeps Newton's method from orbits, "" where none does."""
        monodromy = self.evaluate(events, guess)[0].monodromy
        if self.trivial or not np.isfinite(monodromy).all():
            return ""
        multipliers = np.linalg.eigvals(monodromy)
        nearest = multipliers[np.abs(multipliers - 1.0).argmin()].real
        if abs(nearest - 1.0) > NEAR_ONE:
            return ""
        return f", since a multiplier is {nearest:.4g} there: with 1, orbits meet, or are not apart from each other"

    def _one_of_many(self, events: Itinerary, guess: np.ndarray) -> Orbit | None:
        """Return the nearest orbit where these are not apart from each other, or None if there is none."""
        unknowns, count = guess.copy(), len(guess) - len(self.span)
        weights = self.weights(events, unknowns[count - 1])[:count]
        for _ in range(NEWTON_STEPS):
            _, residual, slopes = self.evaluate(events, unknowns)
            if not (np.isfinite(residual).all() and np.isfinite(slopes).all()):
                return None
            step = np.linalg.lstsq(slopes[:, :count] * weights, residual, rcond=APART_BY)[0]
            unknowns[:count] -= weights * step
            if np.abs(step).max() < CLOSED_BY:
                return self.evaluate(events, unknowns)[0]
        return None

    def evaluate(self, events: Itinerary, unknowns: np.ndarray) -> tuple[Orbit, np.ndarray, np.ndarray]:
        """Return what is left of the equations of an orbit, and their derivatives, at any unknowns."""
        room = self._room(events, unknowns)
        room.orbit.unknowns[:] = room.orbit.base[:] = unknowns
        self._evaluate(self.polynomials, self.plant, events, room.orbit, room.work, room.result)
        count = len(unknowns) - len(self.span)
        return self._taken(room), room.orbit.residual[:count].copy(), room.orbit.jacobian[:count].copy()

    def beside(self, events: Itinerary, many: np.ndarray) -> list[tuple[Orbit, np.ndarray, np.ndarray]]:
        """Return the same at several unknowns, (place, unknown)."""
        return [self.evaluate(events, unknowns) for unknowns in many]

    def passing(self, orbit: Orbit, test: str) -> tuple[Itinerary, np.ndarray]:
        """Return the itinerary of a grazing orbit in which the contact that touches passes, and its unknowns."""
        size, events, unknowns = len(self.sizes), orbit.events, orbit.unknowns
        assert isinstance(events, Itinerary)
        group = brief_impact(orbit, test, size)
        if group is not None:
            segment, functional = group[0], int(events.functionals[group[0]])
            when = float(unknowns[size + group[0]])
            events = without(events, *group)
            unknowns = np.delete(unknowns, size + np.arange(group[0], group[1] + 1))
        elif test == "touch":
            (segment, functional), when = touched(orbit), float(orbit.details[TOUCHED_AT])
        if (test != "touch" and group is None) or events.kinds[functional // 2] >= FRICTION:
            raise InvalidInput("This grazing, of a rest or of dry friction, cannot be followed over two parameters.")
        events, _ = with_impact(events, segment, functional, passing=True)
        return events, np.insert(unknowns, size + segment, when)

    def grazing(self, orbit: Orbit) -> tuple[float, Tests]:
        """Return the rate at which the contact that passes comes to its event, and tests of other events."""
        passing = int(np.argmax(orbit.events.strikes == PASSES))
        tests = orbit.tests._replace(closing=float(np.delete(orbit.rates, passing).min(initial=np.inf)))
        if abs(orbit.details[TOUCH]) < TOUCHES and orbit.details[IN_SEGMENT] in (passing, passing + 1):
            tests = tests._replace(touch=-np.inf)
        return float(orbit.rates[passing]), tests

    def segments(self, orbit: Orbit) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the matrices of the motion in each segment, and the states at both ends, (segment, 2, coordinate)."""
        self.evaluate(orbit.events, orbit.unknowns)
        work = self._rooms[id(orbit.events)].work
        return list(work.generators.copy()), work.states.copy()

    def settled(self, orbit: Orbit) -> Orbit:
        """Return an orbit with its events between the beginning and the end of a period."""
        turned = self.turned(orbit)
        return orbit if turned is None else self.correct(*turned) or orbit

    def turned(self, orbit: Orbit) -> tuple[Itinerary, np.ndarray, np.ndarray, np.ndarray] | None:
        """Return what `correct` takes for an orbit with its events within a period, None if they are."""
        events, size = orbit.events, len(self.sizes)
        assert isinstance(events, Itinerary)
        count = len(events.functionals)
        times, period = orbit.unknowns[size : size + count], orbit.unknowns[size + count]
        early, late = int((times < 0.0).sum()), int((times > period).sum())
        if not early + late:
            return None
        first, begin = (early, 0.0) if early else (count - late, period)
        while first < count and events.together[first]:
            first += 1
        return self._opened(orbit, first, begin)

    def unwrapped(self, orbit: Orbit, test: str) -> Orbit:
        """Return an orbit that is opened before what takes no time where a test vanishes, not in the midst of it."""
        first, place = across(orbit, test, len(self.sizes)), -1 - len(self.span)
        return orbit if first is None else self.correct(*self._opened(orbit, first, orbit.unknowns[place])) or orbit

    def _opened(self, orbit: Orbit, first: int, begin: float) -> tuple[Itinerary, np.ndarray, np.ndarray, np.ndarray]:
        """Return what `correct` takes for an orbit that is opened before one of its events, at the time 0 or a period.

        At 0, the events before that one come a period later, else those from it on a period earlier.
        """
        events, size = orbit.events, len(self.sizes)
        count = len(events.functionals)
        times, period = orbit.unknowns[size : size + count], orbit.unknowns[size + count]
        self.evaluate(events, orbit.unknowns)
        work = self._rooms[id(events)].work
        since = begin - (times[first - 1] if first else 0.0)
        place = expm(work.generators[first] * since) @ work.states[first, 0]
        moved = np.stack([times, orbit.tangent[size : size + count]])
        last = np.array([[period], [orbit.tangent[size + count]]])
        if begin == 0.0:
            moved[:, :first] += last
        else:
            moved[:, first:] -= last
            gone = work.states[count, 1, :size] - orbit.unknowns[:size]
            place = place[:size] - (gone - without_drift(gone, self.drift))  # the same place a period earlier
        moved = np.roll(moved, -first, axis=1)
        guess = np.concatenate([place[:size], moved[0], orbit.unknowns[size + count :]])
        border = np.concatenate([np.zeros(size), moved[1], orbit.tangent[size + count :]])
        return rotated(events, first), guess, guess, border / self.weights(events, period) ** 2

    def others(self, at: Orbit, test: str, wrong: Orbit) -> Iterator[Other]:
        """Yield orbits with other events, where a test vanishes or beyond it, where the old ones are wrong."""
        at, size = self.unwrapped(at, test), len(self.sizes)
        events = at.events
        assert isinstance(events, Itinerary)
        if test == "touch" and at.details[IN_SEGMENT] >= 0:
            yield from self._with_impact(at, events)
        group = brief_impact(at, test, size)
        if group is not None:
            fewer, places = without(events, *group), size + np.arange(group[0], group[1] + 1)
            guess, border = (np.delete(item, places) for item in (at.unknowns, at.tangent))
            found = self.correct(fewer, guess, guess, border / self.weights(fewer, 1.0) ** 2)
            if found is not None:
                yield Other(found)
        state, values = wrong.unknowns[:size], wrong.unknowns[-len(self.span) :]
        period = float(wrong.unknowns[-1 - len(self.span)])
        beyond = self.near(state, values, period, tuple(events.period.tolist()))
        if not isinstance(beyond, str) and not alike(beyond.events, events):
            yield Other(beyond)

    def label(self, at: Orbit, test: str) -> str:
        """Return the name of an event on a branch."""
        if test != "shortest":
            return {"closing": "grazing", "touch": "grazing"}.get(test, test)
        return "meeting" if brief_impact(self.unwrapped(at, test), test, len(self.sizes)) is None else "grazing"

    def weights(self, events: Itinerary, period: float) -> np.ndarray:
        """Return the sizes of all unknowns."""
        times = np.full(len(events.functionals) + 1, period)
        return np.concatenate([self.sizes, times, self.span])

    def happenings(self, orbit: Orbit) -> list[Happening]:
        """Return the events of a period, in order."""
        events, size = orbit.events, len(self.sizes)
        assert isinstance(events, Itinerary)
        return table_of(events, orbit.unknowns[size : size + len(events.functionals)], orbit.rates, self.contacts)

    def state_at(self, orbit: Orbit, time: float) -> np.ndarray:
        """Return the state of an orbit at a time of its period."""
        size, values = len(self.sizes), orbit.unknowns[None, -len(self.span) :]
        if time <= 0.0:
            return orbit.unknowns[:size]
        result: np.ndarray = follow(self.scene(values), orbit.unknowns[None, :size], np.array([time])).ends[0]
        return result

    def state_at_event(self, orbit: Orbit, event: int, after: bool) -> np.ndarray:
        """Return the state of an orbit before an event, or after it."""
        self.evaluate(orbit.events, orbit.unknowns)
        states, size = self._rooms[id(orbit.events)].work.states, len(self.sizes)
        return states[event + 1, 0, :size].copy() if after else states[event, 1, :size].copy()

    def losses(self, orbits: Sequence[Orbit]) -> np.ndarray:
        """Return the energy that each orbit loses in a period (J)."""
        return np.array([float(orbit.details[LOSS]) for orbit in orbits])

    def closures(self, orbits: Sequence[Orbit]) -> tuple[np.ndarray, np.ndarray]:
        """Return how far paths that begin on orbits are from these after a period, in their sizes, and drifts.

        Paths are followed by bounds of all gaps, so that they miss no contact. They are infinitely far where they
        cannot be followed, and NaN where an event is at the beginning to rounding, so that it is before or after it.
        """
        size, parameters = len(self.sizes), len(self.span)
        values = np.array([orbit.unknowns[-parameters:] for orbit in orbits])
        periods = np.array([orbit.unknowns[-parameters - 1] for orbit in orbits])
        states = np.array([orbit.unknowns[:size] for orbit in orbits])
        paths = follow(self.scene(values), states, periods, FINE)
        apart = paths.ends - states
        drifts = apart[:, : size // 2] * (self.drift != 0.0)
        apart = np.abs(without_drift(apart, self.drift))
        result: np.ndarray = (apart / self.sizes).max(axis=1)
        result[list(paths.lost)] = np.inf
        for place, orbit in enumerate(orbits):
            times = orbit.unknowns[size : -parameters - 1]
            if (np.minimum(np.abs(times), np.abs(times - periods[place])) < AT_BEGINNING * periods[place]).any():
                result[place] = np.nan
        return result, drifts

    def _with_impact(self, at: Orbit, events: Itinerary) -> Iterator[Other]:
        """Yield an orbit with an impact that takes little time where a contact that is open touches.

        Or with an opening where one that is closed does, with a slip in a stick, or the reverse.
        """
        size, (segment, functional), when = len(self.sizes), touched(at), float(at.details[TOUCHED_AT])
        kind = events.kinds[functional // 2]
        if kind < FRICTION and events.statuses[segment, functional // 2] not in (OPEN, CLOSED):
            return
        more, count = with_impact(events, segment, functional)
        for part in (0.0,) if kind == RIGID else LENGTHS:
            length = part * at.unknowns[size + len(events.functionals)]
            guess = np.insert(at.unknowns, size + segment, when + length * np.linspace(-0.5, 0.5, count))
            border = np.zeros(len(guess))
            border[size + segment] = -1.0
            if count > 1:
                border[size + segment + count - 1] = 1.0
            found = self.correct(more, guess, guess, border)
            if found is not None:
                yield Other(found, (1.0,)) if count > 1 else Other(found)  # it takes more and more time

    def _room(self, events: Itinerary, unknowns: np.ndarray) -> _Room:
        known = self._rooms.get(id(events))
        if known is None:
            bodies, contacts, waves = self.family.first.shape
            count, size = len(events.functionals), len(unknowns)
            weights = self.weights(events, unknowns[2 * bodies + count])
            orbit = Orbits(
                np.zeros(size), weights, np.zeros(size), np.zeros(size), np.zeros(size), np.zeros((size, size)),
                np.zeros((2 * bodies, 2 * bodies)), np.zeros(FOUND), np.zeros(count), np.zeros(size),
            )  # fmt: skip
            work = work_for(bodies, waves, contacts, count, len(self.span))
            known = self._rooms[id(events)] = _Room(events, orbit, work, np.zeros(1, np.int64))
        return known

    def _taken(self, room: _Room) -> Orbit:
        orbit, found = room.orbit, room.orbit.found.copy()
        tangent, monodromy = orbit.tangent.copy(), orbit.monodromy.copy()
        monodromy = monodromy @ possible_at(self.plant, room.events.statuses[0])
        tests = Tests(tangent[-1], found[FLIP], torus_of(monodromy), found[CLOSING], found[TOUCH], found[SHORTEST])
        return Orbit(
            orbit.unknowns.copy(), tangent, monodromy, tests, room.events, orbit.rates.copy(), int(room.result[0]),
            found,
        )  # fmt: skip


def plant_of(scene: Linear) -> Plant:
    """Return the numbers of a network for compiled code."""
    numbers, begin, parts = numbers_of(scene), 0, dict[str, np.ndarray]()
    for name in NUMBERS:
        array = getattr(scene, name)[0]
        real = array.view(float).reshape(*array.shape, 2) if array.dtype == complex else array
        parts[name] = numbers[begin : begin + real.size].reshape(real.shape)
        if name == "springs":
            parts["laws"] = numbers[begin : begin + 3 * real.size].reshape(3, real.size)
        begin += real.size
    return Plant(
        numbers, parts["mass"], parts["damping"], parts["stiffness"], parts["frequencies"], parts["load"],
        parts["force"], parts["links"], parts["gap"], parts["wall"], parts["laws"], parts["frictions"],
    )  # fmt: skip


def possible_at(plant: Plant, statuses: np.ndarray) -> np.ndarray:
    """Return the projection of deviations onto those that are possible while some contacts rest, and frictions stick.

    Others die out at once: a body that is moved off its stop comes back to it, and one that is pushed sticks again.
    """
    bodies = len(plant.mass)
    result, zero = np.eye(2 * bodies), np.zeros((bodies, bodies))
    for held, quantities in ((statuses == HELD, (1.0, 1.0)), ((statuses == HELD) | (statuses == STICKS), (0.0, 1.0))):
        links = plant.links[held]
        if len(links):
            along = (links / plant.mass).T
            lost = along @ np.linalg.pinv(links @ along) @ links
            result = (np.eye(2 * bodies) - np.block([[quantities[0] * lost, zero], [zero, lost]])) @ result
    return result


def method_of(network: Network) -> LinearOrbits | MappedOrbits:
    """Return what finds the orbits of a network, or refuse it."""
    if not isinstance(network, Network):
        raise InvalidInput(f"orbits takes an il.Network, not {network!r}.")
    model = Model.of(network)
    if model.random.any():
        name = model.bodies.names[int(np.argmax(model.random))]
        raise InvalidInput(
            f"Random forces act on {name!r}: orbits are those of a network in which nothing is random. Leave them out, "
            "and give the network with them to il.orbit_spread."
        )
    check(model, EventLocated())
    if linear_between_events(model) and LinearOrbits.knows(model):
        return LinearOrbits(Family.alone(model))
    return MappedOrbits.of(network)
