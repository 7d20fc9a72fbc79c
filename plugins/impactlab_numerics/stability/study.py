"""The stability study: steps at which each method is accurate, degraded, unstable or refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

import impactlab as il
from impactlab.studies import FolderStudy, Item

AXES = ("hertz_stiffness", "linear_stiffness", "frequency_ratios", "mass_ratios", "damping_ratios", "clearances")
"""Fields of the study along which the pair of the base case is changed, one at a time."""


class StabilityStudy(FolderStudy):
    """Maps of accuracy over the step and the stiffness, frequencies, masses, damping and clearance of a pair.

    The pair of the base case is changed along one axis at a time, at equal temperatures, so that
    the exact law is known under white noise; under bounded noise a run of the default method at a quarter of
    its automatic step takes its place. Each method runs at its own automatic step, and at multiples
    of that of the default method. A cell is *accurate* if no default statistic but the peak is off by
    more than 1 % and three standard errors. A map of its own shows Runge–Kutta at the paper's step under the paper's
    noise. Besides, many wild scenes are run, which must not end without a result and without a word.
    """

    name: ClassVar[str] = "stability"
    title: ClassVar[str] = "Stability: where each method can be trusted"

    captions: ClassVar[Mapping[str, str]] = {
        "stability_paper": (
            "Runge–Kutta at the step and under the noise of the paper: how far the worst statistic is off, over "
            "frequency ratio and contact stiffness."
        ),
        "stability_*": (
            "Where the method is accurate, degraded, unstable or refused, over the step and each changed "
            "parameter of the pair."
        ),
    }

    sections: ClassVar[Mapping[str, str]] = {
        "automatic step": "the default method is accurate in every cell, or refused with the reason",
        "largest step": "no step that a method accepts makes it unstable",
        "paper": "whether Runge–Kutta at the paper's step is accurate",
        "wild scenes": "none ends without a result and without a word",
    }

    hertz_stiffness: tuple[float, ...] = il.parameter((1e2, 1e4, 1e6, 1e8, 1e10, 1e12), units="N m-3/2", above=0.0)
    linear_stiffness: tuple[float, ...] = il.parameter((1e2, 1e4, 1e6, 1e8, 1e10, 1e12), units="N m-1", above=0.0)
    frequency_ratios: tuple[float, ...] = il.parameter((1.0, 4.0, 16.0, 64.0, 1e3, 1e4, 1e5), above=0.0)
    mass_ratios: tuple[float, ...] = il.parameter((1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6), above=0.0)
    damping_ratios: tuple[float, ...] = il.parameter((0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0), minimum=0.0)
    clearances: tuple[float, ...] = il.parameter((-3.0, -1.0, 0.0, 0.2, 1.0, 3.0, 10.0))
    factors: tuple[float, ...] = il.parameter((0.01, 0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0), above=0.0)
    series: bool = il.parameter(True)
    body_steps: float = il.parameter(1e7, above=0.0)
    automatic_body_steps: float = il.parameter(2e9, above=0.0)
    components: int = il.parameter(400, minimum=2)
    paper_frequency_ratios: tuple[float, ...] = il.parameter((1.0, 16.0, 64.0, 128.0, 256.0, 400.0), above=0.0)
    paper_stiffness: tuple[float, ...] = il.parameter((1e3, 1e4, 1e5, 1e6, 1e7, 1e8), units="N m-3/2", above=0.0)
    paper_step: float = il.parameter(0.001, units="s", above=0.0)
    paper_components: int = il.parameter(50000, minimum=2)
    paper_band: tuple[float, float] = il.parameter((0.0, 500.0), units="Hz", minimum=0.0)
    paper_realizations: int = il.parameter(16, minimum=8)
    scenes: int = il.parameter(400, minimum=0)
    first_scene: int = il.parameter(0, minimum=0)
    seed: int = il.parameter(2026, minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in (*AXES, "factors", "paper_frequency_ratios", "paper_stiffness"):
            values = getattr(self, name)
            if list(values) != sorted(set(values)):
                raise il.InvalidInput(f"{name} must be rising numbers, not {list(values)!r}.")
        il.ShinozukaNoise(1.0, band=self.paper_band)  # checks the band

    def quick(self) -> Self:
        """The smoke form: a few cells of two axes, few wild scenes."""
        return self.replace(
            hertz_stiffness=(1e4,),
            linear_stiffness=(),
            frequency_ratios=(),
            mass_ratios=(1e-2,),
            damping_ratios=(),
            clearances=(),
            factors=(0.25, 2.0, 8.0),
            body_steps=1e6,
            automatic_body_steps=1e7,
            paper_frequency_ratios=(16.0, 400.0),
            paper_stiffness=(1e4,),
            paper_components=2000,
            paper_band=(0.0, 400.0),
            scenes=4,
        )

    def items(self) -> list[Item]:
        """Nothing: refused cells are results too, so `collect` simulates."""
        return []
