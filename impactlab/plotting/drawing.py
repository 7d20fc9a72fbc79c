"""Drawings of networks: bodies in a row with springs, dampers and contacts."""

from __future__ import annotations

import itertools
import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

import impactlab
from impactlab.components.component import Component
from impactlab.components.contact import Contact
from impactlab.components.excitation import Excitation
from impactlab.components.oscillator import Oscillator
from impactlab.components.sides import WALL
from impactlab.errors import InvalidInput
from impactlab.plotting.style import COLORS, number_text, style, units_text

BODIES = 8
"""Largest number of bodies that are drawn."""


# Lengths are in inches; the bodies move to the left and to the right.

_WIDTH, _HEIGHT = 1.15, 0.85  # of a body
_GAP = 0.95  # between two bodies
_ANCHOR = 1.35  # from a body to its support beside it
_BUMPER = 0.22
_BELOW = 1.35  # from the lower side of a body to the floor, where supports stand on it
_INK, _PALE, _GROUND = "#222222", "#E8EEF4", "#888888"


def draw_network(network: impactlab.Network, ax: Axes | None = None) -> Figure:
    """Draw the bodies of a network in a row, with their springs, dampers, contacts and excitations.

    Parameters
    ----------
    network : Network
        Drawn are the first eight bodies and their contacts with walls and neighbours;
        what is not drawn is named below, as are couplings and contacts of combinations.
    ax : Axes, optional
        Where to draw; a figure of the right size is made by default.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InvalidInput
        If something else than a network is given.
    """
    if not isinstance(network, impactlab.Network):
        raise InvalidInput(f"draw_network takes an il.Network, not {network!r}.")
    with style():
        row = _in_a_row(network)
        shown = row[:BODIES]
        drawn = _drawable(network, shown)
        left, right = (any(contact.first is WALL for contact in drawn.values()),
                       any(contact.second is WALL for contact in drawn.values()))  # fmt: skip
        beside = not left and (len(shown) == 1 or (len(shown) == 2 and not right))
        start = {name: index * (_WIDTH + _GAP) for index, name in enumerate(shown)}
        low = -_ANCHOR - 0.3 if beside else -_GAP - 0.3 if left else -0.5
        high = start[shown[-1]] + _WIDTH
        high += _ANCHOR + 0.3 if beside and len(shown) == 2 else _GAP + 0.3 if right else 0.3
        bottom, top = (-0.55 if beside else -_BELOW - 0.4), _HEIGHT + 0.75
        notes = _notes(network, row, drawn)
        bottom -= 0.2 * len(notes)
        if ax is None:
            figure = Figure(figsize=(high - low, top - bottom), layout=None)
            figure.set_layout_engine("none")
            ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        ax.set(xlim=(low, high), ylim=(bottom, top), aspect="equal")
        ax.set_axis_off()
        for index, name in enumerate(shown):
            side = 0 if not beside else -1 if index == 0 else 1
            _draw_body(ax, start[name], name, network.oscillators[name], side)
            _draw_excitations(ax, start[name], name, network.excitations_of(name))
        if not beside:
            _hatched(ax, low + 0.1, -_BELOW - 0.12, high - low - 0.2, 0.12)
        for contact in drawn.values():
            _draw_contact(ax, contact, start)
        for index, note in enumerate(reversed(notes)):
            ax.text(low + 0.1, bottom + 0.1 + 0.2 * index, note, fontsize=7.5, color=_INK)
        root = ax.get_figure(root=True)
        assert root is not None
        return root


def _in_a_row(network: impactlab.Network) -> list[str]:
    """Return the names of the bodies so that contacts join neighbours, from left to right, where they can."""
    follower: dict[str, str] = {}
    for contact in network.contacts.values():
        if isinstance(contact.first, str) and isinstance(contact.second, str):
            follower.setdefault(contact.first, contact.second)
    heads = [name for name in network.oscillators if name not in follower.values()]
    row: list[str] = []
    for name in (*heads, *network.oscillators):
        here: str | None = name
        while here is not None and here not in row:
            row.append(here)
            here = follower.get(here)
    return row


def _drawable(network: impactlab.Network, shown: list[str]) -> dict[str, Contact]:
    """Return one contact for each place between neighbours, and between the ends and walls."""
    ends = [WALL, *shown, WALL]
    places = list(itertools.pairwise(ends))
    drawn: dict[str, Contact] = {}
    for name, contact in network.contacts.items():
        place = (contact.first, contact.second)
        if place in places:
            places.remove(place)
            drawn[name] = contact
    return drawn


def _notes(network: impactlab.Network, row: list[str], drawn: dict[str, Contact]) -> list[str]:
    notes = []
    if len(row) > BODIES:
        notes.append(f"… and {len(row) - BODIES} more bodies, {len(network.contacts) - len(drawn)} more contacts")
    else:
        hidden = [
            f"{name} ({contact.first}, {contact.second})"
            for name, contact in network.named_contacts.items()
            if name not in drawn
        ]
        if hidden:
            notes.append(f"Not drawn: {', '.join(hidden)}")
    if network.couplings:
        notes.append(f"Couplings, not drawn: {', '.join(list(network.couplings)[:BODIES])}")
    return notes


def _draw_body(ax: Axes, x: float, name: str, body: Oscillator, side: int) -> None:
    box = FancyBboxPatch(
        (x, 0.0), _WIDTH, _HEIGHT, boxstyle="round,pad=0,rounding_size=0.06", facecolor=_PALE, edgecolor=_INK
    )
    ax.add_patch(box)
    extra = [line for line in _fields(body) if line.split(" ")[0] not in ("mass", "damping", "stiffness")]
    lines = [rf"$m$ = {number_text(body.mass)} kg", *extra]
    centre = x + _WIDTH / 2.0
    ax.text(centre, 0.62 * _HEIGHT, name, ha="center", va="bottom", fontsize=10, weight="bold", color=_INK)
    ax.text(centre, 0.52 * _HEIGHT, "\n".join(lines), ha="center", va="top", fontsize=8, color=_INK)
    parts = [
        (_spring, rf"$k$ = {number_text(body.stiffness)} {units_text('N m-1')}", body.stiffness),
        (_damper, rf"$c$ = {number_text(body.damping)} {units_text('N s m-1')}", body.damping),
    ]
    if not (body.stiffness or body.damping):
        return
    if side:
        near = x if side < 0 else x + _WIDTH
        far = near + side * _ANCHOR
        _hatched(ax, far if side > 0 else far - 0.12, -0.2, 0.12, _HEIGHT + 0.4)
        heights = (0.78 * _HEIGHT, 0.2 * _HEIGHT)
    else:
        far, near = x + 0.1, x + _WIDTH - 0.06
        ax.plot([near, near], [-0.95, 0.0], color=_INK, lw=1.2)
        _hatched(ax, far - 0.1, -_BELOW, 0.1, _BELOW - 0.2)
        heights = (-0.42, -0.95)
    for (draw, text, value), height in zip(parts, heights, strict=True):
        if value:
            draw(ax, min(near, far), max(near, far), height)
            ax.text((near + far) / 2.0, height - 0.13, text, ha="center", va="top", fontsize=7.5, color=_INK)


def _fields(component: Component) -> list[str]:
    """Return the fields of a component that are numbers, as text with units."""
    lines = []
    for name in component.field_names():
        value = getattr(component, name)
        if isinstance(value, float | int) and not isinstance(value, bool):
            units = component.units(name)
            shown = "" if units == "1" else f" {units_text(units)}"
            lines.append(f"{name.replace('_', ' ')} = {number_text(value)}{shown}")
    return lines


def _spring(ax: Axes, left: float, right: float, y: float) -> None:
    lead = 0.22 * (right - left)
    turns = 6
    x = np.linspace(left + lead, right - lead, 2 * turns + 1)
    zigzag = np.where(np.arange(2 * turns + 1) % 2, 0.085, -0.085)
    zigzag[[0, -1]] = 0.0
    ax.plot([left, *x, right], [y, *(y + zigzag), y], color=_INK, lw=1.1, solid_joinstyle="round")


def _damper(ax: Axes, left: float, right: float, y: float) -> None:
    middle, half = (left + right) / 2.0, 0.16
    ax.plot([left, middle - half], [y, y], color=_INK, lw=1.1)
    pot = (
        [middle + half, middle - half, middle - half, middle + half],
        [y + 0.09, y + 0.09, y - 0.09, y - 0.09],
    )
    ax.plot(*pot, color=_INK, lw=1.1)
    ax.plot([middle + 0.04, middle + 0.04], [y - 0.07, y + 0.07], color=_INK, lw=2.0)
    ax.plot([middle + 0.04, right], [y, y], color=_INK, lw=1.1)


def _hatched(ax: Axes, x: float, y: float, width: float, height: float) -> None:
    ax.add_patch(Rectangle((x, y), width, height, facecolor="white", edgecolor=_GROUND, hatch="//////", lw=0.8))


def _draw_excitations(ax: Axes, x: float, body: str, excitations: list[tuple[str, Excitation, float]]) -> None:
    if not excitations:
        return
    y = _HEIGHT + 0.16
    ax.annotate(
        "",
        (x + 0.8 * _WIDTH, y),
        (x + 0.2 * _WIDTH, y),
        arrowprops={"arrowstyle": "-|>", "color": COLORS[1], "lw": 1.6, "shrinkA": 0, "shrinkB": 0},
    )
    lines = []
    for source, excitation, weight in excitations:
        if source != body:
            lines.append(f"{source}: {number_text(weight)} times")
        lines.append(_words(excitation))
        density = getattr(excitation, "spectral_density", None)
        if isinstance(density, float):
            lines.append(rf"$S$ = {number_text(density)} {units_text(excitation.units('spectral_density'))}")
    ax.text(x + _WIDTH / 2.0, y + 0.08, "\n".join(lines), ha="center", va="bottom", fontsize=7.5, color=COLORS[1])


def _draw_contact(ax: Axes, contact: Contact, start: dict[str, float]) -> None:
    """Draw the gap: the first body's bumper, the distance to the second, and the law."""
    if isinstance(contact.first, str):
        left = start[contact.first] + _WIDTH
        right = start[contact.second] if isinstance(contact.second, str) else left + _GAP
    else:
        right = start[str(contact.second)]
        left = right - _GAP
    for side, edge in ((contact.first, left - 0.12), (contact.second, right)):
        if side is WALL:
            _hatched(ax, edge, -0.2, 0.12, _HEIGHT + 0.4)
    middle, color = _HEIGHT / 2.0, COLORS[0]
    angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, 40)
    bumper, height = _BUMPER, 0.26
    ax.fill(left + bumper * np.cos(angle), middle + height * np.sin(angle), facecolor=color, alpha=0.85, lw=0)
    tip = left + bumper
    ax.plot([tip, tip], [middle, _HEIGHT], color=_GROUND, lw=0.7)
    arrows = {
        "arrowstyle": "<|-|>",
        "color": _INK,
        "lw": 0.8,
        "shrinkA": 0,
        "shrinkB": 0,
        "mutation_scale": 6,
    }
    ax.annotate("", (tip, _HEIGHT - 0.06), (right, _HEIGHT - 0.06), arrowprops=arrows)
    clearance = f"{number_text(contact.clearance)} m"
    ax.text((tip + right) / 2.0, _HEIGHT, clearance, ha="center", va="bottom", fontsize=7.5, color=_INK)
    fields = _fields(contact.law)
    if len(fields) == 1:  # the name of the law says what it is
        fields = [fields[0].split(" = ")[1]]
    law = "\n".join([_words(contact.law), *fields])
    ax.text((left + right) / 2.0, -0.03, law, ha="center", va="top", fontsize=7.5, color=color)


def _words(component: Component) -> str:
    """Return the name of a class as words."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", type(component).__name__).capitalize()
