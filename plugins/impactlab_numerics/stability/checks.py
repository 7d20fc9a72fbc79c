"""Checks that pass on any machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab.studies import Check
from impactlab_numerics.stability.cells import CLASSES
from impactlab_numerics.stability.claims import BROKEN, chosen
from impactlab_numerics.stability.collect import AUTOMATIC, DEFAULT
from impactlab_numerics.stability.wild_runs import BAD

if TYPE_CHECKING:
    from impactlab_numerics.stability.study import StabilityStudy


def checks(study: StabilityStudy, tree: xr.DataTree) -> list[Check]:
    """Return the checks that pass on any machine."""
    cells, wild = tree["cells"].to_dataset(), tree["wild"].to_dataset()
    own = chosen(cells, method=DEFAULT, label=AUTOMATIC)
    wrong = np.flatnonzero(np.isin(own.kind.values, BROKEN))
    named = [_place(own.isel(cell=index)) for index in wrong]
    bad = np.flatnonzero(np.isin(wild.outcome.values, BAD))
    unexplained = int(((np.isin(cells.kind.values, CLASSES[3:])) & (cells.reason.values == "")).sum())
    return [
        Check("automatic step", not len(wrong), "; ".join(named) or f"{own.sizes['cell']} cells"),
        Check("refusals have reasons", unexplained == 0, f"{unexplained} without"),
        Check(
            "wild scenes",
            not len(bad),
            "; ".join(f"{int(wild.scene[k])}: {wild.outcome.values[k]}, {wild.detail.values[k]}" for k in bad)
            or f"{wild.sizes['scene']} scenes",
        ),
    ]


def _place(row: xr.Dataset) -> str:
    return (
        f"{row.axis.item()} {float(row.value):g}, {row.noise.item()}: {row.kind.item()}, {row.statistic.item()} "
        f"{100.0 * float(row.deviation):.2f} ± {100.0 * float(row.standard_error):.2f} %"
    )
