"""Means and slopes of harmonic forces over many steps at once, against closed forms and the rule of single steps."""

import math

import numpy as np
import pytest

import impactlab as il
from impactlab.linear.band_limited import PLACES, WIDEST, panel_steps, panel_weights
from impactlab.linear.given_functions import NODES, mean_and_slope


@pytest.mark.parametrize("angle", [1e-3, 0.05, 3.0 / 32.0, 0.1, 0.3, 0.7, 1.4, 2.9])
def test_weights_give_mean_and_slope_of_a_cosine(angle):
    """To rounding, as the mean and the slope of the cosine over a step by their integrals."""
    (steps,) = panel_steps(np.array([angle]), 1.0)
    assert steps * angle <= WIDEST
    phases = np.random.default_rng(1).uniform(0.0, 2.0 * math.pi, (100, 1))
    both = (np.cos(steps * angle * PLACES + phases) @ panel_weights(int(steps))).reshape(100, steps, 2)
    middle, half = angle * (np.arange(steps) + 0.5) + phases, 0.5 * angle
    np.testing.assert_allclose(both[..., 0], np.cos(middle) * np.sinc(half / math.pi), atol=2e-14)
    values = np.cos(angle * (np.arange(steps)[:, None] + NODES) + phases[..., None])
    np.testing.assert_allclose(both, np.stack(mean_and_slope(values), axis=-1), atol=3e-14)


def test_panels_are_as_long_as_the_frequency_lets_them_be():
    highest = np.array([0.0, 0.05, 0.1, 1.0, 3.0, 3.1, math.inf])
    assert panel_steps(highest, 1.0).tolist() == [32, 32, 16, 2, 1, 0, 0]


class Unknown(il.Excitation):
    """A harmonic force of which nothing is known."""

    amplitude: float = il.parameter()
    frequency: float = il.parameter()

    @staticmethod
    def force(time, amplitude, frequency):
        return amplitude * math.sin(frequency * time)


class Gated(il.Harmonic):
    """A harmonic force that begins at time 0, with the fields of another."""

    @staticmethod
    def force(time, amplitude, frequency, phase):
        return amplitude * math.sin(frequency * time + phase) if time >= 0.0 else 0.0


def paths(*forces):
    bodies = {f"body {number}": il.LinearOscillator.from_frequency(4.0, 0.05) for number in range(len(forces))}
    network = il.Network(bodies, {}, dict(zip(bodies, forces, strict=True)))
    return il.simulate(network, 20.0, step=0.01, spin_up=0.505, record=il.Trajectory(0.05)).displacement[0].T


@pytest.mark.full
def test_a_force_of_known_frequency_moves_a_body_as_any_other_force_does():
    known, unknown = paths(il.Harmonic(2.0, frequency=5.0), Unknown(2.0, frequency=5.0))
    np.testing.assert_allclose(known, unknown, atol=1e-13 * float(abs(known).max()))


@pytest.mark.full
def test_forces_of_different_frequencies_do_not_change_each_other():
    slow, fast = il.Harmonic(2.0, frequency=5.0), il.Harmonic(2.0, frequency=50.0)
    together = paths(slow, fast, il.Chirp(1.0, start_frequency=1.0, end_frequency=9.0, duration=9.0))
    for number, force in enumerate((slow, fast)):
        np.testing.assert_array_equal(together[number], paths(force)[0])


@pytest.mark.full
def test_a_kernel_of_its_own_makes_the_frequency_unknown():
    assert il.Harmonic(2.0, frequency=5.0).highest_frequency == 5.0
    assert il.ConstantForce(1.0).highest_frequency == 0.0
    assert Gated(2.0, frequency=5.0).highest_frequency == math.inf
    late, always = paths(Gated(2.0, frequency=5.0), il.Harmonic(2.0, frequency=5.0))
    assert not np.allclose(late, always)
