"""What to cite for the classes that plain data name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from impactlab.components.component import classes_named
from impactlab.components.literature import parts, software


def entries(data: Any) -> list[str]:
    """Return the entries of BibTeX of impactlab and of the classes that plain data name, each once."""
    found = [software()]
    for name in dict.fromkeys(_named_in(data)):
        module, _, last = name.rpartition(".")
        classes = [item for place, item in classes_named(last).items() if module in ("", place)]
        found += [entry for item in classes[:1] for entry in parts(item.citation)]
    return list(dict.fromkeys(found))


def _named_in(data: Any) -> Iterator[str]:
    """Give the names of all classes in plain data, which large networks have many of."""
    if isinstance(data, dict):
        if isinstance(name := data.get("type"), str):
            yield name
        data = data.values()
    for value in data:
        if isinstance(value, dict | list | tuple):
            yield from _named_in(value)
