"""Claims of the coverage study and their verdicts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab.studies.claims import Claim, verdict_of, verdict_on
from impactlab_numerics.coverage.tables import WITHIN, by_question, covered, percent

if TYPE_CHECKING:
    from impactlab_numerics.coverage.study import CoverageStudy

ASKED = (0.93, 0.97)
"""Share of intervals that should hold."""

MOST = 6.0
"""Errors beyond which no balance may be off: of a thousand normal numbers the largest is 3.3, and errors of few units
scatter."""


def claims(study: CoverageStudy, tree: xr.DataTree) -> Iterator[Claim]:
    """Yield the claims."""
    for question, part in by_question(tree).items():
        found = covered(part)
        yield Claim(
            "balances" if question == "balance" else "intervals",
            f"{question}: {WITHIN:g} errors hold in {100.0 * ASKED[0]:g} to {100.0 * ASKED[1]:g} % of cases.",
            f"{percent(found)} % of {found.intervals} in {found.networks} networks; ± is one standard error from the "
            "scatter between networks.",
            verdict_on(found.share, ASKED, 2.0 * found.error),
            figure="coverage",
        )
    balance = by_question(tree).get("balance")
    if balance is not None:
        score = balance.z.values
        yield Claim(
            "balances",
            f"No balance of energy is off by {MOST:g} errors or more.",
            f"the largest is {np.abs(score).max():.1f} of {len(score)}, the mean square {np.mean(score**2):.2f}.",
            verdict_of(bool(np.abs(score).max() < MOST)),
        )
