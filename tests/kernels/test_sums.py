"""The sums over time and the counts, against the same in NumPy."""

import numpy as np
import pytest

from impactlab.assembly.incidence import differences, gathering
from impactlab.integrators.arguments import Closings, Flux, History, Peaks, PointSums, Sums, Turns
from impactlab.integrators.driver import all_samples
from impactlab.kernels.histogram import count_pairs, count_samples
from impactlab.kernels.points import add_history_of_points, add_turns_of_points
from impactlab.kernels.rows import FF, FLUX, FV, FX, VV, XV, XX, F, V, X
from impactlab.kernels.samples import adding
from impactlab.kernels.sums import SLOTS, add_history, add_turns, close_slot, empty_slots, write_snapshot

pytestmark = pytest.mark.full

BODIES, LANES, STEPS = 3, 11, SLOTS
ENDS = np.array([[0, 1], [2, 3]])  # the second contact with the wall
WINDOW = np.array([0.5, 1.0])
PAIRS = np.array([[0, 2], [1, 2]])


@pytest.fixture
def states():
    rng = np.random.default_rng(2)
    x, v, force = rng.normal(size=(3, STEPS, BODIES + 1, LANES))
    x[:, -1] = v[:, -1] = 0.0
    indentation = rng.normal(size=(STEPS, 2, LANES))
    return History(x, v, force, indentation, np.where(indentation > 0.0, 10.0 * indentation, 0.0))


def empty_sums(phases, rows, half_kick=(), jitter=None, points=((),)):
    bodies, contacts, products = (
        np.zeros((phases, rows, BODIES, LANES)),
        np.zeros((4, 2, LANES)),
        np.zeros((9, 2, LANES)),
    )
    tables = differences(ENDS), gathering(ENDS, BODIES), ENDS.ravel()
    indices = np.concatenate([np.cumsum([3, *map(len, tables[:2])]), *tables])
    half_kicks = np.array(half_kick).reshape(-1, BODIES + 1)
    work = np.zeros((4, 2, LANES)), np.zeros(((BODIES + 1) * bool(half_kick), LANES)), np.zeros((2, LANES))
    before = np.full((2, 0 if jitter is None else 2, LANES), np.nan)
    jitters = np.zeros(0) if jitter is None else np.array(jitter)
    peaks = Peaks(0, np.zeros((4, 0, LANES)), np.zeros(0), FLUX + 3, 0)
    counting = Closings(before, jitters, np.zeros(0), 0.1, peaks)
    turning = BODIES * bool(any(points))
    turns = Turns(0.1 * np.arange(1.0, BODIES + 1.0), *np.zeros((2, turning, LANES)), np.zeros(0))
    slots = np.array([slot for row in points for slot in row], dtype=np.int64)
    begin = np.cumsum([0, *map(len, points)]) if any(points) else np.zeros(1, dtype=np.int64)
    weights = np.random.default_rng(3).normal(size=(phases, 9, len(slots)))
    reading = PointSums(begin, slots, weights, np.zeros((phases, 5, len(begin) - 1, LANES)), np.zeros((4, LANES)))
    flux = Flux(WINDOW, half_kicks, *work)
    return Sums(
        bodies,
        contacts,
        3,
        np.zeros((0, BODIES, LANES)),
        products,
        ENDS,
        PAIRS,
        indices,
        counting,
        flux,
        turns,
        reading,
        np.zeros(0, np.int64),
    )


def closed(history, slot, last, sums, now=0):
    """Close a slot as the loop over steps does."""
    if close_slot(history, slot, now, last, sums):
        add_history(history, sums)
        of_contacts = tuple(item for item in all_samples() if item.of_contacts)
        adding(of_contacts)(history.indentation, history.contact_force, sums.contacts)


@pytest.mark.parametrize("phases", [1, 2])
@pytest.mark.parametrize("used", [slice(0, 8), slice(1, 8), slice(0, 3), slice(2, 3), slice(3, 7)], ids=str)
def test_powers_of_state_and_kick_by_phase(states, phases, used):
    """A full group of steps, and one in which a call began or ended."""
    sums = empty_sums(phases, 9)
    x, v, force = (item[:, :-1].copy() for item in states[:3])
    empty_slots(states, 0, used.start)
    closed(states, used.stop - 1, True, sums)
    expected = {
        X: x, V: v, XX: x * x, XV: x * v, VV: v * v, F: force, FF: force * force, FX: force * x, FV: force * v
    }  # fmt: skip
    for row, values in expected.items():
        for phase in range(phases):
            steps = [step for step in range(used.start, used.stop) if step % phases == phase]
            np.testing.assert_allclose(sums.bodies[phase, row], values[steps].sum(axis=0), rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("used", [slice(0, 4), slice(2, 3)], ids=str)
def test_products_of_pairs(states, used):
    """Of x, v, f of the first body and x, v, f of the second, row by row."""
    sums = empty_sums(2, 9)
    quantities = [item.copy() for item in states[:3]]
    empty_slots(states, 0, used.start)
    closed(states, used.stop - 1, True, sums)
    products = [left[used, PAIRS[:, 0]] * right[used, PAIRS[:, 1]] for left in quantities for right in quantities]
    np.testing.assert_allclose(sums.products, np.sum(products, axis=1), rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("phases", [1, 2])
def test_squares_at_points(states, phases):
    """Of four weighted sums of displacements, velocities and forces, whose weights depend on the phase."""
    used, points = slice(1, 7), ((0, 2), (1,))
    sums = empty_sums(phases, 9, points=points)
    x, v, force = (item.copy() for item in states[:3])
    empty_slots(states, 0, used.start)
    closed(states, used.stop - 1, True, sums)
    add_history_of_points(states, sums.points)
    begin = sums.points.begin
    for point, slots in enumerate(points):
        for phase in range(phases):
            steps = [step for step in range(used.start, used.stop) if step % phases == phase]
            w = sums.points.weights[phase, :, begin[point] : begin[point + 1], None]
            at, speed, push = (item[steps][:, list(slots)] for item in (x, v, force))
            read = [w[0] * at, w[1] * speed + w[2] * push]
            read += [w[k] * at + w[k + 1] * speed + w[k + 2] * push for k in (3, 6)]
            expected = [(item.sum(axis=1) ** 2).sum(axis=0) for item in read]
            np.testing.assert_allclose(sums.points.sums[phase, :4, point], expected, rtol=1e-12)


def test_turns_at_points(states):
    """The mean of two kicks times what the flow gives between them, of weighted sums."""
    sums = empty_sums(1, 10, points=((0, 2),))
    w, half = sums.points.weights[0, 0][:, None], sums.turns.half[[0, 2], None]
    expected = np.zeros(LANES)
    for now in range(4):
        if now:
            add_turns_of_points(states.force[now], states.v[now], 0, sums.points, sums.turns)
        add_turns(states.force[now], states.v[now], now > 0, 0, sums)
        if now:
            kick = half * (states.force[now - 1] + states.force[now])[[0, 2]]
            change = (states.v[now] - states.v[now - 1])[[0, 2]]
            expected += (w * kick).sum(axis=0) * (w * (change - kick)).sum(axis=0)
    np.testing.assert_allclose(sums.points.sums[0, 4, 0], expected, rtol=1e-12)


def test_sums_wait_for_the_last_slot(states):
    sums = empty_sums(2, 9)
    for slot in range(SLOTS - 1):
        closed(states, slot, False, sums)
        assert not sums.bodies.any()
        assert not sums.contacts.any()
    closed(states, SLOTS - 1, False, sums)
    assert sums.bodies.all()


def test_methods_that_do_not_kick_have_no_forces(states):
    sums, nine = empty_sums(1, 5), empty_sums(1, 9)
    closed(states, SLOTS - 1, False, sums)
    closed(states, SLOTS - 1, False, nine)
    np.testing.assert_array_equal(sums.bodies, nine.bodies[:, :5])


WIDTHS, LATE = (0.1, 0.2, 0.3, 0.0), (-0.1, 0.0, -0.2, 0.0)


@pytest.mark.parametrize("half_kick", [(), (WIDTHS,), (WIDTHS, LATE)], ids=["alone", "other forces", "slowed"])
def test_contacts(states, half_kick):
    sums = empty_sums(2, 9, half_kick)
    closing = states.v[:, [0, 2]] - states.v[:, [1, 3]]
    readings = [closing]
    if half_kick:
        kick, late = (
            np.diff((states.force * np.array(row)[:, None])[:, ::-1].reshape(STEPS, 2, 2, LANES), axis=2)[:, ::-1, 0]
            for row in (half_kick[0], half_kick[1] if len(half_kick) > 1 else np.zeros(BODIES + 1))
        )
        readings = [closing + late - kick, closing + late, closing + late + kick]
    weight = 1.0 - 5.0 / 3.0 * (states.indentation / WINDOW[:, None]) ** 2
    weight *= np.abs(states.indentation) < WINDOW[:, None]
    flux = weight * np.mean([np.maximum(reading, 0.0) for reading in readings], axis=0)
    closed(states, SLOTS - 1, False, sums)
    ratio, force, peak = sums.contacts[FLUX + 1 :]
    np.testing.assert_array_equal(ratio, (states.indentation > 0.0).sum(axis=0))
    np.testing.assert_allclose(force, states.contact_force.sum(axis=0), rtol=1e-13)
    np.testing.assert_allclose(sums.contacts[FLUX], flux.sum(axis=0), rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(peak, states.contact_force.max(axis=0))


def test_closings_are_counted_on_the_cubic_between_steps(states):
    """Those that begin and end within a step too, around one turning point, against the cubic on a fine grid."""
    step = 0.1
    place = np.linspace(0.0, 1.0, 4001)[:, None, None]
    basis = np.array([(1 + 2 * place) * (1 - place) ** 2, place * (1 - place) ** 2, place**2 * (3 - 2 * place)])
    basis = [*basis, place**2 * (place - 1)]
    depth = 0.2 * states.indentation
    closing = 4.0 * (states.v[:, [0, 2]] - states.v[:, [1, 3]])
    expected = np.zeros((2, LANES), dtype=int)
    hidden = 0
    for now in range(1, STEPS):
        ends = depth[now - 1], step * closing[now - 1], depth[now], step * closing[now]
        path = sum(weight * end for weight, end in zip(basis, ends, strict=True)) > 0.0
        across = path[-1] & ~path[0]
        turns = closing[now - 1] * closing[now] < 0.0
        number = np.where(turns, (path[1:] & ~path[:-1]).sum(axis=0), across)
        hidden += int((number > across).sum())
        expected += number
    counted = History(states.x, 4.0 * states.v, states.force, depth, states.contact_force)
    sums = empty_sums(2, 9, jitter=(0.0, 0.0))
    for slot in range(SLOTS):
        closed(counted, slot, slot == SLOTS - 1, sums)
    np.testing.assert_array_equal(sums.contacts[FLUX], expected)
    assert hidden > 3


def test_counts_go_on_where_a_call_ended(states):
    whole, parts = (empty_sums(2, 9, jitter=(0.5, 1.0)) for _ in range(2))
    again = History(*(item.copy() for item in states))
    for slot in range(SLOTS):
        closed(states, slot, slot == SLOTS - 1, whole)
    for slot in range(SLOTS):
        closed(History(*(item.copy() for item in again)), slot, slot in (2, SLOTS - 1), parts)
    np.testing.assert_array_equal(parts.contacts[FLUX], whole.contacts[FLUX])


def test_snapshots_hold_displacements_velocities_and_forces(states):
    x, v = states.x, states.v
    contact_force = np.arange(2.0 * LANES).reshape(2, LANES)
    snapshots = np.full((2, 2 * BODIES + 2, LANES), np.nan)
    write_snapshot(x[0], v[0], contact_force, empty_sums(2, 9), snapshots, 1)
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
    count_pairs(snapshots, 0, 2, np.array([0, 2]), low, inverse_width, groups, counts)
    edges = np.concatenate([[-np.inf], EDGES, [np.inf]])
    for group in range(2):
        own = snapshots[::2][:, :, groups == group]
        place = [np.searchsorted(edges, own[:, q].ravel(), side="right") - 1 for q in (0, 2)]
        expected = np.zeros((8, 8), dtype=int)
        np.add.at(expected, tuple(place), 1)
        np.testing.assert_array_equal(counts[group], expected)
