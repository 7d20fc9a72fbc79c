"""Tells when code is compiled that is common to all networks: the first time on a machine, or with a new method."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numba.core import event

from impactlab.kernels.jit import cache_folder
from impactlab.progress import is_shown, say

_LONG = 1.0
"""Time of a compilation, on one core, that is worth remembering (s)."""

_NOTE = "seconds.txt"
"""File beside the machine code that says how long it took (s)."""


@contextlib.contextmanager
def announced(progress: bool | Callable[[float], None] | None) -> Iterator[None]:
    """Say once, where a bar would be shown, that code is compiled in here, and how long it took the last time.

    What is in the cache is not compiled, and the functions of a network alone, which take a second, are not worth a
    line.
    """
    if not is_shown(progress):
        yield
        return
    compilation = _Compilation(lambda: say(progress, f"Compiling, once: the machine code is kept. {_foreseen()}"))
    with event.install_listener("numba:run_pass", compilation):
        yield
    if compilation.seconds > _LONG:
        with contextlib.suppress(OSError):  # a guess is not worth an error
            Path(cache_folder(), _NOTE).write_text(f"{compilation.seconds:.0f}\n", encoding="ascii")


def _foreseen() -> str:
    """Say how long the last compilation took, also with other versions, whose folders lie beside ours."""
    with contextlib.suppress(OSError, ValueError):
        notes = sorted(cache_folder().parent.glob(f"*-numba*/{_NOTE}"), key=lambda file: file.stat().st_mtime)
        if notes:
            return f"The last time this took {int(notes[-1].read_text(encoding='ascii'))} s of one core."
    return "The first time this takes half a minute or so of one core."


class _Compilation(event.Listener):  # type: ignore[misc]
    """Calls a function when the compiler begins with anything but the functions of a network, for the first time, and
    adds up the time of processors that it takes, in all threads.

    What is called by a function is compiled while a pass of it goes on, and counts as a part of it.
    """

    def __init__(self, call: Callable[[], None]) -> None:
        self._call, self._first, self._own = call, threading.Lock(), threading.local()
        self.seconds = 0.0

    def on_start(self, event: Any) -> None:
        self._own.depth = getattr(self._own, "depth", 0) + 1
        if self._own.depth > 1:
            return
        self._own.begin = time.thread_time()
        of_network = str(event.data.get("module", "")).startswith("impactlab_network_")
        if not of_network and self._first.acquire(blocking=False):
            self._call()

    def on_end(self, event: Any) -> None:
        self._own.depth = getattr(self._own, "depth", 1) - 1
        if self._own.depth == 0:
            self.seconds += time.thread_time() - self._own.begin
