"""Plots of fragilities: probabilities and laws over the scale of a motion, and the curves of all records."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, known_name
from impactlab.plotting.style import COLORS, axes_of, label_text, legend_above, style


@checked
@style()
def fragility(result: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the probability of each limit state over the scale, with its band, and the lognormal law as a line.

    Parameters
    ----------
    result : Dataset
        Of `fragility`.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Examples
    --------
    >>> risk = il.fragility(towers, records, scales=[0.5, 1.0, 2.0], limit={"left": 0.05})
    >>> axes = il.plot.fragility(risk)
    """
    _check(result, "fitted_probability")
    axes, scales = axes_of(ax), result["scale"].values
    for place, state in enumerate(result["state"].values):
        own, color = result.isel(state=place), COLORS[place % len(COLORS)]
        fraction = own["probability"].values
        ends = np.abs(np.stack([own["probability_low"].values, own["probability_high"].values]) - fraction)
        axes.errorbar(scales, fraction, ends, ls="", marker="o", ms=3.0, color=color, elinewidth=0.8)
        axes.plot(scales, own["fitted_probability"].values, color=color, label=str(state))
        low, high = own["fitted_probability_low"].values, own["fitted_probability_high"].values
        axes.fill_between(scales, low, high, color=color, alpha=0.2, lw=0.0)
    axes.set_xlabel(_scale_text(result))
    axes.set_ylabel("probability of exceeding the limit")
    axes.set_ylim(-0.02, 1.02)
    return legend_above(axes)


@checked
@style()
def incremental(result: xr.Dataset, demand: str | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the curves of an incremental dynamic analysis: the peak of a demand over the scale, of each record.

    Parameters
    ----------
    result : Dataset
        Of `fragility`.
    demand : str, optional
        The first one by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Examples
    --------
    >>> risk = il.fragility(towers, records, scales=[0.5, 1.0, 2.0], limit={"left": 0.05})
    >>> axes = il.plot.incremental(risk)
    """
    _check(result, "peak_quantile")
    known = [str(item) for item in result["demand"].values]
    name = known[0] if demand is None else demand
    known_name("demand", name, known)
    axes, scales, own = axes_of(ax), result["scale"].values, result.sel(demand=name)
    axes.plot(own["peak"].values.T, scales, color="0.75", lw=0.5, zorder=1.0)
    for share, line in zip(own["quantile"].values, ("--", "-", "--"), strict=True):
        text = f"{100.0 * share:g} % of the records"
        axes.plot(own["peak_quantile"].sel(quantile=share).values, scales, line, color=COLORS[0], label=text)
    for level in result["level"].values[result["state_demand"].values == name]:
        axes.axvline(level, color=COLORS[1], lw=0.8, ls=":")
    axes.set_xlabel(label_text(f"peak of {name}", str(own["demand_units"].item())))
    axes.set_ylabel(_scale_text(result))
    return legend_above(axes)


def _check(result: xr.Dataset, name: str) -> None:
    if not isinstance(result, xr.Dataset) or name not in result:
        raise InvalidInput("This is no result that il.fragility returned.")


def _scale_text(result: xr.Dataset) -> str:
    attributes = result["scale"].attrs
    return label_text(str(attributes.get("long_name", "scale")), str(attributes.get("units", "1")))
