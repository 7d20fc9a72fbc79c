"""Impulses at random times as numbers, and linear motion under them."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlab.components.component import Component
from impactlab.components.excitation import Excitation
from impactlab.errors import InvalidInput
from impactlab.inputs import finite
from impactlab.linear.noise_motion import NoiseMotion
from impactlab.linear.systems import LinearSystem
from impactlab.linear.transitions import drift_matrix, noise_root

MOST_PER_SAMPLE = 100.0
"""Impulses that may be expected in the time of a sample."""

DEGREES, RESOLVED = (8, 16, 32, 64, 128), 1e-13
"""Degrees of polynomials that are tried in turn for the response, and what the last of their coefficients may be."""


class Impulses(NamedTuple):
    """Independent impulses of normal sizes at the times of a Poisson process."""

    rate: float  # (s-1)
    mean: float  # (N s)
    deviation: float  # (N s)

    @property
    def density(self) -> float:
        """Two-sided spectral density of the white noise with the same covariance (N2 s rad-1)."""
        return self.rate * (self.mean**2 + self.deviation**2) / (2.0 * math.pi)

    @property
    def large(self) -> float:
        """Size that few impulses exceed (N s)."""
        return abs(self.mean) + 2.0 * self.deviation


def impulses_of(excitation: Component) -> Impulses:
    """Return the impulses of an excitation, or refuse what they cannot be."""
    kind, parts = type(excitation).__name__, excitation.impulses()  # type: ignore[attr-defined]
    if not isinstance(parts, tuple | list) or len(parts) != 3:
        raise InvalidInput(
            f"{kind}.impulses must return rate, mean and standard deviation of the sizes, not {reprlib.repr(parts)}."
        )
    result = Impulses(*(finite(f"{kind}.impulses", part) for part in parts))
    if result.rate <= 0.0 or result.deviation < 0.0:
        raise InvalidInput(
            f"{kind}.impulses must return a rate above 0 and a standard deviation of at least 0, not {tuple(result)}."
        )
    return result


@dataclass(frozen=True, eq=False)
class ImpulsiveMotion(NoiseMotion):
    """What impulses at the times of a Poisson process move; without states of its own."""

    name: str  # of the body or the source, which names its random numbers
    excitation: Excitation
    impulses: Impulses
    slots: np.ndarray  # (body,)
    system: LinearSystem  # of these bodies
    weights: np.ndarray  # (body,) of the impulse on each

    called = "impulses at random times"
    gaussian = False

    @property
    def drives(self) -> bool:
        return bool(self.impulses.density)

    @property
    def white(self) -> np.ndarray:
        return self.impulses.density * np.outer(self.weights, self.weights)  # Campbell

    @cached_property
    def _alone(self) -> LinearSystem:
        """The bodies under white noise that moves them by the same mean squares about the mean."""
        return replace(self.system, intensity=np.outer(self.weights, self.weights) * self.impulses.density)

    @property
    def covariance(self) -> np.ndarray | None:
        """Stationary covariance of displacements and velocities; None if there is none."""
        return self._alone.covariance

    @property
    def mean(self) -> np.ndarray:
        """Mean displacements and velocities where a run begins, (2, body); 0 if there is an envelope."""
        return np.zeros_like(self._steady_mean) if self.modulated else self._steady_mean

    @cached_property
    def _steady_mean(self) -> np.ndarray:
        """Mean without envelope, (2, body); displacements in free directions are taken as 0."""
        system, force = self.system, self.impulses.rate * self.impulses.mean * self.weights
        if not force.any() or not system.rates.all():
            return np.zeros((2, len(self.slots)))
        push = np.concatenate([np.zeros(len(system.drift) - len(force)), force / system.mass])
        return np.asarray(system.reduction.T @ np.linalg.solve(system.drift, -push)).reshape(2, -1)

    def variances(self) -> np.ndarray:
        """Return the mean squares of displacement and velocity, infinite where there is no law, (2, body)."""
        result = self._alone.variances() + self._steady_mean**2
        result[0, self.system.free & (result[1] > 0.0)] = np.inf
        return np.asarray(result)

    def start(self) -> np.ndarray:
        """Return a root of the covariance of the normal law that a run begins with; 0 if there is an envelope."""
        count = 2 * len(self.slots)
        return np.zeros((count, count)) if self.modulated or self.covariance is None else noise_root(self.covariance)

    def steps(self, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the flow F of (x, v), and responses at the end of a step (s) to an impulse within it, by its time.

        The responses are (row, coefficient): Chebyshev coefficients for times from -1 to 1, exact to rounding; with an
        envelope, which is linear within the step, also those of the response times the time.
        """
        if self.impulses.rate * step > MOST_PER_SAMPLE:
            raise InvalidInput(
                f"The impulses of {self.name!r} are {self.impulses.rate * step:.3g} in a step of {step:.3g} s; "
                f"{MOST_PER_SAMPLE:g} is the most. Give a shorter step=, or take il.WhiteNoise for as many."
            )
        count = len(self.slots)
        by_body = np.arange(2 * count).reshape(2, -1).T.ravel()  # x and v of a body follow each other
        for degree in DEGREES:
            coefficients = self._coefficients(step, degree)
            sizes = np.abs(coefficients).max(axis=1, keepdims=True)
            last = np.abs(coefficients[:, -2:])
            if (last <= RESOLVED * sizes).all():
                break
        else:
            raise InvalidInput(
                f"The response to impulses of {self.name!r} varies too much in a step of {step:.3g} s. Give a shorter "
                "step=."
            )
        needed = np.flatnonzero((np.abs(coefficients) > RESOLVED * sizes).any(axis=0)).max(initial=0) + 1
        flow = self._flows(np.array([step]))[0][np.ix_(by_body, by_body)]
        response = coefficients[by_body, :needed]
        if self.modulated:
            response = np.concatenate([np.pad(response, ((0, 0), (0, 1))), _times_time(response)])
        return flow, response

    def _flows(self, times: np.ndarray) -> np.ndarray:
        """Return the matrices that carry (x, v) over some times, (time, 2 body, 2 body)."""
        from scipy.linalg import expm

        system = self.system
        units = np.repeat((max(max(system.scales), 1.0 / times.max()), 1.0), len(self.slots))  # entries then are rates
        drift = units[:, None] * drift_matrix(system.mass, system.damping, system.stiffness) / units
        return np.asarray(expm(times[:, None, None] * drift) * units / units[:, None])

    def _coefficients(self, step: float, degree: int) -> np.ndarray:
        """Return the coefficients of the response, (x and v, degree + 1)."""
        places = np.cos(math.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        push = np.concatenate([np.zeros(len(self.slots)), self.weights / self.system.mass])
        values = self._flows(0.5 * step * (1.0 - places)) @ push
        polynomials = np.cos(np.multiply.outer(np.arange(degree + 1), np.arccos(places)))
        coefficients = 2.0 / (degree + 1) * values.T @ polynomials.T
        coefficients[:, 0] *= 0.5
        return np.asarray(coefficients)

    def autocovariance(self, places: Sequence[int], factors: np.ndarray, lags: np.ndarray) -> np.ndarray:
        """Return the autocovariance of a weighted sum of displacements or velocities, places of (x, v), (lag,)."""
        assert self.covariance is not None
        with_sum, result = self.covariance[:, places] @ factors, np.empty(len(lags))
        for index, lag in enumerate(lags):
            flow = self._flows(np.array([abs(lag)]))[0] if lag else np.eye(2 * len(self.slots))
            result[index] = factors @ flow[places] @ with_sum
        return result

    def spectrum(self, along: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
        """Return the spectral density of a sum of displacements with weights, (body,), (m2 s rad-1), (frequency,)."""
        moved = self.system.receptance(along, frequencies) @ self.weights
        return np.asarray(np.abs(moved) ** 2 * self.impulses.density)


def _times_time(coefficients: np.ndarray) -> np.ndarray:
    """Return the Chebyshev coefficients of functions times their variable, one more than given, (row, coefficient)."""
    result = np.zeros((len(coefficients), coefficients.shape[1] + 1))
    result[:, 1:] = 0.5 * coefficients  # T₁ T_n = (T_(n+1) + T_(n−1))/2
    result[:, :-2] += 0.5 * coefficients[:, 1:]
    result[:, 1] += 0.5 * coefficients[:, 0]
    return result
