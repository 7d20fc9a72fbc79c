"""The measured step of networks whose laws have states."""

import math
import warnings
from functools import partial

import numpy as np
import pytest
from laws import Cosine, Slider, WorkingContact
from scenes import off, plan_of
from scipy.linalg import solve_continuous_lyapunov

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.results.schema import OF_STATES, scatter_of
from impactlab.simulation.block import Block
from impactlab.simulation.planning import make_plan
from impactlab.step_control.measured.segments import Runs, step_bias

PLAIN = il.ExactFlow(measured=False)
HEAT = il.WhiteNoise(1.0)
SOFT = il.LinearOscillator(damping=0.2, stiffness=10.0)
BODY = il.LinearOscillator(damping=1.2, stiffness=40.0)
LIGHT = il.LinearOscillator(mass=0.5, damping=0.4, stiffness=80.0)


class TwoSlopeContact(il.ContactLaw):
    """Unloads on a stiffer line from the largest indentation of this time, which the rules do not see."""

    loading: float = il.parameter(units="N m-1")
    unloading: float = il.parameter(units="N m-1")
    largest: float = il.state(0.0, units="m")

    def force(indentation, loading, unloading, largest):
        return max(loading * largest - unloading * (largest - indentation), 0.0)

    def update(indentation, largest):
        return max(indentation, largest) if indentation > 0.0 else 0.0


class SolidContact(il.ContactLaw):
    """Spring beside a Maxwell element, which relaxes while the contact is open, too."""

    stiffness: float = il.parameter(units="N m-1")
    more: float = il.parameter(units="N m-1")
    relaxation: float = il.parameter(units="s")
    flow: float = il.state(0.0, units="m")

    def force(indentation, stiffness, more, flow):
        return max(stiffness * indentation + more * (indentation - flow), 0.0)

    def update(indentation, elapsed, flow, relaxation):
        return flow + (max(indentation, 0.0) - flow) * -math.expm1(-elapsed / relaxation)


class SlidingCoupling(il.CouplingLaw):
    """Spring in series with dry friction."""

    stiffness: float = il.parameter(units="N m-1")
    most: float = il.parameter(units="N")
    pull: float = il.state(0.0, units="N")
    last: float = il.state(0.0, units="m")

    def force(extension, pull):
        return pull

    def update(extension, pull, last, stiffness, most):
        return max(-most, min(most, pull + stiffness * (extension - last))), extension


class Spring(il.CouplingLaw):
    """Plain spring, which kicks."""

    stiffness: float = il.parameter(units="N m-1")

    def force(extension, stiffness):
        return stiffness * extension


class LateSpring(il.CouplingLaw):
    """The same after 12 s, and half as stiff before: what begins anew is another network."""

    stiffness: float = il.parameter(units="N m-1")
    age: float = il.state(0.0, units="s")

    def force(extension, stiffness, age):
        return stiffness * extension * (1.0 if age > 12.0 else 0.5)

    def update(elapsed, age):
        return age + elapsed


def held(law, body=SOFT, excitation=HEAT):
    return il.Network({"a": body}, {}, {"a": excitation} if excitation else {}, {"h": il.Coupling(il.WALL, "a", law)})


def stopped(law, clearance=0.05, excitation=HEAT):
    contacts = {"w": il.Contact("a", il.WALL, law, clearance=clearance)}
    return il.Network({"a": BODY}, contacts, {"a": excitation} if excitation else {})


def pair(law, coupling=None):
    couplings = {"h": il.Coupling("a", "b", coupling)} if coupling else {}
    noises = {"a": HEAT, "b": il.WhiteNoise(0.05)}
    return il.Network({"a": BODY, "b": LIGHT}, {"c": il.Contact("a", "b", law, clearance=0.05)}, noises, couplings)


def impacts(stiffness, restitution, exponent=1.5):
    return il.LankaraniNikraveshContact(stiffness, restitution=restitution, exponent=exponent)


def chain():
    """Four bodies, of which the outer ones are shaken, and a wall."""
    law = impacts(3e3, 0.5)
    contacts = {one + two: il.Contact(one, two, law, clearance=0.05) for one, two in ("ab", "bc", "cd")}
    contacts["w"] = il.Contact(il.WALL, "a", impacts(1e4, 0.9, 1.0), clearance=0.2)
    return il.Network(dict.fromkeys("abcd", BODY), contacts, {"a": il.WhiteNoise(4.0), "d": il.WhiteNoise(0.5)})


def storeys():
    """Three bodies on hysteretic springs beside a wall."""
    law = il.BoucWenCoupling(100.0, yield_displacement=0.05, ratio=0.2)
    couplings = {one + two: il.Coupling(one, two, law) for one, two in ("ab", "bc")}
    contacts = {"w": il.Contact("c", il.WALL, impacts(1e4, 0.7), clearance=0.1)}
    return il.Network(dict.fromkeys("abc", BODY), contacts, {"a": il.WhiteNoise(3.0)}, couplings)


HYSTERESIS = il.BoucWenCoupling(60.0, yield_displacement=0.1, ratio=0.1)
MANY = {"realizations": 256}
SCENES = {
    "impacts on a stiff wall": (stopped(impacts(1e5, 0.6)), {"duration": 40.0, "realizations": 1024}),
    "impacts on a soft wall": (stopped(impacts(300.0, 0.3), 0.1), {"duration": 100.0, **MANY}),
    "impacts of a pair": (pair(impacts(1e4, 0.8)), {"duration": 40.0, **MANY}),
    "impacts in a chain": (chain(), {"duration": 30.0, "realizations": 1024}),
    "one drop": (stopped(impacts(1e4, 0.7), 0.0, None), {"duration": 3.0, "initial": {"displacement": {"a": -0.5}}}),
    "Maxwell element": (held(il.MaxwellCoupling(60.0, damping=3.0)), {"duration": 100.0, **MANY}),
    "slow Maxwell element": (held(il.MaxwellCoupling(60.0, damping=60.0)), {"duration": 100.0, **MANY}),
    "standard linear solid": (
        held(il.ZenerCoupling(20.0, relaxing_stiffness=60.0, damping=3.0)), {"duration": 100.0, **MANY}
    ),
    "piezoelectric circuit": (
        held(il.PiezoelectricCoupling(0.5, capacitance=0.01, resistance=30.0)), {"duration": 100.0, **MANY}
    ),
    "slider": (held(il.JenkinsCoupling(200.0, slip_force=0.5)), {"duration": 100.0, **MANY}),
    "slider under a given force": (
        held(il.JenkinsCoupling(200.0, slip_force=0.5), SOFT, Cosine(3.0, frequency=4.0)),
        {"duration": 60.0, "initial": {}},
    ),
    "Maxwell element beside a contact": (
        pair(il.HertzContact(1e4), il.MaxwellCoupling(50.0, damping=4.0)), {"duration": 40.0, **MANY}
    ),
    "the same from rest": (
        pair(il.HertzContact(1e4), il.MaxwellCoupling(50.0, damping=4.0)),
        {"duration": 4.0, "initial": "rest", "spin_up": 0.0, **MANY},
    ),
    "hysteresis": (held(HYSTERESIS), {"duration": 50.0, **MANY}),
    "hysteresis under weak noise": (held(HYSTERESIS, SOFT, il.WhiteNoise(0.01)), {"duration": 50.0, **MANY}),
    "hysteresis under strong noise": (held(HYSTERESIS, SOFT, il.WhiteNoise(20.0)), {"duration": 25.0, **MANY}),
    "hysteresis under a given force": (
        held(HYSTERESIS, SOFT, Cosine(3.0, frequency=4.0)), {"duration": 60.0, "initial": {}}
    ),
    "hysteresis from a given start": (
        held(HYSTERESIS, SOFT, il.WhiteNoise(0.05)),
        {"duration": 20.0, "initial": {"displacement": {"a": 0.5}}, **MANY},
    ),
    "hysteretic storeys": (storeys(), {"duration": 30.0, **MANY}),
    "body that slips": (
        il.Network({"a": Slider(spring=50.0, most=1.0, damping=0.2, stiffness=10.0)}, {}, {"a": HEAT}),
        {"duration": 100.0, **MANY},
    ),
    "dry friction beside a contact": (
        pair(il.HertzContact(1e4), SlidingCoupling(200.0, most=0.5)), {"duration": 40.0, **MANY}
    ),
    "two slopes": (stopped(TwoSlopeContact(1e3, unloading=4e3)), {"duration": 50.0, **MANY}),
    "standard solid": (stopped(SolidContact(500.0, more=2000.0, relaxation=0.05), 0.02), {"duration": 50.0, **MANY}),
}  # fmt: skip

QUICK = "one drop", "Maxwell element"


def measured(network, **options):
    """Return the measured bias of a step."""
    plan_for = partial(make_plan, Model.of(network))
    return step_bias(Runs(plan_for, Block), Model.of(network), options.get("initial"), plan_of(network, **options))


@pytest.mark.full
@pytest.mark.parametrize(
    "scene", [pytest.param(name, marks=() if name in QUICK else pytest.mark.campaign) for name in SCENES]
)
def test_the_step_is_as_fine_as_laws_with_states_need(scene):
    """All statistics are those at an eighth of the step, within 0.5 % and three standard errors."""
    network, options = SCENES[scene]
    with warnings.catch_warnings():
        warnings.simplefilter("error", il.AccuracyWarning)
        result = il.simulate(network, **options, integrator=il.ExactFlow(), rng=1)
    assert "mean_square_velocity_step_bias" in result
    finer = {**options, "step": result.attrs["step"] / 8.0, "integrator": PLAIN}
    for name, (difference, error) in off(result, il.simulate(network, **finer, rng=2)).items():
        assert (np.abs(difference) < 5e-3 + 3.0 * error).all(), name


COARSE = {  # steps near those of the rules, or twice them where hardly any bias is seen there
    "impacts on a soft wall": 0.034, "impacts on a stiff wall": 0.008, "Maxwell element": 0.064, "two slopes": 0.0136,
    "hysteresis": 0.05, "hysteresis under strong noise": 0.1, "body that slips": 0.1,
}  # fmt: skip


@pytest.mark.parametrize(
    "scene", [pytest.param(name, marks=() if name in QUICK else pytest.mark.campaign) for name in COARSE]
)
def test_what_is_measured_is_what_is_true(scene):
    """Sign and size of the bias of a coarse step, within a factor of two."""
    network, options = SCENES[scene]
    step, names = COARSE[scene], ("mean_square_displacement", "mean_square_velocity", "mean_contact_force")
    found = measured(network, **options, step=step)
    sizes = (step, 1), (step / 8.0, 2)
    runs = [il.simulate(network, **options, step=size, integrator=PLAIN, rng=rng) for size, rng in sizes]
    for name, (true, error) in off(*runs, names).items():
        unknown = 3.0 * np.hypot(error, found.bias[name].error)
        assert (np.abs(found.bias[name].value - true) < unknown + 0.5 * np.abs(true)).all(), name
        if name == "mean_square_velocity":
            assert (np.abs(true) > 3.0 * error).all()


def test_the_bias_of_a_linear_element_is_that_of_its_linear_system():
    network, _ = SCENES["Maxwell element"]
    matrix = np.array([[0.0, 1.0, 0.0], [-10.0, -0.2, -1.0], [0.0, 60.0, -20.0]])
    exact = solve_continuous_lyapunov(matrix, -np.diag([0.0, 2.0 * np.pi, 0.0]))[1, 1]
    result = il.simulate(network, 200.0, realizations=256, rng=1)
    error = float(scatter_of(result, "mean_square_velocity").item())
    assert abs(float(result.mean_square_velocity.item()) - exact) < 3.0 * error + 5e-3 * exact


@pytest.mark.full
def test_the_fine_run_begins_with_the_states_of_the_coarse_one():
    """A spring that knows its age is seen as the plain spring that it has become."""
    options = {"duration": 100.0, "realizations": 256, "step": 0.04, "spin_up": 60.0}
    late, plain = (measured(held(law), **options) for law in (LateSpring(60.0), Spring(60.0)))
    for name in ("mean_square_displacement", "mean_square_velocity"):
        error = math.hypot(late.bias[name].error[0], plain.bias[name].error[0])
        assert error < 0.01  # what begins anew is off by a third
        assert abs(late.bias[name].value[0] - plain.bias[name].value[0]) < 3.5 * error


@pytest.mark.full
def test_a_step_that_is_given_and_too_large_is_told():
    network, options = SCENES["two slopes"]
    with pytest.warns(il.AccuracyWarning, match=r"At the step of .* s .* too (large|small), as measured on this netw"):
        il.simulate(network, **options, step=0.0136, rng=1)


def test_the_rules_know_forces_at_the_start_and_the_measurement_the_rest():
    """The step of the rules is that of the spring at the start; the one that is measured is smaller."""
    steps = []
    for law in (Spring(60.0), il.MaxwellCoupling(60.0, damping=3.0)):
        network = held(law)
        steps.append(float(network.check().dataset.recommended_step.sel(integrator="ExactFlow")))
    assert steps[1] == pytest.approx(steps[0], rel=1e-9)
    assert il.simulate(network, 100.0, realizations=256, rng=1).attrs["step"] < 0.5 * steps[0]


@pytest.mark.full
def test_a_tolerance_is_reached_with_states():
    network, _ = SCENES["Maxwell element"]
    result = il.simulate(network, tolerance={"mean_square_velocity": 0.02}, rng=1)
    matrix = np.array([[0.0, 1.0, 0.0], [-10.0, -0.2, -1.0], [0.0, 60.0, -20.0]])
    exact = solve_continuous_lyapunov(matrix, -np.diag([0.0, 2.0 * np.pi, 0.0]))[1, 1]
    assert float(result.mean_square_velocity.item()) == pytest.approx(exact, rel=0.02)


@pytest.mark.full
def test_statistics_of_states_are_those_of_their_paths():
    """Means over time by the trapezoidal rule, of batches too, and changes over the time that they take."""
    network, _ = SCENES["Maxwell element"]
    options = {"step": 0.01, "integrator": PLAIN, "rng": 1, "record": [il.Trajectory(0.01), il.PerRealization()]}
    for realizations, duration in ((3, 10.0), (1, 13.0)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", il.AccuracyWarning)  # few samples
            found = il.simulate(network, duration, realizations=realizations, **options)
        path = found.law_state.transpose("realization", "state", "time").values
        means = [np.trapezoid(values, dx=0.01) / duration for values in (path, path**2)]
        expected = dict(zip(OF_STATES, [*means, (path[..., -1] - path[..., 0]) / duration], strict=True))
        for name, values in expected.items():
            np.testing.assert_allclose(found[f"{name}_by_realization"], values, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(found[name], values.mean(axis=0), rtol=1e-9, atol=1e-12)
    assert found.state.values.tolist() == ["h.pull", "h.last"]
    assert found.state.attrs["comment"] == "units: pull N, last m"


def test_statistics_of_states_have_errors_and_biases():
    """Of a linear element the mean square is known; all changes of its states come back."""
    network, _ = SCENES["Maxwell element"]
    matrix = np.array([[0.0, 1.0, 0.0], [-10.0, -0.2, -1.0], [0.0, 60.0, -20.0]])
    exact = np.diag(solve_continuous_lyapunov(matrix, -np.diag([0.0, 2.0 * np.pi, 0.0])))
    found = il.simulate(network, 200.0, realizations=256, rng=1)
    error = found.mean_square_law_state_standard_error.values
    assert (error < 0.01 * exact[[2, 0]]).all()
    assert (np.abs(found.mean_square_law_state - exact[[2, 0]]) < 3.0 * error).all()
    for name in ("mean_law_state", "law_state_growth_rate"):
        assert (np.abs(found[name]) < 4.0 * found[f"{name}_standard_error"]).all(), name
    for name in OF_STATES:
        assert (np.abs(found[f"{name}_step_bias"]) < 0.01).all(), name


def test_networks_without_states_have_no_such_statistics():
    found = il.simulate(stopped(il.HertzContact(1e3)), 1.0, realizations=64, rng=1, spin_up=0.0, initial="rest")
    assert "state" not in found.dims
    assert not {*OF_STATES} & {*found}


@pytest.mark.campaign
def test_the_growth_of_work_is_what_noise_puts_in():
    """At the automatic step, and the bias of a step that is too large is told."""
    network = stopped(WorkingContact(1e4, damping=20.0))
    found = il.simulate(network, 100.0, realizations=256, rng=1)
    work, error = (found[f"law_state_growth_rate{item}"].item() for item in ("", "_standard_error"))
    put_in = math.pi - BODY.damping * found.mean_square_velocity.item()
    doubt = math.hypot(error, BODY.damping * found.mean_square_velocity_standard_error.item())
    assert doubt < 0.02 * put_in
    assert abs(work - put_in) < 3.0 * doubt
    with pytest.warns(
        il.AccuracyWarning, match=r"At the step of .* s (growth rate of the|mean square) state of 'w.work' is about"
    ):
        il.simulate(network, 100.0, realizations=256, rng=1, step=0.014)


SLOW = il.Network(
    {"a": il.LinearOscillator(mass=1.0, damping=0.02)}, {}, {"a": il.WhiteNoise(0.2)},
    {"k": il.Coupling(il.WALL, "a", il.BoucWenCoupling(1.0, yield_displacement=1.0, ratio=0.05, shape=0.7))},
)  # fmt: skip
"""A spring that slips by five yield displacements for tens of seconds."""


@pytest.mark.campaign
def test_slow_hysteresis_is_measured():
    """E[v²] = 1.9187 ± 0.0008 and E[z²] = 0.5200 ± 0.0006 are those of 4000 × 800 s at a step of 0.02 s."""
    options = {"duration": 400.0, "realizations": 1024}
    true = {"mean_square_velocity": (1.9187, 0.0008), "mean_square_law_state": (0.5200, 0.0006)}
    for step in (1.0 / 3.0, 1.0 / 6.0):
        found, run = (
            measured(SLOW, **options, step=step),
            il.simulate(SLOW, **options, step=step, integrator=PLAIN, rng=5),
        )
        for name, (value, doubt) in true.items():
            bias, error = run[name].values[0] / value - 1.0, math.hypot(scatter_of(run, name).values[0], doubt) / value
            assert bias > 4.0 * error
            assert abs(found.bias[name].value[0] - bias) < 3.0 * math.hypot(error, found.bias[name].error[0]), (
                step,
                name,
            )
    chosen = il.simulate(SLOW, **options, rng=11)
    for name, (value, doubt) in true.items():
        error = math.hypot(chosen[f"{name}_standard_error"].values[0], doubt)
        assert abs(chosen[name].values[0] - value) < 3.0 * error, name


SAMPLED = (
    "Maxwell element", "impacts on a soft wall", "slider", "slider under a given force", "hysteresis",
    "hysteresis from a given start", "body that slips", "two slopes", "one drop", "Maxwell element beside a contact",
)  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize(
    "scene", [pytest.param(name, marks=() if name in QUICK else pytest.mark.campaign) for name in SAMPLED]
)
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_records_change_the_step_no_more_than_their_interval_wants(scene):
    """It is rounded down, to divide the interval; without an interval it stays."""
    network, options = SCENES[scene]
    options = {"integrator": il.ExactFlow(), **options, "realizations": min(options.get("realizations", 1), 64)}
    step = il.simulate(network, **options, rng=1).attrs["step"]
    for record in (il.PerRealization(), il.FinalState()):
        assert il.simulate(network, **options, rng=1, record=record).attrs["step"] == step
    for parts in (7, 40):
        interval = options["duration"] / parts
        found = il.simulate(network, **options, rng=1, record=il.Trajectory(interval))
        assert found.attrs["step"] == pytest.approx(interval / math.ceil(interval / step * (1.0 - 1e-9)), rel=1e-9)
        if "mean_square_velocity_step_bias" in found:
            assert "reduced" not in found.mean_square_velocity_step_bias.attrs["comment"]


@pytest.mark.full
def test_one_realization_has_its_step_measured_as_well_as_many():
    """Duffing oscillator, Maxwell element and dashpot stop: at the step of the rules E[v²] is 1.2 % too large."""
    body = il.DuffingOscillator(mass=13.23, damping=7.386, stiffness=72.04, cubic=1829.7)
    stop = il.Contact(il.WALL, "body", il.KelvinVoigtContact(22.34, damping=3.619), clearance=0.1264)
    element = il.Coupling("body", il.WALL, il.MaxwellCoupling(77.51, damping=10.97))
    network = il.Network({"body": body}, {"stop": stop}, {"body": il.WhiteNoise(1.0187)}, {"element": element})
    plan = plan_of(network, duration=10_000.0, realizations=1, integrator=PLAIN)
    assert plan.clock.step > 0.1
    error = step_bias(Runs(partial(make_plan, Model.of(network)), Block), Model.of(network), None, plan)
    (bias,), (known,) = error.bias["mean_square_velocity"][:2]
    assert known < 0.004
    assert abs(bias - 0.012) < 3.0 * known  # against a sixteenth of the step, 0.0121 ± 0.0010
    assert not error.will_do(plan.clock.automatic)
