"""Tables of the work-precision study for its report."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from impactlab_numerics.work_precision.methods import SEEN, Method
from impactlab_numerics.work_precision.results import Results, time_text

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy

Rows = list[dict[str, Any]]


def tables(study: WorkPrecisionStudy, tree: xr.DataTree) -> Iterable[tuple[str, Rows]]:
    """Yield the methods of each scene, the contribution of each device, the speeds, and the price of tolerances."""
    results = Results(study, tree)
    for scene in study.scenes():
        yield f"E[x²] of the last body, {scene}", _methods(results, scene)
    yield "What each device contributes (E[x²] of the base case)", _contributions(results)
    yield "Steps of a body per second", _speeds(results)
    yield f"Paths without noise, {results.paths.attrs['periods']} periods, one core", _paths(results.paths)
    if results.tolerances is not None:
        yield "Time to a tolerance of E[x²], one core", _tolerances(results.tolerances)


def _methods(results: Results, scene: str) -> Rows:
    """One row per case; ≥ says that the bias is not seen, and taken as 0."""
    rows = []
    high = results.study.accuracies[-1]
    paper = Method(scene, "numba", "Runge–Kutta", "series", results.study.paper_step).key
    for case in results.cases(scene):
        row, found = results.methods.sel(case=case), results.findings(case)
        seen = abs(found.bias[0]) > SEEN * found.bias_error[0]
        known = bool(np.isfinite(found.bias[0]))
        times = {
            f"to {accuracy:.2g}": ("" if seen else "≥ ") + time_text(results.seconds(case, accuracy))
            for accuracy in results.study.accuracies
        }
        ratio = results.seconds(paper, high) / results.seconds(case, high)
        rows.append(
            {
                "method": str(row["line"].values),
                "step (ms)": f"{1e3 * found.step:.3g}",
                "ns per body and step": f"{1e9 * found.rate * found.step / int(row['bodies']):.3g}",
                "bias (%)": f"{100 * found.bias[0]:.3f} ± {100 * found.bias_error[0]:.3f}" if known else "not measured",
                "time × error² (s)": f"{found.rate * found.scatter[0]:.2e}",
                **times,
                "times faster than Runge–Kutta + FFT": f"{ratio:.3g}",
                "note": str(row["note"].values),
            }
        )
    return rows


def _contributions(results: Results) -> Rows:
    table = results.contributions
    return [
        {
            "device": str(table["device"].values[row]),
            "instead": str(table["instead"].values[row]),
            "time without it / with it": f"{float(table['ratio'].values[row]):.3g}",
            "measured": str(table["measured"].values[row]),
        }
        for row in range(table.sizes["row"])
    ]


def _speeds(results: Results) -> Rows:
    return [
        {"run": str(run), "steps of a body per second": f"{results.body_steps(str(run)):.3g}"}
        for run in results.speed["run"].values
    ]


def _paths(table: xr.Dataset) -> Rows:
    return [
        {
            "network": str(row["network"].values),
            "method": str(row["line"].values),
            "tolerance, or steps of a period": str(row["fineness"].values),
            "error (m)": f"{float(row['error']):.1e}",
            "time": time_text(float(row["seconds"])),
        }
        for case in range(table.sizes["case"])
        for row in [table.isel(case=case)]
    ]


def _tolerances(table: xr.Dataset) -> Rows:
    return [
        {
            "network": str(name),
            "tolerance": f"{float(row['tolerance']):.2g}",
            "time": time_text(float(row["seconds"])),
            "time of a run with the same step and error": time_text(float(row["direct_seconds"])),
            "ratio": f"{float(row['ratio']):.2f}",
            "error over tolerance": f"{float(row['error']):.2f}",
        }
        for name in table["network"].values
        for row in [table.sel(network=name)]
    ]
