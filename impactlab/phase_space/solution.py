"""The stationary density of a pair: settings, convergence, and what can be read from it."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlab.component import suggestion
from impactlab.dataset import provenance, statistics
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.memory import available
from impactlab.network import Network
from impactlab.phase_space.pair import Pair, Well
from impactlab.phase_space.propagator import REACH, Basis, Propagator
from impactlab.phase_space.reading import Characteristic, Reading

if TYPE_CHECKING:
    import xarray as xr

Values = dict[str, np.ndarray]

FEWER, LONGER = 0.75, math.sqrt(2.0)
"""What one direction of the basis at a time is changed by, to see its convergence."""

LADDER = (*Basis._fields, "step twice")
"""Directions of the basis; for the step there is a third one, twice as long."""

_PILOT = 0.6
"""Part of the nodes with which the temperature of the box is found."""

_MARGIN = 1.25
"""Temperature of the box, relative to the larger mean kinetic energy."""

_SNAPSHOTS, _INTERVAL, _MOST_CYCLES = 6, 0.16, 20
"""Snapshots of an extrapolation, time between them in slowest relaxation times, and extrapolations."""

_SETTLED = 0.05
"""Change by an extrapolation that counts as none, in tolerances."""

_BYTES, _MOST_UNKNOWNS, _MOST_LEVELS = 60.0, 3e7, 6

_QUANTITIES = ("displacement", "velocity")


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
        chosen and refined.
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
    workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        return _Solver(pair, tolerance, pool, workers).solved(network, given)


@dataclass(frozen=True, eq=False)
class _Solver:
    pair: Pair
    tolerance: float
    pool: Executor
    workers: int

    def solved(self, network: Network, given: Mapping[str, float]) -> FokkerPlanckReference:
        """Refine a basis until the errors are within the tolerance."""
        hottest = float(self.pair.temperatures.max())
        pilot = self._propagator(self.pair.well(hottest), given, _PILOT)
        density = self._stationary(pilot, pilot.start(), 0.01)
        kinetic = float((self.pair.mass * Reading(pilot, density).values["mean_square_velocity"]).max())
        well = self.pair.well(min(_MARGIN * kinetic, hottest))
        fine, last = self._propagator(well, given), pilot
        for _ in range(_MOST_LEVELS):
            density = self._stationary(fine, fine.taken_from(last, density), _SETTLED * self.tolerance)
            ladder = {name: self._coarser(fine, density, name) for name in LADDER}
            found = Convergence(Reading(fine, density).values, ladder)
            poor = [name for name in found.insufficient(self.tolerance) if name not in given]
            if not poor:
                return FokkerPlanckReference(network, fine, density, found)
            basis = fine.basis
            for name in poor:
                basis = _changed(basis, name, 1.0 / FEWER, 1.0 / LONGER)
            last, fine = fine, Propagator(self.pair, well, self._affordable(basis))
        raise NoExactReference(
            f"The statistics are not accurate to {self.tolerance:g} with {fine.basis.unknowns:.3g} unknowns: "
            f"{found.summary()}. Ask for a larger tolerance, or give a basis."
        )

    def _propagator(self, well: Well, given: Mapping[str, float], part: float = 1.0) -> Propagator:
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
        longer = LONGER**2 if name == LADDER[-1] else LONGER
        basis = _changed(fine.basis, name.split()[0], FEWER, longer)
        coarse = Propagator(self.pair, fine.well, basis)
        density = self._stationary(coarse, coarse.taken_from(fine, density), _SETTLED * self.tolerance)
        return Reading(coarse, density).values

    def _stationary(self, propagator: Propagator, density: np.ndarray, tolerance: float) -> np.ndarray:
        """March until statistics are stationary, with reduced-rank extrapolation of the slow decay.

        That is the combination of snapshots between which there is the least change (Smith, Ford
        and Sidi, SIAM Rev. 29, 1987, 199).
        """
        steps = max(1, round(_INTERVAL / self.pair.rate / propagator.basis.step))
        last = _flat(Reading(propagator, density).values)
        for _ in range(_MOST_CYCLES):
            snapshots, changes = [], []
            for _ in range(_SNAPSHOTS):
                following = propagator.march(density, steps, self.pool, self.workers)
                snapshots.append(following)
                changes.append((following - density).ravel())
                density = following
            gram = np.array([[np.vdot(one, other) for other in changes] for one in changes], dtype=float)
            gram += 1e-12 * np.trace(gram) * np.eye(len(gram))
            weights = np.linalg.solve(gram, np.ones(len(gram)))
            weights /= weights.sum()
            density = np.zeros_like(density)
            for weight, snapshot in zip(weights, snapshots, strict=True):
                density += np.float32(weight) * snapshot
            density = propagator.normalized(density)
            values = _flat(Reading(propagator, density).values)
            if not np.isfinite(values).all():
                break
            if (np.abs(values - last) <= tolerance * np.abs(values)).all():
                return density
            last = values
        raise NoExactReference(
            f"The density does not become stationary with {propagator.basis}: it is not resolved, or bodies exchange "
            "energy too slowly."
        )


def rule(pair: Pair, well: Well, part: float = 1.0) -> Basis:
    """Return the basis with which to begin, from scales of the network.

    Four nodes to the depth at which the contact stores the energy T of the box, two to a standard
    deviation of the center, 1.7 to one of a velocity, and more where one body alone is colder than
    T, as the fourth root of the ratio; a step of 0.4 over the frequency of the closed contact and 0.8 over those of the bodies.
    """
    low, high = well.ends
    gap = (high - low) / min(0.25 * well.penetration, 0.5 * well.width)
    velocity = _odd(part * REACH / 0.3 * max(well.temperature / float(pair.temperatures.min()), 1.0) ** 0.25)
    closed = math.sqrt(max(well.tangent / pair.reduced_mass, 1e-300))
    step = min(0.4 / closed, 0.8 / float(np.sqrt(pair.stiffness / pair.mass).max()))
    return Basis(
        _fast(part * gap),
        _odd(part * 4.0 * REACH),
        velocity,
        velocity,
        step / part,
    )


@dataclass(frozen=True, eq=False)
class Convergence:
    """Statistics, and those with one direction of the basis made coarser.

    Attributes
    ----------
    values : dict of str to ndarray
    coarser : dict of str to dict
        By the directions of `LADDER`.
    """

    values: Values
    coarser: dict[str, Values]

    @cached_property
    def errors(self) -> dict[str, Values]:
        """Errors of each direction of the basis, by name of the direction and the statistic.

        A quarter fewer nodes are taken to make the error at least twice as large for the gap, where the
        contact has a kink, and three times for the others; a longer step as much as three steps show,
        between the first and the fourth order.
        """
        result: dict[str, Values] = {}
        for direction in Basis._fields:
            share: Any = 1.0 if direction == "gap" else 0.5
            result[direction] = {}
            for name, value in self.values.items():
                change = np.abs(self.coarser[direction][name] - value)
                if direction == "step":
                    twice = np.abs(self.coarser[LADDER[-1]][name] - value)
                    with np.errstate(divide="ignore", invalid="ignore"):
                        ratio = np.nan_to_num(twice / change, nan=5.0, posinf=5.0)
                    share = 1.0 / np.clip(ratio - 2.0, LONGER - 1.0, 3.0)  # twice/change = 2^(p/2) + 1
                result[direction][name] = share * change
        return result

    @cached_property
    def total(self) -> Values:
        """Sum of the errors of all directions, by statistic."""
        return {name: sum(item[name] for item in self.errors.values()) for name in self.values}

    def insufficient(self, tolerance: float) -> list[str]:
        """Return the directions to refine, none if the errors are within the tolerance.

        The rate of contacts, which is read at a single place of the gap, is left out.
        """
        scale = {name: np.abs(value) for name, value in self.values.items() if name != "contact_rate"}
        if all((self.total[name] <= tolerance * scale[name]).all() for name in scale):
            return []
        share = tolerance / len(self.errors)
        return [
            direction
            for direction, errors in self.errors.items()
            if any((errors[name] > share * scale[name]).any() for name in scale)
        ]

    def summary(self) -> str:
        """Return the largest relative error of each direction, as text."""
        return ", ".join(
            f"{direction} {max(_largest(errors[name], self.values[name]) for name in errors):.1e}"
            for direction, errors in self.errors.items()
        )


@dataclass(frozen=True, eq=False, repr=False)
class FokkerPlanckReference:
    """Stationary law of two bodies in contact; `fokker_planck` makes it.

    Parameters
    ----------
    network : Network
        The network.
    propagator : Propagator
        The grid, and the step on it.
    phase_density : (gap, center, first, second) ndarray
        The density at its nodes.
    errors : Convergence
        Statistics on this grid and on coarser ones.
    """

    network: Network
    propagator: Propagator
    phase_density: np.ndarray
    errors: Convergence

    def statistics(self) -> xr.Dataset:
        """Return the default statistics but the peak force, with their errors.

        Returns
        -------
        xarray.Dataset
            Variables as those of `simulate`; each has an ``<name>_error``, the sum of the errors of
            all directions of the basis. The attribute ``basis`` holds the numbers of nodes and the step.
        """
        dataset = self._dataset(self.errors.values)
        for name, error in self._dataset(self.errors.total).data_vars.items():
            attrs = {"units": error.attrs["units"], "long_name": f"numerical error of {error.attrs['long_name']}"}
            dataset[f"{name}_error"] = error.dims, error.values, attrs
        configuration = {"network": self.network.to_dict(), "basis": self.basis}
        return dataset.assign_attrs(provenance("stationary statistics from the Fokker-Planck equation", configuration))

    @property
    def basis(self) -> dict[str, float]:
        """Numbers of nodes and the step (s), as `fokker_planck` takes them."""
        return self.propagator.basis._asdict()

    def convergence(self) -> xr.Dataset:
        """Return how each statistic changes with one direction of the basis at a time.

        Returns
        -------
        xarray.Dataset
            The statistics with a dimension ``direction``: values with three quarters of the nodes
            in that direction, with a step longer by √2, and with one twice as long, each
            minus the value. ``basis`` (direction) is what the direction was changed to, ``balance_force``
            (oscillator; relative to the force of the contact), ``balance_moments`` (oscillator; largest relative
            change of a second moment by a step) and ``balance_power`` what should be 0.
        """
        import xarray as xr

        parts = [
            self._dataset({name: value - self.errors.values[name] for name, value in values.items()})
            for values in self.errors.coarser.values()
        ]
        dataset = xr.concat(parts, dim=xr.Variable("direction", list(self.errors.coarser)))
        changed = [
            getattr(_changed(self.propagator.basis, name.split()[0], FEWER, longer), name.split()[0])
            for name, longer in zip(LADDER, (*[LONGER] * len(Basis._fields), LONGER**2), strict=True)
        ]
        dataset["basis"] = ("direction", np.array(changed, dtype=float), {"long_name": "nodes, or step in s"})
        for name, value in Reading(self.propagator, self.phase_density).balances.items():
            attrs = {"units": "1", "long_name": name.replace("_", " of ")}
            dataset[name] = (("oscillator",), self._in_order(value), attrs) if len(value) == 2 else ((), value[0], attrs)
        return dataset

    def density(self, oscillator: str, quantity: str, grid: Any) -> np.ndarray:
        """Return the probability density of a displacement or a velocity.

        Parameters
        ----------
        oscillator : str
            Name of the body.
        quantity : {"displacement", "velocity"}
            Whose density.
        grid : array_like
            Where (m or m s-1).

        Returns
        -------
        ndarray
            Density (m-1 or s m-1), of the shape of `grid`.

        Raises
        ------
        InvalidInput
            If a name is unknown or a number is not finite.
        """
        law, places = self._law(oscillator, quantity), _finite("grid", grid)
        return law.density(places.ravel()).reshape(places.shape)

    def bin_density(self, oscillator: str, quantity: str, edges: Any) -> np.ndarray:
        """Return the averages of the density over bins, as a histogram estimates them.

        Parameters
        ----------
        oscillator : str
            Name of the body.
        quantity : {"displacement", "velocity"}
            Whose density.
        edges : array_like
            Increasing edges of the bins (m or m s-1).

        Returns
        -------
        ndarray
            One value for every bin (m-1 or s m-1).

        Raises
        ------
        InvalidInput
            If a name is unknown or the edges do not increase.
        """
        law, places = self._law(oscillator, quantity), _finite("edges", edges)
        if places.ndim != 1 or len(places) < 2 or not (np.diff(places) > 0.0).all():
            raise InvalidInput("edges must be at least two increasing numbers in one dimension.")
        return np.asarray(np.diff(law.probability_below(places)) / np.diff(places))

    def __repr__(self) -> str:
        basis = self.propagator.basis
        return (
            f"FokkerPlanckReference: {' and '.join(self.propagator.pair.names)}, {basis.unknowns:.3g} unknowns\n"
            f"  {basis}\n  relative errors: {self.errors.summary()}"
        )

    def _dataset(self, values: Values) -> xr.Dataset:
        ordered = {name: self._in_order(value) for name, value in values.items()}
        return statistics(list(self.network.oscillators), list(self.network.contacts), ordered)

    def _in_order(self, value: np.ndarray) -> np.ndarray:
        """Return what belongs to the bodies of the contact in the order of the network."""
        names = self.propagator.pair.names
        return value[[names.index(name) for name in self.network.oscillators]] if len(value) == 2 else value

    def _law(self, oscillator: str, quantity: str) -> Characteristic:
        names = self.propagator.pair.names
        for kind, name, known in (("body", oscillator, names), ("quantity", quantity, _QUANTITIES)):
            if name not in known:
                raise InvalidInput(f"There is no {kind} {name!r}; {suggestion(name, known)}")
        reading = Reading(self.propagator, self.phase_density)
        return getattr(reading, quantity)(names.index(oscillator))


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


def _finite(name: str, values: Any) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise InvalidInput(f"{name} must hold finite numbers only.")
    return array


def _largest(error: np.ndarray, value: np.ndarray) -> float:
    return float((error[value != 0.0] / np.abs(value[value != 0.0])).max(initial=0.0))


def _changed(basis: Basis, name: str, nodes: float, step: float) -> Basis:
    """Return a basis with one direction changed."""
    value = getattr(basis, name)
    if name == "step":
        return basis._replace(step=value * step)
    return basis._replace(**{name: (_fast if name == "gap" else _odd)(nodes * value)})


def _fast(count: float) -> int:
    """Return the nearest length that Fourier transforms take well."""
    smooth = np.multiply.outer(np.multiply.outer(2 ** np.arange(16), 3 ** np.arange(10)), 5 ** np.arange(7)).ravel()
    return int(smooth[np.argmin(np.abs(smooth - count))])


def _odd(count: float) -> int:
    """Return the nearest odd number."""
    return 2 * round(0.5 * (count - 1.0)) + 1


def _flat(values: Values) -> np.ndarray:
    return np.concatenate([values[name] for name in values])
