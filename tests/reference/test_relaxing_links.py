"""Exact laws with couplings whose forces relax, against Lyapunov's equation with their forces as states."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

import impactlab as il

PATCH = il.PiezoelectricCoupling(0.4, capacitance=1.0, resistance=1.0)
BODIES = {
    "a": il.LinearOscillator(mass=1.5, stiffness=2.0, damping=0.3),
    "b": il.LinearOscillator(mass=0.5, stiffness=4.0, damping=0.1),
}
NOISES = {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(0.2)}


def harvester(damping=0.04):
    body = il.LinearOscillator(mass=1.0, stiffness=1.0, damping=damping)
    motion = il.BaseMotion(il.WhiteNoise(1.0))
    return il.Network({"a": body}, {}, {"ground": motion}, {"patch": il.Coupling("a", il.WALL, PATCH)})


def test_mean_power_of_a_harvester():
    power = il.exact(harvester()).statistics().mean_square_law_state.sel(state="patch.voltage") / PATCH.resistance
    assert power.item() == pytest.approx(2.026833970, rel=1e-9)


def drift_of(weights, law):
    """Drift of displacements, velocities, and the force F of spring and damper in series along ``e = w·x``."""
    beside, stiffness, damping = law
    mass, own_damping, own_stiffness = np.array(
        [(item.mass, item.damping, item.stiffness) for item in BODIES.values()]
    ).T
    drift = np.zeros((5, 5))
    drift[:2, 2:4] = np.eye(2)
    drift[2:4, :2] = -(np.diag(own_stiffness) + beside * np.outer(weights, weights)) / mass[:, None]
    drift[2:4, 2:4] = -np.diag(own_damping / mass)
    drift[2:4, 4] = -weights / mass
    drift[4, 2:4] = stiffness * weights
    drift[4, 4] = -stiffness / damping
    return drift


@pytest.mark.parametrize("second", ["b", il.Combination({"b": 0.5})], ids=["difference", "combination"])
@pytest.mark.parametrize(
    ("law", "same", "gain"),
    [
        (il.MaxwellCoupling(3.0, damping=2.0), (0.0, 3.0, 2.0), 1.0),
        (il.ZenerCoupling(1.0, relaxing_stiffness=3.0, damping=2.0), (1.0, 3.0, 2.0), 1.0),
        (PATCH, (0.0, 0.16, 0.16), -1.0 / 0.4),
    ],
    ids=lambda item: type(item).__name__,
)
def test_moments_and_correlations(law, same, gain, second):
    law_of = il.exact(il.Network(BODIES, {}, NOISES, {"link": il.Coupling("a", second, law)}))
    weights = np.array([-1.0, 1.0 if second == "b" else 0.5])
    growth = np.diag(
        [0.0, 0.0, *(2.0 * np.pi * NOISES[name].spectral_density / BODIES[name].mass ** 2 for name in BODIES), 0]
    )
    drift = drift_of(weights, same)
    known = solve_continuous_lyapunov(drift, -growth)
    found = law_of.statistics()
    np.testing.assert_allclose(found.mean_square_displacement, np.diag(known)[:2], rtol=1e-8)
    np.testing.assert_allclose(found.mean_square_velocity, np.diag(known)[2:4], rtol=1e-8)
    states = [gain**2 * known[4, 4], weights @ known[:2, :2] @ weights]
    np.testing.assert_allclose(found.mean_square_law_state, states, rtol=1e-8)
    lags = np.array([0.0, 0.7, 3.0])
    later = [(expm(lag * drift) @ known)[0, 0] for lag in lags]
    np.testing.assert_allclose(law_of.autocovariance("a", "displacement", lags), later, rtol=3e-7)


def test_contacts_that_matter_are_refused_as_before():
    stop = il.Contact("a", il.WALL, il.HertzContact(1.0), clearance=1.0)
    with pytest.raises(il.NoExactReference, match="coupling 'patch' depends on the past, by the states of Piezo"):
        il.exact(harvester().replace(contacts={"stop": stop}))
    far = il.exact(
        harvester().replace(contacts={"stop": il.Contact("a", il.WALL, il.HertzContact(1.0), clearance=100.0)})
    )
    assert far.statistics().contact_ratio.item() == 0.0


@pytest.mark.full
def test_simulations_agree():
    """At a step at which the bias is below the errors."""
    run = il.simulate(harvester(damping=0.2), 400.0, realizations=128, step=0.05, rng=1)
    rows = il.compare(run, il.exact(harvester(damping=0.2))).to_dataframe()
    assert set(rows.label) == {"a", "patch.voltage", "patch.last"}
    assert rows.z.abs().max() < 4.0
