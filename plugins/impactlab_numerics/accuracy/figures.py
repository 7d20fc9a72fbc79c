"""Figures of the accuracy study."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.special import ndtri, stdtrit

from impactlab.plotting.style import COLORS

if TYPE_CHECKING:
    from impactlab_numerics.accuracy.study import AccuracyStudy


def figures(study: AccuracyStudy, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield the figures for which there are results."""
    for kind in ("equal", "unequal"):
        if kind in tree.children:
            yield f"bias_{kind}", _differences(study, tree[kind].to_dataset())
    if "intervals" in tree.children:
        yield "intervals", _intervals(tree["intervals"].to_dataset())
    if "coverage" in tree.children:
        yield "coverage", _coverage(tree["coverage"].to_dataset())
    if "tolerance" in tree.children:
        yield "tolerance", _tolerance(tree["tolerance"].to_dataset())


def _differences(study: AccuracyStudy, table: xr.Dataset) -> Figure:
    """Relative differences with error bars by statistic, and z against the normal law."""
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    names = list(dict.fromkeys(table.statistic.values.tolist()))
    for row, name in enumerate(names):
        part = table.isel(comparison=np.flatnonzero(table.statistic.values == name))
        order = np.argsort(part.relative_error.values)
        places = row + np.linspace(-0.35, 0.35, len(order))
        left.errorbar(
            places,
            100.0 * part.relative_difference.values[order],
            200.0 * part.relative_error.values[order],
            fmt=".", ms=3, lw=0.7, color=COLORS[row % len(COLORS)],
        )  # fmt: skip
    for sign in (-1.0, 1.0):
        left.axhline(100.0 * sign * study.bias, color="black", lw=0.7, ls="--")
    left.set_xticks(range(len(names)), [name.replace("_", "\n") for name in names], fontsize=7)
    left.set_yscale("symlog", linthresh=100.0 * study.bias)
    left.set_ylabel("difference (%), ±2 standard errors")
    z = np.sort(table.z.values)
    normal = ndtri((np.arange(len(z)) + 0.5) / len(z))
    right.plot(normal, z, ".", ms=3)
    right.plot(normal, normal, color="black", lw=0.7)
    right.set_xlabel("quantile of the normal law")
    right.set_ylabel("difference in standard errors")
    return figure


def _intervals(table: xr.Dataset) -> Figure:
    """Share of intervals of each size that hold the exact value, by statistic: the diagonal is right."""
    figure = Figure(figsize=(5.2, 4.4), layout="constrained")
    axes = figure.subplots()
    asked = np.linspace(0.5, 0.995, 100)
    sizes = stdtrit(table.attrs["realizations"] - 1, 0.5 + 0.5 * asked)
    for row, name in enumerate(dict.fromkeys(table.statistic.values.tolist())):
        z = np.abs(table.z.values[table.statistic.values == name])
        share = (z[:, None] <= sizes).mean(axis=0)
        axes.plot(
            100.0 * asked,
            100.0 * (share - asked),
            color=COLORS[row % len(COLORS)],
            lw=1.0,
            label=name.replace("_", " "),
        )
    axes.axhline(0.0, color="black", lw=0.7)
    axes.set_xlabel("size of the intervals (%)")
    axes.set_ylabel("share that holds the exact value, minus the size (%)")
    axes.legend(fontsize=7)
    return figure


def _coverage(table: xr.Dataset) -> Figure:
    figure = Figure(figsize=(6.0, 3.8), layout="constrained")
    axes = figure.subplots()
    labels = [f"{name.replace('_', ' ')}, {label}" for name, label in
              zip(table.statistic.values, table.label.values, strict=True)]  # fmt: skip
    places, share = np.arange(len(labels)), 100.0 * table.coverage.values
    error = 2.0 * np.sqrt(95.0 * 5.0 / table.sizes["run"])
    axes.axvspan(95.0 - error, 95.0 + error, color="#e8e8e8", label="95 % ± 2 standard errors")
    axes.plot(share, places, "o", ms=4)
    axes.axvline(100.0 * float(table.by_run.mean()), color=COLORS[1], lw=1.0, label="all statistics")
    axes.set_yticks(places, labels, fontsize=7)
    axes.invert_yaxis()
    axes.set_xlabel("95 % intervals that hold the exact value (%)")
    axes.legend(fontsize=7)
    return figure


def _tolerance(table: xr.Dataset) -> Figure:
    figure = Figure(figsize=(4.5, 3.2), layout="constrained")
    axes = figure.subplots()
    error = np.sort(table.error.values)
    axes.step(np.append(0.0, error), np.arange(len(error) + 1) / len(error), where="post")
    axes.axvline(1.0, color="black", lw=0.7, ls="--")
    axes.axhline(0.95, color="black", lw=0.7, ls=":")
    axes.set_xlabel("largest error over the tolerance")
    axes.set_ylabel("share of runs")
    return figure
