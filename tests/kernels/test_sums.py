"""The sums over time and the counts, against the same in NumPy."""

import numpy as np
import pytest

from impactlab.kernels.histogram import count_pairs, count_samples
from impactlab.kernels.sums import (
    CLOSED,
    FLUX,
    FORCE,
    GG,
    GV,
    GX,
    PEAK,
    VV,
    XV,
    XX,
    G,
    V,
    X,
    add_contacts,
    add_kick,
    add_state,
    write_snapshot,
)

BODIES, LANES, STEPS = 3, 11, 4


@pytest.fixture
def states():
    rng = np.random.default_rng(2)
    x, v, force = rng.normal(size=(3, STEPS, BODIES + 1, LANES))
    x[:, -1] = v[:, -1] = 0.0
    return x, v, force


def test_powers_of_state_and_kick(states):
    x, v, force = states
    sums = np.zeros((9, BODIES, LANES))
    coefficients = np.array([[9.0, 0.1], [9.0, 0.2], [9.0, 0.3]])
    for step in range(STEPS):
        add_state(x[step], v[step], sums)
        add_kick(x[step], v[step], force[step], coefficients, 1, sums)
    x, v, g = x[:, :-1], v[:, :-1], force[:, :-1] * coefficients[:, 1, None]
    expected = {X: x, V: v, XX: x * x, XV: x * v, VV: v * v, G: g, GG: g * g, GX: g * x, GV: g * v}
    for row, values in expected.items():
        np.testing.assert_allclose(sums[row], values.sum(axis=0), rtol=1e-13, atol=1e-14)


def test_contacts(states):
    _, v, _ = states
    rng = np.random.default_rng(3)
    indentation = rng.normal(size=(STEPS, 2, LANES))
    force = np.where(indentation > 0.0, 10.0 * indentation, 0.0)
    ends = np.array([[0, 1], [2, 3]])  # the second with the wall
    window = np.array([0.5, 1.0])
    sums = np.zeros((4, 2, LANES))
    for step in range(STEPS):
        add_contacts(v[step], ends, window, indentation[step], force[step], sums)
    closing = v[:, [0, 2]] - v[:, [1, 3]]
    near = np.abs(indentation) < window[:, None]
    np.testing.assert_array_equal(sums[CLOSED], (indentation > 0.0).sum(axis=0))
    np.testing.assert_allclose(sums[FORCE], force.sum(axis=0), rtol=1e-13)
    np.testing.assert_allclose(sums[FLUX], (np.maximum(closing, 0.0) * near).sum(axis=0), rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(sums[PEAK], force.max(axis=0))


def test_snapshots_hold_displacements_velocities_and_forces(states):
    x, v, _ = states
    contact_force = np.arange(2.0 * LANES).reshape(2, LANES)
    snapshots = np.full((2, 2 * BODIES + 2, LANES), np.nan)
    write_snapshot(x[0], v[0], contact_force, snapshots, 1)
    np.testing.assert_array_equal(snapshots[1], np.concatenate([x[0, :-1], v[0, :-1], contact_force]))
    assert np.isnan(snapshots[0]).all()


EDGES = np.linspace(-1.0, 2.0, 7)


def table(samples):
    """Histogram with everything below and above in the first and last bin."""
    return np.histogram(samples, np.concatenate([[-np.inf], EDGES, [np.inf]]))[0]


def test_counts_are_a_histogram_of_every_stride_per_group():
    snapshots = np.random.default_rng(4).normal(size=(10, 3, 6)) * 1.5
    groups = np.array([0, 0, 1, 1, 2, 2])
    counts = np.zeros((3, 8), dtype=np.int64)
    count_samples(snapshots, 1, 3, 2, -1.0, 2.0, groups, counts)
    for group in range(3):
        np.testing.assert_array_equal(counts[group], table(snapshots[1::3, 2][:, groups == group]))


def test_bins_are_closed_below_and_open_above_at_any_distance():
    values = np.array([-1e300, -1.0, -0.5, 1.999, 2.0, 1e300])
    counts = np.zeros((1, 8), dtype=np.int64)
    count_samples(values[None, None], 0, 1, 0, -1.0, 2.0, np.zeros(6, dtype=np.int64), counts)
    assert counts[0].tolist() == [1, 1, 1, 0, 0, 0, 1, 2]


def test_pairs_are_a_histogram_in_two_dimensions():
    snapshots = np.random.default_rng(5).normal(size=(12, 3, 6)) * 1.5
    groups = np.array([0, 1, 0, 1, 0, 1])
    counts = np.zeros((2, 8, 8), dtype=np.int64)
    low, inverse_width = np.array([-1.0, -1.0]), np.array([2.0, 2.0])
    count_pairs(snapshots, 0, 2, np.array([0, 2]), low, inverse_width, 6, groups, counts)
    edges = np.concatenate([[-np.inf], EDGES, [np.inf]])
    for group in range(2):
        own = snapshots[::2][:, :, groups == group]
        place = [np.searchsorted(edges, own[:, q].ravel(), side="right") - 1 for q in (0, 2)]
        expected = np.zeros((8, 8), dtype=int)
        np.add.at(expected, tuple(place), 1)
        np.testing.assert_array_equal(counts[group], expected)
