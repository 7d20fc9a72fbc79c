"""How the figures of the study look."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from impactlab.plotting.style import COLORS, label_text

BLUE, ORANGE, GREEN, SKY, GREY = COLORS[0], COLORS[1], COLORS[2], COLORS[5], "#767676"

AXIS = {
    ("one", "displacement"): (label_text("$x_1$", "m"), "System 1"),
    ("one", "velocity"): (label_text("$v_1$", "m s-1"), "System 1"),
    ("two", "displacement"): (label_text("$x_2$", "m"), "System 2"),
    ("two", "velocity"): (label_text("$v_2$", "m s-1"), "System 2"),
}


def grid(
    figure: Figure,
    heights: Sequence[float],
    columns: int,
    *,
    left: float = 0.65,
    right: float = 0.08,
    bottom: float,
    top: float = 0.25,
    across: float = 0.6,
    down: float,
) -> GridSpec:
    """Place panels by margins and distances in inches, and rows by heights relative to each other.

    Matplotlib could find these distances, but draws all panels twice more for it.
    """
    figure.set_layout_engine("none")
    width, height = figure.get_size_inches()
    panel = (width - left - right - (columns - 1) * across) / columns
    row = (height - top - bottom - (len(heights) - 1) * down) / len(heights)
    return figure.add_gridspec(
        len(heights), columns, height_ratios=heights, wspace=across / panel, hspace=down / row,
        left=left / width, right=1.0 - right / width, bottom=bottom / height, top=1.0 - top / height,
    )  # fmt: skip


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
