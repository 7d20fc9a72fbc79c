"""Plots of bifurcation diagrams, maps of periods and basins."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import impactlab as il

SHORT = {"transient": 40, "keep": 12}


def struck(frequency, amplitude=1.0):
    return il.Network(
        {"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        {"stop": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=0.0)},
        {"a": il.Harmonic(amplitude, frequency=frequency)},
    )


@pytest.fixture
def ax():
    return Figure().subplots()


def test_points_of_few_values_are_larger(diagram, ax):
    assert il.plot.bifurcation(diagram, ax=ax).lines[0].get_markersize() == 5.0


@pytest.fixture(scope="module")
def diagram():
    values = xr.DataArray([1.7, 2.0, 2.9], attrs={"units": "rad s-1"})
    return il.bifurcation(struck, {"frequency": values}, starts=2, rng=1, **SHORT)


@pytest.fixture(scope="module")
def plane():
    return il.bifurcation(struck, {"frequency": [2.9, 1.7, 2.0], "amplitude": [0.5, 1.0]}, **SHORT)


@pytest.fixture(scope="module")
def basins():
    grid = {"x": np.linspace(-2.0, 0.4, 9), "v": np.linspace(-2.0, 2.0, 8)}
    return il.basins(struck(1.2497), ("displacement:a", "velocity:a"), grid)


def test_points_of_all_starts_are_drawn(ax, diagram):
    il.plot.bifurcation(diagram, "a", "velocity", ax=ax, label="up")
    places, values = ax.lines[0].get_data()
    assert len(places) == 3 * 2 * 12
    np.testing.assert_array_equal(np.sort(values), np.sort(diagram.velocity.values.ravel()))
    assert ax.get_xlabel() == "frequency (rad s$^{-1}$)"
    assert ax.get_ylabel() == "velocity of a (m s$^{-1}$)"
    diagram.impactlab.plot.bifurcation(ax=ax, color="red")
    assert ax.lines[1].get_color() == "red"


def test_periods_are_drawn_in_the_order_of_the_values(ax, plane):
    il.plot.period_map(plane, ax=ax)
    mesh = ax.collections[0]
    periods = plane.period.isel(start=0).sortby("frequency").values.T
    texts = [item.get_text() for item in ax.figure.axes[1].get_yticklabels()]
    shown = np.array([{"none": 0, "over 8": 9}.get(text) or int(text) for text in texts if text != "none"])
    codes = mesh.get_array()
    assert codes.shape == periods.shape
    assert len(texts) == len(np.unique(periods.clip(max=9)))
    assert (np.diff(shown) > 0).all()
    assert (codes[periods == 1] == texts.index("1")).all()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("frequency", "amplitude")


def test_basins_and_attractors_are_drawn(ax, basins):
    il.plot.basins(basins, ax=ax)
    labels = basins.label.values.T
    codes = np.ma.filled(ax.collections[0].get_array().astype(float), np.nan)
    np.testing.assert_array_equal(codes, np.where(labels < 0, np.nan, labels))
    assert [len(np.unique(line.get_xdata()[np.isfinite(line.get_xdata())])) for line in ax.lines] == [1, 2]
    assert ax.get_xlabel() == "displacement of a at the start (m)"


def test_bad_input(ax, diagram, plane, basins):
    for draw, data, words in (
        (il.plot.bifurcation, basins, "il.bifurcation returned"),
        (il.plot.bifurcation, plane, "use il.plot.period_map"),
        (il.plot.period_map, diagram, "over two parameters"),
        (il.plot.basins, diagram, "il.basins returned"),
        (il.plot.basins, basins.isel(x=0), "over two quantities"),
    ):
        with pytest.raises(il.InvalidInput, match=words):
            draw(data, ax=ax)
    with pytest.raises(il.InvalidInput, match="no oscillator 'b'"):
        il.plot.bifurcation(diagram, "b", ax=ax)
    with pytest.raises(il.InvalidInput, match="quantity"):
        il.plot.bifurcation(diagram, "a", "speed", ax=ax)
    with pytest.raises(il.InvalidInput, match="there is no start 3"):
        il.plot.period_map(plane, start=3, ax=ax)
