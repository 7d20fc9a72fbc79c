"""Couplings: descriptions, laws of coupled bodies, and what simulations make of them."""

import json
import pickle

import numpy as np
import pytest
from impactlab_numerics.laws.couplings import DeadBandCoupling
from laws import DampedCubicCoupling, TwoLines
from scenes import base, deviations
from scipy.integrate import dblquad, solve_ivp
from scipy.linalg import block_diag
from trio import DAMPER, STIFFNESS, law_by_hand, spring, trio

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators.base import coupling_rate, frequencies
from impactlab.linear.decay import relaxation_time
from impactlab.linear.laws import coupled_systems, flexibility, linear_variances, spread
from impactlab.networks.linearized import LinearizedNetwork
from impactlab.results.schema import balances
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies

MOMENTS = ["mean_square_displacement", "mean_square_velocity"]


def linearized(network):
    model = Model.of(network)
    return LinearizedNetwork.of(model, Stiffening.of(model, np.ones(len(model.bodies))))


# descriptions


def test_coupling_and_its_data():
    one = spring("a", il.WALL, 3.0, 1.0)
    assert one.to_dict()["second"] == {"wall": True}
    assert il.Coupling.from_dict(json.loads(json.dumps(one.to_dict()))) == one
    assert pickle.loads(pickle.dumps(one)) == one
    assert repr(one) == "Coupling('a', WALL, LinearCoupling(stiffness=3.0, damping=1.0))"
    np.testing.assert_allclose(one.law.evaluate([2.0, -1.0], [0.5, 0.5]), [6.5, -2.5])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("a", "a", il.LinearCoupling(1.0)),
            r"coupling of a body with itself: 'a' was given twice; name two",
        ),
        ((il.WALL, {"wall": True}, il.LinearCoupling(1.0)), r"with itself: WALL was given twice"),
        (
            ("", "a", il.LinearCoupling(1.0)),
            r"Coupling.first must be .*, an il.Combination or il.WALL, not ''",
        ),
        (
            ("a", 3, il.LinearCoupling(1.0)),
            r"Coupling.second must be .*, an il.Combination or il.WALL, not 3",
        ),
        (("a", "b", 3.0), r"Coupling.law must be a coupling law such as il.LinearCoupling\(1e3\), not 3.0"),
        (("a", "b", il.HertzContact(1.0)), r"Coupling.law must be a coupling law"),
        (("a", "b", il.HertzContact(1.0).to_dict()), r"'HertzContact' is not a CouplingLaw"),
    ],
)
def test_bad_coupling(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.Coupling(*arguments)


def test_abstract_law():
    with pytest.raises(il.InvalidInput, match=r"CouplingLaw is abstract: it does not define force"):
        il.CouplingLaw()


# forces


@pytest.mark.full
def test_forces_are_opposite_and_those_of_the_formula():
    compiled = trio(damping=0.7).compile()
    y = np.random.default_rng(1).normal(size=6)
    mass, own = np.array([1.0, 2.0, 0.7]), np.array([0.8, 0.5, 1.1])
    force = -STIFFNESS @ y[:3] - (np.diag(own) + 0.7 * DAMPER) @ y[3:]
    np.testing.assert_allclose(compiled.rhs(0.0, y), [*y[3:], *(force / mass)], rtol=1e-13)


@pytest.mark.full
def test_a_law_of_ones_own_between_contacts_and_bodies():
    """Against the equation written by hand; the extension is that of the second over the first."""
    bodies = {"a": il.DuffingOscillator(2.0), "b": il.LinearOscillator(mass=2.0)}
    gap = {"gap": il.Contact("a", "b", il.HertzContact(100.0), clearance=0.1)}
    network = il.Network(bodies, gap, couplings={"c": il.Coupling("b", "a", il.CubicCoupling(5.0))})
    x = np.array([0.9, 0.2])
    pull, push = 5.0 * (0.2 - 0.9) ** 3, 100.0 * 0.6**1.5
    expected = [pull - push - 2.0 * 0.9**3, (-pull + push) / 2.0]
    np.testing.assert_allclose(network.compile().rhs(0.0, np.append(x, [0.3, 0.4]))[2:], expected, rtol=1e-13)
    assert not Model.of(network).kicks.dissipative


def test_what_a_model_knows():
    model = Model.of(trio())
    assert model.links.pairs.tolist() == [[0, 1], [1, 2], [2, 0], [2, 3]]
    assert (model.kicks.nonlinear.all(), model.kicks.dissipative) == (True, False)
    assert Model.of(trio(damping=0.1)).kicks.dissipative
    bodies = dict.fromkeys("pqrst", il.LinearOscillator(stiffness=1.0))
    couplings = {"1": spring("p", "q"), "2": spring("s", il.WALL, 7.0, 2.0)}
    contacts = {"gap": il.Contact("q", "r", il.HertzContact(1.0))}
    model = Model.of(il.Network(bodies, contacts, couplings=couplings))
    assert model.connected.tolist() == [0, 0, 0, 1, 2]
    (first, k, c), (second, k_wall, c_wall) = model.coupled_parts()
    assert (first.tolist(), k.tolist(), c.tolist()) == ([0, 1], [[30.0, -30.0], [-30.0, 30.0]], [[0.0] * 2] * 2)
    assert (second.tolist(), k_wall.tolist(), c_wall.tolist()) == ([3], [[7.0]], [[2.0]])


# linear laws


@pytest.mark.parametrize("hot", [(1.0, 1.0, 1.0), (4.0, 1.0, 0.2), (1.0, 0.0, 0.0)])
@pytest.mark.parametrize("damping", [0.0, 0.6])
def test_law_of_a_coupled_system(hot, damping):
    model = Model.of(trio(damping, hot))
    expected = law_by_hand(hot, damping)
    ((slots, system),) = coupled_systems(model)
    assert slots.tolist() == [0, 1, 2]
    np.testing.assert_allclose(system.covariance, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(linear_variances(model).ravel(), np.diag(expected), rtol=1e-9)
    np.testing.assert_allclose(linearized(model.network).covariance(), expected, rtol=1e-9, atol=1e-12)


def test_law_at_equal_temperature():
    """``Cov(x) = T K⁻¹``, ``Cov(v) = T M⁻¹``."""
    expected = block_diag(3.0 * np.linalg.inv(STIFFNESS), 3.0 * np.diag([1.0, 0.5, 1.0 / 0.7]))
    np.testing.assert_allclose(law_by_hand((3.0,) * 3, 0.0), expected, rtol=1e-9, atol=1e-12)
    model = Model.of(trio(hot=(3.0,) * 3))
    np.testing.assert_allclose(flexibility(model), np.diag(np.linalg.inv(STIFFNESS)))
    np.testing.assert_allclose(spread(model).ravel(), np.sqrt(np.diag(expected)))


def test_law_of_a_pair_that_nothing_holds():
    """The velocities have a law, and so has the distance; the place of the pair has none."""
    body = il.LinearOscillator(mass=2.0, damping=0.5)
    noise = il.WhiteNoise(0.5 / np.pi)  # T = 1 J
    model = Model.of(il.Network({"a": body, "b": body}, {}, {"a": noise, "b": noise}, {"s": spring()}))
    np.testing.assert_allclose(linear_variances(model), [[np.inf] * 2, [0.5] * 2])
    ((_, system),) = coupled_systems(model)
    relative = np.array([1.0, -1.0, 0.0, 0.0])
    assert relative @ system.covariance @ relative == pytest.approx(1.0 / 30.0)
    assert np.isinf(flexibility(model)).all()


def test_no_law_without_damping_and_none_needed_without_noise():
    quiet = il.LinearOscillator(stiffness=1.0)
    still = il.Network({"a": quiet, "b": quiet}, couplings={"s": spring()})
    assert (linear_variances(Model.of(still)) == 0.0).all()
    driven = still.replace(excitations={"b": il.WhiteNoise(1.0)})
    assert np.isinf(linear_variances(Model.of(driven))).all()
    # a damper between them leaves their common motion undamped
    between = driven.replace(couplings={"s": spring(damping=1.0)})
    assert np.isinf(linear_variances(Model.of(between))).all()


def test_relaxation_time_is_that_of_the_slowest_mode():
    """Equal bodies: the common mode has the bodies' own rate, the relative mode more by two dampers."""
    body = il.LinearOscillator(damping=0.3, stiffness=4.0)
    pair = il.Network({"a": body, "b": body}, couplings={"s": spring(damping=0.2)})
    assert relaxation_time(Model.of(pair)) == pytest.approx(2.0 / 0.3)
    ((_, system),) = coupled_systems(Model.of(pair))
    np.testing.assert_allclose(np.sort(system.rates), [0.15, 0.15, 0.35, 0.35])
    undamped = pair.replace(oscillators=dict.fromkeys("ab", il.LinearOscillator(stiffness=4.0)))
    assert relaxation_time(Model.of(undamped)) == pytest.approx(1.0 / 0.2)
    # the damped body slows down the other through a soft spring
    cold = pair.replace(oscillators={"b": il.LinearOscillator(stiffness=4.0)}, couplings={"s": spring(stiffness=0.5)})
    drift = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-4.5, 0.5, -0.3, 0], [0.5, -4.5, 0, 0]])
    assert relaxation_time(Model.of(cold)) == pytest.approx(-1.0 / np.linalg.eigvals(drift).real.max())


def test_variances_under_cosines():
    """Against the amplitude of each body's steady response, found by a linear solve in real numbers."""

    network = trio(damping=0.4, excitations={"a": TwoLines(3.0, second=11.0), "b": None, "c": None})
    mass, damping = np.diag([1.0, 2.0, 0.7]), np.diag([0.8, 0.5, 1.1]) + 0.4 * DAMPER
    expected = np.zeros((2, 3))
    for omega, amplitude in ((3.0, 2.0), (11.0, 5.0)):
        dynamic = STIFFNESS - omega**2 * mass
        real = np.block([[dynamic, omega * damping], [-omega * damping, dynamic]])  # of cosine and sine
        response = np.linalg.solve(real, [amplitude, 0, 0, 0, 0, 0]).reshape(2, 3)
        expected += 0.5 * (response**2).sum(axis=0) * np.array([[1.0], [omega**2]])
    np.testing.assert_allclose(linear_variances(Model.of(network)), expected, rtol=1e-10)


# steps


def crowd(damping=0.0, hot=(1.0, 1.0, 1.0)):
    """The trio, with a tail of six more bodies on soft springs: too many for one joint linear motion."""
    tail = "defghi"
    return trio(damping, hot).replace(
        oscillators=dict.fromkeys(tail, il.LinearOscillator(mass=5.0, damping=1.0, stiffness=3.0)),
        couplings={f"{one}{two}": spring(one, two, 2.0) for one, two in zip("c" + tail[:-1], tail, strict=True)},
    )


def test_springs_and_dampers_limit_the_step():
    model = Model.of(trio(damping=0.5))
    inverse = np.diag(np.array([1.0, 2.0, 0.7]) ** -0.5)
    stiffening = Stiffening.of(model, np.ones(3))
    np.testing.assert_allclose(stiffening.links, [30.0, 50.0, 10.0, 15.0])
    expected = np.sqrt(np.linalg.eigvalsh(inverse @ STIFFNESS @ inverse))
    np.testing.assert_allclose(frequencies(model, stiffening.links), expected)
    assert coupling_rate(model) == pytest.approx(np.linalg.eigvalsh(inverse @ (0.5 * DAMPER) @ inverse)[-1])
    slow = crowd(damping=0.5).check().dataset.recommended_step.sel(integrator="ExactFlow")
    assert slow == pytest.approx(0.05 / coupling_rate(Model.of(crowd(damping=0.5))))
    kicks = np.zeros((9, 9))
    kicks[:3, :3] = STIFFNESS - np.diag([20.0, 5.0, 0.0])
    for one in range(2, 8):
        kicks[one : one + 2, one : one + 2] += 2.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    root = np.array([1.0, 2.0, 0.7, *[5.0] * 6]) ** -0.5
    quick = crowd().check().dataset.recommended_step.sel(integrator="ExactFlow")
    assert quick == pytest.approx(0.5 / np.sqrt(np.linalg.eigvalsh(root[:, None] * kicks * root)[-1]))


def test_tangent_of_a_law_of_ones_own():
    """At the amplitude that stores the energy: ``cubic e⁴/4 = E``, tangent ``3 cubic e²``."""
    bodies = dict.fromkeys("ab", il.LinearOscillator(stiffness=1.0, damping=0.1))
    network = il.Network(bodies, couplings={"c": il.Coupling("a", "b", il.CubicCoupling(5.0))})
    stiffening = Stiffening.of(Model.of(network), np.full(2, 0.3))
    assert stiffening.couplings[0] == pytest.approx(3.0 * 5.0 * np.sqrt(4.0 * 0.3 / 5.0), rel=0.05)  # 64 intervals


def test_energy_of_a_start_counts_the_couplings():
    model = Model.of(trio())
    start = np.array([[0.3, -0.2, 0.1], [1.0, 0.0, 2.0]])
    found = energies(model, start, 1.0)
    own = 0.5 * (np.array([20.0, 5.0, 0.0]) * start[0] ** 2 + np.array([1.0, 2.0, 0.7]) * start[1] ** 2)
    stored = 0.5 * np.array([30.0 * 0.25 + 10.0 * 0.04, 30.0 * 0.25 + 50.0 * 0.09, (50.0 * 9 + 10.0 * 4 + 15.0) / 100])
    np.testing.assert_allclose(found, (own + stored).max())


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Friction takes:impactlab.AccuracyWarning")  # the steps are meant to be too large
@pytest.mark.parametrize(
    ("method", "part", "realizations"),
    [(il.ExactFlow(measured=False), 1.0, 64), (il.RungeKutta4(), 0.7, 64), (il.EulerMaruyama(), 0.7, 128)],
    ids=repr,
)
@pytest.mark.parametrize("damping", [0.0, 1.0])
def test_the_law_at_a_large_step_is_the_predicted_one(method, part, realizations, damping):
    """The discrete Lyapunov equation gives what a simulation finds; the bias is at least 5 of its errors."""
    network = (crowd if isinstance(method, il.ExactFlow) else trio)(damping, hot=(3.0, 1.0, 0.2))
    step = part * network.check().dataset.largest_step.sel(integrator=type(method).__name__).item()
    options = {"duration": 200_000 * step, "spin_up": 100.0, "step": step}
    result = il.simulate(network, **options, realizations=realizations, integrator=method, rng=4)
    scene = linearized(network)
    exact, discrete = np.diag(scene.covariance()), np.diag(scene.discrete_covariance(method, step))
    found = np.concatenate([result[name] for name in MOMENTS])
    error = np.concatenate([result[f"{name}_standard_error"] for name in MOMENTS])
    assert (np.abs(found - discrete) < 3.5 * error).all(), (found - discrete) / error
    assert np.abs((discrete - exact) / error).max() > 5.0


@pytest.mark.parametrize("method", [il.RungeKutta4(), il.EulerMaruyama()], ids=repr)
@pytest.mark.parametrize("damping", [0.0, 0.5, 20.0])
def test_explicit_methods_are_stable_up_to_the_largest_step(method, damping):
    network = trio(damping)
    largest = network.check().dataset.largest_step.sel(integrator=type(method).__name__).item()
    assert np.isfinite(linearized(network).discrete_covariance(method, 0.99 * largest)).all()


# motion


def path(network, duration, step, **start):
    """One noise-free realization: displacements and velocities, (time, body)."""
    initial = {"displacement": start.get("displacement", {}), "velocity": start.get("velocity", {})}
    record = [il.Trajectory(interval=step)]
    result = il.simulate(network, duration=duration, step=step, spin_up=0.0, initial=initial, record=record, rng=1)
    return result.time.values, result.displacement.values[0], result.velocity.values[0]


@pytest.mark.full
def test_modes_of_two_coupled_bodies():
    """In phase at √(k/m), against each other at √((k + 2κ)/m); the frequencies from a fit to 20 periods."""
    body = il.LinearOscillator(mass=0.5, stiffness=8.0)
    network = il.Network({"a": body, "b": body}, couplings={"s": spring(stiffness=30.0)})
    common, relative = 4.0, np.sqrt(68.0 / 0.5)
    for sign, omega in ((1.0, common), (-1.0, relative)):
        duration = 40.0 * np.pi / omega
        step = duration / 8000
        time, x, _ = path(network, duration, step, displacement={"a": 1.0, "b": sign})
        np.testing.assert_allclose(x[:, 1], sign * x[:, 0], atol=1e-12)
        np.testing.assert_allclose(x[:, 0], np.cos(omega * time), atol=2e-4)


def test_momentum_of_free_bodies_is_conserved_and_a_damper_takes_their_energy():
    """Centre of mass in uniform motion; the distance is a damped oscillator with closed form."""
    bodies = {"a": il.LinearOscillator(mass=1.0), "b": il.LinearOscillator(mass=3.0)}
    network = il.Network(bodies, couplings={"s": spring(stiffness=12.0, damping=0.6)})
    time, x, v = path(network, 20.0, 2e-3, velocity={"a": 2.0})
    np.testing.assert_allclose(v @ [1.0, 3.0], 2.0, rtol=1e-12)
    np.testing.assert_allclose(x @ [1.0, 3.0], 2.0 * time, atol=1e-10)
    decay = 0.6 / (2.0 * 0.75)  # reduced mass 3/4
    omega = np.sqrt(12.0 / 0.75 - decay**2)
    np.testing.assert_allclose(x[:, 0] - x[:, 1], 2.0 / omega * np.exp(-decay * time) * np.sin(omega * time), atol=2e-5)


@pytest.mark.full
@pytest.mark.parametrize("method", [il.ExactFlow(), il.RungeKutta4(), il.EulerMaruyama()], ids=repr)
def test_paths_converge_to_those_of_another_solver(method):
    """With contacts, a damped and a user's coupling, and a wall; the order is that of the method, 2 with dampers."""
    network = trio(damping=0.4, excitations=dict.fromkeys("abc")).replace(
        contacts={"gap": il.Contact("a", "c", il.PowerLawContact(500.0, exponent=3.0), clearance=0.05)},
        couplings={"own": il.Coupling("b", il.WALL, DampedCubicCoupling(40.0, damping=0.3))},
    )
    compiled = network.compile()
    start = {"velocity": {"a": 1.5}}
    solution = solve_ivp(compiled.rhs, (0.0, 2.0), compiled.state(**start), "DOP853", rtol=1e-12, atol=1e-13)
    errors = []
    for step in (2e-4, 1e-4) if method.order == 1 else (4e-3, 2e-3):
        initial = {"displacement": {}, "velocity": {"a": 1.5}}
        options = {"duration": 2.0, "spin_up": 0.0, "step": step, "initial": initial, "integrator": method}
        result = il.simulate(network, **options, record=[il.Trajectory(interval=2.0)], rng=1)
        errors.append(np.abs(result.displacement.values[0, -1] - solution.y[:3, -1]).max())
    expected = 2.0 if method.kicks else method.order
    assert np.log2(errors[0] / errors[1]) == pytest.approx(expected, abs=0.25)


# ensembles


@pytest.mark.parametrize("hot", [(1.0, 1.0, 1.0), (9.0, 1.0, 0.1), (1.0, 0.0, 0.0)])
@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_the_law_at_the_automatic_step(hot, damping):
    """Within 0.1 % and 3.5 standard errors, which are smaller than 0.3 %."""
    network = trio(damping, hot)
    result = il.simulate(network, duration=1200.0, realizations=256, rng=11)
    expected = np.diag(law_by_hand(hot, damping)).reshape(2, 3)
    for name, exact in zip(MOMENTS, expected, strict=True):
        error = result[f"{name}_standard_error"].values
        assert (error < 3e-3 * exact).all(), (name, error / exact)
        distance = np.abs(result[name].values - exact) - 1e-3 * exact
        assert (distance < 3.5 * error).all(), (name, (result[name].values - exact) / exact, error / exact)


@pytest.mark.full
def test_balances_close_with_couplings_and_contacts():
    """They hold body by body, at any step, whatever kicks the bodies."""
    network = base(couplings={"s": spring("one", "two", 200.0, 1.0), "w": spring("two", il.WALL, 20.0)})
    for part in (0.3, 0.9):
        step = part * network.check().dataset.largest_step.sel(integrator="ExactFlow").item()
        method = il.ExactFlow(measured=False)  # the steps are meant to be too large
        result = il.simulate(network, duration=100.0, step=step, integrator=method, realizations=128, rng=5)
        for name in (balance.name for balance in balances()):
            if name in result:
                assert (np.abs(result[name]) < 4.0 * result[f"{name}_standard_error"]).all(), name


@pytest.mark.full
def test_a_stationary_start_is_drawn_from_the_coupled_law():
    """Without a spin-up the covariance is there from the beginning; unlike temperatures, one body without noise."""
    network = trio(0.3, (4.0, 1.0, 0.0))
    record = [il.Trajectory(interval=1e-6)]
    result = il.simulate(network, duration=1e-6, step=1e-6, spin_up=0.0, realizations=40_000, record=record, rng=3)
    state = np.concatenate([result.displacement.values[:, 0], result.velocity.values[:, 0]], axis=1)
    expected = law_by_hand((4.0, 1.0, 0.0), 0.3)
    scatter = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / len(state))
    deviation = (state.T @ state / len(state) - expected) / scatter
    assert np.abs(deviation).max() < 4.0, deviation


def test_a_lane_does_not_depend_on_its_block():
    network = trio(0.3, (4.0, 1.0, 0.2))
    record = [il.PerRealization()]
    options = {"duration": 2.0, "spin_up": 0.0, "step": 0.01, "record": record, "rng": 3}
    few, many = (il.simulate(network, realizations=count, **options) for count in (65, 300))
    name = "mean_square_displacement_by_realization"
    np.testing.assert_array_equal(few[name], many[name][:65])


def stiff_pair(stiffness):
    """Unlike bodies at T = 1 J, held by 9 N/m."""
    one, two = il.LinearOscillator(mass=1.0, damping=0.5, stiffness=9.0), il.LinearOscillator(mass=2.0, damping=1.0)
    noises = {"one": il.WhiteNoise(0.5 / np.pi), "two": il.WhiteNoise(1.0 / np.pi)}
    return il.Network({"one": one, "two": two}, {}, noises, {"s": spring("one", "two", stiffness)})


def test_balances_of_both_bodies_serve_as_controls():
    """The errors of the velocities' mean squares fall to less than a half; by a body's own balance alone to 0.6."""
    result = il.simulate(stiff_pair(300.0), duration=300.0, realizations=256, rng=2)
    name = "mean_square_velocity"
    assert (result[f"direct_{name}_standard_error"] > 2.0 * result[f"{name}_standard_error"]).all()


def test_stiffly_coupled_bodies_move_as_one():
    """They have the law of one body with their masses, springs and dampers together."""
    result = il.simulate(stiff_pair(9e4), duration=100.0, realizations=256, rng=6)
    error = result.mean_square_displacement_standard_error
    assert (np.abs(result.mean_square_displacement - 1.0 / 9.0) < 3.5 * error + 1e-3 / 9.0).all()
    assert (error < 0.02 / 9.0).all()


# exact laws


def coupled_base(between=60.0, held=25.0):
    return base(couplings={"s": spring("two", "one", between), "w": spring(il.WALL, "two", held)})


def test_exact_law_of_a_coupled_pair_against_quadrature_in_the_plane():
    """The Gibbs density in (x₁, x₂) with all springs, written by hand."""
    reference = il.exact(coupled_base()).statistics()
    k = [(32.0 * np.pi) ** 2, 4.0 * np.pi**2 + 25.0]
    temperature = np.pi * 16.0 / (0.2 * 32.0 * np.pi)

    def energy(x, y):
        depth = max(x - y - 0.05, 0.0)
        springs = 0.5 * (k[0] * x * x + k[1] * y * y + 60.0 * (x - y) ** 2)
        return (springs + 0.4e4 * depth**2.5) / temperature

    def integral(function):
        """Split where the contact closes; beyond 9 standard deviations nothing is left."""
        wide, narrow = 9.0 * np.sqrt(temperature / k[1]), 9.0 * np.sqrt(temperature / k[0])

        def integrand(x, y):
            return function(x, y) * np.exp(-energy(x, y))

        def corner(y):
            return min(max(y + 0.05, -narrow), narrow)

        options = {"epsabs": 1e-14, "epsrel": 1e-11}
        pieces = [(-wide, -narrow - 0.05), (-narrow - 0.05, narrow - 0.05), (narrow - 0.05, wide)]
        return sum(
            dblquad(integrand, *piece, -narrow, corner, **options)[0]
            + dblquad(integrand, *piece, corner, narrow, **options)[0]
            for piece in pieces
        )

    total = integral(lambda x, y: 1.0)
    for row, power in ((0, (2, 0)), (1, (0, 2))):
        moment = integral(lambda x, y, power=power: x ** power[0] * y ** power[1]) / total
        assert reference.mean_square_displacement[row].item() == pytest.approx(moment, rel=1e-9)
    assert reference.contact_ratio.item() == pytest.approx(integral(lambda x, y: float(x - y > 0.05)) / total, rel=1e-9)


def test_exact_laws_without_contacts_are_gaussian():
    network = coupled_base().replace(contacts={"gap": None})
    k = np.diag([(32.0 * np.pi) ** 2, 4.0 * np.pi**2 + 25.0]) + 60.0 * np.array([[1, -1], [-1, 1]])
    found = il.exact(network).statistics()
    np.testing.assert_allclose(found.variance_displacement, 2.5 * np.diag(np.linalg.inv(k)), rtol=1e-12)


def test_a_coupling_to_the_wall_is_a_stiffer_body():
    one = base().replace(oscillators={"two": None}, contacts={"gap": None}, excitations={"two": None})
    wall = {"gap": il.Contact("one", il.WALL, il.HertzContact(1e4), clearance=0.02)}
    stiffer = one.oscillators["one"].replace(stiffness=one.oscillators["one"].stiffness + 3e3)
    coupled = il.exact(one.replace(contacts=wall, couplings={"w": spring("one", il.WALL, 3e3)})).statistics()
    plain = il.exact(one.replace(contacts=wall, oscillators={"one": stiffer})).statistics()
    for name in plain:
        np.testing.assert_allclose(coupled[name], plain[name], rtol=1e-12)


def test_simulation_of_a_coupled_pair_against_its_exact_law():
    network = coupled_base()
    result = il.simulate(network, duration=200.0, realizations=256, rng=8)
    names = [*MOMENTS, "contact_ratio", "contact_rate", "mean_contact_force"]
    for name, found in deviations(result, il.exact(network).statistics(), names, relative=1e-3).items():
        assert found < 3.5, (name, found)


def test_a_cold_body_may_be_heated_by_its_coupling():
    network = coupled_base().replace(
        oscillators={"two": il.LinearOscillator(stiffness=40.0)}, excitations={"two": None}, contacts={"gap": None}
    )
    assert il.exact(network).statistics().mean_square_velocity.values == pytest.approx(2.5)
    with pytest.raises(il.NoExactReference, match=r"'two': neither noise nor damping"):
        il.exact(network.replace(couplings={"s": spring("two", "one", 0.0)}))


@pytest.mark.parametrize(
    ("couplings", "message"),
    [
        ({"s": spring("one", "two", 60.0, 1.0)}, r"coupling 's' has damping without noise: its temperature is 0"),
        (
            {"s": il.Coupling("one", "two", DeadBandCoupling(1.0, play=0.1))},
            r"DeadBandCoupling, the law of coupling 's', does not define potential; define potential\(extension, ...\)",
        ),
    ],
)
def test_no_exact_law(couplings, message):
    with pytest.raises(il.NoExactReference, match=message):
        il.exact(base(couplings=couplings))


def test_couplings_connect_bodies_for_exact_laws():
    walls = {"gap": None, "stop": il.Contact("one", il.WALL, il.HertzContact(1e4), clearance=0.05)}
    far = base(ratio=4.0).replace(contacts=walls)  # unlike temperatures
    il.exact(far)
    with pytest.raises(il.NoExactReference, match=r"temperatures .* of connected bodies differ"):
        il.exact(far.replace(couplings={"s": spring("one", "two")}))
