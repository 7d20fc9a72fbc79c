"""Links between coordinates: pairs, and combinations with weights."""

import numpy as np
import pytest

from impactlab.assembly.links import Combinations, Pairs, connected_parts, joined

COUNT = 5
PAIRS = np.array([[0, 1], [5, 2], [3, 1], [4, 5], [0, 1]])
VALUES = np.array([1.0, 2.0, 4.0, 0.5, 3.0])
STRENGTH = np.array([1.0, 10.0, 100.0, 7.0, 3.0])
SYMMETRIC = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, 0.4], [0.1, 0.4, 3.0]])

pairs = Pairs(COUNT, PAIRS)
same = Combinations.of(
    [{slot: w for slot, w in zip(row, (1.0, -1.0), strict=True) if slot < COUNT} for row in PAIRS], COUNT
)
weighted = Combinations.of([{0: 2.0, 2: -0.5, 3: 1.0}, {1: -3.0}], COUNT)


@pytest.mark.parametrize("some", [slice(None), np.array([2, 0]), slice(0), np.array([True, False, True, True, False])])
def test_pairs_are_combinations_with_weights_1_and_minus_1(some):
    one, other = pairs.chosen(some), same.chosen(some)
    strength = STRENGTH[some]
    assert len(one) == len(other) == len(strength)
    for name in ("gap", "squares", "largest"):
        np.testing.assert_allclose(getattr(one, name)(VALUES), getattr(other, name)(VALUES))
    np.testing.assert_allclose(
        one.gap(np.stack([VALUES, -VALUES], axis=1)), other.gap(np.stack([VALUES, -VALUES], axis=1))
    )
    np.testing.assert_allclose(one.gap(np.append(VALUES, 0.0)), other.gap(np.append(VALUES, 0.0)))
    np.testing.assert_allclose(one.springs(strength), other.springs(strength))
    np.testing.assert_allclose(one.pushes(strength), other.pushes(strength))
    np.testing.assert_allclose(one.with_strengths(VALUES, strength), other.with_strengths(VALUES, strength))
    of_rows = (links.with_row_sums(VALUES, strength, 1.0 / VALUES) for links in (one, other))
    np.testing.assert_allclose(*of_rows)
    np.testing.assert_allclose(*(links.mixed(SYMMETRIC, np.array([0, 1, 3])) for links in (one, other)), atol=1e-15)
    for name in ("first", "numbers", "coordinates"):
        assert getattr(one, name)().tolist() == getattr(other, name)().tolist()
    assert one.any(VALUES > 2.0).tolist() == other.any(VALUES > 2.0).tolist()
    assert one.all(VALUES > 2.0).tolist() == other.all(VALUES > 2.0).tolist()
    moving = one.slots < COUNT
    np.testing.assert_allclose(one.others(VALUES)[moving], other.others(VALUES))
    assert connected_parts(one).tolist() == connected_parts(other).tolist()
    for both in zip(one.exchanges(VALUES)[:3], other.exchanges(VALUES)[:3], strict=True):
        assert both[0].tolist() == both[1].tolist()


def test_weights():
    """By dense matrices."""
    w = np.array([[2.0, 0.0, -0.5, 1.0, 0.0], [0.0, -3.0, 0.0, 0.0, 0.0]])
    k = np.diag([7.0, 11.0])
    np.testing.assert_allclose(weighted.gap(VALUES), w @ VALUES)
    np.testing.assert_allclose(weighted.squares(VALUES), np.diagonal(w @ np.diag(VALUES) @ w.T))
    np.testing.assert_allclose(weighted.springs(np.diagonal(k)), w.T @ k @ w)
    np.testing.assert_allclose(weighted.with_strengths(VALUES, np.diagonal(k)), VALUES + np.diagonal(w.T @ k @ w))
    np.testing.assert_allclose(weighted.pushes(np.array([1.0, 2.0])), -w.T @ [1.0, 2.0])
    scale = np.diag(np.sqrt(1.0 / VALUES))
    expected = VALUES + sum(np.abs(scale @ w[[i]].T * k[i, i] @ w[[i]] @ scale).sum(axis=1) for i in range(2))
    np.testing.assert_allclose(weighted.with_row_sums(VALUES, np.diagonal(k), 1.0 / VALUES), expected)
    slots = np.array([0, 2, 3])
    inside = w[:, slots]
    expected = np.diagonal(inside @ (SYMMETRIC - np.diag(np.diagonal(SYMMETRIC))) @ inside.T)
    np.testing.assert_allclose(weighted.mixed(SYMMETRIC, slots), expected)
    np.testing.assert_allclose(weighted.others(VALUES), [1.0 + 0.5, 4.0 + 0.5, 4.0 + 1.0, 0.0])
    assert connected_parts(weighted).tolist() == [0, 1, 0, 0, 2]


def test_what_a_collision_exchanges():
    """Mean energies after an elastic reflection along w, from independent velocities of one degree of freedom each."""
    mass = VALUES
    n = np.array([2.0, 0.0, -0.5, 1.0, 0.0]) / np.sqrt(mass)
    n /= np.linalg.norm(n)
    reflected = (np.eye(COUNT) - 2.0 * np.outer(n, n)) ** 2  # of energies
    found = weighted.exchanges(mass)
    assert np.stack([found.first, found.second, found.rows]).tolist() == [[0, 0, 2], [2, 3, 3], [0, 0, 0]]
    np.testing.assert_allclose(found.share, reflected[found.first, found.second])


def test_joined():
    both = joined(pairs, weighted)
    assert not both.plain
    np.testing.assert_allclose(both.gap(VALUES), np.append(pairs.gap(VALUES), weighted.gap(VALUES)))
    assert joined(pairs, pairs.chosen(slice(1))).plain
