"""Tells when code is compiled that is common to all networks: the first time on a machine, or with a new method."""

from __future__ import annotations

import contextlib
import json
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from impactlab.compiling.jit import cache_folder
from impactlab.compiling.numba_private import Listener, install_listener

_LONG = 3.0
"""Time of a compilation, on one core, that is worth a line (s)."""

_NOTE = "seconds.json"
"""File beside the machine code that says how long compilations took, by the function that was the first (s)."""

_OF_NETWORKS = "impactlab_network_", "impactlab.compiling.force_type"
"""Beginnings of the modules whose functions are compiled for each new law, in a second at most."""


@contextlib.contextmanager
def announced(progress: bool | Callable[[float], None] | None) -> Iterator[None]:
    """Say once, on standard error, that code is compiled in here for long, and how long the same took the last time.

    It is said to nobody who has a `progress` of their own, or wants none. What is in the cache is not compiled, and the
    functions of a network alone are not worth a line.
    """
    if not (progress is None or progress is True):
        yield
        return
    compilation = _Compilation(_say)
    with install_listener("numba:run_pass", compilation):
        yield
    if compilation.first:
        with contextlib.suppress(OSError):  # a guess is not worth an error
            note = Path(cache_folder(), _NOTE)
            note.write_text(json.dumps(_times() | {compilation.first: round(compilation.seconds, 1)}), encoding="ascii")


def _say(first: str) -> None:
    """Say that a compilation begins with a function, unless it is short."""
    seconds = _times().get(first)
    if seconds is None or seconds > _LONG:
        taken = "The first time this takes" if seconds is None else "The last time this took"
        long = "half a minute or so" if seconds is None else f"{seconds:.0f} s"
        sys.stderr.write(f"Compiling, once: the machine code is kept. {taken} {long} of one core.\n")
        sys.stderr.flush()


def _times() -> dict[str, float]:
    """Return how long compilations took, also with other versions, whose folders lie beside ours (s)."""
    result: dict[str, float] = {}
    with contextlib.suppress(OSError, ValueError, TypeError, AttributeError, RecursionError):  # a guess
        for note in sorted(cache_folder().parent.glob(f"*-numba*/{_NOTE}"), key=lambda file: file.stat().st_mtime):
            result |= {name: float(seconds) for name, seconds in json.loads(note.read_bytes()).items()}
    return result


class _Compilation(Listener):  # type: ignore[misc]
    """Calls a function when the compiler begins with anything but the functions of a network, for the first time, and
    adds up the time of processors that it takes from there on, in all threads.

    What is called by a function is compiled while a pass of it goes on, and counts as a part of it.
    """

    def __init__(self, call: Callable[[str], None]) -> None:
        self._call, self._lock, self._own = call, threading.Lock(), threading.local()
        self.first, self.seconds = "", 0.0

    def on_start(self, event: Any) -> None:
        self._own.depth = getattr(self._own, "depth", 0) + 1
        if self._own.depth > 1:
            return
        self._own.begin = time.thread_time()
        if not str(event.data.get("module", "")).startswith(_OF_NETWORKS) and self._lock.acquire(blocking=False):
            # names of loops end with a digest of their text
            self.first = re.sub(r"_[0-9a-f]{12,}$", "", str(event.data.get("qualname", "")))
            self._call(self.first)

    def on_end(self, event: Any) -> None:
        self._own.depth = getattr(self._own, "depth", 1) - 1
        if self._own.depth == 0 and self.first:
            self.seconds += time.thread_time() - self._own.begin
