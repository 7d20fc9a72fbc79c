"""What results hold: the default statistics, each one object that says all about itself, and datasets of them."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import xarray as xr

from impactlab.errors import InvalidInput
from impactlab.results.labels import Variables, with_error

BODY, CONTACT, POINT, STATE = "oscillator", "contact", "point", "state"
"""Dimensions of variables: for bodies, for contacts, for points of structures, and for states of laws."""


class OfBodies(NamedTuple):
    """Means over time from which statistics of bodies are formed, (body, …) each: of samples or of an exact law."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    x: np.ndarray  # of the displacement (m)
    xx: np.ndarray  # of its square (m2)
    variance: np.ndarray  # of the displacement (m2)
    v: np.ndarray  # of the velocity (m s-1)
    vv: np.ndarray  # of its square (m2 s-2)
    load: np.ndarray  # what xx lacks for the variance (m2); see `impactlab.statistics.chain.mean_load`

    @classmethod
    def of_law(
        cls, linear: Iterable[np.ndarray], x: np.ndarray, xx: np.ndarray, variance: np.ndarray, vv: np.ndarray
    ) -> Self:
        """Return the moments of a stationary law with mean velocities 0; mass, damping and stiffness are `linear`."""
        mass, damping, stiffness = linear
        nothing = np.zeros_like(x)
        return cls(mass, damping, stiffness, x, xx, variance, nothing, vv, nothing)


class Moments(NamedTuple):
    """Moments, from which statistics are formed."""

    bodies: OfBodies
    others: Mapping[str, np.ndarray]  # statistics that are not formed of these, as they are
    balances: Mapping[str, np.ndarray]  # by the statistic
    points: OfBodies | None = None  # at points, without mass, damping and stiffness

    def values(self) -> dict[str, np.ndarray]:
        """Return the statistics that do not depend on the time of observation."""
        return {item.name: self.of(item) for item in self.statistics()}

    def statistics(self) -> list[Statistic]:
        """Return the statistics that are known here and do not depend on the time of observation."""
        there = {BODY, POINT} if self.points is not None else {BODY}
        known = (item for item in EVERY.values() if item.stationary)
        return [item for item in known if item.name in self.others or (item.formed and item.dimension in there)]

    def of(self, statistic: Statistic) -> np.ndarray:
        """Return a statistic of each unit or of a law."""
        if not statistic.formed:
            return self.others[statistic.name]
        bodies = self.points if statistic.dimension == POINT else self.bodies
        assert bodies is not None
        return statistic.formed(bodies)

    def of_rows(self, dimension: str, rows: np.ndarray) -> Moments:
        """Return the moments of the chosen bodies, contacts, points or states, without balances."""
        bodies, points = (
            OfBodies(*(values[rows] for values in item)) if item is not None and dimension == own else item
            for own, item in ((BODY, self.bodies), (POINT, self.points))
        )
        assert bodies is not None
        others = {name: item[rows] for name, item in self.others.items() if EVERY[name].dimension == dimension}
        return Moments(bodies, others, {}, points)

    def part(self, *chosen: slice) -> Moments:
        """Return the moments of some bodies and contacts, and of some units: parts of all arrays along their axes."""
        bodies = OfBodies(*(values[chosen] for values in self.bodies))
        points = None if self.points is None else OfBodies(*(values[chosen] for values in self.points))
        others, balances = (
            {name: values[chosen] for name, values in item.items()} for item in (self.others, self.balances)
        )
        return Moments(bodies, others, balances, points)


class Estimate(NamedTuple):
    """Values and their standard errors."""

    value: np.ndarray
    error: np.ndarray


Average = Callable[[np.ndarray], Estimate]
"""Estimates the mean of each row of (row, unit) numbers: the plain mean, or by a regression."""


class Push(NamedTuple):
    """What one rare push does to a body for as long as its energy lasts, as a part of the run, (body,) each."""

    xx: np.ndarray  # mean square of the displacement (m2)
    vv: np.ndarray  # mean square of the velocity (m2 s-2)


class Closing(NamedTuple):
    """What one rare closing is like, (contact,) each."""

    duration: np.ndarray  # (s)
    impulse: np.ndarray  # (N s)


@dataclass(frozen=True, eq=False)
class Variable:
    """A variable of a dataset: a number for each body, contact, point or state of a law."""

    statistic: str  # the statistic that it is, or belongs to
    dimension: str  # `BODY`, `CONTACT`, `POINT` or `STATE`
    units: str
    long_name: str
    prefix: str = ""  # of its name, before the statistic

    @cached_property
    def name(self) -> str:
        """Name in a dataset."""
        return f"{self.prefix}{self.statistic}"

    @property
    def error(self) -> str:
        """Name of its standard error."""
        return f"{self.name}_standard_error"

    @property
    def by_realization(self) -> str:
        """Name of the variable with its values of each realization."""
        return f"{self.name}_by_realization"

    @property
    def step_bias(self) -> str:
        """Name of the bias of the step in the statistic."""
        return f"{self.statistic}_step_bias"

    @property
    def allowance(self) -> str:
        """Name of the part of its standard error that allows for the bias of the step."""
        return f"{self.statistic}_step_allowance"


@dataclass(frozen=True, eq=False, kw_only=True)
class Statistic(Variable):
    """A statistic."""

    formed: Callable[[OfBodies], np.ndarray] | None = None
    """Computes the statistic from moments of bodies, `OfBodies`; None for a statistic that is a moment itself."""
    event: Callable[[Any], Any] | None = None
    """Contribution of one `Push` or `Closing`, an event too rare for standard errors, to the statistic."""
    balanced: bool = False
    """Whether there is a second estimate of it, by a balance: their difference, 0 in expectation, is a control variate
    of all statistics.
    """
    stationary: bool = True  # whether it does not depend on the time of observation
    held: bool = False  # whether it has a stationary value only where something holds the body
    square: str = ""  # statistic whose root is its size, where it may be 0 by symmetry
    never_negative: bool = False  # whether a value below 0 is nothing but scatter

    def averaged(self, moments: Moments, average: Average) -> Estimate:
        """Return values and standard errors from the moments of independent units, (row, unit) each."""
        value, error = average(moments.of(self))
        return Estimate(np.maximum(value, 0.0) if self.never_negative else value, error)

    @cached_property
    def direct(self) -> Variable:
        """Its plain mean, where its value is combined with balances."""
        return self._beside("direct_", "plain mean")

    @cached_property
    def balance(self) -> Variable:
        """The difference between two estimates of the statistic, as a variable."""
        return self._beside("balance_", "direct minus balance estimate")

    def _beside(self, prefix: str, text: str) -> Variable:
        return Variable(self.statistic, self.dimension, self.units, f"{self.long_name}: {text}", prefix)


@dataclass(frozen=True, eq=False, kw_only=True)
class Sampled(Statistic):
    """A statistic that is the mean over time of a function of the state."""

    sample: Callable[[Any, Any], Any]
    """The function, for numbers and arrays, of the displacement and velocity of a body, or of the indentation and force
    of a contact; 0 where both are 0 and where a contact is open. It is compiled into the loop and summed once a step,
    where forces are evaluated; exact laws integrate it.
    """
    largest: bool = False  # of contacts: whether it is the largest value in a run, not the mean


class Variance(Statistic):
    """Variance of the displacement."""

    def averaged(self, moments: Moments, average: Average) -> Estimate:
        """Estimate E[x²] − E[x]²; each unit has the influence x² − 2 E[x] x."""
        bodies = moments.points if self.dimension == POINT else moments.bodies
        assert bodies is not None
        mean = average(bodies.x).value
        value, error = average(bodies.xx + bodies.load - 2.0 * mean[:, None] * bodies.x)
        return Estimate(np.maximum(value + mean**2, 0.0), error)


STATISTICS: dict[str, Statistic] = {
    statistic.name: statistic
    for statistic in (
        Statistic(
            "mean_displacement", BODY, "m", "mean displacement",
            formed=lambda bodies: bodies.x, event=lambda push: np.sqrt(push.xx), balanced=True,
            held=True, square="mean_square_displacement",
        ),
        Statistic(
            "mean_square_displacement", BODY, "m2", "mean square displacement",
            formed=lambda bodies: bodies.xx, event=lambda push: push.xx, balanced=True, held=True,
        ),
        Variance(
            "variance_displacement", BODY, "m2", "variance of the displacement",
            formed=lambda bodies: bodies.variance, event=lambda push: push.xx, held=True,
        ),
        Statistic(
            "mean_velocity", BODY, "m s-1", "mean velocity",
            formed=lambda bodies: bodies.v, event=lambda push: np.sqrt(push.vv), square="mean_square_velocity",
        ),
        Statistic(
            "mean_square_velocity", BODY, "m2 s-2", "mean square velocity",
            formed=lambda bodies: bodies.vv, event=lambda push: push.vv, balanced=True,
        ),
        Sampled(
            "contact_ratio", CONTACT, "1", "fraction of time in contact",
            sample=lambda indentation, force: 1.0 * (indentation > 0.0), event=lambda closing: closing.duration,
        ),
        Statistic(
            "contact_rate", CONTACT, "s-1", "rate of contacts", never_negative=True, event=lambda closing: 1.0,
        ),
        Sampled(
            "mean_contact_force", CONTACT, "N", "mean contact force over all time",
            sample=lambda indentation, force: force, event=lambda closing: closing.impulse,
        ),
        Sampled(
            "peak_contact_force", CONTACT, "N", "mean over realizations of the largest contact force",
            sample=lambda indentation, force: force, largest=True, stationary=False,
        ),
    )
}  # fmt: skip
"""The default statistics by name."""


def _at_points(statistic: Statistic) -> Statistic:
    """Return the statistic of points that is formed as one of bodies."""
    return replace(
        statistic, statistic=f"point_{statistic.statistic}", dimension=POINT, balanced=False, event=None,
        long_name=f"{statistic.long_name} at points", square=f"point_{statistic.square}" if statistic.square else "",
    )  # fmt: skip


OF_POINTS: dict[str, Statistic] = {
    statistic.name: statistic
    for statistic in (_at_points(item) for item in STATISTICS.values() if item.dimension == BODY and item.formed)
}
"""The default statistics of points by name, where structures have some."""


OF_STATES: dict[str, Statistic] = {
    statistic.name: statistic
    for statistic in (
        Statistic("mean_law_state", STATE, "", "mean state", square="mean_square_law_state"),
        Statistic("mean_square_law_state", STATE, "", "mean square state"),
        Statistic("law_state_growth_rate", STATE, "", "growth rate of the state"),
    )
}
"""The default statistics of states of laws by name, where there are some; each state has units of its own."""


EVERY: Mapping[str, Statistic] = ChainMap(OF_STATES, OF_POINTS, STATISTICS)
"""All default statistics by name, those of bodies and contacts first."""


def stationary() -> list[Statistic]:
    """Return the statistics of bodies and contacts that do not depend on the time of observation."""
    return [statistic for statistic in STATISTICS.values() if statistic.stationary]


def wanted_names(names: Any) -> tuple[str, ...] | None:
    """Return names of statistics, given as one or as a list of them, or refuse them; None stands for all."""
    if names is None:
        return None
    known = EVERY
    given = [names] if isinstance(names, str) else names
    if not isinstance(given, Sequence) or not given:
        raise InvalidInput(
            f"statistics must be the name of a statistic, or a list of such names, not {names!r}; leave it out for all."
        )
    for name in given:
        if not isinstance(name, str) or name not in known:
            raise InvalidInput(f"statistics cannot be {name!r}; allowed are {', '.join(known)}.")
    return tuple(dict.fromkeys(given))


def unwanted(names: Sequence[str]) -> set[str]:
    """Return the names of all variables of statistics beside some; balances, which are controls of all, are none."""
    others = [item for item in EVERY.values() if item.name not in names]
    found = {name for item in others for name in (item.step_bias, item.allowance)}
    if "contact_rate" not in names:
        found.add("contacts_per_sample")
    return found | {
        name
        for item in others
        for variable in (item, item.direct)
        for name in (variable.name, variable.error, variable.by_realization)
    }


def sampled_of(dimension: str) -> list[Sampled]:
    """Return the statistics of bodies or contacts that are sampled, in the order of their sums: the largest last."""
    found = [item for item in STATISTICS.values() if isinstance(item, Sampled) and item.dimension == dimension]
    return sorted(found, key=lambda statistic: statistic.largest)


def balances() -> list[Variable]:
    """Return the balances."""
    return [statistic.balance for statistic in STATISTICS.values() if statistic.balanced]


def variables() -> dict[str, Variable]:
    """Return everything that is estimated by name: values, plain means, balances."""
    every = EVERY.values()
    direct = [statistic.direct for statistic in every if statistic.stationary]
    return {variable.name: variable for variable in (*every, *direct, *balances())}


def statistics(
    oscillators: list[str],
    contacts: list[str],
    values: Mapping[str, np.ndarray],
    errors: Mapping[str, np.ndarray] | None = None,
    points: Sequence[str] = (),
    **attributes: Any,
) -> xr.Dataset:
    """Return a labelled dataset of statistics.

    Parameters
    ----------
    oscillators, contacts : list of str
        Labels of the two dimensions.
    values : mapping of str to ndarray
        Values by the name of the statistic, one per oscillator, contact or point.
    errors : mapping of str to ndarray, optional
        Standard errors by the name of the statistic.
    points : sequence of str, optional
        Labels of the points of structures.
    **attributes
        Further attributes of the dataset.

    Returns
    -------
    xarray.Dataset
        Variables for which there are no labels (no contacts, say) are left out.
    """
    known = variables()
    coordinates = labels_of(oscillators, contacts, points)
    estimates = {known[name]: (value, (errors or {}).get(name)) for name, value in values.items()}
    return xr.Dataset(variables_of(estimates, coordinates), coordinates, attributes)


def labels_of(oscillators: Sequence[str], contacts: Sequence[str], points: Sequence[str]) -> Variables:
    """Return the labels of bodies, contacts and points, where there are some, as coordinates."""
    labels = {BODY: oscillators, CONTACT: contacts, POINT: points}
    return {
        name: ((name,), np.array(list(items)), {"long_name": f"name of the {name}"})
        for name, items in labels.items()
        if len(items)
    }


def check_labels(dataset: xr.Dataset) -> None:
    """Refuse a dataset in which two bodies, contacts or points have one name."""
    for name in (BODY, CONTACT, POINT):
        if name in dataset.indexes and not dataset.indexes[name].is_unique:
            repeated = dataset.indexes[name][dataset.indexes[name].duplicated()][0]
            raise InvalidInput(
                f"The labels of the dimension {name!r} must be different, but {repeated!r} is there twice."
            )


def variables_of(
    estimates: Mapping[Variable, tuple[np.ndarray, np.ndarray | None]], coordinates: Variables
) -> Variables:
    """Return estimates, some with errors, as variables, where their dimensions have labels."""
    data: Variables = {}
    for item, (value, error) in estimates.items():
        if item.dimension in coordinates:
            data |= with_error(item.name, (item.dimension,), np.asarray(value), error, item.units, item.long_name)
    return data


def scatter_of(dataset: xr.Dataset, name: str) -> xr.DataArray:
    """Return the standard error of a statistic, or its plain mean, without what allows for the bias of the step."""
    variable = variables()[name]
    error, allowance = dataset[variable.error], variable.allowance
    return error if allowance not in dataset else (error**2 - dataset[allowance].fillna(0.0) ** 2).clip(min=0.0) ** 0.5
