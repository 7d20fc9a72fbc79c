"""Exact law of linear bodies on linear couplings: Gaussian under white and filtered noise, a sum over lines under
cosines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, expm, solve_continuous_lyapunov
from scipy.special import j0, ndtr

from impactlab.errors import NoExactReference
from impactlab.linear.noise_motion import NoiseMotion
from impactlab.linear.systems import LinearSystem
from impactlab.linear.transitions import drift_matrix
from impactlab.machine import NUMBERS_AT_A_TIME
from impactlab.reference.marginal import Marginal

OUTERMOST = 10.0  # standard deviations beyond which a density is 0
_FAR = 37.5  # standard deviations after which a Gaussian is no number


@dataclass(frozen=True, eq=False)
class CosineResponse:
    """What a sum of cosines of random phases moves, or a harmonic force, which over its cycle is such a cosine."""

    frequencies: np.ndarray  # (line,) of the force (rad s-1)
    amplitudes: np.ndarray  # (line,) of the force (N)
    receptance: np.ndarray  # (line, body) complex displacement of each body by unit force (m N-1)
    harmonic: bool = False  # whether phases are those of the receptance at t = 0, not random ones


@dataclass(frozen=True, eq=False)
class GaussianLaw:
    """Stationary law of linear bodies on linear couplings, at any temperatures.

    Under white noise the state (x, v) is Gaussian, with mean 0 and the covariance Σ that
    solves ``L Σ + Σ Lᵀ + N = 0``, L the drift and N the noise; under filtered noise the states of
    its filter are states of the same equation. Under `PoissonImpulses` mean and covariance are known
    (Campbell's theorem). Each cosine adds
    ``½ |A H(ω)|²`` and is independent of all others, H being the receptance; the sum is
    not Gaussian, but its characteristic function is known, ``exp(−σ² t²/2) Π J₀(|A H| t)``,
    and gives the density of a displacement or a velocity by one sum.
    """

    bodies: tuple[str, ...]  # names
    system: LinearSystem
    """Their motion and the white noise on them; every motion is damped, and springs hold all bodies."""
    temperature: float | None = None  # temperature of all bodies, if it is one and no coupling has damping (J)
    cosines: Sequence[CosineResponse] = ()  # the sums of cosines
    motions: Sequence[NoiseMotion] = ()  # what each noise that is not white does to all of the bodies

    @cached_property
    def _not_gaussian(self) -> str:
        """Name of the noises for which only mean and covariance are known; empty where the law is."""
        return next((item.called for item in self.motions if not item.gaussian), "")

    @property
    def shot(self) -> bool:
        """Whether only mean and covariance are known."""
        return bool(self._not_gaussian)

    def refuse_density(self, body: str) -> None:
        """Refuse what depends on more than mean and covariance where these are all that is known."""
        if self.shot:
            raise NoExactReference(
                f"The density of {body!r} is not known, because {self._not_gaussian} drive it: mean and covariance "
                "are; under il.WhiteNoise it is Gaussian."
            )

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of (x, v), (2 body, 2 body)."""
        return np.asarray(self._normal + self._of_cosines)

    @cached_property
    def _normal(self) -> np.ndarray:
        """Covariance of what all but the cosines move."""
        result = self._white.copy()
        for item in self.motions:
            assert item.covariance is not None  # every motion is damped
            result += item.covariance[item.states :, item.states :]
        return result

    @cached_property
    def _white(self) -> np.ndarray:
        """Covariance of what the white noises move."""
        mass, count = self.system.mass, len(self.bodies)
        result = np.zeros((2 * count, 2 * count))
        if self.temperature is not None:
            result[:count, :count] = self.temperature * np.linalg.inv(self.system.stiffness)
            result[count:, count:] = np.diag(self.temperature / mass)
        elif self.system.intensity.any():
            # in coordinates whose squares are energies, where only damping is not skew
            root, inverse = np.linalg.cholesky(self.system.stiffness), 1.0 / np.sqrt(mass)
            turning = inverse[:, None] * root
            braking = inverse[:, None] * self.system.damping * inverse
            drift = np.block([[np.zeros((count, count)), turning.T], [-turning, -braking]])
            noise = np.zeros((2 * count, 2 * count))
            noise[count:, count:] = 2.0 * np.pi * self.system.intensity / np.sqrt(np.outer(mass, mass))
            for _ in range(2):  # what rounding leaves is solved for again
                result += solve_continuous_lyapunov(drift, -(noise + drift @ result + result @ drift.T))
            back = block_diag(np.linalg.inv(root).T, np.diag(inverse))
            result = back @ result @ back.T
        return result

    @cached_property
    def _of_cosines(self) -> np.ndarray:
        """Covariance of what the cosines move."""
        count = len(self.bodies)
        result = np.zeros((2 * count, 2 * count))
        for item in self.cosines:
            moved = math.sqrt(0.5) * item.amplitudes[:, None] * item.receptance
            both = np.concatenate([moved, 1j * item.frequencies[:, None] * moved], axis=1)
            result += (both.T @ both.conj()).real
        return result

    def at_phase(self, weights: Mapping[str, float], quantity: str, times: np.ndarray) -> tuple[np.ndarray, float]:
        """Return mean, (time,), and variance of a weighted sum of bodies at times in the cycle of harmonic forces."""
        places, factors = self._places(weights, "displacement")
        row = 1 if quantity == "velocity" else 0
        mean = np.full(len(times), sum((float(item.mean[row, places] @ factors) for item in self.motions), 0.0))
        variance = self.covariance_of(weights, weights, quantity)
        for item in self.cosines:
            if item.harmonic:
                moved = item.amplitudes * (item.receptance[:, places] @ factors) * (1j * item.frequencies) ** row
                mean += (np.exp(1j * np.multiply.outer(times, item.frequencies)) @ moved).real
                variance -= 0.5 * float((np.abs(moved) ** 2).sum())
        return mean, max(variance, 0.0)

    def moments(self, body: str) -> tuple[float, float]:
        """Return the mean (m) and the variance (m2) of a body's displacement."""
        mean = sum(float(item.mean[0, self.bodies.index(body)]) for item in self.motions)
        return mean, self.variance(body, "displacement")

    def variance(self, body: str, quantity: str) -> float:
        """Return the variance of a displacement (m2) or a velocity (m2 s-2)."""
        place = self._place(body, quantity)
        return float(self.covariance[place, place])

    def covariance_of(self, first: Mapping[str, float], second: Mapping[str, float], quantity: str) -> float:
        """Return the covariance of the displacements (m2) or velocities (m2 s-2) of two weighted sums of bodies."""
        (rows, left), (columns, right) = self._places(first, quantity), self._places(second, quantity)
        return float(left @ self.covariance[np.ix_(rows, columns)] @ right)

    def relative_variances(self, weights: Mapping[str, float]) -> tuple[float, float]:
        """Return the variances of the displacement and the velocity of a weighted sum of bodies."""
        place, speed = (self.covariance_of(weights, weights, quantity) for quantity in ("displacement", "velocity"))
        return place, speed

    def density_of(self, body: str, quantity: str, values: np.ndarray) -> np.ndarray:
        """Return the density of a displacement (m-1) or a velocity (s m-1)."""
        self.refuse_density(body)
        deviation = math.sqrt(self.variance(body, quantity))
        z = values / deviation
        if not self.cosines:
            return np.asarray(np.exp(-0.5 * z**2) / (math.sqrt(2.0 * math.pi) * deviation))
        t, weights = self._characteristic(body, quantity)
        density = np.maximum(np.cos(np.multiply.outer(z, t)) @ weights, 0.0)
        return np.where(np.abs(z) < OUTERMOST, density, 0.0) / deviation

    def probability_of(self, body: str, quantity: str, values: np.ndarray) -> np.ndarray:
        """Return the probability that a displacement or a velocity is smaller."""
        self.refuse_density(body)
        z = values / math.sqrt(self.variance(body, quantity))
        if not self.cosines:
            return np.asarray(ndtr(z))
        t, weights = self._characteristic(body, quantity)
        return np.asarray(0.5 + np.sin(np.multiply.outer(np.clip(z, -OUTERMOST, OUTERMOST), t)) @ (weights / t))

    def marginal(self, body: str, speed: float) -> Marginal:
        """Return the law of a body's displacement, its velocity having some standard deviation (m s-1)."""
        self.refuse_density(body)
        if self.cosines:
            raise NoExactReference(
                f"The rate at which {body!r} crosses levels is not known, because it is driven by sums of cosines; "
                "under white noise alone it is."
            )
        deviation = math.sqrt(self.variance(body, "displacement"))
        return Marginal(
            lambda places: self.density_of(body, "displacement", places),
            lambda level: float(ndtr(-level / deviation)),
            deviation * np.linspace(-_FAR, _FAR, 601),
            speed,
        )

    def joint_density(
        self,
        first: str,
        second: str,
        x: np.ndarray,
        y: np.ndarray,
        quantities: tuple[str, str] = ("displacement", "displacement"),
    ) -> np.ndarray:
        """Return the joint density of displacements or velocities of two bodies."""
        self.refuse_density(first)
        if self.cosines:
            raise NoExactReference(
                f"The joint density of {first!r} and {second!r} is not known, because they are driven by sums of "
                "cosines; under white noise alone it is Gaussian."
            )
        places = [self._place(name, quantity) for name, quantity in zip((first, second), quantities, strict=True)]
        part = self.covariance[np.ix_(places, places)]
        root = np.linalg.cholesky(part)
        z = x / root[0, 0]
        rest = (y - root[1, 0] * z) / root[1, 1]
        return np.asarray(np.exp(-0.5 * (z**2 + rest**2)) / (2.0 * math.pi * root[0, 0] * root[1, 1]))

    def autocovariance(self, weights: Mapping[str, float], quantity: str, lags: np.ndarray) -> np.ndarray:
        """Return ``E[q(t) q(t + lag)]`` of the displacement (m2) or velocity (m2 s-2) of a weighted sum of bodies."""
        (places, factors), count = self._places(weights, quantity), len(self.bodies)
        result = np.zeros(len(lags))
        if self.system.intensity.any():
            drift = drift_matrix(self.system.mass, self.system.damping, self.system.stiffness)
            step = max(1, NUMBERS_AT_A_TIME // (2 * count) ** 2)
            for first in range(0, len(lags), step):
                part = slice(first, first + step)
                flows = expm(np.abs(lags[part])[:, None, None] * drift)
                result[part] = factors @ flows[:, places] @ (self._white[:, places] @ factors)
        for item in self.motions:
            result += item.autocovariance(places, factors, lags)
        for frequencies, amplitudes in self._amplitudes(weights, quantity):
            step = max(1, NUMBERS_AT_A_TIME // len(frequencies))
            for first in range(0, len(lags), step):
                part = slice(first, first + step)
                result[part] += np.cos(np.multiply.outer(lags[part], frequencies)) @ (0.5 * amplitudes**2)
        return result

    def spectrum(self, weights: Mapping[str, float], quantity: str, frequencies: np.ndarray) -> np.ndarray:
        """Return the two-sided spectral density of a weighted sum of bodies (m2 s rad-1 or m2 s-1 rad-1)."""
        if self.cosines:
            raise NoExactReference(
                f"The spectrum of {' and '.join(map(repr, weights))} has no density: sums of cosines have line "
                "spectra. Under white noise alone it has one."
            )
        places, factors = self._places(weights, "displacement")
        along = np.zeros(len(self.bodies))
        along[places] = factors
        response = self.system.receptance(along, frequencies)
        own = np.diag(self.system.intensity)
        result = np.abs(response) ** 2 @ own
        if (between := self.system.intensity - np.diag(own)).any():
            result += ((response @ between) * response.conj()).sum(axis=1).real
        for item in self.motions:
            result += item.spectrum(along, frequencies)
        return np.asarray(result * frequencies**2 if quantity == "velocity" else result)

    def __str__(self) -> str:
        if self.cosines and all(item.harmonic for item in self.cosines):
            return "linear motion under harmonic forces, over their cycle"
        if self.cosines:
            return "linear motion under sums of cosines"
        if self.shot:
            return f"{self._not_gaussian}, mean and covariance"
        if self.motions:
            return f"{self.motions[0].called}, Gaussian"
        one = self.temperature is not None
        if not one and (self.system.intensity != np.diag(np.diag(self.system.intensity))).any():
            return "correlated noises, Gaussian"
        return f"temperature {self.temperature:.6g} J, Gaussian" if one else "several temperatures, Gaussian"

    def _place(self, body: str, quantity: str) -> int:
        return self.bodies.index(body) + (len(self.bodies) if quantity == "velocity" else 0)

    def _places(self, weights: Mapping[str, float], quantity: str) -> tuple[list[int], np.ndarray]:
        """Return the places of bodies among (x, v), and their weights."""
        return [self._place(name, quantity) for name in weights], np.array(list(weights.values()))

    def _amplitudes(self, weights: Mapping[str, float], quantity: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the frequencies and the amplitudes of the cosines in a displacement or a velocity."""
        (places, factors), result = self._places(weights, "displacement"), []
        for item in self.cosines:
            amplitudes = item.amplitudes * np.abs(item.receptance[:, places] @ factors)
            result.append((item.frequencies, amplitudes * item.frequencies if quantity == "velocity" else amplitudes))
        return result

    def _characteristic(self, body: str, quantity: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the nodes t, in units of 1/σ, and the weights of ``p(z) = Σ weight cos(t z)``.

        The sum over nodes that are 2π/L apart is the density repeated after L with alternating
        signs; L is twice the reach, so that only tails of ``exp(−_REACH²/2)`` overlap.
        """
        place = self._place(body, quantity)
        variance = float(self.covariance[place, place])
        amplitudes = np.concatenate([part for _, part in self._amplitudes({body: 1.0}, quantity)]) / math.sqrt(variance)
        normal, spacing = float(self._normal[place, place]) / variance, math.pi / OUTERMOST
        values: list[np.ndarray] = []
        # nodes of the characteristic function, at most 4000
        while len(values) * 16 < 4000:
            t = spacing * (np.arange(16 * len(values), 16 * len(values) + 16) + 0.5)
            values.append(np.exp(-0.5 * normal * t**2) * j0(np.multiply.outer(t, amplitudes)).prod(axis=1))
            if np.abs(values[-1]).max() < 1e-17:
                weights = spacing / math.pi * np.concatenate(values)
                return spacing * (np.arange(len(weights)) + 0.5), weights
        raise NoExactReference(
            f"The density of {body!r} is not computed, because few cosines dominate its {quantity} and it is not "
            "smooth. Use more components, or add white noise."
        )
