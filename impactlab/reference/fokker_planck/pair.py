"""Two bodies and a contact between them, as the Fokker–Planck equation sees them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from impactlab.components.composition import Composition
from impactlab.components.contact import Contact
from impactlab.components.evaluation import TIME
from impactlab.errors import NoExactReference
from impactlab.reference.ground import VANISHED

_REFUSAL = "The Fokker–Planck equation of this network is not solved:"
_SAMPLES = 20_001
_ENDS = 0.64, 1.0
"""Energies at which the box of the gap ends, in units of T and the square of its size: the density is 0 there, and
beyond a contact so steep that what ringing leaves must not be pushed out."""

_SLOW, _LITTLE, _MOVED = 0.5, 0.15, 0.45
"""A body follows the other one if the frequency of the closed contact, in its own one, and its standard deviation, in
penetrations, are at most these, and the force at one penetration moves it by at most so many standard deviations."""

_COLD = 0.1
"""Temperature of a body alone, relative to that of the box, below which it has a range and cells of its own."""

_FADE = (0.43, 0.62), (0.56, 0.96)
"""Energies between which densities are faded out, to the left and to the right."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two linear bodies under white noise with one contact between them.

    The first body is that with the higher natural frequency. Where it is the second one of the contact, displacements
    have the other sign, so that ``q = x₁ − x₂ − clearance`` is the gap in which the contact closes at 0.
    """

    names: tuple[str, str]
    sign: float  # of displacements in the network relative to those here
    contact: Contact
    mass: np.ndarray  # (2,)
    damping: np.ndarray  # (2,)
    stiffness: np.ndarray  # (2,)
    intensity: np.ndarray  # (2,) two-sided spectral densities of the forces
    follows: bool = True  # whether the first body may be described as nearly Gaussian
    precise: bool = True  # whether rounding to single precision would be a part of the error that is aimed at

    @classmethod
    def of(cls, network: Composition) -> Pair:
        """Return the pair that a network is, or refuse it with all reasons."""
        reasons = list(_reasons(network))
        if reasons:
            raise NoExactReference("\n- ".join([_REFUSAL, *reasons]))
        (contact,) = network.contacts.values()
        names, sign = (str(contact.first), str(contact.second)), 1.0
        bodies = [network.oscillators[name] for name in names]
        if bodies[1].stiffness / bodies[1].mass > bodies[0].stiffness / bodies[0].mass:
            names, sign, bodies = names[::-1], -1.0, bodies[::-1]
        return cls(
            names,
            sign,
            contact,
            np.array([body.mass for body in bodies]),
            np.array([body.damping for body in bodies]),
            np.array([body.stiffness for body in bodies]),
            np.array([float(network.excitations[name].call("intensity", 0.0)) for name in names]),
        )

    @property
    def real(self) -> np.dtype[Any]:
        """Precision of the numbers of a density; grids of a body that follows are small."""
        return np.dtype(np.float64 if self.precise or self.gaussian else np.float32)

    @property
    def temperatures(self) -> np.ndarray:
        """Temperature that each body alone has (J)."""
        return np.asarray(math.pi * self.intensity / self.damping)

    @property
    def reduced_mass(self) -> float:
        return float(1.0 / (1.0 / self.mass).sum())

    @property
    def rate(self) -> float:
        """Rate at which the slowest motion of a body alone decays (s-1)."""
        friction = 0.5 * self.damping / self.mass
        root = np.sqrt(np.maximum(friction**2 - self.stiffness / self.mass, 0.0))
        return float((self.stiffness / self.mass / (friction + root)).min() if root.any() else friction.min())

    def force(self, gap: np.ndarray) -> np.ndarray:
        """Return the force of the contact (N) at values of q."""
        return self.contact.law.evaluate(gap)

    @cached_property
    def first_node(self) -> float:
        """Place of the first node inside the contact, in cells.

        A sum over nodes of what begins as δ^p, cut off by 0, is wrong by ζ(−p, place) to leading
        order: the place is the zero of this Hurwitz zeta function (for Hertz's law 0.359).
        """
        from scipy.optimize import brentq

        small = 1e-6 * math.sqrt(float(self.temperatures.max() / self.stiffness.sum()))
        force, twice = self.force(np.array([small, 2.0 * small]))
        power = math.log2(twice / force) if force > 0.0 and twice > 0.0 else 1.0
        return float(brentq(lambda place: _hurwitz(min(max(power, 0.5), 4.0), place), 0.0, 0.5))

    def well(self, temperature: float, own: np.ndarray | None = None) -> Well:
        """Return where the gap is at a temperature (J); the bodies alone are at their own, or at given ones, (2,)."""
        return Well(self, temperature, self.temperatures if own is None else np.maximum(own, self.temperatures))

    @cached_property
    def gaussian(self) -> float:
        """Temperature of a normal law that is near that of the first body, whatever the second does (J); 0 if none is.

        The first body then is so fast that it follows the force of the contact as if at rest, and moves little in it.
        It is warmer than the body itself where the force moves it by more than a part of its standard deviation.
        """
        well = self.well(float(self.temperatures[1]))
        slow = well.tangent / self.reduced_mass < _SLOW**2 * self.stiffness[0] / self.mass[0]
        moved = float(self.force(np.array([well.penetration]))[0] / self.stiffness[0])
        spread = max(math.sqrt(self.temperatures[0] / self.stiffness[0]), moved / _MOVED)
        little = spread < _LITTLE * min(well.penetration, well.width)
        return float(spread**2 * self.stiffness[0]) if self.follows and slow and little else 0.0


@dataclass(frozen=True, eq=False)
class Well:
    """Energy of the gap, ``k₁k₂/(k₁+k₂) (q + clearance)²/2`` and the work of the contact, at one temperature."""

    pair: Pair
    temperature: float
    own: np.ndarray  # (2,) temperatures of the bodies (J)

    @cached_property
    def cold(self) -> np.ndarray:
        """Whether each body is much colder than the gap, (2,) of bool: its velocity and the center are then narrow."""
        return np.asarray(self.pair.temperatures < _COLD * self.temperature) & (not self.pair.gaussian)

    def _variances(self, temperatures: np.ndarray) -> np.ndarray:
        """Return mean square velocities at some temperatures of cold bodies, others at that of the gap, (2,)."""
        return np.asarray(np.where(self.cold, temperatures, self.temperature) / self.pair.mass)

    @cached_property
    def speeds(self) -> np.ndarray:
        """Standard deviations of velocities by which their ranges are measured, (2,) (m s-1).

        A cold body is hit by the other one, whose velocities then are its own times ``2 μ/m``.
        """
        speeds = np.sqrt(self._variances(self.own))
        hits = 2.0 * self.pair.reduced_mass / self.pair.mass * speeds[::-1]
        return np.asarray(np.where(self.cold, np.maximum(speeds, hits), speeds))

    @cached_property
    def cores(self) -> np.ndarray:
        """Standard deviations of the velocities of the bodies alone, (2,) (m s-1)."""
        return np.asarray(np.sqrt(self._variances(self.pair.temperatures)))

    @cached_property
    def weights(self) -> np.ndarray:
        """Weight of each displacement in the center, which they make hardly correlated with the gap."""
        strength = self.pair.stiffness
        if self.cold.any():
            strength = strength / np.where(self.cold, self.pair.temperatures, self.temperature)
        return np.asarray(strength / strength.sum())

    def center(self, speeds: np.ndarray) -> float:
        """Return the standard deviation of the center where velocities have some, (2,) (m)."""
        if not self.cold.any():
            return math.sqrt(self.temperature / self.pair.stiffness.sum())
        variances = speeds**2 * self.pair.mass / self.pair.stiffness
        return math.sqrt(1.0 / (1.0 / variances).sum())

    @cached_property
    def _table(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places, and there the energy of the contact and all of it, in units of T."""
        pair = self.pair
        # eight standard deviations are looked at
        reach, center = 8.0 * self.spread, -pair.contact.clearance
        right = 1e-9 * reach
        while True:
            gaps = np.append(
                np.linspace(min(center, 0.0) - reach, 0.0, _SAMPLES)[:-1], np.linspace(0.0, right, _SAMPLES)
            )
            force = pair.force(gaps)
            steps = 0.5 * (force[1:] + force[:-1]) * np.diff(gaps)
            work = np.append(0.0, np.cumsum(steps)) / self.temperature
            energy = 0.5 * ((gaps - center) / self.spread) ** 2 + work
            if energy[-1] - energy.min() > VANISHED or right > reach + abs(center):
                return gaps, work, energy - energy.min()
            right *= 1.5

    def energy(self, gaps: np.ndarray) -> np.ndarray:
        """Return the energy above the least one, in units of T."""
        places, _, energy = self._table
        return np.asarray(np.interp(gaps, places, energy))

    def work(self, gaps: np.ndarray) -> np.ndarray:
        """Return the energy of the contact, in units of T."""
        places, work, _ = self._table
        return np.asarray(np.interp(gaps, places, work))

    @cached_property
    def width(self) -> float:
        """Half the distance between the places where the energy is T/2 above the least one (m)."""
        left, right = self._places(0.5, 0.5)
        return 0.5 * (right - left)

    @property
    def spread(self) -> float:
        """Standard deviation of the gap by the springs alone (m)."""
        return math.sqrt(self.temperature * float((1.0 / self.pair.stiffness).sum()))

    @cached_property
    def penetration(self) -> float:
        """Indentation at which the contact stores T, at most where it is with the preload (m)."""
        gaps, work, _ = self._table
        return float(gaps[min(int(np.searchsorted(work, 1.0)), len(gaps) - 1)])

    @cached_property
    def tangent(self) -> float:
        """Largest stiffness of the contact where the energy is up to T above the least one, or stored (N m-1)."""
        gaps, work, energy = self._table
        near = gaps[(gaps > 0.0) & ((energy <= 1.0) | (work <= 1.0))]
        if len(near) < 2:
            return 0.0
        return float((np.diff(self.pair.force(near)) / np.diff(near)).max())

    @cached_property
    def fastest(self) -> float:
        """Largest frequency of the closed contact and the bodies (rad s-1)."""
        own = self.pair.stiffness / self.pair.mass
        return math.sqrt(max(self.tangent / self.pair.reduced_mass, float(own.max())))

    def ends(self, box: float) -> tuple[float, float]:
        """Return the ends of the box of the gap (m), whose size is in standard deviations."""
        return self._places(_ENDS[0] * box**2, _ENDS[1] * box**2)

    def fade(self, gaps: np.ndarray, box: float) -> np.ndarray:
        """Return a factor that takes a density smoothly to 0 towards the ends."""
        (inner_left, left), (inner_right, right) = ((start * box**2, end * box**2) for start, end in _FADE)
        left, right = self._places(left, right)
        inner_left, inner_right = self._places(inner_left, inner_right)
        rising = _ramp((gaps - left) / (inner_left - left))
        return np.asarray(rising * _ramp((right - gaps) / (right - inner_right)))

    def _places(self, left: float, right: float) -> tuple[float, float]:
        gaps, _, energy = self._table
        lowest = int(np.argmin(energy))
        first = lowest - int(np.argmax(energy[lowest::-1] > left))
        beyond = energy[lowest:] > right
        last = lowest + (int(np.argmax(beyond)) if beyond.any() else len(beyond) - 1)
        return float(gaps[first]), float(gaps[last])


def _ramp(t: np.ndarray) -> np.ndarray:
    """Return a smooth rise from 0 at 0 to 1 at 1."""
    from scipy.special import erfc

    return np.where(t <= 0.0, 0.0, np.where(t >= 1.0, 1.0, 0.5 * erfc(6.0 * (0.5 - t))))


def _hurwitz(power: float, place: float) -> float:
    """Return ζ(−power, place), by the sum formula of Euler and Maclaurin."""
    last = 20.0 + place
    total = math.fsum((k + place) ** power for k in range(20))
    rest = last ** (power + 1.0) / (power + 1.0) - 0.5 * last**power + power * last ** (power - 1.0) / 12.0
    rest -= power * (power - 1.0) * (power - 2.0) * last ** (power - 3.0) / 720.0
    return float(total - rest)


def _reasons(network: Composition) -> Iterator[str]:
    """Say why a network is not a pair of linear bodies under white noise with one contact."""
    if len(network.oscillators) != 2:
        yield f"it has {len(network.oscillators)} bodies; two are allowed."
    between = [item for item in network.contacts.values() if {item.first, item.second} == set(network.oscillators)]
    if len(network.contacts) != 1 or not between:
        yield f"it has the contacts {', '.join(network.contacts) or 'none'}; one between both bodies is allowed."
    for name, contact in network.contacts.items():
        if contact.law.state_names():
            yield f"the force of contact {name!r} depends on the past; laws without states are allowed."
        elif TIME in contact.law.kernel("force")[1]:
            yield f"the force of contact {name!r} depends on time; laws of the indentation alone are allowed."
        elif "rate" in contact.law.kernel("force")[1]:
            yield f"the force of contact {name!r} depends on the rate; laws of the indentation alone are allowed."
    if network.couplings:
        yield f"it has couplings, {', '.join(network.couplings)}; none are allowed."
    for name in network.sources:
        yield f"it has the source {name!r}; each body's own noise alone is allowed."
    for name, body in network.oscillators.items():
        if body.moves_as_given:
            yield f"{name!r} moves as it is given; bodies under white noise are allowed."
            continue
        if body.has_kernel("residual"):
            yield f"{name!r} has a residual force; linear bodies are allowed."
        if not body.damping:
            yield f"{name!r} has no damping; give it some."
        if not body.stiffness:
            yield f"{name!r} has no spring, so that nothing confines it; give it a stiffness."
        excitation = network.excitations.get(name)
        if excitation is None:
            yield f"{name!r} has no noise of its own; give it il.WhiteNoise."
        elif excitation.kind != "intensity" or "time" in excitation.kernel("intensity")[1]:
            yield f"{name!r} is excited by {type(excitation).__name__}; constant white noise is allowed."
        elif not float(excitation.call("intensity", 0.0)) > 0.0:
            yield f"the noise on {name!r} is 0; give it a spectral density above 0."
