"""Motion in a plane: a rotor that rubs, in orbits, films and over time."""

import json

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import impactlab as il
from impactlab.plotting.overview import overview
from impactlab.results.dataset import CONFIGURATION

BODY = il.LinearOscillator(stiffness=1.0)
LAW = il.HertzContact(1e4)
CENTER, CLEARANCE = (0.1, -0.2), 1.0
NETWORK = il.Network(
    dict.fromkeys(("x", "y", "u", "w"), BODY),
    {
        "rub": il.RoundContact(("x", "y"), ("u", "w"), LAW, clearance=CLEARANCE, center=CENTER),
        "stop": il.RoundContact(("u", "w"), il.WALL, LAW, clearance=0.5),
    },
)


def moved(network=NETWORK):
    """A body on a spiral in a casing that moves."""
    time = np.linspace(0.0, 4.0, 401)
    radius, angle = 0.5 * time, 5.0 * time
    casing = np.stack([0.6 * np.sin(time), 0.1 * np.cos(time)])
    body = casing + np.array(CENTER)[:, None] + radius * np.array([np.cos(angle), np.sin(angle)])
    depth = np.stack([radius - CLEARANCE, np.hypot(*casing) - 0.5])
    dims, paths = ("realization", "time"), np.concatenate([body, casing])
    data = {
        "displacement": ((*dims, "oscillator"), paths.T[None]),
        "velocity": ((*dims, "oscillator"), np.gradient(paths, time, axis=1).T[None]),
        "contact_force": ((*dims, "contact"), np.maximum(depth, 0.0).T[None]),
    }
    names = {"oscillator": list(network.oscillators), "contact": list(network.contacts)}
    stored = json.dumps({"network": network.to_dict()})
    return xr.Dataset(data, {"realization": [0], "time": time, **names}, {CONFIGURATION: stored})


@pytest.fixture
def ax():
    return Figure().subplots()


def line(axes, label):
    (found,) = (item for item in axes.lines if item.get_label() == label)
    return found.get_xydata().T


def test_an_orbit_is_relative_to_what_is_around_it(ax):
    result = moved()
    assert il.plot.orbit(result, ax=ax) is ax
    place = np.hypot(*(line(ax, "open") - np.array(CENTER)[:, None]))
    np.testing.assert_allclose(place, 0.5 * result.time, atol=1e-12)
    touching = np.hypot(*(line(ax, "in contact") - np.array(CENTER)[:, None]))
    closed = result.contact_force.sel(realization=0, contact="rub").values > 0.0
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(touching)), np.flatnonzero(closed | np.roll(closed, -1)))
    rim = line(ax, "rub closes") - np.array(CENTER)[:, None]
    np.testing.assert_allclose(np.hypot(*rim), CLEARANCE)
    assert ax.get_aspect() == 1.0
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("displacement of x − u (m)", "displacement of y − w (m)")


def test_the_orbit_of_two_coordinates(ax):
    result = moved()
    il.plot.orbit(result, ("u", "w"), ax=ax)
    casing = result.displacement.sel(realization=0)
    np.testing.assert_array_equal(line(ax, "open"), [casing.sel(oscillator="u"), casing.sel(oscillator="w")])
    np.testing.assert_allclose(np.hypot(*line(ax, "stop closes")), 0.5)
    assert "in contact" in [item.get_label() for item in ax.lines]
    other = il.plot.orbit(result, ("x", il.Combination({"y": 1.0, "w": -1.0})), ax=Figure().subplots())
    assert [item.get_label() for item in other.lines] == ["open"]
    assert other.get_ylabel() == "displacement of y − w (m)"


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("rab", "There is no round contact 'rab'; did you mean 'rub'"),
        (("x",), r"name must be .* not \('x',\)"),
        (("x", "z"), "'z' is not in the result"),
        ([], r"name must be .*, not \[\]"),
    ],
)
def test_what_is_no_plane_is_refused(name, error):
    with pytest.raises(il.InvalidInput, match=error):
        il.plot.orbit(moved(), name)


def test_without_a_round_contact_coordinates_are_asked_for():
    result = moved().drop_attrs()
    with pytest.raises(il.InvalidInput, match=r"no round contact: name x and y, such as il\.plot\.orbit\(result, \("):
        il.plot.orbit(result)
    assert len(il.plot.orbit(result, ("x", "y"), ax=Figure().subplots()).lines) == 1
    with pytest.raises(il.InvalidInput, match="no trajectories"):
        il.plot.orbit(moved()[["contact_force"]])


def test_round_contacts_are_known_over_time_and_in_the_phase_plane(ax):
    result = moved()
    il.plot.trajectory(result, "x", ax=ax)
    assert ax.get_legend_handles_labels()[1] == ["rub closed", "x"]
    axes = il.plot.phase_portrait(result, "w", ax=Figure().subplots())
    closed = (result.contact_force.sel(realization=0) > 0.0).any("contact").values
    assert np.isfinite(line(axes, "in contact")[0][closed]).all()


def test_the_circle_of_a_joint_density(ax):
    result = moved()
    stored = json.loads(result.attrs[CONFIGURATION])
    stored["simulate"] = {"record": [{"type": "JointDensity", "first": "u", "second": "w"}]}
    edges = {f"joint_{side}_edges": (f"joint_{side}_edge", np.arange(4.0)) for side in ("first", "second")}
    density = ("joint_first_bin", "joint_second_bin"), np.eye(3), {"units": "m-2"}
    joint = xr.Dataset({"joint_density": density, **edges}, attrs={CONFIGURATION: json.dumps(stored)})
    il.plot.joint_density(joint, ax=ax)
    np.testing.assert_allclose(np.hypot(*line(ax, "stop closes")), 0.5)
    assert len(ax.lines) == 1


def test_films_show_planes_as_planes():
    """Discs touch their circles where contacts close; bodies of planes alone are no boxes in the row."""
    result = moved()
    scene = il.animate(result).scene
    assert not scene.paths
    rub, _ = scene.planes
    axes = Figure().subplots()
    draw = rub.drawn_on(axes, scene.last_closed)
    closed = result.contact_force.sel(realization=0, contact="rub").values > 0.0
    circle, disc = axes.patches
    for frame in scene.frames:
        draw(frame)
        apart = circle.radius - disc.radius - np.hypot(*np.subtract(disc.center, circle.center))
        assert apart == pytest.approx(CLEARANCE - 0.5 * result.time[frame].item())
        (flash,) = (item for item in axes.lines if item.get_marker() == "*")
        assert len(flash.get_xdata()) == closed[frame]
        if closed[frame]:
            np.testing.assert_allclose(np.hypot(*(flash.get_xydata()[0] - circle.center)), circle.radius)
    with_a_row = NETWORK.replace(contacts={"gap": il.Contact("x", "u", LAW, clearance=0.3), "stop": None})
    film = il.animate(moved(with_a_row).isel(time=slice(0, 3)))
    assert list(film.scene.paths) == ["x", "u"]
    assert film.html.count("data:image/png;base64") == 3


def test_an_overview_has_an_orbit_of_each_round_contact():
    labels = [axes.get_xlabel() for axes in overview(moved()).axes]
    assert labels.count("displacement of x − u (m)") == labels.count("displacement of u (m)") == 1


@pytest.mark.parametrize(
    "stored",
    [
        {"network": None},
        {"network": {"contacts": []}},
        {"network": {"contacts": {"rub": 5}}},
        {"network": {"contacts": {"rub": {"type": "RoundContact", "first": 5, "second": {"wall": True}}}}},
        {"network": {"contacts": {"rub": {"type": "Contact", "first": "x", "second": "u", "clearance": "x"}}}},
        [],
    ],
)
def test_a_damaged_configuration_is_refused(stored):
    result = moved().assign_attrs({CONFIGURATION: json.dumps(stored)})
    for draw in (il.plot.trajectory, il.plot.orbit, il.animate, overview):
        with pytest.raises(il.InvalidInput, match="configuration that is stored with the result is damaged"):
            draw(result)
