"""Bounded noise: sums of cosines with random phases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from impactlab.components.component import SHOWN
from impactlab.components.excitation import Excitation, two_sided
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.components.sampled_rows import take_samples
from impactlab.errors import InvalidInput
from impactlab.inputs import checked

MOST_COSINES = 10_000_000
"""Cosines of a noise at most: an array of 10⁷ frequencies takes 80 MB, one of 10⁹, as a file may ask for, 8 GB."""


class ShinozukaNoise(Excitation):
    """Bounded noise: a sum of cosines of equal amplitude with random phases.

    ``f(t) = Σ A cos(2π f_k t + φ_k)`` with ``f_k = f_a + k Δf``, k = 1…N,
    ``Δf = (f_b − f_a)/N`` and ``A = sqrt(2 S_f Δf)``, where ``S_f = 4π S`` is the
    one-sided density per hertz (Shinozuka and Jan, J. Sound Vib. 25, 1972, 111).

    Parameters
    ----------
    spectral_density : float
        Two-sided spectral density S over angular frequency inside the band (N2 s rad-1).
    band : tuple of float
        Lower and upper end of the band, f_a and f_b (Hz).
    components : int
        Number N of cosines.
    allow_repeat : bool
        Whether a run may be longer than ``1/Δf``, after which the series repeats
        itself (up to a modulation with f_a).

    Notes
    -----
    Equation :eq:`bounded-noise` of the theory.

    Examples
    --------
    >>> il.ShinozukaNoise(1.0, band=(0.0, 20.0), components=4000).period
    200.0
    """

    citation = article(
        "Shinozuka, M. and Jan, C.-M.",
        "Digital simulation of random processes and its applications",
        "J. Sound Vib.", 25, 1972, "111",
    )  # fmt: skip

    spectral_density: float = parameter(units="N2 s rad-1", minimum=0.0)
    band: tuple[float, float] = parameter((0.0, 500.0), units="Hz", minimum=0.0)
    components: int = parameter(50000, minimum=1, maximum=MOST_COSINES)
    allow_repeat: bool = parameter(False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.band[0] < self.band[1]:
            raise InvalidInput(
                f"ShinozukaNoise.band must be two increasing frequencies in Hz such as (0.0, 500.0), not {self.band!r}."
            )

    @classmethod
    @checked
    def from_one_sided(cls, per_hertz: float, **fields: Any) -> Self:
        """Make bounded noise from its one-sided density over frequency, S_f = 4π S (N2 Hz-1)."""
        return cls(spectral_density=two_sided(cls, per_hertz), **fields)

    @property
    def spacing(self) -> float:
        """Distance Δf between neighbouring lines (Hz)."""
        return (self.band[1] - self.band[0]) / self.components

    @property
    def period(self) -> float:
        return math.inf if self.allow_repeat else 1.0 / self.spacing

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the angular frequencies (rad s-1) and the amplitudes (N) of the cosines."""
        frequencies = self.band[0] + self.spacing * np.arange(1, self.components + 1)
        amplitude = math.sqrt(2.0 * 4.0 * math.pi * self.spectral_density * self.spacing)
        return 2.0 * math.pi * frequencies, np.full(self.components, amplitude)


class TabulatedNoise(Excitation):
    """Bounded noise of a spectral density given as a table: a sum of cosines with random phases.

    The density is linear between the frequencies of the table, and 0 outside. Lines are ``Δω = (ω_b − ω_a)/N`` apart,
    at ω_a + Δω, …, ω_b, and each has the power of the band below it, so that the variance is exactly twice the integral
    of the table.

    Parameters
    ----------
    frequencies : (frequency,) array_like
        Increasing angular frequencies, from 0 or above on (rad s-1).
    densities : (frequency,) array_like
        Two-sided spectral densities over angular frequency (N2 s rad-1).
    components : int
        Number N of cosines.
    allow_repeat : bool
        Whether a run may be longer than ``2π/Δω``, after which the series repeats itself (up to a modulation with ω_a).

    Raises
    ------
    InvalidInput
        If a density or a frequency is negative, there are not as many densities as frequencies, fewer than two, one is
        not finite, or frequencies do not increase.

    Examples
    --------
    >>> il.TabulatedNoise([0.0, 5.0, 20.0], [0.0, 1.0, 0.0], components=1000)
    TabulatedNoise(frequencies=(0.0, 5.0, 20.0), densities=(0.0, 1.0, 0.0), components=1000)
    """

    frequencies: Sequence[float] | np.ndarray = parameter(units="rad s-1", kw_only=False)
    densities: Sequence[float] | np.ndarray = parameter(units="N2 s rad-1", kw_only=False)
    components: int = parameter(4000, minimum=1, maximum=MOST_COSINES)
    allow_repeat: bool = parameter(False)

    def __post_init__(self) -> None:
        take_samples(self, "densities", of="frequencies")
        super().__post_init__()
        if self.frequencies[0] < 0.0:
            raise InvalidInput(f"TabulatedNoise.frequencies must be at least 0 rad/s, not {self.frequencies[0]:g}.")
        for frequency, density in zip(self.frequencies, self.densities, strict=True):
            if density < 0.0:
                raise InvalidInput(
                    f"TabulatedNoise.densities must be at least 0, but that at {frequency:g} rad/s is {density:g}."
                )

    def __repr__(self) -> str:
        count = len(self.frequencies)
        if count <= SHOWN:
            return super().__repr__()
        return f"TabulatedNoise of {count} densities from {self.frequencies[0]:g} to {self.frequencies[-1]:g} rad/s"

    @property
    def spacing(self) -> float:
        """Distance Δω between neighbouring lines (rad s-1)."""
        return (self.frequencies[-1] - self.frequencies[0]) / self.components

    @property
    def period(self) -> float:
        return math.inf if self.allow_repeat else 2.0 * math.pi / self.spacing

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the angular frequencies (rad s-1) and the amplitudes (N) of the cosines."""
        known, density = np.array(self.frequencies), np.array(self.densities)
        ends = known[0] + self.spacing * np.arange(self.components + 1)
        places = np.union1d(known, ends[1:-1])
        values = np.interp(places, known, density)
        power = np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(places)))
        below = np.diff(np.interp(np.minimum(ends, places[-1]), places, power))
        return ends[1:], 2.0 * np.sqrt(np.maximum(below, 0.0))
