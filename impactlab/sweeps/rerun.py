"""What a file was made from: its network, and its simulation or sweep done again."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
import xarray as xr

import impactlab
from impactlab.allowed_time import allowed_time
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.build import digest
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, positive
from impactlab.plan.seed import seed_from
from impactlab.plan.start import WORDS
from impactlab.progress import reporter
from impactlab.results.dataset import CONFIGURATION, configuration_of, load, parsed
from impactlab.results.stack import DONE
from impactlab.sweeps.product import Sweep
from impactlab.sweeps.scheduler import run_points
from impactlab.sweeps.sweep_points import Point

_REPEATED = {"duration", "realizations", "step", "integrator", "spin_up", "initial", "record", "seed"}
"""Options that are stored with a result: none of them can name a file."""


QUESTIONS = "basins", "bifurcation", "continuation", "fragility", "lyapunov", "orbits", "spread", "uncertain"
"""Modules of `impactlab.analysis` that answer a question once more, from what is stored with the answer."""


@checked
def rerun(
    source: xr.Dataset | xr.DataTree | str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    max_seconds: float | None = None,
) -> xr.Dataset:
    """Simulate again what a dataset or a file was made from, with the same numbers.

    On the same machine and versions they are the same bit for bit.

    Parameters
    ----------
    source : Dataset, str or path
        What `simulate` or `sweep` returned, a part of a sweep, the answer of `basins`, `bifurcation`, `lyapunov`,
        `orbits`, `continue_orbits`, `orbit_spread`, `fragility` or `required_separation`, or a netCDF file of it.
    executor : concurrent.futures.Executor, optional
        Where to run; see `simulate`.
    max_seconds : float, optional
        Limit of the time, for a file of somebody else: a simulation that is foreseen to take longer is refused before
        it begins, everything else is stopped. Code may have to be compiled in addition.

    Raises
    ------
    InvalidInput
        If no simulation is stored, a component's kernel has changed since, or it takes longer than `max_seconds`.

    Examples
    --------
    >>> result = il.simulate(network, duration=20.0, realizations=64, rng=1)
    >>> il.rerun(result).contact_ratio.equals(result.contact_ratio)
    True
    """
    dataset = load(source) if isinstance(source, str | os.PathLike) else source
    if max_seconds is None:
        return _again(dataset, executor)
    seconds = positive("max_seconds", max_seconds)
    with allowed_time(seconds):
        return _again(dataset, executor, _deadline(seconds), seconds)


def _again(
    dataset: Any, executor: Executor | None, progress: Callable[[float], None] | None = None,
    max_seconds: float | None = None,
) -> xr.Dataset:  # fmt: skip
    """Simulate again what a dataset was made from."""
    configuration = configuration_of(dataset)
    if "sweep" in configuration:
        if not isinstance(dataset, xr.Dataset):
            raise InvalidInput("A sweep is stored as one dataset, but this file has groups.")
        sweep = configuration["sweep"]
        return sweep_again(dataset, sweep.get("reference") is True, executor, progress)
    for question in set(QUESTIONS) & set(configuration):
        again = import_module(f"impactlab.analysis.{question}").again
        try:
            return again(dataset, configuration[question], progress)  # type: ignore[no-any-return]
        except (LookupError, StopIteration, TypeError) as error:
            raise InvalidInput(f"The dataset lacks a part of what {question!r} is made again from: {error}.") from error
    if "simulate" not in configuration:
        study = configuration.get("study")
        name = None if study is None else study.get("name")
        advice = f" It is a result of the study {name!r}: use il.run_study." if name else ""
        raise InvalidInput(f"The stored configuration describes no simulation.{advice}")
    of_point = "spin_up" in dataset and dataset["spin_up"].ndim == 0  # of a sweep
    recorded = dataset["spin_up"].item() if of_point else dataset.attrs.get("spin_up")
    return _repeat(configuration, executor, progress, max_seconds, recorded=recorded)


def _deadline(seconds: float) -> Callable[[float], None]:
    """Return what is told the part that is done, and stops it after some time (s)."""
    end = time.monotonic() + seconds

    def told(part: float) -> None:
        if part < 1.0 and time.monotonic() > end:
            raise InvalidInput(f"{part:.0%} was done in {seconds:.3g} s; give a larger max_seconds=.")

    return told


@checked
def network_of(source: xr.Dataset | xr.DataTree | str | os.PathLike[str]) -> impactlab.Network:
    """Return the network that a dataset or a file was made from.

    Parameters
    ----------
    source : Dataset, str or path
        What `simulate` returned, or the answer to a question about one network, or a netCDF file of it.

    Raises
    ------
    InvalidInput
        If no network is stored, or a class of its components is not defined.

    Examples
    --------
    >>> result = il.simulate(network, duration=20.0, realizations=64, rng=1)
    >>> il.network_of(result) == network
    True
    """
    configuration = configuration_of(source)
    if "network" not in configuration:
        advice = " Select one point of the sweep." if "sweep" in configuration else ""
        raise InvalidInput(f"The stored configuration describes no network.{advice}")
    return impactlab.Network.from_dict(configuration["network"])


def _repeat(
    configuration: Mapping[str, Any],
    executor: Executor | None,
    progress: Callable[[float], None] | None = None,
    max_seconds: float | None = None,
    *,
    recorded: float | None,
) -> xr.Dataset:
    """Simulate again what a configuration of `simulate` describes, unless a component's kernel has changed since.

    `recorded` is the spin-up of the result (s), which older versions chose after rest and did not store as an option.
    """
    options = configuration.get("simulate", {})
    if {"continues", "branch"} & set(options):
        raise InvalidInput("This result goes on from an earlier run: rerun that one, and let it go on again.")
    if set(options) - {"statistics", "on_divergence"} != _REPEATED:
        raise InvalidInput(
            f"A stored simulation has the options {sorted(_REPEATED)} and no others; these are {sorted(options)!r}."
        )
    seed, records = seed_from(options["seed"]), options["record"]
    if not isinstance(records, list):
        raise InvalidInput(f"The stored records must be a list, not {records!r}.")
    if isinstance(options["initial"], str) and options["initial"] not in WORDS:
        raise InvalidInput(f"The stored initial must not name a file, as {options['initial']!r} does.")
    spin_up = recorded if options["initial"] == "rest" and options["spin_up"] is None else options["spin_up"]
    network = impactlab.Network.from_dict(configuration.get("network", {}))
    if digest(generate(Model.of(network))) != configuration.get("text"):
        raise InvalidInput("The kernel of a component, or impactlab, has changed since this result was made.")
    return impactlab.simulate(
        network, options["duration"], realizations=options["realizations"], step=options["step"],
        integrator=impactlab.Integrator.from_dict(options["integrator"]), spin_up=spin_up,
        initial=options["initial"], record=[impactlab.Record.from_dict(item) for item in records], rng=seed,
        executor=executor, progress=progress, statistics=options.get("statistics"), max_seconds=max_seconds,
        on_divergence=options.get("on_divergence", "keep"),
    )  # fmt: skip


def _of_draws(point: xr.Dataset, executor: Executor, progress: Callable[[float], None]) -> xr.Dataset:
    """Simulate the draws of a point of a sweep again."""
    return _again(point, None, progress)


def sweep_again(
    dataset: xr.Dataset, reference: bool, executor: Executor | None, progress: Callable[[float], None] | None
) -> xr.Dataset:
    """Simulate again what was done; a point that was refused keeps its status."""
    if CONFIGURATION not in dataset or "status" not in dataset:
        raise InvalidInput(
            f"The sweep has lost its variables 'status' and {CONFIGURATION!r}; pass the complete dataset."
        )
    stored = dataset[CONFIGURATION]
    points, jobs = [], {}
    for place in np.ndindex(stored.shape):
        configuration = parsed(stored.values[place])
        status = str(dataset["status"].values[place])
        labels = {str(name): dataset[name].values[index].item() for name, index in zip(stored.dims, place, strict=True)}
        network = impactlab.Network.from_dict(configuration["network"]) if "network" in configuration else None
        point = Point(", ".join(f"{name}={label!r}" for name, label in labels.items()), network, {}, status)
        if status == DONE and "uncertain" in configuration:
            point = point._replace(refusal="")
            jobs[point.key] = partial(_of_draws, dataset.isel(dict(zip(stored.dims, place, strict=True))))
        elif status == DONE:
            point = point._replace(refusal="")
            recorded = dataset["spin_up"].values[place].item() if "spin_up" in dataset else None
            jobs[point.key] = partial(_repeat, configuration, recorded=recorded)
        points.append(point)
    coordinates = {str(name): dataset[name].variable for name in stored.dims}
    return Sweep(coordinates, tuple(points), reference).dataset(run_points(jobs, executor, reporter(progress)))
