"""Bodies of given motion: tables, stops and supports that move, against exact maps and tight solutions."""

import functools
import json
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.assembly.model import Model

GRAVITY, TURN, E = 9.81, 40.0, 0.5
PERIOD = 2.0 * math.pi / TURN
FLIP = math.hypot(2.0 * (1.0 + E**2) / (1.0 + E) ** 2, math.pi * (1.0 - E) / (1.0 + E))
"""Acceleration of a table, over that of gravity, from which on a ball does not keep to its period."""


def table(strength, phase=0.0):
    return il.PrescribedMotion(il.Harmonic(strength * GRAVITY / TURN**2, frequency=TURN, phase=phase))


def phase_of(strength):
    """Phase of the impacts of one a period: the velocity of the table there is ``g T/2 (1 − e)/(1 + e)``."""
    return math.acos(math.pi * (1.0 - E) / (1.0 + E) / strength)


STRENGTHS = {"low": 1.2, "stable": FLIP - 1e-4, "unstable": FLIP + 1e-4}


@functools.cache
def bouncing():
    """Balls that begin a little too fast at an impact on tables, and one that lies on a weaker table."""
    phases = {name: phase_of(strength) for name, strength in STRENGTHS.items()}
    tables = {f"{name}_table": table(STRENGTHS[name], phase) for name, phase in phases.items()}
    names = [*STRENGTHS, "lying"]
    network = il.Network(
        {**tables, "lying_table": table(0.9), **dict.fromkeys(names, il.LinearOscillator(mass=0.3))},
        {name: il.Contact(f"{name}_table", name, il.RigidContact(E)) for name in names},
        {"weight": il.BaseMotion(il.ConstantForce(GRAVITY))},
    )
    heights = {name: STRENGTHS[name] * GRAVITY / TURN**2 * math.sin(phase) for name, phase in phases.items()}
    speeds = dict.fromkeys(STRENGTHS, 0.5 * GRAVITY * PERIOD * (1.0 + 1e-5)) | {"lying": 0.9 * GRAVITY / TURN}
    step = PERIOD / 256
    record = il.Trajectory(0.5 * PERIOD)
    start = {"displacement": heights, "velocity": speeds}
    return il.simulate(network, 100 * PERIOD, step=step, initial=start, record=record), heights


def tops(name):
    """How far the tops of the flights of a ball are above that of the periodic one, over the height of its flight."""
    result, heights = bouncing()
    x, v = (result[quantity].sel(oscillator=name).values[0, 1::2] for quantity in ("displacement", "velocity"))
    flight = GRAVITY * PERIOD**2 / 8.0
    return (x + 0.5 * v**2 / GRAVITY - heights[name]) / flight - 1.0


def multipliers(name):
    """Trace and determinant of the map from one impact to the next, from the first tops."""
    off = tops(name)
    pairs = np.stack([off[1:9], off[:8]], axis=1)
    trace, minus = np.linalg.lstsq(pairs, off[2:10], rcond=None)[0]
    return trace, -minus


@pytest.mark.full
def test_a_ball_bounces_once_a_period_on_a_vibrating_table():
    """Heights and phases are those of the exact map, ``v⁺ = (1 + e) V(t) − e v⁻`` after free flights.

    With the table's acceleration a at the impacts its linear map has the trace ``1 + e² + (1 + e)² a/g`` and the
    determinant e²: the motion is stable from where there is one to ``a = −2g (1 + e²)/(1 + e)²``. For high bounces only
    (P. J. Holmes, J. Sound Vib. 84, 1982, 173) the determinant is e and the limit ``a = −g``.
    """
    result, _ = bouncing()
    assert np.abs(tops("low")[-20:]).max() < 1e-8
    period = result.contact_rate.sel(contact=[*STRENGTHS]) * PERIOD
    np.testing.assert_allclose(period, 1.0, atol=0.011)  # whether the last impact is counted
    for name, strength in STRENGTHS.items():
        acceleration = -strength * math.sin(phase_of(strength))
        trace = 1.0 + E**2 + (1.0 + E) ** 2 * acceleration
        assert multipliers(name) == pytest.approx((trace, E**2), abs=1e-4)


def test_its_limit_of_stability():
    """Between two tables whose accelerations differ by 10⁻⁴, as in the sign of ``1 + trace + determinant``."""
    stable, unstable = (1.0 + sum(multipliers(name)) for name in ("stable", "unstable"))
    assert stable > 0.0 > unstable
    limit = FLIP - 1e-4 + 2e-4 * stable / (stable - unstable)
    assert limit == pytest.approx(FLIP, rel=5e-5)  # four digits
    assert FLIP - math.hypot(1.0, math.pi / 3.0) > 0.07  # that of high bounces


def test_a_ball_lies_on_a_table_that_is_weaker_than_gravity():
    result, _ = bouncing()
    ball, under = (result.sel(oscillator=name) for name in ("lying", "lying_table"))
    np.testing.assert_allclose(ball.displacement, under.displacement, atol=1e-15)
    assert float(result.contact_ratio.sel(contact="lying")) == pytest.approx(1.0, abs=1e-12)
    assert float(result.mean_contact_force.sel(contact="lying")) == pytest.approx(0.3 * GRAVITY, rel=1e-6)


def test_the_ground_that_moves_is_the_same_table():
    """In displacements beside the table, whose acceleration then acts on the ball."""
    strength, phase = STRENGTHS["low"], phase_of(STRENGTHS["low"])
    heaving = il.Harmonic(-strength * GRAVITY, frequency=TURN, phase=phase)
    network = il.Network(
        {"low": il.LinearOscillator(mass=0.3)},
        {"low": il.Contact(il.WALL, "low", il.RigidContact(E))},
        {"weight": il.BaseMotion(il.ConstantForce(GRAVITY)), "heaving": il.BaseMotion(heaving)},
    )
    begin = 0.5 * GRAVITY * PERIOD * (1.0 + 1e-5) - strength * GRAVITY / TURN * math.cos(phase)
    start = {"velocity": {"low": begin}}
    beside = il.simulate(
        network, 8 * PERIOD, step=PERIOD / 256, initial=start, record=il.Trajectory(0.5 * PERIOD)
    ).displacement
    result, _ = bouncing()
    ball, under = (result.displacement.sel(oscillator=name)[0, :17] for name in ("low", "low_table"))
    np.testing.assert_allclose(ball - under, beside[0, :, 0], atol=1e-9)


SHAKING = il.Harmonic(0.02, frequency=30.0, phase=0.4)
SWEEP = il.Chirp(0.01, start_frequency=2.0, end_frequency=30.0, duration=4.0)
BODY = il.LinearOscillator(mass=1.5, damping=0.3, stiffness=400.0)
LAWS = {
    "hertz": (il.HertzContact(1e5), lambda d, r: 1e5 * d**1.5),
    "voigt": (il.KelvinVoigtContact(1e4, damping=20.0), lambda d, r: max(1e4 * d + 20.0 * r, 0.0)),
    "hunt": (il.HuntCrossleyContact(1e5, dissipation=0.5), lambda d, r: 1e5 * d**1.5 * (1.0 + 0.5 * r)),
}
DRIVEN = il.Network(
    {**dict.fromkeys(LAWS, BODY), "stop": il.PrescribedMotion(SHAKING), "rider": BODY.replace(stiffness=0.0),
     "support": il.PrescribedMotion(SWEEP)},
    {name: il.Contact(name, "stop", law, clearance=0.03) for name, (law, _) in LAWS.items()},
    dict.fromkeys(LAWS, il.Harmonic(3.0, frequency=14.0)),
    {"spring": il.Coupling("rider", "support", il.LinearCoupling(200.0, damping=4.0))},
)  # fmt: skip
END = 1.6


@functools.cache
def driven(step):
    method = il.ExactFlow(measured=step is None)
    start = {"displacement": dict.fromkeys(LAWS, 0.01), "velocity": dict.fromkeys(LAWS, 0.5)}
    return il.simulate(DRIVEN, END, step=step, initial=start, integrator=method, record=il.Trajectory(0.1))


@functools.cache
def exact(name):
    """Path of a body at the times of the record, to the last digits."""

    def with_stop(t, y):
        depth, rate = y[0] - 0.02 * math.sin(30.0 * t + 0.4) - 0.03, y[1] - 0.6 * math.cos(30.0 * t + 0.4)
        force = LAWS[name][1](depth, rate) if depth > 0.0 else 0.0
        return [y[1], (3.0 * math.sin(14.0 * t) - 0.3 * y[1] - 400.0 * y[0] - force) / 1.5]

    def with_support(t, y):
        place, rate = 0.01 * math.sin((2.0 + 3.5 * t) * t), 0.01 * (2.0 + 7.0 * t) * math.cos((2.0 + 3.5 * t) * t)
        return [y[1], (200.0 * (place - y[0]) + 4.0 * (rate - y[1]) - 0.3 * y[1]) / 1.5]

    right_side, start = (with_support, [0.0, 0.0]) if name == "rider" else (with_stop, [0.01, 0.5])
    times = np.linspace(0.0, END, 17)
    return solve_ivp(right_side, (0.0, END), start, "DOP853", times, rtol=1e-12, atol=1e-14, max_step=5e-4).y


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "gain", "most"), [("rider", 50.0, 1e-7), ("hertz", 30.0, 1e-5), ("hunt", 50.0, 2e-6), ("voigt", 4.0, 2e-3)]
)
def test_paths_with_driven_stops_and_supports_have_the_order_of_the_method(name, gain, most):
    """At an eighth of the step: a spring and damper that kick, contacts with a kink, and a dashpot with a jump."""
    coarse, fine = (off(name, step) for step in (8e-4, 1e-4))
    assert (fine < most).all()
    assert (fine < coarse / gain).all()


def off(name, step):
    """Return the largest differences of a displacement and a velocity, over the largest values."""
    path = driven(step).sel(oscillator=name)
    found = np.stack([path.displacement[0], path.velocity[0]])
    return np.abs(found - exact(name)).max(axis=1) / np.abs(exact(name)).max(axis=1)


@pytest.mark.full
def test_the_body_itself_moves_as_given():
    path = driven(1e-4)
    times = path.time.values
    stop, support = (path.sel(oscillator=name) for name in ("stop", "support"))
    np.testing.assert_allclose(stop.displacement[0], 0.02 * np.sin(30.0 * times + 0.4), atol=1e-12)
    np.testing.assert_allclose(stop.velocity[0], 0.6 * np.cos(30.0 * times + 0.4), atol=1e-9)
    np.testing.assert_allclose(support.displacement[0], 0.01 * np.sin((2.0 + 3.5 * times) * times), atol=1e-12)
    assert path.mean_square_velocity.sel(oscillator="stop").item() == pytest.approx(0.18, rel=0.03)


@pytest.mark.full
def test_an_automatic_step_does():
    step = driven(None).attrs["step"]
    assert step < 5e-3
    for name in ("hertz", "hunt"):
        force = driven(None).mean_contact_force.sel(contact=name).item()
        assert force == pytest.approx(driven(1e-4).mean_contact_force.sel(contact=name).item(), rel=0.02)


@pytest.mark.full
def test_a_record_rests_before_and_after():
    """Before its first and after its last sample; in the spin-up, too."""
    record = il.SampledForce([0.5, 0.7, 1.0], [0.02, 0.05, -0.01], after="zero")
    network = DRIVEN.replace(oscillators={"stop": il.PrescribedMotion(record)})
    options = {"step": 1e-3, "spin_up": 0.1, "initial": "rest", "integrator": il.ExactFlow(measured=False)}
    path = il.simulate(network, 1.5, record=il.Trajectory(0.05), **options)
    expected = np.interp(path.time, [0.5, 0.7, 1.0], [0.02, 0.05, -0.01])
    np.testing.assert_allclose(path.displacement.sel(oscillator="stop")[0], expected, atol=1e-12)
    speed = path.velocity.sel(oscillator="stop")[0].sel(time=[0.3, 0.6, 0.85, 1.3], method="nearest")
    np.testing.assert_allclose(speed, [0.0, 0.15, -0.2, 0.0], atol=1e-10)


@pytest.mark.full
def test_noise_and_a_moving_support_add_up():
    """Mean squares of a body on a spring: those of the noise and of the response to the support."""
    network = il.Network(
        {"support": il.PrescribedMotion(il.Harmonic(0.03, frequency=9.0)), "a": il.LinearOscillator(damping=1.0)},
        excitations={"a": il.WhiteNoise(0.02)},
        couplings={"spring": il.Coupling("support", "a", il.LinearCoupling(100.0, damping=2.0))},
    )
    found = il.simulate(network, 20.0 * 2.0 * math.pi / 9.0, realizations=256, rng=1).sel(oscillator="a")
    gain = abs(0.03 * (100.0 + 18.0j) / (100.0 - 81.0 + 27.0j))
    for name, noise, response in (
        ("displacement", math.pi * 0.02 / 300.0, 0.5 * gain**2), ("velocity", math.pi * 0.02 / 3.0, 40.5 * gain**2)
    ):  # fmt: skip
        value, error = (float(found[f"mean_square_{name}{kind}"]) for kind in ("", "_standard_error"))
        assert error < 0.02 * (noise + response)
        assert abs(value - noise - response) < 3.0 * error


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"oscillators": {"stop": il.PrescribedMotion(il.WhiteNoise(1.0))}}, "displacement of 'stop' must be a given"),
        ({"excitations": {"stop": il.WhiteNoise(1.0)}}, "'stop' has an excitation, but moves as it is given"),
        ({"excitations": {"s": il.Source(il.WhiteNoise(1.0), on="stop")}}, "'stop' is driven by 's', but moves"),
        ({"couplings": {"s": il.Coupling("stop", "support", il.LinearCoupling(1.0))}}, "Both sides of 's' move as"),
        ({"contacts": {"s": il.Contact("stop", il.WALL, il.LinearContact(1.0))}}, "Both sides of 's' move as they"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, message):
    with pytest.raises(il.InvalidInput, match=message):
        DRIVEN.replace(**changes)


def test_what_knows_no_given_motion_says_so():
    with pytest.raises(il.InvalidInput, match="All bodies move as they are given"):
        il.Network({"stop": il.PrescribedMotion(SHAKING)})
    with pytest.raises(il.InvalidInput, match="must be an excitation such as"):
        il.PrescribedMotion(0.1)
    with pytest.raises(il.NoExactReference, match="'stop' moves as it is given, so that no law is stationary"):
        il.exact(DRIVEN)
    with pytest.raises(il.InvalidInput, match="RungeKutta4 knows no bodies of given motion such as 'stop'"):
        il.simulate(DRIVEN, 1.0, integrator=il.RungeKutta4())
    with pytest.raises(il.InvalidInput, match="right-hand side knows no bodies of given motion such as 'stop'"):
        DRIVEN.compile()
    pair = il.Network(
        {"a": BODY, "b": il.PrescribedMotion(SHAKING)}, {"c": il.Contact("a", "b", LAWS["hertz"][0])},
        {"a": il.WhiteNoise(1.0)},
    )  # fmt: skip
    with pytest.raises(il.NoExactReference, match="'b' moves as it is given; bodies under white noise"):
        il.fokker_planck(pair)
    inside = il.Network(
        {"a": BODY, "b": il.PrescribedMotion(il.ConstantForce(-0.1))}, {"c": il.Contact("a", "b", il.RigidContact(E))}
    )
    for start in ("rest", {"displacement": {"a": 0.05}}):
        with pytest.raises(il.InvalidInput, match="inside each other"):
            il.simulate(inside, 1.0, step=0.01, initial=start)


def test_a_start_is_not_given_but_a_run_goes_on():
    table = il.Network(
        {"ball": BODY, "table": il.PrescribedMotion(il.ConstantForce(-0.1))},
        {"c": il.Contact("table", "ball", il.RigidContact(E))},
    )
    with pytest.raises(il.InvalidInput, match="initial displacement of 'table' cannot be chosen: its motion is given"):
        il.simulate(table, 1.0, step=0.01, initial={"displacement": {"ball": 0.1, "table": 0.0}})
    first = il.simulate(table, 1.0, step=0.01, initial={"displacement": {"ball": 0.1}}, record=il.FinalState(), rng=1)
    again = il.simulate(table, 1.0, step=0.01, initial=first, rng=2)
    assert np.isfinite(again.mean_displacement).all()
    assert again.mean_displacement.sel(oscillator="table") == pytest.approx(-0.1, abs=1e-12)


def test_a_check_knows_it():
    text = repr(DRIVEN.check())
    assert "Motions are given: statistics are means over the time of a run, which begins at 0." in text
    assert "RungeKutta4 knows no bodies of given motion such as 'stop'; use il.ExactFlow()." in text
    assert Model.of(DRIVEN).bodies.free.tolist() == [True, True, True, False, True, False]


def test_copies():
    assert il.Network.from_dict(json.loads(json.dumps(DRIVEN.to_dict()))) == DRIVEN
    assert "stop: PrescribedMotion(displacement=Harmonic(amplitude=0.02" in repr(DRIVEN)
    shaken = DRIVEN.replace(excitations={"ground": il.BaseMotion(il.ConstantForce(1.0))})
    assert set(shaken.sources["ground"].on) == {*LAWS, "rider"}
