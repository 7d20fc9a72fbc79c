"""Forces that depend on velocities: how a kick solves them, and the step that resolves them."""

import math

import numpy as np
import pytest
from impactlab_numerics.laws.oscillators import (
    DragOscillator,
    FrictionOscillator,
    ViscousOscillator,
)
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.build import build
from impactlab.step_control.rules.dissipation import OF_BODIES, OF_CONTACTS, damping_rates
from impactlab.step_control.rules.tangent_stiffness import Stiffening

BODY = il.LinearOscillator.from_frequency(1.0, 0.1)
HEAT = il.WhiteNoise(0.2 / np.pi)


def at_wall(law):
    return il.Network({"a": BODY}, {"wall": il.Contact("a", il.WALL, law, clearance=0.2)}, {"a": HEAT})


def alone(body):
    return il.Network({"a": body}, excitations={"a": HEAT})


def force_over_kick(body, *fields):
    module = build(generate(Model.of(alone(body))))
    function = getattr(module, f"{type(body).__name__}_residual_over_kick")
    return lambda speed, response: function(0.0, speed, response, *fields)


@pytest.mark.full
@pytest.mark.parametrize("rate", [1e-3, 0.1, 1.0, 10.0, 100.0])
def test_a_linear_damper_slows_a_kick_down_exactly(rate):
    """Whatever its strength: half the kick is ``response × force``, and ``γh = 2 response c``."""
    force = force_over_kick(ViscousOscillator(2.0), 2.0)
    response = rate / 4.0
    assert 3.0 - 2.0 * response * force(3.0, response) == pytest.approx(3.0 * math.exp(-rate), rel=2e-6, abs=1e-6)


@pytest.mark.full
@pytest.mark.parametrize("response", [0.3, 1.0, 3.0])
def test_dry_friction_brings_a_body_to_rest(response):
    """In a few kicks, each of which would throw it back and forth if its force were that of its velocity before."""
    force = force_over_kick(FrictionOscillator(2.0, creep=1e-9), 2.0, 1e-9)
    for speed in (-1.0, -0.3, 0.02, 1.1):
        after = speed
        for _ in range(4):
            after = after - 2.0 * response * force(after, response)
        assert abs(after) < 0.02 * abs(speed)


@pytest.mark.full
def test_a_kick_without_length_takes_the_force_as_it_is():
    assert force_over_kick(FrictionOscillator(0.5, creep=0.1), 0.5, 0.1)(0.05, 0.0) == 0.5 * math.tanh(0.5)


def test_passes():
    """One pass where each body has one such force, two where forces meet, none where there are none."""
    two = {"a": BODY, "b": BODY}
    walls = {
        "left": il.Contact(il.WALL, "a", il.KelvinVoigtContact(1.0, damping=1.0)),
        "right": il.Contact("a", il.WALL, il.KelvinVoigtContact(1.0, damping=1.0)),
    }
    damped = {"c": il.Coupling("a", "b", il.LinearCoupling(1.0, damping=1.0))}
    assert Model.of(alone(il.DuffingOscillator(1.0))).kicks.passes == 0
    assert Model.of(at_wall(il.KelvinVoigtContact(1.0, damping=1.0))).kicks.passes == 1
    assert Model.of(alone(ViscousOscillator(1.0))).kicks.passes == 1
    assert Model.of(il.Network(two, walls)).kicks.passes == 2
    assert Model.of(il.Network({**two, "a": ViscousOscillator(1.0)}, {"left": walls["left"]})).kicks.passes == 2
    assert Model.of(il.Network(two, couplings=damped)).kicks.passes == 2


def test_rates_of_linear_dampers_are_damping_over_mass():
    network = il.Network(
        {"a": ViscousOscillator(3.0, mass=2.0, stiffness=1.0), "b": BODY},
        {"gap": il.Contact("a", "b", il.KelvinVoigtContact(100.0, damping=5.0))},
    )
    model = Model.of(network)
    contacts, couplings, bodies = damping_rates(model, Stiffening.of(model, np.ones(2)))
    assert bodies == pytest.approx([1.5, 0.0], rel=1e-2)
    assert 0.4 * 7.5 < contacts[0] < 7.5  # the force is 0 where the dashpot would pull
    assert couplings.size == 0


def test_rates_of_equal_laws_are_those_of_each():
    laws = [il.KelvinVoigtContact(100.0, damping=dashpot) for dashpot in (5.0, 9.0, 5.0)]
    model = Model.of(il.chain(4, BODY, laws))
    contacts, _, bodies = damping_rates(model, Stiffening.of(model, np.ones(4)))
    assert contacts[0] == contacts[2] < contacts[1]
    assert (bodies == 0.0).all()


STRENGTHS = [
    pytest.param(at_wall(il.KelvinVoigtContact(100.0, damping=8.0)), marks=pytest.mark.campaign),
    pytest.param(at_wall(il.KelvinVoigtContact(100.0, damping=40.0)), marks=pytest.mark.campaign),
    at_wall(il.KelvinVoigtContact(100.0, damping=100.0)),
    pytest.param(at_wall(il.HuntCrossleyContact(100.0, dissipation=4.0)), marks=pytest.mark.campaign),
    pytest.param(at_wall(il.HuntCrossleyContact(100.0, dissipation=10.0)), marks=pytest.mark.campaign),
    pytest.param(alone(FrictionOscillator(0.5, creep=0.1, damping=0.2, stiffness=1.0)), marks=pytest.mark.campaign),
    pytest.param(alone(FrictionOscillator(0.5, creep=0.005, damping=0.2, stiffness=1.0)), marks=pytest.mark.campaign),
    alone(DragOscillator(10.0, damping=0.2, stiffness=1.0)),
    pytest.param(
        alone(il.VanDerPolOscillator(3.0, width=1.0, damping=0.02, stiffness=1.0)), marks=pytest.mark.campaign
    ),
]

STATISTICS = (
    "mean_square_displacement",
    "mean_square_velocity",
    "contact_ratio",
    "contact_rate",
    "mean_contact_force",
)


@pytest.mark.full
@pytest.mark.parametrize("network", STRENGTHS, ids=repr)
def test_the_automatic_step_resolves_dissipation(network):
    """Against a sixth of the step: within 0.5 % and 3 standard errors."""
    options = {"duration": 100.0, "realizations": 256, "spin_up": 50.0}
    result = il.simulate(network, **options, rng=1)
    fine = il.simulate(network, **options, rng=2, step=result.attrs["step"] / 6.0)
    for name in set(STATISTICS) & set(result):
        error = math.hypot(result[f"{name}_standard_error"].item(), fine[f"{name}_standard_error"].item())
        assert abs(result[name].item() - fine[name].item()) < 5e-3 * abs(fine[name].item()) + 3.0 * error, name


@pytest.mark.full
@pytest.mark.parametrize("damping", [0.3, 1.0, 1.9])
def test_a_damper_that_is_a_residual_keeps_the_law_of_a_linear_one(damping):
    network = il.Network(
        {"a": ViscousOscillator(damping, stiffness=1.0)}, excitations={"a": il.WhiteNoise(damping / np.pi)}
    )
    result = il.simulate(network, 200.0, realizations=256, rng=3)
    for name in ("mean_square_displacement", "mean_square_velocity"):
        assert abs(result[name].item() - 1.0) < 5e-3 + 3.0 * result[f"{name}_standard_error"].item()


@pytest.mark.full
@pytest.mark.parametrize("dashpot", [100.0, 300.0, 3000.0])
def test_no_dashpot_switches_a_wall_off(dashpot):
    """Not even at a step that is fifty times too large: the body would have a mean square of 1 without the wall."""
    step = 0.05
    with pytest.warns(il.AccuracyWarning, match="At the step"):
        result = il.simulate(
            at_wall(il.KelvinVoigtContact(100.0, damping=dashpot)), 100.0, realizations=256, step=step, rng=1
        )
    assert result.mean_contact_force.item() > 0.2
    assert result.mean_square_displacement.item() < 0.35


@pytest.mark.full
@pytest.mark.parametrize("restitution", [0.9, 0.8, 0.5])
def test_restitution_is_what_it_is_at_the_default_step(restitution):
    """A body on a spring and a dashpot that cannot pull leaves a wall with a part of its velocity that is known."""
    stiffness, damping = 1e6, 2.0 * _damping_ratio(restitution) * 1e3
    law = il.KelvinVoigtContact(stiffness, damping=damping)
    network = il.Network({"ball": il.LinearOscillator()}, {"floor": il.Contact("ball", il.WALL, law)})
    start = {"displacement": {"ball": -0.01}, "velocity": {"ball": 1.0}}
    result = il.simulate(network, 0.1, initial=start, record=il.Trajectory(0.1), rng=1)
    assert -result.velocity[0, -1, 0].item() == pytest.approx(restitution, rel=5e-3)


def _damping_ratio(restitution):
    """Damping ratio ζ with ``e = exp(−ζ atan2(2ζβ, 2ζ² − 1)/β)``, β² = 1 − ζ²; Schwager and Pöschel (2007)."""
    low, high = 0.0, 0.99
    for _ in range(60):
        ratio = 0.5 * (low + high)
        root = math.sqrt(1.0 - ratio**2)
        found = math.exp(-ratio / root * math.atan2(2.0 * ratio * root, 2.0 * ratio**2 - 1.0))
        low, high = (ratio, high) if found > restitution else (low, ratio)
    return ratio


def test_limits_are_parts_of_a_step():
    assert 0.0 < OF_BODIES < OF_CONTACTS < 1.0


@pytest.mark.full
@pytest.mark.parametrize(("velocity", "most"), [(1e-2, 1e-6), (1e-4, 2e-4)])
def test_an_explicit_method_resolves_smooth_dry_friction(velocity, most):
    """Whose slope at rest is far above its mean: paths that slip and nearly stick, at the automatic step."""
    network = il.Network(
        {"a": il.LinearOscillator(damping=0.05, stiffness=4.0)},
        excitations={"a": il.Harmonic(1.5, frequency=0.6)},
        couplings={"f": il.Coupling("a", il.WALL, il.FrictionCoupling(1.0, velocity=velocity))},
    )
    options = {"initial": {"displacement": {"a": 0.3}}, "integrator": il.RungeKutta4(), "record": il.Trajectory(1.0)}
    path = il.simulate(network, 20.0, **options)

    def right_side(t, y):
        return [y[1], 1.5 * math.sin(0.6 * t) - 4.0 * y[0] - 0.05 * y[1] - math.tanh(y[1] / velocity)]

    exact = solve_ivp(right_side, (0.0, 20.0), [0.3, 0.0], "Radau", path.time.values, rtol=1e-9, atol=1e-11).y
    np.testing.assert_allclose(path.displacement[0, :, 0], exact[0], atol=most)
    np.testing.assert_allclose(path.velocity[0, :, 0], exact[1], atol=most)
