"""Files that callers name, perhaps of somebody else: whether they can be read, and bounds on the data in them."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any

from impactlab.errors import InvalidInput

NESTED = 60
"""Levels of nested data that are read; what reads or prints nested data calls itself, some hundred times at most."""

DIGITS = 100
"""Digits of a whole number that is read: seeds have 39, floating-point numbers end at 308, where they cannot follow."""

TEXT = 200_000_000
"""Bytes of a text file that is read: 10⁶ bodies in TOML, 10⁷ samples of a series; it takes minutes and some GB."""


def file_of(path: Any, most: float = float("inf")) -> Path:
    """Return the path of a regular file that is not empty, or refuse it: devices and pipes have no end."""
    if not isinstance(path, str | os.PathLike):
        raise InvalidInput(f"Give the path of a file, not {path!r}.")
    try:
        file = Path(path)
        found = file.stat()
    except (OSError, ValueError, TypeError):  # too long a name, and what the system takes for no name, too
        raise InvalidInput(f"There is no file {_short(path)}.") from None
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "a device or a pipe"
        raise InvalidInput(f"{file} is {kind}; give the path of a file.")
    if found.st_size == 0:  # as files of the system that have no end
        raise InvalidInput(f"{file} is empty.")
    if found.st_size > most:
        raise InvalidInput(f"{file} has {found.st_size / 1e6:.3g} MB; {most / 1e6:.3g} MB of text are read at most.")
    return file


def bytes_in(path: Any) -> bytes:
    """Return what is in a file of text, or refuse it."""
    file = file_of(path, TEXT)
    try:
        return file.read_bytes()
    except OSError as error:
        raise InvalidInput(f"Cannot read {file}: {error.strerror or error}.") from error


def text_in(path: Any) -> str:
    """Return the text in a file, which is UTF-8, or refuse it."""
    content = bytes_in(path)
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        raise InvalidInput(f"Cannot read {path}: it is no text in UTF-8 ({error}).") from error


def bounded(data: Any) -> None:
    """Refuse nested data of too many levels, and numbers of too many digits, with a `ValueError`."""
    level, depth = [data], 0
    while level:
        if depth > NESTED:
            raise ValueError(f"data are nested in more than {NESTED} levels")
        below = list[Any]()
        for item in level:
            if isinstance(item, dict):
                below += item.values()
            elif isinstance(item, list):
                below += item
            elif type(item) is int and abs(item) >= 10**DIGITS:
                raise ValueError(f"a number has more than {DIGITS} digits")
        level, depth = below, depth + 1


def _short(path: Any) -> str:
    text = str(path)
    return text if len(text) < 300 else f"{text[:100]}…"
