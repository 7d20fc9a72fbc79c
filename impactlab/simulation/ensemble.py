"""Runs the blocks of a plan, spread over the cores."""

from __future__ import annotations

import concurrent.futures
import contextlib
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, Self

import numpy as np

from impactlab.errors import Diverged, InvalidInput
from impactlab.integrators.arguments import State, Sums
from impactlab.kernels.rows import FLUX, XX
from impactlab.machine import Tally, begin, cores, hand_over, shares_memory, workers_of
from impactlab.plan.plan import Plan
from impactlab.plan.subdomains import Tile
from impactlab.progress import Report, nothing, reporter
from impactlab.records.first_passage import Passages
from impactlab.results.checkpoint import Checkpoint, KeptItem
from impactlab.results.losses import ADVICE, Loss, losses_text
from impactlab.results.measured import headline_text
from impactlab.results.plain_values import digest
from impactlab.results.schema import CONTACT, sampled_of
from impactlab.results.snapshot import AT_KICKS, PEAKS, QUANTITIES
from impactlab.simulation.block import Block, Tick, compiled, untold
from impactlab.simulation.block_state import BlockStates
from impactlab.simulation.block_sums import BlockResult
from impactlab.simulation.divergence import LeftNumbers, finite_in, losses_of
from impactlab.statistics.drift import FEWEST_UNITS

OTHERS = 'With on_divergence="keep" other realizations go on.'
"""How not to lose the other realizations."""

BREAKS, FEWEST_STEPS = 64, 32
"""Parts of a run after which realizations that have passed a limit are left out, and the least steps of one."""

WORTH_LEAVING = 0.7
"""Part of the realizations up to which the others go on without those, which copies all arrays."""


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
        steps = now - self.plan.clock.first
        if steps <= 0 or self.plan.subdomains.tiles:  # what tiles find is put together at the end of a batch
            return
        if self.contacts:
            row = sums.contacts[self.row, 0].copy()
        else:
            row = sums.bodies[:, XX, 0].sum(axis=0) * self.plan.method.interval
        batches = self._sums.setdefault(index, {})
        batches[int(np.searchsorted(self.plan.clock.boundaries, steps))] = row
        self._means[index] = np.sum(list(batches.values()), axis=0) / steps

    def forget(self, index: int) -> None:
        """Forget what a block has told, which begins anew."""
        self._sums.pop(index, None)
        self._means.pop(index, None)

    def text(self) -> str:
        """Return the estimate so far as text, empty before the end of the spin-up."""
        means = list(self._means.values())
        if not means:
            return ""
        values = np.concatenate(means)
        error = values.std(ddof=1) / np.sqrt(values.size) if values.size >= FEWEST_UNITS else np.nan
        return headline_text(self.name, self.label, float(values.mean()), float(error))


@dataclass(frozen=True)
class Execution:
    """Where a run happens, and what it may take; parameters are those of `simulate`."""

    executor: concurrent.futures.Executor | None = None
    progress: bool | Callable[[float], None] | None = None
    seconds: float = math.inf  # time that it may be foreseen to take (s)
    out: str | os.PathLike[str] | None = None
    growing: bool = False
    """Whether realizations will be added: the dataset then has the step as if it were given."""
    checkpoint: Checkpoint | None = None
    """Where blocks are kept as they end."""
    workers: int = field(init=False)  # number of blocks that run at once

    def __post_init__(self) -> None:
        kept = None if self.checkpoint is None else self.checkpoint.chosen.get("workers")
        object.__setattr__(self, "workers", kept or workers_of(self.executor))
        if self.executor is not None and not isinstance(self.executor, concurrent.futures.Executor):
            raise InvalidInput(f"executor must be a concurrent.futures.Executor, not {self.executor!r}.")

    def report(self) -> Report:
        """Return what takes the part of the run that is done."""
        return reporter(self.progress)


def run(
    plan: Plan,
    executor: concurrent.futures.Executor | None,
    progress: Callable[[float], None],
    checkpoint: Checkpoint | None = None,
) -> list[BlockResult]:
    """Run all blocks of a plan, on threads or an executor, and return their results in order.

    An error is raised where all realizations diverge. `progress` is called now and then with the part that is done; a
    `Report` also with what tells what is found so far.
    """
    report = Report.of(progress)
    live = Live(plan) if report.telling else None
    kept: list[dict[str, np.ndarray]] = [{} for _ in plan.observed.records]
    results: list[BlockResult] = []

    def finished(result: BlockResult) -> None:
        if kept and not result.empty:
            add_sums(kept, result.records, plan)
        results.append(result)

    show = partial(_shown, report, live.text if live else nothing)
    run_blocks([plan], run_block, finished, show, executor, live, checkpoint)
    first = next((result for result in results if not result.empty), None)
    if first is None:
        lost = [loss for result in results for loss in result.losses]
        raise Diverged(f"{losses_text(lost, len(lost))} {ADVICE}")
    for sums, of_first in zip(kept, first.records, strict=True):
        of_first.update(sums)
    return results


def whole_blocks(plan: Plan, results: Sequence[BlockResult]) -> tuple[Plan, list[BlockResult]]:
    """Return the plan of the realizations that are finite to their ends, and the results of blocks with some."""
    losses = [loss for result in results for loss in result.losses]
    if not losses:
        return plan, [*results]
    return plan.without(losses), [result for result in results if not result.empty]


def _shown(report: Report, text: Callable[[], str], part: float) -> None:
    report(part, text)


def run_blocks(
    plans: Sequence[Plan],
    function: Callable[..., BlockResult | None],
    finished: Callable[[Any], None],
    progress: Callable[[float], None],
    executor: concurrent.futures.Executor | None = None,
    live: Live | None = None,
    checkpoint: Checkpoint | None = None,
) -> None:
    """Run all blocks of some plans, on threads or an executor, and hand over the result of each in order.

    `function` takes a plan, the index of a block, and the item of a checkpoint, if there is one; in this process also
    the tally of steps, the number of threads and `live`. An error is raised for a realization that left the range of
    finite numbers, and for a worker of the executor that died.
    """
    blocks: list[tuple[Plan, int, KeptItem | None]] = []
    for plan in plans:
        key = "" if checkpoint is None else digest(plan)
        for index in range(plan.realizations.blocks):
            item = None if checkpoint is None else checkpoint.item(f"{key}-{index}")
            blocks.append((plan, index, item))
    total = sum(plan.realizations.left * plan.clock.all_steps for plan in plans)
    tally, ended = Tally(), 0
    with contextlib.ExitStack() as stack:
        pool = executor or stack.enter_context(concurrent.futures.ThreadPoolExecutor(min(len(blocks), cores())))
        shared_memory = shares_memory(pool)
        if shared_memory:
            for plan in plans:
                compiled(plan)  # in this thread, where Ctrl-C is answered at once
        threads = max(1, workers_of(executor) // len(blocks))
        watched = (tally, threads, live) if shared_memory else ()  # a lock cannot go to another process

        def take(result: Any) -> None:
            nonlocal ended
            ended += 1
            finished(result)

        hand_over(
            (begin(pool, kept_block, function, *block, *watched) for block in blocks),
            take,
            lambda: progress(tally.done / total if shared_memory else ended / len(blocks)),
            tally.stop,
            4 * workers_of(pool),
        )


def add_sums(kept: list[dict[str, np.ndarray]], records: list[dict[str, np.ndarray]], plan: Plan) -> None:
    """Move the sums that records share among blocks from a finished block to the common sums."""
    for sums, of_block, (record, _) in zip(kept, records, plan.observed.records, strict=True):
        for name in record.summed:
            array = of_block.pop(name)
            if name in sums:
                sums[name] += array
            else:
                sums[name] = array


def continued(results: list[BlockResult], more: list[BlockResult], plan: Plan) -> list[BlockResult]:
    """Return the results of all blocks of a run from those of its first realizations and those of the others."""
    for sums, others, (record, _) in zip(results[0].records, more[0].records, plan.observed.records, strict=True):
        for name in record.summed:
            shorter, longer = sorted((sums[name], others.pop(name)), key=len)  # of fewer subsamples
            longer[: len(shorter)] += shorter
            sums[name] = longer
    return [*results, *more]


def kept_block(
    function: Callable[..., BlockResult | None], plan: Plan, index: int, item: KeptItem | None, *watched: Any
) -> BlockResult | None:
    """Return the result of a block that an item has, or run the block and keep its result in the item."""
    if item is None:
        return function(plan, index, None, *watched)
    if (kept := item.load()) is not None:
        for tally in watched[:1]:
            tally(len(plan.realizations.of(index)) * plan.clock.all_steps)
        item.remove_parts()  # where the process was killed between both
        return None if kept[0] is None else BlockResult(*kept[0])
    result = function(plan, index, item, *watched)
    item.save([None if result is None else [getattr(result, part.name) for part in fields(result)]])
    item.remove_parts()
    return result


def run_block(
    plan: Plan,
    index: int,
    item: KeptItem | None = None,
    tick: Tick = untold,
    threads: int = 1,
    live: Live | None = None,
) -> BlockResult:
    """Run one block of realizations: a pure function of the plan and the index; tiles run on some threads.

    Beside the item of its result it keeps its state now and then, from which it goes on. Where realizations diverge,
    and the others are to go on, the block runs again without them: its numbers are those of a block that never had
    them.
    """
    kept = None if item is None else item.part("losses")
    found = None if kept is None else kept.load()
    while True:
        losses = tuple(Loss(*row) for row in found or ())  # as plain data from a file
        left = replace(plan, realizations=replace(plan.realizations, losses=losses)) if losses else plan
        if not len(left.realizations.of(index)):
            return BlockResult.without_realizations(losses)
        state = None if item is None else item.part(f"state{len(losses) or ''}")
        try:
            return replace(_run_left(left, index, state, tick, threads, live), losses=losses)
        except LeftNumbers as error:
            new = _losses(left, index, error)
            if not new:
                raise
            if not plan.realizations.keep:
                others = f" {OTHERS}" if plan.realizations.number > 1 else ""
                raise Diverged(f"{min(new, key=_time).text()} {ADVICE}{others}") from None
        found = [*losses, *new]
        if kept is not None:
            kept.save(found)
        if live is not None:
            live.forget(index)
        tick = partial(_uncounted, tick)


def _losses(plan: Plan, index: int, error: LeftNumbers) -> list[Loss]:
    """Return where realizations of a block diverge, of which one has been seen to."""
    block = _begun(plan, index, untold, None)
    return losses_of(block.taken(error.lanes) if plan.observed.ends else block)


def _time(loss: Loss) -> float:
    return loss.time


def _uncounted(tick: Tick, steps: int) -> None:
    """Count no steps, of a block that was counted before, but end it where all are to end."""
    tick(0)


def _run_left(
    plan: Plan, index: int, item: KeptItem | None, tick: Tick, threads: int, live: Live | None
) -> BlockResult:
    """Run a block, whose states an item keeps; see `run_block`."""
    with contextlib.ExitStack() as stack:
        several = plan.subdomains.tiles and threads > 1
        pool = stack.enter_context(concurrent.futures.ThreadPoolExecutor(threads)) if several else None
        block = _begun(plan, index, tick, pool)
        if live is not None and not plan.observed.ends:
            block.tick = _telling(live, index, block)
        states = None if item is None or plan.observed.ends else BlockStates(item)
        if states is not None and states.measuring:
            return block.measure(states)
        if states is not None:
            states.restore(block)
            block.kept = partial(states.note, block)
        block.advance(plan.clock.first - block.now, None)
        return until_passed(block) if plan.observed.ends else block.measure(states)


def until_passed(block: Block) -> BlockResult:
    """Run a block until all of its realizations have passed a limit, or the horizon is over; return the passages."""
    (keeper,) = block.open_keepers()
    assert isinstance(keeper, Passages)
    steps, done, lost = block.plan.clock.steps, 0, list[int]()
    places, block.guarded = np.arange(len(block.realizations)), False  # one that has passed may diverge
    while done < steps and len(waiting := keeper.waiting):
        lanes = len(block.realizations)
        if len(waiting) <= WORTH_LEAVING * lanes and block.tiles is None:
            block.tick((lanes - len(waiting)) * (steps - done))
            block, places = block.taken(waiting), places[waiting]
            keeper.keep(waiting)
        count = min(max(FEWEST_STEPS, steps // BREAKS), steps - done)
        block.advance(count, lambda snapshots: keeper.add(snapshots, 0))
        done += count
        finite = finite_in(block.state).all(axis=0)
        if len(gone := np.intersect1d(keeper.not_passed, np.flatnonzero(~finite))):
            lost += places[gone].tolist()
            keeper.give_up(gone)
    if lost:
        raise LeftNumbers("Realizations left the range of finite numbers before they passed a limit.", np.array(lost))
    block.tick(len(block.realizations) * (steps - done))
    nothing = np.zeros(0)
    sums = nothing, nothing, nothing, nothing, nothing
    return BlockResult(*sums, block.events.noted(), [keeper.result()], frozenset(block.lost))


def _begun(plan: Plan, index: int, tick: Tick, pool: concurrent.futures.Executor | None) -> Block:
    """Return a block at its start, or where its realizations continue, which must be where their states say."""
    start, numbers = plan.start, plan.realizations.of(index)
    if start.continuation is None:
        return opened(plan, numbers, tick, pool)
    places = numbers - np.uint32(plan.realizations.numbered_from)
    block = opened(plan, numbers, tick, pool, start.continuation[:, places])
    given = {motion.slot for motion in plan.driving.motions}
    free = [slot for slot in range(len(plan.system.bodies)) if slot not in given]
    rows, end = plan.snapshot.place, block.end()
    same = all(
        np.array_equal(end[rows(name)][free], values[free][:, places])
        for name, values in zip(("displacement", "velocity"), start.state, strict=True)
    )
    if not same or (start.laws is not None and not np.array_equal(end[rows("law_state")], start.laws[:, places])):
        raise InvalidInput("This state was changed; without continues=True it is a start.")
    return block


def opened(
    plan: Plan,
    realizations: np.ndarray,
    tick: Tick = untold,
    pool: concurrent.futures.Executor | None = None,
    continuation: np.ndarray | None = None,
) -> Block:
    """Return a block of some realizations at its start, or one that continues; tiles run on the threads of a pool."""
    if not plan.subdomains.tiles:
        return Block(plan, realizations, tick, None, continuation)
    tiles = Tiles(plan, [Block(tile, realizations, untold) for tile in plan.tiles], pool)
    return Block(plan, realizations, tick, tiles, continuation)


def _telling(live: Live, index: int, block: Block) -> Tick:
    """Return the tick of a block, and let the progress bar read the sums of the block from now on."""
    tick = block.tick

    def both(steps: int) -> None:
        tick(steps)
        live.take(index, block.now, block.sums)

    return both


class Tiles:
    """Tiles that make the steps of a block of one realization; the numbers do not depend on the threads.

    Parameters
    ----------
    plan : Plan
        Of the whole network.
    parts : list of Block
        One for each tile.
    pool : Executor, optional
        On whose threads they run.
    """

    def __init__(self, plan: Plan, parts: list[Block], pool: concurrent.futures.Executor | None) -> None:
        self.plan, self.parts, self.pool = plan, parts, pool

    def call(
        self, state: State, now: int, count: int, snapshots: np.ndarray, summing: bool, every: int, phase: int
    ) -> None:  # fmt: skip
        """Let every tile make some steps from a state, and bring their own bodies together."""
        plan = self.plan

        def run(part: Block, tile: Tile) -> np.ndarray:
            part.now = now
            for block, whole in zip(part.state[:2], state[:2], strict=True):
                np.take(whole, tile.bodies, axis=0, out=block[:-1])
            kept = np.empty((len(snapshots), part.plan.snapshot.size, 1))
            part.call(count, kept, summing, every, phase)
            return kept

        each = self.pool.map if self.pool else map
        snapshots_of = list(each(run, self.parts, plan.subdomains.tiles))  # all, before the state changes
        for tile, part, kept in zip(plan.subdomains.tiles, self.parts, snapshots_of, strict=True):
            mine, contacts = slice(tile.bodies[0], tile.bodies[0] + tile.own_bodies), tile.contacts[: tile.own_contacts]
            for name in ("x", "v", "reading", "velocity", "total"):
                getattr(state, name)[mine] = getattr(part.state, name)[: tile.own_bodies]
            state.contact_force[contacts] = part.state.contact_force[: tile.own_contacts]
            more = [AT_KICKS] * plan.snapshot.kicked + [PEAKS] * plan.snapshot.peaked
            for quantity in (*QUANTITIES.values(), *more):
                slots = contacts if quantity.dimension == CONTACT else mine
                here, there = (item.place(quantity.name) for item in (plan.snapshot, part.plan.snapshot))
                snapshots[:, here][:, slots] = kept[:, there]

    def taken(self, lanes: np.ndarray) -> Self:
        """Return tiles of some of the realizations, which go on from here as these would."""
        return type(self)(self.plan, [part.taken(lanes) for part in self.parts], self.pool)

    def noted(self) -> list[np.ndarray]:
        """Return the arrays in which a step is noted for the sums over the next one, […, lane], to be changed."""
        return [item for part in self.parts for item in part.noted()]

    def note_gaps(self, x: np.ndarray, v: np.ndarray) -> None:
        """Store the gaps and their rates from which closings are counted."""
        for part, tile in zip(self.parts, self.plan.subdomains.tiles, strict=True):
            places = np.append(tile.bodies, len(self.plan.system.bodies))
            part.note_gaps(x[places], v[places])

    def clear_sums(self) -> None:
        """Set the sums of all tiles to 0."""
        for part in self.parts:
            part.clear_sums()

    def collect_sums(self, sums: Sums) -> None:
        """Bring the sums of all tiles together."""
        for part, tile in zip(self.parts, self.plan.subdomains.tiles, strict=True):
            part.collect_sums()
            sums.bodies[:, :, tile.bodies[: tile.own_bodies]] = part.sums.bodies
            sums.samples[:, tile.bodies[: tile.own_bodies]] = part.sums.samples
            sums.contacts[:, tile.contacts[: tile.own_contacts]] = part.sums.contacts
