"""Sums of cosines by FFT, against direct sums and what is known of the noise."""

import numpy as np
import pytest
from scenes import linear, phases
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.cosine_series import Cosines, sample_count
from impactlab.linear.laws import linear_variances, lines_of
from impactlab.linear.spectral_lines import Lines, receptance_of
from impactlab.plan.seed import seed_of

SEED = (1, 2)


def lines_with(noise):
    return Lines((0,), "a", *noise.lines())


def alone(lines, mass, damping, stiffness):
    """Displacements of one body by unit force."""
    return receptance_of(mass, damping, stiffness, lines.frequencies)[:, None]


def response_amplitudes(lines, response, phase):
    """Complex amplitudes of displacements and velocities, body by body."""
    displacement = lines.amplitudes * np.exp(1j * phase) * response.T
    return np.stack([displacement, 1j * lines.frequencies * displacement], axis=1).reshape(-1, len(phase))


def sampled(lines, gains, derivatives, interval, samples, realization=0, attempt=0, seed=SEED):
    """Values of a sum of cosines from its FFT, (sample, channel)."""
    cosines = Cosines(seed, lines, gains, derivatives, interval)
    result = np.full((cosines.channels, sample_count((lines,), interval, samples)), np.nan)
    cosines.sample(realization, attempt, result)
    return result.T


def direct(frequencies, amplitudes, times):
    return np.array([(a * np.exp(1j * np.outer(times, frequencies))).sum(axis=1).real for a in amplitudes]).T


GRIDS = {  # band, components, interval
    "on the grid": ((0.0, 50.0), 500, 1e-3),
    "a line at Nyquist": ((0.0, 50.0), 500, 1e-2),
    "folded above Nyquist": ((0.0, 50.0), 500, 0.04),
    "folded many times onto few samples": ((0.0, 50.0), 500, 1.25),
    "band from above zero, on the grid": ((10.0, 20.0), 50, 4e-3),
    "off the grid of samples": ((0.0, 50.0), 500, 1.03e-3),
    "lower end no multiple of the spacing": ((3.3333, 20.0), 77, 4e-3),
    "one line": ((0.0, 2.0), 1, 0.01),
}


@pytest.mark.parametrize(("band", "components", "interval"), GRIDS.values(), ids=GRIDS)
@pytest.mark.parametrize("wanted", [200, 1500, 3000])
def test_samples_are_the_direct_sum(band, components, interval, wanted):
    lines = lines_with(il.ShinozukaNoise(1.0, band=band, components=components))
    gains = np.concatenate([alone(lines, 1.0, 2.0, 400.0), alone(lines, 2.0, 1.0, 10.0)], axis=1)
    amplitudes = response_amplitudes(lines, gains, phases(SEED, lines, 3, 2))
    cosines = Cosines(SEED, lines, gains.T, True, interval)
    scale = np.abs(amplitudes).sum(axis=1)
    np.testing.assert_allclose(cosines.start(3, 2) / scale, amplitudes.sum(axis=1).real / scale, rtol=0.0, atol=1e-14)
    samples = np.full((4, wanted), np.nan)
    cosines.sample(3, 2, samples)
    some = np.unique(np.linspace(0, wanted - 1, 1500).astype(int))
    expected = direct(lines.frequencies, amplitudes, interval * some)
    assert (np.abs(samples.T[some] - expected) / scale).max() < 1e-11


@pytest.mark.full
def test_lines_at_any_distance_are_summed_directly():
    frequencies = np.array([0.3, 1.0, 7.7, 20.0])
    lines = Lines((0,), "a", frequencies, np.array([1.0, 2.0, 3.0, 4.0]))
    amplitudes = (lines.amplitudes * np.exp(1j * phases(SEED, lines, 0, 0)))[None]
    expected = direct(frequencies, amplitudes, 0.1 * np.arange(700))
    np.testing.assert_allclose(sampled(lines, np.ones((1, 4)), False, 0.1, 700), expected, rtol=0.0, atol=1e-11)


def test_one_period_is_kept_or_what_is_needed():
    def count(*names, needed=1500):
        grids = [GRIDS[name] for name in names]
        lines = tuple(
            lines_with(il.ShinozukaNoise(1.0, band=band, components=components)) for band, components, _ in grids
        )
        return sample_count(lines, grids[0][2], needed)

    assert count("on the grid") == 1500
    assert count("on the grid", needed=20_000) == 10_000
    assert count("folded above Nyquist") == 250
    assert count("off the grid of samples") == 1500
    assert count("lower end no multiple of the spacing") == 1500
    assert count("folded above Nyquist", "folded above Nyquist") == 250
    assert count("folded above Nyquist", "one line") == 1500  # two periods: the whole run


@pytest.mark.full
def test_force_is_bounded_periodic_and_has_its_variance_and_spectrum():
    noise = il.ShinozukaNoise(0.7, band=(0.0, 20.0), components=400)
    lines = lines_with(noise)
    spacing = 20.0 / 400
    amplitude = np.sqrt(2.0 * 4.0 * np.pi * 0.7 * spacing)
    np.testing.assert_allclose(lines.amplitudes, amplitude, rtol=1e-14)
    np.testing.assert_allclose(lines.frequencies, 2.0 * np.pi * spacing * np.arange(1, 401), rtol=1e-14)
    assert noise.period == pytest.approx(1.0 / spacing)
    force = sampled(lines, np.ones((1, 400)), False, 0.005, 8000)[:, 0]
    assert len(force) == 4000  # one period
    assert np.abs(force).max() <= 400 * amplitude
    assert abs(force.mean()) < 1e-12
    assert (force**2).mean() == pytest.approx(4.0 * np.pi * 0.7 * 20.0, rel=1e-12)  # S_f times the band
    spectrum = np.abs(np.fft.rfft(force)) / 2000.0
    np.testing.assert_allclose(spectrum[1:401], amplitude, rtol=1e-9)
    assert spectrum[401:].max() < 1e-9


@pytest.mark.full
def test_phases_belong_to_realization_attempt_body_and_seed():
    lines = lines_with(il.ShinozukaNoise(1.0, components=50000))

    def drawn(seed=SEED, lines=lines, realization=0, attempt=0):
        return sampled(lines, np.ones((1, 50000)), False, 1e-3, 100_000, realization, attempt, seed)[:, 0]

    force = drawn()
    other_body = Lines((0,), "b", lines.frequencies, lines.amplitudes)
    for other in (drawn(realization=1), drawn(attempt=1), drawn(seed=(2, 2)), drawn(lines=other_body)):
        assert abs(np.corrcoef(force, other)[0, 1]) * np.sqrt(len(force)) < 4.0
    np.testing.assert_array_equal(drawn(), force)


@pytest.mark.parametrize("linear_part", [(1.0, 2.0, 400.0), (2.0, 0.1, 50.0), (0.5, 5.0, 0.0)], ids=str)
def test_response_solves_the_equation_of_motion(linear_part):
    m, c, k = linear_part
    lines = lines_with(il.ShinozukaNoise(1.0, band=(1.0, 6.0), components=20))
    phase = phases(SEED, lines, 0, 0)
    force = (lines.amplitudes * np.exp(1j * phase))[None]
    response = response_amplitudes(lines, alone(lines, *linear_part), phase)

    def rhs(t, y):
        f = (force[0] * np.exp(1j * lines.frequencies * t)).sum().real
        return [y[1], (f - c * y[1] - k * y[0]) / m]

    start = response.real.sum(axis=1)
    times = np.linspace(0.0, 4.0, 33)
    solution = solve_ivp(rhs, (0.0, 4.0), start, "DOP853", times, rtol=1e-11, atol=1e-12).y.T
    np.testing.assert_allclose(direct(lines.frequencies, response, times), solution, rtol=0.0, atol=1e-8)


def band_limited(ratio, components):
    network = linear(density=1.0, ratio=ratio)
    noise = il.ShinozukaNoise(1.0, band=(0.0, 10.0), components=components)
    return network.replace(excitations={"a": noise}), noise


def test_band_limited_law_is_the_sum_over_the_lines_and_tends_to_the_white_one():
    network, noise = band_limited(0.1, 2000)
    model = Model.of(network)
    (omega, amplitude), body = noise.lines(), network.oscillators["a"]
    gain = amplitude**2 / 2.0 / ((body.stiffness - omega**2) ** 2 + (body.damping * omega) ** 2)
    computed = linear_variances(model)[:, 0]
    np.testing.assert_allclose(computed, [gain.sum(), (omega**2 * gain).sum()], rtol=1e-12)
    white = np.pi / body.damping * np.array([1.0 / body.stiffness, 1.0])
    assert computed[0] == pytest.approx(white[0], rel=1e-3)
    assert 0.98 < computed[1] / white[1] < 0.995  # the band lowers it: 4ζ f_n/(π f_b) = 1.3 %


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("integrator", [il.ExactFlow(), il.RungeKutta4()], ids=["exact flow", "RK4"])
def test_a_period_of_a_linear_body_has_the_mean_square_of_its_lines(integrator):
    """Over one whole period, from the steady start, the mean square is no random number."""
    network, _ = band_limited(0.1, 400)
    step = {"ExactFlow": 0.02, "RungeKutta4": 0.002}[type(integrator).__name__]
    options = {"step": step, "integrator": integrator, "spin_up": 0.0, "rng": 1}
    ds = il.simulate(network, 40.0, realizations=2, record=il.PerRealization(), **options)
    expected = linear_variances(Model.of(network))[:, 0]
    tolerance = {"ExactFlow": 1e-10, "RungeKutta4": 1e-3}[type(integrator).__name__]
    np.testing.assert_allclose(ds.mean_square_displacement_by_realization[:, 0], expected[0], rtol=tolerance)
    np.testing.assert_allclose(ds.mean_square_velocity_by_realization[:, 0], expected[1], rtol=tolerance)


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("step", [0.5, 0.05, 0.013])
def test_exact_flow_follows_bounded_noise_exactly_at_any_step(step):
    network, _ = band_limited(0.1, 40)
    network = network.replace(excitations={"a": network.excitations["a"].replace(allow_repeat=True)})
    ds = il.simulate(network, 40 * step, step=step, initial="rest", spin_up=0.0, rng=5, record=il.Trajectory(step))
    item = lines_of(Model.of(network))[0]
    phase = phases(seed_of(5), item, 0, 0)
    body = network.oscillators["a"]
    drift = np.array([[0.0, 1.0], [-body.stiffness, -body.damping]])
    amplitudes = response_amplitudes(item, alone(item, 1.0, body.damping, body.stiffness), phase)
    steady = direct(item.frequencies, amplitudes, ds.time.values)
    transient = np.array([expm(drift * t) @ -steady[0] for t in ds.time.values])
    np.testing.assert_allclose(ds.displacement[0, :, 0], (steady + transient)[:, 0], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(ds.velocity[0, :, 0], (steady + transient)[:, 1], rtol=0.0, atol=1e-10)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("integrator", [il.ExactFlow(), il.RungeKutta4()], ids=["exact flow", "RK4"])
def test_series_of_different_periods_repeat_each_after_its_own(integrator):
    """A body's path does not depend on what excites another body that it never touches."""
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)
    noises = {
        "a": il.ShinozukaNoise(1.0, band=(0.0, 5.0), components=20, allow_repeat=True),  # 4 s
        "b": il.ShinozukaNoise(1.0, band=(0.0, 5.0), components=30, allow_repeat=True),  # 6 s
    }
    options = {"step": 0.01, "rng": 1, "spin_up": 0.0, "integrator": integrator, "record": il.Trajectory(0.5)}
    both = il.simulate(il.Network({"a": body, "b": body}, excitations=noises), 20.0, **options)
    for name in "ab":
        alone = il.simulate(il.Network({name: body}, excitations={name: noises[name]}), 20.0, **options)
        np.testing.assert_allclose(
            both.displacement.sel(oscillator=name), alone.displacement.sel(oscillator=name), rtol=0.0, atol=1e-12
        )


@pytest.mark.parametrize("method", [il.RungeKutta4(), il.EulerMaruyama()])
def test_a_line_near_the_inverse_of_the_step_is_not_taken_for_a_slow_one(method):
    """The step is chosen below, and refused above, what tells the lines of a series apart."""
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)
    network = il.Network({"a": body}, excitations={"a": il.ShinozukaNoise(1.0, band=(0.0, 100.0), components=4000)})
    with pytest.raises(il.InvalidInput, match="too large"):
        il.simulate(network, 10.0, step=1.01 / 101.0, integrator=method, rng=1)
    ds = il.simulate(network, 10.0, realizations=64, spin_up=10.0, integrator=il.RungeKutta4(), rng=1)
    assert ds.step <= 0.5 / 101.0 * (1.0 + 1e-9)
    white = np.pi / (body.damping * body.stiffness)
    assert (
        abs(ds.mean_square_displacement[0] / white - 1.0) < 3.5 * ds.mean_square_displacement_standard_error[0] / white
    )


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("integrator", [il.ExactFlow(), il.RungeKutta4()], ids=["exact flow", "RK4"])
def test_a_start_is_the_first_draw_without_a_closed_contact(integrator):
    """The draws are made again here with NumPy, all bodies each time."""
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)
    noise = il.ShinozukaNoise(1.0, band=(0.0, 5.0), components=40)
    network = il.chain(4, body, il.HertzContact(1e3), clearance=0.3, excitation=noise)
    options = {"spin_up": 0.0, "rng": 5, "integrator": integrator, "record": il.Trajectory(0.01)}
    ds = il.simulate(network, 0.01, step=1e-3, realizations=24, **options)
    items, attempts = lines_of(Model.of(network)), []
    gain = alone(items[0], body.mass, body.damping, body.stiffness)
    for realization in range(24):
        for attempt in range(100):
            draws = [response_amplitudes(item, gain, phases(seed_of(5), item, realization, attempt)) for item in items]
            x, v = np.array(draws).sum(axis=2).real.T
            if (x[:-1] - x[1:] <= 0.3).all():
                break
        attempts.append(attempt)
        np.testing.assert_allclose(ds.displacement[realization, 0], x, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(ds.velocity[realization, 0], v, rtol=0.0, atol=1e-12)
    assert min(attempts) == 0
    assert 3 < max(attempts) < 99
