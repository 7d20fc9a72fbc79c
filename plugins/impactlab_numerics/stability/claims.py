"""Claims of the stability study and their verdicts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab.studies.claims import Claim, verdict_of
from impactlab_numerics.stability.cells import ALLOWED, CLASSES
from impactlab_numerics.stability.collect import AUTOMATIC, DEFAULT, METHODS
from impactlab_numerics.stability.wild_runs import BAD

if TYPE_CHECKING:
    from impactlab_numerics.stability.study import StabilityStudy

BROKEN = ("degraded", "unstable")
"""Classes that no cell of the default method at its own step may have."""


def claims(study: StabilityStudy, tree: xr.DataTree) -> list[Claim]:
    """Return the claims."""
    cells, paper, wild = (tree[name].to_dataset() for name in ("cells", "paper", "wild"))
    return [
        *(_automatic(cells, noise) for noise in dict.fromkeys(cells.noise.values.tolist())),
        *(_safe(cells, type(method).__name__) for method in METHODS),
        _of_paper(paper),
        _of_wild(wild),
    ]


def chosen(cells: xr.Dataset, **wanted: str) -> xr.Dataset:
    """Return the rows in which columns have the given values."""
    found = np.ones(cells.sizes["cell"], dtype=bool)
    for name, value in wanted.items():
        found &= cells[name].values == value
    return cells.isel(cell=np.flatnonzero(found))


def counts(kinds: np.ndarray) -> dict[str, int]:
    """Return how many cells are of each class."""
    return {kind: int((kinds == kind).sum()) for kind in CLASSES}


def _spelled(numbers: dict[str, int]) -> str:
    return ", ".join(f"{number} {kind}" for kind, number in numbers.items() if number) or "none"


def _worst(cells: xr.Dataset) -> str:
    """Say how far off the worst statistics of accurate cells are, and how well that is known."""
    rows = chosen(cells, kind="accurate")
    if not rows.sizes["cell"]:
        return ""
    deviation, error = (100.0 * np.abs(rows[name].values).max() for name in ("deviation", "standard_error"))
    return (
        f"; the worst statistics of accurate cells are up to {deviation:.2f} % off, with standard errors up to "
        f"{error:.2f} %"
    )


def _automatic(cells: xr.Dataset, noise: str) -> Claim:
    rows = chosen(cells, method=DEFAULT, noise=noise, label=AUTOMATIC)
    kinds = rows.kind.values
    seen = kinds == "accurate"
    return Claim(
        "automatic step",
        f"Under {'white' if noise == 'white' else 'bounded'} noise the default method at its automatic step is "
        f"accurate to {ALLOWED:.0%} in every cell, or refused with the reason.",
        f"{len(kinds)} cells: {_spelled(counts(kinds))}{_worst(rows)}",
        verdict_of(not np.isin(kinds, BROKEN).any(), bool(seen.any() or np.isin(kinds, BROKEN).any())),
        figure=f"stability_{DEFAULT}_{noise}",
    )


def _safe(cells: xr.Dataset, method: str) -> Claim:
    rows = chosen(cells, method=method)
    kinds = counts(rows.kind.values)
    run = kinds["accurate"] + kinds["degraded"] + kinds["unstable"]
    return Claim(
        "largest step",
        f"No step that {method} accepts makes it unstable.",
        f"{run} cells were run: {_spelled({kind: kinds[kind] for kind in CLASSES[:3]})}",
        verdict_of(kinds["unstable"] == 0, run > 0),
        figure=f"stability_{method}_white",
    )


def _of_paper(paper: xr.Dataset) -> Claim:
    kinds = paper.kind.values
    accurate = [
        f"ω₁/ω₂ = {ratio:g} at {stiffness:g}"
        for ratio, stiffness, kind in zip(paper.frequency_ratio.values, paper.stiffness.values, kinds, strict=True)
        if kind == "accurate"
    ]
    return Claim(
        "paper",
        f"Runge–Kutta at the paper's step of {1e3 * paper.attrs['step']:g} ms is accurate to {ALLOWED:.0%} everywhere.",
        f"{_spelled(counts(kinds))}{_worst(paper)}; accurate: {', '.join(accurate) or 'nowhere'}",
        verdict_of(bool((kinds == "accurate").all()), len(kinds) > 0),
        figure="stability_paper",
    )


def _of_wild(wild: xr.Dataset) -> Claim:
    outcomes = wild.outcome.values
    found = {kind: int((outcomes == kind).sum()) for kind in dict.fromkeys(sorted(outcomes.tolist()))}
    return Claim(
        "wild scenes",
        "No valid scene ends in a silent NaN, hangs, crashes, or leaves a balance open without a warning.",
        _spelled(found),
        verdict_of(not np.isin(outcomes, BAD).any(), len(outcomes) > 0),
    )
