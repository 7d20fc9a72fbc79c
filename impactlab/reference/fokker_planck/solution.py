"""The stationary density of a pair: marched to, extrapolated and refined."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np

from impactlab.allowed_time import OutOfTime
from impactlab.components.composition import Composition
from impactlab.errors import LONG_TIME, ImpactLabWarning, InvalidInput, NoExactReference, warn
from impactlab.inputs import checked, positive, suggestion
from impactlab.machine import cores
from impactlab.progress import say
from impactlab.reference.fokker_planck.absorbing import PassageReference, absorbed
from impactlab.reference.fokker_planck.convergence import RELATIVE_BALANCES, Convergence
from impactlab.reference.fokker_planck.cost import Budget, announced, check_memory, steps_between
from impactlab.reference.fokker_planck.follower import propagator_of
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

_TOGETHER, _MOST = 16, 128
"""Snapshots in an extrapolation, and in all."""

_SETTLED, _CALM = 0.1, 2
"""Changes by the last snapshots, in tolerances, and how many of them must be so small."""

_ALLOWED: dict[str, tuple[Callable[[float], bool], str]] = {
    "box": (lambda size: 3.0 <= size <= 9.0, "from 3 to 9 standard deviations"),
    "step": (lambda step: step > 0.0, "above 0"),
}
"""What a basis may hold beside odd numbers of nodes."""

_MOST_GRIDS = 6
"""Grids that are tried: coarser ones until one is foreseen to be done in time, and then finer ones."""


@checked
@overload
def fokker_planck(
    network: Composition,
    *,
    absorb: None = None,
    basis: Mapping[str, float] | None = None,
    tolerance: float = 1e-4,
    max_seconds: float | None = None,
) -> FokkerPlanckReference: ...


@checked
@overload
def fokker_planck(
    network: Composition, *, absorb: Mapping[str, Any], tolerance: float = 1e-4, max_seconds: float | None = None
) -> PassageReference: ...


@checked
def fokker_planck(
    network: Composition,
    *,
    absorb: Mapping[str, Any] | None = None,
    basis: Mapping[str, float] | None = None,
    tolerance: float = 1e-4,
    max_seconds: float | None = None,
) -> FokkerPlanckReference | PassageReference:
    """Find the stationary law of two bodies in contact under white noise, or first passages of a body.

    There are no random numbers. First passages are described below, with `absorb`.

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
        them whose force depends on the indentation alone. With `absorb` one body under white noise, or one beside a
        second that is linear and coupled to it by linear springs and dampers, each under white noise of its own.
    absorb : mapping of str to float or pair of float, optional
        Limits of the displacement by the name of the body (m): a number stands for limits on both sides of 0, and None
        in a pair for no limit there. The result then tells when a limit is first passed from any start: mean time,
        survival over time, and the rate at which survival decays. Forces are any functions of displacement and
        velocity. The backward equation is solved by finite elements on finer and finer meshes, and by more and more
        Hermite functions for the state of a second body; errors are the differences between the last two. Beside a
        second body ``tolerance=1e-2`` takes seconds, and limits are on both sides. `basis` is of stationary laws only.
    basis : mapping of str to number, optional
        Odd numbers of nodes ``gap``, ``center``, ``first``, ``second`` (velocities of the bodies, that with the
        higher natural frequency first), half the size of the ``box`` (standard deviations) and the
        ``step`` (s), which are then kept. What is not given is chosen and refined. An
        `AccuracyWarning` says if what was given leaves larger errors.
    tolerance : float
        Relative error that is aimed at, for all default statistics but the rate of contacts.
    max_seconds : float, optional
        Time that may be spent (s). Steps on coarser grids are timed, which tells how long finer ones will take: the
        finest grid that is foreseen to be done in time is solved, and what was reached is returned with a warning and
        its own errors. A pair is refused if not even the coarsest grid would be done, or if the first one is not
        after twice the time. By default any time is allowed, with a warning where a grid will take more than an hour.
        In a terminal or a notebook a line tells the points, the memory and the time of each grid before it begins.

    Returns
    -------
    FokkerPlanckReference or PassageReference

    Raises
    ------
    NoExactReference
        If the network is of another kind, or needs more memory or time than there is.
    InvalidInput
        If an argument cannot be used.

    Notes
    -----
    With unit masses and natural frequencies from 1 to 16 Hz the grid has 0.5 to 3 million points. A body that is so
    fast that it follows the contact as if at rest is nearly Gaussian, and described by few Hermite functions:
    ``center`` and ``first`` are their numbers then, from 3 on, and the grid has 0.1 million points.
    While it works, libraries of linear algebra (BLAS) use one thread in all of the process.

    Mean times of first passage solve equation :eq:`backward` of the theory.

    Examples
    --------
    >>> law = il.fokker_planck(pair, tolerance=0.02)
    >>> round(law.statistics().contact_ratio.item(), 2)
    0.23
    """
    given = _checked(basis)
    if not 1e-6 <= tolerance < 1.0:
        raise InvalidInput(f"tolerance must be a relative error from 1e-6 to 1, not {tolerance!r}.")
    budget = Budget(math.inf if max_seconds is None else positive("max_seconds", max_seconds))
    from threadpoolctl import threadpool_limits

    if absorb is not None:
        if basis is not None:
            raise InvalidInput("basis= is that of stationary laws; leave it out with absorb=.")
        with threadpool_limits(1, user_api="blas"):
            return absorbed(network, absorb, tolerance, budget)
    # otherwise single precision will do, in half the time: rounding then leaves errors up to 1e-4
    pair = replace(Pair.of(network), precise=tolerance < 5e-4)
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(cores()) as pool:
        try:
            return _Solver(pair, tolerance, budget, pool).solved(network, given)
        except _NotStationary:
            if not pair.gaussian:
                raise
            return _Solver(replace(pair, follows=False), tolerance, budget, pool).solved(network, given)


class _NotStationary(NoExactReference):
    """A density does not become stationary."""


@dataclass(frozen=True, eq=False)
class _Solver:
    pair: Pair
    tolerance: float
    budget: Budget
    pool: Executor

    def solved(self, network: Composition, given: Mapping[str, Any]) -> FokkerPlanckReference:
        """Refine a basis until the errors are within the tolerance, or no time is left for a finer one."""
        reached, fine, accuracy = None, None, self.tolerance
        try:
            last, density, well = self._piloted(given)
            basis, accuracy = self._in_time(well, given)
            fine = self._propagator(well, basis)
            kept = {*given, "box"} if given.keys() - {"step"} else set(given)  # nodes make the cells of a box
            free = [name for name in Basis._fields if name not in kept]
            for _ in range(_MOST_GRIDS):
                self._announce(fine.basis, accuracy)
                density, errors = self._converged(fine, fine.taken_from(last, density), accuracy)
                reached, self.budget.answered = FokkerPlanckReference(network, fine, density, errors), True
                poor = errors.insufficient(self.tolerance, free)
                if not poor:
                    if errors.insufficient(self.tolerance, Basis._fields):
                        text = f"With the given basis errors exceed {self.tolerance:g}: {errors.summary()}"
                        warn("tolerance", f"{text}. Give a finer basis=, or none.")
                    return reached
                last, basis = fine, fine.basis
                for name, excess in poor.items():
                    basis = finer(well, basis, name, excess)
                fine, accuracy = self._propagator(well, basis), max(0.1 * accuracy, self.tolerance)
                if self.budget.foreseen(self.pair, basis, accuracy) > self.budget.left:
                    raise OutOfTime("The next grid would take longer than is left.")
        except OutOfTime:
            return self._in_spite(reached, fine, accuracy)
        raise NoExactReference(
            f"The statistics do not reach an accuracy of {self.tolerance:g} with {last.basis.unknowns:.3g} unknowns: "
            f"{errors.summary()}. Give a larger tolerance=, or a basis=."
        )

    def _piloted(self, given: Mapping[str, Any]) -> tuple[Propagator, np.ndarray, Well]:
        """Return the solution on a coarse grid, and the well at the temperature that it shows."""
        bodies = slice(1 if self.pair.gaussian else 0, None)  # that the box must hold
        hottest = float(self.pair.temperatures.max())
        well = self.pair.well(float(self.pair.temperatures[bodies].max()))
        last = self._propagator(well, rule(self.pair, well, _PILOTS[0][0])._replace(**given))
        density, march = last.start(), March(last, self.pool)  # whatever is left: it tells what a march takes
        for steps in (1, 8):  # the first one touches the memory
            self.budget.timed(last.basis, march, density, steps)
        self._in_time(well, given)
        for part, settled in _PILOTS:
            pilot = self._propagator(well, rule(self.pair, well, part)._replace(**given))
            density, found = self._stationary(pilot, pilot.taken_from(last, density), settled)
            # the temperature of the box, a little above the larger mean kinetic energy
            kinetic = 1.25 * (self.pair.mass * found.values["mean_square_velocity"])
            well, last = self.pair.well(min(float(kinetic[bodies].max()), hottest), kinetic), pilot
        return last, density, well

    def _in_time(self, well: Well, given: Mapping[str, Any]) -> tuple[Basis, float]:
        """Return the basis for the tolerance, or the finest one to be done in time, and its accuracy."""
        part = max(math.log(self.tolerance) / math.log(_STANDARD), _LEAST)
        for share in np.linspace(part, _LEAST, _MOST_GRIDS):
            basis = rule(self.pair, well, float(share))._replace(**given)
            accuracy = max(self.tolerance, _STANDARD ** float(share))
            foreseen = self.budget.foreseen(self.pair, basis, accuracy)
            if foreseen <= self.budget.left:
                return basis, accuracy
        left = f"{max(self.budget.left, 0.0):.2g} s"
        raise NoExactReference(
            f"Even a coarse grid would take {announced(self.pair, basis, foreseen)}, but {left} are left. Give a "
            "larger max_seconds=."
        )

    def _announce(self, basis: Basis, accuracy: float) -> None:
        """Tell what a basis is foreseen to take."""
        foreseen = self.budget.foreseen(self.pair, basis, accuracy)
        say(None, f"fokker_planck: {announced(self.pair, basis, foreseen)}")
        if foreseen > LONG_TIME and math.isinf(self.budget.allowed):
            text = f"The grid has {announced(self.pair, basis, foreseen)}. Give max_seconds= for a coarser one."
            warn("long_run", text, ImpactLabWarning)

    def _in_spite(
        self, reached: FokkerPlanckReference | None, fine: Propagator | None, accuracy: float
    ) -> FokkerPlanckReference:
        """Return the solution reached when the time is over, with a warning; refuse if there is none."""
        spent = f"in {self.budget.spent:.2g} s"
        if reached is None or fine is None:
            raise NoExactReference(f"No density became stationary {spent}. Give a larger max_seconds= or tolerance=.")
        foreseen = self.budget.foreseen(self.pair, fine.basis, accuracy)
        warn(
            "tolerance",
            f"The tolerance of {self.tolerance:g} was not reached {spent}: {reached.errors.summary()}. The next grid "
            f"takes {announced(self.pair, fine.basis, foreseen)}; give a larger max_seconds= or tolerance=.",
        )
        return reached

    def _propagator(self, well: Well, basis: Basis) -> Propagator:
        """Return the propagator of a basis that fits into memory."""
        check_memory(self.pair, basis)
        return propagator_of(well, basis)

    def _converged(self, fine: Propagator, density: np.ndarray, accuracy: float) -> tuple[np.ndarray, Convergence]:
        """Return the stationary density, and the statistics with all directions of the ladder.

        The longest steps, which take the least time, come first; other directions are changed from the result.
        """
        settled, changed = _SETTLED * accuracy, {}
        density, twice = self._stationary(self._coarser(fine, LADDER[-1]), density, settled)
        density, found = self._stationary(fine, density, settled)
        for name in LADDER[:-1]:
            other = self._coarser(fine, name)
            changed[name] = self._stationary(other, other.taken_from(fine, density), settled, found)[1].values
        return density, Convergence(found.values, changed | {LADDER[-1]: twice.values}, found.balances)

    def _coarser(self, fine: Propagator, name: str) -> Propagator:
        return propagator_of(fine.well, coarser(fine.well, fine.basis, name))

    def _stationary(
        self, propagator: Propagator, density: np.ndarray, tolerance: float, other: Reading | None = None
    ) -> tuple[np.ndarray, Reading]:
        """March until statistics are stationary, with reduced-rank extrapolation; return the density and its reading.

        That is the combination of snapshots between which there is the least change (Smith, Ford
        and Sidi, SIAM Rev. 29, 1987, 199). Where statistics are compared with others, a fifth of the
        difference is enough.
        """
        march = March(propagator, self.pool, self.budget.check)
        steps = steps_between(self.pair, propagator.basis)
        values = _flat(Reading(propagator, density))
        snapshots, calm = [density], 0
        for _ in range(_MOST):
            snapshots.append(self.budget.timed(propagator.basis, march, snapshots[-1], steps))
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
        raise _NotStationary(
            f"The density does not become stationary with {propagator.basis}: it is not resolved, or the bodies "
            "exchange energy too slowly."
        )


def _checked(basis: Mapping[str, float] | None) -> dict[str, Any]:
    """Return the given settings of a basis, checked."""
    given = dict(basis or {})
    for name, value in given.items():
        if name not in Basis._fields:
            raise InvalidInput(f"basis has no {name!r}; {suggestion(name, Basis._fields)}")
        least = 3 if name in ("center", "first") else 9  # of Hermite functions or of nodes
        right, allowed = _ALLOWED.get(
            name, (lambda count, least=least: count >= least and count % 2 == 1, f"an odd number from {least} on")
        )
        if not right(value):
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
        density += float(weight) * snapshot
    return density


def _apart(values: np.ndarray, others: np.ndarray) -> float:
    """Return the largest relative difference."""
    return float((np.abs(values - others) / np.maximum(np.abs(values), 1e-300)).max())


def _flat(reading: Reading) -> np.ndarray:
    """Return the statistics that a tolerance is for, and balances as what should be 1."""
    with np.errstate(all="ignore"):  # of a density that grows without end
        statistics = [value for name, value in reading.values.items() if name != "contact_rate"]
        return np.concatenate([*statistics, *(1.0 + reading.balances[name] for name in RELATIVE_BALANCES)])
