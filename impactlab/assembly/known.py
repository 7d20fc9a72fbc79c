"""The mechanisms that are known. They stand above all stages, which find them here."""

from __future__ import annotations

from importlib import import_module
from typing import Any

KNOWN: list[Any] = []
"""All mechanisms; a class that derives from `impactlab.assembly.mechanism.Mechanism` adds one."""


def known_mechanisms() -> list[Any]:
    """Return all mechanisms by name."""
    import_module("impactlab.mechanisms")  # late and by its name, since it stands above
    return sorted(KNOWN, key=lambda item: item.name)
