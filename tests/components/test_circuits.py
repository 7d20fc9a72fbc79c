"""Equations without masses: actuators with a lag, circuits that several bodies share, and driven ones, by laws."""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il


def lagged(value, before, after, part):
    """What follows a linear input with a lag, some part of the lag later."""
    left = math.exp(-part)
    mean = -math.expm1(-part) / part
    return left * value + (mean - left) * before + (1.0 - mean) * after


class Actuator(il.CouplingLaw):
    """Force that follows ``gain e`` with a lag."""

    gain: float = il.parameter(units="N m-1")
    lag: float = il.parameter(units="s", above=0.0)
    pull: float = il.state(0.0, units="N")
    last: float = il.state(0.0, units="m")

    @staticmethod
    def force(extension, pull):
        return pull

    @staticmethod
    def update(extension, elapsed, pull, last, gain, lag):
        if elapsed > 0.0:
            pull = lagged(pull, gain * last, gain * extension, elapsed / lag)
        return pull, extension


class DrivenCoil(il.CouplingLaw):
    """Moving coil of a circuit with a source: ``L i' + R i = θ e' + U cos(ω t)``, force ``θ i``."""

    transduction: float = il.parameter(units="N A-1")
    inductance: float = il.parameter(units="H", above=0.0)
    resistance: float = il.parameter(units="Ohm", above=0.0)
    voltage: float = il.parameter(units="V")
    frequency: float = il.parameter(units="rad s-1")
    current: float = il.state(0.0, units="A")
    last: float = il.state(0.0, units="m")

    @staticmethod
    def force(extension, transduction, current):
        return transduction * current

    @staticmethod
    def update(
        extension, elapsed, time, current, last, transduction, inductance, resistance, voltage, frequency
    ):  # fmt: skip
        if elapsed > 0.0:
            induced = transduction * (extension - last) / elapsed
            before = (induced + voltage * math.cos(frequency * (time - elapsed))) / resistance
            after = (induced + voltage * math.cos(frequency * time)) / resistance
            current = lagged(current, before, after, elapsed * resistance / inductance)
        return current, extension


BODY = il.LinearOscillator(mass=1.5, damping=0.2, stiffness=60.0)
SHARED = il.Combination({"first": 1.0, "second": -0.6})
NETWORK = il.Network(
    dict.fromkeys(["arm", "first", "second", "coil", "beam"], BODY)
    | {"charge": il.LinearOscillator(mass=0.4, damping=1.2)},  # an inductance and a resistance
    couplings={
        "actuator": il.Coupling(il.WALL, "arm", Actuator(25.0, lag=0.15)),
        "capacitor": il.Coupling(il.WALL, SHARED, il.PiezoelectricCoupling(3.0, capacitance=0.2, resistance=2.0)),
        "circuit": il.Coupling(
            il.WALL, "coil", DrivenCoil(2.0, inductance=0.3, resistance=1.5, voltage=4.0, frequency=9.0)
        ),
        "piezo": il.Coupling(il.Combination({"charge": 1.0, "beam": -3.0}), il.WALL, il.LinearCoupling(1.0 / 0.2)),
    },
)
START = {"arm": 0.1, "first": 0.2, "second": -0.1, "coil": 0.05, "beam": 0.1}
END = 2.0


@functools.cache
def found():
    options = {"step": 2e-4, "initial": {"displacement": START}, "integrator": il.ExactFlow(measured=False)}
    return il.simulate(NETWORK, END, record=il.Trajectory(END), **options).isel(time=-1, realization=0)


def exact(right_side, start):
    return solve_ivp(right_side, (0.0, END), start, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]


def pulled(x, v, force):
    return (force - 60.0 * x - 0.2 * v) / 1.5


def of_bodies(*names):
    return np.array(
        [found()[quantity].sel(oscillator=list(names)) for quantity in ("displacement", "velocity")]
    ).ravel()


def test_an_actuator_with_a_lag():
    x, v, pull = exact(lambda t, y: [y[1], pulled(y[0], y[1], -y[2]), (25.0 * y[0] - y[2]) / 0.15], [0.1, 0.0, 0.0])
    np.testing.assert_allclose(of_bodies("arm"), [x, v], atol=1e-6)
    assert float(found().law_state.sel(state="actuator.pull")) == pytest.approx(pull, abs=1e-5)


def test_a_circuit_that_two_bodies_share():
    """``C V' + V/R = Σ θ x'`` with the force −θ V on each, as a law along the weighted sum.

    It goes to the first displacements at once, for which the capacitor is charged.
    """

    def right_side(t, y):
        x1, x2, v1, v2, voltage = y
        change = (3.0 * v1 - 1.8 * v2 - voltage / 2.0) / 0.2
        return [v1, v2, pulled(x1, v1, -3.0 * voltage), pulled(x2, v2, 1.8 * voltage), change]

    end = exact(right_side, [0.2, -0.1, 0.0, 0.0, 3.0 * (0.2 + 0.6 * 0.1) / 0.2])
    np.testing.assert_allclose(of_bodies("first", "second"), end[:4], atol=1e-6)


def test_a_circuit_with_a_source():
    def right_side(t, y):
        return [y[1], pulled(y[0], y[1], -2.0 * y[2]), (2.0 * y[1] + 4.0 * math.cos(9.0 * t) - 1.5 * y[2]) / 0.3]

    np.testing.assert_allclose(of_bodies("coil"), exact(right_side, [0.05, 0.0, 0.0])[:2], atol=1e-6)


def test_a_charge_is_a_coordinate():
    """With an inductance it has a mass: ``L q'' + R q' + (q − θ x)/C = 0``, and ``θ (q − θ x)/C`` pulls the body."""

    def right_side(t, y):
        q, x, dq, v = y
        voltage = (q - 3.0 * x) / 0.2
        return [dq, v, (-voltage - 1.2 * dq) / 0.4, pulled(x, v, 3.0 * voltage)]

    end = exact(right_side, [0.0, 0.1, 0.0, 0.0])
    np.testing.assert_allclose(of_bodies("charge", "beam"), end, atol=1e-6)


def test_thermal_noise_of_a_resistor():
    """Of the spectral density ``R T/π`` it gives the charge, and the body, the temperature T: (q − 3x)²/C = T."""
    temperature = 0.01
    noises = {
        "charge": il.WhiteNoise(1.2 * temperature / math.pi), "beam": il.WhiteNoise(0.2 * temperature / math.pi)
    }  # fmt: skip
    bodies = {name: NETWORK.oscillators[name] for name in ("charge", "beam")}
    network = il.Network(bodies, {}, noises, {"piezo": NETWORK.couplings["piezo"]})
    law = il.exact(network)
    square = sum(
        one * other * law.covariance(first, second, "displacement")
        for first, one in (("charge", 1.0), ("beam", -3.0))
        for second, other in (("charge", 1.0), ("beam", -3.0))
    )
    assert square / 0.2 == pytest.approx(temperature, rel=1e-9)
