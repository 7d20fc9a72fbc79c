"""The exact stationary reference of a network."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from impactlab.components.composition import Composition
from impactlab.errors import InvalidInput
from impactlab.reference.conditions import laws_of
from impactlab.reference.densities import Curves, Densities
from impactlab.reference.gaussian import GaussianLaw
from impactlab.reference.laws import finite_array
from impactlab.reference.levels import Levels
from impactlab.reference.linear_laws import linear_law_of
from impactlab.results.dataset import provenance
from impactlab.results.schema import Moments, OfBodies, statistics

if TYPE_CHECKING:
    import xarray as xr


class ExactReference(Levels, Densities):
    """Exact stationary law of a network; `exact` makes it.

    Parameters
    ----------
    network : Network
        The network.
    laws : tuple of GibbsLaw, TreeLaw, RingLaw and GaussianLaw
        The laws of its connected parts, which are independent.
    untouched : frozenset of str
        Contacts that are left out, because less than 10⁻¹² of all time they are closed.
    """

    def statistics(self) -> xr.Dataset:
        """Return the exact values of the default statistics.

        Returns
        -------
        xarray.Dataset
            The variables of `simulate` but the peak force, which depends on the time of
            observation, and the standard errors. The rate of contacts is
            ``sqrt(T/(2πμ)) p(δ = 0)`` with ``1/μ = 1/m_first + 1/m_second`` (Rice's
            formula; a wall has ``1/m = 0``). What is known of contacts that cannot matter is 0.
            The attribute ``laws`` says which laws these are.
        """
        oscillators, contacts = self.network.oscillators, self.network.contacts
        mean, variance = np.array([self._law_of[name].moments(name) for name in oscillators]).T
        kinetic = np.array([self._speed(name) for name in oscillators]) ** 2
        linear = np.array([(body.mass, body.damping, body.stiffness) for body in oscillators.values()]).T
        bodies = OfBodies.of_law(linear, mean, variance + mean**2, variance, kinetic)
        moments = Moments.of_law(bodies, *np.array([self._contact(name) for name in contacts]).reshape(-1, 3).T)
        dataset = statistics(list(oscillators), list(contacts), moments.values())
        configuration = {"network": self.network.to_dict()}
        return dataset.assign_attrs(provenance("exact stationary statistics", configuration), laws=self._described())

    def joint_density(self, first: str, second: str, x: Any, y: Any) -> np.ndarray:
        """Return the joint probability density of the displacements of two bodies.

        Parameters
        ----------
        first, second : str
            Names of the bodies.
        x, y : array_like
            Displacements of the first and of the second body (m), which broadcast.

        Returns
        -------
        ndarray
            Density (m-2).

        Raises
        ------
        InvalidInput
            If a name is unknown or given twice, or a number is not finite.
        """
        laws = [self._law(name, "displacement") for name in (first, second)]
        if first == second:
            raise InvalidInput(f"joint_density takes two different bodies, not {first!r} twice.")
        x, y = np.broadcast_arrays(finite_array("x", x), finite_array("y", y))
        if laws[0] is not laws[1]:
            marginals = [self.density(name, "displacement", at) for name, at in ((first, x), (second, y))]
            return np.asarray(marginals[0] * marginals[1])
        return laws[0].joint_density(first, second, x, y)

    def autocovariance(self, oscillator: str, quantity: str, lags: Any) -> np.ndarray:
        """Return ``E[q(t) q(t + lag)]`` of a body whose motion is linear.

        Parameters
        ----------
        oscillator : str
            Name of the body.
        quantity : {"displacement", "velocity"}
            q, the mean of which is 0.
        lags : array_like
            Lags (s), of either sign.

        Returns
        -------
        ndarray
            Autocovariance (m2 or m2 s-2), of the shape of `lags`.

        Raises
        ------
        InvalidInput
            If a name is unknown or a number is not finite.
        NoExactReference
            If the motion is not linear.
        """
        law, lags = self._linear_law(oscillator, quantity), finite_array("lags", lags)
        return law.autocovariance(oscillator, quantity, lags.ravel()).reshape(lags.shape)

    def spectrum(self, oscillator: str, quantity: str, frequencies: Any) -> np.ndarray:
        """Return the spectral density of a body whose motion is linear.

        It is two-sided over angular frequency, as that of `WhiteNoise`: its integral over all
        frequencies, negative ones too, is the mean square.

        Parameters
        ----------
        oscillator : str
            Name of the body.
        quantity : {"displacement", "velocity"}
            Of what.
        frequencies : array_like
            Angular frequencies (rad s-1).

        Returns
        -------
        ndarray
            Spectral density (m2 s rad-1 or m2 s-1 rad-1), of the shape of `frequencies`.

        Raises
        ------
        InvalidInput
            If a name is unknown or a number is not finite.
        NoExactReference
            If the motion is not linear, or moved by cosines: then it has lines instead.
        """
        law, frequencies = self._linear_law(oscillator, quantity), finite_array("frequencies", frequencies)
        return law.spectrum(oscillator, quantity, frequencies.ravel()).reshape(frequencies.shape)

    def _curves(self, oscillator: str, quantity: str) -> Curves:
        law = self._law(oscillator, quantity)
        if isinstance(law, GaussianLaw):
            return Curves(
                partial(law.density_of, oscillator, quantity), partial(law.probability_of, oscillator, quantity)
            )
        if quantity == "displacement":
            return Curves(partial(law.density, oscillator), partial(law.probability, oscillator))
        scale = self._speed(oscillator)
        return Curves(
            lambda v: np.asarray(np.exp(-0.5 * (v / scale) ** 2) / (math.sqrt(2.0 * math.pi) * scale)),
            lambda v: np.asarray(ndtr(v / scale)),
        )

    def _linear_law(self, oscillator: str, quantity: str) -> GaussianLaw:
        law = self._law(oscillator, quantity)
        return law if isinstance(law, GaussianLaw) else linear_law_of(self.network, oscillator)

    def _contact(self, name: str) -> tuple[float, float, float]:
        """Return the part of the time in contact, the rate of contacts (s-1) and the mean force (N)."""
        if name in self.untouched:
            return 0.0, 0.0, 0.0
        closed, density, force = self._gap_law(name).contact(self.network.contacts[name])
        return closed, self._relative_speed(name) / math.sqrt(2.0 * math.pi) * density, force


def exact(network: Composition) -> ExactReference:
    """Return the exact stationary law of a network that has one which is known here.

    Parts of a network that neither contacts nor couplings connect are independent. Known are

    - parts in which contacts and couplings form trees (between any two bodies at most one way,
      over one or more contacts and couplings), with walls and residual potentials, or one ring of
      bodies with springs, without walls: the noises
      must be white, the contact forces have a potential, the couplings be linear without
      damping, and the temperatures ``π S / damping`` of connected bodies be equal (for two unit
      masses ``S1/S2 = ζ1 ω1/(ζ2 ω2)``, Luo, Yan and Zhang, 2023, equation 8); then the density is
      proportional to ``exp(−H/T)`` with the energy H;
    - linear parts, also in loops and with damping in couplings, under constant white noise of
      any temperatures and sums of cosines. Contacts are allowed if the law without them closes
      them so rarely that they cannot matter: a bound of the probability, and of the contacts
      in a relaxation time, is 10⁻¹².

    Parameters
    ----------
    network : Network
        Bodies, contacts, couplings and noises.

    Returns
    -------
    ExactReference

    Raises
    ------
    NoExactReference
        If there is no such law; the message gives all reasons with the names of the bodies, and
        what would be exact instead.
    InvalidInput
        If `network` is not a network, or a potential is not the integral of its force.
    """
    if not isinstance(network, Composition):
        raise InvalidInput(f"exact takes an il.Network, not {network!r}.")
    return ExactReference(network, *laws_of(network))
