"""Going on from the end of an earlier run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.mechanism import state_labels
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.inputs import shown
from impactlab.networks.network import Network
from impactlab.plan.start import FILTER, WORDS
from impactlab.records.final_state import CONTINUATION, FILTERS, FINAL, name_of
from impactlab.results.dataset import BEGIN, configuration_of, part_of
from impactlab.results.losses import DIVERGED, refuse_losses


def given_by(initial: Any, network: Network, seed: tuple[int, int] | None) -> Any:
    """Return `initial` as values by name where it is an earlier run or the path of its file; else as it is.

    Refused are runs without a final state, of other bodies or laws, and a seed that would repeat their noise, if there
    is one.
    """
    initial = source_of(initial)
    if not isinstance(initial, xr.Dataset | xr.DataTree):
        return initial
    configuration = configuration_of(initial)
    if name_of("displacement") not in initial or name_of("velocity") not in initial:
        raise InvalidInput(
            "initial: this result has no final state; repeat the earlier run with record=il.FinalState()."
        )
    refuse_losses(initial)
    model = Model.of(network)
    before = configuration.get("simulate", configuration.get("run"))
    if seed is not None and model.random.any() and isinstance(before, dict) and before.get("seed") == list(seed):
        raise InvalidInput(
            "The earlier run had the same rng, whose noise would be repeated; give another one, or pass one "
            "np.random.default_rng(…) to both runs."
        )
    names = model.bodies.names
    known = {"displacement": names, "velocity": names, "state": [label for label, _ in model.kicks.states]}
    found = {quantity: _values(initial, quantity, list(names)) for quantity, names in known.items()}
    for quantity in ("displacement", "velocity"):
        of_all, bodies = found[quantity].items(), network.oscillators
        found[quantity] = {name: value for name, value in of_all if not bodies[name].moves_as_given}
    return {**found, FILTER: _filter_states(initial)} if state_labels(model) else found


def source_of(initial: Any) -> Any:
    """Return the states in a file, where `initial` is its path; else `initial`."""
    named = isinstance(initial, str) and initial not in WORDS and Path(initial).is_file()
    if isinstance(initial, os.PathLike) or named:
        return part_of(initial, [*map(name_of, FINAL), FILTERS, CONTINUATION, DIVERGED])
    return initial


def run_of(state: Any) -> dict[str, Any]:
    """Return the configuration of the run that had a state, and refuse a state from which no run continues."""
    configuration = configuration_of(state) if isinstance(state, xr.Dataset) else {}
    if not configuration or CONTINUATION not in state or "realization" not in state[CONTINUATION].dims:
        raise InvalidInput(
            "A run continues or branches from the state of an il.Run, from a result with "
            "il.FinalState(continues=True), or from the path of its file; give one as initial=."
        )
    refuse_losses(state)
    if not state.sizes["realization"]:
        raise InvalidInput("No realization can continue: all had been retired when this state was taken.")
    if "simulate" in configuration:
        run = configuration["simulate"]
        unknown = [name for name in ("step", "spin_up") if run[name] is None and name in state.attrs]
        chosen = {name: float(state.attrs[name]) for name in unknown}
        method = {name: value if name != "jumps" else False for name, value in run["integrator"].items()}
        configuration["run"] = {**run, **chosen, "integrator": method}
    return configuration


def time_of(state: xr.Dataset) -> float | None:
    """Return the time of a state (s), None if it is not known."""
    own = state.coords.get("time")
    if own is not None and own.ndim == 0:
        return float(own)
    if "duration" not in state.attrs:
        return None
    return float(state.attrs.get(BEGIN, 0.0) + state.attrs["duration"])


def _filter_states(source: Any) -> dict[str, list[float]]:
    """Return the final states of the filters of noise by name; nothing if there were none."""
    if FILTERS not in source:
        return {}
    states = source[FILTERS]
    if "realization" not in states.dims:  # one that was selected
        states = states.expand_dims("realization")
    labels = map(str, states[FILTER].values)
    return dict(zip(labels, states.transpose(FILTER, "realization").values.tolist(), strict=True))


def _values(source: Any, quantity: str, known: list[str]) -> dict[str, list[float]]:
    """Return the final values of all realizations by name, of those names that are known and no others."""
    name, dimension = name_of(quantity), FINAL[quantity].dimension
    if name not in source and not known:
        return {}
    values = source.get(name, xr.DataArray(np.zeros((1, 0)), dims=("realization", dimension)))
    if "realization" not in values.dims:  # one that was selected
        values = values.expand_dims("realization")
    if set(values.dims) != {"realization", dimension}:
        raise InvalidInput(
            f"initial: {name} has the dimensions {list(values.dims)}, not realization and {dimension}; of a sweep "
            "select one point."
        )
    labels = [str(label) for label in values[dimension].values]
    if set(labels) != set(known):
        what = "states of laws" if quantity == "state" else "oscillators"
        raise InvalidInput(
            f"initial: the earlier run has the {what} {shown(labels)}, this network {shown(known)}; "
            'a run goes on with the same ones. Give other starts as {"displacement": {name: value}, …}.'
        )
    return dict(zip(labels, values.transpose(dimension, "realization").values.tolist(), strict=True))
