"""The bundled laws with states, against the equations of their publications, solved independently."""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

import impactlab as il

BODY = il.LinearOscillator(mass=1.5, damping=0.3, stiffness=10.0)
PULLED = {"displacement": {"a": 0.02}, "velocity": {"a": 0.1}}
ONE_STEP = il.ExactFlow(measured=False)


def end_of(law, step, method, duration=2.5):
    """Displacement after some time of a body that is held by a coupling and pushed."""
    network = il.Network({"a": BODY}, {}, {"a": il.Harmonic(5.0, frequency=3.0)}, {"h": il.Coupling(il.WALL, "a", law)})
    options = {"integrator": method, "initial": PULLED, "record": il.Trajectory(duration / 2.0)}
    return float(il.simulate(network, duration, step=step, **options).displacement.isel(time=-1).squeeze())


def solution(pull, rate, duration=2.5):
    """The same of its own equations: the pull of the law for x and its state, and the rate of that, for x, v, state."""

    def right_side(t, y):
        x, v, state = y
        force = 5.0 * math.sin(3.0 * t) - 0.3 * v - 10.0 * x - pull(x, state)
        return [v, force / 1.5, rate(x, v, state)]

    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "max_step": 4e-3}
    return solve_ivp(right_side, (0.0, duration), [0.02, 0.1, 0.0], **options).y[0, -1]


@pytest.mark.full
@pytest.mark.parametrize("method", [ONE_STEP, il.RungeKutta4()], ids=lambda item: type(item).__name__)
def test_maxwell_element_converges_with_the_square_of_the_step(method):
    law = il.MaxwellCoupling(20.0, damping=4.0, last=0.02)
    exact = solution(lambda x, force: force, lambda x, v, force: 20.0 * (v - force / 4.0))
    coarse, fine = (end_of(law, step, method) - exact for step in (0.01, 0.005))
    assert coarse / fine == pytest.approx(4.0, rel=0.02)
    assert abs(end_of(law, 1e-3, method) - exact) < 1e-6


def bouc_wen(law):
    k, d, a, n, b = law.stiffness, law.yield_displacement, law.ratio, law.exponent, law.shape

    def rate(x, v, z):
        return (v - (b * abs(v) * np.sign(z) + (1.0 - b) * v) * abs(z) ** n) / d

    return lambda x, z: k * (a * x + (1.0 - a) * d * z), rate


BOUC_WEN = il.BoucWenCoupling(30.0, yield_displacement=0.05, ratio=0.1, exponent=1.5, shape=0.6, last=0.02)


@functools.cache
def bouc_wen_path():
    return tuple(solution(*bouc_wen(BOUC_WEN), duration=duration) for duration in (0.5, 2.5))


@pytest.mark.campaign
@pytest.mark.parametrize("method", [ONE_STEP, il.RungeKutta4()], ids=lambda item: type(item).__name__)
def test_bouc_wen_hysteresis_follows_its_equation(method):
    """Until it turns back the error falls with the square of the step, or faster; it is small after many loops, too."""
    ahead, after = bouc_wen_path()
    coarse, fine = (abs(end_of(BOUC_WEN, step, method, 0.5) - ahead) for step in (0.025, 0.0125))
    assert fine < 0.27 * coarse or coarse < 1e-7
    assert abs(end_of(BOUC_WEN, 5e-4, method) - after) < 1e-6


def loop(law, amplitude, steps, cycles=3):
    """Energy of the last of some cycles of a sinusoidal extension, in a time of 2π s each (J)."""
    places = amplitude * np.sin(np.linspace(0.0, 2.0 * np.pi * cycles, cycles * steps + 1))
    kinematic, fields = law.arguments("update")
    own, of_force = law.arguments("force")
    values = {name: getattr(law, name) for name in law.field_names()}
    forces = []
    for place in places:
        values.update(extension=float(place), elapsed=2.0 * np.pi / steps)
        values.update(
            zip(law.state_names(), law.update(*(values[item] for item in (*kinematic, *fields))), strict=True)
        )
        forces.append(law.force(*(values[item] for item in (*own, *of_force))))
    return float(np.trapezoid(forces[-steps - 1 :], places[-steps - 1 :]))


def test_maxwell_element_dissipates_what_its_loss_modulus_says():
    """``π X² ω c / (1 + (ω c/k)²)`` in a cycle, here at 1 rad/s."""
    law = il.MaxwellCoupling(3.0, damping=2.0)
    exact = math.pi * 0.5**2 * 2.0 / (1.0 + (2.0 / 3.0) ** 2)
    assert loop(law, 0.5, 4000, cycles=6) == pytest.approx(exact, rel=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("exponent", [1.0, 2.0])
@pytest.mark.parametrize("shape", [0.3, 0.5, 1.0])
def test_bouc_wen_loop_dissipates_what_its_equation_says(exponent, shape):
    law = il.BoucWenCoupling(7.0, yield_displacement=0.1, ratio=0.2, exponent=exponent, shape=shape)
    pull, rate = bouc_wen(law)

    def right_side(t, y):
        x, v = 0.3 * math.sin(t), 0.3 * math.cos(t)
        return [rate(x, v, y[0]), pull(x, y[0]) * v]

    times = np.linspace(0.0, 6.0 * np.pi, 13)  # turning points among them
    state = np.zeros(2)
    energies = []
    for begin, end in zip(times[:-1] - 0.5 * np.pi, times[1:] - 0.5 * np.pi, strict=True):
        if end <= 0.0:
            continue
        part = solve_ivp(
            right_side, (max(begin, 0.0), end), state, method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.01
        )
        state = part.y[:, -1]
        energies.append(state[1])
    assert loop(law, 0.3, 4000) == pytest.approx(energies[-1] - energies[-5], rel=2e-5)


@pytest.mark.parametrize("shape", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("way", [-0.3, 0.02, 1.5])
def test_bouc_wen_of_exponent_one_is_exact(way, shape):
    """A short way goes as its equation says, and two ways in a row are one: that leaves one solution."""
    law = il.BoucWenCoupling(1.0, yield_displacement=0.1, shape=shape)

    def after(start, extension):
        return float(law.replace(hysteretic=start).evaluate(extension)) / 0.1

    for start in (-0.95, -0.4, -0.01, 0.3, 1.0):
        assert after(after(start, 0.3 * way), 0.7 * way) == pytest.approx(after(start, way), abs=1e-14)
        full = (shape * math.copysign(1.0, way * start) + 1.0 - shape) * abs(start)
        grown = after(start, 1e-6 * way) - start
        assert grown == pytest.approx(1e-5 * way * (1.0 - full), rel=1e-4, abs=1e-14)


def test_bouc_wen_saturates_from_wherever_it_began():
    law = il.BoucWenCoupling(2.0, yield_displacement=0.1, ratio=0.25, hysteretic=-1.0)
    assert law.evaluate([10.0, 1e9]).tolist() == pytest.approx([2.0 * (2.5 + 0.075), 2.0 * (0.25e9 + 0.075)], rel=1e-12)
    assert il.BoucWenCoupling(2.0, yield_displacement=0.1).evaluate(-5.0) == pytest.approx(-0.2, rel=1e-12)


@pytest.mark.full
def test_maxwell_element_under_white_noise_has_the_variances_of_a_linear_system():
    mass, damping, stiffness, spring, dashpot, density = 1.5, 0.3, 10.0, 20.0, 4.0, 0.2
    body = il.LinearOscillator(mass=mass, damping=damping, stiffness=stiffness)
    element = il.Coupling(il.WALL, "a", il.MaxwellCoupling(spring, damping=dashpot))
    network = il.Network({"a": body}, {}, {"a": il.WhiteNoise(density)}, {"m": element})
    matrix = [[0.0, 1.0, 0.0], [-stiffness / mass, -damping / mass, -1.0 / mass], [0.0, spring, -spring / dashpot]]
    covariance = solve_continuous_lyapunov(np.array(matrix), -np.diag([0.0, 2.0 * np.pi * density / mass**2, 0.0]))
    result = il.simulate(network, duration=100.0, realizations=256, step=0.01, rng=5)
    for name, exact in (("displacement", covariance[0, 0]), ("velocity", covariance[1, 1])):
        value, error = (float(result[f"mean_square_{name}{end}"].squeeze()) for end in ("", "_standard_error"))
        assert error < 0.01 * exact
        assert abs(value - exact) < 3.0 * error


def rebound(law, speed, step):
    """Velocity after an impact on a wall, over that before."""
    network = il.Network({"a": il.LinearOscillator(mass=1.0)}, {"w": il.Contact("a", il.WALL, law, clearance=0.1)})
    options = {"integrator": ONE_STEP, "initial": {"velocity": {"a": speed}}, "record": il.Trajectory(0.3)}
    return -float(il.simulate(network, 0.3, step=step, **options).velocity.isel(time=-1).squeeze()) / speed


@pytest.mark.campaign
@pytest.mark.parametrize("restitution", [1.0, 0.99, 0.9, 0.5])
def test_lankarani_nikravesh_contact_rebounds_as_its_equation_says(restitution):
    stiffness, speed = 1e5, 0.5

    def right_side(t, y):
        damping = 0.75 * (1.0 - restitution**2) * y[1] / speed
        return [y[1], -stiffness * max(y[0], 0.0) ** 1.5 * (1.0 + damping)]

    def opens(t, y):
        return y[0]

    opens.terminal, opens.direction = True, -1.0
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-14, "max_step": 1e-3, "events": opens}
    after = -solve_ivp(right_side, (0.0, 1.0), [0.0, speed], **options).y_events[0][0][1] / speed
    law = il.LankaraniNikraveshContact(stiffness, restitution=restitution)
    assert rebound(law, speed, 1e-4) == pytest.approx(after, abs=2e-6)
    if restitution >= 0.9:  # what the publication claims
        assert after == pytest.approx(restitution, abs=2.0 * (1.0 - restitution) ** 2 + 1e-9)


@pytest.mark.full
def test_restitution_does_not_depend_on_the_speed():
    law = il.LankaraniNikraveshContact(1e5, restitution=0.8)
    assert rebound(law, 1.0, 1e-4) == pytest.approx(rebound(law, 0.5, 1e-4), abs=5e-6)


@pytest.mark.full
def test_a_contact_that_is_closed_at_the_start_is_elastic_until_it_opens():
    law = il.LankaraniNikraveshContact(1e4, restitution=0.5, exponent=1.0)
    network = il.Network({"a": il.LinearOscillator()}, {"w": il.Contact("a", il.WALL, law, clearance=0.0)})
    options = {"integrator": ONE_STEP, "initial": {"displacement": {"a": 0.01}}, "record": il.Trajectory(0.05)}
    result = il.simulate(network, 0.05, step=1e-5, **options)
    assert float(result.velocity.isel(time=-1).squeeze()) == pytest.approx(-1.0, abs=1e-4)


def test_an_error_in_update_is_told_as_such():
    class Remembers(il.CouplingLaw):
        stiffness: float = il.parameter()
        largest: float = il.state(0.0)

        def force(extension, stiffness, largest):
            return stiffness * (extension - largest)

        def update(extension, elapsed, largest):
            return largest / (extension - extension)

    with pytest.raises(il.InvalidInput, match=r"ZeroDivisionError: in update: "):
        Remembers(1.0).call("force", 0.1, 0.0)
