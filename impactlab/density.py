"""Records of probability densities: histograms of groups of realizations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from impactlab.component import parameter, suggestion
from impactlab.errors import InvalidInput
from impactlab.groups import OF_BAND, group_count, groups_of, mean_of_groups
from impactlab.kernels.histogram import count_pairs, count_samples
from impactlab.linear import spread
from impactlab.model import Model
from impactlab.plan import Plan
from impactlab.record import Keeper, Record, Variables, first_own

_UNITS = {"displacement": "m", "velocity": "m s-1"}
_PER = {"displacement": "m-1", "velocity": "s m-1"}


class Density(Record):
    """Probability density of a displacement or velocity, averaged over bins.

    Standard errors come from groups of realizations (batches, if there are few), as
    for the statistics. A band of as many of them on both sides as the band factor says holds the density in
    all bins with a probability of 95 %.

    Parameters
    ----------
    quantity : str
        "displacement" or "velocity".
    oscillators : sequence of str, optional
        Bodies; all by default.
    bins : int
        Number of bins between the limits.
    limits : pair of float, or mapping of str to pair, optional
        Lower and upper limit, for all bodies or by name; by default 5.5 standard
        deviations of the linear law at the highest temperature that is connected.
    """

    summed: ClassVar[tuple[str, ...]] = ("counts",)

    quantity: str = parameter("displacement")
    oscillators: tuple[str, ...] | None = parameter(None, kw_only=True)
    bins: int = parameter(200, minimum=1)
    limits: Any = parameter(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quantity not in _UNITS:
            raise InvalidInput(f"Density.quantity: {suggestion(self.quantity, _UNITS)}")
        object.__setattr__(self, "limits", _plain_limits(self.limits))

    @property
    def identity(self) -> tuple[str, ...]:
        return type(self).__name__, self.quantity

    def resolved(self, model: Model) -> Record:
        names = _known("Density", self.oscillators, model)
        return self.replace(oscillators=names, limits=_resolved_limits(self, names, self.limits, self.quantity, model))

    def stride(self, model: Model, step: float) -> int:
        return _stride(self.oscillators, model, step)

    def bytes_per_block(self, plan: Plan) -> int:
        return 8 * len(self.limits) * group_count(plan) * (self.bins + 2)

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Counts(self, plan, realizations, ratio)

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        counts = results[0]["counts"]
        samples = counts.sum(axis=2, keepdims=True)
        q, n = self.quantity, len(plan.bodies)
        edges = np.full((n, self.bins + 1), np.nan)
        density, error = np.full((2, n, self.bins), np.nan)
        factor = np.full(n, np.nan)
        for row, (name, low, high) in enumerate(self.limits):
            slot = plan.bodies.index(name)
            edges[slot] = np.linspace(low, high, self.bins + 1)
            share, spread_, factor[slot] = mean_of_groups(counts[:, row], samples[:, row], plan.trusted)
            width = (high - low) / self.bins
            density[slot], error[slot] = share[1:-1] / width, spread_[1:-1] / width
        dims = ("oscillator", f"{q}_bin")
        attrs = {"units": _PER[q], "long_name": f"probability density of the {q}, averaged over bins"}
        of_error = {**attrs, "long_name": f"standard error of the density of the {q}"}
        attrs["ancillary_variables"] = f"density_{q}_standard_error"
        centers = 0.5 * (edges[:, 1:] + edges[:, :-1])
        return {
            f"density_{q}": (dims, density, attrs),
            f"density_{q}_standard_error": (dims, error, of_error),
            f"density_{q}_band_factor": (("oscillator",), factor, OF_BAND),
            f"{q}_edges": (("oscillator", f"{q}_edge"), edges, {"units": _UNITS[q], "long_name": "edges of the bins"}),
            f"{q}_center": (dims, centers, {"units": _UNITS[q], "long_name": "centers of the bins"}),
        }


class JointDensity(Record):
    """Joint probability density of the displacements of two bodies, averaged over bins.

    Parameters
    ----------
    first, second : str
        The bodies.
    bins : int
        Number of bins in each direction.
    limits : mapping of str to pair, optional
        Lower and upper limit by name; by default as for `Density`.
    """

    summed: ClassVar[tuple[str, ...]] = ("counts",)

    first: str = parameter(kw_only=False)
    second: str = parameter(kw_only=False)
    bins: int = parameter(60, minimum=1)
    limits: Any = parameter(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "limits", _plain_limits(self.limits))

    def resolved(self, model: Model) -> Record:
        names = _known("JointDensity", (self.first, self.second), model)
        if self.first == self.second:
            raise InvalidInput(f"JointDensity takes two different bodies, {self.first!r} was given twice.")
        return self.replace(limits=_resolved_limits(self, names, self.limits, "displacement", model))

    def stride(self, model: Model, step: float) -> int:
        return _stride((self.first, self.second), model, step)

    def bytes_per_block(self, plan: Plan) -> int:
        return 8 * group_count(plan) * (self.bins + 2) ** 2

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Pairs(self, plan, realizations, ratio)

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        counts = results[0]["counts"]
        groups = counts.shape[0]
        inner = np.pad(np.ones((self.bins, self.bins), dtype=bool), 1)
        share, spread_, factor = mean_of_groups(
            counts.reshape(groups, -1), counts.sum(axis=(1, 2))[:, None], plan.trusted, inner.ravel()
        )
        shape = (self.bins + 2, self.bins + 2)
        edges = [np.linspace(low, high, self.bins + 1) for _, low, high in self.limits]
        area = (edges[0][1] - edges[0][0]) * (edges[1][1] - edges[1][0])
        names = [f"joint_{side}_bin" for side in ("first", "second")]
        attrs = {
            "units": "m-2",
            "long_name": f"joint density of the displacements of {self.first} and {self.second}",
        }
        variables: Variables = {
            "joint_density": (tuple(names), share.reshape(shape)[1:-1, 1:-1] / area, attrs),
            "joint_density_standard_error": (tuple(names), spread_.reshape(shape)[1:-1, 1:-1] / area, attrs),
        }
        variables["joint_density_band_factor"] = ((), np.array(factor), OF_BAND)
        for side, edge in zip(("first", "second"), edges, strict=True):
            attrs = {"units": "m", "long_name": f"edges of the bins of {getattr(self, side)}"}
            variables[f"joint_{side}_edges"] = ((f"joint_{side}_edge",), edge, attrs)
        return variables


class _Counts(Keeper):
    """Histograms per group of realizations."""

    def __init__(self, record: Density, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        self.groups, self.ratio, self.seen, self.record = groups_of(plan, realizations), ratio, 0, record
        offset = 0 if record.quantity == "displacement" else len(plan.bodies)
        self.quantities = [offset + plan.bodies.index(name) for name, _, _ in record.limits]
        self.counts = np.zeros((len(record.limits), group_count(plan), record.bins + 2), dtype=np.int64)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        first = first_own(self.seen, self.ratio)
        self.seen += len(snapshots)
        for row, (quantity, (_, low, high)) in enumerate(zip(self.quantities, self.record.limits, strict=True)):
            inverse_width = self.record.bins / (high - low)
            count_samples(
                snapshots,
                first,
                self.ratio,
                quantity,
                low,
                inverse_width,
                self.groups[batch],
                self.counts[row],
            )

    def result(self) -> dict[str, np.ndarray]:
        return {"counts": self.counts.transpose(1, 0, 2)}


class _Pairs(Keeper):
    def __init__(self, record: JointDensity, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        self.groups, self.ratio, self.seen, self.record = groups_of(plan, realizations), ratio, 0, record
        self.quantities = np.array([plan.bodies.index(name) for name, _, _ in record.limits])
        self.low = np.array([low for _, low, _ in record.limits])
        self.inverse_width = np.array([record.bins / (high - low) for _, low, high in record.limits])
        self.counts = np.zeros((group_count(plan), record.bins + 2, record.bins + 2), dtype=np.int64)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        first = first_own(self.seen, self.ratio)
        self.seen += len(snapshots)
        count_pairs(
            snapshots, first, self.ratio, self.quantities, self.low, self.inverse_width, self.record.bins,
            self.groups[batch], self.counts,
        )  # fmt: skip

    def result(self) -> dict[str, np.ndarray]:
        return {"counts": self.counts}


def _stride(names: tuple[str, ...] | None, model: Model, step: float) -> int:
    """Sample about three times per period of the fastest body that is recorded."""
    slots = [model.bodies.index(name) for name in names or model.bodies]
    fastest = float(np.sqrt(model.stiffness[slots] / model.mass[slots]).max())
    return max(1, int(2.0 / (fastest * step))) if fastest > 0.0 else 1


def _known(place: str, names: tuple[str, ...] | None, model: Model) -> tuple[str, ...]:
    if not isinstance(names, tuple | None):
        raise InvalidInput(f"{place}: oscillators is a sequence of names such as ({names!r},), {names!r} was given.")
    for name in names or ():
        if name not in model.bodies:
            raise InvalidInput(f"{place}: there is no oscillator {name!r}; {suggestion(name, model.bodies)}")
    return tuple(names) if names else model.bodies


def _plain_limits(limits: Any) -> Any:
    """Return limits as None, a pair, or triples (name, low, high)."""
    if limits is None:
        return None
    items = limits
    if isinstance(limits, Mapping):
        items = [(name, *(pair if isinstance(pair, list | tuple) else (pair,))) for name, pair in limits.items()]
    if not isinstance(items, list | tuple):
        raise InvalidInput(f"Limits are (low, high) or {{name: (low, high)}}, {limits!r} was given.")
    plain = tuple(tuple(item) if isinstance(item, list | tuple) else item for item in items)
    by_name = plain and all(isinstance(item, tuple) for item in plain)
    pairs: list[Any] = [item[1:] for item in plain] if by_name else [plain]
    for pair in pairs:
        if len(pair) != 2 or not all(isinstance(limit, int | float | np.number) for limit in pair):
            raise InvalidInput(f"Limits are (low, high) or {{name: (low, high)}}, {limits!r} was given.")
        low, high = (float(limit) for limit in pair)
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise InvalidInput(f"Limits must be two increasing finite numbers, ({low!r}, {high!r}) was given.")
    return plain


def _resolved_limits(
    record: Record, names: tuple[str, ...], limits: Any, quantity: str, model: Model
) -> tuple[tuple[str, float, float], ...]:
    """Return one (name, low, high) per body."""
    place = type(record).__name__
    if limits and not isinstance(limits[0], tuple):
        return tuple((name, *limits) for name in names)
    given = {name: pair for name, *pair in limits or ()}
    _known(place, tuple(given), model)
    scale = spread(model)[0 if quantity == "displacement" else 1]
    result = []
    for name in names:
        reach = 5.5 * float(scale[model.bodies.index(name)])
        if name not in given and not 0.0 < reach < math.inf:
            raise InvalidInput(f"{place}: limits for {name!r} cannot be chosen; give limits={{{name!r}: (low, high)}}.")
        low, high = given.get(name, (-reach, reach))
        result.append((name, float(low), float(high)))
    return tuple(result)
