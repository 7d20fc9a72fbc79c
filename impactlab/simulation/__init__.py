"""Simulations: blocks of realizations, the cores they run on, and the page that calls everything."""

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    """Import a module when it is asked for, as `impactlab` does its public names."""
    if name.startswith("_"):
        raise AttributeError(f"module 'impactlab.simulation' has no attribute {name!r}")
    return import_module(f"impactlab.simulation.{name}")
