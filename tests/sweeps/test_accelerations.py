"""Absolute accelerations: against exact covariances, solutions of differential equations, and matrices."""

import json
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.results.dataset import CONFIGURATION

HOUSE = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.05, mass=3.0)
STIFF = il.LinearOscillator.from_frequency(9.0, 0.05)
SAMPLES = 0.02 * np.arange(300)
RECORD = 3.0 * np.random.default_rng(1).normal(size=300) * np.exp(-((SAMPLES - 2.0) ** 2))
GROUND = {"ground": il.BaseMotion(il.SampledForce(SAMPLES, RECORD))}
EVERY = il.Trajectory(0.02)
few = pytest.mark.filterwarnings("ignore:Too few independent samples")


@pytest.mark.parametrize("noise", [il.WhiteNoise(0.1), il.KanaiTajimi(1.0, 15.0, 0.6)], ids=["white", "Kanai-Tajimi"])
def test_mean_squares_under_noise_are_those_of_the_exact_covariance(noise):
    """``E[(k x + c v)²]/m²``, as x and v of one body are uncorrelated in a stationary motion."""
    network = il.Network({"house": HOUSE}, excitations={"ground": il.BaseMotion(noise)})
    found = il.absolute_acceleration(il.simulate(network, 50.0, realizations=256, rng=1, record=il.Trajectory(0.25)))
    squares = [
        factor**2 * il.exact(network).covariance("house", "house", quantity)
        for factor, quantity in ((HOUSE.stiffness / 3.0, "displacement"), (HOUSE.damping / 3.0, "velocity"))
    ]
    error = found.mean_square_absolute_acceleration_standard_error.item()
    assert error < 0.02 * sum(squares)
    assert found.mean_square_absolute_acceleration.item() == pytest.approx(sum(squares), abs=4.0 * error)


def test_white_noise_through_a_damper_has_the_known_mean_square():
    """``E[a²] = πSω(1 + 4ζ²)/2ζ`` of the absolute acceleration (Crandall and Mark, Random Vibration, 1963)."""
    network = il.Network({"house": HOUSE}, excitations={"ground": il.BaseMotion(il.WhiteNoise(0.1))})
    law = il.exact(network)
    found = (
        HOUSE.stiffness**2 * law.covariance("house", "house", "displacement")
        + HOUSE.damping**2 * law.covariance("house", "house", "velocity")
    ) / 9.0
    assert found == pytest.approx(np.pi * 0.1 * 2.0 * np.pi * (1.0 + 4.0 * 0.05**2) / 0.1, rel=1e-12)


def solved(slope, count, times):
    """States at the times, (time, state), from rest; the method never steps over a sample, where the record bends."""
    states = [np.zeros(count)]
    for span in pairwise(times):
        states.append(solve_ivp(slope, span, states[-1], "DOP853", rtol=1e-10, atol=1e-12).y[:, -1])
    return np.array(states)


def histories(network, times):
    """Relative accelerations by a Runge–Kutta method, with those of the ground added, (time, body)."""
    right, bodies = network.compile(), len(network.oscillators)
    states = solved(right.rhs, 2 * bodies, times)
    relative = np.array([right.rhs(t, y)[bodies:] for t, y in zip(times, states, strict=True)])
    return relative + np.interp(times, SAMPLES, RECORD)[:, None]


@pytest.mark.full
@pytest.mark.parametrize(
    "law",
    [pytest.param(il.HertzContact(1e5), marks=pytest.mark.campaign), il.HuntCrossleyContact(1e5, dissipation=0.5)],
    ids=["elastic", "with damping"],
)
def test_a_record_with_contact_against_a_solver(law):
    """Histories and peaks."""
    network = il.Network(
        {"house": HOUSE, "stiff": STIFF},
        {"gap": il.Contact("house", "stiff", law, clearance=0.005)},
        GROUND,
        {"spring": il.Coupling("house", "stiff", il.CubicCoupling(30.0))},
    )
    result = il.simulate(network, 3.0, step=2e-4, initial={}, record=EVERY)
    assert result.contact_force.max() > 1.0  # at a sample, where it is a good part of the largest acceleration
    found, expected = il.absolute_acceleration(result), histories(network, result.time.values)
    np.testing.assert_allclose(found.absolute_acceleration[0], expected, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_allclose(found.peak_absolute_acceleration, np.abs(expected).max(axis=0), rtol=1e-5)
    assert "peak_absolute_acceleration_standard_error" not in found


@pytest.mark.campaign
def test_laws_with_states_and_laws_that_depend_on_time():
    """A hysteretic storey and a body on a spring that varies, each against its equations."""
    bouc_wen = il.BoucWenCoupling(60.0, yield_displacement=0.02, ratio=0.1)
    network = il.Network(
        {"storey": il.LinearOscillator(mass=2.0, damping=0.5), "varying": il.ParametricOscillator(
            mass=1.0, damping=0.2, stiffness=40.0, depth=0.3, frequency=5.0)},
        excitations=GROUND, couplings={"columns": il.Coupling(il.WALL, "storey", bouc_wen)},
    )  # fmt: skip
    result = il.simulate(network, 5.0, step=2e-4, initial={}, record=EVERY)

    def slope(t, y):
        x, v, z, q, p = y
        ground = np.interp(t, SAMPLES, RECORD)
        growth = (1.0 - abs(z) * (0.5 * np.sign(v * z) + 0.5)) * v / 0.02
        storey = (-0.5 * v - 60.0 * (0.1 * x + 0.9 * 0.02 * z)) / 2.0 - ground
        return [v, storey, growth, p, -0.2 * p - 40.0 * (1.0 + 0.3 * np.cos(5.0 * t)) * q - ground]

    times = result.time.values
    moved = np.array([slope(t, y) for t, y in zip(times, solved(slope, 5, times), strict=True)])[:, [1, 4]]
    expected = moved + np.interp(times, SAMPLES, RECORD)[:, None]
    found = il.absolute_acceleration(result).absolute_acceleration[0]
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.full
@few
def test_structures_follow_their_matrices_and_given_forces_count():
    """``M⁻¹ (f − K x − C v)`` at the points of a structure with a full mass matrix, in all realizations."""
    mass, stiffness = np.array([[2.0, 0.3], [0.3, 1.0]]), np.array([[60.0, -20.0], [-20.0, 20.0]])
    damping = 0.02 * stiffness
    network = il.Network(
        {"frame": il.LinearStructure(mass, damping, stiffness)},
        excitations={"ground": il.BaseMotion(il.WhiteNoise(0.1)), "frame.2": il.Harmonic(0.7, frequency=3.0)},
    )
    result = il.simulate(network, 2.0, realizations=3, rng=1, record=EVERY)
    found = il.absolute_acceleration(result)
    x, v = (result[f"point_{name}"].values for name in ("displacement", "velocity"))
    force = np.array([0.0, 0.7]) * np.sin(3.0 * result.time.values)[:, None]
    expected = (force - x @ stiffness - v @ damping) @ np.linalg.inv(mass)
    np.testing.assert_allclose(found.point_absolute_acceleration, expected, rtol=1e-9, atol=1e-12)
    assert found.point_absolute_acceleration.dims == ("realization", "time", "point")
    one = il.absolute_acceleration(result.isel(realization=1))
    np.testing.assert_array_equal(one.absolute_acceleration[0], found.absolute_acceleration[1])


def test_a_body_at_rest_feels_gravity():
    network = il.Network({"house": HOUSE}, excitations={"gravity": il.BaseMotion(il.ConstantForce(9.80665))})
    rest = {"displacement": {"house": -9.80665 * HOUSE.mass / HOUSE.stiffness}}
    found = il.absolute_acceleration(il.simulate(network, 1.0, initial=rest, record=EVERY))
    np.testing.assert_allclose(found.absolute_acceleration, 9.80665, rtol=1e-9)


@pytest.mark.full
def test_many_times_are_looked_at_in_parts(monkeypatch):
    network = il.Network({"house": HOUSE, "stiff": STIFF}, excitations=GROUND)
    result = il.simulate(network, 5.0, initial={}, realizations=2, record=EVERY)
    whole = il.absolute_acceleration(result)
    monkeypatch.setattr("impactlab.sweeps.accelerations.ROWS_AT_A_TIME", 14)
    np.testing.assert_array_equal(il.absolute_acceleration(result).absolute_acceleration, whole.absolute_acceleration)


@few
def test_a_file_has_the_same(tmp_path):
    network = il.Network({"house": HOUSE}, excitations={"ground": il.BaseMotion(il.WhiteNoise(0.1))})
    result = il.simulate(network, 1.0, realizations=2, rng=1, record=EVERY)
    il.save(result, tmp_path / "run.nc")
    assert il.absolute_acceleration(tmp_path / "run.nc").identical(il.absolute_acceleration(result))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"excitations": {"house": il.WhiteNoise(0.1)}}, "'house', WhiteNoise, acts on bodies themselves"),
        ({"excitations": {"wind": il.Source(il.KanaiTajimi(1.0, 15.0, 0.6), on="house")}}, "'wind', KanaiTajimi, acts"),
        ({"contacts": {"stop": il.Contact("house", il.WALL, il.RigidContact(0.5))}}, "rigid contacts such as 'stop'"),
        (
            {"couplings": {"rub": il.Coupling("house", il.WALL, il.CoulombFrictionCoupling(0.1))}},
            "dry frictions that stick such as 'rub'",
        ),
        (
            {"oscillators": {"table": il.PrescribedMotion(il.Harmonic(0.1, frequency=3.0))}},
            "bodies of given motion such as 'table'",
        ),
    ],
)
def test_what_trajectories_do_not_tell_is_refused(change, message):
    network = il.Network({"house": HOUSE}, excitations=GROUND)
    result = il.simulate(network, 0.1, initial={}, record=EVERY)
    result.attrs[CONFIGURATION] = json.dumps({"network": network.replace(**change).to_dict()})
    with pytest.raises(il.InvalidInput, match=message):
        il.absolute_acceleration(result)


def test_runs_without_trajectories_are_refused():
    network = il.Network({"house": HOUSE}, excitations=GROUND)
    with pytest.raises(il.InvalidInput, match=r"record=il\.Trajectory"):
        il.absolute_acceleration(il.simulate(network, 0.1, initial={}))
