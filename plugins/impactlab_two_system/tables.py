"""The corrections to the paper as a table of the report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from impactlab_two_system.results import Measured

if TYPE_CHECKING:
    from impactlab_two_system.study import TwoSystemStudy


def tables(study: TwoSystemStudy, tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the corrections."""
    table = tree["corrections"].to_dataset()
    yield (
        "Corrections to the paper",
        [
            {
                "correction": int(row.correction),
                "quantity": str(row.quantity.item()),
                "units": str(row.units.item()),
                "paper": "" if np.isnan(row.paper) else f"{float(row.paper):.4g}",
                "found": f"{Measured(float(row.found), float(row.found_standard_error))}",
            }
            for row in (table.isel(row=index) for index in range(table.sizes["row"]))
        ],
    )
