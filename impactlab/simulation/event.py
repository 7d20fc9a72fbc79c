"""Events of a run: a condition on the state passes through 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.inputs import checked, known_name
from impactlab.plan.plan import Plan
from impactlab.records.recorded_run import RecordedRun

ACTIONS = ("note", "retire", "stop")


class Samples:
    """States of realizations at several times, as the condition of an event gets them.

    Attributes
    ----------
    time : (sample, 1) or (sample, realization) ndarray
        Times (s).
    """

    def __init__(self, plan: Plan, snapshots: np.ndarray, time: np.ndarray) -> None:
        self._plan, self._snapshots, self.time = plan, snapshots, time

    def displacement(self, name: str) -> np.ndarray:
        """Return the displacement of a body or a point, (sample, realization) (m)."""
        return self._of("displacement", name)

    def velocity(self, name: str) -> np.ndarray:
        """Return the velocity of a body or a point, (sample, realization) (m s-1)."""
        return self._of("velocity", name)

    def indentation(self, contact: str) -> np.ndarray:
        """Return the indentation of a contact, negative while it is open, (sample, realization) (m)."""
        system = self._plan.system
        known_name("contact", contact, system.contacts)
        row = np.array([system.contacts.index(contact)])
        x = self._snapshots[:, self._plan.snapshot.place("displacement")].swapaxes(0, 1)
        x = np.concatenate([x, np.zeros((1, *x.shape[1:]))])  # and the wall
        gap: np.ndarray = system.ends.chosen(row).gap(x.reshape(len(x), -1)) - system.clearance[row, None]
        return gap.reshape(x.shape[1:])

    def law_state(self, label: str) -> np.ndarray:
        """Return a state of a law, (sample, realization)."""
        return self._of("law_state", label)

    def _of(self, quantity: str, name: str) -> np.ndarray:
        run = RecordedRun(self._plan)
        if name not in run.names(quantity) and name in dict(self._plan.points.labels):
            quantity = f"point_{quantity}"
        values: np.ndarray = run.values(self._snapshots, quantity, [name])[:, 0]
        return values


@checked
@dataclass(frozen=True, eq=False)
class Event:
    """An event of a realization: a condition on its state passes through 0.

    It is looked for after every step and located within the step, on a cubic through displacements and velocities at
    both ends. One that begins and ends within a step is missed: give the run a short ``step=``.

    Parameters
    ----------
    condition : callable
        Takes `Samples` (``at.displacement(name)``, ``at.velocity(name)``, ``at.indentation(contact)``,
        ``at.law_state(label)``, ``at.time``) and returns finite numbers, (sample, realization).
    direction : int
        1 where the condition grows through 0, -1 where it falls, 0 for both.
    action : str
        "note" goes on; "retire" ends the realization; "stop" ends `Run.advance`, of all realizations, after the step of
        the first such event.

    Raises
    ------
    InvalidInput
        If an argument is none of these.

    Examples
    --------
    >>> passage = il.Event(lambda at: at.displacement("a") - 0.05, direction=1, action="retire")
    >>> with il.Run(network, realizations=8, initial="rest", rng=1, events={"passage": passage}) as run:
    ...     run.advance(20.0)
    ...     print(run.realizations.size, run.events["time"].size)
    0 8
    """

    condition: Callable[[Samples], np.ndarray]
    direction: int = 0
    action: str = "note"

    def __post_init__(self) -> None:
        if not callable(self.condition):
            raise InvalidInput(
                "An il.Event takes a function of the state, such as lambda at: at.displacement('ball') - 0.1, not "
                f"{self.condition!r}."
            )
        if self.direction not in (-1, 0, 1):
            raise InvalidInput(f"direction must be 1, -1 or 0, not {self.direction!r}.")
        known_name("action", self.action, ACTIONS)


class Occurred(NamedTuple):
    """Events of one kind in a block."""

    name: str
    event: Event
    step: np.ndarray  # (event,) number of the step in which each happened, from 0
    lane: np.ndarray  # (event,)
    time: np.ndarray  # (event,) (s)
    snapshot: np.ndarray  # (row, event)

    def chosen(self, events: np.ndarray) -> Occurred:
        """Return the chosen events."""
        return self._replace(
            step=self.step[events],
            lane=self.lane[events],
            time=self.time[events],
            snapshot=self.snapshot[:, events],
        )


def occurred(
    name: str, event: Event, plan: Plan, snapshots: np.ndarray, begin: float, realizations: np.ndarray
) -> Occurred:
    """Find the events in the steps between snapshots, (step + 1, row, lane), the first of which is at `begin` (s)."""
    step = plan.clock.step
    times = begin + step * np.arange(len(snapshots))[:, None]

    def condition(states: np.ndarray, at: np.ndarray, which: np.ndarray) -> np.ndarray:
        value = np.asarray(event.condition(Samples(plan, states, at)), dtype=float)
        shape = len(states), states.shape[2]
        if value.ndim > 2 or np.broadcast_shapes(value.shape, shape) != shape:
            raise InvalidInput(
                f"The condition of the event {name!r} returned an array of shape {value.shape}; wanted is a number for "
                f"each sample and realization, {shape}."
            )
        value = np.broadcast_to(value, shape)
        if not np.isfinite(value).all():
            row, lane = np.argwhere(~np.isfinite(value))[0]
            when = float(np.broadcast_to(at, shape)[row, lane])
            raise InvalidInput(
                f"The condition of the event {name!r} is {value[row, lane]} at t = {when:g} s in realization "
                f"{which[lane]}; it must be finite."
            )
        return value

    value = condition(snapshots, times, realizations)
    before, after = value[:-1], value[1:]
    rising, falling = (before < 0.0) & (after >= 0.0), (before > 0.0) & (after <= 0.0)
    steps, lanes = np.nonzero((rising & (event.direction >= 0)) | (falling & (event.direction <= 0)))
    first, last = snapshots[steps, :, lanes].T, snapshots[steps + 1, :, lanes].T
    low, high = np.zeros(len(steps)), np.ones(len(steps))
    # halvings of a step that locate an event, to 1e-12 of the step
    for _ in range(40 if len(steps) else 0):
        middle = 0.5 * (low + high)
        states = _between(plan, first, last, middle)
        at = times[steps, 0] + step * middle
        reached = condition(states[None], at[None], realizations[lanes])[0] * np.sign(after[steps, lanes]) >= 0.0
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return Occurred(name, event, steps, lanes, times[steps, 0] + step * high, _between(plan, first, last, high))


def _between(plan: Plan, first: np.ndarray, last: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return states within steps, (row, event): cubics of displacements, straight lines of all that has no rate."""
    step, s = plan.clock.step, share
    result: np.ndarray = (1.0 - s) * first + s * last
    place, speed = (plan.snapshot.place(name) for name in ("displacement", "velocity"))
    x0, x1, v0, v1 = first[place], last[place], step * first[speed], step * last[speed]
    result[place] = x0 + s * (v0 + s * (3.0 * (x1 - x0) - 2.0 * v0 - v1 + s * (2.0 * (x0 - x1) + v0 + v1)))
    result[speed] = (v0 + s * (6.0 * (x1 - x0) - 4.0 * v0 - 2.0 * v1 + s * (6.0 * (x0 - x1) + 3.0 * (v0 + v1)))) / step
    return result
