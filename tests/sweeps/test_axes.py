"""Axes of records in sweeps: the samples that were asked for, numbered where points have axes of their own."""

import concurrent.futures
import math

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from test_fused import driven

import impactlab as il
from impactlab.results.stack import on_own_axes

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")

FREQUENCIES = [0.8, 1.0, 1.3, 1.7]
REFUSED = 1.3


def at_its_period(frequency):
    """A point whose records have axes of their own, or that is refused."""
    if frequency == REFUSED:
        raise il.InvalidInput("refused")
    period, bins = 2.0 * math.pi / frequency, 10 if frequency < 1.0 else 15
    records = [
        il.Trajectory(period / 8), il.Spectrum(segment=10.0 * period, interval=period / 8), il.PeakForces(),
        il.Density(bins=bins, limits=(-3.0, 3.0)),
        il.PhaseMeans("velocity", period=period, phases=8 if bins == 10 else 4),
        il.PhaseDensity("velocity", period=period, phases=2, bins=bins, limits=(-3.0, 3.0)), il.FinalState(),
    ]  # fmt: skip
    periods = 20 if frequency < 1.5 else 30
    return driven(frequency), {
        "duration": periods * period, "spin_up": period, "initial": "rest", "record": records, "step": period / 80,
    }  # fmt: skip


@pytest.fixture(scope="module")
def own():
    return il.sweep(at_its_period, {"frequency": FREQUENCIES}, rng=1)


def test_times_are_those_that_were_asked_for():
    """Although 50 of 50 parts of the interval are not all of it, by rounding."""
    interval = 2.0 * math.pi
    assert interval / 49 * 49 != interval / 50 * 50
    options = {"duration": 9.0 * interval, "initial": "rest", "record": il.Trajectory(interval)}
    ds = il.sweep(lambda steps: (driven(1.0), {"step": interval / steps}), {"steps": [49, 50]}, **options)
    np.testing.assert_array_equal(ds.time, interval * np.arange(10))
    assert np.isfinite(ds.displacement).all()


def test_a_file_of_trajectories_has_the_same_times(tmp_path):
    interval = 0.1
    ds = il.simulate(driven(1.0), 2.1, step=interval / 11, record=il.Trajectory(interval), out=tmp_path / "path.nc")
    np.testing.assert_array_equal(ds.time, interval * np.arange(22))


def test_axes_of_points_are_numbered(own):
    periods = 2.0 * np.pi / own.frequency.where(own.frequency != REFUSED)
    assert own.displacement.dims == ("frequency", "realization", "sample", "oscillator")
    assert own.time.dims == ("frequency", "sample")
    for frequency, period in zip(FREQUENCIES, periods.values, strict=True):
        count = 0 if frequency == REFUSED else 8 * (20 if frequency < 1.5 else 30) + 1
        of_point = own.sel(frequency=frequency)
        np.testing.assert_array_equal(of_point.time[:count], period / 8 * np.arange(count))
        assert of_point.displacement.notnull().sum("sample").values.tolist() == [[count]]
        assert of_point.time.count() == count
    for name, numbers in {"displacement_frequency": 41, "return_time": 3, "velocity_phase": 8}.items():
        assert own[name].dims == ("frequency", f"{name}_number")
        assert own[name].sizes[f"{name}_number"] == numbers
        assert own[name].attrs["units"]
    assert own.density_velocity_phase.dims == ("density_velocity_phase",)  # of which all points have the same
    highest = own.displacement_frequency.isel(displacement_frequency_number=-1)
    np.testing.assert_allclose(highest, 8.0 * np.pi / periods, rtol=1e-14)
    assert own.phase_mean_velocity.sel(frequency=1.0).count() == 4


@pytest.mark.parametrize("frequency", [0.8, 1.7])
def test_a_point_is_what_its_run_gives(own, frequency):
    point = own.sel(frequency=frequency)
    alone, whole = il.rerun(point), on_own_axes(point)
    for name in alone.variables:
        xr.testing.assert_equal(whole[name].variable, alone[name].variable)


@pytest.mark.full
def test_points_one_by_one_and_files_have_the_same(own, tmp_path):
    il.save(own, tmp_path / "sweep.nc")
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        again = il.sweep(at_its_period, {"frequency": FREQUENCIES}, rng=1, executor=pool)
    with xr.open_dataset(tmp_path / "sweep.nc") as stored:
        for other in (again, stored, il.rerun(tmp_path / "sweep.nc")):
            assert other.variables.keys() == own.variables.keys()
            assert other.coords.keys() == own.coords.keys()
            for name in own.variables:
                xr.testing.assert_equal(other[name].variable, own[name].variable)


def test_plots_of_a_point(own):
    point, period = own.sel(frequency=0.8), 2.0 * math.pi / 0.8
    axes = il.plot.stroboscopic(point, "body", period, ax=Figure().subplots())
    assert len(axes.lines[-1].get_xdata()) == 21
    axes = il.plot.trajectory(point, "body", ax=Figure().subplots())
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), period / 8 * np.arange(161))
    axes = il.plot.density(point, ax=Figure().subplots())
    assert len(axes.lines[0].get_xdata()) == 10
    axes = il.plot.spectrum(point, ax=Figure().subplots())
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), point.displacement_frequency[1:])
    il.plot.peaks(point, ax=Figure().subplots())
    part = point.isel(sample=slice(80, None))
    assert len(il.plot.stroboscopic(part, "body", period, ax=Figure().subplots()).lines[-1].get_xdata()) == 11


def test_plots_of_no_point(own):
    with pytest.raises(
        il.InvalidInput, match=r"is one over frequency: select a point of it, result.sel\(frequency=…\)"
    ):
        il.plot.trajectory(own)
    with pytest.raises(il.InvalidInput, match="Nothing was simulated at this point of the sweep: refused"):
        il.plot.density(own.sel(frequency=REFUSED))


@pytest.mark.full
def test_accelerations_of_a_point(own):
    point = own.sel(frequency=0.8)
    xr.testing.assert_allclose(
        il.absolute_acceleration(point).drop_vars("frequency"), il.absolute_acceleration(il.rerun(point))
    )
