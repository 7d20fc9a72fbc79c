"""The exact stationary reference of a network."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from impactlab.component import suggestion
from impactlab.contact import Contact
from impactlab.dataset import provenance, statistics
from impactlab.errors import InvalidInput
from impactlab.network import Network
from impactlab.reference.conditions import Law, gibbs_laws

if TYPE_CHECKING:
    import xarray as xr

_QUANTITIES = ("displacement", "velocity")


@dataclass(frozen=True, eq=False, repr=False)
class ExactReference:
    """Exact stationary law of a network; `exact` makes it.

    Parameters
    ----------
    network : Network
        The network.
    laws : tuple of GibbsLaw and TreeLaw
        The laws of its connected parts, which are independent.
    """

    network: Network
    laws: tuple[Law, ...]

    def statistics(self) -> xr.Dataset:
        """Return the exact values of the default statistics.

        Returns
        -------
        xarray.Dataset
            The variables of `simulate` but the peak force, which depends on the time of
            observation, and the standard errors. The rate of contacts is
            ``sqrt(T/(2πμ)) p(δ = 0)`` with ``1/μ = 1/m_first + 1/m_second`` (Rice's
            formula; a wall has ``1/m = 0``).
        """
        bodies = [self._moments(name) for name in self.network.oscillators]
        contacts = [self._contact(contact) for contact in self.network.contacts.values()]
        values = {
            name: np.array([item[name] for item in items])
            for items in (bodies, contacts)
            for name in (items[0] if items else ())
        }
        dataset = statistics(list(self.network.oscillators), list(self.network.contacts), values)
        configuration = {"network": self.network.to_dict()}
        return dataset.assign_attrs(provenance("exact stationary statistics", configuration))

    def density(self, oscillator: str, quantity: str, grid: Any) -> np.ndarray:
        """Return the probability density of a displacement or a velocity.

        Parameters
        ----------
        oscillator : str
            Name of the body.
        quantity : {"displacement", "velocity"}
            Whose density.
        grid : array_like
            Where (m or m s-1).

        Returns
        -------
        ndarray
            Density (m-1 or s m-1), of the shape of `grid`.

        Raises
        ------
        InvalidInput
            If a name is unknown or a number is not finite.
        """
        law, grid = self._law(oscillator, quantity), _finite("grid", grid)
        if quantity == "velocity":
            scale = self._thermal_velocity(oscillator)
            return np.asarray(np.exp(-0.5 * (grid / scale) ** 2) / (math.sqrt(2.0 * math.pi) * scale))
        return law.density(oscillator, grid.ravel()).reshape(grid.shape)

    def bin_density(self, oscillator: str, quantity: str, edges: Any) -> np.ndarray:
        """Return the averages of the density over bins, as a histogram estimates them.

        Parameters
        ----------
        oscillator : str
            Name of the body.
        quantity : {"displacement", "velocity"}
            Whose density.
        edges : array_like
            Increasing edges of the bins (m or m s-1).

        Returns
        -------
        ndarray
            One value for every bin (m-1 or s m-1).

        Raises
        ------
        InvalidInput
            If a name is unknown or the edges do not increase.
        """
        law, edges = self._law(oscillator, quantity), _finite("edges", edges)
        if edges.ndim != 1 or len(edges) < 2 or not (np.diff(edges) > 0.0).all():
            raise InvalidInput("edges must be at least two increasing numbers in one dimension.")
        if quantity == "velocity":
            below = ndtr(edges / self._thermal_velocity(oscillator))
        else:
            below = law.probability(oscillator, edges)
        return np.asarray(np.diff(below) / np.diff(edges))

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
            raise InvalidInput(f"joint_density takes two different bodies, {first!r} was given twice.")
        x, y = np.broadcast_arrays(_finite("x", x), _finite("y", y))
        if laws[0] is not laws[1]:
            marginals = [self.density(name, "displacement", at) for name, at in ((first, x), (second, y))]
            return np.asarray(marginals[0] * marginals[1])
        return laws[0].joint_density(first, second, x, y)

    def __repr__(self) -> str:
        lines = [f"  {' and '.join(law.bodies)}: temperature {law.temperature:.6g} J" for law in self.laws]
        return "\n".join(["ExactReference: density proportional to exp(−H/T)", *lines])

    def _law(self, oscillator: str, quantity: str) -> Law:
        for kind, name, known in (
            ("body", oscillator, self.network.oscillators),
            ("quantity", quantity, _QUANTITIES),
        ):
            if name not in known:
                raise InvalidInput(f"There is no {kind} {name!r}; {suggestion(name, known)}")
        return next(law for law in self.laws if oscillator in law.bodies)

    def _thermal_velocity(self, oscillator: str) -> float:
        temperature = self._law(oscillator, "velocity").temperature
        return math.sqrt(temperature / self.network.oscillators[oscillator].mass)

    def _moments(self, name: str) -> dict[str, float]:
        mean, variance = self._law(name, "displacement").moments(name)
        return {
            "mean_displacement": mean,
            "mean_square_displacement": variance + mean**2,
            "variance_displacement": variance,
            "mean_velocity": 0.0,
            "mean_square_velocity": self._thermal_velocity(name) ** 2,
        }

    def _contact(self, contact: Contact) -> dict[str, float]:
        sides = [side for side in (contact.first, contact.second) if isinstance(side, str)]
        law = self._law(sides[0], "displacement")
        relative_velocity = math.sqrt(sum(self._thermal_velocity(name) ** 2 for name in sides))
        ratio, density, force = law.contact(contact)
        return {
            "contact_ratio": ratio,
            "contact_rate": relative_velocity / math.sqrt(2.0 * math.pi) * density,
            "mean_contact_force": force,
        }


def exact(network: Network) -> ExactReference:
    """Return the exact stationary law of a network that has one which is known here.

    Known are networks in which the bodies that contacts and couplings connect form trees: between
    any two of them at most one way, over one or more contacts and couplings. Bodies may have
    residual potentials and walls. The noises must be white, the contact forces have a
    potential, the couplings be linear without damping, and the temperatures ``π S / damping`` of connected bodies
    be equal (for two unit masses ``S1/S2 = ζ1 ω1/(ζ2 ω2)``, Luo, Yan and Zhang, 2023,
    equation 8); then the density is proportional to ``exp(−H/T)`` with the energy H.

    Parameters
    ----------
    network : Network
        Bodies, contacts and white noises.

    Returns
    -------
    ExactReference

    Raises
    ------
    NoExactReference
        If there is no such law; the message gives all reasons with the names of the bodies.
    InvalidInput
        If `network` is not a network, or a potential is not the integral of its force.
    """
    if not isinstance(network, Network):
        raise InvalidInput(f"exact takes an il.Network, {network!r} was given.")
    return ExactReference(network, gibbs_laws(network))


def _finite(name: str, values: Any) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise InvalidInput(f"{name} must hold finite numbers only.")
    return array
