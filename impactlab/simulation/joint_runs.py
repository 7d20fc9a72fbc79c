"""Networks of one structure in one compiled run: each begins, is observed and ends as it does alone."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from impactlab.errors import Diverged, Interrupted
from impactlab.machine import cores
from impactlab.nonlinear.force_checks import LARGEST
from impactlab.plan.plan import Plan
from impactlab.plan.side_by_side import Planned, obstacle, side_by_side, structure
from impactlab.records.record import Keeper
from impactlab.records.recorded_run import RecordedRun
from impactlab.simulation.block import Block, Tick, compiled
from impactlab.simulation.block_sums import BlockResult
from impactlab.simulation.ensemble import add_sums, merged
from impactlab.statistics.estimate import Rows, Units

SIZE, LEAST = 8000, 64
"""Bodies times lanes of a joint run: enough to outweigh the cost of a call, and few enough for the cache; and the least
in each run where networks are divided among several runs only to keep all cores busy."""


@dataclass(frozen=True, eq=False)
class JointRun:
    """A run of several networks.

    Parameters
    ----------
    planned : sequence of Planned
        The networks and their plans, of one `impactlab.plan.side_by_side.structure`.
    """

    planned: Sequence[Planned]
    whole: Plan = field(init=False)

    def __post_init__(self) -> None:
        whole = side_by_side(self.planned)
        records = [
            (_Together([plan.observed.records[index][0] for plan in self.plans], self.plans), ratio)
            for index, (_, ratio) in enumerate(self.plans[0].observed.records)
        ]
        object.__setattr__(self, "whole", replace(whole, observed=replace(whole.observed, records=tuple(records))))

    @property
    def plans(self) -> list[Plan]:
        """Plans of the networks."""
        return [plan for _, plan in self.planned]

    def run(self, index: int, tick: Tick) -> OfBlock:
        """Run one block of realizations; return what it found, and which networks left the range of finite numbers."""
        try:
            block = _JointBlock(self, index, tick)
            with np.errstate(invalid="ignore", over="ignore"):  # of networks that did
                block.advance(self.whole.clock.spin_up_steps, None)
                return OfBlock(block.measure(), block.lost)
        except Diverged:  # each network reports it when it runs alone
            return OfBlock(None, set(range(len(self.planned))))

    def collected(self, blocks: Sequence[OfBlock]) -> list[Found | None]:
        """Return what all blocks found of each network, None if it left the range of finite numbers in a block."""
        number, lost = len(self.planned), set().union(*(block.lost for block in blocks))
        wholes = [block.result for block in blocks if block.result is not None]
        if len(wholes) < len(blocks):
            return [None] * number
        with np.errstate(all="ignore"):  # of networks that are lost
            rows = Rows.of_each(self.whole, self.plans, Units.of(self.whole, *merged(wholes)))
        result: list[Found | None] = []
        for place, plan in enumerate(self.plans):
            found = [_of_network(whole, place, number) for whole in wholes]
            kept: list[dict[str, np.ndarray]] = [{} for _ in plan.observed.records]
            for item in found:
                add_sums(kept, item.records, plan)
            for sums, of_first in zip(kept, found[0].records, strict=True):
                of_first.update(sums)
            result.append(None if place in lost else Found(found, rows[place]))
        return result


class OfBlock(NamedTuple):
    """What a block found of several networks."""

    result: BlockResult | None  # None if all left the range of finite numbers
    lost: set[int]  # which of them did


class Found(NamedTuple):
    """What was found of a network."""

    blocks: list[BlockResult]  # as `impactlab.simulation.ensemble.run` returns them
    rows: Rows  # of their sums


def joins(planned: Planned) -> bool:
    """Whether a network can run beside others."""
    return _most(planned.plan) > 1 and not obstacle(planned)


def grouped(planned: Mapping[str, Planned]) -> list[list[str]]:
    """Return the keys of the networks that run together, run by run; a network without others like it is in none."""
    alike: dict[Hashable, list[str]] = {}
    for key, item in planned.items():
        alike.setdefault(structure(item), []).append(key)
    runs = []
    for keys in alike.values():
        plan = planned[keys[0]].plan
        busy = min(cores() // plan.realizations.blocks, len(keys) * _size(plan) // LEAST, len(keys) // 2)
        number = max(math.ceil(len(keys) / _most(plan)), busy)
        ends = [len(keys) * place // number for place in range(number + 1)]
        runs += [keys[begin:end] for begin, end in pairwise(ends)]
    return [keys for keys in runs if len(keys) > 1]


def _most(plan: Plan) -> int:
    """Return how many networks with plans like this one a run should have."""
    return max(1, SIZE // _size(plan))


def _size(plan: Plan) -> int:
    return len(plan.system.bodies) * plan.realizations.lanes


def run_all(runs: Sequence[JointRun], progress: Callable[[float], None]) -> list[list[Found | None]]:
    """Run all blocks of some runs on threads and return the results of each run by network.

    `progress` is called now and then with the part that is done.
    """
    done, stop, lock = [0], threading.Event(), threading.Lock()
    total = sum(item.whole.realizations.number * item.whole.clock.all_steps for item in runs)

    def tick(steps: int) -> None:
        if stop.is_set():
            raise Interrupted("The simulation was stopped.")
        with lock:
            done[0] += steps

    with ThreadPoolExecutor(cores()) as pool:
        for item in runs:
            compiled(item.whole)  # in this thread, where Ctrl-C is answered at once
        futures: list[list[Future[OfBlock]]] = [
            [pool.submit(item.run, index, tick) for index in range(item.whole.realizations.blocks)] for item in runs
        ]
        pending = {future for of_run in futures for future in of_run}
        try:
            while pending:
                finished, pending = wait(pending, 0.1)
                for future in finished:
                    future.result()
                progress(done[0] / total)
        except BaseException:
            stop.set()
            for future in pending:
                future.cancel()
            raise
    return [item.collected([future.result() for future in of_run]) for item, of_run in zip(runs, futures, strict=True)]


class _JointBlock(Block):
    """A block of the same realizations of several networks."""

    def __init__(self, run: JointRun, index: int, tick: Tick) -> None:
        self.lost: set[int] = set()
        self.networks = len(run.planned)
        self.force_sets = run.whole.driving.given // max(run.plans[0].driving.given, 1) or 1
        super().__init__(run.whole, index, tick)

    def _guard(self) -> None:
        """Note which networks have a number that is not finite, and hold these still."""
        x, v, reading = self.state.x, self.state.v, self.state.reading
        finite = np.isfinite(x) & (np.abs(v) < LARGEST) & (np.abs(reading) < LARGEST)
        if finite.all():
            return
        self.lost |= {int(body) % self.networks for body in np.flatnonzero(~finite.all(axis=1))}
        for place in self.lost:
            for item in (x, v, reading, self.state.velocity, self.state.total):
                item[place : -1 : self.networks] = 0.0


@dataclass(frozen=True, eq=False)
class _Together:
    """The same record of several networks."""

    records: list[Any]
    plans: list[Plan]
    summed: tuple[str, ...] = ()

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        """Return what keeps it of a block."""
        return _Keepers(
            [
                record.keeper(RecordedRun(own), realizations, ratio)
                for record, own in zip(self.records, self.plans, strict=True)
            ]
        )


class _Keepers(Keeper):
    """Hands each network's part of snapshots to its own keeper."""

    def __init__(self, keepers: list[Keeper]) -> None:
        super().__init__()
        self.keepers = keepers
        self.wants_start = keepers[0].wants_start

    def start(self, values: np.ndarray) -> None:
        for place, keeper in enumerate(self.keepers):
            keeper.start(values[place :: len(self.keepers)])

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        for place, keeper in enumerate(self.keepers):
            keeper.add(snapshots[:, place :: len(self.keepers)], batch)

    def result(self) -> dict[str, Any]:
        return {"networks": [keeper.result() for keeper in self.keepers]}


def _of_network(whole: BlockResult, place: int, number: int) -> BlockResult:
    """Return what a block found of one network."""
    bodies, contacts, endless = (
        np.ascontiguousarray(item[..., place::number, :]) for item in (whole.bodies, whole.contacts, whole.endless)
    )
    records: list[dict[str, Any]] = [item["networks"][place] for item in whole.records]  # type: ignore[misc]
    return BlockResult(bodies, contacts, whole.products, whole.points, whole.laws, endless, records)
