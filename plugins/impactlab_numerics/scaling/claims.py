"""Claims of the scaling study and their verdicts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab.studies.claims import Claim, shown_in, verdict_of

if TYPE_CHECKING:
    from impactlab_numerics.scaling.study import ScalingStudy

ENSEMBLE = 1.5
"""Largest cost of an ensemble relative to the pair's."""

SINGLE = 2.5
"""Largest cost of one realization relative to the pair's."""

LARGE = 1000
"""Bodies from which one realization is held to it."""

BYTES = 1000.0
"""Most memory per body and realization."""

MANY = 100000
"""Bodies of a network whose construction is timed."""

BUILD = 2.0
"""Longest time of its construction (s)."""

GAINS = {0.2: 1.0, 4.0: 8.0, 6.0: 12.0}
"""Least gain at equal error by clearance in σ."""

SERIES = 10.0
"""Least gain of bounded noise over Runge–Kutta."""

RECORDS = {"observable": 0.1, "energy flows": 0.25}
"""Most time that records add to a run, by the beginning of their names."""

ACCURACY = 5e-4
"""Allowed relative deviation from the exact law."""

SURE = 4.5
"""Standard errors that are allowed in addition."""


def claims(study: ScalingStudy, tree: xr.DataTree) -> list[Claim]:
    """Return the claims."""
    size, clearance = (tree[name].to_dataset() for name in ("size", "clearance"))
    return [
        *shown_in(
            "cost_against_size",
            [_cost(size, "ensemble", ENSEMBLE, 2), _cost(size, "single", SINGLE, LARGE), _memory(size)],
        ),
        _build(size),
        *shown_in("cost_against_clearance", (_gain(clearance, place, least) for place, least in GAINS.items())),
        _exact(tree["exactness"].to_dataset()),
        _series(tree["series"].to_dataset()),
        _sweep(tree["sweep"].to_dataset()),
        *(_records(tree["records"].to_dataset(), kind, most) for kind, most in RECORDS.items()),
    ]


def _cost(size: xr.Dataset, kind: str, most: float, least: int) -> Claim:
    what = "An ensemble of a chain" if kind == "ensemble" else f"One realization of a chain of at least {least} bodies"
    statement = f"{what} costs at most {most:g} times as much per step of a body as an ensemble of the pair."
    chosen = np.flatnonzero((size.graph.values == "chain") & (size.bodies.values >= least))
    if not len(chosen):
        return Claim("size", statement, f"no chain of {least} bodies", "not testable")
    costs = size.relative_cost.sel(kind=kind).values[chosen]
    rows = [f"{cost:.2f} for {bodies}" for cost, bodies in zip(costs, size.bodies.values[chosen], strict=True)]
    return Claim("size", statement, f"{', '.join(rows)} bodies", verdict_of(bool((costs <= most).all())))


def _memory(size: xr.Dataset) -> Claim:
    """Judge ensembles, and large networks in one realization; small ones have tables that count."""
    ensembles, single = size.memory.sel(kind="ensemble").values, size.memory.sel(kind="single").values
    single = single[size.bodies.values >= LARGE]
    measured = f"{ensembles.min():.0f} to {ensembles.max():.0f} bytes in ensembles"
    if len(single):
        measured += f"; {single.min():.0f} to {single.max():.0f} bytes in one realization of at least {LARGE} bodies"
    fits = bool((ensembles < BYTES).all()), bool((single < BYTES).all())
    return Claim(
        "size",
        f"A simulation needs less than {BYTES:g} bytes per body and realization.",
        measured,
        "holds" if all(fits) else "holds partly" if any(fits) else "does not hold",
    )


def _build(size: xr.Dataset) -> Claim:
    statement = f"A network of {MANY} bodies is made in less than {BUILD:g} s."
    chosen = np.flatnonzero(size.bodies.values >= MANY)
    if not len(chosen):
        return Claim("size", statement, "no such network", "not testable")
    seconds = float(size.build_time.values[chosen].max())
    return Claim("size", statement, f"{seconds:.2f} s", verdict_of(seconds < BUILD))


def _gain(table: xr.Dataset, clearance: float, least: float) -> Claim:
    """Judge the least gain of all statistics; where contacts are too rare to see them, the run time alone."""
    statement = f"With a clearance of {clearance:g} σ the default method takes 1/{least:g} of the time, or less."
    if least == 1.0:
        statement = "In the base case the default method is not slower than one that makes every step."
    if clearance not in table.clearance.values:
        return Claim("clearance", statement, "not measured", "not testable")
    row = table.sel(clearance=clearance)
    quicker, noise = float(row.quicker), float(row.noise)
    measured = f"{quicker:.2f} times quicker (± {100.0 * noise:.1f} %)"
    if np.isnan(row.gain).all():
        gain = quicker
        measured += "; contacts are too rare for standard errors, which are taken as equal"
    else:
        gain = float(row.gain.min())
        named = [f"{float(row.gain.sel(statistic=name)):.2f} for {name}" for name in row.statistic.values]
        measured += f"; at equal error {', '.join(named)}"
    verdict = "sampling error" if least > gain >= least * (1.0 - 2.0 * noise) else verdict_of(gain >= least)
    return Claim("clearance", statement, measured, verdict)


def _exact(table: xr.Dataset) -> Claim:
    ratio = table.isel(comparison=int(np.flatnonzero(table.statistic.values == "contact_ratio")[0]))
    error = float(ratio.standard_error / ratio.reference)
    known = error <= 1.2 * ACCURACY
    return Claim(
        "exactness",
        f"Jumps leave no bias: all statistics agree with the exact law, the contact ratio to {ACCURACY:.2%}.",
        f"contact ratio {float(ratio.relative_difference):.4%} ± {error:.4%}; at most "
        f"{np.nan_to_num(np.abs(table.z)).max():.1f} standard errors",
        verdict_of(float(beyond(table).max()) <= SURE) if known else "not testable",
    )


def beyond(table: xr.Dataset) -> np.ndarray:
    """Return by how many standard errors differences exceed the allowed ones; 0 without standard errors."""
    excess = (np.abs(table.difference) - ACCURACY * np.abs(table.reference)) / table.standard_error
    return np.asarray(np.nan_to_num(excess.values))


def _series(table: xr.Dataset) -> Claim:
    own, other = table.cost.values
    return Claim(
        "bounded noise",
        f"A series of {table.attrs['components']} cosines takes 1/{SERIES:g} of the time of Runge–Kutta, or less.",
        f"{1e3 * own:.3g} ms at a step of {1e3 * float(table.step[0]):.3g} ms, against {1e3 * other:.3g} ms at "
        f"{1e3 * float(table.step[1]):g} ms for {table.attrs['period']:g} s: {other / own:.1f} times",
        verdict_of(SERIES * own <= other),
    )


def _records(table: xr.Dataset, kind: str, most: float) -> Claim:
    names = [name for name in table.record.values.tolist() if name.startswith(kind)]
    added = table.added.sel(record=names)
    measured = f"{float(added.min()):.0%} to {float(added.max()):.0%}"
    statement = f"{kind.capitalize()}: at most {most:.0%} more time, in chains of up to {int(table.bodies.max())}."
    return Claim("records", statement, measured, verdict_of(float(added.max()) <= most))


def _sweep(table: xr.Dataset) -> Claim:
    return Claim(
        "sweep",
        "A sweep over a number compiles nothing after its first point.",
        f"{int(table.compilations)} functions for {int(table.points)} points",
        verdict_of(int(table.compilations) == 0),
    )
