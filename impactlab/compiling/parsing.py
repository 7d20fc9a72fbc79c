"""Text to a syntax tree, one thread at a time."""

from __future__ import annotations

import ast
import threading

_ONE_AT_A_TIME = threading.Lock()


def parsed(text: str) -> ast.Module:
    """Return the syntax tree of a text.

    Threads that parse at once share a counter in CPython 3.11, and one of them may get a `SystemError` for a text that
    is right.
    """
    with _ONE_AT_A_TIME:
        return ast.parse(text)
