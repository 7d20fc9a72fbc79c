"""The bundled coupling laws: paths against closed forms and against their own equations, solved independently."""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from scipy.special import beta, ellipk

import impactlab as il

ONE_STEP = il.ExactFlow(measured=False)
DURATION = 1.0
AWAY, SPEED = 0.3, 2.0  # starts of bodies on springs, and of those with dampers


def bilinear_period(law, amplitude):
    """Period of a unit mass, from the sine and the cosine of which a quarter is made."""
    k, outer, d = law.stiffness, law.outer_stiffness, law.break_extension
    fastest = math.sqrt(k * d**2 + 2.0 * k * d * (amplitude - d) + outer * (amplitude - d) ** 2)
    inside = math.asin(math.sqrt(k) * d / fastest) / math.sqrt(k)
    beyond = math.acos(k * d / outer / (amplitude - d + k * d / outer)) / math.sqrt(outer)
    return 4.0 * (inside + beyond)


def power_period(stiffness, exponent, amplitude):
    p = exponent + 1.0
    return 4.0 * math.sqrt(0.5 * p / stiffness) * beta(1.0 / p, 0.5) / p * amplitude ** (0.5 * (1.0 - exponent))


SOFTENING = il.BilinearCoupling(50.0, outer_stiffness=5.0, break_extension=0.1)
HARDENING = il.BilinearCoupling(20.0, outer_stiffness=90.0, break_extension=0.2)
SPRINGS = {
    "cubic": (il.CubicCoupling(300.0), 4.0 * ellipk(0.5) / math.sqrt(300.0) / AWAY),  # Nayfeh and Mook, section 2.1
    "power": (il.PowerLawCoupling(40.0, exponent=1.5), power_period(40.0, 1.5, AWAY)),
    "softening": (SOFTENING, bilinear_period(SOFTENING, AWAY)),
    "hardening": (HARDENING, bilinear_period(HARDENING, AWAY)),
}  # laws, and periods of a unit mass
DAMPERS = {
    "quadratic": (il.QuadraticDampingCoupling(3.0), SPEED / (1.0 + 3.0 * SPEED * DURATION)),
    "root": (il.PowerLawDampingCoupling(1.0, exponent=0.5), (math.sqrt(SPEED) - 0.5 * DURATION) ** 2),
    "square": (il.PowerLawDampingCoupling(3.0, exponent=2.0), SPEED / (1.0 + 3.0 * SPEED * DURATION)),
    "friction": (
        il.FrictionCoupling(2.2, velocity=0.2), 0.2 * math.asinh(math.sinh(SPEED / 0.2) * math.exp(-2.2 / 0.2))
    ),
}  # laws, and velocities after the time  # fmt: skip
SOLID = il.ZenerCoupling(12.0, relaxing_stiffness=20.0, damping=4.0)
CIRCUIT = il.PiezoelectricCoupling(0.7, capacitance=0.02, resistance=15.0)
SLIDER = il.JenkinsCoupling(30.0, slip_force=1.0)
HELD, PUSH = il.LinearOscillator(mass=1.5, damping=0.3, stiffness=10.0), il.Harmonic(5.0, frequency=9.0)


@functools.cache
def network():
    """A body for each law, so that all are compiled at once."""
    laws = {name: law for name, (law, _) in (SPRINGS | DAMPERS).items()}
    bodies = {name: il.LinearOscillator(mass=DURATION**2 / period**2) for name, (_, period) in SPRINGS.items()}
    bodies |= dict.fromkeys(DAMPERS, il.LinearOscillator())
    laws |= {"solid": SOLID, "circuit": CIRCUIT, "slider": SLIDER}
    pushed = dict.fromkeys(("solid", "circuit", "slider"), HELD)
    couplings = {name: il.Coupling(il.WALL, name, law) for name, law in laws.items()}
    return il.Network(bodies | pushed, {}, dict.fromkeys(pushed, PUSH), couplings)


@functools.cache
def path(step, slider=SLIDER):
    """Displacements and velocities after the time, and the states of laws, by label."""
    initial = {"displacement": dict.fromkeys(SPRINGS, AWAY), "velocity": dict.fromkeys(DAMPERS, SPEED)}
    options = {"initial": initial, "record": il.Trajectory(DURATION), "integrator": ONE_STEP}
    scene = network().replace(couplings={"slider": il.Coupling(il.WALL, "slider", slider)})
    result = il.simulate(scene, DURATION, step=step, **options).isel(realization=0, time=-1)
    names = [f"{name}.{what}" for what in "xv" for name in network().oscillators]
    numbers = [*result.displacement.values.tolist(), *result.velocity.values.tolist()]
    return dict(zip(names, numbers, strict=True)) | dict(
        zip(result.state.values.tolist(), result.law_state.values.tolist(), strict=True)
    )


STEP = 1.0 / 8192


@pytest.mark.full
@pytest.mark.parametrize("name", SPRINGS)
def test_springs_bring_a_body_back_after_a_period(name):
    assert path(STEP)[f"{name}.x"] == pytest.approx(AWAY, abs=1e-7)
    assert path(STEP)[f"{name}.v"] == pytest.approx(0.0, abs=1e-5)
    if name in ("cubic", "power"):
        coarse, fine = (abs(path(step)[f"{name}.v"]) for step in (16 * STEP, 8 * STEP))
        assert coarse / fine == pytest.approx(8.0, rel=0.1)


@pytest.mark.full
@pytest.mark.parametrize("name", DAMPERS)
def test_dampers_slow_a_free_body_as_their_closed_forms_say(name):
    exact = DAMPERS[name][1]
    coarse, fine = (path(step)[f"{name}.v"] - exact for step in (16 * STEP, 8 * STEP))
    assert coarse / fine == pytest.approx(4.0, rel=0.1)
    assert abs(path(STEP)[f"{name}.v"] - exact) < 1e-7


def right_side(t, y, pull, rate):
    """A body that is pushed, and the state of its law."""
    x, v, state = y
    force = 5.0 * math.sin(9.0 * t) - 0.3 * v - 10.0 * x - pull(x, state)
    return [v, force / 1.5, rate(v, state)]


OPTIONS = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}


@functools.cache
def exact(name):
    if name == "slider":
        return sliding(SLIDER.stiffness, SLIDER.slip_force, DURATION)
    pull, rate = {
        "solid": (lambda x, force: 12.0 * x + force, lambda v, force: 20.0 * (v - force / 4.0)),
        "circuit": (lambda x, volt: -0.7 * volt, lambda v, volt: (-0.7 * v - volt / 15.0) / 0.02),
    }[name]
    return solve_ivp(right_side, (0.0, DURATION), [0.0] * 3, args=(pull, rate), **OPTIONS).y[:, -1]


def sliding(stiffness, most, duration):
    """Path of a Jenkins element, whose slips begin and end at events."""

    def begins(t, y, *_):
        return most - abs(y[2])

    def ends(t, y, *_):
        return y[1]

    begins.terminal, begins.direction, ends.terminal = True, -1.0, True
    time, state, slips = 0.0, np.zeros(3), False
    while time < duration:
        rates = (lambda v, force: 0.0) if slips else (lambda v, force: stiffness * v)
        args, ends.direction = (lambda x, force: force, rates), -math.copysign(1.0, state[2])
        part = solve_ivp(
            right_side, (time, duration), state, args=args, events=ends if slips else begins, max_step=0.01, **OPTIONS
        )
        time, state = part.t[-1], part.y[:, -1].copy()
        state[2] = math.copysign(most, state[2]) if part.status == 1 else state[2]
        slips = part.status == 1 and not slips
    return state


def sticking(most, duration):
    """Displacement under Coulomb's friction, which may be anything up to `most` at rest."""

    def driving(t, x):
        return 5.0 * math.sin(9.0 * t) - 10.0 * x

    def slides(t, y, sign):
        return [y[1], (driving(t, y[0]) - 0.3 * y[1] - sign * most) / 1.5]

    def stops(t, y, sign):
        return y[1] * sign

    stops.terminal, stops.direction = True, -1.0
    time, x, rests = 0.0, 0.0, 0
    while True:
        grid = np.linspace(time, duration, 20_001)  # at rest: until the forces are larger than the friction
        beyond = [t for t in grid if abs(driving(t, x)) > most]
        if not beyond:
            return x, rests
        if beyond[0] > time:
            rests += 1
            time = brentq(
                lambda t, at=x: abs(driving(t, at)) - most, beyond[0] - grid[1] + grid[0], beyond[0], xtol=1e-15
            )
        sign = math.copysign(1.0, driving(time, x))
        part = solve_ivp(
            slides, (time, duration), [x, sign * 1e-14], args=(sign,), events=stops, max_step=0.01, **OPTIONS
        )
        time, x = part.t[-1], part.y[0, -1]
        if part.status == 0:
            return x, rests


@pytest.mark.full
def test_a_stiff_slider_is_friction_that_sticks():
    """Within what its ringing at rest, of up to F/sqrt(k m), may do; three rests of 3 N."""
    most = 3.0
    x, rests = sticking(most, DURATION)
    assert rests == 3
    for stiffness in (1e4, 1e6):
        off = path(STEP, il.JenkinsCoupling(stiffness, slip_force=most))["slider.x"] - x
        assert abs(off) < 0.1 * DURATION * most / math.sqrt(1.5 * stiffness)


@pytest.mark.campaign
def test_smooth_friction_of_a_small_velocity_is_nearly_friction_that_sticks():
    """At the automatic step: at rest it creeps less than its velocity scale, and slides as Coulomb's friction."""
    x, _ = sticking(3.0, DURATION)
    law = il.FrictionCoupling(3.0, velocity=1e-4)
    scene = il.Network({"a": HELD}, {}, {"a": PUSH}, {"f": il.Coupling(il.WALL, "a", law)})
    result = il.simulate(scene, DURATION, initial={}, record=il.Trajectory(DURATION))
    assert abs(result.displacement.isel(time=-1).item() - x) < 1e-4


MEMORY = {"solid": "pull", "circuit": "voltage", "slider": "pull"}


@pytest.mark.full
@pytest.mark.parametrize("name", MEMORY)
def test_laws_with_memory_follow_their_equations(name):
    """With the square of the step, and within 1e-6 at a fine one.

    The slider turns somewhere within a step, where it may lose a force of ``k |x''| h²/8``.
    """

    def off(step):
        found = path(step)
        return np.array([found[f"{name}.x"], found[f"{name}.{MEMORY[name]}"]]) - exact(name)[[0, 2]]

    errors = np.array([np.abs(off(step)).max() / step**2 for step in (128 * STEP, 16 * STEP, 4 * STEP)])
    if name == "slider":
        assert (errors < 30.0 * 10.0 / 8.0).all()
    else:
        np.testing.assert_allclose(errors, errors[-1], rtol=0.05)
    assert np.abs(off(STEP)).max() < 1e-6


def test_the_slider_sticks_and_slips():
    """Slow loops dissipate ``4 S (X − S/k)`` each, and below the force of slipping nothing is lost."""
    for amplitude in (0.02, 0.2):
        places = amplitude * np.sin(np.linspace(0.0, 6.0 * math.pi, 3001))
        pull, last, forces = 0.0, 0.0, []
        for place in places.tolist():
            pull, last = SLIDER.update(place, pull, last, 30.0, 1.0)
            forces.append(SLIDER.force(place, pull))
        lost = np.trapezoid(forces[-1001:], places[-1001:])
        assert lost == pytest.approx(4.0 * max(amplitude - 1.0 / 30.0, 0.0), abs=1e-5)


def test_what_the_circuit_takes_is_what_its_resistor_dissipates():
    """In steady harmonic motion, ``|v| = θ ω X R/sqrt(1 + (ω R C)²)``."""
    law, step = CIRCUIT, 2.0 * math.pi / 6.0 / 2000
    places = 0.1 * np.sin(6.0 * step * np.arange(20_001))
    voltage, last, values = 0.0, 0.0, []
    for place in places.tolist():
        voltage, last = law.update(place, step, voltage, last, 0.7, 0.02, 15.0)
        values.append(voltage)
    assert max(values[-2000:]) == pytest.approx(0.7 * 6.0 * 0.1 * 15.0 / math.hypot(1.0, 6.0 * 15.0 * 0.02), rel=1e-5)
    work = np.trapezoid(-0.7 * np.array(values[-2001:]), places[-2001:])
    assert work == pytest.approx(np.mean(np.square(values[-2000:])) / 15.0 * 2000 * step, rel=1e-4)


REFUSED = {
    "depends on the rate without noise": [law for law, _ in DAMPERS.values()],
    "depends on the past, by the states": [SLIDER],
}


@pytest.mark.parametrize("reason", REFUSED)
def test_no_exact_law_with_the_reason(reason):
    body = il.LinearOscillator(damping=1.0, stiffness=1.0)
    for law in REFUSED[reason]:
        network = il.Network({"a": body}, {}, {"a": il.WhiteNoise(1.0)}, {"own": il.Coupling("a", il.WALL, law)})
        with pytest.raises(il.NoExactReference, match=f"coupling 'own' .*{reason}"):
            il.exact(network)
        if law.dissipative:
            with pytest.raises(il.NoExactReference, match="without linear damping of its own, and no temperature"):
                il.exact(network.replace(oscillators={"a": body.replace(damping=0.0)}))


LAWS_UNDER_NOISE = {
    "quadratic": (il.QuadraticDampingCoupling(3.0), lambda v: abs(v) ** 3),
    "root": (il.PowerLawDampingCoupling(1.0, exponent=0.5), lambda v: abs(v) ** 1.5 / 1.5),
    "smooth friction": (il.FrictionCoupling(1.0, velocity=0.5), lambda v: 0.5 * math.log(math.cosh(v / 0.5))),
    "friction": (
        il.FrictionCoupling(1.0, velocity=2e-3),
        lambda v: abs(v) + 2e-3 * math.log1p(math.exp(-1e3 * abs(v))),
    ),
}  # dampers, and the integrals of their forces  # fmt: skip


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore:The two halves of the run differ")  # as the displacement diffuses
@pytest.mark.parametrize("name", LAWS_UNDER_NOISE)
def test_velocities_of_a_free_body_under_white_noise(name):
    """Their density is ``exp(−m G(v)/(π S))``, with the integral G of the force, at the automatic step."""
    law, integral = LAWS_UNDER_NOISE[name]
    mass, density = 1.5, 0.2

    def moment(power):
        options = {"points": [0.01, 0.1, 1.0], "limit": 500}
        return quad(lambda v: v**power * math.exp(-mass * integral(v) / (math.pi * density)), 0.0, 20.0, **options)[0]

    exact = moment(2) / moment(0)
    network = il.Network(
        {"a": il.LinearOscillator(mass=mass)}, {}, {"a": il.WhiteNoise(density)}, {"d": il.Coupling(il.WALL, "a", law)}
    )
    result = il.simulate(network, 400.0, realizations=8192, spin_up=50.0, initial="rest", rng=3)
    value, error = (float(result[f"mean_square_velocity{end}"].item()) for end in ("", "_standard_error"))
    assert error < 3e-3 * exact
    assert abs(value - exact) < 5e-3 * exact + 3.0 * error
