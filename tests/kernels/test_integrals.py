"""Integrals over pieces of motion in closed form, against quadrature of independent solutions."""

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.kernels.elementary import cosine_and_sine, faded
from impactlab.kernels.event_log import BEGAN, LOST_ENERGY, OF_IMPACT
from impactlab.kernels.from_event_to_event import GATHERED, PEAK, PRESSED, Span
from impactlab.located.course import Course
from impactlab.located.scenes import linear_of

NODES, SHARES = np.polynomial.legendre.leggauss(30)


def course_of(network, x, v, duration, logged=False):
    """Run a network from a state."""
    scene = linear_of(Model.of(network))
    ends = np.zeros(1), np.array([duration])
    course = Course(scene, np.array([x]), np.array([v]), *ends, np.zeros((1, 0)), Span(1e-10, True), logged=logged)
    course.run(lambda lane, contact: "")
    assert len(course.lanes.clock) == 1
    return course


def path(mass, damping, stiffness, load, wave, frequency, x, v, duration):
    """Return times, weights, displacements and velocities of ``M x'' + C x' + K x = p + f sin ωt`` at Gauss's nodes."""
    n = len(mass)
    drift = np.zeros((2 * n, 2 * n))
    drift[:n, n:], drift[n:, :n], drift[n:, n:] = np.eye(n), -stiffness / mass[:, None], -damping / mass[:, None]
    whole = block_diag(drift, np.zeros((1, 1)), [[0.0, frequency], [-frequency, 0.0]])
    whole[n : 2 * n, 2 * n], whole[n : 2 * n, 2 * n + 1] = load / mass, wave / mass
    panels = max(4, int(duration * np.abs(np.linalg.eigvals(whole)).max()))
    width, state = duration / panels, np.array([*x, *v, 1.0, 0.0, 1.0])
    flows = np.array([expm(0.5 * width * (1.0 + node) * whole) for node in NODES])
    states = []
    for _ in range(panels):
        states.append(flows @ state)
        state = expm(width * whole) @ state
    return np.tile(0.5 * width * SHARES, panels), np.concatenate(states)[:, : 2 * n]


def network(mass, damping, stiffness, coupling, load, wave, frequency, contacts=None):
    """Return bodies in a row, the first of which is driven."""
    names = [f"b{i}" for i in range(len(mass))]
    bodies = {
        name: il.LinearOscillator(mass=m, damping=c, stiffness=k)
        for name, m, c, k in zip(names, mass, damping, stiffness, strict=True)
    }
    forces = (
        {"load": il.Source(il.ConstantForce(1.0), on={names[i]: w for i, w in enumerate(load) if w})}
        if any(load)
        else {}
    )
    if wave:
        forces["b0"] = il.Harmonic(wave, frequency=frequency)
    couplings = {
        f"c{i}": il.Coupling(names[i], names[i + 1], il.LinearCoupling(coupling[0], damping=coupling[1]))
        for i in range(len(mass) - 1)
    }
    far = {"far": il.Contact("b0", il.WALL, il.LinearContact(1.0), clearance=1e9)}
    return il.Network(bodies, contacts or far, forces, couplings)


SCENES = {
    "undamped": ([2.0], [0.0], [3.0], (0.0, 0.0), [0.0], 0.0, 1.0),
    "constant force": ([2.0], [0.1], [3.0], (0.0, 0.0), [4.0], 0.7, 1.3),
    "near resonance": ([1.0], [0.0], [4.0], (0.0, 0.0), [0.0], 0.3, 2.0 + 1e-2),
    "close to resonance": ([1.0], [0.0], [4.0], (0.0, 0.0), [0.0], 0.3, 2.0 + 1e-4),
    "resonance": ([1.0], [1e-3], [4.0], (0.0, 0.0), [0.2], 0.3, 2.0),
    "free": ([1.5], [0.0], [0.0], (0.0, 0.0), [0.0], 0.0, 1.0),
    "free under forces": ([1.5], [0.0], [0.0], (0.0, 0.0), [-0.3], 0.8, 1.7),
    "free under a slow force": ([1.5], [0.0], [0.0], (0.0, 0.0), [0.2], 0.8, 0.02),
    "damped without a spring": ([1.0], [0.4], [0.0], (0.0, 0.0), [0.5], 0.8, 1.7),
    "overdamped": ([1.0], [5.0], [2.0], (0.0, 0.0), [0.5], 0.8, 1.7),
    "critical": ([1.0], [2.0], [1.0], (0.0, 0.0), [0.5], 0.8, 1.7),
    "almost critical": ([1.0], [1.99], [1.0], (0.0, 0.0), [0.5], 0.8, 1.7),
    "weak spring": ([1.0], [0.0], [1e-8], (0.0, 0.0), [0.5], 0.0, 1.0),
    "close modes": ([1.0, 1.0], [1e-3, 1e-3], [1.0, 1.0], (1e-5, 0.0), [0.0, 0.1], 0.5, 1.4),
    "free together": ([1.0, 2.0], [0.0, 0.0], [0.0, 0.0], (3.0, 0.1), [0.1, 0.0], 0.5, 1.4),
    "coupled by damping": ([1.0, 2.0], [0.3, 0.0], [5.0, 40.0], (3.0, 0.5), [0.1, 0.0], 0.5, 1.4),
    "fast and slow": ([1.0, 1e-2], [0.01, 0.002], [0.01, 100.0], (1.0, 0.0), [0.1, 0.0], 0.5, 1.4),
}


@pytest.mark.full
@pytest.mark.parametrize("duration", [1e-3, 0.3, 2.0, 25.0])
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_integrals_are_those_of_quadrature(scene, duration):
    mass, damping, stiffness, coupling, load, wave, frequency = scene
    n = len(mass)
    x, v = [0.3, -0.2][:n], [-0.5, 0.4][:n]
    sums = course_of(network(*scene), x, v, duration).lanes.bodies[0]
    pull = np.array([[1.0, -1.0], [-1.0, 1.0]]) if n == 2 else np.zeros((1, 1))
    matrices = [np.diag(own) + by * pull for own, by in ((damping, coupling[1]), (stiffness, coupling[0]))]
    forces = np.array(load), np.array([wave, 0.0][:n]), frequency
    weights, states = path(np.array(mass), *matrices, *forces, x, v, duration)
    dynamic = matrices[1] - frequency**2 * np.diag(mass) + 1j * frequency * matrices[0]
    swing = np.abs(np.linalg.solve(dynamic, forces[1])).max()  # of which paths are known to rounding
    for first, part, wave in ((0, slice(0, n), swing), (2, slice(n, 2 * n), frequency * swing)):
        size = np.abs(states[:, part]).max()
        means, squares = weights @ states[:, part], weights @ states[:, part] ** 2
        np.testing.assert_allclose(sums[first], means, rtol=0.0, atol=1e-13 * duration * (size + wave))
        np.testing.assert_allclose(sums[first + 1], squares, rtol=0.0, atol=1e-13 * duration * size * (size + wave))


def test_forces_of_contacts_have_their_impulse_and_largest_value():
    """Of a contact that stays closed, while two modes move it: the largest of many tops, and no end of a piece."""
    contact = {
        "pressed": il.Contact("b0", il.WALL, il.KelvinVoigtContact(30.0, damping=0.2, tension=True), clearance=-5.0)
    }
    scene = [1.0, 0.2], [0.02, 0.0], [1.0, 50.0], (8.0, 0.0), [0.0, 0.0], 3.0, 1.1
    x, v = [-4.2, -0.5], [0.5, 6.0]
    course = course_of(network(*scene, contact), x, v, 30.0, logged=True)
    assert len(course.events_of(0)) == 0
    damping, stiffness = np.diag([0.22, 0.0]), np.array([[39.0, -8.0], [-8.0, 58.0]])
    forces = np.array([-150.0, 0.0]), np.array([3.0, 0.0]), 1.1
    weights, states = path(np.array([1.0, 0.2]), damping, stiffness, *forces, x, v, 30.0)
    force = 30.0 * (states[:, 0] + 5.0) + 0.2 * states[:, 2]
    sums = course.lanes.contacts[0, :, 0]
    assert force.min() > 0.0
    np.testing.assert_allclose(sums[[PRESSED, GATHERED]], weights @ force, rtol=1e-12)
    power = force * states[:, 2]
    lost = sums[OF_IMPACT + LOST_ENERGY - BEGAN]
    assert lost == pytest.approx(weights @ power, rel=0.0, abs=1e-13 * (weights @ np.abs(power)))
    place = int(force.argmax())
    near = slice(place - 4, place + 5)
    parameter = np.linspace(-1.0, 1.0, 9)
    top = np.polynomial.Polynomial.fit(parameter, force[near], 8)
    places = top.deriv().roots()
    tops = [float(top(item.real)) for item in places if abs(item.imag) < 1e-9 and abs(item.real) < 1.0]
    assert sums[PEAK] == pytest.approx(max(tops), rel=1e-9)


def test_cosines_sines_and_exponentials_are_right_to_rounding():
    angles = np.concatenate([np.linspace(-30.0, 30.0, 601), np.linspace(1e5, 1e5 + 5.0, 101)])
    found = np.array([cosine_and_sine(angle) for angle in angles])
    np.testing.assert_allclose(found, np.stack([np.cos(angles), np.sin(angles)], axis=1), rtol=0.0, atol=3e-16)
    growths = np.linspace(0.0, 700.0, 1401)
    np.testing.assert_allclose([faded(growth) for growth in growths], np.exp(-growths), rtol=5e-16)
    assert faded(1e5) == 0.0
