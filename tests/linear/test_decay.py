"""Relaxation of linear motion on springs that vary, against exact moments and long products of matrices."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.decay import periodic, relaxation_time
from impactlab.simulation.growing_ensemble import request_of
from impactlab.step_control.rules.expected import Expected
from impactlab.step_control.rules.relaxation import growth_of

DAMPING, STIFFNESS, PUMP = 0.2, 4.0, 4.0
PERIOD = 2.0 * math.pi / PUMP


class PulsatingSpring(il.CouplingLaw):
    """Linear, with a force of its own, a damper that varies, and a frequency in hertz."""

    stiffness: float = il.parameter(units="N m-1", above=0.0)
    depth: float = il.parameter()
    frequency: float = il.parameter(units="Hz", above=0.0)

    @staticmethod
    def force(extension, rate, time, stiffness, depth, frequency):
        swing = depth * math.cos(2.0 * math.pi * frequency * time)
        return stiffness * (1.0 + swing) * extension + 0.1 * (1.0 - swing) * rate + 0.3


class SofteningSpring(PulsatingSpring):
    """Linear for small extensions only."""

    @staticmethod
    def force(extension, time, stiffness, depth, frequency):
        return stiffness * (1.0 + depth * math.cos(2.0 * math.pi * frequency * time)) * math.tanh(extension)


class TwiceSpring(PulsatingSpring):
    """Of the period of one frequency, a third of which is that of another field."""

    other: float = il.parameter(units="Hz")

    @staticmethod
    def force(extension, time, stiffness, frequency, other):
        return stiffness * (2.0 + math.cos(2.0 * math.pi * frequency * time)) * extension + 0.0 * other


class PoleSpring(PulsatingSpring):
    """Linear nowhere, and not defined at an extension of 1 m."""

    @staticmethod
    def force(extension, time, stiffness, frequency):
        return stiffness * math.cos(2.0 * math.pi * frequency * time) * extension / (1.0 - extension)


def pumped(depth, pump=PUMP, stiffness=STIFFNESS):
    return il.ParametricOscillator(depth, frequency=pump, mass=1.0, damping=DAMPING, stiffness=stiffness)


def network(depth=0.198, contacts=None, **others):
    return il.Network({"a": pumped(depth), **others}, contacts or {}, {"a": il.WhiteNoise(0.05)})


def alone(depth):
    return lambda t: np.array([[0.0, 1.0], [-STIFFNESS * (1.0 + depth * math.cos(PUMP * t)), -DAMPING]])


def decay(drift, period):
    """Relaxation time from the largest eigenvalue of a period's matrix, by an adaptive method."""
    ends = [solve_ivp(lambda t, y: drift(t) @ y, (0.0, period), one, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
            for one in np.eye(len(drift(0.0)))]  # fmt: skip
    return -period / math.log(np.abs(np.linalg.eigvals(np.array(ends).T)).max())


def test_a_body_alone_near_instability():
    found = relaxation_time(Model.of(network()))
    assert found == pytest.approx(decay(alone(0.198), PERIOD), rel=2e-3)
    assert found > 90.0 * 2.0 / DAMPING


def test_coupled_bodies_of_two_periods_and_a_law_of_ones_own():
    spring = PulsatingSpring(1.0, depth=0.5, frequency=2.0 * PUMP / (2.0 * math.pi))
    coupled = network(b=pumped(0.1, 1.5 * PUMP, 9.0)).replace(
        couplings={"k": il.Coupling("a", "b", il.LinearCoupling(0.2)), "p": il.Coupling("a", il.WALL, spring)}
    )

    def drift(t):
        swing = 0.5 * math.cos(2.0 * PUMP * t)
        a = STIFFNESS * (1.0 + 0.198 * math.cos(PUMP * t)) + 1.0 + swing
        b = 9.0 * (1.0 + 0.1 * math.cos(1.5 * PUMP * t))
        stiffness = np.array([[a + 0.2, -0.2], [-0.2, b + 0.2]])
        damping = np.diag([DAMPING + 0.1 * (1.0 - swing), DAMPING])
        return np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]])

    (motion,) = periodic(Model.of(coupled))
    assert motion.period == pytest.approx(2.0 * PERIOD)
    rate = -math.log(motion.multiplier) / motion.period
    assert 1.0 / rate == pytest.approx(decay(drift, 2.0 * PERIOD), rel=1e-6)
    assert motion.alone


def test_the_spin_up_waits_for_the_slowest_motion_of_a_linear_network():
    model = Model.of(network())
    expected = Expected.of(model, request_of(network(), 100.0))
    assert expected.spin_up == 12.0 * expected.relaxed.slowest == 12.0 * relaxation_time(model)


def test_what_varies_far_from_resonance_changes_nothing():
    still, aside = (network(a=pumped(depth, 0.8 * PUMP)) for depth in (0.0, 0.198))
    assert relaxation_time(Model.of(aside)) == relaxation_time(Model.of(still)) == pytest.approx(2.0 / DAMPING)


@pytest.mark.parametrize(
    "law",
    [
        SofteningSpring(STIFFNESS, depth=0.198, frequency=PUMP / (2.0 * math.pi)),
        PoleSpring(STIFFNESS, depth=0.0, frequency=1.0),
        il.LinearCoupling(1.0),
    ],
    ids=lambda law: type(law).__name__,
)
def test_only_linear_springs_of_a_common_period_count(law):
    body = il.LinearOscillator(mass=1.0, damping=DAMPING)
    soft = il.Network({"a": body}, {}, {"a": il.WhiteNoise(0.05)}, {"k": il.Coupling("a", il.WALL, law)})
    assert not periodic(Model.of(soft))
    apart = network(b=pumped(0.1, PUMP * math.sqrt(2.0)))
    apart = apart.replace(couplings={"k": il.Coupling("a", "b", il.LinearCoupling(0.2))})
    assert not periodic(Model.of(apart))


def test_the_period_is_that_of_the_force():
    law = TwiceSpring(STIFFNESS, depth=0.0, frequency=1.0, other=3.0)
    body = il.LinearOscillator(mass=1.0, damping=DAMPING)
    (motion,) = periodic(Model.of(il.Network({"a": body}, couplings={"k": il.Coupling("a", il.WALL, law)})))
    assert motion.period == 1.0


def test_growth_is_refused_where_nothing_limits_it():
    multiplier = math.exp(-PERIOD / decay(alone(0.3), PERIOD))
    assert multiplier > 1.05
    growing = (
        rf"'a' grows without end: its varying stiffness multiplies it by {multiplier:.6g} in each period of 1\.571 s"
    )
    with pytest.raises(il.InvalidInput, match=growing):
        Expected.of(Model.of(network(0.3)), request_of(network(0.3), 100.0))
    assert "grows without end" in str(network(0.3).check())
    for options in ({"initial": {}}, {"initial": "rest"}, {"spin_up": 0.0}):
        Expected.of(Model.of(network(0.3)), request_of(network(0.3), 100.0, **options))
    assert not growth_of(Model.of(network(0.198)))
    stopped = network(0.3, {"stop": il.Contact("a", il.WALL, il.LinearContact(100.0), clearance=1.0)})
    assert not growth_of(Model.of(stopped))
    Expected.of(Model.of(stopped), request_of(stopped, 100.0))


def test_a_network_that_contacts_may_limit_spins_up_or_says_what_it_takes():
    stop = {"stop": il.Contact("a", il.WALL, il.LinearContact(100.0), clearance=50.0)}
    model = Model.of(network(contacts=stop))
    with pytest.warns(il.AccuracyWarning, match=r"'a' is near parametric instability .* 9\.5e\+02 s\. Give spin_up="):
        expected = Expected.of(model, request_of(network(contacts=stop), 100.0))
    assert expected.relaxed.slowest > 900.0
    assert expected.spin_up == pytest.approx(120.0)
    long = Expected.of(model, request_of(network(contacts=stop), 1000.0))
    assert long.spin_up == pytest.approx(6.0 * 475.0, rel=1e-2)


@pytest.mark.full
def test_the_mean_square_near_instability():
    """By the affine map of the covariance over a period; realizations are the only samples."""
    depth = 0.19
    found = il.simulate(network(depth), 64.0 * PERIOD, realizations=512, rng=1)

    def right_side(t, y):
        p = y[:4].reshape(2, 2)
        a = alone(depth)(t)
        return [*(a @ p + p @ a.T + np.diag([0.0, 2.0 * math.pi * 0.05])).ravel(), p[0, 0]]

    def after(start):
        return solve_ivp(right_side, (0.0, PERIOD), [*start, 0.0], "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]

    offset = after(np.zeros(4))
    growth = np.stack([after(one) - offset for one in np.eye(4)], axis=1)[:4]
    exact = after(np.linalg.solve(np.eye(4) - growth, offset[:4]))[4] / PERIOD
    error = found.mean_square_displacement_standard_error.item()
    assert error < 0.1 * exact
    assert abs(found.mean_square_displacement.item() - exact) < 3.0 * error
