"""The random numbers: known answers, addressing, distribution, independence."""

import math

import numba
import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import chi2, kstest, norm

from impactlab.integrators.arguments import Noise
from impactlab.kernels.random import (
    fill_normals,
    fill_steps,
    normal_pair,
    normals_of,
    philox_words,
    stream,
)

SEED = (1, 2)
SIGMAS = 4.5  # a two-sided chance of 7e-6 for each number that is tested


def words_of(counters_and_keys):
    rows = np.atleast_2d(np.array(counters_and_keys, dtype=np.uint64))
    words = np.empty((len(rows), 4), dtype=np.uint64)
    philox_words(rows, words)
    return words


def counters(seed, name, purpose, realizations, blocks):
    """Counter and key of every (block, realization), as the module's docstring lays them out."""
    low, high, word = stream(seed, name, purpose)
    return [[n & 0xFFFFFFFF, n >> 32, k, word, low, high] for n in blocks for k in realizations]


def radius_and_angle(a, b):
    """Box-Muller's radius and angle of words a and b, by the numpy library's functions."""
    a, b = np.asarray(a, dtype=np.uint64), np.asarray(b, dtype=np.uint64)
    uniform = (a.astype(float) + 0.5) / 2.0**32
    angle = ((b >> 10).astype(float) + 0.5) / 2.0**22 * (np.pi / 2)
    return np.sqrt(-2.0 * np.log(uniform)), angle, b >> 8 & 1, b >> 9 & 1


def reference_pair(a, b):
    radius, angle, first, second = radius_and_angle(a, b)
    return np.where(first, -1, 1) * radius * np.cos(angle), np.where(second, -1, 1) * radius * np.sin(angle)


@numba.njit
def pairs(a, b, result):
    for i in range(a.size):
        result[0, i], result[1, i] = normal_pair(a[i], b[i])


def normal_pairs(a, b):
    a, b = np.broadcast_arrays(np.asarray(a, dtype=np.uint32), np.asarray(b, dtype=np.uint32))
    result = np.empty((2, a.size))
    pairs(a.ravel().copy(), b.ravel().copy(), result)
    return result


# known answers


@pytest.mark.parametrize(
    ("counter", "key", "answer"),
    [
        ([0] * 4, [0] * 2, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_words_are_the_known_answers_of_random123(counter, key, answer):
    assert words_of([*counter, *key])[0].tolist() == answer


FROZEN = {  # (realization, block): four normals of the stream (SEED, "body", "noise")
    (0, 0): "0x1.0e1b820000000p-3 0x1.a83ea00000000p-1 -0x1.a6b6980000000p-4 0x1.f7ed4a0000000p-1",
    (0, 1): "0x1.5a472e0000000p-2 -0x1.c30d080000000p-1 -0x1.9a9f640000000p-3 -0x1.6e75de0000000p-2",
    (1, 0): "0x1.2b32940000000p-2 0x1.09a2ba0000000p-2 0x1.1ba7ba0000000p-3 0x1.8418000000000p-5",
    (2**32 - 1, 0): "-0x1.18b9ea0000000p+1 0x1.ee5bfc0000000p-3 -0x1.bfd38c0000000p-1 0x1.11a1680000000p-2",
    (7, 2**40 + 5): "-0x1.70cd6a0000000p-1 -0x1.8b13220000000p-2 -0x1.0d18160000000p+0 0x1.14fb340000000p-1",
}


@pytest.mark.parametrize(("address", "answer"), FROZEN.items(), ids=str)
def test_numbers_never_change(address, answer):
    realization, block = address
    normals = normals_of(SEED, "body", "noise", np.array([realization]), block, 1)[:, 0]
    assert normals.tolist() == [float.fromhex(number) for number in answer.split()]


def test_streams_never_change():
    assert stream(SEED, "body", "noise") == (16248576, 662533967, 575698678)


@pytest.mark.parametrize("block", [0, 2**32 - 2, 2**55 + 2**33 + 1])
def test_normals_are_box_muller_of_the_addressed_words(block):
    realizations = np.array([0, 1, 5, 2**31, 2**32 - 1])
    normals = normals_of((3, 2**64 - 1), "ä", "noise", realizations, block, 3).reshape(3, 2, 2, -1)
    words = words_of(counters((3, 2**64 - 1), "ä", "noise", realizations.tolist(), range(block, block + 3)))
    words = words.reshape(3, len(realizations), 2, 2)
    expected = np.moveaxis(np.array(reference_pair(words[..., 0], words[..., 1])), (0, 3), (2, 1))
    np.testing.assert_allclose(normals, expected, rtol=0.0, atol=3e-6)


# polynomials


@pytest.mark.full
def test_polynomials_at_every_magnitude_of_the_radius():
    rng = np.random.default_rng(5)
    a = np.concatenate([rng.integers(0, 2**bits, 20000) for bits in range(1, 33)])
    a = np.concatenate([a, 2**32 - 1 - a])
    b = rng.integers(0, 2**32, a.size)
    difference = normal_pairs(a, b) - np.array(reference_pair(a, b))
    radius = radius_and_angle(a, b)[0]
    assert np.abs(difference / radius).max() < 5e-7


@pytest.mark.full
def test_polynomials_at_every_angle():
    b = np.arange(0, 2**32, 1 << 12) + 0x355  # every fourth of 2^22 angles
    first, second = normal_pairs(2**31, b)
    expected = reference_pair(2**31, b)
    assert np.abs(first - expected[0]).max() < 5e-7
    assert np.abs(second - expected[1]).max() < 5e-7


def test_extreme_words():
    ends = [0, 2**32 - 1]
    a, b = np.repeat(ends, 2), np.tile(ends, 2)
    normals = normal_pairs(a, b)
    assert np.isfinite(normals).all()
    radius = radius_and_angle(a, b)[0]
    np.testing.assert_allclose(normals / radius, np.array(reference_pair(a, b)) / radius, rtol=0.0, atol=1e-6)
    largest = np.abs(normal_pairs(0, np.arange(0, 2**32, 1 << 20))).max()
    assert 6.7 < largest <= math.sqrt(2.0 * 33.0 * math.log(2.0)) * (1.0 + 1e-6)


# distribution


def exceedance(level, angle):
    """Exact probability of ``radius cos(angle) > level`` for 32 bits of radius."""
    count = np.ceil(np.exp(-0.5 * (level / np.cos(angle)) ** 2) * 2.0**32 - 0.5)
    return np.maximum(count, 0.0) / 2.0**32


@pytest.mark.full
@pytest.mark.parametrize(("level", "tolerance"), [(3.0, 1e-6), (4.0, 1e-5), (5.0, 2e-4), (6.0, 1e-2)])
def test_exact_tail_of_the_discrete_construction(level, tolerance):
    angle = (np.arange(2**22) + 0.5) / 2.0**22 * (np.pi / 2)
    tail = 0.5 * exceedance(level, angle).mean()  # one of two signs
    assert tail == pytest.approx(norm.sf(level), rel=tolerance)


@pytest.mark.parametrize("level", [5.0, 5.5, 6.0])
def test_kernel_has_the_exact_tail(level):
    """All words that can exceed a level, for 256 of the angles, against the formula."""
    reach = int(math.exp(-0.5 * level**2) * 2.0**32) + 256
    radius, angle = np.meshgrid(np.arange(reach), np.arange(8192, 2**22, 16384), indexing="ij")
    first, second = normal_pairs(radius, angle << 10)
    angles = (angle[0] + 0.5) / 2.0**22 * (np.pi / 2)
    for normals, own in ((first, angles), (second, np.pi / 2 - angles)):
        expected = np.rint(exceedance(level, own) * 2.0**32).sum()
        assert abs((normals > level).sum() - expected) <= 1e-5 * expected + 1  # rounding at the level itself


def test_tails_of_many_normals():
    levels = np.array([3.0, 4.0, 5.0])
    blocks, lanes = 300, 2**16
    above, below = np.zeros(3), np.zeros(3)
    normals = np.empty((4, 1, lanes), dtype=np.float32)
    address = np.array([stream(SEED, "tails", "noise")], dtype=np.uint64).T.copy()
    for block in range(blocks):
        fill_normals(address, np.arange(lanes, dtype=np.uint32), np.uint64(block), normals)
        far = normals[np.abs(normals) > levels[0]]
        above += (far[:, None] > levels).sum(axis=0)
        below += (far[:, None] < -levels).sum(axis=0)
    expected = 4 * blocks * lanes * norm.sf(levels)
    assert (np.abs(above - expected) < SIGMAS * np.sqrt(expected)).all()
    assert (np.abs(below - expected) < SIGMAS * np.sqrt(expected)).all()


@pytest.fixture(scope="module")
def normals():
    """[block, member, lane]: 2^24 normals."""
    return normals_of(SEED, "body", "noise", np.arange(2**12), 0, 2**10).reshape(-1, 4, 2**12).astype(float)


@pytest.mark.full
@pytest.mark.parametrize("order", range(1, 9))
def test_moments(normals, order):
    def moment(k):
        return float(math.prod(range(k - 1, 0, -2))) if k % 2 == 0 else 0.0

    sample = normals[:256]
    error = math.sqrt((moment(2 * order) - moment(order) ** 2) / sample.size)
    assert abs((sample**order).mean() - moment(order)) < 4.0 * error


@pytest.mark.parametrize("member", range(4))
def test_kolmogorov_smirnov(normals, member):
    assert kstest(normals[:64, member].ravel(), "norm").pvalue > 1e-4


@pytest.mark.parametrize("member", range(4))
def test_anderson_darling(normals, member):
    ordered = np.sort(normals[64:128, member].ravel())
    n = ordered.size
    weights = 2.0 * np.arange(1, n + 1) - 1.0
    statistic = -n - (weights * (np.log(ndtr(ordered)) + np.log(ndtr(-ordered[::-1])))).mean()
    assert statistic < 9.0  # 6.0 has a chance of 1e-3, 9.0 of 4e-5 (fully specified law)


# independence


def assert_independent(first, second):
    """No correlation of z, |z| and z² (each with each), and none in a table of 16 × 16 cells."""
    first, second = np.ravel(first), np.ravel(second)
    for f in (np.positive, np.abs, np.square):
        for g in (np.positive, np.abs, np.square):
            assert abs(np.corrcoef(f(first), g(second))[0, 1]) * math.sqrt(first.size) < SIGMAS
    table = np.histogram2d(ndtr(first), ndtr(second), bins=16, range=((0, 1), (0, 1)))[0]
    expected = first.size / 256.0
    assert 1e-5 < chi2.sf(((table - expected) ** 2 / expected).sum(), 255) < 1.0 - 1e-5


@pytest.mark.parametrize(("first", "second"), [(0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2)])
def test_members_of_a_block_are_independent(normals, first, second):
    assert_independent(normals[:64, first], normals[:64, second])


@pytest.mark.parametrize("lag", [1, 2, 3, 7, 64, 256])
def test_steps_are_independent(normals, lag):
    for member in (0, 3):
        assert_independent(normals[:64, member], normals[lag : lag + 64, member])


@pytest.mark.full
@pytest.mark.parametrize("lag", [1, 2, 8, 64, 1024])
def test_realizations_are_independent(normals, lag):
    assert_independent(normals[:128, 1, :-lag], normals[:128, 1, lag:])


def test_no_two_of_many_realizations_are_correlated(normals):
    lanes = normals[:, :, :256].reshape(-1, 256)
    scores = np.corrcoef(lanes.T)[np.triu_indices(256, 1)] * math.sqrt(len(lanes))
    assert np.abs(scores).max() < 5.8  # of 32640
    assert abs((scores**2).mean() - 1.0) < 4.0 * math.sqrt(2.0 / scores.size)


@pytest.mark.parametrize(
    "other",
    [((1, 2), "bodz", "noise"), ((1, 2), "body", "start"), ((2, 2), "body", "noise"), ((1, 3), "body", "noise")],
    ids=["body", "purpose", "seed", "other seed word"],
)
def test_streams_are_independent(normals, other):
    realizations = np.arange(normals.shape[2])
    second = normals_of(*other, realizations, 0, 64).reshape(-1, 4, len(realizations))
    for member in range(4):
        assert_independent(normals[:64, member], second[:, member])


@pytest.mark.full
def test_names_do_not_collide():
    addresses = {stream(SEED, f"body_{k}", "noise") for k in range(100_000)}
    assert len(addresses) == 100_000
    assert len({address[:2] for address in addresses}) == 100_000  # the keys alone: 64 bits


# addressing


def test_a_block_alone_is_the_block_among_many():
    realizations = np.arange(37)
    many = normals_of(SEED, "body", "noise", realizations, 2**32 - 5, 10)
    for block in range(10):
        alone = normals_of(SEED, "body", "noise", realizations, 2**32 - 5 + block, 1)
        np.testing.assert_array_equal(alone, many[4 * block : 4 * block + 4])


def test_a_realization_alone_is_the_realization_among_many():
    many = normals_of(SEED, "body", "noise", np.arange(300), 3, 4)
    for lane in (0, 1, 7, 255, 299):
        alone = normals_of(SEED, "body", "noise", np.array([lane]), 3, 4)
        np.testing.assert_array_equal(alone[:, 0], many[:, lane])


@pytest.mark.full
def test_a_stream_alone_is_the_stream_among_many():
    names = ["a", "b", "c"]
    addresses = np.array([stream(SEED, name, "noise") for name in names], dtype=np.uint64)
    together = np.empty((4, 3, 20))
    fill_normals(addresses.T.copy(), np.arange(20, dtype=np.uint64), np.uint64(11), together)
    for row, name in enumerate(names):
        np.testing.assert_array_equal(together[:, row], normals_of(SEED, name, "noise", np.arange(20), 11, 1))


def test_every_bit_of_the_counter_counts():
    blocks = [0, *(1 << bit for bit in range(57))]
    rows = np.array([normals_of(SEED, "body", "noise", np.arange(2), block, 1) for block in blocks])
    assert len(np.unique(rows[:, 0, 0])) == len(blocks)
    lanes = np.array([0, *(1 << bit for bit in range(32))])
    assert len(np.unique(normals_of(SEED, "body", "noise", lanes, 0, 1)[0])) == len(lanes)


NONE = np.zeros(0, np.int64), np.zeros((4, 0, 5), np.float32)


@pytest.mark.parametrize("coarse", [False, True])
def test_rows_of_one_stream_have_its_normals(coarse):
    """As if each row had drawn them for itself."""
    streams = np.array([stream(SEED, name, "noise") for name in ("a", "b")], dtype=np.uint64).T.copy()
    which, lanes = np.array([1, 0, 1]), np.arange(5, dtype=np.uint32)
    rows, others = np.arange(3), (np.zeros((1, 2, 3)),)
    found, expected = np.empty((2, 4, 3, 5), dtype=np.float32)
    for normals, addresses, shared in (
        (found, streams, (which, np.empty((4, 2, 5), np.float32))),
        (expected, streams[:, which].copy(), NONE),
    ):
        runs = np.array([[0, 0, 3]])
        fill_steps(
            Noise(rows, runs, 3, *others, addresses, lanes, np.ones((1, 3)), coarse, normals, *shared), 7, normals
        )
    np.testing.assert_array_equal(found, expected)


def test_a_coarse_step_has_the_noise_of_two():
    """Sums of two steps each, over √2, in their order; and the same blocks where the noise is not coarse."""
    streams = np.array([stream(SEED, name, "noise") for name in ("a", "b")], dtype=np.uint64)
    streams, runs = streams.T.copy(), np.array([[0, 0, 2]])
    lanes = np.arange(5, dtype=np.uint32)
    fine = np.stack([normals_of(SEED, name, "noise", lanes, 6, 2) for name in ("a", "b")])
    for coarse in (False, True):
        normals = np.empty((4, 2, 5), dtype=np.float32)
        noise = Noise(
            np.arange(2), runs, 2, np.zeros((1, 2, 2)), streams, lanes, np.ones((1, 2)), coarse, normals, *NONE
        )
        fill_steps(noise, 3 if coarse else 6, normals)
        expected = (fine[:, 0::2] + fine[:, 1::2]) / math.sqrt(2.0) if coarse else fine[:, :4]
        np.testing.assert_allclose(normals.swapaxes(0, 1), expected, rtol=1e-6, atol=1e-7)
