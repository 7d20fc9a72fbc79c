"""Laws that depend on time: what they are given, and what everything else says to them."""

import contextlib
import functools
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_states import block_of

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.given_functions import jumping_laws
from impactlab.plan.request import Request
from impactlab.plan.seed import Seed
from impactlab.simulation.planning import make_plan
from impactlab.step_control.measured.smooth_path import Laws, SmoothPath

EXACT = il.ExactFlow(measured=False)
METHODS = [EXACT, il.RungeKutta4()]
by_name = pytest.mark.parametrize("method", METHODS, ids=lambda item: type(item).__name__)


class Pulsating(il.CouplingLaw):
    """Spring and damper whose stiffness varies: with no mean, a term of Mathieu's equation."""

    stiffness: float = il.parameter(units="N m-1")
    depth: float = il.parameter()
    frequency: float = il.parameter(units="rad s-1")

    def force(extension, time, stiffness, depth, frequency):
        return stiffness * (1.0 + depth * math.cos(frequency * time)) * extension


class SwayingStop(il.ContactLaw):
    """Stop that moves to and fro, behind a clearance at which it is closest."""

    stiffness: float = il.parameter(units="N m-1")
    amplitude: float = il.parameter(units="m")
    frequency: float = il.parameter(units="rad s-1")

    def force(indentation, time, stiffness, amplitude, frequency):
        return stiffness * max(indentation - amplitude * (1.0 + math.sin(frequency * time)), 0.0)


class SwayingPad(il.ContactLaw):
    """Soft pad that moves, and slows what moves along with it."""

    stiffness: float = il.parameter(units="N m-1")
    damping: float = il.parameter(units="N s m-1")

    def force(indentation, rate, time, stiffness, damping):
        return stiffness * (indentation - 0.1 * math.sin(2.0 * time)) + damping * (1.0 + math.cos(time)) * rate


class Breathing(il.Oscillator):
    """Body on a cubic spring that grows stiffer with time, with a damper that does."""

    cubic: float = il.parameter(units="N m-3")

    def residual(displacement, velocity, time, cubic):
        return cubic * (1.0 + 0.2 * time) * displacement**3 + 0.1 * (1.0 + 0.3 * time) * velocity


class SwayingMaxwell(il.CouplingLaw):
    """Spring and damper in series, whose other end sways."""

    stiffness: float = il.parameter(units="N m-1")
    damping: float = il.parameter(units="N s m-1")
    pull: float = il.state(0.0, units="N")
    last: float = il.state(0.0, units="m")
    noted: float = il.state(0.0, units="s")

    def force(extension, pull):
        return pull

    def update(extension, elapsed, time, pull, last, noted, stiffness, damping):
        place = extension - 0.2 * math.sin(3.0 * time)
        relaxed = elapsed * stiffness / damping
        share = -math.expm1(-relaxed) / relaxed if relaxed > 0.0 else 1.0
        return pull * math.exp(-relaxed) + stiffness * (place - last) * share, place, time


BODY = il.LinearOscillator(mass=1.5, damping=0.3, stiffness=10.0)
LAW = Pulsating(6.0, depth=0.5, frequency=5.0)
SHAKEN = il.Network({"a": BODY}, {}, {}, {"p": il.Coupling(il.WALL, "a", LAW)})
PULLED = {"displacement": {"a": 0.02}, "velocity": {"a": 0.1}}


def end_of(network, step, method, duration, initial=PULLED):
    """Displacements after some time."""
    options = {"integrator": method, "initial": initial, "record": il.Trajectory(0.5 * duration)}
    return il.simulate(network, duration, step=step, **options).displacement.isel(time=-1).values.ravel()


def tight(right_side, duration, start, **options):
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, **options}
    return solve_ivp(right_side, (0.0, duration), start, **options).y[:, -1]


def of_mathieu(t, y):
    """Displacement and velocity of `SHAKEN`, and the sums of their squares."""
    x, v, *_ = y
    return [v, (-0.3 * v - (10.0 + 6.0 * (1.0 + 0.5 * math.cos(5.0 * t))) * x) / 1.5, x * x, v * v]


@pytest.mark.parametrize(("method", "order"), [(EXACT, 4), (il.RungeKutta4(), 4)])
def test_a_parametrically_excited_body_follows_mathieus_equation(method, order):
    exact = tight(of_mathieu, 2.5, [0.02, 0.1, 0.0, 0.0])[0]
    coarse, fine = (float(end_of(SHAKEN, step, method, 2.5)[0]) - exact for step in (0.05, 0.025))
    assert coarse / fine == pytest.approx(2.0**order, rel=0.1)
    assert abs(fine) < 1e-5


def test_it_is_unstable_where_theory_says():
    """Beside twice its frequency it grows like ``exp(µt)``, ``4µ² = (ε ω/2)² − (Ω − 2ω)²``, without friction."""
    body, start = il.LinearOscillator(stiffness=0.9), {"displacement": {"a": 1.0}}
    options = {"step": 0.05, "integrator": EXACT, "initial": start, "record": il.Trajectory(0.1)}
    for frequency in (2.0, 2.04, 2.1):
        law = Pulsating(0.1, depth=1.0, frequency=frequency)
        network = il.Network({"a": body}, {}, {}, {"p": il.Coupling(il.WALL, "a", law)})
        path = il.simulate(network, 400.0, **options).displacement.squeeze()
        early, late = (float((path.sel(time=slice(*times)) ** 2).max()) for times in ((100.0, 200.0), (300.0, 400.0)))
        rate = 0.5 * math.sqrt(max(0.05**2 - (frequency - 2.0) ** 2, 0.0))
        assert math.log(late / early) / 400.0 == pytest.approx(rate, rel=0.03, abs=2e-5)


@pytest.mark.full
@by_name
def test_a_body_meets_a_stop_where_this_is(method):
    law = SwayingStop(400.0, amplitude=0.2, frequency=7.0)
    network = il.Network({"a": BODY}, {"stop": il.Contact("a", il.WALL, law, clearance=0.1)})
    start = {"velocity": {"a": 2.0}}

    def right_side(t, y):
        force = 400.0 * max(y[0] - 0.1 - 0.2 * (1.0 + math.sin(7.0 * t)), 0.0)
        return [y[1], (-0.3 * y[1] - 10.0 * y[0] - force) / 1.5]

    exact = tight(right_side, 3.0, [0.0, 2.0], max_step=1e-3)[0]
    for step in (4e-3, 2.5e-4):  # kinks leave errors of the second order, which scatter
        assert abs(float(end_of(network, step, method, 3.0, start)[0]) - exact) < 40.0 * step**2


def everything(factor=1.0):
    """Laws of all kinds that depend on time, some of them on rates, and never open."""
    bodies = {
        "a": il.LinearOscillator(damping=0.5, stiffness=10.0),
        "b": Breathing(cubic=30.0 * factor, damping=0.2, stiffness=40.0),
    }
    contacts = {
        "pad": il.Contact("a", "b", SwayingPad(20.0, damping=0.4), clearance=-1.0),
        "stop": il.Contact("b", il.WALL, SwayingStop(10.0, amplitude=0.2, frequency=3.0), clearance=-2.0),
    }
    return il.Network(bodies, contacts, {}, {"p": il.Coupling("a", "b", Pulsating(5.0, depth=0.8, frequency=4.0))})


def of_everything(t, y):
    a, b, v, w = y
    pad = 20.0 * (a - b + 1.0 - 0.1 * math.sin(2.0 * t)) + 0.4 * (1.0 + math.cos(t)) * (v - w)
    stop = 10.0 * (b + 2.0 - 0.2 * (1.0 + math.sin(3.0 * t)))
    pull = 5.0 * (1.0 + 0.8 * math.cos(4.0 * t)) * (b - a)
    own = 30.0 * (1.0 + 0.2 * t) * b**3 + 0.1 * (1.0 + 0.3 * t) * w
    return [v, w, -0.5 * v - 10.0 * a - pad + pull, -0.2 * w - 40.0 * b - own + pad - stop - pull]


STARTED = {"displacement": {"a": 0.3, "b": 0.2}, "velocity": {"a": -0.4}}


class Braking(il.CouplingLaw):
    """Damper that is off at the beginning."""

    damping: float = il.parameter(units="N s m-1")

    def force(extension, rate, time, damping):
        return damping * (1.0 - math.cos(0.2 * time)) * rate


def test_a_step_is_made_for_the_strongest_damper():
    network = NOISY.replace(couplings={"p": il.Coupling(il.WALL, "a", Braking(50.0))})
    constant = NOISY.replace(couplings={"p": il.Coupling(il.WALL, "a", il.LinearCoupling(0.0, damping=100.0))})
    method = il.RungeKutta4()
    varying, strong = (
        make_plan(Model.of(item), request(step=None, integrator=method)).clock.step for item in (network, constant)
    )
    assert varying == pytest.approx(strong, rel=0.3)


@functools.cache
def place_of_everything():
    return tight(of_everything, 2.0, [0.3, 0.2, -0.4, 0.0])[:2]


@pytest.mark.campaign
@pytest.mark.parametrize(("method", "order"), [(EXACT, 2), (il.RungeKutta4(), 4)])
def test_laws_of_all_kinds_take_the_time(method, order):
    coarse, fine = (
        np.abs(end_of(everything(), step, method, 2.0, STARTED) - place_of_everything()).max() for step in (0.02, 0.01)
    )
    assert coarse / fine == pytest.approx(2.0**order, rel=0.3)
    assert fine < 2e-4


@pytest.mark.full
def test_a_compiled_network_takes_the_time():
    compiled = everything().compile()
    np.testing.assert_allclose(
        compiled.rhs(0.7, np.array([0.3, 0.2, -0.4, 0.1])), of_everything(0.7, [0.3, 0.2, -0.4, 0.1])
    )
    times = np.array([0.2, 1.1])
    found = compiled.to_dataset(times, np.zeros((4, 2))).contact_force.sel(contact="stop")
    np.testing.assert_allclose(found, 10.0 * (2.0 - 0.2 * (1.0 + np.sin(3.0 * times))))


def test_forces_are_those_of_the_times_of_states():
    """Of the present one, or of others, and along the smooth path that kicks approximate (by differences)."""
    block, place, still = block_of(SHAKEN, 0.01, initial=PULLED), np.ones((2, 2, 1)), np.zeros((2, 2, 1))
    place[:, 1] = 0.0
    block.advance(30, None)
    indentation, contact_force, total = np.zeros((2, 0, 1)), np.zeros((2, 0, 1)), np.zeros((2, 2, 1))

    def pull(times):
        return -6.0 * (1.0 + 0.5 * np.cos(5.0 * times))

    block.evaluate(place, still, indentation, contact_force, total)
    np.testing.assert_allclose(total[:, 0, 0], pull(0.3))
    laws = Laws(np.zeros((2, 0, 1)), np.array([0.1, 0.7]))
    block.evaluate(place, still, indentation, contact_force, total, laws=laws, elapsed=0.05)
    np.testing.assert_allclose(total[:, 0, 0], pull(laws.times + 0.05))
    path = SmoothPath(block.plan, block.evaluate)
    x, v = path.at(place[:, :1], still[:, :1], still[:, :1], laws)
    acceleration, change = pull(laws.times) / 1.5, 15.0 * np.sin(5.0 * laws.times) / 1.5
    np.testing.assert_allclose(x[:, 0, 0], 1.0 + path.ahead[0, 0] * acceleration)
    np.testing.assert_allclose(v[:, 0, 0], -path.lag[0, 0] * acceleration - 0.01**2 / 12.0 * change, rtol=1e-4)


@pytest.mark.full
@pytest.mark.parametrize("realizations", [1, 3])
@by_name
def test_forces_of_a_trajectory_belong_to_its_times(method, realizations):
    """Also before the measurement, and from a block of one lane or many; a stop tells the time by its force."""
    network = everything().replace(excitations={"a": il.WhiteNoise(0.5)})
    options = {"realizations": realizations, "step": 0.01, "integrator": method, "record": il.Trajectory(0.1), "rng": 1}
    several = pytest.warns(il.AccuracyWarning, match="Too few") if realizations > 1 else contextlib.nullcontext()
    with several:
        path = il.simulate(network, 1.0, initial="rest", spin_up=0.5, **options).transpose("realization", "time", ...)
    b, law = path.displacement.sel(oscillator="b").values, network.contacts["stop"].law
    expected = law.evaluate(b + 2.0, time=path.time.values)
    np.testing.assert_allclose(path.contact_force.sel(contact="stop").values, expected, rtol=1e-12)


@pytest.mark.full
@by_name
def test_blocks_of_one_lane_and_of_many_make_the_same_paths(method):
    options = {"integrator": method, "initial": STARTED}
    one, three = (block_of(everything(), 0.01, count, **options) for count in (1, 3))
    for block in (one, three):
        block.advance(77, None)
        block.advance(23, None)
    for name in ("x", "v"):
        single, several = (getattr(block.state, name) for block in (one, three))
        np.testing.assert_allclose(several, np.broadcast_to(single, several.shape), rtol=1e-12, atol=1e-14)


@pytest.mark.campaign
def test_plain_python_gives_the_same_numbers(run_python, tmp_path):
    text = """
import sys
sys.path[:0] = sys.argv[1:]
from test_time import EXACT, STARTED, block_of, everything
for realizations in (1, 2):
    block = block_of(everything(), 0.01, realizations, initial=STARTED)
    block.advance(30, None)
    print(*block.state.x[:, 0].ravel())
"""
    (tmp_path / "run.py").write_text(text, encoding="utf-8")
    here = Path(__file__).parent
    for line in run_python(tmp_path / "run.py", here, here.parent, NUMBA_DISABLE_JIT="1").splitlines():
        block = block_of(everything(), 0.01, initial=STARTED)
        block.advance(30, None)
        np.testing.assert_allclose(block.state.x[:, 0], np.array(line.split(), dtype=float), rtol=1e-12)


@pytest.mark.full
@pytest.mark.parametrize("method", [*METHODS, il.EulerMaruyama()], ids=lambda item: type(item).__name__)
def test_states_and_forces_belong_to_one_time(method):
    """A law with states notes the time when a step is accepted, and its other end is where it is at that time."""
    law = SwayingMaxwell(20.0, damping=4.0, last=0.02)
    network = il.Network({"a": BODY}, {}, {}, {"m": il.Coupling(il.WALL, "a", law)})
    block = block_of(network, 1e-3, integrator=method)
    for steps in (100, 33):
        block.advance(steps, None)
        assert block.states[2, 0] == pytest.approx(block.time, rel=1e-12)
    if isinstance(method, il.EulerMaruyama):
        return

    def right_side(t, y):
        x, v, force = y
        return [v, (-0.3 * v - 10.0 * x - force) / 1.5, 20.0 * (v - 0.6 * math.cos(3.0 * t) - force / 4.0)]

    exact = tight(right_side, 2.4, [0.02, 0.1, 0.0])[0]
    coarse, fine = (float(end_of(network, step, method, 2.4)[0]) - exact for step in (0.005, 0.0025))
    assert coarse / fine == pytest.approx(4.0, rel=0.05)
    assert abs(fine) < 1e-7


NOISY = SHAKEN.replace(excitations={"a": il.WhiteNoise(0.5)})


@functools.cache
def means_of_noise(begin, end):
    """Means of x² and v² of `NOISY` from rest, over the time after 0, by the equation of its covariance."""

    def right_side(t, y):
        xx, xv, vv, *_ = y
        k, c = (10.0 + 6.0 * (1.0 + 0.5 * math.cos(5.0 * t))) / 1.5, 0.3 / 1.5
        after = float(t >= 0.0)
        return [2.0 * xv, vv - k * xx - c * xv, -2.0 * (k * xv + c * vv) + np.pi / 1.5**2, after * xx, after * vv]

    before = solve_ivp(right_side, (begin, -1e-15), np.zeros(5), rtol=1e-10, atol=1e-14).y[:, -1]
    return solve_ivp(right_side, (0.0, end), before, rtol=1e-10, atol=1e-14).y[3:, -1] / end


@pytest.mark.full
@pytest.mark.parametrize(("method", "step"), [(il.ExactFlow(), None), (il.RungeKutta4(), 0.01)])
def test_a_parametric_oscillator_under_noise_has_the_covariance_of_its_equation(method, step):
    """From rest at −1.3 s, so that the phase of the law counts; within three standard errors."""
    options = {"realizations": 4096, "spin_up": 1.3, "initial": "rest", "rng": 5}
    found = il.simulate(NOISY, 2.0, step=step, integrator=method, **options)
    for name, exact in zip(("displacement", "velocity"), means_of_noise(-1.3, 2.0), strict=True):
        value, error = (float(found[f"mean_square_{name}{kind}"].squeeze()) for kind in ("", "_standard_error"))
        assert error < 0.02 * exact
        assert abs(value - exact) < 3.0 * error


@pytest.mark.full
def test_a_small_bias_of_a_large_step_is_not_from_the_wrong_time():
    """Kicks are at the ends of steps, and so is their time: means over a run have errors of fourth order only.

    At ``h Ω = 1`` the phase of the law moves by a radian in a step.
    """
    options = {"realizations": 16384, "spin_up": 1.2, "initial": "rest", "rng": 6, "integrator": EXACT}
    found = il.simulate(NOISY, 2.0, step=0.2, **options)
    for name, exact in zip(("displacement", "velocity"), means_of_noise(-1.2, 2.0), strict=True):
        assert float(found[f"mean_square_{name}"].squeeze()) == pytest.approx(exact, rel=0.02)


@pytest.mark.full
def test_a_run_is_repeated_from_its_file(tmp_path):
    network = il.Network.from_dict(NOISY.to_dict())
    assert network == NOISY
    found = il.simulate(NOISY, 1.0, step=0.02, realizations=64, rng=1, out=tmp_path / "run.nc")
    again = il.rerun(tmp_path / "run.nc")
    assert np.array_equal(found.mean_square_displacement, again.mean_square_displacement)


def request(**options):
    return Request(
        **{
            "duration": 100.0, "realizations": 64, "step": 0.01, "integrator": EXACT, "spin_up": None, "initial": None,
            "records": [], "seed": Seed(1, 2), **options,
        }
    )  # fmt: skip


STOP = SwayingStop(40.0, amplitude=0.2, frequency=7.0)
STOPPED = il.Network({"a": BODY}, {"stop": il.Contact("a", il.WALL, STOP, clearance=8.0)}, {"a": il.WhiteNoise(0.5)})


def test_a_run_is_not_stationary_and_makes_every_step():
    resting = STOPPED.replace(contacts={"stop": il.Contact("a", il.WALL, il.LinearContact(40.0), clearance=8.0)})
    plain, timed = (make_plan(Model.of(network), request()) for network in (resting, STOPPED))
    assert plain.method.interval > 1
    assert timed.method.interval == 1
    assert plain.steady
    assert not timed.steady
    assert timed.transient
    assert timed.observed.counted
    assert plain.clock.certified
    assert not timed.clock.certified
    assert timed.clock.spin_up == pytest.approx(plain.clock.spin_up, rel=0.01)


def test_its_frequencies_limit_the_step():
    """A stiffness that varies fast in time, of a body that is slow."""
    fast = NOISY.replace(couplings={"p": il.Coupling(il.WALL, "a", LAW.replace(frequency=200.0))})
    slow, fast = (make_plan(Model.of(network), request(step=None)).clock.step for network in (NOISY, fast))
    assert fast < 0.8 / 200.0
    assert fast < 0.1 * slow


def test_a_step_is_made_for_the_stiffest_moment():
    """With a stiffness that is nearly 0 at the beginning the step resolves the greatest one."""
    late = LAW.replace(stiffness=600.0, depth=-0.999, frequency=0.2)
    network = NOISY.replace(couplings={"p": il.Coupling(il.WALL, "a", late)})
    constant = NOISY.replace(couplings={"p": il.Coupling(il.WALL, "a", LAW.replace(stiffness=1200.0, depth=0.0))})
    varying, stiff = (make_plan(Model.of(item), request(step=None)).clock.step for item in (network, constant))
    assert varying == pytest.approx(stiff, rel=0.1)


class Switched(il.CouplingLaw):
    """A spring that is there now and then."""

    stiffness: float = il.parameter(units="N m-1")

    @staticmethod
    def force(extension, time, stiffness):
        return stiffness * extension if time % 0.5 < 0.15 else 0.0


@pytest.mark.full
def test_jumps_in_time_are_told():
    switched = il.Network({"a": BODY}, {}, {}, {"s": il.Coupling(il.WALL, "a", Switched(300.0))})
    assert jumping_laws(Model.of(switched), 0.0, 3.0, 1e-3) == ["Switched"]
    for network in (SHAKEN, STOPPED):
        assert jumping_laws(Model.of(network), -2.0, 3.0, 1e-2) == []
    start = {"displacement": {"a": 0.1}}
    with pytest.warns(il.AccuracyWarning, match=r"The force of Switched jumps in time, each time up to half a step"):
        il.simulate(switched, 3.0, initial=start, step=0.01, integrator=EXACT)


@pytest.mark.full
def test_bodies_that_it_moves_have_no_balances_and_contacts_no_return_levels():
    pair = il.Network(
        {"a": BODY, "b": BODY, "c": BODY},
        {"ab": il.Contact("a", "b", SwayingStop(40.0, amplitude=0.01, frequency=7.0)),
         "c": il.Contact("c", il.WALL, il.LinearContact(40.0))},
        dict.fromkeys("abc", il.WhiteNoise(0.5)),
    )  # fmt: skip
    options = {"realizations": 64, "rng": 1, "integrator": EXACT, "record": il.PeakForces(return_times=(3.0,))}
    found = il.simulate(pair, 5.0, step=0.01, **options)
    assert np.isnan(found.return_level).values.ravel().tolist() == [True, False]
    balance = found.balance_mean_square_velocity
    assert np.isnan(balance.sel(oscillator=["a", "b"])).all()
    assert np.isfinite(balance.sel(oscillator="c"))


def test_what_knows_stationary_laws_only_says_so():
    noise = {"a": il.WhiteNoise(1.0)}
    breathing = il.Network({"a": Breathing(cubic=1.0, damping=1.0, stiffness=1.0)}, {}, noise)
    for network, message in (
        (NOISY, "force of coupling 'p' depends on time, so that no law is stationary"),
        (STOPPED, "force of contact 'stop' depends on time"),
        (breathing, "residual force of 'a' depends on time"),
    ):
        with pytest.raises(il.NoExactReference, match=message):
            il.exact(
                network.replace(contacts={name: item.replace(clearance=0.1) for name, item in network.contacts.items()})
            )
    pair = il.Network({"a": BODY, "b": BODY}, {"c": il.Contact("a", "b", STOP)}, dict.fromkeys("ab", noise["a"]))
    with pytest.raises(
        il.NoExactReference, match="force of contact 'c' depends on time; laws of the indentation alone"
    ):
        il.fokker_planck(pair)


def test_a_check_says_what_follows():
    text = repr(STOPPED.check())
    assert "No bias is predicted: laws depend on time." in text
    assert "Laws depend on time: statistics are means over the time of a run, which begins at 0." in text
    assert "The bias of the step is measured before a run" in text
    assert "not crossed at once: laws that depend on time." in text


def test_nothing_is_guessed_where_only_a_law_moves_a_body():
    alone = STOPPED.replace(excitations={"a": None})
    with pytest.raises(il.InvalidInput, match="energy of 'a' is not known, which nothing but a law that depends on"):
        il.simulate(alone, 1.0, integrator=il.ExactFlow())
    assert "depends on time moves" in str(alone.check().dataset.refusal.sel(integrator="ExactFlow").values)


class Shaking(il.CouplingLaw):
    """Spring whose other end is shaken: it moves a body as a given force does."""

    stiffness: float = il.parameter(units="N m-1")
    amplitude: float = il.parameter(units="m")
    frequency: float = il.parameter(units="rad s-1")

    def force(extension, time, stiffness, amplitude, frequency):
        return stiffness * (extension - amplitude * math.sin(frequency * time))


@pytest.mark.full
@pytest.mark.parametrize("step", [None, 0.05 * math.pi])
def test_a_body_without_noise_goes_with_its_shaken_support(step):
    """It begins with a spin-up and ends in the response of linear theory; the error of a large step is measured."""
    law = Shaking(6.0, amplitude=0.5, frequency=4.0)
    found = il.simulate(
        il.Network({"a": BODY}, {}, {}, {"s": il.Coupling(il.WALL, "a", law)}), 20.0 * math.pi, step=step
    )
    gain = 6.0 * 0.5 / abs(16.0 - 1.5 * 16.0 + 0.3j * 4.0)
    assert found.attrs["spin_up"] > 50.0
    for name, exact in (("displacement", 0.5 * gain**2), ("velocity", 0.5 * (4.0 * gain) ** 2)):
        off = float(found[f"mean_square_{name}"].squeeze()) / exact - 1.0
        if step is None:
            assert abs(off) < 2e-3
        else:
            assert off > 3e-4
            assert float(found[f"mean_square_{name}_step_bias"].squeeze()) == pytest.approx(off, rel=0.1)


def force(indentation, time):
    return indentation * time


@pytest.mark.parametrize(
    ("base", "members", "message"),
    [
        (il.ContactLaw, {"force": force, "potential": lambda indentation: 0.0},
         "Law.force depends on time, so that it has no potential: write potential = None"),
        (il.HertzContact, {"force": force}, "Law.force depends on time, so that it has no potential"),
        (il.DuffingOscillator, {"residual": lambda displacement, time: 0.0}, "it has no residual_potential"),
        (il.LinearCoupling, {"force": lambda extension, time: 0.0},
         "Law would be taken for linear: derive it from il.CouplingLaw"),
        (il.ContactLaw, {"force": lambda time, indentation: 0.0}, "kinematic arguments come first and in order"),
        (il.ContactLaw, {"force": force, "time": il.parameter(0.0)}, "field 'time' has the name of a kinematic arg"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_where_the_class_is_made(base, members, message):
    with pytest.raises(il.InvalidInput, match=message):
        type("Law", (base,), {**members, "__annotations__": {"time": "float"} if "time" in members else {}})


def test_a_law_is_evaluated_at_times():
    assert LAW.evaluate(0.1, time=[0.0, 0.2 * math.pi]).tolist() == pytest.approx([0.9, 0.3])
    assert STOP.evaluate(0.3, time=[0.0, -math.pi / 14.0]).tolist() == pytest.approx([4.0, 12.0])

    class Stiffer(il.HertzContact):
        potential = None

        def force(indentation, time, stiffness):
            return stiffness * (1.0 + time) * indentation

    assert float(Stiffer(10.0).evaluate(0.5, time=1.0)) == 10.0
