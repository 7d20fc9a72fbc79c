"""Plots of impacts: dots over time and over a parameter, distributions beside Rayleigh's law."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

import impactlab as il
from impactlab.plotting.overview import overview

EXACT = il.EventLocated()

LAW = SimpleNamespace(onset_velocity_density=None)


def driven(amplitude):
    """A driven body at a stop."""
    return il.Network(
        {"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        {"stop": il.Contact("a", il.WALL, il.LinearContact(60.0), clearance=0.2)},
        {"a": il.Harmonic(amplitude, frequency=0.8)},
    )


@pytest.fixture
def ax():
    return Figure().subplots()


def dots(axes):
    return [item.get_xydata().T for item in axes.lines]


def run(record, **options):
    return il.simulate(driven(1.0), 12.0, initial="rest", integrator=EXACT, record=record, **options)


def test_impacts_are_dots_over_time(ax):
    data = run(il.Impacts())
    il.plot.impacts(data, ax=ax)
    np.testing.assert_array_equal(dots(ax)[0], [data.impact_time.values, data.impact_closing_velocity.values])
    assert ax.get_ylabel() == "closing velocity (m s$^{-1}$)"
    assert ax.get_xlabel() == "time (s)"
    data.impactlab.plot.impacts("stop", "impulse", ax=ax)
    np.testing.assert_array_equal(dots(ax)[1][1], data.impact_impulse.values)


def test_impacts_of_a_sweep_are_dots_over_its_parameter(ax):
    options = {"duration": 40.0, "integrator": EXACT, "record": il.Impacts(), "initial": "rest"}
    data = il.sweep(driven, {"amplitude": [0.5, 1.0]}, **options)
    il.plot.impacts(data, ax=ax)
    places, velocities = dots(ax)[0]
    assert len(places) == data.impact_series_size.sum()
    assert np.unique(places).tolist() == [0.5, 1.0]
    assert (velocities > 0.0).all()
    assert ax.get_xlabel() == "amplitude"
    il.plot.impacts(data.sel(amplitude=0.5), ax=ax)
    assert ax.get_xlabel() == "time (s)"


def test_distributions_of_impacts_are_drawn_beside_the_exact_law(ax):
    data = run(il.Impacts(bins=8))
    noisy = il.Network(driven(1.0).oscillators, driven(1.0).contacts, {"a": il.WhiteNoise(0.1)})
    law = il.exact(noisy)
    il.plot.impacts(data, reference=law, ax=ax)
    center = data.closing_velocity_center.values[0]
    np.testing.assert_array_equal(dots(ax)[0], [center, data.density_closing_velocity.values[0]])
    np.testing.assert_array_equal(dots(ax)[1][1], law.onset_velocity_density("stop", center))
    assert ax.get_xlabel() == "closing velocity (m s$^{-1}$)"


@pytest.mark.parametrize(
    ("record", "text"),
    [(il.Impacts(), "closing velocity (m s$^{-1}$)"), (il.Impacts(bins=8), "probability density (s m$^{-1}$)")],
)
def test_the_overview_has_impacts(record, text):
    assert text in [axes.get_ylabel() for axes in overview(run(record)).axes]


@pytest.mark.parametrize(
    ("record", "options", "message"),
    [
        ([], {}, r"no impacts with this quantity; .* record=\[il\.Impacts\(\)\]"),
        ([], {"reference": LAW}, r"record=\[il\.Impacts\(bins=…\)\]"),
        (il.Impacts(), {"names": "top"}, "'top' is not in the result; did you mean 'stop'"),
        (il.Impacts(), {"reference": LAW}, "beside a distribution"),
        (il.Impacts(bins=3), {"reference": LAW, "quantity": "impulse"}, "knows the closing_velocity"),
        (il.Impacts(bins=3), {"reference": 1}, "a law that knows the velocities"),
    ],
)
def test_bad_input(record, options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.plot.impacts(run(record), ax=Figure().subplots(), **options)
