"""The state at the end of a run, from which another one can go on."""

from __future__ import annotations

import numpy as np

from impactlab.plan.plan import Plan
from impactlab.records.record import Keeper, Record
from impactlab.results.labels import Variables
from impactlab.results.snapshot import QUANTITIES, STATES

FINAL = {"displacement": QUANTITIES["displacement"], "velocity": QUANTITIES["velocity"], "state": STATES}
"""What is kept, by what `initial=` calls it."""


def name_of(quantity: str) -> str:
    """Return the name of the variable that has a quantity, a key of `FINAL`, at the end."""
    return f"final_{FINAL[quantity].name}"


class FinalState(Record):
    """Displacements and velocities of the bodies, and states of laws, at the end of each realization.

    With them a result can be the start of another run, ``simulate(..., initial=result)``.
    """

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        return _End(ratio)

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        snapshot, end = plan.snapshot, np.concatenate([result["end"] for result in results])
        variables = dict(snapshot.coordinates)
        for name, quantity in FINAL.items():
            if snapshot.names(quantity.name):
                attributes = snapshot.attributes(quantity)
                attributes["long_name"] += " at the end"
                values = end[:, snapshot.place(quantity.name)]
                variables[name_of(name)] = ("realization", quantity.dimension), values, attributes
        return variables


class _End(Keeper):
    wants_end = True

    def end(self, values: np.ndarray) -> None:
        self.values = values.T.copy()

    def result(self) -> dict[str, np.ndarray]:
        return {"end": self.values}
