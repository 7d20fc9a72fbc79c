"""Plots of fragilities."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import impactlab as il

SCALES = np.array([1.0, 2.0, 3.0])


def result():
    """A fragility of five records, made by hand."""
    peaks = 0.01 * np.arange(1.0, 6.0)[None, :, None] * SCALES
    fraction = np.array([[0.0, 0.4, 0.8]])
    names = ("probability", "fitted_probability")
    bands = {name + end: (("state", "scale"), fraction) for name in names for end in ("", "_low", "_high")}
    curves = np.quantile(peaks, [0.16, 0.5, 0.84], axis=1).swapaxes(0, 1)
    return xr.Dataset(
        {
            **bands,
            "peak": (("demand", "record", "scale"), peaks),
            "peak_quantile": (("demand", "quantile", "scale"), curves),
        },
        {
            "scale": ("scale", SCALES, {"units": "m s-2", "long_name": "peak acceleration"}),
            "demand": ["top"],
            "demand_units": ("demand", ["m"]),
            "quantile": [0.16, 0.5, 0.84],
            "state": ["top ≥ 0.05 m"],
            "state_demand": ("state", ["top"]),
            "level": ("state", [0.05]),
        },
    )


def test_fragility():
    ax = Figure().subplots()
    il.plot.fragility(result(), ax=ax)
    assert ax.lines[-1].get_label() == "top ≥ 0.05 m"
    assert ax.lines[-1].get_ydata().tolist() == [0.0, 0.4, 0.8]
    assert ax.get_xlabel() == "peak acceleration (m s$^{-2}$)"


def test_incremental():
    ax = Figure().subplots()
    il.plot.incremental(result(), "top", ax=ax)
    assert ax.lines[0].get_xdata() == pytest.approx(0.01 * SCALES)
    assert ax.lines[6].get_xdata() == pytest.approx(0.03 * SCALES)
    assert ax.get_xlabel() == "peak of top (m)"
    with pytest.raises(il.InvalidInput, match="demand 'base'"):
        il.plot.incremental(result(), "base", ax=ax)
    with pytest.raises(il.InvalidInput, match="This is no result"):
        il.plot.fragility(xr.Dataset(), ax=ax)
