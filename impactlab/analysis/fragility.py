"""Fragility: how likely limits are exceeded over the intensity of a motion, and how far apart buildings must stand."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from impactlab.analysis.limit_states import Demand, demands_of
from impactlab.analysis.scaled_motions import (
    RECORD_TIMES,
    RECORD_VALUES,
    ChosenSteps,
    Make,
    RandomMotions,
    RecordedMotions,
    ScaledMotions,
    chosen_steps,
    magnitudes,
    with_excitation,
)
from impactlab.assembly.model import Model
from impactlab.compiling.announced import announced
from impactlab.components.excitation import Excitation
from impactlab.components.literature import article, in_one_line
from impactlab.components.loads import SampledForce
from impactlab.components.stored import entries, json_of, stored
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, finite_array, known_name, positive
from impactlab.located.rows_of_couplings import weights
from impactlab.networks.network import Network
from impactlab.plan.seed import seed_from, seed_of
from impactlab.results.dataset import configuration_of, provenance
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.plain_values import digest, plain_data
from impactlab.simulation.ensemble import Execution
from impactlab.simulation.kept_runs import kept_run
from impactlab.simulation.recorded_runs import Form
from impactlab.statistics.capacities import fraction_band, lognormal, quantile_band

SHARES_BELOW = 0.16, 0.5, 0.84
"""Shares of the records whose peaks are below the curves of an incremental dynamic analysis: a standard deviation."""

CITATIONS = [
    article(
        "Vamvatsikos, D. and Cornell, C. A.", "Incremental dynamic analysis", "Earthq. Eng. Struct. Dyn.", 31, 2002,
        "491", "10.1002/eqe.141",
    ),
    article(
        "Baker, J. W.", "Efficient analytical fragility function fitting using dynamic structural analysis",
        "Earthq. Spectra", 31, 2015, "579", "10.1193/021113EQS025M",
    ),
]  # fmt: skip
"""Sources of the curves, and of their fit."""


@checked
def fragility(
    make: Make,
    records: Sequence[SampledForce] | Excitation,
    scales: Sequence[float] | np.ndarray | xr.DataArray,
    limit: Mapping[str, Any],
    *,
    duration: float | None = None,
    realizations: int | None = None,
    step: float | None = None,
    rng: Any = None,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Return the probabilities with which limits are exceeded over the scale of a motion, and lognormal laws of it.

    All records at all scales run side by side from rest, as realizations of one compiled run, by steps of `ExactFlow`;
    what a linear body does under a record is exact. Peaks are found between steps. The step is chosen so that the
    typical error of peaks is 1e-3 of them at most; ``peak_error`` of the result is that error, measured by half the
    step.

    Parameters
    ----------
    make : callable
        ``make(record)`` returns a network that has the record as an excitation, such as
        ``il.BaseMotion(record)``. It is called once, and the record then exchanged for all others.
    records : sequence of SampledForce, or Excitation
        The records, each of which runs to its own end. Or one random excitation, of which ``realizations`` are drawn,
        the same for all scales.
    scales : sequence of float
        Increasing factors of the records, or intensities if all records have the intensity 1. Attributes of a
        DataArray, such as its units, are kept.
    limit : mapping
        Limits by the name of a body or a point, for the size of its displacement (m), or of a contact, for its force
        (N): a level, or several increasing ones. Other demands have a name of their own, and a pair of a form and its
        levels: weights of displacements by name, or a quantity with a name, such as ``("contact_force", "gap")``.
    duration : float, optional
        Duration of all motions (s). By default that of each record; needed for a random excitation.
    realizations : int, optional
        Number of realizations of a random excitation.
    step : float, optional
        Time step (s); chosen by default.
    rng : optional
        Seed of a random excitation, as for `simulate`.
    executor : concurrent.futures.Executor, optional
        Where to run; threads on all cores by default. Numbers never depend on it.
    progress : bool or callable, optional
        As for `simulate`.
    checkpoint : str or path, optional
        Folder that keeps what is finished, so that the same call goes on where the last one was stopped; as for
        `simulate`.

    Returns
    -------
    xarray.Dataset
        By limit ``state``: ``probability`` (state, scale), the fraction of the records with its 95 % band,
        ``probability_low`` and ``probability_high`` (Wilson); ``median_scale`` and ``dispersion`` of the lognormal law
        of the scale at which a record first exceeds the limit, with standard errors, NaN where fewer than two scales
        have fractions between 0 and 1; its ``fitted_probability`` with the band. By ``demand``: ``peak`` (demand,
        record, scale), the curves of an incremental dynamic analysis, and their ``peak_quantile``.

    Raises
    ------
    InvalidInput
        If something given cannot be used, or a limit is exceeded before the motion begins.

    Examples
    --------
    >>> risk = il.fragility(towers, records, scales=[0.5, 1.0, 2.0], limit={"left": 0.05})
    >>> risk.probability.dims
    ('state', 'scale')
    """
    levels, seed = _scales(scales), seed_of(rng)
    motions = _motions(make, records, levels, duration, realizations, seed)
    demands = demands_of(limit, Model.of(motions.network))
    asked = {"scales": levels, "limit": _plain(limit), "duration": duration, "realizations": realizations, "step": step,
             "records": digest(plain_data(records)), "rng": None if rng is None else seed}  # fmt: skip
    with _kept(checkpoint, "fragility", executor, progress, motions, asked) as (motions, where):
        ranges, chosen = _reached(motions, [demand.form for demand in demands], levels, step, where)
    for demand, start in zip(demands, ranges[:, 2, 0, 0], strict=True):
        if abs(start) >= demand.levels[0]:
            raise InvalidInput(
                f"limit of {demand.name!r}: {demand.levels[0]:g} {demand.units} is exceeded before the motion begins, "
                f"at {abs(start):g} {demand.units}; give a larger one."
            )
    peaks = magnitudes(ranges)
    variables, coordinates = _of_demands(demands, peaks)
    variables |= _of_states(demands, peaks, levels, coordinates)
    options = {"limit": _plain(limit), "duration": duration}
    return _dataset(
        "fragility", "Fragility over the scale of a motion", variables, coordinates, scales, levels, motions, chosen,
        options,
    )  # fmt: skip


@checked
def required_separation(
    make: Make,
    records: Sequence[SampledForce] | Excitation,
    scales: Sequence[float] | np.ndarray | xr.DataArray,
    contact: str,
    *,
    probability: Sequence[float] | float = (0.5, 0.1, 0.05),
    duration: float | None = None,
    realizations: int | None = None,
    step: float | None = None,
    rng: Any = None,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Return the clearance at which a contact closes with some probability, over the scale of a motion.

    Until it closes, nothing depends on the clearance: it is as long open as the relative displacement of what it
    connects, in the network without this contact, is below the clearance. So one run without the contact has the
    required separation at every probability, as a quantile of the largest relative displacements.

    Parameters
    ----------
    make : callable
        As for `fragility`; it returns a network with the contact, whose clearance does not matter.
    records, scales, duration, realizations, step, rng, executor, progress, checkpoint
        As for `fragility`.
    contact : str
        Name of the contact.
    probability : sequence of float
        Probabilities of at least one contact in a motion, between 0 and 1.

    Returns
    -------
    xarray.Dataset
        ``separation`` (probability, scale) (m), with the ends of its 95 % interval, ``separation_low`` and
        ``separation_high``: order statistics, whatever the law is, NaN where there are too few records. And
        ``relative_displacement`` (record, scale), the largest one of each (m).

    Examples
    --------
    >>> found = il.required_separation(towers, records, [1.0], "gap", probability=0.5)
    >>> bool(found.separation > 0.0)
    True
    """
    levels, seed = _scales(scales), seed_of(rng)
    wanted = np.atleast_1d(finite_array("probability", probability))
    if wanted.ndim != 1 or not ((wanted > 0.0) & (wanted < 1.0)).all():
        raise InvalidInput(f"probability must be between 0 and 1, not {probability!r}.")
    motions = _motions(make, records, levels, duration, realizations, seed)
    model = Model.of(motions.network)
    known_name("contact", contact, model.contacts.names)
    if model.contacts.round.any():
        raise InvalidInput("contact: a contact in a plane has no relative displacement of one sign.")
    row = weights(model.ends)[model.contacts.names.index(contact)]
    form = Form({int(slot): float(row[slot]) for slot in np.flatnonzero(row)}, False)
    apart = motions.with_network(motions.network.replace(contacts={contact: None}))
    asked = {"scales": levels, "contact": contact, "duration": duration, "realizations": realizations, "step": step,
             "records": digest(plain_data(records)), "rng": None if rng is None else seed}  # fmt: skip
    with _kept(checkpoint, "required_separation", executor, progress, apart, asked) as (apart, where):
        ranges, chosen = _reached(apart, [form], levels, step, where)
        motions = apart.with_network(motions.network)
    largest, of_scale = ranges[0, 1], ("probability", "scale")
    middle, low, high = (
        np.stack(item) for item in zip(*(quantile_band(largest, 1.0 - p) for p in wanted), strict=True)
    )
    text = "clearance at which the contact closes with the probability"
    variables = {
        "separation": labelled(of_scale, middle, "m", text),
        "separation_low": labelled(of_scale, low, "m", f"lower end of the interval of the {text}"),
        "separation_high": labelled(of_scale, high, "m", f"upper end of the interval of the {text}"),
        "relative_displacement": labelled(
            ("record", "scale"), largest, "m", "largest relative displacement without the contact"
        ),
    }
    coordinates = {"probability": labelled(("probability",), wanted, "1", "probability of at least one contact")}
    options = {"contact": contact, "probability": wanted.tolist(), "duration": duration}
    return _dataset(
        "required_separation", f"Required separation at {contact!r}", variables, coordinates, scales, levels, motions,
        chosen, options,
    )  # fmt: skip


def again(
    dataset: xr.Dataset, options: Mapping[str, Any], progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Return a fragility, or a required separation, again from what is stored with it."""
    network = Network.from_dict(configuration_of(dataset)["network"])
    fields = dict(options)
    question, sources = {"limit": fragility, "contact": required_separation}, fields.pop("sources")
    ask = next(function for name, function in question.items() if name in fields)
    records = _stored_records(dataset, fields.pop("records"))
    if "seed" in fields:
        fields["rng"] = seed_from(fields.pop("seed"))
    found: xr.Dataset = ask(
        lambda record: with_excitation(network, sources, record), records, dataset["scale"], progress=progress, **fields
    )  # type: ignore[operator]
    return found


def _stored_records(dataset: xr.Dataset, stored_as: Any) -> Any:
    """Return the records that a dataset holds, or the random excitation."""
    if isinstance(stored_as, Mapping):
        return Excitation.from_dict(stored_as)
    times, values = dataset[RECORD_TIMES].values, dataset[RECORD_VALUES].values
    counts = np.isfinite(values).sum(axis=1)
    rows = np.broadcast_to(times, values.shape)
    return [
        SampledForce(row[:count], own[:count], **fields)
        for row, own, count, fields in zip(rows, values, counts.tolist(), stored_as, strict=True)
    ]


def _plain(given: Any) -> Any:
    """Return limits as JSON can hold them."""
    if isinstance(given, Mapping):
        return {name: _plain(item) for name, item in given.items()}
    if isinstance(given, list | tuple):
        return [_plain(item) for item in given]
    return given.tolist() if isinstance(given, np.generic | np.ndarray) else given


def _scales(given: Any) -> np.ndarray:
    scales = finite_array("scales", given.values if isinstance(given, xr.DataArray) else given)
    if scales.ndim != 1 or not len(scales) or scales[0] <= 0.0 or (np.diff(scales) <= 0.0).any():
        raise InvalidInput(f"scales must be increasing numbers above 0, not {given!r}.")
    return scales


def _motions(
    make: Make, records: Any, scales: np.ndarray, duration: float | None, realizations: Any, rng: Any
) -> RecordedMotions | RandomMotions:
    """Return records, or realizations of a random excitation."""
    if isinstance(records, Excitation) and not isinstance(records, SampledForce):
        return RandomMotions.of(make, records, duration, realizations, seed_of(rng))
    if realizations is not None:
        raise InvalidInput("realizations= is for a random excitation; records are as many as there are.")
    return RecordedMotions.of(make, records, scales, duration)


@contextlib.contextmanager
def _kept(
    checkpoint: Any,
    question: str,
    executor: Executor | None,
    progress: Any,
    motions: RecordedMotions | RandomMotions,
    asked: dict[str, Any],
) -> Iterator[tuple[Any, Execution]]:
    """Give where to run, and the motions with the seed of the call that made the checkpoint, if there is one."""
    with kept_run(checkpoint, question, executor, {**asked, "network": motions.network}) as (kept, seed):
        if kept is not None and isinstance(motions, RandomMotions):
            motions = replace(motions, seed=seed)
        yield motions, Execution(executor, progress, checkpoint=kept)


def _reached(
    motions: ScaledMotions, forms: Sequence[Form], scales: np.ndarray, step: float | None, where: Execution
) -> tuple[np.ndarray, ChosenSteps]:
    """Return least, largest and first values of forms, (form, 3, record, scale), and the step."""
    given = None if step is None else positive("step", step)
    with announced(where.progress):
        chosen = chosen_steps(motions, forms, scales, given, where)
        found = motions.ranges(forms, np.arange(motions.number), scales, chosen.steps, where, where.report())
    return found, chosen


def _of_demands(demands: Sequence[Demand], peaks: np.ndarray) -> tuple[Variables, Variables]:
    """Return peaks and their quantiles as variables, and coordinates."""
    units = {demand.units for demand in demands}
    common = units.pop() if len(units) == 1 else ""
    text = "largest size in a motion"
    quantiles = np.quantile(peaks, SHARES_BELOW, axis=1, method="hazen").swapaxes(0, 1)
    of_quantiles = labelled(("demand", "quantile", "scale"), quantiles, common, f"quantile of the {text}")
    coordinates = {
        "demand": labelled(("demand",), np.array([item.name for item in demands]), "", "demand"),
        "demand_units": labelled(("demand",), np.array([item.units for item in demands]), "", "units of the demand"),
        "quantile": labelled(("quantile",), np.array(SHARES_BELOW), "1", "share of records with smaller peaks"),
    }
    return {
        "peak": labelled(("demand", "record", "scale"), peaks, common, text),
        "peak_quantile": of_quantiles,
    }, coordinates


def _of_states(demands: Sequence[Demand], peaks: np.ndarray, scales: np.ndarray, coordinates: Variables) -> Variables:
    """Return probabilities and laws of limit states as variables, and add the names of these to the coordinates."""
    states = [(place, level) for place, demand in enumerate(demands) for level in demand.levels]
    names = [f"{demands[place].name} ≥ {level:g} {demands[place].units}" for place, level in states]
    coordinates["state"] = labelled(("state",), np.array(names), "", "limit state")
    coordinates["state_demand"] = labelled(
        ("state",), np.array([demands[place].name for place, _ in states]), "", "demand"
    )
    coordinates["level"] = labelled(
        ("state",), np.array([level for _, level in states]), "", "level of the limit state"
    )
    exceeded = np.stack([peaks[place] >= level for place, level in states])
    laws = [lognormal(item, scales) for item in exceeded]
    counts, along, text = exceeded.sum(axis=1), ("state", "scale"), "probability that the limit is exceeded"
    bands = {"probability": (counts / exceeded.shape[1], *fraction_band(counts, exceeded.shape[1]))}
    fits = (np.stack(item) for item in zip(*(law.probability(scales) for law in laws), strict=True))
    bands["fitted_probability"] = tuple(fits)  # type: ignore[assignment]
    variables: Variables = {}
    for name, band in bands.items():
        of = f"{text}, by the lognormal law" if name.startswith("fitted") else text
        for end, values in zip(("", "_low", "_high"), band, strict=True):
            words = {"": "", "_low": "lower end of the band of the ", "_high": "upper end of the band of the "}[end]
            variables[name + end] = labelled(along, values, "1", words + of)
    errors = np.array([law.errors for law in laws])
    first = "scale at which a record first exceeds the limit"
    median, dispersion = (np.array([getattr(law, name) for law in laws]) for name in ("median", "dispersion"))
    variables |= with_error("median_scale", ("state",), median, errors[:, 0], "1", f"median of the {first}")
    variables |= with_error(
        "dispersion", ("state",), dispersion, errors[:, 1], "1", f"standard deviation of the logarithm of the {first}"
    )
    return variables


def _dataset(
    question: str, title: str, variables: Variables, coordinates: Variables, given: Any, scales: np.ndarray,
    motions: RecordedMotions | RandomMotions, chosen: ChosenSteps, options: dict[str, Any],
) -> xr.Dataset:  # fmt: skip
    """Return the labelled dataset, with what makes it again."""
    own, stored_variables = motions.stored()
    options |= {"sources": list(motions.sources), "step": chosen.steps.step, **own}
    configuration = {"network": stored(motions.network), "fragility": options}
    references = f"{in_one_line(entries(configuration))} {in_one_line(CITATIONS)}"
    attributes = {"units": "1", "long_name": "scale of the motion", **getattr(given, "attrs", {})}
    coordinates = {
        **coordinates,
        "scale": (("scale",), scales, attributes),
        "record": labelled(("record",), np.arange(motions.number), "", "number of the record"),
    }
    return xr.Dataset(
        {**variables, **stored_variables},
        coordinates,
        {
            **provenance(title, json_of(configuration), references),
            "step": chosen.steps.step,
            "peak_error": chosen.typical,
            "peak_error_of_nine_in_ten": chosen.large,
        },
    )
