"""Coloured noise: what linear filters make of white noise, as forces on bodies or accelerations of the ground."""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np

from impactlab.components.excitation import Excitation, two_sided
from impactlab.components.fields import parameter
from impactlab.components.filters import filter_of
from impactlab.components.literature import article, entry, joined_entries
from impactlab.inputs import FiniteNumbers, checked

_KANAI_TAJIMI = joined_entries(
    article(
        "Kanai, K.",
        "Semi-empirical formula for the seismic characteristics of the ground",
        "Bull. Earthq. Res. Inst.", 35, 1957, "309",
    ),
    entry(
        "inproceedings", "Tajimi, H.", 1960, volume=2, pages="781", booktitle="Proc. 2nd World Conf. Earthquake Eng.",
        title="A standard method of determining the maximum response of a building structure during an earthquake",
    ),
)  # fmt: skip


class FilteredNoise(Excitation):
    """White noise through a linear filter; a subclass defines ``filter(self)``, which `Excitation` tells of.

    The exact flow has the states of the filter and what they move in one transition, so that steps may be longer than
    the filter's times. A run begins with a state drawn from the stationary law of the filter, unless it is ``at_rest``.

    Notes
    -----
    Equation :eq:`filter` of the theory.

    Examples
    --------
    >>> class Wind(il.FilteredNoise):
    ...     size: float = il.parameter(units="N")
    ...
    ...     def filter(self):
    ...         return [[-1.0, 0.0], [2.0, -2.0]], [1.0, 0.0], [0.0, self.size]
    >>> round(Wind(3.0).variance, 4)
    18.8496
    """

    @property
    def variance(self) -> float:
        """Stationary variance of the force (N2), or of what a `Source` or a `BaseMotion` makes of it."""
        from scipy.linalg import solve_continuous_lyapunov  # loaded only where it is asked for

        drift, given, output = filter_of(self)
        covariance = solve_continuous_lyapunov(drift, -2.0 * math.pi * np.outer(given, given))
        return float(output @ covariance @ output)

    @checked
    def density(self, frequencies: FiniteNumbers) -> np.ndarray:
        """Return the two-sided spectral density at angular frequencies (rad s-1) (N2 s rad-1)."""
        return filter_of(self).density(frequencies.ravel()).reshape(frequencies.shape)


class OrnsteinUhlenbeckNoise(FilteredNoise):
    """White noise through a filter of first order: ``E[f(t) f(t+τ)] = (πS/τ_c) exp(−|τ|/τ_c)``.

    Its two-sided spectral density is ``S/(1 + ω² τ_c²)``; for short correlation times it is white noise of the density
    S (Uhlenbeck and Ornstein, Phys. Rev. 36, 1930, 823).

    Parameters
    ----------
    spectral_density : float
        Two-sided spectral density S over angular frequency at frequency 0 (N2 s rad-1).
    correlation_time : float
        Time τ_c (s).
    at_rest : bool
        Whether the filter is at rest where a run begins, which is before the spin-up.

    Examples
    --------
    >>> il.OrnsteinUhlenbeckNoise.from_variance(4.0, correlation_time=0.2)
    OrnsteinUhlenbeckNoise(spectral_density=0.25464790894703254, correlation_time=0.2)
    """

    citation = article(
        "Uhlenbeck, G. E. and Ornstein, L. S.",
        "On the theory of the Brownian motion",
        "Phys. Rev.", 36, 1930, "823", "10.1103/PhysRev.36.823",
    )  # fmt: skip

    spectral_density: float = parameter(units="N2 s rad-1", minimum=0.0)
    correlation_time: float = parameter(units="s", above=0.0)
    at_rest: bool = parameter(False)

    @classmethod
    @checked
    def from_variance(cls, variance: float, correlation_time: float, **fields: Any) -> Self:
        """Make the noise from its variance, ``πS/τ_c`` (N2), and its correlation time (s)."""
        return cls(variance * correlation_time / math.pi, correlation_time=correlation_time, **fields)

    def filter(self) -> tuple[Any, Any, Any]:
        """Return the filter; see `Excitation`."""
        rate = 1.0 / self.correlation_time
        return [[-rate]], [rate * math.sqrt(self.spectral_density)], [1.0]


class BandPassNoise(FilteredNoise):
    """White noise through a filter of second order, of the density ``S (2ζω₀ω)²/((ω₀² − ω²)² + (2ζω₀ω)²)``.

    The density is S at the middle frequency ω₀, half of that at the ends of a band of the width 2ζω₀ about it, and 0 at
    frequency 0; the variance is ``2πζω₀S``.

    Parameters
    ----------
    spectral_density : float
        Two-sided spectral density S over angular frequency in the middle of the band (N2 s rad-1).
    frequency : float
        Angular frequency ω₀ (rad s-1).
    damping_ratio : float
        Ratio ζ.
    at_rest : bool
        Whether the filter is at rest where a run begins, which is before the spin-up.

    Examples
    --------
    >>> round(il.BandPassNoise(1.0, frequency=10.0, damping_ratio=0.1).variance, 3)
    6.283
    """

    spectral_density: float = parameter(units="N2 s rad-1", minimum=0.0)
    frequency: float = parameter(units="rad s-1", above=0.0)
    damping_ratio: float = parameter(above=0.0)
    at_rest: bool = parameter(False)

    def filter(self) -> tuple[Any, Any, Any]:
        """Return the filter; see `Excitation`."""
        drift, given = _resonator(self.frequency, self.damping_ratio, self.spectral_density)
        return drift, given, [0.0, -drift[1][1]]


class KanaiTajimi(FilteredNoise):
    """Acceleration of a layer of soil on rock that moves like white noise, by the spectrum of Kanai and Tajimi.

    The two-sided density is ``S₀ (ω_g⁴ + (2ζ_gω_gω)²)/((ω_g² − ω²)² + (2ζ_gω_gω)²)``, that of the absolute acceleration
    of a mass on a spring and damper whose base has the density S₀ (Tajimi, Proc. 2nd World Conf. Earthquake Eng. 2,
    1960, 781).

    Parameters
    ----------
    spectral_density : float
        Two-sided spectral density S₀ over angular frequency of the rock: of its acceleration (m2 s-3 rad-1) in a
        `BaseMotion`, of a force (N2 s rad-1) on a body.
    ground_frequency : float
        Angular frequency ω_g of the layer (rad s-1).
    ground_damping : float
        Damping ratio ζ_g of the layer.
    at_rest : bool
        Whether the filter is at rest where a run begins, which is before the spin-up.

    Examples
    --------
    >>> round(il.KanaiTajimi(1.0, 15.0, 0.6).variance, 3)
    95.819
    """

    citation = _KANAI_TAJIMI

    spectral_density: float = parameter(units="N2 s rad-1", minimum=0.0, kw_only=False)
    ground_frequency: float = parameter(units="rad s-1", above=0.0, kw_only=False)
    ground_damping: float = parameter(above=0.0, kw_only=False)
    at_rest: bool = parameter(False)

    @classmethod
    @checked
    def from_one_sided(cls, per_hertz: float, **fields: Any) -> Self:
        """Make the noise from the one-sided density of the rock over frequency, S_f = 4π S₀."""
        return cls(two_sided(cls, per_hertz), **fields)

    def filter(self) -> tuple[Any, Any, Any]:
        """Return the filter; see `Excitation`."""
        drift, given = _resonator(self.ground_frequency, self.ground_damping, self.spectral_density)
        return drift, given, [-drift[1][0], -drift[1][1]]


class CloughPenzien(FilteredNoise):
    """The acceleration of `KanaiTajimi` through a second filter, which leaves no low frequencies.

    Its density is multiplied by ``ω⁴/((ω_f² − ω²)² + (2ζ_fω_fω)²)``, so that velocity and displacement of the ground
    have finite variances (Clough and Penzien, Dynamics of Structures, 2nd ed., 1993, section 23-2).

    Parameters
    ----------
    spectral_density : float
        Two-sided spectral density S₀ over angular frequency of the rock, as of `KanaiTajimi` (N2 s rad-1).
    ground_frequency, ground_damping : float
        Angular frequency ω_g (rad s-1) and damping ratio ζ_g of the layer.
    filter_frequency, filter_damping : float
        Angular frequency ω_f (rad s-1) and damping ratio ζ_f of the second filter.
    at_rest : bool
        Whether the filter is at rest where a run begins, which is before the spin-up.

    Examples
    --------
    >>> round(il.CloughPenzien(1.0, 15.0, 0.6, 1.5, 0.6).variance, 3)
    94.218
    """

    citation = joined_entries(
        _KANAI_TAJIMI,
        entry("book", "Clough, R. W. and Penzien, J.", 1993, title="Dynamics of Structures", edition="2nd"),
    )

    spectral_density: float = parameter(units="N2 s rad-1", minimum=0.0, kw_only=False)
    ground_frequency: float = parameter(units="rad s-1", above=0.0, kw_only=False)
    ground_damping: float = parameter(above=0.0, kw_only=False)
    filter_frequency: float = parameter(units="rad s-1", above=0.0, kw_only=False)
    filter_damping: float = parameter(above=0.0, kw_only=False)
    at_rest: bool = parameter(False)

    @classmethod
    @checked
    def from_one_sided(cls, per_hertz: float, **fields: Any) -> Self:
        """Make the noise from the one-sided density of the rock over frequency, S_f = 4π S₀."""
        return cls(two_sided(cls, per_hertz), **fields)

    def filter(self) -> tuple[Any, Any, Any]:
        """Return the filter; see `Excitation`."""
        layer = KanaiTajimi(self.spectral_density, self.ground_frequency, self.ground_damping)
        first, given, acceleration = layer.filter()
        second, _ = _resonator(self.filter_frequency, self.filter_damping, 1.0)
        drift = np.zeros((4, 4))
        drift[:2, :2], drift[2:, 2:] = first, second
        drift[3, :2] = acceleration
        return drift, [*given, 0.0, 0.0], [*acceleration, *second[1]]


def _resonator(frequency: float, damping_ratio: float, density: float) -> tuple[list[list[float]], list[float]]:
    """Return matrix and input of ``z'' + 2ζω z' + ω² z = w``, with white noise w of some density."""
    drift = [[0.0, 1.0], [-(frequency**2), -2.0 * damping_ratio * frequency]]
    return drift, [0.0, math.sqrt(density)]
