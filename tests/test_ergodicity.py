"""Driven networks with several stable motions: means over realizations depend on how these began."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import impactlab as il
from impactlab.ergodicity import memory_of
from impactlab.kernels.sums import STATE_ROWS, VV, XX


class Sine(il.Excitation):
    """A force."""

    amplitude: float = il.parameter(units="N")
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def force(time, amplitude, frequency):
        return amplitude * math.sin(frequency * time)


def driven(frequency):
    """A body that a force drives into a wall, and that may knock on a heavy one, which noise moves a little."""
    return il.Network(
        {
            "light": il.LinearOscillator(damping=0.3),
            "heavy": il.LinearOscillator(mass=20.0, stiffness=10.0, damping=10.0),
        },
        {
            "wall": il.Contact("light", il.WALL, il.LinearContact(1000.0)),
            "knock": il.Contact("heavy", "light", il.LinearContact(1.0), clearance=0.3),
        },
        {"light": Sine(frequency**2, frequency=frequency), "heavy": il.WhiteNoise(0.3 / math.pi)},
    )


def test_a_network_with_one_motion_is_no_cause_for_a_warning(recwarn):
    il.simulate(driven(3.0), 60.0, realizations=128, rng=1)
    assert not recwarn


def test_the_error_holds_what_another_start_leads_to():
    with pytest.warns(il.AccuracyWarning, match=r"settle into different motions: .* by \d+\.?\d* %"):
        usual = il.simulate(driven(6.0), 60.0, realizations=128, rng=1)
    far = {"displacement": {"light": 0.0, "heavy": -0.5}, "velocity": {"light": 60.0, "heavy": 0.0}}
    other = il.simulate(driven(6.0), 60.0, realizations=128, rng=1, initial=far, spin_up=usual.spin_up)
    difference = np.abs(usual.mean_square_velocity - other.mean_square_velocity)
    assert (difference < 2.0 * usual.mean_square_velocity_standard_error).all()


def sums(motion, batches, rng):
    """Sums of a batch each (batch, row, body, realization), where squares swing by 0.1 about those of a motion."""
    result = np.zeros((batches, STATE_ROWS, 1, len(motion)))
    result[:, [XX, VV], 0] = motion + 0.1 * rng.standard_normal((batches, 2, len(motion)))
    return result


PLAN = SimpleNamespace(
    start="stationary", spin_up_steps=100, settled=True, relaxation=1.0, forced=np.array([0]), trusted=True, step=0.05,
    random=np.array([True]), bodies=("a",),
)  # fmt: skip


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
