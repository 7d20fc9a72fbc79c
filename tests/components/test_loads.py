"""Loads: forces of common shapes in time, against closed forms of the motion and other solvers."""

import itertools

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import quad, solve_ivp
from scipy.signal import lsim

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.compiling.jit import compilations
from impactlab.linear.given_functions import largest_energy, resolving_step, span_of

MASS, FREQUENCY = 2.0, 2.0 * np.pi
BODY = il.LinearOscillator.from_frequency(FREQUENCY, mass=MASS)
SHAPES = {
    "rectangle": lambda part: 1.0,
    "half-sine": lambda part: np.sin(np.pi * part),
    "versed-sine": lambda part: 0.5 * (1.0 - np.cos(2.0 * np.pi * part)),
}


ENVELOPE = [0.1, 0.9, 2.0, 3.0], [0.5, 1.0, -0.5, 0.0]
KNOWN = [0.0, 0.7, 1.5, 4.0], [1.0, -2.0, 0.5, 1.0]


CORNERS = 0.1, 0.7, 0.9, 1.5, 2.0, 2.25
"""Times at which their products change."""


class Beats(il.Excitation):
    """A force that a user may write."""

    size: float = il.parameter(units="N")

    @staticmethod
    def force(time, size):
        return size * np.cos(4.0 * time) * np.cos(time)


CARRIERS = {
    "constant": il.ConstantForce(2.0), "harmonic": il.Harmonic(2.0, frequency=FREQUENCY, phase=0.4),
    "chirp": il.Chirp(1.5, start_frequency=1.0, end_frequency=20.0, duration=2.25), "samples": il.SampledForce(*KNOWN),
    "user's own": Beats(1.5),
}  # fmt: skip
FORCES = {
    "constant": lambda t: 2.0, "harmonic": lambda t: 2.0 * np.sin(FREQUENCY * t + 0.4),
    "chirp": lambda t: 1.5 * np.sin(t + 0.5 * 19.0 / 2.25 * t**2) if t <= 2.25 else 0.0,
    "samples": lambda t: np.interp(t, *KNOWN), "user's own": lambda t: 1.5 * np.cos(4.0 * t) * np.cos(t),
}  # fmt: skip


@pytest.fixture(scope="module")
def motion():
    """Displacements from rest under each load: an oscillator of its own without damping."""
    loads = {shape: il.Pulse(3.0, duration=0.3, start=0.2, shape=shape) for shape in SHAPES}
    loads["chirp"] = il.Chirp(1.5, start_frequency=1.0, end_frequency=20.0, duration=2.25)
    loads["constant"] = il.ConstantForce(-1.5)
    loads["harmonic"] = il.Harmonic(2.0, frequency=5.0, phase=0.3)
    loads["resonance"] = il.Harmonic(2.0, frequency=FREQUENCY)
    times = np.sort(np.append(np.linspace(0.0, 4.0, 4001), np.linspace(0.0, 4.0, 771)[1:-1] + 1e-4))
    loads["samples"] = il.SampledForce(times, 2.0 * np.sin(5.0 * times + 0.3))
    loads |= {f"{name} with an envelope": il.ModulatedForce(item, *ENVELOPE) for name, item in CARRIERS.items()}
    network = il.Network(dict.fromkeys(loads, BODY), {}, loads)
    return il.simulate(network, 4.0, step=0.01, initial={}, record=il.Trajectory(0.25)).displacement[0]


def of(motion, name):
    return motion.time.values, motion.sel(oscillator=name).values


@pytest.mark.full
@pytest.mark.parametrize("shape", SHAPES)
def test_a_pulse_moves_an_oscillator_as_duhamel_s_integral_says(motion, shape):
    def response(time):
        push = lambda at: 3.0 * SHAPES[shape]((at - 0.2) / 0.3) * np.sin(FREQUENCY * (time - at))  # noqa: E731
        end = min(time, 0.5)
        return quad(push, 0.2, end, epsabs=1e-13)[0] / (MASS * FREQUENCY) if end > 0.2 else 0.0

    times, found = of(motion, shape)
    np.testing.assert_allclose(found, [response(time) for time in times], atol=1e-7 * np.abs(found).max())


@pytest.mark.full
def test_a_constant_force_shifts_the_oscillation(motion):
    times, found = of(motion, "constant")
    rest = -1.5 / (MASS * FREQUENCY**2)
    np.testing.assert_allclose(found, rest * (1.0 - np.cos(FREQUENCY * times)), atol=1e-7 * abs(rest))


def test_a_harmonic_force(motion):
    """The forced oscillation and the free one that it starts; in resonance they grow together."""
    times, found = of(motion, "harmonic")
    amplitude = 2.0 / (MASS * (FREQUENCY**2 - 5.0**2))
    free = np.sin(0.3) * np.cos(FREQUENCY * times) + 5.0 / FREQUENCY * np.cos(0.3) * np.sin(FREQUENCY * times)
    np.testing.assert_allclose(found, amplitude * (np.sin(5.0 * times + 0.3) - free), atol=1e-7)
    times, found = of(motion, "resonance")
    angle = FREQUENCY * times
    expected = (np.sin(angle) - angle * np.cos(angle)) / (MASS * FREQUENCY**2)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_a_chirp_that_ends(motion):
    def slope(time, y):
        force = 1.5 * np.sin(time + 19.0 * time**2 / 4.5) if time <= 2.25 else 0.0
        return [y[1], force / MASS - FREQUENCY**2 * y[0]]

    times, found = of(motion, "chirp")
    first = solve_ivp(slope, (0.0, 2.25), [0.0, 0.0], t_eval=times[times <= 2.25], rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(found[times <= 2.25], first[0], atol=1e-6 * np.abs(found).max())
    rest = solve_ivp(slope, (2.25, 4.0), first[:, -1], t_eval=times[times > 2.25], rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(found[times > 2.25], rest[0], atol=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("name", CARRIERS)
def test_a_force_with_an_envelope_moves_an_oscillator_as_duhamel_s_integral_says(motion, name):
    def response(time):
        push = lambda at: np.interp(at, *ENVELOPE) * FORCES[name](at) * np.sin(FREQUENCY * (time - at))  # noqa: E731
        ends = [end for end in CORNERS if end < time] + [min(time, 3.0)]
        parts = itertools.pairwise(ends) if time > 0.1 else ()
        return sum(quad(push, *part, epsabs=1e-12)[0] for part in parts) / (MASS * FREQUENCY)

    times, found = of(motion, f"{name} with an envelope")
    np.testing.assert_allclose(found, [response(time) for time in times], atol=1e-6 * np.abs(found).max())


@pytest.mark.full
def test_a_product_is_as_plain_in_a_right_hand_side():
    load = il.ModulatedForce(il.Harmonic(3.0, frequency=5.0), *ENVELOPE)
    network = il.Network({"a": BODY, "b": BODY}, {}, {"a": load, "b": il.Harmonic(1.0, frequency=2.0)})
    for time in (0.05, 0.5, 1.3, 3.5):
        rates = network.compile().rhs(time, np.zeros(4))
        expected = [np.interp(time, *ENVELOPE, left=0.0, right=0.0) * 3.0 * np.sin(5.0 * time), np.sin(2.0 * time)]
        np.testing.assert_allclose(rates[2:], np.array(expected) / MASS, rtol=1e-14, atol=1e-15)
        assert load.call("force", time) == pytest.approx(expected[0], rel=1e-14, abs=1e-15)


def test_when_a_product_is_known_and_of_what_it_is_made():
    short = il.SampledForce([1.0, 2.0], [1.0, 1.0])
    assert il.ModulatedForce(short, [0.0, 1.5], [1.0, 1.0]).acts_between == (1.0, 1.5)
    assert il.ModulatedForce(short, [0.0, 1.5], [1.0, 1.0]).known_until == np.inf
    assert il.ModulatedForce(short, [0.0, 2.5], [1.0, 1.0]).known_until == 2.0
    assert il.ModulatedForce(short, [5.0, 6.0], [1.0, 1.0]).acts_between == (5.0, 5.0)
    load = il.ModulatedForce(il.Harmonic(1.0, frequency=2.0), np.arange(50.0), np.ones(50))
    assert repr(load) == "ModulatedForce of 50 samples from 0 to 49 s of Harmonic(amplitude=1.0, frequency=2.0)"
    assert il.Excitation.from_dict(load.to_dict()) == load
    with pytest.raises(il.InvalidInput, match=r"has an envelope; give the product of both to its own carrier"):
        il.ModulatedForce(load, [0.0, 1.0], [1.0, 1.0])
    with pytest.raises(il.InvalidInput, match=r"ModulatedForce takes a value for each time, not 1 for 2 times"):
        il.ModulatedForce(short, [0.0, 1.0], [1.0])


def test_a_harmonic_force_acts_in_the_spin_up():
    """So that the motion is steady at time 0."""
    body = il.LinearOscillator(mass=MASS, damping=4.0, stiffness=30.0)
    network = il.Network({"a": body}, {}, {"a": il.Harmonic(3.0, frequency=4.0, phase=np.pi / 2)})
    paths = il.simulate(network, 2.0, step=0.01, spin_up=30.0, record=il.Trajectory(0.1)).displacement[0, :, 0]
    response = 3.0 / (30.0 - MASS * 16.0 + 16.0j)
    expected = np.real(response * np.exp(4.0j * paths.time.values))
    np.testing.assert_allclose(paths.values, expected, atol=1e-6 * np.abs(response))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: il.Harmonic(1.0, frequency=0.0), r"Harmonic.frequency must be larger than 0 rad s-1, not 0.0"),
        (lambda: il.Chirp(1.0, start_frequency=1.0, end_frequency=2.0, duration=0.0), r"Chirp.duration must be larger"),
        (lambda: il.Pulse(1.0, duration=-1.0), r"Pulse.duration must be larger than 0 s, not -1.0"),
        (lambda: il.Pulse(1.0, duration=1.0, shape="half-sin"), r"There is no shape of a pulse 'half-sin'; did you"),
        (lambda: il.Pulse(1.0, duration=1.0, shape=2), r"Pulse.shape must be a string, not 2"),
        (lambda: il.ConstantForce(np.inf), r"ConstantForce.load must be a finite number, not inf"),
    ],
)
def test_bad_load(make, message):
    with pytest.raises(il.InvalidInput, match=message):
        make()


TIMES = 0.02 * np.arange(400)
VALUES = np.random.default_rng(3).normal(size=400) * np.exp(-(((TIMES - 4.0) / 2.0) ** 2))


def shaken(load, **body):
    body = il.LinearOscillator(mass=MASS, damping=0.8, stiffness=60.0)
    return il.Network(
        {"a": body, "b": body}, {}, {"a": load, "b": il.SampledForce([0.0, 1.0], [0.0, 1.0], after="zero")}
    )


def path(network, duration=7.0, **options):
    return il.simulate(network, duration, initial={}, record=il.Trajectory(0.25), **options)


@pytest.mark.full
def test_samples_move_a_body_as_a_piecewise_linear_force():
    """Exactly, at steps that divide the distance of samples; the other body after its samples is free."""
    data = path(shaken(il.SampledForce(TIMES, VALUES, scale=2.0)), step=0.01)
    system = [[0.0, 1.0], [-60.0 / MASS, -0.8 / MASS]], [[0.0], [1.0 / MASS]], [[1.0, 0.0]], [[0.0]]
    grid = 0.005 * np.arange(1401)
    forces = {"a": 2.0 * np.interp(grid, TIMES, VALUES), "b": np.where(grid <= 1.0, grid, 0.0)}
    forces["b"][grid > 1.0] = 0.0
    _, expected, _ = lsim(system, forces["a"], grid)
    np.testing.assert_allclose(data.displacement[0, :, 0], expected[::50], atol=1e-9 * np.abs(expected).max())
    ramp = lsim(system, grid[:201], grid[:201])
    free = lsim(system, np.zeros(1201), grid[:1201], X0=ramp[2][-1])[1]
    found, expected = data.displacement[0, :, 1], np.concatenate([ramp[1][:-1], free])
    np.testing.assert_allclose(found, expected[::50], atol=1e-7 * np.abs(expected).max())


def test_values_that_are_held_move_a_body_exactly():
    """A body under a force that is constant between samples, at steps that divide their distance."""
    data = path(shaken(il.SampledForce(TIMES, VALUES, interpolation="previous")), step=0.01)
    system = [[0.0, 1.0], [-60.0 / MASS, -0.8 / MASS]], [[0.0], [1.0 / MASS]], [[1.0, 0.0]], [[0.0]]
    _, expected, _ = lsim(system, VALUES[:351], TIMES[:351], interp=False)
    found = data.displacement.sel(oscillator="a")[0, ::2]
    np.testing.assert_allclose(found, expected[::25], atol=1e-9 * np.abs(expected).max())


def test_cubic_samples_are_a_spline():
    """One that keeps cubic polynomials; between samples of a sine of 32 in a period it is off by (h⁴/384) or less."""
    times = np.array([0.0, 0.3, 0.5, 1.1, 1.6, 2.0])
    at = np.linspace(0.0, 2.0, 401)
    load = il.SampledForce(times, times**3 - 2.0 * times, scale=3.0, interpolation="cubic")
    np.testing.assert_allclose(load.call("force", at), 3.0 * (at**3 - 2.0 * at), atol=1e-12)
    times = np.linspace(0.0, 2.0 * np.pi, 33)
    values = np.sin(times)
    values[-1] = values[0]
    wave = il.SampledForce(times, values, after="repeat", interpolation="cubic")
    at = np.linspace(-20.0, 20.0, 2001)
    assert np.abs(wave.call("force", at) - np.sin(at)).max() < 1.05 * times[1] ** 4 / 384.0
    assert np.abs(wave.replace(interpolation="linear").call("force", at) - np.sin(at)).max() > 4e-3


@pytest.mark.full
def test_cubic_samples_of_a_sine_do_what_the_sine_does():
    times = np.linspace(0.0, 4.0, 81)
    force = il.Harmonic(2.0, frequency=5.0)
    loads = {"sine": force, "cubic": il.SampledForce(times, force.call("force", times), interpolation="cubic")}
    data = path(il.Network(dict.fromkeys(loads, BODY), {}, loads), 4.0, step=0.01).displacement[0]
    np.testing.assert_allclose(data[:, 1], data[:, 0], atol=2e-5 * np.abs(data).max())


def test_at_the_chosen_step_samples_are_resolved():
    network = shaken(il.SampledForce(TIMES, VALUES))
    data, fine = (path(network, integrator=il.ExactFlow(), step=step) for step in (None, 0.002))
    assert data.step > 0.002
    np.testing.assert_allclose(data.displacement, fine.displacement, atol=2e-3 * np.abs(fine.displacement).max())


def test_samples_of_a_sine_do_what_the_sine_does(motion):
    np.testing.assert_allclose(of(motion, "samples")[1], of(motion, "harmonic")[1], atol=3e-7)


@pytest.mark.parametrize("unequal", [False, True])
def test_values_between_and_outside_of_samples(unequal):
    times = 2.0 + (np.linspace(0.0, 3.0, 31) ** 2 if unequal else 0.3 * np.arange(31))
    values = np.cos(times)
    at = np.concatenate([times, np.random.default_rng(4).uniform(-20.0, 30.0, 300)])
    inside = np.where((at >= 2.0) & (at <= 11.0), np.interp(at, times, values), 0.0)
    for after in ("error", "zero"):
        load = il.SampledForce(times, values, after=after)
        np.testing.assert_allclose(load.call("force", at), inside, atol=1e-12)
    again = il.SampledForce(times, values, after="repeat").call("force", at[31:])
    np.testing.assert_allclose(again, np.interp((at[31:] - 2.0) % 9.0 + 2.0, times, values), atol=1e-12)


def test_other_samples_compile_nothing_and_a_file_gives_the_same_numbers(tmp_path):
    first = path(shaken(il.SampledForce(TIMES, VALUES)))
    before = compilations()
    other = path(shaken(il.SampledForce(TIMES[:-7] ** 1.01, VALUES[7:] + 0.1, after="repeat")))
    assert compilations() == before
    assert (first.displacement != other.displacement).any()
    il.save(other, tmp_path / "run.nc")
    again = il.rerun(tmp_path / "run.nc")
    np.testing.assert_array_equal(again.displacement, other.displacement)
    assert il.network_of(tmp_path / "run.nc") == il.network_of(other)


def test_samples_from_labelled_arrays():
    record = xr.DataArray(VALUES, {"time": TIMES}, dims="time")
    assert il.SampledForce.from_dataarray(record, scale=3.0) == il.SampledForce(TIMES, VALUES, scale=3.0)
    assert il.SampledForce(record.time, record) == il.SampledForce(list(TIMES), list(VALUES))
    assert repr(il.SampledForce(TIMES, VALUES)) == "SampledForce of 400 samples from 0 to 7.98 s"
    for wrong in (record.expand_dims("x"), record.drop_vars("time"), VALUES):
        with pytest.raises(
            il.InvalidInput,
            match=r"(takes a DataArray of one dimension, with a coordinate of times|must be a DataArray)",
        ):
            il.SampledForce.from_dataarray(wrong)
    with pytest.raises(il.InvalidInput, match="takes times in seconds, not of the type datetime64"):
        il.SampledForce.from_dataarray(record.assign_coords(time=np.arange(400).astype("datetime64[s]")))


def test_a_record_that_is_shorter_than_the_run():
    load = il.SampledForce(TIMES, VALUES)
    with pytest.raises(il.InvalidInput, match=r"samples of 'a' end at 7.98 s, 2.02 s before the run .* after=\"zero\""):
        path(shaken(load), 10.0)
    assert path(shaken(load.replace(after="zero")), 10.0).displacement[0, -1, 0] != 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0, 1.0], [1.0]), r"SampledForce takes a value for each time, not 1 for 2 times"),
        (([0.0], [1.0]), r"SampledForce needs two samples at least"),
        (([0.0, 0.2, 0.2], [1.0] * 3), r"times must increase, but sample 2 \(from 0\) at 0.2 s follows one at 0.2 s"),
        (
            ([0.0, 1.0, 2.0], [1.0, np.nan, 0.0]),
            r"SampledForce.values must be finite, but 1 of 3 are not, the first at 1",
        ),
        (([0.0, np.inf], [1.0, 1.0]), r"SampledForce.times must be finite"),
        (([0.0, 1.0], ["a", "b"]), r"SampledForce.values must be real numbers"),
        (([0.0, 1.0], [1.0, 1j]), r"SampledForce.values must be real numbers, not \[1.0, 1j\]"),
        (([[0.0, 1.0]], [1.0, 1.0]), r"SampledForce.times must be a row of numbers, not of shape \(1, 2\)"),
    ],
)
def test_bad_samples(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.SampledForce(*arguments)
    with pytest.raises(il.InvalidInput, match=r"no value of SampledForce.after 'cycle'; allowed are 'error', 'zero'"):
        il.SampledForce([0.0, 1.0], [1.0, 1.0], after="cycle")
    with pytest.raises(il.InvalidInput, match=r"no value of SampledForce.interpolation 'sinc'; allowed are 'previous'"):
        il.SampledForce([0.0, 1.0], [1.0, 1.0], interpolation="sinc")


@pytest.mark.full
def test_modulated_noise_moves_an_oscillator_as_its_envelope_says():
    """The mean square of the displacement is ``2π ∫ S e(s)² h(t − s)² ds`` with the response h to an impulse."""
    times = np.linspace(1.0, 5.0, 40)
    noise = il.ModulatedNoise(0.5, times, np.sin(times) + 0.2)
    body = il.LinearOscillator(mass=MASS, damping=0.8, stiffness=60.0)
    data = il.simulate(
        il.Network({"a": body}, {}, {"a": noise}), 6.0, realizations=4000, initial={}, rng=1, record=il.Trajectory(1.5)
    )
    decay, own = 0.2, np.sqrt(30.0 - 0.04)
    for time, squares in zip(data.time.values[1:], data.displacement.values[:, 1:, 0].T ** 2, strict=True):
        at = np.linspace(0.0, time, 4001)
        response = np.exp(-decay * (time - at)) * np.sin(own * (time - at)) / (MASS * own)
        envelope = np.interp(at, times, np.sin(times) + 0.2, left=0.0, right=0.0)
        expected = 2.0 * np.pi * 0.5 * np.trapezoid((envelope * response) ** 2, at)
        assert abs(squares.mean() - expected) < 3.5 * squares.std(ddof=1) / np.sqrt(4000), time
    assert repr(noise) == "ModulatedNoise of 40 samples from 1 to 5 s"
    with pytest.raises(il.InvalidInput, match=r"ModulatedNoise takes a value for each time, not 1 for 2 times"):
        il.ModulatedNoise(0.5, [0.0, 1.0], [1.0])


@pytest.mark.parametrize("start", [0.2, 0.20777, 800.0])
def test_a_short_pulse_in_a_long_run_is_found(start):
    """Its step, and the energy that it brings; others of the body bring theirs as well, at the worst at one time."""
    pulse = il.Pulse(1000.0, duration=1e-3, start=start)
    body = {"a": il.LinearOscillator(mass=MASS)}
    model = Model.of(il.Network(body, {}, {"a": pulse}))
    assert 1e-4 < resolving_step(model, 0.0, 1000.0, 10.0) < 5e-4
    energy = (2.0 / np.pi) ** 2 / (2.0 * MASS)
    assert largest_energy(model, 0, -100.0, 1000.0) == pytest.approx(energy, rel=0.02)
    force = il.ConstantForce(0.01)
    both = Model.of(il.Network(body, {}, {"a": pulse, "b": il.Source(force, on="a")}))
    other = largest_energy(Model.of(il.Network(body, {}, {"a": force})), 0, 0.0, 100.0)
    assert largest_energy(both, 0, 0.0, 1000.0) == pytest.approx((energy**0.5 + 10.0 * other**0.5) ** 2, rel=0.02)


def test_when_loads_act():
    times = [1.0, 2.0, 4.0]
    assert il.Pulse(1.0, duration=2.0, start=1.0).acts_between == (1.0, 3.0)
    assert il.Chirp(1.0, start_frequency=1.0, end_frequency=2.0, duration=5.0).acts_between == (0.0, 5.0)
    assert il.SampledForce(times, times, after="zero").acts_between == (1.0, 4.0)
    assert il.SampledForce(times, times, after="repeat").acts_between == (-np.inf, np.inf)
    assert il.ModulatedNoise(1.0, times, times).acts_between == (1.0, 4.0)
    assert span_of(il.Pulse(1.0, duration=2.0, start=1.0), 0.5, 100.0) == (0.5, 4.0)
    assert span_of(il.Pulse(1.0, duration=2.0, start=-9.0), 0.5, 100.0) == (0.5, 100.0)
