"""Records of quantities of one's own: a function of what happens at a place."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput
from impactlab.inputs import suggestion
from impactlab.kernels.histogram import add_values
from impactlab.plan.plan import Plan
from impactlab.records.formulas import formula_of, formula_text
from impactlab.records.links_in_snapshots import LinksInSnapshots
from impactlab.records.quantities import (
    COUPLING,
    EXTREMES,
    KERNEL,
    MEANS,
    MOTION,
    NETWORK,
    Places,
    Quantity,
    WithError,
)
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.records.signed_histogram import SignedHistogram, edges_of, joined_counts
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.schema import BODY, CONTACT
from impactlab.results.snapshot import TIME
from impactlab.statistics.subsamples import in_units, mean_with_error, subsample_count, subsamples_of

STRIDES = {CONTACT: 25, BODY: 21, COUPLING: 15, NETWORK: 21}
"""Steps between samples where forces kick: so many that the record adds a tenth to a run, and odd, so that both phases
of the steps of `ExactFlow` are seen alike. Errors of what contacts do grow as its root."""


CACHED = 50_000
"""Values that are worked on at a time, which with the arguments of a kernel stay in a cache."""


class Observable(Record):
    """A quantity of one's own: its mean and mean square, extremes and density, from a function of what happens.

    The function is a kernel, a formula of scalars (see `impactlab.ContactLaw`), whose arguments are the quantities of
    the place by name. A contact has `indentation`, `gap`, `rate` and `force`; an oscillator has `displacement` and
    `velocity`; a coupling has `extension`, `rate` and `force`; all have the `time`, and the fields and states of their
    law by name, such as the voltage of a `PiezoelectricCoupling`. For the whole network they are
    ``displacement_NAME`` and ``velocity_NAME`` of bodies and ``force_NAME`` of contacts, with ``_`` for ``.``. A gap
    is negative where a contact is open. Velocities are those at which forces do their work, so that force times rate
    is a power.

    Means have standard errors as other statistics have them, with the balances of the bodies as control variates. A
    value that is not finite ends the run with an error.

    Parameters
    ----------
    name : str
        Name of the quantity, from which those of the variables are made: ``mean_work_rate``.
    formula : function
        The kernel; stored as text, so that a result can be made again.
    per : str
        "contact", "oscillator", "coupling" or "network".
    units : str
        Units of the quantity, such as "W"; "1" for a number.
    labels : sequence of str, optional
        Contacts, oscillators or couplings; by default all whose law has what the kernel takes.
    interval : float, optional
        Time between samples (s), which are kept as a path then; by default a few steps, and no path is kept.
    bins : int
        Number of bins of the density, rounded up to a multiple of 4; they are as wide as the values need.

    Examples
    --------
    >>> def work_rate(force, rate):
    ...     return force * rate
    >>> il.Observable("work rate", work_rate, per="contact", units="W").variable
    'work_rate'
    """

    name: str = parameter()
    formula: Any = parameter(kw_only=False)
    per: str = parameter(CONTACT)
    units: str = parameter()
    labels: tuple[str, ...] | None = parameter(None)
    interval: float | None = parameter(None, units="s", above=0.0)
    bins: int = parameter(100, minimum=4)

    of_network: ClassVar[Any] = None
    """What a resolved record knows of its network, `Places`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name.replace(" ", "_").replace("-", "_").isidentifier():
            raise InvalidInput(f"Observable.name is made of letters, digits and spaces, not {self.name!r}.")
        owner = f"Observable {self.name!r}"
        if not self.units.strip():
            raise InvalidInput(f"{owner} needs units, such as units='W', or '1' for a number.")
        if self.per not in (*MOTION, NETWORK):
            raise InvalidInput(f"{owner}: per: {suggestion(self.per, (*MOTION, NETWORK))}")
        object.__setattr__(self, "bins", -(-self.bins // 4) * 4)
        kernel = self.formula
        if isinstance(kernel, str):
            kernel = formula_of(kernel, KERNEL, owner)
        if not inspect.isfunction(getattr(kernel, "py_func", kernel)):
            raise InvalidInput(f"{owner} takes a function of scalars as its formula, not {kernel!r}.")
        object.__setattr__(self, "formula", formula_text(kernel, KERNEL))

    def __reduce__(self) -> Any:
        return (*super().__reduce__(), {"of_network": self.of_network})

    @property
    def identity(self) -> tuple[str, ...]:
        return type(self).__name__, self.variable

    @property
    def variable(self) -> str:
        """Name of the quantity in names of variables."""
        return self.name.replace(" ", "_").replace("-", "_")

    @property
    def kicks(self) -> bool:  # type: ignore[override]
        """Whether velocities at kicks are wanted, at which forces do their work."""
        return self.per in (CONTACT, COUPLING)

    def resolved_for(self, model: Model, begin: float, end: float) -> Record:
        names = tuple(inspect.signature(formula_of(self.formula, KERNEL, "")).parameters)
        result = self.replace()
        object.__setattr__(result, "of_network", Places.of(self, names, model, (begin, end)))
        return result

    def exact_interval(self) -> float | None:
        return self.interval

    def stride(self, model: Model, step: float) -> int:
        if self.per == COUPLING and "force" in (kind for kind, _ in self.of_network.columns):
            for slot in np.flatnonzero(model.couplings.sticking[self.of_network.slots])[:1]:
                raise InvalidInput(
                    f"Observable {self.name!r} takes the force of {self.of_network.labels[slot]!r}, which sticks and "
                    "slips within steps; use integrator=il.EventLocated() where nothing is random, or "
                    "il.FrictionCoupling."
                )
        if self.interval is not None:
            return round(self.interval / step)
        return STRIDES[self.per] if model.kicks.nonlinear.any() else 1

    def quantity(self, plan: Plan) -> Quantity:
        """Return the quantity as a function of the snapshots of a run."""
        return Quantity(self, LinksInSnapshots(self.of_network.network, plan.snapshot, plan.method.grouped))

    def read(self, plan: Plan) -> np.ndarray | None:
        return self.quantity(plan).rows

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Values(self, self.quantity(run.plan), run.plan, realizations, ratio)

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        samples = 0 if self.interval is None else round(run.duration / self.interval) + 1
        return 8 * len(self.of_network.labels) * (samples + 2 * run.parts + 4)

    def bytes_per_block(self, run: RecordedRun) -> int:
        return 8 * len(self.of_network.labels) * subsample_count(run.plan) * self.bins

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        own, trusted = self.of_network, run.plan.realizations.trusted
        averages = {}
        for key, of in zip(("sum", "square"), MEANS, strict=True):
            means = in_units([item[key] / item["samples"] for item in results])
            averages[of] = run.estimates.controls.average(means, own.near)
        for key, sign in zip(EXTREMES, (1.0, -1.0), strict=True):
            each = np.concatenate([item[key] for item in results])
            error = each.std(axis=0, ddof=1) / np.sqrt(len(each)) if len(each) > 1 else np.full(each.shape[1], np.nan)
            averages[key] = sign * each.mean(axis=0), error
        path = None
        if self.interval is not None:
            path = run.begin, np.concatenate([item["path"] for item in results])
        return self.described(averages, results, trusted, path)

    def described(
        self, averages: Mapping[str, WithError], counted: list[dict[str, np.ndarray]], trusted: bool,
        path: tuple[float, np.ndarray] | None,
    ) -> Variables:  # fmt: skip
        """Return the variables of a run.

        Parameters
        ----------
        averages : mapping
            Of `MEANS` and `EXTREMES`: value and error at each place.
        counted : list of dict
            Results of `SignedHistogram`.
        trusted : bool
            Whether the subsamples of these tell errors.
        path : tuple, optional
            Time of the first sample (s), and the path, (realization, sample, place).
        """
        v, own, text = self.variable, self.of_network, self.name
        dims: tuple[str, ...] = () if self.per == NETWORK else (f"{v}_{self.per}",)
        square = self.units if self.units == "1" else f"({self.units})2" if " " in self.units else f"{self.units}2"
        variables: Variables = {}
        if dims:
            variables[dims[0]] = dims, np.array(own.labels), {"long_name": f"{self.per} of the {text}"}
        for of, pair in averages.items():
            value, error = (item if dims else item[0] for item in pair)
            long_name = f"{of} {text}" if of in MEANS else f"mean over realizations of the {of} {text} at the samples"
            units = square if of == MEANS[1] else self.units
            variables |= with_error(f"{of.replace(' ', '_')}_{v}", dims, value, error, units, long_name)
        variables |= self._density(counted, trusted, dims)
        if self.interval is not None and path is not None:
            begin, values = path
            times = begin + self.interval * np.arange(values.shape[1])
            variables[f"{v}_time"] = (f"{v}_time",), times, TIME
            where = ("realization", f"{v}_time", *dims)
            variables[v] = labelled(where, values if dims else values[:, :, 0], self.units, text)
        return variables

    def _density(self, results: list[dict[str, np.ndarray]], trusted: bool, dims: tuple[str, ...]) -> Variables:
        """Return the density over bins that are as wide as the values of all blocks need."""
        v, (counts, width) = self.variable, joined_counts(results, self.bins)
        samples = counts.sum(axis=2, keepdims=True)  # (subsample, place, 1)
        density, error, _ = mean_with_error(counts, samples, trusted and len(counts) > 1)
        density, error, edges = density / width[:, None], error / width[:, None], edges_of(width, self.bins)
        if not dims:
            density, error, edges = density[0], error[0], edges[0]
        units = "1" if self.units == "1" else f"({self.units})-1"
        return {
            **with_error(f"density_{v}", (*dims, f"{v}_bin"), density, error, units, f"density of the {self.name}"),
            f"{v}_edges": labelled((*dims, f"{v}_edge"), edges, self.units, f"edges of the bins of the {self.name}"),
        }


class _Values(Keeper):
    """Evaluates a quantity in the samples of a block."""

    wants_start = True

    def __init__(
        self, record: Observable, quantity: Quantity, plan: Plan, realizations: np.ndarray, ratio: int
    ) -> None:
        super().__init__(ratio)
        self.record, self.quantity, self.plan, self.realizations = record, quantity, plan, realizations
        self.parts, lanes, count = plan.samples_per_realization, len(realizations), len(record.of_network.labels)
        self.sums, self.squares = np.zeros((2, self.parts, count, lanes))
        self.samples = np.zeros((self.parts, 1, lanes))
        self.largest, self.smallest = np.full((2, count, lanes), -np.inf)  # the latter of the negative
        self.counts = SignedHistogram(count, record.bins, subsamples_of(plan, realizations))
        self.path: list[np.ndarray] = []

    def start(self, values: np.ndarray) -> None:
        if self.record.interval is not None:
            times = np.array([self.plan.clock.begin * self.plan.clock.step])
            self.path.append(self.quantity(values[None], times, self.realizations).transpose(1, 0, 2))

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        times = self.plan.sample_times(self.seen, len(snapshots))
        part, first = min(batch, self.parts - 1), self.first_of(snapshots)
        own = np.ascontiguousarray(snapshots[first :: self.ratio])
        if not len(own):
            return
        times = times[first :: self.ratio]
        self.samples[part] += len(own)
        at_a_time = max(1, CACHED // self.largest.size)
        for begin in range(0, len(own), at_a_time):
            chosen = slice(begin, begin + at_a_time)
            values = self.quantity(own[chosen], times[chosen], self.realizations)
            add_values(values, self.sums[part], self.squares[part], self.largest, self.smallest)
            self.counts.add(values, batch)
            if self.record.interval is not None:
                self.path.append(values.transpose(1, 0, 2))

    def result(self) -> dict[str, np.ndarray]:
        found = {"sum": self.sums, "square": self.squares, "samples": self.samples}
        result = {name: values.transpose(2, 0, 1) for name, values in found.items()}  # (lane, part, place)
        result |= {"largest": self.largest.T, "smallest": self.smallest.T, **self.counts.result()}
        if self.path:
            result["path"] = np.concatenate(self.path).transpose(2, 0, 1)
        return result
