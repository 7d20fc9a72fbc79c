"""Bodies with dry friction that sticks and rigid contacts, against closed forms and `solve_ivp`."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il

PLAIN = il.ExactFlow(measured=False)
FRICTION, RESTITUTION, DISTANCE = 0.5, 0.6, 1.0

each_step = pytest.mark.parametrize("step", [0.1, 0.025])


def network(masses, friction, contact, restitution=RESTITUTION, **fields):
    """Free bodies with a friction between two sides and a rigid contact of two sides."""
    bodies = {name: il.LinearOscillator(mass=mass, damping=0.0, stiffness=0.0) for name, mass in masses.items()}
    return il.Network(
        bodies,
        {"stop": il.Contact(*contact, il.RigidContact(restitution), clearance=DISTANCE)},
        couplings={"rub": il.Coupling(*friction, il.CoulombFrictionCoupling(FRICTION))},
        **fields,
    )


def run(scene, duration, step, velocity=None, interval=None, **options):
    """Displacements and velocities at the samples of one path, and its dataset."""
    result = il.simulate(
        scene, duration, step=step, initial={"velocity": velocity or {}}, record=il.Trajectory(interval or step),
        integrator=PLAIN, **options,
    )  # fmt: skip
    return result.displacement.values[0], result.velocity.values[0], result


@each_step
def test_a_block_slides_into_a_stop_and_back(step):
    """It arrives at ``v² = v₀² − 2Fd/m``, leaves at e v, and stops after ``(e v)² m/2F``; at any step."""
    mass, velocity, duration = 2.0, 3.0, 10.0
    scene = network({"a": mass}, ("a", il.WALL), ("a", il.WALL))
    x, v, result = run(scene, duration, step, {"a": velocity})
    slowing = FRICTION / mass
    speed = math.sqrt(velocity**2 - 2.0 * slowing * DISTANCE)
    arrival, rebound = (velocity - speed) / slowing, RESTITUTION * speed
    time = result.time.values
    back = np.clip(time - arrival, 0.0, rebound / slowing)
    ahead = velocity * time - 0.5 * slowing * time**2
    expected = np.where(time < arrival, ahead, DISTANCE - rebound * back + 0.5 * slowing * back**2)
    np.testing.assert_allclose(x[:, 0], expected, atol=1e-12)
    assert not v[time > arrival + rebound / slowing + step].any()
    assert result.contact_rate.item() * duration == pytest.approx(1.0)


@each_step
def test_a_block_at_rest_is_struck(step):
    """The other body goes on as it does without friction, which takes what the block has got."""
    light, heavy, velocity, duration = 1.0, 2.0, 3.0, 8.0
    scene = network({"light": light, "heavy": heavy}, ("heavy", il.WALL), ("light", "heavy"))
    x, v, _ = run(scene, duration, step, {"light": velocity})
    struck = (1.0 + RESTITUTION) * velocity * light / (light + heavy)
    rebound = velocity - struck * heavy / light
    there = DISTANCE + rebound * (duration - DISTANCE / velocity)
    np.testing.assert_allclose(x[-1], [there, 0.5 * struck**2 * heavy / FRICTION], atol=1e-12)
    np.testing.assert_allclose(v[-1], [rebound, 0.0], atol=1e-12)


@each_step
def test_the_load_of_a_carriage_that_hits_a_stop(step):
    """The load slides on until both have one velocity, that of their momentum after the impact."""
    carriage, load, velocity, duration = 1.0, 0.5, 1.0, 6.0
    scene = network({"carriage": carriage, "load": load}, ("carriage", "load"), ("carriage", il.WALL))
    x, v, _ = run(scene, duration, step, {"carriage": velocity, "load": velocity})
    arrival = DISTANCE / velocity
    sliding = (1.0 + RESTITUTION) * velocity / (FRICTION / carriage + FRICTION / load)
    together = (load - carriage * RESTITUTION) * velocity / (carriage + load)
    assert arrival + sliding < duration
    assert together < 0.0  # no second impact
    before = np.array([-RESTITUTION, 1.0]) * velocity * sliding
    bent = 0.5 * FRICTION * sliding**2 * np.array([1.0 / carriage, -1.0 / load])
    expected = DISTANCE + before + bent + together * (duration - arrival - sliding)
    np.testing.assert_allclose(x[-1], expected, atol=1e-12)
    np.testing.assert_allclose(v[-1], together, atol=1e-12)


@pytest.mark.filterwarnings("ignore:'stop' comes to rest by bouncing")
@each_step
def test_a_block_that_is_pushed_bounces_and_rests(step):
    """Friction slows it down before and after each impact: its speeds fall by ``e √((P − F)/(P + F))``."""
    push, mass, duration = 1.5, 1.0, 8.0
    scene = network({"a": mass}, ("a", il.WALL), ("a", il.WALL), excitations={"a": il.ConstantForce(push)})
    x, v, result = run(scene, duration, step)
    toward, away = (push - FRICTION) / mass, (push + FRICTION) / mass
    speed = math.sqrt(2.0 * toward * DISTANCE)
    ends, tops = [speed / toward], []
    for _ in range(60):
        rebound = RESTITUTION * speed
        tops.append(ends[-1] + rebound / away)
        speed = rebound * math.sqrt(toward / away)
        ends.append(tops[-1] + speed / toward)
    time = result.time.values
    first, second = (time > ends[0]) & (time < tops[0]), (time > tops[0]) & (time < ends[1])
    top = DISTANCE - 0.5 * away * (tops[0] - ends[0]) ** 2
    np.testing.assert_allclose(x[first, 0], top + 0.5 * away * (time[first] - tops[0]) ** 2, atol=1e-11)
    np.testing.assert_allclose(x[second, 0], top + 0.5 * toward * (time[second] - tops[0]) ** 2, atol=1e-11)
    resting = time > ends[-1] + 2.0 * step
    assert resting.any()
    np.testing.assert_allclose(x[resting, 0], DISTANCE, atol=1e-9)
    np.testing.assert_allclose(v[resting, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(result.contact_force.values[0, resting, 0], push - FRICTION, rtol=1e-6)


SPRING, DAMPING, STATIC, FORCE, RATE = 4.0, 0.1, 1.3, 3.0, 1.3


def driven():
    body = il.LinearOscillator(mass=1.0, damping=DAMPING, stiffness=SPRING)
    return il.Network(
        {"a": body},
        {"stop": il.Contact("a", il.WALL, il.RigidContact(RESTITUTION), clearance=0.5)},
        {"a": il.Harmonic(FORCE, frequency=RATE)},
        {"rub": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(FRICTION, static_ratio=STATIC))},
    )


def followed(duration, v):
    """Displacement and velocity of the driven body at the end, and the number of impacts and of rests, by `solve_ivp`.

    It is never at rest at the stop.
    """
    t, x, way, impacts, rests = 0.0, 0.0, 1.0, 0, 0
    while t < duration:
        begin, moving = t + 1e-9, way

        def slip(time, state, way=moving):
            force = FORCE * math.sin(RATE * time) - SPRING * state[0] - DAMPING * state[1]
            return [state[1], force - way * FRICTION]

        def stops(time, state, way=moving, begin=begin):
            return way * state[1] if time > begin else 1.0

        def hits(time, state, begin=begin):
            return state[0] - 0.5 if time > begin else -1.0

        stops.terminal = hits.terminal = True
        stops.direction, hits.direction = -1.0, 1.0
        path = solve_ivp(slip, (t, duration), [x, v], events=[stops, hits], rtol=1e-12, atol=1e-13, max_step=0.05)
        t, (x, v) = path.t[-1], path.y[:, -1]
        if path.t_events[1].size:
            v, way, impacts = -RESTITUTION * v, -1.0, impacts + 1
        elif path.t_events[0].size:
            v, rests = 0.0, rests + 1

            def pulled(time, x=x):
                return FORCE * math.sin(RATE * time) - SPRING * x

            while t < duration and abs(pulled(t)) <= STATIC * FRICTION:  # to the release, by steps and then exactly
                t += 1e-3
            low, high = t - 1e-3, t
            for _ in range(60 * (low > path.t[-1])):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if abs(pulled(middle)) > STATIC * FRICTION else (middle, high)
            t, way = high, math.copysign(1.0, pulled(high))
    return x, v, impacts, rests


def test_paths_converge_with_the_second_power_of_the_step():
    duration = 20.0
    x, v, impacts, rests = followed(duration, 1.0)
    assert impacts > 5
    assert rests > 5
    errors = []
    for step in (0.1, 0.0125):
        places, speeds, result = run(driven(), duration, step, {"a": 1.0}, interval=duration)
        errors.append(math.hypot(places[-1, 0] - x, speeds[-1, 0] - v))
        assert result.contact_rate.item() * duration == pytest.approx(impacts)
    assert errors[0] < 1e-4
    assert errors[1] < errors[0] / 8.0**2
