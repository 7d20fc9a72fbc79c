"""A progress bar for long runs that is quiet when nobody watches."""

from __future__ import annotations

import html
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from impactlab.errors import InvalidInput

_PATIENCE = 2.0  # seconds before a bar is worth its line
_WIDTH = 30


def is_watched() -> bool:
    """Whether somebody sees standard error while something runs: on a terminal, or in a notebook."""
    return sys.stderr.isatty() or _in_notebook()


def _in_notebook() -> bool:
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


def nothing() -> str:
    """Tell that nothing is found yet."""
    return ""


@dataclass(frozen=True)
class Report:
    """Takes the part of a run that is done, and what tells what was found so far."""

    show: Callable[[float, Callable[[], str]], None]
    """Is called with both; what tells what was found is called only if it is shown."""
    telling: bool = True  # whether anybody is told what was found

    def __call__(self, part: float, found: Callable[[], str] = nothing) -> None:
        self.show(part, found)

    @classmethod
    def of(cls, function: Callable[[float], None]) -> Report:
        """Return a report that calls a function with the part done; a report is returned unchanged."""
        return function if isinstance(function, Report) else cls(lambda part, _: function(part), telling=False)


def reporter(progress: bool | Callable[[float], None] | None) -> Report:
    """Return a report: a function of the part done, and a text of the results so far.

    With None it is a bar if somebody watches, on a terminal or in a notebook, and the run is long; True and False
    decide it; a callable is called itself.
    """
    if callable(progress):
        return Report.of(progress)
    if not (progress is None or isinstance(progress, bool)):
        raise InvalidInput(
            f"progress must be True, False, None or a function of the completed fraction, not {progress!r}."
        )
    return Report(_Bar().show) if is_shown(progress) else Report(lambda part, found: None, telling=False)


class _Bar:
    """A bar with the time that is left and what was found so far, on a terminal or in a notebook."""

    def __init__(self) -> None:
        self.begin = 0.0  # when the first part was told: before that code may have been compiled
        self.display: Any = None  # of a notebook
        self.length = 0  # of the line that stands there

    def show(self, part: float, found: Callable[[], str]) -> None:
        """Show it, unless the run is too young."""
        self.begin = self.begin or time.monotonic()
        elapsed = time.monotonic() - self.begin
        if elapsed < _PATIENCE and not self.length:
            return
        left = f"{elapsed / part - elapsed:.0f} s left" if 0.0 < part < 1.0 else ""
        told = "   ".join(text for text in (f"{100.0 * part:3.0f} %", left, found() if part < 1.0 else "") if text)
        if _in_notebook():
            self._as_html(part, told)
        else:
            filled = round(_WIDTH * part)
            line = f"[{'#' * filled}{'.' * (_WIDTH - filled)}] {told}"
            end = "\n" if part >= 1.0 else ""
            sys.stderr.write(f"\r{line:<{self.length}}{end}")
            sys.stderr.flush()
        self.length = max(self.length, len(told) + _WIDTH + 3)

    def _as_html(self, part: float, told: str) -> None:
        from IPython.display import HTML, display

        text = f'<progress value="{part:.3f}" max="1"></progress> {html.escape(told)}'
        bar = HTML(text)  # type: ignore[no-untyped-call]
        if self.display is None:
            self.display = display(bar, display_id=True)  # type: ignore[no-untyped-call]
        else:
            self.display.update(bar)
