"""Forces of any shape: the stiffness that matters over all energies, and what kinks and jumps do."""

import math

import numpy as np
import pytest
from impactlab_numerics.laws.contacts import BilinearContact, JumpContact, SaturatingContact
from impactlab_numerics.laws.couplings import DeadBandCoupling
from impactlab_numerics.laws.oscillators import SoftOscillator, StopOscillator
from laws import TwoWells

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.step_control.rules.kinks import kink_step
from impactlab.step_control.rules.profiles import Profiles, of_force, of_powers
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies


class Jump(il.ContactLaw):
    """A force that is there at once, and a jump in its stiffness or at a depth."""

    first: float = il.parameter(units="N")
    stiffness: float = il.parameter(units="N m-1")
    second: float = il.parameter(0.0, units="N")
    depth: float = il.parameter(0.0, units="m")

    @staticmethod
    def force(indentation, first, stiffness, second, depth):
        return first + stiffness * indentation + (second if indentation > depth else 0.0)

    @staticmethod
    def potential(indentation, first, stiffness, second, depth):
        return first * indentation + 0.5 * stiffness * indentation**2 + second * max(indentation - depth, 0.0)


class Hertz(il.ContactLaw):
    """`HertzContact`, unknown to the package."""

    stiffness: float = il.parameter(units="N m-3/2")

    @staticmethod
    def force(indentation, stiffness):
        return stiffness * indentation * math.sqrt(indentation)


def alone(kind, *values, damping=0.2, **fields):
    """A body of unit mass and temperature."""
    body = kind(*values, mass=1.0, damping=damping, **fields)
    return il.Network({"a": body}, excitations={"a": il.WhiteNoise(damping / math.pi)})


def at_wall(law, clearance=0.1, damping=0.2):
    network = alone(il.LinearOscillator, damping=damping, stiffness=1.0)
    return network.replace(contacts={"w": il.Contact("a", il.WALL, law, clearance=clearance)})


def stiffening(network):
    model = Model.of(network)
    return model, Stiffening.of(model, energies(model, "stationary", 10.0))


def passes(columns):
    return Profiles.of(np.array(columns)[:, None])


@pytest.mark.parametrize("over", [0.5, 0.2, 0.05])
def test_kinks_and_jumps_heat_by_what_theory_says(over):
    """A slope that jumps by K heats by T (hΩ)⁴/180 a pass, a force that jumps by F by (hF)²/12m."""
    stiffness, temperature, jump = 100.0, 2.0, 30.0
    reach = math.sqrt(40.0 * temperature / stiffness)
    kink = passes(of_force(lambda x: stiffness * x, 0.0, reach, temperature))
    distance = np.array([over / math.sqrt(stiffness) * math.sqrt(2.0 * temperature)])
    assert kink.heat(distance, np.array([temperature]))[0] == pytest.approx(temperature * over**4 / 180.0, rel=0.15)
    jumps = passes(of_force(lambda x: jump * (x > 0.0), 0.0, 20.0 * temperature / jump, temperature))
    step = over * math.sqrt(temperature) / jump
    found = jumps.heat(np.array([step * math.sqrt(2.0 * temperature)]), np.array([temperature]))[0]
    assert found == pytest.approx((step * jump) ** 2 / 12.0, rel=0.07)


@pytest.mark.parametrize("exponent", [0.1, 0.3, 1.0, 1.5, 2.0])
def test_profiles_of_powers_are_what_is_known_of_them(exponent):
    eta = 20.0
    length = ((exponent + 1.0) / eta) ** (1.0 / (exponent + 1.0))
    found = passes(of_force(lambda x: eta * x**exponent, 0.0, length * 20.0 ** (1.0 / (exponent + 1.0)), 1.0))
    known = passes(of_powers(*(np.array([item]) for item in (eta, exponent, length)))[:, 0])
    np.testing.assert_allclose(found.room, known.room, rtol=2e-2)
    for part in (0.3, 0.2):
        distance, temperature = np.array([part * length]), np.ones(1)
        np.testing.assert_allclose(found.heat(distance, temperature), known.heat(distance, temperature), rtol=0.1)


def test_a_power_has_the_same_stiffness_and_step_whether_or_not_it_is_known():
    for clearance in (0.5, -0.3, -3.0):
        unknown, known = at_wall(Hertz(100.0), clearance), at_wall(il.HertzContact(100.0), clearance)
        np.testing.assert_array_equal(stiffening(unknown)[1].contacts, stiffening(known)[1].contacts)
        assert unknown.check().dataset.attrs["step"] == known.check().dataset.attrs["step"]


def test_a_stiffness_far_beyond_the_thermal_energy_counts_by_how_often_it_is_met():
    bodies = [alone(StopOscillator, 1000.0, distance=gap, stiffness=1.0) for gap in (0.0, 1.5, 2.5, 4.0, 7.0)]
    found = [stiffening(body)[1].bodies[0] for body in bodies]
    assert found[0] == pytest.approx(1000.0, rel=0.05)
    assert (np.diff(found) < 0.0).all()
    assert 60.0 < found[3] < 100.0  # steps are stable there
    assert found[4] == 0.0  # 24 T


@pytest.mark.full
@pytest.mark.parametrize(
    "network",
    [
        pytest.param(alone(StopOscillator, 10.0, distance=1.5, stiffness=1.0), id="stop", marks=pytest.mark.campaign),
        pytest.param(
            alone(StopOscillator, 100.0, distance=2.5, stiffness=1.0), id="stop far out", marks=pytest.mark.campaign
        ),
        pytest.param(alone(SoftOscillator, 1.0, width=0.02, stiffness=1.0), id="catch", marks=pytest.mark.campaign),
        pytest.param(alone(TwoWells, 4.0, wall=2.0), id="double well"),
        pytest.param(
            at_wall(BilinearContact(2.0, second=1000.0, distance=1.5)), id="bilinear", marks=pytest.mark.campaign
        ),
        pytest.param(at_wall(JumpContact(10.0, stiffness=1.0)), id="jump"),
        pytest.param(at_wall(JumpContact(10.0, stiffness=1.0), -2.0), id="jump, pressed", marks=pytest.mark.campaign),
        pytest.param(
            at_wall(Jump(0.0, stiffness=2.0, second=5.0, depth=0.5)), id="jump inside", marks=pytest.mark.campaign
        ),
        pytest.param(at_wall(SaturatingContact(20.0, depth=0.001)), id="saturating", marks=pytest.mark.campaign),
        pytest.param(
            at_wall(SaturatingContact(1.2, depth=0.2), 2.3, damping=0.17),
            id="rarely met, saturating",
            marks=pytest.mark.campaign,
        ),
        pytest.param(at_wall(il.PowerLawContact(20.0, exponent=0.1)), id="power of 0.1", marks=pytest.mark.campaign),
    ],
)
def test_laws_of_any_shape_are_right_at_the_automatic_step(network):
    exact = il.exact(network).statistics()
    step = network.check().dataset.attrs["step"]
    found = il.simulate(network, max(200.0, 4e4 * step), realizations=512, rng=1)
    names = ["mean_square_displacement", "mean_square_velocity"]
    names += ["contact_ratio", "mean_contact_force"] if network.contacts else []
    for name in names:
        true = exact[name].values
        error = found[f"{name}_standard_error"].values
        assert (np.abs(found[name].values - true) <= 0.005 * np.abs(true) + 3.0 * error).all(), name


@pytest.mark.full
def test_a_dead_band_is_right_at_the_automatic_step():
    gap, stiffness = 1.5, 400.0
    network = alone(il.LinearOscillator, stiffness=1.0).replace(
        couplings={"c": il.Coupling("a", il.WALL, DeadBandCoupling(stiffness, play=gap))}
    )
    found = il.simulate(network, 1000.0, realizations=512, rng=1)
    x = np.linspace(-4.0, 4.0, 80001)
    weight = np.exp(-0.5 * x**2 - 0.5 * stiffness * np.maximum(np.abs(x) - gap, 0.0) ** 2)
    for name, true in (("displacement", (x**2 * weight).sum() / weight.sum()), ("velocity", 1.0)):
        error = found[f"mean_square_{name}_standard_error"].item()
        assert abs(found[f"mean_square_{name}"].item() - true) <= 0.005 * true + 3.0 * error


def row(bodies, damping=0.1):
    """Unlike bodies on weak springs; something cools and heats those at the ends only."""
    ends = (0, bodies - 1)
    oscillators = {
        f"b{slot}": il.LinearOscillator(mass=1.0 + 0.6 * (slot % 2), damping=damping * (slot in ends), stiffness=1.0)
        for slot in range(bodies)
    }
    contacts = {
        f"c{slot}": il.Contact(f"b{slot}", f"b{slot + 1}", il.LinearContact(100.0)) for slot in range(bodies - 1)
    }
    return il.Network(oscillators, contacts, {f"b{slot}": il.WhiteNoise(damping / math.pi) for slot in ends})


def test_kinks_of_a_row_share_the_friction_of_its_ends():
    model, found = stiffening(row(9))
    step = kink_step(model, found)
    assert kink_step(*stiffening(row(33))) == pytest.approx(step * (8.0 / 32.0) ** 0.25, rel=0.02)
    assert kink_step(*stiffening(row(9, 0.01))) == pytest.approx(step * 0.1**0.25, rel=0.02)


@pytest.mark.campaign
def test_a_row_without_friction_inside_has_the_temperature_of_its_ends():
    """At 0.5 over the frequency of the closed contacts it is 1.7 % hotter."""
    network = row(17)
    found = il.simulate(network, 1000.0, realizations=256, spin_up=500.0, rng=1)
    mass = np.array([body.mass for body in network.oscillators.values()])
    temperature = mass * found.mean_square_velocity.values
    error = float(np.mean(mass * found.mean_square_velocity_standard_error.values))  # as if all were one
    assert abs(temperature.mean() - 1.0) <= 0.005 + 3.0 * error


@pytest.mark.full
@pytest.mark.parametrize(
    "network",
    [row(5), at_wall(JumpContact(10.0, stiffness=1.0)), alone(StopOscillator, 100.0, distance=1.5, stiffness=1.0)],
)
def test_a_check_and_a_simulation_take_the_same_step(network):
    """By the same rules; a measurement may find a larger one right."""
    step, rules = network.check().dataset.attrs["step"], il.ExactFlow(measured=False)
    found = il.simulate(network, 400.0 * step, realizations=64, spin_up=0.0, integrator=rules, rng=1)
    assert found.attrs["step"] == pytest.approx(step, rel=1e-9)
