"""Statistics as objects."""

import numpy as np
import pytest
from scenes import base

import impactlab as il
from impactlab.results.schema import BODY, STATISTICS, Statistic

KINETIC = Statistic(
    "mean_kinetic_energy", BODY, "J", "mean kinetic energy", formed=lambda bodies: 0.5 * bodies.mass * bodies.vv
)


@pytest.fixture
def result(monkeypatch):
    """A run that knows one more statistic."""
    monkeypatch.setitem(STATISTICS, KINETIC.name, KINETIC)
    return il.simulate(base(), 20.0, realizations=64, rng=1, record=il.PerRealization())


def test_a_statistic_is_added_by_one_object(result):
    np.testing.assert_allclose(result.mean_kinetic_energy, 0.5 * result.mean_square_velocity, rtol=1e-12)
    error = result[result.mean_kinetic_energy.attrs["ancillary_variables"]]
    np.testing.assert_allclose(error, 0.5 * result.mean_square_velocity_standard_error, rtol=1e-9)
    assert result.direct_mean_kinetic_energy.attrs == {
        "units": "J", "long_name": "mean kinetic energy: plain mean", "ancillary_variables": "direct_" + error.name,
    }  # fmt: skip
    assert result.mean_kinetic_energy_by_realization.dims == ("realization", "oscillator")


def test_the_exact_law_a_comparison_and_the_jackknife_know_it_then(result):
    table = il.compare(result, il.exact(base())).to_dataframe().query("statistic == 'mean_kinetic_energy'")
    assert table.units.tolist() == ["J", "J"]
    assert (abs(table.z) < 4.0).all()
    temperature = il.jackknife(result, lambda s: 2.0 * s.mean_kinetic_energy)
    np.testing.assert_allclose(temperature.value, result.mean_square_velocity, rtol=1e-6)
