"""Periodic orbits, against closed forms, given constants and paths of SciPy."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import impactlab as il

TURN = 2.0 * math.pi


def cosine(amplitude, frequency):
    return il.Harmonic(amplitude=amplitude, frequency=frequency, phase=0.5 * math.pi)


def stop(frequency=1.0, gap=1.0, amplitude=1.0, law=None, restitution=0.8, oscillator=None, **others):
    """One driven body and its stop."""
    law = law or il.RigidContact(restitution=restitution)
    return il.Network(
        oscillators={"a": oscillator or il.LinearOscillator(damping=0.1, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, law, clearance=gap)},
        excitations={"a": cosine(amplitude, frequency)},
        **others,
    )


def multipliers(orbits, orbit=0):
    return orbits["multiplier_real"].values[orbit] + 1j * orbits["multiplier_imag"].values[orbit]


def in_phase(network, orbits, orbit=0):
    """The largest distance of a path of SciPy over a period from its beginning: nothing of it is shared."""
    compiled = network.compile()
    state = np.concatenate([orbits["displacement"].values[orbit], orbits["velocity"].values[orbit]])
    period = float(orbits["period"].values[orbit])
    found = solve_ivp(
        compiled.rhs, (0.0, period), state, method="DOP853", rtol=1e-11, atol=1e-13, max_step=period / 400
    )
    return float(np.abs(found.y[:, -1] - state).max())


def test_the_driven_stop_of_one_impact_a_period():
    """Constants of x'' + 0.1 x' + x = cos t, a wall at 1, e = 0.8, from one quadratic equation; COCO's example 15.2."""
    found = il.orbits(stop())
    assert found["closing_velocity"].values[0, 0] == pytest.approx(1.695732938, abs=1e-9)
    assert found["event_time"].values[0, 0] == pytest.approx(0.075952165, abs=1e-9)
    one, other = multipliers(found)
    assert one == pytest.approx(-0.58429531 + 0.00560035j, abs=1e-8)
    assert other == one.conjugate()
    assert abs(one * other) == pytest.approx(0.64 * math.exp(-0.1 * TURN), rel=1e-13)
    assert found["stable"].values[0] == 1
    assert found["closure"].values[0] < 1e-12
    lost = 0.5 * (1.0 - 0.64) * found["closing_velocity"].values[0, 0] ** 2
    path, phase = found["path_velocity"].values[0, :, 0], found["phase"].values
    assert found["energy_lost"].values[0] == pytest.approx(lost + 0.1 * TURN * np.trapezoid(path**2, phase), rel=1e-2)
    assert il.network_of(found) == stop()
    assert "LinearOscillator" not in il.citation(found)


@pytest.mark.parametrize(
    ("section", "time", "displacement"),
    [
        (il.AtContact("stop"), 0.075952165, 1.0),
        (il.AtContact("stop", "leaving"), 0.075952165, 1.0),
        (il.Crossing("a", 0.5), None, 0.5),
        (il.Strobe(TURN, start=1.0), 1.0, None),
        (il.Strobe(2.0 * TURN), 0.0, None),
    ],
)
def test_states_on_sections(section, time, displacement):
    found = il.orbits(stop(), section)
    if time is not None:
        assert found["section_time"].values[0] == pytest.approx(time, abs=1e-9)
    if displacement is not None:
        assert found["displacement"].values[0, 0] == pytest.approx(displacement, abs=1e-12)
    if isinstance(section, il.AtContact):
        velocity = 1.695732938 * (1.0 if section.side == "closing" else -0.8)
        assert found["velocity"].values[0, 0] == pytest.approx(velocity, abs=1e-9)


@pytest.mark.full
@pytest.mark.parametrize(
    ("law", "damping"),
    [
        (il.LinearContact(50.0), 0.0),
        (il.KelvinVoigtContact(stiffness=50.0, damping=3.0), 3.0),
        (il.HertzContact(50.0), 0.0),
    ],
)
def test_soft_stops(law, damping):
    network = stop(law=law)
    found = il.orbits(network)
    assert in_phase(network, found) < 1e-8
    times = dict(zip(found["event_kind"].values[0], found["event_time"].values[0], strict=True))
    lasts = (times["part" if damping else "open"] - times["close"]) % TURN
    product = math.exp(-0.1 * TURN - damping * lasts)  # of the divergence along the orbit
    if not damping:
        assert np.prod(multipliers(found)).real == pytest.approx(product, rel=1e-12 if law.linear else 1e-6)
    assert found["impacts"].values[0] == 1


def test_rest_after_endless_bounces_is_part_of_an_orbit():
    found = il.orbits(stop(frequency=0.4, gap=0.1, restitution=0.3))
    kinds = found["event_kind"].values[0].tolist()
    assert kinds[0] == "release"
    assert kinds[-1] == "rest"
    assert set(kinds[1:-1]) == {"bounce"}
    assert np.abs(multipliers(found)).max() < 1e-12  # what begins near comes to rest in the same way
    assert found["closure"].values[0] < 1e-9


def test_dry_friction_on_a_belt_has_a_period_of_its_own():
    """Stick and slip without damping: a circle about the sliding place, then the way back with the belt."""
    friction, ratio, belt = 0.5, 2.0, 0.3
    law = il.CoulombFrictionCoupling(friction=friction, static_ratio=ratio, velocity=belt)
    network = il.Network(
        oscillators={"a": il.LinearOscillator(stiffness=1.0)}, couplings={"belt": il.Coupling("a", il.WALL, law)}
    )
    height = friction * (ratio - 1.0)
    slips = TURN - 2.0 * math.atan2(height, belt)
    period = slips + 2.0 * height / belt
    found = il.orbits(network, il.Crossing("a", 0.0))
    assert found["period"].values[0] == pytest.approx(period, rel=1e-9)
    assert sorted(np.abs(multipliers(found))) == pytest.approx([0.0, 1.0], abs=1e-9)
    assert found["stable"].values[0] == 1
    with pytest.raises(il.InvalidInput, match="tells no phase"):
        il.orbits(network, il.Strobe(1.0))


@pytest.mark.full
def test_a_search_finds_unstable_orbits_beside_a_chaotic_one():
    network = stop(frequency=2.8, gap=0.0)
    found = il.orbits(network, start="search", periods=3)
    assert {1, 2, 3} <= set(found["periods"].values.tolist())
    assert not found["stable"].values.any()
    for orbit in range(found.sizes["orbit"]):
        impacts, period = int(found["impacts"].values[orbit]), float(found["period"].values[orbit])
        product = np.prod(multipliers(found, orbit)).real
        assert product == pytest.approx(0.64**impacts * math.exp(-0.1 * period), rel=1e-9)
    assert (found["closure"].values < 1e-8).all()
    again = il.orbits(network, start="search", periods=3)
    assert again["period"].identical(found["period"])


def test_starts():
    network = stop(frequency=2.4, gap=0.0)
    end = il.simulate(network, duration=100.0, record=[il.FinalState()])
    path = il.simulate(network, duration=50.0, record=[il.Trajectory(0.5)])
    first, second, third = (il.orbits(network, start=item) for item in (end, path, None))
    near = il.orbits(stop(frequency=2.42, gap=0.0), start=first)
    for other in (second, third):
        np.testing.assert_allclose(other["displacement"], first["displacement"], atol=1e-9)
    assert near["period"].values[0] == pytest.approx(TURN / 2.42)


def capsule(frequency=1.0):
    """A body in a shell that only dry friction holds: it drifts."""
    return il.Network(
        oscillators={"shell": il.LinearOscillator(mass=1.0), "mass": il.LinearOscillator(mass=0.5)},
        contacts={"stop": il.Contact("mass", "shell", il.LinearContact(100.0), clearance=0.02)},
        couplings={
            "ground": il.Coupling("shell", il.WALL, il.CoulombFrictionCoupling(friction=0.3)),
            "spring": il.Coupling("mass", "shell", il.LinearCoupling(stiffness=1.0, damping=0.2)),
        },
        excitations={"drive": il.Source(cosine(0.4, frequency), on={"mass": 1.0, "shell": -1.0})},
    )


def test_a_capsule_drifts_as_its_path_does():
    found = il.orbits(capsule())
    long = il.simulate(capsule(), duration=100 * TURN, record=[il.Trajectory(interval=TURN)])
    steps = np.diff(long["displacement"].sel(oscillator="shell").values[0, -20:])
    np.testing.assert_allclose(steps, found["drift"].sel(oscillator="shell").values[0], atol=1e-9)
    assert found["stable"].values[0] == 1
    assert {"slip", "stick", "turn"} <= set(found["event_kind"].values[0])


@pytest.mark.full
def test_gear_teeth_with_play_and_a_beam_at_a_soft_stop():
    gear = il.Network(
        oscillators={"pinion": il.LinearOscillator(damping=0.3), "wheel": il.LinearOscillator(mass=2.0, damping=0.4)},
        contacts=il.backlash(
            "pinion", "wheel", il.KelvinVoigtContact(stiffness=200.0, damping=2.0), clearance=0.05, name="mesh"
        ),
        couplings={"hold": il.Coupling("wheel", il.WALL, il.LinearCoupling(stiffness=5.0))},
        excitations={
            "drive": il.Source(cosine(5.0, 3.0), on="pinion"),
            "torque": il.Source(il.ConstantForce(load=2.0), on={"pinion": 1.0, "wheel": -1.0}),
        },
    )
    beam = il.beam(1.0, 1.0, 1.0, supports="cantilever", modes=10, damping_ratios=0.02, points={"tip": 1.0})
    tip = il.Network(
        oscillators={"beam": beam},
        contacts={"stop": il.Contact("beam.tip", il.WALL, il.LinearContact(50.0), clearance=0.02)},
        excitations={"force": il.Source(cosine(0.05, 3.0), on={"beam.tip": 1.0})},
    )
    for network in (gear, tip):
        found = il.orbits(network)
        end = il.simulate(network, duration=150 * float(found["period"].values[0]), record=[il.FinalState()])
        for quantity in ("displacement", "velocity"):
            size = np.abs(found[f"path_{quantity}"]).max().item()
            np.testing.assert_allclose(end[f"final_{quantity}"].values[0], found[quantity].values[0], atol=1e-7 * size)
        assert found["stable"].values[0] == 1


@pytest.mark.parametrize(
    ("network", "options", "error", "message"),
    [
        (stop(), {"section": il.Strobe(3.0)}, il.InvalidInput, "0.477464829 times that of the force"),
        (stop(), {"section": il.Crossing("a", 5.0)}, il.InvalidInput, "never crosses"),
        (stop(), {"section": il.Crossing("b")}, il.InvalidInput, "no body 'b'"),
        (stop(), {"section": il.AtContact("wall")}, il.InvalidInput, "no contact 'wall'"),
        (stop(amplitude=0.01), {"section": il.AtContact("stop")}, il.InvalidInput, "never meets"),
        (stop(), {"start": "anywhere"}, il.InvalidInput, "start is a result"),
        (stop(), {"periods": 0}, il.InvalidInput, "periods must be a whole number of at least 1"),
        (None, {}, il.InvalidInput, "must be an il.Network"),
    ],
)
def test_what_is_refused(network, options, error, message):
    with pytest.raises(error, match=message):
        il.orbits(network, **options)


def test_noise_and_forces_without_a_common_period_are_refused():
    noisy = stop().replace(excitations={"noise": il.Source(il.WhiteNoise(1.0), on="a")})
    with pytest.raises(il.InvalidInput, match=r"Random forces act on 'a'.*orbit_spread"):
        il.orbits(noisy)
    two = stop().replace(excitations={"more": il.Source(cosine(1.0, math.sqrt(2.0)), on="a")})
    with pytest.raises(il.InvalidInput, match="no common period"):
        il.orbits(two)
    late = stop().replace(excitations={"more": il.Source(il.Pulse(amplitude=1.0, duration=0.5), on="a")})
    with pytest.raises(il.InvalidInput, match="there is a Pulse"):
        il.orbits(late)


def resting_ball(share):
    """A ball on a table whose largest acceleration is a share of gravity."""
    return il.Network(
        {"ball": il.LinearOscillator(), "table": il.PrescribedMotion(il.Harmonic(share, frequency=1.0))},
        {"table": il.Contact("table", "ball", il.RigidContact(0.5), clearance=0.0)},
        {"gravity": il.BaseMotion(il.ConstantForce(1.0), on="ball")},
    )


@pytest.mark.parametrize("start", [None, "search"])
def test_a_ball_that_always_rests_forgets_how_it_came(start):
    found = il.orbits(resting_ball(0.5), start=start)
    assert found.sizes["orbit"] == 1
    assert multipliers(found).tolist() == [0.0, 0.0]
    assert found.stable.item() == 1
    moves = 0.5 * np.sin(TURN * found.phase.values)
    assert found.path_displacement.values[0, :, 0] == pytest.approx(moves, abs=1e-12)


def test_dry_friction_that_always_sticks_keeps_the_place_and_forgets_the_velocity():
    network = il.Network(
        {"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        excitations={"a": cosine(0.5, 0.7)},
        couplings={"ground": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(friction=1.0))},
    )
    assert sorted(multipliers(il.orbits(network)).real) == pytest.approx([0.0, 1.0], abs=1e-12)


def test_orbits_from_given_states(tmp_path):
    known = il.orbits(stop())
    given = {"displacement": {"a": [-0.4, 0.2]}, "velocity": {"a": [1.0, 0.3]}}
    found = il.orbits(stop(), initial=given)
    assert found.sizes["orbit"] == 1
    assert found.displacement.values == pytest.approx(known.displacement.values, abs=1e-10)
    il.save(found, tmp_path / "orbits.nc")
    assert il.rerun(tmp_path / "orbits.nc").drop_attrs().identical(found.drop_attrs())
    with pytest.raises(il.InvalidInput, match="not both"):
        il.orbits(stop(), start="search", initial=given)


@pytest.mark.parametrize("oscillator", [None, il.DuffingOscillator(damping=0.1, stiffness=1.0, cubic=1.0)])
def test_a_start_that_overlaps_is_said(oscillator):
    with pytest.raises(il.NoOrbit, match=r"contact 'stop' overlap by 0.5 m at the start"):
        il.orbits(stop(oscillator=oscillator), initial={"displacement": {"a": 1.5}})


def test_a_body_that_is_pressed_to_its_stop_begins_there():
    found = il.orbits(stop(gap=-0.1, amplitude=0.05))
    assert found.path_displacement.values == pytest.approx(np.full((1, 257, 1), -0.1), abs=1e-12)
    assert multipliers(found).tolist() == [0.0, 0.0]


@pytest.mark.full
@pytest.mark.parametrize(
    ("oscillator", "law", "gap", "places"),
    [
        (il.LinearOscillator(damping=0.1, stiffness=1.0), il.RigidContact(0.8), 1.0, "a = 0 m"),
        (il.LinearOscillator(damping=0.1, stiffness=1.0), il.HertzContact(10.0), 1.0, "a = 0 m"),
        (il.LinearOscillator(damping=0.1, stiffness=1.0), il.LinearContact(10.0), -0.1, "a = -0.09091 m"),
        (
            il.InvertedOscillator(damping=0.1, repulsion=1.0),
            il.RigidContact(0.5),
            1.0,
            "a = -1 m or a = 0 m or a = 1 m",
        ),
    ],
)
def test_paths_that_come_to_rest_are_no_orbits(oscillator, law, gap, places):
    stops = il.backlash("a", il.WALL, law, clearance=gap, name="stop")
    contacts = stops if gap > 0.0 else {"stop": il.Contact("a", il.WALL, law, clearance=gap)}
    words = f"64 of 64 paths .* came to rest, at {places}. Nothing varies in time"
    with pytest.raises(il.NoOrbit, match=words):
        il.orbits(il.Network({"a": oscillator}, contacts), start="search")


@pytest.mark.full
def test_motions_that_still_die_away_are_no_orbits():
    with pytest.raises(il.NoOrbit, match=r"2 of 2 paths .* came to rest, at a = .* Nothing varies in time"):
        il.orbits(il.Network({"a": il.DoubleWellOscillator(damping=0.1, repulsion=1.0, cubic=1.0)}))


@pytest.mark.full
def test_a_smooth_network_under_a_force_of_no_size_rests():
    """Its multipliers are those of the linear motion."""
    found = il.orbits(stop(law=il.HertzContact(10.0), amplitude=0.0, frequency=0.7), start="search")
    period = TURN / 0.7
    assert found.sizes["orbit"] == 1
    assert np.abs(found.path_displacement.values).max() < 1e-9
    rate = -0.05 + 1j * math.sqrt(1.0 - 0.05**2)
    assert np.sort_complex(multipliers(found)) == pytest.approx(
        np.sort_complex(np.exp(np.array([rate, rate.conjugate()]) * period)), abs=1e-8
    )


def test_an_orbit_that_is_not_found_is_told_with_the_nearest_return():
    pushed = {"push": il.Source(il.ConstantForce(load=1.0), on="a"), "shake": il.Source(cosine(1.0, 1.0), on="a")}
    network = il.Network(oscillators={"a": il.LinearOscillator()}, excitations=pushed)  # it goes ever faster
    words = r"up to 1 periods was found from 1 path .* nearest return, after 1, .* from \(0, 0\), and near it Newton"
    with pytest.raises(il.NoOrbit, match=words):
        il.orbits(network, periods=1)


@pytest.mark.full
def test_rerun(tmp_path):
    """Of a file, with all that orbits were found from: a section, random starts, a run, and known orbits."""
    run = il.simulate(stop(), 20.0, initial="rest", spin_up=0.0, record=[il.FinalState()])
    sought = il.orbits(stop(), il.AtContact("stop"), "search", periods=2, seed=3)
    strobed = il.orbits(stop(), il.Strobe(2.0 * TURN, start=1.0), run, periods=1)
    for found in (sought, strobed, il.orbits(stop(gap=1.01), il.Crossing("a", 0.5), sought)):
        il.save(found, tmp_path / "orbits.nc")
        assert il.rerun(tmp_path / "orbits.nc").drop_attrs().identical(found.drop_attrs())
        again = il.rerun(il.rerun(found))
        assert again.drop_attrs().identical(found.drop_attrs())
    assert il.network_of(tmp_path / "orbits.nc") == stop(gap=1.01)


def test_an_interrupt_has_the_orbits_that_were_found():
    seen = []

    def show(part):
        seen.append(part)
        if len(seen) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as raised:
        il.orbits(stop(2.7, gap=0.0), start="search", progress=show)
    found = raised.value.found
    assert found.sizes["orbit"] > 0
    assert found["closure"].values.max() < 1e-8
    assert "found" in raised.value.__notes__[0]


def test_a_diagram_is_a_start():
    """The orbit is that of the motions which the diagram has come up to, at a phase of its own."""
    law = il.RigidContact(restitution=0.8)
    section = il.Strobe(TURN / 2.7, start=0.5)
    diagram = il.bifurcation(
        lambda frequency: stop(frequency, gap=0.0, law=law), {"frequency": [2.0, 2.7]}, section=section
    )
    with pytest.raises(il.InvalidInput, match="choose one value of 'frequency'"):
        il.orbits(stop(2.7, gap=0.0, law=law), start=diagram)
    found = il.orbits(stop(2.7, gap=0.0, law=law), section, start=diagram.sel(frequency=2.7))
    assert found["periods"].item() == diagram["period"].sel(frequency=2.7).item() == 2
    points = diagram["displacement"].sel(frequency=2.7).values.ravel()
    assert np.abs(points - found["displacement"].item()).min() < 1e-9
    again = il.rerun(found)
    assert again.drop_attrs().identical(found.drop_attrs())


def sliding(amplitude=1.0, friction=0.3, frequency=0.5):
    """A body without damping, that only dry friction slows down."""
    body = {"a": il.LinearOscillator(mass=1.0, stiffness=1.0)}
    rubs = {"f": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(friction))}
    return il.Network(body, {}, {"a": il.Harmonic(amplitude, frequency=frequency)}, rubs)


def slid(state, friction, frequency):
    """Return the state a period later, by Dormand and Prince's method from stop to stop."""
    time, end, (x, v) = 0.0, TURN / frequency, state
    turns = lambda t, y: y[1]  # noqa: E731
    turns.terminal = True
    while time < end:
        pull = math.sin(frequency * time) - x
        if abs(v) < 1e-12 and abs(pull) <= friction:  # sticks until the pull is as large as the friction
            excess = lambda t, x=x: np.abs(np.sin(frequency * t) - x) - friction  # noqa: E731
            times = np.linspace(time, end, 200001)
            first = np.flatnonzero((excess(times[:-1]) <= 0.0) & (excess(times[1:]) > 0.0))
            if not len(first):
                return x, 0.0
            time = brentq(excess, *times[first[0] : first[0] + 2], xtol=1e-15)
            v, pull = 0.0, math.sin(frequency * (time + 1e-9)) - x
        way = math.copysign(1.0, v if abs(v) > 1e-12 else pull)
        rates = lambda t, y, way=way: (y[1], math.sin(frequency * t) - y[0] - way * friction)  # noqa: E731
        turns.direction = -way
        found = solve_ivp(rates, (time, end), (x, v), method="DOP853", events=turns, rtol=1e-12, atol=1e-13)
        time, (x, v) = found.t[-1], found.y[:, -1]
        if found.status == 1:
            v = 0.0
    return x, v


@pytest.mark.full
@pytest.mark.parametrize("frequency", [0.3, 0.45, 0.6])
def test_orbits_that_only_friction_damps_are_those_of_another_solver(frequency):
    found = il.orbits(sliding(frequency=frequency)).isel(orbit=0)
    state = found["displacement"].item(), found["velocity"].item()
    assert slid(state, 0.3, frequency) == pytest.approx(state, abs=1e-9)
    kinds = {"stick", "slip"} if frequency < 0.5 else {"turn"}
    assert set(found["event_kind"].values) == kinds


def test_orbits_that_are_not_apart_from_each_other():
    """The free motion comes back twice a period of the force: with X = A/(1 − ω²) the body turns at ± X + d for any
    small d, where X − A ± d is beyond the friction, and differences of velocities shrink there by the ratio of
    accelerations after and before.
    """
    largest = 1.0 / (1.0 - 0.25)
    for aside in (0.0, 0.02, -0.02):
        start = {"displacement": {"a": -2 * 0.3 + aside}, "velocity": {"a": 0.5 * largest}}
        found = il.orbits(sliding(), initial=start).isel(orbit=0)
        assert found["displacement"].item() == pytest.approx(-0.6 + aside, abs=1e-12)
        assert found["event_kind"].values.tolist() == ["turn", "turn"]
        pulls = largest - 1.0 + np.array([aside, -aside])
        shrinks = np.prod((pulls - 0.3) / (pulls + 0.3))
        np.testing.assert_allclose(found["multiplier_real"].values, [1.0, shrinks], atol=1e-9)
        assert found["stable"].item() == 0
        assert found["closure"].item() < 1e-12
        assert slid((found["displacement"].item(), found["velocity"].item()), 0.3, 0.5) == pytest.approx(
            (found["displacement"].item(), found["velocity"].item()), abs=1e-9
        )
    with pytest.raises(il.NoOrbit, match=r"a multiplier is 0\.99"):  # a path comes up to the last of these like 1/n
        il.orbits(sliding())
