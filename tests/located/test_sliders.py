"""Springs with kinks, and springs in series with dry friction, from event to event, against a solver with events."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_motion import course_of

import impactlab as il
from impactlab.kernels.contact_states import SLIPS_DOWN, SLIPS_UP, STICKS

EXACT = il.EventLocated()
STIFFNESS, SLIP_FORCE, RESTITUTION = 9.0, 0.8, 0.7


def two_bodies(stop=True, force=2.0):
    """A driven body and one that a spring with a slider takes along, which may meet a rigid stop."""
    law = il.JenkinsCoupling(STIFFNESS, slip_force=SLIP_FORCE)
    return il.Network(
        {"a": il.LinearOscillator(stiffness=3.0, damping=0.1), "b": il.LinearOscillator(mass=0.6, stiffness=6.0)},
        {"g": il.Contact("b", il.WALL, il.RigidContact(RESTITUTION), clearance=0.35)} if stop else {},
        {"a": il.Harmonic(force, frequency=1.3)} if force else {},
        {"j": il.Coupling("a", "b", law), "k": il.Coupling("a", "b", il.LinearCoupling(0.5))},
    )


def independent(duration, times, stop=True):
    """Events and path of these by DOP853; a row of the path is a, b, their velocities, and the force of the slider."""

    def rates(t, y, way):
        pull = y[4] + 0.5 * (y[1] - y[0])
        first = 2.0 * math.sin(1.3 * t) - 3.0 * y[0] - 0.1 * y[2] + pull
        return [y[2], y[3], first, (-6.0 * y[1] - pull) / 0.6, 0.0 if way else STIFFNESS * (y[3] - y[2])]

    def slip(t, y, way):
        return way * (y[3] - y[2]) if way else SLIP_FORCE - abs(y[4])

    def gap(t, y, way):
        return 0.35 - y[1]

    slip.terminal = gap.terminal = True
    slip.direction = gap.direction = -1
    options = {"method": "DOP853", "rtol": 3e-13, "atol": 1e-14}
    t, y, way, found, path = 0.0, np.zeros(5), 0, [], np.empty((len(times), 5))
    while t < duration:
        s = solve_ivp(
            rates, (t, duration), y, args=(way,), events=[slip, gap] if stop else [slip],
            dense_output=True, max_step=0.05, **options,
        )  # fmt: skip
        inside = (times >= t) & (times <= s.t[-1])
        if inside.any():
            path[inside] = s.sol(times[inside]).T
        t, y = s.t[-1], s.y[:, -1].copy()
        if s.status != 1:
            break
        strikes = stop and len(s.t_events[1]) > 0
        found.append((t, 0.0 if strikes else float(stop)))
        if strikes:
            y[3] *= -RESTITUTION
            way = way if way * (y[3] - y[2]) > 0.0 else 0
        else:
            way = 0 if way else int(math.copysign(1.0, y[4]))
        if not way:
            y[4] = math.copysign(min(abs(y[4]), SLIP_FORCE * (1.0 - 1e-16)), y[4])
        s = solve_ivp(rates, (t, t + 1e-8), y, args=(way,), **options)  # off the event
        t, y = s.t[-1], s.y[:, -1]
    return np.array(found), path


@pytest.mark.parametrize("stop", [False, True])
def test_a_spring_with_a_slider_under_harmonic_force(stop):
    times = np.linspace(0.0, 30.0, 61)
    found, path = independent(30.0, times, stop)
    course = course_of(two_bodies(stop), 30.0, x=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0), interval=0.5, samples=61)
    events = course.events_of(0)
    assert len(found) > 20
    np.testing.assert_array_equal(events[:, 1], found[:, 1])
    np.testing.assert_allclose(events[:, 0], found[:, 0], atol=1e-9)
    samples = course.lanes.samples[0]
    np.testing.assert_allclose(samples[:, [0, 1, 3, 4]], path[:, :4], atol=1e-9)
    np.testing.assert_allclose(STIFFNESS * (samples[:, 1] - samples[:, 0] - samples[:, 2]), path[:, 4], atol=1e-8)
    assert {STICKS, SLIPS_UP, SLIPS_DOWN} <= set(events[:, 3])


def test_states_of_laws_are_those_of_the_path():
    record = [il.Trajectory(0.5), il.FinalState()]
    whole = il.simulate(two_bodies(), 20.0, integrator=EXACT, initial="rest", spin_up=0.0, record=record)
    _, path = independent(20.0, np.linspace(0.0, 20.0, 41))
    np.testing.assert_allclose(whole.law_state.sel(state="j.pull")[0], path[:, 4], atol=1e-8)
    extension = whole.displacement.sel(oscillator="b") - whole.displacement.sel(oscillator="a")
    np.testing.assert_allclose(whole.law_state.sel(state="j.last"), extension, atol=1e-15)


def test_a_run_goes_on_with_the_states_of_laws():
    free = two_bodies(force=0.0)
    record = [il.Trajectory(0.5), il.FinalState()]
    start = {"displacement": {"a": 1.0}, "velocity": {"b": -0.5}, "state": {"j.pull": 0.3, "j.last": -1.0}}
    options = {"integrator": EXACT, "spin_up": 0.0, "record": record}
    whole = il.simulate(free, 8.0, initial=start, **options)
    first = il.simulate(free, 4.0, initial=start, **options)
    rest = il.simulate(free, 4.0, initial=first, **options)
    assert float(whole.law_state.sel(state="j.pull")[0, 0]) == pytest.approx(0.3, abs=1e-15)
    for name in ("displacement", "law_state"):
        np.testing.assert_allclose(rest[name][0], whole[name][0, 8:], atol=1e-12)


def test_energy_that_sliders_take_is_what_the_force_gives():
    """In periodic motion: mean force times velocity is the work of the slip force, 4 F times the slip in a period."""
    network = il.Network(
        {"a": il.LinearOscillator(stiffness=1.0)}, {}, {"a": il.Harmonic(1.5, frequency=0.5)},
        {"j": il.Coupling("a", il.WALL, il.JenkinsCoupling(5.0, slip_force=0.5))},
    )  # fmt: skip
    period = 2.0 * math.pi / 0.5
    course = course_of(network, 60.0 * period, interval=period / 64.0, samples=3841, x=(0.0, 0.0))
    v = course.lanes.samples[0, -65:-1, 2]
    force = 1.5 * np.sin(0.5 * period / 64.0 * np.arange(3776, 3840))
    work = (force * v).mean() * period
    slip = course.lanes.samples[0, -129:, 1]
    assert work == pytest.approx(2.0 * 0.5 * (slip.max() - slip.min()), rel=2e-3)  # 64 samples a period


def test_a_spring_with_kinks_has_the_period_of_the_closed_form():
    inner, outer, kink, amplitude = 1.0, 5.0, 0.5, 1.0
    for second in (outer, 0.2):
        law = il.BilinearCoupling(inner, outer_stiffness=second, break_extension=kink)
        network = il.Network({"a": il.LinearOscillator()}, {}, {}, {"s": il.Coupling("a", il.WALL, law)})
        events = course_of(network, 60.0, x=(amplitude,)).events_of(0)
        beyond, rate = amplitude - kink, math.sqrt(second)
        center = inner * kink / second
        speed = math.sqrt(second * ((beyond + center) ** 2 - center**2))
        half = math.acos(center / (beyond + center)) / rate + math.atan2(kink * math.sqrt(inner), speed) / math.sqrt(
            inner
        )
        times = events[(events[:, 1] == 1) & (events[:, 3] == 1), 0]
        np.testing.assert_allclose(np.diff(times), 4.0 * half, rtol=1e-11)
        assert len(times) > 5


def test_a_spring_with_a_slider_that_has_no_stiffness_is_refused():
    network = two_bodies(stop=False).replace(
        couplings={"j": il.Coupling("a", "b", il.JenkinsCoupling(0.0, slip_force=1.0))}
    )
    with pytest.raises(il.InvalidInput, match="without stiffness such as 'j'"):
        il.simulate(network, 1.0, initial="rest", integrator=EXACT)


@pytest.mark.parametrize(
    "law", [il.CoulombFrictionCoupling(1.2, static_ratio=1.3), il.JenkinsCoupling(30.0, slip_force=1.2)]
)
def test_a_body_on_a_shaking_table_moves_as_one_that_its_inertia_pushes(law):
    amplitude, frequency, mass = 0.3, 3.1, 1.4
    record, options = il.Trajectory(0.5), {"integrator": EXACT, "spin_up": 0.0}
    body, spring = il.LinearOscillator(mass=mass), il.LinearCoupling(4.0, damping=0.2)
    table = {"table": il.PrescribedMotion(il.Harmonic(amplitude, frequency=frequency))}
    on_table = il.Network(
        {"a": body, **table}, couplings={"f": il.Coupling("table", "a", law), "k": il.Coupling("table", "a", spring)}
    )
    speed = amplitude * frequency  # of the table at first
    still = il.Network(
        {"a": body}, {}, {"a": il.Harmonic(mass * amplitude * frequency**2, frequency=frequency)},
        {"f": il.Coupling(il.WALL, "a", law), "k": il.Coupling(il.WALL, "a", spring)},
    )  # fmt: skip
    one = il.simulate(on_table, 30.0, initial={"velocity": {"a": 0.2 + speed}}, record=record, **options)
    two = il.simulate(still, 30.0, initial={"velocity": {"a": 0.2}}, record=record, **options)
    relative = one.displacement.sel(oscillator="a") - one.displacement.sel(oscillator="table")
    assert one.attrs["events"] == two.attrs["events"] > 20
    np.testing.assert_allclose(relative[0], two.displacement.sel(oscillator="a")[0], atol=1e-11)


def test_a_friction_acts_along_a_combination():
    """Along twice a displacement it is a friction of twice the force."""
    bodies, force = {"a": il.LinearOscillator(stiffness=4.0)}, {"a": il.Harmonic(3.0, frequency=1.1)}
    twice = il.Coupling(il.Combination({"a": 2.0}), il.WALL, il.CoulombFrictionCoupling(0.4, velocity=0.6))
    once = il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(0.8, velocity=0.3))
    events = [course_of(il.Network(bodies, {}, force, {"f": item}), 20.0).events_of(0) for item in (twice, once)]
    assert len(events[0]) > 8
    np.testing.assert_allclose(events[0][:, 0], events[1][:, 0], atol=1e-13)
