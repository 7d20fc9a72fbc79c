"""Cost and memory against size and clearance, for the report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from impactlab_numerics.scaling.record_costs import rows_of

if TYPE_CHECKING:
    from impactlab_numerics.scaling.study import ScalingStudy


def tables(study: ScalingStudy, tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield size, clearance, exactness, records and bounded noise."""
    size = tree["size"].to_dataset()
    yield "Cost and memory against size", [_network(size.sel(network=name)) for name in size.network]
    clearance = tree["clearance"].to_dataset()
    yield "Cost against clearance", [_place(clearance.sel(clearance=place)) for place in clearance.clearance]
    exactness = tree["exactness"].to_dataset()
    yield (
        "Default method against the exact law",
        [
            {
                "statistic": row.statistic.item(),
                "of": row.label.item(),
                "difference (%)": f"{100.0 * row.relative_difference.item():.4f}",
                "standard errors": f"{row.z.item():.2f}",
            }
            for row in (exactness.isel(comparison=index) for index in range(exactness.sizes["comparison"]))
        ],
    )
    yield "Time that records add to a run", rows_of(tree["records"].to_dataset())
    series = tree["series"].to_dataset()
    yield (
        f"Bounded noise: a realization of {series.attrs['period']:g} s, {series.attrs['components']} cosines",
        [
            {
                "method": str(name),
                "step (ms)": f"{1e3 * float(series.step.sel(scheme=name)):.3g}",
                "time (ms)": f"{1e3 * float(series.cost.sel(scheme=name)):.3g}",
            }
            for name in series.scheme.values
        ],
    )


def _network(row: xr.Dataset) -> dict[str, Any]:
    return {
        "network": row.network.item(),
        **{
            f"{kind}: ns per step of a body (relative)": f"{1e9 * float(row.cost.sel(kind=kind)):.2f} "
            f"({float(row.relative_cost.sel(kind=kind)):.2f})"
            for kind in row.kind.values
        },
        "realizations of the ensemble": int(row.realizations.sel(kind="ensemble")),
        **{f"{kind}: bytes per body": f"{row.memory.sel(kind=kind).item():.0f}" for kind in row.kind.values},
        "made in (s)": f"{row.build_time.item():.2g}",
        "planning and estimates (s)": f"{row.preparation.item():.2g}",
    }


def _place(row: xr.Dataset) -> dict[str, Any]:
    gains = {f"gain, {name}": row.gain.sel(statistic=name).item() for name in row.statistic.values}
    return {
        "clearance (σ)": f"{row.clearance.item():g}",
        "longest jump (s)": f"{row.longest_jump.item():.3g}",
        **{f"ns per second, {name}": f"{1e9 * float(row.cost.sel(scheme=name)):.3g}" for name in row.scheme.values},
        "run time": f"{row.quicker.item():.2f}",
        **{name: "too rare" if np.isnan(value) else f"{value:.3g}" for name, value in gains.items()},
    }
