"""Small random networks, on which the accuracy of a simulation is judged."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.transfer.quadrature import Quadrature
from impactlab_numerics.transfer.trees import transfer_statistics

Side = Any  # the name of a body, or il.WALL

_CHAIN = 0.5
"""Probability of a chain."""

_WALL = 0.25
"""Probability of a wall, per body."""

_DUFFING = 0.25
"""Probability of a cubic spring, per body."""

_COUPLING = 0.15
"""Probability of a spring instead of a contact between two bodies."""

_BOTH = 0.15
"""Probability of a spring beside a contact."""

LEAST_RATE = 0.05
"""Least rate at which a contact closes (1/s); one that others keep apart is drawn again."""


@functools.cache
def random_network(seed: int, equal_temperature: bool = True) -> il.Network:
    """Return a random network of 2 to 6 bodies in a chain or a tree.

    Masses lie between 0.1 and 10 kg, natural frequencies between 2 and 63 rad/s, damping
    ratios between 0.02 and 0.5, uniform in the logarithm; forces of contacts are those of
    Hertz, linear, or a power from 1 to 3 of the indentation. At the temperature T = 1 J, s being
    the standard deviation of the gap by the springs alone, clearances are uniform between −s and
    3 s. The frequency of a closed contact, at the indentation that stores T, is 0.3 to 10 times
    that of the faster body. A body may have a wall on one side, and a cubic spring, which at the
    standard deviation of the linear one has 0.1 to 2 times its force. Two bodies may be coupled
    by a spring instead of or beside a contact, 0.1 to 10 times as stiff as ``T/s²``. A contact
    that closes less often than `LEAST_RATE` is drawn again.

    Parameters
    ----------
    seed : int
        Which one.
    equal_temperature : bool
        Whether all bodies have the temperature of 1 J; otherwise the noise on each
        is up to twice as strong or as weak, at the same dampings.

    Returns
    -------
    Network
    """
    if not equal_temperature:
        rng = np.random.default_rng([seed, 1])
        noise = random_network(seed).excitations
        return random_network(seed).replace(
            excitations={
                name: il.WhiteNoise(_between(rng, 0.5, 2.0) * item.spectral_density)  # type: ignore[attr-defined]
                for name, item in noise.items()
            }
        )
    rng = np.random.default_rng([seed, 0])
    names = [f"body_{index}" for index in range(int(rng.integers(2, 7)))]
    is_chain = rng.random() < _CHAIN
    bodies = {name: _oscillator(rng) for name in names}
    contacts: dict[str, il.Contact] = {}
    couplings: dict[str, il.Coupling] = {}
    for index, name in enumerate(names):
        if index:
            other = names[index - 1 if is_chain else int(rng.integers(index))]
            kind = rng.random()
            if kind > _COUPLING or not contacts:
                contacts[f"contact_{len(contacts)}"] = _contact(rng, bodies, name, other)
            if kind < _COUPLING + _BOTH:
                couplings[f"coupling_{len(couplings)}"] = _coupling(rng, bodies, name, other)
        if rng.random() < _WALL:
            contacts[f"contact_{len(contacts)}"] = _contact(rng, bodies, name, il.WALL)
    noises = {name: il.WhiteNoise(body.damping / math.pi) for name, body in bodies.items()}
    network = il.Network(bodies, contacts, noises, couplings)
    while rare := [name for name, rate in closing_rates(network).items() if rate < LEAST_RATE]:
        contacts |= {name: _contact(rng, bodies, contacts[name].first, contacts[name].second) for name in rare}
        network = network.replace(contacts=contacts)
    return network


@functools.cache
def closing_rates(network: il.Network) -> dict[str, float]:
    """Return how often each contact closes (1/s), to a few digits."""
    return transfer_statistics(network, Quadrature(order=10, tolerance=1e-5))["contact_rate"]


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number that is uniform in its logarithm."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _oscillator(rng: np.random.Generator) -> il.Oscillator:
    mass, frequency = _between(rng, 0.1, 10.0), _between(rng, 2.0, 2.0 * 10**1.5)
    ratio, share = _between(rng, 0.02, 0.5), _between(rng, 0.1, 2.0)
    if rng.random() >= _DUFFING:
        return il.LinearOscillator.from_frequency(frequency, ratio, mass=mass)
    cubic = share * (mass * frequency**2) ** 2  # force at x² = 1/k: cubic x³ = share k x
    return il.DuffingOscillator.from_frequency(frequency, ratio, mass=mass, cubic=cubic)


def _spread(bodies: dict[str, il.Oscillator], *sides: Side) -> float:
    """Return the standard deviation of a gap by the springs alone, at the temperature of 1 J."""
    return math.sqrt(sum(1.0 / bodies[side].stiffness for side in sides if isinstance(side, str)))


def _contact(rng: np.random.Generator, bodies: dict[str, il.Oscillator], one: Side, other: Side) -> il.Contact:
    first, second = (one, other) if rng.random() < 0.5 else (other, one)
    clearance = rng.uniform(-1.0, 3.0) * _spread(bodies, one, other)
    touching = [bodies[side] for side in (first, second) if isinstance(side, str)]
    frequency = _between(rng, 0.3, 10.0) * max(body.natural_frequency for body in touching)
    tangent = frequency**2 / sum(1.0 / body.mass for body in touching)
    kind, power = int(rng.integers(3)), rng.uniform(1.0, 3.0)
    exponent = (1.5, 1.0, power)[kind]
    depth = math.sqrt(exponent * (exponent + 1.0) / tangent)  # stores 1 J at that tangent stiffness
    stiffness = (exponent + 1.0) / depth ** (exponent + 1.0)
    laws = (il.HertzContact(stiffness), il.LinearContact(stiffness), il.PowerLawContact(stiffness, exponent=power))
    return il.Contact(first, second, laws[kind], clearance=clearance)


def _coupling(rng: np.random.Generator, bodies: dict[str, il.Oscillator], one: Side, other: Side) -> il.Coupling:
    stiffness = _between(rng, 0.1, 10.0) / _spread(bodies, one, other) ** 2
    return il.Coupling(one, other, il.LinearCoupling(stiffness))
