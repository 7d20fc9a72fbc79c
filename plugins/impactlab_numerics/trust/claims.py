"""Claims of the trust study and their verdicts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import xarray as xr

from impactlab.studies.claims import Claim, verdict_of, verdict_on, worst_verdict
from impactlab_numerics.trust.collect import found_of
from impactlab_numerics.trust.judge import ALLOWED, ERRORS
from impactlab_numerics.trust.tables import (
    NEEDLESS,
    SILENT,
    Coverage,
    by_class,
    coverage,
    percent,
    share,
    worst_of,
)

if TYPE_CHECKING:
    from impactlab_numerics.trust.study import TrustStudy

MOST_NEEDLESS = 0.05
"""Share of networks that may be refused, or warned of, without need."""

COVERED = (0.93, 0.97)
"""Allowed share of 95 % intervals that hold the reference, of all networks."""

COVERED_IN_CLASS = (0.90, 0.98)
"""The same share in each class."""

SAMPLING = "± is one standard error from the scatter between networks, whose intervals hold or miss together"
"""Meaning of the standard error of a coverage."""

MOST_UNKNOWN = 0.05
"""Share of networks for which there may be no reference."""


def claims(study: TrustStudy, tree: xr.DataTree) -> Iterator[Claim]:
    """Yield the claims."""
    found = found_of(tree)
    section = "random networks of all classes"
    silent = [item for item in found if item["outcome"] in SILENT]
    yield Claim(
        section,
        f"No default statistic but the peak is off by more than {100.0 * ALLOWED:g} % and {ERRORS:g} standard errors "
        "without a warning.",
        f"{len(silent)} of {len(found)} networks have one; the worst: {worst_of(found) or 'none'}.",
        verdict_of(not silent),
        figure="differences",
    )
    needless = share(found, NEEDLESS)
    yield Claim(
        section,
        f"At most {100.0 * MOST_NEEDLESS:g} % of networks are refused, or warned of, without need.",
        f"{100.0 * needless:.1f} % of {len(found)}.",
        verdict_of(needless <= MOST_NEEDLESS),
        figure="outcomes",
    )
    low, high = COVERED
    covered = coverage(found)
    yield Claim(
        section,
        f"95 % intervals hold what is right in {100.0 * low:g} to {100.0 * high:g} % of cases.",
        f"{percent(covered)} % of {covered.intervals}; {SAMPLING}." if covered.intervals else "there are none.",
        _covered(covered, (low, high)),
        figure="coverage",
    )
    low, high = COVERED_IN_CLASS
    parts = {name: coverage(part) for name, part in by_class(found).items()}
    known = {name: part for name, part in parts.items() if part.intervals}
    verdicts = [_covered(part, (low, high)) for part in known.values()]
    ends = [pick(known.items(), key=lambda item: item[1].share) for pick in (min, max)] if known else []
    yield Claim(
        section,
        f"95 % intervals hold what is right in {100.0 * low:g} to {100.0 * high:g} % of cases of each class.",
        (" to ".join(f"{percent(part)} % ({name})" for name, part in ends) + f"; {SAMPLING}.")
        if ends
        else "there are none.",
        worst_verdict(verdicts),
        figure="coverage",
    )
    unknown = share(found, ("not judged",))
    yield Claim(
        section,
        f"At least {100.0 * (1.0 - MOST_UNKNOWN):g} % of networks can be judged.",
        f"{100.0 * (1.0 - unknown):.1f} %.",
        verdict_of(unknown <= MOST_UNKNOWN),
        figure="outcomes",
    )


def _covered(covered: Coverage, limits: tuple[float, float]) -> str:
    """Judge a share, if there are intervals at all; two standard errors beyond the limits may be chance."""
    return verdict_on(covered.share, limits, 2.0 * covered.error) if covered.intervals else "not testable"
