"""What the trust study claims, and its verdicts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import xarray as xr

from impactlab_numerics.trust_collect import found_of
from impactlab_numerics.trust_judge import ALLOWED, ERRORS
from impactlab_numerics.trust_tables import (
    NEEDLESS,
    SILENT,
    Coverage,
    by_class,
    class_rows,
    coverage,
    percent,
    share,
    worst_of,
    wrong_rows,
)
from impactlab_numerics.verdicts import Claim, table_of, verdict_of

MOST_NEEDLESS = 0.05
"""Share of networks that may be refused, or warned of, without need."""

COVERED, COVERED_IN_CLASS = (0.93, 0.97), (0.90, 0.98)
"""Share of intervals of 95 % that may hold what is right: of all, and in each class."""

SAMPLING = "± is one standard error from the scatter between networks, whose intervals hold or miss together"
"""What is said of standard errors of a coverage."""

MOST_UNKNOWN = 0.05
"""Share of networks for which there may be no reference."""


def judge(tree: xr.DataTree) -> xr.Dataset:
    """Return the table of claims."""
    return table_of(list(_claims(found_of(tree))))


def _claims(found: list[dict[str, Any]]) -> Iterator[Claim]:
    section = "random networks of all classes"
    silent = [item for item in found if item["outcome"] in SILENT]
    yield Claim(
        section,
        f"No default statistic but the peak is off by more than {100.0 * ALLOWED:g} % and {ERRORS:g} standard errors "
        "without a warning.",
        f"{len(silent)} of {len(found)} networks have one; the worst: {worst_of(found) or 'none'}.",
        verdict_of(not silent),
    )
    needless = share(found, NEEDLESS)
    yield Claim(
        section,
        f"At most {100.0 * MOST_NEEDLESS:g} % of networks are refused, or warned of, without need.",
        f"{100.0 * needless:.1f} % of {len(found)}.",
        verdict_of(needless <= MOST_NEEDLESS),
    )
    low, high = COVERED
    covered = coverage(found)
    yield Claim(
        section,
        f"95 % intervals hold what is right in {100.0 * low:g} to {100.0 * high:g} % of cases.",
        f"{percent(covered)} % of {covered.intervals}; {SAMPLING}." if covered.intervals else "there are none.",
        _covered(covered, (low, high)),
    )
    low, high = COVERED_IN_CLASS
    parts = {name: coverage(part) for name, part in by_class(found).items()}
    known = {name: part for name, part in parts.items() if part.intervals}
    verdicts = [_covered(part, (low, high)) for part in known.values()]
    order = ("does not hold", "sampling error", "holds")
    ends = [pick(known.items(), key=lambda item: item[1].share) for pick in (min, max)] if known else []
    yield Claim(
        section,
        f"95 % intervals hold what is right in {100.0 * low:g} to {100.0 * high:g} % of cases of each class.",
        (" to ".join(f"{percent(part)} % ({name})" for name, part in ends) + f"; {SAMPLING}.")
        if ends
        else "there are none.",
        min(verdicts, key=order.index) if verdicts else "not testable",
    )
    unknown = share(found, ("not judged",))
    yield Claim(
        section,
        f"At least {100.0 * (1.0 - MOST_UNKNOWN):g} % of networks can be judged.",
        f"{100.0 * (1.0 - unknown):.1f} %.",
        verdict_of(unknown <= MOST_UNKNOWN),
    )


def _covered(covered: Coverage, limits: tuple[float, float]) -> str:
    """Judge a share; what is within two standard errors of the limits may be chance."""
    if not covered.intervals:
        return "not testable"
    outside = max(limits[0] - covered.share, covered.share - limits[1], 0.0)
    return "holds" if outside == 0.0 else "sampling error" if outside <= 2.0 * covered.error else "does not hold"


def tables(tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield what became of the networks by class, and those that are silently wrong, or warned of without need."""
    found = found_of(tree)
    yield "Networks by class", class_rows(found)
    for title, outcomes in (("Silently wrong", SILENT), ("Warned or refused without need", NEEDLESS)):
        rows = wrong_rows(found, outcomes)
        if rows:
            yield title, rows
