"""Events of orbits under smooth forces over two parameters, against shooting with SciPy and closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import impactlab as il

pytestmark = pytest.mark.full


def cosine(amplitude, frequency):
    return il.Harmonic(amplitude=amplitude, frequency=frequency, phase=0.5 * math.pi)


def duffing(frequency, amplitude):
    return il.Network(
        oscillators={"a": il.DuffingOscillator(damping=0.1, stiffness=1.0, cubic=1.0)},
        excitations={"a": cosine(amplitude, frequency)},
    )


def stop(frequency, gap, law=None):
    return il.Network(
        oscillators={"a": il.LinearOscillator(damping=0.3, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, law or il.HertzContact(50.0), clearance=gap)},
        excitations={"a": cosine(1.0, frequency)},
    )


class VanDerPol(il.Oscillator):
    """An oscillator that sways by itself."""

    drive: float = il.parameter(units="kg s-1")

    @staticmethod
    def residual(displacement, velocity, drive):
        return drive * (displacement * displacement - 1.0) * velocity


def locked(amplitude, frequency):
    """The oscillator under a force that holds it at its frequency, if it is large enough."""
    return il.Network(
        oscillators={"a": VanDerPol(drive=0.3, stiffness=1.0)}, excitations={"a": cosine(amplitude, frequency)}
    )


def shooting(z, frequency, force, slope, amplitude, gap=math.inf):
    """Return what a period does to a state, and the derivatives of this; steps end where the contact comes and goes."""

    def rates(t, y):
        x, v = y[:2]
        matrix = np.array([[0.0, 1.0], slope(x, v)])
        return [v, force(x, v) + amplitude * math.cos(frequency * t), *(matrix @ y[2:].reshape(2, 2)).ravel()]

    def meets(t, y):
        return y[0] - gap

    meets.terminal = True
    now, end, y = 0.0, 2.0 * math.pi / frequency, np.concatenate([z, np.eye(2).ravel()])
    meets.direction = -1.0 if z[0] > gap else 1.0
    while now < end:
        events = meets if math.isfinite(gap) else None
        found = solve_ivp(rates, (now, end), y, method="DOP853", rtol=1e-12, atol=1e-13, events=events)
        now, y, meets.direction = found.t[-1], found.y[:, -1], -meets.direction
    return y[:2], y[2:].reshape(2, 2)


def start_of(curve, place):
    return np.array([curve["displacement"].values[place, 0], curve["velocity"].values[place, 0]])


def test_the_fold_of_a_hardening_oscillator():
    curve = il.continue_orbits(
        duffing, il.orbits(duffing(1.5, 0.3)), {"frequency": (1.3, 1.9)}, also={"amplitude": (0.2, 0.5)},
        bifurcation="fold", points=20,
    )  # fmt: skip
    assert curve["amplitude"].values.max() == 0.5
    np.testing.assert_allclose(np.abs(curve["multiplier_real"].values - 1.0).min(axis=1), 0.0, atol=1e-7)
    for place in range(0, curve.sizes["point"], 7):
        amplitude = float(curve["amplitude"][place])

        def left(u, amplitude=amplitude):
            end, matrix = shooting(
                u[:2], u[2], lambda x, v: -0.1 * v - x - x**3, lambda x, v: [-1.0 - 3.0 * x**2, -0.1], amplitude
            )
            return [*(end - u[:2]), np.linalg.det(matrix - np.eye(2))]

        frequency = float(curve["frequency"][place])
        known = fsolve(left, [*(1.001 * start_of(curve, place)), 0.9997 * frequency], xtol=1e-13)
        assert frequency == pytest.approx(known[2], rel=1e-10)


def test_the_flip_of_a_hertz_stop():
    """The period doubles where −1 is a multiplier by a solver that stops at the contact."""
    curve = il.continue_orbits(
        stop, il.orbits(stop(2.0, 0.0)), {"frequency": (1.8, 2.8)}, also={"gap": (-0.1, 0.1)}, bifurcation="flip",
        points=20,
    )  # fmt: skip
    assert curve["gap"].values[[0, -1]].tolist() == [-0.1, 0.1]
    for place in np.linspace(0, curve.sizes["point"] - 1, 3).astype(int):
        gap = float(curve["gap"][place])

        def left(u, gap=gap):
            end, matrix = shooting(
                u[:2], u[2],
                lambda x, v: -0.3 * v - x - 50.0 * max(x - gap, 0.0) ** 1.5,
                lambda x, v: [-1.0 - 75.0 * max(x - gap, 0.0) ** 0.5, -0.3],
                1.0, gap,
            )  # fmt: skip
            return [*(end - u[:2]), np.linalg.det(matrix + np.eye(2))]

        frequency = float(curve["frequency"][place])
        known = fsolve(left, [*(1.0001 * start_of(curve, place)), 0.9999 * frequency], xtol=1e-12)
        assert frequency == pytest.approx(known[2], rel=1e-7)


def test_grazing_of_a_hertz_stop_is_the_resonance_curve():
    curve = il.continue_orbits(
        stop, il.orbits(stop(0.5, 1.5)), {"frequency": (0.3, 0.9)}, also={"gap": (1.3, 2.0)}, bifurcation="grazing",
        points=20,
    )  # fmt: skip
    frequency, gap = curve["frequency"].values, curve["gap"].values
    assert gap[[0, -1]].tolist() == [1.3, 2.0]
    np.testing.assert_allclose(gap, 1.0 / np.abs(1.0 - frequency**2 + 0.3j * frequency), rtol=1e-8)
    assert not curve["impacts"].values.any()


def test_the_torus_of_a_forced_van_der_pol_oscillator():
    """Two multipliers are on the unit circle all along, by the derivatives of the flow."""
    curve = il.continue_orbits(
        locked, il.orbits(locked(0.5, 1.1)), {"amplitude": (0.35, 0.55)}, also={"frequency": (1.09, 1.11)},
        bifurcation="torus", points=5,
    )  # fmt: skip
    assert curve["frequency"].values.max() == 1.11
    place = curve.sizes["point"] // 2
    end, matrix = shooting(
        start_of(curve, place), float(curve["frequency"][place]), lambda x, v: 0.3 * (1.0 - x**2) * v - x,
        lambda x, v: [-1.0 - 0.6 * x * v, 0.3 * (1.0 - x**2)], float(curve["amplitude"][place]),
    )  # fmt: skip
    np.testing.assert_allclose(end, start_of(curve, place), atol=1e-9)
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(matrix)), 1.0, atol=1e-7)
