"""Bodies whose stiff linear couplings are a part of their linear motion."""

import numpy as np
import pytest
from laws import TwoLines
from scenes import base, deviations
from scipy.linalg import expm
from trio import DAMPER, MASS, OWN, STIFFNESS, drift_by_hand, law_by_hand, spring, trio

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.laws import flowing_systems
from impactlab.linear.transitions import noise_root, system_response, system_transition, transition
from impactlab.networks.linearized import LinearizedNetwork
from impactlab.results.schema import balances
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies

MOMENTS = ["mean_square_displacement", "mean_square_velocity"]


class OwnSpring(il.CouplingLaw):
    """A linear spring that impactlab does not know to be linear, so that it kicks."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)

    @staticmethod
    def force(extension, stiffness):
        return stiffness * extension


def arranged(network):
    model = Model.of(network)
    stiffening = Stiffening.of(model, energies(model, "stationary", 100.0))
    return il.ExactFlow().arrange(model, stiffening.links, stiffening.bodies), stiffening


def flowing(network):
    """Names of the couplings that are a part of the linear motion."""
    model, _ = arranged(network)
    return [name for name, flows in zip(model.couplings.names, model.couplings.flowing, strict=True) if flows]


def steps(network):
    data = network.check().dataset.sel(integrator="ExactFlow")
    return float(data.largest_step), float(data.recommended_step)


# flow


@pytest.mark.parametrize("step", [1e-4, 0.3, 40.0])
@pytest.mark.parametrize("damping", [0.0, 0.6, 50.0])
def test_transition_of_a_system(step, damping):
    """The exponential of SciPy; the covariance is what the law at unlike temperatures loses in a step."""
    hot = np.array([4.0, 1.0, 0.2])
    friction = np.diag(OWN) + damping * DAMPER
    a, q = system_transition(MASS, friction, STIFFNESS, np.diag(hot * OWN) / np.pi, step, 400.0)
    drift, law = drift_by_hand(damping), law_by_hand(hot, damping)
    np.testing.assert_allclose(a, expm(step * drift), rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(q, law - a @ law @ a.T, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(noise_root(q) @ noise_root(q).T, q, rtol=1e-9, atol=1e-15 * np.abs(q).max())
    by_force = np.linalg.solve(drift, (a - np.eye(6))[:, 3:] / MASS)
    found = system_response(MASS, friction, STIFFNESS, step, 400.0)[0]
    np.testing.assert_allclose(found, by_force, rtol=1e-9, atol=1e-11)


def test_a_system_of_one_body_is_that_body():
    numbers = [np.array([value]) for value in (2.0, 0.7, 30.0, 0.4)]
    mass, damping, stiffness, density = numbers
    found = system_transition(mass, damping[None], stiffness[None], density[None], 0.2, 5.0)
    for joint, (alone,) in zip(found, transition(*numbers, 0.2), strict=True):
        np.testing.assert_allclose(joint, alone, rtol=1e-12)


@pytest.mark.parametrize("step", [0.05, 3.0])
def test_paths_without_noise_are_exact_at_any_step(step):
    network = trio(0.4, excitations=dict.fromkeys("abc"))
    initial = {"displacement": {"a": 0.3, "c": -0.2}, "velocity": {"b": 1.5}}
    options = {"duration": 4.0 * step, "spin_up": 0.0, "step": step, "initial": initial}
    method = il.ExactFlow(measured=False)  # of paths, not of means
    result = il.simulate(network, **options, integrator=method, record=[il.Trajectory(interval=step)], rng=1)
    start = np.array([0.3, 0.0, -0.2, 0.0, 1.5, 0.0])
    for index, time in enumerate(result.time.values):
        expected = expm(time * drift_by_hand(0.4)) @ start
        np.testing.assert_allclose(result.displacement[0, index], expected[:3], atol=1e-12)
        np.testing.assert_allclose(result.velocity[0, index], expected[3:], atol=1e-11)


@pytest.mark.full
def test_a_constant_given_force_on_one_body_moves_all_exactly():
    network = trio(0.4, excitations={"a": None, "b": il.ConstantForce(3.0), "c": None})
    initial = {"displacement": {}, "velocity": {}}
    options = {"record": [il.Trajectory(interval=0.5)], "integrator": il.ExactFlow(measured=False)}
    result = il.simulate(network, 2.0, spin_up=0.0, step=0.5, initial=initial, **options, rng=1)
    drift, acceleration = drift_by_hand(0.4), np.array([0, 0, 0, 0, 1.5, 0])
    for index, time in enumerate(result.time.values):
        expected = np.linalg.solve(drift, (expm(time * drift) - np.eye(6)) @ acceleration)
        np.testing.assert_allclose(result.displacement[0, index], expected[:3], atol=1e-12)


@pytest.mark.full
@pytest.mark.parametrize("part", ["contact", "no contact"])
def test_cosines_on_one_body_move_all(part):
    """Amplitudes and phases of all bodies are those of the response matrix; also beside a contact that stays open."""

    network = trio(0.4, excitations={"a": None, "b": TwoLines(1.0, second=11.0), "c": None})
    if part == "contact":
        network = network.replace(contacts={"gap": il.Contact("a", il.WALL, il.HertzContact(1.0), clearance=99.0)})
    assert len(flowing(network)) == 4
    record = [il.Trajectory(interval=0.1)]
    result = il.simulate(network, 20.0, step=0.1, realizations=70, record=record, rng=2)
    time = result.time.values
    waves = np.concatenate([np.exp(1j * np.outer([1.0, 11.0], time)), np.exp(-1j * np.outer([1.0, 11.0], time))])
    for quantity, power in (("displacement", 0), ("velocity", 1)):
        path = result[quantity].values[5]
        amplitudes = np.linalg.lstsq(waves.T, path, rcond=None)[0]
        np.testing.assert_allclose(amplitudes.T @ waves, path.T, atol=1e-10)
        for line, (omega, force) in enumerate([(1.0, 2.0), (11.0, 5.0)]):
            dynamic = STIFFNESS - omega**2 * np.diag(MASS) + 1j * omega * (np.diag(OWN) + 0.4 * DAMPER)
            expected = (1j * omega) ** power * np.linalg.inv(dynamic)[:, 1] * force / 2.0
            ratio = amplitudes[line] / expected
            np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)
            assert abs(ratio[0]) == pytest.approx(1.0)


@pytest.mark.full
def test_covariance_after_one_step_from_rest():
    """Of all bodies with all others; one of them has no noise of its own."""
    hot, count, step = (4.0, 1.0, 0.0), 30_000, 0.4
    record = [il.Trajectory(interval=step)]
    options = {"duration": step, "spin_up": 0.0, "step": step, "initial": "rest"}
    result = il.simulate(trio(0.3, hot), **options, realizations=count, record=record, rng=3)
    state = np.concatenate([result.displacement.values[:, -1], result.velocity.values[:, -1]], axis=1)
    law, a = law_by_hand(hot, 0.3), expm(step * drift_by_hand(0.3))
    expected = law - a @ law @ a.T
    scatter = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / count)
    deviation = (state.T @ state / count - expected) / scatter
    assert np.abs(deviation).max() < 4.0, deviation


# which couplings, and the step


def test_stiff_and_damped_couplings_flow_part_by_part():
    assert flowing(trio()) == ["ab", "bc", "ca", "wall"]
    soft, stiff = spring("one", "two", 60.0), spring("one", "two", 600.0)
    assert flowing(base(couplings={"s": soft})) == []
    assert flowing(base(couplings={"s": stiff})) == ["s"]
    assert flowing(base(couplings={"s": soft, "w": spring(il.WALL, "one", 1e3)})) == ["s", "w"]
    assert flowing(base(couplings={"s": spring("one", "two", 1.0, damping=3.0)})) == ["s"]
    two = base(couplings={"s": soft}).replace(
        oscillators={name: il.LinearOscillator(stiffness=9.0, damping=1.0) for name in ("x", "y")},
        couplings={"t": spring("x", "y", 900.0)},
    )
    assert flowing(two) == ["t"]


def test_what_kicks_in_any_case():
    """Groups of more than six bodies, noise that varies in time, and what is not known to be linear."""
    bodies = {f"b{k}": il.LinearOscillator(stiffness=9.0, damping=1.0) for k in range(7)}
    links = {f"c{k}": spring(f"b{k}", f"b{k + 1}", 900.0) for k in range(6)}
    assert flowing(il.Network(bodies, couplings=links)) == []
    assert flowing(il.Network(bodies, couplings={**links, "c5": spring("b5", il.WALL, 900.0)})) == list(links)

    class Fading(il.Excitation):
        def intensity(time):
            return 1.0 / (1.0 + time)

    assert flowing(trio(excitations={"a": Fading()})) == []
    own = {"s": il.Coupling("one", "two", OwnSpring(600.0))}
    assert flowing(base(couplings=own)) == []


def test_a_model_of_soft_couplings_stays_as_it_is():
    model = Model.of(base(couplings={"s": spring("one", "two", 60.0)}))
    stiffening = Stiffening.of(model, np.ones(2))
    assert il.ExactFlow().arrange(model, stiffening.links) is model
    assert il.RungeKutta4().arrange(Model.of(trio()), np.ones(4)).kicks.links.all()


def test_steps():
    """Without contacts every step is exact; with them the largest frequency of the group is sampled."""
    free = trio(damping=200.0)
    largest, recommended = steps(free)
    root = MASS**-0.5
    friction = np.linalg.eigvalsh(root[:, None] * (np.diag(OWN) + 200.0 * DAMPER) * root)[-1]
    assert (largest, recommended) == (np.inf, pytest.approx(1.0 / friction))
    open_gap = {"gap": il.Contact("a", il.WALL, il.HertzContact(1.0), clearance=9.0)}
    frequency = np.sqrt(np.linalg.eigvalsh(root[:, None] * STIFFNESS * root)[-1])
    for damping in (0.0, 200.0):  # dampers do not limit it
        largest, recommended = steps(trio(damping, contacts=open_gap))
        assert (largest, recommended) == (pytest.approx(3.0 / frequency), pytest.approx(1.0 / frequency))


def test_a_model_with_flowing_couplings():
    network = trio(0.3, couplings={"own": il.Coupling("a", "b", OwnSpring(8.0))})
    model, _ = arranged(network)
    assert model.couplings.flowing.tolist() == [True, True, True, True, False]
    assert model.kicks.links.tolist() == [False, False, False, False, True]
    assert (model.kicks.dissipative, Model.of(network).kicks.dissipative) == (False, True)
    assert model.kicks.nonlinear.tolist() == [True, True, False]
    ((slots, system),) = flowing_systems(model)
    assert slots.tolist() == [0, 1, 2]
    np.testing.assert_allclose(system.stiffness, STIFFNESS)
    assert flowing_systems(Model.of(network)) == ()


# statistics


@pytest.mark.full
@pytest.mark.parametrize("hot", [(1.0, 1.0, 1.0), (9.0, 1.0, 0.1), (1.0, 0.0, 0.0)])
@pytest.mark.parametrize("damping", [0.0, 30.0])
def test_without_contacts_every_step_has_the_law(hot, damping):
    """At steps of 2 radians of the fastest mode; plain means, errors below 1 %."""
    network = trio(damping, hot)
    frequency = np.sqrt(np.linalg.eigvalsh(MASS[:, None] ** -0.5 * STIFFNESS * MASS**-0.5)[-1])
    result = il.simulate(network, duration=600.0, step=2.0 / frequency, realizations=256, rng=11)
    expected = np.diag(law_by_hand(hot, damping)).reshape(2, 3)
    for name, exact in zip(MOMENTS, expected, strict=True):
        error = result[f"direct_{name}_standard_error"].values
        assert (error < 0.01 * exact).all(), (name, error / exact)
        score = (result[f"direct_{name}"].values - exact) / error
        assert (np.abs(score) < 3.5).all(), (name, score)
        np.testing.assert_allclose(result[name], exact, rtol=1e-3)
    assert "balance_mean_displacement" in result
    predicted = LinearizedNetwork.of(*arranged(network)).discrete_covariance(il.ExactFlow(), 2.0 / frequency)
    np.testing.assert_allclose(predicted, law_by_hand(hot, damping), rtol=1e-6, atol=1e-9)


@pytest.mark.full
def test_the_law_of_a_group_under_kicks_is_the_predicted_one():
    """At the largest step, with a spring that kicks; the bias is more than 5 of the errors."""
    network = trio(1.0, (3.0, 1.0, 0.2), couplings={"own": il.Coupling("a", "b", OwnSpring(300.0))})
    model, stiffening = arranged(network)
    step = 0.98 * steps(network)[0]
    options = {"duration": 100_000 * step, "spin_up": 100.0, "step": step}
    result = il.simulate(network, **options, integrator=il.ExactFlow(measured=False), realizations=128, rng=4)
    scene = LinearizedNetwork.of(model, stiffening)
    exact, discrete = np.diag(scene.covariance()), np.diag(scene.discrete_covariance(il.ExactFlow(), step))
    for prefix in ("", "direct_"):
        found = np.concatenate([result[prefix + name] for name in MOMENTS])
        error = np.concatenate([result[f"{prefix}{name}_standard_error"] for name in MOMENTS])
        assert (np.abs(found - discrete) < 3.5 * error).all(), (found - discrete) / error
        assert np.abs((discrete - exact) / error).max() > 5.0


@pytest.mark.parametrize("between", [600.0, 3000.0])
def test_a_stiffly_coupled_pair_with_contact_against_its_exact_law(between):
    network = base(couplings={"s": spring("one", "two", between), "w": spring("two", il.WALL, 25.0)})
    assert flowing(network) == ["s", "w"]
    result = il.simulate(network, duration=200.0, realizations=256, rng=8)
    names = ["mean_displacement", *MOMENTS, "contact_ratio", "mean_contact_force"]
    for name, found in deviations(result, il.exact(network).statistics(), names, relative=1e-3).items():
        assert found < 3.5, (name, found)


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_balances_of_a_group_hold_at_every_step_and_serve_as_controls(share):
    network = base(couplings={"s": spring("one", "two", 900.0, 2.0), "w": spring("two", il.WALL, 20.0)})
    options = {"step": share * steps(network)[0], "integrator": il.ExactFlow(measured=False)}
    result = il.simulate(network, duration=100.0, **options, realizations=256, rng=5)
    for name in (balance.name for balance in balances()):
        score = result[name] / result[f"{name}_standard_error"]
        assert (np.abs(score) < 3.5).all(), (name, score.values)
    gain = result.direct_mean_square_displacement_standard_error / result.mean_square_displacement_standard_error
    assert (gain > 3.0).all()


@pytest.mark.full
def test_a_stiff_damped_coupling_needs_no_small_step():
    """Moments with contacts at a damping that would limit a kick to a step twenty times smaller."""
    network = base(couplings={"s": spring("one", "two", 1.0, damping=30.0)})
    coarse, fine = (il.simulate(network, 100.0, realizations=256, step=step, rng=4) for step in (None, 1e-3))
    assert coarse.step > 20.0 * 0.05 / 60.0 / 3.0
    for name in [*MOMENTS, "mean_contact_force"]:
        error = np.hypot(coarse[f"{name}_standard_error"], fine[f"{name}_standard_error"])
        assert (np.abs(coarse[name] - fine[name]) < 3.5 * error + 1e-3 * fine[name]).all(), name


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:The two halves")  # of its place, which diffuses
def test_a_pair_that_nothing_holds():
    """Its velocities and its distance have a law; its place has no balance."""
    body = il.LinearOscillator(mass=2.0, damping=0.5)
    noise = il.WhiteNoise(0.5 / np.pi)  # T = 1 J
    network = il.Network({"a": body, "b": body}, {}, {"a": noise, "b": noise}, {"s": spring("a", "b", 900.0)})
    result = il.simulate(network, 400.0, realizations=128, step=0.5, rng=2)
    score = (result.direct_mean_square_velocity - 0.5) / result.direct_mean_square_velocity_standard_error
    assert (np.abs(score) < 3.5).all()
    assert "balance_mean_square_displacement" not in result
    assert (
        np.abs(result.balance_mean_square_velocity) < 3.5 * result.balance_mean_square_velocity_standard_error
    ).all()


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_a_realization_is_the_same_alone_and_among_many():
    network = base(couplings={"s": spring("one", "two", 600.0, 1.0)})
    options = {"duration": 2.0, "spin_up": 0.0, "step": 0.005, "record": [il.PerRealization()], "rng": 3}
    few, many = (il.simulate(network, realizations=count, **options) for count in (1, 300))
    for name in (*MOMENTS, "mean_displacement"):
        np.testing.assert_array_equal(few[f"{name}_by_realization"][0], many[f"{name}_by_realization"][0])


def test_other_bodies_do_not_notice_a_group():
    """A pair with a contact has the same paths beside a group as alone."""
    beside = base().replace(
        oscillators={name: il.LinearOscillator(stiffness=9.0, damping=4.0) for name in ("x", "y")},
        excitations={"x": il.WhiteNoise(1.0)},
        couplings={"t": spring("x", "y", 900.0)},
    )
    assert flowing(beside) == ["t"]
    record = [il.Trajectory(interval=0.1)]
    alone, together = (
        il.simulate(network, 20.0, step=0.005, realizations=70, record=record, rng=2) for network in (base(), beside)
    )
    np.testing.assert_array_equal(together.displacement.sel(oscillator=["one", "two"]), alone.displacement)
    np.testing.assert_array_equal(together.mean_square_velocity[:2], alone.mean_square_velocity)
