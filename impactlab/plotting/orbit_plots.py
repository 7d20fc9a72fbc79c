"""Plots of periodic orbits and of their branches."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, suggestion
from impactlab.plotting.style import Color, axes_of, axis_text, dashes, label_text, legend_above, name_text, style
from impactlab.results.schema import BODY

_QUANTITIES = {"displacement": "m", "velocity": "m s-1", "period": "s", "energy_lost": "J", "closing_velocity": "m s-1"}
_IMPACTS = "bounce", "rest"
_MARKERS = {"fold": "s", "flip": "D", "torus": "o", "grazing": "^", "meeting": "v"}


@checked
@style()
def branch(
    result: xr.Dataset,
    name: str | None = None,
    quantity: str = "displacement",
    *,
    ax: Axes | None = None,
    color: Color | None = None,
) -> Axes:
    """Draw a branch of orbits over its parameter: solid where they are stable, dashed elsewhere, with its events.

    A curve of an event is drawn over its two parameters.

    Parameters
    ----------
    result : Dataset
        Of `continue_orbits`.
    name : str, optional
        The body, of displacements and velocities at the beginning of a period; the first one by default.
    quantity : str
        "displacement", "velocity", "period", "energy_lost" or "closing_velocity", the largest of an orbit.
    ax : Axes, optional
        Where to draw; a new figure by default.
    color : optional
        Colour of the line; black by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result is none of `continue_orbits`, or the name or the quantity is unknown.

    Examples
    --------
    >>> def struck(frequency):
    ...     return driven.replace(excitations={"a": il.Harmonic(1.0, frequency=frequency)})
    >>> branch = il.continue_orbits(struck, il.orbits(driven), {"frequency": (1.5, 2.9)})
    >>> axes = il.plot.branch(branch)
    """
    if not isinstance(result, xr.Dataset) or "bifurcation" not in result:
        raise InvalidInput("branch draws what il.continue_orbits returned.")
    if quantity not in _QUANTITIES:
        raise InvalidInput(f"quantity: {suggestion(quantity, _QUANTITIES)}")
    parameters = [str(item) for item in result.coords if result[item].dims == ("point",)]
    x, axes, color = result[parameters[0]].values, axes_of(ax), color or "black"
    axes.set_xlabel(axis_text(result, parameters[0]))
    if len(parameters) > 1:
        axes.plot(x, result[parameters[1]].values, color=color)
        axes.set_ylabel(axis_text(result, parameters[1]))
        return axes
    values, text = _values(result, name, quantity)
    stable = result["stable"].values.astype(bool)
    for number, chosen in enumerate((stable, ~stable)):
        beside = chosen | np.append(chosen[1:], False) | np.append(False, chosen[:-1])
        axes.plot(x, np.where(beside if number == 0 else chosen, values, np.nan), color=color, ls=dashes(3 * number))
    events = result["bifurcation"].values
    for event, marker in _MARKERS.items():
        if (events == event).any():
            axes.plot(x[events == event], values[events == event], ls="", marker=marker, color=color, label=event)
    axes.set_ylabel(text)
    return legend_above(axes)


def _values(result: xr.Dataset, name: str | None, quantity: str) -> tuple[np.ndarray, str]:
    """Return a quantity of all orbits, and what to call it."""
    units = _QUANTITIES[quantity]
    if quantity == "closing_velocity":
        known = result[quantity].values
        return np.nan_to_num(known, nan=0.0).max(axis=1, initial=0.0), label_text("largest closing velocity", units)
    if BODY not in result[quantity].dims:
        return result[quantity].values, label_text(quantity.replace("_", " "), units)
    body = _body(result, name)
    return result[quantity].sel({BODY: body}).values, label_text(f"{quantity} of {name_text(body)}", units)


def _body(result: xr.Dataset, name: Any) -> str:
    known = [str(item) for item in result[BODY].values]
    if name is not None and name not in known:
        raise InvalidInput(f"name: there is no body {name!r}; {suggestion(str(name), known)}")
    return known[0] if name is None else str(name)


def _with_jumps(one: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements and velocities along an orbit, with both ends of each impact, where velocities jump.

    They are continued to the impacts by the slopes beside them; where two impacts are between samples, the line breaks.
    """
    x, v = one["path_displacement"].values, one["path_velocity"].values
    impacts = np.isin(one["event_kind"].values, _IMPACTS) & np.isfinite(one["event_time"].values)
    step = float(one["period"]) / (len(x) - 1)
    times = np.sort(one["event_time"].values[impacts]) / step
    places, counts = np.unique(np.floor(times).clip(0, len(x) - 2).astype(int), return_counts=True)
    jumps = np.zeros(len(x) + 1, dtype=bool)
    jumps[places + 1] = True  # between the sample before and this one
    rise = np.where(jumps[1:-1], 0.0, np.diff(v))
    parts, begin = list[np.ndarray](), 0
    for place, count in zip(places.tolist(), counts.tolist(), strict=True):
        share = times[np.floor(times).clip(0, len(x) - 2) == place][0] - place
        at, gone = x[place] + share * step * v[place], share - 1.0
        before = v[place] + share * (rise[place - 1] if place else 0.0)
        after = v[place + 1] + gone * (rise[place + 1] if place + 1 < len(rise) else 0.0)
        ends = [[np.nan, np.nan]] if count > 1 else [[at, before], [at, after]]
        parts += [np.stack([x, v], axis=1)[begin : place + 1], np.array(ends)]
        begin = place + 1
    joined = np.concatenate([*parts, np.stack([x, v], axis=1)[begin:]])
    return joined[:, 0], joined[:, 1]


def periodic(result: xr.Dataset, name: Any, ax: Axes | None) -> Axes:
    """Draw the velocity of a body over its displacement along periodic orbits."""
    body, axes = _body(result, name), axes_of(ax)
    orbits = result if "orbit" in result.dims else result.expand_dims("orbit")
    for number in range(orbits.sizes["orbit"]):
        one = orbits.isel(orbit=number).sel({BODY: body})
        style_of = "-" if int(one["stable"]) else dashes(3)
        label = f"{float(one['period']):.4g} s{'' if int(one['stable']) else ', unstable'}"
        axes.plot(*_with_jumps(one), ls=style_of, label=label)
    axes.set_xlabel(label_text(f"displacement of {name_text(body)}", "m"))
    axes.set_ylabel(label_text(f"velocity of {name_text(body)}", "m s-1"))
    return legend_above(axes, least=2)
