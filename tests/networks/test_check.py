"""Checks of a network before it runs: time scales, steps and the bias of a step."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scenes import base, linear

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators.base import frequencies
from impactlab.networks.linearized import LinearizedNetwork
from impactlab.step_control.rules.tangent_stiffness import Stiffening

LAW = il.LinearContact(400.0)
METHODS = [(il.ExactFlow(measured=False), 0.95), (il.RungeKutta4(), 0.7), (il.EulerMaruyama(), 0.5)]
"""Integrators, and a large step as a part of the largest."""


def pressed(overlap=2.0, **changes):
    """Two unequal bodies pressed together between two walls: contacts that never open, at rest at 0."""
    network = il.Network(
        {
            "a": il.LinearOscillator(mass=1.0, damping=0.8, stiffness=20.0),
            "b": il.LinearOscillator(mass=2.0, damping=2.5, stiffness=5.0),
        },
        {
            "left": il.Contact(il.WALL, "a", LAW, clearance=-overlap),
            "middle": il.Contact("a", "b", LAW, clearance=-overlap),
            "right": il.Contact("b", il.WALL, LAW, clearance=-overlap),
        },
        {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(0.3)},
    )
    return network.replace(**changes)


def linearized(network):
    """The network on springs of the contacts' stiffness: the energy does not matter for a linear law."""
    model = Model.of(network)
    return LinearizedNetwork.of(model, Stiffening.of(model, np.ones(len(model.bodies))))


def step_of(network, method, part):
    """A part of the largest step of a method."""
    return part * network.check().dataset.largest_step.sel(integrator=type(method).__name__).item()


@pytest.mark.filterwarnings("ignore:Friction takes:impactlab.AccuracyWarning")  # the steps are meant to be too large
@pytest.mark.parametrize(("method", "part"), METHODS, ids=lambda item: type(item).__name__)
def test_predicted_bias_is_that_of_a_simulation(method, part):
    """Within 3 standard errors at a large step; the bias itself is at least 10 of them."""
    network = pressed()
    step = step_of(network, method, part)
    options = {"duration": 40_000 * step, "spin_up": 80_000 * step}  # the Euler method damps less than the bodies do
    result = il.simulate(network, **options, realizations=128, step=step, integrator=method, rng=1)
    assert (result.contact_ratio == 1.0).all(), "the contacts must stay closed"
    scene = linearized(network)
    exact, discrete = np.diag(scene.covariance()), np.diag(scene.discrete_covariance(method, step))
    found = np.concatenate([result.variance_displacement, result.mean_square_velocity])
    error = np.concatenate([result.variance_displacement_standard_error, result.mean_square_velocity_standard_error])
    assert (np.abs(found - discrete) < 3.0 * error).all(), (found - discrete) / error
    assert np.abs((discrete - exact) / error).max() > 10.0


@pytest.mark.parametrize(("method", "part"), METHODS, ids=lambda item: type(item).__name__)
def test_biases_of_the_modes_add_up_to_those_of_the_bodies(method, part):
    """``Σ m E[x²]`` over bodies is ``Σ E[q²]`` over modes."""
    network = pressed()
    step = step_of(network, method, part)
    scene, data = linearized(network), network.check(step, method).dataset
    assert data.attrs["step"] == step
    frequency, shapes = scene.modes()
    np.testing.assert_allclose(data.closed_frequency, frequency, rtol=1e-9)
    weights = np.kron(np.eye(2), shapes.T * scene.model.mass)
    mass = np.tile(scene.model.mass, 2)
    exact = np.diag(weights @ scene.covariance() @ weights.T)
    biases = np.concatenate([data.bias_mean_square_displacement, data.bias_mean_square_velocity])
    modes = (exact * (1.0 + biases)).reshape(2, -1).sum(axis=1)
    bodies = (mass * np.diag(scene.discrete_covariance(method, step))).reshape(2, -1).sum(axis=1)
    np.testing.assert_allclose(modes, bodies, rtol=1e-8)


def test_covariance_at_equal_temperature():
    """``Cov(x, x) = T K⁻¹``, ``Cov(v, v) = T M⁻¹``."""
    warm = {"a": il.WhiteNoise(0.8 / np.pi), "b": il.WhiteNoise(2.5 / np.pi)}  # T = π S/c = 1 J
    covariance = linearized(pressed(excitations=warm)).covariance()
    stiffness = np.array([[820.0, -400.0], [-400.0, 805.0]])
    expected = np.zeros((4, 4))
    expected[:2, :2], expected[2:, 2:] = np.linalg.inv(stiffness), np.diag([1.0, 0.5])
    np.testing.assert_allclose(covariance, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("method", "step", "order"),
    [(il.ExactFlow(), 0.2, 4), (il.RungeKutta4(), 0.05, 2), (il.EulerMaruyama(), 1e-3, 1)],
    ids=lambda item: type(item).__name__,
)
def test_order_of_the_bias(method, step, order):
    """Shifted kicks and Simpson's rule are of fourth order, held noise under a good method of second.

    Friction that acts at one moment adds a term in the square of ``c h/m`` to the first, which
    is made small here.
    """
    network = pressed()
    if isinstance(method, il.ExactFlow):
        hardly = {name: replace(body, damping=1e-4 * body.damping) for name, body in network.oscillators.items()}
        network = network.replace(oscillators=hardly)
    scene = linearized(network)
    exact = np.diag(scene.covariance())
    unit = 1.0 / scene.modes()[0][-1]
    coarse, fine = (np.diag(scene.discrete_covariance(method, h * unit)) / exact - 1.0 for h in (step, 0.5 * step))
    np.testing.assert_allclose(np.log2(coarse / fine), order, atol=0.1)


@pytest.mark.parametrize("step", [0.01, 1.0, 30.0])
def test_exact_flow_has_no_bias_without_contacts(step):
    data = linear().check(step).dataset
    np.testing.assert_allclose(data.bias_mean_square_displacement, 0.0, atol=1e-12)
    np.testing.assert_allclose(data.bias_mean_square_velocity, 0.0, atol=1e-12)


@pytest.mark.parametrize("method", [il.RungeKutta4(), il.EulerMaruyama()])
def test_covariance_is_infinite_just_above_the_largest_step(method):
    network = linear()
    scene, largest = linearized(network), step_of(network, method, 1.0)
    assert np.isfinite(scene.discrete_covariance(method, 0.99 * largest)).all()
    assert np.isinf(scene.discrete_covariance(method, 1.02 * largest)).all()


def test_bias_of_an_unstable_method_is_infinite(monkeypatch):
    """Also where the method itself does not know its limit."""
    monkeypatch.setattr(il.EulerMaruyama, "largest_step", lambda *arguments: np.inf)
    data = pressed().check(0.1, il.EulerMaruyama()).dataset
    assert np.isposinf([data.bias_mean_square_displacement, data.bias_mean_square_velocity]).all()
    assert data.attrs["note"] == ""


def test_time_scales_of_a_hertz_contact():
    """Closed forms: the penetration that stores T, its tangent, half a period of the reduced mass."""
    network = il.Network(
        {
            "a": il.LinearOscillator(mass=2.0, damping=0.5, stiffness=50.0),
            "b": il.LinearOscillator(mass=3.0, damping=0.5, stiffness=12.0),
        },
        {"gap": il.Contact("a", "b", il.HertzContact(1e4), clearance=0.1)},
        {"a": il.WhiteNoise(1.0)},
    )
    data = network.check().dataset.squeeze()
    energy = np.pi * 1.0 / 0.5
    depth = (2.5 * energy / 1e4) ** 0.4
    tangent = 1.5e4 * np.sqrt(depth)
    assert data.thermal_penetration.item() == pytest.approx(depth, rel=1e-6)
    assert data.static_penetration.item() == 0.0
    assert data.tangent_stiffness.item() == pytest.approx(tangent, rel=1e-6)
    assert data.shortest_contact.item() == pytest.approx(np.pi * np.sqrt(1.2 / tangent), rel=1e-6)
    np.testing.assert_allclose(data.natural_frequency, [5.0, 2.0], rtol=1e-12)
    np.testing.assert_allclose(data.closed_frequency, frequencies(Model.of(network), np.array([tangent])), rtol=1e-6)


def test_a_body_pressed_against_a_wall():
    """Static: spring and contact share the overlap; the wall has infinite mass."""
    body = il.LinearOscillator(mass=2.0, damping=1.0, stiffness=100.0)
    network = il.Network(
        {"a": body}, {"wall": il.Contact("a", il.WALL, LAW, clearance=-0.5)}, {"a": il.WhiteNoise(0.1)}
    )
    data = network.check().dataset.squeeze()
    assert data.static_penetration.item() == pytest.approx(0.5 * 100.0 / 500.0, rel=1e-8)
    assert data.thermal_penetration.item() == pytest.approx(np.sqrt(2.0 * 0.1 * np.pi / 400.0), rel=1e-8)
    assert data.shortest_contact.item() == pytest.approx(np.pi * np.sqrt(2.0 / 400.0), rel=1e-8)
    assert data.closed_frequency.item() == pytest.approx(np.sqrt(250.0), rel=1e-8)


def test_residual_forces_count():
    """A Duffing body is stiffer at its thermal amplitude."""
    body = il.DuffingOscillator(1e4, damping=1.0, stiffness=1.0)
    data = il.Network({"a": body}, {}, {"a": il.WhiteNoise(1.0)}).check().dataset.squeeze()
    amplitude = np.sqrt(-1.0 / 1e4 + np.sqrt(1e-8 + 4.0 * np.pi / 1e4))  # x²/2 + 10⁴ x⁴/4 = π
    assert data.closed_frequency.item() == pytest.approx(np.sqrt(1.0 + 3e4 * amplitude**2), rel=0.05)
    assert data.natural_frequency.item() == 1.0


def test_steps_are_those_of_simulate(base_case):
    network = base_case()
    data = network.check().dataset
    assert list(data.integrator.values) == sorted(data.integrator.values)
    assert {"ExactFlow", "RungeKutta4", "EulerMaruyama"} <= set(data.integrator.values)
    for method in (il.ExactFlow(), il.RungeKutta4()):
        chosen = data.recommended_step.sel(integrator=type(method).__name__).item()
        used = il.simulate(network, 10.0, realizations=64, integrator=method, spin_up=0.0, rng=1).attrs["step"]
        assert used == pytest.approx(10.0 / np.ceil(10.0 / chosen))
        assert network.check(integrator=method).dataset.attrs["step"] == chosen
    assert data.attrs["step"] == data.recommended_step.sel(integrator="ExactFlow")
    with pytest.raises(il.InvalidInput, match=r"largest stable one is"):
        network.check(1.01 * data.largest_step.sel(integrator="ExactFlow").item())
    own = ["EulerMaruyama", "ExactFlow", "RungeKutta4"]  # beside those that other tests have defined
    assert (data.refusal.sel(integrator=own) == "").all()


def test_a_method_that_is_refused_is_not_a_number_with_a_reason():
    """Euler-Maruyama is unstable for a body that is not damped; exact flow is not."""
    network = pressed(oscillators={"a": il.LinearOscillator(stiffness=20.0)}, excitations={"a": None})
    data = network.check().dataset
    refused = data.sel(integrator="EulerMaruyama")
    assert np.isnan([refused.largest_step, refused.recommended_step]).all()
    assert "EulerMaruyama is unstable at any step" in refusal_of(refused)
    assert data.recommended_step.sel(integrator="ExactFlow") > 0.0
    assert np.isfinite(data.bias_mean_square_velocity).all(), "the other body heats and damps both modes"
    chosen = network.check(integrator=il.EulerMaruyama())
    assert np.isnan(chosen.dataset.attrs["step"])
    assert np.isnan(chosen.dataset.bias_mean_square_velocity).all()
    assert "EulerMaruyama is unstable at any step" in repr(chosen)
    assert "EulerMaruyama has no step" in chosen.dataset.attrs["note"]


def refusal_of(row):
    return str(row.refusal.item())


@pytest.mark.parametrize(
    ("network", "note"),
    [
        (pressed(excitations={"a": None, "b": None}), "no body is under white noise"),
        (il.Network({"a": il.LinearOscillator(damping=1.0)}, {}, {"a": il.WhiteNoise(1.0)}), "no stationary law"),
        (il.Network({"a": il.LinearOscillator()}), "no body is under white noise"),
    ],
)
def test_no_bias_without_a_law(network, note):
    data = network.check().dataset
    assert note in data.attrs["note"]
    assert np.isnan(data.bias_mean_square_velocity).all()


LOAD, SPRING = il.Contact("b", il.WALL, il.HertzContact(1e4)), il.Coupling("a", "b", il.LinearCoupling(1.0))
LEVER = il.Combination({"a": 2.0, "b": 1.0})


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, ""),
        ({"contacts": {"more": il.Contact("a", il.WALL, il.LankaraniNikraveshContact(1e4, restitution=0.5))}},
         "The bias of the step is measured before a run, which may choose another. "
         "Contact-free intervals are not crossed at once: laws with states."),
        ({"couplings": {"ab": SPRING}}, "Contact-free intervals are not crossed at once: linear couplings."),
        ({"contacts": {"more": LOAD.replace(first=LEVER)}},
         "Contact-free intervals are not crossed at once: links of weighted bodies."),
        ({"excitations": {"ground": il.Source(il.WhiteNoise(1.0), on={"a": 1.0})}},
         "Contact-free intervals are not crossed at once: sources of white noise."),
        ({"oscillators": {"a": il.DuffingOscillator(1.0, damping=1.0, stiffness=1.0)}},
         "Contact-free intervals are not crossed at once: residual forces."),
    ],
)  # fmt: skip
def test_it_says_what_a_run_does_with_its_step(changes, line):
    found = pressed(**changes).check()
    assert found.dataset.attrs["run"] == line
    assert str(found).endswith(line)


def test_large_networks_say_why_they_do_not_run_in_tiles():
    body, law = il.LinearOscillator(damping=1.0, stiffness=10.0), il.LankaraniNikraveshContact(1e3, restitution=0.5)
    line = "The network does not run in tiles: laws with states."
    assert line in str(il.chain(8192, body, law, excitation=il.WhiteNoise(1.0)).check())
    assert line not in str(il.chain(10, body, law, excitation=il.WhiteNoise(1.0)).check())


def test_an_energy_that_is_not_known():
    """An undamped body under noise: a given step is taken, nothing is guessed."""
    network = pressed(oscillators={"a": il.LinearOscillator(stiffness=20.0)})
    data = network.check(1e-3).dataset
    assert np.isnan(data.thermal_penetration).all()
    assert "closed_frequency" not in data
    np.testing.assert_allclose(data.open_frequency, sorted(data.natural_frequency.values))
    assert "not known" in data.attrs["note"]
    assert "No step can be chosen" in refusal_of(data.sel(integrator="ExactFlow"))


@pytest.mark.parametrize(
    "given",
    [
        {"step": 0.0}, {"step": -0.01}, {"step": np.nan}, {"step": "0.01"}, {"step": True}, {"step": 0.5},
        {"integrator": il.ExactFlow}, {"integrator": "ExactFlow"}, {"integrator": il.HertzContact(1.0)},
        {"step": 0.01, "integrator": il.EulerMaruyama()},
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_the_words_of_simulate(given):
    network = base()
    with pytest.raises(il.InvalidInput) as refused:
        il.simulate(network, 10.0, **given)
    words = str(refused.value).removeprefix("simulate: ")
    with pytest.raises(il.InvalidInput, match=f"^(Network.check: )?{re.escape(words)}$"):
        network.check(**given)


def test_a_table_is_printed():
    text = repr(pressed().check(0.02))
    assert text.startswith("Check of a network: ExactFlow(), step 0.02 s\n")
    rows = {line.split()[0]: line.split()[1:] for line in text.splitlines() if line}
    assert rows["a"] == ["4.472"]
    assert rows["middle"][2:] == ["400", f"{np.pi * np.sqrt(2.0 / 3.0 / 400.0):.4g}"]
    assert len(rows["RungeKutta4"]) == 2
    assert [len(rows[mode]) for mode in ("1", "2")] == [4, 4]
    assert not any(line != line.rstrip() for line in text.splitlines())


def storeys(**others):
    springs = 100.0 * (2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))
    springs[-1, -1] = 100.0
    structure = il.LinearStructure.from_damping_ratio([1.0, 1.0, 2.0], springs, [0.01, 0.02, 0.03])
    return il.Network({"house": structure}, **others), structure.modes()


def test_modes_of_a_network_stand_in_for_bodies_that_couplings_connect():
    """Storeys have no frequency of their own, and where nothing is random there is no thermal penetration."""
    push = {"house.3": il.Harmonic(1.0, frequency=3.0)}
    network, modes = storeys(excitations=push)
    text = repr(network.check())
    assert "natural frequency" not in text
    assert "penetration" not in text
    assert all(f"{frequency:.4g}" in text for frequency in modes.natural_frequency.values)
    stop = {"stop": il.Contact("house.3", il.WALL, il.LinearContact(1e4), clearance=0.1)}
    check = storeys(excitations=push, contacts=stop)[0].check()
    np.testing.assert_allclose(check.dataset.open_frequency, modes.natural_frequency)
    assert (check.dataset.closed_frequency > check.dataset.open_frequency).all()
    assert "static penetration" in repr(check)
    assert "thermal penetration" not in repr(check)


def test_long_tables_are_shortened_and_modes_of_many_bodies_left_out():
    body = il.LinearOscillator(damping=0.1, stiffness=1.0)
    many = il.chain(201, body, il.LinearContact(10.0), clearance=0.1, excitation=il.WhiteNoise(1.0)).check()
    assert "mode" not in many.dataset.dims
    assert "up to 200 bodies" in repr(many)
    assert "… 189 more" in repr(many)
    assert len(repr(many).splitlines()) < 50
