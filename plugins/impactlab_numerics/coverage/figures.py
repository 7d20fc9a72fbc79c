"""The figure of the coverage study."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import xarray as xr
from matplotlib.figure import Figure

from impactlab.plotting.style import COLORS
from impactlab_numerics.coverage.claims import ASKED
from impactlab_numerics.coverage.tables import by_question, covered

if TYPE_CHECKING:
    from impactlab_numerics.coverage.study import CoverageStudy


def figures(study: CoverageStudy, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield the share of intervals that hold, by question."""
    parts = by_question(tree)
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(*(100.0 * end for end in ASKED), color="#e8e8e8")
    for row, part in enumerate(parts.values()):
        found = covered(part)
        axes.errorbar(100.0 * found.share, row, xerr=200.0 * found.error, fmt="o", ms=4, lw=0.8, color=COLORS[0])
    axes.axvline(95.0, color="black", lw=0.7, ls="--")
    axes.set_yticks(range(len(parts)), list(parts))
    axes.invert_yaxis()
    axes.set_xlabel("intervals that hold what a longer run finds (%), ±2 standard errors")
    yield "coverage", figure
