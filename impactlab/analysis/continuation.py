"""Branches of periodic orbits over a parameter, and curves of their events over two."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from impactlab.analysis.branches import Branch, Member, Metric
from impactlab.analysis.described import columns, dataset_of, start_of, states_of, stored_start
from impactlab.analysis.event_curves import EventCurve
from impactlab.analysis.linear_orbits import LinearOrbits, method_of
from impactlab.analysis.made_networks import MadeNetworks, made_again
from impactlab.analysis.mapped_orbits import MappedOrbits
from impactlab.analysis.near_returns import one_configuration, orbit_again
from impactlab.analysis.orbit import EquationsOfOrbits, MakeNetwork, Orbit, OrbitMethod
from impactlab.errors import InvalidInput, NoOrbit, keep_in, warn
from impactlab.inputs import checked
from impactlab.located.families import Family
from impactlab.networks.network import Network
from impactlab.progress import reporter
from impactlab.results.dataset import CONFIGURATION, configuration_of
from impactlab.results.labels import labelled, words

FEWEST_POINTS = 50
"""Orbits across the range of a parameter at least: where a branch is nearly straight, others are between them."""

OPEN_BY = 1e-9
"""Distance between both ends of a path, as a part of its size and of its growth, up to which it is closed."""

TRIED_FROM = 0.5, 0.25, 0.75, 0.05, 0.95
"""Parts of the ranges from which the values of a network are looked for."""

MATCHED, MATCHES = 12, 1e-9
"""Steps by which they are looked for, and differences of numbers, as a part of these, that are none."""

EVENTS = "fold", "flip", "torus", "grazing"
"""Events that are followed over two parameters."""


class Reach(NamedTuple):
    """How far parameters go, and why this is less than their ranges."""

    span: np.ndarray  # (parameter,) of the ranges
    limits: np.ndarray  # (parameter, 2)
    reasons: dict[tuple[int, float], str]  # by the place of the parameter, counted from the last, and its limit

    @staticmethod
    def of(
        ranges: Mapping[str, tuple[float, float]],
        family: Family | None = None,
        reasons: Mapping[tuple[str, float], str] | None = None,
    ) -> Reach:
        """Return that of a family, or of ranges that are not known to end earlier."""
        ends, names = np.array(list(ranges.values()), dtype=float), list(ranges)
        limits = ends if family is None else np.array(list(family.ranges.values()))
        told = {
            (names.index(name) - len(names), end): f"the branch ends at {name}={end:.9g}: {reason}"
            for (name, end), reason in (reasons or {}).items()
        }
        return Reach(np.diff(ends)[:, 0], limits, told)

    def metric(self, method: OrbitMethod, start: Orbit) -> Metric:
        """Return the lengths of ways of orbits like one of a family of one parameter."""
        return Metric(method.sizes, float(start.unknowns[-2]), self.span, self.limits)


class Origin(NamedTuple):
    """What a branch was made from."""

    configuration: Mapping[str, Any]
    made: MadeNetworks
    attributes: Mapping[str, Mapping[str, Any]]  # of parameters, such as their units


@checked
def continue_orbits(
    make: MakeNetwork,
    orbit: xr.Dataset,
    over: Mapping[str, Sequence[float]],
    also: Mapping[str, Sequence[float]] | None = None,
    *,
    bifurcation: str | None = None,
    points: int | None = None,
    progress: bool | Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Follow a periodic orbit over a parameter, through folds and changes of stability; or an event over two.

    Orbits are found by pseudo-arclength continuation: stable and unstable ones. Events on the branch are located to
    rounding: folds, where it turns; flips, where a multiplier is −1 and the period doubles; tori (Neimark–Sacker
    bifurcations), where two complex multipliers leave the unit circle; and grazing, where a contact comes to be touched
    or an impact is lost. The branch goes on with the impacts that there are behind it.

    Parameters
    ----------
    make : callable
        ``make(name=value, ...)`` returns the network at some values.
    orbit : Dataset
        One orbit that `orbits` found for one of these networks.
    over : mapping of str to pair of float
        Name of the parameter, and its range. Attributes of a DataArray of both ends, such as its units, are kept.
    also : mapping of str to pair of float, optional
        A second parameter and its range: the first event of the branch, seen from the orbit, is followed over both.
    bifurcation : str, optional
        Which one is followed: "fold", "flip", "torus" or "grazing"; the nearest of any kind by default.
    points : int, optional
        Orbits on a way as long as the range at least, 50 by default. There are more where the branch bends, so that it
        is 0.001 of the range and of the sizes of states from the straight lines between them at most, and near events.
    progress : bool or callable, optional
        As for `simulate`.

    Returns
    -------
    xarray.Dataset
        Along ``point``, in the order of the branch: the parameters, the variables of `orbits` without the path, with
        the state at the beginning of a period of the force, and ``bifurcation``: what happens there, or "". The
        attribute ``ends`` tells why the branch ends on either side, such as a value at which there is no network, and
        ``interpolation_error`` how far the branch is from straight lines between its points.

    Raises
    ------
    InvalidInput
        If the orbit is none of these networks, networks differ in more than numbers, or these are not smooth.
    NoOrbit
        If the orbit cannot be found again, or there is no such event on its branch.

    Examples
    --------
    >>> def struck(frequency):
    ...     return driven.replace(excitations={"a": il.Harmonic(1.0, frequency=frequency)})
    >>> branch = il.continue_orbits(struck, il.orbits(driven), {"frequency": (1.5, 2.9)})
    >>> branch.frequency.values[branch.bifurcation == "flip"].round(4)
    array([2.6589])
    """
    ranges = _ranges(over, 1) | _ranges(also or {}, 1 if also else 0)
    if also and len(ranges) < 2:
        raise InvalidInput(f"also= has a second parameter, beside that of over=, but it is {next(iter(also))!r} again.")
    if also is None and bifurcation is not None:
        raise InvalidInput("bifurcation= says what is followed over two parameters: give also=, too.")
    if bifurcation is not None and bifurcation not in EVENTS:
        raise InvalidInput(f"bifurcation is {', '.join(map(repr, EVENTS))} or None, not {bifurcation!r}.")
    if points is not None and points < 2:
        raise InvalidInput(f"points is a whole number of 2 or more, not {points!r}.")
    configuration = one_configuration(orbit, "continue_orbits begins with")
    made = MadeNetworks(make)
    network, show = Network.from_dict(configuration["network"]), reporter(progress)
    start_values = _values_of(made, network, ranges)
    name, fixed = next(iter(over)), {other: start_values[other] for other in also or {}}
    method, reach = _method(network, lambda **values: made(**values, **fixed), {name: ranges[name]}, start_values)
    start = orbit_again(method, orbit, np.array([start_values[name]]))
    longest = 1.0 / (points or FEWEST_POINTS)
    options = {
        "start": stored_start(orbit, method), "over": _plain(over), "also": None if also is None else _plain(also),
        "bifurcation": bifurcation, "points": points,
    }  # fmt: skip
    attributes = {str(item): getattr(ends, "attrs", {}) for item, ends in (dict(over) | dict(also or {})).items()}
    origin = Origin({"network": configuration["network"], "continuation": options}, made, attributes)
    told = _shown(start, *ranges[name], show)
    last = frozenset() if also is None else frozenset([bifurcation] if bifurcation else EVENTS)
    branch = Branch(method, reach.metric(method, start), longest, reach.reasons, told, last)
    found = _followed(branch, start, method, [name], origin)
    if also is None:
        return _described(method, branch, *found, [name], origin)
    event = _nearest(found[0], bifurcation)
    event = event._replace(orbit=method.unwrapped(event.orbit, event.test))
    values = {name: float(event.orbit.unknowns[-1]), **fixed}
    both, reach = _method(network, made, ranges, values)
    both.sizes = method.sizes
    curve = EventCurve.of(both, event, np.array(list(values.values())))
    along = Branch(curve, reach.metric(method, start), longest, reach.reasons, lambda orbit: show(1.0))
    found = _followed(along, curve.start, both, list(ranges), origin)
    return _described(both, along, *found, list(ranges), origin, event.event)


def again(
    dataset: xr.Dataset, options: Mapping[str, Any], progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Return a branch again from what is stored with it."""
    given = dict(options)
    start = start_of(given.pop("start"), configuration_of(dataset)["network"])
    over, also = (
        ranges and {name: xr.DataArray(ends, attrs=dataset[name].attrs) for name, ends in ranges.items()}
        for ranges in (given.pop("over"), given.pop("also"))
    )
    return continue_orbits(made_again(dataset), start, over, also, progress=progress, **given)


def _shown(start: Orbit, low: float, high: float, show: Callable[[float], None]) -> Callable[[Orbit], None]:
    """Return what tells how far a branch has come on both sides of an orbit."""
    begin, reached = float(start.unknowns[-1]), [0.0, 0.0]

    def told(orbit: Orbit) -> None:
        way = (float(orbit.unknowns[-1]) - begin) / (high - low)
        side = int(way > 0.0)
        reached[side] = max(reached[side], abs(way))
        show(min(1.0, sum(reached)))

    return told


def _followed(
    branch: Branch, start: Orbit, method: OrbitMethod, names: Sequence[str], origin: Origin
) -> tuple[list[Member], tuple[str, str]]:
    """Return the orbits of a branch, and why it ends; an interrupt has those that were found."""
    try:
        ends = branch.through(start)
    except KeyboardInterrupt as error:
        ends = "interrupted", "interrupted"
        found = _described(method, branch, branch.members(start), ends, names, origin)
        keep_in(error, found, "orbits that were found")
        raise
    return branch.members(start), ends


def _ranges(given: Mapping[str, Sequence[float]], count: int) -> dict[str, tuple[float, float]]:
    """Return ranges of parameters as plain numbers, or refuse them."""
    if not isinstance(given, Mapping) or len(given) != count:
        raise InvalidInput(f"A branch is followed over {{name: (lowest, highest)}} of one parameter, not {given!r}.")
    result = {}
    for name, ends in given.items():
        try:
            low, high = (float(end) for end in ends)
        except (TypeError, ValueError):
            raise InvalidInput(f"{name!r} has a range (lowest, highest), not {ends!r}.") from None
        if not low < high:
            raise InvalidInput(f"{name!r} has a range from a lower to a higher value, not {ends!r}.")
        result[str(name)] = (low, high)
    return result


def _plain(ranges: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
    return {name: [float(end) for end in ends] for name, ends in ranges.items()}


def _values_of(make: MakeNetwork, network: Network, ranges: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Return the values of parameters at which `make` returns a network, or refuse it."""
    target, names = _numbers_in(network.to_dict()), list(ranges)
    low, high = np.array(list(ranges.values())).T
    size = np.maximum(np.abs(target), 1e-3 * np.abs(target).max(initial=1e-300))

    refusals = list[InvalidInput]()

    def apart(values: np.ndarray) -> np.ndarray | None:
        try:
            made = make(**dict(zip(names, values.tolist(), strict=True)))
        except InvalidInput as error:
            refusals.append(error)
            return None
        numbers = _numbers_in(made.to_dict())
        return (numbers - target) / size if numbers.shape == target.shape else None

    best, least = low, np.inf
    for share in TRIED_FROM:
        values = low + share * (high - low)
        for _ in range(MATCHED):
            here = apart(values)
            if here is None:
                break
            if np.abs(here).max(initial=0.0) < least:
                best, least = values, float(np.abs(here).max(initial=0.0))
            shift = 1e-6 * (high - low) * np.where(values < 0.5 * (low + high), 1.0, -1.0)
            columns_of = [apart(values + shift * unit) for unit in np.eye(len(names))]
            if any(item is None for item in columns_of) or least <= 1e-13:
                break
            slopes = np.stack([(item - here) / step for item, step in zip(columns_of, shift, strict=True)], axis=1)
            step = np.linalg.lstsq(slopes, -here, rcond=None)[0]
            values = np.clip(values + step, low, high)
        if least <= MATCHES:
            return dict(zip(names, best.tolist(), strict=True))
    if refusals and least == np.inf:
        raise refusals[-1]
    told = ", ".join(f"{name}={value:.6g}" for name, value in zip(names, best, strict=True))
    raise InvalidInput(
        f"The network of the orbit is none that make returns in the range; the nearest is at {told}. Give an orbit of "
        "one of these networks."
    )


def _numbers_in(data: Any) -> np.ndarray:
    """Return all numbers in plain data, in order."""
    if isinstance(data, Mapping):
        data = list(data.values())
    if isinstance(data, bool | str) or data is None:
        return np.zeros(0)
    if isinstance(data, Sequence):
        return np.concatenate([np.zeros(0), *map(_numbers_in, data)])
    return np.array([float(data)])


def _method(
    network: Network, make: MakeNetwork, ranges: Mapping[str, tuple[float, float]], about: Mapping[str, float]
) -> tuple[EquationsOfOrbits, Reach]:
    """Return what finds the orbits of networks like one, and how far parameters go."""
    values = np.array([about[name] for name in ranges])
    if isinstance(method_of(network), MappedOrbits):
        return MappedOrbits(make, ranges, values), Reach.of(ranges)
    family, reasons = Family.about(make, ranges, values)
    return LinearOrbits(family), Reach.of(ranges, family, reasons)


def _nearest(members: Sequence[Member], event: str | None) -> Member:
    """Return the event on a branch that is nearest to the orbit with which it begins."""
    begin = next(place for place, item in enumerate(members) if item.event == "start")
    places = [
        place for place, item in enumerate(members) if item.event == event or (event is None and item.event in EVENTS)
    ]
    if not places:
        found = sorted({item.event for item in members if item.event and item.event != "start"})
        raise NoOrbit(
            f"There is no {event or 'event'} on the branch of the orbit"
            + (f", but {', '.join(found)}." if found else ".")
            + " Give a wider range."
        )
    return members[min(places, key=lambda place: abs(place - begin))]


def _described(
    method: OrbitMethod,
    branch: Branch,
    members: Sequence[Member],
    ends: tuple[str, str],
    names: Sequence[str],
    origin: Origin,
    event: str = "",
) -> xr.Dataset:
    """Return the dataset of a branch, or of the curve of an event."""
    orbits = [member.orbit for member in members]
    variables, coordinates = columns(method, orbits, "point", [event or member.event for member in members])
    size = len(method.sizes)
    variables |= states_of(
        np.array([orbit.unknowns[:size] for orbit in orbits]), ("point",), suffix=" at the beginning"
    )
    for place, name in enumerate(names, -len(names)):
        values = np.array([orbit.unknowns[place] for orbit in orbits])
        coordinates[name] = ("point",), values, {"long_name": words(name), **origin.attributes[name]}
    events = np.array([member.event for member in members])
    variables["bifurcation"] = labelled(("point",), events, "", "what happens at this point of the branch")
    growth = np.maximum(1.0, np.array([np.abs(orbit.monodromy).max() for orbit in orbits]))
    closure = variables["closure"][1]
    open_ones = (closure > OPEN_BY * growth) & (events != "grazing")
    if open_ones.any() and len(names) == 1:
        place = int(np.argmax(open_ones))
        warn(
            "open_orbits",
            f"{open_ones.sum()} orbits of the branch are not closed when their paths are followed, the first at "
            f"{names[0]}={orbits[place].unknowns[-1]:.6g}: leave out those of large `closure`, or give more points=.",
        )
    title = "Branch of periodic orbits" if len(names) == 1 else "Curve of an event of periodic orbits"
    variables[CONFIGURATION] = origin.made.variable()
    attributes = {"ends": "; ".join(ends), "interpolation_error": branch.apart}
    return dataset_of(variables, coordinates, title, origin.configuration, attributes)
