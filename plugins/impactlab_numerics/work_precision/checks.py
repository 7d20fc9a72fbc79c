"""Checks that pass on any machine: run times only have to exist."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab.studies import Check
from impactlab_numerics.scenes import STATISTICS
from impactlab_numerics.work_precision.results import Results

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy

BIAS = 1e-3
"""Allowed relative bias of the default step."""

SAME = 0.05
"""Allowed relative bias of any method."""

PATH = 1e-5
"""Allowed error of a path, ten times the largest tolerance (m)."""

SURE = 4.0
"""Standard errors that are allowed in addition."""


def checks(study: WorkPrecisionStudy, tree: xr.DataTree) -> list[Check]:
    """Return the checks that pass on any machine: run times only have to exist."""
    results = Results(study, tree)
    methods = results.methods
    rates = methods["rate"].values[methods["note"].values != "not installed"]
    checks = [
        Check("run times", bool((np.isfinite(rates) & (rates > 0.0)).all()), f"{rates.size} cases"),
        *_biases("default method", results, methods["case"].str.contains("exact flow, white, automatic").values, BIAS),
        *_biases("all methods solve one problem", results, np.isfinite(methods["bias"].values).all(axis=1), SAME),
    ]
    paths = results.paths
    located = paths["error"].values[(paths["line"] == "impactlab: located events").values].max()
    checks.append(Check("paths of located events", bool(located <= PATH), f"errors up to {located:.1e} m"))
    if results.tolerances is not None:
        excess = 2.0 * results.tolerances["difference"].dropna("network")  # a tolerance holds 2 standard errors
        checks.append(Check("runs to a tolerance", bool((excess <= SURE).all()), _excess(excess.values)))
    return checks


def _biases(name: str, results: Results, chosen: np.ndarray, allowed: float) -> list[Check]:
    """Check that the biases of cases are within the allowed one and `SURE` standard errors."""
    rows = results.methods.isel(case=np.flatnonzero(chosen), statistic=slice(len(STATISTICS) - 1))
    excess = ((abs(rows["bias"]) - allowed) / rows["bias_error"]).values
    return [Check(f"{name}: bias", bool((excess <= SURE).all()), f"{_excess(excess)} beyond {allowed:.1%}")]


def _excess(excess: np.ndarray) -> str:
    return f"at most {excess.max():.2f} standard errors, allowed {SURE:g}"
