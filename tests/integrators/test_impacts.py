"""Rigid contacts: impacts within steps, their order, rests; exact laws and balances under noise.

Ensembles are campaigns: their loop takes a quarter of a minute to compile.
"""

import math
import warnings
from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.mechanisms.rigid_contacts.impacts import MANY
from impactlab.mechanisms.rigid_contacts.rigid import RigidImpacts
from impactlab.plan.events import Events

FREE = il.LinearOscillator(mass=1.0, damping=0.0, stiffness=0.0)
PLAIN = il.ExactFlow(measured=False)


def wall(restitution, clearance=1.0, damping_ratio=0.05, **fields):
    """A body under noise beside a wall."""
    body = il.LinearOscillator.from_frequency(1.0, damping_ratio)
    contact = il.Contact("a", il.WALL, il.RigidContact(restitution=restitution), clearance=clearance)
    return il.Network({"a": body}, {"c": contact}, **({"excitations": {"a": il.WhiteNoise(1.0)}} | fields))


def path(network, x, v, duration, step, **options):
    """One path from a state, with a sample after every step."""
    initial = {"displacement": x, "velocity": v}
    record = il.Trajectory(step)
    return il.simulate(network, duration, step=step, initial=initial, record=record, integrator=PLAIN, **options)


def ball(restitution):
    """A ball above a table, which falls with 10 m/s²."""
    contact = il.Contact(il.WALL, "ball", il.RigidContact(restitution=restitution))
    return il.Network({"ball": FREE}, {"table": contact}, {"ball": il.ConstantForce(load=-10.0)})


def bouncing(name):
    """Expect to be told that a contact comes to rest by endlessly many impacts."""
    return pytest.warns(il.AccuracyWarning, match=f"'{name}' comes to rest by bouncing")


@pytest.mark.full
@pytest.mark.parametrize("step", [0.01, 0.037])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8, 1.0])
def test_ball_bounces_and_comes_to_rest(restitution, step):
    """Parabolas are cubics: to rounding at any step, until the bouncing ends; then the ball stays on the table."""
    with bouncing("table") if 0.0 < restitution < 1.0 else nullcontext():
        result = path(ball(restitution), {"ball": 1.0}, {"ball": 0.0}, 10.0, step)
    times, expected = result.time.values, np.zeros(result.time.size)
    begin, height, velocity = 0.0, 1.0, 0.0
    while begin < 10.0 and (height > 0.0 or velocity > 1e-9):
        flight = (velocity + math.sqrt(velocity**2 + 20.0 * height)) / 10.0
        since = times - begin
        now = (since >= 0.0) & (since <= flight)
        expected[now] = height + velocity * since[now] - 5.0 * since[now] ** 2
        begin, height, velocity = begin + flight, 0.0, restitution * (10.0 * flight - velocity)
    np.testing.assert_allclose(result.displacement.values[0, :, 0], expected, atol=1e-12)
    assert float(result.contact_ratio[0]) == pytest.approx(max(0.0, 1.0 - begin / 10.0), abs=step / 10.0 + 1e-3)
    duration, final = result.attrs["duration"], result.velocity.values[0, -1, 0]
    assert float(result.mean_contact_force[0]) * duration == pytest.approx(10.0 * duration + final, rel=1e-9)


@pytest.mark.parametrize("step", [0.01, 0.037])
@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8])
def test_fast_impacts_of_a_ball_are_counted(restitution, step):
    """Of endlessly many those that close with ``e^k √(2gh)`` above a threshold; beginnings of rests are none."""
    with bouncing("table"):
        result = path(ball(restitution), {"ball": 1.0}, {"ball": 0.0}, 10.0, step)
    threshold = float(result.impact_velocity_threshold[0])
    number = 1 + math.floor(math.log(threshold / math.sqrt(20.0)) / math.log(restitution))
    assert float(result.contact_rate[0]) * result.attrs["duration"] == pytest.approx(number)
    assert "only faster impacts count" in result.contact_rate.attrs["comment"]


def test_no_rate_no_word_of_its_threshold():
    """Without `contact_rate`, without loss and where nothing is too slow to count."""
    fall = path(ball(0.5), {"ball": 1.0}, {"ball": 0.0}, 2.0, 0.01, statistics="mean_contact_force", realizations=32)
    elastic = path(ball(1.0), {"ball": 1.0}, {"ball": 0.0}, 2.0, 0.01)
    short = path(ball(0.5), {"ball": 1.0}, {"ball": 0.0}, 0.5, 0.01)  # one impact
    for result in (fall, elastic, short):
        assert "impact_velocity_threshold" not in result
    assert float(short.contact_rate[0]) * 0.5 == pytest.approx(1.0)


def located_impacts(restitution, threshold, frequency, periods):
    """Fast impacts of a driven body beside a stop in the last of some periods, each located by DOP853."""

    def hit(t, y):
        return y[0] - 0.1

    def motion(t, y):
        return [y[1], math.sin(frequency * t) - y[0] - 0.1 * y[1]]

    hit.terminal, hit.direction = True, 1
    length, number = 2.0 * math.pi / frequency, 0
    time, state, end = 0.0, [0.0, 0.0], periods * length
    while time < end:
        part = solve_ivp(motion, (time, end), state, method="DOP853", events=hit, rtol=1e-12, atol=1e-14)
        time, closing = part.t[-1], part.y[1, -1]
        number += part.status == 1 and closing >= threshold and time > end - length
        state = [0.1 - 1e-15, -restitution * closing]
        pressed = math.sin(frequency * time) > 0.1
        if closing < 1e-7 and pressed:  # at rest until the force no longer holds it
            time += (math.pi - math.asin(0.1) - frequency * time) % (2.0 * math.pi) / frequency
            state = [0.1 - 1e-15, 0.0]
    return number


@pytest.mark.full
@pytest.mark.parametrize("frequency", [0.3, 0.5])
def test_fast_impacts_of_a_stop_that_is_driven_to_chatter(frequency):
    """Their number in a period does not depend on the step, and is that of located impacts."""
    network = wall(0.5, 0.1, excitations={"a": il.Harmonic(1.0, frequency=frequency)})
    period, found = 2.0 * math.pi / frequency, []
    for step in (0.1, 0.05, 0.02):
        options = {"step": period / round(period / step), "spin_up": 10.0 * period, "integrator": PLAIN}
        with bouncing("c"):
            result = il.simulate(network, 5.0 * period, **options)
        found.append(float(result.contact_rate[0]) * period)
    threshold = float(result.impact_velocity_threshold[0])
    assert found == pytest.approx([located_impacts(0.5, threshold, frequency, 5)] * 3)


def gusts(restitution):
    """A body that coloured noise presses against a stop."""
    noise = il.Source(il.OrnsteinUhlenbeckNoise(0.05, correlation_time=0.5), on="a")
    contact = il.Contact("a", il.WALL, il.RigidContact(restitution), clearance=0.05)
    return il.Network({"a": il.LinearOscillator.from_frequency(2.0, 0.05)}, {"c": contact}, {"s": noise})


def fast_impacts_under_gusts(restitution, threshold, step=5e-4, paths=2000, spin_up=30.0, duration=60.0):
    """Rate of the fast impacts of `gusts` and its standard error, from small steps that share no code."""
    rng, deviation, kept = np.random.default_rng(5), math.sqrt(0.1 * math.pi), math.exp(-2.0 * step)
    x, v, force = np.full(paths, -0.3), np.zeros(paths), deviation * rng.standard_normal(paths)
    number = np.zeros(paths)
    for count in range(round((spin_up + duration) / step)):
        force = kept * force + deviation * math.sqrt(1.0 - kept**2) * rng.standard_normal(paths)
        v += step * (force - 4.0 * x - 0.2 * v)
        x += step * v
        beyond = np.flatnonzero(x > 0.05)
        closing, late = v[beyond], x[beyond] - 0.05
        x[beyond] = 0.05 - np.where(closing > 0.0, restitution * late, 0.0)
        v[beyond] = np.where(closing > 0.0, -restitution * closing, closing)
        if count * step >= spin_up:
            number[beyond] += closing >= threshold
    return float(number.mean() / duration), float(number.std() / duration / math.sqrt(paths))


@pytest.mark.campaign
@pytest.mark.parametrize("restitution", [0.2, 0.6])
def test_rate_of_fast_impacts_under_coloured_noise(restitution):
    """It has a limit, which the automatic step reaches without many steps."""
    rates = []
    for step in (None, 0.02, 0.005):
        with bouncing("c"):
            result = il.simulate(gusts(restitution), 60.0, realizations=2048, step=step, rng=1)
        assert result.attrs["step"] > 0.01 or step == 0.005
        rates.append((float(result.contact_rate[0]), float(result.contact_rate_standard_error[0])))
    rates.append(fast_impacts_under_gusts(restitution, float(result.impact_velocity_threshold[0])))
    for (one, one_error), (other, other_error) in pairwise(rates):
        assert abs(one - other) < 3.5 * math.hypot(one_error, other_error)
        assert math.hypot(one_error, other_error) < 0.01 * one


@pytest.mark.full
def test_path_between_impacts_is_of_third_order():
    """An undamped body on a spring swings between a wall and its turning point."""
    network = wall(1.0, 0.5, 0.0, excitations={})
    swing = math.acos(-0.5)
    errors = []
    for step in (0.2, 0.1, 0.05, 0.025):
        result = path(network, {"a": -1.0}, {"a": 0.0}, 20.0, step)
        phase = np.mod(result.time.values, 2.0 * swing)
        expected = -np.cos(np.where(phase < swing, phase, 2.0 * swing - phase))
        errors.append(np.abs(result.displacement.values[0, :, 0] - expected).max())
        assert float(result.contact_rate[0]) * 20.0 == pytest.approx(5.0)
    assert np.polyfit(np.log([0.2, 0.1, 0.05, 0.025]), np.log(errors), 1)[0] > 2.8
    assert errors[1] < 1e-4


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:'table' comes to rest")
@pytest.mark.parametrize("steps", [1, 3, 10, 40])
@pytest.mark.parametrize("other", [None, 1, 4])
def test_samples_of_forces_hold_all_impulses(steps, other):
    """Whatever the interval: of impacts in the first step and between samples, of a rest, beside another record."""
    interval, further = steps * 0.01, [il.PhaseMeans(period=0.01 * other, phases=1)] if other else []
    options = {"duration": 1.2, "step": 0.01, "integrator": PLAIN}
    begin = {"displacement": {"ball": 1e-3}, "velocity": {"ball": -2.0}}  # rests after 0.4 s
    whole = il.simulate(ball(0.5), initial=begin, record=[il.Trajectory(interval), *further], **options)
    impulses = interval * whole.contact_force.values[0, :, 0]
    assert impulses[0] == 0.0
    assert impulses.sum() == pytest.approx(1.2 * float(whole.mean_contact_force[0]), rel=1e-13)
    every = 0.01 * path(ball(0.5), begin["displacement"], begin["velocity"], 1.2, 0.01).contact_force.values[0, 1:, 0]
    assert np.count_nonzero(every[:39]) < 10  # the steps between the impacts are free
    np.testing.assert_allclose(impulses[1:], every.reshape(-1, steps).sum(axis=1), atol=1e-13)
    assert "over the interval" in whole.contact_force.attrs["comment"]


@pytest.mark.filterwarnings("ignore:'table' comes to rest")
def test_samples_of_forces_in_two_parts_and_in_a_file(tmp_path):
    """At the cut the ball bounces, or rests."""
    for height in (0.05, 1.0):
        begin = {"displacement": {"ball": height}}
        record, options = [il.Trajectory(0.05), il.FinalState()], {"step": 0.01, "integrator": PLAIN}
        whole = il.simulate(ball(0.5), 1.2, initial=begin, record=record, out=tmp_path / f"{height}.nc", **options)
        first = il.simulate(ball(0.5), 0.6, initial=begin, record=record, **options)
        second = il.simulate(ball(0.5), 0.6, initial=first, record=record, **options)
        both = np.concatenate([first.contact_force.values, second.contact_force.values[:, 1:]], axis=1)
        np.testing.assert_allclose(both, whole.contact_force.values, atol=1e-12)
        assert whole.contact_force.attrs == first.contact_force.attrs
        whole.close()


@pytest.mark.campaign
def test_samples_of_forces_of_an_ensemble_hold_all_impulses():
    """After a spin-up, in several blocks and batches, with a contact that is not rigid beside."""
    soft = {"soft": il.Contact(il.WALL, "a", il.LinearContact(100.0), clearance=0.5)}
    network = wall(0.8, 0.3)
    network = network.replace(contacts={**network.contacts, **soft})
    options = {"realizations": 700, "step": 0.02, "integrator": PLAIN, "rng": 1}
    runs = {
        steps: il.simulate(network, 24.0, record=[il.Trajectory(0.02 * steps), il.PerRealization()], **options)
        for steps in (1, 5, 60)
    }
    for steps, run in runs.items():
        np.testing.assert_array_equal(run.mean_contact_force, runs[1].mean_contact_force)
        impulses = 0.02 * steps * run.contact_force.sel(contact="c").sum("time")
        expected = 24.0 * run.mean_contact_force_by_realization.sel(contact="c")
        np.testing.assert_allclose(impulses, expected, rtol=1e-12)
        soft = runs[1].contact_force.sel(contact="soft")[:, ::steps]
        np.testing.assert_array_equal(run.contact_force.sel(contact="soft"), soft)


def test_balls_in_a_row_pass_an_impact_on():
    """Simultaneous impacts follow each other: the last ball leaves with the velocity of the first."""
    names = [f"ball {k}" for k in range(5)]
    contacts = {
        f"{one}, {other}": il.Contact(one, other, il.RigidContact(restitution=1.0)) for one, other in pairwise(names)
    }
    network = il.Network(dict.fromkeys(names, FREE), contacts)
    result = path(network, {"ball 0": -1.0}, {"ball 0": 1.0}, 2.1, 0.03)
    np.testing.assert_allclose(result.velocity.values[0, -1], [0.0, 0.0, 0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(result.contact_rate * result.attrs["duration"], 1.0)
    np.testing.assert_allclose(result.mean_contact_force * result.attrs["duration"], 1.0)


def test_unequal_masses_exchange_momentum():
    """Newton's law of two free bodies, the second of which then meets a third."""
    bodies = {name: FREE.replace(mass=mass) for name, mass in (("a", 2.0), ("b", 1.0), ("c", 3.0))}
    law = il.RigidContact(restitution=0.6)
    network = il.Network(bodies, {"ab": il.Contact("a", "b", law), "bc": il.Contact("b", "c", law, clearance=1.0)})
    result = path(network, {"a": -0.5}, {"a": 1.0}, 1.2, 0.05)
    a, b = 1.0 - 1.6 / 3.0, 1.6 * 2.0 / 3.0
    np.testing.assert_allclose(result.velocity.values[0, -1], [a, b, 0.0], atol=1e-12)
    result = path(network, {"a": -0.5}, {"a": 1.0}, 1.8, 0.05)
    np.testing.assert_allclose(result.velocity.values[0, -1, 1:], [b - 1.6 * 0.75 * b, 1.6 * 0.25 * b], atol=1e-12)


@pytest.mark.parametrize(
    ("frequency", "restitution", "clearance", "number"), [(2.2, 0.7, 0.1, 1), (4.2, 0.7, 0.0, 2), (3.8, 0.6, 0.0, 2)]
)
def test_impacts_of_a_periodic_orbit(frequency, restitution, clearance, number):
    """``x'' + x = α cos ωt`` against a stop: one impact in n periods, at a velocity V of the known condition

    ``Γ² = [(1 − e) V/2ω]² + [d + (1 + e) V cot(T/2)/2]²`` with ``Γ = α/(1 − ω²)``, T = 2πn/ω.
    """
    period = 2.0 * math.pi * number / frequency
    amplitude = 1.0 / (1.0 - frequency**2)

    def condition(v):
        along = clearance + (1.0 + restitution) * v / math.tan(0.5 * period) / 2.0
        return ((1.0 - restitution) * v / (2.0 * frequency)) ** 2 + along**2 - amplitude**2

    velocity = brentq(condition, 1e-3, 10.0, xtol=1e-14)
    force = {"a": il.Harmonic(amplitude=1.0, frequency=frequency)}
    errors = []
    for steps in (40, 80, 160):
        network = wall(restitution, clearance, 0.0, excitations=force)
        start = {"displacement": {"a": -1.0}, "velocity": {"a": 0.0}}
        result = il.simulate(
            network,
            20.0 * period,
            spin_up=200.0 * period,
            step=period / number / steps,
            initial=start,
            integrator=PLAIN,
        )
        assert float(result.contact_rate[0]) * period == pytest.approx(1.0)
        found = float(result.mean_contact_force[0]) * period / (1.0 + restitution)
        errors.append(abs(found / velocity - 1.0))
    assert errors[2] < 1e-6
    assert errors[2] < errors[0] / 16.0


@pytest.mark.full
def test_rest_ends_when_nothing_presses():
    """A ball rests on a table until a growing force lifts it, then flies as if it began there."""

    class Lift(il.Excitation):
        @staticmethod
        def force(time):
            return -10.0 + 10.0 * time

    contact = il.Contact(il.WALL, "ball", il.RigidContact(restitution=0.5))
    network = il.Network({"ball": FREE}, {"table": contact}, {"ball": Lift()})
    result = path(network, {"ball": 0.0}, {"ball": 0.0}, 2.0, 0.0125)
    late = np.maximum(result.time.values - 1.0, 0.0)
    np.testing.assert_allclose(result.displacement.values[0, :, 0], 10.0 * late**3 / 6.0, atol=1e-9)
    assert float(result.contact_ratio[0]) == pytest.approx(0.5, abs=0.01)
    assert float(result.mean_contact_force[0]) * 2.0 == pytest.approx(5.0, rel=1e-3)


def test_endless_impacts_end():
    """Without loss a body that something presses bounces ever shorter flights: it rests after many in a step."""
    result = path(ball(1.0), {"ball": 10.0 * (0.1 / MANY / 4.0) ** 2}, {"ball": 0.0}, 1.0, 0.1)
    assert np.abs(result.displacement.values).max() < 1e-6
    assert float(result.mean_contact_force[0]) == pytest.approx(10.0, rel=1e-3)


def squeezed(mass_ratio):
    """A ball at rest between a wall and a heavy body that approaches, without loss, until the body turns back.

    There are as many impacts as the angle ``arctan(mass_ratio^(−1/2))`` goes into π, less one if it is a divisor
    (G. Galperin, Regul. Chaotic Dyn. 8, 2003, 375).
    """
    law = il.RigidContact(restitution=1.0)
    contacts = {"wall": il.Contact("ball", il.WALL, law, clearance=1.0), "between": il.Contact("heavy", "ball", law)}
    network = il.Network({"ball": FREE, "heavy": FREE.replace(mass=mass_ratio)}, contacts)
    return path(network, {"ball": 0.0, "heavy": -1.0}, {"heavy": 1.0}, 12.0, 0.1)


@pytest.mark.parametrize("mass_ratio", [100.0, 1e4])
def test_impacts_of_a_ball_between_a_wall_and_a_heavy_body(mass_ratio):
    """Each impact with the body turns both velocities, times the roots of the masses, by twice the angle."""
    angle = math.atan(mass_ratio**-0.5)
    number = math.ceil(math.pi / angle) - 1
    between, result = math.ceil(number / 2), squeezed(mass_ratio)
    assert (result.contact_rate * result.attrs["duration"]).values == pytest.approx([number - between, between])
    turned = 2.0 * angle * between
    last = result.velocity.values[0, -1]
    assert abs(last[0]) == pytest.approx(mass_ratio**0.5 * abs(math.sin(turned)), rel=1e-5)
    assert last[1] == pytest.approx(math.cos(turned), abs=1e-9)


def test_chatter_that_does_not_end_is_told_with_contact_and_time():
    """31 415 impacts, nearly all of them in one step."""
    message = r"Chatter of 'wall' does not end: it had more than 1000 impacts in the step at t = 1\.9 s"
    with pytest.warns(il.AccuracyWarning, match=message):
        squeezed(1e8)


@pytest.mark.campaign
@pytest.mark.parametrize("step", [0.2, 0.4])
def test_truncated_normal_law(step):
    """Impacts without loss leave the Gibbs law, at steps that are no shorter than a fifteenth of the period."""
    network = wall(1.0)
    result = il.simulate(network, 1500.0, realizations=1024, step=step, integrator=PLAIN, rng=1)
    expected = il.exact(network).statistics()
    for name in ("mean_displacement", "mean_square_displacement", "mean_square_velocity", "mean_contact_force"):
        value, exact, error = (
            item[0].item() for item in (result[name], expected[name], result[f"{name}_standard_error"])
        )
        assert abs(value - exact) < 4.0 * error + 2e-3 * abs(exact), name
    rate, exact = result.contact_rate[0].item(), expected.contact_rate[0].item()
    assert abs(rate - exact) < 4.0 * result.contact_rate_standard_error[0].item() + 3e-3 * exact
    assert np.isnan(result.get("peak_contact_force", np.nan)).all()


def test_exact_law_is_the_truncated_normal():
    from scipy.stats import truncnorm

    temperature = math.pi / 0.1
    for clearance in (1.0, -3.0):
        network = wall(1.0, clearance)
        law = il.exact(network)
        spread = math.sqrt(temperature)
        normal = truncnorm(-np.inf, clearance / spread, scale=spread)
        found = law.statistics()
        assert found.mean_displacement[0].item() == pytest.approx(normal.mean(), rel=1e-9)
        assert found.variance_displacement[0].item() == pytest.approx(normal.var(), rel=1e-9)
        density = normal.pdf(clearance)
        assert found.mean_contact_force[0].item() == pytest.approx(temperature * density, rel=1e-9)
        assert found.contact_rate[0].item() == pytest.approx(math.sqrt(temperature / (2.0 * math.pi)) * density)
        assert found.contact_ratio[0].item() == 0.0
        places = np.linspace(-15.0, clearance, 7)
        np.testing.assert_allclose(law.density("a", "displacement", places), normal.pdf(places), rtol=1e-9)


def averaged(restitution, clearance, damping_ratio):
    """E[v²] and the rate of impacts of `wall` by stochastic averaging: m = ω = S = 1.

    With the time T(E) of a cycle of the energy E and ``J = ∮ v dx``, noise adds to E the mean π and the variance
    2πJ/T in unit time, friction takes c J/T and an impact ``L = (1 − e²) v²/2``, so that the density of E is as
    ``T exp(−∫ (c + L/J) dE/π)``.
    """
    energy = np.linspace(0.0, 4e3, 400_001)[1:]
    largest = np.sqrt(2.0 * energy)  # amplitude without a wall
    hits = largest > abs(clearance)
    angle = np.arcsin(np.where(hits, clearance / largest, 1.0))
    period = 2.0 * angle + math.pi
    action = 2.0 * energy * (angle + 0.5 * math.pi + np.sin(angle) * np.cos(angle))
    loss = (1.0 - restitution**2) * np.where(hits, energy - 0.5 * clearance**2, 0.0)
    decay = np.cumsum(2.0 * damping_ratio + loss / action) * (energy[1] - energy[0]) / math.pi
    density = period * np.exp(-decay)
    density /= density.sum()
    return float((density * action / period).sum()), float((density * hits / period).sum())


@pytest.mark.campaign
@pytest.mark.parametrize("clearance", [0.0, 5.0])
def test_weak_loss_at_a_wall(clearance):
    """E[v²] and the rate of impacts against stochastic averaging, whose own error is as the loss in a period.

    Forces balance whatever the loss.
    """
    restitution = 0.97
    network = wall(restitution, clearance, 0.01)
    result = il.simulate(network, 3000.0, realizations=512, rng=3)
    loss = 0.02 + (1.0 - restitution**2) / math.pi
    names = "mean_square_velocity", "contact_rate"
    for name, expected in zip(names, averaged(restitution, clearance, 0.01), strict=True):
        value, error = result[name][0].item(), result[f"{name}_standard_error"][0].item()
        assert abs(value - expected) < 4.0 * error + 0.2 * loss * expected, name
    force, shift = result.mean_contact_force[0].item(), result.mean_displacement[0].item()
    errors = result.mean_contact_force_standard_error[0].item(), result.mean_displacement_standard_error[0].item()
    assert abs(force + shift) < 4.0 * np.hypot(*errors)


def event_driven(restitution, step=0.00125, paths=4096, duration=150.0):
    """E[v²] and the rate of impacts of `wall(restitution)` with standard errors, from a simulation that shares no code.

    Linear motion under noise in short exact steps; a body that is beyond the wall at the end of one is reflected.
    """
    drift, noise = np.array([[0.0, 1.0], [-1.0, -0.1]]), np.diag([0.0, 2.0 * math.pi])
    whole = expm(step * np.block([[-drift, noise], [np.zeros((2, 2)), drift.T]]))  # C. F. Van Loan, 1978
    flow = whole[2:, 2:].T
    root = np.linalg.cholesky(flow @ whole[:2, 2:])
    rng = np.random.default_rng(20)
    state, squares, impacts = np.zeros((2, paths)), np.zeros(paths), np.zeros(paths)
    spin_up, steps = round(60.0 / step), round(duration / step)
    for number in range(spin_up + steps):
        state = flow @ state + root @ rng.standard_normal((2, paths))
        beyond = state[0] > 1.0
        hit = beyond & (state[1] > 0.0)
        state[0, beyond] = 1.0 - restitution * (state[0, beyond] - 1.0)
        state[1, hit] *= -restitution
        if number >= spin_up:
            squares += state[1] ** 2
            impacts += hit
    found = squares / steps, impacts / (steps * step)
    return [(float(item.mean()), float(item.std() / math.sqrt(paths))) for item in found]


@pytest.mark.campaign
@pytest.mark.parametrize("restitution", [0.5, 0.9])
def test_noise_and_loss_against_an_event_driven_simulation(restitution):
    endless = restitution < 0.66
    with pytest.warns(il.AccuracyWarning, match="impacts that the step of") if endless else nullcontext():
        result = il.simulate(wall(restitution), 400.0, realizations=2048, rng=21)
    for name, (value, error) in zip(("mean_square_velocity", "contact_rate"), event_driven(restitution), strict=True):
        if name == "contact_rate" and endless:
            continue  # it is one of the step, in both
        own, own_error = result[name][0].item(), result[f"{name}_standard_error"][0].item()
        assert abs(own - value) < 3.0 * math.hypot(own_error, error), name
        assert math.hypot(own_error, error) < 0.01 * value, name


@pytest.mark.campaign
def test_same_paths_alone_and_among_others():
    network = wall(0.7)
    record = il.PerRealization()
    options = {"step": 0.1, "integrator": PLAIN, "record": record, "rng": 5}
    many = il.simulate(network, 50.0, realizations=64, **options)
    with pytest.warns(il.AccuracyWarning, match="Too few independent samples"):
        alone = il.simulate(network, 50.0, realizations=1, **options)
    for name in ("mean_square_velocity_by_realization", "contact_rate_by_realization"):
        assert alone[name][0].values == many[name][0].values


@pytest.mark.campaign
@pytest.mark.parametrize("scene", ["beam", "pair"])
def test_laws_of_structures_and_pairs(scene):
    """Default settings against exact laws."""
    law = il.RigidContact(restitution=1.0)
    if scene == "beam":
        beam = il.ModalStructure([1.0, 6.0, 17.0], [0.05, 0.05 / 6.0, 0.05 / 17.0], points={"tip": [2.0, -2.0, 2.0]})
        noises = {f"beam.{mode}": il.WhiteNoise(1.0) for mode in (1, 2, 3)}
        network = il.Network({"beam": beam}, {"stop": il.Contact("beam.tip", il.WALL, law, clearance=3.0)}, noises)
    else:
        bodies = {
            "a": il.LinearOscillator.from_frequency(1.0, 0.05),
            "b": il.LinearOscillator.from_frequency(2.0, 0.05),
        }
        noises = {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(2.0)}
        network = il.Network(bodies, {"c": il.Contact("a", "b", law, clearance=1.0)}, noises)
    result = il.simulate(network, 3000.0, realizations=512, rng=4)
    expected = il.exact(network).statistics()
    for name in ("mean_displacement", "mean_square_displacement", "mean_square_velocity", "contact_rate"):
        value, exact, error = (item.values for item in (result[name], expected[name], result[f"{name}_standard_error"]))
        assert (np.abs(value - exact) < 4.0 * error + 3e-3 * np.abs(exact)).all(), name


def test_what_rigid_contacts_refuse():
    network = wall(0.5)
    with pytest.raises(il.InvalidInput, match=r"restitution.*1\.5"):
        il.RigidContact(restitution=1.5)
    with pytest.raises(il.InvalidInput, match=r"RungeKutta4 knows no rigid contacts such as 'c'; use il.ExactFlow"):
        il.simulate(network, 10.0, integrator=il.RungeKutta4())
    with pytest.raises(il.InvalidInput, match="'c' is a RigidContact: its impacts have an impulse"):
        il.simulate(network, 10.0, record=il.PeakForces())
    with pytest.raises(il.InvalidInput, match="knows no rigid contacts such as 'c'"):
        network.compile()
    with pytest.raises(il.NoExactReference, match="impacts of contact 'c' take energy; with restitution=1"):
        il.exact(network)
    with pytest.raises(il.NoExactReference, match="is a RigidContact: its impacts have an impulse"):
        il.exact(wall(1.0)).crossing_rate("c", "contact_force", 1.0)
    body, law = il.LinearOscillator.from_frequency(1.0, 0.05), il.RigidContact(restitution=1.0)
    row = il.chain(3, body, law, excitation=il.WhiteNoise(1.0))
    with pytest.raises(il.NoExactReference, match="with impulsive contacts the law is computed for a body"):
        il.exact(row)


def test_restitution_of_a_rigid_contact_is_its_own():
    law = il.RigidContact(restitution=0.7)
    assert law.restitution_at(2.0, 3.0) == 0.7
    assert law.calibrate(restitution=0.3, velocity=1.0, mass=1.0) == il.RigidContact(restitution=0.3)


def test_networks_without_rigid_contacts_run_without_impacts():
    """Their blocks hold nothing for impacts, and nothing of it is compiled."""
    network = wall(1.0).replace(contacts={"c": il.Contact("a", il.WALL, il.HertzContact(10.0))})
    model = Model.of(network)
    assert Events.of(model, 0.1, (0, 0)).parts == ()


def test_noise_of_both_bodies_hides_nothing_of_their_gap():
    """What noise adds to the rate of a gap: both noises where they are independent, nothing of one that moves both."""
    body, law = il.LinearOscillator.from_frequency(1.0, 0.05), il.RigidContact(restitution=1.0)
    contacts = {"c": il.Contact("a", "b", law)}
    noise = il.WhiteNoise(1.0)
    apart = il.Network({"a": body, "b": body}, contacts, {"a": noise, "b": noise})
    together = il.Network({"a": body, "b": body}, contacts, {"both": il.Source(noise, on={"a": 1.0, "b": 1.0})})
    spreads = [RigidImpacts.of(Model.of(network), 0.1, (0, 0)).spread for network in (apart, together)]
    assert spreads[0] == pytest.approx(math.sqrt(4.0 * math.pi))
    assert spreads[1] == 0.0


def test_orders_of_the_rate_of_impacts():
    """They fall with the loss, to 0 at exp(−π/√3); at e = 0.7 and 0.3 from the condition by hand."""
    networks = [wall(restitution) for restitution in (1.0, 0.7, 0.3, 0.2, 0.16, 0.0)]
    orders = [float(RigidImpacts.of(Model.of(network), 0.1, (0, 0)).orders[0]) for network in networks]
    assert orders[0] == 1.0
    assert orders[1:3] == pytest.approx([0.757, 0.2], abs=1e-3)
    assert sorted(orders, reverse=True) == orders
    assert orders[4] == orders[5] == 0.05


@pytest.mark.campaign
def test_impacts_that_no_step_resolves_are_told():
    with pytest.warns(il.AccuracyWarning, match=r"contact_rate of 'c' counts the impacts .* to the power of 0\.2"):
        il.simulate(wall(0.3), 200.0, realizations=64, step=0.1, integrator=PLAIN)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        il.simulate(wall(0.7), 200.0, realizations=64, step=0.1, integrator=PLAIN)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("number", [3, 6])
def test_stack_rests(number, restitution):
    """Balls that lie on each other stay there: each contact carries the weight above it, and no impact counts."""
    names, law = [f"ball {k}" for k in range(number)], il.RigidContact(restitution=restitution)
    contacts = {f"under {above}": il.Contact(below, above, law) for below, above in pairwise([il.WALL, *names])}
    weights = dict.fromkeys(names, il.ConstantForce(load=-10.0))
    network = il.Network(dict.fromkeys(names, FREE), contacts, weights)
    result = path(network, dict.fromkeys(names, 0.0), dict.fromkeys(names, 0.0), 0.5, 0.01)
    assert np.abs(result.displacement.values).max() < 1e-14
    np.testing.assert_allclose(result.mean_contact_force, 10.0 * np.arange(number, 0, -1), rtol=1e-9)
    np.testing.assert_array_equal(result.contact_ratio, 1.0)
    if restitution < 1.0:
        np.testing.assert_array_equal(result.contact_rate, 0.0)


def test_high_stack_that_does_not_settle_within_a_step_is_held():
    names, law = [f"ball {k}" for k in range(20)], il.RigidContact(restitution=0.5)
    contacts = {f"under {above}": il.Contact(below, above, law) for below, above in pairwise([il.WALL, *names])}
    weights = dict.fromkeys(names, il.ConstantForce(load=-10.0))
    network = il.Network(dict.fromkeys(names, FREE), contacts, weights)
    with pytest.warns(il.AccuracyWarning, match="'under ball .* in the step at t = 0 s.* as had 1. other contact"):
        result = path(network, dict.fromkeys(names, 0.0), dict.fromkeys(names, 0.0), 0.1, 0.01)
    assert np.abs(result.displacement.values).max() < 1e-7
    np.testing.assert_allclose(result.mean_contact_force, 10.0 * np.arange(20, 0, -1), rtol=1e-3)


@pytest.mark.parametrize("damping", [0.0, 20.0])
@pytest.mark.parametrize("stiffness", [0.0, 4.0])
def test_force_on_a_body_at_rest_is_all_that_presses_it(damping, stiffness):
    """Also where friction would have taken much of it within a step."""
    body = il.LinearOscillator(mass=1.0, damping=damping, stiffness=stiffness)
    stop = il.Contact("a", il.WALL, il.RigidContact(restitution=0.5), clearance=0.1)
    network = il.Network({"a": body}, {"stop": stop}, {"a": il.ConstantForce(load=3.0)})
    result = path(network, {"a": 0.1}, {"a": 0.0}, 2.0, 0.05)
    assert float(result.mean_contact_force[0]) == pytest.approx(3.0 - 0.1 * stiffness, rel=3e-4)
    assert float(result.contact_ratio[0]) == 1.0


@pytest.mark.full
@pytest.mark.parametrize("load", [2.0, -1.0])
def test_rest_under_kicks_of_a_coupling(load):
    """A spring that pulls a body to or off the wall acts in kicks: if the sum of forces presses it, it rests.

    Its bouncing ends some steps early, at velocities of about a kick.
    """
    anchor = il.LinearOscillator(mass=1e9, damping=0.0, stiffness=0.0)
    network = il.Network(
        {"a": FREE, "anchor": anchor},
        {"stop": il.Contact("a", il.WALL, il.RigidContact(restitution=0.7))},
        {"a": il.ConstantForce(load=load)},
        {"spring": il.Coupling("a", "anchor", il.LinearCoupling(stiffness=10.0, damping=0.0))},
    )
    there = (0.5 - load) / 10.0  # of the spring and the load, 0.5 N remain
    start, still = {"a": 0.0, "anchor": there}, {"a": 0.1, "anchor": 0.0}
    frequency, rebounds = math.sqrt(10.0), 0.1 * 0.7 ** np.arange(1, 100)
    flying = float((2.0 / frequency * np.arctan(rebounds / (0.05 * frequency))).sum())
    impulse = 1.7 * 0.1 / 0.3 + 0.5 * (4.0 - flying)
    for step in (0.01, 0.0025):
        with bouncing("stop"):
            result = path(network, start, still, 4.0, step)
        assert float(result.contact_rate[0]) * 4.0 < 25.0
        assert float(result.contact_ratio[0]) == pytest.approx(1.0 - flying / 4.0, abs=12.0 * step)
        assert float(result.mean_contact_force[0]) * 4.0 == pytest.approx(impulse, rel=0.4 * step)


@pytest.mark.full
@pytest.mark.parametrize("restitution", [0.8, 1.0])
def test_impacts_between_kicks_are_of_second_order(restitution):
    """A Duffing oscillator against a stop: kicks act at the ends of steps, impacts anywhere; against DOP853."""
    duration, clearance, cubic = 12.0, 0.5, 0.3

    def hit(t, y):
        return y[0] - clearance

    hit.terminal, hit.direction = True, 1
    time, state = 0.0, np.array([-1.0, 0.0])
    while time < duration:
        part = solve_ivp(
            lambda t, y: [y[1], -y[0] - cubic * y[0] ** 3], (time, duration), state, method="DOP853", events=hit,
            rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        time, state = part.t[-1], part.y[:, -1].copy()
        if part.status == 1:
            state = np.array([clearance - 1e-15, -restitution * state[1]])
    body = il.DuffingOscillator(mass=1.0, damping=0.0, stiffness=1.0, cubic=cubic)
    contact = il.Contact("a", il.WALL, il.RigidContact(restitution=restitution), clearance=clearance)
    network = il.Network({"a": body}, {"c": contact})
    for step in (0.1, 0.05, 0.025):
        result = path(network, {"a": -1.0}, {}, duration, step)
        found = result.displacement.values[0, -1, 0], result.velocity.values[0, -1, 0]
        assert np.abs(np.subtract(found, state)).max() < 0.2 * step**2, step


def test_start_inside_a_rigid_contact_is_refused():
    with pytest.raises(il.InvalidInput, match=r"'c' is rigid, and the start has its bodies 0\.5 m inside each other"):
        il.simulate(wall(1.0), 10.0, initial={"displacement": {"a": 1.5}})
