"""The state at the end of a run, from which another one can go on."""

from __future__ import annotations

import numpy as np

from impactlab.components.fields import parameter
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables
from impactlab.results.snapshot import QUANTITIES, STATES

FILTERS = "final_filter_state"
"""Name of the variable that has the states of filters of noise."""

CONTINUATION = "continuation"
"""Name of the variable with the numbers from which a run continues bit for bit."""

OF_CONTINUATION = {"long_name": "numbers from which a run continues"}
"""Its attributes."""

FINAL = {"displacement": QUANTITIES["displacement"], "velocity": QUANTITIES["velocity"], "state": STATES}
"""What is kept, by what `initial=` calls it."""


def name_of(quantity: str) -> str:
    """Return the name of the variable that has a quantity, a key of `FINAL`, at the end."""
    return f"final_{FINAL[quantity].name}"


class FinalState(Record):
    """Displacements and velocities of bodies, and states of laws and filters of noise, at the end of each realization.

    With them a result can be the start of another run, ``simulate(..., initial=result)``.

    Parameters
    ----------
    continues : bool
        Whether to keep also the numbers from which ``simulate(network, duration, initial=result, continues=True)``
        takes up the realizations: with steps bit for bit, as does `il.Run`, and with `EventLocated` within the error of
        its path. A run with steps then makes all of them, also where nothing can touch.

    Examples
    --------
    >>> first = il.simulate(network, 20.0, realizations=64, record=il.FinalState(), rng=1)
    >>> second = il.simulate(network, 20.0, realizations=64, initial=first, rng=2)
    >>> first.final_displacement.dims
    ('realization', 'oscillator')
    """

    continues: bool = parameter(False)

    @property
    def every_step(self) -> bool:  # type: ignore[override]
        """Whether contact-free intervals are not crossed at once."""
        return self.continues

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _End(ratio, None if self.continues else run.plan.snapshot.size + len(run.plan.driving.processes.labels))

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        plan = run.plan
        snapshot, end = plan.snapshot, np.concatenate([result["end"] for result in results])
        variables = dict(snapshot.coordinates)
        for name, quantity in FINAL.items():
            if snapshot.names(quantity.name):
                attributes = snapshot.attributes(quantity)
                attributes["long_name"] += " at the end"
                values = end[:, snapshot.place(quantity.name)]
                variables[name_of(name)] = ("realization", quantity.dimension), values, attributes
        labels = plan.driving.processes.labels
        if self.continues:
            variables[CONTINUATION] = ("realization", "number"), end[:, snapshot.size + len(labels) :], OF_CONTINUATION
        if labels:
            attributes = {"units": "1", "long_name": "state of a filter of noise at the end"}
            variables["filter_state"] = ("filter_state",), np.array(labels), {"long_name": "state of a filter"}
            variables[FILTERS] = ("realization", "filter_state"), end[:, snapshot.size :][:, : len(labels)], attributes
        return variables


class _End(Keeper):
    wants_end = True

    def __init__(self, ratio: int, rows: int | None) -> None:
        super().__init__(ratio)
        self.rows = rows

    def end(self, values: np.ndarray) -> None:
        self.values = values[: self.rows].T.copy()

    def result(self) -> dict[str, np.ndarray]:
        return {"end": self.values}
