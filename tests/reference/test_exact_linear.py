"""Exact laws of linear motion: against Lyapunov equations by hand, closed forms, integrals and simulations."""

import itertools
import math

import numpy as np
import pytest
from scenes import base, deviations, linear
from scipy.integrate import quad
from scipy.special import ndtr
from trio import law_by_hand, spring, trio

import impactlab as il
from impactlab.reference.gaussian import GaussianLaw
from impactlab.reference.reference import exact

HOT = (1.0, 4.0, 0.0)
MOMENTS = ["mean_square_displacement", "variance_displacement", "mean_square_velocity"]


def variances(reference):
    data = reference.statistics()
    return np.concatenate([data.variance_displacement, data.mean_square_velocity])


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_trio_at_unequal_temperatures(damping):
    """A loop of three bodies, one of which has no noise, and dampers between them."""
    reference = exact(trio(damping, HOT))
    expected = law_by_hand(HOT, damping)
    np.testing.assert_allclose(variances(reference), np.diag(expected), rtol=1e-12)
    assert (reference.statistics().mean_displacement == 0.0).all()
    for names, rows, quantities in (
        ("ab", [0, 1], ("displacement", "displacement")),
        ("ab", [0, 4], ("displacement", "velocity")),
        ("ba", [4, 0], ("velocity", "displacement")),
        ("ab", [3, 4], ("velocity", "velocity")),
        ("bb", [1, 4], ("displacement", "velocity")),
    ):
        part = expected[np.ix_(rows, rows)]
        x = np.sqrt(np.diag(part)) * np.array([[0.3, -0.2], [1.0, 1.5]])
        density = np.exp(-0.5 * np.einsum("ni,ij,nj->n", x, np.linalg.inv(part), x))
        density /= 2.0 * np.pi * math.sqrt(np.linalg.det(part))
        np.testing.assert_allclose(reference.joint_density(*names, *x.T, quantities=quantities), density, rtol=1e-12)
    edges = np.array([-1.0, 0.2, 0.5])
    for quantity, row in (("displacement", 1), ("velocity", 4)):
        scale = math.sqrt(expected[row, row])
        bins = reference.bin_density("b", quantity, edges)
        np.testing.assert_allclose(bins * np.diff(edges), np.diff(ndtr(edges / scale)), rtol=1e-12)
        values = reference.density("b", quantity, [[0.3]])
        assert values == pytest.approx(np.exp(-0.5 * (0.3 / scale) ** 2) / math.sqrt(2.0 * math.pi) / scale, rel=1e-12)
    assert "several temperatures, Gaussian" in repr(reference)


def test_simulation_of_the_trio():
    network = trio(0.7, HOT)
    result = il.simulate(network, 400.0, realizations=64, rng=3)
    for name, found in deviations(result, exact(network).statistics(), MOMENTS).items():
        assert found < 3.5, (name, found)


def test_two_ways_to_the_thermal_law():
    """At one temperature the covariance is T K⁻¹ and T M⁻¹, which the Lyapunov equation gives as well.

    A spring that is 10⁸ times stiffer than another leaves 8 of 16 digits for that in K.
    """
    for stiff in (30.0, 1e4, 1e8):
        network = trio(hot=(2.0, 2.0, 2.0)).replace(couplings={"ab": spring("a", "b", stiff)})
        (law,) = exact(network).laws
        assert law.temperature == pytest.approx(2.0)
        other = GaussianLaw(law.bodies, law.system)
        square, expected = np.diag(other.covariance), np.diag(law.covariance)
        np.testing.assert_allclose(square[3:], expected[3:], rtol=1e-13)
        np.testing.assert_allclose(square[:3], expected[:3], rtol=1e-8)
    assert "temperature 2 J, Gaussian" in repr(exact(network))


def test_a_long_chain_of_springs_is_one_inverse():
    names = [f"b{k}" for k in range(300)]
    body = il.LinearOscillator(damping=0.3, stiffness=2.0)
    springs = {one: spring(one, other, 5.0) for one, other in itertools.pairwise(names)}
    network = il.Network(dict.fromkeys(names, body), {}, dict.fromkeys(names, il.WhiteNoise(0.3 / math.pi)), springs)
    q = 2.0 * math.pi * (np.arange(100_000) + 0.5) / 100_000  # of the infinite chain: ∫ dq/2π T/(k + 4 K sin²(q/2))
    middle = exact(network).statistics().variance_displacement[150]
    assert middle == pytest.approx(np.mean(1.0 / (2.0 + 20.0 * np.sin(0.5 * q) ** 2)), rel=1e-10)


@pytest.mark.parametrize("ratio", [0.05, 1.0, 3.0])
def test_autocovariance_of_one_body(ratio):
    """Closed form, also for critical damping."""
    frequency = 3.0
    reference = exact(linear(frequency, ratio))
    lags = np.array([[-2.0, 0.0], [0.3, 5.0]])
    square = math.pi / (2.0 * ratio * frequency**3)
    shape = np.emath.sqrt(1.0 - ratio**2) * frequency
    t = np.abs(lags)
    sine = t if shape == 0.0 else (np.sin(shape * t) / shape).real
    decay = np.exp(-ratio * frequency * t)
    expected = square * decay * (np.cos(shape * t).real + ratio * frequency * sine)
    of_velocity = square * frequency**2 * decay * (np.cos(shape * t).real - ratio * frequency * sine)
    np.testing.assert_allclose(reference.autocovariance("a", "displacement", lags), expected, atol=1e-13 * square)
    np.testing.assert_allclose(
        reference.autocovariance("a", "velocity", lags), of_velocity, atol=1e-12 * square * frequency**2
    )


def test_spectra_are_the_transforms_of_autocovariances():
    reference = exact(trio(0.7, HOT))
    for quantity in ("displacement", "velocity"):

        def spectrum(omega, quantity=quantity):
            return float(reference.spectrum("b", quantity, omega))

        for lag in (0.0, 0.4):
            ends = np.array([0.0, 3.0, 6.0, 9.0, 12.0, 20.0, 60.0, 400.0, 1e4])
            parts = [
                quad(spectrum, *pair, weight="cos", wvar=lag, epsabs=1e-13, limit=200)[0]
                for pair in itertools.pairwise(ends)
            ]
            found = reference.autocovariance("b", quantity, lag)
            assert 2.0 * sum(parts) == pytest.approx(float(found), rel=1e-4 if quantity == "velocity" else 1e-8)
    white = exact(linear(3.0, 0.1, density=2.0))
    assert white.spectrum("a", "displacement", 0.0) == pytest.approx(2.0 / 3.0**4, rel=1e-12)


def bounded(components=40, **changes):
    """A body under a few cosines and another, coupled to it, under white noise."""
    return il.Network(
        {"a": il.LinearOscillator(damping=0.8, stiffness=90.0), "b": il.LinearOscillator(damping=0.5, stiffness=30.0)},
        {},
        {"a": il.ShinozukaNoise(1.0, band=(0.2, 4.0), components=components), "b": il.WhiteNoise(0.02)},
        {"s": spring("a", "b", 20.0, 0.1)},
    ).replace(**changes)


def response(network, body):
    """Amplitudes of the cosines in both displacements, and their frequencies, by hand."""
    omega, amplitudes = network.excitations["a"].lines()
    dynamic = np.empty((len(omega), 2, 2), dtype=complex)
    dynamic[:, 0, 0] = 110.0 - omega**2 + 0.9j * omega
    dynamic[:, 1, 1] = 50.0 - omega**2 + 0.6j * omega
    dynamic[:, 0, 1] = dynamic[:, 1, 0] = -20.0 - 0.1j * omega
    return np.abs(np.linalg.inv(dynamic)[:, "ab".index(body), 0]) * amplitudes, omega


def test_bounded_noise_is_a_sum_over_its_lines():
    network = bounded()
    reference, alone = exact(network), exact(bounded(excitations={"a": None}))
    for row, body in enumerate("ab"):
        amplitudes, omega = response(network, body)
        found, white = (variances(item)[[row, row + 2]] for item in (reference, alone))
        expected = white + 0.5 * np.array([(amplitudes**2).sum(), ((omega * amplitudes) ** 2).sum()])
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        lags = np.array([0.0, 0.7, 3.0])
        expected = alone.autocovariance(body, "displacement", lags)
        expected += 0.5 * np.cos(np.outer(lags, omega)) @ amplitudes**2
        np.testing.assert_allclose(reference.autocovariance(body, "displacement", lags), expected, rtol=1e-12)
    assert "sums of cosines" in repr(reference)


@pytest.mark.campaign
def test_densities_under_cosines_are_not_gaussian():
    """Their fourth moment is 3 σ⁴ − 3/8 Σ a⁴; and bins against a million sums of cosines."""
    network = bounded(components=12)
    reference = exact(network)
    amplitudes, _ = response(network, "a")
    square = reference.statistics().variance_displacement.values[0]
    nodes, weights = np.polynomial.legendre.leggauss(400)
    x = 9.0 * math.sqrt(square) * nodes
    masses = 9.0 * math.sqrt(square) * weights * reference.density("a", "displacement", x)
    fourth = 3.0 * square**2 - 0.375 * (amplitudes**4).sum()
    assert fourth < 2.9 * square**2
    np.testing.assert_allclose([masses.sum(), masses @ x**2, masses @ x**4], [1.0, square, fourth], rtol=1e-10)
    rng, count = np.random.default_rng(1), 1_000_000
    white = square - 0.5 * (amplitudes**2).sum()
    draws = math.sqrt(white) * rng.standard_normal(count)
    for amplitude in amplitudes:
        draws += amplitude * np.cos(2.0 * np.pi * rng.random(count))
    edges = math.sqrt(square) * np.linspace(-3.0, 3.0, 13)
    expected = reference.bin_density("a", "displacement", edges) * np.diff(edges)
    counts = np.histogram(draws, edges)[0] / count
    assert (np.abs(counts - expected) < 4.0 * np.sqrt(expected / count)).all()
    # a Gaussian of the same variance would not do
    gauss = np.diff(ndtr(edges / math.sqrt(square)))
    assert (np.abs(counts - gauss) > 6.0 * np.sqrt(gauss / count)).any()


@pytest.mark.full
def test_simulation_under_bounded_noise():
    network = bounded(components=800)
    record = il.Density(oscillators=["a"], bins=12)
    result = il.simulate(network, 100.0, realizations=512, rng=4, record=[record])
    reference = exact(network)
    for name, found in deviations(result, reference.statistics(), MOMENTS).items():
        assert found < 3.5, (name, found)
    edges = result.displacement_edges.values[0]
    expected = reference.bin_density("a", "displacement", edges)
    likely = expected > 0.01 * expected.max()
    found, error = result.density_displacement.values[0], result.density_displacement_standard_error.values[0]
    assert (np.abs(found - expected)[likely] < 4.0 * error[likely]).all()


def test_the_band_limited_reference_of_the_paper():
    """Fifty thousand lines: close to white noise of the same density, but below it for the velocity."""
    noise = il.ShinozukaNoise(1.0)
    found = exact(linear(2.0 * math.pi * 16.0).replace(excitations={"a": noise})).statistics()
    white = exact(linear(2.0 * math.pi * 16.0)).statistics()
    assert found.mean_square_displacement.item() == pytest.approx(white.mean_square_displacement.item(), rel=1e-3)
    ratio = found.mean_square_velocity.item() / white.mean_square_velocity.item()
    assert 0.995 < ratio < 0.997  # 4 ζ ω/π over 2π 500, to first order


def test_contacts_that_cannot_matter():
    """From a clearance on at which the bound of contacts is 10⁻¹² the law is that without them."""
    network = base(ratio=4.0)  # unequal temperatures
    with pytest.raises(il.NoExactReference, match=r"so wide that they never close: [0-9.]+ m for 'gap'\.") as caught:
        exact(network)
    enough = float(str(caught.value).split("never close: ")[1].split(" m")[0])
    far = base(ratio=4.0, clearance=1.01 * enough)
    reference = exact(far)
    apart = exact(far.replace(contacts={"gap": None}))
    np.testing.assert_array_equal(variances(reference), variances(apart))
    assert "left out, because it closes with a probability below 1e-12: contact 'gap'" in repr(reference)
    data = reference.statistics()
    assert "contact 'gap'" in data.attrs["laws"]
    assert data.contact_ratio == data.contact_rate == data.mean_contact_force == 0.0
    assert reference.autocovariance("one", "displacement", 0.0) == pytest.approx(data.variance_displacement.values[0])
    sigma = math.sqrt(data.variance_displacement.sum().item())
    assert ndtr(-1.01 * enough / sigma) < 1e-12
    with pytest.raises(il.NoExactReference, match="never close"):
        exact(base(ratio=4.0, clearance=0.99 * enough))
    with pytest.raises(il.NoExactReference, match="the law of its closing is not known"):
        reference.onset_velocity_density("gap", 0.1)


def test_contacts_of_coupled_bodies_under_cosines_that_cannot_matter():
    """What counts is the spread of the difference, which a stiff spring makes small; walls see the bodies."""
    network = bounded(couplings={"s": spring("a", "b", 5000.0, 0.1)})
    square = variances(exact(network))[:2]
    wide = 1.01 * math.sqrt(2.0 * square[1] * math.log(1e12 * 20.0))
    near = {"gap": il.Contact("b", "a", il.LinearContact(1e3), clearance=0.2 * wide)}
    far = {"stop": il.Contact(il.WALL, "b", il.HertzContact(1e3), clearance=wide)}
    reference = exact(network.replace(contacts=near | far))
    np.testing.assert_array_equal(variances(reference)[:2], square)
    assert "contact 'gap' and 'stop'" in repr(reference)
    with pytest.raises(il.NoExactReference, match=r"never close: [0-9.]+ m for 'stop'\.") as caught:
        exact(network.replace(contacts=near | {"stop": far["stop"].replace(clearance=0.2 * wide)}))
    assert "'a' is excited by ShinozukaNoise" in str(caught.value)


def test_correlations_where_the_law_is_known_but_the_motion_is_not_linear():
    reference = exact(base())
    with pytest.raises(il.NoExactReference, match="'one' is not linear, because of 'gap'"):
        reference.spectrum("one", "displacement", 1.0)
    wide = exact(base(clearance=20.0))  # the law of the pair, in which the contact matters as little
    closed = exact(linear()).autocovariance("a", "displacement", [0.0, 0.3])
    np.testing.assert_allclose(wide.autocovariance("two", "displacement", [0.0, 0.3]), closed, rtol=1e-12)
    with pytest.raises(il.InvalidInput, match="lags must hold finite"):
        wide.autocovariance("two", "displacement", np.nan)
    with pytest.raises(il.InvalidInput, match="no body 'three'"):
        wide.spectrum("three", "displacement", 1.0)


def test_refusals():
    def refused(network):
        with pytest.raises(il.NoExactReference) as caught:
            exact(network)
        return str(caught.value)

    free = trio(0.7, HOT, couplings={"wall": None}).replace(
        oscillators={name: il.LinearOscillator(damping=1.0) for name in "abc"}
    )
    assert "'a' and 'b' and 'c': the law cannot be normalised, because no spring confines their center" in refused(free)
    sliding = il.Network(
        {"a": il.LinearOscillator(stiffness=3.0), "b": il.LinearOscillator(stiffness=3.0)},
        {},
        {"a": il.WhiteNoise(1.0)},
        {"s": spring("a", "b", 1.0, damping=2.0)},  # which does not damp them moving together
    )
    assert "'a' and 'b': noise without damping" in refused(sliding)
    silent = bounded(excitations={"a": il.ShinozukaNoise(0.0, components=5), "b": None})
    assert "'a' and 'b': damping without noise, everything comes to rest" in refused(silent)
    few = exact(linear().replace(excitations={"a": il.ShinozukaNoise(1.0, components=2)}))
    with pytest.raises(il.NoExactReference, match="few cosines dominate its displacement"):
        few.density("a", "displacement", 0.0)
    many = exact(bounded())
    with pytest.raises(il.NoExactReference, match="joint density of 'a' and 'b'"):
        many.joint_density("a", "b", 0.0, 0.0)
    with pytest.raises(il.NoExactReference, match="line spectra"):
        many.spectrum("a", "displacement", 1.0)
    with pytest.raises(il.NoExactReference, match="crosses levels is not known"):
        many.crossing_rate("a", "displacement", 0.1)
