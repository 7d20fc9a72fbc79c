"""Plots of impacts: over time or a parameter, and their distributions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, suggestion
from impactlab.plotting.held import error_of, known_dataset, law_with, rows, several, variable
from impactlab.plotting.style import axes_of, band, dashes, label_text, legend, legend_above, name_text, style


class ClosingVelocities(Protocol):
    """A law that knows the velocities at which contacts close, such as an `ExactReference`."""

    def onset_velocity_density(self, contact: str, grid: Any) -> np.ndarray: ...


@checked
@style()
def impacts(
    result: xr.Dataset,
    names: str | Iterable[str] | None = None,
    quantity: str = "closing_velocity",
    *,
    reference: ClosingVelocities | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw a quantity of all impacts over time, or over the parameter of a sweep, or its distribution.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Impacts()]``, or a sweep over one parameter with it: impacts are dots. Or
        with ``record=[il.Impacts(bins=…)]``: densities have bands of two standard errors.
    names : str or sequence of str, optional
        Contacts; all that were recorded by default.
    quantity : str
        "closing_velocity", "leaving_velocity", "duration", "impulse", "largest_force" or "lost_energy".
    reference : ExactReference, optional
        The law of the network, whose density of closing velocities, Rayleigh's, is drawn as a dashed line.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no such quantity of impacts, or a name is unknown.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.Impacts(bins=40), rng=1)
    >>> axes = il.plot.impacts(result, "stop")
    """
    if f"impact_{quantity}" in known_dataset(result):
        if reference is not None:
            raise InvalidInput("A law is drawn beside a distribution: record il.Impacts(bins=…), or give no law.")
        return _dots(known_dataset(result), names, quantity, axes_of(ax))
    record = "il.Impacts(bins=…)" if reference is not None else "il.Impacts()"
    data = variable(result, f"density_{quantity}", "impacts with this quantity", record, [f"{quantity}_bin"])
    if reference is not None and quantity != "closing_velocity":
        raise InvalidInput(f"reference knows the closing_velocity of impacts, not their {quantity}.")
    axes, result = axes_of(ax), known_dataset(result)
    for index, (name, place) in enumerate(rows(data, names)):
        center, error = result[f"{quantity}_center"].sel(place).values, error_of(result, f"density_{quantity}", place)
        band(axes, center, data.sel(place).values, error, label=name_text(name), ls=dashes(index))
        if reference is not None:
            exact = law_with("onset_velocity_density", reference)(name, center)
            axes.plot(center, exact, color="black", ls=(0, (4, 2.5)), lw=1.0)
    if reference is not None:
        axes.lines[-1].set_label("exact")
    units = str(result[f"{quantity}_center"].attrs["units"])
    axes.set_xlabel(label_text(quantity.replace("_", " "), units))
    axes.set_ylabel(label_text("probability density", str(data.attrs["units"])))
    axes.set_ylim(bottom=0.0)
    return legend(axes)


def _dots(result: xr.Dataset, names: str | Iterable[str] | None, quantity: str, axes: Axes) -> Axes:
    """Draw each impact of a run over time, or of a sweep over its parameter."""
    data, contact = result[f"impact_{quantity}"], result["impact_contact"]
    further = [str(item) for item in data.dims if item != "impact"]
    if len(further) > 1:
        example = ", ".join(f"{item}=…" for item in further[1:])
        raise InvalidInput(f"The result is one over {', '.join(further)}: select a point of it, result.sel({example}).")
    over = result[further[0]] if further else result["impact_time"]
    places = np.broadcast_to(over.values[:, None] if further else over.values, data.shape)
    recorded = [name for name in dict.fromkeys(result["impact_series_contact"].values.ravel().tolist()) if name]
    for name in recorded if names is None else several(names):
        if name not in recorded:
            raise InvalidInput(f"{name!r} is not in the result; {suggestion(str(name), recorded)}")
        own = (contact.values == name) & np.isfinite(data.values)
        axes.plot(places[own], data.values[own], ".", ms=2.5, mew=0.0, label=name_text(name))
    text, units = (further[0], str(over.attrs.get("units", ""))) if further else ("time", "s")
    axes.set_xlabel(label_text(text, units))
    axes.set_ylabel(label_text(quantity.replace("_", " "), str(data.attrs["units"])))
    return legend_above(axes, least=2, dots=3.0)
