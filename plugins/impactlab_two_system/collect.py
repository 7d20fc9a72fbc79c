"""From the simulations of the study to one tree of labelled results."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import impactlab as il
from impactlab import dataset
from impactlab_two_system.analytic import AnalyticSolution
from impactlab_two_system.corrections import corrections

if TYPE_CHECKING:
    from impactlab_two_system.study import TwoSystemStudy

SYSTEMS = ("one", "two")
QUANTITIES = {"displacement": ("m-1", "m"), "velocity": ("s m-1", "m s-1")}
"""Quantities of the densities, with the units of the density and of the quantity."""

Cases = Mapping[tuple[float, float], xr.Dataset]
"""Datasets by frequency ratio and clearance."""

_RATIO = {"units": "1", "long_name": "frequency ratio of System 1 to System 2"}
_CLEARANCE = {"units": "m", "long_name": "clearance"}


def collect(study: TwoSystemStudy, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return the tree of results.

    Groups: ``accurate`` and ``paper`` (all statistics over frequency ratio and clearance,
    with standard errors; in ``accurate`` also the scatter of one record),
    ``peaks`` (largest force of each record), ``density`` (by variant), ``seeds`` and
    ``repetition`` (further records in the paper's way), ``linear``, ``reference``
    (``analytic``, ``density`` and, where it exists, ``exact``) and ``corrections``.
    """
    nodes: dict[str, xr.Dataset] = {"/linear": _linear(study)}
    for variant in study.variants:
        cases = {case: results[_key(variant, *case)] for case in product(study.frequency_ratios, study.clearances)}
        nodes[f"/{variant}"] = _over_cases(study, {case: _statistics(result) for case, result in cases.items()})
        nodes[f"/density/{variant}"] = _densities(study, cases)
        if variant == "accurate":
            nodes["/peaks"] = _peaks(study, cases)
    if "paper" in study.variants:
        nodes["/seeds"] = _seeds(study, results)
        nodes["/repetition"] = _repetition(study, results["repetition"])
    if study.reference:
        nodes |= _reference(study, nodes[f"/density/{study.variants[0]}"])
    tree = xr.DataTree.from_dict(nodes)
    tree["corrections"] = xr.DataTree(corrections(study, tree))
    return tree


def _key(variant: str, ratio: float, clearance: float) -> str:
    return f"{variant}_{ratio:g}_{clearance:g}"


def _over_cases(study: TwoSystemStudy, cases: Cases) -> xr.Dataset:
    """Return the datasets of the cases along frequency ratio and clearance."""
    clearances = ("clearance", np.array(study.clearances), _CLEARANCE)
    ratios = sorted({ratio for ratio, _ in cases})
    rows = [_stacked([cases[ratio, clearance] for clearance in study.clearances], clearances) for ratio in ratios]
    return _stacked(rows, ("frequency_ratio", np.array(ratios), _RATIO))


def _stacked(datasets: list[xr.Dataset], coordinate: tuple[str, np.ndarray, dict[str, str]]) -> xr.Dataset:
    """Return datasets of one form along a new first dimension (what xr.concat does, at a tenth of its time)."""
    first = datasets[0]
    data = {
        name: ((coordinate[0], *variable.dims), np.stack([item[name].values for item in datasets]), variable.attrs)
        for name, variable in first.data_vars.items()
    }
    return xr.Dataset(data, {**first.coords, coordinate[0]: coordinate})


def _statistics(result: xr.Dataset) -> xr.Dataset:
    """Return the statistics of one case, their errors or scatter, and what was chosen.

    One record alone has no standard errors; many have the scatter of one, too.
    """
    names = [name for name in (*dataset.STATISTICS, *dataset.BALANCES) if name in result]
    found = result[names].copy()
    data: dict[str, Any] = {}
    for name in names:
        if result.attrs["realizations"] == 1:
            found[name].attrs.pop("ancillary_variables", None)
            continue
        data[f"{name}_standard_error"] = result[f"{name}_standard_error"]
        if f"{name}_by_realization" in result and name in dataset.STATISTICS:
            scatter = result[f"{name}_by_realization"].std("realization", ddof=1)
            _, units, long_name = dataset.STATISTICS[name]
            scatter.attrs = {"units": units, "long_name": f"standard deviation of one record's {long_name}"}
            data[f"{name}_scatter"] = scatter
    for name, units in (("step", "s"), ("spin_up", "s"), ("duration", "s"), ("realizations", "1")):
        data[name] = ((), float(result.attrs[name]), {"units": units, "long_name": name.replace("_", " ")})
    return found.assign(data)


def _densities(study: TwoSystemStudy, cases: Cases) -> xr.Dataset:
    """Return the densities at their clearance, along the frequency ratio."""
    names = [f"density_{quantity}{ending}" for quantity in QUANTITIES for ending in ("", "_standard_error")]
    bins = [f"{quantity}_{kind}" for quantity in QUANTITIES for kind in ("edges", "center")]
    found = [cases[ratio, study.density_clearance].reset_coords()[[*names, *bins]] for ratio in study.frequency_ratios]
    return _stacked(found, ("frequency_ratio", np.array(study.frequency_ratios), _RATIO)).set_coords(bins)


def _peaks(study: TwoSystemStudy, cases: Cases) -> xr.Dataset:
    """Return the largest force of each record; NaN beyond the number of realizations of a case."""
    realizations = np.arange(max(study.ensemble(ratio) for ratio in study.frequency_ratios))
    name = "peak_contact_force_by_realization"
    return _over_cases(
        study, {case: result[[name]].reindex(realization=realizations) for case, result in cases.items()}
    )


def _seeds(study: TwoSystemStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the mean squares of each record of the items that take many in the paper's way."""
    items = [item.key for item in study.demonstrations() if item.key != "repetition"]
    names = {f"{name}_by_realization": name for name in ("mean_square_displacement", "mean_square_velocity")}
    label = ("item", np.array(items), {"long_name": "what was simulated"})
    return _stacked(
        [results[item][list(names)].rename(names).reindex(realization=np.arange(study.paper_seeds)) for item in items],
        label,
    )


def _repetition(study: TwoSystemStudy, result: xr.Dataset) -> xr.Dataset:
    """Return the correlation of the displacements with those one duration later.

    The first half of the duration is left out: there the start from rest still shows.
    """
    displacement = result["displacement"].isel(realization=0).transpose("oscillator", "time")
    early = displacement.sel(time=slice(0.5 * study.duration, study.duration)).values[:, :-1]
    late = displacement.sel(time=slice(1.5 * study.duration, 2.0 * study.duration)).values
    points = min(early.shape[1], late.shape[1])
    values = [np.corrcoef(first[:points], second[:points])[0, 1] for first, second in zip(early, late, strict=True)]
    attributes = {
        "units": "1",
        "long_name": f"correlation of the displacement with that {study.duration:g} s later",
    }
    return xr.Dataset({"correlation": ("oscillator", values, attributes)}, {"oscillator": list(SYSTEMS)})


def _linear(study: TwoSystemStudy) -> xr.Dataset:
    """Return the laws of the linear systems and the conditions of Eqs. 9 and 17."""
    solutions = [AnalyticSolution.of(study.network(ratio, study.density_clearance)) for ratio in study.frequency_ratios]
    by_system = ("frequency_ratio", "oscillator")
    data = {
        "temperature": (by_system, "temperatures", "J", "temperature"),
        "mean_square_displacement": (
            by_system,
            "linear_mean_square_displacement",
            "m2",
            "mean square displacement",
        ),
        "variance_displacement": (
            by_system,
            "linear_mean_square_displacement",
            "m2",
            "variance of the displacement",
        ),
        "mean_square_velocity": (by_system, "linear_mean_square_velocity", "m2 s-2", "mean square velocity"),
        "velocity_ratio": (by_system[:1], "velocity_ratio", "1", "ratio C_DV of the mean square velocities"),
        "displacement_ratio": (
            by_system[:1],
            "displacement_ratio",
            "1",
            "ratio C_DX of the mean square displacements",
        ),
    }
    return xr.Dataset(
        {
            name: (dims, np.array([getattr(solution, attribute) for solution in solutions]),
                   {"units": units, "long_name": f"{long_name} without contact"})
            for name, (dims, attribute, units, long_name) in data.items()
        },
        {
            "frequency_ratio": ("frequency_ratio", np.array(study.frequency_ratios), _RATIO),
            "oscillator": list(SYSTEMS),
        },
    )  # fmt: skip


def _reference(study: TwoSystemStudy, bins: xr.Dataset) -> dict[str, xr.Dataset]:
    """Return the paper's analytic solution everywhere and the exact law where there is one."""

    solutions = {
        case: AnalyticSolution.of(study.network(*case)) for case in product(study.frequency_ratios, study.clearances)
    }
    nodes = {
        "/reference/analytic": _over_cases(
            study,
            {
                case: dataset.statistics(list(SYSTEMS), ["gap"], solution.statistics())
                for case, solution in solutions.items()
            },
        ),
        "/reference/density": _reference_densities(study, bins),
    }
    exact = {
        case: il.exact(study.network(*case)).statistics()
        for case, solution in solutions.items()
        if solution.condition_holds
    }
    if exact:
        nodes["/reference/exact"] = _over_cases(study, exact)
    return nodes


def _reference_densities(study: TwoSystemStudy, bins: xr.Dataset) -> xr.Dataset:
    """Return the bin averages of the analytic densities in the bins of the simulations."""
    densities = {}
    for quantity, (units, _) in QUANTITIES.items():
        edges = bins[f"{quantity}_edges"]
        values = np.empty(bins[f"density_{quantity}"].shape)
        for i, ratio in enumerate(study.frequency_ratios):
            solution = AnalyticSolution.of(study.network(ratio, study.density_clearance))
            for j, system in enumerate(SYSTEMS):
                edge = edges.sel(frequency_ratio=ratio, oscillator=system).values
                values[i, j] = solution.bin_density(j, quantity, edge)
        attributes = {
            "units": units,
            "long_name": f"analytic density of the {quantity}, averaged over the bin",
        }
        densities[f"density_{quantity}"] = (bins[f"density_{quantity}"].dims, values, attributes)
    return xr.Dataset(densities, bins.coords)
