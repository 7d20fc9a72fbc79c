"""Differences along contacts and sums over them, against a loop in Python, for networks of any kind."""

import numpy as np
import pytest

from impactlab.assembly.incidence import differences, gathering
from impactlab.compiling.single import single
from impactlab.kernels import kick

BODIES = 49  # slot 49 is the wall


def grid(side=7):
    """Bodies row by row; first all contacts along rows, then all across."""
    slots = np.arange(side * side).reshape(side, side)
    along, across = (slots[:, :-1], slots[:, 1:]), (slots[:-1], slots[1:])
    return np.concatenate([np.stack([one.ravel(), two.ravel()], axis=1) for one, two in (along, across)])


def random(contacts=80):
    rng = np.random.default_rng(4)
    return np.array([rng.choice(BODIES + 1, 2, replace=False) for _ in range(contacts)])


GRAPHS = {
    "chain": np.stack([np.arange(48), np.arange(1, 49)], axis=1),
    "chain backwards": np.stack([np.arange(1, 49), np.arange(48)], axis=1),
    "two chains between the same bodies": np.tile(np.stack([np.arange(48), np.arange(1, 49)], axis=1), (2, 1)),
    "grid": grid(),
    "grid in any order": np.random.default_rng(3).permutation(grid()),
    "star": np.stack([np.zeros(48, dtype=np.int64), np.arange(1, 49)], axis=1),
    "star and chain": np.concatenate([[(7, k) for k in range(20, 40)], [(k, k + 1) for k in range(48)]]),
    "random": random(),
    "walls": np.stack([np.arange(49), np.full(49, 49)], axis=1),
    "one": np.array([[3, 40]]),
}


@pytest.fixture(params=["lanes", "one lane"])
def version(request):
    """A kernel and its arrays for blocks, and for a block of one lane."""
    if request.param == "lanes":
        return lambda kernel: kernel, lambda block: block
    return single, lambda block: block[..., 0]


@pytest.mark.full
@pytest.mark.parametrize("name", GRAPHS)
def test_differences_and_sums(name, version):
    """Bit for bit, since terms are added in the order of the contacts."""
    of, seen = version
    ends = GRAPHS[name]
    rng = np.random.default_rng(1)
    x, force = rng.normal(size=(BODIES + 1, 3)), rng.normal(size=(len(ends), 3))
    tables = differences(ends), gathering(ends, BODIES)
    indices = np.concatenate([np.cumsum([2, len(tables[0])]), *tables])
    total, distance = np.full((BODIES + 1, 3), np.nan), np.full((len(ends), 3), np.nan)
    of(kick.gather)(indices, seen(force), seen(total))
    of(kick.differences)(indices, seen(x), seen(distance))
    expected = np.zeros((BODIES + 1, 3))
    for contact, (first, second) in enumerate(ends):
        expected[first] -= force[contact]
        expected[second] += force[contact]
    expected[-1] = 0.0
    np.testing.assert_array_equal(seen(total), seen(expected))
    np.testing.assert_array_equal(seen(distance), seen(x[ends[:, 0]] - x[ends[:, 1]]))


def test_regular_networks_have_loops_of_their_own():
    """A chain is one run of contacts, and one of bodies between its ends; a random network has none."""
    chain, irregular = GRAPHS["chain"], GRAPHS["random"]
    assert differences(chain).tolist() == [1, 0, 0, 0, 1, 48]
    assert gathering(chain, BODIES)[:6].tolist() == [1, 0, 0, 2, 0, 0]
    assert differences(irregular)[:2].tolist() == [0, len(irregular)]
    assert gathering(irregular, BODIES)[0] == 0


def test_tables_are_no_longer_than_the_network():
    """A star of many contacts on one body takes no more memory than a chain."""
    for name in ("chain", "star", "random"):
        ends = GRAPHS[name]
        assert differences(ends).size + gathering(ends, BODIES).size <= 20 + 9 * len(ends) + BODIES
