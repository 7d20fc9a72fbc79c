"""Runs that go on from the end of another: the same path in two parts, in each realization, and what is refused."""

import concurrent.futures
import json
import math

import numpy as np
import pytest
from scenes import base

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.machine import tuned
from impactlab.step_control.rules.tangent_stiffness import energy_of

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")

LIGHT, HEAVY = (il.LinearOscillator(mass=m, damping=0.1, stiffness=k) for m, k in ((1.0, 4.0), (2.0, 3.0)))
BEGIN = {"displacement": {"a": 1.0, "b": -0.3}, "velocity": {"a": 0.5}}
END = il.FinalState()


def pair(**parts):
    return il.Network({"a": LIGHT, "b": HEAVY}, **parts)


def held(law):
    """One body on a law with states."""
    body = il.LinearOscillator(mass=1.0, damping=0.1, stiffness=1.0)
    return il.Network({"a": body}, couplings={"held": il.Coupling("a", il.WALL, law)})


def stopped(law, clearance):
    return pair(contacts={"gap": il.Contact("a", "b", law, clearance=clearance)})


def apart(first, second):
    """Largest difference of two final states."""
    names = "final_displacement", "final_velocity"
    return max(float(abs(first[name] - second[name]).max()) for name in names)


def jump(network, step, duration=6.0, cut=2.0, begin=BEGIN, integrator=None):
    """How far a path in two parts ends from that in one, which is also returned."""
    options = {"step": step, "record": END, "integrator": integrator}
    names = set(network.oscillators)
    begin = {quantity: {k: x for k, x in values.items() if k in names} for quantity, values in begin.items()}
    whole = il.simulate(network, duration, initial=begin, **options)
    first = il.simulate(network, cut, initial=begin, **options)
    second = il.simulate(network, duration - cut, initial=first, **options)
    return apart(whole, second), whole


LINEAR = {
    "free": pair(couplings={"c": il.Coupling("a", "b", il.LinearCoupling(2.0, damping=0.05))}),
    "driven": pair(excitations={"a": il.Harmonic(3.0, frequency=2.0 * math.pi)}),  # cut after whole periods
    "bouncing": il.Network(
        {"a": il.LinearOscillator(mass=1.0)},
        {"floor": il.Contact("a", il.WALL, il.RigidContact(0.6), clearance=2.0)},
        {"a": il.ConstantForce(9.81)},
    ),
}


@pytest.mark.parametrize("name", LINEAR)
def test_a_linear_path_in_two_parts_is_the_same(name):
    difference, whole = jump(LINEAR[name], 1.0 / 32.0)
    assert difference < 1e-12
    assert float(abs(whole.final_displacement).max()) > 0.1


CURVED = {  # how closely forces are resolved, and the order that the difference has at least
    "cubic": (il.Network({"a": il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=3.0)}), 1 / 32, 3.7),
    "pressed": (stopped(il.HertzContact(50.0), -0.8), 1 / 64, 3.7),
    "damped": (stopped(il.KelvinVoigtContact(stiffness=50.0, damping=5.0), -1.0), 1 / 64, 2.7),
    "yielding": (held(il.BoucWenCoupling(stiffness=4.0, yield_displacement=0.3, ratio=0.1)), 1 / 32, 3.7),
    "creeping": (held(il.MaxwellCoupling(stiffness=4.0, damping=2.0)), 1 / 32, 3.7),
}


@pytest.mark.full
@pytest.mark.parametrize(
    "name", [name if name in ("cubic", "damped") else pytest.param(name, marks=pytest.mark.campaign) for name in CURVED]
)
def test_other_paths_differ_by_the_order_of_the_method(name):
    network, step, order = CURVED[name]
    (coarse, _), (fine, whole) = (jump(network, h) for h in (step, step / 2.0))
    assert 1e-12 < fine < 1e-3
    assert math.log2(coarse / fine) > order
    assert float(abs(whole.final_displacement).max()) > 1e-3


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "method"),
    [("cubic", il.EulerMaruyama()), *((name, il.RungeKutta4()) for name in ("cubic", "pressed", "yielding"))],
)
def test_explicit_methods_go_on_as_if_nothing_had_happened(name, method):
    difference, _ = jump(CURVED[name][0], 1.0 / 128.0, integrator=method)
    assert difference < 1e-12


@pytest.mark.full
def test_states_of_laws_go_on():
    network = CURVED["yielding"][0]
    options = {"step": 1.0 / 64.0, "record": END}
    first = il.simulate(network, 2.0, initial={"displacement": {"a": 1.0}}, **options)
    assert list(first.state.values) == ["held.hysteretic", "held.last"]
    assert abs(first.final_law_state.sel(state="held.hysteretic").item()) > 0.1
    second = il.simulate(network, 4.0, initial=first, **options)
    begin = json.loads(second.attrs["impactlab_configuration"])["simulate"]["initial"]
    forgetful = il.simulate(network, 4.0, initial={**begin, "state": {}}, **options)
    assert apart(second, forgetful) > 0.05


def noisy(density=1.0):
    """A pair under noise with a law with states."""
    return pair(
        contacts={"gap": il.Contact("a", "b", il.HertzContact(50.0), clearance=0.3)},
        couplings={"held": il.Coupling("a", il.WALL, il.BoucWenCoupling(stiffness=2.0, yield_displacement=0.2))},
        excitations={name: il.WhiteNoise(density) for name in "ab"},
    )


STEPS = {"realizations": 13, "step": 0.02, "integrator": il.ExactFlow(measured=False)}


@pytest.fixture(scope="module")
def earlier():
    return il.simulate(noisy(), 2.0, rng=1, record=[END, il.Trajectory(0.1)], **STEPS)


def later(initial, **options):
    return il.simulate(
        noisy(), 1.0, **{"initial": initial, "rng": 2, "record": [END, il.Trajectory(0.1)], **STEPS, **options}
    )


@pytest.mark.full
def test_each_realization_begins_where_its_own_ended(earlier):
    end, begin = earlier.isel(time=-1), later(earlier).isel(time=0)
    np.testing.assert_array_equal(earlier.final_displacement, end.displacement)
    np.testing.assert_array_equal(earlier.final_law_state, end.law_state)
    np.testing.assert_allclose(earlier.final_velocity, end.velocity, atol=0.01)
    assert len(np.unique(earlier.final_velocity)) == 26
    np.testing.assert_array_equal(begin.displacement, earlier.final_displacement)
    np.testing.assert_array_equal(begin.velocity, earlier.final_velocity)
    np.testing.assert_array_equal(begin.law_state, earlier.final_law_state)


@pytest.mark.full
def test_numbers_do_not_depend_on_blocks_and_threads(earlier):
    expected = later(earlier)
    for lanes in (1, 3, 8):
        with tuned(lanes=lanes), concurrent.futures.ThreadPoolExecutor(2) as pool:
            assert expected.equals(later(earlier, executor=pool))


@pytest.mark.full
def test_a_file_will_do_and_the_run_can_be_repeated(earlier, tmp_path):
    expected = later(earlier)
    il.save(earlier, tmp_path / "earlier.nc")
    for initial in (tmp_path / "earlier.nc", str(tmp_path / "earlier.nc")):
        assert expected.equals(later(initial))
    il.save(expected, tmp_path / "later.nc")
    (tmp_path / "earlier.nc").unlink()
    assert expected.equals(il.rerun(tmp_path / "later.nc"))
    third = later(tmp_path / "later.nc", rng=3)
    np.testing.assert_array_equal(third.displacement[:, 0], expected.final_displacement)


@pytest.mark.full
def test_one_realization_begins_all(earlier):
    begin = later(earlier.isel(realization=5)).isel(time=0)
    np.testing.assert_array_equal(begin.displacement, np.tile(earlier.final_displacement[5], (13, 1)))
    np.testing.assert_array_equal(begin.law_state, np.tile(earlier.final_law_state[5], (13, 1)))


@pytest.mark.full
def test_without_noise_each_start_has_its_path(earlier):
    full = noisy()
    quiet = il.Network(dict(full.oscillators), dict(full.contacts), {}, dict(full.couplings))
    options = {"step": 0.02, "record": [END, il.PerRealization()]}
    every = il.simulate(quiet, 1.0, initial=earlier, realizations=13, rng=1, **options)
    assert "deterministic" not in every.attrs
    for index in (0, 12):
        one = il.simulate(quiet, 1.0, initial=earlier.isel(realization=index), realizations=13, **options)
        assert one.attrs["deterministic"]
        np.testing.assert_allclose(every.final_velocity[index], one.final_velocity[0], rtol=1e-12)


@pytest.mark.full
def test_values_by_realization():
    places = np.linspace(-1.0, 1.0, 5)
    initial = {"displacement": {"a": places, "b": 0.2}, "velocity": {"b": [3.0]}}
    ds = il.simulate(noisy(), 0.1, realizations=5, step=0.02, initial=initial, rng=1, record=il.Trajectory(0.1))
    np.testing.assert_array_equal(ds.displacement[:, 0], np.stack([places, np.full(5, 0.2)], axis=1))
    np.testing.assert_array_equal(ds.velocity[:, 0], np.tile([0.0, 3.0], (5, 1)))
    assert ds.equals(il.rerun(ds))


def test_the_energy_of_several_starts_is_the_largest():
    model = Model.of(stopped(il.HertzContact(50.0), 0.1))
    starts = np.array([[[1.0, -1.0, 0.0], [0.0, 0.5, 0.0]], [[0.0, 1.0, -3.0], [0.0, 0.0, 0.0]]])
    alone = np.stack([energy_of(model, starts[..., k]) for k in range(3)])
    assert alone.argmax(axis=0).tolist() == [0, 0]
    assert (energy_of(model, starts) >= alone.max(axis=0)).all()
    assert (energy_of(model, starts) <= alone.sum(axis=0)).all()


def test_a_run_with_contact_free_intervals_ends_where_its_trajectory_does():
    rare = base(clearance=1.0)
    ds = il.simulate(rare, 40.0, realizations=8, rng=1, record=[END, il.Trajectory(40.0)])
    assert ds.attrs["longest_jump"] > ds.attrs["step"]
    np.testing.assert_array_equal(ds.final_displacement, ds.displacement[:, -1])
    np.testing.assert_array_equal(ds.final_velocity, ds.velocity[:, -1])


REFUSED = {
    "rng": ({"rng": 1}, r"same rng, whose noise would be repeated"),
    "number": ({"realizations": 3}, r"values of 13 realizations, but there are to be 3; give realizations=13"),
    "tolerance": (
        {"tolerance": {"contact_ratio": 0.1}, "step": None, "integrator": None},
        r"With a tolerance the number of realizations",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_go_on_is_refused(name, earlier):
    options, message = REFUSED[name]
    with pytest.raises(il.InvalidInput, match=message):
        later(earlier, **options)


def test_starts_that_do_not_fit_are_refused(earlier, tmp_path):
    refused = [
        (earlier.drop_vars("final_velocity"), r"has no final state; repeat .* record=il.FinalState\(\)"),
        (earlier.isel(oscillator=[0]), r"has the oscillators \['a'\], this network \['a', 'b'\]"),
        (earlier.isel(state=[0]), r"has the states of laws \['held.hysteretic'\]"),
        (earlier.drop_vars("final_law_state"), r"has the states of laws \[\]"),
        (earlier.expand_dims(speed=2), r"of a sweep select one point"),
        (earlier.assign(final_velocity=earlier.final_velocity * np.nan), r"velocity of 'a' must be a finite number"),
        (earlier.drop_attrs(), r"There is no attribute 'impactlab_configuration'"),
        (tmp_path / "none.nc", r"There is no file .*none.nc"),
        (str(tmp_path / "none.nc"), r"initial must be .* the path of its file, not"),
        ({"displacement": {"a": [0.1, 0.2]}, "velocity": {"b": [1.0] * 3}}, r"values of \[2, 3\] realizations"),
        ({"displacement": {"a": []}}, r"displacement of 'a' has no values"),
        ({"displacement": {"a": [math.nan] * 13}}, r"displacement of 'a' must be a finite number"),
        ({"state": {"held.lst": 1.0}}, r"no state of a law 'held.lst'; did you mean 'held.last'"),
    ]
    for initial, message in refused:
        with pytest.raises(il.InvalidInput, match=message):
            later(initial)
    with pytest.raises(il.InvalidInput, match=r"displacement\['a'\] must be a number"):
        pair().compile().state(displacement={"a": [1.0, 2.0]})


@pytest.mark.full
def test_a_sweep_up_and_down_finds_both_branches():
    """Two motions of a hardening oscillator at one frequency, each reached from the side on which it begins."""

    def response(frequencies):
        previous, size = {}, {}
        for frequency in frequencies:
            body = il.DuffingOscillator(mass=1.0, damping=0.1, stiffness=1.0, cubic=0.5)
            driven = il.Network({"a": body}, excitations={"a": il.Harmonic(0.3, frequency=frequency)})
            duration = 30 * 2.0 * math.pi / frequency
            previous = il.simulate(driven, duration, initial=previous, spin_up=duration, step=0.05, record=END)
            size[frequency] = math.sqrt(2.0 * previous.mean_square_displacement.item())
        return size

    grid = [0.8, 1.0, 1.2, 1.4, 1.6]
    up, down = response(grid), response(grid[::-1])
    assert up[1.4] > 4.0 * down[1.4]
    for frequency in (0.8, 1.0, 1.6):
        assert abs(up[frequency] / down[frequency] - 1.0) < 0.02


def test_coloured_noise_goes_on():
    """The force is the same before and after, and forgets as it does within a run; that of another name is drawn anew.

    Forces are the changes of velocities over a step, in which the noise forgets 1 % of itself.
    """
    noise = il.OrnsteinUhlenbeckNoise.from_variance(1.0, correlation_time=2.0)
    network = il.Network({"a": il.LinearOscillator(damping=0.1, stiffness=4.0)}, excitations={"a": noise})
    options = {"step": 0.02, "realizations": 2000, "record": [END, il.Trajectory(0.02)]}
    first = il.simulate(network, 2.0, rng=1, initial={}, **options)
    end = first.final_filter_state.sel(filter_state="a.0")
    assert first.final_filter_state.dims == ("realization", "filter_state")
    assert float(end.var()) == pytest.approx(1.0, abs=3.0 * math.sqrt(2.0 / 2000))

    def force(path, begin):
        v, x = (path[name][:, begin : begin + 2, 0].values for name in ("velocity", "displacement"))
        return (v[:, 1] - v[:, 0]) / 0.02 + 4.0 * x.mean(axis=1) + 0.1 * v.mean(axis=1)

    second = il.simulate(network, 0.1, rng=2, initial=first, **options)
    before, after = force(first, 99), force(second, 0)
    assert np.corrcoef(before, after)[0, 1] > 0.98
    for values in (before, after):
        assert np.corrcoef(values, end)[0, 1] > 0.99
    assert np.corrcoef(second.final_filter_state[:, 0], end)[0, 1] == pytest.approx(math.exp(-0.05), abs=0.01)
    other = network.replace(excitations={"a": None, "wind": il.Source(noise, on="a")})
    anew = il.simulate(other, 0.1, rng=2, initial=first, **options)
    assert abs(np.corrcoef(force(anew, 0), end)[0, 1]) < 0.1
    begin = json.loads(second.attrs["impactlab_configuration"])["simulate"]["initial"]
    assert begin["filter_state"]["a.0"] == end.values.tolist()
