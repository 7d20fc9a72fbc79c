"""The stationary density of a pair: marched to, extrapolated and refined."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from impactlab.component import suggestion
from impactlab.ensemble import cores
from impactlab.errors import InvalidInput, NoExactReference, warn
from impactlab.memory import available
from impactlab.network import Network
from impactlab.phase_space.convergence import Convergence, Values
from impactlab.phase_space.law import FokkerPlanckReference
from impactlab.phase_space.pair import Pair, Well
from impactlab.phase_space.propagator import Basis, Propagator
from impactlab.phase_space.reading import Reading
from impactlab.phase_space.settings import LADDER, coarser, finer, rule

_PILOTS = (0.6, 0.02), (0.8, 0.005)
"""Parts of the nodes with which the temperature of the box is found, and what is settled then."""

_ENOUGH, _MORE = 0.5, -0.1
"""Part of the nodes with which the refinement begins, for a tolerance of 1; and its power of the tolerance."""

_MARGIN = 1.25
"""Temperature of the box, relative to the larger mean kinetic energy."""

_SNAPSHOTS, _INTERVAL, _MOST_CYCLES = 6, 0.16, 20
"""Snapshots of an extrapolation, time between them in slowest relaxation times, and extrapolations."""

_SETTLED = 0.5
"""Change by the last extrapolation, in tolerances; another one would change a twentieth of that, or less."""

_BYTES, _MOST_UNKNOWNS, _MOST_LEVELS = 60.0, 3e7, 6


def fokker_planck(
    network: Network, *, basis: Mapping[str, float] | None = None, tolerance: float = 1e-4
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
        Numbers of nodes ``gap``, ``center``, ``first``, ``second`` (velocities of the bodies in
        the order of the contact) and the ``step`` (s), which are then kept. What is not given is
        chosen and refined. An `AccuracyWarning` says if what was given leaves larger errors.
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
    With unit masses and natural frequencies from 1 to 16 Hz the grid has 1 to 10 million points.
    """
    if not isinstance(network, Network):
        raise InvalidInput(f"fokker_planck takes an il.Network, {network!r} was given.")
    given = _checked(basis)
    if not (isinstance(tolerance, int | float) and 1e-6 <= tolerance < 1.0):
        raise InvalidInput(f"tolerance must be a relative error from 1e-6 to 1: {tolerance!r}.")
    pair = Pair.of(network)
    workers = cores()
    with ThreadPoolExecutor(workers) as pool:
        return _Solver(pair, tolerance, pool, workers).solved(network, given)


@dataclass(frozen=True, eq=False)
class _Solver:
    pair: Pair
    tolerance: float
    pool: Executor
    workers: int

    def solved(self, network: Network, given: Mapping[str, Any]) -> FokkerPlanckReference:
        """Refine a basis until the errors are within the tolerance."""
        hottest = float(self.pair.temperatures.max())
        temperature, last = hottest, self._propagator(self.pair.well(hottest), given, _PILOTS[0][0])
        density = last.start()
        for part, settled in _PILOTS:
            pilot = self._propagator(self.pair.well(temperature), given, part)
            density, values = self._stationary(pilot, pilot.taken_from(last, density), settled)
            kinetic = float((self.pair.mass * values["mean_square_velocity"]).max())
            temperature, last = min(_MARGIN * kinetic, hottest), pilot
        well = self.pair.well(temperature)
        fine = self._propagator(well, given, _ENOUGH * self.tolerance**_MORE)
        for _ in range(_MOST_LEVELS):
            density, values = self._stationary(fine, fine.taken_from(last, density), _SETTLED * self.tolerance)
            found = Convergence(values, {name: self._coarser(fine, density, name) for name in LADDER})
            poor = found.insufficient(self.tolerance, [name for name in Basis._fields if name not in given])
            if not poor:
                if found.insufficient(self.tolerance, Basis._fields):
                    warn(f"The basis that was given leaves errors above {self.tolerance:g}: {found.summary()}.")
                return FokkerPlanckReference(network, fine, density, found)
            basis = fine.basis
            for name in poor:
                basis = finer(basis, name)
            last, fine = fine, Propagator(self.pair, well, self._affordable(basis))
        raise NoExactReference(
            f"The statistics are not accurate to {self.tolerance:g} with {fine.basis.unknowns:.3g} unknowns: "
            f"{found.summary()}. Ask for a larger tolerance, or give a basis."
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
                f"{most:.3g} are possible: {basis}. Ask for a larger tolerance, or give a basis."
            )
        return basis

    def _coarser(self, fine: Propagator, density: np.ndarray, name: str) -> Values:
        """Return the statistics with one direction of the basis made coarser."""
        coarse = Propagator(self.pair, fine.well, coarser(fine.basis, name))
        return self._stationary(coarse, coarse.taken_from(fine, density), _SETTLED * self.tolerance)[1]

    def _stationary(self, propagator: Propagator, density: np.ndarray, tolerance: float) -> tuple[np.ndarray, Values]:
        """March until statistics are stationary, with reduced-rank extrapolation; return the density and these.

        That is the combination of snapshots between which there is the least change (Smith, Ford
        and Sidi, SIAM Rev. 29, 1987, 199).
        """
        steps = max(1, round(_INTERVAL / self.pair.rate / propagator.basis.step))
        last = _flat(Reading(propagator, density).values)
        for _ in range(_MOST_CYCLES):
            snapshots = [density]
            for _ in range(_SNAPSHOTS):
                snapshots.append(propagator.march(snapshots[-1], steps, self.pool, self.workers))
            gram = np.zeros((_SNAPSHOTS, _SNAPSHOTS))
            for rows in zip(*snapshots, strict=True):  # all of it at once would take as much memory again
                changes = np.diff(np.array(rows).reshape(len(rows), -1), axis=0)
                gram += changes @ changes.T
            gram += 1e-12 * np.trace(gram) * np.eye(len(gram))
            weights = np.linalg.solve(gram, np.ones(len(gram)))
            weights /= weights.sum()
            density = np.zeros_like(density)
            for weight, snapshot in zip(weights, snapshots[1:], strict=True):
                density += np.float32(weight) * snapshot
            density = propagator.normalized(density)
            found = Reading(propagator, density).values
            values = _flat(found)
            if not np.isfinite(values).all():
                break
            if (np.abs(values - last) <= tolerance * np.abs(values)).all():
                return density, found
            last = values
        raise NoExactReference(
            f"The density does not become stationary with {propagator.basis}: it is not resolved, or bodies exchange "
            "energy too slowly."
        )


def _checked(basis: Mapping[str, float] | None) -> dict[str, Any]:
    """Return what was given of a basis."""
    given = dict(basis or {})
    for name, value in given.items():
        if name not in Basis._fields:
            raise InvalidInput(f"basis has no {name!r}; {suggestion(name, Basis._fields)}")
        right = value > 0.0 if name == "step" else isinstance(value, int) and value >= 8
        if not (math.isfinite(value) and right):
            allowed = "above 0" if name == "step" else "a whole number of at least 8 nodes"
            raise InvalidInput(f"basis[{name!r}] must be {allowed}: {value!r}.")
    return given


def _flat(values: Values) -> np.ndarray:
    """Return the statistics that a tolerance is for."""
    return np.concatenate([value for name, value in values.items() if name != "contact_rate"])
