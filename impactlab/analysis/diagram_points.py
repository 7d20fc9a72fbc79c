"""The points of a diagram: networks that are made one by one, or families of them that are made of a few."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import impactlab
from impactlab.analysis.event_returns import event_returns
from impactlab.analysis.found_points import Returns, Wanted
from impactlab.analysis.prepared import Prepared
from impactlab.analysis.returns import LinearLanes, SmoothLanes
from impactlab.components.stored import stored
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.kernels.contact_states import RIGID
from impactlab.located.families import Family
from impactlab.located.scenes import Linear, as_lanes
from impactlab.located.smooth import Smooth
from impactlab.records.surface import Surface
from impactlab.sweeps.sweep_points import MakeNetwork, reason_of

QUESTION = "il.bifurcation"

FEWEST_POINTS = 1000
"""Points from which on a family is made of fewer networks: polynomials of two parameters take some hundred."""

PROPORTIONAL = 1e-12
"""Rounding of the ratios of frequencies."""

Starts = tuple[np.ndarray, np.ndarray]
"""Displacements and velocities where motions begin, (start, 2 coordinate), and states of laws, (start, state)."""


class DiagramPoints(ABC):
    """The networks of a diagram, numbered with the last parameter varying fastest.

    Attributes
    ----------
    first : Prepared
        A network of these.
    refused : list of str
        Why there is no motion at a point, "" where there is one.
    networks : list
        Networks that have been made, as they are stored, each with the values of the parameters.
    """

    first: Prepared
    refused: list[str]
    networks: list[tuple[tuple[Any, ...], Any]]

    @abstractmethod
    def periods(self) -> np.ndarray:
        """Return the time from point to point of the section, (point,) (s), NaN where there is none."""

    @abstractmethod
    def begin(self, places: np.ndarray, initial: Mapping[str, Any] | None) -> list[Starts]:
        """Return where the motions of some points begin."""

    @abstractmethod
    def returns(self, places: np.ndarray, begins: Starts, wanted: Wanted, show: Callable[[float], None]) -> Returns:
        """Run lanes, each at one of some points, and each with a start of its own."""

    @abstractmethod
    def of_bodies(self, points: np.ndarray, times: np.ndarray, starts: int) -> np.ndarray:
        """Return displacements and velocities of all bodies, (lane, …, 2, body), at points and times of lanes."""


class MadePoints(DiagramPoints):
    """Networks that are made one by one."""

    def __init__(
        self, make: MakeNetwork, values: Mapping[str, Sequence[Any]], labels: Mapping[str, np.ndarray],
        section: Surface | None,
    ) -> None:  # fmt: skip
        self.networks, self.refused, self.prepared = [], [], list[Prepared | None]()
        every = itertools.product(*values.values()), itertools.product(*(item.tolist() for item in labels.values()))
        for combination, label in zip(*every, strict=True):
            self.networks.append((label, {}))
            self.prepared.append(None)
            self.refused.append("")
            try:
                network = make(**dict(zip(values, combination, strict=True)))
                if not isinstance(network, impactlab.Network):
                    raise InvalidInput(f"make_network must return an il.Network, not {network!r}.")
                self.networks[-1] = label, stored(network)
                self.prepared[-1] = Prepared.of(network, section, QUESTION)
            except ImpactLabError as error:
                self.refused[-1] = reason_of(error)
        if all(self.refused):
            raise InvalidInput(f"There is no point that could be followed; at the first one: {self.refused[0]}")
        self.first = next(item for item in self.prepared if item is not None)
        known = self.first.model.bodies.names, self.first.model.contacts.names
        for item in self.prepared:
            if item is not None and (item.model.bodies.names, item.model.contacts.names) != known:
                raise InvalidInput("The bodies and contacts must have the same names in the same order at all points.")

    def _chosen(self, places: np.ndarray) -> list[Prepared]:
        return [item for item in (self.prepared[place] for place in places.tolist()) if item is not None]

    def periods(self) -> np.ndarray:
        strobes = [None if item is None or item.surface is not None else item.strobe for item in self.prepared]
        return np.array([np.nan if item is None else item.period for item in strobes])

    def begin(self, places: np.ndarray, initial: Mapping[str, Any] | None) -> list[Starts]:
        return [item.begin(initial) for item in self._chosen(places)]

    def returns(self, places: np.ndarray, begins: Starts, wanted: Wanted, show: Callable[[float], None]) -> Returns:
        return followed(self._chosen(places), *begins, wanted, show)

    def of_bodies(self, points: np.ndarray, times: np.ndarray, starts: int) -> np.ndarray:
        result = np.full((*points.shape[:-1], 2, len(self.first.model.bodies.names)), np.nan)
        for place, item in enumerate(self.prepared):
            lanes = slice(place * starts, (place + 1) * starts)
            if item is not None:
                result[lanes] = item.of_bodies(points[lanes], times[lanes])
        return result


class FamilyPoints(DiagramPoints):
    """A family of networks whose numbers are polynomials of the parameters; refused where there is none."""

    def __init__(self, make: MakeNetwork, values: Mapping[str, np.ndarray], section: Surface | None) -> None:
        self.networks, made = [], list[impactlab.Network]()

        def made_at(**place: Any) -> Any:
            network = make(**place)
            if isinstance(network, impactlab.Network):
                self.networks.append((tuple(place.values()), stored(network)))
                made.append(network)
            return network

        self.family = Family.of(made_at, {name: (item.min(), item.max()) for name, item in values.items()})
        self.first = Prepared.of(made[0], section, QUESTION)
        meshes = np.meshgrid(*values.values(), indexing="ij")
        self.values = np.stack([mesh.ravel() for mesh in meshes], axis=1)
        self.refused = [""] * len(self.values)
        assert isinstance(self.first.scene, Linear)
        own, waves = self.first.scene.frequencies[0], self.family.scenes(self.values).frequencies
        ratios = waves / own if len(own) else np.ones((len(waves), 1))
        if np.ptp(ratios, axis=1).max() > PROPORTIONAL * ratios.max():
            raise InvalidInput("Frequencies are not proportional.")
        if section is not None and np.ptp(ratios) > PROPORTIONAL:
            raise InvalidInput("Frequencies change, and the section does not.")
        if not self.first.model.bodies.free.all() or self.first.surface is not None:
            raise InvalidInput("Motions that are given differ.")
        self._periods = self.first.strobe.period / ratios[:, 0]

    def periods(self) -> np.ndarray:
        return self._periods

    def begin(self, places: np.ndarray, initial: Mapping[str, Any] | None) -> list[Starts]:
        state, laws = self.first.begin(initial)
        result, scene = [(state, laws)] * len(places), self.family.scenes(self.values[places])
        pressed = (scene.gap[:, scene.kinds < RIGID] > 0.0).any(axis=1)
        for lane in np.flatnonzero(pressed).tolist() if initial is None else []:
            own = state.copy()
            own[:, : state.shape[1] // 2] = scene.lanes(np.array([lane])).at_rest()
            result[lane] = own, laws
        return result

    def returns(self, places: np.ndarray, begins: Starts, wanted: Wanted, show: Callable[[float], None]) -> Returns:
        names, model = self.first.row_names(), self.first.model
        begin = np.full(len(places), self.first.strobe.start)
        lanes = LinearLanes(
            self.family.scenes(self.values[places]),
            begin,
            self._periods[places],
            begins[0],
            wanted,
            len(model.contacts.names),
        )
        return lanes.run(lambda lane, contact: names[contact], show)

    def of_bodies(self, points: np.ndarray, times: np.ndarray, starts: int) -> np.ndarray:
        return self.first.of_bodies(points, times)


def points_of(
    make: MakeNetwork, values: Mapping[str, Sequence[Any]], labels: Mapping[str, np.ndarray], section: Surface | None
) -> DiagramPoints:
    """Return the points of a product of values: a family of networks where there is one, and many points."""
    smooth = all(item.dtype.kind == "f" and len(item) > 1 for item in labels.values())
    if smooth and np.prod([len(item) for item in labels.values()]) >= FEWEST_POINTS:
        try:
            return FamilyPoints(make, labels, section)
        except ImpactLabError:
            pass  # no family: refusals are those of single points
    return MadePoints(make, values, labels, section)


def followed(
    lanes: Sequence[Prepared], state: np.ndarray, laws: np.ndarray, wanted: Wanted, show: Callable[[float], None]
) -> Returns:
    """Run networks as lanes, those that are alike in one call.

    They begin at the given displacements and velocities, (lane, 2 coordinate), and states of laws, (lane, state).
    """
    contacts = len(lanes[0].model.contacts.names)
    result = Returns.nothing(len(lanes), wanted, state.shape[1] // 2, contacts)
    groups: dict[tuple[Any, ...], list[int]] = {}
    for place, item in enumerate(lanes):
        groups.setdefault(item.alike, []).append(place)
    done = 0
    for places in groups.values():
        members, chosen = [lanes[place] for place in places], np.array(places)

        def told(part: float, done: int = done, share: int = len(places)) -> None:
            show((done + share * part) / len(lanes))

        try:
            found = _returns_of(members, state[chosen], laws[chosen], wanted, told)
        except ImpactLabError as error:
            found = Returns.nothing(len(places), wanted, state.shape[1] // 2, contacts)
            if len(places) == 1:
                found.refused[0] = reason_of(error)
            for place, member in enumerate(members if len(places) > 1 else ()):  # the fault is that of some
                own = chosen[place : place + 1]
                found.put(np.array([place]), followed([member], state[own], laws[own], wanted, lambda part: None))
        result.put(chosen, found)
        done += len(places)
    return result


def _returns_of(
    members: Sequence[Prepared], state: np.ndarray, laws: np.ndarray, wanted: Wanted, show: Callable[[float], None]
) -> Returns:
    """Run networks that are alike in one call."""
    names, contacts = _names(members), len(members[0].model.contacts.names)
    if members[0].surface is not None:
        return event_returns(members, state, laws, wanted, names, show)
    begin, interval = np.array([[item.strobe.start, item.strobe.period] for item in members]).T
    if isinstance(members[0].scene, Smooth):
        networks = [item.scene for item in members if isinstance(item.scene, Smooth)]
        return SmoothLanes(networks, begin, interval, state, laws, wanted, contacts).run(names, show)
    scene = as_lanes([item.scene for item in members if isinstance(item.scene, Linear)])
    return LinearLanes(scene, begin, interval, state, wanted, contacts).run(names, show)


def _names(members: Sequence[Prepared]) -> Callable[[int, int], str]:
    """Return a function that names a contact of a lane."""
    return lambda lane, contact: members[lane].row_names()[contact]
