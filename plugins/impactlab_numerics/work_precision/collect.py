"""From the simulations of the work-precision study, and from timing, to one tree of results."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import impactlab as il
from impactlab.machine import cores, tuning
from impactlab_numerics.baselines import loops as baselines
from impactlab_numerics.scenes import STATISTICS, Law
from impactlab_numerics.timing import Ensemble, Measurement, Whole, in_rounds
from impactlab_numerics.work_precision.contributions import contributions
from impactlab_numerics.work_precision.methods import Findings, Method, of_batches, of_dataset, seconds_to, unknown
from impactlab_numerics.work_precision.paths import paths
from impactlab_numerics.work_precision.peers import LONG_RUN, SEGMENT, Peer, peers
from impactlab_numerics.work_precision.study import PAIR
from impactlab_numerics.work_precision.tolerances import tolerances

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy

Table = dict[Method, Findings]
Timers = dict[Any, Callable[[], Measurement]]

LOOPS = {"BAOAB": "baoab", "Euler–Maruyama": "euler_maruyama"}
LANES = tuning().lanes
"""Realizations of a full block."""

BLOCKS = (1, 8, 64, LANES)
SERIES_REALIZATIONS = 8  # each takes about 10 ms


def collect(study: WorkPrecisionStudy, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return the tree of results.

    Groups: ``methods`` (bias, scatter, run time and time to each accuracy, over case (a scheme at a
    step in a scene) and statistic), ``speed`` (steps of a body per second), ``contributions`` (what each device
    is worth), ``paths`` (runs without noise: error and time of each method), ``tolerances`` (runs to an accuracy that
    is asked for, with their real times).
    """
    table: Table = {}
    others: dict[Method, Peer] = {}
    for scene, network in study.scenes().items():
        law = Law.of(network, study.bins)
        table |= {method: of_dataset(results[method.key], law) for method in study.methods(scene)}
        table |= {method: _long_run(study, method, law) for method in study.baselines(scene)}
        table |= _solvers(study, scene, table)
        if study.peers and scene == PAIR:
            others = {Method(PAIR, peer.name, peer.scheme, "white", peer.step): peer for peer in peers()}
            table |= {method: _peer(study, peer, law) for method, peer in others.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.AccuracyWarning)  # runs that are timed are short
        timers = _timers(study, table)
        for method, peer in others.items():
            if peer.installed:
                timers[method] = Whole(peer.run, peer.batch, study.timing_seconds, time.process_time)
        found = in_rounds({**timers, **_speed_timers(study, table)}, study.rounds)
        without_noise = paths(study)
    for method in timers:
        rates, startups = np.array(found[method]).T
        table[method].rate, table[method].startup = float(np.median(rates)), float(np.median(startups))
        table[method].rates = list(rates)
    nodes = {"/methods": _methods(study, table), "/speed": _speed(study, table, found)}
    nodes["/contributions"] = contributions(study, table, nodes["/speed"])
    nodes["/paths"] = without_noise
    if study.tolerance:
        nodes["/tolerances"] = tolerances(study)
    return xr.DataTree.from_dict(nodes)


def make_loop(study: WorkPrecisionStudy, method: Method, number: int = 0) -> baselines.Loop:
    """Return the loop of a method, with a seed of its own for each number."""
    network, seed = study.scenes()[method.scene], study.seed + 1000 * number
    if method.noise == "series":
        return baselines.series_loop(network, method.step, study.bins, seed, study.components, study.band)
    return baselines.Loop(network, LOOPS[method.scheme], method.step, study.bins, seed)


def _long_run(study: WorkPrecisionStudy, method: Method, law: Law) -> Findings:
    """Run a loop long enough to see its bias."""
    first = make_loop(study, method)
    bodies = len(study.scenes()[method.scene].oscillators)
    batches = max(16, round(study.steps(method, bodies) * method.step / first.batch))
    found = baselines.in_parallel(lambda number: make_loop(study, method, number + 1), batches, cores())
    return of_batches(found, first.batch, law, method.step)


def _solvers(study: WorkPrecisionStudy, scene: str, table: Table) -> Table:
    """Return findings extrapolated from a brief run: bias unknown, scatter that of the same noise."""
    method = Method(scene, "scipy", "solve_ivp", "series", 0.001)
    like = table[Method(scene, "numba", "Runge–Kutta", "series", study.paper_step)]
    found = unknown(0.001, "extrapolated; bias not measured, taken as 0", like.scatter)
    found.rate = baselines.solve_ivp_rate(study.scenes()[scene], 2.0 * study.timing_seconds, study.seed)
    return {method: found}


def _peer(study: WorkPrecisionStudy, peer: Peer, law: Law) -> Findings:
    """Return the bias of another library, from a run that is not so long."""
    if not peer.installed:
        return unknown(peer.step, "not installed")
    peer.start(study.scenes()[PAIR], law.edges, study.seed)
    return of_batches(peer.run(LONG_RUN), LONG_RUN * SEGMENT, law, peer.step)


def _timers(study: WorkPrecisionStudy, table: Table) -> Timers:
    """Return a timer of each method, warmed up."""
    timers: Timers = {}
    for method, known in table.items():
        network, seconds = study.network(method), study.timing_seconds
        if method.tool == "impactlab" and method.noise == "white":
            options = {**study.options(method), "realizations": in_blocks_of(LANES)}
            del options["record"]  # samples every 40 steps or so, which does not show
            timers[method] = Ensemble(network, options, known.step, known.spin_up, seconds)
        elif method.tool == "impactlab":
            timers[method] = _series_timer(study, method)
        elif method.tool == "numba":
            loop = make_loop(study, method)
            timers[method] = Whole(loop.run, loop.batch, seconds)
    return timers


def _series_timer(study: WorkPrecisionStudy, method: Method) -> Whole:
    """Time impactlab under series, of which each realization needs its own, with all that belongs to it."""
    options = {**study.options(method), "duration": 0.8 * study.period}
    network, pool = study.network(method), ThreadPoolExecutor(1)

    def call(batches: int) -> None:
        realizations = SERIES_REALIZATIONS * batches
        il.simulate(network, **{**options, "realizations": realizations}, rng=1, executor=pool, progress=False)

    return Whole(call, SERIES_REALIZATIONS * options["duration"], study.timing_seconds)


def _speed_timers(study: WorkPrecisionStudy, table: Table) -> Timers:
    """Return timers of the default method with default statistics, by threads and lanes."""
    runs = [(scene, LANES, threads) for scene in study.scenes() for threads in (1, 2)]
    timers: Timers = {}
    for scene, lanes, threads in dict.fromkeys([*runs, *((PAIR, lanes, 1) for lanes in BLOCKS)]):
        network, step = study.scenes()[scene], table[default(scene)].step
        options = {
            "realizations": max(2, cores()) * lanes if lanes == LANES else in_blocks_of(lanes),
            "step": step,
        }
        timers[scene, lanes, threads] = Ensemble(network, options, step, 0.0, study.timing_seconds, threads)
    return timers


def in_blocks_of(lanes: int) -> int:
    """Return how many realizations make blocks of a width: one for each core; less than 8 are one block."""
    return lanes * cores() if lanes >= 8 else lanes


def _speed(study: WorkPrecisionStudy, table: Table, found: Mapping[Any, list[Measurement]]) -> xr.Dataset:
    """Return the steps of a body per second, of the default method and of the loops."""
    rows: dict[str, tuple[float, list[float]]] = {}
    for scene, network in study.scenes().items():
        bodies = len(network.oscillators)
        for lanes, threads in ((LANES, 1), (LANES, 2), *((lanes, 1) for lanes in BLOCKS)):
            if (scene, lanes, threads) in found:
                rates = [rate for rate, _ in found[scene, lanes, threads]]
                rows[run_name(scene, lanes, threads)] = bodies / table[default(scene)].step, rates
        for method in study.baselines(scene):
            rows[method.key] = bodies / method.step, table[method].rates
    per_second = {name: [factor / rate for rate in rates] for name, (factor, rates) in rows.items()}
    values = np.array(list(per_second.values()))
    attributes = {"units": "s-1", "long_name": "steps of a body per second"}
    return xr.Dataset(
        {
            "body_steps_per_second": ("run", np.median(values, axis=1), attributes),
            "body_steps_per_second_by_round": (("run", "round"), values, attributes),
        },
        {"run": list(per_second)},
        {"cores": cores(), "lanes": LANES},
    )


def run_name(scene: str, lanes: int, threads: int = 1) -> str:
    """Return the name of a run of the default method that was timed."""
    width = "full blocks" if lanes == LANES else f"blocks of {lanes}"
    return f"{scene}, impactlab, {width}, {threads} thread{'s' if threads > 1 else ''}"


def default(scene: str) -> Method:
    """Return the method that `simulate` takes when nothing is chosen."""
    return Method(scene, "impactlab", "exact flow", "white", 0.0)


def _methods(study: WorkPrecisionStudy, table: Table) -> xr.Dataset:
    """Return all that is known of the methods."""
    accuracies = np.array(study.accuracies)
    both, alone = ("case", "statistic"), ("case",)
    data: dict[str, tuple[tuple[str, ...], Any, dict[str, str]]] = {}
    for name, text in (
        ("scene", "scene"),
        ("tool", "what runs it"),
        ("scheme", "scheme"),
        ("noise", "noise: white, or a series of cosines"),
        ("line", "scheme and tool"),
    ):
        data[name] = alone, [getattr(method, name) for method in table], {"long_name": text}
    bodies = {scene: len(network.oscillators) for scene, network in study.scenes().items()}
    data["bodies"] = alone, [bodies[method.scene] for method in table], {"units": "1", "long_name": "number of bodies"}
    data["note"] = alone, [found.note for found in table.values()], {"long_name": "note"}
    for name, units, text in (
        ("step", "s", "step"),
        ("rate", "1", "seconds of computing for a second of one realization"),
        ("startup", "s", "seconds before the statistics begin"),
    ):
        data[name] = alone, [getattr(found, name) for found in table.values()], {"units": units, "long_name": text}
    for name, units, text in (
        ("bias", "1", "relative bias; of the density, probability elsewhere"),
        ("bias_error", "1", "standard error of the bias"),
        ("scatter", "s", "squared relative standard error times simulated time"),
        ("direct_scatter", "s", "the same without balances"),
    ):
        values = np.array([getattr(found, name) for found in table.values()])
        data[name] = both, values, {"units": units, "long_name": text}
    for name, deviations, text in (
        ("seconds_to", None, "run time to an accuracy"),
        ("seconds_to_at_least", -2.0, "run time with a bias two standard errors smaller"),
        ("seconds_to_at_most", 2.0, "run time with a bias two standard errors larger"),
    ):
        times = [
            [seconds_to(accuracy, found, deviations=deviations) for accuracy in accuracies] for found in table.values()
        ]
        data[name] = ("case", "accuracy", "statistic"), np.array(times), {"units": "s", "long_name": text}
    coordinates = {"case": [method.key for method in table], "statistic": list(STATISTICS), "accuracy": accuracies}
    return xr.Dataset(data, coordinates)
