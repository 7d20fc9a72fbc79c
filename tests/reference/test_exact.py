"""Exact laws against quadrature, closed forms, symmetries and each other."""

import itertools
import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from impactlab_numerics.laws.contacts import ConicalContact, ExponentialWall
from impactlab_numerics.laws.excitations import FadingNoise
from laws import Cosine, DoubleWell, SofteningContact
from scipy.integrate import quad
from scipy.special import erfc, erfcx, gamma

import impactlab as il
from impactlab.components.sides import WALL
from impactlab.reference.reference import exact
from impactlab.results.schema import stationary


class ForceOnlyContact(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return indentation


class DashpotContact(il.ContactLaw):
    @staticmethod
    def force(indentation, rate):
        return indentation + rate

    @staticmethod
    def potential(indentation):
        return 0.5 * indentation**2


class JaggedContact(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return indentation + 1e9 * math.cos(1e9 * indentation)

    @staticmethod
    def potential(indentation):
        return 0.5 * indentation**2 + math.sin(1e9 * indentation)


class UndefinedContact(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return indentation

    @staticmethod
    def potential(indentation):
        return math.nan if indentation > 0.5 else 0.5 * indentation**2


class QuadraticDrag(il.Oscillator):
    @staticmethod
    def residual(displacement, velocity):
        return displacement + abs(velocity) * velocity

    @staticmethod
    def residual_potential(displacement):
        return 0.5 * displacement**2


class ResidualOnly(il.Oscillator):
    @staticmethod
    def residual(displacement):
        return displacement**3


class ConstantNoise(il.Excitation):
    level: float = il.parameter(units="N2 s rad-1")

    @staticmethod
    def intensity(level):
        return level


def heat(oscillator, temperature):
    """White noise that gives a body this temperature."""
    return il.WhiteNoise(temperature * oscillator.damping / math.pi)


def pair(first, second, contacts, temperature):
    oscillators = {"first": first, "second": second}
    noises = {name: heat(item, temperature) for name, item in oscillators.items() if item.damping}
    return il.Network(oscillators, contacts, noises)


def single(oscillator, contacts, temperature):
    return il.Network({"body": oscillator}, contacts, {"body": heat(oscillator, temperature)})


def base_case(clearance, law=None, swapped=False):
    one = il.LinearOscillator.from_frequency(32.0 * np.pi, 0.1)
    two = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)
    oscillators = {"two": two, "one": one} if swapped else {"one": one, "two": two}
    contact = il.Contact("one", "two", law or il.HertzContact(1e4), clearance=clearance)
    return il.Network(oscillators, {"gap": contact}, {"one": il.WhiteNoise(16.0), "two": il.WhiteNoise(1.0)})


def numbers(network, *names):
    dataset = exact(network).statistics()
    return [dataset[name].values for name in names]


SPRING = il.LinearOscillator(mass=2.0, damping=0.3, stiffness=5.0)
SOFT = il.LinearOscillator(mass=0.5, damping=0.1, stiffness=0.7)

# 30-digit quadrature of the Gibbs density of the base case, independent of impactlab
BASE_CASE = [
    (
        0.01,
        [-0.0006470826616058362, 0.1656531613710941],
        [0.0002472251228633693, 0.05408200897619028],
        (0.1230593596364295, 2.397730173547226, 6.539724682090063),
    ),
    (
        0.05,
        [-0.000559609561235734, 0.1432600476763479],
        [0.0002471576232502521, 0.04965835433094139],
        (0.1076930779498561, 2.134358882452504, 5.655679988187019),
    ),
    (
        0.1,
        [-0.0004592400684179492, 0.117565457514995],
        [0.0002471062243975478, 0.0462898791201121],
        (0.08969591347682993, 1.815539263734751, 4.641298227624315),
    ),
]


@pytest.mark.parametrize(("clearance", "mean", "mean_square", "contact"), BASE_CASE)
@pytest.mark.parametrize("swapped", [False, True])
def test_base_case(clearance, mean, mean_square, contact, swapped):
    network = base_case(clearance, swapped=swapped)
    data = exact(network).statistics().sel(oscillator=["one", "two"])
    np.testing.assert_allclose(data.mean_displacement, mean, rtol=1e-12)
    np.testing.assert_allclose(data.mean_square_displacement, mean_square, rtol=1e-12)
    np.testing.assert_allclose(data.variance_displacement, np.subtract(mean_square, np.square(mean)), rtol=1e-12)
    np.testing.assert_allclose(data.mean_square_velocity, 2.5, rtol=1e-14)
    assert (data.mean_velocity == 0.0).all()
    found = [float(data[name].item()) for name in ("contact_ratio", "contact_rate", "mean_contact_force")]
    np.testing.assert_allclose(found, contact, rtol=1e-12)


def test_statistics_are_those_of_the_contract():
    data = exact(base_case(0.05)).statistics()
    assert set(data.data_vars) == {statistic.name for statistic in stationary()}
    assert data.contact_ratio.attrs["units"] == "1"
    assert il.network_of(data) == base_case(0.05)


def linear_contact_pair(stiffness, clearance, temperature):
    """Ratio, mean force and mean gap of two springs and a one-sided one: truncated Gaussians."""
    k = SPRING.stiffness * SOFT.stiffness / (SPRING.stiffness + SOFT.stiffness)
    total = k + stiffness
    offset = k * clearance / total  # of the corner from the center of the Gaussian on the closed side
    energy = 0.5 * k * clearance**2 / temperature
    z = offset * math.sqrt(total / (2.0 * temperature))
    root = math.sqrt(math.pi * temperature / 2.0)
    closed = root / math.sqrt(total) * erfcx(z) * math.exp(-energy)
    opened = root / math.sqrt(k) * erfc(-clearance * math.sqrt(k / (2.0 * temperature)))
    indentation = temperature / total * math.exp(-energy) - offset * closed
    return closed / (closed + opened), stiffness * indentation / (closed + opened)


@pytest.mark.parametrize("stiffness", [0.0, 1e-6, 0.3, 1e4, 1e12])
@pytest.mark.parametrize("temperature", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("clearance", [-20.0, -3.0, 0.0, 2.0, 10.0])
def test_linear_contact_closed_form(stiffness, temperature, clearance):
    """Clearance in standard deviations; tiny ratios and forces are right relative to themselves."""
    clearance *= math.sqrt(temperature / SPRING.stiffness + temperature / SOFT.stiffness)
    contact = il.Contact("first", "second", il.LinearContact(stiffness), clearance=clearance)
    network = pair(SPRING, SOFT, {"gap": contact}, temperature)
    ratio, force = numbers(network, "contact_ratio", "mean_contact_force")
    expected = linear_contact_pair(stiffness, clearance, temperature)
    np.testing.assert_allclose(force[0], expected[1], rtol=1e-12)
    np.testing.assert_allclose(ratio[0], expected[0], rtol=1e-12)


@pytest.mark.parametrize("clearance", [2.0, 10.0])
@pytest.mark.parametrize("stiffness", [1e8, 1e12])
def test_rare_stiff_hertz_contact(stiffness, clearance):
    """Clearance c in standard deviations: the prior as a power series over the short penetration.

    With δ = depth u it is ``exp(−c²/2 − s u − κ u²/2)``, and the integrals of
    ``uⁿ exp(−u^(5/2))`` are gamma functions.
    """
    k = SPRING.stiffness * SOFT.stiffness / (SPRING.stiffness + SOFT.stiffness)
    contact = il.Contact("first", "second", il.HertzContact(stiffness), clearance=clearance / math.sqrt(k))
    ratio, force = numbers(pair(SPRING, SOFT, {"gap": contact}, 1.0), "contact_ratio", "mean_contact_force")
    depth = (0.4 * stiffness) ** -0.4
    s, kappa = clearance * math.sqrt(k) * depth, k * depth**2
    series = [1.0, -s]
    for n in range(1, 8):
        series.append(-(s * series[n] + kappa * series[n - 1]) / (n + 1))

    def closed(order):
        powers = (term * 0.4 * gamma(0.4 * (n + order + 1.0)) for n, term in enumerate(series))
        return math.exp(-0.5 * clearance**2) * depth ** (order + 1.0) * sum(powers)

    total = math.sqrt(0.5 * math.pi / k) * erfc(-clearance / math.sqrt(2.0)) + closed(0.0)
    assert ratio[0] == pytest.approx(closed(0.0) / total, rel=1e-12)
    assert force[0] == pytest.approx(stiffness * closed(1.5) / total, rel=1e-12)


def test_open_preloaded_contact_has_the_right_tiny_rate():
    """At 20 standard deviations of preload the rate is the prior's at the corner over its sum."""
    deviation = math.sqrt(1.0 / SPRING.stiffness + 1.0 / SOFT.stiffness)
    contact = il.Contact("first", "second", il.LinearContact(1e-9), clearance=-20.0 * deviation)
    (rate,) = numbers(pair(SPRING, SOFT, {"gap": contact}, 1.0), "contact_rate")
    speed = math.sqrt((1.0 / SPRING.mass + 1.0 / SOFT.mass) / (2.0 * math.pi))
    expected = speed * math.exp(-200.0) / math.sqrt(2.0 * math.pi) / deviation
    assert rate[0] == pytest.approx(expected, rel=1e-5)  # the force adds 1e-9 × 20² σ² to Φ


@pytest.mark.parametrize("side", [+1, -1])
@pytest.mark.parametrize("oscillator", [SPRING, il.LinearOscillator(mass=3.0, damping=0.2)])
def test_walls_against_quad(oscillator, side):
    """A body between walls with two laws, also without a spring."""
    law, other = il.HertzContact(1e3), ConicalContact(50.0)
    left, right = ((WALL, "body"), ("body", WALL))[::side]
    contacts = {
        "near": il.Contact(*right, law, clearance=0.3),
        "far": il.Contact(*left, other, clearance=0.7),
    }
    data = exact(single(oscillator, contacts, 1.5)).statistics()

    def density(x):
        near, far = max(side * x - 0.3, 0.0), max(-side * x - 0.7, 0.0)
        energy = 0.5 * oscillator.stiffness * x**2 + 400.0 * near**2.5 + 50.0 * far**3 / 3.0
        return math.exp(-energy / 1.5)

    def integral(function, low=-4.0, high=4.0):
        corners = np.unique([low, *(c for c in (-0.7, -0.3, 0.3, 0.7) if low < c < high), high])
        parts = itertools.pairwise(corners)
        return sum(quad(lambda x: function(x) * density(x), *ends, epsabs=1e-14, epsrel=1e-12)[0] for ends in parts)

    total = integral(np.ones_like)
    mean = integral(lambda x: x) / total
    variance = integral(lambda x: (x - mean) ** 2) / total
    ratio = integral(lambda x: float(side * x > 0.3)) / total
    force = integral(lambda x: 50.0 * max(-side * x - 0.7, 0.0) ** 2) / total
    rate = math.sqrt(1.5 / oscillator.mass / (2.0 * math.pi)) * density(side * 0.3) / total
    assert data.mean_displacement.item() == pytest.approx(mean, rel=1e-10)
    assert data.variance_displacement.item() == pytest.approx(variance, rel=1e-11)
    assert data.contact_ratio.values[0] == pytest.approx(ratio, rel=1e-11)
    assert data.contact_rate.values[0] == pytest.approx(rate, rel=1e-11)
    assert data.mean_contact_force.values[1] == pytest.approx(force, rel=1e-10)


@pytest.mark.parametrize("temperature", [1e-6, 0.2, 1e6])
def test_duffing_against_quad(temperature):
    """In the thermal length of the spring, or of the cubic where that is shorter."""
    body = il.DuffingOscillator(cubic=3.0, mass=2.0, damping=0.5, stiffness=1.2)
    data = exact(single(body, {}, temperature)).statistics()
    length = min((temperature / 1.2) ** 0.5, (temperature / 3.0) ** 0.25)

    def moment(order):
        def integrand(u):
            x = u * length
            return u**order * math.exp(-(0.6 * x**2 + 0.75 * x**4) / temperature)

        return quad(integrand, 0.0, 12.0, epsabs=0.0, epsrel=1e-13, limit=200)[0]

    expected = length**2 * moment(2) / moment(0)
    assert data.mean_square_displacement.item() == pytest.approx(expected, rel=1e-12)
    assert data.mean_square_velocity.item() == pytest.approx(temperature / 2.0, rel=1e-14)
    assert set(data.dims) == {"oscillator"}


def test_double_well_finds_both_wells():
    """Narrow wells far apart; the tilt makes the far one deeper by 2 T."""
    body = DoubleWell(depth=1.0, tilt=1e-5, damping=1.0)
    reference = exact(single(body, {}, 1e-5))
    edges = np.array([-1.2, 0.0, 1.2])
    left, right = reference.bin_density("body", "displacement", edges) * 1.2
    assert left + right == pytest.approx(1.0, rel=1e-12)
    assert left / right == pytest.approx(math.exp(2.0), rel=1e-4)  # equal curvatures to order 1e-5


def test_free_partner_between_two_contacts():
    """A body without spring, noise and damping that a heated one carries in a cage."""
    ball = il.LinearOscillator(mass=0.2)
    contacts = {
        "right": il.Contact("second", "first", il.HertzContact(1e4), clearance=0.1),
        "left": il.Contact("first", "second", il.HertzContact(1e4), clearance=0.1),
    }
    data = exact(pair(SPRING, ball, contacts, 1.0)).statistics()
    depth = (4e3) ** -0.4
    closed = 2.0 * gamma(1.4) * depth
    np.testing.assert_allclose(data.contact_ratio, 0.5 * closed / (0.2 + closed), rtol=1e-11)
    np.testing.assert_allclose(data.mean_square_velocity, [0.5, 5.0], rtol=1e-14)
    opened = 2.0 * 0.1**3 / 3.0
    inside = [math.comb(2, n) * 0.1 ** (2 - n) * depth ** (n + 1) * 0.4 * gamma(0.4 * (n + 1)) for n in range(3)]
    gap = (opened + 2.0 * sum(inside)) / (0.2 + closed)
    variance = 1.0 / SPRING.stiffness
    np.testing.assert_allclose(data.variance_displacement, [variance, variance + gap], rtol=1e-11)
    np.testing.assert_allclose(data.mean_displacement, 0.0, atol=1e-14)


positive = st.floats(0.05, 20.0)
clearances = st.floats(-0.5, 0.8)


@st.composite
def pairs(draw):
    bodies = [
        il.LinearOscillator(mass=draw(positive), damping=draw(positive), stiffness=draw(positive)) for _ in range(2)
    ]
    laws = [il.HertzContact(10.0 ** draw(st.floats(-1, 5))), ConicalContact(10.0 ** draw(st.floats(-1, 5)))]
    sides = [("first", "second"), ("second", "first")]
    contacts = {
        name: il.Contact(*side, law, clearance=draw(clearances))
        for name, side, law in zip("ab", sides, laws, strict=True)
    }
    return bodies, contacts, draw(positive)


def brute_force(bodies, contacts, temperature):
    """Moments by Gauss-Legendre in two dimensions: in each x, y split where a contact closes."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    reach = [8.0 * math.sqrt(temperature / body.stiffness) for body in bodies]
    reach = [side + sum(abs(contact.clearance) for contact in contacts.values()) for side in reach]
    panels = np.linspace(-reach[0], reach[0], 41)
    x = (0.5 * (panels[1:] + panels[:-1])[:, None] + 0.5 * np.diff(panels)[:, None] * nodes).ravel()
    wx = np.outer(0.5 * np.diff(panels), weights).ravel()
    corners = np.array([contacts["a"].clearance, -contacts["b"].clearance])
    steps = np.concatenate([-(2.0 ** np.arange(7, -12, -1)), 2.0 ** np.arange(-11, 8)])
    cuts = np.unique(np.concatenate([[0.0], corners, np.add.outer(corners, steps).ravel()]))
    q = (0.5 * (cuts[1:] + cuts[:-1])[:, None] + 0.5 * np.diff(cuts)[:, None] * nodes).ravel()
    wq = np.outer(0.5 * np.diff(cuts), weights).ravel()
    potential = np.zeros_like(q)
    forces = {}
    for name, sign in (("a", 1.0), ("b", -1.0)):
        indentation = np.maximum(sign * q - contacts[name].clearance, 0.0)
        potential += contacts[name].law.call("potential", indentation)
        forces[name] = contacts[name].law.evaluate(indentation)
    y = x[:, None] - q
    energy = 0.5 * bodies[0].stiffness * x[:, None] ** 2 + 0.5 * bodies[1].stiffness * y**2 + potential
    density = np.exp(-energy / temperature) * wx[:, None] * wq
    density /= density.sum()
    return {
        "mean_displacement": [(density * x[:, None]).sum(), (density * y).sum()],
        "mean_square_displacement": [(density * x[:, None] ** 2).sum(), (density * y**2).sum()],
        "contact_ratio": [density[:, q > corners[0]].sum(), density[:, q < corners[1]].sum()],
        "mean_contact_force": [(density * forces[name]).sum() for name in "ab"],
    }


@pytest.mark.campaign
@settings(max_examples=8, deadline=None, derandomize=True)
@given(pairs())
def test_pair_against_two_dimensional_quadrature(scene):
    data = exact(pair(*scene[0], *scene[1:])).statistics()
    deviation = np.sqrt(data.mean_square_displacement.values.max())
    for name, expected in brute_force(*scene).items():
        tolerance = {"atol": 1e-9 * deviation} if name == "mean_displacement" else {"atol": 1e-12, "rtol": 1e-8}
        np.testing.assert_allclose(data[name], expected, **tolerance)


@pytest.mark.full
@settings(max_examples=15, deadline=None, derandomize=True)
@given(pairs())
def test_force_balance_and_equipartition(scene):
    """k E[x] is the mean contact force, and E[x ∂H/∂x] = T with the force times x by the density."""
    bodies, contacts, temperature = scene
    reference = exact(pair(bodies[0], bodies[1], contacts, temperature))
    data = reference.statistics()
    force = data.mean_contact_force.values
    applied = np.array([force[1] - force[0], force[0] - force[1]])
    stiffness = np.array([body.stiffness for body in bodies])
    np.testing.assert_allclose(stiffness * data.mean_displacement, applied, atol=1e-10 * force.max(), rtol=1e-10)
    law = reference.laws[0]
    starts, offsets, probability = law.quadrature()
    q = starts + offsets
    slope = sum(gap.sign * gap.law.evaluate(gap.indentation(q)) for gap in law.gaps)
    for weight, sign, k, square in zip(
        law.weights, (1.0, -1.0), stiffness, data.mean_square_displacement.values, strict=True
    ):
        assert k * square + sign * weight * (probability @ (q * slope)) == pytest.approx(temperature, rel=1e-10)


@pytest.mark.full
@settings(max_examples=15, deadline=None, derandomize=True)
@given(pairs(), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_symmetries(scene, metre, second, kilogram):
    """Exchanged bodies, mirrored space and other units describe the same pair."""
    bodies, contacts, temperature = scene
    data = exact(pair(*scene[0], *scene[1:])).statistics()

    swapped = {
        name: item.replace(first=item.second, second=item.first) for name, item in contacts.items()
    }  # mirrored: x → −x exchanges first and second
    mirrored = exact(pair(bodies[0], bodies[1], swapped, temperature)).statistics()
    units = {
        name: il.Contact(
            item.first,
            item.second,
            item.law.replace(stiffness=item.law.stiffness * kilogram / second**2 / metre ** {"a": 0.5, "b": 1.0}[name]),
            clearance=item.clearance * metre,
        )
        for name, item in contacts.items()
    }
    scaled = [
        il.LinearOscillator(
            mass=body.mass * kilogram,
            damping=body.damping * kilogram / second,
            stiffness=body.stiffness * kilogram / second**2,
        )
        for body in bodies
    ]
    other = exact(pair(*scaled, units, temperature * kilogram * metre**2 / second**2)).statistics()
    factors = {
        "mean_displacement": metre,
        "variance_displacement": metre**2,
        "mean_square_velocity": (metre / second) ** 2,
        "contact_ratio": 1.0,
        "contact_rate": 1.0 / second,
        "mean_contact_force": kilogram * metre / second**2,
    }
    for name, factor in factors.items():
        sign = -1.0 if name == "mean_displacement" else 1.0
        scale = 1e-13 * np.sqrt(data.mean_square_displacement.max().item()) if sign < 0.0 else 0.0
        np.testing.assert_allclose(mirrored[name], sign * data[name], rtol=1e-11, atol=scale)
        np.testing.assert_allclose(other[name] / factor, data[name], rtol=1e-11, atol=scale)


@pytest.mark.full
@settings(max_examples=10, deadline=None, derandomize=True)
@given(pairs())
def test_densities_of_a_pair(scene):
    """Integrals, moments and bin averages of the densities, and the joint density's marginals."""
    reference = exact(pair(*scene[0], *scene[1:]))
    data = reference.statistics()
    nodes, weights = np.polynomial.legendre.leggauss(10)
    for index, name in enumerate(("first", "second")):
        for quantity in ("displacement", "velocity"):
            mean = data[f"mean_{quantity}"].values[index]
            deviation = math.sqrt(data[f"mean_square_{quantity}"].values[index] - mean**2)
            edges = mean + deviation * np.linspace(-12.0, 12.0, 241)
            grid = 0.5 * (edges[1:] + edges[:-1])[:, None] + 0.05 * deviation * nodes
            density = reference.density(name, quantity, grid)
            average = 0.5 * density @ weights
            bins = reference.bin_density(name, quantity, edges)
            smooth = quantity == "velocity" or reference.laws[0].spread > 0.1 * deviation
            if smooth:
                np.testing.assert_allclose(bins, average, rtol=0.0, atol=1e-10 * bins.max())
            assert bins @ np.diff(edges) == pytest.approx(1.0, abs=1e-13)
            moments = [0.05 * deviation * ((grid**n * density) @ weights).sum() for n in range(3)]
            if smooth:
                assert moments[0] == pytest.approx(1.0, abs=1e-12)
                assert moments[1] == pytest.approx(mean, abs=1e-11 * deviation)
                assert moments[2] - mean**2 == pytest.approx(deviation**2, rel=1e-10)
    x = data.mean_displacement.values[0] + 0.4 * math.sqrt(data.variance_displacement.values[0])
    law = reference.laws[0]
    x_over = 20.0 * law.spread
    edges = np.union1d(law.edges, x / law.weights[0] + x_over / law.weights[0] * np.linspace(-1.0, 1.0, 41))
    q = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * nodes).ravel()
    lengths = np.outer(0.5 * np.diff(edges), weights).ravel()
    joint = reference.joint_density("first", "second", x, x - q)
    assert lengths @ joint == pytest.approx(reference.density("first", "displacement", x).item(), rel=1e-10)
    turned = reference.joint_density("second", "first", x - q, x)
    np.testing.assert_array_equal(joint, turned)


@pytest.mark.parametrize("ratio", [1.0, 1e2, 1e4, 1e8])
def test_density_of_very_unequal_pairs(ratio):
    """The narrow Gaussian of the stiff body is resolved: against quad over the gap, point by point."""
    stiff = il.LinearOscillator(damping=1.0, stiffness=ratio)
    soft = il.LinearOscillator(damping=1.0, stiffness=1.0)
    contact = il.Contact("first", "second", il.HertzContact(1e4), clearance=0.3)
    reference = exact(pair(stiff, soft, {"gap": contact}, 1.0))
    k, spread = ratio / (1.0 + ratio), 1.0 / math.sqrt(1.0 + ratio)

    def coordinate(q):
        return math.exp(-0.5 * k * q * q - 4e3 * max(q - 0.3, 0.0) ** 2.5)

    total = math.sqrt(2.0 * math.pi / k) * 0.5 * erfc(-0.3 * math.sqrt(0.5 * k))
    total += quad(coordinate, 0.3, 0.6, epsabs=0.0, epsrel=1e-13, limit=200)[0]
    for x in (-1.5, -0.31, -0.3, -0.29, 0.0, 0.8):  # of the soft body: x = −k q + spread z

        def integrand(z, x=x):
            return math.exp(-0.5 * z * z) * coordinate((spread * z - x) / k)

        corner = (0.3 * k + x) / spread
        ends = [-9.0, *([corner, min(corner + 0.1, 9.0)] if -9.0 < corner < 8.9 else []), 9.0]
        value = sum(quad(integrand, a, b, epsabs=0.0, epsrel=1e-12, limit=400)[0] for a, b in itertools.pairwise(ends))
        expected = value / (k * total * math.sqrt(2.0 * math.pi))
        assert reference.density("second", "displacement", x).item() == pytest.approx(expected, rel=1e-10)
    edges = np.linspace(-12.0, 12.0, 101)
    for name in ("first", "second"):
        bins = reference.bin_density(name, "displacement", edges)
        assert bins @ np.diff(edges) == pytest.approx(1.0, abs=1e-13)


def test_bin_averages_of_a_single_body_across_corners():
    law = il.HertzContact(1e6)
    reference = exact(single(SPRING, {"stop": il.Contact("body", WALL, law, clearance=0.2)}, 1.0))
    edges = np.array([-0.3, 0.1, 0.201, 0.25])
    for low, high, found in zip(edges, edges[1:], reference.bin_density("body", "displacement", edges), strict=False):
        corners = [low, *([0.2] if low < 0.2 < high else []), high]
        value = sum(
            quad(
                lambda x: reference.density("body", "displacement", x).item(),
                a,
                b,
                epsabs=1e-13,
                epsrel=1e-11,
            )[0]
            for a, b in itertools.pairwise(corners)
        )
        assert found == pytest.approx(value / (high - low), rel=1e-10)
    velocity = reference.density("body", "velocity", [[0.0, 1.0]])
    np.testing.assert_allclose(velocity, [[1.0, math.exp(-1.0)]] / np.sqrt(np.pi), rtol=1e-14)


def test_groups_are_independent():
    network = base_case(0.05)
    third = single(SPRING, {"stop": il.Contact("body", WALL, il.HertzContact(10.0))}, 7.0)
    both = network.replace(
        oscillators=dict(third.oscillators),
        contacts=dict(third.contacts),
        excitations=dict(third.excitations),
    )
    reference = exact(both)
    data = reference.statistics()
    for part in (network, third):
        alone = exact(part).statistics()
        for name in alone.data_vars:
            (dimension,) = alone[name].dims
            np.testing.assert_array_equal(data[name].sel({dimension: alone[dimension]}), alone[name])
    product = reference.density("one", "displacement", 0.01) * reference.density("body", "displacement", 0.2)
    assert reference.joint_density("one", "body", 0.01, 0.2) == product
    assert "one and two: temperature 2.5 J" in repr(reference)
    assert "body: temperature 7 J" in repr(reference)


def test_user_written_laws():
    """A user's law is used as it is; one whose potential overflows in Python too."""
    contact = il.Contact("first", "second", ConicalContact(100.0), clearance=0.1)
    (force,) = numbers(pair(SPRING, SOFT, {"gap": contact}, 1.0), "mean_contact_force")
    k = SPRING.stiffness * SOFT.stiffness / (SPRING.stiffness + SOFT.stiffness)

    def closed(d, order):
        return d**order * math.exp(-0.5 * k * (0.1 + d) ** 2 - 100.0 * d**3 / 3.0)

    total = quad(closed, 0.0, 2.0, args=(0,))[0] + math.sqrt(math.pi / 2.0 / k) * erfc(-0.1 * math.sqrt(0.5 * k))
    assert force[0] == pytest.approx(100.0 * quad(closed, 0.0, 2.0, args=(2,))[0] / total, rel=1e-9)
    stop = {"stop": il.Contact("body", WALL, ExponentialWall(1e3, depth=1e-3), clearance=0.1)}
    mean, force = numbers(single(SPRING, stop, 1.0), "mean_displacement", "mean_contact_force")
    assert SPRING.stiffness * mean[0] == pytest.approx(-force[0], rel=1e-11)
    network = il.Network({"body": SPRING}, {}, {"body": ConstantNoise(0.3)})
    assert exact(network).laws[0].temperature == pytest.approx(math.pi)


@pytest.mark.parametrize("depth", [1e-4, 1.0 / 3.0])
def test_law_with_a_kink(depth):
    """Against quad, split at the kink that the library is not told of."""
    law = SofteningContact(stiffness=40.0, depth=depth)
    stop = {"stop": il.Contact("body", WALL, law, clearance=0.1)}
    (ratio, force) = numbers(single(SPRING, stop, 1.0), "contact_ratio", "mean_contact_force")

    def density(d):
        return math.exp(-0.5 * SPRING.stiffness * (0.1 + d) ** 2 - float(law.call("potential", d)))

    ends = [0.0, depth, 5.0]
    closed = sum(quad(density, *part, epsabs=0.0, epsrel=1e-13)[0] for part in itertools.pairwise(ends))
    work = sum(
        quad(lambda d: float(law.evaluate(d)) * density(d), *part, epsabs=0.0, epsrel=1e-13)[0]
        for part in itertools.pairwise(ends)
    )
    opened = math.sqrt(0.5 * math.pi / SPRING.stiffness) * erfc(-0.1 * math.sqrt(0.5 * SPRING.stiffness))
    assert ratio[0] == pytest.approx(closed / (closed + opened), rel=1e-12)
    assert force[0] == pytest.approx(work / (closed + opened), rel=1e-12)


HERTZ = il.HertzContact(1e4)
FREE = il.LinearOscillator(damping=1.0)
COLD = il.LinearOscillator(stiffness=1.0)


def stopped(density, clearance, bodies="a"):
    body = il.LinearOscillator(mass=1.0, damping=1.0, stiffness=10.0)
    stop = {"stop": il.Contact("a", "b" if "b" in bodies else il.WALL, il.LinearContact(1e4), clearance=clearance)}
    links = {"next": il.Contact("b", "c", il.LinearContact(1e4), clearance=0.1)} if "c" in bodies else {}
    return il.Network(dict.fromkeys(bodies, body), {**stop, **links}, dict.fromkeys(bodies, il.WhiteNoise(density)))


@pytest.mark.parametrize("density", [1e-300, 1e-200, 1e-100, 1e-30, 1e30, 1e100, 1e200, 1e300])
def test_very_quiet_and_very_loud_noise(density):
    """Forces are linear on either side of the place at rest, so that all lengths grow with the root of the noise."""
    usual, found = (exact(stopped(size, 0.0)).statistics() for size in (1.0, density))
    for name, power in (("mean_square_displacement", 1.0), ("mean_displacement", 0.5), ("contact_ratio", 0.0),
                        ("contact_rate", 0.0), ("mean_contact_force", 0.5)):  # fmt: skip
        np.testing.assert_allclose(found[name], density**power * usual[name], rtol=1e-9, err_msg=name)
    pair = exact(stopped(density, 0.2, "ab")).statistics()
    if density < 1.0:
        np.testing.assert_allclose(pair.mean_square_displacement, np.pi * density / 10.0, rtol=1e-9)
        assert pair.contact_ratio == 0.0
    assert all(np.isfinite(item).all() for item in pair.data_vars.values())


def test_motion_that_numbers_do_not_resolve_is_refused():
    with pytest.raises(il.NoExactReference, match=r"'a': the motion about -0\.0999001 m is within 1e-10 m"):
        exact(stopped(1e-30, -0.1))
    with pytest.raises(il.NoExactReference, match=r"smaller than 9e-16 m, which the law of several bodies does not"):
        exact(stopped(1e-30, 0.1, "abc"))


def refused(oscillators, contacts=None, excitations=None):
    with pytest.raises(il.NoExactReference) as caught:
        exact(il.Network(oscillators, contacts, excitations))
    return str(caught.value)


def test_refused_excitations():
    body, stop = {"body": SPRING}, {"stop": il.Contact("body", WALL, HERTZ)}
    assert "'body' is excited by ShinozukaNoise; the law is known for constant white noise only" in refused(
        body, stop, {"body": il.ShinozukaNoise(1.0, components=100)}
    )
    assert "'body' is excited by Cosine" in refused(body, {}, {"body": Cosine(1.0, frequency=1.0)})
    assert "'body' is excited by FadingNoise" in refused(body, {}, {"body": FadingNoise(1.0, decay=1.0)})
    assert "'body' has damping without noise: its temperature is 0; with white noise it" in refused(body, stop)
    assert "'body': damping without noise" in refused(body)
    assert "'body' has noise without damping and gains energy" in refused(
        {"body": COLD}, stop, {"body": il.WhiteNoise(1.0)}
    )
    assert "'body': noise without damping, the energy grows" in refused(
        {"body": COLD}, {}, {"body": il.WhiteNoise(1.0)}
    )
    assert "'body': neither noise nor damping" in refused({"body": COLD})
    assert "'body': neither noise nor damping" in refused({"body": COLD}, {}, {"body": il.WhiteNoise(0.0)})
    with pytest.raises(il.InvalidInput, match=r"ConstantNoise.intensity of 'body'.*-1"):
        exact(il.Network(body, {}, {"body": ConstantNoise(-1.0)}))


def test_refused_forces():
    noise = {"body": il.WhiteNoise(1.0)}
    assert "residual force of 'body' depends on the velocity" in refused(
        {"body": QuadraticDrag(damping=1.0)}, {}, noise
    )
    assert "ResidualOnly, the class of 'body', does not define residual_potential" in refused(
        {"body": ResidualOnly(damping=1.0)}, {}, noise
    )
    assert "ForceOnlyContact, the law of contact 'gap', does not define potential" in refused(
        {"body": SPRING}, {"gap": il.Contact("body", WALL, ForceOnlyContact())}, noise
    )
    assert "the force of contact 'gap' depends on the rate" in refused(
        {"body": SPRING}, {"gap": il.Contact("body", WALL, DashpotContact())}, noise
    )


def test_refused_potentials():
    noise = {"body": il.WhiteNoise(1.0)}
    stop = {"stop": il.Contact("body", WALL, JaggedContact(), clearance=0.1)}
    assert "'body': the integral of exp(−H/T) does not converge" in refused({"body": SPRING}, stop, noise)
    stop = {"stop": il.Contact("body", WALL, UndefinedContact(), clearance=0.1)}
    assert "'body': the potential is NaN" in refused({"body": SPRING}, stop, noise)


def test_refused_temperatures():
    network = base_case(0.05).replace(excitations={"one": il.WhiteNoise(32.0)})
    with pytest.raises(il.NoExactReference, match=r"temperatures .* differ: 'one' 5 J, 'two' 2.5 J"):
        exact(network)
    exact(base_case(0.05).replace(excitations={"one": il.WhiteNoise(16.0 * (1.0 + 1e-10))}))
    with pytest.raises(il.NoExactReference, match="differ"):
        exact(base_case(0.05).replace(excitations={"one": il.WhiteNoise(16.0 * (1.0 + 1e-8))}))


def test_refused_networks():
    heated = heat(SPRING, 1.0)
    gap = {"gap": il.Contact("a", "b", HERTZ)}
    noises = {"a": heat(FREE, 1.0), "b": heat(FREE, 1.0)}
    assert "'a' and 'b' have no springs" in refused({"a": FREE, "b": FREE}, gap, noises)
    assert "cannot be normalised" in refused({"a": SPRING, "b": FREE}, gap, {"a": heated, "b": heat(FREE, 1.0)})
    assert "'a': the law cannot be normalised" in refused({"a": FREE}, {}, {"a": heat(FREE, 1.0)})
    stop = {"stop": il.Contact("a", WALL, HERTZ)}
    assert "on both sides" in refused({"a": FREE}, stop, {"a": heat(FREE, 1.0)})
    slack = {"gap": il.Contact("a", "b", il.HertzContact(0.0))}
    assert "'b' has neither noise nor damping, and nothing heats it" in refused(
        {"a": SPRING, "b": COLD}, slack, {"a": heated}
    )


def test_all_reasons_are_given():
    message = refused(
        {"a": SPRING, "b": SOFT},
        {"gap": il.Contact("a", "b", ForceOnlyContact())},
        {"a": il.ShinozukaNoise(1.0)},
    )
    assert message.splitlines() == [
        "There is no exact stationary law that is known here:",
        "- 'a' is excited by ShinozukaNoise; the law is known for constant white noise only, as il.WhiteNoise.",
        "- 'b' has damping without noise: its temperature is 0; with white noise it would have a law.",
        "- ForceOnlyContact, the law of contact 'gap', does not define potential; define potential(indentation, ...), "
        "the integral of ForceOnlyContact.force from 0.",
    ]


def test_bad_input():
    reference = exact(base_case(0.05))
    with pytest.raises(il.InvalidInput, match="did you mean 'one'"):
        reference.density("onee", "displacement", 0.0)
    with pytest.raises(il.InvalidInput, match="did you mean 'velocity'"):
        reference.density("one", "velocities", 0.0)
    with pytest.raises(il.InvalidInput, match="finite"):
        reference.density("one", "displacement", [0.0, np.nan])
    with pytest.raises(il.InvalidInput, match="increasing"):
        reference.bin_density("one", "displacement", [0.0, 0.0])
    with pytest.raises(il.InvalidInput, match="not the displacement of 'one' twice"):
        reference.joint_density("one", "one", 0.0, 0.0)
    with pytest.raises(il.InvalidInput, match="did you mean 'velocity'"):
        reference.joint_density("one", "two", 0.0, 0.0, quantities=("displacement", "velocty"))
    with pytest.raises(il.InvalidInput, match=r"must be an il\.Network"):
        exact("network")


def test_import_is_light():
    code = "import sys, impactlab.reference; print({'numba', 'matplotlib'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize("density", [1e-300, 1e-100, 1e-30, 1e100, 1e200])
def test_noise_of_any_size(density):
    """The mean square velocity is πS/(mc) whatever the contact; a contact that is too far away never closes."""
    body, stop = (
        il.LinearOscillator(stiffness=10.0, damping=2.0),
        il.Contact("a", il.WALL, il.HertzContact(1e3), clearance=0.1),
    )
    found = il.exact(il.Network({"a": body}, {"stop": stop}, {"a": il.WhiteNoise(density)})).statistics()
    assert found.mean_square_velocity.item() == pytest.approx(np.pi * density / 2.0, rel=1e-12)
    assert np.isfinite(found.mean_square_displacement.item())
    if density < 1.0:
        assert found.mean_square_displacement.item() == pytest.approx(np.pi * density / 20.0, rel=1e-12)
        assert found.contact_ratio.item() == 0.0
