"""A force along its coordinate at all energies that occur: its stiffness, and the part that steps do not resolve."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

REACH = 20.0
"""Energy in temperatures T up to which a force is looked at: what is beyond has a weight of e^(-20)."""

STABLE_REACH = 10.0
"""Energy in temperatures up to which steps must be stable."""

LEAST_WEIGHT = 1.0 / 12.0
"""Weight of a stiffness met at such energies: a step of a half over its frequency is stable up to 1.7 over it."""

STORED = 0.1
"""Part of a temperature that a stiffness must be able to store to count in full: the contact ratio of a pad that yields
at a tenth of T was 1.2 % off at half a step over its later stiffness, with a full T as measure."""

RISE = 0.125
"""Largest change of the potential over a cell in temperatures, so that a stop behind a wide gap is resolved."""

PARTS = 4
"""Parts into which a cell that is too coarse is divided."""

ROUNDS = 20
"""Most rounds of dividing cells."""

RESOLUTION = 64
"""Points of a profile over the length in which its largest stiffness stores a temperature; and cells at first."""

POINTS = 256, 1 << 15
"""Least and largest number of these points."""

APART = np.round(8.0 * 2.0 ** (np.arange(25) / 3.0)).astype(int)
"""Points in the distances at which a profile is sampled: three in an octave, since what two kinks do interferes."""

COLUMNS = 4 + len(APART)
"""Numbers of a row of `Profiles`."""

_HEAT_NODES, _HEAT_WEIGHTS = np.polynomial.laguerre.laggauss(10)


class Profiles(NamedTuple):
    """Stiffness and unresolved work of forces along their coordinates, row by row; NaN where they are not known.

    A step h takes a point that passes at the speed u through the force F(x) at places u h
    apart. The sum of the work ``u h F`` over these places depends on where the first one lies: its variance V(u h)
    over that place is the mean square by which a pass changes the energy at random. With weights
    ``e^(-U/2T)`` of the potential it is that of a pass at temperature T.
    """

    stiffness: np.ndarray  # largest stiffness over all energies, weighted (N m-1)
    room: np.ndarray  # integral of e^(-(U - least U)/T) (m)
    begin: np.ndarray  # U - least U at the origin, in T
    distance: np.ndarray  # the shortest distance at which the variance is known (m)
    variance: np.ndarray  # (row, distance) V at this distance, times `APART` over the first of these (J2)

    @classmethod
    def of(cls, columns: np.ndarray) -> Profiles:
        """Return the profiles in an array of rows `COLUMNS`."""
        stiffness, room, begin, distance, *variances = columns
        return cls(stiffness, room, begin, distance, np.array(variances).T)

    def rows(self, chosen: np.ndarray) -> Profiles:
        """Return the chosen profiles."""
        return Profiles(*(item[chosen] for item in self))

    def heat(self, distance: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        """Return the mean energy that a pass gives (J), (row,).

        A motion that preserves volumes and changes energies by Δ at random heats a law of temperature T by
        ``<Δ²>/2T``. `distance` is that of a step at the speed ``sqrt(2T/m)``; squares of speeds of
        passing have an exponential law.
        """
        places = np.log2(distance / self.distance)[:, None] + 0.5 * np.log2(_HEAT_NODES)
        logs = np.log2(np.maximum(np.maximum.accumulate(self.variance, axis=1), 1e-300))
        known = np.log2(APART / APART[0])
        left = np.clip(np.searchsorted(known, places, side="right") - 1, 0, len(known) - 2)
        row = np.arange(len(logs))[:, None]
        slope = (np.diff(logs, axis=1) / np.diff(known))[row, left]
        beyond = (logs[:, 3] - logs[:, 0]) / known[3]  # a jump has 2, nothing has less
        slope = np.where(places < 0.0, np.maximum(beyond, 2.0)[:, None], slope)
        value = np.exp2(logs[row, left] + slope * (places - known[left]))
        return np.asarray((value * _HEAT_WEIGHTS).sum(axis=1) / (2.0 * temperature))


def of_powers(stiffness: np.ndarray, exponent: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return the `COLUMNS` of forces ``stiffness x^exponent`` at x > 0, where `length` stores a temperature.

    Their variance is ``2 Γ(1 + p)² ζ(2p + 2) (distance/2π)^(2p + 2)`` times the square of the stiffness.
    """
    distances = length / 64.0 * APART[:, None]
    order = 2.0 * exponent + 2.0
    from scipy.special import gamma, zeta  # loaded only here

    variance = 2.0 * (stiffness * gamma(1.0 + exponent)) ** 2 * zeta(order) * (distances / (2.0 * math.pi)) ** order
    room = length * gamma(1.0 + 1.0 / (exponent + 1.0))
    return np.stack([np.full_like(room, np.nan), room, np.zeros_like(room), distances[0], *variance])


def of_force(
    force: Callable[[np.ndarray], np.ndarray],
    low: float,
    high: float,
    temperature: float,
    spring: float = 0.0,
    rest: float = 0.0,
) -> np.ndarray:
    """Return the `COLUMNS` of a force (N), positive where it pushes back to smaller places (m), at a temperature (J).

    It is looked at between two places; nothing is known where they are not in order, or forces there are not finite. A
    spring (N m-1) may be beside it, and rests somewhere (m).
    """
    if not (low < high and math.isfinite(high - low) and 0.0 < temperature < math.inf):
        return np.full(COLUMNS, np.nan)

    def at(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.fmin(np.fmax(force(x), -1e150), 1e150))  # also of NaN

    def potential(x: np.ndarray, work: np.ndarray) -> np.ndarray:
        return (work + 0.5 * spring * (x - rest) ** 2) / temperature

    def levels(x: np.ndarray, found: np.ndarray) -> np.ndarray:
        work = np.concatenate([[0.0], np.cumsum(0.5 * (found[1:] + found[:-1]) * np.diff(x))])
        energy = potential(x, work)
        return np.asarray(energy - energy.min())

    x = np.linspace(low, high, RESOLUTION + 1)
    if not np.isfinite(force(x)).all():  # a run will say so
        return np.full(COLUMNS, np.nan)
    found = at(x)
    energy = levels(x, found)
    inner = np.arange(1, PARTS) / PARTS
    for _ in range(ROUNDS):
        coarse = np.flatnonzero((np.abs(np.diff(energy)) > RISE) & (np.minimum(energy[1:], energy[:-1]) < REACH))
        if not len(coarse):
            break
        more = (x[coarse, None] + np.diff(x)[coarse, None] * inner).ravel()
        order = np.argsort(np.append(x, more), kind="stable")
        x, found = np.append(x, more)[order], np.append(found, at(more))[order]
        energy = levels(x, found)
    inside = np.flatnonzero(energy <= REACH)
    low, high = float(x[max(inside[0] - 1, 0)]), float(x[min(inside[-1] + 1, len(x) - 1)])
    stiffness = _stiffness(x, found, energy, temperature)
    length = min(math.sqrt(2.0 * temperature / stiffness), high - low) if stiffness > 0.0 else high - low
    points = int(np.clip(RESOLUTION * (high - low) / length, *POINTS))
    spacing = (high - low) / points
    places = low + spacing * (np.arange(points) + 0.5)
    found = at(places)
    energy = potential(places, spacing * (np.cumsum(found) - 0.5 * found))
    least = float(energy.min())
    weight = np.exp(-(energy - least))
    distance = APART[0] * spacing
    variances = _variances(found * np.sqrt(weight), spacing)
    begin = float(potential(np.array(low), np.array(0.0))) - least
    return np.array([stiffness, spacing * weight.sum(), begin, distance, *variances])


def _stiffness(x: np.ndarray, force: np.ndarray, energy: np.ndarray, temperature: float) -> float:
    """Largest secant between places, weighted by how often its energies occur, and by how much of T it can store."""
    largest = 0.0
    apart = 1
    while apart < len(x):
        width = x[apart:] - x[:-apart]
        secant = (force[apart:] - force[:-apart]) / width
        top = np.maximum(energy[apart:], energy[:-apart])
        weight = np.where(top <= STABLE_REACH, np.maximum(np.exp(-np.maximum(top - 1.0, 0.0)), LEAST_WEIGHT), 0.0)
        weight *= np.clip(0.5 * secant * width**2 / (STORED * temperature), 0.0, 1.0)
        largest = max(largest, float((secant * weight).max()))
        apart *= 2
    return largest


def _variances(force: np.ndarray, spacing: float) -> np.ndarray:
    """Variances of ``distance × sum`` of samples of a force over the place of the first, (distance,)."""
    padded = np.append(force, np.zeros(APART[-1]))
    result = []
    for apart in APART.tolist():
        rows = -(-len(force) // apart)
        sums = np.add.reduce(padded[: rows * apart].reshape(rows, apart), axis=0) * (apart * spacing)
        result.append(sums.dot(sums) / apart - (np.add.reduce(sums) / apart) ** 2)
    return np.array(result)
