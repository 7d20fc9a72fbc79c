"""Plots of sections."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import impactlab as il


def held(**contact):
    """Points of two realizations, the second of which has fewer."""
    times = np.array([[0.25, 1.5, 2.75], [0.5, 1.0, np.nan]])
    states = np.arange(12.0).reshape(2, 3, 2)
    return xr.Dataset(
        {
            "section_time": (("realization", "section"), times),
            "section_displacement": (("realization", "section", "oscillator"), states),
            "section_velocity": (("realization", "section", "oscillator"), -states),
            **contact,
        },
        {"realization": [0, 1], "oscillator": ["a", "b"]},
    )


def drawn(*arguments, **options):
    axes = il.plot.section(*arguments, **options, ax=Figure().subplots())
    return axes, axes.lines[0].get_xydata().T


def test_a_section_is_in_the_phase_plane_of_a_body():
    axes, (x, v) = drawn(held())
    assert x.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    assert v.tolist() == (-x).tolist()
    assert axes.get_xlabel() == "displacement of a (m)"
    _, (x, _) = drawn(held(), "b", realization=1)
    assert x.tolist() == [7.0, 9.0, 11.0]


def test_a_section_of_a_sweep_is_one_of_its_points():
    swept = held().expand_dims(frequency=[1.0, 2.0])
    with pytest.raises(il.InvalidInput, match=r"for each 'frequency': choose one, as by result.isel\(frequency=0\)"):
        drawn(swept)
    assert len(drawn(swept.isel(frequency=1))[1][0]) == 6


def test_an_impact_map_has_velocities_over_the_phase():
    speed = ("realization", "section"), np.ones((2, 3)), {"long_name": "closing velocity of 'stop' in the section"}
    axes, (phase, v) = drawn(held(section_contact_velocity=speed), period=1.0)
    assert phase[:5].tolist() == [0.25, 0.5, 0.75, 0.5, 0.0]
    assert v.tolist() == [1.0] * 6
    assert axes.get_ylabel() == "closing velocity of stop (m s$^{-1}$)"
    _, (_, v) = drawn(held(section_contact_velocity=speed), "a", 1.0)
    assert v[:3].tolist() == [0.0, -2.0, -4.0]


def test_exponents_settle_within_bands():
    so_far = np.array([[0.3, -0.5], [0.2, -0.4]])
    data = xr.Dataset(
        {
            "lyapunov_exponent": ("exponent", so_far[-1]),
            "lyapunov_exponent_standard_error": ("exponent", [0.01, 0.02]),
            "lyapunov_exponent_so_far": (("time", "exponent"), so_far),
        },
        {"time": [10.0, 20.0], "exponent": [1, 2]},
    )
    axes = il.plot.exponents(data, ax=Figure().subplots())
    assert [line.get_ydata().tolist() for line in axes.lines] == so_far.T.tolist()
    heights = [patch.get_extents().height for patch in axes.patches]
    assert heights[1] / heights[0] == pytest.approx(2.0)
    with pytest.raises(il.InvalidInput, match="holds no exponents along paths"):
        il.plot.exponents(data.drop_vars("lyapunov_exponent_so_far"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: drawn(xr.Dataset()), "no section"),
        (lambda: drawn(held(), "c"), "no oscillator in the section 'c'"),
        (lambda: drawn(held(), realization=5), "no realization 5"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(il.InvalidInput, match=message):
        call()
