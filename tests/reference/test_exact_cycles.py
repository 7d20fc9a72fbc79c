"""Linear networks under harmonic forces: means at phases, the law over the cycle, and simulations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

import impactlab as il

PERIOD = 2.0
OMEGA = 2.0 * np.pi / PERIOD
MASS, DAMPING, STIFFNESS = np.array([1.0, 2.0]), np.diag([0.4, 0.6]), np.array([[9.0, -3.0], [-3.0, 15.0]])
MOTOR = il.Harmonic(1.5, frequency=OMEGA, phase=0.4)
PUMP = il.Harmonic(-0.7, frequency=OMEGA)
TIMES = np.arange(8) * PERIOD / 8


def network(contacts=None, **excitations):
    bodies = {
        "a": il.LinearOscillator(mass=1.0, damping=0.4, stiffness=6.0),
        "b": il.LinearOscillator(mass=2.0, damping=0.6, stiffness=12.0),
    }
    forces = {"a": il.WhiteNoise(0.02), "motor": il.Source(MOTOR, on="a"), "b": PUMP, **excitations}
    return il.Network(bodies, contacts, forces, {"spring": il.Coupling("a", "b", il.LinearCoupling(3.0))})


def slope(t, y):
    force = np.array([1.5 * np.sin(OMEGA * t + 0.4), -0.7 * np.sin(OMEGA * t)])
    return np.concatenate([y[2:], (force - STIFFNESS @ y[:2] - DAMPING @ y[2:]) / MASS])


def steady():
    """Displacements and velocities at the times after 60 periods, (time, state)."""
    run = solve_ivp(slope, (0.0, 62.0 * PERIOD), np.zeros(4), rtol=1e-10, atol=1e-12, t_eval=60.0 * PERIOD + TIMES)
    return run.y.T


def thermal():
    drift = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS / MASS[:, None], -DAMPING / MASS[:, None]]])
    growth = np.zeros((4, 4))
    growth[2, 2] = 2.0 * np.pi * 0.02
    return solve_continuous_lyapunov(drift, -growth)


@pytest.mark.full
@pytest.mark.parametrize(("quantity", "first"), [("displacement", 0), ("velocity", 2)])
def test_means_at_phases_are_the_steady_motion_and_variances_those_of_the_noise(quantity, first):
    law, expected, covariance = il.exact(network()), steady(), thermal()
    for place, name in enumerate("ab", first):
        mean, variance = law.phase_means(name, quantity, TIMES)
        np.testing.assert_allclose(mean, expected[:, place], atol=1e-7)
        assert variance == pytest.approx(covariance[place, place], rel=1e-9)


@pytest.mark.full
def test_the_law_over_the_cycle():
    law, over, covariance = il.exact(network()), steady(), thermal()
    squares = (over**2).mean(axis=0) + np.diag(covariance)  # eight phases of a harmonic motion
    np.testing.assert_allclose(law.statistics().mean_square_displacement, squares[:2], rtol=1e-7)
    np.testing.assert_allclose(law.statistics().mean_square_velocity, squares[2:], rtol=1e-7)
    both = (over[:, 0] * over[:, 1]).mean() + covariance[0, 1]
    assert law.covariance("a", "b", "displacement") == pytest.approx(both, rel=1e-7)


def test_bodies_that_nothing_connects_are_correlated_over_the_cycle():
    alone = il.exact(network().replace(couplings={"spring": None}))
    means = [alone.phase_means(name, "displacement", TIMES)[0] for name in "ab"]
    assert alone.covariance("a", "b", "displacement") == pytest.approx(np.mean(means[0] * means[1]), rel=1e-12)


@pytest.mark.full
def test_a_simulation_has_these_means_densities_and_statistics():
    record = [
        il.PhaseMeans("displacement", period=PERIOD, phases=8),
        il.PhaseMeans("velocity", period=PERIOD, phases=8),
    ]
    result = il.simulate(network(), 40.0 * PERIOD, realizations=128, rng=1, record=record)
    law = il.exact(network())
    for quantity in ("displacement", "velocity"):
        for name in "ab":
            mean, variance = law.phase_means(name, quantity, TIMES)
            for found, expected in ((f"phase_mean_{quantity}", mean), (f"phase_variance_{quantity}", variance)):
                error = result[f"{found}_standard_error"].sel(oscillator=name)
                assert (np.abs(result[found].sel(oscillator=name) - expected) < 4.5 * error).all()
    assert np.abs(il.compare(result, law).z).max() < 4.5


def test_the_density_over_the_cycle_is_the_mean_of_those_at_its_phases():
    law, places = il.exact(network()), np.linspace(-0.6, 0.6, 13)
    means, variance = law.phase_means("a", "displacement", np.arange(400) * PERIOD / 400)
    normal = np.exp(-0.5 * (places[:, None] - means) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
    np.testing.assert_allclose(law.density("a", "displacement", places), normal.mean(axis=1), rtol=1e-8, atol=1e-10)


def test_what_is_refused():
    with pytest.raises(
        il.NoExactReference, match=r"'a' is excited by Chirp, which depends on time.*il\.Harmonic known"
    ):
        il.exact(network(sweep=il.Source(il.Chirp(1.0, start_frequency=1.0, end_frequency=2.0, duration=3.0), on="a")))
    stop = {"stop": il.Contact("a", il.WALL, il.HertzContact(100.0), clearance=0.1)}
    with pytest.raises(il.NoExactReference, match="constant white noise only"):
        il.exact(network(stop))
    with pytest.raises(il.InvalidInput, match="no body 'c'"):
        il.exact(network()).phase_means("c", "displacement", TIMES)
