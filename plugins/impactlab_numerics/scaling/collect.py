"""From the simulations of the scaling study, and from timing, to one tree of results."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import impactlab as il
from impactlab.compiling.jit import compilations
from impactlab.machine import tuning
from impactlab_numerics.baselines.loops import series_loop
from impactlab_numerics.scaling.record_costs import cost_of_records
from impactlab_numerics.scaling.study import METHODS, SEEN, SHORTEST, closing_rate
from impactlab_numerics.scenes import GRAPHS, scene
from impactlab_numerics.timing import Blocks, Stopwatch, Whole, in_rounds, peak_memory

if TYPE_CHECKING:
    from impactlab_numerics.scaling.study import ScalingStudy

KINDS = ("single", "ensemble")
"""How networks are run: one realization, or a block of them."""

COMPARED = {
    "contact ratio": ("contact_ratio", "contact"),
    "mean contact force": ("mean_contact_force", "contact"),
    "E[x²] of the stiff body": ("mean_square_displacement", "body_0"),
    "E[x²] of the soft body": ("mean_square_displacement", "body_1"),
}
"""Variable and label, or its beginning, of the statistics that are compared at each clearance."""

FROM_REST: dict[str, Any] = {"integrator": il.ExactFlow(jumps=False, measured=False), "initial": "rest", "spin_up": 0.0}
"""How networks are run: every step is made, and no random start without overlaps is looked for."""

FEW_STEPS = 0.1
"""Duration of about 20 steps (s)."""

BODY_LANES = 400000
"""Bodies times realizations of the ensemble of a large network, about."""

MOST_BODIES = 100
"""Bodies up to which the cost of records is measured."""

BINS = 100
"""Bins of the density that the loop of Runge-Kutta counts."""

BATCH = 64
"""Realizations of bounded noise in a batch that is timed."""

Columns = tuple[tuple[str, ...], Any, str, str]


def collect(study: ScalingStudy, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return the tree of results.

    Groups: ``size`` (cost per step of a body, memory and preparation of networks), ``clearance`` (cost,
    scatter and deviation from the exact law of both methods), ``exactness`` (a long run against the
    exact law), ``series`` (bounded noise), ``sweep`` (what a sweep compiles), ``records`` (what records add).
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.AccuracyWarning)  # runs that are timed are short
        nodes = {
            "/size": _size(study),
            "/clearance": _clearance(study, results),
            "/exactness": il.compare(results["exactness"], il.exact(study.apart(study.exact_clearance))),
            "/series": _series(study),
            "/sweep": _sweep(study),
            "/records": cost_of_records(
                [size for size in study.sizes if size <= MOST_BODIES], study.timing_seconds, study.rounds
            ),
        }
    return xr.DataTree.from_dict(nodes)


def realizations_of(kind: str, bodies: int) -> int:
    """Return the realizations of a network that is timed: few of a large one, since they share the cache."""
    return 1 if kind == "single" else min(tuning().lanes, max(8, BODY_LANES // bodies))


def _size(study: ScalingStudy) -> xr.Dataset:
    """Time the steps of networks as ensembles and single realizations, and measure memory and preparation."""
    build, memory, timers = [], [], {}
    for graph, bodies in study.graphs():
        begin = time.process_time()
        network = GRAPHS[graph](bodies)
        build.append(time.process_time() - begin)
        for kind in KINDS:
            options = {"realizations": realizations_of(kind, bodies), **FROM_REST}
            timers[graph, bodies, kind] = Blocks(network, options, study.timing_seconds, FEW_STEPS)
            memory.append(peak_memory(network, FEW_STEPS, **options) / bodies / options["realizations"])
    found = in_rounds(timers, study.rounds)
    graphs = study.graphs()
    rates = np.array([[[rate for rate, _ in found[(*case, kind)]] for kind in KINDS] for case in graphs])
    steps = np.array([[timers[(*case, kind)].result.attrs["step"] for kind in KINDS] for case in graphs])
    cost = rates * (steps / np.array([[bodies] for _, bodies in graphs]))[..., None]
    least = cost.min(axis=-1)
    rest = [min(rest for _, rest in found[(*case, "single")]) for case in graphs]
    both, alone = ("network", "kind"), ("network",)
    return _dataset(
        {"network": [f"{graph} of {bodies}" for graph, bodies in graphs], "kind": list(KINDS)},
        graph=(alone, [graph for graph, _ in graphs], "", "graph"),
        bodies=(alone, [bodies for _, bodies in graphs], "1", "number of bodies"),
        realizations=(
            both, [[realizations_of(kind, bodies) for kind in KINDS] for _, bodies in graphs], "1", "realizations",
        ),
        cost_by_round=((*both, "round"), cost, "s", "time of one core for a step of a body, by round"),
        cost=(both, least, "s", "least time of one core for a step of a body"),
        relative_cost=(both, least / least[0, -1], "1", "cost relative to the pair in an ensemble"),
        build_time=(alone, build, "s", "time to make the network"),
        preparation=(alone, rest, "s", "time of a simulation for planning and estimates"),
        memory=(both, np.reshape(memory, cost.shape[:2]), "byte", "memory per body and realization"),
    )  # fmt: skip


def _clearance(study: ScalingStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return cost, scatter and deviations of both methods, and the gain of the default method at equal error."""
    places = [(clearance, method) for clearance in study.clearances for method in METHODS]
    timers = {}
    for clearance, method in places:
        options = {
            "realizations": study.realizations,
            "integrator": il.ExactFlow(jumps=METHODS[method], measured=False),
        }
        timers[clearance, method] = Blocks(study.apart(clearance), options, study.timing_seconds, SHORTEST / 8.0)
    found = in_rounds(timers, study.rounds)
    cost = np.array([[rate for rate, _ in found[place]] for place in places])
    scatter, z = np.array([_judged(study.apart(key[0]), results[f"{key[1]}_{key[0]:g}"]) for key in places]).swapaxes(
        0, 1
    )
    shape = len(study.clearances), len(METHODS)
    cost, scatter, z = (item.reshape(*shape, -1) for item in (cost, scatter, z))
    least = cost.min(axis=-1)
    work = least[..., None] * scatter
    both, contacts = (
        ("clearance", "scheme"),
        [
            closing_rate(study.apart(clearance))
            * results[f"steps_{clearance:g}"].attrs["duration"]
            * study.realizations
            for clearance in study.clearances
        ],
    )
    jump = [results[f"jumps_{clearance:g}"].attrs.get("longest_jump", 0.0) for clearance in study.clearances]
    timed = [timers[clearance, "jumps"].result.attrs.get("longest_jump", 0.0) for clearance in study.clearances]
    return _dataset(
        {"clearance": list(study.clearances), "scheme": list(METHODS), "statistic": list(COMPARED)},
        cost_by_round=((*both, "round"), cost, "1", "time of one core for a second of one realization, by round"),
        cost=(both, least, "1", "least time of one core for a second of one realization"),
        quicker=(("clearance",), least[:, 1] / least[:, 0], "1", "cost of every step over that of the default method"),
        noise=(("clearance",), _noise(cost), "1", "relative standard error of that ratio by the scatter of rounds"),
        longest_jump=(("clearance",), jump, "s", "longest jump"),
        timed_jump=(("clearance",), timed, "s", "longest jump of the runs that are timed"),
        contacts=(("clearance",), contacts, "1", "contacts that are expected in the runs"),
        scatter=((*both, "statistic"), scatter, "s", "squared relative standard error times simulated time"),
        z=((*both, "statistic"), z, "1", "deviation from the exact law in standard errors"),
        gain=(("clearance", "statistic"), work[:, 1] / work[:, 0], "1", "gain of the default method at equal error"),
    )


def _noise(cost: np.ndarray) -> np.ndarray:
    """Return the standard error of the mean logarithm of ratios within rounds, (clearance,)."""
    ratios = np.log(cost[:, 1] / cost[:, 0])
    rounds = ratios.shape[1]
    return np.asarray(ratios.std(axis=1) / np.sqrt(max(rounds - 1, 1)))


def _judged(network: il.Network, result: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return scatter and z of `COMPARED`, NaN where too few contacts are expected for a standard error."""
    rows = il.compare(result, il.exact(network))
    total = result.attrs["duration"] * result.attrs["realizations"]
    if closing_rate(network) * total < SEEN:
        return np.full(len(COMPARED), np.nan), np.full(len(COMPARED), np.nan)
    chosen = [
        next(
            row
            for row in range(rows.sizes["comparison"])
            if rows.statistic[row] == name and str(rows.label[row].item()).startswith(label)
        )
        for name, label in COMPARED.values()
    ]
    rows = rows.isel(comparison=chosen)
    return (rows.standard_error / rows.reference).values ** 2 * total, rows.z.values


def _series(study: ScalingStudy) -> xr.Dataset:
    """Time bounded noise: the default method with its automatic step, and Runge-Kutta as the paper has it."""
    network, duration = study.shaken(), 0.8 * study.period
    options: dict[str, Any] = {"spin_up": 0.2 * study.period, "initial": "rest"}

    def simulate(batches: int) -> xr.Dataset:
        return il.simulate(
            network, duration, realizations=BATCH * batches, **options, rng=1, executor=Stopwatch(), progress=False
        )

    loop = series_loop(scene(2), study.paper_step, BINS, study.seed, study.components, study.band)
    timers = {
        "impactlab": Whole(simulate, BATCH * duration, study.timing_seconds, time.process_time),
        "Runge–Kutta": Whole(loop.run, loop.batch, study.timing_seconds, time.process_time),
    }
    found = in_rounds(timers, study.rounds)
    cost = np.array([[rate for rate, _ in found[name]] for name in timers]) * study.period
    return _dataset(
        {"scheme": list(timers)},
        step=(("scheme",), [simulate(1).attrs["step"], study.paper_step], "s", "step"),
        cost_by_round=(("scheme", "round"), cost, "s", "time for a realization of one period, by round"),
        cost=(("scheme",), cost.min(axis=-1), "s", "least time of one core for a realization of one period"),
    ).assign_attrs(period=study.period, components=study.components)


def _sweep(study: ScalingStudy) -> xr.Dataset:
    """Count the functions that a sweep over parameters compiles after its first point."""
    over = {"clearance": list(study.clearances)}
    options: dict[str, Any] = {"duration": SHORTEST, "realizations": 64, "rng": study.seed, "progress": False}
    il.simulate(study.apart(study.clearances[0]), **options)
    before = compilations()
    sweep = il.sweep(study.apart, over, **options)
    return _dataset(
        {},
        points=((), sweep.sizes["clearance"], "1", "points"),
        compilations=((), compilations() - before, "1", "functions that were compiled after the first point"),
        done=((), int((sweep.status == "done").sum()), "1", "points that were simulated"),
    )


def _dataset(coordinates: dict[str, Any], **columns: Columns) -> xr.Dataset:
    """Return variables from (dims, values, units, long_name)."""
    data = {
        name: (dims, values, {"units": units, "long_name": text})
        for name, (dims, values, units, text) in columns.items()
    }
    return xr.Dataset(data, coordinates)
