"""An orbit of any network: its unknowns, and what tells of its stability and of events along a branch."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from impactlab.networks.network import Network

MakeNetwork = Callable[..., Network]
"""Returns the network at values of parameters, which are given by name."""


class Base(NamedTuple):
    """The period of which orbits take a whole number."""

    period: float  # (s); about that of the slowest free motion, where nothing varies in time
    wave: int  # a wave of forces, −1 where nothing varies in time
    cycles: int  # of this in the period


class Tests(NamedTuple):
    """Functions of an orbit that vanish at events along a branch; NaN where there is none."""

    fold: float  # the part of the direction of the branch along the parameter
    flip: float  # of the multipliers and −1
    torus: float  # of the products of two multipliers and 1
    closing: float  # least rate at which a contact comes to an event
    touch: float  # largest value of a gap, or of a force, that has no event there
    shortest: float  # time between two events


class Happening(NamedTuple):
    """An event of an orbit."""

    time: float  # (s)
    contact: str
    kind: str
    closing_velocity: float  # (m s-1), NaN where nothing closes


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic orbit, as a method has found it.

    The unknowns are the state at the beginning, times of events, the period, and the values of parameters. The tangent
    is the direction of the branch; events are what happens in a period, in words that are equal for equal orbits.
    """

    unknowns: np.ndarray
    tangent: np.ndarray
    monodromy: np.ndarray
    tests: Tests
    events: Any
    rates: np.ndarray  # at which contacts come to their events
    steps: int  # of Newton's method, those in which it used derivatives of its own
    details: Any  # of the method
    pattern: tuple[tuple[str, str], ...] = ()  # contacts and kinds of events, where these are no unknowns


class Other(NamedTuple):
    """An orbit with other events than those of a branch until there, and the ways in which it may go on."""

    orbit: Orbit
    ways: tuple[float, ...] = (1.0, -1.0)  # along the tangent or against it


class Corrector(Protocol):
    """What finds the orbits of networks that depend on a parameter."""

    refusal: str  # why no orbit was found last, where this is known, else ""

    def correct(self, events: Any, guess: np.ndarray, base: np.ndarray, border: np.ndarray) -> Orbit | None:
        """Return the orbit near a guess for which ``border · (unknowns − base)`` is 0, or None if there is none."""
        ...

    def settled(self, orbit: Orbit) -> Orbit:
        """Return an orbit with its events between the beginning and the end of a period."""
        ...

    def others(self, at: Orbit, test: str, wrong: Orbit) -> Iterable[Other]:
        """Return orbits with other events, where a test vanishes or beyond it, where the old ones are wrong."""
        ...

    def label(self, at: Orbit, test: str) -> str:
        """Return the name of what happens where a test vanishes."""
        ...


class OrbitMethod(Corrector, Protocol):
    """What finds orbits, and follows paths."""

    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    sizes: np.ndarray  # of displacements and velocities
    parameters: int
    drift: np.ndarray  # (body,) the direction in which all may stand anywhere, 0 if there is none
    trivial: int  # multipliers that are 1, since nothing tells the time, or holds bodies where they are

    def at_rest(self, values: np.ndarray) -> np.ndarray:
        """Return the state of a network at rest, (2 body,)."""
        ...

    def room(self, values: np.ndarray) -> float:
        """Return how far apart the sides of contacts are, and how far given motions move them (m)."""
        ...

    def force(self, values: np.ndarray) -> tuple[float, int, int] | None:
        """Return the period of all forces (s), a wave and its cycles in it; None if nothing varies in time."""
        ...

    def slowest(self, values: np.ndarray) -> float:
        """Return the period of the slowest free motion of a body alone (s), 1 if none has one."""
        ...

    def sampled(self, states: np.ndarray, values: np.ndarray, begins: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return states of paths at some times, from times before, (lane, sample, 2 body)."""
        ...

    def near(
        self, state: np.ndarray, values: np.ndarray, period: float, cycles: tuple[int, int],
        least: np.ndarray | float = 0.0,
    ) -> Orbit | str:  # fmt: skip
        """Return the orbit near a state at the time 0, or why there is none; its sizes are not below the least ones."""
        ...

    def happenings(self, orbit: Orbit) -> list[Happening]:
        """Return the events of a period, in order."""
        ...

    def losses(self, orbits: Sequence[Orbit]) -> np.ndarray:
        """Return the energy that each orbit loses in a period (J)."""
        ...

    def closures(self, orbits: Sequence[Orbit]) -> tuple[np.ndarray, np.ndarray]:
        """Return how far paths that begin on orbits are from these after a period, in their sizes, and drifts."""
        ...

    def state_at(self, orbit: Orbit, time: float) -> np.ndarray:
        """Return the state of an orbit at a time of its period."""
        ...

    def state_at_event(self, orbit: Orbit, event: int, after: bool) -> np.ndarray:
        """Return the state of an orbit before an event, or after it."""
        ...


class EquationsOfOrbits(OrbitMethod, Protocol):
    """What tells the equations of orbits at any unknowns."""

    shift: float  # of an unknown from which the derivative of the equation of an event is found, in sizes

    def weights(self, events: Any, period: float) -> np.ndarray:
        """Return the sizes of all unknowns."""
        ...

    def evaluate(self, events: Any, unknowns: np.ndarray) -> tuple[Orbit, np.ndarray, np.ndarray]:
        """Return what is left of the equations of an orbit, and their derivatives, at any unknowns."""
        ...

    def beside(self, events: Any, many: np.ndarray) -> list[tuple[Orbit, np.ndarray, np.ndarray]]:
        """Return the same at several unknowns, (place, unknown), perhaps with derivatives at fixed parameters only."""
        ...

    def passing(self, orbit: Orbit, test: str) -> tuple[Any, np.ndarray]:
        """Return the events of a grazing orbit at which the contact that touches passes, and its unknowns."""
        ...

    def grazing(self, orbit: Orbit) -> tuple[float, Tests]:
        """Return what vanishes where the contact that passes grazes, and tests of other events."""
        ...

    def unwrapped(self, orbit: Orbit, test: str) -> Orbit:
        """Return an orbit that is opened before what takes no time where a test vanishes, not in the midst of it."""
        ...

    def turned(self, orbit: Orbit) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray] | None:
        """Return what `correct` takes for an orbit with its events within a period, None if they are."""
        ...


def torus_of(monodromy: np.ndarray) -> float:
    """Return the product over pairs of multipliers of their product less 1, which is real."""
    if len(monodromy) == 2:
        return float(monodromy[0, 0] * monodromy[1, 1] - monodromy[0, 1] * monodromy[1, 0] - 1.0)
    multipliers = np.linalg.eigvals(monodromy)
    one, other = np.triu_indices(len(multipliers), 1)
    return float(np.prod(multipliers[one] * multipliers[other] - 1.0).real)


def sizes_of(means: np.ndarray, least: np.ndarray | float) -> np.ndarray:
    """Return the sizes of displacements and velocities from their root mean squares, none of them too small."""
    halves = np.maximum(means, least).reshape(2, -1)
    result: np.ndarray = np.maximum(halves, 1e-3 * halves.max(axis=1, keepdims=True)).ravel()
    return np.where(result > 0.0, result, 1.0)


def slowest_of(mass: np.ndarray, stiffness: np.ndarray) -> float:
    """Return the longest natural period of bodies alone (s), 1 if none has one."""
    rates = np.sqrt(stiffness[stiffness > 0.0] / mass[stiffness > 0.0])
    return 2.0 * math.pi / float(rates.min()) if len(rates) else 1.0


def along(method: OrbitMethod, orbit: Orbit, times: np.ndarray) -> np.ndarray:
    """Return the states of an orbit at times of its period, (sample, 2 body)."""
    values, state = orbit.unknowns[-method.parameters :], orbit.unknowns[None, : len(method.sizes)]
    result: np.ndarray = method.sampled(state, values, np.zeros(1), times)[0]
    return result
