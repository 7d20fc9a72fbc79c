"""How the figures of the study look."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from impactlab.plotting.style import COLORS, label_text

BLUE, ORANGE, GREEN, SKY, GREY = COLORS[0], COLORS[1], COLORS[2], COLORS[5], "#767676"

AXIS = {
    ("one", "displacement"): (label_text("$x_1$", "m"), "System 1"),
    ("one", "velocity"): (label_text("$v_1$", "m s-1"), "System 1"),
    ("two", "displacement"): (label_text("$x_2$", "m"), "System 2"),
    ("two", "velocity"): (label_text("$v_2$", "m s-1"), "System 2"),
}


_PLACES = "left", "bottom", "right", "top", "wspace", "hspace"


def blank(width: float, height: float) -> Figure:
    """Return a figure for panels that :func:`place` places; sizes in inches."""
    return Figure(figsize=(width, height), layout="none")  # type: ignore[arg-type]  # its stubs leave that out


def place(
    figure: Figure,
    legend: Sequence[Artist],
    columns: int,
    *,
    left: float = 0.7,
    across: float = 0.6,
    down: float = 0.0,
) -> None:
    """Place the panels of a blank figure above a legend in columns, by margins and distances in inches.

    Matplotlib could find these distances, but draws all panels twice more for it.
    """
    figure.legend(handles=list(legend), loc="lower center", ncols=columns)
    grid, size = figure.axes[0].get_gridspec(), figure.get_size_inches()
    assert grid is not None
    low = left, 0.62 + 0.17 * math.ceil(len(legend) / columns)  # below: ticks, label, and rows of the legend
    high = size - (0.1, 0.27)
    shape, between = np.array([grid.ncols, grid.nrows]), np.array([across, down])
    spaces = between * shape / (high - low - (shape - 1) * between)  # in panels, as Matplotlib counts
    figure.subplots_adjust(**dict(zip(_PLACES, (*low / size, *high / size, *spaces), strict=True)))


def plain(value: float, _: float = 0.0) -> str:
    """Return the label of a tick with no more digits than it needs, so that labels do not touch."""
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")


def ratio_axis(axes: Axes, ratios: Iterable[float]) -> None:
    """Give an axis of frequency ratios a logarithmic scale with a tick at each."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(_readable(list(ratios))))
    axes.xaxis.set_major_formatter(FuncFormatter(plain))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel(r"frequency ratio $\bar\omega=\omega_1/\omega_2$")


def plain_log_axis(axes: Axes) -> None:
    """Give the values a logarithmic scale with ticks at 1, 2 and 5, written as plain numbers."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(plain))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _readable(ratios: list[float]) -> list[float]:
    """Leave out ticks that would touch the one before."""
    shown: list[float] = []
    for ratio in ratios:
        if not shown or ratio >= 1.45 * shown[-1]:
            shown.append(ratio)
    return shown


def letter(axes: Axes, index: int, title: str) -> None:
    """Set a title with the panel's letter, at a height that Matplotlib need not find: a fifth of a figure's time."""
    axes.set_title(f"({'abcdefghijklmnopqrstuvwxyz'[index]}) {title}", loc="left", y=1.0)
