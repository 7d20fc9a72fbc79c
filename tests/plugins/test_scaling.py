"""The scaling study: its networks and arithmetic, a small run, and verdicts that follow the numbers."""

import math

import numpy as np
import pytest
from impactlab_numerics import ScalingStudy
from impactlab_numerics.scaling.collect import COMPARED, realizations_of
from impactlab_numerics.scaling.study import SEEN, SHORTEST, closing_rate
from impactlab_numerics.scenes import GRAPHS, TEMPERATURE, scene
from impactlab_numerics.timing import Blocks, Stopwatch, peak_memory

import impactlab as il

pytestmark = pytest.mark.campaign

STUDY = ScalingStudy


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sizes": (10, 100)}, "sizes must begin with 2"),
        ({"sizes": (2, 10, 10)}, "sizes must be rising numbers"),
        ({"clearances": ()}, "clearances must be rising numbers"),
        ({"graph_sizes": (3,)}, "at least 4"),
        ({"band": (500.0, 0.0)}, "band"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, message):
    with pytest.raises(il.InvalidInput, match=message):
        ScalingStudy(**settings)


@pytest.mark.parametrize("bodies", [4, 7, 16])
def test_graphs_are_what_they_are_called(bodies):
    def ends(graph):
        return [(item.first, item.second) for item in GRAPHS[graph](bodies).contacts.values()]

    assert GRAPHS["chain"](bodies) == scene(bodies)
    assert {second for _, second in ends("star")} == {"body_0"}
    assert len({first for first, _ in ends("star")}) == bodies - 1
    width = math.isqrt(bodies)
    places = {f"body_{number}": divmod(number, width) for number in range(bodies)}
    for first, second in ends("grid"):
        (row, column), (below, right) = places[first], places[second]
        assert (below - row) + (right - column) == 1
    assert len(set(ends("grid"))) == sum((row, column + 1) in places.values() for row, column in places.values()) + sum(
        (row + 1, column) in places.values() for row, column in places.values()
    )
    for graph in GRAPHS:
        network = GRAPHS[graph](bodies)
        for name, body in network.oscillators.items():
            assert np.pi * network.excitations[name].spectral_density / body.damping == pytest.approx(TEMPERATURE)


def test_clearances_are_in_standard_deviations_of_the_gap():
    far = ScalingStudy().apart(5.0)
    deviation = math.sqrt(float(il.exact(far).statistics()["variance_displacement"].sum()))
    assert far.contacts["contact_0"].clearance == pytest.approx(5.0 * deviation, rel=1e-4)


def test_runs_are_long_enough_for_contacts_or_short():
    study = ScalingStudy()
    for item in study.items():
        total = item.options["duration"] * item.options["realizations"]
        contacts = closing_rate(item.network) * total
        assert contacts > SEEN or item.options["duration"] == SHORTEST
        assert 2.0 * total / 0.006 < 1.2 * study.body_steps or item.key == "exactness"


def test_large_networks_have_few_realizations():
    assert [realizations_of("ensemble", bodies) for bodies in (2, 1000, 100000)] == [520, 400, 8]
    assert realizations_of("single", 2) == 1


def test_a_stopwatch_runs_the_blocks_that_others_run():
    options = {"duration": 5.0, "realizations": 1300, "rng": 1, "progress": False}
    watch = Stopwatch()
    timed = il.simulate(scene(2), **options, executor=watch)
    assert watch.seconds > 0.0
    np.testing.assert_allclose(timed.contact_ratio, il.simulate(scene(2), **options).contact_ratio, rtol=1e-12)


@pytest.mark.filterwarnings("ignore:1 contact:impactlab.AccuracyWarning")
def test_blocks_are_timed_over_at_least_half_of_the_seconds():
    timer = Blocks(scene(2), {"realizations": 64}, 0.02, 0.1)
    rate, rest = timer()
    assert rate > 0.0
    assert rest > 0.0
    assert timer.result.attrs["duration"] > 0.3


def test_the_quick_form_is_exact(run, explained):
    assert [item for item in run.checks if not item.ok] == []
    assert run.claims.sizes["claim"] == 12
    explained(run.study, run.figures, run.claims)
    assert set(run.figures) == {"cost_against_size", "cost_against_clearance"}
    assert [title for title, rows in run.study.tables(run.tree) if not rows] == []


def test_costs_are_those_of_the_rounds(run):
    size, clearance = (run.tree[name].to_dataset() for name in ("size", "clearance"))
    assert (size.cost == size.cost_by_round.min("round")).all()
    assert float(size.relative_cost.sel(kind="ensemble")[0]) == 1.0
    assert list(size.bodies.values) == [2, 10, 50, 16, 16]
    assert (size.memory > 0.0).all()
    two = clearance.sel(clearance=2.0)
    work = two.cost * two.scatter
    np.testing.assert_allclose(two.gain, work.sel(scheme="steps") / work.sel(scheme="jumps"))
    assert np.isnan(clearance.gain.sel(clearance=6.0)).all()
    assert list(clearance.longest_jump.values > 0.0) == [False, True, True]
    assert list(clearance.statistic.values) == list(COMPARED)


def verdicts(run, group, **changes):
    """Verdicts by the beginning of the statement, after variables of a group were replaced."""
    tree = run.tree.copy(deep=True)
    tree[group] = tree[group].to_dataset().assign(changes)
    table = ScalingStudy().claims(tree)
    return dict(zip(table.statement.values.tolist(), table.verdict.values.tolist(), strict=True)), tree


def holding(found, text):
    """The verdict on the only statement with some text."""
    (verdict,) = (verdict for statement, verdict in found.items() if text in statement)
    return verdict


def test_verdicts_follow_the_numbers(run):
    size, far = run.tree["size"].to_dataset(), run.tree["clearance"].to_dataset()
    for cost, verdict in ((1.5, "holds"), (1.6, "does not hold")):
        found, _ = verdicts(run, "size", relative_cost=xr_full(size.relative_cost, cost))
        assert holding(found, "An ensemble of a chain") == verdict
        assert holding(found, "One realization of a chain") == "not testable"
    for memory, verdict in ((999.0, "holds"), (1000.0, "holds partly")):  # there are no large networks
        found, _ = verdicts(run, "size", memory=xr_full(size.memory, memory))
        assert holding(found, "bytes per body") == verdict
    large = xr_full(size.bodies, 1000)
    found, _ = verdicts(run, "size", memory=xr_full(size.memory, 1000.0), bodies=large)
    assert holding(found, "bytes per body") == "does not hold"
    found, _ = verdicts(run, "size", relative_cost=xr_full(size.relative_cost, 2.5), bodies=large)
    assert holding(found, "One realization of a chain") == "holds"
    for gain, verdict in ((1.0, "holds"), (0.985, "sampling error"), (0.97, "does not hold")):
        found, _ = verdicts(run, "clearance", gain=xr_full(far.gain, gain), noise=xr_full(far.noise, 0.01))
        assert holding(found, "base case") == verdict
        assert holding(found, "4 σ") == "not testable"
    for quicker, verdict in ((12.0, "holds"), (11.0, "does not hold")):
        found, _ = verdicts(run, "clearance", quicker=xr_full(far.quicker, quicker), noise=xr_full(far.noise, 0.01))
        assert holding(found, "6 σ") == verdict
    for cost, verdict in (([0.001, 0.01], "holds"), ([0.001, 0.009], "does not hold")):
        found, _ = verdicts(run, "series", cost=("scheme", cost))
        assert holding(found, "cosines") == verdict
    found, _ = verdicts(run, "sweep", compilations=((), 1))
    assert holding(found, "sweep") == "does not hold"
    for added, verdict in ((0.1, "holds"), (0.11, "does not hold")):
        found, _ = verdicts(run, "records", added=xr_full(run.tree["records"].added, added))
        assert (holding(found, "Observable"), holding(found, "Energy flows")) == (verdict, "holds")


def xr_full(like, value):
    """An array of one value."""
    return like.copy(data=np.full(like.shape, value))


def test_a_bias_is_seen(run):
    table = run.tree["exactness"].to_dataset()
    precise = {"standard_error": 5e-4 * np.abs(table.reference)}
    found, tree = verdicts(run, "exactness", difference=5e-4 * table.reference, **precise)
    assert holding(found, "Jumps leave no bias") == "holds"
    found, tree = verdicts(run, "exactness", difference=4e-3 * table.reference, **precise)
    assert holding(found, "Jumps leave no bias") == "does not hold"
    assert [item.name for item in ScalingStudy().checks(tree) if not item.ok] == ["exact in a long run"]
    _, tree = verdicts(run, "clearance", z=run.tree["clearance"].to_dataset().z + 10.0)
    assert [item.name for item in ScalingStudy().checks(tree) if not item.ok] == ["exact at all clearances"]


def test_a_timer_that_does_not_jump_is_seen(run):
    _, tree = verdicts(run, "clearance", timed_jump=xr_full(run.tree["clearance"].to_dataset().timed_jump, 0.0))
    assert [item.name for item in ScalingStudy().checks(tree) if not item.ok] == ["jumps are timed"]


def test_peak_memory_is_that_of_the_arrays_of_a_block():
    one, four = (peak_memory(scene(2), 1.0, realizations=130 * blocks) for blocks in (1, 4))
    assert 130 * 2 * 8 * 8 < one < four < 4 * one
