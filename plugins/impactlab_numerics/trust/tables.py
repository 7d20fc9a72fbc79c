"""Outcomes of random networks, class by class."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from impactlab_numerics.trust.collect import found_of
from impactlab_numerics.trust.judge import OUTCOMES, worst

if TYPE_CHECKING:
    from impactlab_numerics.trust.study import TrustStudy

SILENT = ("silently wrong",)
"""Outcomes that there should be none of."""

NEEDLESS = ("warned needlessly", "refused", "diverged", "failed")
"""Outcomes that there should be few of."""

Found = Sequence[Mapping[str, Any]]


def by_class(found: Found) -> dict[str, list[Mapping[str, Any]]]:
    """Return the judged networks by class."""
    result: dict[str, list[Mapping[str, Any]]] = {}
    for item in found:
        result.setdefault(item["class"], []).append(item)
    return result


class Coverage(NamedTuple):
    """Share of 95 % intervals that hold the reference, its standard error, and the number of intervals."""

    share: float
    error: float
    intervals: int


def coverage(found: Found) -> Coverage:
    """Return the share of 95 % intervals that hold the reference.

    Those of one network hold or miss together, as its statistics follow from the same paths and share energy: the
    standard error of the share is that of a ratio of sums over networks, but not less than that of independent
    intervals of 95 %, or where there is one network of one interval.
    """
    held = np.array([sum(_held(item)) for item in found], dtype=float)
    number = np.array([len(_held(item)) for item in found])
    networks, intervals = np.count_nonzero(number), int(number.sum())
    if not intervals:
        return Coverage(math.nan, math.nan, 0)
    share = held.sum() / intervals
    independent = math.sqrt(0.95 * 0.05 / (intervals if networks > 1 else 1))
    scatter = math.sqrt(((held - share * number) ** 2).sum() * networks / max(networks - 1, 1)) / intervals
    return Coverage(float(share), max(scatter, independent), intervals)


def _held(item: Mapping[str, Any]) -> list[bool]:
    """Return which intervals of a network hold the reference."""
    return [row["held"] for row in item["rows"] if row["held"] is not None]


def share(found: Found, outcomes: Iterable[str]) -> float:
    """Return the share of networks with the given outcomes."""
    return sum(item["outcome"] in outcomes for item in found) / max(len(found), 1)


def class_rows(found: Found) -> list[dict[str, Any]]:
    """Return a row for each class, and one for all."""
    return [_row(name, part) for name, part in {**by_class(found), "all": list(found)}.items()]


def _row(name: str, part: Found) -> dict[str, Any]:
    count = Counter(item["outcome"] for item in part)
    errors = [row["relative_error"] for item in part for row in item["rows"] if row["relative_error"] > 0.0]
    covered = coverage(part)
    return {
        "class": name,
        "networks": len(part),
        **{outcome: count[outcome] for outcome in OUTCOMES},
        "off by chance": sum(any(row["chance"] for row in item["rows"]) for item in part),
        "coverage (%)": percent(covered),
        "intervals": covered.intervals,
        "standard error (%)": f"{100.0 * float(np.median(errors)):.2g}" if errors else "",
        "worst": worst_of(part),
    }


def percent(covered: Coverage) -> str:
    """Return a coverage and its standard error as text."""
    return f"{100.0 * covered.share:.1f} ± {100.0 * covered.error:.1f}" if covered.intervals else ""


def worst_of(found: Found) -> str:
    """Describe the difference that is largest relative to the allowed one."""
    rows = [row for item in found for row in [worst(item)] if row is not None and not row["chance"]]
    return shown(max(rows, key=lambda row: row["excess"])) if rows else ""


def shown(row: Mapping[str, Any]) -> str:
    """Describe a difference."""
    return (
        f"{row['statistic']} {100.0 * row['relative']:+.3g} ± {100.0 * row['relative_error']:.2g} % "
        f"({row['excess']:.3g} × allowed)"
    )


def wrong_rows(found: Found, outcomes: Iterable[str] = (*SILENT, *NEEDLESS)) -> list[dict[str, Any]]:
    """Return a row for each network with the given outcomes, from which it can be drawn and judged again."""
    return [
        {
            "seed": item["seed"],
            "class": item["class"],
            "outcome": item["outcome"],
            "worst": "" if worst(item) is None else shown(worst(item)),  # type: ignore[arg-type]
            "of": (worst(item) or {}).get("label", ""),
            "said": "; ".join(item["messages"])[:200],
        }
        for item in found
        if item["outcome"] in outcomes
    ]


def tables(study: TrustStudy, tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the outcomes by class, and the networks that are silently wrong, or warned of without need."""
    found = found_of(tree)
    yield "Networks by class", class_rows(found)
    for title, outcomes in (("Silently wrong", SILENT), ("Warned or refused without need", NEEDLESS)):
        rows = wrong_rows(found, outcomes)
        if rows:
            yield title, rows
