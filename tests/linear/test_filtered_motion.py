"""Filters and the bodies that they move as one linear system: steps, start and stationary law."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.decay import relaxation_time
from impactlab.linear.laws import coupled_systems, motions_of

CLOUGH = il.CloughPenzien(1.0, 15.0, 0.6, 1.5, 0.5)
TWO = {
    "a": il.LinearOscillator(mass=1.0, damping=0.4, stiffness=9.0),
    "b": il.LinearOscillator(mass=2.0, damping=1.2, stiffness=20.0),
}
ON = {"a": 1.0, "b": -0.5}


def motion_of(noise, couplings=None, bodies=TWO, on=ON):
    model = Model.of(il.Network(bodies, None, {"ground": il.Source(noise, on=on)}, couplings))
    return motions_of(model, coupled_systems(model))[0]


def drift_of(noise, spring=0.0):
    """Drift and growth of the filter, x_a, x_b, v_a and v_b, without anything of impactlab's linear algebra."""
    a, b, c = map(np.array, noise.filter())
    states = len(b)
    mass, damping, stiffness = np.array([1.0, 2.0]), np.diag([0.4, 1.2]), np.diag([9.0, 20.0])
    stiffness = stiffness + spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    drift, growth = np.zeros((states + 4,) * 2), np.zeros((states + 4,) * 2)
    drift[:states, :states] = a
    drift[states : states + 2, states + 2 :] = np.eye(2)
    drift[states + 2 :, states : states + 2] = -stiffness / mass[:, None]
    drift[states + 2 :, states + 2 :] = -damping / mass[:, None]
    drift[states + 2 :, :states] = np.outer([1.0, -0.5] / mass, c)
    growth[:states, :states] = 2.0 * np.pi * np.outer(b, b)
    return drift, growth


@pytest.mark.parametrize("spring", [0.0, 400.0])
@pytest.mark.parametrize("noise", [CLOUGH, il.OrnsteinUhlenbeckNoise(0.5, correlation_time=0.3)], ids=type)
def test_the_stationary_covariance_solves_lyapunovs_equation(noise, spring):
    couplings = {"s": il.Coupling("a", "b", il.LinearCoupling(spring))} if spring else None
    drift, growth = drift_of(noise, spring)
    expected = solve_continuous_lyapunov(drift, -growth)
    np.testing.assert_allclose(motion_of(noise, couplings).covariance, expected, rtol=1e-8, atol=1e-10)


def test_bodies_that_no_spring_holds_have_the_law_of_their_velocities():
    """In the coordinates z, x_a - x_b, v_a, v_b; what a common motion adds to displacements grows for ever."""
    free = {name: body.replace(stiffness=0.0) for name, body in TWO.items()}
    found = motion_of(CLOUGH, {"s": il.Coupling("a", "b", il.LinearCoupling(30.0))}, free)
    a, b, c = map(np.array, CLOUGH.filter())
    drift, growth = np.zeros((7, 7)), np.zeros((7, 7))
    drift[:4, :4], growth[:4, :4] = a, 2.0 * np.pi * np.outer(b, b)
    drift[4, 5:] = 1.0, -1.0
    drift[5:, 4] = -30.0, 15.0
    drift[5:, 5:] = -np.diag([0.4, 0.6])
    drift[5:, :4] = np.outer([1.0, -0.25], c)
    expected = solve_continuous_lyapunov(drift, -growth)
    apart = np.zeros((7, 8))
    apart[:4, :4], apart[4, 4:6], apart[5:, 6:] = np.eye(4), (1.0, -1.0), np.eye(2)
    np.testing.assert_allclose(apart @ found.covariance @ apart.T, expected, rtol=1e-8, atol=1e-12)
    assert np.isinf(found.variances()[0]).all()
    np.testing.assert_allclose(found.variances()[1], np.diag(expected)[5:], rtol=1e-8)


@pytest.mark.parametrize("step", [0.003, 0.2, 7.0])
def test_steps_of_any_length_keep_the_stationary_law(step):
    """Of filter and bodies together: they forget nothing of what they have in common."""
    motion = motion_of(CLOUGH)
    rows, noise, flow = motion.steps(step)
    states, order = motion.states, [0, 1, 2, 3, 4, 6, 5, 7]  # x and v of a body follow each other
    before = motion.covariance[np.ix_(order, order)]
    whole = np.zeros((8, 8))
    whole[:, :states] = rows
    whole[states:, states:] = flow
    after = whole @ before @ whole.T + noise @ noise.T
    size = np.sqrt(np.diag(before))
    np.testing.assert_allclose(after / np.outer(size, size), before / np.outer(size, size), atol=1e-8)


def test_a_growing_envelope_is_exact_within_a_step():
    """Against many short steps at the values of the envelope in their middle."""
    noise, step, parts, mean, slope = il.Modulated(CLOUGH, [0.0, 1.0], [1.0, 2.0]), 0.4, 800, 1.3, 0.6
    motion = motion_of(noise)
    states = motion.states
    rows, by_noise, *_ = motion.steps(step)
    whole = np.concatenate([rows, by_noise], axis=1)
    response = mean * whole[states : states + 4] + slope * whole[states + 4 :]
    drift, growth = drift_of(noise)
    z = np.concatenate([np.eye(states), np.zeros((4, states))])
    covariance, place = np.zeros((8, 8)), step / parts
    for part in range(parts):
        factor = mean + slope * (2.0 * (part + 0.5) / parts - 1.0)
        here = drift.copy()
        here[states:, :states] *= factor
        middle = z + 0.5 * place * here @ z
        change = here @ covariance + covariance @ here.T + growth
        half = covariance + 0.5 * place * change
        covariance = covariance + place * (here @ half + half @ here.T + growth)
        z = z + place * here @ middle
    order = [4, 6, 5, 7]
    np.testing.assert_allclose(response[:, :states], z[order], atol=2e-5 * np.abs(z[order]).max())
    found, expected = response[:, states:] @ response[:, states:].T, covariance[np.ix_(order, order)]
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-9)


def test_bodies_without_a_law_start_at_rest_and_the_filter_does_not():
    free = motion_of(CLOUGH, bodies={"a": il.LinearOscillator()}, on={"a": 1.0})
    assert free.covariance is None
    root = free.start()
    a, b, _ = map(np.array, CLOUGH.filter())
    expected = solve_continuous_lyapunov(a, -2.0 * np.pi * np.outer(b, b))
    np.testing.assert_allclose((root @ root.T)[:4, :4], expected, rtol=1e-8, atol=1e-12)
    assert not root[4:].any()
    assert not motion_of(CLOUGH.replace(at_rest=True)).start().any()
    joint = motion_of(CLOUGH)
    np.testing.assert_allclose(joint.start() @ joint.start().T, joint.covariance, rtol=1e-8, atol=1e-12)


def test_the_relaxation_time_knows_the_filter():
    body = {"a": il.LinearOscillator(damping=2.0, stiffness=100.0)}
    for time, expected in ((5.0, 5.0), (0.1, 1.0)):
        noise = il.OrnsteinUhlenbeckNoise(1.0, correlation_time=time)
        assert relaxation_time(Model.of(il.Network(body, None, {"a": noise}))) == pytest.approx(expected)
