"""Statistics whose moments nothing else needs: each is one object, summed in the loop and known to exact laws."""

import numpy as np
import pytest
from scenes import base

import impactlab as il
from impactlab.results.schema import BODY, CONTACT, STATISTICS, Sampled

CUBE = Sampled(
    "mean_cube_contact_force", CONTACT, "N3", "mean cube of the contact force",
    sample=lambda indentation, force: force**3, event=lambda closing: closing.impulse**3 / closing.duration**2,
)  # fmt: skip
SPEED = Sampled("mean_speed", BODY, "m s-1", "mean speed", sample=lambda x, v: np.abs(v))


@pytest.fixture(autouse=True)
def _known(monkeypatch):
    for statistic in (CUBE, SPEED):
        monkeypatch.setitem(STATISTICS, statistic.name, statistic)


@pytest.mark.full
@pytest.mark.parametrize("realizations", [pytest.param(1, marks=pytest.mark.campaign), 64])
def test_samples_agree_with_the_exact_law(realizations):
    result = il.simulate(base(), 6400.0 / realizations, realizations=realizations, rng=3)
    table = il.compare(result, il.exact(base())).to_dataframe().set_index("statistic")
    for name, labels in ((CUBE.name, 1), (SPEED.name, 2)):
        assert table.loc[[name]].z.abs().max() < 4.0
        assert (result[name] > 20.0 * result[f"{name}_standard_error"]).all()
        assert result[name].size == labels
    assert (result.direct_mean_speed_standard_error > 0.0).all()


@pytest.mark.campaign
@pytest.mark.parametrize("method", [il.ExactFlow(), il.RungeKutta4()], ids=["kicks", "without kicks"])
def test_the_trapezoidal_rule_is_that_of_a_transient(method):
    """A swing from the greatest displacement to rest: the way over the time, with half of the states at both ends."""
    network = il.Network(oscillators={"mass": il.LinearOscillator(mass=2.0, damping=0.0, stiffness=8.0)})
    options = {
        "initial": {"displacement": {"mass": 3.0}},
        "rng": 1,
        "integrator": method,
        "step": np.pi / 400,
        "realizations": 2,
    }
    result = il.simulate(network, np.pi / 4, **options)
    np.testing.assert_allclose(result.mean_speed, 3.0 / (np.pi / 4), rtol=1e-4)
