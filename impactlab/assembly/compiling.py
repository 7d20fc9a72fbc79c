"""Tells when code is compiled that is common to all networks: the first time on a machine, or with a new method."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

from numba.core import event

from impactlab.progress import is_shown, say

_TEXT = "Compiling, once: the machine code is kept. The first time this takes half a minute or so of one core."


@contextlib.contextmanager
def announced(progress: bool | Callable[[float], None] | None) -> Iterator[None]:
    """Say once, where a bar would be shown, that code is compiled in here.

    What is in the cache is not compiled, and the functions of a network alone, which take a second, are not worth a
    line.
    """
    if not is_shown(progress):
        yield
        return
    with event.install_listener("numba:run_pass", _Once(lambda: say(progress, _TEXT))):
        yield


class _Once(event.Listener):  # type: ignore[misc]
    """Calls a function when the compiler begins with anything but the functions of a network, for the first time.

    What is called by a function is compiled while a pass of it goes on, and counts as a part of it.
    """

    def __init__(self, call: Callable[[], None]) -> None:
        self._call, self._first, self._own = call, threading.Lock(), threading.local()

    def on_start(self, event: Any) -> None:
        self._own.depth = getattr(self._own, "depth", 0) + 1
        of_network = str(event.data.get("module", "")).startswith("impactlab_network_")
        if self._own.depth == 1 and not of_network and self._first.acquire(blocking=False):
            self._call()

    def on_end(self, event: Any) -> None:
        self._own.depth = getattr(self._own, "depth", 1) - 1
