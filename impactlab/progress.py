"""A progress bar for long runs that is quiet when nobody watches."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from impactlab.errors import InvalidInput

_PATIENCE = 2.0  # seconds before a bar is worth its line
_WIDTH = 30


def is_watched() -> bool:
    """Whether somebody sees standard error while something runs: on a terminal, or in a notebook."""
    if sys.stderr.isatty():
        return True
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


def is_shown(progress: bool | Callable[[float], None] | None) -> bool:
    """Whether a bar would be shown."""
    return progress is True or (progress is None and is_watched())


def say(progress: bool | Callable[[float], None] | None, text: str) -> None:
    """Print a line where a bar would be shown."""
    if is_shown(progress):
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()


def reporter(progress: bool | Callable[[float], None] | None) -> Callable[[float], None]:
    """Return what is called with the part that is done.

    With None it is a bar if somebody watches, on a terminal or in a notebook, and the run is long; True and False
    decide it; a callable is called itself.
    """
    if callable(progress):
        return progress
    if not (progress is None or isinstance(progress, bool)):
        raise InvalidInput(
            f"progress must be True, False, None or a function of the completed fraction, not {progress!r}."
        )
    if not is_shown(progress):
        return lambda part: None
    begin = time.monotonic()
    shown = False

    def show(part: float) -> None:
        nonlocal shown
        elapsed = time.monotonic() - begin
        if elapsed < _PATIENCE and not shown:
            return
        shown = True
        filled = round(_WIDTH * part)
        left = f"{elapsed / part - elapsed:.0f} s left" if part > 0.0 else ""
        end = "\n" if part >= 1.0 else ""
        sys.stderr.write(f"\r[{'#' * filled}{'.' * (_WIDTH - filled)}] {100.0 * part:3.0f} % {left:<12}{end}")
        sys.stderr.flush()

    return show
