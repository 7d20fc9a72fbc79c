"""The closed list of what a stored configuration may hold: no file can ask for anything else, such as another file."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Any

from impactlab.errors import InvalidInput

_SIMULATION = (
    "duration", "realizations", "step", "integrator", "spin_up", "initial", "record", "seed", "statistics", "continues",
    "branch", "on_divergence",
)  # fmt: skip

OPTIONS: dict[str, tuple[str, ...]] = {
    "simulate": _SIMULATION,
    "run": _SIMULATION,
    "sweep": ("names", "reference"),
    "study": ("name", "settings"),
    "basins": ("over", "grid", "section", "initial", "transient"),
    "bifurcation": (
        "section", "transient", "keep", "follow", "starts", "initial", "names", "tolerance", "over", "seed",
    ),
    "continuation": ("start", "over", "also", "bifurcation", "points"),
    "fragility": (
        "limit", "contact", "probability", "duration", "realizations", "sources", "step", "records", "seed",
    ),
    "lyapunov": ("number", "tolerance", "duration", "transient", "paths", "initial", "seed"),
    "orbits": ("section", "periods", "seed", "initial", "start"),
    "spread": ("network", "start"),
    "uncertain": ("names", "described"),
}  # fmt: skip
"""Options that are stored, by the question that was asked. None of them names a file or a function."""

FURTHER = ("network", "text", "basis", "absorb", "values", "refused")
"""Names beside them: the network, a digest of its kernels, settings of references, and points over parameters."""


def check_options(configuration: Mapping[str, Any]) -> None:
    """Refuse a stored configuration that holds what impactlab does not store."""
    for name, options in configuration.items():
        if name in FURTHER:
            continue
        if name not in OPTIONS:
            known = ", ".join([*OPTIONS, *FURTHER])
            raise InvalidInput(
                f"The stored configuration has {reprlib.repr(name)}, which this version of impactlab does not know: "
                f"it may have {known}."
            )
        if not isinstance(options, Mapping):
            raise InvalidInput(f"The stored configuration has {reprlib.repr(options)} for options of {name!r}.")
        unknown = [option for option in options if option not in OPTIONS[name]]
        if unknown:
            raise InvalidInput(
                f"The stored configuration has the option {reprlib.repr(unknown[0])} of {name!r}, which is none of "
                f"{', '.join(OPTIONS[name])}."
            )
