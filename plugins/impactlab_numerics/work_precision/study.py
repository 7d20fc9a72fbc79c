"""The work-precision study: settings, and the simulations that show the bias of each method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

import impactlab as il
from impactlab.studies import FolderStudy, Item

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.methods import Method

PAIR, CHAIN = "base case", "chain"
"""Names of the scenes."""

STAGES = {"Runge–Kutta": 4}
"""Evaluations of the forces in a step, where there are more than one or two."""


class WorkPrecisionStudy(FolderStudy):
    """Run time against error of many methods, in one process and on one core.

    A method has at each step a bias, and a statistical error that falls as one over the
    square root of the run time. So it is described by two numbers: its bias, from a long
    run, and its cost constant, run time × (standard error)². They say how long it takes to
    any accuracy. Runs to a tolerance are also timed as they are.
    """

    name: ClassVar[str] = "work-precision"
    title: ClassVar[str] = "Run time against error: impactlab, loops of numba, other libraries"

    captions: ClassVar[Mapping[str, str]] = {
        "work_precision_*": (
            "Run time on one core to an error, bias and two standard errors, for four statistics; one line for "
            "each method, pale where nothing is known of its bias."
        ),
        "paths_without_noise": (
            "Processor time of a whole call against the largest error of its displacements at the ends of periods, of "
            "driven stops without noise; one line for each method."
        ),
    }

    sections: ClassVar[Mapping[str, str]] = {
        "speed": "steps per second against a scalar loop, and with two threads",
        "accuracy": "time to an error of E[x²] against other methods, and the price of a tolerance",
        "paths": "time to an error of a path without noise against other methods",
    }

    chain_bodies: int = il.parameter(10, minimum=0)
    exact_flow_steps: tuple[float, ...] = il.parameter((0.003, 0.008, 0.010, 0.012), units="s", above=0.0)
    plain_kick_steps: tuple[float, ...] = il.parameter((0.001, 0.002, 0.003, 0.006), units="s", above=0.0)
    baoab_steps: tuple[float, ...] = il.parameter((0.001, 0.002, 0.004), units="s", above=0.0)
    euler_maruyama_steps: tuple[float, ...] = il.parameter((0.00002, 0.00004, 0.00006), units="s", above=0.0)
    runge_kutta_steps: tuple[float, ...] = il.parameter((0.001, 0.002), units="s", above=0.0)
    paper_step: float = il.parameter(0.001, units="s", above=0.0)
    components: int = il.parameter(50000, minimum=1)
    band: tuple[float, float] = il.parameter((0.0, 500.0), units="Hz", minimum=0.0)
    accuracies: tuple[float, ...] = il.parameter((0.01, 0.001), above=0.0)
    tolerance: float = il.parameter(0.003, minimum=0.0, maximum=1.0)
    periods: int = il.parameter(20, minimum=1)
    body_steps: float = il.parameter(4e8, above=0.0)
    realizations: int = il.parameter(512, minimum=64)
    bins: int = il.parameter(100, minimum=10)
    rounds: int = il.parameter(3, minimum=1)
    timing_seconds: float = il.parameter(0.2, units="s", above=0.0)
    peers: bool = il.parameter(True)
    seed: int = il.parameter(2026, minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.chain_bodies == 1:
            raise il.InvalidInput("chain_bodies must be at least 2, or 0 for no chain, not 1.")
        for name in ("baoab_steps", "euler_maruyama_steps", "exact_flow_steps"):
            if not getattr(self, name):
                raise il.InvalidInput(f"{name} must hold at least one step (s).")
        if list(self.accuracies) != sorted(set(self.accuracies), reverse=True) or not self.accuracies:
            raise il.InvalidInput(f"accuracies must be falling numbers, not {list(self.accuracies)!r}.")

    def quick(self) -> Self:
        """The smoke form: few steps, short runs, three bodies in the chain."""
        return self.replace(
            chain_bodies=3,
            exact_flow_steps=(0.010,),
            plain_kick_steps=(0.006,),
            baoab_steps=(0.004,),
            euler_maruyama_steps=(0.00006,),
            runge_kutta_steps=(0.002,),
            components=2000,
            band=(0.0, 20.0),
            body_steps=2e6,
            realizations=64,
            rounds=1,
            timing_seconds=0.01,
            tolerance=0.0,
            periods=3,
            peers=False,
        )

    def scenes(self) -> dict[str, il.Network]:
        """Return the networks by name."""
        from impactlab_numerics.scenes import scene

        sizes = {PAIR: 2} | ({CHAIN: self.chain_bodies} if self.chain_bodies else {})
        return {name: scene(bodies) for name, bodies in sizes.items()}

    def methods(self, scene: str) -> list[Method]:
        """Return the methods that impactlab runs."""
        from impactlab_numerics.work_precision.methods import Method

        white = {
            "exact flow": (0.0, *self.exact_flow_steps),
            "exact flow, plain kick": self.plain_kick_steps,
            "exact flow, two normals": (0.006,),
            "Runge–Kutta": self.runge_kutta_steps,
            "Euler–Maruyama": self.euler_maruyama_steps,
        }
        series = {"exact flow": 0.005} | ({"Runge–Kutta": self.paper_step} if scene == PAIR else {})
        return [
            *(Method(scene, "impactlab", name, "white", step) for name, steps in white.items() for step in steps),
            *(Method(scene, "impactlab", name, "series", step) for name, step in series.items()),
        ]

    def baselines(self, scene: str) -> list[Method]:
        """Return the methods that are loops of numba."""
        from impactlab_numerics.work_precision.methods import Method

        return [
            *(Method(scene, "numba", "BAOAB", "white", step) for step in self.baoab_steps),
            *(Method(scene, "numba", "Euler–Maruyama", "white", step) for step in self.euler_maruyama_steps),
            *(Method(scene, "numba", "Runge–Kutta", "series", step) for step in (self.paper_step, 2 * self.paper_step)),
        ]

    def network(self, method: Method) -> il.Network:
        """Return the network that a method simulates."""
        from impactlab_numerics.scenes import shaken

        network = self.scenes()[method.scene]
        return shaken(network, self.components, self.band) if method.noise == "series" else network

    def steps(self, method: Method, bodies: int) -> float:
        """Return the number of steps of one body that the bias of a method is worth."""
        return self.body_steps / bodies / STAGES.get(method.scheme, 1)

    def options(self, method: Method) -> dict[str, Any]:
        """Return how `simulate` runs a method, without a duration."""
        from impactlab_numerics.scenes import limits
        from impactlab_numerics.work_precision.methods import integrator

        body, low, high = limits(self.network(method))
        common: dict[str, Any] = {
            "integrator": integrator(method.scheme),
            "step": method.step or None,
            "record": [il.Density(oscillators=(body,), bins=self.bins, limits={body: (low, high)})],
            "realizations": self.realizations,
        }
        if method.noise == "series":  # synthesis is dear
            few = max(64, self.realizations // 2)
            return {**common, "realizations": few, "spin_up": 0.2 * self.period, "initial": "rest"}
        if method.scheme == "Euler–Maruyama":  # steps are short
            return {**common, "realizations": max(64, self.realizations // 8)}
        return common

    @property
    def period(self) -> float:
        """Time after which a series of cosines repeats (s)."""
        return self.components / (self.band[1] - self.band[0])

    def items(self) -> list[Item]:
        """The long runs of impactlab; all else is measured when they are collected."""
        items = []
        for method in (method for scene in self.scenes() for method in self.methods(scene)):
            network = self.network(method)
            options, step = self.options(method), method.step or 0.006
            time = step * self.steps(method, len(network.oscillators))
            duration = max(10.0, time / options["realizations"])
            options["duration"] = 0.8 * self.period if method.noise == "series" else duration
            items.append(Item(method.key, network, {**options, "rng": self.seed}))
        return items
