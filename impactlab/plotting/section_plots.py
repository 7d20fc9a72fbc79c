"""Plots of sections, as points in the phase plane or impact maps, and of the growth of differences."""

from __future__ import annotations

from itertools import cycle

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, known_name, positive
from impactlab.plotting.held import known_dataset
from impactlab.plotting.motion import axis_label
from impactlab.plotting.style import COLORS, axes_of, label_text, legend, name_text, style

OF_ONE_NETWORK = {"realization", "section"}
"""Dimensions of the section of one network."""

MANY = 500
"""Points from which on they are drawn smaller."""


@checked
@style()
def section(
    result: xr.Dataset,
    name: str | None = None,
    period: float | None = None,
    *,
    realization: int | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the points of a section: displacements and velocities of a body, or velocities over the phase of a force.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Section(surface)]``.
    name : str, optional
        The body; the first one by default.
    period : float, optional
        Period of a force (s), 2π/ω, over whose cycle velocities are drawn: those of the contact of the section, if it
        has one, which makes an impact map, else those of the body.
    realization : int, optional
        Which one; all by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no section, or there is no such name or realization.

    Examples
    --------
    >>> result = il.simulate(driven, 100.0, initial="rest", record=il.Section(il.Strobe(np.pi)))
    >>> axes = il.plot.section(result)
    """
    data = known_dataset(result)
    if "section_time" not in data or set(data["section_time"].dims) - OF_ONE_NETWORK:
        others = sorted(
            str(item) for item in set(data["section_time"].dims if "section_time" in data else ()) - OF_ONE_NETWORK
        )
        raise InvalidInput(
            f"The result has a section for each {others[0]!r}: choose one, as by result.isel({others[0]}=0)."
            if others
            else "The result holds no section: simulate with record=il.Section(surface)."
        )
    if realization is not None:
        known_name("realization", realization, data["realization"].values.tolist())  # type: ignore[arg-type]
        data = data.sel(realization=realization)
    (among,) = set(data["section_velocity"].dims) - set(data["section_time"].dims)
    names = data[among].values.tolist()
    chosen = names[0] if name is None else name
    known_name("oscillator in the section", chosen, names)
    place, rate = (data[f"section_{item}"].sel({among: chosen}).values.ravel() for item in ("displacement", "velocity"))
    axes = axes_of(ax, (4.0, 3.6))
    across, up = axis_label(chosen), axis_label(chosen, "velocity")
    if period is not None:
        place, across = (
            data["section_time"].values.ravel() / positive("period", period) % 1.0,
            "phase (part of the period)",
        )
        axes.set(xlim=(0.0, 1.0))
        if name is None and "section_contact_velocity" in data:
            found = data["section_contact_velocity"]
            rate, title = found.values.ravel(), str(found.attrs["long_name"]).removesuffix(" in the section")
            up = label_text(name_text(title.replace("'", "")), "m s-1")
    axes.set(xlabel=across, ylabel=up)
    axes.plot(place, rate, "o", color=COLORS[0], ms=4.0 if np.isfinite(rate).sum() < MANY else 1.2)
    return axes


@checked
@style()
def exponents(result: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw how Lyapunov exponents settle over the length of paths, with bands of two standard errors of the last.

    Parameters
    ----------
    result : Dataset
        What `impactlab.lyapunov` returned.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no exponents, or those of Floquet multipliers, which do not settle.

    Examples
    --------
    >>> import warnings
    >>> chaotic = driven.replace(excitations={"a": il.Harmonic(1.0, frequency=2.8)})
    >>> axes = il.plot.exponents(il.lyapunov(chaotic, duration=500.0, rng=1))
    """
    data = known_dataset(result)
    if "lyapunov_exponent_so_far" not in data:
        raise InvalidInput(
            "The result holds no exponents along paths: give what il.lyapunov returned of a motion that never repeats."
        )
    axes, times = axes_of(ax), data["time"].values
    for number, colour in zip(data["exponent"].values, cycle(COLORS)):
        chosen = data.sel(exponent=number)
        value, error = (float(chosen[f"lyapunov_exponent{end}"]) for end in ("", "_standard_error"))
        axes.plot(times, chosen["lyapunov_exponent_so_far"], color=colour, label=f"exponent {number}")
        axes.axhspan(value - 2.0 * error, value + 2.0 * error, color=colour, alpha=0.2, lw=0.0)
    axes.set(xlabel=label_text("length of each path", "s"), ylabel=label_text("Lyapunov exponent", "s-1"))
    legend(axes)
    return axes
