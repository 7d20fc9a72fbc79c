"""Scenes in which a plausible implementation gives wrong numbers without a word."""

import numpy as np
import pytest
from scenes import base, deviations, plan_of
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.machine import tuned
from impactlab.simulation.ensemble import run_block

NAMES = ("mean_square_displacement", "mean_square_velocity", "contact_ratio", "mean_contact_force")


def test_a_body_at_rest_beside_others():
    network = base().replace(oscillators={"still": il.LinearOscillator(damping=4.0, stiffness=10.0)})
    result = il.simulate(network, 20.0, realizations=64, rng=1)
    alone = il.simulate(base(), 20.0, realizations=64, rng=1)
    assert result.mean_square_displacement.sel(oscillator="still") == 0.0
    both = result.direct_mean_square_displacement.sel(oscillator=["one", "two"])
    np.testing.assert_allclose(both, alone.direct_mean_square_displacement, rtol=1e-12)


def test_an_undamped_body_is_heated_by_contacts_alone():
    """The law is the one of the pair with equal temperatures; a cold start would take long to get there."""
    undamped = il.LinearOscillator(stiffness=4.0 * np.pi**2)
    network = base().replace(oscillators={"two": undamped}, excitations={"two": None})
    result = il.simulate(network, 100.0, realizations=512, rng=1)
    exact = il.exact(network).statistics()
    assert max(deviations(result, exact, NAMES, 0.001).values()) < 3.5


@pytest.mark.full
@pytest.mark.parametrize("undamped", [True, False])
def test_no_error_bars_from_batches_of_unknown_memory(undamped):
    body = il.LinearOscillator(stiffness=10.0, damping=0.0 if undamped else 2.0)
    wall = il.Contact("a", il.WALL, il.KelvinVoigtContact(100.0, damping=5.0))
    network = il.Network({"a": body}, {"wall": wall}, {"a": il.WhiteNoise(1.0)})
    options = {"spin_up": 20.0, "record": il.Density(bins=10, limits=(-2.0, 2.0)), "rng": 1}
    if undamped:
        with pytest.warns(il.AccuracyWarning, match="use at least 64 realizations"):
            result = il.simulate(network, 2000.0, **options)
        assert np.isnan(result.mean_square_displacement_standard_error).all()
        assert np.isnan(result.density_displacement_standard_error).all()
    else:
        result = il.simulate(network, 2000.0, **options)
        assert (result.mean_square_displacement_standard_error > 0.0).all()
        assert (result.density_displacement_standard_error >= 0.0).all()


def test_a_start_in_contact_brings_its_energy():
    """The step resolves the collision, and the path begins where it was put."""
    body = il.LinearOscillator(damping=0.1, stiffness=1.0)
    network = il.Network({"a": body, "b": body}, {"gap": il.Contact("a", "b", il.HertzContact(1e6))})
    result = il.simulate(
        network, 0.5, initial={"displacement": {"a": 1.0}}, step=None, record=il.Trajectory(0.05), rng=1
    )
    assert result.displacement.isel(realization=0, time=0).values.tolist() == [1.0, 0.0]
    compiled = network.compile()
    start = compiled.state(displacement={"a": 1.0})
    path = solve_ivp(compiled.rhs, (0.0, 0.5), start, "DOP853", rtol=1e-10, atol=1e-12, max_step=1e-3)
    final = result.velocity.isel(realization=0, time=-1).values
    np.testing.assert_allclose(final, path.y[2:, -1], rtol=0.03)


def test_an_undamped_excited_body_has_a_largest_step():
    wall = il.Contact("a", il.WALL, il.HertzContact(1e6))
    network = il.Network({"a": il.LinearOscillator(stiffness=1.0)}, {"wall": wall}, {"a": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match="largest stable one"):
        il.simulate(network, 50.0, realizations=64, step=2.0, rng=1)


def test_calls_stay_short_between_distant_samples():
    """Interrupts are looked for after every call, however far apart the samples are."""
    plan = plan_of(base(), duration=400.0, realizations=64, spin_up=0.0, records=[il.Trajectory(400.0)], workers=1)
    calls = []
    block = run_block(plan, 0, tick=calls.append)
    assert max(calls) <= plan.realizations.steps_per_call * plan.realizations.lanes
    assert len([call for call in calls if call]) == -(-plan.clock.steps // plan.realizations.steps_per_call) > 2
    assert block.records[0]["displacement"].shape == (64, 2, 2)


def test_samples_do_not_depend_on_the_length_of_calls():
    options = {
        "duration": 20.0,
        "realizations": 8,
        "spin_up": 1.0,
        "record": [il.Trajectory(0.5), il.Density()],
        "rng": 3,
    }
    with pytest.warns(il.AccuracyWarning):
        whole = il.simulate(base(), **options)
    with tuned(call_seconds=1e-3), pytest.warns(il.AccuracyWarning):
        pieces = il.simulate(base(), **options)
    for name in ("displacement", "density_displacement", "mean_square_velocity"):
        np.testing.assert_array_equal(whole[name], pieces[name])
