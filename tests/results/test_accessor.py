"""The plots of a dataset as its own."""

import inspect

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import impactlab as il
from impactlab.results.dataset import provenance  # which registers it

VALUE = {"units": "1", "long_name": "fraction of time in contact"}


def swept():
    data = {"contact_ratio": (("clearance", "contact"), [[0.3], [0.2], [0.1]], VALUE)}
    return xr.Dataset(data, {"clearance": [0.0, 0.1, 0.2], "contact": ["gap"]})


def test_a_plot_of_a_dataset_is_that_of_the_function():
    assert callable(provenance)
    data = swept()
    own = data.impactlab.plot.sweep("contact_ratio", ax=Figure().subplots())
    other = il.plot.sweep(data, "contact_ratio", ax=Figure().subplots())
    for one, two in zip(own.lines, other.lines, strict=True):
        np.testing.assert_array_equal(one.get_xydata(), two.get_xydata())
    np.testing.assert_array_equal(own.lines[0].get_ydata(), [0.3, 0.2, 0.1])
    assert own.get_ylabel() == other.get_ylabel() == "fraction of time in contact"


def test_all_plots_of_datasets_are_there():
    plots = swept().impactlab.plot
    expected = {
        name for name in il.plot.__all__ if next(iter(inspect.signature(getattr(il.plot, name)).parameters)) == "result"
    }
    assert set(dir(plots)) == expected
    with pytest.raises(AttributeError, match=r"draws no 'network' of a dataset; it draws density, joint_density, "):
        plots.network()
    assert not hasattr(plots, "densty")


def test_nothing_is_drawn_by_importing(run_python):
    code = "import sys, impactlab.results.dataset; print('matplotlib' in sys.modules)"
    assert run_python("-c", code).strip() == "False"
