"""Figures of the conservation study."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from impactlab.plot import COLORS


def draw(tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield the figures."""
    yield "energy", energy(tree["energy"].to_dataset())
    yield "reversal", reversal(tree["reversal"].to_dataset())
    yield "order", order(tree["order"].to_dataset())


def energy(table: xr.Dataset) -> Figure:
    """Error of the energy against the number of contacts, one panel for each scene."""
    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    for axes, scene in zip(panels, table.scene.values, strict=False):
        part = table.sel(scene=scene)
        for row in range(part.sizes["halving"]):
            n, error = part.contacts.values[row], part.error.values[row]
            axes.loglog(n, error, "o-", ms=3, lw=1.0, color=COLORS[row], label=f"step / {2**row}")
            if np.isinf(part.power):
                axes.loglog(n, part.swing.values[row], ":", lw=1.0, color=COLORS[row])
            elif row == 0:
                known = np.isfinite(error)
                axes.loglog(n, (error / np.sqrt(n))[known][0] * np.sqrt(n), color="black", lw=0.7, ls="--")
        axes.set_title(str(scene), fontsize=9)
    panels[0].legend(fontsize=7)
    panels[-1].set_axis_off()
    panels[-1].text(0.0, 0.5, "dashed: √n\ndotted: swing of the energy", fontsize=8)
    figure.supxlabel("contacts that have closed", fontsize=9)
    figure.supylabel("relative error of the energy", fontsize=9)
    return figure


def reversal(table: xr.Dataset) -> Figure:
    """Distance from the start after a reversal against the number of contacts."""
    figure = Figure(figsize=(4.5, 3.2), layout="constrained")
    axes = figure.subplots()
    for row, scene in enumerate(table.scene.values):
        part = table.sel(scene=scene)
        axes.loglog(part.contacts, part.error, "o-", ms=4, color=COLORS[row], label=str(scene))
    axes.set_xlabel("contacts until the reversal")
    axes.set_ylabel("distance from the start")
    axes.legend(fontsize=8)
    return figure


def order(table: xr.Dataset) -> Figure:
    """Errors of paths against the step."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    panels = figure.subplots(1, table.sizes["force"], sharey=True)
    for axes, force in zip(panels, table.force.values, strict=True):
        for row, name in enumerate(table.integrator.values):
            part = table.sel(integrator=name, force=force)
            label = f"{name}: {float(part.order):.2f}"
            axes.loglog(part.step, part.error, "o-", ms=4, color=COLORS[row], label=label)
        axes.set_title(f"{force} force", fontsize=9)
        axes.set_xlabel("step (s)")
        axes.legend(fontsize=7, title="slope", title_fontsize=7)
    panels[0].set_ylabel("largest error of the path")
    return figure
