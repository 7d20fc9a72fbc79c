"""Where realizations of a block leave the range of finite numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from impactlab.errors import Diverged
from impactlab.integrators.arguments import State
from impactlab.results.losses import Loss
from impactlab.step_control.rules.force_checks import LARGEST


class LeftNumbers(Diverged):
    """Realizations of a block left the range of finite numbers.

    Parameters
    ----------
    message : str
    lanes : (lane,) ndarray of int
        Which of the present ones.
    """

    def __init__(self, message: str, lanes: np.ndarray) -> None:
        super().__init__(message)
        self.lanes = lanes


def finite_in(state: State) -> np.ndarray:
    """Return where the numbers of a state are finite, (body and wall, lane) of bool."""
    x, v, reading = state.x, state.v, state.reading
    return np.asarray(np.isfinite(x) & (np.abs(v) < LARGEST) & (np.abs(reading) < LARGEST))


def losses_of(block: Any) -> list[Loss]:
    """Follow a block from its start to its end, leave out realizations that diverge, and return when and where."""
    losses: list[Loss] = []
    _follow(block, block.plan.clock.first + block.plan.clock.steps, losses)
    return losses


def _follow(block: Any, end: int, losses: list[Loss]) -> Any:
    """Bring a block to a step; return what is left of it, None for nothing.

    A call of the compiled loop in which realizations leave is repeated with these alone, halved down to a step.
    """
    unit, call = block.plan.method.interval, block.plan.realizations.steps_per_call
    while block.now < end:
        before, begin = block.taken(np.arange(len(block.realizations))), block.now
        try:
            block.advance(min(end - begin, max(call // unit, 1) * unit), None)
            continue
        except LeftNumbers as left:
            lost, stays = left.lanes, np.setdiff1d(np.arange(len(block.realizations)), left.lanes)
        made = block.now - begin
        if made <= unit:
            losses.extend(_loss(before, block, lane) for lane in lost.tolist())
        else:
            part = _follow(before.taken(lost), begin + max(made // (2 * unit), 1) * unit, losses)
            if part is not None:
                _follow(part, block.now, losses)
        if not stays.size:
            return None
        block = block.taken(stays)
    return block


def _loss(before: Any, after: Any, lane: int) -> Loss:
    """Return the loss of one realization in a step, with the states before and after it."""
    system = after.plan.system
    body = int(np.flatnonzero(~finite_in(after.state)[:, lane])[0])
    forces = np.abs(np.stack([item.state.contact_force[:, lane] for item in (before, after)])).max(axis=0, initial=0.0)
    touching = system.ends.any(np.arange(len(system.bodies)) == body)
    pushed = np.where(touching & ~(forces == 0.0), np.nan_to_num(forces, nan=np.inf, posinf=np.inf), 0.0)
    contact = system.contacts[int(np.argmax(pushed))] if pushed.any() else ""
    return Loss(int(after.realizations[lane]), after.time, system.bodies[body], contact)
