"""Processes of this machine in which blocks run, of which lost ones are replaced."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.inputs import Count, checked, shown
from impactlab.machine import cores

MOST_PROCESSES = 4096
"""Processes of one machine; operating systems allow hardly more for a user."""

MOST_LOST = 8
"""How often a piece of work is begun anew since a process was lost: it may be the cause, by the memory that it takes,
and each loss concerns all pieces that run."""


@checked
class Processes(Executor):
    """Processes of this machine. One that dies is replaced, and its work is done again; none outlives the program.

    They begin anew, and are not forked, so that they are safe beside threads. Hence a script with classes of its own
    makes them below ``if __name__ == "__main__":``.

    Parameters
    ----------
    number : int, optional
        How many there are; one per core by default.
    prepare : callable, optional
        Called in each process when it begins; a function of a module.
    *arguments
        What it is called with.

    Examples
    --------
    >>> with il.Processes(1) as processes:
    ...     apart = il.simulate(network, 10.0, realizations=64, rng=1, executor=processes)
    >>> apart.equals(il.simulate(network, 10.0, realizations=64, rng=1))
    True
    """

    def __init__(
        self, number: Count | None = None, prepare: Callable[..., None] | None = None, *arguments: Any
    ) -> None:
        self._max_workers = cores() if number is None else number
        if self._max_workers > MOST_PROCESSES:
            raise InvalidInput(f"Processes: number must be {MOST_PROCESSES} at most, not {shown(number)}.")
        self._prepare = prepare, arguments
        self._replacing, self._closed = threading.Lock(), False
        self._pool = self._begun()

    def _begun(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._max_workers, multiprocessing.get_context("spawn"), initializer=_begin, initargs=self._prepare
        )

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """Return the future of a call in one of the processes."""
        if self._closed:
            raise RuntimeError("cannot schedule new futures after shutdown")
        outer: Future[Any] = Future()
        self._submit(outer, 0, function, arguments, named)
        return outer

    def _submit(self, outer: Future[Any], lost: int, *call: Any) -> None:
        function, arguments, named = call
        while True:
            pool = self._pool
            try:
                inner = pool.submit(function, *arguments, **named)
                break
            except BrokenProcessPool:
                self._replace(pool)

        def ended(inner: Future[Any]) -> None:
            if inner.cancelled() or outer.cancelled():
                outer.cancel()
            elif not isinstance(error := inner.exception(), BrokenProcessPool):
                outer.set_exception(error) if error is not None else outer.set_result(inner.result())
            elif self._closed or lost + 1 >= MOST_LOST:
                outer.set_exception(
                    ImpactLabError(f"A process was lost {lost + 1} times at the same work, perhaps for lack of memory.")
                )
            else:
                self._replace(pool)
                self._submit(outer, lost + 1, *call)

        inner.add_done_callback(ended)

    def _replace(self, lost: ProcessPoolExecutor) -> None:
        """Begin new processes in the place of those of which one was lost."""
        with self._replacing:
            if self._pool is lost and not self._closed:
                self._pool = self._begun()
                lost.shutdown(wait=False)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes."""
        self._closed = True
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


def _begin(prepare: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    """Prepare a process: Ctrl-C is answered by the program that began it, and with it the process ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def follow() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=follow, daemon=True).start()
    if prepare is not None:
        prepare(*arguments)
