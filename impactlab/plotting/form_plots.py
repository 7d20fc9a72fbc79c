"""Plots of what records find of linear forms: extremes, cycles, correlation functions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, suggestion
from impactlab.plotting.held import error_of, several, variable
from impactlab.plotting.style import (
    axes_of,
    band,
    dashes,
    label_text,
    legend,
    legend_above,
    name_text,
    number_text,
    points,
    style,
)


def _forms(data: xr.DataArray, dimension: str, names: str | Iterable[str] | None) -> Iterator[tuple[int, str]]:
    """Give the number and the name of each form that is wanted, all by default."""
    if dimension not in data.dims:
        raise InvalidInput(
            f"A plot takes all forms of a result; name those that are wanted, names=…, without {dimension}."
        )
    known = [str(name) for name in data[dimension].values]
    for name in known if names is None else several(names):
        if name not in known:
            raise InvalidInput(f"{name!r} is not in the result; {suggestion(str(name), known)}")
        yield known.index(name), name


@checked
@style()
def extremes(
    result: xr.Dataset,
    names: str | Iterable[str] | None = None,
    kind: str = "maximum",
    window: float | None = None,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draw extremes over their return time: those of windows, return levels and the levels of fitted laws.

    Dots are the extremes of all windows of the length T, at ``−T/ln P`` where P is the part of the windows with
    less. Marks with bars of two standard errors are return levels, lines with bands the fitted laws: of Gumbel, and
    dotted the generalized one.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Extremes(…)]``.
    names : str or sequence of str, optional
        Forms; all by default.
    kind : str
        "maximum", "minimum" or "magnitude".
    window : float, optional
        Length of the windows (s); by default the shortest.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no such extremes, or a name is unknown.

    Examples
    --------
    >>> record = il.Extremes({"a": "a"}, windows=(5.0,), return_times=(20.0,))
    >>> result = il.simulate(network, 20.0, realizations=64, record=record, rng=1)
    >>> axes = il.plot.extremes(result, "a")
    """
    dims = "extreme_form", "extreme_kind", "extreme_window", "extreme_return_time"
    data = variable(result, "extreme_return_level", "extremes", "il.Extremes()", dims)
    kinds, windows = (data[name].values.tolist() for name in dims[1:3])
    window = min(windows) if window is None else window
    if kind not in kinds or window not in windows:
        raise InvalidInput(f"kind is one of {kinds} and window one of {windows} (s), not {kind!r} and {window!r}.")
    axes, times = axes_of(ax), result[dims[3]].values
    for _, name in _forms(data, dims[0], names):
        place = {dims[0]: name, dims[1]: kind, dims[2]: window}
        at, values = _ranked(result, name, kind, round(window / min(windows)), window)
        (dots,) = axes.plot(at, values, ".", ms=3.0, label=name_text(name))
        color = dots.get_color()
        level = data.sel(place).values
        points(axes, times, level, error_of(result, "extreme_return_level", place), color=color, fmt="D", zorder=3)
        for row, tail in enumerate(result["extreme_tail"].values):
            of_law = {**place, "extreme_tail": tail}
            value, error = (
                result["extreme_fitted_level"].sel(of_law).values,
                error_of(result, "extreme_fitted_level", of_law),
            )
            axes.plot(times, value, color=color, ls=("-", ":")[row], lw=1.0, label=f"{name_text(name)}, fitted {tail}")
            axes.fill_between(times, value - 2.0 * error, value + 2.0 * error, color=color, alpha=0.12, linewidth=0.0)
    axes.set(xscale="log", xlabel=label_text("return time", "s"))
    axes.set_ylabel(label_text(f"{kind} in {number_text(window)} s", str(data.attrs.get("units", ""))))
    return legend_above(axes)


def _ranked(result: xr.Dataset, name: str, kind: str, length: int, window: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the extremes of windows of so many of the shortest ones, and the return times of their ranks."""
    most, least = (result[f"window_{side}"].sel(extreme_form=name).values for side in ("maximum", "minimum"))
    values = {"maximum": most, "minimum": -least, "magnitude": np.maximum(most, -least)}[kind]
    count = values.shape[1] // length
    whole = values[:, : count * length].reshape(len(values), count, length).max(axis=2)
    largest, number = -np.sort(-whole.ravel()), whole.size
    # of more than a hundred, extremes that are evenly spaced over the logarithm of their rank
    ranks = np.unique(np.rint(np.geomspace(1.0, number, min(number, 100))).astype(int))
    sign = -1.0 if kind == "minimum" else 1.0
    return -window / np.log(1.0 - (ranks - 0.5) / number), sign * largest[ranks - 1]


@checked
@style()
def cycles(result: xr.Dataset, names: str | Iterable[str] | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw how often cycles have ranges above each range, with a band of two standard errors, on logarithmic axes.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Cycles(…)]``.
    names : str or sequence of str, optional
        Forms; all by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no cycles, or a name is unknown.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.Cycles("a"), rng=1)
    >>> axes = il.plot.cycles(result)
    """
    dims = "cycle_form", "cycle_bin"
    data, axes = variable(result, "cycle_rate", "cycles", "il.Cycles()", dims), axes_of(ax)
    edges = result["cycle_range_edges"]
    for index, name in _forms(data, dims[0], names):
        rate, error = data.values[index], error_of(result, "cycle_rate", {dims[0]: name})
        above = np.cumsum(rate[::-1])[::-1]
        scatter = np.sqrt(np.cumsum(error[::-1] ** 2)[::-1])  # cycles of different ranges depend little on each other
        band(
            axes,
            edges.values[:-1],
            np.where(above > 0.0, above, np.nan),
            scatter,
            label=name_text(name),
            ls=dashes(index),
        )
    axes.set(xscale="log", yscale="log", xlabel=label_text("range", str(edges.attrs.get("units", ""))))
    axes.set_ylabel(label_text("rate of cycles above the range", "s-1"))
    return legend(axes)


@checked
@style()
def correlation(
    result: xr.Dataset,
    names: str | Iterable[str] | None = None,
    other: str | None = None,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draw correlation coefficients over the lag with a band of two standard errors.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Correlation(lags, …)]``.
    names : str or sequence of str, optional
        Forms; all by default.
    other : str, optional
        The form that follows by the lag; by default each form itself.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no correlation functions, or a name is unknown.

    Examples
    --------
    >>> record = il.Correlation(np.linspace(0.0, 2.0, 21))
    >>> result = il.simulate(network, 20.0, realizations=64, record=record, rng=1)
    >>> axes = il.plot.correlation(result)
    """
    dims, record = ("correlation_form", "correlation_other", "correlation_lag"), "il.Correlation(lags)"
    data, axes = variable(result, "correlation_coefficient", "correlation functions", record, dims), axes_of(ax)
    for index, name in _forms(data, dims[0], names):
        ((_, later),) = _forms(data, dims[0], name if other is None else other)
        place = {dims[0]: name, dims[1]: later}
        text = name_text(name if later == name else f"{name}, then {later}")
        error = error_of(result, "correlation_coefficient", place)
        band(axes, data[dims[2]].values, data.sel(place).values, error, label=text, ls=dashes(index))
    axes.axhline(0.0, color="0.7", lw=0.6, zorder=0)
    axes.set(xlabel=label_text("lag", "s"), ylabel="correlation coefficient")
    return legend(axes)
