"""The measures of drawings of networks: where everything is, and how large, in inches."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np

import impactlab
from impactlab.components.contact import Contact, RoundContact
from impactlab.components.coupling import LinearCoupling
from impactlab.components.excitation import BaseMotion
from impactlab.components.sides import is_difference
from impactlab.errors import InvalidInput
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
from impactlab.plotting.style import name_text, number_text
from impactlab.plotting.symbols import LETTER, LINE

# Lengths are in inches; the bodies move to the left and to the right.

_WIDTH, _HEIGHT = 1.15, 0.85  # of a body, at least
_GAP, _WIDEST = 0.95, 1.7  # between two bodies
ANCHOR = 1.35  # from a body to its support beside it
SHARED = 0.42  # height of a source of several bodies
GROUND = 0.25  # height of a motion of the ground
THICK = 0.12  # of walls and the floor
ROUND = 0.9  # of a clearance in a plane


class Measures:
    """A network with the measures of its drawing."""

    def __init__(self, network: impactlab.Network) -> None:
        self.network, self.layout = network, layout_of(network)
        self.members = network.given()["oscillators"]
        self.several = self.layout.links > 1
        self.captions = {name: self._caption(name) for name in self.layout.row}

    @classmethod
    def of(cls, network: Any) -> Measures:
        """Return the measures of a network; refuse anything else."""
        if not isinstance(network, impactlab.Network):
            raise InvalidInput(f"A drawing is of an il.Network, not of {network!r}.")
        return cls(network)

    def _caption(self, name: str) -> list[str]:
        """Return the text on a body, below its name."""
        if name == ELLIPSIS:
            return []
        body: Any = self.members[name]
        if is_structure(body):
            return structure_lines(body)
        if body.moves_as_given:
            return ["moves as given"]
        own = numbers(body, ("mass", "damping", "stiffness", *body.state_names()))
        return [rf"$m$ = {with_units(body.mass, 'kg')}", *own]

    @cached_property
    def lanes(self) -> list[list[tuple[Link, list[str], float]]]:
        """What lies in each place between bodies: links, their text and height."""
        return [[self._lane(link) for link in place] for place in self.layout.between]

    def _lane(self, item: Link) -> tuple[Link, list[str], float]:
        lines = law_lines(item.name if self.several else "", item.link.law)
        symbol = 0.62 if isinstance(item.link, Contact) else 0.12 + 0.22 * len(symbols_of(item.link.law))
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
        ends = self.layout.between[0] or self.layout.between[-1] or self.layout.apart or self.layout.planes
        return len(row) <= 2 and not held and not ends

    @cached_property
    def starts(self) -> dict[str, float]:
        """Left sides of the bodies."""
        result, x = {}, 0.0
        for name, place in zip(self.layout.row, self.lanes[1:], strict=True):
            result[name] = x
            x += self.widths[name] + (spacing(place) if place or ELLIPSIS not in self.layout.row else 0.4)
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
        sides = name_text(f"{side_text(item.link.first)} with {side_text(item.link.second)}")
        clearance = f", {with_units(item.link.clearance, 'm')}" if isinstance(item.link, Contact) else ""
        return [lines[0], f"{sides}{clearance}", *lines[1:]]

    @cached_property
    def planes(self) -> list[tuple[Link, list[str], float]]:
        """Contacts in a plane, right of the row, with their text and width."""
        result = []
        for item in self.layout.planes:
            contact: RoundContact = item.link
            first, second = side_text(contact.first), side_text(contact.second)
            name, *law = law_lines(item.name, contact.law)
            lines = [name, name_text(f"{first} in {second}"), f"clearance = {with_units(contact.clearance, 'm')}"]
            lines += [*law, *numbers(contact, ("clearance", "friction_velocity"))]
            result.append((item, lines, max(ROUND, LETTER * widest(lines)) + 0.2))
        return result

    @cached_property
    def held(self) -> dict[str, list[tuple[str, Any, list[str]]]]:
        """What is below each body: a symbol, the link of a wall if there is one, and its text."""
        result: dict[str, list[tuple[str, Any, list[str]]]] = {}
        for name in self.layout.row:
            found = result.setdefault(name, [])
            if name == ELLIPSIS:
                continue
            body: Any = self.members[name]
            if not (is_structure(body) or body.moves_as_given):
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
                kinds = ["gap"] if isinstance(item.link, Contact) else symbols_of(item.link.law)
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
        depths = [sum(depth(kind, lines) for kind, _, lines in items) for items in self.held.values()]
        round_texts = (ROUND - self.height + LINE * len(lines) for _, lines, _ in self.planes)
        return min(self.below - max(0.35, *depths), *(-text for text in round_texts), 0.0) - 0.1

    @cached_property
    def top(self) -> float:
        """Height of what is written above the bodies."""
        own = [sum(len(lines) for _, lines in self.pushes(name)) for name in self.layout.row]
        return self.height + SHARED * len(self.layout.shared) + (0.32 + LINE * max(own) if any(own) else 0.2)

    @cached_property
    def limits(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper end of the drawing."""
        row = self.layout.row
        held = [self.beside and bool(self.held[name]) for name in row]
        first, last = (spacing(place) + 0.3 if place else 0.3 for place in (self.lanes[0], self.lanes[-1]))
        left = -ANCHOR - 0.3 if held[0] else -first
        right = self.starts[row[-1]] + self.widths[row[-1]]
        right += ANCHOR + 0.3 if held[-1] and len(row) == 2 else last
        right += sum(width for *_, width in self.planes)
        moved = [f"{' ' * 13}{self.ground_text(*item)}" for item in self.layout.ground]
        wide = LETTER * widest([*self.notes, *moved, *(self.shared_text(push) for push in self.layout.shared)]) + 0.3
        ground = 0.05 + GROUND * len(moved) if moved else 0.0
        bottom = self.floor - 0.22 - ground - 0.18 * len(self.notes)
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

    def pushes(self, name: str) -> Iterator[tuple[Push, list[str]]]:
        """Give what drives a body alone, with its text."""
        for push in self.layout.own.get(name, []):
            lines = excitation_lines(push.excitation)
            for place, weight in push.on.items():
                where = own_name(self.layout, place)
                source = push.name if push.name != place else ""
                times = f"{number_text(weight)} times" if weight != 1.0 else ""
                told = ", ".join(item for item in (source, times, f"at {where}" if where else "") if item)
                lines = [name_text(told), *lines] if told else lines
            yield push, lines

    def free(self, places: list[float]) -> tuple[float, float]:
        """Return where there is room for a symbol on a line with legs, and half its width: between two bodies."""
        row, half = self.layout.row, 0.4
        if len(places) == 1:
            return places[0] + 0.7, half
        number = int(np.argmax(np.diff(places)))
        middle = 0.5 * (places[number] + places[number + 1])
        free = [0.5 * (self.starts[a] + self.widths[a] + self.starts[b]) for a, b in itertools.pairwise(row)]
        inside = [x for x in free if places[number] + half <= x <= places[number + 1] - half]
        return min(inside, key=lambda x: abs(x - middle), default=middle), half

    def ground_text(self, name: str, motion: BaseMotion) -> str:
        """Return the text beside a motion of the ground."""
        factors = {place: motion.factor(place) for place in motion.on}
        told = [place if factor == 1.0 else f"{number_text(factor)} {place}" for place, factor in factors.items()]
        on = f" of {name_text(', '.join(told))}" if told else ""
        return f"{name_text(name)}: base motion{on}, {excitation_lines(motion.acceleration)[0]}"

    def shared_text(self, push: Push) -> str:
        """Return what is written at a source of several bodies."""
        return f"{name_text(push.name)}: {', '.join(excitation_lines(push.excitation))}"


def spacing(lanes: list[tuple[Link, list[str], float]]) -> float:
    """Return the distance between two bodies, or of one to a wall."""
    return min(max(_GAP, LETTER * max((widest(lines) for _, lines, _ in lanes), default=0) + 0.16), _WIDEST)


def symbols_of(law: Any) -> list[str]:
    """Return the symbols of a coupling."""
    if not isinstance(law, LinearCoupling):
        return ["element"]
    return [kind for kind, value in (("spring", law.stiffness), ("damper", law.damping)) if value] or ["element"]


def depth(kind: str, lines: list[str]) -> float:
    """Return the height that a symbol below a body takes with its text."""
    # without text, the next symbol below is 0.4 away
    return (0.55 if kind == "gap" else 0.4) + LINE * max(0, len(lines) - (kind != "gap"))
