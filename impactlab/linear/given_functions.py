"""Given functions of time, forces and intensities: what they are like, looked at on irregular times.

Laws that depend on time are such functions as well, at places where they are looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sized
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.component import Component
from impactlab.components.evaluation import TIME
from impactlab.components.excitation import Excitation, Source
from impactlab.components.sides import directions_of, weights_of
from impactlab.errors import InvalidInput
from impactlab.kernels.functions_of_time import follow, look_closely
from impactlab.linear.transitions import response_to_force, transition
from impactlab.quadrature import legendre_coefficients, mean_rule

LOOKS = 16384
"""Times at which a function is looked at: what lasts this part of a run is hardly missed, in about 20 ms."""

SPOTS, FEWEST = 256, 16
"""Of these, times about which it is asked how a step would see the function; the fewest where there are many."""

CLOSER = 32
"""Times between two of these at which a function is evaluated where it is large."""

UNSEEN, MOST = 0.03, 0.95
"""Largest part of a function that a step may leave out, at this share of the times: a cosine of 0.5 to 0.7 rad in a
step, fifty steps in the period of a square wave. What is left out has no mean and no slope over the step, so that
motions hardly feel it; but they themselves vary as fast, and are read once in a step only. In a square wave, the error
of the integral over the steps with a jump counts: at half as many steps a resonance with it is 4 % off."""

_PLACES_OF_LAWS = 0.0, 1.0
"""Where laws that depend on time are looked at: at rest, and where most of them act (m)."""

_DIFFERENCES = np.array([4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0])
"""Weights of the differences of values so many spacings after and before a time in the derivative there."""

_FORWARD = np.array([-761 / 280, 8, -14, 56 / 3, -35 / 2, 56 / 5, -14 / 3, 8 / 7, -1 / 8])
"""Weights of values so many spacings after a time in the derivative there."""

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)

NODES, _ = mean_rule(8)
"""Where in a step a function is evaluated, as parts of the step: Gauss's rule with eight points."""

PLACES = np.concatenate([[0.0], NODES, [1.0]])
"""These, and the ends of the step, where alone a jump close to an end shows."""

_AT_ENDS, _COEFFICIENTS = np.polynomial.legendre.legvander([-1.0, 1.0], 7), legendre_coefficients(8)
_MEAN, _SLOPE = np.ascontiguousarray(_COEFFICIENTS[:, :2].T)

_UNRESOLVED = np.zeros((4, 10))  # the last two coefficients, and distances from the sum at both ends
_UNRESOLVED[:2, 1:-1] = _COEFFICIENTS[:, 6:].T
_UNRESOLVED[2:, 1:-1] = -(_COEFFICIENTS @ _AT_ENDS.T).T
_UNRESOLVED[[2, 3], [0, -1]] = 1.0

ROUGH = 1e-3
"""Coefficients of the last two of eight Legendre polynomials, or distances from their sum at the ends, relative to
the function, from which on it is integrated in parts of the step. For a cosine over half a radian they are below 1e-7,
for a jump a tenth of the jump."""

PANELS = 16
"""Parts of such a step. Gauss's rule for a step is off by up to 9 % of a jump, at random: the impulse of a
pulse that begins with a jump would differ from one to the next, and drive resonances."""


def mean_and_slope(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear function of the time of a step nearest to values at `NODES`, on the last axis.

    They are its mean, which is that of the function, and what it grows by in half a step.
    """
    return values @ _MEAN, values @ _SLOPE


def looked_at(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return whether Gauss's rule does not resolve functions, such as one that jumps, and their least values.

    Values are those at `PLACES`, on the last axis.
    """
    shape, rows = values.shape[:-1], np.ascontiguousarray(values).reshape(-1, values.shape[-1])
    rough, least = np.empty(len(rows), dtype=bool), np.empty(len(rows))
    look_closely(rows, _UNRESOLVED, ROUGH, rough, least)
    return rough.reshape(shape), least.reshape(shape)


def joined(mean: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and slope over a step from those of its `PANELS` equal parts, on the last axis."""
    middle = (2.0 * np.arange(PANELS) + 1.0) / PANELS - 1.0
    return mean.mean(axis=-1), (3.0 * mean * middle + slope / PANELS).mean(axis=-1)


@dataclass(frozen=True)
class LawInTime:
    """Force of a law at some place and at rest: a function of time as a given force is."""

    law: Component
    place: float  # (m)

    def call(self, kind: str, times: np.ndarray) -> np.ndarray:
        """Return the force at some times, 0 where the law is not made for the place (N)."""
        try:
            return self.law.call(kind, self.place, 0.0, times)
        except (InvalidInput, OverflowError):
            return np.zeros_like(times)


@kept
def laws_in_time(model: Model) -> dict[str, list[tuple[Component, str, float]]]:
    """Return the laws that depend on time by body: with the names of their kernels, and what pushes it at a unit force.

    Each is there once for each of its bodies.
    """
    network = model.network
    result: dict[str, list[tuple[Component, str, float]]] = {name: [] for name in model.bodies.names}
    for links, sign in ((network.contacts, -1.0), (network.couplings, 1.0)):
        for link in links.values() if model.kicks.timed.any() else ():
            if TIME in link.law.kernel("force")[1]:
                for direction in directions_of(link):
                    for name, weight in weights_of(direction).items():
                        result[name].append((link.law, "force", sign * weight))
    for slot in np.flatnonzero(model.bodies.residual).tolist():
        name, body = model.bodies.names[slot], model.bodies.oscillators[slot]
        if TIME in body.kernel("residual")[1]:
            result[name].append((body, "residual", -1.0))
    return result


def _given_motions(model: Model) -> list[Excitation]:
    """Return the displacements of bodies whose motion is given."""
    return [item for mechanism in model.mechanisms for _, item in mechanism.given_motions(model)]


@kept
def kinds_of(model: Model) -> dict[Excitation | LawInTime, str]:
    """Return excitations, and laws at some places, that are functions of time, and the names of their kernels."""
    result: dict[Excitation | LawInTime, str] = {}
    given = (*model.network.excitations.values(), *_given_motions(model))
    for item in dict(zip(map(id, given), given, strict=True)).values():
        excitation = item.excitation if isinstance(item, Source) else item
        kind = excitation.kind
        if kind == "force" or (kind == "intensity" and excitation.kernel(kind)[1]):
            result[excitation] = kind
        if excitation.has_kernel("modulation"):
            result[excitation] = "modulation"
    laws = [item for of_body in laws_in_time(model).values() for item in of_body] if model.kicks.timed.any() else []
    result |= {LawInTime(law, place): kernel for law, kernel, _ in laws for place in _PLACES_OF_LAWS}
    return result


def irregular_times(begin: float, end: float, count: int) -> np.ndarray:
    """Return one time in each of some equal parts of an interval, elsewhere in each: no period is sampled in phase."""
    index = np.arange(count)
    return np.asarray(begin + (end - begin) / count * (index + (_GOLDEN * (index + 1)) % 1.0))


@lru_cache(maxsize=64)
def look_at(
    excitation: Excitation | LawInTime, kind: str, begin: float, end: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return irregular times and the values of an excitation there."""
    times = irregular_times(begin, end, count)
    return times, np.asarray(excitation.call(kind, times), dtype=float)


def span_of(item: Excitation | LawInTime, begin: float, end: float) -> tuple[float, float]:
    """Return the part of an interval in which a function acts, with half as much on either side.

    A short function is found however long the interval. A function that never acts in it gives the whole interval.
    """
    first, last = item.acts_between if isinstance(item, Excitation) else (-np.inf, np.inf)
    around = 0.5 * (last - first)
    span = max(begin, first - around), min(end, last + around)
    return span if span[0] < span[1] else (begin, end)


def look(model: Model, excitation: Excitation | LawInTime, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return irregular times, fewer where a network has many functions, and the values of an excitation there."""
    of_time = kinds_of(model)
    return look_at(excitation, of_time[excitation], begin, end, _looks(of_time))


def looks(model: Model) -> int:
    """Return at how many times each function of time of a network is looked at."""
    return _looks(kinds_of(model))


def _looks(of_time: Sized) -> int:
    """Return at how many times each of some functions is looked at."""
    return max(LOOKS // len(of_time), 4 * SPOTS)


def resolving_step(model: Model, begin: float, end: float, longest: float) -> float:
    """Return the largest step, up to the longest, that sees the model's functions of time between two times.

    Around times that are drawn in proportion to the square of a function, it is compared with the linear function of
    time by which a step would know it; the relative difference must be below `UNSEEN` at the share `MOST` of them. So
    what matters is where the function is large, however short that is, and how fast it varies there, not any period; of
    laws and displacements it is what differs from their mean. A function that varies at any step is refused.

    What the next power of 2, a longer step, sees counts as seen: it is tried first, as networks of other steps try the
    same one.
    """
    step, of_time, moved = longest, kinds_of(model), {*_given_motions(model)}
    spots = max(min(SPOTS, 8 * SPOTS // max(len(of_time), 1)), FEWEST)
    for excitation, kind in of_time.items():
        earliest, latest = span_of(excitation, begin, end)
        centred = isinstance(excitation, LawInTime) or excitation in moved
        function = excitation, kind, earliest, latest, _looks(of_time), spots, centred
        if _spots_of(*function) is None:
            continue
        step = min(step, latest - earliest)
        longer = 2.0 ** math.ceil(math.log2(step))
        if longer <= latest - earliest and _sees(longer, *function):
            continue
        while not _sees(step, *function):
            # the next step that is tried
            step *= 0.7
            # no step below this part of a run is looked for
            if step < 1e-9 * (end - begin):
                raise InvalidInput(f"No step can be chosen, since no step resolves {excitation!r}. Give step= (s).")
    return step


@lru_cache(maxsize=64)
def _spots_of(
    excitation: Excitation | LawInTime, kind: str, begin: float, end: float, looks: int, spots: int, centred: bool
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Return times where a function is large, its values there, and its mean, from which they differ if `centred`.

    None where it does not vary.
    """
    times, values = look_at(excitation, kind, begin, end, looks)
    mean = float(values.mean()) if centred else 0.0
    # a law that varies by less over time varies by rounding
    varying = np.abs(values - mean) > (1e-6 * np.abs(values).max() if mean else 0.0)
    if not (np.isfinite(values).all() and varying.any()):
        return None
    values = values - mean
    chosen = _drawn(values, spots)
    return times[chosen], values[chosen], mean


@lru_cache(maxsize=64)
def _sees(step: float, excitation: Excitation | LawInTime, kind: str, begin: float, end: float, *how: int) -> bool:
    """Whether a step resolves a function; other arguments as for `_spots_of`."""
    at, value, mean_of_all = _spots_of(excitation, kind, begin, end, *how)  # type: ignore[misc]
    place = (np.sqrt(2.0) * np.arange(1, len(at) + 1)) % 1.0  # of the time within the step
    first = np.clip(at - place * step, begin, end - step)
    mean, slope = mean_and_slope(excitation.call(kind, first[:, None] + step * NODES) - mean_of_all)
    unseen = np.abs(1.0 - (mean + slope * (2.0 * (at - first) / step - 1.0)) / value)
    return bool(np.quantile(unseen, MOST) <= UNSEEN)


def jumping_laws(model: Model, begin: float, end: float, step: float) -> list[str]:
    """Return the kinds of laws whose force jumps in time: most of a change remains within a small part of a step."""
    found = []
    for item, kind in kinds_of(model).items():
        if not isinstance(item, LawInTime):
            continue
        times, values = look(model, item, begin, end)
        change = np.abs(np.diff(values))
        place = int(change.argmax())
        (low, high), (first, last) = times[place : place + 2], values[place : place + 2]
        while high - low > step / PANELS**2:
            middle = 0.5 * (low + high)
            value = float(item.call(kind, np.array([middle]))[0])
            low, high, first, last = (
                (low, middle, first, value) if abs(value - first) > abs(last - value) else (middle, high, value, last)
            )
        if abs(last - first) > max(0.5 * change[place], UNSEEN * np.abs(values).max()):
            found.append(type(item.law).__name__)
    return sorted(set(found))


def motion_at(
    function: Callable[[np.ndarray], np.ndarray], displacement: Excitation, times: np.ndarray, step: float,
    begins: bool = False,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return displacement and velocity of a given motion at some times, by a function of any times.

    It rests before and after the time in which it acts. The derivative is that of the polynomial of eighth order
    through displacements up to half a step (s) before and after. Where it `begins`, that at the first time is through
    those of the step after: a motion may begin with a jump of its velocity.
    """
    spacing, middle = step / (2 * len(_DIFFERENCES)), len(_DIFFERENCES)
    places = spacing * np.arange(-middle, middle + 1)
    x = function(np.clip(times[:, None] + places, *displacement.acts_between))
    v = (x[:, middle + 1 :] - x[:, middle - 1 :: -1]) @ _DIFFERENCES / spacing
    if begins:
        first = times[0] + spacing * np.arange(len(_FORWARD))
        v[0] = function(np.clip(first, *displacement.acts_between)) @ _FORWARD / spacing
    return x[:, middle], v


@kept
def largest_energy(model: Model, slot: int, begin: float, end: float) -> float:
    """Return the largest energy that given forces, and laws at rest, bring to a body alone (J).

    Those that act in different parts of the time may bring theirs together: their velocities add up.
    """
    excitations: list[tuple[Excitation | LawInTime, float]] = [*model.sources["force"].on(slot)]
    excitations += [(LawInTime(law, 0.0), weight) for law, _, weight in laws_in_time(model)[model.bodies.names[slot]]]
    parts: dict[tuple[float, float], list[tuple[Excitation | LawInTime, float]]] = {}
    for item, weight in excitations:
        parts.setdefault(span_of(item, begin, end), []).append((item, weight))
    energies = [_largest_energy(model, slot, *span, items) for span, items in parts.items()]
    return energies[0] if len(energies) == 1 else float(np.sqrt(energies).sum() ** 2)


def _largest_energy(
    model: Model, slot: int, begin: float, end: float, excitations: list[tuple[Excitation | LawInTime, float]]
) -> float:
    """Return the largest energy that some functions of time bring to a body that starts at rest (J).

    Where the force varies faster than it is looked at, it acts like noise of its size, which brings more; where it is
    large it is looked at more closely, since it may be short.
    """
    of_time = kinds_of(model)
    items = tuple((item, of_time[item], weight) for item, weight in excitations)
    force = _forces_between(items, begin, end, _looks(of_time))
    m, c, k = model.mass[[slot]], model.damping[[slot]], model.stiffness[[slot]]
    interval = (end - begin) / len(force)
    flow = transition(m, c, k, np.zeros(1), interval)[0][0]
    response, energy = response_to_force(m, c, k, interval)[0, :2], np.zeros(1)
    follow(force, np.ascontiguousarray(flow), np.ascontiguousarray(response), np.array([m[0], k[0]]), energy)
    return float(energy[0])


@lru_cache(maxsize=64)
def _forces_between(
    excitations: tuple[tuple[Excitation | LawInTime, str, float], ...], begin: float, end: float, count: int
) -> np.ndarray:
    """Return the sum of weighted functions of time in equal parts of an interval, looked at closely where it is large.

    With each of them goes the name of its kernel.
    """
    looks = [look_at(item, kind, begin, end, count)[1] for item, kind, _ in excitations]
    weights = [weight for *_, weight in excitations]
    force = np.sum([weight * values for weight, values in zip(weights, looks, strict=True)], axis=0)
    if force.any():
        places = np.unique(_drawn(force, SPOTS))
        inside = begin + (end - begin) / count * (places[:, None] + (np.arange(CLOSER) + 0.5) / CLOSER)
        force[places] = sum(weight * item.call(kind, inside).mean(axis=1) for item, kind, weight in excitations)
    return np.asarray(force)


def _drawn(values: np.ndarray, count: int) -> np.ndarray:
    """Return places of values, drawn in proportion to their squares."""
    share = np.cumsum((values / np.abs(values).max()) ** 2)
    return np.minimum(np.searchsorted(share, irregular_times(0.0, share[-1], count)), len(values) - 1)
