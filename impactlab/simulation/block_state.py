"""The state of a block in the midst of its work, kept now and then, from which the block goes on in another process."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import numpy as np

from impactlab.results.checkpoint import BETWEEN_STATES, KeptItem

SHARE = 0.05
"""Part of the time that keeping states may take, where they are large."""


class BlockStates:
    """Keeps the state of a block now and then, beside the item of its result.

    Parameters
    ----------
    item : KeptItem
        Of the states of the block.
    """

    def __init__(self, item: KeptItem) -> None:
        self.item = item
        self.found = self.item.load()
        self.next = time.monotonic() + BETWEEN_STATES

    @property
    def measuring(self) -> bool:
        """Whether there is a state from behind the spin-up."""
        return self.found is not None and self.found[1] is not None

    def note(self, block: Any, course: Any = None) -> None:
        """Keep the state of a block, and of what follows its course, if the last one was kept some time ago."""
        begin = time.monotonic()
        if begin > self.next:
            self.item.save([state_of_block(block), None if course is None else state_of(course, set())])
            end = time.monotonic()
            self.next = end + max(BETWEEN_STATES, (end - begin) / SHARE)

    def restore(self, block: Any, course: Any = None) -> bool:
        """Bring a block at its start, and what follows it, to the state that was kept; return whether there was one."""
        found, self.found = self.found, None
        if found is None:
            return False
        restore_block(block, found[0])
        if course is not None:
            restored(course, found[1])
        block.tick(block.now * len(block.realizations))
        return True


def state_of_block(block: Any) -> list[Any]:
    """Return the state of a block as nested plain data."""
    numbers = block.now, block.sums_began, block.lost, block.draws, block.begun, block.edge
    parts = [] if block.tiles is None else [state_of_block(part) for part in block.tiles.parts]
    return [numbers, [item.copy() for item in _arrays(_changing(block))], parts]


def restore_block(block: Any, state: list[Any]) -> None:
    """Bring a block that is at its start to a state."""
    (block.now, block.sums_began, block.lost, block.draws, block.begun, edge), arrays, parts = state
    block.edge = None if edge is None else block.made_edge(edge)
    for own, item in zip(_arrays(_changing(block)), arrays, strict=True):
        if own.flags.writeable:
            own[...] = item
    for part, of_part in zip([] if block.tiles is None else block.tiles.parts, parts, strict=True):
        restore_block(part, of_part)


def _changing(block: Any) -> tuple[Any, ...]:
    """Return the arrays that steps change, in nested tuples."""
    return (
        block.state, block.history, block.sums, block.normals, block.distinct, block.events.arrays,
        block.processes.arrays, block.intensity, block.parameters, block.series.samples,
    )  # fmt: skip


def _arrays(value: Any) -> Iterator[np.ndarray]:
    """Give all arrays in nested tuples."""
    if isinstance(value, tuple):
        for item in value:
            yield from _arrays(item)
    elif isinstance(value, np.ndarray):
        yield value


def state_of(value: Any, known: set[int]) -> Any:
    """Return what changes in keepers and in what they have, as nested plain data; an `Ellipsis` for all else.

    Objects that are `known` by their addresses come in another place. What is described by a frozen class, and code, is
    made again where it is restored.
    """
    if value is None or isinstance(value, bool | int | float | str | np.generic | set):
        return value
    if isinstance(value, np.ndarray):
        return ... if value.dtype == object else value.copy()
    if isinstance(value, list | tuple):
        items = (state_of(item, known) for item in value)
        return list(items) if isinstance(value, list) else tuple(items)
    if isinstance(value, dict):
        return {key: state_of(item, known) for key, item in value.items()}
    if not _changes(value) or id(value) in known:
        return ...
    known.add(id(value))
    return {name: state_of(item, known) for name, item in vars(value).items()}


def restored(fresh: Any, state: Any) -> Any:
    """Return a value with a state: what was made anew is changed where it is, since others may have its address."""
    if state is ...:
        return fresh
    if isinstance(fresh, np.ndarray) and isinstance(state, np.ndarray):
        if fresh.shape != state.shape or fresh.dtype != state.dtype or not fresh.flags.writeable:
            return state
        fresh[...] = state
        return fresh
    if isinstance(state, list | tuple):
        before = list(fresh) if isinstance(fresh, list | tuple) else []
        items = [restored(own, item) for own, item in itertools.zip_longest(before[: len(state)], state)]
        if isinstance(fresh, list):
            fresh[:] = items
            return fresh
        make: Callable[[list[Any]], Any] = getattr(type(fresh), "_make", type(state))
        return make(items)
    if isinstance(state, dict) and _changes(fresh):
        for name, item in state.items():
            setattr(fresh, name, restored(getattr(fresh, name, None), item))
        return fresh
    if isinstance(state, dict):
        own = fresh if isinstance(fresh, dict) else {}
        known = {key: restored(own.get(key), item) for key, item in state.items()}
        own.clear()
        own.update(known)
        return own
    return state


def _changes(value: Any) -> bool:
    """Whether a value is an object with attributes that change, and neither code nor a description."""
    described = dataclasses.is_dataclass(value) and type(value).__dataclass_params__.frozen  # type: ignore[union-attr]
    return hasattr(value, "__dict__") and not (described or callable(value) or isinstance(value, ModuleType))
