"""Networks of one structure in one compiled run: each begins, is observed and ends as it does alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, pairwise
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.mechanism import Mode
from impactlab.errors import Diverged
from impactlab.machine import cores
from impactlab.plan.plan import Plan
from impactlab.plan.side_by_side import Planned, side_by_side, structure
from impactlab.records.record import Keeper
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.checkpoint import Checkpoint
from impactlab.simulation.block_sums import BlockResult, merged
from impactlab.simulation.ensemble import add_sums, run_block, run_blocks
from impactlab.statistics.estimate import Rows, Units

JOINT_SIZE, LEAST = 8000, 64
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

    def collected(self, blocks: Sequence[BlockResult | None]) -> list[Found | None]:
        """Return the results of each network, None for a network that left the range of finite numbers in a block."""
        number, wholes = len(self.planned), [block for block in blocks if block is not None]
        if len(wholes) < len(blocks):
            return [None] * number
        lost = set().union(*(block.lost for block in wholes))
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


class Found(NamedTuple):
    """Results of one network of a joint run."""

    blocks: list[BlockResult]  # as `impactlab.simulation.ensemble.run` returns them
    rows: Rows  # estimates from their sums


def joins(planned: Planned) -> bool:
    """Whether a network can run beside others."""
    plan = planned.plan
    steps_alone = plan.method.interval == 1 and not (plan.subdomains.tiles or plan.observed.ends)
    return _most(plan) > 1 and steps_alone and Mode.SIDE_BY_SIDE not in plan.system.refusals


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
    return max(1, JOINT_SIZE // _size(plan))


def _size(plan: Plan) -> int:
    return len(plan.system.bodies) * plan.realizations.lanes


def run_all(
    runs: Sequence[JointRun], progress: Callable[[float], None], checkpoint: Checkpoint | None = None
) -> list[list[Found | None]]:
    """Run all blocks of some runs on threads and return the results of each run by network.

    `progress` is called now and then with the part that is done.
    """
    results: list[BlockResult | None] = []
    run_blocks([item.whole for item in runs], _run_block, results.append, progress, checkpoint=checkpoint)
    found = iter(results)
    return [item.collected([*islice(found, item.whole.realizations.blocks)]) for item in runs]


def _run_block(*arguments: Any) -> BlockResult | None:
    """Run one block, or return nothing if it diverges as a whole: each network reports it when it runs alone."""
    try:
        with np.errstate(invalid="ignore", over="ignore"):  # of networks that leave the range of finite numbers
            return run_block(*arguments)
    except Diverged:
        return None


@dataclass(frozen=True, eq=False)
class _Together:
    """The same record of several networks."""

    records: list[Any]
    plans: list[Plan]
    summed: tuple[str, ...] = ()

    def read(self, plan: Plan) -> None:
        """Say that all rows of snapshots are read."""

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        """Return a keeper that hands each network its own part of the snapshots."""
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
    """Return the result of a block for one network."""
    bodies, contacts = (np.ascontiguousarray(item[..., place::number, :]) for item in (whole.bodies, whole.contacts))
    records: list[dict[str, Any]] = [item["networks"][place] for item in whole.records]  # type: ignore[misc]
    return BlockResult(bodies, contacts, whole.products, whole.points, whole.laws, whole.events, records)
