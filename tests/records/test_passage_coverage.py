"""Intervals of two standard errors of first passages hold what they should: for known laws, and in random networks."""

import math

import numpy as np
import pytest

import impactlab as il
from impactlab.statistics.survival import Survival

HORIZON = 1.5


def coverage(inside):
    return 100.0 * np.mean(inside)


def within(found, expected):
    return np.abs(found.value - expected) <= 2.0 * found.error


@pytest.mark.parametrize("realizations", [100, 1000])
def test_intervals_of_exponential_times(realizations):
    random, inside = np.random.default_rng(realizations), {"survival": [], "hazard": [], "restricted": [], "mean": []}
    grid, edges = np.linspace(0.1, HORIZON, 8), np.linspace(0.0, HORIZON, 6)
    for _ in range(1000):
        times = random.exponential(size=realizations)
        found = Survival(np.where(times <= HORIZON, times, np.nan), HORIZON)
        inside["survival"].append(within(found.probability(grid), np.exp(-grid)))
        inside["hazard"].append(within(found.hazard(edges), 1.0))
        inside["restricted"].append(within(found.restricted_mean(), 1.0 - math.exp(-HORIZON)))
        inside["mean"].append(within(Survival(times, math.inf).mean(), 1.0))
        assert math.isnan(found.mean().value)
    assert all(93.0 <= coverage(values) <= 97.0 for values in inside.values()), {
        name: coverage(values) for name, values in inside.items()
    }


def random_network(random):
    """A body with a spring, a cubic term or a stop, at any damping, and limits that it leaves after some periods."""
    damping = 10.0 ** random.uniform(-1.3, 0.7)
    kind = random.integers(3)
    cubic = random.uniform(0.1, 2.0) if kind == 1 else 0.0
    body = il.DuffingOscillator(mass=1.0, damping=damping, stiffness=1.0, cubic=cubic)
    stop = il.Contact("a", il.WALL, il.HertzContact(10.0 ** random.uniform(0.0, 3.0)), clearance=0.5)
    network = il.Network({"a": body}, {"stop": stop} if kind == 2 else {}, {"a": il.WhiteNoise(damping / math.pi)})
    high = 0.8 if kind == 2 else random.uniform(1.0, 2.0)
    return network, (-random.uniform(1.0, 2.0), high)


def passages(random, realizations, rng):
    """Whether intervals hold what the Fokker–Planck equation says: of the mean, survival and late hazard."""
    network, limits = random_network(random)
    solved = il.fokker_planck(network, absorb={"a": limits}, tolerance=1e-3)
    horizon = 1.5 * solved.mean_passage_time().item()
    record = il.FirstPassage({"a": limits}, intervals=15)
    found = il.simulate(network, horizon, realizations=realizations, initial="rest", record=record, rng=rng)
    times = found.survival_time.values[3::3]
    fine = np.linspace(0.0, horizon, 2001)
    expected = {
        "survival": solved.survival(times),
        "restricted_mean_passage_time": np.trapezoid(solved.survival(fine), fine),
    }
    values = {"survival": found.survival[3::3], "restricted_mean_passage_time": found.restricted_mean_passage_time}
    errors = {name: found[f"{name}_standard_error"] for name in values}
    errors["survival"] = errors["survival"][3::3]
    return {name: np.abs(np.asarray(values[name]) - expected[name]) / np.asarray(errors[name]) for name in values}


@pytest.mark.full
def test_some_random_networks():
    random = np.random.default_rng(1)
    found = [passages(random, 400, rng) for rng in range(4)]
    assert max(float(np.max(z)) for item in found for z in item.values()) < 4.0


@pytest.mark.campaign
def test_coverage_in_random_networks():
    """Two errors hold 95 %: within three errors of this share, of one independent number a network."""
    random, networks = np.random.default_rng(2), 20
    found = [passages(random, 400, rng) for rng in range(networks)]
    for name in found[0]:
        inside = np.mean([np.mean(item[name] <= 2.0) for item in found])
        assert abs(inside - 0.954) < 3.0 * math.sqrt(0.954 * 0.046 / networks), name
        assert max(float(np.max(item[name])) for item in found) < 5.0, name
