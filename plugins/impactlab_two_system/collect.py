"""From the simulations of the study to one tree of labelled results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import impactlab as il
from impactlab.results import schema
from impactlab.results.stack import gathered
from impactlab_two_system.analytic import AnalyticSolution
from impactlab_two_system.corrections import corrections

if TYPE_CHECKING:
    from impactlab_two_system.study import TwoSystemStudy

SYSTEMS = ("one", "two")
QUANTITIES = {"displacement": ("m-1", "m"), "velocity": ("s m-1", "m s-1")}
"""Quantities of the densities, with the units of the density and of the quantity."""

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
        sweep = results[variant].assign_coords(_axes(study.frequency_ratios, study.clearances))
        nodes[f"/{variant}"] = _statistics(sweep)
        nodes[f"/density/{variant}"] = _densities(sweep.sel(clearance=study.density_clearance, drop=True))
        if variant == "accurate":
            nodes["/peaks"] = sweep[["peak_contact_force_by_realization"]].drop_attrs(deep=False)
    if "paper" in study.variants:
        nodes["/seeds"] = _seeds(study, results)
        nodes["/repetition"] = _repetition(study, results["repetition"])
    if study.reference != "none":
        nodes |= _reference(study, nodes[f"/density/{study.variants[0]}"])
    if study.reference == "fokker-planck":
        nodes |= _fokker_planck(study, nodes[f"/density/{study.variants[0]}"])
    tree = xr.DataTree.from_dict(nodes)
    tree["corrections"] = xr.DataTree(corrections(study, tree))
    return tree


def _axes(ratios: Sequence[float], clearances: Sequence[float]) -> dict[str, xr.Variable]:
    """Return frequency ratio and clearance as coordinates."""
    return {
        "frequency_ratio": xr.Variable("frequency_ratio", np.array(ratios), _RATIO),
        "clearance": xr.Variable("clearance", np.array(clearances), _CLEARANCE),
    }


def _statistics(sweep: xr.Dataset) -> xr.Dataset:
    """Return the statistics of all cases, their errors or scatter, and what was chosen.

    One record alone has no standard errors; many have the scatter of one, too.
    """
    known = [item for item in (*schema.STATISTICS.values(), *schema.balances()) if item.name in sweep]
    found = sweep[[item.name for item in known]].drop_attrs(deep=False)
    data: dict[str, Any] = {}
    for item in known:
        if (sweep["realizations"] == 1).all():
            found[item.name].attrs.pop("ancillary_variables", None)
            continue
        data[item.error] = sweep[item.error]
        if item.by_realization in sweep and item.name in schema.STATISTICS:
            records = sweep[item.by_realization]
            scatter = xr.apply_ufunc(_scatter, records, input_core_dims=[["realization"]], vectorize=True)
            scatter.attrs = {"units": item.units, "long_name": f"standard deviation of one record's {item.long_name}"}
            data[f"{item.name}_scatter"] = scatter
    for name in ("step", "spin_up", "duration", "realizations"):
        chosen = sweep[name].astype(float)
        chosen.attrs = {**sweep[name].attrs, "long_name": name.replace("_", " ")}
        data[name] = chosen
    return found.assign(data)


def _scatter(records: np.ndarray) -> float:
    """Standard deviation of the records of one case; others may have more."""
    return float(records[np.isfinite(records)].std(ddof=1))


def _densities(sweep: xr.Dataset) -> xr.Dataset:
    """Return the densities of the cases at their clearance, along the frequency ratio."""
    names = [f"density_{quantity}{ending}" for quantity in QUANTITIES for ending in ("", "_standard_error")]
    bins = [f"{quantity}_{kind}" for quantity in QUANTITIES for kind in ("edges", "center")]
    return sweep[[*names, *bins]].set_coords(bins).drop_attrs(deep=False)


def _seeds(study: TwoSystemStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the mean squares of each record of the items that take many in the paper's way."""
    items = [item.key for item in study.demonstrations() if item.key != "repetition"]
    names = {f"{name}_by_realization": name for name in ("mean_square_displacement", "mean_square_velocity")}
    label = xr.Variable("item", np.array(items), {"long_name": "what was simulated"})
    return gathered([results[item][list(names)].rename(names) for item in items], {"item": label})


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

    cases = list(product(study.frequency_ratios, study.clearances))
    solutions = [AnalyticSolution.of(study.network(*case)) for case in cases]
    analytic = [schema.statistics(list(SYSTEMS), ["gap"], solution.statistics()) for solution in solutions]
    nodes = {
        "/reference/analytic": gathered(analytic, _axes(study.frequency_ratios, study.clearances)),
        "/reference/density": _reference_densities(study, bins),
    }
    known = [case for case, solution in zip(cases, solutions, strict=True) if solution.condition_holds]
    if known:
        exact = [il.exact(study.network(*case)).statistics() for case in known]
        nodes["/reference/exact"] = gathered(exact, _axes(sorted({ratio for ratio, _ in known}), study.clearances))
    return nodes


def _fokker_planck(study: TwoSystemStudy, bins: xr.Dataset) -> dict[str, xr.Dataset]:
    """Return statistics, their convergence and densities from the Fokker–Planck equation, at one clearance."""
    ratios = [ratio for ratio in study.fokker_planck_ratios if ratio in study.frequency_ratios]
    if not ratios:
        return {}
    solved = [
        il.fokker_planck(study.network(ratio, study.density_clearance), tolerance=study.fokker_planck_tolerance)
        for ratio in ratios
    ]
    axes = _axes(ratios, [study.density_clearance])
    at = bins.sel(frequency_ratio=ratios)
    densities = {}
    for quantity, (units, _) in QUANTITIES.items():
        edges = at[f"{quantity}_edges"]
        values = [
            [
                law.bin_density(system, quantity, edges.sel(frequency_ratio=ratio, oscillator=system).values)
                for system in SYSTEMS
            ]
            for ratio, law in zip(ratios, solved, strict=True)
        ]
        name = f"density_{quantity}"
        attributes = {"units": units, "long_name": f"density of the {quantity}, averaged over the bin"}
        densities[name] = at[name].dims, np.array(values), attributes
    return {
        "/reference/fokker_planck": gathered([law.statistics() for law in solved], axes),
        "/reference/fokker_planck_convergence": gathered([law.convergence() for law in solved], axes),
        "/reference/fokker_planck_density": xr.Dataset(densities, at.coords),
    }


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
