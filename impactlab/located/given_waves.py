"""Motions of bodies that are given: constants and waves."""

from __future__ import annotations

import cmath
from typing import NamedTuple

import numpy as np

from impactlab.assembly.mechanism import given_motions
from impactlab.assembly.model import Model
from impactlab.located.scenes import wave_of


class Wave(NamedTuple):
    """A given motion: a constant, and a wave."""

    constant: float
    frequency: float
    amplitude: complex

    def at(self, times: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Return displacements and velocities at some times."""
        turning = self.amplitude * np.exp(1j * self.frequency * times)
        return self.constant + turning.real, (1j * self.frequency * turning).real

    def means(self, begin: float, length: float) -> list[float]:
        """Return the means of x, x², v and v² over some time."""
        a, omega = self.constant, self.frequency
        u = self.amplitude * cmath.exp(1j * omega * begin)
        if not u:
            return [a, a * a, 0.0, 0.0]

        def wave(times: int) -> complex:
            angle = 1j * times * omega * length
            return (cmath.exp(angle) - 1.0) / angle

        first, second, half = (u * wave(1)).real, (u * u * wave(2)).real, 0.5 * abs(u) ** 2
        velocity = (1j * omega * u * wave(1)).real
        return [a + first, a * a + 2.0 * a * first + half + 0.5 * second, velocity, omega**2 * (half - 0.5 * second)]


def given_waves(model: Model) -> list[tuple[int, Wave]]:
    """Return the slots of bodies of given motion, and their motions."""
    return [(slot, Wave(*wave_of(item))) for slot, item in given_motions(model)]
