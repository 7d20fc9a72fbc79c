"""Computations that keep what is finished in a folder."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

from impactlab.errors import InvalidInput
from impactlab.machine import workers_of
from impactlab.plan.seed import seed_from, seed_of
from impactlab.records.record import Record
from impactlab.records.trajectory import Trajectory
from impactlab.results.checkpoint import Checkpoint, checkpoint_in


def check_kept(folder: Any, tolerance: Any, out: Any, records: Sequence[Record] | None) -> None:
    """Refuse a checkpoint of a simulation with what cannot be kept."""
    if folder is None:
        return
    if tolerance is not None:
        raise InvalidInput(
            "checkpoint: how a tolerance is reached depends on the time that realizations take, so that no run goes on "
            "from another one; give duration=, or a checkpoint of a sweep, whose points are kept."
        )
    if out is not None and any(isinstance(item, Trajectory) for item in records or ()):
        raise InvalidInput(
            "checkpoint: trajectories that are written to out= while they arise are not kept; leave out one of both."
        )


@contextlib.contextmanager
def kept_run(
    folder: Any, question: str, executor: Executor | None, asked: Mapping[str, Any]
) -> Iterator[tuple[Checkpoint | None, Any]]:
    """Give the checkpoint in a folder, None where none is given, and the random numbers of the call that made it.

    A checkpoint that is given itself belongs to a computation of which this one is a part. What is `asked` must be the
    same in all calls. Where its "rng" is None, later calls have the seed of the first one. All have
    blocks for as many workers as the first.
    """
    if folder is None or isinstance(folder, Checkpoint):
        yield folder, asked["rng"]
        return
    seed = None if asked["rng"] is None else seed_of(asked["rng"])

    def chosen() -> dict[str, Any]:
        return {"seed": seed or seed_of(None), "workers": workers_of(executor)}

    with checkpoint_in(folder, {"question": question, **asked, "rng": seed}, chosen) as checkpoint:
        yield checkpoint, seed_from(checkpoint.chosen["seed"])
