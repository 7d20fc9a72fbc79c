"""The coverage study: how often intervals of records and questions hold what longer runs find."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

import impactlab as il
from impactlab.studies import FolderStudy, Item


class CoverageStudy(FolderStudy):
    """Random networks of all classes, asked for all that has an error: how often do intervals of 95 % hold?

    Every other network is of a class of `trust` or has combinations, shared noise, structures and states of laws; the
    others mix all mechanisms. Each is asked in a short run and, with other noise and the same step, in one of several
    times as many realizations: records of observables, energy flows, extremes, cycles, correlation and wear; first
    passages; fragility; statistics over uncertain numbers. Counted is how often two values differ by less than two
    errors of their difference. Balances of energy are compared with 0.
    """

    name: ClassVar[str] = "coverage"
    title: ClassVar[str] = "Coverage: intervals of records and questions in random networks of all classes"

    captions: ClassVar[Mapping[str, str]] = {
        "coverage": "How many 95 % intervals hold what a longer run finds, with bars of two standard errors.",
    }

    sections: ClassVar[Mapping[str, str]] = {
        "intervals": "intervals hold as often as they should",
        "balances": "energy balances up to its errors",
    }

    networks: int = il.parameter(200, minimum=1)
    first_network: int = il.parameter(0, minimum=0)
    realizations: int = il.parameter(64, minimum=64)
    times: int = il.parameter(8, minimum=4)

    def quick(self) -> Self:
        """The smoke form: six networks."""
        return self.replace(networks=6)

    @property
    def numbers(self) -> range:
        """Numbers of the random networks."""
        return range(self.first_network, self.first_network + self.networks)

    def items(self) -> list[Item]:
        """Nothing: refusals are results too, so `collect` simulates."""
        return []
