"""Oscillators with limit cycles, with two wells, and with none, against closed forms and what is known of them."""

import functools
import math

import numpy as np
import pytest
from scenes import off
from scipy.integrate import quad

import impactlab as il

ONE_STEP = il.ExactFlow(measured=False)
PERIOD, AMPLITUDE = 6.66328685933, 2.00861986087
"""Of van der Pol's equation with μ = 1: C. M. Andersen and J. F. Geer, SIAM J. Appl. Math. 42 (1982) 678."""
PAIRS = 32
BODIES = {
    "van der Pol": il.VanDerPolOscillator(2.0, width=0.5, mass=2.0, stiffness=2.0),
    "Rayleigh": il.RayleighOscillator(1.0, speed=math.sqrt(3.0), stiffness=1.0),
    "double well": il.DoubleWellOscillator(2.0, repulsion=3.0, stiffness=1.0),
    "inverted": il.InvertedOscillator(4.0, stiffness=3.0),
}
FIRST = math.sqrt(2.0)


@functools.cache
def paths(steps):
    """Paths of all over a period of the first, from the largest displacement of its cycle."""
    start = {
        "displacement": {
            "van der Pol": 0.5 * AMPLITUDE, "Rayleigh": AMPLITUDE * (1.0 - AMPLITUDE**2 / 3.0),
            "double well": FIRST, "inverted": 1e-3,
        },
        "velocity": {"Rayleigh": AMPLITUDE},
    }  # fmt: skip
    options = {"initial": start, "record": il.Trajectory(PERIOD / PAIRS), "integrator": ONE_STEP}
    held = {"none": il.Coupling("inverted", il.WALL, il.LinearCoupling(0.0))}
    network = il.Network(BODIES, couplings=held)
    result = il.simulate(network, PERIOD, step=PERIOD / steps, **options).isel(realization=0)
    return {name: result.sel(oscillator=name) for name in BODIES}


@pytest.mark.full
def test_limit_cycle_of_van_der_pol():
    """After a period the body is where it began."""
    errors = []
    for steps in (1024, 2048, 8192):
        path = paths(steps)["van der Pol"]
        errors.append(abs(float(path.displacement[-1]) - 0.5 * AMPLITUDE) + abs(float(path.velocity[-1])))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[2] < 2e-6


@pytest.mark.full
def test_velocity_of_rayleighs_oscillator_moves_as_van_der_pols():
    """That begins at the largest displacement of the same cycle, here with twice the width."""
    one, other = (paths(8192)[name] for name in ("Rayleigh", "van der Pol"))
    np.testing.assert_allclose(one.velocity[1:], 2.0 * other.displacement[1:], atol=5e-6)


@pytest.mark.full
def test_free_motion_over_a_barrier_and_away_from_a_centre():
    """``sqrt(2 κ/c) sech(sqrt(κ) t)`` from its largest place ends at the centre, and ``x cosh(sqrt(κ) t)`` goes on."""
    well, inverted = (paths(8192)[name] for name in ("double well", "inverted"))
    time = well.time.values
    seen = time < 3.0  # errors grow as exp(sqrt(2) t)
    np.testing.assert_allclose(well.displacement[seen], FIRST / np.cosh(FIRST * time[seen]), atol=1e-6)
    np.testing.assert_allclose(inverted.displacement, 1e-3 * np.cosh(time), rtol=1e-5)


def test_wells_and_barrier():
    body = BODIES["double well"]
    assert body.call("residual", body.wells, 0.0) + body.stiffness * body.wells == pytest.approx(0.0, abs=1e-15)
    energy = body.call("residual_potential", body.wells) + 0.5 * body.stiffness * body.wells**2
    assert float(energy) == pytest.approx(-body.barrier, rel=1e-15)
    assert (body.wells, body.barrier) == (1.0, 0.5)
    held = body.replace(stiffness=5.0)
    assert (held.wells, held.barrier) == (0.0, 0.0)


TEMPERATURE = 0.3


def heated(body, contacts=None):
    noise = il.WhiteNoise(body.damping * TEMPERATURE / math.pi)
    return il.Network({"a": body}, contacts or {}, {"a": noise})


BISTABLE = heated(il.DoubleWellOscillator(4.0, repulsion=5.0, stiffness=1.0, damping=0.5))


def test_the_law_of_two_wells_is_that_of_gibbs():
    """By quadrature of ``exp(−V/T)``."""

    def weight(x):
        return math.exp((2.0 * x * x - x**4) / TEMPERATURE)

    total = 2.0 * quad(weight, 0.0, 6.0, epsabs=0.0, epsrel=1e-12)[0]
    square = 2.0 * quad(lambda x: x * x * weight(x), 0.0, 6.0, epsabs=0.0, epsrel=1e-12)[0] / total
    exact = il.exact(BISTABLE)
    assert exact.statistics().mean_square_displacement.item() == pytest.approx(square, rel=1e-9)
    grid = np.array([-1.5, -1.0, 0.0, 0.4])
    expected = np.array([weight(x) for x in grid]) / total
    np.testing.assert_allclose(exact.density("a", "displacement", grid), expected, rtol=1e-9)


def check_against_the_law(network, duration):
    result, exact = il.simulate(network, duration, realizations=256, rng=2), il.exact(network).statistics()
    for name in ("mean_square_displacement", "mean_square_velocity"):
        value, error = (float(result[f"{name}{end}"].item()) for end in ("", "_standard_error"))
        assert error < 1e-2 * exact[name].item()
        assert abs(value - exact[name].item()) < 5e-3 * exact[name].item() + 3.0 * error, name


@pytest.mark.full
def test_two_wells_under_white_noise():
    check_against_the_law(BISTABLE, 100.0)


INVERTED = il.InvertedOscillator(2.0, damping=0.5)


@pytest.mark.campaign
@pytest.mark.parametrize("law", [il.HertzContact(1e4), il.RigidContact(1.0)], ids=repr)
def test_stops_hold_a_body_that_is_repelled(law):
    check_against_the_law(heated(INVERTED, il.backlash("a", il.WALL, law, clearance=0.5, name="stop")), 200.0)


def test_what_nothing_holds_is_refused():
    with pytest.raises(il.InvalidInput, match=r"Nothing holds 'a', which is repelled by 2 N m-1 more than its spring"):
        heated(INVERTED)
    heated(INVERTED.replace(stiffness=2.5))
    one_stop = {"stop": il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.5)}
    with pytest.raises(il.NoExactReference, match=r"neither a spring nor a contact confines it on both sides"):
        il.exact(heated(INVERTED, one_stop))


@pytest.mark.parametrize("name", ["van der Pol", "Rayleigh"])
def test_no_exact_law_of_limit_cycles_with_the_reason(name):
    with pytest.raises(il.NoExactReference) as refusal:
        il.exact(il.Network({"a": BODIES[name]}, {}, {"a": il.WhiteNoise(0.01)}))
    assert "'a' has noise without linear damping of its own, and no temperature" in str(refusal.value)
    assert "the residual force of 'a' depends on the velocity: it has no potential" in str(refusal.value)


@pytest.mark.campaign
@pytest.mark.parametrize("drive", [0.3, 1.0, 5.0])
@pytest.mark.parametrize("cls", [il.VanDerPolOscillator, il.RayleighOscillator])
def test_the_step_under_noise_is_as_fine_as_limit_cycles_need(cls, drive):
    """All statistics are those at an eighth of the step, within 0.5 % and three standard errors."""
    network = il.Network({"a": cls(drive, stiffness=1.0)}, {}, {"a": il.WhiteNoise(0.02)})
    options = {"duration": 200.0, "realizations": 256, "spin_up": 40.0}
    result = il.simulate(network, **options, rng=1)
    finer = il.simulate(network, **options, step=result.attrs["step"] / 8.0, integrator=ONE_STEP, rng=2)
    for name, (difference, error) in off(result, finer).items():
        assert (np.abs(difference) < 5e-3 + 3.0 * error).all(), name
