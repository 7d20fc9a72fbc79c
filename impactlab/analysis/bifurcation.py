"""Bifurcation diagrams: the motions that networks come up to over a parameter, and maps of their periods over two."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from operator import methodcaller
from typing import Any

import numpy as np
import xarray as xr

import impactlab
from impactlab.analysis.diagram_points import DiagramPoints, points_of
from impactlab.analysis.found_points import SETTLED_WITHIN, Returns, Wanted
from impactlab.analysis.prepared import slots_of
from impactlab.compiling.announced import announced
from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries, json_of
from impactlab.errors import InvalidInput, keep_in
from impactlab.inputs import checked, positive, whole
from impactlab.plan.seed import Seed, seed_from, seed_of
from impactlab.plan.start import realizations_of
from impactlab.progress import reporter
from impactlab.records.surface import Surface
from impactlab.results.checkpoint import Checkpoint, made
from impactlab.results.dataset import CONFIGURATION, parsed, provenance
from impactlab.results.labels import labelled, words
from impactlab.results.plain_values import digest
from impactlab.results.schema import BODY, CONTACT
from impactlab.results.stack import DONE
from impactlab.simulation.kept_runs import kept_run
from impactlab.sweeps.sweep_points import MakeNetwork, check_called, labels_of, values_of

LANES_AT_A_TIME = 16384
"""Lanes that run beside each other: when a run is interrupted, those before are done."""

LANES_OF_ITEM = 2048
"""The same where they are kept as an item of a checkpoint."""

LANE_BYTES = 2e8
"""Memory of the pieces and points of lanes that run beside each other, about (bytes)."""

SPREAD = 2.0
"""Largest velocity of a start, as a multiple of that of the motion after rest: motions of some times the energy."""


@checked
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
    checkpoint: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Return the motions that networks settle to over a parameter, as points of a section.

    Linear networks with linear or rigid contacts or dry friction move exactly from event to event, others by steps of
    order eight, as with `EventLocated`. All values and starts run side by side on all cores. A motion that has become
    periodic within 1e-10 of its size is not followed any further. Two parameters give a map of periods, without
    points. When a run is interrupted, its error has the results so far as `found`.

    Parameters
    ----------
    make_network : callable
        ``make_network(name=value, ...)`` returns the network of a point.
    over : mapping of str to sequence
        Values of one or two parameters by name.
    section : Strobe, AtContact or Crossing, optional
        Where motions are sampled; by default once in the common period of all forces, at whole periods from t = 0 on.
    transient : int
        Points of the section before those that are kept.
    keep : int
        Points that are kept; motions are found to repeat after up to a third of them.
    follow : str, optional
        "up" or "down": the motions at a value of the first parameter begin at the ends of those at the previous, or
        next, value, which shows hysteresis. By default all begin in the same way.
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
    checkpoint : str or path, optional
        Folder that keeps what is finished, so that the same call goes on where the last one was stopped; as for
        `simulate`.

    Returns
    -------
    xarray.Dataset
        With the parameters as first dimensions: ``displacement`` and ``velocity`` (…, start, point, oscillator), over
        one parameter; ``period`` (…, start), the number of points after which the motion repeats, 0 where it does not
        among the points that are kept, -1 where there is no motion; ``impacts`` (…, start, contact), mean number of
        impacts from point to point, NaN for endlessly many; ``path_error`` (…, start), the estimated error of
        displacements, infinite where rounding has grown to the size of the motion, as in chaos; ``section_period``
        (…), the time from point to point of a strobe, or ``section_time`` (…, start, point) at contacts and levels; and
        ``status``, "done" or the reason why there is no motion.

    Raises
    ------
    InvalidInput
        If something given cannot be used, or every point is refused; under noise, use `sweep`.

    Examples
    --------
    >>> def struck(frequency):
    ...     return driven.replace(excitations={"a": il.Harmonic(1.0, frequency=frequency)})
    >>> diagram = il.bifurcation(struck, {"frequency": [2.2, 2.5, 2.8]})
    >>> diagram.period.values
    array([[1],
           [1],
           [0]])
    """
    if len(over) not in (1, 2):
        raise InvalidInput(
            f'bifurcation takes the values of one or two parameters, {{"amplitude": [0.1, 0.2]}}, not {over!r}.'
        )
    close, several = positive("tolerance", tolerance), len(over) == 2
    wanted = Wanted(
        whole("transient", transient, 0), whole("keep", keep, 2), close, close if several else SETTLED_WITHIN,
        points=not several,
    )  # fmt: skip
    if follow not in (None, "up", "down"):
        raise InvalidInput(f'follow is "up", "down" or None, not {follow!r}.')
    number, seed = _number_of_starts(starts, initial), seed_of(rng)
    given = {name: values_of(name, items) for name, items in over.items()}
    values = {name: labels_of(name, items) for name, items in given.items()}
    check_called(make_network, tuple(values))
    points = points_of(make_network, given, values, section)
    attributes = {name: getattr(items, "attrs", {}) for name, items in over.items()}
    slots = slots_of(names, points.first.model.bodies.names)
    first = next(iter(values.values()))
    options: dict[str, Any] = {
        "section": None if section is None else section.to_dict(), "transient": transient, "keep": keep,
        "follow": follow, "starts": starts, "initial": initial, "names": names, "tolerance": tolerance,
         "over": {name: items.tolist() for name, items in values.items()},
    }  # fmt: skip
    asked = {**options, "networks": digest(points.networks), "rng": None if rng is None else seed}
    with announced(progress), kept_run(checkpoint, "bifurcation", None, asked) as (kept, used):
        used = seed if kept is None else used
        options |= {"seed": list(used)}
        inner = len(points.refused) // len(first)
        diagram = _Diagram(points, inner, wanted, number, used, initial, kept)
        try:
            diagram.run(follow, first, reporter(progress))
        except KeyboardInterrupt as error:
            keep_in(error, diagram.dataset(values, attributes, slots, options), "points that were done")
            raise
        return diagram.dataset(values, attributes, slots, options)


def again(
    dataset: xr.Dataset, options: Mapping[str, Any], progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Return a diagram again from what is stored with it."""
    given = dict(options)
    stored = [parsed(item) for item in dataset[CONFIGURATION].values.ravel()]
    networks = {tuple(item["values"]): item["network"] for item in stored}

    def make(**values: Any) -> impactlab.Network:
        kept = networks[tuple(values.values())]
        if not kept:
            raise InvalidInput(str(dataset["status"].sel(values).item()))
        return impactlab.Network.from_dict(kept)

    section = given.pop("section")
    section = None if section is None else Surface.from_dict(section)
    over = {name: dataset[name].values.tolist() for name in given.pop("over")}  # of a part, too
    return bifurcation(make, over, section=section, rng=seed_from(given.pop("seed")), progress=progress, **given)


def _number_of_starts(starts: int, initial: Mapping[str, Any] | None) -> int:
    """Return the number of starts, which given values may tell."""
    number = whole("starts", starts, 1)
    if initial is None:
        return number
    given = realizations_of(initial)
    if number != 1 and given not in (1, number):
        raise InvalidInput(f"initial has the values of {given} starts, but starts={number}; leave out starts=.")
    return max(number, given)


class _Diagram:
    """The motions at all points, as they are found."""

    def __init__(
        self, points: DiagramPoints, inner: int, wanted: Wanted, starts: int, seed: Seed,
        initial: Mapping[str, Any] | None, kept: Checkpoint | None,
    ) -> None:  # fmt: skip
        self.points, self.inner, self.wanted, self.starts, self.initial = points, inner, wanted, starts, initial
        self.kept = kept
        self.coordinates = points.first.begin(initial)[0].shape[1] // 2
        contacts = len(points.first.model.contacts.names)
        self.found = Returns.nothing(len(points.refused) * starts, wanted, self.coordinates, contacts)
        draws = np.random.default_rng(np.random.SeedSequence(seed))
        self.draws = draws.uniform(-SPREAD, SPREAD, (starts, self.coordinates))

    def run(self, follow: str | None, first: np.ndarray, show: Callable[[float], None]) -> None:
        """Follow all motions, or those at one value of the first parameter after the other."""
        places = np.array([place for place, text in enumerate(self.points.refused) if not text])
        if follow is None:
            numbers = 60 * (self.coordinates + 1) ** 2 + 4 * self.wanted.keep * self.coordinates  # of a lane, about
            most = LANES_AT_A_TIME if self.kept is None else LANES_OF_ITEM
            most = max(1, min(most, int(LANE_BYTES / (8 * numbers))) // self.starts)
            blocks = [places[begin : begin + most] for begin in range(0, len(places), most)]
            for number, block in enumerate(blocks):
                self._run(block, {}, lambda part, number=number: show((number + part) / len(blocks)))  # type: ignore[misc]
            return
        order = np.argsort(first, kind="stable")
        rows = (order if follow == "up" else order[::-1]).tolist()
        last: dict[int, np.ndarray] = {}
        for number, row in enumerate(rows):
            there = places[places // self.inner == row]
            if len(there):
                self._run(there, last, lambda part: None)
            show((number + 1) / len(rows))
            for place in there.tolist():
                ends = self.found.ends[place * self.starts : (place + 1) * self.starts]
                if np.isfinite(ends).all():
                    last[place % self.inner] = ends

    def _run(self, places: np.ndarray, last: Mapping[int, np.ndarray], show: Callable[[float], None]) -> None:
        """Follow the motions of some points, from where others ended if there are any."""
        begins = self.points.begin(places, self.initial)
        states = [
            last.get(place % self.inner, state) for place, (state, _) in zip(places.tolist(), begins, strict=True)
        ]
        laws, every = [item for _, item in begins], np.arange(self.starts)
        given = self.initial is not None and realizations_of(self.initial) > 1
        if last or given or self.starts == 1:
            self._follow(places, every, states, laws, show)
            return
        self._follow(places, every[:1], states, laws, lambda part: None)
        half = self.coordinates
        sizes = np.nan_to_num(self.found.sizes[places * self.starts, half:])
        sizes = np.where(
            sizes.any(axis=1, keepdims=True), sizes, sizes.max(axis=0)
        )  # as at other points, where it rests
        if not sizes.any():
            raise InvalidInput(
                "The motion that begins at rest stays there, and tells no size of the velocities of other starts; give "
                'initial= with several values, {"displacement": {name: [...]}}.'
            )
        begins = [(np.repeat(state[:1], self.starts, axis=0), size) for state, size in zip(states, sizes, strict=True)]
        for state, size in begins:
            state[:, half:] += self.draws * size
        self._follow(places, every[1:], [state for state, _ in begins], laws, show)

    def _follow(
        self, places: np.ndarray, starts: np.ndarray, states: Sequence[np.ndarray], laws: Sequence[np.ndarray],
        show: Callable[[float], None],
    ) -> None:  # fmt: skip
        """Follow some starts of some points, from displacements and velocities and states of laws of each point."""
        begins = [
            np.concatenate([np.broadcast_to(item, (self.starts, item.shape[1]))[starts] for item in items])
            for items in (states, laws)
        ]
        rows = (places[:, None] * self.starts + starts).ravel()
        of_lanes = np.repeat(places, len(starts))
        given = of_lanes, (begins[0], begins[1]), self.wanted
        item = None if self.kept is None else self.kept.item(digest(given))
        self.found.put(rows, Returns(*made(item, self.points.returns, *given, show)))

    def dataset(
        self, values: Mapping[str, np.ndarray], attrs: Mapping[str, Any], slots: Sequence[int],
        options: Mapping[str, Any],
    ) -> xr.Dataset:  # fmt: skip
        """Return all that was found as one dataset."""
        points, found, model = self.points, self.found, self.points.first.model
        names, sizes = tuple(values), tuple(map(len, values.values()))
        shape, each = (*sizes, self.starts), (*names, "start")
        if len(found.refused) == len(found.periods):
            raise InvalidInput(f"There is no motion at any point; at the first one: {found.refused[0]}")
        states = points.of_bodies(found.points, found.times, self.starts)[..., slots]
        states = states.reshape(*shape, states.shape[1], 2, len(slots))
        of_points, of_contacts = (*each, "point", BODY), (*each, CONTACT)
        texts = [json_of({"values": list(values), "network": item}) for values, item in points.networks]
        everywhere = len(texts) == np.prod(sizes)
        networks = (names, np.array(texts).reshape(sizes)) if everywhere else ("network", np.array(texts))
        variables = {
            "displacement": labelled(of_points, states[..., 0, :], "m", "displacement at a point of the section"),
            "velocity": labelled(of_points, states[..., 1, :], "m s-1", "velocity at a point of the section"),
            "period": labelled(each, found.periods.reshape(shape), "1", "points after which the motion repeats"),
            "impacts": labelled(of_contacts, found.impacts.reshape(*shape, -1), "1", "impacts from point to point"),
            "path_error": labelled(each, found.errors.reshape(shape), "m", "estimated error of displacements"),
            "section_period": labelled(names, points.periods().reshape(sizes), "s", "time from point to point"),
            "status": (names, self._status().reshape(sizes), {"long_name": f"{DONE}, or why there is no motion"}),
            CONFIGURATION: (*networks, {"long_name": "networks that were made"}),
        }
        variables["period"][2]["comment"] = "0 where it does not repeat, -1 where there is no motion"
        if points.first.surface is not None:
            text = "time at a point of the section"
            variables["section_time"] = labelled((*each, "point"), found.times.reshape(*shape, -1), "s", text)
            del variables["section_period"]
        if not self.wanted.points:
            variables = {name: item for name, item in variables.items() if "point" not in item[0]}
        coordinates = {
            **{name: (name, items, {"long_name": words(name), **attrs[name]}) for name, items in values.items()},
            BODY: [model.bodies.names[slot] for slot in slots],
            CONTACT: list(model.contacts.names),
            "start": ("start", np.arange(self.starts), {"long_name": "number of the start"}),
        }  # fmt: skip
        title = f"Motions of networks of oscillators with contacts over {', '.join(names)}"
        cited = in_one_line(entries([{"network": item} for _, item in points.networks]))
        attributes = provenance(title, json.dumps({"bifurcation": options}, default=methodcaller("tolist")), cited)
        return xr.Dataset(variables, coordinates, attributes)

    def _status(self) -> np.ndarray:
        """Return "done" or the reason why there is no motion, (point,)."""
        status = [text or DONE for text in self.points.refused]
        for lane, text in sorted(self.found.refused.items(), reverse=True):
            status[lane // self.starts] = text
        for place in np.flatnonzero(np.isnan(self.found.errors[:: self.starts])).tolist():
            status[place] = "interrupted" if status[place] == DONE else status[place]
        return np.array(status)
