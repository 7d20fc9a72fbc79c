"""Quantities derived from a finished result, with their errors: functions of statistics, effective sample sizes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr

from impactlab.errors import InvalidInput
from impactlab.inputs import checked
from impactlab.plan.clock import BATCHES
from impactlab.results.losses import without_losses
from impactlab.results.schema import EVERY, STATISTICS, Statistic, balances, scatter_of
from impactlab.statistics.controls import UNITS_PER_CONTROL
from impactlab.statistics.regression import Regression


@checked
def jackknife(dataset: xr.Dataset, function: Callable[[xr.Dataset], xr.DataArray]) -> xr.Dataset:
    """Return a function of the statistics of a run, and its standard error.

    The function is evaluated for the means over all realizations but one, for each of them in turn: with the
    value θ for all n and θ_k without realization k, the value is the mean of the pseudo-values
    ``n θ − (n − 1) θ_k``, which has no bias of the order 1/n, and the standard error that of this mean
    (Tukey 1958; Miller, Biometrika 61, 1974, 1). If balances were used for the statistics they are used here, as
    controls of the pseudo-values, where there are few enough: 8 realizations for each.

    Parameters
    ----------
    dataset : xarray.Dataset
        Result of `simulate` with ``record=il.PerRealization()`` and at least 64 realizations.
    function : callable
        Takes a dataset with the default statistics by name and returns an array, label by label: along
        any further dimension it must be done for each element. For example
        ``lambda s: s.mean_square_velocity / s.mean_square_displacement``.

    Returns
    -------
    xarray.Dataset
        ``value`` and ``standard_error``, with the dimensions of what the function returns.

    Raises
    ------
    InvalidInput
        If the statistics of the realizations are not there, there are too few, or the function does not keep
        their dimension.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.PerRealization(), rng=1)
    >>> found = il.jackknife(result, lambda s: s.mean_contact_force / s.contact_ratio)
    >>> found.value.dims
    ('contact',)
    """
    dataset = without_losses(dataset)
    known = [statistic for statistic in EVERY.values() if statistic.by_realization in dataset]
    if not known:
        raise InvalidInput(
            "jackknife needs the statistics of each realization: simulate with record=il.PerRealization()."
        )
    count = dataset.sizes["realization"]
    swept = sorted(str(dim) for dim in set(dataset[known[0].by_realization].dims) - {"realization", "oscillator"})
    if swept:
        raise InvalidInput(f"jackknife takes one simulation: choose a point of the sweep, of {', '.join(swept)}.")
    if count < BATCHES:
        raise InvalidInput(f"jackknife needs at least {BATCHES} realizations, not {count}.")
    of_all, without = (xr.Dataset(_means(dataset, known, left_out)) for left_out in (False, True))
    whole, part = function(of_all), function(without)
    if not isinstance(part, xr.DataArray) or "realization" not in part.dims or "realization" in whole.dims:
        raise InvalidInput(
            "The function must return an array with one element for each label, and keep all dimensions it does not "
            "reduce by name: write .sum('oscillator'), and no .values or .item()."
        )
    pseudo = (count * whole - (count - 1) * part).transpose(..., "realization")
    regression = Regression(_balances(dataset, count)[None], np.ones(count))
    value, error = regression.at_zero(pseudo.values.reshape(-1, count))
    shape, dims = pseudo.shape[:-1], pseudo.dims[:-1]
    return xr.Dataset(
        {
            "value": (dims, value.reshape(shape), {"ancillary_variables": "standard_error"}),
            "standard_error": (dims, error.reshape(shape)),
        },
        pseudo.drop_vars("realization", errors="ignore").coords,
    )


def _means(dataset: xr.Dataset, statistics: list[Statistic], without: bool) -> dict[str, xr.DataArray]:
    """Means over all realizations, or over all but each; the variance is that of all that are in the mean."""

    def mean_of(each: xr.DataArray) -> xr.DataArray:
        mean = each.mean("realization")
        shift = (mean - each).transpose("realization", ...) / (each.sizes["realization"] - 1)
        return shift + mean if without else mean

    result = {item.name: mean_of(dataset[item.by_realization]) for item in statistics}
    for of_points in ("", "point_"):
        names = f"{of_points}variance_displacement", f"{of_points}mean_displacement"
        if names[0] in result:
            own, about = (dataset[EVERY[name].by_realization] for name in names)
            result[names[0]] = mean_of(own + about**2) - mean_of(about) ** 2
    return result


def _balances(dataset: xr.Dataset, count: int) -> np.ndarray:
    """Balances of all realizations, (balance, realization), if they were used and are not too many."""
    controls = controls_of(dataset)
    return controls if len(controls) * UNITS_PER_CONTROL <= count else controls[:0]


def controls_of(dataset: xr.Dataset) -> np.ndarray:
    """Return the balances of all realizations, (balance, realization), if they were used for the statistics."""
    none = np.zeros((0, dataset.sizes["realization"]))
    if not any(statistic.direct.name in dataset for statistic in STATISTICS.values()):
        return none
    names = [balance.by_realization for balance in balances()]
    rows = [dataset[name].transpose(..., "realization") for name in names if name in dataset]
    controls = np.concatenate([none, *(row.values for row in rows)])
    return np.asarray(controls[np.isfinite(controls).all(axis=1)])


@checked
def effective_samples(dataset: xr.Dataset) -> xr.Dataset:
    """Return how many independent samples of a state would give the means of a run with the same standard errors.

    That is the variance of one sample over the square of the standard error: with the variance of the displacement
    for ``mean_displacement``, ``E[v²] − E[v]²`` for ``mean_velocity``, and ``p (1 − p)`` for the contact ratio p.
    Where balances improve a value it counts as more samples; ``direct_…`` are those of the plain means.

    Parameters
    ----------
    dataset : xarray.Dataset
        Result of `simulate` or `sweep`.

    Returns
    -------
    xarray.Dataset
        ``<name>_effective_samples``; NaN without a standard error, infinite where a mean is known exactly.

    Raises
    ------
    InvalidInput
        If there are no standard errors.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.PerRealization(), rng=1)
    >>> il.effective_samples(result).contact_ratio_effective_samples.dims
    ('contact',)
    """
    if "mean_velocity_standard_error" not in dataset:
        raise InvalidInput("effective_samples takes the result of simulate or sweep, with its standard errors.")
    variances = {
        "mean_displacement": dataset.get("variance_displacement"),
        "mean_velocity": dataset.mean_square_velocity - dataset.mean_velocity**2,
        "contact_ratio": dataset.contact_ratio * (1.0 - dataset.contact_ratio) if "contact_ratio" in dataset else None,
    }
    result = {}
    for name, variance in variances.items():
        for variable in (STATISTICS[name], STATISTICS[name].direct):
            if variable.error in dataset:
                number = variance / scatter_of(dataset, variable.name) ** 2
                text = (
                    f"independent samples that would have the standard error of the {variable.name.replace('_', ' ')}"
                )
                result[f"{variable.name}_effective_samples"] = number.assign_attrs({"units": "1", "long_name": text})
    return xr.Dataset(result)
