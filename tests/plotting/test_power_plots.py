"""Plots of energy flows and of quantities of one's own."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import impactlab as il


def flows():
    return xr.Dataset(
        {
            "power_in": ("source", [3.0, 1.0]),
            "power_in_standard_error": ("source", [0.0, 0.0]),
            "power_dissipated": ("oscillator", [2.0, 2.0]),
            "power_dissipated_standard_error": ("oscillator", [0.1, 0.1]),
            "contact_power_carried": ("contact", [1.0]),
        },
        {"source": ["a", "b"], "oscillator": ["a", "b"], "contact": ["gap"]},
    )


def test_powers_are_bars_with_names():
    axes = il.plot.powers(flows(), ax=Figure().subplots())
    assert [bar.get_width() for bar in axes.patches] == [3.0, 1.0, 2.0, 2.0, 1.0]
    names = [text.get_text() for text in axes.get_yticklabels()]
    assert names == ["given: a", "given: b", "lost: a", "lost: b", "carried: gap"]


def test_the_density_of_a_quantity():
    data = xr.Dataset(
        {
            "density_work_rate": (("work_rate_contact", "work_rate_bin"), [[0.25, 0.75]]),
            "work_rate_edges": (("work_rate_contact", "work_rate_edge"), [[-1.0, 0.0, 1.0]], {"units": "W"}),
        },
        {"work_rate_contact": ["gap"]},
    )
    axes = il.plot.observable(data, "work rate", ax=Figure().subplots())
    np.testing.assert_allclose(axes.lines[0].get_xydata(), [[-0.5, 0.25], [0.5, 0.75]])
    assert axes.get_xlabel() == "work rate (W)"


def test_other_results_have_no_such_plots():
    with pytest.raises(il.InvalidInput, match="EnergyFlows"):
        il.plot.powers(xr.Dataset(), ax=Figure().subplots())
    with pytest.raises(il.InvalidInput, match="Observable"):
        il.plot.observable(xr.Dataset(), "power", ax=Figure().subplots())
