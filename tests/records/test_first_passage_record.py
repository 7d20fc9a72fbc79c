"""First passages: against the Fokker–Planck equation, exact laws and SciPy, at any step, alone and with others."""

import math

import numpy as np
import pytest
import scipy.integrate
import xarray as xr

import impactlab as il
from impactlab.kernels import bridges
from impactlab.records import passage_limits

MEAN_OF_TWO = 42.0863
"""Mean time of a linear body (ω = 1, ζ = 0.1, σ = 1) from rest to ±2, from the Fokker–Planck equation."""


def linear(damping=0.2, **others):
    noise = {"a": il.WhiteNoise(damping / math.pi)}
    return il.Network({"a": il.LinearOscillator(mass=1.0, damping=damping, stiffness=1.0)}, others, noise)


def passed(network, limits, duration, realizations, rng=1, initial="rest", **options):
    record = il.FirstPassage(limits)
    return il.simulate(network, duration, realizations=realizations, initial=initial, record=record, rng=rng, **options)


def distance(result, name, expected):
    return abs(result[name].item() - expected) / result[f"{name}_standard_error"].item()


@pytest.mark.full
def test_mean_time_of_a_linear_body():
    result = passed(linear(), {"a": 2.0}, 600.0, 20_000)
    assert not result.passage_censored.any()
    assert distance(result, "mean_passage_time", MEAN_OF_TWO) < 4.0
    assert result.mean_passage_time_standard_error < 0.4


@pytest.mark.full
def test_no_bias_of_a_long_step(monkeypatch):
    """Without paths drawn between steps the mean of a step of 1/ω is 2 % too large."""
    options = {"duration": 600.0, "realizations": 60_000, "step": 1.0}
    assert distance(passed(linear(), {"a": 2.0}, **options), "mean_passage_time", MEAN_OF_TWO) < 4.0
    monkeypatch.setitem(passage_limits.LEVELS, bridges.OF_DISPLACEMENT, 0)
    assert distance(passed(linear(), {"a": 2.0}, **options), "mean_passage_time", MEAN_OF_TWO) > 5.0


@pytest.mark.campaign
def test_order_of_the_bias_without_drawn_paths(monkeypatch):
    """Of the order 3/2 in the step: a path leaves its cubic by ``sqrt(D h³ / 192)``."""
    monkeypatch.setitem(passage_limits.LEVELS, bridges.OF_DISPLACEMENT, 0)
    means = [
        passed(linear(), {"a": 2.0}, 600.0, 400_000, step=step).mean_passage_time.item() - MEAN_OF_TWO
        for step in (0.5, 1.0)
    ]
    assert math.log2(means[1] / means[0]) == pytest.approx(1.5, abs=0.5)


@pytest.mark.full
def test_velocity_of_a_free_body_is_brownian_motion():
    """Brownian motion leaves ±b after b²/D on average, whatever the step."""
    network = il.Network({"a": il.LinearOscillator(mass=1.0)}, {}, {"a": il.WhiteNoise(0.5 / math.pi)})
    result = passed(network, {"a": ("velocity", 1.0)}, 12.0, 20_000, step=0.5)
    assert distance(result, "mean_passage_time", 1.0) < 4.0


@pytest.mark.full
def test_overdamped_body_at_a_step_of_many_relaxation_times():
    """An Ornstein–Uhlenbeck process leaves ±2σ after 4.5016 τ; a mass adds a layer at the limits."""
    network = linear(damping=200.0)
    exact = il.fokker_planck(network, absorb={"a": 2.0}).mean_passage_time().item()
    result = passed(network, {"a": 2.0}, 60.0 * 200.0, 2000)
    assert result.attrs["step"] > 10.0 / 200.0
    assert distance(result, "mean_passage_time", exact) < 4.0


@pytest.mark.full
@pytest.mark.parametrize("kind", ["residual", "contact"])
def test_nonlinear_bodies(kind):
    noise = {"a": il.WhiteNoise(0.2 / math.pi)}
    body = il.DuffingOscillator(mass=1.0, damping=0.2, stiffness=1.0, cubic=1.0 if kind == "residual" else 0.0)
    contacts = {"stop": il.Contact("a", il.WALL, il.HertzContact(50.0), clearance=0.5)} if kind == "contact" else {}
    network = il.Network({"a": body}, contacts, noise)
    limits = {"a": (-1.5, 1.0)} if kind == "residual" else {"a": (-2.0, None), "stop": ("contact_force", 5.0)}
    upper = 1.0 if kind == "residual" else 0.5 + 0.1 ** (2.0 / 3.0)
    low = limits["a"][0]
    exact = il.fokker_planck(network, absorb={"a": (low, upper)}).mean_passage_time().item()
    result = passed(network, limits, 30.0 * exact, 20_000)
    assert distance(result, "mean_passage_time", exact) < 4.0


@pytest.mark.full
def test_survival_hazard_and_decay():
    reference = il.fokker_planck(linear(), absorb={"a": 2.0}, tolerance=1e-3)
    result = passed(linear(), {"a": 2.0}, 100.0, 20_000)
    exact = reference.survival(result.survival_time.values)
    z = (result.survival - exact) / result.survival_standard_error
    assert np.abs(z).max() < 4.0
    late = result.hazard_time > 30.0
    z = ((result.hazard - reference.decay_rate) / result.hazard_standard_error)[late]
    assert np.abs(z).max() < 4.5
    assert abs(z.mean()) < 1.0
    assert math.isnan(result.mean_passage_time)
    assert result.passage_censored.sum() > 0
    area = np.trapezoid(exact, result.survival_time)
    assert distance(result, "restricted_mean_passage_time", area) < 4.0


@pytest.mark.full
def test_causes_and_counts():
    network = il.Network(
        {"a": il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)},
        {"gap": il.Contact("a", il.WALL, il.HertzContact(1e-9), clearance=0.8)},
        {"a": il.WhiteNoise(0.2 / math.pi)},
    )
    result = passed(network, {"a": (None, 1.0)}, 200.0, 500)
    first = passed(network, {"a": (None, 1.0), "gap": ("indentation", 0.0)}, 200.0, 500)
    assert (first.passage_cause == 1).all()
    assert first.passage_count.values.tolist() == [0, 500]
    assert first.limit.values.tolist() == ["a", "gap"]
    assert (first.passage_time < result.passage_time.fillna(np.inf)).all()


@pytest.mark.full
def test_common_noise_does_not_move_a_gap():
    """Bodies on one base that is all that moves them keep their gap, whose path is a cubic without noise."""
    body = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
    source = il.Source(il.WhiteNoise(0.2), on={"a": 1.0, "b": 1.0})
    network = il.Network(
        {"a": body, "b": body}, {"gap": il.Contact("a", "b", il.LinearContact(1.0), clearance=0.1)}, {"ground": source}
    )
    result = passed(network, {"gap": ("indentation", 0.0)}, 20.0, 64)
    assert result.passage_censored.all()
    assert (result.survival == 1.0).all()
    assert math.isnan(result.mean_passage_time)
    assert result.restricted_mean_passage_time == 20.0


@pytest.mark.full
def test_two_towers_against_their_difference():
    """The gap of two equal bodies with independent noises is a body of twice the density."""
    body = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)
    noises = {name: il.WhiteNoise(0.1 / math.pi) for name in "ab"}
    gap = il.Contact("a", "b", il.LinearContact(1.0), clearance=2.0)
    network = il.Network({"a": body, "b": body}, {"gap": gap}, noises)
    result = passed(network, {"gap": ("indentation", 0.0)}, 400.0, 10_000)
    exact = il.fokker_planck(linear(), absorb={"a": (None, 2.0)}, tolerance=1e-3)
    expected = np.trapezoid(exact.survival(np.linspace(0.0, 400.0, 2001)), dx=0.2)
    assert distance(result, "restricted_mean_passage_time", expected) < 4.0


@pytest.mark.full
def test_noise_that_varies_in_time():
    """A free body under a density that grows with time: as under a constant one, at a time of its own."""

    class Growing(il.Excitation):
        @staticmethod
        def intensity(time):
            return time / math.pi

    network = il.Network({"a": il.LinearOscillator(mass=1.0)}, {}, {"a": Growing()})
    result = passed(network, {"a": ("velocity", 1.0)}, 8.0, 20_000, step=0.25)
    # D(t) = 2 t, so that t² is the time of Brownian motion with D = 1, whose mean passage of ±1 is at t² = 1
    assert abs((result.passage_time**2).mean() - 1.0) < 4.0 * (result.passage_time**2).std() / math.sqrt(20_000)


@pytest.mark.full
@pytest.mark.parametrize("limits", [{"a": (None, 0.45)}, {"stop": ("contact_force", 1.0)}, {"a": ("velocity", 0.3)}])
def test_exact_times_where_nothing_is_random(limits):
    network = il.Network(
        {"a": il.LinearOscillator(mass=1.0, damping=0.1, stiffness=1.0)},
        {"stop": il.Contact("a", il.WALL, il.LinearContact(50.0), clearance=0.5)},
        {"a": il.Harmonic(0.2, frequency=1.1)},
    )

    def rate(t, y):
        push = 0.2 * math.cos(1.1 * t) if network.excitations["a"].call("force", 0.0) else 0.2 * math.sin(1.1 * t)
        return [y[1], push - 0.1 * y[1] - y[0] - 50.0 * max(y[0] - 0.5, 0.0)]

    of = {"a": lambda t, y: y[0] - 0.45, "stop": lambda t, y: y[0] - 0.52}
    event = (lambda t, y: abs(y[1]) - 0.3) if ("velocity", 0.3) in limits.values() else of[next(iter(limits))]
    event.terminal = True
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12, "events": event, "max_step": 0.01}
    exact = scipy.integrate.solve_ivp(rate, (0.0, 100.0), [0.0, 0.0], **options).t_events[0][0]
    result = passed(network, limits, 30.0, 1)
    located = "a" not in limits or limits["a"] == (None, 0.45)
    assert result.attrs["integrator"] == ("EventLocated" if located else "ExactFlow")
    assert result.passage_time.item() == pytest.approx(exact, abs=1e-9 if located else 2e-4)
    steps = passed(network, limits, 30.0, 1, integrator=il.ExactFlow())
    assert steps.passage_time.item() == pytest.approx(exact, abs=2e-4)


@pytest.mark.full
def test_one_realization_has_the_same_passage_alone_and_among_others():
    result = passed(linear(), {"a": 1.5}, 200.0, 200, step=0.25)
    alone = passed(linear(), {"a": 1.5}, 200.0, 1, step=0.25)
    whole = passed(linear(), {"a": 1.5}, 200.0, 200, step=0.25, statistics="mean_square_displacement")
    assert alone.passage_time[0] == result.passage_time[0]
    xr.testing.assert_identical(whole.passage_time.drop_attrs(), result.passage_time.drop_attrs())
    assert "mean_square_displacement" in whole
    assert "mean_square_displacement" not in result


def test_files_and_reruns(tmp_path):
    result = passed(linear(), {"a": (-1.0, 1.5)}, 50.0, 16)
    il.save(result, tmp_path / "passages.nc")
    again = il.rerun(tmp_path / "passages.nc")
    xr.testing.assert_equal(again, result)
    assert il.network_of(result) == linear()


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_in_a_sweep_and_with_a_trajectory():
    swept = il.sweep(
        lambda level: linear(), {"level": [1.0, 2.0]}, duration=20.0, realizations=8, initial="rest", rng=1,
        record=[il.FirstPassage({"a": 1.0}), il.Trajectory(1.0)],
    )  # fmt: skip
    first = np.abs(swept.displacement.isel(level=0)) >= 1.0
    for realization in swept.realization.values:
        seen = first.sel(realization=realization, oscillator="a").values
        time = swept.passage_time.isel(level=0).sel(realization=realization).item()
        assert not seen.any() or time <= swept.time.values[seen.argmax()]


@pytest.mark.parametrize(
    ("limits", "options", "message"),
    [
        ({"b": 1.0}, {}, "'b'"),
        ({"stop": 1.0}, {}, "contact_force"),
        ({"gap": ("indentation", 1.0)}, {}, "'gap'"),
        ({"a": 1.0}, {"initial": None}, "give initial="),
        ({"a": 1.0}, {"initial": {"displacement": {"a": 1.0}}}, "'a' is 1 at the start of realization 0"),
        ({"stop": ("contact_force", 1e99)}, {}, "never has a force"),
    ],
)  # fmt: skip
def test_bad_limits_of_a_network(limits, options, message):
    law = il.HertzContact(1.0)
    network = linear(stop=il.Contact("a", il.WALL, law, clearance=3.0))
    with pytest.raises(il.InvalidInput, match=message):
        passed(network, limits, 10.0, 2, **options)


@pytest.mark.parametrize("horizon", [20.0, 0.01])
def test_bad_horizons(horizon):
    record = il.FirstPassage({"a": 1.0}, horizon=horizon)
    with pytest.raises(il.InvalidInput, match="horizon"):
        il.simulate(linear(), 10.0, step=0.1, initial="rest", record=record)


@pytest.mark.parametrize(
    "limits",
    [{}, 1.0, {"a": -1.0}, {"a": (1.0, -1.0)}, {"a": (None, None)}, {"a": ("speed", 1.0)},
     {"a": ("contact_force", 0.0)}, {"a": (0.0, 1.0, 2.0)}, {"a": math.nan}],
)  # fmt: skip
def test_bad_limits(limits):
    with pytest.raises(il.InvalidInput):
        il.FirstPassage(limits)


def beside_wall(restitution, clearance, low=True, **fields):
    sides = (il.WALL, "a") if low else ("a", il.WALL)
    return linear(stop=il.Contact(*sides, il.RigidContact(restitution), clearance=clearance), **fields)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize(("limit", "step"), [(2.0, None), (2.0, 0.4), (("velocity", 2.0), 0.2)])
def test_an_elastic_wall_in_the_middle_changes_no_first_passage(limit, step):
    """By symmetry: the distance from the wall is that of the body without it, and so is the speed."""
    given = {"a": (None, limit)} if limit == 2.0 else {"a": limit}
    result = passed(beside_wall(1.0, 0.0), given, 600.0, 20_000, step=step)
    plain = {"a": limit}
    if limit == 2.0:
        assert distance(result, "mean_passage_time", MEAN_OF_TWO) < 4.0
        return
    free = passed(linear(), plain, 600.0, 20_000, rng=2, step=0.05)
    error = math.hypot(*(item.mean_passage_time_standard_error.item() for item in (result, free)))
    assert abs(result.mean_passage_time.item() - free.mean_passage_time.item()) < 4.0 * error


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("step", [0.4, 0.1])
def test_the_first_impact_under_noise(step):
    """As a limit of the body, whatever happens after it: from the Fokker-Planck equation."""
    expected = il.fokker_planck(linear(), absorb={"a": (-0.5, 2.0)}, tolerance=1e-3).mean_passage_time().item()
    limits = {"a": (None, 2.0), "stop": ("indentation", 0.0)}
    result = passed(beside_wall(0.5, 0.5), limits, 600.0, 20_000, step=step)
    assert distance(result, "mean_passage_time", expected) < 4.0
    with pytest.raises(il.InvalidInput, match=r"no indentation of 0\.1 m"):
        passed(beside_wall(0.5, 0.5), {"stop": ("indentation", 0.1)}, 600.0, 2)


def by_small_steps(restitution, clearance, level, realizations, step=2e-3, damping=0.2, seed=5):
    """Times at which a body beside a wall leaves, by a semi-implicit method with impacts at the ends of steps."""
    numbers, x, v = np.random.default_rng(seed), *np.zeros((2, realizations))
    times, left, now = np.zeros(realizations), np.arange(realizations), 0.0
    while len(left):
        v += -step * (x + damping * v) + math.sqrt(2.0 * damping * step) * numbers.standard_normal(len(left))
        x += step * v
        now += step
        hit = (x < -clearance) & (v < 0.0)
        x[hit], v[hit] = -2.0 * clearance - x[hit], -restitution * v[hit]
        gone = x >= level
        times[left[gone]] = now
        left, x, v = (item[~gone] for item in (left, x, v))
    return times


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_a_wall_that_takes_energy():
    """Beside an independent simulation in small steps."""
    times = by_small_steps(0.6, 0.3, 1.5, 4000)
    result = passed(beside_wall(0.6, 0.3), {"a": (None, 1.5)}, 2000.0, 20_000)
    error = math.hypot(times.std() / math.sqrt(len(times)), result.mean_passage_time_standard_error.item())
    assert abs(result.mean_passage_time.item() - times.mean()) < 4.0 * error


def shot(mean=0.0, deviation=0.5, rate=0.8):
    noise = {"a": il.PoissonImpulses(rate=rate, mean=mean, standard_deviation=deviation)}
    return il.Network({"a": il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)}, excitations=noise)


def by_events(level, realizations, mean=0.0, deviation=0.5, rate=0.8, damping=0.2, seed=7):
    """Times at which a body under impulses leaves, by the exact motion between these, looked at closely."""
    numbers, found = np.random.default_rng(seed), np.zeros(realizations)
    decay, omega = 0.5 * damping, math.sqrt(1.0 - 0.25 * damping**2)
    x, v, now, left = *np.zeros((3, realizations)), np.arange(realizations)
    while len(left):
        wait = numbers.exponential(1.0 / rate, len(left))
        grid = np.linspace(0.0, 1.0, 2001)[:, None] * wait
        swing = np.exp(-decay * grid)
        path = swing * (x * np.cos(omega * grid) + (v + decay * x) / omega * np.sin(omega * grid))
        out = np.abs(path) >= level
        gone, first = out.any(axis=0), out.argmax(axis=0)
        found[left[gone]] = (now + grid[first, np.arange(len(left))])[gone]
        speed = swing[-1] * (v * np.cos(omega * wait) - (x + decay * v) / omega * np.sin(omega * wait))
        x, v, now = path[-1], speed + numbers.normal(mean, deviation, len(left)), now + wait
        x, v, now, left = (item[~gone] for item in (x, v, now, left))
    return found


@pytest.mark.full
@pytest.mark.parametrize("step", [0.1, None])
def test_impulses(step):
    """Beside the exact motion from impulse to impulse."""
    times = by_events(1.2, 4000)
    result = passed(shot(), {"a": 1.2}, 1000.0, 10_000, step=step)
    assert not result.passage_censored.any()
    error = math.hypot(times.std() / math.sqrt(len(times)), result.mean_passage_time_standard_error.item())
    assert abs(result.mean_passage_time.item() - times.mean()) < 4.0 * error
    fast = passed(shot(), {"a": ("velocity", 0.9)}, 1000.0, 2000, step=0.1)
    other = passed(shot(), {"a": ("velocity", 0.9)}, 1000.0, 2000, step=0.02, rng=2)
    error = math.hypot(*(item.mean_passage_time_standard_error.item() for item in (fast, other)))
    assert abs(fast.mean_passage_time.item() - other.mean_passage_time.item()) < 4.0 * error


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_a_run_that_continues_another_is_refused():
    first = il.simulate(linear(), 5.0, initial="rest", record=il.FinalState(continues=True), rng=1)
    with pytest.raises(il.InvalidInput, match="continues=True"):
        il.simulate(linear(), 5.0, initial=first, continues=True, record=il.FirstPassage({"a": 9.0}))


def test_the_first_impact_of_a_rigid_contact():
    """A body that falls from rest by its spring meets a stop at 0 after a quarter of a period."""
    body = {"a": il.LinearOscillator(mass=1.0, stiffness=1.0)}
    network = il.Network(body, {"stop": il.Contact("a", il.WALL, il.RigidContact(0.5), clearance=0.0)})
    start = {"displacement": {"a": -1.0}}
    result = passed(network, {"stop": ("indentation", 0.0), "a": (-2.0, None)}, 10.0, 1, initial=start)
    assert result.passage_time.item() == pytest.approx(0.5 * math.pi, abs=1e-12)
    assert result.passage_cause.item() == 0
    with pytest.raises(il.InvalidInput, match=r"no indentation of 0\.1 m"):
        passed(network, {"stop": ("indentation", 0.1)}, 10.0, 1, initial=start, integrator=il.EventLocated())
