"""The settings of the study and the simulations that follow from them.

Source: Y. Luo, J. Yan, D. Zhang, Stochastic response analysis of two vibration systems with
impact interactions, ENG Transactions 4 (2023) 2868, https://doi.org/10.61186/engt.4.1.2868.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import impactlab as il
from impactlab.components.literature import article
from impactlab.inputs import suggestion
from impactlab.studies import FolderStudy, Item, SweepItem

ONE_SIDED = {"consistent": 4.0 * math.pi, "equation 14": 1.0, "equation 16": math.pi}
"""One-sided density per hertz S_f that stands for a two-sided S, in units of S: the one that agrees
with Eq. 3, Eq. 14 read as S_f = S, and the one that Eq. 16 implies."""


REFERENCES = ("none", "analytic", "fokker-planck")
"""Nothing; the paper's solution, and the exact law where there is one; these and the Fokker–Planck equation."""


class TwoSystemStudy(FolderStudy):
    """Two oscillators with one Hertz contact under random excitation, over frequency ratio and clearance.

    Two variants answer the same questions: `accurate` (white noise, exact flow, an
    ensemble) and `paper` (one random-phase series of 50000 cosines, Runge-Kutta, from
    rest). Both take records of the same length, so that the scatter of one record is
    known from the ensemble.
    """

    citation = article(
        "Luo, Y. and Yan, J. and Zhang, D.",
        "Stochastic response analysis of two vibration systems with impact interactions",
        "ENG Transactions", 4, 2023, "2868", "10.61186/engt.4.1.2868",
    )  # fmt: skip

    name: ClassVar[str] = "two-system"
    title: ClassVar[str] = "Two colliding oscillators under random excitation (Luo, Yan and Zhang 2023)"

    captions: ClassVar[Mapping[str, str]] = {
        "figure_1": "The two systems and their contact (figure 1 of the paper).",
        "figure_2": (
            "Densities of displacements and velocities in the base case, and below each the absolute error of the "
            "ensemble and of one record; bands: two standard errors (figure 2 of the paper)."
        ),
        "figure_3": "The same densities at frequency ratios below that of the base case (figure 3 of the paper).",
        "figure_4": "The same densities at frequency ratios above that of the base case (figure 4 of the paper).",
        "figure_5": (
            "Mean squares and variances against the frequency ratio, and below each over those of the linear "
            "systems (figure 5 of the paper)."
        ),
        "figure_6": (
            "Ratios of the mean squares of the two systems against the frequency ratio (figure 6 of the paper)."
        ),
        "figure_7": "Part of the time in contact against the frequency ratio (figure 7 of the paper).",
        "figure_8": (
            "Largest force of a record: against the frequency ratio, its distribution, and its growth with the "
            "length of the record (figure 8 of the paper)."
        ),
    }

    sections: ClassVar[Mapping[str, str]] = {
        "3.1": "the simulation is long and accurate enough, and agrees with the analysis in the base case",
        "3.2": "at which frequency ratios the densities of both methods agree",
        "3.3": "mean squares, their ratios, time in contact and largest force over frequency ratio and clearance",
        "4": "the conclusions",
    }

    frequency_ratios: tuple[float, ...] = il.parameter(
        (1.0, 2.0, 3.0, 4.0, 8.0, 12.0, 16.0, 32.0, 64.0, 128.0, 256.0), above=0.0
    )
    clearances: tuple[float, ...] = il.parameter((0.01, 0.05, 0.1), units="m")
    density_clearance: float = il.parameter(0.05, units="m")
    natural_frequency_two: float = il.parameter(2.0 * math.pi, units="rad s-1", above=0.0)
    damping_ratio: float = il.parameter(0.1, above=0.0)
    spectral_density_one: float = il.parameter(16.0, units="N2 s rad-1", above=0.0)
    spectral_density_two: float = il.parameter(1.0, units="N2 s rad-1", above=0.0)
    contact_stiffness: float = il.parameter(1e4, units="N m-3/2", above=0.0)
    variants: tuple[str, ...] = il.parameter(("accurate", "paper"))
    reference: str = il.parameter("analytic")
    fokker_planck_ratios: tuple[float, ...] = il.parameter((1.0, 4.0, 8.0, 16.0), above=0.0)
    fokker_planck_tolerance: float = il.parameter(1e-3, minimum=1e-6)
    duration: float = il.parameter(100.0, units="s", above=0.0)
    realizations: int = il.parameter(512, minimum=64)
    balanced_realizations: int = il.parameter(2048, minimum=64)
    bins: int = il.parameter(200, minimum=10)
    normalisation: str = il.parameter("consistent")
    components: int = il.parameter(50000, minimum=1)
    band: tuple[float, float] = il.parameter((0.0, 500.0), units="Hz", minimum=0.0)
    paper_step: float = il.parameter(0.001, units="s", above=0.0)
    paper_seeds: int = il.parameter(32, minimum=2)
    seed: int = il.parameter(2023, minimum=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("frequency_ratios", "clearances", "variants"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                raise il.InvalidInput(f"{name} must be an array of different values, not {list(values)!r}.")
            object.__setattr__(self, name, tuple(sorted(values)))
        for variant in self.variants:
            if variant not in ("accurate", "paper"):
                raise il.InvalidInput(
                    f"There is no variant {variant!r}; {suggestion(str(variant), ('accurate', 'paper'))}"
                )
        if self.reference not in REFERENCES:
            raise il.InvalidInput(f"There is no reference {self.reference!r}; {suggestion(self.reference, REFERENCES)}")
        if self.normalisation not in ONE_SIDED:
            raise il.InvalidInput(
                f"There is no normalisation {self.normalisation!r}; {suggestion(self.normalisation, ONE_SIDED)}"
            )
        if self.density_clearance not in self.clearances:
            raise il.InvalidInput(
                f"density_clearance must be one of the clearances {list(self.clearances)}, not "
                f"{self.density_clearance!r}."
            )

    @property
    def balanced_ratio(self) -> float:
        """The frequency ratio at which assumption (2) of the paper, Eq. 8, holds."""
        return self.spectral_density_one / self.spectral_density_two

    @property
    def artefact_ratios(self) -> tuple[float, ...]:
        """Frequency ratios at which the paper's time step is shown to be too long."""
        return tuple(ratio for ratio in (128.0, 256.0) if ratio in self.frequency_ratios)

    def ensemble(self, ratio: float) -> int:
        """Number of realizations of the accurate variant: more where an exact law judges it."""
        return self.balanced_realizations if ratio == self.balanced_ratio else self.realizations

    def quick(self) -> Self:
        """The smoke form: four frequency ratios and short ensembles."""
        return self.replace(
            frequency_ratios=(1.0, 8.0, 16.0, 256.0),
            realizations=64,
            balanced_realizations=256,
            paper_seeds=4,
        )

    def network(
        self,
        ratio: float,
        clearance: float,
        variant: str = "accurate",
        *,
        normalisation: str | None = None,
        **noise: Any,
    ) -> il.Network:
        """Return the two systems of Eq. 1 with the contact of Eq. 2 and the noise of Eq. 3 or Eq. 14.

        Parameters
        ----------
        ratio : float
            Frequency ratio ω1/ω2.
        clearance : float
            Clearance d (m).
        variant : str
            "accurate" for white noise, "paper" for the random-phase series.
        normalisation : str, optional
            Normalisation of the series in place of the study's.
        **noise
            Fields of the series in place of the study's.
        """

        def excitation(spectral_density: float) -> il.Excitation:
            if variant == "accurate":
                return il.WhiteNoise(spectral_density)
            one_sided = ONE_SIDED[normalisation or self.normalisation] * spectral_density
            series: dict[str, Any] = {"band": self.band, "components": self.components, **noise}
            return il.ShinozukaNoise.from_one_sided(one_sided, **series)

        def oscillator(frequency: float) -> il.LinearOscillator:
            return il.LinearOscillator.from_frequency(frequency, self.damping_ratio)

        return il.Network(
            {
                "one": oscillator(ratio * self.natural_frequency_two),
                "two": oscillator(self.natural_frequency_two),
            },
            {"gap": il.Contact("one", "two", il.HertzContact(self.contact_stiffness), clearance=clearance)},
            {"one": excitation(self.spectral_density_one), "two": excitation(self.spectral_density_two)},
        )

    def limits(self, ratio: float) -> dict[str, tuple[tuple[str, float, float], ...]]:
        """Ranges of the densities: five standard deviations of each body at its hotter temperature.

        The hotter one is its own or, if the neighbour is hotter, the mean of the two, beyond
        which contacts cannot heat a body of equal mass.
        """
        bodies = self.network(ratio, self.density_clearance).oscillators
        densities = {"one": self.spectral_density_one, "two": self.spectral_density_two}
        own = {name: math.pi * densities[name] / body.damping for name, body in bodies.items()}
        hot = {name: max(own[name], 0.5 * sum(own.values())) for name in bodies}
        reach = {
            "displacement": {name: 5.0 * math.sqrt(hot[name] / body.stiffness) for name, body in bodies.items()},
            "velocity": {name: 5.0 * math.sqrt(hot[name] / body.mass) for name, body in bodies.items()},
        }
        return {
            quantity: tuple((name, -value, value) for name, value in values.items())
            for quantity, values in reach.items()
        }

    def options(self, variant: str, ratio: float, clearance: float) -> dict[str, Any]:
        """Return the options of `simulate` for one case of one variant."""
        record: list[il.Record] = [il.PerRealization()] if variant == "accurate" else []
        if clearance == self.density_clearance:
            record += [
                il.Density(quantity, bins=self.bins, limits=limits) for quantity, limits in self.limits(ratio).items()
            ]
        common = {"duration": self.duration, "record": record}
        if variant == "accurate":
            return {**common, "realizations": self.ensemble(ratio)}
        return {**common, "realizations": 1, **self.paper_options()}

    def paper_options(self) -> dict[str, Any]:
        """Return how the paper integrates: Runge-Kutta with a fixed step, from rest, nothing left out."""
        return {"integrator": il.RungeKutta4(), "step": self.paper_step, "initial": "rest", "spin_up": 0.0}

    def items(self) -> list[Item | SweepItem]:
        """A sweep for each variant, and what the corrections to the paper need besides."""
        return [*map(self.sweep, self.variants), *(self.demonstrations() if "paper" in self.variants else [])]

    def sweep(self, variant: str) -> SweepItem:
        """All cases of a variant, with the same random numbers."""

        def case(frequency_ratio: float, clearance: float) -> tuple[il.Network, dict[str, Any]]:
            place = frequency_ratio, clearance
            return self.network(*place, variant), self.options(variant, *place)

        values = {"frequency_ratio": self.frequency_ratios, "clearance": self.clearances}
        return SweepItem(variant, case, values, {"rng": self.seed, "common_random_numbers": True})

    def demonstrations(self) -> list[Item]:
        """Many records in the paper's way, each with one thing changed."""
        base = (self.balanced_ratio, self.density_clearance, "paper")
        many = {
            **self.paper_options(),
            "duration": self.duration,
            "realizations": self.paper_seeds,
            "record": [il.PerRealization()],
            "rng": self.seed,
        }
        few = {**many, "realizations": min(8, self.paper_seeds)}  # for what scatters little
        twice = {
            **many,
            "duration": 2.0 * self.duration,
            "realizations": 1,
            "record": [il.Trajectory(interval=self.duration / 2000.0)],
        }
        return [
            Item("scatter", self.network(*base), many),
            Item("scatter_components", self.network(*base, components=4 * self.components), many),
            Item(
                "scatter_duration",
                self.network(*base, components=4 * self.components),
                {**many, "duration": 4.0 * self.duration},
            ),
            *(
                Item(f"normalisation_{name.replace(' ', '_')}", self.network(*base, normalisation=name), few)
                for name in ONE_SIDED
                if name != "consistent"
            ),
            *(
                Item(f"artefact_{ratio:g}", self.network(ratio, self.density_clearance, "paper"), few)
                for ratio in self.artefact_ratios
            ),
            Item("repetition", self.network(*base, allow_repeat=True), twice),
        ]
