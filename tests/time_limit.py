"""Calls that may hang: they are ended after a time."""

import contextlib
import signal

HANGS = 10
"""Time from which on a call or a command hangs (s)."""


class Hangs(BaseException):
    """The time is over; what handles errors does not catch it."""


def _end(number, frame):
    raise Hangs


@contextlib.contextmanager
def limited(seconds=HANGS):
    """End what is done in here after a time."""
    before = signal.signal(signal.SIGALRM, _end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
