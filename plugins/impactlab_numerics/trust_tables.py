"""What became of random networks, class by class."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab_numerics.trust_judge import OUTCOMES, worst

SILENT, NEEDLESS = ("silently wrong",), ("warned needlessly", "refused", "diverged", "failed")
"""Outcomes of which there should be none, and few."""

Found = Sequence[Mapping[str, Any]]


def by_class(found: Found) -> dict[str, list[Mapping[str, Any]]]:
    """Return what was found by the class of the network."""
    result: dict[str, list[Mapping[str, Any]]] = {}
    for item in found:
        result.setdefault(item["class"], []).append(item)
    return result


class Coverage(NamedTuple):
    """Share of intervals of 95 % that hold what is right, its standard error, and how many they are."""

    share: float
    error: float
    intervals: int


def coverage(found: Found) -> Coverage:
    """Return the share of intervals of 95 % that hold what is right.

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
    """Return which intervals of a network hold what is right."""
    return [row["held"] for row in item["rows"] if row["held"] is not None]


def share(found: Found, outcomes: Iterable[str]) -> float:
    """Return the share of networks with some outcomes."""
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
    """Say which difference is the largest over what is allowed."""
    rows = [row for item in found for row in [worst(item)] if row is not None and not row["chance"]]
    return shown(max(rows, key=lambda row: row["excess"])) if rows else ""


def shown(row: Mapping[str, Any]) -> str:
    """Say what is off, and by how much."""
    return (
        f"{row['statistic']} {100.0 * row['relative']:+.3g} ± {100.0 * row['relative_error']:.2g} % "
        f"({row['excess']:.3g} × allowed)"
    )


def wrong_rows(found: Found, outcomes: Iterable[str] = (*SILENT, *NEEDLESS)) -> list[dict[str, Any]]:
    """Return a row for each network with some outcomes, by which it can be drawn and judged again."""
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


def text_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as a table of plain text."""
    if not rows:
        return "(none)"
    names = list(rows[0])
    cells = [names, *([str(row[name]) for name in names] for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(names))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
                     for line in cells)  # fmt: skip
