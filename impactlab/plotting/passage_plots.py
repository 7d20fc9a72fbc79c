"""Plots of first passages: survival over time."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked
from impactlab.plotting.held import known_dataset
from impactlab.plotting.style import COLORS, axes_of, band, label_text, legend, style


class Survivals(Protocol):
    """A solution that knows survival, such as a `PassageReference`."""

    def survival(self, time: Any, displacement: float = 0.0, velocity: float = 0.0) -> np.ndarray: ...


@checked
@style()
def survival(
    result: xr.Dataset,
    *,
    reference: Survivals | None = None,
    start: tuple[float, float] = (0.0, 0.0),
    log: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw the probability that no limit is passed until a time, with a band of two standard errors.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=il.FirstPassage(limits)``.
    reference : PassageReference, optional
        Solution of the Fokker–Planck equation, drawn as a dashed line.
    start : pair of float
        Displacement and velocity from which the reference starts (m, m s-1).
    log : bool
        Whether probabilities are on a logarithmic axis, on which survivals that decay at one rate are straight lines.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no first passages.

    Examples
    --------
    >>> record = il.FirstPassage({"a": 1.0})
    >>> result = il.simulate(network, 50.0, realizations=64, initial="rest", record=record, rng=1)
    >>> axes = il.plot.survival(result)
    """
    data = known_dataset(result)
    if "survival" not in data or data["survival"].dims != ("survival_time",):
        raise InvalidInput(
            "The result holds no first passages of one network: simulate with record=il.FirstPassage(…)."
        )
    axes, times = axes_of(ax), data["survival_time"].values
    label = None if reference is None else "simulated"
    band(axes, times, data["survival"], data["survival_standard_error"], label=label, color=COLORS[0])
    if reference is not None:
        axes.plot(times, reference.survival(times, *start), "--", color=COLORS[1], label="Fokker–Planck")
    axes.set(xlabel=label_text("time", "s"), ylabel="probability of survival", xlim=(times[0], times[-1]))
    if log:
        least = float(data["survival"].where(data["survival"] > 0.0).min())
        axes.set(yscale="log", ylim=(0.5 * least, 1.5))
    else:
        axes.set(ylim=(0.0, 1.05))
    return legend(axes)
