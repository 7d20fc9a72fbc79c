"""Components of other distributions, which they offer by entry points."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint, EntryPoints

GROUP = "impactlab.components"
"""Group of entry points in which a distribution names its classes of components, each by the name of the class."""


def offered_names() -> list[str]:
    """Return the names of the classes that are offered."""
    return [entry.name for entry in _entries()]


def load_offered(name: str) -> str:
    """Import the modules that define a class which is offered; return whose it is and why it cannot be used, or ""."""
    return next((problem for entry in _entries().select(name=name) if (problem := _load(entry))), "")


def _entries() -> EntryPoints:
    from importlib.metadata import entry_points  # few look for them

    return entry_points(group=GROUP)


def loaded(entry: EntryPoint) -> tuple[Any, str]:
    """Return an entry point's object, and why it cannot be used, or ""; what is printed meanwhile goes to stderr."""
    try:
        with contextlib.redirect_stdout(sys.stderr):
            return entry.load(), ""
    except (Exception, SystemExit) as error:  # whatever a stranger's module does when it is imported
        return None, " ".join(f"{type(error).__name__}: {error}".split())


def _load(entry: EntryPoint) -> str:
    found, problem = loaded(entry)
    if not problem and getattr(found, "__name__", None) != entry.name:
        problem = f"{entry.value} is not a class of that name"
    whose = f"{entry.dist.name} {entry.dist.version}" if entry.dist is not None else "an unknown distribution"
    return problem and f"The component {entry.name!r} of {whose} cannot be used: {problem}."
