"""Claims of the work-precision study and their verdicts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import xarray as xr

from impactlab.studies.claims import Claim, shown_in, verdict_of
from impactlab_numerics.work_precision.results import Results, time_text
from impactlab_numerics.work_precision.study import PAIR

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy

FASTER = 3.0
"""Least factor between our steps per second and those of a scalar BAOAB loop."""

TIMES_PAPER = 100.0
"""Least factor between the time of Runge–Kutta with series and that of a run to a tolerance, errors judged alike."""

PRICE, PRICE_ELSEWHERE = 1.4, 1.5
"""Largest factors between the times to a tolerance and of a run with the same step and error."""

SECONDS = 2.0
"""Longest time to the highest accuracy (s)."""

STEPPING = 0.030
"""Longest time of the steps to the lowest accuracy (s)."""

THREADS = 1.85
"""Least factor between the steps of two threads and of one."""


PATHS = {"linear stop": 20.0, "Hertz stop": 10.0, "rigid stop": 5.0}
"""Least factors between the times of whole calls to a path, of DOP853 with events and of located events."""

PATH_ERROR = 1e-8
"""Error of such a path (m)."""

_DIAGRAM = f"work_precision_{PAIR.replace(' ', '_')}"


def claims(study: WorkPrecisionStudy, tree: xr.DataTree) -> list[Claim]:
    """Return the claims."""
    results = Results(study, tree)
    return [
        _against_baoab(results),
        _threads(results),
        *shown_in(_DIAGRAM, _accuracy(results)),
        _tolerance(results),
        *shown_in("paths_without_noise", [_path(results, network) for network in PATHS]),
    ]


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
    """The time to each accuracy, of a run to that tolerance; biases of others are taken two standard errors smaller."""
    low, high = results.study.accuracies[0], results.study.accuracies[-1]
    run, known = {"seconds": math.inf, "error": math.inf}, results.tolerances is not None
    if results.tolerances is not None:
        run = {name: float(results.tolerances[name].sel(network=PAIR)) for name in run}
    reached = run["error"] <= 1.0
    ours = run["seconds"] if reached else math.inf
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


def _path(results: Results, network: str) -> Claim:
    """Judge the time to an accurate path without noise."""
    lines = ("impactlab: located events", "scipy: DOP853 with events", "numba: Runge–Kutta")
    ours, solver, loop = (results.path_seconds(network, line, PATH_ERROR) for line in lines)
    return Claim(
        "paths",
        f"{network.capitalize()}, {results.paths.attrs['periods']} periods to {PATH_ERROR:g} m: {PATHS[network]:g} "
        "times sooner than DOP853 with events.",
        f"{time_text(ours)} against {time_text(solver)}: {solver / ours:.0f} times (Runge–Kutta: {time_text(loop)})",
        verdict_of(ours * PATHS[network] <= solver and math.isfinite(ours)),
    )


def _tolerance(results: Results) -> Claim:
    """Judge the price of a tolerance, the medians of the rounds."""
    table = results.tolerances
    prices = {} if table is None else dict(zip(table["network"].values, table["ratio"].values, strict=True))
    here, elsewhere = prices.pop(PAIR, math.inf), max(prices, key=prices.__getitem__, default="")
    return Claim(
        "accuracy",
        f"A tolerance takes at most {PRICE:g} times the run with the same step and standard error, {PRICE_ELSEWHERE:g} "
        "times in ten other networks.",
        f"{here:.2f} times; elsewhere at most {prices.get(elsewhere, math.inf):.2f} times ({elsewhere})",
        verdict_of(here <= PRICE and all(price <= PRICE_ELSEWHERE for price in prices.values()), table is not None),
    )
