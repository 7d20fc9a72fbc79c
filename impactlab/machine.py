"""The machine: cores, threads and executors for blocks; sizes of blocks to suit."""

from __future__ import annotations

import concurrent.futures
import contextlib
import gc
import itertools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from impactlab.errors import ImpactLabError, Interrupted, InvalidInput
from impactlab.interrupts import Uninterrupted

Result = TypeVar("Result")

MOST_WAITING = 128
"""Tasks that are handed to workers before the first of them has ended: 100 000 take the memory of these."""

NUMBERS_AT_A_TIME = 2_000_000
"""Numbers of an array that is made on the way (16 MB), where all at a time would be many more."""

ROWS_AT_A_TIME = 4096
"""Rows of a small problem that are worked on at a time, for the same reason."""


@dataclass(frozen=True)
class Tuning:
    """Sizes that suit a machine, as measured on one. No result depends on them."""

    lanes: int = 520
    """Largest number of realizations in a block: enough to outweigh what a step costs at any number, few enough for the
    cache.
    """
    cached: int = 4000  # bodies times lanes of a block that stay in a core's cache
    fewest_lanes: int = 64  # lanes that are not worth dividing for it
    bodies_per_lane: int = 16  # from which on loops over the bodies of one lane cost less than loops over lanes
    single_lane_bodies: int = 200  # bodies from which on they do, too
    single_lane_steps: float = 2e8
    """Steps of bodies of all runs of one realization from which on a compiler is waited for, to make loops over bodies.
    """
    series_bytes: float = 160e6  # memory that the series of a block may take
    call_seconds: float = 0.05  # length of a compiled call: short, so that interrupts are answered
    tile_bodies: int = 4000  # bodies of a tile: few enough for the cache, enough to outweigh what a call costs
    tile_steps: tuple[int, ...] = (64, 32, 16, 8)
    """Steps that tiles make alone, the best first; multiples of the slots of the sums."""
    tile_excess: float = 1.5
    """Largest number of bodies in all tiles with their halos, as a multiple of the bodies of the network."""
    chunk_bytes: int = 1_000_000
    """Size of what is written to a file at a time, and of its chunks, if a sample of a block is not larger."""
    cosines: float = 4e6  # cosines that are evaluated at a time where no FFT sums them


_tuning = Tuning()


def tuning() -> Tuning:
    """Return the sizes that plans are made with in this process."""
    return _tuning


@contextlib.contextmanager
def tuned(**changes: Any) -> Iterator[Tuning]:
    """Let this process, all its threads, plan with other sizes meanwhile: fields of :class:`Tuning`."""
    global _tuning
    usual, _tuning = _tuning, replace(_tuning, **changes)
    try:
        yield _tuning
    finally:
        _tuning = usual


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Let Python not look for garbage meanwhile: of the many objects that a plan is made of nearly all stay."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def begin(executor: concurrent.futures.Executor, function: Callable[..., Any] = int, *arguments: Any) -> Any:
    """Submit a function and return its future; refuse an executor that takes nothing any more."""
    try:
        return executor.submit(function, *arguments)
    except RuntimeError as error:  # a broken executor's error is one as well
        raise InvalidInput(f"The executor accepts no more work ({error}); give one that is running.") from error


class Tally:
    """Counts the steps that tasks make on threads of this process, and ends them once it is stopped."""

    def __init__(self) -> None:
        self.done, self.stop, self._lock = 0, threading.Event(), threading.Lock()

    def __call__(self, steps: int) -> None:
        """Count some steps of a task; raise an error where all are to end."""
        if self.stop.is_set():
            raise Interrupted("The simulation was stopped.")
        with self._lock:
            self.done += steps


def hand_over(
    tasks: Iterable[concurrent.futures.Future[Result]],
    finished: Callable[[Result], None],
    show: Callable[[], None],
    stop: threading.Event,
    most: int = 0,
) -> None:
    """Call `finished` with the result of each task, in their order as soon as all before it ended, and `show` now and
    then.

    No more than `MOST_WAITING` tasks, or `most` if these are more, are made before the first of them has ended. An
    error, in a task or in a function that is called here, stops all: `stop` is set, at which tasks that run have to
    look, and the others do not begin. A worker that died is told in words.
    """
    waiting: deque[concurrent.futures.Future[Result]] = deque()
    left = iter(tasks)
    try:
        while True:
            waiting.extend(itertools.islice(left, max(MOST_WAITING, most) - len(waiting)))
            if not waiting:
                return
            with Uninterrupted():  # what waits has locks, which an interrupt in its midst might leave closed
                concurrent.futures.wait([waiting[0]], 0.1)
            while waiting and waiting[0].done():
                finished(waiting.popleft().result())
            for task in waiting:
                if task.done():
                    task.result()  # an error is raised before those in front of it end
            show()
    except BaseException as error:
        stop.set()
        for task in waiting:
            task.cancel()
        if lost_worker(error):
            raise ImpactLabError(f"A worker of the executor died, perhaps for lack of memory: {error}") from error
        raise


def lost_worker(error: BaseException | None) -> bool:
    """Whether an error tells that an executor lost a worker which it does not replace."""
    of_dask = type(error).__module__.partition(".")[0] == "distributed"  # whose errors have no class in common
    return of_dask or isinstance(error, concurrent.futures.BrokenExecutor)


class SharedThreads(concurrent.futures.ThreadPoolExecutor):
    """Threads on which several simulations run at a time: each needs only its share of them."""

    def __init__(self, threads: int, simulations: int) -> None:
        super().__init__(threads)
        self.share = -(-threads // max(simulations, 1))


def workers_of(executor: concurrent.futures.Executor | None) -> int:
    """Number of blocks that a simulation on an executor should run at once; of cores, where an executor hides its."""
    if isinstance(executor, SharedThreads):
        return executor.share
    known = getattr(executor, "_max_workers", None)  # of pools of the standard library, loky and mpi4py
    return known if isinstance(known, int) and known > 0 else cores()


def shares_memory(executor: concurrent.futures.Executor | None) -> bool:
    """Whether blocks run in this process."""
    return executor is None or isinstance(executor, concurrent.futures.ThreadPoolExecutor)


def cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
