"""What the paper says in its sections 3.1 to 3.3 and 4, each with the predicate that judges it.

Statements are in our words. A statement on the paper's numerical results is judged with
the accurate variant; the scatter of records as short as the paper's tells what one record
cannot show (`sampling error`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import xarray as xr

from impactlab.studies.claims import Claim
from impactlab_two_system import special
from impactlab_two_system.predicates import (
    Judgement,
    by_clearance,
    densities_agree,
    densities_differ,
    discrepancies_seen,
    larger,
    little_influence,
    only,
    same,
)
from impactlab_two_system.results import Missing, Results

if TYPE_CHECKING:
    from impactlab_two_system.study import TwoSystemStudy

X2, V2 = "mean_square_displacement", "mean_square_velocity"
ONE, TWO, BOTH, RATIO = ("one",), ("two",), ("one", "two"), ("one/two",)

_OF_STATISTIC = {
    "contact_ratio": "figure_7", "peak_contact_force": "figure_8", "one/two": "figure_6", X2: "figure_5",
    V2: "figure_5",
}  # fmt: skip
"""Figures by what they show: the first of these names that a statement has decides."""

SHOWN = {
    special.fluctuations_stay: "figure_2",
    special.acceptable: "figure_2",
    special.gaussian: "figure_2",
    special.more_obvious: "figure_3",
    special.densities_move_apart: "figure_3",
    special.methods_differ: "figure_5",
    special.straight: "figure_6",
    special.curved: "figure_6",
    special.rises_then_stable: "figure_7",
    special.minimum_at: "figure_7",
    special.jump_at: "figure_7",
    special.peak_first: "figure_8",
    special.falls_then_stable: "figure_8",
}
"""Figures of predicates of which there is one for a statement."""


class Statement(NamedTuple):
    """A statement of the paper with its section, and the predicate that judges it with its arguments."""

    section: str
    text: str
    predicate: Callable[..., Judgement]
    arguments: tuple[Any, ...]
    options: dict[str, Any]

    @property
    def criterion(self) -> str:
        """When the statement holds: the first paragraph of the predicate's text."""
        return " ".join((self.predicate.__doc__ or "").split("\n\n")[0].split())

    @property
    def figure(self) -> str:
        """The figure that shows what the statement is on, if one does."""
        if self.predicate in SHOWN:
            return SHOWN[self.predicate]
        names = set(_flat(self.arguments))
        if self.predicate in (densities_agree, densities_differ, discrepancies_seen):
            base = {16.0: "figure_2", math.inf: "figure_4"}
            return next((figure for ratio, figure in base.items() if ratio in names), "figure_3")
        return next((figure for name, figure in _OF_STATISTIC.items() if name in names), "")

    def judge(self, results: Results) -> Judgement:
        """Return what was measured and the verdict."""
        try:
            return self.predicate(results, *self.arguments, **self.options)
        except Missing as missing:
            return Judgement(f"{missing}", "not testable")


def _flat(arguments: Any) -> Iterator[Any]:
    for item in arguments:
        if isinstance(item, tuple):
            yield from _flat(item)
        else:
            yield item


def states(section: str, text: str, predicate: Callable[..., Judgement], *arguments: Any, **options: Any) -> Statement:
    """Make one row of the table."""
    return Statement(section, text, predicate, arguments, options)


STATEMENTS: tuple[Statement, ...] = (
    # 3.1 the simulation and the base case
    states("3.1", "With 50000 cosines a realization is almost stationary and ergodic.", special.ergodic),
    states("3.1", "A record of 100 s is long enough for both systems to settle.", special.settled),
    states("3.1", "A record of 100 s at 1 ms gives 4×10⁶ samples.", special.samples),
    states("3.1", "Base case, System 1: the error of both densities is almost zero.",
          densities_agree, ONE, only(16)),
    states("3.1", "Base case, System 2: obvious discrepancies.", discrepancies_seen, "two", only(16)),
    states("3.1", "The fluctuations in System 2 stay when N is much larger than 50000.",
          special.fluctuations_stay),
    states("3.1", "The simulation is acceptable for approximate densities.", special.acceptable),
    # 3.2 densities at other frequency ratios
    states("3.2", "At ω̄ = 16 the ratio S̄/(ζ̄ω̄) is 1: assumption (2) is satisfied.", special.condition),
    states("3.2", "At ω̄ = 16 all densities of the two methods are almost the same.",
          densities_agree, BOTH, only(16)),
    states("3.2", "At ω̄ = 12 (ratio 1.33) the densities coincide.", densities_agree, BOTH, only(12)),
    states("3.2", "At ω̄ = 8 the densities of System 1 still agree well.", densities_agree, ONE, only(8)),
    states("3.2", "At ω̄ = 8 the fluctuations in System 2 are more obvious.", special.more_obvious, 8),
    states("3.2", "At ω̄ = 4 the densities of System 1 still agree well.", densities_agree, ONE, only(4)),
    states("3.2", "At ω̄ = 4 the densities of System 2 are far apart.", densities_differ, TWO, only(4)),
    states("3.2", "At ω̄ = 1 the densities of both systems are far apart.", densities_differ, BOTH, only(1)),
    states("3.2", "For ω̄ ≥ 32 (ratio below 1) all densities agree well.",
          densities_agree, BOTH, (32, math.inf)),
    # 3.3 mean squares
    states("3.3", "Only where (2) holds is ω̄ equal to σ_x2/σ_x1 of the linear systems.",
          special.stiffness_ratio),
    states("3.3", "C_DV tells whether assumption (2) is satisfied.", special.condition_number),
    states("3.3", "In the simulation the linear E[v²] is πS/(8ζω).", special.normalisation),
    states("3.3", "Contact leaves E[v²] at its linear value.",
          same, (V2,), BOTH, "accurate", "linear", (0, math.inf)),
    states("3.3", "The mean squares of the two methods differ clearly.", special.methods_differ),
    states("3.3", "ω̄ = 1: E[x1²] and E[v1²] of the analysis exceed the simulation's.",
          larger, ((X2, "one", "analytic", "accurate"), (V2, "one", "analytic", "accurate")), only(1)),
    states("3.3", "ω̄ = 1: the linear E[x1²] is the greatest of the three.",
          larger, ((X2, "one", "linear", "analytic"), (X2, "one", "linear", "accurate")), only(1)),
    states("3.3", "ω̄ = 1: the simulated E[x2²] is the greatest of the three.",
          larger, ((X2, "two", "accurate", "analytic"), (X2, "two", "accurate", "linear")), only(1)),
    states("3.3", "ω̄ = 1: the simulated E[v2²] exceeds the analysis.",
          larger, ((V2, "two", "accurate", "analytic"),), only(1)),
    states("3.3", "ω̄ = 1: impacts lower E[x1²] and raise E[x2²].",
          larger, ((X2, "one", "linear", "accurate"), (X2, "two", "accurate", "linear")), only(1)),
    states("3.3", "For ω̄ ≥ 8 the two methods give almost the same E[x1²].",
          same, (X2,), ONE, "accurate", "analytic", (8, math.inf)),
    states("3.3", "The linear E[x2²] is always larger than that with contact.",
          larger, ((X2, "two", "linear", "accurate"),), (0, math.inf)),
    states("3.3", "The simulated velocities are still Gaussian.", special.gaussian),
    states("3.3", "For ω̄ ≥ 8 the two methods give almost the same E[v1²].",
          same, (V2,), ONE, "accurate", "analytic", (8, math.inf)),
    states("3.3", "E[v2²] of the two methods meets from ω̄ = 12 on, not before.",
          special.meets, V2, "two", 12),
    states("3.3", "Impacts change the velocity distributions too, not only the displacements'.",
          densities_differ, BOTH, only(1), ("velocity",)),
    states("3.3", "The clearance has little influence on the mean squares of System 1.",
          little_influence, (X2, V2), ONE),
    states("3.3", "E[x2²] is slightly larger with the larger clearance.",
          by_clearance, X2, "two", rises=True),
    states("3.3", "E[v2²] is slightly smaller with the larger clearance.",
          by_clearance, V2, "two", rises=False),
    # 3.3 ratios of mean squares
    states("3.3", "The linear ratios of mean squares are straight lines in log-log scale.",
          special.straight),
    states("3.3", "The analytic ratios of mean squares follow the linear ones.",
          same, (X2, V2), RATIO, "analytic", "linear", (0, math.inf)),
    states("3.3", "ω̄ = 1: the simulated ratio of E[x²] is much smaller than the analytic one.",
          larger, ((X2, "one/two", "analytic", "accurate"),), only(1), factor=2),
    states("3.3", "For ω̄ ≤ 8 the simulated ratio of E[v²] is smaller than the analytic one.",
          larger, ((V2, "one/two", "analytic", "accurate"),), (0, 8)),
    states("3.3", "ω̄ = 1: the simulated ratio of E[v²] is much smaller than the analytic one.",
          larger, ((V2, "one/two", "analytic", "accurate"),), only(1), factor=2),
    states("3.3", "With contact the ratios are not straight lines in log-log scale.", special.curved),
    states("3.3", "The clearance has little influence on the ratios.", little_influence, (X2, V2), RATIO),
    # 3.3 contact ratio and largest force
    states("3.3", "The smaller the clearance, the greater the contact ratio.",
          by_clearance, "contact_ratio", "gap", rises=False),
    states("3.3", "d = 0.01: the contact ratio rises at first and is stable for ω̄ > 16.",
          special.rises_then_stable, 0.01),
    states("3.3", "d = 0.1: the contact ratio falls to a minimum at ω̄ = 8, then rises.",
          special.minimum_at, 0.1, 8),
    states("3.3", "d = 0.05: the contact ratio jumps at ω̄ = 4 and is steady elsewhere.",
          special.jump_at, 0.05, 4),
    states("3.3", "The smaller the clearance, the greater the largest force.",
          by_clearance, "peak_contact_force", "gap", rises=False),
    states("3.3", "The largest force peaks at ω̄ = 1.", special.peak_first),
    states("3.3", "The largest force falls fast, then slowly, then is stable.", special.falls_then_stable),
    # 4 conclusions that section 3 does not state
    states("4", "For ω̄ ≥ 12 (C_DV ≤ 1.33) the densities agree well.",
          densities_agree, BOTH, (12, math.inf)),
    states("4", "C_DV grows as ω̄ falls, and the densities move apart.", special.densities_move_apart),
    states("4", "The clearance has little influence on the mean squares.", little_influence, (X2, V2), BOTH),
)  # fmt: skip


def claims(study: TwoSystemStudy, tree: xr.DataTree) -> Iterator[Claim]:
    """Yield each statement with what was measured and the verdict."""
    results = Results(study, tree)
    for statement in STATEMENTS:
        judgement = statement.judge(results)
        texts = judgement.measured, judgement.verdict, statement.criterion
        yield Claim(statement.section, statement.text, *texts, figure=statement.figure)
