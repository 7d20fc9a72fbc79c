"""The time that a call may take: what it calls looks at it, however deep, and stops where none is left."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from contextvars import ContextVar

from impactlab.errors import InvalidInput

_END = ContextVar("end of the time that is allowed", default=math.inf)


class OutOfTime(InvalidInput):
    """A call takes more time than is allowed."""


@contextlib.contextmanager
def allowed_time(seconds: float) -> Iterator[None]:
    """Let what is called meanwhile by this thread take so much time from now on (s), and no more than before."""
    token = _END.set(min(_END.get(), time.monotonic() + seconds))
    try:
        yield
    finally:
        _END.reset(token)


@contextlib.contextmanager
def uncounted_time() -> Iterator[None]:
    """Let time that passes meanwhile not count, such as that of the compiler, which is spent once."""
    begin = time.monotonic()
    try:
        yield
    finally:
        _END.set(_END.get() + time.monotonic() - begin)


def time_left() -> float:
    """Return the time that is left, which is infinite where none was set (s)."""
    return _END.get() - time.monotonic()


def check_time(task: str, foreseen: float = 0.0) -> None:
    """Stop where a task is foreseen to take longer than is left (s), or where nothing is left."""
    left = time_left()
    if foreseen >= left:
        takes = f"would take about {foreseen:.2g} s" if foreseen else "takes longer"
        raise OutOfTime(
            f"{task} {takes}, but {max(left, 0.0):.2g} s are left. Give a larger max_seconds=, or a smaller network."
        )
