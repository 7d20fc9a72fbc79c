"""The style of figures: colours, units and numbers as text, values with their errors."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from typing import Annotated, Any

import matplotlib
import numpy as np
import xarray as xr
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import is_color_like
from matplotlib.figure import Figure

from impactlab.errors import InvalidInput
from impactlab.inputs import shown

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Colours that can be told apart with every kind of colour vision (Okabe and Ito)."""

DASHES: tuple[Any, ...] = (
    "-",
    (0, (9, 1.5)),
    (0, (7, 1.5, 1.5, 1.5)),
    (0, (1.5, 1.2)),
    (0, (7, 1.5, 1.5, 1.5, 1.5, 1.5)),
)
"""Styles of lines that can be told apart without colours, in the order of the lines."""


_LETTER, _HANDLE = 0.06, 0.5  # width of a letter of a legend, and of the rest of an entry, in inches


def dashes(index: int) -> Any:
    """Return the style of a line."""
    return DASHES[index % len(DASHES)]


_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "axes.prop_cycle": cycler(color=COLORS),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.0,
    "errorbar.capsize": 2.0,
    "hatch.linewidth": 0.6,
    "mathtext.fontset": "dejavusans",
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",
}


@contextlib.contextmanager
def style() -> Iterator[None]:
    """Draw in the style of impactlab's figures while this context is active.

    Nothing else is put back at its end, as `matplotlib.rc_context` does: the first figure of pyplot in a notebook
    switches pictures on by a parameter, ``interactive``.
    """
    before = {name: matplotlib.rcParams[name] for name in _STYLE}
    matplotlib.rcParams.update(_STYLE)
    try:
        yield
    finally:
        matplotlib.rcParams.update(before)


def svg(figure: Figure) -> bytes:
    """Return a figure as SVG, drawn once: `savefig` would draw all of it twice, first for the layout alone.

    The same figure gives the same bytes. Letters are outlines, so that they look the same everywhere.
    """
    buffer, before = io.BytesIO(), figure.canvas
    try:
        with matplotlib.rc_context({"svg.hashsalt": "impactlab", "svg.fonttype": "path"}):
            FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})  # type: ignore[no-untyped-call]
    finally:
        figure.set_canvas(before)
    return buffer.getvalue()


def save_figure(figure: Figure, path: str) -> None:
    """Write a figure to a file, of the kind that the end of its name tells."""
    known = figure.canvas.get_supported_filetypes()
    if path.rpartition(".")[2].lower() not in known:
        raise InvalidInput(f"{path} must end in .svg, .pdf, .png or another of {', '.join(sorted(known))}.")
    with style():
        figure.savefig(path)


def units_text(units: str) -> str:
    """Return units in the notation of UDUNITS as text with raised exponents."""
    return re.sub(r"(?<=[A-Za-z])(-?\d+(?:/\d+)?)", r"$^{\1}$", units)


def number_text(value: float) -> str:
    """Return a number with three digits, as a power of ten where that is shorter."""
    text = f"{value:.3g}"
    if "e" not in text:
        return text.replace("-", "\N{MINUS SIGN}")
    mantissa, exponent = text.split("e")
    factor = "" if mantissa == "1" else rf"{mantissa} \times "
    return rf"${factor}10^{{{int(exponent)}}}$"


def label_text(name: str, units: str) -> str:
    """Return the label of an axis: a quantity with its units in the notation of UDUNITS."""
    return name if units in ("", "1") else f"{name} ({units_text(units)})"


def axis_text(result: xr.Dataset, name: str) -> str:
    """Return the label of an axis of a dataset."""
    attrs = result[name].attrs
    return label_text(str(attrs.get("long_name", name.replace("_", " "))), str(attrs.get("units", "")))


def name_text(name: object) -> str:
    """Return the name of a member as text in which no sign of a formula is left."""
    return str(name).replace("$", r"\$")


def color_of(place: str, value: Any) -> Any:
    """Return a colour as Matplotlib knows it, or refuse it."""
    if not is_color_like(value):
        raise InvalidInput(f"{place} must be a colour such as 'C1' or (0.8, 0.4, 0.0), not {shown(value)}.")
    return value


Color = Annotated[Any, color_of]
"""A colour."""


def axes_of(ax: Axes | None, size: tuple[float, float] = (4.8, 3.2)) -> Axes:
    """Return the axes that were given, or those of a new figure of pyplot."""
    if ax is None:
        from matplotlib import pyplot

        return pyplot.subplots(figsize=size)[1]
    return ax


def legend(axes: Axes, most: int = 8) -> Axes:
    """Add a legend if it helps: there is something to tell apart, and not too much."""
    if 1 < len(axes.get_legend_handles_labels()[1]) <= most:
        axes.legend()
    return axes


def legend_above(axes: Axes, least: int = 1, dots: float = 1.0) -> Axes:
    """Add a legend above the axes, where data leave no room for it, if it has some entries and not too many.

    Its dots are larger than those of the data by a factor.
    """
    labels = axes.get_legend_handles_labels()[1]
    if least <= len(labels) <= 8:
        root = axes.get_figure(root=True)
        assert root is not None
        room, widths = axes.get_window_extent().width / root.dpi, [_HANDLE + _LETTER * len(label) for label in labels]
        columns = len(labels)
        while columns > 1 and sum(map(max, np.array_split(widths, columns))) > room:
            columns -= 1
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=columns, markerscale=dots)
    return axes


def band(axes: Axes, x: Any, value: Any, error: Any, *, label: str | None = None, **line: Any) -> None:
    """Draw a curve with a band of two standard errors on both sides.

    Parameters
    ----------
    axes : Axes
    x, value, error : array_like
        Abscissa, value and standard error.
    label : str, optional
        For the legend.
    **line
        What `Axes.plot` takes, such as `color`.
    """
    x, value, error = (np.asarray(item, dtype=float) for item in (x, value, error))
    (drawn,) = axes.plot(x, value, label=label, **line)
    axes.fill_between(x, value - 2.0 * error, value + 2.0 * error, color=drawn.get_color(), alpha=0.25, linewidth=0.0)


def points(axes: Axes, x: Any, value: Any, error: Any, *, label: str | None = None, **line: Any) -> None:
    """Draw points with bars of two standard errors on both sides; parameters as of :func:`band`."""
    drawn: dict[str, Any] = {"fmt": "o", "linewidth": 1.0} | line
    axes.errorbar(x, value, yerr=2.0 * np.asarray(error, dtype=float), label=label, **drawn)
