"""What to cite for the classes that plain data name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from impactlab.components.component import classes_named
from impactlab.components.literature import parts, software


def entries(data: Any) -> list[str]:
    """Return the entries of BibTeX of impactlab and of the classes that plain data name, each once."""
    return list(dict.fromkeys([software(), *_named_in(data)]))


def _named_in(data: Any) -> Iterator[str]:
    if isinstance(data, Mapping):
        name = data.get("type")
        if isinstance(name, str):
            module, _, last = name.rpartition(".")
            found = [item for place, item in classes_named(last).items() if module in ("", place)]
            for item in found[:1]:
                yield from parts(item.citation)
        for value in data.values():
            yield from _named_in(value)
    elif isinstance(data, list | tuple):
        for value in data:
            yield from _named_in(value)
