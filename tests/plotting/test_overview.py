"""One figure of all that a result holds, by its panels."""

import matplotlib
import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.plotting.overview import overview
from impactlab.plotting.style import save_figure

NETWORK = il.Network(
    {name: il.LinearOscillator(stiffness=1.0, damping=1.0) for name in ("one", "two")},
    {"gap": il.Contact("one", "two", il.HertzContact(10.0))},
    {name: il.WhiteNoise(1.0) for name in ("one", "two")},
)
RECORDS = [
    il.Density(bins=20), il.JointDensity("one", "two", bins=10), il.Spectrum(segment=5.0), il.PeakForces(window=5.0),
    il.Trajectory(0.1),
]  # fmt: skip


@pytest.fixture(scope="module")
def result():
    return il.simulate(NETWORK, 20.0, realizations=64, record=RECORDS, rng=1)


def labels(figure):
    return [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()]


def test_every_record_has_a_panel(result):
    assert labels(overview(result)) == [
        "probability density (m$^{-1}$)",
        "displacement of two (m)",
        "joint density (m$^{-2}$)",
        "spectral density (m$^{2}$ s rad$^{-1}$)",
        "contact force (N)",
        "displacement (m)",
        "contact force of gap (N)",
    ]
    drawn, table, *_ = overview(result).axes
    assert drawn.texts
    assert [len(item) for item in written(table)] == [4] * 8  # two statistics of bodies, four of a contact


def written(axes):
    """The lines of a table."""
    (table,) = axes.tables
    cells = table.get_celld()
    rows = {row for row, _ in cells}
    return [[cells[row, column].get_text().get_text() for column in range(4)] for row in sorted(rows)]


def test_of_few_bodies_statistics_are_written_with_their_errors():
    data = xr.Dataset(
        {
            "mean_velocity": ("oscillator", [1.0, 2.0], {"units": "m s-1", "long_name": "mean velocity"}),
            "mean_velocity_standard_error": ("oscillator", [0.1, np.nan]),
        },
        {"oscillator": ["a", "$b$"]},
    )
    (axes,) = overview(data).axes  # whose network is lost
    assert written(axes) == [
        ["mean velocity", "a", "1.0 ± 0.1", "m s$^{-1}$"],
        ["", r"\$b\$", "2", "m s$^{-1}$"],
    ]
    many = xr.Dataset({"mean_velocity": ("oscillator", np.ones(4))}, {"oscillator": list("abcd")})
    assert labels(overview(many)) == ["mean_velocity"]


def test_of_many_bodies_some_are_drawn():
    shape = {"oscillator": [f"body_{number}" for number in range(100)], "displacement_bin": np.arange(3)}
    density = xr.DataArray(np.ones((100, 3)), shape, name="density_displacement").to_dataset()
    density["displacement_edges"] = ("oscillator", "displacement_edge"), np.tile(np.arange(4.0), (100, 1))
    density["displacement_center"] = ("oscillator", "displacement_bin"), np.tile(np.arange(3.0), (100, 1))
    for name, units in (("displacement_center", "m"), ("density_displacement", "m-1")):
        density[name].attrs["units"] = units
    (axes,) = overview(density).axes
    assert len(axes.lines) == 6


def test_a_sweep_is_drawn_along_its_axis():
    value = ("clearance", "contact"), np.ones((3, 1))
    data = xr.Dataset(
        {"contact_ratio": value, "contact_rate": value}, {"clearance": [0.0, 0.1, 0.2], "contact": ["gap"]}
    )
    figure = overview(data)
    assert [axes.get_xlabel() for axes in figure.axes] == ["clearance", "clearance"]


@pytest.mark.full
def test_files(result, tmp_path):
    before, figure = dict(matplotlib.rcParams), overview(result)
    save_figure(figure, str(tmp_path / "figure.svg"))
    assert (tmp_path / "figure.svg").read_bytes().startswith(b"<?xml")
    assert dict(matplotlib.rcParams) == before
    with pytest.raises(il.InvalidInput, match=r"figure\.txt must end in \.svg"):
        save_figure(figure, str(tmp_path / "figure.txt"))
    with pytest.raises(il.InvalidInput, match="nothing that can be drawn"):
        overview(xr.Dataset())
