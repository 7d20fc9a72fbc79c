"""Checks that pass on any machine: run times only have to exist."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab.studies import Check
from impactlab_numerics.scaling.claims import ACCURACY, SURE, beyond

if TYPE_CHECKING:
    from impactlab_numerics.scaling.study import ScalingStudy


def checks(study: ScalingStudy, tree: xr.DataTree) -> list[Check]:
    """Return the checks that pass on any machine: run times only have to exist.

    They are differences, below 0 in a round in which something else kept the machine busy for a moment.
    """
    size, clearance, exactness, series, sweep = (
        tree[name].to_dataset() for name in ("size", "clearance", "exactness", "series", "sweep")
    )
    times = np.concatenate([table.cost_by_round.max("round").values.ravel() for table in (size, clearance, series)])
    z, excess = float(np.nan_to_num(np.abs(clearance.z)).max()), float(beyond(exactness).max())
    timed, made = (clearance[name].values > 0.0 for name in ("timed_jump", "longest_jump"))
    done, points = int(sweep.done), int(sweep.points)
    return [
        Check("run times", bool((np.isfinite(times) & (times > 0.0)).all()), f"of {times.size} cases"),
        Check("exact at all clearances", z <= SURE, f"at most {z:.2f} standard errors, allowed {SURE:g}"),
        Check("exact in a long run", excess <= SURE, f"at most {excess:.2f} standard errors beyond {ACCURACY:.2%}"),
        Check("jumps are timed", bool((timed == made).all()), f"at {int(timed.sum())} of {timed.size} clearances"),
        Check("sweep", done == points, f"{done} of {points} points were simulated"),
    ]
