"""Networks that depend on parameters: their numbers as polynomials, so that few networks are made for many values.

The numbers of a scene, see `impactlab.located.scenes`, are smooth functions of most parameters of a network. They are
Chebyshev's polynomials to rounding here, on panels of the range where one does not do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from impactlab.assembly.model import Model
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.located.event_located import EventLocated, check, linear_between_events
from impactlab.located.scenes import Linear, linear_of
from impactlab.networks.network import Network

NUMBERS = (
    "mass", "damping", "stiffness", "frequencies", "load", "force", "points", "links", "gap", "wall", "springs",
    "dampers", "restitution", "frictions", "loads",
)  # fmt: skip
"""Arrays of a scene, in the order of the numbers of a network."""

FEWEST_NODES, MOST_NODES = 4, 32
"""Nodes of an axis of a panel: even numbers, since force that is 0 at the middle of a range would have no wave."""

NARROWEST = 1.0 / 128.0
"""Part of a range that a panel has at least: numbers that need a narrower one are no smooth functions."""

OF_NUMBER, OF_ARRAY = 1e-13, 1e-15
"""Last coefficients that are taken for rounding, as a part of the number, and of the largest in its array."""

LAST = 2
"""Coefficients that are to be rounding."""

ROUNDING = 1e-12
"""Part of a range by which a value may be outside of it."""

CUTS, HALVED_ENDS = 20, 40
"""Times that ranges are cut where there are no networks, and halvings by which such an end is located."""

CHECKED_AT = 0.2763932, 0.8541020
"""Where panels are compared with networks, as parts of them; near no node of a rule that is used."""


class NoSuchNetwork(InvalidInput):
    """At some values there is no network, or none like the others; see `Family.about`."""

    def __init__(self, message: str, box: np.ndarray) -> None:
        super().__init__(message)
        self.box = box  # (axis, 2) where this is so


class Panel(NamedTuple):
    """A part of the ranges of parameters, in which numbers are polynomials."""

    box: np.ndarray  # (axis, 2)
    coefficients: np.ndarray  # (number, coefficient, …), one axis for each parameter


@dataclass(frozen=True, eq=False)
class Family:
    """Networks of one shape that depend on one parameter or two; see `Family.of`."""

    ranges: Mapping[str, tuple[float, float]]
    model: Model  # of the first network that was made
    first: Linear  # its scene
    boxes: np.ndarray  # (panel, axis, 2)
    places: np.ndarray  # (varying,) which numbers of a scene vary
    coefficients: np.ndarray  # (panel, varying, coefficient, …)

    @staticmethod
    def about(
        make: Callable[..., Network], ranges: Mapping[str, tuple[float, float]], place: np.ndarray
    ) -> tuple[Family, dict[tuple[str, float], str]]:
        """Return the family about some values, and why it ends within a range: the name and the end of each cut."""
        whole, reasons = {name: (float(low), float(high)) for name, (low, high) in ranges.items()}, dict[Any, str]()
        for _ in range(CUTS):
            try:
                return Family.of(make, whole, place), reasons
            except NoSuchNetwork as error:
                name, side, end, reason = _cut(make, whole, place, error)
                low, high = whole[name]
                whole[name] = (end, high) if side == 0 else (low, end)
                reasons[name, end] = reason
        raise InvalidInput(f"There are too many values without a network; the last: {reason}")

    @staticmethod
    def of(
        make: Callable[..., Network], ranges: Mapping[str, tuple[float, float]], first: np.ndarray | None = None
    ) -> Family:
        """Return the family of networks ``make(name=value, …)`` over ranges of one or two parameters.

        All are to be like the `first`, at some values.

        Raises
        ------
        InvalidInput
            If a network is refused or nonlinear between events, networks differ in more than numbers, or these are no
            smooth functions of the parameters.
        """
        made = _Made(make, ranges, first)
        panels, waiting = list[Panel](), [np.array(list(ranges.values()), dtype=float)]
        while waiting:
            box = waiting.pop()
            found = _fitted(made, box)
            if isinstance(found, Panel):
                panels.append(found)
                continue
            name = list(ranges)[found]
            if np.diff(box[found]) <= NARROWEST * np.diff(ranges[name]):
                raise NoSuchNetwork(
                    f"The numbers of the network are no smooth functions of {name!r} near {box[found].mean():.6g}; "
                    "give a range that ends there.",
                    box,
                )
            middle = box[found].mean()
            for end in (0, 1):
                half = box.copy()
                half[found, 1 - end] = middle
                waiting.append(half)
        panels.sort(key=lambda panel: tuple(panel.box[:, 0]))
        degrees = np.max([panel.coefficients.shape[1:] for panel in panels], axis=0)
        padded = [
            np.pad(item, [(0, 0), *((0, most - own) for most, own in zip(degrees, item.shape[1:], strict=True))])
            for item in (panel.coefficients for panel in panels)
        ]
        coefficients = np.stack(padded)
        constant = coefficients.reshape(*coefficients.shape[:2], -1)
        varies = (constant[:, :, 1:] != 0.0).any(axis=(0, 2)) | (constant[:, :, 0] != made.numbers).any(axis=0)
        return Family(
            dict(ranges), made.model, made.scene, np.stack([panel.box for panel in panels]), np.flatnonzero(varies),
            np.ascontiguousarray(coefficients[:, varies]),
        )  # fmt: skip

    @staticmethod
    def alone(model: Model) -> Family:
        """Return a network as a family of one parameter that changes nothing; it is linear between events."""
        box = np.array([[[-1.0, 1.0]]])
        return Family({"": (-1.0, 1.0)}, model, linear_of(model), box, np.zeros(0, np.int64), np.zeros((1, 0, 1)))

    def numbers(self, values: np.ndarray) -> np.ndarray:
        """Return all numbers of the scenes at some values, (point, number); values are (point, parameter)."""
        values, ends = (
            np.asarray(values, dtype=float).reshape(-1, len(self.ranges)),
            np.array(list(self.ranges.values())),
        )
        within = np.clip(values, *ends.T)
        values = np.where(np.abs(values - within) <= ROUNDING * np.ptp(ends, axis=1), within, values)
        result = np.repeat(numbers_of(self.first)[None], len(values), axis=0)
        within = (values[:, None] >= self.boxes[:, :, 0]) & (values[:, None] <= self.boxes[:, :, 1])
        inside = np.all(within, axis=2)
        if not inside.any(axis=1).all():
            outside = values[~inside.any(axis=1)][0]
            raise InvalidInput(f"{dict(zip(self.ranges, outside.tolist(), strict=True))} is outside of {self.ranges}.")
        of_panel = inside.argmax(axis=1)
        for panel in np.unique(of_panel):
            chosen = of_panel == panel
            low, high = self.boxes[panel].T
            found = self.coefficients[panel]
            at = (2.0 * values[chosen] - low - high) / (high - low)
            bases = [chebyshev.chebvander(at[:, axis], found.shape[1 + axis] - 1) for axis in range(at.shape[1])]
            axes = "ab"[: len(bases)]
            terms = ",".join(f"p{axis}" for axis in axes)
            result[np.ix_(chosen, self.places)] = np.einsum(f"n{axes},{terms}->pn", found, *bases, optimize=True)
        return result

    def scenes(self, values: np.ndarray) -> Linear:
        """Return the networks at some values, (point, parameter), as lanes."""
        return scenes_of(self.first, self.numbers(values))


def numbers_of(scene: Linear) -> np.ndarray:
    """Return the numbers of a scene of one lane, (number,); complex ones as real and imaginary parts."""
    return np.concatenate([np.ascontiguousarray(getattr(scene, name)).view(float).ravel() for name in NUMBERS])


def scenes_of(first: Linear, numbers: np.ndarray) -> Linear:
    """Return scenes like a first one, with other numbers, (lane, number)."""
    begin, parts = 0, dict[str, Any]()
    for name in NUMBERS:
        like = getattr(first, name)
        size = like.view(float).size
        part = np.ascontiguousarray(numbers[:, begin : begin + size])
        parts[name] = part.view(like.dtype).reshape(len(numbers), *like.shape[1:])
        begin += size
    return replace(first, **parts, functions=first.functions * len(numbers))


class _Made:
    """The networks that have been made, and whether they are of one shape."""

    def __init__(
        self, make: Callable[..., Network], ranges: Mapping[str, tuple[float, float]], first: np.ndarray | None = None
    ) -> None:
        self.make, self.names = make, list(ranges)
        for name, (low, high) in ranges.items():
            if not (np.isfinite([low, high]).all() and low < high):
                raise InvalidInput(f"{name!r} has a range from a lower to a higher finite value, not {(low, high)!r}.")
        middle = [low + CHECKED_AT[0] * (high - low) for low, high in ranges.values()]
        self.model = Model.of(self._network(middle if first is None else first))
        check(self.model, EventLocated())
        if not linear_between_events(self.model):
            raise InvalidInput("The network is not linear between events.")
        self.scene = linear_of(self.model)
        self.numbers = numbers_of(self.scene)
        sizes = [getattr(self.scene, name).view(float).size for name in NUMBERS]
        self.arrays = np.repeat(np.arange(len(NUMBERS)), sizes)

    def _network(self, values: Any) -> Network:
        place = dict(zip(self.names, map(float, values), strict=True))
        try:
            network = self.make(**place)
        except InvalidInput as error:
            raise _missing(place, error) from error
        except ImpactLabError as error:
            raise InvalidInput(f"There is no network at {_told(place)}: {error}") from error
        if not isinstance(network, Network):
            raise InvalidInput(f"make must return an il.Network, but at {_told(place)} it returned {network!r}.")
        return network

    def at(self, values: Any) -> np.ndarray:
        """Return the numbers of the network at some values."""
        network, place = self._network(values), dict(zip(self.names, map(float, values), strict=True))
        try:
            model = Model.of(network)
        except InvalidInput as error:
            raise _missing(place, error) from error
        scene, first = (linear_of(model) if linear_between_events(model) else None), self.scene
        names, others = ([*item.bodies.names, *item.contacts.names] for item in (self.model, model))
        if names != others or scene is None or scene.alike != first.alike or scene.functions != first.functions:
            raise NoSuchNetwork(
                f"The networks of a family differ in numbers only, but at {_told(place)} there are other parts, kinds "
                "of laws or given functions.",
                _point(place),
            )
        return numbers_of(scene)

    def refusal(self, values: np.ndarray) -> str:
        """Return why there is no network like the others at some values, "" if there is one."""
        try:
            self.at(values)
        except InvalidInput as error:
            return str(error)
        return ""

    def scales(self, values: np.ndarray) -> np.ndarray:
        """Return the deviations of numbers that are rounding, (number,), from values of some networks."""
        own = np.abs(values).max(axis=0)
        largest = np.zeros(len(NUMBERS))
        np.maximum.at(largest, self.arrays, own)
        allowed: np.ndarray = np.maximum(OF_NUMBER * own, OF_ARRAY * largest[self.arrays])
        return allowed


def _point(place: Mapping[str, float]) -> np.ndarray:
    return np.repeat(np.array(list(place.values()))[:, None], 2, axis=1)


def _missing(place: Mapping[str, float], error: InvalidInput) -> NoSuchNetwork:
    return NoSuchNetwork(f"There is no network at {_told(place)}: {error}", _point(place))


def _cut(
    make: Callable[..., Network], ranges: Mapping[str, tuple[float, float]], place: np.ndarray, error: NoSuchNetwork
) -> tuple[str, int, float, str]:
    """Return the parameter whose range is to end before values without a network, at which side, where, and why.

    There is a network at a `place`. Of several parameters it is the one of which most is left.
    """
    made, whole, ends = _Made(make, ranges, place), np.array(list(ranges.values())), dict[int, tuple[float, str]]()
    out = np.clip(place, error.box[:, 0], error.box[:, 1])
    for axis in np.flatnonzero(out != place).tolist():
        if (error.box[:, 0] < error.box[:, 1]).any():  # it is not a point
            ends[axis] = float(out[axis]), str(error)
            continue
        near = out.copy()
        near[axis] = place[axis]
        if made.refusal(near):  # the other parameter is to blame
            continue
        ends[axis] = _end(made, near, out, axis)
    for axis in np.flatnonzero(out != place).tolist() if not ends else ():
        alone = place.copy()
        alone[axis] = out[axis]
        ends[axis] = _end(made, place, alone, axis)
    left = {
        axis: abs(end - whole[axis, int(end < place[axis])]) / np.ptp(whole[axis]) for axis, (end, _) in ends.items()
    }
    axis = max(left, key=lambda item: left[item], default=-1)
    if axis < 0 or not left[axis] > 0.0:
        raise error
    end, reason = ends[axis]
    return list(ranges)[axis], int(end > place[axis]), end, reason


def _end(made: _Made, near: np.ndarray, far: np.ndarray, axis: int) -> tuple[float, str]:
    """Return where networks end between a point where there is one and another along an axis, and why."""
    reason = ""
    for _ in range(HALVED_ENDS):
        middle = 0.5 * (near + far)
        told = made.refusal(middle)
        near, far, reason = (near, middle, told) if told else (middle, far, reason)
    return float(near[axis]), reason or made.refusal(far)


def _told(place: Mapping[str, float]) -> str:
    return ", ".join(f"{name}={value:.6g}" for name, value in place.items())


def _fitted(made: _Made, box: np.ndarray) -> Panel | int:
    """Return the numbers in a part of the ranges, or the axis along which they are no polynomials."""
    counts = [FEWEST_NODES] * len(box)
    while True:
        nodes = [_nodes(count, *ends) for count, ends in zip(counts, box, strict=True)]
        values = np.array([made.at(item) for item in itertools.product(*nodes)])
        allowed, fit = made.scales(values), values.T.reshape(-1, *counts)
        for axis, count in enumerate(counts):
            fit = np.moveaxis(np.moveaxis(fit, axis + 1, -1) @ _transform(count).T, -1, axis + 1)
        flat = np.abs(fit)
        rough = [
            bool((np.moveaxis(flat, axis + 1, 1)[:, -LAST:].reshape(len(fit), -1).max(axis=1) > allowed).any())
            for axis in range(len(box))
        ]
        if not any(rough):
            still = (values == values[0]).all(axis=0)
            fit[still], fit[(still, *[0] * len(box))] = 0.0, values[0, still]
            if _agrees(made, box, fit, allowed):
                return Panel(box, fit)
            rough = [True] * len(box)
        counts = [2 * count if item else count for count, item in zip(counts, rough, strict=True)]
        if max(counts) > MOST_NODES:
            return int(np.argmax(counts))


def _agrees(made: _Made, box: np.ndarray, fit: np.ndarray, allowed: np.ndarray) -> bool:
    """Return whether polynomials have the numbers of networks elsewhere."""
    for share in CHECKED_AT:
        place, value = box[:, 0] + share * (box[:, 1] - box[:, 0]), fit
        for _ in range(len(box)):
            basis = chebyshev.chebvander(2.0 * share - 1.0, value.shape[-1] - 1)[0]
            value = value @ basis
        if (np.abs(value - made.at(place)) > 10.0 * allowed).any():
            return False
    return True


def _nodes(count: int, low: float, high: float) -> np.ndarray:
    """Return Chebyshev's nodes between two ends."""
    nodes: np.ndarray = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(count) + 0.5) / count)
    return nodes


def _transform(count: int) -> np.ndarray:
    """Return the matrix from values at Chebyshev's nodes to coefficients."""
    angles = np.pi * (np.arange(count) + 0.5) / count
    result: np.ndarray = np.cos(np.outer(np.arange(count), angles)) * 2.0 / count
    result[0] *= 0.5
    return result
