"""Plots of probability densities, of one coordinate and of two."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

import impactlab
from impactlab.components.contact import RoundContact
from impactlab.components.sides import WALL, weights_of
from impactlab.inputs import checked
from impactlab.plotting.held import (
    configuration,
    contacts_of,
    error_of,
    known_dataset,
    law_with,
    reading_stored,
    rows,
    variable,
)
from impactlab.plotting.motion import axis_label, draw_rim
from impactlab.plotting.style import COLORS, axes_of, band, dashes, label_text, legend, legend_above, name_text, style


class BinDensities(Protocol):
    """A law that knows densities, such as an `ExactReference`."""

    def bin_density(self, oscillator: str, quantity: str, edges: Any) -> np.ndarray: ...


class JointDensities(Protocol):
    """A law that knows joint densities, such as an `ExactReference`."""

    def joint_density(
        self, first: str, second: str, x: Any, y: Any, *, quantities: tuple[str, str] = ...
    ) -> np.ndarray: ...


DECADES = 6.0
"""Decades below the largest density that logarithmic axes show at most."""


@checked
@style()
def density(
    result: xr.Dataset,
    names: str | Iterable[str] | None = None,
    quantity: str = "displacement",
    *,
    reference: BinDensities | None = None,
    log: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw probability densities with a band of two standard errors, and exact ones beside them.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Density(quantity)]``.
    names : str or sequence of str, optional
        Bodies, or points of structures for the quantities of these; all that were recorded by default.
    quantity : str
        "displacement", "velocity", "point_displacement" or "point_velocity".
    reference : ExactReference or FokkerPlanckReference, optional
        The law of the network, drawn as a dashed line, averaged over the same bins.
    log : bool
        Whether densities are drawn on a logarithmic axis, which shows the tails.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no such density, or a name is unknown.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.Density(bins=50), rng=1)
    >>> axes = il.plot.density(result, "a", reference=il.exact(network))
    >>> axes.get_xlabel()
    'displacement (m)'
    """
    name, inner, record = f"density_{quantity}", f"{quantity}_bin", f"il.{impactlab.Density(quantity)!r}"
    result = known_dataset(result)
    data = variable(result, name, f"density of the {quantity.replace('_', ' ')}", record, [inner])
    axes, top, reached = axes_of(ax), 0.0, []
    for index, (label, place) in enumerate(rows(data, names)):
        center, value = result[f"{quantity}_center"].sel(place).values, data.sel(place).values
        shown = np.where(value > 0.0, value, np.nan) if log else value
        band(axes, center, shown, error_of(result, name, place), label=name_text(label), ls=dashes(index))
        top = max(top, float(value.max()))
        # on linear axes a thousandth of the largest density can be seen
        reached.append(center[value > (0.0 if log else 1e-3) * value.max()][[0, -1]])
        if reference is not None:
            edges = result[f"{quantity}_edges"].sel(place).values
            exact = law_with("bin_density", reference)(label, quantity.removeprefix("point_"), edges)
            axes.plot(center, exact, color="black", ls=(0, (4, 2.5)), lw=1.0)
    if reference is not None:
        axes.lines[-1].set_label("exact")
    of_center = result[f"{quantity}_center"].attrs
    axes.set_xlabel(label_text(quantity.removeprefix("point_"), str(of_center["units"])))
    axes.set_ylabel(label_text("probability density", str(data.attrs["units"])))
    axes.set_xlim(np.min(reached), np.max(reached))
    if log:
        axes.set_yscale("log")
        lowest = float(data.where(data > 0.0).min())
        axes.set_ylim(max(0.5 * lowest, top * 10.0**-DECADES), 2.0 * top)
    else:
        axes.set_ylim(bottom=0.0)
    return legend(axes)


@checked
@style()
def joint_density(
    result: xr.Dataset, *, reference: JointDensities | None = None, log: bool = False, ax: Axes | None = None
) -> Axes:
    """Draw the joint density of two quantities, with the line or circle on which a contact closes.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.JointDensity(first, second)]``.
    reference : ExactReference, optional
        The law of the network, drawn as contours.
    log : bool
        Whether the colours are those of the logarithm of the density.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no joint density.

    Examples
    --------
    >>> record = il.JointDensity("a", "a", quantities=("displacement", "velocity"))
    >>> result = il.simulate(network, 20.0, realizations=64, record=record, rng=1)
    >>> axes = il.plot.joint_density(result)
    """
    result = known_dataset(result)
    inner = ["joint_first_bin", "joint_second_bin"]
    data = variable(result, "joint_density", "joint density", "il.JointDensity(first, second)", inner)
    edges = [result[f"joint_{side}_edges"].values for side in ("first", "second")]
    items = _items(result)
    (first, _), (second, _) = items
    axes = axes_of(ax, (4.6, 3.6))
    density = data.values
    shown = np.ma.masked_less_equal(density, 0.0)  # white, so that what was never reached can be told from little
    norm = LogNorm(max(shown.min(), shown.max() * 10.0**-DECADES), shown.max()) if log else None
    mesh = axes.pcolormesh(*edges, shown.T, cmap="Blues", norm=norm, rasterized=True)
    root = axes.get_figure(root=True)
    assert root is not None
    root.colorbar(mesh, ax=axes, label=label_text("joint density", str(data.attrs["units"])))
    if reference is not None:
        x, y = (0.5 * (edge[1:] + edge[:-1]) for edge in edges)
        law = law_with("joint_density", reference)
        exact = law(first, second, x[:, None], y[None, :], quantities=(items[0][1], items[1][1]))
        levels = exact.max() * (10.0 ** np.arange(-4.0, 0.0) if log else np.linspace(0.1, 0.9, 5))
        axes.contour(x, y, exact.T, levels, colors="black", linewidths=0.7, linestyles="dashed")
        axes.plot([], [], color="black", lw=0.7, ls="--", label="exact")
    of_first, of_second = [name if quantity == "displacement" else "" for name, quantity in items]
    for name, contact in contacts_of(result).items():
        look: dict[str, Any] = {"color": COLORS[1], "lw": 1.2, "label": name_text(f"{name} closes")}
        if isinstance(contact, RoundContact):
            if (contact.first, contact.second) == ((of_first, of_second), WALL):
                draw_rim(axes, contact, **look)
        elif (weights := weights_of(contact)).keys() <= {of_first, of_second}:
            a, b = weights.get(of_first, 0.0), weights.get(of_second, 0.0)
            if b:
                axes.axline((0.0, contact.clearance / b), slope=-a / b, **look)
            else:
                axes.axvline(contact.clearance / a, **look)
    axes.set(xlim=_reached(edges[0], density.sum(axis=1)), ylim=_reached(edges[1], density.sum(axis=0)))
    axes.set(xlabel=axis_label(first, items[0][1]), ylabel=axis_label(second, items[1][1]))
    return legend_above(axes)


def _reached(edges: np.ndarray, bins: np.ndarray) -> tuple[float, float]:
    """Return between which edges there is something."""
    inside = np.flatnonzero(bins)
    return float(edges[inside[0]]), float(edges[inside[-1] + 1])


@reading_stored()
def _items(result: xr.Dataset) -> list[tuple[str, str]]:
    """Return name and quantity of the first and the second, which only the stored record has."""
    usual = "displacement", "displacement"
    records = configuration(result).get("simulate", {}).get("record", [])
    found = [item for item in records if item["type"] == "JointDensity"] or [{"first": "first", "second": "second"}]
    names = str(found[0]["first"]), str(found[0]["second"])
    return list(zip(names, found[0].get("quantities", usual), strict=True))
