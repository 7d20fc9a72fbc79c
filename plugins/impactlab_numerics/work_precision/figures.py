"""Work-precision diagrams: run time against error, one line per method.

A line is pale where the error is below two standard errors of the measured bias: nothing is known
of the bias there, and the time is a lower bound.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, FuncFormatter, NullLocator

from impactlab.plotting.style import COLORS, style
from impactlab_numerics.scenes import STATISTICS
from impactlab_numerics.work_precision.methods import SEEN, Findings, seconds_to
from impactlab_numerics.work_precision.results import Results
from impactlab_numerics.work_precision.study import PAIR

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy

TITLES = {
    "mean_square_displacement": "E[x²] of the last body",
    "contact_ratio": "contact ratio of the last contact",
    "mean_contact_force": "mean force of the last contact",
    "density": "density of the last body's x",
}
_ERRORS = np.geomspace(0.1, 2e-4, 241)
_TIMES = {
    "1 ms": 1e-3, "10 ms": 1e-2, "0.1 s": 0.1, "1 s": 1.0, "10 s": 10.0, "1 min": 60.0, "10 min": 600.0,
    "1 h": 3600.0, "1 d": 86400.0, "10 d": 864000.0, "100 d": 8640000.0, "1000 d": 86400000.0,
}  # fmt: skip


def figures(study: WorkPrecisionStudy, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
    """Yield one diagram for each scene, and that of paths without noise."""
    results = Results(study, tree)
    for scene in study.scenes():
        with style():
            yield f"work_precision_{scene.replace(' ', '_')}", _diagram(results, scene)
    with style():
        yield "paths_without_noise", _paths(results.paths)


def _diagram(results: Results, scene: str) -> Figure:
    figure = Figure(figsize=(9.0, 7.6))
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    lines: dict[str, list[Findings]] = {}
    for case in results.cases(scene):
        one = results.findings(case)
        if np.isfinite(one.rate):
            lines.setdefault(str(results.methods["line"].sel(case=case).values), []).append(one)
    looks = _looks(list(dict.fromkeys(map(str, results.methods["line"].values))))
    for index, (panel, name) in enumerate(zip(axes.flat, STATISTICS, strict=True)):
        for line, found in lines.items():
            _envelope(panel, found, index, line if index == 0 else None, looks[line])
        panel.set_title(TITLES[name])
        _scales(panel)
    if scene == PAIR and results.tolerances is not None:
        run = results.tolerances.sel(network=PAIR)
        axes[0, 0].plot(
            float(run["tolerance"]), float(run["seconds"]), "*", ms=11, color="black", zorder=5,
            label="impactlab, run to a tolerance",
        )  # fmt: skip
    for panel in axes[1]:
        panel.set_xlabel("|bias| + 2 standard errors" if panel is axes[1, 0] else "probability elsewhere")
    for panel in axes[:, 0]:
        panel.set_ylabel("run time on one core")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _paths(table: xr.Dataset) -> Figure:
    figure = Figure(figsize=(9.0, 3.8))
    networks = list(dict.fromkeys(map(str, table["network"].values)))
    lines = list(dict.fromkeys(map(str, table["line"].values)))
    panels = figure.subplots(1, len(networks), sharex=True, sharey=True)
    for panel, network in zip(panels, networks, strict=True):
        for line, look in _looks(lines, "impactlab: located events").items():
            chosen = ((table["network"] == network) & (table["line"] == line)).values
            error, seconds = table["error"].values[chosen], table["seconds"].values[chosen]
            label = line if panel is panels[0] else None
            panel.plot(error, seconds, marker="o", ms=4, label=label, **look)
        panel.set(title=network, xscale="log", yscale="log", xlabel="largest error (m)")
        panel.grid(color="#DDDDDD", lw=0.5)
    panels[0].invert_xaxis()  # shared by all
    panels[0].set_ylabel("run time on one core (s)")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _looks(lines: list[str], default: str = "impactlab: exact flow") -> dict[str, dict[str, object]]:
    """The same look for a line in all diagrams: impactlab's are solid, the default method's is thick."""
    return {
        line: {
            "color": COLORS[number % len(COLORS)],
            "ls": "-" if line.startswith("impactlab") else "--",
            "lw": 2.2 if line == default else 1.2,
        }
        for number, line in enumerate(lines)
    }


def _envelope(panel: Axes, found: list[Findings], index: int, label: str | None, look: dict[str, object]) -> None:
    """Draw the shortest time of all steps to each error."""
    times = np.array([[seconds_to(error, item)[index] for error in _ERRORS] for item in found])
    best, which = times.min(axis=0), times.argmin(axis=0)
    known = np.array([SEEN * item.bias_error[index] for item in found])[which] <= _ERRORS
    best[np.isinf(best)] = np.nan
    panel.plot(_ERRORS, best, alpha=0.3, **look)  # type: ignore[arg-type]
    panel.plot(_ERRORS, np.where(known, best, np.nan), label=label, **look)  # type: ignore[arg-type]


def _scales(panel: Axes) -> None:
    panel.set(xscale="log", yscale="log", xlim=(_ERRORS[0], _ERRORS[-1]))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:g} %"))
    panel.yaxis.set_major_locator(FixedLocator(list(_TIMES.values())))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.yaxis.set_major_formatter(FixedFormatter(list(_TIMES)))
    panel.grid(color="#DDDDDD", lw=0.5)
