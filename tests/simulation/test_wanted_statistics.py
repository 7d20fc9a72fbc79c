"""Statistics that nobody asked for are not summed, and those that are wanted do not notice."""

import numpy as np
import pytest
from scenes import base, plan_of

import impactlab as il
from impactlab.kernels.rows import FLUX
from impactlab.results.schema import CONTACT, STATISTICS, sampled_of
from impactlab.simulation.ensemble import run_block

WANTED = "mean_square_displacement"


def contacts_of(wanted, **options):
    """Which sums of contacts a run of the pair makes, by the statistic."""
    plan = plan_of(base(), duration=10.0, statistics=wanted, **({"realizations": 64} | options))
    sums = run_block(plan, 0).contacts
    names = ["contact_rate", *(item.name for item in sampled_of(CONTACT))]
    return {name for row, name in enumerate(names, FLUX) if sums[:, row].any()}


@pytest.mark.full
@pytest.mark.parametrize(
    ("wanted", "summed"),
    [
        (None, {"contact_rate", "contact_ratio", "mean_contact_force", "peak_contact_force"}),
        ((WANTED,), {"contact_ratio", "mean_contact_force", "peak_contact_force"}),
        (
            ("mean_velocity", "contact_rate"),
            {"contact_rate", "contact_ratio", "mean_contact_force", "peak_contact_force"},
        ),
    ],
)
def test_a_rate_that_nobody_asked_for_is_not_summed(wanted, summed):
    assert contacts_of(wanted) == summed


@pytest.mark.full
def test_the_rate_that_tells_of_rare_events_is_summed_for_few_realizations():
    assert "contact_rate" in contacts_of((WANTED,), realizations=8)


def distant():
    """The pair, whose contact closes a few times in a run: errors are then widened, and some balances not used."""
    return base(clearance=0.9)


def damped():
    """The pair with a law that depends on the rate, whose peaks are read between steps."""
    return base(
        contacts={"gap": il.Contact("one", "two", il.HuntCrossleyContact(1e4, dissipation=0.3), clearance=0.05)}
    )


def rigid():
    """The pair with impacts."""
    return base(contacts={"gap": il.Contact("one", "two", il.RigidContact(restitution=0.8), clearance=0.05)})


@pytest.mark.full
@pytest.mark.parametrize(
    ("network", "options"),
    [
        (base, {}),
        (base, {"initial": "rest", "spin_up": 0.0}),
        (base, {"step": 0.015}),  # closings are counted
        pytest.param(base, {"realizations": 1, "duration": 1000.0}, marks=pytest.mark.campaign),
        (distant, {}),
        pytest.param(damped, {}, marks=pytest.mark.campaign),
        pytest.param(rigid, {}, marks=pytest.mark.campaign),
    ],
)
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_values_and_errors_are_those_of_a_run_that_sums_all(network, options):
    arguments = {"duration": 10.0, "realizations": 64, "rng": 1} | options
    wanted = [WANTED, "mean_velocity", "contact_ratio"]
    everything = il.simulate(network(), **arguments)
    result = il.simulate(network(), statistics=wanted, **arguments)
    assert {*wanted} == {name for name in STATISTICS if name in result}
    for name in result.drop_vars("warnings", errors="ignore").data_vars:  # their texts tell how closings were counted
        np.testing.assert_array_equal(result[name], everything[name], err_msg=str(name))
    assert result.attrs["step"] == everything.attrs["step"]
    np.testing.assert_equal(result.attrs["step_heating"], everything.attrs["step_heating"])


def test_a_warning_of_rare_contacts_is_given_all_the_same():
    for wanted in (None, WANTED):
        with pytest.warns(il.AccuracyWarning, match="1 contact.s. closed fewer than 30 times"):
            il.simulate(distant(), duration=10.0, realizations=64, rng=1, statistics=wanted)


def test_the_choice_is_stored_and_done_again():
    result = il.simulate(base(), duration=2.0, realizations=64, rng=1, statistics=WANTED)
    again = il.rerun(result)
    assert set(again.data_vars) == set(result.data_vars)
    assert again.identical(result.assign_attrs(history=again.attrs["history"]))
    assert (
        "statistics" not in il.simulate(base(), duration=2.0, realizations=64, rng=1).attrs["impactlab_configuration"]
    )


def test_points_of_a_sweep_have_the_statistics_of_each_alone():
    values, options = [0.02, 0.05], {"duration": 2.0, "realizations": 64, "statistics": [WANTED]}
    swept = il.sweep(lambda clearance: base(clearance=clearance), {"clearance": values}, rng=1, **options)
    for value in values:
        point = swept.sel(clearance=value)
        alone = il.rerun(point)
        assert set(alone.data_vars) <= set(swept.data_vars)
        for name in alone.data_vars:
            np.testing.assert_array_equal(point[name], alone[name], err_msg=str(name))
    assert "contact_rate" not in swept


def test_statistics_of_a_tolerance_are_wanted_as_well():
    result = il.simulate(base(), tolerance={"contact_ratio": 0.2}, statistics=WANTED, rng=1)
    assert {name for name in STATISTICS if name in result} == {WANTED, "contact_ratio"}
    assert "contact_ratio_bias" in result


def test_what_is_missing_is_said_where_it_is_asked_for():
    result = il.simulate(base(), duration=2.0, realizations=64, rng=1, statistics=WANTED)
    assert set(il.compare(result, il.exact(base())).statistic.values) == {WANTED}
    with pytest.raises(il.InvalidInput, match=r"holds no 'contact_rate'.*statistics="):
        il.plot.profile(result, "contact_rate")


@pytest.mark.parametrize("given", ["contact_number", ["mean_velocity", "contact_number"], [], 3, [3]])
def test_statistics_that_there_are_not_are_refused(given):
    with pytest.raises(il.InvalidInput, match=r"^(simulate: )?statistics") as refused:
        il.simulate(base(), duration=1.0, statistics=given)
    if "contact_number" in str(given):
        assert all(name in str(refused.value) for name in STATISTICS)
