"""Plain data as TOML: values as text, and the lines of a text on which its keys stand."""

from __future__ import annotations

import json
import re
import textwrap
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from impactlab.errors import InvalidInput
from impactlab.given_files import bounded

WIDTH = 100
"""Characters of a line, from which on text and arrays go over several."""

_PART = r"""(?:"(?:[^"\\]|\\.)*"|'[^']*'|[A-Za-z0-9_-]+)"""
_KEY = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*\[\s*({_KEY})\s*\]")
_ASSIGNMENT = re.compile(rf"\s*({_KEY})\s*=")


def key_text(key: str) -> str:
    """Return a key as TOML has it, in quotes where it needs them."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else value_text(key)


def value_text(value: Any) -> str:
    """Return a text, number, truth value, array or mapping of these as TOML has it."""
    if isinstance(value, Mapping):
        items = ", ".join(f"{key_text(key)} = {value_text(item)}" for key, item in value.items())
        return f"{{{items}}}"
    if isinstance(value, list | tuple):
        text = ", ".join(map(value_text, value))
        if len(text) > WIDTH and all(type(item) in (int, float) for item in value):
            text = textwrap.fill(text, WIDTH, initial_indent="\n    ", subsequent_indent="    ") + ",\n"
        return f"[{text}]"
    if isinstance(value, str):  # as in JSON, but for one control character
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return json.dumps(value) if isinstance(value, bool) else repr(value)


def parsed_toml(text: str, place: str) -> dict[str, Any]:
    """Return the data of a TOML text, or refuse it."""
    try:
        data = tomllib.loads(text)
        bounded(data)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{place} cannot be read as TOML: {error}.") from error
    return data


def lines_of(text: str) -> dict[tuple[str, ...], int]:
    """Return the lines on which tables and keys stand, counted from 1, by their paths: (table, …, key)."""
    lines: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = tuple(_path(header[1]))
            lines.setdefault(table, number)
        elif assignment := _ASSIGNMENT.match(line):
            lines.setdefault((*table, *_path(assignment[1])), number)
    return lines


def _path(key: str) -> Iterator[str]:
    """Give the parts of a key that may have dots."""
    data: Any = tomllib.loads(f"{key} = 0")
    while isinstance(data, dict):
        ((part, data),) = data.items()
        yield part
