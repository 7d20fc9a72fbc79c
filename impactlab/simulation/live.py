"""What a run finds while it goes on: one number with its error, from the sums of what is done."""

from __future__ import annotations

import numpy as np

from impactlab.integrators.arguments import Sums
from impactlab.kernels.rows import FLUX, XX
from impactlab.plan.plan import Plan
from impactlab.results.measured import headline_text
from impactlab.results.schema import CONTACT, sampled_of
from impactlab.statistics.drift import FEWEST_UNITS


class Live:
    """The estimate so far of one statistic, for the progress bar.

    The statistic is the contact ratio of the first contact or, without contacts, the mean square displacement of the
    first body. The estimate is the plain mean over realizations, without control variates and without corrections of
    second order in the step.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, self.contacts = plan, len(plan.system.contacts) > 0
        self.name = "contact_ratio" if self.contacts else "mean_square_displacement"
        self.label = next(iter(plan.system.contacts if self.contacts else plan.system.bodies))
        self.row = FLUX + 1 + [item.name for item in sampled_of(CONTACT)].index("contact_ratio")
        self._sums: dict[int, dict[int, np.ndarray]] = {}  # by block and batch, those that are running included
        self._means: dict[int, np.ndarray] = {}  # of the realizations of each block

    def take(self, index: int, now: int, sums: Sums) -> None:
        """Take the sums of a block after the given number of steps, which this thread has just made."""
        steps = now - self.plan.clock.spin_up_steps
        if steps <= 0 or self.plan.subdomains.tiles:  # what tiles find is put together at the end of a batch
            return
        if self.contacts:
            row = sums.contacts[self.row, 0].copy()
        else:
            row = sums.bodies[:, XX, 0].sum(axis=0) * self.plan.method.interval
        batches = self._sums.setdefault(index, {})
        batches[int(np.searchsorted(self.plan.clock.boundaries, steps))] = row
        self._means[index] = np.sum(list(batches.values()), axis=0) / steps

    def text(self) -> str:
        """Return the estimate so far as text, empty before the end of the spin-up."""
        means = list(self._means.values())
        if not means:
            return ""
        values = np.concatenate(means)
        error = values.std(ddof=1) / np.sqrt(values.size) if values.size >= FEWEST_UNITS else np.nan
        return headline_text(self.name, self.label, float(values.mean()), float(error))
