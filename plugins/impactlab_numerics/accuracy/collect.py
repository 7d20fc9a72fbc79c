"""From the simulations of the accuracy study to one tree: differences, intervals, kept tolerances."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from scipy.special import stdtrit

import impactlab as il
from impactlab.machine import cores
from impactlab.results import schema
from impactlab_numerics.accuracy.intervals import collect as intervals
from impactlab_numerics.accuracy.random_networks import random_network
from impactlab_numerics.scenes import scene
from impactlab_numerics.transfer.trees import transfer_statistics

if TYPE_CHECKING:
    from impactlab_numerics.accuracy.study import AccuracyStudy

ERRORS = 3.0
"""Standard errors that a difference may have beyond the bias that is allowed."""

_SPREADS = {"mean_displacement": "variance_displacement", "mean_velocity": "mean_square_velocity"}
"""Means, and the squares by which they are measured where these are larger."""

_VARIABLES = {
    "network": "number of the network",
    "difference": "value minus reference",
    "standard_error": "standard error of the difference",
    "scale": "size that the difference is measured by",
    "relative_difference": "difference over the size",
    "relative_error": "standard error over the size",
    "z": "difference in standard errors",
    "excess": "difference over what is allowed: the bias and three standard errors",
}


def collect(study: AccuracyStudy, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return the tree of results.

    Groups: ``networks`` (step and time scales of each), ``equal`` (all statistics of all
    networks against exact laws), ``unequal`` (against runs at a quarter of the step), ``intervals`` (short runs of
    many networks), ``coverage`` (of each statistic, and of each run) and ``tolerance`` (each seed).
    """
    nodes: dict[str, xr.Dataset] = {}
    if study.networks:
        nodes["/networks"] = _networks(study, results)
        laws = _laws(study.seeds)
        nodes["/equal"] = _compared(study, results, "equal", laws.__getitem__)
        if study.unequal:
            nodes["/unequal"] = _compared(study, results, "unequal", lambda number: results[f"quarter_{number}"])
    if study.coverage_networks:
        nodes["/intervals"] = intervals(study, results, _laws(range(study.coverage_networks)))
    if study.coverage_runs:
        nodes["/coverage"] = _coverage(study, results)
    if study.tolerance_seeds:
        nodes["/tolerance"] = _tolerance(study, results)
    return xr.DataTree.from_dict(nodes)


def _laws(numbers: Iterable[int]) -> dict[int, xr.Dataset]:
    """Return the exact statistics of random networks."""
    numbers = list(numbers)
    with ThreadPoolExecutor(cores()) as pool:
        return dict(zip(numbers, pool.map(exact_statistics, map(random_network, numbers)), strict=True))


def exact_statistics(network: il.Network) -> xr.Dataset:
    """Return the statistics of a tree of bodies at one temperature, by transfer integrals."""
    found = transfer_statistics(network)
    values = {name: np.array(list(by_label.values())) for name, by_label in found.items()}
    return schema.statistics(list(network.oscillators), list(network.contacts), values)


def _networks(study: AccuracyStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the sizes of the networks, and the step in units of their fastest motions."""
    rows = []
    for number in study.seeds:
        network, made_with = random_network(number), results[f"equal_{number}"].attrs
        step = float(made_with["step"])
        check = network.check().dataset
        rows.append(
            (
                *(float(len(family)) for family in (network.oscillators, network.contacts, network.couplings)),
                step,
                step * float(check["natural_frequency"].max()),
                step * math.pi / float(check["shortest_contact"].min()),
                float(made_with["duration"]) * float(made_with["realizations"]),
            )
        )  # fmt: skip
    columns = {
        "bodies": ("1", "number of bodies"),
        "contacts": ("1", "number of contacts"),
        "couplings": ("1", "number of couplings"),
        "step": ("s", "automatic step"),
        "step_of_flow": ("1", "step times largest natural frequency"),
        "step_of_contact": ("1", "step times largest frequency of one closed contact"),
        "time": ("s", "simulated time, all realizations together"),
    }
    return xr.Dataset(
        {
            name: ("network", values, {"units": units, "long_name": long_name})
            for (name, (units, long_name)), values in zip(columns.items(), np.array(rows).T, strict=True)
        },
        {"network": list(study.seeds)},
    )


def _compared(
    study: AccuracyStudy, results: Mapping[str, xr.Dataset], kind: str, reference: Callable[[int], xr.Dataset]
) -> xr.Dataset:
    """Return all statistics but the peak of all networks beside their references."""
    rows = []
    for number in study.seeds:
        law = reference(number)
        table = il.compare(results[f"{kind}_{number}"], law)
        for row in table.to_dataframe().itertuples():
            if row.statistic == "peak_contact_force":
                continue
            scale = abs(row.reference)
            if row.statistic in _SPREADS:
                scale = max(scale, math.sqrt(float(law[_SPREADS[row.statistic]].sel(oscillator=row.label))))
            error = row.standard_error
            if f"{row.statistic}_standard_error" in law:
                error = math.hypot(error, float(_at(law[f"{row.statistic}_standard_error"], row.label)))
            allowed = study.bias * scale + ERRORS * error
            numbers = (number, row.difference, error, scale, row.difference / scale, error / scale)
            rows.append((row.statistic, row.label, *numbers, row.difference / error, abs(row.difference) / allowed))
    statistic, label, *columns = zip(*rows, strict=True)
    return xr.Dataset(
        {
            name: ("comparison", np.array(values), {"long_name": text})
            for (name, text), values in zip(_VARIABLES.items(), columns, strict=True)
        },
        {"statistic": ("comparison", list(statistic)), "label": ("comparison", list(label))},
    )


def _at(item: xr.DataArray, label: str) -> xr.DataArray:
    return item.sel({str(item.dims[0]): label})


def _coverage(study: AccuracyStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return how often 95 % intervals hold the exact value: of each statistic, and in each run."""
    law = il.exact(scene(2))
    quantile = float(stdtrit(study.coverage_realizations - 1, 0.975))
    tables = [il.compare(results[f"coverage_{run}"], law) for run in range(study.coverage_runs)]
    z = np.stack([table.z.values for table in tables])
    held = np.abs(z) <= quantile
    first = tables[0]
    return xr.Dataset(
        {
            "coverage": ("comparison", held.mean(axis=0), {"long_name": "share of intervals that hold the value"}),
            "scatter": ("comparison", z.std(axis=0), {"long_name": "standard deviation of z"}),
            "offset": ("comparison", z.mean(axis=0), {"long_name": "mean of z"}),
            "by_run": ("run", held.mean(axis=1), {"long_name": "share of a run's intervals that hold the value"}),
        },
        {name: ("comparison", first[name].values) for name in ("statistic", "label")},
    )


def _tolerance(study: AccuracyStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the largest error of each run relative to the tolerance, and the time that the run took."""
    law = il.exact(scene(2)).statistics()[study.tolerance_statistic]
    found = [results[f"tolerance_{run}"] for run in range(study.tolerance_seeds)]
    errors = [float(np.abs(item[law.name] / law - 1.0).max()) / study.tolerance for item in found]
    spent = {
        "error": (errors, "1", "largest error over the tolerance"),
        "seconds": ([item.attrs["seconds_spent"] for item in found], "s", "time spent"),
        "step": ([item.attrs["step"] for item in found], "s", "step"),
        "realizations": ([float(item.attrs["realizations"]) for item in found], "1", "realizations"),
        "attempts": ([float(item.attrs["attempts"]) for item in found], "1", "attempts"),
    }
    return xr.Dataset(
        {name: ("run", np.array(v), {"units": units, "long_name": text}) for name, (v, units, text) in spent.items()}
    )
