"""The scaling study: cost of a simulation in large networks, with rare contacts, under series, and in sweeps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import impactlab as il
from impactlab.studies import FolderStudy, Item
from impactlab_numerics.scenes import TEMPERATURE, automatic_step, scene

METHODS = {"jumps": True, "steps": False}
"""Whether the exact flow may jump, by method: the default method is compared with one that makes every step."""

SEEN = 1e3
"""Contacts from which standard errors of their statistics are known."""

WANTED = 1e5
"""Contacts that are enough."""

SHORTEST = 40.0
"""Least duration (s), in which all bodies relax many times."""


class ScalingStudy(FolderStudy):
    """Cost against the number of bodies and against the clearance, of bounded noise and of sweeps.

    All times are of one core, measured in rounds in which each case has its turn; the smallest counts.
    Chains, grids and stars are compared with the pair of the base case. For the pair at larger
    clearances, in standard deviations σ of the gap without contacts, the default method is
    compared with one that makes every step, at equal error: run time × (standard error)².
    """

    name: ClassVar[str] = "scaling"
    title: ClassVar[str] = "Scaling: cost against size, clearance and noise"

    captions: ClassVar[Mapping[str, str]] = {
        "cost_against_size": (
            "Time per step of a body (left) and memory per body and realization (right) against the number of "
            "bodies, for chains, grids and stars; grey: what is claimed."
        ),
        "cost_against_clearance": (
            "The pair with rarer and rarer contacts: time of the default method and of one that makes every step "
            "(left), and the gain at equal error (right)."
        ),
    }

    sections: ClassVar[Mapping[str, str]] = {
        "size": "cost, memory and time of construction against the number of bodies",
        "clearance": "how much time contact-free intervals save",
        "exactness": "contact-free intervals leave no bias",
        "bounded noise": "the default method against Runge–Kutta under sums of cosines",
        "sweep": "points of a sweep compile nothing new",
        "records": "what records add to a run",
    }

    sizes: tuple[int, ...] = il.parameter((2, 10, 100, 1000, 10000, 100000), minimum=2)
    graph_sizes: tuple[int, ...] = il.parameter((100, 10000), minimum=4)
    clearances: tuple[float, ...] = il.parameter((0.2, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), minimum=0.0)
    body_steps: float = il.parameter(2e9, above=0.0)
    realizations: int = il.parameter(2080, minimum=64)
    exact_clearance: float = il.parameter(2.0, minimum=0.0)
    standard_error: float = il.parameter(5e-4, above=0.0)
    components: int = il.parameter(50000, minimum=1)
    band: tuple[float, float] = il.parameter((0.0, 500.0), units="Hz", minimum=0.0)
    paper_step: float = il.parameter(0.001, units="s", above=0.0)
    rounds: int = il.parameter(3, minimum=1)
    timing_seconds: float = il.parameter(0.3, units="s", above=0.0)
    seed: int = il.parameter(2026, minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("sizes", "clearances"):
            values = getattr(self, name)
            if not values or list(values) != sorted(set(values)):
                raise il.InvalidInput(f"{name} must be rising numbers, not {list(values)!r}.")
        if self.sizes[0] != 2:
            raise il.InvalidInput(
                f"sizes must begin with 2, the pair with which others are compared, not {self.sizes[0]}."
            )
        self.shaken()  # checks the band

    def quick(self) -> Self:
        """The smoke form: small networks, few clearances, short runs."""
        return self.replace(
            sizes=(2, 10, 50),
            graph_sizes=(16,),
            clearances=(0.2, 2.0, 6.0),
            body_steps=2e7,
            realizations=520,
            standard_error=5e-3,
            components=2000,
            band=(0.0, 20.0),
            rounds=2,
            timing_seconds=0.01,
        )

    def graphs(self) -> list[tuple[str, int]]:
        """Return graph and number of bodies of the networks, as in `impactlab_numerics.scenes.GRAPHS`."""
        chains = [("chain", bodies) for bodies in self.sizes]
        return chains + [(graph, bodies) for graph in ("grid", "star") for bodies in self.graph_sizes]

    def apart(self, clearance: float) -> il.Network:
        """Return the pair with a clearance in standard deviations of the gap."""
        pair = scene(2)
        deviation = math.sqrt(sum(TEMPERATURE / body.stiffness for body in pair.oscillators.values()))
        contacts = {name: item.replace(clearance=clearance * deviation) for name, item in pair.contacts.items()}
        return pair.replace(contacts=contacts)

    def shaken(self) -> il.Network:
        """Return the pair under series of cosines."""
        from impactlab_numerics.scenes import shaken

        return shaken(scene(2), self.components, self.band)

    @property
    def period(self) -> float:
        """Time after which a series of cosines repeats (s)."""
        return self.components / (self.band[1] - self.band[0])

    def items(self) -> list[Item]:
        """Runs at each clearance with both methods, and a long run for the comparison with the exact law."""
        items = []
        for clearance in self.clearances:
            network = self.apart(clearance)
            affordable = 0.5 * self.body_steps * automatic_step(network)
            rate = closing_rate(network)
            total = min(affordable, WANTED / rate) if affordable * rate >= SEEN else 0.0
            for name, jumps in METHODS.items():
                options = {**self._length(total), "integrator": il.ExactFlow(jumps=jumps, measured=False)}
                items.append(Item(f"{name}_{clearance:g}", network, options))
        network = self.apart(self.exact_clearance)
        items.append(Item("exactness", network, self._length(1.3**2 / closing_rate(network) / self.standard_error**2)))
        return items

    def _length(self, total: float) -> dict[str, Any]:
        """Return options for a simulated time of all realizations together (s)."""
        duration = max(SHORTEST, total / self.realizations)
        return {"duration": duration, "realizations": self.realizations, "rng": self.seed}


def closing_rate(network: il.Network) -> float:
    """Return the exact number of contacts per second of a pair."""
    return float(il.exact(network).statistics()["contact_rate"][0])
