"""Dry friction from event to event, against closed forms and a solver that shares no code."""

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import fsolve
from test_motion import course_of

import impactlab as il
from impactlab.kernels.contact_states import HELD, SLIPS_DOWN, SLIPS_UP, STICKS

EXACT = il.EventLocated()
WAYS = {STICKS: 0, SLIPS_UP: 1, SLIPS_DOWN: -1}


def on_ground(friction=3.0, excitations=None, body=None, contacts=None, **options):
    law = il.CoulombFrictionCoupling(friction, **options)
    return il.Network(
        {"a": body or il.LinearOscillator(mass=2.0, stiffness=50.0)},
        contacts or {},
        excitations or {},
        {"f": il.Coupling("a", il.WALL, law)},
    )


def test_an_amplitude_falls_by_the_same_in_each_half_cycle_until_the_body_sticks():
    course = course_of(on_ground(), 12.0, x=(1.0,), interval=math.pi / 5.0, samples=20)
    amplitudes = 1.0 - 0.12 * np.arange(9)  # 2 F/k
    np.testing.assert_allclose(course.lanes.samples[0, :9, 0], amplitudes * (-1.0) ** np.arange(9), atol=1e-13)
    events = course.events_of(0)
    np.testing.assert_allclose(events[-8:, 0], math.pi / 5.0 * np.arange(1, 9), atol=1e-13)
    assert events[-1, 3] == STICKS  # k 0.04 is less than F
    assert course.lanes.x[0, 0] == pytest.approx(0.04, abs=1e-13)
    assert course.lanes.v[0, 0] == 0.0


def test_a_body_on_a_belt_sticks_and_slips_as_the_closed_form_says():
    speed, friction, ratio, rate = 0.4, 3.0, 1.6, 5.0
    course = course_of(on_ground(friction, static_ratio=ratio, velocity=speed), 40.0, x=(0.0,), v=(speed,))
    events = course.events_of(0)
    begins, ends = events[events[:, 2] == STICKS, 0], events[events[:, 3] == STICKS, 0]
    beyond = (ratio - 1.0) * friction / 50.0
    slip = 2.0 * (math.pi - math.atan(beyond * rate / speed)) / rate
    assert len(events) > 50
    np.testing.assert_allclose(begins[0], ratio * friction / 50.0 / speed, rtol=1e-13)
    np.testing.assert_allclose(ends - begins[: len(ends)], slip, rtol=1e-11)
    np.testing.assert_allclose(begins[1:] - ends[: len(begins) - 1], 2.0 * beyond / speed, rtol=1e-11)


def test_a_driven_body_moves_as_den_hartog_has_it():
    """Without stops: J. P. Den Hartog, Trans. ASME 53 (1931) 107."""
    ratio, force, friction = 1.3, 10.0, 3.0  # of the frequencies
    frequency = 5.0 * ratio
    body = il.LinearOscillator(mass=2.0, stiffness=50.0, damping=1e-3)  # the free motion must end, slowly
    network = on_ground(friction, {"a": il.Harmonic(force, frequency=frequency)}, body)
    period = 2.0 * math.pi / frequency
    course = course_of(network, 4000.0 * period, interval=period / 200.0, samples=800001)
    largest = np.abs(course.lanes.samples[0, -4000:, 0]).max()
    angle = math.pi / ratio
    magnified, rubbed = 1.0 / (1.0 - ratio**2), math.sin(angle) / (1.0 + math.cos(angle)) / ratio
    expected = math.sqrt((force / 50.0 * magnified) ** 2 - (friction / 50.0 * rubbed) ** 2)
    assert largest == pytest.approx(expected, rel=2e-3)  # damping of the body alone, and samples


def test_a_driven_body_with_two_stops_in_each_cycle():
    """Slip of half a cycle from rest at −x to rest at x as two equations for the times at which it begins and ends."""
    mass, stiffness, friction, force, frequency = 2.0, 50.0, 4.0, 6.0, 2.0
    rate, half = math.sqrt(stiffness / mass), math.pi / frequency
    answer = force / (stiffness - mass * frequency**2)

    def slipping(begin, time):
        place = (friction - force * math.sin(frequency * begin)) / stiffness  # where k place is the limit
        x0 = -place - answer * math.sin(frequency * begin) + friction / stiffness
        v0 = -answer * frequency * math.cos(frequency * begin)
        angle = rate * (time - begin)
        x = x0 * math.cos(angle) + v0 / rate * math.sin(angle)
        v = v0 * math.cos(angle) - rate * x0 * math.sin(angle)
        x += answer * math.sin(frequency * time) - friction / stiffness
        return place, x, v + answer * frequency * math.cos(frequency * time)

    def closed(times):
        place, x, v = slipping(*times)
        return [x - place, v]

    network = on_ground(friction, {"a": il.Harmonic(force, frequency=frequency)})
    events = course_of(network, 60.0 * half).events_of(0)
    upwards = events[:, 3] == SLIPS_DOWN  # the friction's own coordinate is the negative of the body's
    begin = events[upwards & (events[:, 2] == STICKS), 0][-2]
    end = events[(events[:, 3] == STICKS) & (events[:, 0] > begin), 0][0]
    assert end - begin < 0.9 * half
    np.testing.assert_allclose((begin, end), fsolve(closed, (begin + 0.01, end - 0.01), xtol=1e-13), atol=1e-9)


class Stick:
    """Networks with friction and stops by plain matrices, and a search for their events by small steps."""

    def __init__(self, bodies, rubbing, stops, frequency, between):
        """Bodies are rows of mass, stiffness, damping, amplitude, x, v; stops of clearance, stiffness, restitution."""
        self.mass, self.stiffness, self.damping, self.amplitude, self.x, self.v = np.array(bodies).T
        self.between, self.frequency = between, frequency
        self.rubbing = [sides for sides, _ in rubbing]
        self.friction, self.breakaway, self.surface = np.array([numbers for _, numbers in rubbing]).T
        self.stops = [body for body, _ in stops]
        self.clearance, self.hard, self.restitution = np.array([numbers for _, numbers in stops]).reshape(-1, 3).T
        self.rigid = self.restitution > 0.0

    @classmethod
    def drawn(cls, seed):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 4))
        least, most = [0.3, 0.5, 0.0, 0.5, -0.5, -0.7], [3.0, 6.0, 0.4, 3.0, 0.5, 0.7]
        bodies = rng.uniform(least, most, (n, 6)) * [[1.0, 1.0, draw, 1.0, 1.0, 1.0] for draw in rng.integers(0, 2, n)]
        one, other = (*rng.permutation(n).tolist(), -1)[:2]
        rubbing = []
        for sides in ((one, other if rng.integers(0, 2) else -1), (other, -1))[:n]:
            friction, ratio, moves = (
                rng.uniform(0.2, 1.0),
                (1.0 if n > 1 else rng.choice([1.0, 1.4])),
                rng.integers(0, 2),
            )
            rubbing.append((sides, (friction, ratio * friction, moves * rng.uniform(-0.4, 0.4))))
        stops = [
            (
                int(rng.integers(0, n)),
                rng.uniform([0.5, 10.0, 0.5], [0.9, 200.0, 0.95]) * [1.0, 1.0, rng.integers(0, 2)],
            )
            for _ in range(int(rng.integers(0, 3)))
        ]
        return cls(
            bodies, rubbing, stops, rng.uniform(0.4, 3.0), rng.uniform(0.5, 4.0, n - 1) * rng.integers(0, 2, n - 1)
        )

    def network(self):
        n = len(self.mass)
        names = [f"b{i}" for i in range(n)]
        bodies = {
            names[i]: il.LinearOscillator(mass=self.mass[i], stiffness=self.stiffness[i], damping=self.damping[i])
            for i in range(n)
        }
        couplings = {
            f"c{i}": il.Coupling(names[i], names[i + 1], il.LinearCoupling(k)) for i, k in enumerate(self.between)
        }
        for i, (one, other) in enumerate(self.rubbing):
            law = il.CoulombFrictionCoupling(
                self.friction[i], static_ratio=self.breakaway[i] / self.friction[i], velocity=self.surface[i]
            )
            couplings[f"f{i}"] = il.Coupling(names[one], il.WALL if other < 0 else names[other], law)
        contacts = {
            f"g{i}": il.Contact(
                names[body], il.WALL,
                il.RigidContact(self.restitution[i]) if self.rigid[i] else il.LinearContact(self.hard[i]),
                clearance=self.clearance[i],
            )
            for i, body in enumerate(self.stops)
        }  # fmt: skip
        on = {name: weight for name, weight in zip(names, self.amplitude, strict=True) if weight}
        force = il.Source(il.Harmonic(1.0, frequency=self.frequency), on=on)
        return il.Network(bodies, contacts, {"f": force}, couplings)

    @property
    def directions(self):
        w = np.zeros((len(self.rubbing), len(self.mass)))
        for i, (one, other) in enumerate(self.rubbing):
            w[i, one] = -1.0
            if other >= 0:
                w[i, other] = 1.0
        return w

    def slips(self, z):
        n = len(self.mass)
        return self.directions @ z[n : 2 * n] + self.surface

    def drift(self, ways, closed):
        """Matrix of (x, v, 1, cos, sin), and rows of the forces of friction."""
        n, w, m = len(self.mass), self.directions, 1.0 / self.mass
        k, c, load = np.diag(self.stiffness), np.diag(self.damping), np.zeros(n)
        for i, spring in enumerate(self.between):
            d = np.zeros(n)
            d[i], d[i + 1] = 1.0, -1.0
            k = k + spring * np.outer(d, d)
        for stop in closed:
            k[self.stops[stop], self.stops[stop]] += self.hard[stop]
            load[self.stops[stop]] += self.hard[stop] * self.clearance[stop]
        free = np.zeros((n, 2 * n + 3))  # accelerations without friction
        free[:, :n], free[:, n : 2 * n] = -m[:, None] * k, -m[:, None] * c
        free[:, 2 * n], free[:, 2 * n + 2] = m * load, m * self.amplitude
        forces, held = np.zeros((len(w), 2 * n + 3)), [i for i, way in enumerate(ways) if way == 0]
        forces[:, 2 * n] = np.array(ways) * self.friction
        slipping = free - (m[:, None] * w.T) @ forces
        if held:
            forces[held] = np.linalg.solve((w[held] * m) @ w[held].T, w[held] @ slipping)
        result = np.zeros((2 * n + 3, 2 * n + 3))
        result[:n, n : 2 * n] = np.eye(n)
        result[n : 2 * n] = free - (m[:, None] * w.T) @ forces
        result[2 * n + 1, 2 * n + 2], result[2 * n + 2, 2 * n + 1] = -self.frequency, self.frequency
        return result, forces

    def consistent(self, z, ways, zero, closed, static):
        """Ways of all frictions, those that have no slip rate chosen so that forces and accelerations agree.

        Where forces of breakaway and sliding are equal, no other choice agrees.
        """
        n = len(self.mass)
        choices = itertools.product((0, 1, -1), repeat=len(zero))  # first those that change the fewest
        for choice in sorted(choices, key=lambda choice: np.sum(np.array(choice) != np.array(ways)[zero])):
            found = list(ways)
            for i, way in zip(zero, choice, strict=True):
                found[i] = way
            drift, forces = self.drift(found, closed)
            force, more, grows = forces @ z, drift @ z, drift @ (drift @ z)
            good = True
            for i, way in zip(zero, choice, strict=True):
                if way == 0:
                    good &= abs(force[i]) <= self.breakaway[i] + (-1e-9 if i == static else 1e-9)
                else:
                    change = self.directions[i] @ more[n : 2 * n]
                    change = change if abs(change) > 1e-7 else self.directions[i] @ grows[n : 2 * n]
                    good &= way * change > 0.0
            if good:
                return found
        raise AssertionError("no way is consistent")

    def watched(self, z, ways, closed, drift, forces):
        """Functions that are negative until an event."""
        slip, force = self.slips(z), forces @ z
        result = [
            -way * s if way else abs(f) - b for way, s, f, b in zip(ways, slip, force, self.breakaway, strict=True)
        ]
        gaps = [z[body] - c for body, c in zip(self.stops, self.clearance, strict=True)]
        return np.array([*result, *(-g if i in closed else g for i, g in enumerate(gaps))])

    def searched(self, duration, most, step=4e-3):
        """Times and rows of events, stops first: those that change what slips, sticks or touches."""
        n, stops = len(self.mass), len(self.stops)
        z, t, closed, found, known = np.concatenate([self.x, self.v, [1.0, 1.0, 0.0]]), 0.0, (), [], {}
        ways, fresh = np.sign(self.slips(z)).astype(int).tolist(), -1
        ways = self.consistent(z, ways, [i for i, way in enumerate(ways) if way == 0], closed, -1)
        while t < duration and len(found) < most:
            key = (*ways, closed)
            if key not in known:
                drift, forces = self.drift(ways, closed)
                known[key] = drift, forces, expm(drift * step)
            drift, forces, over = known[key]
            after, first, when = over @ z, -1, step
            for row in np.flatnonzero(self.watched(after, ways, closed, drift, forces) > 0.0):
                low, high = 1e-9 if row == fresh else 0.0, step
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    beyond = self.watched(expm(drift * middle) @ z, ways, closed, drift, forces)[row] > 0.0
                    low, high = (low, middle) if beyond else (middle, high)
                if high < when:
                    first, when = row, high
            if first < 0:
                z, t, fresh = after, t + step, -1
                continue
            z, t, fresh = expm(drift * when) @ z, t + when, first
            rubs = len(ways)
            found.append((t, stops + first if first < rubs else first - rubs))
            static, stop = -1, first - rubs
            if first < rubs:
                static, ways = (first if ways[first] == 0 else -1), [0 if i == first else w for i, w in enumerate(ways)]
            elif self.rigid[stop]:
                z[n + self.stops[stop]] *= -self.restitution[stop]
                slip = self.slips(z)
                ways = np.where(np.abs(slip) > 1e-9, np.sign(slip), 0.0).astype(int).tolist()
            else:
                closed = tuple(sorted(set(closed) ^ {stop}))
            ways = self.consistent(z, ways, [i for i, way in enumerate(ways) if way == 0], closed, static)
        return np.array(found).reshape(-1, 2)


def assert_same_events(drawn, duration, most=40, tolerance=1e-8):
    course = course_of(drawn.network(), duration, drawn.x, drawn.v)
    assert not course.stuck
    events = course.events_of(0)
    rests = np.append(events[events[:, 3] == HELD, 0], duration)[0] - 1e-9  # bounces go on in the search
    events = events[(events[:, 0] > 0.0) & (events[:, 0] < rests)]
    if len(events):
        events = events[np.append(True, np.diff(events[:, 0]) > 1e-11)]  # one of each time
    expected = drawn.searched(duration, most)
    expected = expected[expected[:, 0] < rests]
    assert len(expected) == most or len(events) == len(expected)
    count = len(expected)
    np.testing.assert_array_equal(events[:count, 1], expected[:, 1])
    np.testing.assert_allclose(events[:count, 0], expected[:, 0], atol=tolerance)
    return count


def test_events_are_those_of_a_search_by_small_steps():
    assert sum(assert_same_events(Stick.drawn(seed), 3.0, 12) for seed in range(6)) > 20


@pytest.mark.campaign
def test_events_of_many_networks_are_those_of_a_search_by_small_steps():
    assert sum(assert_same_events(Stick.drawn(seed), 10.0) for seed in range(100)) > 1000


@pytest.mark.full
def test_stacked_bodies_slip_and_stick_on_each_other():
    bodies = [(2.0, 30.0, 0.1, 4.0, 0.1, 0.0), (0.7, 2.0, 0.0, 0.0, 0.0, 0.2)]
    rubbing = [((0, 1), (0.8, 0.8, 0.0)), ((0, -1), (1.5, 1.8, 0.0))]
    assert assert_same_events(Stick(bodies, rubbing, [], 2.3, [0.0]), 40.0, 60, 1e-9) > 50


@pytest.mark.full
def test_a_body_that_rubs_and_strikes_a_stop():
    for stop in ((0.15, 0.0, 0.8), (0.15, 300.0, 0.0)):
        drawn = Stick([(1.0, 4.0, 0.1, 2.0, 0.0, 0.0)], [((0, -1), (0.6, 0.75, 0.3))], [(0, stop)], 1.7, [])
        assert assert_same_events(drawn, 40.0, 60, 1e-9) >= 40


@pytest.mark.parametrize("pull", [3.9, -3.9, 6.0])
def test_two_frictions_of_one_body_hold_it_together(pull):
    """The share of each is not determined, but their sum is: it holds up to 1 N and 3 N together."""
    force = il.Source(il.Harmonic(pull, frequency=0.5), on="a")
    couplings = {f"f{f:g}": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(f)) for f in (1.0, 3.0)}
    network = il.Network({"a": il.LinearOscillator()}, {}, {"s": force}, couplings)
    course = course_of(network, 12.0)
    moved = np.abs(course.lanes.x).max()
    assert (moved > 0.01) if abs(pull) > 4.0 else (moved < 1e-15)
    whole = il.Network(
        {"a": il.LinearOscillator()},
        {},
        {"s": force},
        {"f": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(4.0))},
    )
    np.testing.assert_allclose(course.lanes.x, course_of(whole, 12.0).lanes.x, atol=1e-13)


def test_a_stop_does_not_hold_a_body_that_is_pulled_away():
    network = il.Network(
        {"ball": il.LinearOscillator()},
        {"ceiling": il.Contact("ball", il.WALL, il.RigidContact(0.0), clearance=0.1)},
        {"gravity": il.Source(il.ConstantForce(-9.81), on="ball")},
    )
    course = course_of(network, 1.0, v=(2.0,))
    meets = (2.0 - math.sqrt(4.0 - 2.0 * 9.81 * 0.1)) / 9.81
    assert course.lanes.x[0, 0] == pytest.approx(0.1 - 0.5 * 9.81 * (1.0 - meets) ** 2, rel=1e-13)


def test_a_friction_holds_a_body_at_a_stop_that_pushes_no_more():
    """A push ends slowly; friction of 0.5 N holds the body in the place of the stop until the pull is beyond it."""
    network = il.Network(
        {"a": il.LinearOscillator()},
        {"g": il.Contact("a", il.WALL, il.RigidContact(0.0))},
        {"s": il.Source(il.Harmonic(1.0, frequency=1.0, phase=0.5 * math.pi), on="a")},
        {"f": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(0.5))},
    )
    course = course_of(network, 2.2)
    start = 2.0 * math.pi / 3.0  # cos t = −1/2
    left = 2.2 - start
    assert course.lanes.x[0, 0] < 0.0
    assert course.events_of(0)[-1, 0] == pytest.approx(start, rel=1e-12)
    # x'' = cos t + 1/2 from rest
    assert course.lanes.x[0, 0] == pytest.approx(
        0.25 * left**2 - (math.cos(2.2) - math.cos(start)) - math.sin(start) * left, abs=1e-13
    )


@pytest.mark.campaign
def test_statistics_and_path_are_those_of_short_steps():
    network = il.Network(
        {"a": il.LinearOscillator(stiffness=4.0, damping=0.1), "b": il.LinearOscillator(mass=0.5, stiffness=1.0)},
        {"g": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=0.3)},
        {"a": il.Harmonic(2.0, frequency=1.7)},
        {"f": il.Coupling("a", "b", il.CoulombFrictionCoupling(0.3))},
    )
    options = {"duration": 20.0, "spin_up": 5.0, "initial": "rest", "record": il.Trajectory(0.5)}
    found = il.simulate(network, integrator=EXACT, **options)
    steps = il.simulate(network, integrator=il.ExactFlow(measured=False), step=1e-3, **options)
    for name in ("mean_displacement", "mean_square_velocity", "mean_contact_force"):
        np.testing.assert_allclose(found[name], steps[name], rtol=2e-3, atol=2e-3, err_msg=name)
    np.testing.assert_allclose(found.contact_rate, steps.contact_rate, rtol=1e-9)
    for name in ("displacement", "velocity"):
        np.testing.assert_allclose(found[name], steps[name], atol=1e-4)


def test_the_error_of_a_path_with_friction_is_known():
    def sliding(mass):
        body = il.LinearOscillator(mass=mass, stiffness=4.0 * mass, damping=0.1 * mass)
        rubbing = {"f": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(0.6 * mass, velocity=0.3))}
        stop = {"g": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=0.15)}
        return il.Network({"a": body}, stop, {"a": il.Harmonic(2.0 * mass, frequency=1.7)}, rubbing)

    one, two = (
        il.simulate(sliding(mass), 400.0, spin_up=0.0, integrator=EXACT, record=il.Trajectory(1.0))
        for mass in (1.0, 3.0)
    )
    apart = float(np.abs(one.displacement - two.displacement).max())
    assert apart < one.attrs["path_error"] < 1e-10


@pytest.mark.parametrize("frequency", [0.9, 2.3])
@pytest.mark.parametrize("phase", [0.0, 1.0])
@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_a_force_as_large_as_the_friction_moves_nothing(frequency, phase, damping):
    """Beyond it by ε the body slides by 4.5 F ε²/(m ω²) in each half cycle, from −a to 2 a about the top of the force.

    There, with ω² a² = 2 ε, the slip rate is F ω² (t + a)² (2 a − t)/6 m.
    """
    friction, mass = 0.3, 2.0
    body = il.LinearOscillator(mass=mass, stiffness=1.0, damping=damping)
    for beyond in (0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-10, 1e-6, 1e-5):
        force = {"a": il.Harmonic(friction * (1.0 + beyond), frequency=frequency, phase=phase)}
        half = math.pi / frequency
        course = course_of(on_ground(friction, force, body), 40.0 * half, interval=half, samples=40)
        assert not course.stuck
        assert (course.events_of(0)[:, 1] == 0.0).all()
        slid = np.abs(course.lanes.samples[0, :, 0]).max()
        assert slid == pytest.approx(
            4.5 * friction * max(beyond, 0.0) ** 2 / (mass * frequency**2), rel=1e-3, abs=2e-14
        )


def test_a_pull_as_large_as_the_weight_lifts_nothing():
    """A body on the ground, whose harmonic pull is its weight at the top."""
    ground = {"ground": il.Contact("a", il.WALL, il.RigidContact(0.5), clearance=0.0)}
    for beyond in (0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-10):
        network = il.Network(
            {"a": il.LinearOscillator(mass=1.0)}, ground,
            {"a": il.Harmonic(3.0 * (1.0 + beyond), frequency=0.7), "g": il.Source(il.ConstantForce(3.0), on="a")},
        )  # fmt: skip
        course = course_of(network, 200.0, interval=0.5, samples=400)
        assert not course.stuck
        assert np.abs(course.lanes.samples[0, :, 0]).max() < 1e-15
        assert np.abs(course.lanes.samples[0, :, 1]).max() < 1e-15
