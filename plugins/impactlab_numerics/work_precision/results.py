"""Results of the work-precision study as claims, tables and figures read them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab_numerics.work_precision.methods import Findings, Method
from impactlab_numerics.work_precision.study import PAIR

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy


class Results:
    """Access to a tree of results by the names of the study."""

    def __init__(self, study: WorkPrecisionStudy, tree: xr.DataTree) -> None:
        self.study = study
        self.methods = tree["methods"].to_dataset()
        self.speed = tree["speed"].to_dataset()
        self.contributions = tree["contributions"].to_dataset()
        self.paths = tree["paths"].to_dataset()
        self.tolerances = tree["tolerances"].to_dataset() if "tolerances" in tree.children else None

    @property
    def default(self) -> str:
        """The case that `simulate` takes when nothing is chosen, in the pair."""
        return Method(PAIR, "impactlab", "exact flow", "white", 0.0).key

    @property
    def paper(self) -> str:
        """The case that is done as in the paper: Runge-Kutta with series by FFT, in a loop of numba."""
        return Method(PAIR, "numba", "Runge–Kutta", "series", self.study.paper_step).key

    def cases(self, scene: str) -> list[str]:
        """Names of the cases of a scene."""
        return [str(case) for case in self.methods["case"].values[self.methods["scene"].values == scene]]

    def findings(self, case: str) -> Findings:
        """Return the findings of a case."""
        row = self.methods.sel(case=case)
        bias, error, scatter, direct = (
            row[name].values for name in ("bias", "bias_error", "scatter", "direct_scatter")
        )
        step, rate, startup = (float(row[name]) for name in ("step", "rate", "startup"))
        return Findings(bias, error, scatter, direct, step, rate, startup)

    def seconds(self, case: str, accuracy: float, name: str = "seconds_to") -> float:
        """Return the run time of a case to an accuracy in E[x²]."""
        return float(self.methods[name].sel(case=case, accuracy=accuracy)[0])

    def path_seconds(self, network: str, line: str, error: float) -> float:
        """Return the shortest time of a method to a path with an error (m) at most; infinite if it has none."""
        paths = self.paths
        rows = (paths["network"] == network) & (paths["line"] == line) & (paths["error"] <= error)
        return float(paths["seconds"].values[rows.values].min(initial=np.inf))

    def body_steps(self, run: str) -> float:
        """Return the steps of a body per second of a run, the median of the rounds."""
        return float(self.speed["body_steps_per_second"].sel(run=run))


def time_text(seconds: float) -> str:
    """Return a time with two digits in a unit that suits it."""
    if np.isnan(seconds):
        return "unknown"
    if np.isinf(seconds):
        return "never"
    for limit, unit, size in ((1.0, "ms", 1e-3), (120.0, "s", 1.0), (7200.0, "min", 60.0), (172800.0, "h", 3600.0)):
        if seconds < limit:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{seconds / 86400.0:.2g}'):g} d"
