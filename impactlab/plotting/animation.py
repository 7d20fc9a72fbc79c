"""Animations of trajectories: bodies that move, and contacts that flash while they are closed."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from impactlab.components.contact import Contact, RoundContact
from impactlab.components.sides import WALL, is_difference, named_by, weights_of
from impactlab.errors import InvalidInput
from impactlab.inputs import checked
from impactlab.plotting.held import contacts_of, of_names, rows, structures_of
from impactlab.plotting.layout import MOST_DRAWN, in_a_row
from impactlab.plotting.motion import one_realization, series, trajectories, when_closed
from impactlab.plotting.style import COLORS, name_text, style
from impactlab.plotting.symbols import GROUND, INK, PALE

FRAMES = 150
"""Frames at most; samples between two of them are looked at for contacts only."""

RATE = 25
"""Frames per second."""

_BUTTONS = {
    "minus": "\N{MINUS SIGN}",
    "fast-backward": "|\N{BLACK LEFT-POINTING TRIANGLE}",
    "step-backward": "\N{SINGLE LEFT-POINTING ANGLE QUOTATION MARK}",
    "play fa-flip-horizontal": "\N{BLACK LEFT-POINTING TRIANGLE}",
    "pause": "\N{HEAVY VERTICAL BAR}\N{HEAVY VERTICAL BAR}",
    "play": "\N{BLACK RIGHT-POINTING TRIANGLE}",
    "step-forward": "\N{SINGLE RIGHT-POINTING ANGLE QUOTATION MARK}",
    "fast-forward": "\N{BLACK RIGHT-POINTING TRIANGLE}|",
    "plus": "+",
}
"""Signs on the buttons, by the names of the icons that Matplotlib would fetch from the web."""

_ROW, _PLANE = (7.0, 1.9), 2.5  # width and height of a row, and of a plane, in inches

_WIDTH, _HEIGHT, _ROOM = 0.5, 0.6, 0.6
"""Width of a body and distance of bodies that no contact joins, in the largest range of a motion; height."""


class Animation:
    """A motion as a film; notebooks show it. `animate` makes it.

    Parameters
    ----------
    result : Dataset
        One realization, with trajectories.
    """

    def __init__(self, result: xr.Dataset) -> None:
        self.scene = _Scene(result)

    def _repr_html_(self) -> str:
        return self.html

    @cached_property
    def html(self) -> str:
        """The film with its controls, as a part of a page; nothing of it comes from the web."""
        with style():
            text: str = self._film().to_jshtml(fps=RATE, default_mode="loop")
        text = re.sub(r'<link rel="stylesheet"\s+href="[^"]*">', "", text)
        return re.sub(r'<i class="fa fa-([a-z -]+)"></i>', lambda icon: _BUTTONS.get(icon[1], icon[1]), text)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the film to a file: ``.html``, ``.gif``, or ``.mp4`` where ffmpeg is installed.

        Raises
        ------
        InvalidInput
            If the file cannot be written, or is of another kind.
        """
        path = Path(path)
        kind = path.suffix.lower()
        if kind not in (".html", ".gif", ".mp4"):
            raise InvalidInput(f"An animation is written to a file .html, .gif or .mp4, not {path.name!r}.")
        if kind == ".mp4" and not FFMpegWriter.isAvailable():
            raise InvalidInput("Files .mp4 are written by ffmpeg, which is not installed; write .html or .gif.")
        try:
            if kind == ".html":
                head = '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"></head>'
                path.write_text(f"{head}<body>{self.html}</body></html>", encoding="utf-8")
                return
            writer = PillowWriter(fps=RATE) if kind == ".gif" else FFMpegWriter(fps=RATE)
            with style():
                self._film().save(path, writer=writer)
        except OSError as error:
            raise InvalidInput(f"Cannot write {path}: {error.strerror or error}.") from error

    def _film(self) -> FuncAnimation:
        planes, row = self.scene.planes, bool(self.scene.paths)
        width = _ROW[0] if row or len(planes) > 2 else len(planes) * _PLANE
        height = _ROW[1] * row + _PLANE * bool(planes)
        figure = Figure(figsize=(width, height), dpi=80)
        figure.set_layout_engine("none")
        parts = [self.scene.drawn_on(figure.add_axes((0.02, 0.04 / height, 0.96, 1.6 / height)))] if row else []
        for index, plane in enumerate(planes):
            left, share = index * width / len(planes), width / len(planes)
            place = (left / width, 1.0 - (_PLANE - 0.25) / height, share / width, (_PLANE - 0.45) / height)
            parts.append(plane.drawn_on(figure.add_axes(place), self.scene.last_closed))
        clock = figure.text(0.02, 1.0 - 0.06 / height, "", va="top")

        def draw(sample: int) -> list[Any]:
            clock.set_text(f"{self.scene.times[sample]:.3f} s")
            return [clock, *(item for part in parts for item in part(sample))]

        return FuncAnimation(figure, draw, frames=self.scene.frames, interval=1000.0 / RATE)


@checked
def animate(result: xr.Dataset, path: str | os.PathLike[str] | None = None, *, realization: int = 0) -> Animation:
    """Show a trajectory as a film: bodies move, to scale with their clearances, and contacts flash while closed.

    Bodies are boxes in a row, or, in a round contact, a disc in a circle.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Trajectory(interval)]``. Part of the time is shown of
        ``result.sel(time=slice(2.0, 3.0))``; it has at most 150 frames, 16 bodies and points
        in a row, and three round contacts.
    path : str or path, optional
        File to be written: ``.html``, with controls, ``.gif``, or ``.mp4`` where ffmpeg is installed.
    realization : int
        Which one.

    Returns
    -------
    Animation
        Which notebooks show; ``save(path)`` writes it to a file.

    Raises
    ------
    InvalidInput
        If the result holds no trajectories, or the file cannot be written.

    Examples
    --------
    >>> path = il.simulate(driven, 2.0, initial="rest", record=il.Trajectory(0.05))
    >>> film = il.animate(path)
    >>> film.__class__.__name__
    'Animation'
    """
    animation = Animation(one_realization(result, realization))
    if path is not None:
        animation.save(path)
    return animation


class _Scene:
    """Bodies and points in a row, and in planes, with their displacements and contacts."""

    def __init__(self, result: xr.Dataset) -> None:
        data = trajectories(result, "displacement", ["time"])
        paths = {name: data.sel(place).values for name, place in rows(data)}
        if "point_displacement" in result:
            at_points = of_names(result["point_displacement"])
            points = {name: at_points.sel(place).values for name, place in rows(at_points)}
            hidden = {name.rpartition(".")[0] for name in points} & structures_of(result)
            paths = {name: path for name, path in paths.items() if name.rpartition(".")[0] not in hidden}
            paths |= points
        self.times, contacts = result["time"].values, contacts_of(result)
        self.frames = np.unique(np.linspace(0, len(self.times) - 1, min(FRAMES, len(self.times))).astype(int))
        self.closed = dict.fromkeys(contacts, np.zeros(len(self.times), dtype=bool)) | when_closed(result)
        self.contacts = {name: item for name, item in contacts.items() if isinstance(item, Contact)}
        self.planes = [
            _Plane(name, item, result, self.closed[name])
            for name, item in contacts.items()
            if isinstance(item, RoundContact) and paths.keys() >= {*named_by(item)}
        ][:MOST_DRAWN]
        in_planes = {name for plane in self.planes for name in named_by(plane.contact)}
        in_row = {name for item in self.contacts.values() for name in named_by(item)}
        pairs = [(str(item.first), str(item.second)) for item in self.contacts.values() if _plain(item) == 2]
        row = in_a_row(pairs, [name for name in paths if name in in_row or name not in in_planes])
        # so many are drawn at most
        self.paths = {name: paths[name] for name in [name for name in row if name in paths][:16]}

    @cached_property
    def range(self) -> float:
        """Largest range of a motion or clearance (m)."""
        moved = [float(np.ptp(path)) for path in self.paths.values()]
        return max(*moved, *(item.clearance for item in self.contacts.values()), 1e-300)

    @cached_property
    def places(self) -> dict[str, float]:
        """Left sides of the bodies where their displacements are 0; clearances are to scale."""
        joining = [item for item in reversed(self.contacts.values()) if _plain(item) == 2]
        clearances = {(item.first, item.second): item.clearance for item in joining}
        result: dict[str, float] = {}
        x, before = 0.0, ""
        for name in self.paths:
            if before:
                x += self.range * _WIDTH + clearances.get((before, name), self.range * _ROOM)
            result[name], before = x, name
        return result

    def drawn_on(self, ax: Axes) -> Callable[[int], list[Any]]:
        """Draw what does not move, and return a function that draws a sample."""
        width = _WIDTH * self.range
        low = min(self.places[name] + float(path.min()) for name, path in self.paths.items())
        high = max(self.places[name] + float(path.max()) for name, path in self.paths.items()) + width
        walls = list(self._walls(width))
        margin = 0.3 * self.range
        ax.set(xlim=(min([low, *walls]) - margin, max([high, *walls]) + margin), ylim=(-0.5, 1.0))
        ax.set_axis_off()
        ax.axhline(-0.08, color=GROUND, lw=1.0)
        for wall in walls:
            ax.plot([wall, wall], [-0.08, 0.9], color=INK, lw=3.0)
        look: dict[str, Any] = {"facecolor": PALE, "edgecolor": INK}
        boxes = {name: Rectangle((x, 0.0), width, _HEIGHT, **look) for name, x in self.places.items()}
        names = {name: ax.text(x, -0.3, name_text(name), ha="center", fontsize=8) for name, x in self.places.items()}
        for box in boxes.values():
            ax.add_patch(box)
        flashes = {name: _flash(ax) for name in self.contacts}

        def draw(sample: int) -> list[Any]:
            for name, box in boxes.items():
                box.set_x(self.places[name] + self.paths[name][sample])
                names[name].set_x(box.get_x() + 0.5 * width)
            for name, flash in flashes.items():
                touching = self.last_closed(self.closed[name], sample) is not None
                places = self._touching(self.contacts[name], sample, width) if touching else []
                flash.set_data(places, [0.5 * _HEIGHT] * len(places))
            return [*boxes.values(), *names.values(), *flashes.values()]

        return draw

    def last_closed(self, closed: np.ndarray, sample: int) -> int | None:
        """Return the last sample at which a contact was closed, of a frame and those since the frame before."""
        place = int(np.searchsorted(self.frames, sample))
        before = int(self.frames[place - 1]) + 1 if place else 0
        found = np.flatnonzero(closed[: sample + 1])
        return int(found[-1]) if len(found) and found[-1] >= min(before, sample) else None

    def _walls(self, width: float) -> Iterator[float]:
        for contact in self.contacts.values():
            if _plain(contact) == 1 and contact.first in self.places:
                yield self.places[str(contact.first)] + width + contact.clearance
            elif _plain(contact) == 1 and contact.second in self.places:
                yield self.places[str(contact.second)] - contact.clearance

    def _touching(self, contact: Contact, sample: int, width: float) -> list[float]:
        """Return where a contact flashes: between two bodies, at a wall, or on all bodies of a combination."""
        own = [name for name in named_by(contact) if name in self.places]
        at = [self.places[name] + float(self.paths[name][sample]) for name in own]
        if not own or not _plain(contact):
            return [x + 0.5 * width for x in at]
        faces = [x + width if name == contact.first else x for name, x in zip(own, at, strict=True)]
        return [sum(faces) / len(faces)]


class _Plane:
    """A round contact: a disc in a circle, whose clearance is to scale with the motion."""

    def __init__(self, name: str, contact: RoundContact, result: xr.Dataset, closed: np.ndarray) -> None:
        self.name, self.contact, self.closed = name, contact, closed
        self.body = _in_plane(result, contact.first)
        self.around = np.zeros_like(self.body) if contact.second is WALL else _in_plane(result, contact.second)
        self.around += np.array(contact.center)[:, None]

    def drawn_on(self, ax: Axes, last_closed: Callable[[np.ndarray, int], int | None]) -> Callable[[int], list[Any]]:
        """Draw what does not move, and return a function that draws a sample."""
        offset = self.body - self.around
        radius = max(self.contact.clearance, float(np.hypot(*offset).max()))
        rim = radius + self.contact.clearance
        low, high = self.around.min(axis=1) - 1.15 * rim, self.around.max(axis=1) + 1.15 * rim
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        ax.set_axis_off()
        ax.text(0.5, 0.0, name_text(self.name), ha="center", va="top", fontsize=8, transform=ax.transAxes)
        fixed = self.contact.second is WALL
        circle = Circle((0.0, 0.0), rim, facecolor="none", edgecolor=INK, lw=3.0 if fixed else 1.5)
        disc = Circle((0.0, 0.0), radius, facecolor=PALE, edgecolor=INK)
        (middle,) = ax.plot([], [], "+", color=INK)
        flash = _flash(ax)
        for patch in (circle, disc):
            ax.add_patch(patch)

        def draw(sample: int) -> list[Any]:
            circle.set_center(tuple(self.around[:, sample]))
            disc.set_center(tuple(self.body[:, sample]))
            middle.set_data(*self.body[:, sample, None])
            touched = last_closed(self.closed, sample)
            flash.set_data([], [])
            if touched is not None:
                outwards = offset[:, touched] / np.hypot(*offset[:, touched])
                flash.set_data(*(self.around[:, sample] + rim * outwards)[:, None])
            return [circle, disc, middle, flash]

        return draw


def _in_plane(result: xr.Dataset, sides: Any) -> np.ndarray:
    """Return displacements along x and y, (2, time)."""
    return np.stack([series(result, "displacement", side) for side in sides])


def _flash(ax: Axes) -> Any:
    return ax.plot([], [], "*", color=COLORS[1], ms=14, zorder=5)[0]


def _plain(contact: Contact) -> int:
    """Return how many bodies or points a contact joins; 0 if it joins combinations."""
    return len(weights_of(contact)) if is_difference(contact) else 0
