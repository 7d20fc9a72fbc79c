"""What the scaling study claims, its verdicts, and its tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from impactlab.studies import Check
from impactlab_numerics.verdicts import Claim, table_of, verdict_of

ENSEMBLE, SINGLE, LARGE = 1.5, 2.5, 1000
"""Largest cost relative to the pair's, and the number of bodies from which one realization is held to it."""

BYTES, MANY, BUILD = 1000.0, 100000, 2.0
"""Most memory per body and realization, and the time to make so many bodies (s)."""

GAINS = {0.2: 1.0, 4.0: 8.0, 6.0: 12.0}
"""Least gain at equal error by clearance in σ."""

SERIES = 10.0
"""Least gain of bounded noise over Runge–Kutta."""

ACCURACY, SURE = 5e-4, 4.5
"""Relative deviation from the exact law that is allowed, and standard errors besides."""


def judge(tree: xr.DataTree) -> xr.Dataset:
    """Return the table of claims."""
    size, clearance = (tree[name].to_dataset() for name in ("size", "clearance"))
    claims = [
        _cost(size, "ensemble", ENSEMBLE, 2),
        _cost(size, "single", SINGLE, LARGE),
        _memory(size),
        _build(size),
        *(_gain(clearance, place, least) for place, least in GAINS.items()),
        _exact(tree["exactness"].to_dataset()),
        _series(tree["series"].to_dataset()),
        _sweep(tree["sweep"].to_dataset()),
    ]
    return table_of(claims)


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
    """Return by how many standard errors differences exceed what is allowed; without standard errors, 0."""
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


def _sweep(table: xr.Dataset) -> Claim:
    return Claim(
        "sweep",
        "A sweep over a number compiles nothing after its first point.",
        f"{int(table.compilations)} functions for {int(table.points)} points",
        verdict_of(int(table.compilations) == 0),
    )


def check(tree: xr.DataTree) -> list[Check]:
    """Return what must hold on any machine: nothing about times but that they are there."""
    size, clearance, exactness, series, sweep = (
        tree[name].to_dataset() for name in ("size", "clearance", "exactness", "series", "sweep")
    )
    times = np.concatenate([table.cost_by_round.values.ravel() for table in (size, clearance, series)])
    z, excess = float(np.nan_to_num(np.abs(clearance.z)).max()), float(beyond(exactness).max())
    timed, made = (clearance[name].values > 0.0 for name in ("timed_jump", "longest_jump"))
    done, points = int(sweep.done), int(sweep.points)
    return [
        Check("run times", bool((np.isfinite(times) & (times > 0.0)).all()), f"{times.size} measurements"),
        Check("exact at all clearances", z <= SURE, f"at most {z:.2f} standard errors, allowed {SURE:g}"),
        Check("exact in a long run", excess <= SURE, f"at most {excess:.2f} standard errors beyond {ACCURACY:.2%}"),
        Check("jumps are timed", bool((timed == made).all()), f"at {int(timed.sum())} of {timed.size} clearances"),
        Check("sweep", done == points, f"{done} of {points} points were simulated"),
    ]


def tables(tree: xr.DataTree) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield size, clearance, exactness and bounded noise."""
    size = tree["size"].to_dataset()
    yield "Cost and memory against size", [_network(size.sel(network=name)) for name in size.network]
    clearance = tree["clearance"].to_dataset()
    yield "Cost against clearance", [_place(clearance.sel(clearance=place)) for place in clearance.clearance]
    exactness = tree["exactness"].to_dataset()
    yield (
        "Default method against the exact law",
        [
            {
                "statistic": row.statistic.item(),
                "of": row.label.item(),
                "difference (%)": f"{100.0 * row.relative_difference.item():.4f}",
                "standard errors": f"{row.z.item():.2f}",
            }
            for row in (exactness.isel(comparison=index) for index in range(exactness.sizes["comparison"]))
        ],
    )
    series = tree["series"].to_dataset()
    yield (
        f"Bounded noise: a realization of {series.attrs['period']:g} s, {series.attrs['components']} cosines",
        [
            {
                "method": str(name),
                "step (ms)": f"{1e3 * float(series.step.sel(scheme=name)):.3g}",
                "time (ms)": f"{1e3 * float(series.cost.sel(scheme=name)):.3g}",
            }
            for name in series.scheme.values
        ],
    )


def _network(row: xr.Dataset) -> dict[str, Any]:
    return {
        "network": row.network.item(),
        **{
            f"{kind}: ns per step of a body (relative)": f"{1e9 * float(row.cost.sel(kind=kind)):.2f} "
            f"({float(row.relative_cost.sel(kind=kind)):.2f})"
            for kind in row.kind.values
        },
        "realizations of the ensemble": int(row.realizations.sel(kind="ensemble")),
        **{f"{kind}: bytes per body": f"{row.memory.sel(kind=kind).item():.0f}" for kind in row.kind.values},
        "made in (s)": f"{row.build_time.item():.2g}",
        "planning and estimates (s)": f"{row.preparation.item():.2g}",
    }


def _place(row: xr.Dataset) -> dict[str, Any]:
    gains = {f"gain, {name}": row.gain.sel(statistic=name).item() for name in row.statistic.values}
    return {
        "clearance (σ)": f"{row.clearance.item():g}",
        "longest jump (s)": f"{row.longest_jump.item():.3g}",
        **{f"ns per second, {name}": f"{1e9 * float(row.cost.sel(scheme=name)):.3g}" for name in row.scheme.values},
        "run time": f"{row.quicker.item():.2f}",
        **{name: "too rare" if np.isnan(value) else f"{value:.3g}" for name, value in gains.items()},
    }
