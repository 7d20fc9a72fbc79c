"""A rotor in a round clearance: paths against their equations, and means against quadratures."""

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import impactlab as il

MASS = np.array([[2.0, 0.5], [0.5, 1.0]])
DAMPING = np.diag([2.0, 1.0])
STIFFNESS = np.array([[800.0, 50.0], [50.0, 400.0]])
CENTER = np.array([0.01, -0.005])


def in_a_casing():
    """A rotor that spins and rubs in a flexible casing: the rotor's bodies are its modes, masses differ."""
    bodies = {
        "rotor": il.LinearStructure(MASS, DAMPING, STIFFNESS, names=("x", "y")),
        "x": il.LinearOscillator(mass=3.0, damping=5.0, stiffness=2000.0),
        "y": il.LinearOscillator(mass=4.0, damping=5.0, stiffness=1500.0),
    }
    rub = il.RoundContact(
        ("rotor.x", "rotor.y"), ("x", "y"), il.HuntCrossleyContact(3e5, dissipation=0.1), clearance=0.05,
        center=tuple(CENTER), friction_coefficient=0.2, friction_velocity=0.3, surface_velocity=2.0,
    )  # fmt: skip
    return il.Network(bodies, {"rub": rub})


def acceleration(q, v, p, w):
    """The same in x and y, written by hand; p and w are displacements and velocities of the casing."""
    place, speed = q - p - CENTER, v - w
    r = math.hypot(*place)
    radial = place / r
    across = np.array([-radial[1], radial[0]])
    normal = 3e5 * max(r - 0.05, 0.0) ** 1.5 * max(1.0 + 0.1 * (radial @ speed), 0.0)
    push = -normal * radial - 0.2 * normal * math.tanh((across @ speed + 2.0) / 0.3) * across
    of_rotor = np.linalg.solve(MASS, push - STIFFNESS @ q - DAMPING @ v)
    return of_rotor, (-push - np.array([2000.0, 1500.0]) * p - 5.0 * w) / np.array([3.0, 4.0])


def path_errors(duration, steps):
    """Largest errors of displacements at the end of a path that begins in contact."""

    def slope(t, state):
        q, v, p, w = state.reshape(4, 2)
        of_rotor, of_casing = acceleration(q, v, p, w)
        return np.concatenate([v, of_rotor, w, of_casing])

    begin = np.array([0.07, 0.0, 0.1, 3.0, 0.0, 0.0, 0.0, 0.0])
    end = solve_ivp(slope, (0.0, duration), begin, "DOP853", rtol=1e-11, atol=1e-13, max_step=1e-3).y[:, -1]
    start = {"displacement": {"rotor.x": 0.07}, "velocity": {"rotor.x": 0.1, "rotor.y": 3.0}}
    for step in steps:
        ds = il.simulate(
            in_a_casing(), duration, step=step, integrator=il.ExactFlow(measured=False), initial=start,
            record=il.Trajectory(duration), realizations=1, rng=1,
        )  # fmt: skip
        rotor = ds.point_displacement.values[0, -1] - end[:2]
        casing = ds.displacement.sel(oscillator=["x", "y"]).values[0, -1] - end[4:6]
        yield np.abs([rotor, casing]).max()


@pytest.mark.campaign
def test_paths_of_a_spinning_rotor_that_rubs():
    """ExactFlow is of second order in contact, as under all forces that depend on velocities."""
    errors = np.array(list(path_errors(0.02, (1e-3, 5e-4, 2.5e-4))))
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.1)
    (several_contacts,) = path_errors(0.12, (5e-4,))
    assert several_contacts < 1e-5


def in_a_stator(law=None, clearance=0.05, density=0.0):
    """A rotor in isotropic bearings, with noise or without."""
    damping = math.pi * density  # the temperature is 1
    shaft = il.LinearStructure([1.0, 1.0], damping * np.eye(2), 400.0 * np.eye(2), names=("x", "y"))
    names = "rotor.x", "rotor.y"
    rub = il.RoundContact(names, il.WALL, law or il.LinearContact(1e4), clearance=clearance)
    return il.Network({"rotor": shaft}, {"rub": rub}, {name: il.WhiteNoise(density) for name in names if density})


@pytest.mark.full
def test_without_friction_angular_momentum_is_kept():
    """To rounding, whatever the step: all forces pass through the center.

    It is looked at where the rotor flies freely, and its velocity is read without an estimate of a force's change.
    """
    start = {"displacement": {"rotor.x": 0.03}, "velocity": {"rotor.x": 2.0, "rotor.y": 2.0}}
    ds = il.simulate(
        in_a_stator(), 10.0, step=2e-3, integrator=il.ExactFlow(measured=False), initial=start,
        record=il.Trajectory(0.01), realizations=1, rng=1,
    )  # fmt: skip
    (x, y), (v, w) = ds.displacement.values[0].T, ds.velocity.values[0].T
    free = np.hypot(x, y) < 0.045
    assert 100 < free.sum() < 900
    np.testing.assert_allclose((x * w - y * v)[free], 0.03 * 2.0, rtol=1e-10)


@pytest.mark.campaign
def test_means_against_radial_quadrature():
    """E[r²], contact ratio, mean force and rate of the density ``r exp(−U(r)/T)``, and E[v²] = T/m."""
    stiffness, clearance = 1e4, 0.05

    def weight(r):
        return r * math.exp(-200.0 * r * r - 0.5 * stiffness * max(r - clearance, 0.0) ** 2)

    def integral(function, begin):
        return quad(lambda r: function(r) * weight(r), begin, 0.25, epsrel=1e-10)[0]

    total = quad(weight, 0.0, clearance)[0] + integral(lambda r: 1.0, clearance)
    square = (quad(lambda r: r * r * weight(r), 0.0, clearance)[0] + integral(lambda r: r * r, clearance)) / total
    exact = {
        "contact_ratio": integral(lambda r: 1.0, clearance) / total,
        "mean_contact_force": integral(lambda r: stiffness * (r - clearance), clearance) / total,
        "contact_rate": weight(clearance) / total / math.sqrt(2.0 * math.pi),
    }
    ds = il.simulate(in_a_stator(density=4.0 / math.pi), 100.0, realizations=256, rng=3)
    error = ds.mean_square_displacement_standard_error
    assert abs(ds.mean_square_displacement.sum() - square) < 3.0 * float(np.hypot(*error)) + 5e-4 * square
    assert float(np.hypot(*error)) < 3e-3 * square
    for name, value in exact.items():
        error = ds[f"{name}_standard_error"].item()
        assert 0.0 < error < 5e-3 * value, name
        assert abs(ds[name].item() - value) < 3.0 * error + 1e-3 * value, name
    velocity, error = ds.mean_square_velocity, ds.mean_square_velocity_standard_error
    assert (abs(velocity - 1.0) < 3.0 * error + 5e-4).all()
    assert ds.peak_contact_force.max() > 10.0 * exact["mean_contact_force"]


@pytest.mark.campaign
def test_automatic_step_resolves_friction():
    """A rotor that rubs under noise, against a quarter of its step."""
    network = in_a_stator(il.HertzContact(1e5), density=4.0 / math.pi)
    rub = network.contacts["rub"].replace(friction_coefficient=0.2, friction_velocity=0.05)
    network = network.replace(contacts={"rub": rub})
    coarse = il.simulate(network, 100.0, realizations=256, rng=3)
    fine = il.simulate(network, 100.0, realizations=256, rng=3, step=0.25 * coarse.step)
    assert float(fine.mean_square_velocity.mean()) < 0.9  # friction cools
    for name in ("mean_square_displacement", "mean_square_velocity", "contact_ratio", "contact_rate"):
        error = np.hypot(coarse[f"{name}_standard_error"], fine[f"{name}_standard_error"])
        assert (abs(coarse[name] - fine[name]) < 3.0 * error + 5e-3 * fine[name]).all(), name
