"""Jumps change no path: they are compared with the same noise taken step by step, and with exact laws."""

import numpy as np
import pytest
from laws import LossyContact
from scenes import base, changed, deviations, linear, plan_of

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators.exact_flow import WholeFlow
from impactlab.integrators.intervals import JUMP_LANES, jump_tables
from impactlab.kernels.rows import FLUX
from impactlab.linear.laws import NEVER
from impactlab.linear.transitions import transition
from impactlab.simulation.block import Block
from impactlab.simulation.ensemble import run_block
from impactlab.simulation.memory_use import sizes

SIGMA = float(np.sqrt(il.exact(base(clearance=5.0)).statistics()["variance_displacement"].sum()))
"""Standard deviation of the gap of the base case without contacts (m)."""


def planned(network, duration=60.0, realizations=64, **options):
    return plan_of(network, duration=duration, realizations=realizations, **({"workers": 1} | options))


def always_near(plan):
    """Return the plan with bounds that clear no interval, so that every step is taken."""
    jumps = plan.method.jumps._replace(limit=plan.method.jumps.limit - 1e9, nearest=plan.method.jumps.nearest - 1e9)
    return changed(plan, method__jumps=jumps)


def three():
    """Three bodies of unequal masses, one at a wall, one without noise."""
    bodies = {
        "a": il.LinearOscillator.from_frequency(natural_frequency=60.0, damping_ratio=0.1, mass=0.5),
        "b": il.LinearOscillator.from_frequency(natural_frequency=7.0, damping_ratio=0.2, mass=2.0),
        "c": il.LinearOscillator.from_frequency(natural_frequency=20.0, damping_ratio=0.05),
    }
    contacts = {
        "ab": il.Contact("a", "b", il.HertzContact(1e4), clearance=0.3),
        "wall": il.Contact(il.WALL, "b", LossyContact(2e3, damping=50.0), clearance=0.3),
        "bc": il.Contact("b", "c", il.LinearContact(3e3), clearance=0.32),
    }
    noise = {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(2.0), "c": il.WhiteNoise(0.3)}
    return il.Network(bodies, contacts, noise)


@pytest.mark.full
@pytest.mark.parametrize(
    "network", [base(clearance=2.0 * SIGMA), base(clearance=3.0 * SIGMA), three()], ids=["2", "3", "three"]
)
def test_jumps_change_no_path(network):
    """With the same noise every sum over steps is the same to rounding, whether steps are skipped or not."""
    plan = planned(network, records=[il.Density(bins=20).resolved(Model.of(network))], realizations=520)
    assert plan.method.jumps is not None
    jumping, stepping = run_block(plan, 0), run_block(always_near(plan), 0)
    assert stepping.contacts[:, FLUX].sum() > 0, "contacts close in this run"
    for one, other in ((jumping.bodies, stepping.bodies), (jumping.contacts, stepping.contacts)):
        scale = np.abs(other).max(axis=-1, keepdims=True)
        assert (np.abs(one - other) <= 1e-9 * scale).all()
    np.testing.assert_array_equal(jumping.records[0]["counts"], stepping.records[0]["counts"])


def test_halves_and_steps_of_noise_add_up_and_have_the_covariance_of_their_intervals():
    """The tables keep ``Q(2h) = Q + A Q Aᵀ``: what is drawn for parts has the law of the parts."""
    model = Model.of(three())
    step, leaf, levels = 0.004, 8, 3
    tables = jump_tables(model, step, leaf, levels, np.ones((2, 3)), np.zeros(3))
    for level in range(1, levels + 1):
        half = transition(model.mass, model.damping, model.stiffness, model.noise.intensity, step * (leaf << level) / 2)
        whole = transition(model.mass, model.damping, model.stiffness, model.noise.intensity, step * (leaf << level))
        gain = tables.noise.gain[level].reshape(-1, 2, 2)
        root = np.zeros_like(gain)
        root[:, 0, 0], root[:, 1, 0], root[:, 1, 1] = tables.noise.rest[level].T
        first = gain @ whole[1] @ gain.transpose(0, 2, 1) + root @ root.transpose(0, 2, 1)
        np.testing.assert_allclose(first, half[1], rtol=1e-9)
        rest = np.eye(2) - half[0] @ gain  # of the whole, in the second half
        second = rest @ whole[1] @ rest.transpose(0, 2, 1) + half[0] @ root @ root.transpose(0, 2, 1) @ half[
            0
        ].transpose(0, 2, 1)
        np.testing.assert_allclose(second, half[1], rtol=1e-9)
        mixed = gain @ whole[1] @ rest.transpose(0, 2, 1) - root @ root.transpose(0, 2, 1) @ half[0].transpose(0, 2, 1)
        np.testing.assert_allclose(mixed, np.zeros_like(mixed), atol=1e-9 * np.abs(half[1]).max())
    a, _ = transition(model.mass, model.damping, model.stiffness, model.noise.intensity, step)
    total = np.zeros_like(a)
    for term in tables.noise.terms.reshape(leaf, -1, 2, 2):
        total = a @ total + term
    inverse = tables.noise.inverse[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    np.testing.assert_allclose(total @ inverse, np.broadcast_to(np.eye(2), a.shape), atol=1e-9)


def test_nothing_is_overlooked():
    """The scatter about the mean path, with the sigmas of the limit, is that of a bridge, drawn step by step."""
    model = Model.of(base(clearance=1.0))
    step, leaf, levels = 0.006, 8, 2
    window = np.array([0.01])
    tables = jump_tables(model, step, leaf, levels, np.ones((2, 2)), window)
    steps = leaf << levels
    a, q = transition(model.mass, model.damping, model.stiffness, model.noise.intensity, step)
    normals = np.random.default_rng(5).standard_normal((steps, 2, 2, 40000))
    path, roots = [np.zeros((2, 2, 40000))], np.linalg.cholesky(q)
    for each in normals:
        path.append(a @ path[-1] + roots @ each)
    end = path[-1]
    table = tables.path[-steps:, :2]
    mean = table[..., 2:3] * end[None, :, 0] + table[..., 3:] * end[None, :, 1]
    apart = np.array(path)[1:, :, 0] - mean
    gap = apart[:, 0] - apart[:, 1]
    scatter = (1.0 - 0.01 - tables.limit[-steps:, 0]) / 7.6
    found = gap.std(axis=1)
    middle = slice(0, steps - 1)
    assert np.abs(found[middle] / scatter[middle] - 1.0).max() < 0.04  # 40000 samples, and sigmas of about 7.6
    assert found[-1] < 1e-12
    from scipy.special import ndtr

    sigmas = (0.99 - tables.limit[-steps:, 0][middle]) / found[middle]
    assert (steps * ndtr(-sigmas) < 3.0 * NEVER).all()


def test_bounds_are_above_what_a_search_finds():
    """Where the bound clears an interval the search does, for any state and noise."""
    model = Model.of(three())
    spread = np.array([[0.05, 0.3, 0.1], [3.0, 2.0, 2.0]])
    tables = jump_tables(model, 0.004, 8, 3, spread, np.zeros(3))
    generator = np.random.default_rng(7)
    z = generator.standard_normal((3, 4, 4000)) * generator.uniform(0.1, 4.0, 4000)
    x, v = spread[:, :, None] * z[:, :2].transpose(1, 0, 2)
    wx = tables.noise.draw[:, :1] * z[:, 2]
    wv = tables.noise.draw[:, 1:2] * z[:, 2] + tables.noise.draw[:, 2:] * z[:, 3]
    rows = tables.path[-64:, :3]
    path = rows[..., :1] * x + rows[..., 1:2] * v + rows[..., 2:3] * wx + rows[..., 3:] * wv
    most = tables.reach[:3, 2:] * np.sqrt((z**2).sum(axis=1))
    assert (np.abs(path).max(axis=0) <= most * (1.0 + 1e-12)).all()
    assert (np.abs(path).max(axis=0) > 0.9 * most).any(), "the bound is sharp"


def test_statistics_agree_with_the_exact_law():
    network = base(clearance=1.5 * SIGMA)
    result = il.simulate(network, duration=200.0, realizations=2 * JUMP_LANES, rng=11)
    assert result.attrs["longest_jump"] > 0.0
    names = (
        "mean_square_displacement", "variance_displacement", "mean_square_velocity", "mean_displacement",
        "contact_ratio", "contact_rate", "mean_contact_force",
    )  # fmt: skip
    off = deviations(result, il.exact(network).statistics(), names, relative=5e-4)
    assert max(off.values()) < 4.0, off


def test_scenes_that_do_not_gain_take_every_step():
    """The base case, given starts, other forces and statistics of every step."""
    far = base(clearance=4.0 * SIGMA)
    assert planned(far).method.jumps is not None
    assert planned(base()).method.jumps is None
    assert planned(far, integrator=il.ExactFlow(jumps=False)).method.jumps is None
    assert planned(far, initial={"displacement": {"two": 0.1}}).method.jumps is None
    assert planned(far, records=[il.PerRealization()]).method.jumps is None
    assert planned(far, records=[il.Trajectory(interval=0.01)]).method.jumps is None
    assert (
        planned(far.replace(couplings={"spring": il.Coupling("one", "two", il.LinearCoupling(1.0))})).method.jumps
        is None
    )
    cubic = il.DuffingOscillator.from_frequency(natural_frequency=6.0, damping_ratio=0.1, cubic=1.0)
    assert planned(far.replace(oscillators={"two": cubic})).method.jumps is None


def test_intervals_fit_between_samples_and_batches():
    far = base(clearance=4.0 * SIGMA)
    plan = planned(far, records=[il.Trajectory(interval=1.0)], realizations=4, duration=300.0)
    assert plan.method.jumps is not None
    interval = plan.method.jumps.steps
    assert plan.observed.every * plan.clock.step == pytest.approx(1.0)
    for number in (plan.observed.every, plan.clock.steps, plan.clock.spin_up_steps, *plan.clock.boundaries):
        assert number % interval == 0
    coarse = planned(far, step=2.0 * plan.clock.step, coarse=True, duration=300.0)
    longest = planned(far, duration=300.0).method.jumps.steps
    assert coarse.method.jumps.steps * coarse.clock.step == pytest.approx(longest * plan.clock.step)


def test_a_realization_is_the_same_in_any_block():
    plan = planned(base(clearance=2.0 * SIGMA), realizations=500)
    assert plan.method.jumps is not None
    whole = run_block(plan, 0)
    part = run_block(changed(plan, realizations__lanes=24), 3)
    np.testing.assert_array_equal(part.bodies, whole.bodies[..., 72:96])
    np.testing.assert_array_equal(part.contacts, whole.contacts[..., 72:96])


@pytest.mark.filterwarnings("ignore:1 contact:impactlab.AccuracyWarning")
def test_trajectories_are_the_same_with_longer_and_shorter_intervals():
    """Samples every second and statistics alone share the noise of equal intervals; the law is the same."""
    far = base(clearance=4.0 * SIGMA)
    result = il.simulate(far, duration=64.0, realizations=600, record=il.Trajectory(interval=1.0), rng=3)
    assert result.attrs["longest_jump"] > 0.0
    late = result["displacement"].sel(oscillator="two").isel(time=slice(1, None, 3))
    exact = float(il.exact(far).statistics()["variance_displacement"].sel(oscillator="two"))
    by_realization = (late**2).mean("time")
    error = float(by_realization.std()) / np.sqrt(by_realization.sizes["realization"])
    assert abs(float(by_realization.mean()) - exact) < 4.0 * error


def test_the_exact_flow_of_a_step_makes_up_that_of_an_interval():
    assert WholeFlow.phases == 1
    model = Model.of(base())
    flows = WholeFlow().flows(model, 0.006)
    assert flows.transition.shape == (1, 2, 2, 2)
    a, q = transition(model.mass, model.damping, model.stiffness, model.noise.intensity, 0.006)
    np.testing.assert_array_equal(flows.transition[0], a)
    np.testing.assert_array_equal(flows.covariance[0], q)


def test_work_does_not_grow_with_time_where_nothing_can_touch():
    plans = [planned(linear(), duration=duration) for duration in (1e5, 1e12)]
    assert plans[0].clock.steps == plans[1].clock.steps
    result = il.simulate(linear(), duration=1e12, realizations=8, rng=1)
    value = result["mean_square_displacement"]
    assert float(value[0]) == pytest.approx(1.0 / (1.6 * np.pi**2), rel=1e-9)
    direct = result["direct_mean_square_displacement"]
    assert abs(float(direct[0] - value[0])) < 4.0 * float(result["direct_mean_square_displacement_standard_error"][0])


def test_bodies_that_nothing_can_touch_change_nothing_and_take_few_steps():
    """The pair has the same bits with and without them; their law is exact."""
    others = {"far": il.LinearOscillator.from_frequency(natural_frequency=300.0, damping_ratio=0.1)}
    noise = {"far": il.WhiteNoise(2.0)}
    alone = il.simulate(base(), duration=20.0, realizations=64, rng=5)
    network = il.Network({**others, **base().oscillators}, base().contacts, {**base().excitations, **noise})
    result = il.simulate(network, duration=20.0, realizations=64, rng=5)
    assert list(result["oscillator"].values) == ["far", "one", "two"]
    assert result.attrs["step"] == alone.attrs["step"]
    for name in ("mean_square_displacement", "mean_square_velocity_standard_error", "contact_ratio"):
        own = result[name].sel(oscillator=["one", "two"]) if "oscillator" in result[name].dims else result[name]
        np.testing.assert_array_equal(own, alone[name])
    exact = np.pi * 2.0 / (60.0 * 300.0**2)
    assert float(result["mean_square_displacement"].sel(oscillator="far")) == pytest.approx(exact, rel=1e-9)
    again = il.rerun(result)
    np.testing.assert_array_equal(again["mean_square_displacement"], result["mean_square_displacement"])
    kept = il.simulate(network, duration=20.0, realizations=64, rng=5, record=il.Trajectory(interval=0.5))
    assert kept["displacement"].sizes["oscillator"] == 3


def test_memory_of_a_block_is_foreseen():
    plan = planned(base(clearance=2.0 * SIGMA), realizations=500)
    block = Block(plan, plan.realizations.of(0), lambda steps: None)

    def nbytes(item):
        return sum(map(nbytes, item)) if isinstance(item, tuple) else item.nbytes

    total = nbytes((block.state, block.history, block.sums.bodies, block.sums.contacts))
    assert total / plan.realizations.lanes == pytest.approx(sizes(plan)[0], rel=0.2)
