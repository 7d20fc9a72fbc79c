"""Plots of results, by what is drawn: the data of lines and bands, labels with units."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

import impactlab as il
from impactlab.plotting.density_plots import DECADES

SLOW = 2.0 * np.pi
NETWORK = il.Network(
    {"one": il.LinearOscillator.from_frequency(16.0 * SLOW, 0.1), "two": il.LinearOscillator.from_frequency(SLOW, 0.1)},
    {"gap": il.Contact("one", "two", il.HertzContact(1e4), clearance=0.05)},
    {"one": il.WhiteNoise(16.0), "two": il.WhiteNoise(1.0)},
)
RECORDS = [
    il.Density(bins=40), il.Density("velocity", oscillators=["two"], bins=20), il.JointDensity("one", "two", bins=20),
    il.PeakForces(window=5.0, return_times=(1.0, 5.0)), il.Spectrum(segment=5.0), il.Trajectory(0.01),
]  # fmt: skip
CONTACT_FREE = NETWORK.replace(contacts={"gap": None})


@pytest.fixture(scope="module")
def result():
    return il.simulate(NETWORK, duration=20.0, realizations=64, record=RECORDS, rng=1)


@pytest.fixture(scope="module")
def exact():
    return il.exact(NETWORK)


@pytest.fixture
def ax():
    return Figure().subplots()


def over(clearance, place="middle"):
    """A small dataset as a sweep has it."""
    shape, labels = (len(place), len(clearance), 2), ["a", "b"]
    value = np.arange(np.prod(shape), dtype=float).reshape(shape)
    value[0, -1] = np.nan
    attrs = {"units": "m2", "long_name": "mean square displacement"}
    dims, name = ("place", "clearance", "oscillator"), "mean_square_displacement"
    data = {
        name: (dims, value, attrs),
        f"{name}_standard_error": (dims, 0.1 * value),
        f"{name}_exact": (dims, value + 1),
    }
    coordinates = {"place": place, "clearance": ("clearance", clearance, {"units": "m"}), "oscillator": labels}
    return xr.Dataset(data, coordinates)


def line(axes, label):
    (found,) = (item for item in axes.lines if item.get_label() == label)
    return found.get_xydata().T


def areas(axes):
    return [item for item in axes.collections if isinstance(item, PolyCollection)]


def labels(axes):
    return axes.get_xlabel(), axes.get_ylabel()


def legend(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_new_figures_are_those_of_pyplot_and_the_style_ends(result):
    before = dict(matplotlib.rcParams)
    axes = il.plot.density(result)
    assert isinstance(axes, Axes)
    assert axes.figure.number in pyplot.get_fignums()
    assert dict(matplotlib.rcParams) == before
    pyplot.close(axes.figure)


def test_density_has_a_band_and_the_exact_law(result, exact, ax):
    assert il.plot.density(result, "two", reference=exact, ax=ax) is ax
    two = result.sel(oscillator="two")
    np.testing.assert_array_equal(line(ax, "two"), [two.displacement_center, two.density_displacement])
    np.testing.assert_array_equal(
        line(ax, "exact")[1], exact.bin_density("two", "displacement", two.displacement_edges.values)
    )
    (area,) = areas(ax)
    width = 2.0 * two.density_displacement_standard_error
    ends = area.get_paths()[0].vertices[:, 1]
    assert ends.max() == (two.density_displacement + width).max()
    assert labels(ax) == ("displacement (m)", "probability density (m$^{-1}$)")
    assert legend(ax) == ["two", "exact"]


def test_density_of_what_was_recorded_shows_tails(result, ax):
    il.plot.density(result, quantity="velocity", log=True, ax=ax)
    assert [item.get_label() for item in ax.lines] == ["two"]
    assert labels(ax) == ("velocity (m s$^{-1}$)", "probability density (s m$^{-1}$)")
    assert ax.get_yscale() == "log"
    top = result.density_velocity.max().item()
    assert 0.5 * top * 10.0**-DECADES < ax.get_ylim()[0] < 1e-2 * top
    with pytest.raises(il.InvalidInput, match="'one' was not recorded"):
        il.plot.density(result, "one", "velocity", ax=ax)
    with pytest.raises(il.InvalidInput, match="'tow' is not in the result; did you mean 'two'"):
        il.plot.density(result, "tow", ax=ax)


def test_a_body_that_was_selected(result, ax):
    il.plot.density(result.sel(oscillator="two"), ax=ax)
    assert line(ax, "two").shape == (2, 40)


@pytest.mark.parametrize(("quantities", "lines"), [(("displacement", "velocity"), 1), (("velocity", "velocity"), 0)])
def test_joint_density_of_a_phase_plane(quantities, lines, ax):
    """The contact with a wall closes at a displacement."""
    stop = {"stop": il.Contact("a", il.WALL, il.LinearContact(100.0), clearance=0.5)}
    bodies = dict.fromkeys("ab", il.LinearOscillator.from_frequency(3.0, 0.1))
    network = il.Network(bodies, stop, dict.fromkeys(bodies, il.WhiteNoise(1.0)))
    names = ("a", "a") if lines else ("a", "b")
    record = il.JointDensity(*names, bins=8, limits=((-1.5, 1.5), (-5.0, 5.0)), quantities=quantities)
    run = il.simulate(network, 5.0, realizations=64, record=record, rng=1)
    il.plot.joint_density(run, reference=il.exact(network), ax=ax)
    closing = [item for item in ax.lines if item.get_label() == "stop closes"]
    assert [item.get_xdata()[0] for item in closing] == [0.5] * lines
    units = {"displacement": "m", "velocity": "m s$^{-1}$"}
    for label, name, quantity in zip((ax.get_xlabel(), ax.get_ylabel()), names, quantities, strict=True):
        assert label == f"{quantity} of {name} ({units[quantity]})"


def test_joint_density_shows_where_the_contact_closes(result, exact, ax):
    il.plot.joint_density(result, reference=exact, ax=ax)
    (mesh,) = (item for item in ax.collections if isinstance(item, matplotlib.collections.QuadMesh))
    np.testing.assert_array_equal(np.ma.filled(mesh.get_array(), 0.0), result.joint_density.values.T)
    (closing,) = (item for item in ax.lines if item.get_label() == "gap closes")
    assert closing.get_slope() == 1.0
    assert closing.get_xy1() == (0.0, -0.05)
    assert labels(ax) == ("displacement of one (m)", "displacement of two (m)")
    assert ax.figure.axes[1].get_ylabel() == "joint density (m$^{-2}$)"


def test_spectrum_beside_the_linear_one(result, ax):
    linear = il.exact(CONTACT_FREE)
    il.plot.spectrum(result, "one", reference=linear, ax=ax)
    frequencies = result.displacement_frequency.values[1:]
    value = result.spectrum_displacement.sel(oscillator="one").values[1:]
    np.testing.assert_array_equal(line(ax, "one"), [frequencies, np.where(value > 0.0, value, np.nan)])
    np.testing.assert_array_equal(line(ax, "one, linear")[1], linear.spectrum("one", "displacement", frequencies))
    assert labels(ax) == ("angular frequency (rad s$^{-1}$)", "spectral density (m$^{2}$ s rad$^{-1}$)")
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")


def test_peaks_over_their_return_time(result, exact, ax):
    il.plot.peaks(result, reference=exact, ax=ax)
    times, forces = line(ax, "gap")
    rate = result.crossing_rate.sel(contact="gap")
    at = np.isin(rate.values, 1.0 / times) | np.isclose(rate.values[:, None] * times, 1.0).any(axis=1)
    np.testing.assert_allclose(result.crossing_force.sel(contact="gap").values[at], forces)
    assert times[0] == 1.0 / rate.max()
    of_law, forces_of_law = line(ax, "exact")
    error = result.crossing_rate_standard_error.sel(contact="gap").values[at]
    often = np.isin(forces, forces_of_law) & (1.0 / times > 10.0 * error)  # where counts are nearly normal
    z = (1.0 / times - 1.0 / np.interp(forces, forces_of_law, of_law))[often] / error[often]
    assert np.abs(z).max() < 4.5
    np.testing.assert_allclose(1.0 / of_law[3], exact.crossing_rate("gap", "contact_force", forces_of_law[3]))
    (levels,) = (item for item in ax.containers if len(item[0].get_xdata()) == 2)
    np.testing.assert_array_equal(levels[0].get_ydata(), result.return_level.sel(contact="gap"))
    (dots,) = (item for item in ax.lines if item.get_marker() == "." and len(item.get_xdata()))
    assert dots.get_ydata()[0] == result.window_peak_force.max()
    assert dots.get_xdata()[0] == pytest.approx(
        5.0 * 2 * 64 * 4, rel=0.01
    )  # the largest of 64 realizations of 4 windows
    assert labels(ax) == ("return time (s)", "contact force (N)")


def test_trajectory_shades_contacts(result, ax):
    il.plot.trajectory(result, realization=3, ax=ax)
    path = result.sel(realization=3)
    for name in ("one", "two"):
        np.testing.assert_array_equal(line(ax, name), [path.time, path.displacement.sel(oscillator=name)])
    (shaded,) = areas(ax)
    assert shaded.get_label() == "gap closed"
    closed = path.contact_force.sel(contact="gap").values > 0.0
    begins = closed & ~np.append(False, closed[:-1])
    assert len(shaded.get_paths()) == begins.sum() > 3
    first = shaded.get_paths()[0].get_extents()
    assert first.x0 == pytest.approx(path.time[np.argmax(begins)].item() - 0.005, abs=1e-9)
    assert labels(ax) == ("time (s)", "displacement (m)")


def test_lines_can_be_told_apart_without_colours(result):
    for draw in (il.plot.trajectory, il.plot.density, il.plot.spectrum):
        axes = draw(result, ax=Figure().subplots())
        one, two = axes.lines[:2]
        assert one._dash_pattern != two._dash_pattern
        assert one.get_color() != two.get_color()


@pytest.mark.full
def test_forces_of_rigid_contacts_are_drawn_over_the_intervals_that_they_are_means_of(ax):
    """One impact, at 1.05 s."""
    body = il.LinearOscillator(damping=0.0, stiffness=0.0)
    network = il.Network({"a": body}, {"stop": il.Contact("a", il.WALL, il.RigidContact(0.5), clearance=1.05)})
    begin = {"velocity": {"a": 1.0}}
    plain = il.ExactFlow(measured=False)
    run = il.simulate(network, 2.0, step=0.1, initial=begin, record=il.Trajectory(0.5), integrator=plain)
    (line,) = il.plot.trajectory(run, quantity="contact_force", ax=ax).lines
    assert line.get_drawstyle() == "steps-pre"
    np.testing.assert_allclose(line.get_ydata(), [0.0, 0.0, 0.0, 3.0, 0.0], atol=1e-12)  # 1.5 N s in 0.5 s
    shaded = il.plot.trajectory(run, ax=Figure().subplots()).collections[0].get_paths()[0].vertices[:, 0]
    assert (shaded.min(), shaded.max()) == pytest.approx((1.0, 1.5))


@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_trajectories_of_some_names_are_drawn(ax):
    record = il.Trajectory(0.01, names=["two", "gap"], start=0.5)
    run = il.simulate(NETWORK, 2.0, initial={"velocity": {"two": 3.0}}, record=record, rng=1)
    il.plot.trajectory(run, ax=ax)
    np.testing.assert_array_equal(line(ax, "two"), [run.time, run.displacement[0, :, 0]])
    il.plot.phase_portrait(run, "two", ax=Figure().subplots())
    assert list(il.animate(run).scene.paths) == ["two"]
    with pytest.raises(il.InvalidInput, match="'one' is not in the result"):
        il.plot.trajectory(run, "one")
    run = run.drop_vars("displacement")
    with pytest.raises(il.InvalidInput, match="no trajectories of the displacement"):
        il.plot.phase_portrait(run, "two")


def test_trajectory_of_combinations_and_contacts(result, ax):
    il.plot.trajectory(result, il.Combination({"one": 1.0, "two": -0.5}), "velocity", ax=ax)
    velocity = result.velocity.sel(realization=0)
    expected = velocity.sel(oscillator="one") - 0.5 * velocity.sel(oscillator="two")
    np.testing.assert_allclose(line(ax, "one − 0.5 two")[1], expected)
    assert labels(ax)[1] == "velocity of one − 0.5 two (m s$^{-1}$)"
    forces = il.plot.trajectory(result, "gap", "contact_force", ax=Figure().subplots())
    np.testing.assert_array_equal(line(forces, "gap")[1], result.contact_force.sel(realization=0, contact="gap"))
    assert labels(forces)[1] == "contact force of gap (N)"
    assert not areas(forces)


def test_phase_portrait_marks_contacts(result, ax):
    il.plot.phase_portrait(result, "two", ax=ax)
    path = result.sel(realization=0, oscillator="two")
    np.testing.assert_array_equal(line(ax, "open"), [path.displacement, path.velocity])
    inside = line(ax, "in contact")
    closed = (path.contact_force.sel(contact="gap") > 0.0).values
    assert np.isfinite(inside[0][closed]).all()
    assert np.isnan(inside[0]).any()
    assert labels(ax) == ("displacement of two (m)", "velocity of two (m s$^{-1}$)")


def test_stroboscopic_section_has_the_samples_of_a_period(result, ax):
    il.plot.stroboscopic(result.sel(time=slice(5.0, None)), "two", 0.3, realization=2, ax=ax)
    path = result.sel(realization=2, oscillator="two").isel(time=slice(500, None, 30))
    np.testing.assert_array_equal(ax.lines[0].get_xydata().T, [path.displacement, path.velocity])
    every = il.plot.stroboscopic(result, "two", 0.3, ax=Figure().subplots())
    assert len(every.lines[0].get_xdata()) == 64 * 67
    with pytest.raises(il.InvalidInput, match=r"period of 0\.303 s is no whole number of intervals of 0\.01 s"):
        il.plot.stroboscopic(result, "two", 0.303)


def test_a_settled_motion_is_one_point_not_its_rounding(ax):
    time = np.arange(0.0, 40.0, 0.25)
    x, v = np.sin(2.0 * np.pi * time), np.cos(2.0 * np.pi * time)
    dims = ("time", "oscillator")
    settled = xr.Dataset(
        {"displacement": (dims, x[:, None]), "velocity": (dims, v[:, None])}, {"time": time, "oscillator": ["a"]}
    )
    il.plot.stroboscopic(settled, "a", 1.0, ax=ax)
    path, section = ax.lines
    np.testing.assert_array_equal(path.get_xydata(), np.stack([x, v], axis=1)[-5:])  # of the last period
    assert len(section.get_xdata()) == 40
    assert ax.get_title() == "once in each period of 1 s"
    seldom = il.plot.stroboscopic(settled.isel(time=slice(1, None, 4)), "a", 1.0, ax=Figure().subplots())
    assert np.ptp(seldom.get_xlim()) == pytest.approx(0.2)  # of a displacement of 1
    resting = il.plot.stroboscopic(0.0 * settled, "a", 1.0, ax=Figure().subplots())
    assert resting.get_xlim() == (-1.0, 1.0)


def test_legends_of_motion_are_above_it(result, ax):
    il.plot.trajectory(result, ax=ax)
    ax.figure.canvas.draw()
    assert ax.get_legend().get_window_extent().y0 >= ax.get_window_extent().y1
    assert len(legend(ax)) == 3
    assert il.plot.trajectory(result, "gap", "contact_force", ax=Figure().subplots()).get_legend() is None


def test_a_profile_of_few_has_their_values(ax):
    data = xr.Dataset(
        {"contact_ratio": ("contact", [0.2]), "contact_ratio_standard_error": ("contact", [0.01])}, {"contact": ["gap"]}
    )
    il.plot.profile(data, "contact_ratio", ax=ax)
    assert [item.get_text() for item in ax.texts] == ["0.20 ± 0.01"]
    assert ax.get_ylim()[0] == 0.0


def test_sweep_draws_a_band_for_each_line(ax):
    data = over([0.1, 0.05, 0.2], place=["left", "right"])
    il.plot.sweep(data, "mean_square_displacement", "b", along="clearance", ax=ax)
    right = data.sortby("clearance").sel(place="right", oscillator="b").mean_square_displacement
    np.testing.assert_array_equal(line(ax, "place = right"), [right.clearance, right])
    assert np.isnan(line(ax, "place = left")[1][2])  # the refused point
    exact = [item for item in ax.lines if item.get_color() == "black"]
    np.testing.assert_array_equal(exact[1].get_ydata(), right + 1.0)
    assert areas(ax)[1].get_paths()[0].get_extents().y1 == 1.2 * right.max()
    assert labels(ax) == ("clearance (m)", "mean square displacement of b (m$^{2}$)")
    assert legend(ax) == ["place = left", "place = right", "exact"]
    texts = il.plot.sweep(data, "mean_square_displacement", "b", ax=Figure().subplots())
    assert [item.get_text() for item in texts.get_xticklabels()] == ["left", "right"]
    assert legend(texts)[0] == "clearance = 0.1 m"
    with pytest.raises(il.InvalidInput, match="along: did you mean 'clearance'"):
        il.plot.sweep(data, "mean_square_displacement", along="clearence")


def test_profile_along_a_chain(result, exact, ax):
    il.plot.profile(result, "mean_square_velocity", reference=exact, ax=ax)
    np.testing.assert_array_equal(line(ax, "reference")[1], exact.statistics().mean_square_velocity)
    assert [item.get_text() for item in ax.get_xticklabels()] == ["one", "two"]
    assert labels(ax) == ("oscillator", "mean square velocity (m$^{2}$ s$^{-2}$)")
    many = xr.Dataset({"contact_rate": ("contact", np.arange(30.0))}, {"contact": [f"gap {n}" for n in range(30)]})
    axes = il.plot.profile(many, "contact_rate", ax=Figure().subplots())
    np.testing.assert_array_equal(line(axes, "simulated"), [np.arange(1, 31), np.arange(30.0)])
    assert axes.get_xlabel() == "number of the contact"


@pytest.mark.parametrize(
    ("draw", "error"),
    [
        (il.plot.density, r"no density of the displacement; ask for it with simulate\(…, record=\[il\.Density\(\)\]\)"),
        (lambda data: il.plot.density(data, quantity="velocity"), r"record=\[il\.Density\(quantity='velocity'\)\]"),
        (il.plot.joint_density, r"no joint density; .* record=\[il\.JointDensity\(first, second\)\]"),
        (il.plot.spectrum, r"no spectrum of the displacement; .* record=\[il\.Spectrum\(\)\]"),
        (il.plot.peaks, r"no peak forces; .* record=\[il\.PeakForces\(\)\]"),
        (il.plot.trajectory, r"no trajectories; .* record=\[il\.Trajectory\(interval=…\)\]"),
        (lambda data: il.plot.phase_portrait(data, "one"), "no trajectories"),
        (lambda data: il.plot.stroboscopic(data, "one", 1.0), "no trajectories"),
        (lambda data: il.plot.profile(data, "contact_ration"), "no 'contact_ration'; did you mean 'contact_ratio'"),
        (lambda data: il.plot.sweep(data, "contact_ratio"), r"takes what il\.sweep returned"),
    ],
)
def test_what_is_missing_is_asked_of_a_record(result, draw, error):
    bare = result[["contact_ratio", "mean_square_velocity"]]
    with pytest.raises(il.InvalidInput, match=error):
        draw(bare)


def test_points_of_sweeps_are_selected(result):
    both = xr.concat([result, result], dim="clearance", join="override")
    with pytest.raises(il.InvalidInput, match=r"one over clearance: select a point of it, result\.sel\(clearance=…\)"):
        il.plot.density(both)
    with pytest.raises(il.InvalidInput, match=r"result must be a Dataset, not Network"):
        il.plot.density(NETWORK)
    with pytest.raises(il.InvalidInput, match="There is no realization 64"):
        il.plot.trajectory(result, realization=64)
    with pytest.raises(il.InvalidInput, match="quantity: did you mean 'velocity'"):
        il.plot.trajectory(result, quantity="velocty")
    with pytest.raises(il.InvalidInput, match="ax must be an Axes"):
        il.plot.density(result, ax=Figure())


@pytest.mark.parametrize(
    ("draw", "error"),
    [
        (lambda data: il.plot.density(data, quantity="velocty"), "quantity: did you mean 'velocity'"),
        (lambda data: il.plot.spectrum(data, quantity="velocty"), "quantity: did you mean 'velocity'"),
        (lambda data: il.plot.density(data, 1), "names must be .*, not 1"),
        (lambda data: il.plot.density(data, []), "or a list of names, not"),
        (lambda data: il.plot.trajectory(data, 1), "names must be .*, not 1"),
        (lambda data: il.plot.density(data, reference=data.attrs), "a law that knows densities"),
        (lambda data: il.plot.peaks(data, reference="exact"), "a law that knows how often .* not 'exact'"),
        (lambda data: il.plot.trajectory(data.sel(time=slice(90.0, None))), "Less than two samples are left"),
        (lambda data: il.plot.stroboscopic(data.isel(time=3), "two", 1.0), "Less than two samples are left"),
        (lambda data: il.animate(data.isel(time=[3])), "Less than two samples are left"),
    ],
)
def test_what_cannot_be_drawn_is_told(result, draw, error):
    with pytest.raises(il.InvalidInput, match=error):
        draw(result)
