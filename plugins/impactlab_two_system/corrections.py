"""Corrections to the paper, each with a number that the study computes itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

import impactlab as il
from impactlab_two_system.analytic import (
    CORRECTED_EXPONENT,
    PRINTED_EXPONENT,
    AnalyticSolution,
    fokker_planck_residual,
    runge_kutta_mean_square,
)
from impactlab_two_system.results import Measured, Missing, Results, mean

if TYPE_CHECKING:
    from impactlab_two_system.study import TwoSystemStudy

PAPER_SAMPLES = 4e6
"""Number of samples that section 3.1 of the paper gives for one solution."""


class Row(NamedTuple):
    """One number of a correction; `paper` is what follows from the paper's text, NaN if it gives none."""

    quantity: str
    units: str
    paper: float
    found: Measured


def corrections(study: TwoSystemStudy, tree: xr.DataTree) -> xr.Dataset:
    """Return the numbers of the nine corrections; what the settings leave out has no row."""
    results = Results(study, tree)
    found: list[tuple[int, Row]] = []
    for number, demonstration in enumerate(_DEMONSTRATIONS, start=1):
        try:
            found += [(number, row) for row in demonstration(results)]
        except Missing:
            continue
    rows = [row for _, row in found]
    columns: dict[str, tuple[Any, str]] = {
        "correction": ([number for number, _ in found], "number of the correction"),
        "quantity": ([row.quantity for row in rows], "what is compared"),
        "units": ([row.units for row in rows], "units of the numbers"),
        "paper": ([row.paper for row in rows], "number that follows from the paper; NaN where it gives none"),
        "found": ([row.found.value for row in rows], "number that the study finds"),
        "found_standard_error": ([row.found.error for row in rows], "standard error of what the study finds"),
    }
    return xr.Dataset({name: ("row", values, {"long_name": text}) for name, (values, text) in columns.items()})


def _exponent(results: Results) -> Iterator[Row]:
    study = results.study
    network = study.network(study.balanced_ratio, study.density_clearance)
    printed, corrected = (AnalyticSolution.of(network, p) for p in (PRINTED_EXPONENT, CORRECTED_EXPONENT))
    ratios = [float(solution.statistics()["contact_ratio"][0]) for solution in (printed, corrected)]
    yield Row("contact ratio with exponent 3/2 and 5/2", "1", ratios[0], Measured(ratios[1]))
    normals = np.random.default_rng(study.seed).standard_normal((2, 2, 1000))
    states = [
        np.sqrt(variance)[:, None] * normal
        for variance, normal in zip(
            (corrected.linear_mean_square_displacement, corrected.linear_mean_square_velocity),
            normals,
            strict=True,
        )
    ]
    residuals = [
        float(np.sqrt(np.mean(fokker_planck_residual(solution, *states) ** 2))) for solution in (printed, corrected)
    ]
    yield Row("residual of Eq. 4 with exponent 3/2 and 5/2", "s-1", residuals[0], Measured(residuals[1]))
    simulated = results.value("contact_ratio", "gap", study.balanced_ratio, study.density_clearance)
    yield Row("contact ratio simulated, against exponent 3/2", "1", ratios[0], simulated)


def _normalisation(results: Results) -> Iterator[Row]:
    study = results.study
    network = study.network(study.balanced_ratio, study.density_clearance)
    white = float(AnalyticSolution.of(network).linear_mean_square_velocity[0])
    cases = [("equation 14", white / 4.0), ("equation 16", white / 4.0)]
    for name, paper in cases:
        values = results.seeds(f"normalisation_{name.replace(' ', '_')}", "mean_square_velocity", "one")
        yield Row(f"E[v1²], normalisation {name}, against πS/(8ζω)", "m2 s-2", paper, mean(values))
    if study.normalisation == "consistent":
        values = results.seeds("scatter", "mean_square_velocity", "one")
        yield Row("E[v1²], normalisation S_f = 4πS, against πS/(2ζω) of Eq. 3", "m2 s-2", white, mean(values))


def _record_length(results: Results) -> Iterator[Row]:
    study = results.study
    name = "mean_square_displacement"
    cases = {
        "scatter": f"{study.components} cosines, {study.duration:g} s",
        "scatter_components": f"{4 * study.components} cosines, {study.duration:g} s",
        "scatter_duration": f"{4 * study.components} cosines, {4 * study.duration:g} s",
    }
    for item, text in cases.items():
        yield Row(
            f"relative scatter of E[x2²] between records: {text}",
            "1",
            math.nan,
            results.scatter(item, name, "two"),
        )
    case = (study.balanced_ratio, study.density_clearance)
    white = results.value(name, "two", *case)
    one = results.one_record(name, "two", *case)
    relative = one / white.value
    error = relative / math.sqrt(2.0 * (study.ensemble(case[0]) - 1))
    yield Row(f"the same with white noise, {study.duration:g} s", "1", math.nan, Measured(relative, error))


def _repetition(results: Results) -> Iterator[Row]:
    series: Any = results.study.network(results.study.balanced_ratio, 0.0, "paper").excitations["two"]
    yield Row("time after which the series of equally spaced lines repeats", "s", math.inf, Measured(series.period))
    correlation = float(results.node("repetition")["correlation"].sel(oscillator="two"))
    yield Row("correlation of x2 with itself one duration later", "1", 0.0, Measured(correlation))


def _step(results: Results) -> Iterator[Row]:
    for ratio in results.study.artefact_ratios:
        foretold, found = artefact(results, ratio)
        yield Row(f"relative error of E[x1²] by the paper's step at ω̄ = {ratio:g}", "1", math.nan, found)
        yield Row(f"the same by theory, without contact, ω̄ = {ratio:g}", "1", math.nan, Measured(foretold))


def artefact(results: Results, ratio: float) -> tuple[float, Measured]:
    """Return the relative error of E[x1²] that the paper's step makes: by linear theory, and as simulated."""
    study = results.study
    network = study.network(ratio, study.density_clearance, "paper")
    body, series = network.oscillators["one"], network.excitations["one"]
    assert isinstance(body, il.LinearOscillator)
    assert isinstance(series, il.ShinozukaNoise)
    white = math.pi * series.spectral_density / (body.damping * body.stiffness)
    foretold = runge_kutta_mean_square(body, series, study.paper_step) / white - 1.0
    name = "mean_square_displacement"
    many = mean(results.seeds(f"artefact_{ratio:g}", name, "one"))
    return foretold, many.against(results.value(name, "one", ratio, study.density_clearance))


def _band(results: Results) -> Iterator[Row]:
    study = results.study
    for ratio in (study.balanced_ratio, 256.0):
        network = study.network(ratio, study.density_clearance, "paper", normalisation="consistent")
        body, series = network.oscillators["one"], network.excitations["one"]
        assert isinstance(series, il.ShinozukaNoise)
        frequency, amplitude = series.lines()
        impedance = (body.stiffness - body.mass * frequency**2) ** 2 + (body.damping * frequency) ** 2
        limited = 0.5 * float((amplitude**2 * frequency**2 / impedance).sum())
        white = math.pi * study.spectral_density_one / (body.damping * body.mass)
        yield Row(
            f"linear E[v1²] in the band against white noise, ω̄ = {ratio:g}",
            "1",
            1.0,
            Measured(limited / white),
        )


def _observation_time(results: Results) -> Iterator[Row]:
    study = results.study
    for records in (1, 4, 16):
        peaks = results.peaks(study.balanced_ratio, study.density_clearance, records)
        text = f"mean of the largest force in {records * study.duration:g} s"
        yield Row(text, "N", math.nan, mean(peaks))


def _clearance(results: Results) -> Iterator[Row]:
    study = results.study
    for name, text in (("mean_square_displacement", "E[x2²]"), ("variance_displacement", "variance of x2")):
        for clearance in study.clearances:
            value = results.value(name, "two", study.balanced_ratio, clearance)
            yield Row(f"{text} at d = {clearance:g} m", "m2", math.nan, value)


def _samples(results: Results) -> Iterator[Row]:
    count = 4.0 * results.study.duration / results.study.paper_step
    yield Row("samples of the four coordinates in one record", "1", PAPER_SAMPLES, Measured(count))


_DEMONSTRATIONS: tuple[Callable[[Results], Iterator[Row]], ...] = (
    _exponent,
    _normalisation,
    _record_length,
    _repetition,
    _step,
    _band,
    _observation_time,
    _clearance,
    _samples,
)
