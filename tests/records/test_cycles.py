"""Cycles counted by rainflow: the example of the standard, paths, narrow bands."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from test_extremes import DRIFT, drift_of, towers

import impactlab as il
from impactlab.kernels.turning_points import BINS, bin_of, count_cycles

pytestmark = pytest.mark.full

ASTM = [-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]


def counted(series, room=64):
    """Ranges of the cycles of a series, with their numbers: those that are closed, and half of what is left."""
    stack, born = np.zeros((1, room)), np.zeros((1, room), np.int64)
    height, damage, counts = np.zeros(1, np.int64), np.zeros((1, 1)), np.zeros((1, 1, BINS))
    places, points = np.zeros((2, len(series)), np.int64), (0, len(series))
    assert count_cycles(places, np.array(series), points, 0, stack, born, height, damage, counts, 1.0) == len(series)
    for size in np.abs(np.diff(stack[0, : height[0]])):
        counts[0, 0, bin_of(size)] += 0.5
        damage[0, 0] += 0.5 * size
    return counts[0, 0], float(damage[0, 0])


def by_the_standard(series):
    """Ranges and numbers of cycles as section 5.4.4 of ASTM E1049 words it, with lists."""
    turns = [series[0]]
    for value in series[1:]:
        if value == turns[-1]:
            continue
        if len(turns) > 1 and (value - turns[-1]) * (turns[-1] - turns[-2]) > 0.0:
            turns[-1] = value
        else:
            turns.append(value)
    points, found = [], []
    for value in turns:
        points.append(value)
        while len(points) >= 3:
            latest, previous = abs(points[-1] - points[-2]), abs(points[-2] - points[-3])
            if latest < previous:
                break
            if len(points) == 3:
                found.append((previous, 0.5))
                del points[0]
            else:
                found.append((previous, 1.0))
                del points[-3:-1]
    return found + [(abs(b - a), 0.5) for a, b in pairwise(points)]


def test_the_example_of_the_standard():
    counts, total = counted(ASTM)
    expected = {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}
    assert {size: counts[bin_of(size)] for size in expected} == expected
    assert total == sum(size * number for size, number in expected.items())
    assert sorted(by_the_standard(ASTM)) == [
        (3.0, 0.5),
        (4.0, 0.5),
        (4.0, 1.0),
        (6.0, 0.5),
        (8.0, 0.5),
        (8.0, 0.5),
        (9.0, 0.5),
    ]


def test_any_series_is_counted_as_in_the_standard():
    generator = np.random.default_rng(1)
    for _ in range(20):
        series = np.round(np.cumsum(generator.normal(size=300)) * generator.uniform(0.0, 1.0, 300), 1)
        expected = np.zeros(BINS)
        for size, number in by_the_standard(series.tolist()):
            expected[bin_of(size)] += number
        np.testing.assert_array_equal(counted(series, room=300)[0], expected)


@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_cycles_are_those_of_the_paths():
    """Of forces, whose turning points are at steps but for the tops; of a drift by a fine Hermite spline."""
    step = 0.005
    record = [il.Cycles({"drift": DRIFT}, exponent=3.0), il.Trajectory(step)]
    ds = il.simulate(towers(), 20.0, realizations=3, step=step, record=record, rng=1)
    x, v = drift_of(ds)
    damage = 0.0
    for row in range(3):
        path = CubicHermiteSpline(ds.time.values, x.values[row], v.values[row])
        at = np.sort(np.concatenate([ds.time.values, path.derivative().roots(extrapolate=False)]))
        damage += sum(number * size**3 for size, number in by_the_standard(path(at).tolist()))
    assert float(ds.cycle_damage_rate[0]) == pytest.approx(damage / 60.0, rel=1e-10)
    assert ds.cycle_damage_rate.attrs["units"] == "m3 s-1"
    assert float(ds.cycle_equivalent_range[0]) == pytest.approx((damage / 60.0) ** (1.0 / 3.0), rel=1e-10)
    edges, rate = ds.cycle_range_edges.values, ds.cycle_rate.values[0]
    middle = np.sqrt(edges[1:] * edges[:-1])
    assert (rate * middle**3).sum() == pytest.approx(damage / 60.0, rel=0.02)


def test_a_narrow_band():
    """Ranges of a narrow band are twice Rayleigh's amplitudes: the mean of their cubes is (2 √2 σ)³ Γ(5/2)."""
    band = il.ShinozukaNoise(1.0, band=(0.95, 1.05), components=64, allow_repeat=True)
    body = il.LinearOscillator.from_frequency(2.0 * math.pi, 0.5)  # no narrower than the band
    network = il.Network({"a": body}, excitations={"a": band})
    ds = il.simulate(network, 2000.0, realizations=128, record=il.Cycles(), rng=1)
    deviation = math.sqrt(float(ds.variance_displacement[0]))
    damage, error = (float(ds[f"cycle_damage_rate{end}"][0]) for end in ("", "_standard_error"))
    expected = 30.0795393 * deviation**3  # at one cycle a second
    assert abs(damage - expected) < 3.0 * error + 0.01 * expected
    assert error < 0.02 * expected


def test_decaying_motion_leaves_half_cycles():
    """Every range of a decay stays on the stack, which grows."""
    network = il.Network({"a": il.LinearOscillator.from_frequency(2.0 * math.pi, 0.005)})
    ds = il.simulate(network, 60.0, initial={"displacement": {"a": 1.0}}, record=il.Cycles(exponent=1.0), spin_up=0.0)
    factor = math.exp(-math.pi * 0.005 / math.sqrt(1.0 - 0.005**2))
    swings = [(1.0 + factor) * factor**count for count in range(119)]
    assert float(ds.cycle_damage_rate[0]) * 60.0 == pytest.approx(0.5 * sum(swings), rel=0.01)
    assert float(ds.cycle_rate.sum()) * 60.0 == pytest.approx(60.0, abs=1.0)


@pytest.mark.parametrize(
    ("of", "exponent", "message"),
    [
        (("velocity", "upper"), 3.0, "white noise makes the velocities of 'velocity of upper' rough"),
        ("uper", 3.0, "did you mean 'upper'"),
        ("upper", 0.5, "exponent must be at least 1"),
    ],
)
def test_what_is_wrong_is_named(of, exponent, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(towers(), 20.0, record=il.Cycles(of, exponent=exponent), rng=1)
