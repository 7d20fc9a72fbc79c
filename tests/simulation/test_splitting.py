"""A rare event by splitting, with branches of a held run, against its exact probability."""

import math

import numpy as np
import pytest

import impactlab as il


def probability(network, body, level, *, time, stages, realizations, slope, rng):
    """Return the probability that a displacement is above a level at some time, by branching and retiring.

    At the ends of stages realizations are chosen anew, in proportion to ``exp(slope x)`` over what they were chosen
    with before: those that lead to the level branch, others are retired (Del Moral and Garnier, Annals of Applied
    Probability 15, 2005, 2496).

    Parameters
    ----------
    network : Network
    body : str
    level : float
        Displacement (m).
    time : float
        When it is looked at (s).
    stages : int
        Number of equal stages.
    realizations : int
    slope : float
        Logarithmic weight at the end (m-1); those of earlier stages grow linearly with time.
    rng : int

    Returns
    -------
    float
    """
    chosen = np.random.default_rng(rng)
    with il.Run(network, realizations=realizations, rng=rng, interval=time / stages) as run:
        logarithm, slopes = 0.0, slope * np.arange(1, stages + 1) / stages
        before = 0.0
        for stage in range(stages):
            run.advance(time / stages)
            x = run.state["final_displacement"].sel(oscillator=body).values
            weight = slopes[stage] * x - before
            logarithm += math.log(np.mean(np.exp(weight - weight.max()))) + weight.max()
            shares = np.exp(weight - weight.max())
            parents = systematic(shares / shares.sum(), chosen)
            old = run.realizations
            run.branch(old[parents])
            run.retire(old)
            before = slopes[stage] * x[parents]
        return math.exp(logarithm) * float(np.mean((x[parents] > level) * np.exp(-before)))


def systematic(shares, rng):
    """Return which parents have children, each as often as its share of them says, but for less than one."""
    places = (rng.random() + np.arange(len(shares))) / len(shares)
    return np.minimum(np.searchsorted(np.cumsum(shares), places), len(shares) - 1)


@pytest.mark.full
def test_the_probability_of_four_standard_deviations():
    body = il.LinearOscillator.from_frequency(2.0, damping_ratio=2.0)
    network = il.Network({"body": body}, excitations={"body": il.WhiteNoise(1.0)})
    spread = math.sqrt(float(il.exact(network).statistics()["mean_square_displacement"].item()))
    exact = 0.5 * math.erfc(4.0 / math.sqrt(2.0))  # 3.2e-5: one of 31 600 realizations
    options = {"time": 3.0, "stages": 12, "realizations": 2000, "slope": 3.5 / spread}
    found = np.array([probability(network, "body", 4.0 * spread, rng=rng, **options) for rng in range(8)])
    error = found.std(ddof=1) / math.sqrt(len(found))
    assert error < 0.15 * exact
    assert abs(found.mean() - exact) < 3.0 * error
