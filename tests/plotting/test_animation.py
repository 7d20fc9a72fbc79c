"""Films of trajectories: where bodies are, when contacts flash, and what is written."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import xarray as xr
from matplotlib.animation import FFMpegWriter
from matplotlib.figure import Figure
from PIL import Image

import impactlab as il
from impactlab.plotting import animation
from impactlab.results.dataset import CONFIGURATION

NETWORK = il.Network(
    {"a": il.LinearOscillator(), "b": il.LinearOscillator(mass=2.0)},
    {
        "gap": il.Contact("a", "b", il.LinearContact(100.0), clearance=0.3),
        "stop": il.Contact("b", il.WALL, il.LinearContact(100.0), clearance=0.8),
        "lever": il.Contact(il.Combination({"a": 1.0, "b": 0.5}), il.WALL, il.LinearContact(1.0), clearance=50.0),
    },
)


def as_simulated(network, x, contact_force, **points):
    """A dataset as a simulation has it, of displacements and forces that are given, (time, …) each."""
    dims = ("realization", "time")
    data = {
        "displacement": ((*dims, "oscillator"), x[None], {"units": "m"}),
        "contact_force": ((*dims, "contact"), contact_force[None], {"units": "N"}),
    }
    coordinates = {
        "realization": [0], "time": 0.01 * np.arange(len(x)), "oscillator": list(network.oscillators),
        "contact": list(network.contacts),
    }  # fmt: skip
    if points:
        data["point_displacement"] = (*dims, "point"), np.stack([*points.values()], axis=-1)[None]
        coordinates["point"] = list(network.points)
    return xr.Dataset(data, coordinates, {CONFIGURATION: json.dumps({"network": network.to_dict()})})


@pytest.fixture
def result():
    """One body hits the other, which later hits the wall."""
    time = 0.01 * np.arange(201)
    x = np.stack([0.6 * np.sin(4.0 * time), 0.9 * np.sin(1.7 * time) ** 2], axis=-1)
    depths = [x[:, 0] - x[:, 1] - 0.3, x[:, 1] - 0.8, x @ [1.0, 0.5] - 50.0]
    return as_simulated(NETWORK, x, 100.0 * np.maximum(np.stack(depths, axis=-1), 0.0))


def drawn(film, sample):
    """Boxes and flashes of a sample."""
    axes = Figure().subplots()
    film.scene.drawn_on(axes)(sample)
    return {text.get_text(): box for box, text in zip(axes.patches, axes.texts, strict=True)}, [
        line.get_xdata() for line in axes.lines if line.get_marker() == "*"
    ]


def test_bodies_are_to_scale_and_touch_when_contacts_close(result):
    film = il.animate(result)
    path = result.isel(realization=0)
    for name in ("gap", "stop"):
        closed = path.contact_force.sel(contact=name).values > 0.0
        sample = int(np.argmax(closed))
        boxes, flashes = drawn(film, sample)
        a, b = boxes["a"], boxes["b"]
        apart = b.get_x() - (a.get_x() + a.get_width())
        indentation = float(path.displacement[sample, 0] - path.displacement[sample, 1]) - 0.3
        assert apart == pytest.approx(-indentation)
        at = {"gap": a.get_x() + a.get_width() + 0.5 * apart, "stop": b.get_x() + b.get_width()}
        assert flashes[list(NETWORK.contacts).index(name)] == pytest.approx([at[name]])
    assert not any(len(x) for x in drawn(film, 0)[1])


def test_short_contacts_between_frames_flash(result, monkeypatch):
    monkeypatch.setattr(animation, "FRAMES", 4)
    film = il.animate(result)
    closed = result.contact_force.sel(contact="gap").values[0] > 0.0
    frames = film.scene.frames
    assert len(frames) == 4
    flashes = [len(drawn(film, frame)[1][0]) for frame in frames]
    bounds = [0, *(frames[:-1] + 1)]
    assert flashes == [int(closed[low : high + 1].any()) for low, high in zip(bounds, frames, strict=True)]
    assert sum(flashes) > sum(closed[frames])


def test_points_stand_for_the_modes_of_their_structure():
    beam = il.ModalStructure((3.0, 9.0), 0.1, points={"tip": (2.0, -2.0)})
    network = il.Network({"a": il.LinearOscillator(), "beam": beam}, {
        "hit": il.Contact("a", "beam.tip", il.LinearContact(100.0), clearance=0.1),
    })  # fmt: skip
    modes = np.linspace(0.0, 0.3, 6)[:, None] * [1.0, 0.2, 0.1]
    tip = modes[:, 1:] @ [2.0, -2.0]
    force = np.maximum(modes[:, :1] - tip[:, None] - 0.1, 0.0)
    result = as_simulated(network, modes, force, tip=tip)
    film = il.animate(result)
    assert list(film.scene.paths) == ["a", "beam.tip"]
    assert len(drawn(film, int(np.argmax(result.contact_force.values)))[1][0]) == 1


def test_files_of_each_kind(result, tmp_path, monkeypatch):
    some = result.isel(time=slice(0, 4))
    il.animate(some, tmp_path / "x.gif")
    with Image.open(tmp_path / "x.gif") as image:
        assert image.n_frames == 4
    film = il.animate(some, tmp_path / "x.html")
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert film._repr_html_() in text
    assert text.count("data:image/png;base64") == 4
    assert "://" not in text  # it needs no network
    assert re.findall(r"<button[^>]*>\s*(\S+)\s*</button>", text) == ["−", "|◀", "‹", "◀", "❚❚", "▶", "›", "▶|", "+"]
    monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda: False)
    with pytest.raises(il.InvalidInput, match=r"\.mp4 are written by ffmpeg, which is not installed; write \.html or"):
        film.save(tmp_path / "x.mp4")
    with pytest.raises(il.InvalidInput, match=r"to a file \.html, \.gif or \.mp4, not 'x\.avi'"):
        film.save(tmp_path / "x.avi")
    with pytest.raises(il.InvalidInput, match=r"Cannot write .*No such file"):
        film.save(tmp_path / "none" / "x.html")
    with pytest.raises(il.InvalidInput, match="no trajectories"):
        il.animate(result[["contact_force"]])
