"""Claims of the accuracy study and their verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from scipy.special import bdtrc, ndtri

from impactlab.studies.claims import Claim, shown_in, verdict_on
from impactlab_numerics.accuracy import intervals
from impactlab_numerics.accuracy.collect import ERRORS

if TYPE_CHECKING:
    from impactlab_numerics.accuracy.study import AccuracyStudy

COVERAGE = (0.93, 0.97)
"""Share of 95 % intervals that hold the exact value, over all statistics."""

MISSED = 0.05
"""Share of runs that may miss their tolerance."""

CHANCE = 0.01
"""Probability below which chance explains nothing."""


def claims(study: AccuracyStudy, tree: xr.DataTree) -> Iterator[Claim]:
    """Yield the claims."""
    references = {"equal": "exact laws", "unequal": "runs at a quarter of the step"}
    for kind, reference in references.items():
        if kind in tree.children:
            claim = _bias(study, tree[kind].to_dataset(), f"random networks, {kind} temperatures", reference)
            yield claim._replace(figure=f"bias_{kind}")
    if "intervals" in tree.children:
        yield from shown_in("intervals", intervals.claims(tree["intervals"].to_dataset()))
    if "coverage" in tree.children:
        yield _covered(tree["coverage"].to_dataset())._replace(figure="coverage")
    if "tolerance" in tree.children:
        yield _kept(study, tree["tolerance"].to_dataset())._replace(figure="tolerance")


def _bias(study: AccuracyStudy, table: xr.Dataset, section: str, reference: str) -> Claim:
    """Judge the differences; those that chance explains, given the bias that is allowed, are no evidence."""
    count = table.sizes["comparison"]
    beyond = (np.abs(table.difference.values) - study.bias * table.scale.values) / table.standard_error.values
    failed = beyond > ERRORS
    limit = float(-ndtri(0.5 * CHANCE / count))  # Bonferroni's
    verdict = "holds" if not failed.any() else "sampling error" if beyond.max() <= limit else "does not hold"
    precise = float((table.relative_error <= 1.1 * study.standard_error).mean())
    worst = int(np.argmax(table.excess.values))
    row = table.isel(comparison=worst)
    return Claim(
        section,
        f"All default statistics but the peak are within {100.0 * study.bias:g} % of {reference}.",
        f"{int(failed.sum())} of {count} are not; the worst is {row.statistic.item()} of {row.label.item()} in network "
        f"{row.network.item()}, {100.0 * row.relative_difference.item():.3f} ± {100.0 * row.relative_error.item():.3f} "
        f"%. Standard errors are {100.0 * float(table.relative_error.median()):.3f} % in the median, and within "
        f"{100.0 * study.standard_error:g} % for {100.0 * precise:.0f} % of the statistics.",
        verdict,
        f"|difference| ≤ {100.0 * study.bias:g} % + {ERRORS:g} standard errors for each; sampling error if none is "
        f"{limit:.1f} standard errors beyond the bias.",
    )


def _covered(table: xr.Dataset) -> Claim:
    """Judge the coverage of all statistics together; within a run they are correlated.

    How much is not known well from few runs: the verdict allows for statistics that hold or
    miss their values together, so that there are no more independent cases than runs.
    """
    by_run = table.by_run.values
    share, error = float(by_run.mean()), float(by_run.std() / math.sqrt(len(by_run)))
    chance = math.sqrt(0.95 * 0.05 / len(by_run))
    verdict = verdict_on(share, COVERAGE, 2.0 * chance)
    least, most = (int(pick(table.coverage.values)) for pick in (np.argmin, np.argmax))
    named = [
        f"{100.0 * float(table.coverage[i]):.1f} % for {table.statistic[i].item()} of {table.label[i].item()}"
        for i in (least, most)
    ]
    return Claim(
        "base case, many runs",
        "95 % intervals hold the exact value in 93 to 97 % of all cases.",
        f"{100.0 * share:.1f} ± {100.0 * error:.1f} % in {len(by_run)} runs; from {named[0]} to {named[1]}.",
        verdict,
        "share between 93 and 97 %; sampling error within 2 standard errors of as many independent cases as runs.",
    )


def _kept(study: AccuracyStudy, table: xr.Dataset) -> Claim:
    """Judge the tolerances."""
    missed, count = int((table.error > 1.0).sum()), table.sizes["run"]
    chance = float(bdtrc(missed - 1, count, MISSED)) if missed else 1.0  # of as many at the share that is allowed
    verdict = "holds" if missed <= MISSED * count else "sampling error" if chance > CHANCE else "does not hold"
    return Claim(
        "base case, a tolerance",
        f"A tolerance of {study.tolerance:g} for {study.tolerance_statistic} is missed in at most 5 of 100 runs.",
        f"{missed} of {count} runs missed it; the largest error was {float(table.error.max()):.2f} times the "
        f"tolerance, the median {float(table.error.median()):.2f} times; a run took "
        f"{float(table.seconds.median()):.3g} s in the median.",
        verdict,
        f"share of 5 %; sampling error if as many have a probability of more than {CHANCE:g} at that share.",
    )
