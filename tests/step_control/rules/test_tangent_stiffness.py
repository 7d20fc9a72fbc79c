"""What is known of a scene before it runs."""

import math

import numpy as np
import pytest
from impactlab_numerics.laws.contacts import ConicalContact, ExponentialWall
from scenes import base

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators.base import frequencies
from impactlab.linear.decay import relaxation_time
from impactlab.linear.laws import linear_variances, lines_of, spread
from impactlab.linear.spectral_lines import regular_lines
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies, energy_of


class BadLines(il.Excitation):
    def lines(self):
        return [1.0, 2.0], [1.0, 2.0, 3.0]


class NaNLines(il.Excitation):
    def lines(self):
        return [1.0, 2.0], [1.0, math.nan]


class ComplexLines(il.Excitation):
    def lines(self):
        return [1.0, 2.0], [1.0, 1.0j]


class NoLines(il.Excitation):
    def lines(self):
        return None


class ThreeLines(il.Excitation):
    def lines(self):
        return [1.0], [1.0], [1.0]


class TextLines(il.Excitation):
    def lines(self):
        return "slow", "fast"


def stiffening(network):
    model = Model.of(network)
    return Stiffening.of(model, energies(model, "stationary", 1.0))


def test_linear_variances_of_white_noise():
    bodies = {
        "a": il.LinearOscillator(mass=2.0, damping=0.5, stiffness=8.0),
        "free": il.LinearOscillator(damping=0.5),
        "undamped": il.LinearOscillator(stiffness=1.0),
        "quiet": il.LinearOscillator(stiffness=1.0),
    }
    noise = il.WhiteNoise(3.0)
    model = Model.of(il.Network(bodies, excitations={"a": noise, "free": noise, "undamped": noise}))
    expected = np.pi * 3.0 * np.array([[1 / 4.0, np.inf, np.inf, 0.0], [1 / 1.0, 1 / 0.5, np.inf, 0.0]])
    np.testing.assert_allclose(linear_variances(model), np.where(np.isnan(expected), 0.0, expected))


@pytest.mark.parametrize(
    ("law", "exponent"), [(il.LinearContact(300.0), 1.0), (il.HertzContact(1e4), 1.5), (ConicalContact(5e5), 2.0)]
)
def test_thermal_penetration_of_power_laws(law, exponent):
    network = base().replace(contacts={"gap": il.Contact("one", "two", law, clearance=0.05)})
    temperature = np.pi * 16.0 / network.oscillators["one"].damping
    assert temperature == pytest.approx(np.pi / network.oscillators["two"].damping)  # equal at 16
    eta = float(law.evaluate(1.0))
    depth = ((exponent + 1.0) * temperature / eta) ** (1.0 / (exponent + 1.0))
    found = stiffening(network)
    assert found.penetration[0] == pytest.approx(depth, rel=1e-6)
    assert found.contacts[0] == pytest.approx(exponent * eta * depth ** (exponent - 1.0), rel=1e-5)


def test_penetration_of_a_law_that_overflows():
    """In Python far out, where the search for the penetration begins."""
    law = ExponentialWall(1.0, depth=0.01)
    network = base().replace(contacts={"gap": il.Contact("one", "two", law, clearance=0.05)})
    depth = stiffening(network).penetration[0]
    stored = 0.01 * (math.exp(depth / 0.01) - 1.0) - depth
    assert stored == pytest.approx(2.5, rel=1e-6)  # T


def test_the_hotter_body_gives_the_energy():
    network = base(ratio=4.0)  # body one is four times as hot
    heat = [np.pi * 16.0 / network.oscillators["one"].damping, np.pi / network.oscillators["two"].damping]
    assert heat[0] > heat[1]
    model = Model.of(network)
    np.testing.assert_allclose(energies(model, "stationary", 1.0), heat[0])
    np.testing.assert_allclose(spread(model)[1], np.sqrt(heat[0]))  # unit masses
    apart = Model.of(network.replace(contacts={"gap": None}))
    np.testing.assert_allclose(energies(apart, "stationary", 1.0), heat)


def test_a_given_start_may_be_the_hottest():
    model = Model.of(base())
    start = np.array([[0.0, 1.0], [0.0, 30.0]])
    expected = 0.5 * 4.0 * np.pi**2 + 0.5 * 900.0
    np.testing.assert_allclose(energies(model, start, 1.0), expected)


def test_static_preload():
    """Two springs in series press the contact: overlap = δ + F/k₁ + F/k₂."""
    bodies = {"a": il.LinearOscillator(stiffness=100.0), "b": il.LinearOscillator(stiffness=50.0)}
    network = il.Network(bodies, {"gap": il.Contact("a", "b", il.LinearContact(300.0), clearance=-0.3)})
    force = 0.3 / (1.0 / 300.0 + 1.0 / 100.0 + 1.0 / 50.0)
    found = stiffening(network)
    assert found.penetration[0] == pytest.approx(force / 300.0, rel=1e-6)
    assert found.contacts[0] == pytest.approx(300.0, rel=1e-6)
    np.testing.assert_allclose(found.rest, [-force / 100.0, force / 50.0], rtol=1e-6)


def test_frequencies_with_closed_contacts():
    model = Model.of(base())
    k_1, k_2 = model.stiffness
    tangent = np.array([500.0])
    expected = np.sqrt(np.linalg.eigvalsh([[k_1 + 500.0, -500.0], [-500.0, k_2 + 500.0]]))
    np.testing.assert_allclose(frequencies(model, tangent), expected)
    wall = il.Network({"a": il.LinearOscillator(mass=2.0)}, {"w": il.Contact("a", il.WALL, il.LinearContact(1.0))})
    np.testing.assert_allclose(frequencies(Model.of(wall), tangent), [np.sqrt(250.0)])


def test_the_bound_for_many_bodies_is_above_the_largest_frequency():
    long = il.chain(301, il.LinearOscillator(stiffness=4.0, mass=0.5), il.LinearContact(1.0), clearance=0.1)
    model = Model.of(long)
    tangent = np.full(300, 7.0)
    exact = np.sqrt(4.0 + 4.0 * 7.0 * np.cos(np.pi / 602.0) ** 2) / np.sqrt(0.5)
    assert exact <= frequencies(model, tangent)[-1] <= 1.001 * exact


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (il.LinearOscillator.from_frequency(10.0, 0.1), 1.0),
        (il.LinearOscillator.from_frequency(10.0, 1.0), 0.1),
        (il.LinearOscillator(mass=2.0, damping=50.0, stiffness=8.0), 1.0 / (12.5 - math.sqrt(12.5**2 - 4.0))),
        (il.LinearOscillator(mass=2.0, damping=0.5), 4.0),
        (il.LinearOscillator(stiffness=1.0), 0.0),
    ],
)
def test_relaxation_time_is_the_slowest_root(body, expected):
    quick = il.LinearOscillator.from_frequency(1000.0, 0.5)
    assert relaxation_time(Model.of(il.Network({"a": body}))) == pytest.approx(expected)
    if expected:
        assert relaxation_time(Model.of(il.Network({"a": body, "q": quick}))) == pytest.approx(expected)


def test_regular_lines():
    spacing = 0.3
    whole, period = regular_lines(spacing * np.arange(5, 50))
    np.testing.assert_array_equal(whole, np.arange(5, 50))
    assert period == pytest.approx(2.0 * np.pi / spacing)
    assert regular_lines(0.1 + spacing * np.arange(5, 50)) is None
    assert regular_lines(np.array([1.0, 2.0, 4.0])) is None
    assert regular_lines(np.array([2.0, 1.0])) is None


@pytest.mark.parametrize(
    "excitation", [BadLines(), NaNLines(), ComplexLines(), NoLines(), ThreeLines(), TextLines()], ids=repr
)
def test_lines_that_are_no_two_finite_arrays_are_refused(excitation):
    network = il.Network({"a": il.LinearOscillator(stiffness=1.0)}, excitations={"a": excitation})
    with pytest.raises(il.InvalidInput, match=r"lines must return two finite, .* and real amplitudes, .* returned "):
        lines_of(Model.of(network))


@pytest.mark.parametrize("scale", [1.0, 1e-4])
def test_the_energy_of_a_start_in_a_double_well_is_that_above_the_wells(scale):
    """With U = x⁴/4 − x²/2, whose wells are at ±1."""
    model = Model.of(il.Network({"a": il.DoubleWellOscillator(scale**-2, repulsion=1.0)}))
    for place in (0.01, 0.6, -0.6, 1.0, 1.2, -2.0):
        start = np.array([[scale * place], [0.0]])
        expected = scale**2 * (0.25 * (place**2 - 1.0) ** 2)
        assert energy_of(model, start)[0] == pytest.approx(expected, rel=0.02, abs=1e-6 * scale**2)


@pytest.mark.filterwarnings("ignore:The bias of the step")
@pytest.mark.parametrize(("place", "slope"), [(1.0, 2.0), (0.0, 1.0), (0.6, 2.5), (1.2, 3.2)])
def test_a_step_is_chosen_for_a_double_well_wherever_it_starts(place, slope):
    """By the stiffness where it is, or on its way: the centre and the wells have no energy of motion."""
    network = il.Network({"a": il.DoubleWellOscillator(1.0, repulsion=1.0, damping=0.1)})
    start = {"displacement": {"a": place}}
    result = il.simulate(network, 5.0, initial=start, spin_up=0.0, integrator=il.ExactFlow(), record=il.FinalState())
    assert result.attrs["step"] <= 0.51 / math.sqrt(slope)  # the duration is a whole number of steps
    if place in (0.0, 1.0):
        assert result["final_displacement"].item() == place
