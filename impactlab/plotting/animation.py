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
from matplotlib.patches import Rectangle

from impactlab.errors import InvalidInput
from impactlab.plotting.held import configuration, of_names
from impactlab.plotting.layout import in_a_row
from impactlab.plotting.motion import one_realization, trajectories
from impactlab.plotting.style import COLORS, style
from impactlab.plotting.symbols import GROUND, INK, PALE

FRAMES = 150
"""Frames at most; samples between two of them are looked at for contacts only."""

RATE = 25
"""Frames per second."""

PLACES = 16
"""Bodies and points that are drawn at most."""

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
        figure = Figure(figsize=(7.0, 1.9), dpi=80)
        figure.set_layout_engine("none")
        draw = self.scene.drawn_on(figure.add_axes((0.02, 0.02, 0.96, 0.84)))
        return FuncAnimation(figure, draw, frames=self.scene.frames, interval=1000.0 / RATE)


def animate(result: xr.Dataset, path: str | os.PathLike[str] | None = None, *, realization: int = 0) -> Animation:
    """Show a trajectory as a film: bodies move, to scale with their clearances, and contacts flash while closed.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Trajectory(interval)]``. Part of the time is shown of
        ``result.sel(time=slice(2.0, 3.0))``; it has at most 150 frames, and 16 bodies and points.
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
    """
    animation = Animation(one_realization(result, realization))
    if path is not None:
        animation.save(path)
    return animation


class _Contact:
    """A contact of a scene, with its sides as plain data and when it is closed."""

    def __init__(self, data: dict[str, Any], closed: np.ndarray) -> None:
        self.first, self.second, self.closed = data["first"], data["second"], closed
        self.clearance = float(data["clearance"])

    def sides(self) -> Iterator[str]:
        """Give the names of bodies and points."""
        for side in (self.first, self.second):
            for one in side if isinstance(side, list) else [side]:
                yield from [one] if isinstance(one, str) else one.get("combination", {})


class _Scene:
    """Bodies and points in a row, with their displacements and contacts."""

    def __init__(self, result: xr.Dataset) -> None:
        data = trajectories(result, "displacement", ["time"])
        network = configuration(result).get("network", {})
        paths = {str(name): data.sel(oscillator=name).values for name in data["oscillator"].values}
        if "point_displacement" in result:
            moved = of_names(result["point_displacement"])
            points = {str(name): moved.sel(point=name).values for name in moved["point"].values}
            shown = {name.rpartition(".")[0] for name in points}
            structures = {name for name, item in network.get("oscillators", {}).items() if "Structure" in item["type"]}
            paths = {name: path for name, path in paths.items() if name.rpartition(".")[0] not in shown & structures}
            paths |= points
        self.times = result["time"].values
        forces = dict[str, np.ndarray]()
        if "contact_force" in result:
            data = of_names(result["contact_force"])
            forces = {str(name): data.sel(contact=name).values for name in data["contact"].values}
        never = np.zeros(len(self.times))  # of a contact that was not recorded
        self.contacts = [
            _Contact(item, forces.get(name, never) != 0.0) for name, item in network.get("contacts", {}).items()
        ]
        pairs = [(item.first, item.second) for item in self.contacts if _plain(item) == 2]
        row = in_a_row([pair for pair in pairs if {*pair} <= paths.keys()], list(paths))[:PLACES]
        self.paths = {name: paths[name] for name in row}
        self.frames = np.unique(np.linspace(0, len(self.times) - 1, min(FRAMES, len(self.times))).astype(int))

    @cached_property
    def range(self) -> float:
        """Largest range of a motion or clearance (m)."""
        moved = [float(np.ptp(path)) for path in self.paths.values()]
        return max(*moved, *(item.clearance for item in self.contacts), 1e-300)

    @cached_property
    def places(self) -> dict[str, float]:
        """Left sides of the bodies where their displacements are 0; clearances are to scale."""
        joining = [item for item in reversed(self.contacts) if _plain(item) == 2]
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
        names = {name: ax.text(x, -0.3, name, ha="center", fontsize=8) for name, x in self.places.items()}
        for box in boxes.values():
            ax.add_patch(box)
        flashes = [ax.plot([], [], "*", color=COLORS[1], ms=14, zorder=5)[0] for _ in self.contacts]
        clock = ax.set_title("", loc="left")

        def draw(sample: int) -> list[Any]:
            for name, box in boxes.items():
                box.set_x(self.places[name] + self.paths[name][sample])
                names[name].set_x(box.get_x() + 0.5 * width)
            for contact, flash in zip(self.contacts, flashes, strict=True):
                places = self._touching(contact, sample, width) if self.is_closed(contact, sample) else []
                flash.set_data(places, [0.5 * _HEIGHT] * len(places))
            clock.set_text(f"{self.times[sample]:.3f} s")
            return [*boxes.values(), *names.values(), *flashes, clock]

        return draw

    def is_closed(self, contact: _Contact, sample: int) -> bool:
        """Whether a contact is closed at a frame, or was since the one before."""
        place = int(np.searchsorted(self.frames, sample))
        before = int(self.frames[place - 1]) + 1 if place else 0
        return bool(contact.closed[min(before, sample) : sample + 1].any())

    def _walls(self, width: float) -> Iterator[float]:
        for contact in self.contacts:
            if _plain(contact) == 1 and isinstance(contact.first, str) and contact.first in self.places:
                yield self.places[contact.first] + width + contact.clearance
            elif _plain(contact) == 1 and contact.second in self.places:
                yield self.places[contact.second] - contact.clearance

    def _touching(self, contact: _Contact, sample: int, width: float) -> list[float]:
        """Return where a contact flashes: between two bodies, at a wall, or on all bodies of a combination."""
        own = [name for name in contact.sides() if name in self.places]
        at = [self.places[name] + float(self.paths[name][sample]) for name in own]
        if not own or not _plain(contact):
            return [x + 0.5 * width for x in at]
        faces = [x + width if name == contact.first else x for name, x in zip(own, at, strict=True)]
        return [sum(faces) / len(faces)]


def _plain(contact: _Contact) -> int:
    """Return how many bodies or points a contact joins; 0 if it joins combinations."""
    sides = [side for side in (contact.first, contact.second) if not (isinstance(side, dict) and "wall" in side)]
    return len(sides) if all(isinstance(side, str) for side in sides) else 0
