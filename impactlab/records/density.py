"""Records of probability densities: histograms of subsamples of realizations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput, warn
from impactlab.inputs import suggestion
from impactlab.kernels.histogram import count_pairs, count_samples
from impactlab.linear.given_response import given_ranges
from impactlab.linear.laws import extent
from impactlab.plan.plan import Plan
from impactlab.records.reach import deepest, reach_of_moved
from impactlab.records.record import Keeper, Record, names_of
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.schema import BODY, Variable
from impactlab.results.snapshot import ALL, QUANTITIES, places_of, with_points
from impactlab.statistics.subsamples import OF_BAND, mean_of_subsamples, subsample_count, subsamples_of
from impactlab.step_control.rules.tangent_stiffness import Stiffening

DEVIATIONS = 5.5
"""Standard deviations on either side that densities show where no limits are given."""

PHASE_PLANE = "displacement", "velocity"
"""The quantities of one body whose joint density is that in its phase plane."""

_PER_BOTH = {
    ("displacement", "displacement"): "m-2", ("displacement", "velocity"): "s m-2", ("velocity", "velocity"): "s2 m-2",
    ("contact_force", "displacement"): "m-1 N-1", ("contact_force", "velocity"): "s m-1 N-1",
    ("contact_force", "contact_force"): "N-2",
}  # fmt: skip

_PER = with_points({"displacement": "m-1", "velocity": "s m-1"})


class Density(Record):
    """Probability density of a displacement or velocity, of bodies or of points of structures, averaged over bins.

    Standard errors come from subsamples of realizations (batches, if there are few), as
    for the statistics. A band of as many of them on both sides as the band factor says holds the density in
    all bins with a probability of 95 %.

    Parameters
    ----------
    quantity : str
        "displacement" or "velocity"; "point_displacement" or "point_velocity" at points of structures.
    oscillators : sequence of str, optional
        Bodies, or points; all by default.
    bins : int
        Number of bins between the limits.
    limits : pair of float, or mapping of str to pair, optional
        Lower and upper limit, for all bodies or by name; by default 5.5 standard
        deviations of the linear law at the highest temperature that contacts bring, around where static
        forces hold the body and as far as given forces and motions move it, and for what only contacts hold as far as
        these let it go.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.Density(bins=50), rng=1)
    >>> result.density_displacement.dims
    ('oscillator', 'displacement_bin')
    """

    summed: ClassVar[tuple[str, ...]] = ("counts",)

    quantity: str = parameter("displacement")
    oscillators: tuple[str, ...] | None = parameter(None, kw_only=True)
    bins: int = parameter(200, minimum=1)
    limits: Any = parameter(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quantity not in _PER:
            raise InvalidInput(f"Density.quantity: {suggestion(self.quantity, _PER)}")
        object.__setattr__(self, "limits", _plain_limits(self.limits))

    @property
    def identity(self) -> tuple[str, ...]:
        return type(self).__name__, self.quantity

    def resolved(self, model: Model) -> Record:
        return self.resolved_for(model, 0.0, 0.0)

    def resolved_for(self, model: Model, begin: float, end: float) -> Record:
        known = model.bodies.names if ALL[self.quantity].dimension == BODY else tuple(model.network.points)
        names = self.oscillators
        names = names_of(self, "oscillator", names, self.quantity, model)
        given = given_ranges(model, begin, end) if model.sources["force"].bodies else None
        limits = _resolved_limits(self, names, self.limits, self.quantity.removeprefix("point_"), model, known, given)
        return _with_limits(self.replace(oscillators=names, limits=limits), self.limits)

    def stride(self, model: Model, step: float) -> int:
        return _stride(self.oscillators, model, step)

    def bytes_per_block(self, run: RecordedRun) -> int:
        return 8 * len(self.limits) * subsample_count(run.plan) * (self.bins + 2)

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return Counts(self, run.plan, realizations, ratio)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        plan = run.plan
        counts = results[0]["counts"]
        samples = counts.sum(axis=2, keepdims=True)
        q, known = self.quantity, places_of(plan.snapshot.names(self.quantity))
        n, of = len(known), q.removeprefix("point_")
        edges = np.full((n, self.bins + 1), np.nan)
        density, error = np.full((2, n, self.bins), np.nan)
        factor = np.full(n, np.nan)
        for row, (name, low, high) in enumerate(self.limits):
            slot = known[name]
            edges[slot] = np.linspace(low, high, self.bins + 1)
            trusted = plan.realizations.trusted
            share, spread_, factor[slot] = mean_of_subsamples(counts[:, row], samples[:, row], trusted)
            _warn_of_outside(self, row, 1.0 - share[1:-1].sum(), of)
            width = (high - low) / self.bins
            density[slot], error[slot] = share[1:-1] / width, spread_[1:-1] / width
        dimension, units = ALL[q].dimension, ALL[q].units
        dims, centers = (dimension, f"{q}_bin"), 0.5 * (edges[:, 1:] + edges[:, :-1])
        text = f"probability density of the {ALL[q].long_name}, averaged over bins"
        return {
            **with_error(f"density_{q}", dims, density, error, _PER[q], text),
            f"density_{q}_band_factor": ((dimension,), factor, OF_BAND),
            f"{q}_edges": labelled((dimension, f"{q}_edge"), edges, units, "edges of the bins"),
            f"{q}_center": labelled(dims, centers, units, "centers of the bins"),
        }


class JointDensity(Record):
    """Joint probability density of two displacements, velocities or contact forces, averaged over bins.

    A contact that is open has the force 0, which is in the first bin from 0 on.

    Parameters
    ----------
    first, second : str
        The bodies, points of structures or contacts; one twice where the quantities differ.
    bins : int
        Number of bins in each direction.
    limits : pair of float, mapping of str to pair, or two pairs, optional
        Lower and upper limit, for both, by name, or of the first and the second; by default as for `Density`, and of
        forces from 0 to that at which the contact stores 20 thermal energies.
    quantities : pair of str
        "displacement", "velocity" or "contact_force", of the first and of the second.

    Examples
    --------
    The density in the phase plane of a body:

    >>> il.JointDensity("a", "a", quantities=("displacement", "velocity"))
    JointDensity(first='a', second='a', quantities=('displacement', 'velocity'))
    """

    summed: ClassVar[tuple[str, ...]] = ("counts",)

    first: str = parameter(kw_only=False)
    second: str = parameter(kw_only=False)
    bins: int = parameter(60, minimum=1)
    limits: Any = parameter(None)
    quantities: tuple[str, str] = parameter(("displacement", "displacement"), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for quantity in self.quantities:
            if quantity not in QUANTITIES:
                raise InvalidInput(f"JointDensity.quantities: {suggestion(quantity, QUANTITIES)}")
        limits = self.limits
        if _two_pairs(limits):
            limits = tuple(_plain_limits(pair) for pair in limits)
        object.__setattr__(self, "limits", limits if _two_pairs(limits) else _plain_limits(limits))

    @property
    def items(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Quantity and name of both."""
        return (self.quantities[0], self.first), (self.quantities[1], self.second)

    def resolved(self, model: Model) -> Record:
        return self.resolved_for(model, 0.0, 0.0)

    def resolved_for(self, model: Model, begin: float, end: float) -> Record:
        bodies, contacts = (*model.bodies.names, *model.network.points), tuple(model.network.contacts)
        for quantity, name in self.items:
            _known("JointDensity", (name,), contacts if quantity == "contact_force" else bodies, QUANTITIES[quantity])
        one, other = self.items
        if one == other:
            raise InvalidInput(
                f"JointDensity takes two different quantities, not the {one[0]} of {one[1]!r} twice; "
                f"quantities={PHASE_PLANE!r} are both of one body."
            )
        given = self.limits if _two_pairs(self.limits) else (self.limits, self.limits)
        if self.first == self.second and self.limits and isinstance(given[0][0], tuple):
            raise InvalidInput(
                f"JointDensity: limits by name do not say of which quantity of {self.first!r} they are; give "
                f"{_wanted(self, self.first)}, of the first and the second."
            )
        moved = given_ranges(model, begin, end) if model.sources["force"].bodies else None
        limits = tuple(
            _resolved_limits(self, (name,), own, quantity, model, (self.first, self.second), moved)[0]
            for own, (quantity, name) in zip(given, self.items, strict=True)
        )
        return _with_limits(self.replace(limits=limits), given[0])

    def stride(self, model: Model, step: float) -> int:
        if "contact_force" in self.quantities:
            return 1
        return _stride((self.first, self.second), model, step)

    def bytes_per_block(self, run: RecordedRun) -> int:
        return 8 * subsample_count(run.plan) * (self.bins + 2) ** 2

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Pairs(self, run.plan, realizations, ratio)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        counts = results[0]["counts"]
        samples, shape = counts.sum(axis=(1, 2))[:, None], counts.shape[1:]
        inner = np.pad(np.ones((self.bins, self.bins), dtype=bool), 1)
        share, scatter, factor = mean_of_subsamples(
            counts.reshape(len(counts), -1), samples, run.plan.realizations.trusted, inner.ravel()
        )
        joint, error = share.reshape(shape), scatter.reshape(shape)[1:-1, 1:-1]
        for place, inside in enumerate((joint[1:-1], joint[:, 1:-1])):
            _warn_of_outside(self, place, 1.0 - inside.sum(), self.quantities[place])
        edges = [np.linspace(low, high, self.bins + 1) for _, low, high in self.limits]
        area = (edges[0][1] - edges[0][0]) * (edges[1][1] - edges[1][0])
        of_first, of_second = (f"{quantity} of {name}" for quantity, name in self.items)
        text = f"joint density of the {of_first} and the {of_second}"
        if self.quantities == ("displacement", "displacement"):
            text = f"joint density of the displacements of {self.first} and {self.second}"
        units = _PER_BOTH[min(self.quantities), max(self.quantities)]
        dims = "joint_first_bin", "joint_second_bin"
        return {
            **with_error("joint_density", dims, joint[1:-1, 1:-1] / area, error / area, units, text),
            "joint_density_band_factor": ((), np.array(factor), OF_BAND),
            **{
                f"joint_{side}_edges": labelled(
                    (f"joint_{side}_edge",), own, ALL[quantity].units, f"edges of the bins of {name}"
                )
                for side, own, (quantity, name) in zip(("first", "second"), edges, self.items, strict=True)
            },
        }


class Counts(Keeper):
    """Histograms per subsample of realizations."""

    def __init__(self, record: Density, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        super().__init__(ratio)
        self.subsamples, self.record = subsamples_of(plan, realizations), record
        self.reader = plan.snapshot.reader(record.quantity, [name for name, *_ in record.limits])
        self.counts = np.zeros((len(record.limits), subsample_count(plan), record.bins + 2), dtype=np.int64)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        first = self.first_of(snapshots)
        values = self.reader(snapshots)
        for row, counts, (_, low, high) in zip(self.reader.rows, self.counts, self.record.limits, strict=True):
            inverse_width = self.record.bins / (high - low)
            count_samples(values, first, self.ratio, row, low, inverse_width, self.subsamples[batch], counts)

    def result(self) -> dict[str, np.ndarray]:
        return {"counts": self.counts.transpose(1, 0, 2)}


class _Pairs(Keeper):
    def __init__(self, record: JointDensity, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        super().__init__(ratio)
        self.subsamples, self.record = subsamples_of(plan, realizations), record
        self.reader = plan.snapshot.reader_of(record.items)
        self.rows = np.array(self.reader.rows)
        self.low = np.array([low for _, low, _ in record.limits])
        self.inverse_width = np.array([record.bins / (high - low) for _, low, high in record.limits])
        self.counts = np.zeros((subsample_count(plan), record.bins + 2, record.bins + 2), dtype=np.int64)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        first = self.first_of(snapshots)
        values, subsamples = self.reader(snapshots), self.subsamples[batch]
        count_pairs(values, first, self.ratio, self.rows, self.low, self.inverse_width, subsamples, self.counts)

    def result(self) -> dict[str, np.ndarray]:
        return {"counts": self.counts}


def _stride(names: tuple[str, ...] | None, model: Model, step: float) -> int:
    """Sample about three times per period of the fastest body that is recorded."""
    points, bodies = dict(model.points), places_of(model.bodies.names)
    slots = [
        slot
        for name in names or model.bodies.names
        for slot in ([body for body, _ in points[name]] if name in points else [bodies[name]])
    ]
    fastest = float(np.sqrt(model.stiffness[slots] / model.mass[slots]).max())
    return max(1, int(2.0 / (fastest * step))) if fastest > 0.0 else 1


def _known(place: str, names: tuple[str, ...], known: tuple[str, ...], of: Variable = QUANTITIES["velocity"]) -> None:
    """Refuse names that have not the quantity, by default those of no body."""
    places = frozenset(known)
    for name in names:
        if name not in places:
            raise InvalidInput(f"{place}: there is no {of.dimension} {name!r}; {suggestion(name, known)}")


def _plain_limits(limits: Any) -> Any:
    """Return limits as None, a pair, or triples (name, low, high)."""
    if limits is None:
        return None
    items = limits
    if isinstance(limits, Mapping):
        items = [(name, *(pair if isinstance(pair, list | tuple) else (pair,))) for name, pair in limits.items()]
    if not isinstance(items, list | tuple):
        raise InvalidInput(f"Limits are (low, high) or {{name: (low, high)}}, not {limits!r}.")
    plain = tuple(tuple(item) if isinstance(item, list | tuple) else item for item in items)
    by_name = plain and all(isinstance(item, tuple) for item in plain)
    pairs: list[Any] = [item[1:] for item in plain] if by_name else [plain]
    for pair in pairs:
        if len(pair) != 2 or not all(isinstance(limit, int | float | np.number) for limit in pair):
            raise InvalidInput(f"Limits are (low, high) or {{name: (low, high)}}, not {limits!r}.")
        low, high = (float(limit) for limit in pair)
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise InvalidInput(f"Limits must be two increasing finite numbers, not ({low!r}, {high!r}).")
    return plain


def _two_pairs(limits: Any) -> bool:
    """Whether limits are two pairs, such as ((0.0, 1.0), (-1.0, 1.0))."""
    return (
        isinstance(limits, list | tuple)
        and len(limits) == 2
        and all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in limits)
    )


def _resolved_limits(
    record: Record, names: tuple[str, ...], limits: Any, quantity: str, model: Model, known: tuple[str, ...],
    moved: np.ndarray | None,
) -> tuple[tuple[str, float, float], ...]:  # fmt: skip
    """Return one (name, low, high) per body or point.

    `moved` are the `given_ranges`, if there are given forces or motions.
    """
    place = type(record).__name__
    if limits and not isinstance(limits[0], tuple):
        return tuple((name, *limits) for name in names)
    given = {name: pair for name, *pair in limits or ()}
    _known(place, tuple(given), known)
    chosen = [name for name in names if name not in given]
    pairs = _chosen_limits(model, chosen, quantity, moved) if chosen else {}
    for name, (low, high) in pairs.items():
        if not -math.inf < low < high < math.inf:
            raise InvalidInput(f"{place}: limits for {name!r} cannot be chosen; give {_wanted(record, name)}.")
    pairs |= given
    return tuple((name, float(pairs[name][0]), float(pairs[name][1])) for name in names)


def _wanted(record: Record, name: str) -> str:
    """Return how limits of a name are given."""
    if isinstance(record, JointDensity) and record.first == record.second:
        return "limits=((low, high), (low, high))"
    return f"limits={{{name!r}: (low, high)}}"


def _chosen_limits(model: Model, names: list[str], quantity: str, moved: np.ndarray | None) -> dict[str, Any]:
    """Return limits by the names of bodies or points.

    Those of points are of bodies that noise moves independently, and given forces together.
    """
    if quantity == "contact_force":
        return _ranges_of_forces(model, names)
    low, high = _reach(model, quantity)
    together = np.zeros_like(low)
    if moved is not None:
        wider = reach_of_moved(model, quantity, (low, high), moved, 0.5 * DEVIATIONS**2)
        together = 0.5 * np.maximum((wider[1] - wider[0]) - (high - low), 0.0)
        low, high = wider
    points = dict(model.points)
    pairs = {name: (low[slot], high[slot]) for slot, name in enumerate(model.bodies.names) if name not in points}
    for name in points.keys() & names:
        slots, weights = (np.array(item) for item in zip(*points[name], strict=True))
        place = 0.5 * float(weights @ (low[slots] + high[slots]))
        reach = 0.5 * float(np.linalg.norm(weights * (high[slots] - low[slots] - 2.0 * together[slots])))
        reach += float(np.abs(weights) @ together[slots])
        pairs[name] = place - reach, place + reach
    return {name: pairs[name] for name in names}


def _ranges_of_forces(model: Model, names: list[str]) -> dict[str, Any]:
    """Return ranges of contact forces by the names of contacts."""
    contacts, depths = model.contacts, deepest(model)
    slots = {name: contacts.names.index(name) for name in names}
    for name, slot in slots.items():
        if contacts.impulsive[slot]:
            law = type(contacts.laws[slot]).__name__
            raise InvalidInput(f"JointDensity: {name!r} is a {law}: its impacts have an impulse, but no force.")
    return {name: (0.0, float(contacts.laws[slot].evaluate(depths[slot]))) for name, slot in slots.items()}


def _reach(model: Model, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the limits between which bodies move, (body,) each; not finite where they are not known."""
    scale = extent(model)
    if quantity == "velocity":
        return -DEVIATIONS * scale[1], DEVIATIONS * scale[1]
    heat = model.mass * scale[1] ** 2
    with np.errstate(invalid="ignore"):
        energy = np.where(np.isfinite(heat), heat, 0.0)
    loose = ~np.isfinite(scale[0])
    if not (loose.any() or (model.clearance < 0.0).any()):
        return -DEVIATIONS * scale[0], DEVIATIONS * scale[0]
    stiffening = Stiffening.of(model, 0.5 * DEVIATIONS**2 * energy)
    rest = np.where(loose, 0.0, stiffening.rest)
    low, high = (np.append(rest + sign * DEVIATIONS * scale[0], 0.0) for sign in (-1.0, 1.0))
    first, second = model.ends.pairs.T if model.ends.plain else np.zeros((2, 0), dtype=np.int64)
    farthest = model.clearance + stiffening.penetration
    for _ in range(int(loose.sum())):  # what holds a body that no spring holds, from neighbour to neighbour
        before = low.copy(), high.copy()
        np.minimum.at(high, first, np.where(np.append(loose, False)[first], high[second] + farthest, np.inf))
        np.maximum.at(low, second, np.where(np.append(loose, False)[second], low[first] - farthest, -np.inf))
        if np.array_equal(before, (low, high)):
            break
    return low[:-1], high[:-1]


def _with_limits(record: Density | JointDensity, given: Any) -> Record:
    """Note whose limits a record has chosen itself."""
    named = {item[0] for item in given or () if isinstance(item, tuple)}
    chosen = frozenset(name for name, _, _ in record.limits if given is None or (named and name not in named))
    object.__setattr__(record, "chosen", chosen)
    return record


def _warn_of_outside(record: Any, row: int, outside: float, quantity: str) -> None:
    """Warn of samples that a density does not show: some if it has chosen its limits, all if they were given."""
    name, low, high = record.limits[row]
    # the part of the samples that may be outside of limits that were not given
    if outside > (0.01 if name in getattr(record, "chosen", ()) else 1.0 - 1e-9):
        warn(
            "outside_limits",
            f"{100.0 * outside:.3g} % of the samples of the {quantity} of {name!r} are outside the limits of its "
            f"{type(record).__name__}, {low:.3g} to {high:.3g}; give {_wanted(record, name)}.",
        )
