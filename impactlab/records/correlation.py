"""Records of correlation functions of linear forms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput
from impactlab.kernels.turning_points import add_products, sum_rows
from impactlab.plan.plan import Plan
from impactlab.records.linear_forms import (
    Forms,
    RowsOfForm,
    forms_given,
    joined_rows,
    names_of_forms,
    resolved_forms,
    units_of,
)
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.statistics.subsamples import in_subsamples, mean_with_error

SQUARES = {"m": "m2", "m s-1": "m2 s-2", "N": "N2"}
"""Units of products of two forms of the same units."""

MOST_LAGS = 10_000
"""Largest lag in the intervals between samples."""


class Correlation(Record):
    """Correlation functions of linear forms of displacements, velocities and contact forces.

    ``correlation`` of the forms a and b at the lag τ is the covariance ``E[(a(t) − E a)(b(t + τ) − E b)]``, over time
    and realizations; for negative lags exchange a and b. ``correlation_coefficient`` is the covariance over the
    standard deviations of both. Standard errors are those of independent realizations, or of batches.

    Under forces of a period the covariance depends on the phase ``2π t/cyclic`` too: with `cyclic` it is returned for
    phases at which a is taken, with the means at these phases; t = 0 is the begin of the statistics.

    Parameters
    ----------
    lags : sequence of float
        Lags (s), from 0 on, whole multiples of a common interval, in which samples are taken.
    of : mapping, sequence or str, optional
        Linear forms by name, as of `Extremes`; all bodies and contacts by default.
    cyclic : float, optional
        Period of forces (s).
    phases : int
        Number of phases of the period, which begin at 0.

    Examples
    --------
    >>> record = il.Correlation((0.0, 0.1, 0.2), of=("a", ("velocity", "a")))
    """

    copies: ClassVar[int] = 10  # products of deviations, and their residuals, of all pairs

    lags: tuple[float, ...] = parameter(units="s", minimum=0.0)
    of: Any = parameter(None, kw_only=False)
    cyclic: float | None = parameter(None, units="s", above=0.0, kw_only=True)
    phases: int = parameter(8, minimum=1, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "of", forms_given("Correlation.of", self.of))
        if not any(self.lags) or len(set(self.lags)) < len(self.lags):
            raise InvalidInput("Correlation.lags must be different times (s), at least one of them above 0.")
        if max(self.places) > MOST_LAGS:
            raise InvalidInput(
                f"Correlation.lags are up to {max(self.places)} times their common interval of {self.interval:g} s, "
                f"{MOST_LAGS} at most; give whole multiples of a longer interval, such as np.arange(0.0, 10.0, 0.1)."
            )

    @property
    def identity(self) -> tuple[str, ...]:
        return type(self).__name__, "" if self.cyclic is None else "cyclic"

    @property
    def interval(self) -> float:
        """Time between samples (s)."""
        phases = [] if self.cyclic is None else [self.cyclic / self.phases]
        return common_interval([*filter(None, self.lags), *phases])

    @property
    def places(self) -> list[int]:
        """The lags in intervals, after a lag of 0."""
        return [0, *(round(lag / self.interval) for lag in self.lags)]

    def resolved(self, model: Model) -> Record:
        return self.replace(of=resolved_forms("Correlation.of", self.of, model))

    def exact_interval(self) -> float | None:
        return self.interval

    def read(self, plan: Plan) -> np.ndarray:
        return joined_rows(RowsOfForm.of_all(self.of, plan.snapshot))[1]

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Products(self, run, realizations, ratio)

    @property
    def taken(self) -> int:
        """How many phases are told apart."""
        return 1 if self.cyclic is None else self.phases

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        forms, lags = len(self.of), len(self.lags) + 1
        return 8 * forms * (run.parts * self.taken * lags * (forms + 2) + max(self.places) + 1)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        forms: Forms = self.of
        found = _Found.of(results, run.plan.realizations.trusted)
        prefix = "" if self.cyclic is None else "cyclic_"
        names = [f"{prefix}correlation_{name}" for name in ("form", "other", "lag", "phase")]
        lags = labelled((names[2],), np.array(self.lags), "s", "lag")
        variables: Variables = {names[2]: lags}
        variables |= {name: names_of_forms(name, forms) for name in names[:2]}
        units = units_of(forms)
        square, text = SQUARES.get(units, ""), "covariance of a form and, a lag later, of the other"
        if self.cyclic is None:
            value, error = (item[0] for item in found.covariance)
            variables |= with_error("correlation", tuple(names[:3]), value, error, square, text)
            value, error = found.coefficient
            text = "correlation coefficient of a form and, a lag later, of the other"
            return variables | with_error("correlation_coefficient", tuple(names[:3]), value, error, "1", text)
        value, error = found.covariance
        text += ", at a phase of the form"
        variables |= with_error("cyclic_correlation", (names[3], *names[:3]), value, error, square, text)
        value, error = found.mean
        variables |= with_error("cyclic_mean", (names[3], names[0]), value, error, units, "mean of a form at a phase")
        phases = 2.0 * math.pi * np.arange(self.phases) / self.phases
        return variables | {names[3]: labelled((names[3],), phases, "rad", "phase of the cycle")}


class _Found(NamedTuple):
    """Estimates, (value, error) each, the first lag being 0."""

    mean: tuple[np.ndarray, np.ndarray]  # (phase, form)
    covariance: tuple[np.ndarray, np.ndarray]  # (phase, form, other, lag)
    coefficient: tuple[np.ndarray, np.ndarray]  # (form, other, lag), of all phases

    @classmethod
    def of(cls, results: list[dict[str, np.ndarray]], trusted: bool) -> Self:
        """Return the estimates from the sums of blocks."""
        sums, befores, afters, samples = (in_subsamples([item[key] for item in results]) for key in _Products.KEPT)
        number = samples[..., None]  # (subsample, phase, lag, form)
        before, error, _ = mean_with_error(befores, number, trusted)
        after, _, _ = mean_with_error(afters, number, trusted)
        first, second, number = before[..., :, None], after[..., None, :], number[..., None]
        centred = sums - second * befores[..., :, None] - first * afters[..., None, :] + first * second * number
        value, scatter, residuals = mean_with_error(centred, number, trusted)
        covariance = tuple(np.moveaxis(item[:, 1:], 1, -1) for item in (value, scatter))
        parts = residuals[:, 0] / samples[:, 0].sum(axis=0)[:, None, None]
        coefficient = _coefficient(value[0], parts, trusted)
        return cls((before[:, 0], error[:, 0]), covariance, coefficient)  # type: ignore[arg-type]


def _coefficient(value: np.ndarray, parts: np.ndarray, trusted: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients and errors, (form, other, lag), of covariances and their parts, ([subsample,] lag, …)."""
    variance, of_variance = np.diagonal(value[0]), np.diagonal(parts[:, 0], axis1=1, axis2=2)
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN of what does not move
        scale = np.sqrt(variance[:, None] * variance)
        relative = of_variance / variance
        ratio = value / scale
        moved = parts / scale - 0.5 * ratio * (relative[:, None, :, None] + relative[:, None, None, :])
    count = len(parts)
    error = np.sqrt((moved**2).sum(axis=0) * count / max(count - 1.0, 1.0)) if trusted else np.full_like(ratio, np.nan)
    return np.moveaxis(ratio[1:], 0, -1), np.moveaxis(error[1:], 0, -1)


def common_interval(times: Sequence[float]) -> float:
    """Return the longest time that all times are whole multiples of (s), or refuse them."""
    first = min(times)
    shares = [Fraction(time / first).limit_denominator(1000) for time in times]
    if any(abs(share * first - time) > 1e-9 * time for share, time in zip(shares, times, strict=True)):
        raise InvalidInput(
            "Correlation.lags, and the period over the phases, must be whole multiples of a common interval, such as "
            f"np.arange(0.0, 10.0, 0.1); these are not: {', '.join(f'{time:g}' for time in times[:6])} s."
        )
    return first / math.lcm(*(share.denominator for share in shares))


class _Products(Keeper):
    """Sums of products of samples at lags, per realization or batch of one."""

    KEPT = "sums", "befores", "afters", "samples"

    def __init__(self, record: Correlation, run: RecordedRun, realizations: np.ndarray, ratio: int) -> None:
        super().__init__(ratio)
        self.rows = joined_rows(RowsOfForm.of_all(record.of, run.plan.snapshot))
        self.places = np.array(record.places)
        forms, lanes, self.parts, self.taken = len(record.of), len(realizations), run.parts, 0
        self.ring = np.zeros((self.places.max() + 1, forms, lanes))
        shape = self.parts, record.taken, len(self.places)
        self.sums = np.zeros((*shape, forms, forms, lanes))
        self.befores, self.afters = np.zeros((2, *shape, forms, lanes))
        self.samples = np.zeros(shape)
        self.begin = round(run.begin / record.interval)
        self.per_phase = 1 if record.cyclic is None else round(record.cyclic / record.phases / record.interval)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        own = np.ascontiguousarray(self.own(snapshots))
        series = np.empty((self.ring.shape[1], len(own), own.shape[2]))
        sum_rows(own, *self.rows, series)
        kept = (getattr(self, name)[min(batch, self.parts - 1)] for name in self.KEPT)
        add_products(series, self.taken, self.ring, self.places, self.begin, self.per_phase, *kept)
        self.taken += len(own)

    def result(self) -> dict[str, np.ndarray]:
        each = {name: np.moveaxis(getattr(self, name), -1, 0) for name in self.KEPT[:3]}
        return {**each, "samples": np.broadcast_to(self.samples, (self.ring.shape[2], *self.samples.shape))}
