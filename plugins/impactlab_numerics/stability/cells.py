"""The cells of the stability maps: their scenes, how long they run, and the verdict on each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.decay import relaxation_time
from impactlab.results.schema import CONTACT, STATISTICS
from impactlab_numerics.scenes import TEMPERATURE

if TYPE_CHECKING:
    import xarray as xr

CLASSES = ("accurate", "degraded", "unstable", "refused", "refused for its cost")
"""What a cell can be."""

ALLOWED = 0.01
"""Relative deviation that a statistic of an accurate cell may have."""

SURE = 3.0
"""Standard errors that it may have in addition."""

KNOWN = 0.01
"""Largest relative standard error with which a statistic is judged."""

BLOWN_UP = 10.0
"""Factor from which a mean square counts as unstable."""

JUDGED = (
    "mean_displacement", "mean_square_displacement", "variance_displacement", "mean_velocity", "mean_square_velocity",
    "contact_ratio", "contact_rate", "mean_contact_force",
)  # fmt: skip
"""What is judged: every default statistic but the peak force, which grows with the time. Means are relative to root
mean squares."""

TARGET = 0.004
"""Relative standard error that is wanted of mean squares and of contacts."""

PAIRED_TARGET = 0.01
"""The same under bounded noise, where differences of runs under the same series are known better than either."""

WORST = 0.03
"""Largest relative standard error with which a cell is run."""

SCATTER = 0.3
"""Squared relative scatter of a mean square over a relaxation time."""

CLUMPED = 2.0
"""Squared relative scatter of contacts, by their number."""

SEEN = 1e3
"""Contacts from which their statistics are waited for."""

SPIN_UP = 7.0
"""Relaxation times of spin-up: few, since a start on the linear law is near."""

FEWEST = 64
"""Least realizations of a cell."""

MOST = 512
"""Most realizations of a cell."""

FEWEST_PAIRED = 16
"""Least realizations under bounded noise, where few long ones cost less, since a whole period is sampled for each."""

MOST_PAIRED = 128
"""Most realizations under bounded noise."""

MOST_SAMPLES = 1.2e6
"""Samples of series that a realization may have."""


def pair(
    *, law: il.ContactLaw | None = None, frequency_ratio: float = 16.0, mass_ratio: float = 1.0,
    damping_ratio: float = 0.1, clearance: float = 0.2,
) -> il.Network:  # fmt: skip
    """Return the pair of the base case at 2.5 J with one thing changed.

    Parameters
    ----------
    law : ContactLaw, optional
        By default Hertz contact with 1e4 N m^(-3/2) times twice the reduced mass, so that contacts last as long
        whatever the masses.
    frequency_ratio : float
        Of the first body to the second, which has 2π rad/s.
    mass_ratio : float
        Of the first body to the second, which has 1 kg.
    damping_ratio : float
        Of both bodies; with 0 the first one is undamped and without noise, heated by contacts alone.
    clearance : float
        In standard deviations of the gap without contacts.
    """
    one = il.LinearOscillator.from_frequency(2.0 * math.pi * frequency_ratio, damping_ratio, mass=mass_ratio)
    two = il.LinearOscillator.from_frequency(2.0 * math.pi, damping_ratio or 0.1)
    bodies = {"one": one, "two": two}
    deviation = math.sqrt(sum(TEMPERATURE / body.stiffness for body in bodies.values()))
    law = law or il.HertzContact(1e4 * 2.0 * mass_ratio / (1.0 + mass_ratio))
    noises = {
        name: il.WhiteNoise(TEMPERATURE * body.damping / math.pi) for name, body in bodies.items() if body.damping
    }
    return il.Network(bodies, {"gap": il.Contact("one", "two", law, clearance=clearance * deviation)}, noises)


def scene_on(axis: str, value: float) -> il.Network:
    """Return the pair at a place on an axis of the study."""
    if axis == "hertz_stiffness":
        return pair(law=il.HertzContact(value))
    if axis == "linear_stiffness":
        return pair(law=il.LinearContact(value))
    changed: dict[str, Any] = {axis.removesuffix("s"): value}
    return pair(**changed)


def shaken(network: il.Network, components: int) -> il.Network:
    """Return the pair under cosines up to twice the natural frequency of each body."""
    noises = {
        name: il.ShinozukaNoise(
            noise.spectral_density,  # type: ignore[attr-defined]
            band=(0.0, network.oscillators[name].natural_frequency / math.pi),
            components=components,
            allow_repeat=True,
        )
        for name, noise in network.excitations.items()
    }
    return network.replace(excitations=noises)


class Verdict(NamedTuple):
    """One of `CLASSES`; the worst statistic, its deviation and standard error; how many were judged; the reason."""

    kind: str
    statistic: str = ""
    deviation: float = math.nan
    error: float = math.nan
    judged: int = 0
    reason: str = ""


@dataclass(frozen=True)
class Length:
    """How long a cell runs: realizations and duration, and the spin-up (s)."""

    realizations: int
    duration: float
    spin_up: float

    @property
    def total(self) -> float:
        """Simulated time of all realizations (s)."""
        return self.realizations * (self.spin_up + self.duration)

    @classmethod
    def of(cls, network: il.Network, most: float, rate: float, longest: float | None = None) -> Length | None:
        """Return the length that reaches the target, or the longest allowed; None if that is too short for `WORST`.

        Parameters
        ----------
        network : Network
        most : float
            Simulated time that is allowed (s).
        rate : float
            Of contacts (1/s).
        longest : float, optional
            Time that a realization may take under the series of the reference (s).
        """
        relaxation = relaxation_time(Model.of(network))
        spin_up, variance = SPIN_UP * relaxation, SCATTER * relaxation
        least = variance / WORST**2
        if rate * most > SEEN:
            variance = max(variance, CLUMPED / rate)
        if longest is None:
            wanted = variance / TARGET**2
            realizations = int(min(MOST, max(FEWEST, most // (4.0 * spin_up))))
        else:
            wanted = variance / PAIRED_TARGET**2
            realizations = int(min(MOST_PAIRED, max(FEWEST_PAIRED, min(most, wanted) // longest)))
            most = min(most, realizations * longest)
        measured = min(most - realizations * spin_up, wanted)
        return cls(realizations, measured / realizations, spin_up) if measured >= least else None

    def options(self) -> dict[str, Any]:
        """Return options of `impactlab.simulate`."""
        return {"duration": self.duration, "spin_up": self.spin_up, "realizations": self.realizations}


def verdict(result: xr.Dataset, reference: Mapping[str, Any]) -> Verdict:
    """Judge a result by exact values, or by a run with the same noise.

    A statistic with a standard error above `KNOWN` is not judged, nor are contacts fewer than `SEEN`. The mean of
    the differences of realizations counts where it is known better.
    """
    names, deviations, errors, blown_up = [], [], [], False
    seen = float(np.asarray(reference["contact_rate"])[0]) * result.attrs["duration"] * result.attrs["realizations"]
    for name in JUDGED:
        value, expected = result[name].values, np.asarray(reference[name])
        scale = np.abs(expected)
        statistic = STATISTICS[name]
        if statistic.square:
            scale = np.sqrt(np.asarray(reference[statistic.square]))
        difference, error = value - expected, result[statistic.error].values
        if statistic.error in reference:
            error = np.hypot(error, np.asarray(reference[statistic.error]))
        if statistic.by_realization in reference and statistic.by_realization in result:
            pairs = result[statistic.by_realization].values - np.asarray(reference[statistic.by_realization])
            paired = pairs.std(axis=0, ddof=1) / math.sqrt(len(pairs))
            difference = np.where(paired >= error, difference, pairs.mean(axis=0))  # an error may be NaN
            error = np.fmin(paired, error)
        with np.errstate(divide="ignore", invalid="ignore"):
            relative, scatter = difference / scale, error / scale
        if "mean_square" in name:
            blown_up |= bool((relative > BLOWN_UP).any())
        if statistic.dimension == CONTACT and seen < SEEN:
            scatter = np.full_like(scatter, np.nan)
        labels = result[result[name].dims[0]].values
        names += [f"{name} of {label}" for label in labels]
        deviations += relative.tolist()
        errors += scatter.tolist()
    known = np.array(errors) <= KNOWN
    used = np.where(known, np.abs(deviations) / (ALLOWED + SURE * np.array(errors)), -1.0)
    if blown_up:
        return Verdict("unstable", judged=int(known.sum()), reason=f"a mean square grew more than {BLOWN_UP:g} times")
    if not known.any():
        return Verdict("refused for its cost", reason="no statistic is known well enough")
    worst = int(used.argmax())
    kind = "accurate" if used[worst] <= 1.0 else "degraded"
    return Verdict(kind, names[worst], deviations[worst], errors[worst], int(known.sum()))
