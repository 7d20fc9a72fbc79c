"""Figures 2 to 4: the densities of displacements and velocities."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from impactlab.plotting.style import band, label_text, units_text
from impactlab_two_system.results import Missing, Results
from impactlab_two_system.style import AXIS, BLUE, GREEN, GREY, ORANGE, SKY, blank, letter, place, plain

COORDINATES = tuple(AXIS)
BAND = 2.0  # standard errors


def _variants(results: Results) -> list[str]:
    return [name for name in ("paper", "accurate") if name in results.study.variants]


_LOOKS: dict[str, dict[str, Any]] = {
    "paper": {"color": GREY, "lw": 0.6, "label": "simulated, one record in the paper's way"},
    "accurate": {"color": BLUE, "lw": 1.3, "label": r"simulated, ensemble ($\pm$2 standard errors)"},
    "analytic": {
        "color": ORANGE,
        "lw": 1.1,
        "ls": (0, (4, 2.5)),
        "label": "analytic, Eq. 12 with exponent 5/2",
    },
    "fokker-planck": {"color": "black", "lw": 0.9, "ls": ":", "label": "Fokker\u2013Planck equation"},
}


def _densities(results: Results, axes: Axes, ratio: float, system: str, quantity: str) -> None:
    """Draw the densities of one coordinate."""
    (ratio,) = results.ratios(ratio, ratio)
    shown = np.zeros(0)
    for variant in _variants(results):
        density = results.density(f"density/{variant}", system, ratio)
        center, value = density[f"{quantity}_center"].values, density[f"density_{quantity}"].values
        if variant == "accurate":
            band(axes, center, value, density[f"density_{quantity}_standard_error"].values, **_LOOKS[variant])
        else:
            axes.plot(center, value, **_LOOKS[variant])
        shown = center[value > 1e-3 * value.max()]
    if results.study.reference != "none":
        density = results.density("reference/density", system, ratio)
        axes.plot(center, density[f"density_{quantity}"].values, **_LOOKS["analytic"])
    if ratio in results.solved:
        density = results.density("reference/fokker_planck_density", system, ratio)
        axes.plot(center, density[f"density_{quantity}"].values, **_LOOKS["fokker-planck"])
    axes.set_xlim(shown[0], shown[-1])
    axes.locator_params(axis="x", nbins=4)
    axes.xaxis.set_major_formatter(plain)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel(label_text("density", density[f"density_{quantity}"].attrs["units"]))


def base_densities(results: Results) -> Figure:
    """Figure 2: the base case with the absolute error below each density."""
    ratio = results.study.balanced_ratio
    results.ratios(ratio, ratio)
    figure = blank(7.2, 6.2)
    grid = figure.add_gridspec(5, 2, height_ratios=[3.0, 1.0, 0.85, 3.0, 1.0])
    for index, (system, quantity) in enumerate(COORDINATES):
        row = 0 if index < 2 else 3
        above = figure.add_subplot(grid[row, index % 2])
        below = figure.add_subplot(grid[row + 1, index % 2], sharex=above)
        _densities(results, above, ratio, system, quantity)
        letter(above, index, f"{AXIS[system, quantity][1]}, {quantity}")
        if results.study.reference != "none":
            _absolute_errors(results, below, ratio, system, quantity)
            above.tick_params(labelbottom=False)
            below.set_xlabel(AXIS[system, quantity][0])
        else:
            below.remove()
            above.set_xlabel(AXIS[system, quantity][0])
    legend = _legend(figure)
    if results.study.reference != "none":
        legend.append(Line2D([], [], color=GREEN, label="absolute error of the ensemble"))
    place(figure, legend, 2, left=0.8, across=0.85, down=0.12)
    figure.align_ylabels()
    return figure


def _absolute_errors(results: Results, axes: Axes, ratio: float, system: str, quantity: str) -> None:
    name = f"density_{quantity}"
    analytic = results.density("reference/density", system, ratio)[name].values
    for variant in _variants(results):
        density = results.density(f"density/{variant}", system, ratio)
        colour, width = (GREY, 0.6) if variant == "paper" else (GREEN, 1.1)
        center = density[f"{quantity}_center"].values
        axes.plot(center, np.abs(density[name].values - analytic), color=colour, lw=width)
        if variant == "accurate":
            level = BAND * density[f"{name}_standard_error"].values
            axes.fill_between(center, 1e-9, level, color=SKY, alpha=0.4, lw=0)
    axes.set_ylabel(f"$|\\Delta p|$\n({units_text(density[name].attrs['units'])})")
    axes.set_yscale("log")
    axes.set_ylim(3e-5 * analytic.max(), 0.5 * analytic.max())


def density_grid(results: Results, wanted: tuple[float, ...]) -> Figure:
    """Figures 3 and 4: the densities of all coordinates, one row for each frequency ratio."""
    ratios = [ratio for ratio in wanted if ratio in results.study.frequency_ratios]
    if not ratios:
        raise Missing("none of the frequency ratios was computed")
    figure = blank(9.0, 0.9 + 1.65 * len(ratios))
    panels = figure.subplots(len(ratios), 4, squeeze=False)
    for row, (ratio, line) in enumerate(zip(ratios, panels, strict=True)):
        condition = results.value("velocity_ratio", "", ratio, 0.0, "linear").value
        for column, ((system, quantity), axes) in enumerate(zip(COORDINATES, line, strict=True)):
            _densities(results, axes, ratio, system, quantity)
            if row == len(ratios) - 1:
                axes.set_xlabel(AXIS[system, quantity][0])
            if column == 0:
                letter(axes, row, rf"$\bar\omega={ratio:g}$, $C_{{DV}}={condition:.3g}$")
    place(figure, _legend(figure), 3, down=0.48)
    return figure


def _legend(figure: Figure) -> list[Artist]:
    """Return what the panels show, each once."""
    labelled = [axes.get_legend_handles_labels() for axes in figure.axes]
    return list({label: handle for found in labelled for handle, label in zip(*found, strict=True)}.values())
