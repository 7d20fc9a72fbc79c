"""Impulses at random times: Campbell's theorem, paths, exact laws, and bits."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.stats import poisson

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.kernels.series import NEAR
from impactlab.mechanisms.impulses.moments_of_impulses import Shots, bring_responses, fill_moments
from impactlab.mechanisms.impulses.process_of_impulses import Impulses
from impactlab.mechanisms.sampled_responses import Sparse

pytestmark = pytest.mark.filterwarnings("ignore:Too few independent samples")

BODY = il.LinearOscillator(mass=2.0, damping=0.8, stiffness=18.0)
RATE, MEAN, DEVIATION = 0.7, 0.5, 0.3
HAIL = il.PoissonImpulses(RATE, mean=MEAN, standard_deviation=DEVIATION)
WALL = {"wall": il.Contact("a", il.WALL, il.HertzContact(100.0), clearance=0.05)}
ENVELOPE = [0.0, 2.0, 8.0, 20.0], [0.0, 1.5, -0.5, 1.0]
FADING = il.ModulatedImpulses(RATE, *ENVELOPE, mean=MEAN, standard_deviation=DEVIATION)
REST = {"initial": "rest", "spin_up": 0.0}


def alone(body=BODY, contacts=None, noise=HAIL):
    return il.Network({"a": body}, contacts, {"a": noise})


def response(t, decay=0.2):
    """Displacement of the body after a unit impulse, with a damping of 4 kg times the rate of decay."""
    turning = np.sqrt(9.0 - decay**2)
    return np.exp(-decay * t) * np.sin(turning * t) / (2.0 * turning)


def cumulant(order, decay=0.2):
    """Return a cumulant by Campbell's theorem."""
    moments = {1: MEAN, 2: MEAN**2 + DEVIATION**2, 3: MEAN**3 + 3.0 * MEAN * DEVIATION**2}
    return RATE * moments[order] * quad(lambda t: response(t, decay) ** order, 0.0, 60.0, limit=500, epsabs=1e-13)[0]


def test_the_exact_law_is_that_of_campbells_theorem():
    law = il.exact(alone())
    assert law.statistics().mean_displacement.item() == pytest.approx(cumulant(1), rel=1e-4)  # of exp(-12)
    assert law.statistics().variance_displacement.item() == pytest.approx(cumulant(2), rel=1e-8)
    later = quad(lambda t: response(t) * response(t + 0.4), 0.0, 60.0, limit=500)[0]
    found = law.autocovariance("a", "displacement", [0.0, 0.4, -0.4])
    assert found == pytest.approx([cumulant(2), *[RATE * (MEAN**2 + DEVIATION**2) * later] * 2], rel=1e-8)
    power = quad(lambda w: law.spectrum("a", "displacement", [w])[0], 0.0, 300.0, limit=500, points=[2.9, 3.0, 3.1])[0]
    assert 2.0 * power == pytest.approx(cumulant(2), rel=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("options", [{}, {"step": 1.3}], ids=["default", "a good half of the period"])
def test_statistics_of_two_bodies_under_a_motion_of_the_ground_and_white_noise(options):
    other = il.LinearOscillator(mass=1.0, damping=0.3, stiffness=4.0)
    excitations = {"ground": il.BaseMotion(HAIL), "b": il.WhiteNoise(0.05)}
    couplings = {"spring": il.Coupling("a", "b", il.LinearCoupling(5.0))}
    network = il.Network({"a": BODY, "b": other}, None, excitations, couplings)
    result = il.simulate(network, 100.0, realizations=256, rng=1, **options)
    compared = il.compare(result, il.exact(network))
    assert np.abs(compared.z).max() < 4.0
    mean = compared.sel(comparison=(compared.statistic == "mean_displacement").values)
    assert (np.abs(mean.reference) > 20.0 * mean.standard_error).all()


@pytest.mark.full
def test_skewness():
    """At moments that are far apart; the standard errors are those of independent samples."""
    heavily = alone(il.LinearOscillator(mass=2.0, damping=6.0, stiffness=18.0))
    result = il.simulate(heavily, 100.0, realizations=400, rng=2, record=il.Trajectory(interval=5.0))
    off = result.displacement.values.ravel() - cumulant(1, 1.5)
    for power, expected in ((1, 0.0), (2, cumulant(2, 1.5)), (3, cumulant(3, 1.5))):
        values = off**power
        assert abs(values.mean() - expected) < 4.0 * values.std() / np.sqrt(values.size), power
    assert cumulant(3, 1.5) > 10.0 * (off**3).std() / np.sqrt(off.size)  # a normal law would be told


@pytest.mark.full
def test_an_envelope_changes_cumulants_as_campbells_theorem_says():
    """Beside a wall that is never reached, at steps that are not small, in standard errors."""
    far = {"wall": il.Contact("a", il.WALL, il.LinearContact(1.0), clearance=50.0)}
    network = alone(contacts=far, noise=il.ModulatedImpulses(9.0, *ENVELOPE, mean=MEAN, standard_deviation=DEVIATION))
    result = il.simulate(network, 20.0, realizations=2000, rng=4, step=0.25, record=il.Trajectory(5.0), **REST)
    law = il.exact_covariance(network.replace(contacts={"wall": None}), [5.0, 10.0, 20.0])
    for number, time in enumerate((5.0, 10.0, 20.0)):
        moved = {
            order: quad(
                lambda s, order=order, time=time: (np.interp(s, *ENVELOPE) * response(time - s)) ** order,
                0.0, time, points=[2.0, min(8.0, time)], limit=500, epsabs=1e-14,
            )[0]
            for order in (1, 2)
        }  # fmt: skip
        mean, variance = 9.0 * MEAN * moved[1], 9.0 * (MEAN**2 + DEVIATION**2) * moved[2]
        assert law.variance_displacement.values[number, 0] == pytest.approx(variance, rel=1e-9)
        x = result.displacement.sel(time=time).values[:, 0]
        for values, expected in ((x, mean), ((x - mean) ** 2, variance)):
            assert abs(values.mean() - expected) < 4.0 * values.std(ddof=1) / np.sqrt(len(values))


@pytest.mark.full
def test_impulses_and_noises_with_and_without_envelopes_on_two_bodies():
    """Each has its own envelope: covariances over time, in standard errors."""
    soil = il.OrnsteinUhlenbeckNoise(0.2, correlation_time=0.3, at_rest=True)
    excitations = {
        "hail": il.Source(HAIL.replace(mean=0.0), on={"a": 1.0, "b": -0.5}),
        "a": il.ModulatedImpulses(2.0, [0.0, 10.0], [0.0, 2.0], mean=0.0, standard_deviation=0.7),
        "b": il.Modulated(soil, [0.0, 4.0, 10.0], [2.0, 0.0, 0.0]),
        "ground": il.BaseMotion(il.Modulated(soil, [0.0, 10.0], [0.0, 0.5])),
        "rain": il.Source(il.ModulatedImpulses(5.0, [0.0, 3.0], [1.0, 0.0], mean=0.0, standard_deviation=0.4), on="b"),
    }
    bodies = {"a": BODY, "b": il.LinearOscillator(mass=1.0, damping=0.3, stiffness=4.0)}
    network = il.Network(bodies, None, excitations, {"spring": il.Coupling("a", "b", il.LinearCoupling(5.0))})
    result = il.simulate(network, 10.0, realizations=2000, rng=6, step=0.25, record=il.Trajectory(2.5), **REST)
    law = il.exact_covariance(network, [2.5, 5.0, 10.0])
    for time in (2.5, 5.0, 10.0):
        at = result.displacement.sel(time=time)
        for first, second in (("a", "a"), ("a", "b"), ("b", "b")):
            products = (at.sel(oscillator=first) * at.sel(oscillator=second)).values
            expected = law.covariance_displacement.sel(time=time, oscillator=first, other_oscillator=second).item()
            assert abs(products.mean() - expected) < 4.0 * products.std(ddof=1) / np.sqrt(len(products))


def impulses_of(step, duration):
    """Return times and sizes of the impulses of a realization, by what they do to a free body of the same name."""
    free = il.simulate(
        alone(il.LinearOscillator(mass=2.0)), duration, realizations=2, rng=3, step=step,
        record=il.Trajectory(interval=step), **REST,
    ).isel(realization=1, oscillator=0)  # fmt: skip
    x, v, t = free.displacement.values, free.velocity.values, free.time.values
    steps = np.flatnonzero(np.abs(np.diff(v)) > 1e-9)
    change = np.diff(v)[steps]
    return t[steps] + step - (x[steps + 1] - x[steps] - v[steps] * step) / change, 2.0 * change


def error_of_path(step, contacts, duration=20.0, noise=HAIL):
    """Return the largest difference of a path from that of solve_ivp under the same impulses (m)."""
    found = il.simulate(
        alone(contacts=contacts, noise=noise), duration, realizations=2, rng=3, step=step,
        record=il.Trajectory(interval=0.16), **REST,
    ).isel(realization=1, oscillator=0)  # fmt: skip
    at, expected, begin, state = found.time.values, [], 0.0, np.zeros(2)
    pushed = 100.0 if contacts else 0.0

    def slope(_, y):
        return y[1], (-18.0 * y[0] - 0.8 * y[1] - pushed * max(y[0] - 0.05, 0.0) ** 1.5) / 2.0

    times, sizes = impulses_of(step, duration)
    assert len(times) > 5
    if noise is FADING:
        sizes = sizes * np.interp(times, *ENVELOPE)
    for end, size in zip([*times, duration + 1e-9], [*sizes, 0.0], strict=True):
        path = solve_ivp(slope, (begin, end), state, rtol=1e-11, atol=1e-13, dense_output=True)
        expected += [path.sol(t)[0] for t in at if begin <= t < end]
        begin, state = end, path.y[:, -1] + [0.0, size / 2.0]
    return np.abs(found.displacement.values - expected).max()


@pytest.mark.full
def test_a_linear_path_is_exact():
    assert error_of_path(0.02, None) < 1e-9
    assert error_of_path(0.02, None, noise=FADING) < 1e-9


@pytest.mark.full
def test_paths_with_contacts_converge():
    errors = [error_of_path(step, WALL) for step in (0.02, 0.005)]
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 8.0


@pytest.mark.full
def test_a_realization_has_the_same_impulses_alone_and_among_others():
    options = {"step": 0.05, "rng": 5, "record": il.FinalState(), **REST}
    network = il.Network({"a": BODY}, WALL, {"hail": il.Source(HAIL, on={"a": 1.0})})
    many = il.simulate(network, 20.0, realizations=200, **options)
    one = il.simulate(network, 20.0, realizations=1, **options)
    few = il.simulate(network, 20.0, realizations=7, **options)
    for name in ("final_displacement", "final_velocity"):
        np.testing.assert_array_equal(few[name], many[name][:7])
        np.testing.assert_allclose(one[name], many[name][:1], rtol=1e-12)
    assert len(np.unique(many.final_displacement)) == 200
    other = il.simulate(network.replace(excitations={"rain": network.excitations["hail"]}), 20.0, **options)
    assert other.final_displacement.item() != one.final_displacement.item()


def test_a_coarse_step_has_the_impulses_of_two():
    series = []
    for step, coarse in ((0.1, False), (0.2, True)):
        noises = Impulses().process(Model.of(alone()), il.ExactFlow(), step, (1, 2), 1 + coarse)
        arrays = noises.arrays(np.arange(6, dtype=np.uint32))
        series.append(arrays._replace(near=np.zeros((NEAR + 1, noises.rows, 6))))
        bring_responses(series[-1], 0)
    np.testing.assert_allclose(series[1].near[: NEAR // 2 + 1], series[0].near[::2], rtol=1e-10, atol=1e-13)
    assert series[0].near.any(axis=(0, 1)).sum() > 2


@pytest.mark.parametrize("expected", [1e-4, 0.3, 20.0])
def test_the_numbers_of_impulses_have_poissons_law(expected):
    """Each impulse has the size 1, and the first moment is the sum of the sizes."""
    lanes = 400_000
    none = Sparse(np.zeros(1, np.int64), np.zeros(0, np.int64), np.zeros(0))
    streams = np.arange(6, dtype=np.uint64).reshape(3, 2)
    pairs, numbers = np.zeros((0, 3), np.int64), np.array([[expected], [1.0], [0.0]])
    shots = Shots(none, none, pairs, np.array([0, 3]), numbers, streams, 1)
    moments = np.empty((3, lanes))
    fill_moments(shots, np.arange(lanes, dtype=np.uint32), 7, moments)
    numbers = moments[0]
    for number in {*range(4), round(expected)}:
        share = poisson.pmf(number, expected)
        assert abs((numbers == number).mean() - share) < 4.0 * np.sqrt(share / lanes) + 1e-9, number
    once = numbers == 1.0  # times are uniform
    assert abs(moments[1, once].sum()) <= 4.0 * np.sqrt(once.sum() / 3.0)
    np.testing.assert_allclose(moments[2, once], 2.0 * moments[1, once] ** 2 - 1.0, atol=1e-12)


def test_densities_are_refused():
    law = il.exact(alone())
    assert FADING.acts_between == (0.0, 20.0)
    assert FADING.largest_modulation == 1.5
    for refused in (
        lambda: il.exact(alone(noise=FADING)),
        lambda: law.density("a", "displacement", [0.0]),
        lambda: law.crossing_rate("a", "displacement", 0.1),
        lambda: il.exact(alone(contacts=WALL)),
    ):
        with pytest.raises(il.NoExactReference, match=r"impulses|Impulses"):
            refused()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda: il.PoissonImpulses(0.0, mean=1.0), "rate must be larger than 0 s-1, not 0.0"),
        (lambda: il.PoissonImpulses(1.0, mean=1.0, standard_deviation=-1.0), "must be at least 0 N s, not -1.0"),
        (lambda: il.ModulatedImpulses(1.0, [0.0, 1.0], [1.0], mean=1.0), "takes a value for each time, not 1 for 2"),
        (lambda: il.simulate(alone(noise=il.PoissonImpulses(1e5, mean=1e-3)), 1.0, step=0.1), "in a step of 0.1 s"),
        (lambda: il.simulate(alone(), 1.0, integrator=il.EulerMaruyama()), "does not handle the excitation of 'a'"),
    ],
)
def test_what_is_refused(given, message):
    with pytest.raises(il.InvalidInput, match=message):
        given()
