"""Linear motion under noise with an envelope: its covariance over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from impactlab.linear.noise_motion import NoiseMotion
from impactlab.linear.systems import LinearSystem
from impactlab.linear.transitions import diffusion_matrix, drift_matrix, gaussian_transition, with_delayed_response


class Envelope(NamedTuple):
    """Factor of a noise, linear between samples, and 0 before the first and after the last one."""

    times: np.ndarray  # (sample,) (s)
    values: np.ndarray  # (sample,)

    def over(self, begin: float, end: float) -> tuple[float, float]:
        """Return the value at the end of an interval without samples in it, and the slope there (s-1)."""
        if not self.times[0] <= 0.5 * (begin + end) <= self.times[-1]:
            return 0.0, 0.0
        first, last = np.interp([begin, end], self.times, self.values)
        return float(last), float(last - first) / (end - begin)


ALWAYS = Envelope(np.array([-np.inf, np.inf]), np.ones(2))
"""Envelope of a stationary noise."""


@dataclass(frozen=True, eq=False)
class EnvelopedMotion:
    """What one noise with an envelope moves: states of its filter, if it has one, displacements and velocities."""

    drift: np.ndarray  # (state, state) of all of these under the noise without envelope
    growth: np.ndarray  # (state, state) what the noise adds to their covariance per time
    start: np.ndarray  # (filter state, filter state) covariance of the filter's states where a run begins
    rate: float  # at least the magnitude of the largest eigenvalue of the motion (s-1)
    envelope: Envelope

    @classmethod
    def of_white(cls, system: LinearSystem, intensity: np.ndarray, envelope: Envelope) -> Self:
        """Return the motion under white noises of given spectral densities, (body, body)."""
        drift = drift_matrix(system.mass, system.damping, system.stiffness)
        growth = diffusion_matrix(system.mass, intensity)
        return cls(drift, growth, np.zeros((0, 0)), sum(system.scales), envelope)

    @classmethod
    def of_filtered(cls, motion: NoiseMotion, envelope: Envelope) -> Self:
        """Return the motion under a filtered noise, whose filter begins stationary or at rest."""
        return cls(motion.drift, motion.growth(len(motion.drift)), motion.filter_start(), motion.rate, envelope)

    def covariances(self, begin: float, times: np.ndarray) -> np.ndarray:
        """Return the covariance of (x, v) at increasing times, (time, 2 body, 2 body), for bodies at rest at `begin`.

        Between samples of the envelope transitions are exact: with the time q from a moment to the end of an interval
        the factor is ``e(end) − e' q``, and ``∫ q Φ(q) f`` is a further state of the same linear motion.
        """
        filter_states, size = len(self.start), len(self.drift)
        covariance = np.zeros((size, size))
        covariance[:filter_states, :filter_states] = self.start
        samples = self.envelope.times
        inside = samples[(samples > begin) & (samples < times[-1])]
        known: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        result = np.zeros((len(times), size - filter_states, size - filter_states))
        result[times == begin] = covariance[filter_states:, filter_states:]
        ends = np.unique(np.concatenate([inside, times[times > begin]]))
        for end in ends.tolist():
            step = end - begin
            if step not in known:
                known[step] = self._delayed(step)
            covariance = self._after(covariance, *known[step], *self.envelope.over(begin, end))
            result[times == end] = covariance[filter_states:, filter_states:]
            begin = end
        return result

    def _delayed(self, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return transition and covariance of all states and, after them, of what (x, v) answer to a delayed force."""
        drift = with_delayed_response(self.drift, len(self.start))
        growth = np.zeros(drift.shape)
        growth[: len(self.drift), : len(self.drift)] = self.growth
        a, q = gaussian_transition(drift[None], growth[None], step, self.rate)
        return a[0], q[0]

    def _after(self, covariance: np.ndarray, a: np.ndarray, q: np.ndarray, last: float, slope: float) -> np.ndarray:
        """Return the covariance of all states after an interval."""
        size, filter_states = len(self.drift), len(self.start)
        read = np.zeros((size, len(a)))
        read[:filter_states, :filter_states] = np.eye(filter_states)
        read[filter_states:, filter_states:size] = last * np.eye(size - filter_states)
        read[filter_states:, size:] = -slope * np.eye(size - filter_states)
        moved = read @ a[:, :size]
        moved[filter_states:, filter_states:] = a[filter_states:size, filter_states:size]  # no force, whatever it is
        result = moved @ covariance @ moved.T + read @ q @ read.T
        return np.asarray(0.5 * (result + result.T))
