"""Every error that impactlab raises, and every warning that it gives."""

import contextlib
import contextvars
import sys
import warnings
from collections.abc import Callable, Iterator


class ImpactLabError(Exception):
    """Base of all errors raised on purpose by impactlab."""


class InvalidInput(ImpactLabError, ValueError):
    """What was given cannot be used; the message says what is allowed and what to do, in one line."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))  # arrays are printed over several


class NoExactReference(ImpactLabError):
    """The network has no exact stationary law that is known here; the message says why."""


class Diverged(ImpactLabError, ArithmeticError):
    """A realization left the range of finite numbers; the message says when and where."""


class Interrupted(ImpactLabError):
    """A computation was asked to stop before it was complete."""


class ImpactLabWarning(UserWarning):
    """Base of all warnings given by impactlab."""


class AccuracyWarning(ImpactLabWarning):
    """A result is complete, but less is known of its accuracy than was asked for."""


Listener = Callable[[str, type[Warning]], None]

_listener: contextvars.ContextVar[Listener | None] = contextvars.ContextVar("impactlab_listener", default=None)


@contextlib.contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Hand the warnings of impactlab that are given in here, by this thread, to a function instead."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def unheard() -> contextlib.AbstractContextManager[None]:
    """Keep warnings to oneself that were given before."""
    return heard_by(lambda message, category: None)


def warn(message: str, category: type[Warning] = AccuracyWarning) -> None:
    """Give a warning at the line outside of impactlab that led to it."""
    listener = _listener.get()
    if listener is not None:
        listener(message, category)
        return
    level = 2
    while sys._getframe(level - 1).f_globals.get("__name__", "").startswith("impactlab."):
        level += 1
    warnings.warn(message, category, stacklevel=level)
