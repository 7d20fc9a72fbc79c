"""Cells and wild scenes by outcome, for the report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import xarray as xr

from impactlab_numerics.stability.cells import ALLOWED, SURE
from impactlab_numerics.stability.claims import chosen, counts
from impactlab_numerics.stability.collect import AUTOMATIC

if TYPE_CHECKING:
    from impactlab_numerics.stability.study import StabilityStudy


def tables(study: StabilityStudy, tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield how many cells are of each class, the automatic column, and how wild scenes ended."""
    cells, wild = tree["cells"].to_dataset(), tree["wild"].to_dataset()
    pairs = dict.fromkeys(zip(cells.method.values.tolist(), cells.noise.values.tolist(), strict=True))
    yield (
        "Cells by class",
        [
            {"method": method, "noise": noise, **counts(chosen(cells, method=method, noise=noise).kind.values)}
            for method, noise in pairs
        ],
    )
    own = chosen(cells, label=AUTOMATIC)
    yield (
        f"At the automatic step (accurate: {ALLOWED:.0%} and {SURE:g} standard errors)",
        [_automatic_row(own.isel(cell=index)) for index in range(own.sizes["cell"])],
    )
    outcomes = wild.outcome.values.tolist()
    yield "How wild scenes ended", [{"outcome": kind, "scenes": outcomes.count(kind)} for kind in sorted(set(outcomes))]


def _automatic_row(row: xr.Dataset) -> dict[str, Any]:
    judged = int(row.judged)
    worst = f"{100.0 * float(row.deviation):.2f} ± {100.0 * float(row.standard_error):.2f}" if judged else ""
    return {
        "method": row.method.item(),
        "noise": row.noise.item(),
        "changed": f"{row.axis.item()} {float(row.value):g}",
        "step (s)": f"{float(row.step):.3g}",
        "verdict": row.kind.item(),
        "statistics judged": judged,
        "worst (%)": worst,
        "of": row.statistic.item(),
        "reason": row.reason.item(),
    }
