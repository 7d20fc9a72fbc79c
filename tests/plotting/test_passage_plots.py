"""Plots of first passages."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import impactlab as il


class Decay:
    def survival(self, time, displacement=0.0, velocity=0.0):
        return np.exp(-np.asarray(time)) * (1.0 + displacement)


def result():
    times = np.linspace(0.0, 2.0, 5)
    return xr.Dataset(
        {
            "survival": ("survival_time", np.exp(-times)),
            "survival_standard_error": ("survival_time", np.full(5, 0.01)),
        },
        {"survival_time": times},
    )


def test_survival_with_its_band_and_a_reference():
    axes = il.plot.survival(result(), reference=Decay(), start=(1.0, 0.0), log=True, ax=Figure().subplots())
    simulated, dashed = axes.lines
    np.testing.assert_allclose(2.0 * simulated.get_ydata(), dashed.get_ydata())
    assert axes.get_yscale() == "log"
    assert len(axes.collections) == 1
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["simulated", "Fokker–Planck"]


def test_other_results_are_refused():
    with pytest.raises(il.InvalidInput, match="FirstPassage"):
        il.plot.survival(xr.Dataset(), ax=Figure().subplots())
    with pytest.raises(il.InvalidInput, match="a solution that knows survival"):
        il.plot.survival(result(), reference=1.0, ax=Figure().subplots())
