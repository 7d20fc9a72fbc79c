"""Symbols of drawings of networks: springs, dampers, gaps, hooks, walls, arrows. Lengths are in inches."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from impactlab.components.contact import RoundContact
from impactlab.components.sides import WALL
from impactlab.plotting.style import COLORS, name_text

INK, PALE, GROUND, CONTACT, FORCE = "#222222", "#E8EEF4", "#888888", COLORS[0], COLORS[1]

_SMALL = 7.5  # points, of which an inch has 72

LINE = 1.2 * _SMALL / 72.0
"""Height of a line of small text."""

LETTER = 0.5 * LINE
"""Mean width of a letter of small text."""

BUMPER = 0.22
"""How far the rounded end of a contact stands out."""


def box(ax: Axes, x: float, width: float, height: float, dashed: bool = False) -> None:
    """Draw a body, or, dashed, a structure."""
    shape = "round,pad=0,rounding_size=0.06"
    look = {"facecolor": PALE, "edgecolor": INK, "linestyle": "--" if dashed else "-"}
    ax.add_patch(FancyBboxPatch((x, 0.0), width, height, boxstyle=shape, **look))  # type: ignore[arg-type]


def text(ax: Axes, x: float, y: float, lines: list[str], color: str = INK, ha: str = "center", va: str = "top") -> None:
    """Write small text, by default below a place; what lies under it is hidden."""
    under = {"facecolor": "white", "edgecolor": "none", "pad": 0.4, "alpha": 0.8}
    shown = "\n".join(lines)
    ax.text(x, y, shown, ha=ha, va=va, fontsize=_SMALL, color=color, linespacing=1.15, bbox=under, zorder=3)


def line(ax: Axes, x: list[float], y: list[float], color: str = INK, dashed: bool = False) -> None:
    """Draw a thin line."""
    ax.plot(x, y, color=color, lw=0.9, ls=(0, (3, 2)) if dashed else "-", solid_capstyle="butt")


def spring(ax: Axes, left: float, right: float, y: float) -> None:
    """Draw a spring."""
    lead = 0.22 * (right - left)
    turns = 6
    x = np.linspace(left + lead, right - lead, 2 * turns + 1)
    zigzag = np.where(np.arange(2 * turns + 1) % 2, 0.085, -0.085)
    zigzag[[0, -1]] = 0.0
    ax.plot([left, *x, right], [y, *(y + zigzag), y], color=INK, lw=1.1, solid_joinstyle="round")


def damper(ax: Axes, left: float, right: float, y: float) -> None:
    """Draw a damper."""
    middle, half = (left + right) / 2.0, 0.16
    ax.plot([left, middle - half], [y, y], color=INK, lw=1.1)
    ends, sides = middle + half * np.array([1.0, -1.0, -1.0, 1.0]), y + 0.09 * np.array([1.0, 1.0, -1.0, -1.0])
    ax.plot(ends, sides, color=INK, lw=1.1)
    ax.plot([middle + 0.04, middle + 0.04], [y - 0.07, y + 0.07], color=INK, lw=2.0)
    ax.plot([middle + 0.04, right], [y, y], color=INK, lw=1.1)


def element(ax: Axes, left: float, right: float, y: float) -> None:
    """Draw what is neither spring nor damper."""
    middle, half = (left + right) / 2.0, 0.18
    ax.plot([left, middle - half], [y, y], color=INK, lw=1.1)
    ax.add_patch(Rectangle((middle - half, y - 0.08), 2.0 * half, 0.16, facecolor="white", edgecolor=INK, lw=1.1))
    ax.plot([middle + half, right], [y, y], color=INK, lw=1.1)


def gap(ax: Axes, left: float, right: float, y: float, clearance: str) -> None:
    """Draw a contact: the rounded end of the first body on the left, and the distance to the second."""
    angle, height = np.linspace(-np.pi / 2.0, np.pi / 2.0, 40), 0.13
    ax.fill(left + BUMPER * np.cos(angle), y + height * np.sin(angle), facecolor=CONTACT, alpha=0.85, lw=0)
    tip = left + BUMPER
    ax.plot([tip, tip], [y, y + 0.24], color=GROUND, lw=0.7)
    _distance(ax, tip, right, y + 0.18, clearance)


def hook(ax: Axes, left: float, right: float, y: float, clearance: str) -> None:
    """Draw a contact that closes when bodies part: the second one, on the left, holds the first by a hook."""
    behind, ahead = left + 0.3 * (right - left), right - 0.25 * (right - left)
    ax.plot([left, ahead, ahead], [y - 0.09, y - 0.09, y + 0.07], color=INK, lw=1.4)
    ax.plot([right, behind], [y + 0.09, y + 0.09], color=CONTACT, lw=1.4)
    ax.plot([behind, behind], [y + 0.09, y - 0.06], color=CONTACT, lw=2.6)
    _distance(ax, behind, ahead, y + 0.01, "")
    text(ax, (left + right) / 2.0, y + 0.11, [clearance], va="bottom")


def rim(ax: Axes, x: float, y: float, radius: float, contact: RoundContact) -> None:
    """Draw a body in a round clearance: in the wall, or in something that moves."""
    fixed = contact.second is WALL
    look = {"facecolor": "white", "edgecolor": GROUND, "hatch": "//////"} if fixed else {"facecolor": PALE}
    ax.add_patch(Circle((x, y), radius, **({"edgecolor": INK, "lw": 0.8} | look)))  # type: ignore[arg-type]
    ax.add_patch(Circle((x, y), 0.8 * radius, facecolor="white", edgecolor=INK, lw=0.8))
    gap = 0.25 * radius
    off = gap * np.array(contact.center) / max(contact.clearance, math.hypot(*contact.center))
    ax.add_patch(Circle(tuple(np.array([x, y]) - off), 0.8 * radius - gap, facecolor=CONTACT, alpha=0.85, lw=0))


def _distance(ax: Axes, left: float, right: float, y: float, written: str) -> None:
    arrows = {"arrowstyle": "<|-|>", "color": INK, "lw": 0.8, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
    ax.annotate("", (left, y), (right, y), arrowprops=arrows)
    text(ax, (left + right) / 2.0, y + 0.05, [written], va="bottom")


def arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], both: bool = False) -> None:
    """Draw the arrow of a force."""
    look = {"arrowstyle": "<|-|>" if both else "-|>", "color": FORCE, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", end, start, arrowprops=look)


def hatched(ax: Axes, x: float, y: float, width: float, height: float) -> None:
    """Draw a wall or the ground."""
    ax.add_patch(Rectangle((x, y), width, height, facecolor="white", edgecolor=GROUND, hatch="//////", lw=0.8))


def dot(ax: Axes, x: float, y: float) -> None:
    """Draw the point of a structure."""
    ax.plot([x], [y], "o", color=INK, ms=3.5, zorder=4)


def write_name(ax: Axes, x: float, y: float, name: str, ha: str) -> None:
    """Write the name of a point on a body."""
    ax.text(x, y, name_text(name), ha=ha, va="center", fontsize=_SMALL, color=INK)
