"""Computations that keep what is finished in a folder."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from typing import Any

from impactlab.machine import workers_of
from impactlab.plan.seed import Seed, seed_of
from impactlab.results.checkpoint import Checkpoint, checkpoint_in


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
        yield checkpoint, Seed(*checkpoint.chosen["seed"])
