"""Lyapunov exponents against closed forms, balances and an independent simulation."""

import math

import numpy as np
import pytest

import impactlab as il

CHAOS = {"clearance": 0.0, "frequency": 2.8}


def stop(law=None, clearance=1.0, frequency=1.0, force=1.0, **changes):
    """``x'' + 0.1 x' + x = force sin(frequency t)`` with a stop."""
    body = il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.1)
    contact = il.Contact("a", il.WALL, law or il.RigidContact(0.8), clearance=clearance)
    return il.Network({"a": body}, {"stop": contact}, {"a": il.Harmonic(force, frequency=frequency)}, **changes)


def exponents(network, *arguments, **options):
    data = il.lyapunov(network, *arguments, **options)
    return data.lyapunov_exponent.values, data.lyapunov_exponent_standard_error.values, data


def test_without_impacts_differences_decay_as_the_linear_motion():
    found, errors, data = exponents(stop(frequency=0.8, force=0.36), "all")
    assert found == pytest.approx([-0.05, -0.05], abs=1e-13)
    assert (errors == 0.0).all()
    assert data.attrs["method"].startswith("Floquet")
    assert all("long_name" in item.attrs for item in data.variables.values() if item.dtype.kind in "if")


def test_a_periodic_motion_has_the_exponents_of_its_multipliers():
    """One impact a period: the multipliers are −0.58429531 ± 0.00560035 i, the root of a quadratic equation."""
    found, _, data = exponents(stop(), "all")
    assert found == pytest.approx(np.full(2, math.log(math.hypot(0.58429531, 0.00560035)) / (2.0 * math.pi)), abs=2e-9)
    assert data.lyapunov_sum.item() == pytest.approx(-0.1 + 2.0 * math.log(0.8) / (2.0 * math.pi), abs=1e-13)
    assert data.kaplan_yorke_dimension.item() == 0.0


def test_a_ball_that_always_rests_has_no_finite_exponents():
    ball = il.Network(
        {"ball": il.LinearOscillator(), "table": il.PrescribedMotion(il.Harmonic(0.5, frequency=1.0))},
        {"table": il.Contact("table", "ball", il.RigidContact(0.5), clearance=0.0)},
        {"gravity": il.BaseMotion(il.ConstantForce(1.0), on="ball")},
    )
    found, _, data = exponents(ball, "all")
    assert np.isneginf(found).all()
    assert "rest" in data.attrs["method"]
    assert "comes to rest" in data.lyapunov_exponent.attrs["comment"]
    assert np.isneginf(data.lyapunov_sum_balance.item())


def test_starts_that_overlap_are_refused():
    with pytest.raises(il.InvalidInput, match=r"'stop' overlap by 0\.5 m"):
        il.lyapunov(stop(), initial={"displacement": {"a": 1.5}})
    elastic = il.Network(
        {"a": il.LinearOscillator(stiffness=1.0)}, {"s": il.Contact("a", il.WALL, il.RigidContact(1.0))}
    )
    with pytest.raises(il.InvalidInput, match="Nothing damps"):
        il.lyapunov(elastic)


def twins(periods, number):
    """Mean growth of small differences in chaos, by small steps of the exact flow, and its standard error."""
    step, omega, c, e = 2.0 * math.pi / 2.8 / 64, 2.8, 0.1, 0.8
    root = math.sqrt(1.0 - c * c / 4.0)
    re, im = 1.0 - omega**2, c * omega
    size = re * re + im * im

    def steady(t):
        return (re * np.sin(omega * t) - im * np.cos(omega * t)) / size, omega * (
            re * np.cos(omega * t) + im * np.sin(omega * t)
        ) / size

    def flow(t, x, v, h):
        p, q = steady(t)
        a, b = x - p, v - q
        decay, cosine, sine = np.exp(-c / 2.0 * h), np.cos(root * h), np.sin(root * h) / root
        p, q = steady(t + h)
        return decay * (a * (cosine + c / 2.0 * sine) + b * sine) + p, decay * (
            b * (cosine - c / 2.0 * sine) - a * sine
        ) + q

    def advance(t, x, v):
        new, rate = flow(t, x, v, step)
        hit = np.flatnonzero(new > 0.0)
        low, high = np.zeros(len(hit)), np.full(len(hit), step)
        for _ in range(48):
            middle = 0.5 * (low + high)
            beyond = flow(t, x[hit], v[hit], middle)[0] > 0.0
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        _, at = flow(t, x[hit], v[hit], low)
        new[hit], rate[hit] = flow(t + low, np.zeros(len(hit)), -e * at, step - low)
        return new, rate

    draws = np.random.default_rng(3)
    x, v = -draws.uniform(0.05, 0.2, number), draws.uniform(-0.4, 0.4, number)
    x, v = np.concatenate([x, x]), np.concatenate([v, v + 1e-8])
    total, near = np.zeros(number), 1e-8
    for period in range(periods):
        for place in range(64):
            x, v = advance((64 * period + place) * step, x, v)
        apart = np.hypot(x[number:] - x[:number], v[number:] - v[:number])
        if period >= 30:
            total += np.log(apart / near)
        x[number:] = x[:number] + near / apart * (x[number:] - x[:number])
        v[number:] = v[:number] + near / apart * (v[number:] - v[:number])
    rates = total / ((periods - 30) * 64 * step)
    return rates.mean(), rates.std(ddof=1) / math.sqrt(number)


@pytest.mark.full
def test_chaos_against_an_independent_simulation_and_the_sum_rule():
    found, errors, data = exponents(stop(**CHAOS), "all", tolerance=2e-3, rng=1)
    other, error = twins(70, 800)
    assert abs(found[0] - other) <= 3.0 * math.hypot(errors[0], error)
    assert errors[0] < 1e-3
    assert error < 3e-3
    assert data.lyapunov_sum.item() == pytest.approx(data.lyapunov_sum_balance.item(), rel=1e-12)
    assert data.kaplan_yorke_dimension.item() == pytest.approx(1.0 - found[0] / found[1], rel=1e-14)
    assert data.lyapunov_exponent_so_far.values[-1] == pytest.approx(found, rel=1e-12)
    assert data.time.values[-1] == data.attrs["duration"]


@pytest.mark.full
def test_errors_cover():
    best, least, _ = exponents(stop(**CHAOS), tolerance=1e-3, rng=100)
    runs = [exponents(stop(**CHAOS), duration=3000.0, rng=seed)[:2] for seed in range(40)]
    ratios = np.array([(found[0] - best[0]) / math.hypot(error[0], least[0]) for found, error in runs])
    assert (np.abs(ratios) < 2.0).mean() >= 0.85  # 95 % are expected; 85 % is three standard errors below
    assert np.sqrt((ratios**2).mean()) == pytest.approx(1.0, abs=3.0 / math.sqrt(80))


def test_regular_motion_has_weighted_means():
    """Two frequencies without a common period: the motion never repeats."""
    forces = {
        "one": il.Source(il.Harmonic(0.2, frequency=0.5), on={"a": 1.0}),
        "two": il.Source(il.Harmonic(0.2, frequency=0.5 * math.sqrt(2.0)), on={"a": 1.0}),
    }
    found, errors, data = exponents(
        stop(clearance=5.0).replace(excitations={"a": None, **forces}), "all", tolerance=1e-7
    )
    assert data.attrs["method"].startswith("weighted")
    assert (np.abs(found + 0.05) <= 3.0 * errors + 1e-12).all()
    assert (errors < 1e-8).all()


def test_a_motion_that_rests_forgets_its_past():
    found, _, data = exponents(stop(il.RigidContact(0.2), clearance=-0.1, frequency=0.5), "all")
    assert (found == -np.inf).all()
    assert data.lyapunov_sum_balance.item() == -np.inf


def test_a_body_that_is_pressed_to_a_stop_has_no_past():
    body, contact = (
        il.LinearOscillator(damping=0.1, stiffness=1.0),
        {"s": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=-0.2)},
    )
    assert (exponents(il.Network({"a": body}, contact), "all")[0] == -np.inf).all()


def test_two_bodies_and_damped_contacts_balance():
    """The last law may pull, so that its damper acts as long as it is closed."""
    pair = il.Network(
        {
            "a": il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.1),
            "b": il.LinearOscillator(mass=0.5, stiffness=1.5, damping=0.1),
        },
        {
            "rigid": il.Contact("a", "b", il.RigidContact(0.7), clearance=0.1),
            "soft": il.Contact("b", il.WALL, il.KelvinVoigtContact(20.0, damping=0.3, tension=True), clearance=0.2),
        },
        {"a": il.Harmonic(2.0, frequency=1.3)},
    )
    data = il.lyapunov(pair, "all", duration=2000.0, rng=1)
    assert data.lyapunov_sum.item() == pytest.approx(data.lyapunov_sum_balance.item(), rel=1e-11)


@pytest.mark.full
def test_under_noise_paths_share_their_noise():
    """Differences of linear bodies do not feel noise; those of a harder spring do, with the same sum."""
    body = il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.2)
    linear = il.Network({"a": body}, excitations={"a": il.WhiteNoise(0.1)})
    found, errors, _ = exponents(linear, "all", tolerance=0.02, rng=1)
    assert (np.abs(found + 0.1) <= 4.0 * errors + 1e-6).all()
    contact = {"stop": il.Contact("a", il.WALL, il.HertzContact(60.0), clearance=0.2)}
    found, errors, _ = exponents(linear.replace(contacts=contact), "all", duration=200.0, rng=1)
    assert found.sum() == pytest.approx(-0.2, abs=1e-4)
    assert found[0] > -0.1 + 3.0 * errors[0]


@pytest.mark.full
def test_smooth_chaos_has_the_sum_of_its_dampers():
    well = il.DoubleWellOscillator(mass=1.0, damping=0.25, stiffness=0.0, repulsion=1.0, cubic=1.0)
    network = il.Network({"a": well}, excitations={"a": il.Harmonic(0.3, frequency=1.0)})
    found, errors, _ = exponents(network, "all", duration=300.0, rng=1)
    assert found.sum() == pytest.approx(-0.25, abs=1e-3)
    assert found[0] > 5.0 * errors[0]


@pytest.mark.full
def test_exponents_can_be_found_again(tmp_path):
    data = il.lyapunov(stop(**CHAOS), duration=2000.0, rng=5)
    il.save(data, tmp_path / "exponents.nc")
    again = il.rerun(tmp_path / "exponents.nc")
    assert again.lyapunov_exponent.values.tolist() == data.lyapunov_exponent.values.tolist()
    assert il.network_of(data) == stop(**CHAOS)


def test_time_that_is_over_is_said():
    with pytest.warns(il.AccuracyWarning, match="The time is over"):
        data = il.lyapunov(stop(**CHAOS), tolerance=1e-6, max_seconds=0.05, rng=1)
    assert data.lyapunov_exponent_standard_error.item() > 0.0


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((stop(), 3), {}, "from 1 to 2"),
        ((stop(), "most"), {}, "whole number"),
        (("stop",), {}, "must be an il.Network"),
        ((stop(),), {"paths": 0}, "at least 1"),
        ((stop(),), {"tolerance": 0.0}, "tolerance"),
        ((il.Network({"a": il.LinearOscillator(mass=1.0, stiffness=1.0)}),), {}, "transient="),
        ((stop().replace(excitations={"a": il.WhiteNoise(1.0)}),), {}, "part there by the root"),
        (
            (stop().replace(excitations={"a": il.OrnsteinUhlenbeckNoise(1.0, correlation_time=0.5)}),),
            {},
            "rigid contacts such as 'stop'",
        ),
        (
            (
                stop(il.LinearContact(60.0)).replace(
                    excitations={"b": il.Source(il.ShinozukaNoise(0.1, band=(0.1, 1.0)), on={"a": 1.0})}
                ),
            ),
            {},
            "cosines",
        ),
    ],
)
def test_bad_input(arguments, options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.lyapunov(*arguments, **options)


@pytest.mark.full
@pytest.mark.parametrize("noise", [False, True])
def test_an_interrupt_has_the_exponents_until_then(noise):
    """Of paths that are as long as is told."""
    network = stop(**CHAOS)
    if noise:
        network = stop(il.HertzContact(60.0)).replace(excitations={"a": il.WhiteNoise(0.1)})

    def show(part):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as raised:
        il.lyapunov(network, tolerance=1e-4, rng=1, progress=show)
    found = raised.value.found
    assert found.lyapunov_exponent_standard_error.item() > 0.0
    assert found.time.values[-1] == pytest.approx(found.attrs["duration"])
    assert "found" in raised.value.__notes__[0]
