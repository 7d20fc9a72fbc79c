"""The exact stationary reference of a network."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from impactlab.components.composition import Composition
from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries, json_of, stored
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.inputs import FiniteNumbers, checked, of_one_shape
from impactlab.reference.conditions import Law, laws_of
from impactlab.reference.densities import Curves, Densities, normal_curves
from impactlab.reference.gaussian import GaussianLaw
from impactlab.reference.known_laws import Laws
from impactlab.reference.levels import Coordinate
from impactlab.reference.linear_laws import linear_law_of
from impactlab.reference.relaxing_links import Relaxing, relaxing_couplings, with_nodes
from impactlab.results.dataset import provenance
from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import (
    BODY,
    CONTACT,
    OF_STATES,
    STATE,
    Moments,
    OfBodies,
    sampled_of,
    stationary,
    statistics,
)

if TYPE_CHECKING:
    import xarray as xr


@checked
@dataclass(frozen=True, eq=False, repr=False)
class ExactReference(Densities):
    """Exact stationary law of a network; `exact` makes it.

    Parameters
    ----------
    network : Network
        The network.
    laws : tuple of GibbsLaw, TreeLaw, RingLaw and GaussianLaw
        The laws of its connected parts, which are independent.
    untouched : frozenset of str
        Contacts that are left out, because less than 10⁻¹² of all time they are closed.
    relaxing : tuple of Relaxing
        Couplings whose forces relax, as springs and dampers with nodes between them.

    Examples
    --------
    >>> law = il.exact(network)
    >>> law.density("a", "displacement", [0.0, 0.1]).round(4)
    array([0.8627, 0.8558])
    >>> round(law.return_level("stop", "contact_force", time=60.0), 1)
    470.5
    """

    network: Composition
    laws: tuple[Law, ...]
    untouched: frozenset[str] = frozenset()
    relaxing: tuple[Relaxing, ...] = ()

    def __repr__(self) -> str:
        return f"ExactReference:\n{self._laws.described()}"

    def statistics(self) -> xr.Dataset:
        """Return the exact values of the default statistics.

        Returns
        -------
        xarray.Dataset
            The variables of `simulate` but the peak force, which depends on the time of
            observation, and the standard errors. The rate of contacts is
            ``sqrt(T/(2πμ)) p(δ = 0)`` with ``1/μ = 1/m_first + 1/m_second`` (Rice's
            formula; a wall has ``1/m = 0``). What is known of contacts that cannot matter is 0.
            The attribute ``laws`` says which laws these are. Mean squares at points of structures are known where the
            motion is linear, otherwise NaN.
        """
        oscillators, contacts = self.network.oscillators, self.network.contacts
        mean, variance = np.array([self._laws.of_body[name].moments(name) for name in oscillators]).T
        kinetic = np.array([self._laws.speed(name) for name in oscillators]) ** 2
        linear = np.array([(body.mass, body.damping, body.stiffness) for body in oscillators.values()]).T
        bodies = OfBodies.of_law(linear, mean, variance + mean**2, variance, kinetic)
        others = self._others(BODY, self._body) | self._others(CONTACT, self._contact)
        moments = Moments(bodies, others, {}, self._points())
        dataset = statistics(list(oscillators), list(contacts), moments.values(), points=list(self.network.points))
        configuration = {"network": stored(self.network)}
        return dataset.assign(self._states()).assign_attrs(
            provenance("exact stationary statistics", json_of(configuration), in_one_line(entries(configuration))),
            laws=self._laws.described(),
        )

    def joint_density(
        self,
        first: str,
        second: str,
        x: FiniteNumbers,
        y: FiniteNumbers,
        *,
        quantities: tuple[str, str] = ("displacement", "displacement"),
    ) -> np.ndarray:
        """Return the joint probability density of displacements or velocities of two bodies, or of both of one.

        Parameters
        ----------
        first, second : str
            Names of the bodies; one twice where the quantities differ.
        x, y : array_like
            Values of the first and of the second (m or m s-1), which broadcast.
        quantities : pair of {"displacement", "velocity"}
            Of the first and of the second.

        Returns
        -------
        ndarray
            Density (m-2, s m-2 or s2 m-2).

        Raises
        ------
        InvalidInput
            If a name is unknown, both are the same, or a number is not finite.
        """
        one, other = items = list(zip((first, second), quantities, strict=True))
        laws = [self._laws.law(*item) for item in items]
        if one == other:
            raise InvalidInput(
                f"joint_density takes two different displacements or velocities, not the {one[1]} of {first!r} twice."
            )
        x, y = of_one_shape("joint_density", x, y)
        if laws[0] is laws[1] and isinstance(laws[0], GaussianLaw):
            return laws[0].joint_density(first, second, x, y, quantities)
        if laws[0] is laws[1] and "velocity" not in quantities:
            return laws[0].joint_density(first, second, x, y)
        # at one temperature a velocity is independent of all displacements and of the velocities of other bodies
        marginals = [self.density(*item, at) for item, at in zip(items, (x, y), strict=True)]
        return np.asarray(marginals[0] * marginals[1])

    def covariance(self, first: str, second: str, quantity: str) -> float:
        """Return the covariance of q of two bodies, or points of structures, whose motion is linear.

        Parameters
        ----------
        first, second : str
            Names of the bodies or points; the same one twice for its variance.
        quantity : {"displacement", "velocity"}
            q, the mean of which is 0 but for `PoissonImpulses`.

        Returns
        -------
        float
            Covariance (m2 or m2 s-2).

        Raises
        ------
        InvalidInput
            If a name is unknown.
        NoExactReference
            If the motion is not linear.
        """
        one, other = (self._linear_laws(name, quantity) for name in (first, second))
        pairs = [(law, here, there) for law, here in one for same, there in other if law.bodies == same.bodies]
        return sum((law.covariance_of(here, there, quantity) for law, here, there in pairs), 0.0)

    def phase_means(self, oscillator: str, quantity: str, times: FiniteNumbers) -> tuple[np.ndarray, float]:
        """Return mean and variance at times in the cycle of harmonic forces, where the motion is linear.

        `PhaseMeans` finds the same in a simulation, at the times ``phase/2π · period``. All other methods tell of the
        law over the whole cycle.

        Parameters
        ----------
        oscillator : str
            Name of the body or point.
        quantity : {"displacement", "velocity"}
            Quantity of the phase means.
        times : array_like
            Times from the beginning of the measurement (s).

        Returns
        -------
        mean : ndarray
            Mean over realizations (m or m s-1), of the shape of `times`.
        variance : float
            Variance about it (m2 or m2 s-2), which is the same at all times.

        Raises
        ------
        InvalidInput
            If a name is unknown or a number is not finite.
        NoExactReference
            If the motion is not linear.
        """
        laws = self._linear_laws(oscillator, quantity)
        parts = [law.at_phase(weights, quantity, times.ravel()) for law, weights in laws]
        return np.asarray(sum(mean for mean, _ in parts)).reshape(times.shape), sum(part for _, part in parts)

    def autocovariance(self, oscillator: str, quantity: str, lags: FiniteNumbers) -> np.ndarray:
        """Return the covariance of q(t) and q(t + lag) of a body, or a point of a structure, whose motion is linear.

        Parameters
        ----------
        oscillator : str
            Name of the body or point.
        quantity : {"displacement", "velocity"}
            q, the mean of which is 0 but for `PoissonImpulses`.
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
        laws = self._linear_laws(oscillator, quantity)
        parts = [law.autocovariance(weights, quantity, lags.ravel()) for law, weights in laws]
        return np.asarray(sum(parts)).reshape(lags.shape)

    def spectrum(self, oscillator: str, quantity: str, frequencies: FiniteNumbers) -> np.ndarray:
        """Return the spectral density of a body, or a point of a structure, whose motion is linear.

        It is two-sided over angular frequency, as that of `WhiteNoise`: its integral over all
        frequencies, negative ones too, is the mean square.

        Parameters
        ----------
        oscillator : str
            Name of the body or point.
        quantity : {"displacement", "velocity"}
            Quantity of the spectrum.
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
        laws = self._linear_laws(oscillator, quantity)
        parts = [law.spectrum(weights, quantity, frequencies.ravel()) for law, weights in laws]
        return np.asarray(sum(parts)).reshape(frequencies.shape)

    def onset_velocity_density(self, contact: str, grid: FiniteNumbers) -> np.ndarray:
        """Return the probability density of the relative velocity with which a contact closes.

        It is Rayleigh's, ``v/s² exp(−v²/2s²)`` with ``s² = T/μ``, whatever the contact.

        Parameters
        ----------
        contact : str
            Name of the contact.
        grid : array_like
            Where (m s-1).

        Returns
        -------
        ndarray
            Density (s m-1), of the shape of `grid`; 0 for velocities that part the bodies.

        Raises
        ------
        InvalidInput
            If the name is unknown or a number is not finite.
        NoExactReference
            If the contact is one of those that are left out.
        """
        self._laws.gap_law(contact)
        scale = self._laws.relative_speed(contact)
        forwards = np.maximum(grid, 0.0) / scale
        return np.asarray(forwards / scale * np.exp(-0.5 * forwards**2))

    def crossing_rate(self, name: str, quantity: str, level: float) -> float:
        """Return how often a level is crossed upwards, by Rice's formula.

        Parameters
        ----------
        name : str
            Name of a body or a contact.
        quantity : {"displacement", "contact_force"}
            Of a body or of a contact. (Under white noise a velocity crosses each of its levels
            infinitely often.)
        level : float
            The level (m or N).

        Returns
        -------
        float
            Crossings per second. Levels at which the density is less than 10⁻²⁰ of its top are not
            resolved.

        Raises
        ------
        InvalidInput
            If a name is unknown, or the level is not finite or a negative force.
        NoExactReference
            If cosines move the body, the contact is one of those that are left out, or its
            force falls with the indentation somewhere.
        """
        return self._coordinate(name, quantity).crossing_rate(level)

    def return_level(self, name: str, quantity: str, time: float) -> float:
        """Return the highest level that is crossed upwards once in a time, on average.

        Parameters
        ----------
        name, quantity : str
            As in :meth:`crossing_rate`.
        time : float
            The time (s).

        Returns
        -------
        float
            The level (m or N).

        Raises
        ------
        InvalidInput
            If a name is unknown, the time is not positive, or no level is crossed so often.
        NoExactReference
            As in :meth:`crossing_rate`.
        """
        return self._coordinate(name, quantity).return_level(time)

    def exceedance_bound(self, name: str, quantity: str, level: float, time: float = 0.0) -> float:
        """Return an upper bound of the probability that a level is exceeded within a time.

        It is ``P(now above) + rate · time``, which always holds, and exact for the time 0.

        Parameters
        ----------
        name, quantity, level
            As in :meth:`crossing_rate`.
        time : float
            The time (s).

        Returns
        -------
        float
            At most 1.

        Raises
        ------
        InvalidInput, NoExactReference
            As in :meth:`crossing_rate`, and if the time is negative.
        """
        now, crossings = self._coordinate(name, quantity).exceedance(level, time)
        return min(1.0, now + crossings)

    def exceedance_estimate(self, name: str, quantity: str, level: float, time: float) -> float:
        """Return an estimate of the same probability for crossings that are independent of each other.

        It is ``1 − P(not now above) exp(−rate · time)``, never more than :meth:`exceedance_bound`.
        It is right for levels that are rarely crossed; where motion is weakly damped crossings
        come in clusters, and it is too large.

        Parameters
        ----------
        name, quantity, level, time
            As in :meth:`exceedance_bound`.

        Returns
        -------
        float

        Raises
        ------
        InvalidInput, NoExactReference
            As in :meth:`exceedance_bound`.
        """
        now, crossings = self._coordinate(name, quantity).exceedance(level, time)
        return now - (1.0 - now) * math.expm1(-crossings)

    @cached_property
    def _laws(self) -> Laws:
        return Laws(self.network, self.laws, self.untouched)

    def _coordinate(self, name: str, quantity: str) -> Coordinate:
        return Coordinate.of(self._laws, name, quantity)

    def _curves(self, oscillator: str, quantity: str) -> Curves:
        if oscillator in self.network.points:
            return self._laws.curves_at_point(oscillator, quantity)
        law = self._laws.law(oscillator, quantity)
        if isinstance(law, GaussianLaw):
            return Curves(
                partial(law.density_of, oscillator, quantity), partial(law.probability_of, oscillator, quantity)
            )
        if quantity == "displacement":
            return Curves(partial(law.density, oscillator), partial(law.probability, oscillator))
        return normal_curves(self._laws.speed(oscillator))

    def _linear_laws(self, name: str, quantity: str) -> list[tuple[GaussianLaw, dict[str, float]]]:
        """Return the independent laws of a body, or of those that move a point, with the weights of their bodies."""
        found: dict[tuple[str, ...], tuple[GaussianLaw, dict[str, float]]] = {}
        for body, weight in self.network.points.get(name, {name: 1.0}).items():
            law = self._laws.law(body, quantity)
            linear = law if isinstance(law, GaussianLaw) else linear_law_of(self.network, body)
            found.setdefault(linear.bodies, (linear, {}))[1][body] = weight
        return list(found.values())

    def _states(self) -> Variables:
        """Return mean and mean square of the states of couplings whose forces relax."""
        found = {}
        for item in self.relaxing:
            for name, weights in item.weights().items():
                law = self._laws.of_body[item.node]
                assert isinstance(law, GaussianLaw)
                mean = sum(weight * law.moments(body)[0] for body, weight in weights.items())
                found[name] = mean, law.relative_variances(weights)[0] + mean**2
        if not found:
            return {}
        values = np.array(list(found.values())).T
        known = (OF_STATES["mean_law_state"], OF_STATES["mean_square_law_state"])
        return {
            STATE: labelled((STATE,), np.array(list(found)), "", "name of the state"),
            **{
                item.name: labelled((STATE,), of, item.units, item.long_name)
                for item, of in zip(known, values, strict=True)
            },
        }

    def _points(self) -> OfBodies | None:
        """Return the moments at points of structures, if there are any."""
        if not self.network.points:
            return None
        mean, variance, kinetic = np.array([self._laws.at_point(row) for row in self.network.points.values()]).T
        unknown = np.full_like(mean, np.nan)
        return OfBodies.of_law([unknown] * 3, mean, variance + mean**2, variance, kinetic)

    def _others(self, dimension: str, known: Callable[[str], dict[str, float]]) -> dict[str, np.ndarray]:
        """Return the statistics of all bodies or contacts that are not formed of moments."""
        values = [known(name) for name in (self.network.contacts if dimension == CONTACT else self.network.oscillators)]
        others = [item.name for item in stationary() if item.dimension == dimension and item.formed is None]
        return {name: np.array([of_one[name] for of_one in values]) for name in others}

    def _body(self, name: str) -> dict[str, float]:
        """Return the means of what is sampled of a body."""
        sampled = sampled_of(BODY)
        law = self._laws.of_body[name].marginal(name, self._laws.speed(name)) if sampled else None
        return {item.name: law.mean_with_rate(item.sample) for item in sampled} if law else {}

    def _contact(self, name: str) -> dict[str, float]:
        """Return the statistics of a contact; of three laws know more than the density of the gap."""
        sampled = {item.name: item.sample for item in sampled_of(CONTACT)}
        if name in self.untouched:
            return dict.fromkeys(["contact_rate", *sampled], 0.0)
        laws, contact = self._laws, self.network.contacts[name]
        law, speed = laws.gap_law(name), laws.relative_speed(name)
        closed, density, force = law.contact(contact)
        if contact.law.impulsive:  # an impulse 2 μ v at each velocity v of the density v p(0) exp(−μv²/2T)
            force = law.temperature * density
        rate = speed / math.sqrt(2.0 * math.pi) * density
        known = {"contact_ratio": closed, "contact_rate": rate, "mean_contact_force": force}
        further = [item for item in sampled_of(CONTACT) if item.stationary and item.name not in known]
        of_gap = law.gap_marginal(contact, speed) if further else None
        for item in further:
            assert of_gap is not None
            known[item.name] = of_gap.mean(item.sample, contact.law.evaluate)
        return known


@checked
def exact(network: Composition) -> ExactReference:
    """Return the exact stationary law of a network that has one which is known here.

    Parts of a network that no contacts, couplings or sources connect are independent. Known are

    - parts in which contacts and couplings form trees (between any two bodies at most one way,
      over one or more contacts and couplings), with walls and residual potentials, or one ring of
      bodies with springs, without walls: the noises
      must be white, the forces of contacts and couplings have a potential, linear couplings be without
      damping, and the temperatures ``π S / damping`` of connected bodies be equal (for two unit
      masses ``S1/S2 = ζ1 ω1/(ζ2 ω2)``, Luo, Yan and Zhang, 2023, equation 8); then the density is
      proportional to ``exp(−H/T)`` with the energy H;
    - linear parts, also in loops and with damping in couplings, in which all contacts act along one
      combination of displacements, as between two towers that are given by their modes, if the
      matrices of spectral densities and of damping are in proportion, ``π S = T C``;
    - linear parts, also in loops, with damping in couplings and with couplings whose linear forces relax,
      such as `PiezoelectricCoupling`, under constant white noise of any temperatures, also one on several
      bodies, filtered noise without an envelope, sums of cosines, `PoissonImpulses`, of which mean and
      covariance are known, and harmonic forces, whose law is that over the cycle, with
      :meth:`ExactReference.phase_means`. Contacts are allowed, but beside `PoissonImpulses`, if the law
      without them closes them so rarely that they cannot matter: a bound of the probability, and of the
      contacts in a relaxation time, is 10⁻¹².

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

    Notes
    -----
    Equations :eq:`stationary-density` and, for linear motion, :eq:`lyapunov` of the theory.

    Examples
    --------
    >>> law = il.exact(network)
    >>> round(law.statistics().contact_ratio.item(), 6)
    0.05693
    """
    network.check_numbers()
    if relaxing := relaxing_couplings(network):
        with contextlib.suppress(NoExactReference):  # whose reasons are those of nodes
            return ExactReference(network, *laws_of(with_nodes(network, relaxing)), tuple(relaxing))
    return ExactReference(network, *laws_of(network))
