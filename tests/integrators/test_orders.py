"""The order of every integrator, measured path by path against DOP853."""

import functools

import numpy as np
import pytest
from impactlab_numerics.laws.oscillators import CubicDragOscillator
from laws import Cosine, LossyContact
from scenes import phases
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.linear.laws import lines_of
from impactlab.plan.seed import seed_of

NAMED = il.ExactFlow, il.RungeKutta4, il.EulerMaruyama


def concrete(cls=il.Integrator):
    """Return every integrator of the package that can be used with smooth forces."""
    usable = cls.order is not None and np.isfinite(cls.order)  # one that is exact takes no steps
    own = [cls] if usable and cls.__module__.startswith("impactlab.") else []
    return own + [item for child in cls.__subclasses__() for item in concrete(child)]


DUFFING = il.Network(
    {
        "a": il.DuffingOscillator(cubic=30.0, stiffness=4.0, damping=1.0),
        "b": il.DuffingOscillator(cubic=5.0, stiffness=9.0, damping=1.0, mass=2.0),
    }
)


def pair(law):
    bodies = {
        "a": il.LinearOscillator(stiffness=4.0, damping=1.0),
        "b": il.LinearOscillator(stiffness=9.0, damping=1.0, mass=2.0),
    }
    return il.Network(bodies, {"gap": il.Contact("a", "b", law, clearance=0.1)})


# eight starts, since the error of a path depends on where its collisions fall into the steps
STARTS = [
    {"displacement": {"a": -0.5 - 0.04 * k, "b": 0.3 + 0.03 * k}, "velocity": {"a": 1.0 + 0.1 * k}} for k in range(8)
]


def paths(network, initial, integrator, step, duration, interval):
    ds = il.simulate(
        network,
        duration,
        step=step,
        integrator=integrator,
        initial=initial,
        record=il.Trajectory(interval),
        rng=1,
    )
    return np.concatenate([ds.displacement.values[0], ds.velocity.values[0]], axis=1)


@functools.cache
def reference(network, start, duration, interval):
    """The path from a start, once for all integrators; phases of a run are found again from its stream."""
    compiled = network.compile()
    times = interval * np.arange(round(duration / interval) + 1)
    items, bodies = lines_of(compiled.model), len(compiled.model.bodies.names)
    phase = [phases(seed_of(1), item, 0, 0) for item in items]

    def rhs(t, y):
        slope = compiled.rhs(t, y)
        for item, angle in zip(items, phase, strict=True):
            force = item.amplitudes @ np.cos(item.frequencies * t + angle)
            slope[[bodies + body for body in item.bodies]] += force / compiled.model.mass[[*item.bodies]]
        return slope

    begin = compiled.state(**STARTS[start])
    return solve_ivp(rhs, (0.0, duration), begin, "DOP853", times, rtol=1e-12, atol=1e-13, max_step=0.02).y.T


def measured_order(network, integrator, steps, starts=2, duration=2.0, interval=0.25):
    """Slope of the largest error over time against the step, in the geometric mean over the first starts."""
    errors = np.empty((starts, len(steps)))
    for row in range(starts):
        expected = reference(network, row, duration, interval)
        for column, h in enumerate(steps):
            found = paths(network, STARTS[row], integrator, h, duration, interval)
            errors[row, column] = np.abs(found - expected).max()
    mean = np.log(errors).mean(axis=0)
    return float(np.polyfit(np.log(steps), mean, 1)[0]), np.exp(mean)


# order for smooth forces, for one Hertz contact, and the steps at which it shows
EXPECTED = {
    "ExactFlow": (3.0, 2.5, 0.25 / 2.0 ** np.arange(4, 9)),
    "WholeFlow": (3.0, 2.5, 0.25 / 2.0 ** np.arange(4, 9)),
    "FineFlow": (3.0, 2.5, 0.25 / 2.0 ** np.arange(4, 9)),
    "RungeKutta4": (4.0, 2.5, 0.25 / 2.0 ** np.arange(4, 9)),
    "EulerMaruyama": (1.0, 1.0, 0.25 / 2.0 ** np.arange(10, 14)),
}


def test_every_integrator_has_a_measured_order():
    assert {item.__name__ for item in concrete()} == set(EXPECTED)


pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")


@pytest.mark.parametrize("integrator", concrete())
def test_order_with_smooth_forces(integrator):
    smooth, _, steps = EXPECTED[integrator.__name__]
    assert smooth == integrator.order
    order, errors = measured_order(DUFFING, integrator(), steps)
    assert order == pytest.approx(smooth, abs=0.15), errors


@pytest.mark.full
@pytest.mark.parametrize("integrator", concrete())
def test_order_with_a_hertz_contact(integrator):
    _, hertz, steps = EXPECTED[integrator.__name__]
    order, errors = measured_order(pair(il.HertzContact(100.0)), integrator(), steps, len(STARTS))
    assert order == pytest.approx(hertz, abs=0.25), errors


@pytest.mark.full
@pytest.mark.parametrize("integrator", concrete())
def test_order_with_forces_that_depend_on_velocity(integrator):
    """Kicks by them are of second order."""
    smooth, _, steps = EXPECTED[integrator.__name__]
    expected = 2.0 if integrator.kicks else smooth
    network = il.Network({name: CubicDragOscillator(drag=0.5, stiffness=4.0, damping=0.5) for name in "ab"})
    order, errors = measured_order(network, integrator(), steps)
    assert order == pytest.approx(expected, abs=0.15), errors


@pytest.mark.campaign
def test_exact_flow_is_of_second_order_with_a_dissipative_contact():
    steps = EXPECTED["ExactFlow"][2]
    order, errors = measured_order(pair(LossyContact(100.0, damping=50.0)), il.ExactFlow(), steps, len(STARTS))
    assert order == pytest.approx(2.0, abs=0.25), errors


@pytest.mark.full
@pytest.mark.parametrize("integrator", concrete())
def test_order_with_a_given_force(integrator):
    expected, _, steps = EXPECTED[integrator.__name__]
    network = DUFFING.replace(excitations={"a": Cosine(2.0, frequency=5.0), "b": Cosine(-1.0, frequency=3.0)})
    order, errors = measured_order(network, integrator(), steps)
    assert order == pytest.approx(expected, abs=0.15), errors


@pytest.mark.full
@pytest.mark.parametrize("integrator", concrete())
@pytest.mark.parametrize("hertz", [False, pytest.param(True, marks=pytest.mark.campaign)], ids=["smooth", "Hertz"])
def test_order_with_bounded_noise(integrator, hertz):
    smooth, singular, steps = EXPECTED[integrator.__name__]
    noise = il.ShinozukaNoise(0.5, band=(0.0, 2.0), components=12)
    network = pair(il.HertzContact(100.0)) if hertz else DUFFING
    network = network.replace(excitations={"a": noise, "b": noise})
    order, errors = measured_order(network, integrator(), steps, len(STARTS) if hertz else 2)
    assert order == pytest.approx(singular if hertz else smooth, abs=0.25 if hertz else 0.15), errors
