"""The stationary density of a pair: marched to, extrapolated and refined."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from impactlab.components.component import suggestion
from impactlab.components.composition import Composition
from impactlab.errors import InvalidInput, NoExactReference, warn
from impactlab.machine import available, cores
from impactlab.reference.fokker_planck.convergence import RELATIVE_BALANCES, Convergence
from impactlab.reference.fokker_planck.law import FokkerPlanckReference
from impactlab.reference.fokker_planck.march import March
from impactlab.reference.fokker_planck.pair import Pair, Well
from impactlab.reference.fokker_planck.propagator import Basis, Propagator
from impactlab.reference.fokker_planck.reading import Reading
from impactlab.reference.fokker_planck.settings import LADDER, coarser, finer, rule

_PILOTS = (0.6, 0.02), (0.8, 0.005)
"""Parts of the nodes with which the temperature of the box is found, and what is settled then."""

_STANDARD, _LEAST = 1e-4, 0.5
"""Tolerance that the rule is for, its nodes going with the logarithm of the tolerance; and the least part of them."""

_MARGIN = 1.25
"""Temperature of the box, relative to the larger mean kinetic energy."""

_INTERVAL, _TOGETHER, _MOST = 0.2, 16, 128
"""Time between snapshots in slowest relaxation times, their number in an extrapolation, and in all."""

_SETTLED, _CALM = 0.1, 2
"""Changes by the last snapshots, in tolerances, and how many of them must be so small."""

_ALLOWED: dict[str, tuple[Callable[[float], bool], str]] = {
    "box": (lambda size: 3.0 <= size <= 9.0, "from 3 to 9 standard deviations"),
    "step": (lambda step: step > 0.0, "above 0"),
}
"""What a basis may hold beside odd numbers of nodes."""

_BYTES, _MOST_UNKNOWNS, _MOST_LEVELS = 200.0, 2e7, 6


def fokker_planck(
    network: Composition, *, basis: Mapping[str, float] | None = None, tolerance: float = 1e-4
) -> FokkerPlanckReference:
    """Find the stationary law of two bodies in contact under white noise, without random numbers.

    The temperatures ``π S / damping`` of the bodies may differ, so that there need be no closed
    form. The density of the gap, the center and both velocities is carried from step to step
    of the default integrator's chain until it is stationary, on a grid of trigonometric
    polynomials; the rules that choose the grid look at the network only. Then the grid is made
    coarser in one direction at a time, and the step longer, which tells how accurate the
    statistics are; directions that are not good enough are refined, and it begins anew.

    Parameters
    ----------
    network : Network
        Two linear bodies with a spring, damping and white noise each, and one contact between
        them whose force depends on the indentation alone.
    basis : mapping of str to number, optional
        Odd numbers of nodes ``gap``, ``center``, ``first``, ``second`` (velocities of the bodies in
        the order of the contact), half the size of the ``box`` (standard deviations) and the
        ``step`` (s), which are then kept. What is not given is chosen and refined. An
        `AccuracyWarning` says if what was given leaves larger errors.
    tolerance : float
        Relative error that is aimed at, for all default statistics but the rate of contacts.

    Returns
    -------
    FokkerPlanckReference

    Raises
    ------
    NoExactReference
        If the network is of another kind, or the tolerance needs more memory than there is.
    InvalidInput
        If an argument cannot be used.

    Notes
    -----
    With unit masses and natural frequencies from 1 to 16 Hz the grid has 0.5 to 3 million points.
    While it works, libraries of linear algebra (BLAS) use one thread in all of the process.
    """
    if not isinstance(network, Composition):
        raise InvalidInput(f"fokker_planck takes an il.Network, not {network!r}.")
    given = _checked(basis)
    if not (isinstance(tolerance, int | float) and 1e-6 <= tolerance < 1.0):
        raise InvalidInput(f"tolerance must be a relative error from 1e-6 to 1, not {tolerance!r}.")
    from threadpoolctl import threadpool_limits

    pair = Pair.of(network)
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(cores()) as pool:
        return _Solver(pair, tolerance, pool).solved(network, given)


@dataclass(frozen=True, eq=False)
class _Solver:
    pair: Pair
    tolerance: float
    pool: Executor

    def solved(self, network: Composition, given: Mapping[str, Any]) -> FokkerPlanckReference:
        """Refine a basis until the errors are within the tolerance."""
        hottest = float(self.pair.temperatures.max())
        temperature, last = hottest, self._propagator(self.pair.well(hottest), given, _PILOTS[0][0])
        density = last.start()
        for part, settled in _PILOTS:
            pilot = self._propagator(self.pair.well(temperature), given, part)
            density, found = self._stationary(pilot, pilot.taken_from(last, density), settled)
            kinetic = float((self.pair.mass * found.values["mean_square_velocity"]).max())
            temperature, last = min(_MARGIN * kinetic, hottest), pilot
        well = self.pair.well(temperature)
        part = max(math.log(self.tolerance) / math.log(_STANDARD), _LEAST)
        fine = self._propagator(well, given, part)
        kept = {*given, "box"} if given.keys() - {"step"} else set(given)  # nodes make the cells of a box
        free = [name for name in Basis._fields if name not in kept]
        for _ in range(_MOST_LEVELS):
            density, errors = self._converged(fine, fine.taken_from(last, density))
            poor = errors.insufficient(self.tolerance, free)
            if not poor:
                if errors.insufficient(self.tolerance, Basis._fields):
                    warn(f"With the given basis errors exceed {self.tolerance:g}: {errors.summary()}.")
                return FokkerPlanckReference(network, fine, density, errors)
            basis = fine.basis
            for name, excess in poor.items():
                basis = finer(well, basis, name, excess)
            last, fine = fine, Propagator(self.pair, well, self._affordable(basis))
        raise NoExactReference(
            f"The statistics do not reach an accuracy of {self.tolerance:g} with {fine.basis.unknowns:.3g} unknowns: "
            f"{errors.summary()}. Give a larger tolerance=, or a basis=."
        )

    def _propagator(self, well: Well, given: Mapping[str, Any], part: float = 1.0) -> Propagator:
        """Return the propagator of a basis that follows from the network, with what was given."""
        return Propagator(self.pair, well, self._affordable(rule(self.pair, well, part)._replace(**given)))

    def _affordable(self, basis: Basis) -> Basis:
        """Refuse a basis that does not fit into memory."""
        most = min(_MOST_UNKNOWNS, 0.5 * available() / _BYTES)
        if basis.unknowns > most:
            raise NoExactReference(
                f"The grid would need {basis.unknowns:.3g} points ({_BYTES * basis.unknowns / 1e9:.3g} GB), "
                f"but at most {most:.3g} are possible: {basis}. Give a larger tolerance=, or a basis=."
            )
        return basis

    def _converged(self, fine: Propagator, density: np.ndarray) -> tuple[np.ndarray, Convergence]:
        """Return the stationary density, and the statistics with all directions of the ladder.

        The longest steps, which take the least time, come first; other directions are changed from the result.
        """
        settled, changed = _SETTLED * self.tolerance, {}
        density, twice = self._stationary(self._coarser(fine, LADDER[-1]), density, settled)
        density, found = self._stationary(fine, density, settled)
        for name in LADDER[:-1]:
            other = self._coarser(fine, name)
            changed[name] = self._stationary(other, other.taken_from(fine, density), settled, found)[1].values
        return density, Convergence(found.values, changed | {LADDER[-1]: twice.values}, found.balances)

    def _coarser(self, fine: Propagator, name: str) -> Propagator:
        return Propagator(self.pair, fine.well, coarser(fine.well, fine.basis, name))

    def _stationary(
        self, propagator: Propagator, density: np.ndarray, tolerance: float, other: Reading | None = None
    ) -> tuple[np.ndarray, Reading]:
        """March until statistics are stationary, with reduced-rank extrapolation; return the density and its reading.

        That is the combination of snapshots between which there is the least change (Smith, Ford
        and Sidi, SIAM Rev. 29, 1987, 199). Where statistics are compared with others, a fifth of the
        difference is enough.
        """
        march = March(propagator, self.pool)
        steps = max(1, round(_INTERVAL / self.pair.rate / propagator.basis.step))
        values = _flat(Reading(propagator, density))
        snapshots, calm = [density], 0
        for _ in range(_MOST):
            snapshots.append(march(snapshots[-1], steps))
            density = propagator.normalized(_extrapolated(snapshots))
            found = Reading(propagator, density)
            last, values = values, _flat(found)
            if not np.isfinite(values).all():
                break
            enough = max(tolerance, 0.2 * _apart(values, _flat(other))) if other else tolerance
            calm = calm + 1 if _apart(values, last) <= enough else 0
            if calm == _CALM:
                return density, found
            if len(snapshots) > _TOGETHER:
                snapshots = [density]
        raise NoExactReference(
            f"The density does not become stationary with {propagator.basis}: it is not resolved, or the bodies "
            "exchange energy too slowly."
        )


def _checked(basis: Mapping[str, float] | None) -> dict[str, Any]:
    """Return what was given of a basis."""
    given = dict(basis or {})
    for name, value in given.items():
        if name not in Basis._fields:
            raise InvalidInput(f"basis has no {name!r}; {suggestion(name, Basis._fields)}")
        right, allowed = _ALLOWED.get(name, (lambda count: count >= 9 and count % 2 == 1, "an odd number from 9 on"))
        if not (isinstance(value, int | float) and math.isfinite(value) and right(value)):
            raise InvalidInput(f"basis[{name!r}] must be {allowed}, not {value!r}.")
    return given


def _extrapolated(snapshots: list[np.ndarray]) -> np.ndarray:
    """Return the combination of snapshots between which there is the least change."""
    count = len(snapshots) - 1
    gram = np.zeros((count, count))
    for rows in zip(*snapshots, strict=True):  # all of it at once would take as much memory again
        changes = np.diff(np.array(rows).reshape(len(rows), -1), axis=0)
        gram += changes @ changes.T
    gram += 1e-12 * np.trace(gram) * np.eye(count)
    weights = np.linalg.solve(gram, np.ones(count))
    weights /= weights.sum()
    density = np.zeros_like(snapshots[0])
    for weight, snapshot in zip(weights, snapshots[1:], strict=True):
        density += np.float32(weight) * snapshot
    return density


def _apart(values: np.ndarray, others: np.ndarray) -> float:
    """Return the largest relative difference."""
    return float((np.abs(values - others) / np.maximum(np.abs(values), 1e-300)).max())


def _flat(reading: Reading) -> np.ndarray:
    """Return the statistics that a tolerance is for, and balances as what should be 1."""
    statistics = [value for name, value in reading.values.items() if name != "contact_rate"]
    return np.concatenate([*statistics, *(1.0 + reading.balances[name] for name in RELATIVE_BALANCES)])
