"""What the default method is held to, with verdicts, and what must hold on any machine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab.studies import Check
from impactlab_numerics.scenes import STATISTICS
from impactlab_numerics.verdicts import Claim, table_of, verdict_of
from impactlab_numerics.work_precision import PAIR
from impactlab_numerics.work_precision_results import Results, time_text

if TYPE_CHECKING:
    from impactlab_numerics.work_precision import WorkPrecisionStudy

FASTER, TIMES_PAPER, SECONDS, STEPPING, THREADS = 3.0, 300.0, 2.0, 0.030, 1.85
"""Least factors and largest times (s) of the claims."""

BIAS, SAME, SURE = 1e-3, 0.05, 4.0
"""Relative bias that the default step may leave, and that of any method; standard errors that are allowed besides."""


def judge(study: WorkPrecisionStudy, tree: xr.DataTree) -> xr.Dataset:
    """Return the table of claims."""
    results = Results(study, tree)
    claims = [_against_baoab(results), _threads(results), *_accuracy(results)]
    return table_of(claims)


def _against_baoab(results: Results) -> Claim:
    own = results.body_steps(f"{PAIR}, impactlab, full blocks, 1 thread")
    runs = [str(run) for run in results.speed["run"].values if f"{PAIR}, numba, BAOAB" in str(run)]
    other = max(results.body_steps(run) for run in runs)
    return Claim(
        "speed",
        f"Two bodies, one core: at least {FASTER:g} times the steps of a scalar BAOAB loop with NumPy's generator.",
        f"{own:.3g} against {other:.3g} steps of a body per second: {own / other:.2f} times",
        verdict_of(own >= FASTER * other),
    )


def _threads(results: Results) -> Claim:
    one, two = (results.body_steps(f"{PAIR}, impactlab, full blocks, {text}") for text in ("1 thread", "2 threads"))
    return Claim(
        "speed",
        f"Two threads make at least {THREADS:g} times the steps of one.",
        f"{two / one:.2f} times",
        verdict_of(two >= THREADS * one, results.speed.attrs["cores"] > 1),
    )


def _accuracy(results: Results) -> list[Claim]:
    """The time to each accuracy. Our own bias is taken two standard errors larger, that of others smaller."""
    low, high = results.study.accuracies[0], results.study.accuracies[-1]
    ours, known = results.measured_seconds(), results.direct is not None
    reached, ours = math.isfinite(ours), ours if math.isfinite(ours) else math.inf
    paper = results.seconds(results.paper, high, "seconds_to_at_least")
    others = {
        case: results.seconds(case, high, "seconds_to_at_least")
        for case in results.cases(PAIR)
        if str(results.methods["tool"].sel(case=case).values) != "impactlab"
    }
    others = {case: seconds for case, seconds in others.items() if not math.isnan(seconds)}
    fastest = min(others, key=others.__getitem__)
    found = results.findings(results.default)
    stepping = results.seconds(results.default, low, "seconds_to_at_most") - found.startup
    took = f"{time_text(ours)}, measured" if reached else "not reached"
    return [
        Claim(
            "accuracy",
            f"E[x²] of the base case to {high:.2g} on one core: {TIMES_PAPER:g} times sooner than Runge–Kutta with "
            "series by FFT.",
            f"{took}, against at least {time_text(paper)}: {paper / ours:.0f} times",
            verdict_of(reached and paper >= TIMES_PAPER * ours, known),
        ),
        Claim(
            "accuracy",
            f"E[x²] of the base case to {high:.2g} on one core: within {SECONDS:g} s.",
            took,
            verdict_of(ours <= SECONDS, known),
        ),
        Claim(
            "accuracy",
            f"E[x²] of the base case to {high:.2g} on one core: sooner than all others.",
            f"{took}, against at least {time_text(others[fastest])} ({fastest}): {others[fastest] / ours:.1f} times",
            verdict_of(ours < others[fastest], known),
        ),
        Claim(
            "accuracy",
            f"E[x²] of the base case to {low:.2g} on one core: {1e3 * STEPPING:g} ms of stepping.",
            f"{time_text(stepping)}, and {time_text(found.startup)} for spin-up, planning and estimates",
            verdict_of(stepping <= STEPPING),
        ),
    ]


def check(study: WorkPrecisionStudy, tree: xr.DataTree) -> list[Check]:
    """Return what must hold on any machine: nothing about times but that they are there."""
    results = Results(study, tree)
    methods = results.methods
    rates = methods["rate"].values[methods["note"].values != "not installed"]
    checks = [
        Check("run times", bool((np.isfinite(rates) & (rates > 0.0)).all()), f"{rates.size} cases"),
        *_biases("default method", results, methods["case"].str.contains("exact flow, white, automatic").values, BIAS),
        *_biases("all methods solve one problem", results, np.isfinite(methods["bias"].values).all(axis=1), SAME),
    ]
    if results.direct is not None:
        excess = np.abs(results.direct["difference"].values) - results.direct.attrs["bias_bound"]
        excess = excess / results.direct["standard_error"].values
        checks.append(Check("measured runs", bool((excess <= SURE).all()), _excess(excess)))
    return checks


def _biases(name: str, results: Results, chosen: np.ndarray, allowed: float) -> list[Check]:
    """The biases of some cases are at most as large as allowed, and some standard errors."""
    rows = results.methods.isel(case=np.flatnonzero(chosen), statistic=slice(len(STATISTICS) - 1))
    excess = ((abs(rows["bias"]) - allowed) / rows["bias_error"]).values
    return [Check(f"{name}: bias", bool((excess <= SURE).all()), f"{_excess(excess)} beyond {allowed:.1%}")]


def _excess(excess: np.ndarray) -> str:
    return f"at most {excess.max():.2f} standard errors, allowed {SURE:g}"
