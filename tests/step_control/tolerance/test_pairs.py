"""Realizations that are added, and pairs of them that tell the bias of the step."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr
from scenes import base, linear, plan_of

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators.exact_flow import FineFlow, WholeFlow
from impactlab.plan.request import Request
from impactlab.plan.seed import Seed
from impactlab.simulation.growing_ensemble import Ensemble, Execution
from impactlab.step_control.measured.bias import Bias
from impactlab.step_control.tolerance.pairs import Errors, Numbers, Trial, order_of
from impactlab.step_control.tolerance.tolerance import MORE_PAIRS, MOST_ADDED, _halvings, _next

BODY = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
HYSTERESIS = il.BoucWenCoupling(10.0, yield_displacement=0.1)
PAIR_AND_IDLE = il.Network(
    {**base().oscillators, "idle": BODY}, base().contacts, {**base().excitations, "idle": il.WhiteNoise(1.0)}
)
RECORDS = [
    il.Density(bins=20), il.JointDensity("one", "two", bins=8), il.PeakForces(2.0), il.Spectrum(segment=2.0),
    il.PerRealization(),
]  # fmt: skip


def at_wall(law, clearance=0.2, noise=None, body=BODY):
    wall = {"wall": il.Contact("a", il.WALL, law, clearance=clearance)}
    return il.Network({"a": body}, wall, {"a": noise or il.WhiteNoise(0.2 / np.pi)})


def grown(network, numbers, records, duration=4.0):
    """Run realizations one part after the other."""
    request = Request(duration, numbers[0], None, il.ExactFlow(), None, None, records, (1, 2))
    with ThreadPoolExecutor(1) as pool:
        ensemble = Ensemble(Model.of(network), request, Execution(pool, growing=True))
        for number in numbers:
            ensemble.grow(number, lambda part: None)
        return ensemble.dataset()


GROUPED = ["density_displacement", "joint_density"]
"""Variables whose errors are those of groups of realizations, others where these come in parts."""


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize(
    ("network", "records"),
    [
        (base(), RECORDS),
        (base(clearance=0.6), []),  # with contact-free intervals, whose length depends on the number of realizations
        (PAIR_AND_IDLE, [il.PerRealization()]),
    ],
)
def test_realizations_that_are_added_are_those_of_one_run(network, records):
    joined = grown(network, (70, 100, 300), records)
    direct = il.simulate(network, 4.0, realizations=300, step=joined.attrs["step"], record=records, rng=Seed(1, 2))
    assert direct.attrs["independent_samples"] == 300
    errors = [f"{name}_{ending}" for name in GROUPED for ending in ("standard_error", "band_factor")]
    one, other = (item.drop_vars(errors, errors="ignore") for item in (joined, direct))
    xr.testing.assert_identical(one.assign_attrs(history=""), other.assign_attrs(history=""))
    for name in errors if records == RECORDS else ():  # of groups of other sizes, from counts of few samples
        assert float(joined[name].mean()) == pytest.approx(float(direct[name].mean()), rel=0.1)


def test_contact_free_intervals_depend_on_the_number_of_realizations():
    """What the test above is about, else it would not see that realizations with others are run again."""
    few, many = (plan_of(base(clearance=0.6), duration=4.0, realizations=number) for number in (70, 300))
    assert few.method.interval != many.method.interval


@pytest.mark.full
def test_a_result_is_that_of_one_run():
    name = "mean_contact_force"
    result = il.simulate(base(), tolerance={name: 2e-3}, rng=1)
    assert result.attrs["attempts"] > 1
    again = il.rerun(result)
    assert set(result) - set(again) == {f"{name}_bias"}
    xr.testing.assert_equal(result.drop_vars(f"{name}_bias"), again)


def test_orders_are_those_that_theory_knows_of():
    def orders(network, **options):
        plan = plan_of(network, **{"duration": 100.0, "realizations": 64, "integrator": FineFlow()} | options)
        return [order_of(plan, name) for name in ("mean_square_displacement", "contact_rate")]

    smooth, duffing = at_wall(il.HertzContact(100.0)), il.DuffingOscillator(0.5, damping=0.2, stiffness=1.0)
    assert orders(smooth) == orders(at_wall(il.LinearContact(100.0), body=duffing)) == [4, 2]
    assert orders(smooth, initial={"velocity": {"a": 1.0}}) == [2, 1]
    assert orders(at_wall(il.KelvinVoigtContact(100.0, damping=3.0))) == [2, 1]
    assert orders(at_wall(il.PowerLawContact(20.0, exponent=0.5))) == [2, 1]
    assert orders(smooth, integrator=WholeFlow()) == [4, 2]
    assert orders(smooth, integrator=il.ExactFlow()) == [2, 1]  # friction at one moment of a step
    assert orders(smooth, integrator=il.EulerMaruyama()) == [1, 1]
    coupled = il.Network({"a": BODY}, {}, {"a": il.WhiteNoise(1.0)}, {"c": il.Coupling("a", il.WALL, HYSTERESIS)})
    assert orders(coupled) == [1, 1]


def test_only_little_friction_acts_at_one_moment_of_a_step_where_an_accuracy_is_to_be_reached():
    """The fast body of the pair has a friction of 0.12 in the step of 6 ms, the slow one of 0.008."""
    result = il.simulate(base(), tolerance={"contact_ratio": 0.05}, rng=1)
    assert result.attrs["integrator"] == "FineFlow"
    plan = plan_of(base(), integrator=FineFlow(jumps=False), step=0.006)
    assert [np.count_nonzero(plan.noise.rows == body) for body in (0, 1)] == [2, 1]
    assert plan_of(base(), integrator=il.ExactFlow(jumps=False), step=0.006).noise.rows.tolist() == [0, 1]


def test_a_step_without_an_error_needs_no_pairs():
    result = il.simulate(linear(), tolerance={"mean_square_displacement": 0.05}, rng=1)
    assert (result.mean_square_displacement_bias == 0.0).all()


def errors(scatter=0.0, bias=0.0, error=0.0, order=2, alike=True, shared=0.0):
    one, scatter, bias, error, shared, order = (np.array([item]) for item in (1.0, scatter, bias, error, shared, order))
    return Errors(np.array(["a"]), one, scatter, Bias(bias, error), shared, order, alike)


def test_errors_are_scatter_bias_and_the_error_of_it():
    assert errors(scatter=0.3, bias=-0.2, error=0.1).worst == pytest.approx(0.2 + 2.0 * math.hypot(0.3, 0.1))
    assert errors(scatter=0.4, shared=0.75).worst == pytest.approx(2.0 * math.hypot(0.4, 0.3))
    assert errors(scatter=math.nan).worst == math.inf
    assert errors(alike=False).worst == math.inf


def trial():
    """Realizations that take a second each, pairs that take half of it."""
    found = object.__new__(Trial)
    found.has = found.planned = Numbers(256, 128)
    found.each = Numbers(1.0, 0.5)
    return found


def test_a_step_is_halved_where_that_is_cheaper_than_more_realizations():
    """A bias is made up for by realizations: ``(0.94/(0.94 − bias))²`` times as many; half the step costs twice."""
    halvings = lambda **given: _halvings(trial(), errors(**{"scatter": 2.0} | given), 6)  # noqa: E731
    assert [halvings(bias=bias) for bias in (0.1, 0.2, 0.5, 0.94)] == [0, 0, 1, 1]
    assert [halvings(bias=-20.0, order=order) for order in (1, 2, 4)] == [6, 3, 2]
    assert halvings(bias=0.1, alike=False) == 1
    assert halvings(bias=1e6) == 6  # none is enough: as often as may be
    assert halvings(bias=0.0, scatter=math.nan) == 0


def test_pairs_tell_first_whether_to_halve_the_step():
    """Unless they cost as much as realizations at half the step."""
    many, few = errors(scatter=4.0, bias=0.6, error=0.25), errors(scatter=0.5, bias=0.6, error=0.25)
    assert (_halvings(trial(), many, 6), _halvings(trial(), few, 6)) == (0, 1)
    stage, goal = _next(trial(), many, 1e9, math.inf)
    assert goal.pairs > MORE_PAIRS * 128
    assert stage == (stage.pairs, min(goal.pairs, MOST_ADDED * 128))
    short, _ = _next(trial(), many, 300.0, math.inf)  # s: too short for the pairs
    assert trial().missing(short) == pytest.approx(300.0)


def test_wanted_numbers_are_enough_and_the_fewest():
    """Without a bias, numbers go with the square of the scatter; a bias leaves less for it, a error costs pairs."""
    has = Numbers(256, 256)
    scatter_alone = errors(scatter=2.0).wanted(has)
    assert scatter_alone == (pytest.approx(256 * (2.0 * 2.0 / 0.94) ** 2), 256)
    biased = errors(scatter=2.0, bias=0.47).wanted(has)
    assert biased.fine == pytest.approx(4.0 * scatter_alone.fine)
    errorful = errors(scatter=2.0, bias=0.3, error=0.3)
    wanted = errorful.wanted(has)
    assert 256 < wanted.pairs < wanted.fine < 2.0 * scatter_alone.fine
    then = errors(2.0 * math.sqrt(256 / wanted.fine), error=0.3 * math.sqrt(256 / wanted.pairs))
    assert then.worst < 0.94
    assert errors(scatter=0.1, bias=2.0).wanted(has).fine == math.inf


@pytest.mark.campaign
def test_tolerances_are_kept():
    """Runs of which as many as may be are farther off than was asked for, which is one of twenty."""
    network, name = base(), "mean_square_displacement"
    exact = il.exact(network).statistics()[name]
    found = [il.simulate(network, tolerance={name: 3e-3}, rng=seed) for seed in range(40)]
    off = np.array([float(np.abs(item[name] / exact - 1.0).max()) / 3e-3 for item in found])
    assert (off > 1.0).sum() <= 4  # more than that in 5 % of the cases, at one of twenty
    assert np.sqrt((off**2).mean()) > 0.2  # and no more realizations than are needed
    assert len({item.attrs["step"] for item in found}) == 1
