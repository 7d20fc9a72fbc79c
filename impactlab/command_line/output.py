"""What commands have in common: exit codes, and what is said beside results."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

DONE, FAILED, USAGE, INCOMPLETE = range(4)
"""Exit codes."""

INTERRUPTED, CLOSED = (128 + number for number in (2, 13))
"""Exit codes of programs that SIGINT ends, and SIGPIPE, whose reader has gone, as of ``| head``."""

Command = Callable[[str, Callable[[argparse.Namespace], int], str], argparse.ArgumentParser]
"""Adds a command: its name, its function, what it does."""


def say(*parts: str) -> None:
    """Print a line that is no result: to standard error."""
    print("impactlab:", *parts, file=sys.stderr)


def in_columns(rows: Sequence[Sequence[str]], indent: str = "") -> str:
    """Return rows of texts as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(f"{indent}{line}".rstrip() for line in lines)
