"""Motion from event to event is the usual method where nothing is random; where it is not, the result says why."""

import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.located import limits
from impactlab.located.requests import usual_run
from impactlab.simulation.growing_ensemble import request_of

PERIOD = 2.0 * math.pi / 0.8
REASON = "integrator_reason"


def stop(force=0.7, stiffness=60.0, damping=0.1, noise=0.0, law=None):
    """A body at a stop under a harmonic force, or under noise."""
    return il.Network(
        {"a": il.LinearOscillator(damping=damping, stiffness=1.0)},
        {"g": il.Contact("a", il.WALL, law or il.LinearContact(stiffness), clearance=0.2)},
        {"a": il.WhiteNoise(noise) if noise else il.Harmonic(force, frequency=0.8)},
    )


def resonant(stiffness=0.64):
    return il.Network({"a": il.LinearOscillator(stiffness=stiffness)}, {}, {"a": il.Harmonic(1.0, frequency=0.8)})


def chain(bodies, law):
    return il.Network(
        {f"b{number}": il.LinearOscillator(damping=0.02, stiffness=1.0) for number in range(bodies)},
        {f"c{number}": il.Contact(f"b{number}", f"b{number + 1}", law, clearance=0.1) for number in range(bodies - 1)},
        {"b0": il.Harmonic(0.7, frequency=0.8)},
    )


def assert_same(found, other):
    assert set(found.data_vars) == set(other.data_vars)
    for name in other.data_vars:
        np.testing.assert_array_equal(found[name], other[name], err_msg=name)


def test_a_path_without_noise_is_right_to_ten_digits_and_says_so():
    data = il.simulate(stop(), 4 * PERIOD, initial="rest", record=il.Trajectory(PERIOD))
    assert data.attrs["integrator"] == "EventLocated"
    assert data.attrs[REASON].startswith("Chosen since nothing is random")
    assert data.attrs["event_tolerance"] == 1e-10
    assert 0.0 < data.attrs["path_error"] < 1e-11

    def rate(time, state, closed):
        return [state[1], 0.7 * math.sin(0.8 * time) - 0.1 * state[1] - state[0] - closed * 60.0 * (state[0] - 0.2)]

    def passing(time, state, closed):
        return state[0] - 0.2

    passing.terminal, options = True, {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15, "dense_output": True}
    time, state, closed, found = 0.0, np.zeros(2), 0.0, []
    while len(found) < 5:  # piece by piece, each smooth
        passing.direction = -1.0 if closed else 1.0
        piece = solve_ivp(rate, (time, 4.1 * PERIOD), state, events=passing, args=(closed,), **options)
        while len(found) < 5 and len(found) * PERIOD <= piece.t[-1]:
            found.append(piece.sol(len(found) * PERIOD)[0])
        time, state, closed = piece.t[-1], piece.y[:, -1], 1.0 - closed
    np.testing.assert_allclose(data.displacement[0, :, 0], found, atol=1e-11)


def test_it_is_the_run_that_one_may_ask_for_and_comes_again(tmp_path):
    options = {"duration": 20.0, "record": [il.Trajectory(1.0), il.FinalState(), il.Impacts(), il.PerRealization()]}
    data = il.simulate(stop(), **options, out=tmp_path / "run.nc")
    assert_same(data, il.simulate(stop(), **options, integrator=il.EventLocated()))
    assert_same(data, il.rerun(tmp_path / "run.nc"))


@pytest.mark.parametrize(
    ("network", "options", "reason"),
    [
        (stop(noise=0.1), {"rng": 1}, None),
        (stop(), {"step": 0.01}, None),
        (stop(), {"integrator": il.ExactFlow()}, None),
        (stop(), {"record": il.Density()}, "EventLocated keeps no Density, but"),
        (resonant(), {"initial": "rest"}, r"an undamped mode at its natural frequency, 0.8 rad s-1\.$"),
        (chain(10, il.LinearContact(10.0)), {}, "with more than 8 contacts"),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_steps_say_why(network, options, reason):
    data = il.simulate(network, 5.0, **options)
    assert data.attrs["integrator"] == "ExactFlow"
    if reason is None:
        assert REASON not in data.attrs
    else:
        assert data.attrs[REASON].startswith("Steps were made, though nothing is random: ")
        assert re.search(reason, data.attrs[REASON])
        assert "il.ExactFlow" not in data.attrs[REASON]
    again = il.simulate(network, 5.0, **{"integrator": il.ExactFlow(), **options})
    np.testing.assert_array_equal(data.mean_square_displacement, again.mean_square_displacement)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_smooth_chaos_of_many_bodies_takes_steps(monkeypatch):
    """Work is counted, so that a run is within its limit or not on any machine and beside any other run."""
    monkeypatch.setattr(limits, "LEAST_SECONDS", 0.02)
    data = il.simulate(chain(5, il.HertzContact(100.0)), 20.0)
    assert data.attrs["integrator"] == "ExactFlow"
    assert "EventLocated would take more than" in data.attrs[REASON]
    assert "much longer than steps." in data.attrs[REASON]


def test_linear_motion_beyond_its_limit_takes_steps(monkeypatch):
    monkeypatch.setattr(limits, "LEAST_SECONDS", 1e-4)
    monkeypatch.setattr(limits, "SLOWER", 0.1)
    monkeypatch.setattr("impactlab.located.course.LOOKS_OF_CALL", 1)
    options = {"duration": 200.0, "spin_up": 0.0}
    whole = il.sweep(stop, {"force": [0.1, 0.7]}, **options)
    assert whole.integrator.values.tolist() == ["EventLocated", "ExactFlow"]
    for place, force in enumerate((0.1, 0.7)):
        alone = il.simulate(stop(force), **options)
        assert alone.attrs["integrator"] == whole.integrator.values[place]


@pytest.mark.filterwarnings("ignore:In 2 of 4 points:impactlab.AccuracyWarning")
def test_each_point_of_a_sweep_has_its_own_method():
    over = {"force": [0.3, 0.7], "noise": [0.0, 0.1]}
    whole = il.sweep(stop, over, duration=30.0, record=il.Trajectory(1.0), rng=1)
    assert (whole.status == "done").all()
    assert whole.integrator.values.tolist() == [["EventLocated", "ExactFlow"]] * 2
    assert np.isnan(whole.path_error).values.tolist() == [[False, True]] * 2
    assert np.isnan(whole.step).values.tolist() == [[True, False]] * 2
    assert whole[REASON].values[0, 1] == ""
    alone = il.simulate(stop(0.7), 30.0, record=il.Trajectory(1.0))
    np.testing.assert_array_equal(whole.displacement.values[1, 0], alone.displacement)
    np.testing.assert_array_equal(il.rerun(whole).displacement, whole.displacement)


def test_a_point_of_a_sweep_that_cannot_be_followed_has_steps():
    whole = il.sweep(resonant, {"stiffness": [0.64, 1.0]}, duration=10.0, initial="rest")
    assert whole.integrator.values.tolist() == ["ExactFlow", "EventLocated"]
    assert "at its natural frequency" in whole[REASON].values[0]


def test_thousands_of_starts_by_themselves():
    starts = {"displacement": {"a": np.linspace(-2.0, 0.1, 2000)}}
    data = il.simulate(stop(), 10.0, initial=starts, realizations=2000)
    assert data.attrs["integrator"] == "EventLocated"


def test_samples_that_end_before_the_run_are_refused():
    force = il.SampledForce(np.linspace(0.0, 5.0, 11), np.ones(11))
    network = stop().replace(excitations={"a": force})
    for method in (None, il.EventLocated()):
        with pytest.raises(il.InvalidInput, match="samples of 'a' end at 5 s, 1 s before the run"):
            il.simulate(network, 6.0, integrator=method)


@pytest.mark.full
@pytest.mark.parametrize("law", [il.LinearContact(60.0), il.HertzContact(60.0)])
def test_a_run_that_takes_too_long_is_refused(law):
    with pytest.raises(il.InvalidInput, match=r"EventLocated would take about .* s, but may take 1e-06 s"):
        il.simulate(stop(law=law), 100.0, max_seconds=1e-6)
    assert il.simulate(stop(law=law), 100.0, max_seconds=100.0).attrs["integrator"] == "EventLocated"


def test_a_long_run_is_said_once():
    """The time that is left is foreseen from the part that is done."""
    now, shown = [0.0], []

    def at(seconds, part):
        now[0] = seconds
        watch(part)

    watch = limits.Watch(shown.append, math.inf, lambda: now[0])
    at(1.0, 0.0)
    at(2.0, 1e-9)
    with pytest.warns(il.ImpactLabWarning, match="EventLocated would take about 5e\\+04 s. Give max_seconds="):
        at(51.0, 1e-3)
    at(101.0, 2e-3)
    assert shown == [0.0, 1e-9, 1e-3, 2e-3]


def test_another_motion_after_another_start_is_said():
    """As steps do; the stop is reached in each period, or after a strong push in fewer of them."""
    with pytest.warns(il.AccuracyWarning, match="depends on how it begins: mean_square_displacement of 'a' differs"):
        usual = il.simulate(stop(), 400.0)
    pushed = il.simulate(stop(), 400.0, initial={"velocity": {"a": 7.63011582}}, spin_up=240.0)
    assert pushed.mean_square_displacement.item() < 0.5 * usual.mean_square_displacement.item()
    il.simulate(stop(), 400.0, initial="rest", spin_up=240.0)  # without a word: this start was asked for


def test_a_check_says_what_is_usual():
    words = "where no method is given, il.simulate makes steps only if il.EventLocated cannot follow"
    assert words in str(stop().check())
    assert words not in str(stop(noise=0.1).check())
    assert words not in str(stop().check(integrator=il.RungeKutta4()))


def test_many_starts_under_smooth_laws_are_not_begun():
    """The longest steps tell that it would take too long, before there are lanes."""
    number = 20_000
    starts = {"displacement": {"a": np.linspace(-2.0, 0.1, number)}}
    network, options = stop(law=il.HertzContact(60.0)), {"initial": starts, "realizations": number}
    run = usual_run(Model.of(network), request_of(network, 100.0, **options), lambda: 0.1)
    assert run == "EventLocated would take more than 1 s of one core, much longer than steps."


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_trajectories_beyond_the_memory_are_refused(monkeypatch):
    """Before they are allocated: asked for, the method is refused; chosen, steps are made, which may fit."""
    monkeypatch.setattr("impactlab.located.requests.available", lambda: 1e5)
    record = il.Trajectory(0.01)
    with pytest.raises(il.InvalidInput, match="GB of memory, in which EventLocated keeps them"):
        il.simulate(stop(), 100.0, record=record, integrator=il.EventLocated())
    data = il.simulate(stop(), 100.0, record=record)
    assert data.attrs["integrator"] == "ExactFlow"
    assert "EventLocated keeps them as a whole" in data.attrs[REASON]


def test_an_error_of_steps_says_why_there_were_to_be_steps():
    hit = resonant().replace(contacts={"stop": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=1.0)})
    with pytest.raises(
        il.InvalidInput, match=r"is rigid.* Steps were to be made: EventLocated cannot drive an undamped"
    ):
        il.simulate(hit, 5.0, initial="rest", record=il.Section(il.AtContact("stop")))
