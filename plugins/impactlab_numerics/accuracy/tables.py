"""The largest differences, the bias of each statistic, and the coverage, for the report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from impactlab_numerics.accuracy import intervals

if TYPE_CHECKING:
    from impactlab_numerics.accuracy.study import AccuracyStudy

_WORST = 12
"""Rows of the largest differences."""


def tables(study: AccuracyStudy, tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the worst differences, the bias of each statistic over all networks, and the coverage."""
    for kind in ("equal", "unequal"):
        if kind in tree.children:
            table = tree[kind].to_dataset()
            order = np.argsort(-table.excess.values)[:_WORST]
            yield f"Largest differences, {kind} temperatures", [_row(tree, table, int(i)) for i in order]
            yield f"All networks together, {kind} temperatures", _pooled(table)
    if "intervals" in tree.children:
        yield "Coverage of 95 % intervals, random networks", intervals.shares(tree["intervals"].to_dataset())
    if "coverage" in tree.children:
        yield "Coverage of 95 % intervals, base case", _coverage_rows(tree["coverage"].to_dataset())


def _row(tree: xr.DataTree, table: xr.Dataset, index: int) -> dict[str, Any]:
    row = table.isel(comparison=index)
    network = tree["networks"].to_dataset().sel(network=row.network.item())
    return {
        "network": row.network.item(),
        "statistic": row.statistic.item(),
        "of": row.label.item(),
        "difference (%)": f"{100.0 * row.relative_difference.item():.3f}",
        "standard error (%)": f"{100.0 * row.relative_error.item():.3f}",
        "z": f"{row.z.item():.1f}",
        "over allowed": f"{row.excess.item():.2f}",
        "h ω of the fastest body": f"{network.step_of_flow.item():.2f}",
        "h ω of the stiffest contact": f"{network.step_of_contact.item():.2f}",
    }


def _pooled(table: xr.Dataset) -> list[dict[str, Any]]:
    """Weighted mean of the relative differences of each statistic, and the mean square of z."""
    rows = []
    for name in dict.fromkeys(table.statistic.values.tolist()):
        part = table.isel(comparison=np.flatnonzero(table.statistic.values == name))
        weights = part.relative_error.values**-2.0
        mean = float(weights @ part.relative_difference.values / weights.sum())
        rows.append(
            {
                "statistic": name,
                "number": len(weights),
                "mean difference (%)": f"{100.0 * mean:.4f}",
                "standard error (%)": f"{100.0 * float(weights.sum() ** -0.5):.4f}",
                "mean of z²": f"{float((part.z**2).mean()):.2f}",
                "largest |z|": f"{float(np.abs(part.z).max()):.1f}",
            }
        )
    return rows


def _coverage_rows(table: xr.Dataset) -> list[dict[str, Any]]:
    return [
        {
            "statistic": row.statistic.item(),
            "of": row.label.item(),
            "coverage (%)": f"{100.0 * row.coverage.item():.1f}",
            "mean of z": f"{row.offset.item():.2f}",
            "standard deviation of z": f"{row.scatter.item():.2f}",
        }
        for row in (table.isel(comparison=i) for i in range(table.sizes["comparison"]))
    ]
