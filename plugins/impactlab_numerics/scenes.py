"""The scenes on which methods are compared, their exact laws, and their numbers as plain arrays."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import impactlab as il

if TYPE_CHECKING:
    import numpy as np

STATISTICS = ("mean_square_displacement", "contact_ratio", "mean_contact_force", "density")
"""What is compared: of the last body and of the last contact."""

TEMPERATURE = 2.5  # J, that of the base case
_STIFFNESS = 1e4  # N m-3/2
_CLEARANCE = 0.05  # m
_RANGE = 5.0  # half width of a density in standard deviations of the body alone


def scene(bodies: int) -> il.Network:
    """Return bodies of 1 kg in a row at 2.5 J, which can touch their neighbours.

    The natural frequencies fall from 32π to 2π rad/s in equal ratios, the damping ratios are
    0.1, contacts are of Hertz with 10⁴ N m^(-3/2) and a clearance of 0.05 m. Two bodies are the
    base case of Luo, Yan and Zhang (2023): ω1/ω2 = 16, spectral densities 16 and 1.
    """
    oscillators = _falling(bodies)
    return il.chain(
        bodies,
        oscillators,
        il.HertzContact(_STIFFNESS),
        clearance=_CLEARANCE,
        excitation=[_noise(body) for body in oscillators],
    )


def grid(bodies: int) -> il.Network:
    """Return the bodies of a row in lines as long as there are lines, about: each can touch the next and that below."""
    width = math.isqrt(bodies)
    row = [(body, body + 1) for body in range(bodies - 1) if (body + 1) % width]
    return _network(_falling(bodies), row + [(body, body + width) for body in range(bodies - width)])


def star(bodies: int) -> il.Network:
    """Return a body that can touch all others, which are those of a row; its mass is that of the others together."""
    hub = il.LinearOscillator.from_frequency(2.0 * math.pi, 0.1, mass=bodies - 1.0)
    return _network([hub, *_falling(bodies - 1)], [(body, 0) for body in range(1, bodies)])


GRAPHS = {"chain": scene, "grid": grid, "star": star}
"""What makes a network of a number of bodies, by name."""


def _falling(bodies: int) -> list[il.LinearOscillator]:
    frequencies = [2.0 * math.pi * 16.0 ** (1.0 - body / (bodies - 1)) for body in range(bodies)]
    return [il.LinearOscillator.from_frequency(frequency, 0.1) for frequency in frequencies]


def _noise(body: il.Oscillator) -> il.WhiteNoise:
    return il.WhiteNoise(TEMPERATURE * body.damping / math.pi)


def _network(bodies: list[il.LinearOscillator], pairs: list[tuple[int, int]]) -> il.Network:
    named = {f"body_{number}": body for number, body in enumerate(bodies)}
    contacts = {
        f"contact_{number}": il.Contact(
            f"body_{first}", f"body_{second}", il.HertzContact(_STIFFNESS), clearance=_CLEARANCE
        )
        for number, (first, second) in enumerate(pairs)
    }
    return il.Network(named, contacts, {name: _noise(body) for name, body in named.items()})


def shaken(network: il.Network, components: int, band: tuple[float, float]) -> il.Network:
    """Return the network with series of cosines in place of white noise."""
    noises = {
        name: il.ShinozukaNoise(noise.spectral_density, band=band, components=components)  # type: ignore[attr-defined]
        for name, noise in network.excitations.items()
    }
    return network.replace(excitations=noises)


def automatic_step(network: il.Network) -> float:
    """Return the step that a simulation chooses, before it is made to divide the duration (s)."""
    return float(network.check().dataset.attrs["step"])


def limits(network: il.Network) -> tuple[str, float, float]:
    """Return the last body with the range of its density (m)."""
    name, body = list(network.oscillators.items())[-1]
    reach = _RANGE * math.sqrt(TEMPERATURE / body.stiffness)
    return name, -reach, reach


@dataclass(frozen=True, eq=False)
class Law:
    """Exact values: of `STATISTICS` but the density, and the density in each bin (m-1)."""

    values: np.ndarray
    edges: np.ndarray
    density: np.ndarray

    @classmethod
    def of(cls, network: il.Network, bins: int) -> Self:
        """Return the law of a scene: from `il.exact` for a pair, by transfer integrals for a chain."""
        import numpy as np

        body, low, high = limits(network)
        contact = list(network.contacts)[-1]
        edges = np.linspace(low, high, bins + 1)
        if len(network.oscillators) == 2:
            exact = il.exact(network)
            found: Any = exact.statistics()
            return cls(
                np.array([float(found[name][-1]) for name in STATISTICS[:-1]]),
                edges,
                exact.bin_density(body, "displacement", edges),
            )
        from impactlab_numerics.transfer.trees import Tree

        tree = Tree(network)
        known = tree.of_body(body) | tree.of_contact(contact)
        logarithm = tree.density(body)
        everywhere = np.linspace(logarithm.edges[0], logarithm.edges[-1], 4 * bins + 1)
        top = float(logarithm(everywhere).max())
        total = (_averages(logarithm, everywhere, top) * np.diff(everywhere)).sum()
        values = np.array([known[name] for name in STATISTICS[:-1]])
        return cls(values, edges, _averages(logarithm, edges, top) / total)


def _averages(logarithm: Callable[[np.ndarray], np.ndarray], edges: np.ndarray, top: float) -> np.ndarray:
    """Return the means over bins of a function, divided by ``exp(top)``, that is given by its logarithm."""
    import numpy as np

    nodes, weights = np.polynomial.legendre.leggauss(16)
    places = 0.5 * (edges[:-1, None] + edges[1:, None] + np.diff(edges)[:, None] * nodes)
    return np.asarray(0.5 * np.exp(logarithm(places.ravel()) - top).reshape(places.shape) @ weights)


@dataclass(frozen=True, eq=False)
class Arrays:
    """A scene as a user writes it down for a loop: per body stiffness, damping, spectral density; the contacts."""

    stiffness: np.ndarray
    damping: np.ndarray
    spectral_density: np.ndarray
    hertz: float
    clearance: float

    @classmethod
    def of(cls, network: il.Network) -> Self:
        """Read the numbers of a scene of unit masses with equal contacts."""
        import numpy as np

        bodies = list(network.oscillators.values())
        noises: list[Any] = [network.excitations[name] for name in network.oscillators]
        contact: Any = next(iter(network.contacts.values()))
        return cls(
            np.array([body.stiffness for body in bodies]),
            np.array([body.damping for body in bodies]),
            np.array([noise.spectral_density for noise in noises]),
            contact.law.stiffness,
            contact.clearance,
        )
