"""Diagrams of the scaling study: cost against size, cost and gain against clearance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from impactlab.plotting.style import COLORS, style
from impactlab_numerics.scaling.claims import BYTES, ENSEMBLE, GAINS, SINGLE

if TYPE_CHECKING:
    from impactlab_numerics.scaling.study import ScalingStudy

_KINDS = {"ensemble": ("-", "ensemble"), "single": ("--", "one realization")}
_METHODS = {"jumps": "default method", "steps": "every step made"}


def figures(study: ScalingStudy, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield both diagrams."""
    with style():
        yield "cost_against_size", _size(tree["size"].to_dataset())
        yield "cost_against_clearance", _clearance(tree["clearance"].to_dataset())


def _size(table: xr.Dataset) -> Figure:
    figure = Figure(figsize=(8.6, 4.4))
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for number, graph in enumerate(dict.fromkeys(table.graph.values.tolist())):
        part = table.isel(network=np.flatnonzero(table.graph.values == graph))
        look = {"color": COLORS[number], "marker": "os^"[number]}
        for kind, (line, text) in _KINDS.items():
            left.plot(part.bodies, 1e9 * part.cost.sel(kind=kind), ls=line, label=f"{graph}, {text}", **look)
            right.plot(part.bodies, part.memory.sel(kind=kind), ls=line, **look)
    pair = 1e9 * float(table.cost.sel(kind="ensemble")[0])
    for factor, line in ((ENSEMBLE, "-"), (SINGLE, "--")):
        left.axhline(factor * pair, color="gray", lw=0.9, ls=line, label=f"{factor:g} × ensemble of the pair")
    right.axhline(BYTES, color="gray", lw=0.9)
    for panel, text in ((left, "ns of one core per step of a body"), (right, "bytes per body and realization")):
        panel.set(xscale="log", yscale="log", xlabel="bodies", ylabel=text)
        panel.xaxis.set_minor_formatter(NullFormatter())
        _plain(panel)
        panel.grid(color="#DDDDDD", lw=0.5)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _clearance(table: xr.Dataset) -> Figure:
    figure = Figure(figsize=(8.6, 4.4))
    left, right = figure.subplots(1, 2)
    for number, (method, text) in enumerate(_METHODS.items()):
        left.plot(table.clearance, 1e6 * table.cost.sel(scheme=method), "o-", color=COLORS[number], label=text)
    right.plot(table.clearance, table.quicker, "-", color="black", label="run time alone")
    for number, name in enumerate(table.statistic.values):
        look = {"color": COLORS[number], "marker": "os^v"[number], "ls": ":"}
        right.plot(table.clearance, table.gain.sel(statistic=name), label=name, **look)
    for number, (place, least) in enumerate(GAINS.items()):
        label = None if number else "least that is claimed"
        right.plot([place - 0.25, place + 0.25], [least, least], color="gray", lw=1.5, label=label)
    left.set_ylabel("µs of one core for a second of a realization")
    right.set_ylabel("gain of the default method at equal error")
    for panel in (left, right):
        panel.set(yscale="log", xlabel="clearance in standard deviations of the gap")
        panel.grid(color="#DDDDDD", lw=0.5)
        panel.legend()
        _plain(panel)
    return figure


def _plain(panel: Axes) -> None:
    """Write the numbers of a logarithmic axis in full."""
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_formatter(NullFormatter())
