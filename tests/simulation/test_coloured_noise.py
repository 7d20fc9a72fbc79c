"""Coloured noise in runs: stationary statistics, envelopes, contacts, and bits."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_lyapunov

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.kernels.series import NEAR
from impactlab.machine import tuned
from impactlab.mechanisms.filtered_noise.from_sample_to_sample import bring_samples
from impactlab.mechanisms.filtered_noise.processes_of_filters import ColouredNoises

BODY = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.05)
KANAI = il.KanaiTajimi(1.0, 15.0, 0.6)
CLOUGH = il.CloughPenzien(1.0, 15.0, 0.6, 1.5, 0.6)
OU = il.OrnsteinUhlenbeckNoise(1.0, correlation_time=0.5)
BAND = il.BandPassNoise(1.0, frequency=8.0, damping_ratio=0.1)
GROWS_AND_FADES = [0.0, 2.0, 6.0, 10.0], [0.0, 1.0, 1.0, 0.0]
WALL = il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.2)
few = pytest.mark.filterwarnings("ignore:Too few independent samples")


NAMES = "mean_square_displacement", "mean_square_velocity", "contact_ratio", "contact_rate", "mean_contact_force"


def class_name(item):
    return type(item).__name__


def on_ground(noise, contacts=None, **others):
    return il.Network({"a": BODY, **others}, contacts, {"ground": il.BaseMotion(noise)})


def system_of(noise):
    """Drift and growth of the filter, x and v of the body on the ground; of the drift what the force enters by."""
    a, b, c = map(np.array, noise.filter())
    states = len(b)
    drift, push, growth = np.zeros((3, states + 2, states + 2))
    drift[:states, :states] = a
    drift[states, states + 1] = 1.0
    drift[states + 1, states:] = -BODY.stiffness, -BODY.damping
    push[states + 1, :states] = -c
    growth[:states, :states] = 2.0 * np.pi * np.outer(b, b)
    return drift, push, growth


def assert_covariances(result, law):
    """Those of displacement and velocity of the body at all samples but the first, in standard errors of the run."""
    x, v = (result[name].values[:, 1:, 0] for name in ("displacement", "velocity"))
    x, v = x - x.mean(axis=0), v - v.mean(axis=0)
    names = ("variance_displacement", "covariance_displacement_velocity", "variance_velocity")
    for name, products in zip(names, (x**2, x * v, v**2), strict=True):
        error = products.std(axis=0, ddof=1) / np.sqrt(len(products))
        z = (products.mean(axis=0) - law[name].values.ravel()) / error
        assert np.abs(z).max() < 4.0, name
    scatter = (x**2).std(axis=0) / np.sqrt(len(x))
    assert (scatter < 2.0 / np.sqrt(len(x)) * law.variance_displacement[:, 0]).all()  # so that the test can fail


@pytest.mark.full
@pytest.mark.parametrize("options", [{}, {"step": 0.5}], ids=["default", "half a period"])
def test_a_structure_on_soft_soil(options):
    result = il.simulate(on_ground(KANAI), 100.0, realizations=256, rng=1, **options)
    assert il.exact(on_ground(KANAI)).statistics().variance_displacement.item() == pytest.approx(0.1682484, rel=5e-7)
    compared = il.compare(result, il.exact(on_ground(KANAI)))
    assert np.abs(compared.z).max() < 4.0
    error = result.variance_displacement_standard_error.item()
    assert error < 0.003
    assert result.variance_displacement.item() == pytest.approx(0.1682484, abs=4.0 * error)


SOFT = il.Network({"a": il.LinearOscillator(damping=2.0, stiffness=9.0)}, None, {"a": OU})


@pytest.mark.full
def test_runge_kutta_takes_samples_of_the_force():
    result = il.simulate(SOFT, 20.0, realizations=512, rng=1, integrator=il.RungeKutta4(), step=0.02)
    assert np.abs(il.compare(result, il.exact(SOFT)).z).max() < 4.0


@pytest.mark.full
def test_euler_maruyama_takes_samples_of_the_force():
    """Mean squares are those of the method's own recursion, whose force has the exact correlations."""
    step = 0.05
    result = il.simulate(SOFT, 20.0, realizations=512, rng=1, integrator=il.EulerMaruyama(), step=step)
    decay = np.exp(-step / 0.5)
    recursion = np.array([[decay, 0.0, 0.0], [0.0, 1.0, step], [step, -9.0 * step, 1.0 - 2.0 * step]])
    growth = np.diag([OU.variance * (1.0 - decay**2), 0.0, 0.0])
    for name, expected in zip(NAMES[:2], np.diag(solve_discrete_lyapunov(recursion, growth))[1:], strict=True):
        error = result[f"{name}_standard_error"].item()
        assert error < 0.02 * expected
        assert result[name].item() == pytest.approx(expected, abs=4.0 * error)


@pytest.mark.full
def test_a_first_order_filter_has_closed_forms():
    """``E[x f] = s/(α² + c α + k)``, and ``E[v²]`` and ``E[x²]`` of it by stationarity, m = 1 and α = 1/τ."""
    c, k, s, rate = 2.0, 9.0, np.pi / 0.5, 2.0
    network = il.Network({"a": il.LinearOscillator(damping=c, stiffness=k)}, None, {"a": OU})
    mixed = s / (rate**2 + c * rate + k)
    exact = il.exact(network)
    statistics = exact.statistics()
    assert statistics.mean_square_velocity.item() == pytest.approx(rate * mixed / c, rel=1e-10)
    assert statistics.variance_displacement.item() == pytest.approx(mixed * (1.0 + rate / c) / k, rel=1e-10)
    result = il.simulate(network, 40.0, realizations=512, rng=2)
    assert np.abs(il.compare(result, exact).z).max() < 4.0


def test_the_reference_knows_correlations_and_spectra():
    network = on_ground(CLOUGH).replace(excitations={"a": il.WhiteNoise(0.02)})
    exact, white = il.exact(network), il.exact(il.Network({"a": BODY}, None, {"a": il.WhiteNoise(0.02)}))
    drift, push, growth = system_of(CLOUGH)
    growth[-1, -1] = 2.0 * np.pi * 0.02
    covariance = solve_continuous_lyapunov(drift + push, -growth)
    lags = np.array([0.0, 0.3, 2.0])
    expected = [(expm(lag * (drift + push)) @ covariance)[4, 4] for lag in lags]
    np.testing.assert_allclose(exact.autocovariance("a", "displacement", lags), expected, rtol=1e-8)
    w = np.array([1.0, 6.0, 20.0])
    of_ground = CLOUGH.density(w) / np.abs(BODY.stiffness - w**2 + 1j * w * BODY.damping) ** 2
    spectrum = of_ground + white.spectrum("a", "displacement", w)
    np.testing.assert_allclose(exact.spectrum("a", "displacement", w), spectrum, rtol=1e-10)


def test_what_has_no_exact_law_says_why():
    with pytest.raises(il.NoExactReference, match="'a' is excited by KanaiTajimi; the law is known for constant white"):
        il.exact(on_ground(KANAI, {"wall": WALL}))
    with pytest.raises(il.NoExactReference, match="'a' is excited by Modulated, which depends on time"):
        il.exact(on_ground(il.Modulated(KANAI, [0.0, 1.0], [1.0, 1.0])))


@pytest.mark.full
@pytest.mark.parametrize(
    ("noise", "step"),
    [
        (il.Modulated(CLOUGH, *GROWS_AND_FADES), None),
        (il.Modulated(CLOUGH, *GROWS_AND_FADES), 0.25),
        (il.ModulatedNoise(1.0, *GROWS_AND_FADES), None),
    ],
    ids=["default", "quarter of a period", "white"],
)
def test_an_envelope_against_lyapunovs_equation_in_time(noise, step):
    result = il.simulate(
        on_ground(noise), 10.0, realizations=40_000, rng=3, step=step, record=il.Trajectory(1.0), spin_up=0.0
    )
    assert_covariances(result, il.exact_covariance(on_ground(noise), np.arange(1.0, 11.0)))


@pytest.mark.full
def test_an_envelope_that_begins_in_the_spin_up():
    noise = il.Modulated(OU.replace(at_rest=True), [-1.0, 0.5, 2.0], [0.4, 1.0, -1.0])
    result = il.simulate(on_ground(noise), 2.0, realizations=10_000, rng=3, record=il.Trajectory(0.5), spin_up=0.8)
    times, spin_up = result.time.values[1:], result.attrs["spin_up"]
    assert_covariances(result, il.exact_covariance(on_ground(noise), times, spin_up=spin_up))


@few
@pytest.mark.parametrize("at_rest", [False, True])
def test_a_start_from_rest(at_rest):
    network = on_ground(OU.replace(at_rest=at_rest))
    result = il.simulate(
        network, 2.0, realizations=4000, rng=4, step=0.1, initial="rest", spin_up=0.0, record=il.Trajectory(0.2)
    )
    assert_covariances(result, il.exact_covariance(network, 0.2 * np.arange(1, 11)))


@few
def test_given_states_begin_with_a_filter_that_is_stationary():
    """Realizations differ from the first step on, although all begin alike."""
    options = {"spin_up": 0.0, "initial": {"displacement": {"a": 0.3}}, "record": il.Trajectory(0.1), "step": 0.1}
    result = il.simulate(on_ground(OU), 1.0, realizations=2000, rng=4, **options)
    assert (result.displacement.values[:, 0, 0] == 0.3).all()
    assert_covariances(result, il.exact_covariance(on_ground(OU), 0.1 * np.arange(1, 11)))


@few
def test_a_run_begins_in_the_joint_stationary_law():
    result = il.simulate(
        on_ground(OU), 2.0, realizations=4000, rng=5, step=0.25, initial="stationary", spin_up=0.0,
        record=il.Trajectory(0.25),
    )  # fmt: skip
    drift, push, growth = system_of(OU)
    expected = np.diag(solve_continuous_lyapunov(drift + push, -growth))[1:]
    found = [result[name].values[..., 0].var(axis=0) for name in ("displacement", "velocity")]
    np.testing.assert_allclose(found, np.tile(expected[:, None], 9), rtol=4.0 * np.sqrt(2.0 / 4000.0))


@few
@pytest.mark.parametrize(
    ("spring", "step"), [(None, 0.2), (400.0, 0.05), (4.0, 0.01)], ids=["apart", "in the flow", "kicks"]
)
def test_one_noise_on_two_bodies(spring, step):
    """Of masses 1 and 2, also where a spring connects them; of the same variance as Lyapunov's equation has it."""
    bodies = {
        "a": il.LinearOscillator(mass=1.0, damping=0.4, stiffness=9.0),
        "b": il.LinearOscillator(mass=2.0, damping=1.2, stiffness=20.0),
    }
    couplings = {"s": il.Coupling("a", "b", il.LinearCoupling(spring))} if spring else None
    network = il.Network(bodies, None, {"ground": il.BaseMotion(OU)}, couplings)
    result = il.simulate(network, 40.0, realizations=256, rng=6, step=step, record=il.Trajectory(2.0))
    x = result.displacement.values
    each = np.einsum("rti,rtj->rij", x, x) / x.shape[1]
    error = each.std(axis=0, ddof=1) / np.sqrt(len(each))
    exact = il.exact(network)
    expected = np.array([[exact.covariance(p, q, "displacement") for q in "ab"] for p in "ab"])
    np.testing.assert_array_less(np.abs(each.mean(axis=0) - expected), 4.5 * error)
    assert np.abs(il.compare(result, exact).z).max() < 4.5


def assert_steps_agree(network, realizations, **options):
    """Statistics at the default step, and at an eighth of it, within 0.5 % and 3 standard errors."""
    default = il.simulate(network, 40.0, realizations=realizations, rng=7, **options)
    fine = il.simulate(network, 40.0, realizations=realizations, rng=8, step=default.step / 8.0, **options)
    both = default, fine
    for name in NAMES:
        (one, error), (other, scatter) = ((item[name].item(), item[f"{name}_standard_error"].item()) for item in both)
        assert abs(one - other) < 0.005 * other + 3.0 * np.hypot(error, scatter), name


@pytest.mark.full
def test_a_contact_at_the_default_step():
    assert_steps_agree(on_ground(KANAI, {"wall": WALL}), 256)


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("noise", "law"),
    [
        (KANAI, il.HertzContact(1e4)),
        (CLOUGH, il.LinearContact(4e3)),
        (OU, il.HertzContact(1e4)),
        (BAND, il.LinearContact(4e3)),
    ],
    ids=["KanaiTajimi", "CloughPenzien", "OrnsteinUhlenbeck", "BandPass"],
)
def test_contacts_at_the_default_step(noise, law):
    assert_steps_agree(on_ground(noise, {"wall": il.Contact("a", il.WALL, law, clearance=0.1)}), 8000)


def busy():
    """Two bodies that collide, a pair on a stiff spring, and noises of all kinds, one of them with an envelope."""
    bodies = dict.fromkeys("abc", BODY)
    contacts = {"wall": WALL, "ab": il.Contact("a", "b", il.HertzContact(1e4), clearance=0.05)}
    noises = {
        "a": il.WhiteNoise(0.2),
        "b": OU,
        "ground": il.BaseMotion(il.Modulated(KANAI, [-5.0, 0.4, 9.0], [0.5, 1.0, 0.2])),
        "two": il.Source(CLOUGH, on={"a": 0.3, "c": -0.2}),
        "c": il.ShinozukaNoise(0.1, band=(0.0, 8.0), components=60),
    }
    stiff = {"bc": il.Coupling("b", "c", il.LinearCoupling(4e3))}
    return il.Network(bodies, contacts, noises, stiff)


def numbers_of(realizations=3, **options):
    result = il.simulate(
        busy(), 0.8, realizations=realizations, rng=9, spin_up=0.35, record=il.Trajectory(0.1), **options
    )
    return np.concatenate([result[name].values for name in ("displacement", "velocity")], axis=2)


@pytest.mark.full
@few
@pytest.mark.parametrize("method", [il.ExactFlow(measured=False), il.RungeKutta4()], ids=class_name)
def test_numbers_do_not_depend_on_blocks_calls_or_lanes(method):
    options = {"integrator": method, "step": 2e-3}
    expected = numbers_of(**options)
    np.testing.assert_array_equal(numbers_of(1, **options), expected[:1])
    for setting in ({"single_lane_bodies": 1}, {"call_seconds": 1e-6}, {"lanes": 2}):
        with tuned(**setting):
            np.testing.assert_array_equal(numbers_of(**options), expected, err_msg=str(setting))


@pytest.mark.full
@few
def test_a_rerun_has_the_same_numbers(tmp_path):
    result = il.simulate(busy(), 0.4, realizations=2, rng=10, spin_up=0.1)
    il.save(result, tmp_path / "run.nc")
    again = il.rerun(tmp_path / "run.nc")
    for name in result:
        np.testing.assert_array_equal(again[name], result[name], err_msg=name)


def brought(noise, method, step, coarse=False, lanes=6):
    """Samples of a noise on one body that begin where its filter does."""
    noises = ColouredNoises.of(Model.of(on_ground(noise)), method, step, (1, 2), 1 + coarse)
    realizations = np.arange(lanes, dtype=np.uint32)
    coloured = noises.arrays(realizations)
    for start in noises.starts:
        coloured.kept[:, start.states] = start.draw(realizations, 0)[: noises.states]
    return coloured._replace(near=np.zeros((NEAR + 1, noises.rows, lanes)))


def test_samples_are_the_same_in_any_order():
    series, samples = brought(KANAI, il.EulerMaruyama(), 0.02), {}
    for first in (0, NEAR, 2 * NEAR, NEAR, 5 * NEAR, 2 * NEAR):
        bring_samples(series, first)
        if first in samples:
            np.testing.assert_array_equal(series.near, samples[first])
        samples[first] = series.near.copy()
    np.testing.assert_array_equal(samples[0][NEAR], samples[NEAR][0])


@pytest.mark.parametrize("method", [il.ExactFlow(), il.EulerMaruyama()], ids=class_name)
def test_a_coarse_step_has_the_noise_of_two(method):
    fine, coarse = brought(KANAI, method, 0.1), brought(KANAI, method, 0.2, coarse=True)
    for series in (fine, coarse):
        bring_samples(series, 0)
    np.testing.assert_allclose(coarse.near[: NEAR // 2 + 1], fine.near[::2], rtol=1e-12)


def test_the_force_has_the_correlations_of_its_filter():
    """Also over steps as long as its correlation time."""
    lanes, step = 20_000, 0.4
    series = brought(OU, il.EulerMaruyama(), step, lanes=lanes)
    bring_samples(series, 0)
    force = series.near[:, 0]
    for lag in (0, 1, 3):
        seen = np.mean(force[8] * force[8 + lag])
        assert seen == pytest.approx(
            OU.variance * np.exp(-lag * step / 0.5), abs=4.0 * OU.variance * np.sqrt(2.0 / lanes)
        )
    series = brought(KANAI, il.EulerMaruyama(), 0.1, lanes=lanes)
    bring_samples(series, NEAR)
    error = 95.81858 * np.sqrt(2.0 / lanes)
    for place in (0, NEAR):
        assert series.near[place, 0].var() == pytest.approx(95.81858, abs=4.0 * error)
