"""The accuracy study: simulations at default settings, and simulations with a tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import impactlab as il
from impactlab.studies import FolderStudy, Item
from impactlab_numerics.scenes import automatic_step, scene

REALIZATIONS = 512
"""Realizations of a network."""


class AccuracyStudy(FolderStudy):
    """Default statistics against exact laws: of random networks, in many runs, and with a tolerance.

    Random networks at equal temperatures are compared with transfer integrals, the same ones at
    unequal temperatures with runs at a quarter of the automatic step. Further random networks in short runs, and many
    runs of the base case of Luo, Yan and Zhang (2023), count how often 95 % intervals hold the exact value, and more
    of these how often a tolerance was not kept.
    """

    name: ClassVar[str] = "accuracy"
    title: ClassVar[str] = "Accuracy: bias on random networks, coverage of intervals, tolerances that are kept"

    captions: ClassVar[Mapping[str, str]] = {
        "bias_equal": (
            "Random networks at equal temperatures: differences of all default statistics from the exact law, "
            "with bars of two standard errors, by statistic; and in standard errors against quantiles of the "
            "normal law."
        ),
        "bias_unequal": "The same at unequal temperatures, against runs at a quarter of the step.",
        "intervals": (
            "Random networks in short runs: how many of the intervals of each size hold the exact value, minus "
            "the size, by statistic; 0 is right."
        ),
        "coverage": "Many runs of the base case: how many 95 % intervals hold the exact value, by statistic.",
        "tolerance": (
            "Runs with a tolerance: the share of runs whose largest error, over the tolerance, is below what is "
            "on the abscissa."
        ),
    }

    sections: ClassVar[Mapping[str, str]] = {
        "random networks, equal temperatures": "default statistics agree with exact laws",
        "random networks, unequal temperatures": "default statistics agree with runs at a quarter of the step",
        "random networks, short runs": "intervals hold the exact value as often as they should",
        "base case, many runs": "so they do in many runs of one network",
        "base case, a tolerance": "a tolerance that is asked for is kept",
    }

    networks: int = il.parameter(20, minimum=0)
    first_network: int = il.parameter(0, minimum=0)
    standard_error: float = il.parameter(3e-4, above=0.0)
    body_steps: float = il.parameter(5e7, above=0.0)
    bias: float = il.parameter(1e-3, above=0.0)
    unequal: bool = il.parameter(True)
    coverage_networks: int = il.parameter(200, minimum=0)
    coverage_runs: int = il.parameter(200, minimum=0)
    coverage_duration: float = il.parameter(60.0, units="s", above=0.0)
    coverage_realizations: int = il.parameter(64, minimum=64)
    tolerance: float = il.parameter(1e-3, above=0.0)
    tolerance_statistic: str = il.parameter("mean_square_displacement")
    tolerance_seeds: int = il.parameter(10, minimum=0)
    seed: int = il.parameter(2023, minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.networks or self.coverage_networks or self.coverage_runs or self.tolerance_seeds):
            raise il.InvalidInput(
                "networks, coverage_networks, coverage_runs and tolerance_seeds are all 0: there is nothing to do."
            )

    def quick(self) -> Self:
        """The smoke form: two networks and a loose tolerance."""
        return self.replace(
            networks=2, first_network=11, body_steps=3e6, coverage_networks=4, coverage_runs=20, tolerance=0.05,
            tolerance_seeds=2,
        )  # fmt: skip

    @property
    def seeds(self) -> range:
        """Numbers of the random networks."""
        return range(self.first_network, self.first_network + self.networks)

    def items(self) -> list[Item]:
        """The random networks, at unequal temperatures with two steps, and the base case many times."""
        from impactlab_numerics.accuracy import intervals
        from impactlab_numerics.accuracy.random_networks import random_network

        items = list(intervals.items(self))
        for number in self.seeds:
            own = {"rng": [self.seed, number]}
            network = random_network(number)
            items.append(Item(f"equal_{number}", network, {**self.length(network), **own}))
            if self.unequal:
                length, network = self.length(network), random_network(number, equal_temperature=False)
                quarter = {"step": 0.25 * automatic_step(network), "rng": [self.seed, number, 4]}
                items.append(Item(f"unequal_{number}", network, {**length, **own}))
                items.append(Item(f"quarter_{number}", network, {**length, **quarter}))
        base = scene(2)
        for run in range(self.coverage_runs):
            length = {"duration": self.coverage_duration, "realizations": self.coverage_realizations}
            items.append(Item(f"coverage_{run}", base, {**length, "rng": [self.seed, run, 1]}))
        for run in range(self.tolerance_seeds):
            asked = {"tolerance": {self.tolerance_statistic: self.tolerance}, "max_seconds": 3600.0}
            items.append(Item(f"tolerance_{run}", base, {**asked, "rng": [self.seed, run, 2]}))
        return items

    def length(self, network: il.Network) -> dict[str, Any]:
        """Return how long a network is simulated: until the standard errors are small, or the steps are spent.

        The time is that in which the rarest contact closes often enough for a relative standard
        error of its rate of ``1.3/sqrt(n)`` after n contacts, and the slowest motion relaxes often
        enough for ``0.5/sqrt(n)`` after n relaxation times: values that were found on such networks.
        """
        from impactlab.assembly.model import Model
        from impactlab.linear.decay import relaxation_time
        from impactlab_numerics.accuracy.random_networks import closing_rates

        rarest = min(closing_rates(network).values())
        enough = (1.3**2 / rarest + 0.5**2 * relaxation_time(Model.of(network))) / self.standard_error**2
        affordable = self.body_steps * automatic_step(network) / len(network.oscillators)
        return {"duration": min(enough, affordable) / REALIZATIONS, "realizations": REALIZATIONS}
