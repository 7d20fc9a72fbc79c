"""Drawings of networks: bodies in a row with springs, dampers, contacts, couplings and excitations."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import impactlab
from impactlab.components.contact import Contact
from impactlab.components.coupling import LinearCoupling
from impactlab.components.excitation import BaseMotion
from impactlab.components.sides import WALL, is_difference, weights_of
from impactlab.errors import InvalidInput
from impactlab.plotting import symbols
from impactlab.plotting.captions import (
    excitation_lines,
    law_lines,
    numbers,
    side_text,
    structure_lines,
    widest,
    with_units,
)
from impactlab.plotting.layout import ELLIPSIS, Link, Push, is_structure, layout_of, own_name
from impactlab.plotting.style import axes_of, number_text, style
from impactlab.plotting.symbols import FORCE, INK, LETTER, LINE

# Lengths are in inches; the bodies move to the left and to the right.

_WIDTH, _HEIGHT = 1.15, 0.85  # of a body, at least
_GAP, _WIDEST = 0.95, 1.7  # between two bodies
_ANCHOR = 1.35  # from a body to its support beside it
_PITCH = 0.4  # from one symbol below a body to the next, without text
_SHARED = 0.42  # height of a source of several bodies
_WALL = 0.12


def draw_network(network: impactlab.Network, ax: Axes | None = None) -> Figure:
    """Draw a network and return its figure, which is none of pyplot; see :func:`network`."""
    drawing = _Drawing.of(network)
    if ax is None:
        figure = Figure(figsize=drawing.size, layout=None)
        figure.set_layout_engine("none")
        ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    root = drawing.draw(ax).get_figure(root=True)
    assert root is not None
    return root


def network(network: impactlab.Network, ax: Axes | None = None) -> Axes:
    """Draw a network: bodies in a row with springs, dampers, contacts, couplings and excitations.

    Structures are dashed boxes on which the points that are used have their names. A hook is a contact that closes
    when its bodies part. What joins bodies that are not neighbours, or weighted sums of them, lies below the row; of a
    long chain the first and the last bodies are drawn. What is not drawn is named.

    Parameters
    ----------
    network : Network
        What to draw.
    ax : Axes, optional
        Where to draw; a new figure of the right size by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If something else than a network is given.
    """
    drawing = _Drawing.of(network)
    if ax is None:
        ax = axes_of(None, drawing.size)
        ax.figure.set_layout_engine("none")  # type: ignore[union-attr]
        ax.set_position((0.0, 0.0, 1.0, 1.0))
    return drawing.draw(axes_of(ax))


class _Drawing:
    """A network with the measures of its drawing."""

    def __init__(self, network: impactlab.Network) -> None:
        self.network, self.layout = network, layout_of(network)
        self.members = network.given()["oscillators"]
        self.several = self.layout.links > 1
        self.captions = {name: self._caption(name) for name in self.layout.row}

    @classmethod
    def of(cls, network: Any) -> _Drawing:
        if not isinstance(network, impactlab.Network):
            raise InvalidInput(f"A drawing is of an il.Network, not of {network!r}.")
        return cls(network)

    def _caption(self, name: str) -> list[str]:
        """Return what is written on a body, below its name."""
        if name == ELLIPSIS:
            return []
        body: Any = self.members[name]
        if is_structure(body):
            return structure_lines(body)
        own = numbers(body, ("mass", "damping", "stiffness", *body.state_names()))
        return [rf"$m$ = {with_units(body.mass, 'kg')}", *own]

    # measures

    @cached_property
    def lanes(self) -> list[list[tuple[Link, list[str], float]]]:
        """What lies in each place between bodies: links, their text and height."""
        return [[self._lane(link) for link in place] for place in self.layout.between]

    def _lane(self, item: Link) -> tuple[Link, list[str], float]:
        lines = law_lines(item.name if self.several else "", item.link.law)
        symbol = 0.62 if isinstance(item.link, Contact) else 0.12 + 0.22 * len(_symbols(item.link.law))
        return item, lines, symbol + LINE * len(lines) + 0.06

    @cached_property
    def height(self) -> float:
        """Height of the bodies."""
        written = [0.5 + 0.15 * len(caption) for caption in self.captions.values()]
        return max(_HEIGHT, *written, *(sum(height for *_, height in place) for place in self.lanes))

    @cached_property
    def beside(self) -> bool:
        """Whether supports are beside the bodies, not below them."""
        row, held = self.layout.row, self.layout.stops or any(is_structure(item) for item in self.members.values())
        ends = self.layout.between[0] or self.layout.between[-1] or self.layout.apart
        return len(row) <= 2 and not held and not ends

    @cached_property
    def starts(self) -> dict[str, float]:
        """Left sides of the bodies."""
        result, x = {}, 0.0
        for name, place in zip(self.layout.row, self.lanes[1:], strict=True):
            result[name] = x
            x += self.widths[name] + (_spacing(place) if place or ELLIPSIS not in self.layout.row else 0.4)
        return result

    @cached_property
    def widths(self) -> dict[str, float]:
        """Widths of the bodies."""
        wide = {name: LETTER * 1.08 * widest([*lines, f"{name}  "]) + 0.12 for name, lines in self.captions.items()}
        for name in wide:
            if name != ELLIPSIS and is_structure(self.members[name]):
                wide[name] += 1.1  # the names of points stand on both sides
            stops = self.held[name] if self.layout.stops.get(name) else []
            wide[name] = max(wide[name], *(LETTER * widest(lines) + 0.6 for *_, lines in stops), 0.0)
        return {name: max(_WIDTH if name else 0.3, width) for name, width in wide.items()}

    @cached_property
    def apart(self) -> list[tuple[Link, list[str], float]]:
        """Links below the row with their text and the height of their line."""
        result, y = [], -0.12
        for item in self.layout.apart:
            lines = self._apart_text(item)
            tall = 0.3 if isinstance(item.link, Contact) else 0.14
            result.append((item, lines, y - tall))
            y -= tall + 0.22 + LINE * len(lines)
        return result

    def _apart_text(self, item: Link) -> list[str]:
        lines = law_lines(item.name, item.link.law)
        if is_difference(item.link):
            return lines
        sides = f"{side_text(item.link.first)} with {side_text(item.link.second)}"
        clearance = f", {with_units(item.link.clearance, 'm')}" if isinstance(item.link, Contact) else ""
        return [lines[0], f"{sides}{clearance}", *lines[1:]]

    @cached_property
    def held(self) -> dict[str, list[tuple[str, Any, list[str]]]]:
        """What is below each body: a symbol, the link of a wall if there is one, and its text."""
        result: dict[str, list[tuple[str, Any, list[str]]]] = {}
        for name in self.layout.row:
            found = result.setdefault(name, [])
            if name == ELLIPSIS:
                continue
            body: Any = self.members[name]
            if not is_structure(body):
                found += [
                    (kind, None, [rf"${letter}$ = {with_units(value, units)}"])
                    for kind, letter, value, units in (
                        ("spring", "k", body.stiffness, "N m-1"),
                        ("damper", "c", body.damping, "N s m-1"),
                    )
                    if value
                ]
            for item in self.layout.stops.get(name, []):
                lines = law_lines(item.name if self.several else "", item.link.law)
                kinds = ["gap"] if isinstance(item.link, Contact) else _symbols(item.link.law)
                found += [(kind, item.link, lines if kind == kinds[-1] else []) for kind in kinds]
        return result

    @cached_property
    def below(self) -> float:
        """Where supports begin, beneath what joins bodies that are apart."""
        if not self.apart:
            return -0.02
        _, lines, y = self.apart[-1]
        return y - 0.22 - LINE * len(lines)

    @cached_property
    def floor(self) -> float:
        """Height of the floor."""
        if self.beside:
            return -0.55
        depth = [sum(_depth(kind, lines) for kind, _, lines in items) for items in self.held.values()]
        return self.below - max(0.35, *depth) - 0.1

    @cached_property
    def top(self) -> float:
        """Height of what is written above the bodies."""
        own = [sum(len(lines) for _, lines in self._pushes(name)) for name in self.layout.row]
        return self.height + _SHARED * len(self.layout.shared) + (0.32 + LINE * max(own) if any(own) else 0.2)

    @cached_property
    def limits(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper end of the drawing."""
        row = self.layout.row
        held = [self.beside and bool(self.held[name]) for name in row]
        first, last = (_spacing(place) + 0.3 if place else 0.3 for place in (self.lanes[0], self.lanes[-1]))
        left = -_ANCHOR - 0.3 if held[0] else -first
        right = self.starts[row[-1]] + self.widths[row[-1]]
        right += _ANCHOR + 0.3 if held[-1] and len(row) == 2 else last
        moved = [f"{' ' * 13}{self._ground_text(*item)}" for item in self.layout.ground]
        wide = LETTER * widest([*self.notes, *moved, *(self._shared_text(push) for push in self.layout.shared)]) + 0.3
        bottom = self.floor - 0.22 - (0.3 if self.layout.ground else 0.0) - 0.18 * len(self.notes)
        return left, max(right, left + wide), bottom, self.top

    @property
    def size(self) -> tuple[float, float]:
        """Width and height."""
        left, right, bottom, top = self.limits
        return right - left, top - bottom

    @property
    def notes(self) -> list[str]:
        """What is not drawn."""
        return self.layout.left_out

    # drawing

    @style()
    def draw(self, ax: Axes) -> Axes:
        """Draw everything."""
        left, right, bottom, top = self.limits
        ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
        ax.set_axis_off()
        if not self.beside:
            symbols.hatched(ax, left + 0.1, self.floor - _WALL, right - left - 0.2, _WALL)
        for item, lines, y in self.apart:
            self._draw_apart(ax, item, lines, y)
        for name in self.layout.row:
            self._draw_body(ax, name)
        for place, lanes in enumerate(self.lanes):
            self._draw_between(ax, place, lanes)
        for index, push in enumerate(self.layout.shared):
            self._draw_shared(ax, push, self.height + 0.14 + _SHARED * index)
        for index, (name, motion) in enumerate(self.layout.ground):
            y = self.floor - 0.32 - 0.25 * index
            symbols.arrow(ax, (left + 0.1, y), (left + 0.7, y), both=True)
            symbols.text(ax, left + 0.8, y, [self._ground_text(name, motion)], FORCE, ha="left", va="center")
        for index, note in enumerate(reversed(self.notes)):
            symbols.text(ax, left + 0.1, bottom + 0.06 + 0.18 * index, [note], ha="left", va="bottom")
        return ax

    def _draw_body(self, ax: Axes, name: str) -> None:
        x, width, height = self.starts[name], self.widths[name], self.height
        centre = x + width / 2.0
        if name == ELLIPSIS:
            ax.text(centre, height / 2.0, "\N{MIDLINE HORIZONTAL ELLIPSIS}", ha="center", va="center", fontsize=16)
            return
        symbols.box(ax, x, width, height, dashed=is_structure(self.members[name]))
        ax.text(centre, height / 2.0 + 0.06, name, ha="center", va="bottom", fontsize=10, weight="bold", color=INK)
        caption = "\n".join(self.captions[name])
        ax.text(centre, height / 2.0 + 0.02, caption, ha="center", va="top", fontsize=8, color=INK)
        self._draw_beside(ax, name) if self.beside else self._draw_below(ax, name)
        y = height + 0.16 + _SHARED * len(self.layout.shared)
        pushes = list(self._pushes(name))
        if pushes:
            symbols.arrow(ax, (centre - 0.35, y), (centre + 0.35, y))
            lines = [line for _, lines in pushes for line in lines]
            symbols.text(ax, centre, y + 0.08, lines, FORCE, va="bottom")

    def _pushes(self, name: str) -> Iterator[tuple[Push, list[str]]]:
        """Give what drives a body alone, with its text."""
        for push in self.layout.own.get(name, []):
            lines = excitation_lines(push.excitation)
            for place, weight in push.on.items():
                where = own_name(self.layout, place)
                source = push.name if push.name != place else ""
                times = f"{number_text(weight)} times" if weight != 1.0 else ""
                told = ", ".join(item for item in (source, times, f"at {where}" if where else "") if item)
                lines = [told, *lines] if told else lines
            yield push, lines

    def _draw_beside(self, ax: Axes, name: str) -> None:
        x, width = self.starts[name], self.widths[name]
        side = -1.0 if name == self.layout.row[0] else 1.0
        near = x if side < 0.0 else x + width
        far = near + side * _ANCHOR
        if not self.held[name]:
            return
        symbols.hatched(ax, far if side > 0.0 else far - _WALL, -0.2, _WALL, self.height + 0.4)
        heights = {"spring": 0.78 * self.height, "damper": 0.2 * self.height}
        for kind, _, lines in self.held[name]:
            y = heights[kind]
            _SYMBOLS[kind](ax, min(near, far), max(near, far), y)
            symbols.text(ax, (near + far) / 2.0, y - 0.13, lines)

    def _draw_below(self, ax: Axes, name: str) -> None:
        """Draw what holds a body to the floor, and its stops."""
        items = self.held[name]
        x, width = self.starts[name], self.widths[name]
        if not items:
            if is_structure(self.members[name]):
                symbols.line(ax, [x + width / 2.0] * 2, [self.floor, 0.0])
            return
        right_stop = any(kind == "gap" and link.second is WALL for kind, link, _ in items)
        far, near = x + 0.1, x + (0.55 * width if right_stop else width - 0.06)
        y, last = self.below, 0.0
        if any(kind != "gap" or link.first is WALL for kind, link, _ in items):
            symbols.hatched(ax, far - 0.1, self.floor, 0.1, self.below - self.floor - 0.1)
        if right_stop:
            symbols.hatched(ax, x + width, self.floor, 0.1, self.below - self.floor - 0.1)
        for kind, link, lines in items:
            if kind == "gap":
                at = y - 0.34
                stop = link.second is WALL
                ends = (near, x + width) if stop else (far, near)
                symbols.gap(ax, *ends, at, with_units(link.clearance, "m"))
                symbols.text(ax, x + width / 2.0, at - 0.15, lines, symbols.CONTACT)
            else:
                at = y - 0.22
                _SYMBOLS[kind](ax, far, near, at)
                symbols.text(ax, (near + far) / 2.0, at - 0.11, lines)
            y, last = y - _depth(kind, lines), at
        ax.plot([near, near], [last, 0.0], color=INK, lw=1.2)

    def _draw_between(self, ax: Axes, place: int, lanes: list[tuple[Link, list[str], float]]) -> None:
        """Draw the links between two neighbours, or of an end with a wall, one below the other."""
        if not lanes:
            return
        row = self.layout.row
        left = self.starts[row[place - 1]] + self.widths[row[place - 1]] if place else -_spacing(lanes)
        right = self.starts[row[place]] if place < len(row) else left + _spacing(lanes)
        for wall, x in ((place == 0, left - _WALL), (place == len(row), right)):
            if wall:
                symbols.hatched(ax, x, -0.1, _WALL, self.height + 0.2)
        y = 0.5 * (self.height + sum(height for *_, height in lanes))
        for item, lines, height in lanes:
            self._draw_link(ax, item, (left, right), y, lines)
            sides = (item.link.second, item.link.first) if item.backward else (item.link.first, item.link.second)
            for side, x, beyond, ha in zip(sides, (left, right), (-0.07, 0.07), ("right", "left"), strict=True):
                if isinstance(side, str) and (point := own_name(self.layout, side)):
                    at = y - (0.46 if isinstance(item.link, Contact) else 0.18)
                    symbols.dot(ax, x, at)
                    symbols.named(ax, x + beyond, at, point, ha)
            y -= height

    def _draw_link(self, ax: Axes, item: Link, ends: tuple[float, float], y: float, lines: list[str]) -> None:
        """Draw the symbol and the text of a link below a height."""
        link = item.link
        if isinstance(link, Contact):
            y -= 0.46
            draw = symbols.hook if item.backward else symbols.gap
            draw(ax, *ends, y, with_units(link.clearance, "m"))
            y -= 0.16
        else:
            y -= 0.12
            for kind in _symbols(link.law):
                _SYMBOLS[kind](ax, *ends, y - 0.06)
                y -= 0.22
        symbols.text(ax, sum(ends) / 2.0, y, lines, symbols.CONTACT if isinstance(link, Contact) else INK)

    def _draw_apart(self, ax: Axes, item: Link, lines: list[str], y: float) -> None:
        """Draw a link of bodies that are no neighbours, or of a combination, as a line below the row."""
        weights, plain = weights_of(item.link), is_difference(item.link)
        index = [one for one, *_ in self.apart].index(item)
        legs = []
        for name, weight in weights.items():
            node = self.layout.owners[name]
            legs.append((self.starts[node] + self.widths[node] * (0.2 + 0.15 * index), name, weight))
        same: dict[float, int] = {}
        for number, (x, name, weight) in enumerate(legs):
            same[x] = same.get(x, -1) + 1
            at = x + 0.3 * same[x]  # several points of one structure
            legs[number] = at, name, weight
            symbols.line(ax, [at, at], [y, 0.0], dashed=not plain)
            if point := own_name(self.layout, name):
                symbols.named(ax, at, 0.09, point, "center")
            if not plain:
                symbols.text(ax, at + 0.04, y + 0.03, [f"× {number_text(weight)}"], ha="left", va="bottom")
        middle, half, places = *self._free(sorted(x for x, *_ in legs)), sorted(x for x, *_ in legs)
        for some in ([places[0], middle - half], [middle + half, max(places[-1], middle + half)]):
            symbols.line(ax, some, [y, y], dashed=not plain)
        ends = (middle - half, middle + half)
        if isinstance(item.link, Contact):
            draw = symbols.hook if item.backward else symbols.gap
            draw(ax, *ends, y, with_units(item.link.clearance, "m"))
            symbols.line(ax, [ends[1]] * 2, [y - 0.12, y + 0.2])
            symbols.text(ax, middle, y - 0.16, lines, symbols.CONTACT)
        else:
            _SYMBOLS[_symbols(item.link.law)[0]](ax, *ends, y)
            symbols.text(ax, middle, y - 0.12, lines)

    def _free(self, places: list[float]) -> tuple[float, float]:
        """Return where there is room for a symbol on a line with legs, and half its width: between two bodies."""
        row, half = self.layout.row, 0.4
        if len(places) == 1:
            return places[0] + 0.7, half
        number = int(np.argmax(np.diff(places)))
        middle = 0.5 * (places[number] + places[number + 1])
        free = [0.5 * (self.starts[a] + self.widths[a] + self.starts[b]) for a, b in itertools.pairwise(row)]
        inside = [x for x in free if places[number] + half <= x <= places[number + 1] - half]
        return min(inside, key=lambda x: abs(x - middle), default=middle), half

    def _ground_text(self, name: str, motion: BaseMotion) -> str:
        on = f" of {', '.join(motion.on)}" if motion.on else ""
        return f"{name}: base motion{on}, {excitation_lines(motion.acceleration)[0]}"

    def _shared_text(self, push: Push) -> str:
        return f"{push.name}: {', '.join(excitation_lines(push.excitation))}"

    def _draw_shared(self, ax: Axes, push: Push, y: float) -> None:
        """Draw a source of several bodies: a line above them with an arrow to each."""
        places = []
        for name, weight in push.on.items():
            node = self.layout.owners[name]
            if node not in self.starts:
                continue
            x = self.starts[node] + self.widths[node] * 0.85
            places.append(x)
            symbols.arrow(ax, (x, y + 0.12), (x, self.height + 0.01))
            point = own_name(self.layout, name)
            written = f"{point} × {number_text(weight)}" if point else f"× {number_text(weight)}"
            symbols.text(ax, x - 0.05, y + 0.1, [written], FORCE, ha="right")
        symbols.line(ax, [min(places), max(places)], [y + 0.12] * 2, FORCE)
        symbols.text(ax, min(places), y + 0.14, [self._shared_text(push)], FORCE, ha="left", va="bottom")


def _spacing(lanes: list[tuple[Link, list[str], float]]) -> float:
    """Return the distance between two bodies, or of one to a wall."""
    return min(max(_GAP, LETTER * max((widest(lines) for _, lines, _ in lanes), default=0) + 0.16), _WIDEST)


_SYMBOLS = {"spring": symbols.spring, "damper": symbols.damper, "element": symbols.element}


def _symbols(law: Any) -> list[str]:
    """Return the symbols of a coupling."""
    if not isinstance(law, LinearCoupling):
        return ["element"]
    return [kind for kind, value in (("spring", law.stiffness), ("damper", law.damping)) if value] or ["element"]


def _depth(kind: str, lines: list[str]) -> float:
    """Return the height that a symbol below a body takes with its text."""
    return (0.55 if kind == "gap" else _PITCH) + LINE * max(0, len(lines) - (kind != "gap"))
