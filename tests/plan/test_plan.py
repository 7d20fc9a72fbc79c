"""Rules of planning: step, spin-up, batches, blocks, seeds; and every bad input of simulate."""

import math

import numpy as np
import pytest
from scenes import base, linear, plan_of

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.machine import tuning
from impactlab.plan.clock import batch_count, fit_step
from impactlab.plan.realizations import Realizations, most_lanes
from impactlab.plan.seed import seed_of

# step and spin-up


def test_automatic_step_is_the_closed_form():
    network = base()
    temperature = np.pi / network.oscillators["two"].damping
    depth = (2.5 * temperature / 1e4) ** 0.4
    tangent = 1.5 * 1e4 * math.sqrt(depth)
    closed = math.sqrt(2.0 * tangent)  # two unit masses on the contact's spring; the flow is exact
    expected = min(0.5 / closed, 1.0 / (32.0 * np.pi))
    step = plan_of(network).clock.step
    assert 0.99 * expected < step <= expected * (1.0 + 1e-6)  # made smaller until it divides the duration
    assert 10.0 / step == pytest.approx(round(10.0 / step), abs=1e-6)


def test_step_of_linear_bodies_follows_the_fastest():
    assert plan_of(linear(frequency=20.0)).clock.step == pytest.approx(0.05)


@pytest.mark.parametrize("ratio", [1.0, 16.0, 64.0])
def test_a_step_too_large_names_the_largest_that_is_safe(ratio):
    network = base(ratio)
    with pytest.raises(il.InvalidInput, match=r"largest stable one is") as caught:
        il.simulate(network, 10.0, step=1.0)
    largest = float(str(caught.value).split("largest stable one is ")[1].split(" s")[0])
    assert plan_of(network, step=0.99 * largest).clock.step == 0.99 * largest
    with pytest.raises(il.InvalidInput, match=r"too large for ExactFlow"):
        plan_of(network, step=1.01 * largest)


def test_spin_up_is_twelve_relaxation_times_unless_the_start_is_given():
    network = linear()  # ζω = 0.2 π
    plan = plan_of(network)
    assert plan.clock.spin_up_steps == math.ceil(12.0 / (0.2 * np.pi) / plan.clock.step)
    assert plan_of(network, initial={"displacement": {"a": 1.0}}).clock.spin_up_steps == 0
    assert plan_of(network, spin_up=0.0).clock.spin_up_steps == 0
    assert plan_of(network.replace(excitations={"a": None})).clock.spin_up_steps == 0


@pytest.mark.parametrize(
    ("step", "fixed", "intervals", "duration", "expected"),
    [
        (0.3, False, [], 1.0, (0.25, 4)),
        (0.25, False, [], 1.0, (0.25, 4)),
        (0.3, False, [0.5], 1.0, (0.25, 4)),
        (0.3, True, [], 1.0, (0.3, 3)),
        (0.1, True, [0.3, 0.2], 1.0, (0.1, 10)),
        (0.06, False, [0.1, 0.03], 1.2, (0.01, 120)),
        (0.06, False, [0.1, 0.125], 1.0, (0.025, 40)),
    ],
)
def test_steps_divide_what_they_must(step, fixed, intervals, duration, expected):
    assert fit_step(step, fixed, intervals, duration) == pytest.approx(expected)


def test_the_step_divides_the_period_of_a_series():
    noise = il.ShinozukaNoise(1.0, band=(0.0, 10.0), components=300)
    plan = plan_of(linear().replace(excitations={"a": noise}), duration=7.0, spin_up=0.0)
    assert 30.0 / plan.clock.step == pytest.approx(round(30.0 / plan.clock.step), abs=1e-9)
    assert plan.clock.steps * plan.clock.step == pytest.approx(7.0, abs=plan.clock.step)


@pytest.mark.parametrize("interval", [0.01, 0.013, 0.5])
def test_the_step_divides_the_interval_of_a_trajectory(interval):
    plan = plan_of(base(), records=[il.Trajectory(interval)])
    assert plan.observed.every * plan.clock.step == pytest.approx(interval, rel=1e-12)


# batches, blocks, seeds


@pytest.mark.parametrize(
    ("realizations", "duration", "relaxation", "expected"),
    [
        (64, 1e6, 1.0, 2),  # realizations are enough: two halves for the test of drift
        (32, 40.0, 1.0, 2),
        (16, 80.0, 1.0, 4),
        (16, 79.0, 1.0, 2),  # too short: no batches that count
        (1, 1280.0, 1.0, 64),
        (1, 1270.0, 1.0, 2),
        (3, 1e6, 1.0, 22),
        (5, 281.0, 1.0, 14),  # 13 would do, but halves must be equal
        (5, 279.0, 1.0, 2),
        (1, 1.0, 0.0, 64),
    ],
)
def test_batches(realizations, duration, relaxation, expected):
    assert batch_count(realizations, duration, relaxation) == expected


def blocks_of(model, number, workers, series_bytes, most=None):
    """Blocks of some realizations, of as many lanes as a machine allows."""
    return Realizations.in_blocks(model, number, workers, (0, 0), series_bytes, True, most or tuning().lanes)


@pytest.mark.parametrize("realizations", [1, 2, 7, 64, 511, 512, 10_000])
@pytest.mark.parametrize("workers", [1, 2, 64])
def test_blocks_hold_every_realization_once(realizations, workers):
    found = blocks_of(Model.of(base()), realizations, workers, 0)
    assert 1 <= found.lanes <= tuning().lanes
    assert found.steps_per_call >= 1
    plan = plan_of(base(), realizations=realizations, workers=workers)
    held = np.concatenate([plan.realizations.of(block) for block in range(plan.realizations.blocks)])
    np.testing.assert_array_equal(held, np.arange(realizations))


@pytest.mark.parametrize(
    ("bodies", "realizations", "lanes"),
    [
        (2, 1, 1),
        (15, 1, 1),
        (10, 10_000, 400),  # as many bodies and lanes as stay in the cache
        (60, 10_000, 64),
        (150, 10_000, 64),
        (200, 10_000, 1),
        (300, 8, 1),
        (15, 8, 8),
        (64, 4, 1),
    ],
)
def test_blocks_of_large_networks_stay_in_the_cache_or_have_one_lane(bodies, realizations, lanes):
    network = il.chain(bodies, il.LinearOscillator(stiffness=1.0), il.HertzContact(1e4))
    model = Model.of(network)
    assert blocks_of(model, realizations, 1, 0, most_lanes(model, realizations, 1)).lanes == lanes


def test_blocks_are_small_where_series_are_long():
    assert blocks_of(Model.of(base()), 1000, 2, int(80e6)).lanes == 2
    assert blocks_of(Model.of(base()), 1000, 2, int(1e12)).lanes == 1


def test_seeds_take_the_forms_of_spec_7():
    sequence = np.random.SeedSequence(7)
    assert seed_of(7) == seed_of(np.int64(7)) == seed_of(sequence) == seed_of(sequence)
    assert seed_of([7, 8]) == seed_of(np.random.SeedSequence([7, 8])) != seed_of(7)
    assert seed_of(None) != seed_of(None)
    generator = np.random.default_rng(7)
    first, second = seed_of(generator), seed_of(generator)
    assert first != second  # a generator moves on
    assert first == seed_of(np.random.default_rng(7)) == seed_of(np.random.PCG64(7))
    assert all(0 <= word < 2**64 for word in first)
    assert len({seed_of(k) for k in range(1000)}) == 1000


# bad input


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": 0.0}, r"duration must be larger than 0 s, not 0.0"),
        ({"duration": -1.0}, r"duration must be larger than 0"),
        ({"duration": math.inf}, r"duration must be a finite number"),
        ({"duration": math.nan}, r"duration must be a finite number"),
        ({"duration": "long"}, r"duration must be a number, not 'long'"),
        ({"realizations": 0}, r"realizations must be a whole number from 1"),
        ({"realizations": -1}, r"realizations must be a whole number from 1"),
        ({"realizations": 1.5}, r"realizations must be a whole number, not 1\.5"),
        ({"realizations": True}, r"realizations must be a whole number, not True"),
        ({"realizations": 2**32}, r"realizations must be a whole number from 1"),
        ({"step": 0.0}, r"step must be larger than 0"),
        ({"step": -1e-3}, r"step must be larger than 0"),
        ({"step": math.nan}, r"step must be a finite number"),
        ({"spin_up": -1.0}, r"spin_up must be at least 0 s"),
        ({"spin_up": math.inf}, r"spin_up must be a finite number"),
        ({"rng": -1}, r"rng must be None, a whole number"),
        ({"rng": "seed"}, r"rng must be None, a whole number"),
        ({"rng": 1.5}, r"rng must be None, a whole number"),
        ({"initial": "calm"}, r"initial must be \"stationary\", \"rest\" or"),
        ({"initial": {"place": {}}}, r"initial: there is no quantity 'place'; allowed are 'displacement'"),
        ({"initial": {"displacement": {"on": 1.0}}}, r"no oscillator 'on'; did you mean 'one'"),
        ({"initial": {"velocity": {"one": math.nan}}}, r"initial velocity of 'one' must be a finite number"),
        ({"initial": {"displacement": 3.0}}, r"initial\['displacement'\] must be a mapping, not 3.0"),
        ({"executor": 4}, r"executor must be an Executor, not 4"),
        ({"step": 2e-3, "duration": 1e-3}, r"step of 0.002 s is longer than the duration of 0.001 s"),
        ({"record": il.Trajectory(2.0)}, r"interval of 2 s, longer than the duration of 1 s"),
        ({"record": [il.Trajectory(0.1), il.Trajectory(0.2)]}, r"Two records Trajectory would have variables of the"),
        ({"record": [il.Density(), il.Density(bins=9)]}, r"Two records Density displacement would have"),
        ({"integrator": "RK4"}, r"integrator must be an il.Integrator"),
        ({"record": "paths"}, r"record must be a list of il.Records"),
        ({"record": [3]}, r"record\[0\] must be an il.Record"),
        ({"record": il.Trajectory(0.01), "step": 3e-3}, r"interval of 0.01 s is not a whole number of steps of 0.003"),
        ({"record": il.Trajectory(1e-3), "step": 3e-3}, r"is not a whole number of steps"),
        (
            {"record": il.Trajectory(0.1, start=0.0123456789)},
            r"Intervals of 0\.0123457 s and 0\.1 s are no",
        ),
        ({"record": il.Density("displacement", oscillators=("tow",))}, r"no oscillator 'tow'; did you mean 'two'"),
        ({"record": il.JointDensity("one", "three")}, r"no oscillator 'three'"),
    ],
)
def test_bad_input_is_refused(options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(base(), **{"duration": 1.0, **options})


def test_numbers_of_numpy_are_numbers():
    options = {"realizations": np.int64(64), "step": np.float32(2**-9), "spin_up": np.float32(0.0)}
    initial = {"displacement": {"one": np.float32(0.5)}}
    ds = il.simulate(base(), np.float32(0.25), rng=np.uint8(1), initial=initial, **options)
    again = il.rerun(ds)
    np.testing.assert_array_equal(ds.mean_displacement, again.mean_displacement)


def test_something_else_than_a_network_is_refused():
    with pytest.raises(il.InvalidInput, match=r"network must be an il\.Network"):
        il.simulate({"a": 1}, 1.0)


@pytest.mark.parametrize(
    "make",
    [
        lambda: il.Density("position"),
        lambda: il.Density(limits=(1.0, -1.0)),
        lambda: il.Density(limits=(1.0, 2.0, 3.0)),
        lambda: il.Density(limits={"one": 1.0}),
        lambda: il.Density(limits=(("one", 0.0, 1.0), 3.0)),
        lambda: il.Density(limits="wide"),
        lambda: il.Density(limits=(0.0, math.inf)),
        lambda: il.Density(bins=0),
        lambda: il.Trajectory(0.0),
        lambda: il.Trajectory(math.nan),
    ],
)
def test_records_refuse_bad_values_when_they_are_made(make):
    with pytest.raises(il.InvalidInput):
        make()


def test_a_series_shorter_than_the_run_is_refused():
    noise = il.ShinozukaNoise(1.0, band=(0.0, 10.0), components=100)  # 10 s
    network = linear().replace(excitations={"a": noise})
    with pytest.raises(il.InvalidInput, match=r"series of 'a' repeats after 10 s, but the run .* takes 11 s"):
        il.simulate(network, 6.0, spin_up=5.0)
    plan_of(network, spin_up=0.0)
    plan_of(network.replace(excitations={"a": noise.replace(allow_repeat=True)}), duration=100.0)


def test_a_band_without_the_natural_frequency_is_warned_of():
    noise = il.ShinozukaNoise(1.0, band=(2.0, 10.0), components=1000)
    with pytest.warns(il.AccuracyWarning, match=r"band of the excitation of 'a' .* natural frequency 1 Hz"):
        plan_of(linear().replace(excitations={"a": noise}), spin_up=0.0)
    plan_of(linear(frequency=8.0 * np.pi).replace(excitations={"a": noise}), spin_up=0.0)  # no warning


class Resonant(il.Excitation):
    """A cosine at the natural frequency of a body of unit mass and stiffness."""

    def lines(self):
        return [1.0], [1.0]


@pytest.mark.filterwarnings("ignore:Without friction")  # which is another matter
def test_what_no_rule_can_plan_asks_for_a_step():
    free = il.Network({"a": il.LinearOscillator()})
    with pytest.raises(il.InvalidInput, match=r"no body has stiffness or damping\. Give step="):
        il.simulate(free, 1.0, integrator=il.ExactFlow())
    undamped = il.Network(
        {"a": il.LinearOscillator(stiffness=1.0)},
        {"w": il.Contact("a", il.WALL, il.HertzContact(1.0))},
        {"a": il.WhiteNoise(1.0)},
    )
    # without damping the energy grows with the time: π S t/m · 2 at most is planned for
    for duration in (1.0, 100.0):
        depth = (2.5 * 2.0 * np.pi * duration) ** 0.4
        expected = min(0.5 / math.sqrt(1.5 * math.sqrt(depth)), 1.0)
        assert 0.5 * expected < plan_of(undamped, duration=duration, spin_up=0.0).clock.step <= expected * (1.0 + 1e-6)
    resonant = undamped.replace(excitations={"a": Resonant()})
    with pytest.raises(il.InvalidInput, match=r"energy that 'a' brings into collisions .* Give step="):
        il.simulate(resonant, 1.0)


def test_an_integrator_refuses_noise_that_it_does_not_handle():
    class SmoothOnly(il.RungeKutta4):
        handles = ("force",)

    with pytest.raises(il.InvalidInput, match=r"does not handle the excitation of 'a' \(WhiteNoise.*handles force"):
        il.simulate(linear(), 1.0, integrator=SmoothOnly())


def test_kinks_of_weakly_damped_contacts_shorten_the_step():
    """Rules of the theory page: only kinks count, and their step follows the fourth root of the friction."""

    def step(law, ratio, clearance=-0.05):
        body = il.LinearOscillator.from_frequency(20.0, ratio)
        network = il.Network(
            {"a": body}, {"w": il.Contact("a", il.WALL, law, clearance=clearance)},
            {"a": il.WhiteNoise(body.damping / math.pi)},
        )  # fmt: skip
        return network.check().dataset.attrs["step"]

    linear_law = il.LinearContact(4e4)
    assert step(linear_law, 1e-3) == pytest.approx(10.0**-0.25 * step(linear_law, 1e-2), rel=1e-12)
    assert step(linear_law, 0.5, clearance=0.05) == pytest.approx(0.5 / 200.0, rel=0.02)
    assert step(il.PowerLawContact(4e6, exponent=2.0), 1e-2) == pytest.approx(
        step(il.PowerLawContact(4e6, exponent=2.0), 1e-1), rel=1e-9
    )
    assert step(linear_law, 1e-3, clearance=0.2) > step(linear_law, 1e-3, clearance=0.0)


@pytest.mark.full
def test_a_weakly_damped_preload_keeps_its_temperature():
    """With the step of the other rules it is 1.2 ± 0.02 % too hot."""
    body = il.LinearOscillator.from_frequency(20.0, 0.024)
    network = il.Network(
        {"a": body}, {"w": il.Contact("a", il.WALL, il.LinearContact(4e4), clearance=-0.05)},
        {"a": il.WhiteNoise(body.damping / math.pi)},
    )  # fmt: skip
    ds = il.simulate(network, 300.0, realizations=512, rng=1)
    exact = float(il.exact(network).statistics().mean_square_velocity[0])
    error = float(ds.mean_square_velocity_standard_error[0]) / exact
    assert error < 5e-4
    assert abs(float(ds.mean_square_velocity[0]) / exact - 1.0) < 1e-3 + 3.0 * error
