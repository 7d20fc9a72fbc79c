"""The bias of a step, measured on the network."""

import math
import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import xarray as xr
from impactlab_numerics.laws.contacts import BilinearContact
from impactlab_numerics.laws.excitations import PulsatingNoise
from laws import Cosine, Interval
from scenes import plan_of

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.machine import tuned
from impactlab.plan.request import Request
from impactlab.results.schema import scatter_of, statistics
from impactlab.simulation.block import Block
from impactlab.simulation.idle_bodies import joined
from impactlab.simulation.planning import make_plan
from impactlab.step_control.measured.bias import MARGIN_OF_BIAS, TOLERATED, USUAL_BIAS, Bias, size_of
from impactlab.step_control.measured.segment_statistics import TOGETHER, together
from impactlab.step_control.measured.segments import Runs, step_bias
from impactlab.step_control.measured.step_bias import BIASED, StepBias
from impactlab.step_control.rules.automatic import certified, highest_step
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies

BODY = il.LinearOscillator.from_frequency(1.0, 0.1)
HEAT = il.WhiteNoise(0.2 / np.pi)
START = {"displacement": {"a": 1.0}}


def at_wall(law, body=BODY, excitation=HEAT):
    contacts = {"wall": il.Contact("a", il.WALL, law, clearance=0.2)}
    return il.Network({"a": body}, contacts, {"a": excitation})


def is_certified(network):
    return certified(Model.of(network), np.full(len(network.contacts), 0.3), 0.1)


@pytest.mark.parametrize(
    ("network", "known"),
    [
        (at_wall(il.HertzContact(100.0)), True),
        (at_wall(il.LinearContact(100.0)), True),
        (at_wall(il.PowerLawContact(100.0, exponent=2.0)), True),
        (at_wall(il.HertzContact(100.0), il.DuffingOscillator(1.0)), True),
        (at_wall(il.HertzContact(100.0), il.LinearOscillator.from_frequency(1.0, 4.0)), True),
        (at_wall(il.HertzContact(100.0), il.LinearOscillator.from_frequency(1.0, 6.0)), False),
        (at_wall(il.PowerLawContact(100.0, exponent=0.3)), False),
        (at_wall(BilinearContact(30.0, second=1000.0, distance=0.1)), False),
        (at_wall(il.KelvinVoigtContact(100.0, damping=1.0)), False),
        (at_wall(il.HertzContact(100.0), excitation=Cosine(1.0, frequency=1.3)), False),
        (at_wall(il.HertzContact(100.0), excitation=PulsatingNoise(1.0, frequency=1.0)), False),
        (at_wall(il.HertzContact(100.0), excitation=il.ShinozukaNoise(0.1, band=(0.0, 1.0), components=100)), False),
    ],
    ids=repr,
)
def test_the_certified_class(network, known):
    assert is_certified(network) == known


def test_certified_networks_are_not_measured():
    result = il.simulate(at_wall(il.HertzContact(100.0)), 10.0, realizations=64, rng=1)
    assert not [name for name in result if str(name).endswith("_step_bias")]


@pytest.mark.full
def test_a_measured_step_does_not_depend_on_the_seed():
    network = at_wall(il.KelvinVoigtContact(100.0, damping=30.0))
    one, other = (il.simulate(network, 20.0, realizations=64, rng=seed) for seed in (1, 2))
    assert one.attrs["step"] == other.attrs["step"]
    assert one.mean_square_velocity_step_bias.identical(other.mean_square_velocity_step_bias)
    assert abs(one.mean_square_velocity_step_bias.item()) < 2.0 * TOLERATED
    assert not one.mean_square_velocity.equals(other.mean_square_velocity)


@pytest.mark.full
def test_a_step_that_is_finer_than_needed_becomes_larger():
    """The rules take bodies on a heavy base for as hot as the base, until their velocities have been measured."""
    base = il.LinearOscillator.from_frequency(6.0, 0.1, mass=1e5)
    springs = {
        name: il.Coupling("base", name, il.LinearCoupling(rate**2, damping=0.2 * rate))
        for name, rate in (("left", 10.0), ("right", 6.0))
    }
    bodies = {"base": base, "left": il.LinearOscillator(), "right": il.LinearOscillator()}
    law = il.PowerLawContact(1e3, exponent=2.0)
    contacts = {"pair": il.Contact("left", "right", law, clearance=0.05)}
    network = il.Network(bodies, contacts, {"base": il.WhiteNoise(1e10)}, springs)
    options = {"duration": 150.0, "realizations": 512}
    larger = il.simulate(network, **options, rng=1)
    by_rules = il.simulate(network, **options, integrator=il.ExactFlow(measured=False), rng=2)
    assert larger.attrs["step"] > 1.9 * by_rules.attrs["step"]
    for name in BIASED:
        if name in larger:
            errors = np.hypot(*(item[f"{name}_standard_error"] for item in (larger, by_rules)))
            assert (np.abs(larger[name] - by_rules[name]) < 4.0 * errors).all(), name


@pytest.mark.parametrize(
    ("law", "further"), [(il.HertzContact(100.0), True), (BilinearContact(30.0, second=1e4, distance=2.0), False)]
)
def test_steps_stay_stable_where_a_law_is_hardly_ever_stiff(law, further):
    """Of known powers the stiffness at ten temperatures is known; a stop is met seldom, and throws bodies out then."""
    model, method = Model.of(at_wall(law)), il.ExactFlow()
    stiffening = Stiffening.of(model, energies(model, "stationary", 100.0))
    recommended = method.recommended_step(model, stiffening.links, stiffening.bodies)
    highest = highest_step(model, method, stiffening, 0.0, 0.0, "stationary")
    assert highest == pytest.approx(2.0 * recommended if further else recommended)


@pytest.mark.parametrize(("bias", "error", "automatic", "fine"), [
    (0.0, 0.0, 0.1, True),
    (0.002, 0.0, 0.1, False),
    (0.0, math.inf, 0.1, True),  # unseen, at the step of the rules
    (0.0, math.inf, 0.07, False),  # at a larger one
    (0.0, 0.001, 0.05, True),
])  # fmt: skip
def test_which_biases_will_do(bias, error, automatic, fine):
    found = StepBias(0.1, {"contact_rate": Bias(np.array([bias]), np.array([error]))}, {"contact": ("a",)})
    assert found.will_do(automatic) == fine


def of_states(step, bias, name="law_state_growth_rate", **options):
    """Return the bias of one state."""
    return StepBias(step, {name: Bias(np.array([bias]), np.zeros(1))}, {"state": ("g.worn",)}, **options)


def test_what_is_foreseen_says_so():
    """Biases of a smaller step fall with a power of it, and the first power is no surprise."""
    for order in (1.5, 2.0):
        found = of_states(0.4, 0.08, order=order, growth=np.ones(1))
        smaller = found.at(0.1)
        (bias,), (error,) = smaller.bias["law_state_growth_rate"][:2]
        assert bias == pytest.approx(0.08 / 4.0**order)
        assert bias + error == pytest.approx(0.08 / 4.0)
        comments = []
        for item in (found, smaller):
            data = {item: ("state", np.ones(1)) for item in of_names("law_state_growth_rate")}
            comments.append(item.added_to(xr.Dataset(data), 0.1).law_state_growth_rate_step_bias.attrs["comment"])
        assert comments[0].startswith("measured on the network; standard error")
        assert comments[1].startswith("measured on the network at a step of 0.4 s, and reduced; standard error")


def of_names(name):
    return name, f"{name}_standard_error"


def test_states_will_do_with_what_need_not_be_said():
    assert of_states(0.1, 0.004).will_do(0.1)
    assert not of_states(0.1, 0.006).will_do(0.1)
    assert of_states(0.1, 0.004).better == 0.1
    assert of_states(0.1, 0.02).better == pytest.approx(0.04)


def test_a_state_that_follows_the_step_is_not_hunted():
    count = of_states(0.1, -0.5)
    assert of_states(0.025, -0.5).follows_the_step(count)
    assert not of_states(0.09, -0.5).follows_the_step(count)  # no other step
    assert not of_states(0.025, -0.2).follows_the_step(count)
    assert not of_states(0.025, -0.5, name="mean_law_state").follows_the_step(count)


@pytest.mark.parametrize(
    ("name", "error", "rate", "time", "unclear"),
    [
        ("mean_square_velocity", 1e-3, 1.0, 1e4, False),
        ("mean_square_velocity", 3e-3, 1.0, 1e4, True),  # however long the run is
        ("mean_square_velocity", np.inf, 1.0, 1e4, False),  # nothing moves: nothing will be learned
        ("contact_ratio", 3e-3, 1.0, 1e8, True),
        ("contact_ratio", 3e-3, 1.0, 1e4, False),  # its own standard error is as large
        ("contact_ratio", 3e-3, 0.0, 1e8, False),
    ],
)
def test_a_measurement_goes_on_where_a_bias_may_be_worth_saying(name, error, rate, time, unclear):
    found = StepBias(0.1, {name: Bias(np.zeros(1), np.array([error]))}, {}, {"contact_rate": np.array([rate])})
    assert found.unclear(time) == unclear


@pytest.mark.full
def test_the_fine_path_begins_where_the_coarse_one_is_under_friction_too():
    """A body at ``c h/m`` of 4 is seen at a velocity half way through its kick that is -0.28 K x h/m on average."""
    body = il.LinearOscillator(stiffness=1.0, damping=60.0)
    contact = il.Contact("a", il.WALL, il.LinearContact(20.0), clearance=-5.0)
    network = il.Network({"a": body}, {"w": contact}, {"a": il.WhiteNoise(60.0 / np.pi)})
    exact, model, step = il.exact(network).statistics(), Model.of(network), 4.0 / 60.0
    plan_of = partial(make_plan, model)
    found = step_bias(
        Runs(plan_of, Block), model, None, plan_of(Request(2000.0, 64, step, il.ExactFlow(), None, None, [], (1, 2)))
    )
    method = il.ExactFlow(measured=False)
    runs = il.simulate(network, 2000.0, realizations=512, step=step, rng=1, integrator=method)
    for name in ("mean_square_displacement", "mean_contact_force"):
        value, error = (float(runs[item][0] / exact[name][0]) for item in (name, f"{name}_standard_error"))
        assert abs(found.bias[name].value[0] - (value - 1.0)) < 3.5 * math.hypot(found.bias[name].error[0], error)


@pytest.mark.full
@pytest.mark.parametrize(
    "start", [-0.01, *(pytest.param(start, marks=pytest.mark.campaign) for start in (-0.0137, -0.0171))]
)
def test_a_bounce_has_the_restitution_of_its_dashpot(start):
    """One event of a path: restarted in segments, at states of the coarse one, it was up to 0.9 % off and not told."""
    ratio, stiffness = 0.2, 1e6
    law = il.KelvinVoigtContact(stiffness, damping=2.0 * ratio * math.sqrt(stiffness))
    angle = math.sqrt(1.0 - ratio**2)
    network = il.Network({"ball": il.LinearOscillator()}, {"floor": il.Contact("ball", il.WALL, law)})
    begin = {"displacement": {"ball": start}, "velocity": {"ball": 1.0}}
    result = il.simulate(network, 1.0, initial=begin, record=il.Trajectory(1.0), integrator=il.ExactFlow())
    # the dashpot would pull before the spring is free: contact ends where the force is 0
    restitution = math.exp(-2.0 * ratio / angle * math.atan2(angle, ratio))
    assert float(-result.velocity[0, -1, 0]) == pytest.approx(restitution, rel=3e-3)


@pytest.mark.full
def test_a_path_from_rest_is_right_to_its_end():
    """A force of 1 Hz on a stop, of which a part of a step at the beginning changes E[x²] over 256 s by a third."""
    body = il.LinearOscillator.from_frequency(3.0, 0.05)
    contact = il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.02)
    network = il.Network({"a": body}, {"w": contact}, {"a": Cosine(1.0, frequency=2.0 * math.pi)})
    result = il.simulate(network, 256.0, initial={}, integrator=il.ExactFlow())
    fine = il.simulate(network, 256.0, initial={}, integrator=il.RungeKutta4(), step=2.0**-12)
    for name in ("mean_square_displacement", "mean_square_velocity", "contact_rate"):
        assert float(result[name][0]) == pytest.approx(float(fine[name][0]), rel=5e-3)


@pytest.mark.full
def test_it_is_made_again(tmp_path):
    network = at_wall(il.KelvinVoigtContact(100.0, damping=30.0))
    result = il.simulate(network, 20.0, realizations=64, rng=1)
    il.save(result, tmp_path / "a.nc")
    again = il.rerun(tmp_path / "a.nc")
    for name in ("mean_square_velocity", "mean_square_velocity_step_bias"):
        np.testing.assert_array_equal(again[name], result[name])


@pytest.mark.parametrize(
    ("damping", "step"), [(20.0, 0.1), *(pytest.param(c, 0.05, marks=pytest.mark.campaign) for c in (40.0, 100.0))]
)
def test_what_is_measured_is_what_is_true(damping, step):
    """Sign and size of the bias of a step that is too large, within a factor of three."""
    network = at_wall(il.KelvinVoigtContact(100.0, damping=damping))
    options = {"duration": 200.0, "realizations": 512, "spin_up": 50.0}
    with pytest.warns(il.AccuracyWarning, match=r"At the step of .* is about .* too (large|small), as measured"):
        coarse = il.simulate(network, **options, step=step, rng=1)
    fine = il.simulate(network, **options, rng=2)
    for name in ("mean_square_displacement", "mean_square_velocity", "contact_ratio"):
        true = coarse[name].item() / fine[name].item() - 1.0
        error = math.hypot(coarse[f"{name}_standard_error"].item(), fine[f"{name}_standard_error"].item())
        error /= abs(fine[name].item())
        if abs(true) > 0.01 + 3.0 * error:
            assert (
                0.33 * true < coarse[f"{name}_step_bias"].item() < 3.0 * true
                or 3.0 * true < coarse[f"{name}_step_bias"].item() < 0.33 * true
            ), name


@pytest.mark.parametrize(
    ("bias", "error", "allowance"),
    [
        (2e-6, 0.0, 2e-6),  # tiny and certain
        (TOLERATED, 1e-9, TOLERATED),
        (0.03, np.inf, USUAL_BIAS),  # nothing was seen
        (0.03, 10.0, USUAL_BIAS),
        (0.0, USUAL_BIAS, USUAL_BIAS / math.sqrt(2.0)),
        (0.004, 0.001, 0.004),  # far from usual, but certain
    ],
)
def test_what_is_allowed_for_a_bias_follows_what_is_known_of_it(bias, error, allowance):
    found = StepBias(0.1, {"contact_ratio": Bias(np.array([bias]), np.array([error]))}, {})
    assert found.allowance("contact_ratio") == pytest.approx(allowance, rel=1e-3)


def test_the_allowance_is_the_root_mean_square_of_a_bias_that_was_measured():
    rng, error = np.random.default_rng(3), 0.6 * USUAL_BIAS
    biases = USUAL_BIAS * rng.standard_normal(100_000)
    seen, name = biases + error * rng.standard_normal(100_000), "mean_contact_force"
    found = StepBias(0.1, {name: Bias(seen, np.full(100_000, error))}, {})
    difference = (biases**2 - found.allowance(name) ** 2)[np.abs(seen) < MARGIN_OF_BIAS * error]
    assert abs(difference.mean()) < 4.0 * difference.std() / math.sqrt(len(difference))


def test_standard_errors_allow_for_the_bias_of_a_measured_step():
    """They are those of the scatter beside the allowance, for the plain means too; the scatter is not lost."""
    network = at_wall(il.KelvinVoigtContact(100.0, damping=30.0))
    result = il.simulate(network, 20.0, realizations=64, rng=1)
    plain = il.simulate(
        network, 20.0, realizations=64, rng=1, step=result.attrs["step"], integrator=il.ExactFlow(measured=False)
    )
    for name in BIASED:
        allowance = result[f"{name}_step_allowance"].values
        for key in {name, f"direct_{name}"} & set(result):
            error, scatter = (item[f"{key}_standard_error"].values for item in (result, plain))
            np.testing.assert_array_equal(result[key], plain[key])
            np.testing.assert_allclose(error, np.hypot(scatter, allowance), rtol=1e-12)
            np.testing.assert_allclose(scatter_of(result, key), scatter, rtol=1e-9)
            np.testing.assert_array_equal(scatter_of(plain, key), scatter)
    assert result.mean_velocity_standard_error.equals(plain.mean_velocity_standard_error)
    assert 0.0 < result.contact_ratio_step_allowance.item() < 3.0 * TOLERATED * result.contact_ratio.item()
    xr.testing.assert_allclose(il.effective_samples(result), il.effective_samples(plain), rtol=1e-9)


def test_bodies_that_nothing_touches_have_no_bias():
    name, network = "mean_square_velocity", il.Network({"b": BODY, "a": BODY})
    busy, idle = (statistics([body], [], {name: [1.0]}, {name: [0.1]}, drift=0.0) for body in "ab")
    measured = StepBias(0.1, {name: Bias(np.array([1e-3]), np.array([0.0]))}, {"oscillator": ("a",)})
    both = joined(network, measured.added_to(busy, 0.1), idle)
    np.testing.assert_array_equal(both[f"{name}_step_bias"], [0.0, 1e-3])
    np.testing.assert_array_equal(both[f"{name}_step_allowance"], [0.0, 1e-3])
    np.testing.assert_array_equal(both[f"{name}_standard_error"], [0.1, math.hypot(0.1, 1e-3)])


@pytest.mark.full
def test_a_tolerance_counts_the_bias_for_itself():
    network = at_wall(il.KelvinVoigtContact(100.0, damping=30.0))
    result = il.simulate(network, tolerance={"mean_square_displacement": 0.1}, rng=1)
    assert "mean_square_displacement_bias" in result
    assert not [name for name in result if name.endswith(("_step_bias", "_step_allowance"))]


def test_a_coarse_step_of_a_certified_network_is_told():
    network = at_wall(il.LinearContact(100.0))
    automatic = il.simulate(network, 100.0, realizations=64, rng=1).attrs["step"]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        il.simulate(network, 100.0, realizations=64, rng=1, step=3.0 * automatic)
    assert [item for item in caught if "as measured" in str(item.message)]


@pytest.mark.full
def test_one_path_without_noise_is_measured_whole():
    """The bias of a bounce at a dashpot is known from it alone, and made small."""
    network = il.Network({"a": BODY}, {"wall": il.Contact("a", il.WALL, il.KelvinVoigtContact(400.0, damping=8.0))})
    result = il.simulate(network, 20.0, initial={"displacement": {"a": -1.0}}, integrator=il.ExactFlow())
    fine = il.simulate(network, 20.0, initial={"displacement": {"a": -1.0}}, rng=1, step=result.attrs["step"] / 16.0)
    assert result.mean_square_velocity.item() == pytest.approx(fine.mean_square_velocity.item(), rel=5e-3)
    assert result.mean_contact_force.item() == pytest.approx(fine.mean_contact_force.item(), rel=5e-3)


@pytest.mark.full
def test_a_body_that_a_load_holds_still_asks_for_no_step():
    """Its variance is what the start has left, 10⁻⁷ of its mean square, or rounding."""
    contacts = {
        "left": il.Contact(il.WALL, "still", il.LinearContact(680.0), clearance=-0.2),
        "far": il.Contact("shaken", "still", il.LinearContact(7.0), clearance=0.2),
        "right": il.Contact("shaken", il.WALL, il.LinearContact(17.0)),
    }
    bodies = {
        "still": il.LinearOscillator(mass=0.26, damping=0.94, stiffness=12.0),
        "shaken": il.LinearOscillator(mass=0.95, damping=1.8, stiffness=24.0),
    }
    network = il.Network(bodies, contacts, {"still": il.ConstantForce(74.0), "shaken": HEAT})
    result = il.simulate(network, 65.0, realizations=64, rng=1)
    assert result.attrs["step"] > 2e-3


def test_realizations_are_taken_together_where_there_are_many():
    """Means stay what they are, and so do their standard errors as far as these are known."""
    few, many = np.random.default_rng(1).normal(size=(2, 3, 64 * TOGETHER))
    np.testing.assert_array_equal(together(few[:, :TOGETHER]), few[:, :TOGETHER])
    groups = together(many)
    assert groups.shape == (3, 64)
    np.testing.assert_allclose(groups.mean(axis=-1), many.mean(axis=-1), atol=1e-15)
    ratio = groups.std(axis=-1) * math.sqrt(TOGETHER) / many.std(axis=-1)
    np.testing.assert_allclose(ratio, 1.0, atol=4.0 / math.sqrt(2.0 * 64))  # 4 standard errors


@pytest.mark.campaign
def test_a_step_that_is_twice_enlarged_is_measured_with_the_velocities_that_it_was_chosen_with():
    """At four times the step of the rules; without them it would be refused as too large."""
    base = il.LinearOscillator.from_frequency(6.0, 0.1, mass=1e5)
    springs = {
        name: il.Coupling("base", name, il.LinearCoupling(rate**2, damping=0.2 * rate))
        for name, rate in (("left", 10.0), ("right", 6.0))
    }
    bodies = {"base": base, "left": il.LinearOscillator(), "right": il.LinearOscillator()}
    contacts = {"pair": il.Contact("left", "right", il.PowerLawContact(1e3, exponent=2.0), clearance=0.05)}
    network = il.Network(bodies, contacts, {"base": il.WhiteNoise(1e10)}, springs)
    by_rules = plan_of(network, duration=700.0, realizations=512).clock.step
    assert il.simulate(network, 700.0, realizations=512, rng=1).attrs["step"] > 3.9 * by_rules


@pytest.mark.full
def test_a_body_that_nothing_moves_makes_no_step_smaller():
    pressed = il.Contact("b", il.WALL, il.KelvinVoigtContact(1e3, damping=5.0), clearance=-0.3)
    wall = il.Contact("a", il.WALL, il.KelvinVoigtContact(1e3, damping=5.0), clearance=0.1)
    alone = il.Network({"a": BODY}, {"wall": wall}, {"a": HEAT})
    both = il.Network({"a": BODY, "b": BODY}, {"wall": wall, "pressed": pressed}, {"a": HEAT})
    one, two = (il.simulate(network, 50.0, realizations=64, rng=1) for network in (alone, both))
    assert two.attrs["step"] > 0.5 * one.attrs["step"]


@pytest.mark.full
def test_a_path_of_few_steps_is_measured():
    network = il.Network(
        {"a": BODY}, {"wall": il.Contact("a", il.WALL, il.KelvinVoigtContact(1e3, damping=5.0), clearance=0.1)}
    )
    result = il.simulate(network, 0.01, initial={"displacement": {"a": 0.2}}, integrator=il.ExactFlow())
    assert np.isfinite(result.mean_square_velocity.item())


@pytest.mark.campaign
def test_noise_that_comes_late_is_measured():
    """After most of a run in which hardly anything moves."""
    network = at_wall(
        il.KelvinVoigtContact(100.0, damping=30.0), excitation=Interval(6.0 / np.pi, begin=120.0, end=150.0)
    )
    options = {"duration": 200.0, "realizations": 256}
    with pytest.warns(il.AccuracyWarning, match="as measured on this network"):
        coarse = il.simulate(network, **options, step=0.1, rng=1)
    fine = il.simulate(network, **options, step=0.1 / 16.0, integrator=il.ExactFlow(measured=False), rng=2)
    for name in ("mean_square_velocity", "mean_contact_force"):
        true, bias = coarse[name].item() / fine[name].item() - 1.0, coarse[f"{name}_step_bias"].item()
        error = math.hypot(*(scatter_of(item, name).item() / fine[name].item() for item in (coarse, fine)))
        assert bias > 0.02, name
        assert abs(bias - true) < 3.0 * error + 0.5 * abs(true), name


@pytest.mark.parametrize(
    ("ratio", "damping", "duration"), [(0.01, 0.5, 60.0), pytest.param(0.03, 2.0, 40.0, marks=pytest.mark.campaign)]
)
def test_what_a_path_gains_at_first_it_keeps_to_its_end(ratio, damping, duration):
    """A bias of the energy of a free motion decays as friction takes energy away, not as its ripple does."""
    body = il.LinearOscillator.from_frequency(1.0, ratio)
    network = at_wall(il.KelvinVoigtContact(300.0, damping=damping), body, il.WhiteNoise(1e-9))
    options = {"duration": duration, "realizations": 64, "initial": {"displacement": {"a": -2.0}}, "rng": 1}
    with pytest.warns(il.AccuracyWarning, match="as measured on this network"):
        coarse = il.simulate(network, **options, step=0.035)
    fine = il.simulate(network, **options, step=0.035 / 32.0, integrator=il.ExactFlow(measured=False))
    for name in ("mean_square_velocity", "mean_square_displacement"):
        true = coarse[name].item() / fine[name].item() - 1.0
        assert abs(true) > 0.02, name
        assert 0.6 < coarse[f"{name}_step_bias"].item() / true < 1.6, name


@pytest.mark.full
def test_segments_meet_all_of_a_path_that_decays():
    """Nothing warns: neither of a bias, nor that the path was faster than where it was measured."""
    network = at_wall(il.KelvinVoigtContact(100.0, damping=30.0), excitation=il.WhiteNoise(1e-9))
    options = {"duration": 60.0, "realizations": 64, "initial": {"displacement": {"a": -5.0}}, "rng": 1}
    result = il.simulate(network, **options, integrator=il.ExactFlow())
    fine = il.simulate(network, **options, step=result.attrs["step"] / 8.0, integrator=il.ExactFlow(measured=False))
    for name in ("mean_square_velocity", "mean_contact_force", "contact_ratio"):
        assert result[name].item() == pytest.approx(fine[name].item(), rel=5e-3), name


def test_of_many_statistics_the_largest_is_no_bias_by_chance():
    rng, bodies = np.random.default_rng(5), tuple(f"b{index}" for index in range(2000))
    name = "mean_square_velocity"
    found = StepBias(0.1, {name: Bias(1e-2 * rng.standard_normal(2000), np.full(2000, 1e-2))}, {"oscillator": bodies})
    few = StepBias(0.1, {name: Bias(found.bias[name].value[:10], np.full(10, 1e-2))}, {"oscillator": bodies[:10]})
    assert (np.abs(found.bias[name].value) > 2.5e-2).any()
    assert found.certain == 0.0
    assert few.margin == MARGIN_OF_BIAS


def test_a_body_that_is_much_faster_in_the_run_is_told():
    name = "mean_square_velocity"
    found = StepBias(0.1, {}, {"oscillator": ("a", "b")}, {name: np.array([1.0, 1.0])})
    calm, fast, unknown = (
        statistics(["a", "b"], [], {name: [1.0, value]}, {name: [0.1, error]})
        for value, error in ((1.9, 0.1), (3.0, 0.1), (3.0, np.nan))
    )
    assert "of 'b' is 3 m2 s-2 in the run, but 1 where" in found.warning(fast, sampled=True, steady=True)
    assert not found.warning(calm, sampled=True, steady=True)
    assert not found.warning(unknown, sampled=True, steady=True)
    assert found.warning(unknown, sampled=False, steady=True)


def test_a_part_of_a_run_that_is_like_the_whole_tells_its_bias():
    names = ("mean_square_velocity", "contact_rate")
    labels = {"oscillator": ("a",), "contact": ("w",)}
    seen = StepBias(0.1, {}, labels, {name: np.array([1.0]) for name in names}, reached=0.06)
    for rate, doubted in ((0.9, False), (2.0, True), (0.4, True)):
        run = statistics(["a"], ["w"], {names[0]: [1.1], names[1]: [rate]}, {name: [0.01] for name in names})
        assert ("in the first 6 % of the run only" in seen.warning(run, sampled=True, steady=False)) == doubted
    unsure = statistics(["a"], ["w"], {names[0]: [1.1], names[1]: [2.0]}, {names[0]: [0.01], names[1]: [0.1]})
    assert not seen.warning(unsure, sampled=True, steady=False)


def test_a_bias_that_is_not_known_well_is_that_of_the_rules_up_to_their_step():
    name = "contact_rate"
    found = StepBias(0.1, {name: Bias(np.zeros(1), np.array([0.02]))}, {"contact": ("w",)}, {name: np.ones(1)})
    unmet = StepBias(0.1, {name: Bias(np.zeros(1), np.array([np.inf]))}, {"contact": ("w",)}, {name: np.zeros(1)})
    found, unmet = (
        replace(
            item,
            measured=item.measured | {"mean_square_velocity": np.ones(1)},
            labels=item.labels | {"oscillator": ("a",)},
        )
        for item in (found, unmet)
    )
    run = statistics(
        ["a"], ["w"], {"mean_square_velocity": [1.0], name: [1.0]}, {"mean_square_velocity": [0.0], name: [1e-3]}
    )
    assert "known to ± 2 % only" in found.warning(run, sampled=True, steady=False, automatic=0.05)
    assert not found.warning(run, sampled=True, steady=False, automatic=0.1)
    assert "it was not seen" in unmet.warning(run, sampled=True, steady=False, automatic=0.1)


def test_a_measurement_that_diverges_is_told_if_the_run_does_not():
    infinite = StepBias.infinite(0.1, ("a",), ("wall",))
    name = "mean_square_velocity"
    result = statistics(["a"], [], {name: [1.0]}, {name: [0.1]})
    assert "The bias of the step is unknown" in infinite.warning(result, sampled=False, steady=True)


@pytest.mark.campaign
def test_the_step_of_a_network_in_tiles_is_measured():
    bodies = 8192
    law = il.KelvinVoigtContact(1e3, damping=5.0)
    network = il.chain(bodies, BODY, law, clearance=0.3, excitation=HEAT)
    with tuned(single_lane_steps=0.0):
        assert plan_of(network, duration=0.1, spin_up=0.0).subdomains.tiles
        with pytest.warns(il.AccuracyWarning, match="Too few independent samples"):
            result = il.simulate(network, 0.1, spin_up=0.0, rng=1)
    assert np.isfinite(result.mean_square_velocity_step_bias).all()


@pytest.mark.full
@pytest.mark.parametrize("duration", [1.6, 1.61, 1.8])
@pytest.mark.parametrize("noise", [False, True])
def test_a_hit_in_the_last_steps_is_measured(duration, noise):
    """The stop is reached after 1.57 s."""
    body = il.LinearOscillator.from_frequency(1.0, 0.01)
    contact = il.Contact("a", il.WALL, il.KelvinVoigtContact(100.0, damping=30.0))
    network = il.Network({"a": body}, {"w": contact}, {"a": il.WhiteNoise(1e-8)} if noise else {})
    options = {"initial": {"displacement": {"a": -1.0}}, "realizations": 64 if noise else 1, "rng": 1}
    result = il.simulate(network, duration, **options, integrator=il.ExactFlow())
    step = result.attrs["step"] / 16.0
    fine = il.simulate(network, duration, **options, step=step, integrator=il.ExactFlow(measured=False))
    for name in ("contact_ratio", "mean_contact_force"):
        assert result[name].item() == pytest.approx(fine[name].item(), rel=5e-3), name


@pytest.mark.full
def test_a_measurement_that_does_not_reach_the_end_of_a_path_is_told():
    """A slow drift onto a stop, of which the measurement sees the beginning."""
    contact = il.Contact("a", il.WALL, il.KelvinVoigtContact(1e3, damping=30.0))
    network = il.Network({"a": il.LinearOscillator(stiffness=1e-7)}, {"w": contact})
    with pytest.warns(il.AccuracyWarning, match=r"compare with step="):
        il.simulate(network, 6000.0, initial={"displacement": {"a": -1.0}}, integrator=il.ExactFlow())


def test_a_bias_that_is_not_met_again_is_not_forgotten():
    larger = StepBias(0.2, {"contact_ratio": Bias(np.array([0.04, 0.0]), np.array([1e-4, np.inf]))}, {})
    smaller = StepBias(0.1, {"contact_ratio": Bias(np.array([0.0, 2e-3]), np.array([np.inf, 1e-4]))}, {})
    joint = smaller.or_from(larger)
    np.testing.assert_allclose(joint.bias["contact_ratio"].value, [0.01, 2e-3])
    np.testing.assert_allclose(joint.bias["contact_ratio"].error, [0.01, 1e-4], rtol=1e-3)
    apart = smaller.bias["contact_ratio"]._replace(apart=np.array([True, False]))
    chaotic = replace(smaller, bias={"contact_ratio": apart})
    assert chaotic.or_from(larger).bias["contact_ratio"].error[0] == np.inf


def test_a_mean_that_may_be_zero_has_the_size_of_its_root_mean_square():
    """Unless its scatter says that it is not 0, as where a tolerance is asked for."""
    values = {"mean_displacement": np.array([-0.01, -3.0]), "mean_square_displacement": np.array([4.0, 13.0])}
    scatter = np.full(2, 0.1)
    np.testing.assert_allclose(size_of("mean_displacement", values.get), [2.0, math.sqrt(13.0)])
    np.testing.assert_allclose(size_of("mean_displacement", values.get, scatter), [2.0, 3.0])
    np.testing.assert_allclose(size_of("mean_square_displacement", values.get, scatter), [4.0, 13.0])
