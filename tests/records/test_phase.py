"""Statistics over the cycle of a periodic force."""

import numpy as np
import pytest
from scipy.stats import norm

import impactlab as il

PERIOD, AMPLITUDE, DENSITY = 0.8, 3.0, 0.5


def driven(**fields):
    """A body under noise and a harmonic force."""
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)
    force = il.Harmonic(amplitude=AMPLITUDE, frequency=2.0 * np.pi / PERIOD)
    return il.Network({"a": body}, **fields, excitations={"a": il.WhiteNoise(DENSITY), "b": il.Source(force, on="a")})


def test_means_of_a_linear_body():
    """The mean is the response to the force, the variance that of the noise alone, at every phase."""
    network = driven()
    records = [
        il.PhaseMeans(period=PERIOD),
        il.PhaseMeans("velocity", period=PERIOD),
        il.PhaseDensity(period=PERIOD, bins=40),
    ]
    ds = il.simulate(network, 80.0, realizations=128, rng=1, record=records)
    body, frequency = network.oscillators["a"], 2.0 * np.pi / PERIOD
    transfer = AMPLITUDE / (body.stiffness - body.mass * frequency**2 + 1j * body.damping * frequency)
    heat = np.pi * DENSITY / body.damping
    phases = ds.displacement_phase.values
    assert phases == pytest.approx(2.0 * np.pi * np.arange(16) / 16)
    rotating = transfer * np.exp(1j * phases)
    scores = []
    for q, mean, variance in (
        ("displacement", rotating.imag, heat / body.stiffness),
        ("velocity", (1j * frequency * rotating).imag, heat),
    ):
        for name, expected in (("mean", mean), ("variance", variance)):
            value, error = (ds[f"phase_{name}_{q}{ending}"].values[:, 0] for ending in ("", "_standard_error"))
            scores.append((value - expected) / error)
    assert np.abs(scores).max() < 4.0
    assert 0.4 < np.std(scores) < 1.6  # neighbouring phases are alike
    edges = ds.phase_displacement_edges.values[0]
    middle = (transfer * np.exp(1j * ds.density_displacement_phase.values)).imag
    law = norm(middle[:, None], np.sqrt(heat / body.stiffness))
    expected = np.diff(law.cdf(edges), axis=1) / np.diff(edges)
    value, error = (ds[f"phase_density_displacement{ending}"].values[:, 0] for ending in ("", "_standard_error"))
    seen = expected > 0.02 * expected.max()
    score = (value - expected)[seen] / error[seen]
    assert np.abs(score).max() < 4.5
    assert 0.8 < np.sqrt(np.mean(score**2)) < 1.25


@pytest.mark.full
@pytest.mark.parametrize(("realizations", "duration"), [(3, 800.3), (64, 10.3)])
def test_they_are_those_of_the_paths(realizations, duration):
    """Of a body at a stop, with as many samples as the run has, in batches of a realization as in realizations."""
    stop = {"stop": il.Contact("a", il.WALL, il.LinearContact(1000.0), clearance=0.1)}
    records = [
        il.PhaseMeans(period=PERIOD, phases=8),
        il.PhaseMeans("contact_force", period=PERIOD, phases=8),
        il.PhaseDensity(period=PERIOD, phases=4, bins=10, limits=(-1.0, 1.0)),
        il.Trajectory(PERIOD / 8.0),
    ]
    ds = il.simulate(driven(contacts=stop), duration, realizations=realizations, rng=1, record=records)
    samples = np.arange(1, ds.sizes["time"])
    for q, known in (("displacement", "oscillator"), ("contact_force", "contact")):
        path = ds[q].isel({known: 0}).values[:, 1:]
        for phase in range(8):
            values = path[:, samples % 8 == phase]
            assert float(ds[f"phase_mean_{q}"][phase, 0]) == pytest.approx(values.mean(), rel=1e-12)
            assert float(ds[f"phase_variance_{q}"][phase, 0]) == pytest.approx(values.var(), rel=1e-9)
    path = ds.displacement.values[:, 1:, 0]
    for phase in range(4):
        counts = np.histogram(path[:, samples % 8 == 2 * phase], np.linspace(-1.0, 1.0, 11), density=True)[0]
        np.testing.assert_allclose(ds.phase_density_displacement.values[phase, 0], counts, rtol=1e-12)


def test_names_that_are_not_there_are_refused():
    with pytest.raises(il.InvalidInput, match="there is no label 'c'"):
        il.simulate(driven(), 10.0, record=il.PhaseMeans(period=PERIOD, labels=("c",)))
    with pytest.raises(il.InvalidInput, match="list of strings"):
        il.simulate(driven(), 10.0, record=il.PhaseMeans(period=PERIOD, labels="a"))
    with pytest.raises(il.InvalidInput, match=r"PhaseMeans\.quantity"):
        il.PhaseMeans("force", period=PERIOD)
