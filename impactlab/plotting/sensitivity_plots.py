"""Plots of what uncertain numbers do to a statistic."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, known_name
from impactlab.plotting.held import several
from impactlab.plotting.style import COLORS, axes_of, legend_above, name_text, style


@checked
@style()
def sensitivity(
    result: xr.Dataset, statistic: str, names: str | Iterable[str] | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw the part of the variance of a statistic that each uncertain number causes, with bars of two standard errors.

    Parameters
    ----------
    result : Dataset
        Of `uncertain`, or of `simulate` for a network with uncertain numbers.
    statistic : str
        Name of the statistic, such as "contact_ratio".
    names : str or sequence of str, optional
        Bodies, contacts or points; all by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Examples
    --------
    >>> body = il.LinearOscillator(stiffness=il.Uncertain("lognorm", shapes=(0.1,), scale=400.0), damping=1.0)
    >>> mounted = il.Network({"a": body}, {}, {"a": il.WhiteNoise(1.0)})
    >>> result = il.simulate(mounted, 20.0, realizations=512, rng=1)
    >>> axes = il.plot.sensitivity(result, "mean_square_displacement")
    """
    index = f"{statistic}_sobol_index"
    if not isinstance(result, xr.Dataset) or index not in result or result[index].ndim != 2:
        raise InvalidInput(f"The result has no {index}; il.uncertain returns it, for the statistics of a run.")
    data, (of_number, dimension) = result[index], map(str, result[index].dims)
    known = [str(name) for name in data[dimension].values]
    chosen = known if names is None else [str(name) for name in several(names)]
    for name in chosen:
        known_name(dimension, name, known)
    axes, rows = axes_of(ax), np.arange(data.sizes[of_number])
    height = 0.8 / len(chosen)
    for place, name in enumerate(chosen):
        own, errors = (item.sel({dimension: name}).values for item in (data, result[f"{index}_standard_error"]))
        at = rows + height * (place - 0.5 * (len(chosen) - 1))
        color = COLORS[place % len(COLORS)]
        axes.barh(at, own, 0.9 * height, xerr=2.0 * errors, color=color, ecolor="0.3", label=name_text(name))
    axes.set_yticks(rows, [str(name) for name in data[of_number].values])
    axes.invert_yaxis()
    axes.axvline(0.0, color="0.3", lw=0.8)
    axes.set_xlabel(f"part of the variance by uncertain numbers: {statistic.replace('_', ' ')}")
    return legend_above(axes)
