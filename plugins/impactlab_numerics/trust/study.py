"""The trust study: default simulations of random networks of all classes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

import impactlab as il
from impactlab.studies import FolderStudy, Item


class TrustStudy(FolderStudy):
    """Random networks of all classes at default settings: right within their errors, or warned of, or refused.

    Networks are drawn class by class: rate-dependent contacts, damping in residual forces, kinks, jumps and saturation,
    given forces, noise that varies in time, bounded noise, static loads, heavy bases, unequal temperatures, rows of
    undamped bodies, starts and short runs, few realizations, rare contacts, weak and strong damping, and smooth
    conservative contacts under white noise. Each is simulated at default settings and compared with its exact law, a
    run at a sixteenth of the step whose contacts are counted, or, where nothing is random, a path by another solver. A
    default statistic but the peak is *wrong* beyond 0.5 % and three standard errors, and *silently* wrong if nothing
    was said.
    """

    name: ClassVar[str] = "trust"
    title: ClassVar[str] = "Trust: random networks of all classes at default settings"

    captions: ClassVar[Mapping[str, str]] = {
        "outcomes": "What became of the random networks of each class, in percent.",
        "differences": (
            "Differences of all statistics from what is right, over what is allowed, by class; beyond 1 is wrong."
        ),
        "coverage": "How many 95 % intervals hold what is right, by class, with bars of two standard errors.",
    }

    sections: ClassVar[Mapping[str, str]] = {
        "random networks of all classes": "no silent errors, few needless refusals, intervals that cover",
    }

    networks: int = il.parameter(400, minimum=1)
    first_network: int = il.parameter(0, minimum=0)
    share: float = il.parameter(1.0, above=0.0, maximum=1.0)
    reference_body_steps: float = il.parameter(2.4e8, above=0.0)
    kept_in: str = il.parameter("")

    def quick(self) -> Self:
        """The smoke form: one network of each class, and fewer realizations."""
        return self.replace(networks=16, first_network=16, share=0.1, reference_body_steps=2e7)

    @property
    def seeds(self) -> range:
        """Numbers of the random networks."""
        return range(self.first_network, self.first_network + self.networks)

    def items(self) -> list[Item]:
        """Nothing: warnings and refusals are results too, so `collect` simulates."""
        return []
