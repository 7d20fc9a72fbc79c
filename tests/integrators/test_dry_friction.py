"""Dry friction that sticks: slip, stick and release within steps, against closed forms and against `solve_ivp`."""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model

PLAIN = il.ExactFlow(measured=False)
SPRING, FRICTION = 4.0, 0.3
BODY = il.LinearOscillator(mass=1.0, damping=0.0, stiffness=SPRING)


def rubbing(*sides, friction=FRICTION, **fields):
    """A friction between two bodies, or of a body on the ground."""
    return il.Coupling(*(sides or ("a", il.WALL)), il.CoulombFrictionCoupling(friction, **fields))


def path(network, duration, step, displacement, velocity=0.0, interval=None):
    """One path from a state, with a sample after every step."""
    values = {"displacement": displacement, "velocity": velocity}
    initial = {name: item if isinstance(item, dict) else {"a": item} for name, item in values.items()}
    record = il.Trajectory(interval or step)
    result = il.simulate(network, duration, step=step, initial=initial, record=record, integrator=PLAIN)
    return result.time.values, result.displacement.values[0], result.velocity.values[0], result


@pytest.mark.full
@pytest.mark.parametrize("step", [0.01, 0.037])
def test_a_swing_loses_four_times_the_dead_zone_in_a_cycle_and_stops_in_it(step):
    """Half swings about ±F/k, until one ends where the spring is weaker than the friction; exact at any step."""
    time, x, v, _ = path(il.Network({"a": BODY}, couplings={"f": rubbing()}), 12.0, step, 1.0)
    dead, half = FRICTION / SPRING, 0.5 * math.pi
    turns = [1.0]
    while abs(turns[-1]) > dead:
        turns.append(-(turns[-1] - math.copysign(2.0 * dead, turns[-1])))
    swing = np.minimum((time / half).astype(int), len(turns) - 1)
    begin = np.array(turns)[swing]
    middle = np.where(swing < len(turns) - 1, np.copysign(dead, begin), begin)
    expected = middle + (begin - middle) * np.cos(2.0 * (time - swing * half))
    np.testing.assert_allclose(x[:, 0], expected, atol=1e-12)
    stopped = time > (len(turns) - 1) * half + step
    assert stopped.any()
    assert not v[stopped].any()
    assert abs(turns[2]) == pytest.approx(1.0 - 4.0 * FRICTION / SPRING)


class Belt:
    """The closed orbit of a body on a belt: it sticks until the spring breaks it away, and slips back."""

    friction, ratio, velocity = 1.0, 1.5, 0.2
    frequency = math.sqrt(SPRING)
    middle = friction / SPRING
    release = ratio * middle
    beyond = release - middle
    slip = 2.0 * (math.pi - math.atan2(beyond * frequency, velocity)) / frequency
    stick = 2.0 * beyond / velocity
    period = slip + stick

    def at(self, time):
        """Displacement some time after the release."""
        time = np.mod(time, self.period)
        swing = self.beyond * np.cos(self.frequency * time) + self.velocity / self.frequency * np.sin(
            self.frequency * time
        )
        held = -self.beyond + self.velocity * (time - self.slip)
        return self.middle + np.where(time < self.slip, swing, held)

    def network(self, **fields):
        law = {"friction": self.friction, "static_ratio": self.ratio, "velocity": self.velocity} | fields
        return il.Network({"a": BODY}, couplings={"f": rubbing(**law)})


@pytest.mark.full
@pytest.mark.parametrize("step", [0.05, 0.3])
def test_stick_slip_on_a_belt(step):
    belt = Belt()
    time, x, _, _ = path(belt.network(), 60.0, step, belt.release, belt.velocity)
    np.testing.assert_allclose(x[:, 0], belt.at(time), atol=1e-10)


@pytest.mark.full
def test_stick_slip_attracts_other_starts_and_its_mean_is_that_of_the_cycle():
    belt = Belt()
    time, x, v, _ = path(belt.network(), 60.0, 0.05, 0.0)
    held = int(np.flatnonzero((time > 30.0) & (np.abs(v[:, 0] - belt.velocity) < 1e-13))[0])
    begin = time[held] - belt.slip - (x[held, 0] - belt.middle + belt.beyond) / belt.velocity
    assert np.abs(x[held:, 0] - belt.at(time[held:] - begin)).max() < 1e-10
    cycle = np.linspace(0.0, belt.period, 200_001)
    result = il.simulate(
        belt.network(), 10.0 * belt.period, spin_up=30.0, step=belt.period / 1000.0, initial="rest", integrator=PLAIN
    )
    mean = np.trapezoid(belt.at(cycle), cycle) / belt.period
    assert float(result.mean_displacement[0]) == pytest.approx(mean, abs=1e-5)
    speed = np.gradient(belt.at(cycle), cycle)
    square = np.trapezoid(speed**2, cycle) / belt.period
    assert float(result.mean_square_velocity[0]) == pytest.approx(square, rel=1e-4)


def followed(rates, force, most, bodies, state, grid):
    """Integrate slip and stick piece by piece, with events; return displacements on a grid, and the number of stops.

    `rates(t, y, way)` are those of y = [x…, v…] while a friction acts against the way, 0 in stick; `force(t, y)` is
    that which would break a stick, and `bodies` are the masses, of which the first slips on the second.
    """
    time, y, way, stops = 0.0, np.array(state), None, 0
    found = np.empty((len(grid), len(bodies)))
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "dense_output": True, "max_step": 0.05}
    count = len(bodies)
    while time < grid[-1]:
        if way is None:
            pull = force(time, y)
            way = math.copysign(1.0, pull) if abs(pull) > most else 0.0

        def event(t, y, way, begin=time):
            if way == 0.0:
                return most - abs(force(t, y))
            return way * (y[count] - y[count + 1] if count > 1 else y[count]) if t > begin + 1e-7 else 1.0

        event.terminal, event.direction = True, -1
        piece = solve_ivp(rates, (time, grid[-1]), y, events=event, args=(way,), **options)
        inside = (grid >= time) & (grid <= piece.t[-1])
        found[inside] = piece.sol(grid[inside])[:count].T
        time, y = piece.t[-1], piece.y[:, -1].copy()
        if way == 0.0:
            way, stops = math.copysign(1.0, force(time, y)), stops + 1
        else:
            y[count:] = np.dot(bodies, y[count:]) / sum(bodies) if count > 1 else 0.0
            way = None
    return found, stops


PUSH, FREQUENCY = 1.0, 0.3
GRID = 0.1 * np.arange(601)


@functools.cache
def den_hartog(ratio, damping):
    """Den Hartog's oscillator with unit mass and spring, of friction 0.6: Trans. ASME 53 (1931) APM-53-9."""

    def rates(t, y, way):
        if way == 0.0:
            return [0.0, 0.0]
        return [y[1], PUSH * math.sin(FREQUENCY * t) - y[0] - damping * y[1] - way * 0.6]

    def force(t, y):
        return PUSH * math.sin(FREQUENCY * t) - y[0]

    return followed(rates, force, ratio * 0.6, [1.0], [0.3, 0.0], GRID)


@pytest.mark.parametrize(("ratio", "damping", "limit"), [(1.0, 0.0, 1e-8), (1.2, 0.05, 1e-6)])
def test_harmonic_force_with_stops(ratio, damping, limit):
    expected, stops = den_hartog(ratio, damping)
    assert stops >= 5
    body = il.LinearOscillator(mass=1.0, damping=damping, stiffness=1.0)
    couplings = {"f": rubbing(friction=0.6, static_ratio=ratio)}
    network = il.Network({"a": body}, {}, {"a": il.Harmonic(PUSH, frequency=FREQUENCY)}, couplings)
    errors = []
    for step in (0.1, 0.025, 0.00625):
        _, x, _, _ = path(network, 60.0, step, 0.3, interval=0.1)
        errors.append(np.abs(x - expected).max())
    assert errors[2] < limit
    assert errors[2] < errors[1] / 8.0
    assert errors[1] < errors[0] / 4.0


def test_friction_between_two_bodies():
    """They stick together and slip on each other; both have springs of their own."""
    masses = 1.0, 2.0

    def pushed(t, y):
        return math.sin(1.3 * t) - 0.1 * y[2] - y[0], -5.0 * y[1]

    def force(t, y):
        one, two = pushed(t, y)
        return one - masses[0] * (one + two) / sum(masses)

    def rates(t, y, way):
        one, two = pushed(t, y)
        friction = force(t, y) if way == 0.0 else way * 0.6
        return [y[2], y[3], (one - friction) / masses[0], (two + friction) / masses[1]]

    grid = 0.1 * np.arange(301)
    expected, stops = followed(rates, force, 0.72, masses, [0.5, 0.0, 0.0, 0.0], grid)
    assert stops >= 3
    bodies = {
        "a": il.LinearOscillator(mass=1.0, damping=0.1, stiffness=1.0),
        "b": il.LinearOscillator(mass=2.0, damping=0.0, stiffness=5.0),
    }
    couplings = {"f": rubbing("a", "b", friction=0.6, static_ratio=1.2)}
    network = il.Network(bodies, {}, {"a": il.Harmonic(1.0, frequency=1.3)}, couplings)
    start = {"a": 0.5, "b": 0.0}, {"a": 0.0, "b": 0.0}
    errors = [np.abs(path(network, 30.0, step, *start, interval=0.1)[1] - expected).max() for step in (0.025, 0.00625)]
    assert errors[1] < 3e-6
    assert errors[1] < errors[0] / 8.0


def kicked(ratio=1.3):
    """A body on a belt, on a spring of another one, which a harmonic force drives against a stop."""
    bodies = {name: il.LinearOscillator(mass=1.0, stiffness=spring) for name, spring in (("a", 1.0), ("b", 0.5))}
    couplings = {
        "spring": il.Coupling("a", "b", il.LinearCoupling(2.0)),
        "f": rubbing(static_ratio=ratio, velocity=0.1),
    }
    stop = {"stop": il.Contact("b", il.WALL, il.HertzContact(40.0), clearance=0.4)}
    return il.Network(bodies, stop, {"b": il.Harmonic(0.7, frequency=1.3)}, couplings)


@pytest.mark.full
def test_springs_and_contacts_that_kick_keep_the_second_order():
    start = {"a": 0.0, "b": 0.0}, {"a": 0.0, "b": 0.0}
    finest, *others = (path(kicked(), 20.0, 1.0 / n, *start, interval=0.1)[1] for n in (1280, 10, 20, 40, 80, 160))
    errors = [np.abs(x - finest).max() for x in others]
    assert np.polyfit(np.log([10, 20, 40, 80, 160]), np.log(errors), 1)[0] < -2.0
    assert errors[-1] < 5e-5


def test_what_sticks_does_not_move_while_others_do():
    """Neither its displacement nor its velocity, although its spring pulls more and less."""
    strong = rubbing(friction=5.0, velocity=0.0)
    network = kicked().replace(couplings={"f": strong})
    start = {"a": 0.2, "b": 0.0}, {"a": 0.0, "b": 0.0}
    _, x, v, _ = path(network, 20.0, 0.05, *start)
    assert np.ptp(x[:, 1]) > 0.5
    np.testing.assert_allclose(x[:, 0], 0.2, atol=1e-13)
    np.testing.assert_allclose(v[:, 0], 0.0, atol=1e-13)


@pytest.mark.full
def test_friction_takes_its_force_times_the_way_of_slip():
    """Of the energy of bodies, a spring between them and a contact, at the end of a decay."""
    bodies = {name: il.LinearOscillator(mass=1.0, stiffness=spring) for name, spring in (("a", 1.0), ("b", 0.5))}
    law, spring = il.HertzContact(40.0), 2.0
    couplings = {"spring": il.Coupling("a", "b", il.LinearCoupling(spring)), "f": rubbing(friction=0.05)}
    network = il.Network(bodies, {"stop": il.Contact("b", il.WALL, law, clearance=0.4)}, {}, couplings)
    _, x, v, _ = path(network, 10.0, 0.002, {"a": 0.9, "b": -0.4}, {"a": 0.0, "b": 0.0})
    depth = np.maximum(x[:, 1] - 0.4, 0.0)
    energy = 0.5 * (v**2).sum(axis=1) + 0.5 * x[:, 0] ** 2 + 0.25 * x[:, 1] ** 2
    energy += 0.5 * spring * (x[:, 1] - x[:, 0]) ** 2 + 0.4 * 40.0 * depth**2.5
    slid = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x[:, 0])))])
    assert slid[-1] > 3.0
    np.testing.assert_allclose(energy + 0.05 * slid, energy[0], atol=1e-5)


def test_a_run_goes_on_from_the_end_of_another():
    belt = Belt()
    start = {"displacement": {"a": belt.release}, "velocity": {"a": belt.velocity}}
    options = {"step": 0.05, "integrator": PLAIN}
    for duration in (2.0, belt.slip + 0.5 * belt.stick):
        first = il.simulate(belt.network(), duration, initial=start, record=il.FinalState(), **options)
        second = il.simulate(belt.network(), 20.0, initial=first, record=il.Trajectory(0.05), **options)
        since = first.attrs["duration"] + second.time.values
        np.testing.assert_allclose(second.displacement.values[0, :, 0], belt.at(since), atol=1e-10)


@pytest.mark.campaign
def test_realizations_side_by_side_are_those_alone():
    belt, starts = Belt(), [(0.375, 0.2), (0.0, 0.0), (0.3, 0.2), (-0.2, -0.4)]
    x, v = ({"a": list(values)} for values in zip(*starts, strict=True))
    together = il.simulate(
        belt.network(), 40.0, step=0.05, realizations=4, initial={"displacement": x, "velocity": v},
        record=il.Trajectory(0.05), integrator=PLAIN,
    )  # fmt: skip
    for number, start in enumerate(starts):
        _, alone, _, _ = path(belt.network(), 40.0, 0.05, *start)
        np.testing.assert_array_equal(together.displacement.values[number], alone)


def test_automatic_steps_and_checks():
    belt = Belt()
    check = belt.network().check()
    assert float(check.dataset.recommended_step.sel(integrator="ExactFlow")) == pytest.approx(0.15 / belt.frequency)
    assert "knows no dry frictions that stick such as 'f'" in str(
        check.dataset.refusal.sel(integrator="RungeKutta4").item()
    )
    result = il.simulate(belt.network(), 40.0, spin_up=20.0, initial="rest", integrator=il.ExactFlow())
    assert result.attrs["step"] <= 1.0 / belt.frequency
    with pytest.raises(il.InvalidInput, match="too large"):
        il.simulate(belt.network(), 40.0, step=2.0)


def test_forces_that_are_compiled_do_not_know_of_it():
    """It acts between kicks, so that the generated text is that of a network without it."""
    without = kicked().replace(couplings={"f": None})
    assert generate(Model.of(kicked()), True) == generate(Model.of(without), True)


def test_what_cannot_be_followed_is_refused():
    network = il.Network({"a": BODY, "b": BODY}, couplings={"f": rubbing("a", "b")})
    noisy = network.replace(excitations={"b": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match=r"noise acts on 'b'.*Use il\.FrictionCoupling there"):
        il.simulate(noisy, 1.0)
    twice = network.replace(couplings={"g": rubbing("b", il.WALL)})
    with pytest.raises(il.InvalidInput, match="'b' has two dry frictions that stick"):
        il.simulate(twice, 1.0, integrator=il.ExactFlow())
    with pytest.raises(il.InvalidInput, match=r"knows no dry frictions that stick such as 'f'; use il\.simulate"):
        network.compile()
    with pytest.raises(il.NoExactReference, match="depends on the rate"):
        il.exact(noisy)
    with pytest.raises(il.InvalidInput, match="static_ratio"):
        il.CoulombFrictionCoupling(1.0, static_ratio=0.9)
