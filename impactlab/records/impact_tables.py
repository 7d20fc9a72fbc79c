"""Impacts of all contacts: kept as lists, or counted into bins, and their labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.kernels.event_log import (
    BEGAN,
    CLOSING,
    DURATION,
    EVENT,
    IMPULSE,
    LARGEST,
    LEAVING,
    LOST_ENERGY,
    OF_CONTACT,
)
from impactlab.kernels.impacts_at_steps import CLOSED_AT_START, FLAG, LANE, SUBSAMPLE
from impactlab.results.labels import Variables, labelled, with_error


class OfImpact(NamedTuple):
    """A quantity of an impact."""

    column: int
    units: str
    per: str  # units of its density
    long_name: str


OF_IMPACTS = {
    "closing_velocity": OfImpact(CLOSING, "m s-1", "s m-1", "relative velocity at which a contact closes"),
    "leaving_velocity": OfImpact(LEAVING, "m s-1", "s m-1", "relative velocity at which a contact opens"),
    "duration": OfImpact(DURATION, "s", "s-1", "time from closing to opening"),
    "impulse": OfImpact(IMPULSE, "N s", "N-1 s-1", "integral of the contact force over an impact"),
    "largest_force": OfImpact(LARGEST, "N", "N-1", "largest contact force in an impact"),
    "lost_energy": OfImpact(LOST_ENERGY, "J", "J-1", "work that the bodies do on the contact in an impact"),
}
"""What is known of an impact, by name."""

NARROWEST = -300
"""Bins without limits are at least two to this power wide: none of the quantities is that small but 0."""


class Tally:
    """Takes the impacts of some realizations.

    Parameters
    ----------
    bins : int or None
        Number of bins; without, impacts are listed.
    limits : mapping of str to pair
        Lower and upper limit of the bins of quantities; others have bins from 0 on, as wide as they have to be.
    quantities : sequence of str
        Names of the quantities that are wanted.
    contacts : int
        How many contacts are followed.
    subsamples : (int, int)
        The first subsample of the realizations, and how many there are.
    most : float
        How many impacts may be listed.
    """

    def __init__(
        self, bins: int | None, limits: dict[str, tuple[float, float]], quantities: Sequence[str], contacts: int,
        subsamples: tuple[int, int], most: float,
    ) -> None:  # fmt: skip
        self.bins, self.quantities, self.most, self.listed = bins, quantities, most, 0
        self.columns = [OF_IMPACTS[name].column for name in quantities]
        self.first, number = subsamples
        shape = len(quantities), contacts, number
        self.closings = np.zeros((contacts, number))
        self.values, self.sums = np.zeros(shape), np.zeros(shape)
        self.counts = np.zeros((*shape, (bins or -2) + 2), dtype=np.int64)
        self.exponents = np.full(shape[:2], NARROWEST)
        self.limits = [limits.get(name) for name in quantities]
        self.lists: list[np.ndarray] = []

    def take(self, rows: np.ndarray) -> None:
        """Take impacts, (impact, column), see `impactlab.kernels.impacts_at_steps`."""
        contact, subsample = rows[:, OF_CONTACT].astype(int), rows[:, SUBSAMPLE].astype(int) - self.first
        flags = rows[:, FLAG].astype(int)
        began = flags & CLOSED_AT_START == 0
        np.add.at(self.closings, (contact[began], subsample[began]), 1.0)
        for place, column in enumerate(self.columns):
            value = rows[:, column]
            counts = np.isfinite(value) & (began if column == CLOSING else flags == 0)
            where = contact[counts], subsample[counts]
            np.add.at(self.values[place], where, 1.0)
            np.add.at(self.sums[place], where, value[counts])
            if self.bins is not None:
                self._count(place, *where, value[counts])
        if self.bins is None:
            self.listed += len(rows)
            if self.listed > self.most:
                raise InvalidInput(
                    f"There have been more than {self.most:.4g} impacts by {rows[-1, BEGAN]:.6g} s, which is what "
                    "il.Impacts may list; give a larger most= (96 bytes each), fewer contacts=, or bins= for "
                    "distributions without lists."
                )
            self.lists.append(rows.copy())

    def _count(self, place: int, contact: np.ndarray, subsample: np.ndarray, value: np.ndarray) -> None:
        """Count values of a quantity into bins, which become wider where a value is beyond them."""
        assert self.bins is not None
        given = self.limits[place]
        if given is None:
            largest = np.zeros(self.counts.shape[1])
            np.maximum.at(largest, contact, value)
            needed = np.where(largest > 0.0, np.frexp(largest / self.bins)[1], NARROWEST)
            for slot in np.flatnonzero(needed > self.exponents[place]):
                self.counts[place, slot] = widened(self.counts[place, slot], needed[slot] - self.exponents[place, slot])
                self.exponents[place, slot] = needed[slot]
            bins = np.floor(np.ldexp(value, -self.exponents[place, contact]))
        else:
            bins = np.floor((value - given[0]) * (self.bins / (given[1] - given[0])))
        inside = (bins.clip(-1.0, self.bins) + 1.0).astype(int)
        np.add.at(self.counts[place], (contact, subsample, inside), 1)

    def result(self) -> dict[str, np.ndarray]:
        """Return what was collected; lists by realization, contact and time."""
        rows = np.concatenate([np.zeros((0, EVENT)), *self.lists])
        rows = rows[np.lexsort((rows[:, BEGAN], rows[:, OF_CONTACT], rows[:, LANE]))]
        return {
            "first": np.array(self.first), "closings": self.closings, "values": self.values, "sums": self.sums,
            "counts": self.counts, "exponents": self.exponents, "rows": rows,
        }  # fmt: skip


def widened(counts: np.ndarray, by: int) -> np.ndarray:
    """Return numbers in bins, the last axis, between those of what is below and above, for bins 2^by times as wide."""
    bins, result = counts.shape[-1] - 2, np.zeros_like(counts)
    result[..., [0, -1]] = counts[..., [0, -1]]
    place = np.arange(bins) >> min(int(by), 62)
    for old, new in enumerate(place):
        result[..., new + 1] += counts[..., old + 1]
    return result


Mean = Callable[[np.ndarray, np.ndarray, slice], tuple[np.ndarray, np.ndarray, float]]
"""Gives mean, standard error and band factor of sums over subsamples; see `impactlab.statistics.subsamples`."""


class Described(NamedTuple):
    """The run of which impacts are told."""

    contacts: tuple[str, ...]  # all
    followed: Sequence[int]  # which of them
    quantities: Sequence[str]
    bins: int | None
    limits: dict[str, tuple[float, float]]
    time: np.ndarray  # (subsample,) observed (s)
    lanes: Sequence[int]  # realizations of each result
    mean: Mean
    of_band: dict[str, str]  # attributes of band factors
    comments: dict[str, str]


def labels(run: Described, results: Sequence[dict[str, np.ndarray]]) -> Variables:
    """Return the variables of impacts."""
    total, exponents = _together(run, results)
    variables = _of_rates(run, total["closings"])
    for place, name in enumerate(run.quantities):
        values, sums = total["values"][place], total["sums"][place]
        variables |= _of_means(run, name, values, sums)
        if run.bins is not None:
            variables |= _of_bins(run, name, total["counts"][place], exponents[place])
    if run.bins is None:
        variables |= _of_lists(run, results)
    for name, comment in run.comments.items():
        for known in variables.keys() & {f"impact_{name}", f"mean_{name}", f"density_{name}"}:
            variables[known][2]["comment"] = comment
    return variables


def _together(run: Described, results: Sequence[dict[str, np.ndarray]]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return sums over all blocks, by subsample, and the exponents of the widths of all bins."""
    exponents = np.max([result["exponents"] for result in results], axis=0)
    total: dict[str, np.ndarray] = {}
    for result in results:
        counts = result["counts"].copy()
        if run.bins is not None:
            for place in np.argwhere(exponents > result["exponents"]):
                slot = tuple(place)
                counts[slot] = widened(counts[slot], (exponents - result["exponents"])[slot])
        for name, own in (*((item, result[item]) for item in ("closings", "values", "sums")), ("counts", counts)):
            axis, begin = (1 if name == "closings" else 2), int(result["first"])
            shape = list(own.shape)
            shape[axis] = len(run.time)
            kept = total.setdefault(name, np.zeros(shape, own.dtype))
            where: list[Any] = [slice(None)] * own.ndim
            where[axis] = slice(begin, begin + own.shape[axis])
            kept[tuple(where)] += own
    return total, exponents


def _everywhere(run: Described, values: np.ndarray) -> np.ndarray:
    """Return values of all contacts, NaN of others than are followed."""
    result = np.full((len(run.contacts), *values.shape[1:]), np.nan)
    result[list(run.followed)] = values
    return result


def _of_rates(run: Described, closings: np.ndarray) -> Variables:
    """Return how often contacts close, by counting."""
    rate, error, _ = run.mean(closings.T, run.time[:, None], slice(None))
    numbers = _everywhere(run, closings.sum(axis=1)), _everywhere(run, rate), _everywhere(run, error)
    text = "rate of impacts that were counted"
    variables = {
        "impact_number": labelled(("contact",), numbers[0], "1", "number of impacts in all realizations"),
        **with_error("impact_rate", ("contact",), *numbers[1:], "s-1", text),
    }
    variables["impact_rate"][2]["comment"] = (
        "contact_rate is a flux where steps are made under noise: it has closings, too, after which the contact opens "
        "again within a step, and which nobody can count."
    )
    return variables


def _of_means(run: Described, name: str, values: np.ndarray, sums: np.ndarray) -> Variables:
    """Return the mean of a quantity over impacts."""
    mean, error = np.full((2, len(values)), np.nan)
    for slot in np.flatnonzero(values.sum(axis=1)):
        found = run.mean(sums[slot][:, None], values[slot][:, None], slice(None))
        mean[slot], error[slot] = found[0][0], found[1][0]
    quantity = OF_IMPACTS[name]
    text = f"mean over impacts of the {quantity.long_name}"
    means = _everywhere(run, mean), _everywhere(run, error)
    return with_error(f"mean_{name}", ("contact",), *means, quantity.units, text)


def _of_bins(run: Described, name: str, counts: np.ndarray, exponents: np.ndarray) -> Variables:
    """Return the distribution of a quantity."""
    assert run.bins is not None
    contacts, quantity = len(run.followed), OF_IMPACTS[name]
    density, error = np.full((2, contacts, run.bins), np.nan)
    factor, edges = np.full(contacts, np.nan), np.full((contacts, run.bins + 1), np.nan)
    for slot in range(contacts):
        samples = counts[slot].sum(axis=1, keepdims=True)
        low, high = run.limits.get(name, (0.0, np.ldexp(float(run.bins), exponents[slot])))
        edges[slot] = np.linspace(low, high, run.bins + 1)
        if samples.sum() and (name in run.limits or exponents[slot] > NARROWEST):
            share, scatter, factor[slot] = run.mean(counts[slot], samples, slice(1, -1))
            width = (high - low) / run.bins
            density[slot], error[slot] = share[1:-1] / width, scatter[1:-1] / width
    edges, dims = _everywhere(run, edges), ("contact", f"{name}_bin")
    text = f"probability density of the {quantity.long_name}, averaged over bins"
    of_density = _everywhere(run, density), _everywhere(run, error)
    return {
        **with_error(f"density_{name}", dims, *of_density, quantity.per, text),
        f"density_{name}_band_factor": (("contact",), _everywhere(run, factor), run.of_band),
        f"{name}_edges": labelled(("contact", f"{name}_edge"), edges, quantity.units, "edges of the bins"),
        f"{name}_center": labelled(dims, 0.5 * (edges[:, 1:] + edges[:, :-1]), quantity.units, "centers of the bins"),
    }


def _of_lists(run: Described, results: Sequence[dict[str, np.ndarray]]) -> Variables:
    """Return the lists of impacts: ragged, one realization of one contact after the other."""
    begins = np.concatenate([[0], np.cumsum(run.lanes)])
    rows = np.concatenate([result["rows"] for result in results])
    lanes = np.concatenate([result["rows"][:, LANE] + begin for result, begin in zip(results, begins, strict=False)])
    realizations, contacts = lanes.astype(np.int32), rows[:, OF_CONTACT].astype(int)
    followed, number = len(run.followed), int(begins[-1])
    sizes = np.bincount(realizations * followed + contacts, minlength=number * followed).astype(np.int64)
    names = np.array([run.contacts[slot] for slot in run.followed])
    along, series = ("impact",), ("impact_series",)
    flags: Any = {
        "long_name": "flags of an impact", "flag_masks": np.array([1, 2, 4], dtype=np.int8),
        "flag_meanings": "closed_at_start ends_in_rest closed_at_end",
        "comment": "One that was closed at the start has the time 0 s and no closing velocity. One that ends in rest, "
        "of a rigid contact, is that of a last bounce with what follows while it rests. What has not ended is told up "
        "to the end of the run.",
    }  # fmt: skip
    text = "number of impacts in each series, one contact in one realization after the other"
    size = labelled(series, sizes, "1", text)
    size[2]["sample_dimension"] = "impact"
    return {
        "impact_series_size": size,
        "impact_series_contact": labelled(series, np.tile(names, number), "", "contact of the series"),
        "impact_series_realization": labelled(
            series, np.repeat(np.arange(number, dtype=np.int32), followed), "", "realization of the series"
        ),
        "impact_contact": labelled(along, names[contacts], "", "contact that closes"),
        "impact_realization": labelled(along, realizations, "", "number of the realization"),
        "impact_time": labelled(along, np.maximum(rows[:, BEGAN], 0.0), "s", "time at which a contact closes"),
        "impact_flag": (along, rows[:, FLAG].astype(np.int8), flags),
        **{
            f"impact_{name}": labelled(
                along, rows[:, OF_IMPACTS[name].column].copy(), OF_IMPACTS[name].units, OF_IMPACTS[name].long_name
            )
            for name in run.quantities
        },
    }
