"""Plots of energy flows, and of densities of quantities of one's own."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked
from impactlab.plotting.held import error_of, known_dataset
from impactlab.plotting.style import COLORS, axes_of, band, label_text, legend, name_text, style

GROUPS = (
    ("power_in", "source", "given", 0),
    ("power_dissipated", "oscillator", "lost", 1),
    ("contact_power_dissipated", "contact", "lost", 1),
    ("coupling_power_dissipated", "coupling", "lost", 1),
    ("contact_power_carried", "contact", "carried", 2),
    ("coupling_power_carried", "coupling", "carried", 2),
)
"""Variables of energy flows, their dimensions, names for a legend, and colours."""


@checked
@style()
def powers(result: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the mean powers that sources give, that links carry, and what is lost where, with two standard errors.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=il.EnergyFlows()``.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no energy flows of one network.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.EnergyFlows(), rng=1)
    >>> axes = il.plot.powers(result)
    """
    data = known_dataset(result)
    found = [group for group in GROUPS if group[0] in data]
    if not found or any(data[name].dims != (dimension,) for name, dimension, *_ in found):
        raise InvalidInput("The result holds no energy flows of one network: simulate with record=il.EnergyFlows().")
    axes, names, drawn = axes_of(ax), list[str](), set[str]()
    for name, dimension, text, color in found:
        places = len(names) + np.arange(data.sizes[dimension])
        error = 2.0 * error_of(data, name, {})
        label = None if text in drawn else text
        axes.barh(places, data[name].values, xerr=error, color=COLORS[color], label=label)
        names += [name_text(f"{text}: {item}") for item in data[dimension].values]
        drawn.add(text)
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set(xlabel=label_text("mean power", "W"), yticks=np.arange(len(names)), yticklabels=names)
    axes.invert_yaxis()
    return legend(axes)


@checked
@style()
def observable(result: xr.Dataset, name: str, *, ax: Axes | None = None) -> Axes:
    """Draw the density of a quantity of one's own at each place, with bands of two standard errors.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=il.Observable(name, …)``.
    name : str
        Name of the quantity.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result does not hold the quantity.

    Examples
    --------
    >>> def kinetic(velocity):
    ...     return 0.5 * velocity * velocity
    >>> record = il.Observable("kinetic energy", kinetic, per="oscillator", units="J")
    >>> result = il.simulate(network, 20.0, realizations=64, record=record, rng=1)
    >>> axes = il.plot.observable(result, "kinetic energy")
    """
    data, variable = known_dataset(result), name.replace(" ", "_").replace("-", "_")
    density, edges = f"density_{variable}", f"{variable}_edges"
    if density not in data or data[density].ndim > 2:
        raise InvalidInput(f"The result holds no density of {name!r}: simulate with record=il.Observable({name!r}, …).")
    axes, ends = axes_of(ax), np.atleast_2d(data[edges].values)
    rows, errors = (np.atleast_2d(item) for item in (data[density].values, error_of(data, density, {})))
    labels = data[data[density].dims[0]].values if data[density].ndim == 2 else [None]
    for row, (label, own, error) in enumerate(zip(labels, rows, errors, strict=True)):
        middle = 0.5 * (ends[row, 1:] + ends[row, :-1])
        text = None if label is None else name_text(label)
        band(axes, middle, own, error, label=text, color=COLORS[row % len(COLORS)])
    units = str(data[edges].attrs.get("units", "1"))
    axes.set(xlabel=label_text(name, units), ylabel="density")
    return legend(axes)
