"""Figures of the trust study."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from impactlab.plotting.style import COLORS
from impactlab_numerics.trust.collect import found_of
from impactlab_numerics.trust.judge import ALLOWED, OUTCOMES
from impactlab_numerics.trust.tables import by_class, coverage

if TYPE_CHECKING:
    from impactlab_numerics.trust.study import TrustStudy


def figures(study: TrustStudy, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield the figures."""
    classes = by_class(found_of(tree))
    yield "outcomes", _outcomes(classes)
    yield "differences", _differences(classes)
    yield "coverage", _coverage(classes)


def _outcomes(classes: dict[str, list]) -> Figure:  # type: ignore[type-arg]
    """Share of each outcome by class."""
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    axes = figure.subplots()
    left = np.zeros(len(classes))
    for index, outcome in enumerate(OUTCOMES):
        share = np.array([100.0 * np.mean([item["outcome"] == outcome for item in part]) for part in classes.values()])
        if share.any():
            axes.barh(list(classes), share, left=left, color=COLORS[index % len(COLORS)], label=outcome)
            left += share
    axes.invert_yaxis()
    axes.set_xlabel("networks (%)")
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.4, -0.12), ncols=3)
    return figure


def _differences(classes: dict[str, list]) -> Figure:  # type: ignore[type-arg]
    """Differences relative to the allowed ones, by class; beyond 1 is wrong."""
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    axes = figure.subplots()
    for row, part in enumerate(classes.values()):
        excess = np.array([item["excess"] for network in part for item in network["rows"]])
        excess = np.clip(excess[np.isfinite(excess)], 1e-3, None)
        axes.plot(excess, row + np.linspace(-0.3, 0.3, len(excess)), ".", ms=3, color=COLORS[row % len(COLORS)])
    axes.axvline(1.0, color="black", lw=0.7, ls="--")
    axes.set_xscale("log")
    axes.set_yticks(range(len(classes)), list(classes))
    axes.invert_yaxis()
    axes.set_xlabel(f"difference over what is allowed: {100.0 * ALLOWED:g} % and three standard errors")
    return figure


def _coverage(classes: dict[str, list]) -> Figure:  # type: ignore[type-arg]
    """Share of 95 % intervals that hold the reference, by class."""
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(90.0, 98.0, color="#e8e8e8")
    for row, part in enumerate(classes.values()):
        covered = coverage(part)
        if covered.intervals:
            axes.errorbar(
                100.0 * covered.share, row, xerr=200.0 * covered.error, fmt="o", ms=4, lw=0.8, color=COLORS[0]
            )
    axes.axvline(95.0, color="black", lw=0.7, ls="--")
    axes.set_yticks(range(len(classes)), list(classes))
    axes.invert_yaxis()
    axes.set_xlabel("95 % intervals that hold what is right (%), ±2 standard errors")
    return figure
