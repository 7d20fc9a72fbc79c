"""Plots of diagrams: section points over a parameter, maps of periods, basins of attraction."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, to_rgb

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, suggestion
from impactlab.plotting.style import COLORS, Color, axes_of, axis_text, label_text, legend_above, name_text, style
from impactlab.results.schema import BODY

MOST_PERIODS_SHOWN = 8
"""Periods that have colours of their own; longer ones share one."""

ACROSS, SIZES = 280.0, (1.4, 5.0)
"""Width of a diagram, and sizes of its points (pt): those of few values are larger."""

_UNITS = {"displacement": "m", "velocity": "m s-1"}


@checked
@style()
def bifurcation(
    result: xr.Dataset,
    name: str | None = None,
    quantity: str = "displacement",
    *,
    ax: Axes | None = None,
    color: Color | None = None,
    label: str | None = None,
) -> Axes:
    """Draw the points of a bifurcation diagram over its parameter, of all starts.

    Parameters
    ----------
    result : Dataset
        Of `bifurcation` over one parameter.
    name : str, optional
        The body; the first one by default.
    quantity : str
        "displacement" or "velocity".
    ax : Axes, optional
        Where to draw; a new figure by default. Diagrams that are followed up and down are drawn on the same axes.
    color : optional
        Colour of the points; black by default.
    label : str, optional
        For a legend.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result is none of `bifurcation`, or the name or the quantity is unknown.

    Examples
    --------
    >>> def struck(frequency):
    ...     return driven.replace(excitations={"a": il.Harmonic(1.0, frequency=frequency)})
    >>> diagram = il.bifurcation(struck, {"frequency": [2.2, 2.5, 2.8]})
    >>> axes = il.plot.bifurcation(diagram, "a", "velocity")
    """
    _check(result, "period", "il.bifurcation")
    if quantity not in _UNITS:
        raise InvalidInput(f"quantity: {suggestion(quantity, _UNITS)}")
    if quantity not in result:
        raise InvalidInput("The result has two parameters, and so no points; use il.plot.period_map.")
    known = [str(item) for item in result[BODY].values]
    body = known[0] if name is None else name
    if body not in known:
        raise InvalidInput(f"name: there is no oscillator {body!r}; {suggestion(str(body), known)}")
    parameter = str(result["period"].dims[0])
    values = result[quantity].sel({BODY: body}).transpose(parameter, "start", "point").values
    if result[parameter].dtype.kind not in "fi":
        raise InvalidInput(f"The values of {parameter!r} are no numbers.")
    places = np.broadcast_to(result[parameter].values[:, None, None], values.shape)
    axes = axes_of(ax)
    size = float(np.clip(ACROSS / len(places), *SIZES))
    look: dict[str, Any] = {"ls": "", "marker": ".", "ms": size, "mew": 0.0, "color": color or "black"}
    axes.plot(places.ravel(), values.ravel(), label=label, rasterized=True, **look)
    axes.set_xlabel(axis_text(result, parameter))
    axes.set_ylabel(label_text(f"{quantity} of {name_text(body)}", _UNITS[quantity]))
    return legend_above(axes)


@checked
@style()
def period_map(result: xr.Dataset, *, start: int = 0, ax: Axes | None = None) -> Axes:
    """Draw the periods of the motions over two parameters; motions that do not repeat are black.

    Parameters
    ----------
    result : Dataset
        Of `bifurcation` over two parameters.
    start : int
        Which start.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result is none of `bifurcation` over two parameters.

    Examples
    --------
    >>> def struck(frequency, amplitude):
    ...     return driven.replace(excitations={"a": il.Harmonic(amplitude, frequency=frequency)})
    >>> over = {"frequency": np.linspace(2.2, 3.0, 4), "amplitude": np.linspace(0.5, 1.0, 4)}
    >>> plane = il.bifurcation(struck, over)
    >>> axes = il.plot.period_map(plane)
    """
    _check(result, "period", "il.bifurcation")
    if result["period"].ndim != 3:
        raise InvalidInput("A map of periods takes the result of il.bifurcation over two parameters.")
    if start not in result["start"]:
        raise InvalidInput(f"start: there is no start {start!r}; there are {result.sizes['start']}.")
    data = result["period"].sel(start=start)
    first, second = (str(name) for name in data.dims)
    values = data.values.T.astype(float)
    codes = np.where(values < 0.0, np.nan, np.where(values == 0.0, 0.0, values.clip(max=MOST_PERIODS_SHOWN + 1)))
    shown = sorted(set(codes[np.isfinite(codes)].astype(int).tolist()))
    texts = {0: "none", MOST_PERIODS_SHOWN + 1: f"over {MOST_PERIODS_SHOWN}"}
    axes = axes_of(ax, (4.8, 3.6))
    colours = ["black", *_light(MOST_PERIODS_SHOWN), "0.6"]
    _mesh(axes, data, codes, shown, [colours[code] for code in shown], [texts.get(code, str(code)) for code in shown],
          "period")  # fmt: skip
    axes.set_xlabel(axis_text(result, first))
    axes.set_ylabel(axis_text(result, second))
    return axes


@checked
@style()
def basins(result: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw basins of attraction, and the points of the attractors in their plane.

    Starts at which hard bodies overlap, and those whose attractor was not found, are white.

    Parameters
    ----------
    result : Dataset
        Of `basins` over two quantities.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result is none of `basins` over two quantities.

    Examples
    --------
    >>> grid = {"x": np.linspace(-2.0, 0.0, 8), "v": np.linspace(-2.0, 2.0, 8)}
    >>> found = il.basins(driven, over=("displacement:a", "velocity:a"), grid=grid)
    >>> axes = il.plot.basins(found)
    """
    _check(result, "label", "il.basins")
    data = result["label"]
    if data.ndim != 2:
        raise InvalidInput("il.plot.basins takes the result of il.basins over two quantities.")
    labels = np.where(data.values.T >= 0, data.values.T, np.nan).astype(float)
    shown = sorted(set(labels[np.isfinite(labels)].astype(int).tolist()))
    axes = axes_of(ax, (4.8, 3.6))
    colours = [(*COLORS, "0.6")[min(code, len(COLORS))] for code in shown]
    texts = [f"{code} (period {period})" if period else f"{code} (none)" for code, period in _periods(result, shown)]
    _mesh(axes, data, labels, shown, [_pale(colour) for colour in colours], texts, "attractor")
    over = [data[name].attrs.get("quantity", "") for name in data.dims]
    if all(":" in item for item in over):
        for code, colour in zip(shown, colours, strict=True):
            one = result.isel(attractor=code)
            x, y = (one[item.partition(":")[0]].sel({BODY: item.partition(":")[2]}).values for item in over)
            axes.plot(x, y, ls="", marker="o", ms=4.0, mfc=colour, mec="black", mew=0.5)
    axes.set_xlim(float(data[data.dims[0]].min()), float(data[data.dims[0]].max()))
    axes.set_ylim(float(data[data.dims[1]].min()), float(data[data.dims[1]].max()))
    axes.set_xlabel(axis_text(result, str(data.dims[0])))
    axes.set_ylabel(axis_text(result, str(data.dims[1])))
    return axes


def _check(result: Any, variable: str, maker: str) -> None:
    """Refuse what is no result of a question."""
    beside = {"period": "status", "label": "fraction"}
    if not isinstance(result, xr.Dataset) or variable not in result or beside[variable] not in result:
        raise InvalidInput(f"The plot takes the dataset that {maker} returned.")


def _periods(result: xr.Dataset, shown: list[int]) -> list[tuple[int, int]]:
    return [(code, int(result["period"][code])) for code in shown]


def _mesh(
    axes: Axes, data: xr.DataArray, codes: np.ndarray, shown: list[int], colours: list[Any], texts: list[str],
    title: str,
) -> None:  # fmt: skip
    """Draw codes in colours of their own, with a bar that names them."""
    places = np.full(codes.shape, np.nan)
    for place, code in enumerate(shown):
        places[codes == code] = place
    norm = BoundaryNorm(np.arange(len(shown) + 1) - 0.5, len(shown))
    x, y = (_edges(data[name]) for name in data.dims)
    order = [np.argsort(data[name].values) for name in data.dims]
    sorted_places = np.ma.masked_invalid(places[np.ix_(order[1], order[0])])
    mesh = axes.pcolormesh(x, y, sorted_places, cmap=ListedColormap(colours), norm=norm, rasterized=True)
    root = axes.get_figure(root=True)
    assert root is not None
    bar = root.colorbar(mesh, ax=axes, label=title, ticks=range(len(shown)))
    bar.ax.set_yticklabels(texts)
    bar.ax.tick_params(length=0)


def _edges(values: xr.DataArray) -> np.ndarray:
    """Return the edges of cells around values in order."""
    if values.dtype.kind not in "fi":
        raise InvalidInput(f"The values of {values.name!r} are no numbers.")
    places = np.sort(values.values.astype(float))
    if len(places) == 1:
        return np.asarray(places + np.array([-0.5, 0.5]))
    middle = 0.5 * (places[1:] + places[:-1])
    return np.concatenate([[1.5 * places[0] - 0.5 * places[1]], middle, [1.5 * places[-1] - 0.5 * places[-2]]])


def _light(count: int) -> list[Any]:
    """Return colours from dark to light, whose order is seen with every kind of colour vision."""
    return [colormaps["cividis_r"](0.05 + 0.9 * place / (count - 1)) for place in range(count)]


def _pale(colour: Any) -> Any:
    """Return a colour mixed with white."""
    return tuple(0.45 + 0.55 * part for part in to_rgb(colour))
