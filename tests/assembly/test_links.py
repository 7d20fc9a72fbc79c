"""Links between coordinates: pairs, and combinations with weights."""

import numpy as np
import pytest

from impactlab.assembly.links import Combinations, Pairs, RoundLinks, joined

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
    assert one.parts.tolist() == other.parts.tolist()
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
    assert weighted.parts.tolist() == [0, 1, 0, 0, 2]


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


# x is 2 q0 − q1/2 and y is 3 q1 + q2, around (0.3, −0.4); beside them a link that is not round
PLANE = np.array([[2.0, -0.5, 0.0, 0.0, 0.0], [0.0, 3.0, 1.0, 0.0, 0.0]])
CENTER = np.array([0.3, -0.4])
round_ = RoundLinks(
    COUNT,
    Combinations.of([{4: 1.0}, *({slot: w for slot, w in enumerate(row) if w} for row in PLANE.tolist())], COUNT),
    np.array([0, 1, 1]),
    np.array([0.0, *CENTER]),
    1.0 / VALUES,
)


def test_round_links_have_the_elongation_and_the_rate_of_a_radius():
    speeds = VALUES[::-1].copy()
    place = PLANE @ VALUES - CENTER
    elongations = VALUES[4], np.hypot(*place) - 0.5
    np.testing.assert_allclose(round_.gap(VALUES), elongations)
    np.testing.assert_allclose(round_.gap(np.stack([VALUES, 0.0 * VALUES], axis=1)).T, [elongations, [0.0, 0.0]])
    rate = place @ PLANE @ speeds / np.hypot(*place)
    np.testing.assert_allclose(round_.rates(VALUES, speeds), [speeds[4], rate])
    np.testing.assert_allclose(round_.pushes(np.array([0.0, 2.0])), 2.0 * (CENTER / 0.5) @ PLANE)  # as at rest


def test_round_links_bound_all_radii():
    of_plane = round_.chosen(np.array([1]))
    angles = np.linspace(0.0, np.pi, 1001)
    radii = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ PLANE
    np.testing.assert_allclose(of_plane.squares(VALUES), [(radii**2 @ VALUES).max()], rtol=1e-5)
    springs = of_plane.springs(np.array([7.0]))
    for radius in radii:
        assert np.linalg.eigvalsh(springs - 7.0 * np.outer(radius, radius)).min() > -1e-12


def test_round_links_are_laid_out_with_and_without_masses():
    joint = joined(round_, weighted)
    assert isinstance(joint, RoundLinks)
    table, rounds, centers = joint.laid_out()
    dense = np.zeros((len(table), COUNT))
    dense[table.rows, table.slots] = table.weights
    expected = [np.eye(COUNT)[4], np.zeros(COUNT), *weighted.matrix(np.arange(COUNT)), *PLANE, *(PLANE / VALUES)]
    np.testing.assert_allclose(dense, expected)
    assert rounds.tolist() == [[1, 4, 5]]
    assert centers.tolist() == [CENTER.tolist()]
    assert round_.parts.tolist() == [0, 0, 0, 1, 2]
    assert joint.chosen(np.array([2, 1])).gap(VALUES).tolist() == [weighted.gap(VALUES)[0], round_.gap(VALUES)[1]]
