"""First passage of a linear body, by a held run and its events."""

import math

import numpy as np
import xarray as xr

import impactlab as il


def first_passage(network, body, level, *, realizations, longest, rng=None, initial="rest"):
    """Return when each realization first reaches ``|displacement| = level`` (s), NaN where it does not.

    Parameters
    ----------
    network : Network
    body : str
    level : float
        Displacement (m).
    realizations : int
    longest : float
        Time after which realizations are not followed any more (s).
    rng, initial : optional
        As for `il.simulate`.

    Returns
    -------
    Dataset
        ``first_passage_time`` by ``realization`` (s), and its mean with a standard error.
    """
    passage = il.Event(lambda at: np.abs(at.displacement(body)) - level, direction=1, action="retire")
    with il.Run(
        network, realizations=realizations, rng=rng, initial=initial, duration=longest, events={"passage": passage}
    ) as run:
        run.advance(until=longest)
        events = run.events
    times = np.full(realizations, np.nan)
    times[events["realization"].values] = events["time"].values
    mean = float(np.nanmean(times))
    error = float(np.nanstd(times, ddof=1) / math.sqrt(np.isfinite(times).sum()))
    return xr.Dataset(
        {
            "first_passage_time": ("realization", times, {"units": "s"}),
            "mean_first_passage_time": ((), mean, {"units": "s"}),
            "mean_first_passage_time_standard_error": ((), error, {"units": "s"}),
        }
    )


def test_the_first_passage_of_an_oscillator_from_rest():
    """Against a simulation by itself: exact transitions of the linear body in steps of a hundredth of its period."""
    frequency, ratio, density = 2.0 * math.pi, 0.05, 1.0
    network = il.Network(
        {"body": il.LinearOscillator.from_frequency(frequency, damping_ratio=ratio)},
        excitations={"body": il.WhiteNoise(density)},
    )
    spread = math.sqrt(math.pi * density / (2.0 * ratio * frequency**3))
    found = first_passage(network, "body", 1.5 * spread, realizations=4000, longest=200.0, rng=1)
    assert not np.isnan(found["first_passage_time"].values).any()
    expected, error = by_itself(frequency, ratio, density, 1.5 * spread)
    scatter = math.hypot(error, found["mean_first_passage_time_standard_error"].item())
    assert scatter < 0.03 * expected
    assert abs(found["mean_first_passage_time"].item() - expected) < 3.0 * scatter


def by_itself(frequency, ratio, density, level, steps=128, number=4000):
    """Mean time of first passage and its standard error, at the middle of the step that ends beyond the level."""
    from scipy.linalg import expm, solve_continuous_lyapunov

    step = 2.0 * math.pi / frequency / steps
    matrix = np.array([[0.0, 1.0], [-(frequency**2), -2.0 * ratio * frequency]])
    flow = expm(matrix * step)
    whole = solve_continuous_lyapunov(matrix, -np.diag([0.0, 2.0 * math.pi * density]))
    root = np.linalg.cholesky(whole - flow @ whole @ flow.T)
    rng = np.random.default_rng(5)
    state, times, left = np.zeros((2, number)), np.zeros(number), np.arange(number)
    now = 0
    while left.size:
        state, now = flow @ state + root @ rng.standard_normal((2, left.size)), now + 1
        passed = np.abs(state[0]) >= level
        times[left[passed]] = (now - 0.5) * step
        state, left = state[:, ~passed], left[~passed]
    return times.mean(), times.std(ddof=1) / math.sqrt(number)
