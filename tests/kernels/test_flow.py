"""The exact flow against closed forms, quadrature, and its own algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from impactlab.integrators.arguments import Noise
from impactlab.kernels.flow import flow
from impactlab.linear.transitions import GAUSS, noise_columns, split_transition, transition

BODIES = {  # mass, damping, stiffness, density
    "underdamped": (2.0, 0.7, 30.0, 3.0),
    "critically damped": (0.5, 2.0 * np.sqrt(0.5 * 8.0), 8.0, 1.0),
    "overdamped": (1.5, 20.0, 4.0, 0.3),
    "undamped": (1.0, 0.0, 9.0, 2.0),
    "free and damped": (3.0, 0.8, 0.0, 5.0),
    "free": (0.7, 0.0, 0.0, 1.0),
    "without noise": (1.0, 0.5, 10.0, 0.0),
    "stiff": (1.0, 0.2 * 256 * np.pi, (256 * np.pi) ** 2, 16.0),
}


def one(body, step):
    a, q = transition(*(np.array([value]) for value in body), step)
    return a[0], q[0]


def closed_form(body, step):
    """The transition matrix by its formula, in complex arithmetic."""
    m, c, k, _ = body
    first, second = np.roots([1.0, c / m, k / m]).astype(complex)
    if abs(first - second) < 1e-6 * (abs(first) + 1e-300) or (c == 0.0 and k == 0.0):
        rate = -0.5 * c / m
        decay = np.exp(rate * step)
        return decay * np.array([[1.0 - rate * step, step], [-k / m * step, 1.0 + rate * step]])
    up, down = np.exp(first * step), np.exp(second * step)
    sine = (up - down) / (first - second)
    position = (first * down - second * up) / (first - second)
    return np.array([[position, sine], [-k / m * sine, position - c / m * sine]]).real


def quadrature(body, step):
    """∫₀^h a(s) a(s)ᵀ ds 2πS/m², a the response to a unit velocity."""
    m, c, k, density = body
    drift = np.array([[0.0, 1.0], [-k / m, -c / m]])
    panels = 1 + int(0.25 * step * (c / m + np.sqrt(k / m)))  # of 16 nodes each
    nodes, weights = np.polynomial.legendre.leggauss(16)
    width = step / panels
    times = (np.arange(panels)[:, None] + 0.5 * (nodes + 1.0)).ravel() * width
    response = expm(drift * times[:, None, None])[:, :, 1]
    return np.pi * density / m**2 * width * np.einsum("n,ni,nj->ij", np.tile(weights, panels), response, response)


@pytest.mark.parametrize("step", [1e-9, 1e-3, 0.3, 5.0])
@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_transition_is_the_closed_form(body, step):
    a, _ = one(body, step)
    expected = closed_form(body, step)
    # relative to the size that (x, ω x) has, not to elements that happen to be near zero
    scale = np.sqrt(max(body[2] / body[0], 1.0))
    weight = np.array([[1.0, scale], [1.0 / scale, 1.0]])
    np.testing.assert_allclose(a * weight, expected * weight, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("step", [1e-9, 1e-4, 0.02, 0.5])
@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_covariance_is_the_quadrature(body, step):
    _, q = one(body, step)
    expected = quadrature(body, step)
    off_diagonal = 1e-12 * np.sqrt(expected[0, 0] * expected[1, 1])  # it may cancel
    assert (np.abs(q - expected) <= 1e-9 * np.abs(expected) + off_diagonal * np.eye(2)[::-1]).all()


@pytest.mark.parametrize("step", [1e-9, 1e-6])
def test_short_steps_keep_their_relative_accuracy(step):
    """Q of a short step is 2πS/m² [[h³/3, h²/2], [h²/2, h]]; a difference of laws would lose it."""
    for body in BODIES.values():
        _, q = one(body, step)
        density = 2.0 * np.pi * body[3] / body[0] ** 2
        rate = body[1] / body[0] + np.sqrt(body[2] / body[0])
        expected = density * np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]])
        np.testing.assert_allclose(q, expected, rtol=2.0 * rate * step + 1e-13, atol=0.0)


@pytest.mark.parametrize("relaxation_times", [30.0, 1e3, 1e4])
@pytest.mark.parametrize("name", ["underdamped", "critically damped", "overdamped", "stiff"])
def test_long_steps_reach_the_stationary_law(name, relaxation_times):
    m, c, k, density = BODIES[name]
    slowest = -np.roots([1.0, c / m, k / m]).real.max()
    a, q = one(BODIES[name], relaxation_times / slowest)
    law = np.pi * density / c * np.array([1.0 / k, 1.0 / m])
    np.testing.assert_allclose(np.diag(q), law, rtol=1e-10)
    assert abs(q[0, 1]) < 1e-10 * np.sqrt(law.prod())
    assert np.abs(a).max() < 1e-8 * max(1.0, np.sqrt(k / m))


@pytest.mark.parametrize("relaxation_times", [10.0, 1e4])
def test_long_steps_of_a_damped_free_body_diffuse(relaxation_times):
    m, c, _, density = BODIES["free and damped"]
    step = relaxation_times * m / c
    a, q = one(BODIES["free and damped"], step)
    lost = -np.expm1(-relaxation_times)
    heat = np.pi * density / (m * c)
    spread = 2.0 * (m / c) ** 2 * (relaxation_times - lost) - (m / c) ** 2 * lost**2
    correlation, agitation = m / c * lost**2, -np.expm1(-2.0 * relaxation_times)
    expected = heat * np.array([[spread, correlation], [correlation, agitation]])
    np.testing.assert_allclose(q, expected, rtol=1e-9)
    np.testing.assert_allclose(a[0], [1.0, m / c * lost], rtol=1e-10)


bodies = st.tuples(
    st.floats(0.01, 100.0),
    st.one_of(st.just(0.0), st.floats(1e-3, 100.0)),
    st.one_of(st.just(0.0), st.floats(1e-3, 1e4)),
    st.one_of(st.just(0.0), st.floats(1e-6, 10.0)),
)


@pytest.mark.full
@settings(max_examples=40, deadline=None)
@given(body=bodies, first=st.floats(1e-6, 3.0), second=st.floats(1e-6, 3.0))
def test_two_steps_are_one(body, first, second):
    a_1, q_1 = one(body, first)
    a_2, q_2 = one(body, second)
    a, q = one(body, first + second)
    omega = np.sqrt(body[2] / body[0])
    units = np.array([max(omega, 1.0), 1.0])  # of displacements, so that all elements compare
    scale = units[:, None] / units
    np.testing.assert_allclose(a_2 @ a_1 * scale, a * scale, rtol=1e-9, atol=1e-9)
    size = units[:, None] * units
    largest = np.abs(q * size).max()
    np.testing.assert_allclose((q_2 + a_2 @ q_1 @ a_2.T) * size, q * size, rtol=1e-9, atol=1e-10 * largest)


def assert_stationary(body, a, q):
    """The linear law of a body is that after a step, too."""
    mass, damping, stiffness, density = body
    law = np.pi * density / damping * np.diag([1.0 / stiffness, 1.0 / mass])
    scale = np.sqrt(np.outer(np.diag(law), np.diag(law)))
    np.testing.assert_allclose((a @ law @ a.T + q) / scale, law / scale, rtol=1e-9, atol=1e-9)


@pytest.mark.full
@settings(max_examples=40, deadline=None)
@given(
    mass=st.floats(0.01, 100.0),
    ratio=st.floats(1e-3, 10.0),
    frequency=st.floats(0.1, 1e3),
    density=st.floats(1e-3, 10.0),
    step=st.floats(1e-4, 10.0),
)
def test_the_linear_law_is_stationary(mass, ratio, frequency, density, step):
    body = (mass, 2.0 * ratio * frequency * mass, mass * frequency**2, density)
    assert_stationary(body, *one(body, step))


@pytest.mark.parametrize("step", [1e-9, 1e-3, 0.3, 50.0])
def test_noise_columns_are_a_cholesky_factor(step):
    _, q = transition(*np.array(list(BODIES.values())).T, step)
    (l_xx, l_vx), (zero, l_vv) = noise_columns(q).transpose(0, 2, 1)
    assert (zero == 0.0).all()
    np.testing.assert_allclose(l_xx**2, q[:, 0, 0], rtol=1e-14, atol=0.0)
    np.testing.assert_allclose(l_xx * l_vx, q[:, 0, 1], rtol=1e-14, atol=0.0)
    np.testing.assert_allclose(l_vx**2 + l_vv**2, q[:, 1, 1], rtol=1e-14, atol=0.0)
    without = list(BODIES).index("without noise")
    assert (noise_columns(q)[:, without] == 0.0).all()


@pytest.mark.parametrize("place", [*GAUSS, 0.0, 0.5, 1.0])
@pytest.mark.parametrize("step", [1e-6, 0.01, 0.3])
def test_noise_at_one_moment_needs_one_normal(place, step):
    _, q = split_transition(*np.array(list(BODIES.values())).T, step, place)
    column, rest = noise_columns(q)
    assert (rest == 0.0).all()
    np.testing.assert_allclose(np.einsum("bi,bj->bij", column, column), q, rtol=1e-7, atol=1e-12 * np.abs(q).max())


@given(
    mass=st.floats(0.01, 100.0),
    ratio=st.floats(1e-3, 10.0),
    frequency=st.floats(0.1, 1e3),
    density=st.floats(1e-3, 10.0),
    step=st.floats(1e-4, 10.0),
    place=st.floats(0.0, 1.0),
)
def test_the_linear_law_is_stationary_under_the_split_flow(mass, ratio, frequency, density, step, place):
    body = (mass, 2.0 * ratio * frequency * mass, mass * frequency**2, density)
    assert_stationary(body, *(part[0] for part in split_transition(*np.array([body]).T, step, place)))


@pytest.mark.parametrize("place", GAUSS)
def test_the_split_flow_is_the_exact_one_to_second_order(place):
    """Both flows of a cycle of two steps, whose places are symmetric, against the exact one."""
    bodies = np.array(list(BODIES.values())).T

    def error(step):
        a, q = transition(*bodies, 2.0 * step)
        (first, noise), (second, later) = (split_transition(*bodies, step, node) for node in (place, 1.0 - place))
        both = second @ noise @ second.transpose(0, 2, 1) + later
        return np.array([np.abs(second @ first - a).max(), np.abs(both - q).max()])

    np.testing.assert_allclose(np.log2(error(1e-4) / error(5e-5)), 3.0, atol=0.1)  # of third order in one cycle


def test_the_flow_to_the_middle_is_a_part_of_the_flow():
    bodies = np.array(list(BODIES.values())).T
    undamped = bodies.copy()
    undamped[1] = undamped[3] = 0.0
    half, _ = transition(*undamped, 0.05)
    for place in GAUSS:
        middle, noise = split_transition(*bodies, 0.1, place, until=0.5)
        whole = split_transition(*bodies, 0.1, place)
        if place < 0.5:
            np.testing.assert_allclose(half @ middle, whole[0], rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(half @ noise @ half.transpose(0, 2, 1), whole[1], rtol=1e-10, atol=1e-12)
        else:
            np.testing.assert_allclose(middle, half, rtol=1e-12, atol=1e-12)
            assert (noise == 0.0).all()


def test_equal_bodies_get_equal_numbers_in_their_order():
    listed = [BODIES["underdamped"], BODIES["free"], BODIES["underdamped"]]
    a, q = transition(*np.array(listed).T, 0.1)
    for row, body in enumerate(listed):
        np.testing.assert_array_equal(a[row], one(body, 0.1)[0])
        np.testing.assert_array_equal(q[row], one(body, 0.1)[1])


@pytest.mark.parametrize("column", [0, 3])
def test_kernel_applies_the_transition_and_leaves_the_wall(column):
    """Bodies with one row of noise, with two, and without; the second row of body 3 is the last."""
    bodies = np.array(list(BODIES.values())).T
    a, q = transition(*bodies, 0.1)
    amplitude = np.zeros((2, 2, 4))
    amplitude[1] = noise_columns(q)[[0, 0, 0, 1], [1, 3, 4, 3]].T
    rng = np.random.default_rng(1)
    x, v = rng.normal(size=(2, len(a) + 1, 5))
    scale, normals = rng.uniform(size=(2, 4)), rng.normal(size=(4, 4, 5)).astype(np.float32)
    rows = np.array([1, 3, 4, 3])
    runs = np.array([[0, -1, 1], [1, 0, 1], [2, -1, 1], [3, 1, 2], *([5 + k, -1, 1] for k in range(len(a) - 5))])
    streams, realizations = np.zeros((3, 4), np.uint64), np.arange(5, dtype=np.uint32)
    none = np.zeros((4, 0, 0), np.float32)
    noise = Noise(rows, runs, 3, amplitude, streams, realizations, scale, False, none, rows[:0], none)
    before = np.stack([x, v], axis=1).copy()
    coefficients = np.stack([np.full((4, len(a)), np.nan), a.reshape(-1, 4).T])
    result = x.copy()
    flow(coefficients, 1, noise, 1, normals[column], x, v, result)
    expected = np.einsum("bij,bjl->bil", a, before[:-1])
    for row, body in enumerate(noise.bodies):
        expected[body] += np.outer(amplitude[1, :, row], scale[1, row] * normals[column, row].astype(float))
    np.testing.assert_allclose(result[:-1], expected[:, 0], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(v[:-1], expected[:, 1], rtol=1e-13, atol=1e-12)
    np.testing.assert_array_equal([result[-1], v[-1]], before[-1])
    np.testing.assert_array_equal(x, before[:, 0])
