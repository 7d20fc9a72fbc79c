"""Where realizations of a block leave the range of finite numbers."""

from __future__ import annotations

import numpy as np

from impactlab.results.losses import Loss
from impactlab.simulation.block import Block, LeftNumbers, finite_in


def losses_of(block: Block) -> list[Loss]:
    """Follow a block from its start to its end, leave out realizations that diverge, and return when and where."""
    losses: list[Loss] = []
    _follow(block, block.plan.clock.first + block.plan.clock.steps, losses)
    return losses


def _follow(block: Block, end: int, losses: list[Loss]) -> Block | None:
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


def _loss(before: Block, after: Block, lane: int) -> Loss:
    """Return the loss of one realization in a step, with the states before and after it."""
    system = after.plan.system
    body = int(np.flatnonzero(~finite_in(after.state)[:, lane])[0])
    forces = np.abs(np.stack([item.state.contact_force[:, lane] for item in (before, after)])).max(axis=0, initial=0.0)
    touching = system.ends.any(np.arange(len(system.bodies)) == body)
    pushed = np.where(touching & ~(forces == 0.0), np.nan_to_num(forces, nan=np.inf, posinf=np.inf), 0.0)
    contact = system.contacts[int(np.argmax(pushed))] if pushed.any() else ""
    return Loss(int(after.realizations[lane]), after.time, system.bodies[body], contact)
