"""Plots of statistics: along the axis of a sweep, and along a chain."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any, Protocol

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, suggestion
from impactlab.plotting.held import LABELS, error_of, known_dataset, several
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
    units_text,
)
from impactlab.results.measured import measured_text
from impactlab.results.schema import variables

NAMED = 12
"""Places along an axis whose names are written."""

FEW = 3
"""Places along an axis, or labels of a statistic, up to which values are written."""


class Statistics(Protocol):
    """A law that knows statistics, such as `ExactReference`."""

    def statistics(self) -> xr.Dataset: ...


@checked
@style()
def sweep(
    result: xr.Dataset,
    statistic: str,
    names: str | Iterable[str] | None = None,
    *,
    along: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw a statistic along one axis of a sweep, with bands of two standard errors.

    There is a line for each body or contact and each value of the other axes, and where the sweep has exact values a
    dashed one beside it. Points that were refused are left out. The axis has units where the sweep was given its values
    with them, ``{"clearance": xr.DataArray(values, attrs={"units": "m"})}``.

    Parameters
    ----------
    result : Dataset
        Result of `sweep`, or a selection from the result.
    statistic : str
        Name of the variable, such as "contact_ratio".
    names : str or sequence of str, optional
        Bodies, contacts or points; all by default.
    along : str, optional
        The axis; the first one by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If there is no such statistic, name or axis.

    Examples
    --------
    >>> def at(clearance):
    ...     stop = il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=clearance)
    ...     return network.replace(contacts={"stop": stop})
    >>> found = il.sweep(at, {"clearance": [0.1, 0.2]}, duration=20.0, realizations=64, rng=1)
    >>> axes = il.plot.sweep(found, "contact_ratio")
    >>> axes.get_xlabel()
    'clearance'
    """
    data = _statistic(result, statistic)
    own = [str(name) for name in data.dims if name not in LABELS]
    if not own:
        raise InvalidInput("The result is one simulation; il.plot.sweep takes what il.sweep returned.")
    axis = own[0] if along is None else along
    if axis not in own:
        raise InvalidInput(f"along: {suggestion(axis, own)}")
    if data[axis].dtype.kind in "fiu":
        result = result.sortby(axis)
        data = result[statistic]
    axes = axes_of(ax)
    x = _positions(axes, data[axis])
    others = [name for name in own if name != axis]
    for index, (label, place) in enumerate(_lines(data, others, names)):
        look: dict[str, Any] = {"ls": dashes(index), "marker": "os^vD"[index % 5], "ms": 3.5}
        band(axes, x, data.sel(place).values, error_of(result, statistic, place), label=label, **look)
        if f"{statistic}_exact" in result:
            exact = result[f"{statistic}_exact"].sel(place).values
            axes.plot(x, exact, color="black", ls=(0, (4, 2.5)), lw=1.0)
    if f"{statistic}_exact" in result:
        axes.lines[-1].set_label("exact")
    attrs = data[axis].attrs
    axes.set_xlabel(label_text(str(attrs.get("long_name", axis.replace("_", " "))), str(attrs.get("units", ""))))
    axes.set_ylabel(_label(data, names))
    return legend(axes)


@checked
@style()
def profile(
    result: xr.Dataset, statistic: str, *, reference: xr.Dataset | Statistics | None = None, ax: Axes | None = None
) -> Axes:
    """Draw a statistic of all bodies, contacts or points, in the order of the network, as along a chain.

    Parameters
    ----------
    result : Dataset
        What `simulate` returned.
    statistic : str
        Name of the variable, such as "mean_square_velocity".
    reference : ExactReference, FokkerPlanckReference or Dataset, optional
        A law, or its statistics, or another result, drawn as a dashed line.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If there is no such statistic, or the result is a sweep.

    Examples
    --------
    >>> body = il.LinearOscillator(damping=0.5, stiffness=10.0)
    >>> row = il.chain(4, body, il.HertzContact(1e4), excitation=il.WhiteNoise(1.0))
    >>> result = il.simulate(row, 20.0, realizations=64, rng=1)
    >>> axes = il.plot.profile(result, "mean_square_velocity")
    """
    data = _statistic(result, statistic)
    if len(data.dims) != 1 or data.dims[0] not in LABELS:
        raise InvalidInput(f"{statistic} has the dimensions {data.dims}; select one simulation.")
    dimension = str(data.dims[0])
    axes, x = axes_of(ax), np.arange(1, data.size + 1)
    error = error_of(result, statistic, {})
    if data.size > NAMED:
        band(axes, x, data.values, error, label="simulated")
        axes.set_xlabel(f"number of the {dimension}")
    else:
        points(axes, x, data.values, error, label="simulated")
        beside: dict[str, Any] = {"xytext": (9.0, 0.0), "textcoords": "offset points", "va": "center", "fontsize": 8.0}
        for place, value, spread in zip(x, data.values, error, strict=True) if data.size <= FEW else ():
            axes.annotate(measured_text(value, spread), (place, value), **beside)
        if data.size == 1 and data.values[0] > 0.0:
            axes.set_ylim(bottom=0.0)
        axes.set_xticks(x, [name_text(name) for name in data[dimension].values])
        axes.set_xlim(0.5, data.size + 0.5)
        axes.set_xlabel(dimension)
    if reference is not None:
        known = reference if isinstance(reference, xr.Dataset) else reference.statistics()
        exact = _statistic(known, statistic).reindex({dimension: data[dimension]})
        look: dict[str, Any] = (
            {"ls": (0, (4, 2.5)), "lw": 1.0} if data.size > NAMED else {"ls": "", "marker": "_", "ms": 12}
        )
        axes.plot(x, exact.values, color="black", label="reference", **look)
        legend_above(axes)
    axes.set_ylabel(_label(data))
    return axes


def _statistic(result: Any, name: str) -> xr.DataArray:
    dataset = known_dataset(result)
    if name not in dataset:
        if name in variables():
            raise InvalidInput(
                f"The result holds no {name!r}: the network has nothing that could, or statistics= named others only."
            )
        known = [item for item in variables() if item in dataset]
        raise InvalidInput(f"The result holds no {name!r}; {suggestion(name, known)}")
    return dataset[name]


def _label(data: xr.DataArray, names: str | Iterable[str] | None = None) -> str:
    """Return the label of an axis, with the name of the body, contact or point if one was chosen."""
    title = str(data.attrs.get("long_name", data.name))
    selected = [data[name].item() for name in LABELS if name in data.coords and name not in data.dims]
    chosen = selected if names is None else several(names)
    return label_text(
        f"{title} of {name_text(chosen[0])}" if len(chosen) == 1 else title, str(data.attrs.get("units", ""))
    )


def _lines(
    data: xr.DataArray, others: list[str], names: str | Iterable[str] | None
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Give the label of each line, which tells it from the others, and what selects it."""
    choices: dict[str, list[Any]] = {}
    for dimension in LABELS:
        if dimension in data.dims:
            known = data[dimension].values.tolist()
            wanted = known if names is None else several(names)
            for name in wanted:
                if name not in known:
                    raise InvalidInput(f"There is no {dimension} {name!r}; {suggestion(name, known)}")
            choices[dimension] = wanted
    choices |= {name: data[name].values.tolist() for name in others}
    for values in product(*choices.values()):
        place = dict(zip(choices, values, strict=True))
        told = [
            _told(data, name, value) for name, value in place.items() if len(choices[name]) > 1 or len(choices) == 1
        ]
        yield ", ".join(told) or str(data.name), place


def _told(data: xr.DataArray, name: str, value: Any) -> str:
    if name in LABELS:
        return name_text(value)
    shown = number_text(value) if isinstance(value, int | float) else name_text(value)
    units = str(data[name].attrs.get("units", "1"))
    return f"{name.replace('_', ' ')} = {shown}{'' if units == '1' else f' {units_text(units)}'}"


def _positions(axes: Axes, coordinate: xr.DataArray) -> np.ndarray:
    """Return where the values of an axis are: numbers at their places, texts side by side."""
    values = coordinate.values
    if values.dtype.kind in "fiu":
        return np.asarray(values, dtype=float)
    axes.set_xticks(np.arange(len(values)), [name_text(value) for value in values])
    return np.arange(len(values), dtype=float)
