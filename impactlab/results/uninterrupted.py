"""A lock around what an interrupt must not cut in two."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any


class UninterruptedLock:
    """A re-entrant lock; while the main thread holds it or waits for it, Ctrl-C and SIGTERM wait until it is released.

    An interrupt inside of the netCDF library's own locking would leave these locks closed for ever. Signals without
    a handler of Python, by default SIGTERM, are not put off: they end the process.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._depth = 0  # of the main thread
        self._handlers: dict[int, Any] = {}
        self._waiting: list[tuple[int, FrameType | None]] = []

    def acquire(self, blocking: bool = True, timeout: float = -1.0) -> bool:
        """Take the lock."""
        if threading.current_thread() is not threading.main_thread():
            return self._lock.acquire(blocking, timeout)
        if self._depth == 0:
            self._put_off()
        self._depth += 1
        taken = self._lock.acquire(blocking, timeout)
        if not taken:
            self._leave()
        return taken

    def release(self) -> None:
        """Give the lock back, and let signals that came meanwhile be answered."""
        self._lock.release()
        if threading.current_thread() is threading.main_thread():
            self._leave()

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, place: TracebackType | None
    ) -> None:
        self.release()

    def _put_off(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(number)
            if not callable(handler):
                self._handlers.pop(number, None)
            elif handler != self._note:
                self._handlers[number] = handler  # before it is replaced: a signal may come in between
                signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._depth:
            self._waiting.append((number, frame))
        else:
            self._waiting.clear()
            self._handlers[number](number, frame)

    def _leave(self) -> None:
        self._depth -= 1
        if self._depth:
            return
        handlers = dict(self._handlers)
        for number, handler in handlers.items():
            signal.signal(number, handler)
            self._handlers.pop(number, None)
        waiting, self._waiting = self._waiting, []
        for number, frame in waiting[:1]:  # as pressing Ctrl-C twice does while Python is at work
            handlers[number](number, frame)
