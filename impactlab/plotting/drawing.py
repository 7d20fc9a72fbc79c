"""Drawings of networks: bodies in a row with springs, dampers, contacts, couplings and excitations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import impactlab
from impactlab.components.contact import Contact
from impactlab.components.sides import WALL, is_difference, weights_of
from impactlab.inputs import checked
from impactlab.plotting import symbols
from impactlab.plotting.captions import with_units
from impactlab.plotting.layout import ELLIPSIS, Link, Push, is_structure, own_name
from impactlab.plotting.measures import ANCHOR, GROUND, ROUND, SHARED, THICK, Measures, depth, spacing, symbols_of
from impactlab.plotting.style import axes_of, name_text, number_text, style
from impactlab.plotting.symbols import FORCE, INK

_SYMBOLS = {"spring": symbols.spring, "damper": symbols.damper, "element": symbols.element}


def draw_network(network: impactlab.Network, ax: Axes | None = None) -> Figure:
    """Draw a network and return its figure, which is none of pyplot; see :func:`network`."""
    measures = Measures.of(network)
    if ax is None:
        figure = Figure(figsize=measures.size, layout=None)
        figure.set_layout_engine("none")
        ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    root = _draw(ax, measures).get_figure(root=True)
    assert root is not None
    return root


@checked
def network(network: impactlab.Network, ax: Axes | None = None) -> Axes:
    """Draw a network: bodies in a row with springs, dampers, contacts, couplings and excitations.

    Structures are dashed boxes on which the points that are used have their names. A hook is a contact that closes
    when its bodies part, a disc in a circle one that acts in a plane. What joins bodies that are not neighbours, or
    weighted sums of them, lies below the row; of a long chain the first and the last bodies are drawn. What is not
    drawn is named.

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

    Examples
    --------
    >>> axes = il.plot.network(network)
    """
    measures = Measures.of(network)
    if ax is None:
        ax = axes_of(None, measures.size)
        ax.figure.set_layout_engine("none")  # type: ignore[union-attr]
        ax.set_position((0.0, 0.0, 1.0, 1.0))
    return _draw(axes_of(ax), measures)


@style()
def _draw(ax: Axes, measures: Measures) -> Axes:
    """Draw everything."""
    left, right, bottom, top = measures.limits
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    ax.set_axis_off()
    if not measures.beside:
        symbols.hatched(ax, left + 0.1, measures.floor - THICK, right - left - 0.2, THICK)
    for item, lines, y in measures.apart:
        _draw_apart(ax, measures, item, lines, y)
    for name in measures.layout.row:
        _draw_body(ax, measures, name)
    for place, lanes in enumerate(measures.lanes):
        _draw_between(ax, measures, place, lanes)
    x = right - sum(width for *_, width in measures.planes)
    for item, lines, width in measures.planes:
        middle, y = x + width / 2.0, measures.height - ROUND / 2.0
        symbols.rim(ax, middle, y, ROUND / 2.0, item.link)
        symbols.text(ax, middle, y - ROUND / 2.0 - 0.05, lines, symbols.CONTACT)
        x += width
    for index, push in enumerate(measures.layout.shared):
        _draw_shared(ax, measures, push, measures.height + 0.14 + SHARED * index)
    for index, (name, motion) in enumerate(measures.layout.ground):
        y = measures.floor - 0.32 - GROUND * index
        symbols.arrow(ax, (left + 0.1, y), (left + 0.7, y), both=True)
        symbols.text(ax, left + 0.8, y, [measures.ground_text(name, motion)], FORCE, ha="left", va="center")
    for index, note in enumerate(reversed(measures.notes)):
        symbols.text(ax, left + 0.1, bottom + 0.06 + 0.18 * index, [note], ha="left", va="bottom")
    _shrink(ax, measures)
    return ax


def _shrink(ax: Axes, measures: Measures) -> None:
    """Make the letters as small as the drawing is, where axes that are given are smaller than it."""
    root = ax.get_figure(root=True)
    assert root is not None
    inches = np.array(ax.get_window_extent().size) / root.dpi
    scale = min(1.0, *(inches / measures.size))
    for text in ax.texts:
        text.set_fontsize(scale * text.get_fontsize())


def _draw_body(ax: Axes, measures: Measures, name: str) -> None:
    x, width, height = measures.starts[name], measures.widths[name], measures.height
    centre = x + width / 2.0
    if name == ELLIPSIS:
        ax.text(centre, height / 2.0, "\N{MIDLINE HORIZONTAL ELLIPSIS}", ha="center", va="center", fontsize=16)
        return
    symbols.box(ax, x, width, height, dashed=is_structure(measures.members[name]))
    ax.text(
        centre, height / 2.0 + 0.06, name_text(name), ha="center", va="bottom", fontsize=10, weight="bold", color=INK
    )
    caption = "\n".join(measures.captions[name])
    ax.text(centre, height / 2.0 + 0.02, caption, ha="center", va="top", fontsize=8, color=INK)
    _draw_beside(ax, measures, name) if measures.beside else _draw_below(ax, measures, name)
    y = height + 0.16 + SHARED * len(measures.layout.shared)
    pushes = list(measures.pushes(name))
    if pushes:
        symbols.arrow(ax, (centre - 0.35, y), (centre + 0.35, y))
        lines = [line for _, lines in pushes for line in lines]
        symbols.text(ax, centre, y + 0.08, lines, FORCE, va="bottom")


def _draw_beside(ax: Axes, measures: Measures, name: str) -> None:
    x, width = measures.starts[name], measures.widths[name]
    side = -1.0 if name == measures.layout.row[0] else 1.0
    near = x if side < 0.0 else x + width
    far = near + side * ANCHOR
    if not measures.held[name]:
        return
    symbols.hatched(ax, far if side > 0.0 else far - THICK, -0.2, THICK, measures.height + 0.4)
    heights = {"spring": 0.78 * measures.height, "damper": 0.2 * measures.height}
    for kind, _, lines in measures.held[name]:
        y = heights[kind]
        _SYMBOLS[kind](ax, min(near, far), max(near, far), y)
        symbols.text(ax, (near + far) / 2.0, y - 0.13, lines)


def _draw_below(ax: Axes, measures: Measures, name: str) -> None:
    """Draw what holds a body to the floor, and its stops."""
    items = measures.held[name]
    x, width = measures.starts[name], measures.widths[name]
    if not items:
        if is_structure(measures.members[name]):
            symbols.line(ax, [x + width / 2.0] * 2, [measures.floor, 0.0])
        return
    right_stop = any(kind == "gap" and link.second is WALL for kind, link, _ in items)
    far, near = x + 0.1, x + (0.55 * width if right_stop else width - 0.06)
    y, last = measures.below, 0.0
    if any(kind != "gap" or link.first is WALL for kind, link, _ in items):
        symbols.hatched(ax, far - 0.1, measures.floor, 0.1, measures.below - measures.floor - 0.1)
    if right_stop:
        symbols.hatched(ax, x + width, measures.floor, 0.1, measures.below - measures.floor - 0.1)
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
        y, last = y - depth(kind, lines), at
    ax.plot([near, near], [last, 0.0], color=INK, lw=1.2)


def _draw_between(ax: Axes, measures: Measures, place: int, lanes: list[tuple[Link, list[str], float]]) -> None:
    """Draw the links between two neighbours, or of an end with a wall, one below the other."""
    if not lanes:
        return
    row = measures.layout.row
    left = measures.starts[row[place - 1]] + measures.widths[row[place - 1]] if place else -spacing(lanes)
    right = measures.starts[row[place]] if place < len(row) else left + spacing(lanes)
    for wall, x in ((place == 0, left - THICK), (place == len(row), right)):
        if wall:
            symbols.hatched(ax, x, -0.1, THICK, measures.height + 0.2)
    y = 0.5 * (measures.height + sum(height for *_, height in lanes))
    for item, lines, height in lanes:
        _draw_link(ax, measures, item, (left, right), y, lines)
        sides = (item.link.second, item.link.first) if item.backward else (item.link.first, item.link.second)
        for side, x, beyond, ha in zip(sides, (left, right), (-0.07, 0.07), ("right", "left"), strict=True):
            if isinstance(side, str) and (point := own_name(measures.layout, side)):
                at = y - (0.46 if isinstance(item.link, Contact) else 0.18)
                symbols.dot(ax, x, at)
                symbols.write_name(ax, x + beyond, at, point, ha)
        y -= height


def _draw_link(ax: Axes, measures: Measures, item: Link, ends: tuple[float, float], y: float, lines: list[str]) -> None:
    """Draw the symbol and the text of a link below a height."""
    link = item.link
    if isinstance(link, Contact):
        y -= 0.46
        draw = symbols.hook if item.backward else symbols.gap
        draw(ax, *ends, y, with_units(link.clearance, "m"))
        y -= 0.16
    else:
        y -= 0.12
        for kind in symbols_of(link.law):
            _SYMBOLS[kind](ax, *ends, y - 0.06)
            y -= 0.22
    symbols.text(ax, sum(ends) / 2.0, y, lines, symbols.CONTACT if isinstance(link, Contact) else INK)


def _draw_apart(ax: Axes, measures: Measures, item: Link, lines: list[str], y: float) -> None:
    """Draw a link of bodies that are no neighbours, or of a combination, as a line below the row."""
    weights, plain = weights_of(item.link), is_difference(item.link)
    index = [one for one, *_ in measures.apart].index(item)
    legs = []
    for name, weight in weights.items():
        node = measures.layout.owners[name]
        legs.append((measures.starts[node] + measures.widths[node] * (0.2 + 0.15 * index), name, weight))
    same: dict[float, int] = {}
    for number, (x, name, weight) in enumerate(legs):
        same[x] = same.get(x, -1) + 1
        at = x + 0.3 * same[x]  # several points of one structure
        legs[number] = at, name, weight
        symbols.line(ax, [at, at], [y, 0.0], dashed=not plain)
        if point := own_name(measures.layout, name):
            symbols.write_name(ax, at, 0.09, point, "center")
        if not plain:
            symbols.text(ax, at + 0.04, y + 0.03, [f"× {number_text(weight)}"], ha="left", va="bottom")
    middle, half, places = *measures.free(sorted(x for x, *_ in legs)), sorted(x for x, *_ in legs)
    for some in ([places[0], middle - half], [middle + half, max(places[-1], middle + half)]):
        symbols.line(ax, some, [y, y], dashed=not plain)
    ends = (middle - half, middle + half)
    if isinstance(item.link, Contact):
        draw = symbols.hook if item.backward else symbols.gap
        draw(ax, *ends, y, with_units(item.link.clearance, "m"))
        symbols.line(ax, [ends[1]] * 2, [y - 0.12, y + 0.2])
        symbols.text(ax, middle, y - 0.16, lines, symbols.CONTACT)
    else:
        _SYMBOLS[symbols_of(item.link.law)[0]](ax, *ends, y)
        symbols.text(ax, middle, y - 0.12, lines)


def _draw_shared(ax: Axes, measures: Measures, push: Push, y: float) -> None:
    """Draw a source of several bodies: a line above them with an arrow to each."""
    places = []
    for name, weight in push.on.items():
        node = measures.layout.owners[name]
        if node not in measures.starts:
            continue
        x = measures.starts[node] + measures.widths[node] * 0.85
        places.append(x)
        symbols.arrow(ax, (x, y + 0.12), (x, measures.height + 0.01))
        point = own_name(measures.layout, name)
        written = f"{name_text(point)} × {number_text(weight)}" if point else f"× {number_text(weight)}"
        symbols.text(ax, x - 0.05, y + 0.1, [written], FORCE, ha="right")
    symbols.line(ax, [min(places), max(places)], [y + 0.12] * 2, FORCE)
    symbols.text(ax, min(places), y + 0.14, [measures.shared_text(push)], FORCE, ha="left", va="bottom")
