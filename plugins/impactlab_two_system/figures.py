"""The paper's figures 1 to 8, with error bars and the analytic solution beside the simulation."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle, product
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from impactlab.plotting.drawing import draw_network
from impactlab.plotting.style import COLORS, label_text, points, style
from impactlab_two_system.density_figures import base_densities, density_grid
from impactlab_two_system.results import Measured, Missing, Results, mean
from impactlab_two_system.style import (
    blank,
    letter,
    place,
    plain_log_axis,
    ratio_axis,
)

if TYPE_CHECKING:
    from impactlab_two_system.study import TwoSystemStudy

X2, V2 = "mean_square_displacement", "mean_square_velocity"
_POINTS: dict[str, Any] = {"fmt": "o-", "markersize": 3}
_SOLVED: dict[str, Any] = {
    "color": "black",
    "marker": "*",
    "ms": 6,
    "mfc": "none",
    "mew": 0.7,
    "ls": "none",
    "zorder": 4,
}


def figures(study: TwoSystemStudy, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield the figures that the settings of the study allow."""
    results = Results(study, tree)
    drawings: dict[str, Any] = {
        "figure_1": _system,
        "figure_2": base_densities,
        "figure_3": lambda r: density_grid(r, (12.0, 8.0, 4.0, 1.0)),
        "figure_4": lambda r: density_grid(r, (32.0, 64.0, 128.0, 256.0)),
        "figure_5": _mean_squares,
        "figure_6": _ratios,
        "figure_7": _contact_ratio,
        "figure_8": _largest_force,
    }
    with style():
        for name, drawing in drawings.items():
            try:
                yield name, drawing(results)
            except Missing:
                continue


def _system(results: Results) -> Figure:
    study = results.study
    return draw_network(study.network(study.balanced_ratio, study.density_clearance))


def _curve(
    results: Results,
    axes: Axes,
    source: str,
    name: str,
    label: str,
    clearance: float,
    colour: str,
    relative_to: str | None = None,
) -> None:
    """Draw a statistic against the frequency ratio, or its ratio to another source."""
    ratios = np.array(results.solved if source == "fokker-planck" else results.ratios(0.0))
    values = [results.value(name, label, ratio, clearance, source) for ratio in ratios]
    if relative_to is not None:
        base = [results.value(name, label, ratio, clearance, relative_to) for ratio in ratios]
        values = [Measured(v.value / b.value, v.error / b.value) for v, b in zip(values, base, strict=True)]
    value, error = (np.array([getattr(item, part) for item in values]) for part in ("value", "error"))
    if source == "accurate":
        points(axes, ratios, value, error, color=colour, zorder=3, **_POINTS)
    elif source == "paper":
        axes.plot(ratios, value, color=colour, marker="s", ms=4, mfc="none", mew=0.7, ls="none")
    elif source == "analytic":
        axes.plot(ratios, value, color=colour, ls=(0, (4, 2.5)), lw=1.0)
    elif source == "fokker-planck":
        axes.plot(ratios, value, **_SOLVED)
    else:
        axes.plot(ratios, value, color="black", ls=":", lw=1.2, zorder=1)


def _curves(
    results: Results, axes: Axes, name: str, label: str, sources: tuple[str, ...], relative_to: str | None = None
) -> None:
    """Draw a statistic for all clearances and those sources that the study has."""
    present = {"accurate", "paper"} & set(results.study.variants) | {"linear"}
    present |= set() if results.study.reference == "none" else {"analytic"}
    for source, (clearance, colour) in product(sources, _coloured(results)):
        if source in present:
            _curve(results, axes, source, name, label, clearance, colour, relative_to)
        at_solved = results.solved and name in results.node("reference/fokker_planck")
        if source == "accurate" and at_solved and clearance == results.study.density_clearance:
            _curve(results, axes, "fokker-planck", name, label, clearance, colour, relative_to)


def _coloured(results: Results) -> list[tuple[float, str]]:
    return list(zip(results.study.clearances, cycle(COLORS), strict=False))


def _legend(results: Results, sources: tuple[str, ...]) -> list[Line2D]:
    """Explain colours (clearance) and marks (source)."""
    looks: dict[str, tuple[str, dict[str, Any]]] = {
        "accurate": (r"ensemble ($\pm$2 standard errors)", {"marker": "o", "ms": 3, "lw": 1.0}),
        "paper": (
            "one record in the paper's way",
            {"marker": "s", "ms": 4, "mfc": "none", "mew": 0.7, "ls": "none"},
        ),
        "analytic": ("analytic", {"ls": (0, (4, 2.5)), "lw": 1.0}),
        "linear": ("linear, without contact", {"ls": ":", "lw": 1.2}),
    }
    shown = [Line2D([], [], color=colour, lw=4, label=f"d = {d:g} m") for d, colour in _coloured(results)]
    skipped = {"analytic"} if results.study.reference == "none" else set()
    skipped |= {"accurate", "paper"} - set(results.study.variants)
    for source in sources:
        if source not in skipped:
            text, look = looks[source]
            shown.append(Line2D([], [], color="black", label=text, **look))
    if results.solved:
        shown.append(Line2D([], [], label="Fokker\u2013Planck equation", **_SOLVED))
    return shown


def _mean_squares(results: Results) -> Figure:
    """Figure 5: mean squares and variances, and below each how it stands to the linear one."""
    sources = ("linear", "analytic", "paper", "accurate")
    figure = blank(9.0, 7.4)
    grid = figure.add_gridspec(5, 3, height_ratios=[2.2, 1.3, 0.55, 2.2, 1.3])
    columns = (
        (X2, label_text("mean square\ndisplacement", "m2")),
        ("variance_displacement", label_text("variance of\ndisplacement", "m2")),
        (V2, label_text("mean square\nvelocity", "m2 s-2")),
    )
    for row, system in enumerate(("one", "two")):
        for column, (name, text) in enumerate(columns):
            above = figure.add_subplot(grid[3 * row, column])
            below = figure.add_subplot(grid[3 * row + 1, column])
            _curves(results, above, name, system, sources)
            _curves(results, below, name, system, sources[1:], relative_to="linear")
            below.axhline(1.0, color="black", ls=":", lw=1.2, zorder=1)
            if system == "one":  # over seven decades, and close to the linear law
                above.set_yscale("log")
            else:
                plain_log_axis(above)
                plain_log_axis(below)
            ratio_axis(above, results.ratios(0.0))
            ratio_axis(below, results.ratios(0.0))
            above.set_xlabel("")
            above.tick_params(labelbottom=False)
            above.set_ylabel(text)
            below.set_ylabel("over linear")
            letter(above, 3 * row + column, f"System {row + 1}")
    place(figure, _legend(results, sources), 4, left=0.8, across=0.85, down=0.14)
    figure.align_ylabels()
    return figure


def _ratios(results: Results) -> Figure:
    """Figure 6: ratios of the mean squares of the two systems."""
    sources = ("linear", "analytic", "paper", "accurate")
    figure = blank(7.2, 3.8)
    for index, (name, axes) in enumerate(zip((X2, V2), figure.subplots(1, 2), strict=True)):
        _curves(results, axes, name, "one/two", sources)
        axes.set_yscale("log")
        ratio_axis(axes, results.ratios(0.0))
        symbol = "x" if name == X2 else "v"
        axes.set_ylabel(f"$E[{symbol}_1^2]/E[{symbol}_2^2]$")
        letter(axes, index, "displacement" if name == X2 else "velocity")
    place(figure, _legend(results, sources), 3, across=0.75)
    return figure


def _contact_ratio(results: Results) -> Figure:
    """Figure 7: the share of time in contact."""
    sources = ("analytic", "paper", "accurate")
    figure = blank(6.0, 4.0)
    axes = figure.add_subplot()
    _curves(results, axes, "contact_ratio", "gap", sources)
    ratio_axis(axes, results.ratios(0.0))
    axes.set_ylabel("contact ratio")
    axes.set_ylim(bottom=0.0)
    place(figure, _legend(results, sources), 3)
    return figure


def _largest_force(results: Results) -> Figure:
    """Figure 8: the largest force of a record, its distribution, and its growth with time."""
    study = results.study
    figure = blank(9.0, 3.6)
    over_ratio, distribution, growth = figure.subplots(1, 3)
    for clearance, colour in _coloured(results):
        ratios = results.ratios(0.0)
        if clearance == study.density_clearance:
            levels = np.array([np.quantile(results.peaks(ratio, clearance), (0.05, 0.95)) for ratio in ratios])
            over_ratio.fill_between(ratios, levels[:, 0], levels[:, 1], color=colour, alpha=0.18, lw=0)
    _curves(results, over_ratio, "peak_contact_force", "gap", ("paper", "accurate"))
    ratio_axis(over_ratio, results.ratios(0.0))
    plain_log_axis(over_ratio)
    over_ratio.set_ylabel(f"largest force in {study.duration:g} s (N)")
    letter(over_ratio, 0, "mean; band: 90 % of records")
    base = study.balanced_ratio
    if base in study.frequency_ratios:
        for clearance, colour in _coloured(results):
            peaks = np.sort(results.peaks(base, clearance))
            distribution.plot(peaks, 1.0 - (np.arange(peaks.size) + 0.5) / peaks.size, color=colour)
            counts = [count for count in (1, 2, 4, 8, 16, 32, 64) if count <= study.ensemble(base) // 16]
            means = [mean(results.peaks(base, clearance, count)) for count in counts]
            times, errors = study.duration * np.array(counts), [item.error for item in means]
            points(growth, times, [item.value for item in means], errors, color=colour, **_POINTS)
        distribution.set_yscale("log")
        growth.set_xscale("log")
    distribution.set_xlabel(f"largest force in {study.duration:g} s (N)")
    distribution.set_ylabel("share of records with a larger one")
    letter(distribution, 1, rf"distribution, $\bar\omega={base:g}$")
    growth.set_xlabel("observation time (s)")
    growth.set_ylabel("mean of the largest force (N)")
    letter(growth, 2, rf"growth with time, $\bar\omega={base:g}$")
    place(figure, _legend(results, ("paper", "accurate")), 5, across=0.75)
    return figure
