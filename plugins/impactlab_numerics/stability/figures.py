"""Stability maps: verdicts over the step and the changed parameter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from impactlab.plotting.style import style
from impactlab_numerics.stability.cells import CLASSES
from impactlab_numerics.stability.claims import chosen
from impactlab_numerics.stability.collect import AUTOMATIC, METHODS, PAPER
from impactlab_numerics.stability.study import AXES

if TYPE_CHECKING:
    from impactlab_numerics.stability.study import StabilityStudy

COLORS = ("#3B8E6E", "#E8C547", "#C0392B", "#9AA5B1", "#DDE3E8")
"""Of `CLASSES`."""

_MAP, _NORM = ListedColormap(COLORS), BoundaryNorm(np.arange(len(CLASSES) + 1) - 0.5, len(CLASSES))

_NAMES = {
    "hertz_stiffness": "Hertz stiffness (N/m$^{3/2}$)",
    "linear_stiffness": "linear stiffness (N/m)",
    "frequency_ratios": "frequency ratio",
    "mass_ratios": "mass ratio",
    "damping_ratios": "damping ratio",
    "clearances": "clearance (σ)",
}


def figures(study: StabilityStudy, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield a map for each method and noise, one for the paper's step, and how wild scenes ended."""
    cells = tree["cells"].to_dataset()
    steps = [label for label in dict.fromkeys(cells.label.values.tolist()) if label not in (AUTOMATIC, PAPER)]
    with style():
        for noise in dict.fromkeys(cells.noise.values.tolist()):
            for method in METHODS:
                name = type(method).__name__
                yield f"stability_{name}_{noise}", _maps(chosen(cells, method=name, noise=noise), name, noise, steps)
        yield "stability_paper", _paper(tree["paper"].to_dataset())


def _maps(cells: xr.Dataset, method: str, noise: str, steps: list[str]) -> Figure:
    axes = [axis for axis in AXES if (cells.axis.values == axis).any()]
    figure = Figure(figsize=(10.5, 6.2) if len(axes) > 3 else (10.5, 3.6))
    panels = np.atleast_1d(figure.subplots(2 if len(axes) > 3 else 1, min(3, max(len(axes), 1)))).ravel()
    for panel, axis in zip(panels, axes, strict=False):
        _panel(panel, chosen(cells, axis=axis), _NAMES[axis], steps)
    for panel in panels[len(axes) :]:
        panel.set_axis_off()
    panels[0].set_ylabel("step by the automatic one of the default")
    figure.suptitle(f"{method}, {'white' if noise == 'white' else 'bounded'} noise", fontsize=10)
    _legend(figure)
    return figure


def _panel(panel: Axes, cells: xr.Dataset, title: str, steps: list[str]) -> None:
    values = sorted(set(cells.value.values.tolist()))
    rows = [AUTOMATIC, PAPER, *steps]
    kinds = np.full((len(rows), len(values)), np.nan)
    for value, label, kind in zip(cells.value.values, cells.label.values, cells.kind.values, strict=True):
        kinds[rows.index(label), values.index(value)] = CLASSES.index(kind)
    panel.imshow(kinds, cmap=_MAP, norm=_NORM, aspect="auto", origin="lower", interpolation="none")
    for row, column in np.argwhere(np.isnan(kinds)):
        panel.text(column, row, "ref.", ha="center", va="center", fontsize=7)
    panel.axhline(1.5, color="white", lw=2.0)
    panel.set_xticks(range(len(values)), [f"{value:g}" for value in values])
    panel.set_yticks(range(len(rows)), ["its own", "1 ms" if PAPER in rows else "", *steps])
    panel.set_xlabel(title)
    for name, line in (("automatic_step", "k-"), ("largest_step", "k:")):
        height = [_height(cells, value, name, steps) for value in values]
        panel.plot(range(len(values)), height, line, marker="o", ms=3, lw=1.0)
    panel.set_ylim(-0.5, len(rows) - 0.5)
    panel.set_xlim(-0.5, len(values) - 0.5)


def _height(cells: xr.Dataset, value: float, name: str, steps: list[str]) -> float:
    """Return where a step of the method lies among the rows, which are multiples of the default's."""
    row = cells.isel(cell=int(np.flatnonzero(cells.value.values == value)[0]))
    step = float(row[name]) / float(row.default_step)
    factors = np.log([float(label) for label in steps])
    if not np.isfinite(step) or not len(factors):
        return np.nan
    place = np.interp(np.log(step), factors, np.arange(len(factors)), left=-0.4, right=len(factors) - 0.6)
    return float(2.0 + place)


def _paper(paper: xr.Dataset) -> Figure:
    figure = Figure(figsize=(5.8, 4.6))
    panel = figure.subplots()
    ratios, stiffness = (sorted(set(paper[name].values.tolist())) for name in ("frequency_ratio", "stiffness"))
    kinds = np.full((len(stiffness), len(ratios)), np.nan)
    for row in range(paper.sizes["cell"]):
        cell = paper.isel(cell=row)
        place = stiffness.index(float(cell.stiffness)), ratios.index(float(cell.frequency_ratio))
        kinds[place] = CLASSES.index(cell.kind.item())
        if int(cell.judged):
            text = f"{100.0 * float(cell.deviation):.1f} %"
            panel.text(place[1], place[0], text, ha="center", va="center", fontsize=7)
    panel.imshow(kinds, cmap=_MAP, norm=_NORM, aspect="auto", origin="lower", interpolation="none")
    panel.set_xticks(range(len(ratios)), [f"{value:g}" for value in ratios])
    panel.set_yticks(range(len(stiffness)), [f"{value:g}" for value in stiffness])
    panel.set(xlabel="frequency ratio", ylabel=_NAMES["hertz_stiffness"])
    panel.set_title(f"Runge–Kutta at {1e3 * paper.attrs['step']:g} ms: worst statistic", fontsize=10)
    _legend(figure)
    return figure


def _legend(figure: Figure) -> None:
    patches = [Patch(color=color, label=kind) for color, kind in zip(COLORS, CLASSES, strict=True)]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(CLASSES))
