"""Runs the blocks of a plan, spread over the cores."""

from __future__ import annotations

import concurrent.futures
import contextlib
import os
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from impactlab.block import Block, BlockResult, Tick, compiled
from impactlab.errors import ImpactLabError, Interrupted, InvalidInput
from impactlab.plan import Plan
from impactlab.plan.subdomains import Tile


def run(
    plan: Plan, executor: concurrent.futures.Executor | None, progress: Callable[[float], None]
) -> list[BlockResult]:
    """Run all blocks and return their results in order.

    Parameters
    ----------
    plan : Plan
    executor : Executor, optional
        Where to run; by default threads, one per core.
    progress : callable
        Called now and then with the part that is done.

    Raises
    ------
    Diverged
        If a realization left the range of finite numbers.
    ImpactLabError
        If a worker of the executor died.
    """
    total = plan.realizations.number * plan.clock.all_steps
    done, stop, lock = [0], threading.Event(), threading.Lock()

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
        report = (tick, threads) if shared_memory else ()  # a lock cannot go to another process
        futures = [begin(pool, run_block, plan, k, *report) for k in range(plan.realizations.blocks)]
        kept: list[dict[str, np.ndarray]] = [{} for _ in plan.observed.records]
        try:
            pending = set(futures)
            while pending:
                finished, pending = concurrent.futures.wait(pending, 0.1, concurrent.futures.FIRST_EXCEPTION)
                for future in finished:
                    _add(kept, future.result().records, plan)
                progress(done[0] / total if shared_memory else 1.0 - len(pending) / len(futures))
        except BaseException as error:
            stop.set()
            for future in futures:
                future.cancel()
            if isinstance(error, concurrent.futures.BrokenExecutor):
                raise ImpactLabError(f"A worker of the executor died, for want of memory perhaps: {error}") from error
            raise
    results = [future.result() for future in futures]
    for sums, of_first in zip(kept, results[0].records, strict=True):
        of_first.update(sums)
    return results


def _add(kept: list[dict[str, np.ndarray]], records: list[dict[str, np.ndarray]], plan: Plan) -> None:
    """Add what the records of a finished block have in common with those of others, and take it from them."""
    for sums, of_block, (record, _) in zip(kept, records, plan.observed.records, strict=True):
        for name in record.summed:
            array = of_block.pop(name)
            if name in sums:
                sums[name] += array
            else:
                sums[name] = array


def begin(executor: concurrent.futures.Executor, function: Callable[..., Any] = int, *arguments: Any) -> Any:
    """Submit a function and return its future, or say that the executor takes nothing any more.

    Raises
    ------
    InvalidInput
        If the executor was shut down, or its workers died.
    """
    try:
        return executor.submit(function, *arguments)
    except RuntimeError as error:  # a broken executor's error is one as well
        raise InvalidInput(f"The executor takes no more work ({error}); give one that is running.") from error


class SharedThreads(concurrent.futures.ThreadPoolExecutor):
    """Threads on which several simulations run at a time: each needs only its share of them."""

    def __init__(self, threads: int, simulations: int) -> None:
        super().__init__(threads)
        self.share = -(-threads // max(simulations, 1))


def workers_of(executor: concurrent.futures.Executor | None) -> int:
    """Number of blocks that a simulation on an executor should run at once."""
    return executor.share if isinstance(executor, SharedThreads) else cores()


def shares_memory(executor: concurrent.futures.Executor | None) -> bool:
    """Whether blocks run in this process."""
    return executor is None or isinstance(executor, concurrent.futures.ThreadPoolExecutor)


def cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_block(plan: Plan, index: int, tick: Tick = lambda steps: None, threads: int = 1) -> BlockResult:
    """Run one block of realizations: a pure function of the plan and the index; tiles run on some threads."""
    with contextlib.ExitStack() as stack:
        if plan.subdomains.tiles:
            pool = stack.enter_context(concurrent.futures.ThreadPoolExecutor(threads)) if threads > 1 else None
            block: Block = _TiledBlock(plan, index, tick, pool)
        else:
            block = Block(plan, index, tick)
        block.advance(plan.clock.spin_up_steps, None)
        return block.measure()


class _TiledBlock(Block):
    """A block of one realization of a large network, in tiles; the numbers do not depend on the threads."""

    def __init__(self, plan: Plan, index: int, tick: Tick, pool: concurrent.futures.Executor | None) -> None:
        super().__init__(plan, index, tick)
        self.pool = pool
        self.parts = [Block(plan.restricted(tile), index, lambda steps: None) for tile in plan.subdomains.tiles]

    def _call(self, count: int, snapshots: np.ndarray, summing: bool, every: int, phase: int) -> None:
        """Let every tile make its steps from the state of the network, and bring their own bodies together."""
        plan, state = self.plan, self.state
        bodies, own = len(plan.system.bodies), 2 * plan.observed.bodies

        def run(part: Block, tile: Tile) -> np.ndarray:
            part.now = self.now
            for block, whole in zip(part.state[:2], state[:2], strict=True):
                np.take(whole, tile.bodies, axis=0, out=block[:-1])
            kept = np.empty((len(snapshots), 2 * tile.own_bodies + tile.own_contacts, 1))
            part._call(count, kept, summing, every, phase)
            return kept

        each = self.pool.map if self.pool else map
        snapshots_of = list(each(run, self.parts, plan.subdomains.tiles))  # all, before the state changes
        for tile, part, kept in zip(plan.subdomains.tiles, self.parts, snapshots_of, strict=True):
            mine, contacts = slice(tile.bodies[0], tile.bodies[0] + tile.own_bodies), tile.contacts[: tile.own_contacts]
            for name in ("x", "v", "reading", "velocity", "total"):
                getattr(state, name)[mine] = getattr(part.state, name)[: tile.own_bodies]
            state.contact_force[contacts] = part.state.contact_force[: tile.own_contacts]
            if len(snapshots):
                for at, block in zip((0, bodies), np.split(kept[:, : 2 * tile.own_bodies], 2, axis=1), strict=True):
                    snapshots[:, at + mine.start : at + mine.stop] = block
                snapshots[:, own + contacts] = kept[:, 2 * tile.own_bodies :]

    def _note_gaps(self, x: np.ndarray, v: np.ndarray) -> None:
        for part, tile in zip(self.parts, self.plan.subdomains.tiles, strict=True):
            places = np.append(tile.bodies, len(self.plan.system.bodies))
            part._note_gaps(x[places], v[places])

    def _clear_sums(self) -> None:
        for part in self.parts:
            part._clear_sums()

    def _collect_sums(self) -> None:
        for part, tile in zip(self.parts, self.plan.subdomains.tiles, strict=True):
            self.sums.bodies[:, :, tile.bodies[: tile.own_bodies]] = part.sums.bodies
            self.sums.contacts[:, tile.contacts[: tile.own_contacts]] = part.sums.contacts


def merged(results: list[BlockResult]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Join the sums of all blocks along the realizations, in order."""
    if len(results) == 1:  # without a copy
        return results[0].bodies, results[0].contacts, results[0].products
    return (
        np.concatenate([result.bodies for result in results], axis=-1),
        np.concatenate([result.contacts for result in results], axis=-1),
        np.concatenate([result.products for result in results], axis=-1),
    )
