"""Where the members of a network are in its drawing: bodies in a row, what lies between them, below and above."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import impactlab
from impactlab.components.component import Component
from impactlab.components.contact import Contact
from impactlab.components.excitation import BaseMotion, Excitation, Source
from impactlab.components.sides import WALL, Combination, is_round, named_by
from impactlab.components.structure import Structure
from impactlab.plotting.style import name_text

BODIES = 8
"""Largest number of bodies that are drawn."""

MOST_DRAWN = 4
"""Contacts and couplings of bodies apart, contacts in a plane, and sources of several, that are drawn."""

ELLIPSIS = ""
"""In the place of the bodies that are left out."""


class Link(NamedTuple):
    """A contact or a coupling that is drawn."""

    name: str
    link: Any
    backward: bool = False  # whether its first side is on the right


class Push(NamedTuple):
    """An excitation that is drawn, with weights by the name of what it acts on."""

    name: str
    excitation: Excitation
    on: dict[str, float]


class Layout(NamedTuple):
    """What is drawn where."""

    row: list[str]  # bodies and structures from left to right, and an ellipsis
    owners: dict[str, str]  # the body or structure of each name that a link or an excitation may use
    between: list[list[Link]]  # to the left of the first, between neighbours, to the right of the last
    apart: list[Link]  # of bodies that are not neighbours, and of combinations
    planes: list[Link]  # that act in a plane, right of the row
    stops: dict[str, list[Link]]  # with walls, below a body
    own: dict[str, list[Push]]  # what drives one body or structure
    shared: list[Push]  # what drives several
    ground: list[tuple[str, BaseMotion]]
    left_out: list[str]

    @property
    def links(self) -> int:
        """Number of contacts and couplings that are drawn."""
        return sum(map(len, (*self.between, self.apart, self.planes, *self.stops.values())))


def layout_of(network: impactlab.Network) -> Layout:
    """Arrange the members of a network."""
    given: Mapping[str, Mapping[str, Any]] = network.given()
    owners = {name: name for name in given["oscillators"]}
    for name, structure in network.structures.items():
        owners |= {f"{name}.{own}": name for own in (*structure.bodies(), *structure.weights())}
    row = _row(given, owners)
    shown = row if len(row) <= BODIES else [*row[: BODIES // 2], ELLIPSIS, *row[len(row) + 1 - BODIES // 2 :]]
    layout = Layout(shown, owners, [[] for _ in range(len(shown) + 1)], [], [], {}, {}, [], [], [])
    hidden = {"contacts": 0, "couplings": 0}
    for family in hidden:
        for name, link in given[family].items():
            hidden[family] += not _placed(layout, Link(name, link))
    for name, item in given["excitations"].items():
        _excited(layout, name, item)
    if len(row) > BODIES:
        parts = [f"{len(row) + 1 - len(shown)} more bodies"]
        parts += [f"{count} more {family}" for family, count in hidden.items() if count]
        layout.left_out.insert(0, f"… and {', '.join(parts)}")
    return layout


def _row(given: Mapping[str, Mapping[str, Any]], owners: dict[str, str]) -> list[str]:
    """Return the names of the bodies and structures from left to right."""
    links = (*given["contacts"].values(), *given["couplings"].values())
    plain = [link for link in links if isinstance(link.first, str) and isinstance(link.second, str)]
    return in_a_row([(owners[link.first], owners[link.second]) for link in plain], list(given["oscillators"]))


def in_a_row(pairs: Iterable[tuple[str, str]], names: list[str]) -> list[str]:
    """Return names so that the two of a pair are neighbours, from left to right, where they can be."""
    follower: dict[str, str] = {}
    followed: set[str] = set()
    for first, second in pairs:
        if first != second and first not in follower and second not in followed and follower.get(second) != first:
            follower[first] = second
            followed.add(second)
    row: dict[str, None] = {}
    for name in (*(name for name in names if name not in followed), *names):
        here: str | None = name
        while here is not None and here not in row:
            row[here] = None
            here = follower.get(here)
    return list(row)


def _placed(layout: Layout, item: Link) -> bool:
    """Put a contact or a coupling where it is drawn; whether there is such a place."""
    link, row = item.link, layout.row
    nodes = list(dict.fromkeys(layout.owners[name] for name in named_by(link)))
    if not all(node in row for node in nodes):
        return False
    if is_round(link):
        return _added(layout, layout.planes, item)
    combined = isinstance(link.first, Combination) or isinstance(link.second, Combination)
    if not combined and WALL in (link.first, link.second):
        right = link.second is WALL
        contact, place = isinstance(link, Contact), row.index(nodes[0])
        if contact and place == (len(row) - 1 if right else 0):
            layout.between[-1 if right else 0].append(item)
        else:
            layout.stops.setdefault(nodes[0], []).append(item)
        return True
    places = [row.index(node) for node in nodes]
    if not combined and len(nodes) == 2 and abs(places[0] - places[1]) == 1:
        layout.between[max(places)].append(item._replace(backward=places[0] > places[1]))
        return True
    backward = not combined and len(nodes) == 2 and places[0] > places[1]
    return _added(layout, layout.apart, item._replace(backward=backward))


def _added(layout: Layout, some: list[Link], item: Link) -> bool:
    """Put a link beside others of its kind; whether it is drawn, or told not to be."""
    if len(some) < MOST_DRAWN:
        some.append(item)
        return True
    layout.left_out.append(name_text(f"Not drawn: {item.name}"))
    return len(layout.row) <= BODIES


def _excited(layout: Layout, name: str, item: Excitation | Source | BaseMotion) -> None:
    """Put an excitation where it is drawn, if what it acts on is."""
    if isinstance(item, BaseMotion):
        layout.ground.append((name, item))
        return
    on = dict(item.on) if isinstance(item, Source) else {name: 1.0}
    push = Push(name, item.excitation if isinstance(item, Source) else item, on)
    nodes = [node for node in dict.fromkeys(layout.owners[place] for place in on) if node in layout.row]
    if len(nodes) == 1:
        layout.own.setdefault(nodes[0], []).append(push)
    elif nodes and len(layout.shared) < MOST_DRAWN:
        layout.shared.append(push)
    elif nodes:
        layout.left_out.append(name_text(f"Not drawn: {name}"))


def own_name(layout: Layout, place: str) -> str:
    """Return the name of a point within its structure; nothing of a body."""
    return place.removeprefix(f"{layout.owners[place]}.") if layout.owners[place] != place else ""


def is_structure(member: Component | None) -> bool:
    """Whether a member of the row is a structure."""
    return isinstance(member, Structure)
