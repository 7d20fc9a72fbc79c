"""A spring whose stiffness varies: Mathieu's boundary by Floquet's theory, and moments by Lyapunov's equation."""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import impactlab as il

FREQUENCY, DAMPING, PUMP = 10.0, 0.05, 19.0
PERIOD = 2.0 * math.pi / PUMP


def body(depth):
    return il.ParametricOscillator.from_frequency(FREQUENCY, DAMPING, mass=1.5, depth=depth, frequency=PUMP)


def matrix(time, depth):
    return np.array([[0.0, 1.0], [-(FREQUENCY**2) * (1.0 + depth * math.cos(PUMP * time)), -2.0 * DAMPING * FREQUENCY]])


def largest(monodromy):
    return float(np.abs(np.linalg.eigvals(monodromy)).max())


@functools.cache
def floquet(depth):
    """Displacements and velocities after a period from (1, 0) and (0, 1), in the columns."""
    ends = [
        solve_ivp(lambda t, y: matrix(t, depth) @ y, (0.0, PERIOD), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        for start in np.eye(2)
    ]
    return np.array(ends).T


BOUNDARY = brentq(lambda depth: largest(floquet(depth)) - 1.0, 0.1, 0.5, xtol=1e-10)


@pytest.mark.full
def test_the_boundary_of_stability():
    """Bodies on both sides of it go through a period from two starts each."""
    depths = (BOUNDARY * (1.0 - 1e-3), BOUNDARY * (1.0 + 1e-3))
    bodies = {f"{depth} {start}": body(depth) for depth in depths for start in ("place", "speed")}
    begin = {
        "displacement": {name: 1.0 for name in bodies if name.endswith("place")},
        "velocity": {name: 1.0 for name in bodies if name.endswith("speed")},
    }
    method = il.ExactFlow(measured=False)
    end = il.simulate(
        il.Network(bodies), PERIOD, step=PERIOD / 400, initial=begin, integrator=method, record=il.Trajectory(PERIOD)
    ).isel(time=-1, realization=0)
    found = [
        np.array([end[quantity].sel(oscillator=[f"{depth} place", f"{depth} speed"]) for quantity in begin])
        for depth in depths
    ]
    for monodromy, depth in zip(found, depths, strict=True):
        np.testing.assert_allclose(monodromy, floquet(depth), atol=1e-4 * np.abs(floquet(depth)).max())
    low, high = (largest(monodromy) - 1.0 for monodromy in found)
    assert low < 0.0 < high
    limit = depths[0] - low * (depths[1] - depths[0]) / (high - low)
    assert limit == pytest.approx(BOUNDARY, rel=1e-4)


@pytest.mark.full
def test_moments_under_noise():
    """Means over two periods from rest, within three standard errors of the equation of the covariance."""
    depth, noise = 0.8 * BOUNDARY, 0.2
    network = il.Network({"a": body(depth)}, excitations={"a": il.WhiteNoise(noise)})
    found = il.simulate(network, 2.0 * PERIOD, spin_up=8.0 * PERIOD, initial="rest", realizations=4096, rng=2)

    def right_side(t, y):
        covariance, a = y[:4].reshape(2, 2), matrix(t, depth)
        change = a @ covariance + covariance @ a.T + np.diag([0.0, 2.0 * np.pi * noise / 1.5**2])
        return [*change.ravel(), *(float(t >= 0.0) * np.diag(covariance))]

    begin = solve_ivp(right_side, (-8.0 * PERIOD, -1e-15), np.zeros(6), rtol=1e-10, atol=1e-14).y[:, -1]
    exact = solve_ivp(right_side, (0.0, 2.0 * PERIOD), begin, rtol=1e-10, atol=1e-14).y[4:, -1] / (2.0 * PERIOD)
    for name, value in zip(("displacement", "velocity"), exact, strict=True):
        mean, error = (float(found[f"mean_square_{name}{kind}"].squeeze()) for kind in ("", "_standard_error"))
        assert error < 0.03 * value
        assert abs(mean - value) < 3.0 * error


def test_there_is_no_stationary_law():
    network = il.Network({"a": body(0.1)}, excitations={"a": il.WhiteNoise(1.0)})
    with pytest.raises(il.NoExactReference, match="residual force of 'a' depends on time"):
        il.exact(network)
