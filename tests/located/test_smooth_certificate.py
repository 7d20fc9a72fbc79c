"""No contact of a smooth path is missed: against searches at steps of 1e-5, at tops that graze, in polynomials."""

import math

import numba
import numpy as np
import pytest

import impactlab as il
from impactlab.kernels.passages import first_passage

STEP = 1e-5


@numba.njit
def rates(t, y, p):
    """A driven Duffing body between a stop with damping and a linear body, which has a stop as well."""
    one, two = y[0], y[1]
    left, gap, right = -one - p[6], one - two - p[7], two - p[8]
    push, force = 0.0, 0.0
    if left > 0.0:
        push = max(p[9] * left**1.5 * (1.0 - p[10] * y[2]), 0.0)
    if gap > 0.0:
        force = p[9] * gap**1.5
    stop = p[9] * right**1.5 if right > 0.0 else 0.0
    first = p[0] * math.sin(p[1] * t) - 0.1 * y[2] - p[2] * one - p[3] * one**3 + push - force
    second = -0.1 * y[3] - p[4] * two + force - stop
    return np.array([y[2], y[3], first, second / p[5]])


@numba.njit
def searched(p, duration):
    """Return times at which contacts close, their numbers, how deep they come, and the end, by steps of 1e-5."""
    y, number, found, deepest = np.zeros(4), round(duration / STEP), 0, np.full(3, -1e9)
    times, which, depths = np.zeros(1000), np.zeros(1000, np.int64), np.zeros(1000)
    last, before, row = np.full(3, -1), np.full(3, -1.0), np.zeros(3)
    for step in range(number):
        t = step * STEP
        a = rates(t, y, p)
        b = rates(t + 0.5 * STEP, y + 0.5 * STEP * a, p)
        c = rates(t + 0.5 * STEP, y + 0.5 * STEP * b, p)
        d = rates(t + STEP, y + STEP * c, p)
        y = y + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        row[0], row[1], row[2] = -y[0] - p[6], y[0] - y[1] - p[7], y[1] - p[8]
        for contact in range(3):
            deepest[contact] = max(deepest[contact], row[contact])
            if before[contact] <= 0.0 < row[contact]:
                share = before[contact] / (before[contact] - row[contact])
                times[found], which[found], last[contact] = t + share * STEP, contact, found
                found += 1
            if row[contact] > 0.0:
                depths[last[contact]] = max(depths[last[contact]], row[contact])
            before[contact] = row[contact]
    return times[:found], which[:found], depths[:found], deepest, y


def drawn(rng):
    """Numbers of a network: force, frequency, stiffnesses, mass, clearances, contacts."""
    return np.array([
        rng.uniform(0.4, 1.5), rng.uniform(0.5, 2.0), rng.uniform(0.3, 2.0), rng.uniform(0.0, 2.0),
        rng.uniform(0.3, 3.0), rng.uniform(0.3, 2.0), *rng.uniform(0.15, 0.6, 3), 10.0 ** rng.uniform(1.5, 3.0),
        rng.uniform(0.0, 0.3),
    ])  # fmt: skip


def network(p):
    return il.Network(
        {
            "one": il.DuffingOscillator(damping=0.1, stiffness=p[2], cubic=p[3]),
            "two": il.LinearOscillator(mass=p[5], damping=0.1, stiffness=p[4]),
        },
        {
            "left": il.Contact(il.WALL, "one", il.HuntCrossleyContact(p[9], dissipation=p[10]), clearance=p[6]),
            "gap": il.Contact("one", "two", il.HertzContact(p[9]), clearance=p[7]),
            "right": il.Contact("two", il.WALL, il.HertzContact(p[9]), clearance=p[8]),
        },
        {"one": il.Harmonic(p[0], frequency=p[1])},
    )


def followed(p, duration):
    options = {"initial": "rest", "integrator": il.EventLocated(), "record": [il.Impacts(), il.FinalState()]}
    data = il.simulate(network(p), duration, **options)
    order = np.argsort(data["impact_time"].values)
    names = data["contact"].values.tolist()
    which = np.array([names.index(name) for name in data["impact_contact"].values[order].tolist()], dtype=int)
    return data["impact_time"].values[order], which, data


def compare(seed, count, duration=12.0):
    rng, closed = np.random.default_rng(seed), 0
    for _ in range(count):
        p = drawn(rng)
        times, which, _, _, end = searched(p, duration)
        found, contacts, data = followed(p, duration)
        assert found.size == times.size, p
        np.testing.assert_array_equal(contacts[np.argsort(found)], which[np.argsort(times)])
        np.testing.assert_allclose(found, times, atol=2e-6)  # by a straight line over a step at the search
        np.testing.assert_allclose(data["final_displacement"][0], end[:2], atol=1e-7)
        assert data.attrs["undecided_touches"] == 0
        closed += times.size
    return closed


@pytest.mark.full
def test_events_are_those_of_a_fine_search():
    assert compare(1, 6) > 20


@pytest.mark.campaign
def test_events_of_many_networks_are_those_of_a_fine_search():
    assert compare(2, 50) > 150


@pytest.mark.full
@pytest.mark.parametrize("seed", range(4))
def test_a_top_that_grazes_is_decided_or_counted(seed):
    """The stop of the second body is where the free motion has its largest displacement, but for a little."""
    p = drawn(np.random.default_rng(100 + seed))
    p[8] = 10.0
    largest = searched(p, 12.0)[3][2] + p[8]
    for apart, closings in ((1e-9, 0), (-1e-9, 1)):
        p[8] = largest * (1.0 + apart)
        _, contacts, data = followed(p, 12.0)
        assert (contacts == 2).sum() == closings
        assert data.attrs["undecided_touches"] == 0
    p[8] = followed_top(p, largest)
    assert followed(p, 12.0)[2].attrs["undecided_touches"] >= 1.0


def followed_top(p, largest):
    """The clearance at which the path that is followed turns from touching to not touching."""
    low, high = largest * (1.0 - 1e-9), largest * (1.0 + 1e-9)
    for _ in range(26):
        p[8] = 0.5 * (low + high)
        if (followed(p, 12.0)[1] == 2).any():
            low = p[8]
        else:
            high = p[8]
    return high


def in_eight_parts(curve):
    """Whether looks at eight parts of a step, and a parabola at a top between them, see a passage."""
    at = [np.polynomial.polynomial.polyval(place / 8, curve) for place in range(9)]
    tops = [place for place in range(2, 8) if at[place] >= max(at[place - 1], at[place + 1])]
    return max(at[1:]) > 0.0 or bool(tops)


@pytest.mark.parametrize("at", [0.04, 0.06, 0.37, 0.5, 0.96])
def test_a_short_passage_anywhere_in_a_step_is_found(at):
    """A top 1e-6 above 0, for 2e-3 of a step: looks at eight parts do not see those near the ends of a step."""
    top = np.polynomial.polynomial.polyfromroots([at - 1e-3, at + 1e-3])
    curve = np.zeros(6)
    curve[:3] = -top
    share, by = first_passage(curve, float(np.sum(curve)), 0.0, 0.0, 0.0)
    assert by > 0.0
    assert share == pytest.approx(at - 1e-3, abs=1e-6)
    assert in_eight_parts(curve) == (0.1 < at < 0.9)


def test_an_allowance_leaves_open_what_it_may_be():
    """A top below 0 by less than the quintic may be off is returned as a top; by more it is none."""
    curve = np.zeros(6)
    curve[:3] = -np.polynomial.polynomial.polyfromroots([0.4, 0.4])
    curve[0] -= 1e-6
    assert first_passage(curve, float(curve.sum()), 0.0, 1e-7, 0.0) == (-1.0, 0.0)
    share, by = first_passage(curve, float(curve.sum()), 0.0, 1e-4, 0.0)
    assert by == 0.0
    assert share == pytest.approx(0.4, abs=1e-6)
    curve[0] = 0.0
    curve[1] = -1.0  # which has just been at 0, and leaves
    assert first_passage(curve, float(curve.sum()), 0.0, 1e-7, 0.0) == (-1.0, 0.0)
