"""Numbers with errors, and the way from a question to a number in the study's results."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from impactlab.results.measured import measured_text

if TYPE_CHECKING:
    from impactlab_two_system.study import TwoSystemStudy

SURE = 3.0
"""Standard errors beyond which a difference is taken as real."""

SOURCES = {
    "accurate": "accurate",
    "paper": "paper",
    "analytic": "reference/analytic",
    "exact": "reference/exact",
    "fokker-planck": "reference/fokker_planck",
    "linear": "linear",
}


class Missing(Exception):
    """The settings of the study leave out what a question needs."""


@dataclass(frozen=True)
class Measured:
    """A value with its standard error; errors of two values are taken as independent."""

    value: float
    error: float = 0.0

    def __sub__(self, other: Measured) -> Measured:
        return Measured(self.value - other.value, math.hypot(self.error, other.error))

    def __truediv__(self, other: Measured) -> Measured:
        ratio = self.value / other.value
        return Measured(ratio, math.hypot(self.error, ratio * other.error) / abs(other.value))

    def against(self, other: Measured) -> Measured:
        """Relative difference self/other − 1."""
        ratio = self / other
        return Measured(ratio.value - 1.0, ratio.error)

    def within(self, limit: float) -> bool:
        """Whether the value may be within ±limit: it is, but for three standard errors at most."""
        return abs(self.value) <= limit + SURE * self.error

    def surely_positive(self) -> bool:
        """Whether the value is above zero by more than three standard errors."""
        return self.value > SURE * self.error

    def surely_negative(self) -> bool:
        """Whether the value is below zero by more than three standard errors."""
        return self.value < -SURE * self.error

    def __format__(self, style: str) -> str:
        """Show the value to the digits that its error leaves; style "%" shows both in percent."""
        return (
            f"{measured_text(100.0 * self.value, 100.0 * self.error)} %"
            if style == "%"
            else measured_text(self.value, self.error)
        )


@dataclass(frozen=True, eq=False)
class _Table:
    """The values of a variable, first along what tells cases apart, with the place of each label there.

    Thousands of numbers are looked up, and `sel` takes half a millisecond for each.
    """

    values: np.ndarray
    places: dict[str, dict[Any, int]]

    @classmethod
    def of(cls, variable: xr.DataArray) -> _Table:
        cases: tuple[str, ...] = ("frequency_ratio", "clearance", "oscillator", "contact")
        dims = [dim for dim in cases if dim in variable.dims]
        places = {dim: {label: place for place, label in enumerate(variable[dim].values.tolist())} for dim in dims}
        return cls(variable.transpose(*dims, ...).values, places)


class Results:
    """Access to the results of a study by the words of its claims.

    Sources are ``accurate``, ``paper``, ``analytic`` (the paper's solution), ``exact``,
    ``fokker-planck`` and ``linear``. A number of the paper variant comes from one record; its standard error
    is the scatter of such records in the accurate variant, which has the same length,
    and NaN if that was not run.
    """

    def __init__(self, study: TwoSystemStudy, tree: xr.DataTree) -> None:
        self.study = study
        self.tree = tree
        self._nodes: dict[str, xr.Dataset] = {}
        self._tables: dict[tuple[str, str], _Table] = {}
        self._densities: dict[tuple[str, str, float], xr.Dataset] = {}

    def node(self, path: str) -> xr.Dataset:
        """Return one group of the tree."""
        if path not in self._nodes:
            try:
                self._nodes[path] = self.tree[path].to_dataset()
            except KeyError:
                raise Missing(f"there are no results for {path}") from None
        return self._nodes[path]

    @property
    def solved(self) -> list[float]:
        """Frequency ratios at which the Fokker–Planck equation was solved."""
        try:
            return list(self.node(SOURCES["fokker-planck"])["frequency_ratio"].values.tolist())
        except Missing:
            return []

    def ratios(self, low: float, high: float = math.inf) -> list[float]:
        """Return the frequency ratios from `low` to `high`, of which there must be one."""
        found = [ratio for ratio in self.study.frequency_ratios if low <= ratio <= high]
        if not found:
            wanted = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            raise Missing(f"no frequency ratio of {wanted} was computed")
        return found

    def value(self, name: str, label: str, ratio: float, clearance: float, source: str = "accurate") -> Measured:
        """Return one statistic of a system, of the contact ("gap"), of both ("") or their ratio ("one/two")."""
        if label == "one/two":
            first, second = (self.value(name, system, ratio, clearance, source) for system in ("one", "two"))
            return first / second
        value = float(self._at(SOURCES[source], name, label, ratio, clearance))
        if source == "paper":
            known = "accurate" in self.study.variants
            return Measured(value, self.one_record(name, label, ratio, clearance) if known else math.nan)
        error = f"{name}_standard_error"
        known = error in self.node(SOURCES[source])
        return Measured(value, float(self._at(SOURCES[source], error, label, ratio, clearance)) if known else 0.0)

    def one_record(self, name: str, label: str, ratio: float, clearance: float) -> float:
        """Return the standard deviation of a statistic of one record, from the ensemble."""
        return float(self._at("accurate", f"{name}_scatter", label, ratio, clearance))

    def peaks(self, ratio: float, clearance: float, records: int = 1) -> np.ndarray:
        """Return the largest forces of so many records at a time (N)."""
        peaks = self._at("peaks", "peak_contact_force_by_realization", "gap", ratio, clearance)
        peaks = peaks[np.isfinite(peaks)]
        return np.asarray(peaks[: peaks.size // records * records].reshape(-1, records).max(axis=1))

    def _at(self, path: str, name: str, label: str, ratio: float, clearance: float) -> np.ndarray:
        """Return the values of a variable of a group in one case, for one system or the contact."""
        if (path, name) not in self._tables:
            self._tables[path, name] = _Table.of(self.node(path)[name])
        table = self._tables[path, name]
        wanted: dict[str, Any] = {
            "frequency_ratio": ratio,
            "clearance": clearance,
            "oscillator": label,
            "contact": label,
        }
        try:
            place = tuple(places[wanted[dim]] for dim, places in table.places.items())
        except KeyError:
            raise Missing(f"ω̄ = {ratio:g}, d = {clearance:g} m was not computed") from None
        return np.asarray(table.values[place])

    def distance(
        self, system: str, quantity: str, ratio: float, source: str = "accurate", other: str = "analytic"
    ) -> Measured:
        """Return the probability that one density has elsewhere than another, ½∫|p − q|.

        The error is what the noise of the bins alone would give: for the paper variant
        that of one record, from the scatter of the records of the accurate variant.
        """
        accurate = self.density("density/accurate", system, ratio)
        width = accurate[f"{quantity}_edges"].diff(f"{quantity}_edge").values
        noise = accurate[f"density_{quantity}_standard_error"].values
        if "paper" in (source, other):
            noise = noise * math.sqrt(self.study.ensemble(ratio))
        first, second = (
            self.density("reference/density" if name == "analytic" else f"density/{name}", system, ratio)
            for name in (source, other)
        )
        difference = np.abs(first[f"density_{quantity}"].values - second[f"density_{quantity}"].values)
        expected = math.sqrt(2.0 / math.pi) * np.nan_to_num(noise)
        return Measured(float(0.5 * difference @ width), float(0.5 * expected @ width))

    def density(self, path: str, system: str, ratio: float) -> xr.Dataset:
        """Return the densities of one system at one frequency ratio, from a group of densities."""
        case = path, system, ratio
        if case not in self._densities:
            node = self.node(path)
            if ratio not in node.frequency_ratio:
                raise Missing(f"ω̄ = {ratio:g} was not computed")
            self._densities[case] = node.sel(frequency_ratio=ratio, oscillator=system)
        return self._densities[case]

    def excess_kurtosis(self, system: str, ratio: float) -> Measured:
        """Return the excess kurtosis of a velocity, from its density."""
        density = self.density("density/accurate", system, ratio)
        width = density["velocity_edges"].diff("velocity_edge").values
        center, value = density["velocity_center"].values, density["density_velocity"].values * width
        second, fourth = (value @ center**power for power in (2, 4))
        slope = center**4 / second**2 - 2.0 * fourth * center**2 / second**3
        error = np.sqrt(((slope * width * density["density_velocity_standard_error"].values) ** 2).sum())
        return Measured(float(fourth / second**2 - 3.0), float(error))

    def seeds(self, item: str, name: str, system: str) -> np.ndarray:
        """Return a mean square of each record of an item that takes many in the paper's way."""
        values = self.node("seeds")[name].sel(item=item, oscillator=system).values
        return np.asarray(values[np.isfinite(values)])

    def scatter(self, item: str, name: str, system: str) -> Measured:
        """Return the relative standard deviation of one record over the seeds of an item."""
        values = self.seeds(item, name, system)
        relative = float(values.std(ddof=1) / values.mean())
        return Measured(relative, relative / math.sqrt(2.0 * (values.size - 1)))


def mean(values: np.ndarray) -> Measured:
    """Return the mean of independent values with its standard error."""
    return Measured(float(values.mean()), float(values.std(ddof=1) / math.sqrt(values.size)))
