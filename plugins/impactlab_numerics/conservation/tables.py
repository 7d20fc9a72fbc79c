"""Energies, reversals and orders, for the report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import xarray as xr

if TYPE_CHECKING:
    from impactlab_numerics.conservation.study import ConservationStudy


def tables(study: ConservationStudy, tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the energies at the end of each run, reversals and orders."""
    energy = tree["energy"].to_dataset()
    yield (
        "Energy at the end of each run",
        [
            {
                "scene": str(scene),
                "step (s)": f"{float(part.step):.3g}",
                "contacts": f"{float(part.contacts[-1]):.3g}",
                "relative error (root mean square)": f"{float(part.error[-1]):.1e}",
                "mean": f"{float(part.mean_error[-1]):.1e}",
            }
            for scene in energy.scene.values
            for part in (energy.sel(scene=scene).isel(halving=row) for row in range(energy.sizes["halving"]))
        ],
    )
    reversal = tree["reversal"].to_dataset()
    yield (
        "Distance from the start after a reversal",
        [
            {
                "scene": str(scene),
                "contacts": f"{float(part.contacts):.3g}",
                "median": f"{float(part.error):.1e}",
                "largest": f"{float(part.largest):.1e}",
                "copies": int(part.copies),
            }
            for scene in reversal.scene.values
            for part in (reversal.sel(scene=scene).isel(time=row) for row in range(reversal.sizes["time"]))
        ],
    )
    order = tree["order"].to_dataset()
    yield "Observed orders", [
        {"integrator": str(name), **{str(force): f"{float(order.order.sel(integrator=name, force=force)):.2f}"
                                     for force in order.force.values}}
        for name in order.integrator.values
    ]  # fmt: skip
