"""Coverage by question and by quantity, and what was refused."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

if TYPE_CHECKING:
    from impactlab_numerics.coverage.study import CoverageStudy

WITHIN = 2.0
"""Errors on both sides of a value that hold 95 % of a law of Student of 63 degrees of freedom."""


class Covered(NamedTuple):
    """Share of intervals that hold, its standard error, and how many there are in how many networks."""

    share: float
    error: float
    intervals: int
    networks: int


def by_question(tree: xr.DataTree) -> dict[str, xr.Dataset]:
    """Return the differences by question."""
    whole = tree["comparisons"].to_dataset()
    names = dict.fromkeys(whole["question"].values.tolist())
    return {name: whole.isel(comparison=np.flatnonzero(whole["question"].values == name)) for name in names}


def covered(part: xr.Dataset) -> Covered:
    """Return the share of differences within two errors.

    Those of one network hold or miss together: the error is that of a ratio of sums over networks, or of as many
    independent intervals if that is more.
    """
    _, of_network = np.unique(part["network"].values, return_inverse=True)
    held = np.bincount(of_network, np.abs(part.z.values) <= WITHIN)
    number = np.bincount(of_network)
    networks, intervals = len(number), int(number.sum())
    share = held.sum() / intervals
    scatter = math.sqrt(((held - share * number) ** 2).sum() * networks / max(networks - 1, 1)) / intervals
    independent = math.sqrt(0.95 * 0.05 / (intervals if networks > 1 else 1))
    return Covered(float(share), max(scatter, independent), intervals, networks)


def percent(found: Covered) -> str:
    """Return a coverage and its standard error as text."""
    return f"{100.0 * found.share:.1f} ± {100.0 * found.error:.1f}"


def tables(study: CoverageStudy, tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the coverage of each question and quantity, and refusals."""
    parts = by_question(tree)
    yield "Coverage by question", [_row(name, "", part) for name, part in parts.items()]
    rows = []
    for question, part in parts.items():
        for name in dict.fromkeys(part["quantity"].values.tolist()):
            rows.append(_row(question, name, part.isel(comparison=np.flatnonzero(part["quantity"].values == name))))
    yield "Coverage by quantity", rows
    refused = tree["refusals"].to_dataset()
    names = ("network", "question", "message")
    said = zip(*(refused[name].values.tolist() for name in names), strict=True)
    yield "Refused", [dict(zip(names, item, strict=True)) for item in said]


def _row(question: str, quantity: str, part: xr.Dataset) -> dict[str, Any]:
    found, score = covered(part), part.z.values
    worst = int(np.abs(score).argmax())
    return {
        "question": question,
        **({"quantity": quantity} if quantity else {}),
        "coverage (%)": percent(found),
        "intervals": found.intervals,
        "networks": found.networks,
        "mean of z": round(float(score.mean()), 2),
        "root mean square of z": round(float(np.sqrt(np.mean(score**2))), 2),
        "largest": round(float(np.abs(score[worst])), 1),
        "in network": int(part["network"].values[worst]),
    }
