"""What the stability study claims, its verdicts, and its tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from impactlab.studies import Check
from impactlab_numerics.stability_cells import ALLOWED, CLASSES, SURE
from impactlab_numerics.stability_collect import AUTOMATIC, DEFAULT, METHODS
from impactlab_numerics.verdicts import Claim, table_of, verdict_of
from impactlab_numerics.wild import BAD

BROKEN = ("degraded", "unstable")
"""What no cell of the default method at its own step may be."""


def judge(tree: xr.DataTree) -> xr.Dataset:
    """Return the table of claims."""
    cells, paper, wild = (tree[name].to_dataset() for name in ("cells", "paper", "wild"))
    claims = [
        *(_automatic(cells, noise) for noise in dict.fromkeys(cells.noise.values.tolist())),
        *(_safe(cells, type(method).__name__) for method in METHODS),
        _of_paper(paper),
        _of_wild(wild),
    ]
    return table_of(claims)


def chosen(cells: xr.Dataset, **wanted: str) -> xr.Dataset:
    """Return the rows in which columns have some values."""
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


def check(tree: xr.DataTree) -> list[Check]:
    """Return what must hold on any machine."""
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


def tables(tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
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
