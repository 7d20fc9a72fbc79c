"""Uncertain parameters: statistics over draws of numbers of a network, and what each of these numbers does to them."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
import xarray as xr

import impactlab
from impactlab.components.component import whole
from impactlab.components.literature import article, in_one_line
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.plan.seed import seed_of
from impactlab.results.dataset import CONFIGURATION, provenance
from impactlab.results.schema import STATISTICS

OUTSIDE = 1e-9
"""Probability outside of the range in which a distribution must give networks, on each side."""

DRAWN = "parameter_value"
"""Variable with the drawn numbers."""

SOBOL = article(
    "Janon, A. and Klein, T. and Lagnoux, A. and Nodet, M. and Prieur, C.",
    "Asymptotic normality and efficiency of two Sobol index estimators",
    "ESAIM: Probab. Stat.", 18, 2014, "342", "10.1051/ps/2013040",
)  # fmt: skip
"""Source of the estimator of the indices."""


class Distribution(Protocol):
    """A distribution as `scipy.stats` freezes it."""

    def ppf(self, q: Any) -> Any: ...


def uncertain(
    make: Callable[..., impactlab.Network],
    over: Mapping[str, Distribution],
    draws: int,
    *,
    rng: Any = None,
    **simulate_options: Any,
) -> xr.Dataset:
    """Return statistics of networks with uncertain numbers, and the parts of their variance that each number causes.

    Each of ``draws`` independent rows has one network with all numbers drawn, and one more for each number, which keeps
    this number and has all others drawn anew (pick and freeze): with d numbers ``draws (d + 1)`` networks, which run as
    the points of `impactlab.sweep`, each with noise of its own.

    Parameters
    ----------
    make : callable
        ``make(name=value, ...)`` returns a network.
    over : mapping of str to distribution
        Distribution of each number by name, such as ``scipy.stats.lognorm(0.1, scale=400.0)``; they are independent.
    draws : int
        Number of rows, at least 8.
    rng : optional
        Seed of draws and noise, as for `simulate`; the same seed gives the same draws to networks of other kinds.
    **simulate_options
        Options of `simulate` for all networks, such as ``duration`` and ``realizations``.

    Returns
    -------
    xarray.Dataset
        Each statistic of `simulate` as its mean over all draws, with its standard error; ``<name>_variance``, its
        variance from network to network; ``<name>_sobol_index`` (parameter, …), the part of it that a number causes
        by itself, with its standard error; ``<name>_noise_part``, the part that noise causes, by the standard errors
        of the runs, NaN where these are unknown and 0 where nothing is random; ``<name>_by_draw``; and
        ``parameter_value`` (parameter, draw, network), the numbers.

    Raises
    ------
    InvalidInput
        If something given cannot be used, or a distribution holds numbers with which there is no network.

    Examples
    --------
    >>> import scipy.stats
    >>> def mounted(stiffness):
    ...     body = il.LinearOscillator(damping=0.5, stiffness=stiffness)
    ...     return il.Network({"a": body}, {}, {"a": il.WhiteNoise(1.0)})
    >>> over = {"stiffness": scipy.stats.uniform(8.0, 4.0)}
    >>> spread = il.uncertain(mounted, over, draws=8, duration=20.0, realizations=64, rng=1)
    >>> spread.mean_square_displacement.dims
    ('oscillator',)
    """
    names = _checked(make, over)
    rows, count = whole("draws", draws, 8), len(names)
    seed = seed_of(rng)
    shares = np.random.default_rng([*seed]).random((rows, 2, count))
    values = np.stack([np.asarray(over[name].ppf(shares[..., place])) for place, name in enumerate(names)], axis=-1)
    networks = np.repeat(values[:, :1], count + 1, axis=1)  # (row, network, number)
    for place in range(count):
        networks[:, 1 + place] = values[:, 1]
        networks[:, 1 + place, place] = values[:, 0, place]
    flat = networks.reshape(-1, count)

    def made(point: int) -> Any:
        return make(**dict(zip(names, flat[point].tolist(), strict=True)))

    found = impactlab.sweep(made, {"point": range(len(flat))}, rng=seed, **simulate_options)
    return _summary(found, names, networks)


def again(dataset: xr.Dataset, options: Mapping[str, Any]) -> xr.Dataset:
    """Return statistics over uncertain numbers again from what is stored with them."""
    stored = dataset[[CONFIGURATION, "status", *(name for name in ("spin_up",) if name in dataset)]]
    stored.attrs = {**dataset.attrs, CONFIGURATION: json.dumps({"sweep": {"names": ["point"], "reference": False}})}
    return _summary(impactlab.rerun(stored), list(options["names"]), dataset[DRAWN].transpose(..., "parameter").values)


def _checked(make: Any, over: Any) -> list[str]:
    """Return the names of the numbers, or refuse distributions and ranges that give no network."""
    if not isinstance(over, Mapping) or not over:
        raise InvalidInput(f"over is made of distributions by name, such as scipy.stats.norm(4.0, 0.1), not {over!r}.")
    if not callable(make):
        raise InvalidInput(f"make must be a function that returns an il.Network, not {make!r}.")
    for name, item in over.items():
        if not callable(getattr(item, "ppf", None)):
            raise InvalidInput(
                f"over: {name!r} must be a distribution such as scipy.stats.norm(4.0, 0.1), not {item!r}."
            )
    try:
        inspect.signature(make).bind(**dict.fromkeys(over))
    except TypeError as error:
        raise InvalidInput(f"make cannot be called with the names {', '.join(over)}: {error}.") from None
    middle = {name: float(item.ppf(0.5)) for name, item in over.items()}
    for name, item in over.items():
        for share in (OUTSIDE, 1.0 - OUTSIDE):
            value = float(item.ppf(share))
            try:
                make(**{**middle, name: value})
            except ImpactLabError as error:
                raise InvalidInput(
                    f"The distribution of {name!r} holds {value:.6g}, with which there is no network: {error}"
                ) from None
    return list(over)


def _summary(found: xr.Dataset, names: list[str], networks: np.ndarray) -> xr.Dataset:
    """Return means, variances and indices from the results of all networks, one after the other."""
    done = (found["status"] == "done").values
    if not done.all():
        place = int((~done).argmax())
        row = dict(zip(names, networks.reshape(-1, len(names))[place].tolist(), strict=True))
        raise InvalidInput(f"With {row} there is no result: {found['status'].values[place]}")
    shape, variables, still = networks.shape[:2], dict[str, Any](), "deterministic" in found
    for name in [item for item in STATISTICS if item in found and found[item].dims[:1] == ("point",)]:
        own = found[name]
        values = own.values.reshape(*shape, *own.shape[1:])
        variables |= _of_statistic(own, found.get(f"{name}_standard_error"), values, still)
    coordinates = {
        "parameter": (("parameter",), np.array(names), {"long_name": "uncertain number"}),
        **{name: item for name, item in found.coords.items() if name != "point"},
    }
    kept = {name: found[name] for name in (CONFIGURATION, "status", "spin_up") if name in found}
    variables[DRAWN] = (("draw", "network", "parameter"), networks, {"long_name": "drawn number"})
    told = provenance(
        "Statistics of networks with uncertain numbers", json.dumps({"uncertain": {"names": names}}),
        f"{found.attrs.get('references', '')} {in_one_line([SOBOL])}",
    )  # fmt: skip
    return xr.Dataset({**variables, **kept}, coordinates, told)


def _of_statistic(own: xr.DataArray, errors: xr.DataArray | None, values: np.ndarray, still: bool) -> dict[str, Any]:
    """Return mean, variance and indices of a statistic, (row, network, …), as variables."""
    name, dims, rows = str(own.name), own.dims[1:], len(values)
    units, text = own.attrs.get("units", "1"), own.attrs.get("long_name", own.name)
    mean = values.mean(axis=(0, 1))
    error = values.mean(axis=1).std(axis=0, ddof=1) / np.sqrt(rows)
    variance = values.var(axis=(0, 1))
    noise = np.full(mean.shape, 0.0 if still or errors is None else np.nan)
    if errors is not None and not still:
        noise = (errors.values**2).mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        noise = noise / variance
        pairs = [_index(values[:, 0], values[:, 1 + place]) for place in range(values.shape[1] - 1)]
    index, index_error = (np.stack(item) for item in zip(*pairs, strict=True))
    of = "variance from network to network"
    return {
        name: (dims, mean, {"units": units, "long_name": f"{text}, mean over draws"}),
        f"{name}_standard_error": (dims, error, {"units": units, "long_name": f"standard error of {text}"}),
        f"{name}_variance": (dims, variance, {"long_name": f"{of} of {text}"}),
        f"{name}_sobol_index": (
            ("parameter", *dims), index, {"units": "1", "long_name": f"part of the {of} that one number causes"},
        ),
        f"{name}_sobol_index_standard_error": (
            ("parameter", *dims), index_error, {"units": "1", "long_name": "standard error of the index"},
        ),
        f"{name}_noise_part": (dims, noise, {"units": "1", "long_name": f"part of the {of} that noise causes"}),
        f"{name}_by_draw": (("draw", "network", *dims), values, {"units": units, "long_name": f"{text}, by draw"}),
    }  # fmt: skip


def _index(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the index of a number that two columns share, (row, …), and its standard error by the jackknife."""
    rows, middle = len(one), 0.5 * (one + other).mean(axis=0)
    one, other = one - middle, other - middle  # which changes nothing but rounding
    parts = np.stack([one * other, 0.5 * (one + other), 0.5 * (one**2 + other**2)])

    def index(sums: np.ndarray, count: int) -> np.ndarray:
        product, mean, square = sums / count
        result: np.ndarray = (product - mean**2) / (square - mean**2)
        return result

    whole_index = index(parts.sum(axis=1), rows)
    without = index(parts.sum(axis=1)[:, None] - parts, rows - 1)
    return whole_index, np.sqrt((rows - 1.0) / rows * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
