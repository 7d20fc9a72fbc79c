"""White noise under every integrator: the exact bias of a linear body, and exact flow without any."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

import impactlab as il
from impactlab.assembly.model import Model

OMEGA, RATIO, DENSITY = 2.0 * np.pi, 0.2, 1.5
DAMPING, STIFFNESS = 2.0 * RATIO * OMEGA, OMEGA**2
NETWORK = il.Network({"a": il.LinearOscillator.from_frequency(OMEGA, RATIO)}, excitations={"a": il.WhiteNoise(DENSITY)})
LAW = np.pi * DENSITY / DAMPING * np.array([1.0 / STIFFNESS, 1.0])


def law_of_the_method(polynomial, step):
    """Mean squares of x and v under a method that holds the noise constant over a step.

    The body and its constant force are one linear system, of which the method makes
    ``P(h M)``; the stationary covariance solves a discrete Lyapunov equation.
    """
    m = np.array([[0.0, 1.0, 0.0], [-STIFFNESS, -DAMPING, 1.0], [0.0, 0.0, 0.0]])
    amplification = sum(c * np.linalg.matrix_power(step * m, k) for k, c in enumerate(polynomial))
    push = amplification[:2, 2:] * np.sqrt(2.0 * np.pi * DENSITY / step)
    return np.diag(solve_discrete_lyapunov(amplification[:2, :2], push @ push.T))


METHODS = {
    "RungeKutta4": (il.RungeKutta4(), [1.0, 1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0], 0.1),
    "EulerMaruyama": (il.EulerMaruyama(), [1.0, 1.0], 0.01),
}


@pytest.mark.filterwarnings("ignore:.*off the common temperature:impactlab.AccuracyWarning")  # that is the bias
@pytest.mark.parametrize(("integrator", "polynomial", "step"), METHODS.values(), ids=METHODS)
def test_bias_of_a_linear_body_is_the_predicted_one(integrator, polynomial, step):
    expected = law_of_the_method(polynomial, step)
    ds = il.simulate(NETWORK, 200.0, realizations=512, step=step, integrator=integrator, rng=3)
    measured = np.array([ds.mean_square_displacement[0], ds.mean_square_velocity[0]])
    errors = np.array([ds.mean_square_displacement_standard_error[0], ds.mean_square_velocity_standard_error[0]])
    assert (np.abs(measured - expected) < 3.5 * errors).all()
    assert (np.abs(measured - LAW) > 6.0 * errors).any()  # so the bias is seen


@pytest.mark.parametrize(("name", "order"), [("RungeKutta4", 2.0), ("EulerMaruyama", 1.0)])
def test_order_of_the_bias(name, order):
    """Held noise is of second order in the mean squares of a linear body; Euler's method is of first."""
    _, polynomial, step = METHODS[name]
    coarse, fine = (law_of_the_method(polynomial, step / 2**k) / LAW - 1.0 for k in (4, 5))
    np.testing.assert_allclose(np.log2(coarse / fine), order, atol=0.02)


@pytest.mark.parametrize("periods", [0.01, 0.37, 3.3])
def test_exact_flow_has_no_bias_at_any_step(periods):
    step = periods * 2.0 * np.pi / OMEGA
    steps = 4000 if periods < 0.1 else 400
    ds = il.simulate(NETWORK, steps * step, realizations=512, step=step, rng=4)
    for name, expected in zip(("mean_square_displacement", "mean_square_velocity"), LAW, strict=True):
        error = float(ds[f"{name}_standard_error"][0])
        assert abs(float(ds[name][0]) - expected) < 3.5 * error
        assert error < 0.01 * expected
    for name in ("mean_displacement", "mean_velocity"):
        assert abs(float(ds[name][0])) < 3.5 * float(ds[f"{name}_standard_error"][0])


def free_path(body, x, v, t):
    """Displacement and velocity of a linear body, by the roots of its characteristic equation."""
    rate = body.damping / body.mass
    if body.stiffness == 0.0:
        travelled = -np.expm1(-rate * t) / rate if rate else t
        return x + travelled * v, np.exp(-rate * t) * v
    first, second = np.roots([1.0, rate, body.stiffness / body.mass]).astype(complex)
    weight = (v - second * x) / (first - second)
    parts = weight * np.exp(first * t), (x - weight) * np.exp(second * t)
    return sum(parts).real, (first * parts[0] + second * parts[1]).real


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("step", [1e-3, 0.05, 5.0])
@pytest.mark.parametrize(
    "body",
    [
        il.LinearOscillator.from_frequency(OMEGA, RATIO, mass=3.0),
        il.LinearOscillator(stiffness=4.0),
        il.LinearOscillator(damping=0.5),
        il.LinearOscillator(mass=2.0),
    ],
    ids=["damped", "undamped", "free and damped", "free"],
)
def test_free_flight_is_exact_at_any_step(body, step):
    duration = 100 * step
    ds = il.simulate(
        il.Network({"a": body}),
        duration,
        step=step,
        initial={"displacement": {"a": 0.3}, "velocity": {"a": -1.0}},
        record=il.Trajectory(interval=10 * step),
    )
    expected = np.array([free_path(body, 0.3, -1.0, t) for t in ds.time.values])
    size = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(ds.displacement[0, :, 0], expected[:, 0], rtol=0.0, atol=1e-12 * size[0])
    np.testing.assert_allclose(ds.velocity[0, :, 0], expected[:, 1], rtol=0.0, atol=1e-12 * size[1])


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_flight_between_contacts_is_exact():
    """Bodies that never touch, in a network with a contact, are on their closed paths."""
    network = il.Network(
        {"a": il.LinearOscillator(stiffness=4.0), "b": il.LinearOscillator(stiffness=9.0)},
        {"gap": il.Contact("a", "b", il.HertzContact(1e4), clearance=3.0)},
    )
    ds = il.simulate(
        network,
        10.0,
        initial={"displacement": {"a": 1.0, "b": 1.0}},
        record=il.Trajectory(interval=0.5),
        integrator=il.ExactFlow(),
    )
    expected = np.cos(np.outer(ds.time.values, [2.0, 3.0]))
    np.testing.assert_allclose(ds.displacement[0], expected, rtol=0.0, atol=1e-12)
    assert (ds.contact_ratio == 0.0).all()


def test_an_explicit_method_refuses_a_step_beyond_its_stability():
    with pytest.raises(il.InvalidInput, match=r"largest stable one is 0\.06\d+ s"):
        il.simulate(NETWORK, 10.0, step=0.07, integrator=il.EulerMaruyama())
    undamped = il.Network({"a": il.LinearOscillator(stiffness=1.0)})
    with pytest.raises(il.InvalidInput, match=r"unstable at any step.*ExactFlow"):
        il.simulate(undamped, 10.0, integrator=il.EulerMaruyama())


def test_stability_limits():
    """Euler: |1 + hλ| = 1 at h = 2ζ/ω. RK4 without damping: |P(iy)| = 1 at y = √8. The search steps by 0.7 %."""
    undamped = il.Network({"a": il.LinearOscillator(stiffness=100.0)})
    limits = [
        (il.EulerMaruyama(), NETWORK, 2.0 * RATIO / OMEGA),
        (il.RungeKutta4(), undamped, np.sqrt(8.0) / 10.0),
    ]
    for integrator, network, expected in limits:
        limit = integrator.largest_step(Model.of(network), np.zeros(0))
        assert expected * 0.993 < limit <= expected
