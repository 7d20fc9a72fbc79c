"""Runs the blocks of a plan, spread over the cores."""

from __future__ import annotations

import concurrent.futures
import contextlib
import threading
from collections.abc import Callable

import numpy as np

from impactlab.errors import ImpactLabError, Interrupted
from impactlab.kernels.impacts import MANY
from impactlab.machine import begin, cores, shares_memory, workers_of
from impactlab.plan.plan import Plan
from impactlab.plan.subdomains import Tile
from impactlab.progress import Report
from impactlab.results.schema import CONTACT
from impactlab.results.snapshot import PEAKS, QUANTITIES
from impactlab.simulation.block import Block, Tick, compiled
from impactlab.simulation.block_sums import BlockResult
from impactlab.simulation.live import Live


def run(
    plan: Plan, executor: concurrent.futures.Executor | None, progress: Callable[[float], None]
) -> list[BlockResult]:
    """Run all blocks, on threads or an executor, and return their results in order.

    `progress` is called now and then with the part that is done; a `Report` also with what tells what is found so far.
    An error tells of a realization that left the range of finite numbers, and of a worker of the executor that died.
    """
    total = plan.realizations.left * plan.clock.all_steps
    done, stop, lock = [0], threading.Event(), threading.Lock()
    report, live = Report.of(progress), Live(plan)

    def tick(steps: int) -> None:
        if stop.is_set():
            raise Interrupted("The simulation was stopped.")
        with lock:
            done[0] += steps

    with contextlib.ExitStack() as stack:
        most = min(plan.realizations.blocks, cores())
        pool = executor or stack.enter_context(concurrent.futures.ThreadPoolExecutor(most))
        shared_memory = shares_memory(pool)
        if shared_memory:
            compiled(plan)  # in this thread, where Ctrl-C is answered at once
        threads = max(1, workers_of(executor) // plan.realizations.blocks)
        watched = (tick, threads, live) if shared_memory else ()  # a lock cannot go to another process
        futures = [begin(pool, run_block, plan, k, *watched) for k in range(plan.realizations.blocks)]
        kept: list[dict[str, np.ndarray]] = [{} for _ in plan.observed.records]
        try:
            pending = set(futures)
            while pending:
                finished, pending = concurrent.futures.wait(pending, 0.1, concurrent.futures.FIRST_EXCEPTION)
                for future in finished:
                    add_sums(kept, future.result().records, plan)
                report(done[0] / total if shared_memory else 1.0 - len(pending) / len(futures), live.text)
        except BaseException as error:
            stop.set()
            for future in futures:
                future.cancel()
            if isinstance(error, concurrent.futures.BrokenExecutor):
                raise ImpactLabError(f"A worker of the executor died, perhaps for lack of memory: {error}") from error
            raise
    results = [future.result() for future in futures]
    for sums, of_first in zip(kept, results[0].records, strict=True):
        of_first.update(sums)
    return results


def add_sums(kept: list[dict[str, np.ndarray]], records: list[dict[str, np.ndarray]], plan: Plan) -> None:
    """Move the sums that the records of a finished block share with those of other blocks to the common ones."""
    for sums, of_block, (record, _) in zip(kept, records, plan.observed.records, strict=True):
        for name in record.summed:
            array = of_block.pop(name)
            if name in sums:
                sums[name] += array
            else:
                sums[name] = array


def continued(results: list[BlockResult], more: list[BlockResult], plan: Plan) -> list[BlockResult]:
    """Return the results of all blocks of a run from those of its first realizations and those of the others."""
    if not results:
        return more
    for sums, others, (record, _) in zip(results[0].records, more[0].records, plan.observed.records, strict=True):
        for name in record.summed:
            shorter, longer = sorted((sums[name], others.pop(name)), key=len)  # of fewer subsamples
            longer[: len(shorter)] += shorter
            sums[name] = longer
    return [*results, *more]


def run_block(
    plan: Plan, index: int, tick: Tick = lambda steps: None, threads: int = 1, live: Live | None = None
) -> BlockResult:
    """Run one block of realizations: a pure function of the plan and the index; tiles run on some threads."""
    with contextlib.ExitStack() as stack:
        if plan.subdomains.tiles:
            pool = stack.enter_context(concurrent.futures.ThreadPoolExecutor(threads)) if threads > 1 else None
            block: Block = _TiledBlock(plan, index, tick, pool)
        else:
            block = Block(plan, index, tick)
        if live is not None:
            block.tick = _telling(live, index, block)
        block.advance(plan.clock.spin_up_steps, None)
        return block.measure()


def _telling(live: Live, index: int, block: Block) -> Tick:
    """Return the tick of a block, which from then on also shows the sums of the block."""
    tick = block.tick

    def both(steps: int) -> None:
        tick(steps)
        live.take(index, block.now, block.sums)

    return both


class _TiledBlock(Block):
    """A block of one realization of a large network, in tiles; the numbers do not depend on the threads."""

    def __init__(self, plan: Plan, index: int, tick: Tick, pool: concurrent.futures.Executor | None) -> None:
        super().__init__(plan, index, tick)
        self.pool = pool
        self.parts = [Block(tile, index, lambda steps: None) for tile in plan.tiles]

    def _call(self, count: int, snapshots: np.ndarray, summing: bool, every: int, phase: int) -> None:
        """Let every tile make its steps from the state of the network, and bring their own bodies together."""
        plan, state = self.plan, self.state

        def run(part: Block, tile: Tile) -> np.ndarray:
            part.now = self.now
            for block, whole in zip(part.state[:2], state[:2], strict=True):
                np.take(whole, tile.bodies, axis=0, out=block[:-1])
            kept = np.empty((len(snapshots), part.plan.snapshot.size, 1))
            part._call(count, kept, summing, every, phase)
            return kept

        each = self.pool.map if self.pool else map
        snapshots_of = list(each(run, self.parts, plan.subdomains.tiles))  # all, before the state changes
        for tile, part, kept in zip(plan.subdomains.tiles, self.parts, snapshots_of, strict=True):
            mine, contacts = slice(tile.bodies[0], tile.bodies[0] + tile.own_bodies), tile.contacts[: tile.own_contacts]
            for name in ("x", "v", "reading", "velocity", "total"):
                getattr(state, name)[mine] = getattr(part.state, name)[: tile.own_bodies]
            state.contact_force[contacts] = part.state.contact_force[: tile.own_contacts]
            for quantity in (*QUANTITIES.values(), *[PEAKS] * plan.snapshot.peaked):
                slots = contacts if quantity.dimension == CONTACT else mine
                here, there = (item.place(quantity.name) for item in (plan.snapshot, part.plan.snapshot))
                snapshots[:, here][:, slots] = kept[:, there]

    def note_gaps(self, x: np.ndarray, v: np.ndarray) -> None:
        for part, tile in zip(self.parts, self.plan.subdomains.tiles, strict=True):
            places = np.append(tile.bodies, len(self.plan.system.bodies))
            part.note_gaps(x[places], v[places])

    def _clear_sums(self) -> None:
        for part in self.parts:
            part._clear_sums()

    def _collect_sums(self) -> None:
        for part, tile in zip(self.parts, self.plan.subdomains.tiles, strict=True):
            part._take_peaks()
            self.sums.bodies[:, :, tile.bodies[: tile.own_bodies]] = part.sums.bodies
            self.sums.samples[:, tile.bodies[: tile.own_bodies]] = part.sums.samples
            self.sums.contacts[:, tile.contacts[: tile.own_contacts]] = part.sums.contacts


def endless_chatter(plan: Plan, results: list[BlockResult]) -> str:
    """Say which rigid contact had too many impacts in a step first, and when; nothing where none had."""
    steps = np.concatenate([result.endless[0] for result in results], axis=-1)
    if not steps.any():
        return ""
    first = np.where(steps > 0.0, steps, np.inf).min(axis=-1)
    rigid = int(first.argmin())
    time = (first[rigid] - 1.0 - plan.clock.spin_up_steps) * plan.clock.step
    name, lanes = plan.system.contacts[plan.impacts.rigid.contacts[rigid]], np.count_nonzero(steps[rigid])
    others = np.count_nonzero(np.isfinite(first)) - 1
    return (
        f"Chatter of {name!r} does not end: it had more than {MANY} impacts in the step at t = {time:g} s, and in "
        f"{lanes} of {steps.shape[-1]} realization(s){f', as had {others} other contact(s)' if others else ''}. They "
        "are held at rest for what is left of such a step, which takes energy unless bodies rest on each other: give "
        "a shorter step=."
    )


def slow_impacts(plan: Plan, results: list[BlockResult]) -> np.ndarray:
    """Return the least closing velocity that counts where slower impacts were in the measurement, (contact,) (m s-1).

    It is NaN where all impacts count, or none was slower; of contacts with forces, too.
    """
    speeds, rigid = np.full(len(plan.system.contacts), np.nan), plan.impacts.rigid.contacts
    last = np.max([result.endless[1].max(axis=-1, initial=0.0) for result in results], axis=0)
    speeds[rigid] = np.where(last > plan.clock.spin_up_steps, plan.impacts.counted, np.nan)
    return speeds


def chatter(plan: Plan, speeds: np.ndarray) -> str:
    """Say of which rigid contact the slowest impacts do not count, and from which closing velocity on they do."""
    found = np.flatnonzero(np.isfinite(speeds))
    if not found.size:
        return ""
    others = f", nor of {found.size - 1} other contact(s)" if found.size > 1 else ""
    return (
        f"{plan.system.contacts[found[0]]!r} comes to rest by bouncing: its impacts are endlessly many in finite time, "
        f"so that they have no rate{others}. contact_rate counts those that close with {speeds[found[0]]:.3g} m/s or "
        "more; see impact_velocity_threshold."
    )


def merged(results: list[BlockResult]) -> tuple[np.ndarray, ...]:
    """Join the sums of all blocks over bodies, contacts, pairs, points and laws along the realizations, in order."""
    sums = [(result.bodies, result.contacts, result.products, result.points, result.laws) for result in results]
    return sums[0] if len(sums) == 1 else tuple(np.concatenate(kind, axis=-1) for kind in zip(*sums, strict=True))
