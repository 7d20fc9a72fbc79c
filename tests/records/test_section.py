"""Sections of motions: at strobes, contacts and levels, from event to event and between steps."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il

PERIOD = 2.0 * math.pi / 0.8
STEPS = il.ExactFlow()


def network(law, **changes):
    body = il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.1)
    stop = il.Contact("a", il.WALL, law, clearance=0.2)
    return il.Network({"a": body}, {"stop": stop}, {"a": il.Harmonic(0.6, frequency=0.8)}, **changes)


def run(law, surface, record=(), duration=6.0 * PERIOD, most=1000, **options):
    records = [il.Section(surface, most=most), *record]
    return il.simulate(network(law), duration, spin_up=0.0, initial="rest", record=records, **options)


def test_a_look_where_two_runs_join_is_one():
    first = run(il.RigidContact(0.8), il.Strobe(PERIOD), [il.FinalState(continues=True)], 3.0 * PERIOD)
    second = il.simulate(
        network(il.RigidContact(0.8)), 3.0 * PERIOD, initial=first, continues=True, record=il.Section(il.Strobe(PERIOD))
    )
    times = np.concatenate([first.section_time.values[0], second.section_time.values[0]])
    assert times == pytest.approx(PERIOD * np.arange(7))


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few independent samples")
@pytest.mark.parametrize("start", [0.0, 0.3, -0.65])
@pytest.mark.parametrize("end", [0.35, 4.2, 4.55])
def test_a_run_with_steps_that_goes_on_looks_at_the_phases_of_one_in_one_go(start, end):
    body = {"a": il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.1)}
    noisy = il.Network(body, {}, {"a": il.WhiteNoise(0.1)})
    looks, last = il.Section(il.Strobe(0.7, start=start)), il.FinalState(continues=True)
    options = {"rng": 1, "step": 0.05, "realizations": 3, "spin_up": 0.0, "initial": "rest"}
    whole = il.simulate(noisy, 10.0, record=looks, **options)
    first = il.simulate(noisy, end, record=[looks, last], **options) if end > 0.7 else None
    part = first if first is not None else il.simulate(noisy, end, record=last, **options)
    second = il.simulate(noisy, 10.0 - end, initial=part, continues=True, record=looks)
    number = second.sizes["section"]
    for name in ("section_time", "section_displacement", "section_velocity"):
        np.testing.assert_allclose(second[name].values, whole[name].values[:, -number:], rtol=1e-14, atol=0.0)
    if first is not None:
        assert first.sizes["section"] + number == whole.sizes["section"]
    assert second["section_time"].min() > end + 1e-9


def test_a_section_that_is_never_met_is_said():
    with pytest.warns(il.ImpactLabWarning, match=r"never meets Crossing\(body='a', level=5.0\)"):
        data = run(il.RigidContact(0.8), il.Crossing("a", 5.0))
    assert data.section_points.values.tolist() == [0]


def points(data):
    """Times, displacements and velocities of the only realization."""
    return (data[f"section_{name}"].values[0].squeeze() for name in ("time", "displacement", "velocity"))


def independent(restitution, duration):
    """Events and path of the rigid stop by DOP853: times and closing velocities of impacts, and the path."""

    def rates(t, y):
        return [y[1], 0.6 * math.sin(0.8 * t) - 0.1 * y[1] - y[0]]

    def wall(t, y):
        return y[0] - 0.2

    wall.terminal, wall.direction = True, 1.0
    time, state, impacts, parts = 0.0, [0.0, 0.0], [], []
    while time < duration:
        found = solve_ivp(
            rates, (time, duration), state, "DOP853", events=wall, rtol=1e-13, atol=1e-14, dense_output=True
        )
        parts.append(found.sol)
        time, state = found.t[-1], [0.2, -restitution * found.y[1, -1]]
        if found.status == 1:
            impacts.append((time, found.y[1, -1]))
    return np.array(impacts), parts


def test_a_strobe_of_any_phase_beside_a_trajectory_of_another_interval():
    impacts, parts = independent(0.8, 6.0 * PERIOD)
    data = run(il.RigidContact(0.8), il.Strobe(PERIOD, start=0.3 - PERIOD), [il.Trajectory(0.7)])
    assert data.attrs["integrator"] == "EventLocated"
    times, x, v = points(data)
    assert times == pytest.approx(0.3 + PERIOD * np.arange(6), abs=1e-14)
    for time, place, rate in zip(times, x, v, strict=True):
        part = parts[int(np.searchsorted(impacts[:, 0], time))]
        assert [place, rate] == pytest.approx(part(time), abs=1e-9)
    alone = il.simulate(
        network(il.RigidContact(0.8)), 6.0 * PERIOD, spin_up=0.0, initial="rest", record=il.Trajectory(0.7)
    )
    assert data.contact_force.values == pytest.approx(alone.contact_force.values, abs=1e-12)  # impulses over intervals
    assert data.time.values.tolist() == alone.time.values.tolist()


@pytest.mark.parametrize("side", ["closing", "leaving"])
def test_at_a_rigid_contact_there_are_the_states_before_and_after_impacts(side):
    impacts, _ = independent(0.8, 6.0 * PERIOD)
    data = run(il.RigidContact(0.8), il.AtContact("stop", side))
    times, x, v = points(data)
    assert times == pytest.approx(impacts[:, 0], abs=1e-9)
    assert x == pytest.approx(np.full(len(x), 0.2), abs=1e-13)
    closing = impacts[:, 1]
    assert v == pytest.approx(closing if side == "closing" else -0.8 * closing, abs=1e-9)
    assert data.section_contact_velocity.values[0] == pytest.approx(np.abs(v), rel=1e-14)
    assert data.section_points.values.tolist() == [len(times)]


@pytest.mark.full
@pytest.mark.parametrize("law", [il.LinearContact(60.0), il.HertzContact(60.0)])
def test_levels_are_crossed_where_the_path_crosses_them(law):
    """Sections are no contacts: statistics of contacts are those of the network."""
    for direction, sign in (("up", 1.0), ("down", -1.0)):
        data = run(law, il.Crossing("a", 0.05, direction), [il.Impacts()])
        times, x, v = points(data)
        assert x == pytest.approx(np.full(len(x), 0.05), abs=1e-10)
        assert (sign * v > 0.0).all()
        assert data.contact.values.tolist() == ["stop"]
        path = run(law, il.Crossing("a", 0.05, direction), [il.Trajectory(PERIOD / 400)])
        gap = sign * (path.displacement.values[0, :, 0] - 0.05)
        assert len(times) == ((gap[:-1] < 0.0) & (gap[1:] >= 0.0)).sum()
        assert path.section_time.values[0] == pytest.approx(times, abs=1e-8)


@pytest.mark.full
def test_between_steps_crossings_are_those_of_the_path():
    law = il.HertzContact(60.0)
    for surface in (il.AtContact("stop"), il.Crossing("a", 0.05, "down")):
        exact = run(law, surface)
        steps = run(law, surface, integrator=STEPS)
        assert steps.attrs["integrator"] == "ExactFlow"
        for name in ("section_time", "section_velocity"):
            assert steps[name].values == pytest.approx(exact[name].values, abs=1e-4)
        assert "cubic" in steps.section_time.attrs["comment"]


@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_under_noise_realizations_have_points_of_their_own():
    noisy = network(il.HertzContact(60.0)).replace(excitations={"a": il.WhiteNoise(0.02)})
    record = [il.Section(il.Crossing("a", 0.0, "up"), keep=5), il.Trajectory(0.05)]
    data = il.simulate(noisy, 60.0, realizations=3, rng=1, record=record)
    path = data.displacement.values[:, :, 0]
    assert data.section_time.dims == ("realization", "section")
    for lane in range(3):
        crossed = np.flatnonzero((path[lane, :-1] < 0.0) & (path[lane, 1:] >= 0.0))[-5:]
        assert (np.abs(data.section_time.values[lane] - 0.05 * (crossed + 0.5)) <= 0.026).all()


def test_sections_are_part_of_sweeps_and_rerun():
    def make(force):
        return network(il.RigidContact(0.8)).replace(excitations={"a": il.Harmonic(force, frequency=0.8)})

    data = il.sweep(make, {"force": [0.3, 0.6]}, duration=20.0 * PERIOD, record=il.Section(il.Strobe(PERIOD), keep=4))
    assert data.section_displacement.dims == ("force", "realization", "section", "oscillator")
    again = il.rerun(data.isel(force=1))
    assert again.section_displacement.values.tolist() == data.section_displacement.values[1].tolist()


def test_frequencies_of_a_sweep_run_in_one_call(monkeypatch):
    from impactlab.located import findings

    calls = []
    monkeypatch.setattr(findings, "_course", lambda *given, own=findings._course: calls.append(1) or own(*given))

    def make(frequency):
        made = network(il.RigidContact(0.8)).replace(excitations={"a": il.Harmonic(0.6, frequency=frequency)})
        period = 2.0 * math.pi / frequency
        return made, {"duration": 5.0 * period, "spin_up": 7.0 * period, "record": il.Section(il.Strobe(period))}

    data = il.sweep(make, {"frequency": [0.7, 0.8, 0.9]}, initial="rest")
    assert len(calls) == 1
    network_, options = make(0.9)
    alone = il.simulate(network_, initial="rest", **options)
    assert data.section_displacement.values[2].tolist() == alone.section_displacement.values.tolist()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: il.AtContact("stop", "opening"), "'closing' or 'leaving'"),
        (lambda: il.Section(0.5), "surface"),
        (lambda: run(il.RigidContact(0.8), il.AtContact("stpo")), "no contact 'stpo'"),
        (lambda: run(il.RigidContact(0.8), il.Crossing("b")), "no oscillator 'b'"),
        (lambda: run(il.RigidContact(0.8), il.AtContact("stop"), integrator=STEPS), "is rigid"),
        (lambda: run(il.RigidContact(0.8), il.Strobe(1.0), [], 9.0, integrator=il.EventLocated(), most=3), "keep="),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(il.InvalidInput, match=message):
        make()
