"""Exact stationary statistics of bodies in a tree, by sums over products along its edges.

The density ``exp(−H/T)`` of bodies at one temperature is a product of a function of each
displacement and of functions of the differences of two. On a tree it is integrated body by
body: the message of body i to its neighbour j is

    M(x_j) = ∫ f(x_i) exp(−U(x_i − x_j)/T) dx_i ,

f being the factor of i times all messages that it got from its other neighbours, U the
potential between the two. Each integral is one-dimensional. In a chain this is the method
of transfer integrals (Scalapino, Sears and Ferrell, Phys. Rev. B 6, 1972, 3409), in a tree
the sum-product algorithm (Kschischang, Frey and Loeliger, IEEE Trans. Inf. Theory 47, 2001,
498). Nothing is shared with `impactlab.exact`, not even the formulas of the laws.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.transfer.quadrature import Function, Quadrature, Table

REACH = 12.0
"""Half width of the range of a displacement, in standard deviations of its spring alone."""

VANISHED = 80.0
"""Energy of a contact in units of T beyond which it needs no panels of its own."""

_DROP = 25.0  # of the logarithm of a density from its top to the ends of its range
_CHUNK = 60_000  # points that are looked at together


@dataclass(frozen=True)
class Side:
    """A force on one side of a corner of the difference ``u = x_source − x_target``; a wall is a target at 0.

    The force is ``stiffness δ^exponent`` at ``δ = sign (u − corner) > 0``.
    """

    name: str
    sign: float
    corner: float
    stiffness: float
    exponent: float

    @classmethod
    def all_of(cls, name: str, link: Any, source: str) -> list[Side]:
        """Return a contact as seen from one of its bodies, or a spring as two linear sides."""
        law, sign = link.law, 1.0 if link.first == source else -1.0
        if isinstance(law, il.LinearCoupling) and not law.damping:
            return [cls(name, side, 0.0, law.stiffness, 1.0) for side in (-1.0, 1.0)]
        match law:
            case il.HertzContact():
                exponent = 1.5
            case il.LinearContact():
                exponent = 1.0
            case il.PowerLawContact():
                exponent = law.exponent
            case _:
                raise il.InvalidInput(
                    f"Transfer integrals know powers of the indentation and springs without damping, not {law!r}."
                )
        return [cls(name, sign, sign * link.clearance, law.stiffness, exponent)]

    def indentation(self, u: np.ndarray) -> np.ndarray:
        """Return δ, 0 on the other side of the corner."""
        return np.asarray(np.maximum(self.sign * (u - self.corner), 0.0))

    def force(self, u: np.ndarray) -> np.ndarray:
        """Return the force."""
        return np.asarray(self.stiffness * self.indentation(u) ** self.exponent)

    def potential(self, u: np.ndarray) -> np.ndarray:
        """Return the potential of the force."""
        power = self.exponent + 1.0
        return np.asarray(self.stiffness / power * self.indentation(u) ** power)

    def thermal_depth(self, temperature: float) -> float:
        """Return the indentation that stores the energy T."""
        power = self.exponent + 1.0
        return float((power * temperature / self.stiffness) ** (1.0 / power))

    def thermal_force(self, temperature: float) -> float:
        """Return the force at that indentation."""
        return float(self.stiffness * self.thermal_depth(temperature) ** self.exponent)

    def depths(self, temperature: float) -> np.ndarray:
        """Return differences, doubling from the corner, between which ``exp(−U/T)`` is smooth."""
        power = self.exponent + 1.0
        doubling = 2.0 ** np.arange(-math.ceil(48.0 / power), 1)
        steps = np.arange(2.0, VANISHED ** (1.0 / power) + 1.0)
        offsets = np.concatenate([[0.0], doubling, steps])
        return np.asarray(self.corner + self.sign * self.thermal_depth(temperature) * offsets)


class Tree:
    """Exact statistics of a network whose bodies form trees.

    Parameters
    ----------
    network : Network
        Linear or Duffing bodies with springs, at one temperature π S / damping; contacts with
        forces that are powers of the indentation, and springs, between bodies that form trees
        and between bodies and walls. No body may be pressed to the ends of its range.
    quadrature : Quadrature, optional
        How finely functions are resolved.

    Raises
    ------
    InvalidInput
        If the network is none of these.
    """

    def __init__(self, network: il.Network, quadrature: Quadrature | None = None) -> None:
        self.network, self.quadrature = network, quadrature or Quadrature()
        self.temperature = temperature_of(network)
        self.sides: dict[str, dict[str | None, list[Side]]] = {name: {None: []} for name in network.oscillators}
        links: list[tuple[str, Any]] = [*network.contacts.items(), *network.couplings.items()]
        for name, link in links:
            bodies = _bodies(link)
            for source in bodies:
                target = next((body for body in bodies if body != source), None)
                self.sides[source].setdefault(target, []).extend(Side.all_of(name, link, source))
        self._refuse_loops()
        self._messages: dict[tuple[str, str], Table] = {}

    def _refuse_loops(self) -> None:
        seen: set[str] = set()
        for root in self.sides:
            waiting = [] if root in seen else [(root, "")]
            while waiting:
                body, origin = waiting.pop()
                if body in seen:
                    raise il.InvalidInput(f"The bodies form a loop at {body!r}; transfer integrals need a tree.")
                seen.add(body)
                waiting += [(other, body) for other in self.neighbours(body) if other != origin]

    def neighbours(self, body: str) -> list[str]:
        """Return the bodies that one touches or is coupled to."""
        return [other for other in self.sides[body] if other is not None]

    def edges(self, body: str) -> np.ndarray:
        """Return the edges of the panels with which a table begins."""
        reach = REACH * math.sqrt(self.temperature / self.network.oscillators[body].stiffness)
        corners = [side.corner for side in self.sides[body][None]]
        edges = np.union1d(np.linspace(-reach, reach, 9), corners)
        return edges[np.abs(edges) <= reach]

    def factor(self, body: str, x: np.ndarray) -> np.ndarray:
        """Return the logarithm of the factor of a body alone, with its walls."""
        oscillator = self.network.oscillators[body]
        energy = 0.5 * oscillator.stiffness * x**2
        if isinstance(oscillator, il.DuffingOscillator):
            energy = energy + 0.25 * oscillator.cubic * x**4
        for side in self.sides[body][None]:
            energy = energy + side.potential(x)
        return np.asarray(-energy / self.temperature)

    def density(self, body: str, without: str | None = None) -> Table:
        """Return the density of a body, not normalised, without the transfer integral of one neighbour."""
        got = [self.message(other, body) for other in self.neighbours(body) if other != without]
        return self.quadrature.table(
            lambda x: sum((table(x) for table in got), start=self.factor(body, x)), self.edges(body)
        )

    def message(self, source: str, target: str) -> Table:
        """Return the transfer integral of a body as a function of its neighbour's displacement."""
        key = source, target
        if key not in self._messages:
            transfer = self.transfer(source, target)
            self._messages[key] = self.quadrature.table(lambda x: transfer(x)[0], self.edges(target))
        return self._messages[key]

    def transfer(self, source: str, target: str) -> Function:
        """Return a function of the target's displacement: the integral over that of the source.

        Its first row is the logarithm of the message. For each side follow the probability that it
        is closed and its mean force, given the target's displacement.
        """
        sides, density = self.sides[source][target], self.density(source, target)
        offsets = np.concatenate([side.depths(self.temperature) for side in sides])
        size = (len(density.edges) + len(offsets)) * self.quadrature.order

        def rows(x: np.ndarray) -> np.ndarray:
            """Integrate over panels that begin and end at the contacts, too; (row, place)."""
            moved = np.clip(x[:, None] + offsets, density.edges[0], density.edges[-1])
            fixed = np.broadcast_to(density.edges, (len(x), len(density.edges)))
            edges = np.sort(np.concatenate([moved, fixed], axis=1), axis=1)
            places, weights = self.quadrature.points(edges)
            u = places - x[:, None, None]
            exponent = (
                density.on(0.5 * (edges[:, 1:] + edges[:, :-1]), places)
                - sum(side.potential(u) for side in sides) / self.temperature
            )
            exponent[np.broadcast_to(weights <= 0.0, exponent.shape)] = -np.inf
            highest = exponent.max(axis=(1, 2))
            weights = weights * np.exp(exponent - highest[:, None, None])
            total = weights.sum(axis=(1, 2))
            averages = [
                (weights * read).sum(axis=(1, 2)) / total
                for side in sides
                for read in (side.indentation(u) > 0.0, side.force(u))
            ]
            return np.stack([highest + np.log(total), *averages])

        def function(x: np.ndarray) -> np.ndarray:
            parts = np.array_split(x, max(1, len(x) * size // _CHUNK))
            return np.concatenate([rows(part) for part in parts], axis=1)

        return function

    def of_body(self, body: str) -> dict[str, float]:
        """Return the statistics of a body."""
        density = self.density(body)
        top = density.top

        def moments(center: float, scale: float) -> np.ndarray:
            def function(x: np.ndarray) -> np.ndarray:
                z = (x - center) / scale
                return np.exp(density(x) - top) * np.stack([np.ones_like(z), z, z**2])

            return self.quadrature.integrals(function, density.edges)

        if max(density(density.edges[[0, -1]])) > top - _DROP:
            raise il.InvalidInput(f"{body!r} is pressed to {REACH:g} standard deviations of its spring and farther.")
        scale = math.sqrt(self.temperature / self.network.oscillators[body].stiffness)
        total, first, _ = moments(0.0, scale)
        mean = scale * first / total
        variance = scale**2 * moments(mean, scale)[2] / total
        return {
            "mean_displacement": mean,
            "mean_square_displacement": variance + mean**2,
            "variance_displacement": variance,
            "mean_velocity": 0.0,
            "mean_square_velocity": self.temperature / self.network.oscillators[body].mass,
        }

    def of_contact(self, name: str) -> dict[str, float]:
        """Return the statistics of a contact.

        The rate is that of a Gaussian velocity through the corner, ``sqrt(T/(2πμ)) p(corner)``
        with ``1/μ`` the sum of the inverse masses.
        """
        contact = self.network.contacts[name]
        bodies = _bodies(contact)
        ratio, force, density = self._of_pair(name, *bodies) if len(bodies) == 2 else self._of_wall(name, *bodies)
        velocity = math.sqrt(self.temperature * sum(1.0 / self.network.oscillators[body].mass for body in bodies))
        return {
            "contact_ratio": ratio,
            "contact_rate": velocity / math.sqrt(2.0 * math.pi) * density,
            "mean_contact_force": force,
        }

    def _of_wall(self, name: str, body: str) -> tuple[float, float, float]:
        """Return contact ratio, mean force and density of the displacement at the corner of a wall."""
        side = next(side for side in self.sides[body][None] if side.name == name)
        density = self.density(body)
        top, force = density.top, side.thermal_force(self.temperature)

        def function(x: np.ndarray) -> np.ndarray:
            rows = np.ones_like(x), side.indentation(x) > 0.0, side.force(x) / force
            return np.asarray(np.exp(density(x) - top) * np.stack(rows))

        total, ratio, forced = self.quadrature.integrals(function, density.edges)
        inside = density.edges[0] < side.corner < density.edges[-1]
        here = math.exp(float(density(np.array([side.corner]))[0]) - top) if inside else 0.0
        return ratio / total, force * forced / total, here / total

    def _of_pair(self, name: str, source: str, target: str) -> tuple[float, float, float]:
        """Return contact ratio, mean force and density of the gap at the corner of a contact of two bodies."""
        sides = self.sides[source][target]
        row = [side.name for side in sides].index(name)
        transfer, density = self.transfer(source, target), self.density(target)
        top, force = density.top, sides[row].thermal_force(self.temperature)

        def function(x: np.ndarray) -> np.ndarray:
            closed, mean_force = transfer(x)[1 + 2 * row : 3 + 2 * row]
            rows = np.ones_like(x), closed, mean_force / force
            return np.asarray(np.exp(density(x) - top) * np.stack(rows))

        total, ratio, forced = self.quadrature.integrals(function, density.edges)
        corner = sides[row].corner
        energy = sum(float(side.potential(np.array([corner]))[0]) for side in sides) / self.temperature
        rest, own = self.density(target, source), self.density(source, target)
        (here,) = self.quadrature.integrals(
            lambda x: np.exp(rest(x) + own(x + corner) - energy - top)[None], rest.edges, own.edges - corner
        )
        return ratio / total, force * forced / total, here / total


def temperature_of(network: il.Network) -> float:
    """Return the temperature ``π S / damping`` that all bodies of a network share (J).

    Raises
    ------
    InvalidInput
        If they share none, or a body is not a linear or Duffing oscillator with a spring under white noise.
    """
    temperatures = []
    for name, body in network.oscillators.items():
        noise = network.excitations.get(name)
        if type(body) not in (il.LinearOscillator, il.DuffingOscillator) or not body.stiffness or not body.damping:
            raise il.InvalidInput(f"{name!r} must be linear or Duffing, with a spring and a damper: {body!r}.")
        if not isinstance(noise, il.WhiteNoise):
            raise il.InvalidInput(f"{name!r} must be excited by white noise, not by {noise!r}.")
        temperatures.append(math.pi * noise.spectral_density / body.damping)
    if max(temperatures) - min(temperatures) > 1e-9 * max(temperatures):
        raise il.InvalidInput(f"The bodies have different temperatures: {temperatures}.")
    return temperatures[0]


def transfer_statistics(network: il.Network, quadrature: Quadrature | None = None) -> dict[str, dict[str, float]]:
    """Return the exact default statistics but the peak force: by statistic, then by body or contact.

    See `Tree` for the networks that it can deal with.
    """
    tree = Tree(network, quadrature)
    result: dict[str, dict[str, float]] = {}
    for label, values in _all(tree):
        for name, value in values.items():
            result.setdefault(name, {})[label] = value
    return result


def _all(tree: Tree) -> Iterator[tuple[str, dict[str, float]]]:
    yield from ((name, tree.of_body(name)) for name in tree.network.oscillators)
    yield from ((name, tree.of_contact(name)) for name in tree.network.contacts)


def _bodies(link: il.Contact | il.Coupling) -> list[str]:
    """Return the one or two bodies that a contact or a coupling has."""
    return [side for side in (link.first, link.second) if isinstance(side, str)]
