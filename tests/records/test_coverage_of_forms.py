"""Standard errors of extremes, damage and covariances cover: beside runs of eight times as many realizations."""

import warnings

import numpy as np
import pytest
from impactlab_numerics.trust.networks import CLASSES, scene_of

import impactlab as il


def pair(seed):
    """Two bodies at random that touch, under noise of different temperatures; a period of the slower one."""
    rng = np.random.default_rng(seed)
    slow, fast = np.sort(rng.uniform(3.0, 9.0, 2))
    bodies = {
        name: il.LinearOscillator.from_frequency(frequency, rng.uniform(0.05, 0.3))
        for name, frequency in (("slow", slow), ("fast", fast))
    }
    gap = il.Contact("slow", "fast", il.HertzContact(10.0 ** rng.uniform(2.0, 3.5)), clearance=rng.uniform(-0.1, 0.3))
    noise = {name: il.WhiteNoise(density) for name, density in zip(bodies, rng.uniform(0.2, 2.0, 2), strict=True)}
    return il.Network(bodies, {"gap": gap}, noise), 2.0 * np.pi / slow


def scores(network, time, seed):
    """Differences of a run and a longer one in their common errors, of all that records of forms estimate.

    There are two windows of 8 times some `time` (s) in a realization.
    """
    records = [
        il.Extremes(windows=(8.0 * time,), return_times=(20.0 * time, 50.0 * time)),
        il.Cycles(),
        il.Correlation((0.0, 0.25 * time)),
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.ImpactLabWarning)
        both = [
            il.simulate(network, 16.0 * time, realizations=number, record=records, rng=seed + number)
            for number in (128, 1024)
        ]
    found = []
    for name in ("extreme_mean", "extreme_deviation", "extreme_return_level", "cycle_damage_rate", "correlation"):
        values, errors = ([ds[name + end].values for ds in both] for end in ("", "_standard_error"))
        known = np.hypot(*errors) > 0.0  # not NaN either
        found.append((values[0] - values[1])[known] / np.hypot(*errors)[known])
    return np.concatenate(found)


def cover(found, networks):
    """Whether two errors hold 95 %: within three errors of this share, of five independent numbers a network."""
    assert abs(np.mean(np.abs(found) < 2.0) - 0.954) < 3.0 * np.sqrt(0.954 * 0.046 / (5 * networks))
    assert abs(np.sqrt(np.mean(found**2)) - 1.0) < 3.0 / np.sqrt(2.0 * 5 * networks)


@pytest.mark.full
@pytest.mark.parametrize("networks", [8, pytest.param(60, marks=pytest.mark.full)])
def test_errors_cover_in_random_pairs(networks):
    cover(np.concatenate([scores(*pair(seed), seed) for seed in range(networks)]), networks)


@pytest.mark.campaign
def test_errors_cover_in_random_networks():
    """Of all classes with an exact law."""
    found = []
    for seed in range(30):
        network = scene_of(seed, CLASSES).network
        bodies = [body for body in network.oscillators.values() if isinstance(body, il.Oscillator)]
        slowest = min((body.natural_frequency for body in bodies if body.stiffness > 0.0), default=0.0)
        if slowest:
            found.append(scores(network, 2.0 * np.pi / slowest, seed))
    assert len(found) > 15
    cover(np.concatenate(found), len(found))


def kinetic(velocity):
    return 0.5 * velocity * velocity


def squeezing(force, rate):
    return force * rate * rate


@pytest.mark.campaign
def test_errors_of_observables_and_joint_densities_cover():
    """Of runs of 64 realizations beside those of 512, in random pairs."""
    records = [
        il.Observable("kinetic", kinetic, per="oscillator", units="m2 s-2"),
        il.Observable("squeezing", squeezing, per="contact", units="N m2 s-2"),
        il.JointDensity("slow", "fast", bins=6, limits=((-1.0, 1.0), (-1.0, 1.0))),
    ]
    names, networks = ("mean_kinetic", "mean_squeezing", "joint_density"), 40
    inside = {name: [] for name in names}
    for seed in range(networks):
        network, period = pair(seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", il.ImpactLabWarning)
            both = [
                il.simulate(network, 16.0 * period, realizations=number, record=records, rng=seed + number)
                for number in (64, 512)
            ]
        for name in names:
            values, errors = ([ds[name + end].values for ds in both] for end in ("", "_standard_error"))
            known = values[1] > 0.02 * values[1].max()
            inside[name].append(np.mean(np.abs(values[0] - values[1])[known] < 2.0 * np.hypot(*errors)[known]))
    for name, shares in inside.items():
        assert abs(np.mean(shares) - 0.954) < 3.0 * np.std(shares, ddof=1) / np.sqrt(networks), name
