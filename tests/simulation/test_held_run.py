"""Runs that are held."""

import math

import numpy as np
import pytest

import impactlab as il
from impactlab.machine import tuned
from impactlab.results.dataset import CONFIGURATION, load

BODY = il.LinearOscillator(damping=0.4, stiffness=25.0)
PLAIN = il.ExactFlow(measured=False, jumps=False)


def stop(law, excitation, couplings=(), **bodies):
    contact = il.Contact("body", il.WALL, law, clearance=0.05)
    return il.Network({"body": BODY, **bodies}, {"stop": contact}, {"body": excitation}, dict(couplings))


HEAT = il.WhiteNoise(0.1)
NETWORKS = {
    "white noise": stop(il.HertzContact(1e3), HEAT),
    "filtered noise": stop(il.LinearContact(500.0), il.OrnsteinUhlenbeckNoise(0.5, correlation_time=0.3)),
    "laws with states": stop(
        il.LinearContact(500.0), HEAT, {"element": il.Coupling("body", il.WALL, il.MaxwellCoupling(20.0, damping=4.0))}
    ),
    "rigid contact": stop(il.RigidContact(restitution=0.7), HEAT),
    "dry friction": stop(
        il.LinearContact(500.0),
        il.Harmonic(2.0, frequency=4.0),
        {"slide": il.Coupling("body", il.WALL, il.CoulombFrictionCoupling(0.2))},
    ),
    "given force": stop(il.LinearContact(500.0), il.Harmonic(2.0, frequency=4.0)),
    "impulses": stop(il.LinearContact(500.0), il.PoissonImpulses(3.0, mean=0.1, standard_deviation=0.2)),
    "no contact": il.Network({"body": BODY}, excitations={"body": HEAT}),
}
QUICK = "white noise"
EACH = [name if name == QUICK else pytest.param(name, marks=pytest.mark.full) for name in NETWORKS]
"""Networks, of which others than the first are costly to compile."""

OPTIONS = {"step": 0.01, "integrator": PLAIN, "initial": "rest", "rng": 3}


def numbers_of(dataset):
    return {name: item.values for name, item in dataset.variables.items() if item.dtype.kind == "f"}


def equal(one, other):
    one, other = numbers_of(one), numbers_of(other)
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.mark.filterwarnings("ignore:Too few independent samples")
@pytest.mark.filterwarnings("ignore:.*closed fewer than")
@pytest.mark.parametrize("realizations", [1, 9])
@pytest.mark.parametrize("name", EACH)
def test_a_time_in_parts_has_the_bits_of_the_whole(name, realizations):
    options = {**OPTIONS, "realizations": realizations}
    with il.Run(NETWORKS[name], **options) as parts, il.Run(NETWORKS[name], **options) as whole:
        for until in (0.01, 0.07, 1.0, 1.01, 3.33, 6.0):
            parts.advance(until=until)
            parts.state, parts.statistics()
        whole.advance(6.0)
        assert parts.time == whole.time == 6.0
        equal(parts.state, whole.state)
        equal(parts.statistics(), whole.statistics())


def test_a_run_has_the_numbers_of_simulate():
    options = {**OPTIONS, "realizations": 64}
    result = il.simulate(NETWORKS["white noise"], 6.0, record=il.FinalState(), **options)
    with il.Run(NETWORKS["white noise"], **options) as run:
        run.advance(6.0)
        statistics, state = run.statistics(), run.state
    for name in ("mean_square_displacement", "mean_square_velocity_standard_error", "contact_rate"):
        np.testing.assert_array_equal(statistics[name].values, result[name].values, err_msg=name)
    for name in ("final_displacement", "final_velocity"):
        np.testing.assert_array_equal(state[name].values, result[name].values)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_sums_of_cosines_are_sampled_for_the_whole_duration():
    """200 relaxation times of the body, of which others are foreseen for 100 only."""
    noise = il.ShinozukaNoise(1.0, band=(0.0, 2.0), components=4000)
    network = stop(il.LinearContact(50.0), noise, body=il.LinearOscillator(damping=2.0, stiffness=4.0))
    options = {**OPTIONS, "step": 0.05, "realizations": 2}
    result = il.simulate(network, 200.0, record=il.FinalState(), **options)
    with il.Run(network, duration=200.0, **options) as run:
        run.advance(200.0)
        equal(run.state[["final_displacement"]].drop_vars("time"), result[["final_displacement"]])


@pytest.mark.parametrize("name", EACH)
def test_a_state_is_where_a_restart_begins(name):
    with il.Run(NETWORKS[name], **OPTIONS, realizations=3) as run:
        run.advance(2.0)
        state = run.state
        run.advance(1.0)
        run.restart(state)
        assert run.time == 2.0
        assert run.realizations.tolist() == [3, 4, 5]
        again = run.state
    for item in ("final_displacement", "final_velocity", "final_law_state"):
        if item in state:
            np.testing.assert_array_equal(state[item].values, again[item].values, err_msg=item)


@pytest.mark.parametrize("realizations", [1, 5])
@pytest.mark.parametrize("name", EACH)
def test_a_saved_state_continues_bit_for_bit(name, realizations, tmp_path):
    """Also realizations that branched, and so have made other numbers of steps, and those that are left of some."""
    network, path = NETWORKS[name], tmp_path / "state.nc"
    options = {**OPTIONS, "realizations": realizations, "duration": 10.0}
    with il.Run(network, **options) as run:
        run.advance(1.07)
        run.branch([0])
        run.advance(0.25)
        if realizations > 1:
            run.retire([1, 3])
        il.save(run.state, path)
        numbers = run.realizations
        run.advance(1.3)
        whole = run.state
    with il.Run(network, initial=path, continues=True) as run:
        assert run.time == pytest.approx(1.32)
        np.testing.assert_array_equal(run.realizations, numbers)
        run.advance(1.3)
        again = run.state
        equal(whole, again)
        assert again.attrs[CONFIGURATION] == whole.attrs[CONFIGURATION]
        new = run.branch([0])
        assert new.tolist() == [realizations + 1]
    with il.Run(network, **options) as run:
        run.restart(path, continues=True)
        run.advance(1.3)
        equal(whole, run.state)


@pytest.mark.full
def test_sums_of_cosines_continue_with_the_draws_of_their_start(tmp_path):
    """The stop is closed in half of the draws of a stationary start, so that some realizations draw again."""
    noise = il.ShinozukaNoise(1.0, band=(0.0, 2.0), components=400)
    network = stop(il.LinearContact(50.0), noise, body=il.LinearOscillator(damping=2.0, stiffness=4.0))
    with il.Run(network, step=0.05, realizations=6, duration=20.0, rng=1, spin_up=0.0) as run:
        run.advance(5.0)
        il.save(run.state, tmp_path / "state.nc")
        assert run.state["continuation"].values[:, 0].any()
        run.advance(5.0)
        whole = run.state
    with il.Run(network, initial=tmp_path / "state.nc", continues=True) as run:
        run.advance(5.0)
        equal(whole, run.state)
        with pytest.raises(il.InvalidInput, match="ends at its duration of 20 s"):
            run.advance(20.0)


@pytest.mark.filterwarnings("ignore:Too few independent samples")
@pytest.mark.filterwarnings("ignore:.*closed fewer than")
@pytest.mark.parametrize("name", EACH)
def test_a_run_takes_up_a_simulation(name, tmp_path):
    """Whose step and spin-up were chosen, too: the second half has the bits of one simulation."""
    network, options = NETWORKS[name], {"realizations": 9, "rng": 3, "initial": "rest", "step": 0.01}
    end = il.FinalState(continues=True)
    if name != "no contact":
        options |= {"spin_up": 0.13}
    il.simulate(network, 1.5, record=end, out=tmp_path / "half.nc", **options)
    whole = il.simulate(network, 3.0, record=end, **options)
    with il.Run(network, initial=tmp_path / "half.nc", continues=True) as run:
        assert run.time == 1.5
        run.advance(1.5)
        for item in [*(name for name in whole if name.startswith("final_")), "continuation"]:
            np.testing.assert_array_equal(run.state[item].values, whole[item].values, err_msg=item)


@pytest.mark.full
def test_a_state_continues_in_another_process(tmp_path, run_python):
    with il.Run(NETWORKS["no contact"], **OPTIONS, realizations=2) as run:
        run.advance(0.5)
        il.save(run.state, tmp_path / "state.nc")
        run.advance(0.5)
        whole = run.state
    text = """
import sys, impactlab as il
with il.Run(il.network_of(sys.argv[1]), initial=sys.argv[1], continues=True) as run:
    run.advance(0.5)
    il.save(run.state, sys.argv[2])
"""
    run_python("-c", text, str(tmp_path / "state.nc"), str(tmp_path / "end.nc"))
    equal(whole, load(tmp_path / "end.nc"))


def test_random_numbers_are_not_used_twice():
    """Realizations continue in turn, and not where they have gone on; nor do states that were changed."""
    network = NETWORKS["white noise"]
    with il.Run(network, **OPTIONS, realizations=4) as run:
        run.advance(0.5)
        state = run.state
        run.restart({"displacement": {"body": 0.0}})
        run.restart(state, continues=True)
        assert run.realizations.tolist() == [0, 1, 2, 3]
        equal(run.state, state)
        run.advance(0.1)
        with pytest.raises(il.InvalidInput, match="Realization 0 has gone on since this state"):
            run.restart(state, continues=True)
        run.retire([0, 1, 2, 3])
        with pytest.raises(il.InvalidInput, match="Realization 0 has gone on since this state"):
            run.restart(state, continues=True)
    shorter = state.isel(number=slice(-1))
    with il.Run(network, initial=state.isel(realization=[3, 1]), continues=True) as run:
        assert run.realizations.tolist() == [3, 1]
    changed = state.assign(final_velocity=state["final_velocity"] + 1.0)
    again = {"initial": state, "continues": True}
    for words, bad in {
        "This state was changed": lambda: il.Run(network, initial=changed, continues=True),
        "another version": lambda: il.Run(network, initial=shorter, continues=True),
        "another network": lambda: il.Run(NETWORKS["no contact"], **again),
        "another step": lambda: il.Run(network, **OPTIONS | {"step": 0.02}).restart(state, continues=True),
        "another rng": lambda: il.Run(network, **OPTIONS | {"rng": 4}).restart(state, continues=True),
        "give neither": lambda: il.Run(network, **OPTIONS).restart(state, continues=True, time=1.0),
        "give none of them": lambda: il.Run(network, **again, rng=1),
        "all had been retired": lambda: il.Run(network, initial=state.isel(realization=[]), continues=True),
        "from the state of an il.Run, from a result with": lambda: il.Run(network, initial="rest", continues=True),
    }.items():
        with pytest.raises(il.InvalidInput, match=words) as told:
            bad()
        assert "\n" not in str(told.value)


@pytest.mark.full
def test_a_path_goes_on_smoothly_from_a_restart():
    """Without noise the path is that of one run, but for an error of fourth order in the step."""
    network, off = NETWORKS["given force"], []
    for step in (0.02, 0.01, 0.005):
        with il.Run(network, step=step, initial="rest", integrator=PLAIN) as whole:
            whole.advance(6.0)
            expected = whole.state["final_displacement"].item()
        with il.Run(network, step=step, initial="rest", integrator=PLAIN) as run:
            for count in range(1, 61):
                run.advance(until=0.1 * count)
                run.restart(run.state)
            off.append(abs(run.state["final_displacement"].item() - expected))
    assert off[0] < 3e-5
    np.testing.assert_allclose(np.divide(off[:-1], off[1:]), 16.0, rtol=0.1)


@pytest.mark.full
def test_branches_have_noise_of_their_own_and_leave_their_parents_alone():
    network, options = NETWORKS["filtered noise"], {**OPTIONS, "realizations": 5}
    with il.Run(network, **options) as run, il.Run(network, **options) as alone:
        run.advance(2.0)
        alone.advance(4.0)
        new = run.branch([1, 1, 4])
        assert new.tolist() == [5, 6, 7]
        begun = run.state["final_displacement"].values
        np.testing.assert_array_equal(begun[5:], begun[[1, 1, 4]])
        run.advance(2.0)
        after = run.state["final_displacement"].values
        np.testing.assert_array_equal(after[:5], alone.state["final_displacement"].values)
        assert len(np.unique(after)) == 8
        run.retire([0, 2, 6])
        assert run.realizations.tolist() == [1, 3, 4, 5, 7]
        np.testing.assert_array_equal(run.state["final_displacement"].values, after[[1, 3, 4, 5, 7]])


@pytest.mark.parametrize("name", EACH)
def test_those_that_are_left_go_on_as_if_nothing_had_ended(name):
    with (
        il.Run(NETWORKS[name], **OPTIONS, realizations=6) as run,
        il.Run(NETWORKS[name], **OPTIONS, realizations=6) as whole,
    ):
        run.advance(1.03)
        run.retire([0, 3])
        run.advance(1.0)
        whole.advance(2.03)
        left = whole.state.isel(realization=[1, 2, 4, 5])
        equal(run.state, left)
        run.retire([1, 2, 4])
        run.advance(0.5)
        run.retire([5])
        with pytest.raises(il.InvalidInput, match="No realization is left"):
            run.advance(1.0)
        run.restart(left.isel(realization=0), realizations=4)
        run.advance(0.5)
        assert run.state.sizes["realization"] == 4


@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_statistics_begin_anew_with_branches_whatever_the_phase_of_the_method():
    """ExactFlow has a cycle of two steps: parents and branches may be in different ones."""
    network = il.Network({"body": BODY}, excitations={"body": il.WhiteNoise(0.1)})
    exact = float(il.exact(network).statistics()["mean_square_velocity"].item())
    with il.Run(network, step=0.05, rng=2, realizations=400) as run:
        run.advance(0.35)
        run.branch(run.realizations)
        run.advance(0.05 * 4001)
        found = run.statistics()
    value, error = (found[f"mean_square_velocity{item}"].item() for item in ("", "_standard_error"))
    assert abs(value - exact) < 4.0 * error + 1e-3 * exact
    assert error < 0.01 * exact
    assert found.attrs["begin"] == pytest.approx(0.35)


def oscillation(**options):
    """A free oscillation cos 2t without damping."""
    free = il.Network({"body": il.LinearOscillator(stiffness=4.0)})
    return il.Run(free, step=0.01, initial={"displacement": {"body": 1.0}}, **options)


def test_events_are_located_within_steps():
    events = {
        "up": il.Event(lambda at: at.displacement("body"), direction=1),
        "down": il.Event(lambda at: at.displacement("body"), direction=-1),
        "turn": il.Event(lambda at: at.velocity("body")),
    }
    with oscillation(events=events) as run:
        run.advance(2.0)
        run.advance(2.0)
        found = run.events
    names, times = found["name"].values.tolist(), found["time"].values
    assert names == ["down", "turn", "up", "turn", "down"]
    np.testing.assert_allclose(times, math.pi / 4.0 * np.arange(1, 6), atol=1e-7)
    np.testing.assert_allclose(found["velocity"].values[[0, 2], 0], [-2.0, 2.0], rtol=1e-5)
    np.testing.assert_allclose(found["displacement"].values[1, 0], -1.0, rtol=1e-6)


def test_an_event_stops_a_run_at_the_end_of_its_step():
    stopping = {"down": il.Event(lambda at: at.displacement("body"), direction=-1, action="stop")}
    with oscillation(events=stopping) as run, oscillation() as plain:
        run.advance(10.0)
        assert run.time == pytest.approx(0.79)  # 0.785
        plain.advance(0.79)
        equal(run.state, plain.state)
        run.advance(10.0)
        plain.advance(until=run.time)
        assert run.time == pytest.approx(3.93)  # 3.927
        equal(run.state, plain.state)
        np.testing.assert_allclose(run.events["time"].values, [math.pi / 4.0, 1.25 * math.pi], atol=1e-7)


def test_an_event_retires_its_realization_alone():
    """Four bodies on a stop at different heights; indentations begin where they meet it."""
    network = il.Network(
        {"body": il.LinearOscillator()}, {"stop": il.Contact("body", il.WALL, il.LinearContact(100.0))}
    )
    initial = {"displacement": {"body": [-0.1, -0.2, -0.3, -5.0]}, "velocity": {"body": 1.0}}
    event = il.Event(lambda at: at.indentation("stop"), direction=1, action="retire")
    with il.Run(network, step=0.01, realizations=4, initial=initial, events={"touch": event}) as run:
        run.advance(0.25)
        assert run.realizations.tolist() == [2, 3]
        run.advance(0.25)
        assert run.realizations.tolist() == [3]
        found = run.events
    assert found["realization"].values.tolist() == [0, 1, 2]
    np.testing.assert_allclose(found["time"].values, [0.1, 0.2, 0.3], atol=1e-9)


BAD = {
    "no network": (lambda: il.Run("pair"), "il.Network"),
    "no step": (lambda: il.Run(il.Network({"body": il.LinearOscillator(stiffness=4.0)})), "step= or a duration="),
    "interval": (lambda: oscillation(interval=0.123), "not a whole number of steps"),
    "events": (lambda: oscillation(events={"up": abs}), "must be an il.Event"),
    "condition": (lambda: il.Event("body"), "must be a function"),
    "direction": (lambda: il.Event(abs, direction=2), "1, -1 or 0"),
    "action": (lambda: il.Event(abs, action="retired"), "retire"),
    "nothing": (lambda: oscillation().advance(), "either a duration"),
    "backwards": (lambda: oscillation().advance(until=-1.0), "before the time of the run"),
    "negative": (lambda: oscillation().advance(-1.0), "larger than 0"),
    "fraction": (lambda: oscillation().advance(0.015), "not a whole number of steps of 0.01 s; the nearest are"),
    "beyond": (lambda: oscillation(duration=1.0).advance(1.5), "ends at its duration"),
    "others": (lambda: oscillation().restart({"displacement": {"ball": 1.0}}), "no oscillator 'ball'"),
    "word": (lambda: oscillation().restart("rest"), "not a word"),
    "late": (lambda: oscillation(duration=1.0).restart({"displacement": {"body": 1.0}}, time=2.0), "after the end"),
    "time": (lambda: oscillation().restart({"displacement": {"body": 1.0}}, time=0.005), "not a whole number"),
    "unknown": (lambda: oscillation().retire([7]), "No realization 7 runs"),
    "parents": (lambda: oscillation().branch([7]), "No realization 7 runs"),
    "early": (lambda: oscillation().statistics(), "no time has passed"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_told_in_one_line(name):
    bad, words = BAD[name]
    with pytest.raises(il.InvalidInput, match=words) as told:
        bad()
    assert "\n" not in str(told.value)


def test_a_closed_run_says_so():
    with oscillation() as run:
        run.advance(0.1)
    for use in (lambda: run.advance(0.1), lambda: run.state, run.statistics, lambda: run.retire([0]), run.__enter__):
        with pytest.raises(il.InvalidInput, match="closed"):
            use()


def test_a_state_of_another_network_is_refused():
    with il.Run(il.chain(2, BODY, il.HertzContact(1e3)), step=0.01, initial="rest") as other:
        state = other.state
    with oscillation() as run, pytest.raises(il.InvalidInput, match="this network"):
        run.restart(state)


def test_a_condition_that_is_not_finite_says_which_and_when():
    event = il.Event(lambda at: np.log(at.displacement("body")))
    told = pytest.raises(il.InvalidInput, match=r"'level' is nan at t = 0\.79 s in realization 0")
    with oscillation(events={"level": event}) as run, np.errstate(invalid="ignore"):
        with told:
            run.advance(1.0)
        with pytest.raises(il.InvalidInput, match="closed"):
            run.advance(1.0)


def test_a_state_starts_other_runs(tmp_path):
    network = NETWORKS["white noise"]
    with il.Run(network, **OPTIONS, realizations=4) as run:
        run.advance(1.0)
        state = run.state
        il.save(state, tmp_path / "state.nc")
        run.advance(0.5)
        run.restart(tmp_path / "state.nc")
        assert run.time == 1.0
        np.testing.assert_array_equal(run.state["final_velocity"].values, state["final_velocity"].values)
    with pytest.warns(il.AccuracyWarning, match="Too few independent"):
        later = il.simulate(network, 1.0, step=0.01, initial=tmp_path / "state.nc", realizations=4, rng=5)
    assert later.attrs["initial"] == "given"
    with pytest.raises(il.InvalidInput, match="same rng"):
        il.simulate(network, 1.0, step=0.01, initial=state, realizations=4, rng=3)
    with pytest.raises(il.InvalidInput, match="no simulation"):
        il.rerun(state)
    assert il.network_of(state) == network


def test_the_step_divides_what_runs_advance_by():
    """By default a power of ten seconds; else the interval that is given."""
    network = NETWORKS["white noise"]
    with il.Run(network, rng=1) as run, il.Run(network, rng=1, interval=math.pi) as other:
        run.advance(1.0)
        other.advance(2.0 * math.pi)
        steps = math.pi / other.step
        assert run.time == 1.0
        assert other.time == pytest.approx(2.0 * math.pi, rel=1e-15)
    assert steps == pytest.approx(round(steps), rel=1e-12)
    assert run.step <= 1.25 * other.step


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few independent samples")
@pytest.mark.filterwarnings("ignore:.*closed fewer than")
def test_large_networks_run_in_tiles(tmp_path):
    """Held in parts, continued, and in one piece of `simulate`, tiles make the same numbers."""
    network = il.chain(400, BODY, il.HertzContact(1e4), clearance=0.02, excitation=HEAT)
    options = {**OPTIONS, "realizations": 1}
    with tuned(tile_bodies=100, single_lane_bodies=50, single_lane_steps=0.0):
        result = il.simulate(network, 2.0, record=il.FinalState(), **options)
        with il.Run(network, **options) as run, il.Run(network, **options) as whole:
            assert run._plan.subdomains.tiles
            run.advance(0.31)
            il.save(run.state, tmp_path / "state.nc")
            run.advance(1.69)
            whole.advance(2.0)
            state = whole.state
            equal(run.state, state)
            equal(run.statistics(), whole.statistics())
            for name in ("final_displacement", "final_velocity"):
                np.testing.assert_array_equal(state[name].values, result[name].values)
            branch = whole.branch([0])
            whole.advance(0.1)
            assert whole.realizations.tolist() == [0, *branch]
        with il.Run(network, initial=tmp_path / "state.nc", continues=True) as run:
            run.advance(1.69)
            equal(run.state, state)
