"""Bifurcation diagrams against brute force, and against motions that are known in closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il


def body(**numbers):
    return il.LinearOscillator(**{"damping": 0.1, "stiffness": 1.0, **numbers})


def stopped(amplitude, law=None, frequency=0.8, clearance=0.2):
    wall = il.Contact("a", il.WALL, law or il.LinearContact(60.0), clearance=clearance)
    return il.Network({"a": body()}, {"stop": wall}, {"a": il.Harmonic(amplitude, frequency=frequency)})


def struck(frequency, amplitude=1.0):
    return stopped(amplitude, il.RigidContact(0.8), frequency, 0.0)


def strobed(force, state, period, number):
    """States at whole periods, by steps that end where a force has a kink: `force` returns one of each sign."""
    found, bend = [state], lambda time, state: force(time, state)[1]
    for turn in range(number):
        time, state, end = turn * period, found[-1], (turn + 1) * period
        bend.terminal = True
        while time < end:
            path = solve_ivp(
                lambda time, state: force(time, state)[0], (time, end), state, "DOP853", rtol=1e-12, atol=1e-13,
                events=bend,
            )  # fmt: skip
            time, state = path.t[-1], path.y[:, -1]
            if time < end:  # beyond the kink
                after = min(1e-9, end - time)
                time, state = time + after, state + after * np.array(force(time, state)[0])
        found.append(state)
    return np.array(found)


def test_points_are_those_of_runs():
    amplitudes, period = np.linspace(0.05, 0.6, 12), 2 * np.pi / 0.8
    found = il.bifurcation(stopped, {"amplitude": amplitudes})
    runs = il.sweep(
        stopped, {"amplitude": amplitudes}, duration=279 * period, initial="rest", spin_up=0.0,
        record=il.Trajectory(period, start=200 * period), integrator=il.EventLocated(),
    )  # fmt: skip
    for name in ("displacement", "velocity"):
        kept = runs[name].isel(realization=0).values
        assert np.abs(found[name].isel(start=0).values - kept).max() < 1e-9
    assert set(found.period.values.ravel()) >= {1, 2}
    assert found.section_period.values == pytest.approx(period)
    assert set(found.status.values) == {"done"}


def test_periods_and_impacts_of_a_struck_body():
    """One impact in a period is stable between the two frequencies at which a multiplier is -1."""
    low, high = 1.2297353466, 2.6588845467
    found = il.bifurcation(struck, {"frequency": [low + 0.1, 2.0, high - 2e-2, high + 1e-3]}, transient=3000)
    assert found.period.values.ravel().tolist() == [1, 1, 1, 2]
    assert found.impacts.values.ravel() == pytest.approx(1.0, abs=1e-12)


def test_values_of_their_own_periods_do_not_depend_on_others():
    several = il.bifurcation(struck, {"frequency": [1.7, 2.0, 2.8]}, transient=20, keep=16)
    alone = il.bifurcation(struck, {"frequency": [2.8]}, transient=20, keep=16)
    assert (several.displacement.sel(frequency=2.8) == alone.displacement.sel(frequency=2.8)).all()


@pytest.mark.full
def test_following_shows_both_branches_of_a_duffing_oscillator():
    def driven(frequency):
        oscillator = il.DuffingOscillator(damping=0.1, stiffness=1.0, cubic=1.0)
        return il.Network({"a": oscillator}, excitations={"a": il.Harmonic(0.3, frequency=frequency)})

    frequencies = np.round(np.arange(1.2, 1.95, 0.1), 1)
    up, down = (
        il.bifurcation(driven, {"frequency": frequencies}, follow=way, transient=200, keep=4) for way in ("up", "down")
    )
    apart = np.abs(up.displacement - down.displacement).max(("start", "point", "oscillator")).values
    assert (apart[[0, -1]] < 1e-7).all()
    assert (apart[[2, 5]] > 0.3).all()
    for frequency in (1.4, 1.7):
        for branch in (up, down):
            one = branch.sel(frequency=frequency, start=0, oscillator="a")
            begin = [one.displacement[0].item(), one.velocity[0].item()]

            def force(time, state, frequency=frequency):
                x, v = state
                return (v, 0.3 * np.sin(frequency * time) - 0.1 * v - x - x**3), 1.0

            around = strobed(force, begin, 2 * np.pi / frequency, 2)
            assert np.abs(around[-1] - begin).max() < 1e-7


@pytest.mark.full
def test_a_hertz_stop_agrees_with_brute_force():
    found = il.bifurcation(lambda amplitude: stopped(amplitude, il.HertzContact(60.0)), {"amplitude": [0.5]}, keep=8)

    def force(time, state):
        x, v = state
        return (v, 0.5 * np.sin(0.8 * time) - 0.1 * v - x - 60.0 * max(x - 0.2, 0.0) ** 1.5), x - 0.2

    begin = [found.displacement[0, 0, 0, 0].item(), found.velocity[0, 0, 0, 0].item()]
    points = strobed(force, begin, 2 * np.pi / 0.8, 4)
    kept = np.stack([found.displacement.values[0, 0, :5, 0], found.velocity.values[0, 0, :5, 0]], axis=1)
    assert np.abs(points - kept).max() < 1e-7


@pytest.mark.full
def test_a_beam_of_ten_modes_at_a_stop_agrees_with_brute_force():
    modes = il.beam(
        1.0, 1.0, 1.0, supports="cantilever", modes=10, damping_ratios=0.02, points={"tip": 1.0}
    )  # fmt: skip

    def network(amplitude):
        wall = il.Contact("beam.tip", il.WALL, il.LinearContact(500.0), clearance=0.05)
        ground = il.BaseMotion(il.Harmonic(amplitude, frequency=3.0))
        return il.Network({"beam": modes}, {"stop": wall}, {"ground": ground})

    found = il.bifurcation(network, {"amplitude": [0.5]}, transient=1, keep=5)
    compiled = network(0.5).compile()
    tip = np.array([network(0.5).points["beam.tip"].get(name, 0.0) for name in network(0.5).oscillators])

    def force(time, state):
        return compiled.rhs(time, state), tip @ state[:10] - 0.05

    points = strobed(force, np.zeros(20), 2 * np.pi / 3.0, 5)[1:]
    kept = np.concatenate([found.displacement.values[0, 0], found.velocity.values[0, 0]], axis=1)
    assert np.abs(points - kept).max() < 1e-7


@pytest.mark.full
def test_gear_teeth_with_play_both_ways_agree_with_brute_force():
    def network(amplitude):
        gears = {name: body(stiffness=0.1) for name in "ab"}
        teeth = il.backlash("a", "b", il.KelvinVoigtContact(60.0, damping=1.0), clearance=0.2, name="teeth")
        return il.Network(gears, teeth, {"a": il.Harmonic(amplitude, frequency=0.8)})

    found = il.bifurcation(network, {"amplitude": [0.5]}, transient=1, keep=5)

    def force(time, state):
        x, v = state[:2], state[2:]
        gap, rate = x[0] - x[1], v[0] - v[1]
        push = max(60.0 * (gap - 0.2) + rate, 0.0) if gap > 0.2 else 0.0
        push -= max(-60.0 * (gap + 0.2) - rate, 0.0) if gap < -0.2 else 0.0
        pulled = np.array([0.5 * np.sin(0.8 * time) - push, push]) - 0.1 * v - 0.1 * x
        return np.concatenate([v, pulled]), 1.0

    times = np.linspace(0.0, 2 * np.pi / 0.8 * 5, 6)
    path = solve_ivp(
        lambda *at: force(*at)[0], times[[0, -1]], np.zeros(4), "DOP853", times, rtol=1e-11, atol=1e-12, max_step=5e-3
    )
    kept = np.concatenate([found.displacement.values[0, 0], found.velocity.values[0, 0]], axis=1)
    assert np.abs(path.y.T[1:] - kept).max() < 1e-5  # steps go over kinks


def capsule(amplitude):
    bodies = {"capsule": il.LinearOscillator(mass=1.0), "mass": il.LinearOscillator(mass=0.5)}
    stop = {"wall": il.Contact("mass", "capsule", il.LinearContact(20.0), clearance=0.05)}
    couplings = {
        "spring": il.Coupling("mass", "capsule", il.LinearCoupling(stiffness=1.0, damping=0.05)),
        "ground": il.Coupling("capsule", il.WALL, il.CoulombFrictionCoupling(friction=0.3)),
    }
    drive = il.Source(il.Harmonic(amplitude, frequency=0.9), on={"mass": 1.0, "capsule": -1.0})
    return il.Network(bodies, stop, {"drive": drive}, couplings)


def test_a_capsule_with_dry_friction_that_moves_on_agrees_with_brute_force():
    found = il.bifurcation(capsule, {"amplitude": [0.6]}, keep=12)
    assert found.period.item() == 1  # but for the way that it has made
    period, step = found.section_period.item(), 1.0 / 40_000
    x, v = found.displacement.values[0, 0, 0].copy(), found.velocity.values[0, 0, 0].copy()
    begin, number = x.copy(), 40_000
    for turn in range(number):  # symplectic Euler, whose friction holds whatever it can hold
        time = (turn + 0.5) * step * period
        gap = x[1] - x[0]
        inner = gap + 0.05 * (v[1] - v[0]) + 20.0 * max(gap - 0.05, 0.0) - 0.6 * np.sin(0.9 * time)
        v[1] -= step * period * inner / 0.5
        free = v[0] + step * period * inner
        v[0] = np.sign(free) * max(abs(free) - 0.3 * step * period, 0.0)
        x += step * period * v
    assert x - begin == pytest.approx(np.diff(found.displacement.values[0, 0, :2], axis=0)[0], abs=1e-3)
    assert np.ptp(np.diff(found.displacement.values[0, 0], axis=0), axis=0).max() < 1e-9


@pytest.mark.full
def test_starts_find_both_wells():
    def wells(amplitude):
        oscillator = il.DoubleWellOscillator(damping=0.3, cubic=1.0, repulsion=1.0)
        return il.Network({"a": oscillator}, excitations={"a": il.Harmonic(amplitude, frequency=1.0)})

    starts = {"displacement": {"a": [-1.0, 1.0]}}
    found = il.bifurcation(wells, {"amplitude": [0.05]}, initial=starts, keep=4)
    assert np.sign(found.displacement.values[0, :, :, 0]).tolist() == [[-1.0] * 4, [1.0] * 4]
    assert found.period.values.tolist() == [[1, 1]]
    random = il.bifurcation(stopped, {"amplitude": [0.3, 0.5]}, starts=3, rng=1, transient=40, keep=10)
    again = il.bifurcation(stopped, {"amplitude": [0.5]}, starts=3, rng=1, transient=40, keep=10)
    assert (random.displacement.sel(amplitude=0.5) == again.displacement.sel(amplitude=0.5)).all()


def test_a_given_function_and_a_strobe_of_its_period():
    times = np.linspace(0.0, 5.0, 41)
    force = il.SampledForce(times, 0.5 * np.sin(2 * np.pi * times / 5.0), after="repeat")

    def network(clearance):
        wall = il.Contact("a", il.WALL, il.RigidContact(0.5), clearance=clearance)
        return il.Network({"a": body()}, {"stop": wall}, {"a": force})

    found = il.bifurcation(network, {"clearance": [0.1, 0.3]}, transient=100, keep=6)
    assert (found.section_period == 5.0).all()
    assert (found.period == 1).all()
    run = il.simulate(network(0.1), 525.0, initial="rest", spin_up=0.0, record=il.Trajectory(5.0, start=500.0))
    assert np.abs(run.displacement.values[0, :, 0] - found.displacement.values[0, 0, :, 0]).max() < 1e-9


def test_a_strobe_at_another_phase():
    period = 2 * np.pi / 0.8
    shifted = il.bifurcation(stopped, {"amplitude": [0.3]}, section=il.Strobe(period, start=2.0), keep=4)
    run = il.simulate(stopped(0.3), 2.0 + 300 * period, initial="rest", spin_up=0.0, record=il.FinalState())
    ends = run.final_displacement.item(), run.final_velocity.item()
    kept = shifted.displacement[0, 0, 0, 0].item(), shifted.velocity[0, 0, 0, 0].item()
    assert kept == pytest.approx(ends, abs=1e-9)


def test_bodies_of_given_motion():
    def network(amplitude):
        wall = il.Contact("a", "table", il.RigidContact(0.5), clearance=0.1)
        table = il.PrescribedMotion(il.Harmonic(amplitude, frequency=2.0, phase=0.3))
        return il.Network({"a": body(), "table": table}, {"stop": wall})

    found = il.bifurcation(network, {"amplitude": [0.2]}, keep=3)
    assert found.displacement.sel(oscillator="table").values.ravel() == pytest.approx(0.2 * np.sin(0.3))
    assert il.bifurcation(network, {"amplitude": [0.2]}, names="a").sizes["oscillator"] == 1


def test_what_was_found_is_kept_where_a_point_is_refused():
    def network(amplitude):
        noise = il.WhiteNoise(1.0) if amplitude > 0.5 else il.Harmonic(amplitude, frequency=0.8)
        return il.Network({"a": body()}, excitations={"a": noise})

    found = il.bifurcation(network, {"amplitude": [0.4, 0.6]}, keep=4)
    assert found.status[0] == "done"
    assert "il.sweep" in found.status.values[1]
    assert found.period.values.ravel().tolist() == [1, -1]
    assert np.isnan(found.displacement[1]).all()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"over": {}}, "one or two parameters"),
        ({"over": {"amplitude": []}}, "has no values"),
        ({"section": il.Strobe(3.0)}, "no whole number of periods of 7.85398163"),
        ({"names": "b"}, "there is no oscillator 'b'"),
        ({"names": ()}, "leave it out"),
        ({"follow": "left"}, '"up", "down" or None'),
        ({"keep": 1}, "at least 2"),
        ({"starts": 0}, "at least 1"),
        ({"tolerance": 0.0}, "larger than 0"),
        ({"initial": {"displacement": {"a": [0.0, 0.1]}}, "starts": 3}, "leave out starts="),
        ({"initial": {"displacement": {"a": 0.5}}, "law": il.RigidContact(0.5)}, "overlap by"),
        ({"force": il.WhiteNoise(1.0)}, "a noise moves 'a'"),
        ({"force": il.ConstantForce(1.0)}, "give section="),
        ({"force": il.Chirp(1.0, start_frequency=1.0, end_frequency=2.0, duration=10.0)}, "is not known"),
    ],
)
def test_bad_input(given, words):
    law, force = given.pop("law", None), given.pop("force", None)

    def network(amplitude):
        made = stopped(amplitude, law)
        return made.replace(excitations={"a": force}) if force else made

    over = given.pop("over", {"amplitude": [0.3]})
    with pytest.raises(il.InvalidInput, match=words):
        il.bifurcation(network, over, **given)


def test_forces_without_a_common_period_are_refused():
    def network(amplitude):
        waves = {"one": il.Harmonic(amplitude, frequency=1.0), "other": il.Harmonic(amplitude, frequency=other)}
        sources = {name: il.Source(wave, on={"a": 1.0}) for name, wave in waves.items()}
        return il.Network({"a": body()}, excitations=sources)

    other = np.sqrt(2.0)
    with pytest.raises(il.InvalidInput, match="no common period"):
        il.bifurcation(network, {"amplitude": [0.3]})
    other = 1.5
    assert il.bifurcation(network, {"amplitude": [0.3]}).section_period.item() == pytest.approx(4 * np.pi)


def test_rerun_and_citation(tmp_path):
    given = {"starts": 2, "rng": 1, "transient": 30, "keep": 8, "follow": "down"}
    found = il.bifurcation(stopped, {"amplitude": [0.2, 0.3], "frequency": [0.7, 0.8]}, **given)
    il.save(found, tmp_path / "diagram.nc")
    again = il.rerun(tmp_path / "diagram.nc")
    assert again.drop_attrs().identical(found.drop_attrs())
    assert "software{impactlab" in il.citation(found)
    assert il.network_of(found.isel(amplitude=0, frequency=1)) == stopped(0.2, frequency=0.8)


def struck_map(frequency, amplitude):
    return stopped(amplitude, il.RigidContact(0.8), frequency, 0.3)


def test_a_map_of_periods_from_few_networks_is_that_from_all(monkeypatch):
    values = {"frequency": np.linspace(0.8, 2.6, 12), "amplitude": np.linspace(0.2, 1.4, 11)}
    every = il.bifurcation(struck_map, values, transient=100, keep=60)
    assert "displacement" not in every
    monkeypatch.setattr("impactlab.analysis.diagram_points.FEWEST_POINTS", 10)
    few = il.bifurcation(struck_map, values, transient=100, keep=60)
    assert few.sizes["network"] < 60
    apart = np.abs(every.impacts - few.impacts).isel(contact=0).where(every.period > 0, 0.0)
    same = (every.period == few.period) & (apart < 1e-12)
    assert same.sum() >= same.size - 1  # rounding may lead from the edge of a basin to the other side
    assert few.section_period.values == pytest.approx(every.section_period.values, rel=1e-12)
    assert il.rerun(few).drop_attrs().identical(few.drop_attrs())


def test_networks_that_are_no_family_are_made_one_by_one(monkeypatch):
    monkeypatch.setattr("impactlab.analysis.diagram_points.FEWEST_POINTS", 2)

    def network(amplitude):
        if amplitude > 0.5:
            raise il.InvalidInput("Too large.")
        return stopped(amplitude)

    found = il.bifurcation(network, {"amplitude": [0.1, 0.3, 0.6]}, transient=20, keep=10)
    assert found.status.values.tolist() == ["done", "done", "Too large."]


def test_an_interrupted_run_keeps_what_was_found(monkeypatch):
    monkeypatch.setattr("impactlab.analysis.bifurcation.LANES_AT_A_TIME", 1)

    def interrupt(part):
        if part > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as raised:
        il.bifurcation(stopped, {"amplitude": [0.1, 0.2, 0.3]}, transient=20, keep=10, progress=interrupt)
    found = raised.value.found
    assert found.status.values.tolist() == ["done", "interrupted", "interrupted"]
    assert np.isfinite(found.displacement[0]).all()


def test_impacts_are_points_of_a_section_at_a_contact():
    """COCO's example 15.2, whose closing velocity and phase follow from a quadratic equation."""

    def network(amplitude):
        wall = il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=1.0)
        return il.Network(
            {"a": body()}, {"wall": wall}, {"a": il.Harmonic(amplitude, frequency=1.0, phase=np.pi / 2)}
        )  # fmt: skip

    found = il.bifurcation(network, {"amplitude": [1.0]}, section=il.AtContact("wall"), keep=10)
    assert found.period.item() == 1
    assert found.impacts.item() == 1.0
    assert found.displacement.values.ravel() == pytest.approx(1.0, abs=found.path_error.item())
    assert found.velocity.values.ravel() == pytest.approx(1.695732938, abs=1e-9)
    assert found.section_time.values.ravel() % (2 * np.pi) == pytest.approx(0.075952165, abs=1e-9)
    left = il.bifurcation(network, {"amplitude": [1.0]}, section=il.AtContact("wall", "leaving"), keep=10)
    assert left.velocity.values.ravel() == pytest.approx(-0.8 * 1.695732938, abs=1e-9)


def test_crossings_of_a_level_and_following():
    section = il.Crossing("a", 0.0, "up")
    found = il.bifurcation(
        lambda amplitude: stopped(amplitude, clearance=9.0), {"amplitude": [0.5, 1.0]}, section=section, follow="down"
    )  # fmt: skip
    response = 1.0 / np.hypot(1.0 - 0.8**2, 0.1 * 0.8)
    for amplitude in (0.5, 1.0):
        points = found.sel(amplitude=amplitude)
        assert points.velocity.values.ravel() == pytest.approx(0.8 * amplitude * response, abs=1e-8)
    assert (found.period == 1).all()
    assert (found.impacts == 0.0).all()


@pytest.mark.full
def test_sections_of_smooth_laws_and_of_motions_without_a_force():
    section = il.AtContact("stop")
    found = il.bifurcation(
        lambda amplitude: stopped(amplitude, il.HertzContact(60.0)), {"amplitude": [0.5]}, section=section, keep=9
    )  # fmt: skip
    strobed = il.bifurcation(lambda amplitude: stopped(amplitude, il.HertzContact(60.0)), {"amplitude": [0.5]}, keep=9)
    assert found.displacement.values.ravel() == pytest.approx(0.2, abs=1e-9)
    assert found.period.item() == strobed.period.item() * strobed.impacts.item()
    free = il.bifurcation(
        lambda growth: il.Network({"a": il.VanDerPolOscillator(stiffness=1.0, growth=growth)}),
        {"growth": [0.5]}, section=il.Crossing("a", 0.0, "up"), initial={"velocity": {"a": 1.0}}, keep=9,
        transient=50,
    )  # fmt: skip
    assert free.period.item() == 1


def test_a_section_that_is_not_met_is_refused_and_the_others_are_kept():
    section = il.Crossing("a", 0.25, "up")
    found = il.bifurcation(stopped, {"amplitude": [0.05, 0.5]}, section=section, transient=20, keep=6)
    assert "is never met;" in found.status.values[0]
    assert found.status.values[1] == "done"
    with pytest.raises(il.InvalidInput, match="no contact 'wall'"):
        il.bifurcation(stopped, {"amplitude": [0.1]}, section=il.AtContact("wall"))
    with pytest.raises(il.InvalidInput, match="no oscillator 'b'"):
        il.bifurcation(stopped, {"amplitude": [0.1]}, section=il.Crossing("b"))


def test_laws_as_values():
    laws = [il.RigidContact(0.5), il.RigidContact(0.8)]
    found = il.bifurcation(lambda law: stopped(0.3, law), {"law": laws}, transient=20, keep=6)
    assert found.law.values.tolist() == [repr(law) for law in laws]
    assert il.rerun(found).drop_attrs().identical(found.drop_attrs())


def test_a_point_that_cannot_be_followed_leaves_the_others():
    """Without damping the force drives the body at its natural frequency without end."""

    def undamped(frequency):
        bodies = {"a": body(damping=0.0)}
        return il.Network(bodies, stopped(1.0).contacts, {"a": il.Harmonic(1.0, frequency=frequency)})

    found = il.bifurcation(undamped, {"frequency": [0.8, 1.0, 1.2]}, transient=5, keep=8)
    assert found.status.values[[0, 2]].tolist() == ["done", "done"]
    assert "undamped mode at its natural frequency" in str(found.status.values[1])
    assert found.period.values[1, 0] == -1


def test_a_part_of_a_diagram_can_be_made_again():
    found = il.bifurcation(struck, {"frequency": [2.0, 2.3, 2.6]}, transient=20, keep=8)
    again = il.rerun(found.isel(frequency=slice(0, 2)))
    np.testing.assert_array_equal(again.displacement, found.displacement[:2])


def test_a_slider_begins_where_its_states_say():
    """A law with two states, whose arrays are neither those of starts nor of bodies."""

    def sliding(amplitude):
        slider = il.Coupling("a", il.WALL, il.JenkinsCoupling(5.0, slip_force=0.3))
        return stopped(amplitude).replace(couplings={"slider": slider})

    found = il.bifurcation(sliding, {"amplitude": [0.8]}, transient=20, keep=8, starts=3, rng=1)
    period = 2.0 * np.pi / 0.8
    options = {"spin_up": 0.0, "initial": "rest", "record": il.Section(il.Strobe(period))}
    path = il.simulate(sliding(0.8), 28.0 * period, **options)
    np.testing.assert_allclose(found.displacement[0, :, -1, 0], path.section_displacement[0, -1, 0].item(), atol=1e-9)


def on_belt(speed, friction=1.0, ratio=1.5, damping=0.05):
    """A body that a moving belt carries along until it slips: nothing varies in time."""
    law = il.CoulombFrictionCoupling(friction, static_ratio=ratio, velocity=speed)
    body = {"a": il.LinearOscillator(mass=1.0, stiffness=1.0, damping=damping)}
    return il.Network(body, {}, {}, {"belt": il.Coupling("a", il.WALL, law)})


def test_stick_and_slip_on_a_belt_over_its_speed():
    """From the end of a stick, where the spring and the damper pull as hard as the breakaway force, to the next one."""
    speeds = [0.1, 0.3, 0.5]
    found = il.bifurcation(on_belt, {"speed": speeds}, section=il.Crossing("a", 1.2, "down"), keep=20)
    assert found["period"].values.ravel().tolist() == [1, 1, 1]
    for place, speed in enumerate(speeds):
        begin = 1.5 - 0.05 * speed
        slips = solve_ivp(
            lambda t, y: (y[1], 1.0 - y[0] - 0.05 * y[1]), (0.0, 20.0), (begin, speed), method="DOP853", rtol=1e-12,
            atol=1e-13, events=[lambda t, y, speed=speed: y[1] - speed, lambda t, y: y[0] - 1.2],
            dense_output=True,
        )  # fmt: skip
        again = next(time for time in slips.t_events[0] if time > 1.0)
        length = again + (begin - slips.sol(again)[0]) / speed
        crossed = slips.sol(slips.t_events[1][0])[1]
        np.testing.assert_allclose(found["velocity"].values[place, 0, :, 0], crossed, rtol=1e-8)
        np.testing.assert_allclose(np.diff(found["section_time"].values[place, 0]), length, rtol=1e-8)
