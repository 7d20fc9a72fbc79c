"""Basins of attraction: to which motion each start of a network leads."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from operator import methodcaller
from threading import Event
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import impactlab
from impactlab.analysis.attractors import SAME_ORBIT, VISITS, Cells, Trap, are_stable, trap_of
from impactlab.analysis.diagram_points import followed
from impactlab.analysis.found_points import Returns, Wanted
from impactlab.analysis.laps import AT_A_TIME, Laps
from impactlab.analysis.repetition import sizes_of
from impactlab.compiling.announced import announced
from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries, json_of, stored
from impactlab.errors import InvalidInput, keep_in
from impactlab.inputs import checked, finite_array, suggestion
from impactlab.machine import begin, hand_over, workers_of
from impactlab.progress import reporter
from impactlab.records.surface import Surface
from impactlab.results.checkpoint import Checkpoint, KeptItem, made
from impactlab.results.dataset import configuration_of, provenance
from impactlab.results.labels import Variables, labelled
from impactlab.results.plain_values import digest
from impactlab.results.schema import BODY, CONTACT
from impactlab.simulation.kept_runs import kept_run
from impactlab.sweeps.sweep_points import labels_of, values_of

STARTS_FOLLOWED = 512
"""Starts that are followed to the end, to find attractors; and as many again of those that lead to none of these."""

FOLLOWED_FOR = 120
"""Points in which motions are found to repeat."""

CLOSE = 1e-6
"""Distance from a periodic motion, as a part of its size, at which a start is taken to lead to it."""

CHAOTIC_FOR = 4000
"""Points that tell the cells of a motion that is not periodic."""

TRIES = 3
"""Times that a chaotic motion may come near a periodic one, of which it is taken to approach it, and leave it again."""

SHARED = 0.5
"""Share of common points from which on two motions that are not periodic are one."""

AT_FIRST = 1, 1, 2, 2, 4, 4, 8, 8
"""Points after which starts are looked at; the last one is repeated."""

MOST_ATTRACTORS = 100
"""Attractors that are told apart: where dry friction holds bodies anywhere there is no end of them."""

OVERLAPS, UNDECIDED = -1, -2
"""Labels of starts where hard bodies overlap, and of those whose attractor was not found."""

BOX = 5
"""Starts along each side of the boxes of which entropies are taken: Daza et al. use as many."""


@checked
def basins(
    network: impactlab.Network,
    over: Sequence[str],
    grid: Mapping[str, Sequence[float]],
    *,
    section: Surface | None = None,
    initial: Mapping[str, Any] | None = None,
    transient: int = 500,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Return the attractors of a network without noise, and the one to which each start of a grid leads.

    Attractors are found from some of the starts, which are followed until they repeat. Around each periodic attractor a
    neighbourhood is sought whose starts are verified to lead to it: an ellipsoid of its monodromy matrix, whose surface
    comes to lie inside itself after a period, as do all smaller ones that are tried. A start is labelled when it enters
    one. Motions that are not periodic are known by the cells that they visit. Starts that have entered none are
    followed to the end as well. Chaos that lasts longer than `transient` and 4000 points of the section more counts as
    an attractor.

    Parameters
    ----------
    network : Network
        Its forces repeat with a period.
    over : sequence of str
        What varies: ``"displacement:name"`` or ``"velocity:name"`` of bodies.
    grid : mapping of str to sequence of float
        A name and values for each of these; all combinations are starts.
    section : Strobe, optional
        The times at which motions are looked at; starts are at one of them. By default the common period of all forces
        from t = 0 on; where nothing varies in time, the slowest natural period of a body alone.
    initial : mapping, optional
        Displacements and velocities of all that does not vary, as for `simulate`; at rest by default.
    transient : int
        Points of the section after which a start that has entered no neighbourhood is followed to the end.
    executor : concurrent.futures.Executor, optional
        Where to run; threads on all cores by default. Labels never depend on it.
    progress : bool or callable, optional
        As for `simulate`. When a run is interrupted, its error has what was found as `found`.
    checkpoint : str or path, optional
        Folder that keeps what is finished, so that the same call goes on where the last one was stopped; as for
        `simulate`.

    Returns
    -------
    xarray.Dataset
        ``label`` over the names of the grid: the number of the attractor, -1 where hard bodies overlap at the start, -2
        where none was found. ``fraction`` of the starts of each attractor, with the standard error of as many random
        starts; ``period``, ``impacts`` from point to point, and ``displacement`` and ``velocity`` (attractor, point,
        oscillator). ``basin_entropy`` and ``boundary_entropy``, those of boxes of five starts a side, and of boxes with
        several labels (A. Daza et al., Sci. Rep. 6, 2016, 31416); a boundary entropy above ln 2 tells of a fractal
        boundary.

    Raises
    ------
    InvalidInput
        If something given cannot be used; under noise, basins have no boundaries.

    Examples
    --------
    >>> grid = {"x": np.linspace(-2.0, 0.0, 8), "v": np.linspace(-2.0, 2.0, 8)}
    >>> found = il.basins(driven, over=("displacement:a", "velocity:a"), grid=grid)
    >>> found.period.values
    array([1])
    """
    laps = Laps.of(network, section)
    coordinates, states = _starts(laps, over, grid, initial)
    options = {
        "over": list(over), "grid": {name: values.tolist() for name, values in coordinates.items()},
        "section": None if section is None else section.to_dict(), "initial": initial, "transient": transient,
    }  # fmt: skip
    search, sizes = _Search(laps, transient, _axes(laps, over)), tuple(map(len, coordinates.values()))
    labels = np.full(len(states), UNDECIDED)

    def dataset() -> xr.Dataset:
        return search.dataset(labels.reshape(sizes), coordinates, stored(network), options)

    asked = {**options, "network": network, "rng": None}
    with announced(progress), kept_run(checkpoint, "basins", executor, asked) as (kept, _):
        try:
            task = Task(network, section, executor, kept)
            search.run(states, _sample(coordinates), labels, task, reporter(progress))
        except KeyboardInterrupt as error:
            keep_in(error, dataset(), "starts that were done")
            raise
    if (labels == OVERLAPS).all():
        raise InvalidInput("Hard bodies overlap at all starts of the grid; choose other values, or another clearance.")
    return dataset()


def again(
    dataset: xr.Dataset, options: Mapping[str, Any], progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Return basins again from what is stored with them."""
    given = dict(options)
    network = impactlab.Network.from_dict(configuration_of(dataset)["network"])
    section = given.pop("section")
    return basins(network, section=None if section is None else Surface.from_dict(section), progress=progress, **given)


def _axes(laps: Laps, over: Sequence[str]) -> np.ndarray:
    """Return the coordinates of the displacement and velocity of the first body that varies."""
    model = laps.prepared.model
    place = int(np.flatnonzero(model.bodies.free).tolist().index(_slot(laps, over[0])[1]))
    return np.array([place, place + laps.coordinates])


def _slot(laps: Laps, item: str) -> tuple[int, int]:
    """Return whether something is a displacement, 0, or a velocity, 1, and the slot of its body."""
    names = laps.prepared.model.bodies.names
    quantity, _, name = item.partition(":") if isinstance(item, str) else ("", "", "")
    if quantity not in ("displacement", "velocity"):
        raise InvalidInput(f'over: give "displacement:name" or "velocity:name", not {item!r}.')
    if name not in names:
        raise InvalidInput(f"over: there is no oscillator {name!r}; {suggestion(name, names)}")
    slot = names.index(name)
    if not laps.prepared.model.bodies.free[slot]:
        raise InvalidInput(f"over: the {quantity} of {name!r} cannot be chosen: its motion is given.")
    return int(quantity == "velocity"), slot


def _starts(
    laps: Laps, over: Sequence[str], grid: Mapping[str, Sequence[float]], initial: Mapping[str, Any] | None
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the values by name, and the states of all starts, the last name varying fastest."""
    if not len(over) or len(over) != len(grid):
        raise InvalidInput(
            'basins takes as many values by name as there are quantities, over=("displacement:a", "velocity:a"), '
            f'grid={{"x": [...], "v": [...]}}, not over={over!r} and a grid of {len(grid)}.'
        )
    coordinates = {
        name: finite_array(f"grid: {name}", labels_of(name, values_of(name, values))) for name, values in grid.items()
    }
    places = [_slot(laps, item) for item in over]
    if len(set(places)) < len(places):
        raise InvalidInput(f"over has a quantity twice: {over!r}.")
    base, free = laps.begin(initial), np.flatnonzero(laps.prepared.model.bodies.free).tolist()
    meshes = np.meshgrid(*coordinates.values(), indexing="ij")
    states = np.tile(base, (meshes[0].size, 1))
    for mesh, (velocity, slot) in zip(meshes, places, strict=True):
        states[:, free.index(slot) + velocity * len(base) // 2] = mesh.ravel()
    return coordinates, states


def _sample(coordinates: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the numbers of some starts, spread over the grid; they are the same in whatever order its values are."""
    shape = tuple(map(len, coordinates.values()))
    number, root = np.arange(STARTS_FOLLOWED), _root(len(shape))
    places = []
    for axis, values in enumerate(coordinates.values()):
        share = (0.5 + number / root ** (axis + 1)) % 1.0
        places.append(np.argsort(values)[(share * len(values)).astype(int)])
    return np.asarray(np.unique(np.ravel_multi_index(places, shape)))


def _root(axes: int) -> float:
    """Return the root of ``x^(axes + 1) = x + 1``, whose powers give evenly spread points (M. Roberts, 2018)."""
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (axes + 1))
    return root


class Attractor(NamedTuple):
    """A motion that starts lead to."""

    points: np.ndarray  # (point, 2 coordinate), one period of it, or many points
    period: int  # 0 where it is not periodic
    impacts: np.ndarray  # (contact,) from point to point
    sizes: np.ndarray  # (2 coordinate,)
    known_by: Trap | Cells | None

    def same(self, points: np.ndarray, period: int) -> bool:
        """Whether points are those of this motion."""
        if period != self.period:
            return False
        if isinstance(self.known_by, Cells):
            return bool(self.known_by.holds(points).mean() > SHARED)
        apart = [np.abs(np.roll(points[:period], turn, axis=0) - self.points) / self.sizes for turn in range(period)]
        return bool(min(item.max() for item in apart) <= SAME_ORBIT)


def _labels_of_block(
    task: tuple[impactlab.Network, Surface | None], states: np.ndarray, attractors: Sequence[Attractor], transient: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return what `entered` does, in any process."""
    return entered(Laps.of(*task), states, attractors, transient)


def entered(
    laps: Laps, states: np.ndarray, attractors: Sequence[Attractor], transient: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the labels of starts that come to be known to lead to an attractor, and the states of the others."""
    labels, states = np.full(len(states), UNDECIDED), states.copy()
    visits = np.zeros((len(states), len(attractors)), np.int64)
    left, done, lengths = np.arange(len(states)), 0, iter(AT_FIRST)
    while len(left) and done < transient:
        length = min(next(lengths, AT_FIRST[-1]), transient - done)
        points = laps.around(states[left], length)
        done += length
        lost = ~np.isfinite(points[:, -1]).all(axis=1)
        if done == length and lost.any():
            labels[left[lost]] = np.where(laps.overlap(states[left[lost]]), OVERLAPS, UNDECIDED)
        states[left] = points[:, -1]
        for number, item in enumerate(attractors):
            if isinstance(item.known_by, Trap):
                labels[left[item.known_by.holds(points).any(axis=1)]] = number
            elif isinstance(item.known_by, Cells) and not _confused(item.known_by, attractors):
                inside = item.known_by.holds(points)
                since = np.where(inside.all(axis=1), length, np.argmin(inside[:, ::-1], axis=1))
                visits[left, number] = np.where(since == length, visits[left, number] + length, since)
                labels[left[visits[left, number] >= VISITS]] = number
        left = left[(labels[left] == UNDECIDED) & ~lost]
    return labels, states


def _confused(cells: Cells, attractors: Sequence[Attractor]) -> bool:
    """Whether a periodic motion visits the cells of another motion, so that visits do not tell these apart."""
    return any(item.period and cells.holds(item.points).mean() > SHARED for item in attractors)


class Task(NamedTuple):
    """A network and its section, from which any process can go on, where to run, and where parts are kept."""

    network: impactlab.Network
    section: Surface | None
    executor: Executor | None
    kept: Checkpoint | None

    def item(self, *described: Any) -> KeptItem | None:
        """Return the item of what is described."""
        return None if self.kept is None else self.kept.item(digest(described))


class _Search:
    """Attractors, as they are found."""

    def __init__(self, laps: Laps, transient: int, axes: np.ndarray) -> None:
        self.laps, self.transient, self.axes = laps, transient, axes
        self.attractors: list[Attractor] = []
        self.begins = np.zeros((1, 2 * laps.coordinates))  # largest displacements and velocities of starts

    def run(
        self, states: np.ndarray, sample: np.ndarray, labels: np.ndarray, task: Task, show: Callable[[float], None]
    ) -> None:
        """Write the label of each start; attractors are found from a sample, and from those that lead to none."""
        self.begins = np.abs(states).max(axis=0, keepdims=True)
        self.find(states[sample], task)
        self._sort()
        last, done = states.copy(), 0
        parts = [slice(first, first + AT_A_TIME) for first in range(0, len(states), AT_A_TIME)]

        def take(found: tuple[np.ndarray, np.ndarray]) -> None:
            nonlocal done
            labels[parts[done]], last[parts[done]] = found
            done += 1
            show(done / (len(parts) + 1))

        if task.executor is None:
            for part in parts:
                given = states[part], self.attractors, self.transient
                take(made(task.item("entered", given), entered, self.laps, *given))
        else:
            blocks = ((states[part], self.attractors, self.transient) for part in parts)
            futures = (
                begin(task.executor, made, task.item("entered", of_block), _labels_of_block, task[:2], *of_block)
                for of_block in blocks
            )
            hand_over(futures, take, lambda: None, Event(), 4 * workers_of(task.executor))
        order = np.lexsort(states.T[::-1])  # the same whatever the order of the grid
        left = order[(labels[order] == UNDECIDED) & np.isfinite(last[order]).all(axis=1)]
        while len(left):
            here, left, known = left[:STARTS_FOLLOWED], left[STARTS_FOLLOWED:], len(self.attractors)
            labels[here] = self.find(last[here], task)
            if len(self.attractors) > known and len(left):
                given = last[left], self.attractors, self.transient
                labels[left], last[left] = made(task.item("entered", given), entered, self.laps, *given)
                left = left[(labels[left] == UNDECIDED) & np.isfinite(last[left]).all(axis=1)]
        show(1.0)

    def find(self, states: np.ndarray, task: Task) -> np.ndarray:
        """Follow starts to the end; return the labels of their attractors, new ones among them."""
        prepared = self.laps.prepared
        count, laws = len(states), np.zeros((len(states), 0))
        wanted = Wanted(self.transient, FOLLOWED_FOR, CLOSE)
        item = task.item("followed", states, wanted)
        found = Returns(*made(item, followed, [prepared] * count, states, laws, wanted, lambda part: None))
        labels = np.full(count, UNDECIDED)
        for lane in np.flatnonzero(found.periods >= 0).tolist():
            labels[lane] = self._label(found.points[lane], int(found.periods[lane]), found.impacts[lane])
        return labels

    def _label(self, points: np.ndarray, period: int, impacts: np.ndarray, tries: int = TRIES) -> int:
        """Return the number of the attractor that has these points, a new one if none has them.

        Where they do not repeat, those that follow decide.
        """
        for number, item in enumerate(self.attractors):
            if item.same(points, period):
                return number
        if len(self.attractors) == MOST_ATTRACTORS:
            return UNDECIDED
        if tries and not period:
            wanted, laws = Wanted(CHAOTIC_FOR, FOLLOWED_FOR, CLOSE), np.zeros((1, 0))
            found = followed([self.laps.prepared], points[-1:], laws, wanted, lambda part: None)
            if found.periods[0] > 0:  # the chaos was a transient
                return self._label(found.points[0], int(found.periods[0]), found.impacts[0], tries - 1)
        units = np.repeat([1.0, self.laps.period / (2.0 * np.pi)], self.laps.coordinates)
        sizes = sizes_of((points * units)[None], self.begins * units)[0, 0] / units
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        known: Trap | Cells | None
        later = self.laps.around(points[-1:], CHAOTIC_FOR)[0]
        later = later[np.isfinite(later).all(axis=1)]
        if period:
            orbit = Attractor(points[:period], period, impacts, sizes, None)
            if not (len(later) >= period and orbit.same(later[-period:], period)):  # it was only passed by
                return self._label(later, 0, impacts, tries)
            points = later[-period:]
            matrices = self.laps.monodromies(points, sizes)
            known = trap_of(points, sizes, matrices, self.laps.around) if are_stable(matrices) else None
        else:
            points, known = later, Cells.of(later, self.axes, sizes)
        self.attractors.append(Attractor(points, period, impacts, sizes, known))
        return len(self.attractors) - 1

    def _sort(self) -> None:
        """Number periodic attractors first, by their period, and those of one by their points."""

        def place(item: Attractor) -> tuple[Any, ...]:
            lowest = np.round(item.points / item.sizes, 6)
            return item.period == 0, item.period, *lowest[np.lexsort(lowest.T[::-1])[0]].tolist()

        self.attractors.sort(key=place)

    def dataset(
        self, labels: np.ndarray, coordinates: Mapping[str, np.ndarray], network: Any, options: Mapping[str, Any]
    ) -> xr.Dataset:
        """Return labels and attractors as one dataset."""
        model, number = self.laps.prepared.model, len(self.attractors)
        allowed = int((labels != OVERLAPS).sum())
        shares = np.array([(labels == label).sum() for label in range(number)]) / max(allowed, 1)
        errors = np.sqrt(shares * (1.0 - shares) / max(allowed, 1))
        most = max((len(item.points[:FOLLOWED_FOR]) for item in self.attractors), default=0)
        states = np.full((number, most, 2, len(model.bodies.names)), np.nan)
        for place, item in enumerate(self.attractors):
            found = self.laps.prepared.of_bodies(item.points[:FOLLOWED_FOR], np.zeros(0))
            states[place, : len(found)] = found
        impacts = np.array([item.impacts for item in self.attractors]).reshape(number, len(model.contacts.names))
        of_points = "attractor", "point", BODY
        variables: Variables = {
            "label": labelled(tuple(coordinates), labels, "1", "number of the attractor of a start"),
            "fraction": labelled(("attractor",), shares, "1", "share of starts"),
            "fraction_standard_error": labelled(("attractor",), errors, "1", "standard error of the share of starts"),
            "period": labelled(("attractor",), np.array([item.period for item in self.attractors], dtype=int), "1",
                               "points after which the motion repeats"),
            "impacts": labelled(("attractor", CONTACT), impacts, "1", "mean number of impacts between points"),
            "displacement": labelled(of_points, states[:, :, 0], "m", "displacement at a point of the section"),
            "velocity": labelled(of_points, states[:, :, 1], "m s-1", "velocity at a point of the section"),
            **_entropies(labels),
        }  # fmt: skip
        variables["label"][2]["comment"] = "-1 where rigid bodies overlap at the start, -2 where none was found"
        variables["fraction"][2]["ancillary_variables"] = "fraction_standard_error"
        variables["period"][2]["comment"] = "0 where it does not repeat"
        labels_of_dimensions: dict[str, Any] = {
            **coordinates, BODY: list(model.bodies.names), CONTACT: list(model.contacts.names),
            "attractor": ("attractor", np.arange(number), {"long_name": "number of the attractor"}),
        }  # fmt: skip
        for name, quantity in zip(coordinates, options["over"], strict=True):
            units = "m" if quantity.startswith("displacement") else "m s-1"
            text = f"{quantity.partition(':')[0]} of {quantity.partition(':')[2]} at the start"
            attributes_of_axis = {"units": units, "long_name": text, "quantity": quantity}
            labels_of_dimensions[name] = (name, coordinates[name], attributes_of_axis)
        cited = in_one_line(entries([{"network": network}]))
        configuration = json.loads(json_of({"network": network}))
        attributes = provenance(
            "Basins of attraction of a network of oscillators with contacts",
            json.dumps({**configuration, "basins": options}, default=methodcaller("tolist")), cited,
        )  # fmt: skip
        attributes["section_period"] = self.laps.period  # type: ignore[assignment]
        return xr.Dataset(variables, labels_of_dimensions, attributes)


def _entropies(labels: np.ndarray) -> Variables:
    """Return the entropy of labels in boxes, as means over all boxes and over those with several labels."""
    whole = tuple(slice(0, size - size % BOX) for size in labels.shape)
    sides = [part for size in labels.shape for part in (size // BOX, BOX)]
    boxes = labels[whole].reshape(sides)
    axes = [*range(0, 2 * labels.ndim, 2), *range(1, 2 * labels.ndim, 2)]
    rows = boxes.transpose(axes).reshape(-1, BOX**labels.ndim)
    rows = rows[(rows != OVERLAPS).all(axis=1)]
    entropy = np.zeros(len(rows))
    for label in np.unique(rows):
        share = (rows == label).mean(axis=1)
        entropy -= share * np.log(np.where(share > 0.0, share, 1.0))
    several = entropy > 0.0
    values = {
        "basin_entropy": entropy.mean() if len(rows) else np.nan,
        "boundary_entropy": entropy[several].mean() if several.any() else np.nan,
    }
    texts = {"basin_entropy": "mean entropy of boxes", "boundary_entropy": "mean entropy of boxes with several labels"}
    return {name: labelled((), np.array(value), "1", texts[name]) for name, value in values.items()}
