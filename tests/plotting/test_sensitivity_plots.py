"""Plots of sensitivities."""

import pytest
import xarray as xr
from matplotlib.figure import Figure

import impactlab as il


def result():
    """Indices of two numbers for two bodies, made by hand."""
    dims, name = ("parameter", "oscillator"), "mean_square_displacement_sobol_index"
    variables = {name: (dims, [[0.7, 0.1], [0.2, 0.8]]), f"{name}_standard_error": (dims, [[0.1, 0.02], [0.05, 0.1]])}
    return xr.Dataset(variables, {"parameter": ["stiffness", "clearance"], "oscillator": ["a", "b"]})


def test_sensitivity():
    ax = Figure().subplots()
    il.plot.sensitivity(result(), "mean_square_displacement", ax=ax)
    assert [bar.get_width() for bars in ax.containers[1::2] for bar in bars] == [0.7, 0.2, 0.1, 0.8]
    assert [text.get_text() for text in ax.get_yticklabels()] == ["stiffness", "clearance"]
    one = Figure().subplots()
    il.plot.sensitivity(result(), "mean_square_displacement", "b", ax=one)
    assert [bar.get_width() for bar in one.patches] == [0.1, 0.8]
    with pytest.raises(il.InvalidInput, match="no contact_ratio_sobol_index"):
        il.plot.sensitivity(result(), "contact_ratio", ax=one)
    with pytest.raises(il.InvalidInput, match="There is no oscillator 'c'"):
        il.plot.sensitivity(result(), "mean_square_displacement", "c", ax=one)
