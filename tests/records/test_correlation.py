"""Correlation functions of linear forms, against the exact law of linear motion."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_lyapunov

import impactlab as il

pytestmark = pytest.mark.full

LAGS = np.arange(0.0, 3.01, 0.25)
OF = {"a": "a", "drift": {"a": 1.0, "b": -1.0}, "speed": ("velocity", "b")}
ROWS = np.array([[1.0, 0.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
DRIFT = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-6, 2, -0.5, 0], [2, -4, 0, -0.8]], dtype=float)
"""Of (x, v) with springs of 4 and 2 to the ground and one of 2 between the bodies."""


def coupled():
    bodies = {
        "a": il.LinearOscillator(stiffness=4.0, damping=0.5),
        "b": il.LinearOscillator(stiffness=2.0, damping=0.8),
    }
    link = {"link": il.Coupling("a", "b", il.LinearCoupling(2.0))}
    return il.Network(bodies, couplings=link, excitations={"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(0.3)})


def exact(lags=LAGS):
    covariance = solve_continuous_lyapunov(DRIFT, -2.0 * np.pi * np.diag([0.0, 0.0, 1.0, 0.3]))
    later = np.array([expm(DRIFT * lag) @ covariance for lag in lags])  # (lag, at t + τ, at t)
    return np.einsum("ij,ljk,mk->mil", ROWS, later, ROWS)  # (form, other, lag)


@pytest.fixture(scope="module")
def run():
    return il.simulate(coupled(), 100.0, realizations=256, record=il.Correlation(LAGS, OF), rng=1)


def test_correlations_of_linear_motion(run):
    expected = exact()
    score = (run.correlation - expected) / run.correlation_standard_error
    assert np.abs(score).max() < 4.5
    assert 0.6 < np.sqrt((score**2).mean()) < 1.4
    scale = np.sqrt(np.diagonal(expected[:, :, 0]))
    score = (run.correlation_coefficient - expected / np.outer(scale, scale)[:, :, None]).values
    error = run.correlation_coefficient_standard_error.values
    assert np.abs(score[error > 1e-9] / error[error > 1e-9]).max() < 4.5
    np.testing.assert_allclose(np.diagonal(run.correlation_coefficient[:, :, 0]), 1.0, rtol=1e-12)
    assert run.correlation_coefficient_standard_error[0, 0, 0] < 1e-12


@pytest.mark.filterwarnings("ignore:Too few independent samples")
@pytest.mark.parametrize("realizations", [1, 9])
def test_they_are_those_of_the_paths(realizations):
    """From all pairs of samples, in batches of few realizations as well."""
    record = [il.Correlation(LAGS, OF), il.Trajectory(0.25)]
    ds = il.simulate(coupled(), 40.0, realizations=realizations, record=record, rng=1)
    x, v = ds.displacement.values[:, 1:], ds.velocity.values[:, 1:]
    paths = np.stack([x[..., 0], x[..., 0] - x[..., 1], v[..., 1]])
    for place in range(len(LAGS)):
        first, later = paths[:, :, : paths.shape[2] - place], paths[:, :, place:]
        first, later = (item - item.mean(axis=(1, 2), keepdims=True) for item in (first, later))
        expected = np.einsum("frt,grt->fg", first, later) / first[0].size
        np.testing.assert_allclose(ds.correlation[:, :, place], expected, rtol=1e-9, atol=1e-12)


def test_errors_cover():
    """200 runs: two errors hold 95.4 % of covariances, but for the scatter of about 1 % of this share."""
    lags, hits = (0.0, 0.5, 1.5), []
    expected = exact(lags)
    for rng in range(200):
        ds = il.simulate(coupled(), 20.0, realizations=64, record=il.Correlation(lags, OF), rng=rng)
        hits.append(np.abs(ds.correlation.values - expected) < 2.0 * ds.correlation_standard_error.values)
    assert 0.93 < np.mean(hits) < 0.97


class Breathing(il.Excitation):
    """White noise whose density varies by the period of 2 s."""

    density: float = il.parameter(units="N2 s")

    @staticmethod
    def intensity(time, density):
        return density * (1.0 + 0.8 * math.sin(math.pi * time))


def test_cyclic_correlations():
    """Of a body under noise of a varying density, and a force of the same period."""
    body = il.LinearOscillator(stiffness=9.0, damping=2.0)
    push = il.Source(il.Harmonic(3.0, frequency=np.pi), on="a")
    network = il.Network({"a": body}, excitations={"a": Breathing(1.0), "push": push})
    record = il.Correlation((0.0, 0.5), ("a", ("velocity", "a")), cyclic=2.0, phases=4)
    ds = il.simulate(network, 80.0, realizations=256, record=record, rng=1)
    drift = np.array([[0.0, 1.0], [-9.0, -2.0]])

    def grown(time, state):
        covariance, mean = state[:4].reshape(2, 2), state[4:]
        growth = np.diag([0.0, 2.0 * np.pi * (1.0 + 0.8 * np.sin(np.pi * time))])
        change = drift @ covariance + covariance @ drift.T + growth
        return np.concatenate([change.ravel(), drift @ mean + [0.0, 3.0 * np.sin(np.pi * time)]])

    phases = 20.0 + np.array([0.0, 0.5, 1.0, 1.5])
    states = solve_ivp(grown, (0.0, 22.0), np.zeros(6), t_eval=phases, rtol=1e-9, atol=1e-12).y.T
    for phase, state in enumerate(states):
        score = (ds.cyclic_mean[phase] - state[4:]) / ds.cyclic_mean_standard_error[phase]
        assert np.abs(score).max() < 4.0
        for lag, later in enumerate((np.eye(2), expm(0.5 * drift))):
            expected = (later @ state[:4].reshape(2, 2)).T
            of = ds.isel(cyclic_correlation_phase=phase, cyclic_correlation_lag=lag)
            score = (of.cyclic_correlation - expected) / of.cyclic_correlation_standard_error
            assert np.abs(score).max() < 4.0
    np.testing.assert_allclose(ds.cyclic_correlation_phase, 0.5 * np.pi * np.arange(4))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"lags": (0.0,)}, "at least one of them above 0"),
        ({"lags": (0.5, 0.5)}, "must be different times"),
        ({"lags": (-0.5, 0.5)}, "must be at least 0 s"),
        ({"lags": (0.5, np.sqrt(2.0))}, "whole multiples of a common interval"),
        ({"lags": (1e-5, 1.0)}, "10000 at most"),
        ({"of": "c"}, "no oscillator or contact 'c'"),
        ({"cyclic": 1.0, "phases": 0}, "phases must be at least 1"),
        ({"lags": "abc"}, "must be a list of numbers"),
    ],
)
def test_what_is_wrong_is_named(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(coupled(), 20.0, record=il.Correlation(**{"lags": LAGS, **arguments}), rng=1)
