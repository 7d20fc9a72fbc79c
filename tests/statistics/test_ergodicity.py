"""Driven networks with several stable motions: means over realizations depend on how these began."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import impactlab as il
from impactlab.kernels.rows import STATE_ROWS, VV, XX
from impactlab.statistics.ergodicity import STARTS, memory_of


def driven(frequency):
    """A body that a force drives into a wall and against another one, which noise moves."""
    return il.Network(
        {
            "driven": il.LinearOscillator(mass=0.031, damping=0.07, stiffness=1.3),
            "shaken": il.LinearOscillator(mass=0.7, damping=2.0, stiffness=16.0),
        },
        {
            "wall": il.Contact("driven", il.WALL, il.LinearContact(45.0)),
            "knock": il.Contact("shaken", "driven", il.LinearContact(1.4), clearance=0.9),
        },
        {"driven": il.Harmonic(60.0, frequency=frequency), "shaken": il.WhiteNoise(0.3)},
    )


@pytest.mark.full
def test_a_network_with_one_motion_is_no_cause_for_a_warning(recwarn):
    il.simulate(driven(45.0), 9.0, realizations=128, rng=1)
    assert not recwarn


@pytest.mark.full
def test_the_error_holds_what_another_start_leads_to():
    with pytest.warns(il.AccuracyWarning, match=r"settle into different motions: .* by \d+\.?\d* %"):
        usual = il.simulate(driven(53.0), 9.0, realizations=128, rng=1)
    fast = {"velocity": {"driven": 100.0}}
    other = il.simulate(driven(53.0), 9.0, realizations=128, rng=1, initial=fast, spin_up=usual.spin_up)
    difference = abs(usual.mean_square_velocity - other.mean_square_velocity).sel(oscillator="driven")
    error = usual.mean_square_velocity_standard_error.sel(oscillator="driven")
    assert 0.01 * error < difference < 2.0 * error


def alone(frequency):
    """A body that a force drives into a wall; nothing is random."""
    return il.Network(
        {"a": il.LinearOscillator(damping=0.3, stiffness=1.0)},
        {"wall": il.Contact("a", il.WALL, il.LinearContact(1000.0))},
        {"a": il.Harmonic(frequency**2, frequency=frequency)},
    )


@pytest.mark.full
def test_a_motion_without_noise_begins_elsewhere_too(recwarn):
    il.simulate(alone(2.5), 20.0)
    assert not recwarn
    with pytest.warns(il.AccuracyWarning, match=r"depends on how it begins: .* of 'a' differs by [0-9.]+ %"):
        ds = il.simulate(alone(3.0), 30.0, integrator=il.ExactFlow())  # chaos
    fast = {"velocity": {"a": STARTS[0] * math.sqrt(ds.mean_square_velocity.item())}}
    other = il.simulate(alone(3.0), 30.0, initial=fast, spin_up=ds.spin_up, integrator=il.ExactFlow())
    assert abs(other.mean_square_displacement / ds.mean_square_displacement - 1.0) > 0.01
    with pytest.warns(il.AccuracyWarning, match="Averages along this path are known to"):
        il.simulate(alone(3.0), 30.0, initial="rest", spin_up=ds.spin_up, integrator=il.ExactFlow())


def sums(motion, batches, rng):
    """Sums of a batch each (batch, row, body, realization), where squares swing by 0.1 about those of a motion."""
    result = np.zeros((batches, STATE_ROWS, 1, len(motion)))
    result[:, [XX, VV], 0] = motion + 0.1 * rng.standard_normal((batches, 2, len(motion)))
    return result


PLAN = SimpleNamespace(
    start=SimpleNamespace(given=False),
    clock=SimpleNamespace(spin_up_steps=100, settled=True, relaxation=1.0, step=0.05),
    led=True,
    realizations=SimpleNamespace(trusted=True),
    noise=SimpleNamespace(random=np.array([True])),
    system=SimpleNamespace(bodies=("a",)),
)


@pytest.mark.parametrize(("realizations", "batches"), [(400, 2), (8, 8)])
def test_what_is_remembered_is_not_averaged_away(realizations, batches):
    rng, steps = np.random.default_rng(1), np.full(batches, 1000.0)
    motion = 1.0 + (np.arange(realizations) % 2)
    found = memory_of(PLAN, sums(motion, batches, rng), steps, realizations > 64)
    assert found.warning
    units = realizations if realizations > 64 else realizations * batches
    # half of the mean square is between the motions, whatever the number of realizations
    assert 0.1 + 0.5 / math.sqrt(units) * found.widening(units)[0] == pytest.approx(0.6, rel=0.1)
    same = memory_of(PLAN, sums(np.ones(realizations), batches, rng), steps, realizations > 64)
    assert not same.warning
    assert (same.share == 0.0).all()


def test_realizations_seldom_disagree_by_chance():
    rng, steps = np.random.default_rng(2), np.full(2, 1000.0)
    assert not any(memory_of(PLAN, sums(np.ones(64), 2, rng), steps, True).warning for _ in range(2000))
