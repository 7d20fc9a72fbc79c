"""Uncertain numbers: statistics over draws of them, and what noise and each number do to these statistics."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.stats import rankdata

import impactlab
from impactlab.assembly.model import Model
from impactlab.components.literature import article, in_one_line
from impactlab.components.stored import json_of, stored
from impactlab.components.uncertain_number import Uncertain
from impactlab.errors import ImpactLabError, ImpactLabWarning, InvalidInput, give, heard_by
from impactlab.inputs import checked, whole
from impactlab.networks.network import Network
from impactlab.plan.seed import Seed, seed_of
from impactlab.records.trajectory import PerRealization
from impactlab.results.dataset import CONFIGURATION, provenance
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.schema import EVERY, Statistic, Variance, balances, unwanted, wanted_names
from impactlab.results.stack import DONE
from impactlab.statistics.sensitivity import Sensitivity
from impactlab.sweeps.rerun import sweep_again

NOISES = 8
"""Realizations of noise of each draw: enough to tell what noise does, and few, for many draws."""

LEAST_DRAWS = 64
"""Draws from which on two standard errors of variances and indices hold 93 %."""

DRAWN, MADE_OF = "parameter_value", "draw_configuration"
"""Variables with the drawn numbers, and with what makes each draw again."""

NEEDLESS = "few_samples"
"""Kind of warning of draws that does not concern them together: errors come from their scatter."""

SOBOL = article(
    "Sudret, B.", "Global sensitivity analysis using polynomial chaos expansions", "Reliab. Eng. Syst. Saf.", 93, 2008,
    "964", "10.1016/j.ress.2007.04.002",
)  # fmt: skip
"""Source of indices by polynomials."""


class Question(NamedTuple):
    """What the draws are of."""

    make: Callable[..., Network]
    over: Mapping[str, Uncertain]
    network: Network | None  # that describes them all


@checked
def uncertain(
    make: Callable[..., Network] | Network,
    over: Mapping[str, Any] | None = None,
    duration: float | None = None,
    *,
    realizations: int = 1,
    rng: Any = None,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    **simulate_options: Any,
) -> xr.Dataset:
    """Return statistics over uncertain numbers, and the parts of their variance that noise and each number cause.

    Every 8 realizations of noise have one draw of all numbers; where nothing is random, every realization has its own.
    The draws run as the points of `impactlab.sweep`.

    Parameters
    ----------
    make : callable or Network
        ``make(name=value, ...)`` returns a network; or a network with `impactlab.Uncertain` in the place of numbers, as
        `simulate` takes it as well.
    over : mapping of str to distribution, optional
        Distribution of each argument of the function by name, such as ``scipy.stats.lognorm(0.1, scale=400.0)``; they
        are independent.
    duration : float
        Time over which statistics are taken, after the spin-up (s).
    realizations : int
        Number of realizations of all draws together, a multiple of 8 and at least 512; at least 64 where nothing is
        random.
    rng : optional
        Seed of draws and noise, as for `simulate`. Numbers of one name have the same draws at equal seeds, whatever
        else is uncertain, and more realizations go on with further draws.
    executor, progress : optional
        As for `simulate`.
    **simulate_options
        Further options of `simulate` for all draws.

    Returns
    -------
    xarray.Dataset
        Each statistic of `simulate` as its mean over all draws, with its standard error. The variance of what one
        realization finds is the sum of ``<name>_noise_variance``, which falls with a longer duration, and
        ``<name>_parameter_variance``, which does not; ``<name>_sobol_index`` (parameter, …) is the part of the latter
        that one number causes by itself. All have standard errors. Indices are NaN where the variance by numbers is
        less than two of its standard errors. ``<name>_by_draw`` and ``parameter_value`` (draw, parameter) are what each
        draw found, and its numbers. What records add has the dimension ``draw``.

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
    >>> spread = il.uncertain(mounted, over, 20.0, realizations=512, rng=1)
    >>> spread.mean_square_displacement.dims
    ('oscillator',)
    """
    question, seed = _question(make, over), seed_of(rng)
    options = _usable(simulate_options)
    middle = question.make(**{name: item.median for name, item in question.over.items()})
    noises = NOISES if Model.of(middle).random.any() else 1
    draws = _draws(realizations, noises)
    shares = [_shares(seed, name, draws) for name in question.over]
    values = np.stack(
        [np.asarray(item.ppf(share)) for item, share in zip(question.over.values(), shares, strict=True)], axis=1
    )

    def made(draw: int) -> Network:
        return question.make(**dict(zip(question.over, values[draw].tolist(), strict=True)))

    warnings: list[ImpactLabWarning] = []
    with heard_by(warnings.append):
        found = impactlab.sweep(
            made, {"draw": range(draws)}, rng=seed, duration=duration, realizations=noises, executor=executor,
            progress=progress, **options,
        )  # fmt: skip
    for warning in warnings:
        if warning.kind != NEEDLESS:
            give(warning)
    return _summary(found, list(question.over), values, question.network)


def again(
    dataset: xr.Dataset, options: Mapping[str, Any], progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Return statistics over uncertain numbers again from what is stored with them."""
    kept = dataset[[MADE_OF, "spin_up"]].rename({MADE_OF: CONFIGURATION})
    kept["status"] = xr.full_like(kept[CONFIGURATION], DONE)
    kept.attrs = {**dataset.attrs, CONFIGURATION: json.dumps({"sweep": {"names": ["draw"], "reference": False}})}
    network = impactlab.network_of(dataset) if options["described"] else None
    with heard_by(lambda warning: None):
        found = sweep_again(kept, False, None, progress)
    return _summary(found, list(options["names"]), dataset[DRAWN].transpose("draw", "parameter").values, network)


def _question(make: Any, over: Any) -> Question:
    """Return the networks that are asked for, or refuse distributions and ranges that give none."""
    if isinstance(make, Network):
        if over is not None or not make.is_uncertain:
            raise InvalidInput(
                "A network that uncertain takes has il.Uncertain in the place of some of its numbers, and no over=; "
                "functions of uncertain numbers take over={name: distribution}."
            )
        return Question(lambda **numbers: make.with_numbers(numbers), make.uncertain_numbers, make)
    if not isinstance(over, Mapping) or not over:
        raise InvalidInput(f"over is made of distributions by name, such as scipy.stats.norm(4.0, 0.1), not {over!r}.")
    if not callable(make):
        raise InvalidInput(f"make must be a function that returns an il.Network, or a network, not {make!r}.")
    taken = {}
    for name, item in over.items():
        try:
            taken[name] = item if isinstance(item, Uncertain) else Uncertain(item)
        except InvalidInput as error:
            raise InvalidInput(f"over, {name!r}: {error}") from None
    try:
        inspect.signature(make).bind(**dict.fromkeys(over))
    except TypeError as error:
        raise InvalidInput(f"make cannot be called with the names {', '.join(over)}: {error}.") from None
    middle = {name: item.median for name, item in taken.items()}
    for name, item in taken.items():
        for value in item.range:
            try:
                make(**{**middle, name: value})
            except ImpactLabError as error:
                raise InvalidInput(
                    f"The distribution of {name!r} holds {value:.6g}, with which there is no network: {error}"
                ) from None
    return Question(make, taken, None)


def _usable(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options of draws, which have statistics of each realization; refuse those of one network alone."""
    for name in ("tolerance", "max_seconds", "continues", "branch", "out"):
        if options.get(name) is not None and options[name] is not False:
            raise InvalidInput(
                f"{name}= is for a network without uncertain numbers; give duration= and realizations=, and use "
                "il.save for a file."
            )
    left = {name: value for name, value in options.items() if value is not None and value is not False}
    records = impactlab.Record.all_of(left["record"]) if "record" in left else []
    if not any(isinstance(item, PerRealization) for item in records):
        records = [*records, PerRealization()]
    if names := wanted_names(left.get("statistics")):
        of_variances = [_moments(EVERY[name]) for name in names if isinstance(EVERY[name], Variance)]
        left["statistics"] = list(dict.fromkeys([*names, *(name for pair in of_variances for name in pair)]))
    return {**left, "record": records}


def _draws(realizations: Any, noises: int) -> int:
    """Return the number of draws."""
    number = whole("realizations", realizations, 1)
    if number % noises or number < LEAST_DRAWS * noises:
        each = f", each of {noises} realizations of noise" if noises > 1 else ""
        multiple = f" and a multiple of {noises}" if noises > 1 else ""
        raise InvalidInput(
            f"realizations must be at least {LEAST_DRAWS * noises}{multiple} where numbers are uncertain, for "
            f"{LEAST_DRAWS} draws{each}, not {number}."
        )
    return number // noises


def _shares(seed: Seed, name: str, draws: int) -> np.ndarray:
    """Return the shares below the draws of a number, which depend on its name and the seed alone."""
    word = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    return np.random.default_rng([*seed, word]).random(draws)


def _summary(found: xr.Dataset, names: Sequence[str], values: np.ndarray, network: Network | None) -> xr.Dataset:
    """Return means, variances and indices from the results of all draws."""
    done = (found["status"] == DONE).values
    if not done.all():
        place = int((~done).argmax())
        row = dict(zip(names, values[place].tolist(), strict=True))
        raise InvalidInput(f"With {row} there is no result: {found['status'].values[place]}")
    if "warning" in found.dims:
        found = found.sel(warning=[kind for kind in found["warning"].values if kind != NEEDLESS])
        found = found if found.sizes["warning"] else found.drop_dims("warning")
    known = [item for item in EVERY.values() if item.by_realization in found]
    shares = (rankdata(values, axis=0) - 0.5) / len(values)
    variables: Variables = {}
    for item in known:
        variables |= _of_statistic(item, found[item.by_realization], _each(item, found), shares)
    variables[DRAWN] = labelled(("draw", "parameter"), values, "", "drawn number")
    coordinates = {"parameter": labelled(("parameter",), np.array(names), "", "uncertain number")}
    of_statistics = unwanted([]) | {
        name for item in balances() for name in (item.name, item.error, item.by_realization)
    }
    further = found.drop_vars(["status", *(name for name in of_statistics if name in found)]).rename(
        {CONFIGURATION: MADE_OF}
    )
    if not any("realization" in item.dims for item in further.data_vars.values()):
        further = further.drop_vars("realization")
    configuration: dict[str, Any] = {"uncertain": {"names": list(names), "described": network is not None}}
    configuration |= {} if network is None else {"network": stored(network)}
    sources = f"{found.attrs.get('references', '')} {in_one_line([SOBOL])}"
    told = provenance("Statistics over uncertain numbers", json_of(configuration), sources)
    return further.assign(variables).assign_coords(coordinates).assign_attrs(told)


def _moments(statistic: Statistic) -> tuple[str, str]:
    """Return the names of the mean and the mean square that a variance is made of."""
    mean, square = (statistic.name.replace("variance", kind) for kind in ("mean", "mean_square"))
    return mean, square


def _each(statistic: Statistic, found: xr.Dataset) -> np.ndarray:
    """Return what each realization tells of a statistic of its draw, (draw, realization, …)."""
    values: np.ndarray = found[statistic.by_realization].values
    if not isinstance(statistic, Variance):
        return values
    x, squares = (found[EVERY[name].by_realization].values for name in _moments(statistic))
    mean = x.mean(axis=1, keepdims=True)
    scatter = x.var(axis=1, ddof=1, keepdims=True) / x.shape[1] if x.shape[1] > 1 else 0.0
    return np.asarray(squares - 2.0 * mean * x + mean**2 + scatter)


def _of_statistic(statistic: Statistic, own: xr.DataArray, values: np.ndarray, shares: np.ndarray) -> Variables:
    """Return mean, variances and indices of a statistic as variables."""
    dims, units, text = tuple(map(str, own.dims[2:])), own.attrs.get("units", "1"), statistic.long_name
    found, name, by = Sensitivity.of(values, shares), statistic.name, f"of what a realization finds: {text}"
    square = "1" if units == "1" else f"({units})^2"
    return {
        **with_error(name, dims, *found.mean, units, f"{text}, mean over draws"),
        **with_error(f"{name}_noise_variance", dims, *found.noise, square, f"variance by noise {by}"),
        **with_error(f"{name}_parameter_variance", dims, *found.numbers, square, f"variance by uncertain numbers {by}"),
        **with_error(
            f"{name}_sobol_index", ("parameter", *dims), *found.indices, "1",
            f"part of the variance by uncertain numbers that one number causes by itself: {text}",
        ),
        f"{name}_by_draw": labelled(("draw", *dims), found.means, units, f"{text}, by draw"),
    }  # fmt: skip
