"""Couplings whose force relaxes as springs and dampers in series, with a node between them that has no mass."""

from __future__ import annotations

from typing import NamedTuple

from impactlab.components.composition import Composition
from impactlab.components.coupling import Coupling, LinearCoupling, Series
from impactlab.components.oscillator import LinearOscillator
from impactlab.components.sides import weights_of, weights_of_side

LIGHT = 1e-9
"""Lag of a node over the shortest of its own relaxation time and the periods of bodies: moments are as far from those
without mass, and rounding leaves 1e-7 in correlation functions."""


class Relaxing(NamedTuple):
    """A coupling whose force relaxes."""

    name: str
    coupling: Coupling
    series: Series

    @property
    def node(self) -> str:
        """Name of the node."""
        return f"{self.name} (node)"

    def weights(self) -> dict[str, dict[str, float]]:
        """Return the weights of displacements in each state, by the name of the state."""
        stretched = {body: -weight for body, weight in weights_of_side(self.coupling.first).items()} | {self.node: 1.0}
        force = self.series.gain * self.series.stiffness
        whole = {body: -weight for body, weight in weights_of(self.coupling).items()}
        states = {self.series.state: {body: force * weight for body, weight in stretched.items()}, "last": whole}
        return {f"{self.name}.{state}": states[state] for state in self.coupling.law.state_names()}


def relaxing_couplings(network: Composition) -> list[Relaxing]:
    """Return the couplings of a network whose forces relax."""
    found = [Relaxing(name, item, item.law.series) for name, item in network.couplings.items() if item.law.series]
    return [item for item in found if item.series.stiffness > 0.0]


def with_nodes(network: Composition, relaxing: list[Relaxing]) -> Composition:
    """Return a network with springs, dampers and nodes in the place of some couplings."""
    bodies: dict[str, LinearOscillator] = {}
    links: dict[str, Coupling | None] = {}
    shortest = min(
        (1.0 / body.natural_frequency for body in network.oscillators.values() if body.stiffness), default=1.0
    )
    for item in relaxing:
        first, second, law = item.coupling.first, item.coupling.second, item.series
        lag = LIGHT * min(shortest, law.damping / law.stiffness)
        bodies[item.node] = LinearOscillator(mass=lag * law.damping)
        links[item.name] = Coupling(first, item.node, LinearCoupling(law.stiffness))
        links[f"{item.name} (damper)"] = Coupling(item.node, second, LinearCoupling(0.0, damping=law.damping))
        if law.beside:
            links[f"{item.name} (spring)"] = Coupling(first, second, LinearCoupling(law.beside))
    return network.replace(oscillators=bodies, couplings=links)
