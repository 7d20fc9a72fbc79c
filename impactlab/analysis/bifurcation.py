"""Bifurcation diagrams: the motions that networks come up to over a parameter, and maps of their periods over two."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import impactlab
from impactlab.analysis.prepared import Prepared, followed, slots_of
from impactlab.analysis.returns import Returns, Wanted
from impactlab.compiling.announced import announced
from impactlab.components.component import positive
from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries, json_of, stored
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.plan.seed import Seed, seed_of
from impactlab.plan.start import realizations_of
from impactlab.progress import reporter
from impactlab.records.surface import Surface
from impactlab.results.dataset import CONFIGURATION, parsed, provenance
from impactlab.results.labels import labelled
from impactlab.results.schema import BODY, CONTACT
from impactlab.results.stack import DONE
from impactlab.sweeps.sweep_points import MakeNetwork, labels_of, reason_of, values_of

SPREAD = 2.0
"""Largest velocity of a start, as a multiple of that of the motion after rest: motions of some times the energy."""


def bifurcation(
    make_network: MakeNetwork,
    over: Mapping[str, Sequence[Any]],
    *,
    section: Surface | None = None,
    transient: int = 200,
    keep: int = 80,
    follow: str | None = None,
    starts: int = 1,
    initial: Mapping[str, Any] | None = None,
    names: Sequence[str] | str | None = None,
    tolerance: float = 1e-6,
    rng: Any = None,
    progress: bool | Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Return the motions that networks come up to over a parameter, looked at once in each period of the force.

    Linear networks with contacts that are linear, rigid or rub move exactly from event to event, others by steps of
    order eight, as with `EventLocated`. All values and starts run beside each other on all cores. A lane that has come
    up to a periodic motion within 1e-10 of its size is not followed any further.

    Parameters
    ----------
    make_network : callable
        ``make_network(name=value, ...)`` returns the network of a point.
    over : mapping of str to sequence
        Values of one or two parameters by name.
    section : Strobe, optional
        The times at which motions are looked at; by default once in the common period of all forces, at whole periods
        from t = 0 on.
    transient : int
        Points of the section before those that are kept.
    keep : int
        Points that are kept; motions are found to repeat after up to a third of them.
    follow : str, optional
        "up" or "down": the motions at a value of the first parameter begin where those at the value before, or behind,
        have ended, which shows hysteresis. By default all begin in the same way.
    starts : int
        Number of motions at each value. The first one begins at rest, the others at the same place with random
        velocities of up to twice that of the motion after rest, the same at all values.
    initial : mapping, optional
        Where motions begin, as for `simulate`; with several values of a body for several starts.
    names : str or sequence of str, optional
        Bodies whose displacements and velocities are kept; all by default.
    tolerance : float
        Part of the size of a motion up to which points are the same, when periods are found.
    rng : optional
        Seed of the velocities of starts, as for `simulate`.
    progress : bool or callable, optional
        As for `simulate`.

    Returns
    -------
    xarray.Dataset
        With the parameters as first dimensions: ``displacement`` and ``velocity`` (…, start, point, oscillator),
        ``period`` (…, start), the number of points after which the motion repeats, 0 where it does not among the points
        that are kept, -1 where there is no motion; ``impacts`` (…, start, contact), mean number of impacts from point
        to point, NaN for endlessly many; ``path_error`` (…, start), the estimated error of displacements;
        ``section_period`` (…), and ``status``, "done" or the reason why there is no motion.

    Raises
    ------
    InvalidInput
        If something given cannot be used, or every point is refused; under noise, use `sweep`.
    """
    points = _Points.of(make_network, over, section)
    wanted = Wanted(_whole("transient", transient, 0), _whole("keep", keep, 2), positive("tolerance", tolerance))
    if follow not in (None, "up", "down"):
        raise InvalidInput(f'follow is "up", "down" or None, not {follow!r}.')
    number = _number_of_starts(starts, initial)
    seed = seed_of(rng)
    slots = slots_of(names, points.first.model.bodies.names)
    diagram = _Diagram(points, wanted, number, seed, initial)
    with announced(progress):
        diagram.run(follow, reporter(progress))
    options = {
        "section": None if section is None else section.to_dict(), "transient": transient, "keep": keep,
        "follow": follow, "starts": starts, "initial": initial, "names": names, "tolerance": tolerance,
        "seed": list(seed), "over": {name: values.tolist() for name, values in points.coordinates.items()},
    }  # fmt: skip
    return diagram.dataset(slots, options)


def again(dataset: xr.Dataset, options: Mapping[str, Any]) -> xr.Dataset:
    """Return a diagram again from what is stored with it."""
    given, over = dict(options), options["over"]
    stored = [parsed(item).get("network") for item in dataset[CONFIGURATION].values.ravel()]
    networks = dict(zip(itertools.product(*over.values()), stored, strict=True))

    def make(**values: Any) -> impactlab.Network:
        kept = networks[tuple(values.values())]
        if not kept:
            raise InvalidInput(str(dataset["status"].sel(values).item()))
        return impactlab.Network.from_dict(kept)

    section = given.pop("section")
    section = None if section is None else Surface.from_dict(section)
    return bifurcation(make, given.pop("over"), section=section, rng=Seed(*given.pop("seed")), **given)


def _whole(name: str, value: Any, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InvalidInput(f"{name} must be a whole number of at least {least}, not {value!r}.")
    return int(value)


def _number_of_starts(starts: int, initial: Mapping[str, Any] | None) -> int:
    """Return the number of starts, which given values may tell."""
    number = _whole("starts", starts, 1)
    if initial is None:
        return number
    if not isinstance(initial, Mapping):
        raise InvalidInput(f'initial must be {{"displacement": {{name: value}}, …}}, not {initial!r}.')
    given = realizations_of(initial)
    if number != 1 and given not in (1, number):
        raise InvalidInput(f"initial has the values of {given} starts, but starts={number}; leave out starts=.")
    return max(number, given)


class _Points(NamedTuple):
    """The points of a diagram: their networks, or why there are none."""

    coordinates: Mapping[str, np.ndarray]
    networks: list[Any]  # as stored, {} where there is none
    prepared: list[Prepared | None]
    refused: list[str]

    @classmethod
    def of(cls, make_network: MakeNetwork, over: Mapping[str, Sequence[Any]], section: Surface | None) -> _Points:
        """Make the networks of a product of values, the last one varying fastest."""
        if not isinstance(over, Mapping) or len(over) not in (1, 2):
            raise InvalidInput(
                f'bifurcation takes the values of one or two parameters, {{"amplitude": [0.1, 0.2]}}, not {over!r}.'
            )
        if not callable(make_network):
            raise InvalidInput(f"bifurcation takes a function that returns a network, not {make_network!r}.")
        values = {name: values_of(name, given) for name, given in over.items()}
        coordinates = {name: labels_of(name, items) for name, items in values.items()}
        networks, prepared, refused = list[Any](), list[Prepared | None](), list[str]()
        for combination in itertools.product(*values.values()):
            networks.append({})
            prepared.append(None)
            refused.append("")
            try:
                network = make_network(**dict(zip(values, combination, strict=True)))
                if not isinstance(network, impactlab.Network):
                    raise InvalidInput(f"make_network must return an il.Network, not {network!r}.")
                networks[-1] = stored(network)
                prepared[-1] = Prepared.of(network, section, "il.bifurcation")
            except ImpactLabError as error:
                refused[-1] = reason_of(error)
        result = cls(coordinates, networks, prepared, refused)
        result.check()
        return result

    @property
    def first(self) -> Prepared:
        """The first network that there is."""
        return next(item for item in self.prepared if item is not None)

    def check(self) -> None:
        """Refuse points none of which can be used, or whose bodies or contacts have different names."""
        if all(self.refused):
            raise InvalidInput(f"There is no point that could be followed; at the first one: {self.refused[0]}")
        first = self.first.model
        for item in self.prepared:
            names = None if item is None else (item.model.bodies.names, item.model.contacts.names)
            if names and names != (first.bodies.names, first.contacts.names):
                raise InvalidInput("The bodies and contacts must have the same names in the same order at all points.")


class _Diagram:
    """The motions at all points, as they are found."""

    def __init__(
        self, points: _Points, wanted: Wanted, starts: int, seed: Seed, initial: Mapping[str, Any] | None
    ) -> None:
        self.points, self.wanted, self.starts, self.initial = points, wanted, starts, initial
        first = points.first
        self.begins = {place: item.begin(initial) for place, item in enumerate(points.prepared) if item is not None}
        self.coordinates = next(iter(self.begins.values()))[0].shape[1] // 2
        contacts = len(first.model.contacts.names)
        self.found = Returns.nothing(len(points.prepared) * starts, wanted.keep, self.coordinates, contacts)
        draws = np.random.default_rng(np.random.SeedSequence(seed))
        self.draws = draws.uniform(-SPREAD, SPREAD, (starts, self.coordinates))

    def run(self, follow: str | None, show: Callable[[float], None]) -> None:
        """Follow all motions, or those at one value of the first parameter after the other."""
        places = np.array([place for place, item in enumerate(self.points.prepared) if item is not None])
        if follow is None:
            self._run(places, None, show)
            return
        first = next(iter(self.points.coordinates.values()))
        inner = len(self.points.prepared) // len(first)
        order = np.argsort(first, kind="stable")
        rows = order if follow == "up" else order[::-1]
        last: dict[int, np.ndarray] = {}
        for number, row in enumerate(rows.tolist()):
            there = places[places // inner == row]
            self._run(there, last, lambda part: None)
            show((number + 1) / len(rows))
            for place in there.tolist():
                ends = self.found.points[place * self.starts : (place + 1) * self.starts, -1]
                if np.isfinite(ends).all():
                    last[place % inner] = ends

    def _run(self, places: np.ndarray, last: dict[int, np.ndarray] | None, show: Callable[[float], None]) -> None:
        """Follow the motions of some points, from where others ended if there are any."""
        if not len(places):
            return
        inner = len(self.points.prepared) // len(next(iter(self.points.coordinates.values())))
        known = {place: last[place % inner] for place in places.tolist() if last and place % inner in last}
        given = self.initial is not None and realizations_of(self.initial) > 1
        if known or given or self.starts == 1:
            every = np.arange(self.starts)
            self._follow(places, every, [known.get(place, self.begins[place][0]) for place in places.tolist()], show)
            return
        self._follow(places, np.arange(1), [self.begins[place][0] for place in places.tolist()], lambda part: None)
        begins = []
        for place in places.tolist():
            x, v = np.split(self.found.points[place * self.starts], 2, axis=1)
            angles = v * self.points.prepared[place].strobe.period / (2.0 * np.pi)  # type: ignore[union-attr]
            size = np.nan_to_num(np.hypot(x, angles).max(axis=0, initial=0.0))
            begin = np.repeat(self.begins[place][0], self.starts, axis=0)
            rate = 2.0 * np.pi / self.points.prepared[place].strobe.period  # type: ignore[union-attr]
            begin[:, self.coordinates :] += self.draws * size * rate
            begins.append(begin)
        self._follow(places, np.arange(1, self.starts), begins, show)

    def _follow(
        self, places: np.ndarray, starts: np.ndarray, begins: Sequence[np.ndarray], show: Callable[[float], None]
    ) -> None:
        """Follow some starts of some points, each with displacements and velocities, (start or 1, 2 coordinate)."""
        lanes = [self.points.prepared[place] for place in places.tolist() for _ in starts]
        state = np.concatenate([np.broadcast_to(item, (self.starts, item.shape[1]))[starts] for item in begins])
        laws = [self.begins[place][1] for place in places.tolist()]
        states = np.concatenate([np.broadcast_to(item, (self.starts, item.shape[1]))[starts] for item in laws])
        rows = (places[:, None] * self.starts + starts).ravel()
        self.found.put(rows, followed([item for item in lanes if item is not None], state, states, self.wanted, show))

    def dataset(self, slots: Sequence[int], options: Mapping[str, Any]) -> xr.Dataset:
        """Return all that was found as one dataset."""
        points, found, model = self.points, self.found, self.points.first.model
        names, sizes = tuple(points.coordinates), tuple(map(len, points.coordinates.values()))
        shape, each = (*sizes, self.starts), (*names, "start")
        if len(found.refused) == len(found.periods):
            raise InvalidInput(f"There is no motion at any point; at the first one: {found.refused[0]}")
        states = np.full((*found.points.shape[:2], 2, len(model.bodies.names)), np.nan)
        status = np.array(points.refused, dtype=object)
        for place, item in enumerate(points.prepared):
            lanes = slice(place * self.starts, (place + 1) * self.starts)
            if item is not None:
                states[lanes] = item.of_bodies(found.points[lanes])
            lost = [found.refused[lane] for lane in range(lanes.start, lanes.stop) if lane in found.refused]
            status[place] = status[place] or next(iter(lost), DONE)
        states = states[..., slots].reshape(*shape, self.wanted.keep, 2, len(slots))
        periods = [np.nan if item is None else item.strobe.period for item in points.prepared]
        of_points, of_contacts = (*each, "point", BODY), (*each, CONTACT)
        variables = {
            "displacement": labelled(of_points, states[..., 0, :], "m", "displacement at a point of the section"),
            "velocity": labelled(of_points, states[..., 1, :], "m s-1", "velocity at a point of the section"),
            "period": labelled(each, found.periods.reshape(shape), "1", "points after which the motion repeats"),
            "impacts": labelled(of_contacts, found.impacts.reshape(*shape, -1), "1", "impacts from point to point"),
            "path_error": labelled(each, found.errors.reshape(shape), "m", "estimated error of displacements"),
            "section_period": labelled(names, np.reshape(periods, sizes), "s", "time from point to point"),
            "status": (names, status.astype(str).reshape(sizes), {"long_name": f"{DONE}, or why there is no motion"}),
            CONFIGURATION: (names, _texts(points.networks, sizes), {"long_name": "network of the point"}),
        }
        variables["period"][2]["comment"] = "0 where it does not repeat, -1 where there is no motion"
        coordinates = {
            **points.coordinates, BODY: [model.bodies.names[slot] for slot in slots],
            CONTACT: list(model.contacts.names), "start": np.arange(self.starts),
        }  # fmt: skip
        title = f"Motions of networks of oscillators with contacts over {', '.join(names)}"
        cited = in_one_line(entries([{"network": item} for item in points.networks]))
        attributes = provenance(title, json.dumps({"bifurcation": options}, default=np.ndarray.tolist), cited)
        return xr.Dataset(variables, coordinates, attributes)


def _texts(networks: Sequence[Any], sizes: tuple[int, ...]) -> np.ndarray:
    return np.array([json_of({"network": item}) for item in networks]).reshape(sizes)
