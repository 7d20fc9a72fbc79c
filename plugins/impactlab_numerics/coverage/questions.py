"""Questions to random networks, and the differences of answers of short and of longer runs in their errors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import scipy.stats
import xarray as xr
from scipy.special import ndtri

import impactlab as il
from impactlab_numerics.coverage.networks import Drawn

RECORDS: dict[str, tuple[str, ...]] = {
    "Observable": (
        "mean_kinetic", "mean_square_kinetic", "largest_kinetic", "mean_squeezing", "mean_square_squeezing",
        "mean_stretching",
    ),
    "EnergyFlows": (
        "power_in", "power_dissipated", "power_stored", "contact_power_dissipated", "contact_power_carried",
        "contact_power_stored", "coupling_power_dissipated", "coupling_power_carried", "coupling_power_stored",
        "temperature",
    ),
    "Extremes": ("extreme_mean", "extreme_deviation", "extreme_return_level", "extreme_location", "extreme_scale"),
    "Cycles": ("cycle_damage_rate", "cycle_equivalent_range"),
    "Correlation": ("correlation", "correlation_coefficient"),
    "Wear": ("contact_work_rate",),
}  # fmt: skip
"""Values of each record of a run whose errors are counted."""

BALANCES = "power_balance", "network_power_balance"
"""Values that are 0 up to their errors."""

PASSAGES = "survival", "hazard", "restricted_mean_passage_time"
"""Values of first passages."""

UNCERTAIN = "mean_square_displacement", "mean_square_velocity"
"""Statistics over uncertain numbers."""

SPREADS = {"stiffness": scipy.stats.lognorm(0.2), "damping": scipy.stats.lognorm(0.5)}
"""Factors of a body's numbers, the second of a skewed law."""

SCALES = np.array([0.4, 0.7, 1.0, 1.4, 2.5])
"""Scales of a noise that moves a network beyond a limit."""

WINDOWS = 4
"""Windows of extremes in a realization; of runs of few realizations, in a batch."""

BATCHES = 80
"""Windows of all realizations together, at least so many times `WINDOWS`: some more than the batches of a run."""

ROUNDING = 1e-9
"""Part of a value below which differences and errors are rounding."""

TOLD = 0.02
"""Least probability, and least complement, at which a band is looked at: counts are whole numbers."""


class Row(NamedTuple):
    """The difference of two answers."""

    question: str
    quantity: str
    z: float  # in standard errors of the difference


def kinetic(velocity):  # type: ignore[no-untyped-def]  # a kernel
    """Return the square of a velocity."""
    return velocity * velocity


def squeezing(force, rate):  # type: ignore[no-untyped-def]  # a kernel
    """Return the power of a contact."""
    return force * rate


def stretching(extension, rate):  # type: ignore[no-untyped-def]  # a kernel
    """Return the squares of an extension and of its rate, as a number."""
    return extension * extension + rate * rate


def records_of(item: Drawn) -> list[il.Record]:
    """Return all records that the network may have."""
    options, network = item.options, item.network
    step, steps = options["step"], round(options["duration"] / options["step"])
    windows = WINDOWS * math.ceil(BATCHES / options["realizations"])
    window = step * max(1, steps // windows)
    records: list[il.Record] = [
        il.Observable("kinetic", kinetic, per="oscillator", units="m2 s-2"),
        il.EnergyFlows(),
        il.Extremes(windows=(window,), return_times=(2.0 * window, 10.0 * window)),
        il.Cycles(),
        il.Correlation((0.0, step * max(1, steps // (25 * windows)))),
    ]
    if network.contacts:
        records += [il.Observable("squeezing", squeezing, per="contact", units="W"), il.Wear()]
    if network.couplings:
        records.append(il.Observable("stretching", stretching, per="coupling", units="1"))
    return records


def run(item: Drawn, times: int, **changes: Any) -> xr.Dataset:
    """Simulate with so many times the realizations, and other noise."""
    options = item.options | changes
    number = options.pop("realizations") * times
    return il.simulate(item.network, realizations=number, rng=[item.number, times], **options)


def of_records(item: Drawn, times: int, refused: list[str]) -> tuple[xr.Dataset, xr.Dataset]:
    """Return a short and a longer run with all records that are not refused."""
    records = records_of(item)
    while True:
        try:
            short = run(item, 1, record=records)
            return short, run(item, times, record=records)
        except il.InvalidInput as error:
            left = [record for record in records if type(record).__name__ not in str(error).split("\n")[0]]
            if len(left) == len(records):
                raise
            refused.append(str(error))
            records = left


def of_passages(item: Drawn, times: int, limits: dict[str, float]) -> list[xr.Dataset]:
    """Return first passages of limits from rest."""
    record = il.FirstPassage(limits, intervals=4)
    changes = {"initial": "rest", "record": record, "spin_up": None}
    return [run(item, number, **changes) for number in (1, times)]


def of_uncertain(item: Drawn, times: int, name: str) -> list[xr.Dataset]:
    """Return statistics over the stiffness and the damping of a body, alone under its noise."""
    body, noise = item.network.oscillators[name], item.network.excitations[name]
    alone = il.Network({name: body}, {}, {name: noise})

    def make(**factors: float) -> il.Network:
        changed = {field: factor * getattr(body, field) for field, factor in factors.items()}
        return alone.replace(oscillators={name: body.replace(**changed)})

    options = item.options | {"statistics": UNCERTAIN}
    del options["realizations"]
    if isinstance(options.get("initial"), dict):
        options["initial"] = "rest"
    return [
        il.uncertain(make, SPREADS, realizations=512 * number, rng=[item.number, number], **options)
        for number in (1, times)
    ]


def of_fragility(item: Drawn, times: int, limits: dict[str, float]) -> list[xr.Dataset]:
    """Return the fragility of the network under noise on one of its bodies alone."""
    (name,) = limits
    network, body = item.network, item.network.oscillators[name]
    own = network.excitations.get(name)
    density = getattr(own, "spectral_density", None) or limits[name] ** 2 * body.stiffness * body.damping / math.pi

    def make(record: il.Excitation) -> il.Network:
        source = il.Source(record, on={name: 1.0})
        return network.replace(excitations={**dict.fromkeys(network.excitations), "noise": source})

    return [
        il.fragility(
            make, il.WhiteNoise(density), SCALES, limits, duration=item.options["duration"],
            realizations=64 * number, step=item.options["step"], rng=[item.number, number],
        )
        for number in (1, times)
    ]  # fmt: skip


def compared(question: str, names: Iterable[str], short: xr.Dataset, long: xr.Dataset) -> Iterator[Row]:
    """Yield the differences of values whose errors both runs tell, in errors of the difference."""
    for name in names:
        if name not in short or name not in long:
            continue
        values, errors = (
            np.stack([item[name + end].values.ravel() for item in (short, long)]) for end in ("", "_standard_error")
        )
        both, difference = np.hypot(*errors), values[0] - values[1]
        known = np.isfinite(both) & np.isfinite(difference) & (errors > 0.0).all(axis=0)
        known &= np.maximum(both, np.abs(difference)) > ROUNDING * np.abs(values).max(axis=0)
        yield from (Row(question, name, float(z)) for z in difference[known] / both[known])


def balances(short: xr.Dataset, long: xr.Dataset) -> Iterator[Row]:
    """Yield what is left of balances of energy, in their errors."""
    for run_of, dataset in zip(("", " of longer runs"), (short, long), strict=True):
        for name in BALANCES:
            if name in dataset:
                most = max(np.abs(dataset[item].values).max(initial=0.0) for item in ("power_in", "power_dissipated"))
                values, errors = (np.atleast_1d(dataset[name + end].values) for end in ("", "_standard_error"))
                for value, error in zip(values, errors, strict=True):
                    if error > 0.0 and max(error, abs(value)) > ROUNDING * most:
                        yield Row("balance", name + run_of, float(value / error))


def passages(short: xr.Dataset, long: xr.Dataset) -> Iterator[Row]:
    """Yield differences of first passages; survival where it is told."""
    told = np.flatnonzero((long.survival > TOLD) & (long.survival < 1.0 - TOLD))
    yield from compared("FirstPassage", PASSAGES, *(item.isel(survival_time=told) for item in (short, long)))


def bands(short: xr.Dataset, long: xr.Dataset, times: int) -> Iterator[Row]:
    """Yield differences of probabilities in the errors that bands stand for, at which these would hold 95 %."""
    normal, wider = ndtri(0.975), math.sqrt(1.0 + 1.0 / times)
    for name, change in (("probability", np.asarray), ("fitted_probability", ndtri)):
        values = np.stack([item.values.ravel() for item in (long[name], short[f"{name}_low"], short[f"{name}_high"])])
        told = (values[0] > TOLD) & (values[0] < 1.0 - TOLD) & (values[1] < values[2])
        expected, low, high = change(values[:, told])
        off = (expected - 0.5 * (low + high)) / (0.5 * (high - low))
        yield from (Row("fragility", name, float(normal * z / wider)) for z in off if math.isfinite(z))
