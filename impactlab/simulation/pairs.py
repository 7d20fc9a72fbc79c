"""Realizations at a step, and pairs of them with others at twice the step, which tell the bias of the step."""

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
from impactlab.results.schema import BODY, OF_POINTS, scatter_of, statistic_of
from impactlab.statistics.controls import UNITS_PER_CONTROL
from impactlab.statistics.drift import DRIFT
from impactlab.statistics.jackknife import controls_of
from impactlab.statistics.regression import Regression

SAFETY = 0.94
"""Part of the tolerance that is aimed at: what tells the scatter and the bias scatters itself."""

COARSE = 0.8
"""Work of a realization at twice the step, which takes as many random numbers, over that of one at the step."""

WORTHWHILE = 1.5
"""Factor by which another step must save time, since what there is will be thrown away for it."""

MANY = 64
"""Halvings after which no bias is left."""

UNLIKE = 0.2
"""Relative difference of the mean forces of a contact in the runs at one and two steps, from which a step is halved."""


class Realizations(Protocol):
    """Realizations at one step, to which more can be added; `impactlab.simulation.simulate.Ensemble` says more."""

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


EnsembleOf = Callable[[int, float | None, bool], Realizations]
"""Plans so many realizations at a step, or at one that is chosen; coarse ones have the noise of those at half the step.
"""

Report = Callable[[float], None]
"""Takes the part that is done."""


def within(report: Report, begin: float, end: float) -> Report:
    """Return what reports the parts of something that takes the progress of the whole from one part to another."""
    return lambda part: report(min(begin + (end - begin) * part, 1.0))


class Numbers(NamedTuple):
    """Of realizations at the step, and of those that have one at twice the step beside them; or the time of one (s)."""

    fine: float
    pairs: float


class Errors(NamedTuple):
    """What is known of the errors of all statistics that have a tolerance, (label,) each."""

    names: np.ndarray  # what has them
    allowed: np.ndarray
    scatter: np.ndarray  # standard errors
    bias: np.ndarray  # of the step
    doubt: np.ndarray  # standard errors of the bias, from the realizations at twice the step
    shared: np.ndarray  # those from the realizations at the step, over the scatter
    order: np.ndarray  # power of the step with which it falls at least
    alike: bool  # whether contact forces at the two steps are: else their difference is no estimate

    def of(self, labels: np.ndarray) -> Errors:
        """Return those of some labels, (label,) of bool."""
        return self._replace(**{field: getattr(self, field)[labels] for field in OF_LABELS})

    @property
    def excess(self) -> np.ndarray:
        """Errors over what is allowed; infinite where one is not known."""
        spent = np.abs(self.bias) + 2.0 * np.sqrt((1.0 + self.shared**2) * self.scatter**2 + self.doubt**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where((self.allowed > 0.0) & np.isfinite(spent), spent / self.allowed, np.inf))

    @property
    def worst(self) -> float:
        """The largest of them; infinite as well where the two steps are too different."""
        return float(self.excess.max(initial=0.0)) if self.alike else math.inf

    @property
    def uncertainty(self) -> np.ndarray:
        """Standard errors of the bias."""
        return np.asarray(np.hypot(self.doubt, self.shared * self.scatter))

    def moved(self, deviations: float) -> Errors:
        """Return those of a bias that is larger by some of its standard errors, or smaller, down to 0."""
        return self._replace(bias=np.maximum(np.abs(self.bias) + deviations * self.uncertainty, 0.0))

    def finer(self, halvings: int) -> Errors:
        """Return those that are foreseen where the step is halved some times: paths at two steps then part later."""
        part = 0.5**halvings
        bias = self.bias * part**self.order
        return self._replace(bias=bias, doubt=part * self.doubt, shared=part * self.shared)

    def wanted(self, has: Numbers) -> Numbers:
        """Return the numbers that are enough with the least work, from what those that there are have told.

        More pairs make the doubt of the bias less, and with it what of the bias is chance. Infinite where no numbers
        are enough.
        """
        pairs = has.pairs * 2.0 ** np.arange(0.0, 24.0, 0.25)[:, None]
        doubt = self.doubt * 2.0 ** np.arange(0.0, -12.0, -0.125)[:, None]
        bias = np.hypot(np.sqrt(np.maximum(self.bias**2 - self.uncertainty**2, 0.0)), doubt)
        left = 0.5 * (SAFETY * self.allowed - bias)
        with np.errstate(divide="ignore", invalid="ignore"):
            enough = has.fine * (1.0 + self.shared**2) * self.scatter**2 / (left**2 - doubt**2)
        enough[~((left > doubt) & np.isfinite(enough))] = np.inf
        fine = np.maximum(enough.max(axis=1, initial=0.0), pairs[:, 0])
        best = int(np.argmin(fine + COARSE * pairs[:, 0]))
        return Numbers(float(fine[best]), float(pairs[best, 0]))


OF_LABELS = Errors._fields[:-1]
"""What of them there is for each label."""


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
    def ensembles(self) -> list[Realizations]:
        """Those of realizations at the step and, where it has a bias, at twice the step."""
        return [self.fine] if self.coarse is None else [self.fine, self.coarse]

    def foreseen(self) -> float:
        """Return the time that the numbers that are planned will take, roughly (s)."""
        return sum(ensemble.seconds() for ensemble in self.ensembles)

    def seconds(self, numbers: Numbers) -> float:
        """Return the time that so many realizations and pairs take (s), as those that there are did."""
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
            times.append(WORTHWHILE * 2.0**halvings * self.seconds(least))
        if min(times) < math.inf:
            return int(np.argmin(times)), min(times)
        return most * math.isfinite(errors.finer(MANY).wanted(self.has).fine), math.inf

    def grow(self, numbers: Numbers, report: Report) -> None:
        """Have so many realizations and pairs."""
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
        fine, coarse = self._datasets()
        if max(fine.attrs["drift"], coarse.attrs["drift"]) > DRIFT:
            raise InvalidInput(
                f"After a spin-up of {fine.attrs['spin_up']:g} s the motion is not stationary, so a tolerance has no "
                "meaning yet. Give a longer spin_up= and duration=."
            )
        bias_of = _Bias(self.fine.plan, fine, coarse)
        found: list[Errors] = []
        for name, relative in tolerance.items():
            if name not in fine:
                raise InvalidInput(f"tolerance: this network has no {name}.")
            allowed, scatter = relative * size_of(fine, name), scatter_of(fine, name).values
            bias, doubt, shared = bias_of(name)
            self.biases[name] = fine[name].copy(data=bias)
            order = np.full(len(bias), order_of(self.fine.plan, name))
            dimension = str(fine[name].dims[0])
            names = np.array([f"{name} of {label!r}" for label in fine[dimension].values.tolist()])
            row = Errors(names, allowed, scatter, bias, doubt, shared, order, alike=True)
            found.append(row.of((allowed != 0.0) | (scatter != 0.0) | (dimension != BODY)))
        together = {field: np.concatenate([getattr(item, field) for item in found]) for field in OF_LABELS}
        return Errors(**together, alike=not _sees_other_forces(fine, coarse))

    def _datasets(self) -> tuple[xr.Dataset, xr.Dataset]:
        """Return those at the step and at twice the step, the same where it has no bias."""
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


class _Bias:
    """The bias of a step, from the realizations at twice the step; it falls with the order that theory knows of.

    As far as these follow those at the step under the same noise, the difference of each pair counts; beyond that, the
    difference from all realizations at the step. Balances of both, whose expectations are 0 at any step, take a part of
    the scatter.
    """

    def __init__(self, plan: Plan, fine: xr.Dataset, coarse: xr.Dataset) -> None:
        self.plan, self.fine, self.coarse, self.count = plan, fine, coarse, coarse.sizes["realization"]
        own = controls_of(fine)
        self.alone = _regression(own)
        self.regression = _regression(np.concatenate([own[:, : self.count], controls_of(coarse)]))

    def __call__(self, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return that of a statistic and its standard error: from the realizations at twice the step, and what those at
        the step add, over their own standard error."""
        each = statistic_of(name).by_realization
        fine, coarse = (np.ascontiguousarray(item[each].values.T) for item in (self.fine, self.coarse))
        paired = fine[:, : self.count]
        alike = self.regression.slope(coarse, paired)
        value, doubt = self.regression.at_zero(coarse - alike[:, None] * paired)
        credit = 2.0 ** order_of(self.plan, name) - 1.0
        rest = (1.0 - alike) / credit
        return value / credit - rest * self.alone.at_zero(fine).value, doubt / credit, np.abs(rest)


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
    return 2 if whole else min([1.0, *plan.impacts.orders.tolist()])


def size_of(dataset: xr.Dataset, name: str) -> np.ndarray:
    """Size of a statistic that its tolerance refers to."""
    value: np.ndarray = np.abs(dataset[name].values)
    point = "point_" if name in OF_POINTS else ""
    own = name.removeprefix(point)
    square = {"mean_velocity": "mean_square_velocity", "mean_displacement": "variance_displacement"}.get(own)
    if square is None:
        return value
    zero = value < 5.0 * scatter_of(dataset, name).values
    return np.where(zero, np.sqrt(dataset[point + square].values), value)


def _sees_other_forces(fine: xr.Dataset, coarse: xr.Dataset) -> bool:
    """Whether contact forces of the two runs differ by more than `UNLIKE`, so that their difference is no estimate.

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
    return bool((difference > UNLIKE * forces.max(axis=0) + 3.0 * np.nan_to_num(error)).any())
