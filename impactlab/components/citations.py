"""What to cite for the classes that plain data, or networks as they are stored, name."""

from __future__ import annotations

from typing import Any

from impactlab.components.component import classes_named
from impactlab.components.literature import parts, software
from impactlab.components.stored import named_in


def entries(data: Any) -> list[str]:
    """Return the entries of BibTeX of impactlab and of classes that plain data or stored networks name, each once."""
    found = [software()]
    for name in dict.fromkeys(named_in(data)):
        module, _, last = name.rpartition(".")
        classes = [item for place, item in classes_named(last).items() if module in ("", place)]
        found += [entry for item in classes[:1] for entry in parts(item.citation)]
    return list(dict.fromkeys(found))
