"""Exact laws under noises that drive several bodies."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import solve_continuous_lyapunov
from scipy.stats import multivariate_normal

import impactlab as il

A = il.LinearOscillator(mass=1.0, damping=0.4, stiffness=9.0)
B = il.LinearOscillator(mass=2.0, damping=1.2, stiffness=20.0)
NOISE = il.WhiteNoise(0.6)
GROUND = il.Source(NOISE, on={"a": 1.0, "b": -2.0})
GAP = il.Contact("a", "b", il.HertzContact(1e4), clearance=0.2)
SERIES = il.ShinozukaNoise(1.0, band=(0.0, 2.0), components=400)


def pair(contacts=None, excitations=None, couplings=None):
    return il.Network({"a": A, "b": B}, contacts, excitations or {"ground": GROUND}, couplings)


def law(own=0.0):
    mass, damping, stiffness = np.array([1.0, 2.0]), np.diag([0.4, 1.2]), np.diag([9.0, 20.0])
    drift = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    growth = np.zeros((4, 4))
    growth[2:, 2:] = 2.0 * np.pi * np.array([[0.6 + own, -1.2], [-1.2, 2.4]]) / np.outer(mass, mass)
    return solve_continuous_lyapunov(drift, -growth)


@pytest.mark.parametrize("own", [0.0, 0.3])
def test_second_moments(own):
    """The Lyapunov equation with the spectral densities between the forces."""
    network = pair(excitations={"ground": GROUND} | ({"a": il.WhiteNoise(own)} if own else {}))
    reference, expected = il.exact(network), law(own)
    for shift, quantity in ((0, "displacement"), (2, "velocity")):
        found = [[reference.covariance(i, j, quantity) for j in "ab"] for i in "ab"]
        np.testing.assert_allclose(found, expected[shift : shift + 2, shift : shift + 2], rtol=1e-10)
    np.testing.assert_allclose(reference.statistics().mean_square_velocity, np.diag(expected)[2:], rtol=1e-10)
    place = np.array([0.3, -0.4])
    density = multivariate_normal(np.zeros(2), expected[:2, :2]).pdf(place)
    assert reference.joint_density("a", "b", *place) == pytest.approx(density, rel=1e-10)
    assert "correlated noises, Gaussian" in repr(reference)


def test_spectrum_of_coupled_bodies_under_one_noise():
    """Its integral is the mean square, to which the density between both forces belongs."""
    spring = {"s": il.Coupling("a", "b", il.LinearCoupling(5.0, damping=0.2))}
    reference = il.exact(pair(couplings=spring))
    for body in "ab":
        total, _ = quad(
            lambda w, body=body: reference.spectrum(body, "displacement", w), 0.0, 200.0, limit=400, points=[3, 5]
        )
        assert 2.0 * total == pytest.approx(reference.covariance(body, body, "displacement"), rel=1e-6)
        lag = reference.autocovariance(body, "velocity", [0.0])
        assert lag[0] == pytest.approx(reference.covariance(body, body, "velocity"), rel=1e-10)


def test_cosines_on_two_bodies():
    """Variances and covariances are sums over lines, with the weights of both."""
    reference = il.exact(pair(excitations={"sea": il.Source(SERIES, on={"b": -2.0, "a": 3.0})}))
    frequency, amplitude = SERIES.lines()
    of_a = 3.0 / (9.0 - frequency**2 + 0.4j * frequency)
    of_b = -2.0 / (20.0 - 2.0 * frequency**2 + 1.2j * frequency)
    expected = (0.5 * amplitude**2 * of_a * of_b.conj()).real.sum()
    assert reference.covariance("a", "b", "displacement") == pytest.approx(expected, rel=1e-10)
    assert reference.covariance("b", "b", "velocity") == pytest.approx(
        (0.5 * np.abs(amplitude * frequency * of_b) ** 2).sum(), rel=1e-10
    )


@pytest.mark.full
def test_several_noises_on_one_body_are_one():
    """Their densities add up: two sources on one body, and a noise of its own."""
    excitations = {"a": NOISE, "wind": il.Source(NOISE, on={"a": 2.0}), "b": il.WhiteNoise(9.0)}
    wall = {"stop": il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.2), "gap": GAP}
    several, one = (pair(wall, item) for item in (excitations, {"a": il.WhiteNoise(5 * 0.6), "b": il.WhiteNoise(9.0)}))
    np.testing.assert_allclose(il.exact(several).statistics().contact_rate, il.exact(one).statistics().contact_rate)


def test_contacts_far_away_are_left_out():
    reference = il.exact(pair({"gap": GAP.replace(clearance=60.0)}))
    assert reference.untouched == {"gap"}
    assert reference.covariance("a", "b", "displacement") == pytest.approx(law()[0, 1], rel=1e-10)


@pytest.mark.parametrize(
    ("network", "message"),
    [
        (pair({"gap": GAP}), r"one noise, 'ground', drives 'a' and 'b': their motions are correlated"),
        (pair({"gap": GAP}, {"g": il.Source(SERIES, on="b"), "a": NOISE}), r"'b' is excited by ShinozukaNoise"),
        (
            pair(None, {"g": il.Source(il.Pulse(1.0, duration=1.0), on="b"), "a": NOISE}),
            r"'b' is excited by Pulse, which depends on time",
        ),
    ],
)
def test_no_law(network, message):
    with pytest.raises(il.NoExactReference, match=message):
        il.exact(network)


def test_the_fokker_planck_equation_takes_no_sources():
    with pytest.raises(
        il.NoExactReference, match=r"it has the source 'ground'; each body's own noise alone is allowed"
    ):
        il.fokker_planck(pair({"gap": GAP}, {"a": NOISE, "b": NOISE, "ground": GROUND}))
