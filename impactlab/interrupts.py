"""Signals that wait while they must not be answered."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Sequence
from types import FrameType, TracebackType
from typing import Any

LATER = 0.02
"""Time after which a signal is sent again that came while a process was forked (s): the fork is then over."""

Noted = tuple[int, FrameType | None]
"""A signal that came, and where."""


class Uninterrupted:
    """While the main thread is in here, Ctrl-C and SIGTERM wait; other threads are never interrupted.

    It may be entered again inside. Signals without a handler of Python, by default SIGTERM, are not put off: they end
    the process.
    """

    def __init__(self) -> None:
        self._depth = 0  # of the main thread
        self._handlers: dict[int, Any] = {}
        self._waiting: list[Noted] = []

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():
            if self._depth == 0:
                self._put_off()
            self._depth += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, place: TracebackType | None
    ) -> None:
        if threading.current_thread() is threading.main_thread():
            handlers = dict(self._handlers)
            _answer(self.leave(), handlers)

    def leave(self) -> list[Noted]:
        """Go out of here, and return the signals that came, unanswered."""
        self._depth -= 1
        if self._depth:
            return []
        self.restore()
        waiting, self._waiting = self._waiting, []
        return waiting

    def restore(self) -> None:
        """Give signals their own handlers back."""
        for number, handler in dict(self._handlers).items():
            signal.signal(number, handler)
            self._handlers.pop(number, None)

    def _put_off(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(number)
            if not callable(handler):
                self._handlers.pop(number, None)
            elif handler != self._note:
                self._handlers[number] = handler  # before it is replaced: a signal may come in between
                signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if not self._depth:
            self._waiting.clear()
            self._handlers[number](number, frame)
        elif number not in [known for known, _ in self._waiting]:  # of one kind the system keeps one as well
            self._waiting.append((number, frame))


def _answer(waiting: Sequence[Noted], handlers: dict[int, Any]) -> None:
    """Call the handlers of signals that came, each of them whatever the others raise."""
    if waiting:
        (number, frame), *others = waiting
        try:
            handlers[number](number, frame)
        finally:
            _answer(others, handlers)


class UninterruptedLock:
    """A re-entrant lock; while the main thread holds it or waits for it, Ctrl-C and SIGTERM wait until it is released.

    An interrupt inside of the netCDF library's own locking would leave these locks closed for ever.
    """

    def __init__(self) -> None:
        self._lock, self._signals = threading.RLock(), Uninterrupted()

    def guard_forks(self) -> None:
        """Let processes be forked only while nobody holds the lock: in the child nobody would release it."""
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(before=self.acquire, after_in_parent=self._go_on, after_in_child=self._begin_anew)

    def acquire(self, blocking: bool = True, timeout: float = -1.0) -> bool:
        """Take the lock."""
        self._signals.__enter__()
        taken = self._lock.acquire(blocking, timeout)
        if not taken:
            self._signals.__exit__(None, None, None)
        return taken

    def release(self) -> None:
        """Give the lock back, and let signals that came meanwhile be answered."""
        self._lock.release()
        self._signals.__exit__(None, None, None)

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, place: TracebackType | None
    ) -> None:
        self.release()

    def _go_on(self) -> None:
        """Release the lock after a fork, and have signals that came meanwhile sent again: errors are lost in here."""
        self._lock.release()
        if threading.current_thread() is threading.main_thread():
            for number, _ in self._signals.leave():
                threading.Timer(LATER, os.kill, (os.getpid(), number)).start()

    def _begin_anew(self) -> None:
        """Be free in a child that was forked by any thread, which is its only one."""
        self._signals.restore()
        self._lock, self._signals = threading.RLock(), Uninterrupted()
