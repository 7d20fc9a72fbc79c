"""Realizations at a step, and pairs with realizations at twice the step, from which the bias of the step follows."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import xarray as xr

from impactlab.components.composition import Composition
from impactlab.errors import ImpactLabWarning, InvalidInput, give, heard_by, unheard
from impactlab.integrators.exact_flow import ExactFlow, FineFlow, WholeFlow
from impactlab.plan.plan import Plan
from impactlab.results.dataset import configuration_of
from impactlab.results.losses import without_losses_of_either
from impactlab.results.schema import BODY, EVERY, scatter_of
from impactlab.statistics.controls import UNITS_PER_CONTROL
from impactlab.statistics.drift import DRIFT
from impactlab.statistics.jackknife import controls_of
from impactlab.statistics.regression import Regression
from impactlab.step_control.measured.bias import Bias, size_of

SAFETY = 0.94
"""Part of the tolerance that is aimed at: what tells the scatter and the bias scatters itself."""

COARSE = 0.8
"""Work of a realization at twice the step, which takes as many random numbers, over that of one at the step."""

WORTH_HALVING = 1.5
"""Factor by which another step must save time, since the present realizations are thrown away for it."""

OTHER_FORCES = 0.2
"""Relative difference of the mean forces of a contact in the runs at one and two steps, from which a step is halved."""


class GrowingEnsemble(Protocol):
    """Realizations at one step, to which more can be added, as `impactlab.simulation.growing_ensemble.Ensemble`."""

    @property
    def plan(self) -> Plan: ...

    @property
    def number(self) -> int: ...

    @property
    def exact(self) -> bool: ...

    def seconds(self) -> float: ...

    def compile(self) -> None: ...

    def grow(self, number: int, progress: Callable[[float], None], file: Path | None = None) -> None: ...

    def dataset(self) -> xr.Dataset: ...


EnsembleOf = Callable[[int, float | None, bool], GrowingEnsemble]
"""Plans so many realizations at a step, or at one that is chosen; coarse ones have the noise of those at half the step.
"""

Report = Callable[[float], None]
"""Takes the part that is done."""


def within(report: Report, begin: float, end: float) -> Report:
    """Return a report for a subtask that takes the progress of the whole from `begin` to `end`."""
    return lambda part: report(min(begin + (end - begin) * part, 1.0))


class Numbers(NamedTuple):
    """Numbers of realizations at the step, and of pairs with one at twice the step; or the seconds that each takes."""

    fine: float
    pairs: float


class Errors(NamedTuple):
    """Errors of all statistics that have a tolerance, (label,) each, in the units of the statistics."""

    names: np.ndarray  # of the statistics and their labels
    tolerated: np.ndarray
    scatter: np.ndarray
    bias: Bias  # its error is that of the realizations at twice the step
    shared: np.ndarray  # standard errors of the bias from the realizations at the step, over the scatter
    order: np.ndarray  # power of the step with which the bias falls at least
    alike: bool  # whether contact forces at the two steps are alike: else their difference is no estimate

    @property
    def excess(self) -> np.ndarray:
        """Errors over what is tolerated; infinite where one is not known."""
        bias, error = self.bias.value, self.bias.error
        spent = np.abs(bias) + 2.0 * np.sqrt((1.0 + self.shared**2) * self.scatter**2 + error**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where((self.tolerated > 0.0) & np.isfinite(spent), spent / self.tolerated, np.inf))

    @property
    def worst(self) -> float:
        """The largest excess; infinite where the motions at the two steps differ too much to compare."""
        return float(self.excess.max(initial=0.0)) if self.alike else math.inf

    @property
    def whole(self) -> Bias:
        """The bias with its whole error."""
        return Bias(self.bias.value, np.hypot(self.bias.error, self.shared * self.scatter))

    def moved(self, margin: float) -> Errors:
        """Return the errors with a bias that is larger by a multiple of its error, but not below 0."""
        return self._replace(bias=self.bias._replace(value=np.maximum(self.whole.most(margin), 0.0)))

    def finer(self, halvings: int) -> Errors:
        """Return the errors foreseen after `halvings` of the step; paths at two steps then separate later."""
        part = 0.5**halvings
        bias = Bias(self.bias.value * part**self.order, part * self.bias.error)
        return self._replace(bias=bias, shared=part * self.shared)

    def wanted(self, has: Numbers) -> Numbers:
        """Return the numbers of realizations and pairs that suffice with the least work, as the present ones tell.

        More pairs reduce the error of the bias, and with it the part of the bias that is chance. The numbers are
        infinite where none suffice.
        """
        pairs = has.pairs * 2.0 ** np.arange(0.0, 24.0, 0.25)[:, None]
        error = self.bias.error * 2.0 ** np.arange(0.0, -12.0, -0.125)[:, None]
        bias = np.hypot(np.sqrt(np.maximum(self.bias.value**2 - self.whole.error**2, 0.0)), error)
        left = 0.5 * (SAFETY * self.tolerated - bias)
        with np.errstate(divide="ignore", invalid="ignore"):
            enough = has.fine * (1.0 + self.shared**2) * self.scatter**2 / (left**2 - error**2)
        enough[~((left > error) & np.isfinite(enough))] = np.inf
        fine = np.maximum(enough.max(axis=1, initial=0.0), pairs[:, 0])
        best = int(np.argmin(fine + COARSE * pairs[:, 0]))
        return Numbers(float(fine[best]), float(pairs[best, 0]))


class Trial:
    """Realizations at a step, and pairs of the first of them with others at twice the step under the same noise."""

    def __init__(self, ensemble_of: EnsembleOf, number: int, pairs: int, step: float | None) -> None:
        self.fine = ensemble_of(number, step, False)
        self.step = self.fine.plan.clock.step
        with unheard():
            self.coarse = None if self.fine.exact else ensemble_of(pairs, 2.0 * self.step, True)
        self.planned = Numbers(number, 0 if self.coarse is None else pairs)
        self.has = self.each = Numbers(0, 0)
        self.of_pairs: xr.Dataset | None = None  # statistics at twice the step
        self.biases: dict[str, xr.DataArray] = {}
        self.heard: list[ImpactLabWarning] = []

    @property
    def ensembles(self) -> list[GrowingEnsemble]:
        """The ensembles at the step and, where the step has a bias, at twice the step."""
        return [self.fine] if self.coarse is None else [self.fine, self.coarse]

    def foreseen(self) -> float:
        """Return roughly the time that the planned numbers will take (s)."""
        return sum(ensemble.seconds() for ensemble in self.ensembles)

    def seconds(self, numbers: Numbers) -> float:
        """Return the time that so many realizations and pairs take (s), in proportion to the present ones."""
        return numbers.fine * self.each.fine + numbers.pairs * self.each.pairs

    def missing(self, numbers: Numbers) -> float:
        """Return the time that it takes to have so many (s)."""
        return self.seconds(numbers) - self.seconds(self.has)

    def cheapest(self, errors: Errors, most: int) -> tuple[int, float]:
        """Return how often to halve the step, at most, so that the errors take the least time, and that time (s)."""
        times = [self.missing(errors.wanted(self.has))]
        for halvings in range(1, most + 1):
            wanted = errors.finer(halvings).wanted(self.has)
            least = Numbers(*map(max, wanted, self.planned))
            times.append(WORTH_HALVING * 2.0**halvings * self.seconds(least))
        if min(times) < math.inf:
            return int(np.argmin(times)), min(times)
        return most * math.isfinite(errors.finer(1000).wanted(self.has).fine), math.inf  # no bias is left

    def grow(self, numbers: Numbers, report: Report) -> None:
        """Add realizations and pairs up to the given numbers."""
        has, each, total, done = list(self.has), list(self.each), max(self.missing(numbers), 1e-9), 0.0
        for place, ensemble in enumerate(self.ensembles):
            more = math.ceil(numbers[place]) - has[place]
            if more <= 0:
                continue
            ensemble.compile()
            part, begin = self.each[place] * more / total, time.monotonic()
            ensemble.grow(int(has[place] + more), within(report, done, done + part))
            has[place], each[place], done = has[place] + more, (time.monotonic() - begin) / more, done + part
            self.has, self.each = Numbers(*has), Numbers(*each)

    def errors(self, tolerance: dict[str, float]) -> Errors:
        """Judge what there is.

        A body that never moves is known; a contact that was never closed is not known at all.
        """
        fine, coarse = without_losses_of_either(*self._datasets())
        if max(fine.attrs["drift"], coarse.attrs["drift"]) > DRIFT:
            raise InvalidInput(
                f"After a spin-up of {fine.attrs['spin_up']:g} s the motion is not stationary, so a tolerance has no "
                "meaning yet. Give a longer spin_up= and duration=."
            )
        bias_of = _Pairs(self.fine.plan, fine, coarse)
        found = []
        for name, relative in tolerance.items():
            if name not in fine:
                raise InvalidInput(f"tolerance: this network has no {name}.")
            scatter = scatter_of(fine, name).values
            tolerated = relative * size_of(name, lambda item: fine[item].values, scatter)
            bias, shared = bias_of(name)
            self.biases[name] = fine[name].copy(data=bias.value)
            order = np.full(len(scatter), order_of(self.fine.plan, name))
            dimension = str(fine[name].dims[0])
            names = np.array([f"{name} of {label!r}" for label in fine[dimension].values.tolist()])
            known = (tolerated == 0.0) & (scatter == 0.0) & (dimension == BODY)
            rows = names, tolerated, scatter, bias.value, bias.error, shared, order
            found.append([row[~known] for row in rows])
        names, tolerated, scatter, value, error, shared, order = map(np.concatenate, zip(*found, strict=True))
        alike = not _sees_other_forces(fine, coarse)
        return Errors(names, tolerated, scatter, Bias(value, error), shared, order, alike)

    def _datasets(self) -> tuple[xr.Dataset, xr.Dataset]:
        """Return the datasets at the step and at twice the step; the same dataset twice where the step has no bias."""
        self.heard.clear()
        with heard_by(self.heard.append):
            self.dataset = self.fine.dataset()
        if self.coarse is None:
            return self.dataset, self.dataset
        if self.of_pairs is None or self.of_pairs.sizes["realization"] < self.coarse.number:
            with unheard():
                self.of_pairs = self.coarse.dataset()
        return self.dataset, self.of_pairs

    def repeat_warnings(self) -> None:
        """Give the warnings of the last judgement."""
        for warning in self.heard:
            give(warning)


class _Pairs:
    """The bias of a step, estimated from realizations at twice the step and the theoretical order of convergence.

    Where the two realizations of a pair are correlated, the difference within pairs counts; where they are not, the
    difference from the mean of all realizations at the step. Balances of both, whose expectations are 0 at any step,
    remove a part of the scatter.
    """

    def __init__(self, plan: Plan, fine: xr.Dataset, coarse: xr.Dataset) -> None:
        self.plan, self.fine, self.coarse, self.count = plan, fine, coarse, coarse.sizes["realization"]
        own = controls_of(fine)
        self.alone = _regression(own)
        self.regression = _regression(np.concatenate([own[:, : self.count], controls_of(coarse)]))

    def __call__(self, name: str) -> tuple[Bias, np.ndarray]:
        """Return the bias of a statistic with its error from the pairs, and the share of the scatter to add."""
        each = EVERY[name].by_realization
        fine, coarse = (np.ascontiguousarray(item[each].values.T) for item in (self.fine, self.coarse))
        paired = fine[:, : self.count]
        alike = self.regression.slope(coarse, paired)
        value, error = self.regression.at_zero(coarse - alike[:, None] * paired)
        credit = 2.0 ** order_of(self.plan, name) - 1.0
        rest = (1.0 - alike) / credit
        return Bias(value / credit - rest * self.alone.at_zero(fine).value, error / credit), np.abs(rest)


def _regression(controls: np.ndarray) -> Regression:
    """Return a regression on controls, (control, unit), or on none where they are too many."""
    number, count = controls.shape
    return Regression(controls[None, : number * (number * UNITS_PER_CONTROL <= count)], np.ones(count))


def order_of(plan: Plan, name: str) -> float:
    """Return the power of the step with which the bias of a statistic falls at least, 1 where no theory tells it.

    Stationary means of smooth conservative forces are of fourth order, unless much friction acts at one moment of a
    step. Contact rates, which look at single moments, and forces that depend on velocities are of second order, not
    both together. Nothing is known of laws with states, and of other methods under noise.
    """
    method, whole = plan.method.integrator, name != "contact_rate"
    if not isinstance(method, ExactFlow) or method.derived or len(plan.forces.states):
        return 1
    if plan.clock.certified and plan.steady and isinstance(method, FineFlow | WholeFlow):
        return 4 if whole else 2
    return 2 if whole else plan.events.order


def _sees_other_forces(fine: xr.Dataset, coarse: xr.Dataset) -> bool:
    """Whether contact forces of the two runs differ by more than `OTHER_FORCES`: their difference is then no estimate.

    A step is refused at which bodies overlap and a contact that could push them apart did not: neither run has its
    force.
    """
    if "mean_contact_force" not in fine:
        return False
    forces, closed = (
        np.stack([item[name].values for item in (fine, coarse)]) for name in ("mean_contact_force", "contact_ratio")
    )
    contacts = Composition.from_dict(configuration_of(fine)["network"]).contacts
    for slot in np.flatnonzero((forces == 0.0).all(axis=0) & (closed > 0.0).all(axis=0)):
        name = str(fine.contact.values[slot])
        if (contacts[name].law.evaluate(10.0 ** np.arange(-9.0, 4.0)) > 0.0).any():
            raise InvalidInput(
                f"tolerance: {name!r} was closed in {100.0 * closed[0, slot]:.2g} % of the time without any force at a "
                f"step of {fine.attrs['step']:.3g} s, which is too large. Give a smaller step=."
            )
    error = np.hypot(*(scatter_of(item, "mean_contact_force").values for item in (fine, coarse)))
    difference = np.abs(forces[0] - forces[1])
    return bool((difference > OTHER_FORCES * forces.max(axis=0) + 3.0 * np.nan_to_num(error)).any())
