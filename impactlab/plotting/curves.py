"""Plots of spectra, and of peak forces over their return time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

import impactlab
from impactlab.inputs import checked
from impactlab.plotting.held import error_of, known_dataset, law_with, rows, variable
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


class Spectra(Protocol):
    """A law that knows spectra, such as the `ExactReference` of linear motion."""

    def spectrum(self, oscillator: str, quantity: str, frequencies: Any) -> np.ndarray: ...


class Crossings(Protocol):
    """A law that knows how often levels are crossed, such as an `ExactReference`."""

    def crossing_rate(self, name: str, quantity: str, level: float) -> float: ...


@checked
@style()
def spectrum(
    result: xr.Dataset,
    names: str | Iterable[str] | None = None,
    quantity: str = "displacement",
    *,
    reference: Spectra | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw spectral densities with a band of two standard errors, on logarithmic axes.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Spectrum(quantity)]``.
    names : str or sequence of str, optional
        Bodies, contacts or points of structures; all that were recorded by default.
    quantity : str
        "displacement", "velocity", "contact_force", "point_displacement" or "point_velocity".
    reference : ExactReference, optional
        Law of a linear network whose spectra are drawn as dashed lines; that of the network without its contacts,
        ``il.exact(network.replace(contacts={…: None}))``, shows what these change.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no such spectrum, or a name is unknown.
    NoExactReference
        If the motion of the reference is not linear.

    Examples
    --------
    >>> result = il.simulate(network, 40.0, realizations=64, record=il.Spectrum(segment=10.0), rng=1)
    >>> axes = il.plot.spectrum(result)
    """
    name, inner, record = f"spectrum_{quantity}", f"{quantity}_frequency", f"il.{impactlab.Spectrum(quantity)!r}"
    result = known_dataset(result)
    data = variable(result, name, f"spectrum of the {quantity.replace('_', ' ')}", record, [inner])
    frequencies = result[inner].values
    inside = frequencies > 0.0
    axes = axes_of(ax)
    for index, (label, place) in enumerate(rows(data, names)):
        value = data.sel(place).values[inside]
        error = error_of(result, name, place)[inside]
        shown = np.where(value > 0.0, value, np.nan)
        band(axes, frequencies[inside], shown, error, label=name_text(label), ls=dashes(index))
        if reference is not None:
            linear = law_with("spectrum", reference)(label, quantity.removeprefix("point_"), frequencies[inside])
            axes.plot(frequencies[inside], linear, color=axes.lines[-1].get_color(), ls=(0, (2, 2)), lw=0.8)
            axes.lines[-1].set_label(name_text(f"{label}, linear"))
    axes.set(xscale="log", yscale="log", xlabel=label_text("angular frequency", "rad s-1"))
    largest = float(data.max())
    axes.set_ylim(max(0.5 * float(data.where(data > 0.0).min()), 1e-8 * largest), None)
    axes.set_ylabel(label_text("spectral density", str(data.attrs["units"])))
    return legend(axes)


@checked
@style()
def peaks(
    result: xr.Dataset,
    names: str | Iterable[str] | None = None,
    *,
    reference: Crossings | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw contact forces over their return time: from the rate at which they are crossed, and from largest forces.

    A line with a band of two standard errors is one over the rate of crossings of indentations, at mean forces there;
    forces with a dashpot are largest before the indentation is. Dots are the largest forces in windows
    of the length T, at ``−T/ln P`` where P is the part of the windows with a smaller one: they lie on the line where
    crossings do not cluster. Marks with bars of two standard errors are the return levels.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.PeakForces()]``.
    names : str or sequence of str, optional
        Contacts; all that were recorded by default.
    reference : ExactReference, optional
        The law of the network, drawn as dashed lines.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no peak forces, or a name is unknown.

    Examples
    --------
    >>> result = il.simulate(network, 40.0, realizations=64, record=il.PeakForces(window=5.0), rng=1)
    >>> axes = il.plot.peaks(result)
    """
    result, record = known_dataset(result), "il.PeakForces()"
    data = variable(result, "crossing_rate", "peak forces", record, ["crossing_bin"])
    axes = axes_of(ax)
    for name, place in rows(data, names):
        rate, error = data.sel(place).values, error_of(result, "crossing_rate", place)
        force = result["crossing_force"].sel(place).values
        # rates that are not above 0 by 2.5 standard errors are not drawn
        lost = ~((rate > 2.5 * error) & np.isfinite(force))
        top = int(np.argmax(rate))
        known = slice(top, top + int(np.argmax(np.append(lost[top:], True))))
        rate, error, force = rate[known], error[known], force[known]
        (line,) = axes.plot(1.0 / rate, force, label=name_text(name))
        color = line.get_color()
        sides = 1.0 / (rate + 2.0 * error), 1.0 / (rate - 2.0 * error)
        axes.fill_betweenx(force, *sides, color=color, alpha=0.25, linewidth=0.0)
        _largest(axes, result, place, color)
        level = result["return_level"].sel(place)
        points(
            axes, result["return_time"].values, level.values, error_of(result, "return_level", place),
            color=color, fmt="D", zorder=3,
        )  # fmt: skip
        if reference is not None:
            exact = np.array(
                [law_with("crossing_rate", reference)(name, "contact_force", float(item)) for item in force]
            )
            falling = np.arange(len(exact)) >= np.argmax(exact)
            axes.plot(1.0 / exact[falling], force[falling], color="black", ls=(0, (4, 2.5)), lw=1.0)
    if reference is not None:
        axes.lines[-1].set_label("exact")
    window = float(result["peak_window"])
    axes.plot([], [], ".", color="0.4", ms=3.0, label=f"largest in windows of {number_text(window)} s")
    axes.plot([], [], "D", color="0.4", label="return levels")
    axes.set(xscale="log", xlabel=label_text("return time", "s"), ylabel=label_text("contact force", "N"))
    axes.set_ylim(bottom=0.0)
    return legend_above(axes)


def _largest(axes: Axes, result: xr.Dataset, place: dict[str, str], color: Any) -> None:
    """Draw the largest forces in windows at the return times of their ranks."""
    if "window_peak_force" not in result:
        return
    largest = -np.sort(-result["window_peak_force"].sel(place).values.ravel())
    count = len(largest)
    # of more than a hundred, peaks that are evenly spaced over the logarithm of their rank
    ranks = np.unique(np.rint(np.geomspace(1.0, count, min(count, 100))).astype(int))
    below = 1.0 - (ranks - 0.5) / count
    touched = largest[ranks - 1] > 0.0
    times = -float(result["peak_window"]) / np.log(below)
    axes.plot(times[touched], largest[ranks - 1][touched], ".", color=color, ms=3.0)
