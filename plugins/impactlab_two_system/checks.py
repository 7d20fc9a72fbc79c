"""What the study asks of its own numbers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from scipy.special import ndtri

import impactlab as il
from impactlab.results.schema import STATISTICS, balances
from impactlab.studies import Check
from impactlab_two_system.corrections import artefact
from impactlab_two_system.results import Missing, Results

if TYPE_CHECKING:
    from impactlab_two_system.study import TwoSystemStudy

FALSE_ALARM = 1e-3
"""Probability that a check of many numbers fails by chance, each being right."""

BIAS = 1e-3
"""Relative error that the time step may leave."""


def checks(study: TwoSystemStudy, tree: xr.DataTree) -> list[Check]:
    """Return the checks that the settings of the study allow."""
    results = Results(study, tree)
    found = []
    for one in (_exact, _densities, _solved, _balances, _artefact):
        try:
            found += list(one(results))
        except Missing:
            continue
    return found


def _bound(numbers: int) -> float:
    """Return the standard errors that so many right numbers stay within, but for `FALSE_ALARM` (Bonferroni)."""
    return max(3.5, float(-ndtri(FALSE_ALARM / (2.0 * numbers))))


def _exact(results: Results) -> Iterator[Check]:
    """The statistics with an exact value lie within 3.5 standard errors and 0.1 % of it."""
    exact = results.node("reference/exact")
    accurate = results.node("accurate").sel(frequency_ratio=exact["frequency_ratio"])
    for name in STATISTICS:
        if name not in exact or name not in accurate:
            continue
        difference = abs(accurate[name] - exact[name]) - BIAS * abs(exact[name])
        excess = (difference / accurate[f"{name}_standard_error"]).values
        bound = _bound(excess.size)
        yield Check(
            f"exact law: {name}",
            bool((excess <= bound).all()),
            f"at most {excess.max():.2f} standard errors beyond 0.1 %, allowed {bound:.2f} for {excess.size} numbers",
        )


def _densities(results: Results) -> Iterator[Check]:
    """Of the bins with an error below 10 %, 99 % lie within 3 standard errors, and none beyond 5."""
    study = results.study
    exact = il.exact(study.network(study.balanced_ratio, study.density_clearance))
    scores = []
    for quantity, system in product(("displacement", "velocity"), ("one", "two")):
        density = results.density("density/accurate", system, study.balanced_ratio)
        expected = exact.bin_density(system, quantity, density[f"{quantity}_edges"].values)
        value = density[f"density_{quantity}"].values
        error = density[f"density_{quantity}_standard_error"].values
        sure = value > 10.0 * error
        scores.append(np.abs(value - expected)[sure] / error[sure])
    z = np.concatenate(scores)
    within = float(np.mean(z <= 3.0))
    yield Check(
        "exact law: densities",
        bool(within >= 0.99 and z.max() <= 5.0),
        f"{within:.1%} of {z.size} bins within 3 standard errors, the largest difference is {z.max():.2f}",
    )


def _solved(results: Results) -> Iterator[Check]:
    """Statistics from the Fokker–Planck equation agree with the ensembles, their own errors allowed."""
    solved = results.node("reference/fokker_planck")
    accurate = results.node("accurate").sel(frequency_ratio=solved["frequency_ratio"], clearance=solved["clearance"])
    for name in STATISTICS:
        if name not in solved or name not in accurate:
            continue
        allowed = BIAS * abs(solved[name]) + solved[f"{name}_error"]
        excess = ((abs(accurate[name] - solved[name]) - allowed) / accurate[f"{name}_standard_error"]).values
        bound = _bound(excess.size)
        yield Check(
            f"Fokker–Planck equation: {name}",
            bool((excess <= bound).all()),
            f"at most {excess.max():.2f} standard errors beyond 0.1 % and the errors of the solution, allowed "
            f"{bound:.2f} for {excess.size} numbers",
        )


def _balances(results: Results) -> Iterator[Check]:
    """Force and energy balance of every case."""
    accurate = results.node("accurate")
    for name in (balance.name for balance in balances()):
        if name not in accurate:
            continue
        z = abs(accurate[name] / accurate[f"{name}_standard_error"]).values
        z = z[np.isfinite(z)]
        bound = _bound(z.size)
        yield Check(
            name.replace("_", " "),
            bool(z.size > 0 and (z <= bound).all()),
            f"at most {z.max():.2f} standard errors from zero, allowed {bound:.2f} for {z.size} numbers",
        )


def _artefact(results: Results) -> Iterator[Check]:
    """What the paper's time step does to E[x1²] is what theory foretells for the linear system."""
    for ratio in results.study.artefact_ratios:
        foretold, found = artefact(results, ratio)
        yield Check(
            f"the paper's step at ω̄ = {ratio:g}: E[x1²]",
            abs(found.value - foretold) <= 3.5 * found.error + 2.0 * BIAS,
            f"{found:%}, foretold {foretold:.2%}; allowed 3.5 standard errors and {2.0 * BIAS:.1%} for the contact",
        )
