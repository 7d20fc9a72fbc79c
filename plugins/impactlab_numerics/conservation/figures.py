"""Figures of the conservation study."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from impactlab.plotting.style import COLORS
from impactlab_numerics.conservation.claims import over_contacts

if TYPE_CHECKING:
    from impactlab_numerics.conservation.study import ConservationStudy


def figures(study: ConservationStudy, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield the figures."""
    yield "energy", energy(tree["energy"].to_dataset(), tree["bounce"].to_dataset())
    yield "reversal", reversal(tree["reversal"].to_dataset())
    yield "order", order(tree["order"].to_dataset())


def energy(table: xr.Dataset, bounce: xr.Dataset) -> Figure:
    """Error of the energy against the number of contacts, one panel for each scene; and the change in one contact."""
    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    panels: list[Any] = []
    for place, scene in enumerate(table.scene.values, 1):
        share = {"sharex": panels[0], "sharey": panels[0]} if panels else {}
        axes = figure.add_subplot(2, 3, place, **share)
        panels.append(axes)
        part = table.sel(scene=scene)
        for row in range(part.sizes["halving"]):
            n, error = part.contacts.values[row], part.error.values[row]
            axes.loglog(n, np.where(error > 0.0, error, np.nan), "o-", ms=3, lw=1.0, color=COLORS[row],
                        label=f"automatic step / {2**row}" if row else "automatic step")  # fmt: skip
            if np.isinf(part.power):
                axes.loglog(n, part.swing.values[row], ":", lw=1.0, color=COLORS[row])
            else:
                axes.loglog(n, over_contacts(part)[0][row] * np.sqrt(n), lw=0.7, ls="--", color=COLORS[row])
        axes.set_title(str(scene), fontsize=9)
        axes.set_xlabel(
            "contacts (dashed: √n)" if np.isfinite(part.power) else "time × 2.2/s (dotted: swing)", fontsize=8
        )
    panels[0].legend(fontsize=7)
    panels[0].set_ylim(top=10.0)  # beyond, it grows without end
    axes = figure.add_subplot(2, 3, 6)
    for row, force in enumerate(bounce.force.values):
        part = bounce.sel(force=force)
        axes.loglog(part.relative_step, part.change, "o", ms=4, color=COLORS[row], label=str(force))
        axes.loglog(part.relative_step, part.theory, lw=0.9, color=COLORS[row])
    axes.set_title("one contact (lines: theory)", fontsize=9)
    axes.set_xticks(bounce.relative_step.values[0], [f"{item:.2g}" for item in bounce.relative_step.values[0]])
    axes.minorticks_off()
    axes.set_xlabel("step times frequency of the contact", fontsize=8)
    axes.legend(fontsize=7)
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
